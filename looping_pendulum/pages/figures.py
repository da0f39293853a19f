"""Interactive figures as plain data for plotly.js, which comes with the plotly package and is embedded in the page.

Colours are names such as ``var(--run-0)``, or ``faint var(--run-0)`` for a band; the page's script turns them into the colours
of the ground that is chosen.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from functools import cache
from importlib.resources import files
from typing import Any

import numpy as np

from looping_pendulum.pages.chart import BLACK, DARK_GREY, LIGHT_GREY, Chart, ChartAxis, Curve, Guide, tick
from looping_pendulum.pages.palette import COLOURS, GREY

REFERENCE, SOFT, LINE = "var(--reference)", "var(--soft)", "var(--line)"
SYMBOLS = {"o": "circle", "s": "square", "D": "diamond", "^": "triangle-up", "v": "triangle-down", "P": "cross"} | {
    "*": "star",
    "x": "x",
}
"""Matplotlib's letter of a marker -> plotly's name."""
PAGE_COLOURS = {BLACK: REFERENCE, GREY: SOFT, DARK_GREY: SOFT, LIGHT_GREY: LINE} | {
    colour: f"var(--run-{slot})" for slot, colour in enumerate(COLOURS)
}
"""Colour on paper -> the page's."""
PIXELS_PER_INCH, PIXELS_PER_POINT = 86, 4 / 3
"""Size of a figure on a page by its size on paper [inches], and of its lines and points [points]."""
PANEL_GAP = 0.12
"""Gap between panels times their number, as a share of the height of all."""
MANY_PANELS = 3
"""Number of panels below each other above which the labels of their axes are small."""
COLUMN_GAP, ROW_GAP = 0.12, 0.3
"""Gaps in a grid of panels, as a share of a panel's width and height: room for labels and titles."""
MIN_NAMED_POINT = 3.0
"""Smaller points [points] are hard to see in a legend, which then shows all of one size."""
MAX_LINE_POINTS = 600
"""Most points of one line: a page with every variant stays below 6 MB."""


@cache
def plotly_source() -> str:
    """Return the text of plotly.js."""
    return (files("plotly") / "package_data" / "plotly.min.js").read_text(encoding="utf-8")


def on_page(chart: Chart) -> dict[str, Any]:
    """Return a chart as an interactive figure: its id, its caption, and plotly's traces and layout as plain data.

    A click on a word of its legend hides the curves of that label in all panels.
    """
    traces: list[dict[str, Any]] = []
    shapes: list[dict[str, Any]] = []
    words: list[dict[str, Any]] = []
    # Without the last Plotly shows no legend for a single line
    layout: dict[str, Any] = {"shapes": shapes, "annotations": words, "showlegend": True}
    layout["height"] = round(PIXELS_PER_INCH * chart.size[1])
    if chart.columns is None:
        layout["xaxis"] = _axis(chart.x) | {"anchor": _number("y", len(chart.panels) - 1)}
    else:
        grid = {"rows": -(-len(chart.panels) // chart.columns), "columns": chart.columns}
        layout["grid"] = grid | {"pattern": "independent", "xgap": COLUMN_GAP, "ygap": ROW_GAP}
    gap = PANEL_GAP / len(chart.panels)
    share = (1 - gap * (len(chart.panels) - 1)) / sum(panel.height for panel in chart.panels)
    top = 1.0
    for i, panel in enumerate(chart.panels):
        y, x, x_axis = _number("y", i), "x", chart.x
        vertical = _axis(panel.y)
        if chart.columns is None and len(chart.panels) > MANY_PANELS:  # on a phone their labels would meet
            vertical["title"]["font"] = {"size": 10}
        if chart.columns is None:
            bottom = top - share * panel.height
            vertical["domain"] = [max(bottom, 0.0), top]
            top = bottom - gap
        else:
            x, x_axis = _number("x", i), panel.x or chart.x
            layout[f"xaxis{x[1:]}"] = _axis(x_axis)
        layout[f"yaxis{y[1:]}"] = vertical
        if panel.to_scale:
            layout[f"xaxis{x[1:]}"] |= {"scaleanchor": y, "constrain": "domain"}
            vertical["constrain"] = "domain"
        traces += [trace | {"xaxis": x, "yaxis": y} for curve in panel.curves for trace in _traces(curve, x_axis, panel.y)]
        for guide in panel.guides:
            shapes += _guide(guide, x, y, x_axis, panel.y)
            if guide.text:
                place = {"x": guide.x, "xref": x, "xanchor": "left", "y": 1, "yref": f"{y} domain", "yanchor": "bottom"}
                words.append(place | {"text": guide.text, "showarrow": False, "textangle": -30})
        if panel.title:
            place = {"x": 0, "xref": f"{x} domain", "xanchor": "left", "y": 1, "yref": f"{y} domain", "yanchor": "bottom"}
            words.append(place | {"text": _lines(panel.title), "showarrow": False, "align": "left"})
        if panel.disc is not None:
            box = {"x0": -panel.disc, "x1": panel.disc, "y0": -panel.disc, "y1": panel.disc, "xref": x, "yref": y}
            shapes.append({"type": "circle", "fillcolor": LINE, "line": {"color": SOFT}} | box)
    if any(curve.marker and curve.size < MIN_NAMED_POINT for panel in chart.panels for curve in panel.curves):
        layout["legend"] = {"itemsizing": "constant"}
    # Room for slanted words, or for titles of two lines
    layout |= {"margin": {"t": 90 if chart.columns is None else 50}} if words else {}
    return {"id": chart.id, "caption": chart.caption, "traces": traces, "layout": layout}


def _number(letter: str, panel: int) -> str:
    """Return plotly's name of a panel's axis: "x", "x2", "x3", ..."""
    return letter if panel == 0 else f"{letter}{panel + 1}"


def _guide(guide: Guide, x: str, y: str, x_axis: ChartAxis, y_axis: ChartAxis) -> list[dict[str, Any]]:
    """Return the shapes of a line across the panel whose axes have the names ``x`` and ``y``, and of its shaded span."""
    shapes: list[dict[str, Any]] = []
    for at, letter, axis, place in (
        (guide.x, "x", x_axis, {"xref": x, "yref": f"{y} domain", "y0": 0, "y1": 1}),
        (guide.y, "y", y_axis, {"yref": y, "xref": f"{x} domain", "x0": 0, "x1": 1}),
    ):
        if at is None:
            continue
        dotted = guide.dotted or guide.colour == GREY
        line = {"color": PAGE_COLOURS[guide.colour], "width": 1} | ({"dash": "dot"} if dotted else {})
        looks: list[tuple[float, dict[str, Any]]] = [(0.0, {"type": "line", "line": line})]
        if guide.half_width:
            span = {"type": "rect", "fillcolor": LINE, "opacity": 0.35, "line": {"width": 0}, "layer": "below"}
            looks.append((guide.half_width, span))
        for half, look in looks:
            low, high = _placed(axis, [at - half, at + half])
            shapes.append(look | place | {f"{letter}0": float(low), f"{letter}1": float(high)})
    return shapes


def _axis(axis: ChartAxis) -> dict[str, Any]:
    """Return plotly's axis. It has no scale like "symlog": its values are transformed here, and the ticks named."""
    made: dict[str, Any] = {"title": {"text": _lines(axis.label)}}
    if axis.scale == "log":
        made |= {"type": "log", "tickformat": "~g"}
    if axis.limits is not None:
        ends = np.log10(axis.limits) if axis.scale == "log" else _placed(axis, axis.limits)
        made["range"] = plain(ends)
    ticks = axis.ticks
    if ticks is None and axis.scale == "symlog":
        sizes = [axis.linear_to * 10.0**k for k in range(8)]
        ticks = {value: tick(value) for value in (*(-size for size in reversed(sizes)), 0.0, *sizes)}
    if ticks is not None:
        made |= {"tickvals": plain(_placed(axis, list(ticks))), "ticktext": [_lines(word) for word in ticks.values()]}
    return made


def _placed(axis: ChartAxis, values: Any) -> np.ndarray:
    """Return where values of an axis stand on plotly's."""
    given = np.asarray(values, dtype=float)
    if axis.scale != "symlog":
        return given
    size = np.abs(given) / axis.linear_to
    # The linear part is as long as one decade
    return np.asarray(np.sign(given) * np.where(size <= 1, size, 1 + np.log10(np.maximum(size, 1))))


def _traces(curve: Curve, x: ChartAxis, y: ChartAxis) -> list[dict[str, Any]]:
    """Return the traces of a curve: its own, above the two of its band's edges."""
    colour, name = PAGE_COLOURS[curve.colour], escaped(curve.label)
    # Division that rounds up, so that there are never more points than allowed
    stride = -(-len(curve.x) // MAX_LINE_POINTS) if curve.width and not curve.marker and not curve.in_pairs else 1
    values = [v[::stride] for v in curve.drawn()]
    own: dict[str, Any] = {"name": name, "legendgroup": name, "showlegend": bool(name) and curve.in_legend}
    trace = own | {"x": plain(_placed(x, values[0])), "y": plain(_placed(y, values[1]))}
    trace |= {"type": "scatter", "mode": "+".join(w for w, has in (("lines", curve.width), ("markers", curve.marker)) if has)}
    if curve.width:
        dashes = ",".join(f"{1.6 * length:g}px" for length in curve.dashes)
        dash = "solid" if curve.dashes == (1, 0) else dashes
        trace["line"] = {"color": colour, "width": round(PIXELS_PER_POINT * curve.width, 1), "dash": dash}
    if curve.marker:
        symbol = SYMBOLS[curve.marker] + ("-open" if curve.hollow else "")
        trace["marker"] = {"color": colour, "symbol": symbol, "size": round(PIXELS_PER_POINT * curve.size, 1)}
    if curve.bar is not None:
        bar = {"type": "constant", "value": curve.bar, "color": colour}
        trace |= {"error_x": bar, "error_y": bar}
    if curve.words:
        trace["text"] = [escaped(word) for word in curve.words]
    if not curve.label:
        trace["hoverinfo"] = "skip"
    elif curve.words:
        trace["hovertemplate"] = "%{text}"
    elif "symlog" in (x.scale, y.scale) or y.ticks is not None:
        # What stands beside the pointer is the value itself
        pairs = zip(*(_shown(axis, one) for axis, one in zip((x, y), values, strict=True)), strict=True)
        trace |= {"customdata": [list(pair) for pair in pairs], "hovertemplate": "(%{customdata[0]}, %{customdata[1]})"}
    if curve.band is None:
        return [trace]
    half = np.asarray(curve.band, dtype=float)[::stride]
    edge = own | {"type": "scatter", "mode": "lines", "showlegend": False, "hoverinfo": "skip", "line": {"width": 0}}
    low, high = (edge | {"x": trace["x"], "y": plain(_placed(y, values[1] + side * half))} for side in (-1, 1))
    # Plotly fills from a line to the one before it
    return [low, high | {"fill": "tonexty", "fillcolor": f"faint {colour}"}, trace]


def _shown(axis: ChartAxis, values: np.ndarray) -> list[Any]:
    """Return what a reader is told of values: the word of the nearest tick, where these are not numbers on a scale."""
    if axis.scale == "linear" and axis.ticks:
        return [escaped(axis.ticks[min(axis.ticks, key=lambda tick: abs(tick - value))]).replace("\n", " ") for value in values]
    return list(plain(values))


def plain(values: Iterable[float]) -> list[float | None]:
    """Return ``values`` rounded to six significant digits, None where they are not finite."""
    # Six digits are more than a screen shows, and keep the page small; None is a gap in plotly, while NaN is no JSON
    return [float(f"{v:.6g}") if math.isfinite(v) else None for v in values]


def escaped(text: str) -> str:
    """Escape ``text`` so that plotly shows it literally: its labels interpret some HTML tags."""
    return text.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")


def _lines(text: str) -> str:
    """Return `escaped` ``text`` with its lines below each other."""
    return escaped(text).replace("\n", "<br>")
