"""Track a film of a looping pendulum: the function to call, which leads from the pictures to the points."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from looping_pendulum.measured.film import FilmError, geometry, pendulum
from looping_pendulum.measured.film.decode import Bytes, Survey, film_error, pictures, survey
from looping_pendulum.measured.film.geometry import SHOWN_ERROR
from looping_pendulum.measured.film.moving import (
    MAX_BLOBS,
    Background,
    Blobs,
    MovingPath,
    background,
    blobs_of,
    paths,
    samples_of,
    streak_way,
)
from looping_pendulum.measured.film.pendulum import Fall, LightMass, String
from looping_pendulum.measured.film.points import mass_points, speed
from looping_pendulum.measured.film.record import FilmTrack, Geometry, Points, Release, Stated, TrackSettings
from looping_pendulum.processes import ReportShare
from looping_pendulum.reference_ode.geometry import Array

SECONDS_BEFORE, SECONDS_AFTER = 0.3, 3.0
"""Times before and after the release between which pictures are searched [s]; by then the light mass is wound up."""
EDGE_ERROR = 0.1
"""Error of the falling mass's height [pixels]: its lower edge lies along the rows, and comes to the next one all at once."""
LEAST_MARKS = 6
"""Fewest marks of the light mass while the heavy one is seen."""
LEAST_SHARE_OF_TWIN = 0.5
"""Frames on a taut string, as a share of those of the light mass, from which on another thing may be it, too."""
FAR_FROM_REST = 0.5
"""Bearing from the first motion on from which on a mark before it is none of the light mass [rad]."""
ENOUGH, MAX_ROUNDS = 0.7, 4
"""Share of the frames from the release to the last mark on a taut string from which on no other string is tried, and times
that the light mass is followed and its string is fitted, in turn."""
WINDOW_RATE, FIRST_WINDOWS = 120.0, ((0.1, 0.6), (0.3, 0.9), (0.05, 0.3))
"""Pictures per second by which the time of the fall is found [Hz], and where it may be at first, as shares of the frames."""
SAME_WINDOW = 0.6
"""Share of two times of the fall that they have in common from which on the background of the one serves the other."""
USUAL_LENGTH = 0.5
"""Free length by which the rod's radius is judged where a rule gives the scale [m]."""


class NotTrackedError(FilmError):
    """The masses are not found in a film."""

    def __init__(self, message: str, still: Bytes | None, moving: Sequence[MovingPath]) -> None:
        super().__init__(message)
        self.still = still
        """Brightness of the picture without what moves, as far as the tracking came."""
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
    seen = survey(path, frame_rate=settings.frame_rate, needs_rest=not settings.still)
    if settings.free_length is None and settings.scale is None:
        raise film_error(seen.path, "found no length that tells the scale, needed one", 'add for example --free-length "58 cm"')
    begin, end = settings.frames(seen.t)
    if end - begin < 5:
        raise film_error(
            seen.path, "found fewer than six frames between --from and --to, needed all the motion", "correct them"
        )
    still: Bytes | None = None
    moving: Sequence[MovingPath] = ()
    try:
        window = _window(seen, begin, end)
        for attempt in (1, 2):
            ground = background(samples_of(seen.path, begin, end, window), window)
            still = ground.planes[0]
            first = max(int(np.searchsorted(seen.t, seen.t[window[0]] - SECONDS_BEFORE)), begin)
            last = min(int(np.searchsorted(seen.t, seen.t[window[0]] + SECONDS_AFTER, side="right")), end)
            shown = pictures(seen.path, first, last, lambda share: report("following the masses", 0.4 + 0.5 * share))
            blobs = blobs_of(shown, ground, skip=seen.facts.repeated, region=settings.region)
            if not any(blobs.values()):
                raise FilmError(
                    "found nothing that moves as a looping pendulum does, needed both masses and their release; "
                    "follow whatever moves by --plain"
                )
            moving = paths(blobs, seen.t, max(seen.facts.size))
            try:
                fall = _fall(seen, settings, blobs, moving)
            except FilmError:
                if attempt == 2 or (first <= begin and last >= end):
                    raise
                window = begin, end
                continue
            # A background of other pictures is needed only if the masses rested in those that were taken for the fall's
            common = min(fall.last, window[1]) - max(fall.first, window[0])
            if common > SAME_WINDOW * (max(fall.last, window[1]) - min(fall.first, window[0])):
                break
            window = fall.first, fall.last
        scene = _Scene(seen=seen, settings=settings, blobs=blobs, moving=moving, fall=fall)
        return _finished(scene, ground, _tied(scene, last))
    except FilmError as error:
        text = str(error)
        raise NotTrackedError(text if text.startswith(seen.path) else f"{seen.path}: {text}", still, moving) from None


def _window(seen: Survey, begin: int, end: int) -> tuple[int, int]:
    """Return first and last frame of the fall, as reduced pictures show it, or of most of the film."""
    inside = [p for p in seen.small if begin <= p.frame <= end][:: max(round(seen.facts.clock.rate / WINDOW_RATE), 1)]
    if len(inside) < 3:
        return begin, end
    height, width = inside[0].planes[0].shape
    number = [p.frame for p in inside]
    best: tuple[float, tuple[int, int]] | None = None
    for low, high in FIRST_WINDOWS:
        guess = (number[int(low * (len(number) - 1))], number[int(high * (len(number) - 1))])
        blobs = blobs_of(inside, background(inside[:: math.ceil(len(inside) / 45)], guess), skip=seen.facts.repeated)
        falls = pendulum.falls(paths(blobs, seen.t, max(height, width)), height)
        if falls:
            path = falls[0]
            y = path[:, 2]
            score = float(np.ptp(y)) * float(np.median(path[:, 4]))
            begins = int(path[np.argmax(y > y.min() + 0.5), 0])
            ends = int(path[np.argmax(y > y.min() + 0.9 * np.ptp(y)), 0])
            if best is None or score > 1.2 * best[0]:
                best = score, (begins, ends)
    if best is not None:
        return best[1]
    return number[int(0.1 * (len(number) - 1))], number[int(0.9 * (len(number) - 1))]


def _fall(seen: Survey, settings: TrackSettings, blobs: Blobs, moving: Sequence[MovingPath]) -> Fall:
    """Return the heavy mass: what falls straight down, or what a person has shown.

    Raises
    ------
    FilmError
        If nothing does.
    """
    candidates = pendulum.falls(moving, seen.facts.height)
    shown = settings.heavy
    if shown is not None:
        reach = 20 * seen.facts.unit

        def is_shown(path: MovingPath) -> bool:
            return bool(np.any((path[:, 0] == shown.frame) & (np.hypot(path[:, 1] - shown.x, path[:, 2] - shown.y) < reach)))

        near = [path for path in moving if is_shown(path)]
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
    return pendulum.heavy_mass(blobs, candidates, seen.t, seen.facts.unit)


class _Fit(NamedTuple):
    """A thing on a taut string, and that string."""

    light: LightMass
    string: String
    geometry: Geometry


@dataclass(frozen=True, kw_only=True, eq=False)
class _Scene:
    """A film, all that moves in it, and the heavy mass."""

    seen: Survey
    settings: TrackSettings
    blobs: Blobs
    moving: Sequence[MovingPath]
    fall: Fall

    @property
    def t(self) -> Array:
        """Return the time of each frame [s]."""
        return self.seen.t

    @property
    def unit(self) -> float:
        """Return a pixel of a picture 1280 wide [pixels]."""
        return self.seen.facts.unit

    def asked(self) -> list[int]:
        """Return the frames from the release on in which the light mass is asked for."""
        first = self.fall.first
        return [k for k in self.blobs if k >= first and self.t[k] < self.t[first] + pendulum.SHARE_SECONDS]


def _tied(scene: _Scene, last: int) -> _Fit:
    """Find the string, and with it the light mass, in the frames up to ``last``."""
    fall, t, settings = scene.fall, scene.t, scene.settings
    ratio = settings.rod_radius / (settings.free_length or USUAL_LENGTH)
    until = min(max(fall.last + 3, int(np.searchsorted(t, t[fall.first] + 0.45))), last)
    proposals = pendulum.vote(scene.blobs, fall, ratio, scene.seen.facts.size, until, settings.rod)
    tries: list[_Fit] = []
    for proposal in proposals:
        if (fit := _fitted(scene, proposal)) is not None:
            tries.append(fit)
            asked = sum(fall.first <= k <= fit.light.frames[-1] for k in scene.blobs)
            if len(fit.geometry.frames) > ENOUGH * asked and fit.geometry.scatter < scene.unit:
                break
    if not tries:
        raise FilmError(f"found no thing on a taut string, needed the light mass; {_way_out(scene)}")
    beyond_doubt = [fit for fit in tries if not _doubt(scene, fit)]
    best = max(beyond_doubt or tries, key=lambda fit: len(fit.geometry.frames) - 10 * fit.geometry.scatter / scene.unit)
    if not beyond_doubt:
        raise FilmError(_doubt(scene, best))
    if settings.light is None:
        _refuse_mirrored(scene, best, (p for p in proposals if p.side != best.string.side))
    return best


def _fitted(scene: _Scene, proposal: String, rounds: int = MAX_ROUNDS) -> _Fit | None:
    """Follow the light mass on a string and fit the string to it, in turn; None where nothing is on it."""
    fit, string = None, proposal
    for _ in range(rounds):
        light = pendulum.follow(scene.blobs, scene.moving, scene.fall, string, scene.t, scene.unit, scene.settings.light)
        if light is None or np.sum(scene.fall.known[light.frames]) < LEAST_MARKS:
            return None
        if fit is not None and np.array_equal(light.rows, fit.light.rows):
            break
        found = _geometry(scene, light, string, _bearing_at_rest(light, scene.fall))
        string = String(
            side=found.side, rod=found.rod, radius=found.rod_pixels, gate=max(3.5 * scene.unit, 6 * found.scatter),
            constant=found.values["free_length"] * found.scale + found.rod_pixels * found.bearing, seen=found.string_at,
        )  # fmt: skip
        fit = _Fit(light, string, found)
    return fit


def _geometry(scene: _Scene, light: LightMass, string: String, bearing: float) -> Geometry:
    """Fit the geometry to the marks of a light mass, with what is stated of it as priors."""
    settings = scene.settings
    radius, free_length, rule = settings.rod_radius, settings.free_length, settings.scale
    priors = {"rod_radius": Stated(value=radius, error=settings.rod_radius_error or geometry.ROD_PRIOR * radius)}
    in_pixels = string.constant - string.radius * bearing
    scale = in_pixels / free_length if rule is None and free_length else 0.0
    if rule is not None:
        scale = rule.pixels / rule.length
        priors["scale"] = Stated(value=scale, error=scale * SHOWN_ERROR / rule.pixels)
    if free_length is None:
        priors["free_length"] = Stated(value=in_pixels / scale, error=in_pixels / scale)
    else:
        error = settings.free_length_error or geometry.LENGTH_PRIOR * free_length
        priors["free_length"] = Stated(value=free_length, error=error)
    if settings.rod is not None:
        for name, value in zip(("rod_x", "rod_y"), settings.rod, strict=True):
            priors[name] = Stated(value=value, error=SHOWN_ERROR / math.sqrt(2))
    if settings.readout is not None:
        delay = settings.readout * scale / scene.seen.facts.height
        priors["readout"] = Stated(value=delay, error=geometry.KNOWN_READOUT_ERROR)
    start = {"rod_x": string.rod[0], "rod_y": string.rod[1], "scale": scale}
    return geometry.fit_camera(
        light, scene.fall, scene.t, side=string.side, size=scene.seen.facts.size, start=start, priors=priors, bearing=bearing,
    )  # fmt: skip


def _bearing_at_rest(light: LightMass, fall: Fall) -> float:
    """Return the bearing of the string at the release [rad]; what is far from the first motion is a hand."""
    after = float(light.phi[np.searchsorted(light.frames, fall.first).clip(0, len(light.phi) - 1)])
    before = light.phi[light.frames <= fall.first][-15:]
    at_rest = float(np.median(before)) if len(before) >= 2 else after
    return at_rest if abs(at_rest - after) < FAR_FROM_REST else after


def _way_out(scene: _Scene) -> str:
    """Say which option helps against what the film shows beside the apparatus."""
    if max(map(len, scene.blobs.values())) >= MAX_BLOBS:
        return f'more than {MAX_BLOBS} things move at once: show the apparatus by --region "X,Y X,Y"'
    falls = pendulum.falls(scene.moving, scene.seen.facts.height)
    others = [p for p in falls if abs(np.median(p[:, 1] - scene.fall.column(p[:, 2]))) > 3 * scene.unit]
    if others:
        x, y, frame = others[0][0, 1], others[0][0, 2], int(others[0][0, 0])
        return (
            f"another thing falls (from {x:.0f},{y:.0f} in frame {frame}): show the heavy mass by --heavy X,Y@FRAME, "
            "or leave the other out by --region or --from and --to"
        )
    return "show it by --light X,Y@FRAME and the rod by --rod X,Y, or film with more light and contrast"


def _doubt(scene: _Scene, fit: _Fit) -> str:
    """Say why a thing on a taut string is not taken for the light mass; an empty text: it is."""
    limit = pendulum.MAX_STRING_RESIDUAL * scene.unit
    asked = scene.asked()
    share = len(set(fit.light.frames.tolist()).intersection(asked)) / max(len(asked), 1)
    taut = np.isin(fit.light.frames, fit.geometry.frames)
    sweep = float(np.ptp(fit.light.phi[taut])) if taut.any() else 0.0
    if share < pendulum.MIN_SHARE or sweep < pendulum.MIN_SWEEP:
        return (
            f"found no light mass beyond doubt (in {share:.0%} of the frames, through {math.degrees(sweep):.0f} deg), "
            f"needed half the frames and 115 deg; {_way_out(scene)}"
        )
    if fit.geometry.scatter > limit:
        return (
            f"found a light mass {fit.geometry.scatter:.1f} pixels from a taut string, needed {limit:.1f}; is it this mass "
            "that hangs on the string? Show it by --light X,Y@FRAME and the rod by --rod X,Y"
        )
    string = fit.string
    x, y = string.rod
    beside = abs(x + string.side * string.radius - float(scene.fall.column(y)))  # the mass hangs from the rod's edge
    if scene.settings.rod is None and beside > pendulum.MAX_BESIDE * scene.unit:
        return (
            f"found the rod at {x:.0f},{y:.0f}, {beside:.0f} pixels beside the heavy mass's vertical, needed at most "
            f"{pendulum.MAX_BESIDE * scene.unit:.0f}, as both masses hang on one string over it; show it by --rod X,Y"
        )
    return ""


def _refuse_mirrored(scene: _Scene, best: _Fit, proposals: Iterable[String]) -> None:
    """Refuse a film in which something else hangs on a taut string on the other side just as well: a mirror image."""
    for proposal in proposals:
        other = _fitted(scene, proposal, rounds=2)
        if other is None or _doubt(scene, other):
            continue
        if len(other.geometry.frames) < LEAST_SHARE_OF_TWIN * len(best.geometry.frames):
            continue
        common, mine, its = np.intersect1d(best.light.frames, other.light.frames, return_indices=True)
        apart = np.hypot(*(best.light.points[mine] - other.light.points[its]).T)
        if np.median(apart) > 2 * best.light.rows[0, 6]:
            (x, y), (u, v) = best.light.points[mine[0]], other.light.points[its[0]]
            raise FilmError(
                f"found two things on a taut string, at {x:.0f},{y:.0f} and at {u:.0f},{v:.0f} in frame {common[0]}, "
                "needed one; is one a mirror image? show the light mass by --light X,Y@FRAME, or cover the mirror"
            )


def _finished(scene: _Scene, ground: Background, fit: _Fit) -> FilmTrack:
    """Return all that follows from the masses that were found: their points with errors, and the release."""
    seen, settings, t, fall, light = scene.seen, scene.settings, scene.t, scene.fall, fit.light
    if settings.scale is None and np.sum(fall.rows[:, 0] <= fall.first) < 3:
        raise FilmError(
            "found the masses moving from the first frame on, needed the release, at which the free length is known; "
            'let the film begin before it, or show a length by --scale "X,Y X,Y = 1 m"'
        )
    streak = streak_way(light.rows)
    # Near the rod the string turns by a radian in three pictures, over which no cubic follows x and y
    free, _ = fit.string.at(light.points)
    course = np.stack([free, light.phi], axis=1), np.stack([np.ones_like(free), free], axis=1)
    light_points, light_left_out = mass_points("light", light.rows, t, streak, ground.noise, scene.unit, course=course)
    # The light mass is faster and round, so that its streak tells the exposure, which is the heavy mass's, too
    light_mass_speed = speed(t[light.frames], light.points)
    fast = light_mass_speed > 0.5 * light_mass_speed.max()
    exposure = float(np.median(streak[fast] / light_mass_speed[fast]))
    falling = fall.rows[:, 0].astype(int)
    heavy_streak = exposure * speed(t[falling], fall.rows[:, 1:3])
    heavy_points, heavy_left_out = mass_points(
        "heavy", fall.rows, t, heavy_streak, ground.noise, scene.unit, edge_error=EDGE_ERROR
    )
    view, released, hanging_length = _released(scene, fit, light_points, heavy_points)
    asked = set(scene.asked())
    missing = len(asked.difference(light.frames.tolist()))
    skipped = {
        "copies of the frame before": len(seen.facts.repeated),
        "light mass not found, or not beyond doubt": missing,
        "heavy mass not found": len(asked.difference(falling.tolist())),
    }
    return FilmTrack(
        path=seen.path, facts=seen.facts, settings=settings, t=t, light=light_points, heavy=heavy_points,
        geometry=view, release=released, hanging_length=hanging_length, still=ground.planes[0],
        skipped=skipped | light_left_out | heavy_left_out,
        scale_source="the free length at the release" if settings.scale is None else "a length shown in the picture",
        share=1 - missing / max(len(asked), 1),
    )  # fmt: skip


def _released(scene: _Scene, fit: _Fit, light: Points, heavy: Points) -> tuple[Geometry, Release, float]:
    """Return the geometry, the release, and the hanging length [m]: each needs the others, but little."""
    fall, t = scene.fall, scene.t
    first, rest = _bearing_at_rest(fit.light, fall), fall.heights[fall.first]
    at_rest = np.array([fall.column(rest), rest])
    moves, view = fall.first + 3, fit.geometry
    found = geometry.fit_release(view, t, light, heavy, moves, first, -float(view.metres(at_rest)[1]))
    if found is None:
        step = float(np.median(np.diff(t)))
        found = Release(time=float(t[moves]), time_error=2 * step, angle=first, angle_error=None)
    else:
        view = _geometry(scene, fit.light, fit.string, found.angle)
    return view, found, -float(view.metres(at_rest)[1])
