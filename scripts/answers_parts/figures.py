"""The figures of the page, drawn from the committed summaries alone. One column of a journal is 86 mm, two are 178 mm wide."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from looping_pendulum.pages.palette import COLOURS

from .common import CASES, IMAGES, read, read_map

ONE, TWO = 86 / 25.4, 178 / 25.4
"""Widths [inch]."""
LOOK = {
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
SHORT = {"scenario": "scenario", "as_2_to_1": "as 2:1 trial", "as_10_to_1": "as 10:1 trial"}
NO_HALT = "0.88"
"""Grey of a map where nothing halts."""


def draw() -> list[Path]:
    """Draw every figure; return where they are."""
    figures: dict[str, Callable[[], Figure]] = {
        "four-angles": four_angles,
        "precision": precision,
        "growth": growth,
        "boundaries": boundaries,
        "uncertainty": uncertainty,
        "halting-map": halting_map,
        "lowest-ratio": lowest_ratio,
        "mass-scale": mass_scale,
        "friction-radius": friction_radius,
    }
    paths = []
    for name, make in figures.items():
        with mpl.rc_context(LOOK):
            figure = make()
            FigureCanvasAgg(figure)
            path = IMAGES / f"answers-{name}.png"
            figure.savefig(path, dpi=200, metadata={"Software": None})
        paths.append(path)
    return paths


def _panels(width: float, height: float, columns: int = 1, **options: Any) -> tuple[Figure, list[Axes]]:
    figure = Figure(figsize=(width, height), layout="constrained")
    axes = figure.subplots(1, columns, **options)
    return figure, [axes] if columns == 1 else list(axes)


def _numbers(values: list[float | None]) -> np.ndarray:
    return np.array([math.nan if v is None else v for v in values], dtype=float)


def four_angles() -> Figure:
    """Drop of the heavy mass at the paper's four angles: exact, and with coarse steps."""
    data = read("plain_programs")
    curves = data["curves"]
    figure, axes = _panels(TWO, 2.5, 2, sharey=True)
    titles = {"exact": "exact", "rk4": f"Runge-Kutta, steps of {1e3 * data['drawn_step']:g} ms"}
    for axis, (kind, title) in zip(axes, titles.items(), strict=True):
        for k, curve in enumerate(curves[kind]):
            t, drop = np.array(curve["t"]), 1e3 * np.array(curve["drop"])
            axis.plot(t, drop, color=COLOURS[k], label=f"{curve['angle']:g}°", ls=("-", "--", "-.", ":")[k])
        axis.set_title(f"({'ab'[kind == 'rk4']}) {title}")
        axis.set_xlabel("time [s]")
        axis.set_xlim(0, 3.0)
        axis.set_ylim(600, 0)
    axes[0].set_ylabel("drop of heavy mass [mm]")
    axes[0].legend(title="release angle", loc="upper right")
    return figure


def precision() -> Figure:
    """Deviation of the halting time from 128 bits against the tolerance."""
    angles = read("four_angles")["scenario"]
    figure, (axis,) = _panels(ONE, 2.6)
    for k, (solver, marker) in enumerate((("heyoka", "o"), ("scipy", "s"))):
        for j, told in enumerate(angles.values()):
            pairs = [
                (float(label.split()[1]), abs(value))
                for label, value in told["deviations"].items()
                if label.startswith(solver) and "bit" not in label
            ]
            x, y = np.array(sorted(pairs)).T
            label = {"heyoka": "Taylor (heyoka)", "scipy": "DOP853 (SciPy)"}[solver] if j == 0 else None
            axis.loglog(x, np.maximum(y, 1e-17), marker=marker, ms=3, lw=0.6, color=COLOURS[k], label=label)
    axis.axhspan(1e-17, 2.3e-16, color="0.92", lw=0)
    axis.text(1.3e-15, 2.5e-17, "rounding of the result", fontsize=6, color="0.3")
    spread = _spread(angles)
    axis.axhline(spread, color="k", ls=":", lw=0.8)
    axis.text(1.3e-15, spread * 1.5, "between the four angles", fontsize=6)
    axis.set_xlabel("relative tolerance of a step")
    axis.set_ylabel("error of the halting time [s]")
    axis.set_ylim(1e-17, 1e-1)
    axis.legend(loc="center left", bbox_to_anchor=(0.0, 0.72))
    return figure


def _spread(angles: dict[str, Any]) -> float:
    times = [float(told["told_time"]) for told in angles.values()]
    return max(times) - min(times)


def growth() -> Figure:
    """Greatest growth along the runs at 75 degrees, and to the halt over the angle."""
    data = read("growth")
    figure, (left, right) = _panels(TWO, 2.5, 2)
    for k, name in enumerate(CASES):
        found = data[name]
        left.semilogy(found["t"], found["growth"], color=COLOURS[k], label=SHORT[name])
        left.semilogy(found["at_last_stop"]["t"], found["at_last_stop"]["growth"], "o", ms=4, color=COLOURS[k])
    left.set_xlabel("time [s]")
    left.set_ylabel("greatest growth of a difference")
    left.set_title("(a) released at 75°; dot: last stop")
    left.legend(loc="upper left")
    rows = data["over_angle"]
    angle = np.array([r["angle"] for r in rows])
    value = np.array([r["growth"] for r in rows])
    halts = np.array([r["halts"] for r in rows])
    right.semilogy(angle[halts], value[halts], "o", ms=2.5, color=COLOURS[0], label="to the halt")
    right.semilogy(angle[~halts], value[~halts], "x", ms=3, color="0.5", label="no halt: to the last stop")
    right.set_xlabel("release angle [deg]")
    right.set_title("(b) scenario, to the last stop")
    right.legend(loc="upper left")
    return figure


def boundaries() -> Figure:
    """Halting time over the angle, and how the two sides of each change come together."""
    data = read("along_the_angle")
    figure, (left, right) = _panels(TWO, 2.6, 2, width_ratios=(1.5, 1))
    left.plot(data["angle"], _numbers(data["halting_time"]), ".", ms=1.5, color=COLOURS[0])
    for change in data["equal"]:
        left.axvline(change["angle"], color="0.8", lw=0.4, zorder=0)
    left.axvspan(75.0, 75.3, color=COLOURS[1], alpha=0.5, lw=0, zorder=0)
    left.set_xlabel("release angle [deg]")
    left.set_ylabel("halting time [s]")
    left.set_title("(a) grey: sequence changes; orange: 75.0–75.3°")
    left.set_xlim(60, 130)
    widths = data["equal"][0]["gap_widths_deg"]
    for k, (kind, label) in enumerate((("equal", "static = kinetic"), ("static_above", "static 16 % higher"))):
        gaps = np.array([_numbers(c["gap"]) for c in data[kind]])
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
    right.set_xlabel("distance of the two releases [deg]")
    right.set_ylabel("largest distance of the runs [mm]")
    right.set_title("(b) two runs across a change")
    right.legend(loc="lower right")
    return figure


def uncertainty() -> Figure:
    """Fraction of uncertain releases against the distance."""
    data = read("exponents")
    eps = np.array(data["eps"])
    figure, (axis,) = _panels(ONE, 2.6)
    labels = {"line": "along the angle, $M_2/M_1=2.5$", "plane": "over angle and $M_2/M_1$"}
    for k, (name, label) in enumerate(labels.items()):
        rows = np.array([_numbers(r) for r in data[name]["fractions"]])
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
    axis.set_xlabel("distance ε [part of the range]")
    axis.set_ylabel("fraction of uncertain releases")
    axis.legend(loc="upper left", fontsize=6)
    axis.set_ylim(1e-8, 30)
    return figure


def _map_axis(figure: Figure, axis: Axes, x: np.ndarray, y: np.ndarray, z: np.ndarray, label: str, **limits: float) -> None:
    axis.set_facecolor(NO_HALT)
    image = axis.pcolormesh(x, y, z, shading="nearest", rasterized=True, cmap="cividis", **limits)
    figure.colorbar(image, ax=axis, label=label, pad=0.02)


def halting_map() -> Figure:
    """Halting time and number of stops over release angle and mass ratio."""
    data = read_map("halting_map")
    angle, ratio = np.degrees(data["release_angle"]), data["mass_ratio"]
    halts = np.isfinite(data["halting_time"])
    figure, (left, right) = _panels(TWO, 2.9, 2, sharey=True)
    _map_axis(figure, left, angle, ratio, data["halting_time"].T, "halting time [s]", vmin=0.0, vmax=3.0)
    stops = np.where(halts, data["stops"], np.nan).T
    _map_axis(figure, right, angle, ratio, np.minimum(stops, 8), "stops up to the halt (8: or more)", vmin=1, vmax=8)
    for axis, title in ((left, "(a) when it halts"), (right, "(b) how often it stops")):
        axis.set_xlabel("release angle [deg]")
        axis.set_title(title + "; grey: it does not halt")
        axis.plot([75.0, 75.3], [2.5, 2.5], color="w", lw=3)
    left.set_ylabel("mass ratio $M_2/M_1$")
    return figure


def lowest_ratio() -> Figure:
    """Lowest ratio that halts, for each release angle and case, and for shorter watches."""
    data = read("lowest_ratio")
    figure, (left, right) = _panels(TWO, 2.5, 2, sharey=True)
    for k, name in enumerate(CASES):
        found = data[name]
        left.plot(found["angle"], _numbers(found["edge"]), marker="osD"[k], ms=2, lw=0.5, color=COLOURS[k], label=SHORT[name])
        left.plot(found["best"]["angle"], found["best"]["ratio"], "*", ms=8, color=COLOURS[k])
    for k, watch in enumerate(data["watched"]):
        row = data["scenario"]["watched"][f"{watch:g}"]
        right.plot(data["scenario"]["angle"], _numbers(row), marker=".", ms=2, lw=0.5, color=COLOURS[k], label=f"{watch:g} s")
    for axis, title in ((left, f"(a) within {data['watched'][-1]:g} s; star: lowest"), (right, "(b) scenario, within")):
        axis.set_xlabel("release angle [deg]")
        axis.set_title(title)
        axis.legend(loc="best")
    left.set_ylabel("lowest $M_2/M_1$ that halts")
    return figure


def mass_scale() -> Figure:
    """Halting time over the factor on both masses."""
    data = read("mass_scale")
    scale = np.array(data["scale"])
    figure, (left, right) = _panels(TWO, 2.5, 2)
    for k, row in enumerate(data["ratios"]):
        limit = row["without_drag"]
        left.semilogx(scale, _numbers(row["halting_time"]), color=COLOURS[k], label=f"{row['ratio']:g}")
        if limit is None:
            continue
        left.axhline(limit, color=COLOURS[k], ls=":", lw=0.6)
        for kind, style in (("halting_time", "-"), ("as_solids", "--")):
            apart = np.abs(_numbers(row[kind]) - limit)
            right.loglog(scale, 1e3 * apart, color=COLOURS[k], ls=style)
    left.set_xlabel("factor on both masses")
    left.set_ylabel("halting time [s]")
    left.set_title("(a) drag coefficients kept; dotted: without drag")
    left.legend(title="$M_2/M_1$")
    right.set_xlabel("factor on both masses")
    right.set_ylabel("change by drag [ms]")
    right.set_title("(b) solid: drag kept; dashed: drag as area")
    return figure


def friction_radius() -> Figure:
    """Halting time over friction and rod radius."""
    data = read_map("friction_and_radius")
    at = read("friction_and_radius")["at"]
    figure, (axis,) = _panels(ONE, 2.7)
    radius, friction = 1e3 * data["rod_radius"], data["kinetic_friction"]
    _map_axis(figure, axis, radius, friction, data["halting_time"], "halting time [s]", vmin=0.0, vmax=2.0)
    axis.plot(1e3 * at["radius"], at["friction"], "+", color="w", ms=8, mew=1.5)  # the paper's trial
    axis.set_xlabel("rod radius [mm]")
    axis.set_ylabel("friction coefficient")
    return figure
