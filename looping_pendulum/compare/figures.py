"""Figures of a comparison as data: report.md and report.html draw the same.

Reference black, one colour and line style per engine label, measurements as points with bars.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from looping_pendulum.compare.align import Aligned
from looping_pendulum.compare.deviation import DEPARTURE_THRESHOLDS, events_to_show
from looping_pendulum.compare.report import PAPER_COLUMN
from looping_pendulum.compare.result import ComparisonResult, MeasuredRow, ResultSamples
from looping_pendulum.compare.trial import RESIDUAL_UNITS, TrialComparison, distance
from looping_pendulum.engines.registry import styles
from looping_pendulum.pages.chart import (
    BLACK,
    LIGHT_GREY,
    Chart,
    ChartAxis,
    Curve,
    Guide,
    Panel,
    make_charts,
    reach,
    run_curve,
    tick,
    tracked_points,
    with_room,
)
from looping_pendulum.pages.palette import Style
from looping_pendulum.runs.events import quantity_label
from looping_pendulum.runs.trajectory import Trajectory

PRINTED_HALF_DIGIT = 0.005
"""Bars of the paper's values: half of the last digit printed, in s and in m; the paper states no uncertainty."""
MIN_DRAWN_DEVIATION = 1e-8
"""Deviations below this [m] are not drawn on the log axis: they would squeeze the visible ones."""
LINEAR_DROP, LINEAR_DELAY = 0.1, 20.0
"""Differences up to which their axes are linear: of drops [mm] and of event times [ms]."""
TIME = "time since release [s]"


def charts(result: ComparisonResult) -> list[Chart]:
    """Return every figure that the result has data for; one that cannot be made is left out with a warning."""
    makers: dict[str, Callable[[], Chart | None]] = {}
    if result.samples is not None:
        makers = {
            "path": partial(path_chart, result, result.samples),
            "drop": partial(drop_chart, result, result.samples),
            "divergence": partial(divergence_chart, result, result.samples),
        }
        if result.trial is not None and result.trial.tracks:
            makers["residuals"] = partial(residual_chart, result, result.samples, result.trial)
    if any(row.unit == "s" and row.measured is not None for row in result.measured):
        makers["events"] = partial(events_chart, result)
    return make_charts(makers)


def path_chart(result: ComparisonResult, samples: ResultSamples) -> Chart:
    """Return the path of the light mass, with halts and places where runs broke off."""
    reference, radius = samples.reference, result.parameters.rod_radius
    lines = [
        run_curve(name, run.light_position[:, 0], run.light_position[:, 1], style)
        for name, run, style in drawn_runs(result, samples)
    ]
    curves = lines[:1]
    tracked = None if result.trial is None else result.trial.light_positions()
    if tracked is not None:
        curves.append(tracked_points(*tracked))
    curves += lines[1:]
    box = [-radius, radius]
    x, y = with_room(reach([box, *(c.x for c in curves)]), reach([box, *(c.y for c in curves)]))
    # The reference's star is larger and behind, so that both are seen where a run halts at the same place
    curves += _marks(reference, result.reference.landmarks.halting_time, "reference", BLACK, 13.8)
    look = styles(e.label for e in result.engines)
    for engine, aligned in zip(result.engines, samples.aligned, strict=True):
        curves += _marks(aligned.run, engine.landmarks.halting_time, result.short_name(engine), look[engine.label].colour, 8.4)
    return Chart(
        id="path",
        caption="Path of the light mass around the rod (to scale); star: halt, cross: a run broke off.",
        subject=result.scenario,
        title="path of the light mass",
        x=ChartAxis(label="x [m]", limits=x),
        panels=[Panel(curves=curves, y=ChartAxis(label="y [m]", limits=y), disc=radius, to_scale=True)],
        size=(7.0, 6.4),
    )


def _marks(run: Trajectory, halt: float | None, label: str, colour: str, size: float) -> list[Curve]:
    """Return a cross where a run broke off, and a star where its light mass was at its halt."""
    marks = []
    if not run.status.ok and len(run.t):
        x, y = run.light_position[-1:].T
        marks.append(Curve(label=f"{label} broke off", x=x, y=y, colour=colour, marker="x", size=9, in_legend=False))
    if halt is not None:
        x, y = (np.array([np.interp(halt, run.t, values)]) for values in run.light_position.T)
        marks.append(Curve(label=f"{label} halts", x=x, y=y, colour=colour, marker="*", size=size, in_legend=False))
    return marks


def drop_chart(result: ComparisonResult, samples: ResultSamples) -> Chart:
    """Return the drop of the heavy mass against time, and each engine's deviation below it."""
    reference = samples.reference
    top = [run_curve("reference", reference.t, reference.heavy_drop, None)]
    tracked = None if result.trial is None else result.trial.heavy_drops(reference)
    if tracked is not None:
        top.append(tracked_points(*tracked))
    below = []
    for name, aligned, style in _drawn(result, samples):
        top.append(run_curve(name, aligned.t, aligned.run.heavy_drop, style))
        below.append(run_curve(name, aligned.t, -aligned.heavy_deviation * 1e3, style, in_legend=False))
    seen = [curve.y for curve in top]
    points = measured_drops(result)
    if points:
        bar = PRINTED_HALF_DIGIT if result.trial is None else None
        t, drops = np.array(points).T
        top.append(Curve(label="measured", x=t, y=drops, marker="o", hollow=True, bar=bar))
        seen += [drops - (bar or 0.0), drops + (bar or 0.0)]
    least, most = reach(seen)
    # At least twice the linear part of the axis, so that runs without a visible deviation are a flat line
    lowest, highest = reach([[-2 * LINEAR_DROP, 2 * LINEAR_DROP], *(curve.y for curve in below)])
    return Chart(
        id="drop",
        caption="Drop of the heavy mass, and below it each engine's deviation from the reference.",
        subject=result.scenario,
        title="heavy mass",
        x=ChartAxis(label=TIME),
        panels=[
            # Down is down; a clamped mass is drawn at rest, not as its rounding
            Panel(
                curves=top,
                y=ChartAxis(label="drop of the heavy mass [m]", limits=(max(most, 0.01), min(least, -0.001))),
                height=3,
            ),
            Panel(
                curves=below,
                y=ChartAxis(
                    label=f"drop, engine less reference\n[mm] (linear within ±{LINEAR_DROP:g})",
                    scale="symlog",
                    linear_to=LINEAR_DROP,
                    limits=(lowest, highest),
                ),
                guides=[Guide(y=0.0, colour=BLACK)],
                height=2,
            ),
        ],
        size=(8.0, 6.8),
    )


def measured_drops(result: ComparisonResult) -> list[tuple[float, float]]:
    """Return measured (time [s], drop [m]) of the heavy mass."""
    value = {(row.quantity, row.index): row.measured for row in result.measured}
    pairs = [("t_A", "height_change_at_A", -1), ("t_B", "height_change_at_B", -1)]
    pairs += [("halting_time", "height_change_at_halt", -1), ("halting_time", "drop_at_halt", 1)]
    readings = [(value.get((t, 1)), value.get((height, 1)), sign) for t, height, sign in pairs]
    return [(t, sign * height) for t, height, sign in readings if t is not None and height is not None]


def divergence_chart(result: ComparisonResult, samples: ResultSamples) -> Chart:
    """Return the distance from the reference's light mass on a log axis, with the reference's events."""
    curves = []
    smallest, largest = DEPARTURE_THRESHOLDS
    for name, aligned, style in _drawn(result, samples):
        apart = np.where(aligned.distance > MIN_DRAWN_DEVIATION, aligned.distance, np.nan)
        if np.isfinite(apart).any():
            largest = max(largest, float(np.nanmax(apart)))
            # Not the minimum: where a run crosses the reference, a single sample comes arbitrarily close to it
            smallest = min(smallest, float(np.nanpercentile(apart, 5)))
        else:  # a line without any point still has its entry in the legend, which then says why none is seen
            name = f"{name} (below {MIN_DRAWN_DEVIATION * 1e3:g} mm)"
        curves.append(run_curve(name, aligned.t, apart * 1e3, style))
    events = [(name, time) for name, time in events_to_show(result.reference.events) if time <= result.duration]
    guides = [Guide(y=threshold * 1e3, dotted=True) for threshold in DEPARTURE_THRESHOLDS]
    limits = (smallest * 1e3 / 2, largest * 1e3 * 2)
    return Chart(
        id="divergence",
        caption="Distance of each engine's light mass from the reference's, and the reference's events.",
        subject=result.scenario,
        title="divergence",
        x=ChartAxis(label=TIME, limits=(0.0, result.duration)),
        panels=[
            Panel(
                curves=curves,
                y=ChartAxis(label="distance from the reference's light mass [mm]", scale="log", limits=limits),
                guides=[*guides, *(Guide(x=time, text=name.replace("_", " ")) for name, time in events)],
            )
        ],
        size=(8.0, 5.4),
    )


def residual_chart(result: ComparisonResult, samples: ResultSamples, trial: TrialComparison) -> Chart:
    """Return the distance of every tracked point from each run, one panel for each tracked body."""
    panels: list[Panel] = []
    for comparison in trial.tracks:
        track, unit = comparison.track, RESIDUAL_UNITS[comparison.track.unit]
        curves = [
            run_curve(name, np.array(track.t), distance(track, run) * unit.per_si_unit, style, in_legend=not panels)
            for name, run, style in drawn_runs(result, samples)
        ]
        panels.append(Panel(curves=curves, y=ChartAxis(label=f"{track.name}:\nresidual [{unit.name}]", scale="log")))
    return Chart(
        id="residuals",
        caption="Distance of each tracked point from what the reference and the engines predict for its time.",
        subject=trial.name,
        title="measured less predicted",
        x=ChartAxis(label=TIME),
        panels=panels,
        size=(8.0, 2.0 + 2.4 * len(panels)),
    )


def events_chart(result: ComparisonResult) -> Chart:
    """Return event times less the measured ones."""
    rows = [row for row in result.measured if row.unit == "s" and row.measured is not None]
    bars = np.array([half_width(row) * 1e3 for row in rows])
    ends, at = np.column_stack([-bars, bars]).ravel(), np.repeat(np.arange(len(rows)), 2)
    curves = [Curve(label="measured", x=ends, y=at, colour=LIGHT_GREY, width=9, in_pairs=True)]

    def add(label: str, values: Sequence[float | None], offset: float, marker: str, **look: Any) -> None:
        cells = [(v, row.measured, k + offset) for k, (v, row) in enumerate(zip(values, rows, strict=True))]
        known = [(1e3 * (v - measured), place) for v, measured, place in cells if v is not None and measured is not None]
        if known:
            x, y = np.array(known).T
            curves.append(Curve(label=label, x=x, y=y, marker=marker, **look))

    add(PAPER_COLUMN, [r.paper_numerical for r in rows], -0.3, marker="s", hollow=True)
    add("reference", [r.reference for r in rows], -0.18, marker="o")
    look = styles(e.label for e in result.engines)
    shown = [i for i in range(len(result.engines)) if any(r.engines[i] is not None for r in rows)]
    for place, i in enumerate(shown):
        style = look[result.engines[i].label]
        # Within its row each run has a height of its own, so that equal times do not hide each other
        offset = -0.04 + 0.36 * place / max(len(shown) - 1, 1)
        name = result.short_name(result.engines[i])
        add(name, [r.engines[i] for r in rows], offset, marker=style.marker, colour=style.colour, size=4.5)
    furthest = 1.1 * max(float(np.nanmax(np.abs(curve.x))) for curve in curves)
    printed = all(row.sigma is None for row in result.measured)
    meaning = "half of the last digit that the paper prints" if printed else "standard error of the measured value"
    numbers = (-500, -100, -LINEAR_DELAY, -10, 0, 10, LINEAR_DELAY, 100, 500)
    return Chart(
        id="events",
        caption=f"Event times less the measured ones; grey bars: {meaning}.",
        subject=result.scenario,
        title="event times",
        x=ChartAxis(
            label=f"time less measured time [ms] (linear within ±{LINEAR_DELAY:g})",
            scale="symlog",
            linear_to=LINEAR_DELAY,
            limits=(-furthest, furthest),
            ticks={value: tick(value) for value in numbers},
        ),
        panels=[
            Panel(
                curves=curves,
                y=ChartAxis(
                    limits=(len(rows) - 0.5, -0.5),
                    ticks={k: quantity_label(row.quantity, row.index) for k, row in enumerate(rows)},
                ),
                guides=[Guide(x=0.0, colour=BLACK)],
            )
        ],
        size=(8.0, 2.2 + 0.36 * len(rows)),
    )


def half_width(row: MeasuredRow) -> float:
    """Return the half-width [SI] of a measured value's bar: its standard error, or half of the last digit that is printed."""
    return PRINTED_HALF_DIGIT if row.sigma is None else row.sigma


def drawn_runs(result: ComparisonResult, samples: ResultSamples) -> list[tuple[str, Trajectory, Style | None]]:
    """Return name, motion and style of the reference, which has none, and of each engine whose run makes a line."""
    return [("reference", samples.reference, None), *((name, a.run, style) for name, a, style in _drawn(result, samples))]


def _drawn(result: ComparisonResult, samples: ResultSamples) -> list[tuple[str, Aligned, Style]]:
    """Return name, run and style of each engine whose run makes a line."""
    look = styles(e.label for e in result.engines)
    pairs = zip(result.engines, samples.aligned, strict=True)
    return [(result.short_name(e), a, look[e.label]) for e, a in pairs if len(a.t) > 1]
