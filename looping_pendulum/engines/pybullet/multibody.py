"""A Featherstone multibody between the two masses: free its joints, set its state, read it and apply forces to it."""

from __future__ import annotations

import math

import numpy as np

from looping_pendulum.engines.chain import SlipGauge
from looping_pendulum.engines.pybullet.links import ChainState
from looping_pendulum.engines.pybullet.world import LongestStep, Row, SteppedRig, World, WorldStepper
from looping_pendulum.errors import EngineError
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import Parameters, Release

MAX_JOINTS = 121
"""Largest number of joints whose state PyBullet reports correctly: it has room for 128 numbers, 7 of them the base's.

With more, the first links' positions come back overwritten; beyond 127 PyBullet drops the joints themselves without an error.
"""


class MultibodyRig(SteppedRig):
    """Two masses at the ends of one multibody; a subclass creates the multibody."""

    _body: int
    _ends: tuple[int, int]
    """Indices of the links to read: the light mass, then the heavy one (if held: any, it is not read)."""

    def __init__(self, parameters: Parameters, world: World, longest_step: LongestStep | None = None) -> None:
        self._parameters, self._world = parameters, world
        self._stepper = WorldStepper(world, parameters, longest_step)
        self._held = parameters.release is Release.HELD
        self._slip = SlipGauge()

    def advance(self) -> None:
        """Advance by one sample interval, with the effects' forces."""
        self._stepper.steps(self._world.steps, self)

    def read(self) -> Row:
        """Return positions [m], velocities [m/s], string stretch and slip [m]: `COLUMNS` without the time."""
        x, y, vx, vy, heavy_v = self.read_motion()
        heavy_y = -self._parameters.hanging_length if self._held else float(self._heavy_position[1])
        return (x, y, vx, vy, self._parameters.rod_radius, heavy_y, 0.0, heavy_v, 0.0, self._read_slip(heavy_y))

    def _read_slip(self, heavy_y: float) -> float:
        """Return how far the string has slid over the rod [m]; links are rigid, so node distances are their rest lengths."""
        nodes = range(0 if self._held else 1, self._ends[0] + 1)  # the first link is the heavy mass's, unless it is held
        # Positions as PyBullet computed them for `read_motion`, a moment before
        rows = self._world.api.getLinkStates(self._body, nodes, physicsClientId=self._world.client)
        positions = [*(row[0][:2] for row in reversed(rows)), (self._parameters.rod_radius, heavy_y)]
        return self._slip.read(positions, list(map(math.dist, positions[:-1], positions[1:])))

    def _chain(self) -> ChainState:
        """Return positions and velocities of the masses and nodes."""
        api, client = self._world.api, self._world.client
        joints = range(self._ends[0] + 1)
        rows = api.getLinkStates(self._body, joints, 1, 1, physicsClientId=client)
        positions, velocities = np.array([row[0][:2] for row in rows]), np.array([row[6][:2] for row in rows])
        if self._held:
            p = self._parameters
            positions, velocities = (
                np.vstack([(p.rod_radius, -p.hanging_length), positions]),
                np.vstack([(0.0, 0.0), velocities]),
            )
        return ChainState(positions=positions, velocities=velocities)

    def read_motion(self) -> tuple[float, float, float, float, float]:
        """Return the light mass's position [m] and velocity [m/s] and the heavy mass's upward velocity [m/s]."""
        # 1, 1: with velocities, and positions computed anew; PyBullet otherwise gives those of the step before
        light, heavy = self._world.api.getLinkStates(self._body, self._ends, 1, 1, physicsClientId=self._world.client)
        self._light_position, self._heavy_position = light[0], heavy[0]
        (x, y, _), (vx, vy, _) = light[0], light[6]
        return x, y, vx, vy, 0.0 if self._held else heavy[6][1]

    def apply_forces(self, light: tuple[float, float], heavy: float) -> None:
        """Apply forces [N] to the light mass, and upward to the heavy one, at the positions that `read_motion` last read."""
        self._world.apply_force(self._body, self._ends[0], light, self._light_position)
        if not self._held:
            self._world.apply_force(self._body, 0, (0.0, heavy), self._heavy_position)


def set_joints(world: World, body: int, chain: ChainState, turns: Array, *, sliding: bool) -> None:
    """Set the joints of ``body`` to the angles ``turns`` [rad], and their rates so that the links move as in ``chain``.

    Parameters
    ----------
    turns
        Angle of every hinge, relative to the link before it [rad].
    sliding
        Whether joint 0 is the heavy mass's slide, with the hinges behind it.
    """
    rates, first = chain.turn_rates, 0
    if sliding:
        # The heavy mass cannot swing: the first link turns so that its node keeps its velocity, and the slide gives.
        first = 1
        x, y = chain.positions[1] - chain.positions[0]
        vx, vy = chain.velocities[1]
        rates[0] = -vx / y
        world.api.resetJointState(body, 0, 0.0, float(vy - rates[0] * x), physicsClientId=world.client)
    hinge_rates = np.diff(rates, prepend=0.0).tolist()
    for i, (turn, rate) in enumerate(zip(turns.tolist(), hinge_rates, strict=True)):
        world.api.resetJointState(body, first + i, turn, rate, physicsClientId=world.client)


def free_joints(world: World, body: int, joints: int, *, motors: bool) -> None:
    """Switch off what would brake the joints: damping, speed limit, and (unless ``motors``) the motor in every joint.

    Raises
    ------
    EngineError
        If PyBullet still damps a joint.
    """
    world.remove_damping(body)
    if not motors:
        world.api.setJointMotorControlArray(
            body, range(joints), world.api.VELOCITY_CONTROL, forces=[0.0] * joints, physicsClientId=world.client
        )  # a velocity motor without force is none
    damping = world.api.getJointInfo(body, joints - 1, physicsClientId=world.client)[6]
    if damping != 0:
        raise EngineError(f"pybullet: joint {joints - 1} has a damping of {damping:g}")
