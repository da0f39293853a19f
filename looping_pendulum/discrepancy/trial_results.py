"""The parts of an identification's result that describe the data of each trial, and how far the models are from them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from looping_pendulum.reference_ode.geometry import Array


@dataclass(frozen=True, kw_only=True)
class TrialError:
    """How far the declared and the repaired model are from one trial."""

    trial: str
    held_out: bool
    rms_before: float | None
    """RMS residual of the calibrated declared model [unit]: of the light mass's position where it was tracked, else of all
    channels; None: the trial has only events."""
    rms_after: float | None
    """The same of the repaired model [unit]."""
    standardised_rms_before: float
    """RMS residual of the calibrated declared model in units of the noise; 1 is the best possible."""
    standardised_rms_after: float
    """The same of the repaired model."""
    events_before: Mapping[str, float]
    """SI unit -> RMS of measured less predicted events of that unit, by the calibrated declared model."""
    events_after: Mapping[str, float]
    """The same by the repaired model."""
    unit: str = "m"
    """SI unit of the RMS residuals; empty: channels of several units together."""


@dataclass(frozen=True, kw_only=True)
class Outliers:
    """Tracked points of one body in one trial that do not show it, and so were left out of all fits and tests."""

    trial: str
    held_out: bool
    channels: tuple[str, ...]
    """Channels of the body."""
    count: int
    of: int
    """Number of tracked points of the body, outliers included."""
    intervals: tuple[tuple[float, float], ...]
    """First and last time of each run of neighbouring outliers, by the file's clock [s]."""
    largest_distance: float
    """Largest distance of an outlier from the repaired model [unit]."""
    unit: str


@dataclass(frozen=True, kw_only=True)
class EventResidual:
    """One measured event beside the predictions of both models."""

    trial: str
    held_out: bool
    quantity: str
    index: int
    unit: str
    measured: float
    """Measured value [unit]."""
    sigma: float
    """Standard error [unit]."""
    before: float | None
    """Prediction of the calibrated declared model [unit]; None: the event does not happen in its run."""
    after: float | None
    """The same of the repaired model."""


@dataclass(frozen=True, kw_only=True)
class RecordStart:
    """Start of the motion in a record that begins in mid-swing, at its first tracked point, by the repaired model."""

    trial: str
    held_out: bool
    time: float
    """Time of the first tracked point by the file's clock [s]."""
    angle: float
    """Wrap angle there [rad]; pi: straight down."""
    angle_error: float
    """Standard error [rad]; 0: stated as exact."""
    speed: float
    """Speed of the light mass across its string there [m/s], positive as the wrap angle grows."""
    speed_error: float
    """Standard error [m/s]; 0: stated as exact."""


@dataclass(frozen=True, kw_only=True)
class CorrelatedError:
    """Errors of one body's tracked points that last longer than a frame, as of a tracker that wanders over its mark."""

    body: str
    """Body, of `observations.BODIES`."""
    amplitude: float
    """Standard deviation of these errors, each coordinate [unit]."""
    unit: str
    """SI unit of `amplitude`."""
    correlation_time: float
    """Time in which they change [s]."""
    points: float
    """The same in tracked points."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TrialFigure:
    """Arrays of one trial for the figures: channel -> values; residuals in units of noise."""

    trial: str
    held_out: bool
    channels: tuple[str, ...]
    t: Mapping[str, Array]
    measured: Mapping[str, Array]
    before: Mapping[str, Array]
    after: Mapping[str, Array]
    residual_before: Mapping[str, Array]
    """NaN for outliers."""
    residual_after: Mapping[str, Array]
    outliers: Mapping[str, NDArray[np.bool_]]
    """Which values were left out as outliers."""
