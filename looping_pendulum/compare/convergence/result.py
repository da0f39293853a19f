"""Result of a convergence study: frozen, and the same JSON for the same input.

`convergence.json` is this tree of dataclasses, one JSON object per dataclass and one key per field; the text under a field is
its documentation. Units are SI and radians throughout, a missing number is null. One key is added, ``schema``, the first: it
holds the id and the version of the schema. Wall times and the time of day are in the last block, ``clock``. (With a time limit,
the runs that it cuts depend on the machine too.) A reader must refuse another id and a higher version.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from looping_pendulum.compare.json_text import JsonResult, StoredParameters
from looping_pendulum.runs.trajectory import Provenance, variant_label

FILE = "convergence.json"

HALT = "halting_time"
DROP = "drop_at_halt"
QUANTITIES = {"path_0.35s": "m", "path_0.7s": "m", HALT: "s", DROP: "m"}
"""Quantity -> SI unit: the path of the light mass from the release to a time, and two values of the halt."""
PATH_END_TIMES = {"path_0.35s": 0.35, "path_0.7s": 0.7}
"""Path quantity -> time [s] at which the path ends."""


class Verdict(StrEnum):
    """What refining does to a deviation from the reference."""

    CONVERGED = "converged"
    """The limit is the reference's, and it is reached, both to within `resolution`."""
    NOT_CONVERGED = "not converged"
    """The limit is not reached, or not known well enough; such a value is never ranked."""
    ANOTHER_LIMIT = "another limit"
    """The limit differs from the reference by more than its uncertainty, and by more than the resolution."""


@dataclass(frozen=True, kw_only=True)
class RunSummary:
    """One run against the reference of its own scenario."""

    key: str
    """Key of the run in the cache, and in ``clock``."""
    status: str
    """Name of the `RunStatus`; NOT_RUN: a coarser rung reached the time limit, or the study was interrupted before."""
    ok: bool
    why: str
    """Sentence of the status, and the last line of the engine's message."""
    errors: dict[str, float | None]
    """Quantity -> root mean square distance from the reference's path, or signed difference from the reference's value."""
    halting_time: float | None
    """Halting time [s], even where the reference has none."""


@dataclass(frozen=True, kw_only=True)
class Rung:
    """The run with one value of a refined setting."""

    value: float
    run: RunSummary
    to_limit: dict[str, float | None]
    """Quantity -> distance from the ladder's limit."""


@dataclass(frozen=True, kw_only=True)
class QuantityVerdict:
    """What refining one setting, or all settings of a variant, does to the deviation of one quantity."""

    quantity: str
    verdict: Verdict
    sentence: str
    """The verdict, why, and what to do."""
    refinement: float | None
    """Change from the variant's own settings to the limit or, without one, to the finest rung; of all ladders the largest."""
    limit_error: float | None
    """Distance of the limit from the reference, signed for a ladder's value of the halt; of all ladders added up."""
    uncertainty: float | None
    """Half-width of the limit's 95 % interval."""
    order: float | None = None
    """Order of convergence along one ladder."""


@dataclass(frozen=True, kw_only=True)
class LadderStudy:
    """A sequence of runs that refines one setting."""

    setting: str
    unit: str
    follows: str
    refined_further_by: str
    """Setting of another ladder that refines this one's as far or further, which then counts in its place; empty: none."""
    own: float | None
    """Value at the variant's own settings."""
    rungs: tuple[Rung, ...]
    """From coarse to fine."""
    verdicts: tuple[QuantityVerdict, ...]


@dataclass(frozen=True, kw_only=True)
class VariationStudy:
    """A run with a hidden default of the engine restored, or with another choice of the adapter."""

    what: str
    ours: str
    other: str
    """The engine's default, or the alternative choice."""
    effect: str
    """What the setting does; empty for a choice."""
    run: RunSummary
    change: dict[str, float | None]
    """Quantity -> how far it moves: a distance for a path, a signed difference for a number."""


@dataclass(frozen=True, kw_only=True)
class VariantStudy:
    """Convergence study of one engine variant."""

    engine: str
    variant: str
    profile: str
    summary: str
    own: RunSummary
    ladders: tuple[LadderStudy, ...]
    spread: dict[str, float | None]
    """Quantity -> run-to-run noise: standard deviation of its error under small changes of the start."""
    choices: tuple[VariationStudy, ...]
    defaults: tuple[VariationStudy, ...]
    verdicts: tuple[QuantityVerdict, ...]
    """One for each quantity that the reference has."""
    provenance: Provenance

    @property
    def label(self) -> str:
        """Engine and variant, "pymunk:chain"."""
        return variant_label(self.engine, self.variant)

    def choice(self, name: str) -> float | None:
        """Return the largest change of quantity ``name`` that another choice of the adapter makes."""
        return max((abs(moved) for one in self.choices if (moved := one.change[name]) is not None), default=None)


@dataclass(frozen=True, kw_only=True)
class StudyClock:
    """Everything that differs between two studies of the same input."""

    written: str
    """Date and time, UTC."""
    run_times: dict[str, float | None]
    """Key of a run -> its wall time [s]; several ran at the same time, so this is not a benchmark."""


@dataclass(frozen=True, kw_only=True)
class ConvergenceResult(JsonResult):
    """Convergence studies of several variants on one scenario."""

    SCHEMA_ID = "looping-pendulum/convergence"
    SCHEMA_VERSION = 5
    FILE = FILE
    COMMAND = "converge"

    scenario: str
    title: str
    parameters: StoredParameters
    until: float
    """Simulated time of the runs [s]."""
    time_limit: float
    """Wall time [s] at which a run was cut, and finer rungs of its ladder were left out."""
    reference: str
    """Engine and variant of the reference."""
    reference_values: dict[str, float | None]
    """Quantity of the halt -> its value in the reference."""
    resolution: dict[str, float]
    """Quantity -> difference that no longer matters: the verdicts hold at this resolution."""
    interrupted: bool
    variants: tuple[VariantStudy, ...]
    clock: StudyClock
