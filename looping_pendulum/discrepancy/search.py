"""The search for missing effects: test residuals, screen candidates, refit, test on held-out data, add; then again."""

from __future__ import annotations

import dataclasses
import math
from functools import cached_property

import numpy as np

from looping_pendulum.discrepancy.fit.calibration import Fit, calibrate, minimise
from looping_pendulum.discrepancy.fit.correlated_noise_fit import noises_of, with_correlated_noise
from looping_pendulum.discrepancy.fit.model_test import ModelTest
from looping_pendulum.discrepancy.fit.problem import Problem
from looping_pendulum.discrepancy.fit.residual import best_of, calibrate_from_random_start, check_residuals
from looping_pendulum.discrepancy.fit.residual_noise import refit_with_estimated_noise
from looping_pendulum.discrepancy.inputs import Inputs
from looping_pendulum.discrepancy.listed.attribution import (
    MIN_DELTA_BIC,
    Refit,
    delta_bic_of_likelihoods,
    with_own_noises,
)
from looping_pendulum.discrepancy.listed.candidate_model import CandidateModel
from looping_pendulum.discrepancy.listed.candidates import Candidate
from looping_pendulum.discrepancy.listed.held_out import HeldOutTest, loss_test, predicts_better, square_ratio
from looping_pendulum.discrepancy.listed.round_record import record_round
from looping_pendulum.discrepancy.listed.screening import compile_for, slowest_first, steps_together
from looping_pendulum.discrepancy.revisions import Revisions
from looping_pendulum.discrepancy.rounds import MAX_CHANCE_DELTA_BIC, FractionCallback
from looping_pendulum.discrepancy.unlisted.discovery import (
    LIKELIHOOD_MARGIN,
    RecoveredForce,
    begin_to_discover,
    discover,
)
from looping_pendulum.discrepancy.unlisted.formula import FittedFormula
from looping_pendulum.discrepancy.unlisted.formula import refit as refit_formulas
from looping_pendulum.discrepancy.unlisted.screening import ScreenedClosure
from looping_pendulum.discrepancy.workers import SERIAL, Batch, Workers

MAX_EFFECTS = 3
"""Effects that are added at most."""
MIN_RIVAL_EVIDENCE = 0.5
"""Smallest twice log Bayes factor of a force that is refitted as a rival of listed effects, as a share of what they explain.

In blind studies of a magnet and of a thrust, which two listed effects mimicked, it was 0.95 and 0.54; of two effects, 0.32.
"""
MIN_HIDDEN_EVIDENCE = 20.0
"""Smallest twice log Bayes factor of a force that counts although the declared model passes all tests.

In clean studies forces of any form stay far below it (`thresholds` in docs/data/calibration.json).
"""

FORCE_EXPLAINS_MORE = "an unlisted force explains the data better"


class Search(Revisions):
    """State and steps of the search for missing effects."""

    def __init__(self, inputs: Inputs, seed: int, progress: FractionCallback, workers: Workers = SERIAL) -> None:
        super().__init__(inputs, progress, workers)
        self.rng = np.random.default_rng(seed)
        self.forces: tuple[RecoveredForce, ...] = ()
        """Unlisted forces as radial basis functions, those that explain held-out data first; empty: none does.

        Beside accepted models: they explain held-out data as well as these.
        """
        self.beside_forces: tuple[Candidate, ...] = ()
        """Listed effects that the model has beside these forces."""
        self.formulas: tuple[FittedFormula, ...] = ()
        """Formulas of the first of these forces, refitted to the trajectories, the best first."""
        self.explaining: tuple[Fit, list[RecoveredForce]] | None = None
        """The fit beside which forces were looked for last, and those of them that explain held-out data; None: none does."""
        self.not_refitted: list[ScreenedClosure] = []
        """Closures that were left out of the refits beside that fit, though the screening has them as likely as the best."""
        self.begun: tuple[Fit, Batch | None] | None = None
        """A fit, and what worker processes have begun of the search for an unlisted force beside it."""

    def run(self) -> None:
        """Search until a model passes all tests or no candidate is accepted; describe an unlisted force by formulas."""
        self.find_explanations()
        if not self.accepted_models and not self.forces:
            self.withdraw_refuted_scores()
        if self.forces and self.explaining is not None:
            fit, forces = self.explaining
            formulas = refit_formulas(
                fit, forces[0], self.inputs.held_out, lambda what: self.report_progress(what, 0.93), self.workers
            )
            self.formulas = tuple(formulas)

    def find_explanations(self) -> None:
        """Find listed effects, an unlisted force or noise that lasts longer than a frame, whatever explains the data."""
        self.report_progress("calibrating", 0.02)
        problem = Problem(self.inputs.study, self.inputs.training, self.inputs.free_parameters)
        compiled = slowest_first(c for c in self.inputs.library if c.needs_compilation)
        of_batch = [c for c in compiled if steps_together(problem, c)]
        compiled = [*of_batch[:1], *(c for c in compiled if c not in of_batch)]
        # Compiling the reference for some effects takes seconds, so an idle process begins with it now.
        self.workers.prepare(compile_for, problem, [None, *compiled])
        first = refit_with_estimated_noise(calibrate(problem))
        second = calibrate_from_random_start(first, self.rng)
        best = best_of([first, second])
        # The second start is fitted with the noise that the first one left; only a clearly better fit gets its own estimate.
        if best is second and second.cost < first.cost - 1:
            best = refit_with_estimated_noise(second)
        self.declared_model = self.judge(best, (), (first.cost, second.cost))
        if self.inputs.has_points:
            # Whatever the tests and the rounds find, it is compared with unlisted forces
            self.begun = best, begin_to_discover(best, self.workers)
        if not self.declared_model.failed_tests:
            self.declared_model = self.tested_for_unlisted_force(self.declared_model)
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
                return self.find_rivals_of_several() if added_count else self.find_likelier_force()
            if not added_count and self.noise_explains_all():
                return
            next_model = self.run_wider_round(current, 0.3 + 0.2 * added_count) or next_model
            if self.accepted_models:
                return self.find_rivals_of_several() if added_count else self.find_likelier_force()
            if next_model is None or self.is_swing_with_errors_that_last(next_model):
                break
            current = self.revise_until_settled(next_model)
            if current is not next_model and not current.failed_tests:
                self.accepted_models = (current,)
                return self.find_rivals_of_several()
            if best_single is None:
                best_single = current
        if not searched_unlisted and self.unlisted_force_explains(best_single):
            return
        if self.correlated_fit is not None:
            self.search_with_correlated_noise()

    def withdraw_refuted_scores(self) -> None:
        """Let the declared model pass if all that speaks against it are weak effects that further tests of their refits refuse.

        Of some thirty candidates one looks like noise now and then. Held-out data that such an effect makes less likely, or an
        equally good explanation by a tracker that wanders a little, show that it was chance.
        """
        model = self.correlated_base or self.declared_model
        beside_declared = next((r.ranking for r in reversed(self.rounds) if not r.added_before), ())
        evident = {c.name: c.delta_bic for c in beside_declared if c.delta_bic is not None and c.delta_bic >= MIN_DELTA_BIC}
        refused = {name for name, m in self.tested_beside_declared.items() if any(not t.passes for t in m.other_tests)}
        if model is None or not evident.keys() <= refused or max(evident.values(), default=0.0) > MAX_CHANCE_DELTA_BIC:
            return
        withdrawn = dataclasses.replace(model, refuted=frozenset(evident), screening=lambda: model.remaining)
        if not withdrawn.failed_tests:
            self.declared_model = withdrawn

    def tested_for_unlisted_force(self, model: CandidateModel) -> CandidateModel:
        """Return a model that passes all tests, with one more that fails if an unlisted force explains the data better.

        The fitted parameters can make up for so much of a force that is not listed that the residuals look like noise.
        """
        self.find_unlisted_forces(model, MIN_DELTA_BIC, MIN_HIDDEN_EVIDENCE)
        evidence = max((f.twice_log_bayes_factor for f in self.explaining[1]), default=0.0) if self.explaining else 0.0
        if evidence < MIN_HIDDEN_EVIDENCE:
            return model
        test = ModelTest(
            subject="unlisted forces",
            statistic="twice the log of the Bayes factor of the best",
            value=evidence,
            limit=MIN_HIDDEN_EVIDENCE,
            passes=False,
            failure=FORCE_EXPLAINS_MORE,
        )
        return dataclasses.replace(model, other_tests=(*model.other_tests, test))

    def unlisted_force_explains(self, best_single: CandidateModel | None) -> bool:
        """Return whether an unlisted force explains the data, beside the declared model or beside its best single effect."""
        assert self.declared_model is not None
        self.forces = self.find_unlisted_forces(self.declared_model)
        if not self.forces and best_single is not None:
            self.forces = self.find_unlisted_forces(best_single)
            self.beside_forces = best_single.added if self.forces else ()
        elif self.forces:
            self.find_listed_rivals()
            self.accept_if_it_predicts_as_well(best_single, self.declared_model.fit)
        return bool(self.forces)

    def find_likelier_force(self) -> None:
        """Find an unlisted force that the training data make at least as likely as the listed effect that was accepted.

        A listed effect that is nearly right can pass every test. A force that is likelier by `LIKELIHOOD_MARGIN` replaces it
        unless held-out data speak against that; else both are named. Where a listed effect is right, a force is seldom as
        likely, as it has more free numbers.
        """
        assert self.declared_model is not None
        best = self.best_refit_of_last_round
        # Like with like: closures are screened by a linear model, which shows too little of a large effect, and a bit of any
        min_evidence = min(best.predicted_delta_bic, best.delta_bic) - LIKELIHOOD_MARGIN
        forces = self.find_unlisted_forces(self.declared_model, min_evidence, best.delta_bic)
        if self.explaining is None or max(f.twice_log_bayes_factor for f in self.explaining[1]) < best.delta_bic:
            return
        self.forces = forces
        if not is_likelier(forces[0], best.delta_bic, self.accepted_models[0].held_out):
            return
        # What was accepted is not right, but a listed effect whose score was smaller may be
        self.run_wider_round(self.declared_model, 0.9)
        best = self.best_refit_of_last_round
        if not self.accepted_models or is_likelier(forces[0], best.delta_bic, self.accepted_models[0].held_out):
            self.give_way_to_force()
        elif max(f.twice_log_bayes_factor for f in self.explaining[1]) < best.delta_bic:
            self.forces = ()

    @property
    def best_refit_of_last_round(self) -> Refit:
        """Return the refit of the last round with the largest delta BIC."""
        return max(self.white_rounds[len(self.rounds) - 1][1], key=lambda r: r.delta_bic)

    @property
    def linear_share(self) -> float:
        """Return the share that a linear model shows of what the best single effect explains, at most 1.

        Closures are screened by such a model, which shows too little of a large effect, and are then compared with refits.
        """
        best = max(self.white_rounds[0][1], key=lambda r: r.chi2_decrease)
        return min(best.screened.score**2 / best.chi2_decrease, 1.0)

    def give_way_to_force(self) -> None:
        """Withdraw the accepted models, since an unlisted force explains the data better; the record of the rounds says so."""
        self.accepted_models = ()
        for i, one in enumerate(self.rounds):
            ranking = (dataclasses.replace(c, passes=False, reason=FORCE_EXPLAINS_MORE) if c.passes else c for c in one.ranking)
            self.rounds[i] = dataclasses.replace(one, ranking=tuple(ranking))

    def accept_if_it_predicts_as_well(self, model: CandidateModel | None, base: Fit) -> None:
        """Accept a listed effect that failed a test beside ``base`` if it predicts held-out data as well as the force found.

        Of thousands of right effects some fail a test by chance: with a side force of a delta BIC of 900 chi2 per value of
        held-out data was just above its limit. A force, which can take any form, never looks worse.
        """
        if model is None or self.accepted_models or not self.forces:
            return
        force, delta_bic = self.forces[0], delta_bic_of_likelihoods(model.added[0], base, model.fit)
        if is_likelier(force, delta_bic, model.held_out) or predicts_better(model.held_out, force.held_out, LIKELIHOOD_MARGIN):
            return
        self.accepted_models = (model,)

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
        if not check_residuals(fit).passes or any(has_evidence(r) for r in with_own_noises(fit, self.white_rounds[0][1][:1])):
            return False
        base = self.correlated_model
        if base.failed_tests or any(has_evidence(r) for r in self.refits_with_own_noise):
            return False
        if self.find_unlisted_forces(base):
            return False
        self.declared_model = base
        return True

    def is_swing_with_errors_that_last(self, model: CandidateModel) -> bool:
        """Return whether a long swing leaves errors that last longer than a frame, so that no test by white noise can pass.

        In a loop they may come from a further effect, which the next round finds. The rounds of a long swing take ten times as
        long, and the search with such errors finds the same effects.
        """
        return (
            self.correlated_fit is not None and model.fit.problem.is_swing and bool(noises_of(with_correlated_noise(model.fit)))
        )

    @cached_property
    def correlated_model(self) -> CandidateModel:
        """Return the declared model with errors of the tracked points that last longer than a frame, tested."""
        assert self.correlated_fit is not None
        return self.judge(self.correlated_fit, ())

    def search_with_correlated_noise(self) -> None:
        """Search again with errors of the tracked points that last longer than a frame, as of a tracker that wanders.

        Each model has the noise that its own residuals show, and models are compared by their likelihoods.
        """
        assert self.declared_model is not None
        self.correlated_base = base = current = self.correlated_model
        best_single: CandidateModel | None = None
        for added_count in range(MAX_EFFECTS):
            next_model = self.run_round(current, 0.9 + 0.02 * added_count)
            if self.accepted_models and added_count:
                self.find_rivals()
            if self.accepted_models or next_model is None:
                break
            current = next_model
            best_single = best_single or current
        if not self.accepted_models:
            self.forces = self.find_unlisted_forces(base)
            self.accept_if_it_predicts_as_well(best_single, base.fit)
        if self.accepted_models:
            # The report compares both models by the same noise
            white, best = self.declared_model.fit, self.accepted_models[0].fit.problem.data
            self.declared_model = self.judge(minimise(white.problem.with_data(best), white.x), ())

    def find_rivals_of_several(self) -> None:
        """Find what explains the data as well as several listed effects: other listed ones, or one unlisted force.

        Several listed effects can mimic one law that the library lacks. Held-out data decide between them: an unlisted force
        that predicts them better by `LIKELIHOOD_MARGIN` replaces the listed effects, one that is worse by as much is dropped,
        and one between is kept as an explanation beside them, unless the training data make it likelier by that margin.
        """
        assert self.declared_model is not None
        self.find_rivals()
        self.drop_needless_effects()
        if len(self.accepted_models[0].added) == 1:
            return
        best, declared = self.accepted_models[0], self.declared_model.fit
        same_noise = best.fit.problem.with_data(declared.problem.data).residuals(best.fit.x)
        explained = declared.cost - float(same_noise @ same_noise) if same_noise is not None else 0.0
        forces = self.find_unlisted_forces(self.declared_model, MIN_RIVAL_EVIDENCE * explained * self.linear_share)
        if not forces or predicts_better(forces[0].held_out, best.held_out, LIKELIHOOD_MARGIN):
            return
        self.forces = forces
        if is_likelier(forces[0], explained, best.held_out) or predicts_better(
            best.held_out, forces[0].held_out, LIKELIHOOD_MARGIN
        ):
            self.give_way_to_force()

    def find_unlisted_forces(
        self, base: CandidateModel, min_evidence: float = -math.inf, min_evidence_of_best: float = MIN_DELTA_BIC
    ) -> tuple[RecoveredForce, ...]:
        """Search for an unlisted force that a model lacks; return the best closures, or none if none explains held-out data.

        Closures with less than ``min_evidence``, twice a log Bayes factor by a linear model, are not refitted, and if no refit
        has ``min_evidence_of_best``, none is tested on held-out data.
        """
        if not self.inputs.has_points:  # a few events do not determine a force as a function
            return ()
        self.explaining = None
        forces, not_refitted = discover(
            base.fit, self.inputs.held_out, lambda what: self.report_progress(what, 0.85), self.workers,
            min_evidence=MIN_DELTA_BIC if noises_of(base.fit) else min_evidence, min_evidence_of_best=min_evidence_of_best,
            begun=self.begun[1] if self.begun and self.begun[0] is base.fit else None, held_out_fits=base.held_out.fits,
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
        if not passing:
            return ()
        self.explaining, self.not_refitted = (base.fit, passing), not_refitted
        return tuple(passing + [f for f in forces if f not in passing])


def has_evidence(refit: Refit) -> bool:
    """Return whether the evidence for a candidate suffices."""
    return refit.delta_bic >= MIN_DELTA_BIC


def is_likelier(force: RecoveredForce, delta_bic: float, held_out: HeldOutTest) -> bool:
    """Return whether all data make an unlisted force likelier than listed effects, and held-out data alone do not object.

    Parameters
    ----------
    delta_bic, held_out
        Of the listed effects.
    """
    gained = held_out.minus_twice_log_predictive_density - force.held_out.minus_twice_log_predictive_density
    is_likelier = force.twice_log_bayes_factor - delta_bic + gained >= LIKELIHOOD_MARGIN
    return is_likelier and loss_test(held_out, force.held_out).passes
