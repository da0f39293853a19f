"""How the figures look, held against what was agreed on, and what their lines show, held against the runs.

`appearance.json` holds the look. After a change that is meant, run
``APPEARANCE=write python -m pytest tests/compare/test_appearance.py``, look at the figures, and commit both.
"""

import dataclasses
import json
import os
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from looping_pendulum.compare import compare, figures
from looping_pendulum.compare.convergence import report as convergence_plots
from looping_pendulum.measured.tables.events import MeasuredEventRow
from looping_pendulum.pages.drawing import draw
from looping_pendulum.pages.figures import on_page
from looping_pendulum.runs.trajectory import RunStatus
from tests.compare import fingerprint

STORED = Path(__file__).with_name("appearance.json")


MADE = {}
"""The comparison below, once it is made: it is frozen, and its fixtures are made anew for every test."""


@pytest.fixture
def full(measured_scenario, reference, make_run, missing, table):
    """A comparison with everything that a figure can show."""
    if not MADE:
        MADE["full"] = everything(measured_scenario, reference, make_run, missing, table)
    return MADE["full"]


def everything(measured_scenario, reference, make_run, missing, table):
    late = make_run(shift=(2e-3, -1e-3), delay=4e-3)
    lower = dataclasses.replace(late, heavy_position=late.heavy_position - np.outer(np.minimum(late.t, 0.3), [0.0, 0.04]))
    crashed = make_run(delay=-2e-3, until=0.6, engine="mujoco", status=RunStatus.CRASHED)
    exact = make_run(engine="drake", profile="accurate")
    rows = [
        *table,
        MeasuredEventRow(quantity="t_A", index=1, measured=0.33, paper_numerical=0.34, unit="s"),
        MeasuredEventRow(quantity="height_change_at_A", index=1, measured=-0.24, paper_numerical=None, unit="m"),
        MeasuredEventRow(quantity="time_light_reaches_rod", index=1, measured=1.0, paper_numerical=1.05, unit="s"),
    ]
    return compare(measured_scenario, reference, [lower, crashed, exact, missing], rows)


def looks(result):
    """Name -> figure, of both kinds."""
    charts = figures.charts(result)
    fingerprints = {chart.id: fingerprint.of_figure(draw(chart)) for chart in charts}
    return fingerprints | {f"page {chart.id}": fingerprint.plain(on_page(chart)) for chart in charts}


def ladder():
    """A variant's ladder of four steps with everything that its figure can show."""
    steps = (8e-4, 4e-4, 2e-4, 1e-4)
    marks = list(convergence_plots.PATH_END_TIMES)
    rungs = [
        SimpleNamespace(
            value=v,
            run=SimpleNamespace(
                errors={m: (1 + i) * v for i, m in enumerate(marks)} | {convergence_plots.HALT: -3 * v},
            ),
        )
        for v in steps
    ]
    verdicts = [
        SimpleNamespace(quantity=marks[0], order=1.02, limit_error=1e-4, uncertainty=None),
        *(SimpleNamespace(quantity=m, order=None, limit_error=None, uncertainty=None) for m in marks[1:]),
        SimpleNamespace(quantity=convergence_plots.HALT, order=None, limit_error=1e-4, uncertainty=2e-4),
    ]
    to_limit = {m: [0.9 * v for v in steps] for m in marks}
    ladder = SimpleNamespace(rungs=rungs, verdicts=verdicts, to_limit=to_limit, setting="time_step", unit="s", own=4e-4)
    for rung, i in zip(rungs, range(4), strict=True):
        rung.to_limit = {m: to_limit[m][i] for m in marks}
    spread = {m: 1e-5 for m in marks} | {convergence_plots.HALT: 5e-5}
    return SimpleNamespace(label="pymunk:chain", profile="quick", spread=spread, ladders=(ladder,)), ladder


def test_figures_look_as_agreed(full):
    actual = looks(full) | {"ladder": fingerprint.of_figure(draw(convergence_plots.ladder_chart(*ladder())))}
    actual = json.loads(json.dumps(actual))
    if os.environ.get("APPEARANCE") == "write":
        STORED.write_text(json.dumps(actual, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    stored = json.loads(STORED.read_text(encoding="utf-8"))
    assert not fingerprint.differences(actual, stored), "meant? see this file's first lines"


def test_a_changed_look_is_seen(full):
    original = json.loads(json.dumps(looks(full)))
    thicker = json.loads(json.dumps(original))
    thicker["path"]["axes"][0]["lines"][1]["lw"] *= 1.1
    thicker["page drop"]["traces"][1]["x"]["sums"][0] += 1e-3
    assert len(fingerprint.differences(thicker, original)) == 2


def lines_of(figure, k=0):
    return {line.get_label(): line.get_data() for line in figure.axes[k].lines}


def test_the_divergence_is_the_distance_in_millimetres(full):
    # Oracle: the runs' own samples.
    drawn = lines_of(draw(figures.divergence_chart(full, full.samples)))
    late, reference = full.samples.aligned[0], full.samples.reference
    t, distance = drawn["pymunk:chain"]
    expected = 1e3 * np.hypot(*(late.run.light_position - reference.light_position[: len(late.t)]).T)
    np.testing.assert_allclose(distance, expected, rtol=1e-12)
    np.testing.assert_array_equal(t, late.t)
    assert "drake:chain (below 1e-05 mm)" in drawn


def test_a_lower_heavy_mass_is_drawn_above_zero_in_the_panel_of_drops(full):
    figure = draw(figures.drop_chart(full, full.samples))
    late, reference = full.samples.aligned[0], full.samples.reference
    lines = [line.get_data() for line in figure.axes[1].lines[1:]]  # after the line at zero
    expected = 1e3 * (reference.heavy_position[: len(late.t), 1] - late.run.heavy_position[:, 1])
    assert expected[-1] == pytest.approx(12, abs=0.5)
    np.testing.assert_allclose(lines[0][1], expected, rtol=1e-9, atol=1e-9)
    low, high = figure.axes[0].get_ylim()
    assert low > high, "down is down"


def test_measured_drops_are_downward(full):
    assert figures.measured_drops(full) == [(0.33, 0.24), (0.3512, 0.25)]


def test_event_times_are_drawn_less_the_measured_ones(full):
    drawn = lines_of(draw(figures.events_chart(full)))
    measured = [row.measured for row in full.measured if row.unit == "s" and row.measured is not None]
    reference = [row.reference for row in full.measured if row.unit == "s" and row.measured is not None]
    expected = [1e3 * (v - m) for v, m in zip(reference, measured, strict=True) if v is not None]
    np.testing.assert_allclose(drawn["reference"][0], expected, rtol=1e-12)
    (reference,) = [trace for trace in on_page(figures.events_chart(full))["traces"] if trace["name"] == "reference"]
    np.testing.assert_allclose([x for x, _ in reference["customdata"]], expected, rtol=1e-5)  # a page has six digits


def test_the_star_is_where_the_light_mass_was_at_the_halt(full):
    chart = figures.path_chart(full, full.samples)
    late, halt = full.samples.aligned[0].run, full.engines[0].landmarks.halting_time
    place = [np.interp(halt, late.t, late.light_position[:, k]) for k in (0, 1)]
    stars = [np.ravel(line.get_data()) for line in draw(chart).axes[0].lines if line.get_marker() == "*"]
    assert any(np.allclose(star, place, atol=1e-12) for star in stars)
    pairs = [(t["x"][0], t["y"][0]) for t in on_page(chart)["traces"] if len(t["x"]) == 1]
    assert any(np.allclose(pair, place, atol=1e-6) for pair in pairs)
