"""Library of physical effects, each defined once for the reference, the fit and the engines; here those of the paper's model.

An effect is a force on a mass, a law of the string on the rod, a property of string, rod or mass, or a motion at release.
Its functions take a math namespace ``xp`` (``math``, ``numpy``, ``sympy`` or ``heyoka``), the :class:`Kinematics` of one
instant and the parameters ``p`` (an object with a coefficient per attribute), so that numbers, arrays, symbols and compiled
expressions run the same lines.

Directions are the paper's: *along* the string from the light mass towards the rod (e1 = sin(theta) x - cos(theta) y) and
*across* it the way the light mass loops (t1 = -cos(theta) x - sin(theta) y).
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

from looping_pendulum.reference_ode.effects.closure import CLOSURE
from looping_pendulum.reference_ode.effects.forces import FURTHER_FORCES
from looping_pendulum.reference_ode.effects.installed import installed_effects
from looping_pendulum.reference_ode.effects.properties import FURTHER_PROPERTIES
from looping_pendulum.reference_ode.effects.types import Coefficient, Effect, EffectKind, Kinematics

__all__ = [
    "COEFFICIENTS",
    "EFFECTS",
    "FAULTS",
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

GRAVITY = Effect(
    name="gravity",
    kind=EffectKind.FORCE,
    formula="F = -M g y",
    source="paper, sec. II",
    acts_on="both masses",
    depends_on=(),
    coefficients=(
        Coefficient(
            name="gravity",
            unit="m/s**2",
            default=9.81,
            null=0.0,
            bounds=(0.0, 100.0),
            meaning="acceleration of free fall g",
        ),
    ),
    in_base_model=True,
    force_on_light_mass=lambda xp, k, p: (
        p.light_mass * p.gravity * xp.cos(k.wrap_angle),
        p.light_mass * p.gravity * xp.sin(k.wrap_angle),
    ),
    force_on_heavy_mass=lambda xp, k, p: -p.heavy_mass * p.gravity,
)

CAPSTAN = Effect(
    name="capstan",
    kind=EffectKind.STRING_LAW,
    formula="T2 = T1 exp(-sign(v2) mu theta); holds while |ln(T2/T1)| <= mu_s theta",
    source="paper, eq. for T2/T1; Euler's capstan law",
    acts_on="string on rod",
    depends_on=("wrap_angle",),
    coefficients=(
        Coefficient(
            name="kinetic_friction",
            unit="",
            default=0.0,
            null=0.0,
            bounds=(0.0, 5.0),
            meaning="friction coefficient mu while the string slides",
        ),
        Coefficient(
            name="static_friction",
            unit="",
            default=0.0,
            null=0.0,
            bounds=(0.0, 10.0),
            meaning="friction coefficient mu_s before it slides; the kinetic one if not given",
        ),
    ),
    in_base_model=True,
    sliding_exponent=lambda xp, k, p: p.kinetic_friction * k.contact_angle,
    holding_exponent=lambda xp, k, p: p.static_friction * k.contact_angle,
)

LIGHT_DRAG = Effect(
    name="light_drag",
    kind=EffectKind.FORCE,
    formula="F = -gamma1 |v1| v1, gamma1 = C rho A / 2",
    source="paper, sec. II and IV",
    acts_on="light mass",
    depends_on=("light_mass_speed",),
    coefficients=(
        Coefficient(
            name="light_drag",
            unit="kg/m",
            default=0.0,
            null=0.0,
            bounds=(0.0, 1.0),
            meaning="quadratic drag coefficient gamma1",
        ),
    ),
    in_base_model=True,
    force_on_light_mass=lambda xp, k, p: (
        # The light mass's velocity is -u along e1 and w along t1, hence the two signs
        p.light_drag * k.light_mass_speed * k.retreat_speed,
        -p.light_drag * k.light_mass_speed * k.across_speed,
    ),
)

HEAVY_DRAG = Effect(
    name="heavy_drag",
    kind=EffectKind.FORCE,
    formula="F = -gamma2 |v2| v2, gamma2 = C rho A / 2",
    source="paper, sec. II and IV",
    acts_on="heavy mass",
    depends_on=("heavy_speed",),
    coefficients=(
        Coefficient(
            name="heavy_drag",
            unit="kg/m",
            default=0.0,
            null=0.0,
            bounds=(0.0, 1.0),
            meaning="quadratic drag coefficient gamma2",
        ),
    ),
    in_base_model=True,
    force_on_heavy_mass=lambda xp, k, p: -p.heavy_drag * k.heavy_speed_size * k.heavy_speed,
)

STRING_DRAG = Effect(
    name="string_drag",
    kind=EffectKind.FORCE,
    formula="F = -alpha l |w| w t1, w = v1 . t1",
    source="paper, sec. II: gamma_str = l alpha_str, taken to act on the light mass",
    acts_on="light mass",
    depends_on=("free_length", "across_speed"),
    coefficients=(
        Coefficient(
            name="string_drag",
            unit="kg/m**2",
            default=0.0,
            null=0.0,
            bounds=(0.0, 1.0),
            meaning="drag coefficient alpha of the free string per length",
        ),
    ),
    in_base_model=True,
    needs_string=True,
    force_on_light_mass=lambda xp, k, p: (
        0.0,
        -p.string_drag * k.free_length * k.across_speed_size * k.across_speed,
    ),
)

# Forces and exponents are summed in this order: another order would change the last bits of every result
LIBRARY = (GRAVITY, CAPSTAN, LIGHT_DRAG, HEAVY_DRAG, STRING_DRAG, *FURTHER_FORCES, *FURTHER_PROPERTIES, CLOSURE)
"""Effects of this package."""
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
