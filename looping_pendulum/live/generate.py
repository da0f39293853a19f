"""Writes `model.js`: the driver and the models that it carries out in the browser, from `reference_ode`, and units, bounds and
sliders from `scenarios.quantities`.

``python -m looping_pendulum.live.generate`` writes the file anew; a test holds that the file in the repository is what it
writes.
"""

from __future__ import annotations

import json
from base64 import b64encode
from collections.abc import Iterator
from dataclasses import MISSING, fields
from importlib.resources import files
from pathlib import Path
from typing import Any

from looping_pendulum.live.models import (
    FURTHER_EFFECTS,
    HOLDING_MODES,
    LiveModel,
    live_coefficients,
    live_model,
    live_requirements,
)
from looping_pendulum.measured.camera import CAMERA
from looping_pendulum.reference_ode import solve
from looping_pendulum.reference_ode.core import host, wasm
from looping_pendulum.reference_ode.core.trace import EVENTS
from looping_pendulum.reference_ode.parameters import NUMBERS, Parameters, Release, effect_tables
from looping_pendulum.reference_ode.transitions import END_EVENTS, PHASE_EVENTS, Event, Mode
from looping_pendulum.scenarios.quantities import QUANTITIES
from looping_pendulum.scenarios.units import factor, pretty

FILE = "model.js"


def main() -> None:
    """Write the file into the package."""
    Path(str(files("looping_pendulum.live") / FILE)).write_text(model_source(), encoding="utf-8")


def model_source() -> str:
    """Return the text of the generated module."""
    lines = [
        "// Written by `python -m looping_pendulum.live.generate` from reference_ode and scenarios.quantities: change them.",
        *_constants(),
        *_layouts(),
        *_settings(),
        *_quantities(),
        *_models(),
    ]
    return "\n".join(lines) + "\n"


def _exported(name: str, value: Any, meaning: str, kind: str = "") -> str:
    """Return the lines that export a constant; infinite numbers are written as JavaScript has them."""
    typed = f"\n * @type {{{kind}}}" if kind else ""
    return f"/** {meaning}{typed} */\nexport const {name} = {json.dumps(value, ensure_ascii=False)};"


def _constants() -> Iterator[str]:
    yield _exported("TOLERANCE", solve.TOLERANCE, "Default relative tolerance of a step.")
    yield _exported("LEAST_TOLERANCE", host.LEAST_TOLERANCE, "Smallest relative tolerance of a step.")
    yield _exported("DURATION", solve.DURATION, "Default limit on the simulated time [s].")
    names = {mode.value: mode.name.lower() for mode in Mode}
    yield _exported("MODE_NAMES", names, "Number of a mode -> its name.", "Record<number, string>")
    yield _exported("EVENTS", EVENTS, "Events; the driver names one by its place.")
    yield _exported("STICKING", Mode.STICKING.value, "A mode.")
    yield _exported("HOLDING_MODES", HOLDING_MODES, "Modes in which the rod's friction holds the tensions apart.")
    for event in (Event.LIGHT_REACHES_ROD, Event.STOP):
        yield _exported(event.name, event, "An event of the run.")
    for name, meaning, kind in (
        ("PHASE_EVENTS", "Events that change a sign or a phase, not the mode.", PHASE_EVENTS),
        ("END_EVENTS", "Events that end the run.", END_EVENTS),
    ):
        members = json.dumps([event for event in Event if event in kind])
        yield f"/** {meaning} */\nexport const {name} = new Set({members});"


def _layouts() -> Iterator[str]:
    """Yield what hosts of the driver must know beside the models."""
    yield _exported("STATE_SIZE", host.NY, "Entries of the state.")
    yield _exported("SIGNS_SIZE", host.NS, "Piecewise constants that keep the equations analytic.")
    meaning = "Numbers of a row of events: its code; mode, time, state and signs just after it."
    yield _exported("EVENT_COLUMNS", host.EVENT_COLUMNS, meaning)
    meaning = "Numbers of a row of steps: start, length and mode; the terms of the polynomial, each for the whole state."
    yield _exported("STEP_COLUMNS", host.DENSE_COLUMNS, meaning)
    yield _exported("JOB_FIELDS", host.JOB_FIELDS, "Fields of `Job` in driver.c after the relative tolerance.")
    yield _exported("FAILURES", host.FAILURES, "What went wrong, by its number.", "Record<number, string>")
    yield _exported("IMPORTED", wasm.IMPORTED, "Functions that a model takes from the driver.")


def _settings() -> Iterator[str]:
    """Yield which settings there are, and what they are if not given."""
    optional = [f for f in fields(Parameters) if f.name in NUMBERS and f.default is not MISSING]
    defaults: dict[str, Any] = {f.name: f.default for f in optional}
    of_effects = effect_tables(()).defaults
    defaults |= {name: of_effects[name] for name in live_coefficients()}
    meaning = "Values of the settings that need not be given [SI]; `static_friction` then equals `kinetic_friction`."
    yield _exported("DEFAULTS", defaults, meaning, "Record<string, number>")
    yield _exported("REQUIRED", [name for name in NUMBERS if name not in defaults], "Settings that must be given.")
    vertical = Parameters(light_mass=1, heavy_mass=1, rod_radius=1, free_length=1, release_angle=1, release=Release.VERTICAL)
    angles = {vertical.release: vertical.release_angle}
    yield _exported("DEMANDED_ANGLES", angles, "Release -> the release angle that it demands [rad].", "Record<string, number>")


def _quantities() -> Iterator[str]:
    """Yield what the page needs of the table of quantities, and of the camera's errors."""
    settings = {name: QUANTITIES[name].kind for name in (*NUMBERS, *live_coefficients())}
    units = {name: pretty(kind.unit) for name, kind in settings.items()}
    yield _exported("UNITS", units, "Setting -> its SI unit, as files have it.", "Record<string, string>")
    bounds = {name: (kind.low, kind.high) for name, kind in settings.items()}
    bounds |= {name: c.bounds for name, c in CAMERA.items()}
    meaning = "Setting or error of the camera -> least and greatest value [SI]."
    yield _exported("BOUNDS", bounds, meaning, "Record<string, [number, number]>")
    further = {c.name: effect.name for effect in FURTHER_EFFECTS for c in effect.coefficients}
    meaning = "Coefficient of an effect beside those of the paper's model -> the effect."
    yield _exported("FURTHER_EFFECTS", further, meaning, "Record<string, string>")
    sliders = {}
    for q in QUANTITIES.values():
        if (slider := q.slider) is not None:
            sliders[q.name] = {
                "unit": slider.unit.replace("deg", "°").replace("^2", "²"),
                "unitInLink": slider.unit.replace("/", "_per_").replace("^", ""),
                "factor": float(factor(slider.unit, q.kind.unit)) if slider.unit else 1,
                "min": slider.low,
                "max": slider.high,
                "step": slider.step,
            }
    meaning = "Setting -> its slider: the shown unit, that unit in a link, SI units in one of it, and the range in it."
    entries = "unit: string, unitInLink: string, factor: number, min: number, max: number, step: number"
    yield _exported("SLIDERS", sliders, meaning, f"Record<string, {{{entries}}}>")


def _models() -> Iterator[str]:
    """Yield the driver, the models and the requirements: WebAssembly in base64, and what its host needs to call it."""
    driver = files(wasm.__package__).joinpath("driver.wasm").read_bytes()
    yield _exported("DRIVER", _base64(driver), "The driver, `reference_ode/core/driver.c`.")
    models: list[dict[str, Any]] = []
    releases = {}
    for release in Release:
        model = _described(live_model(release))
        if model not in models:
            models.append(model)
        releases[release] = models.index(model)
    yield _exported("RELEASES", releases, "Release -> the place of its model in `MODELS`.", "Record<string, number>")
    meaning = "Models: what parameters they read, the driver's table, their functions, and places of `quantities` by mode."
    entries = "names: string[], table: number[], functions: string, count: number, quantities: Record<number, number>"
    yield _exported("MODELS", models, meaning, f"{{{entries}}}[]")
    requirements = live_requirements()
    described = {
        "names": requirements.names,
        "messages": requirements.messages,
        "functions": _base64(wasm.module([requirements.outputs])),
        "count": 1,
        "outputs": len(requirements.outputs),
    }
    meaning = "What an apparatus must fulfil: a function whose outputs say what is met, and have the values that messages show."
    yield _exported("REQUIREMENTS", described, meaning)


def _described(model: LiveModel) -> dict[str, Any]:
    first = len(model.traced.functions)
    return {
        "names": model.traced.names,
        "table": model.traced.table.tolist(),
        "functions": _base64(wasm.module(model.functions)),
        "count": len(model.functions),
        "quantities": {mode.value: first + i for i, mode in enumerate(model.quantities)},
    }


def _base64(module: bytes) -> str:
    return b64encode(module).decode()


if __name__ == "__main__":
    main()
