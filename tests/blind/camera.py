"""A camera and its operator: marks with noise, blur and gaps, a badly calibrated scale or clock, and Tracker's export."""

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
    places = motion.at(t)
    instant = 0.5e-4
    before, after = motion.at(np.maximum(t - instant, 0)), motion.at(np.minimum(t + instant, motion.t[-1]))
    marks = []
    for place, earlier, later in zip(places, before, after, strict=True):
        speed = np.linalg.norm(later - earlier, axis=1) / (2 * instant)
        sigma = camera.noise + camera.blur * speed
        seen = _stated(place, camera) + sigma[:, None] * rng.standard_normal((frames, 2))
        seen[_gaps(frames, camera, rng)] = np.nan
        marks.append(seen)
    return Clip(t=t * camera.frame_rate_ratio + camera.clock_offset, light=marks[0], heavy=marks[1])


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
