"""Write docs/engine-study.md and its tables: what the engines' errors are made of, how they converge, what they cost.

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

from benchmarks import ladders_figure, pareto
from benchmarks.engine_study_page import data_files, page
from benchmarks.pareto import Point, points
from benchmarks.stored_study import DOCS, SUMMARY, EngineStudy, Measurement, read, renewed
from looping_pendulum.cli.terminal import convergence_bars
from looping_pendulum.compare.convergence.result import ConvergenceResult
from looping_pendulum.compare.convergence.study import study_convergence, write
from looping_pendulum.compare.export import write_atomically
from looping_pendulum.compare.plots import png
from looping_pendulum.engines.protocol import Profile
from looping_pendulum.engines.registry import missing_packages, select
from looping_pendulum.scenarios import load

PAGE = DOCS / "engine-study.md"
TABLES = DOCS / "data" / "engine_study"
SCENARIO = "ten_to_one"


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
    write_atomically(DOCS / "img" / "pareto.png", png(pareto.figure(list(study.pareto))))
    write_atomically(DOCS / "img" / "engine_study_ladders.png", png(ladders_figure.figure(study.convergence)))
    TABLES.mkdir(exist_ok=True)
    for name, text in data_files(study).items():
        write_atomically(TABLES / f"{name}.csv", text)
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
