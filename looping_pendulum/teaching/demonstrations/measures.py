"""What the demonstrations measure of a run, and the curves that they draw."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from looping_pendulum.compare.landmarks import run_landmarks
from looping_pendulum.engines.protocol import Profile
from looping_pendulum.engines.reference import ReferenceEngine
from looping_pendulum.engines.trajectory import Trajectory
from looping_pendulum.reference_ode.parameters import Parameters
from looping_pendulum.reference_ode.solve import available_integrators
from looping_pendulum.scenarios.scenario import Scenario
from looping_pendulum.teaching.demonstrations.demonstration import DemonstrationCase, FigureCurve, MeasuredColumn, simulated

Runs = Mapping[str, Any]


def reference(scenario: Scenario) -> Trajectory:
    """Exact reference's run of ``scenario``, sampled once a millisecond."""
    return simulated(ReferenceEngine(available_integrators()[0], Profile.ACCURATE), scenario)


def reference_case(
    scenario: Scenario, key: str = "reference", label: str = "reference", *, main: bool = True
) -> DemonstrationCase:
    """Case of the exact reference."""
    return DemonstrationCase(key=key, label=label, run=lambda: reference(scenario), reference=main)


def halting_time(parameters: Parameters) -> MeasuredColumn:
    """When the heavy mass came to rest for good."""

    def measure(runs: Runs, key: str) -> float | None:
        return halt_of(runs[key], parameters)

    return MeasuredColumn(key="halt", header="M2 halts at [s]", measure=measure, digits=".4f", absent="never")


def halt_of(run: Trajectory, parameters: Parameters) -> float | None:
    """Halting time of a run [s]: the reference's own event, or an engine's rest."""
    told = [event.time for event in run.events if event.name == "halt"]
    if told or run.events:
        return told[0] if told else None
    return run_landmarks(run, parameters).halting_time


def lowest(runs: Runs, key: str) -> float:
    """How far the heavy mass fell at most [cm]."""
    return 100 * float(np.max(runs[key].heavy_drop))


def distance(runs: Runs, key: str, to: str, until: float) -> float | None:
    """RMS distance of the light mass from that of another run up to ``until`` [mm]; None of the run itself."""
    if key == to:
        return None
    run, other = runs[key], runs[to]
    count = min(len(run.t), len(other.t), round(until / 1e-3) + 1)
    apart = np.linalg.norm(run.light_position[:count] - other.light_position[:count], axis=1)
    return 1e3 * float(np.sqrt(np.mean(apart**2)))


def first_apart(run: Trajectory, other: Trajectory, limit: float) -> int | None:
    """Index of the first sample whose light mass is more than ``limit`` [m] from the other run's; None: there is none."""
    count = min(len(run.t), len(other.t))
    beyond = np.flatnonzero(np.linalg.norm(run.light_position[:count] - other.light_position[:count], axis=1) > limit)
    return int(beyond[0]) if len(beyond) else None


def drops(runs: Runs, cases: Mapping[str, DemonstrationCase]) -> Sequence[FigureCurve]:
    """How far the heavy mass has fallen, against time."""
    return over_time(lambda run: 100 * run.heavy_drop)(runs, cases)


def over_time(value: Callable[[Trajectory], Any]) -> Callable[[Runs, Mapping[str, DemonstrationCase]], Sequence[FigureCurve]]:
    """Curves of ``value`` against time."""

    def curves(runs: Runs, cases: Mapping[str, DemonstrationCase]) -> Sequence[FigureCurve]:
        return [
            FigureCurve(label=case.label, x=runs[key].t, y=value(runs[key]), reference=case.reference)
            for key, case in cases.items()
        ]

    return curves
