"""Pydantic models of a scenario file: its keys, what each takes, and the error messages.

The models read plain data whose every scalar is still text (see `document`), so that units are not lost before validation.
Their docstrings become descriptions in the JSON Schema for editors.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Annotated, Any

from pydantic import AfterValidator, Field, ValidationInfo, with_config
from pydantic.json_schema import JsonSchemaValue

from looping_pendulum.reference_ode import effects as effect_library
from looping_pendulum.reference_ode.effects.own import OwnEffect, effect_of
from looping_pendulum.reference_ode.parameters import Release
from looping_pendulum.scenarios.document import quote
from looping_pendulum.scenarios.fields import (
    FILE_CONFIG,
    TEXT,
    DependentField,
    FieldType,
    Group,
    Key,
    KeyGroup,
    QuantityField,
    SimpleField,
    Text,
    input_error,
    model_schema,
    no_group,
    one_of,
    read_key,
)
from looping_pendulum.scenarios.metrics import METRICS, Metric
from looping_pendulum.scenarios.own_effects import OwnEffects
from looping_pendulum.scenarios.quantities import FILE_KEYS, QUANTITIES, group_of, quantity_kind
from looping_pendulum.scenarios.scenario import PROFILES, Inference, MeasuredTable, Tolerance
from looping_pendulum.scenarios.units import QuantityKind

AIR_DENSITY = 1.2
"""Density of air [kg/m^3] for a drag shape that does not give it (paper, sec. IV)."""


def _check_measured(measured: MeasuredTable, info: ValidationInfo) -> MeasuredTable:
    """Check the path, which cannot leave the data folder, and the checksum; what the program makes is taken as it is."""
    if info.context is None:
        return measured
    file, sha256 = measured.file, measured.sha256
    if not re.fullmatch(r"[\w.-]+(/[\w.-]+)*", file) or {".", ".."} & set(file.split("/")):
        expected = "a path below a data folder, with forward slashes and no '..'"
        raise input_error(f"expected {expected}, got {quote(file)}; write for example 'paper/trial.csv'", "file")
    if not re.fullmatch(r"[0-9a-fA-F]{64}", sha256):
        needed = "64 hexadecimal digits"
        raise input_error(f"expected {needed}, got {quote(sha256)}; copy what 'sha256sum FILE' prints", "sha256")
    return replace(measured, sha256=sha256.lower())


_DRAGS = ("light_drag", "heavy_drag")
_SHAPE = KeyGroup(
    keys={
        "shape_factor": Key(
            QuantityField(QuantityKind(unit="", low=0.0, high=10.0, example="1.0")),
            "Drag coefficient C: about 0.5 for a ball, 1 for a cylinder.",
            required=True,
        ),
        "area": Key(
            QuantityField(QuantityKind(unit="m**2", low=0.0, high=1.0, exclusive_low=True)),
            "Area across the motion: pi r^2 for a ball, height times diameter for a cylinder.",
            required=True,
        ),
        "air_density": Key(
            QuantityField(QuantityKind(unit="kg/m**3", low=0.0, high=2000.0)),
            f"Density of the air; {AIR_DENSITY:g} kg/m^3 if not given.",
        ),
    },
    description="Quadratic drag by shape, gamma = C rho A / 2.",
)


def _drag_or_shape(number: QuantityField) -> SimpleField:
    """Return the type of a quadratic drag, by its coefficient or by the shape from which this follows."""

    def read(raw: object) -> float:
        if not isinstance(raw, dict):
            coefficient: float = number.read(raw)
            return coefficient
        shape = {"air_density": AIR_DENSITY} | _SHAPE.read(raw)
        return effect_library.drag_coefficient(shape["shape_factor"], shape["air_density"], shape["area"])

    return SimpleField(read, {"anyOf": [number.json_schema, _SHAPE.json_schema]}, write=number.write)


def _field_of(name: str) -> FieldType:
    """Return the type of a quantity."""
    number = QuantityField(QUANTITIES[name].kind)
    return _drag_or_shape(number) if name in _DRAGS else number


def _group(name: str, description: str) -> KeyGroup:
    """Return the type of a group of quantities, by its name in the file."""
    keys = {}
    for q in group_of(name):
        shape = ", or the shape from which it follows" if q.name in _DRAGS else ""
        keys[q.last_key] = Key(_field_of(q.name), f"{q.description().removesuffix('.')}{shape}.", q.required)
    return KeyGroup(keys=keys, description=description)


def with_kind(group: KeyGroup, **changes: Any) -> KeyGroup:
    """Return the type of a group of quantities of a release, with its kind and other changes."""
    meaning = (
        "looping, if not given: as in the demonstration; vertical: both hang; held: the heavy mass is clamped; drop: no string."
    )
    return replace(group, keys={"kind": Key(one_of(*Release), meaning), **group.keys}, **changes)


def _release(keys: dict[str, Any]) -> dict[str, Any]:
    """Require an angle, except for a vertical release, which hangs at 180 deg."""
    keys = {"kind": Release.LOOPING} | keys
    is_vertical, angle = keys["kind"] is Release.VERTICAL, keys.get("angle")
    if angle is None and not is_vertical:
        message = f"missing, and a {keys['kind']} release needed an angle; write for example 'angle: 112 deg'"
        raise input_error(message, "angle")
    if angle not in (None, math.pi) and is_vertical:
        found = f"found {math.degrees(angle):g} deg"
        raise input_error(f"{found}, needed no angle: a vertical release hangs at 180 deg; leave it out", "angle")
    # `Parameters` requires an angle, though a vertical release determines it
    return keys | {"angle": math.pi if angle is None else angle}


def _effects_group(own: Iterable[OwnEffect] = ()) -> KeyGroup:
    """Return the group of coefficients of effects: of those of the library that have no other key, and of the file's own."""
    known = {name: c for name, c in effect_library.COEFFICIENTS.items() if name not in FILE_KEYS}
    known |= {c.name: c for each in own for c in effect_of(each).coefficients}
    keys = {name: Key(QuantityField(quantity_kind(c)), c.meaning) for name, c in known.items()}
    return KeyGroup(keys=keys, description="Coefficients of further effects.")


def _effects(raw: object, before: Mapping[str, Any]) -> Any:
    """Return coefficient -> value [SI]; the file's own may be faulty, so that nobody knows which names there are."""
    return _effects_group(before["own_effects"]).read(raw) if "own_effects" in before else {}


Values = dict[str, Any]
"""Key of a group -> value [SI]."""


# The classes themselves know nothing of pydantic, which an engine's environment may lack
for _class in (Inference, MeasuredTable):
    with_config(FILE_CONFIG)(_class)


def _limit_of(metric: Metric) -> KeyGroup:
    """Return the type of the limit on a metric."""
    example = {"m": "0.6 mm", "s": "8 ms", "rad": "0.01 rad", "": "0.003"}.get(metric.unit, "")
    quantity = QuantityField(QuantityKind(unit=metric.unit, low=0.0, example=example))
    meaning = "Largest magnitude of the metric that is accepted, or for a few metrics the smallest value."
    return KeyGroup(
        keys={
            "limit": Key(quantity, meaning, required=True),
            "reason": Key(TEXT, "Why this much: its source.", required=True),
            "expected_failure": Key(TEXT, "Measured reason why it is not kept; then keeping it is the surprise."),
        }
    )


class _Tolerances(FieldType):
    """Limits by engine, profile and metric; metrics of other packages are known only once a file or its schema is read."""

    @property
    def _of_engine(self) -> KeyGroup:
        limits = KeyGroup(keys={name: Key(_limit_of(metric), metric.description) for name, metric in METRICS.items()})
        keys = {profile: Key(limits, f"Limits with the settings of the profile {profile}.") for profile in PROFILES}
        return KeyGroup(keys=keys, description="One engine's limits, by profile.")

    def read(self, raw: object, /) -> tuple[Tolerance, ...]:
        """Return the tolerances of a file."""
        if not isinstance(raw, dict):
            raise input_error(no_group((), raw))
        of_engine = self._of_engine
        return tuple(
            Tolerance(engine=engine, profile=profile, metric=metric, **limit)
            for engine, profiles in raw.items()
            for profile, limits in read_key(of_engine, profiles, engine).items()
            for metric, limit in limits.items()
        )

    def write(self, value: Any, /) -> Any:
        """Return tolerances as a file has them."""
        tree: dict[str, dict[str, dict[str, Any]]] = {}
        for t in value:
            keys = {"limit": t.limit, "reason": t.reason}
            keys |= {"expected_failure": t.expected_failure} if t.expected_failure else {}
            limits = tree.setdefault(t.engine, {}).setdefault(t.profile, {})
            limits[t.metric] = _limit_of(METRICS[t.metric]).write(keys)
        return tree

    @property
    def json_schema(self) -> JsonSchemaValue:
        """Return the JSON Schema of the tolerances."""
        return {"type": "object", "additionalProperties": self._of_engine.json_schema}


class ScenarioFile(Group):
    """A trial of the looping pendulum: apparatus, release, and what is expected of an engine that rebuilds it."""

    title: Text
    """A few words."""
    description: Text = ""
    """What there is to see, for a reader who has not seen it."""
    light: Annotated[Values, _group("light", "The light mass, which whips round the rod.")]
    heavy: Annotated[Values, _group("heavy", "The heavy mass, which falls and is caught.")]
    rod: Annotated[Values, _group("rod", "The rod.")]
    string: Annotated[Values, _group("string", "The string, and its friction on the rod.")] = {}
    gravity: Annotated[float, _field_of("gravity")] | None = Field(None, description=QUANTITIES["gravity"].description())
    release: Annotated[Values, with_kind(_group("release", "How the masses are let go."), from_keys=_release)]
    duration: Annotated[float, _field_of("duration")] = Field(description=QUANTITIES["duration"].description())
    inferred: tuple[Inference, ...] = ()
    """What the source does not print, and how it was inferred."""
    measured: Annotated[MeasuredTable, AfterValidator(_check_measured)] | None = None
    tolerances: Annotated[tuple[Tolerance, ...], _Tolerances()] = ()
    """Engine and variant ("pymunk:chain"), profile and metric -> limit."""
    own_effects: OwnEffects = ()
    """Effects that the library lacks, each with its formula; their coefficients stand under effects, too."""
    effects: Annotated[dict[str, float], DependentField(_effects, _effects_group().json_schema)] = {}
    """Coefficients of further effects."""


def json_schema() -> dict[str, Any]:
    """Return the JSON Schema (draft 2020-12) of a scenario file, for editors that complete and check YAML."""
    return model_schema(ScenarioFile, "Looping pendulum scenario")
