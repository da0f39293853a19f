"""What may not depend on the processor or on the libraries of linear algebra: runs, the static test, a turn of the data loop.

`test_each` runs this file under every backend; each test's oracle is one that no backend computed.
"""

import json
import math
import subprocess
import sys

import numpy as np
import pytest
from numpy._core import _multiarray_umath as numpy_build

from looping_pendulum.discrepancy.evidence.explanation import COST_ERROR
from looping_pendulum.discrepancy.fit.calibration import COST_TOLERANCE
from looping_pendulum.discrepancy.fit.residual import check_residuals
from looping_pendulum.engines.isolation import run_isolated
from looping_pendulum.engines.protocol import Profile
from looping_pendulum.engines.registry import select
from looping_pendulum.reference_ode.batch import sequence_hash, solve_batch
from looping_pendulum.reference_ode.sensitivity import solve_sensitivities
from looping_pendulum.reference_ode.solve import solve, solve_at
from looping_pendulum.reference_ode.transitions import Mode
from looping_pendulum.scenarios.scenario import Scenario
from tests.apparatus import TEN_TO_ONE, WITHOUT_LOSSES
from tests.backends.write_expected import APPARATUS, CANDIDATES, DATA, PUSH, data_loop

EVENTS = json.loads((DATA / "events.json").read_text(encoding="utf-8"))


def test_this_process_and_those_that_it_starts_are_under_the_backend(backend):
    probe = "from numpy._core import _multiarray_umath as m; print(*(name for name, on in m.__cpu_features__.items() if on))"
    child = subprocess.run([sys.executable, "-c", probe], capture_output=True, text=True, check=True, timeout=60)
    here = [name for name, on in numpy_build.__cpu_features__.items() if on]
    assert child.stdout.split() == here
    assert not set(here) & set(backend.environment.get("NPY_DISABLE_CPU_FEATURES", "").split())


@pytest.mark.parametrize("name", APPARATUS)
def test_events_are_those_of_longer_arithmetic(name):
    # Oracle: 80 bits, whose rounding is 2000 times smaller. Bound: 1000 times the tolerance of a step: errors of steps add up.
    run = solve(APPARATUS[name], duration=2.0)
    sequence = [[e.event and e.event.value, e.mode_after.name] for e in run.events]
    assert sequence == [[event, mode] for event, _, mode, *_ in EVENTS[name]]
    actual = np.array([[e.time, e.state.wrap_angle, e.state.free_length] for e in run.events], dtype=float)
    expected = np.array([[time, angle, length] for _, time, _, angle, length in EVENTS[name]])
    np.testing.assert_allclose(actual, expected, rtol=1e-9, atol=1e-9)  # the angle grows to 23 rad


def test_a_batch_has_the_same_sequences():
    given = [APPARATUS[name] for name in APPARATUS]
    fields = ("light_mass", "heavy_mass", "rod_radius", "free_length", "release_angle")
    columns = {field: np.array([getattr(p, field) for p in given]) for field in fields}
    columns |= {name: np.array([p.coefficients[name] for p in given]) for name in given[0].coefficients if "drag" in name}
    columns["kinetic_friction"] = np.array([p.coefficients["kinetic_friction"] for p in given])
    batch = solve_batch(TEN_TO_ONE, columns, duration=2.0)
    phases = ("slows", "across_reverses")
    modes = [[Mode[mode] for event, _, mode, *_ in EVENTS[name] if event not in phases] for name in APPARATUS]
    assert batch.sequence.tolist() == [sequence_hash(sequence) for sequence in modes]
    np.testing.assert_allclose(batch.end_time, [EVENTS[name][-1][1] for name in APPARATUS], rtol=0, atol=1e-9)


EDGE = TEN_TO_ONE.replace(release="vertical", **WITHOUT_LOSSES)
FRICTION = 0.34


@pytest.mark.parametrize(
    "p",
    [
        EDGE.replace(heavy_mass=EDGE.light_mass),
        EDGE.replace(kinetic_friction=FRICTION, heavy_mass=EDGE.light_mass * math.exp(FRICTION * math.pi)),
        EDGE.replace(kinetic_friction=FRICTION, heavy_mass=EDGE.light_mass * math.exp(-FRICTION * math.pi)),
    ],
    ids=["equal masses", "edge of sliding down", "edge of sliding up"],
)
def test_on_the_edge_of_sliding_nothing_moves_whichever_way_rounding_decides(p):
    # Oracle: statics. Bound: the tolerance of a step, 1e-12, of some hundred steps. With equal masses the string once let go
    # of the rod by rounding, while all rests.
    run = solve(p, duration=1.0)
    t = np.linspace(0, 1.0, 11)
    assert np.abs(run.heavy_drop(run.sample(t).state)).max() < 1e-10


def test_a_string_released_horizontal_is_taut():
    # cos(90 deg) is 6e-17: a tension of that size, of whichever sign, is none. Oracle: energy.
    p = TEN_TO_ONE.replace(release="held", release_angle=math.pi / 2, **WITHOUT_LOSSES)
    samples = solve_at(p, np.array([0.5]), duration=0.51)
    fallen = -samples.light_position[0, 1] + p.rod_radius
    assert 0.5 * np.sum(samples.light_velocity[0] ** 2) == pytest.approx(9.81 * fallen, rel=1e-9)
    assert samples.run.modes[0] is Mode.CLAMPED


def test_a_worker_process_finds_the_reference_where_it_is():
    (engine,) = select(["reference"], Profile.QUICK)
    scenario = Scenario(name="ten", title="", description="", parameters=TEN_TO_ONE, duration=0.05)
    run = run_isolated(engine, scenario).raise_if_failed()
    exact = solve_at(TEN_TO_ONE, run.t, duration=0.06)
    # Oracle: the same here, at a finer tolerance. Bound: that of a step, over a hundred steps.
    np.testing.assert_allclose(run.light_position, exact.light_position, rtol=0, atol=100 * engine.settings.tolerance)


def test_derivatives_are_those_of_differences():
    # Oracle: central differences. Bound: their own error, a third derivative times h^2, and a few 1e-12 / h.
    h, t = 1e-4, np.array([0.2])
    slopes = solve_sensitivities(TEN_TO_ONE, t, ("kinetic_friction",), duration=0.21).state.wrap_angle
    ends = [solve_at(TEN_TO_ONE.replace(kinetic_friction=0.34 + s * h), t, duration=0.21).state.wrap_angle for s in (1, -1)]
    assert np.ravel(slopes) == pytest.approx((ends[0] - ends[1]) / (2 * h), rel=1e-6)


@pytest.fixture(scope="module")
def loop():
    return data_loop()


@pytest.mark.long
def test_the_data_loop_names_the_push_and_gives_the_planted_values_back(loop):
    # Oracle: what made the data. Bound: 4 standard errors, of 4 numbers on one set of noise.
    assert loop.explanations[0].key == {"push_across"}
    true = {"kinetic_friction": 0.34, "ten.release_angle": math.radians(112), "ten.free_length": 0.58, "push_across": PUSH}
    for name, planted in true.items():
        assert abs(loop.added.values[name] - planted) < 4 * loop.added.errors[name], name
    assert not check_residuals(loop.declared).passes
    assert check_residuals(loop.added).passes


def test_the_data_loop_finds_the_same_numbers(loop):
    # Oracle: the same under the default backend, stored. Bound: a fit has converged when its cost falls by a smaller share than
    # COST_TOLERANCE, so two fits may end that far apart, in standard errors. Those of explanations have when it falls by less
    # than COST_ERROR, of which half is the error of the logarithm of the evidence.
    stored = json.loads((DATA / "data_loop.json").read_text(encoding="utf-8"))
    for name, fit in (("declared", loop.declared), ("added", loop.added)):
        apart = math.sqrt(2 * COST_TOLERANCE * fit.cost)
        for number, value in fit.values.items():
            assert abs(value - stored[name][number]) < apart * fit.errors[number], (name, number)
    assert set(loop.log_bayes_factors) == set(CANDIDATES)
    assert loop.log_bayes_factors == pytest.approx(stored["log_bayes_factors"], abs=COST_ERROR)
