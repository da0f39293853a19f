"""What an event table may hold: each quantity's name, what it is, and how it is read from a run's landmarks."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from types import MappingProxyType

from looping_pendulum.compare.result import Landmarks

Value = Callable[[Landmarks, int], float | None]
"""Landmarks and which one, from 1 -> value [SI]; None where the run has none."""


@dataclass(frozen=True, kw_only=True)
class EventQuantity:
    """One quantity of an event table."""

    kind: str
    """"time", "height" (change of the heavy mass's), "drop" (the same, downward), "length" or "angle"."""
    value: Value
    moment: str
    """The time at which it is measured, as the name of a quantity; a time names itself."""
    several: bool = False
    """Whether a run can have more than one."""

    @property
    def unit(self) -> str:
        """SI unit."""
        return {"time": "s", "angle": "rad"}.get(self.kind, "m")


def _stop_time(found: Landmarks, index: int) -> float | None:
    return found.stops[index - 1].time if index <= len(found.stops) else None


def _height_at_stop(found: Landmarks, index: int) -> float | None:
    return found.stops[index - 1].height_change if index <= len(found.stops) else None


def _break_away(found: Landmarks, index: int) -> float | None:
    return found.slip_onsets[index - 1] if index <= len(found.slip_onsets) else None


def _last_break_away(found: Landmarks, index: int) -> float | None:
    halt = found.halting_time
    before = [t for t in found.slip_onsets if halt is not None and t < halt]
    return before[-1] if before else None


def _x1_extremum(found: Landmarks, index: int) -> float | None:
    return found.x1_extrema[index - 1].time if index <= len(found.x1_extrema) else None


def _y1_extremum(found: Landmarks, index: int) -> float | None:
    return found.y1_extrema[index - 1].time if index <= len(found.y1_extrema) else None


def _height_at_halt(found: Landmarks, index: int) -> float | None:
    return None if found.drop_at_halt is None else -found.drop_at_halt


EVENT_QUANTITIES = MappingProxyType(
    {
        "x1_extremum": EventQuantity(kind="time", value=_x1_extremum, moment="x1_extremum", several=True),
        "y1_extremum": EventQuantity(kind="time", value=_y1_extremum, moment="y1_extremum", several=True),
        "stop_time": EventQuantity(kind="time", value=_stop_time, moment="stop_time", several=True),
        "height_change_at_stop": EventQuantity(kind="height", value=_height_at_stop, moment="stop_time", several=True),
        "break_away_time": EventQuantity(kind="time", value=_break_away, moment="break_away_time", several=True),
        "t_A": EventQuantity(kind="time", value=lambda f, _: _stop_time(f, 1), moment="t_A"),
        "height_change_at_A": EventQuantity(kind="height", value=lambda f, _: _height_at_stop(f, 1), moment="t_A"),
        "t_B": EventQuantity(kind="time", value=lambda f, _: _stop_time(f, 2), moment="t_B"),
        "height_change_at_B": EventQuantity(kind="height", value=lambda f, _: _height_at_stop(f, 2), moment="t_B"),
        "t_C": EventQuantity(kind="time", value=_last_break_away, moment="t_C"),
        "halting_time": EventQuantity(kind="time", value=lambda f, _: f.halting_time, moment="halting_time"),
        "height_change_at_halt": EventQuantity(kind="height", value=_height_at_halt, moment="halting_time"),
        "drop_at_halt": EventQuantity(kind="drop", value=lambda f, _: f.drop_at_halt, moment="halting_time"),
        "wrap_angle_at_halt": EventQuantity(kind="angle", value=lambda f, _: f.wrap_angle_at_halt, moment="halting_time"),
        "free_length_at_halt": EventQuantity(kind="length", value=lambda f, _: f.free_length_at_halt, moment="halting_time"),
        "time_light_reaches_rod": EventQuantity(
            kind="time", value=lambda f, _: f.light_reaches_rod, moment="time_light_reaches_rod"
        ),
    }
)
"""By name. A and B are the first two stops of the heavy mass, C is the break-away before the halt: the start of the final
plunge. Stops and break-aways are also there by number. The halt is the start of the rest that lasts to the end."""


def event_value(found: Landmarks, quantity: str, index: int) -> float | None:
    """Value [SI] of a quantity of an event table; None where the run has none, or the quantity is not known."""
    known = EVENT_QUANTITIES.get(quantity)
    return None if known is None or index < 1 else known.value(found, index)
