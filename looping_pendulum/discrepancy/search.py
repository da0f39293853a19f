"""The search: look at what is left, screen, refit, judge, add; until nothing is left or passes."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from looping_pendulum.discrepancy.fit.calibration import Fit, calibrate, minimise
from looping_pendulum.discrepancy.fit.problem import Problem
from looping_pendulum.discrepancy.fit.residual import (
    ResidualTests,
    best_of,
    calibrated,
    check_residuals,
    started,
    with_noise_of_residuals,
)
from looping_pendulum.discrepancy.inputs import Inputs
from looping_pendulum.discrepancy.listed.attribution import SCORE_LIMIT, HeldOutTest, Refit, judge, refit, refits
from looping_pendulum.discrepancy.listed.candidates import Candidate
from looping_pendulum.discrepancy.listed.remainder import REMOVED, ScaledErrors, scaled
from looping_pendulum.discrepancy.listed.screening import ScreenedCandidate, compile_for, costly_first, screen
from looping_pendulum.discrepancy.result import RankedCandidate, Round, Verdict
from looping_pendulum.discrepancy.unlisted.discovery import RecoveredForce, discover
from looping_pendulum.discrepancy.unlisted.formula import FittedFormula
from looping_pendulum.discrepancy.unlisted.formula import refit as write_formulas
from looping_pendulum.discrepancy.workers import ALONE, Workers

GAIN = 10.0
"""On the Bayesian information criterion that an effect must bring; in 120 clean studies none did."""
MARGIN = 10.0
"""Of that over the next candidate's: all wrong winners of the trials were nearer than this."""
REFITS = 6
"""Candidates that are refitted in a round."""
LEAST_SCORE = 2.0
"""Of a candidate that is refitted, and a sixth of the best one's: by far less, it would not gain."""
EXACT = 5
"""Candidates that are screened again with all added effects at work, which costs compilations."""
ASKED, KEPT_PROMISE = 3, 0.5
"""Candidates whose score may raise an alarm alone, and the share of what the smallest alarm promises that it must keep."""
MOST_EFFECTS = 2
"""Added at once; three of the library can mimic most of what it lacks."""

Progress = Callable[[str, float], None]
"""Told what goes on, and the share of all work that is surely done."""


@dataclass(frozen=True, kw_only=True, eq=False)
class CandidateModel:
    """A fitted model, and everything that may speak against it."""

    fit: Fit
    added: tuple[Candidate, ...]
    tests: ResidualTests
    unseen: HeldOutTest
    screening: Callable[[], tuple[ScreenedCandidate, ...]]
    starts: tuple[float, ...] = ()
    objections: tuple[str, ...] = ()
    """What else speaks against it."""
    refitted: dict[str, Refit | None] = field(default_factory=dict)
    """Candidates that were refitted to see whether they raise an alarm."""

    @cached_property
    def left(self) -> tuple[ScreenedCandidate, ...]:
        """What could still be added, best first; found when it is first asked for."""
        return self.screening()

    @cached_property
    def alarms(self) -> tuple[str, ...]:
        """Whatever is not quiet; where something else speaks against an added effect, candidates are not asked any more."""
        found = [*self.objections] if self.tests.quiet else [self.tests.loudest, *self.objections]
        if not self.unseen.explained:
            found.append(f"data that no fit saw: chi2 per value {self.unseen.worst:.3f}")
        if not (found and self.added):
            loud = (s for s in self.left[:ASKED] if abs(s.score) > SCORE_LIMIT)
            confirmed = (s for s in loud if found or self._gains(s))
            found += [f"{s.candidate.name}: score {s.score:.1f}" for s in itertools.islice(confirmed, 1)]
        return tuple(found)

    def _gains(self, screened: ScreenedCandidate) -> bool:
        """Whether a refit takes away a part of what the score promises; one of what is fitted already does not."""
        found = self.refitted[screened.candidate.name] = refit(self.fit, screened)
        return found is not None and self.fit.cost - found.fit.cost > KEPT_PROMISE * SCORE_LIMIT**2

    @property
    def names(self) -> tuple[str, ...]:
        """Names of what was added."""
        return tuple(c.name for c in self.added)


class Search:
    """The state of the loop."""

    def __init__(self, inputs: Inputs, seed: int, progress: Progress, workers: Workers = ALONE) -> None:
        self.inputs = inputs
        self.workers = workers
        self.rng = np.random.default_rng(seed)
        self.progress = progress
        self.rounds: list[Round] = []
        self.base: CandidateModel | None = None
        self.winners: tuple[CandidateModel, ...] = ()
        """Explanations that pass, the best first; those within the margin are tied."""
        self.forces: tuple[RecoveredForce, ...] = ()
        """Unlisted forces that explain what no fit saw, the best first."""
        self.formulas: tuple[FittedFormula, ...] = ()
        """Formulas of them, refitted by trajectory, the best first."""
        self.tried: list[tuple[str, Fit, HeldOutTest]] = []
        """Every explanation that was judged on the marks' scatter."""
        self.scaled: ScaledErrors | None = None
        """Set if all that passes is judged by errors that contain a remainder."""

    def run(self) -> None:
        """Search until nothing is left or nothing passes."""
        self.progress("calibrating", 0.02)
        problem = Problem(self.inputs.study, self.inputs.training, self.inputs.numbers)
        compiled = costly_first(c for c in self.inputs.library if c.compiled)
        self.workers.prepare(compile_for, problem, [None, *compiled], ["", *(c.name for c in compiled)])
        first = calibrated(calibrate(problem))
        second = started(first, self.rng)
        best = best_of([first, second])
        if best is second and second.cost < first.cost - 1:
            best = calibrated(second)
        self.base = self.model(best, (), (first.cost, second.cost))
        current = self.base
        for number in range(MOST_EFFECTS):
            if not current.alarms:
                return
            following = self.round(current, 0.1 + 0.25 * number)
            if self.winners:
                return self.contest() if number else None
            if following is None:
                break
            current = following
        self.forces = self.unlisted_forces()
        marks_only = not any(d.events for d in (*self.inputs.training, *(d for d, _ in self.inputs.held)))
        if not self.forces and marks_only:  # the errors of events are stated, not found
            self.second_look()

    def second_look(self) -> None:
        """Ask again, with what no explanation removes taken for errors of the marks."""
        assert self.base is not None
        self.progress("measuring what no explanation removes", 0.88)
        self.scaled = scaled(self.tried, self.inputs.held)
        base = self.scaled_model(self.scaled.calibrated(self.base.fit), ())
        before, current = len(self.rounds), base
        for number in range(MOST_EFFECTS):
            following = self.round(current, 0.9 + 0.03 * number, base) if current.alarms else None
            if self.winners and number:
                self.contest(base)
            if self.winners or following is None:
                break
            current = following
        self.rounds[before:] = [replace(r, errors_times=self.scaled.factor) for r in self.rounds[before:]]
        if self.winners:
            self.base = base

    def scaled_model(self, fit: Fit, added: tuple[Candidate, ...], base: CandidateModel | None = None) -> CandidateModel:
        """Ask everything that may speak against a fit whose errors contain a remainder."""
        assert self.scaled is not None
        unseen = self.scaled.judge(fit)
        removed = 1 - unseen.worst / base.unseen.worst if base else 1.0
        return CandidateModel(
            fit=fit,
            added=added,
            tests=self.scaled.tests(fit),
            unseen=unseen,
            screening=lambda: self.screened(fit, added),
            objections=() if removed >= REMOVED else (f"removes {removed:.0%} of the misfit of data that no fit saw",),
        )

    def contest(self, scaled_base: CandidateModel | None = None) -> None:
        """Look for rivals of every effect that was added before the last, with the later ones in the model."""
        best = self.winners[0]
        for dropped in best.added[:-1]:
            others = tuple(c for c in best.added if c is not dropped)
            gone = {dropped.name, *(c.name for c in dropped.companions)}
            kept = [i for i, n in enumerate(best.fit.problem.names) if n not in gone]
            numbers = [best.fit.problem.numbers[i] for i in kept]
            fit = minimise(Problem(self.inputs.study, best.fit.problem.data, numbers), best.fit.x[kept])
            left = tuple(s for s in self.screened(fit, others) if s.candidate is not dropped)
            current = CandidateModel(fit=fit, added=others, tests=best.tests, unseen=best.unseen, screening=_known(left))
            least = fit.cost - best.fit.cost - math.log(fit.problem.count) - MARGIN
            refits = self.refits(current, 0.7)
            rivals = [r for r in refits if r.gain >= max(least, GAIN) and r.inside]
            judged = self.judged(current, rivals, 0.8, scaled_base)
            self.rounds.append(_round(current, refits, judged))
            self.winners += tuple(judged.values())

    def model(self, fit: Fit, added: tuple[Candidate, ...], starts: tuple[float, ...] = ()) -> CandidateModel:
        """Ask everything that may speak against a fit."""
        unseen = judge(fit, self.inputs.held)
        self.tried.append((" and ".join(c.name for c in added) or "the declared model", fit, unseen))
        return CandidateModel(
            fit=fit,
            added=added,
            tests=check_residuals(fit),
            unseen=unseen,
            screening=lambda: self.screened(fit, added),
            starts=starts,
        )

    def screened(self, fit: Fit, added: tuple[Candidate, ...]) -> tuple[ScreenedCandidate, ...]:
        """Score all that could still be added."""
        names = {c.name for c in added}
        costly = {k for c in added if c.compiled for k in (c.name, *(k.name for k in c.companions))}
        rough = screen(fit, [c for c in self.inputs.library if c.name not in names], tuple(costly), self.workers)
        if not costly:
            return tuple(rough)
        exact = screen(fit, [s.candidate for s in rough[:EXACT] if abs(s.score) > LEAST_SCORE], workers=self.workers)
        known = {s.candidate.name for s in exact}
        both = [*exact, *(s for s in rough if s.candidate.name not in known)]
        return tuple(sorted(both, key=lambda s: -abs(s.score)))

    def round(self, current: CandidateModel, share: float, scaled_base: CandidateModel | None = None) -> CandidateModel | None:
        """Try to add one effect; return the best model, to go on from, or None if nothing gains enough."""
        refits = self.refits(current, share)
        least = max(GAIN, refits[0].gain - MARGIN) if refits else GAIN
        near = [r for r in refits if r.gain >= least]
        judged = self.judged(current, near, share + (0.02 if scaled_base else 0.2), scaled_base)
        self.rounds.append(_round(current, refits, judged))
        inside = {r.candidate.name for r in refits if r.inside}
        passing = [m for name, m in judged.items() if name in inside and not m.alarms]
        # what is as good but for an alarm is not far enough behind to be ruled out
        alarmed = [m for name, m in judged.items() if name in inside and m.alarms]
        self.winners = (*passing, *alarmed) if passing else ()
        return next(iter(judged.values()), None)

    def refits(self, current: CandidateModel, share: float) -> list[Refit]:
        """Fit the model with each of the best candidates, best first."""
        least = max(LEAST_SCORE, abs(current.left[0].score) / 6) if current.left else 0.0
        chosen = [s for s in current.left if s.amplitude and abs(s.score) >= least][:REFITS]
        begun = itertools.count()

        def told(name: str) -> None:
            self.progress(f"refitting with {name}", share + (0.02 if self.scaled else 0.15) * next(begun) / REFITS)

        return refits(current.fit, chosen, current.refitted, self.workers, told)

    def judged(
        self, current: CandidateModel, refits: Sequence[Refit], share: float, scaled_base: CandidateModel | None = None
    ) -> dict[str, CandidateModel]:
        """Ask of each refit everything that may speak against it."""
        found = {}
        for r in refits:
            self.progress(f"judging {r.candidate.name}", share)
            added = (*current.added, r.candidate)
            if scaled_base:
                found[r.candidate.name] = self.scaled_model(r.fit, added, scaled_base)
            else:
                found[r.candidate.name] = self.model(with_noise_of_residuals(r.fit), added)
        return found

    def unlisted_forces(self) -> tuple[RecoveredForce, ...]:
        """Search for a force that no library lists; keep those that gain and explain unseen data."""
        assert self.base is not None
        if not any(d.channels for d in self.inputs.training):  # events alone do not carry a force as a function
            return ()
        found = discover(self.base.fit, self.inputs.held, lambda what: self.progress(what, 0.85), self.workers)
        self.tried += [(f"a force on the {f.closure.target} by {f.closure.coordinate}", f.fit, f.unseen) for f in found]
        passing = [f for f in found if f.gain >= GAIN and f.unseen.explained and f.unseen.worst < self.base.unseen.worst]
        if passing:
            written = write_formulas(self.base.fit, passing, self.inputs.held, lambda what: self.progress(what, 0.93))
            self.formulas = tuple(written)
        return tuple(passing + [f for f in found if f not in passing]) if passing else ()

    def conclusion(self, interrupted: bool) -> tuple[Verdict, CandidateModel, tuple[CandidateModel, ...]]:
        """Verdict, the model to go on with, and what is tied."""
        assert self.base is not None
        if interrupted:
            return Verdict.INTERRUPTED, self.winners[0] if self.winners else self.base, ()
        if not self.base.alarms:
            return Verdict.NO_MISSING_EFFECT, self.base, ()
        if not self.winners and self.forces:
            fit, unseen = self.forces[0].fit, self.forces[0].unseen
            for formula in self.formulas[:1]:
                if formula.stands and formula.unseen:
                    fit, unseen = formula.fit, formula.unseen
            tests = check_residuals(fit)
            return Verdict.UNLISTED, CandidateModel(fit=fit, added=(), tests=tests, unseen=unseen, screening=tuple), ()
        if not self.winners:
            return Verdict.UNEXPLAINED, self.base, ()
        if len(self.winners) > 1:
            return Verdict.AMBIGUOUS, self.winners[0], self.winners
        return Verdict.IDENTIFIED, self.winners[0], ()


def _known(left: tuple[ScreenedCandidate, ...]) -> Callable[[], tuple[ScreenedCandidate, ...]]:
    return lambda: left


def _passes(r: Refit, model: CandidateModel | None) -> bool:
    return model is not None and r.inside and r.gain >= GAIN and not model.alarms


def _reason(r: Refit, model: CandidateModel | None, best: Refit) -> str:
    if r.gain < GAIN:
        return f"gains less than {GAIN:g}"
    if model is None:
        return f"gains {best.gain - r.gain:.1f} less than {best.candidate.name}"
    if not r.inside:
        return "ends on a bound of what is physically possible"
    return "; ".join(model.alarms)


def _round(current: CandidateModel, refits: Sequence[Refit], judged: dict[str, CandidateModel]) -> Round:
    ranking = []
    for r in refits:
        c, model = r.candidate, judged.get(r.candidate.name)
        ranking.append(
            RankedCandidate(
                name=c.name, kind=c.kind, score=r.screened.score, gain=r.gain, value=r.value, error=r.error,
                held_out=model.unseen.worst if model else None, passes=_passes(r, model), reason=_reason(r, model, refits[0]),
            )
        )  # fmt: skip
    refitted = {r.name for r in ranking}
    for s in current.left:
        if s.candidate.name not in refitted:
            ranking.append(
                RankedCandidate(name=s.candidate.name, kind=s.candidate.kind, score=s.score, gain=None, value=None, error=None,
                       held_out=None, passes=False, reason="not among the best of the screening")
            )  # fmt: skip
    return Round(
        added_before=current.names,
        ranking=tuple(ranking),
        best=ranking[0].name if refits else "",
        runner_up=ranking[1].name if len(refits) > 1 else "",
        margin=refits[0].gain - refits[1].gain if len(refits) > 1 else None,
    )
