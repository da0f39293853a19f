"""Size of the constant friction loss that replaces the capstan law in one MuJoCo variant."""

from __future__ import annotations

from enum import StrEnum

import numpy as np

from looping_pendulum.reference_ode.parameters import Parameters, Release
from looping_pendulum.reference_ode.solve import DURATION, solve

SAMPLES = 2000
"""Number of samples of the reference's run."""
ZERO_FRICTION_RATIO = 1e-12
"""Ratio of friction to the light mass's tension that counts as zero.

Without friction the two tensions are equal, and their difference is only rounding.
"""


class FrictionSize(StrEnum):
    """Which friction of the reference's run the constant is set to."""

    EQUAL_WORK = "mean over the way that the string slides"
    AT_HALT = "last value before the halt"
    AT_RELEASE = "first value"


def friction_loss(parameters: Parameters, size: FrictionSize) -> float:
    """Return the friction |T2 - T1| of the sliding string [N] as one number, from the reference's run of ``parameters``.

    Where the reference never halts, `FrictionSize.AT_HALT` is the last value while the string slides. Where it never slides,
    the constant is the largest that holds it. It has no static friction of its own, so the reference takes the kinetic one.
    """
    if parameters.release in (Release.HELD, Release.DROP):
        return 0.0
    run = solve(parameters.replace(static_friction=parameters.coefficients["kinetic_friction"]), duration=DURATION)
    until = run.end_time if run.halting_time is None else run.halting_time
    samples = run.sample(np.linspace(0.0, until, SAMPLES))
    light, heavy = samples.tensions
    speed = np.abs(samples.state.heavy_speed)
    sliding = (speed > 0) & (light > 0)  # in the reference, speed or tension is exactly 0 while the string sticks or is slack
    if not sliding.any():
        return float(np.abs(heavy - light).max())
    friction, speed = np.abs(heavy - light)[sliding], speed[sliding]
    if np.all(friction <= ZERO_FRICTION_RATIO * light[sliding]):
        return 0.0
    if size is FrictionSize.EQUAL_WORK:
        return float(friction @ speed / speed.sum())
    return float(friction[-1] if size is FrictionSize.AT_HALT else friction[0])
