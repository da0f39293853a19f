"""Measurements of engines: the numbers that their adapters declare, and those that the guides state."""

from __future__ import annotations

import re
import sys
import tempfile
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

from looping_pendulum.engines.landmarks import run_landmarks
from looping_pendulum.engines.protocol import Profile, SteppedEngine
from looping_pendulum.engines.pybullet.world import RodShape
from looping_pendulum.engines.registry import select
from looping_pendulum.engines.trajectory import Trajectory
from looping_pendulum.reference_ode.closed_forms import atwood_acceleration
from looping_pendulum.reference_ode.solve import solve
from looping_pendulum.scenarios import load
from looping_pendulum.scenarios.scenario import Scenario
from scripts.measurements.reference import rms_by_end_time

PAGE = Path(__file__).parents[2] / "docs" / "write-an-engine.md"
FRICTIONS = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.8, 1.0, 1.2)
"""Values of the constant friction that `constant_friction` scans [N]."""


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
    with mock.patch("looping_pendulum.engines.pymunk.chain.direct_library", return_value=None):
        without = summary(engine("pymunk:chain").simulate(scenario), scenario)
    return {"private": with_call, "public": without}


def pymunk_defaults() -> dict[str, Any]:
    """Measure the stretch of a chain with Chipmunk's default settings, and with ten times the iterations.

    Each is run with the limit on stretch, which ends the run early, and without it (`_not_ended`).
    """
    scenario = load("ten_to_one")
    summaries = {}
    for name, iterations in (("default", 10), ("ten_times", 100)):
        run = engine("pymunk:defaults", iterations=iterations).simulate(scenario)
        summaries[name] = {"iterations": iterations} | summary(run, scenario)
    with mock.patch("looping_pendulum.engines.protocol.MAX_STRETCH_FRACTION", float("inf")):
        for name, iterations in (("default", 10), ("ten_times", 100)):
            run = engine("pymunk:defaults", iterations=iterations).simulate(scenario)
            summaries[f"{name}_not_ended"] = {"iterations": iterations} | summary(run, scenario)
    return summaries


def pybullet_cylinder() -> dict[str, Any]:
    """Measure the error of a vertical drop of PyBullet's chain over a sphere, which the adapter uses, and over a cylinder."""
    scenario = load("atwood")
    runs = {shape: engine("pybullet:chain", rod=shape).simulate(scenario) for shape in RodShape}
    return {shape.value: acceleration_error(run, scenario) for shape, run in runs.items()}


def spring() -> dict[str, Any]:
    """Measure the example engine of docs/write-an-engine.md, whose code is taken from the page."""
    (code, *_) = re.findall(r"^```python\n(.*?)^```$", PAGE.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)
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
