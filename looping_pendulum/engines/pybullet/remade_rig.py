"""The rig of the chain that is created anew: one multibody after another, as nodes reach and leave the rod."""

from __future__ import annotations

import numpy as np

from looping_pendulum.engines.pybullet.links import ChainState, typical_wrap_angle
from looping_pendulum.engines.pybullet.multibody import MAX_JOINTS, MultibodyRig, free_joints, set_joints
from looping_pendulum.engines.pybullet.remade_model import NodeChanges, RemadeSettings, nodes_at_release
from looping_pendulum.engines.pybullet.world import Row, World
from looping_pendulum.errors import EngineError
from looping_pendulum.reference_ode.cartesian import release_velocity
from looping_pendulum.reference_ode.parameters import Parameters


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
            self._stepper.steps(min(interval, steps - done), self)
            self._update_nodes()

    def _update_nodes(self) -> None:
        """Replace the multibody by one with more or fewer nodes, if any is due."""
        margins = self._node_changes.margins(self._outermost(), self._node_count)
        if not min(margins) < 0:
            return
        chain = self._node_changes.with_updated_nodes(self._chain())
        # PyBullet cannot add a link to a multibody, so another one takes its place
        self._world.api.removeBody(self._body, physicsClientId=self._world.client)
        self._create_multibody(chain)

    def _outermost(self) -> list[Row]:
        """Return the positions [m] of the masses and of the two outermost nodes on either side."""
        api, client, last = self._world.api, self._world.client, self._ends[0]
        slide = 0 if self._held else 1
        joints = [*range(slide + 2), last - 2, last - 1, last]
        positions = [row[0][:2] for row in api.getLinkStates(self._body, joints, physicsClientId=client)]
        p = self._parameters
        return [(p.rod_radius, -p.hanging_length), *positions] if self._held else positions

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
