"""The state of a run, which of its entries each mode and effect moves, and what the effects see of it.

Paper's l and theta, but speeds chosen so that each mode is simple: free length l, wrap angle theta, u = l' + R theta' (the
light mass's speed away from the rod along the string; the heavy mass's upward speed while taut), w = l theta'.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any, NamedTuple

from looping_pendulum.reference_ode.effects.properties import REST_SPEED
from looping_pendulum.reference_ode.effects.types import TURN, Effect, Kinematics
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.transitions import PHASE_ZERO, Event, Mode

Effects = tuple[Effect, ...]


class State(NamedTuple):
    """State of a run, or its rate of change. SI. Entries with a default belong to one effect each and are 0 without it."""

    free_length: Any
    wrap_angle: Any
    retreat_speed: Any
    """u: of the light mass, along the string, away from the rod [m/s]."""
    across_speed: Any
    """w = l theta' [m/s]."""
    heavy_speed: Any
    """Upward speed of the heavy mass [m/s], along its string if it swings; equal to u while taut (in the plane)."""
    slack: Any
    """String length beyond the shortest path over the rod [m]; 0 while taut."""
    heavy_tilt: Any = 0.0
    """Angle of the heavy mass's string to the vertical [rad]."""
    heavy_across_speed: Any = 0.0
    """Speed of the heavy mass across its string [m/s]."""
    sideways: Any = 0.0
    """Place of the light mass along the rod [m]."""
    sideways_speed: Any = 0.0
    rod_speed: Any = 0.0
    """Speed of the rod's surface towards the light side [m/s]."""
    light_stretch: Any = 0.0
    """Of the string on the light side of the rod [m]."""
    heavy_stretch: Any = 0.0


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
    overlap: Any = 0.0
    """1 beyond the first full turn, where the string lies on itself."""
    rod: Any = 0.0
    """Sign of the rod's speed; 0: its bearing holds it."""
    rod_phase: Any = 0.0
    """As `phase`, for the rod: 0: wait for ROD_SLOWS; 1: watch for its return to rest."""


def meaning(event: Event, signs: Signs) -> Event:
    """What ``event`` stands for in the phase that it happens in."""
    if event in (Event.ROD_CHANGES, Event.ROD_STOPS):
        return Event.ROD_SLOWS if signs.rod and signs.rod_phase == 0 else event
    return PHASE_ZERO.get(event, event) if signs.phase == 0 else event


_RETREAT_SPEED, _HEAVY_SPEED = State._fields.index("retreat_speed"), State._fields.index("heavy_speed")
_BASE = State._fields[: State._fields.index("slack") + 1]
_RESTING: tuple[str, ...] = ("free_length", "wrap_angle", "across_speed")
_MOVING: tuple[str, ...] = ("free_length", "wrap_angle", "retreat_speed", "across_speed")


@lru_cache(maxsize=256)
def own_variables(effects: Effects) -> frozenset[str]:
    """Entries of the state that only these effects move."""
    return frozenset(name for effect in effects for name in effect.variables)


@lru_cache(maxsize=512)
def variables(mode: Mode, effects: Effects) -> tuple[str, ...]:
    """Which entries of the state change in ``mode``; the others are zero, or the heavy speed that follows u."""
    own = own_variables(effects)
    names = set(_BASE if mode.slack else _MOVING if mode.string_moves else _RESTING) | own
    if "sideways" in own:  # then a string of fixed length still lets u change
        names |= {"retreat_speed", "heavy_speed"} if mode.string_moves else {"retreat_speed"}
    if "light_stretch" in own:  # then its two ends move apart from each other
        names |= set(_BASE)
    return tuple(name for name in State._fields if name in names)


def complete(mode: Mode, **values: Any) -> State:
    """Fill in the entries of the state that a mode implies."""
    values.setdefault("retreat_speed", 0.0)
    values.setdefault("heavy_speed", values["retreat_speed"] if mode.string_moves else 0.0)
    values.setdefault("slack", 0.0)
    return State(**values)


def follow(mode: Mode, names: tuple[str, ...], full: Array) -> None:
    """Let the heavy speed be u, in an array of states (..., len(State), any), where it follows from it."""
    if mode.string_moves and "heavy_speed" not in names:
        full[..., _HEAVY_SPEED, :] = full[..., _RETREAT_SPEED, :]


class Winding(NamedTuple):
    """Shape of the rod with what is wound on it, where the string leaves."""

    radius: Any
    """Distance of the string's line from the rod's axis [m]."""
    foot: Any
    """From the foot of the axis on that line to the place where the string leaves [m]."""
    path: Any
    """String from the top of the rod to the light mass, in the plane [m]."""


@lru_cache(maxsize=256)
def winds(effects: Effects) -> bool:
    """Whether the string makes the rod thicker as it winds."""
    return any(effect.winding is not None for effect in effects)


def winding(y: State, overlap: Any, p: Any, effects: Effects) -> Winding:
    """Shape of what is wound on the rod; ``overlap``: 1 beyond the first turn, else 0."""
    radius, foot, path = p.rod_radius, 0.0, y.free_length + p.rod_radius * y.wrap_angle
    for effect in effects if winds(effects) else ():
        if effect.winding is not None:
            growth, slope, more = effect.winding(overlap * (y.wrap_angle - TURN), p)
            radius, foot, path = radius + growth, foot + overlap * slope, path + more + overlap * slope
    return Winding(radius, foot, path)


def string_path(xp: Any, y: State, overlap: Any, p: Any, effects: Effects) -> Any:
    """String from the top of the rod to the light mass [m]."""
    path = winding(y, overlap, p, effects).path
    return xp.sqrt(path * path + y.sideways * y.sideways) if "sideways" in own_variables(effects) else path


def heavy_drop(xp: Any, y: State, overlap: Any, p: Any, effects: Effects) -> Any:
    """How far the heavy mass is below its release [m]: what the light side has lost of the string, slack included."""
    path = string_path(xp, y, overlap, p, effects) + y.slack
    return p.free_length + p.rod_radius * p.release_angle - path


def kinematics(xp: Any, mode: Mode, t: Any, y: State, signs: Signs, p: Any, effects: Effects) -> Kinematics:
    """What the effects may depend on, with absolute values written through their signs."""
    own = own_variables(effects)
    across_size = signs.across * y.across_speed
    if mode.sliding:
        heavy_size = signs.slide * y.heavy_speed
    elif mode.slack:
        heavy_size = signs.heavy * y.heavy_speed
    elif mode is Mode.ROLLING:
        heavy_size = signs.rod * y.heavy_speed
    else:
        heavy_size = 0.0
    square = y.retreat_speed * y.retreat_speed + y.across_speed * y.across_speed
    if "sideways" in own:
        square = square + y.sideways_speed * y.sideways_speed
    along_moves = mode.string_moves or mode.slack or "sideways" in own or "light_stretch" in own
    speed = xp.sqrt(square) if along_moves else across_size
    if "light_stretch" in own:
        heavy_size = xp.sqrt(y.heavy_speed * y.heavy_speed + REST_SPEED * REST_SPEED)
    k = Kinematics(
        time=t,
        free_length=y.free_length,
        wrap_angle=y.wrap_angle,
        retreat_speed=y.retreat_speed,
        across_speed=y.across_speed,
        across_speed_size=across_size,
        light_mass_speed=speed,
        heavy_speed=y.heavy_speed,
        heavy_speed_size=heavy_size,
        overlap=signs.overlap,
    )
    return _of_own_variables(xp, mode, y, signs, p, effects, k) if own or _needs_hanging(effects) else k


@lru_cache(maxsize=256)
def _needs_hanging(effects: Effects) -> bool:
    return any(effect.inertia_of_heavy_mass is not None for effect in effects)


def _of_own_variables(xp: Any, mode: Mode, y: State, signs: Signs, p: Any, effects: Effects, k: Kinematics) -> Kinematics:
    """Add what only some effects move or read."""
    heavy_size = slip = k.heavy_speed_size
    own = own_variables(effects)
    if "heavy_tilt" in own:
        across = y.heavy_across_speed
        heavy_size = xp.sqrt(y.heavy_speed * y.heavy_speed + across * across + REST_SPEED * REST_SPEED)
    if "rod_speed" in own:
        slip = signs.slide * (y.heavy_speed - y.rod_speed) if mode.sliding else 0.0
        if mode.sliding and "heavy_tilt" not in own:
            heavy_size = xp.sqrt(y.heavy_speed * y.heavy_speed + REST_SPEED * REST_SPEED)
    return k._replace(
        heavy_speed_size=heavy_size,
        sliding_speed=slip,
        hanging_length=p.string_length - string_path(xp, y, signs.overlap, p, effects) - y.slack,
        heavy_tilt=y.heavy_tilt,
        heavy_across_speed=y.heavy_across_speed,
        sideways_speed=y.sideways_speed,
    )
