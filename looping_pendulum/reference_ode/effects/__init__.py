"""Library of physical effects, each defined once for the reference, the fit and the engines, and the sums of their terms.

An effect is a force on a mass, a law of the string on the rod, a property of string, rod or mass, or a motion at release.
Its functions take a math namespace ``xp`` (``math``, ``numpy``, ``sympy``, or of `core.expressions`), the :class:`Kinematics`
of one instant and the parameters ``p`` (an object with a coefficient per attribute), so that numbers, arrays, symbols and
expressions run the same lines.

Directions are the paper's: *along* the string from the light mass towards the rod (e1 = sin(theta) x - cos(theta) y) and
*across* it the way the light mass loops (t1 = -cos(theta) x - sin(theta) y).
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

from looping_pendulum.reference_ode.effects.library import CAPSTAN, GRAVITY, LIBRARY
from looping_pendulum.reference_ode.effects.own import installed_effects
from looping_pendulum.reference_ode.effects.types import Coefficient, Effect, EffectKind, Kinematics

__all__ = [
    "COEFFICIENTS",
    "EFFECTS",
    "FAULTS",
    "CAPSTAN",
    "GRAVITY",
    "LIBRARY",
    "Coefficient",
    "Effect",
    "EffectKind",
    "Kinematics",
    "drag_coefficient",
    "force_on_heavy_mass",
    "inertia_of_heavy_mass",
    "holding_exponent",
    "force_on_light_mass",
    "inertia_of_light_mass",
    "sliding_exponent",
]

if TYPE_CHECKING:
    EFFECTS: dict[str, Effect]
    """Every effect of the library and of installed packages, by name."""
    COEFFICIENTS: dict[str, Coefficient]
    """Every coefficient of every effect, by name."""
    FAULTS: tuple[str, ...]
    """One line for each package whose effects cannot be used."""


def __getattr__(name: str) -> Any:
    """Return the tables of all effects, which are made when one of them is first asked for.

    Not sooner: a package that offers effects imports this module, and is imported for the tables.
    """
    if name not in ("EFFECTS", "COEFFICIENTS", "FAULTS"):
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    installed, faults = installed_effects(LIBRARY)
    effects = {e.name: e for e in (*LIBRARY, *installed)}
    coefficients = {c.name: c for e in effects.values() for c in e.coefficients}
    globals().update(EFFECTS=effects, COEFFICIENTS=coefficients, FAULTS=faults)
    return globals()[name]


def drag_coefficient(shape_factor: float, air_density: float, area: float) -> float:
    """Return the quadratic drag coefficient gamma = C rho A / 2 [kg/m] (paper, sec. IV).

    Parameters
    ----------
    shape_factor
        Drag coefficient C of the shape [1].
    air_density
        Density rho [kg/m^3].
    area
        Area A across the motion [m^2]: pi r^2 for a sphere, height times diameter for a cylinder broadside on.
    """
    return 0.5 * shape_factor * air_density * area


def force_on_light_mass(xp: Any, k: Kinematics, p: SimpleNamespace, effects: tuple[Effect, ...]) -> tuple[Any, Any]:
    """Return the sum of the forces on the light mass other than the string's pull, (along, across) [N]."""
    along: Any = 0.0
    across: Any = 0.0
    for effect in effects:
        if effect.force_on_light_mass is not None:
            a, b = effect.force_on_light_mass(xp, k, p)
            along, across = along + a, across + b
    return along, across


def force_on_heavy_mass(xp: Any, k: Kinematics, p: SimpleNamespace, effects: tuple[Effect, ...]) -> Any:
    """Return the sum of the upward forces on the heavy mass other than the string's pull [N]."""
    total: Any = 0.0
    for effect in effects:
        if effect.force_on_heavy_mass is not None:
            total = total + effect.force_on_heavy_mass(xp, k, p)
    return total


def sliding_exponent(xp: Any, k: Kinematics, p: SimpleNamespace, effects: tuple[Effect, ...]) -> Any:
    """Return ln(T2/T1) of a string that slides so that the heavy mass falls; if it rises, ln(T2/T1) is the negative of this."""
    return sum(e.sliding_exponent(xp, k, p) for e in effects if e.sliding_exponent is not None)


def holding_exponent(xp: Any, k: Kinematics, p: SimpleNamespace, effects: tuple[Effect, ...]) -> Any:
    """Return the largest |ln(T2/T1)| that the rod can hold while the string sticks."""
    return sum(e.holding_exponent(xp, k, p) for e in effects if e.holding_exponent is not None)


def inertia_of_light_mass(xp: Any, k: Kinematics, p: SimpleNamespace, effects: tuple[Effect, ...]) -> tuple[Any, Any]:
    """Return the inertia of the light mass and of what moves with it, (along, across) the string [kg]."""
    along = across = p.light_mass
    for effect in effects:
        if effect.inertia_of_light_mass is not None:
            a, b = effect.inertia_of_light_mass(xp, k, p)
            along, across = along + a, across + b
    return along, across


def inertia_of_heavy_mass(xp: Any, k: Kinematics, p: SimpleNamespace, effects: tuple[Effect, ...]) -> Any:
    """Return the inertia of the heavy mass and of what moves with it [kg]."""
    total = p.heavy_mass
    for effect in effects:
        if effect.inertia_of_heavy_mass is not None:
            total = total + effect.inertia_of_heavy_mass(xp, k, p)
    return total
