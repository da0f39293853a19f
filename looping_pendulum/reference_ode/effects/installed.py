"""Effects that other installed packages offer, through an entry point, as they may offer engines."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import cache
from importlib import import_module
from importlib.metadata import entry_points

from looping_pendulum.errors import HarnessError, ParameterError
from looping_pendulum.reference_ode.effects.check import check_effect, taken_names
from looping_pendulum.reference_ode.effects.own import check_name
from looping_pendulum.reference_ode.effects.types import Effect

ENTRY_POINTS = "looping_pendulum.effects"
"""Group of entry points by which other packages offer effects: any name -> module with ``effects() -> list[Effect]``."""


class EffectWarning(UserWarning):
    """Another package's effects cannot be used and are left out; the message says why and what to do."""


def installed_effects(library: Iterable[Effect]) -> tuple[tuple[Effect, ...], tuple[str, ...]]:
    """Return the effects of other packages, and for each package whose effects cannot be used one line that says why."""
    points = {(point.name, point.value, point.dist.name if point.dist else "") for point in entry_points(group=ENTRY_POINTS)}
    library = tuple(library)
    defaults = {c.name: c.default for e in library for c in e.coefficients}
    effects: list[Effect] = []
    faults: list[str] = []
    for _, module, package in sorted(points):
        try:
            effects += _effects_of_package(module, package, taken_names((*library, *effects)), defaults)
        except (Exception, SystemExit) as error:  # foreign code may raise anything, and must not end this program
            why = str(error) if isinstance(error, HarnessError) else f"{type(error).__name__}: {error}"
            faults.append(
                f"the effects of {module} of the package {package or '?'} are left out: {' '.join(why.split())}; "
                "mend or uninstall that package"
            )
    return tuple(effects), tuple(faults)


def _effects_of_package(module: str, package: str, taken: set[str], defaults: Mapping[str, float]) -> list[Effect]:
    """Return the effects of another package, after checking what results depend on."""
    effects = list(import_module(module).effects())
    for effect in effects:
        if not isinstance(effect, Effect):
            raise ParameterError(f"effects() gave {type(effect).__name__}, needed Effect; see docs/write-an-effect.md")
        try:
            names = [effect.name, *(c.name for c in effect.coefficients)]
            # An effect and its first coefficient may share a name
            for name in dict.fromkeys(names):
                check_name(name, taken)
            if len(set(names[1:])) < len(names) - 1:
                raise ParameterError("found two coefficients of one name, needed names that differ")
            check_effect(effect, defaults)
        except HarnessError as error:
            raise ParameterError(f"{effect.name}: {error}") from None
        taken = taken.union(names)
    return [replace(effect, module=module, package=package) for effect in effects]


@cache
def warn_of(fault: str) -> None:
    """Warn once of a package whose effects cannot be used."""
    warnings.warn(fault, EffectWarning, stacklevel=2)
