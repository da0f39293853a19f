"""How much the marks scatter, sigma = a + b |v|, from the data alone: no model of the motion enters.

Differences of fourth order over five neighbouring marks (weights that any cubic in time annihilates, so that uneven steps and
gaps do no harm), scaled so that white noise of standard deviation sigma gives them the standard deviation sigma. What a smooth
motion adds is of order h^4 x''''/sqrt(70) for a step h: at 240 fps, for a mass that turns at 50 rad/s 5 cm from the rod,
0.01 mm. Second differences would see 0.9 mm there. Speeds come from straight lines through seven marks. The law
is fitted by a bounded score, so that a few stops, jolts and wild marks do not count.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from looping_pendulum.discrepancy.data.observations import Channel, DataError
from looping_pendulum.reference_ode.geometry import Array

ORDER = 4
SPEED_POINTS = 7
FEWEST = 20
"""Differences below which no law is fitted."""
CLIP = 2.5
"""Standardised size beyond which a difference counts no more; 1.2 % of Gaussian ones."""
WIDEST = 1.6
"""Windows longer than this many median windows are left out: their gaps let the motion through."""
SMALLEST = 1e-12
"""Keeps logarithms and divisions finite for data without noise."""


@dataclass(frozen=True, kw_only=True)
class Noise:
    """Noise law sigma = a + b |v| of one moving thing, by component."""

    a: float
    """Standard deviation at rest [unit of the channel]."""
    b: float
    """Its growth with speed [s]: half an exposure time or so."""
    a_error: float
    b_error: float
    correlation: float
    """Of the errors of a and b."""
    count: int
    """How many differences it is estimated from."""
    curvature: float
    """By how much, relative to the scatter, the motion itself shows in the differences: an estimate of the bias of sigma.

    From differences of two orders more, which it would shrink. Compare with `a_error / a`."""

    def sigma(self, speed: Array) -> Array:
        """Standard deviation of a mark at ``speed``."""
        return np.asarray(self.a + self.b * np.abs(speed))


def estimate_noise(channels: Sequence[Channel], *, with_speed: bool = True) -> Noise:
    """Estimate the noise law of one moving thing from its own marks.

    Parameters
    ----------
    channels
        Its components, as ``Observations.bodies()`` groups them.
    with_speed
        Whether scatter may grow with speed; else b = 0.

    Raises
    ------
    DataError
        If there are too few marks.
    """
    chosen = [_differences(c, ORDER) for c in channels]
    count = sum(len(d) for _, d in chosen)
    if count < FEWEST:
        names = ", ".join(c.name for c in channels)
        raise DataError(f"{names}: found {count} runs of {ORDER + 1} marks, needed {FEWEST} to estimate their scatter")
    difference = np.concatenate([d for _, d in chosen])
    level = _scale(difference)
    speed = np.concatenate([speed_at(channels, t, level) for t, _ in chosen])
    a, b = _fit(difference, speed, level, with_speed)
    a_error, b_error, correlation = _errors(difference, speed, a, b, with_speed)
    return Noise(
        a=a,
        b=b,
        a_error=a_error,
        b_error=b_error,
        correlation=correlation,
        count=count,
        curvature=_curvature(channels, level),
    )


def speed_at(channels: Sequence[Channel], t: Array, sigma: float = 0.0) -> Array:
    """Speed [unit/s] at times ``t`` of what the channels see, from lines through neighbouring marks.

    The scatter ``sigma`` of the marks adds to a squared speed on average, and that much is taken off.
    """
    square = np.zeros(len(t))
    for channel in channels:
        points = min(SPEED_POINTS, len(channel))
        if points < 2:
            continue
        times = sliding_window_view(channel.t, points)
        centred = times - times.mean(axis=1, keepdims=True)
        spread = np.sum(centred**2, axis=1)
        slope = np.sum(centred * sliding_window_view(channel.value, points), axis=1) / spread
        middle = times.mean(axis=1)
        square += np.interp(t, middle, slope) ** 2 - np.interp(t, middle, sigma**2 / spread)
    return np.sqrt(np.maximum(square, 0.0))


def _differences(channel: Channel, order: int) -> tuple[Array, Array]:
    """Times [s] and scaled differences of ``order``; of unit variance for white noise of unit variance."""
    if len(channel) < order + 1:
        return np.zeros(0), np.zeros(0)
    t = sliding_window_view(channel.t, order + 1)
    x = (t - t.mean(axis=1, keepdims=True)) / (t[:, -1:] - t[:, :1])
    gaps = x[:, :, None] - x[:, None, :] + np.eye(order + 1)
    weights = 1 / np.prod(gaps, axis=2)  # a divided difference
    weights /= np.linalg.norm(weights, axis=1, keepdims=True)
    length = t[:, -1] - t[:, 0]
    kept = length < WIDEST * np.median(length)
    scaled = np.sum(weights * sliding_window_view(channel.value, order + 1), axis=1)
    return t.mean(axis=1)[kept], scaled[kept]


def _scale(difference: Array) -> float:
    """Robust standard deviation about zero: 1.4826 is that of a Gaussian per median absolute value."""
    return max(1.4826 * float(np.median(np.abs(difference))), SMALLEST)


def _expected(power: int) -> float:
    """Mean of min(z^2, CLIP^2) (power 1) or its square (2) for Gaussian z."""
    tail = math.erfc(CLIP / math.sqrt(2))
    density = math.exp(-(CLIP**2) / 2) / math.sqrt(2 * math.pi)
    second = 1 - tail - 2 * CLIP * density
    if power == 1:
        return second + CLIP**2 * tail
    return 3 * second - 2 * CLIP**3 * density + CLIP**4 * tail


def _fit(difference: Array, speed: Array, level: float, with_speed: bool) -> tuple[float, float]:
    """Solve sum (1, v) chi(d / sigma) / sigma = 0 for a, b >= 0, chi(z) = min(z^2, CLIP^2) less its Gaussian mean."""
    mean = _expected(1)
    a, b = level, 0.0
    for _ in range(200):
        sigma = np.maximum(a + b * speed, 1e-3 * level)
        clipped = sigma**2 * np.minimum((difference / sigma) ** 2, CLIP**2) / mean
        # A weighted line through squares, linearised: sigma_new = (sigma + clipped / sigma) / 2.
        target = 0.5 * (sigma + clipped / sigma)
        new_a, new_b = _line(speed, target, 1 / sigma**2, with_speed)
        moved = abs(new_a - a) + abs(new_b - b) * float(np.median(speed))
        a, b = new_a, new_b
        if moved < 1e-9 * level:
            break
    return a, b


def _line(v: Array, y: Array, weight: Array, with_speed: bool) -> tuple[float, float]:
    """Weighted line y = a + b v with a, b >= 0."""
    total = float(weight.sum())
    flat = max(float(weight @ y) / total, SMALLEST)
    if not with_speed:
        return flat, 0.0
    middle = float(weight @ v) / total
    spread = float(weight @ (v - middle) ** 2)
    if spread <= 1e-12 * total * (middle**2 + SMALLEST):
        return flat, 0.0
    b = float(weight @ ((v - middle) * y)) / spread
    a = float(weight @ y) / total - b * middle
    if b < 0:
        return flat, 0.0
    if a < 0:
        return SMALLEST, float(weight @ (v * y)) / float(weight @ v**2)
    return a, b


def _errors(difference: Array, speed: Array, a: float, b: float, with_speed: bool) -> tuple[float, float, float]:
    """Standard errors of a and b and their correlation; windows overlap, so differences are fewer than they look."""
    sigma = np.maximum(a + b * speed, SMALLEST)
    tail = math.erfc(CLIP / math.sqrt(2))
    density = math.exp(-(CLIP**2) / 2) / math.sqrt(2 * math.pi)
    gain = 2 * (1 - tail - 2 * CLIP * density)  # mean of z chi'(z)
    variance = _expected(2) - _expected(1) ** 2
    factor = variance / gain**2 * overlap(ORDER)
    design = np.stack([np.ones_like(speed), speed], axis=1) if with_speed else np.ones((len(speed), 1))
    normal = (design / sigma[:, None]).T @ (design / sigma[:, None])
    if not with_speed or np.linalg.cond(normal) > 1e12:
        return math.sqrt(factor / float(normal[0, 0])), math.inf if with_speed else 0.0, 0.0
    covariance = factor * np.linalg.inv(normal)
    errors = np.sqrt(np.diag(covariance))
    return float(errors[0]), float(errors[1]), float(covariance[0, 1] / (errors[0] * errors[1]))


def overlap(order: int) -> float:
    """How many times the variance of a mean square of overlapping differences exceeds that of independent ones."""
    whole = math.comb(2 * order, order)
    return 1 + 2 * sum((math.comb(2 * order, order + j) / whole) ** 2 for j in range(1, order + 1))


def _curvature(channels: Sequence[Channel], level: float) -> float:
    """Relative excess of the scatter by fourth over that by sixth differences; never below zero."""
    higher = [d for d in (_differences(c, ORDER + 2)[1] for c in channels) if len(d)]
    if not higher or level <= SMALLEST:
        return 0.0
    finer = _scale(np.concatenate(higher))
    return max(level / finer - 1, 0.0)
