"""What figures show in cases that the agreed look does not have: nothing to show, everything in one place, far too much."""

import dataclasses
import math
from types import SimpleNamespace

import numpy as np
import pytest

from looping_pendulum.compare import compare, figures
from looping_pendulum.compare.convergence import report as convergence_plots
from looping_pendulum.compare.convergence.result import HALT, PATH_END_TIMES
from looping_pendulum.compare.result import MeasuredRow
from looping_pendulum.pages import drawing
from looping_pendulum.pages.figures import MAX_LINE_POINTS, on_page
from looping_pendulum.runs.trajectory import RunStatus


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


def chart_of(result, name):
    (match,) = [chart for chart in figures.charts(result) if chart.id == name]
    return match


def page_of(result, name):
    return on_page(chart_of(result, name))


def drawing_of(result, name):
    return drawing.draw(chart_of(result, name))


def traces_of(result, name):
    return {trace["name"]: trace for trace in page_of(result, name)["traces"]}


# ---- event times


@pytest.mark.parametrize(
    ("late", "reach"),
    [(0.0, 5.5), (2e-3, 5.5), (-0.02, 22.0), (0.04, 44.0), (0.2, 220.0)],
    ids=["none", "within the digit", "early", "late", "far"],
)
def test_event_times_reach_a_tenth_beyond_the_furthest(compared, late, reach):
    """At least a tenth beyond half of the last printed digit, 5 ms; beyond 20 ms the axis is logarithmic."""
    result = compared(measured=(row(reference=0.4, engine=0.4 + late), row(index=2)))
    (axes,) = drawing_of(result, "events").axes
    assert axes.get_xlim() == (pytest.approx(-reach), pytest.approx(reach))
    figure = page_of(result, "events")
    far = reach / 20 if reach <= 20 else 1 + math.log10(reach / 20)
    assert figure["layout"]["xaxis"]["range"] == [pytest.approx(-far, rel=1e-5), pytest.approx(far, rel=1e-5)]
    bars, reference, engine = figure["traces"]
    assert [x for x, _ in bars["customdata"]] == [-5.0, 5.0, None] * 2
    assert (reference["customdata"], reference["x"]) == ([[0.0, "x1 extremum 1"]], [0.0])
    assert engine["customdata"] == [[pytest.approx(1e3 * late), "x1 extremum 1"]]
    assert figure["layout"]["yaxis"]["ticktext"] == ["x1 extremum 1", "x1 extremum 2"]


def test_each_event_has_the_bar_of_its_standard_error(compared):
    rows = (row(reference=0.41), dataclasses.replace(row(index=2, reference=0.42), sigma=0.002))
    chart = chart_of(compared(measured=rows), "events")
    bars = np.column_stack(chart.panels[0].curves[0].drawn())
    np.testing.assert_allclose(bars[[0, 1, 3, 4]], [(-5.0, 0), (5.0, 0), (-2.0, 1), (2.0, 1)])
    assert np.isnan(bars[[2, 5]]).all(), "a gap after each"
    assert "standard error" in chart.caption


def test_event_times_are_those_that_were_measured(compared):
    rows = (
        row(reference=0.41, engine=0.42),
        row(measured=None, reference=0.5),
        row(quantity="drop_at_halt", unit="m", reference=0.3),
    )
    result = compared(measured=rows)
    assert all(len(trace["x"]) == 1 for trace in page_of(result, "events")["traces"][1:])
    (axes,) = drawing_of(result, "events").axes
    assert [label.get_text() for label in axes.get_yticklabels()] == ["x1 extremum 1"]
    assert {line.get_label(): float(line.get_xdata()[0]) for line in axes.lines if len(line.get_xdata()) == 1} == {
        "reference": pytest.approx(10.0), "pymunk:chain": pytest.approx(20.0),
    }  # fmt: skip
    for none in ((row(measured=None, reference=0.5),), (row(quantity="drop_at_halt", unit="m"),), ()):
        assert "events" not in {chart.id for chart in figures.charts(compared(measured=none))}
        assert figures.charts(compared(measured=none, samples=None)) == []


def test_an_engine_without_any_measured_event_is_not_in_the_legend(compared):
    result = compared(measured=(row(reference=0.4),))
    assert list(traces_of(result, "events")) == ["measured", "reference"], "nor a paper"
    result = compared(measured=(row(reference=0.4, paper=0.41),))
    assert list(traces_of(result, "events")) == ["measured", "paper's numerical", "reference"]
    (axes,) = drawing_of(result, "events").axes
    assert "pymunk:chain" not in {line.get_label() for line in axes.lines}


def test_the_engines_points_are_spread_over_their_row_in_their_order(scenario, reference, make_run):
    result = compare(scenario, reference, [make_run(engine=name) for name in ("a", "b", "c", "d")])
    rows = tuple(dataclasses.replace(row(reference=0.4), engines=(0.41, None, 0.42, 0.43), index=k) for k in (1, 2))
    result = dataclasses.replace(result, measured=rows)
    (axes,) = drawing_of(result, "events").axes
    first = {line.get_label(): float(line.get_ydata()[0]) for line in axes.lines if len(line.get_xdata()) == 2}
    heights = [first[f"{name}:chain"] for name in "acd"]
    assert np.diff(heights) == pytest.approx([0.18, 0.18])
    assert first["reference"] < heights[0]
    assert heights[-1] < 0.5, "nearer to its own row than to the next"
    assert axes.get_ylim()[0] > axes.get_ylim()[1], "the first row is on top"


# ---- the page's lines


def test_a_pages_line_has_at_most_600_points(compared, make_run, times):
    run = page_of(compared(), "drop")["traces"][1]
    assert len(run["x"]) == 526, "1051 samples: every second"
    assert run["x"][:3] == [0.0, 0.002, 0.004]
    short = page_of(compared(make_run(until=0.599)), "drop")["traces"][1]
    assert len(short["x"]) == MAX_LINE_POINTS == 600, "600 samples: all"
    assert len(page_of(compared(make_run(until=0.6)), "drop")["traces"][1]["x"]) == 301


def test_a_page_shows_runs_of_two_samples_or_more(scenario, reference, make_run):
    names = [make_run(engine="one", until=0.0), make_run(engine="two", until=1e-3)]
    result = compare(scenario, reference, names)
    (name,) = traces_of(result, "divergence")
    assert name.split()[0] == "two:chain"
    drawn = drawing_of(result, "divergence")
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
    (distance,) = page_of(result, "divergence")["traces"]
    known = [(x, y) for x, y in zip(distance["x"], distance["y"], strict=True) if y is not None]
    assert known[0][0] == pytest.approx(0.5)
    np.testing.assert_allclose([y for _, y in known], 3.0, rtol=1e-4)
    drawn = drawing_of(result, "divergence")
    (line,) = [line for line in drawn.axes[0].lines if line.get_label() == "pymunk:chain"]
    x, y = line.get_data()
    assert x[np.isfinite(y)][0] == pytest.approx(0.5)
    assert drawn.axes[0].get_ylim() == (pytest.approx(0.5), pytest.approx(20.0)), "both thresholds are in sight, twice over"


def test_the_page_shows_small_drops_linearly_and_large_ones_by_powers_of_ten(compared, make_run):
    """Oracle: a heavy mass that is 0.05 mm lower up to 0.5 s and 3 mm higher from then on; linear within 0.1 mm."""
    run = make_run()
    off = np.where(run.t < 0.5, -5e-5, 3e-3)
    result = compared(dataclasses.replace(run, heavy_position=run.heavy_position + np.outer(off, [0.0, 1.0])))
    figure = page_of(result, "drop")
    (below,) = [trace for trace in figure["traces"] if trace["yaxis"] == "y2"]
    early = np.array(below["x"]) < 0.5
    np.testing.assert_allclose(np.array(below["y"])[early], 0.5, rtol=1e-4)
    np.testing.assert_allclose(np.array(below["y"])[~early], -(1 + math.log10(30)), rtol=1e-4)
    shown = np.array([drop for _, drop in below["customdata"]])
    np.testing.assert_allclose(shown, np.where(early, 0.05, -3.0), rtol=1e-4)
    axis = figure["layout"]["yaxis2"]
    assert dict(zip(axis["ticktext"], axis["tickvals"], strict=True))["\N{MINUS SIGN}10"] == pytest.approx(-3.0)


def test_the_limits_of_the_divergence_follow_the_runs(compared, make_run):
    """Oracle: distances from 0.01 mm to 100 mm, all but 5 % of them above the lower limit, which is half of it."""
    run = make_run()
    size = 1e-5 * 10 ** (4 * np.arange(len(run.t)) / (len(run.t) - 1))
    result = compared(dataclasses.replace(run, light_position=run.light_position + np.outer(size, [1.0, 0.0])))
    drawn = drawing_of(result, "divergence")
    low, high = drawn.axes[0].get_ylim()
    assert high == pytest.approx(200.0, rel=1e-6)
    assert low == pytest.approx(0.5 * 1e-2 * 10 ** (4 * 0.05), rel=1e-3)


def test_events_after_the_end_of_the_run_are_not_drawn(compared):
    result = compared()
    events = (*result.reference.events, ("slack", result.duration), ("taut", result.duration + 1e-3))
    result = dataclasses.replace(result, reference=dataclasses.replace(result.reference, events=events))
    words = [word["text"] for word in page_of(result, "divergence")["layout"]["annotations"]]
    drawn = drawing_of(result, "divergence")
    assert [text.get_text() for text in drawn.axes[0].texts] == words == ["halt", "slack"]
    levels = [shape["y0"] for shape in page_of(result, "divergence")["layout"]["shapes"] if shape["y0"] == shape["y1"]]
    assert levels == [pytest.approx(1.0), pytest.approx(10.0)]


def test_a_run_that_does_not_halt_has_no_star(compared, make_run):
    def stars(result):
        return [t["name"] for t in page_of(result, "path")["traces"] if t["mode"] == "markers"]

    assert stars(compared()) == ["reference halts", "pymunk:chain halts"]
    result = compared(make_run(until=0.3))
    assert stars(result) == ["reference halts"]
    without = dataclasses.replace(result.reference.landmarks, halting_time=None)
    result = dataclasses.replace(result, reference=dataclasses.replace(result.reference, landmarks=without))
    assert [t["mode"] for t in page_of(result, "path")["traces"]] == ["lines", "lines"]
    drawn = drawing_of(result, "path")
    assert not [line for line in drawn.axes[0].lines if line.get_marker() == "*"]


@pytest.mark.parametrize(("status", "crosses"), [(RunStatus.CRASHED, 1), (RunStatus.LIGHT_REACHED_ROD, 0)])
def test_a_cross_is_where_a_run_broke_off(compared, make_run, status, crosses):
    run = make_run(until=0.6, status=status)
    result = compared(run)
    drawn = drawing_of(result, "path")
    positions = [np.ravel(line.get_data()) for line in drawn.axes[0].lines if line.get_marker() == "x"]
    assert len(positions) == crosses
    assert all(np.allclose(place, run.light_position[-1]) for place in positions)


def test_there_are_no_figures_without_the_trajectories(compared):
    assert figures.charts(compared(samples=None)) == []
    assert [chart.id for chart in figures.charts(compared())] == ["path", "drop", "divergence"]


def test_the_path_on_the_page_is_that_of_the_run(compared, make_run):
    run = make_run(until=0.3, shift=(2e-3, 0.0))
    first, second = page_of(compared(run), "path")["traces"][:2]
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
    assert figures.with_room(x, y) == [pytest.approx(wide[0]), pytest.approx(wide[1])]


def test_a_clamped_mass_is_drawn_at_rest_and_not_as_its_rounding(compared, make_run):
    run = make_run()
    rest = np.tile(run.heavy_position[:1], (len(run.t), 1)) + np.outer(1e-12 * np.sin(run.t), [0.0, 1.0])
    result = compared(dataclasses.replace(run, heavy_position=rest))
    samples = dataclasses.replace(result.samples, reference=dataclasses.replace(result.samples.reference, heavy_position=rest))
    result = dataclasses.replace(result, samples=samples)
    top, below = drawing_of(result, "drop").axes
    assert top.get_ylim() == (pytest.approx(0.01), pytest.approx(-0.001))
    low, high = below.get_ylim()
    assert low < -200, "an engine that stays while the reference falls"
    assert high > 0.2


def test_the_panel_of_drops_shows_a_fifth_of_a_millimetre_at_least(compared, make_run):
    result = compared(make_run())
    _, below = drawing_of(result, "drop").axes
    assert below.get_ylim() == (pytest.approx(-0.22), pytest.approx(0.22)), "with a margin of 5 %"
    large = make_run()
    lower = large.heavy_position - np.outer(np.linspace(0, 5e-3, len(large.t)), [0.0, 1.0])
    result = compared(dataclasses.replace(large, heavy_position=lower))
    _, below = drawing_of(result, "drop").axes
    assert below.get_ylim()[1] >= 5.0, "below the reference is a larger drop, which is up"


def test_measured_drops_need_a_time_and_a_height(compared):
    rows = (
        row(0.3, quantity="t_A"), row(-0.2, quantity="height_change_at_A", unit="m"), row(0.5, quantity="t_B"),
        row(-0.3, quantity="height_change_at_halt", unit="m"), row(0.8, quantity="halting_time"),
    )  # fmt: skip
    assert figures.measured_drops(compared(measured=rows)) == [(0.3, 0.2), (0.8, 0.3)]
    second = (row(0.5, quantity="t_B"), row(-0.1, quantity="height_change_at_B", unit="m"))
    assert figures.measured_drops(compared(measured=second)) == [(0.5, 0.1)]
    assert figures.measured_drops(compared(measured=())) == []
    others = tuple(dataclasses.replace(r, index=2) for r in rows)
    assert figures.measured_drops(compared(measured=others)) == []


@pytest.mark.parametrize(
    ("text", "shown"),
    [("a" * 50, "a" * 50), ("a" * 51, "a" * 50 + "..."), ("$x$", r"\$x\$"), ("\ud800", "\\ud800")],
)
def test_a_long_name_is_cut_and_no_name_is_a_formula(text, shown):
    assert drawing.without_mathtext(text) == shown


@pytest.mark.parametrize(("count", "columns"), [(1, 1), (2, 2), (7, 3)])
def test_a_legend_has_no_more_columns_than_words(count, columns):
    figure, (axes,) = drawing.make_figure(4.0, 3.0)
    for k in range(count):
        axes.plot([0, 1], [k, k], label=str(k))
    drawing.legend_below(figure)
    (legend,) = figure.legends
    assert legend._ncols == columns
    assert [text.get_text() for text in legend.get_texts()] == [str(k) for k in range(count)]


def test_a_figure_without_words_has_no_legend():
    figure, axes = drawing.make_figure(4.0, 3.0, rows=(1, 3))
    drawing.legend_below(figure)
    assert figure.legends == []
    assert axes[0].get_subplotspec().get_gridspec().get_height_ratios() == (1, 3)
    assert list(figure.get_size_inches()) == [4.0, 3.0]


EARLY, LATE = PATH_END_TIMES


def ladder(values, halts=True, own=4e-4, rms=lambda v: 10 * v, limit_error=1e-4, spread=2e-5, unit="s"):
    rungs = [
        SimpleNamespace(
            value=v,
            run=SimpleNamespace(errors={EARLY: rms(v), LATE: rms(v) and 2 * rms(v), HALT: -3 * v if halts else None}),
            to_limit={EARLY: 0.5 * v, LATE: None},
        )
        for v in values
    ]
    verdicts = [
        SimpleNamespace(quantity=name, order=None, limit_error=limit_error, uncertainty=None) for name in (EARLY, LATE, HALT)
    ]
    made = SimpleNamespace(rungs=rungs, verdicts=verdicts, setting="step", unit=unit, own=own)
    v = SimpleNamespace(label="toy:chain", profile="quick", spread={EARLY: spread, LATE: spread, HALT: spread}, ladders=(made,))
    return v, made


STEPS = (8e-4, 4e-4, 2e-4)


def ladder_figure(v, made):
    return drawing.draw(convergence_plots.ladder_chart(v, made))


def lines(axes):
    return {line.get_label(): np.array(line.get_data()) for line in axes.lines}


def test_errors_along_a_ladder_are_in_millimetres_and_finer_is_to_the_right():
    figure = ladder_figure(*ladder(STEPS))
    top, below = figure.axes
    drawn = lines(top)
    np.testing.assert_allclose(drawn["from the reference, to 0.35 s"], [STEPS, [8, 4, 2]])
    np.testing.assert_allclose(drawn["from the reference, to 0.7 s"], [STEPS, [16, 8, 4]])
    np.testing.assert_allclose(drawn["from its own limit, to 0.35 s"], [STEPS, [0.4, 0.2, 0.1]])
    assert drawn["from its own limit, to 0.7 s"].shape == (2, 0)
    np.testing.assert_allclose(drawn["noise, to 0.7 s"][1], 0.02)
    assert [text.get_text() for text in top.texts] == ["its own setting"]
    np.testing.assert_allclose(lines(below)["halting time; band: twice its noise"], [STEPS, [-2.4, -1.2, -0.6]])
    (band,) = below.collections
    heights = {round(float(y), 6) for x, y in band.get_paths()[0].vertices if x == STEPS[0]}
    assert heights == {-2.44, -2.36}, "twice the spread of 0.02 ms to either side"
    assert below.get_xlim()[0] > below.get_xlim()[1]
    assert (below.get_xlabel(), below.get_xscale(), top.get_xlabel()) == ("step [s], finer to the right", "log", "")


def test_iterations_grow_to_the_right_and_have_no_unit():
    last = ladder_figure(*ladder((10, 20, 40), unit="")).axes[-1]
    assert last.get_xlim()[0] < last.get_xlim()[1]
    assert last.get_xlabel() == "step, finer to the right"


def test_a_ladder_without_any_halt_has_one_panel():
    figure = ladder_figure(*ladder(STEPS, halts=False))
    (axes,) = figure.axes
    assert axes.get_xlabel() == "step [s], finer to the right"
    assert figure.get_size_inches()[1] < ladder_figure(*ladder(STEPS)).get_size_inches()[1]


def test_a_setting_of_zero_or_less_has_no_place_on_a_log_axis():
    """A tolerance of 0 ends a ladder; -1 stands for "off" with some engines."""
    figure = ladder_figure(*ladder((4e-4, 2e-4, 0.0, -1.0)))
    assert len(lines(figure.axes[0])["from the reference, to 0.35 s"][0]) == 2
    assert len(figure.axes[1].lines[-1].get_xdata()) == 2
    assert figure.axes[1].get_xlim()[0] > figure.axes[1].get_xlim()[1]


def test_an_error_of_nothing_has_no_place_on_a_log_axis():
    drawn = lines(ladder_figure(*ladder(STEPS, rms=lambda v: 0.0 if v == 4e-4 else None)).axes[0])
    assert drawn["from the reference, to 0.35 s"].shape == (2, 0)


@pytest.mark.parametrize(("limit_error", "shown"), [(1e-4, True), (None, False)])
def test_the_distance_from_a_limit_is_drawn_where_there_is_one(limit_error, shown):
    drawn = lines(ladder_figure(*ladder(STEPS, limit_error=limit_error)).axes[0])
    assert ("from its own limit, to 0.35 s" in drawn) is shown


def test_without_a_spread_or_an_own_value_there_is_no_line_of_it():
    for spread in (None, 0.0):
        figure = ladder_figure(*ladder(STEPS, spread=spread, own=None))
        assert not [label for label in lines(figure.axes[0]) if "noise" in label]
        assert not figure.axes[0].texts
    figure = ladder_figure(*ladder(STEPS, spread=None))
    assert not figure.axes[1].collections


def test_the_limit_of_a_halting_time_is_a_band():
    v, made = ladder(STEPS)
    made.verdicts[2].limit_error, made.verdicts[2].uncertainty = 1e-4, 3e-4
    figure = ladder_figure(v, made)
    band = figure.axes[1].collections[-1].get_paths()[0].get_extents()
    assert (band.y0, band.y1) == (pytest.approx(-0.2), pytest.approx(0.4))
    made.verdicts[2].uncertainty = None
    assert len(ladder_figure(v, made).axes[1].collections) == 1, "that of the noise"


@pytest.mark.parametrize(
    ("values", "rms", "count"),
    [(STEPS, lambda v: v, 1), (STEPS[:2], lambda v: v, 1), (STEPS[:1], lambda v: v, 0), ((1e-3, 0.0), lambda v: v, 0),
     (STEPS, lambda v: None, 0), (STEPS, lambda v: v if v == 8e-4 else None, 0)],
)  # fmt: skip
def test_a_ladder_is_drawn_if_two_of_its_rungs_have_an_error(monkeypatch, values, rms, count):
    monkeypatch.setattr(convergence_plots, "png", lambda figure: b"")
    v, _ = ladder(values, rms=rms)
    figures = convergence_plots.draw(SimpleNamespace(variants=[v]))
    assert list(figures) == ["toy-chain-quick-step.png"] * count
    assert all(label == "toy:chain" and "as step is refined to the right" in caption for label, caption, _ in figures.values())
