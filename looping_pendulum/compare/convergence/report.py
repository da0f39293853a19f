"""Renders the report of a convergence study in Markdown, and its figures, one per ladder, from its result alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
from jinja2 import Template

from looping_pendulum.compare.convergence.result import (
    HALT,
    PATH_END_TIMES,
    QUANTITIES,
    ConvergenceResult,
    LadderStudy,
    QuantityVerdict,
    VariantStudy,
)
from looping_pendulum.compare.convergence.verdict import LADDERS, format_setting
from looping_pendulum.files import file_stem, optional_output
from looping_pendulum.pages.drawing import legend_below, make_figure, png, without_mathtext
from looping_pendulum.pages.numbers import DISPLAY_UNITS, number
from looping_pendulum.pages.palette import COLOURS, GREY
from looping_pendulum.pages.templates import markdown_templates
from looping_pendulum.runs.trajectory import supplies_as_rows

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

QUANTITY_LABELS = {
    "path_0.35s": "path to 0.35 s",
    "path_0.7s": "path to 0.7 s",
    HALT: "halting time",
    "drop_at_halt": "drop at the halt",
}
PATH_STYLES = dict(zip(PATH_END_TIMES, (("o", COLOURS[0]), ("s", COLOURS[1])), strict=True))
"""Path quantity -> marker and colour."""


def convergence_markdown(result: ConvergenceResult, figures: Mapping[str, tuple[str, str]] | None = None) -> str:
    """Return the report.

    Parameters
    ----------
    figures
        Path of a figure, from the report's folder -> (label of its variant, caption).
    """
    supplies = {v.label: supplies_as_rows(v.provenance.supplies) for v in result.variants}
    return (
        _template().render(
            result=result,
            figures=figures or {},
            verdicts={
                name: [(v, one) for v in result.variants for one in v.verdicts if one.quantity == name] for name in QUANTITIES
            },
            supplies=supplies,
            physics=[what for what, *_ in next(iter(supplies.values()), [])],
            seconds=sum(seconds or 0.0 for seconds in result.clock.run_times.values()),
        )
        + "\n"
    )


@cache
def _template() -> Template:
    environment = markdown_templates("looping_pendulum.compare.convergence")
    environment.filters |= {
        "setting": format_setting,
        "text": lambda value: number(value, digits=6) if isinstance(value, float) else str(value),
    }
    environment.globals |= {
        "DISPLAY_UNITS": DISPLAY_UNITS,
        "LADDERS": LADDERS,
        "QUANTITIES": QUANTITIES,
        "QUANTITY_LABELS": QUANTITY_LABELS,
    }
    return environment.get_template("convergence.md.jinja")


def draw(result: ConvergenceResult) -> dict[str, tuple[str, str, bytes]]:
    """Draw every figure that the result has data for: file name -> (label of the variant, caption, PNG)."""
    figures = {}
    for v in result.variants:
        for ladder in v.ladders:
            # A line needs two points, and a logarithmic axis positive values
            if sum(rung.value > 0 and any(rung.run.errors[path] for path in PATH_END_TIMES) for rung in ladder.rungs) > 1:
                name = f"{file_stem(v.label, v.profile, ladder.setting)}.png"
                caption = (
                    f"{v.label}: error against the reference (full) and against its own limit (dashed) as {ladder.setting} "
                    "is refined to the right; below, the halting time's error."
                )
                with optional_output(f"figures/{name}"):
                    figures[name] = v.label, caption, png(ladder_figure(v, ladder))
    return figures


def ladder_figure(v: VariantStudy, ladder: LadderStudy) -> Figure:
    """Draw the errors from the reference and from the ladder's limit against the setting; below, the halting time's error."""
    halts = any(rung.run.errors[HALT] is not None for rung in ladder.rungs)
    figure, axes = make_figure(7.6, 6.6 if halts else 4.8, rows=(3, 2) if halts else (1,))
    verdicts = {one.quantity: one for one in ladder.verdicts}
    _errors(axes[0], v, ladder, verdicts)
    if halts:
        _halts(axes[1], v, ladder, verdicts[HALT])
    last = axes[-1]
    last.set_xscale("log")
    values = [rung.value for rung in ladder.rungs if rung.value > 0]
    # Finer settings are always on the right
    if values[0] > values[-1]:
        last.invert_xaxis()
    last.set_xlabel(f"{ladder.setting}{f' [{ladder.unit}]' if ladder.unit else ''}, finer to the right")
    axes[0].set_title(without_mathtext(f"{v.label}, {v.profile}: {ladder.setting}"))
    legend_below(figure, columns=2)
    return figure


def _errors(axes: Axes, v: VariantStudy, ladder: LadderStudy, verdicts: dict[str, QuantityVerdict]) -> None:
    for name, (marker, colour) in PATH_STYLES.items():
        words, verdict = f"to {PATH_END_TIMES[name]:g} s", verdicts[name]
        how: dict[str, Any] = {"marker": marker, "color": colour, "ms": 5}
        axes.plot(*_points(ladder, [r.run.errors[name] for r in ladder.rungs]), label=f"from the reference, {words}", **how)
        if verdict.limit_error is not None:
            order = "" if verdict.order is None else f", order {verdict.order:.2g}"
            to_limit = _points(ladder, [r.to_limit[name] for r in ladder.rungs])
            axes.plot(*to_limit, dashes=(4, 2), mfc="white", label=f"from its own limit, {words}{order}", **how)
        spread = v.spread[name]
        if spread is not None and spread > 0:
            axes.axhline(spread * 1e3, color=colour, lw=0.8, dashes=(1, 2), label=f"noise, {words}")
    if ladder.own:
        axes.axvline(ladder.own, color=GREY, lw=0.9, zorder=1, label="the variant's own setting")
    axes.set_yscale("log")
    axes.set_ylabel("RMS distance of the light mass [mm]")


def _halts(axes: Axes, v: VariantStudy, ladder: LadderStudy, verdict: QuantityVerdict) -> None:
    known = [(r.value, error * 1e3) for r in ladder.rungs if r.value > 0 and (error := r.run.errors[HALT]) is not None]
    x, y = np.array(known).T
    spread = v.spread[HALT]
    bars = None if spread is None else np.full(len(x), 2 * spread * 1e3)
    axes.errorbar(
        x,
        y,
        yerr=bars,
        fmt="D-",
        ms=4,
        color=COLOURS[2],
        capsize=3,
        label="halting time; bars: twice its noise",
    )
    if verdict.limit_error is not None and verdict.uncertainty is not None:
        middle, half = verdict.limit_error * 1e3, verdict.uncertainty * 1e3
        axes.axhspan(middle - half, middle + half, color=COLOURS[2], alpha=0.15, lw=0, label="its limit, 95 %")
    axes.axhline(0, color="black", lw=1.0)
    if ladder.own:
        axes.axvline(ladder.own, color=GREY, lw=0.9, zorder=1)
    axes.set_ylabel("halting time,\nengine less reference [ms]")


def _points(ladder: LadderStudy, values: Sequence[float | None]) -> tuple[list[float], list[float]]:
    pairs = [(r.value, value * 1e3) for r, value in zip(ladder.rungs, values, strict=True) if value and r.value > 0]
    return [x for x, _ in pairs], [y for _, y in pairs]
