"""Find what moves before a still background: the background, the blobs of each picture that differ from it, and their paths."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from looping_pendulum.measured.film import FilmError
from looping_pendulum.measured.film.decode import (
    Bytes,
    Picture,
    Survey,
    cv2,
    film_error,
    light_of,
    picture_change,
    pictures,
    relit,
    survey,
)
from looping_pendulum.measured.film.record import PlainTrack, Points, TrackSettings
from looping_pendulum.processes import ReportShare
from looping_pendulum.reference_ode.geometry import Array

GRID_SIZE = 360
"""Shorter side of the picture in which blobs are looked for [pixels]; their centres are then measured in the full one."""
NOISE_FACTOR, LEAST_DIFFERENCE = 5.0, 12.0
"""Difference from the background from which on a pixel has changed: in its standard deviations, and in levels of 255."""
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
LEAST_AREA, LARGEST_SHARE = 6, 0.03
"""Smallest blob [pixels of the search grid], and largest one as a share of the picture: a mass is smaller, an arm is not."""
PARTS_APART, LARGEST_WHOLE_SHARE = 9, 0.15
"""Distance up to which parts are one thing of many colours [pixels of the search grid], and its largest share."""
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
SAMPLES, SAMPLES_BESIDE, LEAST_SAMPLES = 15, 7, 9
"""Pictures of the fall of which the median is taken, those before and those after it, and the fewest of the fall."""
MARGIN = 3
"""Pixels around a blob that are looked at for its centre."""
MAX_BLOBS = 40
"""Most blobs of one picture; if there are more, the largest are kept."""


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
    light: Bytes
    """Its light, as of `light_of`: each picture is compared with the background as that picture's light shows it."""
    threshold: Bytes
    """Least difference of a changed pixel, on the search grid."""
    noise: float
    """Median standard deviation of a pixel [levels]."""

    @property
    def size(self) -> tuple[int, int]:
        """Return width and height [pixels]."""
        height, width = self.planes[0].shape
        return width, height


def samples_of(path: str, begin: int, end: int, window: tuple[int, int]) -> list[Picture]:
    """Return pictures of the frames ``begin`` to ``end`` for `background`: some in the window, fewer before and after it."""
    first, last = window
    spans = ((begin, first - 1, SAMPLES_BESIDE), (first, last, SAMPLES), (last + 1, end, SAMPLES_BESIDE))
    wanted = {int(k) for low, high, count in spans if low <= high for k in np.linspace(low, high, count)}
    return [picture.copied() for picture in pictures(path, begin, end) if picture.frame in wanted]


def background(samples: Sequence[Picture], window: tuple[int, int], *, rests: bool = True) -> Background:
    """Return the picture without the masses: the median of three medians, before, during and after the fall.

    Where a mass rests in one of them, the other two outvote it: it may rest before, after, and half-way down.

    Parameters
    ----------
    samples
        Some pictures of the film.
    window
        First and last frame of the fall.
    rests
        Whether a thing that covers a pixel in about half of the pictures may rest there. If it only moves, it has many values,
        and the densest ones are the background's; at rest it has one, as the background has, and the median decides.
    """
    number = np.array([picture.frame for picture in samples])
    before, after = number < window[0], number > window[1]
    groups = [np.flatnonzero(chosen) for chosen in (~before & ~after, before, after)]
    if len(groups[0]) < LEAST_SAMPLES:
        groups[0] = np.arange(len(number))
    groups = [group for group in groups if len(group) >= 3]
    # All as the light of the one of middle brightness shows them
    light = {int(k): light_of(samples[k].planes[0]) for k in np.unique(np.concatenate(groups))}
    middle_light = light[sorted(light, key=lambda k: float(light[k].mean()))[len(light) // 2]]
    lit = {k: relit(samples[k].planes, middle_light, own) for k, own in light.items()}
    still = []
    for plane in range(len(samples[0].planes)):
        each = [_usual([lit[int(k)][plane] for k in group], rests=rests) for group in groups]
        if plane == 0:
            spread = each[0][1].astype(np.float32)
        middle = [value for value, _ in each]
        still.append(_sorted(middle)[1] if len(middle) == 3 else middle[0])
    # Over more than a string's width: along that of the heavy mass pixels change, and a threshold there would cut it in two
    noise = np.maximum(cv2.blur(spread * np.float32(SIGMA_OF_DENSEST), (NOISE_WIDTH, NOISE_WIDTH)), LEAST_NOISE)
    threshold = np.clip(NOISE_FACTOR * noise, LEAST_DIFFERENCE, 255).astype(np.uint8)
    height, width = still[0].shape
    step = max(1, round(min(height, width) / GRID_SIZE))
    grid = cv2.resize(threshold, (width // step, height // step), interpolation=cv2.INTER_AREA)
    return Background(planes=tuple(still), light=light_of(still[0]), threshold=grid, noise=float(np.median(noise)))


def _usual(planes: Sequence[Bytes], *, rests: bool) -> tuple[Bytes, Bytes]:
    """Return each pixel's usual value, and the width of the densest values, nearly half of all; `background` says the rule."""
    rows = _sorted(planes)
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


def _sorted(planes: Sequence[Bytes]) -> list[Bytes]:
    """Sort each pixel's values by comparing neighbours in turn: whole pictures at a time, ten times quicker than a median."""
    rows = list(planes)
    for turn in range(len(rows)):
        for k in range(turn % 2, len(rows) - 1, 2):
            rows[k], rows[k + 1] = cv2.min(rows[k], rows[k + 1]), cv2.max(rows[k], rows[k + 1])
    return rows


Blobs = dict[int, list[Blob]]
"""Frame -> its blobs, largest first."""


def blobs_of(
    shown: Iterable[Picture],
    ground: Background,
    *,
    skip: Collection[int] = (),
    region: tuple[int, int, int, int] | None = None,
    whole: bool = False,
) -> Blobs:
    """Return the blobs of pictures.

    Parameters
    ----------
    skip
        Frames that are left out, as copies.
    region
        Where blobs are looked for: left, top, right, bottom [pixels].
    whole
        Whether parts beside each other are one thing of many colours, such as a cart, and may be large. Otherwise a blob is its
        largest part alone, as what touches a mass is its shadow, its string or the rod.
    """
    grid = ground.threshold.shape[::-1]
    searched = np.full(ground.threshold.shape, 255, np.uint8)
    if region is not None:
        x0, y0, x1, y1 = (max(round(v * grid[0] / ground.size[0]), 0) for v in region)
        searched[:] = 0
        searched[y0:y1, x0:x1] = 255
    found: Blobs = {}
    for picture in shown:
        if picture.frame not in skip:
            still = relit(ground.planes, light_of(picture.planes[0]), ground.light)
            difference = [cv2.absdiff(plane, usual) for plane, usual in zip(picture.planes, still, strict=True)]
            boxes = _changed_parts(difference, ground, searched, whole=whole)
            blobs = (_measured(picture.frame, difference, mask, box, ground.size[0] / grid[0], whole) for mask, box in boxes)
            found[picture.frame] = [blob for blob in blobs if blob is not None]
    return found


def _changed_parts(
    difference: Sequence[Bytes], ground: Background, searched: Bytes, *, whole: bool
) -> list[tuple[NDArray[np.bool_], tuple[int, int, int, int]]]:
    """Return the connected parts that have changed, largest first: its pixels in its box, of left, top, width and height.

    Parameters
    ----------
    difference
        That of brightness and of colours from the background.
    searched
        Where parts are looked for, not 0; it and the parts are on the search grid.
    """
    grid = ground.threshold.shape[::-1]
    luma, *colours = difference
    total = luma if grid == luma.shape[::-1] else cv2.resize(luma, grid, interpolation=cv2.INTER_AREA)
    for colour in colours:
        weighted = cv2.convertScaleAbs(colour, alpha=COLOUR_WEIGHT)
        if weighted.shape != total.shape:
            weighted = cv2.resize(weighted, grid, interpolation=cv2.INTER_LINEAR)
        total = cv2.max(total, weighted)
    changed = cv2.bitwise_and(cv2.compare(cv2.blur(total, (3, 3)), ground.threshold, cv2.CMP_GT), searched)
    changed = cv2.morphologyEx(changed, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    if whole:
        changed = cv2.morphologyEx(changed, cv2.MORPH_CLOSE, np.ones((PARTS_APART, PARTS_APART), np.uint8))
    count, label, stats, _ = cv2.connectedComponentsWithStats(changed, connectivity=8)
    largest = (LARGEST_WHOLE_SHARE if whole else LARGEST_SHARE) * grid[0] * grid[1]
    kept = [j for j in range(1, count) if LEAST_AREA <= stats[j, cv2.CC_STAT_AREA] <= largest]
    kept.sort(key=lambda j: -stats[j, cv2.CC_STAT_AREA])
    parts = []
    for j in kept[:MAX_BLOBS]:
        x, y, w, h = (int(v) for v in stats[j, :4])
        # The part of a thing that is still in the picture has another centre
        if x > 0 and y > 0 and x + w < grid[0] and y + h < grid[1]:
            parts.append((label[y : y + h, x : x + w] == j, (x, y, w, h)))
    return parts


def _measured(
    frame: int, difference: Sequence[Bytes], mask: NDArray[np.bool_], box: tuple[int, int, int, int], step: float, whole: bool
) -> Blob | None:
    """Measure one blob in the full picture: its centre weighted by how much of each pixel it covers.

    Parameters
    ----------
    mask, box
        As `_changed_parts` has them.
    step
        Pixels of the full picture in one of the search grid.
    """
    luma, *colours = difference
    height, width = luma.shape
    x, y, w, h = box
    x0, y0 = (max(int(v * step) - MARGIN, 0) & ~1 for v in (x, y))
    x1, y1 = min(int((x + w) * step) + MARGIN, width), min(int((y + h) * step) + MARGIN, height)
    part = luma[y0:y1, x0:x1]
    for colour in colours:
        patch = colour[y0 // 2 : (y1 + 1) // 2, x0 // 2 : (x1 + 1) // 2]
        wide = cv2.resize(patch, (2 * patch.shape[1], 2 * patch.shape[0]), interpolation=cv2.INTER_LINEAR)
        part = cv2.max(part, cv2.convertScaleAbs(wide[: y1 - y0, : x1 - x0], alpha=COLOUR_WEIGHT))
    framed = np.zeros((y1 - y0, x1 - x0), np.uint8)
    own = cv2.resize(mask.astype(np.uint8), (max(round(w * step), 1), max(round(h * step), 1)), interpolation=cv2.INTER_NEAREST)
    left, top = round(x * step) - x0, round(y * step) - y0
    own = own[: framed.shape[0] - top, : framed.shape[1] - left]
    framed[top : top + own.shape[0], left : left + own.shape[1]] = own
    inside = part[framed > 0]
    if not len(inside):
        return None
    full = int(np.sort(inside)[int(0.9 * (len(inside) - 1))])
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
    area, usual = float(len(inside)), float(np.sort(inside)[(len(inside) - 1) // 2])
    # With a rim of two pixels, which a moving or soft edge covers in part
    own = cv2.dilate((core > 0).astype(np.uint8), np.ones((5, 5), np.uint8))
    cover = np.clip((part / usual - COVERED[0]) / (COVERED[1] - COVERED[0]), 0, 1) * own
    moments = cv2.moments(cover)
    total = moments["m00"]
    if total <= 0:
        return None
    xx, yy, xy = (moments[name] / total for name in ("mu20", "mu02", "mu11"))
    middle, spread = 0.5 * (xx + yy), float(np.hypot(0.5 * (xx - yy), xy))
    return Blob(
        frame=frame,
        x=x0 + moments["m10"] / total,
        y=y0 + moments["m01"] / total,
        area=area,
        contrast=float(inside.mean()),
        length=4 * float(np.sqrt(middle + spread)),
        width=4 * float(np.sqrt(max(middle - spread, 0.0))),
    )


MovingPath = NDArray[np.float64]
"""Rows (frame, x, y, area, contrast, length, width) of one thing that moves, by frame."""

MAX_GAP_SECONDS, LEAST_POINTS = 0.017, 3
"""Time for which a path may be lost and found again [s], two frames at least; and its fewest points."""
OVERLAP, SAME_SIZE = 0.5, 0.2
"""Distance, in widths, and logarithm of the ratio of areas up to which a blob is the same thing wherever its path led."""
MAX_JOINED_SECONDS, MAX_JOINED_GROWTH = 0.1, 0.7
"""Time for which a thing may be lost between two paths that are joined [s], and largest logarithm of their areas' ratio."""
FIRST_SPEED = 3000.0
"""Largest speed of a blob with no past [pixels per second in a picture 1280 wide]."""


def paths(blobs: Blobs, t: Array, width: float) -> list[MovingPath]:
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
    return [np.array(path, dtype=float) for path in done + live if len(path) >= LEAST_POINTS]


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


def joined(pieces: Sequence[MovingPath], t: Array) -> list[MovingPath]:
    """Join paths of one thing that was lost for a moment, as at a bounce: the next begins where it may have come to, as large.

    Parameters
    ----------
    t
        Time of each frame [s].
    """
    limit = max(MAX_JOINED_SECONDS, 3.5 * float(np.median(np.diff(t))))
    chains: list[MovingPath] = []
    for piece in sorted(pieces, key=lambda path: path[0, 0]):
        followed = []
        for i, chain in enumerate(chains):
            rest = piece[piece[:, 0] > chain[-1, 0]]
            if len(piece) - len(rest) > 2:  # up to two frames it may begin on a part that has come off
                continue
            dt = t[int(rest[0, 0])] - t[int(chain[-1, 0])]
            growth = abs(np.log(np.median(rest[:, 3]) / np.median(chain[:, 3])))
            apart = float(np.hypot(*(rest[0, 1:3] - chain[-1, 1:3])))
            reach = 1.3 * max(_speed(chain[-4:], t), _speed(rest[:4], t)) * dt + 0.5 * float(np.median(chain[:, 6]))
            if dt <= limit and growth <= MAX_JOINED_GROWTH and apart < reach:
                followed.append((apart, i, rest))
        if followed:
            _, i, rest = min(followed, key=lambda each: each[0])
            chains[i] = np.concatenate([chains[i], rest])
        else:
            chains.append(piece)
    return chains


def _speed(path: MovingPath, t: Array) -> float:
    """Return the largest speed along a piece of a path [pixels/s]."""
    steps = np.hypot(*np.diff(path[:, 1:3], axis=0).T)
    return float(np.max(steps / np.diff(t[path[:, 0].astype(int)]), initial=0.0))


def streak_way(rows: MovingPath) -> Array:
    """Return the way of discs during the exposure [pixels], by their streaks' lengths and widths, shape (n,).

    Both are four standard deviations: those of a disc along its way grow by the way over the root of 12.
    """
    return np.asarray(np.sqrt(0.75 * np.maximum(rows[:, 5] ** 2 - rows[:, 6] ** 2, 0.0)))


NAMES, ERROR = "ABCDEFGH", 0.3
"""Of the things that are written, at most, and standard error of their points [pixels]."""
LEAST_WAY, LEAST_FRAMES = 0.04, 6
"""Shortest way of a thing, as a share of the picture's longer side, and its fewest frames: what trembles is no motion."""
BUSY_SHARE, BUSY_FILM = 0.8, 0.7
"""Share of all change that lies in the time in which things move, and share of the film that this is if they always do."""


def follow_all(path: str | Path, settings: TrackSettings, progress: ReportShare | None = None) -> PlainTrack:
    """Follow everything that moves before a still background.

    Raises
    ------
    FilmError
        If the film cannot be read, or nothing moves in it.
    """
    report = progress or (lambda _, __: None)
    report("reading the film", 0.0)
    seen = survey(path, frame_rate=settings.frame_rate, needs_rest=False)
    first, last = settings.frames(seen.t)
    if last - first < LEAST_FRAMES:
        raise film_error(seen.path, "found fewer than seven frames between --from and --to, needed the motion", "correct them")
    window = _busy(seen, first, last)
    # Before and after a motion that fills the film there is too little to vote with
    fills = window[1] - window[0] > BUSY_FILM * (last - first)
    window = (first, last) if fills else window
    ground = background(samples_of(seen.path, first, last, window), window, rests=not fills)
    shown = pictures(seen.path, first, last, lambda share: report("following what moves", 0.4 + 0.5 * share))
    blobs = blobs_of(shown, ground, skip=seen.facts.repeated, region=settings.region, whole=True)
    things = _things(seen, blobs)
    if not things:
        raise FilmError(
            f"{seen.path}: found nothing that moves, needed something; is it the right film? Shorten it by --from and --to"
        )
    return PlainTrack(path=seen.path, facts=seen.facts, settings=settings, t=seen.t, things=things)


def _busy(seen: Survey, first: int, last: int) -> tuple[int, int]:
    """Return first and last frame of the shortest time with most of the change: a thing may rest for longer than it moves."""
    inside = [p for p in seen.small if first <= p.frame <= last]
    total = np.cumsum([0.0, *(picture_change(a.planes[0], b.planes[0]) for a, b in pairwise(inside))])
    # For each beginning, the first end by which the share is reached
    ends = np.searchsorted(total, total + BUSY_SHARE * total[-1])
    begins = np.flatnonzero(ends < len(total))
    best = int(begins[np.argmin(ends[begins] - begins)])
    return inside[best].frame, inside[ends[best]].frame


def _things(seen: Survey, blobs: Blobs) -> dict[str, Points]:
    """Return the paths that go farthest, times their contrast, with names."""
    width = max(seen.facts.size)
    found = []
    for path in joined(paths(blobs, seen.t, width), seen.t):
        way = float(np.hypot(np.ptp(path[:, 1]), np.ptp(path[:, 2])))
        if way < LEAST_WAY * width or len(path) < LEAST_FRAMES:
            continue
        found.append((way * float(np.median(path[:, 4])), path))
    found.sort(key=lambda each: -each[0])
    things = {}
    for name, (_, path) in zip(NAMES, found, strict=False):
        error = np.full((len(path), 2), ERROR)
        things[name] = Points(
            frame=path[:, 0].astype(int), place=path[:, 1:3], error=error, counted_error=error,
            radius=0.5 * float(np.median(path[:, 6])),
        )  # fmt: skip
    return things
