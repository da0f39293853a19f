"""Angular velocities of a held pendulum without angles beside them: where the swing begins, and which way the axis points."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from looping_pendulum.measured.observations import Observations, UnusedValues, mirrored

MAX_RATE_AT_REST = 0.05
"""Largest angular velocity of a pendulum that a hand holds still, as a part of the largest one of the record."""
MIN_REST = 0.25
"""Shortest rest before a release, in periods of a small swing: at a turning point it is as slow for a fiftieth of one."""


def rates_from_release(observations: Observations, small_swing_period: float, release_angle: float | None) -> Observations:
    """Return rates that stand alone from their first motion on, in the direction of a release at the stated angle.

    The sign of a gyroscope's axis is arbitrary, and a record may begin while the pendulum is still held. All other observations
    are returned as they are.

    Parameters
    ----------
    small_swing_period
        Period of a small swing [s].
    release_angle
        Wrap angle of the release [rad]; None: it is not stated, and the direction is left as it is.
    """
    if [c.name for c in observations.channels] != ["angle_rate"]:
        return observations
    (rates,) = observations.channels
    speed = np.abs(rates.value)
    first = int(np.argmax(speed > MAX_RATE_AT_REST * speed.max()))
    if rates.t[first] - rates.t[0] >= MIN_REST * small_swing_period:
        at_rest = UnusedValues(count=first, reason="angle_rate: at rest, before the release")
        rates = dataclasses.replace(rates, t=rates.t[first:], value=rates.value[first:])
        observations = dataclasses.replace(observations, channels=(rates,), unused=(*observations.unused, at_rest))
    first_swing = rates.value[np.argmax(np.abs(rates.value) > speed.max() / 2)]
    return mirrored(observations) if release_angle is not None and first_swing * math.sin(release_angle) < 0 else observations
