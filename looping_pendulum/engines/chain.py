"""The string as a chain of links, with the corrections that it needs to represent a string: shared by all chain engines."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from looping_pendulum.engines.protocol import Abilities, StepGroups
from looping_pendulum.engines.shipped import shipped_abilities
from looping_pendulum.engines.studies import Ladder, Variation
from looping_pendulum.pages.numbers import quantity
from looping_pendulum.reference_ode.geometry import light_position
from looping_pendulum.reference_ode.parameters import Parameters

# A compromise: a lighter chain is softer or needs shorter steps, and in a heavier one the string's own inertia shows
MASS_FRACTION = 0.01
"""Mass of the whole chain as a fraction of the light mass; the reference's string has no mass."""
MASS_COMPENSATION = 0.4
"""Fraction of the chain's mass that is subtracted from the light mass, because the free part of the chain swings with it.

A third is the inertia of a rod that turns about its end; the rest is the part that slides.
"""

ONE_COEFFICIENT = (
    "one Coulomb coefficient only: where static_friction differs from kinetic_friction, the kinetic one acts in both"
)
STRAIGHT_STRING = "straight string has no mass and stays straight: no waves run along it, and slack string does not fall"
NO_STOP = (
    "the rig does not stop where the string leaves the rod (wrap angle 0) or the heavy mass reaches it, as the reference does"
)
"""Sentences on limits that several chain variants share."""

CORNER_CHOICES = (
    Variation("contact friction", "corrected for the corners", "mu itself", {"polygon_friction": False}),
    Variation("circle of the beads", "corrected for the corners", "R itself", {"polygon_radius": False}),
)
"""Choices of an adapter that corrects contacts for the corners of the chain (`polygon_friction`, `polygon_radius`)."""

BEAD_RADIUS = 1e-3
"""Usual radius of a bead [m]."""
MIN_ROD_RADIUS = 1.5 * BEAD_RADIUS
"""Smallest radius of the rod [m]; the engine's own rod is thinner by a bead's radius, as beads' centres lie on the surface.

Through a rod of 1.2 mm the chain of pymunk slips (10:1, 110 deg), through one of 1 mm that of MuJoCo (ten_to_one).
"""


@dataclass(frozen=True, kw_only=True)
class BeadChainSettings(StepGroups):
    """Numerical settings that bead chains of several engines share, in SI units."""

    bend: float
    """Angle between neighbouring links on the rod [rad]; a link is R times this long."""
    bead_mass_ratio: float
    """Mass of one bead over the light mass. Lighter: a softer chain; heavier: the string's own inertia shows."""
    bead_radius: float = BEAD_RADIUS
    """Radius of a bead [m]; the rod is thinner by as much, so that the bead's centre moves where the string should."""
    steps_per_group: int = 5
    """Steps between two updates of the effects' forces and of the beads that are added and removed."""
    polygon_friction: bool = True
    """Whether the contact's friction is corrected for the polygon that the beads' links are."""
    polygon_radius: bool = True
    """Whether the beads' circle is corrected for it."""

    def node_radius(self, rod_radius: float) -> float:
        """Return the distance of a bead on the rod from the rod's centre [m]."""
        return float(polygon_radius(rod_radius, self.bend)) if self.polygon_radius else rod_radius

    def contact_friction(self, friction: float) -> float:
        """Return the contacts' coefficient for a string with the coefficient ``friction``."""
        return polygon_friction(friction, self.bend) if self.polygon_friction else friction


def bead_choices(settings: BeadChainSettings) -> tuple[Variation, ...]:
    """Return the choices that every adapter of beads makes: about the corners, the beads, and how often they are updated."""
    return (
        *CORNER_CHOICES,
        Variation("bead radius", quantity(settings.bead_radius, "m", 3), "0.5 mm", {"bead_radius": 5e-4}),
        Variation("steps between two updates of drag and beads", f"{settings.steps_per_group}", "1", {"steps_per_group": 1}),
    )


def bead_abilities(
    label: str,
    *,
    rod: str,
    stick_slip: str,
    bead_mass_ratio: float,
    **declared: Any,
) -> Abilities:
    """Return abilities of a chain with a variable number of beads, over a ``rod`` of this shape; see `shipped_abilities`.

    Parameters
    ----------
    stick_slip
        How the contact sticks and slips.
    bead_mass_ratio
        Mass of a bead over the light mass, with the quick profile.
    """
    winding = f"contact of beads with a {rod}; the adapter adds and removes beads on the straight parts only"
    friction = (
        f"Coulomb friction between beads and {rod.split()[-1]}, its coefficient solved from the capstan law for the polygon's "
        "corners"
    )
    return shipped_abilities(
        label,
        winding=winding,
        friction_law=friction,
        stick_slip=f"the same contact: {stick_slip}",
        additions=(
            f"beads on the rod weigh something, {100 * bead_mass_ratio:.2g} % of the light mass each; nothing is taken "
            "off the masses for them",
        ),
        min_rod_radius=MIN_ROD_RADIUS,
        **declared,
    )


def bend_rungs(settings: Any, bends: Iterable[float]) -> Ladder:
    """Return a ladder of the ``bends`` between a bead chain's links on the rod [rad]; a shorter link has a lighter bead."""
    density = settings.bead_mass_ratio / settings.bend
    rungs = [{"bend": bend, "bead_mass_ratio": density * bend} for bend in bends]
    return Ladder("bend", "rad", rungs, "a bead's mass, so that the string's mass per length stays")


def hanging_rest_length(places: Sequence[Sequence[float]], rest_lengths: Sequence[float]) -> float:
    """Return the rest length [m] from the heavy mass up to where the string first reaches the height of the rod's centre.

    Its change is the string's slip over the rod: none of that part lies on the rod, and the string's stretch does not count in
    it. A corner of the polygon that passes there changes it by less than R bend^3. It is NaN where the heavy mass is not below
    that height.

    Parameters
    ----------
    places
        Positions x and y [m] from the light mass over every node to the heavy mass.
    rest_lengths
        Of the links between [m].
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
    """Return the contact friction with which a polygon of corners ``bend`` [rad] obeys the capstan law of a circle.

    A massless chain that slides over a corner of angle b under Coulomb contact friction m has the tension ratio
    (1 + m tan(b/2)) / (1 - m tan(b/2)); setting that to exp(mu b) gives m = tanh(mu b / 2) / tan(b / 2).
    """
    return math.tanh(friction * bend / 2) / math.tan(bend / 2)


def polygon_radius(rod_radius: float, bend: Any) -> Any:
    """Return the radius [m] on which nodes must lie so that links bent by ``bend`` [rad] (float or array) wind up R per radian.

    A link of length h = R b turns the string by b where its nodes lie on the radius h / (2 sin(b/2)). The straight string then
    pivots about its last node from -b/2 to b/2, and its mean distance from the centre is then that times sin(b/2) / (b/2) = R.
    """
    return rod_radius * (bend / 2) / np.sin(bend / 2)


def point_on_string(parameters: Parameters, arc: float, node_radius: float) -> tuple[float, float]:
    """Return the point of the taut string at release that is ``arc`` [m] from the light mass, along the string.

    Its wound part lies on a circle of ``node_radius`` [m].
    """
    p = parameters
    wound_arc = arc - p.free_length
    if wound_arc < 0:
        return light_position(math, -wound_arc, p.release_angle, p.rod_radius)
    hanging_arc = wound_arc - p.rod_radius * p.release_angle
    if hanging_arc < 0:
        # Without free length this is a point on the nodes' circle; the angle follows from R, by which the string is wound
        return light_position(math, 0.0, p.release_angle - wound_arc / p.rod_radius, node_radius)
    return (p.rod_radius, -hanging_arc)
