"""What can be varied of a variant, as plain data: ladders of refinement, hidden defaults, and choices of the adapter.

A difference between an engine and the reference is *not converged* if a finer rung changes it, *adapter's choice* if another
equally reasonable choice changes it, and *a different model* if neither does. `compare.convergence` runs these studies.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from looping_pendulum.pages.numbers import quantity

Changes = Mapping[str, Any]
"""Settings that change, by the names of their fields -> new values: numbers, texts, or tuples of such."""


@dataclass(frozen=True)
class Ladder:
    """One numerical setting, refined rung by rung; all other settings stay, except those that ``follows`` names."""

    setting: str
    """Name of the field of the variant's settings."""
    unit: str
    """SI unit; '' for a pure number."""
    rungs: Sequence[float | Changes]
    """From coarse to fine: a value of the setting each, or all changes, the setting's among them, where others follow."""
    follows: str = ""
    """Which other settings change along with it, and why; empty: none."""

    @property
    def changes(self) -> tuple[Changes, ...]:
        """Return what changes at each rung."""
        return tuple(rung if isinstance(rung, Mapping) else {self.setting: rung} for rung in self.rungs)

    @property
    def values(self) -> tuple[float, ...]:
        """Return the values of the setting, from coarse to fine."""
        return tuple(changes[self.setting] for changes in self.changes)

    def own_value(self, settings: Any) -> float | None:
        """Return the setting's value among a variant's ``settings``; None if it has none that is a number."""
        value = getattr(settings, self.setting, None)
        return float(value) if isinstance(value, (int, float)) else None


@dataclass(frozen=True)
class Variation:
    """Other settings than the variant's: a default of the engine, or a choice for which the adapter has as good a reason."""

    what: str
    """Name of the setting in the engine, or what is decided."""
    ours: str
    """The variant's value, with unit, or how the adapter decides it."""
    other: str
    """The engine's default, with unit, or the other choice."""
    changes: Changes
    """Changes that make it so."""
    effect: str = ""
    """What the setting does, in a few words; may be left out of a choice."""


@dataclass(frozen=True, kw_only=True)
class Studies:
    """All that can be varied of one variant."""

    ladders: Sequence[Ladder] = ()
    defaults: Sequence[Variation] = ()
    """Settings of the engine that change the result and that its users are not asked for."""
    choices: Sequence[Variation] = ()
    """Decisions of the adapter that could be made otherwise with equally good reason."""


def default_row(settings: Any, setting: str, default: Any, name: str, effect: str, unit: str = "") -> Variation:
    """Return the default of a setting that is called ``name`` in the engine, with both values written alike, in ``unit``."""

    def text(value: Any) -> str:
        if isinstance(value, bool):
            return "on" if value else "off"
        return quantity(value, unit, 3) if unit else value if isinstance(value, str) else f"{value:g}"

    return Variation(name, text(getattr(settings, setting)), text(default), {setting: default}, effect)
