"""One account of time: from what a file says of its times, and a study of the camera, to the times of the points.

A film's frames follow each other at equal steps, so that its times are whole numbers of frames, perhaps rounded by the program
that wrote them. Where they are, they are put back; where they are not, the rounding is an error of each time. What was done is
said in a sentence. Which pictures are stored again, the points themselves say (`copies`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from looping_pendulum.errors import WayOut
from looping_pendulum.measured.noise import scatter
from looping_pendulum.measured.observations import Channel, DataError, ReadingNotes
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
NEAR_STEP = 0.25
"""Largest relative difference of a usual rate's step from the median one at which rows may be counted by that rate."""
TINY = 1e-9
"""Keeps comparisons of decimal times from their last bit [s]."""


@dataclass(frozen=True, kw_only=True)
class Series:
    """Values of one channel as a table has them, one for each row; not a number: none."""

    column: str
    """Name of its column."""
    value: Array
    """Values [SI], shape (n,)."""
    last_digit: Array
    """What one unit of each value's last digit is worth [SI], shape (n,)."""
    unit: float = 1.0
    """The file's unit [SI]."""
    error: Array | None = None
    """Standard error that the file states of each value [SI], shape (n,); 0: none."""


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
    has_unit: bool = True
    """Whether the file or the study says in which unit the times are."""


Refusal = Callable[..., DataError]
"""Function of a line's number, a column's name, a message and perhaps a way out that returns an error about that place."""


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
    if all(_has_whole_times(s) for s in sheets):
        sheets = _of_whole_numbers(sheets, frame_rate, clip_rate, refuse, notes)
    if frame_rate is not None and all(s.frame is not None for s in sheets):
        times = _times_of_frames(sheets, frame_rate, refuse)
        errors = [0.0] * len(sheets)
    elif any(s.time is None for s in sheets):
        way_out = WayOut(words="give {}", keys={"frame_rate": "240 Hz"}, is_example=True)
        raise refuse(None, "", "found frame numbers but no times, needed the camera's frame rate", way_out)
    else:
        sheets = [_growing(s, refuse) for s in sheets]
        times, errors = _times_of_clock(sheets, frame_rate, clip_rate, refuse, notes)
    channels = []
    for sheet, t, error in zip(sheets, times, errors, strict=True):
        for name, series in sheet.channels.items():
            kept = np.isfinite(series.value) & np.isfinite(t)
            if not kept.any():
                raise refuse(None, series.column, f"found no values at all, needed {name}(t); export that track again")
            digit = series.last_digit[kept]
            channels.append(
                Channel(
                    name=name, t=t[kept], value=series.value[kept], column=series.column, time_error=error,
                    last_digit=float(digit.max()),
                    stated_error=None if series.error is None else (t[kept], series.error[kept]),
                )
            )  # fmt: skip
    return channels


def _has_whole_times(sheet: Sheet) -> bool:
    """Return whether times without a unit are whole numbers, so that they cannot be a film's in seconds."""
    if sheet.has_unit or sheet.time is None or sheet.frame is not None:
        return False
    time = sheet.time[np.isfinite(sheet.time)]
    return len(np.unique(time)) > 1 and not np.any(time % 1)


def _of_whole_numbers(
    sheets: Sequence[Sheet], frame_rate: float | None, clip_rate: float | None, refuse: Refusal, notes: ReadingNotes
) -> list[Sheet]:
    """Return sheets whose times are whole numbers without a unit with milliseconds, or with numbers of frames.

    Raises
    ------
    DataError
        If the column does not tell which of both they are.
    """
    times = [s.time for s in sheets if s.time is not None]
    every = np.concatenate(times)
    number = np.unique(every[np.isfinite(every)])
    in_milliseconds = are_milliseconds(number, frame_rate, clip_rate)
    if in_milliseconds is None:
        found = f"found a row every {_typical_step(number):g} s, needed many a second"
        ask = "if times count frames, give the camera's rate by {}" if frame_rate is None else "else name the column 'frame'"
        counted = WayOut(words=ask, keys={"frame_rate": "240 Hz"}, is_example=True)
        way_out = WayOut(words="if times are in ms, say so: {}", keys={"units.time": "ms"}, alternative=counted)
        raise refuse(int(sheets[0].lines[0]), sheets[0].clock, found, way_out)
    what = "milliseconds, as their steps say" if in_milliseconds else "numbers of frames"
    notes.assumptions.append(f"column {sheets[0].clock!r} has whole numbers without a unit: taken as {what}")
    if not in_milliseconds:
        return [replace(s, frame=s.time) for s in sheets]
    return [replace(s, time=t / 1000, rounding=s.rounding / 1000) for s, t in zip(sheets, times, strict=True)]


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
    if abs(_typical_step(number) * known / 1000 - 1) < RATE_TOLERANCE:
        return True
    return False if 1000 / least > MAX_PLAYED * (1 + RATE_TOLERANCE) else None


def _times_of_frames(sheets: Sequence[Sheet], frame_rate: float, refuse: Refusal) -> list[Array]:
    """Compute times from frame numbers; all tracks count from the first frame in which any of them has a point."""
    frames = []
    for s in sheets:
        assert s.frame is not None
        has_point = np.any([np.isfinite(c.value) for c in s.channels.values()], axis=0)
        frame = np.where(has_point, s.frame, np.nan)
        before = -np.inf
        for i in np.flatnonzero(has_point):
            if not frame[i] > before:
                found = "nothing" if np.isnan(frame[i]) else f"{frame[i]:g} after {before:g}"
                raise refuse(int(s.lines[i]), "frame", f"found {found}, needed frame numbers that grow; export them again")
            before = frame[i]
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
        found = f"found a row every {step:g} s, needed many a second"
        unit = "us" if step > 1000 else "ms"
        way_out = WayOut(words=f"if times are in {unit}, say so: {{}}", keys={"units.time": unit})
        raise refuse(int(longest.lines[0]), longest.clock, found, way_out)
    file_rate = 1 / step if step else frame_rate
    times: list[Array] = []
    error = 0.0
    if grid and grid.largest_error > EXACT * step:
        # On the declared rate, if the rounded times do not tell the difference
        wanted = [r for r in stated if abs(r * step - 1) < RATE_TOLERANCE]
        grid = grid.at_usual_rate(longest.time, longest.rounding, wanted) or grid
        on_grid = [grid.times(s) for s in sheets]
        if all(t is not None for t in on_grid):
            times = [t for t in on_grid if t is not None]
            file_rate = grid.rate
            notes.camera_errors["clock_offset"] = rounding
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


def _typical_step(time: Array) -> float:
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

    def times(self, sheet: Sheet) -> Array | None:
        """Return the times of a sheet's rows on this grid [s]; None: they are not on it."""
        assert sheet.time is not None
        own = frame_grid(sheet.time, sheet.rounding, [self.rate])
        if own is None:
            return None
        number = np.round((own.start + self.cut - self.start) * self.rate) + own.number * np.round(self.rate / own.rate)
        t = self.start + number / self.rate
        return t if np.all(np.abs(t - self.cut - sheet.time) <= 2 * sheet.rounding + TINY) else None

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


@dataclass(frozen=True, kw_only=True, eq=False)
class EvenClock:
    """Equal steps in place of uneven ones."""

    t: Array
    """[s], shape (n,)."""
    text: str
    """What is found and assumed, in words."""
    camera_errors: Mapping[str, float]
    """Parameter of the camera -> its standard error by what is not known of the equal steps [SI]."""


def even_clock(t: Array, stated: Sequence[float] = ()) -> EvenClock | None:
    """Return equal steps in place of uneven ones that may be a recorder's; None: there are none, or rows are missing.

    Parameters
    ----------
    t
        Times that grow [s], shape (n,).
    stated
        Rates that the study states [Hz].
    """
    steps = np.diff(t)
    # Each row a frame, or, where rows are missing, whole numbers of a usual rate's frames
    likely = [r for r in (*stated, *USUAL_RATES) if abs(r * float(np.median(steps)) - 1) < NEAR_STEP]
    numbers = [np.arange(len(t), dtype=float), *(_frame_numbers(t, r) for r in likely)]
    clocks = [clock for number in numbers if (clock := _even_clock(t, number))]
    if not clocks:
        return None
    unrest, mean, row = min(clocks, key=lambda clock: clock[0] / clock[1])
    unrest /= float(np.sqrt(row @ row))
    rates = (r for r in (*stated, *USUAL_RATES) if abs(1 / r - mean) <= max(USUAL_SIGMAS * unrest, EXACT * mean))
    fitted, mean = mean, 1 / min(rates, key=lambda r: abs(1 / r - mean), default=1 / mean)
    errors = {"clock_offset": unrest * float(np.sqrt(row @ row / len(row)))}
    if 1 / mean not in stated:
        errors["clock_ratio"] = unrest / fitted
    return EvenClock(
        t=t.mean() + mean * row,
        text=f"{_steps_in_words(steps)}, but the masses move as in equal ones: taken as {1 / mean:.4g} frames a second",
        camera_errors=errors,
    )


def _steps_in_words(steps: Array) -> str:
    low, high = (f"{1e3 * s:.3g}" for s in np.percentile(steps, [5, 95]))
    return f"the steps from row to row are {low} to {high} ms"


def _even_times(sheets: Sequence[Sheet], times: list[Array], stated: Sequence[float], notes: ReadingNotes) -> list[Array]:
    """Return equal steps in place of uneven ones where the points say that the frames were even.

    A program that records a screen or shows a film in steps of its own writes times that are not the camera's.
    """
    t = times[0]
    if len(sheets) > 1 or len(t) < MIN_ROWS or not np.all(np.isfinite(t)):
        return times
    even = even_clock(t, stated)
    if even is None:
        return times
    by_file, by_rows = (_scatter(sheets[0], clock) for clock in (t, even.t))
    if by_rows > MIN_EVEN_GAIN * by_file:
        notes.assumptions.append(f"{_steps_in_words(np.diff(t))}, as the file has them")
        return times
    notes.assumptions.append(even.text)
    notes.camera_errors.update(even.camera_errors)
    return [even.t]


def _frame_numbers(t: Array, rate: float) -> Array:
    """Return the whole numbers of frames nearest to uneven times."""
    phase = float(np.angle(np.mean(np.exp(2j * np.pi * rate * t)))) / (2 * np.pi)
    return np.asarray(np.round(rate * t - phase))


def _even_clock(t: Array, number: Array) -> tuple[float, float, Array] | None:
    """Return how uneven the times of numbered frames are [s], their mean step [s] and their numbers from the middle one on.

    None: some steps are too long for the unrest of a recorder.
    """
    frames = np.diff(number)
    if not np.all(frames > 0):
        return None
    row = number - number.mean()
    mean = float(row @ t / (row @ row))
    if not np.all((np.diff(t) > EXACT * mean * frames) & (np.diff(t) <= MAX_UNEVEN * mean * frames)):
        return None
    return float(np.std(t - t.mean() - mean * row)), mean, row


def _scatter(sheet: Sheet, t: Array) -> float:
    """Return the scatter of a sheet's channels about a smooth motion with these times, summed over the channels [SI]."""
    total = 0.0
    for name, series in sheet.channels.items():
        kept = np.isfinite(series.value)
        total += scatter(Channel(name=name, t=t[kept], value=series.value[kept]))
    return total
