"""PyBullet: the string is one multibody of links that slides over the rod under Bullet's own Coulomb contact.

A Featherstone multibody cannot stretch: a fixed base carries the heavy mass on a vertical slide, and from it one hinge after
another leads along the string to the light mass. Each link has a small contact sphere at its end, a *node*. The rod is a static
sphere: it has the rod's section in the plane of motion, and sphere on sphere is Bullet's one exact contact.

A step of a Featherstone multibody costs about its number of links times its number of contacts. Links must be short where they
lie on the rod or may soon do so; a straight part needs no short ones. So with the quick profile several links away from the rod
are joined to one (`Joining`). A long link is split before it reaches the rod, which changes neither positions nor velocities.
Links that have left the rod are joined, which keeps the chain's momentum.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from looping_pendulum.engines.chain import (
    MASS_COMPENSATION,
    MASS_FRACTION,
    ONE_COEFFICIENT,
    hanging_rest_length,
    polygon_radius,
)
from looping_pendulum.engines.protocol import Abilities, Profile, Rig, SteppedEngine
from looping_pendulum.engines.pybullet.world import (
    DEFAULT_DAMPING,
    DEFAULT_ITERATIONS,
    DEFAULT_NEIGHBOUR_MARGIN,
    DEFAULT_SPEED_LIMIT,
    LARGEST_STEP,
    NO_SPEED_LIMIT,
    FallingRig,
    LongestStep,
    PybulletChainSettings,
    PybulletRig,
    Row,
    contact_friction,
    typical_wrap_angle,
)
from looping_pendulum.engines.shipped import shipped_abilities
from looping_pendulum.engines.studies import Ladder, Studies, Variation, default_row
from looping_pendulum.errors import EngineError
from looping_pendulum.pages.numbers import quantity
from looping_pendulum.reference_ode.cartesian import Vector, masses_at_release
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import Parameters, Release
from looping_pendulum.reference_ode.solve import solve
from looping_pendulum.runs.trajectory import SAMPLE_INTERVAL
from looping_pendulum.scenarios.scenario import Scenario

MAX_JOINTS = 121
"""Largest number of joints whose state PyBullet reports correctly: it has room for 128 numbers, 7 of them the base's.

With more, the first links' positions come back overwritten; beyond 127 PyBullet drops the joints themselves without an error.
"""
MAX_LINK_LENGTHENING = 1.5
"""Largest factor by which links may be longer than the settings say, so that a long string fits `MAX_JOINTS`."""


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
class ReleasedChain(ChainState):
    """The chain at release: positions, velocities, and what each node does where it lies on the rod."""

    bends: Array
    """Angle that the string turns through at each inner node where it lies on the rod [rad], shape (n - 2,)."""
    node_circles: Array
    """Distance of each inner node from the rod's centre where it lies on the rod [m], shape (n - 2,)."""


def chain_at_release(parameters: Parameters, settings: PybulletChainSettings) -> ReleasedChain:
    """Return the chain along the string at release: masses exactly in place, nodes on the rod at their circle.

    A string that needs more joints than PyBullet can hold gets evenly longer links, up to `MAX_LINK_LENGTHENING` times.

    Raises
    ------
    EngineError
        If a link is longer than the rod is thick, or the links would be longer than that.
    """
    p, s = parameters, settings
    inner = max(s.link_length, s.least_bend * p.rod_radius)
    outer = max(s.outer_link_length, inner)
    coarser = 1.0
    while True:
        if outer * coarser > 2 * p.rod_radius:
            raise EngineError(
                f"pybullet:chain: links of {1e3 * outer * coarser:.3g} mm cannot wrap a rod of radius "
                f"{1e3 * p.rod_radius:.3g} mm; shorten link_length and outer_link_length"
            )
        chain = _chain_of_links(p, s, inner * coarser, outer * coarser)
        joints = len(chain.positions)  # one hinge per link, and the heavy mass's slide
        if joints <= MAX_JOINTS:
            return chain
        # By trial, as the number of links is known only once they are laid
        coarser *= 1.01
        if coarser > MAX_LINK_LENGTHENING:
            raise EngineError(
                f"pybullet:chain: the string of {p.string_length:.3g} m needs {joints} joints of longer links "
                f"and PyBullet holds {MAX_JOINTS}; raise link_length or outer_link_length, or shorten the string"
            )


def _chain_of_links(p: Parameters, s: PybulletChainSettings, inner: float, outer: float) -> ReleasedChain:
    """Return a chain of links of about ``inner`` [m] and, near the light mass, ``outer`` [m]."""
    masses = masses_at_release(p)
    light, heavy = np.array(masses.light_position), np.array(masses.heavy_position)
    if p.release is Release.VERTICAL:
        # The wrap angle is constant. Links that divide it reach and leave the rod at the same moments, so that the ripple which
        # a passing node makes in the string's speed is the same at both ends, and the masses do not feel it.
        wound = p.rod_radius * p.release_angle
        inner = wound / math.ceil(wound / inner)
    bend = inner / p.rod_radius
    circle = polygon_radius(p.rod_radius, bend) if s.polygon else p.rod_radius
    links_on_rod = round(p.release_angle / bend)
    # Evenly about the wound string's middle, the heavy side's end first
    angles = 0.5 * p.release_angle + bend * (np.arange(links_on_rod + 1) - 0.5 * links_on_rod)
    on_rod = np.stack([circle * np.cos(angles), circle * np.sin(angles)], axis=1)
    straight = math.dist(on_rod[-1], light)
    inner_count = round(s.sliding_share * straight / inner)
    outer_count = max(1, round((straight - inner_count * inner) / outer))
    hanging_count = max(1, round(math.dist(heavy, on_rod[0]) / s.hanging_link_length))
    corner = inner_count * inner / straight
    # First short links, which may slide over the rod, then long ones, which at most wind on to it
    shares = np.concatenate([np.linspace(0.0, corner, inner_count, endpoint=False), np.linspace(corner, 1.0, outer_count + 1)])

    def along(heavy_end: Array, on_rod: Array, light_end: Array) -> Array:
        """Return values at all nodes: linear from the heavy end to the rod, ``on_rod``, linear from there to the light end."""
        hanging = np.linspace(heavy_end, on_rod[0], hanging_count, endpoint=False)
        return np.concatenate([hanging, on_rod[:-1], on_rod[-1] + shares[:, None] * (light_end - on_rod[-1])])

    # A push turns the free part about its tangent point, and slides the string at the heavy mass's speed.
    sliding = masses.heavy_velocity[1] / np.hypot(*on_rod.T)[:, None] * np.stack([-on_rod[:, 1], on_rod[:, 0]], axis=1)
    positions = along(heavy, on_rod, light)
    velocities = along(np.array(masses.heavy_velocity), sliding, np.array(masses.light_velocity))
    lengths = np.linalg.norm(np.diff(positions, axis=0), axis=1)
    # Hanging links do not come to lie on the rod: their last node bends as the links above it do.
    lengths_on_rod = np.where(np.arange(len(lengths)) < hanging_count, inner, lengths)
    local = 0.5 * (lengths_on_rod[1:] + lengths_on_rod[:-1])
    bends = local / p.rod_radius
    circles = np.asarray(polygon_radius(p.rod_radius, bends)) if s.polygon else np.full(len(bends), p.rod_radius)
    return ReleasedChain(positions=positions, velocities=velocities, bends=bends, node_circles=circles)


def body_masses(p: Parameters, s: PybulletChainSettings, lengths: Array, last_length: float) -> Array:
    """Return the masses [kg] of the heavy mass, the nodes and the light mass, of a chain with links of ``lengths`` [m].

    A node has half the mass of either link beside it. The light mass has none of its link's, which `mass_compensation`
    allows for; a last link longer than ``last_length`` [m], that at release, gives it half of the difference.
    """
    string_mass = MASS_FRACTION * p.light_mass
    density = string_mass / lengths.sum()
    light_mass = p.light_mass - s.mass_compensation * string_mass + 0.5 * density * (lengths[-1] - last_length)
    return np.concatenate([[p.heavy_mass], density * 0.5 * (lengths[:-1] + lengths[1:]), [light_mass]])


def chain_urdf(p: Parameters, s: PybulletChainSettings, chain: ChainState, masses: Array, node_radii: Array) -> str:
    """Return the multibody as URDF: base, heavy mass on a vertical slide (unless held), links, light mass at the last end.

    Parameters
    ----------
    masses
        Masses of the bodies [kg], see `body_masses`.
    node_radii
        Radius of each inner node's contact sphere [m], heavy side first.
    """
    lengths = chain.lengths
    x, y = chain.positions[0]
    rows = [_link("base", mass=0.0, at=0.0, inertia=0.0)]
    parent = "base"
    if p.release is not Release.HELD:
        parent = "heavy"
        # The moment of inertia has no influence on a slide, but URDF requires one
        rows += [_link(parent, mass=p.heavy_mass, at=0.0, inertia=p.heavy_mass * p.rod_radius**2)]
        rows += [_joint("prismatic", "base", parent, x=x, y=y, turn=0.0, axis="0 1 0")]
        x = y = 0.0
    last = len(lengths) - 1
    turns = np.diff(chain.directions, prepend=0.0)
    for i, (turn, length, mass) in enumerate(zip(turns, lengths, masses[1:], strict=True)):
        node_radius = float(node_radii[i]) if i < last else None
        child = f"link{i}"
        rows += [_link(child, mass=mass, at=length, inertia=s.relative_inertia * mass * length**2, node_radius=node_radius)]
        rows += [_joint("continuous", parent, child, x=x, y=y, turn=turn, axis="0 0 1")]
        parent, x, y = child, length, 0.0
    return "\n".join(['<robot name="string">', *rows, "</robot>"])


NO_VISUAL = '<visual><geometry><box size="0 0 0"/></geometry></visual>'
"""Shape to be drawn of a link: the cheapest one, as PyBullet otherwise computes a mesh for each sphere, in 15 ms per chain."""


def _link(name: str, *, mass: float, at: float, inertia: float, node_radius: float | None = None) -> str:
    """Return the URDF of a link: a point-like mass ``at`` [m] along it, with a contact sphere there if it is a node."""
    origin = f'<origin xyz="{float(at)!r} 0 0"/>'
    i = float(inertia)
    node = f'<collision>{origin}<geometry><sphere radius="{node_radius!r}"/></geometry></collision>' if node_radius else ""
    return (
        f'<link name="{name}"><inertial>{origin}<mass value="{float(mass)!r}"/>'
        f'<inertia ixx="{i!r}" ixy="0" ixz="0" iyy="{i!r}" iyz="0" izz="{i!r}"/></inertial>{NO_VISUAL}{node}</link>'
    )


def _joint(kind: str, parent: str, child: str, *, x: float, y: float, turn: float, axis: str) -> str:
    # A lower limit above the upper one means none; a slide needs the element to be read at all.
    limit = f'<limit lower="1" upper="-1" effort="0" velocity="{NO_SPEED_LIMIT!r}"/>' if kind == "prismatic" else ""
    return (
        f'<joint name="to_{child}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{float(x)!r} {float(y)!r} 0" rpy="0 0 {float(turn)!r}"/><axis xyz="{axis}"/>{limit}</joint>'
    )


class Joining:
    """Which nodes of the chain at release exist: all near the rod, and away from it only the ends of long links.

    Parameters
    ----------
    chain
        Chain at release, with all its nodes.
    joined_links
        Number of links that one long link replaces, on the heavy mass's side and on the light mass's; 1: none are joined.
    unjoined_links
        Number of links that stay short beyond the string on the rod, on either side.
    rod_radius
        Radius of the rod [m].
    """

    def __init__(self, chain: ReleasedChain, joined_links: tuple[int, int], unjoined_links: float, rod_radius: float) -> None:
        self._last, self._counts = len(chain.positions) - 1, joined_links
        self._near_square = (chain.node_circles**2 + (unjoined_links * chain.bends * rod_radius) ** 2).tolist()
        self._short = (0, self._last)
        self.nodes = list(range(self._last + 1))
        """Indices, in the chain at release, of the nodes that exist; the first and last one are the masses."""

    def update(self, positions: Sequence[Sequence[float]]) -> bool:
        """Choose the nodes anew, where those that exist are at ``positions`` [m]; return whether others shall exist now."""
        near = [
            i for i, (x, y) in zip(self.nodes[1:-1], positions[1:-1], strict=True) if x * x + y * y < self._near_square[i - 1]
        ]
        if not near:
            return False
        (heavy_count, light_count), (first, last), end = self._counts, self._short, self._last
        short = (_short_from(first, near[0], heavy_count), end - _short_from(end - last, end - near[-1], light_count))
        if short == self._short:
            return False
        first, last = self._short = short
        # Long links are counted from the masses, so that the others stay as they are when one is joined or split
        self.nodes = [*range(0, first, heavy_count), *range(first, last + 1), *range(end, last, -light_count)[::-1]]
        return True


def _short_from(now: int, near: int, count: int) -> int:
    """Return from which node on links are short, if they now are from node ``now`` on, and ``near`` is the first near the rod.

    Nodes are counted from a mass. The link before ``near`` is short too; joining waits for two more, so that it is not undone.
    """
    if count > 1 and (now > near - 1 or now + count <= near - 3):
        return max(near - 1, 0) // count * count
    return now


def with_nodes(chain: ChainState, nodes: Sequence[int], kept: Sequence[int], arc: Array) -> ChainState:
    """Return ``chain``, whose nodes have the indices ``nodes``, with those of indices ``kept``: new ones lie on its links.

    Parameters
    ----------
    arc
        String length from the heavy mass at every index [m].
    """
    old, new = arc[list(nodes)], arc[list(kept)]
    positions, velocities = (
        np.stack([np.interp(new, old, column) for column in rows.T], axis=1) for rows in (chain.positions, chain.velocities)
    )
    return ChainState(positions=positions, velocities=velocities)


def with_rigid_links(chain: ChainState, masses: Array, *, held: bool) -> ChainState:
    """Return ``chain`` with velocities that rigid links allow, after nodes were left out of it.

    Nodes oscillate across the string, so what were neighbours of theirs move towards or away from one another. The velocities
    become those that are nearest to the present ones in the sense of kinetic energy: the bodies exchange the impulses of rigid
    links, as in a plastic collision, and their momentum along every possible motion remains.

    Parameters
    ----------
    masses
        Masses of the bodies [kg], heavy mass first.
    held
        Whether the heavy mass cannot move; otherwise it moves vertically only.
    """
    n = len(chain.positions)
    motion = np.zeros((n, 2, n))  # of every body, for unit speed of the heavy mass or unit turn rate of a link
    motion[:, 1, 0] = 0.0 if held else 1.0
    for link, (dx, dy) in enumerate(np.diff(chain.positions, axis=0).tolist(), start=1):
        motion[link:, 0, link], motion[link:, 1, link] = -dy, dx
    weights = np.sqrt(masses)[:, None]
    rates = np.linalg.lstsq((weights[..., None] * motion).reshape(2 * n, n), (weights * chain.velocities).ravel(), rcond=None)[
        0
    ]
    return ChainState(positions=chain.positions, velocities=motion @ rates)


MAX_WAVE_FRACTION = 0.9
"""Largest fraction of a link that a wave on the chain may pass in one step; a chain of equal links is unstable above 1."""
REFERENCE_SAMPLES = 2000
"""Number of samples of the reference's run, of which the largest friction on the rod is taken."""
MAX_WAVE_FRACTION_AT_CONTACTS = 0.55
"""Largest fraction of a link that a wave may pass in one step, at the largest rod friction T2 - T1 until the halt.

Contacts are less stable than the chain: at fractions up to 0.54 ten_to_one halts; 15:1 at 130 deg diverged at 0.63.
"""
HALT_DELAY = 0.1
"""How much later than in the reference's run the heavy mass may halt while the step still allows for its fall [s]."""


ROD_LENGTH = 0.02
"""Length of a rod that is a cylinder [m]."""


class PybulletChainRig(PybulletRig):
    """The apparatus with a string of links in one multibody, which another one replaces when links are joined or split."""

    def __init__(self, parameters: Parameters, settings: PybulletChainSettings) -> None:
        p, s = parameters, settings
        chain = chain_at_release(p, s)
        super().__init__(p, s, longest_step(p, s, chain) if s.divided_step else None)
        rod_radius = float(chain.node_circles.min()) - s.node_radius
        self._add_rod(rod_radius)
        self._node_radii = chain.node_circles - rod_radius
        wrap_angle, law = typical_wrap_angle(p), p.coefficients["kinetic_friction"]
        self._friction = [
            # Friction acts where a node touches the rod, tension at the node: their lever arms differ by the node's radius.
            (contact_friction(law, bend, wrap_angle) if s.polygon else law) * circle / rod_radius
            for bend, circle in zip(chain.bends.tolist(), chain.node_circles.tolist(), strict=True)
        ]
        self._arc = np.concatenate([[0.0], np.cumsum(chain.lengths)])
        self._last_length = float(chain.lengths[-1])
        self._joining = Joining(chain, (s.joined_hanging_links, s.joined_free_links), s.unjoined_links, p.rod_radius)
        self._joins = max(s.joined_hanging_links, s.joined_free_links) > 1
        nodes = self._joining.nodes
        if self._joins and self._joining.update(chain.positions.tolist()):
            # At release the straight parts are straight and move as rigid links do
            self._create_multibody(with_nodes(chain, nodes, self._joining.nodes, self._arc))
        else:
            self._create_multibody(chain)

    def advance(self) -> None:
        """Advance by one sample interval with the effects' forces, and join or split the links that are due."""
        super().advance()
        # Meanwhile the string moves by a fraction of the links that stay short beyond the rod
        if not self._joins:
            return
        nodes, chain = self._joining.nodes, self._chain()
        if not self._joining.update(chain.positions.tolist()):
            return
        kept = self._joining.nodes
        updated = with_nodes(chain, nodes, kept, self._arc)
        if not set(nodes) <= set(kept):
            masses = body_masses(self._parameters, self._settings, updated.lengths, self._last_length)
            updated = with_rigid_links(updated, masses, held=self._held)
        # PyBullet cannot add a link to a multibody, so another one takes its place
        self._server.removeBody(self._body)
        self._create_multibody(updated)

    def read(self) -> Row:
        """Return positions [m], velocities [m/s], string stretch and slip [m]: `COLUMNS` without the time."""
        x, y, vx, vy, heavy_v = self.read_motion()
        heavy_y = -self._parameters.hanging_length if self._held else float(self._heavy_position[1])
        nodes = range(0 if self._held else 1, self._ends[0] + 1)  # the first link is the heavy mass's, unless it is held
        # Positions as PyBullet computed them for `read_motion`, a moment before
        rows = self._server.getLinkStates(self._body, nodes)
        positions = [*(row[0][:2] for row in reversed(rows)), (self._parameters.rod_radius, heavy_y)]
        # Links are rigid, so the nodes' distances are their rest lengths
        slip = hanging_rest_length(positions, list(map(math.dist, positions[:-1], positions[1:])))
        return (x, y, vx, vy, self._parameters.rod_radius, heavy_y, 0.0, heavy_v, 0.0, slip)

    def _chain(self) -> ChainState:
        """Return positions and velocities of the masses and nodes."""
        rows = self._server.getLinkStates(self._body, range(self._ends[0] + 1), 1, 1)
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
        light, heavy = self._server.getLinkStates(self._body, self._ends, 1, 1)
        self._light_position, self._heavy_position = light[0], heavy[0]
        (x, y, _), (vx, vy, _) = light[0], light[6]
        return x, y, vx, vy, 0.0 if self._held else heavy[6][1]

    def apply_forces(self, light: Vector, heavy: float) -> None:
        """Apply forces [N] to the light mass, and upward to the heavy one, at the positions that `read_motion` last read."""
        self._apply_force(self._body, self._ends[0], light, self._light_position)
        if not self._held:
            self._apply_force(self._body, 0, (0.0, heavy), self._heavy_position)

    def _create_multibody(self, chain: ChainState) -> None:
        """Create the multibody of the nodes that exist, which are where ``chain`` says."""
        p, s = self._parameters, self._settings
        inner = [i - 1 for i in self._joining.nodes[1:-1]]
        masses = body_masses(p, s, chain.lengths, self._last_length)
        self._body = self._load(chain_urdf(p, s, chain, masses, self._node_radii[inner]))
        links = len(chain.lengths)
        joints = links + (not self._held)
        joint_count = self._server.getNumJoints(self._body)
        # PyBullet drops joints beyond its limit without an error
        if joint_count != joints:
            raise EngineError(f"pybullet:chain: {joints} joints were given, PyBullet took {joint_count}")
        self._ends = (joints - 1, 0)
        self._free_joints(joints)
        for joint, i in enumerate(inner, start=joints - links):
            self._set_friction(self._body, joint, self._friction[i])
        if chain.velocities.any():
            self._set_joint_rates(chain)

    def _free_joints(self, joints: int) -> None:
        """Switch off what would brake the joints: damping, speed limit and, unless the settings leave it on, each one's motor.

        Raises
        ------
        EngineError
            If PyBullet still damps a joint.
        """
        server, body = self._server, self._body
        self._remove_damping(body)
        if not self._settings.joint_motors:
            # A velocity motor without force is none
            server.setJointMotorControlArray(body, range(joints), server.VELOCITY_CONTROL, forces=[0.0] * joints)
        damping = server.getJointInfo(body, joints - 1)[6]
        if damping != 0:
            raise EngineError(f"pybullet: joint {joints - 1} has a damping of {damping:g}")

    def _set_joint_rates(self, chain: ChainState) -> None:
        """Set the rates of the joints so that the links move as in ``chain``."""
        rates, first = chain.turn_rates, 0
        if not self._held:
            # The heavy mass cannot swing: the first link turns so that its node keeps its velocity, and the slide gives.
            first = 1
            x, y = chain.positions[1] - chain.positions[0]
            vx, vy = chain.velocities[1]
            rates[0] = -vx / y
            self._server.resetJointState(self._body, 0, 0.0, float(vy - rates[0] * x))
        for joint, rate in enumerate(np.diff(rates, prepend=0.0).tolist(), start=first):
            self._server.resetJointState(self._body, joint, 0.0, rate)

    def _add_rod(self, radius: float) -> None:
        """Create the rod, of ``radius`` [m]."""
        server = self._server
        if self._settings.rod == "sphere":
            shape = server.createCollisionShape(server.GEOM_SPHERE, radius=radius)
        else:
            shape = server.createCollisionShape(server.GEOM_CYLINDER, radius=radius, height=ROD_LENGTH)
        # PyBullet multiplies both coefficients: with 1 here, each node carries that of its contact
        self._set_friction(server.createMultiBody(0, shape, -1, [0, 0, 0]), -1, 1.0)

    def _set_friction(self, body: int, link: int, friction: float) -> None:
        """Set the contact friction coefficient of a link.

        Raises
        ------
        EngineError
            If PyBullet reports another coefficient afterwards.
        """
        server = self._server
        if self._settings.friction_with_damping and link >= 0:
            # PyBullet ignores a friction that comes together with a damping
            server.changeDynamics(body, link, lateralFriction=friction, linearDamping=0, angularDamping=0)
            return
        server.changeDynamics(body, link, lateralFriction=friction, rollingFriction=0, spinningFriction=0, restitution=0)
        actual = server.getDynamicsInfo(body, link)[1]
        if not math.isclose(actual, friction, rel_tol=1e-9, abs_tol=1e-15):
            raise EngineError(f"pybullet: asked for a friction of {friction:g} on link {link}, PyBullet took {actual:g}")

    def _load(self, urdf: str) -> int:
        """Load a body on a fixed base, from a temporary file, as PyBullet reads URDF from files only."""
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder, "string.urdf")
            path.write_text(urdf)
            # Without the flag PyBullet computes the inertias from the collision shapes
            flags = self._server.URDF_USE_INERTIA_FROM_FILE
            body: int = self._server.loadURDF(str(path), useFixedBase=1, flags=flags)
        return body


def longest_step(parameters: Parameters, settings: PybulletChainSettings, chain: ReleasedChain) -> LongestStep:
    """Return a function that computes the step [s]: that of the settings or, where it is not stable, an equal part of it.

    A taut chain carries waves at sqrt(tension / mass per length), and an explicit step is stable while they pass less than a
    link in it. No single step would do for a run: as the light mass whips round on ever less string, its tension
    M1 (v^2 / l + g) grows without bound. The rod's friction has a largest value until the halt, which is read from the
    reference's run.
    """
    p, s = parameters, settings
    density = MASS_FRACTION * p.light_mass / float(chain.lengths.sum())
    shortest = float(chain.lengths.min())
    gravity, radius_square = p.coefficients["gravity"], p.rod_radius**2
    friction, halting_time = largest_rod_friction(p)
    contacts = MAX_WAVE_FRACTION_AT_CONTACTS * shortest * math.sqrt(density / friction) if friction > 0 else math.inf

    def longest(t: float, x: float, y: float, vx: float, vy: float) -> float:
        # Not less than a link, with which the run has ended
        free = math.sqrt(max(x * x + y * y - radius_square, shortest * shortest))
        tension = p.light_mass * ((vx * vx + vy * vy) / free + gravity)
        lengthening = 1.0 if t < halting_time + HALT_DELAY else s.lengthening_after_halt
        stable = min(lengthening * contacts, MAX_WAVE_FRACTION * shortest * math.sqrt(density / tension))
        whole = lengthening * s.time_step
        return whole / math.ceil(whole / stable)

    return longest


def largest_rod_friction(parameters: Parameters) -> tuple[float, float]:
    """Return the largest friction T2 - T1 [N] of the string on the rod in the reference's run until its halt, and its time [s].

    The time is infinite where the heavy mass does not halt.
    """
    if parameters.release is Release.HELD:
        return 0.0, math.inf
    run = solve(parameters)
    until = run.end_time if run.halting_time is None else run.halting_time
    light, heavy = run.sample(np.linspace(0.0, until, REFERENCE_SAMPLES)).tensions
    return float(np.nanmax(heavy - light)), math.inf if run.halting_time is None else run.halting_time


SETTINGS = {
    # With 40 iterations, PyBullet's margin and no links joined, ten_to_one takes 2.6 times the CPU time. RMS at 0.35, 0.7 and
    # 1 s, those settings against these: ten_to_one 0.85, 10, 17 mm against 0.5 to 0.7, 7 to 10, 12 to 19 mm in five releases
    # within 0.01 deg or 0.1 mm; two_to_one 1.3, 1.7, 1.9 mm against 1.5, 2.5, 2.4 mm; two_and_a_half_to_one at 0.7 s 0.4 mm,
    # and 0.5 to 1.3 mm if moved by hundredths of a degree, against 1.1 to 1.4 mm. In two_to_one the heavy mass halted 26 to
    # 32 ms late; of five releases up to 6 nanoradians from the shipped one it now halts in four, 0 to 38 ms late, and in one
    # it never does. The smaller margin, not the joining, moves the acceleration of atwood, from 0.03 % too low to 0.23 % too
    # high.
    Profile.QUICK: PybulletChainSettings(
        time_step=2e-5,
        link_length=5e-3,
        outer_link_length=8e-3,
        solver_iterations=36,
        force_interval=10,
        neighbour_margin=2e-3,
        joined_hanging_links=8,
        joined_free_links=2,
        # Most of the time of ten_to_one is spent after the halt. With 1.17 or more, the string of one in four releases within
        # 0.01 deg or 0.1 mm of its own slides once more half a second later; with 10/9 none does
        lengthening_after_halt=10 / 9,
    ),
    # With PyBullet's margin of 20 mm the same run costs 1.6 times as much. At 0.7 s ten_to_one is 3.4 mm off; 1.8 mm with that
    # margin, 1.5 and 2 mm with the start moved by 0.01 deg or 0.1 mm, 6.5, 1.8 and 6.8 mm with steps of 12.5, 8 and 5 us: what
    # is left scatters with how the nodes of 4.4 mm links lie and are swept. With our margin all halt 1.4 to 2.6 ms early.
    Profile.ACCURATE: PybulletChainSettings(
        time_step=1e-5,
        link_length=4.4e-3,
        outer_link_length=8.5e-3,
        solver_iterations=20,
        force_interval=10,
        neighbour_margin=1e-4,
    ),
}

PYBULLET_DEFAULTS = PybulletChainSettings(
    time_step=LARGEST_STEP,
    link_length=5e-3,
    outer_link_length=8e-3,
    solver_iterations=DEFAULT_ITERATIONS,
    force_interval=1,
    linear_damping=DEFAULT_DAMPING,
    angular_damping=DEFAULT_DAMPING,
    speed_limit=DEFAULT_SPEED_LIMIT,
    joint_motors=True,
    rod="cylinder",
    friction_with_damping=True,
    polygon=False,
    divided_step=False,
)
"""PyBullet's default settings, except its step of 1/240 s, which is longer than the sample interval."""


def _abilities(variant: str, *, limits: tuple[str, ...], **declared: Any) -> Abilities:
    """Return the abilities of a variant."""
    return shipped_abilities(
        f"pybullet:{variant}",
        friction_law="Coulomb contact at every node; the adapter solves its coefficient from the capstan law for the polygon's "
        "corners",
        stick_slip="Coulomb contact",
        limits=(
            ONE_COEFFICIENT,
            f"at most {MAX_JOINTS} joints are reported rightly: links of a long string are laid up to {MAX_LINK_LENGTHENING:g} "
            "times longer than the settings say, and a longer string still is refused",
            "explicit steps: where the rod holds back more than at ten_to_one they are shorter than the settings say",
            "links of several millimetres are long for a thin rod: the string's speed over it ripples as nodes pass",
            "reduced coordinates cannot stretch: the string stretch is 0 by construction, not a measurement",
            *limits,
        ),
        # A link that winds on must not be longer than the rod is thick
        min_rod_radius=max(settings.outer_link_length for settings in SETTINGS.values()) / 2,
        **declared,
    )


_WEIGHT = (
    f"a string that weighs {100 * MASS_FRACTION:g} % of the light mass, "
    f"from which {100 * MASS_FRACTION * MASS_COMPENSATION:g} % is taken off"
)
_ABILITIES = {
    "chain": _abilities(
        "chain",
        winding="contact of the links' end spheres with a static sphere of the rod's section; quick: the adapter joins and "
        "splits links on the straight parts only",
        summary="One Featherstone multibody of links that slides over a static sphere under Coulomb contact.",
        limits=(
            "quick: whether two_to_one comes to rest is chance: of five releases up to 6 nanoradians from its own one never "
            "did, and the others halted 0 to 38 ms late",
        ),
        from_reference=("the length of a step",),
        first_additions=(
            _WEIGHT,
            "a contact coefficient and radius solved from the capstan law for the chain's corners: a little of that law is fed "
            "in",
        ),
        additions=(
            "quick: which links away from the rod are one, and when; when links that left the rod are joined, velocities "
            "change as in a plastic collision",
            "how long a step is, from the largest T2 - T1 of the reference's run until its halt, and from the time of that "
            "halt",
            "the wrap angle over which that coefficient is right on average: the release's, and a quarter turn for what "
            "follows",
        ),
    ),
    "defaults": _abilities(
        "defaults",
        winding="contact of the links' end spheres with a static cylinder",
        summary="The same multibody with PyBullet's defaults: damping, joint motors, speed clamp, a cylinder as rod.",
        limits=("PyBullet's own step of 1/240 s is run at 1 ms, where samples fall",),
        additions=(_WEIGHT,),
        main=False,
    ),
}
"""Variant -> what it can do."""


class PybulletChain(SteppedEngine):
    """A chain of links over a rod.

    Parameters
    ----------
    variant
        "chain": over a static sphere, with settings that make it exact.
        "defaults": with PyBullet's own settings.
    """

    name = "pybullet"
    distribution = "pybullet"
    variant = "chain"
    variants = _ABILITIES
    settings_by_profile = SETTINGS | {("defaults", profile): PYBULLET_DEFAULTS for profile in Profile}
    rig = PybulletChainRig
    settings: PybulletChainSettings

    def build(self, scenario: Scenario) -> Rig:
        """Build the scenario's apparatus at the moment of release."""
        if scenario.parameters.release is Release.DROP:
            return FallingRig(scenario.parameters, self.settings)
        return super().build(scenario)

    def end_length(self, scenario: Scenario) -> float:
        """Return the free length [m] at which the run ends: a chain cannot follow once only its last link is left."""
        last_link: float = self.settings.outer_link_length
        return max(super().end_length(scenario), last_link)

    def studies(self) -> Studies:
        """Return ladders of step, link length and iterations, PyBullet's defaults, and the adapter's choices."""
        s = self.settings
        if self.variant == "defaults":  # the studies of "chain" measure each default by itself
            return Studies()
        # From four times to half of the settings' own, in whole numbers of steps per sample, and none below 1 us
        own_count = SAMPLE_INTERVAL / s.time_step
        counts = [min(round(own_count / n), round(SAMPLE_INTERVAL / 1e-6)) for n in (4, 2, 1, 0.5)]
        outer = s.outer_link_length / s.link_length
        # Shorter links do not fit `MAX_JOINTS` in the ten-to-one trial, and would be lengthened
        lengths = sorted({6e-3, 5.5e-3, 5e-3, 4.5e-3, s.link_length}, reverse=True)
        links = [{"link_length": h, "outer_link_length": outer * h} for h in lengths]
        defaults = (
            Variation(
                "fixedTimeStep",
                quantity(s.time_step, "s", 3),
                "1/240 s (run at 1 ms, where samples fall)",
                {"time_step": LARGEST_STEP},
                "length of a step",
            ),
            default_row(s, "solver_iterations", DEFAULT_ITERATIONS, "numSolverIterations", "sweeps of the solver"),
            default_row(s, "linear_damping", DEFAULT_DAMPING, "linearDamping", "share of a velocity lost per second", "/s"),
            default_row(s, "angular_damping", DEFAULT_DAMPING, "angularDamping", "share of a turn rate lost per second", "/s"),
            default_row(
                s,
                "neighbour_margin",
                DEFAULT_NEIGHBOUR_MARGIN,
                "contactBreakingThreshold",
                "how large the boxes are that find neighbours; the sweep's order with them",
                unit="m",
            ),
            default_row(s, "rod", "cylinder", "rod", "which collision algorithm finds the contacts"),
            default_row(s, "speed_limit", DEFAULT_SPEED_LIMIT, "maxJointVelocity", "clamp of every joint's speed"),
            default_row(s, "joint_motors", True, "joint motors", "friction in every hinge"),
            default_row(
                s,
                "friction_with_damping",
                True,
                "friction given together with damping",
                "the contact's coefficient, which PyBullet then ignores: 0.5 stays",
            ),
        )
        choices = (
            Variation("radius and coefficient", "corrected for the corners", "the circle's own", {"polygon": False}),
            Variation("node radius", quantity(s.node_radius, "m", 3), "1 mm", {"node_radius": 1e-3}),
            Variation("steps between two updates of the forces", f"{s.force_interval}", "1", {"force_interval": 1}),
            Variation(
                "share of a penetration taken back in a step",
                f"{s.contact_error_reduction:g}",
                "0.02",
                {"contact_error_reduction": 0.02},
            ),
            Variation(
                "links away from the rod",
                f"joined by {s.joined_hanging_links} below the rod, by {s.joined_free_links} beyond it",
                "separate",
                {"joined_hanging_links": 1, "joined_free_links": 1},
            ),
            Variation(
                "links below the rod",
                quantity(s.hanging_link_length, "m", 3),
                "half as long",
                {"hanging_link_length": 7.5e-3},
            ),
            Variation("inertia of a link", f"{s.relative_inertia:g} m h^2", "three times", {"relative_inertia": 0.03}),
        )
        return Studies(
            ladders=(
                Ladder("time_step", "s", [SAMPLE_INTERVAL / count for count in counts]),
                Ladder("link_length", "m", links, "links that only wind on, in proportion"),
                Ladder("solver_iterations", "", sorted({5, 10, 20, 40, 80, s.solver_iterations})),
            ),
            defaults=[default for default in defaults if self.with_settings(**default.changes).settings != s],
            choices=[choice for choice in choices if self.with_settings(**choice.changes).settings != s],
        )
