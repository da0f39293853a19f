"""Carry out the rules of the model in a plain Python loop, one mode after another: the driver of the checks.

It shares `Equations` and `rules` with the package's core and nothing else, so that the core can be compared with it. What
integrates a mode is an argument: heyoka's Taylor series (`heyoka_runs`), or SciPy's DOP853 (`tests/oracles/scipy_runs.py`).
"""

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from looping_pendulum.errors import IntegrationError
from looping_pendulum.reference_ode import rules
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import Parameters
from looping_pendulum.reference_ode.solution import Run, RunEvent, Samples
from looping_pendulum.reference_ode.state import Motion, Signs, State
from looping_pendulum.reference_ode.transitions import Event, Mode

MAX_EVENTS = 4000
"""Number of events after which a run is given up as endless."""
_RETREAT_SPEED, _HEAVY_SPEED = State._fields.index("retreat_speed"), State._fields.index("heavy_speed")


def fill_in_heavy_speed(mode: Mode, names: tuple[str, ...], full: Array) -> None:
    """Set the heavy speed to u in an array of states, shape (len(State), n), where it is not integrated itself."""
    if mode.string_moves and "heavy_speed" not in names:
        full[_HEAVY_SPEED] = full[_RETREAT_SPEED]


class ModeIntegrator(Protocol):
    """Integrates one mode until one of its events."""

    number_type: Any
    """Type of the numbers of the run."""

    def advance(self, m: Motion, until: float, times: Array) -> tuple[Event, Any, State, Array]:
        """Integrate from ``m`` until an event, or the time ``until`` [s].

        Returns
        -------
        event, t, y
            The event (TIME_UP at ``until``), its time [s] and the state just before its rule is applied.
        values
            Whole states at those ``times`` [s], all later than ``m``, that were reached, shape (len(State), n).
        """


@dataclass(frozen=True, kw_only=True)
class Part:
    """Samples of a run between two events."""

    mode: Mode
    signs: Signs
    t: Array
    """Times [s], shape (n,)."""
    values: Array
    """Every entry of the state, shape (len(State), n)."""


def drive(
    system: rules.HybridSystem, released: Motion, integrator: ModeIntegrator, times: Array, duration: float
) -> tuple[list[RunEvent], list[Part]]:
    """Run from the motion just after release to the end; return all events, and samples at ``times`` [s], ascending, in parts.

    Raises
    ------
    IntegrationError
        If the events do not end.
    """
    number = integrator.number_type

    def numbers(values: Any) -> Array:
        return np.array([number(v) for v in values], dtype=number)

    times = times[times <= duration]
    events = [RunEvent(None, released.t, released.mode, released.mode, released.y)]
    t = times[times == 0]
    at_release = np.repeat(numbers(released.y)[:, None], len(t), axis=1)
    parts = [Part(mode=released.mode, signs=released.signs, t=t, values=at_release)]
    motion, series, by_series = rules.leave_rest(system, rules.enter(system, released))
    if by_series:
        t = times[(times > 0) & (times <= rules.REST_SERIES_DURATION)]
        x = numbers(t) / number(rules.REST_SERIES_DURATION)
        constant, linear, square = (numbers(term)[:, None] for term in series)
        parts.append(Part(mode=motion.mode, signs=motion.signs, t=t, values=constant + x * (linear + x * square)))
    while motion.mode is not Mode.ENDED:
        if len(events) > MAX_EVENTS:
            raise IntegrationError(f"more than {MAX_EVENTS} events at t = {float(motion.t):g} s; check the parameters")
        # "right": the part before has the sample at the very time of an event
        later = times[times.searchsorted(float(motion.t), side="right") :]
        event, t, y, values = integrator.advance(motion, duration, later)
        parts.append(Part(mode=motion.mode, signs=motion.signs, t=later[: values.shape[1]], values=values))
        before = motion.mode
        motion = rules.apply_event(system, before, event, motion._replace(t=t, y=y))
        events.append(RunEvent(event, motion.t, before, motion.mode, motion.y))
    return events, parts


def join(parameters: Parameters, tolerance: float, events: list[RunEvent], parts: list[Part]) -> Samples:
    """Return all samples of a run."""
    counts = [len(part.t) for part in parts]
    signs = np.concatenate(
        [np.repeat(np.array(part.signs)[:, None], n, axis=1) for part, n in zip(parts, counts, strict=True)], axis=1
    )
    return Samples(
        run=Run(parameters=parameters, tolerance=tolerance, events=tuple(events)),
        t=np.concatenate([part.t for part in parts]),
        state=State(*np.concatenate([part.values for part in parts], axis=1)),
        mode=np.repeat([part.mode.value for part in parts], counts).astype(np.int8),
        signs=Signs(*signs),
    )
