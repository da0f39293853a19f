"""The data of a trial as one vector with its noise: white, or with a part beside it that lasts longer than a frame.

A tracker that follows a mark wanders over it, so that neighbouring points are off by nearly the same. With the white noise of
standard deviation sigma_i the covariance of the errors of points i and j of one coordinate is

    C_ij = sigma_i^2 delta_ij + s^2 exp(-|t_i - t_j| / tau)

with the amplitude s and the correlation time tau: an Ornstein-Uhlenbeck process, which sampled in steps is a first-order
autoregressive one. Residuals are standardised by the one-step predictions of a Kalman filter, which takes as many operations as
there are points and is a Cholesky factor of the inverse of C (Harvey, Forecasting, structural time series models and the Kalman
filter, 1989, section 3.4).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dpttrf, dtbtrs

from looping_pendulum.discrepancy.fit.event_prediction import event_times
from looping_pendulum.measured.noise import estimate_noise, speed_at
from looping_pendulum.measured.observations import BODIES, Channel, EventObservation, Observations
from looping_pendulum.measured.study import Trial
from looping_pendulum.reference_ode.geometry import Array

FRAMES = (4.0, 10.0, 24.0)
"""Correlation times of errors that last longer than a frame, by which they are looked for [frames]."""
MIN_WHITE_SHARE = 0.2
"""Smallest white part of the noise, as a part of what differences of neighbours show."""
MIN_STEP = 1e-9
"""Time [s] by which points of one time count as apart."""


def trial_data(trial: Trial, observations: Observations) -> TrialData:
    """Return a trial's data: channels with noise estimated from the points alone, and events with their stated errors."""
    channels = observations.channels
    if len(channels) > 1:
        channels = tuple(c for c in channels if c.name != "angle_rate")  # computed from the angles: no new information
    parts = {}
    for body in dataclasses.replace(observations, channels=channels).bodies().values():
        of_body = estimate_noise(body)
        for c in body:
            speed = speed_at(body, c.t, of_body.a)
            # A nanometre at least: data without noise would divide by zero
            parts[c.name] = np.maximum(np.maximum(of_body.sigma(speed), c.least_sigma(speed)), 1e-9)
    stated = np.array([e.sigma for e in observations.events], dtype=float)
    sigma = np.concatenate([*(parts[c.name] for c in channels), stated])
    return TrialData(trial=trial, channels=channels, events=observations.events, sigma=sigma)


@dataclass(frozen=True, kw_only=True, eq=False)
class TrialData:
    """Data of one trial as one vector: its channels, end to end, then its events."""

    trial: Trial
    channels: tuple[Channel, ...]
    events: tuple[EventObservation, ...] = ()
    sigma: Array
    """Standard deviation of every value's white noise [SI], shape (n,); infinite: left out of the fit."""
    outliers: NDArray[np.bool_] | None = None
    """Values that are left out because they do not show the mass, shape (n,); None: none were looked for yet."""
    correlated: Mapping[str, CorrelatedNoise] = field(default_factory=dict)
    """Channel -> the correlated part of its noise, beside the white one of `sigma`; channels without one are left out."""

    @property
    def is_outlier(self) -> NDArray[np.bool_]:
        """Return which values are left out as outliers, shape (n,); none if none were looked for."""
        return np.zeros(len(self.sigma), dtype=bool) if self.outliers is None else self.outliers

    @cached_property
    def value(self) -> Array:
        """Return the measured values [SI], shape (n,)."""
        return np.concatenate([*(c.value for c in self.channels), [e.value for e in self.events]])

    @cached_property
    def t(self) -> Array:
        """Return the measured times [s], shape (n,); that of an event is when it happened by its table."""
        times = np.concatenate([np.zeros(0), *(c.t for c in self.channels)])
        return np.concatenate([times, event_times(self.events, float(times.max(initial=0.0)))])

    @cached_property
    def slices(self) -> dict[str, slice]:
        """Return channel -> its part of the vector."""
        ends = np.cumsum([0] + [len(c) for c in self.channels]).tolist()
        return {c.name: slice(a, b) for c, a, b in zip(self.channels, ends, ends[1:], strict=False)}

    @cached_property
    def _whitening(self) -> dict[str, Whitening]:
        return {c.name: Whitening(c.t, self.sigma[self.slices[c.name]], self.correlated[c.name])
                for c in self.channels if c.name in self.correlated}  # fmt: skip

    def standardise(self, difference: Array) -> Array:
        """Return differences from the values in units of the noise, shape (n,) or (n, m) as given; 0: left out."""
        standardised = np.asarray(difference / (self.sigma if difference.ndim == 1 else self.sigma[:, None]))
        for name, whitening in self._whitening.items():
            standardised[self.slices[name]] = whitening(difference[self.slices[name]])
        return standardised

    def with_noises(self, noises: Mapping[str, CorrelatedNoise]) -> TrialData:
        """Return data with white noise alone as data with correlated parts, of which the white one is made smaller.

        Parameters
        ----------
        noises
            Body, of `observations.BODIES`, -> its correlated noise; bodies with white noise alone are left out.
        """
        sigma, correlated = self.sigma.copy(), {}
        for c in self.channels:
            noise = next((n for body, n in noises.items() if c.name in BODIES[body]), None)
            if noise is not None and len(c) > 1:
                correlated[c.name] = noise
                sigma[self.slices[c.name]] = noise.white_sigma(self.sigma[self.slices[c.name]], c.time_step)
        return dataclasses.replace(self, sigma=sigma, correlated=correlated)

    @property
    def log_determinant(self) -> float:
        """Return the logarithm of the determinant of the noise's covariance, without values that are left out."""
        kept = np.isfinite(self.sigma)
        for name in self._whitening:
            kept[self.slices[name]] = False
        white = 2 * float(np.sum(np.log(self.sigma[kept])))
        return white + sum(w.log_determinant for w in self._whitening.values())

    @property
    def event_slice(self) -> slice:
        """Return the part of the vector that holds the events."""
        return slice(len(self.value) - len(self.events), len(self.value))

    def until(self, time: float) -> TrialData:
        """Return only the data up to ``time`` [s]."""
        kept = self.t <= time
        if kept.all():
            return self
        channels = []
        for c in self.channels:
            n = int(np.searchsorted(c.t, time, side="right"))
            channels.append(dataclasses.replace(c, t=c.t[:n], value=c.value[:n]))
        events = tuple(e for e, k in zip(self.events, kept[self.event_slice], strict=True) if k)
        outliers = None if self.outliers is None else self.outliers[kept]
        return dataclasses.replace(self, channels=tuple(channels), events=events, sigma=self.sigma[kept], outliers=outliers)


def noises_of(data: Iterable[TrialData]) -> dict[str, CorrelatedNoise]:
    """Return body -> correlated noise of its tracked points, which is the same in all trials."""
    named = {name: noise for d in data for name, noise in d.correlated.items()}
    return {body: named[n] for body, names in BODIES.items() for n in names if n in named}


@dataclass(frozen=True, kw_only=True)
class CorrelatedNoise:
    """The part of the noise of one body's points that is correlated in time."""

    amplitude: float
    """Standard deviation s of each coordinate [unit of the channel]."""
    correlation_time: float
    """Time tau after which the correlation has fallen to 1/e [s]."""

    def white_sigma(self, sigma: Array, step: float | Array) -> Array:
        """Return the white part of noise whose differences of neighbours scatter as white noise of ``sigma`` would, shape (n,).

        Neighbours ``step`` [s] apart also differ by the correlated part: sigma^2 = white^2 + s^2 (1 - exp(-step / tau)).
        ``step``: one for all points, or shape (n,).
        """
        correlated = self.amplitude**2 * -np.expm1(-step / self.correlation_time)
        # At least a part of it, since both are estimates
        return np.sqrt(np.maximum(sigma**2 - correlated, (MIN_WHITE_SHARE * sigma) ** 2))


class Whitening:
    """Standardises differences of one coordinate with white and correlated noise.

    Parameters
    ----------
    t
        Times of the points [s], ascending, shape (n,). Where they start over, another track begins, with errors of its own.
    sigma
        Standard deviation of the white part, shape (n,); infinite: the point is left out.
    noise
        The correlated part.

    Notes
    -----
    The inverse of the correlated errors' covariance, given all points, is tridiagonal. The pivots of its factors L D L^T hold
    the filter's variances, so that LAPACK runs the recursion.
    """

    def __init__(self, t: Array, sigma: Array, noise: CorrelatedNoise) -> None:
        variance, step = noise.amplitude**2, np.diff(t)
        # Correlation of the errors of neighbours, 0 between tracks
        memory = np.where(step < 0, 0.0, np.exp(-np.maximum(step, 0.0) / noise.correlation_time))
        fresh = np.where(step < 0, variance, -variance * np.expm1(-2 * np.maximum(step, MIN_STEP) / noise.correlation_time))
        to_next = np.append(memory**2 / fresh, 0.0)
        by_point = sigma**-2.0
        pivots, _, _ = dpttrf(1 / np.append(variance, fresh) + by_point + to_next, -memory / fresh)
        # Variance of each error, given the points before it
        predicted = 1 / (pivots - by_point - to_next)
        spread = predicted + sigma**2
        gain = predicted / spread
        self._deviation = np.sqrt(spread)
        # The prediction of the next point is memory (1 - gain) times the last prediction, and memory gain times the last point
        self._from_point = memory * gain[:-1]
        self._band = np.zeros((2, len(t)), order="F")
        self._band[0] = 1.0
        self._band[1, :-1] = -memory * (1.0 - gain[:-1])
        used = np.isfinite(sigma)
        self.log_determinant = float(np.sum(np.log(spread[used])))
        """Logarithm of the determinant of the covariance of the points that are not left out."""

    def __call__(self, difference: Array) -> Array:
        """Return the standardised differences, shape (n,) or (n, m) as given."""
        from_point, deviation = (w if difference.ndim == 1 else w[:, None] for w in (self._from_point, self._deviation))
        source = np.empty_like(difference, order="F")
        source[0] = 0.0
        np.multiply(from_point, difference[:-1], out=source[1:])
        predicted, _ = dtbtrs(self._band, source, uplo="L", diag="U", overwrite_b=True)
        np.subtract(difference, predicted, out=predicted)
        predicted /= deviation
        return np.asarray(predicted)
