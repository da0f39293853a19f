"""Measure a sample of the engine study again, and check whether its stored numbers are reproduced.

`python -m research.study_sample --count 5 --seed 1` draws runs from data/engine_study.json: variants' own settings, and
rungs of ladders, defaults and choices of the adapters. It makes them again and prints stored and measured errors side by side.
Exit status 1: one of them differs by more than `SAME`.
"""

import argparse
import random
import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace

from looping_pendulum.compare.align import align
from looping_pendulum.compare.convergence.result import PATH_END_TIMES, RunSummary, VariantStudy
from looping_pendulum.compare.metrics import rms_until
from looping_pendulum.engines.isolation import run_isolated
from looping_pendulum.engines.protocol import Engine, Profile
from looping_pendulum.engines.reference import Reference
from looping_pendulum.engines.registry import select
from looping_pendulum.pages.markdown import table
from looping_pendulum.pages.numbers import number
from looping_pendulum.scenarios import load
from research.engine_study import SCENARIO
from research.stored_study import SUMMARY, EngineStudy, read

SAME = 0.01
"""Relative difference up to which two errors count as the same: six digits are stored, other processors round otherwise."""
FLOOR = 1e-9
"""Difference of errors that is ignored [m]: a nanometre."""


@dataclass(frozen=True, kw_only=True)
class StoredRun:
    """A run of the study, and the engine that makes it again."""

    name: str
    engine: Engine
    summary: RunSummary


def stored_runs(study: EngineStudy, budget: float) -> list[StoredRun]:
    """Return runs that ended properly and are known to take less than ``budget`` wall seconds per simulated second."""
    costs = {point.key: point.wall for point in study.pareto}
    runs = []
    for variant in study.convergence.variants:
        (engine,) = select([variant.label], Profile.QUICK)
        own = costs.get(variant.own.key)
        for run in _runs(variant, engine):
            cost = costs.get(run.summary.key, own)
            if run.summary.ok and cost is not None and cost < budget:
                runs.append(run)
    return runs


def _runs(variant: VariantStudy, engine: Engine) -> Iterator[StoredRun]:
    """Yield the stored runs of one variant that its present studies still have."""
    studies = engine.studies()
    yield StoredRun(name=f"{variant.label}, its own settings", engine=engine, summary=variant.own)
    made = {
        (ladder.setting, value): engine.with_settings(**changes)
        for ladder in studies.ladders
        for value, changes in zip(ladder.values, ladder.changes, strict=True)
    }
    for ladder in variant.ladders:
        for rung in ladder.rungs:
            again = next((e for (s, v), e in made.items() if s == ladder.setting and abs(v - rung.value) <= 1e-5 * v), None)
            if again is not None:
                yield StoredRun(name=f"{variant.label}, {ladder.setting} {rung.value:g}", engine=again, summary=rung.run)
    others = {(v.what, v.other): engine.with_settings(**v.changes) for v in (*studies.choices, *studies.defaults)}
    for row in (*variant.choices, *variant.defaults):
        if (row.what, row.other) in others:
            yield StoredRun(
                name=f"{variant.label}, {row.what}: {row.other}", engine=others[row.what, row.other], summary=row.run
            )


def measured_again(run: StoredRun, reference: Reference) -> dict[str, float | None]:
    """Make ``run`` again and return its errors."""
    scenario = replace(load(SCENARIO), duration=max(PATH_END_TIMES.values()), tolerances=())
    aligned = align(run_isolated(run.engine, scenario), reference)
    return {name: rms_until(aligned, mark) for name, mark in PATH_END_TIMES.items()}


def same(stored: float | None, again: float | None) -> bool:
    """Return whether two errors are equal to within `SAME` and `FLOOR`."""
    if stored is None or again is None:
        return stored is again
    return abs(stored - again) <= SAME * max(stored, again) + FLOOR


def main() -> None:
    """Draw, measure, compare."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=5, help="how many runs")
    parser.add_argument("--seed", type=int, default=0, help="which ones")
    parser.add_argument("--only", help="variant, such as mujoco:beads")
    parser.add_argument("--budget", type=float, default=20.0, help="leave out runs slower than this [wall s per s]")
    options = parser.parse_args()
    study = read(SUMMARY.read_text(encoding="utf-8"))
    runs = [r for r in stored_runs(study, options.budget) if options.only is None or r.name.startswith(f"{options.only},")]
    reference = Reference(load(SCENARIO))
    rows, reproduced = [], True
    for run in random.Random(options.seed).sample(runs, min(options.count, len(runs))):
        again = measured_again(run, reference)
        for name in PATH_END_TIMES:
            stored = run.summary.errors[name]
            equal = same(stored, again[name])
            reproduced &= equal
            rows.append([run.name, name, *(_mm(value) for value in (stored, again[name])), "yes" if equal else "no"])
    print(table(["run", "what", "stored [mm]", "measured again [mm]", "the same"], rows, left=2))
    sys.exit(0 if reproduced and rows else 1)


def _mm(value: float | None) -> str:
    return "-" if value is None else number(1e3 * value)


if __name__ == "__main__":
    main()
