"""The rig of the chain in maximal coordinates: a rigid body per node, each pinned to the one before it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from looping_pendulum.engines.chain import MASS_COMPENSATION, SlipGauge, point_on_string
from looping_pendulum.engines.pybullet.links import LinkSettings, typical_wrap_angle
from looping_pendulum.engines.pybullet.world import Row, SteppedRig, World, WorldStepper
from looping_pendulum.reference_ode.cartesian import release_velocity
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import Parameters, Release

ROD_GROUP, STRING_GROUP = 1, 2
"""Collision groups: nodes collide with the rod, not with each other."""


@dataclass(frozen=True, kw_only=True)
class PointToPointSettings(LinkSettings):
    """Numerical settings of the chain of bodies, whose nodes are created once, from mass to mass."""

    relative_inertia: float = 0.3
    """Moment of inertia of a node's body over its mass times a link's length squared: with less, its pin converges slowly."""


class PointToPointRig(SteppedRig):
    """The apparatus with a string of pinned bodies."""

    def __init__(self, parameters: Parameters, settings: PointToPointSettings) -> None:
        p, s = parameters, settings
        self._settings = s
        self._world = world = World(p, s)
        self._stepper = WorldStepper(world, p)
        self._held = p.release is Release.HELD
        rod_radius = s.node_circle(p) - s.node_radius
        rod = world.add_rod(rod_radius, 1.0)
        self._set_collision_group(rod, ROD_GROUP, STRING_GROUP)
        self._friction = s.friction(p, typical_wrap_angle(p), rod_radius)
        positions = self._positions(p, s)
        self._node = world.api.createCollisionShape(world.api.GEOM_SPHERE, radius=s.node_radius, physicsClientId=world.client)
        beads = [s.bead_mass_ratio * p.light_mass] * (len(positions) - 2)
        light = p.light_mass - MASS_COMPENSATION * sum(beads)
        masses = [light, *beads, 0.0 if self._held else p.heavy_mass]
        self._lengths = np.hypot(*np.diff(positions, axis=0).T)
        self._bodies: list[int] = []
        self._slip = SlipGauge()
        for i, mass in enumerate(masses):
            self._add_body(i, mass, positions)
        self._set_release_velocities(p, positions)

    @staticmethod
    def _positions(p: Parameters, s: LinkSettings) -> Array:
        """Return the positions [m] of light mass, nodes a link apart, and heavy mass at release, shape (n, 2)."""
        length = s.length_on_rod(p)
        # The last link, above the heavy mass, takes up what does not fit
        count = math.floor(p.string_length / length)
        circle = s.node_circle(p)
        arcs = [i * length for i in range(count)]
        return np.array([*(point_on_string(p, arc, circle) for arc in arcs), (p.rod_radius, -p.hanging_length)])

    def _add_body(self, i: int, mass: float, positions: Array) -> None:
        """Create body ``i``, and pin it to the one before it."""
        api, client, s = self._world.api, self._world.client, self._settings
        last = len(positions) - 1
        length = float(self._lengths[max(i - 1, 0)])
        x, y = positions[i] - positions[i - 1] if i else positions[1] - positions[0]
        turn = api.getQuaternionFromEuler([0, 0, math.atan2(y, x)])
        # -1 is no shape: the masses touch nothing
        shape = self._node if 0 < i < last else -1
        position = [*positions[i].tolist(), 0.0]
        body: int = api.createMultiBody(mass, shape, -1, position, turn, useMaximalCoordinates=1, physicsClientId=client)
        self._world.remove_damping(body)
        if mass:
            # The mass has to be given again: PyBullet takes it for zero where only the inertia is changed.
            inertia = s.relative_inertia * mass * length**2
            self._world.change(body, -1, mass=mass, localInertiaDiagonal=[inertia] * 3)
        if shape >= 0:
            self._world.set_friction(body, -1, self._friction)
            self._set_collision_group(body, STRING_GROUP, ROD_GROUP)
        if i:
            api.createConstraint(
                self._bodies[-1],
                -1,
                body,
                -1,
                api.JOINT_POINT2POINT,
                [0, 0, 0],
                [0, 0, 0],
                # In this body's frame, whose x axis points along the link, away from the body before
                [-length, 0, 0],
                physicsClientId=client,
            )
        self._bodies.append(body)

    def _set_release_velocities(self, p: Parameters, positions: Array) -> None:
        """Set the bodies to the release's velocities: the string slides with the heavy mass."""
        vx, vy, heavy_v = release_velocity(p)
        if not (vx or vy or heavy_v):
            return
        steps = np.gradient(positions, axis=0)
        along = steps / np.hypot(*steps.T)[:, None]
        velocities = -heavy_v * along
        light = np.array([vx, vy])
        on_free = np.arange(len(positions)) * self._settings.length_on_rod(p) < p.free_length
        share = np.clip(1 - np.cumsum([0, *self._lengths]) / p.free_length, 0, 1)[:, None]
        across = light - (light @ along[0]) * along[0]
        # The free part, besides sliding, turns about its tangent point
        velocities[on_free] += (share * across)[on_free]
        for body, velocity in zip(self._bodies, velocities, strict=True):
            self._world.api.resetBaseVelocity(body, [*velocity.tolist(), 0.0], physicsClientId=self._world.client)

    def _set_collision_group(self, body: int, group: int, mask: int) -> None:
        self._world.api.setCollisionFilterGroupMask(body, -1, group, mask, physicsClientId=self._world.client)

    def advance(self) -> None:
        """Advance by one sample interval, with the effects' forces."""
        self._stepper.steps(self._world.steps, self)

    def read(self) -> Row:
        """Return positions [m], velocities [m/s], string stretch and slip [m]: `COLUMNS` without the time."""
        light, light_v = self._world.body_state(self._bodies[0])
        heavy, heavy_v = self._world.body_state(self._bodies[-1])
        positions = np.array([self._world.body_state(body)[0][:2] for body in self._bodies])
        stretch = float(np.hypot(*np.diff(positions, axis=0).T).sum() - self._lengths.sum())
        slip = self._slip.read(positions.tolist(), self._lengths.tolist())
        return (*light[:2], *light_v[:2], *heavy[:2], *heavy_v[:2], stretch, slip)

    def read_motion(self) -> tuple[float, float, float, float, float]:
        """Return the light mass's position [m] and velocity [m/s] and the heavy mass's upward velocity [m/s]."""
        (x, y, _), (vx, vy, _) = self._world.body_state(self._bodies[0])
        return x, y, vx, vy, self._world.body_state(self._bodies[-1])[1][1]

    def apply_forces(self, light: tuple[float, float], heavy: float) -> None:
        """Apply forces [N] to the light mass, and upward to the heavy one, at their positions."""
        self._world.apply_force(self._bodies[0], -1, light, self._world.body_state(self._bodies[0])[0])
        if not self._held:
            self._world.apply_force(self._bodies[-1], -1, (0.0, heavy), self._world.body_state(self._bodies[-1])[0])
