"""Drake's bead chain against closed forms, invariants and the reference; no law is fed in. Drake is optional."""

import importlib.util
import math

import numpy as np
import pytest

from looping_pendulum.engines.drake import SETTINGS, DrakeChain, DrakeChainSettings
from looping_pendulum.engines.protocol import Profile
from looping_pendulum.engines.tension import measure_capstan_exponent
from looping_pendulum.engines.trajectory import RunStatus
from looping_pendulum.errors import EngineError
from looping_pendulum.reference_ode.closed_forms import atwood_acceleration
from looping_pendulum.reference_ode.solve import solve, solve_at
from looping_pendulum.scenarios.scenario import Scenario
from tests.apparatus import TEN_TO_ONE

HERE = importlib.util.find_spec("pydrake") is not None
needs_drake = pytest.mark.skipif(not HERE, reason="pydrake is not installed")

QUICK = SETTINGS[Profile.QUICK]
NO_DRAG = {"light_drag": 0.0, "heavy_drag": 0.0, "string_drag": 0.0}
HANGING = TEN_TO_ONE.replace(release="vertical", free_length=0.4, **NO_DRAG)
QUARTER = TEN_TO_ONE.replace(free_length=TEN_TO_ONE.free_length / 4)
"""The trial on a quarter of its string: times are about half as long, so a run costs half; it halts at 0.18 s."""


def scenario(parameters, duration):
    return Scenario(name="test", title="", description="", parameters=parameters, duration=duration)


def run(parameters, duration, **changes):
    return DrakeChain().with_settings(**changes).simulate(scenario(parameters, duration)).raise_if_failed()


def fitted_acceleration(trajectory):
    square = 0.5 * trajectory.t**2
    return square @ trajectory.heavy_drop / (square @ square)


def test_a_group_that_does_not_divide_a_sample_is_refused():
    with pytest.raises(EngineError, match="time_step: found 2e-05 s in groups of 7, needed a whole number of groups"):
        DrakeChainSettings(time_step=2e-5, bend=0.4, bead_mass_ratio=5e-4, contact_stiffness=2e4, steps_per_group=7)


@pytest.fixture(scope="module")
def quarter():
    """Return a run of `QUARTER` until 35 ms after its halt, and the time of the halt, shared by several tests."""
    halt = solve(QUARTER).halting_time
    return run(QUARTER, round(halt + 0.035, 3)), halt


@needs_drake
@pytest.mark.parametrize(
    ("rod_radius", "friction"),
    [(6.25e-3, 0.34), (0.03, 0.34), (6.25e-3, 0.0)],
)
@pytest.mark.accurate
def test_vertical_release_is_an_atwood_machine_with_the_capstan_ratio(rod_radius, friction):
    # Oracle: closed form. Bound: 0.3 %, as for the other chains; a friction wrong by 1 % would show as 0.7 %. Every
    # day, the conformance suite drops one without friction, and the capstan law's tests below are of the friction.
    p = HANGING.replace(rod_radius=rod_radius, kinetic_friction=friction)
    assert fitted_acceleration(run(p, 0.2)) == pytest.approx(atwood_acceleration(p), rel=3e-3)


@pytest.mark.accurate  # daily, the static ratio, below
@needs_drake
@pytest.mark.parametrize("degrees", [90, *(pytest.param(d, marks=pytest.mark.accurate) for d in (180, 270))])
def test_tension_ratio_obeys_the_capstan_law(degrees):
    # Oracle: exp(mu theta), measured through the protocol alone. Bound: 1 %, of which 0.1 % is the measurement's own.
    # At 90 deg the light mass swings, which makes that 0.1 % in 0.15 s; in 0.1 s it is less, and the string slides by 12 links.
    assert abs(measure_capstan_exponent(DrakeChain(), wrap_angle=math.radians(degrees), duration=0.1).error) < 0.01


@needs_drake
@pytest.mark.parametrize(
    ("share", "holds"), [(0.97, True), pytest.param(1.03, False, marks=pytest.mark.accurate)]
)  # daily, the ratio, above
def test_static_capstan(share, holds):
    # Oracle: the capstan ratio e^{mu pi}. 3 % less is held, 3 % more slides. What is held creeps below the stiction tolerance.
    # Where 3 % are left over, 1 % in friction is a third of the acceleration, so half of it is asked for.
    p = HANGING.replace(heavy_mass=share * HANGING.light_mass * math.exp(0.34 * math.pi))
    drop = run(p, 0.1).heavy_drop[-1]
    assert (drop < 1e-4) if holds else (drop > 0.5 * 0.5 * atwood_acceleration(p) * 0.1**2)


@needs_drake
def test_ten_to_one_follows_the_reference_to_the_halt(quarter):
    # Oracle: the reference. Bounds: a quarter of 0.6 mm and of 1 mm, those of the other chains over the whole string, because
    # the masses go a quarter of the way; the halt's is two samples.
    trajectory, halt = quarter
    until = trajectory.t <= 0.91 * halt  # of the trial's 0.385 s, the 0.35 s of the other chains
    exact = solve_at(QUARTER, trajectory.t, duration=trajectory.t[-1] + 0.01)
    distance = np.linalg.norm(trajectory.light_position - exact.light_position, axis=1)
    assert math.sqrt(np.mean(distance[until] ** 2)) < 0.15e-3
    assert trajectory.heavy_drop[-1] == pytest.approx(exact.heavy_position[0, 1] - exact.heavy_position[-1, 1], abs=0.25e-3)
    speed = trajectory.heavy_velocity[:, 1]
    stops = trajectory.t[np.flatnonzero((speed > -1e-3) & (trajectory.t > 0.05))[0]]
    assert stops == pytest.approx(halt, abs=2e-3)


@needs_drake
def test_halted_string_sticks(quarter):
    # Oracle: sticking is rest. Bound: the stiction tolerance, below which Drake's friction is regularised.
    trajectory, halt = quarter
    rest = trajectory.t > halt + 0.015
    creep = np.polyfit(trajectory.t[rest], trajectory.heavy_drop[rest], 1)[0]
    assert abs(creep) < QUICK.stiction_tolerance


@needs_drake
def test_string_keeps_its_length(quarter):
    # Oracle: the constraint, from the masses' positions alone. Bound where the string rests: the stretch that the chain admits,
    # the offset R b^2 / 8 of a string that leaves a polygon and as much again for beads that land, and what beads sink in under
    # a tension T, T b / k, along a wound string on which T falls off as exp(-mu theta): T b / (k mu), for twice the heavy
    # mass's weight. While it slides beads bounce off the rod for some ms: the suite's 1 mm.
    p, (trajectory, halt) = QUARTER, quarter
    path = trajectory.free_length + p.rod_radius * trajectory.wrap_angle - trajectory.heavy_position[:, 1]
    sunk = 2 * p.heavy_mass * 9.81 * QUICK.bend / (QUICK.contact_stiffness * p.coefficients["kinetic_friction"])
    resting = np.abs(trajectory.string_stretch) + 2 * p.rod_radius * QUICK.bend**2 / 8 + sunk
    assert np.abs(trajectory.string_stretch).max() < 0.3e-3
    assert np.all(np.abs(path - p.string_length) <= np.where(trajectory.t > halt + 0.015, resting, 1e-3))


@needs_drake
@pytest.mark.accurate  # a tenth of the time of Drake's tests; every day the conformance suite swings a held pendulum
def test_held_pendulum_follows_the_reference():
    # Oracle: the reference. Bound: R b^2 / 8, by which the free string's distance from the centre swings about R, and what
    # beads sink in under the light mass's greatest tension, three times its weight, over half a turn: 3 M1 g b pi / k.
    p = TEN_TO_ONE.replace(release="held", **NO_DRAG)
    held = run(p, 0.6)
    exact = solve_at(p, held.t)
    distance = np.linalg.norm(held.light_position - exact.light_position, axis=1)
    sunk = 3 * p.light_mass * 9.81 * QUICK.bend * math.pi / QUICK.contact_stiffness
    assert distance.max() < p.rod_radius * QUICK.bend**2 / 8 + sunk
    assert np.ptp(held.heavy_position, axis=0).max() == 0.0


@needs_drake
def test_drop_is_free_fall():
    # Oracle: g t^2 / 2. A symplectic Euler step falls g t (t + dt) / 2.
    fallen = run(TEN_TO_ONE.replace(release="drop", **NO_DRAG), 0.2)
    for position in (fallen.light_position, fallen.heavy_position):
        euler = 0.5 * 9.81 * fallen.t * (fallen.t + QUICK.time_step)
        np.testing.assert_allclose(position[0, 1] - position[:, 1], euler, rtol=0, atol=1e-9)


@needs_drake
def test_a_slack_string_does_not_push():
    # Oracle: free fall, as the light mass falls towards the rod from above it; a link that pushed would turn it round the rod.
    # Bound: pushed for a sample at most, it is late by g dt t + g dt^2.
    p = TEN_TO_ONE.replace(release="held", release_angle=math.radians(45), free_length=0.2, **NO_DRAG)
    held = run(p, 0.12)
    fallen = held.light_position[0, 1] - held.light_position[:, 1]
    assert np.all(np.abs(fallen - 0.5 * 9.81 * held.t**2) <= 9.81e-3 * (held.t + 1e-3))
    assert held.string_stretch[-1] < -1e-3


@needs_drake
@pytest.mark.accurate  # a tenth, too: every step is seen to; `quarter` holds a grouped run against the reference every day
def test_groups_of_steps_change_little():
    # Oracle: the same engine with drag and beads seen to at every step. Bound: a fifth of the bound against the reference.
    grouped, every = (run(TEN_TO_ONE, 0.1, steps_per_group=n) for n in (QUICK.steps_per_group, 1))
    assert np.linalg.norm(grouped.light_position - every.light_position, axis=1).max() < 0.12e-3


@needs_drake
@pytest.mark.accurate  # the longest of Drake's tests
def test_winding_many_turns_ends_at_the_rod():
    # Oracle: the reference's end. Bound: a sample, and the time of the last links, which get no bead.
    p = TEN_TO_ONE.replace(rod_radius=0.03)
    wound = DrakeChain().simulate(scenario(p, 0.6))
    assert wound.status is RunStatus.LIGHT_REACHED_ROD
    assert wound.t[-1] == pytest.approx(solve(p).end_time, abs=5e-3)


@needs_drake
def test_drakes_step_of_a_millisecond_lets_the_string_go():
    # Oracle: the string's length. Drake's default step does not hold it; that is why the adapter's is a fiftieth.
    stretched = DrakeChain().with_settings(time_step=1e-3, steps_per_group=1).simulate(scenario(TEN_TO_ONE, 0.2))
    lost = stretched.status in (RunStatus.STRING_DRIFT, RunStatus.NOT_FINITE)
    assert lost or np.abs(stretched.string_stretch).max() > 1e-2
