"""Repeat the measurements behind the numbers of README and docs: `python -m research.measure NAME ...`.

Each measurement is a function of this file that returns plain numbers in SI. It is stored as
`research/data/measured/NAME.json` with the command, the day and the versions. Without a name, the script lists the
measurements; `--all` makes all.
"""

import argparse
import datetime
import json
import math
import platform
import re
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

from looping_pendulum.discrepancy.identify import identify
from looping_pendulum.discrepancy.result import Identification
from looping_pendulum.engines.protocol import Profile, SteppedEngine
from looping_pendulum.engines.registry import select
from looping_pendulum.engines.static_capstan import measure_capstan_exponent
from looping_pendulum.errors import EngineError
from looping_pendulum.measured.study_io import load as load_study
from looping_pendulum.reference_ode.closed_forms import atwood_acceleration
from looping_pendulum.reference_ode.parameters import Parameters
from looping_pendulum.reference_ode.solve import solve, solve_at
from looping_pendulum.runs.events import run_landmarks
from looping_pendulum.runs.trajectory import Trajectory
from looping_pendulum.scenarios import load
from looping_pendulum.scenarios.scenario import Scenario
from looping_pendulum.teaching.example_folder import write_example
from looping_pendulum.versions import MISSING, installed_version
from research import DATA, DOCS

FOLDER = DATA / "measured"
PACKAGES = (
    "looping-pendulum", "numpy", "scipy", "wasmtime", "mujoco", "pymunk", "pybullet", "drake", "pyb2d3", "rapier3d", "exudyn",
    "newton", "warp-lang",
)  # fmt: skip
END_TIMES = {"0.35s": 0.35, "0.7s": 0.7, "1.0s": 1.0}
"""Name -> end of the interval over which distances are averaged [s]; the same as in the comparison."""
FRICTIONS = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.8, 1.0, 1.2)
"""Values of the constant friction that `constant_friction` scans [N]."""
WRAP_ANGLES = (90, 135, 180)
"""Wrap angles of the static test [deg]."""
TENDON_END_TIMES = (0.1, 0.2, 0.29)
"""Ends of the times over which the distance from the reference is averaged [s]; soon after the last the run is ended."""
COMPLIANCES = (0.0, 1e-6, 1e-5, 1e-4, 1e-3)
"""[m/N]"""


def main() -> None:
    """Make the requested measurements."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="NAME", help=", ".join(MEASUREMENTS))
    parser.add_argument("--all", action="store_true")
    options = parser.parse_args()
    names = list(MEASUREMENTS) if options.all else options.names
    for name in names:
        if name not in MEASUREMENTS:
            parser.error(f"NAME: found {name!r}, needed one of {', '.join(MEASUREMENTS)}")
    if not names:
        print("\n".join(MEASUREMENTS))
    for name in dict.fromkeys(names):
        print(f"{name} ...", flush=True)
        print(f"  {measure_and_store(name)}", flush=True)


def measure_and_store(name: str) -> Path:
    """Make one measurement and store it; return the file."""
    started = time.process_time()
    values = MEASUREMENTS[name]()
    record = {
        "command": f"python -m research.measure {name}",
        "measured_on": datetime.date.today().isoformat(),
        "cpu_seconds": round(time.process_time() - started),
        "machine": platform.machine(),
        "versions": {"python": platform.python_version()} | _versions(),
        "values": _rounded(values),
    }
    FOLDER.mkdir(parents=True, exist_ok=True)
    file = FOLDER / f"{name}.json"
    file.write_text(json.dumps(record, indent=1, allow_nan=False) + "\n", encoding="utf-8")
    return file


def _versions() -> dict[str, str]:
    versions = {package: installed_version(package) for package in PACKAGES}
    return {package: version for package, version in versions.items() if version != MISSING}


def _rounded(record: Any) -> Any:
    """Round numbers to six digits, which is more than any page prints; replace one that is not finite by None."""
    if isinstance(record, dict):
        return {str(key): _rounded(value) for key, value in record.items()}
    if isinstance(record, list | tuple):
        return [_rounded(value) for value in record]
    if isinstance(record, float):
        return float(f"{record:.6g}") if math.isfinite(record) else None
    return record


def rms(t: Any, light_position: Any, parameters: Parameters, until: float) -> float | None:
    """Return the RMS distance of the light mass from the reference up to ``until`` [m]; None if the run ends earlier."""
    if len(t) == 0 or t[-1] < until - 1e-9:
        return None
    kept = t <= until + 1e-9
    exact = solve_at(parameters, t[kept]).light_position
    return float(np.sqrt(np.mean(np.sum((light_position[kept] - exact) ** 2, axis=1))))


def rms_by_end_time(run: Trajectory, parameters: Parameters) -> dict[str, float | None]:
    """Return the RMS distance of an engine's run from the reference up to each of `END_TIMES` [m]."""
    return {name: rms(run.t, run.light_position, parameters, until) for name, until in END_TIMES.items()}


def friction_by_one_percent() -> dict[str, Any]:
    """Measure how far the light mass of the 10:1 trial moves if the friction is 1 % larger."""
    p = load("ten_to_one").parameters
    t = np.arange(0.0, 1.0005, 1e-3)
    more = {name: 1.01 * p.coefficients[name] for name in ("kinetic_friction", "static_friction")}
    moved = solve_at(p.replace(**more), t).light_position
    return {name: rms(t, moved, p, until) for name, until in END_TIMES.items()}


def paper_columns() -> dict[str, Any]:
    """Compare the reference with the paper's numerical columns; needs the data folder."""
    from looping_pendulum.compare.harness import compare_engines

    ten, two = (compare_engines(load(name), engines=["reference"]).measured for name in ("ten_to_one", "two_to_one"))
    time_errors = [abs(r.reference - r.paper_numerical) for r in ten if r.quantity in ("x1_extremum", "y1_extremum")]
    rows = [abs(r.reference - r.paper_numerical) for r in two]
    return {
        "extrema": len(time_errors),
        "largest_time_error": max(time_errors),
        "two_to_one_rows": len(rows),
        "within_printed_precision": sum(x <= 0.005 for x in rows),
    }


def engine(name: str, profile: Profile = Profile.QUICK, **changes: Any) -> SteppedEngine:
    """Return one variant, with some settings changed."""
    (selected,) = select([name], profile)
    assert isinstance(selected, SteppedEngine)
    return selected.with_settings(**changes) if changes else selected


def largest_stretch(run: Trajectory) -> float:
    """Return the string's largest stretch over the whole run [m]."""
    return float(np.nanmax(np.abs(run.string_stretch)))


def acceleration_error(run: Trajectory, scenario: Scenario) -> float:
    """Return the relative error of the heavy mass's acceleration in a vertical drop from rest, against the closed form."""
    acceleration = 2 * float(np.sum(run.heavy_drop * run.t**2) / np.sum(run.t**4))  # least squares of drop = a t^2 / 2
    return acceleration / atwood_acceleration(scenario.parameters) - 1


def summary(run: Trajectory, scenario: Scenario) -> dict[str, Any]:
    """Return the distances from the reference, the stretch, and the end and status of the run."""
    return {
        "rms": rms_by_end_time(run, scenario.parameters),
        "stretch": largest_stretch(run),
        "stretch_at": float(run.t[np.nanargmax(np.abs(run.string_stretch))]),
        "end": float(run.t[-1]),
        "status": run.status.name,
    }


def constant_friction() -> dict[str, Any]:
    """Scan MuJoCo's constant friction loss: which value is nearest to the reference, and whether any halts the heavy mass."""
    scenario = load("ten_to_one")
    exact = solve(scenario.parameters).halting_time
    assert exact is not None
    scan = {}
    for size in FRICTIONS:
        with mock.patch("looping_pendulum.engines.mujoco.tendon.friction_loss", return_value=size):
            run = engine("mujoco:frictionloss").simulate(scenario)
        turns = np.flatnonzero(run.heavy_velocity[:, 1] > 1e-3)
        halt = run_landmarks(run, scenario.parameters).halting_time
        scan[f"{size:g}"] = {
            "rms_0.35s": rms_by_end_time(run, scenario.parameters)["0.35s"],
            "halt": halt,
            "turns_back_at": float(run.t[turns[0]]) if len(turns) else None,
            "largest_drop": float(np.max(run.heavy_drop)),
        }
    nearest = min(scan, key=lambda size: scan[size]["rms_0.35s"])
    late = [abs(one["halt"] - exact) for one in scan.values() if one["halt"] is not None]
    return {
        "smallest": min(FRICTIONS),
        "largest": max(FRICTIONS),
        "nearest": float(nearest),
        "nearest_turns_back_at": scan[nearest]["turns_back_at"],
        "smallest_halting_error": min(late) if late else None,
        "exact_halt": exact,
        "scan": scan,
    }


def beads_creep() -> dict[str, Any]:
    """Measure the heavy mass's mean speed from 0.45 to 0.6 s, after the halt of ten_to_one, with MuJoCo's beads."""
    scenario = load("ten_to_one")
    run = engine("mujoco:beads").simulate(scenario)
    drops = np.interp([0.45, 0.6], run.t, run.heavy_drop)
    return {"sinking_speed": float((drops[1] - drops[0]) / 0.15)}


def pymunk_public_calls() -> dict[str, Any]:
    """Run pymunk's chain on ten_to_one with its private call, and without it."""
    scenario = load("ten_to_one")
    with_call = summary(engine("pymunk:chain").simulate(scenario), scenario)
    with mock.patch("looping_pendulum.engines.pymunk.private_library", return_value=None):
        without = summary(engine("pymunk:chain").simulate(scenario), scenario)
    return {"private": with_call, "public": without}


def pybullet_cylinder() -> dict[str, Any]:
    """Measure the error of a vertical drop of PyBullet's chain over a sphere, which the adapter uses, and over a cylinder."""
    scenario = load("atwood")
    runs = {shape: engine("pybullet:chain", rod=shape).simulate(scenario) for shape in ("sphere", "cylinder")}
    return {shape.value: acceleration_error(run, scenario) for shape, run in runs.items()}


def spring() -> dict[str, Any]:
    """Measure the example engine of docs/write-an-engine.md, whose code is taken from the page."""
    (code, *_) = re.findall(
        r"^```python\n(.*?)^```$", (DOCS / "write-an-engine.md").read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE
    )
    scenario = load("ten_to_one")
    exact = solve(scenario.parameters).halting_time
    assert exact is not None
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "looping_spring.py").write_text(code, encoding="utf-8")
        sys.path.insert(0, folder)
        try:
            import looping_spring  # type: ignore[import-not-found]
        finally:
            sys.path.remove(folder)
    summaries = {}
    for profile in Profile:
        (one,) = looping_spring.engines(profile)
        run = one.simulate(scenario)
        halt = run_landmarks(run, scenario.parameters).halting_time
        error = None if halt is None else abs(halt - exact)
        summaries[profile.value] = summary(run, scenario) | {"halting_time_error": error}
    return summaries


def newton_tendon() -> dict[str, Any]:
    """Return errors of the capstan exponent and of the 10:1 trial for both profiles, and the exponent for compliances."""
    return {
        **{profile.value: _static(profile) | _trial(profile) for profile in Profile},
        "compliance": {f"{value:g}": _exponent_error(180, compliance=value) for value in COMPLIANCES},
    }


def _static(profile: Profile) -> dict[str, Any]:
    return {"static": {f"{degrees}": _exponent_error(degrees, profile) for degrees in WRAP_ANGLES}}


def _exponent_error(degrees: float, profile: Profile = Profile.QUICK, **changes: float) -> float | str:
    """Return the relative error of ln(T2 / T1) at a wrap angle; a sentence if the string does not slide."""
    try:
        return measure_capstan_exponent(engine("newton:tendon", profile, **changes), wrap_angle=math.radians(degrees)).error
    except EngineError as error:
        if "did not slide" not in str(error):
            raise
        return "does not slide"


def _trial(profile: Profile) -> dict[str, Any]:
    """Return where the 10:1 trial is ended, and the light mass's distance from the reference until then."""
    scenario, samples = load("ten_to_one"), []
    try:
        engine("newton:tendon", profile).simulate(scenario, samples.append)
    except EngineError as error:
        if "beyond half a turn" not in str(error):
            raise
    rows = np.array(samples)
    exact = solve_at(scenario.parameters, rows[:, 0], duration=rows[-1, 0] + 0.01)
    distances = np.linalg.norm(rows[:, 1:3] - exact.light_position, axis=1)
    rms = {f"{end:g}s": math.sqrt(np.mean(distances[rows[:, 0] <= end + 1e-9] ** 2)) for end in TENDON_END_TIMES}
    return {"rms": rms, "ended_at": rows[-1, 0]}


def identification_summary(result: Identification) -> dict[str, Any]:
    """Return what the pages say about a study."""
    held_out = next((e for e in result.errors if e.held_out), None)
    return {
        "verdict": result.verdict.value,
        "effects": {e.name: {"value": e.value, "error": e.error, "unit": e.candidate.unit} for e in result.effects},
        "ties": [{e.name: {"value": e.value, "error": e.error, "unit": e.candidate.unit} for e in tie} for tie in result.ties],
        "explanations": {
            " + ".join(e.names) or "nothing": {"probability": e.probability, "log10_odds": e.log10_odds}
            for e in result.explanations[:2]
        },
        "held_out_before": None if held_out is None else held_out.rms_before,
        "held_out_after": None if held_out is None else held_out.rms_after,
        "correlated_noise": {
            body: {"amplitude": n.amplitude, "time": n.correlation_time} for body, n in result.correlated_noise.items()
        },
        "sentence": result.sentence,
    }


def falling_balls() -> dict[str, Any]:
    """Identify balls that fall from a bridge: two drops each, one held out; needs the data folder."""
    from tests.discrepancy import test_real_data as real_data

    summaries = {}
    for ball in real_data.BALLS:
        with tempfile.TemporaryDirectory() as folder:
            summaries[ball] = identification_summary(real_data.falling(Path(folder), ball))
    return summaries


def example_study() -> dict[str, Any]:
    """Identify the study of the folder that `init` writes, whose verdict docs/film.md shows."""
    with tempfile.TemporaryDirectory() as folder:
        example = Path(folder) / "example"
        write_example(example)
        return identification_summary(identify(load_study(example / "study.yaml")))


MEASUREMENTS: dict[str, Callable[[], dict[str, Any]]] = {
    measurement.__name__: measurement
    for measurement in (
        friction_by_one_percent, paper_columns, constant_friction, beads_creep, pymunk_public_calls,
        pybullet_cylinder, spring, newton_tendon, falling_balls, example_study,
    )
}  # fmt: skip
"""Measurements, which take a few minutes at most."""

if __name__ == "__main__":
    main()
