"""Metrics against closed forms."""

import dataclasses
import math

import numpy as np
import pint
import pytest

from looping_pendulum.compare import compare
from looping_pendulum.compare.align import align, sample_reference
from looping_pendulum.compare.comparison import judge_tolerance
from looping_pendulum.compare.deviation import departures, evaluate_tube, growth_rate
from looping_pendulum.compare.metrics import acceleration_error, rms_until
from looping_pendulum.compare.report import value_and_limit
from looping_pendulum.reference_ode.closed_forms import atwood_acceleration
from looping_pendulum.reference_ode.parameters import Release
from looping_pendulum.runs.trajectory import UNKNOWN_MODE
from looping_pendulum.scenarios import json_schema, load_text
from looping_pendulum.scenarios.metrics import METRICS, metric_called


def test_a_run_shifted_by_3_mm_has_an_rms_of_3_mm_at_every_mark(scenario, reference, make_run):
    result = compare(scenario, reference, [make_run(shift=(1.8e-3, -2.4e-3))])
    for name in ("rms_0.35s", "rms_0.7s", "rms_1.0s", "rms_halt"):
        assert result.engines[0].metrics[name] == pytest.approx(3e-3, rel=1e-12)


def test_rms_grows_as_a_linear_drift_says(reference, make_run, times):
    run = make_run()
    drifting = dataclasses.replace(run, light_position=run.light_position + 0.01 * run.t[:, None] * np.array([1.0, 0.0]))
    t = times[times <= 0.7 + 1e-9]
    assert rms_until(align(drifting, reference), 0.7) == pytest.approx(0.01 * math.sqrt(np.mean(t**2)), rel=1e-12)


def test_a_mark_that_the_run_or_the_reference_does_not_reach_has_no_rms(reference, make_run):
    assert rms_until(align(make_run(until=0.5), reference), 0.7) is None
    assert rms_until(align(make_run(until=0.5), reference), 0.35) is not None
    assert rms_until(align(make_run(), lambda t: reference(t, end=0.6)), 0.7) is None
    assert rms_until(align(make_run(), reference), None) is None


def test_reference_is_asked_once_per_time_in_rising_order_and_never_outside_itself(reference):
    asked = []

    def watched(t):
        asked.append(t)
        return reference(t)

    got = sample_reference(watched, np.array([0.2, -0.1, 0.1, 2.0, 0.2, np.nan]))
    assert np.array_equal(asked[0], [0.1, 0.2, 2.0])
    assert np.array_equal(np.isfinite(got.heavy_position[:, 1]), [True, False, True, False, True, False])
    assert got.mode[3] == UNKNOWN_MODE
    assert got.wrap_angle[0] == got.wrap_angle[4] > got.wrap_angle[2]


def test_a_delay_inside_the_tube_passes_and_one_outside_does_not(reference, make_run):
    late = align(make_run(delay=4e-3), reference)
    assert late.distance.max() > 5e-3, "the amplitude alone would not forgive this delay"
    assert evaluate_tube(late, reference).fraction == 1.0
    assert evaluate_tube(late, reference).first_exit is None
    later = evaluate_tube(align(make_run(delay=15e-3), reference), reference)
    assert 0 < later.fraction < 1
    assert later.first_exit > 0


def test_an_offset_inside_the_tube_passes_and_one_outside_does_not(reference, make_run):
    assert evaluate_tube(align(make_run(shift=(0.0, 4.9e-3)), reference), reference).fraction == 1.0
    out = evaluate_tube(align(make_run(shift=(0.1, 0.1)), reference), reference)
    assert (out.fraction, out.first_exit) == (0.0, 0.0)


def test_the_tube_ends_with_the_reference(reference, make_run):
    def short(t):
        return reference(t, end=0.5)

    assert evaluate_tube(align(make_run(), short), short).compared == 501
    assert evaluate_tube(align(make_run(until=-1.0), reference), reference).fraction is None


def test_departures_say_when_and_in_which_direction(reference, make_run):
    run = make_run()
    growing = 1e-3 * np.exp(20 * (run.t - 0.4))
    heavy = run.heavy_position + np.array([0.0, -5e-4])
    radial = run.light_position / np.linalg.norm(run.light_position, axis=1)[:, None]
    out = dataclasses.replace(run, light_position=run.light_position + growing[:, None] * radial, heavy_position=heavy)
    out = dataclasses.replace(out, free_length=run.free_length + growing)
    crossings = departures(align(out, reference), reference(run.t).events)
    assert [d.threshold for d in crossings] == [1e-3, 1e-2]
    assert crossings[0].time == pytest.approx(0.401, abs=1.1e-3)  # the first sample beyond the crossing
    assert crossings[1].time == pytest.approx(0.4 + math.log(10) / 20, abs=1.1e-3)
    assert growth_rate(crossings) == pytest.approx(20, rel=0.02)  # two times, each up to a sample late
    assert (crossings[0].after, crossings[0].heavy) == ("halt", pytest.approx(-5e-4))
    assert crossings[0].along == pytest.approx(1e-3, rel=0.03)
    assert "sticks" in crossings[0].mode


@pytest.mark.parametrize("error", [0.0, 0.003, -0.01])
def test_fitted_acceleration_against_the_atwood_machine(closed_form, reference, make_run, times, error):
    parameters = closed_form.parameters.replace(release=Release.VERTICAL)
    run = make_run()
    fallen = 0.5 * (1 + error) * atwood_acceleration(parameters) * times**2
    heavy = run.heavy_position[:1] - np.column_stack([np.zeros_like(times), fallen])
    aligned = align(dataclasses.replace(run, heavy_position=heavy), reference)
    assert acceleration_error(aligned, parameters) == pytest.approx(error, abs=1e-12)


def test_with_drag_the_acceleration_is_held_against_the_references(closed_form, reference, make_run):
    parameters = closed_form.parameters.replace(release=Release.VERTICAL, heavy_drag=1e-3)
    assert acceleration_error(align(make_run(), reference), parameters) == pytest.approx(0.0, abs=1e-12)
    assert acceleration_error(align(make_run(), reference), closed_form.parameters) is None


def test_every_metric_has_its_name_and_nothing_is_nan(scenario, reference, make_run, missing):
    broken = make_run()
    broken.light_position[400:] = np.nan
    for engine in compare(scenario, reference, [make_run(), broken, missing]).engines:
        assert tuple(engine.metrics) == tuple(METRICS)
        assert all(value is None or math.isfinite(value) for value in engine.metrics.values())


def test_a_run_that_became_nan_keeps_what_it_has(scenario, reference, make_run):
    broken = make_run(shift=(3e-3, 0.0))
    broken.light_position[400:] = np.nan
    engine = compare(scenario, reference, [broken]).engines[0]
    assert engine.metrics["rms_0.35s"] == pytest.approx(3e-3, rel=1e-12)
    assert engine.metrics["rms_0.7s"] is None
    assert engine.end_time == pytest.approx(0.399)


SCENARIO = """
title: A
light: {mass: 10 g}
heavy: {mass: 100 g}
rod: {radius: 6.25 mm}
release: {angle: 90 deg, free_length: 60 cm, hanging_length: 3 cm}
duration: 1 s
"""
REGISTRY = pint.UnitRegistry()
each_metric = pytest.mark.parametrize("metric", METRICS.values(), ids=METRICS)


@each_metric
def test_the_unit_in_which_it_is_shown_is_that_many_of_the_si_unit(metric):
    # Oracle: pint.
    assert REGISTRY.Quantity(1.0, metric.unit or "").m_as(metric.shown_in.name) == pytest.approx(
        metric.shown_in.per_si_unit, rel=1e-12
    )
    assert metric.column == f"{metric.heading} [{metric.shown_in.name}]"


@each_metric
def test_a_scenario_may_limit_it_in_the_unit_in_which_it_is_shown(metric, scenario, reference, make_run):
    written = f"3 {metric.shown_in.name}" if metric.unit else f"{3 / metric.shown_in.per_si_unit}"
    text = f'{SCENARIO}tolerances: {{"pymunk:chain": {{quick: {{{metric.name}: {{limit: {written}, reason: test}}}}}}}}\n'
    (tolerance,) = load_text(text, "a").tolerances
    assert tolerance.limit == pytest.approx(3 / metric.shown_in.per_si_unit, rel=1e-12)
    judged = judge_tolerance(tolerance, compare(scenario, reference, [make_run()]).engines[0])
    value, limit = value_and_limit(judged)
    assert limit == f"{metric.limit_words} 3 {metric.shown_in.name}"
    assert value.endswith(f" {metric.shown_in.name}") or judged.value is None
    if judged.value is not None:
        assert judged.outcome.good is metric.is_within(judged.value, tolerance.limit)


@each_metric
def test_editors_of_scenario_files_show_what_it_is(metric):
    limits = json_schema()["$defs"]["ProfilesGroup"]["properties"]["quick"]["properties"]
    assert limits[metric.name]["description"] == metric.description
    assert metric.description.endswith(".")


def test_a_metric_of_another_version_is_shown_in_si():
    unknown = metric_called("later")
    assert (unknown.name, unknown.unit, unknown.quantity(2.0), unknown.limit_words) == ("later", "", "2 SI", "at most")
