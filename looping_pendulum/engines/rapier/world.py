"""Rapier's world: bodies, joints and contacts as the chain needs them, in the plane z = 0."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from looping_pendulum.engines.bead_rig import Vector
from looping_pendulum.engines.rapier.settings import RapierChainSettings
from looping_pendulum.reference_ode.parameters import Parameters

ROD, BEAD = 1, 2
"""Collision groups, as bits."""


class RapierWorld:
    """A world of Rapier in SI units, in which only beads and the rod touch each other."""

    def __init__(self, parameters: Parameters, settings: RapierChainSettings) -> None:
        import rapier3d

        self._rapier, self._settings = rapier3d, settings
        self._world = rapier3d.PhysicsWorld(gravity=(0.0, -parameters.coefficients["gravity"], 0.0))
        # A few dozen bodies are too few for more, and the other processor has another engine to run
        self._world.set_num_threads(1)
        solver = self._world.integration_parameters
        solver.dt = settings.time_step
        solver.num_solver_iterations = settings.sub_steps
        solver.num_internal_pgs_iterations = settings.iterations
        solver.friction_in_bias_pass = settings.friction_in_bias_pass
        solver.contact_recycling = settings.contact_recycling
        solver.static_contact_softness = rapier3d.SpringCoefficients(natural_frequency=settings.contact_hertz)

    def add_rod(self, radius: float, friction: float) -> None:
        """Add a fixed cylinder of ``radius`` [m] along z through the origin, and let beads have the ``friction`` on it."""
        self._friction = friction
        # Rapier's cylinders lie along y
        cylinder = self._rapier.Collider.cylinder(radius, radius).rotation((math.pi / 2, 0.0, 0.0))
        self._world.add_body(self._rapier.RigidBody.fixed(), [self._with_material(cylinder, member=ROD, touches=BEAD)])

    def add_bead(self, position: Vector, velocity: Vector, mass: float) -> Any:
        """Add a bead of ``mass`` [kg]."""
        ball = self._rapier.Collider.ball(self._settings.bead_radius)
        return self._add(position, velocity, mass, [self._with_material(ball, member=BEAD, touches=ROD)])

    def add_mass(self, position: Vector, velocity: Vector, mass: float) -> Any:
        """Add a body of ``mass`` [kg] that touches nothing."""
        return self._add(position, velocity, mass, [])

    def add_held(self, position: Vector) -> Any:
        """Add a body that is held at ``position`` [m]."""
        return self._world.add_body(self._rapier.RigidBody.fixed().translation((*position, 0.0)))

    def add_link(self, a: Any, b: Any, length: float) -> Any:
        """Join two bodies by a rope of ``length`` [m], which only pulls."""
        return self._world.impulse_joints.insert(a, b, self._rapier.RopeJoint(length))

    # Rapier's joints keep a distance only from above, so links between beads are ropes, too
    add_straight = add_link

    def remove_link(self, link: Any) -> None:
        """Remove a rope."""
        self._world.impulse_joints.remove(link)

    def remove_bead(self, bead: Any) -> None:
        """Remove a bead that no rope joins any more."""
        self._world.remove_body(bead)

    def step(self, count: int, forces: Sequence[tuple[Any, Vector]]) -> None:
        """Take ``count`` steps, during which these ``forces`` [N] act on bodies."""
        for handle, (fx, fy) in forces:
            body = self._world.rigid_bodies[handle]
            # Rapier keeps a force for all later steps
            body.reset_forces()
            body.add_force((fx, fy, 0.0))
        for _ in range(count):
            self._world.step()

    def position(self, body: Any) -> Vector:
        """Return the position [m] of ``body``."""
        place = self._world.rigid_bodies[body].translation
        return place.x, place.y

    def velocity(self, body: Any) -> Vector:
        """Return the velocity [m/s] of ``body``."""
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
