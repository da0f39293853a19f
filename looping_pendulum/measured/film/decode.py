"""Read a film: its pictures one after the other, when each was taken, in which light, and what the film is.

Pictures are decoded by PyAV and never kept, so that memory does not grow with the film; each pass over it decodes again.

An exposure that drifts brightens the whole picture, a lamp that flickers before a rolling shutter brightens bands of rows, a
cloud one side. All are smooth over the picture or along its rows, and a thing that moves is neither: `gain` tells them apart.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from looping_pendulum.errors import MissingPackageError
from looping_pendulum.files import read_file
from looping_pendulum.installation import install_command
from looping_pendulum.measured.clock import frame_grid
from looping_pendulum.measured.film import FilmError
from looping_pendulum.measured.film.record import Clock, FilmFacts
from looping_pendulum.reference_ode.geometry import Array

try:
    av: Any = import_module("av")
    cv2: Any = import_module("cv2")
except ImportError as error:
    command = install_command("opencv-python-headless", "av")
    raise MissingPackageError(
        f"films: found no PyAV or no OpenCV ({error}), needed both to read films; to get them: `{command}`"
    ) from None
# With pictures this small further threads only wait for a core
cv2.setNumThreads(1)

Bytes = NDArray[np.uint8]
Gain = NDArray[np.float32]
"""Factor of brightness over the picture, for blocks of pixels."""

MIN_PIXELS, MAX_PIXELS = 64 * 48, 50e6
"""Smallest and largest picture [pixels]: 8K films have 33 million, and a damaged header must not ask for all memory."""
MIN_FRAMES = 8
"""Fewest frames of a film: through fewer, no motion can be followed."""
MAX_BROKEN_PACKETS = 100
"""Broken packets in a row after which the rest of the film is given up."""
SMALL_WIDTH, MAX_SMALL_PICTURES = 320, 1200
"""Width to which pictures are reduced to see where anything changes [pixels], and how many are kept at most: 70 MB."""
REPEATED_SHARE, REPEATED_LEAST = 0.3, 8.0
"""Change of a copy as a share of its neighbours', and change [levels of 255] below which nothing moves that would show one."""
CHANGED_PIXELS = 30
"""Number of pixels whose change is taken for that of the picture: a small mass is not more, in a reduced picture."""
UNEVEN_STEP, SLOT_SLACK = 0.05, 0.25
"""Parts of a usual step by which one departs from it to be uneven, and exceeds a step and a half before a frame is lost."""
CLOCK_SOURCE = "the film's clock"
"""Source of the true frame rate where nobody states another one."""
CAPTURE_RATE_KEY = "com.android.capture.fps"
"""Key by which phones state the true rate of slow motion."""
MAX_ASPECT = 4.0
"""Largest ratio of the sides of stored pixels: cameras have up to 4:3, wide lenses of cinemas 2."""
MAX_SHAKE = 1.5
"""Largest shift of the whole picture for which the camera stands still [pixels of a picture 1280 wide]."""
CELL, CELLS, LEAST_CELLS, SAMPLES = 10, 8, 3, 2
"""Blocks of pixels along each side of a cell, in which light changes smoothly; cells along the longer side of a picture, and
along its shorter side at least, of which the middle one outvotes a thing; pixels of a block that are averaged, a side."""
SAME_LEVEL, SAME_LIGHT = 1, 0.004
"""Change of a block's brightness that rounding alone gives [levels of 255], and relative change of brightness that is left."""
DARK, BRIGHT, LEAST_LIT = 16, 250, 0.25
"""Brightness below which noise rules, that of a full sensor [levels], and the share of blocks between that tells a gain."""
THING = 0.08
"""Departure from the surroundings from which on a cell shows a thing: less is no change of a pixel, either."""
ALIKE = 0.03
"""Distance from the median ratio up to which a block shows the light, and no thing."""
TURNS = {90: cv2.ROTATE_90_COUNTERCLOCKWISE, -90: cv2.ROTATE_90_CLOCKWISE, 180: cv2.ROTATE_180, -180: cv2.ROTATE_180}
"""Angle by which a stored picture is turned to be upright, counterclockwise [deg] -> how."""


class Picture(NamedTuple):
    """One decoded picture, upright. The arrays are valid until the next one is asked for."""

    frame: int
    """Number of the frame in the film, from 0."""
    planes: tuple[Bytes, ...]
    """Brightness, shape (height, width); blue and red less that, 128 for grey, at half the size."""

    def copied(self) -> Picture:
        """Return the picture with arrays of its own."""
        return Picture(self.frame, tuple(plane.copy() for plane in self.planes))


@dataclass(frozen=True, kw_only=True, eq=False)
class Survey:
    """A first pass over a film."""

    path: str
    facts: FilmFacts
    t: Array
    """Time of each frame from that of the first [s], shape (n,)."""
    small: tuple[Picture, ...] = field(repr=False)
    """Brightness of some frames at a reduced size."""


def film_error(path: str, found: str, way_out: str) -> FilmError:
    """Return an error of one line about a film."""
    return FilmError(f"{path}: {found}; {way_out}")


class OpenFilm:
    """A film that is open, for one pass over it.

    Raises
    ------
    FilmError
        If it is none, or has pictures of no usual size.
    """

    def __init__(self, path: str) -> None:
        self.path, self.broken = path, 0
        try:
            read_file(path, 0)
        except FileNotFoundError:
            raise film_error(path, "found no such file, needed a film", "check its name and folder") from None
        except (OSError, ValueError) as error:
            raise film_error(path, str(getattr(error, "strerror", "") or error), "name a film") from None
        try:
            self.container = av.open(path)
        except (av.error.FFmpegError, OSError, ValueError) as error:
            words = " ".join(str(getattr(error, "strerror", "") or error).split())
            raise film_error(
                path, f"found no film that can be read ({words}), needed one",
                "copy it from the camera again, or export it as MP4",
            ) from None  # fmt: skip
        try:
            self._check()
        except FilmError:
            self.container.close()
            raise

    def _check(self) -> None:
        if not self.container.streams.video:
            raise film_error(self.path, "found no pictures in it, needed a film", "is it a sound recording?")
        self.stream = self.container.streams.video[0]
        # One thread: a decoder with several keeps more pictures, and other work shares the machine
        self.stream.thread_type = "NONE"
        context = self.stream.codec_context
        if context is None or not MIN_PIXELS <= context.width * context.height <= MAX_PIXELS:
            size = "no size" if context is None else f"{context.width}x{context.height} pixels"
            raise film_error(self.path, f"found pictures of {size}, needed 64x48 to 8K", "export the film again as MP4")
        self.aspect = float(self.stream.sample_aspect_ratio or 1)
        """Width over height of the stored pixels."""
        if not 1 / MAX_ASPECT <= self.aspect <= MAX_ASPECT:
            raise film_error(
                self.path, f"found pixels {self.aspect:.3g} times as wide as high, needed at most {MAX_ASPECT:g} to 1",
                "export the film again with square pixels",
            )  # fmt: skip

    def frames(self) -> Iterator[Any]:
        """Yield decoded frames, and close the film at their end."""
        in_a_row = 0
        with self.container:
            packets = self.container.demux(self.stream)
            while True:
                try:
                    packet = next(packets, None)
                    if packet is None:
                        return
                    decoded = packet.decode()
                    in_a_row = 0
                except (av.error.FFmpegError, ValueError, OSError):
                    # A damaged packet costs its own pictures; what follows it can often be decoded
                    self.broken += 1
                    in_a_row += 1
                    if in_a_row > MAX_BROKEN_PACKETS:
                        return
                    continue
                yield from decoded


def _upright(frame: Any, index: int, aspect: float) -> Picture:
    """Return a frame as a person sees it, with square pixels; ``aspect`` is width over height of the stored ones."""
    if frame.format.name not in ("yuv420p", "yuvj420p"):
        frame = frame.reformat(format="yuv420p")
    planes = []
    for plane, (height, width) in zip(
        frame.planes, ((frame.height, frame.width), *[((frame.height + 1) // 2, (frame.width + 1) // 2)] * 2), strict=True
    ):
        rows = np.frombuffer(plane, np.uint8).reshape(-1, plane.line_size)
        planes.append(rows[:height, :width])
    if aspect != 1:
        # Exactly by the aspect about the left edge: to be resized to whole pixels would change it by up to a thousandth
        wider = np.array([[aspect, 0, 0.5 * (aspect - 1)], [0, 1, 0]])
        planes = [
            cv2.warpAffine(p, wider, (share * round(frame.width * aspect / 2), p.shape[0]), borderMode=cv2.BORDER_REPLICATE)
            for p, share in zip(planes, (2, 1, 1), strict=True)
        ]
    if (turn := TURNS.get(int(frame.rotation))) is not None:
        planes = [cv2.rotate(np.ascontiguousarray(p), turn) for p in planes]
    return Picture(index, tuple(planes))


def pictures(path: str, first: int, last: int, progress: Callable[[float], None] = lambda share: None) -> Iterator[Picture]:
    """Decode a film and yield its pictures ``first`` to ``last``; ``progress`` is called with the share that was yielded."""
    film = OpenFilm(path)
    for index, frame in enumerate(film.frames()):
        if index > last:
            return
        if index >= first:
            progress((index - first) / max(last - first, 1))
            yield _upright(frame, index, film.aspect)


def survey(path: str | Path, *, frame_rate: float | None = None, needs_rest: bool = True) -> Survey:
    """Decode a film once: its facts, the frames' times, and samples of its pictures.

    Parameters
    ----------
    frame_rate
        True frame rate [Hz], for slow motion whose file does not state it.
    needs_rest
        Whether a camera that moves is refused.

    Raises
    ------
    FilmError
        If it is no film, is too short or too damaged, or if the camera moved.
    """
    film = OpenFilm(os.fspath(path))
    stream, file = film.stream, film.path
    stated = float(stream.average_rate) if stream.average_rate else None
    metadata = dict(film.container.metadata) | dict(stream.metadata)
    codec, base = stream.codec_context.name, float(stream.time_base or 0)
    clock: list[float] = []
    change: list[float] = []
    before: Bytes | None = None
    size, interlaced, bits = (0, 0), False, 8
    smalls: list[Picture] = []
    reduction, step = 1.0, 1
    for index, frame in enumerate(film.frames()):
        clock.append(math.nan if frame.pts is None else frame.pts * base)
        picture = _upright(frame, index, film.aspect)
        luma = picture.planes[0]
        if index == 0:
            size, interlaced = luma.shape[::-1], bool(frame.interlaced_frame)
            bits = frame.format.components[0].bits
            reduction = max(max(size) / SMALL_WIDTH, 1.0)
        elif luma.shape[::-1] != size:
            raise film_error(file, f"found pictures of {size[0]}x{size[1]} and other pixels, needed one size", "cut it there")
        small = cv2.resize(luma, (round(size[0] / reduction), round(size[1] / reduction)), interpolation=cv2.INTER_AREA)
        change.append(255.0 if before is None else picture_change(small, before))
        before = small
        if index % step == 0:
            smalls.append(Picture(index, (small,)))
        if len(smalls) > MAX_SMALL_PICTURES:
            smalls, step = smalls[::2], 2 * step
    if len(clock) < MIN_FRAMES:
        damage = f" and {film.broken} damaged parts" if film.broken else ""
        found = {0: "found no picture that can be decoded", 1: "found a single picture"}.get(
            len(clock), f"found {len(clock)} frames"
        )
        way_out = {0: "copy it from the camera again", 1: "name the film, not a photo of it"}
        raise film_error(
            file, f"{found}{damage}, needed a film of {MIN_FRAMES} frames or more",
            way_out.get(len(clock), "film from before the release to the halt"),
        )  # fmt: skip
    shake = camera_shake([p.planes[0] for p in smalls]) * reduction
    if needs_rest and shake > MAX_SHAKE * max(size) / 1280:
        raise film_error(
            file,
            f"found a camera that moves ({shake:.0f} pixels), needed one that stands still",
            "put it on something solid and film again; or, if it stood still, --still",
        )
    t, film_clock = frame_times(np.array(clock), base, stated, frame_rate, metadata)
    # A copy changes by little beside its neighbours
    steps = np.array(change)
    beside = np.minimum(np.append(steps[:1], steps[:-1]), np.append(steps[1:], steps[-1:]))
    repeated = (steps < REPEATED_SHARE * beside) & (beside > REPEATED_LEAST)
    return Survey(
        path=file,
        facts=FilmFacts(
            codec=codec, width=size[0], height=size[1], pixel_aspect=film.aspect, interlaced=interlaced, bits=bits,
            frames=len(t), repeated=tuple(int(i) for i in np.flatnonzero(repeated)), broken=film.broken, shake=shake,
            clock=film_clock,
        ),
        t=t,
        small=tuple(smalls),
    )  # fmt: skip


def light_of(luma: Bytes) -> Bytes:
    """Return the mean brightness of blocks of a picture, by which `gain` compares its light with another one's."""
    long = max(luma.shape)
    rows, columns = (max(round(CELLS * side / long), LEAST_CELLS) * CELL for side in luma.shape)
    step = max(long // (SAMPLES * CELLS * CELL), 1)
    some = np.ascontiguousarray(luma[step // 2 :: step, step // 2 :: step])
    return np.asarray(cv2.resize(some, (columns, rows), interpolation=cv2.INTER_AREA))


def gain(light: Bytes, reference: Bytes) -> Gain | None:
    """Return by which factor a picture is brighter than a reference, both as `light_of` has them; None: as bright.

    It is a profile of the rows, the usual ratio of each, times what is left in cells; where a cell is unlike its neighbours, it
    shows a thing, and their median counts. A thing that moves covers neither half a row nor half of nine cells.
    """
    rows, columns = (side // CELL for side in light.shape)
    changed = cv2.compare(cv2.absdiff(light, reference), SAME_LEVEL, cv2.CMP_GT)
    if cv2.resize(changed, (columns, rows), interpolation=cv2.INTER_AREA).max() < 128:  # in no cell most blocks
        return None
    is_lit = (reference >= DARK) & (np.maximum(light, reference) < BRIGHT)
    if np.mean(is_lit) < LEAST_LIT:
        return None
    ratio = np.asarray(light / np.maximum(reference, 1), np.float32)
    ratio[~is_lit] = np.median(ratio[is_lit])
    profile = _usual(ratio)
    rest = (ratio / profile).reshape(rows, CELL, columns, CELL).swapaxes(1, 2).reshape(rows, columns, CELL**2)
    cells = _usual(rest)[..., 0]
    among = cv2.medianBlur(cv2.copyMakeBorder(cells, 1, 1, 1, 1, cv2.BORDER_REFLECT_101), 3)[1:-1, 1:-1]
    cells = np.where(np.abs(cells - among) > THING, among, cells)
    smooth = np.asarray(profile * cv2.resize(cells, ratio.shape[::-1], interpolation=cv2.INTER_CUBIC), np.float32)
    return smooth if np.abs(smooth - 1).max() > SAME_LIGHT else None


def _usual(values: NDArray[Any]) -> NDArray[np.float32]:
    """Return the mean of the values near the median, along the last axis, which is kept: levels are too coarse for a median."""
    middle = np.median(values, axis=-1, keepdims=True)
    near = np.abs(values - middle) <= ALIKE
    # Of an even number of values the median may lie between two groups, near to neither
    count = np.sum(near, axis=-1, keepdims=True)
    mean = np.sum(values * near, axis=-1, keepdims=True) / np.maximum(count, 1)
    return np.asarray(np.where(count > 0, mean, middle), np.float32)


def relit(planes: Sequence[Bytes], light: Bytes, own: Bytes | None = None) -> tuple[Bytes, ...]:
    """Return a picture's planes, brightness and colours, as another light shows them.

    Parameters
    ----------
    light
        The other light, as of `light_of`.
    own
        That of the picture; None: it is found here.
    """
    factor = gain(light, light_of(planes[0]) if own is None else own)
    if factor is None:
        return tuple(planes)
    shown = [cv2.resize(factor, plane.shape[::-1], interpolation=cv2.INTER_LINEAR) for plane in planes[:2]]
    lit = [cv2.multiply(planes[0], shown[0], dtype=cv2.CV_8U)]
    for colour in planes[1:]:
        scaled = cv2.multiply(colour, shown[1], dtype=cv2.CV_32F)
        lit.append(cv2.add(scaled, 128 * (1 - shown[1]), dtype=cv2.CV_8U))
    return tuple(lit)


def picture_change(picture: Bytes, before: Bytes) -> float:
    """Return the mean of the largest changes from one reduced picture to the next, apart from the light's [levels of 255]."""
    (before,) = relit((before,), light_of(picture))
    counts = cv2.calcHist([cv2.absdiff(picture, before)], [0], None, [256], [0, 256]).ravel()[::-1]
    taken = np.minimum(np.cumsum(counts), CHANGED_PIXELS)
    return float(np.diff(taken, prepend=0.0) @ np.arange(255, -1, -1)) / max(float(taken[-1]), 1.0)


def camera_shake(small: list[Bytes]) -> float:
    """Return the largest shift of the whole picture, by the median optical flow of its corners [reduced pixels].

    Not by phase correlation, which jumps by a whole square of a ruled panel.
    """
    reference = small[len(small) // 2]
    light = light_of(reference)
    corners = cv2.goodFeaturesToTrack(reference, 150, 0.02, 8)
    if corners is None or len(corners) < 12:
        return 0.0
    shifts = [0.0]
    for k in np.unique(np.linspace(0, len(small) - 1, 15).astype(int)):
        (picture,) = relit((small[k],), light)
        moved, found, _ = cv2.calcOpticalFlowPyrLK(reference, picture, corners, None, winSize=(15, 15), maxLevel=2)
        step = (moved - corners).reshape(-1, 2)[found.ravel() == 1]
        if len(step) > 8:
            shifts.append(float(np.hypot(*np.median(step, axis=0))))
    return max(shifts)


def frame_times(
    clock: Array, tick: float, stated: float | None, frame_rate: float | None, metadata: dict[str, str]
) -> tuple[Array, Clock]:
    """Return the time of each frame [s], shape (n,), and where it comes from.

    Parameters
    ----------
    clock
        The film's own times [s], nan where it has none, shape (n,).
    tick
        Unit of which they are whole numbers [s].
    stated, frame_rate
        Frames per second, as the film's header and as the user states them [Hz].
    metadata
        Of the film, by name: it may have the camera's true rate.
    """
    backward = int(np.sum(np.diff(clock) <= 0))
    if backward or not np.all(np.isfinite(clock)):
        clock = np.arange(len(clock)) / (stated or 30.0)
        reason = "the film's own times run backwards" if backward else "the film has no times"
        source = f"numbers of the frames over the stated rate, as {reason}"
    else:
        clock, source = _even_times(clock, tick, stated), "the frames' own times"
    steps = np.diff(clock)
    usual = float(np.median(steps))
    # A step of one and a half is a recorder's unrest, and no lost frame
    slots = np.maximum(np.round(steps / usual - SLOT_SLACK), 1)
    own_rate = float(np.sum(slots) / (clock[-1] - clock[0]))
    rate, rate_source = own_rate, CLOCK_SOURCE
    try:
        capture = float(metadata.get(CAPTURE_RATE_KEY, "nan"))
    except ValueError:
        capture = math.nan
    if frame_rate is not None:
        rate, rate_source = frame_rate, "stated by the user"
    elif math.isfinite(capture) and capture > 0:
        rate, rate_source = capture, "stated in the film as the camera's"
    uneven = int(np.sum(np.abs(steps / usual - 1) > UNEVEN_STEP))
    return (clock - clock[0]) * own_rate / rate, Clock(
        source=source, own_rate=own_rate, rate=rate, rate_source=rate_source,
        lost=int(np.sum(slots - 1)), uneven=uneven, backward=backward,
    )  # fmt: skip


def _even_times(clock: Array, tick: float, stated: float | None) -> Array:
    """Return the times of even frames [s] that were rounded to ticks, WebM's milliseconds; the clock's own if it is no such."""
    rounding, rates = np.full(len(clock), 0.5 * tick), [] if stated is None else [stated]
    grid = frame_grid(clock, rounding, rates)
    if grid is None:
        return clock
    # The stated rate, where the ticks do not tell the difference
    grid = grid.at_usual_rate(clock, rounding, rates) or grid
    return grid.start + grid.number / grid.rate
