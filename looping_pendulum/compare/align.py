"""Evaluates the reference at an engine's own sample times.

An engine's run is never interpolated: the reference is exact at any time, so it is the one that is evaluated anew.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.runs.trajectory import UNKNOWN_MODE, Trajectory

Reference = Callable[[Array], Trajectory]
"""Function that returns the reference's motion at the given times [s], ascending; times after its end are left out or NaN."""

SAME_TIME = 1e-9
"""Largest difference of two times that count as equal [s]: sample times are multiples of a millisecond, but for rounding."""


@dataclass(frozen=True, kw_only=True)
class Aligned:
    """One engine's run beside the reference, at the engine's own sample times."""

    run: Trajectory
    reference: Trajectory
    """The reference at the same times; NaN (or `UNKNOWN_MODE`) after its end."""

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
        return np.asarray(self.run.heavy_position[:, 1] - self.reference.heavy_position[:, 1])


def sample_reference(reference: Reference, times: Array) -> Trajectory:
    """Sample ``reference`` at any ``times`` [s], in any order; its samples beyond its end are NaN, the modes `UNKNOWN_MODE`.

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
    sampled: dict[str, Any] = {}
    for field in dataclasses.fields(samples):
        values = getattr(samples, field.name)
        if isinstance(values, np.ndarray):
            # Integers have no NaN
            missing = UNKNOWN_MODE if field.name == "mode" else np.nan
            out = np.full((len(ascending), *values.shape[1:]), missing, dtype=values.dtype)
            out[known] = values[nearest[known]]
            sampled[field.name] = out[inverse]
    return dataclasses.replace(samples, **(sampled | {"t": times}))


def align(run: Trajectory, reference: Reference) -> Aligned:
    """Return ``run`` with the reference sampled at the run's own times."""
    return Aligned(run=run, reference=sample_reference(reference, run.t))
