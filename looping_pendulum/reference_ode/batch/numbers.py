"""The parameters of the runs of a batch, as arrays with one value per run."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from looping_pendulum.reference_ode.effects import COEFFICIENTS
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import (
    MAX_LENGTH_OR_MASS,
    POINT_MASS_END,
    Parameters,
    Release,
    string_length,
    touching_length,
)

Columns = Mapping[str, Array]
"""Name, one of `COLUMNS` -> one value per run, shape (n,), SI."""
_LENGTHS_AND_MASSES = ("light_mass", "heavy_mass", "rod_radius", "free_length", "hanging_length")
_FIELDS = tuple(field.name for field in dataclasses.fields(Parameters) if field.name not in ("release", "coefficients"))
COLUMNS = (*_FIELDS, *COEFFICIENTS)
"""Names that a column may have."""


def parameters_of_run(base: Parameters, columns: Columns, i: int) -> Parameters:
    """Return the parameters of run ``i``."""
    return base.replace(**{name: float(values[i]) for name, values in columns.items()})


def equation_parameters(base: Parameters, columns: Columns) -> dict[str, Any]:
    """Return every parameter that the equations read, by name: one value, or one per run.

    Derived ones (`end_length`, `string_length`) and the defaults are those of `Parameters`.
    """
    values: dict[str, Any] = {name: getattr(base, name) for name in _FIELDS} | dict(base.coefficients)
    values |= {name: np.asarray(column, dtype=float) for name, column in columns.items()}
    # The rules of `Parameters.replace`: static friction follows the kinetic one, a vertical release keeps its angle
    if base.static_equals_kinetic and "static_friction" not in columns:
        values["static_friction"] = values["kinetic_friction"]
    if base.release is Release.VERTICAL:
        values["release_angle"] = base.release_angle
    light_radius, rod_radius = values["light_radius"], values["rod_radius"]
    point = POINT_MASS_END * rod_radius
    values["end_length"] = np.where(np.greater(light_radius, 0), touching_length(light_radius, rod_radius), point)
    values["string_length"] = string_length(**{name: values[name] for name in (*_STRING, "heavy_swing")})
    return values


_STRING = ("free_length", "rod_radius", "release_angle", "hanging_length")


def valid_runs(values: Mapping[str, Any], n: int) -> NDArray[np.bool_]:
    """Return which of ``n`` runs have values that `Parameters` accepts.

    The comparisons are those of `Parameters`, written so that nan fails each of them.
    """
    checks = [np.greater(values[name], 0) & np.less_equal(values[name], MAX_LENGTH_OR_MASS) for name in _LENGTHS_AND_MASSES]
    checks += [np.isfinite(values["light_radius"]) & np.greater_equal(values["light_radius"], 0)]
    checks += [np.greater(values["release_angle"], 0) & np.less(values["release_angle"], 2 * np.pi)]
    for name, coefficient in COEFFICIENTS.items():
        low, high = coefficient.bounds
        checks.append(np.greater_equal(values[name], low) & np.less_equal(values[name], high) & np.isfinite(values[name]))
    checks.append(np.greater_equal(values["static_friction"], values["kinetic_friction"]))
    checks.append(np.greater(values["free_length"], values["end_length"]))
    valid = np.ones(n, dtype=bool)
    for check in checks:
        valid &= check
    return valid
