"""Rapier, through rapier3d: beads that slide over a fixed cylinder under Coulomb contact; no capstan law is fed in.

Offered through the entry point that a third party uses.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from looping_pendulum.engines.bead_rig import JointRig
from looping_pendulum.engines.chain import (
    NO_STOP,
    ONE_COEFFICIENT,
    STRAIGHT_STRING,
    BeadChainSettings,
    bead_abilities,
    bead_choices,
    bend_rungs,
)
from looping_pendulum.engines.protocol import Engine, Profile, SteppedEngine
from looping_pendulum.engines.studies import Ladder, Studies, Variation, default_row
from looping_pendulum.pages.numbers import quantity
from looping_pendulum.reference_ode.cartesian import Vector
from looping_pendulum.runs.trajectory import SAMPLE_INTERVAL


@dataclass(frozen=True, kw_only=True)
class RapierChainSettings(BeadChainSettings):
    """Numerical settings of the bead chain, in SI units."""

    iterations: int
    """Number of times that joints and contacts are solved in a sub-step (num_internal_pgs_iterations)."""
    sub_steps: int = 1
    """Number of sub-steps of the solver in a step, for which contacts keep their directions (num_solver_iterations)."""
    contact_hertz: float = 1e6
    """Frequency of the contacts with the rod [Hz] (static_contact_softness), as high as Rapier's of joints."""
    friction_in_bias_pass: bool = True
    """Whether friction is solved before places move in a sub-step, too, and not only after it."""
    contact_recycling: bool = False
    """Whether a contact keeps its direction until its bodies have moved by 50 mm against each other."""
    sleeping: bool = False
    """Whether bodies that move slowly for a while fall asleep, until something wakes them."""
    locked_plane: bool = False
    """Whether the bodies' axis z is locked, by which friction loses a third; without it they stay in the plane all the same."""


SETTINGS = {
    Profile.QUICK: RapierChainSettings(time_step=1e-5, iterations=32, bend=0.28, bead_mass_ratio=1e-4),
    Profile.ACCURATE: RapierChainSettings(time_step=1e-5, iterations=64, bend=0.2, bead_mass_ratio=1e-4),
}


ROD, BEAD = 1, 2
"""Collision groups, as bits."""


class RapierRig(JointRig):
    """The apparatus in Rapier, in which only beads and the rod touch each other."""

    def _create_world(self) -> None:
        import rapier3d

        settings = self._settings
        self._rapier = rapier3d
        self._world = rapier3d.PhysicsWorld(gravity=(0.0, -self._parameters.coefficients["gravity"], 0.0))
        # A few dozen bodies are too few for more, and the other processor has another engine to run
        self._world.set_num_threads(1)
        solver = self._world.integration_parameters
        solver.dt = settings.time_step
        solver.num_solver_iterations = settings.sub_steps
        solver.num_internal_pgs_iterations = settings.iterations
        solver.friction_in_bias_pass = settings.friction_in_bias_pass
        solver.contact_recycling = settings.contact_recycling
        solver.static_contact_softness = rapier3d.SpringCoefficients(natural_frequency=settings.contact_hertz)

    def _add_rod(self, radius: float, friction: float) -> None:
        self._friction = friction
        # Rapier's cylinders lie along y
        cylinder = self._rapier.Collider.cylinder(radius, radius).rotation((math.pi / 2, 0.0, 0.0))
        self._world.add_body(self._rapier.RigidBody.fixed(), [self._with_material(cylinder, member=ROD, touches=BEAD)])

    def _create_bead(self, position: Vector, velocity: Vector, mass: float) -> Any:
        ball = self._rapier.Collider.ball(self._settings.bead_radius)
        return self._add(position, velocity, mass, [self._with_material(ball, member=BEAD, touches=ROD)])

    def _create_mass(self, position: Vector, velocity: Vector, mass: float) -> Any:
        return self._add(position, velocity, mass, [])

    def _create_held(self, position: Vector) -> Any:
        return self._world.add_body(self._rapier.RigidBody.fixed().translation((*position, 0.0)))

    def _create_straight(self, a: Any, b: Any, length: float) -> Any:
        return self._world.impulse_joints.insert(a, b, self._rapier.RopeJoint(length))

    # Rapier's joints keep a distance only from above, so links between beads are ropes, too
    _create_link = _create_straight

    def _remove_joint(self, joint: Any) -> None:
        self._world.impulse_joints.remove(joint)

    def _remove_body(self, bead: Any) -> None:
        self._world.remove_body(bead)

    def _take_steps(self, count: int, forces: Sequence[tuple[Any, Vector]]) -> None:
        for handle, (fx, fy) in forces:
            body = self._world.rigid_bodies[handle]
            # Rapier keeps a force for all later steps
            body.reset_forces()
            body.add_force((fx, fy, 0.0))
        for _ in range(count):
            self._world.step()

    def _position_of(self, body: Any) -> Vector:
        place = self._world.rigid_bodies[body].translation
        return place.x, place.y

    def _velocity_of(self, body: Any) -> Vector:
        velocity = self._world.rigid_bodies[body].linvel
        return velocity.x, velocity.y

    def _add(self, position: Vector, velocity: Vector, mass: float, colliders: list[Any]) -> Any:
        body = (
            self._rapier.RigidBody.dynamic()
            .translation((*position, 0.0))
            .linvel((*velocity, 0.0))
            .additional_mass(mass)
            .can_sleep(self._settings.sleeping)
            .enabled_translations((True, True, not self._settings.locked_plane))
            .enabled_rotations((False, False, False))
        )
        return self._world.add_body(body, colliders)

    def _with_material(self, collider: Any, *, member: int, touches: int) -> Any:
        group = self._rapier.Group
        return (
            # Rapier takes the mean of two coefficients, which for equal ones is their own
            collider.density(0.0)
            .friction(self._friction)
            .collision_groups(self._rapier.InteractionGroups(group(member), group(touches)))
        )


_LIMITS = (
    ONE_COEFFICIENT,
    "rapier3d computes in single precision, and PyPI has no Rapier of double precision: each step rounds places and "
    "velocities, so that the accurate profile is hardly better than the quick one, and shorter steps make the path worse",
    STRAIGHT_STRING,
    NO_STOP,
)


class RapierChain(SteppedEngine):
    """A chain of beads over a fixed cylinder."""

    name = "rapier"
    distribution = "rapier3d"
    variant = "chain"
    rig = RapierRig
    settings_by_profile = SETTINGS
    settings: RapierChainSettings
    abilities = bead_abilities(
        "rapier:chain",
        rod="fixed cylinder",
        stick_slip="the solver clamps friction to its cone",
        packages=("rapier3d",),
        summary="Point beads on ropes over a fixed cylinder, one rope for each straight part of the string.",
        limits=_LIMITS,
        bead_mass_ratio=SETTINGS[Profile.QUICK].bead_mass_ratio,
        main=False,
    )

    def studies(self) -> Studies:
        """Return ladders of step, iterations, links and mass, Rapier's defaults, and the adapter's choices."""
        s = self.settings
        return Studies(
            ladders=(
                Ladder("time_step", "s", (4e-5, 2e-5, 1e-5, 5e-6)),
                Ladder("iterations", "", (8, 16, 32, 64)),
                bend_rungs(s, (0.4, 0.28, 0.2, 0.14)),
                Ladder("bead_mass_ratio", "", (4e-4, 2e-4, 1e-4, 5e-5)),
            ),
            defaults=(
                Variation(
                    "dt",
                    quantity(s.time_step, "s", 3),
                    "1/60 s; 1 ms, the sample interval, is as long as a step may be here",
                    {"time_step": SAMPLE_INTERVAL, "steps_per_group": 1},
                    "length of a step, during which a contact keeps its direction",
                ),
                default_row(
                    s,
                    "iterations",
                    1,
                    "num_internal_pgs_iterations",
                    "how often joints and contacts are solved in a sub-step; joints begin each time without a force",
                ),
                default_row(s, "sub_steps", 4, "num_solver_iterations", "number of sub-steps in a step"),
                default_row(s, "contact_hertz", 60.0, "static_contact_softness", "how stiff contacts with the rod are", "Hz"),
                default_row(
                    s,
                    "friction_in_bias_pass",
                    False,
                    "friction_in_bias_pass",
                    "whether friction is solved before places move, too; without it a held string creeps twice as far",
                ),
                default_row(
                    s,
                    "contact_recycling",
                    True,
                    "contact_recycling",
                    "a contact keeps its direction until its bodies have moved by 0.05 length units",
                ),
                default_row(s, "sleeping", True, "can_sleep", "bodies slower than 0.05 units per second stop after 0.5 s"),
            ),
            choices=(
                Variation("bead mass", f"{s.bead_mass_ratio:g} M1", "double", {"bead_mass_ratio": 2 * s.bead_mass_ratio}),
                Variation("plane of motion", "kept, as nothing pushes out of it", "axis z locked", {"locked_plane": True}),
                *bead_choices(s),
                Variation("contact frequency", f"{1e-6 * s.contact_hertz:g} MHz", "10 kHz", {"contact_hertz": 1e4}),
            ),
        )


def engines(profile: Profile) -> list[Engine]:
    """Return every variant of this engine with the settings of ``profile``."""
    return [RapierChain(profile=profile)]
