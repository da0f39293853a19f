"""Metrics against closed forms."""

import dataclasses
import math

import numpy as np
import pint
import pytest

from looping_pendulum.compare import compare
from looping_pendulum.compare.align import align, sample_reference
from looping_pendulum.compare.comparison import judge_tolerance
from looping_pendulum.compare.metrics import acceleration_error
from looping_pendulum.compare.report import value_and_limit
from looping_pendulum.reference_ode.closed_forms import atwood_acceleration
from looping_pendulum.reference_ode.parameters import Release
from looping_pendulum.runs.trajectory import UNKNOWN_MODE
from looping_pendulum.scenarios import json_schema, load_text
from looping_pendulum.scenarios.metrics import METRICS, metric_called


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


@pytest.mark.parametrize("error", [0.0, 0.003, -0.01])
def test_fitted_acceleration_against_the_atwood_machine(closed_form, reference, make_run, times, error):
    parameters = closed_form.parameters.replace(release=Release.VERTICAL)
    run = make_run()
    fallen = 0.5 * (1 + error) * atwood_acceleration(parameters) * times**2
    heavy = run.heavy_position[:1] - np.column_stack([np.zeros_like(times), fallen])
    aligned = align(dataclasses.replace(run, heavy_position=heavy), reference)
    assert acceleration_error(aligned, parameters) == pytest.approx(error, abs=1e-12)


def test_every_metric_has_its_name_and_nothing_is_nan(scenario, reference, make_run, missing):
    broken = make_run()
    broken.light_position[400:] = np.nan
    for engine in compare(scenario, reference, [make_run(), broken, missing]).engines:
        assert tuple(engine.metrics) == tuple(METRICS)
        assert all(value is None or math.isfinite(value) for value in engine.metrics.values())


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
    limits = json_schema()["properties"]["tolerances"]["additionalProperties"]["properties"]["quick"]["properties"]
    assert limits[metric.name]["description"] == metric.description
    assert metric.description.endswith(".")


def test_a_metric_of_another_version_is_shown_in_si():
    unknown = metric_called("later")
    assert (unknown.name, unknown.unit, unknown.quantity(2.0), unknown.limit_words) == ("later", "", "2 SI", "at most")
