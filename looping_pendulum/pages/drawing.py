"""What all figures that Matplotlib draws have in common. It is imported on use, since that takes a second."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Any, Literal

from looping_pendulum.files import utf8
from looping_pendulum.pages.chart import BLACK, LIGHT_GREY, Axis, Chart, Curve, Panel

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MAX_LABEL_LENGTH = 50
"""Characters of a name that a figure shows: a longer one would leave no room for the axes."""
GUIDES, CURVES, DISC, MARKS = 1, 2, 4, 6
"""Order of drawing; curves above each other are a thousandth apart."""


def draw(chart: Chart) -> Figure:
    """Return a chart as Matplotlib's figure."""
    figure, all_axes = make_figure(*chart.size, rows=tuple(panel.height for panel in chart.panels))
    for axes, panel in zip(all_axes, chart.panels, strict=True):
        _draw_panel(axes, panel)
        _set_axis(axes, "y", panel.y)
    _set_axis(all_axes[-1], "x", chart.x)
    if chart.to_scale:
        all_axes[0].set_aspect("equal")
    # Slanted words above the axes need room below the title
    pad = 58 if any(guide.text for panel in chart.panels for guide in panel.guides) else None
    all_axes[0].set_title(f"{without_mathtext(chart.subject)}: {chart.title}", pad=pad)
    legend_below(figure)
    return figure


def _draw_panel(axes: Axes, panel: Panel) -> None:
    from matplotlib.patches import Circle

    for guide in panel.guides:
        look: dict[str, Any] = {"color": guide.colour, "lw": 0.8 if guide.dotted else 0.9, "zorder": GUIDES}
        if guide.dotted:
            look["dashes"] = (1, 2)
        if guide.y is not None:
            axes.axhline(guide.y, **look)
        if guide.x is not None:
            axes.axvline(guide.x, **look)
            place: dict[str, Any] = {"transform": axes.get_xaxis_transform(), "rotation": 40, "ha": "left", "va": "bottom"}
            axes.text(guide.x, 1.01, guide.text, fontsize=8, color="0.25", **place)
    for order, curve in enumerate(panel.curves):
        look = curve_look(curve) | {"zorder": (MARKS if curve.marker in ("*", "x") else CURVES) + order / 1000}
        look["label"] = without_mathtext(curve.label) if curve.in_legend else None
        if curve.bar is None:
            axes.plot(curve.x, curve.y, **look)
        else:
            axes.errorbar(curve.x, curve.y, xerr=curve.bar, yerr=curve.bar, capsize=3, **look)
    if panel.disc is not None:
        axes.add_patch(Circle((0, 0), panel.disc, facecolor=LIGHT_GREY, edgecolor=BLACK, lw=0.8, zorder=DISC))


def curve_look(curve: Curve) -> dict[str, Any]:
    """Return the keywords with which Matplotlib plots a curve."""
    look: dict[str, Any] = {"color": curve.colour, "lw": curve.width, "marker": curve.marker, "ms": curve.size}
    if not curve.width:
        look["ls"] = "none"
    elif curve.dashes == (1, 0):
        look["solid_capstyle"] = "butt"  # a bar must end where its value does
    else:
        look["dashes"] = curve.dashes
    if curve.hollow:
        look |= {"mfc": "white", "mew": 0.8}
    if curve.marker == "*":  # its rim tells stars in one place apart
        look |= {"mec": "white", "mew": 0.6}
    return look | ({"mew": 2} if curve.marker == "x" else {})


def _set_axis(axes: Axes, name: Literal["x", "y"], axis: Axis) -> None:
    own, set_scale, set_limits, set_ticks = (
        (axes.xaxis, axes.set_xscale, axes.set_xlim, axes.set_xticks)
        if name == "x"
        else (axes.yaxis, axes.set_yscale, axes.set_ylim, axes.set_yticks)
    )
    own.set_label_text(axis.label)
    if axis.scale != "linear":
        set_scale(axis.scale, **({"linthresh": axis.linear_to} if axis.scale == "symlog" else {}))
        own.set_major_formatter("{x:g}")
    if axis.ticks is not None:
        set_ticks(list(axis.ticks), list(axis.ticks.values()))
    if axis.limits is not None:  # after the ticks, which widen them
        set_limits(*axis.limits)


def make_figure(width: float, height: float, rows: tuple[int, ...] = (1,)) -> tuple[Figure, tuple[Axes, ...]]:
    """Return a figure [inches] with a grid and its axes below each other, with the ratio of their heights."""
    figure = new_figure(width, height, dpi=130)
    grid = figure.subplots(len(rows), 1, squeeze=False, sharex=True, height_ratios=list(rows))
    for axes in grid[:, 0]:
        axes.grid(True, color="0.92", lw=0.6)
        axes.set_axisbelow(True)
    return figure, tuple(grid[:, 0])


def new_figure(width: float, height: float, dpi: float | None = None) -> Figure:
    """Return an empty figure [inches] that makes room for the labels of its axes; ``dpi``: pixels per inch."""
    # Not by pyplot, which keeps every figure open and may look for a display
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), dpi=dpi, layout="constrained")


def legend_below(figure: Figure, columns: int = 3) -> None:
    """Put one legend for all axes below the figure."""
    pairs = [pair for axes in figure.axes for pair in zip(*axes.get_legend_handles_labels(), strict=True)]
    if pairs:
        handles, labels = zip(*pairs, strict=True)
        figure.legend(
            handles, labels, loc="outside lower center", ncols=min(columns, len(pairs)), frameon=False, handlelength=3.2
        )


def png(figure: Figure, dpi: float | Literal["figure"] = "figure") -> bytes:
    """Return the figure as a PNG file; ``dpi``: pixels per inch, "figure": its own."""
    out = io.BytesIO()
    # No version, so that the same figure has the same bytes
    figure.savefig(out, format="png", metadata={"Software": None}, dpi=dpi)
    return out.getvalue()


def without_mathtext(text: str) -> str:
    """Return ``text`` so that matplotlib shows it as it is.

    It takes what stands between two $ for a formula, and no half characters.
    """
    shown = utf8(text).decode()
    return (shown if len(shown) <= MAX_LABEL_LENGTH else f"{shown[:MAX_LABEL_LENGTH]}...").replace("$", r"\$")
