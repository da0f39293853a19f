"""Rigs of beads: they are added where the straight string is about to touch the rod, and removed behind it.

A bead on a straight part carries no lateral load, so adding or removing it there changes no force; beads that bear on the rod
are moved by the engine alone. An engine whose world can change while it runs gives that (`BeadWorld`), another one a model for
every number of beads (`RebuiltBeadRig`).
"""

from __future__ import annotations

import abc
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol

import numpy as np

from looping_pendulum.engines.chain import (
    BeadChainSettings,
    BeadCountRule,
    Point,
    SlipGauge,
    beads_at_release,
    next_bead_position,
    point_on_string,
    polygon_friction,
    polygon_radius,
)
from looping_pendulum.engines.protocol import TunedEngine
from looping_pendulum.reference_ode.cartesian import MassesAtRelease, Vector, cartesian_force, masses_at_release
from looping_pendulum.reference_ode.parameters import Parameters, Release
from looping_pendulum.scenarios.scenario import Scenario

MAX_SLACK_FRACTION = 1e-3
"""Largest fraction by which the ends of a straight part may be nearer than its string is long, for its beads to change.

Beyond it that part hangs slack, and its beads do not lie on the line to its mass.
"""


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


class PolygonCorrection:
    """What follows from settings with one switch for both corrections; a dataclass that derives from it has the fields."""

    bend: float
    """Angle between neighbouring links on the rod [rad]."""
    polygon: bool
    """Whether the rod's radius and coefficient are corrected for the polygon that the links are (`engines.chain`)."""

    def node_radius(self, rod_radius: float) -> float:
        """Return the distance of a bead on the rod from the rod's centre [m]."""
        return float(polygon_radius(rod_radius, self.bend)) if self.polygon else rod_radius

    def contact_friction(self, friction: float) -> float:
        """Return the contacts' coefficient for a string with the coefficient ``friction``."""
        return polygon_friction(friction, self.bend) if self.polygon else friction


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
        masses = masses_at_release(p)
        heavy_position = point_on_string(p, p.string_length, p.rod_radius)
        self._light = self._world.add_mass(masses.light_position, masses.light_velocity, p.light_mass)
        if self._is_held:
            self._heavy = self._world.add_held(heavy_position)
        else:
            self._heavy = self._world.add_mass(heavy_position, masses.heavy_velocity, p.heavy_mass)
        self._has_string = p.release is not Release.DROP
        if self._has_string:
            self._place_string(p, masses)

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

    def _place_string(self, p: Parameters, masses: MassesAtRelease) -> None:
        """Add the rod, and the string with the release's velocities."""
        s = self._settings
        node_radius = s.node_radius(p.rod_radius)
        self._rule = BeadCountRule(p.rod_radius, s.bend, node_radius)
        self._bead_mass = s.bead_mass_ratio * p.light_mass
        self._slip = SlipGauge()
        self._world.add_rod(node_radius - s.bead_radius, s.contact_friction(p.coefficients["kinetic_friction"]))
        positions, velocities = beads_at_release(p, masses, s.bend, node_radius)
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


LIGHT, HEAVY = 0, 1
"""Indices of the string's two ends."""

Row = list[float]
"""Values of all coordinates: x and y of the light mass and of every bead, light side first, then y of the heavy mass."""


class RebuiltBeadRig(abc.ABC):
    """The apparatus in an engine whose models cannot change: one for every number of beads, made when it is first needed."""

    _model: Any
    """The model in use."""
    _beads: int
    """Its number of beads."""

    def __init__(self, parameters: Parameters, settings: Any) -> None:
        p, s = parameters, settings
        self._parameters, self._settings = p, s
        self._node_radius = s.node_radius(p.rod_radius)
        self._rule = BeadCountRule(p.rod_radius, s.bend, self._node_radius)
        self._has_string, self._is_held = p.release is not Release.DROP, p.release is Release.HELD
        self._force = cartesian_force(p)
        self._models: dict[int, Any] = {}
        self._slip = SlipGauge()
        self._place_chain()

    @abc.abstractmethod
    def _build_model(self, beads: int) -> Any:
        """Build the model of ``beads`` beads."""

    @abc.abstractmethod
    def _rows(self) -> tuple[Row, ...]:
        """Return positions [m], velocities [m/s] and, where the solver starts from them, accelerations [m/s^2]."""

    @abc.abstractmethod
    def _is_slack(self, end: int, distance: float) -> bool:
        """Return whether the straight part at ``end`` hangs slack, whose ends are ``distance`` [m] apart."""

    @abc.abstractmethod
    def _advance_group(self) -> None:
        """Take a group of steps with the effects' forces."""

    def advance(self) -> None:
        """Advance by one sample interval, in groups of steps."""
        for _ in range(self._settings.groups_per_sample):
            if self._has_string:
                self._update_beads(LIGHT)
                self._update_beads(HEAVY)
            self._advance_group()

    def read(self) -> tuple[float, ...]:
        """Return positions [m], velocities [m/s], string stretch and slip [m]: `COLUMNS` without the time."""
        positions, velocities, *_ = self._rows()
        heavy = (self._parameters.rod_radius, positions[-1], 0.0, velocities[-1])
        return (*positions[:2], *velocities[:2], *heavy, *self._read_string(positions))

    def _place_chain(self) -> None:
        """Place the chain along the taut string, with the release's velocities."""
        masses = masses_at_release(self._parameters)
        beads = sliding = np.empty((0, 2))
        if self._has_string:
            beads, sliding = beads_at_release(self._parameters, masses, self._settings.bend, self._node_radius)
        self.lengths = self._distances([masses.light_position, *beads.tolist(), masses.heavy_position])
        positions = [*masses.light_position, *beads.ravel().tolist(), masses.heavy_position[1]]
        velocities = [*masses.light_velocity, *sliding.ravel().tolist(), masses.heavy_velocity[1]]
        self._use_model(len(beads), [positions, velocities, [0.0] * len(positions)])

    def _use_model(self, beads: int, rows: Sequence[Row]) -> None:
        """Continue with the model of ``beads`` beads, in the state that `_rows` shall return as ``rows``."""
        if beads not in self._models:
            self._models[beads] = self._build_model(beads)
        self._beads, self._model = beads, self._models[beads]

    @staticmethod
    def _distances(places: Sequence[Point]) -> list[float]:
        """Return the distances [m] between neighbours."""
        return [math.dist(a, b) for a, b in zip(places[:-1], places[1:], strict=True)]

    def _straight_index(self, end: int) -> int:
        """Return the index of the straight link at ``end``."""
        return 0 if end == LIGHT else self._beads

    def _mass_position(self, end: int, positions: Row) -> Row:
        """Return the position [m] of the mass at ``end``."""
        return positions[:2] if end == LIGHT else [self._parameters.rod_radius, positions[-1]]

    def _bead(self, row: Row, end: int, index: int) -> Row:
        """Return the x and y components in ``row`` of the bead that is number ``index`` from ``end``."""
        first = 2 + 2 * (index if end == LIGHT else self._beads - 1 - index)
        return row[first : first + 2]

    def _update_beads(self, end: int) -> None:
        """Add or remove a bead on the straight part at ``end``, if one is due."""
        positions = self._rows()[0]
        mass, outermost, following = self._mass_position(end, positions), *(self._bead(positions, end, i) for i in (0, 1))
        distance = math.dist(mass, outermost)
        if self._is_slack(end, distance):
            return
        rest_length = self.lengths[self._straight_index(end)]
        change = self._rule.bead_count_change(mass, outermost, following, rest_length, self._beads)
        if change > 0:
            self._add_bead(end, self._rule.link_length / distance)
        elif change < 0:
            self._remove_bead(end)

    def _add_bead(self, end: int, share: float) -> None:
        """Add a bead on the straight part at ``end``, a fraction ``share`` of the way from the outermost bead to the mass."""
        link, at = self._straight_index(end), 2 if end == LIGHT else 2 + 2 * self._beads
        rows = self._rows()
        heavy = ((self._parameters.rod_radius, rows[0][-1]), (0.0, rows[1][-1]), (0.0, 0.0))

        def with_bead(row: Row, heavy: Point) -> Row:
            # Position, velocity and acceleration of the new bead are all interpolated, so that the motion stays smooth
            mass_x, mass_y = row[:2] if end == LIGHT else heavy
            x, y = self._bead(row, end, 0)
            return [*row[:at], x + share * (mass_x - x), y + share * (mass_y - y), *row[at:]]

        rest, new = self.lengths[link] - self._rule.link_length, self._rule.link_length
        self.lengths[link : link + 1] = [rest, new] if end == LIGHT else [new, rest]
        self._use_model(self._beads + 1, [with_bead(*each) for each in zip(rows, heavy, strict=False)])

    def _remove_bead(self, end: int) -> None:
        """Remove the outermost bead at ``end``, so that its link becomes part of the straight string."""
        first = 2 if end == LIGHT else 2 * self._beads
        joined = slice(0, 2) if end == LIGHT else slice(self._beads - 1, self._beads + 1)
        self.lengths[joined] = [math.fsum(self.lengths[joined])]
        self._use_model(self._beads - 1, [row[:first] + row[first + 2 :] for row in self._rows()])

    def _read_string(self, positions: Row) -> Vector:
        """Return the string's stretch beyond its rest length (negative: it hangs slack) and its slip over the rod [m]."""
        if not self._has_string:
            return math.nan, math.nan
        places = [*zip(positions[:-1:2], positions[1:-1:2], strict=True), (self._parameters.rod_radius, positions[-1])]
        return math.fsum(self._distances(places)) - math.fsum(self.lengths), self._slip.read(places, self.lengths)


class BeadEngine(TunedEngine):
    """A chain of beads in an engine of games, whose world is all that differs from one to another."""

    variant = "chain"
    world: ClassVar[type[Any]]
    """Class of the engine's `BeadWorld`, called with parameters and settings."""
    settings: Any

    def build(self, scenario: Scenario) -> BeadRig:
        """Build the scenario's apparatus at the moment of release."""
        return BeadRig(scenario.parameters, self.settings, self.world(scenario.parameters, self.settings))
