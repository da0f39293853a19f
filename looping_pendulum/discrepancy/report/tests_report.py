"""Report the numbers behind the verdict: every test of the declared and of the repaired model, and those that others failed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from looping_pendulum.compare.tables import GAP, number, signed, table
from looping_pendulum.discrepancy.fit.model_test import ModelTest
from looping_pendulum.discrepancy.listed.attribution import MIN_DELTA_BIC
from looping_pendulum.discrepancy.listed.round_record import MIN_DELTA_BIC_MARGIN
from looping_pendulum.discrepancy.report import unlisted_report
from looping_pendulum.discrepancy.report.lead_figure import has_repair
from looping_pendulum.discrepancy.result import Identification, Round


def section(result: Identification) -> str:
    """Return the section on tests."""
    models = {"declared model": result.before.tests}
    if has_repair(result):
        models["repaired model"] = result.after.tests
    force = [unlisted_report.tests(result.unlisted)] if result.unlisted else []
    parts = [_tests(models), *force, *(_candidates(r, i) for i, r in enumerate(result.rounds, start=1))]
    note = (
        "The numbers behind the words above. A model passes if all its tests do: the size of the residuals, their pattern in "
        "every part of the motion, the held-out data, and whether the residuals look like an effect that is not in the model. "
        f"A candidate also needs a delta BIC of at least {MIN_DELTA_BIC:g}, within {MIN_DELTA_BIC_MARGIN:g} of the best.\n\n"
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


def _candidates(r: Round, index: int) -> str:
    head = ["candidate", "score z", "delta BIC", "value [SI]", "+/-", "held-out chi2/n"]
    rows = [
        [c.name, signed(c.score), number(c.delta_bic), number(c.value, digits=4), number(c.error, digits=2),
         number(c.held_out_chi2)]
        for c in r.ranking
    ]  # fmt: skip
    failed = [[c.name, t.subject, t.statistic, _limit(t), number(t.value)] for c in r.ranking for t in c.tests if not t.passes]
    text = f"### Candidates of round {index}\n\n{table(head, rows) if rows else GAP}"
    if r.margin is not None:
        text += f"\nBest: {r.best}; runner-up: {r.runner_up}, with a delta BIC {r.margin:.1f} lower.\n"
    if failed:
        head = ["model with", "tested", "number", "limit", "value"]
        text += "\nTests that the models with these candidates fail:\n\n" + table(head, failed, left=4)
    return text
