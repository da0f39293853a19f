"""Position and velocity of the string at the moment of release, along which the pymunk chains are placed."""

from __future__ import annotations

import math
from typing import Any

from looping_pendulum.engines.chain import point_on_string
from looping_pendulum.reference_ode.cartesian import release_velocity
from looping_pendulum.reference_ode.parameters import Parameters, Release

Vector = tuple[float, float]
"""x and y components, in the unit of the quantity."""


def bead_arcs(parameters: Parameters, link_length: float, margin: float) -> list[float]:
    """Return the distances [m] of the beads from the light mass along the string at release, a link apart.

    Beads lie on the rod and ``margin`` links beyond it on either side, but a link or more from either mass.
    """
    first = parameters.free_length - margin * link_length
    wound = parameters.rod_radius * parameters.release_angle
    count = math.ceil(wound / link_length + 2 * margin)
    arcs = (first + i * link_length for i in range(count + 1))
    return [arc for arc in arcs if link_length <= arc <= parameters.string_length - link_length]


def velocity_on_string(parameters: Parameters, arc: float) -> Vector:
    """Return the velocity [m/s] of the taut string just after release, ``arc`` [m] from the light mass.

    String on the rod and on the heavy side moves along itself with the heavy mass's speed; on the free part the velocity is
    linear between that of the tangent point and the light mass's.
    """
    p = parameters
    vx, vy, heavy_vy = release_velocity(p)
    wound_arc = min(max(arc - p.free_length, 0.0), p.rod_radius * p.release_angle)
    angle = p.release_angle - wound_arc / p.rod_radius
    along = (-heavy_vy * math.sin(angle), heavy_vy * math.cos(angle))
    share = max(1 - arc / p.free_length, 0.0)
    return (along[0] + share * (vx - along[0]), along[1] + share * (vy - along[1]))


def masses(space: Any, parameters: Parameters, *, light_mass: float | None = None) -> tuple[Any, Any]:
    """Create the light and the heavy mass as bodies of ``space``, as they are released; a clamped mass is a static body.

    Parameters
    ----------
    light_mass
        Mass of the light body [kg]; None: that of ``parameters``. A chain subtracts part of its own mass from it.
    """
    import pymunk

    # An infinite moment of inertia: the masses are points, and joints at their centres exert no torque.
    light = pymunk.Body(parameters.light_mass if light_mass is None else light_mass, math.inf)
    if parameters.release is Release.HELD:
        heavy = pymunk.Body(body_type=pymunk.Body.STATIC)
    else:
        heavy = pymunk.Body(parameters.heavy_mass, math.inf)
    light.position = point_on_string(parameters, 0.0, parameters.rod_radius)
    heavy.position = point_on_string(parameters, parameters.string_length, parameters.rod_radius)
    vx, vy, heavy_vy = release_velocity(parameters)
    light.velocity = (vx, vy)
    if parameters.release is not Release.HELD:
        heavy.velocity = (0.0, heavy_vy)
    space.add(light, heavy)
    return light, heavy
