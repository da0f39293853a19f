"""A fitted model with the results of all tests that it may fail."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

from looping_pendulum.discrepancy.fit.calibration import Fit
from looping_pendulum.discrepancy.fit.residual import ResidualTests
from looping_pendulum.discrepancy.listed.attribution import MAX_NULL_SCORE, HeldOutTest, Refit, refit
from looping_pendulum.discrepancy.listed.candidates import Candidate
from looping_pendulum.discrepancy.listed.screening import ScreenedCandidate

MAX_SCORES_CHECKED = 3
"""Candidates whose score alone may fail a model."""
MIN_REALISED_SHARE = 0.5
"""Share of the chi-square decrease predicted by a score of `MAX_NULL_SCORE` that a refit must realise to fail a model."""


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
        if refitted is None:
            return False
        # Of likelihoods, since the refit may have a noise of its own
        decrease = self.fit.minus_twice_log_likelihood - refitted.fit.minus_twice_log_likelihood
        return decrease > MIN_REALISED_SHARE * MAX_NULL_SCORE**2

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the added effects."""
        return tuple(c.name for c in self.added)
