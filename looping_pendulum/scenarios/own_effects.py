"""The key ``own_effects`` of scenarios, ``candidates`` of studies: effects that the library lacks, by their formulas."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Annotated, Any

from pydantic_core import PydanticCustomError

from looping_pendulum.errors import HarnessError
from looping_pendulum.reference_ode import effects as effect_library
from looping_pendulum.reference_ode.effects.own import (
    DIRECTIONS,
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
from looping_pendulum.scenarios.fields import (
    TEXT,
    Key,
    KeyGroup,
    QuantityField,
    SimpleField,
    input_error,
    no_group,
    read_key,
)
from looping_pendulum.scenarios.units import QuantityKind, pretty

KEY = "own_effects"
"""Key of the group in a scenario."""
KEY_IN_STUDY = "candidates"
"""Key of the group in a study, where the effects are candidates unless it declares that they act."""


def _pair(raw: object) -> list[str | float]:
    if isinstance(raw, (list, tuple)) and len(raw) == 2 and all(isinstance(each, (str, float, int)) for each in raw):
        return list(raw)
    raise input_error(f"expected a lowest and a highest value, got {quote(raw)}; write for example '[-1 N, 1 N]'")


OWN_FORCE = KeyGroup(
    keys={
        "light_along_string": Key(TEXT, "On the light mass along the string, towards the rod."),
        "light_across_string": Key(TEXT, "On the light mass across the string, the way it loops."),
        "light_along_velocity": Key(TEXT, "On the light mass along its velocity; a drag is negative."),
        "light_horizontal": Key(TEXT, "On the light mass along x, to the right."),
        "light_vertical": Key(TEXT, "On the light mass along y, upward."),
        "heavy_vertical": Key(TEXT, "On the heavy mass, upward."),
    },
    description="Formulas of a force [N], by the direction in which it acts.",
)
"""Type of the key ``force``."""
_BOUNDS = SimpleField(_pair, {"type": "array", "minItems": 2, "maxItems": 2})
_OWN_EFFECT = KeyGroup(
    keys={
        "meaning": Key(TEXT, "What it is, in a few words."),
        "unit": Key(TEXT, "SI unit of the coefficient, for example N or kg/s; 1 for a pure number.", required=True),
        "bounds": Key(_BOUNDS, "Lowest and highest value of the coefficient, with units.", required=True),
        "force": Key(OWN_FORCE, required=True),
        "source": Key(TEXT, "Where the formula is from."),
    },
    description="A force that the library lacks. Its one coefficient has the effect's name, and the force vanishes where that "
    "is 0.",
)


def _own_effects(raw: object) -> tuple[OwnEffect, ...]:
    """Return the effects that a file defines, by their names."""
    if not isinstance(raw, dict):
        raise input_error(no_group((), raw))
    own = tuple(_own_effect(name, read_key(_OWN_EFFECT, content, name)) for name, content in raw.items())
    effect_tables(own)  # what one group alone does not show
    return own


def _own_effect(name: str, keys: dict[str, Any]) -> OwnEffect:
    """Return the effect of a group, after checking one entry after another, so that an error has the key of its cause."""
    entry = [name]
    try:
        check_name(name, taken_names(effect_library.EFFECTS.values()))
        entry = [name, "unit"]
        unit = "" if keys["unit"] == "1" else re.sub(r" ?([*/]) ?", r"\1", keys["unit"]).replace("^", "**")
        check_unit(unit)
        entry = [name, "bounds"]
        low, high = _bounds(keys["bounds"], unit)
        force = {direction: " ".join(text.split()) for direction, text in keys["force"].items()}
        for direction, formula in force.items():
            entry = [name, "force", direction]
            force_formula(formula, name)
        entry = [name, "force"]
        own = OwnEffect(
            name=name,
            unit=unit,
            bounds=(low, high),
            force=tuple((direction, force[direction]) for direction in DIRECTIONS if direction in force),
            meaning=keys.get("meaning", ""),
            source=keys.get("source", ""),
        )
        effect_of(own)
    except (HarnessError, PydanticCustomError) as error:
        raise input_error(str(error).removeprefix(f"{KEY}: {name}: "), *entry) from None
    return own


def _bounds(texts: Sequence[str | float], unit: str) -> tuple[float, float]:
    """Return the bounds of a coefficient [SI]."""
    quantity = QuantityField(QuantityKind(unit=unit))
    low, high = (quantity.read(each) for each in texts)
    if not low <= 0 <= high or low == high:
        shown = f"{quote(texts[0])} to {quote(texts[1])}"
        raise input_error(f"found {shown}, needed a lowest and a highest value with 0 among them, where the effect is absent")
    return low, high


def _keys_of(own: OwnEffect) -> dict[str, Any]:
    """Return an effect as nested keys and texts of a file."""
    keys = {
        "meaning": own.meaning,
        "unit": pretty(own.unit) or 1,
        "bounds": [QuantityField(QuantityKind(unit=own.unit)).write(bound) for bound in own.bounds],
        "force": dict(own.force),
        "source": own.source,
    }
    return {key: value for key, value in keys.items() if value != ""}


OwnEffects = Annotated[
    tuple[OwnEffect, ...],
    SimpleField(
        _own_effects,
        {"type": "object", "additionalProperties": _OWN_EFFECT.json_schema},
        write=lambda effects: {own.name: _keys_of(own) for own in effects},
    ),
]
"""Field type of the group: keys and texts in a file, a tuple of `OwnEffect` in the program."""


def warn_of_faulty_packages() -> None:
    """Warn of installed packages whose effects cannot be used."""
    for fault in effect_library.FAULTS:
        warn_of(fault)
