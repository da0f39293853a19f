"""What may be claimed of an explanation: every test of its fits, the verdict that they leave, and its words."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from looping_pendulum.discrepancy.candidates import in_words
from looping_pendulum.discrepancy.evidence.explain import Explanations, Judged
from looping_pendulum.discrepancy.evidence.explanation import NOTHING
from looping_pendulum.discrepancy.evidence.prior import DECISIVE
from looping_pendulum.discrepancy.fit.data import CorrelatedNoise
from looping_pendulum.discrepancy.fit.residual import BLOCKS, ModelTest, failures_in_words
from looping_pendulum.discrepancy.formulas import Unlisted
from looping_pendulum.discrepancy.result import FittedEffect, Outliers, RankedExplanation, TrialError, Verdict
from looping_pendulum.measured.observations import BODIES, UNITS
from looping_pendulum.measured.study import Trial
from looping_pendulum.pages.numbers import amount, quantity, uncertain

LEAST_EXPLAINED = 0.5
"""Least share of what the declared model misses of held-out data that is called an explanation of it."""
MIN_VISIBLE_SHARE = 0.1
"""Share of its distance by which a model must come nearer for the sentence to call it nearer."""
MAX_TIES_WITH_VALUES, MAX_TIES = 3, 6
"""Number of tied explanations up to which the sentence has their values, and their names; the report's table has all."""
BODY_IN_WORDS = {
    "light": "light mass",
    "heavy": "heavy mass",
    "angle": "angle",
    "angle_rate": "angular velocity",
    "height": "height",
}
"""Body, of `observations.BODIES`, in words."""
UNIT_OF_BODY = {body: UNITS[names[0]] for body, names in BODIES.items()}
"""Body -> SI unit of its channels."""


@dataclass(frozen=True, kw_only=True)
class ModelTests:
    """Tests of a model: of its fit to all data, and of its fit to the training data on held-out data."""

    fit: tuple[ModelTest, ...]
    """Of the fit to all data: whether it has converged, and leaves residuals that look like its noise."""
    seeks_patterns: bool
    """Whether the residuals were searched for patterns, not only measured: not where errors last longer than a frame."""
    held_out: tuple[ModelTest, ...]
    """Whether held-out data are predicted to their noise."""
    gain: ModelTest | None = None
    """Log of the factor by which the model makes held-out data more probable than the declared one; None: it is that."""
    contradiction: ModelTest | None = None
    """Of the declared model where a more probable one fails the held-out data: its odds."""
    explained_share: float = 0.0
    """Share of the declared model's excess of chi2 over noise, on the worst held-out data, that the model explains."""

    @property
    def all(self) -> tuple[ModelTest, ...]:
        """Every test."""
        return (*self.fit, *self.held_out, *(t for t in (self.gain, self.contradiction) if t))

    @property
    def predicts(self) -> bool:
        """Whether held-out data are predicted to their noise."""
        return all(t.passes for t in self.held_out)

    @property
    def confirmed(self) -> bool:
        """Whether the held-out data by themselves decide for the model, against the declared one."""
        return self.gain is not None and self.gain.value > DECISIVE

    @property
    def explains(self) -> bool:
        """Whether the model may be said to explain the data: held-out ones to noise, or most of what is missed of them."""
        is_no_worse = all(t.passes for t in (*self.fit, self.gain) if t)
        return is_no_worse and (self.predicts or (self.confirmed and self.explained_share > LEAST_EXPLAINED))


def tests_of(model: Judged, declared: Judged, contradiction: ModelTest | None) -> ModelTests:
    """Return the tests of a model, which is compared with the declared one unless it is that.

    Parameters
    ----------
    contradiction
        `Explanations.contradiction`, where the declared model alone is left.
    """
    gain, share = None, 0.0
    if model is not declared:
        worst = model.held_out.worst
        chi2, chi2_declared, count = _chi2_of_both(model, declared)
        share = (chi2_declared - chi2) / max(chi2_declared - count, 1.0)
        is_of_blocks = math.isnan(model.log_prediction)
        gain = ModelTest(
            subject=worst.subject if is_of_blocks else "held-out trials",
            statistic="log of the factor by which they are more probable than by the declared model",
            value=0.5 * (chi2_declared - chi2) if is_of_blocks else model.log_prediction - declared.log_prediction,
            limit=-DECISIVE,
            limit_is_lower=True,
            failure=f"with what the other trials say of it, the {worst.subject} is less probable than by the declared model",
        )
    convergence = ModelTest(
        subject="fit",
        statistic="converged (1: yes)",
        value=float(model.fit.converged and model.training.converged),
        limit=1.0,
        limit_is_lower=True,
        failure="the fit has not converged",
    )
    return ModelTests(
        fit=(convergence, *model.tests.results),
        seeks_patterns=model.tests.seeks_patterns,
        held_out=model.held_out.results,
        gain=gain,
        contradiction=contradiction,
        explained_share=share,
    )


def _chi2_of_both(model: Judged, declared: Judged) -> tuple[float, float, int]:
    """Return chi2 of the worst held-out trial, or of all blocks of time, by a model and by the declared one, and its mean.

    Of a trial by the same points and the smaller noise of the two, since a model that misses it finds its noise larger, too.
    """
    results = model.held_out.results
    if not model.held_out.fits:
        count = model.training.problem.count
        return results[0].value * count, declared.held_out.results[0].value * count, count
    worst = results.index(model.held_out.worst)
    fits = model.held_out.fits[worst], declared.held_out.fits[worst]
    data = fits[0].problem.data[0]
    data = dataclasses.replace(data, sigma=np.minimum(data.sigma, fits[1].problem.data[0].sigma))
    used = np.all([np.isfinite(f.problem.data[0].sigma) for f in fits], axis=0)
    differences = (data.value - f.problem.predict(f.x, 0) for f in fits)
    of_model, of_declared = (float(np.sum(data.standardise(np.where(used, off, 0.0)) ** 2)) for off in differences)
    return of_model, of_declared, int(used.sum())


def verdict_by_evidence(found: Explanations) -> Verdict:
    """Return what the evidence says about the declared model; `decide` tests it."""
    if found.interrupted:
        return Verdict.INTERRUPTED
    if found.credible == (NOTHING,):
        return Verdict.UNEXPLAINED if found.contradicted else Verdict.NO_MISSING_EFFECT
    if all(e.parts.law for e in found.ranked if e.key in found.credible):
        return Verdict.UNLISTED
    return Verdict.IDENTIFIED if len(found.credible) == 1 else Verdict.AMBIGUOUS


def decide(by_evidence: Verdict, tests: ModelTests) -> Verdict:
    """Return the verdict: what the evidence says, unless the most probable explanation fails a test of what would be claimed.

    Parameters
    ----------
    tests
        Of the most probable explanation.
    """
    if by_evidence is Verdict.INTERRUPTED or tests.explains:
        return by_evidence
    return Verdict.UNEXPLAINED


def effect_in_words(effect: FittedEffect) -> str:
    """Return an effect in words: "a wind (wind_speed) = 0.120 +/- 0.003 m/s", "a wind (wind_speed) of at most 2 m/s"."""
    name, unit, null = in_words(effect.name), effect.candidate.unit, effect.candidate.null
    if effect.interval is None:
        return f"{name} = {uncertain(effect.value, effect.error, unit)}"
    low, high = effect.interval

    def write(value: float) -> str:
        # To three digits those about a ratio of 1 would mostly be 1
        return quantity(value, unit, 4 if abs(value - null) < 0.1 * abs(null) else 3)

    limits = limits_in_words(low, high, write)
    if (low is None) != (high is None):
        return f"{name} of {limits}"
    return f"{name} = {write(effect.value)} ({f'probably {limits}' if limits else 'the data set it no limits'})"


def explanation_in_words(e: RankedExplanation, *, with_values: bool) -> str:
    """Return what an explanation adds: "linear_drag and a force on the light mass as a function of the height"."""
    effects = [effect_in_words(one) if with_values else in_words(one.name) for one in e.effects]
    return " and ".join([*effects, *([f"a {e.law.in_words}, which is not listed"] if e.law else [])])


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
    after, where = _distance(worst, after=True), _data_of(worst)
    if verdict is Verdict.NO_MISSING_EFFECT:
        return f"The declared model is enough: it comes to within {after} of {where}, as near as their errors allow."
    if verdict is Verdict.INTERRUPTED:
        return f"The search was interrupted before its end: so far, the most probable model is {after} from {where}."
    library = "the library or of the study" if own_effects else "the library"
    if verdict is Verdict.UNEXPLAINED:
        return _unexplained(first, worst, tests, declared, library)
    how_well, decides = _how_well(worst, tests), _what_decides(worst, tests)
    if verdict is Verdict.IDENTIFIED:
        added = " and ".join(effect_in_words(e) for e in first.effects)
        verb, them = ("explain", "them") if len(first.effects) > 1 else ("explains", "it")
        return f"{added} {verb} what the declared model misses: with {them}, {how_well}{decides}."
    if verdict is Verdict.AMBIGUOUS:
        credible = [e for e in explanations if e.credible]
        named = [e for e in credible if e.names]
        ties = [explanation_in_words(e, with_values=len(named) <= MAX_TIES_WITH_VALUES) for e in named]
        if len(ties) > MAX_TIES:
            ties[MAX_TIES - 1 :] = [f"one of {len(ties) - MAX_TIES + 1} others"]
        listed = "; or ".join(ties)
        if len(named) < len(credible):
            return (
                f"These data hardly show whether anything is missing: nothing may be; or {listed}; "
                f"with the most probable, {how_well}."
            )
        return (
            f"Something is missing, and these data cannot say which of {len(named)} explanations is right: "
            f"{listed}; with the first, {how_well}{decides}."
        )
    assert unlisted is not None
    beside = f", beside {' and '.join(effect_in_words(e) for e in first.effects)}," if first.effects else ""
    size = ""
    if unlisted.law.factor == "constant":
        size = f", of up to {quantity(max(abs(p.largest) for p in unlisted.profiles), unlisted.value_unit)},"
    return (
        f"No effect of {library} explains what the declared model misses, but{beside} a {unlisted.in_words}{size} does: "
        f"with it, {how_well}{decides}."
    )


def _how_well(error: TrialError, tests: ModelTests) -> str:
    """Return how near a model that explains the data comes to held-out ones, and what it leaves, by its tests."""
    after, before, where = _distance(error, after=True), _distance(error, after=False), _data_of(error)
    before = before.removesuffix(" (RMS)")
    size_before, size_after = error.rms_before, error.rms_after
    if size_before is None or size_after is None or not error.unit:
        size_before, size_after = error.standardised_rms_before, error.standardised_rms_after
    how_near = f"the model comes to within {after} of {where}, instead of {before}"
    if size_after > (1 - MIN_VISIBLE_SHARE) * size_before:
        how_near = f"the model is {after} from {where} ({before} without)"
    if not tests.predicts:  # but it predicts them better, or it would not explain
        return f"{how_near}, nearer by their errors than without, but not as near as these allow"
    left = "looks like noise" if tests.seeks_patterns else "is no larger than the errors of the points, which last"
    return f"{how_near}, and what is left {left}"


def _what_decides(error: TrialError, tests: ModelTests) -> str:
    """Return that all trials together decide where the held-out ones do not; empty: they do."""
    if tests.confirmed or not tests.predicts or error.trial == BLOCKS or not error.held_out:
        return ""
    return (
        "; held-out trials neither confirm nor contradict this, as the declared model with other values predicts them as well, "
        "so that the probability of all trials together decides"
    )


def _unexplained(nearest: RankedExplanation, error: TrialError, tests: ModelTests, declared: ModelTests, library: str) -> str:
    """Return what comes nearest, how near it is, and which of its tests fail."""
    failures = " and ".join(failures_in_words(tests.all))
    after, where = _distance(error, after=True), _data_of(error)
    if not nearest.names and tests.predicts:
        return (
            f"The declared model comes to within {after} of {where}, as near as their errors allow, but {failures}, and no "
            f"effect of {library} explains it."
        )
    if error.rms_after is not None and error.unit:  # a length
        where += f", {amount(error.standardised_rms_after)} times their error"
    if not nearest.names:
        return (
            f"Something is missing that no effect of {library} explains: the declared model is the most probable one, "
            f"{after} from {where}, and {failures}."
        )
    missing = "These data do not say whether anything is missing"
    if any(not t.passes for t in declared.all):
        missing = "Something is missing that nothing that was tried explains"
    added, before = explanation_in_words(nearest, with_values=True), _distance(error, after=False).removesuffix(" (RMS)")
    return f"{missing}: the most probable model, with {added}, is {after} from {where} ({before} without), but {failures}."


def verdict_notes(
    verdict: Verdict,
    explanations: Sequence[RankedExplanation],
    contradiction: ModelTest | None,
    ruled_out: Sequence[tuple[str, str]],
    noise: Mapping[str, CorrelatedNoise],
    outliers: Sequence[Outliers],
    trials: Sequence[Trial],
) -> tuple[str, ...]:
    """Return further sentences on the verdict.

    Parameters
    ----------
    contradiction
        `Explanations.contradiction`.
    ruled_out
        Name of each listed effect whose value would be impossible, and what is known of it.
    noise
        Body -> errors of its tracked points that last longer than a frame.
    trials
        All trials of the study.
    """
    notes = []
    laws = list(dict.fromkeys(e.law.in_words for e in explanations if e.credible and e.law))
    if verdict is Verdict.UNLISTED and len(laws) > 1:
        others = "; ".join(f"a {law}" for law in laws[1:])
        notes.append(f"Which law it is, is less sure than that there is one: the data do not exclude, in its place, {others}.")
    if verdict in (Verdict.IDENTIFIED, Verdict.AMBIGUOUS) and contradiction and not contradiction.passes:
        times = amount(math.exp(min(contradiction.value, 300.0)))
        notes.append(
            f"By all trials together {contradiction.failure}, though it is {times} times as probable. Film one more trial, "
            "with another heavy mass or angle, and hold it out."
        )
    if verdict is Verdict.IDENTIFIED:
        notes += [f"{name} was ruled out, as {known}." for name, known in ruled_out]
    nearest = next((e for e in explanations if e.names), None)
    if nearest and verdict is Verdict.NO_MISSING_EFFECT:
        added, odds = explanation_in_words(nearest, with_values=False), 10 ** min(-nearest.log10_odds, 300.0)
        notes.append(f"The model comes nearest with {added}; {amount(odds)} to 1 that it is chance.")
    if len(trials) == 1 and any(e.credible and e.names for e in explanations):
        notes.append(
            "All this comes from one trial: the intervals presume that what was declared has the right form and that nothing "
            "else acts, as what acts alike in this trial is counted with what was found. A trial with another heavy mass or "
            "angle would tell them apart."
        )
    if in_mid_swing := [t.name for t in trials if t.in_mid_swing]:
        notes.append(
            f"These records begin in mid-swing: {', '.join(in_mid_swing)}. Their motion begins at the first tracked point, "
            "whose angle (release_angle) and speed across the string (push_across) are fitted unless the study states them "
            "(`release: {angle: ..., speed: ...}`); they are no push."
        )
    if noise:
        each = " and ".join(
            f"{quantity(n.amplitude, UNIT_OF_BODY[body])} ({BODY_IN_WORDS[body]}) for some {quantity(n.correlation_time, 's')}"
            for body, n in noise.items()
        )
        notes.append(
            f"The tracked points are off by about {each} at a time, as when a tracker wanders over its mark; an effect that "
            "looks like this cannot be seen in these data."
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


def _data_of(error: TrialError) -> str:
    """Return which data it is of: "the data of the held-out trial eight"."""
    name = error.trial if error.trial == BLOCKS else f"trial {error.trial}"
    return f"the data of the {'held-out ' if error.held_out else ''}{name}"


def _distance(error: TrialError, *, after: bool) -> str:
    """Return how far the repaired or the declared model is from a trial, as a length if it has one: "1.4 mm (RMS)"."""
    rms = error.rms_after if after else error.rms_before
    if rms is None or not error.unit:
        return f"{amount(error.standardised_rms_after if after else error.standardised_rms_before)} standard errors (RMS)"
    return f"{quantity(rms, error.unit, digits=3)} (RMS)"
