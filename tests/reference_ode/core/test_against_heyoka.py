"""The core against heyoka's Taylor series at 1e-15: same events, times within 1e-10 s, positions within 1e-9 m.

heyoka's runs share the equations and the rules with the core, and neither its driver nor its code.
"""

import math

import numpy as np
import pytest

from looping_pendulum.reference_ode import closed_forms
from looping_pendulum.reference_ode.solve import solve, solve_at
from looping_pendulum.reference_ode.transitions import Event
from looping_pendulum.scenarios.loader import load
from research.answers.grazing import ParameterLine, find_changes
from tests.apparatus import SENSITIVE, TEN_TO_ONE, TWO_TO_ONE, WITHOUT_LOSSES
from tests.oracles.agreement import assert_same_run
from tests.oracles.random_apparatus import FURTHER, of_any_kind, of_papers_model
from tests.reference_ode.test_effects import TYPICAL, suited

heyoka_runs = pytest.importorskip("research.heyoka_runs", reason="heyoka is not installed; on Linux the extra `test` has it")

T = np.linspace(0, 5, 501)


def assert_agree(p, duration=5.0, **bounds):
    t = T[duration >= T]
    ours, other = (solver(p, t, duration=duration) for solver in (solve_at, heyoka_runs.solve_at))
    assert_same_run(ours, other, **bounds)
    return ours


@pytest.mark.parametrize("p", [TEN_TO_ONE, TWO_TO_ONE, SENSITIVE, TEN_TO_ONE.replace(rod_radius=0.03)])
def test_the_papers_trials(p):
    assert_agree(p)


# 1962: the estimate of a step's error cancelled, so that a step four times as long as the last was taken, and the end came 5 ns
# late
@pytest.mark.parametrize("seeds", [(*range(60), 1962), pytest.param(range(60, 2000), marks=pytest.mark.long)])
def test_random_apparatus_of_the_papers_model(seeds):
    for seed in seeds:
        try:
            assert_agree(of_papers_model(seed))
        except AssertionError as error:
            raise AssertionError(f"seed {seed}: {error}") from error


LOOSE = {"wind": 1e-7, "string_stretch": 1e-9}
"""Effect -> largest difference of a position [m] and an event's time [s].

A light mass that drifts with the wind has an almost sharp bend in |v - W|, over which heyoka, too, is good to 3e-8 m only at
1e-12 (seeds 22 and 41 of `of_any_kind`). A string that vibrates makes dozens of events.
"""


def bounds_of(p):
    loosest = max((LOOSE[e.name] for e in p.effects if e.name in LOOSE), default=None)
    return {} if loosest is None else {"distance": loosest, "time": loosest}


@pytest.mark.parametrize(
    "seed", [seed if seed % 8 == 0 else pytest.param(seed, marks=pytest.mark.long) for seed in range(2 * len(FURTHER))]
)
def test_random_apparatus_of_every_release_with_random_effects(seed):
    p = of_any_kind(seed)
    assert_agree(p, duration=3.0, **bounds_of(p))


BESIDE = 1e-8
"""Angle from a change of the sequence of events at which two integrators agree on it [rad]; small differences grow by 1000."""


@pytest.mark.parametrize(
    ("degrees", "changes"),
    [
        ((60, 70), {}),
        pytest.param((60, 110), {"static_friction": 1.16 * 0.3}, marks=pytest.mark.long),
        pytest.param((60, 110), {"heavy_drag": 0.3, "light_drag": 3e-3}, marks=pytest.mark.long),
    ],
)
def test_events_that_only_just_happen_are_found_and_no_others(degrees, changes):
    """Dips of event functions at every place within a step.

    Near the ends of a step they were not seen, so that a break-away was missed up to 4e-7 of a parameter from where it begins.
    """
    base = load("two_and_a_half_to_one").parameters.replace(**changes)
    line = ParameterLine(base=base, name="release_angle", duration=8.0)
    angles = np.radians(np.linspace(*degrees, 10 * (degrees[1] - degrees[0]) + 1))
    found = find_changes(line, angles, width=1e-10)
    assert sum(change.kind == "graze" for change in found) >= 4
    for angle in (a for change in found for a in (change.low - BESIDE, change.high + BESIDE)):
        runs = [solver(base.replace(release_angle=angle), duration=8.0) for solver in (solve, heyoka_runs.solve)]
        assert len({tuple(e.event for e in run.events) for run in runs}) == 1, angle


DAILY = ("turning_rod", "string_stretch", "string_thickness", "out_of_plane", "heavy_swing")
"""Effects that add states, events or geometry."""


@pytest.mark.parametrize("name", [name if name in DAILY else pytest.param(name, marks=pytest.mark.long) for name in TYPICAL])
def test_every_effect_by_itself(name):
    for base in (TEN_TO_ONE, TWO_TO_ONE):
        p = suited(base, name).replace(**TYPICAL[name])
        assert_agree(p, duration=2.0, **bounds_of(p))


@pytest.mark.parametrize("duration", [60.0, pytest.param(600.0, marks=pytest.mark.long)])
def test_a_long_held_swing(duration):
    """Hundreds of turning points: what each half swing differs by adds up, so that the bounds grow with their number."""
    p = TEN_TO_ONE.replace(release="held")
    t = np.linspace(0, duration, 1800)
    ours, other = (solver(p, t, duration=duration) for solver in (solve_at, heyoka_runs.solve_at))
    turns = sum(e.event is Event.ACROSS_REVERSES for e in ours.run.events)
    assert turns > duration / 0.9
    assert_same_run(ours, other, distance=1e-9 * duration / 10, time=1e-10 * duration / 10)


def test_the_turning_points_of_a_swing_without_losses_are_half_periods_apart():
    p = TEN_TO_ONE.replace(release="held", rod_radius=1e-3, **WITHOUT_LOSSES)
    run = solve_at(p, np.zeros(0), duration=60.0).run
    turns = np.array([e.time for e in run.events if e.event is Event.ACROSS_REVERSES])
    half = 0.5 * closed_forms.held_period(p)
    # The swing's two sides differ, so that whole periods are equal and halves are not
    assert np.abs(turns[1::2] - 2 * half * np.arange(1, len(turns[1::2]) + 1)).max() < 1e-8 * 60.0


@pytest.mark.parametrize("angle", [math.pi / 2, math.radians(12), math.radians(178)])
@pytest.mark.parametrize("release", ["held", "vertical", "drop", "looping"])
def test_every_release(release, angle):
    assert_agree(TEN_TO_ONE.replace(release=release, release_angle=angle), duration=3.0)
