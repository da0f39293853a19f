"""Rows of a film that are displaced in time, by the points themselves: repeated, lost and uneven pictures.

Over a short while the masses' motion is a polynomial of the time. Points whose pictures were taken earlier or later than their
times say lie beside it along the velocity, those of all masses by one and the same time. That time is fitted; no model of the
motion is needed.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple, Protocol, TypeVar

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from looping_pendulum.measured.noise import scatter
from looping_pendulum.measured.observations import BODIES, Channel, ReadingNotes
from looping_pendulum.reference_ode.geometry import Array

T = TypeVar("T")

HALF_WINDOWS = ((3, 0.0125), (6, 0.025), (6, 0.05))
"""Rows, and time [s], on each side over which the motion is taken for a polynomial, whichever is longer.

Of those windows that fit, the longest one counts.
"""
MAX_HALF = 24
"""Largest number of rows on each side, at many frames a second."""
PATTERN_HALF_WINDOWS = (6, 3)
"""The same for patterns; the longer one holds all of them whole, but with few frames a second the masses turn in it."""
DEGREE = 3
"""Degree of the polynomial."""
FINER_DEGREE = 5
"""Degree of the polynomials by which the points alone must show lost and repeated pictures, too, in the longest window.

In 20 rows a second, a swing of 1.7 s is no cubic at its turning points, and looks displaced there. In the shortest windows, a
tracker that slips to another object for some rows looks so in 11 of 100 clean studies with outliers, and in none of them here.
"""
MAX_MISFIT_RATIO = 1.25
"""Largest mean square of a longer window's residuals, in that of a shorter one or in the noise's, with which it is taken."""
MAX_MISFIT = 2.5
"""The same with which a displacement is named at all: beyond it the motion is no polynomial, as where a string jerks."""
MAX_MISFIT_AGREED = 6.0
"""The same where a model agrees."""
REFITS = 3
"""Number of fits, each with the velocity of the one before: rows that are displaced change it."""
MAX_DISPLACEMENT = 6.0
"""Largest displacement that is fitted [steps]."""
MIN_SIGMAS = 6.0
"""Standard errors by which a row must be displaced. Of 312 blind trials with right times, the largest is 5.4."""
MAX_ACROSS, MAX_SLOPE = 4.0, 0.1
"""Largest displacement otherwise than along the velocities, in standard errors and in the one along them.

A tracker that slips goes another way than the mass, and with one mass alone.
"""
COPIED = (-1.5, -0.6)
"""Displacement of a row, or of all from it on, in which the picture before is stored again [steps]."""
MAX_STOP, MIN_WAY, MIN_COSINE = 0.2, 20.0, 0.5
"""The same by three steps in a row: largest speed of the middle one in that of the others, smallest way that it should be
[standard deviations of the noise], and smallest cosine of the angle between the others."""
MAX_LOST = 12
"""Largest number of places at which pictures are lost that are looked for."""
MIN_CHANGE = 0.05
"""Smallest change of the misfits from a model by other times that tells anything."""
MIN_LOST = 0.6
"""The same of all rows after lost pictures."""
RATE_FACTORS = (2.0, 4.0, 8.0, 1 / 2, 1 / 4, 1 / 8)
"""Factors by which the duration of a row may change in a film: those of a phone's slow motion."""
RATE_HALF_WINDOWS = (3, 4, 6, 10)
"""Rows on each side of one from which on they last longer or shorter."""
MIN_GAIN, MIN_OWN_GAIN = 30.0, 40.0
"""Smallest fall of the residuals' sum of squares [variances of the noise] by a change of the clock, and without a model.

In films with one clock, that a string lies on itself or a tracker slips gives 30 to 130, without the conditions below.
"""
MIN_NOISE_LEFT = 0.3
"""Smallest part of the noise's sum of squares that remains, so that windows with less to lose need not be tried."""
MIN_GAIN_RATIO, MIN_MISFIT_FALL = 1.5, 3.0
"""Without a model: the same in that by leaving out one row, and smallest factor by which the misfit falls."""
MIN_OWN_HALF = 6
"""Without a model: smallest number of rows on each side, as in short windows few numbers describe any motion."""
MAX_CHANGES = 4
"""Largest number of changes of the clock, the clearest ones."""
MAX_PERIOD = 6
"""Longest pattern of repeated or uneven frames [frames]."""
MIN_PATTERN_SIGMAS = 6.0
"""Standard errors by which durations at the places of a pattern must differ."""
MIN_ROWS = 12
"""Smallest number of rows that show anything."""
MIN_FRESH = 6
"""Smallest number of points that are left without copies."""
MAX_ROWS = 4000
"""Largest number of rows that are looked at, the first ones: a minute at 60 frames a second."""
MIN_MISFIT_RATIO = 0.8
"""Misfit of a longer pattern, in that of a shorter one, below which it is the longer one."""
COPY = 0.35
"""Duration of a step below which a picture is stored again [steps]."""
MIN_UNEVEN = 0.08
"""Smallest difference of the durations of frames in turn that is named: at 240 a second, a third of a millisecond."""
MAX_ROW_ERROR = 0.3
"""Largest error of a row's displacement by the noise with which it tells of uneven times [steps]."""
MAX_SIGMAS = 8.0
"""Largest displacement of a row that counts [standard errors]."""
MIN_UNEVEN_RATIO = 2.2
"""Smallest ratio of the points' mean squares along and across their ways at which times are uneven.

Where the noise grows with the speed, the ratio is up to 1.9, of 38 films with even times.
"""
MAX_CHANCE_DIGIT = 0.2
"""Last digit, in standard deviations of the noise, up to which equal points are no chance but copies."""
MIN_COPIES = 3
"""Smallest number of points that are equal to the one before, or where the masses were then, of which any is a copy."""
MIN_NOISE = 5e-5
"""Smallest noise, as a part of the range of the values, in which a copy tells anything: made-up data have none."""
MAX_SHOWN = 3
"""Largest number of rows that a sentence names."""
OWN_TIMES = "export the film's own frame times, or its frame numbers"
"""Way out where pictures are lost, repeated or uneven."""
ONE_CLOCK = (
    "share the film as the camera took it, without a part in slow motion, and mark it again, or mark one part and state its "
    "'frame_rate'"
)
"""Way out where the clock changes."""


def without_copies(channels: Sequence[Channel], notes: ReadingNotes) -> list[Channel]:
    """Return the channels without pictures that are stored again: every picture as often, or single ones with equal points.

    A copy has no noise of its own, so that it would count twice in a fit.
    """
    film = _film(tuple(channels))
    pattern = None if film is None else _pattern_of_copies(film)
    if film is None or pattern is None:
        return [c for body in _by_body(channels) for c in _without_equal_points(body, notes)]
    period, new = len(pattern), int(pattern.sum())
    first = int(np.argmax(pattern))
    by_file, even = [], []
    for c in channels:
        number = film.number_of(c.t)
        kept = pattern[number % period]
        rank = (np.cumsum(pattern)[number % period] - 1 + new * (number // period))[kept]
        by_file.append(replace(c, t=c.t[kept], value=c.value[kept]))
        # A camera's pictures are even in time, which a film shows twice and three times in turn
        even.append(replace(by_file[-1], t=film.t[0] + (first + rank * period / new) * film.step))
    noise = [scatter(c) for c in by_file]
    chosen = min((by_file, even), key=lambda those: _roughness(those, noise))
    every = f"every picture is stored {period} times" if new == 1 else f"{period} rows show {new} pictures"
    rows = f"{len(max(chosen, key=len))} of {len(max(channels, key=len))}"
    notes.assumptions.append(f"{every}: one row of each is kept, {rows}")
    return chosen


def with_time_errors(channels: Sequence[Channel], notes: ReadingNotes) -> list[Channel]:
    """Return the channels with an error of each time, if points lie farther from a smooth motion along their ways than across.

    So it is where pictures are taken unevenly, but their times are even.
    """
    film = _film(tuple(channels))
    if film is None:
        return list(channels)
    rows = film.best_displacements(onward=False)
    precise = np.flatnonzero((rows.misfit < MAX_MISFIT) & (rows.error < MAX_ROW_ERROR))
    others = len(film.values) - 1
    if len(precise) < MIN_ROWS or not others:
        return list(channels)
    # By the noise alone; a point that is far out in either direction is an outlier
    widening = np.sqrt(np.maximum(rows.misfit[precise], 1.0))
    error = rows.error[precise] / widening
    along, across = (
        np.minimum(np.abs(each), MAX_SIGMAS) ** 2 for each in (rows.value[precise] / error, rows.across[precise] * widening)
    )
    noise = max(float(np.mean(across)) / others, 1.0)
    if np.mean(along) < noise * max(MIN_UNEVEN_RATIO, 1 + MIN_SIGMAS * np.sqrt(2 / len(precise))):
        return list(channels)
    variance = float(np.average((along - noise) * error**2, weights=1 / (error**2 + MIN_UNEVEN**2) ** 2))
    time_error = film.step * float(np.sqrt(max(variance, 0.0)))
    if time_error < 2 * max(c.time_error for c in channels):  # what rounding explains
        return list(channels)
    notes.assumptions.append(
        f"by the masses' motion, pictures were taken unevenly, {1e3 * time_error:.2g} ms beside their times: taken as an error "
        "of each time"
    )
    return [replace(c, time_error=time_error) for c in channels]


def without_repeated_rows(channels: Sequence[Channel], notes: ReadingNotes) -> list[Channel]:
    """Return the channels without single rows in which the masses are where they were a row before.

    There the picture before is stored again, or a tracker slipped; such a row tells nothing in either case.
    """
    film = _film(tuple(channels))
    if film is None:
        return list(channels)
    rows = [each for each in _displaced_rows(film, None, _unrest(channels, film)) if not each.onward]
    if not 0 < len(rows) < MIN_COPIES:
        return list(channels)
    times = " and ".join(f"{each.t:.4g} s" for each in rows)
    notes.assumptions.append(
        f"at {times} the masses are where they were a row before, as where a picture is stored again or a tracker slips: "
        "left out"
    )
    kept = [~np.any([each.concerns(c.t) for each in rows], axis=0) for c in channels]
    return [replace(c, t=c.t[k], value=c.value[k]) for c, k in zip(channels, kept, strict=True)]


@dataclass(frozen=True, kw_only=True)
class WrongTimes:
    """What is wrong with the times of a row, or of all from it on."""

    t: float
    """Time of the first row by the file [s]."""
    shift: float = 0.0
    """By how much later the pictures were taken [s]."""
    factor: float = 1.0
    """How long a row lasts, in what it lasted before."""
    onward: bool = True
    """Whether all later rows are concerned, too."""

    def concerns(self, t: Array) -> NDArray[np.bool_]:
        """Return which rows' times, by the file [s], are wrong."""
        return np.asarray(t > self.t - 1e-9 if self.onward else np.isclose(t, self.t))

    def undone(self, t: Array) -> Array:
        """Return the times at which the pictures of some rows were taken [s]."""
        return np.asarray(np.where(self.concerns(t), self.t + self.factor * (t - self.t) + self.shift, t))


class KnownMotion(Protocol):
    """What a model knows of the motion beside its points."""

    def agrees(self, wrong: tuple[WrongTimes, ...]) -> bool | None:
        """Return whether it agrees with other times; None: it does not tell."""

    def gain(self, wrong: tuple[WrongTimes, ...], known: tuple[WrongTimes, ...]) -> float:
        """Return by how much nearer to it the points are with other times than with others that are known already."""


def clock_faults(channels: Sequence[Channel], model: KnownMotion | None = None) -> list[str]:
    """Return what the points say against the times: clocks that change, lost, repeated and uneven pictures.

    None of these can be put right.

    Parameters
    ----------
    model
        What is asked about rows from which on all times are wrong. Where a tracker slips along the mass's way, or the string
        jerks, the points alone look the same; without this, only the clearest are named.
    """
    film = _film(tuple(channels))
    if film is None:
        return []
    changes = _rate_changes(film, is_clear=False) if model else []
    agreed = None
    if model and changes:
        by_earlier, by_later = by_either_clock(changes)
        agreed = model.agrees(by_earlier)
        agreed = agreed or model.agrees(by_later) or agreed
    if agreed is None:
        changes = _rate_changes(film, is_clear=True)
    unrest = _unrest(channels, film)
    if changes and agreed is not False:
        displaced = _displaced_rows(film, model, unrest) if model else []
        # Some pictures that are lost while the masses are slow look like a change
        is_nearer = model and displaced and model.gain(tuple(displaced), tuple(changes)) > MIN_CHANGE
        return sentences(displaced if is_nearer else changes, film.step)
    uneven = _uneven_pattern(film)
    if uneven is not None:
        means = " and ".join(f"{m:.2g}" for m in uneven)
        return [f"frames in turn last {means} of their mean, by the masses' motion, unlike their times; {OWN_TIMES}"]
    return sentences(_displaced_rows(film, model, unrest), film.step)


def by_either_clock(wrong: Sequence[WrongTimes]) -> tuple[tuple[WrongTimes, ...], tuple[WrongTimes, ...]]:
    """Return the same times by the film's clock before a first change, and by that after it."""
    return (*wrong,), (WrongTimes(t=0.0, factor=1 / wrong[0].factor), *wrong)


def sentences(wrong: Sequence[WrongTimes], step: float) -> list[str]:
    """Return in words which rows' times are wrong, and how; ``step`` is the time from row to row by the file [s]."""
    changes = [rows for rows in wrong if rows.factor != 1]
    said = []
    if changes:
        ratios = (f"{c.factor:.3g} times" if c.factor > 1 else f"1/{1 / c.factor:.3g}" for c in changes)
        found = " and ".join(
            f"from {c.t:.3g} s on a row lasts {words} as long" for c, words in zip(changes, ratios, strict=True)
        )
        said.append(f"by the masses' motion, the clock changes: {found}; {ONE_CLOCK}")

    def is_copy(rows: WrongTimes) -> bool:
        return COPIED[0] < rows.shift / step < COPIED[1]

    for named, what in (
        (
            [rows for rows in wrong if rows.onward and rows.shift > 0],
            "on the masses are ahead of their times, as where pictures are lost (at the first place {steps:.2g})",
        ),
        (
            [rows for rows in wrong if is_copy(rows)],
            "on the masses are where they were before, so that a picture is stored again there",
        ),
        (
            [rows for rows in wrong if rows.shift and not rows.onward and not is_copy(rows)],
            "on pictures were taken up to {most:.2g} ms beside their times, by the masses' way",
        ),
    ):
        if named:
            shown = ", ".join(f"{rows.t:.4g} s" for rows in named[:MAX_SHOWN])
            more = f" and {len(named) - MAX_SHOWN} more" if len(named) > MAX_SHOWN else ""
            most = 1e3 * max(abs(rows.shift) for rows in named)
            said.append(f"from {shown}{more} {what.format(steps=named[0].shift / step, most=most)}; {OWN_TIMES}")
    return said


@dataclass(frozen=True, kw_only=True, eq=False)
class _Film:
    """All channels at the times of all rows."""

    t: Array
    """Times of the rows, as far as they are known [s], shape (n,)."""
    t_by_file: Array
    """The same by the file [s]."""
    values: Array
    """Values in standard deviations of their noise, shape (channels, n); not a number where one is missing."""
    step: float
    """Time from row to row by the file [s]."""

    @classmethod
    def of(cls, channels: Sequence[Channel], noise: Sequence[float] = ()) -> _Film | None:
        """Return the film of some channels; None: there are too few rows.

        Parameters
        ----------
        noise
            Standard deviation of each channel's noise; by default as its points show it.
        """
        known = noise or [max(scatter(c), c.last_digit) for c in channels]
        moving = [(c, n) for c, n in zip(channels, known, strict=True) if c.name != "angle_rate" and len(c) >= MIN_ROWS]
        if not moving:
            return None
        t = np.unique(np.concatenate([c.t for c, _ in moving]))
        values = np.full((len(moving), len(t)), np.nan)
        for i, (c, sigma) in enumerate(moving):
            values[i, np.searchsorted(t, c.t)] = c.value / sigma
        t, values = t[:MAX_ROWS], values[:, :MAX_ROWS]
        return cls(t=t, t_by_file=t, values=values, step=float(np.median(np.diff(t))))

    def at_other_times(self, wrong: WrongTimes) -> _Film:
        """Return the film with some times corrected, without rows that then show a time again."""
        t = self.t + np.where(wrong.concerns(self.t_by_file), wrong.shift, 0.0)
        later = np.append(True, np.diff(t) > self.step / 2)
        return replace(self, t=t[later], t_by_file=self.t_by_file[later], values=self.values[:, later])

    def number_of(self, t: Array) -> NDArray[np.intp]:
        """Return the number of the frame at each time, from the first row."""
        return np.asarray(np.round((t - self.t[0]) / self.step), dtype=np.intp)

    @property
    def halves(self) -> list[int]:
        """Numbers of rows on each side by which displacements are looked for, the smallest first."""
        return sorted({min(max(rows, round(duration / self.step)), MAX_HALF) for rows, duration in HALF_WINDOWS})

    def displacements(self, half: int, *, onward: bool, degree: int = DEGREE) -> _Displacements:
        """Return by how much each row is displaced in time: a positive one was filmed later than its time says.

        Parameters
        ----------
        half
            Number of rows on each side of it.
        onward
            Whether all rows after it are displaced with it.
        degree
            Degree of the polynomials.
        """
        length = 2 * half + (not onward)
        if len(self.t) < length:
            empty = np.full(len(self.t), np.inf)
            return _Displacements(half=np.full(len(self.t), half), value=0 * self.t, error=empty, misfit=empty, across=empty)
        windows = _Windows(self, half, length, degree=degree)
        place = np.arange(windows.length)
        fit = windows.fit((place >= half if onward else place == half)[None, None])
        return _Displacements(
            half=np.full(len(self.t), half),
            value=self._by_row(half, fit.value[:, 0], 0.0),
            error=self._by_row(half, np.sqrt(fit.covariance[:, 0, 0]), np.inf),
            misfit=self._by_row(half, fit.misfit, np.inf),
            across=self._by_row(half, fit.across, np.inf),
        )

    def _by_row(self, half: int, values: Array, other: float) -> Array:
        """Return values of windows at the rows in their middle, and another one where no window is."""
        all_rows = np.full(len(self.t), other)
        all_rows[half : half + len(values)] = values
        return all_rows

    @lru_cache(maxsize=32)  # noqa: B019, as films are few
    def best_displacements(self, *, onward: bool) -> _Displacements:
        """Return displacements by the longest window of each row in which the motion is a polynomial."""
        best, *longer = (self.displacements(half, onward=onward) for half in self.halves)
        for other in longer:
            fits = other.misfit < MAX_MISFIT_RATIO * np.maximum(best.misfit, 1.0)
            best = _Displacements(*(np.where(fits, new, old) for new, old in zip(other, best, strict=True)))
        return best

    def stops(self) -> NDArray[np.intp]:
        """Return rows in which the masses are where they were before, though they move far, and on, before and after."""
        time = np.diff(self.t)
        ways = np.diff(self.values, axis=1)
        speed = np.linalg.norm(ways, axis=0) / time
        along = np.sum(ways[:, :-2] * ways[:, 2:], axis=0) / (time[:-2] * time[2:])
        slower = np.minimum(speed[:-2], speed[2:])
        # With few rows a second no polynomial describes the motion; not a number where a point is missing
        moves = (slower * time[1:-1] > MIN_WAY) & (along > MIN_COSINE * speed[:-2] * speed[2:])
        # Where rows are missing the speed is a mean of too long a time
        moves &= np.maximum(np.maximum(time[:-2], time[2:]), time[1:-1]) < 1.5 * self.step
        return np.flatnonzero(moves & (speed[1:-1] < MAX_STOP * slower)) + 2

    @lru_cache(maxsize=32)  # noqa: B019
    def patterns(self, half: int) -> list[_Pattern]:
        """Return how long pictures in turn last by the points, by the length of the pattern; empty: there are too few rows."""
        if len(self.t) < max(2 * half + MIN_ROWS, 4 * MAX_PERIOD):
            return []
        windows = _Windows(self, half, 2 * half + 1)
        found = []
        for period in range(2, MAX_PERIOD + 1):
            place = sliding_window_view(self.number_of(self.t) % period, windows.length)
            # The others are displaced from the last place
            fit = windows.fit(place == np.arange(period - 1)[:, None, None], pooled=True)
            to_next = (np.roll(np.eye(period), 1, axis=1) - np.eye(period))[:, : period - 1]
            found.append(
                _Pattern(
                    durations=1 + to_next @ fit.value[0],
                    error=np.sqrt(np.einsum("pi,ij,pj->p", to_next, fit.covariance[0], to_next)),
                    misfit=float(np.median(fit.misfit)),
                )
            )
        return found


@dataclass(frozen=True, kw_only=True, eq=False)
class _Pattern:
    """How long pictures in turn last."""

    durations: Array
    """Time from the picture at each place of the pattern to the next one [steps], shape (period,)."""
    error: Array
    """Standard errors of the durations [steps]."""
    misfit: float
    """Median over windows of the residuals' mean square, in variances of the noise."""

    @property
    def new(self) -> NDArray[np.bool_] | None:
        """Return which rows of a period show a new picture; None: none is clearly stored again, or some are neither."""
        # A row shows the picture before again if that one lasts no time
        last, error = np.roll(self.durations, 1), np.roll(self.error, 1)
        copy = last < COPY
        clear = np.where(copy, 1 - last, last - COPY) > MIN_PATTERN_SIGMAS * error
        return np.asarray(~copy) if copy.any() and np.all(clear) else None


class _Displacements(NamedTuple):
    """By how much each row is displaced in time, shape (n,) each."""

    half: NDArray[np.intp]
    """Rows on each side of it that were taken."""
    value: Array
    """Displacement [steps]; positive: filmed later than its time says."""
    error: Array
    """Standard error [steps]; infinite where there are too few rows."""
    misfit: Array
    """Mean square of the residuals, in variances of the noise."""
    across: Array
    """Displacement otherwise than along the velocities [standard errors]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Fit:
    """Displacements that windows share, or each window's own."""

    value: Array
    """Displacements [steps], shape (windows or 1, displacements)."""
    covariance: Array
    """Their covariance, shape (windows or 1, displacements, displacements)."""
    misfit: Array
    """Mean square of each window's residuals, in variances of the noise."""
    across: Array
    """What rows are displaced by otherwise than along the velocities [standard errors], of each window; 0 if pooled."""


class _Windows:
    """All runs of so many rows, in each of which the motion is a polynomial of the time."""

    def __init__(
        self, film: _Film, half: int, length: int, *, factor: float = 1.0, which: NDArray[np.intp] | slice = slice(None),
        degree: int = DEGREE,
    ) -> None:  # fmt: skip
        """Take the values of a film; the polynomials' variable is 0 at row `half` of each window.

        Parameters
        ----------
        factor
            How long a row lasts from that one on, in what it lasted before.
        which
            Only these windows.
        """
        self.half, self.length, self.degree = half, length, degree
        t = sliding_window_view(film.t, length)[which]
        x = (t - t[:, half, None]) / (half * film.step * max(factor, 1.0))
        x = np.where(x > 0, factor * x, x)
        values = sliding_window_view(film.values, length, axis=1)[:, which]
        self.known = np.isfinite(values)
        self.y = np.where(self.known, values, 0.0)
        self.basis, self.slopes = _polynomials(x, self.known, degree)
        self.rest = self._without_polynomials(self.y)

    def fit(self, moved: NDArray[np.bool_], *, pooled: bool = False) -> _Fit:
        """Return by how much rows are displaced in time.

        Parameters
        ----------
        moved
            Which rows of each window share a displacement, shape (displacements, windows or 1, rows).
        pooled
            Whether all windows have the same ones.
        """
        freedom = np.maximum(self.freedom - len(moved), 1)
        misfit = np.ones(self.y.shape[1])
        velocity, late = np.zeros_like(self.y), np.zeros(self.y.shape[1:])
        for _ in range(REFITS):
            coefficients = np.einsum("jcnk,cnk->jcn", self.basis, self.y - velocity * late)
            velocity = np.where(self.known, np.einsum("jcnk,jcn->cnk", self.slopes, coefficients) / self.half, 0.0)
            free = [self._without_polynomials(velocity * rows) for rows in moved]
            normal = np.array([[np.einsum("cnk,cnk->n", one, other) for other in free] for one in free])
            right = np.array([np.einsum("cnk,cnk->n", one, self.rest) for one in free])
            if pooled:
                weight = 1 / np.maximum(misfit, 1.0)
                normal, right = (np.sum(weight * each, axis=-1, keepdims=True) for each in (normal, right))
            normal = np.moveaxis(normal, -1, 0)
            size = np.trace(normal, axis1=1, axis2=2)[:, None, None]
            normal = normal + (1e-9 * size + 1e-12) * np.eye(len(moved))
            value = np.clip(np.linalg.solve(normal, right.T[..., None])[..., 0], -MAX_DISPLACEMENT, MAX_DISPLACEMENT)
            late = sum(each[:, None] * rows for each, rows in zip(value.T, moved, strict=True))
            left = self.rest - sum(each[:, None] * rows for each, rows in zip(value.T, free, strict=True))
            misfit = np.einsum("cnk,cnk->n", left, left) / freedom
        # Windows overlap, so that each row counts in as many as they are long
        scale = np.array([self.length * np.average(misfit, weights=weight)]) if pooled else np.maximum(misfit, 1.0)
        steps = [self._without_polynomials(self.known * rows) for rows in (() if pooled else moved)]
        across = [
            np.einsum("cnk,cnk->cn", step, left) ** 2 / np.maximum(np.einsum("cnk,cnk->cn", step, step), 1e-12)
            for step in steps
        ]
        return _Fit(
            value=value,
            covariance=scale[:, None, None] * np.linalg.inv(normal),
            misfit=misfit,
            across=np.sqrt(sum(np.sum(each, axis=0) for each in across) / np.maximum(misfit, 1.0)),
        )

    @property
    def freedom(self) -> Array:
        """Return the number of values of each window beyond the polynomials' coefficients."""
        return np.asarray(np.maximum(np.maximum(self.known.sum(axis=2) - self.degree - 1, 0).sum(axis=0), 1))

    @property
    def squares(self) -> Array:
        """Return the sum of squares of each window's residuals, in variances of the noise."""
        return np.asarray(np.einsum("cnk,cnk->n", self.rest, self.rest))

    @property
    def largest_by_one_row(self) -> Array:
        """Return by how much each window's sum of squares falls without the row that fits worst."""
        own = np.maximum(1 - np.sum(self.basis**2, axis=0), 0.05)
        return np.asarray(np.max(np.sum(self.rest**2 / own, axis=0), axis=1))

    def _without_polynomials(self, y: Array) -> Array:
        """Return what of y, shape (channels, windows, rows), no polynomial describes."""
        return np.asarray(y - np.einsum("jcnk,jcn->cnk", self.basis, np.einsum("jcnk,cnk->jcn", self.basis, y)))


def _polynomials(x: Array, known: NDArray[np.bool_], degree: int) -> tuple[Array, Array]:
    """Return polynomials of x that are orthonormal over the known rows of each window, and their derivatives.

    Both have shape (degree + 1, channels, windows, rows). A polynomial that the rows do not determine is zero.
    """
    basis, slopes = np.zeros((2, degree + 1, *known.shape))
    for j in range(degree + 1):
        polynomial, slope = x**j * known, np.broadcast_to(j * x ** max(j - 1, 0), known.shape)
        for i in range(j):
            shared = np.einsum("cnk,cnk->cn", basis[i], polynomial)[..., None]
            polynomial, slope = polynomial - shared * basis[i], slope - shared * slopes[i]
        size = np.linalg.norm(polynomial, axis=2, keepdims=True)
        scale = np.where(size > 1e-6, 1 / np.maximum(size, 1e-6), 0.0)
        basis[j], slopes[j] = scale * polynomial, scale * slope
    return basis, slopes


@lru_cache(maxsize=32)
def _rate_changes(film: _Film, *, is_clear: bool) -> list[WrongTimes]:
    """Return rows from which on they last longer or shorter, if the motion is a polynomial of other times only.

    Parameters
    ----------
    is_clear
        Whether only the clearest are returned.
    """
    best: dict[int, tuple[float, int, float]] = {}
    for half in RATE_HALF_WINDOWS:
        if len(film.t) < 2 * half + 1 or (is_clear and half < MIN_OWN_HALF):
            continue
        even = _Windows(film, half, 2 * half + 1)
        # The others' sums are too small to fall that far
        which = np.flatnonzero(even.squares > MIN_GAIN + MIN_NOISE_LEFT * even.freedom)
        squares, by_one_row = even.squares[which], even.largest_by_one_row[which]
        for factor in RATE_FACTORS if len(which) else ():
            changed = _Windows(film, half, 2 * half + 1, factor=factor, which=which)
            gain = squares - changed.squares
            is_change = (gain > MIN_GAIN) & (changed.squares < MAX_MISFIT * changed.freedom)
            if is_clear:
                is_change &= (gain > MIN_OWN_GAIN) & (gain > MIN_GAIN_RATIO * by_one_row)
                is_change &= squares > MIN_MISFIT_FALL * changed.squares
            for k in np.flatnonzero(is_change):
                row = int(which[k]) + half
                best[row] = max(best.get(row, (0.0, 0, 1.0)), (float(gain[k]), half, factor))
    chosen = _clearest((gain, row, half, factor) for row, (gain, half, factor) in best.items())
    return [WrongTimes(t=float(film.t[row]), factor=chosen[row]) for row in sorted(list(chosen)[:MAX_CHANGES])]


def _unrest(channels: Sequence[Channel], film: _Film) -> float:
    """Return the standard error of each time [steps]."""
    return max(c.time_error for c in channels) / film.step


def _displaced_rows(film: _Film, model: KnownMotion | None, unrest: float) -> list[WrongTimes]:
    """Return rows before which pictures are lost, and those that show the picture before.

    Parameters
    ----------
    unrest
        Standard error of each time [steps].
    """
    found = _single_displacements(film, unrest, MAX_MISFIT_AGREED if model else MAX_MISFIT)
    singles = [each for each in found if not each.onward]
    known = tuple(each for each in found if each.onward)
    if model is None or (known and model.agrees(known)):
        return sorted(found, key=lambda each: each.t)
    # One after the other, as each one spoils the model's fit, and the windows around it
    known = ()
    while len(known) < MAX_LOST:
        onward = next((each for each in found if each.onward), None)
        if onward is None:
            break
        gain = model.gain((*known, onward), known)
        # What the model does not see must be as clear as without it
        if gain < MIN_CHANGE and (gain < -MIN_CHANGE or onward not in _single_displacements(film, unrest, MAX_MISFIT)):
            break
        known = (*known, onward)
        film = film.at_other_times(onward)
        found = _single_displacements(film, unrest, MAX_MISFIT_AGREED)
        singles = [each for each in found if not each.onward]
    if known and model.agrees(known) is False:
        known = ()
    return sorted((*known, *singles), key=lambda each: each.t)


def _single_displacements(film: _Film, unrest: float, largest_misfit: float) -> list[WrongTimes]:
    """Return rows that are displaced by themselves, or with all that follow, the clearest first.

    Parameters
    ----------
    largest_misfit
        Largest mean square of the residuals, in variances of the noise, with which one of the latter is named.
    """
    found = []
    for onward in (True, False):
        rows = film.best_displacements(onward=onward)
        sigmas = np.abs(rows.value) / np.hypot(rows.error, unrest)
        usual = (rows.value > COPIED[0]) & (rows.value < COPIED[1]) | onward & (rows.value > MIN_LOST)
        usual &= rows.across < np.maximum(MAX_ACROSS, MAX_SLOPE * sigmas)
        named = usual & (sigmas > MIN_SIGMAS) & (rows.misfit < (largest_misfit if onward else MAX_MISFIT))
        if onward and largest_misfit == MAX_MISFIT and named.any():  # by the points alone
            finer = film.displacements(max(film.halves), onward=True, degree=FINER_DEGREE)
            least = np.maximum(MIN_LOST, MIN_SIGMAS * np.hypot(finer.error, unrest))
            named &= (np.sign(rows.value) * finer.value > least) & (finer.misfit < MAX_MISFIT)
        for k in np.flatnonzero(named):
            here = WrongTimes(t=float(film.t_by_file[k]), shift=round(float(rows.value[k])) * film.step, onward=onward)
            found.append((float(sigmas[k]), int(k), int(rows.half[k]), here))
    # A single row that is displaced displaces those around it a little, and the other way round
    chosen = _clearest(found)
    for row in map(int, film.stops() if unrest < MAX_STOP else ()):
        if all(abs(row - other) > 1 for other in chosen):
            chosen[row] = WrongTimes(t=float(film.t_by_file[row]), shift=-film.step, onward=False)
    return list(chosen.values())


def _clearest(found: Iterable[tuple[float, int, int, T]]) -> dict[int, T]:
    """Return row -> what was found there, the clearest first, without what has clearer ones within its window.

    Parameters
    ----------
    found
        How clear each is, its row, the number of rows on each side that were taken, and what was found.
    """
    chosen: dict[int, T] = {}
    for _, row, half, here in sorted(found, key=lambda each: each[:3], reverse=True):
        if all(abs(row - other) > half for other in chosen):
            chosen[row] = here
    return chosen


def _by_body(channels: Sequence[Channel]) -> list[list[Channel]]:
    """Return the channels in their order, by body; those of no body each alone."""
    bodies = {name: body for body, names in BODIES.items() for name in names}
    grouped: dict[str, list[Channel]] = {}
    for c in channels:
        grouped.setdefault(bodies.get(c.name, c.name), []).append(c)
    return list(grouped.values())


def _without_equal_points(body: list[Channel], notes: ReadingNotes) -> list[Channel]:
    """Return a body's channels without points that repeat the one before in every digit."""
    if any(not np.array_equal(c.t, body[0].t) for c in body) or len(body[0]) < MIN_ROWS:
        return body
    values = np.stack([c.value for c in body], axis=1)
    fresh = np.append(True, np.any(values[1:] != values[:-1], axis=1))
    if fresh.all() or fresh.sum() < MIN_FRESH:
        return body
    left = [replace(c, t=c.t[fresh], value=c.value[fresh]) for c in body]
    # Of rounded points, or of those on a raster such as a picture's pixels, many that are no neighbours are equal, too
    by_chance = max(len(c) - len(np.unique(c.value)) for c in left)
    if (~fresh).sum() < max(MIN_COPIES, by_chance) or not all(map(_has_fine_digits, left)):
        return body
    for c in body:
        notes.unused[f"{c.name}: a copy of the point before"] += int(np.sum(~fresh))
    return left


def _has_fine_digits(channel: Channel) -> bool:
    """Return whether a channel has noise, and digits so far below it that no two points are equal by chance."""
    noise = scatter(channel)
    return noise > max(MIN_NOISE * float(np.ptp(channel.value)), channel.last_digit / MAX_CHANCE_DIGIT)


@lru_cache(maxsize=16)
def _film(channels: tuple[Channel, ...]) -> _Film | None:
    """Return the film of some channels: what is found of it is asked for by the reader and by the first look."""
    return _Film.of(channels)


def _roughness(channels: Sequence[Channel], noise: Sequence[float]) -> float:
    """Return how far points are from polynomials of their times [variances of the noise]."""
    film, half = _Film.of(channels, noise), PATTERN_HALF_WINDOWS[1]
    return 0.0 if film is None else float(np.sum(_Windows(film, half, 2 * half + 1).squares))


def _pattern_of_copies(film: _Film) -> NDArray[np.bool_] | None:
    """Return which rows of a period show a new picture; None: there is no such pattern."""
    for half in PATTERN_HALF_WINDOWS:
        best = None
        for pattern in film.patterns(half):
            # Of pictures stored four times, every second one is stored twice, too
            if pattern.new is not None and (best is None or pattern.misfit < MIN_MISFIT_RATIO * best.misfit):
                best = pattern
        if best is not None:
            return best.new
    return None


def _uneven_pattern(film: _Film) -> Array | None:
    """Return the mean durations of frames in turn; None: they are even."""
    for half in PATTERN_HALF_WINDOWS:
        for pattern in film.patterns(half):
            least = max(MIN_UNEVEN, MIN_PATTERN_SIGMAS * np.sqrt(2) * float(pattern.error.max()))
            if np.ptp(pattern.durations) > least:
                return pattern.durations
    return None
