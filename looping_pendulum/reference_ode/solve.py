"""Solve the model: the functions that all other parts call."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from functools import cache
from importlib.util import find_spec
from typing import Any, TypeVar

import numpy as np

from looping_pendulum.errors import IntegratorFallbackWarning, IntegratorGaveUpError, MissingPackageError
from looping_pendulum.installation import install_command
from looping_pendulum.reference_ode.driver import Driver
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import Parameters
from looping_pendulum.reference_ode.solution import Run, Samples, Solution, join_samples

T = TypeVar("T")

# heyoka and SciPy then agree within 1e-9 m and s up to the halt, 1e-7 m to the end (tests/reference_ode/test_solve.py)
TOLERANCE = 1e-12
"""Default relative tolerance of a step."""
DURATION = 5.0
"""Default limit on the simulated time [s]; most runs end long before, when the light mass reaches the rod."""


def solve(
    parameters: Parameters, *, duration: float = DURATION, tolerance: float = TOLERANCE, integrator: str = "auto"
) -> Solution:
    """Integrate the equations of all modes from the release until the run ends or ``duration`` [s] is over.

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
        `IntegratorFallbackWarning`, and says so (`Run.handed_over`).

    Raises
    ------
    IntegrationError
        If the integration breaks down or the events do not end.
    MissingPackageError
        If heyoka is asked for by name and not installed.
    """
    solution = solve_without_warning(parameters, duration=duration, tolerance=tolerance, integrator=integrator)
    _warn_if_handed_over(solution)
    return solution


def solve_without_warning(
    parameters: Parameters, *, duration: float = DURATION, tolerance: float = TOLERANCE, integrator: str = "auto"
) -> Solution:
    """Do the same as `solve` without a warning if SciPy takes over; `Run.handed_over` says so."""
    record, segments = _run_driver(parameters, duration, tolerance, integrator, Driver.run_dense)
    return Solution(**record, segments=tuple(segments))


def solve_at(
    parameters: Parameters,
    t: Array,
    *,
    duration: float = DURATION,
    tolerance: float = TOLERANCE,
    integrator: str = "auto",
) -> Samples:
    """Integrate as `solve` does, but keep only samples at times ``t`` [s], ascending; this is faster for many runs.

    Times after the run's end are left out, so the samples may be fewer than the times.
    """
    times = np.asarray(t, dtype=float)
    record, parts = _run_driver(parameters, duration, tolerance, integrator, lambda driver: driver.run_sampled(times))
    run = Run(**record)
    _warn_if_handed_over(run)
    return join_samples(run, parts)


def _run_driver(
    parameters: Parameters, duration: float, tolerance: float, integrator: str, drive: Callable[[Driver], T]
) -> tuple[dict[str, Any], T]:
    """Run to the end; return the fields of the `Run`, and what ``drive`` returned.

    With integrator "auto", if heyoka gives up, SciPy solves the whole run again: near some ends Taylor steps become too short
    to arrive, while those of DOP853 do not.
    """
    chosen = _resolve_integrator(integrator)
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


def _warn_if_handed_over(run: Run) -> None:
    if run.handed_over:
        warnings.warn(IntegratorFallbackWarning(run.handed_over), stacklevel=3)


@cache
def available_integrators() -> tuple[str, ...]:
    """Return the integrators that are installed, the default first."""
    # Looked for, not imported, as the import is slow
    return ("heyoka", "scipy") if find_spec("heyoka") else ("scipy",)


def _resolve_integrator(integrator: str) -> str:
    """Return the name of the integrator to use; refuse one that is unknown or not installed."""
    name = available_integrators()[0] if integrator == "auto" else integrator
    if name not in ("heyoka", "scipy"):
        raise ValueError(f"integrator: found {integrator!r}, needed 'heyoka', 'scipy' or 'auto'")
    if name not in available_integrators():
        require_heyoka("integrator='heyoka'", instead="integrator='scipy'")
    return name


def require_heyoka(what: str, instead: str = "") -> None:
    """Raise `MissingPackageError` if heyoka, which ``what`` needs, is not installed; ``instead`` can do without it."""
    if "heyoka" not in available_integrators():
        way_out = f" (Linux only), or use {instead}" if instead else " (Linux only)"
        raise MissingPackageError(f"{what}: heyoka is not installed; to get it: `{install_command('heyoka')}`{way_out}")
