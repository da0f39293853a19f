"""Many runs of the reference at once, against what a user would write instead: `python -m benchmarks --only maps`.

The set is that of the maps: release angle 60 to 130 degrees, M2/M1 from 1 to 12, the apparatus of ten_to_one.
"""

from __future__ import annotations

import resource
import statistics
import subprocess
import sys
import time
from collections.abc import Callable

import numpy as np

from looping_pendulum.reference_ode.batch import BatchResult, solve_batch
from looping_pendulum.reference_ode.solve import DURATION, solve
from looping_pendulum.scenarios import load

BASE = load("ten_to_one").parameters
Columns = dict[str, np.ndarray]


def map_columns(n: int) -> Columns:
    """A low-discrepancy sample of the map (Roberts' R2 sequence)."""
    golden = 1.324717957244746
    first, second = ((0.5 + np.arange(1, n + 1) / golden**k) % 1 for k in (1, 2))
    return {"release_angle": np.radians(60 + 70 * first), "heavy_mass": BASE.light_mass * (1 + 11 * second)}


def part(columns: Columns, n: int) -> Columns:
    return {name: values[:n] for name, values in columns.items()}


def cpu_per_run(task: Callable[[], object], runs: int) -> float:
    """CPU time per run [us]."""
    started = time.process_time()
    task()
    return 1e6 * (time.process_time() - started) / runs


def interleaved(tasks: dict[str, tuple[Callable[[], object], int]], repeats: int) -> dict[str, float]:
    """Median CPU time per run [us] of each task, taken in turn."""
    found: dict[str, list[float]] = {name: [] for name in tasks}
    for _ in range(repeats):
        for name, (task, runs) in tasks.items():
            found[name].append(cpu_per_run(task, runs))
    return {name: statistics.median(values) for name, values in found.items()}


def one_by_one(columns: Columns, runs: int, tolerance: float, integrator: str) -> tuple[np.ndarray, np.ndarray]:
    """Halting and end times from single runs."""
    times = []
    for i in range(runs):
        values = {name: float(column[i]) for name, column in columns.items()}
        run = solve(BASE.replace(**values), tolerance=tolerance, integrator=integrator)
        times.append((np.nan if run.halting_time is None else run.halting_time, run.end_time))
    halting, end = np.array(times).T
    return halting, end


def error(found: tuple[np.ndarray, np.ndarray], exact: tuple[np.ndarray, np.ndarray]) -> str:
    """Median and 99th percentile of the error of a run's times [s]."""
    worst = np.fmax.reduce([np.abs(a[: len(b)] - b) for a, b in zip(found, exact, strict=True)])
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
    for name, needed in (("Numba DOP853, 1e-12", 1.5), ("SciPy DOP853, 1e-9", 300.0)):
        print(f"Target {needed:g} times {name}: {verdict(medians[name] / ours >= needed)} ({medians[name] / ours:.2f}).")


def verdict(met: bool) -> str:
    return "met" if met else "not met"


def growth() -> None:
    """CPU time per run from a thousand to a hundred thousand runs."""
    print("\n| runs | CPU per run [us], warm |\n|---|---|")
    for n in (1_000, 10_000, 100_000):
        columns = map_columns(n)
        print(f"| {n} | {min(cpu_per_run(lambda c=columns: solve_batch(BASE, c), n) for _ in range(3)):.1f} |")


def wall_clock(runs: int, processes: int) -> tuple[float, float, float]:
    """Wall time [s], CPU time [s] and peak memory of the processes together [MiB] of one batch, from a fresh start."""
    code = (
        "import resource, sys, time\n"
        "from benchmarks.maps import BASE, map_columns, solve_batch\n"
        "if __name__ == '__main__':\n"
        "    started = time.perf_counter()\n"
        f"    solve_batch(BASE, map_columns({runs}), processes={processes})\n"
        "    print(time.perf_counter() - started)\n"
        "    uses = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]\n"
        "    print(sum(use.ru_utime + use.ru_stime for use in uses))\n"
        f"    print((uses[0].ru_maxrss + uses[1].ru_maxrss * {processes - 1}) / 1024)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    wall, cpu, memory = map(float, done.stdout.split())
    return wall, cpu, memory


def machine_scaling(pairs: int = 5) -> float:
    """How many times one process two get done here, of work that stays within a core and shares nothing."""
    code = (
        "import time, numpy as np\n"
        "a, started = np.ones(1000), time.perf_counter()\n"
        "for _ in range(300000): np.exp(a)\n"
        "print(time.perf_counter() - started)\n"
    )

    def together(processes: int) -> float:
        running = [subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) for _ in range(processes)]
        return max(float(process.communicate()[0]) for process in running)

    return statistics.median(2 * together(1) / together(2) for _ in range(pairs))


def whole_map(runs: int, repeats: int = 3) -> None:
    """The map itself, on one process and on two, in turn."""
    print(f"\n## {runs} runs at 1e-12, compiling included\n")
    print("| processes | wall [s] | CPU [s] | peak memory [MiB] |\n|---|---|---|---|")
    walls: dict[int, list[float]] = {1: [], 2: []}
    for _ in range(repeats):
        for processes, taken in walls.items():
            wall, cpu, memory = wall_clock(runs, processes)
            taken.append(wall)
            print(f"| {processes} | {wall:.1f} | {cpu:.1f} | {memory:.0f} |", flush=True)
    one, two = (statistics.median(taken) for taken in walls.values())
    print(f"\nTarget 1e6 runs in 40 s on two cores: {verdict(two * 1e6 / runs <= 40)} ({two:.1f} s).")
    print(f"Target two processes 1.8 times one: {verdict(one / two >= 1.8)} ({one / two:.2f}).")
    print(f"Two processes that share nothing get {machine_scaling():.2f} times as much done as one on this machine now.")


def benchmark(repeats: int, runs: int) -> None:
    """Everything."""
    peers(repeats)
    growth()
    whole_map(runs)
    print(f"\nPeak memory of this process: {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MiB")
