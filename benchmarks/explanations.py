"""Compare `identify` with explanations by their evidence on the same blind studies: `python -m benchmarks --only explanations`.

Both are judged by the same rule. Every finished study is kept in the work folder; the same command goes on from there.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from benchmarks.blind_sample import KINDS, BlindStudy, planted_values, write_files
from benchmarks.calibration import drawn_studies, law_of, outcome_of, work_folder
from benchmarks.resumable import Outcome, run
from looping_pendulum.compare.tables import table
from looping_pendulum.discrepancy.data.study_io import load
from looping_pendulum.discrepancy.evidence.explain import explain
from looping_pendulum.discrepancy.evidence.prior import body_of
from looping_pendulum.discrepancy.identify import identify
from looping_pendulum.discrepancy.inputs import read_inputs
from looping_pendulum.discrepancy.workers import one_blas_thread
from looping_pendulum.errors import HarnessError
from tests.discrepancy.expected import PLANTED_LAWS

Explanation = tuple[frozenset[str], tuple[str, str] | None]
"""Listed effects, and the body and coordinate of a law."""
METHODS = ("identify", "evidence")
EDGES = (0.0, 0.05, 0.2, 0.5, 0.8, 0.95, 0.99, 1.0)
"""Edges of the bins of stated probabilities."""


def benchmark(options: argparse.Namespace) -> None:
    """Run the studies and print both methods side by side."""
    studies, folder = drawn_studies(options), work_folder(options)
    outcomes, interrupted = run(studies, solve, folder, jobs=options.jobs, cluster=options.cluster, title="explanations")
    pairs = [(s, outcomes[s.name]) for s in studies if s.name in outcomes and "unreachable" not in outcomes[s.name]]
    print(summary(pairs))
    if interrupted:
        sys.exit(130)


def solve(study: BlindStudy) -> tuple[str, Outcome]:
    """Make a study, and explain it by both methods; return its name and what each said."""
    with tempfile.TemporaryDirectory() as folder:
        try:
            loaded = load(write_files(study, Path(folder)))
        except ValueError as error:  # no value of the hidden number gives the size
            return study.name, {"unreachable": str(error)}
        planted = planted_values(study)
        outcome: Outcome = {}
        for method in METHODS:
            started = time.process_time()
            try:
                if method == "identify":
                    result = identify(loaded, workers=1)
                    said = outcome_of(result, planted, study.kind) | {"law": law_of(result.unlisted)}
                    found = _said_by_identify(said, list(result.names))
                else:
                    with one_blas_thread():
                        explained = explain(read_inputs(loaded))
                    found = [_parts(key) for key in explained.credible] if explained.passes else []
                    outcome["probabilities"] = [[sorted(key), p] for key, p in explained.probabilities if p > 1e-6]
                    outcome["passes"] = explained.passes
            except HarnessError as error:
                outcome[method] = {"failed": str(error)}
                continue
            outcome[method] = {
                "explanations": [[sorted(effects), law] for effects, law in found],
                "judgement": judgement(found, truth(study)),
                "cpu_seconds": time.process_time() - started,
            }
    return study.name, outcome


def truth(study: BlindStudy) -> Explanation:
    """Return what is hidden in a study, as an explanation."""
    laws = [PLANTED_LAWS[name] for name in study.hidden if name in PLANTED_LAWS]
    return frozenset(planted_values(study)), (body_of(laws[0][0]), laws[0][1]) if laws else None


def judgement(found: Sequence[Explanation], right: Explanation) -> str:
    """Return what a set of explanations is worth.

    "right": it is the only one, of a law its body and coordinate; "tied": it is one of several; "part": a part of it is named;
    "law": its effects are named beside another law; "none": nothing is said to be missing; "wrong": something else is.
    """
    nothing: Explanation = frozenset(), None
    if not found or nothing in found:
        return "right" if right == nothing else "none"
    if right in found:
        return "right" if len(set(found)) == 1 else "tied"
    effects, law = right
    if law and any(e == effects and other for e, other in found):
        return "law"
    parts = [(e, other) for e, other in found if e <= effects and other in (None, law)]
    return "part" if parts else "wrong"


def _said_by_identify(said: dict[str, Any], names: Sequence[str]) -> list[Explanation]:
    law = (body_of(said["law"]["acts_on"]), said["law"]["depends_on"]) if said["law"] else None
    if said["verdict"] == "unlisted":
        return [(frozenset(names), law)]
    ties = said["ties"] or ([names] if names else [])
    return [(frozenset(tie), None) for tie in ties] + ([(frozenset(), law)] if law else [])


def _parts(key: Iterable[str]) -> Explanation:
    """Return the names of an explanation's parts as its effects and its law's body and coordinate."""
    laws = [name.removeprefix("law: ").split(" by ") for name in key if name.startswith("law: ")]
    effects = frozenset(name for name in key if not name.startswith("law: "))
    return effects, (body_of(laws[0][0]), laws[0][1].split(" times ")[0]) if laws else None


def summary(pairs: Sequence[tuple[BlindStudy, Outcome]]) -> str:
    """Return tables of both methods' judgements, of the stated probabilities, and of the studies that they differ on."""
    words = ("right", "tied", "law", "part", "wrong", "none", "failed")
    rows = []
    for kind in KINDS:
        of_kind = [o for s, o in pairs if s.kind == kind]
        for method in METHODS if of_kind else ():
            said = Counter(_judgement(o[method]) for o in of_kind)
            seconds = sorted(o[method].get("cpu_seconds", 0.0) for o in of_kind)
            rows.append(
                [kind, method, *(str(said[word]) for word in words), f"{seconds[len(seconds) // 2]:.1f}", f"{sum(seconds):.0f}"]
            )
    text = table(["hidden", "method", *words, "median CPU [s]", "sum"], rows, left=2)
    stated = [(p, _parts(key) == truth(s)) for s, o in pairs for key, p in o.get("probabilities", []) if key]
    rows = []
    for low, high in zip(EDGES, EDGES[1:], strict=False):
        here = [(p, right) for p, right in stated if low <= p < high or (high == 1.0 and p >= high)]
        if here:
            mean = sum(p for p, _ in here) / len(here)
            rows.append(
                [f"{low:g} to {high:g}", str(len(here)), f"{mean:.3f}", f"{sum(right for _, right in here) / len(here):.3f}"]
            )
    text += "\nExplanations that something is missing:\n\n" + table(
        ["stated probability", "number", "mean", "share that is right"], rows
    )
    inside = [truth(s) in _explanations(o["evidence"]) for s, o in pairs]
    text += f"\nThe credible set holds the truth in {sum(inside)} of {len(inside)} studies.\n\n"
    differ = [
        [s.name, "+".join(s.hidden) or "nothing", *(f"{_judgement(o[m])}: {_said(o[m])}" for m in METHODS)]
        for s, o in pairs
        if _judgement(o["identify"]) != _judgement(o["evidence"])
    ]
    return text + table(["study", "hidden", *METHODS], differ, left=4)


def _judgement(said: dict[str, Any]) -> str:
    return str(said.get("judgement", "failed"))


def _explanations(said: dict[str, Any]) -> list[Explanation]:
    """Return explanations that JSON has made lists of."""
    return [(frozenset(effects), tuple(law) if law else None) for effects, law in said.get("explanations", [])]


def _said(said: dict[str, Any]) -> str:
    names = [
        "+".join([*sorted(effects), *(["law of the " + " by ".join(law)] if law else [])])
        for effects, law in _explanations(said)
    ]
    return " or ".join(name or "nothing" for name in names[:3]) or "nothing"
