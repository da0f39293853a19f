"""Films of a looping pendulum with the truth of each frame, made without a line of the tracker.

A scene is drawn in linear light: a textured background with a ruled panel and a stand, the rod's end, both strings, both masses
with their shading, their shadows, and a hand that lets the light mass go. What moves is averaged over the exposure; then come
the camera's gamma, light that changes, the camera's noise, and an encoder. Motions come from the blind simulator, so that
nothing here was made by the package.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
from numpy.typing import NDArray

from tests.blind import Apparatus, Effects
from tests.blind.simulator import Motion, simulate

Array = NDArray[np.float64]

GAMMA = 2.2
LEVELS = 4095
"""Steps of linear light in the table that turns it into the camera's 8 bits."""
TO_CAMERA = np.round((np.arange(LEVELS + 1) / LEVELS) ** (1 / GAMMA) * 255).astype(np.uint8)
PANEL = (0.66, 0.70, 0.70)
"""Colour of the background, blue, green and red in linear light."""
STRING_COLOUR = (0.15, 0.15, 0.15)
SKIN = (0.30, 0.42, 0.68)
HLG, BT2020 = 18, 9
"""Numbers of a transfer and of primaries in ITU-T H.273."""
ROD_DISTANCE, ROD_BEHIND, ROD_BEFORE = 2.0, 0.06, 0.01
"""From the camera to the string's plane, and how far the rod reaches behind that and before it [m]."""
ROTATIONS = {0: 0, 90: -1, 180: 2, -90: 1}
"""Rotation that the file states [deg, counterclockwise] -> quarter turns by which the sensor's picture is stored."""


@dataclass(frozen=True, kw_only=True)
class Decoy:
    """A dark disc that moves."""

    place: Callable[[float], tuple[float, float] | None]
    """Centre in the picture [px] at a time since the release [s]; None: not in the picture."""
    radius: float
    """[px]"""
    level: int = 25
    """Brightness of 255."""


@dataclass(frozen=True, kw_only=True)
class Scene:
    """What is filmed, and by which camera."""

    size: tuple[int, int] = (1280, 720)
    """Width and height of the upright picture [px]."""
    scale: float = 830.0
    """[px/m]"""
    rod: tuple[float, float] = (790.0, 262.0)
    """Where the rod's centre is seen [px]."""
    tilt: float = 0.0
    """Angle by which the picture is turned, counterclockwise [deg]."""
    frame_rate: float = 240.0
    exposure: float = 1e-3
    """[s]"""
    before: float = 0.25
    """How long the masses rest before the release [s]."""
    duration: float = 1.0
    """From the release on [s]."""
    codec: str = "libx264"
    crf: int = 23
    preset: str = "veryfast"
    """Of x264: how long the encoder may try."""
    pixels: str = "yuv420p"
    stated_rate: float | None = None
    """Rate by which the file's clock plays the frames; None: the true one."""
    rotation: int = 0
    """Stated in the file [deg, counterclockwise]; the pixels are stored turned the other way."""
    aspect: Fraction = Fraction(1)
    """Width over height of a stored pixel, which the file states: the stored picture is squeezed by it, `size` is not."""
    noise: float = 1.0
    """Standard deviation of a pixel's luma [levels of 255]."""
    contrast: float = 1.0
    alike: bool = False
    """Whether both masses have the same colour."""
    hand: bool = False
    covered: float | None = None
    """How long after the release the light mass is still behind the fingers of a hand, which then draws back [s]; None: `hand`
    says whether there is one."""
    shadow: bool = False
    clutter: bool = False
    posters: bool = False
    """Whether a wall with the frame of a window, a skirting board, a sheet of text and a dark poster stands for the panel."""
    rod_side: bool = False
    """Whether the rod, which comes out of the wall, is seen as by a camera opposite the picture's middle at `ROD_DISTANCE`."""
    decoys: tuple[Decoy, ...] = ()
    """Discs that move before the apparatus and have nothing to do with it."""
    readout: float = 0.0
    """Time from the reading of the first row to that of the last [s]; a frame's time is its middle row's."""
    jitter: float = 0.0
    """Range of the unrest of the frames' true times, which the file's clock has too [frames]."""
    ramp: tuple[float, float] = (1.0, 1.0)
    """Factors of the frame rate in the first and in the last third, as a phone that changes its rate; the clock has it, too."""
    hdr: bool = False
    """Whether the file states the transfer and primaries of HDR (HLG, BT.2020)."""
    lost: tuple[int, ...] = ()
    """Frames that are not stored."""
    uneven_light: float = 0.15
    drift: tuple[float, float, float] = (0.0, 0.0, 0.3)
    """Relative change of the exposure in linear light, when it begins after the release [s], and how long it takes [s]; the
    brighter end has the usual light."""
    flicker: tuple[float, float] = (0.0, 100.0)
    """Relative amplitude of the lamps' light, and its frequency [Hz]: each row has the mean over its own exposure."""
    cloud: float = 0.0
    """Relative change of the light at the centre of a smooth patch that moves over the picture."""
    light_radius: float = 8e-3
    heavy_size: tuple[float, float] = (13e-3, 16e-3)
    """Half width and half height of the heavy mass [m]."""
    project: Callable[[Array], Array] | None = None
    """Maps positions [m] to the picture, from the rod, x right and y down [px]; None: by `scale` and `tilt`."""
    seed: int = 1
    metadata: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Truth:
    """What each stored frame shows."""

    t: Array
    """Time since the release at mid-exposure of the middle row [s], shape (n,)."""
    light: Array
    """Centre of the light mass as it is seen [px], shape (n, 2)."""
    heavy: Array
    clock: Array
    """Time by the file's clock [s]."""
    rod: Array
    scale: float
    motion: Motion = field(repr=False)


def seen_by_a_camera(
    scene: Scene, *, aside: float = 0.0, above: float = 0.0, lens: float = 0.0, distance: float = 3.0
) -> Callable[[Array], Array]:
    """Return the projection of a camera that is turned aside and looks down, for `Scene.project`.

    Parameters
    ----------
    aside, above
        Angles [deg].
    lens
        Share of the distance from the picture's middle by which the lens displaces at half the picture's width.
    distance
        From the camera to the rod [m].
    """
    across, down = math.radians(aside), math.radians(above)
    middle, half = np.array(scene.size) / 2, scene.size[0] / 2

    def project(position: Array) -> Array:
        x, y = position[..., 0], position[..., 1]
        depth = distance + x * math.sin(across) + y * math.sin(down)
        from_rod = scene.scale * distance * np.stack([x * math.cos(across) / depth, -y * math.cos(down) / depth], axis=-1)
        off = (np.array(scene.rod) + from_rod - middle) / half
        return middle + half * off * (1 + lens * np.sum(off**2, axis=-1, keepdims=True)) - scene.rod

    return project


def looping_motion(duration: float = 1.0, effects: Effects | None = None, **apparatus: Any) -> Motion:
    """Return the blind simulator's motion of the paper's apparatus, with changes."""
    return simulate(Apparatus(**apparatus), effects, duration=duration)


def until_ball_rests(motion: Motion, radius: float, caught: float = math.inf, stopping: float = 0.01) -> Motion:
    """Return a motion whose light mass, a ball, lies still from where it touches the rod, or where a hand catches it.

    Parameters
    ----------
    caught
        Time from which on a hand brings both masses to rest [s].
    stopping
        Time in which it does so [s].
    """
    on_rod = np.flatnonzero(np.hypot(*motion.light.T[:2]) <= motion.apparatus.rod_radius + radius)
    end = float(motion.t[on_rod[0]]) if len(on_rod) else float(motion.t[-1])
    if caught >= end:
        caught, stopping = end, 1e-6
    # Time goes on ever more slowly, as exp(-2 x) does, to half the stopping time after the catch
    late = np.maximum(motion.t - caught, 0.0)
    slowed = np.minimum(motion.t, caught) + 0.5 * stopping * -np.expm1(-2 * late / stopping)
    shown = [np.array([np.interp(slowed, motion.t, column) for column in part.T]).T for part in (motion.light, motion.heavy)]
    still = (motion.t <= caught)[:, None]
    # Interpolated speeds would overshoot: between two steps of 50 us a straight line will do
    speeds = [np.gradient(part, motion.t, axis=0) for part in shown]
    speeds = [np.where(still, own, v) for own, v in zip((motion.light_velocity, motion.heavy_velocity), speeds, strict=True)]
    return replace(motion, light=shown[0], heavy=shown[1], light_velocity=speeds[0], heavy_velocity=speeds[1])


def render(path: Path, scene: Scene, motion: Motion) -> Truth:
    """Write a film and return its truth."""
    return _Studio(scene, motion).film(path)


def cut_off(film: Path, target: Path, frames: int) -> None:
    """Write a copy of a film without its first frames, as phones shorten one: an edit list says that it begins after them."""
    with av.open(str(film)) as source, av.open(str(target), "w") as container:
        stream = source.streams.video[0]
        copy = container.add_stream_from_template(stream)
        shift = round(frames / stream.average_rate / stream.time_base)
        for packet in source.demux(stream):
            if packet.dts is not None:
                packet.pts, packet.dts, packet.stream = packet.pts - shift, packet.dts - shift, copy
                container.mux(packet)


class _Studio:
    """One scene, with all that does not change from frame to frame drawn once."""

    def __init__(self, scene: Scene, motion: Motion) -> None:
        self.scene, self.motion = scene, motion
        self.random = np.random.default_rng(scene.seed)
        self.rod = np.array(scene.rod)
        self.width, self.height = scene.size
        base, dark = np.array(PANEL), np.array((0.03, 0.03, 0.03))
        red, blue = np.array((0.03, 0.03, 0.45)), np.array((0.30, 0.10, 0.02))
        light, heavy = (dark, dark) if scene.alike else (red, blue)
        self.light_colour = base + scene.contrast * (light - base)
        self.heavy_colour = base + scene.contrast * (heavy - base)
        self.still = self._background()
        self.still_picture = _developed(self.still)
        width, height = scene.size if not scene.rotation % 180 else scene.size[::-1]
        self.stored_size = 2 * round(width / scene.aspect / 2), height
        margin = 32
        wider = float(max(1 / scene.aspect, 1))  # a picture that is stored wider than it is shown
        shape = (math.ceil(wider * self.height) + margin, math.ceil(wider * self.width) + margin)
        self.grain = [
            np.clip(self.random.normal(0, max(scene.noise, 1e-3), shape), -120, 120).astype(np.float32) for _ in range(4)
        ]

    def seen(self, position: Array) -> Array:
        """Return pixels of positions [m], shape (..., 2)."""
        position = np.asarray(position, dtype=float)
        if self.scene.project is not None:
            return self.rod + self.scene.project(position)
        a = math.radians(self.scene.tilt)
        x, y = position[..., 0], position[..., 1]
        right, up = math.cos(a) * x - math.sin(a) * y, math.sin(a) * x + math.cos(a) * y
        return self.rod + self.scene.scale * np.stack([right, -up], axis=-1)

    def masses(self, t: Array) -> tuple[Array, Array]:
        """Return positions [m] of both masses at times since the release [s], at rest before it."""
        return self.motion.at(np.clip(t, 0, self.motion.t[-1]))

    def rolled(self, t: Array) -> tuple[Array, Array]:
        """Return pixels of both masses where the row that shows each is read at its own time."""
        light, heavy = map(self.seen, self.masses(t))
        if self.scene.readout:
            for _ in range(3):
                own = [t + self.scene.readout * (p[:, 1] / self.height - 0.5) for p in (light, heavy)]
                light, heavy = self.seen(self.masses(own[0])[0]), self.seen(self.masses(own[1])[1])
        return light, heavy

    def film(self, path: Path) -> Truth:
        s = self.scene
        stored_rate = s.stated_rate or s.frame_rate
        tick = Fraction(1, 90000)
        count = round((s.before + s.duration) * s.frame_rate)
        shift = self.random.uniform(0.2, 0.8) / s.frame_rate
        rows: list[tuple[float, Array, Array, float]] = []
        delay = 0.0
        with av.open(str(path), "w") as container:
            container.metadata.update(s.metadata)
            stream = container.add_stream(s.codec, rate=Fraction(stored_rate).limit_denominator(1001))
            stream.width, stream.height = self.stored_size
            stream.pix_fmt = s.pixels
            stream.options = {"crf": str(s.crf), "preset": s.preset, "threads": "1"}
            if s.aspect != 1:
                stream.codec_context.sample_aspect_ratio = s.aspect
            if s.codec == "libx265":
                stream.options |= {"preset": "superfast", "x265-params": "pools=none:frame-threads=1:log-level=none"}
            if s.hdr:
                stream.codec_context.color_trc, stream.codec_context.color_primaries = HLG, BT2020
            stream.codec_context.time_base = stream.time_base = tick
            if s.rotation:
                stream.set_display_rotation(s.rotation)
            for i in range(count):
                unrest = s.jitter * self.random.uniform(-0.5, 0.5)
                # At the factors of the ramp a frame comes so much later
                late = np.interp(i / count, (0, 1 / 3, 2 / 3, 1), 1 / np.repeat(s.ramp, 2)) - 1
                delay += late
                t = (i + delay + unrest) / s.frame_rate - s.before + shift
                clock = (i + delay + unrest + 1) / stored_rate
                if i in s.lost:
                    continue
                picture, light, heavy = self._frame(t)
                frame = av.VideoFrame.from_ndarray(picture, format="yuv420p")
                if s.pixels != "yuv420p":
                    frame = frame.reformat(format=s.pixels)
                frame.pts, frame.time_base = round(clock / tick), tick
                container.mux(stream.encode(frame))
                rows.append((t, light, heavy, clock))
            container.mux(stream.encode())
        t, light, heavy, clock = (np.array(column) for column in zip(*rows, strict=True))
        return Truth(
            t=t, light=light, heavy=heavy, clock=clock,
            rod=self.seen(np.zeros(2)), scale=s.scale, motion=self.motion,
        )  # fmt: skip

    def _frame(self, t: float) -> tuple[NDArray[np.uint8], Array, Array]:
        """Return one picture as planes of yuv420p, and where the masses are in it."""
        s = self.scene
        light, heavy = (p[0] for p in self.rolled(np.array([t])))
        ends = self.rolled(t + np.array([-0.5, 0.5]) * s.exposure)
        travel = max(float(np.hypot(*(p[1] - p[0]))) for p in ends)
        instants = t + s.exposure * ((np.arange(n := int(np.clip(travel / 0.7, 3, 60))) + 0.5) / n - 0.5)
        lights, heavies = self.rolled(instants)
        reach = 0.06 * s.scale
        corners = np.vstack([lights, heavies, self.rod[None]])
        x0, y0 = np.maximum(np.floor(corners.min(axis=0) - reach), 0).astype(int)
        x1, y1 = np.minimum(np.ceil(corners.max(axis=0) + reach), s.size).astype(int)
        origin = np.array([x0, y0])
        canvas = self.still[y0:y1, x0:x1].copy()
        if s.shadow:
            aside = np.array([0.035, 0.028]) * s.scale - origin
            for places, size in ((lights, 1.3 * s.light_radius), (heavies, 1.2 * s.heavy_size[0])):
                for share in (1.25, 1.0, 0.75):
                    _blend(canvas, [_disc(p + aside, share * size * s.scale, 0.0) for p in places], np.full(3, 0.1), 0.13)
        self._strings(canvas, instants, lights, heavies, origin)
        half = np.array(s.heavy_size) * s.scale
        _blend(canvas, [_box(p - origin, half) for p in heavies], self.heavy_colour, 1.0)
        _blend(canvas, [_disc(p - origin, s.light_radius * s.scale, 0.35) for p in lights], self.light_colour, 1.0)
        picture = self.still_picture.copy()
        changed = cv2.absdiff(canvas, self.still[y0:y1, x0:x1]) > 1e-4
        changed = changed[..., 0] | changed[..., 1] | changed[..., 2]
        picture[y0:y1, x0:x1][changed] = _developed(canvas[changed])
        if s.covered is not None:
            self._covering_hand(picture, t)
        elif s.hand:
            self._hand(picture, t)
        for decoy in s.decoys:
            if (place := decoy.place(t)) is not None:
                fixed = tuple(round(16 * v) for v in place)
                cv2.circle(picture, fixed, round(16 * decoy.radius), (decoy.level,) * 3, -1, cv2.LINE_AA, 4)
        return self._sensor(picture, self._light(t)), light, heavy

    def _light(self, t: float) -> NDArray[np.float32] | None:
        """Return by how much light raises each of the camera's levels, shape (height, width); None: nowhere."""
        s = self.scene
        (change, start, lasting), (depth, frequency) = s.drift, s.flicker
        if not (change or depth or s.cloud):
            return None
        # The columns change smoothly: an eighth of them will do
        x, y = (np.arange(self.width // 8) + 0.5) * 8 / self.width, np.arange(self.height) / self.height
        row = t + s.readout * (y - 0.5)
        light = (1 + change * np.clip((row - start) / lasting, 0, 1)) / (1 + max(change, 0))
        # The mean of a cosine over the exposure
        mean = np.sinc(frequency * s.exposure)
        light *= 1 + depth * mean * np.cos(2 * math.pi * frequency * row + s.seed)
        beside = np.exp(-0.5 * ((x - 0.8 + 0.6 * t) / 0.2) ** 2)
        below = s.cloud * np.exp(-0.5 * ((y - 0.4 - 0.2 * t) / 0.3) ** 2)
        # A factor of linear light is one of the camera's levels, too, as its gamma is a power
        factor = (light[:, None] * (1 + np.outer(below, beside))) ** (1 / GAMMA)
        return cv2.resize(factor.astype(np.float32), self.scene.size)

    def _stored(self, picture: NDArray[Any]) -> NDArray[Any]:
        """Return a picture turned and squeezed as the sensor stores it."""
        turned = np.ascontiguousarray(np.rot90(picture, ROTATIONS[self.scene.rotation]))
        if self.scene.aspect == 1:
            return turned
        return cv2.resize(turned, self.stored_size, interpolation=cv2.INTER_AREA)

    def _sensor(self, picture: NDArray[np.uint8], light: NDArray[np.float32] | None) -> NDArray[np.uint8]:
        """Return the planes of a picture in some light, with noise, as the sensor stores it."""
        turns = ROTATIONS[self.scene.rotation]
        colours = cv2.cvtColor(self._stored(picture), cv2.COLOR_BGR2YCrCb)
        height, width = colours.shape[:2]
        # OpenCV's own planes have the colour of each upper left pixel alone; a camera's have the mean of four
        half = width // 2, height // 2
        halves = [cv2.resize(colours[..., k], half, interpolation=cv2.INTER_AREA) for k in (2, 1)]
        luma = np.asarray(colours[..., 0], np.float32)
        if light is not None:
            factor = self._stored(light)
            luma *= factor
            factor = cv2.resize(factor, half, interpolation=cv2.INTER_AREA)
            halves = [np.clip(128.5 + (plane - np.float32(128)) * factor, 0, 255).astype(np.uint8) for plane in halves]
        planes = np.concatenate([p.reshape(-1, width) for p in (colours[..., 0], *halves)])
        grain = self.grain[self.random.integers(len(self.grain))]
        grain = grain if turns % 2 == 0 else grain.T
        y, x = self.random.integers(0, 32, size=2)
        noisy = luma + grain[y : y + height, x : x + width]
        noisy += 0.5
        planes[:height] = np.clip(noisy, 0, 255, out=noisy)
        return planes

    def _strings(self, canvas: NDArray[np.float32], t: Array, lights: Array, heavies: Array, origin: Array) -> None:
        """Draw the string to the heavy mass, and the one from its tangent point on the rod to the light mass."""
        radius = self.motion.apparatus.rod_radius
        pick = np.unique(np.linspace(0, len(t) - 1, 4).astype(int))
        position = self.masses(t)[0]
        for k in pick:
            d = float(np.hypot(*position[k]))
            bearing = math.atan2(position[k, 1], position[k, 0]) - math.acos(min(radius / d, 1.0))
            leaves = self.seen(radius * np.array([math.cos(bearing), math.sin(bearing)]))
            hangs = self.seen(np.array([radius, 0.0]))
            for a, b in ((leaves, lights[k]), (hangs, heavies[k])):
                _line(canvas, a - origin, b - origin, 1.2e-3 * self.scene.scale, STRING_COLOUR, 1 / len(pick))

    def _hand(self, picture: NDArray[np.uint8], t: float) -> None:
        """Draw a hand that holds the light mass, and withdraws from the release on."""
        gone = max(t + 0.012, 0.0)
        away = 2.2 * gone if gone < 0.1 else 0.22 + 3 * (gone - 0.1)
        start = self.masses(np.zeros(1))[0][0]
        place = self.seen(start + np.array([-0.024, 0.004]) + away * np.array([-1.1, 0.25]))
        parts = (
            (-0.035, 0.0, 0.034),
            (-0.012, -0.012, 0.011),
            (-0.012, 0.016, 0.011),
            (-0.08, 0.012, 0.036),
            (-0.15, 0.02, 0.038),
        )
        colour = tuple(int(v) for v in _developed(np.array(SKIN, dtype=np.float32)))
        for dx, dy, r in parts:
            centre = np.round((place + np.array([dx, dy]) * self.scene.scale) * 16).astype(int)
            cv2.circle(picture, tuple(int(v) for v in centre), round(r * self.scene.scale * 16), colour, -1, cv2.LINE_AA, 4)

    def _covering_hand(self, picture: NDArray[np.uint8], t: float) -> None:
        """Draw an arm from below, whose fingers cover the light mass's way until `Scene.covered`, and which then draws back."""
        s = self.scene
        covered = s.covered or 0.0
        start, end = self.masses(np.array([0.0, covered]))[0]
        out = start / np.hypot(*start)
        along = end - start - 5e-3 * out
        along /= np.hypot(*along)
        across = np.array([-along[1], along[0]])
        gone = max(t - covered, 0.0)
        # So fast that the ball, which comes out at 0.5 to 1 m/s, is clear of the fingers a hundredth of a second later
        back = 1.2 * gone**2 / (gone + 5e-3) + 5 * gone**2
        if back > 1.0:
            return  # out of the picture; far beyond its edge OpenCV's lines and the lens' formula lead back into it
        arm = out + 0.45 * np.array([-out[1], out[0]])
        arm /= np.hypot(*arm)
        thumb = max(0.75 * s.light_radius, 8e-3)
        tip, knuckle = end + 0.5 * s.light_radius * along + back * arm, start - 0.03 * along + back * arm
        opened = thumb + min(0.3 * gone, 0.012)
        parts = [(knuckle + 0.02 * arm, knuckle + 0.6 * arm, 0.027)]
        parts += [(knuckle + side * 0.8 * opened * across, tip + side * opened * across, thumb) for side in (-1, 1)]
        for near, far, radius in parts:
            # Lighter along the middle: an arm is round
            for share, tone in ((1.0, 0.8), (0.8, 0.92), (0.5, 1.0)):
                colour = tuple(int(v) for v in _developed(np.array(SKIN, dtype=np.float32) * tone))
                ends = [tuple(int(v) for v in np.round(16 * self.seen(place))) for place in (near, far)]
                cv2.line(picture, *ends, colour, round(2 * share * radius * s.scale), cv2.LINE_AA, 4)

    def _background(self) -> NDArray[np.float32]:
        """Return the still picture in linear light, shape (height, width, 3)."""
        s, w, h = self.scene, self.width, self.height
        fine = cv2.GaussianBlur(self.random.standard_normal((h, w)).astype(np.float32), (0, 0), 2.5) * 0.10
        coarse = cv2.GaussianBlur(self.random.standard_normal((h, w)).astype(np.float32), (0, 0), 25) * 0.6
        picture = np.empty((h, w, 3), np.float32)
        picture[:] = PANEL
        picture *= (1 + 0.5 * (fine + coarse))[..., None]
        if s.posters:
            self._posters(picture)
        else:
            step = 0.05 * s.scale
            for k in range(-30, 40):
                x, y = self.rod[0] + k * step + 7, self.rod[1] + k * step + 11
                grey = (0.25, 0.27, 0.22) if k % 2 else (0.40, 0.42, 0.38)
                _line(picture, np.array([x, 0]), np.array([x + 3, h]), 1.2, grey, 1.0)
                _line(picture, np.array([0, y]), np.array([w, y - 2]), 1.2, grey, 1.0)
        if s.clutter:
            for _ in range(60):
                place, size = self.random.uniform(0, 1, 2) * (w, h), self.random.uniform(3, 14)
                _blend(picture, [_disc(place, size, 0.2)], self.random.uniform(0.05, 0.7, 3), 1.0)
        x, y = np.meshgrid(np.arange(w) / w - 0.5, np.arange(h) / h - 0.5)
        picture *= (1 + s.uneven_light * (x - 0.7 * y)).astype(np.float32)[..., None]
        if s.rod_side:
            self._rod_from_the_wall(picture)
            return picture
        post = int(self.rod[0] + 0.23 * s.scale)
        thick = 0.004 * s.scale
        cv2.rectangle(
            picture, (post, int(self.rod[1] - 0.02 * s.scale)), (int(post + 0.025 * s.scale), h), (0.12, 0.12, 0.13), -1
        )
        arm = (int(self.rod[0]), int(self.rod[1] - thick)), (post, int(self.rod[1] + thick))
        cv2.rectangle(picture, *arm, (0.18, 0.17, 0.16), -1)
        radius = self.motion.apparatus.rod_radius * s.scale
        _blend(picture, [_disc(self.rod, radius, 0.5)], np.array((0.20, 0.19, 0.18)), 1.0)
        return picture

    def _posters(self, picture: NDArray[np.float32]) -> None:
        """Draw the frame of a window, a skirting board, a sheet of text, and a dark poster with bright lines."""
        random = np.random.default_rng(self.scene.seed)
        size = np.array([self.width, self.height])
        picture *= 0.6

        def bar(corner: Array, extent: Array, grey: float) -> None:
            (x0, y0), (x1, y1) = (np.round(v * size).astype(int) for v in (corner, corner + extent))
            picture[max(y0, 0) : max(y1, 0), max(x0, 0) : max(x1, 0)] *= grey

        for x in random.uniform((0.02, 0.84), (0.1, 0.95)):
            bar(np.array([x, 0.0]), np.array([0.02, 1.0]), 0.35)
        bar(np.array([0.0, random.uniform(0.88, 0.95)]), np.array([1.0, 0.3]), 0.4)
        bar(np.array([0.0, random.uniform(0.02, 0.1)]), np.array([1.0, 0.012]), 0.5)
        for paper, ink, low, high in ((1.25, 0.25, (0.62, 0.55), (0.75, 0.65)), (0.3, 3.0, (0.02, 0.2), (0.3, 0.55))):
            corner, extent = random.uniform(low, high), random.uniform((0.12, 0.16), (0.2, 0.26))
            bar(corner, extent, paper)
            for line in np.linspace(0.12, 0.85, 7):
                bar(corner + (0.06, line) * extent, np.array([random.uniform(0.4, 0.88), 0.03]) * extent, ink)

    def _rod_from_the_wall(self, picture: NDArray[np.float32]) -> None:
        """Draw the rod's side between the wall and the rod's end, each seen from opposite the picture's middle."""
        place, middle = self.seen(np.zeros(2)), np.array([self.width, self.height]) / 2
        radius = self.motion.apparatus.rod_radius * self.scene.scale
        for depth in np.linspace(ROD_BEHIND, -ROD_BEFORE, 40):
            nearer = ROD_DISTANCE / (ROD_DISTANCE + depth)
            disc = _disc(middle + nearer * (place - middle), nearer * radius, 0.5)
            is_end = depth == -ROD_BEFORE
            _blend(picture, [disc], np.array((0.30, 0.42, 0.50) if is_end else (0.10, 0.14, 0.17)), 1.0)


_Shape = Callable[[NDArray[np.float32], NDArray[np.float32]], tuple[NDArray[np.float32], NDArray[np.float32]]]


def _disc(centre: Array, radius: float, shading: float) -> tuple[Array, Array, _Shape]:
    """Return centre, reach and coverage of a disc with a soft edge, darker towards the lower right."""

    def cover(u: NDArray[np.float32], v: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        return np.clip(radius + 0.5 - np.hypot(u, v), 0, 1), 1 - shading * (u + v) / (1.6 * radius)

    return centre, np.full(2, radius), cover


def _box(centre: Array, half: Array) -> tuple[Array, Array, _Shape]:
    """Return centre, reach and coverage of an upright cylinder seen from the side, darker towards the right."""

    def cover(u: NDArray[np.float32], v: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        inside = np.clip(half[0] + 0.5 - np.abs(u), 0, 1) * np.clip(half[1] + 0.5 - np.abs(v), 0, 1)
        return inside, 1 - 0.35 * u / half[0]

    return centre, half, cover


def _blend(canvas: NDArray[np.float32], shapes: list[tuple[Array, Array, _Shape]], colour: Array, opacity: float) -> None:
    """Average a body's coverage over the exposure, and lay it over the canvas."""
    low = np.min([c - r for c, r, _ in shapes], axis=0) - 2
    high = np.max([c + r for c, r, _ in shapes], axis=0) + 3
    x0, y0 = np.maximum(low, 0).astype(int)
    x1, y1 = np.minimum(high, canvas.shape[1::-1]).astype(int)
    if x1 <= x0 or y1 <= y0:
        return
    x, y = np.meshgrid(np.arange(x0, x1, dtype=np.float32), np.arange(y0, y1, dtype=np.float32))
    cover, lit = np.zeros_like(x), np.zeros_like(x)
    for centre, _, shape in shapes:
        inside, brightness = shape(x - np.float32(centre[0]), y - np.float32(centre[1]))
        cover += inside / len(shapes)
        lit += inside * np.clip(brightness, 0.2, 2) / len(shapes)
    part = canvas[y0:y1, x0:x1]
    part *= 1 - opacity * cover[..., None]
    part += opacity * lit[..., None] * np.asarray(colour, dtype=np.float32)


def _line(canvas: NDArray[np.float32], a: Array, b: Array, width: float, colour: tuple[float, ...], opacity: float) -> None:
    low, high = (np.minimum(a, b) - width - 4).astype(int), (np.maximum(a, b) + width + 5).astype(int)
    if np.any(low < 0) or np.any(high > canvas.shape[1::-1]):
        low, high = np.zeros(2, int), np.array(canvas.shape[1::-1])
    canvas = canvas[low[1] : high[1], low[0] : high[0]]
    mask = np.zeros(canvas.shape[:2], np.uint8)
    ends = [tuple(int(v) for v in np.round((p - low) * 16)) for p in (a, b)]
    cv2.line(mask, ends[0], ends[1], 255, max(1, round(width)), cv2.LINE_AA, 4)
    y, x = np.nonzero(mask)
    cover = (mask[y, x] / 255.0 * min(1, width) * opacity).astype(np.float32)[:, None]
    canvas[y, x] = canvas[y, x] * (1 - cover) + cover * np.asarray(colour, dtype=np.float32)


def _developed(linear: NDArray[np.float32]) -> NDArray[np.uint8]:
    return TO_CAMERA[np.clip(linear * LEVELS + 0.5, 0, LEVELS).astype(np.uint16)]
