"""Rules of transition over expressions: they trace without an error, and the graph gives what the rules give over floats.

Oracle: `rules` over floats, bit for bit, at random states. What decides a rule must therefore be in the graph, not in Python.
"""

import math
import operator
from types import SimpleNamespace

import numpy as np
import pytest

from looping_pendulum.reference_ode import rules
from looping_pendulum.reference_ode.core.expressions import FUNCTIONS, Expression, ExpressionGraph
from looping_pendulum.reference_ode.core.trace import SymbolicSystem
from looping_pendulum.reference_ode.effects import LIBRARY
from looping_pendulum.reference_ode.effects.library import PIVOT_FRICTION
from looping_pendulum.reference_ode.parameters import Parameters, Release
from looping_pendulum.reference_ode.state import Motion, Signs, State, event_in_phase, extra_variables
from looping_pendulum.reference_ode.transitions import END_EVENTS, Event, Mode
from tests.apparatus import TEN_TO_ONE

ROD = {"rod_mobility": 12.0, "bearing_friction": 0.3}
STATES = 40
"""Random states at which each traced rule is compared with the rule over floats."""
OPERATIONS = {
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
    "/": operator.truediv,
    "neg": operator.neg,
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
    "==": operator.eq,
    "&&": operator.and_,
    "||": operator.or_,
    "?:": lambda condition, a, b: a if condition else b,
    "abs": abs,
} | {name: getattr(math, name) for name in FUNCTIONS}


def evaluated(graph: ExpressionGraph, given: dict[str, float], outputs: list) -> list:
    """Return the values of ``outputs``, given those of the symbols; both branches of a choice are computed, as in wasm."""
    values = {}

    def value_of(x):
        return values[x.number] if isinstance(x, Expression) else x

    for node in graph.nodes.values():  # in the order in which they were built, so that operands come first
        if node.operation == "symbol":
            values[node.number] = given[node.operands[0]]
            continue
        try:
            values[node.number] = OPERATIONS[node.operation](*map(value_of, node.operands))
        except (ArithmeticError, ValueError):  # where it is taken, NaN shows: over floats the rule raises
            values[node.number] = math.nan
    return [value_of(x) for x in outputs]


def flat(m: Motion) -> list:
    return [m.mode, m.t, *m.y, *m.signs]


class Traced:
    """Parameters, time, state and signs as symbols, and the equations over them."""

    def __init__(self, parameters: Parameters) -> None:
        self.graph = ExpressionGraph()
        self.p = SimpleNamespace(**{name: self.graph.symbol(name) for name in names_of(parameters)})
        self.system = SymbolicSystem(self.graph, self.p, parameters.effects)

    def motion(self, mode: Mode) -> Motion:
        y = State(*(self.graph.symbol(f"y.{name}") for name in State._fields))
        signs = Signs(*(self.graph.symbol(f"s.{name}") for name in Signs._fields))
        return Motion(mode, self.graph.symbol("t"), y, signs)

    def values_at(self, p: dict[str, float], outputs: list, m: Motion | None = None) -> list:
        given = dict(p)
        if m is not None:
            given |= {"t": m.t, **{f"y.{k}": v for k, v in m.y._asdict().items()}}
            given |= {f"s.{k}": v for k, v in m.signs._asdict().items()}
        return evaluated(self.graph, given, outputs)


def names_of(parameters: Parameters) -> list[str]:
    return [name for name, value in vars(parameters.values()).items() if isinstance(value, float)]


def apparatus(release: Release, coefficients: dict[str, float]) -> Parameters:
    angle = math.pi / 2 if release is Release.VERTICAL else 1.9
    return TEN_TO_ONE.replace(release=release, release_angle=angle, rod_radius=0.03, hanging_length=0.7, **coefficients)


def coefficients_of(effect) -> dict[str, float]:
    """Return values at which the effect acts, well within their bounds."""
    values = {c.name: c.null + 0.1 * min(1.0, c.bounds[1] - c.null) for c in effect.coefficients}
    values |= {"string_thickness": 2e-3} if "string_thickness" in values else {}
    return {} if effect.in_base_model else values


def cases() -> dict[str, dict[str, float]]:
    """Return the effects of the library, each by itself and with a rod that turns, as their coefficients."""
    alone = {effect.name: coefficients_of(effect) for effect in LIBRARY if not effect.in_base_model} | {"base": {}}
    with_rod = {f"{name} + rod": values | ROD for name, values in alone.items() if "string_compliance" not in values}
    return alone | with_rod


CASES = cases()
EACH = pytest.mark.parametrize("name", CASES)


def modes_of(release: Release, parameters: Parameters) -> list[Mode]:
    """Return the modes of a run, but for its end."""
    if release is Release.DROP:
        return [Mode.FALLING]
    if release is Release.HELD:
        return [Mode.CLAMPED, Mode.CLAMPED_SLACK]
    rolling = [Mode.ROLLING] if "rod_speed" in extra_variables(parameters.effects) else []
    return [Mode.STICKING, Mode.SLIDING_DOWN, Mode.SLIDING_UP, Mode.SLACK, *rolling]


def events_of(system: rules.HybridSystem, mode: Mode, m: Motion) -> list[Event]:
    """Return the events of a mode that do not end the run, in either phase."""
    functions = system.equations.event_functions(mode, m.t, m.y, m.signs)
    phases = [m.signs._replace(phase=phase, rod=1.0, rod_phase=phase) for phase in (0.0, 1.0)]
    found = dict.fromkeys(event_in_phase(event, signs) for event in functions for signs in phases)
    return [event for event in found if event not in END_EVENTS]


def numbers(parameters: Parameters, rng: np.random.Generator) -> dict[str, float]:
    """Return the parameters as numbers, with friction in the rod's bearing that holds it, does not, or is absent."""
    p = {name: getattr(parameters.values(), name) for name in names_of(parameters)}
    return p | {"bearing_friction": float(rng.choice([0.0, 0.3, 5.0]))}


def random_motion(mode: Mode, parameters: Parameters, rng: np.random.Generator) -> Motion:
    """Return a state of ``mode`` with speeds so large that the tension on the light side may be above the other or below 0."""
    y = State(rng.uniform(0.2, 0.5), rng.uniform(0.5, 6.0), rng.normal(0, 1), rng.normal(0, 12), rng.normal(0, 1), 0.0)
    own = {name: rng.normal(0, 0.2) for name in sorted(extra_variables(parameters.effects))}
    own |= {name: abs(own[name]) * 1e-2 for name in ("light_stretch", "heavy_stretch") if name in own}
    if "rod_speed" in own and (mode is Mode.STICKING or rng.random() < 0.5):
        own["rod_speed"] = 0.0
    y = State(*map(float, y._replace(**own)))
    if rng.random() < 0.3:
        y = y._replace(heavy_speed=y.rod_speed, retreat_speed=y.rod_speed)
    slide = {Mode.SLIDING_UP: 1.0, Mode.SLIDING_DOWN: -1.0}.get(mode, float(rng.choice([-1.0, 1.0])))
    across = 0.0 if PIVOT_FRICTION in parameters.effects and rng.random() < 0.5 else math.copysign(1.0, y.across_speed)
    heavy, phase, overlap, rod_phase = math.copysign(1.0, y.heavy_speed), *(float(x) for x in rng.integers(0, 2, 3))
    return Motion(mode, 0.3, y, Signs(slide, across, heavy, phase, overlap, float(np.sign(y.rod_speed)), rod_phase))


@EACH
def test_an_event_traces_and_gives_what_it_gives_over_floats(name):
    rng = np.random.default_rng(7)
    for release in (Release.LOOPING, Release.HELD, Release.DROP):
        parameters = apparatus(release, CASES[name])
        for mode in modes_of(release, parameters):
            some = Traced(parameters)
            for event in events_of(some.system, mode, some.motion(mode)):
                traced = Traced(parameters)
                outputs = flat(rules.apply_event(traced.system, mode, event, traced.motion(mode)))
                for _ in range(STATES):
                    p, m = numbers(parameters, rng), random_motion(mode, parameters, rng)
                    system = rules.system_of_floats(SimpleNamespace(**p), parameters.effects)
                    expected = flat(rules.apply_event(system, mode, event, m))
                    assert traced.values_at(p, outputs, m) == expected, (mode.name, event, m)


@EACH
@pytest.mark.parametrize("release", Release)
def test_a_release_traces_and_gives_what_it_gives_over_floats(name, release):
    rng = np.random.default_rng(8)
    parameters = apparatus(release, CASES[name])
    traced = Traced(parameters)
    start = SimpleNamespace(**vars(traced.p), release=release, coefficients=vars(traced.p))
    outputs = released(traced.system, release, rules.state_at_release(start))
    for push in (0.0, -0.4, 0.4):
        for across in (0.0, -3.0, 8.0):
            p = numbers(parameters, rng) | {"push_along": push, "push_across": across}
            system = rules.system_of_floats(SimpleNamespace(**p), parameters.effects)
            pushed = SimpleNamespace(**p, release=release, coefficients=p)
            expected = released(system, release, rules.state_at_release(pushed))
            assert traced.values_at(p, outputs) == expected


def released(system: rules.HybridSystem, release: Release, y: State) -> list:
    """Return all numbers of a release and of the step by which it leaves rest."""
    first = rules.release(system, release, y)
    after, series, by_series = rules.leave_rest(system, rules.enter(system, first))
    return [*flat(first), *flat(after), by_series, *(x for term in series for x in term)]


def test_the_random_states_reach_every_mode_that_a_rod_that_turns_allows():
    rng = np.random.default_rng(9)
    parameters = apparatus(Release.LOOPING, ROD)
    reached = set()
    for _ in range(10 * STATES):
        p, m = numbers(parameters, rng), random_motion(Mode.SLIDING_DOWN, parameters, rng)
        system = rules.system_of_floats(SimpleNamespace(**p), parameters.effects)
        after = rules.apply_event(system, Mode.SLIDING_DOWN, Event.STOP, m)
        reached.add((m.y.rod_speed == 0, after.mode, after.signs.rod != 0))
    on_resting_rod = {(Mode.STICKING, False), (Mode.ROLLING, True)}
    on_resting_rod |= {(mode, turns) for mode in rules.SLIDING for turns in (False, True)}
    on_turning_rod = {(mode, True) for mode in (*rules.SLIDING, Mode.ROLLING)}
    assert reached == {(True, *x) for x in on_resting_rod} | {(False, *x) for x in on_turning_rod}
