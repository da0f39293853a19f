"""A figure as data: drawn by Matplotlib for report.md and films (`drawing.draw`), by Plotly for a page (`figures.on_page`).

Colours are those on white paper, as Matplotlib knows them; a page turns them into those of its ground.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from looping_pendulum.files import optional_output
from looping_pendulum.pages.palette import GREY, Style

Values = Sequence[float] | np.ndarray
BLACK, DARK_GREY, LIGHT_GREY = "black", "0.35", "0.8"
"""Colours of the reference, of tracked points, and of bands and the rod."""
MARGIN = 0.05
"""Room at either end of an axis, as a share of what it shows: Matplotlib's own."""


@dataclass(frozen=True, kw_only=True)
class ChartAxis:
    """One axis of a panel."""

    label: str = ""
    """With unit; a line may end in it."""
    scale: Literal["linear", "log", "symlog"] = "linear"
    """"symlog" is linear up to `linear_to` and logarithmic beyond, to either side."""
    linear_to: float = 1.0
    limits: tuple[float, float] | None = None
    """Values at the left or lower end and at the other; None: what the data need."""
    ticks: Mapping[float, str] | None = None
    """Value -> word beside it; None: numbers where they suit."""


@dataclass(frozen=True, kw_only=True)
class Curve:
    """A line, points or both."""

    label: str
    """In the legend; curves of one label in several panels are switched together. Empty: no legend and no pointer names it."""
    x: Values
    y: Values
    """NaN is a gap."""
    colour: str = BLACK
    width: float = 0.0
    """Width of the line [points]; 0: no line."""
    dashes: tuple[float, ...] = (1, 0)
    """Lengths of strokes and gaps [line widths]."""
    in_pairs: bool = False
    """Whether every two points have a line of their own, instead of one that joins all."""
    band: Values | None = None
    """Half-height of a faint band about each point."""
    marker: str = ""
    """Matplotlib's letter, one of `palette.MARKERS`, "*" or "x"; empty: no points."""
    size: float = 5.0
    """Size of the points [points]."""
    hollow: bool = False
    bar: float | None = None
    """Half-length of a bar at every point, in x and in y."""
    in_legend: bool = True
    words: Sequence[str] = ()
    """Of each point: what stands on a page beside the pointer at it."""

    def drawn(self) -> tuple[np.ndarray, np.ndarray]:
        """Return x and y of the points, with a gap after each two that have a line of their own."""
        x, y = (np.asarray(values, dtype=float) for values in (self.x, self.y))
        if not self.in_pairs:
            return x, y
        ends = np.arange(2, len(x) + 1, 2)
        return np.insert(x, ends, np.nan), np.insert(y, ends, np.nan)


@dataclass(frozen=True, kw_only=True)
class Guide:
    """A straight line across a panel, which may be the middle of a shaded span."""

    x: float | None = None
    """Where a vertical line stands."""
    y: float | None = None
    """Where a horizontal line stands; one of the two is given."""
    text: str = ""
    """Words at the upper end of a vertical line."""
    colour: str = GREY
    dotted: bool = False
    half_width: float = 0.0
    """Reach of the shaded span to either side; 0: there is none."""


@dataclass(frozen=True, kw_only=True)
class Panel:
    """Axes with curves; the later are drawn above the earlier."""

    curves: Sequence[Curve]
    y: ChartAxis
    guides: Sequence[Guide] = ()
    height: int = 1
    """Height in proportion to the other panels."""
    disc: float | None = None
    """Radius of a disc about the origin, which hides what is below it."""
    x: ChartAxis | None = None
    """Its own x axis, which a panel of a grid may have; None: the chart's."""
    title: str = ""
    """Of a panel of a grid; a line may end in it."""
    to_scale: bool = False
    """Whether a unit is as long in y as in x."""


@dataclass(frozen=True, kw_only=True)
class Chart:
    """Panels below each other that share their x axis, or a grid of panels with axes of their own."""

    id: str
    """Name of its file and of its element on a page."""
    caption: str
    """Description of what it shows, also for screen readers."""
    subject: str
    """Name of a scenario or a trial, which stands before the title."""
    title: str
    x: ChartAxis
    panels: Sequence[Panel]
    size: tuple[float, float]
    """Width and height on paper [inches]."""
    columns: int | None = None
    """Panels in a row of the grid; on a narrow screen they stand below each other. None: there is no grid."""


def make_charts(makers: Mapping[str, Callable[[], Chart | None]]) -> list[Chart]:
    """Return the charts of several ids but for None; one that cannot be made is left out with a warning."""
    made = []
    for name, make in makers.items():
        with optional_output(f"figures/{name}.png"):
            made.append(make())
    return [chart for chart in made if chart is not None]


def run_curve(label: str, x: Values, y: Values, style: Style | None, *, in_legend: bool = True) -> Curve:
    """Return the line of a run; without a style, that of the reference, which shows on both sides of a run that follows it."""
    look: dict[str, Any] = {"width": 2.4} if style is None else {"colour": style.colour, "width": 1.4, "dashes": style.dashes}
    return Curve(label=label, x=x, y=y, in_legend=in_legend, **look)


def tracked_points(x: Values, y: Values) -> Curve:
    """Return tracked points, small and hollow, so that lines show through hundreds of them."""
    return Curve(label="tracked points", x=x, y=y, colour=DARK_GREY, marker="o", size=3.2, hollow=True)


def tick(value: float) -> str:
    """Return a number beside an axis, with a minus as long as a plus."""
    return f"{value:g}".replace("-", "\N{MINUS SIGN}")


def reach(values: Sequence[Values]) -> tuple[float, float]:
    """Return the limits of an axis that shows all finite ``values`` with `MARGIN`."""
    known = np.concatenate([np.ravel(np.asarray(v, dtype=float)) for v in values])
    known = known[np.isfinite(known)]
    low, high = float(known.min()), float(known.max())
    return low - MARGIN * (high - low), high + MARGIN * (high - low)


def with_room(*spans: tuple[float, float]) -> list[tuple[float, float]]:
    """Return the limits of both axes, the shorter as long as half of the longer: a vertical drop gets room to both sides."""
    room = max(high - low for low, high in spans) / 2
    halves = [max(high - low, room) / 2 for low, high in spans]
    return [((low + high) / 2 - half, (low + high) / 2 + half) for (low, high), half in zip(spans, halves, strict=True)]
