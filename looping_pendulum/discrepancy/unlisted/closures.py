"""Closures: what an unknown law may be a function of and where it may act, and which of them is simpler."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np

from looping_pendulum.discrepancy.result import STRING_ON_ROD
from looping_pendulum.measured.study import Estimate, Study
from looping_pendulum.reference_ode.effects.closure import COORDINATES, FACTORS, N_BASIS_FUNCTIONS, weight_name
from looping_pendulum.reference_ode.geometry import Array

STRING = STRING_ON_ROD
"""Target of a law of the string: a change of its coefficient of friction."""
TARGETS: dict[str, tuple[str, ...]] = {
    "light mass, along the string": ("along",),
    "light mass, across the string": ("across",),
    "light mass": ("along", "across"),
    "light mass, to the right": ("gradient",),
    "light mass, upward": ("gradient",),
    "light mass, away from a point": ("gradient",),
    "heavy mass": ("heavy",),
    STRING: ("friction",),
}
"""Where an unknown law may act -> sides of the closure in `reference_ode.effects.closure`."""
_OF_LIGHT_MASS = ("time", "free_length", "wrap_angle", "retreat_speed", "across_speed")
COORDINATES_OF: dict[str, tuple[str, ...]] = {
    "light mass, along the string": _OF_LIGHT_MASS,
    "light mass, across the string": _OF_LIGHT_MASS,
    "light mass": _OF_LIGHT_MASS,
    "light mass, to the right": ("horizontal_position",),
    "light mass, upward": ("height",),
    "light mass, away from a point": ("distance",),
    "heavy mass": ("time", "retreat_speed", "hanging_length"),
    STRING: ("wrap_angle", "slip_speed", "normal_load"),
}
"""Target -> coordinates of which a law there is searched for: time, and the place and speeds of what it acts on."""
assert {c for names in COORDINATES_OF.values() for c in names} <= set(COORDINATES)


@dataclass(frozen=True, kw_only=True)
class Closure:
    """A sum of radial basis functions of one coordinate, times a factor, as an unknown force or change of friction."""

    coordinate: str
    """Name of the coordinate, of `COORDINATES`."""
    factor: str
    """Name of the factor, of `FACTORS`."""
    target: str
    """Where it acts, of `TARGETS`."""
    first_centre: float
    """Coordinate of the first basis function's centre."""
    spacing: float
    """Distance of neighbouring centres, which is also each basis function's width, in units of the coordinate."""
    point: tuple[float, float] | None = None
    """Point (x, y) from which the coordinate "distance" is measured [m]; None for the other coordinates."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the weights, side by side."""
        return tuple(weight_name(side, i) for side in TARGETS[self.target] for i in range(N_BASIS_FUNCTIONS))

    @property
    def centres(self) -> Array:
        """Coordinates of the centres, shape (N_BASIS_FUNCTIONS,)."""
        return np.asarray(self.first_centre + self.spacing * np.arange(N_BASIS_FUNCTIONS), dtype=np.float64)

    @property
    def coefficients(self) -> dict[str, float]:
        """Coefficients of the effect beside its weights: which coordinate, factor and point, and where the centres are."""
        return {
            f"closure_of_{self.coordinate}": 1.0,
            f"closure_by_{self.factor}": 1.0,
            "closure_scale": 1 / self.spacing,
            "closure_start": self.first_centre / self.spacing,
            **self.point_coefficients,
        }

    @property
    def point_coefficients(self) -> dict[str, float]:
        """Coefficients that say where the point is; empty without one."""
        return dict(zip(("closure_point_x", "closure_point_y"), self.point, strict=True)) if self.point else {}

    def added_to(self, study: Study) -> Study:
        """Return ``study`` with this closure among its effects, its weights still zero."""
        fixed = {n: Estimate(value=v) for n, v in self.coefficients.items()}
        return dataclasses.replace(study, effects={**study.effects, **fixed})

    def basis_functions(self, s: Array) -> Array:
        """Return every basis function at coordinates ``s`` of shape (n,), shape (n, N_BASIS_FUNCTIONS)."""
        return np.asarray(np.exp(-0.5 * ((s[:, None] - self.centres) / self.spacing) ** 2), dtype=np.float64)

    def profile(self, weights: Array, s: Array) -> Array:
        """Return the weighted sum at coordinates ``s``, shape of ``s``; [N], or [N s/m] times a speed; [1] for friction."""
        return np.asarray(self.basis_functions(s) @ weights)


def factors_of(target: str) -> tuple[str, ...]:
    """Return the factors with which a law is searched for: friction and a force along a gradient have none."""
    if target == "heavy mass":
        return FACTORS[:2]  # while the string is taut, the first speed is its own
    return FACTORS if TARGETS[target][0] in ("along", "across") else FACTORS[:1]
