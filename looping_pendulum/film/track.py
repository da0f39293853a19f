"""Track a film of a looping pendulum: the function to call, its settings, and what it returns."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from looping_pendulum.film import pendulum
from looping_pendulum.film.decode import FilmError, FilmFacts, Picture, Survey, film_error, pictures, survey
from looping_pendulum.film.moving import (
    LEAST_SAMPLES,
    MAX_BLOBS,
    MOST_SAMPLES,
    Background,
    Blobs,
    Bytes,
    background,
    blobs_of,
    paths,
)
from looping_pendulum.film.moving import Path as MovingPath
from looping_pendulum.film.pendulum import Fall, LightMass, String
from looping_pendulum.processes import ReportShare
from looping_pendulum.reference_ode.geometry import Array, string_coordinates

SECONDS_BEFORE = 0.3
"""Time before the release from which on pictures are searched [s]."""
SECONDS_AFTER = 3.0
"""Time after the release up to which they are [s]; by then the light mass is wound up."""
CENTRE_ERROR = 0.05
"""Scatter of a centre that a picture leaves at least [pixels]: what a codec does to an edge."""
SHARED_ERROR = 10.0
"""Error that points less than the mass's radius apart share, times the mass's contrast [pixels levels].

Shading, the string and lines of the background pull a centre the more, the paler the mass is; scatter does not show it.
"""
EDGE_ERROR = 0.1
"""Error of the falling mass's height [pixels]: its lower edge lies along the rows, and comes to the next one all at once."""
NOISE_ERROR = 0.3
"""Error of a disc's centre, in radii over radii: its noise over its contrast times this [pixels]."""
RADIUS_ERROR = 0.3
"""Error of a disc's radius by where its soft edge is taken to be [pixels]."""
WIDTHS = 25
"""Points whose median is the usual width of a mass."""
STREAK_ERROR = 0.03
"""Error of a streak's middle, as a share of the way during the exposure."""
LENGTH_ERROR = 0.2
"""Error of the string's length by where the masses' centres are taken to be, constant through a film [pixels]."""
STRAIGHT = 0.3
"""Scatter of the string's length above which perspective or the lens bends the picture [pixels of a picture 1280 wide].

By what exceeds it rod and scale may be wrong, too: the fit of a rod gives way to a bent circle.
"""
FIRST_MOTION, LEAST_FIRST_POINTS = 0.3, 6
"""Part of the motion whose acceleration shows gravity [s], and fewest points of it."""
SHOWN_ERROR = 1.4
"""Error of a length between two places that a person has shown [pixels]."""
WINDOW_RATE = 120.0
"""Pictures per second by which the time of the fall is found [Hz]."""
FIRST_WINDOWS = ((0.1, 0.6), (0.3, 0.9), (0.05, 0.3))
"""Where in the film the fall may be at first, as shares of its frames."""


class ScaleRule(NamedTuple):
    """A length in the picture that a person knows."""

    start: tuple[float, float]
    """[pixels], y downwards."""
    end: tuple[float, float]
    length: float
    """[m]"""

    @property
    def pixels(self) -> float:
        """Return the length in the picture [pixels]."""
        return math.hypot(self.end[0] - self.start[0], self.end[1] - self.start[1])


class Shown(NamedTuple):
    """A mass that a person shows in a frame."""

    x: float
    """[pixels]"""
    y: float
    frame: int


@dataclass(frozen=True, kw_only=True)
class TrackSettings:
    """What is known of the apparatus, and what a person has shown in the film."""

    free_length: float | None = None
    """String from the rod to the light mass at the release [m]."""
    free_length_error: float = 0.0
    """Its standard error [m]."""
    rod_radius: float = 6.25e-3
    """[m]"""
    frame_rate: float | None = None
    """True frame rate [Hz]; None: as the film says."""
    scale: ScaleRule | None = None
    light: Shown | None = None
    heavy: Shown | None = None
    rod: tuple[float, float] | None = None
    """Centre of the rod [pixels]."""
    first: float | None = None
    """Time from which on the film is read [s by its clock, from its first frame]."""
    last: float | None = None
    """Time up to which it is read [s]."""
    readout: float | None = None
    """Time from the reading of the picture's first row to that of its last [s]; None: not known."""
    region: tuple[int, int, int, int] | None = None
    """Rectangle in which masses are looked for: left, top, right, bottom [pixels]."""

    def frames(self, t: Array) -> tuple[int, int]:
        """Return the first and the last frame that is read, of frames at the times ``t`` [s]."""
        first = 0 if self.first is None else int(np.searchsorted(t, self.first))
        last = len(t) - 1 if self.last is None else int(np.searchsorted(t, self.last, side="right")) - 1
        return first, last

    def region_on_grid(self, ground: Background) -> Bytes | None:
        """Return `region` as `find_blobs` takes it: not 0 where things are looked for, on the search grid."""
        if self.region is None:
            return None
        height, width = ground.threshold.shape
        x0, y0, x1, y1 = (round(v * width / ground.size[0]) for v in self.region)
        region = np.zeros((height, width), np.uint8)
        region[max(y0, 0) : max(y1, 0), max(x0, 0) : max(x1, 0)] = 255
        return region


@dataclass(frozen=True, kw_only=True, eq=False)
class Points:
    """One mass in the frames in which it was found."""

    frame: NDArray[np.intp]
    """Shape (n,)."""
    place: Array
    """Centre [pixels], y downwards, shape (n, 2)."""
    error: Array
    """Standard errors of both [pixels], shape (n, 2)."""
    counted_error: Array
    """The same by which a fit should weigh them, as points that share an error show it once [pixels], shape (n, 2)."""
    streak: Array
    """Way during the exposure [pixels], shape (n,)."""
    radius: float
    """Of the mass's disc, or half its narrower side [pixels]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class FilmTrack:
    """Both masses in a film, and how pixels become metres."""

    path: str
    facts: FilmFacts
    settings: TrackSettings
    t: Array
    """Time of each frame from that of the first [s], by the true rate, shape (frames,)."""
    light: Points
    heavy: Points
    side: int
    """1: the heavy mass hangs on the right of the rod; -1: on the left, so that the table is mirrored."""
    rod: tuple[float, float]
    """Centre of the rod [pixels]."""
    rod_error: tuple[float, float]
    """Its standard errors [pixels]."""
    rod_radius: float
    """[pixels]"""
    scale: float
    """[pixels per m]"""
    scale_error: float
    """Its standard error, relative, with that of the declared length."""
    scale_source: str
    """Where it comes from, in words."""
    tilt: float
    """Angle of the heavy mass's vertical in the picture, by which the table is turned back, counterclockwise [rad]."""
    tilt_error: float
    """Its standard error [rad]."""
    release: float
    """Time of the release [s] from the first frame."""
    release_error: float
    """Its standard error [s]."""
    angle: float
    """Angle of the string at the release, from straight up [rad]."""
    hanging_length: float
    """From the rod's height to the heavy mass's centre at the release [m]."""
    string_residual: Array
    """Departure of the string's length from the taut one at each point of the light mass [pixels], shape (n,)."""
    share: float
    """Share of the frames from the release on, over `pendulum.SHARE_SECONDS`, in which the light mass was found."""
    skipped: dict[str, int]
    """Why points are missing -> number of frames."""
    ground: Background = field(repr=False)
    """The picture without the masses."""

    @property
    def string_scatter(self) -> float:
        """Return the standard deviation of `string_residual` [pixels], by its median size, which outliers do not change."""
        return 1.4826 * float(np.median(np.abs(self.string_residual)))

    def metres(self, place: Array) -> Array:
        """Return positions [m] from the rod's centre, x right and y up along the heavy mass's vertical, of pixels (n, 2).

        The light mass starts on the left: a film of the other side is mirrored.
        """
        d = (np.asarray(place) - np.array(self.rod)) / self.scale
        right, up = d[..., 0], -d[..., 1]
        cosine, sine = math.cos(self.tilt), math.sin(self.tilt)
        x, y = cosine * right + sine * up, -sine * right + cosine * up
        return np.stack([self.side * x, y], axis=-1)


class NotTrackedError(FilmError):
    """The masses are not found in a film."""

    def __init__(self, message: str, ground: Background | None, moving: Sequence[MovingPath]) -> None:
        super().__init__(message)
        self.ground = ground
        """The picture without what moves, as far as the tracking came."""
        self.moving = moving
        """Whatever moves."""


def track(path: str | Path, settings: TrackSettings, progress: ReportShare | None = None) -> FilmTrack:
    """Track both masses through a film.

    Raises
    ------
    FilmError
        If the film cannot be read.
    NotTrackedError
        If the masses are not found in it beyond doubt; the message says what would help.
    """
    report = progress or (lambda _, __: None)
    report("reading the film", 0.0)
    seen = survey(path, frame_rate=settings.frame_rate)
    if settings.free_length is None and settings.scale is None:
        raise film_error(seen.path, "found no length that tells the scale, needed one", 'add for example --free-length "58 cm"')
    tracking = _Tracking(seen, settings, report)
    try:
        return tracking.result()
    except FilmError as error:
        text = str(error)
        raise NotTrackedError(
            text if text.startswith(seen.path) else f"{seen.path}: {text}", tracking.ground, tracking.moving
        ) from None


class _Fit(NamedTuple):
    """A thing on a taut string, and that string."""

    light: LightMass
    string: String
    residual: Array
    """Departure of each of its points from the taut string [pixels], shape (n,)."""
    covariance: Array
    """Of the rod's x and y and of the string's length [pixels^2], shape (3, 3)."""

    @property
    def scatter(self) -> float:
        """Return the standard deviation of `residual`, by its median size."""
        return 1.4826 * float(np.median(np.abs(self.residual)))


class _Tracking:
    """The stages of one film's tracking."""

    def __init__(self, seen: Survey, settings: TrackSettings, report: ReportShare) -> None:
        self.seen, self.settings, self.report = seen, settings, report
        self.t, self.facts = seen.t, seen.facts
        self.size = seen.facts.width, seen.facts.height
        self.unit = max(self.size) / 1280
        self.ground: Background | None = None
        self.moving: Sequence[MovingPath] = ()
        self.first, self.last = settings.frames(self.t)
        if self.last - self.first < 5:
            raise FilmError("found fewer than six frames between --from and --to, needed the whole motion; correct them")

    def result(self) -> FilmTrack:
        window, sure = self._window()
        for attempt in (1, 2):
            ground = self.ground = self._background(window, sure=sure)
            first, last = self._span(window)
            blobs = self._blobs(ground, first, last)
            moving = self.moving = paths(blobs, self.t, max(self.size))
            try:
                fall = self._fall(blobs, moving)
            except FilmError:
                if attempt == 2 or self._covers(first, last):
                    raise
                window, sure = (self.first, self.last), False
                continue
            # A background of other pictures is needed only if the masses rested in those that were taken for the fall's
            common = min(fall.last, window[1]) - max(fall.first, window[0])
            if common > 0.6 * (max(fall.last, window[1]) - min(fall.first, window[0])):
                break
            window, sure = (fall.first, fall.last), True
        return self._tied(ground, blobs, moving, fall, last)

    def _covers(self, first: int, last: int) -> bool:
        return first <= self.first and last >= self.last

    def _window(self) -> tuple[tuple[int, int], bool]:
        """Return first and last frame of the fall, as reduced pictures show it, and whether they do."""
        index = self.seen.small_index
        inside = np.flatnonzero((index >= self.first) & (index <= self.last))
        inside = inside[:: max(round(self.facts.rate / WINDOW_RATE), 1)]
        small = [(self.seen.small[i],) for i in inside]
        number = [int(index[i]) for i in inside]
        height = self.seen.small.shape[1]
        best: tuple[float, tuple[int, int]] | None = None
        for low, high in FIRST_WINDOWS:
            guess = (number[int(low * (len(number) - 1))], number[int(high * (len(number) - 1))])
            ground = background(small, number, guess, sure=False)
            films = (
                Picture(k, *planes, *planes[:0], np.empty(0, np.uint8), np.empty(0, np.uint8))
                for k, planes in zip(number, small, strict=True)
            )
            blobs = blobs_of(films, ground, skip=self.seen.repeated)
            found = pendulum.falls(paths(blobs, self.t, max(self.seen.small.shape[1:])), height)
            if found:
                path = found[0]
                score = float(np.ptp(path[:, 2])) * float(np.median(path[:, 4]))
                y = path[:, 2]
                begins = int(path[np.argmax(y > y.min() + 0.5), 0])
                ends = int(path[np.argmax(y > y.min() + 0.9 * np.ptp(y)), 0])
                if best is None or score > 1.2 * best[0]:
                    best = score, (begins, ends)
        if best is not None:
            return best[1], True
        return (number[int(0.1 * (len(number) - 1))], number[int(0.9 * (len(number) - 1))]), False

    def _span(self, window: tuple[int, int]) -> tuple[int, int]:
        """Return the frames that are searched for blobs."""
        t0 = self.t[window[0]]
        first = max(int(np.searchsorted(self.t, t0 - SECONDS_BEFORE)), self.first)
        last = min(int(np.searchsorted(self.t, t0 + SECONDS_AFTER, side="right")), self.last)
        return first, last

    def _background(self, window: tuple[int, int], *, sure: bool) -> Background:
        kept = [p for p in self.seen.kept if self.first <= p.frame <= self.last]
        during = sum(window[0] <= p.frame <= window[1] for p in kept)
        if during < LEAST_SAMPLES:  # of a long film too few were kept there
            wanted = set(np.linspace(window[0], window[1], MOST_SAMPLES).astype(int).tolist()) - {p.frame for p in kept}
            kept += [p.copied() for p in pictures(self.seen, window[0], window[1]) if p.frame in wanted]
            kept.sort(key=lambda p: p.frame)
        return background([p.planes for p in kept], [p.frame for p in kept], window, sure=sure)

    def _blobs(self, ground: Background, first: int, last: int) -> Blobs:
        def progress(frame: int) -> None:
            self.report("following the masses", 0.4 + 0.5 * (frame - first) / max(last - first, 1))

        region = self.settings.region_on_grid(ground)
        blobs = blobs_of(pictures(self.seen, first, last), ground, skip=self.seen.repeated, region=region, progress=progress)
        if not any(blobs.values()):
            raise FilmError(
                "found nothing that moves as a looping pendulum does, needed both masses and their release; "
                "follow whatever moves by --plain"
            )
        return blobs

    def _fall(self, blobs: Blobs, moving: Sequence[MovingPath]) -> Fall:
        candidates = pendulum.falls(moving, self.size[1])
        shown = self.settings.heavy
        if shown is not None:
            near = [
                p
                for p in moving
                if np.any((p[:, 0] == shown.frame) & (np.hypot(p[:, 1] - shown.x, p[:, 2] - shown.y) < 20 * self.unit))
            ]
            if not near:
                raise FilmError(
                    f"found nothing that moves at {shown.x:g},{shown.y:g} in frame {shown.frame}, needed the heavy mass; "
                    "correct --heavy"
                )
            candidates = near + [p for p in candidates if not any(p is q for q in near)]
        if not candidates:
            many = len(moving)
            found = "a single thing that moves" if many == 1 else f"{many} things that move"
            raise FilmError(
                f"found {found}, none of them straight down, needed the heavy mass; is it in the picture, and the camera "
                "upright? Show it by --heavy X,Y@FRAME, or follow whatever moves by --plain"
            )
        return pendulum.heavy_mass(blobs, candidates, self.t, self.unit)

    def _tied(self, ground: Background, blobs: Blobs, moving: Sequence[MovingPath], fall: Fall, last: int) -> FilmTrack:
        """Find the string, and with it the light mass; then all that follows from both."""
        settings, t, unit = self.settings, self.t, self.unit
        heights = fall.heights(len(t))
        ratio = self._ratio(fall)
        until = min(max(fall.last + 3, int(np.searchsorted(t, t[fall.first] + 0.45))), last)
        proposals = pendulum.vote(blobs, fall, heights, ratio, self.size, until, settings.rod)
        tries: list[_Fit] = []
        for proposal in proposals:
            if (fit := self._fitted(proposal, blobs, moving, fall, heights, ratio)) is not None:
                tries.append(fit)
                if len(fit.light.blobs) > 0.8 * np.sum(fit.light.frames[-1] >= np.array(sorted(blobs))) and fit.scatter < unit:
                    break
        if not tries:
            raise FilmError(f"found no thing on a taut string, needed the light mass; {self._way_out(blobs, moving, fall)}")
        best = max(tries, key=lambda each: len(each.light.blobs) - 10 * each.scatter / unit)
        if doubt := self._doubt(blobs, moving, fall, best):
            raise FilmError(doubt)
        if settings.light is None:
            others = [proposal for proposal in proposals if proposal.side != best.string.side]
            self._refuse_mirrored(
                best, (self._fitted(each, blobs, moving, fall, heights, ratio) for each in others), blobs, fall
            )
        return self._finished(ground, blobs, fall, heights, best)

    def _fitted(
        self, proposal: String, blobs: Blobs, moving: Sequence[MovingPath], fall: Fall, heights: Array, ratio: float
    ) -> _Fit | None:
        """Follow the light mass on a string and fit the string to it, in turn; None where nothing is on it."""
        shown = self.settings.light
        seed = None if shown is None else (shown.frame, shown.x, shown.y)
        fit, string = None, proposal
        for _ in range(3):
            light = pendulum.follow(blobs, moving, fall, heights, string, self.t, self.unit, seed)
            if light is None or len(light.blobs) < 6:
                return None
            string, residual, covariance = pendulum.refined(
                light, heights, fall, string, ratio, self.unit, _bearing_at_rest(light, fall), self.settings.rod is not None
            )
            fit = _Fit(light, string, residual, covariance)
        return fit

    def _way_out(self, blobs: Blobs, moving: Sequence[MovingPath], fall: Fall) -> str:
        """Say which option helps against what the film shows beside the apparatus."""
        if max(map(len, blobs.values())) >= MAX_BLOBS:
            return f'more than {MAX_BLOBS} things move at once: show the apparatus by --region "X,Y X,Y"'
        others = [p for p in pendulum.falls(moving, self.size[1]) if not fall.has(p)]
        if others:
            x, y, frame = others[0][0, 1], others[0][0, 2], int(others[0][0, 0])
            return (
                f"another thing falls (from {x:.0f},{y:.0f} in frame {frame}): show the heavy mass by --heavy X,Y@FRAME, "
                "or leave the other out by --region or --from and --to"
            )
        return "show it by --light X,Y@FRAME and the rod by --rod X,Y, or film with more light and contrast"

    def _span_after(self, blobs: Blobs, fall: Fall) -> list[int]:
        """Return the frames from the release on in which the light mass is asked for."""
        return [k for k in blobs if k >= fall.first and self.t[k] < self.t[fall.first] + pendulum.SHARE_SECONDS]

    def _doubt(self, blobs: Blobs, moving: Sequence[MovingPath], fall: Fall, fit: _Fit) -> str:
        """Say why a thing on a taut string is not taken for the light mass; an empty text: it is."""
        limit = pendulum.MAX_STRING_RESIDUAL * self.unit
        span = self._span_after(blobs, fall)
        share = len(set(fit.light.frames.tolist()).intersection(span)) / max(len(span), 1)
        sweep = float(np.ptp(fit.light.phi))
        if share < pendulum.MIN_SHARE or fit.scatter > limit or sweep < pendulum.MIN_SWEEP:
            return (
                f"found no light mass beyond doubt (in {share:.0%} of the frames, {fit.scatter:.1f} pixels from a taut string, "
                f"through {math.degrees(sweep):.0f} deg), needed half the frames, {limit:.1f} pixels and 115 deg; "
                f"{self._way_out(blobs, moving, fall)}"
            )
        beside, (x, y) = abs(fit.string.beside(fall)), fit.string.rod
        if self.settings.rod is None and beside > pendulum.MAX_BESIDE * self.unit:
            return (
                f"found the rod at {x:.0f},{y:.0f}, {beside:.0f} pixels beside the heavy mass's vertical, needed at most "
                f"{pendulum.MAX_BESIDE * self.unit:.0f}, as both masses hang on one string over it; show it by --rod X,Y"
            )
        return ""

    def _refuse_mirrored(self, best: _Fit, others: Iterable[_Fit | None], blobs: Blobs, fall: Fall) -> None:
        """Refuse a film in which something else hangs on a taut string on the other side just as well: a mirror image."""
        for other in others:
            if other is None or self._doubt(blobs, (), fall, other):
                continue
            common, mine, its = np.intersect1d(best.light.frames, other.light.frames, return_indices=True)
            apart = np.hypot(*(best.light.points[mine] - other.light.points[its]).T)
            if np.median(apart) > 2 * best.light.blobs[0].width:
                (x, y), (u, v) = best.light.points[mine[0]], other.light.points[its[0]]
                raise FilmError(
                    f"found two things on a taut string, at {x:.0f},{y:.0f} and at {u:.0f},{v:.0f} in frame {common[0]}, "
                    "needed one; is one a mirror image? show the light mass by --light X,Y@FRAME, or cover the mirror"
                )

    def _ratio(self, fall: Fall) -> float:
        """Return the rod's radius over the free length; where a rule gives the scale, a usual length will do."""
        return self.settings.rod_radius / (self.settings.free_length or 0.5)

    def _finished(self, ground: Background, blobs: Blobs, fall: Fall, heights: Array, fit: _Fit) -> FilmTrack:
        settings, t, unit = self.settings, self.t, self.unit
        light, string, covariance = fit.light, fit.string, fit.covariance
        span = self._span_after(blobs, fall)
        found = set(light.frames.tolist())
        share = sum(k in found for k in span) / max(len(span), 1)
        rest_seen = int(np.sum(fall.rows[:, 0] <= fall.first)) >= 3
        streak = streak_way(np.array([(b.length, b.width) for b in light.blobs]))
        # Near the rod the string turns by a radian in three pictures, over which no cubic follows x and y
        free = string.at(light.points)[0]
        size = np.stack([np.ones_like(free), free], axis=1)
        light_points, light_partial, light_wrong = self._points(
            light.frames, light.points, np.array([b.contrast for b in light.blobs]), streak, ground,
            width=np.array([b.width for b in light.blobs]), course=(np.stack([free, light.phi], axis=1), size),
        )  # fmt: skip
        # The light mass is faster and round, so that its streak tells the exposure, which is the heavy mass's, too
        falling = fall.rows[:, 0].astype(int)
        speed = _speed(t[light.frames], light.points)
        fast = speed > 0.5 * speed.max()
        exposure = float(np.median(streak[fast] / speed[fast]))
        heavy_points, heavy_partial, heavy_wrong = self._points(
            falling, fall.rows[:, 1:3], fall.rows[:, 4], exposure * _speed(t[falling], fall.rows[:, 1:3]), ground,
            width=fall.rows[:, 6], edge_error=EDGE_ERROR,
        )  # fmt: skip
        kept = np.isin(light.frames, light_points.frame)
        released, release_error = pendulum.release(t, heavy_points.frame, heavy_points.place[:, 1], fall.first + 3)
        start = _bearing_at_rest(light, fall)
        at_release = string.constant - string.radius * start
        bend = max(fit.scatter - STRAIGHT * unit, 0.0)
        if settings.scale is not None:
            rule = settings.scale
            scale, scale_error, source = rule.pixels / rule.length, SHOWN_ERROR / rule.pixels, "a length shown in the picture"
        else:
            assert settings.free_length is not None
            if not rest_seen:
                raise FilmError(
                    "found the masses moving from the first frame on, needed the release, at which the free length is known; "
                    'let the film begin before it, or show a length by --scale "X,Y X,Y = 1 m"'
                )
            scale, source = at_release / settings.free_length, "the free length at the release"
            scale_error = math.hypot(
                math.hypot(math.sqrt(covariance[2, 2]), LENGTH_ERROR, bend) / at_release,
                settings.free_length_error / settings.free_length,
            )
        radius = settings.rod_radius * scale
        skipped = {
            "copies of the frame before": int(np.sum(self.seen.repeated)),
            "light mass not found, or not beyond doubt": len(span) - sum(k in found for k in span),
            "heavy mass not found": len(span) - len(set(falling.tolist()).intersection(span)),
            "light mass partly hidden, or one with another thing": light_partial,
            "heavy mass partly hidden, or one with another thing": heavy_partial,
            "light mass off the course of its neighbours": light_wrong,
            "heavy mass off the course of its neighbours": heavy_wrong,
        }
        tilt = math.atan(fall.slope)
        heavy_rest = heights[fall.first]
        track = FilmTrack(
            path=self.seen.path, facts=self.facts, settings=settings, t=t, light=light_points, heavy=heavy_points,
            side=string.side, rod=string.rod,
            rod_error=(math.hypot(math.sqrt(covariance[0, 0]), bend), math.hypot(math.sqrt(covariance[1, 1]), bend)),
            rod_radius=radius, scale=scale, scale_error=scale_error, scale_source=source, tilt=tilt,
            tilt_error=_tilt_error(fall, unit), release=released, release_error=release_error,
            angle=0.0, hanging_length=0.0,
            string_residual=fit.residual[kept], share=share, skipped=skipped, ground=ground,
        )  # fmt: skip
        hanging = -float(track.metres(np.array([fall.column(heavy_rest), heavy_rest]))[1])
        # From straight up, against the sense of the loops, in which the string leaves at right angles to its bearing
        return replace(track, angle=start - track.side * tilt, hanging_length=hanging)

    def _points(
        self, frame: NDArray[np.intp], place: Array, contrast: Array, streak: Array, ground: Background, *,
        width: Array, edge_error: float = 0.0, course: tuple[Array, Array] | None = None,
    ) -> tuple[Points, int, int]:  # fmt: skip
        """Return the points of a mass, and how many are left out as the whole mass is not seen, or their neighbours contradict.

        Parameters
        ----------
        course
            Coordinates that change more smoothly than x and y, and pixels per unit of both, shape (n, 2) each.
        """
        expected = CENTRE_ERROR + NOISE_ERROR * ground.noise / contrast
        # By so much the centre moves where a part is hidden
        off = 0.5 * np.abs(width - median_filter(width, WIDTHS, mode="nearest"))
        speed = _speed(self.t[frame], place)
        usual = 1.4826 * np.median(off[speed > 0.1 * speed.max()])  # at rest, a codec repeats a picture
        keep = off < pendulum.OUTLIER_SIGMAS * np.hypot(expected, usual)
        partial, factor = int(np.sum(~keep)), 1.0
        for _ in range(3):
            chosen = np.flatnonzero(keep)
            smooth, size = (place, np.ones_like(place)) if course is None else course
            distance, leverage = pendulum.from_cubic(self.t[frame[chosen]], smooth[chosen], size[chosen])
            relative = distance / (leverage * expected[chosen])
            known = np.isfinite(relative)
            if not known.any():
                break
            # The median distance of a normal law in two dimensions is 1.18 standard deviations
            factor = float(np.clip(np.median(relative[known]) / 1.18, 1.0, 10))
            wrong = chosen[known & (relative > pendulum.OUTLIER_SIGMAS * 1.4 * factor) & (distance > 0.5 * self.unit)]
            if not len(wrong):
                break
            # The worst first: it leads its neighbours' cubics astray, too
            order = np.argsort(-np.nan_to_num(relative[np.searchsorted(chosen, wrong)]))
            dropped: list[int] = []
            for w in wrong[order]:
                if all(abs(int(w) - d) > 4 for d in dropped):
                    dropped.append(int(w))
            keep[dropped] = False
        frame, place, contrast, streak, width = frame[keep], place[keep], contrast[keep], streak[keep], width[keep]
        own = np.hypot(factor * expected[keep], STREAK_ERROR * streak)
        shared = np.stack([SHARED_ERROR / contrast] * 2 + [np.full(len(frame), edge_error)])
        times = [_in_a_row(place, 0.5 * width)] * 2 + [_in_a_row(place[:, 1:], np.full(len(frame), 0.5))]

        def error_of(x: Array, y: Array, edge: Array) -> Array:
            return np.stack([np.hypot(own, x), np.hypot(np.hypot(own, y), edge)], axis=1)

        counted = error_of(*(shared * np.sqrt(times)))
        points = Points(
            frame=frame,
            place=place,
            error=error_of(*shared),
            counted_error=counted,
            streak=streak,
            radius=_radius(width, streak),
        )
        return points, partial, int(np.sum(~keep)) - partial


def _in_a_row(place: Array, reach: Array) -> Array:
    """Return how many points in a row are less than its reach from each, itself included, of places (n, axes)."""
    count = np.empty(len(place))
    for i, (here, near) in enumerate(zip(place, reach, strict=True)):
        far = np.flatnonzero(np.linalg.norm(place - here, axis=1) >= near)
        k = int(np.searchsorted(far, i))
        count[i] = (far[k] if k < len(far) else len(place)) - (far[k - 1] if k else -1) - 1
    return count


def gravity_shown(track: FilmTrack) -> float:
    """Return the acceleration of free fall by the light mass's first motion across its string [m/s^2].

    Across the string, nothing but gravity acts, and speed along it that turns across, as `usable_points` has it.
    """
    t = track.t[track.light.frame] - track.release
    chosen = (t > 0) & (t < FIRST_MOTION)
    if np.sum(chosen) < LEAST_FIRST_POINTS:
        return math.nan
    t, place, radius = t[chosen], track.metres(track.light.place)[chosen], track.settings.rod_radius
    length, phi = string_coordinates(place, radius, track.angle)
    dt, turn = np.diff(t), np.diff(phi)
    across = 0.5 * (length[1:] + length[:-1]) * turn / dt
    turned = (np.diff(length) + radius * turn) * turn / dt
    pull = np.sin(0.5 * (phi[1:] + phi[:-1])) * dt
    middle = [np.cumsum(steps) - 0.5 * steps for steps in (turned, pull)]
    return float(np.polyfit(middle[1], across + middle[0], 1)[0])


def _radius(width: Array, streak: Array) -> float:
    """Return the radius of a disc by its widths, across its way: of the half of its pictures in which it is slower [pixels]."""
    return 0.5 * float(np.median(width[streak <= np.median(streak)]))


def streak_way(extent: Array) -> Array:
    """Return the way of discs during the exposure [pixels], of their streaks' lengths and widths, shape (n, 2).

    Both are four standard deviations: those of a disc along its way grow by the way over the root of 12.
    """
    return np.asarray(np.sqrt(0.75 * np.maximum(extent[:, 0] ** 2 - extent[:, 1] ** 2, 0.0)))


def _speed(t: Array, place: Array) -> Array:
    """Return the speed at each point of a track [pixels/s], shape (n,), without outliers."""
    smooth = median_filter(place, (5, 1), mode="nearest")
    return np.asarray(np.hypot(*np.gradient(smooth, t, axis=0).T)) if len(t) > 1 else np.zeros(len(t))


def _bearing_at_rest(light: LightMass, fall: Fall) -> float:
    """Return the bearing of the string at the release [rad]."""
    order = np.argsort(light.frames)
    before = light.phi[light.frames <= fall.first]
    return float(np.median(before[-15:])) if len(before) >= 2 else float(light.phi[order[0]])


def _tilt_error(fall: Fall, unit: float) -> float:
    """Return the standard error of the heavy mass's vertical [rad]: it swings a little, and its points scatter."""
    y = fall.rows[:, 2]
    x = fall.rows[:, 1] - fall.column(y)
    spread = max(float(np.std(y)), 1.0)
    scatter = max(1.4826 * float(np.median(np.abs(x - np.median(x)))), 0.1)
    return float(np.hypot(scatter * 3 / math.sqrt(len(y)) / spread, 0.3 * unit / float(np.ptp(y))))


def film_window(track: FilmTrack) -> tuple[int, int]:
    """Return the first and last frame in which both masses were followed."""
    return int(min(track.light.frame[0], track.heavy.frame[0])), int(max(track.light.frame[-1], track.heavy.frame[-1]))
