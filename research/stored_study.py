"""The stored engine study, research/data/engine_study.json: what it holds, and how single variants are renewed in it."""

import dataclasses
import json
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from looping_pendulum.compare.convergence.result import ConvergenceResult, RunSummary, VariantStudy
from looping_pendulum.compare.convergence.study import LEAST_NOISE
from looping_pendulum.compare.json_text import plain
from looping_pendulum.runs.trajectory import Supplier
from research import DATA, rounded

SUMMARY = DATA / "engine_study.json"
MARK = "path_0.7s"
"""Error that the page and its figures show."""
SAME_STUDY = ("scenario", "parameters", "until", "time_limit", "reference")
"""What two studies must have in common, so that their rows may stand in one table."""
STORED_DIGITS = 6
"""Significant digits of the stored numbers, more than the page prints."""
AGAIN = "make all runs of the study again instead"


@dataclass(frozen=True, kw_only=True)
class Point:
    """A timed rung."""

    variant: str
    where: str
    """ "time_step 1e-05", or empty at the variant's own settings."""
    key: str
    contact: bool
    """Whether the engine itself supplies winding and friction law."""
    rms: float
    """Root mean square error to 0.7 s [m]."""
    wall: float
    """Median wall seconds per simulated second."""
    cpu: float
    """Median CPU seconds per simulated second."""
    runs: int
    slowest: float
    """Largest wall seconds per simulated second of the runs."""


@dataclass(frozen=True, kw_only=True)
class Measurement:
    """When the rows of one variant were measured."""

    variant: str
    errors: str
    """Day on which the study of the variant's errors ended, "2026-11-22"."""
    times: str
    """Day on which its runs were timed; empty: none was."""
    timing_budget: float
    """Only settings whose run took at most this wall time in the study were timed [s]."""


@dataclass(frozen=True, kw_only=True)
class EngineStudy:
    """The stored data that the page is written from."""

    convergence: ConvergenceResult
    pareto: tuple[Point, ...]
    measurements: tuple[Measurement, ...]
    """One for each variant, in the same order."""

    def to_json(self) -> str:
        """Return the text of the stored data: one line per variant and timed point, to keep it small."""
        tree = {
            "schema": {"id": "looping-pendulum/engine-study", "version": 3},
            "convergence": json.loads(self.convergence.to_json()),
            "pareto": [dataclasses.asdict(p) for p in self.pareto],
            "measurements": [dataclasses.asdict(m) for m in self.measurements],
        }
        text = json.dumps(rounded(tree, STORED_DIGITS), indent=None, separators=(",", ":"))
        return text.replace('{"engine":', '\n{"engine":').replace('{"variant":', '\n{"variant":') + "\n"


def reported_runs(variant: VariantStudy) -> list[RunSummary]:
    """Return every run of a variant's study; one that is a rung of several ladders comes several times."""
    rungs = [rung.run for ladder in variant.ladders for rung in ladder.rungs]
    return [variant.own, *rungs, *(one.run for one in (*variant.choices, *variant.defaults))]


def read(text: str) -> EngineStudy:
    """Read `EngineStudy.to_json`'s text back."""
    tree = json.loads(text)
    return EngineStudy(
        convergence=ConvergenceResult.from_json(json.dumps(tree["convergence"])),
        pareto=tuple(Point(**p) for p in tree["pareto"]),
        measurements=tuple(Measurement(**m) for m in tree["measurements"]),
    )


def renewed(stored: EngineStudy, new: EngineStudy) -> EngineStudy:
    """Return ``stored`` with the variants of ``new`` in place of its own or, where it has none, behind them.

    Raises
    ------
    ValueError
        If the two studies were not made in the same way, or do not have the same reference values.
    """
    old, other = stored.convergence, new.convergence
    for name in SAME_STUDY:
        found, needed = (_comparable(plain(getattr(result, name))) for result in (other, old))
        if found != needed:
            raise ValueError(f"{name}: found {found}, the stored study has {needed}; {AGAIN}")
    for name, value in old.reference_values.items():
        again = other.reference_values[name]
        if (value is None) != (again is None) or (
            value is not None and again is not None and abs(value - again) > LEAST_NOISE[name]
        ):
            raise ValueError(f"reference: {name}: found {again}, the stored study has {value}; {AGAIN}")
    variants = {v.label: v for v in old.variants} | {v.label: v for v in other.variants}
    times = old.clock.run_times | other.clock.run_times
    # A renewed variant's former runs are not in the study any more
    keys = {run.key for v in variants.values() for run in reported_runs(v)}
    clock = dataclasses.replace(other.clock, run_times={key: times[key] for key in times.keys() & keys})
    points = [p for p in stored.pareto if p.variant not in {v.label for v in other.variants}] + list(new.pareto)
    measurements = {m.variant: m for m in (*stored.measurements, *new.measurements)}
    order = list(variants)
    return EngineStudy(
        convergence=dataclasses.replace(old, variants=tuple(variants.values()), clock=clock),
        pareto=tuple(sorted(points, key=lambda p: order.index(p.variant))),
        measurements=tuple(measurements[name] for name in order),
    )


def _comparable(value: Any) -> Any:
    """Return ``value`` as it is stored, without coefficients of zero: a later version of the package knows more of these."""
    if isinstance(value, dict):
        return {key: kept for key, item in value.items() if (kept := _comparable(item)) != 0.0}
    return rounded(value, STORED_DIGITS)


def supplied_by_engine(v: VariantStudy) -> bool:
    """Return whether the engine itself supplies winding and friction law."""
    supplies = v.provenance.supplies
    return supplies.winding.by is supplies.friction_law.by is Supplier.ENGINE


def front(timed_points: Iterable[Point]) -> list[Point]:
    """Return the Pareto front of the engines' points in time and error, from fast to slow; the reference is left out."""
    engines = [p for p in timed_points if p.variant != "reference"]
    best = [p for p in engines if not any(o is not p and o.cpu <= p.cpu and o.rms <= p.rms for o in engines)]
    return sorted(best, key=lambda p: p.cpu)
