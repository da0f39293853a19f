"""Exact solutions of special cases, and the energy that a run conserves, with which tests compare every solver and engine."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from looping_pendulum.reference_ode.geometry import Array, light_velocity
from looping_pendulum.reference_ode.parameters import Parameters

HELD_PERIOD_NODES = 200
"""Nodes of the midpoint rule in `held_period`, which converges to rounding with far fewer."""


def atwood_acceleration(parameters: Parameters) -> float:
    """Return the downward acceleration of the heavy mass, both masses hanging, no drag [m/s^2] (paper, eq. for y2(t)).

    It is g (M2 - M1 e^{mu pi}) / (M2 + M1 e^{mu pi}), or zero if the rod holds the string.
    """
    c, pi = parameters.coefficients, math.pi
    if parameters.heavy_mass <= parameters.light_mass * math.exp(c["static_friction"] * pi):
        return 0.0
    pull = parameters.light_mass * math.exp(c["kinetic_friction"] * pi)
    return c["gravity"] * (parameters.heavy_mass - pull) / (parameters.heavy_mass + pull)


def free_fall(t: Array, *, mass: float, drag: float, gravity: float) -> Array:
    """Return the distance fallen from rest after ``t`` [s] under quadratic drag ``drag`` [kg/m]; shape of ``t`` [m].

    It is (m / gamma) ln cosh(sqrt(g gamma / m) t), or g t^2 / 2 without drag.
    """
    if drag == 0:  # exactly, as it is given, not computed
        return 0.5 * gravity * t**2
    x = math.sqrt(gravity * drag / mass) * t
    # ln cosh x without cosh itself, which overflows at a large x
    return mass / drag * (np.logaddexp(x, -x) - math.log(2))


def spiral(wrap_angle: Array, *, halt_length: float, halt_angle: float, rod_radius: float) -> tuple[Array, Array]:
    """Return the path of the light mass once the heavy one has halted, as polar coordinates (rho [m], psi [rad]).

    From the paper, appendix B: rho = sqrt(R^2 + l^2) and psi = theta + arctan(l / R), with l + R theta constant.
    """
    free_length = halt_length + rod_radius * (halt_angle - wrap_angle)
    return np.hypot(rod_radius, free_length), wrap_angle + np.arctan2(free_length, rod_radius)


def halted_free_length(t: Array, *, halt_length: float, halt_time: float, end_time: float) -> Array:
    """Return the free length after the halt, gravity and drag neglected [m] (paper, eq. l0).

    It is l_halt sqrt((t_end - t) / (t_end - t_halt)): exact without gravity and drag; with them the paper finds it to be right
    within a few percent.
    """
    return halt_length * np.sqrt((end_time - t) / (end_time - halt_time))


def held_period(parameters: Parameters) -> float:
    """Return the period of the held pendulum, whose string winds on and off the rod, without drag [s].

    From the energy integral: with the heavy mass clamped l + R theta is constant, w = l theta' is the light mass's speed, and
    T = 2 times the integral of l / w over theta between the turning points. In s (theta = middle - half cos s) the integrand is
    smooth and periodic, so that the midpoint rule converges exponentially.

    Raises
    ------
    ValueError
        If the string would go slack: at the release, or at the turn on the other side, where it is shorter and so higher.
    """
    # Imported on use: SciPy's optimizers are slow to import, and the conformance checks import this module
    from scipy.optimize import brentq

    p, gravity, start = parameters, parameters.coefficients["gravity"], parameters.release_angle
    total = p.free_length + p.rod_radius * start

    def height(theta: Array | float) -> Array:
        return np.asarray(p.rod_radius * np.sin(theta) + (total - p.rod_radius * theta) * np.cos(theta))

    # Beyond 270 deg, where the string leaves the rod's lowest point, a mass at rest would fall away from the string's line
    if start >= math.pi or height(start) > -p.rod_radius:
        raise ValueError("held_period: needs a release between 90 and 180 deg, below the rod; else the string goes slack")
    # The bracket: straight down the mass is below its start; straight up, or with all its string wound, it is not
    turn = brentq(lambda theta: float(height(theta) - height(start)), math.pi, min(2 * math.pi, total / p.rod_radius))
    nodes = (np.arange(HELD_PERIOD_NODES) + 0.5) * math.pi / HELD_PERIOD_NODES
    theta = (start + turn) / 2 - (turn - start) / 2 * np.cos(nodes)
    speed = np.sqrt(2 * gravity * (height(start) - height(theta)))
    integrand = (total - p.rod_radius * theta) / speed * (turn - start) / 2 * np.sin(nodes)
    return float(2 * integrand.sum() * math.pi / HELD_PERIOD_NODES)


def release_acceleration(parameters: Parameters, friction: float | None = None) -> tuple[float, float, float]:
    """Return the accelerations of a looping release at t = 0: light mass x and y, heavy mass y [m/s^2].

    From rest, at the wrap angle theta, with E = exp(mu theta) the ratio of the tensions over a rod on which the string slides:
    M1 u' = -M1 g cos(theta) - T1 along the string, M2 u' = T1 E - M2 g, and g sin(theta) across it. Drag is zero at rest.

    Parameters
    ----------
    friction
        Another coefficient mu in place of the kinetic one, which may be negative here.

    Raises
    ------
    ValueError
        If the rod holds the string, so that it does not slide down.
    """
    p, theta, gravity = parameters, parameters.release_angle, parameters.coefficients["gravity"]
    weight = -p.light_mass * math.cos(theta)
    if p.heavy_mass <= weight * math.exp(p.coefficients["static_friction"] * theta):
        raise ValueError("release_acceleration: the rod holds the string; needs a heavier heavy mass")
    ratio = math.exp((p.coefficients["kinetic_friction"] if friction is None else friction) * theta)
    rate = gravity * (weight * ratio - p.heavy_mass) / (p.heavy_mass + p.light_mass * ratio)
    return (*light_velocity(math, theta, rate, gravity * math.sin(theta)), rate)


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
