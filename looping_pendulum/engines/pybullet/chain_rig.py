"""The rig of the Featherstone chain: one multibody that is made anew when the string has moved by some links."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from looping_pendulum.engines.pybullet.chain_model import Laid, LinkSettings, Watch, lay, typical_wrap_angle
from looping_pendulum.engines.pybullet.world import Drive, Pushed, Row, World
from looping_pendulum.errors import EngineError
from looping_pendulum.reference_ode.cartesian import release_velocity
from looping_pendulum.reference_ode.parameters import Parameters, Release

MAX_JOINTS = 121
"""Joints that PyBullet reports rightly: its state has room for 128 numbers, 7 of them the base's.

With more, the first links' positions come back overwritten; beyond 127 the joints themselves are dropped, without a word.
"""


@dataclass(frozen=True, kw_only=True)
class ChainSettings(LinkSettings):
    """Numerics of the Featherstone chain."""

    relative_inertia: float = 1e-2
    """Moment of inertia of a link, in a node's mass times a link's length squared: small, but not singular."""
    look_interval: int = 2
    """Steps between two looks whether a node comes or goes; a test shows that it may be 1."""
    joint_motors: bool = False
    """Leave on the motor that PyBullet puts in every joint."""


class ChainRig(Pushed):
    """The apparatus with a string."""

    def __init__(self, parameters: Parameters, settings: ChainSettings) -> None:
        p, s = parameters, settings
        self._parameters, self._settings = p, s
        self._world = World(p, s)
        self._drive = Drive(self._world, p)
        self._held = p.release is Release.HELD
        self._length = s.length_on_rod(p)
        rod_radius = s.node_circle(p) - s.node_radius
        self._world.lay_rod(rod_radius, 1.0)
        wrap_angle = p.release_angle if p.release is Release.VERTICAL else typical_wrap_angle(p)
        self._friction = s.friction(p, wrap_angle, rod_radius)
        self._node = self._node_shape(self._length)
        chain = lay(p, s, release_velocity(p))
        self._watch = Watch(p, s)
        self._nodes, self.times_laid = 0, 0
        self._make(chain)

    def advance(self) -> None:
        """Step through one sample interval, applying the effects' forces, then see to the chain."""
        steps, interval = self._world.steps, self._settings.look_interval
        for done in range(0, steps, interval):
            self._drive.steps(min(interval, steps - done), self)
            self._look()

    def read(self) -> Row:
        """Positions [m], velocities [m/s] and string stretch [m]: `COLUMNS` without the time."""
        x, y, vx, vy, heavy_v = self.motion()
        return (x, y, vx, vy, self._parameters.rod_radius, self._heavy_y, 0.0, heavy_v, 0.0)

    def motion(self) -> tuple[float, float, float, float, float]:
        """Light mass's position [m] and velocity [m/s], heavy mass's upward velocity [m/s]."""
        light, heavy = self._world.api.getLinkStates(self._body, self._ends, 1, 1, physicsClientId=self._world.client)
        self._light_place, self._heavy_place = light[0], heavy[0]
        (x, y, _), (vx, vy, _) = light[0], light[6]
        return x, y, vx, vy, 0.0 if self._held else heavy[6][1]

    @property
    def _heavy_y(self) -> float:
        return -self._parameters.hanging_length if self._held else float(self._heavy_place[1])

    def push(self, light: tuple[float, float], heavy: float) -> None:
        """Apply forces [N] on the light mass, and upward on the heavy one, where they are."""
        self._world.push(self._body, self._ends[0], light, self._light_place)
        if not self._held:
            self._world.push(self._body, 0, (0.0, heavy), self._heavy_place)

    def _look(self) -> None:
        """See whether a node comes or goes."""
        margins = self._watch.margins(self._outermost(), self._nodes)
        if not min(margins) < 0:
            return
        anew = self._watch.seen_to(self._chain())
        self._world.api.removeBody(self._body, physicsClientId=self._world.client)
        self._make(anew)

    def _outermost(self) -> list[Row]:
        """Places of the masses and of the two outermost nodes on either side [m]."""
        api, client, last = self._world.api, self._world.client, self._ends[0]
        slide = 0 if self._held else 1
        joints = [*range(slide + 2), last - 2, last - 1, last]
        places = [row[0][:2] for row in api.getLinkStates(self._body, joints, physicsClientId=client)]
        p = self._parameters
        return [(p.rod_radius, -p.hanging_length), *places] if self._held else places

    def _chain(self) -> Laid:
        """Places and velocities of the masses and nodes."""
        api, client = self._world.api, self._world.client
        joints = range(self._ends[0] + 1)
        rows = api.getLinkStates(self._body, joints, 1, 1, physicsClientId=client)
        places, velocities = np.array([row[0][:2] for row in rows]), np.array([row[6][:2] for row in rows])
        if self._held:
            p = self._parameters
            places, velocities = np.vstack([(p.rod_radius, -p.hanging_length), places]), np.vstack([(0.0, 0.0), velocities])
        return Laid(places=places, velocities=velocities)

    def _make(self, chain: Laid) -> None:
        """Make the multibody: base, heavy mass on a vertical slide (not if held), links, light mass at the end of the last."""
        api, client, p, s = self._world.api, self._world.client, self._parameters, self._settings
        lengths = chain.lengths.tolist()
        n, node_mass = len(lengths), s.bead_mass_ratio * p.light_mass
        heavy = [*chain.places[0].tolist(), 0.0]
        slide = 0 if self._held else 1
        starts = [[0.0, 0.0, 0.0]] * slide + [[0.0, 0.0, 0.0]] + [[length, 0.0, 0.0] for length in lengths[:-1]]
        joints = slide + n
        none = [0.0, 0.0, 0.0, 1.0]
        self._body = body = api.createMultiBody(
            0,
            -1,
            -1,
            heavy,
            linkMasses=[p.heavy_mass] * slide + [node_mass] * (n - 1) + [p.light_mass],
            linkCollisionShapeIndices=[-1] * slide + [self._node_shape(lengths[0])] + [self._node] * (n - 2) + [-1],
            linkVisualShapeIndices=[-1] * joints,
            linkPositions=starts,
            linkOrientations=[none] * joints,
            linkInertialFramePositions=[[0.0, 0.0, 0.0]] * slide + [[length, 0.0, 0.0] for length in lengths],
            linkInertialFrameOrientations=[none] * joints,
            linkParentIndices=list(range(joints)),
            linkJointTypes=[api.JOINT_PRISMATIC] * slide + [api.JOINT_REVOLUTE] * n,
            linkJointAxis=[[0, 1, 0]] * slide + [[0, 0, 1]] * n,
            physicsClientId=client,
        )
        found = api.getNumJoints(body, physicsClientId=client)
        if found != joints or joints > MAX_JOINTS:
            raise EngineError(
                f"pybullet:chain: the wound string needs {joints} joints and PyBullet holds {MAX_JOINTS}; raise link_length"
            )
        self._ends = (joints - 1, 0)
        """Links to read: the light mass, then the heavy one (if held: any, it is not read)."""
        self._free_joints(joints)
        inertia = s.relative_inertia * node_mass * self._length**2
        for joint in range(slide, joints):
            self._world.change(body, joint, localInertiaDiagonal=[inertia] * 3)
            if joint < joints - 1:
                self._world.set_friction(body, joint, self._friction)
        rates = chain.turn_rates
        if slide:
            # The heavy mass cannot swing: the first link turns so that its node keeps its velocity, and the slide gives.
            x, y = chain.places[1] - chain.places[0]
            vx, vy = chain.velocities[1]
            rates[0] = -vx / y
            api.resetJointState(body, 0, 0.0, float(vy - rates[0] * x), physicsClientId=client)
        turns, rates = np.diff(chain.directions, prepend=0.0).tolist(), np.diff(rates, prepend=0.0).tolist()
        for i, (turn, rate) in enumerate(zip(turns, rates, strict=True)):
            api.resetJointState(body, slide + i, turn, rate, physicsClientId=client)
        self._nodes = len(chain.places) - 2
        self.times_laid += 1
        self._light_place, self._heavy_place = [*chain.places[-1].tolist(), 0.0], heavy

    def _free_joints(self, joints: int) -> None:
        """Switch off what would brake the joints: damping, speed limit, and the motor that PyBullet puts in each."""
        world = self._world
        world.undamp(self._body)
        if not self._settings.joint_motors:
            world.api.setJointMotorControlArray(
                self._body, range(joints), world.api.VELOCITY_CONTROL, forces=[0.0] * joints, physicsClientId=world.client
            )
        damping = world.api.getJointInfo(self._body, joints - 1, physicsClientId=world.client)[6]
        if damping != 0:
            raise EngineError(f"pybullet:chain: joint {joints - 1} has a damping of {damping:g}")

    def _node_shape(self, length: float) -> int:
        api = self._world.api
        shape: int = api.createCollisionShape(
            api.GEOM_SPHERE,
            radius=self._settings.node_radius,
            collisionFramePosition=[length, 0.0, 0.0],
            physicsClientId=self._world.client,
        )
        return shape
