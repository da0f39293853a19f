"""The numbers of a batch: what each run's parameters are, and what the equations need."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from looping_pendulum.reference_ode.effects import COEFFICIENTS
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import (
    LARGEST,
    POINT_MASS_END,
    Parameters,
    Release,
    string_length,
    touching_length,
)

Columns = Mapping[str, Array]
"""Name of `COLUMNS` -> one value per run."""
_LENGTHS_AND_MASSES = ("light_mass", "heavy_mass", "rod_radius", "free_length", "hanging_length")
_FIELDS = tuple(field.name for field in dataclasses.fields(Parameters) if field.name not in ("release", "coefficients"))
COLUMNS = (*_FIELDS, *COEFFICIENTS)
"""Names that a column may have."""


def member(base: Parameters, columns: Columns, i: int) -> Parameters:
    """Parameters of run ``i``."""
    return base.replace(**{name: float(values[i]) for name, values in columns.items()})


def free_parameters_of(base: Parameters, columns: Columns) -> dict[str, Any]:
    """Every number that the equations need, by name: one value, or one per run."""
    numbers: dict[str, Any] = {name: getattr(base, name) for name in _FIELDS} | dict(base.coefficients)
    numbers |= {name: np.asarray(values, dtype=float) for name, values in columns.items()}
    if base.static_follows and "static_friction" not in columns:
        numbers["static_friction"] = numbers["kinetic_friction"]
    if base.release is Release.VERTICAL:
        numbers["release_angle"] = base.release_angle
    light_radius, rod_radius = numbers["light_radius"], numbers["rod_radius"]
    point = POINT_MASS_END * rod_radius
    numbers["end_length"] = np.where(np.greater(light_radius, 0), touching_length(light_radius, rod_radius), point)
    numbers["string_length"] = string_length(**{name: numbers[name] for name in (*_STRING, "heavy_swing")})
    return numbers


_STRING = ("free_length", "rod_radius", "release_angle", "hanging_length")


def possible(numbers: Mapping[str, Any], n: int) -> NDArray[np.bool_]:
    """Which runs have values that `Parameters` does not refuse."""
    checks = [np.greater(numbers[name], 0) & np.less_equal(numbers[name], LARGEST) for name in _LENGTHS_AND_MASSES]
    checks += [np.isfinite(numbers["light_radius"]) & np.greater_equal(numbers["light_radius"], 0)]
    checks += [np.greater(numbers["release_angle"], 0) & np.less(numbers["release_angle"], 2 * np.pi)]
    for name, coefficient in COEFFICIENTS.items():
        low, high = coefficient.bounds
        checks.append(np.greater_equal(numbers[name], low) & np.less_equal(numbers[name], high) & np.isfinite(numbers[name]))
    checks.append(np.greater_equal(numbers["static_friction"], numbers["kinetic_friction"]))
    checks.append(np.greater(numbers["free_length"], numbers["end_length"]))
    possible = np.ones(n, dtype=bool)
    for check in checks:
        possible &= check
    return possible
