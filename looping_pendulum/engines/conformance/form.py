"""Checks of what an engine hands back, whatever its physics: times, shapes, units, who supplied what."""

from __future__ import annotations

import math
import pickle

import numpy as np

from looping_pendulum.engines.conformance.apparatus import (
    ROUGH,
    ROUGH_DURATION,
    SMOOTH,
    SMOOTH_DURATION,
    fresh_run,
    needs,
    rough_run,
    sample_times,
    scenario,
    smooth_run,
)
from looping_pendulum.engines.protocol import SAMPLE_INTERVAL, Engine
from looping_pendulum.engines.trajectory import RunStatus
from looping_pendulum.reference_ode.geometry import light_position

START_TOLERANCE = 1e-9
"""[m] A chain's end node stands exactly where the light mass is held."""
COORDINATE_TOLERANCE = 1e-3
"""[m] By which free length and wrap angle may place the light mass elsewhere than where it is."""


def makes_nothing_heavy(engine: Engine) -> None:
    """An engine travels to its process as a pickle, so making one may hold no handle of its package."""
    original = getattr(engine, "engine", engine)  # of one that only wraps another
    again = pickle.loads(pickle.dumps(original))
    assert (again.name, again.variant, again.settings) == (engine.name, engine.variant, engine.settings)


@needs(SMOOTH)
def samples_every_millisecond_from_rest(engine: Engine) -> None:
    """Sample times are whole multiples of the sample interval to the end; the first sample is the release, at rest."""
    p, run = SMOOTH, smooth_run(engine)
    assert run.status is RunStatus.FINISHED, f"the run: {run.status.value}"
    times = sample_times(SMOOTH_DURATION)
    assert len(run.t) == len(times), f"{len(run.t)} samples of {SMOOTH_DURATION} s, needed {len(times)}"
    assert np.allclose(run.t, times, rtol=0, atol=1e-12), "sample times"
    start = light_position(math, p.free_length, p.release_angle, p.rod_radius)
    assert np.allclose(run.light_position[0], start, rtol=0, atol=START_TOLERANCE), "light mass at release"
    assert np.allclose(run.heavy_position[0], (p.rod_radius, -p.hanging_length), rtol=0, atol=START_TOLERANCE), "heavy mass"
    assert not run.light_velocity[0].any(), "light mass not at rest"
    assert not run.heavy_velocity[0].any(), "heavy mass not at rest"
    arrays = (run.light_position, run.light_velocity, run.heavy_position, run.heavy_velocity, run.free_length, run.wrap_angle)
    assert all(len(a) == len(run.t) and np.isfinite(a).all() for a in arrays), "shapes or values"


@needs(SMOOTH)
def velocity_is_the_rate_of_position(engine: Engine) -> None:
    """Velocities read back are those of the positions, within what a first-order step of a millisecond allows."""
    run = smooth_run(engine)
    for position, velocity in ((run.light_position, run.light_velocity), (run.heavy_position, run.heavy_velocity)):
        moved = np.diff(position, axis=0) / SAMPLE_INTERVAL
        middle = 0.5 * (velocity[1:] + velocity[:-1])
        off = float(np.abs(moved - middle).max())
        assert off < 2 * 9.81 * SAMPLE_INTERVAL, f"a velocity is {off:.3f} m/s off the rate of its position"


@needs(ROUGH, laws=False)
def free_length_and_wrap_angle_are_those_of_the_position(engine: Engine) -> None:
    """Free length and wrap angle place the light mass where it is, and turns are counted on beyond the first."""
    p, run = ROUGH, rough_run(engine)
    placed = np.column_stack(light_position(np, run.free_length, run.wrap_angle, p.rod_radius))
    off = float(np.abs(placed - run.light_position).max())
    assert off < COORDINATE_TOLERANCE, f"they place it {1e3 * off:.2f} mm from its position"
    assert abs(run.wrap_angle[0] - p.release_angle) < 1e-6, f"wrap angle at release {run.wrap_angle[0]:.4f} rad"
    jump = float(np.abs(np.diff(run.wrap_angle)).max())
    assert jump < math.pi, f"the wrap angle jumps by {jump:.2f} rad from one sample to the next"


@needs(SMOOTH)
def is_deterministic(engine: Engine) -> None:
    """The same input gives the same bytes."""
    first, second = (fresh_run(engine, scenario(SMOOTH, 0.02)) for _ in range(2))
    for name in ("light_position", "heavy_position", "light_velocity", "heavy_velocity"):
        assert getattr(first, name).tobytes() == getattr(second, name).tobytes(), f"{name.replace('_', ' ')} differs"


@needs(SMOOTH)
def says_who_supplies_what(engine: Engine) -> None:
    """Versions, settings and suppliers are all there."""
    run = smooth_run(engine)
    assert run.provenance.versions, "no versions"
    assert run.provenance.settings, "no settings"
    assert all(s.how for s in vars(run.provenance.supplies).values()), "a supplier without a how"
    assert (run.engine, run.variant, run.profile) == (engine.name, engine.variant, engine.profile.value)


@needs(ROUGH, laws=False)
def runs_to_its_end(engine: Engine) -> None:
    """A run has samples for the scenario's whole duration, unless the light mass is at the rod."""
    run = rough_run(engine)
    assert run.status.ok, f"the run: {run.status.value}"
    if run.status is RunStatus.FINISHED:
        times = sample_times(ROUGH_DURATION)
        assert len(run.t) == len(times), f"{len(run.t)} samples of {ROUGH_DURATION} s, needed {len(times)}"
        assert np.allclose(run.t, times, rtol=0, atol=1e-12), "sample times"
    else:
        assert run.free_length[-1] < 2 * ROUGH.rod_radius, f"it ends with {run.free_length[-1]:.3f} m of free string"
