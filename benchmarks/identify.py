"""Time `identify` on blind studies, and its calibration against the same one by SciPy.

`python -m benchmarks.identify STUDY.yaml` is one measurement in a process of its own, printed as JSON.
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

from looping_pendulum.discrepancy.first_look.check import take_first_look
from looping_pendulum.discrepancy.fit.calibration import calibrate
from looping_pendulum.discrepancy.fit.problem import Problem
from looping_pendulum.discrepancy.identify import identify
from looping_pendulum.discrepancy.inputs import read_inputs
from looping_pendulum.measured.measurement import predict
from looping_pendulum.measured.study_io import load
from looping_pendulum.reference_ode.solve import solve_at
from tests.blind.cases import CASES
from tests.blind.pendulum import Pendulum
from tests.discrepancy.blind_study import write_study
from tests.discrepancy.held_study import write_held_study
from tests.discrepancy.mistaken_study import MISTAKES, mistaken

THREE_TRIALS = ("ten_a", "six", "eight")
"""Two that are fitted and one held out; both masses are seen."""
SWING = "a swing of 100 turning points"
MOST_SECONDS = {"linear_drag": 2.0, "side_force": 2.0, "drag_and_thickness": 8.0, "magnet": 10.0, SWING: 20.0}
"""What is hidden -> target [s]: a listed effect, two at once, a force that is not listed; friction of a pendulum's axle."""
MOST_MEMORY = 600.0
"""[MiB]"""
MOST_SECONDS_OF_LOOK = 5.0
"""[s], of CPU time, once compiled."""
TIMES_SCIPY = 50.0
MET = {True: "met", False: "not met"}


def benchmark() -> None:
    """Print how long studies take, cold and warm, and the calibration against SciPy's."""
    print("\n## `identify`, three trials of two masses or a held pendulum, all candidates\n")
    print("| hidden | verdict | cold [s] | warm [s] | warm, CPU [s] | peak [MiB] | target |\n|---|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        for name, most in MOST_SECONDS.items():
            study = _study(Path(folder) / name, name)
            home = str(Path(folder) / name / "home")  # heyoka keeps compiled code below it
            cold, warm = _in_own_process(study, home), _in_own_process(study, home)
            met = MET[warm["seconds"] < most and warm["peak"] < MOST_MEMORY]
            print(
                f"| {name} | {warm['verdict']} | {cold['seconds']:.1f} | {warm['seconds']:.1f} | {warm['cpu']:.1f} "
                f"| {warm['peak']:.0f} | {most:g} s, {MOST_MEMORY:g} MiB: {met} |",
                flush=True,
            )
        against_scipy(_study(Path(folder) / "again", "linear_drag"))
        first_looks(Path(folder) / "again")


def first_looks(folder: Path) -> None:
    """Print how long a first look takes at a study as it is, and with each of ten mistakes in it."""
    seconds = {"none": _seconds_of_first_look(folder / "study.yaml")}
    for name, mistake in MISTAKES.items():
        seconds[name] = _seconds_of_first_look(mistaken(folder / "study.yaml", folder / name.replace(" ", "_"), mistake))
    print("\n## First look at the same study\n\n| mistake | CPU [s] |\n|---|---|")
    for name, taken in seconds.items():
        print(f"| {name} | {taken:.2f} |")
    print(f"\nTarget {MOST_SECONDS_OF_LOOK:g} s: {MET[max(seconds.values()) < MOST_SECONDS_OF_LOOK]}.")


def _seconds_of_first_look(study: Path) -> float:
    loaded = load(study)
    take_first_look(loaded)  # compiles
    started = time.process_time()
    take_first_look(loaded)
    return time.process_time() - started


def against_scipy(study: Path) -> None:
    """Calibrate the same data, numbers and priors from the same start, by ours and by SciPy; CPU seconds."""
    inputs = read_inputs(load(study))
    calibrate(Problem(inputs.study, inputs.training, inputs.free_parameters))
    seconds = []
    for _ in range(3):
        problem = Problem(inputs.study, inputs.training, inputs.free_parameters)
        started = time.process_time()
        fit = calibrate(problem)
        seconds.append(time.process_time() - started)
    ours = float(np.median(seconds))
    started = time.process_time()
    theirs = least_squares(lambda x: _residuals_by_scipy(problem, x), problem.prior_mean, bounds=(problem.low, problem.high),
                           diff_step=1e-3, x_scale=1.0, ftol=1e-6, xtol=1e-8)  # fmt: skip
    taken = time.process_time() - started
    print(f"\n## Calibration of {len(inputs.training)} trials, {len(problem.free_parameters)} numbers\n")
    print("| by | CPU seconds | cost | Jacobians |\n|---|---|---|---|")
    print(f"| ours | {ours:.2f} | {fit.cost:.2f} | {fit.iterations} |")
    print(f"| SciPy least_squares, finite differences, DOP853 at 1e-9 | {taken:.1f} | {2 * theirs.cost:.2f} | {theirs.njev} |")
    print(f"\nTarget {TIMES_SCIPY:g} times faster: {MET[taken / ours >= TIMES_SCIPY]} ({taken / ours:.0f}).")


def _residuals_by_scipy(problem: Problem, x: np.ndarray) -> np.ndarray:
    parts = []
    for k, d in enumerate(problem.data):
        parameters, camera = problem.parameters_and_camera(x, k)
        seen = predict(
            lambda t, p=parameters: solve_at(p, t, duration=float(t[-1]) + 1e-3, tolerance=1e-9, integrator="scipy"),
            camera, d.channels, dropped=d.trial.dropped,
        )  # fmt: skip
        values = np.concatenate([seen.values[c.name] for c in d.channels])
        parts.append((d.value - values) / d.sigma)
    return np.concatenate([*parts, -problem.prior_weights @ (x - problem.prior_mean)])


def _study(folder: Path, case: str) -> Path:
    folder.mkdir()
    if case == SWING:
        return write_held_study(folder, Pendulum(quadratic_drag=4e-4, axle_torque=3e-4))
    return write_study(folder, CASES[case], 1, trials=THREE_TRIALS)


def _in_own_process(study: Path, home: str) -> dict[str, object]:
    environment = os.environ | {"HOME": home, "XDG_CACHE_HOME": home, "OMP_NUM_THREADS": "1"}
    command = [sys.executable, "-m", "benchmarks.identify", str(study)]
    done = subprocess.run(command, env=environment, check=True, capture_output=True, text=True)
    return json.loads(done.stdout.splitlines()[-1])


def measure(study: Path) -> dict[str, object]:
    """Seconds (imports left out), CPU seconds and peak memory [MiB], both with the helper's, of one `identify`."""
    started, cpu = time.perf_counter(), time.process_time()
    result = identify(load(study))
    seconds = time.perf_counter() - started
    own, helper = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return {
        "verdict": result.verdict.value,
        "seconds": seconds,
        "cpu": time.process_time() - cpu + helper.ru_utime + helper.ru_stime,
        "peak": (own.ru_maxrss + helper.ru_maxrss) / 1024,
    }


if __name__ == "__main__":
    print(json.dumps(measure(Path(sys.argv[1]))))
