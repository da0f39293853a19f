"""How large a constant friction loss is made that shall stand for the capstan law."""

from __future__ import annotations

from enum import StrEnum

import numpy as np

from looping_pendulum.reference_ode.parameters import Parameters, Release
from looping_pendulum.reference_ode.solve import DURATION, solve

SAMPLES = 2000
"""Samples of the reference's run."""
ROUNDING = 1e-12
"""Friction over the light mass's tension that is none: on a slippery rod it is the difference of two equal tensions."""


class FrictionSize(StrEnum):
    """What the constant is made equal to, in the reference's run."""

    EQUAL_WORK = "mean over the way that the string slides"
    AT_HALT = "last value before the halt"
    AT_RELEASE = "first value"


def friction_loss(parameters: Parameters, size: FrictionSize) -> float:
    """Friction |T2 - T1| of the string that slides over the rod [N], reduced to one number of the reference's own run.

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
    sliding = (speed > 0) & (light > 0)  # the reference gives a string that sticks, or is slack, exactly 0
    if not sliding.any():
        return float(np.abs(heavy - light).max())
    friction, speed = np.abs(heavy - light)[sliding], speed[sliding]
    if np.all(friction <= ROUNDING * light[sliding]):
        return 0.0
    if size is FrictionSize.EQUAL_WORK:
        return float(friction @ speed / speed.sum())
    return float(friction[-1] if size is FrictionSize.AT_HALT else friction[0])
