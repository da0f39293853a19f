"""Writes `model.js`: equations, events and rules of transition as JavaScript, from their one definition in `reference_ode`,
and units, bounds and sliders from `scenarios.quantities`.

``python -m looping_pendulum.live.generate`` writes the file anew; a test holds that the file in the repository is what it
writes.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator
from dataclasses import MISSING, fields
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from looping_pendulum.live.expressions import literal, written
from looping_pendulum.live.functions import mode_equations, release_function
from looping_pendulum.live.symbols import (
    FURTHER_EFFECTS,
    MODES,
    PARAMETERS,
    SIGNS,
    STATE,
    Model,
    live_coefficients,
    live_effects,
)
from looping_pendulum.measured.camera import CAMERA
from looping_pendulum.reference_ode import rules, solve
from looping_pendulum.reference_ode.core.expressions import Expression
from looping_pendulum.reference_ode.parameters import (
    NUMBERS,
    POINT_MASS_END,
    Parameters,
    Release,
    effect_tables,
    string_length,
    touching_length,
)
from looping_pendulum.reference_ode.transitions import END_EVENTS, PHASE_EVENTS, Event, Mode
from looping_pendulum.scenarios.quantities import QUANTITIES
from looping_pendulum.scenarios.units import factor, pretty

FILE = "model.js"
INDENT = "  "


def main() -> None:
    """Write the file into the package."""
    Path(str(files("looping_pendulum.live") / FILE)).write_text(model_source(), encoding="utf-8")


def model_source() -> str:
    """Return the text of the generated module."""
    lines = [
        "// Written by `python -m looping_pendulum.live.generate` from reference_ode and scenarios.quantities: change them.",
        *_types(),
        *_constants(),
        *_tables_of_dop853(),
        *_names(),
        *_settings(),
        *_quantities(),
        *_derived(),
        *_faults(),
        *_releases(),
        "/** Number of a mode -> its equations.\n * @type {Record<number, ModeEquations>} */",
        "export const MODES = {",
        *(line for mode in MODES for line in _indented(mode_equations(mode))),
        "};",
    ]
    return "\n".join(lines) + "\n"


def _types() -> Iterator[str]:
    yield f"""\
/**
 * Numbers of the apparatus, in SI.
 * @typedef {{{_typed(PARAMETERS)}}} Numbers
 *
 * Piecewise constants that keep the equations analytic between events.
 * @typedef {{{_typed(SIGNS)}}} Signs
 *
 * State of a run: {", ".join(STATE)}.
 * @typedef {{number[]}} State
 *
 * A run at one instant.
 * @typedef {{{{mode: number, t: number, y: State, signs: Signs}}}} Motion
 *
 * Motion just after the release, and after the run has left rest; the terms of the series by which it does so.
 * @typedef {{{{released: Motion, after: Motion, bySeries: boolean, series: State[]}}}} Release
 *
 * What can be seen or drawn of one instant (SI; vectors are x and y).
 * @typedef {{{{
 *   light: number[], heavy: number[], lightVelocity: number[], heavyVelocity: number[], wrapAngle: number, freeLength: number,
 *   slack: number, lightTension: number, heavyTension: number, kineticEnergy: number, potentialEnergy: number,
 *   dragForce: number[], holding: {{needed: number, bound: number}} | null,
 * }}}} Quantities
 *
 * Equations of one mode. `z` has the entries of the state that it integrates, `y` all of them.
 * @typedef {{{{
 *   integrated: number[],
 *   events: string[][],
 *   rates(p: Numbers, t: number, z: Float64Array, s: Signs, out: Float64Array): void,
 *   eventValues(p: Numbers, t: number, z: Float64Array, s: Signs, out: Float64Array): void,
 *   fullState(z: Float64Array): State,
 *   quantities(p: Numbers, t: number, y: State, s: Signs): Quantities,
 *   apply: Record<string, (p: Numbers, t: number, y: State, s: Signs) => Motion>,
 * }}}} ModeEquations
 */"""


def _typed(names: Iterable[str]) -> str:
    return "{" + ", ".join(f"{name}: number" for name in names) + "}"


def _constants() -> Iterator[str]:
    numbers: dict[str, tuple[float, str]] = {
        "TOLERANCE": (solve.TOLERANCE, "Default relative tolerance of a step."),
        "DURATION": (solve.DURATION, "Default limit on the simulated time [s]."),
        "MAX_EVENTS": (4000, "Number of events after which a run is given up as endless."),
        "MAX_STEPS": (200_000, "Number of steps in one mode after which a run is given up."),
        "FIRST_STEP": (1e-6, "First step in a mode [s]."),
        "REST_SERIES_DURATION": (rules.REST_SERIES_DURATION, "Length of the step by which a run leaves rest [s]."),
        "DIP_THRESHOLD": (
            0.01,
            "Fraction of an event function's largest value; a lower dip is minimized.",
        ),
        "MIN_DIP_DEPTH": (1e-6, "Fraction of the same by which a minimum must be below zero."),
    }
    for name, (value, meaning) in numbers.items():
        yield f"/** {meaning} */\nexport const {name} = {literal(value)};"
    yield "/** Fractions of a step at which event functions are evaluated. */"
    yield f"export const CHECKS = {_list(np.linspace(0.0, 1.0, 9))};"
    yield "/** Fractions of a step at which the polynomial through those values is evaluated. */"
    yield f"export const BETWEEN = {_list(np.linspace(0.0, 1.0, 65))};"


def _tables_of_dop853() -> Iterator[str]:
    from scipy.integrate._ivp import dop853_coefficients as tables

    yield "/** Coefficients of the method of Dormand and Prince of order 8 (DOP853), from SciPy. */\nexport const DOP853 = {"
    for name in ("B", "C", "E3", "E5"):
        yield f"{INDENT}{name}: {_list(getattr(tables, name))},"
    for name in ("A", "D"):
        yield f"{INDENT}{name}: ["
        yield from (f"{2 * INDENT}{_list(row)}," for row in getattr(tables, name))
        yield f"{INDENT}],"
    yield "};"


def _names() -> Iterator[str]:
    names = {mode.value: mode.name.lower() for mode in (*MODES, Mode.ENDED)}
    yield "/** Number of a mode -> its name.\n * @type {Record<number, string>} */"
    yield f"export const MODE_NAMES = {json.dumps(names)};"
    yield f"export const ENDED = {Mode.ENDED.value};\nexport const STICKING = {Mode.STICKING.value};"
    for event in (Event.TIME_UP, Event.LIGHT_REACHES_ROD, Event.STOP):
        yield f'export const {event.name} = "{event.value}";'
    for name, meaning, kind in (
        ("PHASE_EVENTS", "Events that change a sign or a phase, not the mode.", PHASE_EVENTS),
        ("END_EVENTS", "Events that end the run.", END_EVENTS),
    ):
        members = json.dumps([event.value for event in Event if event in kind])
        yield f"/** {meaning} */\nexport const {name} = new Set({members});"


def _settings() -> Iterator[str]:
    """Yield which settings there are, and what they are if not given."""
    optional = [f for f in fields(Parameters) if f.name in NUMBERS and f.default is not MISSING]
    defaults: dict[str, Any] = {f.name: f.default for f in optional}
    of_effects = effect_tables(()).defaults
    coefficients = {name: of_effects[name] for name in live_coefficients()}
    yield "/** Values of the settings that need not be given [SI]; `static_friction` then equals `kinetic_friction`."
    yield f" * @type {{Record<string, number>}} */\nexport const DEFAULTS = {json.dumps(defaults | coefficients)};"
    required = [name for name in NUMBERS if name not in defaults]
    yield f"/** Settings that must be given. */\nexport const REQUIRED = {json.dumps(required)};"
    vertical = Parameters(light_mass=1, heavy_mass=1, rod_radius=1, free_length=1, release_angle=1, release=Release.VERTICAL)
    yield "/** Release -> the release angle that it demands [rad].\n * @type {Record<string, number>} */"
    yield f"export const DEMANDED_ANGLES = {json.dumps({vertical.release.value: vertical.release_angle})};"


def _quantities() -> Iterator[str]:
    """Yield what the page needs of the table of quantities, and of the camera's errors."""
    settings = {name: QUANTITIES[name].kind for name in (*NUMBERS, *live_coefficients())}
    yield "/** Setting -> its SI unit, as files have it.\n * @type {Record<string, string>} */"
    yield f"export const UNITS = {json.dumps({name: pretty(kind.unit) for name, kind in settings.items()})};"
    bounds = {name: (kind.low, kind.high) for name, kind in settings.items()}
    yield "/** Setting or error of the camera -> least and greatest value [SI].\n * @type {Record<string, [number, number]>} */"
    yield "export const BOUNDS = {"
    for name, (low, high) in (bounds | {name: c.bounds for name, c in CAMERA.items()}).items():
        yield f"{INDENT}{name}: [{_bound(low)}, {_bound(high)}],"
    yield "};"
    yield "/** Coefficient of an effect beside those of the paper's model -> the effect.\n * @type {Record<string, string>} */"
    further = {c.name: effect.name for effect in FURTHER_EFFECTS for c in effect.coefficients}
    yield f"export const FURTHER_EFFECTS = {json.dumps(further)};"
    yield "/** Setting -> its slider: the shown unit, that unit in a link, SI units in one of it, and the range in it."
    entries = "unit: string, unitInLink: string, factor: number, min: number, max: number, step: number"
    yield f" * @type {{Record<string, {{{entries}}}>}} */"
    yield "export const SLIDERS = {"
    for q in QUANTITIES.values():
        if (slider := q.slider) is not None:
            shown = slider.unit.replace("deg", "°").replace("^2", "²")
            entry: dict[str, Any] = {"unit": shown, "unitInLink": slider.unit.replace("/", "_per_").replace("^", "")}
            entry |= {"factor": float(factor(slider.unit, q.kind.unit)) if slider.unit else 1}
            entry |= {"min": slider.low, "max": slider.high, "step": slider.step}
            yield f"{INDENT}{q.name}: {json.dumps(entry, ensure_ascii=False)},"
    yield "};"


def _bound(value: float) -> str:
    return literal(value) if math.isfinite(value) else f"{'-' if value < 0 else ''}Infinity"


def _derived() -> Iterator[str]:
    model = Model(live_effects(Release.LOOPING))
    p = model.p
    end = model.system.where(p.light_radius > 0, touching_length(p.light_radius, p.rod_radius), POINT_MASS_END * p.rod_radius)
    whole = string_length(p.free_length, p.rod_radius, p.release_angle, p.hanging_length, p.heavy_swing)
    lines, (end, whole) = written([end, whole])
    yield "/** Return the settings with the numbers that follow from them.\n * @param {any} p @returns {Numbers} */"
    yield "export function withDerived(p) {"
    yield from _indented([*lines, f"return {{ ...p, end_length: {end}, string_length: {whole} }};"])
    yield "}"


def _faults() -> Iterator[str]:
    """Yield the function that says what is impossible in an apparatus, by the requirements of the reference."""
    values = vars(Model(live_effects(Release.LOOPING)).p)
    yield "/** Return a number with six significant digits.\n * @param {number} x */"
    yield "const general = (x) => String(Number(x.toPrecision(6)));"
    yield '/** Return what is impossible in an apparatus; "" if nothing is.\n * @param {Numbers} p */'
    yield "export function faultOf(p) {"
    requirements = [(r.is_met(values), r.message) for r in effect_tables(()).requirements(live_coefficients())]
    # What concerns effects that the live model does not have is met whatever the numbers are
    remaining = [(is_met, message) for is_met, message in requirements if isinstance(is_met, Expression)]
    lines, texts = written([is_met for is_met, _ in remaining])
    checks = [f"if (!({text})) return `{message(values)}`;" for text, (_, message) in zip(texts, remaining, strict=True)]
    yield from _indented([*lines, *checks])
    yield f'{INDENT}return "";\n}}'


def _releases() -> Iterator[str]:
    """Yield the table of the releases; one that begins like another, but for numbers, has the same function."""
    yield "/** How each release begins.\n * @type {Record<string, (p: Numbers) => Release>} */\nexport const RELEASES = {};"
    known: dict[tuple[str, ...], str] = {}
    for kind in Release:
        first, *rest = lines = tuple(release_function(kind))
        if lines in known:
            yield f"RELEASES.{kind.value} = {known[lines]};"
        else:
            known[lines] = f"RELEASES.{kind.value}"
            yield from (f"RELEASES.{kind.value} = {first}", *rest[:-1], "};")


def _list(values: Any) -> str:
    return "[" + ", ".join(literal(x) for x in values.tolist()) + "]"


def _indented(lines: Iterable[str]) -> Iterator[str]:
    return (INDENT + line for line in lines)


if __name__ == "__main__":
    main()
