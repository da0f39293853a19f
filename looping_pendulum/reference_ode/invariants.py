"""Quantities that a run must conserve."""

from __future__ import annotations

from typing import Any

import numpy as np

from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import Parameters


def kinetic_energy(parameters: Parameters, light_velocity: Any, heavy_velocity: Any) -> Any:
    """Return the kinetic energy of both masses [J]; velocities as pairs (x, y) of numbers or arrays [m/s]."""
    (ax, ay), (bx, by) = light_velocity, heavy_velocity
    return 0.5 * parameters.light_mass * (ax * ax + ay * ay) + 0.5 * parameters.heavy_mass * (bx * bx + by * by)


def potential_energy(parameters: Parameters, light_position: Any, heavy_position: Any) -> Any:
    """Return the potential energy of both masses [J], 0 at the rod's centre; positions as pairs (x, y) [m]."""
    weighted_height = parameters.light_mass * light_position[1] + parameters.heavy_mass * heavy_position[1]
    return parameters.coefficients["gravity"] * weighted_height


def mechanical_energy(
    parameters: Parameters, light_position: Array, light_velocity: Array, heavy_position: Array, heavy_velocity: Array
) -> Array:
    """Return the kinetic and potential energy of both masses [J], shape (n,); arguments (n, 2), SI.

    It is constant without friction and drag.
    """
    kinetic = kinetic_energy(parameters, light_velocity.T, heavy_velocity.T)
    return np.asarray(kinetic + potential_energy(parameters, light_position.T, heavy_position.T))
