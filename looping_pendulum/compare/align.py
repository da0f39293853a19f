"""Evaluates the reference at an engine's own sample times.

An engine's run is never interpolated: the reference is exact at any time, so it is the one that is evaluated anew.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from looping_pendulum.engines.trajectory import UNKNOWN_MODE, Trajectory
from looping_pendulum.reference_ode.geometry import Array

Reference = Callable[[Array], Trajectory]
"""Function that returns the reference's motion at the given times [s], ascending; times after its end are left out or NaN."""

SAME_TIME = 1e-9
"""Largest difference of two times that count as equal [s]: sample times are multiples of a millisecond, but for rounding."""


@dataclass(frozen=True, kw_only=True)
class ReferenceSamples:
    """The reference sampled at given times; NaN (or `UNKNOWN_MODE`) after its end."""

    t: Array
    """[s], shape (n,)."""
    light_position: Array
    """[m], shape (n, 2)."""
    heavy_height: Array
    """[m], shape (n,)."""
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
    """Sample ``reference`` at any ``times`` [s], in any order, also beyond its end.

    Parameters
    ----------
    times
        Shape (n,). Negative times and times after the reference's end give NaN.
    """
    # A reference takes ascending times only, and the tubes around the samples give them in another order
    ascending, inverse = np.unique(times, return_inverse=True)
    samples = reference(ascending[np.isfinite(ascending) & (ascending >= 0)])
    # A reference may leave out times, so that its samples are found by their time and not by their place
    nearest = np.clip(np.searchsorted(samples.t, ascending), 0, max(len(samples.t) - 1, 0))
    known = np.abs(samples.t[nearest] - ascending) < SAME_TIME if len(samples.t) else np.zeros(len(ascending), dtype=bool)

    def in_given_order(values: Array) -> Array:
        out = np.full((len(ascending), *values.shape[1:]), np.nan)
        out[known] = values[nearest[known]]
        return np.asarray(out[inverse])

    # Apart from the others, because integers have no NaN
    mode = np.full(len(ascending), UNKNOWN_MODE, dtype=np.int8)
    mode[known] = samples.mode[nearest[known]]
    return ReferenceSamples(
        t=times,
        light_position=in_given_order(samples.light_position),
        heavy_height=in_given_order(samples.heavy_position[:, 1]),
        free_length=in_given_order(samples.free_length),
        wrap_angle=in_given_order(samples.wrap_angle),
        mode=mode[inverse],
    )


def align(run: Trajectory, reference: Reference) -> Aligned:
    """Return ``run`` with the reference sampled at the run's own times."""
    return Aligned(run=run, reference=sample_reference(reference, run.t))
