"""The functions of the live model as lines of JavaScript: releases, and the equations and rules of each mode."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

from looping_pendulum.live.expressions import written
from looping_pendulum.live.symbols import SIGNS, STATE, Model, effects_in, live_effects
from looping_pendulum.reference_ode import effects as forces
from looping_pendulum.reference_ode import rules
from looping_pendulum.reference_ode.closed_forms import kinetic_energy, potential_energy
from looping_pendulum.reference_ode.effects import GRAVITY
from looping_pendulum.reference_ode.effects.library import SIDE_FORCE
from looping_pendulum.reference_ode.geometry import light_velocity, vector_xy
from looping_pendulum.reference_ode.parameters import Release
from looping_pendulum.reference_ode.solution import heavy_mass_position, light_mass_position
from looping_pendulum.reference_ode.state import Motion, State, event_in_phase, full_state, kinematics, variables
from looping_pendulum.reference_ode.transitions import Event, Mode

INDENT = "  "
NOT_FROM_THE_AIR = (GRAVITY.name, SIDE_FORCE.name)
"""Effects whose forces on the light mass are no drag."""
_MOTION_SIZE = 2 + len(STATE) + len(SIGNS)


def release_function(kind: Release) -> Iterator[str]:
    """Yield the lines of the function that releases the apparatus, and takes the first step of a run that starts at rest."""
    model = Model(live_effects(kind))
    system = model.system
    released = rules.release(system, kind, rules.state_at_release(model.parameters(kind)))
    after, series, by_series = rules.leave_rest(system, rules.enter(system, released))
    terms = [_entries(term) for term in series]
    lines, texts = written([*_flat(released), *_flat(after), by_series, *(x for term in terms for x in term)])
    first, second = texts[:_MOTION_SIZE], texts[_MOTION_SIZE : 2 * _MOTION_SIZE]
    taken, rest = texts[2 * _MOTION_SIZE], texts[2 * _MOTION_SIZE + 1 :]
    rows = [_array(rest[i : i + len(STATE)]) for i in range(0, len(rest), len(STATE))]
    result = [
        "return {",
        f"{INDENT}released: {_motion(first)},",
        f"{INDENT}after: {_motion(second)},",
        f"{INDENT}bySeries: {taken},",
        f"{INDENT}series: {_array(rows)},",
        "};",
    ]
    yield from _function("(p) =>", [*lines, *result])


def mode_equations(mode: Mode) -> Iterator[str]:
    """Yield the entry of ``mode`` in the table of the modes."""
    names = variables(mode, effects_in(mode))
    pairs = _events(mode)
    yield f"{mode.value}: {{  // {mode.name.lower()}"
    yield f"{INDENT}integrated: {_array(str(STATE.index(name)) for name in names)},"
    yield f"{INDENT}events: {json.dumps([[event.value for event in pair] for pair in pairs.values()])},"
    for function in (_rates, _event_values, _full_state, _quantities):
        yield from _indented(function(mode))
    yield f"{INDENT}apply: {{"
    for event in dict.fromkeys([Event.TIME_UP, *(event for pair in pairs.values() for event in pair)]):
        yield from _indented(_indented(_apply_event(mode, event)))
    yield f"{INDENT}}},\n}},"


def _events(mode: Mode) -> dict[Event, tuple[Event, Event]]:
    """Return the events of the mode's functions, each with what it announces in phase 0 and in phase 1."""
    model, y = _integrated_state(mode)
    functions = model.system.equations.event_functions(mode, model.t, y, model.signs)
    phases = [model.signs._replace(phase=phase) for phase in (0.0, 1.0)]
    return {event: (event_in_phase(event, phases[0]), event_in_phase(event, phases[1])) for event in functions}


def _integrated_state(mode: Mode) -> tuple[Model, State]:
    """Return symbols for a mode, and its whole state from the entries that are integrated."""
    model = Model(effects_in(mode))
    names = variables(mode, model.effects)
    return model, full_state(mode, **{name: getattr(model.y, name) for name in names})


def _rates(mode: Mode) -> Iterator[str]:
    model, y = _integrated_state(mode)
    names = variables(mode, model.effects)
    rates = model.system.equations.rates(mode, model.t, y, model.signs)
    lines, texts = written([getattr(rates, name) for name in names])
    yield from _function("rates(p, t, z, s, out)", _with_state("z", names, [*lines, *_stored(texts)]))


def _event_values(mode: Mode) -> Iterator[str]:
    model, y = _integrated_state(mode)
    functions = model.system.equations.event_functions(mode, model.t, y, model.signs)
    lines, texts = written(list(functions.values()))
    names = variables(mode, model.effects)
    yield from _function("eventValues(p, t, z, s, out)", _with_state("z", names, [*lines, *_stored(texts)]))


def _full_state(mode: Mode) -> Iterator[str]:
    model, y = _integrated_state(mode)
    _, texts = written(_entries(y))
    names = variables(mode, model.effects)
    yield from _function("fullState(z)", _with_state("z", names, [f"return {_array(texts)};"]))


def _apply_event(mode: Mode, event: Event) -> Iterator[str]:
    model = Model(effects_in(mode))
    after = rules.apply_event(model.system, mode, event, Motion(mode, model.t, model.y, model.signs))
    lines, texts = written(_flat(after))
    yield from _function(f"{event.value}(p, t, y, s)", _with_state("y", STATE, [*lines, f"return {_motion(texts)};"]))


def _quantities(mode: Mode) -> Iterator[str]:
    """Yield the function that gives what can be seen and drawn of an instant."""
    model = Model(effects_in(mode))
    xp, y, p, parameters = model.xp, model.y, model.p, model.parameters()
    tensions = model.system.equations.tensions(mode, model.t, y, model.signs)
    k = kinematics(xp, mode, model.t, y, model.signs, p, model.effects)
    from_the_air = tuple(effect for effect in model.effects if effect.name not in NOT_FROM_THE_AIR)
    light = light_mass_position(xp, y, 0.0, p, model.effects)
    heavy = heavy_mass_position(xp, y, 0.0, p, model.effects)
    velocity = light_velocity(xp, y.wrap_angle, y.retreat_speed, y.across_speed)
    outputs = {
        "light": light,
        "heavy": heavy,
        "lightVelocity": velocity,
        "heavyVelocity": (0.0, y.heavy_speed),
        "wrapAngle": y.wrap_angle,
        "freeLength": y.free_length,
        "slack": y.slack,
        "lightTension": tensions[0],
        "heavyTension": tensions[1],
        "kineticEnergy": kinetic_energy(parameters, velocity, (0.0, y.heavy_speed)),
        "potentialEnergy": potential_energy(parameters, light, heavy),
        "dragForce": vector_xy(xp, y.wrap_angle, *forces.force_on_light_mass(xp, k, p, from_the_air)),
    }
    if mode.string_moves or mode is Mode.STICKING:
        needed = abs(xp.log(tensions[1] / tensions[0]))
        outputs["needed"], outputs["bound"] = needed, forces.holding_exponent(xp, k, p, model.effects)
    flat = [x for value in outputs.values() for x in (value if isinstance(value, tuple) else (value,))]
    lines, texts = written(flat)
    remaining = iter(texts)
    parts = {
        name: _array([next(remaining), next(remaining)]) if isinstance(value, tuple) else next(remaining)
        for name, value in outputs.items()
    }
    holding = f"{{ needed: {parts.pop('needed')}, bound: {parts.pop('bound')} }}" if "needed" in parts else "null"
    fields = [f"{INDENT}{name}: {text}," for name, text in (parts | {"holding": holding}).items()]
    yield from _function("quantities(p, t, y, s)", _with_state("y", STATE, [*lines, "return {", *fields, "};"]))


def _entries(y: State) -> list[Any]:
    """Return the entries of `STATE`; the others belong to effects that the live model does not have, and are 0."""
    if any(x != 0 for x in y[len(STATE) :]):
        raise ValueError(f"state: found {y}, needed 0 in all entries after {STATE[-1]}")
    return list(y[: len(STATE)])


def _flat(m: Motion) -> list[Any]:
    """Return the numbers of a motion: its mode, its time, its state and its signs."""
    if any(x != 0 for x in m.signs[len(SIGNS) :]):
        raise ValueError(f"signs: found {m.signs}, needed 0 in all entries after {SIGNS[-1]}")
    return [m.mode, m.t, *_entries(m.y), *m.signs[: len(SIGNS)]]


def _motion(texts: Sequence[str]) -> str:
    """Return a motion as an object, from the texts of its numbers."""
    mode, t, *others = texts
    signs = ", ".join(f"{name}: {text}" for name, text in zip(SIGNS, others[len(STATE) :], strict=True))
    return f"{{ mode: {mode}, t: {t}, y: {_array(others[: len(STATE)])}, signs: {{ {signs} }} }}"


def _with_state(array: str, names: Sequence[str], lines: Sequence[str]) -> list[str]:
    """Return the lines of a function after those that read from ``array`` the entries that they use."""
    used = set(re.findall(r"(?<![.\w])\w+", "\n".join(lines)))
    return [*(f"const {name} = {array}[{i}];" for i, name in enumerate(names) if name in used), *lines]


def _stored(texts: Sequence[str]) -> Iterator[str]:
    return (f"out[{i}] = {text};" for i, text in enumerate(texts))


def _array(texts: Iterable[str]) -> str:
    return f"[{', '.join(texts)}]"


def _function(signature: str, lines: Iterable[str]) -> Iterator[str]:
    yield f"{signature} {{"
    yield from _indented(lines)
    yield "},"


def _indented(lines: Iterable[str]) -> Iterator[str]:
    return (INDENT + line for line in lines)
