"""Render the report in Markdown from the result object alone: the verdict first, then why, then the details."""

from __future__ import annotations

import math
from collections.abc import Mapping

from looping_pendulum.compare.tables import GAP, number, signed, table
from looping_pendulum.discrepancy.identification import BODY_IN_WORDS
from looping_pendulum.discrepancy.listed.attribution import MAX_NULL_SCORE
from looping_pendulum.discrepancy.listed.round_record import MIN_DELTA_BIC, MIN_DELTA_BIC_MARGIN
from looping_pendulum.discrepancy.record_starts import record_starts_in_words
from looping_pendulum.discrepancy.report import event_report, unlisted_report
from looping_pendulum.discrepancy.result import FitReport, Identification, IdentifiedEffect, Round, Verdict
from looping_pendulum.pages.numbers import quantity, uncertain

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
    """Return the sections above the figures, the title first; some are empty."""
    return [
        f"# {result.title}\n",
        f"## Verdict: {HEADLINES[result.verdict]} (`{result.verdict.value}`)\n\n{result.sentence}\n",
        _effects(result),
        _correlated_noise(result),
        unlisted_report.section(result),
        "## Error before and after\n\n" + _errors(result),
        record_starts_in_words(result.record_starts),
        _outliers(result),
        event_report.section(result),
        _ties(result),
    ]


def after_figures(result: Identification) -> list[str]:
    """Return the sections below the figures; some are empty."""
    return [
        "## Candidates\n\n" + _rounds(result),
        _smallest_visible(result),
        "## Declared model, calibrated\n\n" + _fit(result.before),
        "## Repaired model\n\n" + _fit(result.after) if result.effects or result.unlisted else "",
        "## Data\n\n" + "".join(f"- {line}\n" for line in result.data),
        "## Provenance\n\n" + _provenance(result),
    ]


def _effects(result: Identification) -> str:
    if not result.effects:
        return ""
    note = "At its null value an effect is absent.\n\n"
    return f"## What was added\n\n{note}{_effect_table(result.effects)}"


def _effect_table(effects: tuple[IdentifiedEffect, ...]) -> str:
    head = ["effect", "kind", "acts on", "depends on", "formula", "value", "standard error", "null value", "unit"]
    rows = [
        [e.name, e.kind, e.acts_on, ", ".join(e.depends_on) or GAP, f"`{e.formula}`", number(e.value, digits=5),
         number(e.error, digits=2), number(e.null_value), e.unit or GAP]
        for e in effects
    ]  # fmt: skip
    # Not where it would say that a parameter is itself
    note = "".join(
        f"\nThe value of {e.name} {e.meaning} {e.parameter}.\n" for e in effects if e.name != e.parameter or e.meaning != "is"
    )
    for e in effects:
        note += "".join(f"\nFitted with {e.name}: {n} = {uncertain(v, s)} [SI].\n" for n, v, s in e.companions)
    return table(head, rows, left=5) + note


def _correlated_noise(result: Identification) -> str:
    if not result.correlated_noise:
        return ""
    head = ["tracked points of", "off by", "for some [points]", "for some [s]"]
    rows = [
        [BODY_IN_WORDS[e.body], quantity(e.amplitude, e.unit), number(e.points, digits=2), number(e.correlation_time, digits=2)]
        for e in result.correlated_noise
    ]
    note = (
        "Beside what scatters from frame to frame, the points are off by an error that changes slowly, as when a tracker "
        "wanders over its mark: a standard deviation per coordinate, and the time in which it changes. All tests take it into "
        "account.\n\n"
    )
    return "## Errors that last longer than a frame\n\n" + note + table(head, rows, left=1)


def _smallest_visible(result: Identification) -> str:
    if not result.smallest_visible:
        return ""
    head = ["effect", "smallest size that would show", "unit"]
    rows = [[v.name, number(v.value, digits=2), v.unit or GAP] for v in result.smallest_visible]
    note = (
        f"A change of each value that would have a score of {MAX_NULL_SCORE:g} in these data, beside all fitted parameters. "
        "Smaller effects may be there without a trace.\n\n"
    )
    return "## What these data could show\n\n" + note + table(head, rows, left=1)


def _errors(result: Identification) -> str:
    head = ["trial", "held out?", "RMS before [mm, mrad]", "RMS after [mm, mrad]", "before [noise]", "after [noise]"]
    rows = [
        [e.trial, "yes" if e.held_out else "no", number(e.rms_before, 1e3), number(e.rms_after, 1e3),
         number(e.standardised_rms_before), number(e.standardised_rms_after)]
        for e in result.errors
    ]  # fmt: skip
    note = (
        "RMS of the distance from the light mass's tracked points to the model, as a length or an angle, and in units of the "
        "noise, of which 1 is the best possible. *Before*: the declared model, calibrated; *after*: the repaired model. The "
        f"verdict rests on {result.judged_on}.\n\n"
    )
    return note + table(head, rows, left=2)


def _outliers(result: Identification) -> str:
    if not result.outliers:
        return ""
    head = ["trial", "held out?", "channels", "outliers", "of", "farthest off", "when, by the file's clock [s]"]
    rows = [
        [o.trial, "yes" if o.held_out else "no", ", ".join(o.channels), str(o.count), str(o.of),
         quantity(o.largest_distance, o.unit), ", ".join(_interval(*i) for i in o.intervals)]
        for o in result.outliers
    ]  # fmt: skip
    note = (
        "These tracked points are far from where their neighbours lead one to expect them, so that they show another object; "
        "neither fits nor tests use them. What a model lacks moves many neighbouring points together and is not mistaken for "
        "an outlier. Correct them in the tracker, if you can.\n\n"
    )
    return "## Outliers\n\n" + note + table(head, rows, left=3)


def _interval(first: float, last: float) -> str:
    return number(first, digits=4) if first == last else f"{number(first, digits=4)} to {number(last, digits=4)}"


def _ties(result: Identification) -> str:
    if not result.ties:
        return ""
    text = "## Explanations that these data cannot tell apart\n\n"
    text += "\n".join(_effect_table(tie) for tie in result.ties)
    if not result.next_experiments:
        return text + "\nNo trial within the limits could be simulated to separate them.\n"
    head = ["release", "angle [deg]", "free length [cm]", "M2/M1", "distance [units of noise]", "closest explanations"]
    rows = [
        [e.release, number(math.degrees(e.release_angle)), number(e.free_length, 1e2), number(e.mass_ratio),
         number(e.distance), " / ".join(e.tells_apart)]
        for e in result.next_experiments
    ]  # fmt: skip
    best = result.next_experiments[0].distance
    advice = (
        "The first of these trials separates them best."
        if best > 3
        else "None of these trials separates them: measure the effect directly."
    )
    return (
        text
        + f"\n### Next experiment\n\n{advice} A distance below about 3 units of noise decides nothing.\n\n"
        + table(head, rows)
    )


def _figures(figures: Mapping[str, str]) -> str:
    if not figures:
        return ""
    return "## Figures\n\n" + "\n".join(f"![{caption}]({path})\n\n*{caption}*\n" for path, caption in figures.items())


def _rounds(result: Identification) -> str:
    if not result.rounds:
        score = f"{result.before.largest_score:.1f}"
        return f"None was refitted, since the declared model passes all tests. The largest score is {score}.\n"
    note = (
        f"A candidate passes if its delta BIC is at least {MIN_DELTA_BIC:g} and within {MIN_DELTA_BIC_MARGIN:g} of the best, "
        "its value is physically possible, and the model with it passes all tests, on residuals and on held-out data.\n\n"
    )
    return note + "\n".join(_round(r, i) for i, r in enumerate(result.rounds, start=1))


def _round(r: Round, index: int) -> str:
    head = ["candidate", "kind", "passes?", "score z", "delta BIC", "value [SI]", "+/-", "held-out chi2/n", "why not"]
    rows = [
        [c.name, c.kind, "yes" if c.passes else "no", signed(c.score), number(c.delta_bic), number(c.value, digits=4),
         number(c.error, digits=2), number(c.held_out_chi2), c.reason or GAP]
        for c in r.ranking
    ]  # fmt: skip
    before = f" with {', '.join(r.added_before)} in the model" if r.added_before else ""
    margin = ""
    if r.margin is not None:
        margin = f"Best: {r.best}; runner-up: {r.runner_up}, with a delta BIC {r.margin:.1f} lower.\n\n"
    if r.correlated_noise:
        before += ", with errors that last longer than a frame"
    return f"### Round {index}{before}\n\n{margin}{table(head, rows, left=3)}"


def _fit(fit: FitReport) -> str:
    head = ["parameter", "value [SI]", "standard error", "measured or start", "+/-", "moved by [its +/-]", "remark"]
    rows = []
    for n in fit.parameters:
        moved = (n.value - n.measured) / n.measured_error if n.measured_error else None
        rows.append(
            [n.name, number(n.value, digits=6), number(n.error, digits=2), number(n.measured, digits=6),
             number(n.measured_error, digits=2), signed(moved, digits=2), "on a bound" if n.at_bound else ""]
        )  # fmt: skip
    text = table(head, rows)
    text += (
        f"\nChi-square per degree of freedom {fit.chi2_per_dof:.3f}; on held-out data per value {fit.held_out_chi2:.3f}; "
        f"largest score of a remaining candidate {fit.largest_score:.1f}; "
        f"condition number {number(fit.condition_number, digits=2)}."
    )
    if fit.start_costs:
        text += f" The fits from different starts ended at costs {', '.join(f'{c:.1f}' for c in fit.start_costs)}."
    text += "\n\nFailed tests: " + ("; ".join(fit.failed_tests) if fit.failed_tests else "none") + ".\n"
    if fit.correlations:
        pairs = "; ".join(f"{a} and {b} {c:+.3f}" for a, b, c in fit.correlations)
        text += f"\nCorrelations of parameters above 0.9: {pairs}.\n"
    return text


def _provenance(result: Identification) -> str:
    versions = ", ".join(f"{k} {v}" for k, v in sorted(result.provenance.items()))
    return f"Study `{result.study}`, seed {result.seed}; {versions}. The same input and seed give the same bytes.\n"
