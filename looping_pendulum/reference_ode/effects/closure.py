"""An unknown force as a function of the state: a row of bumps along one coordinate, for the search of what no library lists.

It is an effect like any other, so that the reference, the fit and the engines can all run it; only its many coefficients are
found by `discrepancy.unlisted.discovery`, never typed.
"""

from __future__ import annotations

from operator import attrgetter, mul
from typing import Any

from looping_pendulum.reference_ode.effects.types import Coefficient, Effect, EffectKind, Kinematics

BUMPS = 12
"""Gaussian bumps along the coordinate, a width apart."""
COORDINATES = ("time", "free_length", "wrap_angle", "retreat_speed", "across_speed")
"""What the force may be a function of."""
SIDES = ("along", "across", "heavy")
"""Where it may act: on the light mass along or across the string, on the heavy mass upward."""
FACTORS = ("constant", "retreat_speed", "across_speed")
"""What the bumps may be multiplied by: 1, or minus a speed."""


def weight(side: str, i: int) -> str:
    """Name of the coefficient of bump ``i`` on ``side``."""
    return f"closure_{side}_{i}"


_OF = attrgetter(*(f"closure_of_{name}" for name in COORDINATES))
_BY = attrgetter(*(f"closure_by_{name}" for name in FACTORS[1:]))
_COORDINATES, _SPEEDS = attrgetter(*COORDINATES), attrgetter(*FACTORS[1:])
_WEIGHTS = {side: attrgetter(*(weight(side, i) for i in range(BUMPS))) for side in SIDES}
"""What reads many coefficients at once: a run asks for them at each of its events."""


def _number(name: str, meaning: str, unit: str = "", bound: float = 1e6) -> Coefficient:
    return Coefficient(name=name, unit=unit, default=0.0, null=0.0, bounds=(-bound, bound), meaning=meaning)


def _bumps(xp: Any, k: Kinematics, p: Any) -> list[Any]:
    s = sum(map(mul, _OF(p), _COORDINATES(k)))
    x = s * p.closure_scale - p.closure_start
    factor = p.closure_by_constant - sum(map(mul, _BY(p), _SPEEDS(k)))
    return [factor * xp.exp(-0.5 * (x - i) * (x - i)) for i in range(BUMPS)]


def _side(bumps: list[Any], p: Any, side: str) -> Any:
    return sum(map(mul, _WEIGHTS[side](p), bumps))


def _light(xp: Any, k: Kinematics, p: Any) -> tuple[Any, Any]:
    bumps = _bumps(xp, k, p)
    return _side(bumps, p, "along"), _side(bumps, p, "across")


CLOSURE = Effect(
    name="closure",
    kind=EffectKind.CLOSURE,
    formula="F = sum_i c_i exp(-((s - s_i) / h)^2 / 2) (1, -u or -w), s one coordinate",
    source="none: found from data",
    acts_on="either mass",
    depends_on=COORDINATES,
    coefficients=(
        *(_number(weight(side, i), f"bump {i} of the unknown force {side}", "N") for side in SIDES for i in range(BUMPS)),
        *(_number(f"closure_of_{name}", f"1 if the force is a function of {name}") for name in COORDINATES),
        *(_number(f"closure_by_{name}", f"1 if the bumps are multiplied by {name}") for name in FACTORS),
        _number("closure_scale", "bumps per unit of the coordinate"),
        _number("closure_start", "coordinate of the first bump, in bumps"),
    ),
    force_on_light_mass=_light,
    force_on_heavy_mass=lambda xp, k, p: _side(_bumps(xp, k, p), p, "heavy"),
)
