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
from dataclasses import dataclass
from typing import Any

from looping_pendulum.engines.chain import (
    BEAD_RADIUS,
    CORNER_CHOICES,
    ONE_COEFFICIENT,
    STRAIGHT_STRING,
    SlipGauge,
    bead_abilities,
    point_on_string,
    polygon_friction,
    polygon_radius,
)
from looping_pendulum.engines.protocol import Engine, Profile, TunedEngine, groups_per_sample
from looping_pendulum.engines.studies import DefaultRow, Studies, studies_from_rows
from looping_pendulum.pages.numbers import quantity
from looping_pendulum.reference_ode.cartesian import MassesAtRelease, Vector, cartesian_force, masses_at_release
from looping_pendulum.reference_ode.parameters import Parameters, Release
from looping_pendulum.runs.trajectory import Provenance
from looping_pendulum.scenarios.scenario import Scenario

DEFAULT_TIME_STEP = 1e-3
"""Step of the studies' defaults [s]. Chipmunk has no default step; this is ten times finer than what its guides use."""
DEFAULT_ITERATIONS = 10
"""Chipmunk's default number of solver iterations per step."""
DEFAULT_COLLISION_SLOP = 0.1
"""Chipmunk's default penetration that contacts leave uncorrected, in units of length: here 10 cm."""
DEFAULT_RATE = -60 * math.log(1 - 0.1)
"""Chipmunk's default rate of error correction [1/s]: a tenth of the error in every sixtieth of a second."""
DEFAULT_RATE_TEXT = f"a tenth of it every 1/60 s ({DEFAULT_RATE:.1f} /s)"
MAX_SLOP_IN_RADIUS = 1e-3
"""Largest penetration slop that the circle's radius makes up for [m]; Chipmunk's default slop, 10 cm, exceeds the rod."""


@dataclass(frozen=True, kw_only=True)
class PymunkChainSettings:
    """Numerical settings of the bead chain."""

    time_step: float
    """Length of a step [s]; it must divide the sample interval."""
    bend: float
    """Angle between neighbouring links on the rod [rad]; a link is R times this long."""
    bead_mass_ratio: float
    """Mass of one bead over the light mass. Lighter: a softer chain; heavier: the string's own inertia shows."""
    iterations: int = 20
    """Iterations (sweeps over all constraints) of the solver per step."""
    impulse_leak: float = 150.0
    """Rate at which joints forget their warm-start impulse [1/s].

    Warm starting makes the chain act as an undamped spring; the leak damps it.
    """
    leak_interval: int = 5
    """Steps between two leaks of the warm-start impulse, each for the whole interval, as a leak costs a call.

    It must divide `force_interval`.
    """
    error_rate: float = 100.0
    """Rate at which joints correct their length error [1/s]; above `impulse_leak` the chain's oscillations grow."""
    contact_rate: float = 100.0
    """Rate at which contacts correct penetration beyond `contact_slop` [1/s]."""
    bead_radius: float = BEAD_RADIUS
    """Radius of a bead [m]; the rod's circle is smaller by as much, so that the bead's centre moves where the string should."""
    contact_slop: float = 1e-5
    """Depth to which beads rest in the circle [m]; allowed for in its radius."""
    force_interval: int = 50
    """Steps between two updates of the drag forces and of the beads on the straight parts; a test compares it with 1."""
    polygon_friction: bool = True
    """Whether the contact's friction is corrected for the polygon that the beads' links are."""
    polygon_radius: bool = True
    """Whether the beads' circle is corrected for it."""

    def __post_init__(self) -> None:
        """Raise ValueError where leaks do not divide a group, EngineError where groups do not divide the sample interval."""
        if self.force_interval % self.leak_interval:
            raise ValueError(
                f"leak_interval: found {self.leak_interval}, needed a divisor of force_interval, {self.force_interval}"
            )
        groups_per_sample(self.time_step, self.force_interval)


SETTINGS = {
    Profile.QUICK: PymunkChainSettings(time_step=5e-6, bend=0.28, bead_mass_ratio=2e-4),
    Profile.ACCURATE: PymunkChainSettings(time_step=2e-6, bend=0.24, bead_mass_ratio=1e-4),
}

DIRECT_CALLS = ("cpBodyGetPosition", "cpBodyGetVelocity", "cpBodySetForce", "cpSpaceSetCurrentTimeStep", "cpSpaceStep")
"""Chipmunk functions that pymunk calls itself but does not publish."""


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
MAX_SLACK_FRACTION = 1e-3
"""Largest fraction by which the ends of a straight part may be nearer than its string is long, for a bead to be removed.

Beyond it that part hangs slack, and its beads are kept.
"""


class PublicCalls:
    """The calls to Chipmunk that a rig makes at every step, by pymunk's published interface only."""

    def __init__(self, space: Any, time_step: float) -> None:
        self._space = space
        self._time_step = time_step

    def step(self, count: int) -> None:
        """Take ``count`` steps."""
        for _ in range(count):
            self._space.step(self._time_step)

    def position(self, body: Any) -> tuple[float, float]:
        """Return the position [m] of ``body``: x, y."""
        return (*body.position,)

    def position_and_velocity(self, body: Any) -> tuple[float, float, float, float]:
        """Return position [m] and velocity [m/s] of ``body``: x, y, vx, vy."""
        return (*body.position, *body.velocity)

    def apply_force(self, body: Any, fx: float, fy: float) -> None:
        """Apply a force [N] to ``body`` during the next step only."""
        body.force = (fx, fy)


class DirectCalls(PublicCalls):
    """Call Chipmunk's functions below pymunk, which alone makes the leaky warm start possible.

    Chipmunk scales warm-start impulses by the new step over the previous one. If the previous step is set to
    dt / (1 - n leak dt) before a step, Chipmunk keeps the fraction 1 - n leak dt of the impulses, where n is the number of
    steps between two such settings.
    """

    def __init__(self, library: Any, space: Any, settings: PymunkChainSettings) -> None:
        self._library = library
        self._space = space._space
        self._time_step = settings.time_step
        self._interval = settings.leak_interval
        self._claimed_previous_step = settings.time_step / (1 - self._interval * settings.impulse_leak * settings.time_step)

    def step(self, count: int) -> None:
        """Take ``count`` steps."""
        space, time_step, claimed_previous_step = self._space, self._time_step, self._claimed_previous_step
        set_previous_step, step = self._library.cpSpaceSetCurrentTimeStep, self._library.cpSpaceStep
        interval = range(self._interval)
        for _ in range(count // self._interval):
            set_previous_step(space, claimed_previous_step)
            for _ in interval:
                step(space, time_step)

    def position(self, body: Any) -> tuple[float, float]:
        """Return the position [m] of ``body``: x, y."""
        position = self._library.cpBodyGetPosition(body._body)
        return position.x, position.y

    def position_and_velocity(self, body: Any) -> tuple[float, float, float, float]:
        """Return position [m] and velocity [m/s] of ``body``: x, y, vx, vy."""
        position = self._library.cpBodyGetPosition(body._body)
        velocity = self._library.cpBodyGetVelocity(body._body)
        return position.x, position.y, velocity.x, velocity.y

    def apply_force(self, body: Any, fx: float, fy: float) -> None:
        """Apply a force [N] to ``body`` during the next step only."""
        self._library.cpBodySetForce(body._body, (fx, fy))


def direct_library() -> Any:
    """Return Chipmunk's functions below pymunk, or None where this version of pymunk lacks one of `DIRECT_CALLS`."""
    try:
        library = importlib.import_module("pymunk._chipmunk").lib
    except (ImportError, AttributeError):
        return None
    return library if all(hasattr(library, name) for name in DIRECT_CALLS) else None


def bead_arcs(parameters: Parameters, link_length: float, margin: float) -> list[float]:
    """Return the distances [m] of the beads from the light mass along the string at release, a link apart.

    Beads lie on the rod and ``margin`` links beyond it on either side, but a link or more from either mass.
    """
    first = parameters.free_length - margin * link_length
    wound = parameters.rod_radius * parameters.release_angle
    count = math.ceil(wound / link_length + 2 * margin)
    arcs = (first + i * link_length for i in range(count + 1))
    return [arc for arc in arcs if link_length <= arc <= parameters.string_length - link_length]


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


def add_masses(space: Any, parameters: Parameters, masses: MassesAtRelease) -> tuple[Any, Any]:
    """Create the light and the heavy mass as bodies of ``space``, as they are released; a clamped mass is a static body."""
    import pymunk

    # An infinite moment of inertia: the masses are points, and joints at their centres exert no torque.
    light = pymunk.Body(parameters.light_mass, math.inf)
    if parameters.release is Release.HELD:
        heavy = pymunk.Body(body_type=pymunk.Body.STATIC)
    else:
        heavy = pymunk.Body(parameters.heavy_mass, math.inf)
    light.position, light.velocity = masses.light_position, masses.light_velocity
    heavy.position = point_on_string(parameters, parameters.string_length, parameters.rod_radius)
    if parameters.release is not Release.HELD:
        heavy.velocity = masses.heavy_velocity
    space.add(light, heavy)
    return light, heavy


class PymunkChainRig:
    """The apparatus in one Chipmunk space: masses and beads in a row; the first and the last link are the straight parts.

    Parameters
    ----------
    library
        Chipmunk's functions below pymunk (`direct_library`); None: published calls only, without the leaky warm start.
    """

    def __init__(self, parameters: Parameters, settings: PymunkChainSettings, library: Any) -> None:
        import pymunk

        p, s = parameters, settings
        self._pymunk, self._settings = pymunk, s
        self._space = space = pymunk.Space()
        space.gravity = (0.0, -p.coefficients["gravity"])
        space.iterations, space.collision_slop = s.iterations, s.contact_slop
        self._force = cartesian_force(p)
        self._clamped = p.release is Release.HELD
        self._groups = 0
        space.collision_bias = math.exp(-s.contact_rate)  # fraction of an error left after a second
        if library is None:
            self._calls, error_rate = PublicCalls(space, s.time_step), PUBLIC_ERROR_RATE
        else:
            self._calls, error_rate = DirectCalls(library, space, s), s.error_rate
        self._error_bias = math.exp(-error_rate)
        self._rod_radius = p.rod_radius
        self._link_length = p.rod_radius * s.bend
        self._bead_mass = s.bead_mass_ratio * p.light_mass
        self._slip = SlipGauge()
        self._no_mutual_contact = pymunk.ShapeFilter(group=1)
        self._shapes: dict[Any, Any] = {}  # bead in the space -> its shape
        self._unused_beads: list[tuple[Any, Any]] = []  # removed beads, kept for reuse
        self._has_string = p.release is not Release.DROP
        if self._has_string:
            self._add_string(p, masses_at_release(p))
        else:
            self._light, self._heavy = add_masses(space, p, masses_at_release(p))

    def advance(self) -> None:
        """Advance the simulation by one `SAMPLE_INTERVAL`."""
        group = self._settings.force_interval
        for _ in range(groups_per_sample(self._settings.time_step, group)):
            if self._has_string:
                self._update_beads()
            self._apply_effect_forces(group)
            self._calls.step(group)
            self._groups += 1

    def read(self) -> tuple[float, ...]:
        """Return positions [m], velocities [m/s], string stretch and slip [m]: `COLUMNS` without the time."""
        lx, ly, lvx, lvy = self._calls.position_and_velocity(self._light)
        hx, hy, hvx, hvy = self._calls.position_and_velocity(self._heavy)
        return lx, ly, lvx, lvy, hx, hy, hvx, hvy, *self._read_string()

    def _apply_effect_forces(self, group: int) -> None:
        """Apply the effects' forces for a whole group of steps in its first step, as Chipmunk clears forces after each step.

        The first group gets half of its impulse, so that on average over a group the speeds are neither early nor late.
        """
        if self._force is None:
            return
        share = group if self._groups else 0.5 * group
        time = self._groups * group * self._settings.time_step
        heavy_vy = self._calls.position_and_velocity(self._heavy)[3]
        fx, fy, heavy_fy = self._force(time, *self._calls.position_and_velocity(self._light), heavy_vy)
        self._calls.apply_force(self._light, share * fx, share * fy)
        if not self._clamped:
            self._calls.apply_force(self._heavy, 0.0, share * heavy_fy)

    def _add_string(self, p: Parameters, masses: MassesAtRelease) -> None:
        """Add the rod, the masses, and the string with the release's velocities."""
        s, friction = self._settings, p.coefficients["kinetic_friction"]
        node_radius = polygon_radius(p.rod_radius, s.bend) if s.polygon_radius else p.rod_radius
        slop = min(s.contact_slop, MAX_SLOP_IN_RADIUS)
        rod = self._pymunk.Circle(self._space.static_body, node_radius - s.bead_radius + slop)
        rod.friction = polygon_friction(friction, s.bend) if s.polygon_friction else friction
        self._space.add(rod)
        self._light, self._heavy = add_masses(self._space, p, masses)
        arcs = bead_arcs(p, self._link_length, ADD_WITHIN_LINKS)
        beads = [self._bead(point_on_string(p, a, node_radius), velocity_on_string(p, masses, a)) for a in arcs]
        self.bodies = [self._light, *beads, self._heavy]
        pairs = list(zip(self.bodies[:-1], self.bodies[1:], strict=True))
        self.lengths = [a.position.get_distance(b.position) for a, b in pairs]
        last = len(pairs) - 1
        self._links = [
            self._straight(a, b, length) if i in (0, last) else self._link(a, b, length)
            for i, ((a, b), length) in enumerate(zip(pairs, self.lengths, strict=True))
        ]

    def _update_beads(self) -> None:
        """Add or remove a bead on either straight part, so that there are beads where the string will meet the rod."""
        if self._needs_update(1, 2):
            self._update_first_end()
        # The same two beads, counted from the other end
        if self._needs_update(-2, -3):
            self._reverse()
            self._update_first_end()
            self._reverse()

    def _needs_update(self, outermost: int, second: int) -> bool:
        """Return whether the outermost bead of a side is near its tangent point, or the second one far from it."""
        if self._tangent_distance(outermost) < ADD_WITHIN_LINKS * self._link_length:
            return True
        return self._tangent_distance(second) > REMOVE_BEYOND_LINKS * self._link_length

    def _reverse(self) -> None:
        """Reverse the row, so that one method serves both ends."""
        for row in (self.bodies, self._links, self.lengths):
            row.reverse()

    def _update_first_end(self) -> None:
        """Add or remove a bead on the straight part at the row's first end."""
        if self._tangent_distance(1) < ADD_WITHIN_LINKS * self._link_length:
            if self.lengths[0] > 2 * self._link_length:
                self._add_bead()
        elif (
            len(self.bodies) - 2 > MIN_BEADS
            and self._tangent_distance(2) > REMOVE_BEYOND_LINKS * self._link_length
            and self.bodies[0].position.get_distance(self.bodies[1].position) > (1 - MAX_SLACK_FRACTION) * self.lengths[0]
        ):
            self._remove_bead()

    def _tangent_distance(self, index: int) -> float:
        """Return the length [m] of the tangent from body ``index`` to the rod; 0 on the rod."""
        x, y = self._calls.position(self.bodies[index])
        return math.sqrt(max(x * x + y * y - self._rod_radius**2, 0.0))

    def _add_bead(self) -> None:
        """Put a new bead where the outermost one is, and move the outermost one a link towards the mass.

        So the straight part keeps its joint, and with it the warm-start impulse that carries the mass.
        """
        mass, end, following = self.bodies[:3]
        share = self._link_length / self.lengths[0]
        x, y, vx, vy = self._calls.position_and_velocity(end)
        mass_x, mass_y, mass_vx, mass_vy = self._calls.position_and_velocity(mass)
        bead = self._bead((x, y), (vx, vy))
        end.position = x + (mass_x - x) * share, y + (mass_y - y) * share
        end.velocity = vx + (mass_vx - vx) * share, vy + (mass_vy - vy) * share
        # A joint cannot change its bodies, so the links beside the new bead are created anew
        self._space.remove(self._links[1])
        self._set_straight(self.lengths[0] - self._link_length)
        self.lengths.insert(1, self._link_length)
        self.bodies.insert(2, bead)
        self._links[1:2] = [self._link(end, bead, self.lengths[1]), self._link(bead, following, self.lengths[2])]

    def _remove_bead(self) -> None:
        """Remove the second bead and put the outermost one in its place, so that the straight part keeps its joint."""
        end, bead, following = self.bodies[1:4]
        shape = self._shapes.pop(bead)
        self._space.remove(self._links[1], self._links[2], bead, shape)
        self._unused_beads.append((bead, shape))
        end.position, end.velocity = bead.position, bead.velocity
        del self.bodies[2]
        self._set_straight(self.lengths[0] + self.lengths.pop(1))
        self._links[1:3] = [self._link(end, following, self.lengths[1])]

    def _bead(self, position: tuple[float, float], velocity: tuple[float, float]) -> Any:
        if self._unused_beads:
            bead, shape = self._unused_beads.pop()
        else:
            # An infinite moment of inertia: beads are points, which slide and do not roll
            bead = self._pymunk.Body(self._bead_mass, math.inf)
            shape = self._pymunk.Circle(bead, self._settings.bead_radius)
            shape.friction = 1.0  # Chipmunk multiplies the two shapes' coefficients: the circle's is then the pair's
            shape.filter = self._no_mutual_contact
        bead.position, bead.velocity = position, velocity
        self._space.add(bead, shape)
        self._shapes[bead] = shape
        return bead

    def _link(self, a: Any, b: Any, length: float) -> Any:
        joint = self._pymunk.PinJoint(a, b)
        joint.distance = length
        return self._join(joint)

    def _straight(self, a: Any, b: Any, length: float) -> Any:
        # From 0 to the length: it pulls, and never pushes
        return self._join(self._pymunk.SlideJoint(a, b, (0, 0), (0, 0), 0, length))

    def _join(self, joint: Any) -> Any:
        joint.error_bias = self._error_bias
        self._space.add(joint)
        return joint

    def _set_straight(self, length: float) -> None:
        self.lengths[0] = length
        self._links[0].max = length

    def _read_string(self) -> Vector:
        """Return the string's stretch beyond its rest length and its slip over the rod [m]; NaN without a string."""
        if not self._has_string:
            return math.nan, math.nan
        places = [self._calls.position(body) for body in self.bodies]
        stretch = math.fsum(map(math.dist, places[:-1], places[1:])) - math.fsum(self.lengths)
        return stretch, self._slip.read(places, self.lengths)


def step_default(settings: Any, **with_long_step: int) -> DefaultRow:
    """Return the long step as a hidden default; ``with_long_step`` are intervals in steps, for which it has room for one."""
    changes = {"time_step": DEFAULT_TIME_STEP, "force_interval": 1} | with_long_step
    effect = "length of a step; joints soften with its square"
    return "dt", "none; 1 ms is finer than its guides use", quantity(settings.time_step, "s", 3), effect, changes


def iterations_default(settings: Any) -> DefaultRow:
    """Return Chipmunk's number of iterations as a hidden default."""
    effect = "sweeps of the solver per step; joints stiffen in proportion"
    return "iterations", f"{DEFAULT_ITERATIONS}", f"{settings.iterations}", effect, {"iterations": DEFAULT_ITERATIONS}


def slop_default(settings: Any, field: str) -> DefaultRow:
    """Return Chipmunk's slop as a hidden default of the setting ``field``."""
    effect, ours = "how deep shapes may rest in one another; the adapter allows for it up to 1 mm", getattr(settings, field)
    return "collision_slop", "0.1 units of length: 10 cm", quantity(ours, "m", 3), effect, {field: DEFAULT_COLLISION_SLOP}


def error_bias_default(settings: Any) -> DefaultRow:
    """Return Chipmunk's rate of the joints as a hidden default."""
    effect = "how fast a stretched joint returns to its length"
    return "error_bias", DEFAULT_RATE_TEXT, f"{settings.error_rate:g} /s", effect, {"error_rate": DEFAULT_RATE}


class PymunkChain(TunedEngine):
    """Chain of beads over a static circle."""

    name = "pymunk"
    distribution = "pymunk"
    variant = "chain"
    settings_by_profile = SETTINGS
    settings: PymunkChainSettings
    abilities = bead_abilities(
        "pymunk:chain",
        quick_cost=7.0,
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

    _leaky = True

    def build(self, scenario: Scenario) -> PymunkChainRig:
        """Build the scenario's apparatus at the moment of release."""
        library = direct_library()
        self._leaky = library is not None
        return PymunkChainRig(scenario.parameters, self.settings, library)

    def studies(self) -> Studies:
        """Return the ladders of refinement, Chipmunk's defaults one at a time, and the adapter's choices."""
        s = self.settings
        # No rung is coarser than the settings: joints are springs that soften with the square of the step, and a string that
        # has stretched by millimetres halts by another motion
        factors = (1, 2, 4, 8)
        masses = [{"bead_mass_ratio": s.bead_mass_ratio / n**2, "time_step": s.time_step / n} for n in factors]
        return studies_from_rows(
            self,
            ladders=(
                ("time_step", "s", [s.time_step / n for n in factors]),
                ("bend", "rad", [s.bend / math.sqrt(n) for n in factors]),
                ("bead_mass_ratio", "", masses, "the step, as the root of a bead's mass, so that the joints stay as stiff"),
                ("iterations", "", [s.iterations * n for n in factors]),
            ),
            defaults=(
                step_default(s, leak_interval=1),
                iterations_default(s),
                slop_default(s, "contact_slop"),
                (
                    "collision_bias",
                    DEFAULT_RATE_TEXT,
                    f"{s.contact_rate:g} /s",
                    "how fast a bead too deep in the circle comes out",
                    {"contact_rate": DEFAULT_RATE},
                ),
                error_bias_default(s),
                (
                    "warm start",
                    "each joint starts from its last impulse",
                    f"a share of {s.impulse_leak:g} /s of it is forgotten",
                    "what damps the spring that the joints act as",
                    {"impulse_leak": 0.0},
                ),
            ),
            choices=(
                ("bead mass", f"{s.bead_mass_ratio:g} M1", "half", {"bead_mass_ratio": s.bead_mass_ratio / 2}),
                ("bead mass", f"{s.bead_mass_ratio:g} M1", "double", {"bead_mass_ratio": s.bead_mass_ratio * 2}),
                *CORNER_CHOICES,
                ("bead radius", f"{1e3 * s.bead_radius:g} mm", "half", {"bead_radius": s.bead_radius / 2}),
                ("forces and beads updated", f"every {s.force_interval} steps", "every 10", {"force_interval": 10}),
                ("leak of the warm start", f"{s.impulse_leak:g} /s", "double", {"impulse_leak": 2 * s.impulse_leak}),
                ("leak of the warm start", f"every {s.leak_interval} steps", "every step", {"leak_interval": 1}),
            ),
        )

    def provenance(self) -> Provenance:
        """Return versions, settings and suppliers, and whether the warm start leaks (pymunk had the private call)."""
        provenance = super().provenance()
        return dataclasses.replace(provenance, settings=provenance.settings | {"leaky_warm_start": self._leaky})


def engines(profile: Profile) -> list[Engine]:
    """Return every variant of this engine with the settings of ``profile``."""
    return [PymunkChain(profile=profile)]
