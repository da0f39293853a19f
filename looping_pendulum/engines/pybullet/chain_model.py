"""The chain that stands for the string in PyBullet: where its nodes lie, what friction they need, and when it is laid anew.

A straight part of the string is one long link. As the string slides or winds, nodes come where it is about to touch the rod,
and go where it has left it. A node on a straight part carries nothing sideways, so one that comes or goes there changes no
force; every node that bears on the rod is PyBullet's alone.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from looping_pendulum.engines.chain import point_on_string, polygon_friction, polygon_radius
from looping_pendulum.engines.pybullet.settings import WorldSettings
from looping_pendulum.errors import EngineError
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import Parameters, Release

Place = Sequence[float] | Array
"""x and y [m]."""
TURN_TO_HALT = math.pi / 2
"""How much further than at release the string is typically wound, averaged over a looping mass's way to its halt [rad]."""
MOST_BEND = 1.3
"""Largest bend at a node [rad]: friction at such corners no longer is that of a circle."""
LEAST_NODES = 2
"""Nodes that always stay."""
LEAST_LENGTH = 1.5
"""A straight part shorter than this gets no more nodes, in links."""


@dataclass(frozen=True, kw_only=True)
class LinkSettings(WorldSettings):
    """What variants of links between nodes set."""

    link_length: float
    """Length of a link that may come on the rod [m]; longer on a thick rod, see `least_bend`."""
    bead_mass_ratio: float
    """Mass of a node over the light mass. Stable below steps of about sqrt(its mass x link length / tension)."""
    least_bend: float = 0.2
    """Links are laid longer than asked for if they would turn by less than this on the rod [rad]: no need on a thick rod."""
    comes: float = 0.03
    """A node comes where the straight string would put it on the rod after sliding or winding by this many links."""
    goes: float = 0.08
    """The outermost node goes when it has been off the rod for this many links; more than `comes`, so that none flickers.

    A node that is off the rod for longer swings like a bead on a string instrument."""

    def length_on_rod(self, parameters: Parameters) -> float:
        """Length of a link on the rod [m].

        Raises
        ------
        EngineError
            If it would bend too far there.
        """
        radius = parameters.rod_radius
        if self.link_length > MOST_BEND * radius:
            raise EngineError(
                f"pybullet: links of {1e3 * self.link_length:.3g} mm cannot wrap a rod of radius {1e3 * radius:.3g} mm; "
                f"shorten link_length to {1e3 * MOST_BEND * radius:.2g} mm or less"
            )
        length = max(self.link_length, self.least_bend * radius)
        if parameters.release is Release.VERTICAL:
            # The wrap angle stays. Links that divide it come on and off the rod at the same moments, so that the ripple which a
            # passing node makes in the string's speed is the same at both ends, and the masses do not feel it.
            wound = radius * parameters.release_angle
            length = wound / math.ceil(wound / length)
        return length

    def node_circle(self, parameters: Parameters) -> float:
        """Distance of a node on the rod from the rod's centre [m]."""
        radius = parameters.rod_radius
        return float(polygon_radius(radius, self.length_on_rod(parameters) / radius)) if self.polygon else radius

    def friction(self, parameters: Parameters, wrap_angle: float, rod_radius: float) -> float:
        """Contact coefficient of nodes on a rod whose sphere has ``rod_radius`` [m].

        Friction acts where a node touches the rod, tension at the node: their lever arms differ by the node's radius.
        """
        p = parameters
        law = p.coefficients["kinetic_friction"]
        if self.polygon:
            law = contact_friction(law, self.length_on_rod(p) / p.rod_radius, wrap_angle)
        return law * self.node_circle(p) / rod_radius


def typical_wrap_angle(parameters: Parameters, turn: float = TURN_TO_HALT) -> float:
    """Wrap angle at which the polygon's mean friction is to be right [rad]; it changes little with it."""
    return parameters.release_angle + turn


def contact_friction(friction: float, bend: float, wrap_angle: float) -> float:
    """Contact friction with which a sliding polygon obeys the capstan law, on average over how its ends lie.

    `polygon_friction` is right for full corners. A corner of angle d makes ln(T2/T1) = 2 artanh(m tan(d/2)), which grows faster
    than d; and the first and last corner on the rod turn by anything from 0 to the full ``bend``, evenly as the string winds.
    So the wrap angle theta is theta / bend - 1 full corners and two such ends, and m solves
    (theta / bend - 1) f(bend) + 2 mean(f) = mu theta.
    """
    if friction == 0:
        return 0.0
    points, weights = np.polynomial.legendre.leggauss(16)
    tangents = np.tan(0.25 * bend * (points + 1))
    full = math.tan(bend / 2)

    def exponent(m: float) -> float:
        ends = float(weights @ np.arctanh(m * tangents)) * 2  # the weights add up to 2: both ends
        return (wrap_angle / bend - 1) * 2 * math.atanh(m * full) + ends

    lowest, highest = polygon_friction(friction, bend), (1 - 1e-12) / full
    return float(brentq(lambda m: exponent(m) - friction * wrap_angle, 0.5 * lowest, highest, xtol=1e-15))


@dataclass(frozen=True, kw_only=True)
class Laid:
    """The string at one moment: its ends and the nodes between, from the heavy mass to the light one."""

    places: Array
    """Shape (n, 2) [m]"""
    velocities: Array
    """Shape (n, 2) [m/s]"""

    @property
    def lengths(self) -> Array:
        """Of the links [m], shape (n - 1,)."""
        return np.asarray(np.hypot(*np.diff(self.places, axis=0).T))

    @property
    def directions(self) -> Array:
        """Of the links [rad], shape (n - 1,)."""
        x, y = np.diff(self.places, axis=0).T
        return np.asarray(np.arctan2(y, x))

    @property
    def turn_rates(self) -> Array:
        """Angular velocities of the links [rad/s], shape (n - 1,)."""
        (x, y), (vx, vy) = np.diff(self.places, axis=0).T, np.diff(self.velocities, axis=0).T
        return np.asarray((x * vy - y * vx) / (x * x + y * y))


def lay(parameters: Parameters, settings: LinkSettings, release_velocity: tuple[float, float, float]) -> Laid:
    """Lay the chain along the string at release: masses exactly in place, nodes on the rod at their circle."""
    p, bend = parameters, settings.length_on_rod(parameters) / parameters.rod_radius
    circle = settings.node_circle(p)
    corners = max(round(p.release_angle / bend), 1)
    angles = 0.5 * p.release_angle + bend * (np.arange(corners + 1) - 0.5 * corners)
    vx, vy, heavy_v = release_velocity
    on_rod = np.stack([circle * np.cos(angles), circle * np.sin(angles)], axis=1)
    sliding = heavy_v * np.stack([-np.sin(angles), np.cos(angles)], axis=1)
    heavy, light = (p.rod_radius, -p.hanging_length), point_on_string(p, 0.0, circle)
    return Laid(places=np.vstack([heavy, on_rod, light]), velocities=np.vstack([[0.0, heavy_v], sliding, [vx, vy]]))


class Watch:
    """When nodes come and go, by where the straight string runs."""

    def __init__(self, parameters: Parameters, settings: LinkSettings) -> None:
        self._parameters = parameters
        self._length = settings.length_on_rod(parameters)
        lift, circle = self._length**2 / parameters.rod_radius, settings.node_circle(parameters)
        self._comes, self._goes = circle + settings.comes * lift, circle + settings.goes * lift

    def margins(self, places: Sequence[Place], nodes: int) -> tuple[float, ...]:
        """How far the straight string is from where the next node comes or goes, on the heavy side and the light one [m].

        ``places`` are those of a chain with so many ``nodes``, or at least its three outermost ones on either side.
        """
        heavy, light, spare = places[0], places[-1], nodes > LEAST_NODES
        return (
            self._room(heavy, places[1]),
            self._goes - self._height(places[2], heavy) if spare else math.inf,
            self._room(light, places[-2]),
            self._goes - self._height(places[-3], light) if spare else math.inf,
        )

    def seen_to(self, chain: Laid) -> Laid:
        """Return the chain with nodes added where it is about to touch the rod, and taken off where it has left it."""
        places, first, last = chain.places, 1, len(chain.places) - 1
        while last - first > LEAST_NODES and self._height(places[last - 2], places[-1]) > self._goes:
            last -= 1
        while last - first > LEAST_NODES and self._height(places[first + 1], places[0]) > self._goes:
            first += 1
        kept = [0, *range(first, last), len(places) - 1]
        found = chain if len(kept) == len(places) else _straightened(chain, kept, self._parameters)
        for _ in range(2):  # the light side, then the heavy one, turned round
            found = self._with_nodes(found)
            found = Laid(places=found.places[::-1], velocities=found.velocities[::-1])
        return found

    def _with_nodes(self, chain: Laid) -> Laid:
        """Add nodes before the last place."""
        places, velocities = chain.places, chain.velocities
        while self._room(places[-1], places[-2]) < 0:
            share = self._length / math.dist(places[-1], places[-2])
            places, velocities = (
                np.insert(row, -1, row[-2] + share * (row[-1] - row[-2]), axis=0) for row in (places, velocities)
            )
        return Laid(places=places, velocities=velocities)

    def _room(self, mass: Place, node: Place) -> float:
        """How far the string is from where a node would come between ``node`` and ``mass`` [m]; infinite: there is no room."""
        if math.dist(mass, node) < LEAST_LENGTH * self._length:
            return math.inf
        return self._height(node, mass) - self._comes

    def _height(self, node: Place, mass: Place) -> float:
        """Distance from the rod's centre [m] of the place a link from ``node`` on the way to ``mass``."""
        share = self._length / math.dist(mass, node)
        return math.hypot(node[0] + share * (mass[0] - node[0]), node[1] + share * (mass[1] - node[1]))


def _straightened(chain: Laid, kept: list[int], parameters: Parameters) -> Laid:
    """Take nodes off the straight parts.

    Such a node swings across the line between its neighbours, and the masses feel that swing: they are nearer together than the
    string is long, and part at another speed than a straight string's. Both differences go to the masses in inverse proportion
    to them, as the string's pull would share them out: the string keeps its length, and gets the mean speed of the swing.
    """
    p = parameters
    heavy_share = 0.0 if p.release is Release.HELD else p.light_mass / (p.light_mass + p.heavy_mass)
    places, velocities = chain.places[kept], chain.velocities[kept].copy()
    along = (places[-1] - places[-2]) / math.dist(places[-1], places[-2])
    excess = float(chain.lengths.sum()) - float(Laid(places=places, velocities=velocities).lengths.sum())
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
    return Laid(places=moved, velocities=velocities)
