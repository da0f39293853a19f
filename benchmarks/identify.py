"""Time `identify` and a first look on blind studies.

`python -m benchmarks.identify STUDY.yaml` is one measurement in a process of its own, printed as JSON.
"""

import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from looping_pendulum.discrepancy.identify import identify
from looping_pendulum.discrepancy.look.check import take_first_look
from looping_pendulum.measured.study_io import load
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
"""[s], of CPU time, once the models are traced."""
MET = {True: "met", False: "not met"}


def benchmark() -> None:
    """Print how long studies take, and how long a first look."""
    print("\n## `identify`, three trials of two masses or a held pendulum, all candidates\n")
    print("| hidden | verdict | wall [s] | CPU [s] | peak [MiB] | target |\n|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        for name, most in MOST_SECONDS.items():
            taken = _in_own_process(_study(Path(folder) / name, name))
            met = MET[taken["seconds"] < most and taken["peak"] < MOST_MEMORY]
            print(
                f"| {name} | {taken['verdict']} | {taken['seconds']:.1f} | {taken['cpu']:.1f} "
                f"| {taken['peak']:.0f} | {most:g} s, {MOST_MEMORY:g} MiB: {met} |",
                flush=True,
            )
        _study(Path(folder) / "again", "linear_drag")
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
    take_first_look(loaded)  # traces the models
    started = time.process_time()
    take_first_look(loaded)
    return time.process_time() - started


def _study(folder: Path, case: str) -> Path:
    folder.mkdir()
    if case == SWING:
        return write_held_study(folder, Pendulum(quadratic_drag=4e-4, axle_torque=3e-4))
    return write_study(folder, CASES[case], 1, trials=THREE_TRIALS)


def _in_own_process(study: Path) -> dict[str, object]:
    environment = os.environ | {"OMP_NUM_THREADS": "1"}
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
