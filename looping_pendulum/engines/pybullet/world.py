"""A PyBullet server with the rod, its settings and its steps, for every variant: PyBullet's defaults suit toys on a floor."""

from __future__ import annotations

import math
import weakref
from collections.abc import Callable
from typing import Any

from looping_pendulum.engines.protocol import steps_per_sample
from looping_pendulum.engines.pybullet.settings import RodShape, WorldSettings
from looping_pendulum.errors import EngineError
from looping_pendulum.reference_ode.cartesian import CartesianForce, cartesian_force, release_velocity
from looping_pendulum.reference_ode.geometry import light_position
from looping_pendulum.reference_ode.parameters import Parameters

ROD_HALF_LENGTH = 0.01
"""Half the length of a rod that is a cylinder [m]."""

MAX_DIVISION = 50
"""Largest number of parts into which a step is divided: a light mass that needs more is about to reach the rod."""

Row = tuple[float, ...]
"""Vector from PyBullet, or a row of samples."""
LongestStep = Callable[[float, float, float, float, float], float]
"""Time [s], light mass's x, y [m] and vx, vy [m/s] -> longest stable step [s]."""


class World:
    """A PyBullet server with gravity and the settings; it is disconnected when the rig that owns it is deleted."""

    def __init__(self, parameters: Parameters, settings: WorldSettings) -> None:
        import pybullet

        self.api: Any = pybullet
        self.client: int = pybullet.connect(pybullet.DIRECT)
        # A server lives until it is disconnected, whatever becomes of the Python objects
        weakref.finalize(self, pybullet.disconnect, self.client)
        self.settings = settings
        self.steps = steps_per_sample(settings.time_step)
        pybullet.setGravity(0, -parameters.coefficients["gravity"], 0, physicsClientId=self.client)
        pybullet.setPhysicsEngineParameter(
            fixedTimeStep=settings.time_step,
            numSolverIterations=settings.solver_iterations,
            erp=settings.joint_error_reduction,
            contactERP=settings.contact_error_reduction,
            frictionERP=settings.friction_error_reduction,
            contactBreakingThreshold=settings.neighbour_margin,
            physicsClientId=self.client,
        )

    def add_rod(self, radius: float, friction: float) -> int:
        """Create the rod, of ``radius`` [m]; PyBullet takes the product of two bodies' coefficients as the contact's."""
        api = self.api
        if self.settings.rod is RodShape.SPHERE:
            shape = api.createCollisionShape(api.GEOM_SPHERE, radius=radius, physicsClientId=self.client)
        else:
            shape = api.createCollisionShape(
                api.GEOM_CYLINDER, radius=radius, height=2 * ROD_HALF_LENGTH, physicsClientId=self.client
            )
        rod: int = api.createMultiBody(0, shape, -1, [0, 0, 0], physicsClientId=self.client)
        self.set_friction(rod, -1, friction)
        return rod

    def remove_damping(self, body: int, link: int = -1) -> None:
        """Remove the damping and the speed limit that PyBullet gives every body; a multibody has them at its base."""
        s = self.settings
        self.change(body, link, linearDamping=s.linear_damping, angularDamping=s.angular_damping)
        self.change(body, link, maxJointVelocity=s.speed_limit)

    def set_friction(self, body: int, link: int, friction: float) -> None:
        """Set the contact friction coefficient of a link.

        Raises
        ------
        EngineError
            If PyBullet reports another coefficient afterwards.
        """
        if self.settings.friction_with_damping and link >= 0:
            self.change(body, link, lateralFriction=friction, linearDamping=0, angularDamping=0)
            return
        self.change(body, link, lateralFriction=friction, rollingFriction=0, spinningFriction=0, restitution=0)
        actual = self.api.getDynamicsInfo(body, link, physicsClientId=self.client)[1]
        if not math.isclose(actual, friction, rel_tol=1e-9, abs_tol=1e-15):
            raise EngineError(f"pybullet: asked for a friction of {friction:g} on link {link}, PyBullet took {actual:g}")

    def change(self, body: int, link: int, **values: object) -> None:
        """Call PyBullet's `changeDynamics`; it ignores a friction that comes together with a damping, so use two calls."""
        self.api.changeDynamics(body, link, physicsClientId=self.client, **values)

    def body_state(self, body: int) -> tuple[Row, Row]:
        """Return position [m] and velocity [m/s] of a body without links."""
        position = self.api.getBasePositionAndOrientation(body, physicsClientId=self.client)[0]
        return position, self.api.getBaseVelocity(body, physicsClientId=self.client)[0]

    def apply_force(self, body: int, link: int, force: tuple[float, float], position: tuple[float, ...]) -> None:
        """Apply ``force`` [N], in the plane of motion, at ``position`` [m] during the next step only."""
        api = self.api
        api.applyExternalForce(body, link, (*force, 0.0), position, api.WORLD_FRAME, physicsClientId=self.client)


class WorldStepper:
    """Steps a world and applies the effects' forces, in the same way for every rig.

    Parameters
    ----------
    world
        World to step.
    parameters
        Parameters with the effects whose forces are applied.
    longest_step
        Longest step [s] at a time [s] and for the light mass's position [m] and velocity [m/s]: t, x, y, vx, vy. A group of
        ``force_interval`` steps is divided into more or fewer steps by it. None: every step is as long as the settings say.
    """

    def __init__(self, world: World, parameters: Parameters, longest_step: LongestStep | None = None) -> None:
        self._world = world
        self._force: CartesianForce | None = cartesian_force(parameters)
        self._longest_step = longest_step
        self._steps_done, self._left_in_group = 0, 0
        self._step = world.settings.time_step

    def steps(self, count: int, rig: SteppedRig) -> None:
        """Take ``count`` steps of the settings' length, or other ones that take as long.

        PyBullet clears an applied force after a step, so the forces of a group are applied in its first step, as many times
        larger.
        """
        world = self._world
        time_step, interval = world.settings.time_step, world.settings.force_interval
        while count > 0:
            if not self._left_in_group:
                # A group that may be divided does not reach beyond these steps, so that it is taken whole
                self._left_in_group = interval if self._longest_step is None else min(interval, count)
                self._begin_group(self._left_in_group, rig)
            now = min(count, self._left_in_group)
            for _ in range(round(now * time_step / self._step)):  # all of a divided group
                world.api.stepSimulation(physicsClientId=world.client)
            count -= now
            self._left_in_group -= now
            self._steps_done += now

    def _begin_group(self, group: int, rig: SteppedRig) -> None:
        """Set the step of the coming ``group`` of the settings' steps, and apply the effects' forces of all of them."""
        if self._force is None and self._longest_step is None:
            return
        world, t = self._world, self._steps_done * self._world.settings.time_step
        x, y, vx, vy, heavy_v = rig.read_motion()
        duration = group * world.settings.time_step
        if self._longest_step is not None:
            needed = math.ceil(duration / self._longest_step(t, x, y, vx, vy) - 1e-9)  # less what rounding adds
            count = min(needed, group * MAX_DIVISION)
            step = world.settings.time_step if count == group else duration / count
            if step != self._step:
                self._step = step
                world.api.setTimeStep(step, physicsClientId=world.client)
        if self._force is not None:
            fx, fy, heavy = self._force(t, x, y, vx, vy, heavy_v)
            share = duration / self._step
            rig.apply_forces((share * fx, share * fy), share * heavy)


class SteppedRig:
    """Motion and forces of a rig, as `WorldStepper` needs them."""

    def read_motion(self) -> tuple[float, float, float, float, float]:
        """Return the light mass's position [m] and velocity [m/s] and the heavy mass's upward velocity [m/s]."""
        raise NotImplementedError

    def apply_forces(self, light: tuple[float, float], heavy: float) -> None:
        """Apply forces [N] to the light mass, and upward to the heavy one, at their positions."""
        raise NotImplementedError


class FallingRig(SteppedRig):
    """The two masses without a string."""

    def __init__(self, parameters: Parameters, settings: WorldSettings) -> None:
        p = parameters
        self._world = world = World(p, settings)
        self._stepper = WorldStepper(world, p)
        vx, vy, heavy_v = release_velocity(p)
        light = light_position(math, p.free_length, p.release_angle, p.rod_radius)
        self._light = self._body(p.light_mass, [*light, 0.0], [vx, vy, 0.0])
        self._heavy = self._body(p.heavy_mass, [p.rod_radius, -p.hanging_length, 0.0], [0.0, heavy_v, 0.0])

    def advance(self) -> None:
        """Advance by one sample interval, with the effects' forces."""
        self._stepper.steps(self._world.steps, self)

    def read(self) -> Row:
        """Return positions [m], velocities [m/s] and string stretch [m]: `COLUMNS` without the time."""
        light, light_v = self._world.body_state(self._light)
        heavy, heavy_v = self._world.body_state(self._heavy)
        return (*light[:2], *light_v[:2], *heavy[:2], *heavy_v[:2], math.nan)

    def read_motion(self) -> tuple[float, float, float, float, float]:
        """Return the light mass's position [m] and velocity [m/s] and the heavy mass's upward velocity [m/s]."""
        (x, y, _), (vx, vy, _) = self._world.body_state(self._light)
        return x, y, vx, vy, self._world.body_state(self._heavy)[1][1]

    def apply_forces(self, light: tuple[float, float], heavy: float) -> None:
        """Apply forces [N] to the light mass, and upward to the heavy one, at their positions."""
        self._world.apply_force(self._light, -1, light, self._world.body_state(self._light)[0])
        self._world.apply_force(self._heavy, -1, (0.0, heavy), self._world.body_state(self._heavy)[0])

    def _body(self, mass: float, position: list[float], velocity: list[float]) -> int:
        api, client = self._world.api, self._world.client
        body: int = api.createMultiBody(mass, -1, -1, position, physicsClientId=client)
        self._world.remove_damping(body)
        api.resetBaseVelocity(body, linearVelocity=velocity, physicsClientId=client)
        return body
