"""Say how the motion begins in the records that begin in mid-swing."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

from looping_pendulum.discrepancy.fit.calibration import Fit
from looping_pendulum.discrepancy.trial_results import RecordStart
from looping_pendulum.pages.numbers import number, uncertain


def record_starts(fits: Iterable[tuple[Fit, int, bool]]) -> tuple[RecordStart, ...]:
    """Return the starts of the records that begin in mid-swing; of each trial its fit, its index there, whether held out."""
    starts = []
    for fit, k, held_out in fits:
        trial = fit.problem.data[k].trial
        if not trial.in_mid_swing:
            continue
        parameters, _ = fit.problem.parameters_and_camera(fit.x, k)
        errors = {n.parameter: fit.errors[n.name] for n in fit.problem.free_parameters if trial.name in n.trials}
        starts.append(
            RecordStart(
                trial=trial.name,
                held_out=held_out,
                time=float(fit.problem.data[k].t.min()),
                angle=parameters.release_angle,
                angle_error=errors.get("release_angle", 0.0),
                speed=parameters.coefficients["push_across"],
                speed_error=errors.get("push_across", 0.0),
            )
        )
    return tuple(starts)


def record_starts_in_words(starts: Sequence[RecordStart]) -> str:
    """Return a paragraph for the report; empty if no record begins in mid-swing."""
    lines = [
        f"- {s.trial}: at {number(s.time, digits=4)} s by the file's clock, the first tracked point, the wrap angle is "
        f"{uncertain(math.degrees(s.angle), math.degrees(s.angle_error), 'deg')} (180 deg is straight down) and the light mass "
        f"moves across its string at {uncertain(s.speed, s.speed_error, 'm/s')}.\n"
        for s in starts
    ]
    if not lines:
        return ""
    note = (
        "These records begin in mid-swing, so that the motion begins at their first tracked point. Its angle and speed are "
        "fitted unless the study states them (`release: {angle: ..., speed: ...}`); they are no push.\n\n"
    )
    return "## Start of the records\n\n" + note + "".join(lines)
