"""Figures of a comparison. Reference black, one colour and line style per engine label, measurements as points with bars."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from looping_pendulum.compare.align import Aligned
from looping_pendulum.compare.metrics import DEPARTURE_THRESHOLDS
from looping_pendulum.compare.paper_table import PAPER_COLUMN, quantity_label
from looping_pendulum.compare.result import ComparisonResult, MeasuredRow, ResultSamples
from looping_pendulum.compare.trial import TrialComparison, distance
from looping_pendulum.compare.trial_table import RESIDUAL_UNITS
from looping_pendulum.compare.words import events_to_show
from looping_pendulum.files import optional_output
from looping_pendulum.pages.drawing import png, without_mathtext
from looping_pendulum.pages.palette import GREY, Style, styles

PRINTED_HALF_DIGIT = 0.005
"""Bars of the paper's values: half of the last digit printed, in s and in m; the paper states no uncertainty."""
MIN_DRAWN_DEVIATION = 1e-8
"""Deviations below this [m] are not drawn on the log axis: they would squeeze the visible ones."""
RESIDUAL_CAPTION = "Distance of each tracked point from what the reference and the engines predict for its time."
TRACKED: dict[str, Any] = {"ls": "none", "marker": "o", "ms": 3.2, "mfc": "white", "mec": "0.35", "mew": 0.8}
"""Appearance of tracked points: hollow and small, so that lines show through hundreds of them."""


def draw(result: ComparisonResult) -> dict[str, tuple[str, bytes]]:
    """Every figure that the result has data for: file name -> (caption, PNG)."""
    figures: dict[str, tuple[str, bytes]] = {}
    look = styles(e.label for e in result.engines)
    if result.samples is not None:
        panels: tuple[tuple[str, str, Callable[[ComparisonResult, ResultSamples, dict[str, Style]], Figure]], ...] = (
            ("path.png", "Path of the light mass around the rod (to scale); star: halt, cross: a run broke off.", path_figure),
            ("drop.png", "Drop of the heavy mass, and below it each engine's deviation from the reference.", drop_figure),
            (
                "divergence.png",
                "Distance of each engine's light mass from the reference's, and the reference's events.",
                divergence_figure,
            ),
        )
        for name, caption, make in panels:
            with optional_output(f"figures/{name}"):
                figures[name] = caption, png(make(result, result.samples, look))
    if result.samples is not None and result.trial is not None and result.trial.tracks:
        with optional_output("figures/residuals.png"):
            figures["residuals.png"] = RESIDUAL_CAPTION, png(residual_figure(result, result.samples, result.trial, look))
    if any(row.unit == "s" and row.measured is not None for row in result.measured):
        caption = f"Event times less the measured ones; grey bars: {bar_words(result)}."
        with optional_output("figures/events.png"):
            figures["events.png"] = caption, png(events_figure(result, look))
    return figures


def path_figure(result: ComparisonResult, samples: ResultSamples, look: dict[str, Style]) -> Figure:
    """Path of the light mass, equal axes."""
    figure, (axes,) = make_figure(7.0, 6.4)
    reference = samples.reference
    # Thick and behind, so that it shows on both sides of a run that follows it
    axes.plot(*reference.light_position.T, color="black", lw=2.4, label="reference", zorder=2)
    for aligned in _drawn(samples):
        style = look[aligned.run.label]
        axes.plot(*aligned.run.light_position.T, **_line(style), label=_name(aligned, result), zorder=3)
    tracked = None if result.trial is None else result.trial.light_positions()
    if tracked is not None:
        axes.plot(*tracked, **TRACKED, label="tracked points", zorder=2.5)
    radius = float(result.parameters["rod_radius"])
    axes.add_patch(Circle((0, 0), radius, facecolor="0.8", edgecolor="black", lw=0.8, zorder=4))
    _halts(axes, result, samples, look)
    _widen(axes)
    axes.set_aspect("equal")
    axes.set(xlabel="x [m]", ylabel="y [m]", title=f"{without_mathtext(result.scenario)}: path of the light mass")
    legend_below(figure)
    return figure


def _widen(axes: Axes) -> None:
    """Give a path that is nearly a line (a vertical drop) room to both sides."""
    spans = [(low, high) for low, high in (axes.get_xlim(), axes.get_ylim())]
    room = max(high - low for low, high in spans) / 2
    (x, width), (y, height) = [((low + high) / 2, max(high - low, room)) for low, high in spans]
    axes.set_xlim(x - width / 2, x + width / 2)
    axes.set_ylim(y - height / 2, y + height / 2)


def _halts(axes: Axes, result: ComparisonResult, samples: ResultSamples, look: dict[str, Style]) -> None:
    # The reference's star is larger and behind, so that both are seen where a run halts at the same place
    runs = [(samples.reference, result.reference.landmarks.halting_time, "black", 190.0, 5)]
    runs += [
        (a.run, e.landmarks.halting_time, look[e.label].colour, 70.0, 6)
        for a, e in zip(samples.aligned, result.engines, strict=True)
    ]
    for run, halt, colour, size, order in runs:
        if not run.status.ok and len(run.t):
            axes.plot(*run.light_position[-1], marker="x", ms=9, mew=2, color=colour, zorder=order)
        if halt is not None:
            x, y = (np.interp(halt, run.t, run.light_position[:, k]) for k in (0, 1))
            axes.scatter([x], [y], marker="*", s=size, color=colour, edgecolor="white", linewidth=0.6, zorder=order)


def drop_figure(result: ComparisonResult, samples: ResultSamples, look: dict[str, Style]) -> Figure:
    """Drop of the heavy mass against time, deviation panel below."""
    figure, (top, below) = make_figure(8.0, 6.8, rows=(3, 2))
    top.plot(samples.reference.t, samples.reference.heavy_drop, color="black", lw=2.4, label="reference", zorder=2)
    for aligned in _drawn(samples):
        line = _line(look[aligned.run.label])
        top.plot(aligned.t, aligned.run.heavy_drop, **line, label=_name(aligned, result), zorder=3)
        below.plot(aligned.t, -aligned.heavy_deviation * 1e3, **line, zorder=3)
    tracked = None if result.trial is None else result.trial.heavy_drops(samples.reference)
    if tracked is not None:
        top.plot(*tracked, **TRACKED, label="tracked points", zorder=2.5)
    points = measured_drops(result)
    if points:
        t, drop = zip(*points, strict=True)
        how = {"fmt": "o", "color": "black", "mfc": "white", "ms": 5, "capsize": 3}
        bar = PRINTED_HALF_DIGIT if result.trial is None else None
        top.errorbar(t, drop, xerr=bar, yerr=bar, label="measured", zorder=5, **how)  # type: ignore[arg-type]
    least, most = top.get_ylim()
    top.set_ylim(max(most, 0.01), min(least, -0.001))  # down is down; a clamped mass is drawn at rest, not as its rounding
    top.set(ylabel="drop of the heavy mass [m]", title=f"{without_mathtext(result.scenario)}: heavy mass")
    below.axhline(0, color="black", lw=1.2)
    below.set_yscale("symlog", linthresh=0.1)
    # At least twice the linear part of the axis, so that runs without a visible deviation are a flat line
    below.set_ylim(min(below.get_ylim()[0], -0.2), max(below.get_ylim()[1], 0.2))
    below.yaxis.set_major_formatter("{x:g}")
    below.set(xlabel="time since release [s]", ylabel="drop, engine less reference\n[mm] (linear within ±0.1)")
    legend_below(figure)
    return figure


def measured_drops(result: ComparisonResult) -> list[tuple[float, float]]:
    """Measured (time [s], drop [m]) of the heavy mass."""
    value = {(row.quantity, row.index): row.measured for row in result.measured}
    pairs = [("t_A", "height_change_at_A", -1), ("t_B", "height_change_at_B", -1)]
    pairs += [("halting_time", "height_change_at_halt", -1), ("halting_time", "drop_at_halt", 1)]
    readings = [(value.get((t, 1)), value.get((height, 1)), sign) for t, height, sign in pairs]
    return [(t, sign * height) for t, height, sign in readings if t is not None and height is not None]


def residual_figure(result: ComparisonResult, samples: ResultSamples, trial: TrialComparison, look: dict[str, Style]) -> Figure:
    """Distance of every tracked point from each run, one panel for each tracked body."""
    figure, panels = make_figure(8.0, 2.0 + 2.4 * len(trial.tracks), rows=(1,) * len(trial.tracks))
    for axes, comparison in zip(panels, trial.tracks, strict=True):
        track, unit = comparison.track, RESIDUAL_UNITS[comparison.track.unit]
        own = distance(track, samples.reference) * unit.per_si_unit
        for aligned in _drawn(samples):
            off = distance(track, aligned.run) * unit.per_si_unit
            label = _name(aligned, result) if axes is panels[0] else None
            axes.plot(track.t, off, **_line(look[aligned.run.label]), label=label, zorder=3)
        axes.plot(track.t, own, color="black", lw=2.0, label="reference" if axes is panels[0] else None, zorder=2)
        axes.set_yscale("log")
        axes.yaxis.set_major_formatter("{x:g}")
        axes.set_ylabel(f"{track.name}:\nresidual [{unit.name}]")
    panels[0].set_title(f"{without_mathtext(trial.name)}: measured less predicted")
    panels[-1].set_xlabel("time since release [s]")
    legend_below(figure)
    return figure


def divergence_figure(result: ComparisonResult, samples: ResultSamples, look: dict[str, Style]) -> Figure:
    """Distance from the reference's light mass on a log axis, with the reference's events."""
    figure, (axes,) = make_figure(8.0, 5.4)
    largest, smallest = DEPARTURE_THRESHOLDS[1], DEPARTURE_THRESHOLDS[0]
    for aligned in _drawn(samples):
        distance = np.where(aligned.distance > MIN_DRAWN_DEVIATION, aligned.distance, np.nan)
        # A line without any point still has its entry in the legend, which then says why none is seen
        seen = bool(np.isfinite(distance).any())
        label = _name(aligned, result) if seen else f"{_name(aligned, result)} (below {MIN_DRAWN_DEVIATION * 1e3:g} mm)"
        axes.plot(aligned.t, distance * 1e3, **_line(look[aligned.run.label]), label=label, zorder=3)
        if seen:
            largest = max(largest, float(np.nanmax(distance)))
            # Not the minimum: where a run crosses the reference, a single sample comes arbitrarily close to it
            smallest = min(smallest, float(np.nanpercentile(distance, 5)))
    for threshold in DEPARTURE_THRESHOLDS:
        axes.axhline(threshold * 1e3, color=GREY, lw=0.8, dashes=(1, 2))
    axes.set_yscale("log")
    axes.set_ylim(smallest * 1e3 / 2, largest * 1e3 * 2)
    axes.set_xlim(0, result.duration)
    axes.yaxis.set_major_formatter("{x:g}")
    for name, time in events_to_show(result.reference.events):
        if time <= result.duration:
            axes.axvline(time, color=GREY, lw=0.9, zorder=1)
            place, text = axes.get_xaxis_transform(), name.replace("_", " ")
            axes.text(time, 1.01, text, transform=place, rotation=40, ha="left", va="bottom", fontsize=8, color="0.25")
    axes.set(xlabel="time since release [s]", ylabel="distance from the reference's light mass [mm]")
    axes.set_title(f"{without_mathtext(result.scenario)}: divergence", pad=58)  # room for the events' names
    legend_below(figure)
    return figure


def events_figure(result: ComparisonResult, look: dict[str, Style]) -> Figure:
    """Event times less the measured ones."""
    rows = [row for row in result.measured if row.unit == "s" and row.measured is not None]
    figure, (axes,) = make_figure(8.0, 2.2 + 0.36 * len(rows))
    y = np.arange(len(rows), dtype=float)
    bars = [half_width(row) * 1e3 for row in rows]
    axes.errorbar(np.zeros(len(rows)), y, xerr=bars, fmt="none", ecolor="0.8", elinewidth=9, label="measured", zorder=1)
    axes.axvline(0, color="black", lw=0.8, zorder=1)

    def points(values: list[float | None], offset: float, label: str, **how: Any) -> None:
        cells = zip(values, rows, y, strict=True)
        known = [(1e3 * (v - r.measured), k) for v, r, k in cells if v is not None and r.measured is not None]
        if known:
            x, k = np.array(known).T
            axes.plot(x, k + offset, ls="none", label=label, **how)

    points([r.paper_numerical for r in rows], -0.3, PAPER_COLUMN, marker="s", mfc="white", mec="black", ms=5)
    points([r.reference for r in rows], -0.18, "reference", marker="o", color="black", ms=5)
    shown = [i for i in range(len(result.engines)) if any(r.engines[i] is not None for r in rows)]
    for place, i in enumerate(shown):
        engine = result.engines[i]
        style = look[engine.label]
        # Within its row each run has a height of its own, so that equal times do not hide each other
        offset = -0.04 + 0.36 * place / max(len(shown) - 1, 1)
        points(
            [r.engines[i] for r in rows],
            offset,
            without_mathtext(engine.label),
            marker=style.marker,
            color=style.colour,
            ms=4.5,
        )
    axes.set_yticks(y, [quantity_label(r.quantity, r.index) for r in rows])
    axes.invert_yaxis()
    axes.set_xscale("symlog", linthresh=20)
    # Setting ticks widens the limits to include them all
    limits = axes.get_xlim()
    axes.set_xticks([-500, -100, -20, -10, 0, 10, 20, 100, 500])
    axes.set_xlim(limits)
    axes.xaxis.set_major_formatter("{x:g}")
    axes.set(
        xlabel="time less measured time [ms] (linear within ±20)", title=f"{without_mathtext(result.scenario)}: event times"
    )
    legend_below(figure)
    return figure


def half_width(row: MeasuredRow) -> float:
    """Return the half-width [SI] of a measured value's bar: its standard error, or half of the last digit that is printed."""
    return PRINTED_HALF_DIGIT if row.sigma is None else row.sigma


def bar_words(result: ComparisonResult) -> str:
    """Say what the bars of the measured values are."""
    if all(row.sigma is None for row in result.measured):
        return "half of the last digit that the paper prints"
    return "standard error of the measured value"


def _drawn(samples: ResultSamples) -> list[Aligned]:
    return [a for a in samples.aligned if len(a.t) > 1]


def _name(aligned: Aligned, result: ComparisonResult) -> str:
    run = aligned.run
    return without_mathtext(
        next(result.short_name(e) for e in result.engines if (e.label, e.profile) == (run.label, run.profile))
    )


def _line(style: Style) -> dict[str, Any]:
    dashes: dict[str, Any] = {} if style.dashes == (1, 0) else {"dashes": style.dashes}
    return {"color": style.colour, "lw": 1.4, **dashes}


def make_figure(width: float, height: float, rows: tuple[int, ...] = (1,)) -> tuple[Figure, tuple[Axes, ...]]:
    """Make a figure [inches] of axes below each other, with the ratio of their heights."""
    figure = Figure(figsize=(width, height), dpi=130, layout="constrained")
    # Not by pyplot, which keeps every figure open and may look for a display
    FigureCanvasAgg(figure)
    grid = figure.subplots(len(rows), 1, squeeze=False, sharex=True, height_ratios=list(rows))
    for axes in grid[:, 0]:
        axes.grid(True, color="0.92", lw=0.6)
        axes.set_axisbelow(True)
    return figure, tuple(grid[:, 0])


def legend_below(figure: Figure, columns: int = 3) -> None:
    """Put one legend for all axes below the figure."""
    pairs = [pair for axes in figure.axes for pair in zip(*axes.get_legend_handles_labels(), strict=True)]
    if pairs:
        handles, labels = zip(*pairs, strict=True)
        figure.legend(
            handles, labels, loc="outside lower center", ncols=min(columns, len(pairs)), frameon=False, handlelength=3.2
        )
