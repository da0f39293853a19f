"""Write what was found in a film: the table of points, what the film is, the contact sheet, and the film with its marks."""

from __future__ import annotations

import json
import math
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter

from looping_pendulum.files import write_atomically
from looping_pendulum.film.decode import FilmError, Picture, decoding, imaging, pictures_of
from looping_pendulum.film.moving import Background
from looping_pendulum.film.moving import Path as MovingPath
from looping_pendulum.film.plain import PlainTrack
from looping_pendulum.film.track import (
    RADIUS_ERROR,
    FilmTrack,
    NotTrackedError,
    Points,
    TrackSettings,
    film_window,
    gravity_shown,
    track,
)
from looping_pendulum.processes import ReportShare
from looping_pendulum.reference_ode.effects import GRAVITY
from looping_pendulum.reference_ode.geometry import Array

CHANNELS = ("light_x", "light_y", "heavy_x", "heavy_y")
TABLE_COLUMNS = ("t [s]", *(f"{name} [m]" for name in CHANNELS), *(f"{name}_error [m]" for name in CHANNELS), "flag")
"""Columns of the table, which is an export: a study that names the film takes the points themselves."""
POINT_COLUMNS = ("t", "x", "y", "x_error", "y_error")
"""Columns of a mass's points among the facts [s, m]."""
MAX_GRAVITY_RATIO = 1.2
"""Ratio of gravity in a film to the true one from which on clock or scale are in doubt: drag and draughts change it by less."""
LONG_STREAK = 12.0
"""Way during the exposure from which on its point is flagged [pixels of a picture 1280 wide]."""
SHEET_WIDTH = 1280
"""Width of the contact sheet [pixels]."""
TILES = 8
"""Enlarged frames on the contact sheet."""
LIGHT_COLOUR, HEAVY_COLOUR, ROD_COLOUR, INK, PAPER = (0, 0, 230), (230, 110, 0), (0, 150, 0), (40, 40, 40), (255, 255, 255)
"""Blue, green and red."""
PATH_COLOURS = (
    (0, 0, 230),
    (230, 110, 0),
    (0, 150, 0),
    (0, 140, 240),
    (190, 0, 190),
    (150, 140, 0),
    (90, 90, 90),
    (60, 30, 120),
)
"""Of things that move, of which the masses are not known; blue, green and red."""
CROSS_COLOUR = (0, 230, 255)
"""Of crosses on the masses themselves."""
LEAST_ORIGIN_ERROR = 1e-4
"""Smallest error of the rod's centre that is stated [m]: the centre of a mass is not quite that of its picture."""
HEAVY_OFFSET_ERROR = 5e-4
"""Usual distance of the heavy mass's centre in the picture from its string, by its shading and its hook [m]."""
READOUT_ERROR, KNOWN_READOUT_ERROR = 5e-3, 5e-5
"""Error of the rows' delay per length [s/m] where the time of the readout is not known, and where it is stated.

A phone reads its picture in 3 to 16 ms, which shows about 1.5 m: without room for it, a delay of 3.5 ms looked like a force.
"""
RELEASE_ANGLE_ERROR, HANGING_LENGTH_ERROR = 0.3, 1e-3
"""Errors of the string's angle [deg] and of the hanging length [m] at the release, most of all of where a mass's centre is."""
CAMERA_LEAST_TILT = math.radians(0.02)
"""Smallest error of the tilt that is stated [rad]."""


@dataclass(frozen=True, kw_only=True)
class FilmFiles:
    """Files that belong to a film, beside it."""

    table: Path
    facts: Path
    sheet: Path
    overlay: Path


def files_of(film: str | Path, folder: Path | None = None) -> FilmFiles:
    """Return the names of the files that tracking writes: beside the film, or in ``folder``."""
    path = Path(film)
    base = (folder or path.parent) / path.stem
    return FilmFiles(
        table=base.with_name(f"{path.stem}.csv"),
        facts=base.with_name(f"{path.stem}.film.json"),
        sheet=base.with_name(f"{path.stem}.track.png"),
        overlay=base.with_name(f"{path.stem}.overlay.mp4"),
    )


def refuse_foreign_table(files: FilmFiles) -> None:
    """Refuse to write over a table that tracking did not write: it may be somebody's work of an hour.

    Raises
    ------
    FilmError
        If there is such a table.
    """
    try:
        with files.table.open(encoding="utf-8", errors="replace") as stream:
            head = stream.readline(400)
    except OSError:
        return
    if not head.startswith("t [s],"):
        raise FilmError(f"{files.table}: found a table of another program, needed room for the points; rename it, or use --out")


def stored_facts(files: FilmFiles, film: str | Path, stated: Mapping[str, float]) -> dict[str, Any] | None:
    """Return the facts that `write` wrote for a film, if they are newer than it and were found with what is now stated.

    Parameters
    ----------
    stated
        Field of `TrackSettings` -> its value now [SI]; what a person has shown in the film besides is not compared.
    """
    try:
        if files.facts.stat().st_mtime_ns < Path(film).stat().st_mtime_ns:
            return None
        tree: dict[str, Any] = json.loads(files.facts.read_text(encoding="utf-8"))
        numbers = [tree["points"][mass][column] for mass in ("light", "heavy") for column in POINT_COLUMNS]
        numbers += [[tree["points"]["light"]["radius"], tree["points"]["light"]["radius_error"]]]
        numbers += [list(tree["camera_errors"].values()), list(tree["skipped"].values())]
        # A length was written with six digits in a study's line
        same = all(math.isclose(tree["settings"][name], value, rel_tol=1e-5) for name, value in stated.items())
        is_whole = all(len(column) and np.isfinite(column).all() for column in numbers)
        is_whole &= bool(tree["release"]) and bool(tree["light_radius"])
    # Whoever changed or cut the file, tracking the film again puts it right
    except (OSError, ValueError, TypeError, KeyError, AttributeError):
        return None
    return tree if same and is_whole else None


def is_edited(files: FilmFiles) -> bool:
    """Return whether somebody changed the table after it was written: the facts are written last."""
    try:
        return files.table.stat().st_mtime_ns > files.facts.stat().st_mtime_ns
    except OSError:
        return False


def stored_settings(files: FilmFiles) -> TrackSettings:
    """Return the settings with which the facts beside a film were found; the usual ones without them."""
    try:
        return TypeAdapter(TrackSettings).validate_python(json.loads(files.facts.read_text(encoding="utf-8"))["settings"])
    except (OSError, ValueError, TypeError, KeyError):
        return TrackSettings()


def table(track: FilmTrack) -> str:
    """Return the table of points from the release on, as CSV: metres from the rod's axis, and seconds from the release."""
    rows = [",".join(TABLE_COLUMNS)]
    masses = (track.light, track.heavy)
    index = [{int(k): i for i, k in enumerate(mass.frame)} for mass in masses]
    metres = [track.metres(mass.place) for mass in masses]
    long_streak = LONG_STREAK * track.facts.width / 1280
    for k in range(len(track.t)):
        now = track.t[k] - track.release
        at = [places.get(k) for places in index]
        if now < 0 or at == [None, None]:
            continue
        cells, errors, flags = [f"{now:.6f}"], [], []
        for mass, place, i, name in zip(masses, metres, at, ("light", "heavy"), strict=True):
            cells += ["", ""] if i is None else [f"{v:.6f}" for v in place[i]]
            errors += ["", ""] if i is None else [f"{v:.6f}" for v in mass.counted_error[i] / track.scale]
            if i is None:
                flags.append(f"no {name}")
            elif mass.streak[i] > long_streak:
                flags.append(f"{name} streak")
        rows.append(",".join([*cells, *errors, "; ".join(flags)]))
    return "\n".join(rows) + "\n"


def _camera_errors(track: FilmTrack) -> dict[str, float]:
    """Return the standard errors of the camera's parameters [SI], with which they are fitted where a study states none."""
    origin_x, origin_y = (max(error / track.scale, LEAST_ORIGIN_ERROR) for error in track.rod_error)
    return {
        "scale": track.scale_error,
        "origin_x": origin_x,
        "origin_y": origin_y,
        "tilt": max(track.tilt_error, CAMERA_LEAST_TILT),
        "clock_offset": track.release_error,
        "heavy_offset_x": HEAVY_OFFSET_ERROR,
        "readout": READOUT_ERROR,
    }


def release_lines(track: FilmTrack) -> dict[str, str]:
    """Return what a study says of this film's release, as the picture before it shows it."""
    return {
        "angle": f"{math.degrees(track.angle):.2f} deg +/- {RELEASE_ANGLE_ERROR:g} deg",
        "hanging_length": f"{1e3 * track.hanging_length:.1f} mm +/- {1e3 * HANGING_LENGTH_ERROR:g} mm",
    }


def ball_radius(track: FilmTrack) -> str:
    """Return the radius of the light mass, as a study states it."""
    return f"{1e3 * track.light.radius / track.scale:.2f} mm +/- {1e3 * RADIUS_ERROR / track.scale:.2f} mm"


def sentence(track: FilmTrack) -> str:
    """Say in one line what was found."""
    return (
        f"{track.path}: light mass in {track.share:.0%} of the frames after the release, "
        f"{track.string_scatter:.2f} pixels from a taut string; "
        f"scale {track.scale:.1f} pixels per metre +/- {track.scale_error:.2%} by {track.scale_source}; released at "
        f"{track.release:.3f} s; {track.facts.rate:.4g} frames per second, {track.facts.rate_source}"
        + ("; mirrored, as the light mass starts on the right" if track.side < 0 else "")
    )


def doubt(track: FilmTrack) -> str:
    """Say that clock or scale contradict gravity, if they do by more than any effect on the first motion; else nothing."""
    gravity, true = gravity_shown(track), GRAVITY.coefficients[0].default
    if not abs(math.log(max(gravity, 1e-3) / true)) > math.log(MAX_GRAVITY_RATIO):
        return ""
    rate = track.facts.rate * math.sqrt(true / max(gravity, 1e-3))
    length = track.settings.free_length
    scale = (
        "the shown length is wrong" if length is None else f"the free length near {length * true / max(gravity, 1e-3):.3g} m"
    )
    return (
        f"found gravity of {gravity:.2g} m/s^2 by the light mass's first motion, needed {true:g} m/s^2; either the true "
        f'frame rate is near {rate:.3g} Hz (--frame-rate "{rate:.3g} Hz"), or {scale}'
    )


def study_lines(track: FilmTrack, file: str) -> str:
    """Return the lines of a study for this film's trial, to copy; the errors of its camera go with the points."""
    release = release_lines(track)
    length = "" if track.settings.free_length is None else f", free_length: {_length(track)}"
    lines = [
        f"  - file: {file}",
        f"    light: {{radius: {ball_radius(track)}}}",
        f"    release: {{kind: looping, angle: {release['angle']}{length},",
        f"      hanging_length: {release['hanging_length']}}}",
    ]
    if track.settings.readout is not None:
        delay = track.settings.readout * track.scale / track.facts.height
        lines.append(f"    camera: {{readout: {delay:.4g} s/m +/- {KNOWN_READOUT_ERROR:.2g} s/m}}")
    return "\n".join(lines)


def _length(track: FilmTrack) -> str:
    assert track.settings.free_length is not None
    error = track.settings.free_length_error
    return f"{100 * track.settings.free_length:.6g} cm" + (f" +/- {1e3 * error:.3g} mm" if error else "")


def facts(track: FilmTrack | PlainTrack) -> dict[str, Any]:
    """Return what the film is and what was found in it, as plain data in SI units and pixels."""
    tree: dict[str, Any] = {"film": Path(track.path).name, **asdict(track.facts)}
    if isinstance(track, PlainTrack):
        return tree | {"things": [{"name": name, "frames": len(p.frame)} for name, p in track.things.items()]}
    first, last = film_window(track)
    return tree | {
        "rod_pixels": list(track.rod), "rod_error_pixels": list(track.rod_error), "scale_pixels_per_m": track.scale,
        "scale_relative_error": track.scale_error, "scale_source": track.scale_source, "tilt_deg": math.degrees(track.tilt),
        "tilt_error_deg": math.degrees(track.tilt_error), "tilt_source": "the vertical on which the heavy mass falls",
        "mirrored": track.side < 0, "release_s": track.release, "release_error_s": track.release_error,
        "angle_deg": math.degrees(track.angle), "hanging_length_m": track.hanging_length,
        "string_residual_pixels": track.string_scatter,
        "frames_followed": [first, last], "light_share": track.share, "skipped": track.skipped,
        "settings": asdict(track.settings), "release": release_lines(track), "light_radius": ball_radius(track),
        "camera_errors": _camera_errors(track),
        "points": {name: _points(track, p) for name, p in (("light", track.light), ("heavy", track.heavy))},
    }  # fmt: skip


def _points(track: FilmTrack, points: Points) -> dict[str, Any]:
    """Return a mass's radius and its points from the release on, in seconds and metres as `table` has them, and a summary."""
    t = track.t[points.frame] - track.release
    (x, y), error = track.metres(points.place).T, points.counted_error.T / track.scale
    columns = dict(zip(POINT_COLUMNS, (t, x, y, *error), strict=True))
    return {
        "frames": len(points.frame),
        "median_error_pixels": float(np.median(points.error)),
        "longest_streak_pixels": float(points.streak.max()),
        "radius": points.radius / track.scale,
        "radius_error": RADIUS_ERROR / track.scale,
        **{name: values[t >= 0].tolist() for name, values in columns.items()},
    }


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
        if error.ground is None or not error.moving:
            raise
        write_atomically(files.sheet, _png(sheet_of_moving_things(error.ground, error.moving, str(error))))
        raise FilmError(f"{error}; {files.sheet.name} shows what moves") from None
    return found, write(found, files, overlay=overlay)


def write(track: FilmTrack, files: FilmFiles, *, overlay: bool = False) -> list[Path]:
    """Write table, facts and contact sheet, with ``overlay`` the film with its marks, too; return their paths."""
    write_atomically(files.table, table(track))
    write_atomically(files.facts, _json(facts(track)))
    write_atomically(files.sheet, _png(contact_sheet(track)))
    written = [files.table, files.facts, files.sheet]
    if overlay:
        write_overlay(track, files.overlay)
        written.append(files.overlay)
    return written


def write_plain(track: PlainTrack, files: FilmFiles) -> list[Path]:
    """Write the table of things that move and the facts of their film; return the paths."""
    write_atomically(files.table, track.table())
    write_atomically(files.facts, _json(facts(track)))
    return [files.table, files.facts]


def _json(tree: dict[str, Any]) -> str:
    """Return the facts with one of them in each line."""
    lines = (f"{json.dumps(key)}: {json.dumps(value, default=float)}" for key, value in tree.items())
    return "{\n" + ",\n".join(lines) + "\n}\n"


def _png(picture: NDArray[np.uint8]) -> bytes:
    return bytes(imaging().imencode(".png", picture)[1])


def contact_sheet(track: FilmTrack) -> NDArray[np.uint8]:
    """Return the picture by which a person checks the points: the paths, eight frames enlarged, the string's residual."""
    cv2 = imaging()
    scene, shrink = _pale(cv2, track.ground)
    for points, colour in ((track.light, LIGHT_COLOUR), (track.heavy, HEAVY_COLOUR)):
        for x, y in points.place * shrink:
            _dot(cv2, scene, x, y, 1.5, colour)
    cv2.circle(
        scene, _fixed(np.array(track.rod) * shrink), int(16 * max(track.rod_radius * shrink, 2)), ROD_COLOUR, 2, cv2.LINE_AA, 4
    )
    lines = (
        f"{Path(track.path).name}: light mass (red) in {track.share:.0%} of the frames, heavy mass blue, rod green",
        f"scale {track.scale:.1f} px/m +/- {track.scale_error:.2%}, string within {track.string_scatter:.2f} px, "
        f"release at {track.release:.3f} s, "
        f"{track.facts.rate:.4g} frames/s, angle {math.degrees(track.angle):.1f} deg",
    )
    return np.vstack([_head(cv2, lines), _wide(cv2, scene), _tiles(cv2, track), _residual_plot(cv2, track)])


def sheet_of_moving_things(ground: Background, moving: Sequence[MovingPath], message: str) -> NDArray[np.uint8]:
    """Return the picture by which a person finds the masses: the longest paths, each with its first place and frames."""
    cv2 = imaging()
    scene, shrink = _pale(cv2, ground)
    longest = sorted(moving, key=lambda path: -float(np.ptp(path[:, 1:3], axis=0).sum()))[: len(PATH_COLOURS)]
    for path, colour in zip(longest, PATH_COLOURS, strict=False):
        for x, y in path[:, 1:3] * shrink:
            _dot(cv2, scene, x, y, 1.5, colour)
    for path, colour in zip(longest, PATH_COLOURS, strict=False):
        frame, x, y = path[len(path) // 2, :3]
        _dot(cv2, scene, x * shrink, y * shrink, 5, colour)
        _write(cv2, scene, f"{x:.0f},{y:.0f}@{frame:.0f}", x * shrink + 9, y * shrink + 5, 0.5)
    found, *ways_out = message.split("; ")
    lines = [found, *textwrap.wrap("; ".join(ways_out), 130), "Places in a frame, X,Y@FRAME, of what moves farthest:"]
    return np.vstack([_head(cv2, lines), _wide(cv2, scene)])


def _pale(cv2: Any, ground: Background) -> tuple[NDArray[np.uint8], float]:
    """Return the background as wide as a sheet, or half as wide if it is upright, in pale grey, and by how much it shrank."""
    height, width = ground.planes[0].shape
    shrink = SHEET_WIDTH / width if width >= height else 0.5 * SHEET_WIDTH / width
    grey = cv2.resize(ground.planes[0], None, fx=shrink, fy=shrink, interpolation=cv2.INTER_AREA)
    scene = cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR)
    return cv2.addWeighted(scene, 0.55, np.full_like(scene, 255), 0.45, 0), shrink


def _wide(cv2: Any, scene: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return a picture with a margin on the right that makes it as wide as the sheet."""
    margin = SHEET_WIDTH - scene.shape[1]
    return np.asarray(cv2.copyMakeBorder(scene, 0, 0, 0, margin, cv2.BORDER_CONSTANT, value=PAPER)) if margin else scene


def _head(cv2: Any, lines: Sequence[str]) -> NDArray[np.uint8]:
    head = np.full((10 + 24 * len(lines), SHEET_WIDTH, 3), 255, np.uint8)
    for i, text in enumerate(lines):
        _write(cv2, head, text, 10, 22 + 24 * i, 0.55)
    return head


def _tiles(cv2: Any, track: FilmTrack) -> NDArray[np.uint8]:
    """Return eight frames from the release on, enlarged around the light mass."""
    index = {int(k): i for i, k in enumerate(track.light.frame)}
    frames = track.light.frame[track.t[track.light.frame] >= track.release]
    frames = frames if len(frames) >= TILES else track.light.frame
    wanted = {int(k) for k in frames[np.linspace(0, len(frames) - 1, TILES).astype(int)]}
    half = max(int(0.07 * track.scale), 24)
    side = SHEET_WIDTH // 4
    tiles = []
    heavy = {int(k): i for i, k in enumerate(track.heavy.frame)}
    for picture in pictures_of(track.path, min(wanted), max(wanted)):
        if picture.frame not in wanted:
            continue
        centre = track.light.place[index[picture.frame]]
        tile = cv2.cvtColor(
            cv2.getRectSubPix(_colours(cv2, picture), (2 * half, 2 * half), tuple(float(v) for v in centre)), cv2.COLOR_RGB2BGR
        )
        tile = cv2.resize(tile, (side, side), interpolation=cv2.INTER_CUBIC)
        zoom = side / (2 * half)
        marks = [(centre, CROSS_COLOUR)]
        if picture.frame in heavy:
            marks.append((track.heavy.place[heavy[picture.frame]], CROSS_COLOUR))
        for place, colour in marks:
            x, y = (place - centre + half) * zoom
            if 0 <= x < side and 0 <= y < side:
                _cross(cv2, tile, x, y, 14, colour)
        _write(cv2, tile, f"frame {picture.frame}, {track.t[picture.frame] - track.release:.3f} s", 6, 18, 0.5)
        tiles.append(cv2.copyMakeBorder(tile[1:-1, 1:-1], 1, 1, 1, 1, cv2.BORDER_CONSTANT, value=PAPER))
    while len(tiles) < TILES:
        tiles.append(np.full((side, side, 3), 255, np.uint8))
    return np.vstack([np.hstack(tiles[:4]), np.hstack(tiles[4:TILES])])


def _residual_plot(cv2: Any, track: FilmTrack) -> NDArray[np.uint8]:
    """Return a plot of the departure of the string's length from the taut one over time."""
    plot = np.full((170, SHEET_WIDTH, 3), 255, np.uint8)
    t = track.t[track.light.frame] - track.release
    e = track.string_residual
    reach = max(1.0, float(np.ceil(np.percentile(np.abs(e), 98))))
    left, right, middle, tall = 70, SHEET_WIDTH - 15, 85, 62
    span = max(float(t[-1] - t[0]), 1e-9)
    for level in (-reach, 0.0, reach):
        y = int(middle - tall * level / reach)
        cv2.line(plot, (left, y), (right, y), (200, 200, 200), 1)
        _write(cv2, plot, f"{level:+.0f} px", 8, y + 5, 0.45)
    for now, value in zip(t, e, strict=True):
        _dot(
            cv2,
            plot,
            left + (right - left) * (now - t[0]) / span,
            middle - tall * float(np.clip(value / reach, -1.1, 1.1)),
            2,
            LIGHT_COLOUR,
        )
    _write(cv2, plot, f"length of the string less that of a taut one, from {t[0]:.2f} s to {t[-1]:.2f} s", left, 165, 0.45)
    return plot


def write_overlay(track: FilmTrack, path: Path) -> None:
    """Write the film from the release on with its marks, at 30 frames a second."""
    cv2, av = imaging(), decoding()
    index = [{int(k): i for i, k in enumerate(points.frame)} for points in (track.light, track.heavy)]
    first, last = film_window(track)
    width, height = (track.facts.width // 2 * 2, track.facts.height // 2 * 2)
    part = path.with_name(f".{path.name}.part")
    try:
        with av.open(str(part), "w", format="mp4") as container:
            stream = container.add_stream("libx264", rate=Fraction(30))
            stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
            stream.options = {"crf": "23", "preset": "veryfast"}
            for picture in pictures_of(track.path, first, last):
                shown = np.ascontiguousarray(_colours(cv2, picture)[:height, :width, ::-1])
                for places, points, colour in zip(index, (track.light, track.heavy), (LIGHT_COLOUR, HEAVY_COLOUR), strict=True):
                    if (i := places.get(picture.frame)) is not None:
                        _cross(cv2, shown, float(points.place[i][0]), float(points.place[i][1]), 12, colour)
                cv2.circle(
                    shown, _fixed(np.array(track.rod)), int(16 * max(track.rod_radius, 2)), ROD_COLOUR, 1, cv2.LINE_AA, 4
                )
                container.mux(stream.encode(av.VideoFrame.from_ndarray(shown, format="bgr24")))
            container.mux(stream.encode())
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)


def _colours(cv2: Any, picture: Picture) -> NDArray[np.uint8]:
    """Return a picture in red, green and blue."""
    height, width = picture.luma.shape
    wide = [cv2.resize(p, (width, height), interpolation=cv2.INTER_LINEAR) for p in (picture.red, picture.blue)]
    return np.asarray(cv2.cvtColor(cv2.merge([picture.luma, *wide]), cv2.COLOR_YCrCb2RGB))


def _fixed(place: Array) -> tuple[int, int]:
    """Return a place in sixteenths of a pixel, as OpenCV draws it with ``shift`` 4."""
    return round(float(place[0]) * 16), round(float(place[1]) * 16)


def _dot(cv2: Any, picture: NDArray[np.uint8], x: float, y: float, radius: float, colour: tuple[int, ...]) -> None:
    cv2.circle(picture, _fixed(np.array([x, y])), int(16 * radius), colour, -1, cv2.LINE_AA, 4)


def _cross(cv2: Any, picture: NDArray[np.uint8], x: float, y: float, reach: float, colour: tuple[int, ...]) -> None:
    """Draw a cross that leaves its middle open, so that what it marks is seen."""
    for dx, dy in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        ends = [_fixed(np.array([x + r * dx, y + r * dy])) for r in (0.3 * reach, reach)]
        cv2.line(picture, *ends, colour, 1, cv2.LINE_AA, 4)


def _write(cv2: Any, picture: NDArray[np.uint8], text: str, x: float, y: float, size: float) -> None:
    shown, place = text.encode("ascii", "replace").decode(), (round(x), round(y))
    cv2.putText(picture, shown, place, cv2.FONT_HERSHEY_SIMPLEX, size, PAPER, 3, cv2.LINE_AA)
    cv2.putText(picture, shown, place, cv2.FONT_HERSHEY_SIMPLEX, size, INK, 1, cv2.LINE_AA)
