"""The search for missing effects: test residuals, screen candidates, refit, test on held-out data, add; then again."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from looping_pendulum.discrepancy.fit.calibration import Fit, calibrate, minimise
from looping_pendulum.discrepancy.fit.problem import Problem
from looping_pendulum.discrepancy.fit.residual import ResidualTests, best_of, calibrate_from_random_start, check_residuals
from looping_pendulum.discrepancy.fit.residual_noise import refit_with_estimated_noise, with_noise_of_residuals
from looping_pendulum.discrepancy.inputs import Inputs
from looping_pendulum.discrepancy.listed.attribution import MAX_NULL_SCORE, HeldOutTest, Refit, check_held_out, refit, refits
from looping_pendulum.discrepancy.listed.candidates import Candidate
from looping_pendulum.discrepancy.listed.remainder import MIN_MISFIT_REMOVED, ScaledErrors, scale_errors
from looping_pendulum.discrepancy.listed.screening import ScreenedCandidate, compile_for, screen, slowest_first
from looping_pendulum.discrepancy.result import RankedCandidate, Round, Verdict
from looping_pendulum.discrepancy.unlisted.discovery import RecoveredForce, discover
from looping_pendulum.discrepancy.unlisted.formula import FittedFormula
from looping_pendulum.discrepancy.unlisted.formula import refit as refit_formulas
from looping_pendulum.discrepancy.workers import SERIAL, Workers

MIN_DELTA_BIC = 10.0
"""Smallest decrease of the Bayesian information criterion with which an effect is added.

Kass and Raftery (J. Am. Stat. Assoc. 90 (1995) 773) call it very strong evidence: odds of exp(10 / 2), 148 to 1. In 120 clean
studies no effect reached it.
"""
MIN_DELTA_BIC_MARGIN = 10.0
"""Delta BIC by which an effect must exceed the next candidate's; in trials on blind data all wrong winners were nearer."""
MAX_REFITS = 6
"""Candidates that are refitted in a round."""
MIN_REFIT_SCORE = 2.0
"""Smallest |z| of a candidate that is refitted.

The delta BIC that a score z predicts is z^2 less log(n), far below `MIN_DELTA_BIC` for such z.
"""
MAX_SCORE_RATIO = 6
"""Largest ratio of the best candidate's |z| to that of a candidate that is refitted."""
MAX_RESCREENED = 5
"""Candidates that are screened again with all added effects in the model, which costs compilations."""
MAX_SCORES_CHECKED = 3
"""Candidates whose score alone may fail a model."""
MIN_REALISED_SHARE = 0.5
"""Share of the chi-square decrease predicted by a score of `MAX_NULL_SCORE` that a refit must realise to fail a model."""
MAX_EFFECTS = 2
"""Effects that are added at most: three of the library can mimic most of what it lacks."""

FractionCallback = Callable[[str, float], None]
"""Called with a description of the step that begins, and the share of all work that is done at least."""


@dataclass(frozen=True, kw_only=True, eq=False)
class CandidateModel:
    """A fitted model with the results of all tests that it may fail."""

    fit: Fit
    added: tuple[Candidate, ...]
    """Effects beyond the declared model."""
    tests: ResidualTests
    held_out: HeldOutTest
    screening: Callable[[], tuple[ScreenedCandidate, ...]]
    """Screens the candidates that could still be added."""
    start_costs: tuple[float, ...] = ()
    """Cost at which the fit from each start ended."""
    other_failures: tuple[str, ...] = ()
    """Descriptions of failed tests beyond those of residuals, held-out data and scores."""
    refitted: dict[str, Refit | None] = field(default_factory=dict)
    """Candidates that were refitted to check what their score predicts, by name."""

    @cached_property
    def remaining(self) -> tuple[ScreenedCandidate, ...]:
        """Candidates that could still be added, best first; screened on first access, since that takes long."""
        return self.screening()

    @cached_property
    def failed_tests(self) -> tuple[str, ...]:
        """Descriptions of all failed tests; empty: the model passes.

        Scores are not checked where an added effect fails another test already: the model is refused in any case.
        """
        failures = [*self.other_failures] if self.tests.passes else [self.tests.failures, *self.other_failures]
        if not self.held_out.passes:
            failures.append(f"held-out data: chi2 per value {self.held_out.worst:.3f}")
        if not (failures and self.added):
            high = (s for s in self.remaining[:MAX_SCORES_CHECKED] if abs(s.score) > MAX_NULL_SCORE)
            confirmed = (s for s in high if failures or self._realises_predicted_decrease(s))
            # One is enough to fail the model, and each further one would cost a refit
            failures += [f"{s.candidate.name}: score {s.score:.1f}" for s in itertools.islice(confirmed, 1)]
        return tuple(failures)

    def _realises_predicted_decrease(self, screened: ScreenedCandidate) -> bool:
        """Whether a refit with the candidate lowers chi-square by about what its score predicts.

        A candidate that does nearly the same as a fitted parameter may have a high score, but its refit gains little.
        """
        refitted = self.refitted[screened.candidate.name] = refit(self.fit, screened)
        return refitted is not None and self.fit.cost - refitted.fit.cost > MIN_REALISED_SHARE * MAX_NULL_SCORE**2

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the added effects."""
        return tuple(c.name for c in self.added)


class Search:
    """State and steps of the search for missing effects."""

    def __init__(self, inputs: Inputs, seed: int, progress: FractionCallback, workers: Workers = SERIAL) -> None:
        self.inputs = inputs
        self.workers = workers
        self.rng = np.random.default_rng(seed)
        self.report_progress = progress
        self.rounds: list[Round] = []
        self.declared_model: CandidateModel | None = None
        """The declared model, calibrated; None until then."""
        self.accepted_models: tuple[CandidateModel, ...] = ()
        """Accepted explanations, the best first; all are within the margin of the best, so more than one are tied."""
        self.forces: tuple[RecoveredForce, ...] = ()
        """Unlisted forces as radial basis functions, those that explain held-out data first; empty: none does."""
        self.formulas: tuple[FittedFormula, ...] = ()
        """Formulas of these forces, refitted to the trajectories, the best first."""
        self.judged_explanations: list[tuple[str, Fit, HeldOutTest]] = []
        """Every explanation that was tested with errors from the scatter of the tracked points: name, fit, held-out test."""
        self.scaled_errors: ScaledErrors | None = None
        """Errors that contain a remainder; set once no explanation has passed with errors from the scatter alone."""

    def run(self) -> None:
        """Search until a model passes all tests or no candidate is accepted."""
        self.report_progress("calibrating", 0.02)
        problem = Problem(self.inputs.study, self.inputs.training, self.inputs.free_parameters)
        compiled = slowest_first(c for c in self.inputs.library if c.needs_compilation)
        # Compiling the reference for some effects takes seconds, so an idle process begins with it now.
        self.workers.prepare(compile_for, problem, [None, *compiled], ["", *(c.name for c in compiled)])
        first = refit_with_estimated_noise(calibrate(problem))
        second = calibrate_from_random_start(first, self.rng)
        best = best_of([first, second])
        # The second start is fitted with the noise that the first one left; only a clearly better fit gets its own estimate.
        if best is second and second.cost < first.cost - 1:
            best = refit_with_estimated_noise(second)
        self.declared_model = self.judge(best, (), (first.cost, second.cost))
        current = self.declared_model
        for added_count in range(MAX_EFFECTS):
            if not current.failed_tests:
                return
            next_model = self.run_round(current, 0.1 + 0.25 * added_count)
            if self.accepted_models:
                return self.find_rivals() if added_count else None
            if next_model is None:
                break
            current = next_model
        self.forces = self.find_unlisted_forces()
        tracks_only = not any(d.events for d in (*self.inputs.training, *(d for d, _ in self.inputs.held_out)))
        if not self.forces and tracks_only:  # the errors of events are stated in the study, so they are not scaled
            self.search_with_scaled_errors()

    def search_with_scaled_errors(self) -> None:
        """Search again, with what no explanation removes taken for errors of the tracked points."""
        assert self.declared_model is not None
        self.report_progress("estimating the errors that no explanation removes", 0.88)
        self.scaled_errors = scale_errors(self.judged_explanations, self.inputs.held_out)
        base = self.judge_with_scaled_errors(self.scaled_errors.calibrate(self.declared_model.fit), ())
        before, current = len(self.rounds), base
        for added_count in range(MAX_EFFECTS):
            next_model = self.run_round(current, 0.9 + 0.03 * added_count, base) if current.failed_tests else None
            if self.accepted_models and added_count:
                self.find_rivals(base)
            if self.accepted_models or next_model is None:
                break
            current = next_model
        self.rounds[before:] = [replace(r, error_factor=self.scaled_errors.factor) for r in self.rounds[before:]]
        if self.accepted_models:
            # The report compares both models by the same errors, so that the declared one has scaled errors, too
            self.declared_model = base

    def judge_with_scaled_errors(
        self, fit: Fit, added: tuple[Candidate, ...], base: CandidateModel | None = None
    ) -> CandidateModel:
        """Test a fit whose errors contain the remainder; ``base`` is the declared model with such errors."""
        assert self.scaled_errors is not None
        held_out = self.scaled_errors.check_held_out(fit)
        removed = 1 - held_out.worst / base.held_out.worst if base else 1.0
        failures = () if removed >= MIN_MISFIT_REMOVED else (f"removes {removed:.0%} of the misfit of held-out data",)
        return CandidateModel(
            fit=fit,
            added=added,
            tests=self.scaled_errors.tests(fit),
            held_out=held_out,
            screening=lambda: self.screen_candidates(fit, added),
            other_failures=failures,
        )

    def find_rivals(self, base: CandidateModel | None = None) -> None:
        """Find rivals of every effect that was added before the last, with the later ones in the model.

        An early effect was compared with its rivals in a model without the later ones; beside these, another may do as well.
        """
        best = self.accepted_models[0]
        for dropped in best.added[:-1]:
            others = tuple(c for c in best.added if c is not dropped)
            dropped_names = {dropped.name, *(c.name for c in dropped.companions)}
            kept = [i for i, n in enumerate(best.fit.problem.names) if n not in dropped_names]
            parameters = [best.fit.problem.free_parameters[i] for i in kept]
            problem = Problem(self.inputs.study, best.fit.problem.data, parameters)
            # Without what held its phase a long swing is far from its minimum, so that it is fitted in growing windows again
            fit = calibrate(problem, best.fit.x[kept]) if problem.is_swing else minimise(problem, best.fit.x[kept])
            remaining = tuple(s for s in self.screen_candidates(fit, others) if s.candidate is not dropped)
            current = CandidateModel(
                fit=fit, added=others, tests=best.tests, held_out=best.held_out, screening=_returning(remaining)
            )
            # Delta BIC of the dropped effect beside the others, less the margin within which explanations are tied
            min_delta_bic = fit.cost - best.fit.cost - math.log(fit.problem.count) - MIN_DELTA_BIC_MARGIN
            refits = self.refit_candidates(current, 0.7)
            rivals = [r for r in refits if r.delta_bic >= max(min_delta_bic, MIN_DELTA_BIC) and r.within_bounds]
            judged = self.judge_refits(current, rivals, 0.8, base)
            self.rounds.append(_round(current, refits, judged))
            self.accepted_models += tuple(judged.values())

    def judge(self, fit: Fit, added: tuple[Candidate, ...], start_costs: tuple[float, ...] = ()) -> CandidateModel:
        """Test a fit on its residuals, on held-out data and by the scores of the remaining candidates."""
        held_out = check_held_out(fit, self.inputs.held_out)
        self.judged_explanations.append((" and ".join(c.name for c in added) or "the declared model", fit, held_out))
        return CandidateModel(
            fit=fit,
            added=added,
            tests=check_residuals(fit),
            held_out=held_out,
            screening=lambda: self.screen_candidates(fit, added),
            start_costs=start_costs,
        )

    def screen_candidates(self, fit: Fit, added: tuple[Candidate, ...]) -> tuple[ScreenedCandidate, ...]:
        """Screen the candidates that could still be added, best first.

        The reference is compiled anew for every set of effects, so beside an added effect that needs it only the best are
        screened exactly.
        """
        added_names = {c.name for c in added}
        costly = {k for c in added if c.needs_compilation for k in (c.name, *(k.name for k in c.companions))}
        rough = screen(fit, [c for c in self.inputs.library if c.name not in added_names], tuple(costly), self.workers)
        if not costly:
            return tuple(rough)
        exact = screen(
            fit, [s.candidate for s in rough[:MAX_RESCREENED] if abs(s.score) > MIN_REFIT_SCORE], workers=self.workers
        )
        rescreened = {s.candidate.name for s in exact}
        both = [*exact, *(s for s in rough if s.candidate.name not in rescreened)]
        return tuple(sorted(both, key=lambda s: -abs(s.score)))

    def run_round(self, current: CandidateModel, share: float, base: CandidateModel | None = None) -> CandidateModel | None:
        """Try to add one effect; return the best model to go on from, or None if no delta BIC is sufficient."""
        refits = self.refit_candidates(current, share)
        threshold = max(MIN_DELTA_BIC, refits[0].delta_bic - MIN_DELTA_BIC_MARGIN) if refits else MIN_DELTA_BIC
        near = [r for r in refits if r.delta_bic >= threshold]
        judged = self.judge_refits(current, near, share + (0.02 if base else 0.2), base)
        self.rounds.append(_round(current, refits, judged))
        within_bounds = {r.candidate.name for r in refits if r.within_bounds}
        passing = [m for name, m in judged.items() if name in within_bounds and not m.failed_tests]
        # A model within the margin that fails a test is no winner, but its delta BIC is too near to the best to rule it out.
        failing = [m for name, m in judged.items() if name in within_bounds and m.failed_tests]
        self.accepted_models = (*passing, *failing) if passing else ()
        return next(iter(judged.values()), None)

    def refit_candidates(self, current: CandidateModel, share: float) -> list[Refit]:
        """Refit the model with each of the best candidates; return the refits, best first."""
        min_score = max(MIN_REFIT_SCORE, abs(current.remaining[0].score) / MAX_SCORE_RATIO) if current.remaining else 0.0
        # An amplitude of zero means that no change within the bounds looks like the residuals
        chosen = [s for s in current.remaining if s.amplitude and abs(s.score) >= min_score][:MAX_REFITS]
        counter = itertools.count()

        def report(name: str) -> None:
            self.report_progress(
                f"refitting with {name}", share + (0.02 if self.scaled_errors else 0.15) * next(counter) / MAX_REFITS
            )

        return refits(current.fit, chosen, current.refitted, self.workers, report)

    def judge_refits(
        self, current: CandidateModel, refits: Sequence[Refit], share: float, base: CandidateModel | None = None
    ) -> dict[str, CandidateModel]:
        """Test each refit; return candidate name -> model. With ``base``, errors contain the remainder."""
        judged = {}
        for r in refits:
            self.report_progress(f"testing {r.candidate.name}", share)
            added = (*current.added, r.candidate)
            if base:
                judged[r.candidate.name] = self.judge_with_scaled_errors(r.fit, added, base)
            else:
                judged[r.candidate.name] = self.judge(with_noise_of_residuals(r.fit), added)
        return judged

    def find_unlisted_forces(self) -> tuple[RecoveredForce, ...]:
        """Search for a force that no library lists; return the best closures, or none if none explains held-out data."""
        assert self.declared_model is not None
        if not any(d.channels for d in self.inputs.training):  # a few events do not determine a force as a function
            return ()
        forces = discover(
            self.declared_model.fit, self.inputs.held_out, lambda what: self.report_progress(what, 0.85), self.workers
        )
        self.judged_explanations += [
            (f"a force on the {f.closure.target} by {f.closure.coordinate}", f.fit, f.held_out) for f in forces
        ]
        before = self.declared_model.held_out.worst
        passing = [
            f for f in forces if f.twice_log_bayes_factor >= MIN_DELTA_BIC and f.held_out.passes and f.held_out.worst < before
        ]
        if passing:
            formulas = refit_formulas(
                self.declared_model.fit, passing, self.inputs.held_out, lambda what: self.report_progress(what, 0.93)
            )
            self.formulas = tuple(formulas)
        return tuple(passing + [f for f in forces if f not in passing]) if passing else ()

    def conclusion(self, interrupted: bool) -> tuple[Verdict, CandidateModel, tuple[CandidateModel, ...]]:
        """Return the verdict, the repaired model, and the tied models if the verdict is ambiguous."""
        assert self.declared_model is not None
        if interrupted:
            return Verdict.INTERRUPTED, self.accepted_models[0] if self.accepted_models else self.declared_model, ()
        if not self.declared_model.failed_tests:
            return Verdict.NO_MISSING_EFFECT, self.declared_model, ()
        if not self.accepted_models and self.forces:
            fit, held_out = self.forces[0].fit, self.forces[0].held_out
            for formula in self.formulas[:1]:
                if formula.accepted and formula.held_out:
                    fit, held_out = formula.fit, formula.held_out
            tests = check_residuals(fit)
            # The screening is `tuple`, which returns no candidates: nothing is added to this model any more
            return Verdict.UNLISTED, CandidateModel(fit=fit, added=(), tests=tests, held_out=held_out, screening=tuple), ()
        if not self.accepted_models:
            return Verdict.UNEXPLAINED, self.declared_model, ()
        if len(self.accepted_models) > 1:
            return Verdict.AMBIGUOUS, self.accepted_models[0], self.accepted_models
        return Verdict.IDENTIFIED, self.accepted_models[0], ()


def _returning(screened: tuple[ScreenedCandidate, ...]) -> Callable[[], tuple[ScreenedCandidate, ...]]:
    return lambda: screened  # a function of its own binds the value of this turn of the caller's loop


def _passes(r: Refit, model: CandidateModel | None) -> bool:
    return model is not None and r.within_bounds and r.delta_bic >= MIN_DELTA_BIC and not model.failed_tests


def _reason(r: Refit, model: CandidateModel | None, best: Refit) -> str:
    """Return why a refit does not pass; empty if it does. ``model`` is None if the refit was not tested."""
    if r.delta_bic < MIN_DELTA_BIC:
        return f"delta BIC below {MIN_DELTA_BIC:g}"
    if model is None:
        return f"delta BIC {best.delta_bic - r.delta_bic:.1f} below that of {best.candidate.name}"
    if not r.within_bounds:
        return "the fitted value is on a bound of what is physically possible"
    return "; ".join(model.failed_tests)


def _round(current: CandidateModel, refits: Sequence[Refit], judged: dict[str, CandidateModel]) -> Round:
    """Return the record of a round: the refits, best first, then the candidates that were only screened."""
    ranking = []
    for r in refits:
        c, model = r.candidate, judged.get(r.candidate.name)
        ranking.append(
            RankedCandidate(
                name=c.name,
                kind=c.kind,
                score=r.screened.score,
                delta_bic=r.delta_bic,
                value=r.value,
                error=r.error,
                held_out_chi2=model.held_out.worst if model else None,
                passes=_passes(r, model),
                reason=_reason(r, model, refits[0]),
            )
        )
    refitted = {r.name for r in ranking}
    ranking += [
        RankedCandidate(
            name=s.candidate.name,
            kind=s.candidate.kind,
            score=s.score,
            delta_bic=None,
            value=None,
            error=None,
            held_out_chi2=None,
            passes=False,
            reason="not refitted: others have higher scores",
        )
        for s in current.remaining
        if s.candidate.name not in refitted
    ]
    return Round(
        added_before=current.names,
        ranking=tuple(ranking),
        best=ranking[0].name if refits else "",
        runner_up=ranking[1].name if len(refits) > 1 else "",
        margin=refits[0].delta_bic - refits[1].delta_bic if len(refits) > 1 else None,
    )
