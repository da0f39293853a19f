"""Engines against a closed form that each integrates with an error of its own, known exactly."""

import numpy as np
import pytest

from looping_pendulum.engines.box2d import Box2dChain
from looping_pendulum.engines.drake import DrakeChain
from looping_pendulum.engines.exudyn import ExudynCable
from looping_pendulum.engines.mujoco.beads import MujocoBeads
from looping_pendulum.engines.mujoco.tendon import MujocoTendon
from looping_pendulum.engines.pybullet.chain import PybulletChain
from looping_pendulum.engines.pymunk import PymunkChain
from looping_pendulum.engines.rapier import RapierChain
from looping_pendulum.engines.registry import label
from tests.apparatus import NO_DRAG, TEN_TO_ONE, simulated

FALLS = (
    # Leapfrog and the generalised-alpha method are exact; rounding, and of Exudyn Newton's tolerance
    (MujocoTendon(variant="documented"), 0.0, 1e-12),
    (MujocoTendon(variant="capstan"), 0.0, 1e-12),
    (ExudynCable(), 0.0, 1e-6),
    # A symplectic Euler step moves a body with the speed at its end, Chipmunk's with that at its beginning
    *((engine, engine.settings.time_step, 1e-9) for engine in (MujocoBeads(), PybulletChain(), DrakeChain())),
    (PymunkChain(), -PymunkChain().settings.time_step, 1e-9),
    # In the games' single precision each sub-step rounds place and velocity, by 3e-8 of them at random or up to half a unit in
    # the last place alike; Box2D's 80000 give 35 um, so three times that.
    *((engine, engine.settings.time_step / engine.settings.sub_steps, 1e-4) for engine in (Box2dChain(), RapierChain())),
)
"""Engine, step h by which it falls too far, g h t / 2, and bound [m]."""


@pytest.mark.parametrize(("engine", "step", "bound"), FALLS, ids=[label(engine) for engine, _, _ in FALLS])
def test_drop_is_free_fall(engine, step, bound):
    for package in engine.abilities.packages:
        pytest.importorskip(package)
    fallen = simulated(engine, TEN_TO_ONE.replace(release="drop", **NO_DRAG), 0.2)
    for position in (fallen.light_position, fallen.heavy_position):
        expected = 0.5 * 9.81 * fallen.t * (fallen.t + step)
        np.testing.assert_allclose(position[0, 1] - position[:, 1], expected, rtol=0, atol=bound)
        np.testing.assert_allclose(position[:, 0], position[0, 0], rtol=0, atol=1e-12)
