"""What the chains of links between nodes share: the contacts' friction, a chain at one moment, and a multibody of links."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from looping_pendulum.engines.chain import SlipGauge, polygon_friction, polygon_radius
from looping_pendulum.engines.pybullet.world import LongestStep, Row, SteppedRig, World, WorldSettings
from looping_pendulum.engines.studies import LadderRow
from looping_pendulum.errors import EngineError
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import Parameters, Release

MEAN_TURN_TO_HALT = math.pi / 2
"""Typical wrap angle beyond the release's, averaged over a looping mass's motion until the halt [rad]."""
MAX_BEND = 1.3
"""Largest bend at a node [rad]: beyond it friction at the corners no longer is that of a circle."""


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


@dataclass(frozen=True, kw_only=True)
class LinkSettings(WorldSettings):
    """Settings of variants that consist of links between nodes."""

    link_length: float
    """Length of a link that may lie on the rod [m]; longer on a thick rod, see `least_bend`."""
    bead_mass_ratio: float
    """Mass of a node over the light mass. Stable below steps of about sqrt(its mass x link length / tension)."""
    least_bend: float = 0.2
    """Smallest angle between links on the rod [rad]: on a thick rod, which needs no shorter ones, links are longer."""

    def link_rungs(self) -> LadderRow:
        """Return a ladder of link lengths along which the string's mass per length is constant."""
        density = self.bead_mass_ratio / self.link_length
        rungs = [{"link_length": h, "bead_mass_ratio": density * h} for h in (4e-3, 3.5e-3, 3e-3, 2.5e-3, 2e-3)]
        return "link_length", "m", rungs, "a node's mass, so that the string's mass per length stays"

    def length_on_rod(self, parameters: Parameters) -> float:
        """Return the length of a link on the rod [m].

        Raises
        ------
        EngineError
            If it would bend too far there.
        """
        radius = parameters.rod_radius
        if self.link_length > MAX_BEND * radius:
            raise EngineError(
                f"pybullet: links of {1e3 * self.link_length:.3g} mm cannot wrap a rod of radius {1e3 * radius:.3g} mm; "
                f"shorten link_length to {1e3 * MAX_BEND * radius:.2g} mm or less"
            )
        return fitting_length(parameters, max(self.link_length, self.least_bend * radius))

    def last_link_length(self, parameters: Parameters) -> float:
        """Return the free length [m] with which only the last link is left."""
        return 2 * self.length_on_rod(parameters)

    def node_circle(self, parameters: Parameters) -> float:
        """Return the distance of a node on the rod from the rod's centre [m]."""
        radius = parameters.rod_radius
        return float(polygon_radius(radius, self.length_on_rod(parameters) / radius)) if self.polygon else radius

    def friction(self, parameters: Parameters, wrap_angle: float, rod_radius: float) -> float:
        """Return the contact coefficient of nodes on a rod whose sphere has ``rod_radius`` [m].

        Friction acts where a node touches the rod, tension at the node: their lever arms differ by the node's radius.
        """
        p = parameters
        law = p.coefficients["kinetic_friction"]
        if self.polygon:
            law = contact_friction(law, self.length_on_rod(p) / p.rod_radius, wrap_angle)
        return law * self.node_circle(p) / rod_radius


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
        return (x, y, vx, vy, self._parameters.rod_radius, heavy_y, 0.0, heavy_v, 0.0, self._read_slip(heavy_y))

    def _read_slip(self, heavy_y: float) -> float:
        """Return how far the string has slid over the rod [m]; links are rigid, so node distances are their rest lengths."""
        nodes = range(0 if self._held else 1, self._ends[0] + 1)  # the first link is the heavy mass's, unless it is held
        # Positions as PyBullet computed them for `read_motion`, a moment before
        rows = self._world.api.getLinkStates(self._body, nodes, physicsClientId=self._world.client)
        positions = [*(row[0][:2] for row in reversed(rows)), (self._parameters.rod_radius, heavy_y)]
        return self._slip.read(positions, list(map(math.dist, positions[:-1], positions[1:])))

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
