"""Measure what docs/accuracy.md says: what the engines' errors are made of, how they converge, what they cost.

`python -m research.engine_study --work DIR` makes all runs (hours; ended ones are kept in DIR), stores what they found as
research/data/engine_study.json, draws the page's figures and writes all tables into DIR/tables. With `--engine box2d:chain`,
which may be repeated, it makes only that variant's runs, and the others' stored rows stay. `--tables` makes no run.
"""

import argparse
import dataclasses
import datetime
import json
import pickle
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from pathlib import Path

from looping_pendulum.cli.terminal import ProgressBars
from looping_pendulum.compare.convergence.result import ConvergenceResult, VariantStudy
from looping_pendulum.compare.convergence.study import plan_variant, study_convergence, write
from looping_pendulum.engines.protocol import Engine, Profile
from looping_pendulum.engines.registry import missing_packages, select
from looping_pendulum.files import write_atomically
from looping_pendulum.pages.drawing import png
from looping_pendulum.scenarios import load
from looping_pendulum.scenarios.scenario import Scenario
from research import IMAGES
from research.engine_study_figures import ladders_figure, pareto_figure, speed_table
from research.stored_study import MARK, SUMMARY, EngineStudy, Measurement, Point, read, renewed, supplied_by_engine

SCENARIO = "ten_to_one"
WARM_UP = 5e-3
"""Simulated time of a first run that is not timed [s], so that imports and caches do not count."""
REPEATS, TIME_BUDGET = 3, 60.0
"""Timed runs of one rung, and wall time [s] after which no further one is begun."""


def main() -> None:
    """Make the runs, and write figures and tables, or only write these."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--work", type=Path, default=Path("runs"), help="folder where runs are kept and tables written")
    parser.add_argument("--tables", action="store_true", help="only write figures and tables again, from the stored numbers")
    parser.add_argument("--time-limit", type=float, default=300.0, help="of each run [s]; leaves out finer rungs, too")
    parser.add_argument("--timing-budget", type=float, default=120.0, help="time only runs that took at most this [s]")
    parser.add_argument("--jobs", type=int, help="error runs at once; timed ones always run alone")
    parser.add_argument("--engine", "-e", action="append", help="add or renew only this engine or variant")
    parser.add_argument("--one", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.one is not None:
        print(json.dumps(one(options.one)))
        return
    if not options.tables:
        engines = select(options.engine or ["reference", "all"], Profile.QUICK)
        missing = sorted({package for engine in engines for package in missing_packages(engine)})
        if missing:
            parser.error(f"needed {', '.join(missing)}, which this Python has not: its rows would be empty")
        with ProgressBars(time_left=True) as bars:
            result = study_convergence(
                load(SCENARIO),
                engines,
                options.work,
                jobs=options.jobs,
                time_limit=options.time_limit,
                progress=bars.update,
            )
        write(result, options.work)
        if result.interrupted:
            sys.exit(130)
        new = timed_study(result, options.work / "pareto.json", options.timing_budget)
        if options.engine:
            try:
                new = renewed(read(SUMMARY.read_text(encoding="utf-8")), new)
            except ValueError as error:
                parser.error(str(error))
        write_atomically(SUMMARY, new.to_json())
    study = read(SUMMARY.read_text(encoding="utf-8"))
    write_atomically(IMAGES / "pareto.png", png(pareto_figure(study.pareto)))
    write_atomically(IMAGES / "engine_study_ladders.png", png(ladders_figure(study.convergence)))
    tables = options.work / "tables"
    write(study.convergence, tables)
    write_atomically(tables / "speed.md", speed_table(study))
    print(f"wrote tables into {tables}")


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


def points(study: ConvergenceResult, budget: float, known: Mapping[str, Point] | None = None) -> Iterator[Point]:
    """Time every rung that has an error at 0.7 s and took at most ``budget`` [s] in the study; not again what is ``known``."""
    scenario = dataclasses.replace(load(study.scenario), duration=study.until)
    for v in study.variants:
        engine = select([v.label], Profile(v.profile))[0]
        runs = plan_variant(engine, scenario, ())
        engines = {task.key: task.engine for task in runs.tasks()}
        for where, key, rms in rungs(v):
            if known and key in known:
                yield known[key]
            elif key in engines and (study.clock.run_times.get(key) or 0.0) <= budget:
                wall, cpu = timed(engines[key], scenario)
                times = {"wall": statistics.median(wall), "cpu": statistics.median(cpu), "slowest": max(wall)}
                print(
                    f"{v.label} {where or '(own)'}: {1e3 * rms:.3g} mm, {times['cpu']:.3g} CPU s per s",
                    file=sys.stderr,
                    flush=True,
                )
                contact = supplied_by_engine(v)
                yield Point(variant=v.label, where=where, key=key, contact=contact, rms=rms, runs=len(wall), **times)


def rungs(v: VariantStudy) -> list[tuple[str, str, float]]:
    """Return (setting and value, key, error) of the variant's own run and of each of its rungs, each run once."""
    every = [("", v.own), *((f"{ladder.setting} {r.value:g}", r.run) for ladder in v.ladders for r in ladder.rungs)]
    rungs_by_key: dict[str, tuple[str, str, float]] = {}
    for where, run in every:
        rms = run.errors[MARK]
        if run.ok and rms is not None:
            rungs_by_key.setdefault(run.key, (where, run.key, rms))
    return list(rungs_by_key.values())


def timed(engine: Engine, scenario: Scenario) -> tuple[list[float], list[float]]:
    """Return wall and CPU seconds per simulated second of a few runs, each in a process of its own, one after the other."""
    wall: list[float] = []
    cpu: list[float] = []
    with tempfile.TemporaryDirectory() as folder:
        job = Path(folder) / "job.pickle"
        job.write_bytes(pickle.dumps((engine, scenario)))
        began = time.perf_counter()
        while len(wall) < REPEATS and (not wall or time.perf_counter() - began < TIME_BUDGET):
            command = [sys.executable, "-m", "research.engine_study", "--one", str(job)]
            done = subprocess.run(command, check=True, capture_output=True, text=True)
            seconds = json.loads(done.stdout.splitlines()[-1])
            wall.append(seconds["wall"])
            cpu.append(seconds["cpu"])
    return wall, cpu


def one(job: Path) -> dict[str, float]:
    """Return wall and CPU seconds per simulated second of one run after a warm-up, including building the apparatus."""
    engine, scenario = pickle.loads(job.read_bytes())
    engine.simulate(dataclasses.replace(scenario, duration=WARM_UP))
    wall, cpu = time.perf_counter(), time.process_time()
    run = engine.simulate(scenario)
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    simulated = float(run.t[-1])
    return {"wall": wall / simulated, "cpu": cpu / simulated}


if __name__ == "__main__":
    main()
