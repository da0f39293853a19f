"""Draws the figure of a map: halting time over the varied quantities; runs without a halt are grey, by their ending."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import FormatStrFormatter, LogFormatter, LogLocator, MaxNLocator
from numpy.typing import NDArray
from zarr.storage import LocalStore

from looping_pendulum.engines.registry import styles
from looping_pendulum.pages.drawing import new_figure, png
from looping_pendulum.reference_ode.transitions import Event
from looping_pendulum.sweep.cells import ENDING_DESCRIPTIONS, ENDINGS
from looping_pendulum.sweep.map_file import REFERENCE, MapPlan
from looping_pendulum.sweep.quantities import Axis

MAP = "viridis"
"""Matplotlib's colour map: safe for colour-blind readers, and monotone when printed in grey."""
GREYS = (0.82, 0.42)
"""Lightest and darkest grey of runs without a halt; their endings are evenly between them."""
MAX_CELLS = 1500
"""Largest number of values of an axis that are drawn; of more, every second or third is."""
MAX_POINTS = 20000
"""Largest number of runs of a sample that are drawn."""
MAX_PANELS = 9
"""Largest number of panels, one for each value of a third quantity."""
NO_HALT = {**ENDING_DESCRIPTIONS, str(Event.LIGHT_REACHES_ROD): "the light mass reached the rod, and M2 was not at rest"}
"""Ending of a run without a halt -> its description."""


def draw(plan: MapPlan, store: Path) -> tuple[str, bytes]:
    """Draw the figure; return its caption and the PNG."""
    varied = [axis for axis in plan.axes if plan.sample or len(axis.values) > 1] or [plan.axes[0]]
    # Of the quantities of a grid, those with the most values are drawn across and up; any other needs panels
    panels = [] if plan.sample else sorted(plan.axes, key=lambda axis: len(axis.values))[:-2]
    # As plain arrays, also where Dask is installed: it is loaded whole anyway
    with xr.open_zarr(LocalStore(store, read_only=True), chunks=None) as data:
        most = dict.fromkeys(data.dims, MAX_POINTS if plan.sample or len(plan.axes) == 1 else MAX_CELLS)
        most |= {axis.name: MAX_PANELS // len(plan.engines) or 1 for axis in panels}
        # Evenly spaced, with the first and the last
        drawn = {dim: np.linspace(0, n - 1, min(n, most[dim])).round().astype(int) for dim, n in data.sizes.items()}
        thin = data[["halting_time", "stops", "end"]].isel(drawn).load()
    is_whole = thin.sizes == data.sizes
    thin = thin.assign_coords({axis.name: thin[axis.name] / axis.scale for axis in plan.axes})
    if not plan.several:
        thin = thin.expand_dims(engine=list(plan.engines))
    over = " and ".join(axis.name for axis in varied)
    if len(varied) == 1:
        caption = f"Halting time and stops of the heavy mass over {over}; grey: runs that do not halt."
        figure = _lines(plan, thin, varied[0])
    else:
        caption = f"Halting time over {over}; grey: runs that do not halt, and how they end."
        figure = _map(plan, thin, panels)
    return caption if is_whole else f"{caption} Of so many runs, evenly chosen ones are drawn.", png(figure)


def _label(axis: Axis) -> str:
    return f"{axis.name.replace('_', ' ')}{f' [{axis.written}]' if axis.written else ''}"


def _scale(axis: Axis) -> str:
    return "log" if axis.logarithmic else "linear"


def _lines(plan: MapPlan, data: xr.Dataset, axis: Axis) -> Figure:
    """Draw one varied quantity: halting time above, number of stops below; ticks mark runs that do not halt."""
    figure = new_figure(7.6, 5.6, dpi=130)
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
    # Many points, or a sample's in any order, are not joined: the line would hide them
    few = plan.runs // len(plan.engines) <= 200 and not plan.sample
    look = styles(plan.engines)
    for i, engine in enumerate(plan.engines):
        x, halt, stops = (data.isel(engine=i)[name].values.ravel() for name in (axis.name, "halting_time", "stops"))
        colour = "black" if engine == REFERENCE else look[engine].colour
        how: dict[str, Any] = {"color": colour, "marker": "o", "ms": 4 if few else 2, "ls": "-" if few else "", "lw": 0.8}
        above.plot(x, halt, label=engine, **how)
        below.plot(x, np.where(stops < 0, np.nan, stops), **how)
        without = x[np.isnan(halt)]
        # In axes units from the bottom, each engine at a height of its own
        above.plot(without, np.full(len(without), 0.02 + 0.03 * i), "|", color="0.5", transform=above.get_xaxis_transform())
    above.set(ylabel="halting time [s]", title=plan.title)
    below.set(xlabel=_label(axis), xscale=_scale(axis), ylabel="stops of the heavy mass", ylim=(0, None))
    below.yaxis.set_major_locator(MaxNLocator(integer=True))
    if plan.several:
        above.legend(frameon=False)
    return figure


def _parts(plan: MapPlan, data: xr.Dataset, panels: list[Axis]) -> Iterator[tuple[str, Axis, Axis, xr.Dataset]]:
    """Yield title, quantities across and up, and runs of each panel: of an engine, and of a value of each of ``panels``."""
    pairs = itertools.combinations([axis for axis in plan.axes if axis not in panels], 2)
    stacked = data.stack(panel=["engine", *(axis.name for axis in panels)])
    for (x, y), i in itertools.product(pairs, range(stacked.sizes["panel"])):
        part = stacked.isel(panel=i)
        title = [part["engine"].item()] if plan.several else []
        title += [f"{_label(axis)} {part[axis.name].item():.4g}" for axis in panels]
        yield ", ".join(title), x, y, part


def _map(plan: MapPlan, data: xr.Dataset, panels: list[Axis]) -> Figure:
    """Draw the halting time over two quantities, of a grid in a panel for each value of ``panels``."""
    halting = data["halting_time"]
    codes = np.unique(data["end"].values[halting.isnull()])
    greys = np.linspace(*GREYS, len(codes))
    # Of the runs without a halt; those that halt are drawn over it
    data["grey"] = (halting.dims, np.interp(data["end"], codes, greys) if len(codes) else np.full(halting.shape, np.nan))
    parts = list(_parts(plan, data, panels))
    columns = 1 if len(parts) == 1 else 2 if len(parts) in (2, 4) else 3
    rows = math.ceil(len(parts) / columns)
    figure = new_figure(7.6, 5.6, dpi=130) if columns == 1 else new_figure(3.9 * columns, 3.5 * rows, dpi=130)
    grid = list(figure.subplots(rows, columns, squeeze=False).ravel())
    norm = _norm(halting.values)
    for axes, (title, x, y, part) in zip(grid, parts, strict=False):
        how: dict[str, Any] = {"x": x.name, "y": y.name, "ax": axes, "add_colorbar": False}
        how |= {"xscale": _scale(x), "yscale": _scale(y)}
        if plan.sample:
            how |= {"s": 5, "linewidths": 0}
            part.where(part["halting_time"].isnull()).plot.scatter(hue="grey", cmap="gray", vmin=0, vmax=1, **how)
            part.plot.scatter(hue="halting_time", cmap=MAP, norm=norm, **how)
        else:
            part["grey"].plot.pcolormesh(cmap="gray", vmin=0, vmax=1, **how)
            part["halting_time"].plot.pcolormesh(cmap=MAP, norm=norm, **how)
        axes.set(xlabel=_label(x), ylabel=_label(y))
        for drawn, axis in ((x, axes.xaxis), (y, axes.yaxis)):
            if drawn.logarithmic:  # 6, where Matplotlib has 6 x 10^0
                axis.set_major_formatter(LogFormatter())
                axis.set_minor_formatter(LogFormatter())
        axes.set_title(title, fontsize="medium")
    for axes in grid[len(parts) :]:
        axes.set_axis_off()
    _add_colour_bar(figure, grid, norm)
    figure.suptitle(plan.title)
    if len(codes):
        legend = [Patch(facecolor=f"{grey}", label=NO_HALT[ENDINGS[code]]) for code, grey in zip(codes, greys, strict=True)]
        figure.legend(handles=legend, loc="outside lower center", ncols=min(2, len(codes)), frameon=False)
    return figure


def _norm(halting: NDArray[np.float64]) -> Normalize:
    """Return the colours' scale."""
    halting = halting[np.isfinite(halting)]
    # Without any halt the scale does not matter, but there must be one
    low, high = (halting.min(), halting.max()) if len(halting) else (1.0, 2.0)
    # Late halts are rare: on a linear scale most of a map would have one colour
    return LogNorm(low, high) if high > 3 * low > 0 else Normalize(low, high)


def _add_colour_bar(figure: Figure, grid: list[Axes], norm: Normalize) -> None:
    bar = figure.colorbar(ScalarMappable(norm=norm, cmap=MAP), ax=grid, label="halting time [s]", shrink=0.9)
    if isinstance(norm, LogNorm):
        # Matplotlib labels only the decades, of which a range of halting times may have none
        bar.ax.yaxis.set_major_locator(LogLocator(subs=(1, 2, 3, 5)))
        bar.ax.yaxis.set_major_formatter(FormatStrFormatter("%g"))
        bar.ax.minorticks_off()
