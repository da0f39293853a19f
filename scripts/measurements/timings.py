"""Wall times, for a machine that does nothing else meanwhile."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks.__main__ import interleaved
from looping_pendulum.reference_ode.solve import solve_at
from looping_pendulum.scenarios import load


def reference_speed() -> dict[str, Any]:
    """One run of ten_to_one sampled at 1 kHz, positions of both masses, by either integrator [s]."""
    parameters, t = load("ten_to_one").parameters, np.arange(0.0, 1.2, 1e-3)

    def task(integrator: str, tolerance: float) -> Any:
        def run() -> object:
            samples = solve_at(parameters, t, tolerance=tolerance, integrator=integrator)
            return samples.light_position, samples.heavy_position

        return run

    return interleaved({"heyoka": task("heyoka", 1e-12), "scipy": task("scipy", 1e-9)}, repeats=15)


def map_speed() -> dict[str, Any]:
    """Many runs in a batch, against what they would cost otherwise."""
    from benchmarks import maps  # compiles, and needs the extra "benchmark"

    return maps.measured(repeats=3, runs=1_000_000)
