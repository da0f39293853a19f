"""What the checks run, and how a check says what it needs of an engine."""

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
"""It raises AssertionError, with what it found and what it needed, where an engine does not do what it must."""

SMOOTH = Parameters(light_mass=0.01, heavy_mass=0.1, rod_radius=0.02, free_length=0.4, release_angle=radians(112))
"""No friction and no drag; a fat rod, so that chains of a few millimetres a link go over it smoothly."""
SMOOTH_DURATION = 0.15
"""[s]"""

ROUGH = Parameters(
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
"""Friction, drag, and no number that `SMOOTH` or a default has, so that one that an engine does not read shows.

The heavy mass halts at 0.226 s, and the string is wound by more than a full turn from 0.367 s on.
"""
ROUGH_DURATION = 0.42
"""[s]"""


@dataclass(frozen=True, kw_only=True)
class Needs:
    """What an engine must declare for a check to say anything of it."""

    parameters: tuple[Parameters, ...] = (SMOOTH,)
    """Apparatus that it must be able to represent."""
    laws: bool = True
    """Whether somebody must supply the physics of ``parameters``: friction, drag, a static friction of its own."""
    ladders: bool = False
    """Whether it must offer a ladder of refinement."""


NEEDS: dict[Check, Needs] = {}
"""Check -> what it needs; filled by `needs`."""


def needs(*parameters: Parameters, laws: bool = True) -> Callable[[Check], Check]:
    """Return a decorator that writes down what a check needs of an engine."""

    def note(check: Check) -> Check:
        NEEDS[check] = Needs(parameters=parameters, laws=laws)
        return check

    return note


def scenario(parameters: Parameters, duration: float) -> Scenario:
    """Wrap ``parameters`` for a check; ``duration`` is in s."""
    return Scenario(name="conformance", title="", description="", parameters=parameters, duration=duration)


def smooth_run(engine: Engine) -> Trajectory:
    """Run of `SMOOTH`."""
    return engine.simulate(scenario(SMOOTH, SMOOTH_DURATION))


def rough_run(engine: Engine) -> Trajectory:
    """Run of `ROUGH`."""
    return engine.simulate(scenario(ROUGH, ROUGH_DURATION))


def sample_times(duration: float) -> Array:
    """Times of the samples of a run of ``duration`` [s]."""
    return np.asarray(np.arange(round(duration / SAMPLE_INTERVAL) + 1) * SAMPLE_INTERVAL)


def step_of(engine: Engine) -> float:
    """Time step of ``engine`` [s]; the reference has none and gets zero."""
    return float(getattr(engine.settings, "time_step", 0.0))


class Remembering:
    """An engine that runs each scenario once: checks share their runs, failed ones too, and `again` makes one anew."""

    def __init__(self, engine: Engine) -> None:
        self.engine = engine
        self.name, self.variant, self.profile = engine.name, engine.variant, engine.profile
        self.abilities, self.settings = engine.abilities, engine.settings
        self.studies = engine.studies
        self._runs: list[tuple[Scenario, Trajectory | Exception]] = []

    def simulate(self, scenario: Scenario, recorder: object = None) -> Trajectory:
        """Return the run of ``scenario``; samples come with the trajectory, not through ``recorder``."""
        outcome = next((outcome for known, outcome in self._runs if known == scenario), None)
        if outcome is None:
            try:
                outcome = self.engine.simulate(scenario)
            except Exception as error:  # a hang of minutes is not waited for again
                outcome = error
            self._runs.append((scenario, outcome))
        if isinstance(outcome, Exception):
            raise outcome
        return outcome

    def again(self, scenario: Scenario) -> Trajectory:
        """Run ``scenario`` whatever was run before."""
        return self.engine.simulate(scenario)


def undisturbed_run(engine: Engine, parameters: Parameters, duration: float) -> Trajectory:
    """Run of ``parameters`` for ``duration`` [s] or longer: of `SMOOTH` an engine that remembers its runs has a longer one."""
    if isinstance(engine, Remembering) and parameters == SMOOTH and duration <= SMOOTH_DURATION:
        return smooth_run(engine)
    return engine.simulate(scenario(parameters, duration))


def fresh_run(engine: Engine, scenario: Scenario) -> Trajectory:
    """Run ``scenario``, also if ``engine`` remembers having run it."""
    return engine.again(scenario) if isinstance(engine, Remembering) else engine.simulate(scenario)
