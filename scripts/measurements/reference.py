"""Measurements that need the exact reference alone."""

from __future__ import annotations

from typing import Any

import numpy as np

from looping_pendulum.engines.trajectory import Trajectory
from looping_pendulum.reference_ode.parameters import Parameters
from looping_pendulum.reference_ode.solve import solve_at
from looping_pendulum.scenarios import load

MARKS = {"0.35s": 0.35, "0.7s": 0.7, "1.0s": 1.0}
"""Name -> time up to which distances are averaged [s]: those of the comparison."""


def rms(t: Any, light_position: Any, parameters: Parameters, until: float) -> float | None:
    """Root mean square of the light mass's distance from the reference up to ``until`` [m]; None where the run ends before."""
    if len(t) == 0 or t[-1] < until - 1e-9:
        return None
    kept = t <= until + 1e-9
    exact = solve_at(parameters, t[kept]).light_position
    return float(np.sqrt(np.mean(np.sum((light_position[kept] - exact) ** 2, axis=1))))


def rms_of(run: Trajectory, parameters: Parameters) -> dict[str, float | None]:
    """Distances of an engine's run up to each of `MARKS` [m]."""
    return {name: rms(run.t, run.light_position, parameters, until) for name, until in MARKS.items()}


def friction_by_one_percent() -> dict[str, Any]:
    """How far the light mass of the 10:1 trial moves when the friction is 1 % larger."""
    p = load("ten_to_one").parameters
    t = np.arange(0.0, 1.0005, 1e-3)
    more = {name: 1.01 * p.coefficients[name] for name in ("kinetic_friction", "static_friction")}
    moved = solve_at(p.replace(**more), t).light_position
    return {name: rms(t, moved, p, until) for name, until in MARKS.items()}


def paper_columns() -> dict[str, Any]:
    """The reference against the paper's numerical columns; needs the data folder."""
    from looping_pendulum.compare.harness import compare_engines

    ten, two = (compare_engines(load(name), engines=["reference:scipy"]).measured for name in ("ten_to_one", "two_to_one"))
    off = [abs(r.reference - r.paper_numerical) for r in ten if r.quantity in ("x1_extremum", "y1_extremum")]
    rows = [abs(r.reference - r.paper_numerical) for r in two]
    return {
        "extrema": len(off),
        "largest_time_error": max(off),
        "two_to_one_rows": len(rows),
        "within_printed_precision": sum(x <= 0.005 for x in rows),
    }
