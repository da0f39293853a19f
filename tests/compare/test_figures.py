"""What figures show in cases that the agreed look does not have: nothing to show, everything in one place, far too much."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from matplotlib.figure import Figure

from looping_pendulum.compare import compare, page, plots
from looping_pendulum.compare.result import MeasuredRow
from looping_pendulum.engines.trajectory import RunStatus
from looping_pendulum.pages.palette import styles


def row(measured=0.4, reference=None, engine=None, quantity="x1_extremum", index=1, unit="s", paper=None):
    return MeasuredRow(
        quantity=quantity,
        index=index,
        unit=unit,
        measured=measured,
        paper_numerical=paper,
        reference=reference,
        engines=(engine,),
    )


@pytest.fixture
def compared(scenario, reference, make_run):
    """Comparison of one run that is 2 mm off; ``fields`` of the result as given."""

    def make(run=None, **fields):
        return dataclasses.replace(compare(scenario, reference, [run or make_run(shift=(2e-3, 0.0))]), **fields)

    return make


def look_of(result):
    return styles(e.label for e in result.engines)


def on_page(result, name):
    (match,) = [figure for figure in page.figures(result) if figure.id == name]
    return match


# ---- event times


@pytest.mark.parametrize(
    ("late", "reach"),
    [(0.0, 5.5), (2e-3, 5.5), (-0.02, 22.0), (0.04, 44.0), (0.2, 50.0)],
    ids=["none", "within the digit", "early", "late", "far"],
)
def test_the_pages_event_times_reach_a_tenth_beyond_the_furthest(compared, late, reach):
    """At least a tenth beyond half of the last printed digit, 5 ms; at most 50 ms, or one would squeeze the others."""
    result = compared(measured=(row(reference=0.4, engine=0.4 + late), row(index=2)))
    figure = on_page(result, "events")
    low, high = figure.layout["xaxis"]["range"]
    assert (low, high) == (pytest.approx(-reach), pytest.approx(reach))
    (digit,) = figure.layout["shapes"]
    assert (digit["x0"], digit["x1"], digit["y0"], digit["y1"]) == (-5.0, 5.0, 0, 1)
    assert [trace["x"] for trace in figure.traces] == [[0.0, None], [pytest.approx(1e3 * late), None]]
    assert figure.traces[0]["y"] == ["x1 extremum 1", "x1 extremum 2"]


def test_each_event_has_the_bar_of_its_standard_error(compared):
    rows = (row(reference=0.41), dataclasses.replace(row(index=2, reference=0.42), sigma=0.002))
    result = compared(measured=rows)
    bars = on_page(result, "events").layout["shapes"]
    assert [(bar["x0"], bar["x1"], bar["y0"], bar["y1"]) for bar in bars] == [(-5.0, 5.0, -0.5, 0.5), (-2.0, 2.0, 0.5, 1.5)]
    assert "standard error" in on_page(result, "events").caption


def test_event_times_are_those_that_were_measured(compared):
    rows = (
        row(reference=0.41, engine=0.42),
        row(measured=None, reference=0.5),
        row(quantity="drop_at_halt", unit="m", reference=0.3),
    )
    result = compared(measured=rows)
    assert all(len(trace["x"]) == 1 for trace in on_page(result, "events").traces)
    (axes,) = plots.events_figure(result, look_of(result)).axes
    assert [label.get_text() for label in axes.get_yticklabels()] == ["x1 extremum 1"]
    assert {line.get_label(): float(line.get_xdata()[0]) for line in axes.lines if len(line.get_xdata()) == 1} == {
        "reference": pytest.approx(10.0), "pymunk:chain": pytest.approx(20.0),
    }  # fmt: skip
    for none in ((row(measured=None, reference=0.5),), (row(quantity="drop_at_halt", unit="m"),), ()):
        assert "events" not in {figure.id for figure in page.figures(compared(measured=none))}
        assert "events.png" not in plots.draw(compared(measured=none, samples=None))


def test_an_engine_without_any_measured_event_is_not_in_the_legend(compared):
    result = compared(measured=(row(reference=0.4),))
    assert [trace["name"] for trace in on_page(result, "events").traces] == ["reference"], "nor a paper"
    result = compared(measured=(row(reference=0.4, paper=0.41),))
    assert [trace["name"] for trace in on_page(result, "events").traces] == ["paper's numerical", "reference"]
    (axes,) = plots.events_figure(result, look_of(result)).axes
    assert "pymunk:chain" not in {line.get_label() for line in axes.lines}


def test_the_engines_points_are_spread_over_their_row_in_their_order(scenario, reference, make_run):
    result = compare(scenario, reference, [make_run(engine=name) for name in ("a", "b", "c", "d")])
    rows = tuple(dataclasses.replace(row(reference=0.4), engines=(0.41, None, 0.42, 0.43), index=k) for k in (1, 2))
    result = dataclasses.replace(result, measured=rows)
    (axes,) = plots.events_figure(result, look_of(result)).axes
    first = {line.get_label(): float(line.get_ydata()[0]) for line in axes.lines if len(line.get_xdata()) == 2}
    heights = [first[f"{name}:chain"] for name in "acd"]
    assert np.diff(heights) == pytest.approx([0.18, 0.18])
    assert first["reference"] < heights[0]
    assert heights[-1] < 0.5, "nearer to its own row than to the next"
    assert axes.get_ylim()[0] > axes.get_ylim()[1], "the first row is on top"


# ---- the page's lines


def test_a_pages_line_has_at_most_600_points(compared, make_run, times):
    run = on_page(compared(), "drop").traces[1]
    assert len(run["x"]) == 526, "1051 samples: every second"
    assert run["x"][:3] == [0.0, 0.002, 0.004]
    short = on_page(compared(make_run(until=0.599)), "drop").traces[1]
    assert len(short["x"]) == page.MAX_LINE_POINTS == 600, "600 samples: all"
    assert len(on_page(compared(make_run(until=0.6)), "drop").traces[1]["x"]) == 301


def test_a_page_shows_runs_of_two_samples_or_more(scenario, reference, make_run):
    names = [make_run(engine="one", until=0.0), make_run(engine="two", until=1e-3)]
    figure = on_page(compare(scenario, reference, names), "divergence")
    assert [trace["name"] for trace in figure.traces] == ["two:chain"]
    drawn = plots.divergence_figure(*(lambda r: (r, r.samples, look_of(r)))(compare(scenario, reference, names)))
    assert {t.get_text().split()[0] for t in drawn.legends[0].get_texts()} == {"two:chain"}


def test_deviations_of_a_hundredth_of_a_micron_are_left_out_of_a_log_axis(compared, make_run):
    """Oracle: a run that is 1 nm off up to 0.5 s, and 3 mm off from then on; of its height, too."""
    run = make_run()
    off = np.where(run.t < 0.5, 1e-9, 3e-3)
    run = dataclasses.replace(
        run,
        light_position=run.light_position + np.outer(off, [0.0, 1.0]),
        heavy_position=run.heavy_position - np.outer(off, [0.0, 1.0]),
    )
    result = compared(run)
    (distance,) = on_page(result, "divergence").traces
    below = on_page(result, "drop").traces[2]
    for trace in (distance, below):
        known = [(x, y) for x, y in zip(trace["x"], trace["y"], strict=True) if y is not None]
        assert known[0][0] == pytest.approx(0.5)
        np.testing.assert_allclose([y for _, y in known], 3.0, rtol=1e-4)
    assert below["yaxis"] == "y2"
    drawn = plots.divergence_figure(result, result.samples, look_of(result))
    (line,) = [line for line in drawn.axes[0].lines if line.get_label() == "pymunk:chain"]
    x, y = line.get_data()
    assert x[np.isfinite(y)][0] == pytest.approx(0.5)
    assert drawn.axes[0].get_ylim() == (pytest.approx(0.5), pytest.approx(20.0)), "both thresholds are in sight, twice over"


def test_the_limits_of_the_divergence_follow_the_runs(compared, make_run):
    """Oracle: distances from 0.01 mm to 100 mm, all but 5 % of them above the lower limit, which is half of it."""
    run = make_run()
    size = 1e-5 * 10 ** (4 * np.arange(len(run.t)) / (len(run.t) - 1))
    result = compared(dataclasses.replace(run, light_position=run.light_position + np.outer(size, [1.0, 0.0])))
    drawn = plots.divergence_figure(result, result.samples, look_of(result))
    low, high = drawn.axes[0].get_ylim()
    assert high == pytest.approx(200.0, rel=1e-6)
    assert low == pytest.approx(0.5 * 1e-2 * 10 ** (4 * 0.05), rel=1e-3)


def test_events_after_the_end_of_the_run_are_not_drawn(compared):
    result = compared()
    events = (*result.reference.events, ("slack", result.duration), ("taut", result.duration + 1e-3))
    result = dataclasses.replace(result, reference=dataclasses.replace(result.reference, events=events))
    words = [word["text"] for word in on_page(result, "divergence").layout["annotations"]]
    drawn = plots.divergence_figure(result, result.samples, look_of(result))
    assert [text.get_text() for text in drawn.axes[0].texts] == words == ["halt", "slack"]
    levels = [shape["y0"] for shape in on_page(result, "divergence").layout["shapes"] if shape["y0"] == shape["y1"]]
    assert levels == [pytest.approx(1.0), pytest.approx(10.0)]


def test_a_run_that_does_not_halt_has_no_star(compared, make_run):
    stars = [t for t in on_page(compared(), "path").traces if t["mode"] == "markers"]
    assert [star["name"] for star in stars] == ["pymunk:chain halts", "reference halts"]
    result = compared(make_run(until=0.3))
    assert [t["name"] for t in on_page(result, "path").traces if t["mode"] == "markers"] == ["reference halts"]
    without = dataclasses.replace(result.reference.landmarks, halting_time=None)
    result = dataclasses.replace(result, reference=dataclasses.replace(result.reference, landmarks=without))
    assert [t["mode"] for t in on_page(result, "path").traces] == ["lines", "lines"]
    drawn = plots.path_figure(result, result.samples, look_of(result))
    assert len(drawn.axes[0].collections) == 0


@pytest.mark.parametrize(("status", "crosses"), [(RunStatus.CRASHED, 1), (RunStatus.LIGHT_REACHED_ROD, 0)])
def test_a_cross_is_where_a_run_broke_off(compared, make_run, status, crosses):
    run = make_run(until=0.6, status=status)
    result = compared(run)
    drawn = plots.path_figure(result, result.samples, look_of(result))
    positions = [np.ravel(line.get_data()) for line in drawn.axes[0].lines if line.get_marker() == "x"]
    assert len(positions) == crosses
    assert all(np.allclose(place, run.light_position[-1]) for place in positions)


def test_the_page_has_no_figures_without_the_trajectories(compared):
    assert page.figures(compared(samples=None)) == []
    assert plots.draw(compared(samples=None)) == {}
    assert [figure.id for figure in page.figures(compared())] == ["path", "drop", "divergence"]


def test_the_path_on_the_page_is_that_of_the_run(compared, make_run):
    run = make_run(until=0.3, shift=(2e-3, 0.0))
    first, second = on_page(compared(run), "path").traces[:2]
    assert (first["name"], second["name"]) == ("reference", "pymunk:chain")
    np.testing.assert_allclose(np.column_stack([second["x"], second["y"]]), run.light_position, atol=1e-6)
    assert first["x"][0] == pytest.approx(run.light_position[0, 0] - 2e-3, abs=1e-6)


# ---- Matplotlib's axes


@pytest.mark.parametrize(
    ("x", "y", "wide"),
    [((1.0, 1.2), (-3.0, 1.0), ((0.1, 2.1), (-3.0, 1.0))), ((0.0, 4.0), (5.0, 6.0), ((0.0, 4.0), (4.5, 6.5))),
     ((0.0, 3.0), (0.0, 4.0), ((0.0, 3.0), (0.0, 4.0)))],
)  # fmt: skip
def test_a_path_that_is_nearly_a_line_gets_half_its_length_to_the_side(x, y, wide):
    axes = Figure().subplots()
    axes.set(xlim=x, ylim=y)
    plots._widen(axes)
    assert axes.get_xlim() == pytest.approx(wide[0])
    assert axes.get_ylim() == pytest.approx(wide[1])


def test_a_clamped_mass_is_drawn_at_rest_and_not_as_its_rounding(compared, make_run):
    run = make_run()
    rest = np.tile(run.heavy_position[:1], (len(run.t), 1)) + np.outer(1e-12 * np.sin(run.t), [0.0, 1.0])
    result = compared(dataclasses.replace(run, heavy_position=rest))
    samples = dataclasses.replace(result.samples, reference=dataclasses.replace(result.samples.reference, heavy_position=rest))
    top, below = plots.drop_figure(result, samples, look_of(result)).axes
    assert top.get_ylim() == (pytest.approx(0.01), pytest.approx(-0.001))
    low, high = below.get_ylim()
    assert low < -200, "an engine that stays while the reference falls"
    assert high == pytest.approx(0.2, rel=1e-6) or high > 0.2


def test_the_panel_of_drops_shows_a_fifth_of_a_millimetre_at_least(compared, make_run):
    result = compared(make_run())
    _, below = plots.drop_figure(result, result.samples, look_of(result)).axes
    assert below.get_ylim() == (pytest.approx(-0.2), pytest.approx(0.2))
    large = make_run()
    lower = large.heavy_position - np.outer(np.linspace(0, 5e-3, len(large.t)), [0.0, 1.0])
    result = compared(dataclasses.replace(large, heavy_position=lower))
    _, below = plots.drop_figure(result, result.samples, look_of(result)).axes
    assert below.get_ylim()[1] >= 5.0, "below the reference is a larger drop, which is up"


def test_measured_drops_need_a_time_and_a_height(compared):
    rows = (
        row(0.3, quantity="t_A"), row(-0.2, quantity="height_change_at_A", unit="m"), row(0.5, quantity="t_B"),
        row(-0.3, quantity="height_change_at_halt", unit="m"), row(0.8, quantity="halting_time"),
    )  # fmt: skip
    assert plots.measured_drops(compared(measured=rows)) == [(0.3, 0.2), (0.8, 0.3)]
    second = (row(0.5, quantity="t_B"), row(-0.1, quantity="height_change_at_B", unit="m"))
    assert plots.measured_drops(compared(measured=second)) == [(0.5, 0.1)]
    assert plots.measured_drops(compared(measured=())) == []
    others = tuple(dataclasses.replace(r, index=2) for r in rows)
    assert plots.measured_drops(compared(measured=others)) == []


@pytest.mark.parametrize(
    ("text", "shown"),
    [("a" * 50, "a" * 50), ("a" * 51, "a" * 50 + "..."), ("$x$", r"\$x\$"), ("\ud800", "\\ud800")],
)
def test_a_long_name_is_cut_and_no_name_is_a_formula(text, shown):
    assert plots.without_mathtext(text) == shown


@pytest.mark.parametrize(("count", "columns"), [(1, 1), (2, 2), (7, 3)])
def test_a_legend_has_no_more_columns_than_words(count, columns):
    figure, (axes,) = plots.make_figure(4.0, 3.0)
    for k in range(count):
        axes.plot([0, 1], [k, k], label=str(k))
    plots.legend_below(figure)
    (legend,) = figure.legends
    assert legend._ncols == columns
    assert [text.get_text() for text in legend.get_texts()] == [str(k) for k in range(count)]


def test_a_figure_without_words_has_no_legend():
    figure, axes = plots.make_figure(4.0, 3.0, rows=(1, 3))
    plots.legend_below(figure)
    assert figure.legends == []
    assert axes[0].get_subplotspec().get_gridspec().get_height_ratios() == [1, 3]
    assert list(figure.get_size_inches()) == [4.0, 3.0]


def test_the_star_on_the_page_is_where_the_light_mass_was(compared, closed_form):
    star = on_page(compared(), "path").traces[-1]
    run = compared().samples.reference
    place = [np.interp(closed_form.halt, run.t, run.light_position[:, k]) for k in (0, 1)]
    assert [star["x"][0], star["y"][0]] == pytest.approx(place, abs=1e-6)
    assert math.hypot(star["x"][0] - place[0], star["y"][0] - place[1]) < 1e-6
