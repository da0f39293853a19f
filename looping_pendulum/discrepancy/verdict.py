"""What may be claimed of an explanation: every test of its fits, and the verdict that they leave of what the evidence says."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from looping_pendulum.discrepancy.fit.held_out import HeldOutTest
from looping_pendulum.discrepancy.fit.residual import ModelTest
from looping_pendulum.discrepancy.result import Verdict

if TYPE_CHECKING:
    from looping_pendulum.discrepancy.evidence.explain import Judged

MAX_LOSS = 0.5
"""Largest log likelihood of held-out data that an explanation may lose against the declared model.

A difference of half a unit is no evidence: noise that is estimated anew beside each model makes as much of it.
"""
LEAST_EXPLAINED = 0.5
"""Least share of what the declared model misses of held-out data that is called an explanation of it."""


@dataclass(frozen=True, kw_only=True)
class ModelTests:
    """Tests of a model: of its fit to all data, and of its fit to the training data on held-out data."""

    convergence: ModelTest
    residuals: tuple[ModelTest, ...]
    """Of the fit to all data."""
    seeks_patterns: bool
    """Whether the residuals were searched for patterns, not only measured: not where errors last longer than a frame."""
    held_out: tuple[ModelTest, ...]
    loss: ModelTest | None
    """Log likelihood of held-out data that the model loses against the declared one; None: it is the declared one."""
    contradiction: tuple[ModelTest, ...] = ()
    """Of the declared model where more probable ones fail the held-out data: their odds."""
    explained_share: float = 0.0
    """Share of the declared model's excess of chi2 over noise, on the worst held-out data, that the model explains."""

    @property
    def all(self) -> tuple[ModelTest, ...]:
        """Every test."""
        return (self.convergence, *self.residuals, *self.held_out, *([self.loss] if self.loss else []), *self.contradiction)

    @property
    def fits(self) -> bool:
        """Whether the fit to all data has converged, and leaves residuals that look like its noise."""
        return self.convergence.passes and all(t.passes for t in self.residuals)

    @property
    def predicts(self) -> bool:
        """Whether held-out data are predicted to their noise."""
        return all(t.passes for t in self.held_out)

    @property
    def improves(self) -> bool:
        """Whether held-out data are predicted better than by the declared model: most of what it misses is explained."""
        return self.loss is not None and self.loss.value < -MAX_LOSS and self.explained_share > LEAST_EXPLAINED

    @property
    def explains(self) -> bool:
        """Whether the model may be said to explain the data."""
        is_no_worse = self.loss is None or self.loss.passes
        return self.fits and is_no_worse and (self.predicts or self.improves)


def tests_of(model: Judged, declared: Judged, contradiction: tuple[ModelTest, ...]) -> ModelTests:
    """Return the tests of a model, which is compared with the declared one unless it is that.

    Parameters
    ----------
    contradiction
        What else the model fails: `Explanations.contradiction` of the declared one.
    """
    loss, share = None, 0.0
    if model is not declared:
        worst = max(range(len(model.held_out.chi2)), key=lambda i: model.held_out.chi2[i])
        chi2, chi2_declared, count = _chi2_of_both(model.held_out, declared.held_out, worst)
        share = (chi2_declared - chi2) / max(chi2_declared - count, 1.0)
        loss = ModelTest(
            subject=f"held-out {model.held_out.subjects[worst]}",
            statistic="log likelihood lost against the declared model",
            value=0.5 * (chi2 - chi2_declared),
            limit=MAX_LOSS,
            failure=f"it predicts the held-out {model.held_out.subjects[worst]} no better than the declared model does",
        )
    converged = all(fit.converged for fit in (model.fit, model.training))
    return ModelTests(
        convergence=ModelTest(
            subject="fit",
            statistic="converged (1: yes)",
            value=float(converged),
            limit=1.0,
            limit_is_lower=True,
            failure="the fit has not converged",
        ),
        residuals=model.tests.results,
        seeks_patterns=bool(model.tests.groups),
        held_out=model.held_out.results,
        loss=loss,
        contradiction=contradiction,
        explained_share=share,
    )


def _chi2_of_both(model: HeldOutTest, declared: HeldOutTest, worst: int) -> tuple[float, float, int]:
    """Return chi2 of the worst held-out trial, or of all blocks of time, by a model and by the declared one, and its mean.

    Of a trial by the same points and the smaller noise of the two, since a model that misses it finds its noise larger, too.
    """
    if not model.fits:
        count = model.counts[worst]
        return model.worst * count, declared.worst * count, count
    fits = model.fits[worst], declared.fits[worst]
    sigma = np.minimum(*(f.problem.data[0].sigma for f in fits))
    used = np.all([np.isfinite(f.problem.data[0].sigma) for f in fits], axis=0)
    of_model, of_declared = ((f.problem.data[0].value - f.problem.predict(f.x, 0))[used] / sigma[used] for f in fits)
    return float(of_model @ of_model), float(of_declared @ of_declared), int(used.sum())


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
