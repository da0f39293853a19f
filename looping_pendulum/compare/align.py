"""Evaluates the reference at an engine's own sample times.

An engine's run is never interpolated: the reference is exact at any time, so it is the one that is evaluated anew. Its
landmarks, too, are read as an engine's are, from samples, where the two are compared.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import Parameters
from looping_pendulum.reference_ode.solve import DURATION
from looping_pendulum.runs.events import MIN_REST, Landmarks, exact_landmarks, extrema, run_landmarks
from looping_pendulum.runs.trajectory import (
    SAME_TIME,
    UNKNOWN_MODE,
    RunStatus,
    Trajectory,
    finite_length,
    first_samples,
    sample_times,
)

Reference = Callable[[Array], Trajectory]
"""Function that returns the reference's motion at the given times [s], ascending; times after its end are left out or NaN."""

LENGTH_ROUNDING = 1e-9
"""Difference of two lengths that is due to rounding [m]."""


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
    def heavy_distance(self) -> Array:
        """Distance of the heavy mass from the reference's [m], shape (n,)."""
        return np.asarray(np.hypot(*(self.run.heavy_position - self.reference.heavy_position).T))

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


def reference_landmarks(reference: Reference, grid: Array) -> Landmarks:
    """Return the landmarks of the reference from its own events; only the extrema come from its samples at ``grid`` [s]."""
    run = reference(grid)
    count = finite_length(run)
    release_height = float(sample_reference(reference, np.zeros(1)).heavy_position[0, 1])

    def state_at(times: Sequence[float]) -> tuple[Array, Array, Array]:
        at = sample_reference(reference, np.array(times, dtype=float))
        return release_height - at.heavy_position[:, 1], at.wrap_angle, at.free_length

    x1, y1 = (extrema(run.t[:count], run.light_position[:count, i]) for i in (0, 1))
    return exact_landmarks(run.events, state_at, x1_extrema=x1, y1_extrema=y1)


class SampledReference:
    """The reference's run, sampled as often and cut like an engine's, so that both are read in the same way."""

    def __init__(self, reference: Reference, parameters: Parameters) -> None:
        # As long as the reference goes, because only what follows it shows whether a rest is the halt
        whole = reference(sample_times(DURATION))
        ended = any(event.name == "light_reaches_rod" for event in whole.events)
        self.parameters = parameters
        # The detector takes a rest for a confirmed halt by this status, as it does for an engine's run
        self.run = dataclasses.replace(whole, status=RunStatus.LIGHT_REACHED_ROD if ended else RunStatus.FINISHED)
        """The run from the release to the reference's own end, which may be later than the scenario's."""
        # Kept, since it is asked for beside every engine
        self._whole = run_landmarks(self.run, parameters)

    def landmarks_until(self, end: float) -> Landmarks:
        """Return the landmarks of the reference as if its run had been cut at the time ``end`` [s]."""
        count = int(np.searchsorted(self.run.t, end + SAME_TIME))
        return run_landmarks(dataclasses.replace(first_samples(self.run, count), status=RunStatus.FINISHED), self.parameters)

    def landmarks_beside(self, run: Trajectory | None = None) -> Landmarks:
        """Return the landmarks of the reference that an engine's ``run`` is compared with; those of its whole run without one.

        If the engine's run ended because its light mass reached the rod, the reference is cut where its free length is as
        short: the engine's run does not show the last millimetres.
        """
        # One chain of comparisons: both runs ended because the light mass reached the rod
        if run is None or not self.run.status is run.status is RunStatus.LIGHT_REACHED_ROD:
            return self._whole
        shortest = run.free_length[finite_length(run) - 1] - LENGTH_ROUNDING
        shorter = np.flatnonzero(self.run.free_length < shortest)
        return run_landmarks(first_samples(self.run, int(shorter[0]) if len(shorter) else len(self.run.t)), self.parameters)


def why_not_comparable(run: Trajectory, own: Landmarks, reference: SampledReference) -> str:
    """Return why the halt of ``run``, or its lack of one, cannot be compared with the reference's; empty: it can.

    A run that ended because its light mass reached the rod is complete. One that was cut must last for `MIN_REST` beyond the
    reference's halt, or it can neither confirm nor refute that halt. If the reference never halts, a cut run that is at rest at
    its end is not comparable where the reference is at rest at that time as well: the reference slides again later.

    Parameters
    ----------
    own
        Landmarks of ``run``.
    """
    if len(run.t) == 0 or run.status is RunStatus.LIGHT_REACHED_ROD:
        return ""
    end, halt = float(run.t[-1]), reference.landmarks_beside().halting_time
    if halt is None:
        if own.halting_time is None or reference.landmarks_until(end).halting_time is None:
            return ""
        return f"the run ends at {end:.3f} s, when its string rests; the reference's rests then too, but slides again later"
    if end >= halt + MIN_REST:
        return ""
    rests = "" if own.halting_time is None else f"; its string rests from {own.halting_time:.3f} s to the end of the run"
    if end < halt:
        return f"the run ends at {end:.3f} s, before the reference halts at {halt:.3f} s{rests}"
    return f"the run ends at {end:.3f} s, less than {MIN_REST * 1e3:.0f} ms after the reference halts at {halt:.3f} s{rests}"
