"""Plain-language descriptions of the names of events, modes and physics."""

from __future__ import annotations

from collections.abc import Iterable

from looping_pendulum.compare.align import SAME_TIME
from looping_pendulum.engines.trajectory import UNKNOWN_MODE
from looping_pendulum.reference_ode.transitions import Mode

EVENT_DESCRIPTIONS = {
    "release": "the release",
    "stop": "a stop of the heavy mass",
    "stick": "the string began to stick",
    "halt": "the halt",
    "slip_onset": "the string began to slide again",
    "slack": "the string fell slack",
    "taut": "the string became taut again",
    "light_reaches_rod": "the light mass reached the rod",
    "heavy_reaches_rod": "the heavy mass reached the rod",
    "unwrapped": "the string left the rod",
}

PHYSICS_DESCRIPTIONS = {
    "winding": "the winding",
    "friction_law": "the string's friction on the rod",
    "stick_slip": "sticking and slipping",
    "drag": "the drag",
    "static_friction": "a static friction other than the kinetic one",
}
"""Name of a piece of physics, as in `Abilities.lacks` and `Supplies` -> its description."""


def events_to_show(events: Iterable[tuple[str, float]]) -> list[tuple[str, float]]:
    """Return (name, time [s]) of the events that a reader should see.

    Of simultaneous events only one is kept: a halt is also a stick and a stop, and is the most informative of the three.
    """
    rank = {name: place for place, name in enumerate(("halt", "stick", "stop"))}
    shown: list[tuple[str, float]] = []
    for name, time in sorted(events, key=lambda e: (e[1], rank.get(e[0], -1))):
        if name == "release" or name not in EVENT_DESCRIPTIONS:
            continue
        if shown and time - shown[-1][1] < SAME_TIME and name in rank:
            continue
        shown.append((name, time))
    return shown


def mode_description(mode: int) -> str:
    """Describe a mode of the reference in plain words."""
    descriptions = {
        Mode.STICKING: "the string sticks to the rod",
        Mode.ROLLING: "the string sticks to the rod, which turns",
        Mode.SLIDING_DOWN: "the string slides and the heavy mass falls",
        Mode.SLIDING_UP: "the string slides and the heavy mass rises",
        Mode.SLACK: "the string is slack",
        Mode.CLAMPED: "the light mass swings and the heavy one is clamped",
        Mode.CLAMPED_SLACK: "the string is slack and the heavy mass clamped",
        Mode.FALLING: "both masses fall freely",
        Mode.ENDED: "the reference ends",
    }
    return "the mode of the reference is unknown" if mode == UNKNOWN_MODE else descriptions[Mode(mode)]
