"""Quantities that an event table may hold, and how each is read from a run's landmarks."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from types import MappingProxyType

from looping_pendulum.engines.landmarks import Landmarks

ReadQuantity = Callable[[Landmarks, int], float | None]
"""Function of a run's landmarks and an index from 1 that returns the value [SI], or None where the run has none."""


@dataclass(frozen=True, kw_only=True)
class EventQuantity:
    """One quantity of an event table, such as the time of a stop."""

    kind: str
    """"time", "height" (of the heavy mass, less its height at release), "drop" (the same, downward), "length" or "angle"."""
    value: ReadQuantity
    measured_at: str
    """Name of the quantity that is the time at which this one is measured; a time names itself."""
    several: bool = False
    """Whether a run can have more than one, told apart by their index."""

    @property
    def unit(self) -> str:
        """Return the SI unit."""
        return {"time": "s", "angle": "rad"}.get(self.kind, "m")


def _stop_time(landmarks: Landmarks, index: int) -> float | None:
    return landmarks.stops[index - 1].time if index <= len(landmarks.stops) else None


def _height_at_stop(landmarks: Landmarks, index: int) -> float | None:
    return landmarks.stops[index - 1].height_change if index <= len(landmarks.stops) else None


def _slip_onset_time(landmarks: Landmarks, index: int) -> float | None:
    return landmarks.slip_onsets[index - 1] if index <= len(landmarks.slip_onsets) else None


def _last_slip_onset_time(landmarks: Landmarks, index: int) -> float | None:
    halt = landmarks.halting_time
    before = [t for t in landmarks.slip_onsets if halt is not None and t < halt]
    return before[-1] if before else None


def _x1_extremum(landmarks: Landmarks, index: int) -> float | None:
    return landmarks.x1_extrema[index - 1].time if index <= len(landmarks.x1_extrema) else None


def _y1_extremum(landmarks: Landmarks, index: int) -> float | None:
    return landmarks.y1_extrema[index - 1].time if index <= len(landmarks.y1_extrema) else None


def _height_at_halt(landmarks: Landmarks, index: int) -> float | None:
    return None if landmarks.drop_at_halt is None else -landmarks.drop_at_halt


EVENT_QUANTITIES = MappingProxyType(
    {
        "x1_extremum": EventQuantity(kind="time", value=_x1_extremum, measured_at="x1_extremum", several=True),
        "y1_extremum": EventQuantity(kind="time", value=_y1_extremum, measured_at="y1_extremum", several=True),
        "stop_time": EventQuantity(kind="time", value=_stop_time, measured_at="stop_time", several=True),
        "height_change_at_stop": EventQuantity(kind="height", value=_height_at_stop, measured_at="stop_time", several=True),
        "slip_onset_time": EventQuantity(kind="time", value=_slip_onset_time, measured_at="slip_onset_time", several=True),
        "t_A": EventQuantity(kind="time", value=lambda landmarks, _: _stop_time(landmarks, 1), measured_at="t_A"),
        "height_change_at_A": EventQuantity(
            kind="height", value=lambda landmarks, _: _height_at_stop(landmarks, 1), measured_at="t_A"
        ),
        "t_B": EventQuantity(kind="time", value=lambda landmarks, _: _stop_time(landmarks, 2), measured_at="t_B"),
        "height_change_at_B": EventQuantity(
            kind="height", value=lambda landmarks, _: _height_at_stop(landmarks, 2), measured_at="t_B"
        ),
        "t_C": EventQuantity(kind="time", value=_last_slip_onset_time, measured_at="t_C"),
        "halting_time": EventQuantity(
            kind="time", value=lambda landmarks, _: landmarks.halting_time, measured_at="halting_time"
        ),
        "height_change_at_halt": EventQuantity(kind="height", value=_height_at_halt, measured_at="halting_time"),
        "drop_at_halt": EventQuantity(
            kind="drop", value=lambda landmarks, _: landmarks.drop_at_halt, measured_at="halting_time"
        ),
        "wrap_angle_at_halt": EventQuantity(
            kind="angle", value=lambda landmarks, _: landmarks.wrap_angle_at_halt, measured_at="halting_time"
        ),
        "free_length_at_halt": EventQuantity(
            kind="length", value=lambda landmarks, _: landmarks.free_length_at_halt, measured_at="halting_time"
        ),
        "time_light_reaches_rod": EventQuantity(
            kind="time", value=lambda landmarks, _: landmarks.light_reaches_rod, measured_at="time_light_reaches_rod"
        ),
    }
)
"""Event quantity by name.

As in the paper, A and B are the first two stops of the heavy mass, C is the last slip onset before the halt: the start of
the final plunge. Stops and slip onsets are also there by number. The halt is the start of the rest that lasts to the end."""


def event_value(landmarks: Landmarks, quantity: str, index: int) -> float | None:
    """Return the value [SI] of a quantity of an event table; None where the run has none, or the quantity is not known."""
    known = EVENT_QUANTITIES.get(quantity)
    return None if known is None or index < 1 else known.value(landmarks, index)
