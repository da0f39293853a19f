"""Draw the numbers of each variant against the releases: one row per engine, two numbers side by side."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from looping_pendulum.engines.registry import styles
from looping_pendulum.pages.drawing import new_figure, png, without_mathtext
from looping_pendulum.pages.palette import Style
from research.releases.result import CAPSTAN, QUANTITIES, ReleasesResult

DRAWN = ("rms_0.35s", CAPSTAN.name)
ROW_HEIGHT, WIDTH = 2.9, 11.0
"""[inches]."""
MAX_TICKS = 24
"""Most releases that are named below an axis."""


def png_of(results: Sequence[ReleasesResult]) -> bytes:
    """Return the figure of one study or several as a PNG file."""
    return png(figure(results))


def figure(results: Sequence[ReleasesResult]) -> Figure:
    """Draw `DRAWN` of each study; a ring marks a release that moved the number by more than its spread."""
    look = styles(label for result in results for label in result.labels())
    picture = new_figure(WIDTH, 0.6 + ROW_HEIGHT * len(results), dpi=110)
    grid = picture.subplots(len(results), len(DRAWN), squeeze=False)
    for axes_of_row, result in zip(grid, results, strict=True):
        for axes, quantity in zip(axes_of_row, DRAWN, strict=True):
            _panel(axes, result, quantity, look)
        if axes_of_row[0].get_legend_handles_labels()[0]:
            axes_of_row[0].legend(loc="best", fontsize=8, frameon=False)
    marks = "bars: spread when the start changes by 0.01 deg or 0.1 mm; ring: moved by more than that; cross: did not run"
    picture.suptitle(f"Magnitude of each error against the release\n{marks}", fontsize=9.5)
    return picture


def _panel(axes: Axes, result: ReleasesResult, quantity: str, look: dict[str, Style]) -> None:
    metric, names = QUANTITIES[quantity], [row.release for row in result.releases]
    scale = metric.shown_in.per_si_unit
    drawn: list[float] = []
    for label in result.labels():
        values = [None if (v := row.variant(label)) is None else v.values.get(quantity) for row in result.releases]
        known = [(place, abs(value) * scale) for place, value in enumerate(values) if value]
        spread = None if result.spread is None else result.spread.values.get(label, {}).get(quantity)
        size = (spread or 0.0) * scale
        drawn += [end for _, value in known for end in (value, value + size)]
        if known:
            _line(axes, result, label, quantity, known, size, look[label])
    absent = [place for place, row in enumerate(result.releases) if not row.ran]
    # At the foot of the axes, whatever their range
    axes.plot(absent, [0.03] * len(absent), "x", ms=5, color="0.55", transform=axes.get_xaxis_transform())
    step = -(-len(names) // MAX_TICKS)
    # The newest is always named
    shown = list(range(len(names) - 1, -1, -step))[::-1]
    axes.set_xticks(shown, [names[place] for place in shown], rotation=90, fontsize=7)
    axes.set_xlim(-0.7, len(names) - 0.3)
    if drawn:
        axes.set_yscale("log")
        # Whole decades, so that there are at least two marks with numbers
        axes.set_ylim(10 ** np.floor(np.log10(min(drawn) / 1.5)), 10 ** np.ceil(np.log10(1.5 * max(drawn))))
        axes.yaxis.set_minor_formatter(NullFormatter())
    axes.grid(True, color="0.92", lw=0.6)
    axes.set_axisbelow(True)
    axes.set_ylabel(metric.column, fontsize=8)
    axes.tick_params(axis="y", labelsize=7)
    axes.set_title(without_mathtext(f"{result.distribution}: {metric.heading}"), fontsize=9)


def _line(
    axes: Axes,
    result: ReleasesResult,
    label: str,
    quantity: str,
    known: Sequence[tuple[int, float]],
    size: float,
    style: Style,
) -> None:
    x, y = np.array(known).T
    # A bar that reaches zero has no lower end on a log axis
    bars: Any = None if not size else np.array([np.minimum(size, 0.9 * y), np.full(len(y), size)])
    how: dict[str, Any] = {"color": style.colour, "ms": 4, "lw": 1.1, "elinewidth": 0.8, "capsize": 1.5}
    axes.errorbar(x, y, yerr=bars, marker=style.marker, label=without_mathtext(label), **how)
    moved = {move.release for move in result.moves if move.label == label and move.quantity == quantity}
    rings = [(place, value) for place, value in known if result.releases[int(place)].release in moved]
    if rings:
        axes.plot(*np.array(rings).T, ls="none", marker="o", ms=10, mfc="none", mec=style.colour, mew=1.3)
