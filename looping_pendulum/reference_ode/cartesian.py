"""The one path by which the effects' forces, and a push at release, reach engines that work in x and y."""

from __future__ import annotations

import math
from collections.abc import Callable

from looping_pendulum.reference_ode import effects
from looping_pendulum.reference_ode.driver import Driver
from looping_pendulum.reference_ode.effects import GRAVITY, EffectKind, Kinematics
from looping_pendulum.reference_ode.geometry import light_velocity, string_followed
from looping_pendulum.reference_ode.parameters import Parameters

RELEASE_TOLERANCE = 1e-12
"""Asked for by the reference's constructor; nothing is integrated here."""

CartesianForce = Callable[[float, float, float, float, float, float], tuple[float, float, float]]


def cartesian_force(parameters: Parameters) -> CartesianForce | None:
    """Return ``force(time, x, y, vx, vy, heavy_vy) -> (fx, fy, heavy_fy)`` [N], or None where no such force acts.

    Gravity is left out (every engine has its own), and so is the string's law on the rod. Positions [m] are from the rod's
    centre, velocities in m/s. The formulas are the reference's own. The function counts the light mass's turns, so it must be
    called in the order of time, more than twice a turn.
    """
    p, radius = parameters.values(), parameters.rod_radius
    acting = tuple(
        effect
        for effect in parameters.effects
        if effect.kind in (EffectKind.FORCE, EffectKind.CLOSURE)
        and effect is not GRAVITY
        and any(parameters.coefficients[c.name] != c.null for c in effect.coefficients)
    )
    if not acting:
        return None
    on_light = tuple(effect for effect in acting if effect.force_on_light_mass is not None)
    on_heavy = tuple(effect for effect in acting if effect.force_on_heavy_mass is not None)
    last_angle = parameters.release_angle

    def force(time: float, x: float, y: float, vx: float, vy: float, heavy_vy: float) -> tuple[float, float, float]:
        nonlocal last_angle
        free_length, last_angle = string_followed(x, y, radius, last_angle)
        cosine, sine = math.cos(last_angle), math.sin(last_angle)
        retreat, across = vy * cosine - vx * sine, -(vx * cosine + vy * sine)
        k = Kinematics(time, free_length, last_angle, retreat, across, abs(across), math.hypot(vx, vy), heavy_vy, abs(heavy_vy))
        along_force, across_force = effects.force_on_light_mass(math, k, p, on_light)
        return (
            along_force * sine - across_force * cosine,
            -along_force * cosine - across_force * sine,
            effects.force_on_heavy_mass(math, k, p, on_heavy),
        )

    return force


def release_velocity(parameters: Parameters) -> tuple[float, float, float]:
    """Velocities just after release [m/s]: x and y of the light mass, y of the heavy one.

    They are the reference's own: at rest unless the light mass is pushed; of a push that pulls at a taut string both masses get
    what the reference gives them.
    """
    state = Driver(parameters, 0.0, RELEASE_TOLERANCE, "scipy").y
    return (*light_velocity(math, state.wrap_angle, state.retreat_speed, state.across_speed), state.heavy_speed)
