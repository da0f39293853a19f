"""Measure how reliable `identify` is, on blind studies of the separate simulator: `python -m research.calibration`.

Every finished study is kept as a file of its own in the work folder; the same command goes on from there. A changed program
needs a new folder. `--outliers` shows that leaving outliers out does not hide effects: the same studies with one hidden
effect are judged four times, with and without points on another object, and with and without the search for such points.
"""

import argparse
import contextlib
import dataclasses
import datetime
import json
import math
import platform
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Any, Protocol
from unittest import mock

import numpy as np

from looping_pendulum.cli.terminal import ProgressBars
from looping_pendulum.discrepancy.blas import one_blas_thread
from looping_pendulum.discrepancy.candidates import MIN_SHARE_OF_MULTIPLIED
from looping_pendulum.discrepancy.evidence.explain import explain
from looping_pendulum.discrepancy.evidence.prior import MARGIN, VISIBLE, body_of
from looping_pendulum.discrepancy.fit import residual_noise
from looping_pendulum.discrepancy.identify import identify
from looping_pendulum.discrepancy.inputs import read_inputs
from looping_pendulum.discrepancy.result import (
    NORMAL_95,
    Identification,
    IdentifiedEffect,
    RankedExplanation,
    Verdict,
)
from looping_pendulum.errors import HarnessError
from looping_pendulum.files import write_atomically
from looping_pendulum.measured.study import Study
from looping_pendulum.measured.study_io import load
from looping_pendulum.reference_ode.effects import EFFECTS
from looping_pendulum.reference_ode.effects.own import multiplied_coefficient
from looping_pendulum.versions import MISSING, installed_version
from research import DATA, rates_page, rounded
from research.calibration_summary import NAMED, Outcome, proportion, summary
from tests.discrepancy.blind_sample import DEFAULT_COUNTS, KINDS, BlindStudy, draw, planted_values, write_files
from tests.discrepancy.expected import PLANTED_LAWS

Explained = tuple[frozenset[str], tuple[str, str] | None]
"""An explanation: its listed effects, and the body and coordinate of its law; None: it has no law."""
NOTHING: Explained = frozenset(), None
CAN_HIDE = frozenset({"rod_mobility"})
"""Effects that can hide at any size (`Identification.can_hide`), whatever the data."""
CLOCK_SET = "was taken as 0"
"""What the reader says of a clock that it has set."""
MIN_ARM_SIZE = 0.008
"""Smallest size of what is hidden where outliers are studied [m]: of smaller effects too few are named."""
ARM_NOISE_KINDS = ("white", "outliers")
RESULT = DATA / "calibration.json"


class Task(Protocol):
    """A frozen dataclass that says all that its outcome depends on."""

    @property
    def name(self) -> str:
        """Name of its file, without ending."""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options that say which blind studies are made, and where finished ones are kept."""
    for kind in KINDS:
        parser.add_argument(f"--{kind}", type=int, default=DEFAULT_COUNTS[kind], help=f"{kind} studies (%(default)s)")
    parser.add_argument("--share", type=float, default=1.0, help="share of these numbers, such as 0.1")
    parser.add_argument("--set", choices=("thresholds", "rates"), default="rates", help="which seeds")
    parser.add_argument("--seed", type=int, default=0, help="further seed")
    parser.add_argument("--work", type=Path, help="folder in which finished studies are kept")
    parser.add_argument("--jobs", type=int, default=1, help="processes")


def drawn_studies(options: argparse.Namespace) -> list[BlindStudy]:
    """Return the studies that the options ask for."""
    counts = {kind: round(getattr(options, kind) * options.share) for kind in KINDS}
    return [study for kind, count in counts.items() for study in draw(options.set, kind, count, options.seed)]


def work_folder(options: argparse.Namespace) -> Path:
    """Return the folder in which finished studies are kept; ends the program with a line if there is none."""
    if options.work is None:
        sys.exit("--work: found no folder, needed one that keeps finished studies; write for example --work calibration_runs")
    if not 0 < options.share or options.jobs < 1:
        sys.exit("--share, --jobs: found a number that is not positive, needed for example --share 0.1 --jobs 2")
    return Path(options.work)


def benchmark(options: argparse.Namespace) -> None:
    """Run the studies, print the summary and store it under the set's name in `RESULT`."""
    studies, folder = drawn_studies(options), work_folder(options)
    outcomes, interrupted = run(studies, solve, folder, jobs=options.jobs, title=f"calibration, {options.set}")
    result = summary([(study, outcomes[study.name]) for study in studies if study.name in outcomes])
    block = provenance(options, "calibration") | {"summary": result}
    if result["studies"]:
        print(rates_page.block(block))
    if interrupted:
        sys.exit(130)
    store(RESULT, options.set, block)


def run(
    tasks: Sequence[Task],
    solve: Callable[[Any], tuple[str, Outcome]],
    folder: Path,
    *,
    jobs: int = 1,
    title: str = "",
) -> tuple[dict[str, Outcome], bool]:
    """Solve tasks; those that ``folder`` has are not solved again.

    Parameters
    ----------
    solve
        Function of a module that returns a task's name and outcome (plain data).
    jobs
        Number of processes.

    Returns
    -------
    Name -> outcome of all tasks that are finished, in the order of the tasks, and whether Ctrl-C ended the run.
    """
    known = {task.name: outcome for task in tasks if (outcome := _stored(folder, task)) is not None}
    by_name = {task.name: task for task in tasks}
    waiting = [task for task in tasks if task.name not in known]
    interrupted = False
    with ProgressBars(time_left=True, line_every_fraction=0.1) as bars, ProcessPoolExecutor(jobs, get_context("spawn")) as pool:
        bars.update(title, len(known) / max(len(tasks), 1))
        try:
            for future in as_completed([pool.submit(solve, task) for task in waiting]):
                name, outcome = future.result()
                known[name] = outcome
                record = {"task": _as_json(by_name[name]), "outcome": outcome}
                write_atomically(folder / f"{name}.json", json.dumps(record, indent=1) + "\n")
                bars.update(f"{title}: {name}", len(known) / len(tasks))
        except KeyboardInterrupt:
            interrupted = True
            # The processes were interrupted, too, and end what they do
            pool.shutdown(wait=False, cancel_futures=True)
            print(f"interrupted; {len(known)} of {len(tasks)} are kept in {folder}", file=sys.stderr)
    return {task.name: known[task.name] for task in tasks if task.name in known}, interrupted


def _stored(folder: Path, task: Any) -> Outcome | None:
    """Return the stored outcome of a task; None: there is none, or it is that of another task of this name."""
    file = folder / f"{task.name}.json"
    if not file.exists():
        return None
    record = json.loads(file.read_text(encoding="utf-8"))
    return record["outcome"] if record["task"] == _as_json(task) else None


def _as_json(task: Any) -> Any:
    """Return a task as JSON has it, where a tuple is a list."""
    return json.loads(json.dumps(dataclasses.asdict(task)))


def store(file: Path, key: str, block: dict[str, Any]) -> None:
    """Store a block of results, beside those that the file has under other keys."""
    tree = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}
    tree[key] = block
    write_atomically(file, json.dumps(rounded(dict(sorted(tree.items()))), indent=1) + "\n")
    print(f"wrote {file}")


def provenance(options: argparse.Namespace, name: str) -> dict[str, Any]:
    """Return the command, the day and the versions of a measurement."""
    counts = [f" --{kind} {getattr(options, kind)}" for kind in KINDS if getattr(options, kind) != DEFAULT_COUNTS[kind]]
    seed = f" --seed {options.seed}" if options.seed else ""
    versions = {p: installed_version(p) for p in ("looping-pendulum", "numpy", "scipy", "wasmtime", "lmfit", "scikit-learn")}
    return {
        "command": f"python -m research.{name} --set {options.set}{seed} --share {options.share:g}" + "".join(counts),
        "seed": options.seed,
        "measured_on": datetime.date.today().isoformat(),
        "machine": platform.machine(),
        "versions": {"python": platform.python_version()} | {p: v for p, v in versions.items() if v != MISSING},
    }


def solve(study: BlindStudy) -> tuple[str, Outcome]:
    """Make a study, identify what is missing, and return its name and the outcome.

    Raises
    ------
    KeyboardInterrupt
        If Ctrl-C ended the search, so that half an outcome is not kept.
    """
    with tempfile.TemporaryDirectory() as folder:
        try:
            path = write_files(study, Path(folder))
        except ValueError as error:  # no value of the hidden number gives the size
            return study.name, {"unreachable": str(error)}
        loaded = load(path)
        if "clock_offset" in study.hidden and any(
            CLOCK_SET in said for _, o in read_inputs(loaded).observed for said in o.assumptions
        ):
            return study.name, {"unreachable": "the reader sets a clock that begins elsewhere while the masses rest"}
        started = time.process_time()
        try:
            result = identify(loaded)
        except HarnessError as error:
            return study.name, {"failed": str(error), "cpu_seconds": time.process_time() - started}
        if result.verdict is Verdict.INTERRUPTED:
            raise KeyboardInterrupt
        outcome = outcome_of(result, planted_values(study), truth(study))
        outcome["cpu_seconds"] = time.process_time() - started
        # No rate needs them, and they take as long as the search
        if study.set == "thresholds" and study.kind == "clean" and study.noise_kind != "wander":
            outcome["statistics"] = statistics_of_tests(loaded)
    return study.name, outcome


def truth(study: BlindStudy) -> Explained:
    """Return what is hidden in a study, as an explanation."""
    laws = [PLANTED_LAWS[name] for name in study.hidden if name in PLANTED_LAWS]
    return frozenset(planted_values(study)), (body_of(laws[0][0]), laws[0][1]) if laws else None


def outcome_of(result: Identification, planted: dict[str, float], right: Explained) -> Outcome:
    """Return what an identification says, beside what was planted.

    Each of the "probabilities" has effects, a law, the stated probability, and whether this is what was hidden.
    """
    named = [parts_of(e) for e in _named(result)]
    judged = judgement(named, right)
    effects = next((e.effects for e in _named(result) if parts_of(e) == right), ()) if judged in NAMED else ()
    probabilities: dict[Explained, float] = {}
    for e in result.explanations:
        probabilities[parts_of(e)] = probabilities.get(parts_of(e), 0.0) + (e.probability or 0.0)
    return {
        "verdict": result.verdict.value,
        "names": list(result.names),
        "explanations": [_plain(e) for e in dict.fromkeys(named)],
        "law": next((list(law) for _, law in named if law), None),
        "judgement": judged,
        "probabilities": [[*_plain(e), p, e == right] for e, p in probabilities.items() if p],
        "credible_holds_truth": right in map(parts_of, result.credible),
        "planted": planted,
        "estimates": [_estimate(effect, planted[effect.name]) for effect in effects],
        "visibility": visibility(result, planted),
        "held_out_error": max(e.standardised_rms_after for e in result.errors if e.held_out),
        "correlated_noise": bool(result.correlated_noise),
    }


def _named(result: Identification) -> tuple[RankedExplanation, ...]:
    """Return the explanations that a verdict names, the most probable first."""
    return () if result.verdict is Verdict.UNEXPLAINED else result.credible


def parts_of(e: RankedExplanation) -> Explained:
    """Return the effects of an explanation, and the body and coordinate of its law."""
    return frozenset(effect.name for effect in e.effects), (body_of(e.law.acts_on), e.law.depends_on) if e.law else None


def _plain(e: Explained) -> list[Any]:
    effects, law = e
    return [sorted(effects), list(law) if law else None]


def visibility(result: Identification, planted: dict[str, float]) -> float | None:
    """Return the planted change over the smallest one that the data could show, by the report; of two effects the smaller.

    None: nothing that the library lists was planted, or the report says nothing of it.
    """
    # Once it is named, its error is known, but not that of one that stays hidden: to count only the first would be unfair
    if not planted.keys().isdisjoint(CAN_HIDE) or _multiplies_zero(result, planted):
        return None
    smallest = {v.name: (v.value, v.null_value) for v in result.smallest_visible}
    effects = [effect for e in reversed(_named(result)) for effect in e.effects]
    smallest |= {e.name: (VISIBLE * _error_towards_null(e), e.null_value) for e in effects}
    if not planted or not planted.keys() <= smallest.keys():
        return None
    return min(abs(value - smallest[name][1]) / smallest[name][0] for name, value in planted.items())


def _error_towards_null(effect: IdentifiedEffect) -> float:
    """Return the standard error that the end of the 95 % interval on the side of the null value corresponds to [SI]."""
    low, high = effect.interval_95
    end = low if effect.value > effect.null_value else high
    return effect.error if end is None else abs(effect.value - end) / NORMAL_95


def _multiplies_zero(result: Identification, planted: Iterable[str]) -> bool:
    """Return whether a planted effect multiplies a coefficient that the declared model's fit has put to zero."""
    zero = {p.name for p in result.before.parameters if p.value < MIN_SHARE_OF_MULTIPLIED * p.measured}
    nulls = {c.name: c.null for effect in EFFECTS.values() for c in effect.coefficients}
    effects = [e for e in EFFECTS.values() if not e.in_base_model and any(c.name in planted for c in e.coefficients)]
    return any(multiplied_coefficient(e, nulls) in zero for e in effects)


def judgement(named: Sequence[Explained], right: Explained) -> str:
    """Return what a set of explanations is worth.

    "right": it is the only one, of a law its body and coordinate; "tied": it is one of several; "law": its effects are named
    beside another law; "part": a part of it is named; "none": nothing is said to be missing, or nothing explains the data;
    "wrong": something else is named. Of a clean study a set that holds that nothing is missing is right.
    """
    if not named or NOTHING in named:
        return "right" if named and right == NOTHING else "none"
    if right in named:
        return "right" if len(set(named)) == 1 else "tied"
    effects, law = right
    if law and any(e == effects and other for e, other in named):
        return "law"
    return "part" if any(e <= effects and other in (None, law) for e, other in named) else "wrong"


def _estimate(effect: IdentifiedEffect, planted: float) -> dict[str, Any]:
    low, high = effect.interval_95
    return {
        "name": effect.name,
        "value": effect.value,
        "error": effect.error,
        "interval": effect.interval,
        "planted": planted,
        "within": (low is None or low <= planted) and (high is None or planted <= high),
    }


def statistics_of_tests(study: Study) -> dict[str, float]:
    """Return the statistics of the declared model's tests, each as far from noise as any group has it.

    The odds are those of the most probable explanation that adds something; if none comes near, those from which on it would.
    """
    with one_blas_thread():
        found, _ = explain(read_inputs(study))
        declared = found.judged(found.nothing)
    tests, groups = declared.tests, declared.tests.groups
    odds = [e.log_posterior - found.nothing.log_posterior for e in found.ranked if e.key]
    return {
        "chi2_per_dof": tests.chi2_per_dof,
        "chi2_over_limit": tests.chi2_per_dof / tests.limit,
        "lasting_z": max(g.lasting for g in groups),
        "held_out_chi2": declared.held_out.worst,
        "log10_odds": max(odds, default=-MARGIN) / math.log(10),
        "values": float(tests.count),
    }


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


def outliers(options: argparse.Namespace) -> None:
    """Judge every study in every way, print the table, and store it beside the rates."""
    studies = [s for s in drawn_studies(options) if s.kind == "single" and s.size and s.size >= MIN_ARM_SIZE]
    arms = [
        Arm(study=dataclasses.replace(s, noise_kind=kind), finds_outliers=finds)
        for s in studies
        for kind in ARM_NOISE_KINDS
        for finds in (True, False)
    ]
    outcomes, interrupted = run(arms, solve_arm, work_folder(options), jobs=options.jobs, title="outliers")
    rows = outlier_rows([(arm, outcomes[arm.name]) for arm in arms if arm.name in outcomes])
    block = provenance(options, "calibration --outliers") | {"rows": rows}
    print(rates_page.outliers_block(block))
    if interrupted:
        sys.exit(130)
    store(RESULT, "outliers", block)


def solve_arm(arm: Arm) -> tuple[str, Outcome]:
    """Judge one study in one way."""
    with contextlib.nullcontext() if arm.finds_outliers else no_search():
        _, outcome = solve(arm.study)
    return arm.name, outcome


@contextlib.contextmanager
def no_search() -> Iterator[None]:
    """Take every point for one of the mass."""
    with mock.patch.object(residual_noise, "find_outliers", lambda residual, *_: np.zeros(len(residual), dtype=bool)):
        yield


def outlier_rows(pairs: Sequence[tuple[Arm, Outcome]]) -> list[dict[str, Any]]:
    """Return a row for each way: how often the hidden effect is named, and the errors of values relative to the first way's."""
    judged = {(a.study.index, a.study.noise_kind, a.finds_outliers): o for a, o in pairs if "judgement" in o}
    ways = [(kind, finds) for kind in ARM_NOISE_KINDS for finds in (True, False)]
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


def main() -> None:
    """Judge the studies that the options ask for."""
    parser = argparse.ArgumentParser(description=__doc__)
    add_options(parser)
    parser.add_argument("--outliers", action="store_true", help="judge each study four times, with and without outliers")
    options = parser.parse_args()
    (outliers if options.outliers else benchmark)(options)


if __name__ == "__main__":
    main()
