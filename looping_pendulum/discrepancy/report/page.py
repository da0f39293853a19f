"""Render the report as a page from the same result as report.md: its sections, and interactive figures."""

from __future__ import annotations

from typing import Any

from looping_pendulum.compare.landmarks import quantity_label
from looping_pendulum.discrepancy.report import first_look_figure, lead_figure, markdown
from looping_pendulum.discrepancy.report.event_report import AXIS_LIMIT, off_by
from looping_pendulum.discrepancy.report.plots import EXPLANATIONS_CAPTION, name_lines
from looping_pendulum.discrepancy.report.unlisted_report import SIDES
from looping_pendulum.discrepancy.result import Identification, Unlisted
from looping_pendulum.discrepancy.trial_results import TrialFigure
from looping_pendulum.pages import report as pages
from looping_pendulum.pages.figures import INK, LINE, SOFT, Figure, band, escaped, horizontal, plain, points
from looping_pendulum.pages.glossary import glossary
from looping_pendulum.pages.palette import COLOURS

BEFORE, AFTER = "var(--run-1)", "var(--run-0)"
"""Colours of the declared and of the repaired model, by the page's style."""
MODELS = (("before", "declared model", BEFORE), ("after", "repaired model", AFTER))
"""Field of a figure's arrays, label and colour of each model."""
LABEL_WIDTH = 28
"""Characters in a line of an explanation's name: half of a phone's width."""


def render(result: Identification) -> str:
    """Return the page as HTML."""
    return pages.render(
        f"{result.title}: what the model lacks",
        markdown.before_figures(result),
        figures(result),
        markdown.after_figures(result),
        glossary("identification"),
        "Residual: measured less predicted. Grey bands: two standard errors, which contain 95 % of mere noise.",
        first_figures(result),
    )


def _models(result: Identification) -> tuple[tuple[str, str, str], ...]:
    """Return those of `MODELS` that differ."""
    return MODELS if lead_figure.has_repair(result) else MODELS[:1]


def first_figures(result: Identification) -> list[Figure]:
    """Return the figures that stand directly below the verdict: the motion or, if nothing was tracked, the events."""
    if result.trial_figures:
        return lead_figure.page_figures(result, {"before": BEFORE, "after": AFTER})
    return [event_figure(result)] if result.events else []


def figures(result: Identification) -> list[Figure]:
    """Return every figure that the result has data for, but for the first."""
    look = result.first_look
    shown = first_look_figure.figure(look) if look is not None and look.notes else None
    charts = [] if shown is None else [shown]
    charts += [error_figure(result)] if result.errors else []
    charts += [trial_figure(picture, i) for i, picture in enumerate(result.trial_figures)]
    if result.events and result.trial_figures:  # without these it stands below the verdict
        charts.append(event_figure(result))
    if len(result.explanations) > 1:
        charts.append(explanations_figure(result))
    if result.unlisted is not None:
        charts.append(unlisted_figure(result.unlisted))
    return charts


def error_figure(result: Identification) -> Figure:
    """Return bars of each trial's error before and after."""
    names = [escaped(e.trial) + (" (held out)" if e.held_out else "") for e in result.errors]
    sizes = ([e.standardised_rms_before for e in result.errors], [e.standardised_rms_after for e in result.errors])
    traces = tuple(
        {"type": "bar", "name": label, "x": names, "y": plain(values), "marker": {"color": colour}}
        for (_, label, colour), values in zip(_models(result), sizes, strict=False)
    )
    return Figure(
        id="errors",
        caption="Error of each trial before and after, in units of noise: 1 (dotted) is the best possible.",
        traces=traces,
        layout={
            "yaxis": {"title": {"text": "RMS [noise]"}, "rangemode": "tozero"},
            "xaxis": {"type": "category"},
            "shapes": [horizontal(1)],
        },
    )


def trial_figure(picture: TrialFigure, index: int) -> Figure:
    """Return tracked points and both models of one trial over time, and the residuals of each channel below."""
    rows = len(picture.channels)
    # In heights of a residual panel: the upper one is 2.2 tall, with a gap of 0.2 below
    tall = 1.0 / (rows + 2.4)
    layout: dict[str, Any] = {
        "xaxis": {"title": {"text": "time by the file's clock [s]"}, "anchor": f"y{rows + 1}"},
        "yaxis": {"title": {"text": "measured [SI]"}, "domain": [1 - 2.2 * tall, 1]},
        "shapes": [],
        # Otherwise the legend shows the points as small as the figure does
        "legend": {"itemsizing": "constant"},
    }
    traces: list[dict[str, Any]] = []
    for i, channel in enumerate(picture.channels):
        t, axis, name = plain(picture.t[channel]), f"y{i + 2}", escaped(channel)
        top = 1 - 2.4 * tall - i * tall
        layout[f"yaxis{i + 2}"] = {"title": {"text": name}, "domain": [top - 0.85 * tall, top]}
        layout["shapes"].append(band(-2, 2, axis))
        colour = f"var(--run-{i % len(COLOURS)})"
        point_style = {"color": colour, "size": 4}
        is_outlier = picture.outliers[channel]
        symbols = {"symbol": ["x" if cross else "circle" for cross in is_outlier]} if is_outlier.any() else {}
        traces.append(points(f"{name}, tracked", t, plain(picture.measured[channel]), colour, marker=point_style | symbols))
        for side, label, shade in MODELS:
            line_style = {
                "color": INK if side == "after" else SOFT,
                "width": 1.3,
                "dash": "solid" if side == "after" else "6px,3px",
            }
            curve = {
                "type": "scatter",
                "mode": "lines",
                "line": line_style,
                "name": label,
                "legendgroup": side,
                # The models have one entry in the legend for all channels
                "showlegend": i == 0,
            }
            traces.append(curve | {"x": t, "y": plain(getattr(picture, side)[channel])})
            residuals = plain(getattr(picture, f"residual_{side}")[channel], 4)
            residual_style = {"color": shade, "size": 4}
            traces.append(
                points(f"residual, {label}", t, residuals, shade, marker=residual_style, yaxis=axis, showlegend=i == 0)
            )
    role = "held out" if picture.held_out else "training"
    return Figure(
        id=f"trial-{index}",
        caption=f"Trial {picture.trial} ({role}): tracked points (crosses: outliers, left out) and both models; below, "
        "residuals in units of noise.",
        traces=tuple(traces),
        layout=layout,
        height=300 + 110 * rows,
    )


def event_figure(result: Identification) -> Figure:
    """Return the residuals of every event, by trial from above."""
    events = result.events
    names = [f"{escaped(e.trial)}{' (held out)' if e.held_out else ''}: {quantity_label(e.quantity, e.index)}" for e in events]
    traces = []
    for side, label, colour in _models(result):
        predicted = [getattr(e, side) for e in events]
        pairs = [(e, v) for e, v in zip(events, predicted, strict=True)]
        x = [AXIS_LIMIT if v is None else max(min((e.measured - v) / e.sigma, AXIS_LIMIT), -AXIS_LIMIT) for e, v in pairs]
        point_style = {"color": colour, "size": 8, "symbol": ["x" if v is None else "circle" for v in predicted]}
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


def explanations_figure(result: Identification) -> Figure:
    """Return the odds of the explanations against that nothing is missing as bars."""
    shown = [e for e in result.explanations if e.names]
    names = [name_lines(e, LABEL_WIDTH) for e in shown]
    bars = {
        "type": "bar",
        "orientation": "h",
        "x": plain((e.log10_odds for e in shown), 4),
        "y": list(range(len(shown))),
        "marker": {"color": [AFTER if e.credible else SOFT for e in shown]},
        "text": [markdown.probability_in_words(e.probability) for e in shown],
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


def unlisted_figure(force: Unlisted) -> Figure:
    """Return the unlisted force in every direction with a band of two standard errors, and the formula."""
    traces: list[dict[str, Any]] = []
    for i, p in enumerate(force.profiles):
        s, colour, side = plain(p.coordinate), f"var(--run-{i % len(COLOURS)})", SIDES[p.side]
        low = plain(v - 2 * e for v, e in zip(p.value, p.error, strict=True))
        high = plain(v + 2 * e for v, e in zip(p.value, p.error, strict=True))
        edge = {"type": "scatter", "mode": "lines", "x": s, "line": {"width": 0}, "hoverinfo": "skip", "showlegend": False}
        # Plotly fills from a line to the one before it
        traces += [edge | {"y": low}, edge | {"y": high, "fill": "tonexty", "fillcolor": f"faint {colour}"}]
        curve = {"type": "scatter", "mode": "lines", "x": s, "line": {"color": colour, "width": 2}, "name": side}
        traces.append(curve | {"y": plain(p.value)})
        if p.fitted_formula_values is not None:
            dashed = {"color": colour, "width": 2, "dash": "6px,3px"}
            traces.append(curve | {"y": plain(p.fitted_formula_values), "line": dashed, "name": "its formula"})
    return Figure(
        id="unlisted",
        caption="The unlisted force along its coordinate; bands: two standard errors.",
        traces=tuple(traces),
        layout={
            "xaxis": {"title": {"text": f"{force.depends_on.replace('_', ' ')} [{force.unit}]"}},
            "yaxis": {"title": {"text": f"unlisted law [{force.value_unit or 1}]"}},
        },
    )
