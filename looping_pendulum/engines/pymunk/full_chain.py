"""pymunk (Chipmunk): links along the whole string, as a reader of its user guide would build it, by public calls only."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from looping_pendulum.engines.chain import MASS_COMPENSATION, SlipGauge, point_on_string
from looping_pendulum.engines.protocol import Profile, SteppedEngine
from looping_pendulum.engines.pymunk.abilities import full_abilities
from looping_pendulum.engines.pymunk.calls import MAX_SLOP_IN_RADIUS, PublicCalls
from looping_pendulum.engines.pymunk.full_settings import (
    FullChainSettings,
    FullChainVariant,
    contact_friction,
    full_settings,
    link_contact_radius,
)
from looping_pendulum.engines.pymunk.release_state import Vector, masses, velocity_on_string
from looping_pendulum.engines.pymunk.space_rig import SpaceRig
from looping_pendulum.engines.pymunk.studies import full_studies
from looping_pendulum.engines.studies import Studies
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import Parameters, Release
from looping_pendulum.scenarios.scenario import Scenario
from looping_pendulum.versions import installed_version


class _Beads:
    """Light mass, beads and heavy mass in a row, with a pin joint between neighbours.

    Parameters
    ----------
    nodes
        Distances of masses and beads from the light mass along the string [m].
    radius
        Distance from the rod's centre of a bead on the rod [m].
    """

    def __init__(
        self, space: Any, parameters: Parameters, settings: FullChainSettings, nodes: list[float], radius: float
    ) -> None:
        import pymunk

        p, s = parameters, settings
        string_mass = s.mass_fraction * p.light_mass
        light, heavy = masses(space, p, light_mass=p.light_mass - MASS_COMPENSATION * string_mass)
        self.light, self.heavy = light, heavy
        beads = []
        for arc in nodes[1:-1]:
            bead = pymunk.Body(string_mass / (len(nodes) - 1), math.inf)
            bead.position, bead.velocity = point_on_string(p, arc, radius), velocity_on_string(p, arc)
            shape = pymunk.Circle(bead, s.bead_radius)
            add_link_shape(space, bead, shape)
            beads.append(bead)
        bodies = [light, *beads, heavy]
        self.links = len(beads)
        origin = (0.0, 0.0)
        pairs = list(zip(bodies[:-1], bodies[1:], strict=True))
        joints = [pymunk.PinJoint(a, b, origin, origin) for a, b in pairs]
        add_joints(space, joints, s)
        # A pin joint keeps the distance that its ends have when it is created
        self._lengths = [joint.distance for joint in joints]
        self._slip = SlipGauge()
        anchors = [(body, origin) for body in bodies]
        add_joints(space, long_range_joints(anchors, self._lengths, s.long_range), s)

    def read(self, light: Vector, links: Array, heavy: Vector) -> tuple[float, float]:
        """Return the string's stretch beyond its rest length and its slip over the rod [m].

        Parameters
        ----------
        light, heavy
            Positions of the masses [m].
        links
            Position [m] and angle [rad] of every bead: x, y, angle, shape (n, 3).
        """
        nodes = np.vstack([light, links[:, :2], heavy])
        stretch = float(np.hypot(*np.diff(nodes, axis=0).T).sum()) - math.fsum(self._lengths)
        return stretch, self._slip.read(nodes.tolist(), self._lengths)


class _Segments:
    """Light mass, rigid segments and heavy mass in a row, with a pivot joint between neighbours.

    Parameters
    ----------
    nodes
        Distances of masses and joints from the light mass along the string [m].
    radius
        Distance from the rod's centre of a joint on the rod [m].
    """

    def __init__(
        self, space: Any, parameters: Parameters, settings: FullChainSettings, nodes: list[float], radius: float
    ) -> None:
        import pymunk

        p, s = parameters, settings
        string_mass = s.mass_fraction * p.light_mass
        light, heavy = masses(space, p, light_mass=p.light_mass - MASS_COMPENSATION * string_mass)
        self.light, self.heavy = light, heavy
        places = [point_on_string(p, arc, radius) for arc in nodes]
        speeds = [velocity_on_string(p, arc) for arc in nodes]
        mass = string_mass / (len(nodes) - 1)
        origin = (0.0, 0.0)
        joints, last, last_anchor, anchors, lengths = [], light, origin, [(light, origin)], []
        for i in range(len(nodes) - 1):
            start, end = places[i : i + 2]
            length = math.dist(start, end)
            # The moment of inertia of a thin rod about its middle
            body = pymunk.Body(mass, mass * length * length / 12)
            body.position, body.angle = _middle(start, end), math.atan2(end[1] - start[1], end[0] - start[0])
            body.velocity, body.angular_velocity = _rigid_motion(start, end, *speeds[i : i + 2])
            front, back = (-length / 2, 0.0), (length / 2, 0.0)
            shape = pymunk.Segment(body, front, back, s.bead_radius)
            add_link_shape(space, body, shape)
            joints.append(pymunk.PivotJoint(last, body, last_anchor, front))
            last, last_anchor = body, back
            anchors.append((body, back))
            lengths.append(length)
        joints.append(pymunk.PivotJoint(last, heavy, last_anchor, origin))
        self._lengths = np.array(lengths)
        self._slip = SlipGauge()
        self.links = len(lengths)
        add_joints(space, joints, s)
        add_joints(space, long_range_joints(anchors, lengths, s.long_range), s)

    def read(self, light: Vector, links: Array, heavy: Vector) -> tuple[float, float]:
        """Return the string's stretch beyond its rest length and its slip over the rod [m].

        The stretch is the sum of the joints' gaps, each along the segment before it.

        Parameters
        ----------
        light, heavy
            Positions of the masses [m].
        links
            Position of the middle [m] and angle [rad] of every segment: x, y, angle, shape (n, 3).
        """
        directions = np.stack([np.cos(links[:, 2]), np.sin(links[:, 2])], axis=1)
        halves = 0.5 * self._lengths[:, None] * directions
        starts, ends = links[:, :2] - halves, links[:, :2] + halves
        gaps = np.vstack([starts[1:], heavy]) - ends
        stretch = float((gaps * directions).sum() + (starts[0] - light) @ directions[0])
        return stretch, self._slip.read([*starts.tolist(), heavy], self._lengths.tolist())


def add_link_shape(space: Any, body: Any, shape: Any) -> None:
    """Add ``body`` with its collision shape to ``space``; one group for all links, so that they do not touch one another."""
    import pymunk

    shape.friction = 1.0  # Chipmunk multiplies the two shapes' coefficients: the circle's is then the pair's
    shape.filter = pymunk.ShapeFilter(group=1)
    space.add(body, shape)


def add_joints(space: Any, joints: list[Any], settings: FullChainSettings) -> None:
    """Add ``joints`` to ``space``, with the settings' rate of error correction."""
    for joint in joints:
        joint.error_bias = math.exp(-settings.error_rate)
        joint.collide_bodies = False
        space.add(joint)


def long_range_joints(anchors: list[tuple[Any, Vector]], lengths: list[float], longest: int) -> list[Any]:
    """Create slide joints over 2, 4, ... ``longest`` links, as long as the string between their ends.

    They pass the pull along straight string in few iterations, and are slack where it bends.

    Parameters
    ----------
    anchors
        Body and point on it [m, in the body's frame] of every node, light mass first.
    lengths
        Rest lengths of the links between the nodes [m].
    longest
        Longest span [links].
    """
    import pymunk

    joints, span = [], 2
    while span <= longest:
        for i in range(0, len(lengths) - span + 1, span):
            (a, on_a), (b, on_b) = anchors[i], anchors[i + span]
            joints.append(pymunk.SlideJoint(a, b, on_a, on_b, 0, math.fsum(lengths[i : i + span])))
        span *= 2
    return joints


def _middle(a: Vector, b: Vector) -> Vector:
    return ((a[0] + b[0]) / 2, (a[1] + b[1]) / 2)


def _rigid_motion(start: Vector, end: Vector, start_velocity: Vector, end_velocity: Vector) -> tuple[Vector, float]:
    """Return the velocity of the middle [m/s] and the angular velocity [rad/s] of a segment, from those of its ends."""
    x, y = end[0] - start[0], end[1] - start[1]
    vx, vy = end_velocity[0] - start_velocity[0], end_velocity[1] - start_velocity[1]
    return _middle(start_velocity, end_velocity), (x * vy - y * vx) / (x * x + y * y)


class FullChainRig(SpaceRig):
    """The apparatus in one Chipmunk space."""

    def __init__(self, variant: FullChainVariant, parameters: Parameters, settings: FullChainSettings) -> None:
        import pymunk
        import pymunk.batch

        super().__init__(parameters, settings)
        p, s = parameters, settings
        space = pymunk.Space()
        space.gravity = (0.0, -p.coefficients["gravity"])
        space.iterations = s.iterations
        space.collision_slop = s.collision_slop
        self._space = space
        self._calls = PublicCalls(space, s.time_step)
        self._chain: _Beads | _Segments | None = None
        if p.release is Release.DROP:
            self._light, self._heavy = masses(space, p)
        else:
            count = round(p.string_length / s.link_length)
            nodes = [i * p.string_length / count for i in range(count + 1)]
            bend, friction = s.bend(p.rod_radius), p.coefficients["kinetic_friction"]
            radius = link_contact_radius(variant, p.rod_radius, bend) if s.polygon_radius else p.rod_radius
            allowed = min(s.collision_slop, MAX_SLOP_IN_RADIUS)
            rod = pymunk.Circle(space.static_body, radius - s.bead_radius + allowed)
            rod.friction = contact_friction(variant, friction, bend) if s.polygon_friction else friction
            space.add(rod)
            if variant is FullChainVariant.SEGMENTS:
                # Segments touch the circle in their middle, so their joints lie farther from its centre than ``radius``
                self._chain = _Segments(space, p, s, nodes, math.hypot(radius, s.link_length / 2))
            else:
                self._chain = _Beads(space, p, s, nodes, radius)
            self._light, self._heavy = self._chain.light, self._chain.heavy
        self._batch, self._buffer = pymunk.batch, pymunk.batch.Buffer()
        self._fields = pymunk.batch.BodyFields.POSITION | pymunk.batch.BodyFields.ANGLE

    def _read_string(self, light: Vector, heavy: Vector) -> tuple[float, float]:
        if self._chain is None:
            return math.nan, math.nan
        self._buffer.clear()
        self._batch.get_space_bodies(self._space, self._fields, self._buffer)
        # pymunk lists bodies in the order in which they were added, static ones last: a clamped heavy mass is static.
        bodies = np.frombuffer(self._buffer.float_buf()).reshape(-1, 3)
        first = 1 if self._clamped else 2
        return self._chain.read(light, bodies[first : first + self._chain.links], heavy)


class PymunkFullChain(SteppedEngine):
    """Chain of links along the whole string, over a static circle.

    Parameters
    ----------
    variant
        What the links are, see `FullChainVariant`.
    profile
        Chooses the settings.
    settings
        Replaces the profile's settings, for studies of convergence.
    """

    name = "pymunk"

    def __init__(
        self,
        *,
        variant: str = FullChainVariant.BEADS,
        profile: Profile = Profile.QUICK,
        settings: FullChainSettings | None = None,
    ) -> None:
        chosen = FullChainVariant(variant)
        self.variant = chosen.value
        self.profile = profile
        self.settings: FullChainSettings = settings if settings is not None else full_settings(chosen, profile)
        self.abilities = full_abilities(chosen)

    def build(self, scenario: Scenario) -> FullChainRig:
        """Build the scenario's apparatus at the moment of release."""
        return FullChainRig(FullChainVariant(self.variant), scenario.parameters, self.settings)

    def studies(self) -> Studies:
        """Return the ladders of refinement, Chipmunk's defaults one at a time, and the adapter's choices."""
        return full_studies(FullChainVariant(self.variant), self.settings, self.with_settings)

    def versions(self) -> dict[str, str]:
        """Return the version of pymunk."""
        return {"pymunk": installed_version("pymunk")}
