"""Demonstrations of what a model assumes: a question, a guess, an experiment that is run, and an answer that its run supports.

A demonstration is data. Its answer consists of claims; each has a test on the values measured in the run, and a claim whose
test fails is printed as not borne out, never as an answer.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from looping_pendulum.engines.landmarks import run_landmarks
from looping_pendulum.engines.protocol import Engine, Profile
from looping_pendulum.engines.reference import ReferenceEngine
from looping_pendulum.engines.registry import how_to_get, label, missing_packages
from looping_pendulum.engines.trajectory import Trajectory
from looping_pendulum.errors import HarnessError, MissingPackageError
from looping_pendulum.processes import ReportShare
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import Parameters
from looping_pendulum.reference_ode.solve import available_integrators
from looping_pendulum.scenarios import load
from looping_pendulum.scenarios.scenario import Scenario
from looping_pendulum.versions import installed_version

Runs = Mapping[str, Any]
"""Case -> what its run returned."""
MeasuredValues = Mapping[str, Mapping[str, Any]]
"""Quantity -> case -> measured value: ``values["halt"]["reference"]``; None where there is nothing to measure."""


class DemonstrationError(HarnessError, ValueError):
    """A demonstration cannot be run."""


@dataclass(frozen=True, kw_only=True)
class DemonstrationCase:
    """One run of an experiment."""

    key: str
    """What claims call it."""
    label: str
    """What tables and figures call it."""
    run: Callable[[], Any]
    """Makes the run, and returns what quantities and curves are computed from."""
    reference: bool = False
    """Whether the others are compared with it: drawn black."""


@dataclass(frozen=True, kw_only=True)
class MeasuredColumn:
    """A quantity that is measured in every case: a column of the table."""

    key: str
    """What claims call it."""
    header: str
    """Header of the column, with unit."""
    measure: Callable[[Mapping[str, Any], str], Any]
    """Takes the runs by case and the case's key; returns a number, text, or None."""
    digits: str = ".3f"
    """Format of a number."""
    absent: str = "–"
    """Text in the table for None."""


@dataclass(frozen=True, kw_only=True)
class FigureCurve:
    """One line of the figure."""

    label: str
    x: Array
    y: Array
    reference: bool = False
    points: bool = False
    """Whether it is a few measurements rather than a motion: drawn with markers."""


@dataclass(frozen=True, kw_only=True)
class DemonstrationFigure:
    """The figure of a demonstration."""

    x: str
    """Label of the x axis, with unit."""
    y: str
    """Label of the y axis, with unit."""
    caption: str
    """What the figure shows; also its text for readers who cannot see it."""
    curves: Callable[[Mapping[str, Any], Mapping[str, DemonstrationCase]], Sequence[FigureCurve]]


@dataclass(frozen=True, kw_only=True)
class Claim:
    """One sentence of an answer."""

    words: str
    """Template that is filled with `MeasuredValues`: "halts at {halt[reference]:.3f} s"."""
    holds: Callable[[MeasuredValues], bool]
    """Test on the measured values; returns whether they support the sentence."""


@dataclass(frozen=True, kw_only=True)
class Demonstration:
    """A question about a model, with the experiment that answers it: one page."""

    name: str
    """Name on the command line, and of the page's files."""
    title: str
    question: str
    guess: str
    experiment: str
    """Description of the runs."""
    scenario: str
    """Name of the shipped scenario that the experiment starts from."""
    change: str
    """What a reader may change in the scenario, as lines of YAML."""
    commands: tuple[str, ...]
    """Commands with which a reader repeats the experiment."""
    cases: Callable[[], tuple[DemonstrationCase, ...]]
    quantities: tuple[MeasuredColumn, ...]
    claims: tuple[Claim, ...]
    picture: DemonstrationFigure
    packages: tuple[str, ...] = ()
    """Packages of the engines, where the runs are no trajectories that name them."""


@dataclass(frozen=True, kw_only=True)
class JudgedClaim:
    """A claim after the run: its sentence with numbers, and the outcome of its test."""

    text: str
    holds: bool


@dataclass(frozen=True, kw_only=True)
class DemonstrationResult:
    """A demonstration after its run."""

    demonstration: Demonstration
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    numbers: MeasuredValues
    answer: tuple[JudgedClaim, ...]
    curves: tuple[FigureCurve, ...]
    versions: Mapping[str, str] = field(default_factory=dict)
    """Package -> version, of the packages that ran."""

    @property
    def all_claims_hold(self) -> bool:
        """Whether every claim holds in this run."""
        return all(sentence.holds for sentence in self.answer)


def run_demonstration(demonstration: Demonstration, progress: ReportShare | None = None) -> DemonstrationResult:
    """Run the experiment of ``demonstration`` and return the content of its page.

    Raises
    ------
    MissingPackageError
        If an engine that it needs is not installed.
    """
    cases = {case.key: case for case in demonstration.cases()}
    runs: dict[str, Any] = {}
    for done, (key, case) in enumerate(cases.items()):
        if progress is not None:
            progress(f"{demonstration.name}: {case.label}", done / len(cases))
        runs[key] = case.run()
    numbers = {q.key: {key: q.measure(runs, key) for key in cases} for q in demonstration.quantities}
    rows = tuple(
        (case.label, *(_cell(q, numbers[q.key][key]) for q in demonstration.quantities)) for key, case in cases.items()
    )
    return DemonstrationResult(
        demonstration=demonstration,
        header=("run", *(q.header for q in demonstration.quantities)),
        rows=rows,
        numbers=numbers,
        answer=tuple(judge_claim(claim, numbers) for claim in demonstration.claims),
        curves=tuple(demonstration.picture.curves(runs, cases)),
        versions=_versions(runs.values(), demonstration.packages),
    )


def simulate(engine: Engine, scenario: Scenario) -> Trajectory:
    """Return the run of ``engine``, in this process, as the engines of the demonstrations neither crash nor hang.

    Raises
    ------
    MissingPackageError
        If the engine is not installed.
    """
    missing = missing_packages(engine)
    if missing:
        raise MissingPackageError(f"{label(engine)}: {missing[0]} is not installed; to get it: {how_to_get(missing[0])}")
    return engine.simulate(scenario)


def judge_claim(claim: Claim, numbers: MeasuredValues) -> JudgedClaim:
    """Test a claim, and fill in its numbers; a claim that does not hold may lack some of them."""
    try:
        text = claim.words.format_map(numbers)
    except (TypeError, ValueError):
        text = claim.words
    return JudgedClaim(text=text, holds=bool(claim.holds(numbers)))


def _cell(quantity: MeasuredColumn, value: Any) -> str:
    if value is None or (isinstance(value, float) and not math.isfinite(value)):
        return quantity.absent
    return value if isinstance(value, str) else format(value, quantity.digits)


def _versions(runs: Any, packages: Sequence[str]) -> dict[str, str]:
    versions = {package: installed_version(package) for package in ("looping-pendulum", *packages)}
    for run in runs:
        if isinstance(run, Trajectory):
            versions |= run.provenance.versions
    return dict(sorted(versions.items()))


def run_reference(scenario: Scenario) -> Trajectory:
    """Return the exact reference's run of ``scenario``, sampled once a millisecond."""
    return simulate(ReferenceEngine(available_integrators()[0], Profile.ACCURATE), scenario)


def reference_case(
    scenario: Scenario, key: str = "reference", label: str = "reference", *, main: bool = True
) -> DemonstrationCase:
    """Return the case of the exact reference; one that is not ``main`` is drawn in colour like the engines."""
    return DemonstrationCase(key=key, label=label, run=lambda: run_reference(scenario), reference=main)


def halting_time(parameters: Parameters) -> MeasuredColumn:
    """Return the column of the time at which the heavy mass comes to rest for good."""

    def measure(runs: Runs, key: str) -> float | None:
        return halting_time_of(runs[key], parameters)

    return MeasuredColumn(key="halt", header="M2 halts at [s]", measure=measure, digits=".4f", absent="never")


def halting_time_of(run: Trajectory, parameters: Parameters) -> float | None:
    """Return the halting time of a run [s]: the reference's own event, or an engine's, from its samples; None: never."""
    halts = [event.time for event in run.events if event.name == "halt"]
    if halts or run.events:
        return halts[0] if halts else None
    return run_landmarks(run, parameters).halting_time


def rms_distance(runs: Runs, key: str, to: str, until: float) -> float | None:
    """Return the RMS distance [mm] of the light mass from that of run ``to`` until ``until`` [s]; None for that run itself."""
    if key == to:
        return None
    run, other = runs[key], runs[to]
    count = min(len(run.t), len(other.t), round(until / 1e-3) + 1)
    distances = np.linalg.norm(run.light_position[:count] - other.light_position[:count], axis=1)
    return 1e3 * float(np.sqrt(np.mean(distances**2)))


def first_index_apart(run: Trajectory, other: Trajectory, limit: float) -> int | None:
    """Return the index of the first sample whose light mass is more than ``limit`` [m] from the other run's, or None."""
    count = min(len(run.t), len(other.t))
    beyond = np.flatnonzero(np.linalg.norm(run.light_position[:count] - other.light_position[:count], axis=1) > limit)
    return int(beyond[0]) if len(beyond) else None


def _largest_drop(runs: Runs, key: str) -> float:
    """Return how far the heavy mass fell at most [cm]."""
    return 100 * float(np.max(runs[key].heavy_drop))


TEN_TO_ONE: Scenario = load("ten_to_one")
PARAMETERS = TEN_TO_ONE.parameters
LARGEST_DROP = MeasuredColumn(key="lowest", header="M2 falls at most [cm]", measure=_largest_drop, digits=".1f")
"""Of the scenario from which nearly all experiments start."""


def drop_curves(runs: Runs, cases: Mapping[str, DemonstrationCase]) -> Sequence[FigureCurve]:
    """Return curves of how far the heavy mass has fallen [cm], against time."""
    return curves_over_time(lambda run: 100 * run.heavy_drop)(runs, cases)


def curves_over_time(
    value: Callable[[Trajectory], Any],
) -> Callable[[Runs, Mapping[str, DemonstrationCase]], Sequence[FigureCurve]]:
    """Return a function that makes curves of ``value`` against time."""

    def curves(runs: Runs, cases: Mapping[str, DemonstrationCase]) -> Sequence[FigureCurve]:
        return [
            FigureCurve(label=case.label, x=runs[key].t, y=value(runs[key]), reference=case.reference)
            for key, case in cases.items()
        ]

    return curves
