"""Speed against accuracy: CPU seconds per simulated second against the error at 0.7 s, for every rung of every ladder.

`python -m benchmarks.pareto --study DIR --out DIR` times the runs of a study that `looping-pendulum converge ... --out DIR`
made, one at a time and apart from it, and writes pareto.json and pareto.png. The errors are the study's.
Processor time is drawn, not wall time, because a neighbour on the machine hardly changes it.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import pickle
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from looping_pendulum.compare.convergence.result import FILE, ConvergenceResult, VariantStudy
from looping_pendulum.compare.convergence.study import plan_variant
from looping_pendulum.engines.protocol import Engine, Profile
from looping_pendulum.engines.registry import select
from looping_pendulum.files import write_atomically
from looping_pendulum.pages.drawing import legend_below, make_figure, png
from looping_pendulum.pages.palette import GREY, styles
from looping_pendulum.scenarios import load
from looping_pendulum.scenarios.scenario import Scenario

NAME = "pareto.json"
MARK = "path_0.7s"
WARM_UP = 5e-3
"""Simulated time of a first run that is not timed [s], so that imports and caches do not count."""
REPEATS, TIME_BUDGET = 3, 60.0
"""Timed runs of one rung, and wall time [s] after which no further one is begun."""
TARGET = 60.0
"""CPU seconds per simulated second that a chain may take: a run of 0.7 s then takes less than a minute."""


@dataclass(frozen=True, kw_only=True)
class Point:
    """A timed rung."""

    variant: str
    where: str
    """ "time_step 1e-05", or empty at the variant's own settings."""
    key: str
    contact: bool
    """Whether the engine itself supplies winding and friction law."""
    rms: float
    """Root mean square error to 0.7 s [m]."""
    wall: float
    """Median wall seconds per simulated second."""
    cpu: float
    """Median CPU seconds per simulated second."""
    runs: int
    slowest: float
    """Largest wall seconds per simulated second of the runs."""


def points(study: ConvergenceResult, budget: float, known: Mapping[str, Point] | None = None) -> Iterator[Point]:
    """Time every rung that has an error at 0.7 s and took at most ``budget`` [s] in the study; not again what is ``known``."""
    scenario = dataclasses.replace(load(study.scenario), duration=study.until)
    took = {one.key: one.seconds for one in study.clock.run_times}
    for v in study.variants:
        engine = select([v.label], Profile(v.profile))[0]
        runs = plan_variant(engine, scenario, ())
        engines = {task.key: task.engine for task in runs.tasks()}
        for where, key, rms in rungs(v):
            if known and key in known:
                yield known[key]
            elif key in engines and (took.get(key) or 0.0) <= budget:
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
        rms = run.rms[MARK]
        if run.ok and rms is not None:
            rungs_by_key.setdefault(run.key, (where, run.key, rms))
    return list(rungs_by_key.values())


def supplied_by_engine(v: VariantStudy) -> bool:
    """Return whether the engine itself supplies winding and friction law."""
    by = {s.what: s.by for s in v.provenance.supplies}
    return by["winding"] == by["friction law"] == "engine"


def timed(engine: Engine, scenario: Scenario) -> tuple[list[float], list[float]]:
    """Return wall and CPU seconds per simulated second of a few runs, each in a process of its own, one after the other."""
    wall: list[float] = []
    cpu: list[float] = []
    with tempfile.TemporaryDirectory() as folder:
        job = Path(folder) / "job.pickle"
        job.write_bytes(pickle.dumps((engine, scenario)))
        began = time.perf_counter()
        while len(wall) < REPEATS and (not wall or time.perf_counter() - began < TIME_BUDGET):
            command = [sys.executable, "-m", "benchmarks.pareto", "--one", str(job)]
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


def front(timed_points: Iterable[Point]) -> list[Point]:
    """Return the Pareto front of the engines' points in time and error, from fast to slow; the reference is left out."""
    engines = [p for p in timed_points if not p.variant.startswith("reference:")]
    best = [p for p in engines if not any(o is not p and o.cpu <= p.cpu and o.rms <= p.rms for o in engines)]
    return sorted(best, key=lambda p: p.cpu)


def figure(timed_points: list[Point]) -> Figure:
    """Draw error against time, log-log, with the Pareto fronts of all engines and of those that supply winding and friction."""
    picture, (axes,) = make_figure(8.4, 6.8)
    look = styles(p.variant for p in timed_points)
    for variant in dict.fromkeys(p.variant for p in timed_points):
        mine = [p for p in timed_points if p.variant == variant]
        style = look[variant]
        fill = style.colour if mine[0].contact else "white"
        xy = np.array([(p.cpu, 1e3 * p.rms) for p in mine]).T
        axes.plot(*xy, ls="none", marker=style.marker, ms=5.5, color=style.colour, mfc=fill, label=variant)
    for chosen, line, name in (
        (front(timed_points), "-", "no engine beats these"),
        (front(p for p in timed_points if p.contact), "--", "nor these, law its own"),
    ):
        axes.plot([p.cpu for p in chosen], [1e3 * p.rms for p in chosen], line, color="black", lw=1.0, zorder=1, label=name)
    axes.axvline(TARGET, color=GREY, lw=0.9, dashes=(1, 2), label=f"target {TARGET:g} s per s")
    axes.set(
        xscale="log", yscale="log", xlabel="CPU seconds per simulated second", ylabel="RMS to 0.7 s against the reference [mm]"
    )
    axes.set_title("Speed against accuracy; open marks: the adapter feeds a law in")
    legend_below(picture)
    return picture


def read_study(folder: Path) -> ConvergenceResult:
    """Read the study that `looping-pendulum converge` left in ``folder``."""
    return ConvergenceResult.from_json((folder / FILE).read_text(encoding="utf-8"))


def main() -> None:
    """Time a study's runs."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--study", type=Path, help="folder that `looping-pendulum converge` wrote")
    parser.add_argument("--out", type=Path, help="folder for pareto.json and pareto.png")
    parser.add_argument(
        "--budget", type=float, default=120.0, help="leave out runs that took longer than this in the study [s]"
    )
    parser.add_argument("--one", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.one is not None:
        print(json.dumps(one(options.one)))
        return
    if options.study is None or options.out is None:
        parser.error("--study and --out: needed both")
    timed_points = list(points(read_study(options.study), options.budget))
    write_atomically(options.out / NAME, json.dumps([dataclasses.asdict(p) for p in timed_points], indent=1) + "\n")
    write_atomically(options.out / "pareto.png", png(figure(timed_points)))


if __name__ == "__main__":
    main()
