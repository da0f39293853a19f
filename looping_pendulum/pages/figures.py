"""Builds interactive figures as plain data for plotly.js, which comes with the plotly package and is embedded in the page.

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

from looping_pendulum.pages.palette import Style

REFERENCE, INK, SOFT, LINE = "var(--reference)", "var(--ink)", "var(--soft)", "var(--line)"
DOTTED = {"color": SOFT, "width": 1, "dash": "dot"}
SYMBOLS = {"o": "circle", "s": "square", "D": "diamond", "^": "triangle-up", "v": "triangle-down", "P": "cross"}
"""Marker of `palette.MARKERS` -> plotly's name."""


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


def line(name: str, x: Sequence[float | None], y: Sequence[float | None], style: Style | None, **more: Any) -> dict[str, Any]:
    """Return the trace of a line; without a style it is drawn as the reference."""
    if style is None:
        appearance = {"color": REFERENCE, "width": 3}
    else:
        appearance = {"color": run_colour(style), "width": 1.8, "dash": dash(style)}
    return {"type": "scatter", "mode": "lines", "name": name, "x": x, "y": y, "line": appearance} | more


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


def run_colour(style: Style) -> str:
    """Return the colour of a run as a CSS variable."""
    return f"var(--run-{style.slot})"


def dash(style: Style) -> str:
    """Return plotly's dash of a style: "solid", or lengths in pixels."""
    return "solid" if not style.dashes[1] else ",".join(f"{1.6 * length:g}px" for length in style.dashes)


def vertical(x: float, text: str) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the shape and the annotation of a vertical line at ``x`` with ``text`` above it."""
    shape = {"type": "line", "x0": x, "x1": x, "yref": "paper", "y0": 0, "y1": 1, "line": DOTTED}
    place = {"x": x, "yref": "paper", "y": 1, "yanchor": "bottom", "xanchor": "left"}
    return shape, place | {"text": text, "showarrow": False, "textangle": -30}


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
