"""pymunk (Chipmunk): the string is a row of point-mass beads that slide over a static circle under Coulomb contact.

Chipmunk solves its joints by a few sweeps of projected Gauss-Seidel per step, each joint starting from its impulse of the step
before. A chain under tension then acts as a spring of stiffness about ``iterations * bead_mass / (links * time_step**2)``:
few links and a short step make it stiff. So there are beads only where the string touches the rod or is about to; a straight
part of the string is one massless joint. As the string slides or winds, the adapter adds and removes beads on the straight
parts, where they carry no lateral load; beads that touch the rod are moved by Chipmunk alone.
"""

from __future__ import annotations

import dataclasses
import importlib
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from looping_pendulum.engines.bead_rig import FOLLOWING, LIGHT, OUTERMOST, JointRig, between
from looping_pendulum.engines.chain import (
    CORNER_CHOICES,
    ONE_COEFFICIENT,
    STRAIGHT_STRING,
    BeadChainSettings,
    bead_abilities,
    point_on_string,
)
from looping_pendulum.engines.protocol import Engine, Profile, SteppedEngine
from looping_pendulum.engines.studies import Ladder, Studies, Variation, default_row
from looping_pendulum.pages.numbers import quantity
from looping_pendulum.reference_ode.cartesian import MassesAtRelease, Vector
from looping_pendulum.reference_ode.parameters import Parameters
from looping_pendulum.runs.trajectory import Provenance

DEFAULT_TIME_STEP = 1e-3
"""Step of the studies' defaults [s]. Chipmunk has no default step; this is ten times finer than what its guides use."""
DEFAULT_ITERATIONS = 10
"""Chipmunk's default number of solver iterations per step."""
DEFAULT_COLLISION_SLOP = 0.1
"""Chipmunk's default penetration that contacts leave uncorrected, in units of length: here 10 cm."""
DEFAULT_RATE = -60 * math.log(1 - 0.1)
"""Chipmunk's default rate of error correction [1/s]: a tenth of the error in every sixtieth of a second."""
MAX_SLOP_IN_RADIUS = 1e-3
"""Largest penetration slop that the circle's radius makes up for [m]; Chipmunk's default slop, 10 cm, exceeds the rod."""


@dataclass(frozen=True, kw_only=True)
class PymunkChainSettings(BeadChainSettings):
    """Numerical settings of the bead chain."""

    iterations: int = 20
    """Iterations (sweeps over all constraints) of the solver per step."""
    impulse_leak: float = 150.0
    """Rate at which joints forget their warm-start impulse [1/s].

    Warm starting makes the chain act as an undamped spring; the leak damps it.
    """
    leak_interval: int = 5
    """Steps between two leaks of the warm-start impulse, each for the whole interval, as a leak costs a call.

    It must divide `steps_per_group`.
    """
    error_rate: float = 100.0
    """Rate at which joints correct their length error [1/s]; above `impulse_leak` the chain's oscillations grow."""
    contact_rate: float = 100.0
    """Rate at which contacts correct penetration beyond `contact_slop` [1/s]."""
    contact_slop: float = 1e-5
    """Depth to which beads rest in the circle [m]; allowed for in its radius."""
    steps_per_group: int = 50

    def __post_init__(self) -> None:
        """Raise ValueError where leaks do not divide a group, EngineError where groups do not divide the sample interval."""
        if self.steps_per_group % self.leak_interval:
            raise ValueError(
                f"leak_interval: found {self.leak_interval}, needed a divisor of steps_per_group, {self.steps_per_group}"
            )
        super().__post_init__()


SETTINGS = {
    Profile.QUICK: PymunkChainSettings(time_step=5e-6, bend=0.28, bead_mass_ratio=2e-4),
    Profile.ACCURATE: PymunkChainSettings(time_step=2e-6, bend=0.24, bead_mass_ratio=1e-4),
}

PRIVATE_CALLS = ("cpSpaceSetCurrentTimeStep", "cpSpaceStep")
"""Chipmunk functions that pymunk calls itself but does not publish."""
TIME_UNIT = 2.0**-13
"""Length of Chipmunk's second [s]; a power of two, by which nothing is rounded.

Chipmunk looks for contacts within a tenth of a second's way of each shape. With seconds, that is where all other beads are.
"""
PUBLIC_ERROR_RATE = 6.3
"""Error rate of the joints where the leak is not available [1/s]: Chipmunk's default.

Without the leak nothing damps the chain, so joints must correct their errors no faster.
"""

ADD_WITHIN_LINKS = 2.0
"""A bead is added when the outermost one is nearer than this to its tangent point [links].

The new bead is then still off the rod, and lands on it later.
"""
REMOVE_BEYOND_LINKS = 3.5
"""A bead is removed when the second one is farther than this from its tangent point [links].

It exceeds `ADD_WITHIN_LINKS` by more than a link, so that no bead is added and removed in turn.
"""
MIN_BEADS = 4
"""Number of beads that are never removed."""


def private_library() -> Any:
    """Return Chipmunk's functions below pymunk, or None where this version of pymunk lacks one of `PRIVATE_CALLS`."""
    try:
        library = importlib.import_module("pymunk._chipmunk").lib
    except (ImportError, AttributeError):
        return None
    return library if all(hasattr(library, name) for name in PRIVATE_CALLS) else None


def velocity_on_string(parameters: Parameters, masses: MassesAtRelease, arc: float) -> Vector:
    """Return the velocity [m/s] of the taut string just after release, ``arc`` [m] from the light mass.

    String on the rod and on the heavy side moves along itself with the heavy mass's speed; on the free part the velocity is
    linear between that of the tangent point and the light mass's.
    """
    p = parameters
    (vx, vy), (_, heavy_vy) = masses.light_velocity, masses.heavy_velocity
    wound_arc = min(max(arc - p.free_length, 0.0), p.rod_radius * p.release_angle)
    angle = p.release_angle - wound_arc / p.rod_radius
    along = (-heavy_vy * math.sin(angle), heavy_vy * math.cos(angle))
    share = max(1 - arc / p.free_length, 0.0)
    return (along[0] + share * (vx - along[0]), along[1] + share * (vy - along[1]))


class PymunkRig(JointRig):
    """The apparatus in Chipmunk, with some beads off the rod, which land on it later."""

    def _create_world(self) -> None:
        import pymunk

        s = self._settings
        self._pymunk, self._library = pymunk, private_library()
        self._space = space = pymunk.Space()
        space.gravity = (0.0, -self._parameters.coefficients["gravity"] * TIME_UNIT**2)
        space.iterations, space.collision_slop = s.iterations, s.contact_slop
        # Fraction of an error that is left after a unit of time
        space.collision_bias = math.exp(-s.contact_rate * TIME_UNIT)
        self._error_bias = math.exp(-(PUBLIC_ERROR_RATE if self._library is None else s.error_rate) * TIME_UNIT)
        self._no_mutual_contact = pymunk.ShapeFilter(group=1)
        # The first group of steps gets half of the forces' impulse, so that on average over a group the speeds are neither
        # early nor late
        self._share = 0.5

    def _add_rod(self, radius: float, friction: float) -> None:
        rod = self._pymunk.Circle(self._space.static_body, radius + min(self._settings.contact_slop, MAX_SLOP_IN_RADIUS))
        rod.friction = friction
        self._space.add(rod)

    def _create_bead(self, position: Vector, velocity: Vector, mass: float) -> Any:
        bead = self._create_mass(position, velocity, mass)
        shape = self._pymunk.Circle(bead, self._settings.bead_radius)
        shape.friction = 1.0  # Chipmunk multiplies the two shapes' coefficients: the circle's is then the pair's
        shape.filter = self._no_mutual_contact
        self._space.add(shape)
        return bead

    def _create_mass(self, position: Vector, velocity: Vector, mass: float) -> Any:
        # An infinite moment of inertia: bodies are points, which slide and do not roll
        body = self._pymunk.Body(mass, math.inf)
        body.position, body.velocity = position, self._scaled(velocity)
        self._space.add(body)
        return body

    def _create_held(self, position: Vector) -> Any:
        body = self._pymunk.Body(body_type=self._pymunk.Body.STATIC)
        body.position = position
        self._space.add(body)
        return body

    def _create_link(self, a: Any, b: Any, length: float) -> Any:
        joint = self._pymunk.PinJoint(a, b)
        joint.distance = length
        return self._join(joint)

    def _create_straight(self, a: Any, b: Any, length: float) -> Any:
        return self._join(self._pymunk.SlideJoint(a, b, (0, 0), (0, 0), 0, length))

    def _remove_joint(self, joint: Any) -> None:
        self._space.remove(joint)

    def _remove_body(self, bead: Any) -> None:
        self._space.remove(bead, *bead.shapes)

    def _position_of(self, body: Any) -> Vector:
        x, y = body.position
        return x, y

    def _velocity_of(self, body: Any) -> Vector:
        vx, vy = body.velocity
        return vx / TIME_UNIT, vy / TIME_UNIT

    def _take_steps(self, count: int, forces: Sequence[tuple[Any, Vector]]) -> None:
        """Take ``count`` steps; the first one gets the impulse of ``forces`` [N] for all, as Chipmunk clears them after it."""
        for body, (fx, fy) in forces:
            scale = self._share * count * TIME_UNIT**2
            body.force = (scale * fx, scale * fy)
        self._share = 1.0
        s, library, step = self._settings, self._library, self._settings.time_step / TIME_UNIT
        if library is None:
            for _ in range(count):
                self._space.step(step)
            return
        # Chipmunk scales warm-start impulses by the new step over the previous one. Where the previous one is set to
        # dt / (1 - n leak dt), it keeps the fraction 1 - n leak dt of the impulses; n is the number of steps between
        claimed_previous_step = step / (1 - s.leak_interval * s.impulse_leak * s.time_step)
        for _ in range(count // s.leak_interval):
            library.cpSpaceSetCurrentTimeStep(self._space._space, claimed_previous_step)
            for _ in range(s.leak_interval):
                library.cpSpaceStep(self._space._space, step)

    def _beads_at_release(self, masses: MassesAtRelease) -> tuple[list[Vector], list[Vector]]:
        """Return positions [m] and velocities [m/s] of the beads, light side first.

        Beads lie on the rod and `ADD_WITHIN_LINKS` beyond it on either side, but a link or more from either mass.
        """
        p, link = self._parameters, self._link_length
        first = p.free_length - ADD_WITHIN_LINKS * link
        count = math.ceil(p.rod_radius * p.release_angle / link + 2 * ADD_WITHIN_LINKS)
        arcs = (first + i * link for i in range(count + 1))
        kept = [arc for arc in arcs if link <= arc <= p.string_length - link]
        return [point_on_string(p, arc, self._node_radius) for arc in kept], [
            velocity_on_string(p, masses, arc) for arc in kept
        ]

    def _bead_count_change(self, end: int) -> int:
        link, beads = self._link_length, len(self._lengths) - 1
        if self._tangent_length(OUTERMOST[end]) < ADD_WITHIN_LINKS * link:
            return 1 if self._lengths[end] > 2 * link else 0
        return -1 if beads > MIN_BEADS and self._tangent_length(FOLLOWING[end]) > REMOVE_BEYOND_LINKS * link else 0

    def _tangent_length(self, bead: int) -> float:
        """Return the length [m] of the tangent from a bead to the rod; 0 on the rod."""
        x, y = self._position(bead)
        return math.sqrt(max(x * x + y * y - self._parameters.rod_radius**2, 0.0))

    def _insert(self, end: int, share: float) -> None:
        """Put the new bead where the outermost one is, and move that one towards the mass.

        So the straight part keeps its joint, and with it the warm-start impulse that carries the mass.
        """
        mass, outermost, following = (self._bodies[i] for i in (end, OUTERMOST[end], FOLLOWING[end]))
        position, velocity = self._position_of(outermost), self._velocity_of(outermost)
        straight, link_length = self._lengths[end], self._lengths[OUTERMOST[end]]
        # Of the rest length, not of the distance as ``share``: so the new link is stretched as the straight part is
        rest_share = link_length / (straight + link_length)
        outermost.position = between(position, self._position_of(mass), rest_share)
        outermost.velocity = self._scaled(between(velocity, self._velocity_of(mass), rest_share))
        self._joints[end].max = straight
        # A joint cannot change its bodies, so the links beside the new bead are created anew
        self._remove_joint(self._joints.pop(OUTERMOST[end]))
        bead = self._create_bead(position, velocity, self._bead_mass)
        link = self._create_link(outermost, bead, link_length)
        next_link = self._create_link(bead, following, self._lengths[FOLLOWING[end]])
        if end == LIGHT:
            self._bodies.insert(2, bead)
            self._joints[1:1] = [link, next_link]
        else:
            self._bodies.insert(-2, bead)
            self._joints[-1:-1] = [next_link, link]

    def _delete(self, end: int) -> None:
        """Remove the second bead and put the outermost one in its place, so that the straight part keeps its joint."""
        bead, outermost = self._bodies.pop(FOLLOWING[end]), self._bodies[OUTERMOST[end]]
        outermost.position, outermost.velocity = bead.position, bead.velocity
        self._joints[end].max = self._lengths[end]
        for _ in range(2):
            self._remove_joint(self._joints.pop(OUTERMOST[end]))
        self._remove_body(bead)
        link = self._create_link(outermost, self._bodies[FOLLOWING[end]], self._lengths[OUTERMOST[end]])
        self._joints.insert(1 if end == LIGHT else -1, link)

    @staticmethod
    def _scaled(velocity: Vector) -> Vector:
        """Return ``velocity`` [m/s] in metres per `TIME_UNIT`."""
        return velocity[0] * TIME_UNIT, velocity[1] * TIME_UNIT

    def _join(self, joint: Any) -> Any:
        joint.error_bias = self._error_bias
        self._space.add(joint)
        return joint


class PymunkChain(SteppedEngine):
    """Chain of beads over a static circle."""

    name = "pymunk"
    distribution = "pymunk"
    variant = "chain"
    rig = PymunkRig
    settings_by_profile = SETTINGS
    settings: PymunkChainSettings
    abilities = bead_abilities(
        "pymunk:chain",
        rod="static circle",
        stick_slip="the solver clamps friction to its cone",
        summary="Point beads on pin joints over a static circle, a slide joint for each straight part of the string.",
        limits=(
            ONE_COEFFICIENT,
            "damps its joints through a private pymunk call (a leaky warm start); where a pymunk lacks it the chain is softer "
            "(at ten to one, quick: 0.99 mm of stretch for 0.13 mm) and provenance.settings says leaky_warm_start: False",
            STRAIGHT_STRING,
            "a slack string that jerks taut bounces: the chain takes the pull as a spring, where the reference's pull is "
            "inelastic",
        ),
        bead_mass_ratio=SETTINGS[Profile.QUICK].bead_mass_ratio,
    )

    def studies(self) -> Studies:
        """Return the ladders of refinement, Chipmunk's defaults one at a time, and the adapter's choices."""
        s = self.settings
        # No rung is coarser than the settings: joints are springs that soften with the square of the step, and a string that
        # has stretched by millimetres halts by another motion
        factors = (1, 2, 4, 8)
        masses = [{"bead_mass_ratio": s.bead_mass_ratio / n**2, "time_step": s.time_step / n} for n in factors]
        return Studies(
            ladders=(
                Ladder("time_step", "s", [s.time_step / n for n in factors]),
                Ladder("bend", "rad", [s.bend / math.sqrt(n) for n in factors]),
                Ladder("bead_mass_ratio", "", masses, "the step, as the root of a bead's mass: joints stay as stiff"),
                Ladder("iterations", "", [s.iterations * n for n in factors]),
            ),
            defaults=(
                Variation(
                    "dt",
                    quantity(s.time_step, "s", 3),
                    "none; 1 ms is finer than its guides use",
                    {"time_step": DEFAULT_TIME_STEP, "steps_per_group": 1, "leak_interval": 1},
                    "length of a step; joints soften with its square",
                ),
                default_row(s, "iterations", DEFAULT_ITERATIONS, "iterations", "sweeps per step; joints stiffen in proportion"),
                default_row(
                    s,
                    "contact_slop",
                    DEFAULT_COLLISION_SLOP,
                    "collision_slop",
                    "how deep shapes may rest in one another; allowed for up to 1 mm",
                    "m",
                ),
                default_row(s, "contact_rate", DEFAULT_RATE, "collision_bias", "how fast a bead too deep comes out", "/s"),
                default_row(s, "error_rate", DEFAULT_RATE, "error_bias", "how fast a stretched joint returns", "/s"),
                default_row(
                    s,
                    "impulse_leak",
                    0.0,
                    "warm start",
                    "share of its last impulse that a joint forgets per second, which damps the spring that it acts as",
                    "/s",
                ),
            ),
            choices=(
                Variation("bead mass", f"{s.bead_mass_ratio:g} M1", "half", {"bead_mass_ratio": s.bead_mass_ratio / 2}),
                Variation("bead mass", f"{s.bead_mass_ratio:g} M1", "double", {"bead_mass_ratio": s.bead_mass_ratio * 2}),
                *CORNER_CHOICES,
                Variation("bead radius", f"{1e3 * s.bead_radius:g} mm", "half", {"bead_radius": s.bead_radius / 2}),
                Variation("forces and beads updated", f"every {s.steps_per_group} steps", "every 10", {"steps_per_group": 10}),
                Variation("leak of the warm start", f"{s.impulse_leak:g} /s", "double", {"impulse_leak": 2 * s.impulse_leak}),
                Variation("leak of the warm start", f"every {s.leak_interval} steps", "every step", {"leak_interval": 1}),
            ),
        )

    def provenance(self) -> Provenance:
        """Return versions, settings and suppliers, and whether the warm start leaks (pymunk had the private call)."""
        provenance = super().provenance()
        is_leaky = private_library() is not None
        return dataclasses.replace(provenance, settings=provenance.settings | {"leaky_warm_start": is_leaky})


def engines(profile: Profile) -> list[Engine]:
    """Return every variant of this engine with the settings of ``profile``."""
    return [PymunkChain(profile=profile)]
