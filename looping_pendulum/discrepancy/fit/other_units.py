"""Refuse data whose lengths or times are in another unit than was said, before a fit searches for minutes.

The declared model, at the measured values, is compared with the first part of each trial: as it is, with lengths multiplied by
a factor, and with times multiplied by a factor. If it is far off as it is, and close with a factor far from 1, the unit is
wrong.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from looping_pendulum.discrepancy.data.measurement import predict
from looping_pendulum.discrepancy.data.observations import Channel, DataError
from looping_pendulum.discrepancy.data.study import Trial
from looping_pendulum.discrepancy.fit.problem import Problem
from looping_pendulum.errors import HarnessError
from looping_pendulum.pages.numbers import number
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.solve import available_integrators, solve_without_warning

TIME_FACTORS = 2.0 ** (np.arange(-28, 29) / 4)
"""Factors on the file's times that are tried: steps of 1/4 octave, 1 among them."""
WINDOW_FALL_TIMES = 1.5
"""Length of the compared part, in units of the time in which a mass falls through the free length."""
MIN_POINTS = 6
"""Smallest number of points of a channel in that part; channels with fewer are left out."""
MIN_MISFIT, MIN_IMPROVEMENT = 0.15, 10.0
"""Smallest misfit of data that are far off, and how many times smaller the misfit with a factor must be.

For the two trials of the example folder it is 0.002 and 0.007 with friction and drag still at their first guess, and 0.19 to
0.98 where lengths or times are 2 to 100 times too large or too small. For eleven real trials, of balls and of a pendulum, it is
at most 0.011.
"""
UNKNOWN_OFFSET = 0.5
"""Assumed error of the clock's offset where the study says that it is not known [s]."""
MAX_DECLARED_ERROR = 0.1
"""Largest standard error, or distance from 1, of a declared scale or clock ratio with which trials are checked.

Beyond it the study itself says that lengths or times may be off by a factor.
"""
MIN_UNIT_FACTOR = 1.4
"""Smallest factor, or inverse of one, that means another unit or frame rate and not an error of measurement."""


@dataclass(frozen=True, kw_only=True)
class _UnitFactor:
    """A factor on the lengths or times of a trial."""

    what: str
    """"lengths" or "times"."""
    factor: float
    misfit: float
    """Misfit with this factor, see `_misfit`."""


def refuse_wrong_units(problem: Problem) -> None:
    """Refuse trials whose lengths or times are many times those that the declared model can have.

    Raises
    ------
    DataError
        If there is such a trial; the message names it, the factor, and the keys by which a study allows for it.
    """
    for k, data in enumerate(problem.data):
        if not data.channels:
            continue
        try:
            as_it_is, corrections = _misfits(problem, k)
        except (HarnessError, ValueError, ArithmeticError):  # the fit itself will say what is wrong, if anything is
            continue
        best = min(corrections, key=lambda factor: factor.misfit, default=None)
        if (
            best is None
            or as_it_is < MIN_MISFIT
            or best.misfit * MIN_IMPROVEMENT > as_it_is
            or 1 / MIN_UNIT_FACTOR < best.factor < MIN_UNIT_FACTOR
        ):
            continue
        is_length = best.what == "lengths"
        unit = "units: {length: cm}" if is_length else "units: {time: ms}' or 'frame_rate: 240 Hz"
        camera_parameter = "scale" if is_length else "clock_ratio"
        ratio = _times_text(1 / best.factor)
        raise DataError(
            f"trial {data.trial.name!r}: found {best.what} that are {ratio} what the declared apparatus allows"
            f" (times {number(best.factor)}, they would fit), needed both in the same units; say for example '{unit}', correct "
            f"the apparatus, or, if all is right, declare 'camera: {{{camera_parameter}: free from 1}}'"
        )


def _times_text(factor: float) -> str:
    """Write a factor as "25 times" or "1/25 of"."""
    return f"{number(factor)} times" if factor >= 1 else f"1/{number(1 / factor)} of"


def _misfits(problem: Problem, k: int) -> tuple[float, list[_UnitFactor]]:
    """Return the misfit of trial ``k`` as it is, and the best factors on lengths and times, unless its study allows them."""
    trial = problem.data[k].trial
    parameters, camera = problem.parameters_and_camera(problem.prior_mean, k)
    window = WINDOW_FALL_TIMES * math.sqrt(2 * parameters.free_length / 9.81)
    solution = solve_without_warning(parameters, duration=window, integrator=available_integrators()[0])
    window = min(window, solution.end_time)

    def pairs_with_time_factor(ratio: float, clock_shift: float = 0.0) -> list[tuple[Channel, Array]]:
        """Return the channels of the first part and their prediction.

        The true time is that of the camera with the file's times multiplied by ``ratio``, plus ``clock_shift`` [s].
        """
        shifted_camera = replace(camera, clock_offset=camera.clock_offset + clock_shift)
        channels = []
        for c in problem.data[k].channels:
            count = int(np.searchsorted(shifted_camera.true_time(c.t * ratio), window, side="right"))
            # A rate was computed from the angles, and a factor on the times would change it, too
            if count >= MIN_POINTS and c.name != "angle_rate":
                channels.append(Channel(name=c.name, t=c.t[:count] * ratio, value=c.value[:count], column=c.column))
        if not channels:
            return []
        # Times may pass the end of what was solved by rounding
        run = predict(lambda t: solution.sample(np.minimum(t, window)), shifted_camera, channels, dropped=trial.dropped)
        return [(c, run.values[c.name]) for c in channels]

    as_said = pairs_with_time_factor(1.0)
    offset = trial.camera.get("clock_offset")
    # A clock that starts at another time may look like a wrong unit, so that what the study allows of it is tried as well
    clock_shift = UNKNOWN_OFFSET if offset is not None and offset.free else 2 * ((offset and offset.sigma) or 0.0)
    shifted = [
        pairs for shift in (-1.0, -0.5, 0.5, 1.0) if clock_shift and (pairs := pairs_with_time_factor(1.0, shift * clock_shift))
    ]
    # no pairs: too few points during the motion, by a slow camera or another unit of time, which counts as far off
    as_it_is = min((_misfit(pairs) for pairs in (as_said, *shifted) if pairs), default=1.0)
    corrections = []
    scale = _best_scale(as_said)
    if scale > 0 and not _is_left_open(trial, "scale"):
        corrections.append(_UnitFactor(what="lengths", factor=1 / scale, misfit=_misfit(as_said, scale)))
    if not _is_left_open(trial, "clock_ratio"):
        tried = [(_misfit(pairs), ratio) for ratio in TIME_FACTORS.tolist() if (pairs := pairs_with_time_factor(ratio))]
        corrections += [_UnitFactor(what="times", factor=ratio, misfit=misfit) for misfit, ratio in sorted(tried)[:1]]
    return as_it_is, corrections


def _is_left_open(trial: Trial, name: str) -> bool:
    """Return whether the study says that this parameter of the camera may be far from 1."""
    known = trial.camera.get(name)
    return known is not None and (
        known.free or (known.sigma or 0.0) > MAX_DECLARED_ERROR or abs(known.value - 1) > MAX_DECLARED_ERROR
    )


def _centred(values: Array) -> Array:
    """Return values less their mean, so that the camera's origin does not matter."""
    return np.asarray(values - values.mean())


def _best_scale(pairs: list[tuple[Channel, Array]]) -> float:
    """Return the measured length per true length that fits best; 0 if there is none."""
    if not pairs or any(c.unit != "m" for c, _ in pairs):
        return 0.0
    measured, model = (
        np.concatenate([_centred(v) for v in side]) for side in zip(*((c.value, p) for c, p in pairs), strict=True)
    )
    size = float(model @ model)
    return float(measured @ model) / size if size else 0.0


def _misfit(pairs: list[tuple[Channel, Array]], scale: float = 1.0) -> float:
    """Return the sum of squared residuals relative to those of data and model.

    It is 0 if they agree, and 1 if one of them hardly moves compared to the other.
    """
    residual = total = 0.0
    for c, p in pairs:
        measured, model = _centred(c.value), scale * _centred(p)
        unit = scale if c.unit == "m" else 1.0  # so that the scale does not change the weight of lengths beside angles
        residual += float(np.sum((measured - model) ** 2)) / unit**2
        total += float(measured @ measured + model @ model) / unit**2
    return residual / total if total else 0.0
