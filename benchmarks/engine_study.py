"""Write docs/engine-study.md: what the engines' errors are made of, how they converge, what they cost.

`python -m benchmarks.engine_study --work DIR` makes all runs (hours; ended ones are kept in DIR), stores what they found as
docs/data/engine_study.json and writes the page from that. `--page` writes the page again from the stored numbers alone.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks import pareto
from benchmarks.pareto import PROTOTYPES, Point, figure, front, points
from looping_pendulum.cli.progress import convergence_bars
from looping_pendulum.compare.convergence import report
from looping_pendulum.compare.convergence.result import ConvergenceResult
from looping_pendulum.compare.convergence.study import study_convergence, write
from looping_pendulum.compare.export import write_atomically
from looping_pendulum.compare.plots import png
from looping_pendulum.compare.tables import number, table
from looping_pendulum.engines.protocol import Profile
from looping_pendulum.engines.registry import select
from looping_pendulum.scenarios import load

DOCS = Path(__file__).parents[1] / "docs"
SUMMARY, PAGE, FIGURE = DOCS / "data" / "engine_study.json", DOCS / "engine-study.md", DOCS / "img" / "pareto.png"
COMMAND = "python -m benchmarks.engine_study"
SCENARIO = "ten_to_one"


@dataclass(frozen=True, kw_only=True)
class EngineStudy:
    """The stored data that the page is written from."""

    convergence: ConvergenceResult
    pareto: tuple[Point, ...]
    timing_note: str = ""
    """What a reader must know of these times; empty: they were taken in one run with the errors."""

    def to_json(self) -> str:
        """Return the text of the stored data: one line per variant, ladder and timed point, to keep it small."""
        tree = {
            "schema": {"id": "looping-pendulum/engine-study", "version": 1},
            "convergence": json.loads(self.convergence.to_json()),
            "pareto": [dataclasses.asdict(p) for p in self.pareto],
            "timing_note": self.timing_note,
        }
        return json.dumps(rounded(tree), indent=None, separators=(",", ":")).replace('{"engine":', '\n{"engine":') + "\n"


def read(text: str) -> EngineStudy:
    """Read `EngineStudy.to_json`'s text back."""
    tree = json.loads(text)
    return EngineStudy(
        convergence=ConvergenceResult.from_json(json.dumps(tree["convergence"])),
        pareto=tuple(Point(**p) for p in tree["pareto"]),
        timing_note=tree.get("timing_note", ""),
    )


def rounded(tree: Any) -> Any:
    """Return ``tree`` with floats rounded to six significant digits, more than the page prints."""
    if isinstance(tree, dict):
        return {key: rounded(value) for key, value in tree.items()}
    if isinstance(tree, list):
        return [rounded(value) for value in tree]
    return float(f"{tree:.6g}") if isinstance(tree, float) else tree


def page(study: EngineStudy) -> str:
    """Return the page of Markdown."""
    result = study.convergence
    return f"""# What the engines' errors are made of

`{COMMAND}` writes this page from `docs/data/engine_study.json`, the stored numbers of one run of all studies; do not edit it
by hand. `looping-pendulum converge {result.scenario} --engine NAME` writes the same report for one variant, with a figure for
every setting. The [glossary](glossary.md) explains the terms.

{report.opening(result)}
{report.HOW_TO_READ}
## How each error splits into parts

{report.splits_table(result)}
## Does the halting time converge?

{report.halting_table(result)}
## Every ladder

{report.ladders_table(result)}
## Speed against accuracy

![CPU seconds per simulated second against the error at 0.7 s](img/pareto.png)

{pareto_text(study.pareto, study.timing_note)}
## Hidden defaults

Each row is a run in which only this setting differs from the variant's own settings.

{report.defaults_table(result)}
## The adapters' choices

{report.choices_table(result)}
## Provenance

{report.provenance_table(result)}"""


def pareto_text(timed_points: tuple[Point, ...], timing_note: str) -> str:
    """Return the tables of the points on the Pareto front, the variants' own points, and the prototypes."""
    best = {p.key for p in front(timed_points)}
    contact = {p.key for p in front(p for p in timed_points if p.contact)}
    head = ["variant", "setting", "what", "RMS to 0.7 s [mm]", "CPU s per s", "wall s per s", "runs", "slowest"]
    rows = []
    for p in sorted(timed_points, key=lambda p: (p.variant, p.cpu)):
        marks = [
            *(["no engine beats it"] if p.key in best else []),
            *(["no engine beats it where the law is its own"] if p.key in contact - best else []),
            *(["own settings"] if not p.where else []),
        ]
        if marks:
            times = [number(x, digits=2) for x in (p.cpu, p.wall)]
            rows.append(
                [
                    p.variant,
                    p.where or "its own",
                    ", ".join(marks),
                    number(1e3 * p.rms),
                    *times,
                    str(p.runs),
                    number(p.slowest, digits=2),
                ]
            )
    old = table(["prototype", "RMS to 0.7 s [mm]", "wall s per s"], [[w, number(e), number(t)] for w, e, t in PROTOTYPES])
    return f"""Timed apart from the error runs, one process at a time, building included and imports not; median of the runs.
The slowest is in wall seconds.{timing_note}

{table(head, rows, left=3)}
The prototypes that were written before the adapters, in haste and on a shared machine (times to a factor of two):

{old}"""


def main() -> None:
    """Make the runs and write the page, or only write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--work", type=Path, help="folder where runs are kept")
    parser.add_argument("--page", action="store_true", help="only write the page again from the stored numbers")
    parser.add_argument("--budget", type=float, default=300.0, help="leave out runs expected to take longer than this [s]")
    parser.add_argument("--timing-budget", type=float, default=120.0, help="time only runs that took at most this [s]")
    parser.add_argument("--jobs", type=int, help="error runs at once; timed ones always run alone")
    parser.add_argument("--engine", "-e", action="append", help="engine or variant; default: all, and the reference")
    options = parser.parse_args()
    if not options.page:
        if options.work is None:
            parser.error("--work: needed a folder, or --page")
        engines = select(options.engine or ["reference", "all"], Profile.QUICK)
        with convergence_bars() as bars:
            result = study_convergence(
                load(SCENARIO),
                engines,
                options.work,
                budget=options.budget,
                jobs=options.jobs,
                time_limit=3600.0,
                progress=lambda fraction, description: bars.update(description, fraction),
            )
        write(result, options.work)
        if result.interrupted:
            sys.exit(130)
        timed = kept_points(result, options.work / pareto.NAME, options.timing_budget)
        write_atomically(SUMMARY, EngineStudy(convergence=result, pareto=timed).to_json())
    study = read(SUMMARY.read_text(encoding="utf-8"))
    write_atomically(FIGURE, png(figure(list(study.pareto))))
    write_atomically(PAGE, page(study))
    print(f"wrote {PAGE}")


def kept_points(result: ConvergenceResult, file: Path, budget: float) -> tuple[Point, ...]:
    """Return the timed points of ``result``; points that ``file`` has are not timed again."""
    known = {p["key"]: Point(**p) for p in json.loads(file.read_text(encoding="utf-8"))} if file.exists() else {}
    timed_points: list[Point] = []
    for point in points(result, budget, known):
        timed_points.append(point)
        known[point.key] = point
        write_atomically(file, json.dumps([dataclasses.asdict(p) for p in known.values()], indent=1) + "\n")
    return tuple(timed_points)


if __name__ == "__main__":
    main()
