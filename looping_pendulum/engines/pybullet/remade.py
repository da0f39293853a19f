"""PyBullet: the multibody of links is created anew whenever a node reaches or leaves the rod, so that it has fewer links.

Only links on the rod have nodes; each straight part of the string is one long link, where `chain` keeps short ones near the
rod. As the string slides or winds, nodes are added where it is about to touch the rod, and removed where it has left it. A node
on a straight part carries no lateral load, so adding or removing it there changes no force; nodes that bear on the rod are
moved by PyBullet alone. It is not as good as `chain`: the adapter chooses when a node is added or removed, and the masses feel
it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from looping_pendulum.engines.chain import MIN_BEADS, MIN_STRAIGHT_LINKS, Point, next_bead_position, point_on_string
from looping_pendulum.engines.protocol import Profile
from looping_pendulum.engines.pybullet.world import (
    LINK_CONTACT,
    MAX_JOINTS,
    NO_STRETCH_LIMIT,
    ONE_COEFFICIENT,
    RIPPLE_LIMIT,
    ChainState,
    LinkSettings,
    MultibodyRig,
    PybulletVariant,
    World,
    free_joints,
    iteration_rungs,
    node_angles,
    set_joints,
    step_rungs,
    typical_wrap_angle,
)
from looping_pendulum.engines.shipped import shipped_abilities
from looping_pendulum.engines.studies import Studies, studies_from_rows
from looping_pendulum.errors import EngineError
from looping_pendulum.reference_ode.cartesian import release_velocity
from looping_pendulum.reference_ode.parameters import Parameters, Release


@dataclass(frozen=True, kw_only=True)
class RemadeSettings(LinkSettings):
    """Numerical settings of the chain that is created anew."""

    comes: float = 0.03
    """A node is added where the straight string would put it on the rod after sliding or winding by this many links."""
    goes: float = 0.08
    """The outermost node is removed when the string has moved by this many links since it left the rod.

    It exceeds `comes`, so that no node is added and removed in turn. A node that stays for longer oscillates across the string.
    """
    relative_inertia: float = 1e-2
    """Moment of inertia of a link over a node's mass times a link's length squared: small, but not singular."""
    look_interval: int = 2
    """Steps between two checks whether to add or remove a node; a test compares it with 1."""
    joint_motors: bool = False
    """Whether to leave on the motor that PyBullet puts in every joint."""


def nodes_at_release(
    parameters: Parameters, settings: LinkSettings, release_velocity: tuple[float, float, float]
) -> ChainState:
    """Return the chain along the string at release: masses exactly in place, nodes on the rod at their circle.

    Parameters
    ----------
    release_velocity
        Velocity of the light mass and upward velocity of the heavy mass [m/s]: vx, vy, heavy vy.
    """
    p, bend = parameters, settings.length_on_rod(parameters) / parameters.rod_radius
    circle = settings.node_circle(p)
    angles = node_angles(p, bend, max(round(p.release_angle / bend), 1))
    vx, vy, heavy_v = release_velocity
    on_rod = np.stack([circle * np.cos(angles), circle * np.sin(angles)], axis=1)
    sliding = heavy_v * np.stack([-np.sin(angles), np.cos(angles)], axis=1)
    heavy, light = (p.rod_radius, -p.hanging_length), point_on_string(p, 0.0, circle)
    return ChainState(positions=np.vstack([heavy, on_rod, light]), velocities=np.vstack([[0.0, heavy_v], sliding, [vx, vy]]))


class NodeChanges:
    """Decides when nodes are added and removed, from where the straight string runs."""

    def __init__(self, parameters: Parameters, settings: RemadeSettings) -> None:
        self._parameters = parameters
        self._length = settings.length_on_rod(parameters)
        lift, circle = self._length**2 / parameters.rod_radius, settings.node_circle(parameters)
        self._adding_radius, self._removal_radius = circle + settings.comes * lift, circle + settings.goes * lift

    def margins(self, positions: Sequence[Point], nodes: int) -> tuple[float, ...]:
        """Return how far the straight string is from adding and from removing a node, on the heavy and on the light side [m].

        A negative distance means that the change is due; it is infinite for a removal while there are `MIN_BEADS` nodes only.

        Parameters
        ----------
        positions
            Of a chain with so many ``nodes`` [m]: all, or at least its three outermost ones on either side.
        """
        heavy, light, spare = positions[0], positions[-1], nodes > MIN_BEADS
        return (
            self._distance_to_adding(heavy, positions[1]),
            self._removal_radius - self._next_node_radius(positions[2], heavy) if spare else math.inf,
            self._distance_to_adding(light, positions[-2]),
            self._removal_radius - self._next_node_radius(positions[-3], light) if spare else math.inf,
        )

    def with_updated_nodes(self, chain: ChainState) -> ChainState:
        """Return the chain with nodes added where it is about to touch the rod, and removed where it has left it."""
        positions, first, last = chain.positions, 1, len(chain.positions) - 1
        while last - first > MIN_BEADS and self._next_node_radius(positions[last - 2], positions[-1]) > self._removal_radius:
            last -= 1
        while last - first > MIN_BEADS and self._next_node_radius(positions[first + 1], positions[0]) > self._removal_radius:
            first += 1
        kept = [0, *range(first, last), len(positions) - 1]
        updated = chain if len(kept) == len(positions) else _without_nodes(chain, kept, self._parameters)
        for _ in range(2):  # the light side, then the heavy one, turned round
            positions, velocities = updated.positions, updated.velocities
            while self._distance_to_adding(positions[-1], positions[-2]) < 0:
                share = self._length / math.dist(positions[-1], positions[-2])
                positions, velocities = (
                    np.insert(row, -1, row[-2] + share * (row[-1] - row[-2]), axis=0) for row in (positions, velocities)
                )
            updated = ChainState(positions=positions[::-1], velocities=velocities[::-1])
        return updated

    def _distance_to_adding(self, mass: Point, node: Point) -> float:
        """Return how far the string is from adding a node between ``node`` and ``mass`` [m]; infinite without room for one."""
        if math.dist(mass, node) < MIN_STRAIGHT_LINKS * self._length:
            return math.inf
        return self._next_node_radius(node, mass) - self._adding_radius

    def _next_node_radius(self, node: Point, mass: Point) -> float:
        """Return the distance from the rod's centre [m] of the point a link away from ``node`` on the way to ``mass``."""
        return math.hypot(*next_bead_position(node, mass, self._length))


def _without_nodes(chain: ChainState, kept: list[int], parameters: Parameters) -> ChainState:
    """Return the chain with the nodes of indices ``kept`` only: those left out lie on the straight parts.

    Such a node oscillates across the line between its neighbours, and the masses feel it: they are nearer together than the
    string is long, and move apart at another speed than with a straight string. Both differences are shared between the masses
    in inverse proportion to them, as the string's pull would do: the string keeps its length, and gets its mean speed.
    """
    p = parameters
    heavy_share = 0.0 if p.release is Release.HELD else p.light_mass / (p.light_mass + p.heavy_mass)
    positions, velocities = chain.positions[kept], chain.velocities[kept].copy()
    along = (positions[-1] - positions[-2]) / math.dist(positions[-1], positions[-2])
    excess = float(chain.lengths.sum()) - float(ChainState(positions=positions, velocities=velocities).lengths.sum())
    moved = positions.copy()
    moved[-1] += (1 - heavy_share) * excess * along
    moved[0, 1] -= heavy_share * excess
    x, y = positions[1] - positions[0]
    heavy_mismatch = velocities[0, 1] - (velocities[1, 1] + velocities[1, 0] * x / y)
    light_mismatch = float((velocities[-1] - velocities[-2]) @ along)
    sliding = (1 - heavy_share) * heavy_mismatch + heavy_share * light_mismatch
    if p.release is not Release.HELD:
        velocities[1:-1] += sliding / p.rod_radius * np.stack([-positions[1:-1, 1], positions[1:-1, 0]], axis=1)
    velocities[-1] += float((velocities[-2] - velocities[-1]) @ along) * along
    return ChainState(positions=moved, velocities=velocities)


class RemadeRig(MultibodyRig):
    """The apparatus with a string of links, in a multibody that is replaced when nodes change."""

    def __init__(self, parameters: Parameters, settings: RemadeSettings) -> None:
        p, s = parameters, settings
        super().__init__(p, World(p, s))
        self._settings = s
        self._length = s.length_on_rod(p)
        rod_radius = s.node_circle(p) - s.node_radius
        self._world.add_rod(rod_radius, 1.0)
        self._friction = s.friction(p, typical_wrap_angle(p), rod_radius)
        self._node = self._node_shape(self._length)
        chain = nodes_at_release(p, s, release_velocity(p))
        self._node_changes = NodeChanges(p, s)
        self._node_count, self.rebuild_count = 0, 0
        self._create_multibody(chain)

    def advance(self) -> None:
        """Advance by one sample interval with the effects' forces, updating the nodes every `look_interval` steps."""
        steps, interval = self._world.steps, self._settings.look_interval
        for done in range(0, steps, interval):
            self.take_steps(min(interval, steps - done))
            self._update_nodes()

    def _update_nodes(self) -> None:
        """Replace the multibody by one with more or fewer nodes, if any is due."""
        api, client, last = self._world.api, self._world.client, self._ends[0]
        slide = 0 if self._held else 1
        # The masses and the two outermost nodes on either side
        joints = [*range(slide + 2), last - 2, last - 1, last]
        positions = [row[0][:2] for row in api.getLinkStates(self._body, joints, physicsClientId=client)]
        if self._held:
            p = self._parameters
            positions.insert(0, (p.rod_radius, -p.hanging_length))
        margins = self._node_changes.margins(positions, self._node_count)
        if not min(margins) < 0:
            return
        chain = self._node_changes.with_updated_nodes(self._chain())
        # PyBullet cannot add a link to a multibody, so another one takes its place
        api.removeBody(self._body, physicsClientId=client)
        self._create_multibody(chain)

    def _create_multibody(self, chain: ChainState) -> None:
        """Create the multibody: base, heavy mass on a vertical slide (unless held), links, light mass at the last one's end."""
        api, client, p, s = self._world.api, self._world.client, self._parameters, self._settings
        lengths = chain.lengths.tolist()
        n, node_mass = len(lengths), s.bead_mass_ratio * p.light_mass
        heavy = [*chain.positions[0].tolist(), 0.0]
        slide = 0 if self._held else 1
        starts = [[0.0, 0.0, 0.0]] * slide + [[0.0, 0.0, 0.0]] + [[length, 0.0, 0.0] for length in lengths[:-1]]
        joints = slide + n
        no_rotation = [0.0, 0.0, 0.0, 1.0]
        self._body = body = api.createMultiBody(
            0,
            -1,
            -1,
            heavy,
            linkMasses=[p.heavy_mass] * slide + [node_mass] * (n - 1) + [p.light_mass],
            linkCollisionShapeIndices=[-1] * slide + [self._node_shape(lengths[0])] + [self._node] * (n - 2) + [-1],
            linkVisualShapeIndices=[-1] * joints,
            linkPositions=starts,
            linkOrientations=[no_rotation] * joints,
            linkInertialFramePositions=[[0.0, 0.0, 0.0]] * slide + [[length, 0.0, 0.0] for length in lengths],
            linkInertialFrameOrientations=[no_rotation] * joints,
            linkParentIndices=list(range(joints)),
            linkJointTypes=[api.JOINT_PRISMATIC] * slide + [api.JOINT_REVOLUTE] * n,
            linkJointAxis=[[0, 1, 0]] * slide + [[0, 0, 1]] * n,
            physicsClientId=client,
        )
        joint_count = api.getNumJoints(body, physicsClientId=client)
        if joint_count != joints or joints > MAX_JOINTS:
            raise EngineError(
                f"pybullet:remade: the wound string needs {joints} joints and PyBullet holds {MAX_JOINTS}; raise link_length"
            )
        self._ends = (joints - 1, 0)
        free_joints(self._world, body, joints, motors=s.joint_motors)
        inertia = s.relative_inertia * node_mass * self._length**2
        for joint in range(slide, joints):
            self._world.change(body, joint, localInertiaDiagonal=[inertia] * 3)
            if joint < joints - 1:
                self._world.set_friction(body, joint, self._friction)
        set_joints(self._world, body, chain, np.diff(chain.directions, prepend=0.0), sliding=not self._held)
        self._node_count = len(chain.positions) - 2
        self.rebuild_count += 1
        self._light_position, self._heavy_position = [*chain.positions[-1].tolist(), 0.0], heavy

    def _node_shape(self, length: float) -> int:
        api = self._world.api
        shape: int = api.createCollisionShape(
            api.GEOM_SPHERE,
            radius=self._settings.node_radius,
            collisionFramePosition=[length, 0.0, 0.0],
            physicsClientId=self._world.client,
        )
        return shape


SETTINGS = {
    Profile.QUICK: RemadeSettings(time_step=2e-5, link_length=3e-3, bead_mass_ratio=1e-3, solver_iterations=20),
    Profile.ACCURATE: RemadeSettings(
        time_step=1e-5, link_length=2.5e-3, bead_mass_ratio=5e-4, solver_iterations=20, look_interval=4, force_interval=10
    ),
}


class PybulletRemade(PybulletVariant):
    """A chain whose links are added and removed as the string winds."""

    variant = "remade"
    settings_by_profile = SETTINGS
    rig = RemadeRig
    settings: RemadeSettings
    abilities = shipped_abilities(
        "pybullet:remade",
        quick_cost=15.0,
        winding="contact of the links' end spheres with a static sphere of the rod's section; the adapter adds and takes off "
        "links on the straight parts only",
        **LINK_CONTACT,
        main=False,
        additions=(
            f"nodes on the rod weigh {100 * SETTINGS[Profile.QUICK].bead_mass_ratio:.2g} % of the light mass each; nothing is "
            "taken off the masses for them",
            "what a node that goes had in length and speed is shared out between the masses, as the string's pull would",
        ),
        summary="The multibody made anew whenever a node comes on the rod or goes; its constants were selected on ten_to_one.",
        limits=(
            ONE_COEFFICIENT,
            "its constants were selected on ten_to_one, where it scatters; at mass ratios of 2 and 2.5 it is farther off",
            "when a node comes and goes is the adapter's choice, and moves the vertical drop's acceleration",
            f"at most {MAX_JOINTS} joints are reported rightly: a string wound over more links is refused",
            RIPPLE_LIMIT,
            NO_STRETCH_LIMIT,
            "straight string is one stiff massless link: no waves run along it, and slack string does not fall",
        ),
    )

    def studies(self) -> Studies:
        """Return ladders of step, links, their mass and iterations, and choices of when nodes are added and removed.

        PyBullet's defaults are studied by `chain`.
        """
        s = self.settings
        comes, goes = f"{s.comes:g} and {s.goes:g} links from touching", f"off the rod for {s.goes:g} links"
        return studies_from_rows(
            self,
            ladders=(
                step_rungs(s),
                s.link_rungs(),
                iteration_rungs(s),
                ("bead_mass_ratio", "", (2e-3, 1e-3, 5e-4, 2.5e-4)),
            ),
            choices=(
                ("when a node goes", goes, "for 0.5 links: it swings meanwhile", {"comes": 0.3, "goes": 0.5}),
                ("when a node comes and goes", comes, "0.01 and 0.03", {"comes": 0.01, "goes": 0.03}),
                ("steps between two looks at the nodes", f"{s.look_interval}", "1", {"look_interval": 1}),
            ),
        )
