"""Demonstrations of what a model assumes: a question, a guess, an experiment that is run, an answer that its numbers carry.

A demonstration is data. Its answer is made of claims; each has a test on the numbers of the run, and a claim whose test fails
is shown as not borne out, never as an answer.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import version
from typing import Any

from looping_pendulum.engines.protocol import Engine
from looping_pendulum.engines.registry import how_to_get, label, missing_packages
from looping_pendulum.engines.trajectory import Trajectory
from looping_pendulum.errors import HarnessError, MissingPackageError
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.scenarios.scenario import Scenario

Numbers = Mapping[str, Mapping[str, Any]]
"""Quantity -> case -> what was measured: ``numbers["halt"]["reference"]``; None where there is nothing to measure."""
Progress = Callable[[str, float], None]
"""Called with what goes on, and the share of the work that is done."""


class DemonstrationError(HarnessError, ValueError):
    """A demonstration cannot be shown."""


@dataclass(frozen=True, kw_only=True)
class DemonstrationCase:
    """One run of an experiment."""

    key: str
    """What claims call it."""
    label: str
    """What tables and figures call it."""
    run: Callable[[], Any]
    """Makes the run; what it returns goes to the quantities and curves."""
    reference: bool = False
    """Whether it is what the others are held against: drawn black."""


@dataclass(frozen=True, kw_only=True)
class MeasuredColumn:
    """Something measured in every case: a column of the table."""

    key: str
    """What claims call it."""
    header: str
    """With unit."""
    measure: Callable[[Mapping[str, Any], str], Any]
    """Takes the runs by case and the case's key; returns a number, text, or None."""
    digits: str = ".3f"
    """Format of a number."""
    absent: str = "–"
    """What stands in the table for None."""


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
    """Label of the axis, with unit."""
    y: str
    caption: str
    """What to see; also the text for those who do not see it."""
    curves: Callable[[Mapping[str, Any], Mapping[str, DemonstrationCase]], Sequence[FigureCurve]]


@dataclass(frozen=True, kw_only=True)
class Claim:
    """One sentence of an answer."""

    words: str
    """Template over `Numbers`: "halts at {halt[reference]:.3f} s"."""
    holds: Callable[[Numbers], bool]
    """Whether the numbers bear the sentence out."""


@dataclass(frozen=True, kw_only=True)
class Demonstration:
    """One page."""

    name: str
    """Name on the command line and of its files."""
    title: str
    question: str
    guess: str
    experiment: str
    """What is run, in words."""
    scenario: str
    """Shipped scenario that it starts from."""
    change: str
    """What to change in it oneself, as lines of YAML or of a command."""
    commands: tuple[str, ...]
    """To see it oneself."""
    cases: Callable[[], tuple[DemonstrationCase, ...]]
    quantities: tuple[MeasuredColumn, ...]
    claims: tuple[Claim, ...]
    picture: DemonstrationFigure
    packages: tuple[str, ...] = ()
    """Packages that run, where the runs do not tell."""


@dataclass(frozen=True, kw_only=True)
class JudgedClaim:
    """A claim after the run."""

    text: str
    holds: bool


@dataclass(frozen=True, kw_only=True)
class DemonstrationResult:
    """A demonstration that was run."""

    demonstration: Demonstration
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    numbers: Numbers
    answer: tuple[JudgedClaim, ...]
    curves: tuple[FigureCurve, ...]
    versions: Mapping[str, str] = field(default_factory=dict)
    """Package -> version of what ran."""

    @property
    def borne_out(self) -> bool:
        """Whether every claim holds in this run."""
        return all(sentence.holds for sentence in self.answer)


def show(demonstration: Demonstration, progress: Progress | None = None) -> DemonstrationResult:
    """Run the experiment of ``demonstration`` and put its page's content together.

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
        answer=tuple(_said(claim, numbers) for claim in demonstration.claims),
        curves=tuple(demonstration.picture.curves(runs, cases)),
        versions=_versions(runs.values(), demonstration.packages),
    )


def simulated(engine: Engine, scenario: Scenario) -> Trajectory:
    """Run of ``engine``, in this process: these engines neither crash nor hang.

    Raises
    ------
    MissingPackageError
        If it is not installed.
    """
    missing = missing_packages(engine)
    if missing:
        raise MissingPackageError(f"{label(engine)}: {missing[0]} is not installed; to get it: {how_to_get(missing[0])}")
    return engine.simulate(scenario)


def _said(claim: Claim, numbers: Numbers) -> JudgedClaim:
    """Write a claim with its numbers; one that does not hold may lack the numbers that it speaks of."""
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
    found = {package: version(package) for package in ("looping-pendulum", *packages)}
    for run in runs:
        if isinstance(run, Trajectory):
            found |= run.provenance.versions
    return dict(sorted(found.items()))
