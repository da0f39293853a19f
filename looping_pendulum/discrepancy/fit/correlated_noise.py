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
from scipy.linalg.lapack import dpttrf

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
MIN_STEP = 1e-9
"""Time [s] by which points of one time count as apart."""


def _predictions(t: Array, sigma: Array, noise: CorrelatedNoise) -> tuple[Array, Array]:
    """Return memory and predictions of the correlated errors; arguments as of `Whitening`.

    The inverse of the errors' covariance, given all points, is tridiagonal. The pivots of its factors L D L^T hold the filter's
    variances, so that LAPACK runs the recursion.

    Returns
    -------
    memory
        Correlation of the errors of neighbours, 0 between tracks, shape (n - 1,).
    predicted
        Variance of each error, given the points before it, shape (n,).
    """
    variance, step = noise.amplitude**2, np.diff(t)
    memory = np.where(step < 0, 0.0, np.exp(-np.maximum(step, 0.0) / noise.correlation_time))
    fresh = np.where(step < 0, variance, -variance * np.expm1(-2 * np.maximum(step, MIN_STEP) / noise.correlation_time))
    to_next = np.append(memory**2 / fresh, 0.0)
    by_point = sigma**-2.0
    pivots, _, _ = dpttrf(1 / np.append(variance, fresh) + by_point + to_next, -memory / fresh)
    return memory, 1 / (pivots - by_point - to_next)


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
        memory, predicted = _predictions(t, sigma, noise)
        spread = predicted + sigma**2
        gain = predicted / spread
        self._deviation = np.sqrt(spread)
        # The prediction of the next point is memory (1 - gain) times the last prediction, and memory gain times the last point
        self._from_point = memory * gain[:-1]
        self._band = np.zeros((2, len(t)))
        self._band[0] = 1.0
        self._band[1, :-1] = -memory * (1.0 - gain[:-1])
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
