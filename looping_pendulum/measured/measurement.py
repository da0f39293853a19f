"""Predict what is measured of a run: the camera's picture of it at the measured times."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from looping_pendulum.measured.camera import Camera
from looping_pendulum.measured.observations import Channel, DataError
from looping_pendulum.reference_ode.geometry import Array, xy_pairs
from looping_pendulum.reference_ode.parameters import Parameters
from looping_pendulum.reference_ode.sensitivity import COMPLEX_STEP, DifferentiatedRun, moves_with, run_with_derivatives
from looping_pendulum.reference_ode.solution import heavy_mass_position, height_at_release, light_mass_position, string_overlap
from looping_pendulum.reference_ode.solve import carried_out
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


def predict(parameters: Parameters, camera: Camera, channels: Sequence[Channel], *, dropped: str = "heavy") -> dict[str, Array]:
    """Return the values [SI] that ``camera`` measures in each channel of a run, at the channel's own times.

    Past the run's end they are those of its end.

    Parameters
    ----------
    dropped
        Mass that a channel "height" shows, "light" or "heavy". Height is measured from its release, plus origin_y.

    Raises
    ------
    HarnessError
        If the model cannot run.
    DataError
        If a channel has points, but none of them during the run.
    """
    times = sample_times(camera, channels)
    runs = carried_out(
        parameters, parameters.effects, times.times, times.duration, FIT_TOLERANCE, max_steps=FIT_STEPS
    )  # past its end the driver returns samples of the end
    run = SampledRun(State(*runs.samples.T), int(runs.counts[0]), parameters.values(), parameters.effects)
    return _measured(run, camera, channels, times, dropped)


def predict_with_derivatives(
    parameters: Parameters,
    camera: Camera,
    channels: Sequence[Channel],
    dropped: str,
    wrt: Sequence[str],
    camera_wrt: Sequence[str],
) -> tuple[Array, Array]:
    """Predict the same, with derivatives by parameters of the model and by values of the camera.

    Returns
    -------
    The values, shape (n,), and their derivatives by ``wrt`` and then by ``camera_wrt``, shape (n, m); nan where none exists
    (`run_with_derivatives`).
    """
    times = sample_times(camera, channels)
    run = run_with_derivatives(
        parameters, times.times, wrt, duration=times.duration, tolerance=FIT_TOLERANCE, max_steps=FIT_STEPS
    )
    known = int(run.runs.counts[0])

    def measured(state: State, p: SimpleNamespace, camera: Camera) -> Array:
        values = _measured(SampledRun(state, known, p, run.effects), camera, channels, times, dropped)
        return np.concatenate([*values.values()], axis=-1)

    rows = np.concatenate([times.index[c.name] for c in channels])
    entries = {"across_speed", *PLACING_ENTRIES} if "angle_rate" in times.index else PLACING_ENTRIES
    clock = [name for name in CLOCK if name in camera_wrt]
    values, derivatives, by_time = differentiate(measured, run, rows, entries, camera, camera_wrt, by_time_too=bool(clock))
    for name in clock:
        derivatives[:, len(wrt) + camera_wrt.index(name)] += by_time * times.delays(name, channels)
    return values, derivatives


def differentiate(
    function: Callable[[State, SimpleNamespace, Camera], Array],
    run: DifferentiatedRun,
    rows: NDArray[np.intp],
    entries: Collection[str],
    camera: Camera,
    camera_wrt: Sequence[str],
    *,
    by_time_too: bool = True,
) -> tuple[Array, Array, Array]:
    """Return what is measured in n samples of a run, and its derivatives, by complex steps in all that it depends on.

    Parameters
    ----------
    function
        Function of the state at all samples, of `PLACES`, and of the camera. It returns the values at the samples ``rows``,
        shape (n,). Entries of the state may have the shape (m, samples), and places (m, 1): then it returns the shape (m, n).
    entries
        Entries of the state on which it depends.
    camera_wrt
        Values of the camera by which derivatives are wanted.
    by_time_too
        Whether derivatives by time are wanted.

    Returns
    -------
    values
        Shape (n,).
    derivatives
        By the run's parameters ``wrt`` and then by those of the camera, at fixed time, shape (n, m).
    by_time
        Derivatives by time, shape (n,); 0 if they are not wanted.
    """
    wrt, partials = run.wrt, run.runs.partials
    state, p = State(*run.runs.samples.T), run.parameters.values()
    moving = [i for i, name in enumerate(State._fields) if name in entries and (state[i].any() or partials[:, i].any())]
    places = [name for name in PLACES if name in wrt and moves_with(run.parameters, name, wrt)]
    steps = 1j * COMPLEX_STEP * np.eye(len(moving) + len(places))[:, :, None]
    moved = state._replace(**{State._fields[i]: state[i] + step for i, step in zip(moving, steps, strict=False)})
    at = SimpleNamespace(**{name: getattr(p, name) for name in PLACES})
    for name, step in zip(places, steps[len(moving) :], strict=True):
        setattr(at, name, getattr(p, name) + step)
    # Times alone do not depend on the state, and so have no row for each step
    slopes = np.broadcast_to(function(moved, at, camera).imag / COMPLEX_STEP, (len(steps), len(rows)))
    derivatives, by_time = np.zeros((len(rows), len(wrt) + len(camera_wrt))), np.zeros(len(rows))
    for i, slope in zip(moving, slopes, strict=False):
        derivatives[:, : len(wrt)] += slope[:, None] * partials[rows, i]
        if by_time_too:
            by_time += slope * run.rates[i][rows]
    for name, slope in zip(places, slopes[len(moving) :], strict=True):
        derivatives[:, wrt.index(name)] += slope
    for i, name in enumerate(camera_wrt, start=len(wrt)):
        moved_camera = dataclasses.replace(camera, **{name: getattr(camera, name) + 1j * COMPLEX_STEP})
        derivatives[:, i] = function(state, p, moved_camera).imag / COMPLEX_STEP
    return function(state, p, camera), derivatives, by_time


class SampledRun(NamedTuple):
    """A run at n times, past its end at rest where it ended."""

    state: State
    """Entries of shape (n,), or (m, n) in m runs; maybe complex."""
    known: int
    """How many of the times lie within the run."""
    parameters: SimpleNamespace
    """Parameters as the equations read them, at least `PLACES`."""
    effects: Effects


def _measured(
    run: SampledRun, camera: Camera, channels: Sequence[Channel], times: SampleTimes, dropped: str
) -> dict[str, Array]:
    """Return the measured values of each channel, as `predict` has them."""
    series, values = _series(run, camera, dropped, times.index.keys()), {}
    for name, index in times.index.items():
        if len(index) and run.known <= index.min():
            raise DataError("found no point during the run, needed some; check the times and the clock offset")
        # np.take is several times faster than indexing with an array
        values[name] = np.take(series[name], index, axis=-1)
        if name == "angle_rate":
            # before its release the mass is at rest, but the run's first sample may have the speed of a push
            values[name][..., : times.before_release[name]] = camera.rate_offset
    return values


def _series(run: SampledRun, camera: Camera, dropped: str, names: Collection[str]) -> dict[str, Array]:
    """Return measured values of the channels ``names`` at the sampled times, before the release as at it."""
    state, p, effects = run.state, run.parameters, run.effects
    series: dict[str, Array] = {}

    def position(mass: str) -> Array:
        place = light_mass_position if mass == "light" else heavy_mass_position
        return xy_pairs(*place(np, state, string_overlap(state, effects), p, effects))

    for mass in ("light", "heavy"):
        if f"{mass}_x" in names or f"{mass}_y" in names:
            shown = camera.project(position(mass))
            series[f"{mass}_x"], series[f"{mass}_y"] = shown[..., 0], shown[..., 1]
            if mass == "heavy":
                series["heavy_x"] = series["heavy_x"] + camera.heavy_offset_x
    if "angle" in names:
        series["angle"] = state.wrap_angle - math.pi + camera.tilt
    if "angle_rate" in names:
        # The file's rates are per second of its own clock
        series["angle_rate"] = state.across_speed / state.free_length * camera.clock_ratio + camera.rate_offset
    if "height" in names:
        rise = position(dropped)[..., 1] - height_at_release(p, effects, dropped)
        series["height"] = camera.scale * rise + camera.origin_y
    return series


@dataclass(frozen=True, kw_only=True, eq=False)
class SampleTimes:
    """Times at which a run is sampled for the points of all channels."""

    times: Array
    """True times since release [s], ascending, the first 0; points before the release have 0, as the masses are held there."""
    index: Mapping[str, NDArray[np.intp]]
    """Channel -> indices into `times` of its points, shape (n,)."""
    before_release: Mapping[str, int]
    """Channel -> number of its points before the release."""

    @property
    def duration(self) -> float:
        """Time limit of a run that is sampled at these times [s]: a millisecond more, lest it end before the last."""
        return float(self.times[-1]) + 1e-3

    def delays(self, name: str, channels: Sequence[Channel]) -> Array:
        """Return the derivatives of the sample times of all points by a value of `CLOCK`, shape (n,); 0 up to the release."""
        by_channel = {
            c.name: 1.0 if name == "clock_offset" else c.t if name == "clock_ratio" else -_height(c, channels) for c in channels
        }
        return np.concatenate([np.where(self.index[c.name] > 0, by_channel[c.name], 0.0) for c in channels])


def sample_times(camera: Camera, channels: Sequence[Channel]) -> SampleTimes:
    """Return the times at which a run is sampled for the points of channels by the clock of a camera.

    With a rolling shutter, a point's own time follows from the height at which it was measured, which is known well enough.
    """
    return _sample_times(camera.clock_offset, camera.clock_ratio, camera.readout, tuple(channels))


# A fit predicts the same channels thousands of times, mostly by the same clock
@lru_cache(maxsize=64)
def _sample_times(clock_offset: float, clock_ratio: float, readout: float, channels: tuple[Channel, ...]) -> SampleTimes:
    camera = Camera(clock_offset=clock_offset, clock_ratio=clock_ratio)
    channel_times = {c.name: camera.true_time(c.t) - (readout * _height(c, channels) if readout else 0.0) for c in channels}
    # With 0, because heights are measured from the release
    times = np.unique(np.concatenate([np.maximum(t, 0.0) for t in channel_times.values()] + [np.zeros(1)]))
    return SampleTimes(
        times=times,
        index={name: np.searchsorted(times, np.maximum(t, 0.0)) for name, t in channel_times.items()},
        before_release={name: int(np.sum(t < 0)) for name, t in channel_times.items()},
    )


def _height(channel: Channel, channels: Sequence[Channel]) -> Array | float:
    """Return the measured height of the mass at the points of a channel [m], shape (n,); 0 where it was not measured."""
    mass = channel.name.partition("_")[0]
    beside = next((c for c in channels if c.name == f"{mass}_y"), None)
    return 0.0 if beside is None else np.asarray(np.interp(channel.t, beside.t, beside.value))
