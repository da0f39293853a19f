"""Write docs/engine-study.md: what the engines' errors are made of, how they converge, what they cost.

`python -m benchmarks.engine_study --work DIR` makes all runs (hours; ended ones are kept in DIR), stores what they found as
docs/data/engine_study.json and writes the page from that. With `--engine box2d:chain`, which may be repeated, it makes only
that variant's runs, and the others' stored rows stay. `--page` writes the page again from the stored numbers alone.
"""

from __future__ import annotations

import argparse
import dataclasses
import datetime
import json
import sys
from pathlib import Path

from benchmarks import pareto
from benchmarks.pareto import PROTOTYPES, Point, figure, front, points
from benchmarks.stored_study import DOCS, SUMMARY, EngineStudy, Measurement, read, renewed
from looping_pendulum.cli.progress import convergence_bars
from looping_pendulum.compare.convergence import report
from looping_pendulum.compare.convergence.result import ConvergenceResult
from looping_pendulum.compare.convergence.study import study_convergence, write
from looping_pendulum.compare.export import write_atomically
from looping_pendulum.compare.plots import png
from looping_pendulum.compare.tables import GAP, number, table
from looping_pendulum.engines.protocol import Profile
from looping_pendulum.engines.registry import missing_packages, select
from looping_pendulum.scenarios import load

PAGE, FIGURE = DOCS / "engine-study.md", DOCS / "img" / "pareto.png"
COMMAND = "python -m benchmarks.engine_study"
SCENARIO = "ten_to_one"


def page(study: EngineStudy) -> str:
    """Return the page of Markdown."""
    result = study.convergence
    return f"""# What the engines' errors are made of

`{COMMAND}` writes this page from `docs/data/engine_study.json`; do not edit it by hand.
Variants are measured on days of their own, [with the versions of that day](#provenance).
`looping-pendulum converge {result.scenario} --engine NAME` writes the same report for one variant, with a figure for
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

{pareto_text(study)}
## Hidden defaults

Each row is a run in which only this setting differs from the variant's own settings.

{report.defaults_table(result)}
## The adapters' choices

{report.choices_table(result)}
## Provenance

{days_table(study)}
{report.provenance_table(result)}"""


def days_table(study: EngineStudy) -> str:
    """Return a table of the days on which each variant was measured, and of the engine's versions on that day."""
    versions = {v.label: v.provenance.versions for v in study.convergence.variants}
    rows = [
        [m.variant, ", ".join(f"{k} {x}" for k, x in versions[m.variant].items()) or GAP, m.errors, m.times or GAP]
        for m in study.measurements
    ]
    return table(["variant", "versions", "errors measured", "times measured"], rows, left=4)


def pareto_text(study: EngineStudy) -> str:
    """Return the tables of the points on the Pareto front, the variants' own points, and the prototypes."""
    timed_points = study.pareto
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
The slowest is in wall seconds. {timing_note(study)}

{table(head, rows, left=3)}
The prototypes that were written before the adapters, in haste and on a shared machine (times to a factor of two):

{old}"""


def timing_note(study: EngineStudy) -> str:
    """Say which settings were timed, and which times are older than the errors."""
    budgets = sorted({m.timing_budget for m in study.measurements if m.times})
    text = f"Only settings whose run took at most {' or '.join(f'{seconds:g}' for seconds in budgets)} s were timed."
    older = {m.times for m in study.measurements if m.times and m.times < m.errors}
    if older:
        text += f" Times of {' and '.join(sorted(older))} are [older than the errors](#provenance): of these, only settings\n"
        text += "are shown whose path is still the same to 1 %."
    return text


def main() -> None:
    """Make the runs and write the page, or only write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--work", type=Path, help="folder where runs are kept")
    parser.add_argument("--page", action="store_true", help="only write the page again from the stored numbers")
    parser.add_argument("--budget", type=float, default=300.0, help="leave out runs expected to take longer than this [s]")
    parser.add_argument("--timing-budget", type=float, default=120.0, help="time only runs that took at most this [s]")
    parser.add_argument("--jobs", type=int, help="error runs at once; timed ones always run alone")
    parser.add_argument("--engine", "-e", action="append", help="add or renew only this engine or variant")
    options = parser.parse_args()
    if not options.page:
        if options.work is None:
            parser.error("--work: needed a folder, or --page")
        engines = select(options.engine or ["reference", "all"], Profile.QUICK)
        missing = sorted({package for engine in engines for package in missing_packages(engine)})
        if missing:
            parser.error(f"needed {', '.join(missing)}, which this Python has not: its rows would be empty")
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
        new = timed_study(result, options.work / pareto.NAME, options.timing_budget)
        if options.engine:
            try:
                new = renewed(read(SUMMARY.read_text(encoding="utf-8")), new)
            except ValueError as error:
                parser.error(str(error))
        write_atomically(SUMMARY, new.to_json())
    study = read(SUMMARY.read_text(encoding="utf-8"))
    write_atomically(FIGURE, png(figure(list(study.pareto))))
    write_atomically(PAGE, page(study))
    print(f"wrote {PAGE}")


def timed_study(result: ConvergenceResult, file: Path, budget: float) -> EngineStudy:
    """Time the runs of ``result`` and return both, dated; points that ``file`` has are not timed again."""
    known = {p["key"]: Point(**p) for p in json.loads(file.read_text(encoding="utf-8"))} if file.exists() else {}
    timed_points: list[Point] = []
    for point in points(result, budget, known):
        timed_points.append(point)
        known[point.key] = point
        write_atomically(file, json.dumps([dataclasses.asdict(p) for p in known.values()], indent=1) + "\n")
    today = datetime.datetime.now(datetime.UTC).date().isoformat()
    timed_variants = {p.variant for p in timed_points}
    measurements = (
        Measurement(
            variant=v.label,
            errors=result.clock.written[: len(today)],
            times=today if v.label in timed_variants else "",
            timing_budget=budget,
        )
        for v in result.variants
    )
    return EngineStudy(convergence=result, pareto=tuple(timed_points), measurements=tuple(measurements))


if __name__ == "__main__":
    main()
