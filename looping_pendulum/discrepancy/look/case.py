"""One trial as a hypothesis has it: what is declared, and the table of its points as arrays."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import reduce
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from looping_pendulum.discrepancy.look.prior import BLUR, COPIES, HAND_ACCELERATIONS, MOVED_BY_HAND, SLIPS, STAYS, USUAL_DRAG
from looping_pendulum.errors import HarnessError
from looping_pendulum.measured.noise import estimate_noise, speed_at
from looping_pendulum.measured.observations import BODIES, Channel, Observations
from looping_pendulum.measured.study import PLACEHOLDERS, Estimate, Study, Trial
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import Release

CANNOT_RUN = (HarnessError, ValueError, ArithmeticError, np.linalg.LinAlgError)
"""What is raised where values are impossible together, or the model cannot run with them."""
END, MIN_ROWS, ALL_ROWS, MAX_ROWS = 3.0, 12, 100, 1500
"""End of what is looked at, in times in which a mass falls through the free length; fewest rows; rows that are always taken,
and most."""
LEAST_NOISE = 1e-4
"""Smallest noise in the range of the points: the motion is not computed more exactly, and no film shows more."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Case:
    """One trial as it is declared, or as it would be without some mistake."""

    study: Study
    """With this trial alone."""
    observations: Observations
    log_volume: float = 0.0
    """Logarithm of the factor on each value, so that densities are those of the points as they were read."""
    factors: Mapping[str, float] = field(default_factory=dict)
    """What "lengths" and "times" were multiplied by."""
    exchanged: tuple[float, ...] = ()
    """Times of the rows in which the two masses' points were exchanged [s]."""
    has_other_tracks: bool = False
    open: frozenset[str] = frozenset()
    """Values that are known but for a factor of some: `clock_ratio` or `scale`."""

    @staticmethod
    def of(study: Study, trial: Trial, observations: Observations) -> Case:
        """Return a trial as it is declared; the air's drag, which always acts, is open if it is not declared."""
        mass = trial.dropped if trial.release is Release.DROP else "light"
        effects = {f"{mass}_drag": Estimate(value=0.0, sigma=USUAL_DRAG)} | dict(study.effects)
        alone = (dataclasses.replace(trial, held_out=False),)
        return Case(study=dataclasses.replace(study, effects=effects, trials=alone), observations=observations)

    @property
    def trial(self) -> Trial:
        """Return the trial."""
        return self.study.trials[0]

    @property
    def free_length(self) -> float:
        """Return the declared free length, or how far a mass without string falls [m]."""
        if self.trial.release is Release.DROP:
            return max((float(np.ptp(c.value)) for c in self.observations.channels if len(c)), default=1.0)
        known = self.estimate("free_length")
        return PLACEHOLDERS["free_length"] if known is None else known.value

    @property
    def fall_time(self) -> float:
        """Return the time in which a mass falls through the free length [s]."""
        return math.sqrt(2 * self.free_length / 9.81)

    def estimate(self, name: str) -> Estimate | None:
        """Return what is declared of a parameter."""
        return self.study.estimate(name, self.trial)

    def with_trial(self, trial: Trial, **changes: Any) -> Case:
        """Return the case with another trial."""
        return dataclasses.replace(self, study=dataclasses.replace(self.study, trials=(trial,)), **changes)

    def with_channels(self, change: Callable[[Channel], Channel], **changes: Any) -> Case:
        """Return the case with other channels."""
        observations = dataclasses.replace(self.observations, channels=tuple(map(change, self.observations.channels)))
        return dataclasses.replace(self, observations=observations, **changes)


@dataclass(frozen=True, kw_only=True, eq=False)
class Rows:
    """The table as arrays: a row for each time, a column for each channel; not a number: not tracked."""

    channels: tuple[Channel, ...]
    t: Array
    """Times by the file [s], shape (rows,)."""
    value: Array
    """Points [SI], shape (rows, channels)."""
    at_rest: Array
    """Errors of points of a mass at rest [SI], shape (rows, channels)."""
    speed: Array
    """Speed of the mass of each point [SI/s], same shape."""
    unit: Array
    """Length that a unit of each channel is worth [m], shape (channels,)."""
    bodies: tuple[tuple[int, ...], ...]
    """Columns of each body."""

    @staticmethod
    def of(case: Case, count: int = 0, most: int = MAX_ROWS) -> Rows:
        """Return the rows of a case that are looked at, or its first ``count``; every few of them, if they are too many.

        Raises
        ------
        DataError
            If there are too few points to estimate their noise.
        """
        channels = tuple(
            c for c in case.observations.channels if c.name != "angle_rate" or len(case.observations.channels) == 1
        )
        t = reduce(np.union1d, [c.t for c in channels])
        count = count or max(int(np.searchsorted(t, END * case.fall_time, side="right")), ALL_ROWS)
        t = t[:count]
        value, at_rest, speed = np.full((3, len(t), len(channels)), np.nan)
        for body in dataclasses.replace(case.observations, channels=channels).bodies().values():
            noise = estimate_noise(body).a
            for c in body:
                i, kept = channels.index(c), c.t <= t[-1]
                row = np.searchsorted(t, c.t[kept])
                value[row, i] = c.value[kept]
                speed[row, i] = speed_at(body, c.t, noise)[kept]
                least = max(noise, LEAST_NOISE * float(np.ptp(c.value)), 1e-9)
                at_rest[row, i] = np.maximum(least, c.least_sigma(speed_at(body, c.t))[kept])
        length, names = case.free_length, [c.name for c in channels]
        worth = {"m": 1.0, "rad": length, "rad/s": length * math.sqrt(length / 9.81)}
        every = slice(None, None, -(-len(t) // most))
        return Rows(
            channels=channels,
            t=t[every],
            value=value[every],
            at_rest=at_rest[every],
            speed=speed[every],
            unit=np.array([worth[c.unit] for c in channels]),
            bodies=tuple(b for of in BODIES.values() if (b := tuple(i for i, n in enumerate(names) if n in of))),
        )

    @property
    def step(self) -> float:
        """Return the time from row to row [s]."""
        return float(np.median(np.diff(self.t)))

    @property
    def sigma(self) -> Array:
        """Return the errors of the points before any fit [SI], shape (rows, channels)."""
        return np.hypot(self.at_rest, BLUR * self.speed)

    @property
    def is_point(self) -> NDArray[np.bool_]:
        """Return which points were tracked, shape (rows, channels)."""
        return np.isfinite(self.value)

    @property
    def body_of_channel(self) -> Array:
        """Return the matrix that sums channels to bodies, shape (channels, bodies)."""
        return np.array([[i in body for body in self.bodies] for i in range(len(self.channels))], dtype=float)

    @property
    def log_anywhere(self) -> float:
        """Return the logarithm of the density of a coordinate that may be anywhere in the picture [1/m]."""
        return -math.log(float(np.nanmax(self.value * self.unit) - np.nanmin(self.value * self.unit)) + 1e-9)

    def part(self, kept: NDArray[Any] | slice) -> Rows:
        """Return some of the rows."""
        return dataclasses.replace(
            self, t=self.t[kept], value=self.value[kept], at_rest=self.at_rest[kept], speed=self.speed[kept]
        )

    def log_normal(self, away: Array, sigma: Array) -> Array:
        """Return the logarithm of the density of points [1/m] that are away by this much [SI], shape (rows, channels)."""
        return -0.5 * (away / sigma) ** 2 - np.log(sigma * self.unit * math.sqrt(2 * math.pi))

    def log_stays(self) -> Array:
        """Return the logarithm of the density of each body's points if its mark stays where it was, shape (rows, bodies)."""
        each = self.log_normal(np.diff(self.value, axis=0, prepend=np.nan), self.at_rest)
        known = self.is_point @ self.body_of_channel == np.isfinite(each) @ self.body_of_channel
        return np.where(known, np.nan_to_num(each) @ self.body_of_channel, -np.inf)

    def log_slips(self) -> Array:
        """Return the logarithm of the density of each body's points anywhere, with its share, shape (rows, bodies)."""
        return math.log(SLIPS) + (self.is_point * self.log_anywhere) @ self.body_of_channel

    def log_otherwise(self) -> Array:
        """Return the logarithm of the density of each body's points if they do not show it, shape (rows, bodies)."""
        return np.logaddexp(math.log(STAYS) + self.log_stays(), self.log_slips())

    def log_copied(self) -> Array:
        """Return the logarithm of the density of each row's points as the marks of the row before, set again, shape (rows,).

        A body that rests has equal marks in new pictures, too: if they stay in further rows, they are as in a new one.
        """
        apart = np.diff(self.value, axis=0, prepend=np.nan)
        digit = np.array([max(c.last_digit, 1e-9) for c in self.channels])
        stays = (self.is_point & ~(np.abs(apart) <= digit)) @ self.body_of_channel == 0
        stays &= self.is_point @ self.body_of_channel > 0
        beyond = np.pad(stays, ((1, 1), (0, 0)))
        rests = stays & (beyond[:-2] | beyond[2:])
        moves = np.nan_to_num([self.log_normal(apart, np.maximum(share * self.sigma, digit)) for share in COPIES])
        of_body = np.where(rests, self.log_otherwise(), moves @ self.body_of_channel)
        logs = of_body.sum(axis=-1)
        return np.where(np.isfinite(apart).any(axis=1), logsumexp(logs, axis=0) - math.log(len(COPIES)), -np.inf)

    def log_held(self) -> Array:
        """Return the logarithm of the density of each row's points if something holds the masses, shape (rows,).

        They stay where they were, but for some rows in which a hand moves them.
        """
        moved, onwards = [], np.diff(self.value, 2, axis=0, prepend=np.full((2, len(self.channels)), np.nan))
        for acceleration in HAND_ACCELERATIONS:
            sigma = np.hypot(math.sqrt(6) * self.at_rest, acceleration * self.step**2 / self.unit)
            each = np.nan_to_num(self.log_normal(onwards, sigma), nan=self.log_anywhere) * self.is_point
            moved.append(each @ self.body_of_channel + math.log(MOVED_BY_HAND / len(HAND_ACCELERATIONS)))
        return np.asarray(logsumexp([self.log_stays(), *moved, self.log_slips()], axis=0).sum(axis=1))
