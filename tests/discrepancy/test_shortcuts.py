"""Shortcuts of a fit change no result: parameters that are only partly checked, runs that are only partly sampled."""

import dataclasses
import math

import numpy as np
import pytest

from looping_pendulum.compare.landmarks import EVENT_QUANTITIES
from looping_pendulum.discrepancy.fit import event_prediction as prediction
from looping_pendulum.discrepancy.fit.calibration import calibrate_steps
from looping_pendulum.discrepancy.fit.problem import (
    MIN_BATCH_OF_OWN_MODEL,
    Problem,
    alone,
    predict_requests,
    together,
)
from looping_pendulum.discrepancy.inputs import read_inputs
from looping_pendulum.errors import HarnessError, ParameterError
from looping_pendulum.measured.camera import CAMERA, Camera
from looping_pendulum.measured.free_parameter import FreeParameter, ParameterRole
from looping_pendulum.measured.observations import EventObservation
from looping_pendulum.measured.study_io import load
from looping_pendulum.reference_ode.batch import compiled_alone, supports
from looping_pendulum.reference_ode.effects import COEFFICIENTS
from looping_pendulum.reference_ode.parameters import Parameters, Release
from looping_pendulum.scenarios import loader
from tests.apparatus import TEN_TO_ONE
from tests.blind.cases import CASES
from tests.discrepancy.blind_study import write_study

FIELDS = [f.name for f in dataclasses.fields(Parameters) if f.name not in ("release", "coefficients", "own_effects")]


def made_by_constructor(base, **changes):
    """The same parameters by the constructor, which checks everything."""
    data = {f.name: getattr(base, f.name) for f in dataclasses.fields(Parameters)}
    given = {n: v for n, v in base.coefficients.items() if n != "static_friction" or not base.static_equals_kinetic}
    given |= {n: changes.pop(n) for n in list(changes) if n in COEFFICIENTS}
    return Parameters(**(data | changes | {"coefficients": given}))


@pytest.mark.parametrize("name", [*FIELDS, *COEFFICIENTS])
@pytest.mark.parametrize("release", Release)
def test_a_copy_with_another_number_is_what_the_constructor_makes(name, release):
    base = TEN_TO_ONE.replace(release=release)
    if name in COEFFICIENTS:
        low, high = COEFFICIENTS[name].bounds
        value = max(low + 0.3 * (high - low), base.coefficients["kinetic_friction"] if name == "static_friction" else low)
    else:
        value = 1.01 * getattr(base, name) or 1e-3
    assert base.effects  # what is remembered of the base must not reach the copy
    copy, constructed = base.replace(**{name: value}), made_by_constructor(base, **{name: value})
    assert copy == constructed
    assert copy.effects == constructed.effects
    assert vars(copy.values()) == vars(constructed.values())
    back = getattr(base, name) if name not in COEFFICIENTS else base.coefficients[name]
    restored = copy.replace(**{name: back})
    assert restored.effects == base.effects
    if name != "static_friction":  # given by itself, it does not follow any more
        assert restored == base


@pytest.mark.parametrize(
    "changes",
    [
        {"light_mass": -1.0},
        {"free_length": math.nan},
        {"release_angle": 7.0},
        {"light_drag": 2.0},
        {"light_drag": math.inf},
        {"kinetic_friction": 0.5, "static_friction": 0.4},
        {"rod_mobility": 1.0, "string_compliance": 1e-3},
        {"light_radius": 10.0},
    ],
)
def test_a_copy_that_cannot_be_is_refused_as_by_the_constructor(changes):
    with pytest.raises(ParameterError) as by_constructor:
        made_by_constructor(TEN_TO_ONE, **changes)
    with pytest.raises(ParameterError) as by_copy:
        TEN_TO_ONE.replace(**changes)
    assert str(by_copy.value) == str(by_constructor.value)


def row(quantity, index=1, value=0.0):
    return EventObservation(quantity=quantity, index=index, value=value, sigma=0.01, unit=EVENT_QUANTITIES[quantity].unit)


@pytest.mark.parametrize("name", ["ten_to_one", "two_to_one"])
def test_a_run_that_is_sampled_in_part_tells_of_the_same_events(name):
    parameters = loader.load(name).parameters
    whole = prediction.run_for_events(parameters)
    count = len(prediction.landmarks(whole, Camera()).x1_extrema)
    rows = [row("x1_extremum", i) for i in range(1, count + 2)] + [row("halting_time"), row("drop_at_halt")]
    exact = prediction.predict_events(whole, Camera(), rows)
    assert np.isnan(exact).tolist() == [False] * count + [True, False, False]  # one turn more than there are
    first_rows, all_turns = rows[: (count + 1) // 2], rows[:count]
    for requested, table_ends in (
        (first_rows, exact[len(first_rows) - 1]),
        (all_turns, 0.3 * exact[count - 1]),
        (rows, 0.3 * exact[count - 1]),
    ):
        timed = [dataclasses.replace(r, value=float(table_ends)) for r in requested]
        run = prediction.EventRun(parameters, timed)
        expected = [exact[rows.index(r)] for r in requested]
        assert run.predict(Camera()) == pytest.approx(expected, rel=1e-10, nan_ok=True)
        tilted = Camera(tilt=0.1)  # another camera sees other turns of the same run
        assert run.predict(tilted) == pytest.approx(prediction.predict_events(whole, tilted, requested), rel=1e-10, nan_ok=True)
        assert run.samples.t[-1] == pytest.approx(whole.t[-1])


def test_only_what_a_table_covers_is_sampled_at_first():
    parameters = loader.load("two_to_one").parameters
    first = prediction.landmarks(prediction.run_for_events(parameters), Camera()).x1_extrema[0].time
    run = prediction.EventRun(parameters, [row("x1_extremum", value=first)])
    assert run.predict(Camera()) == pytest.approx([first], rel=1e-10)
    assert run._samples.t[-1] == pytest.approx(prediction.SAMPLING_MARGIN * first, abs=prediction.SAMPLE_STEP)
    assert run._samples.run.end_time > 1.01 * prediction.SAMPLING_MARGIN * first


# ---- many predictions at once are those of single runs: of candidates, cameras, clocks, several trials, impossible values


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("study")
    return read_inputs(load(write_study(folder, CASES["clean_varied"], 3, trials=["ten_a", "six"])))


@pytest.fixture(scope="module")
def problem(inputs):
    return Problem(inputs.study, inputs.training, inputs.free_parameters)


@pytest.fixture
def in_batches(monkeypatch):
    """Predict without a single run."""

    def predicted(requests):
        with monkeypatch.context() as patch:
            patch.setattr(Problem, "predict", lambda *_: pytest.fail("a single run"))
            return predict_requests(requests)

    return predicted


def singly(problem, rows):
    """Predict by single runs."""
    return np.array([np.concatenate([one(problem, x, k) for k in range(len(problem.data))]) for x in rows])


def one(problem, x, k):
    try:
        return problem.predict(x, k)
    except HarnessError:
        return np.full(len(problem.data[k].value), np.nan)


@pytest.mark.long
def test_of_every_candidate_and_of_all_trials_at_once(inputs, problem, in_batches):
    """Oracle: single runs, with only those effects compiled in that act."""
    rng = np.random.default_rng(5)
    requests = []
    for c in inputs.library:
        names = [name for name in (c.parameter,) if name in problem.base[0].coefficients]
        if not supports(problem.base[0], names) or c.companions:
            continue
        count = MIN_BATCH_OF_OWN_MODEL if compiled_alone(problem.base[0].effects_with(names)) else 3
        reach = min(c.bounds[1] - c.null, 0.02 * (abs(c.null) or 1.0)) or -0.02
        extended = problem.with_parameters(dataclasses.replace(c.free_parameter(1.0), scale=abs(reach)))
        rows = rng.normal(0, 0.3, (count, len(extended.names)))
        rows[:, -1] = np.sign(reach) * np.linspace(0.5, 1.0, count)
        requests.append((extended, rows))
    assert len(requests) > 20
    for (extended, rows), found in zip(requests, in_batches(requests), strict=True):
        np.testing.assert_allclose(found, singly(extended, rows), atol=1e-9, rtol=0, err_msg=extended.names[-1])


def error_of_camera(name, trials, scale):
    role, c = ParameterRole.CAMERA, CAMERA[name]
    return FreeParameter(name=name, parameter=name, role=role, trials=trials, init_value=c.null, scale=scale)


def test_of_every_error_of_the_camera(problem, in_batches):
    rng = np.random.default_rng(6)
    trials = tuple(d.trial.name for d in problem.data)
    names = set(CAMERA) - {"origin_x", "origin_y", "rate_offset"}
    extended = problem.with_parameters(*(error_of_camera(name, trials, CAMERA[name].error) for name in sorted(names)))
    rows = rng.normal(0, 0.5, (3, len(extended.names)))
    (found,) = in_batches([(extended, rows)])
    np.testing.assert_allclose(found, singly(extended, rows), atol=1e-9, rtol=0)


def test_where_the_model_or_the_camera_cannot_be_there_is_no_number(problem, in_batches):
    trials = tuple(d.trial.name for d in problem.data)
    own = [
        FreeParameter(name="rod_radius", parameter="rod_radius", trials=trials, init_value=0.006, scale=1.0),
        error_of_camera("perspective_x", trials, 1.0),
        error_of_camera("clock_offset", trials, 1.0),
    ]
    extended = Problem(problem.study, problem.data, own)
    rows = np.array([[0, 0, 0], [-1, 0, 0], [9, 0, 0], [0, 5, 0], [0, 0, 50], [0, 0, 90], [0, 0.1, 0.01], [1e-3, 0, 0.0]])
    (found,) = in_batches([(extended, rows)])
    expected = singly(extended, rows)
    assert np.isnan(found).all(axis=1).tolist() == [False, True, True, True, True, True, False, False]
    np.testing.assert_allclose(found, expected, atol=1e-9, rtol=0)


def test_a_prediction_depends_on_no_other_in_any_bit(problem, in_batches):
    rows = np.random.default_rng(7).normal(0, 0.5, (40, len(problem.names)))
    (whole,) = in_batches([(problem, rows)])
    (part,) = in_batches([(problem, rows[11:23])])
    assert np.array_equal(whole[11:23], part)
    first, second = in_batches([(problem, rows[:20]), (problem, rows[20:])])
    assert np.array_equal(whole, np.vstack([first, second]))


@pytest.mark.long
def test_fits_in_step_end_where_they_end_alone(problem):
    """Oracle: each by itself, some of its steps by single runs."""
    rng = np.random.default_rng(8)
    starts = [np.clip(rng.normal(0, 0.5, len(problem.names)), problem.low, problem.high) for _ in range(3)]
    in_step = together([calibrate_steps(problem, start) for start in starts])
    for start, fit in zip(starts, in_step, strict=True):
        assert fit.cost == pytest.approx(alone(calibrate_steps(problem, start)).cost, rel=1e-4)
