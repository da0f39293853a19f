"""The parameters of the runs of a batch, as arrays with one value per run."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import (
    NUMBERS,
    POINT_MASS_END,
    Parameters,
    Release,
    effect_tables,
    string_length,
    touching_length,
)

Columns = Mapping[str, Array]
"""Name, one of `column_names` -> one value per run, shape (n,), SI."""


def column_names(base: Parameters) -> tuple[str, ...]:
    """Return the names that a column may have."""
    return (*NUMBERS, *base.coefficients)


def parameters_of_run(base: Parameters, columns: Columns, i: int) -> Parameters:
    """Return the parameters of run ``i``."""
    return base.replace(**{name: float(values[i]) for name, values in columns.items()})


def equation_parameters(base: Parameters, columns: Columns) -> dict[str, Any]:
    """Return every parameter that the equations read, by name: one value, or one per run.

    Derived ones (`end_length`, `string_length`) and the defaults are those of `Parameters`.
    """
    values: dict[str, Any] = {name: getattr(base, name) for name in NUMBERS} | dict(base.coefficients)
    values |= base.with_static_friction({name: np.asarray(column, dtype=float) for name, column in columns.items()})
    # As in `Parameters.replace`, a vertical release keeps its angle
    if base.release is Release.VERTICAL:
        values["release_angle"] = base.release_angle
    light_radius, rod_radius = values["light_radius"], values["rod_radius"]
    point = POINT_MASS_END * rod_radius
    values["end_length"] = np.where(np.greater(light_radius, 0), touching_length(light_radius, rod_radius), point)
    values["string_length"] = string_length(**{name: values[name] for name in (*_STRING, "heavy_swing")})
    return values


_STRING = ("free_length", "rod_radius", "release_angle", "hanging_length")


def valid_runs(base: Parameters, values: Mapping[str, Any], n: int) -> NDArray[np.bool_]:
    """Return which of ``n`` runs have values that `Parameters` accepts."""
    valid = np.ones(n, dtype=bool)
    for requirement in effect_tables(base.own_effects).requirements(base.coefficients):
        valid &= requirement.is_met(values)
    return valid
