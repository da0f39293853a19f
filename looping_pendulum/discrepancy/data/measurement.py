"""Model of the camera, apart from the physics: origin, scale, tilt and clock of its picture, and the noise of tracked points.

A point at (x, y) at the true time t is measured at the time t_m with t = clock_offset + clock_ratio t_m, at the position
scale Rot(tilt) (x, y) + (origin_x, origin_y). Its noise is sigma = a + b |v|, because a moving mass is blurred along its path.
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
from looping_pendulum.reference_ode.effects import Coefficient
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import Parameters
from looping_pendulum.reference_ode.sensitivity import Sensitivities
from looping_pendulum.reference_ode.solution import Samples
from looping_pendulum.reference_ode.solve import solve_at

__all__ = [
    "CAMERA",
    "CAMERA_ERRORS",
    "Camera",
    "Noise",
    "Prediction",
    "SampleFunction",
    "estimate_noise",
    "predict",
    "sampler",
    "speed_at",
]

SampleFunction = Callable[[Array], Samples]
"""Function of ascending times since release [s], none negative, that returns the run at those times.

It may leave out times past the run's end.
"""


def _coefficient(name: str, unit: str, null: float, bounds: tuple[float, float], meaning: str) -> Coefficient:
    return Coefficient(name=name, unit=unit, default=null, null=null, bounds=bounds, meaning=meaning)


CAMERA = MappingProxyType(
    {
        c.name: c
        for c in (
            _coefficient("origin_x", "m", 0.0, (-2e3, 2e3), "x at which the rod's centre is measured"),
            _coefficient("origin_y", "m", 0.0, (-2e3, 2e3), "y at which the rod's centre is measured"),
            _coefficient("scale", "", 1.0, (0.2, 5.0), "measured length per true length"),
            _coefficient("tilt", "rad", 0.0, (-math.pi, math.pi), "angle by which the picture is turned, counterclockwise"),
            _coefficient("clock_offset", "s", 0.0, (-60.0, 60.0), "true time since release at which the file's clock is 0"),
            _coefficient("clock_ratio", "", 1.0, (0.01, 100.0), "true time per measured time"),
        )
    }
)
"""Coefficients of the camera model, by name; the null values are those of a perfect camera."""
CAMERA_ERRORS = MappingProxyType(
    {
        "origin_x": 5e-3,
        "origin_y": 5e-3,
        "scale": 0.005,
        "tilt": math.radians(0.5),
        "clock_offset": 4e-3,
        "clock_ratio": 0.002,
    }
)
"""Coefficient of the camera model -> its standard error in a careful set-up [SI], used as its prior."""


@dataclass(frozen=True, kw_only=True)
class Camera:
    """Camera of one trial; the default is a perfect one."""

    origin_x: float = CAMERA["origin_x"].null
    """[m]"""
    origin_y: float = CAMERA["origin_y"].null
    """[m]"""
    scale: float = CAMERA["scale"].null
    tilt: float = CAMERA["tilt"].null
    """[rad]"""
    clock_offset: float = CAMERA["clock_offset"].null
    """[s]"""
    clock_ratio: float = CAMERA["clock_ratio"].null

    def __post_init__(self) -> None:
        """Refuse values out of their bounds."""
        for name, c in CAMERA.items():
            low, high = c.bounds
            if not low <= getattr(self, name) <= high:
                raise DataError(f"camera {name}: found {getattr(self, name):g}, needed between {low:g} and {high:g}")

    def true_time(self, t: Array) -> Array:
        """Return the times since release [s] of the file's times ``t`` [s]."""
        return self.clock_offset + self.clock_ratio * t

    def project(self, position: Array) -> Array:
        """Return measured positions [m] of true ones [m], shape (n, 2)."""
        return np.asarray(self.project_displacement(position) + [self.origin_x, self.origin_y])

    def project_displacement(self, displacement: Array) -> Array:
        """Return measured displacements [m] of true ones [m], shape (n, 2)."""
        cosine, sine = math.cos(self.tilt), math.sin(self.tilt)
        # Positions are rows, so the matrix stands on the right and is transposed
        return np.asarray(self.scale * (displacement @ np.array([[cosine, sine], [-sine, cosine]])))

    def unproject(self, measured: Array) -> Array:
        """Return true positions [m] of measured ones [m], shape (n, 2): the inverse of `project`."""
        cosine, sine = math.cos(self.tilt), math.sin(self.tilt)
        rotated = (measured - [self.origin_x, self.origin_y]) / self.scale
        return np.asarray(rotated @ np.array([[cosine, -sine], [sine, cosine]]))


@dataclass(frozen=True, kw_only=True, eq=False)
class Prediction:
    """Values that the camera would have measured in a run."""

    values: Mapping[str, Array]
    """Channel -> predicted values [SI] at its measured times, shape (n,); NaN past the run's end."""
    after_end: Mapping[str, int]
    """Channel -> number of measured points past the run's end."""
    before_release: Mapping[str, int]
    """Channel -> number of measured points before the release, when the masses are at rest."""


def sampler(parameters: Parameters) -> SampleFunction:
    """Return the reference run of ``parameters`` as a function of time."""
    return lambda t: solve_at(parameters, t, duration=float(t[-1]) + 1e-3)


def predict(sample: SampleFunction, camera: Camera, channels: Sequence[Channel], *, dropped: str = "heavy") -> Prediction:
    """Predict the values that ``camera`` measures in each channel of a run, at the channel's own times.

    Parameters
    ----------
    sample
        The run, as from `sampler`. It is called once, with all times that any channel needs.
    dropped
        Mass that a channel "height" shows, "light" or "heavy". Height is measured from its release, plus origin_y.
    """
    sample_times = _sample_times(camera.clock_offset, camera.clock_ratio, tuple(channels))
    samples = sample(sample_times.times)
    series = _series(samples, camera, dropped, set(sample_times.index))
    values, after = {}, {}
    for name, index in sample_times.index.items():
        known = series[name]
        beyond = len(sample_times.times) - len(known)
        # np.take is several times faster than indexing with an array
        values[name] = np.take(np.append(known, np.full(beyond, np.nan)) if beyond else known, index)
        after[name] = int(np.count_nonzero(index >= len(known))) if beyond else 0
        if name == "angle_rate":
            # before its release the mass is at rest, but the run's first sample may have the speed of a push
            values[name][: sample_times.before_release[name]] = 0.0
    return Prediction(values=values, after_end=after, before_release=sample_times.before_release)


DIFFERENTIABLE_CHANNELS = frozenset({"light_x", "light_y", "heavy_x", "heavy_y", "angle"})
"""Channels whose derivatives `predicted_derivatives` returns."""


def predicted_derivatives(
    solved: Callable[[Array], Sensitivities], camera: Camera, channels: Sequence[Channel]
) -> Mapping[str, Array]:
    """Return derivatives of the values that ``camera`` measures in each channel, by m parameters of the run, shape (n, m).

    Parameters
    ----------
    solved
        Function that returns the run's derivatives at given times, as from `solve_sensitivities`. Past its end everything is
        at rest.
    channels
        Channels of `DIFFERENTIABLE_CHANNELS`.
    """
    sample_times = _sample_times(camera.clock_offset, camera.clock_ratio, tuple(channels))
    s = solved(sample_times.times)
    known = len(s.samples.t)
    series: dict[str, Array] = {}
    for mass, position in (("light", s.light_position), ("heavy", s.heavy_position)):
        if f"{mass}_x" in sample_times.index or f"{mass}_y" in sample_times.index:
            measured = camera.project_displacement(position.transpose(0, 2, 1))
            series[f"{mass}_x"], series[f"{mass}_y"] = measured[..., 0], measured[..., 1]
    if "angle" in sample_times.index:
        series["angle"] = s.state.wrap_angle.T
    return {name: series[name][np.minimum(index, known - 1)] for name, index in sample_times.index.items()}


@dataclass(frozen=True, kw_only=True, eq=False)
class _SampleTimes:
    """Times at which a run is sampled for the points of all channels."""

    times: Array
    """True times since release [s], ascending, the first 0; points before the release have 0, as the masses are held there."""
    index: Mapping[str, NDArray[np.intp]]
    """Channel -> indices into `times` of its points, shape (n,)."""
    before_release: Mapping[str, int]
    """Channel -> number of its points before the release."""


# A fit predicts the same channels thousands of times, mostly by the same clock
@lru_cache(maxsize=64)
def _sample_times(clock_offset: float, clock_ratio: float, channels: tuple[Channel, ...]) -> _SampleTimes:
    camera = Camera(clock_offset=clock_offset, clock_ratio=clock_ratio)
    channel_times = {c.name: camera.true_time(c.t) for c in channels}
    # With 0, because heights are measured from the release
    times = np.unique(np.concatenate([np.maximum(t, 0.0) for t in channel_times.values()] + [np.zeros(1)]))
    return _SampleTimes(
        times=times,
        index={name: np.searchsorted(times, np.maximum(t, 0.0)) for name, t in channel_times.items()},
        before_release={name: int(np.sum(t < 0)) for name, t in channel_times.items()},
    )


def _series(samples: Samples, camera: Camera, dropped: str, names: set[str]) -> dict[str, Array]:
    """Return measured values of each channel at the sampled times."""
    series: dict[str, Array] = {}
    for mass, position in (("light", "light_position"), ("heavy", "heavy_position")):
        if f"{mass}_x" in names or f"{mass}_y" in names:
            series[f"{mass}_x"], series[f"{mass}_y"] = camera.project(getattr(samples, position)).T
    if "angle" in names:
        series["angle"] = samples.state.wrap_angle - math.pi + camera.tilt
    if "angle_rate" in names:
        angle_rate = samples.state.across_speed / samples.state.free_length
        series["angle_rate"] = angle_rate * camera.clock_ratio  # the file's rates are per second of its own clock
    if "height" in names:
        path = samples.heavy_position if dropped == "heavy" else samples.light_position
        series["height"] = camera.scale * (path[:, 1] - path[0, 1]) + camera.origin_y
    return series
