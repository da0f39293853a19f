"""The state of a run: its variables, which of them each mode and effect moves, and the kinematics that the effects read.

The coordinates are the paper's free length l and wrap angle theta. The speeds are chosen so that the equations of each mode are
simple: u = l' + R theta', the speed of the light mass away from the rod along the string, which is also the upward speed of the
heavy mass while the string is taut; and w = l theta', the speed of the light mass across the string.
"""

from __future__ import annotations

from functools import lru_cache
from types import SimpleNamespace
from typing import Any, NamedTuple

from looping_pendulum.reference_ode.effects.library import REST_SPEED
from looping_pendulum.reference_ode.effects.types import TURN, Effect, Kinematics
from looping_pendulum.reference_ode.transitions import PHASE_ZERO, Event, Mode

Effects = tuple[Effect, ...]


class State(NamedTuple):
    """State of a run, or its derivative by time. SI. Entries with a default belong to one effect each and are 0 without it."""

    free_length: Any
    wrap_angle: Any
    retreat_speed: Any
    """u, speed of the light mass along the string, away from the rod [m/s]."""
    across_speed: Any
    """w = l theta', speed of the light mass across the string [m/s]."""
    heavy_speed: Any
    """Upward speed of the heavy mass [m/s], along its string if it swings; equal to u while taut (in the plane)."""
    slack: Any
    """String length beyond the shortest path over the rod [m]; 0 while taut."""
    heavy_tilt: Any = 0.0
    """Angle of the heavy mass's string to the vertical [rad]."""
    heavy_across_speed: Any = 0.0
    """Speed of the heavy mass across its string [m/s]."""
    sideways: Any = 0.0
    """Coordinate z of the light mass along the rod [m]."""
    sideways_speed: Any = 0.0
    """z' [m/s]."""
    rod_speed: Any = 0.0
    """Speed of the rod's surface towards the light side [m/s]."""
    light_stretch: Any = 0.0
    """Stretch of the string on the light side of the rod [m]."""
    heavy_stretch: Any = 0.0
    """Stretch of the string on the heavy side of the rod [m]."""


class Signs(NamedTuple):
    """Piecewise constants that keep the equations analytic between events: |x| is written as the sign of x times x."""

    slide: Any
    """+1 sliding up, -1 sliding down."""
    across: Any
    """Sign of w; 0: the friction of the pivot holds the light mass at rest."""
    heavy: Any
    """Sign of the heavy mass's speed while slack."""
    phase: Any
    """0: speed or slack leaves zero, and its turning back is watched for (SLOWS, CLOSES); 1: its return to zero (STOP, TAUT).

    The function of a return is zero where it starts, so it is watched for only once it can fall through zero again.
    """
    overlap: Any = 0.0
    """1 beyond the first full turn, where the string lies on itself."""
    rod: Any = 0.0
    """Sign of the rod's speed; 0: its bearing holds it."""
    rod_phase: Any = 0.0
    """The same as `phase`, for the speed of the rod: 0: ROD_SLOWS is watched for; 1: its return to rest is."""


class Motion(NamedTuple):
    """A run at one instant: all that the equations need beside the parameters."""

    mode: Any
    """`Mode`, or an expression that chooses between modes."""
    t: Any
    """Time since release [s]."""
    y: State
    signs: Signs


# Still a normal number (they end at 2e-308), and lost beside any real speed
TINY_SPEED = 1e-300
"""Speed that stands for zero with a sign [m/s]: the event function of the speed then starts beyond the root just handled."""


def event_in_phase(event: Event, signs: Signs) -> Event:
    """Return the event that the function of ``event`` announces in the present phase: in phase 0 it is the turning back."""
    if event in (Event.ROD_CHANGES, Event.ROD_STOPS):
        return Event.ROD_SLOWS if signs.rod and signs.rod_phase == 0 else event
    return PHASE_ZERO.get(event, event) if signs.phase == 0 else event


# Entries of the state that change while the string is slack, while a taut string rests, and while it moves
_BASE = State._fields[: State._fields.index("slack") + 1]
_RESTING: tuple[str, ...] = ("free_length", "wrap_angle", "across_speed")
_MOVING: tuple[str, ...] = ("free_length", "wrap_angle", "retreat_speed", "across_speed")


@lru_cache(maxsize=256)
def extra_variables(effects: Effects) -> frozenset[str]:
    """Return the entries of the state that these effects add."""
    return frozenset(name for effect in effects for name in effect.variables)


@lru_cache(maxsize=512)
def variables(mode: Mode, effects: Effects) -> tuple[str, ...]:
    """Return the entries of the state that are integrated in ``mode``; the others are 0, or the heavy speed, which equals u."""
    own = extra_variables(effects)
    names = set(_BASE if mode.slack else _MOVING if mode.string_moves else _RESTING) | own
    if "sideways" in own:  # motion along the rod lets u change even where the string is held
        names |= {"retreat_speed", "heavy_speed"} if mode.string_moves else {"retreat_speed"}
    if "light_stretch" in own:  # the two ends of the string then move independently
        names |= set(_BASE)
    return tuple(name for name in State._fields if name in names)


def full_state(mode: Mode, **values: Any) -> State:
    """Return the whole state from the entries that are integrated in ``mode``."""
    values.setdefault("retreat_speed", 0.0)
    values.setdefault("heavy_speed", values["retreat_speed"] if mode.string_moves else 0.0)
    values.setdefault("slack", 0.0)
    return State(**values)


class Winding(NamedTuple):
    """Geometry of the wound rod at the place where the string leaves it."""

    radius: Any
    """Distance of the string's line from the rod's axis [m]."""
    foot: Any
    """Distance along that line from the point nearest the axis to the place where the string leaves [m]."""
    path: Any
    """Length of string from the top of the rod to the light mass, in the plane [m]."""


@lru_cache(maxsize=256)
def string_has_thickness(effects: Effects) -> bool:
    """Return whether the string makes the rod thicker as it winds."""
    return any(effect.winding is not None for effect in effects)


def winding(y: State, overlap: Any, p: SimpleNamespace, effects: Effects) -> Winding:
    """Return the geometry of the wound rod; ``overlap``: 1 beyond the first turn, else 0."""
    radius, foot, path = p.rod_radius, 0.0, y.free_length + p.rod_radius * y.wrap_angle
    for effect in effects if string_has_thickness(effects) else ():
        if effect.winding is not None:
            growth, slope, integral = effect.winding(overlap * (y.wrap_angle - TURN), p)
            radius, foot, path = radius + growth, foot + overlap * slope, path + integral + overlap * slope
    return Winding(radius, foot, path)


def string_path(xp: Any, y: State, overlap: Any, p: SimpleNamespace, effects: Effects) -> Any:
    """Return the length of string from the top of the rod to the light mass, which may be out of the plane [m]."""
    path = winding(y, overlap, p, effects).path
    return xp.sqrt(path * path + y.sideways * y.sideways) if "sideways" in extra_variables(effects) else path


def heavy_drop(xp: Any, y: State, overlap: Any, p: SimpleNamespace, effects: Effects) -> Any:
    """Return how far the heavy mass is below its release [m]: the length that the light side has lost, slack included."""
    path = string_path(xp, y, overlap, p, effects) + y.slack
    return p.free_length + p.rod_radius * p.release_angle - path


def kinematics(xp: Any, mode: Mode, t: Any, y: State, signs: Signs, p: SimpleNamespace, effects: Effects) -> Kinematics:
    """Return what the effects may depend on, with absolute values written as a sign times a value."""
    own = extra_variables(effects)
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
    # Where only the speed across the string differs from zero, its size needs no root, which is not analytic at 0
    along_moves = mode.string_moves or mode.slack or "sideways" in own or "light_stretch" in own
    speed = xp.sqrt(square) if along_moves else across_size
    if "light_stretch" in own:  # no event marks its change of sign, so |u2| is rounded off at 0
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
        across_sign=signs.across,
        taut=0.0 if mode.slack else 1.0,
    )
    return _with_extra_variables(xp, mode, y, signs, p, effects, k) if own or _needs_hanging_length(effects) else k


@lru_cache(maxsize=256)
def _needs_hanging_length(effects: Effects) -> bool:
    """Return whether an effect reads the length of string on the heavy side."""
    return any(effect.inertia_of_heavy_mass is not None for effect in effects)


def _with_extra_variables(
    xp: Any, mode: Mode, y: State, signs: Signs, p: SimpleNamespace, effects: Effects, k: Kinematics
) -> Kinematics:
    """Return ``k`` with the quantities that only some effects read."""
    heavy_size = slip_speed = k.heavy_speed_size
    own = extra_variables(effects)
    if "heavy_tilt" in own:
        across = y.heavy_across_speed
        # A swinging mass has a velocity of two components, so that no sign makes a size of it
        heavy_size = xp.sqrt(y.heavy_speed * y.heavy_speed + across * across + REST_SPEED * REST_SPEED)
    if "rod_speed" in own:
        slip_speed = signs.slide * (y.heavy_speed - y.rod_speed) if mode.sliding else 0.0
        # ``slide`` is the direction relative to the rod's surface; the heavy mass itself may reverse without an event
        if mode.sliding and "heavy_tilt" not in own:
            heavy_size = xp.sqrt(y.heavy_speed * y.heavy_speed + REST_SPEED * REST_SPEED)
    return k._replace(
        heavy_speed_size=heavy_size,
        sliding_speed=slip_speed,
        hanging_length=p.string_length - string_path(xp, y, signs.overlap, p, effects) - y.slack,
        heavy_tilt=y.heavy_tilt,
        heavy_across_speed=y.heavy_across_speed,
        sideways_speed=y.sideways_speed,
    )
