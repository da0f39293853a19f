"""What a study of convergence found: frozen, and the same JSON for the same input.

`convergence.json` is this tree of dataclasses, one JSON object per dataclass and one key per field; the text under a field is
its documentation. Units are SI and radians throughout, a missing number is null. One key is added, ``schema``, the first: it
holds `SCHEMA_ID` and `SCHEMA_VERSION`. Wall times and the time of day are in the last block, ``clock``. (With a budget, the
runs that it leaves out depend on the machine too.) A reader must refuse another id and a higher version.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from looping_pendulum.compare.convergence.ladder import ErrorCause, SequenceKind
from looping_pendulum.compare.json_text import dump, load
from looping_pendulum.compare.result import RunProvenance

SCHEMA_ID = "looping-pendulum/convergence"
SCHEMA_VERSION = 3
"""Since 2, halting times are the end of the string's sliding (`compare.slides`); in 1 they were read from a band of speeds."""
FILE = "convergence.json"

HALT = "halting_time"
DROP = "drop_at_halt"
QUANTITIES = {"path_0.35s": "m", "path_0.7s": "m", HALT: "s", DROP: "m"}
"""What is studied -> SI unit: the whole path of the light mass from the release to a time, and two numbers of the halt."""
MARKS = {"path_0.35s": 0.35, "path_0.7s": 0.7}
"""Path -> time [s] to which it is taken."""


@dataclass(frozen=True, kw_only=True)
class RunSummary:
    """One run against the reference of its own scenario."""

    key: str
    """Name of the run in the cache, and in ``clock``."""
    status: str
    """Name of the `RunStatus`; SKIPPED: left out to keep the budget; NOT_RUN: the study was interrupted before it."""
    ok: bool
    why: str
    """Sentence of the status, and what the engine said."""
    rms: dict[str, float | None]
    """Path -> root mean square distance of the light mass from the reference [m]."""
    halting_time: float | None
    """[s]"""
    halting_time_error: float | None
    """[s]"""
    drop_at_halt: float | None
    """[m]"""
    drop_error: float | None
    """[m]"""
    string_stretch: float | None
    """Largest [m]."""


@dataclass(frozen=True, kw_only=True)
class Rung:
    """One value of a refined setting."""

    value: float
    run: RunSummary
    to_finest: dict[str, float | None]
    """Quantity -> distance from the finest rung that ended properly."""
    to_limit: dict[str, float | None]
    """Quantity -> distance from the ladder's limit."""


@dataclass(frozen=True, kw_only=True)
class ConvergenceVerdict:
    """What one quantity does along one ladder."""

    quantity: str
    unit: str
    kind: SequenceKind
    why: str
    """Why it is no better."""
    rungs: int
    """Rungs that have the quantity."""
    used: int
    """Finest of them that the limit is of."""
    order: float | None
    order_uncertainty: float | None
    """95 %; null where three rungs leave nothing to tell it from."""
    limit: float | None
    """Of a number; a path's limit is a path."""
    uncertainty: float | None
    """Of the limit, 95 %."""
    scatter: float | None
    """Standard deviation of a rung, where rungs follow no power law."""
    limit_error: float | None
    """Distance of the limit from the reference; signed for a number."""
    sentence: str


@dataclass(frozen=True, kw_only=True)
class LadderStudy:
    """One setting, refined."""

    setting: str
    unit: str
    follows: str
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
    """A hidden default put back, or another choice of the adapter."""

    what: str
    ours: str
    other: str
    """The engine's default, or what could be chosen instead."""
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
    """Distance to the variant's own limit: the sum of its ladders' corrections."""
    numerics_uncertainty: float | None
    model: float | None
    """Distance of that limit to the reference."""
    model_uncertainty: float | None
    choice: float | None
    """Largest change by another choice as reasonable."""
    choice_of: str
    spread: float | None
    """Standard deviation of the error under small changes of the start."""
    causes: tuple[ErrorCause, ...]
    """Parts above their uncertainty, the largest first."""
    without_limit: tuple[str, ...]
    """Ladders whose limit is not known: they are missing from the numerics."""


@dataclass(frozen=True, kw_only=True)
class VariantStudy:
    """Everything about one engine variant."""

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
    provenance: RunProvenance

    @property
    def label(self) -> str:
        """Engine and variant, "pymunk:chain"."""
        return f"{self.engine}:{self.variant}"


@dataclass(frozen=True, kw_only=True)
class RunTime:
    """What one run of the study took; runs shared the machine, so this is no benchmark."""

    key: str
    seconds: float | None


@dataclass(frozen=True, kw_only=True)
class StudyClock:
    """Everything that differs between two studies of the same input."""

    written: str
    """Date and time, UTC."""
    run_times: tuple[RunTime, ...]


@dataclass(frozen=True, kw_only=True)
class ConvergenceResult:
    """One scenario, several variants."""

    scenario: str
    title: str
    parameters: dict[str, Any]
    until: float
    """How long runs were watched [s]."""
    budget: float | None
    """Runs expected to take longer were left out [s]."""
    reference: str
    """Engine and variant of the reference."""
    reference_values: dict[str, float | None]
    """Number -> its true value."""
    floors: dict[str, float]
    """Quantity -> how well it can be read off; changes up to that are not seen."""
    interrupted: bool
    variants: tuple[VariantStudy, ...]
    clock: StudyClock

    def to_json(self) -> str:
        """Text of ``convergence.json``."""
        return dump(self, SCHEMA_ID, SCHEMA_VERSION)

    @classmethod
    def from_json(cls, text: str) -> ConvergenceResult:
        """Read `to_json`'s text back.

        Raises
        ------
        ResultError
            If it is something else, or from a later version.
        """
        return load(cls, text, SCHEMA_ID, SCHEMA_VERSION, file=FILE, again="write it again with `looping-pendulum converge`")
