"""How long the steps of PyBullet's chain are, and that other lengths take neither time nor force away."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from looping_pendulum.engines.protocol import SAMPLE_INTERVAL, Profile
from looping_pendulum.engines.pybullet.chain import (
    HALT_DELAY,
    MAX_WAVE_FRACTION,
    MAX_WAVE_FRACTION_AT_CONTACTS,
    SETTINGS,
    chain_at_release,
    largest_rod_friction,
    longest_step,
)
from looping_pendulum.engines.pybullet.world import WorldStepper
from tests.apparatus import TEN_TO_ONE

QUICK = SETTINGS[Profile.QUICK]
CHAIN = chain_at_release(TEN_TO_ONE, QUICK)
DENSITY = 0.01 * TEN_TO_ONE.light_mass / CHAIN.lengths.sum()
AT_REST = (0.0, 0.3, 0.1, 0.0, 0.0)
UNLIMITED = replace(QUICK, time_step=1e6)
"""A step so long that the stable part of it, which divides it evenly, is the stable step to eleven digits."""


def test_the_shipped_trial_is_stepped_as_its_settings_say():
    # Oracle: its published figures were measured with that step; dividing it would move them.
    longest = longest_step(TEN_TO_ONE, QUICK, CHAIN)
    assert longest(*AT_REST) == QUICK.time_step


def test_what_the_rod_holds_back_bounds_the_step():
    # Oracle: the wave equation, c = sqrt(T / rho); 15:1 at 130 deg holds back 8.9 N and flew apart with steps of 20 us.
    p = TEN_TO_ONE.replace(heavy_mass=0.15, release_angle=math.radians(130))
    braked, _ = largest_rod_friction(p)
    wave = np.sqrt(braked / DENSITY)
    longest = longest_step(p, UNLIMITED, CHAIN)(*AT_REST)
    assert wave * longest == pytest.approx(MAX_WAVE_FRACTION_AT_CONTACTS * CHAIN.lengths.min(), rel=1e-10)
    assert QUICK.time_step / 2 < longest < QUICK.time_step
    assert longest_step(p, QUICK, CHAIN)(*AT_REST) == QUICK.time_step / 2


def test_without_friction_a_light_mass_that_whips_round_shortens_it():
    # Oracle: the wave equation with a tension of M1 (v^2 / l + g).
    p = TEN_TO_ONE.replace(kinetic_friction=0.0, static_friction=0.0)
    length, speed = 0.05, 8.0
    wave = np.sqrt(p.light_mass * (speed**2 / length + 9.81) / DENSITY)
    longest = longest_step(p, UNLIMITED, CHAIN)(0.0, np.hypot(length, p.rod_radius), 0.0, 0.0, speed)
    assert wave * longest == pytest.approx(MAX_WAVE_FRACTION * CHAIN.lengths.min(), rel=1e-10)
    assert MAX_WAVE_FRACTION < 1


def test_once_the_heavy_mass_hangs_still_steps_are_longer():
    # Oracle: the reference's halting time; what the tension of the light mass allows is as before.
    halting_time = largest_rod_friction(TEN_TO_ONE)[1]
    moving, still = halting_time + 0.99 * HALT_DELAY, halting_time + 1.01 * HALT_DELAY
    longest = longest_step(TEN_TO_ONE, QUICK, CHAIN)
    slow = (0.3, 0.1, 0.0, 3.0)
    assert (longest(moving, *slow), longest(still, *slow)) == (QUICK.time_step, 10 / 9 * QUICK.time_step)
    fast = (0.02, 0.0, 0.0, 8.0)
    assert longest(moving, *fast) < longest(still, *fast) * 10 / 9
    without = longest_step(TEN_TO_ONE, replace(UNLIMITED, lengthening_after_halt=2.0), CHAIN)
    assert without(still, *fast) == pytest.approx(longest_step(TEN_TO_ONE, UNLIMITED, CHAIN)(still, *fast), rel=1e-10)


class FakeWorld:
    """Adds up the simulated time and the applied impulse."""

    def __init__(self, time_step, force_interval):
        self.settings = SimpleNamespace(time_step=time_step, force_interval=force_interval)
        self.steps, self.client, self.api = round(SAMPLE_INTERVAL / time_step), 0, self
        self.step, self.time, self.force, self.impulse = time_step, 0.0, 0.0, 0.0

    def setTimeStep(self, step, physicsClientId):  # noqa: N802 - PyBullet's name
        self.step = step

    def stepSimulation(self, physicsClientId):  # noqa: N802
        self.time += self.step
        self.impulse += self.step * self.force
        self.force = 0.0

    def read_motion(self):
        return 0.3, 0.1, 0.0, 1.0, 0.0

    def apply_forces(self, light, heavy):
        self.force = light[1]


@pytest.mark.parametrize("factor", [1.0, 1 / 3, 0.4, 1.25, 10 / 9])
@pytest.mark.parametrize("force_interval", [1, 5])
def test_other_steps_take_as_long_and_push_as_much(factor, force_interval):
    # Oracle: time and impulse of the same motion with steps as they are: a constant drag over one sample.
    world = FakeWorld(2e-5, force_interval)
    p = TEN_TO_ONE.replace(light_drag=1e-3)
    drive = WorldStepper(world, p, lambda *_: factor * world.settings.time_step)
    drive.steps(world.steps, world)
    once = FakeWorld(2e-5, 1)
    WorldStepper(once, p).steps(once.steps, once)
    # A group of steps is divided evenly, none of them longer than is allowed
    assert world.step == pytest.approx(2e-5 * force_interval / math.ceil(force_interval / factor - 1e-9), rel=1e-12)
    assert world.time == pytest.approx(SAMPLE_INTERVAL, rel=1e-12)
    assert world.impulse == pytest.approx(once.impulse, rel=1e-9) != 0


def test_steps_in_other_portions_than_the_forces_are_the_same():
    # Oracle: the same steps taken at once; the variant `remade` looks at its nodes every few steps.
    worlds = [FakeWorld(2e-5, 10) for _ in range(2)]
    p = TEN_TO_ONE.replace(light_drag=1e-3)
    whole, portions = (WorldStepper(w, p) for w in worlds)
    whole.steps(48, worlds[0])
    for _ in range(12):
        portions.steps(4, worlds[1])
    assert worlds[0].time == worlds[1].time
    assert worlds[0].impulse == worlds[1].impulse
