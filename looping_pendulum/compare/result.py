"""What a comparison found: frozen, free of NaN (a missing number is None), and the same JSON for the same input.

`result.json` is this tree of dataclasses, one JSON object per dataclass and one key per field, in the order below; the text
under a field is its documentation. Units are SI and radians throughout. One key is added, ``schema``, the first: it holds
`SCHEMA_ID` and `SCHEMA_VERSION`. One is left out: `ComparisonResult.samples`, the trajectories, are written as CSV instead.
Everything that differs between two runs of the same input (times of day, wall times) is in the last block, ``clock``.
A reader must refuse another id and a higher version; a version grows when a key changes its meaning or goes away.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING, Any

from looping_pendulum.errors import HarnessError

if TYPE_CHECKING:
    from looping_pendulum.compare.align import Aligned
    from looping_pendulum.engines.trajectory import Trajectory

SCHEMA_ID = "looping-pendulum/comparison"
SCHEMA_VERSION = 3


class ResultError(HarnessError, ValueError):
    """A file is not a comparison result that this version can read."""


@dataclass(frozen=True, kw_only=True)
class Stop:
    """The heavy mass's speed reached zero."""

    time: float
    """[s]"""
    height_change: float
    """Height of the heavy mass less its height at release [m]; negative below."""


@dataclass(frozen=True, kw_only=True)
class Extremum:
    """A coordinate turned."""

    time: float
    """[s]"""
    value: float
    """[m]"""


@dataclass(frozen=True, kw_only=True)
class HaltingTimeAt:
    """The halting time that one resolution gives."""

    resolution: float
    """Motion of the string that does not count as sliding [m]."""
    time: float | None
    """[s]; None if the string slid by more until the end of the run."""


@dataclass(frozen=True, kw_only=True)
class Rebound:
    """What the string still does after its first rest, the time from which on it stays within `slides.COARSE`."""

    travel: float
    """Between the two furthest places it takes [m]."""
    speed: float
    """Largest, over one sample interval [m/s]."""


@dataclass(frozen=True, kw_only=True)
class Landmarks:
    """The moments of one run, and the apparatus at them."""

    stops: tuple[Stop, ...] = ()
    """When the sliding of the string stops: it turns, or rests."""
    slip_onsets: tuple[float, ...] = ()
    """When a resting string began to slide again [s]."""
    halting_time: float | None = None
    """When the string stops sliding and does not slide again until the light mass reaches the rod, or the run ends [s].

    Read from samples with the resolution `slides.RESOLUTION`; the reference's own events know it to rounding.
    """
    halting_confirmed: bool = False
    """Whether that rest was seen to last until the light mass reached the rod; else the run was cut while the mass rested."""
    halting_times: tuple[HaltingTimeAt, ...] = ()
    """The same at several resolutions, the finest first; empty where events say it."""
    halting_time_blur: float | None = None
    """How far the halting time moves if `slides.RESOLUTION` is a quarter finer or coarser [s]; None: it is then lost."""
    rebound: Rebound | None = None
    """None where the string never comes to rest."""
    drop_at_halt: float | None = None
    """How far the heavy mass is below its release [m]."""
    wrap_angle_at_halt: float | None = None
    """[rad]"""
    free_length_at_halt: float | None = None
    """[m]"""
    light_reaches_rod: float | None = None
    """[s]; an engine's run ends at a small free length of its own choosing, so it is early by that much."""
    x1_extrema: tuple[Extremum, ...] = ()
    """Turns of the light mass's x."""
    y1_extrema: tuple[Extremum, ...] = ()
    """Turns of the light mass's y."""


@dataclass(frozen=True, kw_only=True)
class Tube:
    """Which samples have a point of the reference within a time and a distance."""

    half_time: float
    """[s]"""
    half_width: float
    """[m]"""
    compared: int
    """Samples that were tested: those before the reference's end."""
    fraction: float | None = None
    """Share of them inside."""
    first_exit: float | None = None
    """Time of the first sample outside [s]."""


@dataclass(frozen=True, kw_only=True)
class Departure:
    """When a run first is further from the reference than a threshold, and what the reference was doing."""

    threshold: float
    """[m]"""
    time: float
    """[s]"""
    mode: str
    """Mode of the reference then."""
    after: str
    """Last event of the reference before, "release" if none."""
    after_time: float
    """When that was [s]."""
    along: float
    """Deviation of the free length then [m]: positive where the engine's light mass is further out; 0 without a string."""
    across: float
    """Deviation of the wrap angle then, times the free length [m]: positive where the engine's light mass is ahead."""
    heavy: float
    """Deviation of the heavy mass's height then [m]."""
    stretch: float | None = None
    """Largest string stretch up to then [m]."""


@dataclass(frozen=True, kw_only=True)
class SupplyEntry:
    """One piece of physics and who supplies it."""

    what: str
    by: str
    """"engine", "adapter" or "nobody"."""
    how: str


@dataclass(frozen=True, kw_only=True)
class RunProvenance:
    """What made a run."""

    versions: dict[str, str]
    settings: dict[str, Any]
    """SI."""
    supplies: tuple[SupplyEntry, ...]
    seed: int | None = None


@dataclass(frozen=True, kw_only=True)
class ReferenceResult:
    """The reference that everything is compared with."""

    engine: str
    variant: str
    landmarks: Landmarks
    """By its own events, to rounding."""
    events: tuple[tuple[str, float], ...]
    """(name, time [s])"""
    end_time: float
    """Last time [s] that the reference covers, at most the scenario's duration."""
    provenance: RunProvenance
    sampled: Landmarks = Landmarks()
    """Landmarks of the reference's samples, by the detector that reads the engines': what their errors are taken against."""


@dataclass(frozen=True, kw_only=True)
class EngineResult:
    """One engine's run against the reference."""

    engine: str
    variant: str
    profile: str
    status: str
    """Name of the `RunStatus`, "FINISHED"."""
    status_sentence: str
    """Its sentence."""
    ok: bool
    """Whether the run came to its proper end."""
    available: bool
    """False where there was nothing to run: engine missing, scenario not representable, interrupted."""
    message: str
    samples: int
    end_time: float | None
    """Last finite sample [s]."""
    landmarks: Landmarks
    metrics: dict[str, float | None]
    """Metric name -> value, SI; None where the run or the reference ends too soon or the metric does not apply."""
    not_comparable: str = ""
    """Why this run's halt cannot be held against the reference's, which has one; empty: it can, or neither has one."""
    lacks: tuple[str, ...] = ()
    """Names of the physics that the scenario has and this run went without, "static_friction"; empty: it had all."""
    additions: tuple[str, ...] = ()
    """What the adapter puts in beyond the engine, each as a sentence with its measured worth."""
    outside_range: tuple[str, ...] = ()
    """What of the scenario lies outside the range in which this variant's accuracy was measured, each as a phrase."""
    tube: Tube
    departures: tuple[Departure, ...]
    """One per threshold that was passed, in the order of time."""
    growth_rate: float | None
    """Rate at which the deviation grew from the first threshold to the last, as an exponential's [1/s]."""
    story: str
    """Where, when and why it departs, in one or two sentences."""
    provenance: RunProvenance

    @property
    def label(self) -> str:
        """Engine and variant, "pymunk:chain"."""
        return f"{self.engine}:{self.variant}"


class ToleranceOutcome(StrEnum):
    """What became of one tolerance."""

    PASSED = "pass"
    FAILED = "fail"
    EXPECTED_FAILURE = "expected failure"
    UNEXPECTED_PASS = "unexpected pass"
    NOT_RUN = "not run"

    @property
    def good(self) -> bool:
        """Whether it leaves the comparison within tolerance. An unexpected pass does not: its reason is out of date."""
        return self not in (ToleranceOutcome.FAILED, ToleranceOutcome.UNEXPECTED_PASS)


@dataclass(frozen=True, kw_only=True)
class ToleranceResult:
    """One tolerance of the scenario, judged."""

    engine: str
    """Engine and variant."""
    profile: str
    metric: str
    limit: float
    """SI."""
    value: float | None
    outcome: ToleranceOutcome
    explanation: str
    """Why this outcome, where the numbers do not say it."""
    reason: str
    """Why the limit is what it is."""
    expected_failure: str


@dataclass(frozen=True, kw_only=True)
class MeasuredRow:
    """One row of the measured event table, with what the reference and the engines say."""

    quantity: str
    index: int
    unit: str
    measured: float | None
    paper_numerical: float | None
    reference: float | None
    engines: tuple[float | None, ...]
    """In the order of `ComparisonResult.engines`."""


@dataclass(frozen=True, kw_only=True)
class InferredEntry:
    """Parameters that the source does not print."""

    parameters: tuple[str, ...]
    how: str
    script: str


@dataclass(frozen=True, kw_only=True)
class WallTime:
    """What one run cost."""

    engine: str
    """Engine and variant."""
    profile: str
    seconds: float | None
    per_simulated_second: float | None


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
class ComparisonResult:
    """One scenario, one reference, several engines."""

    scenario: str
    title: str
    description: str
    parameters: dict[str, Any]
    """`Parameters.as_dict`, SI and radians."""
    duration: float
    """[s]"""
    inferred: tuple[InferredEntry, ...]
    reference: ReferenceResult
    engines: tuple[EngineResult, ...]
    tolerances: tuple[ToleranceResult, ...]
    measured: tuple[MeasuredRow, ...]
    """Empty without a measured event table."""
    measured_source: str
    """Where the scenario says its measured event table comes from; empty if it has none."""
    run_keys: tuple[str, ...] = ()
    """Name of each engine's run, equal for equal settings, scenario, versions and adapter; empty if unknown."""
    clock: Clock
    samples: ResultSamples | None = field(default=None, compare=False, repr=False)
    """None if read from JSON."""

    @property
    def within_tolerance(self) -> bool:
        """Whether no tolerance is broken and no run broke off unexpectedly: what the exit code says."""
        return all(t.outcome.good for t in self.tolerances) and not any(self.broke_off(e) for e in self.engines)

    def short_name(self, engine: EngineResult) -> str:
        """Label of ``engine``, with its profile if one label was run with several."""
        same = sum(e.label == engine.label for e in self.engines)
        return engine.label if same == 1 else f"{engine.label} ({engine.profile})"

    def judged(self, engine: EngineResult) -> tuple[ToleranceResult, ...]:
        """Return the tolerances that apply to ``engine``."""
        return tuple(t for t in self.tolerances if (t.engine, t.profile) == (engine.label, engine.profile))

    def broke_off(self, engine: EngineResult) -> bool:
        """Whether ``engine``'s run failed although no tolerance of it declares an expected failure."""
        return engine.available and not engine.ok and not any(t.expected_failure for t in self.judged(engine))

    def _repr_html_(self) -> str:
        """Show verdict, table and stories in a notebook."""
        from looping_pendulum.compare.report import before_figures
        from looping_pendulum.pages.markdown import html

        return str(html("\n\n".join(before_figures(self))))

    def to_json(self) -> str:
        """Text of ``result.json``; everything but ``clock`` is the same for the same input."""
        from looping_pendulum.compare.json_text import dump

        return dump(self)

    @classmethod
    def from_json(cls, text: str) -> ComparisonResult:
        """Read `to_json`'s text back, without the samples.

        Raises
        ------
        ResultError
            If it is something else, or from a later version.
        """
        from looping_pendulum.compare.json_text import load

        return load(cls, text)
