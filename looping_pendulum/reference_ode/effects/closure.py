"""A force of unknown form: a sum of radial basis functions of one coordinate, for what no effect of the library describes.

It is an effect like any other, so that the reference, the fit and the engines can all run it. Its coefficients, the weights of
the basis functions, are found by `discrepancy.unlisted.discovery`.
"""

from __future__ import annotations

from operator import attrgetter, mul
from types import SimpleNamespace
from typing import Any

from looping_pendulum.reference_ode.effects.types import Coefficient, Effect, EffectKind, Kinematics

N_BASIS_FUNCTIONS = 12
"""Number of radial basis functions, Gaussians whose centres are one width (standard deviation) apart."""
COORDINATES = ("time", "free_length", "wrap_angle", "retreat_speed", "across_speed")
"""Coordinates of which the force may be a function."""
SIDES = ("along", "across", "heavy")
"""Directions in which it may act: on the light mass along or across the string, on the heavy mass upward."""
FACTORS = ("constant", "retreat_speed", "across_speed")
"""Factors by which the basis functions may be multiplied: 1, or minus a speed."""


def weight_name(side: str, i: int) -> str:
    """Return the name of the coefficient that is the weight of basis function ``i`` on ``side``."""
    return f"closure_{side}_{i}"


_IS_FUNCTION_OF = attrgetter(*(f"closure_of_{name}" for name in COORDINATES))
_IS_MULTIPLIED_BY = attrgetter(*(f"closure_by_{name}" for name in FACTORS[1:]))
_COORDINATES, _SPEEDS = attrgetter(*COORDINATES), attrgetter(*FACTORS[1:])
_WEIGHTS = {side: attrgetter(*(weight_name(side, i) for i in range(N_BASIS_FUNCTIONS))) for side in SIDES}
"""Getters of many coefficients at once, for speed: a run reads them at each of its events."""


def _closure_coefficient(name: str, meaning: str, unit: str = "", bound: float = 1e6) -> Coefficient:
    return Coefficient(name=name, unit=unit, default=0.0, null=0.0, bounds=(-bound, bound), meaning=meaning)


def _basis_functions(xp: Any, k: Kinematics, p: SimpleNamespace) -> list[Any]:
    """Return the values of the basis functions, times the factor, at one instant.

    One ``closure_of_*`` and one ``closure_by_*`` is 1, the others are 0: sums pick the coordinate and the factor, because
    compiled expressions have no branches.
    """
    coordinate = sum(map(mul, _IS_FUNCTION_OF(p), _COORDINATES(k)))
    x = coordinate * p.closure_scale - p.closure_start
    factor = p.closure_by_constant - sum(map(mul, _IS_MULTIPLIED_BY(p), _SPEEDS(k)))
    return [factor * xp.exp(-0.5 * (x - i) * (x - i)) for i in range(N_BASIS_FUNCTIONS)]


def _force_on_side(basis_functions: list[Any], p: SimpleNamespace, side: str) -> Any:
    """Return the weighted sum of the basis functions on ``side`` [N]."""
    return sum(map(mul, _WEIGHTS[side](p), basis_functions))


def _force_on_light_mass(xp: Any, k: Kinematics, p: SimpleNamespace) -> tuple[Any, Any]:
    """Return the force on the light mass (along, across) [N]."""
    basis_functions = _basis_functions(xp, k, p)
    return _force_on_side(basis_functions, p, "along"), _force_on_side(basis_functions, p, "across")


CLOSURE = Effect(
    name="closure",
    kind=EffectKind.CLOSURE,
    formula="F = sum_i c_i exp(-((s - s_i) / h)^2 / 2) (1, -u or -w), s one coordinate",
    source="none: found from data",
    acts_on="either mass",
    depends_on=COORDINATES,
    coefficients=(
        *(
            _closure_coefficient(weight_name(side, i), f"weight of basis function {i} of the unknown force {side}", "N")
            for side in SIDES
            for i in range(N_BASIS_FUNCTIONS)
        ),
        *(_closure_coefficient(f"closure_of_{name}", f"1 if the force is a function of {name}") for name in COORDINATES),
        *(_closure_coefficient(f"closure_by_{name}", f"1 if the basis functions are multiplied by {name}") for name in FACTORS),
        _closure_coefficient("closure_scale", "basis functions per unit of the coordinate"),
        _closure_coefficient("closure_start", "coordinate of the first basis function, in units of their distance"),
    ),
    force_on_light_mass=_force_on_light_mass,
    force_on_heavy_mass=lambda xp, k, p: _force_on_side(_basis_functions(xp, k, p), p, "heavy"),
)
