"""The rig of the Featherstone chain: one multibody whose links stay as they are at release."""

from __future__ import annotations

import math
import os
import tempfile

import numpy as np

from looping_pendulum.engines.chain import MASS_FRACTION
from looping_pendulum.engines.pybullet.chain_model import PybulletChainSettings, ReleasedChain, chain_at_release, chain_urdf
from looping_pendulum.engines.pybullet.links import contact_friction, typical_wrap_angle
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
"""Largest fraction of a link that a wave may pass in one step, at the largest rod friction T2 - T1 of the whole run.

Contacts are less stable than the chain: at fractions up to 0.54 ten_to_one halts; 15:1 at 130 deg diverged at 0.63.
"""


class PybulletChainRig(MultibodyRig):
    """The apparatus with a string of links, in one multibody."""

    def __init__(self, parameters: Parameters, settings: PybulletChainSettings) -> None:
        p = parameters
        chain = chain_at_release(p, settings)
        world = World(p, settings)
        super().__init__(p, world, longest_step(p, chain) if settings.divided_step else None)
        rod_radius = float(chain.node_circles.min()) - settings.node_radius
        # PyBullet multiplies both coefficients: with 1 here, each node carries that of its contact
        world.add_rod(rod_radius, 1.0)
        node_radii = chain.node_circles - rod_radius
        self._body = _load(world, chain_urdf(p, settings, chain, node_radii))
        links = len(chain.lengths)
        joints = links + (not self._held)
        joint_count = world.api.getNumJoints(self._body, physicsClientId=world.client)
        # PyBullet drops joints beyond its limit without an error
        if joint_count != joints:
            raise EngineError(f"pybullet:chain: {joints} joints were given, PyBullet took {joint_count}")
        self._ends = (joints - 1, 0)
        free_joints(world, self._body, joints, motors=settings.joint_motors)
        wrap_angle, law = typical_wrap_angle(p), p.coefficients["kinetic_friction"]
        for i, (bend, circle) in enumerate(zip(chain.bends.tolist(), chain.node_circles.tolist(), strict=True)):
            friction = contact_friction(law, bend, wrap_angle) if settings.polygon else law
            # Friction acts where a node touches the rod, tension at the node: their lever arms differ by the node's radius.
            world.set_friction(self._body, joints - links + i, friction * circle / rod_radius)
        if chain.velocities.any():
            set_joints(world, self._body, chain, np.zeros(links), sliding=not self._held)


def longest_step(parameters: Parameters, chain: ReleasedChain) -> LongestStep:
    """Return a function that computes the longest stable step [s] from the light mass's motion.

    A taut chain carries waves at sqrt(tension / mass per length), and an explicit step is stable while they pass less than a
    link in it. No single step would do for a run: as the light mass whips round on ever less string, its tension
    M1 (v^2 / l + g) grows without bound. The rod's friction has a largest value, which is read from the reference's run.
    """
    p = parameters
    density = MASS_FRACTION * p.light_mass / float(chain.lengths.sum())
    shortest = float(chain.lengths.min())
    gravity, radius_square = p.coefficients["gravity"], p.rod_radius**2
    largest_friction = largest_rod_friction(p)
    contacts = (
        MAX_WAVE_FRACTION_AT_CONTACTS * shortest * math.sqrt(density / largest_friction) if largest_friction > 0 else math.inf
    )

    def longest(x: float, y: float, vx: float, vy: float) -> float:
        # Not less than a link, with which the run has ended
        free = math.sqrt(max(x * x + y * y - radius_square, shortest * shortest))
        tension = p.light_mass * ((vx * vx + vy * vy) / free + gravity)
        return min(contacts, MAX_WAVE_FRACTION * shortest * math.sqrt(density / tension))

    return longest


def largest_rod_friction(parameters: Parameters) -> float:
    """Return the largest friction T2 - T1 [N] of the string on the rod in the reference's run until it halts."""
    if parameters.release is Release.HELD:
        return 0.0
    run = solve(parameters)
    until = run.end_time if run.halting_time is None else run.halting_time
    light, heavy = run.sample(np.linspace(0.0, until, REFERENCE_SAMPLES)).tensions
    return float(np.nanmax(heavy - light))


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
