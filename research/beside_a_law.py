"""Say why an effect beside an unlisted law was not named: `python -m research.beside_a_law`.

Of each study that shows both (data/calibration.json) and is judged otherwise, the table says by how many nats the right
explanation is less probable than the one that wins: at most, by the linear model that proposed it, as the search fitted it, and
fitted from the planted value of the effect, as nobody who searches could.
"""

import argparse
import json
import math
import tempfile
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from scipy.linalg import block_diag
from threadpoolctl import threadpool_limits

import looping_pendulum as lp
from looping_pendulum.discrepancy.evidence.explain import explain
from looping_pendulum.discrepancy.evidence.explanation import (
    Addition,
    Explanation,
    Parts,
    explained,
    fit_addition,
    raw,
    with_best_prior,
)
from looping_pendulum.discrepancy.evidence.laws import body_of, laws_beside
from looping_pendulum.discrepancy.evidence.search import NOTHING, Search, in_words
from looping_pendulum.discrepancy.fit.calibration import minimise
from looping_pendulum.discrepancy.fit.problem import Problem
from looping_pendulum.discrepancy.inputs import read_inputs
from looping_pendulum.pages.markdown import table
from research.calibration import RESULT
from research.calibration_summary import NAMED
from research.known_answer import SHOWN, planted_companions, planted_parameters
from tests.discrepancy.blind_sample import COUNTS, BlindStudy, draw, planted_values, write_files
from tests.discrepancy.expected import Explained, parts_of, truth

HEADERS = ("study", "hidden", "odds by the known formula", "what wins", "proposed", "fitted", "from the planted value")
HELD = 1e-3
"""Prior standard deviation that holds an effect at its planted value [that value]."""


def from_planted_value(search: Search, study: BlindStudy) -> list[Explanation]:
    """Return the explanations with what is hidden, fitted from where the effect has its planted value."""
    effects, law_acts_on = truth(study.hidden)
    base, planted = search.fitted[NOTHING].fit, planted_values(study)
    chosen = tuple(c for c in search.library if c.name in effects)
    added, start = planted_parameters(chosen, planted, planted_companions(study))
    p = base.problem

    def problem(sigma: Sequence[float], mean: Sequence[float]) -> Problem:
        root = block_diag(p.prior_weights, np.diag(1 / np.array(sigma)))
        return Problem(p.study, p.data, (*p.free_parameters, *added), (np.append(p.prior_mean, mean), root))

    held = minimise(problem([HELD] * len(added), start), np.append(base.x, start))
    beside = minimise(problem([n.prior_sigma for n in added], [0.0] * len(added)), held.x, max_iterations=1)
    parent = explained(search.grid, beside, Parts(effects=chosen), len(search.library))
    laws = laws_beside(beside, search.grid, 0, raw(beside))
    found = []
    for law in laws.all() if laws else ():
        if (body_of(law.closure.target), law.closure.coordinate) == law_acts_on:
            addition = Addition(
                parent=parent, law=law, step=law.step, gain=law.log_bayes_factor, decrease=law.decrease,
                library=len(search.library),
            )  # fmt: skip
            if fit := fit_addition(addition):
                fitted = with_best_prior(fit, addition.parts)
                found.append(explained(search.grid, *fitted, len(search.library)))
    return found


def behind(found: Iterable[Explanation], best: Explanation) -> str:
    """Return by how many nats the most probable of some explanations is behind the best."""
    logs = [(e.log_posterior, e.fit.converged) for e in found]
    if not logs:
        return "no"
    log_posterior, converged = max(logs)
    return f"{log_posterior - best.log_posterior:+.1f}{'' if converged else ', not converged'}"


def row_of(study: BlindStudy, log10_odds: float) -> list[str]:
    """Search in a study, and return its row of the table."""
    right = truth(study.hidden)
    with tempfile.TemporaryDirectory() as folder, threadpool_limits(1, user_api="blas"):
        inputs = read_inputs(lp.load_study(write_files(study, Path(folder))))
        found, _ = explain(inputs)
        search, best = found.search, found.best
        fitted = [e for e in search.fitted.values() if parts_of(e.parts) == right]
        proposed = [most for key, (_, most) in search.proposed.items() if right[0] < key and _has_law(key, right)]
        return [
            study.name,
            " + ".join(study.hidden),
            f"10^{log10_odds:.1f}",
            in_words(best.key),
            "yes" if fitted else f"{max(proposed) - best.log_posterior:+.1f}" if proposed else "no",
            behind(fitted, best),
            behind(from_planted_value(search, study), best),
        ]


def _has_law(key: Iterable[str], right: Explained) -> bool:
    assert right[1] is not None
    body, coordinate = right[1]
    return any(name.startswith(f"law: {body}") and f" by {coordinate}" in name for name in key)


def main() -> None:
    """Print the table."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    stored = json.loads(RESULT.read_text(encoding="utf-8"))
    studies = {s.name: s for kind in ("mixed", "three_masses") for s in draw(kind, COUNTS[kind], stored["seed"])}
    rows = []
    for one in stored["each"]:
        study, odds = studies.get(one["name"]), one["log10_odds"]
        shown = odds is not None and odds * math.log(10) >= SHOWN
        if study and len(study.hidden) > 1 and shown and one["judgement"] not in NAMED:
            rows.append(row_of(study, odds))
            print(table(HEADERS, rows[-1:]).splitlines()[-1], flush=True)
    print(f"\n{table(HEADERS, rows)}")


if __name__ == "__main__":
    main()
