"""Solve the hybrid model: the functions that everything else calls."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from functools import cache
from importlib.util import find_spec
from typing import Any, TypeVar

import numpy as np

from looping_pendulum.errors import HandedOverWarning, IntegratorGaveUpError, MissingPackageError
from looping_pendulum.reference_ode.driver import Driver
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import Parameters
from looping_pendulum.reference_ode.solution import Run, Samples, Solution, join

T = TypeVar("T")

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
        "heyoka", "scipy", or "auto": heyoka where it is installed; a run at which it gives up is handed to SciPy, with a
        `HandedOverWarning`, and says so (`Run.handed_over`).

    Raises
    ------
    IntegrationError
        If the run breaks down or its events do not end.
    MissingPackageError
        If heyoka is asked for by name and not installed.
    """
    solution = solve_quietly(parameters, duration=duration, tolerance=tolerance, integrator=integrator)
    _warn(solution)
    return solution


def solve_quietly(
    parameters: Parameters, *, duration: float = DURATION, tolerance: float = TOLERANCE, integrator: str = "auto"
) -> Solution:
    """As `solve`; that a run was handed over only its `Run.handed_over` says."""
    record, segments = _driven(parameters, duration, tolerance, integrator, Driver.run_dense)
    return Solution(**record, segments=tuple(segments))


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
    times = np.asarray(t, dtype=float)
    record, parts = _driven(parameters, duration, tolerance, integrator, lambda driver: driver.run_sampled(times))
    run = Run(**record)
    _warn(run)
    return join(run, parts)


def _driven(
    parameters: Parameters, duration: float, tolerance: float, integrator: str, drive: Callable[[Driver], T]
) -> tuple[dict[str, Any], T]:
    """Drive a run to its end; return its record, and what ``drive`` returned.

    Where the choice of the integrator is ours, and heyoka gives up, SciPy goes over the whole run: near some ends Taylor
    steps become too short to arrive, and those of DOP853 do not.
    """
    chosen = _chosen(integrator)
    driver = Driver(parameters, duration, tolerance, chosen)
    try:
        driven = drive(driver)
    except IntegratorGaveUpError as error:
        if integrator != "auto" or chosen == "scipy":
            raise
        driver = Driver(parameters, duration, tolerance, "scipy")
        driven = drive(driver)
        return driver.record() | {"handed_over": f"{chosen} gave up ({error}), so SciPy solved this run"}, driven
    return driver.record(), driven


def _warn(run: Run) -> None:
    if run.handed_over:
        warnings.warn(HandedOverWarning(run.handed_over), stacklevel=3)


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
