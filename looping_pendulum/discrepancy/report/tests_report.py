"""Report the numbers behind the verdict: every test of the declared and of the repaired model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from looping_pendulum.compare.tables import GAP, number, table
from looping_pendulum.discrepancy.fit.model_test import ModelTest
from looping_pendulum.discrepancy.report import unlisted_report
from looping_pendulum.discrepancy.report.lead_figure import has_repair
from looping_pendulum.discrepancy.result import Identification


def section(result: Identification) -> str:
    """Return the section on tests."""
    models = {"declared model": result.before.tests}
    if has_repair(result):
        models["repaired model"] = result.after.tests
    force = [unlisted_report.tests(result.unlisted)] if result.unlisted else []
    parts = [_tests(models), *force]
    note = (
        "Whether the residuals look like noise, in size and in every part of the motion, and whether a fit of the training "
        "trials predicts the held-out data. The verdict rests on the probabilities above; a model whose residuals fail is said "
        "to leave something unexplained.\n\n"
    )
    return "## Tests\n\n" + note + "\n".join(parts)


def _tests(models: Mapping[str, Sequence[ModelTest]]) -> str:
    """Return one table of the tests of all ``models`` (name -> tests)."""
    head = ["tested", "number", "limit", *(f"{word}{name}" for name in models for word in ("", "passes, "))]
    by_test: dict[tuple[str, ...], dict[str, ModelTest]] = {}
    for name, tests in models.items():
        for t in tests:
            by_test.setdefault((t.subject, t.statistic, _limit(t)), {})[name] = t
    rows = [[*test, *(cell for name in models for cell in _outcome(results.get(name)))] for test, results in by_test.items()]
    return table(head, rows, left=3)


def _limit(t: ModelTest) -> str:
    return f"{'at least' if t.limit_is_lower else 'at most'} {number(t.limit)}"


def _outcome(t: ModelTest | None) -> tuple[str, str]:
    return (GAP, GAP) if t is None else (number(t.value), "yes" if t.passes else "no")
