"""Measurements of run times, for an otherwise idle machine."""

from __future__ import annotations

import statistics
import time
from typing import Any

import numpy as np

from looping_pendulum.reference_ode.solve import solve_at
from looping_pendulum.scenarios import load


def reference_speed() -> dict[str, Any]:
    """Measure the CPU time [s] of one run of ten_to_one, with both masses' positions sampled at 1 kHz, for each integrator.

    The values are medians; one run of each integrator before them compiles the equations and is not counted.
    """
    parameters, t = load("ten_to_one").parameters, np.arange(0.0, 1.2, 1e-3)

    def cpu_time(integrator: str, tolerance: float, repeats: int) -> float:
        started = time.process_time()
        for _ in range(repeats):
            samples = solve_at(parameters, t, tolerance=tolerance, integrator=integrator)
            _ = samples.light_position, samples.heavy_position
        return (time.process_time() - started) / repeats

    tasks = {"heyoka": (1e-12, 50), "scipy": (1e-9, 1)}
    for name, (tolerance, _) in tasks.items():
        cpu_time(name, tolerance, 1)
    taken = {name: [cpu_time(name, tolerance, n) for _ in range(15)] for name, (tolerance, n) in tasks.items()}
    return {name: statistics.median(times) for name, times in taken.items()}
