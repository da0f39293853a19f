"""What all figures that Matplotlib draws have in common. It is imported on use, since that takes a second."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Any, Literal

from looping_pendulum.files import utf8
from looping_pendulum.pages.chart import BLACK, LIGHT_GREY, Chart, ChartAxis, Curve, Panel

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MAX_LABEL_LENGTH = 50
"""Characters of a name that a figure shows: a longer one would leave no room for the axes."""
SPANS, GUIDES, CURVES, DISC, MARKS = 0.5, 1, 2, 4, 6
"""Order of drawing; curves above each other are a thousandth apart."""
LINE, CHARACTER, NUMBER_LENGTH = 0.2, 0.078, 6
"""Height of a line of text and width of a character [inches], and characters of a number beside an axis."""
MAX_COLUMNS, HANDLE_ROOM = 3, 0.75
"""Most columns of a legend, and width of what stands before an entry's words [inches]."""
TITLE_ROOM, SLANTED_ROOM = 0.4, 0.8
"""Heights of a title and of the slanted words below it [inches]."""


def draw(chart: Chart) -> Figure:
    """Return a chart as Matplotlib's figure."""
    count, columns = len(chart.panels), chart.columns
    rows = tuple(panel.height for panel in chart.panels) if columns is None else (1,) * -(-count // columns)
    slanted = any(guide.text for panel in chart.panels for guide in panel.guides)
    room = {"left": max(_room_beside(panel.y) for panel in chart.panels), "top": TITLE_ROOM}
    if slanted:
        room["top"] += SLANTED_ROOM
    elif columns is not None:
        room["top"] += LINE * max(1 + panel.title.count("\n") for panel in chart.panels)
    figure, all_axes = make_figure(*chart.size, rows=rows, columns=columns, **room)
    for axes, panel in zip(all_axes, chart.panels, strict=False):
        _draw_panel(axes, panel)
        _set_axis(axes, "y", panel.y)
        if columns is not None or panel is chart.panels[-1]:
            _set_axis(axes, "x", panel.x or chart.x)
        if panel.to_scale:
            axes.set_aspect("equal")
    title = f"{without_mathtext(chart.subject)}: {chart.title}"
    if columns is None:
        all_axes[0].set_title(title, pad=72 * SLANTED_ROOM if slanted else None)
    else:
        figure.suptitle(title)
        for axes, panel in zip(all_axes, chart.panels, strict=False):
            axes.set_title(_lines(panel.title), fontsize=10)
        for axes in all_axes[count:]:
            axes.set_visible(False)
    legend_below(figure)
    return figure


def _room_beside(axis: ChartAxis) -> float:
    """Return the room for the label of a y axis and for what stands beside its ticks [inches]."""
    longest = max((len(line) for words in (axis.ticks or {}).values() for line in words.split("\n")), default=NUMBER_LENGTH)
    return 0.25 + CHARACTER * longest + (LINE * (1 + axis.label.count("\n")) if axis.label else 0.0)


def _draw_panel(axes: Axes, panel: Panel) -> None:
    from matplotlib.patches import Circle

    for guide in panel.guides:
        look: dict[str, Any] = {"color": guide.colour, "lw": 0.8 if guide.dotted else 0.9, "zorder": GUIDES}
        if guide.dotted:
            look["dashes"] = (1, 2)
        for at, line, span in ((guide.x, axes.axvline, axes.axvspan), (guide.y, axes.axhline, axes.axhspan)):
            if at is not None:
                line(at, **look)
                if guide.half_width:
                    span(at - guide.half_width, at + guide.half_width, color="0.92", lw=0, zorder=SPANS)
        if guide.x is not None and guide.text:
            place: dict[str, Any] = {"transform": axes.get_xaxis_transform(), "rotation": 40, "ha": "left", "va": "bottom"}
            axes.text(guide.x, 1.01, guide.text, fontsize=8, color="0.25", **place)
    for order, curve in enumerate(panel.curves):
        look = curve_look(curve) | {"zorder": (MARKS if curve.marker in ("*", "x") else CURVES) + order / 1000}
        look["label"] = without_mathtext(curve.label) if curve.label and curve.in_legend else None
        x, y = curve.drawn()
        if curve.bar is None:
            axes.plot(x, y, **look)
        else:
            axes.errorbar(x, y, xerr=curve.bar, yerr=curve.bar, capsize=3, **look)
        if curve.band is not None:
            axes.fill_between(x, y - curve.band, y + curve.band, color=curve.colour, alpha=0.25, lw=0)
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


def _set_axis(axes: Axes, name: Literal["x", "y"], axis: ChartAxis) -> None:
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
        set_ticks(list(axis.ticks), [_lines(words) for words in axis.ticks.values()])
    if axis.limits is not None:  # after the ticks, which widen them
        set_limits(*axis.limits)


def make_figure(
    width: float,
    height: float,
    rows: tuple[int, ...] = (1,),
    columns: int | None = None,
    *,
    left: float = 0.9,
    top: float = TITLE_ROOM,
) -> tuple[Figure, tuple[Axes, ...]]:
    """Return a figure [inches] with axes, which have grid lines, in rows with the ratio of their heights.

    Without a number of ``columns`` they stand below each other and share their x axis. `legend_below` makes room for what is
    below the axes.

    Parameters
    ----------
    left, top
        Room beside and above the axes [inches].
    """
    # Not by pyplot, which keeps every figure open and may look for a display
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), dpi=130)
    gaps = {"hspace": 0.1} if columns is None else {"hspace": 0.45, "wspace": 0.3}
    room = {"left": left / width, "right": 1 - 0.2 / width, "top": 1 - top / height} | gaps
    grid = figure.subplots(
        len(rows), columns or 1, squeeze=False, sharex=columns is None, gridspec_kw=room | {"height_ratios": rows}
    )
    for axes in grid.flat:
        axes.grid(True, color="0.92", lw=0.6)
        axes.set_axisbelow(True)
    return figure, tuple(grid.flat)


def new_figure(width: float, height: float, dpi: float | None = None) -> Figure:
    """Return an empty figure [inches] that makes room for the labels of its axes; ``dpi``: pixels per inch."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), dpi=dpi, layout="constrained")


def legend_below(figure: Figure) -> None:
    """Put one legend for all axes at the lower edge of the figure, and the axes above it."""
    below = max(1 + axes.get_xlabel().count("\n") for axes in figure.axes)
    pairs = [pair for axes in figure.axes for pair in zip(*axes.get_legend_handles_labels(), strict=True)]
    if pairs:
        handles, labels = zip(*pairs, strict=True)
        width = HANDLE_ROOM + CHARACTER * max(map(len, labels))
        columns = max(1, min(MAX_COLUMNS, len(pairs), int(figure.get_figwidth() / width)))
        figure.legend(handles, labels, loc="lower center", ncols=columns, frameon=False, handlelength=3.2)
        below += -(-len(pairs) // columns)
    figure.subplots_adjust(bottom=(0.45 + LINE * below) / figure.get_figheight())


def png(figure: Figure) -> bytes:
    """Return the figure as a PNG file."""
    out = io.BytesIO()
    # Once, and without the drawing that `savefig` would do only for the sake of the layout
    if (layout := figure.get_layout_engine()) is not None:
        layout.execute(figure)
        figure.set_layout_engine("none")
    # No version, so that the same figure has the same bytes
    figure.savefig(out, format="png", metadata={"Software": None}, dpi="figure")
    return out.getvalue()


def _lines(text: str) -> str:
    """Return ``text``, each line of it as `without_mathtext` does."""
    return "\n".join(map(without_mathtext, text.split("\n")))


def without_mathtext(text: str) -> str:
    """Return ``text`` so that matplotlib shows it as it is.

    It takes what stands between two $ for a formula, and no half characters.
    """
    shown = utf8(text).decode()
    return (shown if len(shown) <= MAX_LABEL_LENGTH else f"{shown[:MAX_LABEL_LENGTH]}...").replace("$", r"\$")
