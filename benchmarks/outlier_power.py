"""Show that leaving outliers out does not hide effects: `python -m benchmarks --only outliers`.

The same blind studies with one hidden effect are judged four times: with and without points on another object, and with and
without the search for such points.
"""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any
from unittest import mock

import numpy as np

from benchmarks import calibration, rates_page
from benchmarks.blind_sample import BlindStudy
from benchmarks.calibration_summary import NAMED, Outcome, proportion
from looping_pendulum.discrepancy.fit import residual_noise

MIN_SIZE = 0.008
"""Smallest size of what is hidden [m]: of smaller effects too few are named."""
NOISE_KINDS = ("white", "outliers")


@dataclass(frozen=True, kw_only=True)
class Arm:
    """One of the ways in which a study is judged."""

    study: BlindStudy
    finds_outliers: bool
    """Whether outliers are searched for and left out."""

    @property
    def name(self) -> str:
        """Name of its file in the work folder, without ending."""
        search = "search" if self.finds_outliers else "no-search"
        return f"{self.study.name}-{self.study.noise_kind}-{search}"


def benchmark(options: argparse.Namespace) -> None:
    """Judge every study in every way, print the table, and store it beside the rates."""
    studies = [s for s in calibration.drawn_studies(options) if s.kind == "single" and s.size and s.size >= MIN_SIZE]
    arms = [
        Arm(study=dataclasses.replace(s, noise_kind=kind), finds_outliers=finds)
        for s in studies
        for kind in NOISE_KINDS
        for finds in (True, False)
    ]
    outcomes, interrupted = calibration.run(arms, solve, calibration.work_folder(options), jobs=options.jobs, title="outliers")
    rows = summary([(arm, outcomes[arm.name]) for arm in arms if arm.name in outcomes])
    block = calibration.provenance(options, "outliers") | {"rows": rows}
    print(rates_page.outliers_block(block))
    if interrupted:
        sys.exit(130)
    calibration.store(calibration.RESULT, "outliers", block)


def solve(arm: Arm) -> tuple[str, Outcome]:
    """Judge one study in one way."""
    with contextlib.nullcontext() if arm.finds_outliers else no_search():
        _, outcome = calibration.solve(arm.study)
    return arm.name, outcome


@contextlib.contextmanager
def no_search() -> Iterator[None]:
    """Take every point for one of the mass."""
    with mock.patch.object(residual_noise, "find_outliers", lambda residual, *_: np.zeros(len(residual), dtype=bool)):
        yield


def summary(pairs: Sequence[tuple[Arm, Outcome]]) -> list[dict[str, Any]]:
    """Return a row for each way: how often the hidden effect is named, and the errors of values relative to the first way's."""
    judged = {(a.study.index, a.study.noise_kind, a.finds_outliers): o for a, o in pairs if "judgement" in o}
    ways = [(kind, finds) for kind in NOISE_KINDS for finds in (True, False)]
    complete = sorted({i for i, *_ in judged if all((i, *way) in judged for way in ways)})
    rows = []
    for way in ways:
        outcomes = [judged[(i, *way)] for i in complete]
        ratios = [
            o["estimates"][0]["error"] / first["estimates"][0]["error"]
            for o, first in zip(outcomes, (judged[(i, *ways[0])] for i in complete), strict=True)
            if o["estimates"] and first["estimates"]
        ]
        rows.append(
            {
                "points": way[0],
                "finds_outliers": way[1],
                "named_or_tied": proportion(sum(o["judgement"] in NAMED for o in outcomes), len(outcomes)),
                "wrong": proportion(sum(o["judgement"] == "wrong" for o in outcomes), len(outcomes)),
                "unexplained": proportion(sum(o["verdict"] == "unexplained" for o in outcomes), len(outcomes)),
                "standard_error_ratio": float(np.median(ratios)) if ratios else None,
            }
        )
    return rows
