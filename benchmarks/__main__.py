"""Time what users wait for, against what they would use instead, in one run: `python -m benchmarks`.

Prints a Markdown table. Ratios are between medians of interleaved repetitions, so that a machine that slows down slows both.
"""

from __future__ import annotations

import argparse
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable

import numpy as np

from benchmarks import (
    calibration,
    engine_overhead,
    identify,
    known_answer,
    live,
    live_page,
    outlier_power,
    pages,
    rivals,
)
from benchmarks.plain_scipy import plain_run
from benchmarks.rival_methods import METHODS
from looping_pendulum.engines.protocol import Profile
from looping_pendulum.measured.measurement import FIT_TOLERANCE
from looping_pendulum.reference_ode.batch import sample_batch
from looping_pendulum.reference_ode.solve import available_integrators, solve_at
from looping_pendulum.scenarios import load

TEN_TO_ONE = load("ten_to_one").parameters


def interleaved(tasks: dict[str, Callable[[], object]], repeats: int) -> dict[str, float]:
    """Median seconds of each task, taken in turn after a warm-up."""
    times: dict[str, list[float]] = {name: [] for name in tasks}
    for task in tasks.values():
        task()
    for _ in range(repeats):
        for name, task in tasks.items():
            inner = 20 if name.startswith("heyoka") else 1
            started = time.perf_counter()
            for _ in range(inner):
                task()
            times[name].append((time.perf_counter() - started) / inner)
    return {name: statistics.median(values) for name, values in times.items()}


def reference(repeats: int) -> None:
    """One run of the reference, sampled at 1 kHz, positions of both masses."""
    t = np.arange(0.0, 1.2, 1e-3)

    def ours(integrator: str, tolerance: float) -> Callable[[], object]:
        def task() -> object:
            samples = solve_at(TEN_TO_ONE, t, tolerance=tolerance, integrator=integrator)
            return samples.light_position, samples.heavy_position

        return task

    tasks: dict[str, Callable[[], object]] = {
        "SciPy DOP853, 1e-9, our driver": ours("scipy", 1e-9),
        "SciPy solve_ivp DOP853, 1e-9, plain script": lambda: plain_run(TEN_TO_ONE, t),
    }
    if "heyoka" in available_integrators():
        tasks = {"heyoka, 1e-12": ours("heyoka", 1e-12), "heyoka, 1e-9": ours("heyoka", 1e-9)} | tasks
    medians = interleaved(tasks, repeats)
    fastest = next(iter(medians.values()))
    print("\n## One reference run of ten_to_one, sampled at 1 kHz, warm\n")
    print("| integrator | median [ms] | times the first |\n|---|---|---|")
    for name, seconds in medians.items():
        print(f"| {name} | {1e3 * seconds:.3f} | {seconds / fastest:.1f} |")
    ratio = medians["SciPy DOP853, 1e-9, our driver"] / fastest
    verdict = {True: "met", False: "not met"}
    print(f"\nTarget under 1 ms: {verdict[fastest < 1e-3]}.")
    print(f"Target 100 times SciPy at 1e-9: {verdict[ratio >= 100]} ({ratio:.0f}).")


def batches(repeats: int) -> None:
    """Runs with the samples of a film, singly and in batches of several sizes; CPU time, the least of all repetitions."""
    t = np.arange(280) / 240.0

    def least(task: Callable[[], object]) -> float:
        task()
        seconds = []
        for _ in range(repeats):
            started = time.process_time()
            task()
            seconds.append(time.process_time() - started)
        return min(seconds)

    def many(n: int) -> Callable[[], object]:
        columns = {"kinetic_friction": TEN_TO_ONE.coefficients["kinetic_friction"] * np.linspace(0.99, 1.01, n)}
        return lambda: sample_batch(TEN_TO_ONE, columns, [t] * n, duration=1.2, tolerance=FIT_TOLERANCE)

    single = least(lambda: [solve_at(TEN_TO_ONE, t, duration=1.2, tolerance=FIT_TOLERANCE) for _ in range(20)]) / 20
    print(f"\n## Runs of ten_to_one with 280 samples, at {FIT_TOLERANCE:g}, warm\n")
    print("| runs in a batch | CPU time of one [us] | of a single run |\n|---|---|---|")
    print(f"| single | {1e6 * single:.0f} | 1 |")
    for n in (8, 30, 75, 300, 1000):
        one = least(many(n)) / n
        print(f"| {n} | {1e6 * one:.0f} | {one / single:.2f} |", flush=True)


def command_line(repeats: int) -> None:
    """How long `--help` takes."""
    command = [sys.executable, "-m", "looping_pendulum", "--help"]
    seconds = interleaved({"help": lambda: subprocess.run(command, check=True, capture_output=True)}, repeats)["help"]
    print(f"\n## Command line\n\n`--help`: {seconds:.2f} s")


def quick_comparison() -> None:
    """How long the main job takes."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "looping_pendulum", "compare", "ten_to_one", "--profile", "quick", "--out", folder]
        started = time.perf_counter()
        done = subprocess.run(command, capture_output=True, text=True)
        seconds = time.perf_counter() - started
    print(f"\n## `compare ten_to_one --profile quick`, all engines\n\n{seconds:.1f} s (exit status {done.returncode})")
    print("\n```text\n" + done.stderr.strip() + "\n```")


def main() -> None:
    """Run the benchmarks that were asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--only",
        choices=[
            "reference",
            "batches",
            "command-line",
            "comparison",
            "identify",
            "overhead",
            "pages",
            "live",
            "live-page",
            "maps",
            "calibration",
            "known-answer",
            "outliers",
            "rivals",
        ],
        help="calibration, known-answer, outliers and rivals take hours, so they run only if they are named",
    )
    parser.add_argument("--runs", type=int, default=1_000_000, help="runs of the map in `--only maps`")
    parser.add_argument("--repeats", type=int, default=15)
    calibration.add_options(parser)
    parser.add_argument(
        "--method", action="append", choices=list(METHODS), help="in `--only rivals`, only this one; repeatable"
    )
    options = parser.parse_args()
    if options.only in (None, "reference"):
        reference(options.repeats)
    if options.only in (None, "batches"):
        batches(options.repeats)
    if options.only in (None, "command-line"):
        command_line(options.repeats)
    if options.only in (None, "comparison"):
        quick_comparison()
    if options.only in (None, "identify"):
        identify.benchmark()
    if options.only in (None, "overhead"):
        engine_overhead.benchmark(sorted(engine_overhead.BARE_LOOPS), Profile.QUICK)
    if options.only in (None, "maps"):
        from benchmarks import maps  # compiles, and needs numba

        maps.benchmark(min(options.repeats, 3), options.runs)
    if options.only in (None, "pages"):
        pages.benchmark()
    if options.only in (None, "live"):
        live.benchmark()
    if options.only in (None, "live-page"):
        live_page.benchmark()
    if options.only == "calibration":
        calibration.benchmark(options)
    if options.only == "known-answer":
        known_answer.benchmark(options)
    if options.only == "outliers":
        outlier_power.benchmark(options)
    if options.only == "rivals":
        rivals.benchmark(options)


if __name__ == "__main__":
    main()
