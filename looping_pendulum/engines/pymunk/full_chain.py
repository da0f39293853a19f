"""pymunk (Chipmunk): links along the whole string, as a reader of its user guide would build it, by public calls only."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from looping_pendulum.engines.chain import (
    CORNER_CHOICES,
    MASS_COMPENSATION,
    MASS_FRACTION,
    ONE_COEFFICIENT,
    SlipGauge,
    point_on_string,
    polygon_friction,
    polygon_radius,
)
from looping_pendulum.engines.protocol import Abilities, Profile, TunedEngine
from looping_pendulum.engines.pymunk.space import (
    DEFAULT_COLLISION_SLOP,
    DEFAULT_ITERATIONS,
    DEFAULT_RATE,
    DEFAULT_TIME_STEP,
    MAX_SLOP_IN_RADIUS,
    ForceIntervals,
    PublicCalls,
    SpaceRig,
    Vector,
    error_bias_default,
    iterations_default,
    masses,
    slop_default,
    step_default,
    velocity_on_string,
)
from looping_pendulum.engines.shipped import shipped_abilities
from looping_pendulum.engines.studies import Studies, rows_that_differ, studies_from_rows
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import Parameters, Release
from looping_pendulum.scenarios.scenario import Scenario


@dataclass(frozen=True, kw_only=True)
class FullChainSettings(ForceIntervals):
    """Numerical settings of a chain of links along the whole string."""

    time_step: float
    """Length of a step [s]; it must divide the sample interval."""
    link_length: float
    """Length of a link [m]; adjusted so that equal links make up the string."""
    iterations: int
    """Iterations (sweeps over all constraints) of the solver per step."""
    long_range: int
    """Longest span, in links, of the slide joints that pass the pull over 2, 4, 8, ... links at once; 0: none."""
    mass_fraction: float = 0.01
    """Mass of the whole chain over the light mass. Lighter: a softer chain; heavier: the string's own inertia shows."""
    error_rate: float = DEFAULT_RATE
    """Rate at which joints correct their length error [1/s]; Chipmunk's `error_bias` is exp(-rate).

    Nothing damps the chain, so a high rate makes it oscillate: of the quick profile's held pendulum, 30 costs 1 % of its
    energy and 100 costs 12 %.
    """
    collision_slop: float = 1e-5
    """Depth to which links rest in the circle [m]; its radius is larger by as much, up to `MAX_SLOP_IN_RADIUS`."""
    bead_radius: float = 1e-3
    """Half of the links' thickness [m]; the circle is that much smaller, so that their middle runs where the string should."""
    polygon_friction: bool = True
    """Whether the contact's friction is corrected for the polygon that the links are."""
    polygon_radius: bool = True
    """Whether the circle's radius is corrected for it."""
    force_interval: int = 10
    """Steps between two updates of the drag forces."""

    def bend(self, rod_radius: float) -> float:
        """Return the angle between neighbouring links on a rod of ``rod_radius`` [m], in rad."""
        return self.link_length / rod_radius


_DEFAULTS = FullChainSettings(
    time_step=DEFAULT_TIME_STEP,
    link_length=6e-3,
    iterations=DEFAULT_ITERATIONS,
    long_range=0,
    collision_slop=DEFAULT_COLLISION_SLOP,
    polygon_friction=False,
    polygon_radius=False,
    force_interval=1,
)

SETTINGS = {
    ("beads", Profile.QUICK): FullChainSettings(
        time_step=2e-5, link_length=6e-3, iterations=10, long_range=64, error_rate=30.0
    ),
    ("beads", Profile.ACCURATE): FullChainSettings(
        time_step=4e-6, link_length=3e-3, iterations=10, long_range=64, error_rate=100.0
    ),
    ("segments", Profile.QUICK): FullChainSettings(
        time_step=2e-5, link_length=5e-3, iterations=10, long_range=64, error_rate=30.0, bead_radius=0.0
    ),
    ("segments", Profile.ACCURATE): FullChainSettings(
        time_step=4e-6, link_length=3e-3, iterations=10, long_range=64, error_rate=100.0, bead_radius=0.0
    ),
    ("defaults", Profile.QUICK): _DEFAULTS,
    ("defaults", Profile.ACCURATE): _DEFAULTS,
}
"""Variant and profile -> settings. The defaults variant has one for both profiles, as it shows what the defaults do."""


def contact_friction(variant: str, friction: float, bend: float) -> float:
    """Return the contact friction with which a polygon of links obeys the capstan law of a circle.

    Beads touch the circle where the string bends: `engines.chain.polygon_friction`. A rigid segment touches it in its middle,
    and the string bends at its ends. Let joint forces grow by exp(mu b) from one end to the other, at the same angle to the
    radius at both: then the segment's three equations of equilibrium give m = sinh(mu b) / sin(b). That is above mu, where the
    beads' coefficient is below it.
    """
    if variant == "segments":
        return math.sinh(friction * bend) / math.sin(bend)
    return polygon_friction(friction, bend)


def link_contact_radius(variant: str, rod_radius: float, bend: float) -> float:
    """Return the distance from the rod's centre [m] at which the links' middle lines must touch it to wind up R per radian.

    Segments of length h = R b on a circle of radius r turn the string by b where r tan(b/2) = h / 2.
    """
    if variant == "segments":
        return rod_radius * (bend / 2) / math.tan(bend / 2)
    return float(polygon_radius(rod_radius, bend))


def _abilities(variant: str, links: str, friction: str, summary: str, limit: str, **declared: Any) -> Abilities:
    """Return the abilities of a variant whose ``links`` touch the rod, with ``friction`` between them and the circle."""
    return shipped_abilities(
        f"pymunk:{variant}",
        winding=f"contact of {links} along the whole string with a static circle",
        friction_law=f"Coulomb friction between {links} and circle, {friction}",
        stick_slip="the same contact: the solver clamps friction to its cone",
        summary=summary,
        limits=(ONE_COEFFICIENT, limit),
        additions=(
            f"the string weighs {100 * MASS_FRACTION:g} % of the light mass; {100 * MASS_FRACTION * MASS_COMPENSATION:g} % is "
            "taken off that",
        ),
        main=False,
        **declared,
    )


_SOLVED = "its coefficient solved from the capstan law for the polygon's corners"
_SPRING = (
    "nothing damps its joints, which act as a spring: the string rings along its length, and the halted heavy mass with it"
)
_STRETCHES = "measured to stretch by more than its budget after 0.06 s, which ends the run"
_LETS_FALL = "a string that stretches lets fall"
_LOST_EFFECTS = ("light_drag", "heavy_drag", "light_linear_drag", "heavy_linear_drag", "attitude_drag", "wind", "side_force")
_ABILITIES = {
    "beads": _abilities(
        "beads",
        "beads",
        _SOLVED,
        "Point beads on pin joints along the whole string, slide joints over many; public calls only.",
        _SPRING,
    ),
    "segments": _abilities(
        "segments",
        "segments",
        _SOLVED,
        "Rigid segments on pivot joints along the whole string, slide joints over many; public calls only.",
        _SPRING,
        known_failures={
            "follows_the_reference_past_the_halt_and_a_full_turn": "measured 5.8 mm off at 0.42 s, for 5.7 mm: it rings",
        },
    ),
    "defaults": _abilities(
        "defaults",
        "beads",
        "uncorrected",
        "Point beads on pin joints along the whole string, with every setting of Chipmunk left as it comes.",
        "the string stretches without bound: no run of it says anything of a string",
        known_failures={
            "samples_every_millisecond_from_rest": _STRETCHES,
            "runs_to_its_end": _STRETCHES,
            "frictionless_vertical_release_is_an_atwood_machine": f"measured 9.56 for 8.03 m/s^2: {_LETS_FALL}",
            "vertical_release_obeys_the_capstan_law": f"measured 9.56 for 5.80 m/s^2: {_LETS_FALL}",
            "friction_holds_the_string_of_a_small_overweight": f"measured 12 mm in 0.1 s: {_LETS_FALL}",
            "held_pendulum_swings_to_the_other_side": "the light mass falls all the way: the string that should turn it "
            "stretches",
            "string_keeps_its_length": "measured 22 mm of stretch after 0.15 s",
            "release_has_the_exact_acceleration": "measured free fall of the light mass: no string pulls it",
            "release_against_friction_has_the_exact_acceleration": "measured free fall of the light mass: no string pulls it",
            "energy_never_grows_with_losses": "measured 1.1 % of what the heavy mass gave, where 1 % is allowed",
            "energy_is_kept_without_losses": "measured 1.6 % of what the heavy mass gave, where 1 % is allowed",
            "follows_the_reference_without_losses": "measured 21 mm off at 0.06 s",
            "follows_the_reference_past_the_halt_and_a_full_turn": "measured 10 mm off at 0.05 s",
            "error_is_covered_by_refinement": "its finer runs break off like its own: the string stretches without bound",
        }
        | {
            f"{effect}_acts_as_in_the_reference": "measured on one mass only: a string that stretches does not pull the other"
            for effect in (*_LOST_EFFECTS, "side_stiffness")
        },
    ),
}
"""Variant -> what it can do."""


class FullChainRig(SpaceRig):
    """The apparatus in one Chipmunk space, with a joint between neighbouring links; a subclass adds the links."""

    _link_count: int
    _anchors: list[tuple[Any, Vector]]
    """Body and point on it [m, in the body's frame] of every node, light mass first."""

    def __init__(self, variant: str, parameters: Parameters, settings: FullChainSettings) -> None:
        import pymunk
        import pymunk.batch

        super().__init__(parameters, settings, slop=settings.collision_slop)
        p, s, space = parameters, settings, self._space
        self._pymunk, self._parameters = pymunk, p
        self._calls = PublicCalls(space, s.time_step)
        self._lengths: list[float] = []
        self._slip = SlipGauge()
        self._has_string = p.release is not Release.DROP
        if self._has_string:
            bend, friction = s.bend(p.rod_radius), p.coefficients["kinetic_friction"]
            radius = link_contact_radius(variant, p.rod_radius, bend) if s.polygon_radius else p.rod_radius
            rod = pymunk.Circle(space.static_body, radius - s.bead_radius + min(s.collision_slop, MAX_SLOP_IN_RADIUS))
            rod.friction = contact_friction(variant, friction, bend) if s.polygon_friction else friction
            space.add(rod)
            self._add_string(radius)
        else:
            self._light, self._heavy = masses(space, p)
        self._buffer = pymunk.batch.Buffer()
        self._fields = pymunk.batch.BodyFields.POSITION | pymunk.batch.BodyFields.ANGLE

    def _add_string(self, radius: float) -> None:
        """Add the masses, the links and their joints; ``radius`` [m] is where a link touches the rod, from the rod's centre."""
        p, s = self._parameters, self._settings
        string_mass = s.mass_fraction * p.light_mass
        self._light, self._heavy = masses(self._space, p, light_mass=p.light_mass - MASS_COMPENSATION * string_mass)
        count = round(p.string_length / s.link_length)
        # The masses, and the beads or the joints between segments
        nodes = [i * p.string_length / count for i in range(count + 1)]
        for joint in (*self._add_links(nodes, radius, string_mass / count), *self._long_range_joints()):
            joint.error_bias = math.exp(-s.error_rate)
            joint.collide_bodies = False
            self._space.add(joint)

    def _add_links(self, nodes: list[float], radius: float, mass: float) -> list[Any]:
        """Add links of ``mass`` [kg], with ``nodes`` at these distances from the light mass along the string [m].

        They have the release's velocities. Return the joints between them and the masses.
        """
        raise NotImplementedError

    def _add_link(self, body: Any, shape: Any) -> None:
        """Add ``body`` with its collision ``shape``; one group for all links, so that they do not touch one another."""
        shape.friction = 1.0  # Chipmunk multiplies the two shapes' coefficients: the circle's is then the pair's
        shape.filter = self._pymunk.ShapeFilter(group=1)
        self._space.add(body, shape)

    def _long_range_joints(self) -> list[Any]:
        """Create slide joints over 2, 4, ... `long_range` links, as long as the string between their ends.

        They pass the pull along straight string in few iterations, and are slack where it bends.
        """
        joints, span, lengths = [], 2, self._lengths
        while span <= self._settings.long_range:
            for i in range(0, len(lengths) - span + 1, span):
                (a, on_a), (b, on_b) = self._anchors[i], self._anchors[i + span]
                joints.append(self._pymunk.SlideJoint(a, b, on_a, on_b, 0, math.fsum(lengths[i : i + span])))
            span *= 2
        return joints

    def _read_string(self, light: Vector, heavy: Vector) -> tuple[float, float]:
        if not self._has_string:
            return math.nan, math.nan
        self._buffer.clear()
        self._pymunk.batch.get_space_bodies(self._space, self._fields, self._buffer)
        # pymunk lists bodies in the order in which they were added, static ones last: a clamped heavy mass is static.
        bodies = np.frombuffer(self._buffer.float_buf()).reshape(-1, 3)
        first = 1 if self._clamped else 2
        return self._read_links(light, bodies[first : first + self._link_count], heavy)

    def _read_links(self, light: Vector, links: Array, heavy: Vector) -> tuple[float, float]:
        """Return the string's stretch beyond its rest length and its slip over the rod [m].

        Parameters
        ----------
        light, heavy
            Positions of the masses [m].
        links
            Position of the middle [m] and angle [rad] of every link: x, y, angle, shape (n, 3).
        """
        raise NotImplementedError


class BeadsRig(FullChainRig):
    """The apparatus with beads, and a pin joint between neighbours."""

    def _add_links(self, nodes: list[float], radius: float, mass: float) -> list[Any]:
        p, pymunk = self._parameters, self._pymunk
        beads = []
        for arc in nodes[1:-1]:
            bead = pymunk.Body(mass, math.inf)
            bead.position, bead.velocity = point_on_string(p, arc, radius), velocity_on_string(p, arc)
            self._add_link(bead, pymunk.Circle(bead, self._settings.bead_radius))
            beads.append(bead)
        self._link_count = len(beads)
        self._anchors = [(body, (0.0, 0.0)) for body in (self._light, *beads, self._heavy)]
        pairs = zip(self._anchors[:-1], self._anchors[1:], strict=True)
        joints = [pymunk.PinJoint(a, b, on_a, on_b) for (a, on_a), (b, on_b) in pairs]
        # A pin joint keeps the distance that its ends have when it is created
        self._lengths = [joint.distance for joint in joints]
        return joints

    def _read_links(self, light: Vector, links: Array, heavy: Vector) -> tuple[float, float]:
        nodes = np.vstack([light, links[:, :2], heavy])
        stretch = float(np.hypot(*np.diff(nodes, axis=0).T).sum()) - math.fsum(self._lengths)
        return stretch, self._slip.read(nodes.tolist(), self._lengths)


class SegmentsRig(FullChainRig):
    """The apparatus with rigid segments, and a pivot joint between neighbours."""

    def _add_links(self, nodes: list[float], radius: float, mass: float) -> list[Any]:
        p, pymunk = self._parameters, self._pymunk
        # Segments touch the circle in their middle, so their joints lie farther from its centre
        joint_radius = math.hypot(radius, self._settings.link_length / 2)
        places = np.array([point_on_string(p, arc, joint_radius) for arc in nodes])
        speeds = np.array([velocity_on_string(p, arc) for arc in nodes])
        joints, last, last_anchor, origin = [], self._light, (0.0, 0.0), (0.0, 0.0)
        self._anchors = [(last, origin)]
        for i in range(len(nodes) - 1):
            (x, y), (vx, vy) = (np.diff(row[i : i + 2], axis=0)[0].tolist() for row in (places, speeds))
            length = math.dist(*places[i : i + 2].tolist())
            # The moment of inertia of a thin rod about its middle
            body = pymunk.Body(mass, mass * length * length / 12)
            body.position, body.velocity = ((0.5 * (row[i] + row[i + 1])).tolist() for row in (places, speeds))
            body.angle, body.angular_velocity = math.atan2(y, x), (x * vy - y * vx) / (x * x + y * y)
            front, back = (-length / 2, 0.0), (length / 2, 0.0)
            self._add_link(body, pymunk.Segment(body, front, back, self._settings.bead_radius))
            joints.append(pymunk.PivotJoint(last, body, last_anchor, front))
            last, last_anchor = body, back
            self._anchors.append((body, back))
            self._lengths.append(length)
        joints.append(pymunk.PivotJoint(last, self._heavy, last_anchor, origin))
        self._link_count = len(self._lengths)
        return joints

    def _read_links(self, light: Vector, links: Array, heavy: Vector) -> tuple[float, float]:
        # The stretch is the sum of the joints' gaps, each along the segment before it
        directions = np.stack([np.cos(links[:, 2]), np.sin(links[:, 2])], axis=1)
        halves = 0.5 * np.array(self._lengths)[:, None] * directions
        starts, ends = links[:, :2] - halves, links[:, :2] + halves
        gaps = np.vstack([starts[1:], heavy]) - ends
        stretch = float((gaps * directions).sum() + (starts[0] - light) @ directions[0])
        return stretch, self._slip.read([*starts.tolist(), heavy], self._lengths)


class PymunkFullChain(TunedEngine):
    """Chain of links along the whole string, over a static circle.

    The variants say what the links are: "beads" on pin joints, rigid "segments" on pivot joints, or "defaults", as beads, with
    everything else left as Chipmunk has it.
    """

    name = "pymunk"
    distribution = "pymunk"
    variant = "beads"
    variants = _ABILITIES
    settings_by_profile = SETTINGS
    settings: FullChainSettings

    def build(self, scenario: Scenario) -> FullChainRig:
        """Build the scenario's apparatus at the moment of release."""
        rig = SegmentsRig if self.variant == "segments" else BeadsRig
        return rig(self.variant, scenario.parameters, self.settings)

    def studies(self) -> Studies:
        """Return ladders, Chipmunk's defaults and the adapter's choices; "defaults" varies its step only, which is none."""
        s = self.settings
        if self.variant == "defaults":
            return studies_from_rows(self, ladders=(("time_step", "s", (1e-3, 5e-4, 2e-4, 1e-4)),))
        return studies_from_rows(
            self,
            ladders=(
                ("time_step", "s", (5e-5, 2e-5, 1e-5, 5e-6)),
                ("link_length", "m", (8e-3, 6e-3, 4e-3, 3e-3)),
                ("iterations", "", (5, 10, 20, 40)),
                ("mass_fraction", "", (0.04, 0.02, 0.01, 0.005)),
            ),
            defaults=(
                step_default(s),
                *rows_that_differ(s, (iterations_default(s),)),
                slop_default(s, "collision_slop"),
                error_bias_default(s),
            ),
            choices=(
                ("long-range joints", f"up to {s.long_range} links", "none", {"long_range": 0}),
                ("string mass", f"{s.mass_fraction:g} M1", "half", {"mass_fraction": s.mass_fraction / 2}),
                CORNER_CHOICES[0],
                ("circle of the links", "corrected for the corners", "R itself", {"polygon_radius": False}),
                ("links' half thickness", f"{1e3 * s.bead_radius:g} mm", "0.5 mm", {"bead_radius": 5e-4}),
                ("forces updated", f"every {s.force_interval} steps", "every step", {"force_interval": 1}),
            ),
        )
