"""The rig of the chain in maximal coordinates: a rigid body per node, each pinned to the one before it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from looping_pendulum.engines.chain import MASS_COMPENSATION, SlipGauge, point_on_string
from looping_pendulum.engines.pybullet.links import LinkSettings, typical_wrap_angle
from looping_pendulum.engines.pybullet.world import Drive, PushedBodies, Row, World
from looping_pendulum.reference_ode.cartesian import release_velocity
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import Parameters, Release

ROD_GROUP, STRING_GROUP = 1, 2
"""Collision groups: nodes meet the rod, not each other."""


@dataclass(frozen=True, kw_only=True)
class PointToPointSettings(LinkSettings):
    """Numerics of the chain of bodies; its nodes are laid once, from mass to mass."""

    relative_inertia: float = 0.3
    """Moment of inertia of a node's body, in its mass times a link's length squared: with less, its pin converges slowly."""


class PointToPointRig(PushedBodies):
    """The apparatus with a string of bodies."""

    def __init__(self, parameters: Parameters, settings: PointToPointSettings) -> None:
        p, s = parameters, settings
        self._settings = s
        self._world = world = World(p, s)
        self._drive = Drive(world, p)
        self._held = p.release is Release.HELD
        rod_radius = s.node_circle(p) - s.node_radius
        rod = world.lay_rod(rod_radius, 1.0)
        self._group(rod, ROD_GROUP, STRING_GROUP)
        self._friction = s.friction(p, typical_wrap_angle(p), rod_radius)
        places = self._places(p, s)
        self._node = world.api.createCollisionShape(world.api.GEOM_SPHERE, radius=s.node_radius, physicsClientId=world.client)
        beads = [s.bead_mass_ratio * p.light_mass] * (len(places) - 2)
        light = p.light_mass - MASS_COMPENSATION * sum(beads)
        masses = [light, *beads, 0.0 if self._held else p.heavy_mass]
        self._lengths = np.hypot(*np.diff(places, axis=0).T)
        self._bodies: list[int] = []
        self._slip = SlipGauge()
        for i, mass in enumerate(masses):
            self._add(i, mass, places)
        self._start(p, places)

    @staticmethod
    def _places(p: Parameters, s: LinkSettings) -> Array:
        """Light mass, nodes a link apart, heavy mass, shape (n, 2) [m]."""
        length = s.length_on_rod(p)
        count = math.floor(p.string_length / length)
        circle = s.node_circle(p)
        arcs = [i * length for i in range(count)]
        return np.array([*(point_on_string(p, arc, circle) for arc in arcs), (p.rod_radius, -p.hanging_length)])

    def _add(self, i: int, mass: float, places: Array) -> None:
        """Make body ``i``, and pin it to the one before it."""
        api, client, s = self._world.api, self._world.client, self._settings
        last = len(places) - 1
        length = float(self._lengths[max(i - 1, 0)])
        x, y = places[i] - places[i - 1] if i else places[1] - places[0]
        turn = api.getQuaternionFromEuler([0, 0, math.atan2(y, x)])
        shape = self._node if 0 < i < last else -1
        position = [*places[i].tolist(), 0.0]
        body: int = api.createMultiBody(mass, shape, -1, position, turn, useMaximalCoordinates=1, physicsClientId=client)
        self._world.undamp(body)
        if mass:
            # The mass has to be given again: PyBullet takes it for zero where only the inertia is changed.
            inertia = s.relative_inertia * mass * length**2
            self._world.change(body, -1, mass=mass, localInertiaDiagonal=[inertia] * 3)
        if shape >= 0:
            self._world.set_friction(body, -1, self._friction)
            self._group(body, STRING_GROUP, ROD_GROUP)
        if i:
            api.createConstraint(
                self._bodies[-1],
                -1,
                body,
                -1,
                api.JOINT_POINT2POINT,
                [0, 0, 0],
                [0, 0, 0],
                [-length, 0, 0],
                physicsClientId=client,
            )
        self._bodies.append(body)

    def _start(self, p: Parameters, places: Array) -> None:
        """Give the bodies the release's velocities: the string slides as the heavy mass moves."""
        vx, vy, heavy_v = release_velocity(p)
        if not (vx or vy or heavy_v):
            return
        steps = np.gradient(places, axis=0)
        along = steps / np.hypot(*steps.T)[:, None]
        velocities = -heavy_v * along
        light = np.array([vx, vy])
        on_free = np.arange(len(places)) * self._settings.length_on_rod(p) < p.free_length
        share = np.clip(1 - np.cumsum([0, *self._lengths]) / p.free_length, 0, 1)[:, None]
        across = light - (light @ along[0]) * along[0]
        velocities[on_free] += (share * across)[on_free]
        for body, velocity in zip(self._bodies, velocities, strict=True):
            self._world.api.resetBaseVelocity(body, [*velocity.tolist(), 0.0], physicsClientId=self._world.client)

    def _group(self, body: int, group: int, mask: int) -> None:
        self._world.api.setCollisionFilterGroupMask(body, -1, group, mask, physicsClientId=self._world.client)

    def advance(self) -> None:
        """Step through one sample interval, applying the effects' forces."""
        self._drive.steps(self._world.steps, self)

    def read(self) -> Row:
        """Positions [m], velocities [m/s], string stretch and slip [m]: `COLUMNS` without the time."""
        light, light_v = self._world.body_state(self._bodies[0])
        heavy, heavy_v = self._world.body_state(self._bodies[-1])
        places = np.array([self._world.body_state(body)[0][:2] for body in self._bodies])
        stretch = float(np.hypot(*np.diff(places, axis=0).T).sum() - self._lengths.sum())
        slip = self._slip.read(places.tolist(), self._lengths.tolist())
        return (*light[:2], *light_v[:2], *heavy[:2], *heavy_v[:2], stretch, slip)

    def motion(self) -> tuple[float, float, float, float, float]:
        """Light mass's position [m] and velocity [m/s], heavy mass's upward velocity [m/s]."""
        (x, y, _), (vx, vy, _) = self._world.body_state(self._bodies[0])
        return x, y, vx, vy, self._world.body_state(self._bodies[-1])[1][1]

    def push(self, light: tuple[float, float], heavy: float) -> None:
        """Apply forces [N] on the light mass, and upward on the heavy one, where they are."""
        self._world.push(self._bodies[0], -1, light, self._world.body_state(self._bodies[0])[0])
        if not self._held:
            self._world.push(self._bodies[-1], -1, (0.0, heavy), self._world.body_state(self._bodies[-1])[0])
