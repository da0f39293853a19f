"""Solve the model: the functions that all other parts call for one run."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from looping_pendulum.errors import IntegrationError, ParameterError
from looping_pendulum.reference_ode.core.host import FAILURES, Model, Runs, this_threads_core, traced
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import HasParameters, Parameters, parameters_of
from looping_pendulum.reference_ode.solution import Run, Samples, Solution, events_of, samples_at
from looping_pendulum.reference_ode.state import Effects, State
from looping_pendulum.reference_ode.transitions import Mode

# Runs then agree with Taylor series of order 20 in 80-bit numbers within 1e-10 m (tests/reference_ode/core)
TOLERANCE = 1e-12
"""Default relative tolerance of a step."""
DURATION = 5.0
"""Least default limit on the simulated time [s]; most runs end long before, when the light mass reaches the rod."""


def solve(parameters: Parameters | HasParameters, *, duration: float | None = None, tolerance: float = TOLERANCE) -> Solution:
    """Integrate the equations of all modes from the release until the run ends or ``duration`` [s] is over.

    Parameters
    ----------
    parameters
        Apparatus, release and coefficients; or a scenario, which has them.
    duration
        Limit on the simulated time [s]; None: `default_duration`.
    tolerance
        Relative tolerance of a step; 0.1 of it is the absolute one [m, m/s, rad].

    Raises
    ------
    ParameterError
        If the duration or the tolerance is no positive number.
    IntegrationError
        If the integration breaks down or the events do not end.
    MissingPackageError
        If wasmtime, which carries out runs, does not start on this system.
    """
    duration = default_duration(parameters) if duration is None else duration
    parameters = parameters_of(parameters)
    runs = carried_out(parameters, parameters.effects, np.zeros(0), duration, tolerance, dense=True)
    return Solution(
        parameters=parameters, tolerance=tolerance, events=events_of(runs.events), rows=runs.events, steps=runs.dense
    )


def solve_at(
    parameters: Parameters | HasParameters, t: ArrayLike, *, duration: float | None = None, tolerance: float = TOLERANCE
) -> Samples:
    """Integrate as `solve` does, but keep only samples at times ``t`` [s], ascending; this is faster for many runs.

    Times after the run's end are left out, so the samples may be fewer than the times.

    Raises
    ------
    ParameterError
        If the times descend.
    IntegrationError, MissingPackageError
        As `solve` does.
    """
    duration = default_duration(parameters) if duration is None else duration
    parameters, times = parameters_of(parameters), np.asarray(t, dtype=float)
    runs = carried_out(parameters, parameters.effects, times, duration, tolerance)
    run = Run(parameters=parameters, tolerance=tolerance, events=events_of(runs.events))
    count = int(runs.counts[0])
    return samples_at(run, runs.events, times[:count], State(*runs.samples[:count].T))


def default_duration(given: Parameters | HasParameters) -> float:
    """Return `DURATION`, or the duration of a scenario where it is longer: a run's end shows whether a stop is the halt [s]."""
    return DURATION if isinstance(given, Parameters) else max(DURATION, given.duration)


def carried_out(
    parameters: Parameters,
    effects: Effects,
    times: Array,
    duration: float,
    tolerance: float,
    *,
    max_steps: int = 0,
    seeds: Callable[[Model], Array] | None = None,
    dense: bool = False,
) -> Runs:
    """Carry out one run.

    Parameters
    ----------
    effects
        Effects that act, whether their coefficients are null or not.
    max_steps
        Number of steps in one mode after which a run fails; 0: the driver's own limit.
    seeds
        Returns `Core.carry_out`'s seeds for the model; None: no derivatives are wanted.

    Raises
    ------
    ParameterError
        If the times descend, or a limit is no number.
    IntegrationError
        If the run fails.
    """
    if not np.all(times[1:] >= times[:-1]):
        raise ParameterError("t: found times that descend, needed ascending ones; sort them first")
    model, values = traced(parameters.release, effects, seeds is not None), vars(parameters.values())
    runs = this_threads_core().carry_out(
        model,
        np.array([[values[name] for name in model.names]]),
        np.array([duration], dtype=float),
        times,
        np.array([0, len(times)], dtype=np.int32),
        tolerance=tolerance,
        max_steps=max_steps,
        seeds=None if seeds is None else seeds(model),
        dense=dense,
    )
    if runs.failures[0]:
        raise failure(runs, 0)
    return runs


def failure(runs: Runs, run: int) -> IntegrationError:
    """Return what went wrong in a run that failed, and where."""
    _, mode, t, *y = runs.events[runs.event_counts[: run + 1].sum() - 1].tolist()
    state = ", ".join(f"{name} {value:g}" for name, value in zip(State._fields, y, strict=False) if value)
    where = f"at t = {t:g} s, in mode {Mode(int(mode)).name.lower()}, with {state}"
    return IntegrationError(f"{FAILURES[int(runs.failures[run])]}, {where}; check the parameters")
