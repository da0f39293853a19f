"""The rig of the Featherstone chain: one multibody, whose links may be joined away from the rod."""

from __future__ import annotations

import math
import os
import tempfile

import numpy as np

from looping_pendulum.engines.chain import MASS_FRACTION
from looping_pendulum.engines.pybullet.chain_model import (
    PybulletChainSettings,
    ReleasedChain,
    body_masses,
    chain_at_release,
    chain_urdf,
)
from looping_pendulum.engines.pybullet.joining import Joining, with_nodes, with_rigid_links
from looping_pendulum.engines.pybullet.links import ChainState, contact_friction, typical_wrap_angle
from looping_pendulum.engines.pybullet.multibody import MultibodyRig, free_joints, set_joints
from looping_pendulum.engines.pybullet.world import LongestStep, World
from looping_pendulum.errors import EngineError
from looping_pendulum.reference_ode.parameters import Parameters, Release
from looping_pendulum.reference_ode.solve import solve

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


class PybulletChainRig(MultibodyRig):
    """The apparatus with a string of links in one multibody, which another one replaces when links are joined or split."""

    def __init__(self, parameters: Parameters, settings: PybulletChainSettings) -> None:
        p, s = parameters, settings
        chain = chain_at_release(p, s)
        world = World(p, s)
        super().__init__(p, world, longest_step(p, s, chain) if s.divided_step else None)
        self._settings = s
        self._rod_radius = float(chain.node_circles.min()) - s.node_radius
        # PyBullet multiplies both coefficients: with 1 here, each node carries that of its contact
        world.add_rod(self._rod_radius, 1.0)
        self._node_radii = chain.node_circles - self._rod_radius
        wrap_angle, law = typical_wrap_angle(p), p.coefficients["kinetic_friction"]
        self._friction = [
            # Friction acts where a node touches the rod, tension at the node: their lever arms differ by the node's radius.
            (contact_friction(law, bend, wrap_angle) if s.polygon else law) * circle / self._rod_radius
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
        if self._joins:
            self._update_links()

    def _update_links(self) -> None:
        """Replace the multibody by one with other nodes, if any are due."""
        nodes, chain = self._joining.nodes, self._chain()
        if not self._joining.update(chain.positions.tolist()):
            return
        kept = self._joining.nodes
        updated = with_nodes(chain, nodes, kept, self._arc)
        if not set(nodes) <= set(kept):
            masses = body_masses(self._parameters, self._settings, updated.lengths, self._last_length)
            updated = with_rigid_links(updated, masses, held=self._held)
        # PyBullet cannot add a link to a multibody, so another one takes its place
        self._world.api.removeBody(self._body, physicsClientId=self._world.client)
        self._create_multibody(updated)

    def _create_multibody(self, chain: ChainState) -> None:
        """Create the multibody of the nodes that exist, which are where ``chain`` says."""
        p, s, world = self._parameters, self._settings, self._world
        inner = [i - 1 for i in self._joining.nodes[1:-1]]
        masses = body_masses(p, s, chain.lengths, self._last_length)
        self._body = _load(world, chain_urdf(p, s, chain, masses, self._node_radii[inner]))
        links = len(chain.lengths)
        joints = links + (not self._held)
        joint_count = world.api.getNumJoints(self._body, physicsClientId=world.client)
        # PyBullet drops joints beyond its limit without an error
        if joint_count != joints:
            raise EngineError(f"pybullet:chain: {joints} joints were given, PyBullet took {joint_count}")
        self._ends = (joints - 1, 0)
        free_joints(world, self._body, joints, motors=s.joint_motors)
        for joint, i in enumerate(inner, start=joints - links):
            world.set_friction(self._body, joint, self._friction[i])
        if chain.velocities.any():
            set_joints(world, self._body, chain, np.zeros(links), sliding=not self._held)


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


def _load(world: World, urdf: str) -> int:
    """Load a body on a fixed base, from a temporary file, as PyBullet reads URDF from files only."""
    handle, path = tempfile.mkstemp(suffix=".urdf")
    try:
        with os.fdopen(handle, "w") as file:
            file.write(urdf)
        # Without the flag PyBullet computes the inertias from the collision shapes
        body: int = world.api.loadURDF(
            path, useFixedBase=1, flags=world.api.URDF_USE_INERTIA_FROM_FILE, physicsClientId=world.client
        )
    finally:
        os.remove(path)
    return body
