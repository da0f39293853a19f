"""MuJoCo's bead chain against closed forms, invariants and the reference; no law is fed in."""

import math

import numpy as np
import pytest

from looping_pendulum.engines.mujoco.beads import SETTINGS, BeadSettings, MujocoBeads
from looping_pendulum.engines.protocol import Profile
from looping_pendulum.engines.trajectory import RunStatus
from looping_pendulum.errors import EngineError
from looping_pendulum.reference_ode.closed_forms import atwood_acceleration
from looping_pendulum.reference_ode.solve import solve, solve_at
from looping_pendulum.scenarios.scenario import Scenario
from tests.apparatus import TEN_TO_ONE

pytest.importorskip("mujoco")

QUICK = SETTINGS[Profile.QUICK]
NO_DRAG = {"light_drag": 0.0, "heavy_drag": 0.0, "string_drag": 0.0}
HANGING = TEN_TO_ONE.replace(release="vertical", free_length=0.4, **NO_DRAG)


def run(parameters, duration, **changes):
    scenario = Scenario(name="test", title="", description="", parameters=parameters, duration=duration)
    return MujocoBeads().with_settings(**changes).simulate(scenario).raise_if_failed()


def fitted_acceleration(trajectory):
    square = 0.5 * trajectory.t**2
    return square @ trajectory.heavy_drop / (square @ square)


@pytest.fixture(scope="module")
def ten_to_one():
    """Return one run past the halt at 0.385 s, shared by several tests."""
    return run(TEN_TO_ONE, 0.45)


@pytest.mark.parametrize(
    ("rod_radius", "friction"),
    [(6.25e-3, 0.34), *(pytest.param(*other, marks=pytest.mark.accurate) for other in ((0.03, 0.34), (6.25e-3, 0.0)))],
)
def test_vertical_release_is_an_atwood_machine_with_the_capstan_ratio(rod_radius, friction):
    # Oracle: closed form. Bound: 0.3 %, as for the other chains; a friction wrong by 1 % would show as 0.7 %.
    p = HANGING.replace(rod_radius=rod_radius, kinetic_friction=friction)
    assert fitted_acceleration(run(p, 0.2)) == pytest.approx(atwood_acceleration(p), rel=3e-3)


@pytest.mark.parametrize(("share", "holds"), [(0.97, True), (1.03, False)])
def test_static_capstan(share, holds):
    # Oracle: the massless chain's static capstan ratio, e^{mu pi} with the corners allowed for. 3 % less is held, 3 % more
    # slides. Contacts are soft, so what is held creeps: 0.1 mm in 0.1 s at most. Where 3 % are left over, 1 % in friction is a
    # third of the acceleration, so half of it is asked for.
    p = HANGING.replace(heavy_mass=share * HANGING.light_mass * math.exp(0.34 * math.pi))
    drop = run(p, 0.1).heavy_drop[-1]
    assert (drop < 1e-4) if holds else (drop > 0.5 * 0.5 * atwood_acceleration(p) * 0.1**2)


def test_ten_to_one_follows_the_reference_to_the_halt(ten_to_one):
    # Oracle: the reference. Bounds: 0.6 mm and 1 mm are those of the other chains; the halt's is two samples.
    until = ten_to_one.t <= 0.35 + 1e-9
    exact = solve_at(TEN_TO_ONE, ten_to_one.t, duration=0.6)
    distance = np.linalg.norm(ten_to_one.light_position - exact.light_position, axis=1)
    assert math.sqrt(np.mean(distance[until] ** 2)) < 0.6e-3
    assert ten_to_one.heavy_drop[-1] == pytest.approx(exact.heavy_position[0, 1] - exact.heavy_position[-1, 1], abs=1e-3)
    speed = ten_to_one.heavy_velocity[:, 1]
    stops = ten_to_one.t[np.flatnonzero((speed >= 0) & (ten_to_one.t > 0.1))[0]]
    assert stops == pytest.approx(solve(TEN_TO_ONE).halting_time, abs=2e-3)


def test_halted_string_sticks(ten_to_one):
    # Oracle: sticking is rest. Bound: 1 mm/s of creep, a hundredth of what gravity would give in that time.
    rest = ten_to_one.t > 0.41
    creep = np.polyfit(ten_to_one.t[rest], ten_to_one.heavy_drop[rest], 1)[0]
    assert abs(creep) < 1e-3


def test_slip_over_the_rod_is_the_heavy_mass_s_drop(ten_to_one):
    # Oracle: a string that keeps its length. Bound: what it does stretch by, and R bend^3 of the polygon at either reading.
    polygon = 2 * TEN_TO_ONE.rod_radius * QUICK.bend**3
    bound = np.abs(ten_to_one.string_stretch).max() + polygon
    assert np.abs(ten_to_one.string_slip - ten_to_one.heavy_drop).max() < bound


def test_string_keeps_its_length(ten_to_one):
    # Oracle: the constraint, from the masses' positions alone. Bound: the stretch that the chain admits, the offset R b^2 / 8
    # of a string that leaves a polygon, and as much again for beads that land.
    path = ten_to_one.free_length + TEN_TO_ONE.rod_radius * ten_to_one.wrap_angle - ten_to_one.heavy_position[:, 1]
    bound = np.abs(ten_to_one.string_stretch) + 2 * TEN_TO_ONE.rod_radius * QUICK.bend**2 / 8 + 1e-5
    assert np.abs(ten_to_one.string_stretch).max() < 0.3e-3
    assert np.all(np.abs(path - TEN_TO_ONE.string_length) <= bound)


def test_held_pendulum_follows_the_reference():
    # Oracle: the reference. Bound: R b^2 / 8, by which the free string's distance from the centre swings about R, and 1e-5 by
    # which a bead sinks in.
    p = TEN_TO_ONE.replace(release="held", **NO_DRAG)
    held = run(p, 0.4)
    exact = solve_at(p, held.t)
    distance = np.linalg.norm(held.light_position - exact.light_position, axis=1)
    assert distance.max() < p.rod_radius * QUICK.bend**2 / 8 + 1e-5
    assert np.ptp(held.heavy_position, axis=0).max() == 0.0


def test_drop_is_free_fall():
    # Oracle: g t^2 / 2. A symplectic Euler step falls g t (t + dt) / 2.
    fallen = run(TEN_TO_ONE.replace(release="drop", **NO_DRAG), 0.2)
    for position in (fallen.light_position, fallen.heavy_position):
        euler = 0.5 * 9.81 * fallen.t * (fallen.t + QUICK.time_step)
        np.testing.assert_allclose(position[0, 1] - position[:, 1], euler, rtol=0, atol=1e-9)


def test_sparse_and_dense_algebra_agree():
    # MuJoCo 4.0.0 factorizes some sparse Hessians wrongly. Oracle: its dense algebra, over 30 ms in which beads come and go;
    # bound: rounding, grown by contacts that open and close, a thousandth of the bound against the reference.
    sparse, dense = (run(TEN_TO_ONE.replace(push_across=2.0), 0.03, jacobian=kind) for kind in ("sparse", "dense"))
    assert np.linalg.norm(sparse.light_position - dense.light_position, axis=1).max() < 0.6e-6


def test_groups_of_steps_change_nothing_that_shows(ten_to_one):
    # Oracle: the same engine with drag and beads seen to at every step. Bound: a tenth of the bound against the reference.
    assert QUICK.steps_per_group > 1
    every = run(TEN_TO_ONE, 0.15, steps_per_group=1)
    grouped = ten_to_one.light_position[: len(every.t)]
    assert np.linalg.norm(grouped - every.light_position, axis=1).max() < 0.06e-3


@pytest.mark.accurate  # daily, test_tolerances.py winds the string of a fat rod
def test_winding_many_turns_ends_at_the_rod():
    # Oracle: the reference's end. Bound: a sample, and the time of the last links, which get no bead.
    p = TEN_TO_ONE.replace(rod_radius=0.03)
    scenario = Scenario(name="test", title="", description="", parameters=p, duration=0.6)
    wound = MujocoBeads().simulate(scenario)
    assert wound.status is RunStatus.LIGHT_REACHED_ROD
    assert wound.t[-1] == pytest.approx(solve(p).end_time, abs=5e-3)


@pytest.mark.parametrize("time_step", [3e-6, 1e-3, 1.5e-5])
def test_a_step_that_does_not_divide_the_sample_interval_is_refused(time_step):
    with pytest.raises(EngineError, match="time_step: found"):
        BeadSettings(time_step=time_step, bend=0.3, bead_mass_ratio=1e-4)


@pytest.mark.accurate  # a fact about MuJoCo, not about the adapter; the engine study measures it, too
@pytest.mark.parametrize("steps_per_group", [QUICK.steps_per_group, 1])
def test_a_pyramidal_cone_never_halts(steps_per_group):
    # MuJoCo's default cone: before the halt at 0.385 s the string has stretched by millimetres, and the mass falls on. That
    # seeing to the beads at every step does not help is for the accurate tests.
    scenario = Scenario(name="test", title="", description="", parameters=TEN_TO_ONE, duration=0.4)
    falling = MujocoBeads().with_settings(cone="pyramidal", steps_per_group=steps_per_group).simulate(scenario)
    assert np.abs(falling.string_stretch).max() > 5e-3
    assert np.abs(falling.heavy_velocity[falling.t > 0.1, 1]).min() > 0.1
