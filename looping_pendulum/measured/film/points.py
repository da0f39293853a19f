"""Points of a mass, with their errors: what a codec, noise, shading and streaks do to its centre, and which are left out."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import maximum_filter1d, median_filter

from looping_pendulum.measured.film.moving import MovingPath
from looping_pendulum.measured.film.record import Points
from looping_pendulum.reference_ode.geometry import Array

CENTRE_ERROR, NOISE_ERROR = 0.05, 0.3
"""Scatter of a disc's centre by what a codec does to its edge [pixels], and by noise, in units of noise over contrast."""
SHARED_ERROR = 10.0
"""Error that points less than the mass's radius apart share, times the mass's contrast [pixels levels].

Shading, the string and lines of the background pull a centre the more, the paler the mass is; scatter does not show it.
"""
WIDTHS = 25
"""Points whose median is the usual width of a mass."""
STREAK_ERROR = 0.03
"""Error of a streak's middle, as a share of the way during the exposure."""
OUTLIER_SIGMAS = 5.0
"""Departure of a single point from a cubic through its neighbours, in their usual ones, from which on it is left out."""
SMOOTH_SECONDS = 0.0225
"""Time on either side of a point for this cubic [s]; eight points in all at least."""


def mass_points(
    mass: str, rows: MovingPath, t: Array, streak: Array, noise: float, unit: float,
    edge_error: float = 0.0, course: tuple[Array, Array] | None = None,
) -> tuple[Points, dict[str, int]]:  # fmt: skip
    """Return the points of a mass of that name, and why others are left out -> how many.

    Parameters
    ----------
    rows
        The mass in each frame in which it was found, shape (n, 7).
    t
        Time of each frame of the film [s].
    streak
        Way of the mass during the exposure [pixels], shape (n,).
    noise
        Standard deviation of a pixel [levels].
    unit
        A pixel of a picture 1280 wide [pixels].
    edge_error
        Error of the height beside the others [pixels].
    course
        Coordinates that change more smoothly than x and y, and pixels per unit of both, shape (n, 2) each.
    """
    frame, place, contrast, width = rows[:, 0].astype(int), rows[:, 1:3], rows[:, 4], rows[:, 6]
    smooth, size = (place, np.ones_like(place)) if course is None else course
    expected = CENTRE_ERROR + NOISE_ERROR * noise / contrast
    # By so much the centre moves where a part is hidden
    off = 0.5 * np.abs(width - median_filter(width, WIDTHS, mode="nearest"))
    moving = speed(t[frame], place)
    usual = 1.4826 * np.median(off[moving > 0.1 * moving.max()])  # at rest, a codec repeats a picture
    keep = off < OUTLIER_SIGMAS * np.hypot(expected, usual)
    whole, factor = keep.copy(), 1.0
    for _ in range(3):
        chosen = np.flatnonzero(keep)
        distance, leverage = from_cubic(t[frame[chosen]], smooth[chosen], size[chosen])
        relative = distance / (leverage * expected[chosen])
        known = np.isfinite(relative)
        if not known.any():
            break
        # The median distance of a normal law in two dimensions is 1.18 standard deviations
        factor = float(np.clip(np.median(relative[known]) / 1.18, 1.0, 10))
        wrong = known & (relative > OUTLIER_SIGMAS * 1.4 * factor) & (distance > 0.5 * unit)
        if not wrong.any():
            break
        # The worst of neighbours first: it leads their cubics astray, too
        keep[chosen[wrong & (relative == maximum_filter1d(np.nan_to_num(relative), 9))]] = False
    left_out = {
        f"{mass} mass partly hidden, or one with another thing": int(np.sum(~whole)),
        f"{mass} mass off the course of its neighbours": int(np.sum(whole & ~keep)),
    }
    place, contrast, streak, width = place[keep], contrast[keep], streak[keep], width[keep]
    own = np.hypot(factor * expected[keep], STREAK_ERROR * streak)
    shared = np.stack([SHARED_ERROR / contrast] * 2 + [np.full(len(place), edge_error)])
    times = [_in_a_row(place, 0.5 * width)] * 2 + [_in_a_row(place[:, 1:], np.full(len(place), 0.5))]

    def error_of(x: Array, y: Array, edge: Array) -> Array:
        return np.stack([np.hypot(own, x), np.hypot(np.hypot(own, y), edge)], axis=1)

    points = Points(
        frame=frame[keep],
        place=place,
        error=error_of(*shared),
        counted_error=error_of(*(shared * np.sqrt(times))),
        # Across its way, of the half of its pictures in which it is slower
        radius=0.5 * float(np.median(width[streak <= np.median(streak)])),
    )
    return points, left_out


def _in_a_row(place: Array, reach: Array) -> Array:
    """Return how many points in a row are less than its reach from each, itself included, of places (n, axes)."""
    count = np.empty(len(place))
    for i, (here, near) in enumerate(zip(place, reach, strict=True)):
        far = np.flatnonzero(np.linalg.norm(place - here, axis=1) >= near)
        k = int(np.searchsorted(far, i))
        count[i] = (far[k] if k < len(far) else len(place)) - (far[k - 1] if k else -1) - 1
    return count


def speed(t: Array, place: Array) -> Array:
    """Return the speed at each point of a track [pixels/s], shape (n,), without outliers."""
    smooth = median_filter(place, (5, 1), mode="nearest")
    return np.asarray(np.hypot(*np.gradient(smooth, t, axis=0).T)) if len(t) > 1 else np.zeros(len(t))


def from_cubic(t: Array, points: Array, size: Array | float = 1.0) -> tuple[Array, Array]:
    """Return the distance of each point from a cubic through its neighbours, and the usual one along the track.

    Parameters
    ----------
    t
        Times [s], shape (n,).
    points
        Shape (n, 2).
    size
        Pixels per unit of both coordinates at each point, shape (n, 2), if they are not in pixels.

    Returns
    -------
    distance
        [pixels], nan with fewer than six neighbours, shape (n,).
    leverage
        Standard deviation of the distance per axis for points of unit error, shape (n,).
    """
    n = len(t)
    distance, leverage = np.full(n, np.nan), np.ones(n)
    size = np.broadcast_to(size, points.shape)
    for i in range(n):
        span = slice(max(i - 12, 0), i + 13)
        near = np.flatnonzero(np.abs(t[span] - t[i]) < SMOOTH_SECONDS) + span.start
        if len(near) < 9:
            near = np.arange(max(i - 4, 0), min(i + 5, n))
            if len(near) < 9 or np.ptp(t[near]) > 4 * SMOOTH_SECONDS:
                continue
        near = near[near != i]
        width = float(np.max(np.abs(t[near] - t[i])))
        powers = np.vander((t[near] - t[i]) / width, 4, increasing=True)
        weight = np.linalg.pinv(powers)[0]
        distance[i] = float(np.hypot(*((weight @ points[near] - points[i]) * size[i])))
        leverage[i] = float(np.sqrt(1 + weight @ weight))
    return distance, leverage
