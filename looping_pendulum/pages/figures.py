"""Interactive figures as plain data for plotly.js, which comes with the plotly package and is embedded in the page.

Colours are names such as ``var(--run-0)``, or ``faint var(--run-0)`` for a band; the page's script turns them into the colours
of the ground that is chosen.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any

import numpy as np

from looping_pendulum.pages.chart import BLACK, DARK_GREY, LIGHT_GREY, Axis, Chart, Curve, tick
from looping_pendulum.pages.palette import COLOURS, GREY

REFERENCE, INK, SOFT, LINE = "var(--reference)", "var(--ink)", "var(--soft)", "var(--line)"
DOTTED = {"color": SOFT, "width": 1, "dash": "dot"}
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
PANEL_GAP = 0.06
"""Gap between panels, as a share of the height of all."""
MAX_LINE_POINTS = 600
"""Most points of one line: a page with every variant stays below 6 MB."""


@dataclass(frozen=True, kw_only=True)
class Figure:
    """A figure of a page."""

    id: str
    """Id of its HTML element, unique on the page."""
    caption: str
    """Description of what it shows, also for screen readers."""
    traces: tuple[dict[str, Any], ...]
    layout: dict[str, Any]
    height: int = 420
    """Height [px]."""

    def as_dict(self) -> dict[str, Any]:
        """Return the figure as plain data for the page's script."""
        return {"id": self.id, "traces": list(self.traces), "layout": self.layout | {"height": self.height}}


@cache
def plotly_source() -> str:
    """Return the text of plotly.js."""
    return (files("plotly") / "package_data" / "plotly.min.js").read_text(encoding="utf-8")


def on_page(chart: Chart) -> Figure:
    """Return a chart as an interactive figure; a click on a word of its legend hides the curves of that label in all panels."""
    traces: list[dict[str, Any]] = []
    shapes: list[dict[str, Any]] = []
    words: list[dict[str, Any]] = []
    share = (1 - PANEL_GAP * (len(chart.panels) - 1)) / sum(panel.height for panel in chart.panels)
    layout: dict[str, Any] = {"xaxis": _axis(chart.x) | {"anchor": _name(len(chart.panels) - 1)}}
    top = 1.0
    for i, panel in enumerate(chart.panels):
        name, bottom = _name(i), top - share * panel.height
        layout[f"yaxis{name[1:]}"] = _axis(panel.y) | {"domain": [max(bottom, 0.0), top]}
        top = bottom - PANEL_GAP
        traces += [_trace(curve, chart.x, panel.y) | {"yaxis": name} for curve in panel.curves]
        for guide in panel.guides:
            line = DOTTED if guide.colour == GREY else {"color": PAGE_COLOURS[guide.colour], "width": 1}
            look = {"type": "line", "line": line}
            if guide.x is None:
                y = float(_placed(panel.y, guide.y))
                shapes.append(look | {"xref": "paper", "x0": 0, "x1": 1, "yref": name, "y0": y, "y1": y})
            else:
                x = float(_placed(chart.x, guide.x))
                shapes.append(look | {"x0": x, "x1": x, "yref": "paper", "y0": 0, "y1": 1})
            if guide.text:
                place = {"x": guide.x, "yref": "paper", "y": 1, "yanchor": "bottom", "xanchor": "left"}
                words.append(place | {"text": guide.text, "showarrow": False, "textangle": -30})
        if panel.disc is not None:
            box = {"x0": -panel.disc, "x1": panel.disc, "y0": -panel.disc, "y1": panel.disc, "yref": name}
            shapes.append({"type": "circle", "fillcolor": LINE, "line": {"color": SOFT}} | box)
    if chart.to_scale:
        layout["xaxis"] |= {"scaleanchor": "y", "constrain": "domain"}
        layout["yaxis"] |= {"constrain": "domain"}
    # Without it Plotly shows no legend for a single line
    layout |= {"shapes": shapes, "annotations": words, "showlegend": True}
    # Room for slanted words
    layout |= {"margin": {"t": 90}} if words else {}
    return Figure(
        id=chart.id,
        caption=chart.caption,
        traces=tuple(traces),
        layout=layout,
        height=round(PIXELS_PER_INCH * chart.size[1]),
    )


def _name(panel: int) -> str:
    return "y" if panel == 0 else f"y{panel + 1}"


def _axis(axis: Axis) -> dict[str, Any]:
    """Return plotly's axis. It has no scale like "symlog": its values are transformed here, and the ticks named."""
    made: dict[str, Any] = {"title": {"text": axis.label.replace("\n", "<br>")}}
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
        made |= {"tickvals": plain(_placed(axis, list(ticks))), "ticktext": [escaped(word) for word in ticks.values()]}
    return made


def _placed(axis: Axis, values: Any) -> np.ndarray:
    """Return where values of an axis stand on plotly's."""
    given = np.asarray(values, dtype=float)
    if axis.scale != "symlog":
        return given
    size = np.abs(given) / axis.linear_to
    # The linear part is as long as one decade
    return np.asarray(np.sign(given) * np.where(size <= 1, size, 1 + np.log10(np.maximum(size, 1))))


def _trace(curve: Curve, x: Axis, y: Axis) -> dict[str, Any]:
    colour, name = PAGE_COLOURS[curve.colour], escaped(curve.label)
    # Division that rounds up, so that there are never more points than allowed
    stride = -(-len(curve.x) // MAX_LINE_POINTS) if curve.width and not curve.marker else 1
    values = [np.asarray(v, dtype=float)[::stride] for v in (curve.x, curve.y)]
    trace: dict[str, Any] = {"type": "scatter", "name": name, "legendgroup": name, "showlegend": curve.in_legend}
    trace |= {"mode": "+".join(what for what, has in (("lines", curve.width), ("markers", curve.marker)) if has)}
    trace |= {"x": plain(_placed(x, values[0])), "y": plain(_placed(y, values[1]))}
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
    if "symlog" in (x.scale, y.scale) or y.ticks is not None:
        # What stands beside the pointer is the value itself
        pairs = zip(*(_shown(axis, one) for axis, one in zip((x, y), values, strict=True)), strict=True)
        trace |= {"customdata": [list(pair) for pair in pairs], "hovertemplate": "(%{customdata[0]}, %{customdata[1]})"}
    return trace


def _shown(axis: Axis, values: np.ndarray) -> list[Any]:
    """Return what a reader is told of values: the word of the nearest tick, where these are not numbers on a scale."""
    if axis.scale == "linear" and axis.ticks:
        return [escaped(axis.ticks[min(axis.ticks, key=lambda tick: abs(tick - value))]) for value in values]
    return list(plain(values))


def points(name: str, x: Sequence[Any], y: Sequence[Any], colour: str, symbol: str = "circle", **more: Any) -> dict[str, Any]:
    """Return the trace of points."""
    return {
        "type": "scatter",
        "mode": "markers",
        "name": name,
        "x": x,
        "y": y,
        "marker": {"color": colour, "symbol": symbol, "size": 8},
    } | more


def horizontal(y: float, axis: str = "y") -> dict[str, Any]:
    """Return the shape of a horizontal line at ``y``."""
    return {"type": "line", "xref": "paper", "x0": 0, "x1": 1, "yref": axis, "y0": y, "y1": y, "line": DOTTED}


def band(low: float, high: float, axis: str = "y") -> dict[str, Any]:
    """Return the shape of a horizontal band."""
    return {
        "type": "rect",
        "xref": "paper",
        "x0": 0,
        "x1": 1,
        "yref": axis,
        "y0": low,
        "y1": high,
        "fillcolor": LINE,
        "opacity": 0.35,
        "line": {"width": 0},
        "layer": "below",
    }


def plain(values: Iterable[float], digits: int = 6) -> list[float | None]:
    """Return ``values`` rounded to ``digits`` significant digits, None where they are not finite."""
    # Six digits are more than a screen shows, and keep the page small; None is a gap in plotly, while NaN is no JSON
    return [float(f"{v:.{digits}g}") if math.isfinite(v) else None for v in values]


def escaped(text: str) -> str:
    """Escape ``text`` so that plotly shows it literally: its labels interpret some HTML tags."""
    return text.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")
