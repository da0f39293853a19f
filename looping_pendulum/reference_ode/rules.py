"""Rules of transition: what the release and each event do to mode, state and signs; which mode follows.

Each rule is a pure function from one `Motion` to the next and asks for the equations through `HybridSystem`. It decides by
``system.where`` and ``system.choose``, so that numbers and expressions follow the same lines. Only what is the same for all
runs of a model, such as the event, the mode in which it happens and the effects, is decided by ``if``.

Comparisons with 0 are of three kinds. Coefficients are as given, and signs and the speeds of what rests (or `TINY_SPEED`) were
assigned, so these comparisons are exact. Tensions and margins are computed and have tolerances (`RELATIVE_TENSION_TOLERANCE`,
`MARGIN_TOLERANCE`, `equations.FRICTION_CONE_TOLERANCE`). Other computed numbers are far from 0, except where an event is only
grazed; there both of the possible modes are right to rounding.
"""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

from looping_pendulum.reference_ode.equations import Equations, Impact
from looping_pendulum.reference_ode.parameters import Parameters, Release
from looping_pendulum.reference_ode.state import TINY_SPEED, Effects, Motion, Signs, State, winding
from looping_pendulum.reference_ode.transitions import Event, Mode, TransitionChoice, next_mode

REST_SERIES_DURATION = 1e-6
"""Length of the step by which a run leaves rest [s]: |v| is not analytic at v = 0, so a series of second order takes it.

The next term of the series is of order REST_SERIES_DURATION^3.
"""
# 1e-8 of the weight of a 10 g mass
MARGIN_TOLERANCE = 1e-9
"""Margin within which a tension is on the edge of the friction cone where a string that stretches comes to rest [N]."""
RELATIVE_TENSION_TOLERANCE = 1e-14
"""Tension at release, as a fraction of the light mass's weight, that is zero but for rounding (-6e-17 at 90 deg)."""


class HybridSystem:
    """The equations of one run over numbers, as the rules ask them; `core.trace.SymbolicSystem` answers with expressions."""

    def __init__(self, equations: Equations) -> None:
        self.equations, self.p, self.effects = equations, equations.p, equations.effects
        self.rod_turns, self.string_stretches = equations.rod_turns, equations.string_stretches
        self.leaves_plane, self.heavy_mass_swings = equations.leaves_plane, equations.heavy_mass_swings
        self.pivot_holds = equations.pivot_holds

    def where(self, condition: Any, a: Any, b: Any) -> Any:
        """Return the number ``a`` where ``condition`` holds, else ``b``."""
        return a if condition else b

    def choose(self, condition: Any, a: Motion, b: Motion) -> Motion:
        """Return the motion ``a`` where ``condition`` holds, else ``b``."""
        return a if condition else b

    def rates(self, m: Motion) -> State:
        """Return the derivatives of the state by time."""
        return self.equations.rates(*m)

    def tensions(self, m: Motion) -> tuple[Any, Any]:
        """Return the tensions in the free string and above the heavy mass [N]."""
        return self.equations.tensions(*m)

    def holding_margins(self, m: Motion) -> tuple[Any, Any]:
        """Return by how much the tensions are inside the friction cone, (down, up) [N]."""
        return self.equations.holding_margins(*m)

    def impact(self, slide: float, m: Motion) -> Impact:
        """Return the result of an inelastic impulse along the string; arguments as of `Equations.impact`."""
        return self.equations.impact(slide, m.t, m.y, m.signs)


def system_of_floats(p: SimpleNamespace, effects: Effects) -> HybridSystem:
    """Return the system of a run whose numbers are floats."""
    return HybridSystem(Equations(math, p, effects))


def state_at_release(start: Parameters) -> State:
    """Return the state at release, before a push along the string has acted on the heavy mass."""
    c = start.coefficients
    y = State(start.free_length, start.release_angle, c["push_along"], c["push_across"], 0.0, 0.0)
    if start.release is Release.DROP:
        return y
    return y._replace(heavy_tilt=c["heavy_swing"], sideways_speed=c["push_sideways"])


def release(system: HybridSystem, kind: Release, y: State) -> Motion:
    """Return the motion just after a release with the state ``y``.

    A push away from the rod acts on both masses, as when a slack string becomes taut; one towards it leaves the string slack.
    """
    across = system.where(y.across_speed < 0, -1.0, 1.0)
    m = Motion(Mode.FALLING, 0.0, y, Signs(slide=-1.0, across=across, heavy=-1.0, phase=0.0))
    held = kind is Release.HELD
    if kind is Release.DROP:
        return m
    if system.string_stretches:
        y = system.equations.with_stretch_at_rest(m.t, m.y, m.signs)
        # What the clamp holds does not stretch
        return (
            m._replace(mode=Mode.CLAMPED, y=y._replace(heavy_stretch=0.0)) if held else m._replace(mode=Mode.SLIDING_DOWN, y=y)
        )
    push = y.retreat_speed
    slack = m._replace(mode=Mode.CLAMPED_SLACK if held else Mode.SLACK)
    if held:
        taut = m._replace(mode=Mode.CLAMPED, y=y._replace(retreat_speed=system.where(push < 0, push, 0.0)))
    else:
        taut = system.choose(push > 0, slide_or_stick_after_impulse(system, m), stick_or_slide(system, m))
    taut = begin_sliding(system, taut)
    # If the light mass does not move backwards the tension grows, so that a tension of zero, but for rounding, is the edge of a
    # taut string. Taken for slack it would never become taut, as its slack neither opens nor closes.
    weight = system.p.light_mass * system.p.gravity
    least = system.where(y.across_speed >= 0, -RELATIVE_TENSION_TOLERANCE * weight, 0.0)
    pulls = system.tensions(taut)[0] >= least
    return system.choose(push < 0, slack, system.choose(pulls, taut, taut._replace(mode=slack.mode)))


def leave_rest(system: HybridSystem, m: Motion) -> tuple[Motion, tuple[State, State, State], Any]:
    """Take the first `REST_SERIES_DURATION` by a series where the light mass starts at rest, where |v| is not analytic.

    Returns
    -------
    after
        The motion after that, or ``m`` with the sign of the light mass's speed where no series is needed.
    series
        State after `REST_SERIES_DURATION` as the terms of the series: constant, linear and square.
    by_series
        Whether it was taken.
    """
    y = m.y
    across_at_rest = y.across_speed == 0
    if system.pivot_holds:
        across = system.where(across_at_rest, _sign_from_rest(system, m), m.signs.across)
        rate = system.rates(m._replace(signs=m.signs._replace(across=across)))
    else:
        rate = system.rates(m)
        across = system.where(across_at_rest, system.where(rate.across_speed >= 0, 1.0, -1.0), m.signs.across)
    at_rest = across_at_rest & (y.retreat_speed == 0) & (y.sideways_speed == 0)
    # In the other modes only the speed across the string leaves zero, and its size is its sign times itself
    by_series = at_rest & (_is_one_of(m.mode, STRING_MOVES + SLACK) | system.string_stretches)
    # Speeds grow linearly from rest, so that what they move has these second derivatives
    turning = rate.across_speed / y.free_length
    second_derivatives = State(
        free_length=rate.retreat_speed - system.p.rod_radius * turning,
        wrap_angle=turning,
        retreat_speed=0.0,
        across_speed=0.0,
        heavy_speed=0.0,
        slack=rate.heavy_speed - rate.retreat_speed,
        heavy_tilt=rate.heavy_across_speed / system.p.hanging_length if system.heavy_mass_swings else 0.0,
    )
    linear = State(*(REST_SERIES_DURATION * r for r in rate))
    square = State(*(0.5 * REST_SERIES_DURATION**2 * r for r in second_derivatives))
    series = y, linear, square
    signs = m.signs._replace(across=across)
    gone = m._replace(t=REST_SERIES_DURATION, y=State(*(a + b + c for a, b, c in zip(*series, strict=True))), signs=signs)
    signed = system.where(across_at_rest, y.across_speed + TINY_SPEED * across, y.across_speed)
    return system.choose(by_series, gone, m._replace(y=y._replace(across_speed=signed), signs=signs)), series, by_series


def _sign_from_rest(system: HybridSystem, m: Motion) -> Any:
    """Return the sign of the speed that the light mass takes up across its string; 0 if the pivot's friction holds it."""
    y = m.y._replace(across_speed=0.0 * m.y.across_speed)
    # Friction acts against the speed, so that the mass moves to a side only if the force beats the friction of that side
    up, down = (system.rates(m._replace(y=y, signs=m.signs._replace(across=sign))).across_speed for sign in (1.0, -1.0))
    return system.where(up > 0, 1.0, system.where(down < 0, -1.0, 0.0))


def turning_back_reverses(system: HybridSystem, mode: Mode) -> bool:
    """Return whether a light mass that has come to rest across its string always moves back; else the pivot may hold it."""
    return not (system.pivot_holds and mode is Mode.CLAMPED)


def across_after_turn(system: HybridSystem, mode: Mode, m: Motion) -> Any:
    """Return the sign of the light mass's speed across its string after a turning point; 0 if the pivot holds it."""
    return -1.0 * m.signs.across if turning_back_reverses(system, mode) else _sign_from_rest(system, m)


def apply_event(system: HybridSystem, mode: Mode, event: Event, m: Motion) -> Motion:
    """Return the motion after ``event``, at which the run, or all runs, arrived in ``mode``."""
    following = next_mode(mode, event)
    if following is Mode.ENDED:
        return m._replace(mode=Mode.ENDED)
    if event is Event.ACROSS_REVERSES:
        across = across_after_turn(system, mode, m)
        return m._replace(signs=m.signs._replace(across=across), y=m.y._replace(across_speed=TINY_SPEED * across))
    if event is Event.HEAVY_REVERSES:
        heavy = -1.0 * m.signs.heavy
        return m._replace(signs=m.signs._replace(heavy=heavy), y=m.y._replace(heavy_speed=TINY_SPEED * heavy))
    if event in (Event.SLOWS, Event.CLOSES):
        return m._replace(signs=m.signs._replace(phase=1.0))
    if event is Event.ROD_SLOWS:
        return m._replace(signs=m.signs._replace(rod_phase=1.0))
    if event is Event.FIRST_TURN:
        return _cross_first_turn(system, m)
    if event is Event.ROD_CHANGES:  # it begins or ceases to turn under a string that slides or is slack
        return system.choose(m.signs.rod == 0, _begin_to_turn(m, m.signs.slide), _turn_if_not_held(system, m))
    return _change_mode(system, mode, event, following, m)


def _change_mode(system: HybridSystem, mode: Mode, event: Event, following: Mode | TransitionChoice, m: Motion) -> Motion:
    """Set the speeds that ``event`` sets, and enter the mode that follows."""
    if system.string_stretches:
        if event is Event.TAUT and mode is Mode.SLACK:
            m = m._replace(y=system.equations.with_even_stretch(m.y, m.signs))
    elif event is Event.STOP:
        m = _with_string_speed(system, m, m.y.rod_speed if system.rod_turns else 0.0)
    elif event is Event.ROD_STOPS:
        m = _with_string_speed(system, m, 0.0)
        m = m._replace(y=m.y._replace(rod_speed=0.0))
    elif event in (Event.ROD_YIELDS_UP, Event.ROD_YIELDS_DOWN):
        m = _begin_to_turn(m, 1.0 if event is Event.ROD_YIELDS_UP else -1.0)
    elif event is Event.TAUT and mode is Mode.CLAMPED_SLACK:
        m = _after(system, system.impact(0.0, m), m)
    if isinstance(following, Mode):
        m = m._replace(mode=following)
    elif following is TransitionChoice.BY_HOLDING or system.string_stretches:
        m = stick_or_slide(system, m)
    else:
        m = slide_or_stick_after_impulse(system, m)
    m = enter(system, m)
    if system.pivot_holds and event is Event.LOSES_TENSION:  # a slack string does not hold the light mass
        m = m._replace(signs=m.signs._replace(across=system.where(m.signs.across == 0, 1.0, m.signs.across)))
    if event is Event.TAUT and not system.string_stretches:
        # Other forces may still push the ends of the string together: then it is slack again at once
        loose = m._replace(mode=Mode.CLAMPED_SLACK if mode is Mode.CLAMPED_SLACK else Mode.SLACK)
        m = system.choose(system.tensions(m)[0] < 0, enter(system, loose), m)
    return m


def _cross_first_turn(system: HybridSystem, m: Motion) -> Motion:
    """Change the overlap at a full turn, where the place at which the string leaves the rod jumps.

    The free length changes by as much, so that the light mass stays where it is.
    """
    overlap = 1.0 - m.signs.overlap
    feet = [winding(m.y, beyond, system.p, system.effects).foot for beyond in (m.signs.overlap, overlap)]
    return m._replace(signs=m.signs._replace(overlap=overlap), y=m.y._replace(free_length=m.y.free_length + feet[0] - feet[1]))


def _with_string_speed(system: HybridSystem, m: Motion, speed: Any) -> Motion:
    """Give the heavy mass, and the string with it, exactly ``speed`` [m/s]: a root is found only to rounding."""
    retreat = m.y.retreat_speed if system.leaves_plane else speed
    return m._replace(y=m.y._replace(heavy_speed=speed, retreat_speed=retreat))


def stick_or_slide(system: HybridSystem, m: Motion) -> Motion:
    """Return the motion of a string that does not slide now: it sticks if the rod holds it, else begins to slide."""
    if system.rod_turns:
        rolling = m._replace(mode=Mode.ROLLING)
        return system.choose(m.y.rod_speed == 0, _stick_roll_or_slide(system, m), _hold_or_slide(system, rolling))
    # A string that stretches slows down onto the edge of the friction cone, where a margin is 0 but for rounding
    least = -MARGIN_TOLERANCE if system.string_stretches else 0.0
    return _hold_or_slide(system, m._replace(mode=Mode.STICKING), least)


def _hold_or_slide(system: HybridSystem, m: Motion, least: float = 0.0) -> Motion:
    """Return ``m``, in which the string sticks or rolls, if both margins are at least ``least`` [N]; else the string slides."""
    down, up = system.holding_margins(m)
    holds_or_rises = system.where(up < least, Mode.SLIDING_UP, m.mode)
    return m._replace(mode=system.where(down < least, Mode.SLIDING_DOWN, holds_or_rises))


def _stick_roll_or_slide(system: HybridSystem, m: Motion) -> Motion:
    """Return the motion of a string that does not slide, on a rod at rest: it sticks, rolls with the rod or slides on it."""
    sticking = m._replace(mode=Mode.STICKING, signs=m.signs._replace(rod=0.0))
    light, heavy = system.tensions(sticking)
    rolling = _begin_to_turn(sticking, system.where(light < heavy, -1.0, 1.0))._replace(mode=Mode.ROLLING)
    # A string that sticks pulls the rod by T1 - T2, and only the bearing resists
    yields = abs(light - heavy) > system.p.bearing_friction
    after = system.choose(yields, _hold_or_slide(system, rolling), _hold_or_slide(system, sticking))
    return system.choose(_is_one_of(after.mode, SLIDING), _turn_if_not_held(system, after), after)


def _begin_to_turn(m: Motion, sign: Any) -> Motion:
    """Return the motion of a rod that begins to turn, towards the light side if ``sign`` is +1."""
    return m._replace(signs=m.signs._replace(rod=sign, rod_phase=0.0), y=m.y._replace(rod_speed=sign * TINY_SPEED))


def _turn_if_not_held(system: HybridSystem, m: Motion) -> Motion:
    """Return the motion with the rod at rest; it begins to turn if the string slides and rubs harder than its bearing holds."""
    sliding = _is_one_of(m.mode, SLIDING)
    slide = system.where(m.mode == Mode.SLIDING_UP, 1.0, -1.0)
    signs = m.signs._replace(rod=0.0, slide=system.where(sliding, slide, m.signs.slide))
    held = m._replace(y=m.y._replace(rod_speed=0.0), signs=signs)
    light, heavy = system.tensions(held)
    yields = sliding & (slide * (light - heavy) > system.p.bearing_friction)
    return system.choose(yields, _begin_to_turn(held, slide), held)


def slide_or_stick_after_impulse(system: HybridSystem, m: Motion) -> Motion:
    """Return the motion after an inelastic impulse along the string.

    Exactly one of up, down and sticking is consistent; energy falls in each.
    """
    up, down, held = (system.impact(slide, m) for slide in (1.0, -1.0, 0.0))
    sticking = stick_or_slide(system, _after(system, held, m))
    falling = system.choose(down.sliding < 0, _after(system, down, m._replace(mode=Mode.SLIDING_DOWN)), sticking)
    return system.choose(up.sliding > 0, _after(system, up, m._replace(mode=Mode.SLIDING_UP)), falling)


def _after(system: HybridSystem, impact: Impact, m: Motion) -> Motion:
    """Return ``m`` with the state just after an impact, which may have set the rod in motion."""
    m = m._replace(y=impact.state)
    if system.rod_turns:
        speed = m.y.rod_speed
        sign = system.where(speed > 0, 1.0, system.where(speed < 0, -1.0, 0.0))
        m = m._replace(signs=m.signs._replace(rod=sign))
    return m


SLIDING = (Mode.SLIDING_DOWN, Mode.SLIDING_UP)
STRING_MOVES = tuple(mode for mode in Mode if mode.string_moves)
SLACK = tuple(mode for mode in Mode if mode.slack)


def _is_one_of(mode: Any, modes: tuple[Mode, ...]) -> Any:
    """Return whether ``mode`` is one of ``modes``."""
    # By `==` and `|`, as the mode may be a choice between several
    result: Any = mode == modes[0]
    for other in modes[1:]:
        result = result | (mode == other)
    return result


def begin_sliding(system: HybridSystem, m: Motion) -> Motion:
    """Return the motion with the sign and the phase with which a sliding mode begins."""
    sliding = _is_one_of(m.mode, SLIDING)
    # The stop of a string that stretches is watched for at once: its event function has no phases
    resting = False if system.string_stretches else abs(m.y.heavy_speed - m.y.rod_speed) <= TINY_SPEED
    slide = system.where(m.mode == Mode.SLIDING_UP, 1.0, -1.0)
    return m._replace(
        signs=m.signs._replace(
            slide=system.where(sliding, slide, m.signs.slide),
            phase=system.where(sliding, system.where(resting, 0.0, 1.0), m.signs.phase),
        )
    )


def enter(system: HybridSystem, m: Motion) -> Motion:
    """Return the motion with the signs and the phase with which its mode begins."""
    if system.rod_turns:
        turns = abs(m.y.rod_speed) > TINY_SPEED  # so its return to rest is watched for
        m = m._replace(signs=m.signs._replace(rod_phase=system.where(turns, 1.0, m.signs.rod_phase)))
    m = begin_sliding(system, m)
    slack = _is_one_of(m.mode, SLACK)
    falls_from_rest = (m.mode == Mode.SLACK) & (m.y.heavy_speed == 0)
    # Not 0: an event function that starts at exactly 0 would not be seen to fall through it
    heavy_speed = system.where(falls_from_rest, -TINY_SPEED, m.y.heavy_speed)
    y = m.y._replace(heavy_speed=heavy_speed)
    if not system.string_stretches:
        y = y._replace(slack=system.where(slack, 0.0, y.slack))
    heavy = system.where(slack, system.where(heavy_speed > 0, 1.0, -1.0), m.signs.heavy)
    return m._replace(y=y, signs=m.signs._replace(heavy=heavy, phase=system.where(slack, 0.0, m.signs.phase)))
