"""A Featherstone multibody between the two masses: how it is freed, started, read and pushed."""

from __future__ import annotations

import math

import numpy as np

from looping_pendulum.engines.chain import SlipGauge
from looping_pendulum.engines.pybullet.links import LinkPositions
from looping_pendulum.engines.pybullet.world import Drive, LongestStep, PushedBodies, Row, World
from looping_pendulum.errors import EngineError
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import Parameters, Release

MAX_JOINTS = 121
"""Joints that PyBullet reports rightly: its state has room for 128 numbers, 7 of them the base's.

With more, the first links' positions come back overwritten; beyond 127 the joints themselves are dropped, without a word.
"""


class MultibodyRig(PushedBodies):
    """Two masses at the ends of one multibody: how such a rig is read and pushed."""

    _body: int
    _ends: tuple[int, int]
    """Links to read: the light mass, then the heavy one (if held: any, it is not read)."""

    def __init__(self, parameters: Parameters, world: World, longest_step: LongestStep | None = None) -> None:
        self._parameters, self._world = parameters, world
        self._drive = Drive(world, parameters, longest_step)
        self._held = parameters.release is Release.HELD
        self._slip = SlipGauge()

    def advance(self) -> None:
        """Step through one sample interval, applying the effects' forces."""
        self._drive.steps(self._world.steps, self)

    def read(self) -> Row:
        """Positions [m], velocities [m/s], string stretch and slip [m]: `COLUMNS` without the time."""
        x, y, vx, vy, heavy_v = self.motion()
        heavy_y = -self._parameters.hanging_length if self._held else float(self._heavy_place[1])
        return (x, y, vx, vy, self._parameters.rod_radius, heavy_y, 0.0, heavy_v, 0.0, self._read_slip(heavy_y))

    def _read_slip(self, heavy_y: float) -> float:
        """How far the string has slid [m]; its links are as long as they are far from node to node."""
        nodes = range(0 if self._held else 1, self._ends[0] + 1)  # the first link is the heavy mass's, unless it is held
        rows = self._world.api.getLinkStates(self._body, nodes, physicsClientId=self._world.client)
        places = [*(row[0][:2] for row in reversed(rows)), (self._parameters.rod_radius, heavy_y)]
        return self._slip.read(places, list(map(math.dist, places[:-1], places[1:])))

    def motion(self) -> tuple[float, float, float, float, float]:
        """Light mass's position [m] and velocity [m/s], heavy mass's upward velocity [m/s]."""
        light, heavy = self._world.api.getLinkStates(self._body, self._ends, 1, 1, physicsClientId=self._world.client)
        self._light_place, self._heavy_place = light[0], heavy[0]
        (x, y, _), (vx, vy, _) = light[0], light[6]
        return x, y, vx, vy, 0.0 if self._held else heavy[6][1]

    def push(self, light: tuple[float, float], heavy: float) -> None:
        """Apply forces [N] on the light mass, and upward on the heavy one, where `motion` last found them."""
        self._world.push(self._body, self._ends[0], light, self._light_place)
        if not self._held:
            self._world.push(self._body, 0, (0.0, heavy), self._heavy_place)


def set_joints(world: World, body: int, chain: LinkPositions, turns: Array, *, sliding: bool) -> None:
    """Give the joints of ``body`` their angles ``turns`` [rad] and the rates at which links move as in ``chain``.

    With ``sliding``, joint 0 is the heavy mass's slide, and the hinges follow it.
    """
    rates, first = chain.turn_rates, 0
    if sliding:
        # The heavy mass cannot swing: the first link turns so that its node keeps its velocity, and the slide gives.
        first = 1
        x, y = chain.places[1] - chain.places[0]
        vx, vy = chain.velocities[1]
        rates[0] = -vx / y
        world.api.resetJointState(body, 0, 0.0, float(vy - rates[0] * x), physicsClientId=world.client)
    hinge_rates = np.diff(rates, prepend=0.0).tolist()
    for i, (turn, rate) in enumerate(zip(turns.tolist(), hinge_rates, strict=True)):
        world.api.resetJointState(body, first + i, turn, rate, physicsClientId=world.client)


def free_joints(world: World, body: int, joints: int, *, motors: bool) -> None:
    """Switch off what would brake the joints: damping, speed limit, and (unless ``motors``) the motor in each of them.

    Raises
    ------
    EngineError
        If a joint is damped still.
    """
    world.undamp(body)
    if not motors:
        world.api.setJointMotorControlArray(
            body, range(joints), world.api.VELOCITY_CONTROL, forces=[0.0] * joints, physicsClientId=world.client
        )
    damping = world.api.getJointInfo(body, joints - 1, physicsClientId=world.client)[6]
    if damping != 0:
        raise EngineError(f"pybullet: joint {joints - 1} has a damping of {damping:g}")
