"""What may be claimed of an explanation: every test of its fits, and the verdict that they leave of what the evidence says."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from looping_pendulum.discrepancy.fit.residual import ModelTest
from looping_pendulum.discrepancy.result import Verdict

if TYPE_CHECKING:
    from looping_pendulum.discrepancy.evidence.explain import Judged

MAX_LOSS = 0.5
"""Largest log likelihood of held-out data that an explanation may lose against the declared model.

A difference of half a unit is no evidence: noise that is estimated anew beside each model makes as much of it.
"""


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

    @property
    def all(self) -> tuple[ModelTest, ...]:
        """Every test."""
        return (self.convergence, *self.residuals, *self.held_out, *([self.loss] if self.loss else []))

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
        """Whether held-out data are predicted better than by the declared model."""
        return self.loss is not None and self.loss.value < -MAX_LOSS

    @property
    def explains(self) -> bool:
        """Whether the model may be said to explain the data."""
        is_no_worse = self.loss is None or self.loss.passes
        return self.fits and is_no_worse and (self.predicts or self.improves)


def tests_of(model: Judged, declared: Judged) -> ModelTests:
    """Return the tests of a model, which is compared with the declared one unless it is that."""
    loss = None
    if model is not declared:
        worst = max(range(len(model.held_out.chi2)), key=lambda i: model.held_out.chi2[i])
        loss = ModelTest(
            subject=f"held-out {model.held_out.subjects[worst]}",
            statistic="log likelihood lost against the declared model",
            value=0.5 * (model.held_out.worst - declared.held_out.worst) * model.held_out.counts[worst],
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
    )


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
