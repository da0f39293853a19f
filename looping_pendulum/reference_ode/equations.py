"""The equations of motion and of the events, each written once, for numbers, arrays, symbols and compiled expressions.

State (paper's l and theta, but speeds chosen so that each mode is simple): free length l, wrap angle theta,
u = l' + R theta' (the light mass's speed away from the rod along the string; the heavy mass's upward speed while taut),
w = l theta'. Newton's second law in the paper's directions e1 (along, towards the rod) and t1 (across) reads::

    M1 (w theta' - u') = T1 + F_along          M1 (w' + u theta') = F_across
    M2 u2'             = T2 + F_heavy          T2 = T1 exp(-sign(u2) X(theta))

with every force but the string's pull in F, and the capstan exponent X = mu theta. Dividing by M1 the string's drag too is what
the paper's own force balance demands; its combined equation for theta'' omits that (an erratum, see docs/derivation.md).
"""

from __future__ import annotations

from typing import Any, NamedTuple

from looping_pendulum.reference_ode import effects as forces
from looping_pendulum.reference_ode.effects import Effect, Kinematics
from looping_pendulum.reference_ode.transitions import Event, Mode

Effects = tuple[Effect, ...]

NUDGE = 1e-18
"""Added to a phase's first event function: heyoka misses later roots of a function that is exactly zero where it starts."""


class State(NamedTuple):
    """State of a run, or its rate of change. SI."""

    free_length: Any
    wrap_angle: Any
    retreat_speed: Any
    """u: of the light mass, along the string, away from the rod [m/s]."""
    across_speed: Any
    """w = l theta' [m/s]."""
    heavy_speed: Any
    """Upward speed of the heavy mass [m/s]; equal to u while taut."""
    slack: Any
    """String length beyond the shortest path over the rod [m]; 0 while taut."""


RETREAT_SPEED, HEAVY_SPEED = State._fields.index("retreat_speed"), State._fields.index("heavy_speed")


class Signs(NamedTuple):
    """Piecewise constants that keep the equations analytic between events."""

    slide: Any
    """+1 sliding up, -1 sliding down."""
    across: Any
    """Sign of w."""
    heavy: Any
    """Sign of the heavy mass's speed while slack."""
    phase: Any
    """0: wait until a return to zero becomes possible (SLOWS, CLOSES); 1: watch for the return (STOP, TAUT)."""


VARIABLES: dict[Mode, tuple[str, ...]] = {
    Mode.STICKING: ("free_length", "wrap_angle", "across_speed"),
    Mode.CLAMPED: ("free_length", "wrap_angle", "across_speed"),
    Mode.SLIDING_DOWN: ("free_length", "wrap_angle", "retreat_speed", "across_speed"),
    Mode.SLIDING_UP: ("free_length", "wrap_angle", "retreat_speed", "across_speed"),
    Mode.SLACK: State._fields,
    Mode.CLAMPED_SLACK: State._fields,
    Mode.FALLING: State._fields,
}
"""Which entries of the state change in each mode; the others are zero, or the heavy speed that follows u."""


def complete(mode: Mode, **variables: Any) -> State:
    """Fill in the entries of the state that a mode implies."""
    if mode.slack:
        return State(**variables)
    u = variables.pop("retreat_speed", 0.0)
    return State(**variables, retreat_speed=u, heavy_speed=u, slack=0.0)


def kinematics(xp: Any, mode: Mode, t: Any, y: State, signs: Signs) -> Kinematics:
    """What the effects may depend on, with absolute values written through their signs."""
    across_size = signs.across * y.across_speed
    if mode.sliding:
        heavy_size = signs.slide * y.heavy_speed
    elif mode.slack:
        heavy_size = signs.heavy * y.heavy_speed
    else:
        heavy_size = 0.0
    moving_along = mode.sliding or mode.slack
    speed = xp.sqrt(y.retreat_speed * y.retreat_speed + y.across_speed * y.across_speed) if moving_along else across_size
    return Kinematics(
        time=t,
        free_length=y.free_length,
        wrap_angle=y.wrap_angle,
        retreat_speed=y.retreat_speed,
        across_speed=y.across_speed,
        across_speed_size=across_size,
        light_speed=speed,
        heavy_speed=y.heavy_speed,
        heavy_speed_size=heavy_size,
    )


class _Balance(NamedTuple):
    """Forces of one instant."""

    pull: Any
    """Tension that would hold the light mass at u' = 0: M1 w theta' - F_along [N]."""
    across: Any
    """F_across [N]."""
    heavy: Any
    """F_heavy [N]."""
    ratio: Any
    """T2 / T1 while sliding."""
    holding: Any
    """Largest T2 / T1 that the rod can hold."""


def _balance(xp: Any, mode: Mode, t: Any, y: State, signs: Signs, p: Any, effects: Effects) -> _Balance:
    k = kinematics(xp, mode, t, y, signs)
    along, across = forces.light_force(xp, k, p, effects)
    heavy = forces.heavy_force(xp, k, p, effects)
    pull = p.light_mass * y.across_speed * (y.across_speed / y.free_length) - along
    ratio = xp.exp(-signs.slide * forces.sliding_exponent(xp, k, p, effects)) if mode.sliding else None
    holding = xp.exp(forces.holding_exponent(xp, k, p, effects)) if mode is Mode.STICKING else None
    return _Balance(pull, across, heavy, ratio, holding)


def _sliding_drive(b: _Balance) -> Any:
    """(M2 + M1 T2/T1) u' [N]: what accelerates both masses along the string."""
    return b.ratio * b.pull + b.heavy


def rates(xp: Any, mode: Mode, t: Any, y: State, signs: Signs, p: Any, effects: Effects) -> State:
    """Derivatives of the state by time."""
    b = _balance(xp, mode, t, y, signs, p, effects)
    u, w = y.retreat_speed, y.across_speed
    turning = w / y.free_length
    if mode.sliding:
        u_rate = heavy_rate = _sliding_drive(b) / (p.heavy_mass + p.light_mass * b.ratio)
    elif mode.slack:
        u_rate = b.pull / p.light_mass
        heavy_rate = 0.0 if mode is Mode.CLAMPED_SLACK else b.heavy / p.heavy_mass
    else:
        u_rate = heavy_rate = 0.0
    return State(
        free_length=u - p.rod_radius * turning,
        wrap_angle=turning,
        retreat_speed=u_rate,
        across_speed=b.across / p.light_mass - u * turning,
        heavy_speed=heavy_rate,
        slack=y.heavy_speed - u,
    )


def tensions(xp: Any, mode: Mode, t: Any, y: State, signs: Signs, p: Any, effects: Effects) -> tuple[Any, Any]:
    """Tension in the free string and above the heavy mass, (T1, T2) [N]; a clamped heavy mass counts as hanging by it."""
    b = _balance(xp, mode, t, y, signs, p, effects)
    if mode.slack:
        return 0.0 * b.pull, 0.0 * b.pull
    u_rate = _sliding_drive(b) / (p.heavy_mass + p.light_mass * b.ratio) if mode.sliding else 0.0
    return b.pull - p.light_mass * u_rate, p.heavy_mass * u_rate - b.heavy


def holding_margins(xp: Any, t: Any, y: State, signs: Signs, p: Any, effects: Effects) -> tuple[Any, Any]:
    """How far the rod is from letting a resting string slide (down, up), as tensions [N]; below zero it slides.

    With T1 taken at u = u' = 0, the string rests while T1 / H <= T2 <= T1 H, H the largest tension ratio the rod can hold.
    """
    b = _balance(xp, Mode.STICKING, t, y, signs, p, effects)
    return b.pull * b.holding + b.heavy, -b.heavy * b.holding - b.pull


def event_functions(xp: Any, mode: Mode, t: Any, y: State, signs: Signs, p: Any, effects: Effects) -> dict[Event, Any]:
    """What is watched in ``mode``: each event happens where its function falls through zero."""
    length = y.free_length
    watched = {Event.LIGHT_REACHES_ROD: length - p.end_length, Event.ACROSS_REVERSES: signs.across * y.across_speed}
    if mode is Mode.FALLING:
        return watched
    b = _balance(xp, mode, t, y, signs, p, effects)
    hanging = p.string_length - length - p.rod_radius * y.wrap_angle - y.slack
    watched[Event.UNWRAPPED] = y.wrap_angle
    if mode.sliding:
        watched[Event.HEAVY_REACHES_ROD] = hanging
        drive = signs.slide * _sliding_drive(b) + NUDGE
        watched[Event.STOP] = signs.phase * signs.slide * y.retreat_speed + (1.0 - signs.phase) * drive
        watched[Event.LOSES_TENSION] = p.heavy_mass * b.pull - p.light_mass * b.heavy
    elif mode is Mode.STICKING:
        watched[Event.BREAKS_DOWN], watched[Event.BREAKS_UP] = holding_margins(xp, t, y, signs, p, effects)
    elif mode is Mode.CLAMPED:
        watched[Event.LOSES_TENSION] = b.pull
    else:
        closing = y.heavy_speed - y.retreat_speed + NUDGE
        watched[Event.TAUT] = signs.phase * y.slack + (1.0 - signs.phase) * closing
        if mode is Mode.SLACK:
            watched[Event.HEAVY_REACHES_ROD] = hanging
            watched[Event.HEAVY_REVERSES] = signs.heavy * y.heavy_speed
    return watched


def retaut_speed(xp: Any, slide: float, t: Any, y: State, signs: Signs, p: Any, effects: Effects) -> Any:
    """Common speed along the string after an inelastic pull with the string sliding by ``slide`` (+1 up, -1 down) [m/s].

    The impulses on the two sides obey the capstan law too, J2 = J1 exp(-slide X), so that
    u = (M2 u2 + E M1 u1) / (M2 + E M1), E = exp(-slide X).
    """
    k = kinematics(xp, Mode.SLACK, t, y, signs)
    ratio = xp.exp(-slide * forces.sliding_exponent(xp, k, p, effects))
    momentum = p.heavy_mass * y.heavy_speed + ratio * p.light_mass * y.retreat_speed
    return momentum / (p.heavy_mass + ratio * p.light_mass)
