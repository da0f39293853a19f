"""Schema of a study file, as pydantic models, and the messages for faulty files."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import (
    Field,
    GetCoreSchemaHandler,
    PlainValidator,
    ValidationError,
    ValidationInfo,
    WithJsonSchema,
)
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, ErrorDetails, PydanticCustomError, core_schema

from looping_pendulum.measured.camera import CAMERA
from looping_pendulum.measured.readers import KINDS
from looping_pendulum.measured.study import EARTH_GRAVITY, RELEASE, Estimate
from looping_pendulum.reference_ode import effects as effect_library
from looping_pendulum.reference_ode.effects import Coefficient
from looping_pendulum.reference_ode.effects.own import OwnEffect, effect_of
from looping_pendulum.reference_ode.parameters import Release
from looping_pendulum.scenarios import own_effects as own_effects_of_file
from looping_pendulum.scenarios.document import Document, Path, quote
from looping_pendulum.scenarios.fields import (
    NUMBER_PATTERN,
    QUANTITY_TEXT,
    FieldType,
    Flag,
    Group,
    QuantityField,
    Text,
    first_error,
    input_error,
    keys_below,
    made_group,
    model_schema,
    one_of,
    suggest,
)
from looping_pendulum.scenarios.own_effects import KEY, KEY_IN_STUDY, OwnEffects
from looping_pendulum.scenarios.quantities import APPARATUS, QUANTITIES, Quantity, group_of, quantity_kind
from looping_pendulum.scenarios.units import QuantityKind, UnitError, show, to_si

MAX_RELATIVE_ERROR = 1000
"""Largest standard error of a value of a range without an end, in units of the value."""
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
        return Estimate(value=value, sigma=self._error(parts[1], value, parts[0]) if len(parts) == 2 else None)

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

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.no_info_plain_validator_function(self.estimate)

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


def text_by_key(expected: str, keys: Mapping[str, str]) -> FieldType:
    """Return the type of a mapping from known keys to text; ``keys`` has the meaning of each."""

    def read(raw: object) -> dict[str, str]:
        example = f"'{{{next(iter(keys))}: ...}}'"
        if not isinstance(raw, dict) or not raw:
            raise input_error(f"expected {expected}, got {quote(raw)}; write for example {example}")
        for key, value in raw.items():
            if key not in keys:
                raise input_error(f"found an unknown key, needed one of: {', '.join(keys)}{suggest(key, keys)}", key)
            if not isinstance(value, str):
                raise input_error(f"expected text, got {quote(value)}; write for example {example}", key)
        return dict(raw)

    properties = {key: {"type": "string", "description": meaning} for key, meaning in keys.items()}
    return FieldType(read=read, json_schema={"minProperties": 1} | _group_schema(properties))


def low_and_high(kind: QuantityKind, example: str) -> FieldType:
    """Return the type of a pair of a lowest and a highest value."""

    def read(raw: object) -> tuple[float, float]:
        if not isinstance(raw, list) or len(raw) != 2:
            raise input_error(f"expected a lowest and a highest value, got {quote(raw)}; write for example '{example}'")
        low, high = (QuantityField(kind).read(each) for each in raw)
        if not low <= high:
            raise input_error(f"found the lowest value above the highest, needed them in order; write for example '{example}'")
        return low, high

    words = f"the lowest and the highest value, each {kind.requirement}"
    schema = {"type": "array", "minItems": 2, "maxItems": 2, "examples": [example], QUANTITY_TEXT: words}
    return FieldType(read=read, json_schema=schema)


def _group_schema(properties: JsonSchemaValue, *, further: bool = False) -> JsonSchemaValue:
    """Return the JSON Schema of a group of keys; ``further`` allows keys of any other name."""
    return {"type": "object", "properties": properties, "additionalProperties": {} if further else False}


def _coefficient_field(c: Coefficient) -> MeasuredField:
    known = QUANTITIES.get(c.name)
    return MeasuredField(quantity_kind(c), c.default if known is None or known.free_start is None else known.free_start)


_CAMERA_FIELDS = {c.name: MeasuredField(quantity_kind(c, example=show(c.null, c.unit)), c.null) for c in CAMERA.values()}


def _estimates(group: Mapping[str, object], known: Mapping[str, MeasuredField], place: str) -> dict[str, Estimate]:
    """Return coefficient -> estimate of a group of the file; ``place`` has "{}" where its key stands in that of an error."""
    values = {}
    for name, each in group.items():
        key = place.format(name)
        if name not in known:
            raise input_error(f"found an unknown key, needed one of: {', '.join(known)}{suggest(name, known)}", key)
        try:
            values[name] = known[name].estimate(each)
        except PydanticCustomError as error:
            raise input_error(str(error), key) from None
    return values


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
        known = {c.name: _coefficient_field(c) for c in library[effect].coefficients}
        if isinstance(content, dict):
            values |= _estimates(content, known, effect + ".{}")
        else:
            # A single value is that of the effect's first coefficient, which switches it on
            values |= _estimates({next(iter(known)): content}, known, effect)
    return values


def _camera(raw: object) -> dict[str, Estimate]:
    """Return coefficient -> estimate of every declared error of a camera, which replaces its usual prior."""
    if not isinstance(raw, dict):
        raise input_error(f"expected a group of keys ({', '.join(CAMERA)}), got {quote(raw)}; write them indented below it")
    return _estimates(raw, _CAMERA_FIELDS, "{}")


def _effects_schema() -> JsonSchemaValue:
    """Return the JSON Schema of the declared effects; those that a file defines itself may be declared, too."""
    properties: JsonSchemaValue = {}
    for effect in effect_library.EFFECTS.values():
        values = {c.name: _coefficient_field(c).json_schema | {"description": c.meaning} for c in effect.coefficients}
        properties[effect.name] = {"anyOf": [next(iter(values.values())), _group_schema(values)]}
    return _group_schema(properties, further=True)


Effects = Annotated[
    dict[str, Estimate],
    PlainValidator(_effects, json_schema_input_type=Annotated[Any, WithJsonSchema(_effects_schema())]),
]
"""Field type of the declared effects: coefficient -> estimate."""
Camera = Annotated[
    dict[str, Estimate],
    FieldType(
        read=_camera,
        json_schema=_group_schema({n: f.json_schema | {"description": CAMERA[n].meaning} for n, f in _CAMERA_FIELDS.items()}),
    ),
]
"""Field type of the declared errors of a camera: coefficient -> estimate."""


_RELEASES = tuple(r.value for r in Release)
_RATE = QuantityField(QUANTITIES["frame_rate"].kind)
_TIME_ERROR = QuantityField(QuantityKind(unit="s", low=0.0, exclusive_low=True, example="8 ms"))
_LENGTH_ERROR = QuantityField(QuantityKind(unit="m", low=0.0, exclusive_low=True, example="1 cm"))
_ANGLE_ERROR = QuantityField(QuantityKind(unit="rad", low=0.0, exclusive_low=True, example="2 deg"))


class _Release(Group):
    """How the masses were let go."""

    kind: Annotated[str, one_of(*_RELEASES)] = Release.LOOPING.value
    """looping: as in the demonstration; vertical: both hang; held: the heavy mass is clamped; drop: no string."""


def _measured(q: Quantity, description: str = "") -> Any:
    """Return type and default of a measured quantity's key, as pydantic makes a model of them."""
    return Annotated[Estimate, MeasuredField(q.kind)] | None, Field(
        None, description=description or q.description(in_study=True)
    )


def _group(name: str, meaning: str = "", base: type[Group] = Group, **further: Any) -> Any:
    """Return the model of a group of measured quantities, by its name in the file."""
    keys = {q.last_key: _measured(q) for q in group_of(name) if q.name in (*APPARATUS, *RELEASE)} | further
    return made_group(f"Study{name.capitalize()}Group", meaning or base.__doc__, base, **keys)


StudyLightGroup = _group("light", "The light mass, which whips round the rod.")
StudyHeavyGroup = _group("heavy", "The heavy mass, which falls and is caught.")
StudyRodGroup = _group("rod", "The rod.")
_SPEED = "Speed of the light mass across the string as the motion begins, positive the way it loops; at rest if not given."
StudyReleaseGroup = _group("release", base=_Release, speed=_measured(QUANTITIES["push_across"], _SPEED))


class ApparatusGroup(Group):
    """The apparatus, as measured for all trials; a trial may give another value."""

    light: StudyLightGroup = StudyLightGroup()  # type: ignore[valid-type]
    heavy: StudyHeavyGroup = StudyHeavyGroup()  # type: ignore[valid-type]
    rod: StudyRodGroup = StudyRodGroup()  # type: ignore[valid-type]


class EventErrorsGroup(Group):
    """Standard errors of events, for tables that do not print them."""

    time: Annotated[float, _TIME_ERROR] | None = None
    """Of times; one unit of the last printed digit if not given."""
    length: Annotated[float, _LENGTH_ERROR] | None = None
    """Of lengths; one unit of the last printed digit if not given."""
    angle: Annotated[float, _ANGLE_ERROR] | None = None
    """Of angles; one unit of the last printed digit if not given."""


class TrialGroup(Group):
    """A trial: its file of tracked points or measured events, its release and its camera."""

    name: Text | None = None
    """Name in reports; that of the file if not given."""
    file: Text | None = None
    """Its data: a Tracker export, a table, or events. Its path begins at the study's folder. Either this or `files`."""
    files: (
        Annotated[
            dict[str, str],
            text_by_key("a file for each mass", {"light": "File of the light mass.", "heavy": "File of the heavy mass."}),
        ]
        | None
    ) = None
    """A file for each mass, instead of `file`."""
    events: Text | None = None
    """Table of measured events beside the tracked points."""
    kind: Annotated[str, one_of(*KINDS)] = "auto"
    """What the file holds; auto: as its header says."""
    frame_rate: Annotated[float, _RATE] | None = None
    """True frame rate of the camera; the file's times then only count frames."""
    clip_rate: Annotated[float, _RATE] | None = None
    """Frame rate by which the file's times were computed, for slow motion; not given: one row is one frame."""
    tracks: (
        Annotated[
            dict[str, str],
            text_by_key("the track of each mass", {"light": "Track of the light mass.", "heavy": "Track of the heavy mass."}),
        ]
        | None
    ) = None
    """Names of the tracks in the file; not needed where they say light and heavy."""
    units: (
        Annotated[
            dict[str, str],
            text_by_key(
                "units",
                {
                    "length": "Unit of lengths; m if not given.",
                    "time": "Unit of times; s if not given.",
                    "angle": "Unit of angles; rad if not given.",
                },
            ),
        ]
        | None
    ) = None
    """Units of the columns whose header has none."""
    run: Text | None = None
    """Number of the run or drop, in a file of several."""
    dropped: Annotated[str, one_of("light", "heavy")] = "heavy"
    """Mass whose height the file has, or that a drop lets fall."""
    mirrored: Flag = False
    """Whether the light mass starts on the right: the camera stood on the other side."""
    held_out: Flag = False
    """Whether the error before and after is judged on the trial, by fits to the others alone."""
    light: StudyLightGroup = StudyLightGroup()  # type: ignore[valid-type]
    heavy: StudyHeavyGroup = StudyHeavyGroup()  # type: ignore[valid-type]
    release: StudyReleaseGroup = StudyReleaseGroup()  # type: ignore[valid-type]
    camera: Camera = {}
    """Errors of the camera, with what is known of each."""
    event_errors: EventErrorsGroup = EventErrorsGroup()


class LimitsGroup(Group):
    """Limits of the trials that could be done next, for the proposal of the next experiment."""

    release_angle: (
        Annotated[tuple[float, float], low_and_high(QUANTITIES["release_angle"].kind, "[60 deg, 130 deg]")] | None
    ) = None
    """Smallest and largest angle of release."""
    mass_ratio: Annotated[tuple[float, float], low_and_high(QUANTITIES["mass_ratio"].kind, "[2, 10]")] | None = None
    """Smallest and largest ratio M2/M1."""
    releases: Annotated[list[Annotated[str, one_of(*_RELEASES)]], Field(min_length=1)] | None = None
    """Kinds of release that are possible; all if not given."""


class StudyFile(Group):
    """Trials of one apparatus, and the effects that are declared to act in them."""

    title: Text
    """A few words."""
    apparatus: ApparatusGroup = ApparatusGroup()
    effects: Effects = {}
    """Effects that are declared to act, each with the value of its first coefficient, or a group of its coefficients."""
    candidates: OwnEffects = {}
    """Effects that the library lacks, each with its formula: candidates, unless `effects` declares them."""
    fit: Annotated[list[Text], Field(min_length=1)] | None = None
    """Names of what a fit may change; if not given, all that is free or has a standard error."""
    trials: Annotated[list[TrialGroup], Field(min_length=1)]
    """The trials; at least one is not held out."""
    limits: LimitsGroup = LimitsGroup()
    gravity_range: Annotated[
        tuple[float, float], low_and_high(QuantityKind(unit="m/s**2", low=0.0), "[1.61 m/s^2, 1.64 m/s^2]")
    ] = EARTH_GRAVITY
    """Acceleration of free fall that there may be where the trials were made; that on Earth if not given."""


def json_schema() -> dict[str, Any]:
    """Return the JSON Schema (draft 2020-12) of a study file, for editors that complete and check YAML."""
    return model_schema(StudyFile, "Looping pendulum study")


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
        raise first_error(error, doc, StudyFile, _own_words) from None


def _own_effects(doc: Document) -> tuple[OwnEffect, ...]:
    """Return the effects that a study defines; they share a namespace with the camera's parameters."""
    own_effects = own_effects_of_file.read(doc.data, KEY_IN_STUDY)
    for own in own_effects:
        if own.name in CAMERA:
            message = f"found the name '{own.name}', which a camera's parameter has already; needed another"
            raise doc.error((KEY_IN_STUDY, own.name), f"{message}, such as 'my_{own.name}'")
    return own_effects


def _own_words(each: ErrorDetails, path: Path) -> str:
    """Return a message of a study's own for an error of pydantic, '' if it is that of other files."""
    if each["type"] == "extra_forbidden":
        if path == (KEY,):
            return f"found a key of scenarios, needed '{KEY_IN_STUDY}'"
        known = keys_below(StudyFile, path[:-1])
        return f"found an unknown key, needed one of: {', '.join(known)}{suggest(str(path[-1]), known)}"
    if each["type"] == "missing":
        return f"missing, needed {'a list of trials, each begun with ' + repr('- ') if path == ('trials',) else 'text'}"
    return "found an empty list, needed at least one entry" if each["type"] == "too_short" else ""
