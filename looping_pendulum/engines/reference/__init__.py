"""The exact hybrid model as an engine, and as the reference that every other engine is compared with."""

from __future__ import annotations

import math
import time
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from looping_pendulum.engines.protocol import Abilities, Engine, Profile, RecordSample, known_fields
from looping_pendulum.engines.studies import Ladder, Studies
from looping_pendulum.reference_ode.effects import EffectKind
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import Release
from looping_pendulum.reference_ode.solution import Run, Samples
from looping_pendulum.reference_ode.solve import default_duration, solve, solve_at
from looping_pendulum.reference_ode.transitions import PHASE_EVENTS, Event, Mode
from looping_pendulum.runs.trajectory import (
    SAMPLE_INTERVAL,
    Provenance,
    RunStatus,
    Supplier,
    Supplies,
    Supply,
    Trajectory,
    TrajectoryEvent,
    from_samples,
    sample_times,
)
from looping_pendulum.scenarios.scenario import Scenario
from looping_pendulum.versions import installed_version

TOLERANCES = {Profile.QUICK: 1e-9, Profile.ACCURATE: 1e-12}
"""Relative tolerance of an integration step, by profile."""

PACKAGES = ("numpy", "wasmtime")
"""Packages that its results depend on."""

SUPPLIES = Supplies(
    winding=Supply(by=Supplier.ENGINE, how="wrap angle is a coordinate"),
    friction_law=Supply(by=Supplier.ENGINE, how="capstan law, T2 = T1 exp(-sign(v2) mu theta)"),
    stick_slip=Supply(by=Supplier.ENGINE, how="modes and events, located to rounding on the solution of a step"),
    drag=Supply(by=Supplier.ENGINE, how="the effects' forces in the equations of motion"),
)

LADDER = (1e-6, 1e-8, 1e-10, 1e-12)
"""Relative tolerances of an integration step for a convergence study, from coarse to fine."""


@dataclass(frozen=True, kw_only=True)
class ReferenceSettings:
    """Numerical settings of a reference run."""

    tolerance: float
    """Relative tolerance of an integration step."""


class ReferenceEngine:
    """The hybrid model of `reference_ode`."""

    name = "reference"
    variant = ""

    def __init__(self, profile: Profile, *, tolerance: float | None = None) -> None:
        self.profile = profile
        chosen = TOLERANCES[profile] if tolerance is None else tolerance
        self.settings = ReferenceSettings(tolerance=chosen)
        self.abilities = Abilities(
            releases=frozenset(Release),
            effect_kinds=frozenset(EffectKind),
            supplies=SUPPLIES,
            packages=("wasmtime",),
            summary="the exact hybrid model (stick, slip, slack)",
        )

    def simulate(self, scenario: Scenario, record: RecordSample | None = None) -> Trajectory:
        """Run ``scenario`` from its release to its duration, or until the light mass reaches the rod."""
        # Loads the model, which belongs to the building of an engine and not to its run
        solve_at(scenario.parameters, np.zeros(0), duration=SAMPLE_INTERVAL)
        started, cpu_started = time.perf_counter(), time.process_time()
        samples = solve_at(
            scenario.parameters,
            sample_times(scenario.duration),
            duration=default_duration(scenario),
            tolerance=self.settings.tolerance,
        )
        wall, cpu = time.perf_counter() - started, time.process_time() - cpu_started
        trajectory = replace(_trajectory(samples, scenario, self), wall_time=wall, cpu_time=cpu)
        # All at the end, as the solution is not computed sample by sample
        if record is not None:
            for row in _rows(samples):
                record(row.tolist())
        return trajectory

    def with_settings(self, **changes: Any) -> ReferenceEngine:
        """Return the reference with another tolerance."""
        return ReferenceEngine(self.profile, **changes)

    def studies(self) -> Studies:
        """Return one ladder: the tolerance of a step."""
        return Studies(ladders=[Ladder("tolerance", "", LADDER)])

    def provenance(self) -> Provenance:
        """Return versions, settings and suppliers of this engine's runs."""
        return Provenance(
            versions={name: installed_version(name) for name in PACKAGES},
            settings=asdict(self.settings),
            supplies=SUPPLIES,
        )


STATUS_OF_END = {
    Event.LIGHT_REACHES_ROD: RunStatus.LIGHT_REACHED_ROD,
    Event.HEAVY_REACHES_ROD: RunStatus.HEAVY_REACHED_ROD,
    Event.UNWRAPPED: RunStatus.STRING_LEFT_ROD,
}
"""Event that ends a run of the reference before its time is up -> status."""


class Reference:
    """The reference's solution of one scenario; it is sampled at an engine's times, so that no engine is ever resampled."""

    def __init__(self, scenario: Scenario) -> None:
        self.scenario = scenario
        self.engine = ReferenceEngine(Profile.ACCURATE)
        tolerance = self.engine.settings.tolerance
        # Solved once for all times, unlike `ReferenceEngine`: each engine is compared at times of its own
        self.solution = solve(scenario, tolerance=tolerance)

    def __call__(self, t: Array) -> Trajectory:
        """Sample the reference at times ``t`` [s]; times after its end are left out."""
        t = np.asarray(t, dtype=float)
        samples = self.solution.sample(t[t <= self.solution.end_time])
        return _trajectory(samples, self.scenario, self.engine)


def event_names(run: Run) -> tuple[TrajectoryEvent, ...]:
    """Return the events of a run by the names in reports: stop, stick, slip_onset, slack, taut, halt, light_reaches_rod ..."""
    trajectory_events: list[TrajectoryEvent] = []
    for event in run.events:
        if event.event in PHASE_EVENTS:
            continue
        name = {
            None: "release",
            Event.LOSES_TENSION: "slack",
            Event.SLIP_ONSET_DOWN: "slip_onset",
            Event.SLIP_ONSET_UP: "slip_onset",
        }.get(event.event, str(event.event))
        trajectory_events.append(TrajectoryEvent(time=event.time, name=name))
        if event.mode_after is Mode.STICKING:
            trajectory_events.append(TrajectoryEvent(time=event.time, name="stick"))
    if run.halt is not None:
        trajectory_events.append(TrajectoryEvent(time=run.halt.time, name="halt"))
    return tuple(sorted(trajectory_events, key=lambda e: e.time))


def engines(profile: Profile) -> list[Engine]:
    """Return the reference, in ``profile``."""
    return [ReferenceEngine(profile)]


def _rows(samples: Samples) -> Array:
    """Return the rows of `trajectory.COLUMNS`; the string of the model does not stretch."""
    parts = (samples.light_position, samples.light_velocity, samples.heavy_position, samples.heavy_velocity)
    return np.column_stack([samples.t, *parts, np.zeros(len(samples.t)), np.full(len(samples.t), np.nan)])


def _trajectory(samples: Samples, scenario: Scenario, engine: ReferenceEngine) -> Trajectory:
    run, provenance = samples.run, engine.provenance()
    without_string = scenario.parameters.release is Release.DROP
    nan = np.full(len(samples.t), math.nan)
    light_tension, heavy_tension = samples.tensions
    # The clamp holds the heavy mass, so the tension above it is not determined by the motion.
    heavy_tension = np.where(np.isin(samples.mode, (Mode.CLAMPED, Mode.CLAMPED_SLACK)), math.nan, heavy_tension)
    # The run itself goes on beyond the scenario's duration, see `simulate`
    ended = STATUS_OF_END.get(run.end.event) if run.end.event is not None and run.end_time <= scenario.duration else None
    return from_samples(
        _rows(samples),
        parameters=scenario.parameters,
        free_length=nan if without_string else samples.state.free_length,
        wrap_angle=nan if without_string else samples.state.wrap_angle,
        mode=samples.mode,
        light_tension=light_tension,
        heavy_tension=heavy_tension,
        events=event_names(run),
        status=ended or RunStatus.FINISHED,
        provenance=provenance,
        **known_fields(engine, scenario),
    )
