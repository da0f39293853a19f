"""The effects of this package: those of the paper's model, and candidates for what a measurement may show to be missing.

Forces, string laws and motions at release come first. Then follow properties of string, rod and masses, which change inertias
or geometry, or add state variables.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from looping_pendulum.reference_ode.effects.closure import CLOSURE
from looping_pendulum.reference_ode.effects.types import TURN, Coefficient, Effect, EffectKind, Kinematics

MIN_SPEED = 1e-150
"""Added to a denominator to keep a ratio of speeds defined at rest [m/s]; rounding loses it beside any real speed."""


MIN_LOSS_TIME = 1e-4
"""Least damping over stiffness of a string that stretches [s]: without damping its speed over the rod is not determined."""
REST_SPEED = 1e-3
"""Speed below which the drag on a swinging heavy mass is rounded off [m/s], as |v| is not analytic at 0: 1e-9 N at most."""


def _coefficient(
    name: str, title: str, unit: str, bounds: tuple[float, float], meaning: str, *, default: float = 0.0, even: bool = False
) -> Coefficient:
    return Coefficient(name=name, title=title, unit=unit, default=default, null=0.0, bounds=bounds, meaning=meaning, even=even)


GRAVITY = Effect(
    name="gravity",
    kind=EffectKind.FORCE,
    formula="F = -M g y",
    source="paper, sec. II",
    acts_on="both masses",
    depends_on=(),
    coefficients=(_coefficient("gravity", "gravity", "m/s**2", (0.0, 100.0), "acceleration of free fall g", default=9.81),),
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
        _coefficient(
            "kinetic_friction",
            "friction of the sliding string",
            "",
            (0.0, 5.0),
            "friction coefficient mu while the string slides",
        ),
        _coefficient(
            "static_friction",
            "friction of the string at rest",
            "",
            (0.0, 10.0),
            "friction coefficient mu_s before it slides; the kinetic one if not given",
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
        _coefficient("light_drag", "the air's drag on the light mass", "kg/m", (0.0, 1.0), "quadratic drag coefficient gamma1"),
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
        _coefficient("heavy_drag", "the air's drag on the heavy mass", "kg/m", (0.0, 1.0), "quadratic drag coefficient gamma2"),
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
        _coefficient(
            "string_drag",
            "the air's drag on the string",
            "kg/m**2",
            (0.0, 1.0),
            "drag coefficient alpha of the free string per length",
        ),
    ),
    in_base_model=True,
    needs_string=True,
    force_on_light_mass=lambda xp, k, p: (0.0, -p.string_drag * k.free_length * k.across_speed_size * k.across_speed),
)


def _horizontal(xp: Any, k: Kinematics, x: Any) -> tuple[Any, Any]:
    """Return a vector along x as (along, across) the string."""
    return x * xp.sin(k.wrap_angle), -x * xp.cos(k.wrap_angle)


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
    wind_along, wind_across = _horizontal(xp, k, p.wind_speed)
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
    coefficients=(
        _coefficient(
            "light_linear_drag",
            "a drag on the light mass in proportion to its speed",
            "kg/s",
            (0.0, 1.0),
            "linear drag coefficient b1 of the light mass",
        ),
    ),
    force_on_light_mass=lambda xp, k, p: (p.light_linear_drag * k.retreat_speed, -p.light_linear_drag * k.across_speed),
)

HEAVY_LINEAR_DRAG = Effect(
    name="heavy_linear_drag",
    kind=EffectKind.FORCE,
    formula="F = -b2 v2",
    source="Stokes drag, 6 pi eta r for a slow sphere",
    acts_on="heavy mass",
    depends_on=("heavy_speed",),
    coefficients=(
        _coefficient(
            "heavy_linear_drag",
            "a drag on the heavy mass in proportion to its speed",
            "kg/s",
            (0.0, 10.0),
            "linear drag coefficient b2 of the heavy mass",
        ),
    ),
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
        _coefficient(
            "attitude_drag",
            "a drag that depends on how the light mass points",
            "",
            (-1.0, 100.0),
            "growth of gamma1 where the light mass moves along its string",
        ),
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
    coefficients=(_coefficient("wind_speed", "a wind", "m/s", (-20.0, 20.0), "speed W of the air along x at the light mass"),),
    force_on_light_mass=_wind_force,
)

SIDE_FORCE = Effect(
    name="side_force",
    kind=EffectKind.FORCE,
    formula="F = F0 x",
    source="a constant horizontal pull",
    acts_on="light mass",
    depends_on=(),
    direction="x",
    coefficients=(
        _coefficient(
            "side_force", "a steady sideways force", "N", (-10.0, 10.0), "horizontal force F0 on the light mass, along x"
        ),
    ),
    force_on_light_mass=lambda xp, k, p: _horizontal(xp, k, p.side_force),
)

SIDE_STIFFNESS = Effect(
    name="side_stiffness",
    kind=EffectKind.FORCE,
    formula="F = kappa x1 x",
    source="a horizontal pull that grows with the distance from the rod's vertical plane, to first order",
    acts_on="light mass",
    depends_on=("free_length", "wrap_angle"),
    direction="x",
    coefficients=(
        _coefficient(
            "side_stiffness",
            "a sideways pull that grows with the distance",
            "N/m",
            (-10.0, 10.0),
            "horizontal force on the light mass per x; positive: outwards",
        ),
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
        _coefficient(
            "friction_per_speed",
            "a friction that changes with the string's speed",
            "s/m",
            (-0.1, 10.0),
            "relative growth of kinetic friction with sliding speed",
        ),
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
    coefficients=(
        _coefficient(
            "friction_per_wrap",
            "a friction that changes with the wound angle",
            "1/rad",
            (-0.05, 1.0),
            "relative growth of friction with wrap angle",
        ),
    ),
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
    coefficients=(
        _coefficient(
            "string_on_string",
            "the friction of string on string",
            "",
            (0.0, 5.0),
            "friction added to the rod's beyond the first full turn",
        ),
    ),
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
        _coefficient(
            "push_across",
            "a push across the string at the release",
            "m/s",
            (-20.0, 20.0),
            "speed w0 of the light mass across the string at release",
        ),
    ),
)

PUSH_ALONG = Effect(
    name="push_along",
    kind=EffectKind.RELEASE,
    formula="v1(0) = -u0 e1; a taut string shares u0 > 0 at once, as when it becomes taut, and u0 < 0 leaves it slack",
    source="a hand that moves as it lets go",
    acts_on="light mass",
    depends_on=(),
    coefficients=(
        _coefficient(
            "push_along",
            "a push along the string at the release",
            "m/s",
            (-20.0, 20.0),
            "speed u0 of the light mass away from the rod at release",
        ),
    ),
)

PIVOT_FRICTION = Effect(
    name="pivot_friction",
    kind=EffectKind.FORCE,
    formula="torque -tau0 sign(theta'), F = -tau0 sign(w) / l across the string; holds a mass at rest up to tau0",
    source="Coulomb friction of a knife edge or a bearing; Squire, Am. J. Phys. 54 (1986) 984",
    acts_on="light mass",
    depends_on=("free_length", "across_speed"),
    coefficients=(
        _coefficient(
            "pivot_friction",
            "a steady friction of the pivot",
            "N*m",
            (0.0, 10.0),
            "constant frictional torque tau0 at the pivot",
        ),
    ),
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
    coefficients=(
        _coefficient(
            "pivot_damping",
            "a friction of the pivot in proportion to the speed",
            "N*m*s",
            (0.0, 10.0),
            "frictional torque c at the pivot per angular speed",
        ),
    ),
    needs_string=True,
    needs_pivot=True,
    force_on_light_mass=lambda xp, k, p: (
        0.0,
        -p.pivot_damping * k.taut * k.across_speed / (k.free_length * k.free_length),
    ),
)


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
    coefficients=(
        _coefficient("string_density", "the string's mass", "kg/m", (0.0, 0.1), "mass rho of the string per length"),
    ),
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
    coefficients=(
        _coefficient("string_thickness", "the string's thickness", "m", (0.0, 0.01), "growth d of the wound radius per turn"),
    ),
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
        _coefficient(
            "heavy_swing",
            "a swing of the heavy mass",
            "rad",
            (-1.2, 1.2),
            "angle phi of the heavy mass's string to the vertical at release",
        ),
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
        _coefficient(
            "push_sideways",
            "a push along the rod at the release",
            "m/s",
            (-5.0, 5.0),
            "speed of the light mass along the rod at release",
            even=True,
        ),
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
        _coefficient(
            "rod_mobility", "a rod that turns", "1/kg", (0.0, 1e4), "R^2 over the rod's moment of inertia; 0: the rod is fixed"
        ),
        _coefficient(
            "bearing_friction",
            "the friction of the rod's bearing",
            "N",
            (0.0, 100.0),
            "Coulomb friction F0 of the bearing, as a force at the rod's surface",
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
        _coefficient(
            "string_compliance", "a string that stretches", "m/N", (0.0, 0.1), "stretch C of the whole string per force"
        ),
        _coefficient(
            "string_loss_time",
            "the damping of a string that stretches",
            "s",
            (0.0, 0.1),
            "damping over stiffness tau of a string that stretches; at least 0.1 ms",
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
        _coefficient(
            "light_inertia",
            "the inertia of the light mass as it turns",
            "kg*m**2",
            (0.0, 1.0),
            "moment of inertia I of the light mass about its own centre",
        ),
    ),
    needs_string=True,
    force_on_light_mass=_force_of_turning,
    inertia_of_light_mass=lambda xp, k, p: (0.0, _turning_inertia(k, p)),
)

# Forces and exponents are summed in this order: another order would change the last bits of every result
LIBRARY = (
    GRAVITY,
    CAPSTAN,
    LIGHT_DRAG,
    HEAVY_DRAG,
    STRING_DRAG,
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
    STRING_MASS,
    STRING_THICKNESS,
    HEAVY_SWING,
    OUT_OF_PLANE,
    TURNING_ROD,
    STRING_STRETCH,
    LIGHT_INERTIA,
    CLOSURE,
)
"""Effects of this package."""
