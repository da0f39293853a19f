"""Estimate the noise of tracked points, sigma = a + b |v|, from the data alone, without a model of the motion.

The estimate uses differences of fourth order over five neighbouring points. Their weights annihilate any cubic in time,
whatever the time steps are, and are scaled so that white noise of standard deviation sigma gives differences of standard
deviation sigma. A smooth motion adds a part of order h^4 x''''/sqrt(70) for a step h: 0.01 mm at 240 fps for a mass that turns
at 50 rad/s 5 cm from the rod, where second differences would add 0.9 mm. Speeds are slopes of straight lines through seven
points. The law is fitted by an M-estimator with a bounded score function, so that a few stops, jolts and outliers have little
weight.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.optimize import nnls

from looping_pendulum.measured.observations import Channel, DataError
from looping_pendulum.reference_ode.geometry import Array

ORDER = 4
"""Order of the differences."""
SPEED_WINDOW = 7
"""Points of the straight line whose slope is the speed."""
MIN_DIFFERENCES = 20
"""Smallest number of differences to which the law is fitted."""
CLIP_SIGMAS = 2.5
"""Standardised size at which a squared difference is clipped; 1.2 % of Gaussian differences exceed it."""
MAX_WINDOW_RATIO = 1.6
"""Windows of points that are longer than this many median windows are left out.

They have gaps, over which the motion is no cubic, so that the differences would show it.
"""
GAUSSIAN_MAD = 1.4826
"""Standard deviation of a Gaussian in units of its median absolute value."""
MIN_SCALE = 1e-12
"""Smallest standard deviation [unit of the channel]: keeps divisions finite for data without noise."""


@dataclass(frozen=True, kw_only=True)
class Noise:
    """Noise law sigma = a + b |v| of one body; sigma is that of each component."""

    a: float
    """Standard deviation at rest [unit of the channel]."""
    b: float
    """Growth of the standard deviation with speed [s]: about half an exposure time."""

    def sigma(self, speed: Array) -> Array:
        """Return the standard deviation of a tracked point at ``speed`` [unit/s]."""
        return np.asarray(self.a + self.b * np.abs(speed))


def estimate_noise(channels: Sequence[Channel]) -> Noise:
    """Estimate the noise law of one body from its tracked points.

    Parameters
    ----------
    channels
        Components of its motion, as ``Observations.bodies()`` groups them.

    Raises
    ------
    DataError
        If there are too few points.
    """
    differences = [_differences(c, ORDER) for c in channels]
    count = sum(len(d) for _, d in differences)
    if count < MIN_DIFFERENCES:
        names = ", ".join(c.name for c in channels)
        raise DataError(f"{names}: found {count} runs of {ORDER + 1} points, needed {MIN_DIFFERENCES} to estimate their noise")
    difference = np.concatenate([d for _, d in differences])
    typical_sigma = _robust_standard_deviation(difference)
    speed = np.concatenate([speed_at(channels, t, typical_sigma) for t, _ in differences])
    a, b = fit_noise_law(difference, speed)
    return Noise(a=a, b=b)


def speed_at(channels: Sequence[Channel], t: Array, sigma: float = 0.0) -> Array:
    """Return the speed [unit/s] of a body at times ``t`` [s], by straight lines through neighbouring points.

    The noise ``sigma`` of the points adds its variance to the squared speed on average; it is subtracted.
    """
    square = np.zeros(len(t))
    for channel in channels:
        points = min(SPEED_WINDOW, len(channel))
        if points < 2:
            continue
        times = sliding_window_view(channel.t, points)
        centred = times - times.mean(axis=1, keepdims=True)
        spread = np.sum(centred**2, axis=1)
        slope = np.sum(centred * sliding_window_view(channel.value, points), axis=1) / spread
        mean_time = times.mean(axis=1)
        square += np.interp(t, mean_time, slope) ** 2 - np.interp(t, mean_time, sigma**2 / spread)
    return np.sqrt(np.maximum(square, 0.0))


def scatter(channel: Channel) -> float:
    """Return the typical size of a channel's differences of fourth order: of noise, and of times that are not the points'."""
    return _robust_standard_deviation(_differences(channel, ORDER)[1]) if len(channel) > ORDER else 0.0


def _differences(channel: Channel, order: int) -> tuple[Array, Array]:
    """Return mean times [s] and scaled differences of ``order``, which have unit variance for white noise of unit variance."""
    if len(channel) < order + 1:
        return np.zeros(0), np.zeros(0)
    t = sliding_window_view(channel.t, order + 1)
    x = (t - t.mean(axis=1, keepdims=True)) / (t[:, -1:] - t[:, :1])
    # Ones on the diagonal, where a point's distance from itself would make the product zero
    gaps = x[:, :, None] - x[:, None, :] + np.eye(order + 1)
    products = np.prod(gaps, axis=2)
    apart = products != 0  # of times that are nearly one, the product vanishes
    weights = 1 / np.where(apart, products, 1.0)  # of a divided difference: valid for uneven steps, too
    weights /= np.linalg.norm(weights, axis=1, keepdims=True)
    length = t[:, -1] - t[:, 0]
    kept = (length < MAX_WINDOW_RATIO * np.median(length)) & apart.all(axis=1)
    scaled = np.sum(weights * sliding_window_view(channel.value, order + 1), axis=1)
    return t.mean(axis=1)[kept], scaled[kept]


def _robust_standard_deviation(difference: Array) -> float:
    """Return a robust standard deviation about zero: 1.4826 times the median absolute value, as for a Gaussian."""
    return max(GAUSSIAN_MAD * float(np.median(np.abs(difference))), MIN_SCALE)


def fit_noise_law(difference: Array, speed: Array, clip: float = CLIP_SIGMAS) -> tuple[float, float]:
    """Fit sigma = a + b v with a, b >= 0 to differences that scatter by sigma; return a and b.

    It solves sum (1, v) chi(d / sigma) / sigma = 0, where chi(z) is min(z^2, clip^2) less its Gaussian mean: a smaller clip
    gives outliers less weight, a larger one estimates better.

    Parameters
    ----------
    difference
        Differences d [unit of the channel], shape (n,).
    speed
        Speeds v of the body at these [unit/s], shape (n,).
    """
    tail, density = math.erfc(clip / math.sqrt(2)), math.exp(-(clip**2) / 2) / math.sqrt(2 * math.pi)
    mean = 1 - tail - 2 * clip * density + clip**2 * tail
    typical_sigma = _robust_standard_deviation(difference)
    a, b = typical_sigma, 0.0
    for _ in range(200):
        sigma = np.maximum(a + b * speed, 1e-3 * typical_sigma)
        clipped = np.minimum(difference**2, (clip * sigma) ** 2) / mean
        # Linearised, the estimating equation is a weighted line through (sigma + clipped / sigma) / 2.
        target = 0.5 * (sigma + clipped / sigma)
        (new_a, new_b), _ = nnls(np.stack([1 / sigma, speed / sigma], axis=1), target / sigma)
        # Both in the unit of sigma, b by what it adds at a typical speed
        change = abs(new_a - a) + abs(new_b - b) * float(np.median(speed))
        a, b = new_a, new_b
        if change < 1e-9 * typical_sigma:
            break
    return max(float(a), MIN_SCALE), float(b)
