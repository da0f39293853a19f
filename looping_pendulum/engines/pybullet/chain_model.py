"""The chain that represents the string in PyBullet: its links' positions and velocities at release, and its URDF."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from looping_pendulum.engines.chain import MASS_COMPENSATION, MASS_FRACTION, polygon_radius
from looping_pendulum.engines.pybullet.links import ChainState
from looping_pendulum.engines.pybullet.multibody import MAX_JOINTS
from looping_pendulum.engines.pybullet.settings import NO_SPEED_LIMIT, WorldSettings
from looping_pendulum.errors import EngineError
from looping_pendulum.reference_ode.cartesian import release_velocity
from looping_pendulum.reference_ode.geometry import Array, light_position
from looping_pendulum.reference_ode.parameters import Parameters, Release

MAX_LINK_LENGTHENING = 1.5
"""Largest factor by which links may be longer than the settings say, so that a long string fits `MAX_JOINTS`."""


@dataclass(frozen=True, kw_only=True)
class PybulletChainSettings(WorldSettings):
    """Numerical settings of the link chain, stable below steps of about link length over sqrt(tension / mass per length)."""

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
    light = np.array(light_position(np, p.free_length, p.release_angle, p.rod_radius))
    heavy = np.array([p.rod_radius, -p.hanging_length])
    if p.release is Release.VERTICAL:
        # The wrap angle is constant. Links that divide it reach and leave the rod at the same moments, so that the ripple which
        # a passing node makes in the string's speed is the same at both ends, and the masses do not feel it.
        wound = p.rod_radius * p.release_angle
        inner = wound / math.ceil(wound / inner)
    on_rod = _nodes_on_rod(p, s, inner)
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
    vx, vy, heavy_v = release_velocity(p)
    sliding = heavy_v / np.hypot(*on_rod.T)[:, None] * np.stack([-on_rod[:, 1], on_rod[:, 0]], axis=1)
    positions = along(heavy, on_rod, light)
    velocities = along(np.array([0.0, heavy_v]), sliding, np.array([vx, vy]))
    lengths = np.linalg.norm(np.diff(positions, axis=0), axis=1)
    # Hanging links do not come to lie on the rod: their last node bends as the links above it do.
    lengths_on_rod = np.where(np.arange(len(lengths)) < hanging_count, inner, lengths)
    local = 0.5 * (lengths_on_rod[1:] + lengths_on_rod[:-1])
    bends = local / p.rod_radius
    circles = np.asarray(polygon_radius(p.rod_radius, bends)) if s.polygon else np.full(len(bends), p.rod_radius)
    return ReleasedChain(positions=positions, velocities=velocities, bends=bends, node_circles=circles)


def _nodes_on_rod(p: Parameters, s: PybulletChainSettings, link_length: float) -> Array:
    """Return the nodes [m] on the rod at release, heavy side first, symmetric about the middle of the wound string."""
    bend = link_length / p.rod_radius
    circle = polygon_radius(p.rod_radius, bend) if s.polygon else p.rod_radius
    links = round(p.release_angle / bend)
    angles = 0.5 * p.release_angle + bend * (np.arange(links + 1) - 0.5 * links)
    return np.stack([circle * np.cos(angles), circle * np.sin(angles)], axis=1)


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


def _link(name: str, *, mass: float, at: float, inertia: float, node_radius: float | None = None) -> str:
    """Return the URDF of a link: a point-like mass ``at`` [m] along it, with a contact sphere there if it is a node."""
    origin = f'<origin xyz="{float(at)!r} 0 0"/>'
    i = float(inertia)
    node = f'<collision>{origin}<geometry><sphere radius="{node_radius!r}"/></geometry></collision>' if node_radius else ""
    return (
        f'<link name="{name}"><inertial>{origin}<mass value="{float(mass)!r}"/>'
        f'<inertia ixx="{i!r}" ixy="0" ixz="0" iyy="{i!r}" iyz="0" izz="{i!r}"/></inertial>{node}</link>'
    )


def _joint(kind: str, parent: str, child: str, *, x: float, y: float, turn: float, axis: str) -> str:
    # A lower limit above the upper one means none; a slide needs the element to be read at all.
    limit = f'<limit lower="1" upper="-1" effort="0" velocity="{NO_SPEED_LIMIT!r}"/>' if kind == "prismatic" else ""
    return (
        f'<joint name="to_{child}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{float(x)!r} {float(y)!r} 0" rpy="0 0 {float(turn)!r}"/><axis xyz="{axis}"/>{limit}</joint>'
    )
