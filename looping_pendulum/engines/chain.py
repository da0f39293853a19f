"""The string as a chain of links, and what a chain must correct to stand for a string: shared by the chain engines."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from looping_pendulum.engines.protocol import APPLIED_DRAG
from looping_pendulum.engines.trajectory import Supplier, Supplies, Supply
from looping_pendulum.reference_ode.geometry import Array, light_position
from looping_pendulum.reference_ode.parameters import Parameters

MASS_FRACTION = 0.01
"""Mass of the whole chain as a fraction of the light mass; the model's string has none."""
MASS_COMPENSATION = 0.4
"""Share of the chain's mass taken off the light mass: the free part swings with it (a third, and the sliding part)."""

ONE_COEFFICIENT = (
    "one Coulomb coefficient only: where static_friction differs from kinetic_friction, the kinetic one acts in both"
)
STRAIGHT_STRING = "straight string has no mass and stays straight: no waves run along it, and slack string does not fall"
NO_STOP = (
    "the rig does not stop where the string leaves the rod (wrap angle 0) or the heavy mass reaches it, as the reference does"
)
"""Limits that chains share."""
BEADS_WEIGH = "beads on the rod weigh something, {:.2g} % of the light mass each; nothing is taken off the masses for them"
"""An addition that bead chains share."""

COMES = 0.2
"""A bead comes when its place on the straight string is this near to the rod's polygon, in R bend^2: the place comes nearer
by 1 while the string is wound, or slides, by one link."""
GOES = 0.5
"""The outermost bead goes when the string without it would pass the polygon at this distance, in R bend^2; more than `COMES`,
so that none flickers."""
LEAST_BEADS = 2
"""Beads that always stay."""
LEAST_LENGTH = 1.5
"""A straight part shorter than this gets no more beads, in links."""

Place = Sequence[float] | Array
"""x and y [m]."""


def bead_supplies(rod: str, stick_slip: str) -> Supplies:
    """Who supplies what in a chain whose beads come and go, over a ``rod`` of this shape."""
    return Supplies(
        winding=Supply(
            by=Supplier.ENGINE,
            how=f"contact of beads with a {rod}; the adapter adds and removes beads on the straight parts only",
        ),
        friction_law=Supply(
            by=Supplier.ENGINE,
            how=f"Coulomb friction between beads and {rod.split()[-1]}, its coefficient solved "
            "from the capstan law for the polygon's corners",
        ),
        stick_slip=Supply(by=Supplier.ENGINE, how=f"the same contact: {stick_slip}"),
        drag=APPLIED_DRAG,
    )


def next_place(bead: Place, mass: Place, link_length: float) -> tuple[float, float]:
    """Where the next bead would be on the straight string from ``bead`` to ``mass``: a link of this length [m] further."""
    (x, y), (mass_x, mass_y) = bead, mass
    share = link_length / math.hypot(mass_x - x, mass_y - y)
    return x + share * (mass_x - x), y + share * (mass_y - y)


class StraightParts:
    """When a bead comes or goes where a straight part of the string meets the rod.

    A bead on a straight part carries nothing sideways, so one that comes or goes there changes no force.

    Parameters
    ----------
    rod_radius
        [m]
    bend
        Angle between neighbouring links on the rod [rad].
    node_radius
        Distance of a bead on the rod from the rod's centre [m].
    """

    def __init__(self, rod_radius: float, bend: float, node_radius: float) -> None:
        self.link_length = rod_radius * bend
        lift = rod_radius * bend**2
        self._comes, self._goes = ((node_radius + share * lift) ** 2 for share in (COMES, GOES))

    def change(self, mass: Place, outermost: Place, following: Place, rest_length: float, beads: int) -> int:
        """How many of the ``beads`` come (1) or go (-1) between ``mass`` and the ``outermost``; ``following`` is next to that.

        ``rest_length`` [m] is the straight part's own.
        """
        x, y = next_place(outermost, mass, self.link_length)
        if x * x + y * y < self._comes:
            return 1 if rest_length > LEAST_LENGTH * self.link_length else 0
        if beads > LEAST_BEADS:
            x, y = next_place(following, mass, self.link_length)
            return -1 if x * x + y * y > self._goes else 0
        return 0


class SlipGauge:
    """How far the string has slid over the rod, read from a chain's nodes.

    The rest length that hangs below the rod's centre tells it: none of it lies on the rod, and what the string stretches by is
    no part of it. A polygon's corner that passes there changes it by less than R bend^3.
    """

    def __init__(self) -> None:
        self._at_release: float | None = None

    def read(self, places: Sequence[Place], rest_lengths: Sequence[float]) -> float:
        """Slip since the first reading [m], positive where the string moved towards the heavy mass; NaN: it cannot be told.

        ``places`` run from the light mass over every node to the heavy mass, ``rest_lengths`` [m] belong to the links between.
        """
        hanging = hanging_rest_length(places, rest_lengths)
        if self._at_release is None:
            self._at_release = hanging
        return hanging - self._at_release


def hanging_rest_length(places: Sequence[Place], rest_lengths: Sequence[float]) -> float:
    """Rest length [m] from the heavy mass up to where the string first reaches the height of the rod's centre.

    NaN where the heavy mass is not below that height. Arguments as for `SlipGauge.read`.
    """
    lower = places[-1][1]
    if not lower < 0:
        return math.nan
    hanging = 0.0
    for place, length in zip(reversed(places[:-1]), reversed(rest_lengths), strict=True):
        upper = place[1]
        if upper >= 0:
            return hanging + length * -lower / (upper - lower)
        hanging += length
        lower = upper
    return math.nan


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
