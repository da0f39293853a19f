"""Pydantic models of a scenario file: its keys, what each takes, and the error messages.

The models read plain data whose every scalar is still text (see `document`), so that units are not lost before validation.
Their docstrings become descriptions in the JSON Schema for editors.
"""

from __future__ import annotations

import functools
import math
import re
from collections.abc import Iterable
from typing import Annotated, Any

from pydantic import (
    BaseModel,
    BeforeValidator,
    Discriminator,
    Field,
    Tag,
    ValidationInfo,
    model_validator,
)

from looping_pendulum.reference_ode import effects as effect_library
from looping_pendulum.reference_ode import parameters
from looping_pendulum.reference_ode.effects import Coefficient
from looping_pendulum.scenarios.document import quote
from looping_pendulum.scenarios.fields import Group, QuantityField, Text, input_error, made_group, model_schema, one_of, suggest
from looping_pendulum.scenarios.metrics import METRICS
from looping_pendulum.scenarios.own_effects import OwnEffects
from looping_pendulum.scenarios.quantities import FILE_KEYS, QUANTITIES, Quantity, file_key, group_of, quantity_kind
from looping_pendulum.scenarios.units import QuantityKind


def _parameter_key(value: object, info: ValidationInfo) -> str:
    """Validate a key of a scenario file, "release.angle"; the context gives the file's own coefficients."""
    coefficients = (*effect_library.COEFFICIENTS, *(info.context or ()))
    known = [*FILE_KEYS.values(), *map(file_key, coefficients)]
    if isinstance(value, str) and value in known:
        return value
    hint = suggest(value, known) if isinstance(value, str) else ""
    raise input_error(f"expected a key of this file such as 'release.angle', got {quote(value)}{hint}")


def _data_path(value: object) -> str:
    """Validate a path that cannot leave the data folder."""
    parts = value.split("/") if isinstance(value, str) else []
    if isinstance(value, str) and re.fullmatch(r"[\w.-]+(/[\w.-]+)*", value) and not {".", ".."} & set(parts):
        return value
    expected = "a path below a data folder, with forward slashes and no '..'"
    raise input_error(f"expected {expected}, got {quote(value)}; write for example 'paper/trial.csv'")


def _sha256(value: object) -> str:
    """Validate a SHA-256 checksum."""
    if isinstance(value, str) and re.fullmatch(r"[0-9a-fA-F]{64}", value):
        return value.lower()
    raise input_error(f"expected 64 hexadecimal digits, got {quote(value)}; copy what 'sha256sum FILE' prints")


class DragShape(Group):
    """Quadratic drag by shape, gamma = C rho A / 2."""

    shape_factor: Annotated[float, QuantityField(QuantityKind(unit="", low=0.0, high=10.0, example="1.0"))]
    """Drag coefficient C: about 0.5 for a ball, 1 for a cylinder."""
    area: Annotated[float, QuantityField(QuantityKind(unit="m**2", low=0.0, high=1.0, exclusive_low=True))]
    """Area across the motion: pi r^2 for a ball, height times diameter for a cylinder."""
    air_density: Annotated[float, QuantityField(QuantityKind(unit="kg/m**3", low=0.0, high=2000.0))] | None = None
    """Density of the air; 1.2 kg/m^3 if not given."""


def _annotation(q: Quantity) -> Any:
    """Return the type of a quantity's key; a quadratic drag may be given by a shape, too."""
    number = Annotated[float, QuantityField(q.kind)]
    if q.name not in ("light_drag", "heavy_drag"):
        return number
    # Tags in brackets, as no key has them: `fields.first_error` takes them out of the paths that it shows
    return Annotated[
        Annotated[number, Tag("<direct>")] | Annotated[DragShape, Tag("<shape>")],
        Discriminator(lambda value: "<shape>" if isinstance(value, dict) else "<direct>"),
    ]


def _key_of(q: Quantity) -> Any:
    """Return type and default of a quantity's key, as pydantic makes a model of them."""
    shape = ", or the shape from which it follows" if q.name in ("light_drag", "heavy_drag") else ""
    description = f"{q.description().removesuffix('.')}{shape}."
    if q.required:
        return _annotation(q), Field(description=description)
    return _annotation(q) | None, Field(None, description=description)


def _group(name: str, meaning: str = "", base: type[Group] = Group) -> Any:
    """Return the model of a group of quantities, by its name in the file."""
    keys: dict[str, Any] = {q.last_key: _key_of(q) for q in group_of(name)}
    return made_group(f"{name.capitalize()}Group", meaning or base.__doc__, base, **keys)


class _Release(Group):
    """How the masses are let go."""

    kind: Annotated[str, one_of(*(r.value for r in parameters.Release))] = parameters.Release.LOOPING.value
    """looping: as in the demonstration; vertical: both hang; held: the heavy mass is clamped; drop: no string."""
    # A placeholder for the quantity that is checked here; the table of quantities has its type
    angle: Any = None

    @model_validator(mode="after")
    def _check_angle(self) -> _Release:
        """Require an angle, except for a vertical release, which hangs at 180 deg."""
        vertical = self.kind == parameters.Release.VERTICAL.value
        if self.angle is None and not vertical:
            raise input_error(
                f"missing, and a {self.kind} release needed an angle; write for example 'angle: 112 deg'", "angle"
            )
        if self.angle is not None and vertical and self.angle != math.pi:
            degrees = math.degrees(self.angle)
            raise input_error(
                f"found {degrees:g} deg, needed no angle: a vertical release hangs at 180 deg; leave it out", "angle"
            )
        return self


LightGroup = _group("light", "The light mass, which whips round the rod.")
HeavyGroup = _group("heavy", "The heavy mass, which falls and is caught.")
RodGroup = _group("rod", "The rod.")
StringGroup = _group("string", "The string, and its friction on the rod.")
ReleaseGroup = _group("release", base=_Release)
Gravity = _annotation(QUANTITIES["gravity"])
Duration = _annotation(QUANTITIES["duration"])


class InferredGroup(Group):
    """Values that the source does not print."""

    parameters: Annotated[list[Annotated[str, BeforeValidator(_parameter_key)]], Field(min_length=1)]
    """Keys of this file, as "release.angle"."""
    how: Text
    """How they were found."""
    script: Text = ""
    """The script that found them; not given for an assumption."""


class MeasuredGroup(Group):
    """The measured event table of this trial."""

    file: Annotated[str, BeforeValidator(_data_path)]
    """Path below a data folder; the data is not part of the package."""
    sha256: Annotated[str, BeforeValidator(_sha256)]
    """Checksum of that file."""
    source: Text
    """Who measured it and where it is printed."""


class Limit(Group):
    """What an engine must keep."""

    limit: float
    """Largest magnitude of the metric that is accepted, or for a few metrics the smallest value."""
    reason: Text
    """Why this much: its source."""
    expected_failure: Text = ""
    """Measured reason why it is not kept; then keeping it is the surprise."""


def _limit_of(unit: str) -> type[Limit]:
    """Return the model of a limit on a metric with this SI unit."""
    example = {"m": "0.6 mm", "s": "8 ms", "rad": "0.01 rad", "": "0.003"}.get(unit, "")
    quantity = QuantityField(QuantityKind(unit=unit, low=0.0, example=example))
    limit: Any = (Annotated[float, quantity], Field(description=Limit.model_fields["limit"].description))
    return made_group(f"Limit of {unit or 'a number'}", None, Limit, limit=limit)


_LIMITS = {unit: _limit_of(unit) for unit in dict.fromkeys(metric.unit for metric in METRICS.values())}

# Names such as rms_0.35s are not valid Python names, so they are aliases of the fields.
_METRIC_FIELDS: dict[str, Any] = {
    f"metric_{i}": (_LIMITS[metric.unit] | None, Field(None, alias=metric.name, description=metric.description))
    for i, metric in enumerate(METRICS.values())
}
Limits: type[BaseModel] = made_group("Limits", None, Group, **_METRIC_FIELDS)


class ProfilesGroup(Group):
    """One engine's limits, by profile."""

    quick: Limits | None = None  # type: ignore[valid-type]
    """Limits with the settings of the profile quick."""
    accurate: Limits | None = None  # type: ignore[valid-type]
    """Limits with the settings of the profile accurate."""


class ScenarioFile(Group):
    """A trial of the looping pendulum: apparatus, release, and what is expected of an engine that rebuilds it."""

    title: Text
    """A few words."""
    description: Text = ""
    """What there is to see, for a reader who has not seen it."""
    light: LightGroup  # type: ignore[valid-type]
    heavy: HeavyGroup  # type: ignore[valid-type]
    rod: RodGroup  # type: ignore[valid-type]
    string: StringGroup = StringGroup()  # type: ignore[valid-type]
    gravity: Gravity | None = _key_of(QUANTITIES["gravity"])[1]  # type: ignore[valid-type]
    release: ReleaseGroup  # type: ignore[valid-type]
    duration: Duration = _key_of(QUANTITIES["duration"])[1]  # type: ignore[valid-type]
    inferred: list[InferredGroup] = []
    """What the source does not print, and how it was inferred."""
    measured: MeasuredGroup | None = None
    tolerances: dict[str, ProfilesGroup] = {}
    """Engine and variant ("pymunk:chain"), profile and metric -> limit."""
    own_effects: OwnEffects = {}
    """Effects that the library lacks, each with its formula; their coefficients stand under effects, too."""
    # A placeholder: `_file_model` puts a group with the library's coefficients here
    effects: Any = None
    """Coefficients of further effects."""


def file_model(own: Iterable[Coefficient] = ()) -> type[ScenarioFile]:
    """Return the model of a whole file, with a key under ``effects`` for each coefficient that is in no other group.

    Parameters
    ----------
    own
        Coefficients of the effects that the file defines.
    """
    return _file_model((*(c for name, c in effect_library.COEFFICIENTS.items() if name not in FILE_KEYS), *own))


@functools.lru_cache(maxsize=8)
def _file_model(others: tuple[Coefficient, ...]) -> type[ScenarioFile]:
    """Return the model of a whole file with these coefficients under ``effects``; cached, because building it is slow."""
    fields: dict[str, Any] = {
        c.name: (Annotated[float, QuantityField(quantity_kind(c))] | None, Field(None, description=c.meaning)) for c in others
    }
    effects = made_group("EffectsGroup", "Coefficients of further effects.", Group, **fields)
    return made_group("ScenarioFile", ScenarioFile.__doc__, ScenarioFile, effects=(effects, effects()))


def json_schema() -> dict[str, Any]:
    """Return the JSON Schema (draft 2020-12) of a scenario file, for editors that complete and check YAML."""
    return model_schema(file_model(), "Looping pendulum scenario")
