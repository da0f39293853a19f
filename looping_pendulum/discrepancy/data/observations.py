"""What was measured, as plain numbers [SI]: channels over time, event tables, and what was left out of them and why."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from looping_pendulum.errors import HarnessError
from looping_pendulum.reference_ode.geometry import Array

UNITS = MappingProxyType(
    {
        "light_x": "m",
        "light_y": "m",
        "heavy_x": "m",
        "heavy_y": "m",
        "angle": "rad",
        "angle_rate": "rad/s",
        "height": "m",
    }
)
"""Channel -> SI unit. Positions: x right and y up; angle: of the string from the downward vertical, growing as the light mass
loops (wrap angle - pi); height: of the mass that falls, upward."""

BODIES = MappingProxyType(
    {"light": ("light_x", "light_y"), "heavy": ("heavy_x", "heavy_y"), "angle": ("angle",), "height": ("height",)}
)
"""What moves -> the channels that see it; components of one motion share one noise law."""


class DataError(HarnessError, ValueError):
    """A file of measured data cannot be used as it is."""


@dataclass(frozen=True, kw_only=True)
class UnusedValues:
    """Values that were not used."""

    count: int
    reason: str


@dataclass(frozen=True, kw_only=True, eq=False)
class Channel:
    """One measured quantity over time; only points that are there."""

    name: str
    """One of `UNITS`."""
    t: Array
    """Times by the file's clock, or by the true frame rate where that was given [s], shape (n,), ascending."""
    value: Array
    """Measured values [SI], shape (n,)."""
    column: str = ""
    """What the file calls it."""

    def __post_init__(self) -> None:
        """Refuse what no channel can be."""
        if self.name not in UNITS:
            raise DataError(f"channel {self.name!r}: needed one of {', '.join(UNITS)}")
        if self.t.shape != self.value.shape or self.t.ndim != 1:
            raise DataError(f"channel {self.name}: found shapes {self.t.shape} and {self.value.shape}, needed (n,) twice")
        if not (np.all(np.isfinite(self.t)) and np.all(np.isfinite(self.value)) and np.all(np.diff(self.t) > 0)):
            raise DataError(f"channel {self.name}: found times or values that are not finite and ascending")

    @property
    def unit(self) -> str:
        """SI unit of the values."""
        return UNITS[self.name]

    def __len__(self) -> int:
        """Return the number of points."""
        return len(self.t)


@dataclass(frozen=True, kw_only=True)
class EventObservation:
    """One measured event: a time or a position at it."""

    quantity: str
    """Name, "x1_extremum"."""
    index: int
    """Which one, from 1."""
    value: float
    """SI."""
    sigma: float
    """Its standard error [same unit]: stated, or one unit of the last printed digit."""
    unit: str
    """SI unit."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Observations:
    """Everything that was measured in one trial."""

    name: str
    file: str
    """Where it was read; several files are joined by ' + '."""
    channels: tuple[Channel, ...] = ()
    events: tuple[EventObservation, ...] = ()
    dropped: tuple[UnusedValues, ...] = ()
    """What was left out, and why."""
    assumptions: tuple[str, ...] = ()
    """What the reader took for granted because the file does not say it."""

    @property
    def used(self) -> int:
        """How many values are there to be used."""
        return sum(len(c) for c in self.channels) + len(self.events)

    def channel(self, name: str) -> Channel:
        """Return the channel of that name.

        Raises
        ------
        DataError
            If it was not measured.
        """
        for channel in self.channels:
            if channel.name == name:
                return channel
        have = ", ".join(c.name for c in self.channels) or "no channels"
        raise DataError(f"{self.file}: found no {name}, only {have}")

    def bodies(self) -> dict[str, tuple[Channel, ...]]:
        """Channels by what moves: components of one motion together."""
        found = {body: tuple(c for c in self.channels if c.name in names) for body, names in BODIES.items()}
        return {body: channels for body, channels in found.items() if channels}

    def summary(self) -> str:
        """How many values were used, how many not, and why, in one line."""
        parts = [f"{c.name} {len(c)}" for c in self.channels] + ([f"events {len(self.events)}"] if self.events else [])
        left = "; ".join(f"{d.count} not used: {d.reason}" for d in self.dropped)
        return f"{self.name}: used {', '.join(parts) or 'nothing'}" + (f"; {left}" if left else "")


def merge(name: str, parts: tuple[Observations, ...]) -> Observations:
    """Join what several files saw of one trial.

    Raises
    ------
    DataError
        If two files have the same channel.
    """
    channels: dict[str, tuple[Channel, str]] = {}
    for part in parts:
        for channel in part.channels:
            if channel.name in channels:
                raise DataError(
                    f"{part.file}: found {channel.name} again (first in {channels[channel.name][1]}), needed each once; "
                    "say by 'tracks' which mass is in which file"
                )
            channels[channel.name] = channel, part.file
    return Observations(
        name=name,
        file=" + ".join(dict.fromkeys(p.file for p in parts)),
        channels=tuple(c for c, _ in channels.values()),
        events=tuple(e for p in parts for e in p.events),
        dropped=tuple(d for p in parts for d in p.dropped),
        assumptions=tuple(dict.fromkeys(a for p in parts for a in p.assumptions)),
    )


def mirrored(observations: Observations) -> Observations:
    """Return what a camera on the other side of the rod would have seen."""
    flip = {"light_x", "heavy_x", "angle", "angle_rate"}
    channels = tuple(replace(c, value=-c.value) if c.name in flip else c for c in observations.channels)
    return replace(observations, channels=channels)


def with_event_errors(observations: Observations, errors: dict[str, float]) -> Observations:
    """Return a copy whose events have the standard errors given for their unit ({"s": 0.008})."""
    for unit, sigma in errors.items():
        if not (math.isfinite(sigma) and sigma > 0):
            raise DataError(f"event error in {unit}: found {sigma}, needed a number above 0")
    events = tuple(replace(e, sigma=errors.get(e.unit, e.sigma)) for e in observations.events)
    return replace(observations, events=events)
