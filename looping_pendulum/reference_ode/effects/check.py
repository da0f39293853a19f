"""Checks of effects that others bring: a force is finite, vanishes at the null value, and is one analytic expression."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from types import MappingProxyType, SimpleNamespace
from typing import Any

from looping_pendulum.errors import ParameterError, shorten
from looping_pendulum.reference_ode.effects.formula import FUNCTIONS
from looping_pendulum.reference_ode.effects.types import Effect, EffectKind, Kinematics

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
