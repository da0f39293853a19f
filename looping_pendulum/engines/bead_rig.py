"""The rig of beads on a string, which every chain of beads shares; an engine gives it bodies and links.

Beads are added where the straight string is about to touch the rod, and removed behind it. A bead on a straight part carries no
lateral load, so adding or removing it there changes no force; beads that bear on the rod are moved by the engine alone. An
engine has either bodies and joints that come and go (`JointRig`), or a model for every number of beads (`RebuiltRig`).
"""

from __future__ import annotations

import abc
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from looping_pendulum.engines.chain import hanging_rest_length
from looping_pendulum.reference_ode.cartesian import MassesAtRelease, Vector, cartesian_force, masses_at_release
from looping_pendulum.reference_ode.parameters import Parameters, Release

ADD_THRESHOLD = 0.2
"""A bead is added when its position on the straight string is this near to the rod's polygon, in units of R bend^2.

In these units the position approaches the polygon by 1 while the string is wound, or slides, by one link.
"""
REMOVE_THRESHOLD = 0.5
"""The outermost bead is removed when the string without it would pass the polygon at this distance, in units of R bend^2.

It is larger than `ADD_THRESHOLD`, so that no bead is added and removed in turn.
"""
MIN_BEADS = 2
"""Number of beads that always remain."""
MIN_STRAIGHT_LINKS = 1.5
"""Length, in links, below which a straight part of the string gets no more beads."""
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


class BeadRig(abc.ABC):
    """The apparatus in SI units: light mass, beads and heavy mass in a row, and links between neighbours.

    Only beads touch the rod, and bodies do not turn. The first and the last link are the straight parts of the string, which
    only pull. An index counts bodies from the light mass; a negative one counts from the heavy mass.
    """

    def __init__(self, parameters: Parameters, settings: Any) -> None:
        p, s = self._parameters, self._settings = parameters, settings
        self._has_string = p.release is not Release.DROP
        self._is_held = p.release is Release.HELD
        self._force = cartesian_force(p)
        self._groups = 0
        self._link_length, self._node_radius = p.rod_radius * s.bend, s.node_radius(p.rod_radius)
        unit = p.rod_radius * s.bend**2
        # Squares, so that the rule, which is asked many times per sample, takes no roots
        add_below, remove_above = (self._node_radius + n * unit for n in (ADD_THRESHOLD, REMOVE_THRESHOLD))
        self._add_below, self._remove_above = add_below**2, remove_above**2
        self._lengths: list[float] = []
        """Rest lengths of the links [m], from the light mass on; empty without a string."""
        self._create_world()
        masses = masses_at_release(p)
        beads, sliding = self._beads_at_release(masses) if self._has_string else ([], [])
        self._place(
            [masses.light_position, *beads, masses.heavy_position], [masses.light_velocity, *sliding, masses.heavy_velocity]
        )

    @abc.abstractmethod
    def _create_world(self) -> None:
        """Prepare the engine, before the bodies come."""

    @abc.abstractmethod
    def _place(self, positions: Sequence[Vector], velocities: Sequence[Vector]) -> None:
        """Create the bodies at ``positions`` [m] with ``velocities`` [m/s], the links, which are as long, and the rod."""

    @abc.abstractmethod
    def _position(self, index: int) -> Vector:
        """Return the position [m] of a body."""

    @abc.abstractmethod
    def _velocity(self, index: int) -> Vector:
        """Return the velocity [m/s] of a body."""

    @abc.abstractmethod
    def _step(self, count: int, forces: Forces | None) -> None:
        """Take ``count`` steps, during which these ``forces`` act on the masses."""

    @abc.abstractmethod
    def _insert(self, end: int, share: float) -> None:
        """Insert a bead at ``end``, a fraction ``share`` of the way from the outermost bead to the mass; `_lengths` has it."""

    @abc.abstractmethod
    def _delete(self, end: int) -> None:
        """Delete the outermost bead at ``end``, whose link `_lengths` has no more."""

    def advance(self) -> None:
        """Advance by one sample interval, in groups of steps."""
        for _ in range(self._settings.groups_per_sample):
            if self._has_string:
                self._update_beads(LIGHT)
                self._update_beads(HEAVY)
            self._step(self._settings.steps_per_group, self._effect_forces())
            self._groups += 1

    def read(self) -> tuple[float, ...]:
        """Return positions [m], velocities [m/s], string stretch and slip [m]: `COLUMNS` without the time."""
        light, heavy = ((*self._position(end), *self._velocity(end)) for end in (LIGHT, HEAVY))
        return (*light, *heavy, *self._read_string())

    def _read_string(self) -> Vector:
        """Return the string's stretch beyond its rest length (negative: it hangs slack) and its slip over the rod [m]."""
        if not self._has_string:
            return math.nan, math.nan
        places = [self._position(i) for i in range(len(self._lengths) + 1)]
        return math.fsum(distances(places)) - math.fsum(self._lengths), hanging_rest_length(places, self._lengths)

    def _effect_forces(self) -> Forces | None:
        """Return the effects' forces, None without any."""
        if self._force is None:
            return None
        time = self._groups * self._settings.group_time
        fx, fy, heavy_fy = self._force(time, *self._position(LIGHT), *self._velocity(LIGHT), self._velocity(HEAVY)[1])
        return (fx, fy), heavy_fy

    def _beads_at_release(self, masses: MassesAtRelease) -> tuple[list[Vector], list[Vector]]:
        """Return positions [m] and velocities [m/s] of the beads on the rod at release, light side first.

        The outermost beads lie within half a link of their tangent points, on either side of them.
        """
        angle, bend = self._parameters.release_angle, self._settings.bend
        count = max(round(angle / bend) + 1, MIN_BEADS)
        first = angle - 0.5 * (angle - (count - 1) * bend)
        angles = first - bend * np.arange(count)
        outwards = np.stack([np.cos(angles), np.sin(angles)], axis=1)
        sliding = masses.heavy_velocity[1] * np.stack([-outwards[:, 1], outwards[:, 0]], axis=1)
        return [(x, y) for x, y in (self._node_radius * outwards).tolist()], [(vx, vy) for vx, vy in sliding.tolist()]

    def _update_beads(self, end: int) -> None:
        """Add or remove a bead on the straight part at ``end``, if one is due."""
        change = self._bead_count_change(end)
        if change == 0 or self._is_slack(end):
            return
        if change > 0:
            link = self._link_length
            rest = self._lengths[end] - link
            if end == LIGHT:
                self._lengths[:1] = [rest, link]
            else:
                self._lengths[-1:] = [link, rest]
            self._insert(end, link / math.dist(self._position(end), self._position(OUTERMOST[end])))
        else:
            # Its link becomes part of the straight string
            joined = slice(0, 2) if end == LIGHT else slice(-2, None)
            self._lengths[joined] = [math.fsum(self._lengths[joined])]
            self._delete(end)

    def _bead_count_change(self, end: int) -> int:
        """Return 1 to add a bead on the straight part at ``end``, -1 to remove the outermost one, 0 to change nothing."""
        if self._square_of_next(OUTERMOST[end], end) < self._add_below:
            return 1 if self._lengths[end] > MIN_STRAIGHT_LINKS * self._link_length else 0
        if len(self._lengths) - 1 > MIN_BEADS:
            return -1 if self._square_of_next(FOLLOWING[end], end) > self._remove_above else 0
        return 0

    def _square_of_next(self, bead: int, end: int) -> float:
        """Return the squared distance [m^2] from the rod's centre to the point a link beyond ``bead``, towards ``end``."""
        (x, y), (mass_x, mass_y) = self._position(bead), self._position(end)
        fraction = self._link_length / math.hypot(mass_x - x, mass_y - y)
        next_x, next_y = x + fraction * (mass_x - x), y + fraction * (mass_y - y)
        return float(next_x * next_x + next_y * next_y)

    def _is_slack(self, end: int) -> bool:
        """Return whether the straight part at ``end`` hangs slack."""
        distance = math.dist(self._position(end), self._position(OUTERMOST[end]))
        return distance < (1 - MAX_SLACK_FRACTION) * self._lengths[end]


def between(a: Vector, b: Vector, share: float) -> Vector:
    """Return the vector a fraction ``share`` of the way from ``a`` to ``b``."""
    return a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])


def distances(positions: Sequence[Vector]) -> list[float]:
    """Return the distances [m] between neighbours."""
    return [math.dist(a, b) for a, b in zip(positions[:-1], positions[1:], strict=True)]


class JointRig(BeadRig):
    """A rig of bodies and joints, which can be added and removed while it runs."""

    @abc.abstractmethod
    def _add_rod(self, radius: float, friction: float) -> None:
        """Add a fixed circle of ``radius`` [m] at the origin, and let beads have the ``friction`` on it."""

    @abc.abstractmethod
    def _create_bead(self, position: Vector, velocity: Vector, mass: float) -> Any:
        """Return a new bead of ``mass`` [kg]."""

    @abc.abstractmethod
    def _create_mass(self, position: Vector, velocity: Vector, mass: float) -> Any:
        """Return a new body of ``mass`` [kg] that touches nothing."""

    @abc.abstractmethod
    def _create_held(self, position: Vector) -> Any:
        """Return a new body that is held at ``position`` [m]."""

    @abc.abstractmethod
    def _create_link(self, a: Any, b: Any, length: float) -> Any:
        """Return a new joint of ``length`` [m] between neighbouring beads."""

    @abc.abstractmethod
    def _create_straight(self, a: Any, b: Any, length: float) -> Any:
        """Return a new joint for a straight part of the string, of ``length`` [m], which only pulls."""

    @abc.abstractmethod
    def _remove_joint(self, joint: Any) -> None:
        """Remove a link or a straight part."""

    @abc.abstractmethod
    def _remove_body(self, bead: Any) -> None:
        """Remove a bead that no joint joins any more."""

    @abc.abstractmethod
    def _position_of(self, body: Any) -> Vector:
        """Return the position [m] of ``body``."""

    @abc.abstractmethod
    def _velocity_of(self, body: Any) -> Vector:
        """Return the velocity [m/s] of ``body``."""

    @abc.abstractmethod
    def _take_steps(self, count: int, forces: Sequence[tuple[Any, Vector]]) -> None:
        """Take ``count`` steps, during which these ``forces`` [N] act on bodies."""

    def _place(self, positions: Sequence[Vector], velocities: Sequence[Vector]) -> None:
        p, s = self._parameters, self._settings
        light = self._create_mass(positions[LIGHT], velocities[LIGHT], p.light_mass)
        if self._is_held:
            heavy = self._create_held(positions[HEAVY])
        else:
            heavy = self._create_mass(positions[HEAVY], velocities[HEAVY], p.heavy_mass)
        self._bodies, self._joints = [light, heavy], []
        if not self._has_string:
            return
        self._bead_mass = s.bead_mass_ratio * p.light_mass
        self._add_rod(self._node_radius - s.bead_radius, s.contact_friction(p.coefficients["kinetic_friction"]))
        self._bodies[1:1] = [
            self._create_bead(position, velocity, self._bead_mass)
            for position, velocity in zip(positions[1:-1], velocities[1:-1], strict=True)
        ]
        # As the engine has them, which may round
        self._lengths = distances([self._position_of(body) for body in self._bodies])
        last = len(self._lengths) - 1
        for i, (a, b, length) in enumerate(zip(self._bodies[:-1], self._bodies[1:], self._lengths, strict=True)):
            self._joints.append((self._create_straight if i in (0, last) else self._create_link)(a, b, length))

    def _position(self, index: int) -> Vector:
        return self._position_of(self._bodies[index])

    def _velocity(self, index: int) -> Vector:
        return self._velocity_of(self._bodies[index])

    def _step(self, count: int, forces: Forces | None) -> None:
        applied: list[tuple[Any, Vector]] = []
        if forces is not None:
            applied.append((self._bodies[LIGHT], forces[0]))
            if not self._is_held:
                applied.append((self._bodies[HEAVY], (0.0, forces[1])))
        self._take_steps(count, applied)

    def _insert(self, end: int, share: float) -> None:
        mass, outermost = self._bodies[end], self._bodies[OUTERMOST[end]]
        position = between(self._position_of(outermost), self._position_of(mass), share)
        velocity = between(self._velocity_of(outermost), self._velocity_of(mass), share)
        bead = self._create_bead(position, velocity, self._bead_mass)
        self._remove_joint(self._joints.pop(end))
        straight = self._create_straight(mass, bead, self._lengths[end])
        link = self._create_link(bead, outermost, self._lengths[OUTERMOST[end]])
        if end == LIGHT:
            self._bodies.insert(1, bead)
            self._joints[:0] = [straight, link]
        else:
            self._bodies.insert(-1, bead)
            self._joints += [link, straight]

    def _delete(self, end: int) -> None:
        for _ in range(2):
            self._remove_joint(self._joints.pop(end))
        self._remove_body(self._bodies.pop(OUTERMOST[end]))
        straight = self._create_straight(self._bodies[end], self._bodies[OUTERMOST[end]], self._lengths[end])
        self._joints.insert(0 if end == LIGHT else len(self._joints), straight)


class RebuiltRig(BeadRig):
    """A rig in an engine whose models cannot change: one for every number of beads, made when it is first needed.

    A model's coordinates are x and y of the light mass and of every bead, then y of the heavy mass unless that is held.
    """

    _model: Any
    """The model in use."""

    @abc.abstractmethod
    def _build_model(self, beads: int) -> Any:
        """Return the model of ``beads`` beads."""

    @abc.abstractmethod
    def _start_model(self) -> None:
        """Give the model in use the state `_rows` and the `_lengths`."""

    @abc.abstractmethod
    def _advance_model(self, count: int, forces: Forces | None) -> None:
        """Take ``count`` steps of the model in use with these ``forces``."""

    @abc.abstractmethod
    def _coordinates(self) -> Sequence[list[float]]:
        """Return the model's coordinates [m], their velocities and, where the solver starts from them, accelerations."""

    def _place(self, positions: Sequence[Vector], velocities: Sequence[Vector]) -> None:
        self._models: dict[int, Any] = {}
        self._rows = [list(positions), list(velocities), [(0.0, 0.0)] * len(positions)]
        if self._has_string:
            self._lengths = distances(positions)
        self._use_model()

    def _position(self, index: int) -> Vector:
        return self._rows[0][index]

    def _velocity(self, index: int) -> Vector:
        return self._rows[1][index]

    def _step(self, count: int, forces: Forces | None) -> None:
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
