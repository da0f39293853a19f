"""Checks of the data that an engine returns, whatever its physics: times, shapes, units, provenance."""

from __future__ import annotations

import math
import pickle

import numpy as np

from looping_pendulum.engines.conformance.apparatus import (
    LOSSLESS,
    LOSSLESS_DURATION,
    LOSSY,
    LOSSY_DURATION,
    lossless_run,
    lossy_run,
    requires,
    sample_times,
    scenario,
    uncached_run,
)
from looping_pendulum.engines.protocol import SAMPLE_INTERVAL, Engine
from looping_pendulum.engines.trajectory import RunStatus
from looping_pendulum.reference_ode.geometry import light_position

START_TOLERANCE = 1e-9
"""Largest error of the positions at release [m]; a chain's end node stands exactly where the light mass is held."""
COORDINATE_TOLERANCE = 1e-3
"""Largest distance between the light mass's position and the one computed from free length and wrap angle [m]."""


def can_be_pickled(engine: Engine) -> None:
    """An engine is sent to its process as a pickle, so a new one may hold no handle of its package."""
    original = getattr(engine, "engine", engine)  # a wrapper such as CachedEngine has the real engine inside
    unpickled = pickle.loads(pickle.dumps(original))
    assert (unpickled.name, unpickled.variant, unpickled.settings) == (
        engine.name,
        engine.variant,
        engine.settings,
    )


@requires(LOSSLESS)
def samples_every_millisecond_from_rest(engine: Engine) -> None:
    """Sample times are whole multiples of the sample interval to the end; the first sample is the release, at rest."""
    p, run = LOSSLESS, lossless_run(engine)
    assert run.status is RunStatus.FINISHED, f"the run: {run.status.value}"
    times = sample_times(LOSSLESS_DURATION)
    assert len(run.t) == len(times), f"{len(run.t)} samples of {LOSSLESS_DURATION} s, needed {len(times)}"
    assert np.allclose(run.t, times, rtol=0, atol=1e-12), "sample times"
    start = light_position(math, p.free_length, p.release_angle, p.rod_radius)
    assert np.allclose(run.light_position[0], start, rtol=0, atol=START_TOLERANCE), "light mass at release"
    assert np.allclose(run.heavy_position[0], (p.rod_radius, -p.hanging_length), rtol=0, atol=START_TOLERANCE), "heavy mass"
    assert not run.light_velocity[0].any(), "light mass not at rest"
    assert not run.heavy_velocity[0].any(), "heavy mass not at rest"
    arrays = (run.light_position, run.light_velocity, run.heavy_position, run.heavy_velocity, run.free_length, run.wrap_angle)
    assert all(len(a) == len(run.t) and np.isfinite(a).all() for a in arrays), "shapes or values"


@requires(LOSSLESS)
def velocity_is_the_rate_of_position(engine: Engine) -> None:
    """The velocities are the rate of change of the positions, within the error of a first-order step of a millisecond."""
    run = lossless_run(engine)
    for position, velocity in ((run.light_position, run.light_velocity), (run.heavy_position, run.heavy_velocity)):
        rate = np.diff(position, axis=0) / SAMPLE_INTERVAL
        mean_velocity = 0.5 * (velocity[1:] + velocity[:-1])
        error = float(np.abs(rate - mean_velocity).max())
        assert error < 2 * 9.81 * SAMPLE_INTERVAL, f"a velocity is {error:.3f} m/s off the rate of its position"


@requires(LOSSY, laws=False)
def free_length_and_wrap_angle_are_those_of_the_position(engine: Engine) -> None:
    """Free length and wrap angle are those of the light mass's position, and the wrap angle continues beyond a full turn."""
    p, run = LOSSY, lossy_run(engine)
    computed = np.column_stack(light_position(np, run.free_length, run.wrap_angle, p.rod_radius))
    error = float(np.abs(computed - run.light_position).max())
    assert error < COORDINATE_TOLERANCE, f"they place it {1e3 * error:.2f} mm from its position"
    assert abs(run.wrap_angle[0] - p.release_angle) < 1e-6, f"wrap angle at release {run.wrap_angle[0]:.4f} rad"
    jump = float(np.abs(np.diff(run.wrap_angle)).max())
    # A larger jump is a turn that was counted twice, or not at all
    assert jump < math.pi, f"the wrap angle jumps by {jump:.2f} rad from one sample to the next"


@requires(LOSSLESS)
def is_deterministic(engine: Engine) -> None:
    """Two runs of the same scenario give identical bytes."""
    first, second = (uncached_run(engine, scenario(LOSSLESS, 0.02)) for _ in range(2))
    for name in ("light_position", "heavy_position", "light_velocity", "heavy_velocity"):
        assert getattr(first, name).tobytes() == getattr(second, name).tobytes(), f"{name.replace('_', ' ')} differs"


@requires(LOSSLESS)
def provenance_is_complete(engine: Engine) -> None:
    """The trajectory states versions, settings, suppliers and the engine's names."""
    run = lossless_run(engine)
    assert run.provenance.versions, "no versions"
    assert run.provenance.settings, "no settings"
    assert all(s.how for s in vars(run.provenance.supplies).values()), "a supplier without a how"
    assert (run.engine, run.variant, run.profile) == (engine.name, engine.variant, engine.profile.value)


@requires(LOSSY, laws=False)
def runs_to_its_end(engine: Engine) -> None:
    """A run has samples for the scenario's whole duration, unless the light mass has reached the rod."""
    run = lossy_run(engine)
    assert run.status.ok, f"the run: {run.status.value}"
    if run.status is RunStatus.FINISHED:
        times = sample_times(LOSSY_DURATION)
        assert len(run.t) == len(times), f"{len(run.t)} samples of {LOSSY_DURATION} s, needed {len(times)}"
        assert np.allclose(run.t, times, rtol=0, atol=1e-12), "sample times"
    else:
        assert run.free_length[-1] < 2 * LOSSY.rod_radius, f"it ends with {run.free_length[-1]:.3f} m of free string"
