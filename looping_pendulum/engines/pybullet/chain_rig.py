"""The rig of the Featherstone chain: one multibody whose links stay as they are laid at release."""

from __future__ import annotations

import os
import tempfile

import numpy as np

from looping_pendulum.engines.pybullet.chain_model import ChainSettings, chain_urdf, lay_chain
from looping_pendulum.engines.pybullet.links import contact_friction, typical_wrap_angle
from looping_pendulum.engines.pybullet.multibody import MultibodyRig, free_joints, set_joints
from looping_pendulum.engines.pybullet.world import World
from looping_pendulum.errors import EngineError
from looping_pendulum.reference_ode.parameters import Parameters


class ChainRig(MultibodyRig):
    """The apparatus with a string."""

    def __init__(self, parameters: Parameters, settings: ChainSettings) -> None:
        p = parameters
        chain = lay_chain(p, settings)
        world = World(p, settings)
        super().__init__(p, world)
        rod_radius = float(chain.node_circles.min()) - settings.node_radius
        world.lay_rod(rod_radius, 1.0)
        node_radii = chain.node_circles - rod_radius
        self._body = _load(world, chain_urdf(p, settings, chain, node_radii))
        links = len(chain.lengths)
        joints = links + (not self._held)
        found = world.api.getNumJoints(self._body, physicsClientId=world.client)
        if found != joints:
            raise EngineError(f"pybullet:chain: {joints} joints were given, PyBullet took {found}")
        self._ends = (joints - 1, 0)
        free_joints(world, self._body, joints, motors=settings.joint_motors)
        wrap_angle, law = typical_wrap_angle(p), p.coefficients["kinetic_friction"]
        for i, (bend, circle) in enumerate(zip(chain.bends.tolist(), chain.node_circles.tolist(), strict=True)):
            friction = contact_friction(law, bend, wrap_angle) if settings.polygon else law
            # Friction acts where a node touches the rod, tension at the node: their lever arms differ by the node's radius.
            world.set_friction(self._body, joints - links + i, friction * circle / rod_radius)
        if chain.velocities.any():
            set_joints(world, self._body, chain, np.zeros(links), sliding=not self._held)


def _load(world: World, urdf: str) -> int:
    """Load a body on a fixed base; PyBullet only reads URDF from files."""
    handle, path = tempfile.mkstemp(suffix=".urdf")
    try:
        with os.fdopen(handle, "w") as file:
            file.write(urdf)
        body: int = world.api.loadURDF(
            path, useFixedBase=1, flags=world.api.URDF_USE_INERTIA_FROM_FILE, physicsClientId=world.client
        )
    finally:
        os.remove(path)
    return body
