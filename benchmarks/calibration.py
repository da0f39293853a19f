"""Measure how reliable `identify` is, on blind studies of the separate simulator: `python -m benchmarks --only calibration`.

Every finished study is kept as a file of its own in the work folder; the same command goes on from there. A changed program
needs a new folder.
"""

from __future__ import annotations

import argparse
import datetime
import json
import platform
import sys
import tempfile
import time
from collections.abc import Collection, Iterable
from pathlib import Path
from typing import Any

from benchmarks.blind_sample import DEFAULT_COUNTS, KINDS, BlindStudy, draw, planted_values, write_files
from benchmarks.calibration_summary import print_summary, summary
from benchmarks.resumable import Outcome, run
from benchmarks.rounding import rounded
from looping_pendulum.discrepancy.data.study import Study
from looping_pendulum.discrepancy.data.study_io import load
from looping_pendulum.discrepancy.fit.calibration import calibrate
from looping_pendulum.discrepancy.fit.problem import Problem
from looping_pendulum.discrepancy.fit.residual_noise import refit_with_estimated_noise
from looping_pendulum.discrepancy.identify import identify
from looping_pendulum.discrepancy.inputs import read_inputs
from looping_pendulum.discrepancy.listed.candidates import MIN_SHARE_OF_MULTIPLIED
from looping_pendulum.discrepancy.listed.screening import MAX_NULL_SCORE
from looping_pendulum.discrepancy.result import NORMAL_95, Identification, IdentifiedEffect, Unlisted, Verdict
from looping_pendulum.discrepancy.search import Search
from looping_pendulum.discrepancy.unlisted.screening import motions, responses_of, screen
from looping_pendulum.errors import HarnessError
from looping_pendulum.files import write_atomically
from looping_pendulum.reference_ode.effects import EFFECTS
from looping_pendulum.reference_ode.effects.check import multiplied_coefficient
from looping_pendulum.versions import MISSING, installed_version

CAN_HIDE = frozenset({"rod_mobility"})
"""Effects that can hide at any size (`Identification.can_hide`), whatever the data."""
RESULT = Path(__file__).parents[1] / "docs" / "data" / "calibration.json"


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the benchmarks on blind studies."""
    group = parser.add_argument_group("blind studies (--only calibration, explanations, known-answer, rivals)")
    for kind in KINDS:
        group.add_argument(f"--{kind}", type=int, default=DEFAULT_COUNTS[kind], help=f"{kind} studies (%(default)s)")
    group.add_argument("--share", type=float, default=1.0, help="share of these numbers, such as 0.1")
    group.add_argument("--set", choices=("thresholds", "rates"), default="rates", help="which seeds")
    group.add_argument("--seed", type=int, default=0, help="further seed")
    group.add_argument("--work", type=Path, help="folder in which finished studies are kept")
    group.add_argument("--jobs", type=int, default=1, help="processes")
    group.add_argument("--cluster", help="address of a Dask scheduler, in place of --jobs")


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
    outcomes, interrupted = run(
        studies, solve, folder, jobs=options.jobs, cluster=options.cluster, title=f"calibration, {options.set}"
    )
    result = summary([(study, outcomes[study.name]) for study in studies if study.name in outcomes])
    print_summary(options.set, result)
    if interrupted:
        sys.exit(130)
    store(RESULT, options.set, provenance(options, "calibration") | {"summary": result})


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
    versions = {p: installed_version(p) for p in ("looping-pendulum", "numpy", "scipy", "heyoka", "lmfit", "scikit-learn")}
    return {
        "command": f"python -m benchmarks --only {name} --set {options.set}{seed} --share {options.share:g}" + "".join(counts),
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
        started = time.process_time()
        try:
            result = identify(loaded, workers=1)
        except HarnessError as error:
            return study.name, {"failed": str(error), "cpu_seconds": time.process_time() - started}
        if result.verdict is Verdict.INTERRUPTED:
            raise KeyboardInterrupt
        outcome = outcome_of(result, planted_values(study), study.kind)
        if study.kind == "unlisted":
            outcome["law"] = law_of(result.unlisted)
        outcome["cpu_seconds"] = time.process_time() - started
        # No rate needs them, and they take as long as the search
        if study.set == "thresholds" and study.kind == "clean" and study.noise_kind != "wander":
            outcome["statistics"] = statistics_of_tests(loaded)
    return study.name, outcome


def outcome_of(result: Identification, planted: dict[str, float], kind: str) -> Outcome:
    """Return what an identification says, beside what was planted."""
    explanations = result.ties or ((result.effects,) if result.effects else ())
    named = [{e.name for e in tie} for tie in explanations]
    if result.verdict is Verdict.AMBIGUOUS and result.unlisted:
        named.append({UNLISTED})
    right = next((tie for tie in explanations if {e.name for e in tie} == set(planted)), ())
    held_out = [e.standardised_rms_after for e in result.errors if e.held_out]
    return {
        "verdict": result.verdict.value,
        "names": list(result.names),
        "ties": [[e.name for e in tie] for tie in result.ties],
        "judgement": judgement(result.verdict, named, set(planted), kind, _on_same_body(result.unlisted, planted)),
        "planted": planted,
        "estimates": [_estimate(effect, planted[effect.name]) for effect in right],
        "visibility": visibility(result, planted),
        "held_out_error": max(held_out),
        "correlated_noise": bool(result.correlated_noise),
    }


def visibility(result: Identification, planted: dict[str, float]) -> float | None:
    """Return the planted change over the smallest one that the data could show, by the report; of two effects the smaller.

    None: nothing that the library lists was planted, or the report says nothing of it.
    """
    # Once it is named, its error is known, but not that of one that stays hidden: to count only the first would be unfair
    if not planted.keys().isdisjoint(CAN_HIDE) or _multiplies_zero(result, planted):
        return None
    smallest = {v.name: (v.value, v.null_value) for v in result.smallest_visible}
    explanations = result.ties or (result.effects,)
    smallest |= {e.name: (MAX_NULL_SCORE * _error_towards_null(e), e.null_value) for tie in explanations for e in tie}
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


UNLISTED = "an unlisted force"
"""What an explanation names that is no listed effect."""


def law_of(force: Unlisted | None) -> dict[str, Any] | None:
    """Return what a force that was found acts on and depends on, and the others that the report does not exclude."""
    if force is None:
        return None
    others = [[o.acts_on, o.depends_on] for o in force.other_closures if not o.excluded]
    return {"acts_on": force.acts_on, "depends_on": force.depends_on, "not_excluded": others}


def _on_same_body(force: Unlisted | None, planted: Iterable[str]) -> set[str]:
    """Return the planted effects that act on what an unlisted force acts on."""
    acts_on = {c.name: effect.acts_on for effect in EFFECTS.values() for c in effect.coefficients}
    return {name for name in planted if force and name in acts_on and force.acts_on.startswith(acts_on[name])}


def judgement(
    verdict: Verdict, explanations: list[set[str]], planted: set[str], kind: str, on_same_body: Collection[str] = ()
) -> str:
    """Return "right", "tied", "part" (one of two effects), "wrong" or "none" (nothing is named).

    Of clean studies only the verdict that nothing is missing is right. Of unlisted forces only that verdict is. Of two effects
    one beside an unlisted force that acts on what the other acts on (``on_same_body``) counts as tied.
    """
    if kind == "unlisted":
        if verdict is Verdict.UNLISTED:
            return "right"
        return "tied" if {UNLISTED} in explanations else "wrong" if explanations else "none"
    if verdict is Verdict.UNLISTED:
        return "tied" if any(names < planted and planted - names <= set(on_same_body) for names in explanations) else "wrong"
    if not explanations:
        return "right" if kind == "clean" and verdict is Verdict.NO_MISSING_EFFECT else "none"
    if planted and planted in explanations:
        return "right" if len(explanations) == 1 else "tied"
    return "part" if any(names < planted for names in explanations) else "wrong"


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
    """Return the statistics of the declared model's tests, each as far from noise as any group or candidate has it.

    Clean studies are not searched once they pass, so the delta BIC of the candidates with the best scores is fitted here, and
    the unlisted forces are screened.
    """
    inputs = read_inputs(study)
    problem = Problem(inputs.study, inputs.training, inputs.free_parameters)
    search = Search(inputs, 0, lambda what, share: None)
    search.declared_model = model = search.judge(refit_with_estimated_noise(calibrate(problem)), ())
    refits = search.refit_candidates(model, 0.0)
    groups = model.tests.groups
    return {
        "chi2_per_dof": model.tests.chi2_per_dof,
        "chi2_over_limit": model.tests.chi2_per_dof / model.tests.limit,
        "lag1_z": max(g.lag1 for g in groups),
        "ljung_box_p": min(g.ljung_box for g in groups),
        "runs_z": min(g.runs for g in groups),
        "score": abs(model.remaining[0].score) if model.remaining else 0.0,
        "held_out_chi2": model.held_out.worst,
        "delta_bic": max((r.delta_bic for r in refits), default=0.0),
        "unlisted_evidence": screen(responses_of(model.fit, motions(model.fit)))[0].twice_log_bayes_factor,
        "values": float(problem.count),
    }
