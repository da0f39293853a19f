"""Solve the hybrid model: the functions that everything else calls."""

from __future__ import annotations

from functools import cache
from importlib.util import find_spec

import numpy as np

from looping_pendulum.errors import MissingPackageError
from looping_pendulum.reference_ode.driver import Driver
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import Parameters
from looping_pendulum.reference_ode.solution import Run, Samples, Solution, join

TOLERANCE = 1e-12
DURATION = 5.0
"""Default limit on the simulated time [s]; most runs end long before, when the light mass reaches the rod."""


def solve(
    parameters: Parameters, *, duration: float = DURATION, tolerance: float = TOLERANCE, integrator: str = "auto"
) -> Solution:
    """Integrate the hybrid model from its release until it ends or ``duration`` [s] is over.

    Parameters
    ----------
    parameters
        Apparatus, release and coefficients.
    duration
        Limit on the simulated time [s].
    tolerance
        Relative tolerance of a step.
    integrator
        "heyoka", "scipy", or "auto": heyoka where it is installed.

    Raises
    ------
    IntegrationError
        If the run breaks down or its events do not end.
    MissingPackageError
        If heyoka is asked for by name and not installed.
    """
    driver = Driver(parameters, duration, tolerance, _chosen(integrator))
    segments = driver.run_dense()
    return Solution(**driver.record(), segments=tuple(segments))


def solve_at(
    parameters: Parameters,
    t: Array,
    *,
    duration: float = DURATION,
    tolerance: float = TOLERANCE,
    integrator: str = "auto",
) -> Samples:
    """Integrate as `solve` does, but only keep the samples at times ``t`` [s], ascending: faster where many runs are needed.

    Times after the run's end are left out, so the samples may be fewer than the times.
    """
    driver = Driver(parameters, duration, tolerance, _chosen(integrator))
    parts = driver.run_sampled(np.asarray(t, dtype=float))
    return join(Run(**driver.record()), parts)


@cache
def available_integrators() -> tuple[str, ...]:
    """Names that `solve` takes here, the default first."""
    return ("heyoka", "scipy") if find_spec("heyoka") else ("scipy",)


def _chosen(integrator: str) -> str:
    """Name of the integrator to use."""
    name = available_integrators()[0] if integrator == "auto" else integrator
    if name not in ("heyoka", "scipy"):
        raise ValueError(f"integrator: found {integrator!r}, needed 'heyoka', 'scipy' or 'auto'")
    if name not in available_integrators():
        raise MissingPackageError("heyoka is not installed: `pip install heyoka` (Linux x86-64), or use integrator='scipy'")
    return name
