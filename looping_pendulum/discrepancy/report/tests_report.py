"""Report the numbers behind the verdict: every test of the declared and of the repaired model, and those that others failed."""

from __future__ import annotations

from looping_pendulum.compare.tables import GAP, number, signed, table
from looping_pendulum.discrepancy.fit.model_test import ModelTest
from looping_pendulum.discrepancy.listed.round_record import MIN_DELTA_BIC, MIN_DELTA_BIC_MARGIN
from looping_pendulum.discrepancy.report.lead_figure import has_repair
from looping_pendulum.discrepancy.result import Identification, Round

HEAD = ["tested", "number", "value", "limit", "passed?"]


def section(result: Identification) -> str:
    """Return the section on tests."""
    parts = [f"### Declared model\n\n{_tests(result.before.tests)}"]
    if has_repair(result):
        parts.append(f"### Repaired model\n\n{_tests(result.after.tests)}")
    parts += [_candidates(r, i) for i, r in enumerate(result.rounds, start=1)]
    note = (
        "The numbers behind the words above. A model passes if all its tests do: the size of the residuals, their pattern in "
        "every part of the motion, the held-out data, and whether the residuals look like an effect that is not in the model. "
        f"A candidate also needs a delta BIC of at least {MIN_DELTA_BIC:g}, within {MIN_DELTA_BIC_MARGIN:g} of the best.\n\n"
    )
    return "## Tests\n\n" + note + "\n".join(parts)


def _tests(tests: tuple[ModelTest, ...]) -> str:
    if not tests:
        return "No test was made.\n"
    return table(HEAD, [_row(t) for t in tests], left=2)


def _row(t: ModelTest) -> list[str]:
    limit = f"{'at least' if t.limit_is_lower else 'at most'} {number(t.limit)}"
    return [t.subject, t.statistic, number(t.value), limit, "yes" if t.passes else "no"]


def _candidates(r: Round, index: int) -> str:
    head = ["candidate", "score z", "delta BIC", "value [SI]", "+/-", "held-out chi2/n"]
    rows = [
        [c.name, signed(c.score), number(c.delta_bic), number(c.value, digits=4), number(c.error, digits=2),
         number(c.held_out_chi2)]
        for c in r.ranking
    ]  # fmt: skip
    failed = [[c.name, *_row(t)[:4]] for c in r.ranking for t in c.tests if not t.passes]
    text = f"### Candidates of round {index}\n\n{table(head, rows) if rows else GAP}"
    if r.margin is not None:
        text += f"\nBest: {r.best}; runner-up: {r.runner_up}, with a delta BIC {r.margin:.1f} lower.\n"
    if failed:
        text += "\nTests that the models with these candidates failed:\n\n" + table(["candidate", *HEAD[:4]], failed, left=3)
    return text
