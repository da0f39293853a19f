"""Quantities that the demonstrations measure of a run, and curves that they draw."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from looping_pendulum.engines.landmarks import run_landmarks
from looping_pendulum.engines.protocol import Profile
from looping_pendulum.engines.reference import ReferenceEngine
from looping_pendulum.engines.trajectory import Trajectory
from looping_pendulum.reference_ode.parameters import Parameters
from looping_pendulum.reference_ode.solve import available_integrators
from looping_pendulum.scenarios.scenario import Scenario
from looping_pendulum.teaching.demonstrations.demonstration import DemonstrationCase, FigureCurve, MeasuredColumn, simulate

Runs = Mapping[str, Any]
"""Case -> what its run returned."""


def run_reference(scenario: Scenario) -> Trajectory:
    """Return the exact reference's run of ``scenario``, sampled once a millisecond."""
    return simulate(ReferenceEngine(available_integrators()[0], Profile.ACCURATE), scenario)


def reference_case(
    scenario: Scenario, key: str = "reference", label: str = "reference", *, main: bool = True
) -> DemonstrationCase:
    """Return the case of the exact reference; one that is not ``main`` is drawn in colour like the engines."""
    return DemonstrationCase(key=key, label=label, run=lambda: run_reference(scenario), reference=main)


def halting_time(parameters: Parameters) -> MeasuredColumn:
    """Return the column of the time at which the heavy mass comes to rest for good."""

    def measure(runs: Runs, key: str) -> float | None:
        return halting_time_of(runs[key], parameters)

    return MeasuredColumn(key="halt", header="M2 halts at [s]", measure=measure, digits=".4f", absent="never")


def halting_time_of(run: Trajectory, parameters: Parameters) -> float | None:
    """Return the halting time of a run [s]: the reference's own event, or an engine's, from its samples; None: never."""
    halts = [event.time for event in run.events if event.name == "halt"]
    if halts or run.events:
        return halts[0] if halts else None
    return run_landmarks(run, parameters).halting_time


def largest_drop(runs: Runs, key: str) -> float:
    """Return how far the heavy mass fell at most [cm]."""
    return 100 * float(np.max(runs[key].heavy_drop))


def rms_distance(runs: Runs, key: str, to: str, until: float) -> float | None:
    """Return the RMS distance [mm] of the light mass from that of run ``to`` until ``until`` [s]; None for that run itself."""
    if key == to:
        return None
    run, other = runs[key], runs[to]
    count = min(len(run.t), len(other.t), round(until / 1e-3) + 1)
    distances = np.linalg.norm(run.light_position[:count] - other.light_position[:count], axis=1)
    return 1e3 * float(np.sqrt(np.mean(distances**2)))


def first_index_apart(run: Trajectory, other: Trajectory, limit: float) -> int | None:
    """Return the index of the first sample whose light mass is more than ``limit`` [m] from the other run's, or None."""
    count = min(len(run.t), len(other.t))
    beyond = np.flatnonzero(np.linalg.norm(run.light_position[:count] - other.light_position[:count], axis=1) > limit)
    return int(beyond[0]) if len(beyond) else None


def drop_curves(runs: Runs, cases: Mapping[str, DemonstrationCase]) -> Sequence[FigureCurve]:
    """Return curves of how far the heavy mass has fallen [cm], against time."""
    return curves_over_time(lambda run: 100 * run.heavy_drop)(runs, cases)


def curves_over_time(
    value: Callable[[Trajectory], Any],
) -> Callable[[Runs, Mapping[str, DemonstrationCase]], Sequence[FigureCurve]]:
    """Return a function that makes curves of ``value`` against time."""

    def curves(runs: Runs, cases: Mapping[str, DemonstrationCase]) -> Sequence[FigureCurve]:
        return [
            FigureCurve(label=case.label, x=runs[key].t, y=value(runs[key]), reference=case.reference)
            for key, case in cases.items()
        ]

    return curves
