"""A law that no library lists, as radial basis functions of time or of the state, that was fitted to the trajectories.

It may be a force on a mass or a change of the friction of the string on the rod. While the string slides, a force on the heavy
mass and one along the light mass's string move everything alike, so a force as a function of *time* cannot name its body; as a
function of the *state* it can, and the ranking says which of both the data prefer.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from looping_pendulum.discrepancy.fit.calibration import Fit
from looping_pendulum.discrepancy.fit.held_out import HeldOutTest
from looping_pendulum.discrepancy.unlisted.closures import Closure
from looping_pendulum.measured.free_parameter import FreeParameter
from looping_pendulum.reference_ode.effects.closure import N_BASIS_FUNCTIONS
from looping_pendulum.reference_ode.geometry import Array

POINT_SCALE = 0.01
"""Unit of a point's coordinates in a fit [m]."""
MAX_SHIFT = 0.3
"""Largest distance of a fitted point from where the linear model has it, in each direction [m]."""
WEAK_PRIOR = 1e6
"""Prior standard deviation, in scales of a parameter, that leaves it to the data."""


@dataclass(frozen=True, kw_only=True, eq=False)
class RecoveredForce:
    """A closure that was fitted to the training trials and tested on held-out data."""

    closure: Closure
    fit: Fit
    """Its weights are the last of the free parameters."""
    log_bayes_factor: float
    """Log of the factor by which it makes the data of all trials more probable."""
    coordinates: Array
    """Values of the coordinate along the training trials, where it matters, shape (n,)."""
    held_out: HeldOutTest

    @cached_property
    def weights(self) -> Array:
        """Weights of all sides [N], shape (sides, N_BASIS_FUNCTIONS)."""
        values = self.fit.values
        return np.array([values[n] for n in self.closure.names]).reshape(-1, N_BASIS_FUNCTIONS)

    def covariance(self, side: int) -> Array:
        """Return the covariance of a side's weights [N^2], shape (N_BASIS_FUNCTIONS, N_BASIS_FUNCTIONS)."""
        problem = self.fit.problem
        index = [problem.names.index(n) for n in self.closure.names[side * N_BASIS_FUNCTIONS : (side + 1) * N_BASIS_FUNCTIONS]]
        scale = np.array([problem.free_parameters[i].scale for i in index])
        return np.asarray(self.fit.covariance[np.ix_(index, index)] * np.outer(scale, scale))

    def standard_error(self, side: int, s: Array) -> Array:
        """Return the standard error of a side's profile at coordinates ``s``, shape of ``s``."""
        basis = self.closure.basis_functions(s)
        variance = np.einsum("ij,jk,ik->i", basis, self.covariance(side), basis)
        return np.asarray(np.sqrt(np.maximum(variance, 0.0)))  # rounding can leave a variance slightly negative


def point_parameters(closure: Closure, trials: tuple[str, ...], prior: float = WEAK_PRIOR) -> list[FreeParameter]:
    """Return x and y of the point from which a closure's distance is measured as free parameters; empty without one.

    Their standard deviation is ``prior`` times `POINT_SCALE`.
    """
    return [
        FreeParameter(
            name=name, parameter=name, trials=trials, init_value=value, scale=POINT_SCALE, prior=prior,
            bounds=(value - MAX_SHIFT, value + MAX_SHIFT),
        )
        for name, value in closure.point_coefficients.items()
    ]  # fmt: skip


def weight_parameters(closure: Closure, trials: tuple[str, ...], scale: float) -> list[FreeParameter]:
    """Return a closure's weights as free parameters, of standard deviation ``scale``."""
    return [
        FreeParameter(name=n, parameter=n, trials=trials, init_value=0.0, scale=scale, prior=1.0, bounds=(-1e6, 1e6))
        for n in closure.names
    ]
