"""Apparatuses that the checks simulate, and the declaration of what a check requires of an engine."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import radians

import numpy as np

from looping_pendulum.engines.protocol import SAMPLE_INTERVAL, Engine
from looping_pendulum.engines.trajectory import Trajectory
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import Parameters
from looping_pendulum.scenarios.scenario import Scenario

Check = Callable[[Engine], None]
"""A check raises AssertionError, with what was found and what was needed, if the engine fails it."""

LOSSLESS = Parameters(light_mass=0.01, heavy_mass=0.1, rod_radius=0.02, free_length=0.4, release_angle=radians(112))
"""No friction and no drag; a fat rod, so that chains of a few millimetres a link go over it smoothly."""
LOSSLESS_DURATION = 0.15
"""Duration of a run of `LOSSLESS` [s]."""

LOSSY = Parameters(
    light_mass=0.02,
    heavy_mass=0.1,
    rod_radius=0.0125,
    free_length=0.2,
    release_angle=radians(100),
    hanging_length=0.05,
    coefficients={
        "gravity": 8.0,
        "kinetic_friction": 0.35,
        "light_drag": 2e-3,
        "heavy_drag": 1e-3,
        "string_drag": 1e-3,
    },
)
"""With friction and drag. No value equals that of `LOSSLESS` or a default, so that a value that an engine ignores is noticed.

The heavy mass halts at 0.226 s, and the string is wound by more than a full turn from 0.367 s on.
"""
LOSSY_DURATION = 0.42
"""Duration of a run of `LOSSY` [s]."""


@dataclass(frozen=True, kw_only=True)
class Requirements:
    """What an engine must declare for a check to apply to it."""

    parameters: tuple[Parameters, ...] = (LOSSLESS,)
    """Apparatuses that it must be able to represent."""
    laws: bool = True
    """Whether it must also have the physics of ``parameters``: friction, drag, a static friction other than the kinetic one."""
    ladders: bool = False
    """Whether it must offer a ladder of refinement."""


REQUIREMENTS: dict[Check, Requirements] = {}
"""Check -> what it requires of an engine; filled by `requires`."""


def requires(*parameters: Parameters, laws: bool = True) -> Callable[[Check], Check]:
    """Return a decorator that registers what a check requires of an engine."""

    def register(check: Check) -> Check:
        REQUIREMENTS[check] = Requirements(parameters=parameters, laws=laws)
        return check

    return register


def scenario(parameters: Parameters, duration: float) -> Scenario:
    """Return a scenario with ``parameters`` for a check; ``duration`` is in s."""
    return Scenario(name="conformance", title="", description="", parameters=parameters, duration=duration)


def lossless_run(engine: Engine) -> Trajectory:
    """Return the engine's run of `LOSSLESS`."""
    return engine.simulate(scenario(LOSSLESS, LOSSLESS_DURATION))


def lossy_run(engine: Engine) -> Trajectory:
    """Return the engine's run of `LOSSY`."""
    return engine.simulate(scenario(LOSSY, LOSSY_DURATION))


def sample_times(duration: float) -> Array:
    """Return the sample times [s] of a run of ``duration`` [s]."""
    return np.asarray(np.arange(round(duration / SAMPLE_INTERVAL) + 1) * SAMPLE_INTERVAL)


def time_step_of(engine: Engine) -> float:
    """Return the time step of ``engine`` [s]; 0 for the reference, which has none."""
    return float(getattr(engine.settings, "time_step", 0.0))


class CachedEngine:
    """An engine that simulates each scenario only once, so that checks share their runs, including failed ones."""

    def __init__(self, engine: Engine) -> None:
        self.engine = engine
        self.name, self.variant, self.profile = engine.name, engine.variant, engine.profile
        self.abilities, self.settings = engine.abilities, engine.settings
        self.studies = engine.studies
        self._runs: list[tuple[Scenario, Trajectory | Exception]] = []

    def simulate(self, scenario: Scenario, recorder: object = None) -> Trajectory:
        """Return the run of ``scenario``; samples come with the trajectory, not through ``recorder``."""
        outcome = next((outcome for cached, outcome in self._runs if cached == scenario), None)
        if outcome is None:
            try:
                outcome = self.engine.simulate(scenario)
            except Exception as error:  # cached too: a run that hangs for minutes is not repeated
                outcome = error
            self._runs.append((scenario, outcome))
        if isinstance(outcome, Exception):
            raise outcome
        return outcome

    def simulate_uncached(self, scenario: Scenario) -> Trajectory:
        """Simulate ``scenario`` again, even if its run is cached."""
        return self.engine.simulate(scenario)


def run_without_effect(engine: Engine, parameters: Parameters, duration: float) -> Trajectory:
    """Return a run of ``parameters`` for at least ``duration`` [s], if possible the cached one of `LOSSLESS`."""
    if isinstance(engine, CachedEngine) and parameters == LOSSLESS and duration <= LOSSLESS_DURATION:
        return lossless_run(engine)
    return engine.simulate(scenario(parameters, duration))


def uncached_run(engine: Engine, scenario: Scenario) -> Trajectory:
    """Simulate ``scenario``, even if ``engine`` has its run cached."""
    return engine.simulate_uncached(scenario) if isinstance(engine, CachedEngine) else engine.simulate(scenario)
