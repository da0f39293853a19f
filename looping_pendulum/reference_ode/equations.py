"""The equations of motion and of the events, each written once, for numbers, arrays, symbols and compiled expressions.

With u = l' + R theta' and w = l theta' (see `state`), Newton's second law in the paper's directions e1 (along, towards the rod)
and t1 (across) reads::

    M1 (w theta' - u') = T1 + F_along          M1 (w' + u theta') = F_across
    M2 u2'             = T2 + F_heavy          T2 = T1 exp(-sign(u2) X(theta))

with every force but the string's pull in F, and the capstan exponent X = mu theta. Dividing by M1 the string's drag too is what
the paper's own force balance demands; its combined equation for theta'' omits that (an erratum, see docs/derivation.md).

Effects that the paper lacks change the inertias (M1 along and across, M2) or the radius, or add entries to the state. A string
that also runs along the rod, by z, is S = hypot(P, z) long on the light side, P = l + R theta, so that T1 has the share
c = P / S in the plane and s = z / S along the rod. A rod that turns moves its surface by the speed v, and the string slides by
u2 - v.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from looping_pendulum.reference_ode import effects as forces
from looping_pendulum.reference_ode.effects.forces import air_resistance
from looping_pendulum.reference_ode.effects.properties import swing_rates
from looping_pendulum.reference_ode.effects.types import TURN, Kinematics
from looping_pendulum.reference_ode.state import Effects, Signs, State, kinematics, own_variables, string_path, winding
from looping_pendulum.reference_ode.stretch import Springs, light_share, springs
from looping_pendulum.reference_ode.transitions import Event, Mode

NUDGE = 1e-18
"""Added to a phase's first event function: heyoka misses later roots of a function that is exactly zero where it starts."""
PASSING_NUDGE = 1e-12
"""The same for the speed of passing string, which is the difference of numbers about 1 m/s."""
EDGE = 1e-14
"""Share of the heavy side's tension by which the rod holds more than the friction cone says. On the very edge, as with equal
masses and no friction, rounding would decide; and |v| cannot be differentiated where a string lets go while everything rests.
"""


class _Slant(NamedTuple):
    """A string that also runs along the rod."""

    in_plane: Any
    """c"""
    along_rod: Any
    """s"""
    speed: Any
    """S' = c u + s z' [m/s]."""
    bend: Any
    """What S'' has beyond c u' + s z'' [m/s^2]: (u^2 + z'^2 - S'^2) / S."""
    force: Any
    """Force on the light mass along the rod but the string's [N]."""


class _Balance(NamedTuple):
    """Forces and inertias of one instant."""

    k: Kinematics
    pull: Any
    """Tension that would hold the light side of the string at a constant rate: M1 w theta' - F_along in the plane [N]."""
    across: Any
    """F_across [N]."""
    heavy: Any
    """F_heavy [N]."""
    ratio: Any
    """T2 / T1 while sliding."""
    holding: Any
    """Largest T2 / T1 that the rod can hold."""
    mass: Any
    """Of the light side, against a pull along the string [kg]."""
    along_mass: Any
    """Of the light side, in the plane along the string [kg]."""
    across_mass: Any
    heavy_mass: Any
    plane_pull: Any
    """M1 w theta' - F_along [N]."""
    string_speed: Any
    """Speed at which the path on the light side grows, S' [m/s]."""
    slant: _Slant | None
    """None in the plane."""
    springs: Springs | None
    """None for a string that does not stretch."""


def _balance(xp: Any, mode: Mode, t: Any, y: State, signs: Signs, p: Any, effects: Effects) -> _Balance:
    k = kinematics(xp, mode, t, y, signs, p, effects)
    along, across = forces.force_on_light_mass(xp, k, p, effects)
    heavy = forces.force_on_heavy_mass(xp, k, p, effects)
    along_mass, across_mass = forces.inertia_of_light_mass(xp, k, p, effects)
    heavy_mass = forces.inertia_of_heavy_mass(xp, k, p, effects)
    mass, pull = along_mass, along_mass * y.across_speed * (y.across_speed / y.free_length) - along
    slant, plane_pull, string_speed = None, pull, y.retreat_speed
    if "sideways" in own_variables(effects):
        slant = _slant(xp, k, y, signs, p, effects)
        c, s, string_speed = slant.in_plane, slant.along_rod, slant.speed
        mass = 1.0 / (c * c / along_mass + s * s / p.light_mass)
        pull = mass * (c * plane_pull / along_mass + s * slant.force / p.light_mass + slant.bend)
    ratio = xp.exp(-signs.slide * forces.sliding_exponent(xp, k, p, effects)) if mode.sliding else None
    gripped = mode in (Mode.STICKING, Mode.ROLLING)
    holding = xp.exp(forces.holding_exponent(xp, k, p, effects)) if gripped else None
    stretched = None
    if "light_stretch" in own_variables(effects):
        path = string_path(xp, y, signs.overlap, p, effects)
        stretched = springs(mode, y, string_speed, path, ratio, p)
    return _Balance(
        k=k,
        pull=pull,
        across=across,
        heavy=heavy,
        ratio=ratio,
        holding=holding,
        mass=mass,
        along_mass=along_mass,
        across_mass=across_mass,
        heavy_mass=heavy_mass,
        plane_pull=plane_pull,
        string_speed=string_speed,
        slant=slant,
        springs=stretched,
    )


def _slant(xp: Any, k: Kinematics, y: State, signs: Signs, p: Any, effects: Effects) -> _Slant:
    whole, path = string_path(xp, y, signs.overlap, p, effects), winding(y, signs.overlap, p, effects).path
    c, s, u, v = path / whole, y.sideways / whole, y.retreat_speed, y.sideways_speed
    speed = c * u + s * v
    return _Slant(c, s, speed, (u * u + v * v - speed * speed) / whole, -air_resistance(xp, k, p) * v)


def _sliding_drive(b: _Balance) -> Any:
    """(M2 + M1 T2/T1) u2' [N]: what accelerates both masses along the string."""
    return b.ratio * b.pull + b.heavy


def _heavy_rate(mode: Mode, signs: Signs, b: _Balance, p: Any) -> Any:
    """Upward acceleration u2' of the heavy mass [m/s^2]."""
    if b.springs is not None and mode in (Mode.SLIDING_DOWN, Mode.SLIDING_UP, Mode.STICKING):
        return (b.springs.heavy_tension + b.heavy) / b.heavy_mass
    if mode.sliding:
        return _sliding_drive(b) / (b.heavy_mass + b.mass * b.ratio)
    if mode is Mode.ROLLING:
        mobility = p.rod_mobility
        driven = b.pull + b.heavy - p.bearing_friction * signs.rod
        return mobility * driven / (1.0 + mobility * (b.mass + b.heavy_mass))
    return b.heavy / b.heavy_mass if mode in (Mode.SLACK, Mode.FALLING) else 0.0


def _tensions(mode: Mode, b: _Balance, heavy_rate: Any) -> tuple[Any, Any]:
    if mode.slack:
        return 0.0 * b.pull, 0.0 * b.pull
    if b.springs is not None:
        return b.springs.light_tension, b.springs.heavy_tension
    return b.pull - b.mass * heavy_rate, b.heavy_mass * heavy_rate - b.heavy


def _rod_rate(mode: Mode, signs: Signs, b: _Balance, p: Any, heavy_rate: Any) -> Any:
    """Acceleration of the rod's surface [m/s^2]: R^2 / I (T1 - T2 - sign F0), 0 while its bearing holds it."""
    if mode is Mode.ROLLING:
        return heavy_rate
    if not (mode.sliding or mode is Mode.SLACK):
        return 0.0
    light, heavy = _tensions(mode, b, heavy_rate)
    return signs.rod * signs.rod * p.rod_mobility * (light - heavy - p.bearing_friction * signs.rod)


def rates(xp: Any, mode: Mode, t: Any, y: State, signs: Signs, p: Any, effects: Effects) -> State:
    """Derivatives of the state by time."""
    b = _balance(xp, mode, t, y, signs, p, effects)
    own = own_variables(effects)
    turning = y.across_speed / y.free_length
    heavy_rate = _heavy_rate(mode, signs, b, p)
    u_rate = b.pull / b.mass if mode.slack else heavy_rate
    sideways_rate = 0.0
    if b.slant is not None:
        light_tension, _ = _tensions(mode, b, heavy_rate)
        u_rate = (b.plane_pull - b.slant.in_plane * light_tension) / b.along_mass
        sideways_rate = (b.slant.force - b.slant.along_rod * light_tension) / p.light_mass
    elif b.springs is not None:
        u_rate = (b.pull - _tensions(mode, b, heavy_rate)[0]) / b.along_mass
    light_stretching = heavy_stretching = 0.0
    if b.springs is not None:
        passing = y.heavy_speed if mode.slack else b.springs.passing  # all of it, so that the heavy side stays as it is
        light_stretching, heavy_stretching = b.string_speed - passing, passing - y.heavy_speed
    tilt_rate = swing_rate = 0.0
    if "heavy_tilt" in own and mode not in (Mode.CLAMPED, Mode.CLAMPED_SLACK):
        tilt_rate, swing_rate = swing_rates(xp, b.k, p)
    return State(
        free_length=y.retreat_speed - winding(y, signs.overlap, p, effects).radius * turning,
        wrap_angle=turning,
        retreat_speed=u_rate,
        across_speed=b.across / b.across_mass - y.retreat_speed * turning,
        heavy_speed=heavy_rate,
        slack=y.heavy_speed - b.string_speed,
        heavy_tilt=tilt_rate,
        heavy_across_speed=swing_rate,
        sideways=y.sideways_speed,
        sideways_speed=sideways_rate,
        rod_speed=_rod_rate(mode, signs, b, p, heavy_rate) if "rod_speed" in own else 0.0,
        light_stretch=light_stretching,
        heavy_stretch=heavy_stretching,
    )


def tensions(xp: Any, mode: Mode, t: Any, y: State, signs: Signs, p: Any, effects: Effects) -> tuple[Any, Any]:
    """Tension in the free string and above the heavy mass, (T1, T2) [N]; a clamped heavy mass counts as hanging by it."""
    b = _balance(xp, mode, t, y, signs, p, effects)
    return _tensions(mode, b, _heavy_rate(mode, signs, b, p))


def holding_margins(
    xp: Any, t: Any, y: State, signs: Signs, p: Any, effects: Effects, mode: Mode = Mode.STICKING
) -> tuple[Any, Any]:
    """How far the rod is from letting a string slide that it holds (down, up), as tensions [N]; below zero it slides.

    It holds while T1 / H <= T2 <= T1 H, H the largest tension ratio that it can hold. ``mode``: whether it rests or turns.
    """
    b = _balance(xp, mode, t, y, signs, p, effects)
    return _margins(mode, signs, b, p)


def _margins(mode: Mode, signs: Signs, b: _Balance, p: Any) -> tuple[Any, Any]:
    light, heavy = _tensions(mode, b, _heavy_rate(mode, signs, b, p))
    spare = EDGE * heavy
    return light * b.holding - heavy + spare, heavy * b.holding - light + spare


def _rod_returns(signs: Signs, y: State, rod_rate: Any) -> Any:
    """Fall through zero: the rod slows (phase 0), or has come to rest (phase 1)."""
    return signs.rod_phase * signs.rod * y.rod_speed + (1.0 - signs.rod_phase) * (signs.rod * rod_rate + NUDGE)


def event_functions(xp: Any, mode: Mode, t: Any, y: State, signs: Signs, p: Any, effects: Effects) -> dict[Event, Any]:
    """What is watched in ``mode``: each event happens where its function falls through zero."""
    length = y.free_length
    watched = {Event.LIGHT_REACHES_ROD: length - p.end_length, Event.ACROSS_REVERSES: signs.across * y.across_speed}
    if mode is Mode.FALLING:
        return watched
    b = _balance(xp, mode, t, y, signs, p, effects)
    turns = "rod_speed" in own_variables(effects)
    hanging = p.string_length - string_path(xp, y, signs.overlap, p, effects) - y.slack
    watched[Event.UNWRAPPED] = y.wrap_angle
    if any(effect.watches_first_turn for effect in effects):
        watched[Event.FIRST_TURN] = (2.0 * signs.overlap - 1.0) * (y.wrap_angle - TURN)
    if mode.string_moves or mode is Mode.SLACK:
        watched[Event.HEAVY_REACHES_ROD] = hanging
    if mode.sliding:
        returning, drive = signs.slide * y.heavy_speed, signs.slide * _sliding_drive(b)
        if turns:
            heavy_rate = _heavy_rate(mode, signs, b, p)
            light, heavy = _tensions(mode, b, heavy_rate)
            returning = signs.slide * (y.heavy_speed - y.rod_speed)
            held = p.bearing_friction - signs.slide * (light - heavy)
            rod_rate = _rod_rate(mode, signs, b, p, heavy_rate)
            drive = signs.slide * (heavy_rate - rod_rate)
            watched[Event.ROD_CHANGES] = _rod_returns(signs, y, rod_rate) + (1.0 - signs.rod * signs.rod) * held
        if b.springs is not None:
            watched[Event.STOP] = signs.slide * b.springs.passing + PASSING_NUDGE
            watched[Event.LOSES_TENSION] = b.springs.reserve
        else:
            watched[Event.STOP] = signs.phase * returning + (1.0 - signs.phase) * (drive + NUDGE)
            watched[Event.LOSES_TENSION] = b.heavy_mass * b.pull - b.mass * b.heavy
    elif mode in (Mode.STICKING, Mode.ROLLING):
        watched[Event.SLIP_ONSET_DOWN], watched[Event.SLIP_ONSET_UP] = _margins(mode, signs, b, p)
        if mode is Mode.ROLLING:
            watched[Event.ROD_STOPS] = _rod_returns(signs, y, _heavy_rate(mode, signs, b, p))
        elif turns:
            watched[Event.ROD_YIELDS_UP] = p.bearing_friction - (b.pull + b.heavy)
            watched[Event.ROD_YIELDS_DOWN] = p.bearing_friction + (b.pull + b.heavy)
    elif mode is Mode.CLAMPED:
        watched[Event.LOSES_TENSION] = b.pull if b.springs is None else b.springs.light_tension
    else:
        slack, closing = y.slack, y.heavy_speed - b.string_speed + NUDGE
        if b.springs is not None:
            slack = -b.springs.reserve
            closing = closing + p.string_loss_time * (_heavy_rate(mode, signs, b, p) - b.pull / b.mass)
        watched[Event.TAUT] = signs.phase * slack + (1.0 - signs.phase) * closing
        if mode is Mode.SLACK:
            watched[Event.HEAVY_REVERSES] = signs.heavy * y.heavy_speed
            if turns:
                watched[Event.ROD_CHANGES] = signs.rod * y.rod_speed + (1.0 - signs.rod * signs.rod)
    return watched


class Impact(NamedTuple):
    """Just after a string became taut, or a pull along it."""

    state: State
    sliding: Any
    """Speed at which the string then slides over the rod, up being positive [m/s]."""


def impact(xp: Any, slide: float, t: Any, y: State, signs: Signs, p: Any, effects: Effects) -> Impact:
    """Inelastic pull along the string, which slides by ``slide`` (+1 up, -1 down; 0: the rod holds it).

    The impulses on the two sides obey the capstan law too, J2 = J1 E with E = exp(-slide X), so that
    u = (M2 u2 + E M1 u1) / (M2 + E M1). A rod that turns takes up J1 - J2; one that cannot stops a string that it holds.
    """
    b = _balance(xp, Mode.SLACK, t, y, signs, p, effects)
    ratio = xp.exp(-slide * forces.sliding_exponent(xp, b.k, p, effects))
    light_mass_speed = b.string_speed
    turns = "rod_speed" in own_variables(effects)
    if slide:
        momentum = b.heavy_mass * y.heavy_speed + ratio * b.mass * light_mass_speed
        speed = momentum / (b.heavy_mass + ratio * b.mass)
    elif turns:
        momentum = b.heavy_mass * y.heavy_speed + b.mass * light_mass_speed + y.rod_speed / p.rod_mobility
        speed = momentum / (b.heavy_mass + b.mass + 1.0 / p.rod_mobility)
    else:
        speed = 0.0
    impulse = b.mass * (light_mass_speed - speed)
    after = y._replace(retreat_speed=speed, heavy_speed=speed, slack=0.0)
    if b.slant is not None:
        after = after._replace(
            retreat_speed=y.retreat_speed - b.slant.in_plane * impulse / b.along_mass,
            sideways_speed=y.sideways_speed - b.slant.along_rod * impulse / p.light_mass,
        )
    if turns:
        rod_speed = y.rod_speed + p.rod_mobility * impulse * (1.0 - ratio) if slide else speed
        after = after._replace(rod_speed=rod_speed)
    return Impact(after, speed - after.rod_speed)


def stretched_at_rest(xp: Any, t: Any, y: State, signs: Signs, p: Any, effects: Effects) -> State:
    """``y``, at rest, with the stretch of a string on the verge of sliding down: T2 the heavy mass's weight, T1 = T2 / E."""
    b = _balance(xp, Mode.SLIDING_DOWN, t, y, signs, p, effects)
    share = light_share(string_path(xp, y, signs.overlap, p, effects), 0.0, p)
    weight, c = -b.heavy, p.string_compliance
    return y._replace(light_stretch=weight / b.ratio * c * share, heavy_stretch=weight * c * (1.0 - share))


def evened_out(xp: Any, y: State, signs: Signs, p: Any, effects: Effects) -> State:
    """``y`` with its stretch spread evenly, as a string without tension does."""
    whole = y.light_stretch + y.heavy_stretch
    share = light_share(string_path(xp, y, signs.overlap, p, effects), y.light_stretch, p)
    return y._replace(light_stretch=whole * share, heavy_stretch=whole * (1.0 - share))
