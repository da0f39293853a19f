"""Compare a filmed trial with the reference and the engines: the residual of every tracked point, measured less predicted.

A trial is plain data here; `compare.trial_files` reads its files. A run is joined linearly between its samples, a
millisecond apart: that moves a mass by less than 0.02 mm, where a tracked point is accurate to about one.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from looping_pendulum.measured.tables.events import MeasuredEventRow
from looping_pendulum.pages.numbers import DisplayUnit
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.runs.trajectory import Trajectory, finite_length, first_samples

LEVEL_TIME = 0.05
"""Time after the release [s] whose points give the level of a mass that hangs at an unknown height.

A heavy mass falls by no more than 12 mm in it, so that a prediction wrong by 1 % is off by 0.1 mm.
"""
MAX_CLOCK_ERROR = 1.0
"""Largest error of the release's time that is looked for [s]."""
CLOCK_STEP = 1e-3
"""Step of that search [s]: a quarter of a frame at 240 frames a second."""
EARLY = 0.35
"""Time since the release [s] up to which points tell it: an error of the model, as of its friction, is still small then."""
MIN_EARLY_POINTS = 10
"""Fewest points up to then."""
CLOCK_GAIN = 0.5
"""Part of the RMS to which a better release time must bring it before the report speaks of it."""
OFFSET_SHARE = 0.7
"""Part of the RMS that is a constant offset, from which on the report speaks of the axes' origin."""
MIN_OFFSET = 2e-3
"""Smallest constant offset that the report speaks of [m]: twice what a careful student's tracking is accurate to."""

RESIDUAL_UNITS = {"m": DisplayUnit("mm", 1e3), "rad": DisplayUnit("deg", 57.29577951308232)}
"""SI unit of a track -> unit in which its residuals are shown."""

_PREDICTED: Mapping[str, Callable[[Trajectory], Array]] = MappingProxyType(
    {
        "light_x": lambda run: run.light_position[:, 0],
        "light_y": lambda run: run.light_position[:, 1],
        "heavy_x": lambda run: run.heavy_position[:, 0],
        "heavy_y": lambda run: run.heavy_position[:, 1],
        "wrap_angle": lambda run: run.wrap_angle,
    }
)
"""Channel of a track -> its values in a run [SI], shape (n,)."""


@dataclass(frozen=True, kw_only=True)
class MeasuredTrack:
    """Tracked points of one body: metres from the rod's centre, x right and y up, or the wrap angle [rad]."""

    name: str
    """What was tracked: "light mass", "heavy mass" or "wrap angle"."""
    channels: tuple[str, ...]
    """Coordinates of a point: "light_x", "light_y", "heavy_x", "heavy_y", or "wrap_angle"."""
    unit: str
    """SI unit of the values."""
    t: tuple[float, ...]
    """Times since the release [s], ascending, none negative."""
    values: tuple[tuple[float, ...], ...]
    """Measured values of each channel [SI], each as long as ``t``."""
    level_unknown: bool = False
    """Whether heights have an unknown zero, as the length on which a mass hangs does not influence its motion."""

    def channel(self, name: str) -> tuple[float, ...] | None:
        """Return the values of a channel [SI], None if it was not measured."""
        return self.values[self.channels.index(name)] if name in self.channels else None


@dataclass(frozen=True, kw_only=True)
class MeasuredTrial:
    """What was measured of one trial: tracked points, events, or both."""

    name: str
    source: str
    """Files that it was read from."""
    tracks: tuple[MeasuredTrack, ...] = ()
    rows: tuple[MeasuredEventRow, ...] = ()
    """Measured events."""
    notes: tuple[str, ...] = ()
    """What was read, left out and assumed, each as a sentence."""
    clock_offset: float = 0.0
    """Time since the release [s] at which the file's clock is 0, as its points have it."""
    origin: tuple[float, float] = (0.0, 0.0)
    """Place in the file (x, y) [m] of the rod's centre, as its points have it."""


@dataclass(frozen=True, kw_only=True)
class RunResidual:
    """Residual of one track from one run: measured less predicted, over the points that the run covers."""

    compared: int
    """Number of points that the run covers."""
    rms: float | None
    """Root mean square of the distance between point and prediction [SI]; None without points."""
    mean: tuple[float, ...]
    """Mean residual of each channel [SI]; empty without points."""
    largest: float | None
    """Largest distance [SI]."""
    largest_at: float | None
    """Time of it since the release [s]."""


@dataclass(frozen=True, kw_only=True)
class TrackComparison:
    """One track beside the reference and the engines."""

    track: MeasuredTrack
    """Its points, at the level that `level_shift` gives them."""
    level_shift: float
    """Height that was added to the points [m], so that they begin where the reference does; 0 where the level is known."""
    reference: RunResidual
    engines: tuple[RunResidual, ...]
    """In the order of `ComparisonResult.engines`."""


@dataclass(frozen=True, kw_only=True)
class TrialComparison:
    """A filmed trial beside the reference and the engines."""

    name: str
    source: str
    notes: tuple[str, ...]
    """What was read, left out and assumed, and what looks like a mistake of clock or axes, each as a sentence."""
    tracks: tuple[TrackComparison, ...]

    def track(self, name: str) -> MeasuredTrack | None:
        """Return the points of a body, None if it was not tracked."""
        return next((c.track for c in self.tracks if c.track.name == name), None)

    def light_positions(self) -> tuple[Array, Array] | None:
        """Return x and y [m] of the points of the light mass, shape (n,) each; None if it was not tracked in both."""
        track = self.track("light mass")
        x, y = (None, None) if track is None else (track.channel("light_x"), track.channel("light_y"))
        return None if x is None or y is None else (np.array(x), np.array(y))

    def heavy_drops(self, reference: Trajectory) -> tuple[Array, Array] | None:
        """Return times [s] and drops below the release [m] of the points of the heavy mass; None if its height is unknown."""
        track = self.track("heavy mass")
        height = None if track is None else track.channel("heavy_y")
        if track is None or height is None:
            return None
        return np.array(track.t), reference.heavy_position[0, 1] - np.array(height)


def compare_trial(trial: MeasuredTrial, reference: Trajectory, runs: tuple[Trajectory, ...]) -> TrialComparison:
    """Return the residuals of every track of ``trial`` from the reference and from each of ``runs``."""
    reference = first_samples(reference, finite_length(reference))
    hint = _clock_hint(trial, reference)
    compared, notes = [], [*trial.notes, *([hint] if hint else [])]
    for measured in trial.tracks:
        shift = _level_shift(measured, reference) if measured.level_unknown else 0.0
        raised = tuple(
            tuple(v + shift for v in values) if name.endswith("_y") else values
            for name, values in zip(measured.channels, measured.values, strict=True)
        )
        track = replace(measured, values=raised)
        comparison = TrackComparison(
            track=track,
            level_shift=shift,
            reference=_run_residual(track, reference),
            engines=tuple(_run_residual(track, run) for run in runs),
        )
        compared.append(comparison)
        notes += _level_note(comparison)
        # A wrong clock moves the points, too, and is the more likely mistake
        notes += [] if hint else _offset_hint(comparison, trial.origin)
    return TrialComparison(name=trial.name, source=trial.source, notes=tuple(notes), tracks=tuple(compared))


def residual(track: MeasuredTrack, run: Trajectory, clock_shift: float = 0.0) -> Array:
    """Return measured less predicted values [SI], shape (n, channels); NaN where the run does not reach.

    Parameters
    ----------
    clock_shift
        Time [s] that is added to the points' times.
    """
    if not len(run.t):
        return np.full((len(track.t), len(track.channels)), np.nan)
    t = np.array(track.t) + clock_shift
    columns = [
        np.array(values) - np.interp(t, run.t, _PREDICTED[name](run), right=np.nan)
        for name, values in zip(track.channels, track.values, strict=True)
    ]
    return np.column_stack(columns)


def distance(track: MeasuredTrack, run: Trajectory) -> Array:
    """Return the distance between each point and its prediction [SI], shape (n,)."""
    return np.asarray(np.sqrt(np.sum(residual(track, run) ** 2, axis=1)))


def _run_residual(track: MeasuredTrack, run: Trajectory) -> RunResidual:
    off = residual(track, run)
    known = np.isfinite(off).all(axis=1)
    if not known.any():
        return RunResidual(compared=0, rms=None, mean=(), largest=None, largest_at=None)
    size = np.sqrt(np.sum(off[known] ** 2, axis=1))
    worst = int(np.argmax(size))
    return RunResidual(
        compared=int(known.sum()),
        rms=float(np.sqrt(np.mean(size**2))),
        mean=tuple(float(m) for m in off[known].mean(axis=0)),
        largest=float(size[worst]),
        largest_at=float(np.array(track.t)[known][worst]),
    )


def _level_shift(track: MeasuredTrack, reference: Trajectory) -> float:
    """Return the height [m] to add to a track's points, so that on average the first of them are where the reference is."""
    off = residual(track, reference)[:, [name.endswith("_y") for name in track.channels]][:, 0]
    first = off[np.array(track.t) <= max(LEVEL_TIME, track.t[0])]
    return -float(np.mean(first)) if np.isfinite(first).all() else 0.0


def _level_note(comparison: TrackComparison) -> list[str]:
    if not comparison.track.level_unknown:
        return []
    up = "raised" if comparison.level_shift > 0 else "lowered"
    return [
        f"The points of the {comparison.track.name} were {up} by {abs(comparison.level_shift) * 1e3:.1f} mm, so that they "
        "begin where the reference does: on what length it hangs does not matter for its motion."
    ]


def _clock_hint(trial: MeasuredTrial, reference: Trajectory) -> str:
    """Return a sentence if another time of the release fits the tracked points much better, otherwise nothing."""
    track = next((t for t in trial.tracks if not t.level_unknown), None)
    if track is None or not len(reference.t):
        return ""

    def rms(shift: float) -> float:
        off = residual(track, reference, shift)
        known = np.isfinite(off).all(axis=1) & (np.array(track.t) + shift <= EARLY)
        # A shift that moves the points out of the run would fit whatever is left
        if known.sum() < min(MIN_EARLY_POINTS, len(track.t)):
            return math.inf
        return float(np.sqrt(np.mean(np.sum(off[known] ** 2, axis=1))))

    shifts = np.arange(-MAX_CLOCK_ERROR, MAX_CLOCK_ERROR + CLOCK_STEP / 2, CLOCK_STEP)
    sizes = np.array([rms(float(shift)) for shift in shifts])
    best, now = int(np.argmin(sizes)), rms(0.0)
    frame = float(np.median(np.diff(track.t))) if len(track.t) > 1 else 0.0
    if not sizes[best] < CLOCK_GAIN * now or abs(shifts[best]) <= 2 * frame:
        return ""
    when = "earlier" if shifts[best] > 0 else "later"
    return (
        f"The points fit the reference much better if the release was {abs(shifts[best]):.3f} s {when} by the file's clock; if "
        f"it was, say so: --marks-set 'camera.clock_offset={trial.clock_offset + shifts[best]:.3f} s'."
    )


def _offset_hint(comparison: TrackComparison, origin: tuple[float, float]) -> list[str]:
    """Return a sentence if most of the reference's residual is a constant offset."""
    found, track = comparison.reference, comparison.track
    if track.unit != "m" or found.rms is None or len(track.channels) < 2 or track.level_unknown:
        return []
    x, y = found.mean
    size = math.hypot(x, y)
    if size < max(MIN_OFFSET, OFFSET_SHARE * found.rms):
        return []
    sides = f"{abs(x) * 1e3:.1f} mm {'right' if x > 0 else 'left'} of and {abs(y) * 1e3:.1f} mm {'above' if y > 0 else 'below'}"
    return [
        f"On average the points of the {track.name} lie {sides} the reference, which is most of their residual: is the axes' "
        f"origin on the rod's centre? If not, say where that is: --marks-set 'camera.origin_x={1e3 * (origin[0] + x):.1f} mm' "
        f"--marks-set 'camera.origin_y={1e3 * (origin[1] + y):.1f} mm'."
    ]
