"""Make a sample of the engine study's runs again: `python -m benchmarks.study_again --count 10 --seed 1`.

The runs are drawn from docs/data/engine_study.json, at any setting of any variant; each distance from the truth is held against
the stored one. Exit status 1 says that one differs: an adapter, an engine's version or the machine is not what it was then, and
`python -m benchmarks.engine_study` has to be run again.
"""

from __future__ import annotations

import argparse
import dataclasses
import random
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from benchmarks.engine_study import SCENARIO, SUMMARY, Study, read
from looping_pendulum.compare.convergence.result import MARKS, RunSummary, VariantStudy
from looping_pendulum.compare.convergence.study import Task, plan
from looping_pendulum.compare.tables import table
from looping_pendulum.engines.isolation import run_isolated
from looping_pendulum.engines.protocol import Profile
from looping_pendulum.engines.registry import missing_packages, select
from looping_pendulum.pages.numbers import amount
from looping_pendulum.scenarios import load
from looping_pendulum.scenarios.scenario import Scenario
from scripts.measurements.reference import rms

SAME = 1e-3
"""Share by which a distance may differ: the study keeps six digits, and chains of contacts repeat them on one machine."""
FLOOR = 1e-11
"""Distance [m] below which both are rounding."""


@dataclass(frozen=True)
class Again:
    """One run of the study, made again."""

    where: str
    stored: dict[str, float | None]
    measured: dict[str, float | None]

    @property
    def same(self) -> bool:
        """Whether every distance is the stored one."""
        return all(_same(self.stored[mark], self.measured[mark]) for mark in MARKS)


def _same(stored: float | None, measured: float | None) -> bool:
    if stored is None or measured is None:
        return stored is measured
    return abs(stored - measured) <= max(SAME * stored, FLOOR)


Drawn = tuple[str, Task, RunSummary]
"""Where a run stands, as it is planned today, and what the study keeps of it."""


def candidates(study: Study, names: Sequence[str], budget: float) -> list[Drawn]:
    """Runs of the study that ended properly, took at most ``budget`` [s] and can be made here."""
    result = study.convergence
    scenario = dataclasses.replace(load(result.scenario), duration=result.until)
    took = {run.key: run.seconds for run in result.clock.run_times}
    found = []
    for v in result.variants:
        if names and v.label not in names and v.label.partition(":")[0] not in names:
            continue
        (engine,) = select([v.label], Profile(v.profile))
        if not missing_packages(engine):
            found += [drawn for drawn in _pairs(v, scenario) if drawn[2].ok and (took.get(drawn[2].key) or 0.0) <= budget]
    return found


def _pairs(v: VariantStudy, scenario: Scenario) -> Iterator[Drawn]:
    """Runs of a variant as they are planned today, each with the stored one at the same place."""
    (engine,) = select([v.label], Profile(v.profile))
    today = plan(engine, scenario, ())
    yield v.label, today.own, v.own
    stored = {(ladder.setting, rung.value): rung.run for ladder in v.ladders for rung in ladder.rungs}
    for ladder, tasks in today.ladders:
        for value, task in zip(ladder.values, tasks, strict=True):
            if run := stored.get((ladder.setting, float(f"{value:.6g}"))):
                yield f"{v.label}, {ladder.setting} {amount(float(value))}", task, run
    varied = {one.what: one.run for one in (*v.choices, *v.defaults)}
    for what, task in [(c.what, t) for c, t in today.choices] + [(d.setting, t) for d, t in today.defaults]:
        if run := varied.get(what):
            yield f"{v.label}, {what}", task, run


def again(drawn: Drawn) -> Again:
    """Make one run again."""
    where, task, stored = drawn
    run = run_isolated(task.engine, task.scenario)
    measured = {mark: rms(run.t, run.light_position, task.scenario.parameters, until) for mark, until in MARKS.items()}
    return Again(where=where, stored=stored.rms, measured=measured)


def main() -> None:
    """Draw runs, make them again and print both distances."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=10, help="runs to make again")
    parser.add_argument("--seed", type=int, default=0, help="of the draw")
    parser.add_argument("--budget", type=float, default=60.0, help="draw only from runs that took at most this [s]")
    parser.add_argument("--engine", "-e", action="append", default=[], help="only of this engine or variant")
    options = parser.parse_args()
    study = read(SUMMARY.read_text(encoding="utf-8"))
    known = candidates(study, options.engine, options.budget)
    sample = random.Random(options.seed).sample(known, min(options.count, len(known)))
    if not sample:
        parser.error("found no run of the study to make again: raise --budget, or name an engine that is installed")
    rows = []
    for drawn in sample:
        one = again(drawn)
        cells = [amount(x, 1e3, 4) for mark in MARKS for x in (one.stored[mark], one.measured[mark])]
        rows.append([one.where, *cells, "yes" if one.same else "no"])
        print(one.where, *cells, "same" if one.same else "differs", file=sys.stderr, flush=True)
    head = ["run", *(f"{mark.removeprefix('path_')}, {what} [mm]" for mark in MARKS for what in ("stored", "now")), "same"]
    print(f"{len(rows)} of the {len(known)} runs of {SCENARIO}, seed {options.seed}\n\n{table(head, rows)}")
    sys.exit(0 if all(row[-1] == "yes" for row in rows) else 1)


if __name__ == "__main__":
    main()
