"""Predict what is measured of a run: the camera's picture of it at the measured times, and the noise of tracked points.

The noise is sigma = a + b |v|, because a moving mass is blurred along its path.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from looping_pendulum.discrepancy.data.camera import Camera
from looping_pendulum.discrepancy.data.noise import Noise, estimate_noise, speed_at
from looping_pendulum.discrepancy.data.observations import Channel, DataError
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import Parameters
from looping_pendulum.reference_ode.sensitivity import Sensitivities
from looping_pendulum.reference_ode.solution import Samples
from looping_pendulum.reference_ode.solve import solve_at

__all__ = [
    "Noise",
    "Prediction",
    "SampleFunction",
    "estimate_noise",
    "predict",
    "sampler",
    "speed_at",
]

# Runs of ten_to_one and two_to_one agree with those of `solve.TOLERANCE` within 1e-11 m, and `identify` takes a sixth less time
FIT_TOLERANCE = 1e-9
"""Relative tolerance of a step of the runs that are compared with tracked points, which are known to tenths of a millimetre."""

SampleFunction = Callable[[Array], Samples]
"""Function of ascending times since release [s], none negative, that returns the run at those times.

It may leave out times past the run's end.
"""


@dataclass(frozen=True, kw_only=True, eq=False)
class Prediction:
    """Values that the camera would have measured in a run."""

    values: Mapping[str, Array]
    """Channel -> predicted values [SI] at its measured times, shape (n,); past the run's end, those of its end."""
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

    Raises
    ------
    DataError
        If a channel has points, but none of them during the run.
    """
    sample_times = _sample_times(camera.clock_offset, camera.clock_ratio, tuple(channels))
    samples = sample(sample_times.times)
    known = len(samples.t)
    ends_early = known < len(sample_times.times)
    if ends_early:
        # Not the last sample: within a frame of its end the light mass moves by centimetres
        samples = samples.and_end()
    series = _series(samples, camera, dropped, set(sample_times.index))
    values, after = {}, {}
    for name, index in sample_times.index.items():
        # np.take is several times faster than indexing with an array
        values[name] = np.take(series[name], np.minimum(index, known) if ends_early else index)
        after[name] = int(np.count_nonzero(index >= known)) if ends_early else 0
        if after[name] and after[name] == len(index):
            raise DataError("found no point during the run, needed some; check the times and the clock offset")
        if name == "angle_rate":
            # before its release the mass is at rest, but the run's first sample may have the speed of a push
            values[name][: sample_times.before_release[name]] = camera.rate_offset
    return Prediction(values=values, after_end=after, before_release=sample_times.before_release)


DIFFERENTIABLE_CHANNELS = frozenset({"light_x", "light_y", "heavy_x", "heavy_y", "angle", "angle_rate"})
"""Channels whose derivatives `predicted_derivatives` returns."""


def predicted_derivatives(
    solved: Callable[[Array], Sensitivities], camera: Camera, channels: Sequence[Channel]
) -> Mapping[str, Array]:
    """Return derivatives of the values that ``camera`` measures in each channel, by m parameters of the run, shape (n, m).

    Parameters
    ----------
    solved
        Function that returns the run's derivatives at given times, as from `solve_sensitivities`. Past its end everything is
        at rest where it ended.
    channels
        Channels of `DIFFERENTIABLE_CHANNELS`.
    """
    sample_times = _sample_times(camera.clock_offset, camera.clock_ratio, tuple(channels))
    s = solved(sample_times.times)
    known = len(s.samples.t)
    if known < len(sample_times.times):
        s = s.and_end()
    series: dict[str, Array] = {}
    for mass, derivatives in (("light", s.light_position), ("heavy", s.heavy_position)):
        if f"{mass}_x" in sample_times.index or f"{mass}_y" in sample_times.index:
            position = getattr(s.samples, f"{mass}_position")[:, np.newaxis]
            measured = camera.project_displacement(position, derivatives.transpose(0, 2, 1))
            series[f"{mass}_x"], series[f"{mass}_y"] = measured[..., 0], measured[..., 1]
    if "angle" in sample_times.index:
        series["angle"] = s.state.wrap_angle.T
    if "angle_rate" in sample_times.index:
        run = s.samples.state
        change = s.state.across_speed - run.across_speed / run.free_length * s.state.free_length
        series["angle_rate"] = (change / run.free_length).T * camera.clock_ratio
    found = {name: series[name][np.minimum(index, known)] for name, index in sample_times.index.items()}
    if "angle_rate" in found:
        found["angle_rate"][: sample_times.before_release["angle_rate"]] = 0.0  # as in `predict`
    return found


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
        # The file's rates are per second of its own clock
        series["angle_rate"] = angle_rate * camera.clock_ratio + camera.rate_offset
    if "height" in names:
        path = samples.heavy_position if dropped == "heavy" else samples.light_position
        series["height"] = camera.scale * (path[:, 1] - path[0, 1]) + camera.origin_y
    return series
