"""PyBullet: the string as one multibody of links that slides over the rod under Bullet's own Coulomb contact.

A Featherstone multibody cannot stretch: a fixed base carries the heavy mass on a vertical slide, and from it one hinge after
another leads along the string to the light mass. Each link has a small contact sphere at its end, a *node*. The rod is a static
sphere: it has the rod's section in the plane of motion, and sphere on sphere is Bullet's one exact contact.
"""

from __future__ import annotations

import importlib.metadata
import math
import os
import tempfile
import weakref
from typing import Any

from looping_pendulum.engines.protocol import Abilities, Profile, Rig, SteppedEngine, steps_per_sample
from looping_pendulum.engines.pybullet.chain_model import (
    COARSEST,
    MAX_JOINTS,
    NO_SPEED_LIMIT,
    ChainSettings,
    chain_urdf,
    contact_friction,
    lay_chain,
)
from looping_pendulum.engines.trajectory import Supplier, Supplies, Supply
from looping_pendulum.errors import EngineError
from looping_pendulum.reference_ode.cartesian import cartesian_force
from looping_pendulum.reference_ode.geometry import light_position
from looping_pendulum.reference_ode.parameters import Parameters, Release
from looping_pendulum.scenarios.scenario import Scenario

TURN_TO_HALT = math.pi / 2
"""How much further than at release the string is typically wound, averaged over a looping mass's way to its halt [rad]."""


SETTINGS = {
    # At 20 us steps 20 iterations do not hold the heavy mass at its halt: it slips back by 0.4 mm first, and halts 18 ms late.
    Profile.QUICK: ChainSettings(time_step=2e-5, link_length=5e-3, outer_link_length=8e-3, solver_iterations=40),
    Profile.ACCURATE: ChainSettings(time_step=1e-5, link_length=4.4e-3, outer_link_length=8.5e-3),
}


class _World:
    """A PyBullet server of its own; it ends with the rig that owns it."""

    def __init__(self, parameters: Parameters, settings: ChainSettings) -> None:
        import pybullet

        self.api: Any = pybullet
        self.client: int = pybullet.connect(pybullet.DIRECT)
        weakref.finalize(self, pybullet.disconnect, self.client)
        self.time_step = settings.time_step
        self.steps = steps_per_sample(settings.time_step)
        pybullet.setGravity(0, -parameters.coefficients["gravity"], 0, physicsClientId=self.client)
        pybullet.setPhysicsEngineParameter(
            fixedTimeStep=settings.time_step,
            numSolverIterations=settings.solver_iterations,
            erp=settings.error_reduction,
            contactERP=settings.error_reduction,
            frictionERP=settings.error_reduction,
            physicsClientId=self.client,
        )

    def undamp(self, body: int, link: int) -> None:
        """Take off the damping, speed limit and friction that PyBullet gives every body."""
        self.change(body, link, linearDamping=0, angularDamping=0)
        self.change(body, link, jointDamping=0)
        self.change(body, link, maxJointVelocity=NO_SPEED_LIMIT)

    def set_friction(self, body: int, link: int, friction: float) -> None:
        """Set the contact friction; a pair's friction is the product of its two."""
        self.change(body, link, lateralFriction=friction)
        self.change(body, link, rollingFriction=0, spinningFriction=0, restitution=0)
        found = self.api.getDynamicsInfo(body, link, physicsClientId=self.client)[1]
        if not math.isclose(found, friction, rel_tol=1e-9, abs_tol=1e-15):
            raise EngineError(f"pybullet:chain: asked for a friction of {friction:g} on link {link}, PyBullet took {found:g}")

    def change(self, body: int, link: int, **values: float) -> None:
        """`changeDynamics`; what is given together with a damping is ignored there, so give those apart."""
        self.api.changeDynamics(body, link, physicsClientId=self.client, **values)


class ChainRig:
    """The apparatus with a string."""

    def __init__(self, parameters: Parameters, settings: ChainSettings) -> None:
        p = parameters
        chain = lay_chain(p, settings)
        self._world = world = _World(p, settings)
        self._held = p.release is Release.HELD
        self._radius, self._hanging = p.rod_radius, p.hanging_length
        self._force, self._time = cartesian_force(p), 0.0
        rod_radius = float(chain.node_circles.min()) - settings.node_radius
        self._lay_rod(rod_radius)
        node_radii = chain.node_circles - rod_radius
        self._body = _load(world, chain_urdf(p, settings, chain, node_radii))
        joints = len(chain.link_lengths) + (not self._held)
        found = world.api.getNumJoints(self._body, physicsClientId=world.client)
        if found != joints:
            raise EngineError(f"pybullet:chain: {joints} joints were given, PyBullet took {found}")
        self._light = joints - 1
        self._ends = (self._light, 0)
        """Links to read: the light mass, then the heavy one (if held: any, it is not read)."""
        self._free_joints(joints)
        wrap_angle = p.release_angle + (0.0 if p.release is Release.VERTICAL else TURN_TO_HALT)
        frictions = [contact_friction(p.coefficients["kinetic_friction"], float(b), wrap_angle) for b in chain.bends]
        first_node = joints - len(chain.link_lengths)
        for i, friction in enumerate(frictions):
            # Friction acts where a node touches the rod, tension at the node: their lever arms differ by the node's radius.
            world.set_friction(self._body, first_node + i, friction * float(chain.node_circles[i]) / rod_radius)

    def advance(self) -> None:
        """Step through one sample interval, applying the effects' forces at every step."""
        step, client = self._world.api.stepSimulation, self._world.client
        for _ in range(self._world.steps):
            if self._force is not None:
                self._push()
            step(physicsClientId=client)
            self._time += self._world.time_step

    def read(self) -> tuple[float, ...]:
        """Positions [m], velocities [m/s] and string stretch [m]: `COLUMNS` without the time."""
        light, heavy = self._world.api.getLinkStates(self._body, self._ends, 1, 1, physicsClientId=self._world.client)
        heavy_y, heavy_v = (-self._hanging, 0.0) if self._held else (heavy[0][1], heavy[6][1])
        return (*light[0][:2], *light[6][:2], self._radius, heavy_y, 0.0, heavy_v, 0.0)

    def _push(self) -> None:
        api, client, body = self._world.api, self._world.client, self._body
        assert self._force is not None
        light, heavy = api.getLinkStates(body, self._ends, 1, physicsClientId=client)
        x, y, _ = light[0]
        vx, vy, _ = light[6]
        heavy_v = 0.0 if self._held else heavy[6][1]
        fx, fy, heavy_fy = self._force(self._time, x, y, vx, vy, heavy_v)
        api.applyExternalForce(body, self._light, (fx, fy, 0.0), light[0], api.WORLD_FRAME, physicsClientId=client)
        if not self._held:
            api.applyExternalForce(body, 0, (0.0, heavy_fy, 0.0), heavy[0], api.WORLD_FRAME, physicsClientId=client)

    def _lay_rod(self, radius: float) -> None:
        api, client = self._world.api, self._world.client
        shape = api.createCollisionShape(api.GEOM_SPHERE, radius=radius, physicsClientId=client)
        rod = api.createMultiBody(0, shape, -1, [0, 0, 0], physicsClientId=client)
        self._world.set_friction(rod, -1, 1.0)

    def _free_joints(self, joints: int) -> None:
        """Switch off what would brake the joints: damping, speed limit, and the motor that PyBullet puts in each."""
        world = self._world
        world.undamp(self._body, -1)
        for joint in range(joints):
            world.undamp(self._body, joint)
            world.api.setJointMotorControl2(
                self._body, joint, world.api.VELOCITY_CONTROL, force=0, physicsClientId=world.client
            )
            damping = world.api.getJointInfo(self._body, joint, physicsClientId=world.client)[6]
            if damping != 0:
                raise EngineError(f"pybullet:chain: joint {joint} kept a damping of {damping:g}")


class FallingRig:
    """The two masses without a string."""

    def __init__(self, parameters: Parameters, settings: ChainSettings) -> None:
        p = parameters
        self._world = world = _World(p, settings)
        self._force, self._time = cartesian_force(p), 0.0
        light = light_position(math, p.free_length, p.release_angle, p.rod_radius)
        self._light = self._body(p.light_mass, [*light, 0.0])
        self._heavy = self._body(p.heavy_mass, [p.rod_radius, -p.hanging_length, 0.0])
        self._api, self._client = world.api, world.client

    def advance(self) -> None:
        """Step through one sample interval, applying the effects' forces at every step."""
        for _ in range(self._world.steps):
            if self._force is not None:
                self._push()
            self._api.stepSimulation(physicsClientId=self._client)
            self._time += self._world.time_step

    def read(self) -> tuple[float, ...]:
        """Positions [m], velocities [m/s] and string stretch [m]: `COLUMNS` without the time."""
        light, light_v = self._state(self._light)
        heavy, heavy_v = self._state(self._heavy)
        return (*light[:2], *light_v[:2], *heavy[:2], *heavy_v[:2], math.nan)

    def _push(self) -> None:
        assert self._force is not None
        light, light_v = self._state(self._light)
        heavy, heavy_v = self._state(self._heavy)
        fx, fy, heavy_fy = self._force(self._time, light[0], light[1], light_v[0], light_v[1], heavy_v[1])
        for body, force, position in ((self._light, (fx, fy, 0.0), light), (self._heavy, (0.0, heavy_fy, 0.0), heavy)):
            self._api.applyExternalForce(body, -1, force, position, self._api.WORLD_FRAME, physicsClientId=self._client)

    def _state(self, body: int) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Position [m] and velocity [m/s]."""
        position = self._api.getBasePositionAndOrientation(body, physicsClientId=self._client)[0]
        return position, self._api.getBaseVelocity(body, physicsClientId=self._client)[0]

    def _body(self, mass: float, position: list[float]) -> int:
        body: int = self._world.api.createMultiBody(mass, -1, -1, position, physicsClientId=self._world.client)
        self._world.undamp(body, -1)
        return body


def _load(world: _World, urdf: str) -> int:
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


_ABILITIES = Abilities(
    releases=frozenset(Release),
    supplies=Supplies(
        winding=Supply(by=Supplier.ENGINE, how="contact of the links' end spheres with a static sphere of the rod's section"),
        friction_law=Supply(
            by=Supplier.ENGINE, how="Coulomb contact at every node; the adapter only corrects the coefficient for the polygon"
        ),
        stick_slip=Supply(by=Supplier.ENGINE, how="Coulomb contact"),
        drag=Supply(by=Supplier.ADAPTER, how="the reference's formulas as applied forces"),
    ),
    packages=("pybullet",),
    summary="One Featherstone multibody of links that slides over a static sphere under Coulomb contact.",
    limits=(
        "one Coulomb coefficient: of a static friction above the kinetic one, only the kinetic one is represented",
        f"at most {MAX_JOINTS} joints are reported rightly: links of a long string are laid up to {COARSEST:g} times longer "
        "than the settings say, and a longer string still is refused",
        "links of several millimetres are long for a thin rod: the string's speed over it ripples as nodes pass",
        "reduced coordinates cannot stretch: the string stretch is 0 by construction, not a measurement",
    ),
)


class PybulletChain(SteppedEngine):
    """A chain of links over a static sphere.

    Parameters
    ----------
    profile
        Chooses the settings.
    settings
        Replaces the profile's settings, for studies of convergence.
    """

    name = "pybullet"
    variant = "chain"
    abilities = _ABILITIES

    def __init__(self, *, profile: Profile = Profile.QUICK, settings: ChainSettings | None = None) -> None:
        self.profile = profile
        self.settings: ChainSettings = settings if settings is not None else SETTINGS[profile]

    def build(self, scenario: Scenario) -> Rig:
        """Rebuild the scenario's apparatus at the moment of release."""
        rig = FallingRig if scenario.parameters.release is Release.DROP else ChainRig
        return rig(scenario.parameters, self.settings)

    def end_length(self, scenario: Scenario) -> float:
        """Free length [m] at which the run ends: a chain cannot follow once only its last link is left."""
        return max(super().end_length(scenario), self.settings.outer_link_length)

    def versions(self) -> dict[str, str]:
        """Version of PyBullet."""
        return {"pybullet": importlib.metadata.version("pybullet")}
