"""The reference at an engine's own sample times. The engine is never resampled: the reference is exact at any time, so it moves."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from looping_pendulum.engines.trajectory import UNKNOWN_MODE, Trajectory
from looping_pendulum.reference_ode.geometry import Array

Reference = Callable[[Array], Trajectory]
"""The reference's motion at exactly the given times [s], in rising order; times after its end are left out or NaN."""

SAME_TIME = 1e-9
"""Two times closer than this [s] are one: sample times are multiples of a millisecond, rounded by floating point."""


@dataclass(frozen=True, kw_only=True)
class ReferenceSamples:
    """The reference at given times; NaN (or `UNKNOWN_MODE`) where it has ended."""

    t: Array
    """[s], shape (n,)."""
    light_position: Array
    """[m], shape (n, 2)."""
    heavy_height: Array
    """[m], shape (n,)."""
    heavy_speed: Array
    """Upward [m/s], shape (n,)."""
    free_length: Array
    """[m], shape (n,)."""
    wrap_angle: Array
    """[rad], shape (n,)."""
    mode: NDArray[np.int8]
    """Shape (n,)."""


@dataclass(frozen=True, kw_only=True)
class Aligned:
    """One engine's run beside the reference, at the engine's own sample times."""

    run: Trajectory
    reference: ReferenceSamples

    @property
    def t(self) -> Array:
        """Sample times [s], shape (n,)."""
        return self.run.t

    @property
    def deviation(self) -> Array:
        """Light mass, engine minus reference [m], shape (n, 2)."""
        return np.asarray(self.run.light_position - self.reference.light_position)

    @property
    def distance(self) -> Array:
        """Length of `deviation` [m], shape (n,)."""
        return np.asarray(np.hypot(*self.deviation.T))

    @property
    def heavy_deviation(self) -> Array:
        """Height of the heavy mass, engine minus reference [m], shape (n,)."""
        return np.asarray(self.run.heavy_position[:, 1] - self.reference.heavy_height)


def sample_reference(reference: Reference, times: Array) -> ReferenceSamples:
    """Ask ``reference`` for any ``times`` [s], in any order, also beyond its end.

    Parameters
    ----------
    times
        Shape (n,). Negative times and times after the reference's end give NaN.
    """
    rising, back = np.unique(times, return_inverse=True)
    asked = rising[np.isfinite(rising) & (rising >= 0)]
    got = reference(asked)
    place = np.clip(np.searchsorted(got.t, rising), 0, max(len(got.t) - 1, 0))
    known = np.abs(got.t[place] - rising) < SAME_TIME if len(got.t) else np.zeros(len(rising), dtype=bool)

    def spread(values: Array) -> Array:
        out = np.full((len(rising), *values.shape[1:]), np.nan)
        out[known] = values[place[known]]
        return np.asarray(out[back])

    mode = np.full(len(rising), UNKNOWN_MODE, dtype=np.int8)
    mode[known] = got.mode[place[known]]
    return ReferenceSamples(
        t=times,
        light_position=spread(got.light_position),
        heavy_height=spread(got.heavy_position[:, 1]),
        heavy_speed=spread(got.heavy_velocity[:, 1]),
        free_length=spread(got.free_length),
        wrap_angle=spread(got.wrap_angle),
        mode=mode[back],
    )


def align(run: Trajectory, reference: Reference) -> Aligned:
    """Put the reference beside ``run`` at the run's own sample times."""
    return Aligned(run=run, reference=sample_reference(reference, run.t))
