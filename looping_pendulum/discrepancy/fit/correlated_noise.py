"""Errors of tracked points that last longer than a frame: noise with an exponential correlation beside the white noise.

A tracker that follows a mark wanders over it, so that neighbouring points are off by nearly the same. With the white noise of
standard deviation sigma_i the covariance of the errors of points i and j of one coordinate is

    C_ij = sigma_i^2 delta_ij + s^2 exp(-|t_i - t_j| / tau)

with the amplitude s and the correlation time tau: an Ornstein-Uhlenbeck process, which sampled in steps is a first-order
autoregressive one. Residuals are standardised by the one-step predictions of a Kalman filter, which takes as many operations as
there are points and is a Cholesky factor of the inverse of C (Harvey, Forecasting, structural time series models and the Kalman
filter, 1989, section 3.4).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_banded

from looping_pendulum.reference_ode.geometry import Array


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


MIN_WHITE_SHARE = 0.2
"""Smallest white part of the noise, as a part of what differences of neighbours show."""


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
    """

    def __init__(self, t: Array, sigma: Array, noise: CorrelatedNoise) -> None:
        variance = noise.amplitude**2
        step = np.diff(t, append=t[-1:])
        memory = np.where(step < 0, 0.0, np.exp(-np.maximum(step, 0.0) / noise.correlation_time))
        gain, spread = np.empty(len(t)), np.empty(len(t))
        predicted = variance
        # Python floats: ten times as fast as NumPy's one by one
        for i, (s, m) in enumerate(zip(sigma.tolist(), memory.tolist(), strict=True)):
            total = predicted + s * s
            share = predicted / total
            gain[i], spread[i] = share, total
            predicted = m * m * (1.0 - share) * predicted + variance * (1.0 - m * m)
        self._deviation = np.sqrt(spread)
        # The prediction of the next point is memory (1 - gain) times the last prediction, and memory gain times the last point
        self._from_point = (memory * gain)[:-1]
        self._band = np.zeros((2, len(t)))
        self._band[0] = 1.0
        self._band[1, :-1] = -(memory * (1.0 - gain))[:-1]
        used = np.isfinite(sigma)
        self.log_determinant = float(np.sum(np.log(spread[used])))
        """Logarithm of the determinant of the covariance of the points that are not left out."""

    def __call__(self, difference: Array) -> Array:
        """Return the standardised differences, shape (n,) or (n, m) as given."""
        source = np.zeros_like(difference)
        source[1:] = (self._from_point if difference.ndim == 1 else self._from_point[:, None]) * difference[:-1]
        predicted = solve_banded((1, 0), self._band, source, overwrite_b=True, check_finite=False)
        deviation = self._deviation if difference.ndim == 1 else self._deviation[:, None]
        return np.asarray((difference - predicted) / deviation)
