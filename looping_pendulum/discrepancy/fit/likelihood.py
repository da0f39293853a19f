"""How far the data let one fitted number go, all others refitted: its interval where a model is far from linear."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from looping_pendulum.discrepancy.fit.calibration import Fit, minimise
from looping_pendulum.discrepancy.fit.problem import Problem

THREE_ERRORS = 9.0
"""Rise of the cost at three standard errors of a linear model."""
FARTHEST = 12
"""Steps of one standard error that an interval is looked for."""


def rise(fit: Fit, name: str, value: float) -> float:
    """How much the cost rises where a number has ``value`` [SI]; the root counts standard errors.

    The others are refitted, step by step of about one standard error, so that each fit starts near its end.
    """
    best = fit.values[name]
    steps = max(1, math.ceil(abs(value - best) / fit.errors[name] - 1e-9))
    held = fit
    for here in np.linspace(best, value, steps + 1)[1:]:
        held = _held_at(fit, held, name, float(here))
    return held.cost - fit.cost


def interval(fit: Fit, name: str, most: float = THREE_ERRORS) -> tuple[float, float]:
    """Values [SI] between which the cost rises by at most ``most``, all others refitted.

    A side that rises less up to the number's bound, or within `FARTHEST` standard errors, ends there.
    """
    return _end(fit, name, -1, most), _end(fit, name, 1, most)


def _end(fit: Fit, name: str, side: int, most: float) -> float:
    low, high = fit.problem.numbers[fit.problem.names.index(name)].bounds
    held, here, before = fit, fit.values[name], 0.0
    for _ in range(FARTHEST):
        value = min(max(here + side * fit.errors[name], low), high)
        held = _held_at(fit, held, name, value)
        z = math.sqrt(max(held.cost - fit.cost, 0.0))
        if z >= math.sqrt(most):  # the root of the rise is nearly linear in the value
            return here + (value - here) * (math.sqrt(most) - before) / (z - before)
        if value in (low, high):
            return value
        here, before = value, z
    return here


def _held_at(fit: Fit, start: Fit, name: str, value: float) -> Fit:
    p = fit.problem
    numbers = [dataclasses.replace(n, bounds=(value, value)) if n.name == name else n for n in p.numbers]
    return minimise(Problem(p.study, p.data, numbers, (p.prior_mean, p.prior_weights)), start.x)
