"""What tracking finds in a film, as one record: `track` returns it, it stands beside the film as JSON, and a study reads that.

Places are in pixels, y downwards, unless they say [m].
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field, FiniteFloat, PlainSerializer, PlainValidator, TypeAdapter

from looping_pendulum.measured.camera import CAMERA, Camera
from looping_pendulum.measured.observations import Channel, Edit, Observations
from looping_pendulum.reference_ode.geometry import Array, string_from_rod

RADIUS_ERROR = 0.3
"""Error of a disc's radius by where its soft edge is taken to be [pixels]."""
LEAST_ORIGIN_ERROR, LEAST_TILT_ERROR, LEAST_CLOCK_ERROR = 1e-4, math.radians(0.05), 3e-4
"""Smallest errors that are stated: of the rod's centre [m], as a mass's centre is not quite that of its picture; of the tilt
[rad]; and of the release, as a hand does more than to let go [s]."""
HANGING_LENGTH_ERROR = 1e-3
"""Error of the hanging length at the release, most of all of where a mass's centre is [m]."""
CENTRE_OFFSET = 0.2
"""Error of the string's length by where the masses' centres are taken to be, constant through a film [pixels]."""
CONTRADICTS = 4.0
"""Errors of a stated value from which on the film contradicts it."""
BENT, LEAST_SCATTER = 3.0, 0.1
"""Scatter of the string's length from which on it is no straight string's, in the noise of neighbouring marks; the smallest
scatter [pixels]."""
MAX_DISTANCE, MAX_FRAMES = 1000.0, 10_000_000
"""Largest distance of a mass from the rod [m], and more frames than any film has."""
SAME_VALUE = 1e-5
"""Relative difference of two statements of one value: a study's line has a length with six digits."""
CAMERA_PRIORS = {"foreshortening": 2e-3, "shear": 2e-3, "perspective_x": 2.5e-3, "perspective_y": 2.5e-3, "distortion": 0.02}
"""Name -> prior standard error of what a careful set-up leaves: a camera two metres away that looks 0.3 deg aside [1/m], a lens
that moves half a metre by half a percent [1/m^2]."""
FITTED = ("rod_x", "rod_y", "scale", "tilt", "free_length", "rod_radius", *CAMERA_PRIORS, "readout")
"""Names of what `Geometry` has: pixels, pixels per metre, and SI."""


def _numbers(values: ArrayLike) -> Array:
    array = np.asarray(values, dtype=np.float64)
    if not np.isfinite(array).all():
        raise ValueError("found a number that is not finite")
    return array


def _frames(values: ArrayLike) -> NDArray[np.intp]:
    frames = _numbers(values)
    if not np.all((frames >= 0) & (frames < MAX_FRAMES)):
        raise ValueError("found no number of a frame")
    return frames.astype(np.intp)


Numbers = Annotated[NDArray[np.float64], PlainValidator(_numbers), PlainSerializer(np.ndarray.tolist)]
Frames = Annotated[NDArray[np.intp], PlainValidator(_frames), PlainSerializer(np.ndarray.tolist)]


@dataclass(frozen=True, kw_only=True)
class Clock:
    """Where the times of a film's frames come from."""

    source: str
    """In words."""
    own_rate: float
    """Frames per second by the film's own clock [Hz]."""
    rate: float
    """Frames per second in truth, as far as the film or the user says [Hz]."""
    rate_source: str
    """Where `rate` comes from, in words."""
    lost: int
    """Places in an even row of times at which there is no frame."""
    uneven: int
    """Steps of time that depart from the usual one, lost frames among them."""
    backward: int
    """Times that are not later than the one before."""


@dataclass(frozen=True, kw_only=True)
class FilmFacts:
    """What a film is."""

    codec: str
    width: int
    """Of the upright picture [pixels]."""
    height: int
    pixel_aspect: float
    """Width over height of the stored pixels, as the film states it; the upright picture has square ones."""
    interlaced: bool
    """Whether alternate rows show different instants."""
    bits: int
    """Bits of each sample of brightness; more than 8 are reduced to 8."""
    frames: int
    clock: Clock
    repeated: tuple[int, ...]
    """Frames that are copies of the one before."""
    broken: int
    """Packets that could not be decoded."""
    shake: float
    """Largest shift of the whole picture [pixels]."""

    @property
    def size(self) -> tuple[int, int]:
        """Return width and height of the upright picture [pixels]."""
        return self.width, self.height

    @property
    def unit(self) -> float:
        """Return a pixel of a picture 1280 wide, in which limits are stated [pixels]."""
        return max(self.size) / 1280


class ScaleRule(NamedTuple):
    """A length in the picture that a person knows."""

    start: tuple[float, float]
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
    rod_radius_error: float = 0.0
    """Its standard error [m]; 0: none is stated."""
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
    still: bool = False
    """Whether the camera is taken as standing still, though its pictures seem to move."""

    def with_stated(self, stated: Mapping[str, float]) -> TrackSettings:
        """Return the settings with other values: field -> value [SI]."""
        values: dict[str, Any] = dict(stated)
        return replace(self, **values)

    def frames(self, t: Array) -> tuple[int, int]:
        """Return the first and the last frame that is read, of frames at the times ``t`` [s]."""
        first = 0 if self.first is None else int(np.searchsorted(t, self.first))
        last = len(t) - 1 if self.last is None else int(np.searchsorted(t, self.last, side="right")) - 1
        return first, last


@dataclass(frozen=True, kw_only=True, eq=False)
class Points:
    """One mass in the frames in which it was found."""

    frame: Frames
    """Shape (n,)."""
    place: Numbers
    """Centre [pixels], shape (n, 2)."""
    error: Numbers
    """Standard errors of both [pixels], shape (n, 2)."""
    counted_error: Numbers
    """The same by which a fit should weigh them, as points that share an error show it once [pixels], shape (n, 2)."""
    radius: FiniteFloat
    """Of the mass's disc, or half its narrower side [pixels]."""

    def __post_init__(self) -> None:
        n = len(self.frame)
        shapes = [each.shape for each in (self.frame, self.place, self.error, self.counted_error)]
        if not n or shapes != [(n,), (n, 2), (n, 2), (n, 2)]:
            raise ValueError("found columns of different lengths, or none")

    @cached_property
    def row(self) -> dict[int, int]:
        """Return frame -> its row in the arrays."""
        return {int(k): i for i, k in enumerate(self.frame)}


@dataclass(frozen=True, kw_only=True)
class Stated:
    """A value with its standard error [SI, pixels], before the film is seen."""

    value: float
    error: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Geometry:
    """How pixels become positions [m]: x right and y up from the rod's axis, with the light mass on the left at first."""

    side: int
    """1: the heavy mass hangs on the right of the rod; -1: on the left, so that x is mirrored."""
    size: tuple[int, int]
    """Width and height of the picture [pixels]."""
    bearing: float
    """Bearing of the string at the release, with which it was fitted [rad]."""
    values: Mapping[str, FiniteFloat]
    """Of `FITTED`: pixels and SI."""
    errors: Mapping[str, FiniteFloat]
    """Their standard errors."""
    priors: Mapping[str, Stated]
    """What was known of them before."""
    frames: Frames
    """Frames with the taut string, shape (n,)."""
    residual: Numbers
    """Departure of the string's length from the taut one there [pixels], shape (n,)."""

    def __post_init__(self) -> None:
        if not all(set(FITTED) == set(each) for each in (self.values, self.errors, self.priors)):
            raise ValueError("found a value too few or too many")
        if self.scale <= 0 or self.frames.shape != self.residual.shape or self.residual.ndim != 1:
            raise ValueError("found no scale, or columns of different lengths")

    @property
    def rod(self) -> tuple[float, float]:
        """Return the centre of the rod [pixels]."""
        return self.values["rod_x"], self.values["rod_y"]

    @property
    def scale(self) -> float:
        """Return pixels per metre at the rod."""
        return self.values["scale"]

    @property
    def scale_error(self) -> float:
        """Return its standard error, relative."""
        length = self.values["free_length"] * self.scale
        return math.hypot(self.errors["scale"] / self.scale, CENTRE_OFFSET / length)

    @property
    def rod_radius(self) -> float:
        """Return the radius of the rod [m]."""
        return self.values["rod_radius"]

    @property
    def rod_pixels(self) -> float:
        """Return the radius of the rod in the picture [pixels]."""
        return self.rod_radius * self.scale

    @property
    def scatter(self) -> float:
        """Return the standard deviation of `residual`, by its median size, which outliers do not change [pixels]."""
        return 1.4826 * float(np.median(np.abs(self.residual)))

    @cached_property
    def noise(self) -> float:
        """Return the same of what neighbouring marks do not share."""
        steps = np.diff(self.residual)[np.diff(self.frames) <= 2]
        return 1.4826 * float(np.median(np.abs(steps))) / math.sqrt(2) if len(steps) else self.scatter

    @property
    def is_bent(self) -> bool:
        """Return whether the string's length departs from a taut one by more than its marks scatter."""
        return self.scatter > BENT * max(self.noise, LEAST_SCATTER)

    def contradicted(self) -> list[str]:
        """Return the names of stated values that the film contradicts, the most improbable one first."""
        off = {n: abs(self.values[n] - p.value) / math.hypot(p.error, self.errors[n]) for n, p in self.priors.items()}
        return sorted((n for n in ("rod_radius", "free_length") if off[n] > CONTRADICTS), key=lambda n: -off[n])

    def metres(self, place: Array) -> Array:
        """Return positions [m] of pixels, shape (..., 2)."""
        return in_the_plane(np.asarray(place, dtype=float), self.values, self.side, self.size)

    def string_at(self, place: Array) -> tuple[Array, Array]:
        """Return free length [pixels at the rod] and bearing [rad] of the string at pixels (n, 2)."""
        x, y = self.metres(place).T
        free, bearing = string_from_rod(x, y, self.rod_radius)
        return self.scale * free, bearing


def in_the_plane(place: Array, v: Mapping[str, float], side: int, size: tuple[int, int]) -> Array:
    """Return the positions [m] of pixels, shape (..., 2), by the values ``v`` of `FITTED`."""
    rod, metres = np.array([v["rod_x"], v["rod_y"]]), np.array([side, -1]) / v["scale"]
    centre_x, centre_y = metres * (0.5 * np.array(size) - rod)
    looks = {name: v[name] for name in CAMERA_PRIORS}
    return Camera(tilt=side * v["tilt"], centre_x=centre_x, centre_y=centre_y, **looks).true_position(metres * (place - rod))


@dataclass(frozen=True, kw_only=True)
class Release:
    """What a film shows of a release."""

    time: FiniteFloat
    """From the first frame, as the rod's row of the picture has it [s]."""
    time_error: FiniteFloat
    angle: FiniteFloat
    """Of the string, from straight up [rad]."""
    angle_error: FiniteFloat | None
    """Standard error [rad]; None: the film does not show the angle."""


@dataclass(frozen=True, kw_only=True, eq=False)
class FilmTrack:
    """Both masses in a film, and how pixels become metres."""

    path: Annotated[str, PlainSerializer(lambda path: Path(path).name)]
    facts: FilmFacts
    settings: TrackSettings
    t: Numbers
    """Time of each frame from that of the first [s], by the true rate, shape (frames,)."""
    light: Points
    heavy: Points
    geometry: Geometry
    """Where the rod is, the scale, and how the camera looks."""
    scale_source: str
    """Where the scale comes from, in words."""
    release: Release
    hanging_length: FiniteFloat
    """From the rod's height to the heavy mass's centre at the release [m]."""
    share: float
    """Share of the frames from the release on, over `pendulum.SHARE_SECONDS`, in which the light mass was found."""
    skipped: dict[str, int]
    """Why points are missing -> number of frames."""
    still: Annotated[Any, Field(exclude=True)] = field(default=None, repr=False)
    """Brightness of the picture without the masses; None where the record was read."""

    def __post_init__(self) -> None:
        rows = (self.t, self.light.frame, self.heavy.frame)
        if self.t.ndim != 1 or any(np.any(np.diff(row) <= 0) for row in rows):
            raise ValueError("found times or frames that do not ascend")
        if max(self.light.frame[-1], self.heavy.frame[-1]) >= len(self.t):
            raise ValueError("found points in frames that the film does not have")
        with np.errstate(all="ignore"):
            positions = self.geometry.metres(np.concatenate([self.light.place, self.heavy.place]))
        if not np.all(np.abs(positions) < MAX_DISTANCE):
            raise ValueError("found points far from any apparatus")

    @property
    def window(self) -> tuple[int, int]:
        """Return the first and last frame in which both masses were followed."""
        return int(min(self.light.frame[0], self.heavy.frame[0])), int(max(self.light.frame[-1], self.heavy.frame[-1]))

    @property
    def light_radius(self) -> tuple[float, float]:
        """Return the radius of the light mass, and its standard error [m]."""
        return self.light.radius / self.geometry.scale, RADIUS_ERROR / self.geometry.scale

    def shown(self) -> dict[str, str]:
        """Return what the film shows of ball and release: name of a quantity -> its value and error, as a study states them."""
        radius, radius_error = (1e3 * v for v in self.light_radius)
        shown = {
            "light_radius": f"{radius:.2f} mm +/- {radius_error:.2f} mm",
            "hanging_length": f"{1e3 * self.hanging_length:.1f} mm +/- {1e3 * HANGING_LENGTH_ERROR:g} mm",
        }
        if self.release.angle_error is not None:
            angle, error = math.degrees(self.release.angle), math.degrees(self.release.angle_error)
            shown["release_angle"] = f"{angle:.2f} deg +/- {error:.2g} deg"
        return shown

    @property
    def camera_errors(self) -> dict[str, float]:
        """Return the standard errors of the camera's parameters [SI], with which they are fitted where a study states none."""
        view = self.geometry
        origin_x, origin_y = (max(view.errors[n] / view.scale, LEAST_ORIGIN_ERROR) for n in ("rod_x", "rod_y"))
        return {
            "scale": view.scale_error,
            "origin_x": origin_x,
            "origin_y": origin_y,
            "tilt": max(view.errors["tilt"], LEAST_TILT_ERROR),
            "clock_offset": math.hypot(self.release.time_error, LEAST_CLOCK_ERROR),
            "heavy_offset_x": CAMERA["heavy_offset_x"].error,
            # The points' places are put right by the film's own values, their times are not
            "readout": math.hypot(view.errors["readout"], view.values["readout"]),
            **{name: view.errors[name] for name in CAMERA_PRIORS},
        }

    def stated_otherwise(self, stated: Mapping[str, float]) -> list[str]:
        """Return the fields of `settings` that have another value in ``stated`` [SI]."""
        known = {name: getattr(self.settings, name) for name in stated}
        return [n for n, v in stated.items() if known[n] is None or not math.isclose(known[n], v, rel_tol=SAME_VALUE)]

    def observations(self, name: str, *notes: str) -> Observations:
        """Return the points from the release on, in seconds and metres, as those of the trial ``name``."""
        channels = []
        for mass, points in (("light", self.light), ("heavy", self.heavy)):
            t = self.t[points.frame] - self.release.time
            after = t >= 0
            position, error = self.geometry.metres(points.place), points.counted_error / self.geometry.scale
            for i, axis in enumerate("xy"):
                column = f"{mass}_{axis}"
                stated_error = (t[after], error[after, i])
                channels.append(Channel(name=column, t=t[after], value=position[after, i], stated_error=stated_error))
        return Observations(
            name=name,
            file=self.path,
            channels=tuple(channels),
            edits=(
                *(Edit(count=count, reason=reason) for reason, count in self.skipped.items() if count),
                *(Edit(reason=note) for note in notes),
            ),
            camera_errors=self.camera_errors,
            light_radius=self.light_radius,
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class PlainTrack:
    """Things that move in a film, the one that goes farthest first."""

    path: Annotated[str, PlainSerializer(lambda path: Path(path).name)]
    facts: FilmFacts
    settings: TrackSettings
    t: Numbers
    """Time of each frame from that of the first [s]."""
    things: Mapping[str, Points]
    """Name -> its points: "A", "B" and so on."""


@dataclass(frozen=True, kw_only=True)
class FilmFiles:
    """Files that belong to a film, beside it."""

    table: Path
    record: Path
    sheet: Path
    overlay: Path


def files_of(film: str | Path, folder: Path | None = None) -> FilmFiles:
    """Return the names of the files that tracking writes: beside the film, or in ``folder``."""
    path = Path(film)
    base = (folder or path.parent) / path.stem
    return FilmFiles(
        table=base.with_name(f"{path.stem}.csv"),
        record=base.with_name(f"{path.stem}.film.json"),
        sheet=base.with_name(f"{path.stem}.track.png"),
        overlay=base.with_name(f"{path.stem}.overlay.mp4"),
    )


def record_tree(track: FilmTrack | PlainTrack) -> dict[str, Any]:
    """Return a record as plain data for JSON."""
    tree: dict[str, Any] = TypeAdapter(type(track)).dump_python(track, mode="json")
    return tree


def record_text(track: FilmTrack | PlainTrack) -> str:
    """Return a record as JSON."""
    return json.dumps(record_tree(track)) + "\n"


def read_record(text: str | bytes) -> FilmTrack:
    """Return the record that `record_text` wrote.

    Raises
    ------
    ValueError
        If it is none, or was cut or changed.
    """
    try:
        return TypeAdapter(FilmTrack).validate_json(text)
    except (TypeError, OverflowError) as error:  # an array of what are no numbers
        raise ValueError(str(error)) from None
