"""The figures of docs/accuracy.md and the table of its times, from the stored engine study."""

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from looping_pendulum.compare.convergence.limit import refinement_sizes
from looping_pendulum.compare.convergence.result import (
    ConvergenceResult,
    LadderStudy,
    VariantStudy,
)
from looping_pendulum.engines.registry import styles
from looping_pendulum.pages.drawing import legend_below, make_figure
from looping_pendulum.pages.markdown import table
from looping_pendulum.pages.numbers import number
from looping_pendulum.pages.palette import COLOURS, GREY, MARKERS
from research.stored_study import MARK, EngineStudy, Point, front

TARGET = 60.0
"""CPU seconds per simulated second that a chain may take: a run of 0.7 s then takes less than a minute."""
KINDS = {
    "time step": ("time_step",),
    "link length": ("bend", "link_length", "segment_length", "elements"),
    "softness": ("time_constant", "stiffness", "compliance", "stiction_tolerance", "contact_slop", "error_rate", "hertz"),
    "solver's effort": ("iterations", "sub_steps", "solver_iterations", "substeps", "tolerance"),
    "string's mass": ("mass_fraction", "bead_mass_ratio"),
}
"""Kind of a ladder -> endings of the names of the settings that it refines."""
OTHER = "other"
COLUMNS, WIDTH, ROW_HEIGHT, LEGEND_HEIGHT = 3, 4.8, 1.25, 0.8
"""Panels beside each other, and sizes [in]: at this width the letters can be read on a phone."""
ERRORS = (1e-4, 1e3)
"""Limits of the errors' axis [mm]; smaller errors are drawn on its lower edge."""


def speed_table(study: EngineStudy) -> str:
    """Return a row for every timed setting: its error, its times, and whether any engine's point beats it."""
    best = {p.key for p in front(study.pareto)}
    contact = {p.key for p in front(p for p in study.pareto if p.contact)}
    head = ["variant", "setting", "no point is faster and more accurate", "RMS to 0.7 s [mm]", "CPU s per s", "wall s per s"]
    rows = []
    for p in sorted(study.pareto, key=lambda p: (p.variant, p.cpu)):
        beaten = "of all" if p.key in best else "of those with a law of their own" if p.key in contact else ""
        times = [number(x, digits=2) for x in (p.cpu, p.wall)]
        rows.append(
            [p.variant, p.where or "its own", beaten, number(1e3 * p.rms), *times, str(p.runs), number(p.slowest, digits=2)]
        )
    return table([*head, "runs", "slowest [wall s per s]"], rows, left=3)


def kind_of_ladder(setting: str) -> str:
    """Return the kind of the ladder that refines ``setting``."""
    return next((name for name, endings in KINDS.items() if setting.endswith(endings)), OTHER)


def ladder_line(v: VariantStudy, ladder: LadderStudy) -> tuple[list[float], list[float]]:
    """Return refinement against the variant's own setting, and error [mm], of each rung that has one."""
    sizes = refinement_sizes([rung.value for rung in ladder.rungs])
    own = next((h for h, rung in zip(sizes, ladder.rungs, strict=True) if rung.run.key == v.own.key), None)
    if own is None and ladder.own:
        rises = ladder.rungs[0].value < ladder.rungs[-1].value
        own = 1 / ladder.own if rises else ladder.own
    refinement, errors = [], []
    for h, rung in zip(sizes, ladder.rungs, strict=True):
        rms = rung.run.errors[MARK]
        if rms is not None and rung.run.ok and h > 0:
            refinement.append(float((own or sizes[0]) / h))
            errors.append(max(1e3 * rms, ERRORS[0]))
    return refinement, errors


def ladders_figure(result: ConvergenceResult) -> Figure:
    """Draw a panel for each variant that has a ladder with two rungs to 0.7 s; the reference is left out."""
    panels = {}
    for v in result.variants:
        lines = [(kind_of_ladder(ladder.setting), *ladder_line(v, ladder)) for ladder in v.ladders]
        lines = [line for line in lines if len(line[1]) > 1]
        if lines and v.engine != "reference":
            panels[v.label] = lines
    rows = math.ceil(len(panels) / COLUMNS)
    picture = Figure(figsize=(WIDTH, rows * ROW_HEIGHT + LEGEND_HEIGHT), dpi=180, layout="constrained")
    FigureCanvasAgg(picture)
    grid = picture.subplots(rows, COLUMNS, sharex=True, sharey=True, squeeze=False).ravel()
    look = {name: (COLOURS[k], MARKERS[k]) for k, name in enumerate((*KINDS, OTHER))}
    used = {name for lines in panels.values() for name, _, _ in lines}
    for axes, (label, lines) in zip(grid, panels.items(), strict=False):
        for name, x, y in lines:
            colour, marker = look[name]
            axes.plot(x, y, color=colour, marker=marker, ms=2.8, lw=1.0, clip_on=False, zorder=3)
        axes.axvline(1.0, color="0.6", lw=0.7)
        axes.set_title(label, fontsize=7.5, pad=2.5)
        axes.set(xscale="log", yscale="log", ylim=ERRORS)
        axes.set_yticks([1e-4, 1e-2, 1, 1e2], ["1e-4", "0.01", "1", "100"])
        axes.set_xticks([0.1, 1, 10], ["1/10", "1", "10"])
        axes.minorticks_off()
        axes.tick_params(labelsize=7, length=2)
        axes.grid(True, color="0.92", lw=0.6)
    for axes in grid[len(panels) :]:
        axes.set_visible(False)
    for axes in grid[len(panels) - COLUMNS : len(panels)]:
        # Above a hidden panel, too
        axes.tick_params(labelbottom=True)
    picture.supxlabel("refinement: own setting = 1, finer to the right", fontsize=8)
    picture.supylabel("RMS to 0.7 s against the reference [mm]", fontsize=8)
    handles = [Line2D([], [], color=c, marker=m, ms=4, label=name) for name, (c, m) in look.items() if name in used]
    picture.legend(handles=handles, loc="outside upper center", ncols=3, frameon=False, fontsize=8)
    return picture


def pareto_figure(timed_points: Sequence[Point]) -> Figure:
    """Draw error against time, log-log, with the Pareto fronts of all engines and of those that supply winding and friction."""
    picture, (axes,) = make_figure(8.4, 6.8)
    look = styles(p.variant for p in timed_points)
    for variant in dict.fromkeys(p.variant for p in timed_points):
        mine = [p for p in timed_points if p.variant == variant]
        style = look[variant]
        fill = style.colour if mine[0].contact else "white"
        xy = np.array([(p.cpu, 1e3 * p.rms) for p in mine]).T
        axes.plot(*xy, ls="none", marker=style.marker, ms=5.5, color=style.colour, mfc=fill, label=variant)
    for chosen, line, name in (
        (front(timed_points), "-", "no engine beats these"),
        (front(p for p in timed_points if p.contact), "--", "nor these, law its own"),
    ):
        axes.plot([p.cpu for p in chosen], [1e3 * p.rms for p in chosen], line, color="black", lw=1.0, zorder=1, label=name)
    axes.axvline(TARGET, color=GREY, lw=0.9, dashes=(1, 2), label=f"target {TARGET:g} s per s")
    axes.set(
        xscale="log", yscale="log", xlabel="CPU seconds per simulated second", ylabel="RMS to 0.7 s against the reference [mm]"
    )
    axes.set_title("Speed against accuracy; open marks: the adapter feeds a law in")
    legend_below(picture)
    return picture
