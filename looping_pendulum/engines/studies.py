"""Data classes for what can be varied of a variant: ladders of refinement, hidden defaults, and choices of the adapter.

A difference between an engine and the reference is *not converged* if a finer rung changes it, *adapter's choice* if another
equally reasonable choice changes it, and *a different model* if neither does. `compare.convergence` runs these studies.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

from looping_pendulum.pages.numbers import quantity

if TYPE_CHECKING:
    from looping_pendulum.engines.protocol import Engine, SteppedEngine

Changes = Mapping[str, Any]
"""Settings that change, by the names of their fields -> new values."""
LadderRow = tuple[str, str, Iterable[float | Changes]] | tuple[str, str, Iterable[float | Changes], str]
"""Setting, its unit, its rungs, and what `Ladder.follows` says; a rung is a value, or all changes where others follow."""
DefaultRow = tuple[str, str, str, str, Changes]
"""Setting, default, ours and effect as in `HiddenDefault`, and the changes that restore the engine's default."""
ChoiceRow = tuple[str, str, str, Changes]
"""What, ours and instead as in `AdapterChoice`, and the changes that make the other choice."""
Row = TypeVar("Row", DefaultRow, ChoiceRow)
WithSettings = Callable[..., "Engine"]
"""Type of a function ``with_settings(**changes)`` that returns a variant with some settings changed."""


@dataclass(frozen=True, kw_only=True)
class Ladder:
    """One numerical setting, refined rung by rung; all other settings stay, except those that ``follows`` names."""

    setting: str
    """Name of the field of the variant's settings."""
    unit: str
    """SI unit; '' for a pure number."""
    values: tuple[float, ...]
    """Values of the setting, from coarse to fine."""
    engines: tuple[Engine, ...]
    """The variant at each value."""
    follows: str = ""
    """Which other settings change along with it, and why; empty: none."""

    def __post_init__(self) -> None:
        """Refuse a ladder whose numbers of values and engines differ."""
        if len(self.values) != len(self.engines):
            raise ValueError(f"ladder {self.setting}: {len(self.values)} values for {len(self.engines)} engines")


@dataclass(frozen=True, kw_only=True)
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
    engine: Engine
    """The variant with the engine's default for this one setting."""


@dataclass(frozen=True, kw_only=True)
class AdapterChoice:
    """A decision of the adapter that could be made otherwise with equally good reason."""

    what: str
    """What is decided."""
    ours: str
    """How the adapter decides it."""
    instead: str
    """The other choice."""
    engine: Engine
    """The variant with the other choice."""


@dataclass(frozen=True, kw_only=True)
class Studies:
    """All that can be varied of one variant."""

    ladders: tuple[Ladder, ...] = ()
    defaults: tuple[HiddenDefault, ...] = ()
    choices: tuple[AdapterChoice, ...] = ()


def ladder(with_settings: WithSettings, setting: str, unit: str, rungs: Iterable[Changes], follows: str = "") -> Ladder:
    """Return a ladder with one engine per rung; a rung is a dict of changed settings, ``setting`` among them."""
    changes_per_rung = tuple(rungs)
    return Ladder(
        setting=setting,
        unit=unit,
        values=tuple(changes[setting] for changes in changes_per_rung),
        engines=tuple(with_settings(**changes) for changes in changes_per_rung),
        follows=follows,
    )


def studies_from_rows(
    engine: SteppedEngine,
    *,
    ladders: Iterable[LadderRow],
    defaults: Iterable[DefaultRow] = (),
    choices: Iterable[ChoiceRow] = (),
) -> Studies:
    """Return the studies that start from the settings of ``engine``."""

    def rungs(setting: str, values: Iterable[float | Changes]) -> Iterable[Changes]:
        return (value if isinstance(value, Mapping) else {setting: value} for value in values)

    return Studies(
        ladders=tuple(ladder(engine.with_settings, row[0], row[1], rungs(row[0], row[2]), *row[3:]) for row in ladders),
        defaults=tuple(
            HiddenDefault(setting=name, default=default, ours=ours, effect=effect, engine=engine.with_settings(**changes))
            for name, default, ours, effect, changes in defaults
        ),
        choices=tuple(
            AdapterChoice(what=what, ours=ours, instead=instead, engine=engine.with_settings(**changes))
            for what, ours, instead, changes in choices
        ),
    )


def default_row(settings: Any, setting: str, default: Any, name: str, effect: str, unit: str = "") -> DefaultRow:
    """Return the row of a setting that is called ``name`` in the engine, with both values written alike, in ``unit``."""

    def text(value: Any) -> str:
        return quantity(value, unit, 3) if unit else value if isinstance(value, str) else f"{value:g}"

    return name, text(default), text(getattr(settings, setting)), effect, {setting: default}


def rows_that_differ(settings: Any, rows: Iterable[Row]) -> list[Row]:
    """Return those of the ``rows``, of defaults or of choices, that change something in ``settings``."""
    return [row for row in rows if any(getattr(settings, field) != value for field, value in row[-1].items())]
