"""Tell the masses from all else that moves: the heavy one falls along its vertical, the light one hangs on a taut string.

With d the distance of the light mass from the rod's centre and r the rod's radius, the string that is free is sqrt(d^2 - r^2),
it leaves the rod at the bearing phi, and what the heavy mass drops is taken from it:

    sqrt(d^2 - r^2) + r phi + drop = C,   the same in every picture.

Every blob votes by this for the height of the rod and for C. A hand, a shadow or somebody who walks by agrees with no C for
long, so that the one that most pictures agree upon is the string's, and with its declared length gives the scale. All lengths
here are in pixels, y downwards, unless they say [m]. ``side`` is 1 where the heavy mass hangs on the right of the rod and the
light one loops counterclockwise, -1 for the mirror image.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter
from scipy.optimize import least_squares

from looping_pendulum.film.decode import FilmError
from looping_pendulum.film.moving import Blob, Blobs, Path
from looping_pendulum.reference_ode.geometry import Array

MIN_FALL = 0.06
"""Shortest fall, as a share of the picture's height."""
MAX_LEAN = 0.12
"""Largest slope of the fall against the picture's vertical: seven degrees."""
MAX_RISE = 0.1
"""Largest share of its way down by which the heavy mass may go up again."""
MAX_STRING_RESIDUAL = 3.0
"""Scatter of the string's length above which it was not the string [pixels of a picture 1280 wide]."""
MAX_BESIDE = 6.0
"""Distance of the heavy mass's vertical from the rod's edge above which it was not the rod [pixels of a picture 1280 wide]."""
MIN_SHARE = 0.5
"""Share of the pictures after the release in which the light mass must be found."""
MIN_SWEEP = 2.0
"""Smallest angle that the light mass must travel [rad]."""
SHARE_SECONDS = 0.8
"""Time after the release over which `MIN_SHARE` is asked for [s]."""
VOTE_STEP = 2.0
"""Step of the rod's height in the vote [pixels of a picture 1280 wide]."""
VOTE_BIN = 6.0
"""Width of a bin of the string's length in the vote [pixels of a picture 1280 wide]."""
MAX_PROPOSALS = 5
"""Most results of the vote that are tried."""
OUTLIER_SIGMAS = 5.0
"""Departure of a single point from a cubic through its neighbours, in their usual ones, from which on it is left out."""
SMOOTH_SECONDS = 0.0225
"""Time on either side of a point for this cubic [s]; eight points in all at least."""


REST_ERROR = 0.12
"""Error that all pictures of the resting heavy mass share, against those of the moving one [pixels]."""
BEGINNING = 0.14
"""Part of the fall that tells the release [s]; over it, the acceleration's next part would shift the release by 0.1 ms."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Fall:
    """The heavy mass in all frames in which it was found."""

    rows: Path
    """One row (frame, x, y, area, contrast, length, width) for each frame."""
    slope: float
    """Of its vertical: x = offset + slope y."""
    offset: float
    first: int
    """Last frame before it moves, or one of the two before."""
    last: int
    """Frame at which most of the fall is over."""

    def column(self, y: Array | float) -> Array | float:
        """Return x on the vertical of the heavy mass at heights y."""
        return self.offset + self.slope * y

    def has(self, path: Path) -> bool:
        """Return whether most of a path is this mass."""
        own = {int(row[0]): row for row in self.rows}
        shared = [(row, own[int(row[0])]) for row in path if int(row[0]) in own]
        same = sum(bool(np.hypot(row[1] - mass[1], row[2] - mass[2]) < 0.5 * mass[6]) for row, mass in shared)
        return 2 * same > len(path)

    def heights(self, frames: int) -> Array:
        """Return y of the mass in every frame, interpolated, and at rest up to `first`, shape (frames,)."""
        k, y = self.rows[:, 0], self.rows[:, 2]
        smooth = median_filter(y, 5, mode="nearest") if len(y) > 8 else y
        filled = np.interp(np.arange(frames), k, smooth)
        rest = y[k <= self.first]
        filled[: self.first + 1] = np.median(rest) if len(rest) >= 3 else filled[self.first]
        return filled


def falls(moving: Sequence[Path], height: float) -> list[Path]:
    """Return the paths that lead straight down, best first: a shadow falls, too, but with less contrast."""
    scored = []
    for path in moving:
        x, y = path[:, 1], path[:, 2]
        way = float(np.ptp(y))
        if way < MIN_FALL * height or len(path) < 4:
            continue
        line = np.polyfit(y, x, 1)
        if abs(line[0]) > MAX_LEAN or np.std(x - np.polyval(line, y)) > 0.005 * height:
            continue
        if -np.minimum(np.diff(y), 0).sum() > MAX_RISE * way + 0.004 * height:
            continue
        scored.append((way * float(np.median(path[:, 4])), path))
    return [path for _, path in sorted(scored, key=lambda each: -each[0])]


def heavy_mass(blobs: Blobs, candidates: Sequence[Path], t: Array, unit: float) -> Fall:
    """Return the heavy mass in all frames: its falls along one vertical, and blobs there that continue them.

    Blobs elsewhere on the vertical are shadows, or places where the background still shows the resting mass.
    """
    best = candidates[0]
    slope, offset = _vertical(best)
    area, contrast = np.median(best[:, 3]), np.median(best[:, 4])
    rows: dict[int, Array] = {}
    for path in candidates:
        is_aside = abs(np.median(path[:, 1] - offset - slope * path[:, 2])) > 3 * unit
        if is_aside or abs(np.log(np.median(path[:, 4]) / contrast)) > 0.5 or abs(np.log(np.median(path[:, 3]) / area)) > 0.5:
            continue
        for row in path:
            if abs(row[1] - offset - slope * row[2]) < 6 * unit:
                rows.setdefault(int(row[0]), row)
    usual = float(np.median(np.diff(t)))
    k = np.array(sorted(rows))
    y = np.array([rows[i][2] for i in k])
    steady = abs(y - median_filter(y, 5, mode="nearest")) < unit * (20 + 1200 * usual)
    k, y = k[steady], y[steady]
    rows = {int(i): rows[int(i)] for i in k}
    moves = int(k[np.argmax(y > y.min() + 2 * unit)])
    halts = int(k[np.argmax(y > y.min() + 0.85 * np.ptp(y))])

    def nearest(frame: int, height: float, gate: float) -> Array | None:
        near = [
            b
            for b in blobs.get(frame, ())
            if abs(b.x - offset - slope * b.y) < 3 * unit and abs(b.y - height) < gate
            and abs(np.log(b.area / area)) < 0.35 and abs(np.log(b.contrast / contrast)) < 0.6
        ]  # fmt: skip
        return np.array(min(near, key=lambda b: abs(b.y - height))[:7], dtype=float) if near else None

    for frame in range(int(k[0]) + 1, int(k[-1])):
        if frame not in rows and (row := nearest(frame, float(np.interp(frame, k, y)), unit * (8 + 400 * usual))) is not None:
            rows[frame] = row
    for step, end, place, share in ((1, int(k[-1]), y[-1], 2), (-1, int(k[0]), y[0], 1)):
        for frame in range(end + step, len(t) if step > 0 else -1, step):
            last = [rows[i] for i in range(frame - step, frame - 6 * step, -step) if i in rows]
            if len(last) >= 4:  # on at its speed: where the light mass crosses it, it is lost or displaced in a picture or two
                past = np.array([(t[int(row[0])] - t[frame], row[2]) for row in last])
                place = float(np.polyfit(past[:, 0], past[:, 1], 1)[1])
            if (row := nearest(frame, place, unit * (4 + 300 * usual * share))) is not None:
                rows[frame] = row
                place = row[2]
    return Fall(rows=np.array([rows[i] for i in sorted(rows)]), slope=slope, offset=offset, first=max(moves - 3, 0), last=halts)


def _vertical(path: Path) -> tuple[float, float]:
    """Return slope and offset of the line x = offset + slope y through a path, without outliers."""
    middle = float(path[:, 2].mean())
    fit = least_squares(
        lambda p: p[0] * (path[:, 2] - middle) / 100 + p[1] - path[:, 1],
        [0, np.median(path[:, 1])],
        loss="soft_l1",
        f_scale=0.4,
    )
    slope = float(fit.x[0]) / 100
    return slope, float(fit.x[1]) - slope * middle


@dataclass(frozen=True, kw_only=True, eq=False)
class String:
    """Where the rod is, and how long the string."""

    side: int
    rod: tuple[float, float]
    """Centre of the rod."""
    radius: float
    """Of the rod."""
    constant: float
    """C of the module's formula."""
    gate: float
    """Largest departure from it of a blob that may be the light mass."""

    def at(self, points: Array) -> tuple[Array, Array]:
        """Return the free length and the bearing at which the string leaves the rod, as `string_at` does, of points (n, 2)."""
        return string_at(points, self.rod, self.radius, self.side)

    def beside(self, fall: Fall) -> float:
        """Return how far right of the heavy mass's vertical the rod's edge is from which that mass hangs."""
        return self.rod[0] + self.side * self.radius - float(fall.column(self.rod[1]))


_CUT = -0.2
"""Least bearing of the string in the first turn [rad]: the light mass is let go between straight up and straight down."""


def string_at(points: Array, rod: tuple[Array | float, Array | float], radius: Array | float, side: int) -> tuple[Array, Array]:
    """Return the free length and the bearing at which the string leaves the rod, of the light mass at points (n, 2)."""
    u, v = (points[:, 0] - rod[0]) * side, rod[1] - points[:, 1]
    d = np.hypot(u, v)
    free = np.sqrt(np.maximum(d * d - radius * radius, 1.0))
    phi = np.arctan2(v, u) - np.arccos(np.minimum(radius / np.maximum(d, radius), 1.0))
    return free, (phi - _CUT) % (2 * np.pi) + _CUT


def vote(
    blobs: Blobs, fall: Fall, heights: Array, ratio: float, size: tuple[int, int], last: int,
    rod: tuple[float, float] | None = None,
) -> list[String]:  # fmt: skip
    """Return the strings that most pictures from the release to ``last`` agree upon, best first.

    Parameters
    ----------
    heights
        y of the heavy mass in each frame.
    ratio
        Radius of the rod over the free length at the release.
    size
        Width and height of the picture.
    rod
        Centre of the rod, if a person has shown it.

    Raises
    ------
    FilmError
        If nothing but the heavy mass moves.
    """
    unit = max(size) / 1280
    own = {int(row[0]): row for row in fall.rows}
    points = np.array([
        (b.frame, b.x, b.y)
        for frame in range(fall.first, last)
        for b in blobs.get(frame, ())
        if frame not in own or np.hypot(b.x - own[frame][1], b.y - own[frame][2]) > 0.5 * b.width
    ])  # fmt: skip
    if len(points) < 6:
        raise FilmError("found nothing that moves beside the heavy mass, needed the light mass")
    frame = points[:, 0].astype(int)
    drop = heights[frame] - heights[fall.first]
    top = heights[fall.first]
    rows = np.arange(top - 0.6 * size[1], top - 4 * unit, VOTE_STEP * unit) if rod is None else np.array([rod[1]])
    bins = VOTE_BIN * unit
    found: list[tuple[float, String]] = []
    for side in (1, -1):
        for y in rows:
            vertical = float(fall.column(y)) if rod is None else rod[0]
            d = np.hypot(points[:, 1] - vertical, points[:, 2] - y)
            radius: Array = ratio * (d + drop)
            for _ in range(2):
                centre = vertical - side * radius if rod is None else vertical
                free, phi = string_at(points[:, 1:], (centre, y), radius, side)
                radius = ratio * (free + drop + radius * (phi - 0.5 * np.pi))
            constant = free + radius * phi + drop
            for shift in (0.0, 0.5):
                best = _fullest_bin(np.floor(constant / bins + shift).astype(int), frame - fall.first, phi)
                for score, index in best:
                    level = (index + 0.5 - shift) * bins
                    r = ratio * level / (1 + 0.5 * np.pi * ratio)
                    place = (vertical - side * r, y) if rod is None else rod
                    found.append((score, String(side=side, rod=place, radius=r, constant=level, gate=8 * unit)))
    found.sort(key=lambda each: -each[0])
    chosen: list[String] = []
    for _, string in found:
        if all(
            string.side != c.side or abs(string.rod[1] - c.rod[1]) > 10 * unit or abs(string.constant - c.constant) > 15 * unit
            for c in chosen
        ):
            chosen.append(string)
        if len(chosen) == MAX_PROPOSALS:
            break
    return chosen


def _fullest_bin(index: NDArray[np.intp], frame: NDArray[np.intp], phi: Array) -> list[tuple[float, int]]:
    """Return the scores and numbers of the two bins with most frames, times the angle that their points sweep."""
    index = np.clip(index, 0, 4000)
    pairs = np.unique(index * (int(frame.max()) + 1) + frame)
    frames = np.bincount(pairs // (int(frame.max()) + 1))
    low, high = np.full(len(frames), np.inf), np.full(len(frames), -np.inf)
    np.minimum.at(low, index, phi)
    np.maximum.at(high, index, phi)
    sweep = np.where(frames > 3, high - low, 0.0)
    score = frames * np.clip(np.minimum(sweep, MIN_SWEEP) - 0.7, 0.0, None)
    best = np.argsort(score)[-2:]
    return [(float(score[b]), int(b)) for b in best if score[b] > 0]


@dataclass(frozen=True, kw_only=True, eq=False)
class LightMass:
    """The light mass in the frames in which it was found, by frame."""

    blobs: tuple[Blob, ...]
    phi: Array
    """Bearing of the string, with all turns [rad], shape (n,)."""
    residual: Array
    """Departure of the string's length from the taut one [pixels], shape (n,)."""

    @property
    def frames(self) -> NDArray[np.intp]:
        """Return the frames' numbers, shape (n,)."""
        return np.array([b.frame for b in self.blobs], dtype=int)

    @property
    def points(self) -> Array:
        """Return the centres, shape (n, 2)."""
        return np.array([(b.x, b.y) for b in self.blobs], dtype=float).reshape(-1, 2)


def follow(
    blobs: Blobs, moving: Sequence[Path], fall: Fall, heights: Array, string: String, t: Array, unit: float,
    seed: tuple[int, float, float] | None = None,
) -> LightMass | None:  # fmt: skip
    """Return the light mass on a string: from the path that agrees best with it, forwards and backwards in time.

    Parameters
    ----------
    seed
        Frame and place at which a person has shown the light mass.

    Returns
    -------
    light
        None if no path agrees.
    """
    own = {int(row[0]): (row[1], row[2]) for row in fall.rows}
    drop = heights - heights[fall.first]
    start = _seed(moving, own, drop, string, fall.first, seed)
    if start is None:
        return None
    history = [(t[b.frame], phi) for b, phi, _ in start]
    found = {b.frame: (b, phi, e) for b, phi, e in start}
    area = float(np.median([b.area for b, _, _ in start]))
    contrast = float(np.median([b.contrast for b, _, _ in start]))
    frames = [k for k in sorted(blobs) if k >= max(fall.first - 60, 0)]
    for forward in (True, False):
        past = list(history) if forward else list(reversed(history))
        todo = [k for k in frames if (k > start[-1][0].frame if forward else k < start[0][0].frame)]
        size = area
        for k in todo if forward else reversed(todo):
            at_rest = not forward and k <= fall.first
            best = _next(blobs[k], own.get(k), drop[k], string, past, t[k], size, contrast, unit, at_rest=at_rest)
            if best is not None:
                found[k] = best
                past.append((t[k], best[1]))
                size = 0.8 * size + 0.2 * best[0].area
    chosen = [found[k] for k in sorted(found)]
    return LightMass(
        blobs=tuple(b for b, _, _ in chosen),
        phi=np.array([p for _, p, _ in chosen]),
        residual=np.array([e for _, _, e in chosen]),
    )


_Step = tuple[Blob, float, float]
"""A blob, the string's bearing with all turns, and the departure of the string's length."""


def _seed(
    moving: Sequence[Path], own: dict[int, tuple[float, float]], drop: Array, string: String, first: int,
    shown: tuple[int, float, float] | None,
) -> list[_Step] | None:  # fmt: skip
    """Return some points in a row of the path that agrees best with the string in the first turn."""
    best: tuple[float, list[_Step]] = (0.0, [])
    for path in moving:
        path = path[path[:, 0] >= first]
        if len(path) < 3:
            continue
        frame = path[:, 0].astype(int)
        free, phi = string.at(path[:, 1:3])
        phi = np.unwrap(phi)
        e = free + string.radius * phi + drop[frame] - string.constant
        good = np.abs(e) < string.gate
        good &= np.array(
            [k not in own or np.hypot(x - own[k][0], y - own[k][1]) > 4 for k, (x, y) in zip(frame, path[:, 1:3], strict=True)]
        )
        if shown is not None:
            near = np.flatnonzero(frame == shown[0])
            if not len(near) or np.hypot(*(path[near[0], 1:3] - shown[1:])) > 0.03 * string.constant:
                continue
            good |= True
        ends = np.flatnonzero(np.diff(np.concatenate([[0], good.astype(int), [0]])))
        for a, b in ends.reshape(-1, 2):
            sweep = phi[b - 1] - phi[a]  # it loops towards growing bearings
            score = (b - a) * max(sweep, 0.0)
            if b - a >= 3 and score > best[0]:
                best = score, [(_blob(path[i]), float(phi[i]), float(e[i])) for i in range(a, b)]
    return best[1] or None


def _blob(row: Array) -> Blob:
    x, y, area, contrast, length, width = (float(v) for v in row[1:7])
    return Blob(int(row[0]), x, y, area, contrast, length, width)


def _next(
    here: Sequence[Blob], heavy: tuple[float, float] | None, drop: float, string: String, past: list[tuple[float, float]],
    now: float, area: float, contrast: float, unit: float, *, at_rest: bool,
) -> _Step | None:  # fmt: skip
    """Return the blob that continues the light mass's way: along it by the angle's course, across it by the taut string."""
    recent = np.array(past[-5:])
    dt = abs(now - recent[-1, 0])
    degree = min(len(recent) - 1, 2) if not at_rest else 0
    course = np.polynomial.Polynomial.fit(recent[:, 0] - recent[-1, 0], recent[:, 1], degree) if degree else None
    expected = recent[-1, 1] if course is None else float(course(now - recent[-1, 0]))
    rate = 0.0 if course is None else abs(float(course.deriv()(0.0)))
    best: tuple[float, _Step] | None = None
    for b in here:
        if heavy is not None and np.hypot(b.x - heavy[0], b.y - heavy[1]) < 2 * unit:
            continue
        (free,), (phi,) = string.at(np.array([[b.x, b.y]]))
        phi += 2 * np.pi * round((expected - phi) / (2 * np.pi))
        e = free + string.radius * phi + drop - string.constant
        along = (phi - expected) * free
        gate_along = unit * 6 + (0.25 * rate * dt + 100 * dt * dt) * max(free, 20 * unit)
        gate_across = string.gate + 0.02 * free * rate * dt
        change = abs(np.log(b.area / area))
        # A hand, or the rod, may have stopped it anywhere on its way
        beyond = max(min(expected, recent[-1, 1]) - phi, phi - max(expected, recent[-1, 1]), 0.0) * free
        has_stopped = beyond < 6 * unit and change < 0.5 and b.contrast > 0.7 * contrast
        if abs(e) > gate_across or (abs(along) > gate_along and not has_stopped) or change > 1.6:
            continue
        cost = (e / gate_across) ** 2 + (along / gate_along) ** 2 + change**2 - 0.3 * min(b.contrast / contrast, 1.5)
        if best is None or cost < best[0]:
            best = cost, (b, float(phi), float(e))
    return None if best is None else best[1]


def refined(
    light: LightMass, heights: Array, fall: Fall, string: String, ratio: float, unit: float,
    start: float = 0.5 * np.pi, rod_fixed: bool = False,
) -> tuple[String, Array, Array]:  # fmt: skip
    """Fit the rod's centre and the string's length to the light mass's points, without outliers.

    Parameters
    ----------
    ratio
        Radius of the rod over the free length at the release.
    start
        Bearing of the string at the release [rad].
    rod_fixed
        Whether the rod's centre is known.

    Returns
    -------
    string
        With its gate by the points' scatter.
    residual
        Departure of each point from the taut string [pixels], shape (n,).
    covariance
        Of the rod's x and y and of C [pixels^2], shape (3, 3).
    """
    points, drop = light.points, heights[light.frames] - heights[fall.first]

    def departure(p: Array) -> tuple[Array, float]:
        radius = ratio * p[2] / (1 + start * ratio)
        free, phi = string_at(points, (p[0], p[1]), radius, string.side)
        phi = phi + 2 * np.pi * np.round((light.phi - phi) / (2 * np.pi))
        return free + radius * phi + drop - p[2], radius

    def residuals(p: Array) -> Array:
        e, radius = departure(p)
        # The heavy mass's vertical leads to the rod's edge, as well as the mass's centre lies under the string
        tie = 0.5 * replace(string, rod=(p[0], p[1]), radius=radius).beside(fall) / unit
        held = [(p[0] - string.rod[0]) * 1e3, (p[1] - string.rod[1]) * 1e3] if rod_fixed else [tie]
        return np.append(e, held)

    fit = least_squares(residuals, [*string.rod, string.constant], loss="soft_l1", f_scale=1.0)
    e, radius = departure(fit.x)
    scatter = 1.4826 * float(np.median(np.abs(e - np.median(e))))
    # Neighbouring points share their errors, about ten of them
    covariance = np.linalg.pinv(fit.jac.T @ fit.jac) * max(scatter, 0.05) ** 2 * 10
    better = replace(
        string, rod=(float(fit.x[0]), float(fit.x[1])), radius=float(radius), constant=float(fit.x[2]),
        gate=max(3.5 * unit, 6 * scatter),
    )  # fmt: skip
    return better, e, covariance


def release(t: Array, frame: NDArray[np.intp], y: Array, moves: int) -> tuple[float, float]:
    """Return the time of the first motion and its standard error [s]: rest, then an acceleration that changes as time squared.

    From rest, it has no part linear in time: the light mass's pull grows with the square of its speed, and with its way. With
    such a part, releases came out 0.5 to 0.9 ms late.

    Parameters
    ----------
    t
        Time of each frame [s].
    frame, y
        Frames and heights of the heavy mass.
    moves
        A frame in which it has just begun to move.
    """
    chosen = (t[frame] > t[moves] - 0.25) & (t[frame] < t[moves] + BEGINNING)
    now, height = t[frame[chosen]], y[chosen]
    if len(now) < 5:
        return float(t[moves]), float(np.median(np.diff(t)))

    def residuals(p: Array) -> Array:
        since = np.maximum(now - p[2], 0.0)
        return np.asarray(p[0] + 0.5 * p[1] * since**2 * (1 + p[3] * (since / BEGINNING) ** 2) - height)

    rest = float(np.median(height[: max(3, len(height) // 4)]))
    speed = max(float(np.ptp(height)), 1.0)
    fits = [
        least_squares(
            residuals,
            [rest, 2 * speed / BEGINNING**2, t[moves] + shift, 0.0],
            loss="soft_l1",
            f_scale=0.3,
            x_scale=[1, 1000, 0.01, 1],
        )
        for shift in (-0.03, -0.01, 0.0, 0.01)
    ]
    best = min(fits, key=lambda fit: fit.cost)
    scatter = max(1.4826 * float(np.median(np.abs(best.fun))), 0.03)
    solve = np.linalg.pinv(best.jac)[2]
    by_rest = float(solve @ (now < best.x[2]))
    return float(best.x[2]), math.hypot(scatter * float(np.linalg.norm(solve)), REST_ERROR * by_rest)


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
