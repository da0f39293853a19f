"""Compare the tracked points with the declared motion, and name large mistakes of filming or of declaration.

A mistake is named if undoing it alone brings the points near the declared motion, and nothing less does: the study's
uncertain values (friction, drag, what was measured with an error) are fitted both with and without it. Effects that the
declared model lacks are left to the fit of `identify`. They move the points by centimetres, a mistake by decimetres, and they
do not vanish with another unit or another sign.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from functools import cached_property

from looping_pendulum.discrepancy.data.observations import DataError, Observations
from looping_pendulum.discrepancy.data.study import Study, Trial
from looping_pendulum.discrepancy.first_look.declared_trial import DeclaredTrial, declared_trial, with_lengths
from looping_pendulum.discrepancy.first_look.misfit import Distance, FittedMisfit, fitted_misfit, measured_distance
from looping_pendulum.discrepancy.first_look.mistakes import MIN_UNIT_FACTOR, Mistake, Undone, possible_mistakes
from looping_pendulum.discrepancy.first_look.plausible import implausible_values
from looping_pendulum.pages.numbers import quantity

MAX_GOOD_MISFIT = 1.1
"""Largest misfit of a trial in which no mistake is looked for.

Clean trials of the blind simulator have 0.6 to 0.9. Beyond it there may be a mistake, or an effect that the model lacks.
"""
MAX_MISFIT_RATIO = 0.6
"""Largest misfit without a mistake, as a share of that with it, at which the mistake is named."""
MAX_RIVAL_RATIO, MAX_RIVAL_DISTANCE = 1.15, 0.02
"""Another explanation is as good if its misfit is at most so many times the best, and its distance at most so much larger.

The distance is that of the points from the motion before anything is fitted, in free lengths.
"""
MAX_TRIED = 6
"""Number of mistakes, those of the smallest distances, that are tried with a fit."""
MAX_TRIED_DISTANCE = 0.25
"""Largest distance of the points without a mistake, in free lengths, at which it is tried: beyond it something else is wrong."""
STEPS = (1, 2)
"""Numbers of mistakes at once that are tried, one after the other: two are no explanation where one suffices."""
MIN_ORIGIN_SHIFT = 0.1
"""Smallest distance of the origin from where it was declared, in free lengths, that is a mistake and no error of measurement."""
MIN_ORIGIN_SIGMAS = 10.0
"""The same in standard errors of the declared place."""


class DeclarationError(DataError):
    """Tracked points and declaration contradict each other; `check` says how."""

    def __init__(self, check: DeclarationCheck) -> None:
        super().__init__("; ".join(m.text for m in check.mistakes) + GO_ON)
        self.check = check


GO_ON = "; if all is as declared, go on with --anyway"
"""Way out at the end of an error message."""


@dataclass(frozen=True, kw_only=True)
class NamedMistake:
    """A mistake that the points show."""

    trials: tuple[str, ...]
    names: tuple[str, ...]
    """Names of `mistakes.Mistake`; several if the points do not tell which of them was made."""
    text: str
    """One line: where, what was found, what was needed, and the key that mends it."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TrialCheck:
    """Comparison of one trial."""

    trial: str
    distance: Distance | None
    """Distance of its points from the declared motion; None: the trial was not looked at."""
    reason: str = ""
    """Why it was not looked at."""

    @property
    def text(self) -> str:
        """Return in one line how near the points are."""
        if self.distance is None:
            return f"trial '{self.trial}': not looked at, {self.reason}"
        return (
            f"trial '{self.trial}': in the first {quantity(self.distance.window, 's')} the points are "
            f"{quantity(self.distance.rms, 'm')} from the declared motion, before anything is fitted"
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class DeclarationCheck:
    """Result of a first look at a study."""

    trials: tuple[TrialCheck, ...]
    mistakes: tuple[NamedMistake, ...] = ()
    """What looks wrong."""
    warnings: tuple[str, ...] = ()
    """Declared values of unusual size, in one line each; they do not contradict the points."""

    def refuse_mistakes(self) -> None:
        """Raise what looks wrong, if anything does.

        Raises
        ------
        DeclarationError
            If there is a mistake; its message is one line.
        """
        if self.mistakes:
            raise DeclarationError(self)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Correction:
    """A trial without one mistake that may have been made."""

    mistake: Mistake
    undone: Undone
    distance: Distance
    """Distance of the points from the motion without the mistake."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Explanation(_Correction):
    """The same after a fit."""

    fit: FittedMisfit


@dataclass(eq=False)
class _TrialSearch:
    """Misfits of one trial, computed when they are asked for."""

    declared: DeclaredTrial
    distance: Distance
    _corrections: dict[int, list[_Correction]] = field(default_factory=dict)
    _fitted: dict[str, _Explanation] = field(default_factory=dict)

    @property
    def name(self) -> str:
        return self.declared.trial.name

    @cached_property
    def as_declared(self) -> FittedMisfit:
        """Return the misfit with the study as it is."""
        return fitted_misfit(self.declared)

    def corrections(self, steps: int) -> list[_Correction]:
        """Return mistakes of so many steps that leave the points nearer to the motion, nearest first; of variants the best."""
        if steps not in self._corrections:
            best: dict[str, _Correction] = {}
            for mistake, corrected in possible_mistakes(self.declared, steps):
                correction = _correction(mistake, self.declared, corrected)
                nearest = best[mistake.name].distance if mistake.name in best else self.distance
                if correction is not None and correction.distance.relative < nearest.relative:
                    best[mistake.name] = correction
            self._corrections[steps] = sorted(best.values(), key=lambda c: c.distance.relative)
        return self._corrections[steps]

    def explanations(self, steps: int) -> list[_Explanation]:
        """Return the mistakes of so many steps that leave a small misfit, the smallest first."""
        found: list[_Explanation] = []
        reach = MAX_TRIED_DISTANCE
        for correction in self.corrections(steps)[:MAX_TRIED]:
            if correction.distance.relative > reach:
                break
            explanation = self.explanation(correction)
            if explanation.fit.largest <= MAX_GOOD_MISFIT:
                # What is farther away than a rival may be need not be tried
                reach = min(reach, correction.distance.relative + MAX_RIVAL_DISTANCE)
            found.append(explanation)
        return sorted(found, key=lambda e: e.fit.largest)

    def explanation(self, correction: _Correction) -> _Explanation:
        """Return a correction with its fit."""
        name = correction.mistake.name
        if name not in self._fitted:
            self._fitted[name] = _explanation(correction)
        return self._fitted[name]

    def explanation_named(self, name: str) -> _Explanation | None:
        """Return the single mistake of that name as an explanation of this trial; None: it brings the points no nearer."""
        return next((self.explanation(c) for c in self.corrections(1) if c.mistake.name == name), None)


def _correction(mistake: Mistake, declared: DeclaredTrial, corrected: DeclaredTrial) -> _Correction | None:
    """Return a trial without a mistake and its distance; None: a factor on lengths would be too near 1 for a mistake."""
    of_length = "scale" in mistake.fits
    distance = measured_distance(corrected, with_length_factor=of_length)
    factors = {}
    if of_length:
        factors["lengths"] = factor = distance.length_factor
        if 1 / MIN_UNIT_FACTOR < factor < MIN_UNIT_FACTOR:
            return None
        corrected = with_lengths(corrected, factor)
    if "clock_ratio" in mistake.fits:
        before, after = (d.observations.channels[0].t[-1] for d in (declared, corrected))
        factors["times"] = float(after / before)
    undone = Undone(declared=declared, corrected=corrected, factors=factors)
    return _Correction(mistake=mistake, undone=undone, distance=distance)


def _explanation(correction: _Correction) -> _Explanation:
    """Fit a trial without a mistake, and refine the factors of the mistake by it."""
    undone = correction.undone
    fit = fitted_misfit(undone.corrected, correction.mistake.fits)
    factors = dict(undone.factors)
    # The fit knows them better than the grid, or the unfitted motion, from which they come
    if "times" in factors:
        factors["times"] *= fit.values.get("clock_ratio", 1.0)
    if "lengths" in factors:
        factors["lengths"] /= fit.values.get("scale", 1.0)
    refined = Undone(declared=undone.declared, corrected=undone.corrected, factors=factors)
    return _Explanation(mistake=correction.mistake, undone=refined, distance=correction.distance, fit=fit)


def check_declaration(study: Study, observed: Iterable[tuple[Trial, Observations]]) -> DeclarationCheck:
    """Take a first look at a study.

    Parameters
    ----------
    observed
        Every trial with its observations as they were read.
    """
    checks, searches = [], []
    for trial, observations in observed:
        if not observations.channels:
            checks.append(TrialCheck(trial=trial.name, distance=None, reason="it has events only"))
            continue
        declared = declared_trial(study, trial, observations)
        distance = measured_distance(declared)
        searches.append(_TrialSearch(declared=declared, distance=distance))
        if math.isfinite(distance.rms):
            checks.append(TrialCheck(trial=trial.name, distance=distance))
        else:
            checks.append(
                TrialCheck(trial=trial.name, distance=None, reason="too few points lie in the first part of the motion")
            )
    return DeclarationCheck(
        trials=tuple(checks), mistakes=_named(searches), warnings=tuple(implausible_values(study, [s.declared for s in searches]))
    )


def _named(searches: Sequence[_TrialSearch]) -> tuple[NamedMistake, ...]:
    """Return the mistakes of all trials; one that several trials share is named once."""
    by_names: dict[tuple[str, ...], list[tuple[_TrialSearch, list[_Explanation]]]] = {}
    for search in searches:
        if search.as_declared.largest <= MAX_GOOD_MISFIT:
            continue
        best = next((e for names in by_names if (e := _same(names, search, searches))), None) or _best(search, searches)
        if best:
            by_names.setdefault(tuple(e.mistake.name for e in best), []).append((search, best))
    mistakes = [_mistake(names, members) for names, members in by_names.items()]
    mended = {s.name for members in by_names.values() for s, _ in members}
    misplaced = [s for s in searches if s.name not in mended and _origin_is_wrong(s)]
    if misplaced:
        mistakes.append(_origin_mistake(misplaced))
    return tuple(mistakes)


def _same(names: Sequence[str], search: _TrialSearch, searches: Sequence[_TrialSearch]) -> list[_Explanation]:
    """Return the explanations of another trial as those of this one; empty if they do not mend it, too."""
    same = [search.explanation_named(name) for name in names]
    good = [e for e in same if e is not None and e.fit.largest <= MAX_GOOD_MISFIT and _mends(e, search, searches)]
    return good if len(good) == len(names) else []


def _best(search: _TrialSearch, searches: Sequence[_TrialSearch]) -> list[_Explanation]:
    """Return the best explanation of a trial's misfit, and those that are as good; empty if none mends it."""
    for steps in STEPS:
        mending = [e for e in search.explanations(steps) if _mends(e, search, searches)]
        if mending:
            smallest, nearest = mending[0].fit.largest, min(e.distance.relative for e in mending)
            return [
                e
                for e in mending
                if e.fit.largest <= MAX_RIVAL_RATIO * smallest and e.distance.relative <= nearest + MAX_RIVAL_DISTANCE
            ] or mending[:1]
    return []


def _mends(explanation: _Explanation, search: _TrialSearch, searches: Sequence[_TrialSearch]) -> bool:
    """Return whether the misfit vanishes without a mistake; one of the apparatus must explain all trials together."""
    with_mistake, without = search.as_declared.largest**2, explanation.fit.largest**2
    # First by the trial itself, as a fit of every other one takes its time
    if explanation.mistake.of_apparatus and without < with_mistake:
        for other in searches:
            if other is not search:
                same = other.explanation_named(explanation.mistake.name)
                with_mistake += other.as_declared.largest**2
                without += other.as_declared.largest ** 2 if same is None else same.fit.largest**2
    return math.sqrt(without / with_mistake) <= MAX_MISFIT_RATIO


def _mistake(names: tuple[str, ...], members: Sequence[tuple[_TrialSearch, list[_Explanation]]]) -> NamedMistake:
    """Return a mistake in words; the first of its trials gives the values."""
    search, explanations = members[0]
    trials = tuple(s.name for s, _ in members)
    found = " or ".join(e.mistake.found(e.undone) for e in explanations)
    keys = "' or '".join(dict.fromkeys(e.mistake.keys(e.undone) for e in explanations))
    before = search.distance.rms
    # In the units of the declared apparatus, as the distance before
    after = explanations[0].distance.rms
    if math.isfinite(before):
        size = f"the points are {quantity(before, 'm')} from the declared motion and {quantity(after, 'm')} with the change"
    else:
        size = f"hardly any point lies in the declared motion, and with the change they are {quantity(after, 'm')} from it"
    return NamedMistake(
        trials=trials, names=names, text=f"{_where(trials)}: found {found}; needed '{keys}' ({size})"
    )


def _where(trials: Sequence[str]) -> str:
    """Return the trials of a message."""
    shown = ", ".join(f"'{t}'" for t in trials)
    return f"trial {shown}" if len(trials) == 1 else f"trials {shown}"


def _origin_is_wrong(search: _TrialSearch) -> bool:
    """Return whether the rod's centre is far from where it was declared, in a trial that agrees otherwise."""
    if search.as_declared.largest > MAX_ORIGIN_MISFIT:
        return False
    limits: Callable[[str], float] = lambda name: _origin_limit(search, name)  # noqa: E731
    return any(abs(_origin(search, name) - _declared_origin(search, name)) > limits(name) for name in ORIGIN if name in search.as_declared.values)


ORIGIN = ("origin_x", "origin_y")
MAX_ORIGIN_MISFIT = 3.0


def _origin(search: _TrialSearch, name: str) -> float:
    return search.as_declared.values.get(name, 0.0)


def _declared_origin(search: _TrialSearch, name: str) -> float:
    prior = search.declared.study.camera_priors(search.declared.trial, search.declared.observations)[name]
    return prior.value


def _origin_limit(search: _TrialSearch, name: str) -> float:
    trial = search.declared.trial
    prior = search.declared.study.camera_priors(trial, search.declared.observations)[name]
    if prior.free or "height" in {c.name for c in search.declared.observations.channels}:
        return math.inf
    length = search.declared.study.parameters({}, trial).free_length
    return max(MIN_ORIGIN_SHIFT * length, MIN_ORIGIN_SIGMAS * (prior.sigma or 0.0))


def _origin_mistake(searches: Sequence[_TrialSearch]) -> NamedMistake:
    """Return an origin that is not at the rod, in words."""
    trials = tuple(s.name for s in searches)
    x, y = (_origin(searches[0], name) for name in ORIGIN)
    return NamedMistake(
        trials=trials,
        names=("origin",),
        text=f"{_where(trials)}: found the rod's centre near x = {quantity(x, 'm')}, y = {quantity(y, 'm')}; needed "
        f"the origin at the rod's centre, or 'camera: {{origin_x: free from {quantity(x, 'm')}, origin_y: free from "
        f"{quantity(y, 'm')}}}'",
    )
