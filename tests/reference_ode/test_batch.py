"""Many runs at once: each equals the single run, and an independent integrator's; bad runs disturb no other."""

import multiprocessing

import numpy as np
import pytest

from looping_pendulum.errors import ParameterError
from looping_pendulum.reference_ode import batch
from looping_pendulum.reference_ode.batch import ENDS, FAILED, BatchResult, sample_batch, sequence_hash, solve_batch
from looping_pendulum.reference_ode.batch.result import summary
from looping_pendulum.reference_ode.parameters import Parameters, Release
from looping_pendulum.reference_ode.solve import DURATION, TOLERANCE, available_integrators, solve
from looping_pendulum.reference_ode.transitions import Mode

pytestmark = pytest.mark.skipif(
    "heyoka" not in available_integrators(), reason="without heyoka a batch is a loop over single runs"
)

BASE = Parameters(light_mass=0.01, heavy_mass=0.1, rod_radius=0.006, free_length=0.5, release_angle=1.5)
TIMES_AND_PLACES = (
    "halting_time",
    "halting_wrap_angle",
    "halting_free_length",
    "drop",
    "wrap_angle",
    "free_length",
    "end_time",
)
COUNTS = ("stops", "reslips", "slack_intervals", "end", "sequence")


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


def assert_equal(found, expected, bound):
    for name in COUNTS:
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name), err_msg=name)
    for name in TIMES_AND_PLACES:
        np.testing.assert_allclose(getattr(found, name), getattr(expected, name), rtol=0, atol=bound, err_msg=name)


@pytest.mark.parametrize(("release", "pushed"), [(Release.LOOPING, False), (Release.LOOPING, True), (Release.VERTICAL, False)])
def test_a_batch_equals_single_runs(release, pushed):
    """Oracle: the single run. Bound: what the issue asks for, 1000 times the tolerance of a step."""
    columns = random_columns(200, seed=7, pushed=pushed)
    base = BASE.replace(release=release)
    found = solve_batch(base, columns)
    assert_equal(found, one_by_one(base, columns), bound=1e-9)
    if release is Release.LOOPING:
        assert found.reslips.sum() > 50
        assert {ENDS[end] for end in found.end} >= {ENDS[0], ENDS[2], ENDS[3]}
    if pushed:
        assert found.slack_intervals.sum() > 30


@pytest.mark.accurate
@pytest.mark.parametrize("release", [Release.HELD, Release.DROP])
def test_the_other_releases_equal_single_runs(release):
    columns = random_columns(300, seed=7, pushed=True)
    base = BASE.replace(release=release)
    found = solve_batch(base, columns)
    assert_equal(found, one_by_one(base, columns), bound=1e-8)  # pushed runs wind 30 turns, up to 500 rad


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


def test_impossible_runs_are_marked_and_disturb_no_other():
    columns = {name: values[:6] for name, values in random_columns(6, seed=3).items()}
    expected = one_by_one(BASE, columns)
    bad = {name: np.concatenate([values, values]) for name, values in columns.items()}
    for i, (name, value) in enumerate(
        [("heavy_mass", -1.0), ("rod_radius", np.nan), ("free_length", 1e-4), ("release_angle", 7.0), ("light_drag", 2.0)]
    ):
        bad[name][6 + i] = value
    bad["static_friction"][11] = 0.5 * bad["kinetic_friction"][11]
    found = solve_batch(BASE, bad)
    assert np.all(found.end[6:] == FAILED)
    assert np.all(np.isnan(found.end_time[6:]))
    assert_equal(BatchResult(**{name: getattr(found, name)[:6] for name in (*COUNTS, *TIMES_AND_PLACES)}), expected, bound=1e-9)


def test_effects_that_add_to_the_state_are_run_one_after_another():
    columns = {"release_angle": np.radians([75.0, 90.0]), "heavy_swing": np.array([0.1, 0.2])}
    found = solve_batch(BASE, columns)
    for i in range(2):
        run = solve(BASE.replace(**{name: float(values[i]) for name, values in columns.items()}))
        assert found.end_time[i] == run.end_time
        assert found.sequence[i] == sequence_hash(run.modes)


def test_static_friction_follows_the_kinetic_one():
    friction = np.array([0.1, 0.3])
    found = solve_batch(BASE, {"kinetic_friction": friction})
    expected = [solve(BASE.replace(kinetic_friction=float(value))) for value in friction]
    np.testing.assert_allclose(found.end_time, [run.end_time for run in expected], rtol=0, atol=1e-9)
    assert found.sequence.tolist() == [sequence_hash(run.modes) for run in expected]


def test_processes_share_the_work_and_report_it():
    columns = {"release_angle": np.radians(np.linspace(70.0, 110.0, 6)), "heavy_swing": np.full(6, 0.1)}  # compiles little
    seen = []
    shared = solve_batch(BASE, columns, processes=2, progress=lambda done, n: seen.append((done, n)))
    expected = solve_batch(BASE, columns)
    assert_equal(shared, expected, bound=0.0)
    assert seen[:3] == [(1, 6), (2, 6), (3, 6)]
    assert seen[-1] == (6, 6)
    assert seen == sorted(seen)


def test_a_helping_process_takes_what_nobody_has_taken(monkeypatch):
    """As such a process would, but here, where it does not matter which one is faster."""
    columns = {"release_angle": np.radians(np.linspace(70.0, 110.0, 7)), "heavy_swing": np.full(7, 0.1)}
    taken = multiprocessing.get_context("spawn").Value("q", 3)
    monkeypatch.setattr(batch, "_taken", taken)
    parts = batch._solve_shares(BASE, columns, DURATION, TOLERANCE, processes=2)
    assert list(parts) == [3, 5, 6]
    assert taken.value == 7
    rest = {name: values[3:] for name, values in columns.items()}
    assert_equal(batch.BatchResult.joined(list(parts.values())), solve_batch(BASE, rest), bound=0.0)


@pytest.mark.parametrize("n", [0, 1, 7, 50_000, 1_000_000])
@pytest.mark.parametrize("processes", [2, 5])
def test_shares_are_all_the_runs_and_small_in_the_end(n, processes):
    left, shares = n, []
    while left:
        shares.append(batch._share(left, processes))
        left -= shares[-1]
    assert left == 0
    assert shares == sorted(shares, reverse=True)
    assert not shares or shares[-1] <= min(batch.LEAST_SHARE, -(-n // processes))
    assert len(shares) < 100


def test_trajectories_on_request():
    columns = random_columns(4, seed=1)
    (samples,) = sample_batch(BASE, columns, [2], np.array([0.0, 0.05]))
    result = solve_batch(BASE, columns)
    assert samples.run.end_time == pytest.approx(result.end_time[2], abs=1e-9)
    assert samples.state.wrap_angle[0] == columns["release_angle"][2]


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


def test_the_hash_tells_sequences_apart():
    modes = list(Mode)[:4]
    hashes = {sequence_hash(modes[:k] + [Mode.ENDED]) for k in range(5)} | {sequence_hash(modes[::-1])}
    assert len(hashes) == 6
    assert sequence_hash([]) == 0xCBF29CE484222325  # FNV-1a's offset basis
