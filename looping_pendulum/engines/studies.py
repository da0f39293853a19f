"""What each variant lets others vary, as data: ladders of refinement, hidden defaults, and choices that the adapter made.

A difference between an engine and the reference is *not converged* where a finer rung changes it, *adapter's choice* where another
choice as reasonable changes it, and *a different model* where neither does. `compare.convergence` runs these studies.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from looping_pendulum.engines.protocol import Engine

Adjusted = Callable[..., "Engine"]
"""``adjusted(**changes)``: a variant with some settings changed."""


@dataclass(frozen=True, kw_only=True)
class Ladder:
    """One numerical setting, refined rung by rung; all else follows the variant's rule or stays."""

    setting: str
    """Name of the field of the variant's settings."""
    unit: str
    """SI unit; '' for a pure number."""
    values: tuple[float, ...]
    """From coarse to fine."""
    engines: tuple[Engine, ...]
    """The variant at each value."""
    follows: str = ""
    """What moves along with it, and why; empty: nothing."""

    def __post_init__(self) -> None:
        """Refuse a ladder whose rungs and engines differ in number."""
        if len(self.values) != len(self.engines):
            raise ValueError(f"ladder {self.setting}: {len(self.values)} values for {len(self.engines)} engines")


@dataclass(frozen=True, kw_only=True)
class HiddenDefault:
    """A setting of the engine that changes the answer and that nobody is asked for."""

    setting: str
    """As the engine calls it."""
    default: str
    """The engine's value, with unit."""
    ours: str
    """The variant's value, with unit."""
    effect: str
    """What the setting does, in a few words."""
    engine: Engine
    """The variant with the engine's default for this one setting."""


@dataclass(frozen=True, kw_only=True)
class AdapterChoice:
    """Something that the adapter decides and that could be decided otherwise with as good a reason."""

    what: str
    ours: str
    instead: str
    engine: Engine
    """The variant with the other choice."""


@dataclass(frozen=True, kw_only=True)
class Studies:
    """Everything that can be varied of one variant."""

    ladders: tuple[Ladder, ...] = ()
    defaults: tuple[HiddenDefault, ...] = ()
    choices: tuple[AdapterChoice, ...] = ()


def ladder(adjusted: Adjusted, setting: str, unit: str, rungs: Iterable[dict[str, Any]], follows: str = "") -> Ladder:
    """Make a ladder of one engine per rung; a rung is its changes, ``setting`` among them."""
    steps = tuple(rungs)
    return Ladder(
        setting=setting,
        unit=unit,
        values=tuple(changes[setting] for changes in steps),
        engines=tuple(adjusted(**changes) for changes in steps),
        follows=follows,
    )
