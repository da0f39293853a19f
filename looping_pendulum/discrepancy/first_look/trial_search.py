"""Find the mistakes that would explain why one trial's points are far from the declared motion."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

from looping_pendulum.discrepancy.first_look.declared_trial import MIN_UNIT_FACTOR, DeclaredTrial, with_lengths
from looping_pendulum.discrepancy.first_look.misfit import Distance, FittedMisfit, fitted_misfit, measured_distance
from looping_pendulum.discrepancy.first_look.mistakes import Mistake, Undone, possible_mistakes
from looping_pendulum.reference_ode.parameters import Release

MAX_GOOD_MISFIT = 1.1
"""Largest misfit of a trial in which no mistake is looked for.

Clean trials of the blind simulator have 0.6 to 0.9. Beyond it there may be a mistake, or an effect that the model lacks.
"""
MIN_DROP_DISTANCE = 0.25
"""Smallest distance of a dropped mass from its fall in the first part, in units of its free length, that may be a mistake.

Its path has one number, which the air, the scale and the clock change alike: real drops are up to 0.11 off.
"""
MAX_RIVAL_RATIO, MAX_RIVAL_DISTANCE = 1.15, 0.02
"""Another explanation is as good if its misfit is at most so many times the best, and its distance at most so much larger.

The distance is that of the points from the motion before anything is fitted, in free lengths.
"""
MIN_POINTS_OF_FRAME_RATE = 10
"""Smallest number of points in the first part of the motion after a factor on the times: fewer fit too many motions."""
MAX_TRIED = 6
"""Number of mistakes, those of the smallest distances, that are tried with a fit."""
MAX_TRIED_DISTANCE = 0.2
"""Largest distance of the points without a mistake, in free lengths, at which it is tried: beyond it another thing is wrong."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Correction:
    """A trial without one mistake that may have been made."""

    mistake: Mistake
    undone: Undone
    distance: Distance
    """Distance of the points from the motion without the mistake."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Explanation(Correction):
    """The same after a fit."""

    fit: FittedMisfit


@dataclass(frozen=True, kw_only=True, eq=False)
class TrialSearch:
    """Misfits of one trial, computed when they are asked for."""

    declared: DeclaredTrial
    distance: Distance
    _corrections: dict[int, list[Correction]] = field(default_factory=dict)
    _fitted: dict[Mistake, Explanation] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """Return the trial's name."""
        return self.declared.trial.name

    @property
    def is_near(self) -> bool:
        """Return whether the points are as near to the declared motion as those of a trial without a mistake may be."""
        if self.declared.trial.release is Release.DROP and self.distance.relative < MIN_DROP_DISTANCE:
            return True
        return self.quickly_fitted.largest <= MAX_GOOD_MISFIT

    @cached_property
    def quickly_fitted(self) -> FittedMisfit:
        """Return the same as `as_declared`, or the first that is small enough for a trial without a mistake."""
        return fitted_misfit(self.declared, self.distance, good_enough=MAX_GOOD_MISFIT)

    @cached_property
    def as_declared(self) -> FittedMisfit:
        """Return the misfit with the study as it is."""
        if min(self.quickly_fitted.misfits) > MAX_GOOD_MISFIT:  # no fit was cut short
            return self.quickly_fitted
        return fitted_misfit(self.declared, self.distance)

    def corrections(self, steps: int) -> list[Correction]:
        """Return mistakes of so many steps that leave the points nearer to the motion, nearest first; of variants the best."""
        if steps not in self._corrections:
            best: dict[str, Correction] = {}
            for mistake, corrected in possible_mistakes(self.declared, steps):
                correction = _correction(mistake, self.declared, corrected)
                nearest = best[mistake.name].distance if mistake.name in best else self.distance
                if correction is not None and correction.distance.relative < nearest.relative:
                    best[mistake.name] = correction
            self._corrections[steps] = sorted(best.values(), key=lambda c: c.distance.relative)
        return self._corrections[steps]

    def explanations(self, steps: int) -> list[Explanation]:
        """Return the mistakes of so many steps that leave a small misfit, the smallest first."""
        found: list[Explanation] = []
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

    def explanation(self, correction: Correction) -> Explanation:
        """Return a correction with its fit."""
        if correction.mistake not in self._fitted:
            self._fitted[correction.mistake] = _explanation(correction)
        return self._fitted[correction.mistake]

    def explanation_by(self, mistake: Mistake) -> Explanation | None:
        """Return a mistake of another trial as an explanation of this one; None: it brings the points no nearer."""
        if mistake not in self._fitted:
            corrected = mistake.undo(self.declared) if self.declared.trial.release in mistake.releases else None
            correction = None if corrected is None else _correction(mistake, self.declared, corrected)
            if correction is None or correction.distance.relative >= self.distance.relative:
                return None
            return self.explanation(correction)
        return self._fitted[mistake]


def _correction(mistake: Mistake, declared: DeclaredTrial, corrected: DeclaredTrial) -> Correction | None:
    """Return a trial without a mistake and its distance; None: the factor is too near 1, or leaves too few points."""
    of_length = "scale" in mistake.fits
    distance = measured_distance(corrected, with_length_factor=of_length)
    factors = {}
    if of_length:
        factors["lengths"] = factor = distance.length_factor
        if 1 / MIN_UNIT_FACTOR < factor < MIN_UNIT_FACTOR:
            return None
        corrected = with_lengths(corrected, factor)
    if "clock_ratio" in mistake.fits:
        if max((len(c) for c, _ in distance.points), default=0) < MIN_POINTS_OF_FRAME_RATE:
            return None
        before, after = (d.observations.channels[0].t[-1] for d in (declared, corrected))
        factors["times"] = float(after / before)
    undone = Undone(declared=declared, corrected=corrected, factors=factors)
    return Correction(mistake=mistake, undone=undone, distance=distance)


def _explanation(correction: Correction) -> Explanation:
    """Fit a trial without a mistake, and refine the factors of the mistake by it."""
    undone = correction.undone
    fit = fitted_misfit(undone.corrected, correction.distance, correction.mistake.fits)
    factors = dict(undone.factors)
    # The fit knows them better than the grid, or the unfitted motion, from which they come
    if "times" in factors:
        factors["times"] *= fit.values.get("clock_ratio", 1.0)
    if "lengths" in factors:
        factors["lengths"] /= fit.values.get("scale", 1.0)
    refined = Undone(declared=undone.declared, corrected=undone.corrected, factors=factors)
    return Explanation(mistake=correction.mistake, undone=refined, distance=correction.distance, fit=fit)
