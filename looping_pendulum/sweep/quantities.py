"""Quantities that a map may vary: fields of `Parameters`, coefficients of effects, and ratios that set some of these."""

from __future__ import annotations

import functools
from collections import ChainMap
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np

from looping_pendulum.reference_ode import effects as effect_library
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import Parameters
from looping_pendulum.scenarios.quantities import FILE_KEYS, QUANTITIES, quantity_kind
from looping_pendulum.scenarios.units import QuantityKind

NOT_VARIABLE = ("release",)
"""Entries of a scenario that are not numbers and cannot be varied."""
ApplyRatio = Callable[[Array, Mapping[str, Any]], dict[str, Array]]
"""Function of a ratio's values and of all parameters' values so far that returns the columns that the ratio sets."""
AXIS_NAMES = MappingProxyType({"free_length": "release_free_length"})
"""Parameter -> name of its axis, where a field of the map has the parameter's own name; arrays need names of their own."""


@dataclass(frozen=True, kw_only=True)
class Variable:
    """A quantity that a map may vary."""

    name: str
    kind: QuantityKind
    meaning: str
    sets: tuple[str, ...]
    """Names of the fields and coefficients that it sets."""
    apply: ApplyRatio | None = None
    """For a ratio, which is no field of `Parameters` but sets some of them."""

    @property
    def axis_name(self) -> str:
        """Name of its axis in a map."""
        return AXIS_NAMES.get(self.name, self.name)


_RATIOS = (
    Variable(
        name="mass_scale",
        kind=QuantityKind(unit="", low=0.0, exclusive_low=True, example="2"),
        meaning="factor on both masses, their ratio kept",
        sets=("light_mass", "heavy_mass"),
        apply=lambda scale, now: {"light_mass": scale * now["light_mass"], "heavy_mass": scale * now["heavy_mass"]},
    ),
    Variable(
        name="mass_ratio",
        kind=QuantityKind(unit="", low=0.0, exclusive_low=True, example="2.5"),
        meaning="heavy over light mass M2/M1, the light one kept",
        sets=("heavy_mass",),
        apply=lambda ratio, now: {"heavy_mass": ratio * now["light_mass"]},
    ),
    Variable(
        name="static_ratio",
        kind=QuantityKind(unit="", low=1.0, example="1.2"),
        meaning="static over kinetic friction, the kinetic one kept",
        sets=("static_friction",),
        apply=lambda ratio, now: {"static_friction": ratio * now["kinetic_friction"]},
    ),
)
RATIOS = MappingProxyType({ratio.name: ratio for ratio in _RATIOS})
"""Ratio by name, in the order in which they are applied: each uses what those before it have set."""

ALLOWED_OVERLAP = frozenset({"mass_scale", "mass_ratio"})
"""Ratios that set the same parameter and may still be varied together; the ratio is applied last."""


@functools.cache
def variables() -> MappingProxyType[str, Variable]:
    """Return every quantity that a map may vary, by name."""
    by_name = {}
    for name in FILE_KEYS:
        if name not in NOT_VARIABLE and name not in effect_library.COEFFICIENTS:
            q = QUANTITIES[name]
            by_name[name] = Variable(name=name, kind=q.kind, meaning=f"{q.group}: {q.description()}".rstrip("."), sets=(name,))
    for name, c in effect_library.COEFFICIENTS.items():
        by_name[name] = Variable(name=name, kind=quantity_kind(c), meaning=c.meaning, sets=(name,))
    return MappingProxyType(by_name | RATIOS)


def columns(base: Parameters, given: Mapping[str, Array]) -> dict[str, Array]:
    """Return the columns for `solve_batch`: fields and coefficients that differ from ``base``.

    Parameters
    ----------
    base
        Parameters that the runs have in common.
    given
        Varied quantities by the names of their axes (`Variable.axis_name`), SI, shape (n,) each.
    """
    parameters = {axis: name for name, axis in AXIS_NAMES.items()}
    known = vars(base.values())
    out = base.with_static_friction(
        {parameters.get(name, name): np.asarray(values, dtype=float) for name, values in given.items() if name not in RATIOS}
    )
    for name, ratio in RATIOS.items():
        if name in given and ratio.apply:
            # The chain looks into what is set so far first, so that a ratio uses a varied value rather than the scenario's
            out |= ratio.apply(np.asarray(given[name], dtype=float), ChainMap(out, known))
    return out
