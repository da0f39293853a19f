"""Properties of string, rod and masses beyond the paper's model; they change inertias or geometry, or add state variables."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from looping_pendulum.reference_ode.effects.types import TURN, Coefficient, Effect, EffectKind, Kinematics

MIN_LOSS_TIME = 1e-4
"""Least damping over stiffness of a string that stretches [s]: without damping its speed over the rod is not determined."""
REST_SPEED = 1e-3
"""Speed below which the drag on a swinging heavy mass is rounded off [m/s], as |v| is not analytic at 0: 1e-9 N at most."""


def _coefficient(name: str, unit: str, bounds: tuple[float, float], meaning: str, even: bool = False) -> Coefficient:
    return Coefficient(name=name, unit=unit, default=0.0, null=0.0, bounds=bounds, meaning=meaning, even=even)


def _weight_of_free_string(xp: Any, k: Kinematics, p: SimpleNamespace) -> tuple[Any, Any]:
    """Return the half of the free string's weight that acts on the light mass, (along, across) [N]."""
    weight = 0.5 * p.string_density * p.gravity * k.free_length
    return weight * xp.cos(k.wrap_angle), weight * xp.sin(k.wrap_angle)


def _winding(beyond: Any, p: SimpleNamespace) -> tuple[Any, Any, Any]:
    """Return the growth of the radius [m] of a spiral of Archimedes, its slope [m/rad] and its integral [m]."""
    slope = p.string_thickness / TURN
    return slope * beyond, slope, 0.5 * slope * beyond * beyond


def _turning_inertia(k: Kinematics, p: SimpleNamespace) -> Any:
    """Return the light mass's moment of inertia as a mass across the string [kg]; free of a slack string it resists nothing."""
    return k.taut * p.light_inertia / (k.free_length * k.free_length)


def _force_of_turning(xp: Any, k: Kinematics, p: SimpleNamespace) -> tuple[Any, Any]:
    """Return the force that stands for the moment of inertia beside its share of the mass across, (along, across) [N].

    With theta' = w / l, M1 (w' + u theta') l + I theta'' = F l is (M1 + I / l^2) (w' + u theta') = F + I / l^2 theta' (l' + u).
    """
    turning = k.across_speed / k.free_length
    return 0.0, _turning_inertia(k, p) * turning * (2.0 * k.retreat_speed - p.rod_radius * turning)


def swinging_mass(k: Kinematics, p: SimpleNamespace) -> Any:
    """Return the mass that swings at the heavy end, with the hanging string if that has a mass [kg]."""
    return p.heavy_mass + p.string_density * k.hanging_length


def _swing_force(xp: Any, k: Kinematics, p: SimpleNamespace) -> Any:
    """Return the upward force along its string on a swinging mass, less that on a hanging one [N].

    A tilt reduces the weight along the string; the centrifugal force pulls down.
    """
    length = k.hanging_length + p.rod_radius * k.heavy_tilt
    lost_weight = p.gravity * (1.0 - xp.cos(k.heavy_tilt))
    return swinging_mass(k, p) * (lost_weight - k.heavy_across_speed * k.heavy_across_speed / length)


def heavy_swing_rates(xp: Any, k: Kinematics, p: SimpleNamespace) -> tuple[Any, Any]:
    """Return the derivatives of the heavy mass's tilt [rad/s] and of its speed across its string [m/s^2].

    With d along its string (downwards) and m across it, v2 = -u2 d + w2 m, L = hanging length + R tilt and tilt' = w2 / L:
    M2 (w2' - u2 tilt') = -M2 g sin(tilt) - (gamma2 |v2| + b2) w2.
    """
    turning = k.heavy_across_speed / (k.hanging_length + p.rod_radius * k.heavy_tilt)
    resistance = (p.heavy_drag * k.heavy_speed_size + p.heavy_linear_drag) / swinging_mass(k, p)
    rate = k.heavy_speed * turning - p.gravity * xp.sin(k.heavy_tilt) - resistance * k.heavy_across_speed
    return turning, rate


STRING_MASS = Effect(
    name="string_mass",
    kind=EffectKind.PROPERTY,
    formula="light side: weight rho l g / 2, inertia rho l / 2 along, rho l / 3 across; heavy side: weight and inertia rho h",
    source="mean over a straight string; its part on the rod and the momentum of what changes sides are left out",
    acts_on="both masses",
    depends_on=("free_length",),
    coefficients=(_coefficient("string_density", "kg/m", (0.0, 0.1), "mass rho of the string per length"),),
    needs_string=True,
    force_on_light_mass=_weight_of_free_string,
    force_on_heavy_mass=lambda xp, k, p: -p.string_density * p.gravity * k.hanging_length,
    inertia_of_light_mass=lambda xp, k, p: (p.string_density * k.free_length / 2, p.string_density * k.free_length / 3),
    inertia_of_heavy_mass=lambda xp, k, p: p.string_density * k.hanging_length,
)

STRING_THICKNESS = Effect(
    name="string_thickness",
    kind=EffectKind.PROPERTY,
    formula="R -> R + d (theta - 2 pi) / (2 pi) beyond the first turn",
    source="string that lies on itself winds a spiral of Archimedes",
    acts_on="string on rod",
    depends_on=("wrap_angle",),
    coefficients=(_coefficient("string_thickness", "m", (0.0, 0.01), "growth d of the wound radius per turn"),),
    needs_string=True,
    winding=_winding,
    watches_first_turn=True,
)

HEAVY_SWING = Effect(
    name="heavy_swing",
    kind=EffectKind.PROPERTY,
    formula="heavy mass as a pendulum: weight M2 g cos(phi) + M2 w2^2 / L along its string; capstan angle theta - phi",
    source="Newton's second law for a heavy mass that is released at an angle",
    acts_on="heavy mass",
    depends_on=("heavy_speed",),
    coefficients=(
        _coefficient("heavy_swing", "rad", (-1.2, 1.2), "angle phi of the heavy mass's string to the vertical at release"),
    ),
    needs_string=True,
    force_on_heavy_mass=_swing_force,
    variables=("heavy_tilt", "heavy_across_speed"),
)

OUT_OF_PLANE = Effect(
    name="out_of_plane",
    kind=EffectKind.PROPERTY,
    formula="S = hypot(l + R theta, z) on the light side; its pull has the shares (l + R theta) / S in the plane, z / S across",
    source="rod unrolled into a plane; the string moves along the rod without friction",
    acts_on="light mass",
    depends_on=("free_length", "wrap_angle"),
    coefficients=(
        _coefficient("push_sideways", "m/s", (-5.0, 5.0), "speed of the light mass along the rod at release", even=True),
    ),
    needs_string=True,
    variables=("sideways", "sideways_speed"),
)

TURNING_ROD = Effect(
    name="turning_rod",
    kind=EffectKind.PROPERTY,
    formula="I / R^2 s' = T1 - T2 - sign(s) F0, s the speed of the rod's surface; the string slides relative to it",
    source="Newton's second law for the rod, Coulomb friction in its bearing",
    acts_on="rod",
    depends_on=("wrap_angle",),
    coefficients=(
        _coefficient("rod_mobility", "1/kg", (0.0, 1e4), "R^2 over the rod's moment of inertia; 0: the rod is fixed"),
        _coefficient(
            "bearing_friction", "N", (0.0, 100.0), "Coulomb friction F0 of the bearing, as a force at the rod's surface"
        ),
    ),
    needs_string=True,
    switch="rod_mobility",
    variables=("rod_speed",),
)

STRING_STRETCH = Effect(
    name="string_stretch",
    kind=EffectKind.PROPERTY,
    formula="T = k (e + tau e') on either side of the rod, 1/k the share of its string in C",
    source="Kelvin-Voigt model; string passes over the rod as the capstan law lets it",
    acts_on="string",
    depends_on=("free_length", "heavy_speed"),
    coefficients=(
        _coefficient("string_compliance", "m/N", (0.0, 0.1), "stretch C of the whole string per force"),
        _coefficient(
            "string_loss_time", "s", (0.0, 0.1), "damping over stiffness tau of a string that stretches; at least 0.1 ms"
        ),
    ),
    needs_string=True,
    switch="string_compliance",
    variables=("light_stretch", "heavy_stretch"),
)

LIGHT_INERTIA = Effect(
    name="light_inertia",
    kind=EffectKind.PROPERTY,
    formula="inertia M1 + I / l^2 across the string; I = 2/5 M1 r^2 for a sphere",
    source="Newton's second law for a body with size that turns with its string; a slack string leaves it free",
    acts_on="light mass",
    depends_on=("free_length", "across_speed", "retreat_speed"),
    coefficients=(
        _coefficient("light_inertia", "kg*m**2", (0.0, 1.0), "moment of inertia I of the light mass about its own centre"),
    ),
    needs_string=True,
    force_on_light_mass=_force_of_turning,
    inertia_of_light_mass=lambda xp, k, p: (0.0, _turning_inertia(k, p)),
)

FURTHER_PROPERTIES = (STRING_MASS, STRING_THICKNESS, HEAVY_SWING, OUT_OF_PLANE, TURNING_ROD, STRING_STRETCH, LIGHT_INERTIA)
"""Properties that the paper's model lacks."""
