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


@dataclass(frozen=True)
class HiddenDefault:
    """A setting of the engine that changes the result and that its users are not asked for."""

    setting: str
    """Name of the setting in the engine."""
    default: str
    """The engine's value, with unit."""
    ours: str
    """The variant's value, with unit."""
    effect: str
    """What the setting does, in a few words."""
    changes: Changes
    """Changes that restore the engine's default."""


@dataclass(frozen=True)
class AdapterChoice:
    """A decision of the adapter that could be made otherwise with equally good reason."""

    what: str
    """What is decided."""
    ours: str
    """How the adapter decides it."""
    instead: str
    """The other choice."""
    changes: Changes
    """Changes that make the other choice."""


@dataclass(frozen=True, kw_only=True)
class Studies:
    """All that can be varied of one variant."""

    ladders: Sequence[Ladder] = ()
    defaults: Sequence[HiddenDefault] = ()
    choices: Sequence[AdapterChoice] = ()


def default_row(settings: Any, setting: str, default: Any, name: str, effect: str, unit: str = "") -> HiddenDefault:
    """Return the default of a setting that is called ``name`` in the engine, with both values written alike, in ``unit``."""

    def text(value: Any) -> str:
        if isinstance(value, bool):
            return "on" if value else "off"
        return quantity(value, unit, 3) if unit else value if isinstance(value, str) else f"{value:g}"

    return HiddenDefault(name, text(default), text(getattr(settings, setting)), effect, {setting: default})
