"""Quantities that a run must conserve."""

from __future__ import annotations

import numpy as np

from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import Parameters


def mechanical_energy(
    parameters: Parameters, light_position: Array, light_velocity: Array, heavy_position: Array, heavy_velocity: Array
) -> Array:
    """Return the kinetic and potential energy of both masses [J], shape (n,); arguments (n, 2), SI.

    It is constant without friction and drag.
    """
    gravity = parameters.coefficients["gravity"]
    light = 0.5 * np.sum(light_velocity**2, axis=1) + gravity * light_position[:, 1]
    heavy = 0.5 * np.sum(heavy_velocity**2, axis=1) + gravity * heavy_position[:, 1]
    return np.asarray(parameters.light_mass * light + parameters.heavy_mass * heavy)
