"""First derivatives of a run by its parameters, which the driver integrates beside the run (see docs/derivation.md)."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import SimpleNamespace
from typing import Any

import numpy as np

from looping_pendulum.errors import IntegrationError, ParameterError
from looping_pendulum.reference_ode.batch import SWITCH_COEFFICIENTS
from looping_pendulum.reference_ode.core.host import MAX_COLUMNS, Model, Runs
from looping_pendulum.reference_ode.effects import COEFFICIENTS
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import HasParameters, Parameters, Release, parameters_of
from looping_pendulum.reference_ode.solution import (
    Run,
    Samples,
    events_of,
    heavy_mass_position,
    light_mass_position,
    samples_at,
)
from looping_pendulum.reference_ode.solve import DURATION, TOLERANCE, carried_out
from looping_pendulum.reference_ode.state import Effects, State

COMPLEX_STEP = 1e-30
"""Imaginary step by which positions are differentiated: without a difference, nothing is lost to rounding."""


class SensitivityError(IntegrationError):
    """A derivative does not exist."""


@dataclass(frozen=True, kw_only=True)
class Sensitivities:
    """Derivatives of a run by m parameters ``wrt`` at the times of its n samples. SI."""

    wrt: tuple[str, ...]
    """Names of the parameters."""
    samples: Samples
    """The run itself."""
    state: State
    """Derivatives of every entry of the state at fixed time, each of shape (m, n)."""
    event_times: Array
    """Derivatives of the times of all events of the run, shape (events, m); 0 for the release and for TIME_UP."""
    end_state: State
    """Derivatives of every entry of the state at the run's end, whose time moves, each of shape (m,)."""

    def and_end(self) -> Sensitivities:
        """Return the same with the end of the run as the last sample; the derivatives there are those of `end_state`."""
        columns = zip(self.state, self.end_state, strict=True)
        return dataclasses.replace(
            self,
            samples=self.samples.and_end(),
            state=State(*(np.column_stack([values, at_end]) for values, at_end in columns)),
        )

    @cached_property
    def light_position(self) -> Array:
        """Derivatives of the light mass's position [m per unit of the parameter], shape (n, 2, m)."""
        return self._position_derivatives(light_mass_position)

    @cached_property
    def heavy_position(self) -> Array:
        """Derivatives of the heavy mass's position [m per unit of the parameter], shape (n, 2, m)."""
        return self._position_derivatives(heavy_mass_position)

    def _position_derivatives(self, place: Callable[..., tuple[Any, Any]]) -> Array:
        samples, given = self.samples, self.samples.run.parameters
        state = State(*(v + 1j * COMPLEX_STEP * d for v, d in zip(samples.state, self.state, strict=True)))
        numbers = dict(vars(given.values()))
        for name, column in zip(self.wrt, np.eye(len(self.wrt)), strict=True):
            for moved in moves_with(given, name, self.wrt):
                numbers[moved] = numbers[moved] + 1j * COMPLEX_STEP * column[:, None]
        # An effect that is absent may move a mass, too
        acting = given.effects_with(frozenset(self.wrt) & given.coefficients.keys())
        parts = place(np, state, samples.signs.overlap, SimpleNamespace(**numbers), acting)
        shape = (len(self.wrt), len(samples.t))
        return np.stack([np.broadcast_to(np.imag(x) / COMPLEX_STEP, shape) for x in parts]).transpose(2, 0, 1)


def solve_sensitivities(
    parameters: Parameters | HasParameters,
    t: Array,
    wrt: Sequence[str],
    *,
    duration: float = DURATION,
    tolerance: float = TOLERANCE,
) -> Sensitivities:
    """Solve as `solve_at` does, and return the derivatives by the parameters ``wrt`` at the times ``t`` [s], ascending.

    A parameter changes as in `Parameters.replace`: the kinetic friction takes the static one along where they are equal, unless
    ``wrt`` has both. The coefficient of an effect that is absent, at its null value, is allowed, too. The sequence of events is
    taken as fixed.

    Parameters
    ----------
    wrt
        Names of fields or coefficients of ``parameters``.

    Raises
    ------
    ParameterError
        If a name is no field or coefficient of ``parameters``, or occurs twice.
    SensitivityError
        If a derivative does not exist: an event is only grazed, or the motion changes its kind at the value of a parameter.
    """
    parameters, times, wrt = parameters_of(parameters), np.asarray(t, dtype=float), tuple(wrt)
    _check_wrt(parameters, wrt)
    runs = run_with_derivatives(parameters, times, wrt, duration=duration, tolerance=tolerance).runs
    run, count = Run(parameters=parameters, tolerance=tolerance, events=events_of(runs.events)), int(runs.counts[0])
    for event, slopes in zip(run.events, runs.event_partials, strict=True):
        if not np.isfinite(slopes).all():
            where = f"where the event {event.event} is grazed, not crossed"
            raise SensitivityError(f"no derivatives beyond t = {event.time:g} s, {where}")
    return Sensitivities(
        wrt=wrt,
        samples=samples_at(run, runs.events, times[:count], State(*runs.samples[:count].T)),
        state=State(*runs.partials[:count].transpose(1, 2, 0)),
        event_times=runs.event_partials,
        end_state=State(*runs.end_partials[0]),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class DifferentiatedRun:
    """A run at n given times, with its derivatives by m parameters; past its end they are those of its end."""

    parameters: Parameters
    wrt: tuple[str, ...]
    """Names of the m parameters."""
    t: Array
    """Times [s], shape (n,)."""
    runs: Runs
    """What the driver returned; its derivatives are nan where none exist."""

    @property
    def effects(self) -> Effects:
        """Effects that act, those included whose coefficients are among ``wrt`` and null."""
        return self.parameters.effects_with(self.parameters.coefficients.keys() & set(self.wrt))

    @cached_property
    def rates(self) -> Array:
        """Derivatives of the state's entries by time, shape (entries, n); 0 past the run's end."""
        run = Run(parameters=self.parameters, tolerance=TOLERANCE, events=events_of(self.runs.events))
        rates = np.array(samples_at(run, self.runs.events, self.t, State(*self.runs.samples.T)).rates)
        rates[:, self.runs.counts[0] :] = 0.0
        return rates


def run_with_derivatives(
    parameters: Parameters, t: Array, wrt: Sequence[str], *, duration: float, tolerance: float, max_steps: int = 0
) -> DifferentiatedRun:
    """Carry out a run with its derivatives by the parameters ``wrt``, as `solve_sensitivities` does.

    Where none exist they are nan: after an event that is only grazed, and by what `changes_kind` of the motion.

    Parameters
    ----------
    max_steps
        Number of steps in one mode after which the run fails; 0: the driver's own limit.
    """
    if len(wrt) > MAX_COLUMNS:
        raise ParameterError(f"wrt: found {len(wrt)} names, needed at most {MAX_COLUMNS}")
    values = vars(parameters.values())
    missing = np.array([changes_kind(name, values, parameters.release) for name in wrt], dtype=bool)
    # The equations of an effect that sets in may divide by its coefficient
    acting = {name for name, is_missing in zip(wrt, missing, strict=True) if name in parameters.coefficients and not is_missing}
    runs = carried_out(
        parameters, parameters.effects_with(acting), t, duration, tolerance,
        max_steps=max_steps, seeds=lambda model: _seeds_of(model, parameters, wrt),
    )  # fmt: skip
    for derivatives in (runs.partials, runs.event_partials, runs.end_partials):
        derivatives[..., missing] = np.nan
    return DifferentiatedRun(parameters=parameters, wrt=tuple(wrt), t=t, runs=runs)


def _check_wrt(parameters: Parameters, wrt: tuple[str, ...]) -> None:
    """Refuse names that are unknown or repeated, and parameters by which no derivative exists at their value."""
    known = {f.name for f in dataclasses.fields(parameters)} - {"coefficients", "release", "own_effects"} | set(
        parameters.coefficients
    )
    for name in wrt:
        if name not in known:
            raise ParameterError(f"wrt: found {name!r}, needed one of {', '.join(sorted(known))}")
        if wrt.count(name) > 1:
            raise ParameterError(f"wrt: found {name!r} more than once, needed it once")
        if changes_kind(name, vars(parameters.values()), parameters.release):
            raise SensitivityError(
                f"wrt {name}: no derivative at its value, where the motion changes its kind; give it another"
            )


def changes_kind(name: str, values: Mapping[str, Any], release: Release) -> Any:
    """Return whether the motion changes its kind at the value of a parameter, so that it has no derivative by that.

    There its effect sets in, a light mass is a point, or a taut string goes slack.
    """
    if name in SWITCH_COEFFICIENTS:
        return values[name] == COEFFICIENTS[name].null
    is_kink = name == "light_radius" or (name == "push_along" and release is not Release.DROP)
    return (values[name] == 0) & is_kink


def moves_with(base: Parameters, name: str, wrt: Sequence[str]) -> tuple[str, ...]:
    """Return the parameters that change with ``name``, one of ``wrt``, as in `Parameters.replace`."""
    if name == "release_angle" and base.release is Release.VERTICAL:  # which keeps its angle
        return ()
    follows = name == "kinetic_friction" and base.static_equals_kinetic and "static_friction" not in wrt
    return (name, "static_friction") if follows else (name,)


def _seeds_of(model: Model, base: Parameters, wrt: Sequence[str]) -> Array:
    """Return the derivatives of a model's parameters by those named ``wrt``, shape (parameters, len(wrt))."""
    seeds = np.zeros((len(model.names), len(wrt)))
    for column, name in enumerate(wrt):
        for moved in moves_with(base, name, wrt):
            if moved in model.names:
                seeds[model.names.index(moved), column] = 1.0
    return seeds
