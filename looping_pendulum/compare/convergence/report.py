"""Renders the report of a convergence study in Markdown, and its figures, one per ladder, from its result alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from looping_pendulum.compare.convergence.result import (
    DROP,
    HALT,
    PATH_END_TIMES,
    QUANTITIES,
    ConvergenceResult,
    ConvergenceVerdict,
    ErrorCause,
    ErrorSplit,
    LadderStudy,
    RunSummary,
    SequenceKind,
    VariantStudy,
    VariationStudy,
)
from looping_pendulum.errors import EngineError
from looping_pendulum.files import file_stem, optional_output
from looping_pendulum.pages.drawing import legend_below, make_figure, png, without_mathtext
from looping_pendulum.pages.markdown import table
from looping_pendulum.pages.numbers import DISPLAY_UNITS, GAP, fixed, number, quantity, signed
from looping_pendulum.pages.palette import COLOURS, GREY
from looping_pendulum.runs.trajectory import supplies_as_rows
from looping_pendulum.scenarios.units import pretty

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

QUANTITY_LABELS = {
    "path_0.35s": "path to 0.35 s",
    "path_0.7s": "path to 0.7 s",
    HALT: "halting time",
    DROP: "drop at the halt",
}
EARLY, LATE = PATH_END_TIMES
"""Names of the two path quantities: to 0.35 s and to 0.7 s."""

LADDERS = "studies(), in docs/write-an-engine.md"
"""Section of the documentation on how an adapter offers ladders."""

HOW_TO_READ = """\
- **ladder, rung**: a sequence of runs that refines one setting of the variant step by step; each run of it is a rung.
- **error**: for a path, the root mean square distance of the light mass from the reference up to that time; for the halting
  time, its difference from the reference's.
- **not converged** (numerics): how far the variant at its own settings is from its own limit. The corrections of all ladders
  are added up, except those of a ladder whose setting another ladder refines as far or further.
- **different model**: how far that limit is from the reference; counted only if it is above its uncertainty.
- **adapter's choice**: the largest change that another, equally reasonable choice makes. The distance of the limit from the
  reference is attributed to the choice, not to the model, if such a change is as large.
- **spread**: standard deviation of the error when the start changes by 0.01 deg or 0.1 mm, each start with its own reference.
- Uncertainties are half-widths of 95 % intervals. An order is fitted only where all changes have one direction and shrink like
  a power of the setting. Rungs too coarse for that, outside the *asymptotic range*, are left out, which the ladder's line says.
  Where each rung comes at least three times nearer to the finest one, that one is the limit; otherwise the scatter of the
  finest rungs is given.
- **–**: there is no such number: fewer than three runs have a value of it, or the run broke off.
"""
HOW_TO_READ_LADDERS = """\
- **order 2 → 5 ± 1**: converges with order 2 to a limit whose distance from the reference is 5 ± 1.
- **settled → 5 ± 1**: the finest rungs differ no more.
- **closes in → 5 ± 1**: each rung comes at least three times nearer to the finest one, but by no one power.
- **± 3 about 5 ± 1**: the finest rungs scatter by 3 about a mean 5 ± 1 from the reference. **In the spread**: small changes of
  the start move it as much as refinement does, so that nothing is left to converge.
- **–**: fewer than three rungs have a value.
"""
ERROR_COLUMNS = ("RMS to 0.35 s [mm]", "to 0.7 s [mm]", "halting error [ms]", "drop error [mm]", "remark")
CHANGE_COLUMNS = ("change of the path to 0.35 s [mm]", "to 0.7 s [mm]", "of the halting time [ms]", "remark")
PATH_STYLES = dict(zip(PATH_END_TIMES, (("o", COLOURS[0]), ("s", COLOURS[1])), strict=True))
"""Path quantity -> marker and colour."""


def convergence_markdown(result: ConvergenceResult, figures: Mapping[str, tuple[str, str]] | None = None) -> str:
    """Return the report.

    Parameters
    ----------
    figures
        Path of a figure, from the report's folder -> (label of its variant, caption).
    """
    total = sum(one.seconds or 0.0 for one in result.clock.run_times)
    runs = f"{len(result.clock.run_times)} runs took {total:.0f} s in total"
    sections = [
        f"# {result.title}: what the engines' errors are made of\n\n{opening(result)}",
        "## Verdict\n\n" + splits_table(result),
        "## Does the halting time converge?\n\n" + halting_table(result),
        "## How to read this\n\n" + HOW_TO_READ,
        *(_variant(v, figures or {}) for v in result.variants),
        "## Hidden defaults\n\n" + defaults_table(result),
        "## The adapter's choices and their alternatives\n\n" + choices_table(result),
        "## Provenance\n\n" + provenance_table(result),
        f"## Wall times\n\nWritten {result.clock.written}. {runs}; several ran at the same time, so this is not a benchmark.\n",
    ]
    return "\n".join(sections)


def opening(result: ConvergenceResult) -> str:
    """Return what was run, for how long, and what was left out."""
    text = f"Scenario `{result.scenario}`, simulated for {result.until:g} s and compared with {result.reference}."
    if result.reference_values[HALT] is not None:
        text += f" The reference halts at {result.reference_values[HALT]:.5f} s."
    left_out = sum(run.status == "SKIPPED" for run in _runs(result))
    if result.budget is not None:
        runs = "1 run was left out because it was" if left_out == 1 else f"{left_out} runs were left out because they were"
        text += f" {runs} expected to take more than {result.budget:g} s."
    if result.interrupted:
        text += " **Interrupted**: this report has the runs that had ended by then; run the same command again to continue."
    return text + "\n"


def _runs(result: ConvergenceResult) -> list[RunSummary]:
    summaries = []
    for v in result.variants:
        summaries += [v.own, *(r.run for ladder in v.ladders for r in ladder.rungs), *(s.run for s in v.starts)]
        summaries += [one.run for one in (*v.choices, *v.defaults)]
    # One run may be a rung of several ladders
    return list({run.key: run for run in summaries}.values())


def splits_table(result: ConvergenceResult, quantities: Sequence[str] = (EARLY, LATE, HALT)) -> str:
    """Return one table per quantity with the parts of every variant's error."""
    parts = []
    for name in quantities:
        unit, scale = DISPLAY_UNITS[QUANTITIES[name]]
        head = [
            "variant",
            "main cause",
            f"error [{unit}]",
            "not converged",
            "different model",
            "± (of both)",
            "choice",
            "spread",
        ]
        rows = []
        for v in result.variants:
            split = next((s for s in v.splits if s.quantity == name), None)
            if split is None:
                rows.append([v.label, _why_without(v, name), *[GAP] * 6])
                continue
            cells = (split.error, split.numerics, split.model, split.numerics_uncertainty, split.choice, split.spread)
            rows.append([v.label, _causes(split), *(number(x, scale, 2) for x in cells)])
        parts.append(f"### {QUANTITY_LABELS[name][0].upper()}{QUANTITY_LABELS[name][1:]}\n\n{table(head, rows, left=2)}")
    return "\n".join(parts)


def _causes(split: ErrorSplit) -> str:
    text = ", then ".join(GAP if cause is ErrorCause.UNKNOWN else cause.value for cause in split.causes)
    if split.without_limit and ErrorCause.UNKNOWN not in split.causes:
        text += f" (no limit known for {', '.join(split.without_limit)})"
    return text


def _why_without(v: VariantStudy, name: str) -> str:
    if not v.own.ok:
        return _fault(v.own)
    return "never halts" if name in (HALT, DROP) and v.own.halting_time is None else "the reference has no value"


def _fault(run: RunSummary) -> str:
    """Say why a run did not end properly, without the advice that its status gives."""
    why = run.why.split(";")[0]
    _, refused, said = why.partition(f"{EngineError.__name__}: ")
    # What an adapter says begins with its name: "newton:tendon: found ..., needed ...: the reason"
    return said.split(": ")[1] if refused and ": " in said else why


def halting_table(result: ConvergenceResult) -> str:
    """Return a table of whether each variant's halting time converges, and to within what."""
    rows = []
    for v in result.variants:
        error = "does not halt" if v.own.ok and v.own.halting_time is None else signed(v.own.halting_time_error, 1e3)
        rows.append([v.label, halting_verdict(v), error, number(v.spread[HALT], 1e3, 2)])
    return table(["variant", "converges?", "halting error [ms]", "spread [ms]"], rows, left=2)


def halting_verdict(v: VariantStudy) -> str:
    """Say whether the halting time of ``v`` converges along every ladder that no other refines further, and to within what."""
    counted = [ladder for ladder in v.ladders if not ladder.refined_further_by]
    verdicts = [verdict for ladder in counted for verdict in ladder.verdicts if verdict.quantity == HALT]
    kinds = {verdict.kind for verdict in verdicts}
    if not verdicts:
        return f"the adapter offers no ladder ({LADDERS})"
    if kinds == {SequenceKind.NEVER}:
        return "never halts"
    if not v.own.ok:
        return "its run at its own settings does not end properly"
    # One ladder without a limit is enough, whatever the others do
    if SequenceKind.SCATTERS in kinds or SequenceKind.NEVER in kinds:
        if v.own.halting_time is None:
            return "no; it halts only with some settings"
        worst = max((verdict.scatter or 0.0 for verdict in verdicts if verdict.kind is SequenceKind.SCATTERS), default=0.0)
        return f"no; it scatters by ± {number(worst, 1e3, 2)} ms"
    split = next((s for s in v.splits if s.quantity == HALT), None)
    if SequenceKind.UNKNOWN in kinds or split is None:
        return "along some ladder too few runs halt to tell"
    within = f"to within ± {number(split.numerics_uncertainty, 1e3, 2)} ms"
    return (
        f"only {within}, the spread of small changes of the start" if SequenceKind.WITHIN_SPREAD in kinds else f"yes, {within}"
    )


def _variant(v: VariantStudy, figures: Mapping[str, tuple[str, str]]) -> str:
    parts = [f"## {v.label}, {v.profile}\n\n{v.summary.rstrip('.')}. At its own settings: {v.own.why}.\n"]
    parts += [_ladder(ladder) for ladder in v.ladders] or [f"The adapter offers no ladder ({LADDERS}).\n"]
    parts += [f"![{caption}]({path})\n\n*{caption}*\n" for path, (label, caption) in figures.items() if label == v.label]
    if v.starts:
        rows = []
        for one in v.starts:
            row = [one.what, number(one.run.rms[EARLY], 1e3), number(one.run.rms[LATE], 1e3)]
            row += [signed(one.run.halting_time_error, 1e3), signed(one.run.drop_error, 1e3)]
            rows.append([*row, "" if one.run.ok else _fault(one.run)])
        parts.append(
            "Runs with slightly changed starts, each compared with its own reference:\n\n"
            + table(["start", *ERROR_COLUMNS], rows)
        )
    return "\n".join(parts)


def _change_cells(one: VariationStudy) -> list[str]:
    halts = "never halts" if one.run.ok and one.run.halting_time is None else ""
    cells = [number(one.change[EARLY], 1e3), number(one.change[LATE], 1e3), signed(one.change[HALT], 1e3)]
    return [*cells, halts or ("" if one.run.ok else _fault(one.run))]


def _ladder(ladder: LadderStudy) -> str:
    head = [
        ladder.setting,
        "RMS to 0.35 s [mm]",
        "to 0.7 s [mm]",
        "distance to 0.7 s from the finest rung [mm]",
        "from its own limit [mm]",
        "halting time [s]",
        "halting error [ms]",
        "remark",
    ]
    rows = []
    for rung in ladder.rungs:
        run = rung.run
        row = [format_setting(rung.value, ladder.unit), number(run.rms[EARLY], 1e3), number(run.rms[LATE], 1e3)]
        row += [number(rung.to_finest[LATE], 1e3), number(rung.to_limit[LATE], 1e3)]
        rows.append([*row, fixed(run.halting_time, 5), signed(run.halting_time_error, 1e3), "" if run.ok else _fault(run)])
    follows = f" ({ladder.follows})" if ladder.follows else ""
    verdicts = "".join(f"- {QUANTITY_LABELS[v.quantity]}: {v.sentence}\n" for v in ladder.verdicts)
    own = "" if ladder.own is None else f"; the variant uses {format_setting(ladder.own, ladder.unit)}"
    further = ladder.refined_further_by
    if further:
        verdicts += f"- left out of the verdicts above, as the ladder of {further} refines it as far or further\n"
    return f"### Refining {ladder.setting}{follows}{own}\n\n{table(head, rows, left=0)}\n{verdicts}"


def format_setting(value: float, unit: str) -> str:
    """Format the value of a setting with a suitable unit; angles stay in radians, as in the settings."""
    return f"{number(value)} rad" if unit == "rad" else quantity(value, pretty(unit), 3)


def defaults_table(result: ConvergenceResult) -> str:
    """Return a table of the engine's default of each setting, the adapter's value, and what the default alone changes."""
    head = [
        "variant",
        "setting",
        "engine's default",
        "adapter's value",
        "what the setting does",
        "change of the halting time [ms]",
        "RMS to 0.35 s, adapter's value [mm]",
        "RMS to 0.35 s, default [mm]",
        "remark",
    ]
    rows = []
    for v in result.variants:
        for one in v.defaults:
            row = [v.label, one.what, one.other, one.ours, one.effect, signed(one.change[HALT], 1e3)]
            rows.append([*row, number(v.own.rms[EARLY], 1e3), number(one.run.rms[EARLY], 1e3), _change_cells(one)[-1]])
    return table(head, rows, left=5) if rows else "None of these variants declares one.\n"


def choices_table(result: ConvergenceResult) -> str:
    """Return a table of the adapter's choices, an equally reasonable alternative to each, and what that changes."""
    rows = [[v.label, one.what, one.ours, one.other, *_change_cells(one)] for v in result.variants for one in v.choices]
    head = ["variant", "choice", "adapter's", "alternative", *CHANGE_COLUMNS]
    return table(head, rows, left=4) if rows else "None of these variants declares one.\n"


def ladders_table(result: ConvergenceResult) -> str:
    """Return a table with a row per ladder: its ends, and how each quantity behaves along it."""
    units = {name: DISPLAY_UNITS[QUANTITIES[name]][0] for name in (EARLY, LATE, HALT)}
    head = ["variant", "setting", "from", "to", "rungs", *(f"{QUANTITY_LABELS[name]} [{units[name]}]" for name in units)]
    rows = []
    for v in result.variants:
        for ladder in v.ladders:
            verdicts = {verdict.quantity: verdict for verdict in ladder.verdicts}
            ran = [rung.value for rung in ladder.rungs if rung.run.status not in ("SKIPPED", "NOT_RUN")]
            ends = [format_setting(value, ladder.unit) for value in (ran[0], ran[-1])] if ran else [GAP, GAP]
            counts = f"{len(ran)} of {len(ladder.rungs)}"
            rows.append(
                [v.label, ladder.setting, *ends, counts, *(verdict_cell(verdicts[name]) for name in (EARLY, LATE, HALT))]
            )
    return table(head, rows, left=8)


def verdict_cell(verdict: ConvergenceVerdict) -> str:
    """Return a verdict in a few signs (`HOW_TO_READ_LADDERS`), in millimetres or milliseconds."""
    if verdict.kind is SequenceKind.NEVER:
        return "never halts"
    if verdict.kind is SequenceKind.UNKNOWN:
        return GAP
    if verdict.limit_error is None or verdict.uncertainty is None:
        return "halts on some rungs"
    distance = f"{number(abs(verdict.limit_error), 1e3, 2)} ± {number(verdict.uncertainty, 1e3, 2)}"
    if verdict.kind is SequenceKind.CONVERGES:
        return f"{'closes in' if verdict.order is None else f'order {number(verdict.order, digits=2)}'} → {distance}"
    if verdict.kind is SequenceKind.SETTLED:
        return f"settled → {distance}"
    within = ", in the spread" if verdict.kind is SequenceKind.WITHIN_SPREAD else ""
    return f"± {number(verdict.scatter, 1e3, 2)} about {distance}{within}"


def provenance_table(result: ConvergenceResult) -> str:
    """Return a table of versions and suppliers of physics of every variant, and below it the settings of each."""
    physics: list[str] = []
    rows, settings = [], []
    for v in result.variants:
        p = v.provenance
        supplies = supplies_as_rows(p.supplies)
        physics = [what for what, *_ in supplies]
        versions = ", ".join(f"{k} {x}" for k, x in p.versions.items()) or GAP
        rows.append([v.label, versions, *(by for _, by, _ in supplies)])
        each = ", ".join(f"{k} {number(x, digits=6) if isinstance(x, float) else x}" for k, x in p.settings.items())
        settings.append(f"- **{v.label}**: {each or GAP}\n")
    head = ["variant", "versions", *physics]
    return f"{table(head, rows, left=len(head))}\nSettings, in SI units:\n\n{''.join(settings)}"


def draw(result: ConvergenceResult) -> dict[str, tuple[str, str, bytes]]:
    """Draw every figure that the result has data for: file name -> (label of the variant, caption, PNG)."""
    figures = {}
    for v in result.variants:
        for ladder in v.ladders:
            # A line needs two points, and a logarithmic axis positive values
            if sum(rung.value > 0 and any(rung.run.rms[path] for path in PATH_END_TIMES) for rung in ladder.rungs) > 1:
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
    halts = any(rung.run.halting_time_error is not None for rung in ladder.rungs)
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


def _errors(axes: Axes, v: VariantStudy, ladder: LadderStudy, verdicts: dict[str, ConvergenceVerdict]) -> None:
    for name, (marker, colour) in PATH_STYLES.items():
        words, verdict = f"to {PATH_END_TIMES[name]:g} s", verdicts[name]
        how: dict[str, Any] = {"marker": marker, "color": colour, "ms": 5}
        axes.plot(*_points(ladder, [r.run.rms[name] for r in ladder.rungs]), label=f"from the reference, {words}", **how)
        if verdict.kind in (SequenceKind.CONVERGES, SequenceKind.SETTLED):
            order = "" if verdict.order is None else f", order {verdict.order:.2g}"
            to_limit = _points(ladder, [r.to_limit[name] for r in ladder.rungs])
            axes.plot(*to_limit, dashes=(4, 2), mfc="white", label=f"from its own limit, {words}{order}", **how)
        spread = v.spread[name]
        if spread is not None and spread > 0:
            axes.axhline(spread * 1e3, color=colour, lw=0.8, dashes=(1, 2), label=f"spread of small changes, {words}")
    if ladder.own:
        axes.axvline(ladder.own, color=GREY, lw=0.9, zorder=1, label="the variant's own setting")
    axes.set_yscale("log")
    axes.set_ylabel("RMS distance of the light mass [mm]")


def _halts(axes: Axes, v: VariantStudy, ladder: LadderStudy, verdict: ConvergenceVerdict) -> None:
    known = [
        (r.value, r.run.halting_time_error * 1e3) for r in ladder.rungs if r.value > 0 and r.run.halting_time_error is not None
    ]
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
        label="halting time less the reference's; bars: twice its spread",
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
