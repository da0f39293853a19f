"""The rig of beads on a string, which every chain of beads shares; an engine gives it a world.

Beads are added where the straight string is about to touch the rod, and removed behind it. A bead on a straight part carries no
lateral load, so adding or removing it there changes no force; beads that bear on the rod are moved by the engine alone. A
world is either one of bodies and joints that come and go (`JointWorld`), or a model for every number of beads (`RebuiltWorld`).
"""

from __future__ import annotations

import abc
import math
from collections.abc import Sequence
from typing import Any, ClassVar

from looping_pendulum.engines.chain import BeadChainSettings, BeadRule, SlipGauge
from looping_pendulum.engines.protocol import TunedEngine
from looping_pendulum.reference_ode.cartesian import Vector, cartesian_force, masses_at_release
from looping_pendulum.reference_ode.parameters import Parameters, Release
from looping_pendulum.scenarios.scenario import Scenario

MAX_SLACK_FRACTION = 1e-3
"""Largest fraction by which the ends of a straight part may be nearer than its string is long, for its beads to change.

Beyond it that part hangs slack, and its beads do not lie on the line to its mass.
"""
LIGHT, HEAVY = 0, -1
"""The string's two ends: indices of the masses in the row of bodies, and of the straight parts in the row of links."""
OUTERMOST = {LIGHT: 1, HEAVY: -2}
"""End -> index of the bead next to its mass."""
FOLLOWING = {LIGHT: 2, HEAVY: -3}
"""End -> index of the bead after that."""

Forces = tuple[Vector, float]
"""Force on the light mass [N], and the upward one on the heavy mass [N]."""


class BeadWorld(abc.ABC):
    """An engine's world in SI units: light mass, beads and heavy mass in a row, and links between neighbours.

    Only beads touch the rod, and bodies do not turn. The first and the last link are the straight parts of the string, which
    only pull. An index counts bodies from the light mass; a negative one counts from the heavy mass.
    """

    rule: ClassVar[type[BeadRule]] = BeadRule
    """Class of the rule by which beads are added and removed."""

    def __init__(self, parameters: Parameters, settings: Any) -> None:
        self._parameters, self._settings = parameters, settings
        self._has_string = parameters.release is not Release.DROP
        self._is_held = parameters.release is Release.HELD
        self.lengths: list[float] = []
        """Rest lengths of the links [m], from the light mass on; empty without a string."""

    @abc.abstractmethod
    def place(self, positions: Sequence[Vector], velocities: Sequence[Vector]) -> None:
        """Create the bodies at ``positions`` [m] with ``velocities`` [m/s], the links, which are as long, and the rod."""

    @abc.abstractmethod
    def position(self, index: int) -> Vector:
        """Return the position [m] of a body."""

    @abc.abstractmethod
    def velocity(self, index: int) -> Vector:
        """Return the velocity [m/s] of a body."""

    @abc.abstractmethod
    def positions(self) -> Sequence[Vector]:
        """Return the positions [m] of all bodies."""

    @abc.abstractmethod
    def step(self, count: int, forces: Forces | None) -> None:
        """Take ``count`` steps, during which these ``forces`` act on the masses."""

    def is_slack(self, end: int) -> bool:
        """Return whether the straight part at ``end`` hangs slack."""
        distance = math.dist(self.position(end), self.position(OUTERMOST[end]))
        return distance < (1 - MAX_SLACK_FRACTION) * self.lengths[end]

    def add_bead(self, end: int, link_length: float) -> None:
        """Add a bead on the straight part at ``end``, ``link_length`` [m] from the outermost bead."""
        rest = self.lengths[end] - link_length
        if end == LIGHT:
            self.lengths[:1] = [rest, link_length]
        else:
            self.lengths[-1:] = [link_length, rest]
        self._insert(end, link_length / math.dist(self.position(end), self.position(OUTERMOST[end])))

    def remove_bead(self, end: int) -> None:
        """Remove the outermost bead at ``end``, so that its link becomes part of the straight string."""
        joined = slice(0, 2) if end == LIGHT else slice(-2, None)
        self.lengths[joined] = [math.fsum(self.lengths[joined])]
        self._delete(end)

    @abc.abstractmethod
    def _insert(self, end: int, share: float) -> None:
        """Insert a bead at ``end``, a fraction ``share`` of the way from the outermost bead to the mass; `lengths` has it."""

    @abc.abstractmethod
    def _delete(self, end: int) -> None:
        """Delete the outermost bead at ``end``, whose link `lengths` has no more."""


def between(a: Vector, b: Vector, share: float) -> Vector:
    """Return the vector a fraction ``share`` of the way from ``a`` to ``b``."""
    return a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])


def distances(positions: Sequence[Vector]) -> list[float]:
    """Return the distances [m] between neighbours."""
    return [math.dist(a, b) for a, b in zip(positions[:-1], positions[1:], strict=True)]


class JointWorld(BeadWorld):
    """A world of bodies and joints, which can be added and removed while it runs."""

    @abc.abstractmethod
    def add_rod(self, radius: float, friction: float) -> None:
        """Add a fixed circle of ``radius`` [m] at the origin, and let beads have the ``friction`` on it."""

    @abc.abstractmethod
    def create_bead(self, position: Vector, velocity: Vector, mass: float) -> Any:
        """Return a new bead of ``mass`` [kg]."""

    @abc.abstractmethod
    def create_mass(self, position: Vector, velocity: Vector, mass: float) -> Any:
        """Return a new body of ``mass`` [kg] that touches nothing."""

    @abc.abstractmethod
    def create_held(self, position: Vector) -> Any:
        """Return a new body that is held at ``position`` [m]."""

    @abc.abstractmethod
    def create_link(self, a: Any, b: Any, length: float) -> Any:
        """Return a new joint of ``length`` [m] between neighbouring beads."""

    @abc.abstractmethod
    def create_straight(self, a: Any, b: Any, length: float) -> Any:
        """Return a new joint for a straight part of the string, of ``length`` [m], which only pulls."""

    @abc.abstractmethod
    def remove_joint(self, joint: Any) -> None:
        """Remove a link or a straight part."""

    @abc.abstractmethod
    def remove_body(self, bead: Any) -> None:
        """Remove a bead that no joint joins any more."""

    @abc.abstractmethod
    def position_of(self, body: Any) -> Vector:
        """Return the position [m] of ``body``."""

    @abc.abstractmethod
    def velocity_of(self, body: Any) -> Vector:
        """Return the velocity [m/s] of ``body``."""

    @abc.abstractmethod
    def advance(self, count: int, forces: Sequence[tuple[Any, Vector]]) -> None:
        """Take ``count`` steps, during which these ``forces`` [N] act on bodies."""

    def place(self, positions: Sequence[Vector], velocities: Sequence[Vector]) -> None:
        """Create the bodies at ``positions`` [m] with ``velocities`` [m/s], the links, which are as long, and the rod."""
        p, s = self._parameters, self._settings
        light = self.create_mass(positions[LIGHT], velocities[LIGHT], p.light_mass)
        if self._is_held:
            heavy = self.create_held(positions[HEAVY])
        else:
            heavy = self.create_mass(positions[HEAVY], velocities[HEAVY], p.heavy_mass)
        self._bodies, self._joints = [light, heavy], []
        if not self._has_string:
            return
        self._bead_mass = s.bead_mass_ratio * p.light_mass
        self.add_rod(s.node_radius(p.rod_radius) - s.bead_radius, s.contact_friction(p.coefficients["kinetic_friction"]))
        self._bodies[1:1] = [
            self.create_bead(position, velocity, self._bead_mass)
            for position, velocity in zip(positions[1:-1], velocities[1:-1], strict=True)
        ]
        # As the engine has them, which may round
        self.lengths = distances(self.positions())
        last = len(self.lengths) - 1
        for i, (a, b, length) in enumerate(zip(self._bodies[:-1], self._bodies[1:], self.lengths, strict=True)):
            self._joints.append((self.create_straight if i in (0, last) else self.create_link)(a, b, length))

    def position(self, index: int) -> Vector:
        """Return the position [m] of a body."""
        return self.position_of(self._bodies[index])

    def velocity(self, index: int) -> Vector:
        """Return the velocity [m/s] of a body."""
        return self.velocity_of(self._bodies[index])

    def positions(self) -> Sequence[Vector]:
        """Return the positions [m] of all bodies."""
        return [self.position_of(body) for body in self._bodies]

    def step(self, count: int, forces: Forces | None) -> None:
        """Take ``count`` steps, during which these ``forces`` act on the masses."""
        applied: list[tuple[Any, Vector]] = []
        if forces is not None:
            applied.append((self._bodies[LIGHT], forces[0]))
            if not self._is_held:
                applied.append((self._bodies[HEAVY], (0.0, forces[1])))
        self.advance(count, applied)

    def _insert(self, end: int, share: float) -> None:
        mass, outermost = self._bodies[end], self._bodies[OUTERMOST[end]]
        position = between(self.position_of(outermost), self.position_of(mass), share)
        velocity = between(self.velocity_of(outermost), self.velocity_of(mass), share)
        bead = self.create_bead(position, velocity, self._bead_mass)
        self.remove_joint(self._joints.pop(end))
        straight = self.create_straight(mass, bead, self.lengths[end])
        link = self.create_link(bead, outermost, self.lengths[OUTERMOST[end]])
        if end == LIGHT:
            self._bodies.insert(1, bead)
            self._joints[:0] = [straight, link]
        else:
            self._bodies.insert(-1, bead)
            self._joints += [link, straight]

    def _delete(self, end: int) -> None:
        for _ in range(2):
            self.remove_joint(self._joints.pop(end))
        self.remove_body(self._bodies.pop(OUTERMOST[end]))
        straight = self.create_straight(self._bodies[end], self._bodies[OUTERMOST[end]], self.lengths[end])
        self._joints.insert(0 if end == LIGHT else len(self._joints), straight)


class RebuiltWorld(BeadWorld):
    """A world of an engine whose models cannot change: one for every number of beads, made when it is first needed.

    A model's coordinates are x and y of the light mass and of every bead, then y of the heavy mass unless that is held.
    """

    _model: Any
    """The model in use."""

    @abc.abstractmethod
    def _build_model(self, beads: int) -> Any:
        """Return the model of ``beads`` beads."""

    @abc.abstractmethod
    def _start_model(self) -> None:
        """Give the model in use the state `_rows` and the `lengths`."""

    @abc.abstractmethod
    def _advance_model(self, count: int, forces: Forces | None) -> None:
        """Take ``count`` steps of the model in use with these ``forces``."""

    @abc.abstractmethod
    def _coordinates(self) -> Sequence[list[float]]:
        """Return the model's coordinates [m], their velocities and, where the solver starts from them, accelerations."""

    def place(self, positions: Sequence[Vector], velocities: Sequence[Vector]) -> None:
        """Create the bodies at ``positions`` [m] with ``velocities`` [m/s], the links, which are as long, and the rod."""
        self._models: dict[int, Any] = {}
        self._rows = [list(positions), list(velocities), [(0.0, 0.0)] * len(positions)]
        if self._has_string:
            self.lengths = distances(positions)
        self._use_model()

    def position(self, index: int) -> Vector:
        """Return the position [m] of a body."""
        return self._rows[0][index]

    def velocity(self, index: int) -> Vector:
        """Return the velocity [m/s] of a body."""
        return self._rows[1][index]

    def positions(self) -> Sequence[Vector]:
        """Return the positions [m] of all bodies."""
        return self._rows[0]

    def step(self, count: int, forces: Forces | None) -> None:
        """Take ``count`` steps, during which these ``forces`` act on the masses."""
        self._advance_model(count, forces)
        p = self._parameters
        heavy_rest = ((p.rod_radius, -p.hanging_length), (0.0, 0.0), (0.0, 0.0))
        self._rows = []
        for values, (x, held_y) in zip(self._coordinates(), heavy_rest, strict=False):
            heavy = (x, held_y if self._is_held else values[-1])
            self._rows.append([*zip(values[:-1:2], values[1::2], strict=False), heavy])

    def _flat(self, row: Sequence[Vector]) -> list[float]:
        """Return the components of ``row`` in the order of the model's coordinates."""
        values = [component for vector in row[:-1] for component in vector]
        return values if self._is_held else [*values, row[-1][1]]

    def _insert(self, end: int, share: float) -> None:
        # Velocities and accelerations are interpolated, too, so that the motion stays smooth
        for row in self._rows:
            row.insert(1 if end == LIGHT else -1, between(row[OUTERMOST[end]], row[end], share))
        self._use_model()

    def _delete(self, end: int) -> None:
        for row in self._rows:
            del row[OUTERMOST[end]]
        self._use_model()

    def _use_model(self) -> None:
        """Continue with the model for the present number of beads."""
        beads = len(self._rows[0]) - 2
        if beads not in self._models:
            self._models[beads] = self._build_model(beads)
        self._model = self._models[beads]
        self._start_model()


class BeadRig:
    """The apparatus in a world, to which it adds and from which it removes beads."""

    def __init__(self, parameters: Parameters, settings: BeadChainSettings, world: BeadWorld) -> None:
        p, s = parameters, settings
        self._settings, self._world = s, world
        self._force = cartesian_force(p)
        self._groups = 0
        self._has_string = p.release is not Release.DROP
        masses = masses_at_release(p)
        beads: list[Vector] = []
        sliding: list[Vector] = []
        if self._has_string:
            self._rule = world.rule(p, s)
            self._slip = SlipGauge()
            beads, sliding = self._rule.beads_at_release(masses)
        world.place(
            [masses.light_position, *beads, masses.heavy_position], [masses.light_velocity, *sliding, masses.heavy_velocity]
        )

    def advance(self) -> None:
        """Advance by one sample interval, in groups of steps."""
        for _ in range(self._settings.groups_per_sample):
            if self._has_string:
                self._update_beads(LIGHT)
                self._update_beads(HEAVY)
            self._world.step(self._settings.steps_per_group, self._effect_forces())
            self._groups += 1

    def read(self) -> tuple[float, ...]:
        """Return positions [m], velocities [m/s], string stretch and slip [m]: `COLUMNS` without the time."""
        world = self._world
        light, heavy = ((*world.position(end), *world.velocity(end)) for end in (LIGHT, HEAVY))
        return (*light, *heavy, *self._read_string())

    def _effect_forces(self) -> Forces | None:
        """Return the effects' forces, None without any."""
        if self._force is None:
            return None
        world, time = self._world, self._groups * self._settings.group_time
        fx, fy, heavy_fy = self._force(time, *world.position(LIGHT), *world.velocity(LIGHT), world.velocity(HEAVY)[1])
        return (fx, fy), heavy_fy

    def _update_beads(self, end: int) -> None:
        """Add or remove a bead on the straight part at ``end``, if one is due."""
        world = self._world
        mass, outermost, following = (world.position(i) for i in (end, OUTERMOST[end], FOLLOWING[end]))
        change = self._rule.bead_count_change(mass, outermost, following, world.lengths[end], len(world.lengths) - 1)
        if change == 0 or world.is_slack(end):
            return
        if change > 0:
            world.add_bead(end, self._rule.link_length)
        else:
            world.remove_bead(end)

    def _read_string(self) -> Vector:
        """Return the string's stretch beyond its rest length (negative: it hangs slack) and its slip over the rod [m]."""
        if not self._has_string:
            return math.nan, math.nan
        places, lengths = self._world.positions(), self._world.lengths
        return math.fsum(distances(places)) - math.fsum(lengths), self._slip.read(places, lengths)


class BeadEngine(TunedEngine):
    """A chain of beads, whose world is all that differs from one engine to another."""

    variant = "chain"
    world: ClassVar[type[Any]]
    """Class of the engine's `BeadWorld`, called with parameters and settings."""
    settings: Any

    def build(self, scenario: Scenario) -> BeadRig:
        """Build the scenario's apparatus at the moment of release."""
        return BeadRig(scenario.parameters, self.settings, self.world(scenario.parameters, self.settings))
