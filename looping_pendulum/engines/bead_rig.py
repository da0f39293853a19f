"""A rig for engines of games: beads are added where the straight string is about to touch the rod, and removed behind it.

A bead on a straight part carries no lateral load, so adding or removing it there changes no force; beads that bear on the rod
are moved by the engine alone. Each engine gives its world (`BeadWorld`), and has settings of its own (`BeadRigSettings`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol

from looping_pendulum.engines.chain import (
    BeadChainSettings,
    BeadCountRule,
    SlipGauge,
    beads_at_release,
    next_bead_position,
    point_on_string,
    polygon_friction,
    polygon_radius,
)
from looping_pendulum.engines.protocol import TunedEngine
from looping_pendulum.reference_ode.cartesian import cartesian_force, release_velocity
from looping_pendulum.reference_ode.parameters import Parameters, Release
from looping_pendulum.scenarios.scenario import Scenario

MAX_SLACK_FRACTION = 1e-3
"""Largest fraction by which the ends of a straight part may be nearer than its string is long, for its beads to change.

Beyond it that part hangs slack, and its beads do not lie on the line to its mass.
"""


Vector = tuple[float, float]
"""x and y components, in the unit of the quantity."""


@dataclass(frozen=True, kw_only=True)
class BeadRigSettings(BeadChainSettings):
    """Numerical settings of a bead chain that this rig builds, in SI units."""

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


class BeadWorld(Protocol):
    """An engine's world in SI units, in which only beads and the rod touch each other, and bodies do not turn."""

    def add_rod(self, radius: float, friction: float) -> None:
        """Add a fixed circle of ``radius`` [m] at the origin, and let beads have the ``friction`` on it."""

    def add_bead(self, position: Vector, velocity: Vector, mass: float) -> Any:
        """Add a bead of ``mass`` [kg]."""

    def add_mass(self, position: Vector, velocity: Vector, mass: float) -> Any:
        """Add a body of ``mass`` [kg] that touches nothing."""

    def add_held(self, position: Vector) -> Any:
        """Add a body that is held at ``position`` [m]."""

    def add_link(self, a: Any, b: Any, length: float) -> Any:
        """Join two bodies by a link of ``length`` [m] between neighbouring beads."""

    def add_straight(self, a: Any, b: Any, length: float) -> Any:
        """Join two bodies by a straight part of the string, of ``length`` [m], which only pulls."""

    def remove_link(self, link: Any) -> None:
        """Remove a link or a straight part."""

    def remove_bead(self, bead: Any) -> None:
        """Remove a bead that no link joins any more."""

    def step(self, count: int, forces: Sequence[tuple[Any, Vector]]) -> None:
        """Take ``count`` steps, during which these ``forces`` [N] act on bodies."""

    def position(self, body: Any) -> Vector:
        """Return the position [m] of ``body``."""

    def velocity(self, body: Any) -> Vector:
        """Return the velocity [m/s] of ``body``."""


class BeadRig:
    """The apparatus in one world."""

    def __init__(self, parameters: Parameters, settings: BeadRigSettings, world: BeadWorld) -> None:
        p = parameters
        self._settings, self._world = settings, world
        self._force = cartesian_force(p)
        self._is_held = p.release is Release.HELD
        self._groups = 0
        vx, vy, heavy_vy = release_velocity(p)
        light_position = point_on_string(p, 0.0, p.rod_radius)
        heavy_position = point_on_string(p, p.string_length, p.rod_radius)
        self._light = self._world.add_mass(light_position, (vx, vy), p.light_mass)
        if self._is_held:
            self._heavy = self._world.add_held(heavy_position)
        else:
            self._heavy = self._world.add_mass(heavy_position, (0.0, heavy_vy), p.heavy_mass)
        self._has_string = p.release is not Release.DROP
        if self._has_string:
            self._place_string(p)

    def advance(self) -> None:
        """Advance by one sample interval."""
        for _ in range(self._settings.groups_per_sample):
            if self._has_string:
                self._update_beads()
            self._world.step(self._settings.steps_per_group, self._effect_forces())
            self._groups += 1

    def read(self) -> tuple[float, ...]:
        """Return positions [m], velocities [m/s], string stretch and slip [m]: `COLUMNS` without the time."""
        world, light, heavy = self._world, self._light, self._heavy
        masses = (*world.position(light), *world.velocity(light), *world.position(heavy), *world.velocity(heavy))
        return (*masses, *self._read_string())

    def _place_string(self, p: Parameters) -> None:
        """Add the rod, and the string with the release's velocities."""
        s = self._settings
        node_radius = s.node_radius(p.rod_radius)
        self._rule = BeadCountRule(p.rod_radius, s.bend, node_radius)
        self._bead_mass = s.bead_mass_ratio * p.light_mass
        self._slip = SlipGauge()
        self._world.add_rod(node_radius - s.bead_radius, s.contact_friction(p.coefficients["kinetic_friction"]))
        positions, velocities = beads_at_release(p, s.bend, node_radius)
        beads = [
            self._world.add_bead((x, y), (vx, vy), self._bead_mass)
            for (x, y), (vx, vy) in zip(positions.tolist(), velocities.tolist(), strict=True)
        ]
        self._bodies = [self._light, *beads, self._heavy]
        places = [self._world.position(body) for body in self._bodies]
        self._lengths = [math.dist(a, b) for a, b in zip(places[:-1], places[1:], strict=True)]
        last = len(self._lengths) - 1
        self._links = [self._join(i, straight=i in (0, last)) for i in range(last + 1)]

    def _join(self, index: int, *, straight: bool) -> Any:
        """Return a new joint for link ``index``."""
        add = self._world.add_straight if straight else self._world.add_link
        return add(self._bodies[index], self._bodies[index + 1], self._lengths[index])

    def _effect_forces(self) -> list[tuple[Any, Vector]]:
        """Return the effects' forces [N] on the masses that can move."""
        if self._force is None:
            return []
        time = self._groups * self._settings.group_time
        light, heavy_vy = self._light, self._world.velocity(self._heavy)[1]
        fx, fy, heavy_fy = self._force(time, *self._world.position(light), *self._world.velocity(light), heavy_vy)
        forces = [(light, (fx, fy))]
        return forces if self._is_held else [*forces, (self._heavy, (0.0, heavy_fy))]

    def _update_beads(self) -> None:
        """Add or remove a bead on either straight part, if one is due."""
        self._update_first_end()
        # The same, counted from the other end
        self._reverse()
        self._update_first_end()
        self._reverse()

    def _reverse(self) -> None:
        """Reverse the row, so that one method serves both ends."""
        for row in (self._bodies, self._links, self._lengths):
            row.reverse()

    def _update_first_end(self) -> None:
        """Add or remove a bead on the straight part at the row's first end, if one is due."""
        mass, outermost, following = (self._world.position(body) for body in self._bodies[:3])
        rest = self._lengths[0]
        change = self._rule.bead_count_change(mass, outermost, following, rest, len(self._bodies) - 2)
        if change == 0 or math.dist(mass, outermost) < (1 - MAX_SLACK_FRACTION) * rest:
            return
        if change > 0:
            self._add_bead(mass, outermost)
        else:
            self._remove_bead()

    def _add_bead(self, mass: Vector, outermost: Vector) -> None:
        """Add a bead on the straight part at the first end, a link from the outermost one."""
        link_length = self._rule.link_length
        share = link_length / math.dist(mass, outermost)
        (vx, vy), (mass_vx, mass_vy) = self._world.velocity(self._bodies[1]), self._world.velocity(self._bodies[0])
        velocity = vx + share * (mass_vx - vx), vy + share * (mass_vy - vy)
        bead = self._world.add_bead(next_bead_position(outermost, mass, link_length), velocity, self._bead_mass)
        self._world.remove_link(self._links[0])
        self._bodies.insert(1, bead)
        self._lengths[0:1] = [self._lengths[0] - link_length, link_length]
        self._links[0:1] = [self._join(0, straight=True), self._join(1, straight=False)]

    def _remove_bead(self) -> None:
        """Remove the outermost bead at the first end, so that its link becomes part of the straight string."""
        for link in self._links[:2]:
            self._world.remove_link(link)
        self._world.remove_bead(self._bodies.pop(1))
        self._lengths[0:2] = [math.fsum(self._lengths[:2])]
        self._links[0:2] = [self._join(0, straight=True)]

    def _read_string(self) -> Vector:
        """Return the string's stretch beyond its rest length (negative: it hangs slack) and its slip over the rod [m]."""
        if not self._has_string:
            return math.nan, math.nan
        places = [self._world.position(body) for body in self._bodies]
        stretch = math.fsum(map(math.dist, places[:-1], places[1:])) - math.fsum(self._lengths)
        return stretch, self._slip.read(places, self._lengths)


class BeadEngine(TunedEngine):
    """A chain of beads in an engine of games, whose world is all that differs from one to another."""

    variant = "chain"
    world: ClassVar[type[Any]]
    """Class of the engine's `BeadWorld`, called with parameters and settings."""
    settings: Any

    def build(self, scenario: Scenario) -> BeadRig:
        """Build the scenario's apparatus at the moment of release."""
        return BeadRig(scenario.parameters, self.settings, self.world(scenario.parameters, self.settings))
