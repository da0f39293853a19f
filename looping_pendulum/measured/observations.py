"""Measured data in SI units: channels over time, event tables, and which values were left out of them and why."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np

from looping_pendulum.errors import HarnessError, WayOut, one_line
from looping_pendulum.reference_ode.geometry import Array

KINDS = ("auto", "positions", "angle", "drop", "events")
"""Kinds of files; "positions" stands for tracked points of every form, "auto" tells the kind by the names of the columns."""
PLANES = ("xy", "xz", "yx", "yz", "zx", "zy")
"""Axes of a table that are horizontal and vertical in the plane of the motion."""
BOXES = ("centre", "corner")
"""What x and y of a box are: its middle, or its corner of smallest x and y, from which width and height count."""
UNITS = MappingProxyType(
    {"light_x": "m", "light_y": "m", "heavy_x": "m", "heavy_y": "m", "angle": "rad", "angle_rate": "rad/s", "height": "m"}
)
"""Channel -> SI unit.

Positions have x to the right and y up. "angle" is that of the string from the downward vertical; it grows as the light mass
loops, so it is the wrap angle less pi. "height" is that of the mass that falls, upward.
"""

BODIES = MappingProxyType({
    "light": ("light_x", "light_y"), "heavy": ("heavy_x", "heavy_y"),
    "angle": ("angle",), "angle_rate": ("angle_rate",), "height": ("height",),
})  # fmt: skip
"""Moving body -> the channels that show its motion. They share one noise law.

An "angle_rate" beside other channels was computed from them, so that only one that stands alone is fitted.
"""


class DataError(HarnessError, ValueError):
    """Raised if a file of measured data cannot be used as it is.

    The message is that for the author of a study; `on_command_line` words its way out for those who give keys as options.
    """

    def __init__(self, problem: str, way_out: WayOut | None = None) -> None:
        super().__init__(f"{problem}; {way_out.in_file()}" if way_out else problem)
        self.problem = problem
        """Where, what was found and what was needed."""
        self.way_out = way_out

    def on_command_line(self, option: str) -> str:
        """Return the message for a command line on which ``option`` gives keys of a study's trial."""
        return one_line(f"{self.problem}; {self.way_out.as_options(option)}") if self.way_out else str(self)


class ImplausibleLengthError(DataError):
    """Raised if lengths are so large that they must be in another unit than the file or the study says."""


@dataclass(frozen=True, kw_only=True)
class Edit:
    """One way in which observations differ from what the file says: values left out or moved, or what was assumed."""

    reason: str
    """What was done and why, in words."""
    count: int = 0
    """Number of values that were left out; 0: none, their times or meaning changed."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Channel:
    """One measured quantity over time, without missing samples."""

    name: str
    """One of `UNITS`."""
    t: Array
    """Times by the file's clock, or by the true frame rate if that is given [s], shape (n,), ascending."""
    value: Array
    """Measured values [SI], shape (n,)."""
    last_digit: float = 0.0
    """What one unit of the values' last digit is worth in the file [SI]; 0: not known."""
    time_error: float = 0.0
    """Standard error of each time by rounding [s]."""
    stated_error: tuple[Array, Array] | None = None
    """Times [s] and the standard errors [SI] that the program which tracked the points states for them, if it does."""

    def __post_init__(self) -> None:
        """Refuse unknown names, unequal shapes, and times or values that are not finite and ascending."""
        if self.name not in UNITS:
            raise DataError(f"channel {self.name!r}: needed one of {', '.join(UNITS)}")
        if self.t.shape != self.value.shape or self.t.ndim != 1:
            raise DataError(f"channel {self.name}: found shapes {self.t.shape} and {self.value.shape}, needed (n,) twice")
        if not (np.all(np.isfinite(self.t)) and np.all(np.isfinite(self.value)) and np.all(np.diff(self.t) > 0)):
            raise DataError(f"channel {self.name}: found times or values that are not finite and ascending")

    @property
    def unit(self) -> str:
        """Return the SI unit of the values."""
        return UNITS[self.name]

    def least_sigma(self, speed: Array) -> Array:
        """Return the error that each point has at least [SI]: by the file's rounding of values and times, and as stated.

        Values that rounding makes equal have one error of rounding, so that they count once.
        """
        begins = np.append(True, np.diff(self.value) != 0)
        length = np.bincount(np.cumsum(begins) - 1)[np.cumsum(begins) - 1]
        rounding = np.asarray(np.hypot(self.last_digit / math.sqrt(12) * np.sqrt(length), self.time_error * speed))
        return rounding if self.stated_error is None else np.hypot(rounding, np.interp(self.t, *self.stated_error))

    @property
    def time_step(self) -> float:
        """Return the median time from one sample to the next [s]; 0 with fewer than two samples."""
        return float(np.median(np.diff(self.t))) if len(self) > 1 else 0.0

    def __len__(self) -> int:
        """Return the number of samples."""
        return len(self.t)


@dataclass(frozen=True, kw_only=True, eq=False)
class Track:
    """Tracked points of one object, in the unit of the file."""

    name: str
    """Name in the file; '' if it has none."""
    x: Array
    """Horizontal positions, shape (n,)."""
    y: Array
    """Vertical positions, upward, shape (m,); n and m may differ by empty cells."""

    @property
    def width(self) -> float:
        """Return the range of x without outliers."""
        return value_range(self.x)

    @property
    def fall(self) -> float:
        """Return how much lower the track ends than it begins."""
        return float(self.y[0] - self.y[-1]) if len(self.y) else 0.0


OUTLIER_SHARE = 5.0
"""Percentage of the points at either end of a range that do not count, as an autotracker slips."""


def value_range(values: Array) -> float:
    """Return the range of values without outliers."""
    return float(np.subtract(*np.percentile(values, [100 - OUTLIER_SHARE, OUTLIER_SHARE]))) if len(values) else 0.0


@dataclass(kw_only=True)
class ReadingNotes:
    """Values left out and assumptions made while a file is read."""

    unused: Counter[str] = field(default_factory=Counter)
    """Reason -> number of values that were left out for it."""
    assumptions: list[str] = field(default_factory=list)
    """What was assumed, put right or left out, one after the other."""
    camera_errors: dict[str, float] = field(default_factory=dict)
    """Parameter of the camera -> standard error that it has by what was put right [SI]."""
    tracks: dict[str, str] = field(default_factory=dict)
    """Mass -> name of its track in the file."""

    def edits(self) -> tuple[Edit, ...]:
        """Return what was left out, and what was assumed."""
        left_out = (Edit(reason=reason, count=count) for reason, count in self.unused.items() if count)
        return (*left_out, *(Edit(reason=assumption) for assumption in dict.fromkeys(self.assumptions)))


@dataclass(frozen=True, kw_only=True)
class EventObservation:
    """One measured event: a time or a position at it."""

    quantity: str
    """Name of the event or of a value at it, for example "x1_extremum"."""
    index: int
    """Which of several such events, from 1."""
    value: float
    """Measured value [SI]."""
    sigma: float
    """Standard error of the value [SI]: as stated in the file, or one unit of the last printed digit."""
    unit: str
    """SI unit of value and standard error."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Observations:
    """Everything that was measured in one trial."""

    name: str
    file: str
    """Path that it was read from; several are joined by ' + '."""
    channels: tuple[Channel, ...] = ()
    events: tuple[EventObservation, ...] = ()
    edits: tuple[Edit, ...] = ()
    """All that was done to what the file says, in its order."""
    camera_errors: Mapping[str, float] = field(default_factory=dict)
    """Parameter of the camera -> standard error that it has by what was put right in reading [SI]."""
    light_radius: tuple[float, float] | None = None
    """Radius of the light mass's disc and its standard error [m], where a film shows it."""
    tracks: Mapping[str, str] = field(default_factory=dict)
    """Mass -> name of its track in the file."""
    length_unit: str = ""
    """Unit of length that the first file names itself; '' if it names none."""

    @property
    def unused(self) -> tuple[Edit, ...]:
        """Return the edits that left values out."""
        return tuple(e for e in self.edits if e.count)

    @property
    def assumptions(self) -> tuple[str, ...]:
        """Return what was assumed because the file does not say it, and what was put right."""
        return tuple(e.reason for e in self.edits if not e.count)

    @property
    def used(self) -> int:
        """Return the number of values that can be used."""
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
        """Return the channels of each moving body that was measured."""
        by_body = {body: tuple(c for c in self.channels if c.name in names) for body, names in BODIES.items()}
        return {body: channels for body, channels in by_body.items() if channels}

    def summary(self) -> str:
        """Say in one line how many values were used, how many not, and why."""
        parts = [f"{c.name} {len(c)}" for c in self.channels] + ([f"events {len(self.events)}"] if self.events else [])
        unused = "; ".join(f"{u.count} not used: {u.reason}" for u in self.unused)
        used = f"{self.name}: used {', '.join(parts) or 'nothing'}"
        return "; ".join(filter(None, (used, unused, *self.assumptions)))


def merge(name: str, parts: tuple[Observations, ...]) -> Observations:
    """Join the observations of one trial that stand in several files.

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
                    f"{part.file}: found {channel.name} again (first in {channels[channel.name][1]}), needed each once",
                    WayOut(words="say by {} which mass is in which file", keys={"tracks.light": "NAME"}, is_example=True),
                )
            channels[channel.name] = channel, part.file
    return Observations(
        name=name,
        file=" + ".join(dict.fromkeys(p.file for p in parts)),
        channels=tuple(c for c, _ in channels.values()),
        events=tuple(e for p in parts for e in p.events),
        edits=(
            *(e for p in parts for e in p.unused),
            *dict.fromkeys(e for p in parts for e in p.edits if not e.count),  # several files of one form say the same
        ),
        camera_errors={name: sigma for p in parts for name, sigma in p.camera_errors.items()},
        light_radius=next((p.light_radius for p in parts if p.light_radius is not None), None),
        tracks={mass: track for p in parts for mass, track in p.tracks.items()},
        length_unit=parts[0].length_unit,
    )


def mirrored(observations: Observations) -> Observations:
    """Return the observations that a camera on the other side of the rod would have made."""
    # Events are left as they are: what their tables hold is the same from both sides
    flip = {"light_x", "heavy_x", "angle", "angle_rate"}
    channels = tuple(replace(c, value=-c.value) if c.name in flip else c for c in observations.channels)
    return replace(observations, channels=channels)


MAX_RATE_AT_REST = 0.05
"""Largest angular velocity of a pendulum that a hand holds still, as a part of the largest one of the record."""
MIN_REST = 0.25
"""Shortest rest before a release, in periods of a small swing: at a turning point it is as slow for a fiftieth of one."""


def rates_from_release(observations: Observations, small_swing_period: float, release_angle: float | None) -> Observations:
    """Return rates that stand alone from their first motion on, in the direction of a release at the stated angle.

    The sign of a gyroscope's axis is arbitrary, and a record may begin while the pendulum is still held. All other observations
    are returned as they are.

    Parameters
    ----------
    small_swing_period
        Period of a small swing [s].
    release_angle
        Wrap angle of the release [rad]; None: it is not stated, and the direction is left as it is.
    """
    if [c.name for c in observations.channels] != ["angle_rate"]:
        return observations
    (rates,) = observations.channels
    speed = np.abs(rates.value)
    first = int(np.argmax(speed > MAX_RATE_AT_REST * speed.max()))
    if rates.t[first] - rates.t[0] >= MIN_REST * small_swing_period:
        at_rest = Edit(count=first, reason="angle_rate: at rest, before the release")
        rates = replace(rates, t=rates.t[first:], value=rates.value[first:])
        observations = replace(observations, channels=(rates,), edits=(*observations.edits, at_rest))
    first_swing = rates.value[np.argmax(np.abs(rates.value) > speed.max() / 2)]
    return mirrored(observations) if release_angle is not None and first_swing * math.sin(release_angle) < 0 else observations
