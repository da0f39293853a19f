"""The steps of a clock: equal ones on which rounded times lie, and equal ones in place of a recorder's uneven ones.

A film's frames follow each other at equal steps, so that its times are whole numbers of frames, perhaps rounded by the program
that wrote them. `tables.times` says what is done to a file's times by these.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from looping_pendulum.reference_ode.geometry import Array

RATE_TOLERANCE = 0.01
"""Relative difference of two frame rates that are the same: the file's clock says 29.97 for 30."""
USUAL_RATES = (15.0, 20.0, 24.0, 25.0, 30.0, 48.0, 50.0, 60.0, 90.0, 100.0, 120.0, 200.0, 240.0, 250.0, 300.0, 400.0, 480.0,
               500.0, 600.0, 960.0, 1000.0)  # fmt: skip
"""Frame rates of cameras [Hz]: rounded times that do not tell a rate from one of these have that one."""
MAX_PLAYED = 60.0
"""Highest rate at which films in slow motion are stored [Hz]."""
EXACT = 1e-3
"""Rounding of times, in steps from row to row, that needs no account: a mass moves by hundredths of a millimetre in it."""
MAX_TIME_STEP = 0.5
"""Largest plausible median time between rows [s]; beyond it, times must be frames or milliseconds.

The slowest real data set has 15 rows a second.
"""
USUAL_SIGMAS = 3.0
"""Standard errors of an uneven clock's mean step within which a usual rate is taken."""
MAX_UNEVEN = 2.5
"""Longest step from row to row, in mean steps, that may be the unrest of a recorder and not a missing row."""
NEAR_STEP = 0.25
"""Largest relative difference of a usual rate's step from the median one at which rows may be counted by that rate."""
TINY = 1e-9
"""Keeps comparisons of decimal times from their last bit [s]."""


def are_milliseconds(number: Array, frame_rate: float | None = None, clip_rate: float | None = None) -> bool | None:
    """Return whether whole numbers are milliseconds (True) or count frames (False); None: they may be either.

    Numbers of frames grow by one step and its multiples, where rows are missing. Rounded milliseconds of a film do not, except
    at rates such as 250/s; then their step fits the film's rate, or one of `MAX_PLAYED` at most, if it is in slow motion.

    Parameters
    ----------
    number
        Whole numbers that grow, shape (n,), n > 1.
    frame_rate, clip_rate
        As of `timed_channels`.
    """
    steps = np.diff(number)
    least = float(steps.min())
    grid = frame_grid(number / 1000, np.full(len(number), 0.5e-3), [r for r in (clip_rate, frame_rate) if r is not None])
    if grid is not None and np.any(np.diff(grid.number) * least != steps):
        return True
    known = clip_rate or frame_rate
    if known is None:
        return None
    if abs(typical_step(number) * known / 1000 - 1) < RATE_TOLERANCE:
        return True
    return False if 1000 / least > MAX_PLAYED * (1 + RATE_TOLERANCE) else None


def typical_step(time: Array) -> float:
    """Return the mean of the steps that are no gaps [s]; 0 with fewer than two rows."""
    steps = np.diff(time)
    steps = steps[steps > 0]
    return _mean_near(steps, 50) if len(steps) else 0.0


def _mean_near(steps: Array, percent: float) -> float:
    """Return the mean of the steps that are about as long as the one that ``percent`` of all do not exceed [s]."""
    usual = np.percentile(steps, percent, method="lower")
    return float(np.mean(steps[(steps > 0.5 * usual) & (steps < 1.5 * usual)]))


@dataclass(frozen=True, kw_only=True, eq=False)
class TimeGrid:
    """Equal steps on which times lie."""

    start: float
    """Time of number 0 [s]."""
    rate: float
    """Steps a second."""
    number: Array
    """Whole number of steps of each time, shape (n,)."""
    largest_error: float
    """Largest distance of a time from its step [s]."""
    cut: float = 0.0
    """What is added to times whose last digits were cut off so that they are as good as rounded ones [s]."""

    def times(self, time: Array, rounding: Array) -> Array | None:
        """Return other rounded times on this grid [s]; None: they are too coarse, or not on it."""
        t = self.start + np.round((time + self.cut - self.start) * self.rate) / self.rate
        is_on_grid = 2 * rounding.max() * self.rate < 1 and np.all(np.abs(t - self.cut - time) <= 2 * rounding + TINY)
        return t if is_on_grid else None

    def at_usual_rate(self, time: Array, rounding: Array, wanted: Sequence[float], tolerance: float = TINY) -> TimeGrid | None:
        """Return the grid with a ``wanted`` rate, or the nearest usual one; None: the rounded times do not allow it."""
        for rate in (*wanted, min(USUAL_RATES, key=lambda r: abs(r - self.rate))):
            low = float(np.max(time - rounding - self.number / rate))
            high = float(np.min(time + rounding - self.number / rate))
            # A film's times count its frames, from one of them on; programs round them, or cut their last digits off
            earliest = min(0.0, float(time[0])) - TINY
            for cut, above in ((0.0, TINY), (float(rounding.max()), -TINY)):
                for start in (0.0, float(np.round((0.5 * (low + high) + cut) * rate + TINY)) / rate):
                    if max(low + cut - TINY, earliest) <= start <= high + cut + above:
                        return replace(self, start=start, rate=rate, cut=cut)
            if low <= high + tolerance:
                return replace(self, start=0.5 * (low + high), rate=rate)
        return None


def frame_grid(time: Array, rounding: Array, rates: Sequence[float] = ()) -> TimeGrid | None:
    """Return the equal steps of which rounded times are whole numbers; None: they are not, or are too coarse to tell.

    Parameters
    ----------
    time
        Times that do not fall [s], shape (n,).
    rounding
        Largest error of each by rounding [s], shape (n,).
    rates
        Steps a second that are likely [Hz].
    """
    if len(time) < 3 or time[-1] <= time[0]:
        return None
    steps = np.diff(time)
    # A quarter of a step where a row has more digits than others, as what is fitted has the others' error
    most = 1.5 * np.minimum(np.maximum(rounding, float(np.median(steps)) / 6), float(rounding.max()))
    last_bit = TINY * (1 + abs(float(time[-1])))
    rows = _fitted_grid(time, np.arange(len(time), dtype=float), most + last_bit)
    usual = float(np.percentile(steps, 50, method="lower"))
    if any(abs(rate * usual - 1) < TINY for rate in (*rates, *USUAL_RATES)):
        # Times that are whole numbers of a usual step are exact, unless no row is missing at another usual rate
        exact = _fitted_grid(time, np.round((time - time[0]) / usual), last_bit)
        if exact and not (rows and rows.at_usual_rate(time, rounding, rates, tolerance=-TINY)):
            return exact
    # Each row a frame; then, where rows may be missing, steps rounded to whole numbers of the smaller ones
    numbers = []
    if np.percentile(steps, 10, method="lower") > 4 * float(rounding.max()):
        numbers.append(np.concatenate([[0.0], np.cumsum(np.round(steps / _mean_near(steps, 10)))]))
    numbers += [np.round((time - time[0]) * rate) for rate in rates]
    grids = (_fitted_grid(time, number, most + last_bit) for number in numbers)
    return rows or next(filter(None, grids), None)


def _fitted_grid(time: Array, number: Array, largest_error: Array | float) -> TimeGrid | None:
    """Return the equal steps nearest to times with these numbers; None: one is farther from its step than is allowed."""
    if not np.all(np.diff(number) > 0):
        return None
    slope, start = np.polyfit(number, time, 1)
    errors = np.abs(time - start - slope * number)
    if slope <= 0 or np.any(errors > largest_error):
        return None
    return TimeGrid(start=float(start), rate=float(1 / slope), number=number, largest_error=float(errors.max()))


@dataclass(frozen=True, kw_only=True, eq=False)
class EvenClock:
    """Equal steps in place of uneven ones."""

    t: Array
    """[s], shape (n,)."""
    text: str
    """What is found and assumed, in words."""
    camera_errors: Mapping[str, float]
    """Parameter of the camera -> its standard error by what is not known of the equal steps [SI]."""


def even_clock(t: Array) -> EvenClock | None:
    """Return equal steps in place of uneven ones that may be a recorder's; None: there are none, or rows are missing.

    Parameters
    ----------
    t
        Times that grow [s], shape (n,).
    """
    steps = np.diff(t)
    # Each row a frame, or, where rows are missing, whole numbers of a usual rate's frames
    numbers = [np.arange(len(t), dtype=float)]
    for rate in USUAL_RATES:
        if abs(rate * float(np.median(steps)) - 1) < NEAR_STEP:
            phase = float(np.angle(np.mean(np.exp(2j * np.pi * rate * t)))) / (2 * np.pi)
            numbers.append(np.round(rate * t - phase))
    clocks = []
    for number in numbers:
        frames, row = np.diff(number), number - number.mean()
        mean = float(row @ t / (row @ row)) if frames.all() else 0.0
        # A longer step is a missing row and not the unrest of a recorder
        if mean and np.all((steps > EXACT * mean * frames) & (steps <= MAX_UNEVEN * mean * frames)):
            clocks.append((float(np.std(t - t.mean() - mean * row)), mean, row))
    if not clocks:
        return None
    scatter, mean, row = min(clocks, key=lambda clock: clock[0] / clock[1])
    error = scatter / float(np.sqrt(row @ row))
    near = [r for r in USUAL_RATES if abs(1 / r - mean) <= max(USUAL_SIGMAS * error, EXACT * mean)]
    step = 1 / min(near, key=lambda r: abs(1 / r - mean)) if near else mean
    low, high = (f"{1e3 * s:.3g}" for s in np.percentile(steps, [5, 95]))
    return EvenClock(
        t=t.mean() + step * row,
        text=f"the steps from row to row are {low} to {high} ms, but the masses move as in equal ones: taken as {1 / step:.4g} "
        "frames a second",
        camera_errors={"clock_offset": scatter / float(np.sqrt(len(row))), "clock_ratio": error / mean},
    )
