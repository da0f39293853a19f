"""Result of a comparison: frozen, free of NaN (a missing number is None), and the same JSON for the same input.

`result.json` is this tree of dataclasses (`Landmarks` is defined in `runs.events`), one JSON object per dataclass and one key
per field, in the order of the fields; the text under a field is its documentation. Units are SI and radians throughout. One key
is added, ``schema``, the first, with the schema's id and version; `result.schema.json` beside this file is the JSON Schema,
which `python -m scripts.result_schema` writes. One is left out: `ComparisonResult.samples`, the trajectories, are written as
CSV instead. Everything that differs between two runs of the same input (times of day, run times) is in the last block,
``clock``. A reader must refuse another id and a higher version; a version grows when a key changes its name or meaning or goes
away.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Any

from pydantic import InstanceOf
from pydantic.json_schema import SkipJsonSchema

from looping_pendulum.compare.align import Aligned
from looping_pendulum.compare.deviation import Departure, Tube
from looping_pendulum.compare.json_text import JsonResult, StoredParameters, plain
from looping_pendulum.compare.trial import TrialComparison
from looping_pendulum.pages.tables import data_frame
from looping_pendulum.runs.events import Landmarks
from looping_pendulum.runs.trajectory import Provenance, RunStatus, Trajectory, variant_label
from looping_pendulum.scenarios.scenario import Inference


def stored_provenance(provenance: Provenance) -> Provenance:
    """Return a run's provenance with settings as JSON has them, so that a result is equal to what is read back."""
    return replace(provenance, versions=plain(provenance.versions), settings=plain(provenance.settings))


@dataclass(frozen=True, kw_only=True)
class ReferenceResult:
    """The reference that everything is compared with."""

    engine: str
    variant: str
    landmarks: Landmarks
    """Landmarks from the reference's own events, exact to rounding."""
    events: tuple[tuple[str, float], ...]
    """Events as (name, time [s])."""
    end_time: float
    """Last time [s] that the reference covers, at most the scenario's duration."""
    provenance: Provenance
    sampled: Landmarks = Landmarks()
    """Landmarks from the reference's samples, by the detector that reads the engines; their errors are relative to it."""

    @property
    def label(self) -> str:
        """Engine and variant, "reference"."""
        return variant_label(self.engine, self.variant)


@dataclass(frozen=True, kw_only=True)
class EngineResult:
    """One engine's run against the reference."""

    engine: str
    variant: str
    profile: str
    status: str
    """Name of the `RunStatus`, "FINISHED"."""
    status_sentence: str
    """Sentence of that status."""
    ok: bool
    """Whether the run came to its proper end."""
    available: bool
    """False where no run was made or finished: engine missing, scenario not representable, interrupted."""
    message: str
    samples: int
    end_time: float | None
    """Time of the last finite sample [s]."""
    landmarks: Landmarks
    metrics: dict[str, float | None]
    """Metric name -> value, SI; None where the run or the reference ends too soon or the metric does not apply."""
    not_comparable: str = ""
    """Why this run's halting time cannot be compared with the reference's; empty: it can, or neither halts."""
    lacks: tuple[str, ...] = ()
    """Names of the physics that the scenario has and this run did not, such as "static_friction"; empty: it had all."""
    additions: tuple[str, ...] = ()
    """Corrections that the adapter adds to the engine, each as a sentence with its measured effect."""
    from_reference: tuple[str, ...] = ()
    """What the adapter took from the reference's own run, each in a few words; empty: nothing."""
    outside_range: tuple[str, ...] = ()
    """Quantities of the scenario outside the range in which this variant's accuracy was measured, each as a phrase."""
    tube: Tube
    departures: tuple[Departure, ...]
    """One departure per threshold that was exceeded, in order of time."""
    growth_rate: float | None
    """Rate [1/s] of the exponential that grows from the first exceeded threshold to the last."""
    story: str
    """Where, when and why it departs, in one or two sentences."""
    provenance: Provenance

    @property
    def label(self) -> str:
        """Engine and variant, "pymunk:chain"."""
        return variant_label(self.engine, self.variant)


class ToleranceOutcome(StrEnum):
    """Outcome of one tolerance."""

    PASSED = "pass"
    FAILED = "fail"
    EXPECTED_FAILURE = "expected failure"
    UNEXPECTED_PASS = "unexpected pass"
    NOT_RUN = "not run"

    @property
    def good(self) -> bool:
        """Whether the comparison stays within tolerance; an unexpected pass does not: its reason is out of date."""
        return self not in (ToleranceOutcome.FAILED, ToleranceOutcome.UNEXPECTED_PASS)


@dataclass(frozen=True, kw_only=True)
class ToleranceResult:
    """A tolerance of the scenario with the value of its metric and the outcome."""

    engine: str
    """Engine and variant."""
    profile: str
    metric: str
    limit: float
    """Limit of the metric, SI."""
    value: float | None
    outcome: ToleranceOutcome
    explanation: str
    """Reason for the outcome, where value and limit do not show it."""
    reason: str
    """Reason for the limit, from the scenario."""
    expected_failure: str


@dataclass(frozen=True, kw_only=True)
class MeasuredRow:
    """A row of the measured event table, with the values of the reference and of the engines."""

    quantity: str
    index: int
    unit: str
    measured: float | None
    paper_numerical: float | None
    reference: float | None
    engines: tuple[float | None, ...]
    """In the order of `ComparisonResult.engines`."""
    sigma: float | None = None
    """Standard error of the measured value [SI]; None if its source states none."""


@dataclass(frozen=True, kw_only=True)
class WallTime:
    """Wall and CPU time of one run."""

    engine: str
    """Engine and variant."""
    profile: str
    seconds: float | None
    per_simulated_second: float | None
    cpu_seconds: float | None = None
    cpu_per_simulated_second: float | None = None


@dataclass(frozen=True, kw_only=True)
class Clock:
    """Everything that differs between two runs of the same input."""

    written: str
    """Date and time, UTC."""
    wall_times: tuple[WallTime, ...]
    """In the order of `ComparisonResult.engines`."""


@dataclass(frozen=True, kw_only=True)
class ResultSamples:
    """The trajectories behind a result, for figures and CSV; never in the JSON."""

    reference: Trajectory
    aligned: tuple[Aligned, ...]


@dataclass(frozen=True, kw_only=True)
class ComparisonResult(JsonResult):
    """One scenario, one reference, several engines; `from_json` reads it without the samples."""

    SCHEMA_ID = "looping-pendulum/comparison"
    SCHEMA_VERSION = 4

    scenario: str
    title: str
    description: str
    parameters: StoredParameters
    """`Parameters.as_dict`, SI and radians."""
    duration: float
    """[s]"""
    inferred: tuple[Inference, ...]
    reference: ReferenceResult
    engines: tuple[EngineResult, ...]
    tolerances: tuple[ToleranceResult, ...]
    measured: tuple[MeasuredRow, ...]
    """Empty without a measured event table."""
    measured_source: str
    """Files of the measured trial, or where the scenario says its measured event table comes from; empty without either."""
    trial: TrialComparison | None = None
    """Residuals of a filmed trial's tracked points; None without one."""
    run_keys: tuple[str, ...] = ()
    """Key of each engine's run in the cache, equal for equal settings, scenario, versions and adapter; empty if unknown."""
    clock: Clock
    samples: SkipJsonSchema[InstanceOf[ResultSamples]] | None = field(default=None, compare=False, repr=False)
    """None if read from JSON."""

    @property
    def within_tolerance(self) -> bool:
        """Whether no tolerance fails and no run broke off unexpectedly; the exit code says the same."""
        return all(t.outcome.good for t in self.tolerances) and not any(self.broke_off(e) for e in self.engines)

    @property
    def interrupted(self) -> bool:
        """Whether the user interrupted a run."""
        return any(engine.status == RunStatus.INTERRUPTED.name for engine in self.engines)

    def rows(self) -> list[dict[str, Any]]:
        """Return one row for each engine: its name, profile and status, and every metric [SI], None where it is not defined."""
        return [{"engine": e.label, "profile": e.profile, "status": e.status, **e.metrics} for e in self.engines]

    def to_frame(self) -> Any:
        """Return `rows` as a `pandas.DataFrame`, in which None is NaN.

        Raises
        ------
        MissingPackageError
            If pandas is not installed.
        """
        return data_frame(self.rows())

    def short_name(self, engine: EngineResult) -> str:
        """Return the label of ``engine``, with its profile if the engine was run with several or is the reference's own."""
        same = [self.reference.label, *(e.label for e in self.engines)].count(engine.label)
        return engine.label if same == 1 else f"{engine.label} ({engine.profile})"

    def judged(self, engine: EngineResult) -> tuple[ToleranceResult, ...]:
        """Return the tolerances that apply to ``engine``."""
        return tuple(t for t in self.tolerances if (t.engine, t.profile) == (engine.label, engine.profile))

    def broke_off(self, engine: EngineResult) -> bool:
        """Whether ``engine``'s run failed although no tolerance of it declares an expected failure."""
        return engine.available and not engine.ok and not any(t.expected_failure for t in self.judged(engine))
