"""Draws the figure of a map: halting time over the varied quantities; runs without a halt are grey, hatched by their ending."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FormatStrFormatter, MaxNLocator
from numpy.typing import NDArray
from zarr.storage import LocalStore

from looping_pendulum.engines.registry import styles
from looping_pendulum.pages.drawing import new_figure, png
from looping_pendulum.reference_ode.transitions import Event
from looping_pendulum.sweep.cells import ENDING_DESCRIPTIONS, ENDINGS
from looping_pendulum.sweep.plan import REFERENCE, Axis, MapPlan, Sample

MAP = "viridis"
"""Matplotlib's colour map: safe for colour-blind readers, and monotone when printed in grey."""
HATCHES = ("", "////", "....", "xxxx", "\\\\\\\\", "++++", "oo")
MARKERS = ("x", "1", "+", "2", "3", "4", ".")
GREYS = ("0.92", "0.82", "0.72", "0.88", "0.78", "0.68", "0.95")
MAX_CELLS = 1500
"""Largest number of values of an axis that are drawn; of more, every second or third is."""
MAX_POINTS = 20000
"""Largest number of runs of a sample that are drawn."""
MAX_PANELS = 9
"""Largest number of panels, one for each value of a third quantity."""
NO_HALT = {**ENDING_DESCRIPTIONS, str(Event.LIGHT_REACHES_ROD): "the light mass reached the rod, and M2 was not at rest"}
"""Ending of a run without a halt -> its description."""


def draw(plan: MapPlan, store: Path) -> dict[str, tuple[str, bytes]]:
    """Draw the figure: file name -> (caption, PNG)."""
    sampled = isinstance(plan.design, Sample)
    varied = [axis for axis in plan.design.axes if sampled or len(axis.values) > 1] or [plan.design.axes[0]]
    # As plain arrays, also where Dask is installed: it is loaded whole anyway
    with xr.open_zarr(LocalStore(store, read_only=True), chunks=None) as data:
        most = MAX_POINTS if sampled or len(plan.design.axes) == 1 else MAX_CELLS
        steps = {dim: math.ceil(n / most) for dim, n in data.sizes.items()}
        thin = data[["halting_time", "stops", "end"]].isel({dim: slice(None, None, step) for dim, step in steps.items()}).load()
    if len(varied) == 1:
        caption = f"Halting time and stops of the heavy mass over {varied[0].name}; grey: runs that do not halt."
        figure = _lines(plan, thin, varied[0])
    else:
        over = " and ".join(axis.name for axis in varied)
        caption = f"Halting time over {over}; grey: runs that do not halt, and how they end."
        figure = _map(plan, thin, varied)
    if max(steps.values()) > 1:
        caption += " Of so many runs, evenly chosen ones are drawn."
    return {"halting_time.png": (caption, png(figure))}


def _label(axis: Axis) -> str:
    return f"{axis.name.replace('_', ' ')}{f' [{axis.written}]' if axis.written else ''}"


def _values(axis: Axis, data: xr.Dataset) -> NDArray[np.float64]:
    return np.asarray(data[axis.name].values, dtype=float) / axis.scale


def _scales(axes: Axes, x: Axis, y: Axis | None = None) -> None:
    axes.set_xlabel(_label(x))
    if x.logarithmic:
        axes.set_xscale("log")
    if y is not None:
        axes.set_ylabel(_label(y))
        if y.logarithmic:
            axes.set_yscale("log")


def _lines(plan: MapPlan, data: xr.Dataset, axis: Axis) -> Figure:
    """Draw one varied quantity: halting time above, number of stops below; ticks mark runs that do not halt."""
    figure = new_figure(7.6, 5.6, dpi=130)
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
    # Many points, or a sample's in any order, are not joined: the line would hide them
    few = data.sizes[next(iter(data["end"].dims[-1:]))] <= 200 and not isinstance(plan.design, Sample)
    look = styles(plan.engines)
    for i, engine in enumerate(plan.engines):
        one = data.isel(engine=i) if plan.several else data
        colour = "black" if engine == REFERENCE else look[engine].colour
        x, halt = _values(axis, one), one["halting_time"].values.ravel()
        stops = np.where(one["stops"].values < 0, np.nan, one["stops"].values).ravel()
        how: dict[str, Any] = {"color": colour, "ms": 4 if few else 2, "ls": "-" if few else "", "lw": 0.8}
        above.plot(x, halt, marker="o", label=engine, **how)
        below.plot(x, stops, marker="o", **how)
        without = x[~np.isfinite(halt)]
        # In axes units from the bottom, each engine at a height of its own
        above.plot(without, np.full(len(without), 0.02 + 0.03 * i), "|", color="0.5", transform=above.get_xaxis_transform())
    above.set_ylabel("halting time [s]")
    below.set_ylabel("stops of the heavy mass")
    below.set_ylim(bottom=0)
    below.yaxis.set_major_locator(MaxNLocator(integer=True))
    _scales(below, axis)
    above.set_title(plan.title)
    if plan.several:
        above.legend(frameon=False)
    return figure


class _Panel(NamedTuple):
    title: str
    x: Axis
    y: Axis
    data: xr.Dataset


def _panels(plan: MapPlan, data: xr.Dataset, varied: list[Axis]) -> Iterator[_Panel]:
    """Yield, for each engine, each pair of a sample's quantities, or two of a grid's at each of some values of a third one."""
    for i, engine in enumerate(plan.engines):
        one = data.isel(engine=i) if plan.several else data
        of = [engine] if plan.several else []
        if isinstance(plan.design, Sample):
            for x, y in itertools.combinations(varied, 2):
                yield _Panel(", ".join(of), x, y, one)
        elif len(varied) == 2:
            yield _Panel(", ".join(of), varied[0], varied[1], one.squeeze())
        else:
            # The quantity with the fewest values, since each needs a panel
            third = min(varied, key=lambda axis: len(axis.values))
            x, y = (axis for axis in varied if axis is not third)
            # Evenly spaced, with the first and the last
            n = data.sizes[third.name]
            for j in np.unique(np.linspace(0, n - 1, min(n, MAX_PANELS // len(plan.engines) or 1)).round().astype(int)):
                title = ", ".join([*of, f"{_label(third)} {_values(third, one)[j]:.4g}"])
                yield _Panel(title, x, y, one.isel({third.name: int(j)}))


def _map(plan: MapPlan, data: xr.Dataset, varied: list[Axis]) -> Figure:
    """Draw the halting time over two or three quantities."""
    panels = list(_panels(plan, data, varied))
    columns = 1 if len(panels) == 1 else 2 if len(panels) in (2, 4) else 3
    rows = math.ceil(len(panels) / columns)
    figure = new_figure(7.6, 5.6, dpi=130) if columns == 1 else new_figure(3.9 * columns, 3.5 * rows, dpi=130)
    grid = list(figure.subplots(rows, columns, squeeze=False).ravel())
    norm = _norm(data["halting_time"].values)
    handles: dict[int, Any] = {}
    for axes, panel in zip(grid, panels, strict=False):
        handles |= (_scatter if isinstance(plan.design, Sample) else _heat)(axes, panel, norm)
        _scales(axes, panel.x, panel.y)
        axes.set_title(panel.title, fontsize="medium")
    for axes in grid[len(panels) :]:
        axes.set_axis_off()
    bar = figure.colorbar(ScalarMappable(norm=norm, cmap=MAP), ax=grid, label="halting time [s]", shrink=0.9)
    if isinstance(norm, LogNorm):
        low, high = float(norm.vmin or 0), float(norm.vmax or 0)
        # Matplotlib labels only the decades, of which a range of halting times may have none
        ticks = [digit * 10.0**power for power in range(-6, 7) for digit in (1, 2, 3, 5)]
        bar.set_ticks([tick for tick in ticks if low <= tick <= high], minor=False)
        bar.ax.minorticks_off()
        bar.ax.yaxis.set_major_formatter(FormatStrFormatter("%g"))
    figure.suptitle(plan.title)
    if handles:
        shown = [handles[code] for code in sorted(handles)]
        figure.legend(handles=shown, loc="outside lower center", ncols=min(2, len(handles)), frameon=False)
    return figure


def _norm(halting: NDArray[np.float64]) -> Normalize:
    """Return the colours' scale."""
    halting = halting[np.isfinite(halting)]
    # Without any halt the scale does not matter, but there must be one
    low, high = (halting.min(), halting.max()) if len(halting) else (1.0, 2.0)
    # Late halts are rare: on a linear scale most of a map would have one colour
    return LogNorm(low, high) if high > 3 * low > 0 else Normalize(low, high)


def _scatter(axes: Axes, panel: _Panel, norm: Normalize) -> dict[int, Any]:
    """Draw runs of a sample; return code -> what the legend shows of the endings of those that do not halt."""
    halt, end = panel.data["halting_time"].values, panel.data["end"].values
    halts = np.isfinite(halt)
    across, up = _values(panel.x, panel.data), _values(panel.y, panel.data)
    handles = {}
    for code in map(int, np.unique(end[~halts])):
        here, marker = ~halts & (end == code), MARKERS[code % len(MARKERS)]
        axes.plot(across[here], up[here], marker, ms=3, color="0.6", mew=0.6, zorder=1)
        handles[code] = Line2D([], [], ls="", marker=marker, color="0.6", label=NO_HALT[ENDINGS[code]])
    axes.scatter(across[halts], up[halts], c=halt[halts], s=5, cmap=MAP, norm=norm, linewidths=0, zorder=2)
    return handles


def _heat(axes: Axes, panel: _Panel, norm: Normalize) -> dict[int, Any]:
    """Draw runs of a grid; return code -> what the legend shows of the endings of those that do not halt."""
    one = panel.data.transpose(panel.y.name, panel.x.name)
    halt, end = one["halting_time"].values, one["end"].values
    (across, right), (up, top) = (_edges(axis, _values(axis, one)) for axis in (panel.x, panel.y))
    axes.pcolormesh(right, top, np.ma.masked_invalid(halt), cmap=MAP, norm=norm)
    without = ~np.isfinite(halt)
    handles = {}
    for code in map(int, np.unique(end[without])):
        here = without & (end == code)
        grey, hatch = GREYS[code % len(GREYS)], HATCHES[code % len(HATCHES)]
        handles[code] = Patch(facecolor=grey, edgecolor="0.45", hatch=hatch, lw=0, label=NO_HALT[ENDINGS[code]])
        shade = np.ma.masked_where(~here, np.full(here.shape, float(grey)))
        axes.pcolormesh(right, top, shade, cmap="gray", vmin=0, vmax=1)
        if hatch:
            # A pseudocolour plot cannot be hatched, a filled contour can; it reaches from centre to centre, so half a cell is
            # added around
            wide = np.pad(here.astype(float), 1, mode="edge")
            around = axes.contourf(across, up, wide, levels=[0.5, 1.5], colors="none", hatches=[hatch])
            around.set_edgecolor("0.45")
            around.set_linewidth(0)
    return handles


def _edges(axis: Axis, centres: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the centres of the cells with the outermost edges before and after them, and all edges."""
    # Edges lie in the middle as the axis shows it
    on = np.log(centres) if axis.logarithmic else centres
    between = (on[1:] + on[:-1]) / 2
    edges = np.concatenate([[on[0] - (between[0] - on[0])], between, [on[-1] + (on[-1] - between[-1])]])
    edges = np.exp(edges) if axis.logarithmic else edges
    return np.concatenate([edges[:1], centres, edges[-1:]]), edges
