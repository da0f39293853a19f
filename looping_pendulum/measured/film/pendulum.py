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

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from looping_pendulum.measured.film import FilmError
from looping_pendulum.measured.film.moving import Blob, Blobs, MovingPath
from looping_pendulum.measured.film.record import Shown
from looping_pendulum.reference_ode.geometry import Array, string_from_rod

MIN_FALL, MAX_LEAN, MAX_RISE = 0.06, 0.12, 0.1
"""Shortest fall, as a share of the picture's height; its largest slope against the picture's vertical, seven degrees; and the
largest share of its way down by which the heavy mass may go up again."""
MAX_STRING_RESIDUAL, MAX_BESIDE = 3.0, 6.0
"""Scatter of the string's length above which it was not the string, and distance of the heavy mass's vertical from the rod's
edge above which it was not the rod [pixels of a picture 1280 wide]."""
MIN_SHARE, SHARE_SECONDS, MIN_SWEEP = 0.5, 0.8, 2.0
"""Share of the pictures in which the light mass must be found, so long after the release [s], and the angle it sweeps [rad]."""
VOTE_STEP, VOTE_BIN, MAX_PROPOSALS = 2.0, 6.0, 5
"""Step of the rod's height and bin of the string's length in the vote [pixels of a picture 1280 wide]; most results tried."""
FURTHEST_GAP, KNOWN_SECONDS = 10, 0.025
"""Frames in which the heavy mass may be hidden as it begins to fall; time from a mark up to which its height is known [s]."""
UNKNOWN_HEIGHT = 12.0
"""Departure of the string's length that is allowed besides where it is not [pixels of a picture 1280 wide]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Fall:
    """The heavy mass in all frames in which it was found."""

    rows: MovingPath
    """One row (frame, x, y, area, contrast, length, width) for each frame."""
    slope: float
    """Of its vertical: x = offset + slope y."""
    offset: float
    first: int
    """Last frame before it moves, or one of the two before."""
    last: int
    """Frame at which most of the fall is over."""
    heights: Array
    """y in every frame of the film, interpolated, and at rest up to `first`, shape (frames,)."""
    known: NDArray[np.bool_]
    """Whether the height is known in a frame: before the fall, or near to a mark of it, shape (frames,)."""

    @property
    def drop(self) -> Array:
        """Return how much lower it is in every frame than at rest, shape (frames,)."""
        return np.asarray(self.heights - self.heights[self.first])

    def column(self, y: Array | float) -> Array | float:
        """Return x on the vertical of the heavy mass at heights y."""
        return self.offset + self.slope * y


def fall_of(rows: MovingPath, t: Array, slope: float, offset: float, first: int, last: int) -> Fall:
    """Return the heavy mass by its rows, of a film with frames at the times ``t`` [s]; the rest is as `Fall` has it."""
    y, marked = rows[:, 2], t[rows[:, 0].astype(int)]
    heights = np.interp(t, marked, median_filter(y, 5, mode="nearest") if len(y) > 8 else y)
    rest = y[rows[:, 0] <= first]
    heights[: first + 1] = np.median(rest) if len(rest) >= 3 else heights[first]
    after = np.searchsorted(marked, t).clip(1, len(marked) - 1)
    near = np.minimum(np.abs(t - marked[after]), np.abs(t - marked[after - 1])) < max(
        KNOWN_SECONDS, 1.5 * float(np.median(np.diff(t)))
    )
    known = (near & (t <= marked[-1])) | (np.arange(len(t)) <= first)
    return Fall(rows=rows, slope=slope, offset=offset, first=first, last=last, heights=heights, known=known)


def falls(moving: Sequence[MovingPath], height: float) -> list[MovingPath]:
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


def heavy_mass(blobs: Blobs, candidates: Sequence[MovingPath], t: Array, unit: float) -> Fall:
    """Return the heavy mass in all frames: its falls along one vertical, and blobs there that continue them.

    Blobs elsewhere on the vertical are shadows, or places where the background still shows the resting mass.
    """
    from scipy.stats import theilslopes  # not at the top: its import takes as long as that of all other modules here

    best = candidates[0]
    slope, offset, *_ = (float(v) for v in theilslopes(best[:, 1], best[:, 2]))
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
    halts = int(k[np.argmax(y > y.min() + 0.85 * np.ptp(y))])

    def nearest(frame: int, height: float, gate: float) -> Array | None:
        near = [
            b
            for b in blobs.get(frame, ())
            if abs(b.x - offset - slope * b.y) < 3 * unit and abs(b.y - height) < gate
            and abs(np.log(b.area / area)) < 0.35 and abs(np.log(b.contrast / contrast)) < 0.6
        ]  # fmt: skip
        return np.array(min(near, key=lambda b: abs(b.y - height)), dtype=float) if near else None

    for frame in range(int(k[0]) + 1, int(k[-1])):
        if frame not in rows and (row := nearest(frame, float(np.interp(frame, k, y)), unit * (8 + 400 * usual))) is not None:
            rows[frame] = row
    for step, end, place, share in ((1, int(k[-1]), y[-1], 2), (-1, int(k[0]), y[0], 1)):
        for frame in range(end + step, len(t) if step > 0 else -1, step):
            last = [rows[i] for i in range(frame - step, frame - 6 * step, -step) if i in rows]
            if len(last) >= 4:  # on at its speed: where the light mass crosses it, it is lost or displaced in a picture or two
                past = np.array([(t[int(row[0])] - t[frame], row[2]) for row in last])
                place = float(np.polyfit(past[:, 0], past[:, 1], 1)[1])
            # Before the fall it rests somewhere above, even where something as dark hid its first motion
            reach = 1 if step > 0 else min(abs(frame - min(rows)), FURTHEST_GAP)
            if (row := nearest(frame, place, unit * (4 + 300 * usual * share * reach))) is not None:
                rows[frame] = row
                place = row[2]
    k = np.array(sorted(rows))
    y = np.array([rows[i][2] for i in k])
    moves = int(k[np.argmax(y > y.min() + 2 * unit)])
    return fall_of(np.array([rows[i] for i in k]), t, slope, offset, max(moves - 3, 0), halts)


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
    seen: Callable[[Array], tuple[Array, Array]] | None = None
    """Returns free length and bearing at points, of a camera that does not look straight on; None: of one that does."""

    def at(self, points: Array) -> tuple[Array, Array]:
        """Return free length [pixels] and bearing [rad], in the first turn, of the string to points (n, 2)."""
        if self.seen is None:
            return string_in_picture(points, self.rod, self.radius, self.side)
        free, phi = self.seen(points)
        return free, in_first_turn(phi)


CUT = -0.2
"""Least bearing of the string in the first turn [rad]: the light mass is let go between straight up and straight down."""


def in_first_turn(bearing: Array) -> Array:
    """Return bearings [rad] within a turn that begins at `CUT`."""
    return (bearing - CUT) % (2 * np.pi) + CUT


def string_in_picture(
    points: Array, rod: tuple[Array | float, Array | float], radius: Array | float, side: int
) -> tuple[Array, Array]:
    """Return free length [pixels] and bearing [rad] of the string to points (n, 2), seen by a camera that looks straight on."""
    free, phi = string_from_rod((points[:, 0] - rod[0]) * side, rod[1] - points[:, 1], radius)
    return free, in_first_turn(phi)


def vote(
    blobs: Blobs, fall: Fall, ratio: float, size: tuple[int, int], last: int, rod: tuple[float, float] | None = None,
) -> list[String]:  # fmt: skip
    """Return the strings that most pictures from the release to ``last`` agree upon, best first.

    Parameters
    ----------
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
    drop, top = fall.drop[frame], fall.heights[fall.first]
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
                free, phi = string_in_picture(points[:, 1:], (centre, y), radius, side)
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

    rows: MovingPath
    """One row (frame, x, y, area, contrast, length, width) for each frame, shape (n, 7)."""
    phi: Array
    """Bearing of the string, with all turns [rad], shape (n,)."""

    @property
    def frames(self) -> NDArray[np.intp]:
        """Return the frames' numbers, shape (n,)."""
        return self.rows[:, 0].astype(np.intp)

    @property
    def points(self) -> Array:
        """Return the centres, shape (n, 2)."""
        return self.rows[:, 1:3]


def follow(
    blobs: Blobs, moving: Sequence[MovingPath], fall: Fall, string: String, t: Array, unit: float, seed: Shown | None = None,
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
    drop = fall.drop
    start = _seed(moving, own, drop, string, fall.first, seed)
    if start is None:
        return None
    history = [(t[b.frame], phi) for b, phi in start]
    found = {b.frame: (b, phi) for b, phi in start}
    area = float(np.median([b.area for b, _ in start]))
    contrast = float(np.median([b.contrast for b, _ in start]))
    frames = [k for k in sorted(blobs) if k >= max(fall.first - 60, 0)]
    gate = np.where(fall.known, string.gate, string.gate + UNKNOWN_HEIGHT * unit)
    for forward in (True, False):
        past = list(history) if forward else list(reversed(history))
        todo = [k for k in frames if (k > start[-1][0].frame if forward else k < start[0][0].frame)]
        size = area
        for k in todo if forward else reversed(todo):
            at_rest = not forward and k <= fall.first
            best = _next(blobs[k], own.get(k), drop[k], string, gate[k], past, t[k], size, contrast, unit, at_rest=at_rest)
            if best is not None:
                found[k] = best
                past.append((t[k], best[1]))
                size = 0.8 * size + 0.2 * best[0].area
    chosen = [found[k] for k in sorted(found)]
    return LightMass(rows=np.array([b for b, _ in chosen], dtype=float), phi=np.array([p for _, p in chosen]))


_Step = tuple[Blob, float]
"""A blob, and the string's bearing with all turns."""


def _seed(
    moving: Sequence[MovingPath], own: dict[int, tuple[float, float]], drop: Array, string: String, first: int,
    shown: Shown | None,
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
            near = np.flatnonzero(frame == shown.frame)
            if not len(near) or np.hypot(*(path[near[0], 1:3] - shown[:2])) > 0.03 * string.constant:
                continue
            good |= True
        ends = np.flatnonzero(np.diff(np.concatenate([[0], good.astype(int), [0]])))
        for a, b in ends.reshape(-1, 2):
            sweep = phi[b - 1] - phi[a]  # it loops towards growing bearings
            score = (b - a) * max(sweep, 0.0)
            if b - a >= 3 and score > best[0]:
                best = score, [(Blob(int(path[i, 0]), *path[i, 1:].tolist()), float(phi[i])) for i in range(a, b)]
    return best[1] or None


def _next(
    here: Sequence[Blob], heavy: tuple[float, float] | None, drop: float, string: String, gate: float,
    past: list[tuple[float, float]],
    now: float, area: float, contrast: float, unit: float, *, at_rest: bool,
) -> _Step | None:  # fmt: skip
    """Return the blob that continues the light mass's way: along it by the angle's course, across it by the taut string."""
    if not here:
        return None
    recent = np.array(past[-5:])
    dt = abs(now - recent[-1, 0])
    degree = min(len(recent) - 1, 2) if not at_rest else 0
    expected, rate = recent[-1, 1], 0.0
    if degree:
        since = recent[:, 0] - recent[-1, 0]
        span = float(np.abs(since).max())
        course = np.linalg.lstsq(np.vander(since / span, degree + 1, increasing=True), recent[:, 1], rcond=None)[0]
        expected = float(course @ ((now - recent[-1, 0]) / span) ** np.arange(degree + 1))
        rate = abs(float(course[1])) / span
    place = np.array([(b.x, b.y) for b in here])
    free, phi = string.at(place)
    phi = phi + 2 * np.pi * np.round((expected - phi) / (2 * np.pi))
    e = free + string.radius * phi + drop - string.constant
    along = np.abs(phi - expected) * free
    gate_along = unit * 6 + (0.25 * rate * dt + 100 * dt * dt) * np.maximum(free, 20 * unit)
    gate_across = gate + 0.02 * free * rate * dt
    change = np.abs(np.log(np.array([b.area for b in here]) / area))
    relative = np.array([b.contrast for b in here]) / contrast
    # A hand, or the rod, may have stopped it anywhere on its way
    low, high = sorted((expected, recent[-1, 1]))
    beyond = np.maximum(np.maximum(low - phi, phi - high), 0.0) * free
    has_stopped = (beyond < 6 * unit) & (change < 0.5) & (relative > 0.7)
    fits = (np.abs(e) <= gate_across) & ((along <= gate_along) | has_stopped) & (change <= 1.6)
    if heavy is not None:
        fits &= np.hypot(*(place - heavy).T) >= 2 * unit
    if not fits.any():
        return None
    cost = (e / gate_across) ** 2 + (along / gate_along) ** 2 + change**2 - 0.3 * np.minimum(relative, 1.5)
    best = int(np.argmin(np.where(fits, cost, np.inf)))
    return here[best], float(phi[best])
