"""Predict what is measured of a run: the camera's picture of it at the measured times, and the noise of tracked points.

The noise is sigma = a + b |v|, because a moving mass is blurred along its path.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from looping_pendulum.measured.camera import Camera
from looping_pendulum.measured.observations import Channel, DataError
from looping_pendulum.reference_ode.geometry import Array, xy_pairs
from looping_pendulum.reference_ode.parameters import Parameters
from looping_pendulum.reference_ode.sensitivity import COMPLEX_STEP, DifferentiatedRun, moves_with, run_with_derivatives
from looping_pendulum.reference_ode.solution import (
    Samples,
    heavy_mass_position,
    height_at_release,
    light_mass_position,
    string_overlap,
)
from looping_pendulum.reference_ode.state import Effects, State

# Of ten_to_one, two_to_one and static_friction: positions to their ends within 4e-9 m of those at 1e-13, derivatives by masses,
# lengths, angle, friction and drag within 3e-7 of the largest. At 1e-8 that were 3e-8 m and 4e-6, of runs a quarter shorter,
# and differences of runs, which fits take where no derivative exists, would be noisier
FIT_TOLERANCE = 1e-9
"""Relative tolerance of a step of the runs that are compared with tracked points, which are known to tenths of a millimetre."""
FIT_STEPS = 5_000
"""Number of steps in one mode after which a run of a fit fails: fits ask for ever stiffer strings, which take 200 000 steps and
differ from one that does not stretch by less than any film shows."""

PLACES = ("rod_radius", "free_length", "release_angle", "hanging_length", "heavy_swing", "string_thickness")
"""Parameters that say, beside the state, where the masses are."""
PLACING_ENTRIES = {"free_length", "wrap_angle", "slack", "heavy_tilt", "sideways"}
"""Entries of the state that say where the masses are."""
CLOCK = ("clock_offset", "clock_ratio", "readout")
"""Values of the camera that say when each point was measured."""

SampleFunction = Callable[[Array], Samples]
"""Function of ascending times since release [s], none negative, that returns the run at those times.

It may leave out times past the run's end.
"""


def predict(sample: SampleFunction, camera: Camera, channels: Sequence[Channel], *, dropped: str = "heavy") -> dict[str, Array]:
    """Return the values [SI] that ``camera`` measures in each channel of a run, at the channel's own times.

    Past the run's end they are those of its end.

    Parameters
    ----------
    sample
        The run. It is called once, with all times that any channel needs.
    dropped
        Mass that a channel "height" shows, "light" or "heavy". Height is measured from its release, plus origin_y.

    Raises
    ------
    DataError
        If a channel has points, but none of them during the run.
    """
    times = sample_times(camera.clock_offset, camera.clock_ratio, camera.readout, tuple(channels))
    samples = sample(times.times)
    known = len(samples.t)
    ends_early = known < len(times.times)
    if ends_early:
        # Not the last sample: within a frame of its end the light mass moves by centimetres
        samples = samples.and_end()
    series = _series(samples, camera, dropped, set(times.index))
    values = {}
    for name, index in times.index.items():
        # np.take is several times faster than indexing with an array
        values[name] = np.take(series[name], np.minimum(index, known) if ends_early else index)
        if ends_early and len(index) and np.min(index) >= known:
            raise DataError("found no point during the run, needed some; check the times and the clock offset")
        if name == "angle_rate":
            # before its release the mass is at rest, but the run's first sample may have the speed of a push
            values[name][: times.before_release[name]] = camera.rate_offset
    return values


def predict_many(samples: SampledRuns, camera: Camera, channels: Sequence[Channel], times: SampleTimes, dropped: str) -> Array:
    """Predict the same for many cameras by one clock, as one vector: shape (m, n), the channels end to end.

    Where `predict` would raise, a row is nan.

    Parameters
    ----------
    samples
        Run that each camera films, at ``times``; past a run's end its end.
    camera
        Many cameras, as `Camera.of_many` makes them.
    """
    series = _series(samples, camera, dropped, set(times.index))
    parts = []
    for channel in channels:
        index = times.index[channel.name]
        values = np.broadcast_to(series[channel.name], (len(samples.known), len(times.times))).take(index, axis=1)
        if len(index):
            values[samples.known <= index.min()] = np.nan  # no point during the run
        if channel.name == "angle_rate":
            values[:, : times.before_release[channel.name]] = camera.rate_offset
        parts.append(values)
    return np.concatenate(parts, axis=1)


def predict_with_derivatives(
    parameters: Parameters,
    camera: Camera,
    channels: tuple[Channel, ...],
    dropped: str,
    wrt: Sequence[str],
    camera_wrt: Sequence[str],
) -> tuple[Array, Array]:
    """Predict the same of one run, with derivatives by parameters of the model and by values of the camera.

    Returns
    -------
    The values, shape (n,), and their derivatives by ``wrt`` and then by ``camera_wrt``, shape (n, m); nan where none exists
    (`run_with_derivatives`).
    """
    times = sample_times(camera.clock_offset, camera.clock_ratio, camera.readout, channels)
    run = run_with_derivatives(
        parameters, times.times, wrt, duration=duration_of(times.times), tolerance=FIT_TOLERANCE, max_steps=FIT_STEPS
    )

    def measured(state: State, places: SimpleNamespace, camera: Camera) -> NDArray[Any]:
        count = np.broadcast_shapes(*map(np.shape, state))[0]
        samples = SampledRuns(state, run.runs.counts.repeat(count), places, run.effects)
        return predict_many(samples, camera, channels, times, dropped)

    rows = np.concatenate([times.index[c.name] for c in channels])
    entries = {"across_speed", *PLACING_ENTRIES} if "angle_rate" in times.index else PLACING_ENTRIES
    found = differentiate(measured, run, rows, entries, camera, camera_wrt)
    for name in CLOCK:
        if name in camera_wrt:
            found.derivatives[:, len(wrt) + camera_wrt.index(name)] += found.by_time * times.delays(name, channels)
    return found.values, found.derivatives


@dataclass(frozen=True, kw_only=True, eq=False)
class Differentiated:
    """What is measured in n samples of a run, and its derivatives."""

    run: DifferentiatedRun
    rows: NDArray[np.intp]
    """Samples, shape (n,)."""
    values: Array
    """Shape (n,)."""
    derivatives: Array
    """By the run's parameters ``wrt`` and then by values of the camera, at fixed time, shape (n, m)."""
    by_entry: Mapping[int, Array]
    """By entries of the state, shape (n,) each; by all others they are 0."""

    @property
    def by_time(self) -> Array:
        """By time, shape (n,)."""
        return np.asarray(sum(slope * self.run.rates[i][self.rows] for i, slope in self.by_entry.items()))


def differentiate(
    function: Callable[[State, SimpleNamespace, Camera], NDArray[Any]],
    run: DifferentiatedRun,
    rows: NDArray[np.intp],
    entries: Collection[str],
    camera: Camera,
    camera_wrt: Sequence[str],
) -> Differentiated:
    """Return what a function has for n samples of a run, and its derivatives, by complex steps in all that it depends on.

    Parameters
    ----------
    function
        Of the state, whose entries have the shape (m, all samples), or (all samples,) where it is real; of `PLACES`, numbers or
        of shape (m, 1); and of many cameras. It returns the values at ``rows``, shape (m, n).
    entries
        Entries of the state on which it depends.
    camera_wrt
        Values of the camera by which derivatives are wanted.
    """
    runs, wrt, values = run.runs, run.wrt, vars(run.parameters.values())
    moving = [
        i for i, name in enumerate(State._fields)
        if name in entries and (runs.samples[:, i].any() or runs.partials[:, i].any())
    ]  # fmt: skip
    places = [name for name in PLACES if name in wrt and moves_with(run.parameters, name, wrt)]
    count = len(moving) + len(places) + len(camera_wrt)
    steps = 1j * COMPLEX_STEP * np.eye(count)[:, :, None]
    of_state, of_places, of_camera = np.split(steps, np.cumsum([len(moving), len(places)]))
    state = list(runs.samples.T)
    for i, step in zip(moving, of_state, strict=True):
        state[i] = state[i] + step
    moved = {name: values[name] + step for name, step in zip(places, of_places, strict=True)}
    at = SimpleNamespace(**{name: values[name] for name in PLACES} | moved)
    found = function(State(*state), at, camera.stepped(camera_wrt, of_camera))
    slopes = found.imag / COMPLEX_STEP
    derivatives = np.zeros((len(rows), len(wrt) + len(camera_wrt)))
    for i, slope in zip(moving, slopes, strict=False):
        derivatives[:, : len(wrt)] += slope[:, None] * runs.partials[rows, i]
    for name, slope in zip(places, slopes[len(moving) :], strict=False):
        derivatives[:, wrt.index(name)] += slope
    derivatives[:, len(wrt) :] = slopes[len(moving) + len(places) :].T
    return Differentiated(
        run=run, rows=rows, values=found[0].real, derivatives=derivatives, by_entry=dict(zip(moving, slopes, strict=False))
    )


class SampledRuns:
    """Many runs at the same times: what `Samples` is of one run, for n of them."""

    def __init__(
        self, state: State, known: NDArray[np.integer[Any]], parameters: SimpleNamespace, effects: Effects = ()
    ) -> None:
        """Keep the samples.

        Parameters
        ----------
        state
            Entries of the state, shape (n, times), or (times,) where they are the same in all runs; they may be complex.
        known
            How many of the times lie within each run, shape (n,).
        parameters
            Parameters that the equations read, numbers or arrays of shape (n, 1).
        effects
            Effects that say where the masses are.
        """
        self.state, self.known, self._p, self._effects = state, known, parameters, effects

    @cached_property
    def light_position(self) -> Array:
        """Position of the light mass [m], shape (n, times, 2)."""
        overlap = string_overlap(self.state, self._effects)
        return xy_pairs(*light_mass_position(np, self.state, overlap, self._p, self._effects))

    @cached_property
    def heavy_position(self) -> Array:
        """Position of the heavy mass [m], shape (n, times, 2)."""
        overlap = string_overlap(self.state, self._effects)
        return xy_pairs(*heavy_mass_position(np, self.state, overlap, self._p, self._effects))

    def height_at_release(self, mass: str) -> Any:
        """Return the height of a mass at release, "light" or "heavy" [m], a number or shape (n, 1)."""
        return height_at_release(self._p, self._effects, mass)


@dataclass(frozen=True, kw_only=True, eq=False)
class SampleTimes:
    """Times at which a run is sampled for the points of all channels."""

    times: Array
    """True times since release [s], ascending, the first 0; points before the release have 0, as the masses are held there."""
    index: Mapping[str, NDArray[np.intp]]
    """Channel -> indices into `times` of its points, shape (n,)."""
    before_release: Mapping[str, int]
    """Channel -> number of its points before the release."""

    def delays(self, name: str, channels: tuple[Channel, ...]) -> Array:
        """Return the derivatives of the sample times of all points by a value of `CLOCK`, shape (n,); 0 up to the release."""
        by_channel = {
            c.name: 1.0 if name == "clock_offset" else c.t if name == "clock_ratio" else -_height(c, channels) for c in channels
        }
        return np.concatenate([np.where(self.index[c.name] > 0, by_channel[c.name], 0.0) for c in channels])


# A fit predicts the same channels thousands of times, mostly by the same clock
@lru_cache(maxsize=64)
def sample_times(clock_offset: float, clock_ratio: float, readout: float, channels: tuple[Channel, ...]) -> SampleTimes:
    """Return the times at which a run is sampled for the points of channels by a clock.

    With a rolling shutter, a point's own time follows from the height at which it was measured, which is known well enough.
    """
    camera = Camera(clock_offset=clock_offset, clock_ratio=clock_ratio)
    channel_times = {c.name: camera.true_time(c.t) - (readout * _height(c, channels) if readout else 0.0) for c in channels}
    # With 0, because heights are measured from the release
    times = np.unique(np.concatenate([np.maximum(t, 0.0) for t in channel_times.values()] + [np.zeros(1)]))
    return SampleTimes(
        times=times,
        index={name: np.searchsorted(times, np.maximum(t, 0.0)) for name, t in channel_times.items()},
        before_release={name: int(np.sum(t < 0)) for name, t in channel_times.items()},
    )


def duration_of(t: Array) -> float:
    """Return the time limit of a run that is sampled at ascending times: a millisecond more, lest it end before the last."""
    return float(t[-1]) + 1e-3


def _height(channel: Channel, channels: tuple[Channel, ...]) -> Array | float:
    """Return the measured height of the mass at the points of a channel [m], shape (n,); 0 where it was not measured."""
    mass = channel.name.partition("_")[0]
    beside = next((c for c in channels if c.name == f"{mass}_y"), None)
    return 0.0 if beside is None else np.asarray(np.interp(channel.t, beside.t, beside.value))


def _series(samples: Samples | SampledRuns, camera: Camera, dropped: str, names: set[str]) -> dict[str, Array]:
    """Return measured values of each channel at the sampled times."""
    series: dict[str, Array] = {}
    for mass, position in (("light", "light_position"), ("heavy", "heavy_position")):
        if f"{mass}_x" in names or f"{mass}_y" in names:
            shown = camera.project(getattr(samples, position))
            series[f"{mass}_x"], series[f"{mass}_y"] = shown[..., 0], shown[..., 1]
            if mass == "heavy":
                series["heavy_x"] = series["heavy_x"] + camera.heavy_offset_x
    if "angle" in names:
        series["angle"] = samples.state.wrap_angle - math.pi + camera.tilt
    if "angle_rate" in names:
        angle_rate = samples.state.across_speed / samples.state.free_length
        # The file's rates are per second of its own clock
        series["angle_rate"] = angle_rate * camera.clock_ratio + camera.rate_offset
    if "height" in names:
        path = samples.heavy_position if dropped == "heavy" else samples.light_position
        series["height"] = camera.scale * (path[..., 1] - samples.height_at_release(dropped)) + camera.origin_y
    return series
