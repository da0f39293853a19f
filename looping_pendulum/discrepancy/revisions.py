"""Revisions of a model with several added effects: one leaves again, is replaced, or has rivals."""

from __future__ import annotations

import dataclasses

from looping_pendulum.discrepancy.fit.calibration import Fit, calibrate, minimise
from looping_pendulum.discrepancy.fit.problem import Problem
from looping_pendulum.discrepancy.fit.residual_noise import with_noise_of_residuals
from looping_pendulum.discrepancy.listed.attribution import MIN_DELTA_BIC, Refit, delta_bic_of, delta_bic_of_likelihoods
from looping_pendulum.discrepancy.listed.candidate_model import CandidateModel
from looping_pendulum.discrepancy.listed.candidates import Candidate
from looping_pendulum.discrepancy.listed.round_record import MIN_DELTA_BIC_MARGIN
from looping_pendulum.discrepancy.rounds import Rounds

MAX_REVISIONS = 4
"""Largest number of effects that leave or are replaced after one was added."""


class Revisions(Rounds):
    """Rounds, and the steps that try the effects of a model again once there are several."""

    def revise_until_settled(self, model: CandidateModel) -> CandidateModel:
        """Revise a model as long as an effect leaves or is replaced, and the model still fails a test.

        Once one wrong effect is replaced by the right one, another may be seen to be wrong, too.
        """
        for _ in range(MAX_REVISIONS):
            revised = self.revise(model)
            if revised is model or not revised.failed_tests:
                return revised
            model = revised
        return model

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
            delta_bic_to_beat = delta_bic + MIN_DELTA_BIC_MARGIN
            refits = self.refit_candidates(current, 0.5, delta_bic_to_beat)
            better = [r for r in refits if r.delta_bic > delta_bic_to_beat and r.within_bounds][:1]
            if better:
                judged = self.judge_refits(current, better, 0.55)
                self.record(current, refits, judged)
                return judged[better[0].candidate.name]
        return model

    def find_rivals(self) -> None:
        """Find rivals of every effect that was added before the last, with the later ones in the model.

        An early effect was compared with its rivals in a model without the later ones; beside these, another may do as well.
        """
        best = self.accepted_models[0]
        for dropped in best.added[:-1]:
            current = self.without(best, dropped)
            # Delta BIC of the dropped effect beside the others, less the margin within which explanations are tied
            min_delta_bic = max(delta_bic_of(dropped, current.fit, best.fit) - MIN_DELTA_BIC_MARGIN, 0.0)
            refits = self.refit_candidates(current, 0.7, min_delta_bic)
            rivals = [r for r in refits if r.delta_bic >= min_delta_bic and r.within_bounds]
            judged = self.judge_refits(current, rivals, 0.8)
            self.record(current, refits, judged)
            self.accepted_models += tuple(judged.values())

    def drop_needless_effects(self) -> None:
        """Replace the accepted models by those with an effect less that explain the data as well, as long as there are any.

        Far from its minimum the fit of a right effect alone may end short of it, and another one is added beside a wrong first.
        As a rival of that pair, beside what is left of the other, the right effect reaches its value and needs it no more.
        """
        while len(self.accepted_models[0].added) > 1:
            # The same effects may be left of several models
            left = {frozenset(m.names): m for model in self.accepted_models for m in self.with_an_effect_less(model)}
            if not left:
                return
            simpler = sorted(left.values(), key=lambda m: m.fit.minus_twice_log_likelihood)
            limit = simpler[0].fit.minus_twice_log_likelihood + MIN_DELTA_BIC_MARGIN
            self.accepted_models = tuple(m for m in simpler if m.fit.minus_twice_log_likelihood <= limit)
            self.record_simpler_models()

    def with_an_effect_less(self, model: CandidateModel) -> list[CandidateModel]:
        """Return the models without one of the effects of a model, if it explains too little beside the others and all pass."""
        simpler = []
        for dropped in model.added:
            fit = self.fit_without(model, dropped)
            if delta_bic_of(dropped, fit, model.fit) < MIN_DELTA_BIC:
                others = tuple(c for c in model.added if c is not dropped)
                found = self.judge(with_noise_of_residuals(fit), others)
                if not found.failed_tests:
                    simpler.append(found)
        return simpler

    def record_simpler_models(self) -> None:
        """Record the accepted models as a round, in which the last effect of each was tried beside its others."""
        assert self.declared_model is not None
        best = self.accepted_models[0]
        current = self.without(best, best.added[-1]) if len(best.added) > 1 else self.declared_model
        # An effect of a coefficient that is zero there, as attitude drag of no drag at all, changes nothing: its score is zero
        screened = {name: dataclasses.replace(s, score=0.0) for name, s in self.screened.items()}
        screened |= {s.candidate.name: s for s in current.remaining}
        alike = {m.added[-1].name: m for m in self.accepted_models if m.added[:-1] == best.added[:-1]}
        refits = [
            Refit(screened=screened[name], fit=m.fit, delta_bic=delta_bic_of_likelihoods(m.added[-1], current.fit, m.fit))
            for name, m in alike.items()
        ]
        self.record(current, sorted(refits, key=lambda r: -r.delta_bic), alike)

    def without(self, model: CandidateModel, dropped: Candidate) -> CandidateModel:
        """Return a model without one of its added effects, fitted to the same data, to which others can be added."""
        others = tuple(c for c in model.added if c is not dropped)
        fit = self.fit_without(model, dropped)
        remaining = tuple(s for s in self.screen_candidates(fit, others) if s.candidate is not dropped)
        return CandidateModel(fit=fit, added=others, tests=model.tests, held_out=model.held_out, screening=lambda: remaining)

    def fit_without(self, model: CandidateModel, dropped: Candidate) -> Fit:
        """Return the fit of a model without one of its added effects to the same data."""
        dropped_names = {dropped.name, *(c.name for c in dropped.companions)}
        kept = [i for i, n in enumerate(model.fit.problem.names) if n not in dropped_names]
        parameters = [model.fit.problem.free_parameters[i] for i in kept]
        problem = Problem(self.inputs.study, model.fit.problem.data, parameters)
        # Without what held its phase a long swing is far from its minimum, so that it is fitted in growing windows again
        return calibrate(problem, model.fit.x[kept]) if problem.is_swing else minimise(problem, model.fit.x[kept])
