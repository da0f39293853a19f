"""Schema of a study file, as pydantic models, and the messages for faulty files."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BaseModel, Field, ValidationError, create_model
from pydantic_core import ErrorDetails

from looping_pendulum.errors import ScenarioError
from looping_pendulum.measured.camera import CAMERA
from looping_pendulum.measured.readers import KINDS
from looping_pendulum.measured.study import EARTH_GRAVITY, RELEASE, Estimate
from looping_pendulum.measured.study_fields import Camera, Effects, MeasuredField, low_and_high, text_by_key
from looping_pendulum.reference_ode.effects.own import OwnEffect
from looping_pendulum.reference_ode.parameters import Release
from looping_pendulum.scenarios import file_schema
from looping_pendulum.scenarios import own_effects as own_effects_of_file
from looping_pendulum.scenarios.document import Document, Path, quote
from looping_pendulum.scenarios.fields import Flag, Group, OneOf, QuantityField, Text, suggest
from looping_pendulum.scenarios.own_effects import KEY, KEY_IN_STUDY, OwnEffects
from looping_pendulum.scenarios.quantities import APPARATUS, QUANTITIES, Quantity, group_of
from looping_pendulum.scenarios.units import QuantityKind

_RELEASES = tuple(r.value for r in Release)
_RATE = QuantityField(QUANTITIES["frame_rate"].kind)
_TIME_ERROR = QuantityField(QuantityKind(unit="s", low=0.0, exclusive_low=True, example="8 ms"))
_LENGTH_ERROR = QuantityField(QuantityKind(unit="m", low=0.0, exclusive_low=True, example="1 cm"))
_ANGLE_ERROR = QuantityField(QuantityKind(unit="rad", low=0.0, exclusive_low=True, example="2 deg"))


class _Release(Group):
    """How the masses were let go."""

    kind: Annotated[str, OneOf(*_RELEASES)] = Release.LOOPING.value
    """looping: as in the demonstration; vertical: both hang; held: the heavy mass is clamped; drop: no string."""


def _measured(q: Quantity, description: str = "") -> Any:
    """Return type and default of a measured quantity's key, as pydantic makes a model of them."""
    return Annotated[Estimate, MeasuredField(q.kind)] | None, Field(
        None, description=description or q.description(in_study=True)
    )


def _group(name: str, meaning: str = "", base: type[Group] = Group, **further: Any) -> Any:
    """Return the model of a group of measured quantities, by its name in the file."""
    keys = {q.last_key: _measured(q) for q in group_of(name) if q.name in (*APPARATUS, *RELEASE)} | further
    return create_model(f"Study{name.capitalize()}Group", __base__=base, __doc__=meaning or base.__doc__, **keys)


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
    kind: Annotated[str, OneOf(*KINDS)] = "auto"
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
    dropped: Annotated[str, OneOf("light", "heavy")] = "heavy"
    """Mass whose height the file has, or that a drop lets fall."""
    mirrored: Annotated[bool, Flag()] = False
    """Whether the light mass starts on the right: the camera stood on the other side."""
    held_out: Annotated[bool, Flag()] = False
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
    releases: Annotated[list[Annotated[str, OneOf(*_RELEASES)]], Field(min_length=1)] | None = None
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
    return file_schema.json_schema(StudyFile, "Looping pendulum study")


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
    own_effects = own_effects_of_file.read(doc.data, KEY_IN_STUDY)
    for own in own_effects:
        if own.name in CAMERA:
            message = f"found the name '{own.name}', which a camera's parameter has already; needed another"
            raise doc.error((KEY_IN_STUDY, own.name), f"{message}, such as 'my_{own.name}'")
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
        if path == (KEY,):
            return f"found a key of scenarios, needed '{KEY_IN_STUDY}'"
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
