"""The chain that PyBullet's multibody is created anew from: where its nodes lie, and when they are added and removed.

A straight part of the string is one long link. As the string slides or winds, nodes are added where it is about to touch the
rod, and removed where it has left it. A node on a straight part carries no lateral load, so adding or removing it there changes
no force; nodes that bear on the rod are moved by PyBullet alone.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from looping_pendulum.engines.chain import MIN_BEADS, MIN_STRAIGHT_LINKS, Point, next_bead_position, point_on_string
from looping_pendulum.engines.pybullet.links import ChainState, LinkSettings
from looping_pendulum.reference_ode.parameters import Parameters, Release


@dataclass(frozen=True, kw_only=True)
class RemadeSettings(LinkSettings):
    """Numerical settings of the chain that is created anew."""

    comes: float = 0.03
    """A node is added where the straight string would put it on the rod after sliding or winding by this many links."""
    goes: float = 0.08
    """The outermost node is removed when the string has moved by this many links since it left the rod.

    It exceeds `comes`, so that no node is added and removed in turn. A node that stays for longer oscillates across the string.
    """
    relative_inertia: float = 1e-2
    """Moment of inertia of a link over a node's mass times a link's length squared: small, but not singular."""
    look_interval: int = 2
    """Steps between two checks whether to add or remove a node; a test compares it with 1."""
    joint_motors: bool = False
    """Whether to leave on the motor that PyBullet puts in every joint."""


def nodes_at_release(
    parameters: Parameters, settings: LinkSettings, release_velocity: tuple[float, float, float]
) -> ChainState:
    """Return the chain along the string at release: masses exactly in place, nodes on the rod at their circle.

    Parameters
    ----------
    release_velocity
        Velocity of the light mass and upward velocity of the heavy mass [m/s]: vx, vy, heavy vy.
    """
    p, bend = parameters, settings.length_on_rod(parameters) / parameters.rod_radius
    circle = settings.node_circle(p)
    corners = max(round(p.release_angle / bend), 1)
    angles = 0.5 * p.release_angle + bend * (np.arange(corners + 1) - 0.5 * corners)
    vx, vy, heavy_v = release_velocity
    on_rod = np.stack([circle * np.cos(angles), circle * np.sin(angles)], axis=1)
    sliding = heavy_v * np.stack([-np.sin(angles), np.cos(angles)], axis=1)
    heavy, light = (p.rod_radius, -p.hanging_length), point_on_string(p, 0.0, circle)
    return ChainState(positions=np.vstack([heavy, on_rod, light]), velocities=np.vstack([[0.0, heavy_v], sliding, [vx, vy]]))


class NodeChanges:
    """Decides when nodes are added and removed, from where the straight string runs."""

    def __init__(self, parameters: Parameters, settings: RemadeSettings) -> None:
        self._parameters = parameters
        self._length = settings.length_on_rod(parameters)
        lift, circle = self._length**2 / parameters.rod_radius, settings.node_circle(parameters)
        self._adding_radius, self._removal_radius = circle + settings.comes * lift, circle + settings.goes * lift

    def margins(self, positions: Sequence[Point], nodes: int) -> tuple[float, ...]:
        """Return how far the straight string is from adding and from removing a node, on the heavy and on the light side [m].

        A negative distance means that the change is due; it is infinite for a removal while there are `MIN_BEADS` nodes only.

        Parameters
        ----------
        positions
            Of a chain with so many ``nodes`` [m]: all, or at least its three outermost ones on either side.
        """
        heavy, light, spare = positions[0], positions[-1], nodes > MIN_BEADS
        return (
            self._distance_to_adding(heavy, positions[1]),
            self._removal_radius - self._next_node_radius(positions[2], heavy) if spare else math.inf,
            self._distance_to_adding(light, positions[-2]),
            self._removal_radius - self._next_node_radius(positions[-3], light) if spare else math.inf,
        )

    def with_updated_nodes(self, chain: ChainState) -> ChainState:
        """Return the chain with nodes added where it is about to touch the rod, and removed where it has left it."""
        positions, first, last = chain.positions, 1, len(chain.positions) - 1
        while last - first > MIN_BEADS and self._next_node_radius(positions[last - 2], positions[-1]) > self._removal_radius:
            last -= 1
        while last - first > MIN_BEADS and self._next_node_radius(positions[first + 1], positions[0]) > self._removal_radius:
            first += 1
        kept = [0, *range(first, last), len(positions) - 1]
        updated = chain if len(kept) == len(positions) else _without_nodes(chain, kept, self._parameters)
        for _ in range(2):  # the light side, then the heavy one, turned round
            updated = self._with_added_nodes(updated)
            updated = ChainState(positions=updated.positions[::-1], velocities=updated.velocities[::-1])
        return updated

    def _with_added_nodes(self, chain: ChainState) -> ChainState:
        """Return the chain with the nodes that are due added before its last position."""
        positions, velocities = chain.positions, chain.velocities
        while self._distance_to_adding(positions[-1], positions[-2]) < 0:
            share = self._length / math.dist(positions[-1], positions[-2])
            positions, velocities = (
                np.insert(row, -1, row[-2] + share * (row[-1] - row[-2]), axis=0) for row in (positions, velocities)
            )
        return ChainState(positions=positions, velocities=velocities)

    def _distance_to_adding(self, mass: Point, node: Point) -> float:
        """Return how far the string is from adding a node between ``node`` and ``mass`` [m]; infinite without room for one."""
        if math.dist(mass, node) < MIN_STRAIGHT_LINKS * self._length:
            return math.inf
        return self._next_node_radius(node, mass) - self._adding_radius

    def _next_node_radius(self, node: Point, mass: Point) -> float:
        """Return the distance from the rod's centre [m] of the point a link away from ``node`` on the way to ``mass``."""
        return math.hypot(*next_bead_position(node, mass, self._length))


def _without_nodes(chain: ChainState, kept: list[int], parameters: Parameters) -> ChainState:
    """Return the chain with the nodes of indices ``kept`` only: those left out lie on the straight parts.

    Such a node oscillates across the line between its neighbours, and the masses feel it: they are nearer together than the
    string is long, and move apart at another speed than with a straight string. Both differences are shared between the masses
    in inverse proportion to them, as the string's pull would do: the string keeps its length, and gets its mean speed.
    """
    p = parameters
    heavy_share = 0.0 if p.release is Release.HELD else p.light_mass / (p.light_mass + p.heavy_mass)
    positions, velocities = chain.positions[kept], chain.velocities[kept].copy()
    along = (positions[-1] - positions[-2]) / math.dist(positions[-1], positions[-2])
    excess = float(chain.lengths.sum()) - float(ChainState(positions=positions, velocities=velocities).lengths.sum())
    moved = positions.copy()
    moved[-1] += (1 - heavy_share) * excess * along
    moved[0, 1] -= heavy_share * excess
    x, y = positions[1] - positions[0]
    heavy_mismatch = velocities[0, 1] - (velocities[1, 1] + velocities[1, 0] * x / y)
    light_mismatch = float((velocities[-1] - velocities[-2]) @ along)
    sliding = (1 - heavy_share) * heavy_mismatch + heavy_share * light_mismatch
    if p.release is not Release.HELD:
        velocities[1:-1] += sliding / p.rod_radius * np.stack([-positions[1:-1, 1], positions[1:-1, 0]], axis=1)
    velocities[-1] += float((velocities[-2] - velocities[-1]) @ along) * along
    return ChainState(positions=moved, velocities=velocities)
