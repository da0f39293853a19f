"""Marks whose lengths or times are in another unit than was said are noticed before the fit, which would search for minutes.

The declared model, at the measured values, is held against the first part of each trial: as it is, with lengths times a factor,
and with times times a factor. Where it is far off as it is, and close with a factor far from 1, the unit is wrong.
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
from looping_pendulum.reference_ode.solve import available_integrators, solve_quietly

TIME_FACTORS = 2.0 ** (np.arange(-28, 29) / 4)
"""True time per time in the file that are tried; 1 is among them."""
FALLS = 1.5
"""Length of the part that is looked at, in the times in which a mass falls through the free length."""
FEWEST = 6
"""Marks of a channel in that part; of fewer, nothing is said."""
FAR, CLOSE = 0.15, 10.0
"""Misfit from which marks count as far off, and how many times smaller another factor's must be.

Of the two trials of the example folder it is 0.002 and 0.007 with friction and drag still at their first guess, and 0.19 to
0.98 where lengths or times are 2 to 100 times too large or too small. Of eleven real trials, of balls and of a pendulum, it is
at most 0.011.
"""
UNKNOWN_OFFSET = 0.5
"""How far a clock is taken to be off where the study says that nobody knows [s]."""
OPEN = 0.1
"""Standard error, or distance from 1, of a declared scale or clock ratio from which on a factor is the study's own business."""
OTHER = 1.4
"""Smallest factor, or its inverse, that is another unit or frame rate and no error of measurement."""


@dataclass(frozen=True, kw_only=True)
class _Factor:
    """What marks would have to be multiplied with."""

    what: str
    times: float
    misfit: float


def refuse_other_units(problem: Problem) -> None:
    """Refuse trials whose lengths or times are many times those that the declared model can have.

    Raises
    ------
    DataError
        With the trial, the factor, and the keys by which a study says so.
    """
    for k, data in enumerate(problem.data):
        if not data.channels:
            continue
        try:
            as_it_is, others = _factors(problem, k)
        except (HarnessError, ValueError, ArithmeticError):  # the fit says what is wrong, if anything is
            continue
        best = min(others, key=lambda factor: factor.misfit, default=None)
        if best is None or as_it_is < FAR or best.misfit * CLOSE > as_it_is or 1 / OTHER < best.times < OTHER:
            continue
        unit = "units: {length: cm}" if best.what == "lengths" else "units: {time: ms}' or 'frame_rate: 240 Hz"
        sure = "scale" if best.what == "lengths" else "clock_ratio"
        raise DataError(
            f"trial {data.trial.name!r}: found {best.what} that are {_times(1 / best.times)} what the declared apparatus allows"
            f" (times {number(best.times)}, they would fit), needed both in the same units; say for example '{unit}', mend the "
            f"apparatus, or, if all is as it should be, declare 'camera: {{{sure}: free from 1}}'"
        )


def _times(factor: float) -> str:
    return f"{number(factor)} times" if factor >= 1 else f"1/{number(1 / factor)} of"


def _factors(problem: Problem, k: int) -> tuple[float, list[_Factor]]:
    """Misfit of trial ``k`` as it is, and the best single factors that its study does not leave open."""
    trial = problem.data[k].trial
    parameters, camera = problem.setting(problem.prior_mean, k)
    window = FALLS * math.sqrt(2 * parameters.free_length / 9.81)
    solution = solve_quietly(parameters, duration=window, integrator=available_integrators()[0])
    window = min(window, solution.end_time)

    def seen(ratio: float, late: float = 0.0) -> list[tuple[Channel, Array]]:
        """Marks of the first part, and what would have been seen, at a true time of ``ratio`` times theirs plus ``late``."""
        moved = replace(camera, clock_offset=camera.clock_offset + late)
        channels = []
        for c in problem.data[k].channels:
            count = int(np.searchsorted(moved.true_time(c.t * ratio), window, side="right"))
            if count >= FEWEST and c.name != "angle_rate":
                channels.append(Channel(name=c.name, t=c.t[:count] * ratio, value=c.value[:count], column=c.column))
        if not channels:
            return []
        found = predict(lambda t: solution.sample(np.minimum(t, window)), moved, channels, dropped=trial.dropped).values
        return [(c, found[c.name]) for c in channels]

    here = seen(1.0)
    offset = trial.camera.get("clock_offset")
    late = UNKNOWN_OFFSET if offset is not None and offset.free else 2 * ((offset and offset.sigma) or 0.0)
    shifted = [pairs for shift in (-1.0, -0.5, 0.5, 1.0) if late and (pairs := seen(1.0, shift * late))]
    # few marks during the whole motion: of a slow camera, or of another unit of time
    as_it_is = min((_misfit(pairs) for pairs in (here, *shifted) if pairs), default=1.0)
    others = []
    scale = _best_scale(here)
    if scale > 0 and not _is_open(trial, "scale"):
        others.append(_Factor(what="lengths", times=1 / scale, misfit=_misfit(here, scale)))
    if not _is_open(trial, "clock_ratio"):
        tried = [(_misfit(pairs), ratio) for ratio in TIME_FACTORS.tolist() if (pairs := seen(ratio))]
        others += [_Factor(what="times", times=ratio, misfit=misfit) for misfit, ratio in sorted(tried)[:1]]
    return as_it_is, others


def _is_open(trial: Trial, name: str) -> bool:
    """Whether the study says that this number of the camera may be far from its usual one."""
    known = trial.camera.get(name)
    return known is not None and (known.free or (known.sigma or 0.0) > OPEN or abs(known.value - 1) > OPEN)


def _centred(values: Array) -> Array:
    """Without the mean: where the camera's origin is must not matter."""
    return np.asarray(values - values.mean())


def _best_scale(pairs: list[tuple[Channel, Array]]) -> float:
    """Seen length per true length that fits best; 0 if there is none."""
    if not pairs or any(c.unit != "m" for c, _ in pairs):
        return 0.0
    marks, model = (np.concatenate([_centred(v) for v in side]) for side in zip(*((c.value, p) for c, p in pairs), strict=True))
    size = float(model @ model)
    return float(marks @ model) / size if size else 0.0


def _misfit(pairs: list[tuple[Channel, Array]], scale: float = 1.0) -> float:
    """Sum of squares of what is left, per those of marks and model: 0 if they agree, 1 if one hardly moves beside the other."""
    left = total = 0.0
    for c, p in pairs:
        marks, model = _centred(c.value), scale * _centred(p)
        unit = scale if c.unit == "m" else 1.0  # so that channels of several units count as they do in true lengths
        left += float(np.sum((marks - model) ** 2)) / unit**2
        total += float(marks @ marks + model @ model) / unit**2
    return left / total if total else 0.0
