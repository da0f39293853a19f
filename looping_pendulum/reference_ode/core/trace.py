"""Traces the equations and rules of one model: which functions the driver needs of it, and the table that tells their places.

`Equations` and `rules` are run as they are, on symbols, for exactly the effects that act. What comes out is a `TracedModel`:
the functions, each a list of outputs, and an int32 table that has the layout of ``Model`` and ``Mode`` in `driver.c`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from looping_pendulum.reference_ode import rules
from looping_pendulum.reference_ode.core.expressions import Expression, ExpressionGraph, ExpressionMath, possible_values
from looping_pendulum.reference_ode.core.gradients import slopes_of
from looping_pendulum.reference_ode.effects import EFFECTS, EffectKind
from looping_pendulum.reference_ode.equations import Equations
from looping_pendulum.reference_ode.parameters import NUMBERS, Parameters, Release, derived_values
from looping_pendulum.reference_ode.rules import HybridSystem
from looping_pendulum.reference_ode.state import Effects, Motion, Signs, State, event_in_phase, full_state, variables
from looping_pendulum.reference_ode.transitions import END_EVENTS, PHASE_ZERO, Event, Mode

EVENTS = tuple(Event)
"""The code of an event in the driver's rows is its place here."""
CONTINUOUS_EVENTS = frozenset({*PHASE_ZERO.values(), Event.ROD_SLOWS})
"""Events that only change which function is watched: neither the state nor its rates jump."""
MAX_EVENTS_OF_MODE = 12
"""Number of event functions for which a mode has room in the table."""
NO_STRUCTURE = 0


class _ModeRow(NamedTuple):
    """Layout of ``Mode`` in `driver.c`: the number of entries of each of its fields, in their order."""

    variables: int = 1
    places: int = 15
    heavy_follows: int = 1
    events: int = 1
    rates: int = 1
    event_values: int = 1
    jacobian: int = 1
    jacobian_structure: int = 1
    each: int = MAX_EVENTS_OF_MODE
    gradient: int = MAX_EVENTS_OF_MODE
    gradient_structure: int = MAX_EVENTS_OF_MODE
    of_rod: int = MAX_EVENTS_OF_MODE
    apply: int = 2 * MAX_EVENTS_OF_MODE
    apply_jacobian: int = 2 * MAX_EVENTS_OF_MODE
    apply_structure: int = 2 * MAX_EVENTS_OF_MODE
    code: int = 2 * MAX_EVENTS_OF_MODE
    ends: int = 2 * MAX_EVENTS_OF_MODE
    continuous: int = 2 * MAX_EVENTS_OF_MODE


_HEADER = ("release", "release_jacobian", "release_structure", "parameters", "values")
_MODE_SIZE = sum(_ModeRow())
_PLACES = dict(zip(_ModeRow._fields, np.cumsum([0, *_ModeRow()]).tolist(), strict=False))


# Compared and hashed by identity
@dataclass(frozen=True, kw_only=True, eq=False)
class TracedModel:
    """Functions of a model, in the order in which they are put into the driver's table of functions."""

    names: tuple[str, ...]
    """Names of the parameters that its functions read, in their order."""
    functions: tuple[tuple[Any, ...], ...]
    """Outputs of each function."""
    table: NDArray[np.int32]
    """``Model`` of `driver.c`; functions by their place in ``functions``, structures by their place in the table."""


class SymbolicSystem(HybridSystem):
    """The equations of one run on expressions; the mode may be a choice between several."""

    def __init__(self, graph: ExpressionGraph, p: SimpleNamespace, effects: Effects) -> None:
        super().__init__(Equations(ExpressionMath(graph), p, effects))
        self._graph = graph

    def where(self, condition: Any, a: Any, b: Any) -> Any:
        """Return the number ``a`` where ``condition`` holds, else ``b``."""
        return self._graph.where(condition, a, b)

    def choose(self, condition: Any, a: Motion, b: Motion) -> Motion:
        """Return the motion ``a`` where ``condition`` holds, else ``b``."""
        return Motion(
            mode=self.where(condition, a.mode, b.mode),
            t=self.where(condition, a.t, b.t),
            y=State(*self._each(condition, a.y, b.y)),
            signs=Signs(*self._each(condition, a.signs, b.signs)),
        )

    def _each(self, condition: Any, a: tuple[Any, ...], b: tuple[Any, ...]) -> list[Any]:
        return [self.where(condition, x, y) for x, y in zip(a, b, strict=True)]

    def rates(self, m: Motion) -> State:
        """Return the derivatives of the state by time."""
        return State(*self._in_each_mode(m, self.equations.rates))

    def tensions(self, m: Motion) -> tuple[Any, Any]:
        """Return the tensions in the free string and above the heavy mass [N]."""
        light, heavy = self._in_each_mode(m, self.equations.tensions)
        return light, heavy

    def holding_margins(self, m: Motion) -> tuple[Any, Any]:
        """Return by how much the tensions are inside the friction cone, (down, up) [N]."""
        down, up = self._in_each_mode(m, self.equations.holding_margins)
        return down, up

    def _in_each_mode(self, m: Motion, function: Callable[..., tuple[Any, ...]]) -> list[Any]:
        """Return what ``function`` gives in the mode of ``m``, which may be a choice between several."""
        modes = [Mode(value) for value in possible_values(m.mode)]
        result = list(function(modes[-1], *m[1:]))
        for mode in modes[:-1]:
            result = self._each(m.mode == mode, function(mode, *m[1:]), tuple(result))
        return result


class Symbols:
    """Symbols of a model, and the equations over them.

    Parameters
    ----------
    names
        Parameters that are symbols; the coefficients of all other effects are their null values, which are numbers, so that
        nothing is left of their terms.
    effects
        Effects that act.
    """

    def __init__(self, names: Sequence[str], effects: Effects) -> None:
        self.graph = ExpressionGraph()
        self.inputs = [self.graph.symbol(f"p{i}") for i in range(len(names))]
        absent = {c.name: c.null for effect in EFFECTS.values() for c in effect.coefficients}
        values = absent | dict(zip(names, self.inputs, strict=True))
        self.p = SimpleNamespace(**values | derived_values(values, self.graph.where))
        self.t = self.graph.symbol("t")
        self.y = State(*(self.graph.symbol(f"y{i}") for i in range(len(State._fields))))
        self.signs = Signs(*(self.graph.symbol(f"s{i}") for i in range(len(Signs._fields))))
        self.system = SymbolicSystem(self.graph, self.p, effects)

    def parameters(self, release: Release | None = None) -> Parameters:
        """Return what stands for `Parameters` in functions that read its numbers."""
        stand_in: Any = SimpleNamespace(
            **vars(self.p), release=release, coefficients=vars(self.p), effects=self.system.effects, values=lambda: self.p
        )
        return cast(Parameters, stand_in)


def parameter_names(effects: Effects) -> tuple[str, ...]:
    """Return the names of the parameters that a model with these effects reads."""
    return tuple(dict.fromkeys([*NUMBERS, "push_along", "push_across", *(c.name for e in effects for c in e.coefficients)]))


def possible_modes(release: Release, effects: Effects) -> tuple[Mode, ...]:
    """Return the modes that can occur after a release."""
    if release is Release.DROP:
        return (Mode.FALLING,)
    if release is Release.HELD:
        return Mode.CLAMPED, Mode.CLAMPED_SLACK
    rolling = (Mode.ROLLING,) if any("rod_speed" in e.variables for e in effects) else ()
    return Mode.STICKING, Mode.SLIDING_DOWN, Mode.SLIDING_UP, Mode.SLACK, *rolling


def trace(release: Release, effects: Effects, *, derivatives: bool) -> TracedModel:
    """Return the functions of a model, with all their derivatives by state, time and parameters if these are wanted."""
    tracer = _Tracer(release, effects, derivatives)
    tracer.release()
    for mode in possible_modes(release, effects):
        tracer.mode(mode)
    return tracer.traced()


class _Tracer:
    def __init__(self, release: Release, effects: Effects, derivatives: bool) -> None:
        self._release, self._derivatives = release, derivatives
        self._names = parameter_names(effects)
        # A push at release is in no equation
        self._effects = tuple(e for e in effects if e.kind is not EffectKind.RELEASE)
        # One graph for all functions, as making the symbols takes as long as most functions
        self._symbols = Symbols(self._names, self._effects)
        self._functions: list[tuple[Any, ...]] = []
        self._header = dict.fromkeys(_HEADER, 0) | {"parameters": len(self._names)}
        self._modes = np.zeros((len(Mode), _MODE_SIZE), dtype=np.int32)
        self._structures: list[int] = []
        self._slopes: dict[int, dict[int, Any]] = {}
        """Number of an output -> `slopes_of` it: what happens at an event is the same in several modes."""

    def traced(self) -> TracedModel:
        """Return what was traced."""
        table = np.concatenate([list(self._header.values()), self._modes.ravel(), self._structures])
        return TracedModel(names=self._names, functions=tuple(self._functions), table=table.astype(np.int32))

    def release(self) -> None:
        """Trace the release, and the series by which a run leaves rest."""
        symbols, system = self._symbols, self._symbols.system
        y = rules.state_at_release(symbols.parameters(self._release))
        released = rules.release(system, self._release, y)
        after, series, by_series = rules.leave_rest(system, rules.enter(system, released))
        outputs = [*_flat(released), *_flat(after), system.where(by_series, 1.0, 0.0), *(x for term in series for x in term)]
        self._header["release"] = self._put(outputs)
        if self._derivatives:
            rows = [self._gradient(x, symbols.inputs) for x in (*released.y, *after.y)]
            self._header["release_jacobian"], self._header["release_structure"] = self._put_jacobian([], rows, 0)

    def mode(self, mode: Mode) -> None:
        """Trace rates, event functions and what each event does in one mode."""
        row = self._modes[mode]
        names = variables(mode, self._effects)
        _fill(row, "variables", [len(names)])
        _fill(row, "places", [State._fields.index(name) for name in names])
        _fill(row, "heavy_follows", [mode.string_moves and "heavy_speed" not in names])
        symbols, y = self._symbols, self._integrated_state(mode, names)
        rates = symbols.system.equations.rates(mode, symbols.t, y, symbols.signs)
        outputs = [getattr(rates, name) for name in names]
        inputs = [*symbols.y[: len(names)], *symbols.inputs]
        _fill(row, "rates", [self._put(outputs)])
        if self._derivatives:
            placed = self._put_jacobian(outputs, [self._gradient(x, inputs) for x in outputs], len(names))
            _fill(row, "jacobian", placed[:1])
            _fill(row, "jacobian_structure", placed[1:])
        functions = symbols.system.equations.event_functions(mode, symbols.t, y, symbols.signs)
        _fill(row, "events", [len(functions)])
        _fill(row, "event_values", [self._put(list(functions.values()))])
        _fill(row, "each", [self._put([x]) for x in functions.values()])
        if self._derivatives:
            placed_all = [
                self._put_jacobian(self._gradient(x, [symbols.t]), [self._gradient(x, inputs)], len(names))
                for x in functions.values()
            ]
            _fill(row, "gradient", [place for place, _ in placed_all])
            _fill(row, "gradient_structure", [structure for _, structure in placed_all])
        self._events(mode, list(functions))

    def _integrated_state(self, mode: Mode, names: Sequence[str]) -> State:
        """Return the whole state from the entries that ``mode`` integrates, which are y0, y1 ...."""
        return full_state(mode, **dict(zip(names, self._symbols.y, strict=False)))

    def _events(self, mode: Mode, functions: Sequence[Event]) -> None:
        row = self._modes[mode]
        phases = [Signs(*[0.0] * len(Signs._fields))._replace(phase=x, rod=1.0, rod_phase=x) for x in (0.0, 1.0)]
        announced = [tuple(event_in_phase(event, signs) for signs in phases) for event in functions]
        flat = [event for pair in announced for event in pair]
        applied = {event: self._apply(mode, event) for event in dict.fromkeys(flat)}
        _fill(row, "of_rod", [pair[1] in (Event.ROD_CHANGES, Event.ROD_STOPS) for pair in announced])
        for i, field in enumerate(("apply", "apply_jacobian", "apply_structure")):
            _fill(row, field, [applied[event][i] for event in flat])
        _fill(row, "code", [EVENTS.index(event) for event in flat])
        _fill(row, "ends", [event in END_EVENTS for event in flat])
        _fill(row, "continuous", [event in CONTINUOUS_EVENTS for event in flat])

    def _apply(self, mode: Mode, event: Event) -> tuple[int, int, int]:
        """Trace what ``event`` does; return the places of the function, its Jacobian and the structure of that."""
        symbols = self._symbols
        after = rules.apply_event(symbols.system, mode, event, Motion(mode, symbols.t, symbols.y, symbols.signs))
        function = self._put(_flat(after))
        if not self._derivatives or event in END_EVENTS:
            return function, 0, NO_STRUCTURE
        inputs = [*symbols.y, *symbols.inputs]
        return function, *self._put_jacobian([], [self._gradient(x, inputs) for x in after.y], len(State._fields))

    def _gradient(self, output: Any, inputs: Sequence[Expression]) -> list[Any]:
        """Return the derivatives of a number or an expression by ``inputs``."""
        if not isinstance(output, Expression):
            return [0.0] * len(inputs)
        if output.number not in self._slopes:
            self._slopes[output.number] = slopes_of(output)
        slopes = self._slopes[output.number]
        return [slopes.get(x.number, 0.0) for x in inputs]

    def _put(self, outputs: Sequence[Any]) -> int:
        self._functions.append(tuple(outputs))
        return len(self._functions) - 1

    def _put_jacobian(self, leading: Sequence[Any], rows: Sequence[Sequence[Any]], states: int) -> tuple[int, int]:
        """Add a function of ``leading`` outputs, then of the entries of a Jacobian that are not 0 everywhere.

        Its first ``states`` columns belong to the state, the others to the parameters. Return the places of the function and
        of the structure, ``Structure`` in `driver.c`: numbers of rows, entries by state and entries by parameters; where each
        row's entries by state begin, and their columns; rows and columns of the entries by parameters.
        """
        by_state = [
            (i, j, x) for i, row in enumerate(rows) for j, x in enumerate(row[:states]) if isinstance(x, Expression) or x != 0
        ]
        by_parameter = [
            (i, j, x) for i, row in enumerate(rows) for j, x in enumerate(row[states:]) if isinstance(x, Expression) or x != 0
        ]
        starts = np.searchsorted([i for i, *_ in by_state], range(len(rows) + 1)).tolist()
        place = len(_HEADER) + self._modes.size + len(self._structures)
        self._structures += [len(rows), len(by_state), len(by_parameter), *starts, *(j for _, j, _ in by_state)]
        self._structures += [*(i for i, _, _ in by_parameter), *(j for _, j, _ in by_parameter)]
        outputs = [*leading, *(x for *_, x in (*by_state, *by_parameter))]
        self._header["values"] = max(self._header["values"], len(outputs))
        return self._put(outputs), place


def _fill(row: NDArray[np.int32], field: str, values: Sequence[Any]) -> None:
    """Write the entries of a field of a mode."""
    place, room = _PLACES[field], getattr(_ModeRow(), field)
    if len(values) > room:
        raise ValueError(f"{field}: found {len(values)} entries, needed at most {room}; give it more room here and in driver.c")
    row[place : place + len(values)] = values


def _flat(m: Motion) -> list[Any]:
    """Return the numbers of a motion, in the order of ``Motion`` in `driver.c`."""
    return [m.mode, m.t, *m.y, *m.signs]
