"""A law of unknown form: a sum of radial basis functions of one coordinate, for what no effect of the library describes.

It is a force on a mass or a change of the friction coefficient, and an effect like any other, so that the reference, the fit
and the engines can all run it. Its coefficients, the weights of the basis functions, are found by
`discrepancy.evidence.laws`.
"""

from __future__ import annotations

from operator import attrgetter, mul
from types import MappingProxyType, SimpleNamespace
from typing import Any

from looping_pendulum.reference_ode.effects.types import Coefficient, Effect, EffectKind, Kinematics
from looping_pendulum.reference_ode.geometry import light_position

N_BASIS_FUNCTIONS = 12
"""Number of radial basis functions, Gaussians whose centres are one width (standard deviation) apart."""
COORDINATE_UNITS = MappingProxyType(
    {
        "time": "s",
        "free_length": "m",
        "wrap_angle": "rad",
        "retreat_speed": "m/s",
        "across_speed": "m/s",
        "slip_speed": "m/s",
        "normal_load": "N",
        "hanging_length": "m",
        "horizontal_position": "m",
        "height": "m",
        "distance": "m",
    }
)
"""Coordinate of which the law may be a function -> its SI unit, in the order of `coordinates_at`."""
COORDINATES = tuple(COORDINATE_UNITS)
SIDES = ("along", "across", "gradient", "heavy", "friction")
"""Where it may act: on the light mass along or across the string or along the gradient of the coordinate, on the heavy mass
upward, or on the coefficient of friction."""
FACTORS = ("constant", "retreat_speed", "across_speed")
"""Factors by which the basis functions may be multiplied: 1, or minus a speed."""
ROUNDING_DISTANCE = 0.005
"""Length that rounds off the distance from a point [m], whose gradient is not analytic at the point."""


def weight_name(side: str, i: int) -> str:
    """Return the name of the coefficient that is the weight of basis function ``i`` on ``side``."""
    return f"closure_{side}_{i}"


_IS_FUNCTION_OF = attrgetter(*(f"closure_of_{name}" for name in COORDINATES))
_IS_MULTIPLIED_BY = attrgetter(*(f"closure_by_{name}" for name in FACTORS[1:]))
_SPEEDS = attrgetter(*FACTORS[1:])
_WEIGHTS = {side: attrgetter(*(weight_name(side, i) for i in range(N_BASIS_FUNCTIONS))) for side in SIDES}
"""Getters of many coefficients at once, for speed: a run reads them at each of its events."""


def _closure_coefficient(name: str, meaning: str, unit: str = "") -> Coefficient:
    return Coefficient(name=name, unit=unit, default=0.0, null=0.0, bounds=(-1e6, 1e6), meaning=meaning)


def _from_point(xp: Any, x: Any, y: Any, p: SimpleNamespace) -> tuple[Any, Any, Any]:
    """Return the vector from the closure's point to the light mass, and its rounded length [m]."""
    dx, dy = x - p.closure_point_x, y - p.closure_point_y
    return dx, dy, xp.sqrt(dx * dx + dy * dy + ROUNDING_DISTANCE * ROUNDING_DISTANCE)


def coordinates_at(xp: Any, k: Kinematics, p: SimpleNamespace) -> tuple[Any, ...]:
    """Return the values of `COORDINATES` at one instant [SI].

    The normal load is the pull of the light mass on its string, M1 (w^2 / l - g cos(theta)), which presses the string on the
    rod: the tension at that end without the acceleration along the string, which would follow from the friction in turn.
    """
    x, y = light_position(xp, k.free_length, k.wrap_angle, p.rod_radius)
    pull = k.across_speed * k.across_speed / k.free_length - p.gravity * xp.cos(k.wrap_angle)
    return (
        k.time,
        k.free_length,
        k.wrap_angle,
        k.retreat_speed,
        k.across_speed,
        k.slip_speed,
        p.light_mass * pull,
        p.string_length - k.free_length - p.rod_radius * k.wrap_angle,
        x,
        y,
        _from_point(xp, x, y, p)[2],
    )


def _basis_functions(xp: Any, k: Kinematics, p: SimpleNamespace) -> list[Any]:
    """Return the values of the basis functions, times the factor, at one instant.

    One ``closure_of_*`` and one ``closure_by_*`` is 1, the others are 0: sums pick the coordinate and the factor, because
    compiled expressions have no branches.
    """
    coordinate = sum(map(mul, _IS_FUNCTION_OF(p), coordinates_at(xp, k, p)))
    x = coordinate * p.closure_scale - p.closure_start
    factor = p.closure_by_constant - sum(map(mul, _IS_MULTIPLIED_BY(p), _SPEEDS(k)))
    return [factor * xp.exp(-0.5 * (x - i) * (x - i)) for i in range(N_BASIS_FUNCTIONS)]


def _on_side(basis_functions: list[Any], p: SimpleNamespace, side: str) -> Any:
    """Return the weighted sum of the basis functions on ``side``."""
    return sum(map(mul, _WEIGHTS[side](p), basis_functions))


def _gradient(xp: Any, k: Kinematics, p: SimpleNamespace) -> tuple[Any, Any]:
    """Return the gradient of the coordinate if that is a place, (along, across)."""
    dx, dy, distance = _from_point(xp, *light_position(xp, k.free_length, k.wrap_angle, p.rod_radius), p)
    to_right = p.closure_of_horizontal_position + p.closure_of_distance * dx / distance
    upward = p.closure_of_height + p.closure_of_distance * dy / distance
    cosine, sine = xp.cos(k.wrap_angle), xp.sin(k.wrap_angle)
    return to_right * sine - upward * cosine, -to_right * cosine - upward * sine


def _force_on_light_mass(xp: Any, k: Kinematics, p: SimpleNamespace) -> tuple[Any, Any]:
    """Return the force on the light mass (along, across) [N]."""
    basis_functions = _basis_functions(xp, k, p)
    force = _on_side(basis_functions, p, "gradient")
    along, across = _gradient(xp, k, p)
    return (
        _on_side(basis_functions, p, "along") + force * along,
        _on_side(basis_functions, p, "across") + force * across,
    )


def _exponent(xp: Any, k: Kinematics, p: SimpleNamespace) -> Any:
    """Return the change of the friction coefficient times the angle of contact."""
    return k.contact_angle * _on_side(_basis_functions(xp, k, p), p, "friction")


CLOSURE = Effect(
    name="closure",
    kind=EffectKind.CLOSURE,
    formula="F or change of mu = sum_i c_i exp(-((s - s_i) / h)^2 / 2) (1, -u or -w), s one coordinate",
    source="none: found from data",
    acts_on="either mass, or string on rod",
    depends_on=("time", "free_length", "wrap_angle", "retreat_speed", "across_speed", "heavy_speed"),
    coefficients=(
        *(
            _closure_coefficient(
                weight_name(side, i),
                f"weight of basis function {i} of the unknown law, {side}",
                "" if side == "friction" else "N",
            )
            for side in SIDES
            for i in range(N_BASIS_FUNCTIONS)
        ),
        *(_closure_coefficient(f"closure_of_{name}", f"1 if the law is a function of {name}") for name in COORDINATES),
        *(_closure_coefficient(f"closure_by_{name}", f"1 if the basis functions are multiplied by {name}") for name in FACTORS),
        _closure_coefficient("closure_scale", "basis functions per unit of the coordinate"),
        _closure_coefficient("closure_start", "coordinate of the first basis function, in units of their distance"),
        _closure_coefficient("closure_point_x", "x of the point from which the distance is measured", "m"),
        _closure_coefficient("closure_point_y", "y of the point from which the distance is measured", "m"),
    ),
    force_on_light_mass=_force_on_light_mass,
    force_on_heavy_mass=lambda xp, k, p: _on_side(_basis_functions(xp, k, p), p, "heavy"),
    sliding_exponent=_exponent,
    holding_exponent=_exponent,
)
