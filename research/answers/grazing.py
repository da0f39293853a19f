"""Finds where, along a line of runs, the sequence of modes changes, and which event just begins or ceases to happen there.

A change is found by bisection between neighbours of a scan. On one of its sides an event is missing. Its function, which would
have had to fall through zero, has a least value on that side; that value goes to zero at the change: the event is grazed (the
least value lies within the interval) or comes too late (at its end, where another event ends the interval). Or the same event
leads on to another mode, because the rod just holds the string, or just does not.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from looping_pendulum.reference_ode.batch import solve_batch
from looping_pendulum.reference_ode.equations import Equations
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import Parameters
from looping_pendulum.reference_ode.solution import RunEvent, Solution
from looping_pendulum.reference_ode.solve import TOLERANCE, solve
from looping_pendulum.reference_ode.state import Signs
from looping_pendulum.reference_ode.transitions import PHASE_EVENTS, Event, Mode

SAMPLES_PER_INTERVAL = 400
"""Number of times between two events at which the least value of an event function is looked for, before it is refined."""
END_SHARE = 1e-3
"""Distance from the end of an interval, as a share of it, within which a least value counts as at the end."""
MIN_EVENT_SEPARATION = 1e-4
"""Time difference [s] above which events of the same kind in two neighbouring runs are different events."""
MAX_SINGLE_RUNS = 1000
"""Largest number of runs that are made one by one; a batch has to be compiled first."""
Sequence = tuple[tuple[Mode, ...], Event | None]
"""Modes of a run in order, and the event that ended it."""


@dataclass(frozen=True, kw_only=True)
class ParameterLine:
    """A line of runs that differ in one parameter."""

    base: Parameters
    name: str
    """Name of the parameter: a field or coefficient of `Parameters`."""
    duration: float
    """Limit on the simulated time [s]."""

    def run(self, value: float) -> Solution:
        """Return the run at ``value`` [SI], with the tolerance of `solve`."""
        return solve(self.base.replace(**{self.name: value}), duration=self.duration)


@dataclass(frozen=True, kw_only=True)
class SequenceChange:
    """A value of the parameter at which the sequence of modes changes."""

    low: float
    """Values below (`low`) and above (`high`) the change [SI], as close as bisection came."""
    high: float
    sequences: tuple[Sequence, Sequence]
    """Sequences of modes below and above."""
    halting_times: tuple[float | None, float | None]
    """Halting times below and above [s]."""
    event: Event
    """Event that just begins or ceases to happen, or to lead to another mode."""
    kind: str
    """"graze": the event function just reaches zero; "race": another event ends the mode first; "choice": the rod just holds
    the string."""
    rival: Event
    """Event that happens instead; for a choice, the event itself."""
    missing_below: bool
    """Whether the event is missing (or the string held) below the change rather than above it."""
    position: int
    """Index of that event among those that end a mode, the release being 0."""
    time: float
    """Time of the event [s]."""
    quantity: float
    """Quantity that is zero at the change, on the side without the event: least value of its function, or the margin."""
    gap: float
    """Largest distance between the positions of a mass in the two runs at equal times [m]."""


def sequence(run: Solution) -> Sequence:
    """Return the modes of a run and the event that ended it."""
    return run.modes, run.end.event


def find_changes(line: ParameterLine, values: Array, *, width: float) -> list[SequenceChange]:
    """Find the changes between neighbouring ``values`` [SI], ascending, each to within ``width`` [SI].

    Two changes between neighbours that cancel each other are not found; a finer scan shows whether there are any.
    """
    codes = _codes(line, values)
    different = [i for i in range(len(values) - 1) if codes[i] != codes[i + 1]]
    changes: list[SequenceChange] = []
    for i in different:
        low, high = float(values[i]), float(values[i + 1])
        for bracket in _brackets(line, low, high, sequence(line.run(low)), sequence(line.run(high)), width):
            changes.append(explain(line, *bracket))
    return changes


def _codes(line: ParameterLine, values: Array) -> list[object]:
    """Return a value for each run that is equal for runs with equal sequences."""
    if len(values) <= MAX_SINGLE_RUNS:
        return [sequence(line.run(float(value))) for value in values]
    scanned = solve_batch(line.base, {line.name: values}, duration=line.duration, tolerance=TOLERANCE)
    return list(zip(scanned.sequence.tolist(), scanned.end.tolist(), strict=True))


def _brackets(
    line: ParameterLine, low: float, high: float, below: Sequence, above: Sequence, width: float
) -> Iterator[tuple[float, float]]:
    """Bisect until every change between ``low`` and ``high`` has a bracket of its own, at most ``width`` wide."""
    middle = 0.5 * (low + high)
    # Between two neighbouring floats there is no third
    if high - low <= width or middle in (low, high):
        yield low, high
        return
    between = sequence(line.run(middle))
    # A middle that differs from both ends has a change on either side
    if between != below:
        yield from _brackets(line, low, middle, below, between, width)
    if between != above:
        yield from _brackets(line, middle, high, between, above, width)


def explain(line: ParameterLine, low: float, high: float) -> SequenceChange:
    """Return which event makes the two runs differ, and the quantity that passes zero there."""
    runs = line.run(low), line.run(high)
    lists = [_ending_modes(run) for run in runs]
    k = next(i for i, pair in enumerate(zip(*lists, strict=False)) if _differ(*pair))
    first = lists[0][k], lists[1][k]  # the first event in which the runs differ
    assert first[0].event is not None
    assert first[1].event is not None
    if first[0].event is first[1].event and abs(first[0].time - first[1].time) < MIN_EVENT_SEPARATION:
        held = 0 if first[0].mode_after is Mode.STICKING else 1
        event, kind, missing = first[0].event, "choice", held
        quantity = min(_margins(runs[held], first[held]))
        rival, time = event, first[held].time
    else:
        missing = 1 if first[0].time <= first[1].time else 0  # the earlier event is the one that the other run lacks
        other = first[1 - missing].event
        assert other is not None
        event, rival = other, first[missing].event or other
        # Until the event before, both runs have done the same
        start = lists[missing][k - 1].time
        quantity, time, share = least_value(runs[missing], event, start, _until(event, first[1 - missing].time, first[missing]))
        kind = "race" if share > 1 - END_SHARE else "graze"
    return SequenceChange(
        low=low,
        high=high,
        sequences=(sequence(runs[0]), sequence(runs[1])),
        halting_times=(runs[0].halting_time, runs[1].halting_time),
        event=event,
        kind=kind,
        rival=rival,
        missing_below=missing == 0,
        position=k,
        time=time,
        quantity=quantity,
        gap=gap(*runs),
    )


def _differ(a: RunEvent, b: RunEvent) -> bool:
    return (a.event, a.mode_after) != (b.event, b.mode_after) or abs(a.time - b.time) > MIN_EVENT_SEPARATION


def _until(event: Event, time: float, ending: RunEvent) -> float:
    """Return the end of the interval in which ``event``, expected near ``time`` [s], is missing; it may occur again later."""
    return 0.5 * (time + ending.time) if ending.event is event else ending.time


def approach(line: ParameterLine, change: SequenceChange, distances: Array) -> Array:
    """Return the quantity that is zero at ``change``, at ``distances`` [SI] from it on the side where the event is missing."""
    values = change.low - distances if change.missing_below else change.high + distances
    return np.array([_quantity_at(line, change, float(value)) for value in values])


def _quantity_at(line: ParameterLine, change: SequenceChange, value: float) -> float:
    run = line.run(value)
    events, k = _ending_modes(run), change.position
    common = change.sequences[0][0][:k]
    if run.modes[:k] != common or len(events) <= k:
        return math.nan  # another change lies between
    if change.kind == "choice":
        return min(_margins(run, events[k]))
    return least_value(run, change.event, events[k - 1].time, _until(change.event, change.time, events[k]))[0]


def _ending_modes(run: Solution) -> list[RunEvent]:
    return [e for e in run.events if e.event not in PHASE_EVENTS]


def _margins(run: Solution, event: RunEvent) -> tuple[float, float]:
    """Return by how much the rod holds the string against sliding down and up, at an event that stops it [N]."""
    equations = Equations(math, run.parameters.values(), run.parameters.effects)
    begin = max(e.time for e in run.events if e.time < event.time)
    down, up = equations.holding_margins(Mode.STICKING, event.time, event.state, _mode_and_signs(run, begin, event.time)[1])
    return float(down), float(up)


def least_value(run: Solution, event: Event, start: float, end: float) -> tuple[float, float, float]:
    """Return the least value of the function of ``event`` between two times [s], its time, and its share of the interval.

    A slide starts from a stop, and slack from zero tension: the functions are zero there, which does not count.
    """
    from scipy.optimize import minimize_scalar

    best = (math.inf, end)
    from_zero = event in (Event.STOP, Event.TAUT)
    for before, after in zip(run.events, run.events[1:], strict=False):
        low, high = max(start, before.time), min(end, after.time)
        if low >= high:
            continue
        # Just before an event, as at its very time the motion after it begins
        t = np.linspace(low, np.nextafter(high, low), SAMPLES_PER_INTERVAL)
        mode, signs = _mode_and_signs(run, before.time, after.time)
        values = _event_function(run, mode, signs, event, t)
        first_counts = not (from_zero and t[0] == start)  # exact: an interval begins at the very time of an event
        candidates = [(float(values[i]), float(t[i])) for i in ((0, -1) if first_counts else (-1,))]
        for i in 1 + np.flatnonzero((values[1:-1] <= values[:-2]) & (values[1:-1] <= values[2:])):
            refined = minimize_scalar(
                lambda x, mode=mode, signs=signs: float(_event_function(run, mode, signs, event, np.array([x]))[0]),
                bounds=(t[i - 1], t[i + 1]),
                method="bounded",
                # SciPy's default, 1e-5 s, would leave the least value too large near a change, where it goes to zero
                options={"xatol": 1e-13},
            )
            candidates.append((float(refined.fun), float(refined.x)))
        best = min(best, *candidates)
    return best[0], best[1], (best[1] - start) / (end - start)


def _mode_and_signs(run: Solution, begin: float, end: float) -> tuple[Mode, Signs]:
    """Return the mode and the signs between two events that follow one another, at these times [s]."""
    middle = run.sample(np.array([0.5 * (begin + end)]))
    return Mode(middle.mode[0]), Signs(*(float(sign[0]) for sign in middle.signs))


def _event_function(run: Solution, mode: Mode, signs: Signs, event: Event, t: Array) -> Array:
    """Evaluate the function of ``event`` in ``mode``, without the condition that a stop or a pull has to arm first."""
    equations = Equations(np, run.parameters.values(), run.parameters.effects)
    # In phase 1 the events themselves are watched for, not what has to come before them
    functions = equations.event_functions(mode, t, run.sample(t).state, signs._replace(phase=1.0))
    return np.broadcast_to(functions[event], t.shape)


def gap(a: Solution, b: Solution) -> float:
    """Return the largest distance between the positions of a mass at equal times [m], while both runs last."""
    t = np.linspace(0.0, min(a.end_time, b.end_time), 10 * SAMPLES_PER_INTERVAL)[:-1]
    first, second = a.sample(t), b.sample(t)
    light, heavy = first.light_position - second.light_position, first.heavy_position - second.heavy_position
    return float(max(np.hypot(*light.T).max(), np.hypot(*heavy.T).max()))
