"""A camera and its operator: marks with noise, blur and gaps, a badly calibrated scale or clock, and Tracker's export.

A camera that looks at the motion from an angle, or whose lens distorts, is one in space, which sees points along rays.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tests.blind.rigid import RigidMotion
from tests.blind.simulator import Motion

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Camera:
    """What happens between the masses and the table of marks. The errors' defaults are null."""

    frame_rate: float = 240.0
    """True frames per second."""
    noise: float = 1e-3
    """Standard deviation of a mark of a mass at rest, each axis [m]."""
    blur: float = 2e-4
    """Growth of that with speed [s]."""
    missing: float = 0.02
    """Probability that a mark is missing."""
    bursts: int = 2
    """Runs of 3 to 8 missing marks in a row, per mass."""
    origin: tuple[float, float] = (0.0, 0.0)
    """Where the operator put the origin, from the rod's centre [m]."""
    scale: float = 1.0
    """Stated over true lengths."""
    tilt: float = 0.0
    """Angle by which the operator's axes are turned [rad]."""
    clock_offset: float = 0.0
    """Stated less true time [s]."""
    frame_rate_ratio: float = 1.0
    """True over stated frame rate: stated times are that much longer."""
    distance: float = 3.0
    """From the camera to the rod [m]; it does not matter unless one of the values below departs from its null value."""
    sideways: float = 0.0
    """Angle by which the camera stands to the right of the rod's axis, and looks at the rod from there [rad]."""
    above: float = 0.0
    """Angle by which it stands above the rod [rad]."""
    aside: tuple[float, float] = (0.0, 0.0)
    """Where the optical axis meets the plane of motion: right of the rod and above it [m]."""
    lens: float = 0.0
    """Radial distortion: relative growth of the picture's radius with the square of the tangent of the angle to the axis."""
    pixel_aspect: float = 0.0
    """Width over height of a pixel, less 1, in a recording that the operator's program shows with square ones."""
    rule_behind: float = 0.0
    """Distance of the operator's rule behind the plane of motion [m]."""


@dataclass(frozen=True, kw_only=True)
class Clip:
    """A table of marks; NaN where one is missing."""

    t: Array
    """Stated times [s], shape (n,)."""
    light: Array
    """Stated positions [m], shape (n, 2)."""
    heavy: Array


def film(motion: Motion | RigidMotion, camera: Camera, rng: np.random.Generator, *, duration: float = 1.0) -> Clip:
    """Film from the release on, for ``duration`` [s] or until the motion ends."""
    frames = int(np.floor(min(duration, motion.t[-1]) * camera.frame_rate + 1e-9)) + 1
    t = np.arange(frames) / camera.frame_rate
    pinhole = Pinhole(camera) if Pinhole.is_needed(camera) else None
    places = motion.at(t)
    instant = 0.5e-4
    before, after = motion.at(np.maximum(t - instant, 0)), motion.at(np.minimum(t + instant, motion.t[-1]))
    marks = []
    for place, earlier, later in zip(places, before, after, strict=True):
        speed = np.linalg.norm(later - earlier, axis=1) / (2 * instant)
        sigma = camera.noise + camera.blur * speed
        in_picture = place if pinhole is None else pinhole.stated(place)
        seen = _stated(in_picture, camera) + sigma[:, None] * rng.standard_normal((frames, 2))
        seen[_gaps(frames, camera, rng)] = np.nan
        marks.append(seen)
    return Clip(t=t * camera.frame_rate_ratio + camera.clock_offset, light=marks[0], heavy=marks[1])


class Pinhole:
    """A camera in space, and an operator who puts a rule on its picture. The rod's end is the origin, z towards the camera."""

    FOCAL_LENGTH = 1500.0
    """[pixels]"""
    RULE = 0.5
    """Length of the rule, which stands upright with its middle at the rod [m]."""

    def __init__(self, camera: Camera) -> None:
        s, a = camera.sideways, camera.above
        towards = np.array([np.sin(s) * np.cos(a), np.sin(a), np.cos(s) * np.cos(a)])
        aim = np.array([*camera.aside, 0.0])
        self.lens, self.pixel_aspect = camera.lens, camera.pixel_aspect
        self.place = aim + camera.distance * towards
        right = np.cross([0.0, 1.0, 0.0], towards)
        right /= np.linalg.norm(right)
        self.axes = np.stack([right, np.cross(towards, right), -towards])
        """Rows: right in the picture, up in it, and the direction of view."""
        ends = self.pixels(np.array([[0.0, y, -camera.rule_behind] for y in (-self.RULE / 2, self.RULE / 2)]))
        self.metres_per_pixel = self.RULE / float(np.linalg.norm(ends[1] - ends[0]))
        self.rod = self.pixels(np.zeros((1, 3)))

    @staticmethod
    def is_needed(camera: Camera) -> bool:
        """Whether the picture is other than that of a camera far away with a perfect lens."""
        return any((camera.sideways, camera.above, camera.lens, camera.pixel_aspect, camera.rule_behind))

    def pixels(self, points: Array) -> Array:
        """Pixels, from the middle of the picture, of points in space, shape (n, 3)."""
        right, up, depth = self.axes @ (points - self.place).T
        tangent = np.hypot(right, up) / depth
        radius = self.FOCAL_LENGTH * tangent * (1 + self.lens * tangent**2)
        bearing = np.arctan2(up, right)
        return np.stack([radius * np.cos(bearing) * (1 + self.pixel_aspect), radius * np.sin(bearing)], axis=1)

    def stated(self, place: Array) -> Array:
        """Positions that the operator's program states for places in the plane of motion [m], shape (n, 2)."""
        in_space = np.column_stack([place, np.zeros(len(place))])
        return np.asarray(self.metres_per_pixel * (self.pixels(in_space) - self.rod))


def _stated(place: Array, camera: Camera) -> Array:
    cosine, sine = np.cos(camera.tilt), np.sin(camera.tilt)
    turned = (place - np.array(camera.origin)) @ np.array([[cosine, -sine], [sine, cosine]])
    return np.asarray(camera.scale * turned)


def _gaps(frames: int, camera: Camera, rng: np.random.Generator) -> NDArray[np.bool_]:
    gone = rng.random(frames) < camera.missing
    for _ in range(camera.bursts):
        start = int(rng.integers(1, frames))
        gone[start : start + int(rng.integers(3, 9))] = True
    return gone


def tracker_csv(clip: Clip, *, delimiter: str = ",", multi: bool = True, names: tuple[str, str] = ("mass A", "mass B")) -> str:
    """Write a clip as Tracker exports it; "mass A" is the light mass."""
    gap = delimiter
    lines = [f"#multi:{gap}"] if multi else []
    lines.append(f"{gap}{names[0]}{gap}{gap}{names[1]}{gap}{gap}")
    lines.append(gap.join(["t", "x", "y", "x", "y", ""]))
    for t, light, heavy in zip(clip.t, clip.light, clip.heavy, strict=True):
        lines.append(gap.join([*(exponent_notation(v) for v in (t, *light, *heavy)), ""]))
    return "\n".join(lines) + "\n"


def exponent_notation(value: float) -> str:
    """Tracker's way to write a number, 12.45987 as 1.245987E1; a missing one is empty."""
    if np.isnan(value):
        return ""
    mantissa, exponent = f"{value:.6E}".split("E")
    return f"{mantissa}E{int(exponent)}"
