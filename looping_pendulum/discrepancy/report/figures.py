"""The figures of a report: each drawn by Matplotlib for report.md, and beside it the same as data for the page.

The first is how far one trial is from the declared and from the repaired model. Where a mass's position was tracked, it is the
motion with the residual of every point as a line, magnified; otherwise it is the residual against time. The trial is the one
that the verdict's sentence speaks of.
"""

from __future__ import annotations

import math
import textwrap
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from looping_pendulum.compare.landmarks import quantity_label
from looping_pendulum.discrepancy.first_look.check import DeclarationCheck, TrialCheck
from looping_pendulum.discrepancy.first_look.misfit import Distance
from looping_pendulum.discrepancy.report.markdown import EVENTS, MOTION, SIDES, off_by, probability_in_words
from looping_pendulum.discrepancy.result import Identification, RankedExplanation, TrialFigure, Unlisted
from looping_pendulum.discrepancy.verdict_sentence import BODY_IN_WORDS, worst_trial
from looping_pendulum.files import file_stems, optional_output
from looping_pendulum.measured.observations import BODIES, UNITS
from looping_pendulum.pages.drawing import MAX_LABEL_LENGTH, new_figure, png, without_mathtext
from looping_pendulum.pages.figures import INK, LINE, SOFT, Figure, band, escaped, horizontal, plain, points
from looping_pendulum.pages.palette import COLOURS, GREY
from looping_pendulum.reference_ode.geometry import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Drawing

MODELS = (("before", "declared model"), ("after", "repaired model"))
"""Field of a figure's arrays and label of each model."""
ON_PAPER = {"before": COLOURS[1], "after": COLOURS[0]}
"""Field of the model -> its colour in a picture."""
ON_PAGE = {"before": "var(--run-1)", "after": "var(--run-0)"}
"""The same on a page, by its style."""
VECTOR_SHARE = 0.1
"""Length of the declared model's RMS residual in the picture, as a share of the motion's size; no magnification exceeds it."""
SHOWN_UNITS = {"m": (("mm", 1e3), ("m", 1.0)), "rad": (("mrad", 1e3), ("deg", 180 / math.pi)), "rad/s": (("rad/s", 1.0),) * 2}
"""SI unit of a channel -> unit and its number per SI unit for small residuals, and for those of `LARGE` and above."""
LARGE = 0.1
"""RMS residual [SI] above which the larger unit is used."""
CLOCK = "time by the file's clock [s]"
AXIS_LIMIT = 15.0
"""Largest residual of an event on the axis [standard errors]; larger ones and events that do not happen are drawn there."""
MAX_LINES, LABEL_WIDTH = 5, 28
"""Lines of an explanation's name in a figure, and characters in a line of it on the page: half of a phone's width."""
EXPLANATIONS_CAPTION = (
    "How much more probable each explanation is than that nothing is missing, in powers of ten; blue: together these have 95 % "
    "of the probability."
)
UNLISTED_CAPTION = "The unlisted force along its coordinate; bands: two standard errors."
FIRST_LOOK = "first-look.png"
"""File name of the picture of a first look."""
FIRST_LOOK_CAPTION = (
    "Tracked points of the first part of each trial, and the motion that the study declares (lines), before anything is fitted."
)
MAX_TRIALS = 4
"""Largest number of trials that are shown of a first look."""
PANEL = 3.4
"""Width and height of one of its panels [inches]."""
AXES = {True: ("x [m]", "y [m]"), False: (CLOCK, "measured [SI]")}
"""Whether a path is shown -> titles of its axes."""


def draw(result: Identification) -> dict[str, tuple[str, bytes]]:
    """Return all figures for report.md: file name -> (caption, PNG)."""
    drawings: list[tuple[str, str, Callable[[], Drawing]]] = []
    if result.trial_figures:
        drawings.append((MOTION, motion_caption(result), partial(draw_motion, result)))
    stems = file_stems([("trial", picture.trial) for picture in result.trial_figures])
    for picture, stem in zip(result.trial_figures, stems, strict=True):
        caption = f"{_in_words(picture)}: tracked points and both models; below, residuals in units of noise (band: 2)."
        drawings.append((f"{stem}.png", caption, partial(draw_trial, picture)))
    if result.events:
        caption = "Measured less predicted events in units of their standard errors (band: 2); crosses: they do not happen."
        drawings.append((EVENTS, caption, partial(draw_events, result)))
    if len(result.explanations) > 1:
        drawings.append(("explanations.png", EXPLANATIONS_CAPTION, partial(draw_explanations, result)))
    if result.unlisted is not None:
        drawings.append(("unlisted-force.png", UNLISTED_CAPTION, partial(draw_unlisted, result.unlisted)))
    drawings.append(("errors.png", "Error of each trial before and after, in units of noise.", partial(draw_errors, result)))
    figures: dict[str, tuple[str, bytes]] = {}
    for name, caption, make in drawings:
        with optional_output(f"figures/{name}"):
            figures[name] = caption, png(make())
    if result.first_look is not None and result.first_look.notes:
        with optional_output(f"figures/{FIRST_LOOK}"):
            image = draw_first_look(result.first_look)
            if image is not None:
                figures[FIRST_LOOK] = FIRST_LOOK_CAPTION, image
    return figures


def first_on_page(result: Identification) -> list[Figure]:
    """Return the figures that stand directly below the verdict: the motion or, if nothing was tracked, the events."""
    if result.trial_figures:
        return motion_on_page(result)
    return [events_on_page(result)] if result.events else []


def on_page(result: Identification) -> list[Figure]:
    """Return every figure of the page that the result has data for, but for the first."""
    look = result.first_look
    shown = first_look_on_page(look) if look is not None and look.notes else None
    charts = [] if shown is None else [shown]
    charts += [errors_on_page(result)] if result.errors else []
    charts += [trial_on_page(picture, i) for i, picture in enumerate(result.trial_figures)]
    if result.events and result.trial_figures:  # without these it stands below the verdict
        charts.append(events_on_page(result))
    if len(result.explanations) > 1:
        charts.append(explanations_on_page(result))
    if result.unlisted is not None:
        charts.append(unlisted_on_page(result.unlisted))
    return charts


def _models(result: Identification) -> tuple[tuple[str, str], ...]:
    """Return those of `MODELS` that differ."""
    return MODELS if result.has_repair else MODELS[:1]


def _lines(**more: Any) -> dict[str, Any]:
    """Return the trace of a line on the page."""
    return {"type": "scatter", "mode": "lines"} | more


# The motion, or residuals over time, of the trial that the verdict speaks of


@dataclass(frozen=True, kw_only=True, eq=False)
class ResidualVectors:
    """Residuals of a tracked mass as lines from the model to the points."""

    path: Array
    """Positions by the model [m], shape (n, 2)."""
    tips: Array
    """The model's position plus the magnified residual [m], shape (n, 2)."""

    @property
    def with_gaps(self) -> tuple[Array, Array]:
        """Return x and y of all lines as one, with a gap (NaN) after each."""
        joined = np.stack([self.path, self.tips, np.full_like(self.path, np.nan)], axis=1).reshape(-1, 2)
        return joined[:, 0], joined[:, 1]


def shown_trial(result: Identification) -> TrialFigure:
    """Return the trial to show: the one that the verdict's sentence speaks of, or else the first that was tracked."""
    name = worst_trial(result.errors).trial
    return next((p for p in result.trial_figures if p.trial == name), result.trial_figures[0])


def tracked_body(picture: TrialFigure) -> str | None:
    """Return the body whose position was tracked in both directions, the light mass first; None: there is none."""
    return next((b for b, names in BODIES.items() if len(names) == 2 and set(names) <= set(picture.channels)), None)


def residual_vectors(picture: TrialFigure, body: str) -> tuple[dict[str, ResidualVectors], float]:
    """Return field of the model ("before", "after") -> residual vectors, and the factor by which they are magnified.

    The factor is one of 1, 2, 5, 10, 20, ...
    """
    x, y = BODIES[body]
    _, ix, iy = np.intersect1d(picture.t[x], picture.t[y], return_indices=True)
    used = ~(picture.outliers[x][ix] | picture.outliers[y][iy])
    ix, iy = ix[used], iy[used]

    def both(values: Mapping[str, Array]) -> Array:
        return np.column_stack([values[x][ix], values[y][iy]])

    measured = both(picture.measured)
    paths = {side: both(getattr(picture, side)) for side, _ in MODELS}
    size = float(np.max(np.ptp(measured, axis=0), initial=0.0))
    rms = float(np.sqrt(np.mean(np.sum((measured - paths["before"]) ** 2, axis=1)))) if len(measured) else 0.0
    factor = 1.0
    if rms > 0 and (largest := VECTOR_SHARE * size / rms) >= 1:
        power = 10.0 ** math.floor(math.log10(largest))
        factor = power * max(step for step in (1, 2, 5) if step * power <= largest)
    return {side: ResidualVectors(path=path, tips=path + factor * (measured - path)) for side, path in paths.items()}, factor


def _residuals_over_time(picture: TrialFigure, channel: str) -> tuple[dict[str, Array], str]:
    """Return field of the model -> measured less predicted values without outliers, and their unit."""
    raw = {
        side: np.where(picture.outliers[channel], np.nan, picture.measured[channel] - getattr(picture, side)[channel])
        for side, _ in MODELS
    }
    size = float(np.sqrt(np.nanmean(raw["before"] ** 2)))
    unit, per_si = SHOWN_UNITS[UNITS[channel]][size > LARGE]
    return {side: per_si * values for side, values in raw.items()}, unit


def motion_caption(result: Identification) -> str:
    """Return what the picture shows."""
    picture = shown_trial(result)
    if tracked_body(picture) is not None:
        beside = " Left: the declared model; right: the repaired one." if result.has_repair else ""
        return f"{_vectors_in_words(picture)}{beside}"
    several = "the declared and the repaired model" if result.has_repair else "the declared model"
    role = "held-out trial" if picture.held_out else "trial"
    return f"Measured less predicted by {several}, in the {role} {picture.trial}. A right model leaves only scatter about 0."


def _vectors_in_words(picture: TrialFigure) -> str:
    body = tracked_body(picture)
    assert body is not None
    _, factor = residual_vectors(picture, body)
    longer = f", drawn {factor:g} times as long as it is" if factor > 1 else ""
    role = "held-out trial" if picture.held_out else "trial"
    return (
        f"Motion of the {BODY_IN_WORDS[body]} in the {role} {picture.trial}. Each line leads from the model to the tracked "
        f"point{longer}. A right model leaves lines in all directions; where neighbouring lines point the same way, it is off."
    )


def draw_motion(result: Identification) -> Drawing:
    """Draw the motion with residual vectors, or the residuals over time."""
    picture, shown = shown_trial(result), _models(result)
    body = tracked_body(picture)
    if body is None:
        drawing = new_figure(8.0, 1.0 + 2.6 * len(picture.channels))
        panels = drawing.subplots(len(picture.channels), 1, sharex=True, squeeze=False)[:, 0]
        for axes, channel in zip(panels, picture.channels, strict=True):
            residuals, unit = _residuals_over_time(picture, channel)
            axes.axhline(0, color=GREY, lw=0.8)
            for side, label in shown:
                axes.plot(picture.t[channel], residuals[side], ".-", lw=0.8, ms=4, color=ON_PAPER[side], label=label)
            axes.set_ylabel(f"{without_mathtext(channel)}: measured\nless predicted [{unit}]")
        panels[0].legend(fontsize=9)
        panels[-1].set_xlabel(CLOCK)
        return drawing
    vectors, factor = residual_vectors(picture, body)
    ends = np.concatenate([vectors[side].tips for side, _ in shown])
    width, height = np.maximum(np.ptp(ends, axis=0), 1e-9)
    drawing = new_figure(4.8 * len(shown), 1.0 + min(max(4.2 * height / width, 2.0), 5.0))
    panels = drawing.subplots(1, len(shown), sharex=True, sharey=True, squeeze=False)[0]
    for axes, (side, label) in zip(panels, shown, strict=True):
        v = vectors[side]
        axes.plot(*v.with_gaps, "-", lw=0.8, color=ON_PAPER[side])
        axes.plot(v.path[:, 0], v.path[:, 1], "-", lw=1.2, color="black")
        axes.set_title(label + (f" (residuals x {factor:g})" if factor > 1 else ""), fontsize=10)
        axes.set_aspect("equal", adjustable="box")
        axes.set_xlabel("x [m]")
    panels[0].set_ylabel("y [m]")
    return drawing


def motion_on_page(result: Identification) -> list[Figure]:
    """Return the same for the page, of a motion one figure for each model."""
    picture, shown = shown_trial(result), _models(result)
    body = tracked_body(picture)
    if body is None:
        return [_residuals_on_page(result, picture)]
    vectors, factor = residual_vectors(picture, body)
    # The same square for all, so that they can be compared: a margin of 5 % around everything
    ends = np.concatenate([part for side, _ in shown for part in (vectors[side].path, vectors[side].tips)])
    centre, half = (ends.max(axis=0) + ends.min(axis=0)) / 2, 0.55 * float(np.max(np.ptp(ends, axis=0)))
    axis = [{"range": plain([c - half, c + half]), "title": {"text": f"{n} [m]"}} for n, c in zip("xy", centre, strict=True)]
    charts = []
    for i, (side, label) in enumerate(shown):
        v = vectors[side]
        x, y = map(plain, v.with_gaps)
        style = {"color": ON_PAGE[side], "width": 1}
        vector_lines = _lines(x=x, y=y, name="residuals", hoverinfo="skip", showlegend=False, line=style)
        x, y = map(plain, v.path.T)
        path = _lines(x=x, y=y, name=label, showlegend=False, line={"color": INK, "width": 1.5})
        # On the left and in two lines: the buttons of Plotly are on the right, and a phone is narrow
        title = label + (f"<br>(residuals x {factor:g})" if factor > 1 else "")
        charts.append(
            Figure(
                id=f"motion-{i}",
                caption=f"{label.capitalize()}" + (f". {_vectors_in_words(picture)}" if i == 0 else ", drawn in the same way."),
                traces=(vector_lines, path),
                layout={
                    "title": {"text": title, "font": {"size": 14}, "x": 0.0, "xanchor": "left"},
                    "xaxis": axis[0] | {"constrain": "domain"},
                    "yaxis": axis[1] | {"scaleanchor": "x", "constrain": "domain"},
                    "margin": {"t": 40, "b": 50},
                },
            )
        )
    return charts


def _residuals_on_page(result: Identification, picture: TrialFigure) -> Figure:
    traces: list[dict[str, Any]] = []
    layout: dict[str, Any] = {"shapes": []}
    count = len(picture.channels)
    for i, channel in enumerate(picture.channels):
        residuals, unit = _residuals_over_time(picture, channel)
        axis = "y" if i == 0 else f"y{i + 1}"
        layout[f"yaxis{i + 1 if i else ''}"] = {
            "title": {"text": f"{escaped(channel)} [{unit}]"}, "domain": [1 - (i + 0.9) / count, 1 - i / count]
        }  # fmt: skip
        layout["shapes"].append(horizontal(0, axis))
        for side, label in _models(result):
            colour = ON_PAGE[side]
            t, values = plain(picture.t[channel]), plain(residuals[side], 4)
            traces.append(points(label, t, values, colour, marker={"color": colour, "size": 6}, mode="lines+markers",
                                 yaxis=axis, line={"color": colour, "width": 1}, showlegend=i == 0))  # fmt: skip
    layout["xaxis"] = {"title": {"text": CLOCK}, "anchor": f"y{count}" if count > 1 else "y"}
    return Figure(id="motion-0", caption=motion_caption(result), traces=tuple(traces), layout=layout, height=160 + 220 * count)


# Errors of all trials


def draw_errors(result: Identification) -> Drawing:
    """Draw each trial's error before and after as bars."""
    figure = new_figure(7.0, 3.2)
    axes = figure.subplots()
    at = np.arange(len(result.errors))
    axes.bar(at - 0.2, [e.standardised_rms_before for e in result.errors], 0.4, color=ON_PAPER["before"], label="declared")
    axes.bar(at + 0.2, [e.standardised_rms_after for e in result.errors], 0.4, color=ON_PAPER["after"], label="repaired")
    axes.axhline(1, color="black", lw=0.8, ls=":")
    axes.set_xticks(at, [without_mathtext(e.trial) + (" (held out)" if e.held_out else "") for e in result.errors])
    axes.set_ylabel("RMS [noise]")
    axes.legend(fontsize=8)
    return figure


def errors_on_page(result: Identification) -> Figure:
    """Return the same for the page."""
    names = [escaped(e.trial) + (" (held out)" if e.held_out else "") for e in result.errors]
    traces = []
    for side, label in _models(result):
        sizes = plain(getattr(e, f"standardised_rms_{side}") for e in result.errors)
        traces.append({"type": "bar", "name": label, "x": names, "y": sizes, "marker": {"color": ON_PAGE[side]}})
    return Figure(
        id="errors",
        caption="Error of each trial before and after, in units of noise: 1 (dotted) is the best possible.",
        traces=tuple(traces),
        layout={
            "yaxis": {"title": {"text": "RMS [noise]"}, "rangemode": "tozero"},
            "xaxis": {"type": "category"},
            "shapes": [horizontal(1)],
        },
    )


# One trial: points, both models, residuals


def _in_words(picture: TrialFigure) -> str:
    return f"Trial {picture.trial} ({'held out' if picture.held_out else 'training'})"


def draw_trial(picture: TrialFigure) -> Drawing:
    """Draw tracked points and both models of one trial over time, and the residuals of each channel."""
    count = len(picture.channels)
    figure = new_figure(9.0, 3.2 + 1.3 * count)
    axes = figure.subplots(1 + count, 1, sharex=True, height_ratios=[2.4, *[1.0] * count])
    for i, name in enumerate(picture.channels):
        t = picture.t[name]
        colour = COLOURS[i % len(COLOURS)]
        axes[0].plot(t, picture.measured[name], ".", ms=2.5, color=colour, label=name)
        is_outlier = picture.outliers[name]
        axes[0].plot(t[is_outlier], picture.measured[name][is_outlier], "x", ms=5, mew=1.2, color=colour)
        axes[0].plot(t, picture.before[name], "--", lw=0.9, color=GREY)
        axes[0].plot(t, picture.after[name], "-", lw=0.9, color="black")
        axes[1 + i].axhspan(-2, 2, color="0.92")
        axes[1 + i].plot(t, picture.residual_before[name], ".", ms=3, color=ON_PAPER["before"], label="declared")
        axes[1 + i].plot(t, picture.residual_after[name], ".", ms=3, color=ON_PAPER["after"], label="repaired")
        axes[1 + i].set_ylabel(name, fontsize=8)
    axes[0].set_ylabel("measured [SI]")
    axes[0].legend(loc="best", fontsize=8, ncols=count)
    axes[0].set_title(
        "points: tracked; crosses: outliers, left out; dashed grey: declared model; black: repaired model", fontsize=9
    )
    axes[1].legend(loc="upper left", fontsize=8, ncols=2)
    axes[-1].set_xlabel(CLOCK)
    return figure


def trial_on_page(picture: TrialFigure, index: int) -> Figure:
    """Return the same for the page."""
    rows = len(picture.channels)
    # In heights of a residual panel: the upper one is 2.2 tall, with a gap of 0.2 below
    tall = 1.0 / (rows + 2.4)
    layout: dict[str, Any] = {
        "xaxis": {"title": {"text": CLOCK}, "anchor": f"y{rows + 1}"},
        "yaxis": {"title": {"text": "measured [SI]"}, "domain": [1 - 2.2 * tall, 1]},
        "shapes": [],
        # Otherwise the legend shows the points as small as the figure does
        "legend": {"itemsizing": "constant"},
    }
    traces: list[dict[str, Any]] = []
    model_lines = {
        "before": {"color": SOFT, "width": 1.3, "dash": "6px,3px"},
        "after": {"color": INK, "width": 1.3, "dash": "solid"},
    }
    for i, channel in enumerate(picture.channels):
        t, axis, name = plain(picture.t[channel]), f"y{i + 2}", escaped(channel)
        top = 1 - 2.4 * tall - i * tall
        layout[f"yaxis{i + 2}"] = {"title": {"text": name}, "domain": [top - 0.85 * tall, top]}
        layout["shapes"].append(band(-2, 2, axis))
        colour = f"var(--run-{i % len(COLOURS)})"
        point_style: dict[str, Any] = {"color": colour, "size": 4}
        is_outlier = picture.outliers[channel]
        if is_outlier.any():
            point_style["symbol"] = ["x" if cross else "circle" for cross in is_outlier]
        traces.append(points(f"{name}, tracked", t, plain(picture.measured[channel]), colour, marker=point_style))
        for side, label in MODELS:
            # The models have one entry in the legend for all channels
            curve = _lines(line=model_lines[side], name=label, legendgroup=side, showlegend=i == 0)
            traces.append(curve | {"x": t, "y": plain(getattr(picture, side)[channel])})
            residuals, shade = plain(getattr(picture, f"residual_{side}")[channel], 4), ON_PAGE[side]
            small = {"color": shade, "size": 4}
            traces.append(points(f"residual, {label}", t, residuals, shade, marker=small, yaxis=axis, showlegend=i == 0))
    return Figure(
        id=f"trial-{index}",
        caption=f"{_in_words(picture)}: tracked points (crosses: outliers, left out) and both models; below, residuals in "
        "units of noise.",
        traces=tuple(traces),
        layout=layout,
        height=300 + 110 * rows,
    )


# Events


def draw_events(result: Identification) -> Drawing:
    """Draw the residuals of all events, by trial from above."""
    events = result.events
    chart = new_figure(7.5, 1.2 + 0.24 * len(events))
    axes = chart.subplots()
    axes.axvspan(-2, 2, color="0.92")
    axes.axvline(0, color="black", lw=0.8)
    for side, label in MODELS:
        predictions = [(i, e, getattr(e, side)) for i, e in enumerate(events)]
        positions = [
            (max(min((e.measured - v) / e.sigma, AXIS_LIMIT), -AXIS_LIMIT), i) for i, e, v in predictions if v is not None
        ]
        x, y, colour = [x for x, _ in positions], [y for _, y in positions], ON_PAPER[side]
        axes.plot(x, y, "o", ms=4, color=colour, label=label.removesuffix(" model"))
        missing = [i for i, _, v in predictions if v is None]
        axes.plot([AXIS_LIMIT] * len(missing), missing, "x", ms=6, color=colour)
    names = [
        f"{without_mathtext(e.trial)}{' (held out)' if e.held_out else ''}: {quantity_label(e.quantity, e.index)}"
        for e in events
    ]
    axes.set_yticks(range(len(events)), names, fontsize=8)
    axes.invert_yaxis()
    axes.set_xlim(-1.05 * AXIS_LIMIT, 1.05 * AXIS_LIMIT)
    axes.set_xlabel("measured less predicted [standard errors]")
    axes.legend(fontsize=8, loc="lower right")
    return chart


def events_on_page(result: Identification) -> Figure:
    """Return the same for the page."""
    events = result.events
    names = [f"{escaped(e.trial)}{' (held out)' if e.held_out else ''}: {quantity_label(e.quantity, e.index)}" for e in events]
    traces = []
    for side, label in _models(result):
        pairs, colour = [(e, getattr(e, side)) for e in events], ON_PAGE[side]
        x = [AXIS_LIMIT if v is None else max(min((e.measured - v) / e.sigma, AXIS_LIMIT), -AXIS_LIMIT) for e, v in pairs]
        point_style = {"color": colour, "size": 8, "symbol": ["x" if v is None else "circle" for _, v in pairs]}
        labels = [off_by(e, v) for e, v in pairs]
        traces.append(points(label, plain(x, 4), names, colour, marker=point_style, text=labels, hoverinfo="text+name+y"))
    shade = {"type": "rect", "x0": -2, "x1": 2, "yref": "paper", "y0": 0, "y1": 1, "fillcolor": LINE, "opacity": 0.35}
    return Figure(
        id="events",
        caption=f"Measured less predicted events in standard errors; those beyond {AXIS_LIMIT:g} are drawn at the edge; "
        "a cross: the event does not happen in that model's run.",
        traces=tuple(traces),
        layout={
            "xaxis": {"title": {"text": "measured less predicted [standard errors]"}},
            "yaxis": {"autorange": "reversed", "type": "category"},
            "shapes": [shade | {"line": {"width": 0}, "layer": "below"}],
        },
        height=200 + 24 * len(events),
    )


# Explanations


def name_lines(explanation: RankedExplanation, width: int) -> list[str]:
    """Return an explanation's name in lines of at most ``width`` characters, since that of a law is too long for one line."""
    return textwrap.wrap(" + ".join(explanation.names), width, max_lines=MAX_LINES, placeholder="...")


def draw_explanations(result: Identification) -> Drawing:
    """Draw the odds of the explanations against that nothing is missing as bars."""
    # Matplotlib draws horizontal bars from below, and the best should be on top
    shown = [e for e in result.explanations if e.names][::-1]
    labels = [[without_mathtext(line) for line in name_lines(e, MAX_LABEL_LENGTH)] for e in shown]
    figure = new_figure(7.0, 1.2 + (0.2 + 0.15 * max((len(label) for label in labels), default=1)) * len(shown))
    axes = figure.subplots()
    # At places of their own: two laws may have one name
    at = np.arange(len(shown))
    axes.barh(at, [e.log10_odds for e in shown], color=[ON_PAPER["after"] if e.credible else GREY for e in shown])
    axes.set_yticks(at, ["\n".join(label) for label in labels])
    axes.axvline(0, color="black", lw=0.8)
    axes.set_xlabel("odds, powers of ten")
    return figure


def explanations_on_page(result: Identification) -> Figure:
    """Return the same for the page."""
    shown = [e for e in result.explanations if e.names]
    names = [name_lines(e, LABEL_WIDTH) for e in shown]
    bars = {
        "type": "bar",
        "orientation": "h",
        "x": plain((e.log10_odds for e in shown), 4),
        "y": list(range(len(shown))),
        "marker": {"color": [ON_PAGE["after"] if e.credible else SOFT for e in shown]},
        "text": [probability_in_words(e.probability) for e in shown],
        "showlegend": False,
    }
    return Figure(
        id="explanations",
        caption=EXPLANATIONS_CAPTION,
        traces=(bars,),
        layout={
            "xaxis": {"title": {"text": "odds, powers of ten"}},
            "yaxis": {
                "autorange": "reversed",
                "tickvals": list(range(len(shown))),
                "ticktext": ["<br>".join(map(escaped, lines)) for lines in names],
            },
        },
        height=170 + (12 + 17 * max(map(len, names), default=1)) * len(shown),
    )


# The unlisted force


def draw_unlisted(force: Unlisted) -> Drawing:
    """Draw the force in every direction with a band of two standard errors, and the formula."""
    chart = new_figure(8.0, 3.6)
    axes = chart.subplots()
    axes.axhline(0.0, color="black", lw=0.8)
    for colour, p in zip(COLOURS, force.profiles, strict=False):
        s, value, error = np.array(p.coordinate), np.array(p.value), np.array(p.error)
        axes.fill_between(s, value - 2 * error, value + 2 * error, color=colour, alpha=0.25, lw=0)
        axes.plot(s, value, color=colour, label=SIDES[p.side])
        if p.fitted_formula_values is not None:
            axes.plot(s, p.fitted_formula_values, "--", color=colour, label="its formula")
    axes.set_xlabel(f"{force.depends_on.replace('_', ' ')} [{force.unit}]")
    axes.set_ylabel(f"unlisted law [{force.value_unit or 1}]")
    axes.legend(loc="best", fontsize=8)
    return chart


def unlisted_on_page(force: Unlisted) -> Figure:
    """Return the same for the page."""
    traces: list[dict[str, Any]] = []
    for i, p in enumerate(force.profiles):
        s, colour = plain(p.coordinate), f"var(--run-{i % len(COLOURS)})"
        low = plain(v - 2 * e for v, e in zip(p.value, p.error, strict=True))
        high = plain(v + 2 * e for v, e in zip(p.value, p.error, strict=True))
        edge = _lines(x=s, line={"width": 0}, hoverinfo="skip", showlegend=False)
        # Plotly fills from a line to the one before it
        traces += [edge | {"y": low}, edge | {"y": high, "fill": "tonexty", "fillcolor": f"faint {colour}"}]
        curve = _lines(x=s, line={"color": colour, "width": 2}, name=SIDES[p.side])
        traces.append(curve | {"y": plain(p.value)})
        if p.fitted_formula_values is not None:
            dashed = {"color": colour, "width": 2, "dash": "6px,3px"}
            traces.append(curve | {"y": plain(p.fitted_formula_values), "line": dashed, "name": "its formula"})
    return Figure(
        id="unlisted",
        caption=UNLISTED_CAPTION,
        traces=tuple(traces),
        layout={
            "xaxis": {"title": {"text": f"{force.depends_on.replace('_', ' ')} [{force.unit}]"}},
            "yaxis": {"title": {"text": f"unlisted law [{force.value_unit or 1}]"}},
        },
    )


# The first look: tracked points, and where the study says that they should be


@dataclass(frozen=True, kw_only=True, eq=False)
class Curve:
    """Tracked points of one body or channel, and its declared motion."""

    label: str
    points: Array
    """Positions [m], or times and values, shape (n, 2)."""
    motion: Array
    """The same as declared."""
    is_path: bool
    """Whether these are positions."""


def curves(distance: Distance) -> list[Curve]:
    """Return the path of each mass that was tracked; where none was, every channel against time."""
    named = {channel.name: (channel, predicted) for channel, predicted in distance.points}
    paths = []
    for body, names in BODIES.items():
        if len(names) == 2 and named.keys() >= set(names):
            (x, x_predicted), (y, y_predicted) = (named[n] for n in names)
            _, in_x, in_y = np.intersect1d(x.t, y.t, return_indices=True)
            tracked = np.column_stack([x.value[in_x], y.value[in_y]])
            motion = np.column_stack([x_predicted[in_x], y_predicted[in_y]])
            paths.append(Curve(label=f"{body}, tracked", points=tracked, motion=motion, is_path=True))
    return paths or [
        Curve(
            label=f"{channel.name}, measured",
            points=np.column_stack([channel.t, channel.value]),
            motion=np.column_stack([channel.t, predicted]),
            is_path=False,
        )
        for channel, predicted in named.values()
    ]


def _shown_checks(check: DeclarationCheck) -> Sequence[tuple[TrialCheck, Distance]]:
    """Return the trials to show with their distances, those with mistakes first."""
    mistaken = {trial for mistake in check.mistakes for trial in mistake.trials}
    shown = [(t, t.distance) for t in check.trials if t.distance is not None]
    return sorted(shown, key=lambda one: one[0].trial not in mistaken)[:MAX_TRIALS]


def draw_first_look(check: DeclarationCheck) -> bytes | None:
    """Return the picture of a first look as PNG; None: no trial has points to show.

    Each row is a trial: on the left as it is declared, on the right, if a mistake was named in it, without the mistake. Trials
    with mistakes come first.
    """
    corrected = {trial: (m.keys, distance) for m in check.mistakes for trial, distance in m.corrected.items()}
    rows = _shown_checks(check)
    if not rows:
        return None
    columns = 2 if corrected else 1
    figure = new_figure(PANEL * columns + 0.4, PANEL * len(rows))
    panels = figure.subplots(len(rows), columns, squeeze=False)
    for (left, *right), (row, distance) in zip(panels, rows, strict=True):
        _draw_declared(left, distance)
        left.set_title(without_mathtext(f"trial {row.trial}, as declared"), fontsize=9)
        for axes in right:
            if row.trial in corrected:
                keys, without_mistake = corrected[row.trial]
                _draw_declared(axes, without_mistake)
                axes.set_title(without_mathtext(f"with '{keys}'"), fontsize=9, wrap=True)
            else:
                axes.set_visible(False)
    panels[0][0].legend(fontsize=7, loc="best")
    return png(figure)


def _draw_declared(axes: Axes, distance: Distance) -> None:
    """Draw the points and the motion: paths to scale."""
    shown = curves(distance)
    for i, curve in enumerate(shown):
        axes.plot(*curve.points.T, ".", ms=4, color=COLOURS[i % len(COLOURS)], label=curve.label)
        axes.plot(*curve.motion.T, "-", lw=1.2, color="black", label="declared motion" if i == 0 else None)
        if curve.is_path:
            axes.plot(*curve.motion[0], "o", ms=5, mfc="none", color="black", label="its start" if i == 0 else None)
    if shown[0].is_path:
        axes.plot(0, 0, "+", ms=8, color="0.4", label="origin")
        axes.set_aspect("equal", adjustable="datalim")
    x_title, y_title = AXES[shown[0].is_path]
    axes.set_xlabel(x_title)
    axes.set_ylabel(y_title)


def first_look_on_page(check: DeclarationCheck) -> Figure | None:
    """Return the points and the declared motion of the first trial with a mistake, or of the first one; None: there is none."""
    shown = _shown_checks(check)
    if not shown:
        return None
    row, distance = shown[0]
    traces: list[dict[str, Any]] = []
    for i, curve in enumerate(drawn := curves(distance)):
        colour = f"var(--run-{i})"
        x, y = map(plain, curve.points.T)
        traces.append(points(curve.label, x, y, colour, marker={"color": colour, "size": 5}))
        x, y = map(plain, curve.motion.T)
        traces.append(_lines(name="declared motion", showlegend=i == 0, line={"color": INK, "width": 1.5}, x=x, y=y))
    to_scale = {"scaleanchor": "x", "constrain": "domain"} if drawn[0].is_path else {}
    x_title, y_title = AXES[drawn[0].is_path]
    return Figure(
        id="first-look",
        caption=f"First look, trial {escaped(row.trial)}: tracked points of the first part, and the motion that the study "
        "declares, before anything is fitted.",
        traces=tuple(traces),
        layout={"xaxis": {"title": {"text": x_title}}, "yaxis": {"title": {"text": y_title}} | to_scale},
    )
