"""Read project files of Tracker, the video analysis program of Open Source Physics (OSP), as tables.

A `.trk` is XML in which OSP's `XMLControlElement` wrote objects with named properties. A `.trz` is a zip archive with one
`.trk`, beside films and pages. What the numbers mean was read in the Java sources of Tracker and OSP, whose classes are
named below.
"""

from __future__ import annotations

import contextlib
import io
import math
import re
import zipfile
import zlib
from dataclasses import dataclass
from xml.etree.ElementTree import Element, ParseError

import numpy as np
from defusedxml import DefusedXmlException, ElementTree  # type: ignore[import-untyped]
from numpy.typing import NDArray

from looping_pendulum.measured.observations import DataError
from looping_pendulum.measured.tables.delimited import DelimitedText, TableLine, data_error
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.scenarios.document import quote

LARGEST_PROJECT = 20 * 1024 * 1024
"""Largest size of a `.trk` that is read [bytes]: some fifty thousand tracked points."""
LARGEST_ARCHIVE = 256 * 1024 * 1024
"""Largest size of a `.trz` that is read [bytes]. Most of it is the film, which is not unpacked."""
MAX_TAGS = 1_000_000
"""Largest number of tags in a `.trk`: each takes some 300 bytes of memory, so that a small file could take very much."""
MAX_FRAMES = 300_000
"""Largest number of frames of a film, as in Tracker (`VideoClip`)."""
MAX_NUMBER = 1e12
"""Largest plausible value of any other number, whatever its unit."""
MIN_SCALE = 1e-9
"""Smallest plausible scale [pixels per unit of length]."""
MIN_DURATION = 1e-6
"""Shortest plausible duration of a frame [ms]."""
STRETCH_TOLERANCE = 1e-3
"""Relative difference of two frame durations that are the same; the film's frame times are rounded to 1 us."""

_TRACKER = "org.opensourcephysics.cabrillo.tracker."
_ZIP_START = b"PK\x03\x04"
# What `zipfile` raises for a damaged archive; `BadZipFile` is an Exception of its own
_ZIP_FAULTS = (zipfile.BadZipFile, zlib.error, RuntimeError, EOFError, OSError, ValueError)
_INDEX = re.compile(r"\[([0-9]{1,9})\]")
_RESAVE = "save the project again in Tracker"
_AXES = ("xorigin", "yorigin", "angle", "xscale", "yscale")
# Tracks that a user may take for point masses. All others are axes and measuring tools.
_OTHER_TRACKS = (
    "Vector", "VectorSum", "CenterOfMass", "AnalyticParticle", "DynamicParticle", "DynamicParticlePolar", "DynamicSystem",
    "ParticleDataTrack",
)  # fmt: skip


DIGITS = 12
"""Digits of the numbers in the table that is made of a project."""


def is_project(file: str) -> bool:
    """Return whether a file is a project, by its name."""
    return file.lower().endswith((".trk", ".trz"))


def read_project(raw: bytes, file: str) -> DelimitedText:
    """Return the points in a `.trk` or a `.trz` as a table, one object's below the other's: object, time, frame, x and y.

    Positions are in the project's axes and its unit of length, in pixels if it is not calibrated. Times are those that Tracker
    shows: the clip's first frame has the clip's start time, 0 unless the user changed it.

    Raises
    ------
    DataError
        If it is no project, damaged, too large or without points of a point mass.
    """
    panel = _panel(_unpack(raw, file) if raw.startswith(_ZIP_START) else raw, file)
    clip, axes, notes = _Clip.read(panel), _axes(panel), list[str]()
    tracks = _tracks(panel, clip, axes, notes)
    reference = panel.text("referenceframe")
    if reference:
        notes.append(f"The project shows positions relative to {quote(reference)}; they are read in fixed axes instead.")
    is_calibrated = bool(np.any(axes[3:] != 1))
    if not is_calibrated:
        notes.append("The project is not calibrated: positions are in pixels.")
    if clip.step > 1:
        notes.append(f"The project's step size is {clip.step} frames.")
    time = _frame_times(panel, clip, max(int(frame[-1]) for frame, _ in tracks.values()), notes)
    unit = (panel.text("length_unit") or "m") if is_calibrated else "px"
    lines = [TableLine(line=1, cells=("object", "t [s]", "frame", f"x [{unit}]", f"y [{unit}]"), values=(math.nan,) * 5)]
    for name, (frame, place) in tracks.items():
        for row in zip(time[frame].tolist(), frame.tolist(), *place.tolist(), strict=True):
            cells = (name, *(f"{value:.{DIGITS}g}" for value in row))
            lines.append(TableLine(line=len(lines) + 1, cells=cells, values=(math.nan, *row)))
    return DelimitedText(file=file, delimiter=",", decimal_comma=False, comments=(), lines=lines, notes=tuple(notes))


def _unpack(raw: bytes, file: str) -> bytes:
    """Return the only `.trk` of an archive, at most one byte longer than is allowed."""
    found = "an archive that cannot be unpacked"
    try:
        with zipfile.ZipFile(io.BytesIO(raw)) as archive:
            members = _members(archive)
            if len(members) != 1:
                names = f" ({', '.join(quote(member.filename) for member in members[:5])})" if members else ""
                found = f"{len(members)} .trk files{names}"
            # The other methods unpack a whole block, however large
            elif members[0].compress_type in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
                with archive.open(members[0]) as stream:
                    return stream.read(LARGEST_PROJECT + 1)
    except _ZIP_FAULTS:
        pass
    raise data_error(file, None, "", f"found {found}, needed a .trz with one .trk; give the .trk file, or export one tab again")


def _members(archive: zipfile.ZipFile) -> list[zipfile.ZipInfo]:
    """Return the `.trk` files of an archive, without the shadows that macOS adds."""
    return [m for m in archive.infolist() if m.filename.lower().endswith(".trk") and not m.filename.startswith("__MACOSX/")]


def _panel(raw: bytes, file: str) -> _Object:
    """Return the main object of a project, a `TrackerPanel`."""
    if len(raw) > LARGEST_PROJECT or raw.count(b"<") > MAX_TAGS:
        size = f"{LARGEST_PROJECT // 1024**2} MiB or {MAX_TAGS} tags"
        raise data_error(file, None, "", f"found a project of more than {size}, needed less; delete other tracks in Tracker")
    try:
        root = ElementTree.fromstring(raw)
    except (DefusedXmlException, ParseError, LookupError, ValueError) as fault:
        raise data_error(file, None, "", f"found damaged XML ({fault}), needed a project; {_RESAVE}") from None
    panels = [element for element in root.iter("object") if element.get("class") == _TRACKER + "TrackerPanel"]
    if len(panels) == 1:
        return _Object(element=panels[0], file=file)
    # A set of tabs only names files
    found = f"found {len(panels)} projects of Tracker in the XML"
    raise data_error(file, None, "", f"{found}, needed one project; save its tab in Tracker as a .trk file of its own")


@dataclass(frozen=True, kw_only=True)
class _Object:
    """An object in the XML, whose properties have names."""

    element: Element
    file: str

    def error(self, message: str) -> DataError:
        """Return an error about the file."""
        return data_error(self.file, None, "", message)

    def text(self, name: str) -> str:
        """Return a text, '' if there is none."""
        return (self.element.findtext(f"property[@name='{name}']") or "").strip()

    def number(self, name: str, default: float | None = None, largest: float = MAX_NUMBER) -> float:
        """Return a number of at most a plausible size. One without a default must be there."""
        text = self.text(name)
        if not text and default is not None:
            return default
        with contextlib.suppress(ValueError):
            value = float(text)
            if abs(value) <= largest or largest == math.inf:
                return value
        raise self.error(f"{name}: found {quote(text)}, needed a plausible number; {_RESAVE}")

    def child(self, name: str) -> _Object | None:
        """Return an object, None if there is none."""
        element = self.element.find(f"property[@name='{name}']/object")
        return None if element is None else _Object(element=element, file=self.file)

    def array(self, name: str) -> dict[int, _Object]:
        """Return the objects of an array by their index, ascending.

        A null is an index that is left out, or the text "null" at the end (`XMLPropertyElement`).
        """
        found = {}
        for entry in self.element.findall(f"property[@name='{name}']/property"):
            index, element = _INDEX.fullmatch(entry.get("name", "")), entry.find("object")
            if index and element is not None:
                found[int(index[1])] = _Object(element=element, file=self.file)
        return dict(sorted(found.items()))

    def numbers(self, name: str) -> Array:
        """Return an array of numbers, which is one text "{0.0,33.333}" or has entries (`XMLPropertyElement`)."""
        entries = self.element.findall(f"property[@name='{name}']/property")
        text = ",".join((entry.text or "").strip(" {}\n\r\t") for entry in entries)
        try:
            return np.array([float(cell) for cell in text.split(",")] if text else [])
        except ValueError:
            raise self.error(f"{name}: found {quote(text)}, needed numbers; {_RESAVE}") from None


@dataclass(frozen=True, kw_only=True)
class _Clip:
    """The part of the film that the project uses (`VideoClip`)."""

    start: int
    end: int
    """First and last frame.

    The "frameshift" of some versions about 2014 moves the numbers of clip and points alike, so that no time depends on it.
    """
    step: int
    """Frames from one step to the next."""
    start_time: float
    """Time at the first frame [ms]."""
    video: _Object | None
    """The film; None if the project has none."""

    @classmethod
    def read(cls, panel: _Object) -> _Clip:
        """Read the clip of a project; what is not written has Tracker's default."""
        clip = panel.child("videoclip")
        if clip is None:
            raise panel.error(f"found no video clip, needed one; {_RESAVE}")
        start = max(round(clip.number("startframe", 0)), 0)
        step = abs(round(clip.number("stepsize", 1))) or 1
        end = start + step * (abs(round(clip.number("stepcount", MAX_FRAMES))) - 1)
        start_time, video = clip.number("starttime", 0), clip.child("video")
        return cls(start=start, end=min(end, MAX_FRAMES - 1), step=step, start_time=start_time, video=video)


def _axes(panel: _Object) -> Array:
    """Return the axes in the picture (`ImageCoordSystem`), shape (5,).

    They are the origin's x and y [pixels from the upper left corner, y down], the angle of the x axis, counterclockwise [deg],
    and the scale in the picture's x and y [pixels per unit].
    """
    coords = panel.child("coords")
    entries = coords.array("framedata") if coords else {}
    settings = np.array([[entry.number(name) for name in _AXES] for entry in entries.values()])
    if not len(settings):
        raise panel.error("found no axes, needed origin and scale of the picture; set them in Tracker and save again")
    if np.any(settings != settings[0]):
        way_out = "choose fixed origin, angle and scale in Tracker's menu Coordinate System, and save again"
        raise panel.error(f"found axes that change with the frame, needed fixed ones; {way_out}")
    smallest = np.min(np.abs(settings[0, 3:]))
    if smallest < MIN_SCALE:
        raise panel.error(f"found a scale of {smallest:g} pixels per unit, needed a plausible one; calibrate again")
    return np.asarray(settings[0])


def _positions(axes: Array, pixel: Array) -> Array:
    """Return positions in the axes, shape (2, n), of points in the picture, shape (2, n)."""
    origin_x, origin_y, angle, scale_x, scale_y = axes
    right, up = (pixel[0] - origin_x) / scale_x, (origin_y - pixel[1]) / scale_y
    cos, sin = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    return np.array([cos * right + sin * up, cos * up - sin * right])


def _tracks(panel: _Object, clip: _Clip, axes: Array, notes: list[str]) -> dict[str, tuple[NDArray[np.intp], Array]]:
    """Return the point masses with points in the clip: name -> frames and positions, shape (2, n); note what was left out."""
    tracks: dict[str, tuple[NDArray[np.intp], Array]] = {}
    others = []
    for element in panel.element.findall("property[@name='tracks']/property/object"):
        track = _Object(element=element, file=panel.file)
        name = track.text("name") or "mass"
        kind = element.get("class", "").removeprefix(_TRACKER)
        if kind != "PointMass":
            others += [f"{quote(name)} ({kind})"] if kind in _OTHER_TRACKS else []
            continue
        frame, pixel = _points(track, name, clip, notes)
        if not frame.size:
            others.append(f"{quote(name)} (no points in the clip)")
            continue
        if name in tracks:
            raise panel.error(f"found two tracks named {quote(name)}, needed different names; rename one in Tracker")
        tracks[name] = frame, _positions(axes, pixel)
    if not tracks:
        instead = f" but {', '.join(others[:5])}" if others else ""
        raise panel.error(f"found no point mass with points{instead}, needed one; track it in Tracker and save again")
    if others:
        notes.append(f"Tracks that were left out: {', '.join(others)}.")
    return tracks


def _points(track: _Object, name: str, clip: _Clip, notes: list[str]) -> tuple[NDArray[np.intp], Array]:
    """Return the frames of a track's points in the clip, and where they are in the picture [pixels], shape (2, n)."""
    points = track.array("framedata")
    pixel = np.array([[point.number(axis, largest=math.inf) for axis in "xy"] for point in points.values()]).reshape(-1, 2).T
    frame = np.array(list(points), dtype=np.intp)
    # Not a number, or infinite: this frame has no mark
    marked = np.isfinite(pixel).all(axis=0)
    inside = marked & (frame >= clip.start) & (frame <= clip.end)
    if np.any(inside < marked):
        where = f"outside the project's clip (frames {clip.start} to {clip.end})"
        notes.append(f"Points of {quote(name)} {where} were left out: {np.count_nonzero(inside < marked)}.")
    return frame[inside], pixel[:, inside]


def _frame_times(panel: _Object, clip: _Clip, last: int, notes: list[str]) -> Array:
    """Return the times of all frames up to ``last`` or the film's end [s]; add notes.

    As in `StepperClipControl.getStepTime` and `VideoPlayer.getStepTime`: the film's own times count from the clip's start,
    and are stretched until the mean frame of the clip lasts "delta_t". So a film in slow motion has the clock of its user.
    """
    # The second is that of a film that is a folder of pictures (`ImageVideo`)
    durations = [abs(holder.number("delta_t", 0)) for holder in (panel.child("clipcontrol"), clip.video) if holder]
    duration = next((d for d in durations if d), 0.0)
    film = clip.video.numbers("start_times") if clip.video else np.zeros(0)
    end = min(clip.end, film.size - 1)
    rises = bool(np.all(np.diff(film) >= MIN_DURATION) and np.all(np.abs(film) <= MAX_NUMBER))
    if film.size and not (rises and last < film.size and end > clip.start):
        notes.append("The film's times lack frames or do not rise, so that its frames are taken at equal steps.")
        film = np.zeros(0)
    film_duration = float(film[end] - film[clip.start]) / (end - clip.start) if film.size else 0.0
    duration = duration or film_duration
    if duration < MIN_DURATION:
        raise panel.error(f"found a frame duration (delta_t) of {duration:g} ms, needed a plausible one; {_RESAVE}")
    stretch = duration / film_duration if film_duration else 1.0
    if abs(stretch - 1) > STRETCH_TOLERANCE:
        clocks = f"{duration:.4g} ms by the project's clock, which is used, and {film_duration:.4g} ms by the film's"
        notes.append(f"A frame lasts {clocks}.")
    if clip.start_time:
        notes.append(f"The project's clock reads {clip.start_time / 1000:g} s at frame {clip.start}.")
    time = film * stretch if film.size else duration * np.arange(last + 1)
    return np.asarray((time - time[clip.start] + clip.start_time) / 1000)
