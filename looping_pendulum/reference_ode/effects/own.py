"""Effects that a study or a scenario brings itself: forces as formulas, plain data that travel to every process and back.

An `OwnEffect` is text and numbers alone; `effect_of` makes the `Effect` of it, wherever it is needed.
"""

from __future__ import annotations

import keyword
import re
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from functools import lru_cache
from types import MappingProxyType, SimpleNamespace
from typing import Any

from looping_pendulum.errors import ParameterError, shorten
from looping_pendulum.reference_ode.effects.check import check_effect
from looping_pendulum.reference_ode.effects.formula import CONSTANTS, FUNCTIONS, FormulaError, ParsedFormula, parse
from looping_pendulum.reference_ode.effects.types import Coefficient, Effect, EffectKind, Kinematics
from looping_pendulum.reference_ode.geometry import light_position, light_velocity

REST_SPEED = 1e-3
"""Speed below which a force along the velocity is rounded off [m/s]: the direction of a velocity is not analytic at rest."""
NAME = re.compile(r"[a-z][a-z0-9_]{0,39}")
"""Regular expression of the name of an effect."""

_Coordinate = Callable[[Any, Kinematics, Any], Any]


def _position(i: int) -> _Coordinate:
    return lambda xp, k, p: light_position(xp, k.free_length, k.wrap_angle, p.rod_radius)[i]


def _velocity(i: int) -> _Coordinate:
    return lambda xp, k, p: light_velocity(xp, k.wrap_angle, k.retreat_speed, k.across_speed)[i]


COORDINATES: Mapping[str, _Coordinate] = MappingProxyType(
    {
        "time": lambda xp, k, p: k.time,
        "light_x": _position(0),
        "light_y": _position(1),
        "light_vx": _velocity(0),
        "light_vy": _velocity(1),
        "light_mass_speed": lambda xp, k, p: k.light_mass_speed,
        "free_length": lambda xp, k, p: k.free_length,
        "wrap_angle": lambda xp, k, p: k.wrap_angle,
        "retreat_speed": lambda xp, k, p: k.retreat_speed,
        "across_speed": lambda xp, k, p: k.across_speed,
        "across_speed_size": lambda xp, k, p: k.across_speed_size,
        "heavy_speed": lambda xp, k, p: k.heavy_speed,
        "heavy_speed_size": lambda xp, k, p: k.heavy_speed_size,
    }
)
"""Quantity that a formula may name -> its value (SI); docs/write-an-effect.md says what each is."""

_Components = Callable[[Any, Kinematics, Any], tuple[Any, Any]]


def _along_velocity(xp: Any, k: Kinematics, force: Any) -> tuple[Any, Any]:
    """Return a force along the light mass's velocity, (along, across) the string [N]."""
    u, w, z = k.retreat_speed, k.across_speed, k.sideways_speed
    share = force / xp.sqrt(u * u + w * w + z * z + REST_SPEED * REST_SPEED)
    return -share * u, share * w


LIGHT_DIRECTIONS: Mapping[str, _Components] = MappingProxyType(
    {
        "light_along_string": lambda xp, k, force: (force, 0.0),
        "light_across_string": lambda xp, k, force: (0.0, force),
        "light_along_velocity": _along_velocity,
        "light_horizontal": lambda xp, k, force: (force * xp.sin(k.wrap_angle), -force * xp.cos(k.wrap_angle)),
        "light_vertical": lambda xp, k, force: (-force * xp.cos(k.wrap_angle), -force * xp.sin(k.wrap_angle)),
    }
)
"""Direction of a force on the light mass -> its components (along, across) the string.

In this order: along the string towards the rod, across it the way the mass loops, along its velocity, along x, along y.
"""
HEAVY_DIRECTION = "heavy_vertical"
"""Direction of a force on the heavy mass: upward (along its string, if it swings)."""
DIRECTIONS = (*LIGHT_DIRECTIONS, HEAVY_DIRECTION)
"""Directions in which an effect of a study's own may act."""
_OF_STRING = frozenset(
    {
        "light_along_string",
        "light_across_string",
        "free_length",
        "wrap_angle",
        "retreat_speed",
        "across_speed",
        "across_speed_size",
    }
)
"""Directions and coordinates that mean nothing without a string."""


@dataclass(frozen=True, kw_only=True)
class OwnEffect:
    """A force of a study's or scenario's own, with one coefficient, which has the effect's name and switches it off at 0."""

    name: str
    """Name of the effect and of its coefficient, which the formulas contain."""
    unit: str
    """SI unit of the coefficient, as pint reads it; '' for a pure number."""
    bounds: tuple[float, float]
    """Least and largest value of the coefficient [SI]."""
    force: tuple[tuple[str, str], ...]
    """Direction, one of `DIRECTIONS`, and formula of the force in it [N]."""
    meaning: str = ""
    """What it is, in words."""
    source: str = ""
    """Where it is from."""


def own_effect_from(data: Mapping[str, Any]) -> OwnEffect:
    """Return the effect whose plain data these are, as `dataclasses.asdict` gives them or JSON keeps them."""
    low, high = data["bounds"]
    force = tuple((direction, formula) for direction, formula in data["force"])
    return OwnEffect(**{**data, "bounds": (low, high), "force": force})


def check_name(name: str, taken: Collection[str]) -> None:
    """Refuse a name that a formula cannot contain, or that something else has.

    Raises
    ------
    ParameterError
        With what is wrong with it.
    """
    if not NAME.fullmatch(name) or keyword.iskeyword(name):
        raise ParameterError(
            f"found the name {shorten(name)!r}, needed small letters, digits and '_', such as 'magnet' or 'fan_2'"
        )
    if name in taken or name in COORDINATES or name in FUNCTIONS or name in CONSTANTS:
        raise ParameterError(f"found the name {name!r}, which something else has already; needed another, such as 'my_{name}'")


def force_formula(text: str, name: str) -> ParsedFormula:
    """Check the formula of a force of the effect ``name``.

    Raises
    ------
    FormulaError
        If it is no formula of the coordinates and the coefficient.
    """
    formula = parse(text, (name, *COORDINATES))
    if name not in formula.names:
        raise FormulaError(f"found {shorten(text)!r} without {name!r}, needed the coefficient in it, as a factor for example")
    return formula


@lru_cache(maxsize=256)
def effect_of(own: OwnEffect) -> Effect:
    """Return the effect for the equations; one object for equal definitions, so that what is compiled with it is shared.

    Raises
    ------
    ParameterError
        If the definition is faulty.
    """
    try:
        formulas = {direction: force_formula(text, own.name) for direction, text in own.force}
    except FormulaError as error:
        raise ParameterError(f"own_effects: {own.name}: {error}") from None
    unknown = [direction for direction in formulas if direction not in DIRECTIONS]
    if unknown or not formulas:
        raise ParameterError(
            f"own_effects: {own.name}: found {unknown[0] if unknown else 'no force'!r}, needed some of {', '.join(DIRECTIONS)}"
        )
    on_light = {d: f for d, f in formulas.items() if d in LIGHT_DIRECTIONS}
    on_heavy = formulas.get(HEAVY_DIRECTION)
    used = sorted({name for f in formulas.values() for name in f.names if name != own.name}, key=list(COORDINATES).index)
    effect = Effect(
        name=own.name,
        kind=EffectKind.FORCE,
        formula=", ".join(f"{d} = {f.text}" for d, f in formulas.items()),
        source=own.source or "given with the trials",
        acts_on="both masses" if on_light and on_heavy else "light mass" if on_light else "heavy mass",
        depends_on=tuple(used),
        coefficients=(
            Coefficient(
                name=own.name, unit=own.unit, default=0.0, null=0.0, bounds=own.bounds, meaning=own.meaning or "own coefficient"
            ),
        ),
        needs_string=not _OF_STRING.isdisjoint([*formulas, *used]),
        force_on_light_mass=_force_on_light_mass(own.name, on_light) if on_light else None,
        force_on_heavy_mass=_force_on_heavy_mass(own.name, on_heavy) if on_heavy else None,
    )
    try:
        check_effect(effect)
    except ParameterError as error:
        raise ParameterError(f"own_effects: {own.name}: {error}") from None
    return effect


def _values(xp: Any, k: Kinematics, p: Any, name: str, names: Collection[str]) -> dict[str, Any]:
    """Return the values of the ``names`` in a formula, of which ``name`` is the coefficient."""
    return {n: getattr(p, name) if n == name else COORDINATES[n](xp, k, p) for n in names}


def _force_on_light_mass(name: str, formulas: Mapping[str, ParsedFormula]) -> Callable[[Any, Kinematics, Any], tuple[Any, Any]]:
    names = sorted({n for f in formulas.values() for n in f.names})

    def force(xp: Any, k: Kinematics, p: SimpleNamespace) -> tuple[Any, Any]:
        values = _values(xp, k, p, name, names)
        along: Any = 0.0
        across: Any = 0.0
        for direction, formula in formulas.items():
            a, b = LIGHT_DIRECTIONS[direction](xp, k, formula(xp, values))
            along, across = along + a, across + b
        return along, across

    return force


def _force_on_heavy_mass(name: str, formula: ParsedFormula) -> Callable[[Any, Kinematics, Any], Any]:
    names = sorted(formula.names)
    return lambda xp, k, p: formula(xp, _values(xp, k, p, name, names))
