"""PyBullet's world: a server with a rod, how it is stepped, its settings and its defaults, which suit toys on a floor."""

from __future__ import annotations

import abc
import math
import weakref
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from looping_pendulum.engines.chain import MASS_COMPENSATION, polygon_friction
from looping_pendulum.engines.protocol import steps_per_sample
from looping_pendulum.errors import EngineError
from looping_pendulum.reference_ode.cartesian import Vector, cartesian_force, masses_at_release
from looping_pendulum.reference_ode.parameters import Parameters, Release

NO_SPEED_LIMIT = 1e9
"""Limit of joint speeds [m/s or rad/s] that is never reached; links turn faster than PyBullet's as they pass over the rod."""
DEFAULT_SPEED_LIMIT = 100.0
"""PyBullet's limit of every joint's speed [m/s or rad/s]."""
DEFAULT_DAMPING = 0.04
"""PyBullet's linear and angular damping of every body [1/s]."""
DEFAULT_ITERATIONS = 50
"""PyBullet's number of solver iterations per step."""
DEFAULT_NEIGHBOUR_MARGIN = 0.02
"""PyBullet's contactBreakingThreshold [m]."""
LARGEST_STEP = 1e-3
"""Largest step [s]: samples are a millisecond apart and are not interpolated; PyBullet's own step is 1/240 s."""


@dataclass(frozen=True, kw_only=True)
class PybulletChainSettings:
    """Numerical settings of the link chain, stable below steps of about link length over sqrt(tension / mass per length)."""

    time_step: float
    """Length of a step [s]; it must divide the sample interval."""
    solver_iterations: int
    """Iterations (sweeps over all constraints) of the solver per step (numSolverIterations)."""
    force_interval: int = 5
    """Steps between two updates of the effects' forces; a test compares it with 1."""
    contact_error_reduction: float = 0.2
    """Fraction of a penetration that a step corrects (contactERP)."""
    neighbour_margin: float = DEFAULT_NEIGHBOUR_MARGIN
    """Margin by which the bounding boxes of the neighbour search exceed the shapes [m] (contactBreakingThreshold).

    With PyBullet's 20 mm a node has a dozen others for neighbours, and sorting them out costs as much as the contacts. Whether
    spheres touch does not depend on it, but the order does in which the solver sweeps over the contacts.
    """
    linear_damping: float = 0.0
    """Fraction of a body's velocity lost per second."""
    angular_damping: float = 0.0
    """Fraction of a body's angular velocity lost per second."""
    speed_limit: float = NO_SPEED_LIMIT
    """Largest speed of a multibody's joints [m/s or rad/s] (maxJointVelocity)."""
    rod: str = "sphere"
    """Collision shape, "sphere" or "cylinder"; both have the same section in the plane of motion.

    Sphere on sphere is Bullet's only exact contact. It finds those of a cylinder by a general algorithm, whose points and
    normals are inexact at sizes of a millimetre.
    """
    friction_with_damping: bool = False
    """Whether to set a link's friction and damping in one call.

    PyBullet's documentation allows it, but PyBullet then ignores the friction.
    """
    node_radius: float = 2e-4
    """Radius of a node's contact sphere [m]; the rod is thinner by as much, so that the string's middle lies at its radius."""
    polygon: bool = True
    """Whether the rod's radius and coefficient are corrected for the polygon that the links are (`engines.chain`)."""
    link_length: float
    """Length of a link that may slide over the rod [m]; see `chain_at_release` for when links are longer."""
    outer_link_length: float
    """Length of a link near the light mass, which at most winds on to the rod [m]; adjusted to end at the light mass."""
    least_bend: float = 0.2
    """Smallest angle between links on the rod [rad]: on a thick rod, which needs no shorter ones, links are longer."""
    sliding_share: float = 0.7
    """Fraction of the free string, from the rod on, that consists of links of `link_length`."""
    hanging_link_length: float = 0.015
    """Length of the links below the rod on the heavy side at release, which never come to lie on it [m]."""
    relative_inertia: float = 1e-2
    """Moment of inertia of a link about its end, over its mass times its length squared: small, but not singular."""
    mass_compensation: float = MASS_COMPENSATION
    """Fraction of the chain's mass that is subtracted from the light mass, see `engines.chain`."""
    joint_motors: bool = False
    """Whether to leave on the motor that PyBullet puts in every joint."""
    joined_hanging_links: int = 1
    """Number of links that are joined to one on the heavy mass's side after they left the rod (`joining`); 1: none are."""
    joined_free_links: int = 1
    """Number of links that are joined to one on the light mass's side, until they come near the rod; 1: none are."""
    unjoined_links: float = 3.0
    """Number of links beyond the string on the rod, on either side, that are not joined."""
    lengthening_after_halt: float = 1.0
    """Factor by which steps are longer once the heavy mass hangs still."""
    divided_step: bool = True
    """Whether steps are shorter where a wave on the taut chain would pass too much of a link, and longer after the halt."""


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

    def __init__(self, parameters: Parameters, settings: PybulletChainSettings) -> None:
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
            contactERP=settings.contact_error_reduction,
            contactBreakingThreshold=settings.neighbour_margin,
            physicsClientId=self.client,
        )

    def add_rod(self, radius: float, friction: float) -> int:
        """Create the rod, of ``radius`` [m]; PyBullet takes the product of two bodies' coefficients as the contact's."""
        api = self.api
        if self.settings.rod == "sphere":
            shape = api.createCollisionShape(api.GEOM_SPHERE, radius=radius, physicsClientId=self.client)
        else:
            shape = api.createCollisionShape(
                api.GEOM_CYLINDER, radius=radius, height=2 * ROD_HALF_LENGTH, physicsClientId=self.client
            )
        rod: int = api.createMultiBody(0, shape, -1, [0, 0, 0], physicsClientId=self.client)
        self.set_friction(rod, -1, friction)
        return rod

    def remove_damping(self, body: int) -> None:
        """Remove the damping and the speed limit that PyBullet gives every body; a multibody has them at its base."""
        s = self.settings
        self.change(body, -1, linearDamping=s.linear_damping, angularDamping=s.angular_damping)
        self.change(body, -1, maxJointVelocity=s.speed_limit)

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

    def apply_force(self, body: int, link: int, force: Vector, position: tuple[float, ...]) -> None:
        """Apply ``force`` [N], in the plane of motion, at ``position`` [m] during the next step only."""
        api = self.api
        api.applyExternalForce(body, link, (*force, 0.0), position, api.WORLD_FRAME, physicsClientId=self.client)


class SteppedRig(abc.ABC):
    """Steps a world with the effects' forces.

    Parameters
    ----------
    parameters
        Parameters with the effects whose forces are applied.
    world
        World to step.
    longest_step
        Longest step [s] at a time [s] and for the light mass's position [m] and velocity [m/s]: t, x, y, vx, vy. A group of
        ``force_interval`` steps is divided into more or fewer steps by it. None: every step is as long as the settings say.
    """

    def __init__(self, parameters: Parameters, world: World, longest_step: LongestStep | None = None) -> None:
        self._parameters, self._world = parameters, world
        self._held = parameters.release is Release.HELD
        self._force = cartesian_force(parameters)
        self._longest_step = longest_step
        self._steps_done, self._left_in_group = 0, 0
        self._step = world.settings.time_step

    def advance(self) -> None:
        """Advance by one sample interval, with the effects' forces, in steps of the settings' length or others as long in sum.

        PyBullet clears an applied force after a step, so the forces of a group are applied in its first step, as many times
        larger.
        """
        world = self._world
        time_step, interval, count = world.settings.time_step, world.settings.force_interval, world.steps
        while count > 0:
            if not self._left_in_group:
                # A group that may be divided does not reach beyond these steps, so that it is taken whole
                self._left_in_group = interval if self._longest_step is None else min(interval, count)
                self._begin_group(self._left_in_group)
            now = min(count, self._left_in_group)
            for _ in range(round(now * time_step / self._step)):  # all of a divided group
                world.api.stepSimulation(physicsClientId=world.client)
            count -= now
            self._left_in_group -= now
            self._steps_done += now

    def _begin_group(self, group: int) -> None:
        """Set the step of the coming ``group`` of the settings' steps, and apply the effects' forces of all of them."""
        if self._force is None and self._longest_step is None:
            return
        world, t = self._world, self._steps_done * self._world.settings.time_step
        x, y, vx, vy, heavy_v = self.read_motion()
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
            self.apply_forces((share * fx, share * fy), share * heavy)

    @abc.abstractmethod
    def read_motion(self) -> tuple[float, float, float, float, float]:
        """Return the light mass's position [m] and velocity [m/s] and the heavy mass's upward velocity [m/s]."""

    @abc.abstractmethod
    def apply_forces(self, light: Vector, heavy: float) -> None:
        """Apply forces [N] to the light mass, and upward to the heavy one, where `read_motion` last found them."""


class FallingRig(SteppedRig):
    """The two masses without a string."""

    def __init__(self, parameters: Parameters, settings: PybulletChainSettings) -> None:
        p = parameters
        super().__init__(p, World(p, settings))
        masses = masses_at_release(p)
        self._light = self._body(p.light_mass, masses.light_position, masses.light_velocity)
        self._heavy = self._body(p.heavy_mass, masses.heavy_position, masses.heavy_velocity)

    def read(self) -> Row:
        """Return positions [m] and velocities [m/s], of `COLUMNS`; there is no string."""
        (light, light_v), (heavy, heavy_v) = self._state(self._light), self._state(self._heavy)
        return (*light[:2], *light_v[:2], *heavy[:2], *heavy_v[:2], math.nan, math.nan)

    def read_motion(self) -> tuple[float, float, float, float, float]:
        """Return the light mass's position [m] and velocity [m/s] and the heavy mass's upward velocity [m/s]."""
        (x, y, _), (vx, vy, _) = self._state(self._light)
        return x, y, vx, vy, self._state(self._heavy)[1][1]

    def apply_forces(self, light: Vector, heavy: float) -> None:
        """Apply forces [N] to the light mass, and upward to the heavy one."""
        self._world.apply_force(self._light, -1, light, self._state(self._light)[0])
        self._world.apply_force(self._heavy, -1, (0.0, heavy), self._state(self._heavy)[0])

    def _body(self, mass: float, position: Vector, velocity: Vector) -> int:
        api, client = self._world.api, self._world.client
        body: int = api.createMultiBody(mass, -1, -1, [*position, 0.0], physicsClientId=client)
        self._world.remove_damping(body)
        api.resetBaseVelocity(body, linearVelocity=[*velocity, 0.0], physicsClientId=client)
        return body

    def _state(self, body: int) -> tuple[Row, Row]:
        """Return position [m] and velocity [m/s] of a mass."""
        api, client = self._world.api, self._world.client
        return (
            api.getBasePositionAndOrientation(body, physicsClientId=client)[0],
            api.getBaseVelocity(body, physicsClientId=client)[0],
        )


MEAN_TURN_TO_HALT = math.pi / 2
"""Typical wrap angle beyond the release's, averaged over a looping mass's motion until the halt [rad]."""


def typical_wrap_angle(parameters: Parameters) -> float:
    """Return the wrap angle [rad] at which the polygon's mean friction shall be that of a circle; it changes little with it."""
    return parameters.release_angle + (0.0 if parameters.release is Release.VERTICAL else MEAN_TURN_TO_HALT)


def contact_friction(friction: float, bend: float, wrap_angle: float) -> float:
    """Return the contact friction with which a sliding polygon obeys the capstan law, averaged over its ends' positions.

    `polygon_friction` is right for full corners. A corner of angle d makes ln(T2/T1) = 2 artanh(m tan(d/2)), which grows faster
    than d; and the first and last corner on the rod turn by anything from 0 to the full ``bend``, evenly as the string winds.
    So the wrap angle theta is theta / bend - 1 full corners and two such ends, and m solves
    (theta / bend - 1) f(bend) + 2 mean(f) = mu theta.
    """
    from scipy.optimize import brentq  # imported here, as it is slow and every list of engines imports this module

    if friction == 0:
        return 0.0
    points, weights = np.polynomial.legendre.leggauss(16)
    tangents = np.tan(0.25 * bend * (points + 1))
    full = math.tan(bend / 2)

    def exponent(m: float) -> float:
        ends = float(weights @ np.arctanh(m * tangents)) * 2  # the weights add up to 2: both ends
        return (wrap_angle / bend - 1) * 2 * math.atanh(m * full) + ends

    # At 1 / tan(bend / 2) a full corner would hold any tension
    lowest, highest = polygon_friction(friction, bend), (1 - 1e-12) / full
    return float(brentq(lambda m: exponent(m) - friction * wrap_angle, 0.5 * lowest, highest, xtol=1e-15))
