"""Render the report in Markdown from the result object alone.

First the verdict in one sentence, with one picture; then what to do next; then the details, and the numbers of all tests last.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

from looping_pendulum.compare.tables import GAP, number, signed, table
from looping_pendulum.discrepancy.record_start_summary import record_starts_in_words
from looping_pendulum.discrepancy.report import (
    event_report,
    lead_figure,
    next_steps,
    tests_report,
    unlisted_report,
    visible_report,
)
from looping_pendulum.discrepancy.result import (
    MIN_SEPARATION,
    FitReport,
    Identification,
    IdentifiedEffect,
    RankedExplanation,
    Verdict,
)
from looping_pendulum.discrepancy.verdict_sentence import limits_in_words
from looping_pendulum.pages.numbers import DISPLAY_UNITS, quantity, uncertain, unit_in_words

HEADLINES = {
    Verdict.NO_MISSING_EFFECT: "Nothing is missing that these data could show",
    Verdict.IDENTIFIED: "A missing effect was found",
    Verdict.AMBIGUOUS: "Something is missing, and these data allow several explanations",
    Verdict.UNLISTED: "A force that no library lists was found",
    Verdict.UNEXPLAINED: "Something is missing that no listed effect explains",
    Verdict.INTERRUPTED: "Interrupted",
}
PERHAPS_NOTHING = "Something may be missing, and these data allow several explanations"
"""Headline of an ambiguous verdict where one of the explanations is that nothing is missing."""


def render(result: Identification, figures: Mapping[str, str] | None = None) -> str:
    """Return the report.

    Parameters
    ----------
    figures
        Path below the report's folder -> caption.
    """
    images = {path: f"![{caption}]({path})\n\n*{caption}*\n" for path, caption in (figures or {}).items()}
    # If nothing was tracked, the events are all that there is to see
    first = images.pop(f"figures/{lead_figure.NAME if result.trial_figures else 'events.png'}", "")
    title, verdict, *others = before_figures(result)
    rest = "## Figures\n\n" + "\n".join(images.values()) if images else ""
    return "\n".join(s for s in [title, verdict, first, *others, rest, *after_figures(result)] if s)


def before_figures(result: Identification) -> list[str]:
    """Return the sections above the figures, the title and the verdict first; some are empty."""
    return [
        f"# {result.title}\n",
        f"## Verdict: {_headline(result)} (`{result.verdict.value}`)\n\n{result.sentence}\n",
        next_steps.section(result),
        "## Further remarks\n\n" + "".join(f"- {note}\n" for note in result.notes) if result.notes else "",
        _effects(result),
        unlisted_report.section(result),
        "## Error before and after\n\n" + _errors(result),
        record_starts_in_words(result.record_starts),
        visible_report.correlated_noise_section(result),
        _outliers(result),
        event_report.section(result),
        _ties(result),
    ]


def after_figures(result: Identification) -> list[str]:
    """Return the sections below the figures; some are empty."""
    return [
        "## Explanations that were compared\n\n" + _explanations(result),
        visible_report.section(result),
        tests_report.section(result),
        "## Declared model, calibrated\n\n" + _fit(result.before),
        "## Repaired model\n\n" + _fit(result.after) if result.effects or result.unlisted else "",
        "## Data\n\n" + "".join(f"- {line}\n" for line in result.data),
        "## Provenance\n\n" + _provenance(result),
    ]


def _headline(result: Identification) -> str:
    if result.verdict is Verdict.AMBIGUOUS and not all(e.names for e in result.credible):
        return PERHAPS_NOTHING
    return HEADLINES[result.verdict]


def _effects(result: Identification) -> str:
    if not result.effects:
        return ""
    note = "At its null value an effect is absent.\n\n"
    return f"## What was added\n\n{note}{_effect_table(result.effects)}"


def _effect_table(effects: tuple[IdentifiedEffect, ...]) -> str:
    head = ["effect", "kind", "acts on", "depends on", "formula", "value", "standard error", "95 % interval", "null value",
            "unit"]  # fmt: skip
    rows = [
        [e.name, e.kind, e.acts_on, ", ".join(e.depends_on) or GAP, f"`{e.formula}`", number(e.value, digits=5),
         number(e.error, digits=2), limits_in_words(*e.interval_95, _to_four_digits) or GAP, number(e.null_value),
         unit_in_words(e.unit) or GAP]
        for e in effects
    ]  # fmt: skip
    return table(head, rows, left=5) + _notes(effects)


def _to_four_digits(value: float) -> str:
    """Write an end of an interval: to three digits, those about a ratio of 1 would mostly be 1."""
    return number(value, digits=4)


def _notes(effects: Iterable[IdentifiedEffect]) -> str:
    """Return what the numbers of effects mean, and what was fitted with them."""
    note = ""
    for e in dict.fromkeys(effects):
        # Not where it would say that a parameter is itself
        note += f"\nThe value of {e.name} {e.meaning} {e.parameter}.\n" if e.name != e.parameter else ""
        note += "".join(f"\nFitted with {e.name}: {n} = {uncertain(v, s)} [SI].\n" for n, v, s in e.companions)
    return note


def _errors(result: Identification) -> str:
    units = ", ".join(DISPLAY_UNITS[unit].name for unit in sorted({e.unit for e in result.errors}) if unit in DISPLAY_UNITS)
    units = units or GAP
    head = ["trial", "held out?", f"RMS before [{units}]", f"RMS after [{units}]", "before [noise]", "after [noise]"]
    rows = [
        [e.trial, "yes" if e.held_out else "no", number(e.rms_before, 1e3), number(e.rms_after, 1e3),
         number(e.standardised_rms_before), number(e.standardised_rms_after)]
        for e in result.errors
    ]  # fmt: skip
    note = (
        "RMS of the distance from the light mass's tracked points to the model, as a length, an angle or an angular velocity, "
        "and in units of the noise, of which 1 is the best possible. *Before*: the declared model, calibrated; *after*: the "
        f"repaired model. Fits that have not seen the {result.judged_on} predict these here.\n\n"
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
    """Return the explanations that the data do not exclude, and which trial would; empty if there is only one."""
    credible = result.credible
    if len(credible) < 2 or result.verdict is Verdict.INTERRUPTED:
        return ""
    text = (
        "## Explanations that these data cannot tell apart\n\nTogether they have 95 % of the probability.\n\n"
        + _explanations_table(credible)
    )
    # No trial is simulated with an unlisted law, of which nothing is known where it did not act; nothing missing can be
    if result.verdict is not Verdict.AMBIGUOUS or sum(not e.law for e in credible) < 2:
        return text
    if not result.next_experiments:
        return text + "\nNo trial within the limits could be simulated to separate them.\n"
    head = ["release", "angle [deg]", "free length [cm]", "M2/M1", "separated pairs", "of", "distance [units of noise]",
            "closest of these"]  # fmt: skip
    rows = [
        [e.release, number(math.degrees(e.release_angle)), number(e.free_length, 1e2), number(e.mass_ratio),
         str(e.separated_pairs), str(e.pairs), number(e.distance), " / ".join(e.tells_apart)]
        for e in result.next_experiments
    ]  # fmt: skip
    return (
        text
        + "\n### Next experiment\n\nA trial separates two explanations whose predictions are more than "
        + f"{MIN_SEPARATION:g} units of noise apart.\n\n"
        + table(head, rows)
    )


def _explanations_table(explanations: Sequence[RankedExplanation]) -> str:
    """Return one table of explanations, a line for each of their parts."""
    head = ["explanation", "probability", "adds", "acts on", "formula", "value", "95 % interval", "null value"]
    rows = []
    for i, one in enumerate(explanations, start=1):
        of_one = [
            [e.name, e.acts_on, f"`{e.formula}`", uncertain(e.value, e.error, e.unit),
             limits_in_words(*e.interval_95, _to_four_digits) or GAP, number(e.null_value)]
            for e in one.effects
        ]  # fmt: skip
        of_one += [[f"a {one.law.in_words}", *[GAP] * 5]] if one.law else []
        first = [str(i), probability_in_words(one.probability)]
        for row in of_one or [["nothing", *[GAP] * 5]]:
            rows.append([*first, *row])
            first = ["", ""]
    return table(head, rows, left=5) + _notes(e for one in explanations for e in one.effects)


def probability_in_words(p: float | None) -> str:
    """Return a probability as a percentage; that of what is counted with another explanation as a gap."""
    if p is None:
        return GAP
    return "over 99.9 %" if p > 0.999 else "below 0.1 %" if p < 1e-3 else f"{100 * p:.1f} %"


def _explanations(result: Identification) -> str:
    note = (
        "How probable each explanation is, given all data and what is known of it beforehand, the most probable first; all "
        "that were fitted have 100 % together. The odds compare it with the declared model, to which nothing is added. An "
        "explanation that is less probable than a part of it is counted with that part: what it adds does not show.\n\n"
    )
    head = ["added to the declared model", "probability", "odds (log10)", "values"]
    rows = [
        [" + ".join(one.names) or "nothing", probability_in_words(one.probability), signed(one.log10_odds, digits=3),
         "; ".join(uncertain(e.value, e.error, e.unit) for e in one.effects) or GAP]
        for one in result.explanations
    ]  # fmt: skip
    return note + table(head, rows, left=1)


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
    rows = [
        ["chi2 per degree of freedom", f"{fit.chi2_per_dof:.3f}"],
        ["largest chi2 per value on held-out data", f"{fit.held_out_chi2:.3f}"],
        ["condition number", number(fit.condition_number, digits=2)],
        *([f"cost from start {i}", f"{c:.1f}"] for i, c in enumerate(fit.start_costs, start=1)),
    ]
    text += "\n" + table(["of the fit", "value"], rows)
    text += "\nWhat fails: " + ("; ".join(fit.failed_tests) if fit.failed_tests else "nothing") + ".\n"
    if fit.correlations:
        pairs = "; ".join(f"{a} and {b} {c:+.3f}" for a, b, c in fit.correlations)
        text += f"\nCorrelations of parameters above 0.9: {pairs}.\n"
    return text


def _provenance(result: Identification) -> str:
    versions = ", ".join(f"{k} {v}" for k, v in sorted(result.provenance.items()))
    return f"Study `{result.study}`, seed {result.seed}; {versions}. The same input and seed give the same bytes.\n"
