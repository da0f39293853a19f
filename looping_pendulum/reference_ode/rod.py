"""Rules of transition of a rod that turns in its bearing, for one run: a batch does not support such rods."""

from __future__ import annotations

import math

from looping_pendulum.reference_ode.hybrid_system import HybridSystem
from looping_pendulum.reference_ode.state import TINY_SPEED, Motion
from looping_pendulum.reference_ode.transitions import Event, Mode


def stick_roll_or_slide(system: HybridSystem, m: Motion) -> Motion:
    """Return the motion of a string that does not slide now: it sticks, rolls with the rod or slides on it."""
    at_rest = m.y.rod_speed == 0
    margins = (0.0, 0.0)
    if at_rest:
        m = m._replace(mode=Mode.STICKING, signs=m.signs._replace(rod=0.0))
        light, heavy = system.tensions(m)
        margins = system.holding_margins(m)
        # A string that sticks pulls the rod by T1 - T2, and only the bearing resists
        if abs(light - heavy) > system.p.bearing_friction:
            m = begin_to_turn(m, math.copysign(1.0, light - heavy))
        elif min(margins) >= 0:
            return m
    if m.signs.rod:
        # On a rod that turns, or now begins to, the string may stick and turn with it
        rolling = m._replace(mode=Mode.ROLLING)
        margins = system.holding_margins(rolling)
        if min(margins) >= 0:
            return rolling
    # The string slides. A rod that was at rest turns only if the string's rubbing overcomes its bearing
    m = m._replace(mode=Mode.SLIDING_DOWN if margins[0] < 0 else Mode.SLIDING_UP)
    return turn_if_not_held(system, m._replace(y=m.y._replace(rod_speed=0.0))) if at_rest else m


def begin_to_turn(m: Motion, sign: float) -> Motion:
    """Return the motion of a rod that begins to turn, towards the light side if ``sign`` is +1."""
    return m._replace(signs=m.signs._replace(rod=sign, rod_phase=0.0), y=m.y._replace(rod_speed=sign * TINY_SPEED))


def turn_if_not_held(system: HybridSystem, m: Motion) -> Motion:
    """Return the motion of a rod at rest, which begins to turn if the string rubs it harder than its bearing holds it."""
    m = m._replace(signs=m.signs._replace(rod=0.0))
    if m.mode.sliding:
        slide = 1.0 if m.mode is Mode.SLIDING_UP else -1.0
        m = m._replace(signs=m.signs._replace(slide=slide))
        light, heavy = system.tensions(m)
        if slide * (light - heavy) > system.p.bearing_friction:
            return begin_to_turn(m, slide)
    return m


def apply_phase_event(system: HybridSystem, event: Event, m: Motion) -> Motion:
    """Return the motion after the rod began to slow, or began or ceased to turn under a string that slides or is slack."""
    if event is Event.ROD_SLOWS:
        return m._replace(signs=m.signs._replace(rod_phase=1.0))
    if m.signs.rod:
        return turn_if_not_held(system, m._replace(y=m.y._replace(rod_speed=0.0)))
    return begin_to_turn(m, m.signs.slide)


def with_sign_of_speed(m: Motion) -> Motion:
    """Return the motion with the sign of the rod's speed after an impact."""
    return m._replace(signs=m.signs._replace(rod=math.copysign(1.0, m.y.rod_speed) if m.y.rod_speed else 0.0))


def with_phase(m: Motion) -> Motion:
    """Return the motion with the rod's return to rest watched for if the rod turns."""
    return m._replace(signs=m.signs._replace(rod_phase=1.0)) if abs(m.y.rod_speed) > TINY_SPEED else m
