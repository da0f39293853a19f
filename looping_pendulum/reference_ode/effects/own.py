"""Effects that do not come with this package: formulas of a study or scenario, and what other installed packages offer.

An `OwnEffect` is text and numbers alone, which travel to every process and back; `effect_of` makes the `Effect` of it, wherever
it is needed. Every such effect is checked: a force is finite, vanishes at the null value, and is one analytic expression.
"""

from __future__ import annotations

import keyword
import math
import re
import warnings
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from importlib import import_module
from importlib.metadata import entry_points
from types import MappingProxyType, SimpleNamespace
from typing import Any

from looping_pendulum.errors import HarnessError, ParameterError, shorten
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
ENTRY_POINTS = "looping_pendulum.effects"
"""Group of entry points by which other packages offer effects: any name -> module with ``effects() -> list[Effect]``."""
KINDS = (EffectKind.FORCE, EffectKind.STRING_LAW, EffectKind.PROPERTY)
"""Kinds of effects that others may bring; a motion at release and a closure need code elsewhere."""
TERMS = (
    "force_on_light_mass",
    "force_on_heavy_mass",
    "sliding_exponent",
    "holding_exponent",
    "inertia_of_light_mass",
    "inertia_of_heavy_mass",
)
"""Functions of an effect that take (xp, kinematics, p)."""
APPARATUS = {"light_mass": 0.01, "heavy_mass": 0.1, "rod_radius": 0.006, "free_length": 0.58, "release_angle": 2.0,
             "hanging_length": 0.03, "light_radius": 0.0, "gravity": 9.81, "kinetic_friction": 0.3, "static_friction": 0.3,
             "light_drag": 1e-3, "heavy_drag": 1e-3, "string_drag": 1e-3,
             "string_length": 0.62, "end_length": 2e-3}  # fmt: skip
"""Parameters with which an effect is tried [SI]."""
BASE_COEFFICIENTS = (("kinetic_friction", "static_friction"), ("light_drag",), ("heavy_drag",), ("string_drag",))
"""Those of them that an effect may multiply, each with those that are zero with it."""
RESERVED = frozenset({*APPARATUS, "release", "coefficients", "own_effects"})
"""Names of parameters, which no effect may have."""


def _instant(t: float, free_length: float, wrap_angle: float, u: float, w: float, heavy_speed: float) -> Kinematics:
    return Kinematics(
        t, free_length, wrap_angle, u, w, abs(w), math.hypot(u, w), heavy_speed, abs(heavy_speed), hanging_length=0.1
    )


INSTANTS = (
    _instant(0.0, 0.58, 1.95, 0.0, 0.0, 0.0),
    _instant(0.3, 0.25, 3.6, -1.1, 2.3, -1.1),
    _instant(0.6, 0.1, 9.0, 0.2, -1.7, 0.2),
)
"""Instants at which an effect is tried: a release from rest, and two of a run."""
_FACTOR = r"(?:kg|rad|Pa|Hz|m|s|N|J|W|K)(?:\*\*-?[1-9])?"
SI_UNIT = re.compile(rf"(?:1/)?{_FACTOR}(?:[*/]{_FACTOR}){{0,5}}")
"""Regular expression of the unit of a coefficient, as pint reads it."""


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


class EffectWarning(UserWarning):
    """Another package's effects cannot be used and are left out; the message says why and what to do."""


def installed_effects(library: Iterable[Effect]) -> tuple[tuple[Effect, ...], tuple[str, ...]]:
    """Return the effects of other packages, and for each package whose effects cannot be used one line that says why."""
    points = {(point.name, point.value, point.dist.name if point.dist else "") for point in entry_points(group=ENTRY_POINTS)}
    library = tuple(library)
    defaults = {c.name: c.default for e in library for c in e.coefficients}
    effects: list[Effect] = []
    faults: list[str] = []
    for _, module, package in sorted(points):
        try:
            effects += _effects_of_package(module, package, taken_names((*library, *effects)), defaults)
        except (Exception, SystemExit) as error:  # foreign code may raise anything, and must not end this program
            why = str(error) if isinstance(error, HarnessError) else f"{type(error).__name__}: {error}"
            faults.append(
                f"the effects of {module} of the package {package or '?'} are left out: {' '.join(why.split())}; "
                "mend or uninstall that package"
            )
    return tuple(effects), tuple(faults)


def _effects_of_package(module: str, package: str, taken: set[str], defaults: Mapping[str, float]) -> list[Effect]:
    """Return the effects of another package, after checking what results depend on."""
    effects = list(import_module(module).effects())
    for effect in effects:
        if not isinstance(effect, Effect):
            raise ParameterError(f"effects() gave {type(effect).__name__}, needed Effect; see docs/write-an-effect.md")
        try:
            names = [effect.name, *(c.name for c in effect.coefficients)]
            # An effect and its first coefficient may share a name
            for name in dict.fromkeys(names):
                check_name(name, taken)
            if len(set(names[1:])) < len(names) - 1:
                raise ParameterError("found two coefficients of one name, needed names that differ")
            check_effect(effect, defaults)
        except HarnessError as error:
            raise ParameterError(f"{effect.name}: {error}") from None
        taken = taken.union(names)
    return [replace(effect, module=module, package=package) for effect in effects]


@cache
def warn_of(fault: str) -> None:
    """Warn once of a package whose effects cannot be used."""
    warnings.warn(fault, EffectWarning, stacklevel=2)


class _Symbol:
    """A quantity without a value, of which any comparison is an error, as of a compiled expression's."""

    def _combined(self, other: Any = None) -> _Symbol:
        return self

    __add__ = __radd__ = __sub__ = __rsub__ = __mul__ = __rmul__ = __truediv__ = __rtruediv__ = _combined

    def __neg__(self) -> _Symbol:
        return self

    def _refused(self, other: Any = None) -> Any:
        raise ParameterError("found abs(), a comparison or a branch, needed one analytic expression (docs/write-an-effect.md)")

    def __pow__(self, power: Any) -> Any:
        raise ParameterError("found a power, needed products, which every kind of number has; write x * x")

    __abs__ = __bool__ = __lt__ = __le__ = __gt__ = __ge__ = __float__ = __eq__ = _refused
    __hash__ = None  # type: ignore[assignment]


_SYMBOLS = SimpleNamespace(**{name: lambda x: _Symbol() for name in FUNCTIONS})
"""Math namespace of `_Symbol`."""


def check_unit(unit: str) -> None:
    """Refuse a unit of a coefficient in which the formulas, which are in SI units, would need a factor.

    Raises
    ------
    ParameterError
        If it is no product or quotient of SI units without prefixes.
    """
    if unit and not SI_UNIT.fullmatch(unit):
        raise ParameterError(
            f"found {shorten(unit)!r}, needed an SI unit without a prefix, such as 'N', 'kg/s' or 'N*s/m'; "
            "'1' for a pure number"
        )


def check_effect(effect: Effect, others: Mapping[str, float] = MappingProxyType({})) -> None:
    """Try an effect that does not come with the library.

    Parameters
    ----------
    others
        Coefficients of other effects, on which it may depend [SI].

    Raises
    ------
    ParameterError
        If it is of a kind that cannot be added, does not vanish at its null value, or is no finite analytic expression.
    """
    if effect.kind not in KINDS or effect.variables or effect.in_base_model:
        raise ParameterError(
            f"found a {effect.kind.value}, needed a {' or a '.join(k.value for k in KINDS)}, without variables"
        )
    if not effect.coefficients:
        raise ParameterError("found no coefficient, needed one to fit")
    for c in effect.coefficients:
        try:
            check_unit(c.unit)
        except ParameterError as error:
            raise ParameterError(f"{c.name}: unit: {error}") from None
        low, high = c.bounds
        if not (math.isfinite(low) and math.isfinite(high) and low < high):
            raise ParameterError(f"{c.name}: found bounds {low:g} and {high:g}, needed two finite ones in order")
        if not (low <= c.null <= high and c.default == c.null):
            raise ParameterError(
                f"{c.name}: found the default {c.default:g} and the null value {c.null:g}, needed both equal and within "
                f"the bounds {low:g} to {high:g}"
            )
    null = {c.name: c.null for c in effect.coefficients}
    if effect.switch:
        null = {c.name: 0.5 * (c.bounds[0] + c.bounds[1]) for c in effect.coefficients}
        null[effect.switch] = next(c.null for c in effect.coefficients if c.name == effect.switch)
    acting = _acting(effect)
    for k in INSTANTS:
        _values_at(effect, k, {**others, **acting})
        if any(_values_at(effect, k, {**others, **null})):
            name = effect.switch or effect.coefficients[0].name
            raise ParameterError(
                f"found an effect that does not vanish where {name} is {null[name]:g}, needed one that its coefficient "
                "switches off; multiply by it, or subtract what is left"
            )
    symbols = Kinematics(*(_Symbol() for _ in Kinematics._fields))
    p = SimpleNamespace(**{name: _Symbol() for name in (*others, *APPARATUS, *acting)})
    _evaluated(effect, _SYMBOLS, symbols, p)


def multiplied_coefficient(effect: Effect, others: Mapping[str, float]) -> str:
    """Return the coefficient of the base model to which all terms of an effect are proportional; '' if there is none.

    Where the model has 0 for it, such as friction that grows with speed on a rod without friction, the effect does nothing.

    Parameters
    ----------
    others
        Coefficients of other effects [SI].
    """
    acting = {**others, **_acting(effect)}

    def acts(without: tuple[str, ...] = ()) -> bool:
        try:
            return any(any(_values_at(effect, k, acting, APPARATUS | dict.fromkeys(without, 0.0))) for k in INSTANTS)
        except ParameterError:  # no finite value, as of one that divides by the coefficient
            return True

    return next((names[0] for names in BASE_COEFFICIENTS if acts() and not acts(names)), "")


def _acting(effect: Effect) -> dict[str, float]:
    """Return values of an effect's coefficients at which it acts."""
    # A third of the way to a bound, as a bound itself may be as exceptional as the null value
    return {c.name: c.null + max(c.bounds[1] - c.null, c.null - c.bounds[0], key=abs) / 3 for c in effect.coefficients}


def _values_at(
    effect: Effect, k: Kinematics, coefficients: Mapping[str, float], apparatus: Mapping[str, float] = APPARATUS
) -> list[float]:
    """Return all terms of an effect at an instant; refuse what is no finite number."""
    try:
        values = _evaluated(effect, math, k, SimpleNamespace(**{**coefficients, **apparatus}))
    except (ArithmeticError, ValueError) as error:
        values, why = [math.nan], f" ({error})"
    else:
        why = ""
    if not all(isinstance(v, int | float) and math.isfinite(v) for v in values):
        at = "release, where the masses rest" if k is INSTANTS[0] else f"t = {k.time:g} s with l = {k.free_length:g} m"
        raise ParameterError(f"found no finite value{why} at {at}, needed one wherever the masses may be")
    return values


def _evaluated(effect: Effect, xp: Any, k: Kinematics, p: SimpleNamespace) -> list[Any]:
    values: list[Any] = []
    for term in TERMS:
        function = getattr(effect, term)
        if function is not None:
            value = function(xp, k, p)
            values += value if isinstance(value, tuple) else [value]
    return values


def taken_names(effects: Iterable[Effect]) -> set[str]:
    """Return the names that no further effect may have: those of parameters, of these effects and of their coefficients."""
    return {*RESERVED} | {name for e in effects for name in (e.name, *(c.name for c in e.coefficients))}
