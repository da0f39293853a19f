"""Measurements that need the exact reference alone."""

from __future__ import annotations

from typing import Any

import numpy as np

from looping_pendulum.engines.trajectory import Trajectory
from looping_pendulum.reference_ode.parameters import Parameters
from looping_pendulum.reference_ode.solve import solve_at
from looping_pendulum.scenarios import load

END_TIMES = {"0.35s": 0.35, "0.7s": 0.7, "1.0s": 1.0}
"""Name -> end of the interval over which distances are averaged [s]; the same as in the comparison."""


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

    ten, two = (compare_engines(load(name), engines=["reference:scipy"]).measured for name in ("ten_to_one", "two_to_one"))
    time_errors = [abs(r.reference - r.paper_numerical) for r in ten if r.quantity in ("x1_extremum", "y1_extremum")]
    rows = [abs(r.reference - r.paper_numerical) for r in two]
    return {
        "extrema": len(time_errors),
        "largest_time_error": max(time_errors),
        "two_to_one_rows": len(rows),
        "within_printed_precision": sum(x <= 0.005 for x in rows),
    }
