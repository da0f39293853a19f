"""What a run of the core has in common with the same run by another integrator."""

import numpy as np

DISTANCE, TIME = 1e-9, 1e-10
"""Largest difference of a position [m] and of an event's time [s]."""


def assert_same_run(ours, other, *, distance=DISTANCE, time=TIME):
    """Two runs have the same events, at the same times, and in between the same modes, signs and positions."""
    assert [e.event for e in ours.run.events] == [e.event for e in other.run.events]
    assert [e.mode_after for e in ours.run.events] == [e.mode_after for e in other.run.events]
    times = [np.array([float(e.time) for e in samples.run.events]) for samples in (ours, other)]
    assert np.abs(times[0] - times[1]).max() <= time
    # One more sample where the end lies just on its other side
    assert abs(len(ours.t) - len(other.t)) <= 1
    n = min(len(ours.t), len(other.t))
    between = np.abs(ours.t[:n, None] - times[0]).min(axis=1) > 2 * time
    for mine, theirs in zip((ours.mode, *ours.signs), (other.mode, *other.signs), strict=True):
        assert np.array_equal(mine[:n][between], theirs[:n][between])
    for place in ("light_position", "heavy_position"):
        apart = np.abs(getattr(ours, place)[:n] - getattr(other, place)[:n])
        assert apart.max(initial=0.0) <= distance
