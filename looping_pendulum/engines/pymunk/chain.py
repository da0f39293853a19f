"""pymunk (Chipmunk): the string is a row of point-mass beads that slide over a static circle under Coulomb contact.

Chipmunk solves its joints by a few sweeps of projected Gauss-Seidel per step, each joint starting from its impulse of the step
before. A chain under tension then acts as a spring of stiffness about ``iterations * bead_mass / (links * time_step**2)``:
few links and a short step make it stiff. So there are beads only where the string touches the rod or is about to; a straight
part of the string is one massless joint. As the string slides or winds, the adapter adds and removes beads on the straight
parts, where they carry no lateral load; beads that touch the rod are moved by Chipmunk alone.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any

from looping_pendulum.engines.additions import measured_additions
from looping_pendulum.engines.chain import (
    BEADS_WEIGH,
    ONE_COEFFICIENT,
    STRAIGHT_STRING,
    SlipGauge,
    bead_supplies,
    point_on_string,
    polygon_friction,
    polygon_radius,
)
from looping_pendulum.engines.protocol import FORCES_AND_RELEASE, Abilities, Profile, TunedEngine
from looping_pendulum.engines.pymunk.calls import (
    MAX_SLOP_IN_RADIUS,
    PUBLIC_ERROR_RATE,
    SETTINGS,
    Calls,
    DirectCalls,
    PublicCalls,
    PymunkChainSettings,
    direct_library,
)
from looping_pendulum.engines.pymunk.release_state import Vector, bead_arcs, masses, velocity_on_string
from looping_pendulum.engines.pymunk.space_rig import SpaceRig
from looping_pendulum.engines.pymunk.studies import chain_studies
from looping_pendulum.engines.studies import Studies
from looping_pendulum.engines.trajectory import Provenance
from looping_pendulum.engines.validated import shipped_range
from looping_pendulum.reference_ode.parameters import Parameters, Release
from looping_pendulum.scenarios.scenario import Scenario

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


class _BeadString:
    """Light mass, beads and heavy mass in a row, joined by links; the first and the last link are the straight parts."""

    def __init__(self, space: Any, parameters: Parameters, settings: PymunkChainSettings, error_bias: float) -> None:
        import pymunk

        self._pymunk = pymunk
        self._space = space
        self._rod_radius = parameters.rod_radius
        self._link_length = parameters.rod_radius * settings.bend
        self._bead_mass = settings.bead_mass_ratio * parameters.light_mass
        self._bead_radius = settings.bead_radius
        self._error_bias = error_bias
        self._slip = SlipGauge()
        self._no_mutual_contact = pymunk.ShapeFilter(group=1)
        self._shapes: dict[Any, Any] = {}  # bead in the space -> its shape
        self._unused_beads: list[tuple[Any, Any]] = []  # removed beads, kept for reuse
        radius, friction = parameters.rod_radius, parameters.coefficients["kinetic_friction"]
        node_radius = polygon_radius(radius, settings.bend) if settings.polygon_radius else radius
        slop = min(settings.contact_slop, MAX_SLOP_IN_RADIUS)
        rod = pymunk.Circle(space.static_body, node_radius - settings.bead_radius + slop)
        rod.friction = polygon_friction(friction, settings.bend) if settings.polygon_friction else friction
        space.add(rod)
        light, heavy = masses(space, parameters)
        arcs = bead_arcs(parameters, self._link_length, ADD_WITHIN_LINKS)
        beads = [self._bead(point_on_string(parameters, a, node_radius), velocity_on_string(parameters, a)) for a in arcs]
        self.bodies = [light, *beads, heavy]
        pairs = list(zip(self.bodies[:-1], self.bodies[1:], strict=True))
        self.lengths = [a.position.get_distance(b.position) for a, b in pairs]
        last = len(pairs) - 1
        self._links = [
            self._straight(a, b, length) if i in (0, last) else self._link(a, b, length)
            for i, ((a, b), length) in enumerate(zip(pairs, self.lengths, strict=True))
        ]

    def update_beads(self, calls: Calls) -> None:
        """Add or remove a bead on either straight part, so that there are beads where the string will meet the rod."""
        if self._needs_update(calls, 1, 2):
            self._update_first_end(calls)
        # The same two beads, counted from the other end
        if self._needs_update(calls, -2, -3):
            self._reverse()
            self._update_first_end(calls)
            self._reverse()

    def _needs_update(self, calls: Calls, outermost: int, second: int) -> bool:
        """Return whether the outermost bead of a side is near its tangent point, or the second one far from it."""
        if self._tangent_distance(calls, outermost) < ADD_WITHIN_LINKS * self._link_length:
            return True
        return self._tangent_distance(calls, second) > REMOVE_BEYOND_LINKS * self._link_length

    def _reverse(self) -> None:
        """Reverse the row, so that one method serves both ends."""
        for row in (self.bodies, self._links, self.lengths):
            row.reverse()

    def _update_first_end(self, calls: Calls) -> None:
        """Add or remove a bead on the straight part at the row's first end."""
        if self._tangent_distance(calls, 1) < ADD_WITHIN_LINKS * self._link_length:
            if self.lengths[0] > 2 * self._link_length:
                self._add_bead(calls)
        elif (
            len(self.bodies) - 2 > MIN_BEADS
            and self._tangent_distance(calls, 2) > REMOVE_BEYOND_LINKS * self._link_length
            and self.bodies[0].position.get_distance(self.bodies[1].position) > (1 - MAX_SLACK_FRACTION) * self.lengths[0]
        ):
            self._remove_bead()

    def _tangent_distance(self, calls: Calls, index: int) -> float:
        """Return the length [m] of the tangent from body ``index`` to the rod; 0 on the rod."""
        x, y = calls.position(self.bodies[index])
        return math.sqrt(max(x * x + y * y - self._rod_radius**2, 0.0))

    def _add_bead(self, calls: Calls) -> None:
        """Put a new bead where the outermost one is, and move the outermost one a link towards the mass.

        So the straight part keeps its joint, and with it the warm-start impulse that carries the mass.
        """
        mass, end, following = self.bodies[:3]
        share = self._link_length / self.lengths[0]
        x, y, vx, vy = calls.position_and_velocity(end)
        mass_x, mass_y, mass_vx, mass_vy = calls.position_and_velocity(mass)
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
        bead, shape = self._unused_beads.pop() if self._unused_beads else self._new_bead()
        bead.position, bead.velocity = position, velocity
        self._space.add(bead, shape)
        self._shapes[bead] = shape
        return bead

    def _new_bead(self) -> tuple[Any, Any]:
        # An infinite moment of inertia: beads are points, which slide and do not roll
        body = self._pymunk.Body(self._bead_mass, math.inf)
        shape = self._pymunk.Circle(body, self._bead_radius)
        shape.friction = 1.0  # Chipmunk multiplies the two shapes' coefficients: the circle's is then the pair's
        shape.filter = self._no_mutual_contact
        return body, shape

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

    def read(self, calls: Calls) -> tuple[float, float]:
        """Return the string's stretch beyond its rest length (negative: it hangs slack) and its slip over the rod [m]."""
        places = [calls.position(body) for body in self.bodies]
        stretch = math.fsum(map(math.dist, places[:-1], places[1:])) - math.fsum(self.lengths)
        return stretch, self._slip.read(places, self.lengths)


def space_with_gravity(parameters: Parameters, settings: PymunkChainSettings) -> Any:
    """Create a Chipmunk space with gravity and the solver's settings, and nothing in it."""
    import pymunk

    space = pymunk.Space()
    space.gravity = (0.0, -parameters.coefficients["gravity"])
    space.damping = 1.0  # fraction of the speed kept per second: drag is applied as forces of the scenario's effects
    space.iterations = settings.iterations
    space.collision_slop = settings.contact_slop
    space.collision_bias = math.exp(-settings.contact_rate)  # fraction of an error left after a second
    return space


class PymunkChainRig(SpaceRig):
    """The apparatus in one Chipmunk space.

    Parameters
    ----------
    library
        Chipmunk's functions below pymunk (`direct_library`); None: published calls only, without the leaky warm start.
    """

    def __init__(self, parameters: Parameters, settings: PymunkChainSettings, library: Any) -> None:
        super().__init__(parameters, settings)
        self._space = space = space_with_gravity(parameters, settings)
        if library is None:
            self._calls, error_rate = PublicCalls(space, settings.time_step), PUBLIC_ERROR_RATE
        else:
            self._calls, error_rate = DirectCalls(library, space, settings), settings.error_rate
        self._string: _BeadString | None = None
        if parameters.release is Release.DROP:
            self._light, self._heavy = masses(space, parameters)
        else:
            self._string = _BeadString(space, parameters, settings, math.exp(-error_rate))
            self._light, self._heavy = self._string.bodies[0], self._string.bodies[-1]

    def _update_beads(self) -> None:
        if self._string is not None:
            self._string.update_beads(self._calls)

    def _read_string(self, light: Vector, heavy: Vector) -> tuple[float, float]:
        return (math.nan, math.nan) if self._string is None else self._string.read(self._calls)


_LIMITS = (
    ONE_COEFFICIENT,
    "damps its joints through a private pymunk call (a leaky warm start); where a pymunk lacks it the chain is softer (at ten "
    "to one, quick: 0.99 mm of stretch for 0.13 mm) and provenance.settings says leaky_warm_start: False",
    STRAIGHT_STRING,
    "a slack string that jerks taut bounces: the chain takes the pull as a spring, where the reference's pull is inelastic",
)


class PymunkChain(TunedEngine):
    """Chain of beads over a static circle."""

    name = "pymunk"
    distribution = "pymunk"
    variant = "chain"
    abilities = Abilities(
        quick_cost=7.0,
        releases=frozenset(Release),
        effect_kinds=FORCES_AND_RELEASE,
        supplies=bead_supplies("static circle", "the solver clamps friction to its cone"),
        packages=("pymunk",),
        summary="Point beads on pin joints over a static circle, a slide joint for each straight part of the string.",
        limits=_LIMITS,
        additions=(
            *measured_additions("pymunk:chain"),
            BEADS_WEIGH.format(100 * SETTINGS[Profile.QUICK].bead_mass_ratio),
        ),
        validated=shipped_range("pymunk:chain"),
    )
    settings_by_profile = SETTINGS
    settings: PymunkChainSettings

    def __init__(self, *, profile: Profile = Profile.QUICK, settings: PymunkChainSettings | None = None) -> None:
        super().__init__(profile=profile, settings=settings)
        self._leaky = True

    def build(self, scenario: Scenario) -> PymunkChainRig:
        """Build the scenario's apparatus at the moment of release."""
        library = direct_library()
        self._leaky = library is not None
        return PymunkChainRig(scenario.parameters, self.settings, library)

    def studies(self) -> Studies:
        """Return the ladders of refinement, Chipmunk's defaults one at a time, and the adapter's choices."""
        return chain_studies(self.settings, self.with_settings)

    def provenance(self) -> Provenance:
        """Return versions, settings and suppliers, and whether the warm start leaks (pymunk had the private call)."""
        provenance = super().provenance()
        return dataclasses.replace(provenance, settings=provenance.settings | {"leaky_warm_start": self._leaky})
