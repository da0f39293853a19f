"""Read a film: its pictures one after the other, when each was taken, and what the film is.

Pictures are decoded by PyAV and never kept, so that memory does not grow with the film; each pass over it decodes again.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from looping_pendulum.errors import HarnessError, MissingPackageError, one_line
from looping_pendulum.installation import install_command
from looping_pendulum.reference_ode.geometry import Array

FILM_ENDINGS = (".mp4", ".mov", ".m4v", ".avi", ".mkv", ".webm", ".3gp", ".mts", ".m2ts", ".mpg", ".mpeg", ".wmv", ".gif")
"""Endings of file names that are taken for films where a table may stand, too."""
PACKAGES = ("opencv-python-headless", "av")
"""Packages that read films, as pip knows them."""
MAX_PIXELS = 50e6
"""Largest picture [pixels]: 8K films have 33 million, and a damaged header must not ask for all memory."""
MIN_PIXELS = 64 * 48
"""Smallest picture in which masses can be distinguished [pixels]."""
MIN_FRAMES = 8
"""Fewest frames of a film: through fewer, no motion can be followed."""
MAX_BROKEN_PACKETS = 100
"""Broken packets in a row after which the rest of the film is given up."""
SMALL_WIDTH = 320
"""Width to which pictures are reduced to see where anything changes [pixels]."""
MAX_SMALL_PICTURES = 1200
"""Reduced pictures that are kept at most: 70 MB."""
MAX_KEPT_BYTES = 80e6
"""Memory for pictures of full size that the background is made of [bytes]."""
REPEATED_SHARE = 0.3
"""A picture that changes less than this share of what its neighbours do is a copy: copies reach 0.08, others begin at 0.8."""
REPEATED_LEAST = 8.0
"""Change [levels of 255] below which nothing moves, and a copy looks like a still picture."""
CHANGED_PIXELS = 30
"""Number of pixels whose change is taken for that of the picture: a small mass is not more, in a reduced picture."""
UNEVEN_STEP = 0.05
"""Departure of a step of time from the usual one, relative to it, from which on it is called uneven."""
SLOT_SLACK = 0.25
"""Part of a usual step by which one must exceed a step and a half, and so on, before a frame counts as lost."""
TICK_SPREAD = 1.5
"""Ticks by which times that were rounded to them may spread about even frames: one, and a half as the rate is fitted."""
CAPTURE_RATE_KEY = "com.android.capture.fps"
"""Key by which phones state the true rate of slow motion."""
MAX_SHAKE = 1.5
"""Largest shift of the whole picture for which the camera stands still [pixels of a picture 1280 wide]."""


class FilmError(HarnessError, ValueError):
    """A film cannot be read, or the masses cannot be found in it."""


class Picture(NamedTuple):
    """One decoded picture, upright. The arrays are valid until the next one is asked for."""

    frame: int
    """Number of the frame in the film, from 0."""
    luma: NDArray[np.uint8]
    """Brightness, shape (height, width)."""
    blue: NDArray[np.uint8]
    """Blue less luma, 128 for grey, at half the size."""
    red: NDArray[np.uint8]
    """Red less luma, 128 for grey, at half the size."""

    @property
    def planes(self) -> tuple[NDArray[np.uint8], ...]:
        """Return brightness and both colours."""
        return self.luma, self.blue, self.red

    def copied(self) -> Picture:
        """Return the picture with arrays of its own."""
        return Picture(self.frame, *(plane.copy() for plane in self.planes))


@dataclass(frozen=True, kw_only=True)
class FilmFacts:
    """What a film is."""

    codec: str
    pixel_format: str
    width: int
    """Of the upright picture [pixels]."""
    height: int
    rotation: int
    """By which the stored pictures were turned, counterclockwise [deg]."""
    interlaced: bool
    bits: int
    """Bits of each sample of brightness; more than 8 are reduced to 8."""
    frames: int
    stated_rate: float | None
    """Frame rate in the film's header [Hz]."""
    clock: str
    """Where the frames' times come from, in words."""
    clock_rate: float
    """Frames per second by the film's own clock [Hz]."""
    rate: float
    """Frames per second in truth, as far as the film or the user says [Hz]."""
    rate_source: str
    """Where `rate` comes from, in words."""
    repeated: tuple[int, ...]
    """Frames that are copies of the one before."""
    lost: int
    """Places in an even row of times at which there is no frame."""
    uneven: int
    """Steps of time that depart from the usual one, lost frames among them."""
    backward: int
    """Times that are not later than the one before."""
    broken: int
    """Packets that could not be decoded."""
    shake: float
    """Largest shift of the whole picture [pixels]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Survey:
    """A first pass over a film."""

    path: str
    facts: FilmFacts
    t: Array
    """Time of each frame from that of the first [s], shape (n,)."""
    repeated: NDArray[np.bool_]
    """Whether each frame is a copy of the one before, shape (n,)."""
    small: NDArray[np.uint8]
    """Brightness of some frames at a reduced size, shape (m, height, width)."""
    small_index: NDArray[np.intp]
    """Numbers of these frames, shape (m,)."""
    reduction: float
    """Pixels of the film per pixel of `small`."""
    kept: tuple[Picture, ...] = field(repr=False)
    """Pictures from which the background is made: some evenly through the film, some where much moves."""


def imaging() -> Any:
    """Return OpenCV.

    Raises
    ------
    MissingPackageError
        If it is not installed.
    """
    try:
        import cv2
    except ImportError:
        raise _missing("opencv-python-headless") from None
    # With pictures this small further threads only wait for a core
    cv2.setNumThreads(1)
    return cv2


def decoding() -> Any:
    """Return PyAV.

    Raises
    ------
    MissingPackageError
        If it is not installed.
    """
    try:
        import av
    except ImportError:
        raise _missing("av") from None
    return av


def _missing(package: str) -> MissingPackageError:
    command = install_command(*PACKAGES)
    return MissingPackageError(f"films: found no package {package}, needed it to read films; to get it: `{command}`")


def film_error(path: str, found: str, way_out: str) -> FilmError:
    """Return an error of one line about a film."""
    return FilmError(one_line(f"{path}: {found}; {way_out}"))


def is_film(path: str | Path) -> bool:
    """Return whether a file is a film by its name."""
    return Path(path).suffix.lower() in FILM_ENDINGS


class _Decoder:
    """The decoder of one film, for one pass."""

    def __init__(self, path: str) -> None:
        self.path, self.av = path, decoding()
        self.broken = 0
        if not os.path.exists(path):
            raise film_error(path, "found no such file, needed a film", "check its name and folder")
        if os.path.isdir(path):
            raise film_error(path, "found a folder, needed a film", "name a film in it")
        try:
            self.container = self.av.open(path)
        except (self.av.error.FFmpegError, OSError, ValueError) as error:
            raise film_error(
                path,
                f"found no film that can be read ({_words(error)}), needed one",
                "copy it from the camera again, or export it as MP4",
            ) from None
        if not self.container.streams.video:
            self.container.close()
            raise film_error(path, "found no pictures in it, needed a film", "is it a sound recording?")
        self.stream = self.container.streams.video[0]
        # One thread: a decoder with several keeps more pictures, and other work shares the machine
        self.stream.thread_type = "NONE"
        context = self.stream.codec_context
        if context is None or not MIN_PIXELS <= context.width * context.height <= MAX_PIXELS:
            size = "no size" if context is None else f"{context.width}x{context.height} pixels"
            self.container.close()
            raise film_error(path, f"found pictures of {size}, needed 64x48 to 8K", "export the film again as MP4")

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
                except (self.av.error.FFmpegError, ValueError, OSError):
                    # A damaged packet costs its own pictures; what follows it can often be decoded
                    self.broken += 1
                    in_a_row += 1
                    if in_a_row > MAX_BROKEN_PACKETS:
                        return
                    continue
                yield from decoded


def _words(error: BaseException) -> str:
    return " ".join(str(getattr(error, "strerror", "") or error).split())


def _upright(frame: Any, index: int) -> tuple[Picture, int]:
    """Return a frame's planes as a person sees them, and the rotation [deg] that this took."""
    cv2 = imaging()
    rotation = int(frame.rotation) if int(frame.rotation) in (90, -90, 180, -180) else 0
    if frame.format.name not in ("yuv420p", "yuvj420p"):
        frame = frame.reformat(format="yuv420p")
    planes = []
    for plane, (height, width) in zip(
        frame.planes, ((frame.height, frame.width), *[((frame.height + 1) // 2, (frame.width + 1) // 2)] * 2), strict=True
    ):
        rows = np.frombuffer(plane, np.uint8).reshape(-1, plane.line_size)
        planes.append(rows[:height, :width])
    if rotation:
        turn = {90: cv2.ROTATE_90_COUNTERCLOCKWISE, -90: cv2.ROTATE_90_CLOCKWISE}.get(rotation, cv2.ROTATE_180)
        planes = [cv2.rotate(np.ascontiguousarray(p), turn) for p in planes]
    return Picture(index, *planes), rotation


def pictures(survey: Survey, first: int = 0, last: int | None = None) -> Iterator[Picture]:
    """Decode a film again and yield its pictures ``first`` to ``last`` (default: the last one)."""
    return pictures_of(survey.path, first, survey.facts.frames - 1 if last is None else last)


def pictures_of(path: str, first: int, last: int) -> Iterator[Picture]:
    """Decode a film and yield its pictures ``first`` to ``last``."""
    for index, frame in enumerate(_Decoder(path).frames()):
        if index > last:
            return
        if index >= first:
            yield _upright(frame, index)[0]


@dataclass(kw_only=True)
class _Sample:
    """Pictures that are kept at even steps of a growing quantity; the steps double when the memory is full."""

    limit: int
    step: float
    kept: list[tuple[float, Any]] = field(default_factory=list)

    def offer(self, at: float, make: Any) -> None:
        """Keep what ``make`` returns, if the quantity has grown by a step since the last one."""
        if self.kept and at < self.kept[-1][0] + self.step:
            return
        self.kept.append((at, make()))
        if len(self.kept) > self.limit:
            self.kept = self.kept[::2]
            self.step *= 2


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
    MissingPackageError
        If the packages that read films are not installed.
    """
    cv2, file = imaging(), os.fspath(path)
    decoder = _Decoder(file)
    stream = decoder.stream
    stated = float(stream.average_rate) if stream.average_rate else None
    metadata = dict(decoder.container.metadata) | dict(stream.metadata)
    codec, base = stream.codec_context.name, float(stream.time_base or 0)
    clock: list[float] = []
    change: list[float] = []
    before: NDArray[np.uint8] | None = None
    rotation, interlaced, format_name, bits, size = 0, False, "", 8, (0, 0)
    steady = moving = smalls = _Sample(limit=1, step=1.0)
    reduction, activity = 1.0, 0.0
    for index, frame in enumerate(decoder.frames()):
        clock.append(math.nan if frame.pts is None else frame.pts * base)
        picture, rotation = _upright(frame, index)
        if index == 0:
            size = picture.luma.shape[::-1]
            interlaced, format_name = bool(frame.interlaced_frame), frame.format.name
            bits = frame.format.components[0].bits
            reduction = max(max(size) / SMALL_WIDTH, 1.0)
            limit = int(np.clip(MAX_KEPT_BYTES / (1.5 * size[0] * size[1]), 12, 60))
            steady, moving = _Sample(limit=limit // 2, step=1.0), _Sample(limit=limit // 2, step=200.0)
            smalls = _Sample(limit=MAX_SMALL_PICTURES, step=1.0)
        elif picture.luma.shape[::-1] != size:
            raise film_error(file, f"found pictures of {size[0]}x{size[1]} and other pixels, needed one size", "cut it there")
        small = cv2.resize(picture.luma, (round(size[0] / reduction), round(size[1] / reduction)), interpolation=cv2.INTER_AREA)
        change.append(255.0 if before is None else picture_change(small, before))
        activity += min(change[-1], 255.0)
        before = small
        steady.offer(index, picture.copied)
        moving.offer(activity, picture.copied)
        smalls.offer(index, lambda index=index, small=small: (index, small))
    _refuse_short(file, len(clock), decoder.broken)
    shake = _shake(cv2, [s for _, (_, s) in smalls.kept]) * reduction
    if needs_rest and shake > MAX_SHAKE * max(size) / 1280:
        raise film_error(
            file,
            f"found a camera that moves ({shake:.0f} pixels), needed one that stands still",
            "put it on something solid and film again",
        )
    t, facts = _times(np.array(clock), base, stated, frame_rate, metadata)
    repeated = _repeated(np.array(change))
    pool = {p.frame: p for _, p in (*steady.kept, *moving.kept)}
    return Survey(
        path=file,
        facts=FilmFacts(
            codec=codec, pixel_format=format_name, bits=bits, width=size[0], height=size[1], rotation=rotation,
            interlaced=interlaced, frames=len(t), stated_rate=stated, repeated=tuple(int(i) for i in np.flatnonzero(repeated)),
            broken=decoder.broken, shake=shake, **facts,
        ),
        t=t,
        repeated=repeated,
        small=np.array([s for _, (_, s) in smalls.kept]),
        small_index=np.array([i for _, (i, _) in smalls.kept]),
        reduction=reduction,
        kept=tuple(pool[i] for i in sorted(pool)),
    )  # fmt: skip


def _refuse_short(file: str, frames: int, broken: int) -> None:
    damage = f" and {broken} damaged parts" if broken else ""
    if frames == 0:
        raise film_error(file, f"found no picture that can be decoded{damage}, needed a film", "copy it from the camera again")
    if frames == 1:
        raise film_error(file, f"found a single picture{damage}, needed a film", "name the film, not a photo of it")
    if frames < MIN_FRAMES:
        raise film_error(
            file, f"found {frames} frames{damage}, needed {MIN_FRAMES} or more", "film from before the release to the halt"
        )


def picture_change(picture: NDArray[np.uint8], before: NDArray[np.uint8]) -> float:
    """Return the mean of the largest changes of brightness from one reduced picture to the next [levels of 255]."""
    cv2 = imaging()
    counts = cv2.calcHist([cv2.absdiff(picture, before)], [0], None, [256], [0, 256]).ravel()[::-1]
    taken = np.minimum(np.cumsum(counts), CHANGED_PIXELS)
    return float(np.diff(taken, prepend=0.0) @ np.arange(255, -1, -1)) / max(float(taken[-1]), 1.0)


def _repeated(change: Array) -> NDArray[np.bool_]:
    """Return which pictures are copies of the one before, by how much each changes beside its neighbours."""
    beside = np.minimum(np.append(change[:1], change[:-1]), np.append(change[1:], change[-1:]))
    return np.asarray((change < REPEATED_SHARE * beside) & (beside > REPEATED_LEAST))


def _shake(cv2: Any, small: list[NDArray[np.uint8]]) -> float:
    """Return the largest shift of the whole picture, by the median optical flow of its corners [reduced pixels].

    Not by phase correlation, which jumps by a whole square of a ruled panel.
    """
    reference = small[len(small) // 2]
    corners = cv2.goodFeaturesToTrack(reference, 150, 0.02, 8)
    if corners is None or len(corners) < 12:
        return 0.0
    shifts = [0.0]
    for k in np.unique(np.linspace(0, len(small) - 1, 15).astype(int)):
        moved, found, _ = cv2.calcOpticalFlowPyrLK(reference, small[k], corners, None, winSize=(15, 15), maxLevel=2)
        step = (moved - corners).reshape(-1, 2)[found.ravel() == 1]
        if len(step) > 8:
            shifts.append(float(np.hypot(*np.median(step, axis=0))))
    return max(shifts)


def _times(
    clock: Array, tick: float, stated: float | None, frame_rate: float | None, metadata: dict[str, str]
) -> tuple[Array, dict[str, Any]]:
    """Return the time of each frame [s] and the facts about the clock, which has whole numbers of a ``tick`` [s]."""
    n = len(clock)
    steps = np.diff(clock)
    backward = int(np.sum(steps <= 0))
    if backward or not np.all(np.isfinite(clock)):
        rate = stated or 30.0
        clock, source = np.arange(n) / rate, "numbers of the frames over the stated rate, as the film's own times run backwards"
        if not backward:
            source = "numbers of the frames over the stated rate, as the film has no times"
        steps = np.diff(clock)
    else:
        clock, source = _even_times(clock, tick, stated), "the frames' own times"
        steps = np.diff(clock)
    usual = float(np.median(steps))
    # A step of one and a half is a recorder's unrest, and no lost frame
    slots = np.maximum(np.round(steps / usual - SLOT_SLACK), 1)
    lost = int(np.sum(slots - 1))
    clock_rate = float(np.sum(slots) / (clock[-1] - clock[0]))
    rate, rate_source = clock_rate, "the film's clock"
    capture = _positive(metadata.get(CAPTURE_RATE_KEY))
    if frame_rate is not None:
        rate, rate_source = frame_rate, "stated by the user"
    elif capture:
        rate, rate_source = capture, "stated in the film as the camera's"
    return (clock - clock[0]) * clock_rate / rate, {
        "clock": source, "clock_rate": clock_rate, "rate": rate, "rate_source": rate_source, "lost": lost,
        "uneven": int(np.sum(np.abs(steps / usual - 1) > UNEVEN_STEP)), "backward": backward,
    }  # fmt: skip


def _even_times(clock: Array, tick: float, stated: float | None) -> Array:
    """Return the times of even frames [s] that were rounded to ticks, WebM's milliseconds; the clock's own if it is no such."""
    steps = np.diff(clock)
    consecutive = np.arange(len(clock))
    with_lost = np.cumsum(np.append(0, np.maximum(np.round(steps / np.median(steps)), 1)))
    for number in (consecutive, with_lost):
        fitted = 1 / float(np.polyfit(number, clock, 1)[0])
        # The stated rate, where the ticks do not tell the difference
        for rate in (stated or fitted, fitted):
            beside = clock - number / rate
            if np.ptp(beside) <= TICK_SPREAD * tick:
                return np.asarray(number / rate + 0.5 * (beside.min() + beside.max()))
    return clock


def _positive(text: str | None) -> float | None:
    try:
        value = float(text or "")
    except ValueError:
        return None
    return value if math.isfinite(value) and value > 0 else None
