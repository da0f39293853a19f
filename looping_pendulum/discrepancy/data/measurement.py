"""What the camera does, apart from physics: where its origin is, its scale, tilt and clock, and how much its marks scatter.

A point at (x, y) at the true time t is measured at the time t_m with t = clock_offset + clock_ratio t_m, and seen at
scale Rot(tilt) (x, y) + (origin_x, origin_y). Marks scatter by sigma = a + b |v|: a moving mass is a smear along its path.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from looping_pendulum.discrepancy.data.noise import Noise, estimate_noise, speed_at
from looping_pendulum.discrepancy.data.observations import Channel, DataError
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import Parameters
from looping_pendulum.reference_ode.sensitivity import Sensitivities
from looping_pendulum.reference_ode.solution import Samples
from looping_pendulum.reference_ode.solve import solve_at

__all__ = [
    "CAMERA",
    "Camera",
    "CameraParameter",
    "Noise",
    "Prediction",
    "SampleFunction",
    "estimate_noise",
    "predict",
    "sampler",
    "speed_at",
]

SampleFunction = Callable[[Array], Samples]
"""Ascending times since release [s], none negative -> the run at those times; times past its end may be left out."""


@dataclass(frozen=True, kw_only=True)
class CameraParameter:
    """One number of the camera."""

    name: str
    unit: str
    """SI unit; '' for a pure number."""
    null: float
    """Value of a perfect camera."""
    bounds: tuple[float, float]
    sigma: float
    """How far off it usually is: standard error of a careful set-up, for a prior."""
    meaning: str


CAMERA = MappingProxyType(
    {
        p.name: p
        for p in (
            CameraParameter(
                name="origin_x", unit="m", null=0.0, bounds=(-2e3, 2e3), sigma=5e-3, meaning="where the rod's centre is seen, x"
            ),
            CameraParameter(
                name="origin_y", unit="m", null=0.0, bounds=(-2e3, 2e3), sigma=5e-3, meaning="where the rod's centre is seen, y"
            ),
            CameraParameter(
                name="scale", unit="", null=1.0, bounds=(0.2, 5.0), sigma=0.005, meaning="seen length per true length"
            ),
            CameraParameter(
                name="tilt",
                unit="rad",
                null=0.0,
                bounds=(-math.pi, math.pi),
                sigma=math.radians(0.5),
                meaning="angle by which the picture is turned, counterclockwise",
            ),
            CameraParameter(
                name="clock_offset",
                unit="s",
                null=0.0,
                bounds=(-60.0, 60.0),
                sigma=4e-3,
                meaning="true time since release at which the file's clock is 0",
            ),
            CameraParameter(
                name="clock_ratio", unit="", null=1.0, bounds=(0.01, 100.0), sigma=0.002, meaning="true time per measured time"
            ),
        )
    }
)
"""What a camera may get wrong, by name."""


@dataclass(frozen=True, kw_only=True)
class Camera:
    """One trial's camera; the default is a perfect one."""

    origin_x: float = 0.0
    """[m]"""
    origin_y: float = 0.0
    """[m]"""
    scale: float = 1.0
    tilt: float = 0.0
    """[rad]"""
    clock_offset: float = 0.0
    """[s]"""
    clock_ratio: float = 1.0

    def __post_init__(self) -> None:
        """Refuse what no camera does."""
        for name, p in CAMERA.items():
            low, high = p.bounds
            if not low <= getattr(self, name) <= high:
                raise DataError(f"camera {name}: found {getattr(self, name):g}, needed between {low:g} and {high:g}")

    def true_time(self, t: Array) -> Array:
        """Time since release [s] of the file's times ``t`` [s]."""
        return self.clock_offset + self.clock_ratio * t

    def seen(self, position: Array) -> Array:
        """Where a true position [m], shape (n, 2), is seen [m]."""
        return np.asarray(self.seen_shift(position) + [self.origin_x, self.origin_y])

    def seen_shift(self, shift: Array) -> Array:
        """What a true shift of a position [m], shape (n, 2), looks like [m]."""
        cosine, sine = math.cos(self.tilt), math.sin(self.tilt)
        return np.asarray(self.scale * (shift @ np.array([[cosine, sine], [-sine, cosine]])))

    def unseen(self, seen: Array) -> Array:
        """Undo `seen`: true position [m] of a seen one, shape (n, 2)."""
        cosine, sine = math.cos(self.tilt), math.sin(self.tilt)
        turned = (seen - [self.origin_x, self.origin_y]) / self.scale
        return np.asarray(turned @ np.array([[cosine, -sine], [sine, cosine]]))


@dataclass(frozen=True, kw_only=True, eq=False)
class Prediction:
    """What the camera would have measured of a run."""

    values: Mapping[str, Array]
    """Channel -> predicted values [SI] at its measured times, shape (n,); NaN past the run's end."""
    after_end: Mapping[str, int]
    """Channel -> how many measured points lie past the run's end."""
    before_release: Mapping[str, int]
    """Channel -> how many lie before the release, where the masses are at rest."""


def sampler(parameters: Parameters) -> SampleFunction:
    """Return the reference run of ``parameters`` as a function of time."""
    return lambda t: solve_at(parameters, t, duration=float(t[-1]) + 1e-3)


def predict(sample: SampleFunction, camera: Camera, channels: Sequence[Channel], *, dropped: str = "heavy") -> Prediction:
    """Predict what ``camera`` measures of a run in each channel, at the channel's own times.

    Parameters
    ----------
    sample
        The run, as from `sampler`; asked once, at all times that any channel needs.
    dropped
        Which mass a channel "height" sees, "light" or "heavy"; its height counts from its release, plus origin_y.
    """
    moments = _moments(camera.clock_offset, camera.clock_ratio, tuple(channels))
    samples = sample(moments.times)
    series = _series(samples, camera, dropped, set(moments.index))
    values, after = {}, {}
    for name, index in moments.index.items():
        known = series[name]
        beyond = len(moments.times) - len(known)
        # np.take is several times faster than fancy indexing
        values[name] = np.take(np.append(known, np.full(beyond, np.nan)) if beyond else known, index)
        after[name] = int(np.count_nonzero(index >= len(known))) if beyond else 0
        if name == "angle_rate":
            values[name][: moments.before_release[name]] = 0.0
    return Prediction(values=values, after_end=after, before_release=moments.before_release)


DIFFERENTIABLE = frozenset({"light_x", "light_y", "heavy_x", "heavy_y", "angle"})
"""Channels of which `differential` knows the derivatives."""


def differential(solved: Callable[[Array], Sensitivities], camera: Camera, channels: Sequence[Channel]) -> Mapping[str, Array]:
    """Derivatives of what ``camera`` measures in each channel, by the numbers of the run: shape (marks, m).

    Parameters
    ----------
    solved
        The run's derivatives at given times, as from `solve_sensitivities`; past its end everything rests.
    channels
        Of `DIFFERENTIABLE`.
    """
    moments = _moments(camera.clock_offset, camera.clock_ratio, tuple(channels))
    s = solved(moments.times)
    known = len(s.samples.t)
    series: dict[str, Array] = {}
    for mass, places in (("light", s.light_position), ("heavy", s.heavy_position)):
        if f"{mass}_x" in moments.index or f"{mass}_y" in moments.index:
            seen = camera.seen_shift(places.transpose(0, 2, 1))
            series[f"{mass}_x"], series[f"{mass}_y"] = seen[..., 0], seen[..., 1]
    if "angle" in moments.index:
        series["angle"] = s.state.wrap_angle.T
    return {name: series[name][np.minimum(index, known - 1)] for name, index in moments.index.items()}


@dataclass(frozen=True, kw_only=True, eq=False)
class _Moments:
    """When marks were made, by one clock."""

    times: Array
    """All true times since release [s], ascending, the first 0: before its release a mass is held where it starts."""
    index: Mapping[str, NDArray[np.intp]]
    """Channel -> which of the times its marks have, shape (n,)."""
    before_release: Mapping[str, int]
    """Channel -> how many of its marks lie before the release."""


@lru_cache(maxsize=64)
def _moments(clock_offset: float, clock_ratio: float, channels: tuple[Channel, ...]) -> _Moments:
    camera = Camera(clock_offset=clock_offset, clock_ratio=clock_ratio)
    wanted = {c.name: camera.true_time(c.t) for c in channels}
    times = np.unique(np.concatenate([np.maximum(t, 0.0) for t in wanted.values()] + [np.zeros(1)]))
    return _Moments(
        times=times,
        index={name: np.searchsorted(times, np.maximum(t, 0.0)) for name, t in wanted.items()},
        before_release={name: int(np.sum(t < 0)) for name, t in wanted.items()},
    )


def _series(samples: Samples, camera: Camera, dropped: str, names: set[str]) -> dict[str, Array]:
    """Seen values of each channel at the sampled times."""
    series: dict[str, Array] = {}
    for mass, position in (("light", "light_position"), ("heavy", "heavy_position")):
        if f"{mass}_x" in names or f"{mass}_y" in names:
            series[f"{mass}_x"], series[f"{mass}_y"] = camera.seen(getattr(samples, position)).T
    if "angle" in names:
        series["angle"] = samples.state.wrap_angle - math.pi + camera.tilt
    if "angle_rate" in names:
        turning = samples.state.across_speed / samples.state.free_length
        series["angle_rate"] = turning * camera.clock_ratio  # the file divides by its own seconds
    if "height" in names:
        path = samples.heavy_position if dropped == "heavy" else samples.light_position
        series["height"] = camera.scale * (path[:, 1] - path[0, 1]) + camera.origin_y
    return series
