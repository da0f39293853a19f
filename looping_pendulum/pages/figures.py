"""Interactive figures as plain data for plotly.js, which comes with the plotly package and stands whole in the page.

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
    """One figure."""

    id: str
    """Of its element, unique on the page."""
    caption: str
    """What it shows; also what a screen reader says."""
    traces: tuple[dict[str, Any], ...]
    layout: dict[str, Any]
    height: int = 420
    """[px]"""

    def as_dict(self) -> dict[str, Any]:
        """Plain data for the page's script."""
        return {"id": self.id, "traces": list(self.traces), "layout": self.layout | {"height": self.height}}


@cache
def plotly_source() -> str:
    """Text of plotly.js."""
    return (files("plotly") / "package_data" / "plotly.min.js").read_text(encoding="utf-8")


def line(name: str, x: Sequence[float | None], y: Sequence[float | None], style: Style | None, **more: Any) -> dict[str, Any]:
    """Make a line; without a style, the reference's."""
    if style is None:
        look = {"color": REFERENCE, "width": 3}
    else:
        look = {"color": run_colour(style), "width": 1.8, "dash": dash(style)}
    return {"type": "scatter", "mode": "lines", "name": name, "x": x, "y": y, "line": look} | more


def points(name: str, x: Sequence[Any], y: Sequence[Any], colour: str, symbol: str = "circle", **more: Any) -> dict[str, Any]:
    """Make points."""
    return {
        "type": "scatter",
        "mode": "markers",
        "name": name,
        "x": x,
        "y": y,
        "marker": {"color": colour, "symbol": symbol, "size": 8},
    } | more


def run_colour(style: Style) -> str:
    """Colour of a run, for the page's script."""
    return f"var(--run-{style.slot})"


def dash(style: Style) -> str:
    """Plotly's dash of a style: "solid", or lengths in pixels."""
    return "solid" if not style.dashes[1] else ",".join(f"{1.6 * length:g}px" for length in style.dashes)


def vertical(x: float, text: str) -> tuple[dict[str, Any], dict[str, Any]]:
    """Shape and annotation of a vertical line at ``x`` with a word above it."""
    shape = {"type": "line", "x0": x, "x1": x, "yref": "paper", "y0": 0, "y1": 1, "line": DOTTED}
    place = {"x": x, "yref": "paper", "y": 1, "yanchor": "bottom", "xanchor": "left"}
    return shape, place | {"text": text, "showarrow": False, "textangle": -30}


def horizontal(y: float, axis: str = "y") -> dict[str, Any]:
    """Shape of a horizontal line at ``y``."""
    return {"type": "line", "xref": "paper", "x0": 0, "x1": 1, "yref": axis, "y0": y, "y1": y, "line": DOTTED}


def band(low: float, high: float, axis: str = "y") -> dict[str, Any]:
    """Shape of a horizontal band."""
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
    """``values`` to ``digits`` significant digits, None where they are not finite."""
    return [float(f"{v:.{digits}g}") if math.isfinite(v) else None for v in values]


def escaped(text: str) -> str:
    """``text`` as plotly shows it literally: its labels take some HTML tags for formatting."""
    return text.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")
