"""A PyBullet server with the rod in it, and what every variant sets in it: PyBullet's defaults are those of toys on a floor."""

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
"""Of a rod that is a cylinder [m]."""

STEPS_TO_LOOK = 5
"""Steps between two looks at the longest stable step, where no force asks for the motion more often."""
MOST_PARTS = 50
"""Parts of a step, at most: a light mass that needs more has as good as met the rod."""

Row = tuple[float, ...]
LongestStep = Callable[[float, float, float, float], float]


class World:
    """A PyBullet server of its own; it ends with the rig that owns it."""

    def __init__(self, parameters: Parameters, settings: WorldSettings) -> None:
        import pybullet

        self.api: Any = pybullet
        self.client: int = pybullet.connect(pybullet.DIRECT)
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

    def lay_rod(self, radius: float, friction: float) -> int:
        """Make the rod, of ``radius`` [m]; a pair's friction is the product of its two."""
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

    def undamp(self, body: int, link: int = -1) -> None:
        """Take off the damping and the speed limit that PyBullet gives every body: those of a multibody are its base's."""
        s = self.settings
        self.change(body, link, linearDamping=s.linear_damping, angularDamping=s.angular_damping)
        self.change(body, link, maxJointVelocity=s.speed_limit)

    def set_friction(self, body: int, link: int, friction: float) -> None:
        """Set the contact friction.

        Raises
        ------
        EngineError
            If PyBullet took another.
        """
        if self.settings.friction_with_damping and link >= 0:
            self.change(body, link, lateralFriction=friction, linearDamping=0, angularDamping=0)
            return
        self.change(body, link, lateralFriction=friction, rollingFriction=0, spinningFriction=0, restitution=0)
        found = self.api.getDynamicsInfo(body, link, physicsClientId=self.client)[1]
        if not math.isclose(found, friction, rel_tol=1e-9, abs_tol=1e-15):
            raise EngineError(f"pybullet: asked for a friction of {friction:g} on link {link}, PyBullet took {found:g}")

    def change(self, body: int, link: int, **values: object) -> None:
        """`changeDynamics`; a friction that is given together with a damping is ignored there, so give those apart."""
        self.api.changeDynamics(body, link, physicsClientId=self.client, **values)

    def body_state(self, body: int) -> tuple[Row, Row]:
        """Position [m] and velocity [m/s] of a body without links."""
        position = self.api.getBasePositionAndOrientation(body, physicsClientId=self.client)[0]
        return position, self.api.getBaseVelocity(body, physicsClientId=self.client)[0]

    def push(self, body: int, link: int, force: tuple[float, float], position: tuple[float, ...]) -> None:
        """Apply ``force`` [N] in the plane at ``position`` [m], during the next step only."""
        api = self.api
        api.applyExternalForce(body, link, (*force, 0.0), position, api.WORLD_FRAME, physicsClientId=self.client)


class Drive:
    """Steps a world and applies the effects' forces: one way for every rig.

    Parameters
    ----------
    world, parameters
        Where, and whose effects.
    longest_step
        Longest stable step [s] for the light mass's position [m] and velocity [m/s]: x, y, vx, vy. Where it is shorter than
        the settings' step, that is taken in as many equal parts as it needs. None: every step is stable.
    """

    def __init__(self, world: World, parameters: Parameters, longest_step: LongestStep | None = None) -> None:
        self._world = world
        self._force: CartesianForce | None = cartesian_force(parameters)
        self._longest_step = longest_step
        self._steps_done, self._parts = 0, 1

    def steps(self, count: int, rig: PushedBodies) -> None:
        """Take ``count`` steps.

        PyBullet forgets an applied force after a step, so those of a group of ``force_interval`` steps go into its first step.
        """
        world = self._world
        step, client, interval = world.api.stepSimulation, world.client, world.settings.force_interval
        if self._force is None and self._longest_step is None:
            for _ in range(count):
                step(physicsClientId=client)
            return
        look = interval if self._force is not None else STEPS_TO_LOOK
        for _ in range(count):
            if self._steps_done % look == 0:
                x, y, vx, vy, heavy_v = rig.motion()
                self._divide(x, y, vx, vy)
                if self._force is not None:
                    fx, fy, heavy = self._force(self._steps_done * world.settings.time_step, x, y, vx, vy, heavy_v)
                    share = interval * self._parts
                    rig.push((share * fx, share * fy), share * heavy)
            for _ in range(self._parts):
                step(physicsClientId=client)
            self._steps_done += 1

    def _divide(self, x: float, y: float, vx: float, vy: float) -> None:
        """Set into how many parts the coming steps are divided."""
        if self._longest_step is None:
            return
        time_step = self._world.settings.time_step
        parts = min(max(math.ceil(time_step / self._longest_step(x, y, vx, vy)), 1), MOST_PARTS)
        if parts != self._parts:
            self._parts = parts
            self._world.api.setTimeStep(time_step / parts, physicsClientId=self._world.client)


class PushedBodies:
    """What `Drive` needs of a rig."""

    def motion(self) -> tuple[float, float, float, float, float]:
        """Light mass's position [m] and velocity [m/s], heavy mass's upward velocity [m/s]."""
        raise NotImplementedError

    def push(self, light: tuple[float, float], heavy: float) -> None:
        """Apply forces [N] on the light mass, and upward on the heavy one, where they are."""
        raise NotImplementedError


class FallingRig(PushedBodies):
    """The two masses without a string."""

    def __init__(self, parameters: Parameters, settings: WorldSettings) -> None:
        p = parameters
        self._world = world = World(p, settings)
        self._drive = Drive(world, p)
        vx, vy, heavy_v = release_velocity(p)
        light = light_position(math, p.free_length, p.release_angle, p.rod_radius)
        self._light = self._body(p.light_mass, [*light, 0.0], [vx, vy, 0.0])
        self._heavy = self._body(p.heavy_mass, [p.rod_radius, -p.hanging_length, 0.0], [0.0, heavy_v, 0.0])

    def advance(self) -> None:
        """Step through one sample interval, applying the effects' forces."""
        self._drive.steps(self._world.steps, self)

    def read(self) -> Row:
        """Positions [m], velocities [m/s] and string stretch [m]: `COLUMNS` without the time."""
        light, light_v = self._world.body_state(self._light)
        heavy, heavy_v = self._world.body_state(self._heavy)
        return (*light[:2], *light_v[:2], *heavy[:2], *heavy_v[:2], math.nan)

    def motion(self) -> tuple[float, float, float, float, float]:
        """Light mass's position [m] and velocity [m/s], heavy mass's upward velocity [m/s]."""
        (x, y, _), (vx, vy, _) = self._world.body_state(self._light)
        return x, y, vx, vy, self._world.body_state(self._heavy)[1][1]

    def push(self, light: tuple[float, float], heavy: float) -> None:
        """Apply forces [N] on the light mass, and upward on the heavy one, where they are."""
        self._world.push(self._light, -1, light, self._world.body_state(self._light)[0])
        self._world.push(self._heavy, -1, (0.0, heavy), self._world.body_state(self._heavy)[0])

    def _body(self, mass: float, position: list[float], velocity: list[float]) -> int:
        api, client = self._world.api, self._world.client
        body: int = api.createMultiBody(mass, -1, -1, position, physicsClientId=client)
        self._world.undamp(body)
        api.resetBaseVelocity(body, linearVelocity=velocity, physicsClientId=client)
        return body
