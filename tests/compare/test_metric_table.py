"""Every metric of the one table is computed, limited, judged, shown and documented by what stands there."""

from __future__ import annotations

from pathlib import Path

import pint
import pytest

from looping_pendulum.compare import compare
from looping_pendulum.compare.comparison import judge_tolerance
from looping_pendulum.compare.report import limit_and_value
from looping_pendulum.scenarios import json_schema, load_text
from looping_pendulum.scenarios.metrics import METRICS, metric_called
from scripts.metrics_page import PAGE, page

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


def test_every_metric_is_computed_in_the_order_of_the_table(scenario, reference, make_run):
    assert list(compare(scenario, reference, [make_run()]).engines[0].metrics) == list(METRICS)


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
    limit, value = limit_and_value(judged)
    assert limit == f"{metric.limit_words} 3 {metric.shown_in.name}"
    assert value.endswith(f" {metric.shown_in.name}") or judged.value is None
    if judged.value is not None:
        assert judged.outcome.good is metric.is_within(judged.value, tolerance.limit)


@each_metric
def test_editors_of_scenario_files_show_what_it_is(metric):
    limits = json_schema()["$defs"]["Limits"]["properties"]
    assert limits[metric.name]["description"] == metric.description
    assert metric.description.endswith(".")


def test_the_page_of_metrics_is_what_the_table_says():
    assert PAGE == Path(__file__).parents[2] / "docs" / "metrics.md"
    assert PAGE.read_text(encoding="utf-8") == page(), "out of date; write it again: python -m scripts.metrics_page"


def test_a_metric_of_another_version_is_shown_in_si():
    unknown = metric_called("later")
    assert (unknown.name, unknown.unit, unknown.quantity(2.0), unknown.limit_words) == ("later", "", "2 SI", "at most")
