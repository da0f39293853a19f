"""The report in Markdown, rendered from the result object and nothing else. Verdict first, then why, then detail."""

from __future__ import annotations

import math
from collections.abc import Mapping

from looping_pendulum.compare.tables import GAP, number, signed, table
from looping_pendulum.discrepancy.report import event_report, unlisted_report
from looping_pendulum.discrepancy.result import FitReport, Identification, IdentifiedEffect, Round, Verdict
from looping_pendulum.pages.numbers import uncertain

HEADLINES = {
    Verdict.NO_MISSING_EFFECT: "Nothing is missing",
    Verdict.IDENTIFIED: "A missing effect was found",
    Verdict.AMBIGUOUS: "Something is missing, and these data allow several explanations",
    Verdict.UNLISTED: "A force that no library lists was found",
    Verdict.UNEXPLAINED: "Something is missing that no listed effect explains",
    Verdict.INTERRUPTED: "Interrupted",
}


def render(result: Identification, figures: Mapping[str, str] | None = None) -> str:
    """Return the report.

    Parameters
    ----------
    figures
        Path below the report's folder -> caption.
    """
    return "\n".join(s for s in [*before_figures(result), _figures(figures or {}), *after_figures(result)] if s)


def before_figures(result: Identification) -> list[str]:
    """Sections that stand above the figures, the title first; some are empty."""
    return [
        f"# {result.title}\n",
        f"## Verdict: {HEADLINES[result.verdict]} (`{result.verdict.value}`)\n\n{result.sentence}\n",
        _effects(result),
        _remainder(result),
        unlisted_report.section(result),
        "## Error before and after\n\n" + _errors(result),
        event_report.section(result),
        _ties(result),
    ]


def after_figures(result: Identification) -> list[str]:
    """Sections that stand below the figures; some are empty."""
    return [
        "## Candidates\n\n" + _rounds(result),
        "## Declared model, calibrated\n\n" + _fit(result.before),
        "## Repaired model\n\n" + _fit(result.after) if result.effects or result.unlisted else "",
        "## Data\n\n" + "".join(f"- {line}\n" for line in result.data),
        "## Provenance\n\n" + _provenance(result),
    ]


def _effects(result: Identification) -> str:
    if not result.effects:
        return ""
    return "## What was added\n\n" + _effect_table(result.effects)


def _effect_table(effects: tuple[IdentifiedEffect, ...]) -> str:
    head = ["effect", "kind", "acts on", "depends on", "formula", "value", "standard error", "without it", "unit"]
    rows = [
        [e.name, e.kind, e.acts_on, ", ".join(e.depends_on) or GAP, f"`{e.formula}`", number(e.value, digits=5),
         number(e.error, digits=2), number(e.null), e.unit or GAP]
        for e in effects
    ]  # fmt: skip
    note = "".join(
        f"\nThe value of {e.name} {e.meaning} {e.parameter}.\n" for e in effects if e.name != e.parameter or e.meaning != "is"
    )
    for e in effects:
        note += "".join(f"\nFitted with {e.name}: {n} = {uncertain(v, s)} [SI].\n" for n, v, s in e.companions)
    return table(head, rows, left=5) + note


def _remainder(result: Identification) -> str:
    r = result.remainder
    if r is None:
        return ""
    judged = "The verdict" if result.effects else "A second look at all candidates"
    return (
        f"## Remainder\n\nMarks are off the model by {number(r.rms, digits=2)} {r.unit} more than they scatter from frame to "
        f"frame; nothing in the library explains that. {judged} takes what the best explanation ({r.least}) leaves for "
        f"errors of the marks: {number(r.ratio, digits=2)} times their scatter, lasting {number(r.lasting, digits=2)} marks, "
        "so that as many count as one.\n"
    )


def _errors(result: Identification) -> str:
    head = ["trial", "seen by the fit?", "RMS before [mm, mrad]", "RMS after [mm, mrad]", "before [noise]", "after [noise]"]
    rows = [
        [e.trial, "no" if e.held_out else "yes", number(e.rms_before, 1e3), number(e.rms_after, 1e3), number(e.noise_before),
         number(e.noise_after)]
        for e in result.errors
    ]  # fmt: skip
    note = (
        f"RMS of the distance from the light mass's marks to the model; 1 in units of noise is the best possible. Judged on "
        f"{result.judged_on}; *before* is the declared model after its own calibration.\n\n"
    )
    return note + table(head, rows, left=2)


def _ties(result: Identification) -> str:
    if not result.ties:
        return ""
    text = "## Explanations that these data cannot tell apart\n\n"
    text += "\n".join(_effect_table(tie) for tie in result.ties)
    if not result.next_experiments:
        return text + "\nNo trial within the limits could be simulated to separate them.\n"
    head = ["release", "angle [deg]", "M2/M1", "distance [noise]", "tells apart least well"]
    rows = [
        [e.release, number(math.degrees(e.release_angle)), number(e.mass_ratio), number(e.distance), " / ".join(e.tells_apart)]
        for e in result.next_experiments
    ]
    best = result.next_experiments[0].distance
    advice = "The first of these separates them best." if best > 3 else "None of these separates them: measure it directly."
    return text + f"\n### Next experiment\n\n{advice} Below about 3 units of noise nothing is decided.\n\n" + table(head, rows)


def _figures(figures: Mapping[str, str]) -> str:
    if not figures:
        return ""
    return "## Figures\n\n" + "\n".join(f"![{caption}]({path})\n\n*{caption}*\n" for path, caption in figures.items())


def _rounds(result: Identification) -> str:
    if not result.rounds:
        return f"None was tried: nothing was left. The best score of the screening is {result.before.largest_score:.1f}.\n"
    return "\n".join(_round(r, i) for i, r in enumerate(result.rounds, start=1))


def _round(r: Round, index: int) -> str:
    head = ["candidate", "kind", "passes?", "score z", "gain (BIC)", "value [SI]", "+/-", "unseen chi2/n", "why not"]
    rows = [
        [c.name, c.kind, "yes" if c.passes else "no", signed(c.score), number(c.gain), number(c.value, digits=4),
         number(c.error, digits=2), number(c.held_out), c.reason or GAP]
        for c in r.ranking
    ]  # fmt: skip
    before = f" with {', '.join(r.added_before)} in the model" if r.added_before else ""
    margin = ""
    if r.margin is not None:
        margin = f"Best: {r.best}; runner-up: {r.runner_up}, {r.margin:.1f} behind.\n\n"
    if r.errors_times != 1:
        before += f", errors of the marks {number(r.errors_times, digits=2)} times their scatter"
    return f"### Round {index}{before}\n\n{margin}{table(head, rows, left=3)}"


def _fit(fit: FitReport) -> str:
    head = ["number", "value [SI]", "standard error", "measured or start", "+/-", "moved [its errors]", "remark"]
    rows = []
    for n in fit.numbers:
        moved = (n.value - n.measured) / n.measured_error if n.measured_error else None
        rows.append(
            [n.name, number(n.value, digits=6), number(n.error, digits=2), number(n.measured, digits=6),
             number(n.measured_error, digits=2), signed(moved, digits=2), "on a bound" if n.at_bound else ""]
        )  # fmt: skip
    text = table(head, rows)
    text += f"\nChi2 per degree of freedom {fit.chi2_per_dof:.3f}; unseen chi2 per value {fit.held_out:.3f}; "
    text += f"largest score {fit.largest_score:.1f}; condition number {number(fit.condition, digits=2)}."
    if fit.starts:
        text += f" Starts ended at costs {', '.join(f'{c:.1f}' for c in fit.starts)}."
    text += "\n\nNot quiet: " + ("; ".join(fit.alarms) if fit.alarms else "nothing") + ".\n"
    if fit.correlations:
        pairs = "; ".join(f"{a} and {b} {c:+.3f}" for a, b, c in fit.correlations)
        text += f"\nCorrelations above 0.9: {pairs}.\n"
    return text


def _provenance(result: Identification) -> str:
    versions = ", ".join(f"{k} {v}" for k, v in sorted(result.provenance.items()))
    return f"Study `{result.study}`, seed {result.seed}; {versions}. The same input and seed give the same bytes.\n"
