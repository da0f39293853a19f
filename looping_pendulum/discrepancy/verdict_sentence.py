"""The verdict in one sentence of plain words, and the notes that belong to it."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from looping_pendulum.discrepancy.candidates import in_words
from looping_pendulum.discrepancy.fit.residual import failures_in_words
from looping_pendulum.discrepancy.result import (
    CorrelatedError,
    IdentifiedEffect,
    Outliers,
    RankedExplanation,
    TrialError,
    Unlisted,
    Verdict,
)
from looping_pendulum.discrepancy.verdict import ModelTests
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

MAX_TIES_WITH_VALUES, MAX_TIES = 3, 6
"""Number of tied explanations up to which the sentence has their values, and their names; the report's table has all."""


def effect_in_words(effect: IdentifiedEffect) -> str:
    """Return an effect in words: "a wind (wind_speed) = 0.120 +/- 0.003 m/s", "a wind (wind_speed) of at most 2 m/s"."""
    name = in_words(effect.name)
    if effect.interval is None:
        return f"{name} = {uncertain(effect.value, effect.error, effect.unit)}"
    low, high = effect.interval

    def write(value: float) -> str:
        # To three digits those about a ratio of 1 would mostly be 1
        return quantity(value, effect.unit, 4 if abs(value - effect.null_value) < 0.1 * abs(effect.null_value) else 3)

    limits = limits_in_words(low, high, write)
    if (low is None) != (high is None):
        return f"{name} of {limits}"
    return f"{name} = {write(effect.value)} ({f'probably {limits}' if limits else 'the data set it no limits'})"


def explanation_in_words(e: RankedExplanation, *, with_values: bool) -> str:
    """Return what an explanation adds: "linear_drag and a force on the light mass as a function of the height"."""
    effects = [effect_in_words(one) if with_values else in_words(one.name) for one in e.effects]
    return " and ".join([*effects, *([f"a {e.law.in_words}, which is not listed"] if e.law else [])]) or "nothing"


def limits_in_words(low: float | None, high: float | None, write: Callable[[float], str]) -> str:
    """Return an interval whose ends ``write`` writes; an end that is None is open. Empty: both are."""
    if low is not None and high is not None:
        return f"{write(low)} to {write(high)}"
    if low is not None:
        return f"at least {write(low)}"
    return "" if high is None else f"at most {write(high)}"


def verdict_sentence(
    verdict: Verdict,
    explanations: Sequence[RankedExplanation],
    unlisted: Unlisted | None,
    errors: Sequence[TrialError],
    *,
    tests: ModelTests,
    declared: ModelTests,
    own_effects: bool,
) -> str:
    """Return the verdict in one sentence, of which every clause is what a test says.

    Parameters
    ----------
    explanations
        The most probable first: ``errors`` and ``tests`` are of this one, and of the declared model.
    own_effects
        Whether the study has effects of its own beside those of the library.
    """
    worst, first = worst_trial(errors), explanations[0]
    after = distance(worst, after=True)
    where = f"the data of {trial_in_words(worst)}"
    if verdict is Verdict.NO_MISSING_EFFECT:
        return f"The declared model is enough: it comes to within {after} of {where}, as near as their errors allow."
    if verdict is Verdict.INTERRUPTED:
        return f"The search was interrupted before its end: so far, the most probable model is {after} from {where}."
    candidates = "the library or of the study" if own_effects else "the library"
    if verdict is Verdict.UNEXPLAINED:
        return _unexplained(first, worst, tests, declared, candidates)
    if verdict is Verdict.IDENTIFIED:
        added = " and ".join(effect_in_words(e) for e in first.effects)
        verb, them = ("explain", "them") if len(first.effects) > 1 else ("explains", "it")
        return f"{added} {verb} what the declared model misses: with {them}, {_how_well(worst, tests)}."
    if verdict is Verdict.AMBIGUOUS:
        credible = [e for e in explanations if e.credible]
        named = [e for e in credible if e.names]
        with_values = len(named) <= MAX_TIES_WITH_VALUES
        ties = [explanation_in_words(e, with_values=with_values) for e in named]
        if len(ties) > MAX_TIES:
            ties[MAX_TIES - 1 :] = [f"one of {len(ties) - MAX_TIES + 1} others"]
        if len(named) < len(credible):
            return (
                f"These data hardly show whether anything is missing: nothing may be; or {'; or '.join(ties)}; "
                f"with the most probable, {_how_well(worst, tests)}."
            )
        return (
            f"Something is missing, and these data cannot say which of {len(named)} explanations is right: "
            f"{'; or '.join(ties)}; with the first, {_how_well(worst, tests)}."
        )
    assert unlisted is not None
    beside = f", beside {' and '.join(effect_in_words(e) for e in first.effects)}," if first.effects else ""
    size = ""
    if unlisted.multiplied_by == "constant":
        size = f", of up to {quantity(max(abs(p.largest) for p in unlisted.profiles), unlisted.value_unit)},"
    return (
        f"No effect of {candidates} explains what the declared model misses, but{beside} a {unlisted.in_words}{size} does: "
        f"with it, {_how_well(worst, tests)}."
    )


def _how_well(error: TrialError, tests: ModelTests) -> str:
    """Return how near a model that explains the data comes to held-out ones, and what it leaves, by its tests."""
    if not tests.predicts:  # but it predicts them better, or it would not explain
        return f"{_how_near(error)}, nearer by their errors than without, but not as near as these allow"
    left = "looks like noise" if tests.seeks_patterns else "is no larger than the errors of the points, which last"
    return f"{_how_near(error)}, and what is left {left}"


def _how_near(error: TrialError) -> str:
    """Return how far a model is from a trial, and how far the declared one."""
    before, after = distance(error, after=False).removesuffix(" (RMS)"), distance(error, after=True)
    where = f"the data of {trial_in_words(error)}"
    size_before, size_after = error.rms_before, error.rms_after
    if size_before is None or size_after is None or not error.unit:
        size_before, size_after = error.standardised_rms_before, error.standardised_rms_after
    if size_after > (1 - MIN_VISIBLE_SHARE) * size_before:
        return f"the model is {after} from {where} ({before} without)"
    return f"the model comes to within {after} of {where}, instead of {before}"


def _unexplained(
    nearest: RankedExplanation, error: TrialError, tests: ModelTests, declared: ModelTests, candidates: str
) -> str:
    """Return what comes nearest, how near it is, and which of its tests fail."""
    failures = " and ".join(failures_in_words(tests.all))
    after, where = distance(error, after=True), f"the data of {trial_in_words(error)}"
    if not nearest.names:
        if tests.predicts:
            return (
                f"The declared model comes to within {after} of {where}, as near as their errors allow, but {failures}, and no "
                f"effect of {candidates} explains it."
            )
        return (
            f"Something is missing that no effect of {candidates} explains: the declared model is the most probable one, "
            f"{after} from {where}{_in_errors(error)}, and {failures}."
        )
    missing = "These data do not say whether anything is missing"
    if any(not t.passes for t in declared.all):
        missing = "Something is missing that nothing that was tried explains"
    added = explanation_in_words(nearest, with_values=True)
    before = distance(error, after=False).removesuffix(" (RMS)")
    return (
        f"{missing}: the most probable model, with {added}, is {after} from {where}{_in_errors(error)} ({before} without), but "
        f"{failures}."
    )


def _in_errors(error: TrialError) -> str:
    """Return the size of a distance that is given as a length in standard errors, too."""
    return "" if error.rms_after is None or not error.unit else f", {amount(error.standardised_rms_after)} times their error"


def verdict_notes(
    verdict: Verdict,
    explanations: Sequence[RankedExplanation],
    ruled_out: Sequence[tuple[str, str]],
    errors: Sequence[CorrelatedError],
    outliers: Sequence[Outliers],
    *,
    trials: int,
) -> tuple[str, ...]:
    """Return further sentences on the verdict.

    Parameters
    ----------
    trials
        Number of the study's trials.
    ruled_out
        Name of each listed effect whose value would be impossible, and what is known of it.
    """
    notes = []
    laws = list(dict.fromkeys(e.law.in_words for e in explanations if e.credible and e.law))
    if verdict is Verdict.UNLISTED and len(laws) > 1:
        others = "; ".join(f"a {law}" for law in laws[1:])
        notes.append(f"Which law it is, is less sure than that there is one: the data do not exclude, in its place, {others}.")
    if verdict is Verdict.IDENTIFIED:
        notes += [f"{name} was ruled out, as {known}." for name, known in ruled_out]
    nearest = next((e for e in explanations if e.names), None)
    if nearest and verdict is Verdict.NO_MISSING_EFFECT:
        added, odds = explanation_in_words(nearest, with_values=False), 10 ** min(-nearest.log10_odds, 300.0)
        notes.append(f"The model comes nearest with {added}; {amount(odds)} to 1 that it is chance.")
    if trials == 1 and any(e.credible and e.effects for e in explanations):
        notes.append(
            "All this comes from one trial: the intervals presume that what was declared has the right form and that nothing "
            "else acts, as what acts alike in this trial is counted with what was found. A trial with another heavy mass or "
            "angle would tell them apart."
        )
    if errors:
        each = " and ".join(
            f"{quantity(e.amplitude, e.unit)} ({BODY_IN_WORDS[e.body]}) for some {amount(e.points)} points in a row"
            for e in errors
        )
        notes.append(
            f"The tracked points are off by about {each}, as when a tracker wanders over its mark; an effect that looks like "
            "this cannot be seen in these data."
        )
    if outliers:
        largest = max(outliers, key=lambda o: o.largest_distance)
        notes.append(
            f"{sum(o.count for o in outliers)} of {sum(o.of for o in outliers)} tracked points do not show the mass, being off "
            f"by up to {quantity(largest.largest_distance, largest.unit)} beside neighbours that are not; they were left out."
        )
    return tuple(notes)


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
