"""Time many runs of the reference at once, against what a user would write instead: `python -m benchmarks --only maps`.

The set is that of the maps: release angle 60 to 130 degrees, M2/M1 from 1 to 12, the apparatus of ten_to_one.
"""

from __future__ import annotations

import multiprocessing
import resource
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor

import numpy as np

from looping_pendulum.reference_ode.batch import BatchResult, solve_batch
from looping_pendulum.reference_ode.solve import DURATION, solve
from looping_pendulum.scenarios import load

BASE = load("ten_to_one").parameters
Columns = dict[str, np.ndarray]


def map_columns(n: int) -> Columns:
    """Return a low-discrepancy sample of the map (Roberts' R2 sequence)."""
    golden = 1.324717957244746
    first, second = ((0.5 + np.arange(1, n + 1) / golden**k) % 1 for k in (1, 2))
    return {"release_angle": np.radians(60 + 70 * first), "heavy_mass": BASE.light_mass * (1 + 11 * second)}


def part(columns: Columns, n: int) -> Columns:
    return {name: values[:n] for name, values in columns.items()}


def cpu_per_run(task: Callable[[], object], runs: int) -> float:
    """Return the CPU time per run [us]."""
    started = time.process_time()
    task()
    return 1e6 * (time.process_time() - started) / runs


def interleaved(tasks: dict[str, tuple[Callable[[], object], int]], repeats: int) -> dict[str, float]:
    """Return the median CPU time per run [us] of each task, taken in turn."""
    cpu_times: dict[str, list[float]] = {name: [] for name in tasks}
    for _ in range(repeats):
        for name, (task, runs) in tasks.items():
            cpu_times[name].append(cpu_per_run(task, runs))
    return {name: statistics.median(values) for name, values in cpu_times.items()}


def one_by_one(columns: Columns, runs: int, tolerance: float, integrator: str) -> tuple[np.ndarray, np.ndarray]:
    """Return halting and end times from single runs."""
    times = []
    for i in range(runs):
        values = {name: float(column[i]) for name, column in columns.items()}
        run = solve(BASE.replace(**values), tolerance=tolerance, integrator=integrator)
        times.append((np.nan if run.halting_time is None else run.halting_time, run.end_time))
    halting, end = np.array(times).T
    return halting, end


def error(actual: tuple[np.ndarray, np.ndarray], exact: tuple[np.ndarray, np.ndarray]) -> str:
    """Return median and 99th percentile of the error of a run's times [s]."""
    worst = np.fmax.reduce([np.abs(a[: len(b)] - b) for a, b in zip(actual, exact, strict=True)])
    return f"{np.median(worst):.0e}, {np.quantile(worst, 0.99):.0e}"


def peers(repeats: int, runs: int = 50_000, checked: int = 300, slow_runs: int = 40) -> None:
    """CPU time per run and accuracy, ours against others'."""
    from benchmarks.compiled_dop853 import solve_with_numba  # here, so that Numba is not in `wall_clock`'s memory

    columns = map_columns(runs)
    exact = one_by_one(columns, checked, 1e-15, "auto")
    few = part(columns, slow_runs)
    started = time.process_time()
    solve_batch(BASE, few)
    print(f"\n## Many runs at once, one core\n\nCompiling the steps, once per process: {time.process_time() - started:.1f} s\n")
    solve_with_numba(BASE, few, DURATION, 1e-9)

    def times(result: BatchResult) -> tuple[np.ndarray, np.ndarray]:
        return result.halting_time, result.end_time

    tasks: dict[str, tuple[Callable[[], object], int]] = {
        "solve_batch, 1e-12": (lambda: solve_batch(BASE, columns), runs),
        "Numba DOP853, 1e-12": (lambda: solve_with_numba(BASE, columns, DURATION, 1e-12), runs),
        "Numba DOP853, 1e-9": (lambda: solve_with_numba(BASE, columns, DURATION, 1e-9), runs),
        "single runs, 1e-12": (lambda: one_by_one(columns, 10 * slow_runs, 1e-12, "auto"), 10 * slow_runs),
        "SciPy DOP853, 1e-9": (lambda: one_by_one(columns, slow_runs, 1e-9, "scipy"), slow_runs),
    }
    errors = {
        "solve_batch, 1e-12": error(times(solve_batch(BASE, part(columns, checked))), exact),
        "Numba DOP853, 1e-12": error(solve_with_numba(BASE, part(columns, checked), DURATION, 1e-12)[:2], exact),
        "Numba DOP853, 1e-9": error(solve_with_numba(BASE, part(columns, checked), DURATION, 1e-9)[:2], exact),
        "single runs, 1e-12": error(one_by_one(columns, checked, 1e-12, "auto"), exact),
        "SciPy DOP853, 1e-9": error(one_by_one(columns, slow_runs, 1e-9, "scipy"), tuple(a[:slow_runs] for a in exact)),  # type: ignore[arg-type]
    }
    medians = interleaved(tasks, repeats)
    ours = medians["solve_batch, 1e-12"]
    print("| integrator | CPU per run [us] | times the first | error of the times: median, 99 % [s] |\n|---|---|---|---|")
    for name, value in medians.items():
        print(f"| {name} | {value:.1f} | {value / ours:.2f} | {errors[name]} |")
    differ = np.count_nonzero(solve_batch(BASE, columns).sequence != solve_with_numba(BASE, columns, DURATION, 1e-12)[2])
    print(f"\nMode sequences that differ between solve_batch and Numba, both at 1e-12: {differ} of {runs}.")
    for name, target in (("Numba DOP853, 1e-12", 1.5), ("SciPy DOP853, 1e-9", 300.0)):
        print(f"Target {target:g} times {name}: {verdict(medians[name] / ours >= target)} ({medians[name] / ours:.2f}).")


def verdict(met: bool) -> str:
    return "met" if met else "not met"


def growth(rounds: int = 3) -> None:
    """CPU time of a batch of a thousand runs to a million, beside a straight line through the first and the last.

    The fastest of several, taken in turn: this machine is at times slower by half, for seconds.
    """
    times = dict.fromkeys((1_000, 10_000, 100_000, 1_000_000), np.inf)
    for _ in range(rounds):
        for n in times:
            columns = map_columns(n)
            for _ in range(max(1, 30_000 // n)):
                times[n] = min(times[n], cpu_per_run(lambda c=columns: solve_batch(BASE, c), n) * n / 1e6)
    few, many = min(times), max(times)
    slope = (times[many] - times[few]) / (many - few)
    start = times[few] - few * slope
    print("\n| runs | CPU, warm [s] | per run [us] | straight line [s] |\n|---|---|---|---|")
    for n, seconds in times.items():
        print(f"| {n} | {seconds:.3f} | {1e6 * seconds / n:.1f} | {start + n * slope:.3f} |")
    off = max(abs(seconds / (start + n * slope) - 1) for n, seconds in times.items())
    print(f"\nThe line: {start:.3f} s and {1e6 * slope:.1f} us per run; furthest off it: {100 * off:.0f} %.")
    print(f"Target cost linear from 1e3 to 1e6 (within 20 % of a line): {verdict(off <= 0.2)}.")


def short_batch(runs: int) -> None:
    """Compute some runs of the map, in a process that has compiled the integrator already."""
    solve_batch(BASE, map_columns(runs))


def cached_work(times: int) -> None:
    """Do work that stays within a core's cache and shares nothing with other cores."""
    a = np.ones(1000)
    for _ in range(times):
        np.exp(a)


def scaling(pairs: int = 40, runs: int = 20_000) -> None:
    """Measure how much more two processes compute than one, both ready, as those of `map --jobs 2` are: short pieces, in turn.

    Others use this machine, too, and two processes feel it more than one; so work that shares nothing is done in turn with it.
    """
    tasks: dict[str, tuple[Callable[[int], None], int]] = {
        "runs of the map": (short_batch, runs),
        "np.exp of 1000 numbers": (cached_work, 150_000),
    }
    ratios: dict[str, list[float]] = {name: [] for name in tasks}
    with ProcessPoolExecutor(2, mp_context=multiprocessing.get_context("spawn")) as pool:

        def together(name: str, processes: int) -> float:
            task, size = tasks[name]
            started = time.perf_counter()
            for done in [pool.submit(task, size) for _ in range(processes)]:
                done.result()
            return time.perf_counter() - started

        for name in [*tasks, *tasks]:  # so that both processes are ready
            together(name, 2)
        for _ in range(pairs):
            for name, values in ratios.items():
                before, two = together(name, 1), together(name, 2)
                values.append((before + together(name, 1)) / two)
    print("\n| two processes / one, both ready | median | middle half |\n|---|---|---|")
    for name, values in ratios.items():
        low, middle, high = statistics.quantiles(values, n=4)
        print(f"| {name} | {middle:.2f} | {low:.2f} to {high:.2f} |")
    ours, possible = (statistics.median(values) for values in ratios.values())
    print(f"\nTarget two processes 1.8 times one, both ready: {verdict(ours >= 1.8)} ({ours:.2f}; np.exp: {possible:.2f}).")


def wall_clock(runs: int, processes: int) -> tuple[float, float, float]:
    """Return wall time [s], CPU time [s] and peak memory of the processes together [MiB] of one batch, from a fresh start."""
    code = (
        "import resource, sys, time\n"
        "from benchmarks.maps import BASE, map_columns, solve_batch\n"
        "if __name__ == '__main__':\n"
        "    started = time.perf_counter()\n"
        f"    solve_batch(BASE, map_columns({runs}), processes={processes})\n"
        "    print(time.perf_counter() - started)\n"
        "    uses = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]\n"
        "    print(sum(use.ru_utime + use.ru_stime for use in uses))\n"
        "    own = open('/proc/self/status').read().split('VmHWM:')[1].split()[0]\n"  # ru_maxrss begins with the parent's
        f"    print((float(own) + uses[1].ru_maxrss * {processes - 1}) / 1024)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    wall, cpu, memory = map(float, done.stdout.split())
    return wall, cpu, memory


def whole_map(runs: int, repeats: int = 3) -> None:
    """The map itself, on one process and on two, in turn."""
    print(f"\n## {runs} runs at 1e-12, from a fresh start (what heyoka has compiled before, it finds on disk)\n")
    print("| processes | wall [s] | CPU [s] | peak memory [MiB] |\n|---|---|---|---|")
    walls: dict[int, list[float]] = {1: [], 2: []}
    wall_clock(1000, 1)
    for _ in range(repeats):
        for processes, taken in walls.items():
            wall, cpu, memory = wall_clock(runs, processes)
            taken.append(wall)
            print(f"| {processes} | {wall:.1f} | {cpu:.1f} | {memory:.0f} |", flush=True)
    one, two = (statistics.median(taken) for taken in walls.values())
    print(f"\nTarget 1e6 runs in 40 s on two cores: {verdict(two * 1e6 / runs <= 40)} ({two:.1f} s; the aim was 20 s).")
    print(
        f"Target two processes 1.8 times one, the second one's start included: {verdict(one / two >= 1.8)} ({one / two:.2f})."
    )


def benchmark(repeats: int, runs: int) -> None:
    """Run all benchmarks of maps."""
    peers(repeats)
    growth()
    scaling()
    whole_map(runs)
    print(f"\nPeak memory of this process: {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MiB")
