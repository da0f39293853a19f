"""Forces of the effects, and the state of the masses at release, in x and y, as engines need them."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from looping_pendulum.reference_ode import effects, rules
from looping_pendulum.reference_ode.effects import GRAVITY, EffectKind, Kinematics
from looping_pendulum.reference_ode.geometry import light_position, light_velocity, next_string_coordinates
from looping_pendulum.reference_ode.parameters import Parameters

Vector = tuple[float, float]
"""x and y components, in the unit of the quantity."""
CartesianForce = Callable[[float, float, float, float, float, float], tuple[float, float, float]]
"""(time, x, y, vx, vy, heavy_vy) -> (fx, fy, heavy_fy), SI."""


def kinematics(time: float, free_length: float, wrap_angle: float, vx: float, vy: float, heavy_vy: float) -> Kinematics:
    """Return the kinematics on which the effects depend, from those of the string and the masses' velocities [m/s]."""
    cosine, sine = math.cos(wrap_angle), math.sin(wrap_angle)
    # Components along -e1 and t1, the directions of `Kinematics`
    retreat, across = vy * cosine - vx * sine, -(vx * cosine + vy * sine)
    return Kinematics(time, free_length, wrap_angle, retreat, across, abs(across), math.hypot(vx, vy), heavy_vy, abs(heavy_vy))


def cartesian_force(parameters: Parameters) -> CartesianForce | None:
    """Return ``force(time, x, y, vx, vy, heavy_vy) -> (fx, fy, heavy_fy)`` [N], or None where no such force acts.

    Gravity is left out (every engine has its own), and so is the law of the string on the rod. Positions [m] are from the rod's
    centre, velocities in m/s. The formulas are those of the reference. The function counts the turns of the light mass, so it
    must be called in the order of time, more than twice a turn.
    """
    p, radius = parameters.values(), parameters.rod_radius
    acting = tuple(
        effect
        for effect in parameters.effects
        if effect.kind in (EffectKind.FORCE, EffectKind.CLOSURE)
        and effect is not GRAVITY
        # Effects of the paper's model are always listed, even at their null value
        and any(parameters.coefficients[c.name] != c.null for c in effect.coefficients)
    )
    if not acting:
        return None
    # Sorted out once, as engines call the function at every step
    on_light = tuple(effect for effect in acting if effect.force_on_light_mass is not None)
    on_heavy = tuple(effect for effect in acting if effect.force_on_heavy_mass is not None)
    last_angle = parameters.release_angle

    def force(time: float, x: float, y: float, vx: float, vy: float, heavy_vy: float) -> tuple[float, float, float]:
        nonlocal last_angle
        free_length, last_angle = next_string_coordinates(x, y, radius, last_angle)
        k = kinematics(time, free_length, last_angle, vx, vy, heavy_vy)
        cosine, sine = math.cos(last_angle), math.sin(last_angle)
        along_force, across_force = effects.force_on_light_mass(math, k, p, on_light)
        return (
            along_force * sine - across_force * cosine,
            -along_force * cosine - across_force * sine,
            effects.force_on_heavy_mass(math, k, p, on_heavy),
        )

    return force


@dataclass(frozen=True, kw_only=True)
class MassesAtRelease:
    """Where both masses are just after release, and how they move."""

    light_position: Vector
    """x and y [m]."""
    light_velocity: Vector
    """[m/s]."""
    heavy_position: Vector
    """[m]."""
    heavy_velocity: Vector
    """[m/s]."""


def masses_at_release(parameters: Parameters) -> MassesAtRelease:
    """Return the state in which every rig starts, which is the reference's.

    The masses rest unless the light one is pushed. A push that pulls at a taut string moves both.
    """
    p = parameters
    system = rules.system_of_floats(p.values(), p.effects)
    state = rules.release(system, p.release, rules.state_at_release(p)).y
    return MassesAtRelease(
        light_position=light_position(math, p.free_length, p.release_angle, p.rod_radius),
        light_velocity=light_velocity(math, state.wrap_angle, state.retreat_speed, state.across_speed),
        heavy_position=(p.rod_radius, -p.hanging_length),
        heavy_velocity=(0.0, state.heavy_speed),
    )
