"""Many runs at once: each equals the single run, and an independent integrator's; bad runs disturb no other."""

import contextlib
import dataclasses
import math
import os

import numpy as np
import pytest
from looping_pendulum.reference_ode.batch.runs import parameters_of_run, summary
from looping_pendulum.reference_ode.batch.steps import supports_batch

from looping_pendulum.errors import IntegrationError, ParameterError
from looping_pendulum.reference_ode import batch
from looping_pendulum.reference_ode.batch import (
    ENDS,
    FAILED,
    BatchResult,
    sample_batch,
    schedule,
    sequence_hash,
    solve_batch,
)
from looping_pendulum.reference_ode.effects import EFFECTS, EffectKind
from looping_pendulum.reference_ode.parameters import Parameters, Release
from looping_pendulum.reference_ode.solve import available_integrators, solve, solve_at
from looping_pendulum.reference_ode.state import State
from looping_pendulum.reference_ode.transitions import Mode

pytestmark = pytest.mark.skipif(
    "heyoka" not in available_integrators(), reason="without heyoka a batch is a loop over single runs"
)

BASE = Parameters(light_mass=0.01, heavy_mass=0.1, rod_radius=0.006, free_length=0.5, release_angle=1.5)
NOT_FORCES = (EffectKind.CLOSURE, EffectKind.RELEASE)
TIMES_AND_PLACES = (
    "halting_time",
    "halting_wrap_angle",
    "halting_free_length",
    "drop",
    "wrap_angle",
    "free_length",
    "end_time",
)
COUNTS = ("stops", "slip_count", "slack_intervals", "end", "sequence")


def random_columns(n, seed, pushed=False):
    """A wide range of apparatus: all modes occur in a few hundred."""
    rng = np.random.default_rng(seed)
    light_mass, friction = 10 ** rng.uniform(-2.5, -1, n), rng.uniform(0, 0.6, n)
    columns = {
        "light_mass": light_mass,
        "heavy_mass": light_mass * rng.uniform(1, 14, n),
        "rod_radius": 10 ** rng.uniform(-2.7, -1.5, n),
        "free_length": rng.uniform(0.2, 1.2, n),
        "release_angle": np.radians(rng.uniform(20, 160, n)),
        "kinetic_friction": friction,
        "static_friction": friction * np.where(rng.random(n) < 0.5, 1.0, rng.uniform(1, 1.5, n)),
        "light_drag": 10 ** rng.uniform(-5, -2, n),
        "heavy_drag": 10 ** rng.uniform(-5, -1.5, n),
        "string_drag": 10 ** rng.uniform(-5, -2, n),
        "hanging_length": 10 ** rng.uniform(-2, 0, n),
        "light_radius": np.where(rng.random(n) < 0.5, 0.0, rng.uniform(0, 0.02, n)),
    }
    if pushed:
        columns["push_across"] = np.where(rng.random(n) < 0.5, 0.0, rng.normal(0, 2, n))
        columns["push_along"] = np.where(rng.random(n) < 0.5, 0.0, rng.normal(0, 2, n))
    return columns


def one_by_one(base, columns, **options):
    n = len(columns["light_mass"])
    result = BatchResult.empty(n)
    for i in range(n):
        run = solve(base.replace(**{name: float(values[i]) for name, values in columns.items()}), **options)
        for name, value in summary(run).items():
            getattr(result, name)[i] = value
    return result


def assert_equal(actual, expected, bound):
    for name in COUNTS:
        np.testing.assert_array_equal(getattr(actual, name), getattr(expected, name), err_msg=name)
    for name in TIMES_AND_PLACES:
        np.testing.assert_allclose(getattr(actual, name), getattr(expected, name), rtol=0, atol=bound, err_msg=name)


@pytest.mark.long
@pytest.mark.parametrize(("release", "pushed"), [(Release.LOOPING, False), (Release.LOOPING, True), (Release.VERTICAL, False)])
def test_a_batch_equals_single_runs(release, pushed):
    """Oracle: the single run. Bound: what the issue asks for, 1000 times the tolerance of a step."""
    columns = random_columns(200, seed=7, pushed=pushed)
    base = BASE.replace(release=release)
    actual = solve_batch(base, columns)
    assert_equal(actual, one_by_one(base, columns), bound=1e-9)
    if release is Release.LOOPING:
        assert actual.slip_count.sum() > 50
        assert {ENDS[end] for end in actual.end} >= {ENDS[0], ENDS[2], ENDS[3]}
    if pushed:
        assert actual.slack_intervals.sum() > 30


@pytest.mark.accurate
@pytest.mark.parametrize("release", [Release.HELD, Release.DROP])
def test_the_other_releases_equal_single_runs(release):
    columns = random_columns(300, seed=7, pushed=True)
    base = BASE.replace(release=release)
    actual = solve_batch(base, columns)
    assert_equal(actual, one_by_one(base, columns), bound=1e-8)  # pushed runs wind 30 turns, up to 500 rad


@pytest.mark.accurate
def test_a_batch_has_the_sequences_of_1e5_single_runs():
    columns = random_columns(100_000, seed=2026)
    np.testing.assert_array_equal(solve_batch(BASE, columns).sequence, one_by_one(BASE, columns).sequence)


@pytest.mark.accurate
def test_a_batch_has_the_sequences_of_scipys_runs():
    """Oracle: DOP853 with its own event search."""
    columns = random_columns(400, seed=11)
    expected = one_by_one(BASE, columns, integrator="scipy", tolerance=1e-11)
    np.testing.assert_array_equal(solve_batch(BASE, columns).sequence, expected.sequence)


@pytest.mark.accurate  # compiles for 12 s what no other daily test needs; the single run's is in test_solve.py
def test_a_held_string_at_a_right_angle_is_taut_in_a_batch_too():
    columns = {"release_angle": math.pi / 2 + np.array([-1e-9, 0.0, 1e-9])}
    base = BASE.replace(release="held")
    expected = [solve(base.replace(release_angle=angle), duration=0.5) for angle in columns["release_angle"]]
    actual = solve_batch(base, columns, duration=0.5)
    assert actual.sequence.tolist() == [sequence_hash(run.modes) for run in expected]
    np.testing.assert_allclose(actual.wrap_angle, [run.end.state.wrap_angle for run in expected], rtol=0, atol=1e-9)
    assert np.ptp(actual.wrap_angle) < 1e-7


def test_impossible_runs_are_marked_and_disturb_no_other():
    columns = {name: values[:6] for name, values in random_columns(6, seed=3).items()}
    expected = one_by_one(BASE, columns)
    bad = {name: np.concatenate([values, values]) for name, values in columns.items()}
    for i, (name, value) in enumerate(
        [("heavy_mass", -1.0), ("rod_radius", np.nan), ("free_length", 1e-4), ("release_angle", 7.0), ("light_drag", 2.0)]
    ):
        bad[name][6 + i] = value
    bad["static_friction"][11] = 0.5 * bad["kinetic_friction"][11]
    actual = solve_batch(BASE, bad)
    assert np.all(actual.end[6:] == FAILED)
    assert np.all(np.isnan(actual.end_time[6:]))
    assert_equal(part(actual, slice(6)), expected, bound=1e-9)


def test_runs_with_a_rod_that_turns_are_made_one_after_another():
    columns = {"release_angle": np.radians([75.0, 90.0]), "rod_mobility": np.array([10.0, 20.0])}
    actual = solve_batch(BASE, columns)
    for i in range(2):
        run = solve(BASE.replace(**{name: float(values[i]) for name, values in columns.items()}))
        assert actual.end_time[i] == run.end_time
        assert actual.sequence[i] == sequence_hash(run.modes)


def test_static_friction_follows_the_kinetic_one():
    friction = np.array([0.1, 0.3])
    actual = solve_batch(BASE, {"kinetic_friction": friction})
    expected = [solve(BASE.replace(kinetic_friction=float(value))) for value in friction]
    np.testing.assert_allclose(actual.end_time, [run.end_time for run in expected], rtol=0, atol=1e-9)
    assert actual.sequence.tolist() == [sequence_hash(run.modes) for run in expected]


@pytest.mark.usefixtures("optimised")
def test_processes_share_the_work_and_report_it():
    columns = {"release_angle": np.radians(np.linspace(70.0, 110.0, 6)), "rod_mobility": np.full(6, 10.0)}  # compiles little
    seen = []
    shared = solve_batch(BASE, columns, processes=2, progress=lambda done, n: seen.append((done, n)))
    expected = solve_batch(BASE, columns)
    assert_equal(
        shared, expected, bound=0.0
    )  # promised: the same compiled code on the same processor, whichever process has it
    assert seen[:3] == [(1, 6), (2, 6), (3, 6)]
    assert seen[-1] == (6, 6)
    assert seen == sorted(seen)


class Deadly(Parameters):
    """Parameters that end the process that unpickles them."""

    def __reduce__(self):
        return os._exit, (1,)


def test_the_runs_of_a_helping_process_that_dies_are_run_again():
    """One of the six is impossible, so it stays failed."""
    columns = {"release_angle": np.radians([70.0, 80.0, 90.0, 100.0, 400.0, 110.0]), "rod_mobility": np.full(6, 10.0)}
    deadly = Deadly(**{field.name: getattr(BASE, field.name) for field in dataclasses.fields(Parameters)})
    actual = solve_batch(deadly, columns, processes=2)
    assert_equal(actual, solve_batch(BASE, columns), bound=0.0)
    assert np.flatnonzero(actual.end == FAILED).tolist() == [4]


@pytest.mark.long
@pytest.mark.parametrize("at_once", [24, pytest.param(100_000, marks=pytest.mark.accurate)])
def test_results_do_not_depend_on_what_runs_beside(monkeypatch, at_once):
    """Results are equal to the last bit whatever the order, the division of a batch and the number of concurrent runs."""
    columns = random_columns(400, seed=5, pushed=True)
    whole = solve_batch(BASE, columns)
    monkeypatch.setattr(schedule, "MAX_CONCURRENT_RUNS", at_once)
    order = np.random.default_rng(1).permutation(400)
    mixed = solve_batch(BASE, {name: values[order] for name, values in columns.items()})
    assert_equal(mixed, part(whole, order), bound=0.0)
    for cut in (slice(0, 1), slice(1, 8), slice(8, 301)):
        alone = solve_batch(BASE, {name: values[cut] for name, values in columns.items()})
        assert_equal(alone, part(whole, cut), bound=0.0)


def part(result, runs):
    return BatchResult(**{name: getattr(result, name)[runs] for name in (*COUNTS, *TIMES_AND_PLACES, "handed_over")})


def test_a_run_with_too_many_steps_is_left_to_the_single_integrator(monkeypatch):
    columns = random_columns(5, seed=2)
    expected = solve_batch(BASE, columns)
    monkeypatch.setattr(schedule, "MAX_STEPS", 20)
    singly = []
    monkeypatch.setattr(batch, "solve_without_warning", lambda *a, **k: singly.append(solve(*a, **k)) or singly[-1])
    assert_equal(solve_batch(BASE, columns), expected, bound=1e-9)
    assert len(singly) == 5


def test_samples_are_those_of_single_runs_at_each_runs_own_times():
    columns = random_columns(40, seed=1)
    times = [np.linspace(0, 1.5, 60) * (1 + 0.01 * i) for i in range(40)]
    samples = sample_batch(BASE, columns, times, duration=3.0)
    for i, t in enumerate(times):
        alone = solve_at(parameters_of_run(BASE, columns, i), t, duration=3.0)
        assert samples.count[i] == len(alone.t)
        state = samples.state[:, samples.part(i)]
        exact = np.array(alone.and_end().state)[: len(state), np.minimum(np.arange(len(t)), len(alone.t))]
        # A free length of a micrometre at the end turns once in a microsecond
        assert np.abs(state[0] - exact[0]).max() < 1e-9
        assert np.abs(exact[0] * (state[1] - exact[1])).max() < 1e-9


FURTHER = {
    "light_linear_drag": (0.0, 0.02), "heavy_linear_drag": (0.0, 0.02), "attitude_drag": (-1.0, 1.0), "wind_speed": (-1.0, 1.0),
    "side_force": (-0.02, 0.02), "side_stiffness": (-0.1, 0.1), "friction_per_speed": (-0.02, 0.02),
    "friction_per_wrap": (-0.01, 0.01), "string_density": (0.0, 2e-3), "light_inertia": (0.0, 1e-6),
}  # fmt: skip
"""Coefficient of an effect beyond the paper's model, of those that a batch compiles into one model -> range."""
ALONE = {
    "heavy_swing": (-0.4, 0.4),
    "push_sideways": (0.0, 0.5),
    "string_thickness": (0.0, 1e-3),
    "string_on_string": (0.0, 0.3),
}
"""The same of those that have a model of their own."""


def beside_single_runs(columns, n):
    """Samples of a batch and of single runs: their states, by run; grazed events and runs that break down are left out."""
    times = [np.linspace(0.0, 1.0, 41)] * n
    samples = sample_batch(BASE, columns, times, duration=1.0 + 1e-3)
    results = solve_batch(BASE, columns, duration=1.0 + 1e-3)
    found = {}
    for i, t in enumerate(times):
        with contextlib.suppress(IntegrationError):
            alone = solve_at(parameters_of_run(BASE, columns, i), t, duration=1.0 + 1e-3)
            if sequence_hash(alone.run.modes) == results.sequence[i]:
                exact = np.array(alone.and_end().state)[:, np.minimum(np.arange(len(t)), len(alone.t))]
                found[i] = State(*samples.state[:, samples.part(i)]), State(*exact)
    return found


def farthest(a, b, *others):
    """How far apart samples of a run are [m], the wrap angle by the way of the light mass, and other entries of the state."""
    angle = np.abs(b.free_length * (a.wrap_angle - b.wrap_angle)).max()
    return max(angle, *(np.abs(getattr(a, name) - getattr(b, name)).max() for name in ("free_length", *others)))


@pytest.mark.long
@pytest.mark.parametrize("n", [24, pytest.param(2000, marks=pytest.mark.accurate)])
def test_samples_with_further_effects_are_those_of_single_runs(n):
    """Oracle: single runs, in which only the effects that act are compiled in."""
    assert FURTHER.keys() | ALONE.keys() == {
        c.name for e in EFFECTS.values() for c in e.coefficients
        if supports_batch((e,)) and not (e.in_base_model or e.package or e.needs_pivot) and e.kind not in NOT_FORCES
    }  # fmt: skip
    rng = np.random.default_rng(n)
    columns = random_columns(n, seed=n, pushed=True)
    columns |= {name: np.where(rng.random(n) < 0.3, rng.uniform(low, high, n), 0.0) for name, (low, high) in FURTHER.items()}
    found = beside_single_runs(columns, n)
    off = {i: farthest(*states) for i, states in found.items()}
    assert max(distance for i, distance in off.items() if not columns["wind_speed"][i]) < 1e-9
    # Where the mass moves with the air the drag has a kink, over which integrators lose digits: single runs up to 6e-8
    assert max(off.values()) < 1e-6
    assert len(found) >= 0.99 * n


@pytest.mark.long
@pytest.mark.parametrize("n", [12, pytest.param(500, marks=pytest.mark.accurate)])
@pytest.mark.parametrize("name", ALONE)
def test_samples_with_effects_that_add_to_the_state_are_those_of_single_runs(name, n):
    """Oracle: single runs. A mass out of the plane, one that swings and a string that lies on itself, beside a drag or none."""
    rng = np.random.default_rng(n)
    columns = random_columns(n, seed=n, pushed=True) | {name: rng.uniform(*ALONE[name], n)}
    columns["light_linear_drag"] = np.where(rng.random(n) < 0.5, rng.uniform(0.0, 0.02, n), 0.0)
    found = beside_single_runs(columns, n)
    assert max(farthest(*states, "slack", "sideways") for states in found.values()) < 1e-9
    assert max(np.abs(a.heavy_tilt - b.heavy_tilt).max() for a, b in found.values()) < 1e-8  # [rad], also of a short string
    assert len(found) >= 0.98 * n


@pytest.mark.long
def test_just_before_the_rod_samples_are_found_though_time_falls_beyond():
    """The step in which the light mass reaches the rod goes on with a negative free length, in which time falls."""
    columns = random_columns(200, seed=4)
    ends = solve_batch(BASE, columns, tolerance=1e-9).end_time
    times = [end - np.linspace(2e-3, 0.0, 80)[:-1] for end in ends]
    samples = sample_batch(BASE, columns, times, tolerance=1e-9)
    for i, t in enumerate(times):
        alone = solve_at(parameters_of_run(BASE, columns, i), t)
        known = min(len(alone.t), samples.count[i])
        off = samples.state[0, samples.part(i)][:known] - alone.state.free_length[:known]
        assert np.abs(off).max(initial=0.0) < 1e-8, i


def test_samples_do_not_depend_on_the_other_runs():
    columns = random_columns(9, seed=2)
    times = [np.linspace(0, 1, 30)] * 9
    together = sample_batch(BASE, columns, times)
    alone = sample_batch(BASE, {name: values[4:5] for name, values in columns.items()}, times[:1])
    assert np.array_equal(together.state[:, together.part(4)], alone.state)


def test_runs_that_a_batch_cannot_step_are_sampled_one_by_one():
    base = BASE.replace(rod_mobility=10.0)
    columns = {"heavy_mass": np.array([0.1, -1.0])}
    samples = sample_batch(base, columns, [np.array([0.0, 0.1])] * 2)
    assert samples.count[0] == 2
    assert np.isfinite(samples.state[:, samples.part(0)]).all()
    assert np.isnan(samples.state[:, samples.part(1)]).all()


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        ({}, "found none"),
        ({"colour": np.ones(2)}, "found 'colour', needed one of light_mass"),
        ({"heavy_mass": np.ones(2), "rod_radius": np.ones(3)}, "found lengths heavy_mass 2, rod_radius 3"),
        ({"heavy_mass": np.ones((2, 2))}, r"found shape \(2, 2\)"),
    ],
)
def test_bad_columns_are_refused_in_one_line(columns, message):
    with pytest.raises(ParameterError, match=message):
        solve_batch(BASE, columns)


def test_no_process_at_all_is_refused():
    with pytest.raises(ParameterError, match="processes: found 0, needed 1 or more"):
        solve_batch(BASE, {"heavy_mass": np.ones(2)}, processes=0)


def test_the_hash_tells_sequences_apart():
    modes = list(Mode)[:4]
    hashes = {sequence_hash(modes[:k] + [Mode.ENDED]) for k in range(5)} | {sequence_hash(modes[::-1])}
    assert len(hashes) == 6
    assert sequence_hash([]) == 0xCBF29CE484222325  # FNV-1a's offset basis
