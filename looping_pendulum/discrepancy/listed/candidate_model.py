"""A fitted model with the results of all tests that it may fail."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

from looping_pendulum.discrepancy.fit.calibration import Fit
from looping_pendulum.discrepancy.fit.model_test import ModelTest, failures_in_words
from looping_pendulum.discrepancy.fit.residual import ResidualTests
from looping_pendulum.discrepancy.listed.attribution import MIN_DELTA_BIC, Refit, refit
from looping_pendulum.discrepancy.listed.candidates import Candidate
from looping_pendulum.discrepancy.listed.held_out import HeldOutTest
from looping_pendulum.discrepancy.listed.screening import MAX_NULL_SCORE, ScreenedCandidate

MAX_SCORES_CHECKED = 3
"""Candidates whose score alone may fail a model."""


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
    other_tests: tuple[ModelTest, ...] = ()
    """Results of tests beyond those of residuals, held-out data and scores."""
    refitted: dict[str, Refit | None] = field(default_factory=dict)
    """Candidates that were refitted to check what their score predicts, by name."""
    refuted: frozenset[str] = frozenset()
    """Names of candidates that other tests refused, so that their scores are chance."""

    @cached_property
    def remaining(self) -> tuple[ScreenedCandidate, ...]:
        """Candidates that could still be added, best first; screened on first access, since that takes long."""
        return self.screening()

    @cached_property
    def test_results(self) -> tuple[ModelTest, ...]:
        """Results of all tests.

        Scores are not checked where an added effect fails another test already: the model is refused in any case.
        """
        results = (*self.tests.results, *self.other_tests, *self.held_out.results)
        failed = any(not t.passes for t in results)
        if (failed and self.added) or not self.remaining:
            return results
        high = [s for s in self.remaining[:MAX_SCORES_CHECKED] if abs(s.score) > MAX_NULL_SCORE]
        left = [s for s in high if s.candidate.name not in self.refuted]
        # One is enough to fail the model, and each further one would cost a refit
        confirmed = next((s for s in left if failed or self._has_evidence(s)), None)
        tested = confirmed or self.remaining[0]
        by = "a refit does" if left else "further tests of the refit do"
        score = ModelTest(
            subject=tested.candidate.name,
            statistic=f"score |z|, which {by} not confirm" if high and not confirmed else "score |z|",
            value=abs(tested.score),
            limit=MAX_NULL_SCORE,
            passes=confirmed is None,
            failure=f"the residuals look like {tested.candidate.name}",
        )
        return (*results, score)

    @property
    def failed_tests(self) -> tuple[str, ...]:
        """What the failed tests mean, in words; empty: the model passes."""
        return failures_in_words(self.test_results)

    def _has_evidence(self, screened: ScreenedCandidate) -> bool:
        """Whether a refit with a candidate has the evidence with which it would be added.

        A candidate that does nearly the same as a fitted parameter may have a high score, but its refit gains little.
        """
        name = screened.candidate.name
        if name not in self.refitted:
            self.refitted[name] = refit(self.fit, screened)
        refitted = self.refitted[name]
        return refitted is not None and refitted.delta_bic >= MIN_DELTA_BIC

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the added effects."""
        return tuple(c.name for c in self.added)
