"""Box2D's world in SI units: bodies, joints and contacts as the chain needs them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from looping_pendulum.engines.bead_rig import Vector
from looping_pendulum.engines.box2d.settings import Box2dChainSettings
from looping_pendulum.reference_ode.parameters import Parameters

MIN_LENGTH = 1e-2
"""Shortest length to which a straight part may go slack, in Box2D's metres; Box2D allows none below its slop, 0.005."""
BEADS = -1
"""Collision group of the beads: shapes of the same negative group never touch."""


class Box2dWorld:
    """A world of Box2D that speaks SI units, and in which only beads and the rod touch each other.

    Box2D's lengths are SI over `Box2dChainSettings.length_unit`, its times over `time_unit`, its masses are kilograms.
    """

    def __init__(self, parameters: Parameters, settings: Box2dChainSettings) -> None:
        import pyb2d3

        self._box2d, self._settings = pyb2d3, settings
        self._length, self._time = settings.length_unit, settings.time_unit
        self._speed = self._length / self._time
        self._force = self._length / self._time**2  # for a mass of 1 kg
        self._step, self._sub_steps = settings.time_step / self._time, settings.sub_steps
        self._world = pyb2d3.World(gravity=(0.0, -parameters.coefficients["gravity"] / self._force))
        self._world.sleeping_enabled = settings.sleeping
        self._world.continuous_enabled = settings.continuous
        self._world.set_contact_tuning(
            settings.contact_hertz * self._time, settings.contact_damping_ratio, settings.push_speed / self._speed
        )

    def add_rod(self, radius: float, friction: float) -> None:
        """Add a static circle of ``radius`` [m] at the origin, and let beads have the ``friction`` on it."""
        self._friction = friction
        self._add_circle(self._world.create_static_body(position=(0.0, 0.0)), radius)

    def add_bead(self, position: Vector, velocity: Vector, mass: float) -> Any:
        """Add a bead of ``mass`` [kg]."""
        bead = self.add_mass(position, velocity, mass)
        self._add_circle(bead, self._settings.bead_radius, group_index=BEADS)
        # A shape adds its own mass to its body
        self._set_mass(bead, mass)
        return bead

    def add_mass(self, position: Vector, velocity: Vector, mass: float) -> Any:
        """Add a body of ``mass`` [kg] that touches nothing and does not turn."""
        body = self._world.create_dynamic_body(
            position=self._scaled(position, self._length),
            linear_velocity=self._scaled(velocity, self._speed),
            fixed_rotation=True,
        )
        self._set_mass(body, mass)
        return body

    def add_held(self, position: Vector) -> Any:
        """Add a body that is held at ``position`` [m]."""
        return self._world.create_static_body(position=self._scaled(position, self._length))

    def add_link(self, a: Any, b: Any, length: float) -> Any:
        """Join two bodies by a link of ``length`` [m], which pulls and pushes."""
        return self._world.create_distance_joint(a, b, length=length / self._length)

    def add_straight(self, a: Any, b: Any, length: float) -> Any:
        """Join two bodies by a straight part of the string, of ``length`` [m], which only pulls."""
        longest = length / self._length
        # Box2D sees to limits only where a spring is enabled; one of 0 Hz exerts no force
        return self._world.create_distance_joint(
            a, b, length=longest, enable_spring=True, hertz=0.0, enable_limit=True, min_length=MIN_LENGTH, max_length=longest
        )

    @staticmethod
    def remove_link(link: Any) -> None:
        """Remove a link or a straight part."""
        link.destroy()

    @staticmethod
    def remove_bead(bead: Any) -> None:
        """Remove a bead that no link joins any more."""
        bead.destroy()

    def step(self, count: int, forces: Sequence[tuple[Any, Vector]]) -> None:
        """Take ``count`` steps, during which these ``forces`` [N] act on bodies."""
        scaled = [(body, (fx / self._force, fy / self._force)) for body, (fx, fy) in forces]
        for _ in range(count):
            # Box2D forgets a force after a step
            for body, force in scaled:
                body.apply_force_to_center(force)
            self._world.step(self._step, self._sub_steps)

    def position(self, body: Any) -> Vector:
        """Return the position [m] of ``body``."""
        x, y = body.position
        return x * self._length, y * self._length

    def velocity(self, body: Any) -> Vector:
        """Return the velocity [m/s] of ``body``."""
        vx, vy = body.linear_velocity
        return vx * self._speed, vy * self._speed

    def _add_circle(self, body: Any, radius: float, **collision: int) -> None:
        shape = self._box2d.shape_def(
            # Box2D takes the geometric mean of two coefficients, which for equal ones is their own
            material=self._box2d.surface_material(friction=self._friction, restitution=0.0),
            filter=self._box2d.make_filter(**collision),
        )
        body.create_shape(shape, self._box2d.circle(radius=radius / self._length))

    def _set_mass(self, body: Any, mass: float) -> None:
        data = self._box2d.MassData()
        data.mass, data.center, data.rotational_inertia = mass, (0.0, 0.0), 0.0
        body.mass_data = data

    @staticmethod
    def _scaled(vector: Vector, unit: float) -> Vector:
        return vector[0] / unit, vector[1] / unit
