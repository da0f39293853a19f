"""Follow whatever moves in a film, without physics: a ball, a cart, a bob; pixels and seconds, or metres by a rule."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from looping_pendulum.film.decode import FilmError, FilmFacts, Survey, film_error, picture_change, pictures, survey
from looping_pendulum.film.moving import Background, Blobs, background, blobs_of, joined, paths
from looping_pendulum.film.track import Points, TrackSettings, streak_way
from looping_pendulum.processes import ReportShare
from looping_pendulum.reference_ode.geometry import Array

NAMES = "ABCDEFGH"
"""Of the things that are written, at most."""
ERROR = 0.3
"""Standard error of their points [pixels]."""
LEAST_WAY = 0.04
"""Shortest way of a thing, as a share of the picture's longer side: what only trembles is no motion."""
LEAST_FRAMES = 6
BUSY_SHARE = 0.8
"""Share of all change that lies in the time in which things move."""
BUSY_FILM = 0.7
"""Share of the film from which on they move all the time."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PlainTrack:
    """Things that move in a film, the one that goes farthest first."""

    path: str
    facts: FilmFacts
    settings: TrackSettings
    t: Array
    """Time of each frame from that of the first [s]."""
    things: Mapping[str, Points]
    """Name -> its points: "A", "B" and so on."""

    def table(self) -> str:
        """Return the things' points over time as CSV, y upwards: in pixels, or in metres if a rule was shown."""
        rule = self.settings.scale
        unit, scale = "px", 1.0
        if rule is not None:
            unit, scale = "m", rule.pixels / rule.length
        names = [f"{name}_{axis} [{unit}]" for name in self.things for axis in "xy"]
        rows = [",".join(["t [s]", "frame", *names])]
        index = {name: {int(k): i for i, k in enumerate(p.frame)} for name, p in self.things.items()}
        for k in sorted(set().union(*index.values())):
            cells = [f"{self.t[k]:.6f}", str(k)]
            for name, points in self.things.items():
                i = index[name].get(k)
                x, y = (np.nan, np.nan) if i is None else points.place[i] / scale
                cells += ["", ""] if i is None else [f"{x:.6g}", f"{self.facts.height / scale - y:.6g}"]
            rows.append(",".join(cells))
        return "\n".join(rows) + "\n"


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
    ground = _ground(seen, first, last)
    report("following what moves", 0.4)
    blobs = blobs_of(
        pictures(seen, first, last), ground, skip=seen.repeated, region=settings.region_on_grid(ground), whole=True,
        progress=lambda k: report("following what moves", 0.4 + 0.5 * (k - first) / max(last - first, 1)),
    )  # fmt: skip
    things = _things(seen, blobs, settings)
    if not things:
        raise FilmError(
            f"{seen.path}: found nothing that moves, needed something; is it the right film? Shorten it by --from and --to"
        )
    return PlainTrack(path=seen.path, facts=seen.facts, settings=settings, t=seen.t, things=things)


def _ground(seen: Survey, first: int, last: int) -> Background:
    kept = [p for p in seen.kept if first <= p.frame <= last]
    if len(kept) < 9:
        wanted = set(np.linspace(first, last, 15).astype(int).tolist())
        kept = [p.copied() for p in pictures(seen, first, last) if p.frame in wanted]
    window = _busy(seen, first, last)
    # Before and after a motion that fills the film there is too little to vote with
    sure = window[1] - window[0] > BUSY_FILM * (last - first)
    return background([p.planes for p in kept], [p.frame for p in kept], window, sure=sure, rests=not sure)


def _busy(seen: Survey, first: int, last: int) -> tuple[int, int]:
    """Return first and last frame of the shortest time with most of the change: a thing may rest for longer than it moves."""
    inside = np.flatnonzero((seen.small_index >= first) & (seen.small_index <= last))
    total = np.concatenate([[0.0], np.cumsum([picture_change(a, b) for a, b in pairwise(seen.small[inside])])])
    # For each beginning, the first end by which the share is reached
    ends = np.searchsorted(total, total + BUSY_SHARE * total[-1])
    begins = np.flatnonzero(ends < len(total))
    best = int(begins[np.argmin(ends[begins] - begins)])
    return int(seen.small_index[inside[best]]), int(seen.small_index[inside[ends[best]]])


def _things(seen: Survey, blobs: Blobs, settings: TrackSettings) -> dict[str, Points]:
    """Return the paths that go farthest, times their contrast, with names."""
    width = max(seen.facts.width, seen.facts.height)
    found = []
    for path in joined(paths(blobs, seen.t, width), seen.t):
        way = float(np.hypot(np.ptp(path[:, 1]), np.ptp(path[:, 2])))
        if way < LEAST_WAY * width or len(path) < LEAST_FRAMES:
            continue
        shown = settings.light
        if shown is not None and not np.any(
            (path[:, 0] == shown.frame) & (np.hypot(path[:, 1] - shown.x, path[:, 2] - shown.y) < 0.02 * width)
        ):
            continue
        found.append((way * float(np.median(path[:, 4])), path))
    found.sort(key=lambda each: -each[0])
    things = {}
    for name, (_, path) in zip(NAMES, found, strict=False):
        error = np.full((len(path), 2), ERROR)
        things[name] = Points(
            frame=path[:, 0].astype(int), place=path[:, 1:3], error=error, counted_error=error,
            streak=streak_way(path[:, 5:7]), radius=0.5 * float(np.median(path[:, 6])),
        )  # fmt: skip
    return things
