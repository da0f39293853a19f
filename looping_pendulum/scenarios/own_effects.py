"""The key ``own_effects`` of scenarios, ``candidates`` of studies: effects that the library lacks, by their formulas."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, cast

from pydantic import AfterValidator, BaseModel, PlainValidator, WithJsonSchema, create_model
from pydantic_core import PydanticCustomError

from looping_pendulum.errors import HarnessError
from looping_pendulum.reference_ode import effects as effect_library
from looping_pendulum.reference_ode.effects.own import (
    OwnEffect,
    check_name,
    check_unit,
    effect_of,
    force_formula,
    taken_names,
    warn_of,
)
from looping_pendulum.reference_ode.parameters import effect_tables
from looping_pendulum.scenarios.document import quote
from looping_pendulum.scenarios.fields import Group, QuantityField, Text, input_error
from looping_pendulum.scenarios.units import QuantityKind, pretty, show

KEY = "own_effects"
"""Key of the group in a scenario."""
KEY_IN_STUDY = "candidates"
"""Key of the group in a study, where the effects are candidates unless it declares that they act."""


def _pair(raw: object) -> list[str]:
    if isinstance(raw, list) and len(raw) == 2 and all(isinstance(each, str) for each in raw):
        return raw
    raise input_error(f"expected a lowest and a highest value, got {quote(raw)}; write for example '[-1 N, 1 N]'")


class OwnForceGroup(Group):
    """Formulas of a force [N], by the direction in which it acts."""

    light_along_string: Text | None = None
    """On the light mass along the string, towards the rod."""
    light_across_string: Text | None = None
    """On the light mass across the string, the way it loops."""
    light_along_velocity: Text | None = None
    """On the light mass along its velocity; a drag is negative."""
    light_horizontal: Text | None = None
    """On the light mass along x, to the right."""
    light_vertical: Text | None = None
    """On the light mass along y, upward."""
    heavy_vertical: Text | None = None
    """On the heavy mass, upward."""


class OwnEffectGroup(Group):
    """A force that the library lacks. Its one coefficient has the effect's name, and the force vanishes where that is 0."""

    meaning: Text = ""
    """What it is, in a few words."""
    unit: Text
    """SI unit of the coefficient, for example N or kg/s; 1 for a pure number."""
    bounds: Annotated[list[str], PlainValidator(_pair), WithJsonSchema({"type": "array", "minItems": 2, "maxItems": 2})]
    """Lowest and highest value of the coefficient, with units."""
    force: OwnForceGroup
    source: Text = ""
    """Where the formula is from."""


def _own_effects(groups: dict[str, OwnEffectGroup]) -> tuple[OwnEffect, ...]:
    own = tuple(_own_effect(name, group) for name, group in groups.items())
    effect_tables(own)  # what one group alone does not show
    return own


def _own_effect(name: str, group: OwnEffectGroup) -> OwnEffect:
    """Return the effect of a group, after checking one entry after another, so that an error has the key of its cause."""
    key = name
    try:
        check_name(name, taken_names(effect_library.EFFECTS.values()))
        key = f"{name}.unit"
        unit = "" if group.unit == "1" else re.sub(r" ?([*/]) ?", r"\1", group.unit).replace("^", "**")
        check_unit(unit)
        key = f"{name}.bounds"
        low, high = _bounds(group.bounds, unit)
        force = {direction: " ".join(text.split()) for direction, text in group.force if text is not None}
        for direction, formula in force.items():
            key = f"{name}.force.{direction}"
            force_formula(formula, name)
        key = f"{name}.force"
        own = OwnEffect(
            name=name,
            unit=unit,
            bounds=(low, high),
            force=tuple(force.items()),
            meaning=group.meaning,
            source=group.source,
        )
        effect_of(own)
    except (HarnessError, PydanticCustomError) as error:
        raise input_error(str(error).removeprefix(f"{KEY}: {name}: "), key) from None
    return own


def _bounds(texts: Sequence[str], unit: str) -> tuple[float, float]:
    """Return the bounds of a coefficient [SI]."""
    quantity = QuantityField(QuantityKind(unit=unit))
    low, high = (quantity.read(each) for each in texts)
    if not low <= 0 <= high or low == high:
        shown = f"{quote(texts[0])} to {quote(texts[1])}"
        raise input_error(f"found {shown}, needed a lowest and a highest value with 0 among them, where the effect is absent")
    return low, high


OwnEffects = Annotated[dict[str, OwnEffectGroup], AfterValidator(_own_effects)]
"""Field type of the group: keys and texts in a file, a tuple of `OwnEffect` in the program."""


# The group has to be read before the others, which may name what it defines
_FILES: dict[str, type[BaseModel]] = {
    key: create_model(f"file with {key}", **{key: (OwnEffects, {})})  # type: ignore[call-overload]
    for key in (KEY, KEY_IN_STUDY)
}
"""Key of the group -> model of a file of which only that group is read."""


def read(data: Mapping[str, Any], key: str = KEY) -> tuple[OwnEffect, ...]:
    """Return the effects that the content of a file defines below a key, and warn of packages whose effects cannot be used.

    Raises
    ------
    pydantic.ValidationError
        If they are faulty.
    """
    for fault in effect_library.FAULTS:
        warn_of(fault)
    # A type checker does not see what a validator gives; without the key it is the empty default
    return cast("tuple[OwnEffect, ...]", tuple(getattr(_FILES[key].model_validate(data), key)))


def tree(own_effects: Sequence[OwnEffect]) -> dict[str, Any]:
    """Return effects as nested keys and texts of a file, which `read` reads."""
    groups = {
        own.name: {
            "meaning": own.meaning,
            "unit": pretty(own.unit) or 1,
            "bounds": [show(bound, own.unit) if own.unit else bound for bound in own.bounds],
            "force": dict(own.force),
            "source": own.source,
        }
        for own in own_effects
    }
    return {name: {key: value for key, value in group.items() if value != ""} for name, group in groups.items()}
