"""The report as a page, made of the same result as report.md: its sections, and its figures to zoom and switch in."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from looping_pendulum.compare import report
from looping_pendulum.compare.align import Aligned
from looping_pendulum.compare.baseline import ResultChanges
from looping_pendulum.compare.metrics import DEPARTURE_THRESHOLDS
from looping_pendulum.compare.paper_table import PAPER_COLUMN, quantity_label
from looping_pendulum.compare.plots import (
    MIN_DRAWN_DEVIATION,
    PRINTED_HALF_DIGIT,
    RESIDUAL_CAPTION,
    bar_words,
    half_width,
    measured_drops,
)
from looping_pendulum.compare.result import ComparisonResult, EngineResult, ResultSamples
from looping_pendulum.compare.trial import TrialComparison, distance
from looping_pendulum.compare.trial_table import RESIDUAL_UNITS
from looping_pendulum.compare.words import events_to_show
from looping_pendulum.engines.trajectory import Trajectory
from looping_pendulum.pages import report as pages
from looping_pendulum.pages.figures import (
    INK,
    LINE,
    SOFT,
    SYMBOLS,
    Figure,
    escaped,
    horizontal,
    line,
    plain,
    points,
    run_colour,
    vertical,
)
from looping_pendulum.pages.glossary import glossary
from looping_pendulum.pages.palette import Style, styles
from looping_pendulum.reference_ode.geometry import Array

MAX_LINE_POINTS = 600
"""Most points of one line: a page with every variant stays below 6 MB."""
TIME = "time since release [s]"
MAX_SHOWN_DIFFERENCE = 50.0
"""Differences of event times that the figure shows at first [ms]; one that is further off would squeeze the others."""


def render(result: ComparisonResult, changes: ResultChanges | None = None, running: Sequence[str] = ()) -> str:
    """Return the page; ``changes`` since a baseline, if there is one, and the labels of engines that are still ``running``."""
    head, *sections = report.before_figures(result, changes)
    if running:
        head += f"\n**Still running:** {', '.join(running)}. This page is about the others; reload it for these.\n"
    return pages.render(
        f"{result.title}: engines against the reference",
        [head, *sections],
        figures(result),
        report.after_figures(result),
        glossary("comparison"),
        f"Lines join at most {MAX_LINE_POINTS} samples of a run; every number on this page comes from all of them.",
    )


def figures(result: ComparisonResult) -> list[Figure]:
    """Every figure that the result has data for."""
    look = styles(e.label for e in result.engines)
    page_figures: list[Figure] = []
    if result.samples is not None:
        shown = [(e, a, look[e.label]) for e, a in zip(result.engines, result.samples.aligned, strict=True) if len(a.t) > 1]
        page_figures += [make(result, result.samples, shown) for make in (path_figure, drop_figure, divergence_figure)]
        if result.trial is not None and result.trial.tracks:
            page_figures.append(residual_figure(result, result.samples, result.trial, shown))
    if any(row.unit == "s" and row.measured is not None for row in result.measured):
        page_figures.append(events_figure(result, look))
    return page_figures


Shown = list[tuple[EngineResult, Aligned, Style]]


def path_figure(result: ComparisonResult, samples: ResultSamples, shown: Shown) -> Figure:
    """Path of the light mass, equal axes."""
    traces = [_path("reference", samples.reference.light_position, None)]
    traces += [_path(_name(result, e), a.run.light_position, style) for e, a, style in shown]
    tracked = None if result.trial is None else result.trial.light_positions()
    if tracked is not None:
        traces.append(_tracked(*tracked))
    for e, a, style in shown:
        if e.landmarks.halting_time is not None:
            traces.append(_halt(a.run.t, a.run.light_position, e.landmarks.halting_time, run_colour(style), e.label, 12))
    halt = result.reference.landmarks.halting_time
    if halt is not None:
        traces.append(_halt(samples.reference.t, samples.reference.light_position, halt, INK, "reference", 18))
    radius = float(result.parameters["rod_radius"])
    box = {"x0": -radius, "x1": radius, "y0": -radius, "y1": radius}
    rod = {"type": "circle", "fillcolor": LINE, "line": {"color": SOFT}} | box
    return Figure(
        id="path",
        caption="Path of the light mass around the rod, to scale; star: where it was at the halt.",
        traces=tuple(traces),
        layout={
            "xaxis": {"title": {"text": "x [m]"}, "scaleanchor": "y", "constrain": "domain"},
            "yaxis": {"title": {"text": "y [m]"}, "constrain": "domain"},
            "shapes": [rod],
        },
        height=560,
    )


def drop_figure(result: ComparisonResult, samples: ResultSamples, shown: Shown) -> Figure:
    """Drop of the heavy mass against time, size of the engines' deviation below."""
    reference = samples.reference
    traces = [line("reference", _line(reference.t), _line(reference.heavy_drop), None)]
    for e, a, style in shown:
        name, times = _name(result, e), _line(a.t)
        traces.append(line(name, times, _line(a.run.heavy_drop), style, legendgroup=e.label))
        # NaN makes a gap in the line: a logarithmic axis cannot show zero
        off = np.where(np.abs(a.heavy_deviation) > MIN_DRAWN_DEVIATION, np.abs(a.heavy_deviation) * 1e3, np.nan)
        # One entry of the legend for both panels; a click on it hides the run in both
        traces.append(line(name, times, _line(off, 5), style, legendgroup=e.label, showlegend=False, yaxis="y2"))
    tracked = None if result.trial is None else result.trial.heavy_drops(reference)
    if tracked is not None:
        traces.append(_tracked(*tracked))
    measured = measured_drops(result)
    if measured:
        t, drop = zip(*measured, strict=True)
        bars = {"type": "constant", "value": PRINTED_HALF_DIGIT, "color": INK}
        more = {"error_x": bars, "error_y": bars} if result.trial is None else {}
        traces.append(points("measured", t, drop, INK, "circle-open", **more))
    return Figure(
        id="drop",
        caption="Drop of the heavy mass (down is down), and below it how far each engine is from the reference.",
        traces=tuple(traces),
        layout={
            # The time axis is drawn below the lower panel, y2
            "xaxis": {"title": {"text": TIME}, "anchor": "y2"},
            "yaxis": {"title": {"text": "drop [m]"}, "domain": [0.44, 1], "autorange": "reversed"},
            "yaxis2": {"title": {"text": "off the reference [mm]"}, "domain": [0, 0.38], "type": "log", "tickformat": "~g"},
        },
        height=560,
    )


def residual_figure(result: ComparisonResult, samples: ResultSamples, trial: TrialComparison, shown: Shown) -> Figure:
    """Distance of every tracked point from each run, one panel for each tracked body."""
    traces, rows = [], len(trial.tracks)
    lowest = "y" if rows == 1 else f"y{rows}"
    layout: dict[str, Any] = {"xaxis": {"title": {"text": TIME}, "anchor": lowest}, "showlegend": True}
    for i, comparison in enumerate(trial.tracks):
        track, unit = comparison.track, RESIDUAL_UNITS[comparison.track.unit]
        axis = "y" if i == 0 else f"y{i + 1}"
        layout[f"yaxis{'' if i == 0 else i + 1}"] = {
            "title": {"text": f"{track.name} [{unit.name}]"},
            "domain": [1 - (i + 0.92) / rows, 1 - i / rows],
            "type": "log",
            "tickformat": "~g",
        }
        t = plain(track.t)
        runs: list[tuple[str, str, Trajectory, Style | None]] = [("reference", "reference", samples.reference, None)]
        runs += [(_name(result, e), e.label, a.run, style) for e, a, style in shown]
        for name, group, run, style in runs:
            off = plain(distance(track, run) * unit.per_si_unit, 4)
            traces.append(line(name, t, off, style, legendgroup=group, showlegend=i == 0, yaxis=axis))
    return Figure(id="residuals", caption=RESIDUAL_CAPTION, traces=tuple(traces), layout=layout, height=180 + 210 * rows)


def divergence_figure(result: ComparisonResult, samples: ResultSamples, shown: Shown) -> Figure:
    """Distance from the reference's light mass on a log axis, with the reference's events."""
    traces = []
    for e, a, style in shown:
        distance = np.where(a.distance > MIN_DRAWN_DEVIATION, a.distance * 1e3, np.nan)
        traces.append(line(_name(result, e), _line(a.t), _line(distance, 5), style))
    events = [(name, time) for name, time in events_to_show(result.reference.events) if time <= result.duration]
    event_lines = [vertical(time, name.replace("_", " ")) for name, time in events]
    return Figure(
        id="divergence",
        caption="Distance of each engine's light mass from the reference's, with the reference's events; dotted: 1 mm, 10 mm.",
        traces=tuple(traces),
        layout={
            "xaxis": {"title": {"text": TIME}, "range": [0, result.duration]},
            "yaxis": {"title": {"text": "distance [mm]"}, "type": "log", "tickformat": "~g"},
            "shapes": [
                *(shape for shape, _ in event_lines),
                *(horizontal(1e3 * threshold) for threshold in DEPARTURE_THRESHOLDS),
            ],
            "annotations": [word for _, word in event_lines],
            # Room for the slanted names of the events
            "margin": {"t": 90},
            # Without it Plotly shows no legend for a single line
            "showlegend": True,
        },
        height=460,
    )


def events_figure(result: ComparisonResult, look: dict[str, Style]) -> Figure:
    """Event times less the measured ones."""
    rows = [row for row in result.measured if row.unit == "s" and row.measured is not None]
    names = [quantity_label(row.quantity, row.index) for row in rows]

    def less_measured(values: Iterable[float | None]) -> list[float | None]:
        pairs = zip(values, (row.measured for row in rows), strict=True)
        return [None if v is None or m is None else round(1e3 * (v - m), 3) for v, m in pairs]

    traces = [
        points("reference", less_measured(r.reference for r in rows), names, INK),
    ]
    if any(r.paper_numerical is not None for r in rows):
        numerical = less_measured(r.paper_numerical for r in rows)
        traces.insert(0, points(PAPER_COLUMN, numerical, names, INK, "square-open"))
    for i, engine in enumerate(result.engines):
        times = less_measured(r.engines[i] for r in rows)
        if any(time is not None for time in times):
            style = look[engine.label]
            traces.append(points(_name(result, engine), times, names, run_colour(style), SYMBOLS[style.marker]))
    off = [abs(x) for trace in traces for x in trace["x"] if x is not None]
    halves = [1e3 * half_width(row) for row in rows]
    reach = min(1.1 * max([*off, *halves]), MAX_SHOWN_DIFFERENCE)
    grey = {"type": "rect", "fillcolor": LINE, "opacity": 0.5, "line": {"width": 0}, "layer": "below"}
    if len(set(halves)) == 1:
        bars = [grey | {"x0": -halves[0], "x1": halves[0], "yref": "paper", "y0": 0, "y1": 1}]
    else:
        # On an axis of categories, row k reaches from k - 0.5 to k + 0.5
        bars = [grey | {"x0": -half, "x1": half, "y0": k - 0.5, "y1": k + 0.5} for k, half in enumerate(halves)]
    return Figure(
        id="events",
        caption=f"Event times less the measured ones; grey: {bar_words(result)}. "
        f"Events more than {MAX_SHOWN_DIFFERENCE:g} ms off show with Autoscale.",
        traces=tuple(traces),
        layout={
            "xaxis": {"title": {"text": "time less measured time [ms]"}, "range": [-reach, reach]},
            "yaxis": {"autorange": "reversed", "type": "category"},
            "shapes": bars,
        },
        height=200 + 26 * len(rows),
    )


def _tracked(x: Array, y: Array) -> dict[str, Any]:
    """Return the trace of tracked points, small and hollow, so that lines show through hundreds of them."""
    return points("tracked points", plain(x), plain(y), SOFT, marker={"color": SOFT, "symbol": "circle-open", "size": 5})


def _path(name: str, place: Array, style: Style | None) -> dict[str, Any]:
    return line(name, _line(place[:, 0]), _line(place[:, 1]), style)


def _halt(t: Array, place: Array, time: float, colour: str, label: str, size: int) -> dict[str, Any]:
    x, y = (round(float(np.interp(time, t, place[:, k])), 6) for k in (0, 1))
    mark = {"color": colour, "symbol": "star", "size": size, "line": {"color": SOFT, "width": 0.5}}
    return points(f"{escaped(label)} halts", [x], [y], colour, marker=mark, showlegend=False, legendgroup=escaped(label))


def _name(result: ComparisonResult, engine: EngineResult) -> str:
    return escaped(result.short_name(engine))


def _line(values: Array, digits: int = 6) -> list[float | None]:
    """Evenly thinned ``values`` to ``digits`` significant digits, None where they are not finite."""
    # Division that rounds up, so that there are never more points than allowed
    stride = -(-len(values) // MAX_LINE_POINTS)
    return plain(values[::stride], digits)
