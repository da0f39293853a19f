"""Renders the report of a convergence study in Markdown, and its figures, one per ladder, from its result alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache
from typing import Any

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
from looping_pendulum.pages.chart import BLACK, MARGIN, Chart, ChartAxis, Curve, Guide, Panel
from looping_pendulum.pages.drawing import draw as drawn
from looping_pendulum.pages.drawing import png
from looping_pendulum.pages.numbers import DISPLAY_UNITS, number
from looping_pendulum.pages.palette import COLOURS
from looping_pendulum.pages.templates import markdown_templates
from looping_pendulum.runs.trajectory import supplies_as_rows

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
                chart = ladder_chart(v, ladder)
                name = f"{chart.id}.png"
                with optional_output(f"figures/{name}"):
                    figures[name] = v.label, chart.caption, png(drawn(chart))
    return figures


def ladder_chart(v: VariantStudy, ladder: LadderStudy) -> Chart:
    """Return the errors from the reference and from the ladder's limit over the setting; below, the halting time's error."""
    values = [rung.value for rung in ladder.rungs if rung.value > 0]
    ends = values[0], values[-1]
    beyond = (ends[1] / ends[0]) ** MARGIN
    # From the coarsest to the finest, which is always on the right
    limits = ends[0] / beyond, ends[1] * beyond
    verdicts = {one.quantity: one for one in ladder.verdicts}
    own = [Guide(x=ladder.own, text="its own setting")] if ladder.own else []
    panels = [
        Panel(
            curves=_errors(v, ladder, verdicts, ends),
            y=ChartAxis(label="RMS distance of\nthe light mass [mm]", scale="log"),
            guides=own,
            height=3,
        )
    ]
    if any(rung.run.errors[HALT] is not None for rung in ladder.rungs):
        panels.append(
            Panel(
                curves=_halts(v, ladder, verdicts[HALT], ends),
                y=ChartAxis(label="halting time,\nengine less reference [ms]"),
                guides=[Guide(y=0.0, colour=BLACK), *(replace(guide, text="") for guide in own)],
                height=2,
            )
        )
    unit = f" [{ladder.unit}]" if ladder.unit else ""
    return Chart(
        id=file_stem(v.label, v.profile, ladder.setting),
        caption=f"{v.label}: error against the reference (full) and against its own limit (dashed) as {ladder.setting} "
        "is refined to the right; below, the halting time's error.",
        subject=f"{v.label}, {v.profile}",
        title=ladder.setting,
        x=ChartAxis(label=f"{ladder.setting}{unit}, finer to the right", scale="log", limits=limits),
        panels=panels,
        size=(7.6, 5.2 if len(panels) == 1 else 7.4),
    )


def _errors(
    v: VariantStudy, ladder: LadderStudy, verdicts: Mapping[str, QuantityVerdict], ends: tuple[float, float]
) -> list[Curve]:
    curves = []
    for name, (marker, colour) in PATH_STYLES.items():
        words, verdict, spread = f"to {PATH_END_TIMES[name]:g} s", verdicts[name], v.spread[name]
        look: dict[str, Any] = {"marker": marker, "colour": colour, "width": 1.5}
        x, y = _points(ladder, [r.run.errors[name] for r in ladder.rungs])
        curves.append(Curve(label=f"from the reference, {words}", x=x, y=y, **look))
        if verdict.limit_error is not None:
            order = "" if verdict.order is None else f", order {verdict.order:.2g}"
            x, y = _points(ladder, [r.to_limit[name] for r in ladder.rungs])
            curves.append(Curve(label=f"from its own limit, {words}{order}", x=x, y=y, dashes=(4, 2), hollow=True, **look))
        if spread is not None and spread > 0:
            noise = [1e3 * spread] * 2
            curves.append(Curve(label=f"noise, {words}", x=ends, y=noise, colour=colour, width=0.8, dashes=(1, 2)))
    return curves


def _halts(v: VariantStudy, ladder: LadderStudy, verdict: QuantityVerdict, ends: tuple[float, float]) -> list[Curve]:
    known = [(r.value, error * 1e3) for r in ladder.rungs if r.value > 0 and (error := r.run.errors[HALT]) is not None]
    x, y = np.array(known).T
    spread = v.spread[HALT]
    noise = None if spread is None else np.full(len(x), 2e3 * spread)
    look: dict[str, Any] = {"colour": COLOURS[2], "marker": "D", "size": 4.0, "width": 1.5}
    curves = [Curve(label="halting time; band: twice its noise", x=x, y=y, band=noise, **look)]
    if verdict.limit_error is not None and verdict.uncertainty is not None:
        limit, half = [1e3 * verdict.limit_error] * 2, [1e3 * verdict.uncertainty] * 2
        look = {"colour": COLOURS[2], "width": 0.8, "dashes": (4, 2)}
        curves.append(Curve(label="its limit; band: 95 %", x=ends, y=limit, band=half, **look))
    return curves


def _points(ladder: LadderStudy, values: Sequence[float | None]) -> tuple[list[float], list[float]]:
    pairs = [(r.value, value * 1e3) for r, value in zip(ladder.rungs, values, strict=True) if value and r.value > 0]
    return [x for x, _ in pairs], [y for _, y in pairs]
