"""The search for missing effects: test residuals, screen candidates, refit, test on held-out data, add; then again."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable, Sequence
from functools import cached_property

import numpy as np

from looping_pendulum.discrepancy.fit.calibration import Fit, calibrate, minimise
from looping_pendulum.discrepancy.fit.correlated_noise_fit import noises_of, with_correlated_noise
from looping_pendulum.discrepancy.fit.model_test import ModelTest
from looping_pendulum.discrepancy.fit.problem import Problem
from looping_pendulum.discrepancy.fit.residual import best_of, calibrate_from_random_start, check_residuals
from looping_pendulum.discrepancy.fit.residual_noise import refit_with_estimated_noise, with_noise_of_residuals
from looping_pendulum.discrepancy.inputs import Inputs
from looping_pendulum.discrepancy.listed.attribution import Refit, delta_bic_of, refits, with_own_noises
from looping_pendulum.discrepancy.listed.candidate_model import CandidateModel
from looping_pendulum.discrepancy.listed.candidates import Candidate
from looping_pendulum.discrepancy.listed.held_out import (
    HeldOutTest,
    check_held_out,
    improvement_test,
    loss_test,
    predicts_better,
    square_ratio,
)
from looping_pendulum.discrepancy.listed.round_record import MIN_DELTA_BIC, MIN_DELTA_BIC_MARGIN, record_round
from looping_pendulum.discrepancy.listed.screening import ScreenedCandidate, compile_for, screen, slowest_first
from looping_pendulum.discrepancy.result import Round
from looping_pendulum.discrepancy.unlisted.discovery import LIKELIHOOD_MARGIN, RecoveredForce, by_preference, discover
from looping_pendulum.discrepancy.unlisted.formula import FittedFormula
from looping_pendulum.discrepancy.unlisted.formula import refit as refit_formulas
from looping_pendulum.discrepancy.workers import SERIAL, Workers

MAX_REFITS = 6
"""Candidates that are refitted in a round."""
MAX_FURTHER_REFITS, MIN_SHARE_OF_BEST_SCORE = 12, 1 / 3
"""Further ones that are refitted if none of these passes, and the smallest score of those over the best.

Of an effect that fitted parameters nearly undo the scores say little: a linear drag that moved the light mass by 50 mm came
ninth, with a delta BIC of 750 where the best of six had 150; beside a wind it came tenth, with 260 where they had 45.
"""
MIN_REFIT_SCORE = 2.0
"""Smallest |z| of a candidate that is refitted.

The delta BIC that a score z predicts is z^2 less log(n), far below `MIN_DELTA_BIC` for such z.
"""
MAX_SCORE_RATIO = 6
"""Largest ratio of the best candidate's |z| to that of a candidate that is refitted."""
MAX_NONLINEARITY = 1.5
"""Largest delta BIC of a refit over what its score predicts, z^2, up to which the scores are trusted to rank candidates.

A string that is smoother on itself had a score of 17, friction per wrap angle one of 33 in its place, which predicts a delta
BIC of 1100; its refit had 2520.
"""
MAX_RESCREENED = 5
"""Candidates that are screened again with all added effects in the model, which costs compilations."""
MAX_SQUARE_LEFT = 0.5
"""Share of the held-out mean square residual up to which an effect is not refused for the pattern that it leaves.

The errors of real marks are seldom as simple as correlated noise, so that a pattern stays beside the right effect, too.
"""
MAX_EFFECTS = 3
"""Effects that are added at most."""
MIN_RIVAL_EVIDENCE = 0.5
"""Smallest twice log Bayes factor of a force that is refitted as a rival of listed effects, as a share of what they explain.

In blind studies of a magnet and of a thrust, which two listed effects mimicked, it was 0.95 and 0.54; of two effects, 0.32.
"""

FractionCallback = Callable[[str, float], None]
"""Called with a description of the step that begins, and the share of all work that is done at least."""


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
        """Unlisted forces as radial basis functions, those that explain held-out data first; empty: none does.

        Beside accepted models: they explain held-out data as well as these.
        """
        self.beside_forces: tuple[Candidate, ...] = ()
        """Listed effects that the model has beside these forces."""
        self.formulas: tuple[FittedFormula, ...] = ()
        """Formulas of these forces, refitted to the trajectories, the best first."""
        self.scales: dict[str, float] = {}
        """Candidate's name -> change of its value that changes the prediction as `screening.SCALE_SIZE` says."""
        self.white_rounds: dict[int, tuple[CandidateModel, list[Refit], dict[str, CandidateModel]]] = {}
        """Rounds with white noise, by their index: the model before, its refits, and those of them that were tested."""
        self.correlated_base: CandidateModel | None = None
        """The declared model with errors of the tracked points that last longer than a frame; None: the search takes none."""
        self.correlated_fit: Fit | None = None
        """Fit of the declared model with such errors, once it is known that there are some."""

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
        current, best_single, searched_unlisted = self.declared_model, None, False
        for added_count in range(MAX_EFFECTS):
            if not current.failed_tests:
                return
            if added_count == MAX_EFFECTS - 1:
                # So many listed effects can mimic most of what the library lacks: one unlisted force is simpler
                searched_unlisted = True
                if self.unlisted_force_explains(best_single):
                    return
            next_model = self.run_round(current, 0.1 + 0.2 * added_count)
            if self.accepted_models:
                return self.find_rivals_of_several() if added_count else None
            if not added_count and self.noise_explains_all():
                return
            next_model = self.run_wider_round(current, 0.3 + 0.2 * added_count) or next_model
            if self.accepted_models:
                return self.find_rivals_of_several() if added_count else None
            if next_model is None:
                break
            current = self.revise(next_model)
            if current is not next_model and not current.failed_tests:
                self.accepted_models = (current,)
                return self.find_rivals_of_several()
            if best_single is None:
                best_single = current
        if not searched_unlisted and self.unlisted_force_explains(best_single):
            return
        if self.correlated_fit is not None:
            self.search_with_correlated_noise()

    def unlisted_force_explains(self, best_single: CandidateModel | None) -> bool:
        """Return whether an unlisted force explains the data, beside the declared model or beside its best single effect."""
        assert self.declared_model is not None
        self.forces = self.find_unlisted_forces(self.declared_model)
        if not self.forces and best_single is not None:
            self.forces = self.find_unlisted_forces(best_single)
            self.beside_forces = best_single.added if self.forces else ()
        elif self.forces:
            self.find_listed_rivals()
        return bool(self.forces)

    def find_listed_rivals(self) -> None:
        """Find one or two listed effects that explain the data as well as an unlisted force.

        In one trial the fitted parameters can make up for most of a large effect, so that its delta BIC is below
        `MIN_DELTA_BIC`; it may be the only one or the second of two. Held-out data decide: a model with it is tied with the
        force if it passes every test and the force does not predict them better by `LIKELIHOOD_MARGIN`.
        """
        for index, (current, refitted, judged) in self.white_rounds.items():
            weak = [r for r in refitted if 0 < r.delta_bic < MIN_DELTA_BIC and r.within_bounds]
            rivals = {
                name: m
                for name, m in self.judge_refits(current, weak, 0.95).items()
                if not m.failed_tests and not predicts_better(m.held_out, self.forces[0].held_out, LIKELIHOOD_MARGIN)
            }
            if rivals:
                self.accepted_models = tuple(rivals.values())
                self.rounds[index] = record_round(current, refitted, judged | rivals, correlated_noise=False)
                return

    def noise_explains_all(self) -> bool:
        """Return whether errors of the tracked points that last longer than a frame are all that the declared model lacks.

        Such noise can stand for much of what a model lacks. So all tests must pass with it, and no candidate, with the noise
        that its own residuals show, may have a delta BIC of `MIN_DELTA_BIC`, nor an unlisted force explain held-out data.
        """
        assert self.declared_model is not None
        self.report_progress("estimating errors of the tracked points that last longer than a frame", 0.28)
        fit = with_correlated_noise(self.declared_model.fit)
        if not noises_of(fit):
            return False
        self.correlated_fit = fit
        # The cheapest tests first: where an effect is missing, one of them mostly fails
        if not check_residuals(fit).passes:
            return False
        base = self.correlated_model
        if base.failed_tests or any(r.delta_bic >= MIN_DELTA_BIC for r in self.refits_with_own_noise):
            return False
        if self.find_unlisted_forces(base):
            return False
        self.declared_model = base
        return True

    @cached_property
    def correlated_model(self) -> CandidateModel:
        """Return the declared model with errors of the tracked points that last longer than a frame, tested."""
        assert self.correlated_fit is not None
        return self.judge(self.correlated_fit, ())

    @cached_property
    def refits_with_own_noise(self) -> list[Refit]:
        """Return the refits of the first round, each with the noise that its own residuals show."""
        assert self.correlated_fit is not None
        return with_own_noises(self.correlated_fit, self.white_rounds[0][1], self.workers)

    def search_with_correlated_noise(self) -> None:
        """Search again with errors of the tracked points that last longer than a frame, as of a tracker that wanders.

        Each model has the noise that its own residuals show, and models are compared by their likelihoods.
        """
        assert self.declared_model is not None
        self.correlated_base = base = current = self.correlated_model
        for added_count in range(MAX_EFFECTS):
            next_model = self.run_round(current, 0.9 + 0.02 * added_count)
            if self.accepted_models and added_count:
                self.find_rivals()
            if self.accepted_models or next_model is None:
                break
            current = next_model
        if self.accepted_models:
            # The report compares both models by the same noise
            white, best = self.declared_model.fit, self.accepted_models[0].fit.problem.data
            self.declared_model = self.judge(minimise(white.problem.with_data(best), white.x), ())
        else:
            self.forces = self.find_unlisted_forces(base)

    def find_rivals_of_several(self) -> None:
        """Find what explains the data as well as several listed effects: other listed ones, or one unlisted force.

        Several listed effects can mimic one law that the library lacks. Held-out data decide between them: an unlisted force
        that predicts them better by `LIKELIHOOD_MARGIN` replaces the listed effects, one that is worse by as much is dropped,
        and one between is kept as an explanation beside them.
        """
        assert self.declared_model is not None
        self.find_rivals()
        best, declared = self.accepted_models[0], self.declared_model.fit
        same_noise = best.fit.problem.with_data(declared.problem.data).residuals(best.fit.x)
        explained = declared.cost - float(same_noise @ same_noise) if same_noise is not None else 0.0
        forces = self.find_unlisted_forces(self.declared_model, MIN_RIVAL_EVIDENCE * explained)
        if not forces or predicts_better(forces[0].held_out, best.held_out, LIKELIHOOD_MARGIN):
            return
        self.forces = forces
        if predicts_better(best.held_out, forces[0].held_out, LIKELIHOOD_MARGIN):
            self.accepted_models = ()

    def find_rivals(self) -> None:
        """Find rivals of every effect that was added before the last, with the later ones in the model.

        An early effect was compared with its rivals in a model without the later ones; beside these, another may do as well.
        """
        best = self.accepted_models[0]
        for dropped in best.added[:-1]:
            current = self.without(best, dropped)
            # Delta BIC of the dropped effect beside the others, less the margin within which explanations are tied
            min_delta_bic = delta_bic_of(dropped, current.fit, best.fit) - MIN_DELTA_BIC_MARGIN
            refits = self.refit_candidates(current, 0.7)
            rivals = [r for r in refits if r.delta_bic >= max(min_delta_bic, MIN_DELTA_BIC) and r.within_bounds]
            judged = self.judge_refits(current, rivals, 0.8)
            self.record(current, refits, judged)
            self.accepted_models += tuple(judged.values())

    def revise(self, model: CandidateModel) -> CandidateModel:
        """Remove or replace an effect that was added before the last, if the later ones have made it useless or second best.

        An early effect may only have stood for a later one. It leaves again if its delta BIC beside the others is below
        `MIN_DELTA_BIC`, and is replaced if another candidate's is larger by `MIN_DELTA_BIC_MARGIN`.
        """
        for dropped in model.added[:-1]:
            current = self.without(model, dropped)
            delta_bic = delta_bic_of(dropped, current.fit, model.fit)
            if delta_bic < MIN_DELTA_BIC:
                return self.judge(with_noise_of_residuals(current.fit), current.added)
            refits = self.refit_candidates(current, 0.5)
            better = [r for r in refits if r.delta_bic > delta_bic + MIN_DELTA_BIC_MARGIN and r.within_bounds][:1]
            if better:
                judged = self.judge_refits(current, better, 0.55)
                self.record(current, refits, judged)
                return judged[better[0].candidate.name]
        return model

    def without(self, model: CandidateModel, dropped: Candidate) -> CandidateModel:
        """Return a model without one of its added effects, fitted to the same data, to which others can be added."""
        others = tuple(c for c in model.added if c is not dropped)
        dropped_names = {dropped.name, *(c.name for c in dropped.companions)}
        kept = [i for i, n in enumerate(model.fit.problem.names) if n not in dropped_names]
        parameters = [model.fit.problem.free_parameters[i] for i in kept]
        problem = Problem(self.inputs.study, model.fit.problem.data, parameters)
        # Without what held its phase a long swing is far from its minimum, so that it is fitted in growing windows again
        fit = calibrate(problem, model.fit.x[kept]) if problem.is_swing else minimise(problem, model.fit.x[kept])
        remaining = tuple(s for s in self.screen_candidates(fit, others) if s.candidate is not dropped)
        return CandidateModel(
            fit=fit, added=others, tests=model.tests, held_out=model.held_out, screening=_returning(remaining)
        )

    def record(self, current: CandidateModel, refits: Sequence[Refit], judged: dict[str, CandidateModel]) -> None:
        """Record a round."""
        self.rounds.append(record_round(current, refits, judged, correlated_noise=self.correlated_base is not None))

    def judge(
        self,
        fit: Fit,
        added: tuple[Candidate, ...],
        start_costs: tuple[float, ...] = (),
        without: HeldOutTest | None = None,
    ) -> CandidateModel:
        """Test a fit on its residuals, on held-out data and by the scores of the remaining candidates."""
        held_out = check_held_out(fit, self.inputs.held_out)
        other_tests: tuple[ModelTest, ...] = (loss_test(without, held_out),) if without else ()
        tests = check_residuals(fit)
        if added and self.correlated_base and self.declared_model:
            other_tests += (improvement_test(self.correlated_base.held_out, held_out),)
            if square_ratio(self.declared_model.held_out, held_out) <= MAX_SQUARE_LEFT:
                tests = dataclasses.replace(tests, groups=())
        return CandidateModel(
            fit=fit,
            added=added,
            tests=tests,
            held_out=held_out,
            screening=lambda: self.screen_candidates(fit, added),
            start_costs=start_costs,
            other_tests=other_tests,
        )

    def screen_candidates(self, fit: Fit, added: tuple[Candidate, ...]) -> tuple[ScreenedCandidate, ...]:
        """Screen the candidates that could still be added, best first.

        The reference is compiled anew for every set of effects, so beside an added effect that needs it only the best are
        screened exactly.
        """
        added_names = {c.name for c in added}
        costly = {k for c in added if c.needs_compilation for k in (c.name, *(k.name for k in c.companions))}
        library = [c for c in self.inputs.library if c.name not in added_names]
        rough = screen(fit, library, tuple(costly), self.workers, self.scales)
        self.scales |= {s.candidate.name: s.scale for s in rough}
        if not costly:
            return tuple(rough)
        best = [s.candidate for s in rough[:MAX_RESCREENED] if abs(s.score) > MIN_REFIT_SCORE]
        exact = screen(fit, best, workers=self.workers, known_scales=self.scales)
        rescreened = {s.candidate.name for s in exact}
        both = [*exact, *(s for s in rough if s.candidate.name not in rescreened)]
        return tuple(sorted(both, key=lambda s: -abs(s.score)))

    def run_round(self, current: CandidateModel, share: float) -> CandidateModel | None:
        """Try to add one effect; return the best model to go on from, or None if no delta BIC is sufficient."""
        return self.judge_round(current, self.refit_candidates(current, share), share)

    def run_wider_round(self, current: CandidateModel, share: float) -> CandidateModel | None:
        """Refit further candidates where none of the last round passed; return the best model, or None if it is the same."""
        known = self.white_rounds[len(self.rounds) - 1][1]
        names = {r.candidate.name for r in known}
        further = [
            s
            for s in current.remaining
            if s.amplitude
            and s.candidate.name not in names
            and abs(s.score) >= MIN_SHARE_OF_BEST_SCORE * abs(current.remaining[0].score)
        ]
        wider = [*known, *refits(current.fit, further[:MAX_FURTHER_REFITS], {}, self.workers)]
        best = max(wider, key=lambda r: r.delta_bic, default=None)
        if best is None or best in known:
            return None
        self.rounds.pop()  # the round is part of this one
        return self.judge_round(current, sorted(wider, key=lambda r: -r.delta_bic), share)

    def judge_round(self, current: CandidateModel, refits: Sequence[Refit], share: float) -> CandidateModel | None:
        """Test the best refits and record the round; return the best model, or None if no delta BIC is sufficient."""
        threshold = max(MIN_DELTA_BIC, refits[0].delta_bic - MIN_DELTA_BIC_MARGIN) if refits else MIN_DELTA_BIC
        near = [r for r in refits if r.delta_bic >= threshold]
        judged = self.judge_refits(current, near, share + (0.01 if self.correlated_base else 0.2), current.held_out)
        self.record(current, refits, judged)
        if self.correlated_base is None:
            self.white_rounds[len(self.rounds) - 1] = (current, list(refits), judged)
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
        eligible = [s for s in current.remaining if s.amplitude and abs(s.score) >= min_score]
        chosen = eligible[:MAX_REFITS]
        known: dict[str, Refit | None] = dict(current.refitted)
        if self.correlated_base and not current.added:
            # Correlated noise may hide from the score what the candidate's own noise shows
            known.update((r.candidate.name, r) for r in self.refits_with_own_noise)
            chosen += [s for s in current.remaining if s.candidate.name in known and s not in chosen]
        counter = itertools.count()

        def report(name: str) -> None:
            self.report_progress(
                f"refitting with {name}", share + (0.01 if self.correlated_base else 0.15) * next(counter) / MAX_REFITS
            )

        results = refits(current.fit, chosen, known, self.workers, report)
        if results and results[0].delta_bic > MAX_NONLINEARITY * results[0].screened.score ** 2:
            # Of a large effect the scores say little: what acts on the same may do better than the best with a smaller score
            acts_on = results[0].candidate.acts_on
            alike = [s for s in eligible if s.candidate.acts_on == acts_on and s not in chosen][:MAX_REFITS]
            known.update((r.candidate.name, r) for r in results)
            results = refits(current.fit, [*chosen, *alike], known, self.workers, report)
        return results

    def judge_refits(
        self, current: CandidateModel, refits: Sequence[Refit], share: float, without: HeldOutTest | None = None
    ) -> dict[str, CandidateModel]:
        """Test each refit, and whether held-out data are less likely than ``without`` it; return candidate name -> model."""
        judged = {}
        for r in refits:
            self.report_progress(f"testing {r.candidate.name}", share)
            fit = r.fit if self.correlated_base else with_noise_of_residuals(r.fit, central=True)
            judged[r.candidate.name] = self.judge(fit, (*current.added, r.candidate), without=without)
        return judged

    def find_unlisted_forces(self, base: CandidateModel, min_evidence: float = -math.inf) -> tuple[RecoveredForce, ...]:
        """Search for an unlisted force that a model lacks; return the best closures, or none if none explains held-out data.

        Closures with less than ``min_evidence``, twice a log Bayes factor, are not refitted.
        """
        if not any(d.channels for d in self.inputs.training):  # a few events do not determine a force as a function
            return ()
        self.formulas = ()
        forces = discover(
            base.fit, self.inputs.held_out, lambda what: self.report_progress(what, 0.85), self.workers,
            min_evidence=MIN_DELTA_BIC if noises_of(base.fit) else min_evidence,
        )  # fmt: skip
        # Many forms are tried, so that the best of them fits noise better than none; held-out data are not so easily pleased
        passing = [
            f
            for f in forces
            if f.twice_log_bayes_factor >= MIN_DELTA_BIC
            and f.held_out.passes
            and predicts_better(base.held_out, f.held_out, MIN_DELTA_BIC)
        ]
        if noises_of(base.fit):
            # Nor is a force of any form an explanation if without it, and with white noise, the model is nearer to the points
            passing = [f for f in passing if self.declared_model and square_ratio(self.declared_model.held_out, f.held_out) < 1]
        if passing:
            formulas = refit_formulas(base.fit, passing, self.inputs.held_out, lambda what: self.report_progress(what, 0.93))
            self.formulas = tuple(formulas)
        return tuple(by_preference(passing) + [f for f in forces if f not in passing]) if passing else ()


def _returning(screened: tuple[ScreenedCandidate, ...]) -> Callable[[], tuple[ScreenedCandidate, ...]]:
    return lambda: screened  # a function of its own binds the value of this turn of the caller's loop
