"""Schema of a study file, as pydantic models, and the messages for faulty files.

As in a scenario, every scalar is still text here, so that no unit is lost. A measured value may carry its standard error,
"10 g +/- 0.05 g" or "10 g +/- 0.5 %" (of the value); "free" stands for a value that is not known.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection
from typing import Annotated, Any

from pydantic import BaseModel, BeforeValidator, Field, GetCoreSchemaHandler, PlainValidator, ValidationError, ValidationInfo
from pydantic_core import CoreSchema, ErrorDetails, PydanticCustomError, core_schema

from looping_pendulum.discrepancy.data.camera import CAMERA
from looping_pendulum.discrepancy.data.readers import KINDS
from looping_pendulum.discrepancy.data.study import EARTH_GRAVITY, Estimate
from looping_pendulum.errors import ScenarioError
from looping_pendulum.reference_ode import effects as effect_library
from looping_pendulum.reference_ode.effects.own import OwnEffect, effect_of
from looping_pendulum.reference_ode.parameters import Release
from looping_pendulum.scenarios import own_effects as own_effects_of_file
from looping_pendulum.scenarios.document import Document, Path, quote
from looping_pendulum.scenarios.fields import Group, QuantityField, Text, input_error, quantity_kind, suggest
from looping_pendulum.scenarios.own_effects import OwnEffects
from looping_pendulum.scenarios.units import QuantityKind, UnitError, show, to_si

FREE_STARTS = {"kinetic_friction": 0.3, "static_friction": 0.3, "light_drag": 1e-3, "heavy_drag": 1e-3, "string_drag": 1e-3}
"""Initial values of "free" coefficients [SI] for which the file gives none: the order of magnitude that the paper prints.

Other coefficients start at their default.
"""
_PLUS_MINUS = re.compile(r"\+/-|\+-|±")


class MeasuredField(QuantityField):
    """Pydantic field of a quantity with its standard error."""

    def __init__(self, kind: QuantityKind, start: float | None = None) -> None:
        super().__init__(kind)
        self.start = start

    def estimate(self, raw: object) -> Estimate:
        """Return value and standard error [SI] of an entry of the file."""
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
        value = self.read(parts[0] if isinstance(raw, str) else raw)
        return Estimate(value=value, sigma=self._error(parts[1], value) if len(parts) == 2 else None)

    @property
    def way_out(self) -> str:
        """Return a value with its standard error, as an example to copy."""
        return f"{self.kind.example_text} +/- 1 %"

    def _free(self, text: str) -> Estimate:
        if text != "free":
            return Estimate(value=self.read(text.removeprefix("free from ")), free=True)
        if self.start is None:
            raise input_error(
                f"found 'free' without a start, needed one; write for example 'free from {self.kind.example_text}'"
            )
        return Estimate(value=self.start, free=True)

    def _error(self, text: str, value: float) -> float:
        try:
            if text.endswith("%"):
                sigma = abs(value) * to_si(text[:-1], "") / 100
            else:
                sigma = QuantityKind(unit=self.kind.unit).parse(text)
        except UnitError as error:
            detail = f" ({error})" if str(error) else ""
            message = f"found {quote(text)} after '+/-'{detail}, needed a standard error in the same kind of unit or in %"
            raise input_error(f"{message}; write for example '{self.way_out}'") from None
        if not (math.isfinite(sigma) and sigma > 0):
            raise input_error(
                f"found a standard error of {quote(text)}, needed one above 0; leave '+/-' out if the value is exact"
            )
        return sigma

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.no_info_plain_validator_function(self.estimate)


def _split(text: str) -> list[str]:
    """Split at each plus-minus sign; a regular expression that takes spaces off, too, would need quadratic time."""
    return [part.strip() for part in _PLUS_MINUS.split(text)]


def _length(example: str) -> MeasuredField:
    return MeasuredField(QuantityKind(unit="m", low=0.0, exclusive_low=True, example=example))


def _mass(example: str) -> MeasuredField:
    return MeasuredField(QuantityKind(unit="kg", low=0.0, exclusive_low=True, example=example))


def _flag(raw: object) -> bool:
    if raw in ("true", "false"):
        return raw == "true"
    raise input_error(f"expected true or false, got {quote(raw)}")


def _one_of(*known: str) -> BeforeValidator:
    def choose(raw: object) -> str:
        if isinstance(raw, str) and raw in known:
            return raw
        raise input_error(f"expected one of {', '.join(known)}, got {quote(raw)}{suggest(str(raw), known)}")

    return BeforeValidator(choose)


def _count(raw: object) -> int:
    # int() of very long texts takes quadratic time, so only the first digits are read before the length is known
    if isinstance(raw, str) and raw.isascii() and raw.isdigit() and 0 < int(raw[:9]) and len(raw) < 10:
        return int(raw)
    raise input_error(f"expected a whole number from 1, got {quote(raw)}; write for example '1'")


def _text_by_key(expected: str, keys: tuple[str, ...]) -> PlainValidator:
    """Return a validator of a mapping from known keys to text."""

    def read(raw: object) -> dict[str, str]:
        example = f"'{{{keys[0]}: ...}}'"
        if not isinstance(raw, dict) or not raw:
            raise input_error(f"expected {expected}, got {quote(raw)}; write for example {example}")
        for key, value in raw.items():
            if key not in keys:
                raise input_error(f"found an unknown key, needed one of: {', '.join(keys)}{suggest(key, keys)}", key)
            if not isinstance(value, str):
                raise input_error(f"expected text, got {quote(value)}; write for example {example}", key)
        return dict(raw)

    return PlainValidator(read)


def _range(kind: QuantityKind, example: str) -> PlainValidator:
    """Return a validator of a pair of a lowest and a highest value."""

    def read(raw: object) -> tuple[float, float]:
        if not isinstance(raw, list) or len(raw) != 2:
            raise input_error(f"expected a lowest and a highest value, got {quote(raw)}; write for example '{example}'")
        low, high = (QuantityField(kind).read(each) for each in raw)
        if not low <= high:
            raise input_error(f"found the lowest value above the highest, needed them in order; write for example '{example}'")
        return low, high

    return PlainValidator(read)


def _effects(raw: object, info: ValidationInfo) -> dict[str, Estimate]:
    """Return coefficient -> estimate of every declared effect; the context gives the file's own effects."""
    library = effect_library.EFFECTS | {own.name: effect_of(own) for own in info.context or ()}
    if not isinstance(raw, dict):
        raise input_error(f"expected effects with their values, got {quote(raw)}; write for example 'light_drag: free'")
    values: dict[str, Estimate] = {}
    for effect, content in raw.items():
        if effect not in library:
            near = suggest(effect, library)
            raise input_error(f"found an unknown effect, needed one of: {', '.join(library)}{near}", effect)
        known = {c.name: c for c in library[effect].coefficients}
        # A single value is that of the effect's first coefficient, which switches it on
        group = content if isinstance(content, dict) else {next(iter(known)): content}
        for name, each in group.items():
            key = f"{effect}.{name}" if isinstance(content, dict) else effect
            if name not in known:
                raise _unknown_key(name, known, key)
            c = known[name]
            values[name] = _coefficient_estimate(MeasuredField(quantity_kind(c), FREE_STARTS.get(name, c.default)), each, key)
    return values


def _camera(raw: object) -> dict[str, Estimate]:
    """Return coefficient -> estimate of every declared error of a camera, which replaces its usual prior."""
    if not isinstance(raw, dict):
        raise input_error(f"expected a group of keys ({', '.join(CAMERA)}), got {quote(raw)}; write them indented below it")
    values = {}
    for name, each in raw.items():
        if name not in CAMERA:
            raise _unknown_key(name, CAMERA, name)
        c = CAMERA[name]
        field = MeasuredField(quantity_kind(c, example=show(c.null, c.unit)), c.null)
        values[name] = _coefficient_estimate(field, each, name)
    return values


def _unknown_key(name: str, known: Collection[str], key: str) -> PydanticCustomError:
    return input_error(f"found an unknown key, needed one of: {', '.join(known)}{suggest(name, known)}", key)


def _coefficient_estimate(field: MeasuredField, raw: object, key: str) -> Estimate:
    try:
        return field.estimate(raw)
    except PydanticCustomError as error:
        raise input_error(str(error), key) from None


class StudyLightGroup(Group):
    """Keys of the light mass."""

    mass: Annotated[Estimate, _mass("10 g")] | None = None
    radius: Annotated[Estimate, _length("5 mm")] | None = None


class StudyHeavyGroup(Group):
    """Keys of the heavy mass."""

    mass: Annotated[Estimate, _mass("100 g")] | None = None


class StudyRodGroup(Group):
    """Keys of the rod."""

    radius: Annotated[Estimate, _length("6.25 mm")] | None = None


class ApparatusGroup(Group):
    """Keys of the apparatus: masses and lengths measured for all trials."""

    light: StudyLightGroup = StudyLightGroup()
    heavy: StudyHeavyGroup = StudyHeavyGroup()
    rod: StudyRodGroup = StudyRodGroup()


class StudyReleaseGroup(Group):
    """Keys of a release."""

    kind: Annotated[str, _one_of(*(str(r.value) for r in Release))] = Release.LOOPING.value
    angle: (
        Annotated[
            Estimate, MeasuredField(QuantityKind(unit="rad", low=0.0, high=2 * math.pi, exclusive_low=True, example="112 deg"))
        ]
        | None
    ) = None
    free_length: Annotated[Estimate, _length("58 cm")] | None = None
    hanging_length: Annotated[Estimate, _length("3 cm")] | None = None
    speed: Annotated[Estimate, MeasuredField(quantity_kind(effect_library.COEFFICIENTS["push_across"]))] | None = None


class EventErrorsGroup(Group):
    """Keys of standard errors of events, for tables that do not print them."""

    time: Annotated[float, QuantityField(QuantityKind(unit="s", low=0.0, exclusive_low=True, example="8 ms"))] | None = None
    length: Annotated[float, QuantityField(QuantityKind(unit="m", low=0.0, exclusive_low=True))] | None = None
    angle: Annotated[float, QuantityField(QuantityKind(unit="rad", low=0.0, exclusive_low=True, example="2 deg"))] | None = None


_RATE = QuantityField(QuantityKind(unit="Hz", low=0.0, exclusive_low=True, example="240 Hz"))


class TrialGroup(Group):
    """Keys of a trial."""

    name: Text | None = None
    file: Text | None = None
    files: Annotated[dict[str, str], _text_by_key("a file for each mass", ("light", "heavy"))] | None = None
    events: Text | None = None
    kind: Annotated[str, _one_of(*KINDS)] = "auto"
    frame_rate: Annotated[float, _RATE] | None = None
    clip_rate: Annotated[float, _RATE] | None = None
    tracks: Annotated[dict[str, str], _text_by_key("the track of each mass", ("light", "heavy"))] | None = None
    units: Annotated[dict[str, str], _text_by_key("units", ("length", "time", "angle"))] | None = None
    drop: Annotated[int, BeforeValidator(_count)] | None = None
    dropped: Annotated[str, _one_of("light", "heavy")] = "heavy"
    mirrored: Annotated[bool, BeforeValidator(_flag)] = False
    held_out: Annotated[bool, BeforeValidator(_flag)] = False
    light: StudyLightGroup = StudyLightGroup()
    heavy: StudyHeavyGroup = StudyHeavyGroup()
    release: StudyReleaseGroup = StudyReleaseGroup()
    camera: Annotated[dict[str, Estimate], PlainValidator(_camera)] = {}
    event_errors: EventErrorsGroup = EventErrorsGroup()


class LimitsGroup(Group):
    """Keys of the limits of trials that the experimenter could do next."""

    release_angle: (
        Annotated[
            tuple[float, float],
            _range(
                QuantityKind(unit="rad", low=0.0, high=2 * math.pi, exclusive_low=True, example="60 deg"), "[60 deg, 130 deg]"
            ),
        ]
        | None
    ) = None
    mass_ratio: Annotated[tuple[float, float], _range(QuantityKind(unit="", low=0.0, exclusive_low=True), "[2, 10]")] | None = (
        None
    )
    releases: Annotated[list[Annotated[str, _one_of(*(str(r.value) for r in Release))]], Field(min_length=1)] | None = None


class StudyFile(Group):
    """Keys of a study file: trials, and the effects that are declared to act in them."""

    title: Text
    apparatus: ApparatusGroup = ApparatusGroup()
    effects: Annotated[dict[str, Estimate], PlainValidator(_effects)] = {}
    own_effects: OwnEffects = {}
    fit: Annotated[list[Text], Field(min_length=1)] | None = None
    trials: Annotated[list[TrialGroup], Field(min_length=1)]
    limits: LimitsGroup = LimitsGroup()
    gravity_range: Annotated[tuple[float, float], _range(QuantityKind(unit="m/s**2", low=0.0), "[1.61 m/s^2, 1.64 m/s^2]")] = (
        EARTH_GRAVITY
    )


def check(doc: Document) -> StudyFile:
    """Check a document against the schema.

    Raises
    ------
    ScenarioError
        In one line, with the file's line and the key.
    """
    try:
        return StudyFile.model_validate(doc.data, context=_own_effects(doc))
    except ValidationError as error:
        raise _first_error(error, doc) from None


def _own_effects(doc: Document) -> tuple[OwnEffect, ...]:
    """Return the effects that a study defines; they share a namespace with the camera's parameters."""
    own_effects = own_effects_of_file.read(doc.data)
    for own in own_effects:
        if own.name in CAMERA:
            message = f"found the name '{own.name}', which a camera's parameter has already; needed another"
            raise doc.error((own_effects_of_file.KEY, own.name), f"{message}, such as 'my_{own.name}'")
    return own_effects


def _first_error(error: ValidationError, doc: Document) -> ScenarioError:
    """Return the error to correct first: an unknown key, which often is the missing one misspelt, otherwise the topmost one."""

    def order(each: ErrorDetails) -> tuple[bool, int]:
        path = _path(each)
        lines = [doc.lines[path[:n]] for n in range(len(path), 0, -1) if path[:n] in doc.lines]
        # An error without a line comes last
        return each["type"] != "extra_forbidden", lines[0] if lines else 1 << 30

    first = min(error.errors(include_url=False), key=order)
    return doc.error(_path(first), _message(first))


def _path(each: ErrorDetails) -> Path:
    """Return the keys that lead to the faulty entry."""
    key = each.get("ctx", {}).get("key")
    # Pydantic adds the names of validators to a path, which are no keys of the file
    path = tuple(p for p in each["loc"] if not (isinstance(p, str) and p.startswith("function-")))
    return (*path, *str(key).split(".")) if key else path


def _message(each: ErrorDetails) -> str:
    """Return a message in the project's words for an error of pydantic."""
    path, raw = _path(each), each["input"]
    if each["type"] == "scenario":
        return each["msg"]
    if each["type"] == "extra_forbidden":
        known = list(_model_at(path[:-1]).model_fields)
        return f"found an unknown key, needed one of: {', '.join(known)}{suggest(str(path[-1]), known)}"
    keys = ", ".join(_model_at(path).model_fields)
    if each["type"] == "missing":
        return f"missing, needed {'a list of trials, each begun with ' + repr('- ') if path == ('trials',) else 'text'}"
    if each["type"] == "too_short":
        return "found an empty list, needed at least one entry"
    if each["type"] == "list_type":
        return f"expected a list, got {quote(raw)}; begin each entry with '- '"
    return f"expected a group of keys ({keys}), got {quote(raw)}; write them indented below it"


def _model_at(path: Path) -> type[BaseModel]:
    """Return the model of the group at ``path``."""
    model: type[BaseModel] = StudyFile
    for part in path:
        if isinstance(part, str) and part in model.model_fields:
            model = _inner(model.model_fields[part].annotation) or model
    return model


def _inner(annotation: Any) -> type[BaseModel] | None:
    """Return the first model in an annotation such as ``list[TrialGroup]``."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    return next((m for a in getattr(annotation, "__args__", ()) if (m := _inner(a))), None)
