"""Modes of the motion, the events that end them, and the transition table (mode, event) -> mode."""

from __future__ import annotations

from enum import Enum, IntEnum, StrEnum
from functools import cached_property


class Mode(IntEnum):
    """Set of equations that holds between two events."""

    STICKING = 0
    """The rod holds the string: the heavy mass rests, the light one winds its string on the rod."""
    SLIDING_DOWN = 1
    """The string slides and the heavy mass falls."""
    SLIDING_UP = 2
    """The string slides and the heavy mass rises."""
    SLACK = 3
    """No tension: the light mass flies freely, the heavy one falls freely."""
    CLAMPED = 4
    """A clamp holds the heavy mass, whatever the tension (held release); else as sticking."""
    CLAMPED_SLACK = 5
    """The string of a clamped heavy mass is slack."""
    FALLING = 6
    """No string at all (drop release)."""
    ENDED = 7
    """The run is over: what follows is beyond the model."""
    # After ENDED, though it belongs to the moving modes: files and hashes of sequences contain these numbers
    ROLLING = 8
    """The string sticks to a rod that turns in its bearing."""

    @cached_property
    def sliding(self) -> bool:
        """Whether the string slides over the rod."""
        return self in (Mode.SLIDING_DOWN, Mode.SLIDING_UP)

    @cached_property
    def string_moves(self) -> bool:
        """Whether a taut string moves, over the rod or with it."""
        return self.sliding or self is Mode.ROLLING

    @cached_property
    def slack(self) -> bool:
        """Whether the string carries no tension."""
        return self in (Mode.SLACK, Mode.CLAMPED_SLACK, Mode.FALLING)


class Event(StrEnum):
    """What ends a mode, or a phase of it. Each has a function that falls through zero (`equations.event_functions`)."""

    LIGHT_REACHES_ROD = "light_reaches_rod"
    """The surface of the light mass touches the rod."""
    HEAVY_REACHES_ROD = "heavy_reaches_rod"
    """No string is left between the rod and the heavy mass."""
    UNWRAPPED = "unwrapped"
    """The wrap angle fell to zero: the string has left the rod."""
    TIME_UP = "time_up"
    """The limit on the simulated time is reached."""
    STOP = "stop"
    """The heavy mass comes to rest (on a rod that turns, or with a string that stretches: the string stops sliding)."""
    SLOWS = "slows"
    """The acceleration of the heavy mass has turned against its speed; from here on it can stop, and STOP is watched for."""
    LOSES_TENSION = "slack"
    """The tension falls to zero: the string goes slack."""
    SLIP_ONSET_DOWN = "slip_onset_down"
    """The rod no longer holds a string at rest, which begins to slide so that the heavy mass falls (next: rises)."""
    SLIP_ONSET_UP = "slip_onset_up"
    ACROSS_REVERSES = "across_reverses"
    """The light mass's speed across the string changes sign; |w| is carried as sign times w."""
    CLOSES = "closes"
    """The slack has stopped growing; from here on the string can become taut, and TAUT is watched for."""
    TAUT = "taut"
    """The slack falls to zero."""
    HEAVY_REVERSES = "heavy_reverses"
    """The heavy mass reverses its motion while the string is slack."""
    FIRST_TURN = "first_turn"
    """The wrap angle passes a full turn, from where the string lies on itself."""
    ROD_CHANGES = "rod_changes"
    """The rod begins or ceases to turn while the string slides on it or is slack."""
    ROD_SLOWS = "rod_slows"
    """The rod's acceleration has turned against its speed; from here on it can stop, and its stop is watched for."""
    ROD_STOPS = "rod_stops"
    """The rod, and with it the string, comes to rest."""
    ROD_YIELDS_UP = "rod_yields_up"
    """The bearing no longer holds the rod, which begins to turn with the string so that the heavy mass rises (next: falls)."""
    ROD_YIELDS_DOWN = "rod_yields_down"


END_EVENTS = frozenset({Event.LIGHT_REACHES_ROD, Event.HEAVY_REACHES_ROD, Event.UNWRAPPED, Event.TIME_UP})
"""Events that end the run in any mode."""
PHASE_EVENTS = frozenset(
    {
        Event.SLOWS,
        Event.CLOSES,
        Event.ACROSS_REVERSES,
        Event.HEAVY_REVERSES,
        Event.FIRST_TURN,
        Event.ROD_CHANGES,
        Event.ROD_SLOWS,
    }
)
"""Events that change a sign or a phase (`state.Signs`), not the mode."""

PHASE_ZERO = {Event.STOP: Event.SLOWS, Event.TAUT: Event.CLOSES}
"""Return to zero -> event that is watched for in its place in phase 0, without which the return cannot happen."""


class TransitionChoice(Enum):
    """Rule by which the next mode is chosen where it depends on the forces, not on the event alone."""

    BY_HOLDING = "sticks if the rod can hold the difference of the tensions, else slides the way it is pulled"
    BY_IMPULSE = "slides the way the inelastic pull leaves it, or sticks inside the friction cone"


TABLE: dict[tuple[Mode, Event], Mode | TransitionChoice] = {
    (Mode.SLIDING_DOWN, Event.STOP): TransitionChoice.BY_HOLDING,
    (Mode.SLIDING_UP, Event.STOP): TransitionChoice.BY_HOLDING,
    (Mode.SLIDING_DOWN, Event.LOSES_TENSION): Mode.SLACK,
    (Mode.SLIDING_UP, Event.LOSES_TENSION): Mode.SLACK,
    (Mode.STICKING, Event.SLIP_ONSET_DOWN): Mode.SLIDING_DOWN,
    (Mode.STICKING, Event.SLIP_ONSET_UP): Mode.SLIDING_UP,
    (Mode.STICKING, Event.ROD_YIELDS_UP): Mode.ROLLING,
    (Mode.STICKING, Event.ROD_YIELDS_DOWN): Mode.ROLLING,
    (Mode.ROLLING, Event.SLIP_ONSET_DOWN): Mode.SLIDING_DOWN,
    (Mode.ROLLING, Event.SLIP_ONSET_UP): Mode.SLIDING_UP,
    (Mode.ROLLING, Event.ROD_STOPS): TransitionChoice.BY_HOLDING,
    (Mode.SLACK, Event.TAUT): TransitionChoice.BY_IMPULSE,
    (Mode.CLAMPED, Event.LOSES_TENSION): Mode.CLAMPED_SLACK,
    (Mode.CLAMPED_SLACK, Event.TAUT): Mode.CLAMPED,
}
"""The whole transition table; `END_EVENTS` end any mode and `PHASE_EVENTS` leave it as it is."""


def next_mode(mode: Mode, event: Event) -> Mode | TransitionChoice:
    """Return the mode that follows ``event`` in ``mode``, or the rule by which it is chosen."""
    if event in END_EVENTS:
        return Mode.ENDED
    if event in PHASE_EVENTS:
        return mode
    return TABLE[mode, event]
