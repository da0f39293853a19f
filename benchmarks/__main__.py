"""Time what users wait for, in one run: `python -m benchmarks`. It prints Markdown tables."""

import argparse
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable

from benchmarks import browser, identify
from looping_pendulum.sweep import map_file


def million(repeats: int, runs: int) -> None:
    """The runs of a map of release angle and mass ratio, from a fresh start, on one thread and on two, in turn."""
    print(f"\n## {runs} runs of a map at {map_file.TOLERANCE:g}, from a fresh start\n")
    print("| threads | wall [s] | CPU [s] | CPU per run [us] | peak memory [MiB] |\n|---|---|---|---|---|")
    walls: dict[int, list[float]] = {1: [], 2: []}
    for _ in range(repeats):
        for threads, taken in walls.items():
            program = MAP.format(runs, threads, map_file.TOLERANCE)
            done = subprocess.run([sys.executable, "-c", program], check=True, capture_output=True, text=True)
            wall, cpu, memory = map(float, done.stdout.split())
            taken.append(wall)
            print(f"| {threads} | {wall:.1f} | {cpu:.1f} | {1e6 * cpu / runs:.1f} | {memory:.0f} |", flush=True)
    one, two = (statistics.median(taken) for taken in walls.values())
    print(f"\nTwo threads: {two:.1f} s, {one / two:.2f} times as fast as one.")


MAP = """
import resource, time
import numpy as np
from looping_pendulum.reference_ode.batch import solve_batch
from looping_pendulum.scenarios import load

base = load("ten_to_one").parameters
# A low-discrepancy sample of 60 to 130 degrees, and of M2/M1 from 1 to 12 (Roberts' R2 sequence)
first, second = ((0.5 + np.arange(1, {0} + 1) / 1.324717957244746**k) % 1 for k in (1, 2))
columns = dict(release_angle=np.radians(60 + 70 * first), heavy_mass=base.light_mass * (1 + 11 * second))
started = time.perf_counter()
solve_batch(base, columns, threads={1}, tolerance={2})
print(time.perf_counter() - started)
use = resource.getrusage(resource.RUSAGE_SELF)
print(use.ru_utime + use.ru_stime)
print(float(open('/proc/self/status').read().split('VmHWM:')[1].split()[0]) / 1024)  # ru_maxrss begins with the parent's
"""
"""Program that prints wall time [s], CPU time [s] and peak memory [MiB]; {0} runs, {1} threads, tolerance {2}."""


def command_line(repeats: int) -> None:
    """How long `--help` takes."""
    seconds = []
    for _ in range(repeats + 1):
        started = time.perf_counter()
        subprocess.run([sys.executable, "-m", "looping_pendulum", "--help"], check=True, capture_output=True)
        seconds.append(time.perf_counter() - started)
    print(f"\n## Command line\n\n`--help`: {statistics.median(seconds[1:]):.2f} s")  # the first fills the disk's cache


def quick_comparison() -> None:
    """How long the main job takes."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "looping_pendulum", "compare", "ten_to_one", "--profile", "quick", "--out", folder]
        started = time.perf_counter()
        done = subprocess.run(command, capture_output=True, text=True)
        seconds = time.perf_counter() - started
    print(f"\n## `compare ten_to_one --profile quick`, all engines\n\n{seconds:.1f} s (exit status {done.returncode})")
    print("\n```text\n" + done.stderr.strip() + "\n```")


BENCHMARKS: dict[str, Callable[[argparse.Namespace], None]] = {
    "command-line": lambda options: command_line(options.repeats),
    "comparison": lambda _: quick_comparison(),
    "identify": lambda _: identify.benchmark(),
    "maps": lambda options: million(min(options.repeats, 3), options.runs),
    "pages": lambda _: browser.demonstration(),
    "live-page": lambda _: browser.live_page(),
}


def main() -> None:
    """Run the benchmarks that were asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", choices=list(BENCHMARKS), help="by default all run")
    parser.add_argument("--runs", type=int, default=1_000_000, help="runs of the map in `--only maps`")
    parser.add_argument("--repeats", type=int, default=15)
    options = parser.parse_args()
    for name in [options.only] if options.only else BENCHMARKS:
        BENCHMARKS[name](options)


if __name__ == "__main__":
    main()
