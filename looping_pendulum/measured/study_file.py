"""What the keys of a study file take: measured values with their errors, declared effects, the files of a trial."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from numbers import Real
from typing import Any

from pydantic import ValidationInfo
from pydantic.json_schema import JsonSchemaValue

from looping_pendulum.measured.camera import CAMERA
from looping_pendulum.reference_ode import effects as effect_library
from looping_pendulum.reference_ode.effects import Coefficient, Effect, EffectKind
from looping_pendulum.reference_ode.effects.own import effect_of
from looping_pendulum.reference_ode.parameters import Parameters, Release
from looping_pendulum.scenarios.document import quote
from looping_pendulum.scenarios.fields import (
    NUMBER_PATTERN,
    QUANTITY_TEXT,
    TEXT,
    FieldType,
    Key,
    KeyGroup,
    QuantityField,
    SimpleField,
    in_si_unit,
    input_error,
    suggest,
)
from looping_pendulum.scenarios.quantities import APPARATUS, QUANTITIES, quantity_kind
from looping_pendulum.scenarios.schema import with_kind
from looping_pendulum.scenarios.units import QuantityKind, UnitError, show, to_si

RELEASE = ("release_angle", "free_length", "hanging_length", "push_across")
"""Parameters of a release; a study gives the speed of a push with them, not under ``effects``."""
PLACES = {n: QUANTITIES[n].key for n in (*APPARATUS, *RELEASE)} | {"push_across": "release.speed"}
"""Measured parameter -> its key, in the apparatus or in a trial: "rod_radius" -> "rod.radius"."""
MAX_RELATIVE_ERROR = 1000
"""Largest standard error of a value of a range without an end, in units of the value."""
WRONG = "wrong_"
"""Beginning of the name by which `identify` calls a declared value that is wrong."""
_PLUS_MINUS = re.compile(r"\+/-|\+-|±")


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """Measured value of one parameter with its standard error, or an initial value if nothing is known."""

    value: float
    """Measured value, or initial value of a free parameter [SI]."""
    sigma: float | None = None
    """Standard error [SI]; None: the value is exact, or free."""
    free: bool = False
    """Whether nothing is known of the parameter, so that only the fit determines it."""

    @property
    def uncertain(self) -> bool:
        """Return whether a fit may change the value."""
        return self.free or self.sigma is not None


class MeasuredField(QuantityField):
    """A quantity with its standard error: an `Estimate` in the program."""

    def __init__(self, kind: QuantityKind, start: float | None = None) -> None:
        super().__init__(kind)
        self.start = start
        """Initial value [SI] of one that is "free"; None: it has to be given."""

    def read(self, raw: object, /) -> Estimate:
        """Return value and standard error [SI] of an entry of the file, or in a script of a number or of a pair [SI]."""
        if isinstance(raw, tuple) and len(raw) == 2 and all(isinstance(each, Real) for each in raw):
            raw = " +/- ".join(in_si_unit(each, self.kind.unit) for each in raw)
        text = raw.strip() if isinstance(raw, str) else ""
        if text == "free" or text.startswith("free from "):
            return self._free(text)
        inside, bracket, unit = text.removeprefix("(").rpartition(")")
        parts = _split(inside)
        if not (text.startswith("(") and bracket and len(parts) == 2):
            parts, unit = _split(text), ""
        parts = [part + unit for part in parts]  # in "(65 +/- 1) cm" the unit belongs to both
        if len(parts) > 2:
            raise input_error(f"expected one '+/-', got {quote(raw)}; write for example '{self.way_out}'")
        value = super().read(parts[0] if isinstance(raw, str) else raw)
        return Estimate(value=value, sigma=self._error(parts[1], value, parts[0]) if len(parts) == 2 else None)

    def write(self, value: Any, /) -> str:
        """Write an estimate as a study file has it."""
        text = show(value.value, self.kind.unit)
        if value.free:
            return f"free from {text}"
        return text if value.sigma is None else f"{text} +/- {show(value.sigma, self.kind.unit)}"

    @property
    def way_out(self) -> str:
        """Return a value with its standard error, as an example to copy."""
        return f"{self.kind.example_text} +/- 1 %"

    def _free(self, text: str) -> Estimate:
        if text != "free":
            return Estimate(value=super().read(text.removeprefix("free from ")), free=True)
        if self.start is None:
            raise input_error(
                f"found 'free' without a start, needed one; write for example 'free from {self.kind.example_text}'"
            )
        return Estimate(value=self.start, free=True)

    def _error(self, text: str, value: float, value_text: str) -> float:
        try:
            if text.endswith("%"):
                sigma = abs(value) * to_si(text[:-1], "") / 100
            else:
                sigma = QuantityKind(unit=self.kind.unit).parse(text)
        except UnitError as error:
            detail = f" ({error})" if str(error) else ""
            message = f"found {quote(text)} after '+/-'{detail}, needed a standard error in the same kind of unit or in %"
            raise input_error(f"{message}; write for example '{self.way_out}'") from None
        if sigma <= 0:
            raise input_error(
                f"found a standard error of {quote(text)}, needed one above 0; leave '+/-' out if the value is exact"
            )
        whole = self.kind.high - self.kind.low
        is_bounded = math.isfinite(whole)
        if not math.isfinite(sigma) or sigma > (whole if is_bounded else MAX_RELATIVE_ERROR * abs(value)):
            most = f"{show(whole, self.kind.unit)}, its whole range" if is_bounded else f"{MAX_RELATIVE_ERROR} times the value"
            message = f"found a standard error of {quote(text)}, needed at most {most}"
            raise input_error(f"{message}; if nothing is known of the value, write 'free from {value_text}'")
        return sigma

    @property
    def json_schema(self) -> JsonSchemaValue:
        """Return the JSON Schema of such a value."""
        text = {"type": "string", "pattern": rf"^(free( from {NUMBER_PATTERN}.*)?|\(?{NUMBER_PATTERN}.*)$"}
        parts = "unit and standard error" if self.kind.unit else "standard error"
        free = "'free'" if self.start is not None else f"'free from {self.kind.example_text}'"
        return {
            **(text if self.kind.unit else {"anyOf": [{"type": "number"}, text]}),
            "examples": [self.way_out],
            QUANTITY_TEXT: f"{self.kind.requirement}, with its {parts}; or {free}",
        }


def _split(text: str) -> list[str]:
    """Split at each plus-minus sign; a regular expression that takes spaces off, too, would need quadratic time."""
    return [part.strip() for part in _PLUS_MINUS.split(text)]


def low_and_high(kind: QuantityKind, example: str) -> SimpleField:
    """Return the type of a pair of a lowest and a highest value."""

    def read(raw: object) -> tuple[float, float]:
        if not isinstance(raw, (list, tuple)) or len(raw) != 2:
            raise input_error(f"expected a lowest and a highest value, got {quote(raw)}; write for example '{example}'")
        low, high = (QuantityField(kind).read(each) for each in raw)
        if not low <= high:
            raise input_error(f"found the lowest value above the highest, needed them in order; write for example '{example}'")
        return low, high

    words = f"the lowest and the highest value, each {kind.requirement}"
    schema = {"type": "array", "minItems": 2, "maxItems": 2, "examples": [example], QUANTITY_TEXT: words}
    return SimpleField(read, schema, write=lambda pair: [QuantityField(kind).write(each) for each in pair])


def _by_parameter(groups: Mapping[str, Mapping[str, Any]]) -> dict[str, Estimate]:
    """Return parameter -> estimate of groups of measured values."""
    split = {name: place.split(".") for name, place in PLACES.items()}
    return {name: groups[group][key] for name, (group, key) in split.items() if key in groups.get(group, ())}


def _by_place(estimates: Mapping[str, Estimate]) -> dict[str, dict[str, Estimate]]:
    """Return the groups of measured values; the inverse of `_by_parameter`."""
    groups: dict[str, dict[str, Estimate]] = {}
    for name, estimate in estimates.items():
        group, _, key = PLACES[name].partition(".")
        groups.setdefault(group, {})[key] = estimate
    return groups


def _in_trial(groups: Mapping[str, Mapping[str, Any]]) -> dict[str, Estimate]:
    """Return parameter -> estimate of a trial's groups, beside which its release is."""
    values, release = _by_parameter(groups), groups.get("release", {}).get("kind", Release.LOOPING)
    if release is Release.VERTICAL and "release_angle" in values:
        message = "found an angle, needed none: a vertical release hangs at 180 deg; leave it out"
        raise input_error(message, "release", "angle")
    if release in (Release.LOOPING, Release.VERTICAL) and "hanging_length" not in values:
        # It does not influence the motion: it only shifts the measured height of the heavy mass
        values["hanging_length"] = Estimate(value=Parameters.hanging_length, free=True)
    return values


def _measured_group(name: str, description: str) -> KeyGroup:
    """Return the type of a group of measured quantities, by its name in a file."""
    keys = {place.partition(".")[2]: QUANTITIES[q] for q, place in PLACES.items() if place.partition(".")[0] == name}
    speed = "Speed of the light mass across the string as the motion begins, positive the way it loops; at rest if not given."
    known = {
        key: Key(MeasuredField(q.kind), speed if key == "speed" else q.description(in_study=True)) for key, q in keys.items()
    }
    return KeyGroup(keys=known, description=description)


_LIGHT = _measured_group("light", "The light mass, which whips round the rod.")
_HEAVY = _measured_group("heavy", "The heavy mass, which falls and is caught.")
_ROD = _measured_group("rod", "The rod.")
_RELEASE = with_kind(_measured_group("release", "How the masses were let go."))
MEASURED_APPARATUS = KeyGroup(
    keys={"light": Key(_LIGHT), "heavy": Key(_HEAVY), "rod": Key(_ROD)},
    from_keys=_by_parameter,
    to_keys=_by_place,
)
"""Measured parameters of the apparatus: groups of keys in a file, parameter -> estimate in the program."""
MEASURED_IN_TRIAL = KeyGroup(
    keys={"light": Key(_LIGHT), "heavy": Key(_HEAVY), "release": Key(_RELEASE)},
    from_keys=_in_trial,
    to_keys=_by_place,
)
"""The same of a trial."""


def _release(raw: Any) -> Release:
    """Return the kind of a release; a faulty one is refused where its group is read."""
    group = raw.get("release", {})
    kind = group.get("kind") if isinstance(group, dict) else None
    return Release(kind) if kind in tuple(Release) else Release.LOOPING


RELEASE_OF_TRIAL = SimpleField(_release, {}, write=lambda release: {"release": {"kind": str(release)}})
"""Kind of a release, whose schema is that of its group in `MEASURED_IN_TRIAL`."""


class DeclaredEffects(FieldType):
    """Declared effects: coefficient -> estimate in the program. A file may name effects that it defines itself.

    A coefficient has the name by which `identify`, a scenario file and the reports know it. The friction, of whose two
    coefficients neither switches it on, is a group besides, and so is what is not of the library, which may have any names.
    """

    def validate(self, value: object, info: ValidationInfo) -> Any:
        """Return coefficient -> estimate."""
        if info.context is None:
            return value
        if "own_effects" not in info.data:  # faulty, so that nobody knows which names there are
            return {}
        if not isinstance(value, dict):
            raise input_error(f"expected effects with their values, got {quote(value)}; write for example 'light_drag: free'")
        known = _effects([effect_of(own) for own in info.data["own_effects"]])
        for key in value:
            if key not in known.keys:
                listed = f", needed one of: {', '.join(known.keys)}{suggest(key, known.keys)}"
                raise input_error(f"found an unknown effect{_hint_for_effect(key, known.keys) or listed}", key)
        return known.read(value)

    @property
    def json_schema(self) -> JsonSchemaValue:
        """Return the JSON Schema of the library's effects; those that a file defines itself may be declared, too."""
        return _effects(()).json_schema | {"additionalProperties": {}}


def _effect_field(effect: Effect) -> SimpleField:
    """Return the type of an effect: a group of its coefficients, or the value of the first, which switches it on."""
    first = effect.coefficients[0].name
    group = KeyGroup(keys={c.name: _coefficient_key(c) for c in effect.coefficients})
    schema = group.json_schema
    return SimpleField(
        lambda raw: group.read(raw if isinstance(raw, dict) else {first: raw}),
        {"anyOf": [schema["properties"][first], schema]},
    )


def _effects(own: Sequence[Effect]) -> KeyGroup:
    """Return the type of a group of all effects that there are."""
    effects = (*effect_library.EFFECTS.values(), *own)
    grouped = [e for e in effects if e is effect_library.CAPSTAN or e not in effect_library.LIBRARY]
    groups = {e.name: Key(_effect_field(e)) for e in grouped}
    keys = {c.name: _coefficient_key(c) for e in effects if e.kind is not EffectKind.CLOSURE for c in e.coefficients}
    return KeyGroup(keys={"gravity": keys["gravity"]} | groups | keys | groups, from_keys=_each_once)


def _each_once(keys: Mapping[str, Any]) -> dict[str, Estimate]:
    """Return coefficient -> estimate, and refuse a second value of one."""
    values: dict[str, Estimate] = {}
    for key, content in keys.items():
        found = {key: content} if isinstance(content, Estimate) else content
        if twice := [name for name in found if name in values]:
            raise input_error(f"found a second value of {twice[0]}, needed one; leave one out", key)
        values |= found
    return values


def _coefficient_key(c: Coefficient) -> Key:
    known = QUANTITIES.get(c.name)
    start = c.default if known is None or known.free_start is None else known.free_start
    return Key(MeasuredField(quantity_kind(c), start), c.meaning)


def _hint_for_effect(name: str, known: Mapping[str, object]) -> str:
    """Return which key is meant by one that is no effect's, '' if nobody can tell.

    It may be the name of an effect whose key is that of its coefficient, or what `identify` calls a wrong value or an error of
    the camera.
    """
    parameter = name.removeprefix(WRONG)
    if name in effect_library.EFFECTS and effect_library.EFFECTS[name].kind is not EffectKind.CLOSURE:
        keys = " and ".join(f"'{c.name}'" for c in effect_library.EFFECTS[name].coefficients)
        return f", needed its key {keys}, as `identify` names it"
    if parameter in CAMERA:
        example = show(CAMERA[parameter].null, CAMERA[parameter].unit)
        return f", needed it in a trial, as it is an error of the camera; write 'camera: {{{parameter}: free from {example}}}'"
    if parameter in (*APPARATUS, *RELEASE):
        group, _, key = (QUANTITIES[parameter].key if parameter != "push_across" else "release.speed").partition(".")
        place = "the apparatus" if parameter in APPARATUS else "the trials"
        value = QUANTITIES[parameter].measured_example if QUANTITIES[parameter].usual_error else "free from 0 m/s"
        needed = f"needed it among the values of {place}"
        return f", {needed}; measure {group}.{key} again, and write there for example '{group}: {{{key}: {value}}}'"
    if parameter in known:
        effect = next((e.name for e in (effect_library.CAPSTAN,) if parameter == e.coefficients[0].name), parameter)
        return f", needed the effect itself, whose value a fit may change; write for example '{effect}: free'"
    return ""


def _by_mass(description: str, what: str) -> KeyGroup:
    """Return the type of a group with a text for each mass."""
    keys = {mass: Key(TEXT, f"{what} of the {mass} mass.") for mass in ("light", "heavy")}
    return KeyGroup(keys=keys, description=description)


def _files(keys: Mapping[str, Any]) -> tuple[tuple[str, Mapping[str, str]], ...]:
    """Return (path, {mass: track}) for each file of a trial."""
    file, files, tracks = keys.get("file"), keys.get("files", {}), keys.get("tracks", {})
    if (file is None) == (not files):
        text = "both 'file' and 'files'" if files else "nothing"
        raise input_error(f"found {text}, needed one of them; write for example 'file: first.csv'", "file")
    if files and tracks:
        raise input_error("found tracks beside a file for each mass, needed one of them; leave one out", "tracks")
    return tuple((path, {mass: ""}) for mass, path in files.items()) or ((str(file), tracks),)


def _keys_of_files(files: Sequence[tuple[str, Mapping[str, str]]]) -> dict[str, Any]:
    """Return the keys of a trial's files; the inverse of `_files`."""
    if all(list(tracks.values()) == [""] for _, tracks in files):
        return {"files": {mass: path for path, tracks in files for mass in tracks}}
    ((path, tracks),) = files
    return {"file": path} | ({"tracks": tracks} if tracks else {})


FILES = KeyGroup(
    keys={
        "file": Key(
            TEXT,
            "Its data: a Tracker export, a table, or events. Its path begins at the study's folder. Either this or `files`.",
        ),
        "files": Key(_by_mass("A file for each mass, instead of `file`.", "File")),
        "tracks": Key(_by_mass("Names of the tracks in the file; not needed where they say light and heavy.", "Track")),
    },
    from_keys=_files,
    to_keys=_keys_of_files,
)
UNITS = KeyGroup(
    keys={
        "length": Key(TEXT, "Unit of lengths; m if not given."),
        "time": Key(TEXT, "Unit of times; s if not given."),
        "angle": Key(TEXT, "Unit of angles; rad if not given."),
    }
)
CAMERA_ERRORS = KeyGroup(
    keys={n: Key(MeasuredField(quantity_kind(c, example=show(c.null, c.unit)), c.null), c.meaning) for n, c in CAMERA.items()}
)
