"""Render the report in Markdown from the result object alone.

First the verdict in one sentence, with one picture; then what to do next; then the details, and the numbers of all tests last.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

from looping_pendulum.compare.landmarks import quantity_label
from looping_pendulum.discrepancy.candidates import in_words
from looping_pendulum.discrepancy.fit.event_prediction import MISSED_EVENT_ERRORS
from looping_pendulum.discrepancy.fit.residual import ModelTest
from looping_pendulum.discrepancy.report import next_steps
from looping_pendulum.discrepancy.result import (
    MIN_SEPARATION,
    EventResidual,
    FitReport,
    Identification,
    IdentifiedEffect,
    RankedExplanation,
    Unlisted,
    Verdict,
)
from looping_pendulum.discrepancy.verdict_sentence import BODY_IN_WORDS, limits_in_words
from looping_pendulum.pages.markdown import table
from looping_pendulum.pages.numbers import DISPLAY_UNITS, GAP, amount, number, quantity, signed, uncertain, unit_in_words
from looping_pendulum.reference_ode.effects.types import EffectKind

HEADLINES = {
    Verdict.NO_MISSING_EFFECT: "Nothing is missing that these data could show",
    Verdict.IDENTIFIED: "A missing effect was found",
    Verdict.AMBIGUOUS: "Something is missing, and these data allow several explanations",
    Verdict.UNLISTED: "A force that no library lists was found",
    Verdict.UNEXPLAINED: "No explanation that was tried passes its tests",
    Verdict.INTERRUPTED: "Interrupted",
}
PERHAPS_NOTHING = "Something may be missing, and these data allow several explanations"
"""Headline of an ambiguous verdict where one of the explanations is that nothing is missing."""
MOTION, EVENTS = "motion", "events"
"""Names of the first figure: of one trial or, if nothing was tracked, of the events."""
SIDES = {
    "along": "along the string, towards the rod",
    "across": "across the string, the way it loops",
    "heavy": "on the heavy mass, upward",
    "gradient": "the way in which the coordinate grows",
    "friction": "coefficient of friction",
}
"""Direction of a force (`ForceProfile.side`) -> words."""
IN_NO_REPAIRED_MODEL = "It is one of several explanations; the repaired model has the most probable one, without this force."
MAX_VISIBLE = 10
"""Effects in the table of what these data could show."""


def identification_markdown(result: Identification, figures: Mapping[str, str] | None = None) -> str:
    """Return the report.

    Parameters
    ----------
    figures
        Path below the report's folder -> caption.
    """
    images = {path: f"![{caption}]({path})\n\n*{caption}*\n" for path, caption in (figures or {}).items()}
    first = images.pop(f"figures/{first_figure(result)}.png", "")
    title, verdict, *others = before_figures(result)
    rest = "## Figures\n\n" + "\n".join(images.values()) if images else ""
    return "\n".join(s for s in [title, verdict, first, *others, rest, *after_figures(result)] if s)


def first_figure(result: Identification) -> str:
    """Return the name of the figure directly below the verdict."""
    # If nothing was tracked, the events are all that there is to see
    return MOTION if result.trial_figures else EVENTS


def before_figures(result: Identification) -> list[str]:
    """Return the sections above the figures, the title and the verdict first; some are empty."""
    headline = HEADLINES[result.verdict]
    if result.verdict is Verdict.AMBIGUOUS and not all(e.names for e in result.credible):
        headline = PERHAPS_NOTHING
    return [
        f"# {result.title}\n",
        f"## Verdict: {headline} (`{result.verdict.value}`)\n\n{result.sentence}\n",
        next_steps.section(result),
        "## Further remarks\n\n" + "".join(f"- {note}\n" for note in result.notes) if result.notes else "",
        _effects(result),
        unlisted_force(result),
        _errors(result),
        _record_starts(result),
        _correlated_noise(result),
        _outliers(result),
        _events(result),
        _ties(result),
    ]


def after_figures(result: Identification) -> list[str]:
    """Return the sections below the figures; some are empty."""
    versions = ", ".join(f"{k} {v}" for k, v in sorted(result.provenance.items()))
    origin = f"Study `{result.study}`, seed {result.seed}; {versions}. The same input and seed give the same bytes.\n"
    return [
        _explanations(result),
        smallest_visible(result),
        _tests(result),
        "## Declared model, calibrated\n\n" + _fit(result.before),
        f"## {result.other_model.capitalize()}\n\n{_fit(result.after)}" if result.has_other_model else "",
        "## Data\n\n" + "".join(f"- {line}\n" for line in result.data),
        "## Provenance\n\n" + origin,
    ]


def _section(title: str, note: str, head: Sequence[str], rows: Sequence[Sequence[str]], *, left: int) -> str:
    """Return a section with a table; empty without rows. The first ``left`` columns are words."""
    return f"## {title}\n\n{note}\n\n{table(head, rows, left=left)}" if rows else ""


def _effects(result: Identification) -> str:
    if not result.effects:
        return ""
    head = ["effect", "kind", "acts on", "depends on", "formula", "value", "standard error", "95 % interval", "absent at",
            "unit"]  # fmt: skip
    rows = [
        [in_words(e.name), e.kind, e.acts_on, _depends_on(e), f"`{e.formula}`", number(e.value, digits=5),
         number(e.error, digits=2), limits_in_words(*e.interval_95, _to_four_digits) or GAP, number(e.null_value),
         unit_in_words(e.unit) or GAP]
        for e in result.effects
    ]  # fmt: skip
    return f"## What was added\n\n{table(head, rows, left=5)}{_notes(result.effects)}"


def _depends_on(e: IdentifiedEffect) -> str:
    """Say on what the size of an effect depends, and along which axis its force acts: "constant, along x"."""
    words = list(e.depends_on) or (["constant"] if e.kind == EffectKind.FORCE.value else [])
    return ", ".join([*words, *([f"along {e.direction}"] if e.direction else [])]) or GAP


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


def unlisted_force(result: Identification) -> str:
    """Return the section on the unlisted force; empty without one."""
    force = result.unlisted
    if force is None:
        return ""
    unit, name = force.unit, force.depends_on.replace("_", " ")
    head = ["direction", f"largest at {name} [{unit}]", f"largest [{force.value_unit or 1}]", f"significant between [{unit}]",
            "formula"]  # fmt: skip
    rows = []
    for p in force.profiles:
        significant = GAP if p.significant_from is None else f"{number(p.significant_from)} and {number(p.significant_to)}"
        rows.append([SIDES[p.side], number(p.largest_at), number(p.largest), significant, f"`{p.formula}`"])
    model = IN_NO_REPAIRED_MODEL
    if result.explanations[0].law and force.formula is None:
        model = "The repaired model has these, since no simple formula explains held-out data as well."
    elif result.explanations[0].law:
        model = (
            "The repaired model has the formula, which explains the data better than these; its parameters are fitted to the "
            "trajectories together with those of the declared model."
        )
    text = (
        "## The unlisted force\n\n"
        f"It is a {force.in_words} (s in the formula), and acts {force.phase}. It was found as a sum of radial "
        f"basis functions of that coordinate. {model} "
        "*Significant*: above two standard errors.\n\n" + table(head, rows, left=1)
    )
    if force.formula is None:
        return text
    head = ["parameter", "value", "standard error", "unit"]
    rows = [
        [n.name.replace("_", ", "), number(n.value, digits=4), number(n.error, digits=2), n.unit]
        for n in force.formula.parameters
    ]
    note = "A pulse is a Gaussian, whose width is its standard deviation; an odd pulse changes sign at its place."
    return f"{text}\n{table(head, rows, left=1)}\n{note}\n"


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
        f"{result.other_model}. Fits that have not seen the {result.judged_on} predict these here."
    )
    return _section("Error before and after", note, head, rows, left=2)


def _record_starts(result: Identification) -> str:
    """Return the section on records that begin in mid-swing; empty if none does."""
    lines = [
        f"- {s.trial}: at {number(s.time, digits=4)} s by the file's clock, the first tracked point, the wrap angle is "
        f"{uncertain(math.degrees(s.angle), math.degrees(s.angle_error), 'deg')} (180 deg is straight down) and the light mass "
        f"moves across its string at {uncertain(s.speed, s.speed_error, 'm/s')}.\n"
        for s in result.record_starts
    ]
    if not lines:
        return ""
    note = (
        "These records begin in mid-swing, so that the motion begins at their first tracked point. Its angle and speed are "
        "fitted unless the study states them (`release: {angle: ..., speed: ...}`); they are no push.\n\n"
    )
    return "## Start of the records\n\n" + note + "".join(lines)


def _correlated_noise(result: Identification) -> str:
    """Return the section on errors that last longer than a frame; empty if there are none."""
    head = ["tracked points of", "typically off by", "for about", "that is"]
    rows = [
        [BODY_IN_WORDS[e.body], quantity(e.amplitude, e.unit), quantity(e.correlation_time, "s"), f"{amount(e.points)} points"]
        for e in result.correlated_noise
    ]
    note = (
        "The tracked points do not only scatter from frame to frame. Neighbouring ones are off in the same direction, as when "
        "a tracker or a hand wanders over the mark. The tests allow for it; the price is that a small effect can hide behind "
        "it. Marks that are set anew in every frame, on a larger picture, would make it smaller."
    )
    return _section("Errors that last longer than a frame", note, head, rows, left=1)


def _outliers(result: Identification) -> str:
    head = ["trial", "held out?", "channels", "outliers", "of points", "farthest off", "when, by the file's clock [s]"]
    rows = [
        [o.trial, "yes" if o.held_out else "no", ", ".join(o.channels), str(o.count), str(o.of),
         quantity(o.largest_distance, o.unit), ", ".join(_interval(*i) for i in o.intervals)]
        for o in result.outliers
    ]  # fmt: skip
    note = (
        "These tracked points are far from where their neighbours lead one to expect them, so that they show another object; "
        "neither fits nor tests use them. What a model lacks moves many neighbouring points together and is not mistaken for "
        "an outlier. Correct them in the tracker, if you can."
    )
    return _section("Outliers", note, head, rows, left=3)


def _interval(first: float, last: float) -> str:
    return number(first, digits=4) if first == last else f"{number(first, digits=4)} to {number(last, digits=4)}"


def _events(result: Identification) -> str:
    """Return the section on events; empty if none was measured."""
    head = ["trial", "held out?", "event", "unit", "measured", "+/-", "declared model", "off by", result.other_model, "off by"]
    rows = [
        [e.trial, "yes" if e.held_out else "no", quantity_label(e.quantity, e.index), e.unit or GAP,
         number(e.measured, digits=4), number(e.sigma, digits=2), number(e.before, digits=4), off_by(e, e.before),
         number(e.after, digits=4), off_by(e, e.after)]
        for e in result.events
    ]  # fmt: skip
    note = (
        "Off by: measured less predicted, in standard errors. An event without a prediction does not happen in that model's "
        f"run, and counts as missed by {MISSED_EVENT_ERRORS:g} standard errors."
    )
    text = _section("Events", note, head, rows, left=4)
    rows = [
        [e.trial, "yes" if e.held_out else "no", DISPLAY_UNITS[unit].name,
         *(number(errors.get(unit), DISPLAY_UNITS[unit].per_si_unit) for errors in (e.events_before, e.events_after))]
        for e in result.errors
        for unit in sorted({*e.events_before, *e.events_after})
        if unit in DISPLAY_UNITS
    ]  # fmt: skip
    head = ["trial", "held out?", "unit", "RMS of its events, declared model", result.other_model]
    return f"{text}\n{table(head, rows, left=3) if rows else ''}" if text else ""


def off_by(event: EventResidual, predicted: float | None) -> str:
    """Return measured less predicted in standard errors, in words."""
    return "does not happen" if predicted is None else signed((event.measured - predicted) / event.sigma, digits=2)


def _ties(result: Identification) -> str:
    """Return the explanations that the data do not exclude, and which trial would; empty if there is only one."""
    credible = result.credible
    if len(credible) < 2 or result.verdict is Verdict.INTERRUPTED:
        return ""
    text = (
        "## Explanations that these data cannot tell apart\n\nTogether they have at least 95 % of the probability.\n\n"
        + _explanations_table(credible)
    )
    # No trial is simulated with an unlisted law, of which nothing is known where it did not act; nothing missing can be
    if result.verdict is not Verdict.AMBIGUOUS or sum(not e.law for e in credible) < 2:
        return text
    if not result.next_experiments:
        return text + "\nNo trial within the limits could be simulated to separate them.\n"
    head = ["release", "angle [deg]", "free length [cm]", "M2/M1", "separated pairs", "of pairs", "distance [units of noise]",
            "closest of these"]  # fmt: skip
    rows = [
        [e.release, number(math.degrees(e.release_angle)), number(e.free_length, 1e2), number(e.mass_ratio),
         str(e.separated_pairs), str(e.pairs), number(e.distance), " / ".join(map(_parts_in_words, e.tells_apart))]
        for e in result.next_experiments
    ]  # fmt: skip
    return (
        text
        + "\n### Next experiment\n\nA trial separates two explanations whose predictions are more than "
        + f"{MIN_SEPARATION:g} units of noise apart.\n\n"
        + table(head, rows)
    )


def _parts_in_words(names: str) -> str:
    """Return the names of an explanation's parts, "wind_speed+side_force", in plain words."""
    return " and ".join(map(in_words, names.split("+")))


def _explanations_table(explanations: Sequence[RankedExplanation]) -> str:
    """Return one table of explanations, a line for each of their parts."""
    head = ["explanation", "probability", "adds", "acts on", "formula", "value", "95 % interval", "absent at"]
    rows = []
    for i, one in enumerate(explanations, start=1):
        of_one = [
            [in_words(e.name), e.acts_on, f"`{e.formula}`", uncertain(e.value, e.error, e.unit),
             limits_in_words(*e.interval_95, _to_four_digits) or GAP, number(e.null_value)]
            for e in one.effects
        ]  # fmt: skip
        of_one += [[f"a {one.law.in_words}", *[GAP] * 5]] if one.law else []
        first = [str(i), _probability(one)]
        for row in of_one or [["nothing", *[GAP] * 5]]:
            rows.append([*first, *row])
            first = ["", ""]
    return table(head, rows, left=5) + _notes(e for one in explanations for e in one.effects)


def probability_in_words(p: float | None) -> str:
    """Return a probability as a percentage; that of what is counted with another explanation as a gap."""
    if p is None:
        return GAP
    return "over 99.9 %" if p > 0.999 else "below 0.1 %" if p < 1e-3 else f"{100 * p:.1f} %"


def _probability(one: RankedExplanation) -> str:
    return probability_in_words(one.probability) + (" (sampled)" if one.checked else "")


def _explanations(result: Identification) -> str:
    note = (
        f"{result.explanations_fitted} explanations were fitted. How probable each is, given all data and what is known of it "
        "beforehand, the most probable first; all that were fitted have 100 % together. The table goes on after those that "
        "cannot be excluded, with the best of each kind. The odds compare an explanation with the declared model, to which "
        "nothing is added. An explanation that is less probable than a part of it is counted with that part: what it adds does "
        "not show. *Sampled*: the probability is by importance sampling, not by a Gaussian about the best fit. The held-out "
        "error is that of the worst trial, in units of noise, where it was looked at."
    )
    head = ["added to the declared model", "probability", "odds (log10)", "held-out error", "values"]
    rows = [
        [one.in_words, _probability(one), signed(one.log10_odds, digits=3),
         number(one.held_out_error), "; ".join(uncertain(e.value, e.error, e.unit) for e in one.effects) or GAP]
        for one in result.explanations
    ]  # fmt: skip
    return _section("Explanations that were compared", note, head, rows, left=1)


def smallest_visible(result: Identification) -> str:
    """Return the section on the smallest visible effects; empty if there are none."""
    visible = result.smallest_visible
    hiding = ""
    if result.can_hide:
        hiding = (
            f" No size of {', '.join(result.can_hide)} would be sure to show: what is fitted with it can keep it from "
            "acting, as friction in a bearing does, or a drag or friction of zero that it multiplies."
        )
    head = ["effect", "acts on", "smallest size that would show", "moves the masses by [noise]"]
    rows = [[in_words(v.name), v.acts_on, v.in_words, number(v.motion, digits=2)] for v in visible[:MAX_VISIBLE]]
    rest = f" The other {len(visible) - MAX_VISIBLE} are in `verdict.json`." if len(visible) > MAX_VISIBLE else ""
    note = (
        "An effect that is smaller than this may be there without a trace. The first of the list can hide best: an effect of "
        "that size moves the masses by the most, but the fitted masses, lengths, friction and camera settings make up for it. "
        f"A percentage is that of the value itself.{rest}{hiding}"
    )
    return _section("What these data could show", note, head, rows, left=2)


def _tests(result: Identification) -> str:
    """Return the section on the numbers behind the verdict: every test of the declared and of the most probable model."""
    models = {"declared model": result.before.tests}
    if result.has_other_model:
        models[result.other_model] = result.after.tests
    head = ["tested", "number", "limit", *(f"{word}{name}" for name in models for word in ("", "passes, "))]
    by_test: dict[tuple[str, ...], dict[str, ModelTest]] = {}
    for name, tests in models.items():
        for t in tests:
            limit = f"{'at least' if t.limit_is_lower else 'at most'} {number(t.limit)}"
            by_test.setdefault((t.subject, t.statistic, limit), {})[name] = t
    rows = []
    for test, results in by_test.items():
        of_models = [results.get(name) for name in models]
        cells = [(GAP, GAP) if t is None else (number(t.value), "yes" if t.passes else "no") for t in of_models]
        rows.append([*test, *(cell for pair in cells for cell in pair)])
    note = (
        "Whether the fit has converged, whether the residuals look like noise, in size and in every part of the motion, and "
        "whether a fit of the training trials predicts the held-out data. The verdict rests on the probabilities above; but a "
        "model that fails a test of its fit, or predicts held-out data no better than the declared one, explains nothing.\n\n"
    )
    text = "## Tests\n\n" + note + table(head, rows, left=3)
    return text if result.unlisted is None else f"{text}\n{_tests_of_force(result.unlisted)}"


def _tests_of_force(force: Unlisted) -> str:
    """Return the tables of the numbers behind the unlisted force, and of all formulas that were refitted."""
    f = force.formula
    rows = [
        ["the model with radial basis functions over that without", "ln of the Bayes factor", number(force.log_bayes_factor)],
        ["declared model on held-out data", "chi2 per value", number(force.held_out_chi2_before)],
        ["repaired model on held-out data", "chi2 per value", number(force.held_out_chi2_after)],
    ]
    if f is not None:
        rows += [
            ["formula over the declared model", "delta BIC", number(f.delta_bic)],
            ["formula over the radial basis functions", "delta BIC", number(f.delta_bic - f.delta_bic_of_profile)],
        ]
    text = "### The unlisted force\n\n" + table(["compared", "number", "value"], rows, left=2)
    if not force.formulas:
        return text
    head = ["formula", "depends on", "multiplied by", "accepted?", "delta BIC", "delta BIC of RBF", "held-out chi2/n", "of RBF"]
    rows = [
        [f.form, *(word.replace("_", " ") for word in (f.depends_on, f.multiplied_by)), "yes" if f.accepted else "no",
         f"{f.delta_bic:.1f}", f"{f.delta_bic_of_profile:.1f}", number(f.held_out_chi2), number(f.held_out_chi2_of_profile)]
        for f in force.formulas
    ]  # fmt: skip
    return (
        text
        + "\nFormulas that were refitted to the trajectories (RBF: the radial basis functions that each was fitted to):\n\n"
        + table(head, rows, left=4)
    )


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
