"""Draw the figures of the page from the committed summaries. One column of a journal is 86 mm wide, two columns are 178 mm."""

import math
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from looping_pendulum.pages.palette import COLOURS
from research import IMAGES

from .common import CASES, read, read_map

COLUMN_WIDTH, PAGE_WIDTH = 86 / 25.4, 178 / 25.4
"""Widths of a figure over one column and over two columns [inch]."""
RC_PARAMS = {
    "font.size": 8,
    "axes.labelsize": 8,
    "axes.titlesize": 8,
    "legend.fontsize": 7,
    "xtick.labelsize": 7,
    "ytick.labelsize": 7,
    "axes.linewidth": 0.6,
    "lines.linewidth": 1.0,
    "legend.frameon": False,
    "image.cmap": "cividis",
}
CASE_LABELS = {"scenario": "scenario", "as_2_to_1": "as 2:1 trial", "as_10_to_1": "as 10:1 trial"}
NO_HALT_GREY = "0.88"
"""Grey level of a map where the heavy mass does not halt."""


def draw() -> list[Path]:
    """Draw every figure and return the paths."""
    figures = (
        *(four_angles, precision, growth, boundaries, uncertainty),
        *(halting_map, lowest_ratio, mass_scale, friction_radius),
    )
    paths = []
    for make in figures:
        with mpl.rc_context(RC_PARAMS):
            figure = make()
            FigureCanvasAgg(figure)
            path = IMAGES / f"answers-{make.__name__.replace('_', '-')}.png"
            figure.savefig(path, dpi=200, metadata={"Software": None})
        paths.append(path)
    return paths


def _panels(width: float, height: float, columns: int = 1, **options: Any) -> tuple[Figure, list[Axes]]:
    figure = Figure(figsize=(width, height), layout="constrained")
    axes = figure.subplots(1, columns, **options)
    return figure, [axes] if columns == 1 else list(axes)


def _with_nan(values: list[float | None]) -> np.ndarray:
    return np.array([math.nan if v is None else v for v in values], dtype=float)


def four_angles() -> Figure:
    """Draw the drop of the heavy mass at the paper's four angles: by the reference, and with coarse steps."""
    data = read("plain_programs")
    curves = data["curves"]
    figure, axes = _panels(PAGE_WIDTH, 2.5, 2, sharey=True)
    titles = {"exact": "exact", "rk4": f"Runge-Kutta, steps of {1e3 * data['drawn_step']:g} ms"}
    for axis, (kind, title) in zip(axes, titles.items(), strict=True):
        for k, curve in enumerate(curves[kind]):
            t, drop = np.array(curve["t"]), 1e3 * np.array(curve["drop"])
            axis.plot(t, drop, color=COLOURS[k], label=f"{curve['angle']:g}°", ls=("-", "--", "-.", ":")[k])
        axis.set(title=f"({'ab'[kind == 'rk4']}) {title}", xlabel="time [s]", xlim=(0, 3.0), ylim=(600, 0))
    axes[0].set_ylabel("drop of heavy mass [mm]")
    axes[0].legend(title="release angle", loc="upper right")
    return figure


def precision() -> Figure:
    """Draw the deviation of the halting time from the 128-bit run over the tolerance."""
    angles = read("four_angles")["scenario"]
    figure, (axis,) = _panels(COLUMN_WIDTH, 2.6)
    for k, (solver, marker) in enumerate((("heyoka", "o"), ("reference", "s"))):
        for j, angle_summary in enumerate(angles.values()):
            pairs = [
                (float(label.split()[1]), abs(value))
                for label, value in angle_summary["deviations"].items()
                if label.startswith(solver) and "bit" not in label
            ]
            x, y = np.array(sorted(pairs)).T
            label = {"heyoka": "Taylor (heyoka)", "reference": "DOP853 (reference)"}[solver] if j == 0 else None
            axis.loglog(x, np.maximum(y, 1e-17), marker=marker, ms=3, lw=0.6, color=COLOURS[k], label=label)
    axis.axhspan(1e-17, 2.3e-16, color="0.92", lw=0)
    axis.text(1.3e-15, 2.5e-17, "rounding of the result", fontsize=6, color="0.3")
    spread = _spread(angles)
    axis.axhline(spread, color="k", ls=":", lw=0.8)
    axis.text(1.3e-15, spread * 1.5, "between the four angles", fontsize=6)
    axis.set(xlabel="relative tolerance of a step", ylabel="error of the halting time [s]", ylim=(1e-17, 1e-1))
    axis.legend(loc="center left", bbox_to_anchor=(0.0, 0.72))
    return figure


def _spread(angles: dict[str, Any]) -> float:
    times = [float(angle_summary["reported_time"]) for angle_summary in angles.values()]
    return max(times) - min(times)


def growth() -> Figure:
    """Draw the largest growth of a difference along the runs at 75 degrees, and up to the halt over the angle."""
    data = read("growth")
    figure, (left, right) = _panels(PAGE_WIDTH, 2.5, 2)
    for k, name in enumerate(CASES):
        summary = data[name]
        left.semilogy(summary["t"], summary["growth"], color=COLOURS[k], label=CASE_LABELS[name])
        left.semilogy(summary["at_last_stop"]["t"], summary["at_last_stop"]["growth"], "o", ms=4, color=COLOURS[k])
    left.set(xlabel="time [s]", ylabel="greatest growth of a difference", title="(a) released at 75°; dot: last stop")
    left.legend(loc="upper left")
    rows = data["over_angle"]
    angle = np.array([r["angle"] for r in rows])
    value = np.array([r["growth"] for r in rows])
    halts = np.array([r["halts"] for r in rows])
    right.semilogy(angle[halts], value[halts], "o", ms=2.5, color=COLOURS[0], label="to the halt")
    right.semilogy(angle[~halts], value[~halts], "x", ms=3, color="0.5", label="no halt: to the last stop")
    right.set(xlabel="release angle [deg]", title="(b) scenario, to the last stop")
    right.legend(loc="upper left")
    return figure


def boundaries() -> Figure:
    """Draw the halting time over the angle, and the distance between the motions on the two sides of each change."""
    data = read("along_the_angle")
    figure, (left, right) = _panels(PAGE_WIDTH, 2.6, 2, width_ratios=(1.5, 1))
    left.plot(data["angle"], _with_nan(data["halting_time"]), ".", ms=1.5, color=COLOURS[0])
    for change in data["equal"]:
        left.axvline(change["angle"], color="0.8", lw=0.4, zorder=0)
    left.axvspan(75.0, 75.3, color=COLOURS[1], alpha=0.5, lw=0, zorder=0)
    left.set(
        xlabel="release angle [deg]",
        ylabel="halting time [s]",
        title="(a) grey: sequence changes; orange: 75.0–75.3°",
        xlim=(60, 130),
    )
    widths = data["equal"][0]["gap_widths_deg"]
    for k, (kind, label) in enumerate((("equal", "static = kinetic"), ("static_above", "static 16 % higher"))):
        gaps = np.array([_with_nan(c["gap"]) for c in data[kind]])
        offset = (1.0, 1.25)[k]
        for j, row in enumerate(gaps):
            right.loglog(
                np.array(widths) * offset,
                1e3 * row,
                marker="os"[k],
                ms=2.5,
                lw=0.4,
                color=COLOURS[k],
                alpha=0.6,
                label=label if j == 0 else None,
            )
    right.set(
        xlabel="distance of the two releases [deg]",
        ylabel="largest distance of the runs [mm]",
        title="(b) two runs across a change",
    )
    right.legend(loc="lower right")
    return figure


def uncertainty() -> Figure:
    """Draw the fraction of uncertain releases over the distance."""
    data = read("exponents")
    eps = np.array(data["eps"])
    figure, (axis,) = _panels(COLUMN_WIDTH, 2.6)
    labels = {"line": "along the angle, $M_2/M_1=2.5$", "plane": "over angle and $M_2/M_1$"}
    for k, (name, label) in enumerate(labels.items()):
        rows = np.array([_with_nan(r) for r in data[name]["fractions"]])
        axis.loglog(eps, rows.T, color=COLOURS[k], lw=0.3, alpha=0.5)
        axis.loglog(
            eps,
            rows.mean(axis=0),
            marker="os"[k],
            ms=3,
            color=COLOURS[k],
            label=f"{label}: α = {data[name]['exponent']:.3f} ± {data[name]['standard_error']:.3f}",
        )
    axis.loglog(eps, 0.3 * eps / eps[0] * 0.2, "k:", lw=0.8, label="slope 1")
    axis.set(xlabel="distance ε [part of the range]", ylabel="fraction of uncertain releases")
    axis.legend(loc="upper left", fontsize=6)
    axis.set_ylim(1e-8, 30)
    return figure


def _map_axis(figure: Figure, axis: Axes, x: np.ndarray, y: np.ndarray, z: np.ndarray, label: str, **limits: float) -> None:
    axis.set_facecolor(NO_HALT_GREY)
    image = axis.pcolormesh(x, y, z, shading="nearest", rasterized=True, cmap="cividis", **limits)
    figure.colorbar(image, ax=axis, label=label, pad=0.02)


def halting_map() -> Figure:
    """Draw halting time and number of stops over release angle and mass ratio."""
    data = read_map("halting_map")
    angle, ratio = np.degrees(data["release_angle"]), data["mass_ratio"]
    halts = np.isfinite(data["halting_time"])
    figure, (left, right) = _panels(PAGE_WIDTH, 2.9, 2, sharey=True)
    _map_axis(figure, left, angle, ratio, data["halting_time"].T, "halting time [s]", vmin=0.0, vmax=3.0)
    stops = np.where(halts, data["stops"], np.nan).T
    _map_axis(figure, right, angle, ratio, np.minimum(stops, 8), "stops up to the halt (8: or more)", vmin=1, vmax=8)
    for axis, title in ((left, "(a) when it halts"), (right, "(b) how often it stops")):
        axis.set(xlabel="release angle [deg]", title=title + "; grey: it does not halt")
        axis.plot([75.0, 75.3], [2.5, 2.5], color="w", lw=3)
    left.set_ylabel("mass ratio $M_2/M_1$")
    return figure


def lowest_ratio() -> Figure:
    """Draw the lowest ratio that halts, for each release angle and case, and for shorter time limits."""
    data = read("lowest_ratio")
    figure, (left, right) = _panels(PAGE_WIDTH, 2.5, 2, sharey=True)
    for k, name in enumerate(CASES):
        summary = data[name]
        left.plot(
            summary["angle"],
            _with_nan(summary["edge"]),
            marker="osD"[k],
            ms=2,
            lw=0.5,
            color=COLOURS[k],
            label=CASE_LABELS[name],
        )
        left.plot(summary["best"]["angle"], summary["best"]["ratio"], "*", ms=8, color=COLOURS[k])
    for k, watch in enumerate(data["watched"]):
        row = data["scenario"]["watched"][f"{watch:g}"]
        right.plot(data["scenario"]["angle"], _with_nan(row), marker=".", ms=2, lw=0.5, color=COLOURS[k], label=f"{watch:g} s")
    for axis, title in ((left, f"(a) within {data['watched'][-1]:g} s; star: lowest"), (right, "(b) scenario, within")):
        axis.set(xlabel="release angle [deg]", title=title)
        axis.legend(loc="best")
    left.set_ylabel("lowest $M_2/M_1$ that halts")
    return figure


def mass_scale() -> Figure:
    """Draw the halting time over the factor on both masses."""
    data = read("mass_scale")
    scale = np.array(data["scale"])
    figure, (left, right) = _panels(PAGE_WIDTH, 2.5, 2)
    for k, row in enumerate(data["ratios"]):
        limit = row["without_drag"]
        left.semilogx(scale, _with_nan(row["halting_time"]), color=COLOURS[k], label=f"{row['ratio']:g}")
        if limit is None:
            continue
        left.axhline(limit, color=COLOURS[k], ls=":", lw=0.6)
        for kind, style in (("halting_time", "-"), ("as_solids", "--")):
            apart = np.abs(_with_nan(row[kind]) - limit)
            right.loglog(scale, 1e3 * apart, color=COLOURS[k], ls=style)
    left.set(
        xlabel="factor on both masses", ylabel="halting time [s]", title="(a) drag coefficients kept; dotted: without drag"
    )
    left.legend(title="$M_2/M_1$")
    right.set(xlabel="factor on both masses", ylabel="change by drag [ms]", title="(b) solid: drag kept; dashed: drag as area")
    return figure


def friction_radius() -> Figure:
    """Draw the halting time over friction and rod radius."""
    data = read_map("friction_and_radius")
    at = read("friction_and_radius")["at"]
    figure, (axis,) = _panels(COLUMN_WIDTH, 2.7)
    radius, friction = 1e3 * data["rod_radius"], data["kinetic_friction"]
    _map_axis(figure, axis, radius, friction, data["halting_time"], "halting time [s]", vmin=0.0, vmax=2.0)
    axis.plot(1e3 * at["radius"], at["friction"], "+", color="w", ms=8, mew=1.5)  # the paper's trial
    axis.set(xlabel="rod radius [mm]", ylabel="friction coefficient")
    return figure
