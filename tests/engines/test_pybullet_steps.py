"""How long the steps of PyBullet's chain are, and that other lengths take neither time nor force away."""

import dataclasses
import math
from dataclasses import replace

import numpy as np
import pytest

from looping_pendulum.engines.protocol import Profile
from looping_pendulum.engines.pybullet.chain import (
    HALT_DELAY,
    MAX_WAVE_FRACTION,
    MAX_WAVE_FRACTION_AT_CONTACTS,
    SETTINGS,
    ChainState,
    Joining,
    PybulletChain,
    body_masses,
    chain_at_release,
    largest_rod_friction,
    longest_step,
    with_nodes,
    with_rigid_links,
)
from looping_pendulum.engines.pybullet.world import PybulletRig
from looping_pendulum.reference_ode.parameters import Release
from looping_pendulum.runs.trajectory import SAMPLE_INTERVAL
from looping_pendulum.scenarios.scenario import Scenario
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


class FakeServer:
    """Adds up the simulated time and the applied impulse."""

    def __init__(self):
        self.step, self.time, self.force, self.impulse = 0.0, 0.0, 0.0, 0.0

    def setGravity(self, *gravity):  # noqa: N802 - PyBullet's name
        pass

    def setPhysicsEngineParameter(self, *, fixedTimeStep, **others):  # noqa: N802, N803
        self.step = fixedTimeStep

    def setTimeStep(self, step):  # noqa: N802
        self.step = step

    def stepSimulation(self):  # noqa: N802
        self.time += self.step
        self.impulse += self.step * self.force
        self.force = 0.0


class Braked(PybulletRig):
    """Applies the drag of one steady motion."""

    def read_motion(self):
        return 0.3, 0.1, 0.0, 1.0, 0.0

    def apply_forces(self, light, heavy):
        self._server.force = light[1]


@pytest.mark.parametrize("factor", [1.0, 1 / 3, 0.4, 1.25, 10 / 9])
@pytest.mark.parametrize("force_interval", [1, 5])
def test_other_steps_take_as_long_and_push_as_much(factor, force_interval, monkeypatch):
    # Oracle: time and impulse of the same motion with steps as they are: a constant drag over one sample.
    monkeypatch.setattr("looping_pendulum.engines.pybullet.world.Server", FakeServer)
    p = TEN_TO_ONE.replace(light_drag=1e-3)
    rig = Braked(p, replace(QUICK, force_interval=force_interval), lambda *_: factor * QUICK.time_step)
    rig.advance()
    once = Braked(p, replace(QUICK, force_interval=1))
    once.advance()
    server = rig._server
    # A group of steps is divided evenly, none of them longer than is allowed
    step = QUICK.time_step * force_interval / math.ceil(force_interval / factor - 1e-9)
    assert server.step == pytest.approx(step, rel=1e-12)
    assert server.time == pytest.approx(SAMPLE_INTERVAL, rel=1e-12)
    assert server.impulse == pytest.approx(once._server.impulse, rel=1e-9) != 0


# ---- joining and splitting the links of PyBullet's chain away from the rod: what it must keep, and what a run makes of it


SEPARATE = dataclasses.replace(QUICK, joined_hanging_links=1, joined_free_links=1)
JOINED = dataclasses.replace(QUICK, joined_hanging_links=8, joined_free_links=2)
ARC = np.concatenate([[0.0], np.cumsum(CHAIN.lengths)])


def joining(unjoined_links: float = 3.0) -> Joining:
    """Return the joining of `CHAIN` as `JOINED` asks for it."""
    return Joining(CHAIN, (8, 2), unjoined_links, TEN_TO_ONE.rod_radius)


def slid(distance: float) -> np.ndarray:
    """Return nodes [m] of a string that has slid by ``distance`` [m]: straight down, round the rod, and straight up."""
    on_rod = float(ARC[np.argmax(CHAIN.positions[:, 1] > 0)])
    arc, r = ARC - on_rod - distance, TEN_TO_ONE.rod_radius * 1.02
    angle = np.clip(arc / r, 0.0, np.pi)
    beyond = arc - angle * r
    return np.stack([r * np.cos(angle), r * np.sin(angle) + np.where(beyond < 0, beyond, -beyond)], axis=1)


def test_links_near_the_rod_are_never_joined_and_those_away_from_it_are() -> None:
    # Oracle: the shape itself; every node within three links of the rod exists while the string slides by 0.3 m and back.
    chosen = joining()
    for distance in np.concatenate([np.arange(0.0, 0.3, 2.5e-3), np.arange(0.3, 0.0, -2.5e-3)]):
        positions = slid(distance)
        chosen.update(positions[chosen.nodes].tolist())
        near = np.flatnonzero(np.hypot(*positions.T) < np.hypot(TEN_TO_ONE.rod_radius, 2.5 * QUICK.link_length))
        assert set(near[(near > 0) & (near < len(ARC) - 1)]) <= set(chosen.nodes), distance
        assert chosen.nodes[0] == 0
        assert chosen.nodes[-1] == len(ARC) - 1
        assert len(chosen.nodes) < 0.75 * len(ARC)


def test_links_that_are_not_to_be_joined_stay() -> None:
    chosen = Joining(CHAIN, (1, 1), 3.0, TEN_TO_ONE.rod_radius)
    assert not chosen.update(slid(0.2).tolist())
    assert len(chosen.nodes) == len(ARC)


def test_a_split_link_moves_as_before() -> None:
    # Oracle: a rigid link, along which positions and velocities are linear.
    chain = ChainState(positions=np.array([[0, 0], [0, 1.0], [1, 1]]), velocities=np.array([[0, 2.0], [3, 2], [3, 5]]))
    split = with_nodes(chain, [0, 2, 4], [0, 1, 2, 3, 4], np.arange(5) * 0.5)
    assert split.positions[[1, 3]] == pytest.approx(np.array([[0, 0.5], [0.5, 1]]))
    assert split.velocities[[1, 3]] == pytest.approx(np.array([[1.5, 2], [3, 3.5]]))
    assert np.array_equal(split.positions[[0, 2, 4]], chain.positions)


@pytest.mark.parametrize("held", [False, True])
def test_joined_links_are_rigid_and_keep_the_momentum(held: bool) -> None:
    rng = np.random.default_rng(1)
    kept = [0, 8, 16, *range(17, len(ARC))]
    velocities = rng.normal(size=CHAIN.velocities.shape)
    velocities[0] = [0.0, 0.0 if held else -1.0]
    loose = with_nodes(ChainState(positions=CHAIN.positions, velocities=velocities), range(len(ARC)), kept, ARC)
    masses = body_masses(TEN_TO_ONE, QUICK, loose.lengths, float(CHAIN.lengths[-1]))
    rigid = with_rigid_links(loose, masses, held=held)
    links = np.diff(rigid.positions, axis=0)
    assert (np.diff(rigid.velocities, axis=0) * links).sum(axis=1) == pytest.approx(0, abs=1e-12)
    assert rigid.velocities[0] == pytest.approx([0, rigid.velocities[0, 1]], abs=1e-12)
    # Momentum along motions that rigid links allow: all bodies up and down (unless held), and all about the heavy mass
    change = masses[:, None] * (rigid.velocities - loose.velocities)
    turned = rigid.positions - rigid.positions[0]
    assert (turned[:, 0] * change[:, 1] - turned[:, 1] * change[:, 0]).sum() == pytest.approx(0, abs=1e-14)
    if held:
        assert not rigid.velocities[0].any()
    else:
        assert change[:, 1].sum() == pytest.approx(0, abs=1e-14)


def test_masses_of_a_joined_chain_add_up_to_those_at_release() -> None:
    last = float(CHAIN.lengths[-1])
    released = body_masses(TEN_TO_ONE, QUICK, CHAIN.lengths, last)
    kept = [*range(0, len(ARC) - 8), len(ARC) - 1]
    joined = body_masses(TEN_TO_ONE, QUICK, np.diff(ARC[kept]), last)
    assert joined.sum() == pytest.approx(released.sum(), rel=1e-12)


@pytest.mark.long
@pytest.mark.parametrize("release", [Release.LOOPING, Release.HELD])
def test_a_rig_that_joins_links_has_fewer_and_keeps_the_masses_in_place(release: Release) -> None:
    pytest.importorskip("pybullet")
    p = TEN_TO_ONE.replace(release=release)
    scenario = Scenario(name="test", title="", description="", parameters=p, duration=0.1)
    every, joined = (PybulletChain(settings=s).build(scenario) for s in (SEPARATE, JOINED))
    assert len(joined._chain().positions) < 0.7 * len(every._chain().positions)
    for _ in range(20):
        before = joined.read()
        every.advance()
        joined.advance()
        # A sample's way at the speed before and after, by the trapezium rule; replacing the multibody moves nothing
        after = joined.read()
        way = 0.5e-3 * (np.array(before[2:4]) + np.array(after[2:4]))
        assert np.array(after[:2]) - np.array(before[:2]) == pytest.approx(way, abs=2e-5)
    # 20 ms of fall differ by less than the string weighs (1 % of the light mass) of the way
    assert joined.read()[:2] == pytest.approx(every.read()[:2], abs=0.01 * 0.5 * 9.81 * 0.02**2)
