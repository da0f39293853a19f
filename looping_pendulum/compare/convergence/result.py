"""Result of a convergence study: frozen, and the same JSON for the same input.

`convergence.json` is this tree of dataclasses, one JSON object per dataclass and one key per field; the text under a field is
its documentation. Units are SI and radians throughout, a missing number is null. One key is added, ``schema``, the first: it
holds the id and the version of the schema. Wall times and the time of day are in the last block, ``clock``. (With a budget, the
runs that it leaves out depend on the machine too.) A reader must refuse another id and a higher version.
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


class SequenceKind(StrEnum):
    """Behaviour of a sequence under refinement."""

    CONVERGES = "converges"
    SETTLED = "no longer changes"
    WITHIN_SPREAD = "converges no further than its spread"
    SCATTERS = "does not converge"
    NEVER = "never happens"
    UNKNOWN = "not known"


class ErrorCause(StrEnum):
    """Cause of a part of an error."""

    NOT_CONVERGED = "not converged"
    MODEL = "different model"
    CHOICE = "adapter's choice"
    NOTHING = "nothing beyond its uncertainty"
    UNKNOWN = "not known"


@dataclass(frozen=True, kw_only=True)
class RunSummary:
    """One run against the reference of its own scenario."""

    key: str
    """Key of the run in the cache, and in ``clock``."""
    status: str
    """Name of the `RunStatus`; SKIPPED: left out to keep the budget; NOT_RUN: the study was interrupted before it."""
    ok: bool
    why: str
    """Sentence of the status, and the last line of the engine's message."""
    rms: dict[str, float | None]
    """Path quantity -> root mean square distance of the light mass from the reference [m]."""
    halting_time: float | None
    """Halting time [s]."""
    halting_time_error: float | None
    """Halting time less the reference's [s]."""
    drop_at_halt: float | None
    """Drop of the heavy mass at the halt [m]."""
    drop_error: float | None
    """Drop at the halt less the reference's [m]."""
    string_stretch: float | None
    """Largest stretch of the string [m]."""


@dataclass(frozen=True, kw_only=True)
class Rung:
    """The run with one value of a refined setting."""

    value: float
    run: RunSummary
    to_finest: dict[str, float | None]
    """Quantity -> distance from the finest rung that ended properly."""
    to_limit: dict[str, float | None]
    """Quantity -> distance from the ladder's limit."""


@dataclass(frozen=True, kw_only=True)
class ConvergenceVerdict:
    """Behaviour of one quantity along one ladder."""

    quantity: str
    unit: str
    kind: SequenceKind
    why: str
    """Reason for the kind, where it is not convergence."""
    rungs: int
    """Number of rungs that have a value of the quantity."""
    used: int
    """Number of the finest of these that the limit is derived from."""
    order: float | None
    order_uncertainty: float | None
    """Half-width of the order's 95 % interval; null where three rungs leave no degree of freedom."""
    limit: float | None
    """Limit of a value of the halt; null for a path, whose limit is a path."""
    uncertainty: float | None
    """Half-width of the limit's 95 % interval."""
    scatter: float | None
    """Standard deviation of a rung, where rungs follow no power law."""
    limit_error: float | None
    """Distance of the limit from the reference; signed for a value of the halt."""
    sentence: str


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
    verdicts: tuple[ConvergenceVerdict, ...]


@dataclass(frozen=True, kw_only=True)
class StartChange:
    """A run from a slightly different start."""

    what: str
    run: RunSummary


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
class ErrorSplit:
    """The error at the variant's own settings, in parts; uncertainties are 95 %."""

    quantity: str
    unit: str
    error: float
    numerics: float | None
    """Distance of the variant from its own limit: the sum of its ladders' corrections."""
    numerics_uncertainty: float | None
    model: float | None
    """Distance of that limit to the reference."""
    model_uncertainty: float | None
    choice: float | None
    """Largest change that an equally reasonable alternative choice makes."""
    choice_of: str
    spread: float | None
    """Standard deviation of the error under small changes of the start."""
    causes: tuple[ErrorCause, ...]
    """Causes of the parts above their uncertainty, the largest first."""
    without_limit: tuple[str, ...]
    """Ladders whose limit is not known: they are missing from the numerics."""


@dataclass(frozen=True, kw_only=True)
class VariantStudy:
    """Convergence study of one engine variant."""

    engine: str
    variant: str
    profile: str
    summary: str
    own: RunSummary
    ladders: tuple[LadderStudy, ...]
    starts: tuple[StartChange, ...]
    spread: dict[str, float | None]
    """Quantity -> standard deviation of its error under small changes of the start."""
    choices: tuple[VariationStudy, ...]
    defaults: tuple[VariationStudy, ...]
    splits: tuple[ErrorSplit, ...]
    provenance: Provenance

    @property
    def label(self) -> str:
        """Engine and variant, "pymunk:chain"."""
        return variant_label(self.engine, self.variant)


@dataclass(frozen=True, kw_only=True)
class RunTime:
    """Wall time of one run of the study; several ran at the same time, so this is not a benchmark."""

    key: str
    seconds: float | None


@dataclass(frozen=True, kw_only=True)
class StudyClock:
    """Everything that differs between two studies of the same input."""

    written: str
    """Date and time, UTC."""
    run_times: tuple[RunTime, ...]


@dataclass(frozen=True, kw_only=True)
class ConvergenceResult(JsonResult):
    """Convergence studies of several variants on one scenario."""

    SCHEMA_ID = "looping-pendulum/convergence"
    SCHEMA_VERSION = 4
    FILE = FILE
    COMMAND = "converge"

    scenario: str
    title: str
    parameters: StoredParameters
    until: float
    """Simulated time of the runs [s]."""
    budget: float | None
    """Wall time [s] above which runs were left out, by the expected cost; null: none were."""
    reference: str
    """Engine and variant of the reference."""
    reference_values: dict[str, float | None]
    """Quantity of the halt -> its value in the reference."""
    floors: dict[str, float]
    """Quantity -> smallest change that can be seen; smaller ones are due to reading samples."""
    interrupted: bool
    variants: tuple[VariantStudy, ...]
    clock: StudyClock
