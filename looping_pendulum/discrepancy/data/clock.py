"""One account of time: from what a file says of its times, and a study of the camera, to the times of the points.

A film's frames follow each other at equal steps, so that its times are whole numbers of frames, perhaps rounded by the program
that wrote them. Where they are, they are put back; where they are not, the rounding is an error of each time. What was done is
said in a sentence. What the points themselves say of their times stands in `step_durations`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from looping_pendulum.discrepancy.data.noise import scatter
from looping_pendulum.discrepancy.data.observations import Channel, DataError, ReadingNotes
from looping_pendulum.reference_ode.geometry import Array

RATE_TOLERANCE = 0.01
"""Relative difference of two frame rates that are the same: the file's clock says 29.97 for 30."""
USUAL_RATES = (15.0, 20.0, 24.0, 25.0, 30.0, 48.0, 50.0, 60.0, 90.0, 100.0, 120.0, 200.0, 240.0, 250.0, 300.0, 400.0, 480.0,
               500.0, 600.0, 960.0, 1000.0)  # fmt: skip
"""Frame rates of cameras [Hz]: rounded times that do not tell a rate from one of these have that one."""
EXACT = 1e-3
"""Rounding of times, in steps from row to row, that needs no account: a mass moves by hundredths of a millimetre in it."""
MAX_TIME_STEP = 0.5
"""Largest plausible median time between rows [s]; beyond it, times must be frames or milliseconds.

The slowest real data set has 15 rows a second.
"""
MIN_ROUNDED = 10
"""Smallest number of rows whose times are looked at for rounding."""
MIN_EVEN_GAIN = 0.8
"""Scatter of the points about a smooth motion with equal steps, as a share of that with the file's uneven times, at or below
which the frames were even and the times are not theirs."""
MIN_ROWS = 24
"""Smallest number of rows by which the points tell even frames from uneven ones."""
USUAL_SIGMAS = 3.0
"""Standard errors of an uneven clock's mean step within which a usual rate is taken."""
MAX_UNEVEN = 2.5
"""Longest step from row to row, in mean steps, that may be the unrest of a recorder and not a missing row."""


@dataclass(frozen=True, kw_only=True)
class Series:
    """Values of one channel as a table has them, one for each row; not a number: none."""

    column: str
    """Name of its column."""
    value: Array
    """Values [SI], shape (n,)."""
    last_digit: Array
    """What one unit of each value's last digit is worth [SI], shape (n,)."""


@dataclass(frozen=True, kw_only=True)
class Sheet:
    """Rows with one column of times, and the channels that it times."""

    clock: str
    """Name of the column of times, or of frames where there are no times."""
    lines: NDArray[np.intp]
    """Numbers of the lines, shape (n,)."""
    time: Array | None
    """Times by the file's clock [s], shape (n,); not a number: none. None: the file has frames only."""
    rounding: Array
    """Largest error by which rounding has changed each time [s], shape (n,)."""
    frame: Array | None
    """Numbers of the frames, shape (n,); None: the file does not say."""
    channels: Mapping[str, Series] = field(default_factory=dict)


Refusal = Callable[[int | None, str, str], DataError]
"""Function of a line's number, a column's name and a message that returns an error about that place."""


def timed_channels(
    sheets: Sequence[Sheet],
    frame_rate: float | None,
    clip_rate: float | None,
    refuse: Refusal,
    notes: ReadingNotes,
) -> list[Channel]:
    """Return the channels with the times of their points.

    Parameters
    ----------
    frame_rate, clip_rate
        True frame rate of the camera, and that by which the file's times were made [Hz]; None: not stated.
    notes
        To which a sentence is added for everything that was put right or assumed.

    Raises
    ------
    DataError
        If the times cannot be used.
    """
    if frame_rate is not None and all(s.frame is not None for s in sheets):
        times = _times_of_frames(sheets, frame_rate, refuse)
        errors = [0.0] * len(sheets)
    elif any(s.time is None for s in sheets):
        raise refuse(None, "", "found frame numbers but no times, needed the camera's frame rate; give 'frame_rate'")
    else:
        sheets = [_growing(s, refuse) for s in sheets]
        times, errors = _times_of_clock(sheets, frame_rate, clip_rate, refuse, notes)
    channels = []
    for sheet, t, error in zip(sheets, times, errors, strict=True):
        for name, series in sheet.channels.items():
            kept = np.isfinite(series.value) & np.isfinite(t)
            digit = series.last_digit[kept]
            channels.append(
                Channel(
                    name=name, t=t[kept], value=series.value[kept], column=series.column, time_error=error,
                    last_digit=float(digit.max()) if len(digit) else 0.0,
                )
            )  # fmt: skip
    return channels


def _times_of_frames(sheets: Sequence[Sheet], frame_rate: float, refuse: Refusal) -> list[Array]:
    """Compute times from frame numbers; all tracks count from the first frame in which any of them has a point."""
    frames = []
    for s in sheets:
        assert s.frame is not None
        has_point = np.any([np.isfinite(c.value) for c in s.channels.values()], axis=0)
        frame = np.where(has_point, s.frame, np.nan)
        for i in np.flatnonzero(has_point & ~np.isfinite(s.frame)):
            raise refuse(int(s.lines[i]), "frame", "found nothing, needed frame numbers that grow; export them again")
        at = np.flatnonzero(has_point)
        for i, j in zip(at[:-1], at[1:], strict=True):
            if frame[j] <= frame[i]:
                text = f"found {frame[j]:g} after {frame[i]:g}"
                raise refuse(int(s.lines[j]), "frame", f"{text}, needed frame numbers that grow; export them again")
        frames.append(frame)
    first = min(float(np.nanmin(f)) for f in frames)
    return [(f - first) / frame_rate for f in frames]


def _growing(sheet: Sheet, refuse: Refusal) -> Sheet:
    """Return the rows that have a time and a point.

    Raises
    ------
    DataError
        If times run backwards.
    """
    assert sheet.time is not None
    has_point = np.any([np.isfinite(c.value) for c in sheet.channels.values()], axis=0)
    kept = np.flatnonzero(np.isfinite(sheet.time) & has_point)
    time = sheet.time[kept]
    for i in np.flatnonzero(np.diff(time) < 0):
        found = f"found {time[i + 1]:g} after {time[i]:g} (line {sheet.lines[kept[i]]})"
        raise refuse(int(sheet.lines[kept[i + 1]]), sheet.clock, f"{found}, needed times that grow; sort or delete rows")
    return replace(
        sheet,
        lines=sheet.lines[kept],
        time=time,
        rounding=sheet.rounding[kept],
        frame=None if sheet.frame is None else sheet.frame[kept],
        channels={n: replace(c, value=c.value[kept], last_digit=c.last_digit[kept]) for n, c in sheet.channels.items()},
    )


def _times_of_clock(
    sheets: Sequence[Sheet], frame_rate: float | None, clip_rate: float | None, refuse: Refusal, notes: ReadingNotes
) -> tuple[list[Array], list[float]]:
    """Return the times of the rows of each sheet [s], and how far rounding may have changed them, as a standard error [s]."""
    longest = max(sheets, key=lambda s: len(s.lines))
    assert longest.time is not None
    rounding = float(longest.rounding.max()) if len(longest.time) >= MIN_ROUNDED else 0.0
    stated = [r for r in (clip_rate, frame_rate) if r is not None]
    grid = frame_grid(longest.time, longest.rounding, stated) if rounding else None
    step = 1 / grid.rate if grid else _typical_step(longest.time)
    if frame_rate is None and step > MAX_TIME_STEP:
        raise refuse(int(longest.lines[0]), longest.clock, _slow_clock(step))
    file_rate = 1 / step if step else frame_rate
    times: list[Array] = []
    error = 0.0
    if grid and grid.largest_error > EXACT * step:
        # On the declared rate, if the rounded times do not tell the difference
        wanted = [r for r in stated if abs(r * step - 1) < RATE_TOLERANCE]
        grid = grid.at_usual_rate(longest, wanted)
        on_grid = [grid.times(s) for s in sheets]
        if all(t is not None for t in on_grid):
            times = [t for t in on_grid if t is not None]
            file_rate = grid.rate
            coarse = ", which is coarse" if rounding > 0.1 * step else ""
            notes.assumptions.append(
                f"times printed to {2 * rounding:.2g} s{coarse}: put back on {grid.rate:.4g} frames a second; an export with "
                "more decimals needs no such step"
            )
    if not times:
        unique = [_without_repeated_rows(s, refuse, notes) for s in sheets]
        times = _even_times(sheets, unique, stated, notes) if not grid else unique
        error = rounding / np.sqrt(3) if not grid and rounding > EXACT * step else 0.0
        if error:
            notes.assumptions.append(
                f"times printed to {2 * rounding:.2g} s, at no equal steps: that rounding is an error of each time"
            )
    factor = 1.0
    file_rate = clip_rate or file_rate
    if frame_rate is not None and file_rate is not None and abs(file_rate / frame_rate - 1) >= RATE_TOLERANCE:
        factor = file_rate / frame_rate
        assumption = "" if clip_rate else ", taking one row as one frame"
        notes.assumptions.append(f"times made for {file_rate:.4g} frames a second were put to {frame_rate:.4g}{assumption}")
    return [t * factor for t in times], [error * factor] * len(sheets)


def _slow_clock(step: float) -> str:
    """Return what to say of times that are in no seconds."""
    found = f"found a row every {step:g} s, needed many a second"
    if abs(step - 1) < 1e-9:
        return (
            f"{found}; if times count frames, give the camera's 'frame_rate'; if they are in ms, say so: 'units: {{time: ms}}'"
        )
    unit = "us" if step > 1000 else "ms"
    return f"{found}; if times are in {unit}, say so: 'units: {{time: {unit}}}'"


def _typical_step(time: Array) -> float:
    """Return the mean of the steps that are no gaps [s]; 0 with fewer than two rows."""
    steps = np.diff(time)
    steps = steps[steps > 0]
    if not len(steps):
        return 0.0
    middle = float(np.median(steps))
    return float(np.mean(steps[(steps > 0.5 * middle) & (steps < 1.5 * middle)]))


@dataclass(frozen=True, kw_only=True, eq=False)
class Grid:
    """Equal steps on which times lie."""

    start: float
    """Time of number 0 [s]."""
    rate: float
    """Steps a second."""
    number: Array
    """Whole number of steps of each time, shape (n,)."""
    largest_error: float
    """Largest distance of a time from its step [s]."""

    def times(self, sheet: Sheet) -> Array | None:
        """Return the times of a sheet's rows on this grid [s]; None: they are not on it."""
        assert sheet.time is not None
        own = frame_grid(sheet.time, sheet.rounding, [self.rate])
        if own is None:
            return None
        number = np.round((own.start - self.start) * self.rate) + own.number * np.round(self.rate / own.rate)
        t = self.start + number / self.rate
        return t if np.all(np.abs(t - sheet.time) <= 2 * sheet.rounding + 1e-9) else None

    def at_usual_rate(self, sheet: Sheet, wanted: Sequence[float]) -> Grid:
        """Return the grid with one of the ``wanted`` rates, or the nearest usual one, if the rounded times allow it."""
        assert sheet.time is not None
        for rate in (*wanted, min(USUAL_RATES, key=lambda r: abs(r - self.rate))):
            low = float(np.max(sheet.time - sheet.rounding - self.number / rate))
            high = float(np.min(sheet.time + sheet.rounding - self.number / rate))
            if low <= high + 1e-9:
                start = 0.0 if low - 1e-9 <= 0 <= high + 1e-9 else 0.5 * (low + high)
                return replace(self, start=start, rate=rate)
        return self


def frame_grid(time: Array, rounding: Array, rates: Sequence[float] = ()) -> Grid | None:
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
    # Each row a frame; then, where rows may be missing, steps rounded to whole numbers of the smaller ones
    numbers = [np.arange(len(time), dtype=float)]
    steps = np.diff(time)
    small = float(np.percentile(steps, 10))
    if small > 4 * float(rounding.max()):
        one = float(np.mean(steps[(steps > 0.5 * small) & (steps < 1.5 * small)]))
        numbers.append(np.concatenate([[0.0], np.cumsum(np.round(steps / one))]))
    numbers += [np.round((time - time[0]) * rate) for rate in rates]
    for number in numbers:
        if np.all(np.diff(number) > 0):
            slope, start = np.polyfit(number, time, 1)
            largest = float(np.max(np.abs(time - start - slope * number)))
            if slope > 0 and largest <= 1.5 * float(rounding.max()) + 1e-9 * (1 + abs(float(time[-1]))):
                return Grid(start=float(start), rate=float(1 / slope), number=number, largest_error=largest)
    return None


def _without_repeated_rows(sheet: Sheet, refuse: Refusal, notes: ReadingNotes) -> Array:
    """Return the times of a sheet's rows [s], not a number for a row that repeats the one before whole.

    Raises
    ------
    DataError
        If rows at the same time have different values.
    """
    assert sheet.time is not None
    t = sheet.time.copy()
    for i in np.flatnonzero(np.diff(sheet.time) == 0) + 1:
        for name, c in sheet.channels.items():
            notes.unused[f"{name}: the row before repeated"] += int(np.isfinite(c.value[i]))
            if np.isfinite(c.value[i - 1]) and np.isfinite(c.value[i]) and c.value[i] != c.value[i - 1]:
                found = f"found {sheet.time[i]:g} after {sheet.time[i - 1]:g} (line {sheet.lines[i - 1]})"
                needed = "needed times that grow; export them with more decimals, or with the numbers of the frames"
                raise refuse(int(sheet.lines[i]), sheet.clock, f"{found}, {needed}")
        t[i] = np.nan
    return t


def _even_times(sheets: Sequence[Sheet], times: list[Array], stated: Sequence[float], notes: ReadingNotes) -> list[Array]:
    """Return equal steps in place of uneven ones where the points say that the frames were even.

    A program that records a screen or shows a film in steps of its own writes times that are not the camera's.
    """
    if len(sheets) > 1 or len(times[0]) < MIN_ROWS:
        return times
    t = times[0][np.isfinite(times[0])]
    steps = np.diff(t)
    row = np.arange(len(t)) - 0.5 * (len(t) - 1)
    mean = float(row @ t / (row @ row))
    if len(t) < len(times[0]) or not EXACT * mean < steps.min() <= steps.max() <= MAX_UNEVEN * mean:
        return times
    unrest = float(np.std(t - t.mean() - mean * row)) / float(np.sqrt(row @ row))
    rates = (r for r in (*stated, *USUAL_RATES) if abs(1 / r - mean) <= max(USUAL_SIGMAS * unrest, EXACT * mean))
    mean = 1 / min(rates, key=lambda r: abs(1 / r - mean), default=1 / mean)
    even = t.mean() + mean * row
    by_file, by_rows = (_scatter(sheets[0], clock) for clock in (t, even))
    low, high = (f"{1e3 * s:.3g}" for s in np.percentile(steps, [5, 95]))
    frames = f"the steps from row to row are {low} to {high} ms"
    if by_rows > MIN_EVEN_GAIN * by_file:
        notes.assumptions.append(f"{frames}, as the file has them")
        return times
    notes.assumptions.append(f"{frames}, but the masses move as in equal ones: taken as {1 / mean:.4g} frames a second")
    return [even]


def _scatter(sheet: Sheet, t: Array) -> float:
    """Return the scatter of a sheet's channels about a smooth motion with these times, summed over the channels [SI]."""
    total = 0.0
    for name, series in sheet.channels.items():
        kept = np.isfinite(series.value)
        total += scatter(Channel(name=name, t=t[kept], value=series.value[kept]))
    return total
