"""Transitions after release and events in a batch agree with the driver of single runs; how a batch is driven; and its parts:
Taylor series of expressions, and the search for the first fall of polynomials.
"""

import dataclasses
import math
import warnings

import numpy as np
import pytest

hy = pytest.importorskip("heyoka", reason="without heyoka a batch is a loop over single runs")

from looping_pendulum.errors import IntegratorFallbackWarning, ParameterError  # noqa: E402
from looping_pendulum.reference_ode import batch, heyoka_backend  # noqa: E402
from looping_pendulum.reference_ode.batch import compiled, roots, schedule, solve_batch, steps, system  # noqa: E402
from looping_pendulum.reference_ode.batch.compiled import LEADING, BatchModel, CompiledFunction, SeriesAlgebra, batch_model  # noqa: E402
from looping_pendulum.reference_ode.batch.roots import first_falling_roots  # noqa: E402
from looping_pendulum.reference_ode.batch.runs import (  # noqa: E402
    FAILED,
    BatchResult,
    equation_parameters,
    parameters_of_run,
    valid_runs,
)
from looping_pendulum.reference_ode.batch.steps import stepper  # noqa: E402
from looping_pendulum.reference_ode.batch.system import BOOKKEEPING, Block  # noqa: E402
from looping_pendulum.reference_ode.effects import COEFFICIENTS  # noqa: E402
from looping_pendulum.reference_ode.parameters import Parameters, Release  # noqa: E402
from looping_pendulum.reference_ode.rules import REST_SERIES_DURATION  # noqa: E402
from looping_pendulum.reference_ode.solve import TOLERANCE, Driver, solve, solve_at  # noqa: E402
from looping_pendulum.reference_ode.state import TINY_SPEED, Motion, Signs, State  # noqa: E402
from looping_pendulum.reference_ode.transitions import TABLE, Event, Mode  # noqa: E402
from tests.apparatus import TEN_TO_ONE  # noqa: E402
from tests.reference_ode.test_batch import BASE, random_columns  # noqa: E402

SLIDES = (Mode.SLIDING_DOWN, Mode.SLIDING_UP)
ROUNDING = 1e-14
"""Rounding of numbers about 1, which heyoka's compiled sums add in another order than Python does."""


def apparatus(release: Release) -> list[Parameters]:
    """Return all releases: pushed along either way, across either way, from below and above the rod, heavy and light."""
    given = [
        {"release_angle": math.radians(angle), "heavy_mass": heavy, "push_along": along, "push_across": across}
        for angle in (35.0, 112.0, 200.0)
        for heavy in (0.1, 0.012, 0.002)
        for along in (0.0, 0.4, -0.4)
        for across in (0.0, 0.5, -0.5, 3.0)
    ]
    base = BASE.replace(release=release, kinetic_friction=0.3, light_drag=1e-3, heavy_drag=2e-3, string_drag=3e-3)
    return [base.replace(**changes) for changes in given]


def block_of(all_parameters: list[Parameters]) -> tuple[Block, BatchModel]:
    """Return the runs as a block, and their model, as `Schedule._release` makes it."""
    numbers = [equation_parameters(p, {}) for p in all_parameters]
    model = batch_model(all_parameters[0].effects, numbers[0])
    block = Block(np.zeros((len(BOOKKEEPING) + len(LEADING) + len(model.names), len(numbers))))
    for row, name in enumerate(model.names, start=len(LEADING)):
        block.inputs[row] = [n[name] for n in numbers]
    for entry, name in (("free_length", "free_length"), ("wrap_angle", "release_angle")):
        block[entry] = [n[name] for n in numbers]
    return block, model


def pushes(all_parameters: list[Parameters]) -> tuple[np.ndarray, ...]:
    return tuple(np.array([p.coefficients[name] for p in all_parameters]) for name in ("push_along", "push_across"))


def assert_same(block: Block, drivers: list[Driver], bound: float = ROUNDING) -> None:
    """Check each column against its driver: mode and signs exactly, the state to rounding, `TINY_SPEED` with its sign."""
    assert [Mode(int(mode)) for mode in block["mode"]] == [driver.motion.mode for driver in drivers]
    for name in State._fields:
        expected = np.array([float(getattr(driver.motion.y, name)) for driver in drivers])
        np.testing.assert_allclose(block[name], expected, rtol=0, atol=bound, err_msg=name)
        np.testing.assert_array_equal(np.sign(block[name]), np.sign(expected), err_msg=name)
        tiny = np.abs(expected) <= TINY_SPEED
        np.testing.assert_array_equal(block[name][tiny], expected[tiny], err_msg=name)
    read = {"across": lambda mode: True, "slide": lambda mode: mode.sliding, "heavy": lambda mode: mode.slack}
    read["phase"] = lambda mode: mode.sliding or (mode.slack and mode is not Mode.FALLING)
    for name in read:  # the others belong to effects that do not act here
        for column, driver in enumerate(drivers):
            if read[name](driver.motion.mode):
                assert block[name][column] == getattr(driver.motion.signs, name), (name, driver.motion.mode)


@pytest.mark.parametrize("release", list(Release))
def test_a_release_is_the_single_runs(release):
    every = apparatus(release)
    if release is Release.VERTICAL:
        every = [p for p in every if p.coefficients["push_across"] in (0.0, 0.5)]
    block, model = block_of(every)
    system.release(model, release, block, *pushes(every))
    drivers = [Driver(p, 1.0, TOLERANCE, "scipy") for p in every]
    for driver in drivers:
        driver._start_run()
    assert_same(block, drivers)
    np.testing.assert_array_equal(block["time"], [driver.motion.t for driver in drivers])
    # What the first instant adds is small beside what it is added to; so its second order is compared by itself.
    at_rest = [i for i, driver in enumerate(drivers) if driver.motion.t == REST_SERIES_DURATION]
    assert at_rest or release is Release.HELD
    for name in ("free_length", "wrap_angle"):
        moved = np.array([getattr(d.motion.y, name) - getattr(d.parameters, name.replace("wrap", "release")) for d in drivers])
        actual = block[name] - [getattr(p, name.replace("wrap", "release")) for p in every]
        np.testing.assert_allclose(actual[at_rest], moved[at_rest], rtol=0, atol=5e-16, err_msg=name)  # rounding of about 1


EVENTS = [*TABLE, *((mode, Event.ACROSS_REVERSES) for mode in (*SLIDES, Mode.STICKING, Mode.SLACK))]
EVENTS += [(Mode.SLACK, Event.HEAVY_REVERSES), (Mode.SLACK, Event.CLOSES), (Mode.SLIDING_UP, Event.SLOWS)]
EVENTS += [(Mode.SLIDING_DOWN, Event.TIME_UP), (Mode.STICKING, Event.LIGHT_REACHES_ROD)]


@pytest.mark.parametrize(
    ("mode", "event"), [(m, e) for m, e in EVENTS if m is not Mode.ROLLING and not e.value.startswith("rod_")]
)
def test_what_follows_an_event_is_what_follows_it_in_a_single_run(mode, event):
    """From random states of ``mode``, each with the signs that such a run has."""
    rng = np.random.default_rng(11)
    held = mode in (Mode.CLAMPED, Mode.CLAMPED_SLACK)
    base = TEN_TO_ONE.replace(release="held" if held else "looping")
    drivers = []
    for _ in range(24):
        driver = Driver(base.replace(heavy_mass=10 ** rng.uniform(-2.5, -1)), 1.0, TOLERANCE, "scipy")
        u = 0.0 if mode in (Mode.STICKING, Mode.CLAMPED) or event is Event.STOP else rng.normal(0, 1)
        heavy = u if mode in SLIDES else rng.normal(0, 1) if mode is Mode.SLACK else 0.0
        if event is Event.TAUT and u < heavy:  # the path grows faster than the string is fed
            u, heavy = (heavy, u) if mode is Mode.SLACK else (-u, heavy)
        slack = rng.uniform(0, 0.1) if mode.slack else 0.0
        w = rng.normal(0, 1)
        y = State(rng.uniform(0.2, 0.5), rng.uniform(1.0, 9.0), u, w, heavy, slack)
        signs = driver.motion.signs._replace(
            slide=1.0 if mode is Mode.SLIDING_UP else -1.0,
            across=math.copysign(1.0, w),
            heavy=math.copysign(1.0, heavy),
            phase=0.0 if event is Event.SLOWS else 1.0,
        )
        driver.motion = Motion(mode, 0.0, y, signs)
        drivers.append(driver)
    block, model = block_of([driver.parameters for driver in drivers])
    block["mode"] = float(mode)
    for name in State._fields:
        block[name] = [getattr(driver.motion.y, name) for driver in drivers]
    for name in Signs._fields:
        block[name] = [getattr(driver.motion.signs, name) for driver in drivers]
    system.apply_event(model, block, mode, event)
    ended = [driver._apply_event(event, driver.motion.t, driver.motion.y) for driver in drivers]
    if any(ended):
        assert all(ended)
        assert np.all(block["mode"] == Mode.ENDED)
        return
    assert_same(block, drivers, bound=1e-13)  # an impact divides by sums of masses
    if event is Event.TAUT and mode is Mode.SLACK:
        assert {driver.motion.mode for driver in drivers} >= {Mode.SLIDING_UP, Mode.SLIDING_DOWN}


@pytest.mark.parametrize(
    ("release", "mode", "heavy_speed", "drag"),
    [("held", Mode.CLAMPED_SLACK, 0.0, 0.0), ("looping", Mode.SLACK, -3.0, 1.0)],
)
def test_a_string_that_becomes_taut_under_a_push_is_slack_again(release, mode, heavy_speed, drag):
    """Above the rod a slow light mass weighs on a clamped string; a heavy mass that air slows at 58 m/s^2 does so, too."""
    p = TEN_TO_ONE.replace(release=release, release_angle=math.radians(30), heavy_drag=drag)
    driver = Driver(p, 1.0, TOLERANCE, "scipy")
    y = State(0.4, math.radians(30), 0.5, 0.1, heavy_speed, 0.0)
    driver.motion = Motion(mode, 0.0, y, driver.motion.signs._replace(phase=1.0, across=1.0))
    block, model = block_of([p])
    block["mode"] = float(mode)
    for name in State._fields:
        block[name] = getattr(driver.motion.y, name)
    for name in Signs._fields:
        block[name] = getattr(driver.motion.signs, name)
    driver._apply_event(Event.TAUT, driver.motion.t, driver.motion.y)
    assert driver.motion.mode is mode
    assert driver.motion.signs.phase == 0
    system.apply_event(model, block, mode, Event.TAUT)
    assert_same(block, [driver], bound=1e-13)


def test_a_step_is_as_long_as_its_last_terms_allow():
    """Oracle: Jorba and Zou's rule, on the series itself: the last two terms of all that moves or is watched."""
    every = [BASE.replace(heavy_mass=heavy, kinetic_friction=0.3, light_drag=1e-3) for heavy in np.linspace(0.02, 0.2, 16)]
    block, _ = block_of(every)
    rng = np.random.default_rng(3)
    block["free_length"], block["wrap_angle"] = rng.uniform(0.05, 0.5, 16), rng.uniform(1, 9, 16)
    block["across_speed"], block["across"], block["slide"], block["heavy"] = rng.uniform(0.5, 9, 16), 1.0, -1.0, -1.0
    block["retreat_speed"] = -rng.uniform(0.1, 1, 16)
    block["heavy_speed"] = block["retreat_speed"]
    block["mode"], block["duration"], block["phase"] = float(Mode.SLIDING_DOWN), 5.0, 1.0
    model = batch_model(every[0].effects, equation_parameters(every[0], {}))
    step = stepper(model, Mode.SLIDING_DOWN, TOLERANCE)
    series = step.series(block.inputs)
    moving = series[: (len(step.rows) - 1) * (step.order + 1)].reshape(-1, step.order + 1, 16)
    watched = series[step.sampled.stop : -1].reshape(-1, step.order + 1, 16)
    scale = np.maximum(np.abs(moving[:, 0]).max(axis=0), 1.0)
    last = [np.abs(moving[:, n]) / scale for n in (-2, -1)] + [
        np.abs(watched[:, n]) / np.maximum(np.abs(watched[:, 0]), 1.0) for n in (-2, -1)
    ]
    largest = np.max([part.max(axis=0) for part in last], axis=0)
    np.testing.assert_allclose(largest, 0.05 * TOLERANCE, rtol=1e-6)  # some hundred steps may add up to some tolerances


# How a batch is driven


@pytest.mark.long
def test_nothing_but_one_process_works_unasked(monkeypatch):
    monkeypatch.setattr(batch, "_solved_together", lambda *_: pytest.fail("a second process"))
    assert (
        solve_batch(BASE, {"heavy_mass": np.array([0.1, 0.11]), "heavy_swing": np.full(2, 0.1)}, duration=0.01).end_time[0] > 0
    )


def test_only_events_count_as_events(monkeypatch):
    """A run with more than `MAX_EVENTS` is left to the single integrator; one with as many is not."""
    columns = {"heavy_mass": np.array([0.02, 0.1]), "kinetic_friction": np.array([0.3, 0.3])}
    runs = [solve(BASE.replace(**{name: values[i] for name, values in columns.items()})) for i in range(2)]
    counts = [len(run.events) - 1 for run in runs]  # the release is none
    assert counts[0] > counts[1]
    singly = []
    monkeypatch.setattr(batch, "solve_without_warning", lambda *a, **k: singly.append(solve(*a, **k)) or singly[-1])
    for most, left in ((max(counts), 0), (max(counts) - 1, 1), (min(counts) - 1, 2)):
        singly.clear()
        monkeypatch.setattr(schedule, "MAX_EVENTS", most)
        actual = solve_batch(BASE, columns)
        assert len(singly) == left
        np.testing.assert_allclose(actual.end_time, [run.end_time for run in runs], rtol=0, atol=1e-9)


@pytest.mark.parametrize("call", [
    lambda p: solve(p, duration=0.02),
    lambda p: solve_at(p, np.array([0.01]), duration=0.02),
    lambda p: solve_batch(p, {"heavy_mass": np.array([0.1])}, duration=0.02),
])  # fmt: skip
def test_a_fallback_warning_points_at_the_caller(monkeypatch, call):
    monkeypatch.setattr(heyoka_backend, "MAX_STEPS", 1)
    monkeypatch.setattr(heyoka_backend, "MAX_SAMPLED_STEPS", 1)
    monkeypatch.setattr(schedule, "MAX_STEPS", 1)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        call(TEN_TO_ONE)
    (actual,) = [w for w in caught if w.category is IntegratorFallbackWarning]
    assert actual.filename == __file__


def test_what_is_compiled_is_compiled_once():
    model = batch_model(BASE.effects, equation_parameters(BASE, {}))
    for make in (
        lambda: compiled.drop(model),
        lambda: compiled.light_tension(model, Mode.SLIDING_DOWN),
        lambda: compiled.rates(model, Mode.SLIDING_DOWN),
        lambda: compiled.holding_margins(model),
        lambda: compiled.impact(model, 1.0),
        lambda: steps.stepper(model, Mode.SLIDING_DOWN, TOLERANCE),
        lambda: roots._compiled_root_expressions(4),
        lambda: roots._compiled_halves(4),
    ):
        assert make() is make()


# The numbers of a batch

RANGES = {
    **{name: (math.nan, -1.0, 0.0, 1e-9, 0.4, math.inf) for name in ("light_mass", "heavy_mass", "hanging_length")},
    "rod_radius": (math.nan, -1.0, 0.0, 1e-9, 0.4, 1.5, 1.6, math.inf),  # a third of the radius must be below l = 0.5
    "free_length": (math.nan, -1.0, 0.0, 0.006 / 3, 0.0021, 0.4, math.inf),
    "light_radius": (math.nan, -1e-9, 0.0, 0.4, 0.495, math.inf),
    "release_angle": (math.nan, -1.0, 0.0, 1e-9, 6.28, 2 * math.pi, 7.0),
    **{
        name: (math.nan, low - 1e-3, low, c.null, high, high * (1 + 1e-6) + 1e-6)
        for name, c in COEFFICIENTS.items()
        for low, high in [c.bounds]
    },
}


@pytest.mark.parametrize("follows", [True, False])
@pytest.mark.parametrize("name", RANGES)
def test_a_batch_refuses_what_a_single_run_refuses(name, follows):
    base = BASE.replace(**({} if follows else {"static_friction": 0.4}))
    values = np.array(RANGES[name])

    def taken(value: float) -> bool:
        try:
            base.replace(**{name: value})
        except ParameterError:
            return False
        return True

    expected = [taken(float(value)) for value in values]
    assert True in expected
    assert False in expected
    with np.errstate(all="ignore"):  # as `Schedule.run` does
        assert valid_runs(base, equation_parameters(base, {name: values}), len(values)).tolist() == expected


@pytest.mark.parametrize("release", list(Release))
def test_the_numbers_of_a_run_in_a_batch_are_those_of_a_single_one(release):
    columns = {name: values[:8] for name, values in random_columns(8, seed=4, pushed=True).items()}
    columns["heavy_swing"] = np.linspace(0, 0.3, 8)
    base = BASE.replace(release=release)
    numbers = equation_parameters(base, columns)
    for i in range(8):
        single = vars(parameters_of_run(base, columns, i).values())
        for name in set(single) - {"release", "string_loss_time"}:
            assert np.broadcast_to(numbers[name], 8)[i] == pytest.approx(single[name], rel=1e-15), name


@pytest.mark.parametrize("n", [1, 3, 8])
def test_a_result_lies_where_processors_read_it_fastest(n):
    result = BatchResult.empty(n)
    columns = [getattr(result, field.name) for field in dataclasses.fields(BatchResult)]
    assert all(column.flags.aligned and len(column) == n for column in columns)
    assert np.all(result.end == FAILED)
    assert {name for name in vars(result) if np.isnan(np.asarray(getattr(result, name), dtype=float)).all()} == {
        "halting_time", "halting_wrap_angle", "halting_free_length", "drop", "wrap_angle", "free_length", "end_time",
    }  # fmt: skip


def test_series_of_the_elementary_functions():
    """Oracle: known series of functions of 0.5 + s, s the variable."""
    algebra = SeriesAlgebra()
    x = algebra.variable(hy.expression("x"), lambda: algebra.series(1.0))
    cases = {
        "exp": (algebra.exp(x), [math.exp(0.5) / math.factorial(n) for n in range(6)]),
        "sin": (algebra.sin(x), [math.sin(0.5 + n * math.pi / 2) / math.factorial(n) for n in range(6)]),
        "cos": (algebra.cos(x), [math.cos(0.5 + n * math.pi / 2) / math.factorial(n) for n in range(6)]),
        "1/x": (1.0 / x, [(-1.0) ** n / 0.5 ** (n + 1) for n in range(6)]),
        "sqrt(x^3)": (algebra.sqrt(x * x * x), [_binomial(1.5, n) * 0.5 ** (1.5 - n) for n in range(6)]),
        "(3 - x) x / 2": ((3.0 - x) * x / 2.0, [0.625, 1.0, -0.5, 0.0, 0.0, 0.0]),
        "-x + 1": (-x + 1.0, [0.5, -1.0, 0.0, 0.0, 0.0, 0.0]),
    }
    for name, (series, expected) in cases.items():
        terms = [hy.expression(0.0) + series[n] for n in range(6)]
        actual = hy.cfunc(terms, [hy.expression("x")])(np.array([0.5]))
        np.testing.assert_allclose(actual, expected, rtol=1e-13, atol=1e-15, err_msg=name)


def _binomial(a, n):
    return math.prod((a - k) / (k + 1) for k in range(n))


def test_a_compiled_function_gives_each_column_the_same_wherever_it_stands():
    x, y = hy.make_vars("x", "y")
    function = CompiledFunction([hy.exp(x) * hy.sin(y) + 1.0 / y, hy.log(x) - y], [x, y])
    data = np.random.default_rng(0).uniform(0.1, 3.0, (2, 19))
    whole = function(data)
    np.testing.assert_allclose(whole, [np.exp(data[0]) * np.sin(data[1]) + 1 / data[1], np.log(data[0]) - data[1]], rtol=1e-14)
    for i in range(19):
        np.testing.assert_array_equal(function(data[:, i : i + 1])[:, 0], whole[:, i])


def test_equal_operations_are_made_once():
    algebra = SeriesAlgebra()
    x = algebra.variable(hy.expression("x"), lambda: algebra.series(1.0))
    y = algebra.variable(hy.expression("y"), lambda: algebra.series(1.0))
    assert x * y is y * x
    assert algebra.sin(x + y) is algebra.sin(y + x)


def test_first_falling_roots_are_those_of_a_fine_grid():
    """Oracle: signs on a grid of 2e-5, and the polynomial's own value at the root."""
    rng = np.random.default_rng(0)
    degree, n = 16, 400
    polynomials = rng.normal(size=(degree + 1, n)) * np.exp(-1.0 * np.arange(degree + 1))[:, None]
    actual = first_falling_roots(polynomials)
    grid = np.linspace(0, 1, 50_001)
    for i in range(n):
        signs = np.polyval(polynomials[::-1, i], grid) > 0
        falls = np.flatnonzero(signs[:-1] & ~signs[1:])
        if falls.size:
            assert abs(actual[i] - grid[falls[0]]) < 4e-5
            assert abs(np.polyval(polynomials[::-1, i], actual[i])) < 1e-14
        else:
            assert np.isinf(actual[i])


def test_a_close_pair_of_roots_is_not_missed():
    """(x - 0.3)(x - 0.3 - d) falls at 0.3, rises d later; a touch from above, or a rise, is no fall."""
    gaps = np.array([1e-2, 1e-4, 1e-6])
    pairs = np.array([0.3 * (0.3 + gaps), -(0.6 + gaps), np.ones(3)])
    np.testing.assert_allclose(first_falling_roots(pairs), 0.3, rtol=0, atol=1e-9)
    never = np.array([[0.09 + 1e-9, -0.6, 1.0], [-0.3, 1.0, 0.0], [1.0, 0.0, 0.0]]).T
    assert np.all(np.isinf(first_falling_roots(never)))


def test_a_function_that_starts_at_zero_falls_only_later():
    """x (0.5 - x) starts at exactly 0, rises and falls at 0.5."""
    assert first_falling_roots(np.array([[0.0], [0.5], [-1.0]]))[0] == pytest.approx(0.5, abs=1e-15)
