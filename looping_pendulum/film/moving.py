"""Find what moves before a still background: the background, the blobs of each picture that differ from it, and their paths."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from looping_pendulum.film.decode import Picture, imaging
from looping_pendulum.reference_ode.geometry import Array

Bytes = NDArray[np.uint8]

GRID_SIZE = 360
"""Shorter side of the picture in which blobs are looked for [pixels]; their centres are then measured in the full one."""
NOISE_FACTOR = 5.0
"""Difference from the background, in standard deviations of a pixel, from which on a pixel has changed."""
LEAST_DIFFERENCE = 12.0
"""The same in levels of 255: encoders leave differences of up to ten around what moves."""
LEAST_NOISE = 0.7
"""Smallest standard deviation of a pixel [levels]; rounding alone gives 0.3."""
COLOUR_WEIGHT = 2.0
"""Weight of differences of colour, which span half the range that those of brightness do."""
SIGMA_OF_DENSEST = 1.5
"""Standard deviation of a normal law over the width of the densest of `_usual`, of 9 to 15 values."""
TWO_VALUED = 6
"""Distance of the median from the middle of the densest values from which on a mass covers the pixel in the others [levels]."""
NOISE_WIDTH = 25
"""Width over which the noise of pixels is averaged [pixels]."""
LEAST_AREA = 6
"""Smallest blob [pixels of the search grid]."""
LARGEST_SHARE = 0.03
"""Largest blob, as a share of the picture: a mass is smaller, an arm is not."""
PARTS_APART = 9
"""Distance up to which parts are one thing, where things of many colours are looked for [pixels of the search grid]."""
LARGEST_WHOLE_SHARE = 0.15
"""Largest such thing, as a share of the picture."""
CORE_SHARE = 0.45
"""Share of a blob's own contrast that a pixel needs to belong to its core, which sheds a shadow or a string that touches it."""
LINE_WIDTH = 5
"""Width up to which gaps in a core are closed, and what stands out of it is taken off [pixels].

Lines of a ruled panel and strings are up to four pixels wide.
"""
COVERED = (0.3, 0.8)
"""Shares of a blob's median contrast that count as nothing and as all in its centre.

The lower one is above noise, shadow and string. Above the upper one, shading and lines of the background would pull the centre.
"""
LEAST_SAMPLES, MOST_SAMPLES = 9, 15
"""Fewest and most pictures of which the median is taken."""
MARGIN = 3
"""Pixels around a blob that are looked at for its centre."""
MAX_BLOBS = 40
"""Most blobs of one picture; if there are more, the largest are kept."""
FLICKER = 0.004
"""Relative change of the whole picture's brightness from which on it is corrected."""


class Blob(NamedTuple):
    """A connected part of a picture that differs from the background."""

    frame: int
    x: float
    """Centre, weighted by how much of each pixel is covered [pixels]."""
    y: float
    area: float
    """[pixels]"""
    contrast: float
    """Mean difference from the background [levels of 255]."""
    length: float
    """Extent along its longer axis, four standard deviations of its pixels [pixels]."""
    width: float
    """The same across it."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Background:
    """The picture without the masses, and where a change would be noticed."""

    planes: tuple[Bytes, ...]
    """Brightness, and both colours at half the size if there are any."""
    threshold: Bytes
    """Least difference of a changed pixel, on the search grid."""
    noise: float
    """Median standard deviation of a pixel [levels]."""

    @property
    def size(self) -> tuple[int, int]:
        """Return width and height [pixels]."""
        height, width = self.planes[0].shape
        return width, height


def background(
    samples: Sequence[Sequence[Bytes]], index: Sequence[int], window: tuple[int, int], *, sure: bool, rests: bool = True
) -> Background:
    """Return the picture without the masses: the median during the fall, in which neither rests.

    Parameters
    ----------
    samples
        Planes of some pictures.
    index
        Their frames' numbers.
    window
        First and last frame of the fall.
    sure
        Whether the window is known. If it is a guess, the median of three medians is taken, of the pictures before, during and
        after it: where a mass rests in one of them, the other two outvote it.
    rests
        Whether a thing that covers a pixel in about half of the pictures may rest there. If it only moves, it has many values,
        and the densest ones are the background's; at rest it has one, as the background has, and the median decides.
    """
    cv2 = imaging()
    number = np.asarray(index)
    before, after = number < window[0], number > window[1]
    groups = [np.flatnonzero(chosen) for chosen in (~before & ~after, before, after)]
    if len(groups[0]) < LEAST_SAMPLES:
        groups[0] = np.arange(len(number))
    groups = [_spread(number, group, MOST_SAMPLES) for group in groups[: 1 if sure else 3] if len(group) >= 3]
    still = []
    for plane in range(len(samples[0])):
        each = [_usual(cv2, [samples[int(k)][plane] for k in group], rests=rests) for group in groups]
        if plane == 0:
            spread = each[0][1].astype(np.float32)
        middle = [value for value, _ in each]
        still.append(_sorted(cv2, middle)[1] if len(middle) == 3 else middle[0])
    # Over more than a string's width: along that of the heavy mass pixels change, and a threshold there would cut it in two
    noise = np.maximum(cv2.blur(spread * np.float32(SIGMA_OF_DENSEST), (NOISE_WIDTH, NOISE_WIDTH)), LEAST_NOISE)
    threshold = np.clip(NOISE_FACTOR * noise, LEAST_DIFFERENCE, 255).astype(np.uint8)
    grid = cv2.resize(threshold, _grid_size(still[0]), interpolation=cv2.INTER_AREA)
    return Background(planes=tuple(still), threshold=grid, noise=float(np.median(noise)))


def _spread(number: NDArray[np.intp], group: NDArray[np.intp], most: int) -> NDArray[np.intp]:
    """Return at most so many members of a group of pictures, evenly spread over time: more were kept where much moves."""
    places = np.linspace(number[group[0]], number[group[-1]], most)
    chosen: NDArray[np.intp] = group[np.unique(np.argmin(np.abs(number[group][:, None] - places), axis=0))]
    return chosen


def _usual(cv2: Any, pictures: Sequence[Bytes], *, rests: bool) -> tuple[Bytes, Bytes]:
    """Return each pixel's usual value, and the width of the densest values, nearly half of all; `background` says the rule."""
    rows = _sorted(cv2, pictures)
    half, median = max(len(rows) // 2 - 1, 1), rows[len(rows) // 2]
    width, middle = cv2.subtract(rows[half], rows[0]), rows[half // 2].copy()
    for i in range(1, len(rows) - half):
        here = cv2.subtract(rows[i + half], rows[i])
        cv2.copyTo(rows[i + half // 2], cv2.compare(here, width, cv2.CMP_LT), middle)
        width = cv2.min(width, here)
    if rests:
        return median, width
    is_covered = cv2.compare(cv2.absdiff(median, middle), TWO_VALUED, cv2.CMP_GT)
    return cv2.copyTo(middle, is_covered, median.copy()), width


def _sorted(cv2: Any, pictures: Sequence[Bytes]) -> list[Bytes]:
    """Sort each pixel's values by comparing neighbours in turn: whole pictures at a time, ten times quicker than a median."""
    rows = list(pictures)
    for turn in range(len(rows)):
        for k in range(turn % 2, len(rows) - 1, 2):
            rows[k], rows[k + 1] = cv2.min(rows[k], rows[k + 1]), cv2.max(rows[k], rows[k + 1])
    return rows


def _grid_size(luma: Bytes) -> tuple[int, int]:
    height, width = luma.shape
    step = max(1, round(min(height, width) / GRID_SIZE))
    return width // step, height // step


class Difference:
    """Difference of one picture from the background."""

    def __init__(self, planes: Sequence[Bytes], ground: Background) -> None:
        cv2 = imaging()
        self._cv2 = cv2
        still = ground.planes[0]
        some = (slice(4, None, 16), slice(4, None, 16))
        gain = float(np.median(planes[0][some].astype(np.float32) / np.maximum(still[some], 1)))
        if abs(gain - 1) > FLICKER:
            still = cv2.convertScaleAbs(still, alpha=gain)
        self.luma: Bytes = cv2.absdiff(planes[0], still)
        self.colours: list[Bytes] = [cv2.absdiff(p, g) for p, g in zip(planes[1:], ground.planes[1:], strict=True)]

    def on_grid(self, size: tuple[int, int]) -> Bytes:
        """Return the difference at the size of the search grid."""
        cv2 = self._cv2
        total = self.luma if size == self.luma.shape[::-1] else cv2.resize(self.luma, size, interpolation=cv2.INTER_AREA)
        for colour in self.colours:
            weighted = cv2.convertScaleAbs(colour, alpha=COLOUR_WEIGHT)
            if weighted.shape != total.shape:
                weighted = cv2.resize(weighted, size, interpolation=cv2.INTER_LINEAR)
            total = cv2.max(total, weighted)
        return np.asarray(total)

    def part(self, x0: int, y0: int, x1: int, y1: int) -> Bytes:
        """Return the difference in a rectangle of the full picture; its left and upper edges are even."""
        cv2 = self._cv2
        total = self.luma[y0:y1, x0:x1]
        for colour in self.colours:
            patch = colour[y0 // 2 : (y1 + 1) // 2, x0 // 2 : (x1 + 1) // 2]
            wide = cv2.resize(patch, (2 * patch.shape[1], 2 * patch.shape[0]), interpolation=cv2.INTER_LINEAR)
            total = cv2.max(total, cv2.convertScaleAbs(wide[: y1 - y0, : x1 - x0], alpha=COLOUR_WEIGHT))
        return np.asarray(total)


def find_blobs(
    frame: int, difference: Difference, ground: Background, region: Bytes | None = None, *, whole: bool = False
) -> list[Blob]:
    """Return the blobs of one picture, largest first.

    Parameters
    ----------
    region
        Where blobs are looked for, not 0, on the search grid; None: everywhere.
    whole
        Whether parts beside each other are one thing of many colours, such as a cart, and may be large. Otherwise a blob is its
        largest part alone, as what touches a mass is its shadow, its string or the rod.
    """
    cv2 = imaging()
    grid_size = ground.threshold.shape[::-1]
    step = ground.size[0] / grid_size[0]
    on_grid = cv2.blur(difference.on_grid(grid_size), (3, 3))
    changed = cv2.compare(on_grid, ground.threshold, cv2.CMP_GT)
    if region is not None:
        changed = cv2.bitwise_and(changed, region)
    changed = cv2.morphologyEx(changed, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    if whole:
        changed = cv2.morphologyEx(changed, cv2.MORPH_CLOSE, np.ones((PARTS_APART, PARTS_APART), np.uint8))
    count, label, stats, _ = cv2.connectedComponentsWithStats(changed, connectivity=8)
    largest = (LARGEST_WHOLE_SHARE if whole else LARGEST_SHARE) * grid_size[0] * grid_size[1]
    kept = [j for j in range(1, count) if LEAST_AREA <= stats[j, cv2.CC_STAT_AREA] <= largest]
    kept.sort(key=lambda j: -stats[j, cv2.CC_STAT_AREA])
    blobs = []
    for j in kept[:MAX_BLOBS]:
        x, y, w, h = (int(v) for v in stats[j, :4])
        if x == 0 or y == 0 or x + w >= grid_size[0] or y + h >= grid_size[1]:
            continue  # the part of a thing that is still in the picture has another centre
        blob = _measured(frame, difference, ground, label[y : y + h, x : x + w] == j, (x, y, w, h), step, whole)
        if blob is not None:
            blobs.append(blob)
    return blobs


def _measured(
    frame: int, difference: Difference, ground: Background, mask: NDArray[np.bool_], box: tuple[int, int, int, int],
    step: float, whole: bool,
) -> Blob | None:  # fmt: skip
    """Measure one blob in the full picture: its centre weighted by how much of each pixel it covers."""
    cv2 = imaging()
    width, height = ground.size
    x, y, w, h = box
    x0, y0 = (max(int(v * step) - MARGIN, 0) & ~1 for v in (x, y))
    x1, y1 = min(int((x + w) * step) + MARGIN, width), min(int((y + h) * step) + MARGIN, height)
    part = difference.part(x0, y0, x1, y1)
    framed = np.zeros((y1 - y0, x1 - x0), np.uint8)
    own = cv2.resize(mask.astype(np.uint8), (max(round(w * step), 1), max(round(h * step), 1)), interpolation=cv2.INTER_NEAREST)
    left, top = round(x * step) - x0, round(y * step) - y0
    own = own[: framed.shape[0] - top, : framed.shape[1] - left]
    framed[top : top + own.shape[0], left : left + own.shape[1]] = own
    inside = part[framed > 0]
    if not len(inside):
        return None
    full = float(_ranked(inside, 0.9))
    strong = cv2.compare(part, CORE_SHARE * full, cv2.CMP_GT)
    core = strong = cv2.bitwise_and(strong, cv2.dilate(framed, None) * 255)
    if not whole:
        # A line of the background as bright as the mass must not cut it in two, nor its string belong to it
        size = np.ones((LINE_WIDTH, LINE_WIDTH), np.uint8)
        core = cv2.morphologyEx(core, cv2.MORPH_CLOSE, size)
        thick = cv2.morphologyEx(core, cv2.MORPH_OPEN, size)
        core = thick if cv2.countNonZero(thick) else core
        count, label, stats, _ = cv2.connectedComponentsWithStats(core, connectivity=8)
        core = np.asarray(label == 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA])) if count > 1 else 0 * core)
    inside = part[(core > 0) & (strong > 0)]
    if not len(inside):
        return None
    area, usual = float(len(inside)), float(_ranked(inside, 0.5))
    # With a rim of two pixels, which a moving or soft edge covers in part
    own = cv2.dilate((core > 0).astype(np.uint8), np.ones((5, 5), np.uint8))
    cover = np.clip((part / usual - COVERED[0]) / (COVERED[1] - COVERED[0]), 0, 1) * own
    total = float(cover.sum())
    if total <= 0:
        return None
    columns, rows = np.arange(part.shape[1]), np.arange(part.shape[0])
    by_column, by_row = cover.sum(axis=0), cover.sum(axis=1)
    cx, cy = float(by_column @ columns) / total, float(by_row @ rows) / total
    xx = float(by_column @ (columns - cx) ** 2) / total
    yy = float(by_row @ (rows - cy) ** 2) / total
    xy = float((rows - cy) @ cover @ (columns - cx)) / total
    middle, spread = 0.5 * (xx + yy), float(np.hypot(0.5 * (xx - yy), xy))
    return Blob(
        frame=frame,
        x=x0 + cx,
        y=y0 + cy,
        area=area,
        contrast=float(inside.mean()),
        length=4 * float(np.sqrt(middle + spread)),
        width=4 * float(np.sqrt(max(middle - spread, 0.0))),
    )


def _ranked(values: Bytes, share: float) -> Any:
    """Return the value that a share of all is not above: NumPy's own percentile takes longer than all else of a blob."""
    k = int(share * (len(values) - 1))
    return np.partition(values, k)[k]


Blobs = dict[int, list[Blob]]
"""Frame -> its blobs."""


def blobs_of(
    pictures: Iterable[Picture],
    ground: Background,
    *,
    skip: NDArray[np.bool_] | None = None,
    region: Bytes | None = None,
    whole: bool = False,
    progress: Callable[[int], None] | None = None,
) -> Blobs:
    """Return the blobs of pictures.

    Parameters
    ----------
    skip
        Frames that are left out, as copies.
    region
        Where blobs are looked for, on the search grid.
    whole
        Whether they may have parts, as of `find_blobs`.
    progress
        Called with the number of each frame.
    """
    found: Blobs = {}
    for picture in pictures:
        if progress is not None:
            progress(picture.frame)
        if skip is None or not skip[picture.frame]:
            difference = Difference(picture.planes[: len(ground.planes)], ground)
            found[picture.frame] = find_blobs(picture.frame, difference, ground, region, whole=whole)
    return found


Path = NDArray[np.float64]
"""Rows (frame, x, y, area, contrast, length, width) of one thing that moves, by frame."""

MAX_GAP_SECONDS = 0.017
"""Time for which a path may be lost and found again [s], and two frames at least."""
LEAST_POINTS = 3
"""Fewest points of a path."""
OVERLAP, SAME_SIZE = 0.5, 0.2
"""Distance, in widths, and logarithm of the ratio of areas up to which a blob is the same thing wherever its path led."""
MAX_JOINED_SECONDS = 0.1
"""Time for which a thing may be lost between two paths that are joined [s], and three frames at least."""
MAX_JOINED_GROWTH = 0.7
"""Largest logarithm of the ratio of areas of two paths that are joined."""
FIRST_SPEED = 3000.0
"""Largest speed of a blob with no past [pixels per second in a picture 1280 wide]."""


def paths(blobs: Blobs, t: Array, width: float) -> list[Path]:
    """Link blobs to paths: each continues where its last points lead, with the nearest blob of a similar size.

    Parameters
    ----------
    t
        Time of each frame [s].
    width
        Longer side of the picture [pixels].
    """
    unit = width / 1280
    usual = float(np.median(np.diff(t)))
    live: list[list[Blob]] = []
    done: list[list[Blob]] = []
    for k in sorted(blobs):
        here = blobs[k]
        place = np.array([(b.x, b.y) for b in here]).reshape(-1, 2)
        size = np.log([b.area for b in here])
        free = np.ones(len(here), dtype=bool)
        live.sort(key=lambda path: -len(path))
        for path in live:
            expected, gate = _expected(path, t, t[k], unit)
            growth = np.abs(size - np.log(path[-1].area))
            cost = np.hypot(*(place - expected).T) + 4 * unit * growth
            # What overlaps the expected place and is as large is the same thing: times and centres err, too
            reach = np.where(growth < SAME_SIZE, max(gate, OVERLAP * path[-1].width), gate)
            cost[~free | (cost >= reach)] = np.inf
            if len(here) and np.isfinite(cost.min()):
                path.append(here[int(np.argmin(cost))])
                free[np.argmin(cost)] = False
        # One point has no course along which it could be found again after a while
        kept = [t[k] - t[path[-1].frame] <= max(MAX_GAP_SECONDS if len(path) > 1 else 0.0, 2.5 * usual) for path in live]
        done += [path for path, is_kept in zip(live, kept, strict=True) if not is_kept]
        live = [path for path, is_kept in zip(live, kept, strict=True) if is_kept]
        live += [[b] for b, is_free in zip(here, free, strict=True) if is_free]
    return [np.array([b[:7] for b in path], dtype=float) for path in done + live if len(path) >= LEAST_POINTS]


def _expected(path: list[Blob], t: Array, now: float, unit: float) -> tuple[Array, float]:
    """Return where a path should continue [pixels], and how far from there it may [pixels]."""
    last = np.array(path[-1][1:3])
    dt = now - t[path[-1].frame]
    if len(path) == 1:
        return last, 10 * unit + FIRST_SPEED * unit * dt
    speed = (last - np.array(path[-2][1:3])) / (t[path[-1].frame] - t[path[-2].frame])
    if len(path) > 3:
        earlier = (np.array(path[-2][1:3]) - np.array(path[-3][1:3])) / (t[path[-2].frame] - t[path[-3].frame])
        speed = speed + (speed - earlier) * min(dt / (t[path[-1].frame] - t[path[-2].frame]), 1.5)
    return last + speed * dt, 5 * unit + 0.35 * float(np.hypot(*speed)) * dt


def joined(pieces: Sequence[Path], t: Array) -> list[Path]:
    """Join paths of one thing that was lost for a moment, as at a bounce: the next begins where it may have come to, as large.

    Parameters
    ----------
    t
        Time of each frame [s].
    """
    limit = max(MAX_JOINED_SECONDS, 3.5 * float(np.median(np.diff(t))))
    rest = sorted(pieces, key=lambda path: path[0, 0])
    links = []
    for i, a in enumerate(rest):
        for j, b in enumerate(rest):
            if b[0, 0] <= a[-1, 0] < b[2, 0]:  # the next begins on a part that has come off
                b = b[b[:, 0] > a[-1, 0]]
            dt = t[int(b[0, 0])] - t[int(a[-1, 0])]
            if not 0 < dt <= limit or abs(np.log(np.median(b[:, 3]) / np.median(a[:, 3]))) > MAX_JOINED_GROWTH:
                continue
            speed = max(_speed(a[-4:], t), _speed(b[:4], t))
            apart = float(np.hypot(*(b[0, 1:3] - a[-1, 1:3])))
            if apart < 1.3 * speed * dt + 0.5 * float(np.median(a[:, 6])):
                links.append((apart, i, j))
    follower: dict[int, int] = {}
    for _, i, j in sorted(links):
        if i not in follower and j not in follower.values():
            follower[i] = j
    chains = []
    for i in sorted(set(range(len(rest))) - set(follower.values())):
        chain = [rest[i]]
        while i in follower:
            end, i = rest[i][-1, 0], follower[i]
            chain.append(rest[i][rest[i][:, 0] > end])
        chains.append(np.concatenate(chain))
    return chains


def _speed(path: Path, t: Array) -> float:
    """Return the largest speed along a piece of a path [pixels/s]."""
    steps = np.hypot(*np.diff(path[:, 1:3], axis=0).T)
    return float(np.max(steps / np.diff(t[path[:, 0].astype(int)]), initial=0.0))
