"""The string as a chain of links, and what a chain must correct to stand for a string: shared by the chain engines."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from looping_pendulum.reference_ode.geometry import Array, light_position
from looping_pendulum.reference_ode.parameters import Parameters

MASS_FRACTION = 0.01
"""Mass of the whole chain as a fraction of the light mass; the model's string has none."""
MASS_COMPENSATION = 0.4
"""Share of the chain's mass taken off the light mass: the free part swings with it (a third, and the sliding part)."""


@dataclass(frozen=True, kw_only=True)
class Chain:
    """Nodes of a chain laid along the string, from the light mass to the heavy one."""

    nodes: Array
    """Node positions at release [m], shape (n + 1, 2); the first is the light mass, the last the heavy one."""
    link_lengths: Array
    """Rest length of each link [m], shape (n,)."""
    light_mass: float
    """Light mass less what the chain already carries for it [kg]."""
    link_mass: float
    """[kg] per link or inner node."""
    bend: float
    """Angle between neighbouring links where they lie on the rod [rad]."""


def lay_chain(parameters: Parameters, link_length: float) -> Chain:
    """Lay a chain of about ``link_length`` [m] per link along the taut string, its nodes on the rod's circle."""
    p = parameters
    count = max(4, round(p.string_length / link_length))
    wound = p.rod_radius * p.release_angle
    nodes = np.empty((count + 1, 2))
    for i, s in enumerate(np.linspace(0.0, p.string_length, count + 1)):
        if s < p.free_length:
            nodes[i] = light_position(np, p.free_length - s, p.release_angle, p.rod_radius)
        elif s < p.free_length + wound:
            angle = p.release_angle - (s - p.free_length) / p.rod_radius
            nodes[i] = light_position(np, 0.0, angle, p.rod_radius)
        else:
            nodes[i] = (p.rod_radius, -(s - p.free_length - wound))
    chain_mass = MASS_FRACTION * p.light_mass
    spacing = p.string_length / count
    return Chain(
        nodes=nodes,
        link_lengths=np.linalg.norm(np.diff(nodes, axis=0), axis=1),
        light_mass=p.light_mass - MASS_COMPENSATION * chain_mass,
        link_mass=chain_mass / count,
        bend=2 * math.asin(min(1.0, spacing / (2 * p.rod_radius))),
    )


def polygon_friction(friction: float, bend: float) -> float:
    """Contact friction with which a polygon of corners ``bend`` [rad] obeys the capstan law of a circle.

    A massless chain that slides over a corner of angle b under Coulomb contact friction m has the tension ratio
    (1 + m tan(b/2)) / (1 - m tan(b/2)); setting that to exp(mu b) gives m = tanh(mu b / 2) / tan(b / 2).
    """
    return math.tanh(friction * bend / 2) / math.tan(bend / 2)


def polygon_radius(rod_radius: float, bend: float) -> float:
    """Radius [m] on which nodes must lie so that links bent by ``bend`` [rad] wind up R per radian, as a string does.

    A link of length h = R b turns the string by b where its nodes lie on the radius h / (2 sin(b/2)). The straight string then
    pivots about its last node from -b/2 to b/2, and its mean distance from the centre is then that times sin(b/2) / (b/2) = R.
    """
    return rod_radius * (bend / 2) / math.sin(bend / 2)


def point_on_string(parameters: Parameters, arc: float, node_radius: float) -> tuple[float, float]:
    """Where the taut string is at release, ``arc`` [m] from the light mass; its wound part lies on ``node_radius`` [m]."""
    p = parameters
    wound_arc = arc - p.free_length
    if wound_arc < 0:
        return light_position(math, -wound_arc, p.release_angle, p.rod_radius)
    hanging_arc = wound_arc - p.rod_radius * p.release_angle
    if hanging_arc < 0:
        return light_position(math, 0.0, p.release_angle - wound_arc / p.rod_radius, node_radius)
    return (p.rod_radius, -hanging_arc)


def bead_places(parameters: Parameters, link_length: float, node_radius: float, margin: float) -> list[tuple[float, float]]:
    """Beads at release, a link apart: on the rod and ``margin`` links beyond it, but a link or more from either mass."""
    first = parameters.free_length - margin * link_length
    wound = parameters.rod_radius * parameters.release_angle
    count = math.ceil(wound / link_length + 2 * margin)
    arcs = (first + i * link_length for i in range(count + 1))
    inside = (arc for arc in arcs if link_length <= arc <= parameters.string_length - link_length)
    return [point_on_string(parameters, arc, node_radius) for arc in inside]
