"""The result of one test of a model: what it says in words, and the number behind it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class ModelTest:
    """One test of a model."""

    subject: str
    """What was tested: "all residuals", "sliding, light along", "held-out trial eight", the name of a candidate."""
    statistic: str
    """Name of the number that was tested, for example "chi2 per degree of freedom"."""
    value: float
    limit: float
    """Largest value that passes, or the smallest one if `limit_is_lower`."""
    limit_is_lower: bool = False
    passes: bool
    failure: str
    """What a failure means, in words without the number, for example "the residuals still have a pattern"."""


def failures_in_words(tests: Iterable[ModelTest]) -> tuple[str, ...]:
    """Return what the failed tests mean, each meaning once, in their order; empty if all pass."""
    return tuple(dict.fromkeys(t.failure for t in tests if not t.passes))
