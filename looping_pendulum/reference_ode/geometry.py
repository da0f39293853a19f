"""Convert string coordinates (free length l, wrap angle theta) to x and y, and back. The origin is the rod's centre."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def xy_pairs(x: Any, y: Any) -> Array:
    """Return coordinates as pairs, shape (..., 2), for those of shapes that go together; much faster than `numpy.stack`."""
    pairs = np.empty((*np.broadcast(x, y).shape, 2), dtype=np.result_type(x, y))
    pairs[..., 0], pairs[..., 1] = x, y
    return pairs


def light_position(xp: Any, free_length: Any, wrap_angle: Any, rod_radius: Any) -> tuple[Any, Any]:
    """Return the position (x, y) of the light mass [m] (paper, sec. II).

    It is x = R cos(theta) - l sin(theta), y = R sin(theta) + l cos(theta).
    """
    cosine, sine = xp.cos(wrap_angle), xp.sin(wrap_angle)
    return rod_radius * cosine - free_length * sine, rod_radius * sine + free_length * cosine


def light_velocity(xp: Any, wrap_angle: Any, retreat_speed: Any, across_speed: Any) -> tuple[Any, Any]:
    """Return the velocity (x, y) of the light mass [m/s]: -u e1 + w t1 (paper, eq. v1)."""
    return vector_xy(xp, wrap_angle, -retreat_speed, across_speed)


def vector_xy(xp: Any, wrap_angle: Any, along: Any, across: Any) -> tuple[Any, Any]:
    """Return the components (x, y) of a vector with these components along e1 and t1, see `effects`."""
    cosine, sine = xp.cos(wrap_angle), xp.sin(wrap_angle)
    return along * sine - across * cosine, -along * cosine - across * sine


def next_string_coordinates(x: float, y: float, rod_radius: float, wrap_angle: float) -> tuple[float, float]:
    """Return free length [m], at least 1e-8, and wrap angle [rad] of one position of the light mass.

    This is :func:`string_coordinates` step by step: ``wrap_angle`` is that of less than half a turn ago, from which turns are
    counted on.
    """
    # An engine's step may end inside the rod, while forces divide by the length
    free_length = math.sqrt(max(x * x + y * y - rod_radius * rod_radius, 1e-16))
    angle = math.atan2(y, x) - math.atan2(free_length, rod_radius)
    return free_length, wrap_angle + ((angle - wrap_angle + math.pi) % (2 * math.pi) - math.pi)


def string_from_rod(x: Any, y: Any, rod_radius: Any) -> tuple[Any, Any]:
    """Return free length and bearing [rad] at which a taut string leaves the rod, whose centre is the origin, to a place x, y.

    The unit of length is that of the arguments, numbers or arrays. The bearing has no turns: -1.5 pi to pi.
    """
    free_length = np.sqrt(np.maximum(x * x + y * y - rod_radius**2, 0.0))
    return free_length, np.arctan2(y, x) - np.arctan2(free_length, rod_radius)


def string_coordinates(light_position: Array, rod_radius: float, release_angle: float) -> tuple[Array, Array]:
    """Return free length [m] and wrap angle [rad], turns counted, of a light mass at ``light_position`` (n, 2) [m].

    This is the inverse of :func:`light_position` for a taut string. Samples must be closer than half a turn.
    """
    free_length, angle = string_from_rod(light_position[:, 0], light_position[:, 1], rod_radius)
    # The release angle stands first, as NumPy counts turns from the first value
    unwrapped = np.unwrap(np.concatenate([[release_angle], angle]))[1:]
    return free_length, unwrapped
