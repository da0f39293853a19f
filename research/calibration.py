"""Measure how reliable `identify` is, on blind studies of the separate simulator: `python -m research.calibration --work DIR`.

Each study is judged by `identify`, which reads only its files, and fitted with exactly what was hidden, which tells what its
data show. Every finished study is kept as a file of its own in the work folder; the same command goes on from there. A changed
program needs a new folder.
"""

import argparse
import dataclasses
import datetime
import json
import platform
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import looping_pendulum as lp
from looping_pendulum.cli.terminal import ProgressBars
from looping_pendulum.discrepancy.inputs import read_inputs
from looping_pendulum.discrepancy.result import FittedEffect, Identification, RankedExplanation, Verdict
from looping_pendulum.files import write_atomically
from looping_pendulum.versions import MISSING, installed_version
from research import DATA, rates_page, rounded
from research.calibration_summary import NAMED, summary
from research.known_answer import LAW, Outcome, known_answer, log_odds, shown_parts
from tests.discrepancy.blind_sample import COUNTS, BlindStudy, draw, planted_values, write_files
from tests.discrepancy.expected import NOTHING, Explained, parts_of, truth

CLOCK_SET = "was taken as 0"
"""What the reader says of a clock that it has set."""
RESULT = DATA / "calibration.json"


def drawn_studies(options: argparse.Namespace) -> list[BlindStudy]:
    """Return the studies that the options ask for."""
    counts = {kind: round(count * options.share) for kind, count in COUNTS.items()}
    return [study for kind, count in counts.items() for study in draw(kind, count, options.seed)]


def benchmark(options: argparse.Namespace) -> None:
    """Judge the studies, print the page of their rates, and store what it is written from in `RESULT`."""
    studies = drawn_studies(options)
    outcomes, interrupted = run(studies, options.work, jobs=options.jobs)
    result = provenance(options) | summary([(study, outcomes[study.name]) for study in studies if study.name in outcomes])
    print(rates_page.page(result))
    if interrupted:
        sys.exit(130)
    write_atomically(options.result, json.dumps(rounded(result), indent=1) + "\n")
    print(f"wrote {options.result}")


def run(
    studies: Sequence[BlindStudy],
    folder: Path,
    *,
    jobs: int = 1,
    judge: Callable[[BlindStudy], tuple[str, Outcome]] | None = None,
) -> tuple[dict[str, Outcome], bool]:
    """Judge studies in ``jobs`` processes; those that ``folder`` has are not judged again.

    Parameters
    ----------
    judge
        Function of a module that returns a study's name and outcome; None: `solve`.

    Returns
    -------
    Name -> outcome of all studies that are finished, in their order, and whether Ctrl-C ended the run.
    """
    known = {study.name: outcome for study in studies if (outcome := _stored(folder, study)) is not None}
    by_name = {study.name: study for study in studies}
    interrupted = False
    with ProgressBars(time_left=True) as bars, ProcessPoolExecutor(jobs, get_context("spawn")) as pool:
        bars.update("blind studies", len(known) / max(len(studies), 1))
        try:
            for future in as_completed(
                [pool.submit(judge or solve, study) for name, study in by_name.items() if name not in known]
            ):
                name, outcome = future.result()
                known[name] = outcome
                record = {"study": _as_json(by_name[name]), "outcome": outcome}
                write_atomically(folder / f"{name}.json", json.dumps(record, indent=1) + "\n")
                bars.update(f"blind studies: {name}", len(known) / len(studies))
        except KeyboardInterrupt:
            interrupted = True
            # The processes were interrupted, too, and end what they do
            pool.shutdown(wait=False, cancel_futures=True)
            print(f"interrupted; {len(known)} of {len(studies)} are kept in {folder}", file=sys.stderr)
    return {name: known[name] for name in by_name if name in known}, interrupted


def _stored(folder: Path, study: BlindStudy) -> Outcome | None:
    """Return the stored outcome of a study; None: there is none, or it is that of another study of this name."""
    file = folder / f"{study.name}.json"
    if not file.exists():
        return None
    record = json.loads(file.read_text(encoding="utf-8"))
    return record["outcome"] if record["study"] == _as_json(study) else None


def _as_json(study: BlindStudy) -> Any:
    """Return a study as JSON has it, where a tuple is a list."""
    return json.loads(json.dumps(dataclasses.asdict(study)))


def provenance(options: argparse.Namespace) -> dict[str, Any]:
    """Return the command, the day and the versions of a measurement."""
    versions = {p: installed_version(p) for p in ("looping-pendulum", "numpy", "scipy", "wasmtime")}
    share = "" if options.share == 1 else f" --share {options.share:g}"
    return {
        "command": f"python -m research.calibration --seed {options.seed}{share}",
        "seed": options.seed,
        "measured_on": datetime.date.today().isoformat(),
        "machine": platform.machine(),
        "versions": {"python": platform.python_version()} | {p: v for p, v in versions.items() if v != MISSING},
    }


def solve(study: BlindStudy) -> tuple[str, Outcome]:
    """Make a study, judge it and fit it with what was hidden, and return its name and the outcome.

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
        loaded = lp.load_study(path)
        if "clock_offset" in study.hidden and any(
            CLOCK_SET in said for _, o in read_inputs(loaded).observed for said in o.assumptions
        ):
            return study.name, {"unreachable": "the reader sets a clock that begins elsewhere while the masses rest"}
        started = time.process_time()
        try:
            result = lp.identify(loaded)
        except Exception as error:  # whatever it is: a rate that leaves such studies out says so
            return study.name, {"failed": repr(error), "cpu_seconds": time.process_time() - started}
        if result.verdict is Verdict.INTERRUPTED:
            raise KeyboardInterrupt
        seconds = time.process_time() - started
        known = known_answer(study, path) if study.hidden else None
    return study.name, outcome_of(result, study, known) | {"cpu_seconds": seconds}


def outcome_of(result: Identification, study: BlindStudy, known: Outcome | None) -> Outcome:
    """Return what an identification says, beside what was hidden and what the data show of it.

    Each of the "probabilities" has effects, a law, the stated probability, and whether it is what the data show of what was
    hidden: of all of it, or of the most probable part by the fits with the known answer.
    """
    right = truth(study.hidden)
    named = [parts_of(e) for e in _named(result)]
    judged = judgement(named, right)
    effects = next((e.effects for e in _named(result) if parts_of(e) == right), ()) if judged in NAMED else ()
    rights = {right, _shown(known, right) if known else NOTHING}
    probabilities: dict[Explained, float] = {}
    for e in result.explanations:
        probabilities[parts_of(e)] = probabilities.get(parts_of(e), 0.0) + (e.probability or 0.0)
    planted = planted_values(study)
    return {
        "verdict": result.verdict.value,
        "explanations": [_plain(e) for e in dict.fromkeys(named)],
        "judgement": judged,
        "log_odds": log_odds(known) if known else None,
        "known_answer": known,
        "probabilities": [[*_plain(e), p, e in rights] for e, p in probabilities.items() if p],
        "estimates": [_estimate(effect, planted[effect.name]) for effect in effects],
        "explanations_fitted": result.explanations_fitted,
        "held_out_error": max((e.standardised_rms_after for e in result.errors if e.held_out), default=None),
    }


def _shown(known: Outcome, right: Explained) -> Explained:
    """Return what the data show of what was hidden: the most probable part of it, or all of it where that is not known."""
    shown = shown_parts(known)
    if shown is None:
        return right
    law = right[1] if any(name.startswith(LAW) for name in shown) else None
    return frozenset(name for name in shown if not name.startswith(LAW)), law


def _named(result: Identification) -> tuple[RankedExplanation, ...]:
    """Return the explanations that a verdict names, the most probable first."""
    return () if result.verdict is Verdict.UNEXPLAINED else result.credible


def _plain(e: Explained) -> list[Any]:
    effects, law = e
    return [sorted(effects), list(law) if law else None]


def judgement(named: Sequence[Explained], right: Explained) -> str:
    """Return what a set of explanations is worth.

    "right": it is the only one, of a law its body and coordinate; "tied": it is one of several, perhaps beside that nothing is
    missing; "law": its effects are named beside another law; "part": a part of it is named; "none": nothing may be missing, or
    nothing explains the data; "wrong": something else is named. Of a clean study a set that holds that nothing is missing is
    right.
    """
    if right in named:
        return "right" if len(set(named)) == 1 or right == NOTHING else "tied"
    if not named or NOTHING in named:
        return "none"
    effects, law = right
    if law and any(e == effects and other for e, other in named):
        return "law"
    return "part" if any(e <= effects and other in (None, law) for e, other in named) else "wrong"


def _estimate(effect: FittedEffect, planted: float) -> dict[str, Any]:
    low, high = effect.interval_95
    return {
        "name": effect.name,
        "value": effect.value,
        "error": effect.error,
        "interval": effect.interval,
        "planted": planted,
        "within": (low is None or low <= planted) and (high is None or planted <= high),
    }


def main() -> None:
    """Judge the studies that the options ask for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--work", type=Path, required=True, help="folder in which finished studies are kept")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--share", type=float, default=1.0, help=f"share of {sum(COUNTS.values())} studies, such as 0.05")
    parser.add_argument("--seed", type=int, default=0, help="seed of the studies")
    parser.add_argument("--result", type=Path, default=RESULT, help="file of the results (%(default)s)")
    options = parser.parse_args()
    if options.share <= 0 or options.jobs < 1:
        parser.error("--share, --jobs: found a number that is not positive, needed for example --share 0.1 --jobs 2")
    benchmark(options)


if __name__ == "__main__":
    main()
