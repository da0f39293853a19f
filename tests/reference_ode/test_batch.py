"""Many runs at once: each equals the single run in every bit, alone, beside others and in threads; bad runs disturb none."""

import dataclasses
import math
import re
import threading

import numpy as np
import pytest

from looping_pendulum.errors import ParameterError
from looping_pendulum.reference_ode import batch
from looping_pendulum.reference_ode.batch import COLUMNS, ENDS, FAILED, BatchResult, sequence_hash, solve_batch
from looping_pendulum.reference_ode.parameters import Parameters, Release
from looping_pendulum.reference_ode.sensitivity import SensitivityError, run_with_derivatives, solve_sensitivities
from looping_pendulum.reference_ode.solve import TOLERANCE, solve, solve_at
from looping_pendulum.reference_ode.transitions import Event, Mode
from tests.oracles import scipy_runs
from tests.reference_ode.test_effects import TYPICAL

BASE = Parameters(light_mass=0.01, heavy_mass=0.1, rod_radius=0.006, free_length=0.5, release_angle=1.5)
RELEASES = [
    (Release.LOOPING, False),
    (Release.LOOPING, True),
    (Release.VERTICAL, False),
    (Release.HELD, True),
    (Release.DROP, True),
]


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


def parameters_of_run(base, columns, i):
    """Return the parameters of run ``i``, with exactly the effects of the batch."""
    p = base.replace(**{name: float(values[i]) for name, values in columns.items()})
    p.__dict__["effects"] = base.effects_with([name for name in columns if name in base.coefficients])
    return p


def one_by_one(base, columns, solver=solve, **options):
    """Return what `solve_batch` should, from the properties of single runs."""
    n = len(next(iter(columns.values())))
    result = BatchResult.empty(n)
    for i in range(n):
        run = solver(parameters_of_run(base, columns, i), **options)
        halt, end = run.halt, run.end
        events = [e.event for e in run.events]
        values = {
            "halting_time": math.nan if halt is None else halt.time,
            "halting_wrap_angle": math.nan if halt is None else halt.state.wrap_angle,
            "halting_free_length": math.nan if halt is None else halt.state.free_length,
            "drop": float(run.heavy_drop(end.state)),
            "wrap_angle": end.state.wrap_angle,
            "free_length": end.state.free_length,
            "stops": len(run.stops),
            "slip_count": events.count(Event.SLIP_ONSET_DOWN) + events.count(Event.SLIP_ONSET_UP),
            "slack_intervals": sum(mode in (Mode.SLACK, Mode.CLAMPED_SLACK) for mode in run.modes),
            "end": ENDS.index(end.event),
            "end_time": end.time,
            "sequence": sequence_hash(run.modes),
        }
        for name, value in values.items():
            getattr(result, name)[i] = value
    return result


def part(result, runs):
    return BatchResult(**{name: getattr(result, name)[runs] for name in COLUMNS})


def assert_same_bits(actual, expected):
    for name in COLUMNS:
        np.testing.assert_array_equal(getattr(actual, name), getattr(expected, name), err_msg=name)


@pytest.mark.parametrize(("release", "pushed"), RELEASES)
def test_a_batch_equals_single_runs(release, pushed):
    columns, base = random_columns(200, seed=7, pushed=pushed), BASE.replace(release=release)
    actual = solve_batch(base, columns)
    assert_same_bits(actual, one_by_one(base, columns))
    if release is Release.LOOPING:
        assert actual.slip_count.sum() > 50
        assert {ENDS[end] for end in actual.end} >= {ENDS[0], ENDS[2], ENDS[3]}
        assert not pushed or actual.slack_intervals.sum() > 30


@pytest.mark.long
def test_a_batch_equals_20_000_single_runs():
    columns = random_columns(20_000, seed=2026)
    assert_same_bits(solve_batch(BASE, columns, threads=2), one_by_one(BASE, columns))


@pytest.mark.long
def test_a_batch_has_the_sequences_of_scipys_runs():
    """Oracle: SciPy's DOP853 with an event search of its own."""
    columns = random_columns(100, seed=11)
    expected = one_by_one(BASE, columns, scipy_runs.solve, tolerance=1e-11)
    np.testing.assert_array_equal(solve_batch(BASE, columns).sequence, expected.sequence)


def fields_of_run(columns, run):
    """Return the fields of `Parameters` in one run."""
    values = {name: float(values[run]) for name, values in columns.items()}
    fields = {field.name: values.get(field.name, getattr(BASE, field.name)) for field in dataclasses.fields(Parameters)}
    return fields | {"coefficients": {name: value for name, value in values.items() if name not in fields}}


def test_impossible_runs_are_refused_with_the_reasons_of_a_single_run_and_disturb_no_other():
    columns = random_columns(6, seed=3)
    bad = {name: np.concatenate([values, values]) for name, values in columns.items()}
    for i, (name, value) in enumerate(
        [("heavy_mass", -1.0), ("rod_radius", np.nan), ("free_length", 1e-4), ("release_angle", 7.0), ("light_drag", 2.0)]
    ):
        bad[name][6 + i] = value
    bad["static_friction"][11] = 0.5 * bad["kinetic_friction"][11]
    bad["heavy_mass"][9] = 0.0  # of two faults the first is named, as by `Parameters`
    actual = solve_batch(BASE, bad, threads=2)
    assert_same_bits(part(actual, slice(6)), one_by_one(BASE, columns))
    assert_same_bits(part(actual, slice(6, 12)), BatchResult.empty(6))
    assert sorted(actual.errors) == list(range(6, 12))
    for run, error in actual.errors.items():
        assert isinstance(error, ParameterError)
        with pytest.raises(ParameterError, match=f"^{re.escape(str(error))}$"):
            Parameters(**fields_of_run(bad, run))


def test_static_friction_follows_the_kinetic_one():
    friction = np.array([0.1, 0.3])
    actual = solve_batch(BASE, {"kinetic_friction": friction})
    expected = one_by_one(BASE, {"kinetic_friction": friction, "static_friction": friction})
    assert_same_bits(actual, expected)


@pytest.mark.parametrize("threads", [1, 2, 5])
def test_results_do_not_depend_on_what_runs_beside(monkeypatch, threads):
    """Results are equal to the last bit whatever the order, the division of a batch and the thread of a run."""
    columns = random_columns(300, seed=5, pushed=True)
    whole = solve_batch(BASE, columns)
    monkeypatch.setattr(batch, "MOST_RUNS", 37)
    order = np.random.default_rng(1).permutation(300)
    mixed = solve_batch(BASE, {name: values[order] for name, values in columns.items()}, threads=threads)
    assert_same_bits(mixed, part(whole, order))
    for cut in (slice(0, 1), slice(1, 8), slice(8, 301)):
        alone = solve_batch(BASE, {name: values[cut] for name, values in columns.items()})
        assert_same_bits(alone, part(whole, cut))


def test_threads_share_the_work_and_report_it(monkeypatch):
    monkeypatch.setattr(batch, "MOST_RUNS", 20)
    columns, seen, workers = random_columns(100, seed=5), [], set()
    whole = batch.this_threads_core
    monkeypatch.setattr(batch, "this_threads_core", lambda: workers.add(threading.get_ident()) or whole())
    solve_batch(BASE, columns, threads=3, progress=lambda done, n: seen.append((done, n)))
    assert seen == [(done, 100) for done in range(20, 101, 20)]
    assert 1 <= len(workers) <= 3  # one that is quick may do the work of all
    assert threading.get_ident() not in workers


@pytest.mark.parametrize("name", [None, *TYPICAL])
def test_samples_of_a_run_with_derivatives_are_those_of_one_without(name):
    """Past the end of a run they are those of its end."""
    n, base = 8, BASE.replace(hanging_length=0.2)
    if name in ("pivot_friction", "pivot_damping"):
        base = base.replace(release="held")
    columns = random_columns(n, seed=1, pushed=True)
    del columns["static_friction"]  # so that it follows the kinetic one, in a batch as in single runs
    base, wrt = base.replace(**TYPICAL[name] if name else {}), ("light_mass", "kinetic_friction", "release_angle")
    if name:
        wrt += (next(iter(TYPICAL[name])),) if not name == "closure" else ("closure_across_3",)
    for i in range(n):
        p, t = parameters_of_run(base, columns, i), np.linspace(0, 1.5, 60) * (1 + 0.01 * i)
        alone = solve_at(p, t, duration=3.0)
        place = np.minimum(np.arange(len(t)), len(alone.t))
        runs = run_with_derivatives(p, t, wrt, duration=3.0, tolerance=TOLERANCE).runs
        np.testing.assert_array_equal(runs.samples.T, np.array(alone.and_end().state)[:, place])
        try:
            exact = solve_sensitivities(p, t, wrt, duration=3.0).and_end()
        except SensitivityError:
            continue
        expected = np.array(exact.state)[:, :, place].transpose(2, 0, 1)
        np.testing.assert_allclose(runs.partials, expected, rtol=1e-13, atol=1e-13)


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


def test_what_cannot_be_asked_for_is_refused():
    columns = {"heavy_mass": np.ones(2)}
    with pytest.raises(ParameterError, match="threads: found 0, needed 1 or more"):
        solve_batch(BASE, columns, threads=0)


def test_the_hash_tells_sequences_apart():
    modes = list(Mode)[:4]
    hashes = {sequence_hash(modes[:k] + [Mode.ENDED]) for k in range(5)} | {sequence_hash(modes[::-1])}
    assert len(hashes) == 6
    assert sequence_hash([]) == 0xCBF29CE484222325  # FNV-1a's offset basis
    assert ENDS[FAILED] == "failed"
