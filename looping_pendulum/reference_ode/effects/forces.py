"""Forces, string laws and releases beyond the paper's model, candidates for what a measurement may show to be missing."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from looping_pendulum.reference_ode.effects.types import Coefficient, Effect, EffectKind, Kinematics

MIN_SPEED = 1e-150
"""Added to a denominator to keep a ratio of speeds defined at rest [m/s]; rounding loses it beside any real speed."""


def _coefficient(name: str, unit: str, bounds: tuple[float, float], meaning: str) -> Coefficient:
    return Coefficient(name=name, unit=unit, default=0.0, null=0.0, bounds=bounds, meaning=meaning)


def _wind_along_and_across(xp: Any, k: Kinematics, p: SimpleNamespace) -> tuple[Any, Any]:
    """Return the velocity of the wind, which blows along x, (along, across) the string [m/s]."""
    return p.wind_speed * xp.sin(k.wrap_angle), -p.wind_speed * xp.cos(k.wrap_angle)


def _drag_coefficient(p: SimpleNamespace, along: Any, speed: Any) -> Any:
    """Return drag force per unit speed [kg/s] on the light mass, including its dependence on attitude.

    Parameters
    ----------
    along
        Velocity through the air along the string [m/s].
    speed
        Speed through the air [m/s].
    """
    attitude = p.attitude_drag * along * along / (speed + MIN_SPEED)
    return p.light_linear_drag + p.light_drag * (speed + attitude)


def _velocity_through_air(xp: Any, k: Kinematics, p: SimpleNamespace) -> tuple[Any, Any, Any]:
    """Return the velocity of the light mass relative to the air, (along, across), and its size [m/s]."""
    wind_along, wind_across = _wind_along_and_across(xp, k, p)
    along, across = -k.retreat_speed - wind_along, k.across_speed - wind_across
    return along, across, xp.sqrt(along * along + across * across + k.sideways_speed * k.sideways_speed)


def air_drag_coefficient(xp: Any, k: Kinematics, p: SimpleNamespace) -> Any:
    """Return drag force per unit speed [kg/s] on the light mass, as it moves through the air at this instant."""
    along, _, speed = _velocity_through_air(xp, k, p)
    return _drag_coefficient(p, along, speed)


def _wind_force(xp: Any, k: Kinematics, p: SimpleNamespace) -> tuple[Any, Any]:
    """Return the drag in moving air less that in still air, which the drag effects give already, (along, across) [N]."""
    along, across, speed = _velocity_through_air(xp, k, p)
    moving = _drag_coefficient(p, along, speed)
    still = _drag_coefficient(p, k.retreat_speed, k.light_mass_speed)
    return -moving * along - still * k.retreat_speed, -moving * across + still * k.across_speed


def _attitude_drag_force(xp: Any, k: Kinematics, p: SimpleNamespace) -> tuple[Any, Any]:
    """Return the drag that motion along the string adds in still air, (along, across) [N]."""
    more = p.light_drag * p.attitude_drag * k.retreat_speed * k.retreat_speed / (k.light_mass_speed + MIN_SPEED)
    return more * k.retreat_speed, -more * k.across_speed


def _horizontal(xp: Any, k: Kinematics, force: Any) -> tuple[Any, Any]:
    """Return a force along x as (along, across) the string [N]."""
    return force * xp.sin(k.wrap_angle), -force * xp.cos(k.wrap_angle)


def _side_spring(xp: Any, k: Kinematics, p: SimpleNamespace) -> tuple[Any, Any]:
    """Return the horizontal force that is proportional to the light mass's x, (along, across) [N]."""
    x = p.rod_radius * xp.cos(k.wrap_angle) - k.free_length * xp.sin(k.wrap_angle)
    return _horizontal(xp, k, p.side_stiffness * x)


LIGHT_LINEAR_DRAG = Effect(
    name="light_linear_drag",
    kind=EffectKind.FORCE,
    formula="F = -b1 v1",
    source="Stokes drag, 6 pi eta r for a slow sphere",
    acts_on="light mass",
    depends_on=("light_mass_speed",),
    coefficients=(_coefficient("light_linear_drag", "kg/s", (0.0, 1.0), "linear drag coefficient b1 of the light mass"),),
    force_on_light_mass=lambda xp, k, p: (p.light_linear_drag * k.retreat_speed, -p.light_linear_drag * k.across_speed),
)

HEAVY_LINEAR_DRAG = Effect(
    name="heavy_linear_drag",
    kind=EffectKind.FORCE,
    formula="F = -b2 v2",
    source="Stokes drag, 6 pi eta r for a slow sphere",
    acts_on="heavy mass",
    depends_on=("heavy_speed",),
    coefficients=(_coefficient("heavy_linear_drag", "kg/s", (0.0, 10.0), "linear drag coefficient b2 of the heavy mass"),),
    force_on_heavy_mass=lambda xp, k, p: -p.heavy_linear_drag * k.heavy_speed,
)

ATTITUDE_DRAG = Effect(
    name="attitude_drag",
    kind=EffectKind.FORCE,
    formula="F = -c gamma1 cos^2(angle between v1 and string) |v1| v1",
    source="drag of a body that is not round and points along its string",
    acts_on="light mass",
    depends_on=("light_mass_speed", "retreat_speed"),
    coefficients=(
        # Down to -1, where drag along the string vanishes
        _coefficient("attitude_drag", "", (-1.0, 100.0), "growth of gamma1 where the light mass moves along its string"),
    ),
    force_on_light_mass=_attitude_drag_force,
)

WIND = Effect(
    name="wind",
    kind=EffectKind.FORCE,
    formula="F = D(v1 - W x) - D(v1), D the light mass's drag",
    source="drag acts against the velocity relative to the air",
    acts_on="light mass",
    depends_on=("light_mass_speed", "retreat_speed", "across_speed", "wrap_angle"),
    coefficients=(_coefficient("wind_speed", "m/s", (-20.0, 20.0), "speed W of the air along x at the light mass"),),
    force_on_light_mass=_wind_force,
)

SIDE_FORCE = Effect(
    name="side_force",
    kind=EffectKind.FORCE,
    formula="F = F0 x",
    source="a constant horizontal pull",
    acts_on="light mass",
    depends_on=("wrap_angle",),
    coefficients=(_coefficient("side_force", "N", (-10.0, 10.0), "horizontal force F0 on the light mass, along x"),),
    force_on_light_mass=lambda xp, k, p: _horizontal(xp, k, p.side_force),
)

SIDE_STIFFNESS = Effect(
    name="side_stiffness",
    kind=EffectKind.FORCE,
    formula="F = kappa x1 x",
    source="a horizontal pull that grows with the distance from the rod's vertical plane, to first order",
    acts_on="light mass",
    depends_on=("free_length", "wrap_angle"),
    coefficients=(
        _coefficient("side_stiffness", "N/m", (-10.0, 10.0), "horizontal force on the light mass per x; positive: outwards"),
    ),
    force_on_light_mass=_side_spring,
)

FRICTION_PER_SPEED = Effect(
    name="friction_per_speed",
    kind=EffectKind.STRING_LAW,
    formula="mu -> mu (1 + c |v2|) while the string slides",
    source="friction that depends on speed, to first order",
    acts_on="string on rod",
    depends_on=("wrap_angle", "heavy_speed"),
    coefficients=(
        # Down to -0.1, so that friction stays positive up to 10 m/s
        _coefficient("friction_per_speed", "s/m", (-0.1, 10.0), "relative growth of kinetic friction with sliding speed"),
    ),
    sliding_exponent=lambda xp, k, p: p.kinetic_friction * k.contact_angle * p.friction_per_speed * k.slip_speed,
)

FRICTION_PER_WRAP = Effect(
    name="friction_per_wrap",
    kind=EffectKind.STRING_LAW,
    formula="mu -> mu (1 + c theta)",
    source="departure from the capstan law, as of a string with stiffness, to first order",
    acts_on="string on rod",
    depends_on=("wrap_angle",),
    # Down to -0.05, so that friction stays positive up to 20 rad, three turns
    coefficients=(_coefficient("friction_per_wrap", "1/rad", (-0.05, 1.0), "relative growth of friction with wrap angle"),),
    sliding_exponent=lambda xp, k, p: p.kinetic_friction * p.friction_per_wrap * k.contact_angle * k.contact_angle,
    holding_exponent=lambda xp, k, p: p.static_friction * p.friction_per_wrap * k.contact_angle * k.contact_angle,
)

STRING_ON_STRING = Effect(
    name="string_on_string",
    kind=EffectKind.STRING_LAW,
    formula="exponent of the capstan law + c (theta - 2 pi) beyond the first turn",
    source="string that lies on string rubs twice",
    acts_on="string on rod",
    depends_on=("wrap_angle",),
    coefficients=(_coefficient("string_on_string", "", (0.0, 5.0), "friction added to the rod's beyond the first full turn"),),
    sliding_exponent=lambda xp, k, p: p.string_on_string * k.wrap_beyond_first_turn,
    holding_exponent=lambda xp, k, p: p.string_on_string * k.wrap_beyond_first_turn,
    watches_first_turn=True,
)

PUSH_ACROSS = Effect(
    name="push_across",
    kind=EffectKind.RELEASE,
    formula="v1(0) = w0 t1",
    source="a hand that moves as it lets go",
    acts_on="light mass",
    depends_on=(),
    coefficients=(
        _coefficient("push_across", "m/s", (-20.0, 20.0), "speed w0 of the light mass across the string at release"),
    ),
)

PUSH_ALONG = Effect(
    name="push_along",
    kind=EffectKind.RELEASE,
    formula="v1(0) = -u0 e1; a taut string shares u0 > 0 at once, as when it becomes taut, and u0 < 0 leaves it slack",
    source="a hand that moves as it lets go",
    acts_on="light mass",
    depends_on=(),
    coefficients=(_coefficient("push_along", "m/s", (-20.0, 20.0), "speed u0 of the light mass away from the rod at release"),),
)

PIVOT_FRICTION = Effect(
    name="pivot_friction",
    kind=EffectKind.FORCE,
    formula="torque -tau0 sign(theta'), F = -tau0 sign(w) / l across the string; holds a mass at rest up to tau0",
    source="Coulomb friction of a knife edge or a bearing; Squire, Am. J. Phys. 54 (1986) 984",
    acts_on="light mass",
    depends_on=("free_length", "across_speed"),
    coefficients=(_coefficient("pivot_friction", "N*m", (0.0, 10.0), "constant frictional torque tau0 at the pivot"),),
    needs_string=True,
    needs_pivot=True,
    force_on_light_mass=lambda xp, k, p: (0.0, -p.pivot_friction * k.taut * k.across_direction / k.free_length),
)

PIVOT_DAMPING = Effect(
    name="pivot_damping",
    kind=EffectKind.FORCE,
    formula="torque -c theta', F = -c w / l^2 across the string",
    source="viscous friction of a lubricated bearing",
    acts_on="light mass",
    depends_on=("free_length", "across_speed"),
    coefficients=(_coefficient("pivot_damping", "N*m*s", (0.0, 10.0), "frictional torque c at the pivot per angular speed"),),
    needs_string=True,
    needs_pivot=True,
    force_on_light_mass=lambda xp, k, p: (
        0.0,
        -p.pivot_damping * k.taut * k.across_speed / (k.free_length * k.free_length),
    ),
)

FURTHER_FORCES = (
    LIGHT_LINEAR_DRAG,
    HEAVY_LINEAR_DRAG,
    ATTITUDE_DRAG,
    WIND,
    SIDE_FORCE,
    SIDE_STIFFNESS,
    FRICTION_PER_SPEED,
    FRICTION_PER_WRAP,
    STRING_ON_STRING,
    PUSH_ACROSS,
    PUSH_ALONG,
    PIVOT_FRICTION,
    PIVOT_DAMPING,
)
"""Forces, string laws and releases that the paper's model lacks."""
