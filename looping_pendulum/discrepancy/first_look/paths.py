"""Which times the rows of a film may show: paths of times, the likeliest first.

Given the time of every row, points are what a fit of the declared model predicts + what it lacks, an integrated Wiener process
in each coordinate, + noise. So a Kalman filter of two numbers for each coordinate gives the density of a path's points; those
of all paths run at once. At each row the likeliest paths branch: it may show the picture before again, pictures may be lost
before it, and rows may last longer or shorter from it on. Of paths that come to one time at one rate, the likeliest goes on.

A tracker slips to another place, or stays where it was while the mass goes on. Such points tell nothing of the times.
"""

from __future__ import annotations

import copy
import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln, logsumexp

from looping_pendulum.discrepancy.first_look.evidence import growth
from looping_pendulum.discrepancy.first_look.prior import (
    AT_REST,
    BEGINNING,
    BLURS,
    CHANGES,
    COPIES,
    KNOWN_NOISE,
    LACKING,
    LEAST_NOISE,
    SLIPS,
    STAYS,
    STICKS,
    UNREST,
)
from looping_pendulum.discrepancy.fit.data import TrialData
from looping_pendulum.discrepancy.fit.problem import Problem
from looping_pendulum.measured.observations import BODIES
from looping_pendulum.reference_ode.geometry import Array

LOST = (1, 2, 3)
"""Numbers of successive pictures that may be lost."""
RATE_FACTORS = (2.0, 4.0, 8.0, 1 / 2, 1 / 4, 1 / 8)
"""Factors by which the duration of a row may change in a film: those of a phone's slow motion."""
LEAST_ROWS = 3
"""Smallest number of rows between two changes of their duration."""
BEGINS = 16
"""Number of parts of the rows between which something may begin to act."""
PATHS, PARENTS = 24, 3
"""Numbers of paths that are kept at a row, and of those that branch."""
SUBSTEPS = 8
"""Steps between two rows in which the model's motion is computed."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Rows:
    """The points of a trial, row by row."""

    t: Array
    """Times by the file [s], shape (n,)."""
    points: Array
    """[m], shape (n, channels); not a number where one is missing."""
    sigma: Array
    """Noise of each channel's points at rest [m], shape (channels,)."""
    rounding: Array
    """Scatter of the difference of two of its points by the file's rounding [m], shape (channels,)."""
    bodies: tuple[tuple[int, ...], ...]
    """Numbers of the channels of each body."""
    unit: Array
    """Length that a unit of each channel is worth [m]."""

    @staticmethod
    def of(data: TrialData, length_per_unit: Mapping[str, float]) -> Rows:
        """Return the rows of a trial."""
        t = np.unique(np.concatenate([c.t for c in data.channels]))
        points, names = np.full((len(t), len(data.channels)), np.nan), [c.name for c in data.channels]
        unit = np.array([length_per_unit[c.unit] for c in data.channels])
        for i, c in enumerate(data.channels):
            points[np.searchsorted(t, c.t), i] = c.value * unit[i]
        bodies = tuple(filter(None, (tuple(names.index(n) for n in of if n in names) for of in BODIES.values())))
        # Of a mass that moves, noise and wrong times look alike
        least = np.array([float(np.min(data.sigma[data.slices[n]])) for n in names]) * unit
        # With few rows a second, differences of neighbours show the light mass's motion, too
        sigma = np.full(len(names), max(float(least.min()), LEAST_NOISE * float(np.nanmax(points) - np.nanmin(points))))
        rounding = np.array([c.last_digit for c in data.channels]) * unit / math.sqrt(6)
        return Rows(t=t, points=points, sigma=sigma, rounding=rounding, bodies=bodies, unit=unit)

    @cached_property
    def of_body(self) -> Array:
        """Return 1 where a channel is one of a body, shape (channels, bodies)."""
        return np.array([[float(i in body) for body in self.bodies] for i in range(self.points.shape[1])])

    @cached_property
    def body(self) -> NDArray[np.intp]:
        """Return the number of each channel's body; 0 for those of none, shape (channels,)."""
        return np.asarray(np.argmax(self.of_body, axis=1))

    @property
    def step(self) -> float:
        """Return the time from row to row by the file [s]."""
        return float(np.median(np.diff(self.t)))

    @property
    def log_slip(self) -> float:
        """Return the logarithm of the density of a coordinate to which a tracker slips [1/m]."""
        return -math.log(float(np.nanmax(self.points) - np.nanmin(self.points)))


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    """What a fit of the declared model predicts, at closely spaced times."""

    start: float
    step: float
    place: Array
    """[m], shape (times, channels)."""
    velocity: Array
    end: float
    """Time at which the model ends and is at rest from then on; infinite: it does not [s]."""

    @staticmethod
    def of(problem: Problem, x: Array, rows: Rows, end: float) -> Motion:
        """Return the motion from the first row's time to ``end`` [s]."""
        data, step = problem.data[0], rows.step / SUBSTEPS
        # At least to the next row, as a record may begin after the motion that is looked at
        t = np.arange(rows.t[0], max(end, rows.t[0] + rows.step) + step, step)
        dense = tuple(dataclasses.replace(c, t=t, value=np.zeros_like(t)) for c in data.channels)
        there = problem.with_data([TrialData(trial=data.trial, channels=dense, sigma=np.ones(len(t) * len(dense)))])
        place = (there.predict(x, 0).reshape(len(dense), -1) * rows.unit[:, None]).T
        velocity = np.asarray(np.gradient(place, step, axis=0))
        moving = np.flatnonzero(velocity.any(axis=1))
        ends = len(moving) and moving[-1] + 1 < len(t)
        return Motion(
            start=float(t[0]), step=step, place=place, velocity=velocity, end=float(t[moving[-1]]) if ends else math.inf
        )

    def at(self, t: Array) -> tuple[Array, Array]:
        """Return places and velocities at times of each channel, shape (paths, channels)."""
        k = np.clip(np.rint((t - self.start) / self.step), 0, len(self.place) - 1).astype(int)
        off = np.clip(t - self.start - k * self.step, -self.step, self.step)
        channel = np.arange(self.place.shape[1])
        velocity = self.velocity[k, channel]
        return self.place[k, channel] + off * velocity, velocity


@dataclass(frozen=True)
class Change:
    """A change of the times from a row on."""

    row: int
    lost: int = 0
    """Number of pictures lost before it; -1: it shows the one before again."""
    factor: float = 1.0
    """How long a row lasts from here on, in what it lasted before."""
    alone: bool = False
    """Whether all later rows show their own pictures again."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Path:
    """Times of the rows, and how likely they are."""

    log: float
    """Logarithm of the probability of its changes and of the density of the points."""
    time: Array
    """Time of each row [s], shape (rows,)."""
    changes: tuple[Change, ...] = ()


@dataclass(frozen=True, kw_only=True, eq=False)
class Filtered:
    """Points as they are by several paths."""

    log: Array
    """Logarithms of their density by each path, shape (paths,)."""
    unexplained: NDArray[np.bool_]
    """Points of each body to which the tracker slips, or which something moves, by the likeliest one, shape (rows, bodies)."""
    stays: NDArray[np.bool_]
    """Points of each body that are those of the row before, though the mass moves on, by the likeliest one, same shape."""
    begin: int
    """Row from which on something acts that the model lacks; the number of rows: in none."""


class Filters:
    """Kalman filters of several paths: of how far each coordinate is off the model's way, and of how fast it departs."""

    def __init__(
        self, rows: Rows, motion: Motion, q: Array, unrest: Array | float = UNREST, blur: Array | float = BLURS[1]
    ) -> None:
        paths, channels = len(q), rows.points.shape[1]
        self.rows, self.motion = rows, motion
        self.log = np.zeros(paths)
        """Logarithm of each path's probability."""
        self.q, self.unrest, self.blur = np.array(q), np.full(paths, rows.step * np.asarray(unrest)), np.full(paths, blur)
        self.off, self.speed, self.off_speed = (np.zeros((paths, channels)) for _ in range(3))
        """Means, and the covariance of the two."""
        self.off_variance, self.speed_variance = np.tile(rows.sigma**2, (paths, 1)), np.full((paths, channels), AT_REST**2)
        self.squares, self.counts = (np.full((paths, len(rows.bodies)), KNOWN_NOISE) for _ in range(2))
        """Squares of what is left of each body's points, in the noise as it is known beforehand, and their number."""
        self.slipped = np.zeros((paths, len(rows.bodies)), dtype=bool)
        """Whether the last points of each body were no places of it."""
        self.stays = self.slipped.copy()
        """Whether they were those of the row before."""

    @property
    def _arrays(self) -> dict[str, Array]:
        return {name: value for name, value in vars(self).items() if name not in ("rows", "motion")}

    def take(self, index: NDArray[np.intp]) -> Filters:
        """Return the filters of some paths."""
        taken = copy.copy(self)
        vars(taken).update({name: value[index] for name, value in self._arrays.items()})
        return taken

    def step(self, row: int, t: Array, elapsed: Array) -> None:
        """Predict a row at times of shape (paths, channels), so long after the one before, and take in its points."""
        q, dt = self.q[:, None], elapsed[:, None] + 1e-9
        self.off = self.off + dt * self.speed
        self.off_variance = self.off_variance + dt * (2 * self.off_speed + dt * self.speed_variance) + q * dt**3 / 3
        self.off_speed = self.off_speed + dt * self.speed_variance + q * dt**2 / 2
        self.speed_variance = self.speed_variance + q * dt
        place, velocity = self.motion.at(t)
        rest = self.rows.points[row] - place - self.off
        self._take_in(row, rest, velocity)

    def _take_in(self, row: int, rest: Array, velocity: Array) -> None:
        """Take in the points of a row, which are off what is predicted by ``rest``, shape (paths, channels)."""
        known, of_body, body = np.isfinite(rest[0]), self.rows.of_body, self.rows.body
        members = of_body * known[:, None]
        many = members.sum(axis=0)
        rest, velocity, unrest = np.where(known, rest, 0.0), velocity * known, self.unrest[:, None] ** 2
        scale = np.sqrt(self.squares / self.counts)
        noise = self.rows.sigma * scale[:, body] + (self.blur[:, None] * np.sqrt(velocity**2 @ members))[:, body]
        variance = self.off_variance + noise**2
        # An error of the time is one and the same for all coordinates
        by_time = unrest * (velocity**2 / variance @ members)
        square = rest**2 / variance @ members - unrest / (1 + by_time) * (velocity * rest / variance @ members) ** 2
        # Student's distribution, as the noise is not known exactly
        log = gammaln((self.counts + many) / 2) - gammaln(self.counts / 2)
        log -= 0.5 * ((self.counts + many) * np.log1p(square / self.counts) + many * np.log(self.counts * math.pi))
        log -= 0.5 * (np.log(variance) @ members + np.log1p(by_time)) - math.log1p(-SLIPS)
        stays = self._log_of_stay(row, members, noise)
        slip = np.maximum(stays, math.log(SLIPS) + many * self.rows.log_slip)
        used = log > slip
        self.log = self.log + np.where(used, log, slip) @ (many > 0)
        self.slipped = np.where(many > 0, ~used, self.slipped)
        self.stays = ~used & (stays == slip) & (many > 0)
        taken = used[:, body] * members.any(axis=1)
        variance = variance + unrest * velocity**2
        gain, of_speed = self.off_variance / variance * taken, self.off_speed / variance * taken
        self.off = self.off + gain * rest
        self.speed = self.speed + of_speed * rest
        self.speed_variance = self.speed_variance - of_speed * self.off_speed
        self.off_speed = self.off_speed - gain * self.off_speed
        self.off_variance = self.off_variance - gain * self.off_variance
        left = ((rest * (1 - gain)) ** 2 + self.off_variance) * (scale[:, body] / noise) ** 2
        self.squares = self.squares + used * (left @ members)
        self.counts = self.counts + used * many

    def _log_of_stay(self, row: int, members: Array, noise: Array) -> Array:
        """Return the logarithm of the density of points if the tracker stays where it was, shape (paths, bodies)."""
        apart = self.rows.points[row] - self.rows.points[row - 1]
        near = (0.5 * (np.nan_to_num(apart) / noise) ** 2 + np.log(noise * math.sqrt(2 * math.pi))) @ members
        can_stay = (members.T @ ~np.isfinite(apart) == 0) & (row > 0)
        return np.asarray(np.where(can_stay, np.where(self.slipped, math.log(STAYS), math.log(STICKS)) - near, -math.inf))

    def step_again(self, row: int, t: Array, elapsed: Array, copied: NDArray[np.bool_]) -> None:
        """Do the same where some paths show the picture before again: marked as it was, which tells nothing new, or anew."""
        if not copied.any():
            return self.step(row, t, elapsed)
        before = self.take(np.arange(len(copied)))
        self.step(row, t, elapsed)
        before.log = before.log + before._log_of_copy(row)
        as_before = copied & (before.log > self.log)
        vars(self).update(
            {
                name: np.where(as_before if value.ndim == 1 else as_before[:, None], before._arrays[name], value)
                for name, value in self._arrays.items()
            }
        )
        self.log = self.log + np.where(copied, math.log(0.5), 0.0)

    def _log_of_copy(self, row: int) -> Array:
        """Return the logarithm of the density of a row's points as the marks of the row before, which are set again."""
        apart, log = self.rows.points[row] - self.rows.points[row - 1], np.zeros(len(self.log))
        scale = np.sqrt(self.squares / self.counts)
        for b, body in enumerate(self.rows.bodies):
            known = [i for i in body if math.isfinite(apart[i])]
            if known:
                noise = np.multiply.outer(scale[:, b], np.multiply.outer(COPIES, self.rows.sigma[known]))
                noise = np.maximum(noise, self.rows.rounding[known])  # by which other points are equal, too
                each = -0.5 * (apart[known] / noise) ** 2 - np.log(noise * math.sqrt(2 * math.pi))
                log += logsumexp(np.sum(each, axis=2), axis=1) - math.log(len(COPIES))
        return log


def filtered(
    rows: Rows,
    motion: Motion,
    t: Array,
    unrest: Array,
    copied: NDArray[np.bool_] | None = None,
    lacking: float | None = None,
) -> Filtered:
    """Filter the points with given times of the rows.

    Parameters
    ----------
    t
        Shape (paths, rows, channels) [s].
    unrest
        Errors of the times [steps], shape (paths,).
    copied
        Rows that show the picture before again, shape (paths, rows).
    lacking
        Size of what the model lacks [m]; by default all sizes, those of something that begins to act later, too.
    """
    # Of every path with all sizes and blurs, and with all that may begin later
    if lacking is None:
        at = np.linspace(0, t.shape[1], BEGINS + 1).astype(int)[1:-1]
        kinds = [(size, blur, 0) for size in LACKING for blur in BLURS]
        kinds += [(size, BLURS[-1], int(row)) for size in BEGINNING for row in at]
    else:
        kinds = [(lacking, BLURS[-1], 0)]
    sizes, blurs, begins = (np.tile(values, len(t)) for values in zip(*kinds, strict=True))
    each, q = np.repeat(np.arange(len(t)), len(kinds)), growth(sizes)
    slipped, stays = [], []
    filters = Filters(rows, motion, q, unrest[each], blurs)
    for row in range(t.shape[1]):
        filters.q = np.where(row < begins, growth(LACKING[0]), q)
        now = t[each, row]
        elapsed = np.abs(np.median(now - t[each, row - 1], axis=1)) if row else np.zeros(len(each))
        filters.step_again(row, now, elapsed, np.zeros(len(each), dtype=bool) if copied is None else copied[each, row])
        slipped.append(filters.slipped)
        stays.append(filters.stays)
    likeliest = int(np.argmax(filters.log))
    left_out = np.array(slipped)[:, likeliest]
    if begins[likeliest]:
        left_out[begins[likeliest] :] = True
    log = logsumexp(filters.log.reshape(len(t), len(kinds)), axis=1) - math.log(len(kinds))
    begin = int(begins[likeliest]) or t.shape[1]
    return Filtered(log=np.asarray(log), unexplained=left_out, stays=np.array(stays)[:, likeliest], begin=begin)


def log_of_change(count: int) -> float:
    """Return the logarithm of the prior probability of one change at one of so many rows."""
    return math.log(CHANGES / count / (1 + len(LOST) + len(RATE_FACTORS)))


@dataclass(frozen=True, kw_only=True)
class _Option:
    """A way in which some paths may go on."""

    paths: NDArray[np.intp]
    elapsed: Array
    """Time to the next row [s]."""
    log: float
    """Logarithm of its probability."""
    change: Change | None = None


def likeliest_paths(rows: Rows, motion: Motion, count: int) -> list[Path]:
    """Return the likeliest paths of times over so many rows, the likeliest first."""
    each, stay = log_of_change(count), math.log1p(-min(CHANGES / count, 0.5))
    rate = np.repeat([1.0, *RATE_FACTORS], len(LACKING))
    filters = Filters(rows, motion, np.tile([growth(size) for size in LACKING], 1 + len(RATE_FACTORS)))
    filters.log = np.where(rate == 1, 0.0, each)
    changes: list[tuple[Change, ...]] = [() if r == 1 else (Change(row=0, factor=r),) for r in rate.tolist()]
    time, owed = np.full(len(rate), rows.t[0]), np.zeros(len(rate), dtype=bool)
    since = np.where(rate == 1, -LEAST_ROWS, 0)
    channels = rows.points.shape[1]
    filters.step(0, np.tile(time[:, None], channels), np.zeros(len(rate)))
    for row in range(1, count):
        dt, best = float(rows.t[row] - rows.t[row - 1]), np.argsort(-filters.log)[:PARENTS]
        options = [_Option(paths=np.arange(len(time)), elapsed=rate * dt, log=stay)]
        if owed.any():
            late = np.flatnonzero(owed)
            change = Change(row=row - 1, lost=-1, alone=True)
            options.append(_Option(paths=late, elapsed=rate[late] * (dt + rows.step), log=stay, change=change))
        options.append(_Option(paths=best, elapsed=0 * rate[best], log=each, change=Change(row=row, lost=-1)))
        for n in LOST:
            elapsed = rate[best] * (dt + n * rows.step)
            options.append(_Option(paths=best, elapsed=elapsed, log=each, change=Change(row=row, lost=n)))
        steady = best[row - since[best] >= LEAST_ROWS]
        for factor in RATE_FACTORS:
            of = steady[np.abs(np.log(rate[steady] * factor)) < math.log(max(RATE_FACTORS)) + 0.1]
            change = Change(row=row, factor=factor)
            options.append(_Option(paths=of, elapsed=rate[of] * factor * dt, log=each, change=change))
        index, made = np.concatenate([o.paths for o in options]), [o.change for o in options for _ in o.paths]
        filters = filters.take(index)
        filters.log = filters.log + np.concatenate([np.full(len(o.paths), o.log) for o in options])
        # A picture that was shown again may be made up for, or not
        filters.log = filters.log + np.where(owed[index], math.log(0.5), 0.0)
        elapsed = np.concatenate([o.elapsed for o in options])
        time, rate = time[index] + elapsed, rate[index] * np.array([c.factor if c else 1.0 for c in made])
        since = np.where([c is not None and c.factor != 1 for c in made], row, since[index])
        owed = np.array([c is not None and c.lost < 0 and not c.alone for c in made])
        changes = [_with_change(changes[i], c) for i, c in zip(index.tolist(), made, strict=True)]
        filters.step_again(row, np.tile(time[:, None], channels), elapsed, owed)
        kept = _likeliest_apart(filters, np.rint(16 * time / rows.step), np.rint(64 * rate), owed)
        filters, changes = filters.take(kept), [changes[i] for i in kept.tolist()]
        time, rate, since, owed = time[kept], rate[kept], since[kept], owed[kept]
    found: dict[tuple[Change, ...], Path] = {}
    for i in np.argsort(-filters.log).tolist():
        if changes[i] not in found:
            found[changes[i]] = Path(log=float(filters.log[i]), time=times_with(rows, count, changes[i]), changes=changes[i])
    return list(found.values())


def _with_change(changes: tuple[Change, ...], new: Change | None) -> tuple[Change, ...]:
    """Return the changes with a new one, which takes the place of the last one if it says that this was alone."""
    if new is None:
        return changes
    return (*changes[:-1], new) if new.alone else (*changes, new)


def _likeliest_apart(filters: Filters, *state: Array) -> NDArray[np.intp]:
    """Return the likeliest paths, one of those that are in one state with one size of what the model lacks."""
    order = np.argsort(-filters.log)
    _, first = np.unique(np.column_stack([filters.q, *state])[order], axis=0, return_index=True)
    return order[np.sort(first)[:PATHS]]


def times_with(rows: Rows, count: int, changes: Sequence[Change]) -> Array:
    """Return the times of so many rows with some changes [s]."""
    at: dict[int, list[Change]] = {}
    for change in changes:
        at.setdefault(change.row, []).append(change)
    rate = math.prod(c.factor for c in at.get(0, ()))
    time, owed = rows.t[:count].copy(), 0.0
    for row in range(1, count):
        elapsed, owed = float(rows.t[row] - rows.t[row - 1]) + owed, 0.0
        for change in at.get(row, ()):
            rate *= change.factor
            if change.lost > 0:
                elapsed += change.lost * rows.step
            elif change.lost < 0:
                elapsed, owed = 0.0, rows.step if change.alone else 0.0
        time[row] = time[row - 1] + rate * elapsed
    return time
