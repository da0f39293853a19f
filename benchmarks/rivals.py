"""Let other methods name what is missing in the blind studies of the calibration: `python -m benchmarks --only rivals`.

Each method gets the data of a study, the declared model and, where it names effects, the same candidates as `identify`, whose
outcomes come from the calibration if the work folder is the same. Studies of a single trial are left out: not every method can
hold out blocks of time. A method whose package is not installed is not run, and the table says so.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import calibration
from benchmarks.blind_sample import KINDS, BlindStudy, planted_values, write_files
from benchmarks.calibration_summary import JUDGEMENTS, in_words, proportion
from benchmarks.resumable import Outcome, run
from benchmarks.rival_methods import METHODS, NOT_ASKED, Rival
from looping_pendulum.discrepancy.inputs import read_inputs
from looping_pendulum.errors import HarnessError
from looping_pendulum.installation import install_command
from looping_pendulum.measured.study_io import load

RESULT = Path(__file__).parents[1] / "docs" / "data" / "rivals.json"
OURS = "identify"


@dataclass(frozen=True, kw_only=True)
class RivalRun:
    """One method on one study."""

    study: BlindStudy
    method: str
    """A key of `METHODS`."""

    @property
    def name(self) -> str:
        """Name of its file in the work folder, without ending."""
        return f"{self.study.name}-{self.method}"


def benchmark(options: argparse.Namespace) -> None:
    """Run all methods on the studies, print the table and store it under the set's name in `RESULT`."""
    studies = [s for s in calibration.drawn_studies(options) if s.trials > 1]
    folder = calibration.work_folder(options)
    machine = {"jobs": options.jobs, "cluster": options.cluster}
    installed = [name for name, m in METHODS.items() if not m.package or find_spec(m.package)]
    runnable = [name for name in installed if name in (options.method or METHODS)]
    not_run = {
        m.title: NOT_ASKED if name in installed else f"{m.package} is missing: {install_command('-e', '.[benchmark]')}"
        for name, m in METHODS.items()
        if name not in runnable
    }
    ours, interrupted = run(studies, calibration.solve, folder, title=OURS, **machine)
    outcomes = {OURS: [(s, ours[s.name]) for s in studies if s.name in ours]}
    for method in runnable:
        if interrupted:
            break
        runs = [RivalRun(study=s, method=method) for s in studies]
        done, interrupted = run(runs, solve, folder, title=method, **machine)
        outcomes[method] = [(r.study, done[r.name]) for r in runs if r.name in done]
    result = {method: summary(pairs) for method, pairs in outcomes.items()}
    losses = lost_studies(outcomes)
    print_table(options.set, result, not_run, losses)
    if interrupted:
        sys.exit(130)
    block = {"studies": len(studies), "methods": result, "not_run": not_run, "losses_of_identify": losses}
    calibration.store(RESULT, options.set, calibration.provenance(options, "rivals") | block)


def solve(task: RivalRun) -> tuple[str, Outcome]:
    """Make a study again, let the method judge it, and return the run's name and the outcome."""
    study = task.study
    with tempfile.TemporaryDirectory() as folder:
        try:
            path = write_files(study, Path(folder))
        except ValueError as error:  # no value of the hidden number gives the size
            return task.name, {"unreachable": str(error)}
        started = time.process_time()
        try:
            says = METHODS[task.method].function(read_inputs(load(path)))
        except (HarnessError, ArithmeticError, ValueError) as error:
            return task.name, {"failed": str(error), "cpu_seconds": time.process_time() - started}
    return task.name, {
        "names": list(says.names),
        "departs": says.departs,
        "judgement": judgement(says, set(planted_values(study)), study.kind),
        "held_out_error": says.held_out_error,
        "cpu_seconds": time.process_time() - started,
    }


def judgement(says: Rival, planted: set[str], kind: str) -> str:
    """Return "right", "part", "wrong" or "none"; of a clean study only that nothing is missing is right.

    A method that finds that something is missing in a clean study gives a false alarm, whether it names an effect or not.
    """
    if kind == "clean":
        return "wrong" if says.departs else "right"
    names = set(says.names)
    if not names:
        return "none"
    if kind not in ("unlisted", "mixed") and names == planted:
        return "right"
    return "part" if names <= planted else "wrong"


def summary(pairs: Sequence[tuple[BlindStudy, Outcome]]) -> dict[str, Any]:
    """Return one method's shares by kind of study, its false alarms, held-out errors and seconds."""
    judged = [(s, o) for s, o in pairs if "judgement" in o]
    missing = [(s, o) for s, o in judged if s.kind != "clean"]
    held_out = [o["held_out_error"] for _, o in missing if o["held_out_error"] is not None]
    result: dict[str, Any] = {}
    for kind in KINDS:
        said = [o["judgement"] for s, o in judged if s.kind == kind]
        result[kind] = {j: proportion(said.count(j), len(said)) for j in JUDGEMENTS}
    result["detected"] = proportion(sum(_departs(o) for _, o in missing), len(missing))
    result["held_out_error"] = float(np.median(held_out)) if held_out else None
    result["cpu_seconds"] = float(np.median([o["cpu_seconds"] for _, o in judged])) if judged else None
    result["failed"] = sum("failed" in o for _, o in pairs)
    return result


def _departs(outcome: Outcome) -> bool:
    """Return whether a method says that something is missing."""
    return bool(outcome.get("departs", outcome.get("verdict") not in (None, "no_missing_effect")))


def lost_studies(outcomes: dict[str, list[tuple[BlindStudy, Outcome]]]) -> list[dict[str, Any]]:
    """Return the studies that another method judges right, and `identify` neither right nor tied."""
    by_method = {method: {s.name: o for s, o in pairs} for method, pairs in outcomes.items()}
    losses = []
    for study, ours in outcomes[OURS]:
        better = [m for m, said in by_method.items() if said.get(study.name, {}).get("judgement") == "right"]
        if better and ours.get("judgement") not in ("right", "tied"):
            losses.append(
                {"study": study.name, "hidden": list(study.hidden), "size": study.size, "noise": study.noise,
                 "ours": ours.get("verdict", "failed"), "right": better}
            )  # fmt: skip
    return losses


def print_table(title: str, result: dict[str, Any], not_run: dict[str, str], losses: Sequence[dict[str, Any]]) -> None:
    """Print the methods side by side, what was not run, and what `identify` loses."""
    from rich.console import Console
    from rich.table import Table

    console = Console()
    table = Table(title=f"{title}: methods on the same studies (95 % intervals)")
    columns = ("single: right", "single: tied", "single: wrong", "two: right", "false alarms", "detected", "held out", "CPU s")
    for column in ("method", *columns):
        table.add_column(column, justify="left" if column == "method" else "right")
    for method, r in result.items():
        error, seconds = (("-" if r[k] is None else f"{r[k]:.2f}") for k in ("held_out_error", "cpu_seconds"))
        shares = [r["single"]["right"], r["single"]["tied"], r["single"]["wrong"], r["two"]["right"], r["clean"]["wrong"]]
        table.add_row(method, *(in_words(share) for share in [*shares, r["detected"]]), error, seconds)
    console.print(table)
    for method, reason in not_run.items():
        console.print(f"not run: {method}: {reason}", markup=False)
    for loss in losses:
        hidden = " and ".join(loss["hidden"]) or "nothing"
        console.print(
            f"identify loses {loss['study']} ({hidden}): {loss['ours']}; right: {', '.join(loss['right'])}", markup=False
        )
