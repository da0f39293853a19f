"""A rigid string as the limit of stiff ones, where the heavy mass turns at once and a single stiffness is not enough.

A string that stretches then needs a time of order 1/sqrt(k) to reverse its friction. With the loss time and the step kept a
fixed part of the string's period, the error is one power series in 1/sqrt(k); several stiffnesses cancel its first terms.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tests.blind import Apparatus, Effects
from tests.blind.simulator import Motion, Numerics, simulate

Array = NDArray[np.float64]

STIFFNESSES = (1e6, 4e6, 1.6e7)
"""Each four times the one before [N/m]: halves the error's first term."""
WEIGHTS = (1 / 3, -2.0, 8 / 3)
"""Cancel the terms in 1/sqrt(k) and 1/k."""


@dataclass(frozen=True)
class RigidMotion:
    """Motions with `STIFFNESSES`, and their limit."""

    motions: tuple[Motion, ...]

    @property
    def t(self) -> Array:
        """Times [s], up to the first end, shape (n,)."""
        return min((m.t for m in self.motions), key=lambda t: float(t[-1]))

    def at(self, t: Array) -> tuple[Array, Array]:
        """Positions (x, y) of the light and the heavy mass at times ``t`` [s]."""
        places = [m.at(t) for m in self.motions]
        light, heavy = (sum(w * p[mass] for w, p in zip(WEIGHTS, places, strict=True)) for mass in (0, 1))
        return np.asarray(light), np.asarray(heavy)


def simulate_rigid(apparatus: Apparatus, effects: Effects, *, duration: float, softer: float = 1.0) -> RigidMotion:
    """As `simulate`, for a rigid string; ``softer`` divides all stiffnesses."""
    motions = []
    for stiffness in (k / softer for k in STIFFNESSES):
        period = math.sqrt(1e6 / stiffness)
        numerics = Numerics(stiffness=stiffness, loss_time=2e-4 * period, step=5e-5 * period)
        motions.append(simulate(apparatus, effects, duration=duration, numerics=numerics))
    return RigidMotion(tuple(motions))
