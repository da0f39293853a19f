"""What a run of the core has in common with the same run by another integrator."""

import numpy as np

from looping_pendulum.reference_ode.transitions import Event

DISTANCE, TIME = 1e-9, 1e-10
"""Largest difference of a position [m] and of an event's time [s]."""


def assert_same_run(ours, other, *, distance=DISTANCE, time=TIME):
    """Two runs have the same events, at the same times, and in between the same modes, signs and positions."""
    # A string that hangs straight has a speed of rounding across it, the larger the shorter it is: how often its sign
    # changes means nothing
    hangs = max(np.ptp(samples.light_position[:, 0]) for samples in (ours, other)) < distance
    events, others = (
        [e for e in samples.run.events if not (hangs and e.event is Event.ACROSS_REVERSES)] for samples in (ours, other)
    )
    assert [(e.event, e.mode_after) for e in events] == [(e.event, e.mode_after) for e in others]
    times, other_times = (np.array([float(e.time) for e in listed]) for listed in (events, others))
    assert np.abs(times - other_times).max() <= time
    # One more sample where the end lies just on its other side
    assert abs(len(ours.t) - len(other.t)) <= 1
    n = min(len(ours.t), len(other.t))
    between = np.abs(ours.t[:n, None] - times).min(axis=1) > 2 * time
    for name in ("mode", *ours.signs._fields):
        if not (hangs and name == "across"):
            mine, theirs = (s.mode if name == "mode" else getattr(s.signs, name) for s in (ours, other))
            assert np.array_equal(mine[:n][between], theirs[:n][between]), name
    for place in ("light_position", "heavy_position"):
        apart = np.abs(getattr(ours, place)[:n] - getattr(other, place)[:n])
        assert apart.max(initial=0.0) <= distance, place
