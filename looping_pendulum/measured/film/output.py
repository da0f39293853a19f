"""Write what was found in a film: the table of points, the record, and the pictures by which a person checks both."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from looping_pendulum.files import write_atomically
from looping_pendulum.measured.film import FilmError
from looping_pendulum.measured.film.decode import Bytes, Picture, av, cv2, pictures
from looping_pendulum.measured.film.moving import MovingPath
from looping_pendulum.measured.film.record import FilmFiles, FilmTrack, PlainTrack, TrackSettings, record_text
from looping_pendulum.measured.film.track import NotTrackedError, track
from looping_pendulum.measured.tables.plain_table import plain_table
from looping_pendulum.processes import ReportShare

DECIMALS = 6
"""Of the table, in seconds and metres. It is an export: a study that names the film takes the points themselves."""


def refuse_foreign_table(files: FilmFiles) -> None:
    """Refuse to write over a table that tracking did not write: it may be somebody's work of an hour.

    Raises
    ------
    FilmError
        If there is such a table.
    """
    if not files.table.is_file():
        return
    with files.table.open(encoding="utf-8", errors="replace") as stream:
        head = stream.readline(400)
    if not head.startswith("t [s],"):
        raise FilmError(f"{files.table}: found a table of another program, needed room for the points; rename it, or use --out")


def table_of_things(track: PlainTrack) -> str:
    """Return the things' points over time as CSV, y upwards: in pixels, or in metres if a rule was shown."""
    rule = track.settings.scale
    unit, scale = ("px", 1.0) if rule is None else ("m", rule.pixels / rule.length)
    rows = [",".join(["t [s]", "frame", *(f"{name}_{axis} [{unit}]" for name in track.things for axis in "xy")])]
    for k in sorted(set().union(*(points.row for points in track.things.values()))):
        cells = [f"{track.t[k]:.6f}", str(k)]
        for points in track.things.values():
            if k in points.row:
                x, y = points.place[points.row[k]]
                cells += [f"{x / scale:.6g}", f"{(track.facts.height - y) / scale:.6g}"]
            else:
                cells += ["", ""]
        rows.append(",".join(cells))
    return "\n".join(rows) + "\n"


def track_and_write(
    film: str | Path, settings: TrackSettings, files: FilmFiles, progress: ReportShare | None = None, *, overlay: bool = False
) -> tuple[FilmTrack, list[Path]]:
    """Track a film and write what `write` does; return its track and the paths.

    Raises
    ------
    FilmError
        As `track` does, and if a table of another program is in the way. Where the masses are not found, the contact sheet
        shows whatever moves, with the places that options ask for.
    """
    refuse_foreign_table(files)
    try:
        found = track(film, settings, progress)
    except NotTrackedError as error:
        if error.still is None or not error.moving:
            raise
        write_atomically(files.sheet, _png(sheet_of_moving_things(error.still, error.moving, str(error))))
        raise FilmError(f"{error}; {files.sheet.name} shows what moves") from None
    return found, write(found, files, overlay=overlay)


def write(track: FilmTrack, files: FilmFiles, *, overlay: bool = False) -> list[Path]:
    """Write table, record and contact sheet, with ``overlay`` the film with its marks, too; return their paths."""
    write_atomically(files.table, plain_table(track.observations(Path(track.path).stem), DECIMALS))
    write_atomically(files.record, record_text(track))
    write_atomically(files.sheet, _png(contact_sheet(track)))
    written = [files.table, files.record, files.sheet]
    if overlay:
        write_overlay(track, files.overlay)
        written.append(files.overlay)
    return written


def write_plain(track: PlainTrack, files: FilmFiles) -> list[Path]:
    """Write the table of things that move and the record of their film; return the paths."""
    write_atomically(files.table, table_of_things(track))
    write_atomically(files.record, record_text(track))
    return [files.table, files.record]


def _png(picture: Bytes) -> bytes:
    return bytes(cv2.imencode(".png", picture)[1])


SHEET_WIDTH = 1280
"""Width of the contact sheet [pixels]."""
TILES, TILE_REACH = 8, 0.07
"""Enlarged frames on the contact sheet, and how far they show around the light mass [m]."""
LIGHT_COLOUR, HEAVY_COLOUR, ROD_COLOUR, CROSS_COLOUR = (0, 0, 230), (230, 110, 0), (0, 150, 0), (0, 230, 255)
"""Of both masses' paths, of the rod, and of crosses on the masses themselves: blue, green and red."""
PATH_COLOURS = (
    LIGHT_COLOUR, HEAVY_COLOUR, ROD_COLOUR, (0, 140, 240), (190, 0, 190), (150, 140, 0), (90, 90, 90), (60, 30, 120)
)  # fmt: skip
"""Of things that move, of which the masses are not known."""
INK, PAPER, RULE = (40, 40, 40), (255, 255, 255), (200, 200, 200)


def contact_sheet(track: FilmTrack) -> Bytes:
    """Return the picture by which a person checks the points: the paths, eight frames enlarged, the string's residual."""
    view = track.geometry
    scene, shrink = _pale(track.still)
    for points, colour in ((track.light, LIGHT_COLOUR), (track.heavy, HEAVY_COLOUR)):
        for place in points.place * shrink:
            _circle(scene, place, 1.5, colour)
    _circle(scene, np.array(view.rod) * shrink, max(view.rod_pixels * shrink, 2), ROD_COLOUR, thickness=2)
    lines = (
        f"{Path(track.path).name}: light mass (red) in {track.share:.0%} of the frames, heavy mass blue, rod green",
        f"scale {view.scale:.1f} px/m +/- {view.scale_error:.2%}, string within {view.scatter:.2f} px, release at "
        f"{track.release.time:.3f} s, {track.facts.clock.rate:.4g} frames/s, angle {math.degrees(track.release.angle):.1f} deg",
    )
    tiles = _tiles(track)
    return _sheet(_text(lines), scene, np.hstack(tiles[:4]), np.hstack(tiles[4:]), _residual_plot(track))


def sheet_of_moving_things(still: Bytes, moving: Sequence[MovingPath], message: str) -> Bytes:
    """Return the picture by which a person finds the masses: the longest paths, each with its first place and frames."""
    scene, shrink = _pale(still)
    longest = sorted(moving, key=lambda path: -float(np.ptp(path[:, 1:3], axis=0).sum()))
    named = list(zip(longest, PATH_COLOURS, strict=False))
    for path, colour in named:
        for place in path[:, 1:3] * shrink:
            _circle(scene, place, 1.5, colour)
    for path, colour in named:
        frame, x, y = path[len(path) // 2, :3]
        _circle(scene, (x * shrink, y * shrink), 5, colour)
        _write(scene, f"{x:.0f},{y:.0f}@{frame:.0f}", x * shrink + 9, y * shrink + 5, 0.5)
    found, *ways_out = message.split("; ")
    lines = [found, *textwrap.wrap("; ".join(ways_out), 130), "Places in a frame, X,Y@FRAME, of what moves farthest:"]
    return _sheet(_text(lines), scene)


def write_overlay(track: FilmTrack, path: Path) -> None:
    """Write the film from the release on with its marks, at 30 frames a second."""
    width, height = (track.facts.width // 2 * 2, track.facts.height // 2 * 2)
    part = path.with_name(f".{path.name}.part")
    try:
        with av.open(str(part), "w", format="mp4") as container:
            stream = container.add_stream("libx264", rate=Fraction(30))
            stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
            stream.options = {"crf": "23", "preset": "veryfast"}
            for picture in pictures(track.path, *track.window):
                shown = np.ascontiguousarray(_in_colours(picture)[:height, :width])
                for points, colour in ((track.light, LIGHT_COLOUR), (track.heavy, HEAVY_COLOUR)):
                    if picture.frame in points.row:
                        _cross(shown, points.place[points.row[picture.frame]], 12, colour)
                _circle(shown, track.geometry.rod, max(track.geometry.rod_pixels, 2), ROD_COLOUR, thickness=1)
                container.mux(stream.encode(av.VideoFrame.from_ndarray(shown, format="bgr24")))
            container.mux(stream.encode())
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)


def _sheet(*parts: Bytes) -> Bytes:
    """Return pictures one below the other, as wide as the sheet."""
    wide = [cv2.copyMakeBorder(part, 0, 0, 0, SHEET_WIDTH - part.shape[1], cv2.BORDER_CONSTANT, value=PAPER) for part in parts]
    return np.vstack(wide)


def _pale(still: Bytes) -> tuple[Bytes, float]:
    """Return the background as wide as a sheet, or half as wide if it is upright, in pale grey, and by how much it shrank."""
    height, width = still.shape
    shrink = SHEET_WIDTH / width if width >= height else 0.5 * SHEET_WIDTH / width
    scene = cv2.cvtColor(cv2.resize(still, None, fx=shrink, fy=shrink, interpolation=cv2.INTER_AREA), cv2.COLOR_GRAY2BGR)
    return cv2.addWeighted(scene, 0.55, np.full_like(scene, 255), 0.45, 0), shrink


def _text(lines: Sequence[str]) -> Bytes:
    head = np.full((10 + 24 * len(lines), SHEET_WIDTH, 3), 255, np.uint8)
    for i, text in enumerate(lines):
        _write(head, text, 10, 22 + 24 * i, 0.55)
    return head


def _tiles(track: FilmTrack) -> list[Bytes]:
    """Return eight frames from the release on, enlarged around the light mass."""
    frames = track.light.frame[track.t[track.light.frame] >= track.release.time]
    frames = frames if len(frames) >= TILES else track.light.frame
    wanted = {int(k) for k in frames[np.linspace(0, len(frames) - 1, TILES).astype(int)]}
    half, side = max(int(TILE_REACH * track.geometry.scale), 24), SHEET_WIDTH // 4
    tiles = []
    for picture in pictures(track.path, min(wanted), max(wanted)):
        if picture.frame not in wanted:
            continue
        centre = track.light.place[track.light.row[picture.frame]]
        part = cv2.getRectSubPix(_in_colours(picture), (2 * half, 2 * half), tuple(centre.tolist()))
        tile = cv2.resize(part, (side, side), interpolation=cv2.INTER_CUBIC)
        for points in (track.light, track.heavy):
            if picture.frame in points.row:
                place = points.place[points.row[picture.frame]]
                _cross(tile, (place - centre + half) * side / (2 * half), 14, CROSS_COLOUR)
        _write(tile, f"frame {picture.frame}, {track.t[picture.frame] - track.release.time:.3f} s", 6, 18, 0.5)
        tiles.append(cv2.copyMakeBorder(tile[1:-1, 1:-1], 1, 1, 1, 1, cv2.BORDER_CONSTANT, value=PAPER))
    return tiles + [np.full((side, side, 3), 255, np.uint8)] * (TILES - len(tiles))


def _residual_plot(track: FilmTrack) -> Bytes:
    """Return a plot of the departure of the string's length from the taut one over time."""
    plot = np.full((170, SHEET_WIDTH, 3), 255, np.uint8)
    t, e = track.t[track.geometry.frames] - track.release.time, track.geometry.residual
    reach = max(1.0, float(np.ceil(np.percentile(np.abs(e), 98))))
    left, right, middle, tall = 70, SHEET_WIDTH - 15, 85, 62
    for level in (-reach, 0.0, reach):
        y = int(middle - tall * level / reach)
        cv2.line(plot, (left, y), (right, y), RULE, 1)
        _write(plot, f"{level:+.0f} px", 8, y + 5, 0.45)
    columns = left + (right - left) * (t - t[0]) / max(float(t[-1] - t[0]), 1e-9)
    for place in zip(columns, middle - tall * np.clip(e / reach, -1.1, 1.1), strict=True):
        _circle(plot, place, 2, LIGHT_COLOUR)
    _write(plot, f"length of the string less that of a taut one, from {t[0]:.2f} s to {t[-1]:.2f} s", left, 165, 0.45)
    return plot


def _in_colours(picture: Picture) -> Bytes:
    """Return a picture in blue, green and red."""
    luma, blue, red = picture.planes
    wide = [cv2.resize(plane, luma.shape[::-1], interpolation=cv2.INTER_LINEAR) for plane in (red, blue)]
    return np.asarray(cv2.cvtColor(cv2.merge([luma, *wide]), cv2.COLOR_YCrCb2BGR))


def _circle(picture: Bytes, place: ArrayLike, radius: float, colour: tuple[int, ...], thickness: int = -1) -> None:
    """Draw a disc, or a circle of some thickness, to a sixteenth of a pixel."""
    cv2.circle(
        picture, np.rint(16 * np.asarray(place)).astype(int).tolist(), int(16 * radius), colour, thickness, cv2.LINE_AA, 4
    )


def _cross(picture: Bytes, place: ArrayLike, reach: float, colour: tuple[int, ...]) -> None:
    """Draw a cross that leaves its middle open, so that what it marks is seen."""
    for way in np.array([(1, 0), (-1, 0), (0, 1), (0, -1)]):
        ends = [np.rint(16 * (np.asarray(place) + r * way)).astype(int).tolist() for r in (0.3 * reach, reach)]
        cv2.line(picture, *ends, colour, 1, cv2.LINE_AA, 4)


def _write(picture: Bytes, text: str, x: float, y: float, size: float) -> None:
    shown, place = text.encode("ascii", "replace").decode(), (round(x), round(y))
    for colour, thickness in ((PAPER, 3), (INK, 1)):
        cv2.putText(picture, shown, place, cv2.FONT_HERSHEY_SIMPLEX, size, colour, thickness, cv2.LINE_AA)
