"""PyBullet: the string as one multibody of links that slides on the rod under Bullet's own Coulomb contact."""

from __future__ import annotations

import importlib.metadata
import math
import os
import tempfile
import weakref
from dataclasses import dataclass
from typing import Any

import numpy as np

from looping_pendulum.engines.chain import MASS_COMPENSATION, MASS_FRACTION
from looping_pendulum.engines.protocol import SAMPLE_INTERVAL, Abilities, Engine, Profile, Rig, SteppedEngine
from looping_pendulum.engines.trajectory import Supplier, Supplies, Supply
from looping_pendulum.errors import EngineError
from looping_pendulum.reference_ode.cartesian import cartesian_force
from looping_pendulum.reference_ode.geometry import Array, light_position
from looping_pendulum.reference_ode.parameters import Parameters, Release
from looping_pendulum.scenarios.scenario import Scenario

MAX_JOINTS = 127
"""Joints of one multibody that PyBullet loads and reports; it drops any further ones without a word."""
NO_LIMIT = 1e9
"""Stands for no limit on joint speeds; PyBullet's own limit is 100."""


@dataclass(frozen=True, kw_only=True)
class ChainSettings:
    """Numerics of the link chain."""

    link_length: float
    """Length of a link that may come to lie on the rod [m]; rounded so that the free string has whole links."""
    hanging_link_length: float
    """Length of the links that hang from the rod at release and never reach it [m]."""
    time_step: float
    """[s]"""
    mass_fraction: float = MASS_FRACTION
    """Mass of the free string at release as a fraction of the light mass; the model's string has none."""
    node_radius: float = 2e-4
    """Radius of the contact sphere at the end of each link [m]."""
    solver_iterations: int = 20
    error_reduction: float = 0.2
    """Share of a penetration that a step takes back (Bullet's erp)."""
    relative_inertia: float = 1e-2
    """Moment of inertia of a link about its end, in its mass times its length squared: small, but not singular."""
    corner_mean: bool = True
    rod_shape: str = 'sphere'
    cbt: float | None = None
    slop: float | None = None
    k: float | None = None
    d: float = 10.
    warm: float | None = None
    mean_radius: bool = True


@dataclass(frozen=True, kw_only=True)
class LaidChain:
    """A chain at release, from the heavy mass to the light one."""

    nodes: Array
    """Shape (n + 1, 2) [m]; the first is the heavy mass, the last the light one."""
    node_circle: float
    """Radius of the circle on which nodes lie on the rod [m]."""
    bend: float
    """Angle between neighbouring links that lie on the rod [rad]."""


def lay_chain(parameters: Parameters, link_length: float, hanging_link_length: float, mean_radius=True) -> LaidChain:
    p = parameters
    light = np.array(light_position(np, p.free_length, p.release_angle, p.rod_radius))
    heavy = np.array([p.rod_radius, -p.hanging_length])
    straight = p.free_length
    for _ in range(50):
        count = max(1, round(straight / link_length))
        length = straight / count
        if mean_radius:
            bend = length / p.rod_radius
            circle = length / (2 * math.sin(bend / 2))
        else:
            bend = 2 * math.asin(length / 2 / p.rod_radius)
            circle = p.rod_radius
        links_on_rod = round(p.release_angle / bend)
        angles = 0.5 * p.release_angle + bend * (np.arange(links_on_rod + 1) - 0.5 * links_on_rod)
        on_rod = circle * np.stack([np.cos(angles), np.sin(angles)], axis=1)
        straight = math.dist(light, on_rod[-1])
    hanging = math.dist(heavy, on_rod[0])
    hanging_count = max(1, round(hanging / hanging_link_length))
    nodes = np.concatenate(
        [
            np.linspace(heavy, on_rod[0], hanging_count + 1)[:-1],
            on_rod[:-1],
            np.linspace(on_rod[-1], light, count + 1),
        ]
    )
    return LaidChain(nodes=nodes, node_circle=circle, bend=bend)


def corner_exponent(friction, angle):
    return 2 * math.atanh(friction * math.tan(angle / 2))


def contact_friction(friction: float, bend: float, wrap_angle: float, corner_mean=True) -> float:
    first = math.tanh(friction * bend / 2) / math.tan(bend / 2)
    if friction == 0 or not corner_mean:
        return first
    x, w = np.polynomial.legendre.leggauss(12)

    def excess(m):
        ends = sum(w[i] * corner_exponent(m, bend * (x[i] + 1) / 2) for i in range(12))  # two ends: mean over 0..bend, twice
        return (wrap_angle / bend - 1) * corner_exponent(m, bend) + ends - friction * wrap_angle

    lo, hi = 0.5 * first, min(2 * first, (1 - 1e-12) / math.tan(bend / 2))
    for _ in range(60):
        mid = 0.5 * (lo + hi)
        lo, hi = (mid, hi) if excess(mid) < 0 else (lo, mid)
    return 0.5 * (lo + hi)


class ChainRig:
    def __init__(self, parameters: Parameters, settings: ChainSettings) -> None:
        import pybullet

        p, s = parameters, settings
        self._api: Any = pybullet
        self._client: int = pybullet.connect(pybullet.DIRECT)
        self._finalizer = weakref.finalize(self, pybullet.disconnect, self._client)
        self._steps, self._dt = steps_per_sample(s.time_step), s.time_step
        self._time = 0.0
        self._force = cartesian_force(p)
        self._held = p.release is Release.HELD
        chain = lay_chain(p, s.link_length, s.hanging_link_length, s.mean_radius)
        self.chain = chain
        _prepare_world(pybullet, self._client, p, s)
        self._lay_rod(p, s, chain)
        self._load_chain(p, s, chain)
        self._heavy_x, self._heavy_start = p.rod_radius, -p.hanging_length
        if not self._held:
            self._links = [0, self._light]
        else:
            self._links = [self._light, self._light]

    def _lay_rod(self, p, s, chain) -> None:
        api, client = self._api, self._client
        contact_radius = chain.node_circle - s.node_radius
        shape = api.createCollisionShape(api.GEOM_SPHERE, radius=contact_radius, physicsClientId=client) if s.rod_shape=='sphere' else api.createCollisionShape(api.GEOM_CAPSULE, radius=contact_radius, height=.02, physicsClientId=client)
        self._rod = api.createMultiBody(0, shape, -1, [0, 0, 0], physicsClientId=client)
        wrap = p.release_angle + (0 if p.release is Release.VERTICAL else math.pi / 2)
        mu = contact_friction(p.coefficients["kinetic_friction"], chain.bend, wrap, s.corner_mean)
        self._mu = mu * chain.node_circle / contact_radius
        _set_friction(api, client, self._rod, -1, self._mu)
        if s.k: api.changeDynamics(self._rod, -1, contactStiffness=s.k, contactDamping=s.d, physicsClientId=client)

    def _load_chain(self, p, s, chain) -> None:
        api, client = self._api, self._client
        text = chain_urdf(p, s, chain)
        handle, path = tempfile.mkstemp(suffix=".urdf")
        try:
            with os.fdopen(handle, "w") as file:
                file.write(text)
            heavy = chain.nodes[0]
            self._body = api.loadURDF(
                path,
                [heavy[0], heavy[1], 0],
                useFixedBase=1,
                flags=api.URDF_USE_INERTIA_FROM_FILE,
                physicsClientId=client,
            )
        finally:
            os.remove(path)
        body = self._body
        joints = len(chain.nodes) - 1 + (not self._held)
        got = api.getNumJoints(body, physicsClientId=client)
        if got != joints:
            raise EngineError(f"pybullet:chain: found {got} joints, needed {joints}")
        self._light = joints - 1
        api.changeDynamics(body, -1, linearDamping=0, angularDamping=0, maxJointVelocity=NO_LIMIT, physicsClientId=client)
        for link in range(joints):
            api.changeDynamics(body, link, linearDamping=0, angularDamping=0, physicsClientId=client)
            api.changeDynamics(body, link, jointDamping=0, physicsClientId=client)
            api.changeDynamics(body, link, maxJointVelocity=NO_LIMIT, physicsClientId=client)
            _set_friction(api, client, body, link, 1.0)
            api.setJointMotorControl2(body, link, api.VELOCITY_CONTROL, force=0, physicsClientId=client)

    def advance(self) -> None:
        step, client = self._api.stepSimulation, self._client
        if self._force is None:
            for _ in range(self._steps):
                step(physicsClientId=client)
            return
        for _ in range(self._steps):
            self._push()
            step(physicsClientId=client)
            self._time += self._dt

    def _push(self) -> None:
        api, client, body = self._api, self._client, self._body
        heavy, light = api.getLinkStates(body, self._links, 1, physicsClientId=client)
        x, y, _ = light[0]
        vx, vy, _ = light[6]
        fx, fy, heavy_fy = self._force(self._time, x, y, vx, vy, 0.0 if self._held else heavy[6][1])
        api.applyExternalForce(body, self._light, (fx, fy, 0.0), light[0], api.WORLD_FRAME, physicsClientId=client)
        if not self._held:
            api.applyExternalForce(body, 0, (0.0, heavy_fy, 0.0), heavy[0], api.WORLD_FRAME, physicsClientId=client)

    def read(self) -> tuple[float, ...]:
        heavy, light = self._api.getLinkStates(self._body, self._links, 1, 1, physicsClientId=self._client)
        x, y, _ = light[0]
        vx, vy, _ = light[6]
        hy, hvy = (self._heavy_start, 0.0) if self._held else (heavy[0][1], heavy[6][1])
        return (x, y, vx, vy, self._heavy_x, hy, 0.0, hvy, 0.0)


def _prepare_world(api, client, p, s):
    if s.cbt: api.setPhysicsEngineParameter(contactBreakingThreshold=s.cbt, physicsClientId=client)
    if s.slop is not None: api.setPhysicsEngineParameter(contactSlop=s.slop, physicsClientId=client)
    if s.warm is not None: api.setPhysicsEngineParameter(warmStartingFactor=s.warm, physicsClientId=client)
    api.setGravity(0, -p.coefficients["gravity"], 0, physicsClientId=client)
    api.setTimeStep(s.time_step, physicsClientId=client)
    api.setPhysicsEngineParameter(
        numSolverIterations=s.solver_iterations,
        erp=s.error_reduction,
        contactERP=s.error_reduction,
        frictionERP=s.error_reduction,
        physicsClientId=client,
    )


def _set_friction(api, client, body, link, friction):
    api.changeDynamics(
        body, link, lateralFriction=friction, rollingFriction=0, spinningFriction=0, restitution=0, physicsClientId=client
    )
    found = api.getDynamicsInfo(body, link, physicsClientId=client)[1]
    if not math.isclose(found, friction, rel_tol=1e-6, abs_tol=1e-12):
        raise EngineError(f"friction {found} {friction}")


def chain_urdf(p, s, chain) -> str:
    nodes = chain.nodes
    lengths = np.linalg.norm(np.diff(nodes, axis=0), axis=1)
    free_mass = s.mass_fraction * p.light_mass
    total = lengths.sum()
    density = free_mass / total
    rows = [
        '<robot name="chain"><link name="l0"><inertial><mass value="0"/>'
        '<inertia ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"/></inertial></link>'
    ]
    parent = 0
    if p.release is not Release.HELD:
        parent = 1
        rows.append(link_xml(1, p.heavy_mass, 0.0, p.heavy_mass * 1e-4, None))
        rows.append(joint_xml(1, "prismatic", 0, 0.0, 0.0, "0 1 0"))
    turned = offset = 0.0
    for i, length in enumerate(lengths):
        angle = math.atan2(*(nodes[i + 1] - nodes[i])[::-1])
        last = i == len(lengths) - 1
        mass = p.light_mass - MASS_COMPENSATION * free_mass if last else density * 0.5 * (length + lengths[i + 1])
        inertia = s.relative_inertia * mass * length**2
        k = parent + 1
        rows.append(link_xml(k, mass, length, inertia, None if last else s.node_radius))
        rows.append(joint_xml(k, "continuous", parent, offset, angle - turned, "0 0 1"))
        parent, turned, offset = k, angle, length
    rows.append("</robot>")
    return "\n".join(rows)


def link_xml(k, mass, offset, inertia, sphere):
    collision = (
        ""
        if sphere is None
        else f'<collision><origin xyz="{offset!r} 0 0"/><geometry><sphere radius="{sphere!r}"/></geometry></collision>'
    )
    i = repr(float(inertia))
    return (
        f'<link name="l{k}"><inertial><origin xyz="{float(offset)!r} 0 0"/><mass value="{float(mass)!r}"/>'
        f'<inertia ixx="{i}" ixy="0" ixz="0" iyy="{i}" iyz="0" izz="{i}"/></inertial>{collision}</link>'
    ).replace("np.float64(", "").replace(")", "")


def joint_xml(k, kind, parent, offset, turn, axis):
    limit = '<limit lower="1" upper="-1" effort="0" velocity="1e9"/>' if kind == "prismatic" else ""
    return (
        f'<joint name="j{k}" type="{kind}"><parent link="l{parent}"/><child link="l{k}"/>'
        f'<origin xyz="{float(offset)!r} 0 0" rpy="0 0 {float(turn)!r}"/><axis xyz="{axis}"/>{limit}</joint>'
    )


def steps_per_sample(time_step: float) -> int:
    steps = round(SAMPLE_INTERVAL / time_step)
    if not math.isclose(steps * time_step, SAMPLE_INTERVAL, rel_tol=1e-9):
        raise EngineError("no")
    return steps


class PybulletChain(SteppedEngine):
    name = "pybullet"
    variant = "chain"

    def __init__(self, *, profile=Profile.QUICK, settings=None):
        self.profile = profile
        self.settings = settings
        from looping_pendulum.engines.mujoco import _SUPPLIES, Variant

        self.abilities = Abilities(
            releases=frozenset(Release), supplies=_SUPPLIES[Variant.CAPSTAN], packages=("pybullet",), summary=""
        )

    def build(self, scenario: Scenario) -> Rig:
        return ChainRig(scenario.parameters, self.settings)

    def versions(self):
        return {"pybullet": importlib.metadata.version("pybullet")}
