"""The chain that is made anew in PyBullet: where its nodes lie, and when they come and go.

A straight part of the string is one long link. As the string slides or winds, nodes come where it is about to touch the rod,
and go where it has left it. A node on a straight part carries nothing sideways, so one that comes or goes there changes no
force; every node that bears on the rod is PyBullet's alone.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from looping_pendulum.engines.chain import LEAST_BEADS, LEAST_LENGTH, Place, next_place, point_on_string
from looping_pendulum.engines.pybullet.links import LinkPositions, LinkSettings
from looping_pendulum.reference_ode.parameters import Parameters, Release


@dataclass(frozen=True, kw_only=True)
class RemadeSettings(LinkSettings):
    """Numerics of the chain that is made anew."""

    comes: float = 0.03
    """A node comes where the straight string would put it on the rod after sliding or winding by this many links."""
    goes: float = 0.08
    """The outermost node goes when it has been off the rod for this many links; more than `comes`, so that none flickers.

    A node that is off the rod for longer swings like a bead on a string instrument."""
    relative_inertia: float = 1e-2
    """Moment of inertia of a link, in a node's mass times a link's length squared: small, but not singular."""
    look_interval: int = 2
    """Steps between two looks whether a node comes or goes; a test shows that it may be 1."""
    joint_motors: bool = False
    """Leave on the motor that PyBullet puts in every joint."""


def lay(parameters: Parameters, settings: LinkSettings, release_velocity: tuple[float, float, float]) -> LinkPositions:
    """Lay the chain along the string at release: masses exactly in place, nodes on the rod at their circle."""
    p, bend = parameters, settings.length_on_rod(parameters) / parameters.rod_radius
    circle = settings.node_circle(p)
    corners = max(round(p.release_angle / bend), 1)
    angles = 0.5 * p.release_angle + bend * (np.arange(corners + 1) - 0.5 * corners)
    vx, vy, heavy_v = release_velocity
    on_rod = np.stack([circle * np.cos(angles), circle * np.sin(angles)], axis=1)
    sliding = heavy_v * np.stack([-np.sin(angles), np.cos(angles)], axis=1)
    heavy, light = (p.rod_radius, -p.hanging_length), point_on_string(p, 0.0, circle)
    return LinkPositions(places=np.vstack([heavy, on_rod, light]), velocities=np.vstack([[0.0, heavy_v], sliding, [vx, vy]]))


class NodeChanges:
    """When nodes come and go, by where the straight string runs."""

    def __init__(self, parameters: Parameters, settings: RemadeSettings) -> None:
        self._parameters = parameters
        self._length = settings.length_on_rod(parameters)
        lift, circle = self._length**2 / parameters.rod_radius, settings.node_circle(parameters)
        self._comes, self._goes = circle + settings.comes * lift, circle + settings.goes * lift

    def margins(self, places: Sequence[Place], nodes: int) -> tuple[float, ...]:
        """How far the straight string is from where the next node comes or goes, on the heavy side and the light one [m].

        ``places`` are those of a chain with so many ``nodes``, or at least its three outermost ones on either side.
        """
        heavy, light, spare = places[0], places[-1], nodes > LEAST_BEADS
        return (
            self._room(heavy, places[1]),
            self._goes - self._height(places[2], heavy) if spare else math.inf,
            self._room(light, places[-2]),
            self._goes - self._height(places[-3], light) if spare else math.inf,
        )

    def seen_to(self, chain: LinkPositions) -> LinkPositions:
        """Return the chain with nodes added where it is about to touch the rod, and taken off where it has left it."""
        places, first, last = chain.places, 1, len(chain.places) - 1
        while last - first > LEAST_BEADS and self._height(places[last - 2], places[-1]) > self._goes:
            last -= 1
        while last - first > LEAST_BEADS and self._height(places[first + 1], places[0]) > self._goes:
            first += 1
        kept = [0, *range(first, last), len(places) - 1]
        found = chain if len(kept) == len(places) else _straightened(chain, kept, self._parameters)
        for _ in range(2):  # the light side, then the heavy one, turned round
            found = self._with_nodes(found)
            found = LinkPositions(places=found.places[::-1], velocities=found.velocities[::-1])
        return found

    def _with_nodes(self, chain: LinkPositions) -> LinkPositions:
        """Add nodes before the last place."""
        places, velocities = chain.places, chain.velocities
        while self._room(places[-1], places[-2]) < 0:
            share = self._length / math.dist(places[-1], places[-2])
            places, velocities = (
                np.insert(row, -1, row[-2] + share * (row[-1] - row[-2]), axis=0) for row in (places, velocities)
            )
        return LinkPositions(places=places, velocities=velocities)

    def _room(self, mass: Place, node: Place) -> float:
        """How far the string is from where a node would come between ``node`` and ``mass`` [m]; infinite: there is no room."""
        if math.dist(mass, node) < LEAST_LENGTH * self._length:
            return math.inf
        return self._height(node, mass) - self._comes

    def _height(self, node: Place, mass: Place) -> float:
        """Distance from the rod's centre [m] of the place a link from ``node`` on the way to ``mass``."""
        return math.hypot(*next_place(node, mass, self._length))


def _straightened(chain: LinkPositions, kept: list[int], parameters: Parameters) -> LinkPositions:
    """Take nodes off the straight parts.

    Such a node swings across the line between its neighbours, and the masses feel that swing: they are nearer together than the
    string is long, and part at another speed than a straight string's. Both differences go to the masses in inverse proportion
    to them, as the string's pull would share them out: the string keeps its length, and gets the mean speed of the swing.
    """
    p = parameters
    heavy_share = 0.0 if p.release is Release.HELD else p.light_mass / (p.light_mass + p.heavy_mass)
    places, velocities = chain.places[kept], chain.velocities[kept].copy()
    along = (places[-1] - places[-2]) / math.dist(places[-1], places[-2])
    excess = float(chain.lengths.sum()) - float(LinkPositions(places=places, velocities=velocities).lengths.sum())
    moved = places.copy()
    moved[-1] += (1 - heavy_share) * excess * along
    moved[0, 1] -= heavy_share * excess
    x, y = places[1] - places[0]
    heavy_mismatch = velocities[0, 1] - (velocities[1, 1] + velocities[1, 0] * x / y)
    light_mismatch = float((velocities[-1] - velocities[-2]) @ along)
    sliding = (1 - heavy_share) * heavy_mismatch + heavy_share * light_mismatch
    if p.release is not Release.HELD:
        velocities[1:-1] += sliding / p.rod_radius * np.stack([-places[1:-1, 1], places[1:-1, 0]], axis=1)
    velocities[-1] += float((velocities[-2] - velocities[-1]) @ along) * along
    return LinkPositions(places=moved, velocities=velocities)
