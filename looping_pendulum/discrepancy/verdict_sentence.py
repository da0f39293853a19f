"""The verdict in one sentence of plain words, and the notes that belong to it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from operator import attrgetter

from looping_pendulum.discrepancy.outlier_summary import outliers_in_words
from looping_pendulum.discrepancy.result import IdentifiedEffect, Round, Unlisted, Verdict, law_in_words
from looping_pendulum.discrepancy.trial_results import CorrelatedError, Outliers, TrialError
from looping_pendulum.pages.numbers import amount, quantity, uncertain

BODY_IN_WORDS = {
    "light": "light mass",
    "heavy": "heavy mass",
    "angle": "angle",
    "angle_rate": "angular velocity",
    "height": "height",
}
"""Body, of `observations.BODIES`, in words."""
MIN_VISIBLE_SHARE = 0.1
"""Share of its distance by which a model must come nearer for the sentence to call it nearer."""

MAX_TIES_WITH_VALUES = 3
"""Number of tied explanations up to which the sentence has their values; those of more are read in the report's table."""


def effect_in_words(effect: IdentifiedEffect) -> str:
    """Return an effect in words: "linear_drag = 0.00120 +/- 0.00003 kg/s", "static_friction of at least 1.18"."""
    if effect.interval is None:
        return f"{effect.name} = {uncertain(effect.value, effect.error, effect.unit)}"
    low, high = effect.interval

    def write(value: float) -> str:
        # To three digits those about a ratio of 1 would mostly be 1
        return quantity(value, effect.unit, 4 if abs(value - effect.null_value) < 0.1 * abs(effect.null_value) else 3)

    limits = limits_in_words(low, high, write)
    if (low is None) != (high is None):
        return f"{effect.name} of {limits}"
    return f"{effect.name} = {write(effect.value)} ({f'probably {limits}' if limits else 'the data set it no limits'})"


def limits_in_words(low: float | None, high: float | None, write: Callable[[float], str]) -> str:
    """Return an interval whose ends ``write`` writes; an end that is None is open. Empty: both are."""
    if low is not None and high is not None:
        return f"{write(low)} to {write(high)}"
    if low is not None:
        return f"at least {write(low)}"
    return "" if high is None else f"at most {write(high)}"


def verdict_sentence(
    verdict: Verdict,
    effects: Sequence[IdentifiedEffect],
    ties: Sequence[Sequence[IdentifiedEffect]],
    unlisted: Unlisted | None,
    errors: Sequence[TrialError],
    *,
    failures: Sequence[str],
    own_effects: bool,
) -> str:
    """Return the verdict in one sentence.

    Parameters
    ----------
    failures
        What the tests mean that the declared model fails.
    own_effects
        Whether the study has effects of its own beside those of the library.
    """
    worst = worst_trial(errors)
    after = distance(worst, after=True)
    where = f"the data of {trial_in_words(worst)}"
    if verdict is Verdict.NO_MISSING_EFFECT:
        return f"The declared model is enough: it comes to within {after} of {where}, as near as their errors allow."
    if verdict is Verdict.INTERRUPTED:
        return f"The search was interrupted before its end: so far, the best model comes to within {after} of {where}."
    if verdict is Verdict.IDENTIFIED:
        added = " and ".join(effect_in_words(e) for e in effects)
        verb, them = ("explain", "them") if len(effects) > 1 else ("explains", "it")
        return f"{added} {verb} what the declared model misses: with {them}, {_nearer(worst)}."
    if verdict is Verdict.AMBIGUOUS:
        in_words = effect_in_words if len(ties) <= MAX_TIES_WITH_VALUES else attrgetter("name")
        explanations = [" and ".join(map(in_words, tie)) for tie in ties]
        explanations += [f"a {unlisted.in_words}, which is not listed"] if unlisted else []
        return (
            f"Something is missing, and these data cannot say which of {len(explanations)} explanations is right: "
            f"{'; or '.join(explanations)}; "
            f"with the first, {_nearer(worst)}."
        )
    candidates = "the library or of the study" if own_effects else "the library"
    if unlisted is not None:
        beside = f", beside {' and '.join(effect_in_words(e) for e in effects)}," if effects else ""
        size = ""
        if unlisted.multiplied_by == "constant":
            size = f", of up to {quantity(max(abs(p.largest) for p in unlisted.profiles), unlisted.value_unit)},"
        return (
            f"No effect of {candidates} explains what the declared model misses, but{beside} a {unlisted.in_words}{size} does: "
            f"with it, {_nearer(worst)}."
        )
    if worst.standardised_rms_after <= 1 + MIN_VISIBLE_SHARE:
        return (
            f"The declared model comes to within {after} of {where}, as near as their errors allow, "
            f"but {' and '.join(failures)}, and no effect of {candidates} explains it."
        )
    errors_of_data = f", {amount(worst.standardised_rms_after)} times their error" if worst.rms_after is not None else ""
    return (
        f"Something is missing that no effect of {candidates} explains: the declared model comes no nearer than {after} to "
        f"{where}{errors_of_data}."
    )


def verdict_notes(
    verdict: Verdict,
    rounds: Sequence[Round],
    unlisted: Unlisted | None,
    errors: Sequence[CorrelatedError],
    outliers: Sequence[Outliers],
) -> tuple[str, ...]:
    """Return further sentences on the verdict."""
    notes = []
    if verdict is Verdict.UNLISTED and unlisted and (laws := laws_not_excluded(unlisted)):
        count = len(laws)
        others = f"{count} others" if count > 1 else "another one"
        notes.append(f"Which law it is, is less sure than that there is one: the data do not exclude {others}.")
    if verdict is Verdict.IDENTIFIED:
        notes += [f"{c.name} was ruled out, as {c.held_by}." for c in rounds[-1].ranking if c.held_by]
    if rounds and (verdict is Verdict.UNEXPLAINED or (verdict is Verdict.NO_MISSING_EFFECT and not errors)):
        # Of the first round: later ones already have an effect in the model that was not accepted
        best = next((r for r in rounds[0].ranking if r.delta_bic is not None), None)
        notes += [f"{best.name} comes nearest and does not pass: {best.reason}."] if best and best.reason else []
    notes += [_correlated_noise_in_words(errors)] if errors else []
    notes += [outliers_in_words(outliers)] if outliers else []
    return tuple(notes)


def laws_not_excluded(force: Unlisted) -> tuple[str, ...]:
    """Return the laws that the data do not exclude in place of an unlisted force's, as parts of a sentence."""
    others = dict.fromkeys(law_in_words(o.acts_on, o.depends_on) for o in force.other_closures if not o.excluded)
    return tuple(law for law in others if law != law_in_words(force.acts_on, force.depends_on))


def worst_trial(errors: Sequence[TrialError]) -> TrialError:
    """Return the trial that the declared model misses by most, of the held-out ones if there are any."""
    return max((e for e in errors if e.held_out), key=lambda e: e.standardised_rms_before, default=errors[0])


def trial_in_words(error: TrialError) -> str:
    """Return which trial it is: "the held-out trial eight"."""
    if error.held_out and error.trial == "blocks of time":
        return "the held-out blocks of time"
    return f"the {'held-out ' if error.held_out else ''}trial {error.trial}"


def distance(error: TrialError, *, after: bool) -> str:
    """Return how far the repaired or the declared model is from a trial, as a length if it has one: "1.4 mm (RMS)"."""
    rms, standardised = (
        (error.rms_after, error.standardised_rms_after) if after else (error.rms_before, error.standardised_rms_before)
    )
    if rms is None or not error.unit:
        return f"{amount(standardised)} standard errors (RMS)"
    return f"{quantity(rms, error.unit, digits=3)} (RMS)"


def _nearer(error: TrialError) -> str:
    """Return how much nearer the repaired model comes to a trial than the declared one."""
    before, after = distance(error, after=False).removesuffix(" (RMS)"), distance(error, after=True)
    where = f"the data of {trial_in_words(error)}"
    size_before, size_after = error.rms_before, error.rms_after
    if size_before is None or size_after is None or not error.unit:
        size_before, size_after = error.standardised_rms_before, error.standardised_rms_after
    if size_after > (1 - MIN_VISIBLE_SHARE) * size_before:
        return f"the model is {after} from {where} ({before} without), and what is left looks like noise"
    return f"the model comes to within {after} of {where}, instead of {before}"


def _correlated_noise_in_words(errors: Sequence[CorrelatedError]) -> str:
    each = " and ".join(
        f"{quantity(e.amplitude, e.unit)} ({BODY_IN_WORDS[e.body]}) for some {amount(e.points)} points in a row" for e in errors
    )
    return (
        f"The tracked points are off by about {each}, as when a tracker wanders over its mark; an effect that looks like this "
        "cannot be seen in these data."
    )
