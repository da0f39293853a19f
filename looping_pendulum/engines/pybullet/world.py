"""PyBullet's server and how it is stepped, the settings, and PyBullet's defaults, which suit toys on a floor."""

from __future__ import annotations

import abc
import math
import weakref
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from looping_pendulum.engines.chain import MASS_COMPENSATION, polygon_friction
from looping_pendulum.engines.protocol import steps_per_sample
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


MAX_DIVISION = 50
"""Largest number of parts into which a step is divided: a light mass that needs more is about to reach the rod."""

Row = tuple[float, ...]
"""Vector from PyBullet, or a row of samples."""
LongestStep = Callable[[float, float, float, float, float], float]
"""Time [s], light mass's x, y [m] and vx, vy [m/s] -> longest stable step [s]."""


class Server:
    """A PyBullet server: PyBullet's functions, which act on it, and its constants. It ends when the object is deleted."""

    def __init__(self) -> None:
        import pybullet

        self._pybullet: Any = pybullet
        self.client: int = pybullet.connect(pybullet.DIRECT)
        weakref.finalize(self, pybullet.disconnect, self.client)

    def __getattr__(self, name: str) -> Any:
        """Return a function or a constant of PyBullet."""
        value = getattr(self._pybullet, name)
        return partial(value, physicsClientId=self.client) if callable(value) else value


class PybulletRig(abc.ABC):
    """A rig in a PyBullet server of its own, stepped with the effects' forces.

    Parameters
    ----------
    parameters, settings
        Physics and numerics.
    longest_step
        Longest step [s] at a time [s] and for the light mass's position [m] and velocity [m/s]: t, x, y, vx, vy. A group of
        ``force_interval`` steps is divided into more or fewer steps by it. None: every step is as long as the settings say.
    """

    def __init__(
        self, parameters: Parameters, settings: PybulletChainSettings, longest_step: LongestStep | None = None
    ) -> None:
        self._server = Server()
        self._parameters, self._settings = parameters, settings
        self._held = parameters.release is Release.HELD
        self._force = cartesian_force(parameters)
        self._longest_step = longest_step
        self._steps_per_sample = steps_per_sample(settings.time_step)
        self._steps_done, self._left_in_group = 0, 0
        self._step = settings.time_step
        self._server.setGravity(0, -parameters.coefficients["gravity"], 0)
        self._server.setPhysicsEngineParameter(
            fixedTimeStep=settings.time_step,
            numSolverIterations=settings.solver_iterations,
            contactERP=settings.contact_error_reduction,
            contactBreakingThreshold=settings.neighbour_margin,
        )

    def advance(self) -> None:
        """Advance by one sample interval, with the effects' forces, in steps of the settings' length or others as long in sum.

        PyBullet clears an applied force after a step, so the forces of a group are applied in its first step, as many times
        larger.
        """
        s, count = self._settings, self._steps_per_sample
        while count > 0:
            if not self._left_in_group:
                # A group that may be divided does not reach beyond these steps, so that it is taken whole
                self._left_in_group = s.force_interval if self._longest_step is None else min(s.force_interval, count)
                self._begin_group(self._left_in_group)
            now = min(count, self._left_in_group)
            for _ in range(round(now * s.time_step / self._step)):  # all of a divided group
                self._server.stepSimulation()
            count -= now
            self._left_in_group -= now
            self._steps_done += now

    def _begin_group(self, group: int) -> None:
        """Set the step of the coming ``group`` of the settings' steps, and apply the effects' forces of all of them."""
        if self._force is None and self._longest_step is None:
            return
        time_step = self._settings.time_step
        t, duration = self._steps_done * time_step, group * time_step
        x, y, vx, vy, heavy_v = self.read_motion()
        if self._longest_step is not None:
            needed = math.ceil(duration / self._longest_step(t, x, y, vx, vy) - 1e-9)  # less what rounding adds
            count = min(needed, group * MAX_DIVISION)
            step = time_step if count == group else duration / count
            if step != self._step:
                self._step = step
                self._server.setTimeStep(step)
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

    def _apply_force(self, body: int, link: int, force: Vector, position: Row) -> None:
        """Apply ``force`` [N], in the plane of motion, at ``position`` [m] during the next step only."""
        self._server.applyExternalForce(body, link, (*force, 0.0), position, self._server.WORLD_FRAME)

    def _remove_damping(self, body: int) -> None:
        """Remove the damping and the speed limit that PyBullet gives every body; a multibody has them at its base."""
        s = self._settings
        self._server.changeDynamics(body, -1, linearDamping=s.linear_damping, angularDamping=s.angular_damping)
        self._server.changeDynamics(body, -1, maxJointVelocity=s.speed_limit)


class FallingRig(PybulletRig):
    """The two masses without a string."""

    def __init__(self, parameters: Parameters, settings: PybulletChainSettings) -> None:
        p = parameters
        super().__init__(p, settings)
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
        self._apply_force(self._light, -1, light, self._state(self._light)[0])
        self._apply_force(self._heavy, -1, (0.0, heavy), self._state(self._heavy)[0])

    def _body(self, mass: float, position: Vector, velocity: Vector) -> int:
        body: int = self._server.createMultiBody(mass, -1, -1, [*position, 0.0])
        self._remove_damping(body)
        self._server.resetBaseVelocity(body, linearVelocity=[*velocity, 0.0])
        return body

    def _state(self, body: int) -> tuple[Row, Row]:
        """Return position [m] and velocity [m/s] of a mass."""
        return self._server.getBasePositionAndOrientation(body)[0], self._server.getBaseVelocity(body)[0]


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
