"""What the PyBullet variants share: a server with rod and steps, chains of links between nodes, settings, and studies.

PyBullet's defaults suit toys on a floor.
"""

from __future__ import annotations

import math
import weakref
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np

from looping_pendulum.engines.chain import SlipGauge, polygon_friction
from looping_pendulum.engines.protocol import Rig, TunedEngine, steps_per_sample
from looping_pendulum.engines.studies import ChoiceRow, DefaultRow, LadderRow, default_row
from looping_pendulum.errors import EngineError
from looping_pendulum.pages.numbers import quantity
from looping_pendulum.reference_ode.cartesian import cartesian_force, masses_at_release
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import Parameters, Release
from looping_pendulum.runs.trajectory import SAMPLE_INTERVAL
from looping_pendulum.scenarios.scenario import Scenario

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


class RodShape(StrEnum):
    """Collision shape of the rod."""

    SPHERE = "sphere"
    """Has the rod's section in the plane of motion; sphere on sphere is Bullet's only exact contact."""
    CYLINDER = "cylinder"
    """Bullet finds its contacts by a general algorithm, whose points and normals are inexact at sizes of a millimetre."""


@dataclass(frozen=True, kw_only=True)
class WorldSettings:
    """Settings that every PyBullet variant has."""

    time_step: float
    """Length of a step [s]; it must divide the sample interval."""
    solver_iterations: int
    """Iterations (sweeps over all constraints) of the solver per step (numSolverIterations)."""
    force_interval: int = 5
    """Steps between two updates of the effects' forces; a test compares it with 1."""
    joint_error_reduction: float = 0.2
    """Fraction of a joint's position error that a step corrects (Bullet's erp)."""
    contact_error_reduction: float = 0.2
    """Fraction of a penetration that a step corrects (contactERP)."""
    friction_error_reduction: float = 0.2
    """Fraction of the drift of a sticking contact that a step corrects (frictionERP)."""
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
    rod: RodShape = RodShape.SPHERE
    """Collision shape of the rod."""
    friction_with_damping: bool = False
    """Whether to set a link's friction and damping in one call.

    PyBullet's documentation allows it, but PyBullet then ignores the friction.
    """
    node_radius: float = 2e-4
    """Radius of a node's contact sphere [m]; the rod is thinner by as much, so that the string's middle lies at its radius."""
    polygon: bool = True
    """Whether the rod's radius and coefficient are corrected for the polygon that the links are (`engines.chain`)."""


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

    def body_state(self, body: int) -> tuple[Row, Row]:
        """Return position [m] and velocity [m/s] of a body without links."""
        position = self.api.getBasePositionAndOrientation(body, physicsClientId=self.client)[0]
        return position, self.api.getBaseVelocity(body, physicsClientId=self.client)[0]

    def apply_force(self, body: int, link: int, force: tuple[float, float], position: tuple[float, ...]) -> None:
        """Apply ``force`` [N], in the plane of motion, at ``position`` [m] during the next step only."""
        api = self.api
        api.applyExternalForce(body, link, (*force, 0.0), position, api.WORLD_FRAME, physicsClientId=self.client)


class SteppedRig:
    """Steps a world with the effects' forces; the masses are two bodies, unless a subclass reads and moves them otherwise.

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

    _light: int
    _heavy: int

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

    def read(self) -> Row:
        """Return positions [m], velocities [m/s], and what else is known of `COLUMNS`, without the time."""
        light, light_v = self._world.body_state(self._light)
        heavy, heavy_v = self._world.body_state(self._heavy)
        return (*light[:2], *light_v[:2], *heavy[:2], *heavy_v[:2], *self._read_string())

    def _read_string(self) -> Row:
        """Return the string's stretch and slip over the rod [m]."""
        raise NotImplementedError

    def read_motion(self) -> tuple[float, float, float, float, float]:
        """Return the light mass's position [m] and velocity [m/s] and the heavy mass's upward velocity [m/s]."""
        (x, y, _), (vx, vy, _) = self._world.body_state(self._light)
        return x, y, vx, vy, self._world.body_state(self._heavy)[1][1]

    def apply_forces(self, light: tuple[float, float], heavy: float) -> None:
        """Apply forces [N] to the light mass, and upward to the heavy one, at their positions."""
        self._world.apply_force(self._light, -1, light, self._world.body_state(self._light)[0])
        if not self._held:
            self._world.apply_force(self._heavy, -1, (0.0, heavy), self._world.body_state(self._heavy)[0])


class FallingRig(SteppedRig):
    """The two masses without a string."""

    def __init__(self, parameters: Parameters, settings: WorldSettings) -> None:
        p = parameters
        super().__init__(p, World(p, settings))
        masses = masses_at_release(p)
        self._light = self._body(p.light_mass, [*masses.light_position, 0.0], [*masses.light_velocity, 0.0])
        self._heavy = self._body(p.heavy_mass, [*masses.heavy_position, 0.0], [*masses.heavy_velocity, 0.0])

    def _read_string(self) -> Row:
        return (math.nan,)

    def _body(self, mass: float, position: list[float], velocity: list[float]) -> int:
        api, client = self._world.api, self._world.client
        body: int = api.createMultiBody(mass, -1, -1, position, physicsClientId=client)
        self._world.remove_damping(body)
        api.resetBaseVelocity(body, linearVelocity=velocity, physicsClientId=client)
        return body


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


def fitting_length(parameters: Parameters, length: float) -> float:
    """Return the ``length`` [m] of a link on the rod, in a vertical release adjusted so that links divide the wound string."""
    if parameters.release is not Release.VERTICAL:
        return length
    # The wrap angle is constant. Links that divide it reach and leave the rod at the same moments, so that the ripple which a
    # passing node makes in the string's speed is the same at both ends, and the masses do not feel it.
    wound = parameters.rod_radius * parameters.release_angle
    return wound / math.ceil(wound / length)


def node_angles(parameters: Parameters, bend: float, links: int) -> Array:
    """Return the angles [rad] of the ends of so many ``links`` on the rod at release, evenly about the wound string's middle.

    Each link turns the string by ``bend`` [rad]; the heavy side's end comes first.
    """
    return np.asarray(0.5 * parameters.release_angle + bend * (np.arange(links + 1) - 0.5 * links))


@dataclass(frozen=True, kw_only=True)
class ChainState:
    """Positions and velocities of a chain at one moment: its ends and the nodes between, from heavy to light mass."""

    positions: Array
    """Of masses and nodes [m], shape (n, 2)."""
    velocities: Array
    """Of masses and nodes [m/s], shape (n, 2)."""

    @property
    def lengths(self) -> Array:
        """Lengths of the links [m], shape (n - 1,)."""
        return np.asarray(np.hypot(*np.diff(self.positions, axis=0).T))

    @property
    def directions(self) -> Array:
        """Directions of the links, from the x axis [rad], shape (n - 1,)."""
        x, y = np.diff(self.positions, axis=0).T
        return np.asarray(np.arctan2(y, x))

    @property
    def turn_rates(self) -> Array:
        """Angular velocities of the links [rad/s], shape (n - 1,)."""
        (x, y), (vx, vy) = np.diff(self.positions, axis=0).T, np.diff(self.velocities, axis=0).T
        return np.asarray((x * vy - y * vx) / (x * x + y * y))


RIPPLE_LIMIT = "links of several millimetres are long for a thin rod: the string's speed over it ripples as nodes pass"
NO_STRETCH_LIMIT = "reduced coordinates cannot stretch: the string stretch is 0 by construction, not a measurement"
"""Sentences on limits of variants whose string is a multibody."""
MAX_JOINTS = 121
"""Largest number of joints whose state PyBullet reports correctly: it has room for 128 numbers, 7 of them the base's.

With more, the first links' positions come back overwritten; beyond 127 PyBullet drops the joints themselves without an error.
"""


class MultibodyRig(SteppedRig):
    """Two masses at the ends of one multibody; a subclass creates the multibody."""

    _body: int
    _ends: tuple[int, int]
    """Indices of the links to read: the light mass, then the heavy one (if held: any, it is not read)."""

    def __init__(self, parameters: Parameters, world: World, longest_step: LongestStep | None = None) -> None:
        super().__init__(parameters, world, longest_step)
        self._slip = SlipGauge()

    def read(self) -> Row:
        """Return positions [m], velocities [m/s], string stretch and slip [m]: `COLUMNS` without the time."""
        x, y, vx, vy, heavy_v = self.read_motion()
        heavy_y = -self._parameters.hanging_length if self._held else float(self._heavy_position[1])
        nodes = range(0 if self._held else 1, self._ends[0] + 1)  # the first link is the heavy mass's, unless it is held
        # Positions as PyBullet computed them for `read_motion`, a moment before
        rows = self._world.api.getLinkStates(self._body, nodes, physicsClientId=self._world.client)
        positions = [*(row[0][:2] for row in reversed(rows)), (self._parameters.rod_radius, heavy_y)]
        # Links are rigid, so the nodes' distances are their rest lengths
        slip = self._slip.read(positions, list(map(math.dist, positions[:-1], positions[1:])))
        return (x, y, vx, vy, self._parameters.rod_radius, heavy_y, 0.0, heavy_v, 0.0, slip)

    def _chain(self) -> ChainState:
        """Return positions and velocities of the masses and nodes."""
        api, client = self._world.api, self._world.client
        joints = range(self._ends[0] + 1)
        rows = api.getLinkStates(self._body, joints, 1, 1, physicsClientId=client)
        positions, velocities = np.array([row[0][:2] for row in rows]), np.array([row[6][:2] for row in rows])
        if self._held:
            p = self._parameters
            positions, velocities = (
                np.vstack([(p.rod_radius, -p.hanging_length), positions]),
                np.vstack([(0.0, 0.0), velocities]),
            )
        return ChainState(positions=positions, velocities=velocities)

    def read_motion(self) -> tuple[float, float, float, float, float]:
        """Return the light mass's position [m] and velocity [m/s] and the heavy mass's upward velocity [m/s]."""
        # 1, 1: with velocities, and positions computed anew; PyBullet otherwise gives those of the step before
        light, heavy = self._world.api.getLinkStates(self._body, self._ends, 1, 1, physicsClientId=self._world.client)
        self._light_position, self._heavy_position = light[0], heavy[0]
        (x, y, _), (vx, vy, _) = light[0], light[6]
        return x, y, vx, vy, 0.0 if self._held else heavy[6][1]

    def apply_forces(self, light: tuple[float, float], heavy: float) -> None:
        """Apply forces [N] to the light mass, and upward to the heavy one, at the positions that `read_motion` last read."""
        self._world.apply_force(self._body, self._ends[0], light, self._light_position)
        if not self._held:
            self._world.apply_force(self._body, 0, (0.0, heavy), self._heavy_position)


def set_joints(world: World, body: int, chain: ChainState, turns: Array, *, sliding: bool) -> None:
    """Set the joints of ``body`` to the angles ``turns`` [rad], and their rates so that the links move as in ``chain``.

    Parameters
    ----------
    turns
        Angle of every hinge, relative to the link before it [rad].
    sliding
        Whether joint 0 is the heavy mass's slide, with the hinges behind it.
    """
    rates, first = chain.turn_rates, 0
    if sliding:
        # The heavy mass cannot swing: the first link turns so that its node keeps its velocity, and the slide gives.
        first = 1
        x, y = chain.positions[1] - chain.positions[0]
        vx, vy = chain.velocities[1]
        rates[0] = -vx / y
        world.api.resetJointState(body, 0, 0.0, float(vy - rates[0] * x), physicsClientId=world.client)
    hinge_rates = np.diff(rates, prepend=0.0).tolist()
    for i, (turn, rate) in enumerate(zip(turns.tolist(), hinge_rates, strict=True)):
        world.api.resetJointState(body, first + i, turn, rate, physicsClientId=world.client)


def free_joints(world: World, body: int, joints: int, *, motors: bool) -> None:
    """Switch off what would brake the joints: damping, speed limit, and (unless ``motors``) the motor in every joint.

    Raises
    ------
    EngineError
        If PyBullet still damps a joint.
    """
    world.remove_damping(body)
    if not motors:
        world.api.setJointMotorControlArray(
            body, range(joints), world.api.VELOCITY_CONTROL, forces=[0.0] * joints, physicsClientId=world.client
        )  # a velocity motor without force is none
    damping = world.api.getJointInfo(body, joints - 1, physicsClientId=world.client)[6]
    if damping != 0:
        raise EngineError(f"pybullet: joint {joints - 1} has a damping of {damping:g}")


LINK_CONTACT: Mapping[str, Any] = {
    "friction_law": "Coulomb contact at every node; the adapter solves its coefficient from the capstan law for the polygon's "
    "corners",
    "stick_slip": "Coulomb contact",
}
"""How Bullet supplies the friction of a chain of links."""


class PybulletVariant(TunedEngine):
    """A variant of the apparatus in PyBullet."""

    name = "pybullet"
    distribution = "pybullet"

    def build(self, scenario: Scenario) -> Rig:
        """Build the scenario's apparatus at the moment of release."""
        if scenario.parameters.release is Release.DROP:
            return FallingRig(scenario.parameters, self.settings)
        return super().build(scenario)

    def end_length(self, scenario: Scenario) -> float:
        """Return the free length [m] at which the run ends: a chain cannot follow once only its last link is left."""
        last_link: float = self.settings.outer_link_length
        return max(super().end_length(scenario), last_link)


def step_rungs(settings: WorldSettings) -> LadderRow:
    """Return a ladder of time steps, from four times to half of the settings' own."""
    # Whole numbers of steps per sample, and no step below 1 us
    counts = (min(round(SAMPLE_INTERVAL / settings.time_step / n), round(SAMPLE_INTERVAL / 1e-6)) for n in (4, 2, 1, 0.5))
    return "time_step", "s", [SAMPLE_INTERVAL / count for count in counts]


def iteration_rungs(settings: WorldSettings) -> LadderRow:
    """Return a ladder of solver iterations that includes the settings' own number."""
    return "solver_iterations", "", sorted({5, 10, 20, 40, 80, settings.solver_iterations})


def world_defaults(settings: WorldSettings) -> tuple[DefaultRow, ...]:
    """Return PyBullet's defaults that concern every variant."""
    s = settings
    return (
        (
            "fixedTimeStep",
            "1/240 s (run at 1 ms, where samples fall)",
            quantity(s.time_step, "s", 3),
            "length of a step",
            {"time_step": LARGEST_STEP},
        ),
        default_row(s, "solver_iterations", DEFAULT_ITERATIONS, "numSolverIterations", "sweeps of the solver"),
        (
            "linearDamping",
            f"{DEFAULT_DAMPING:g} /s",
            f"{s.linear_damping:g}",
            "share of a velocity lost per second",
            {"linear_damping": DEFAULT_DAMPING},
        ),
        (
            "angularDamping",
            f"{DEFAULT_DAMPING:g} /s",
            f"{s.angular_damping:g}",
            "share of an angular velocity lost per second",
            {"angular_damping": DEFAULT_DAMPING},
        ),
        (
            "contactBreakingThreshold",
            f"{1e3 * DEFAULT_NEIGHBOUR_MARGIN:g} mm",
            f"{1e3 * s.neighbour_margin:g} mm",
            "how large the boxes are that find neighbours; the sweep's order with them",
            {"neighbour_margin": DEFAULT_NEIGHBOUR_MARGIN},
        ),
        (
            "rod",
            "GEOM_CYLINDER, the obvious shape",
            "GEOM_SPHERE",
            "which collision algorithm finds the contacts",
            {"rod": RodShape.CYLINDER},
        ),
    )


def common_choices(settings: WorldSettings) -> tuple[ChoiceRow, ...]:
    """Return what an adapter of a chain decides: corrections for corners, the contact, how often forces are updated."""
    s, share = settings, "share of a penetration taken back in a step"
    return (
        ("radius and coefficient", "corrected for the corners", "the circle's own", {"polygon": False}),
        ("node radius", quantity(s.node_radius, "m", 3), "1 mm", {"node_radius": 1e-3}),
        ("steps between two updates of the forces", f"{s.force_interval}", "1", {"force_interval": 1}),
        (share, f"{s.contact_error_reduction:g}", "0.02", {"contact_error_reduction": 0.02}),
    )
