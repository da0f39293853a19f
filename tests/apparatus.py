"""Apparatus that several tests use, and what they do with an engine's run of it."""

import math

import numpy as np

from looping_pendulum.reference_ode.parameters import Parameters
from looping_pendulum.reference_ode.solve import solve_at
from looping_pendulum.scenarios.scenario import Scenario

TEN_TO_ONE = Parameters(
    light_mass=0.010,
    heavy_mass=0.100,
    rod_radius=0.00625,
    free_length=0.58,
    release_angle=math.radians(112),
    coefficients={"kinetic_friction": 0.34, "light_drag": 1e-3, "heavy_drag": 1e-3, "string_drag": 1e-3},
)
TWO_TO_ONE = Parameters(
    light_mass=0.050,
    heavy_mass=0.100,
    rod_radius=0.0065,
    free_length=0.584,
    release_angle=math.radians(68),
    coefficients={"kinetic_friction": 0.265, "light_drag": 6e-4, "heavy_drag": 1e-3, "string_drag": 5.9e-3},
)
SENSITIVE = Parameters(  # the paper's "sensitive" case, M2/M1 = 2.5
    light_mass=0.0152,
    heavy_mass=0.038,
    rod_radius=0.00625,
    free_length=0.58,
    release_angle=math.radians(75.1),
    coefficients={"kinetic_friction": 0.3, "light_drag": 1e-3, "heavy_drag": 1e-3},
)
WITHOUT_LOSSES = {"kinetic_friction": 0.0, "light_drag": 0.0, "heavy_drag": 0.0, "string_drag": 0.0}
NO_DRAG = {"light_drag": 0.0, "heavy_drag": 0.0, "string_drag": 0.0}


def scenario(parameters, duration):
    return Scenario(name="test", title="", description="", parameters=parameters, duration=duration)


def simulated(engine, parameters, duration, **changes):
    """Return an engine's run with some settings changed, which must not fail."""
    changed = engine.with_settings(**changes) if changes else engine
    return changed.simulate(scenario(parameters, duration)).raise_if_failed()


def fitted_acceleration(trajectory):
    """Return the acceleration of the heavy mass that fits its drop from rest best [m/s^2]."""
    square = 0.5 * trajectory.t**2
    return square @ trajectory.heavy_drop / (square @ square)


def distances(trajectory, parameters):
    """Return the distance of the light mass from the reference's at every sample that both have [m]."""
    exact = solve_at(parameters, trajectory.t, duration=trajectory.t[-1] + 0.01)
    return np.linalg.norm(trajectory.light_position[: len(exact.t)] - exact.light_position, axis=1)
