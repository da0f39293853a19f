"""The string as a chain of links, and what a chain must correct to stand for a string: shared by the chain engines."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from looping_pendulum.reference_ode.geometry import light_position
from looping_pendulum.reference_ode.parameters import Parameters

MASS_FRACTION = 0.01
"""Mass of the whole chain as a fraction of the light mass; the model's string has none."""
MASS_COMPENSATION = 0.4
"""Share of the chain's mass taken off the light mass: the free part swings with it (a third, and the sliding part)."""


def polygon_friction(friction: float, bend: float) -> float:
    """Contact friction with which a polygon of corners ``bend`` [rad] obeys the capstan law of a circle.

    A massless chain that slides over a corner of angle b under Coulomb contact friction m has the tension ratio
    (1 + m tan(b/2)) / (1 - m tan(b/2)); setting that to exp(mu b) gives m = tanh(mu b / 2) / tan(b / 2).
    """
    return math.tanh(friction * bend / 2) / math.tan(bend / 2)


def polygon_radius(rod_radius: float, bend: Any) -> Any:
    """Radius [m] on which nodes must lie so that links bent by ``bend`` [rad] (a number or an array) wind up R per radian.

    A link of length h = R b turns the string by b where its nodes lie on the radius h / (2 sin(b/2)). The straight string then
    pivots about its last node from -b/2 to b/2, and its mean distance from the centre is then that times sin(b/2) / (b/2) = R.
    """
    return rod_radius * (bend / 2) / np.sin(bend / 2)


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
