"""Fit the blind studies with exactly what was hidden: `python -m research.known_answer`.

What a fit that is given the answer, and begins at its true value, cannot tell from the declared model by a delta BIC of
`DECISIVE`, no search can name, however large the effect is: the fitted parameters make up for it. The same holds of a law
that no library lists if a listed effect explains the data as well. The outcomes of `identify` come from the calibration, whose
work folder this one shares.
"""

import argparse
import contextlib
import itertools
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from looping_pendulum.discrepancy.candidates import Candidate
from looping_pendulum.discrepancy.evidence.explanation import fit_addition
from looping_pendulum.discrepancy.fit.calibration import Fit, FitError, calibrate, minimise
from looping_pendulum.discrepancy.fit.residual_noise import refit_with_estimated_noise, with_noise_of_residuals
from looping_pendulum.discrepancy.inputs import read_inputs
from looping_pendulum.errors import HarnessError
from looping_pendulum.measured.study_io import load
from looping_pendulum.reference_ode.effects.own import ENTRY_POINTS
from research import calibration, rates_page
from research.calibration_summary import LARGE, NAMED, Outcome, proportion
from research.rivals import best_additions, delta_bic
from tests.discrepancy.blind_sample import BlindStudy, planted_values, scaled, write_files
from tests.discrepancy.expected import DECISIVE, hidden_number

LAWS = "research.hidden_laws"
"""Module with the laws that no library lists."""


@dataclass(frozen=True, kw_only=True)
class KnownAnswer:
    """One blind study, and what `identify` said of it."""

    study: BlindStudy
    explanations: tuple[tuple[str, ...], ...]
    """Listed effects of each explanation that it named."""

    @property
    def name(self) -> str:
        """Name of its file in the work folder, without ending."""
        return f"{self.study.name}-known-answer"


def benchmark(options: argparse.Namespace) -> None:
    """Fit every study in which something large is hidden, print the summary, and store it beside the rates."""
    # Small effects hide, and nobody doubts it; beside a law, what explains a part of the data would count as a rival
    studies = [s for s in calibration.drawn_studies(options) if s.size and s.size >= LARGE and s.kind != "mixed"]
    folder = calibration.work_folder(options)

    outcomes, interrupted = calibration.run(studies, calibration.solve, folder, title="identify", jobs=options.jobs)
    judged = [(s, outcomes[s.name]) for s in studies if "judgement" in outcomes.get(s.name, {})]
    tasks = [KnownAnswer(study=s, explanations=_explanations(o)) for s, o in judged]
    known: dict[str, Outcome] = {}
    if not interrupted:
        known, interrupted = calibration.run(tasks, solve, folder, title="known answer", jobs=options.jobs)
    result = summary([(s, o["judgement"], known[t.name]) for (s, o), t in zip(judged, tasks, strict=True) if t.name in known])
    block = calibration.provenance(options, "known_answer") | {"summary": result}
    print(rates_page.known_answer_block(block))
    if interrupted:
        sys.exit(130)
    calibration.store(calibration.RESULT, f"known_answer_{options.set}", block)


def _explanations(outcome: Outcome) -> tuple[tuple[str, ...], ...]:
    """Return the listed effects of each explanation that was named and has no law."""
    return tuple(tuple(names) for names, law in outcome["explanations"] if names and not law)


def solve(task: KnownAnswer) -> tuple[str, Outcome]:
    """Make a study again and fit it with what was hidden, a law that no library lists in a process that knows it."""
    if task.study.kind != "unlisted":
        return task.name, gains(task.study, planted_values(task.study), ())
    with _installed_laws() as folder:
        known = json.dumps([task.study.__dict__, task.explanations])
        path = os.pathsep.join([folder, *filter(None, [os.environ.get("PYTHONPATH")])])
        command = [sys.executable, "-m", "research.known_answer", "--one", known]
        done = subprocess.run(command, env=os.environ | {"PYTHONPATH": path}, capture_output=True, text=True)
    if done.returncode:
        return task.name, {"failed": done.stderr[-500:]}
    outcome: Outcome = json.loads(done.stdout.splitlines()[-1])
    return task.name, outcome


@contextlib.contextmanager
def _installed_laws() -> Iterator[str]:
    """Make a folder on whose path the hidden laws are effects of another package."""
    with tempfile.TemporaryDirectory() as folder:
        about = Path(folder) / "hidden_laws-1.dist-info"
        about.mkdir()
        (about / "METADATA").write_text("Metadata-Version: 2.1\nName: hidden-laws\nVersion: 1\n", encoding="utf-8")
        (about / "entry_points.txt").write_text(f"[{ENTRY_POINTS}]\nlaws = {LAWS}\n", encoding="utf-8")
        yield folder


def gains(study: BlindStudy, planted: Mapping[str, float], explanations: Sequence[Sequence[str]]) -> Outcome:
    """Return the delta BIC of each planted effect beside the others, and of each explanation beside the declared model.

    Parameters
    ----------
    planted
        Name of a candidate -> its planted value [SI].
    """
    with tempfile.TemporaryDirectory() as folder:
        inputs = read_inputs(load(write_files(study, Path(folder))))
    library = {c.name: c for c in inputs.library}
    right = {library[name]: value for name, value in planted.items()}
    declared = refit_with_estimated_noise(calibrate(inputs.problem()))  # of all trials, as the search has them
    try:
        # The noise is that of the right model: the declared one's would count what it lacks as noise
        best = with_noise_of_residuals(_best_fit(declared, right))
        known = declared.problem.with_data(best.problem.data)
        base = minimise(known, declared.x)
        without = {name: _best_fit(base, {c: v for c, v in right.items() if c.name != name}) for name in planted}
        others = [_refitted(base, [library[n] for n in names]) for names in explanations]
    except (FitError, HarnessError) as error:
        return {"failed": str(error)}
    return {
        "delta_bic": {name: delta_bic(fit, best) for name, fit in without.items()},
        "delta_bic_of_explanations": [delta_bic(base, fit) for fit in others],
    }


def _refitted(base: Fit, added: Sequence[Candidate]) -> Fit:
    """Return a fit with candidates whose values nobody knows, added one after another."""
    for candidate in added:
        found = best_additions(base, [candidate])
        base = (fit_addition(found[0]) if found else None) or base
    return base


def _best_fit(base: Fit, added: Mapping[Candidate, float]) -> Fit:
    """Return the best fit with the candidates that ``added`` names, begun at their true values and at none."""
    if not added:
        return base
    scales = [abs(v - c.null) for c, v in added.items()]
    main = [c.free_parameter(s) for c, s in zip(added, scales, strict=True)]
    at_truth = [(v - c.null) / s for (c, v), s in zip(added.items(), scales, strict=True)]
    fits = []
    for values in itertools.product(*(c.companion_grid() for c in added)):
        companions = [p for c, v in zip(added, values, strict=True) for p in c.companion_parameters(v)]
        problem = base.problem.with_parameters(*main, *companions)
        for start in (at_truth, [0.0] * len(main)):
            x = np.concatenate([base.x, start, np.zeros(len(companions))])
            with contextlib.suppress(FitError):
                fits.append(minimise(problem, x))
        with contextlib.suppress(FitError):
            fits.append(calibrate(problem, np.concatenate([base.x, at_truth, np.zeros(len(companions))])))
    if not fits:
        raise FitError("the model with what was hidden cannot run")
    return min(fits, key=lambda f: f.cost)


def is_shown(outcome: Outcome) -> bool:
    """Return whether the data show each hidden effect, and make it more likely than what was named instead."""
    return bool(min(outcome["delta_bic"].values()) >= max([0.0, *outcome["delta_bic_of_explanations"]]) + DECISIVE)


def summary(rows: Sequence[tuple[BlindStudy, str, Outcome]]) -> dict[str, Any]:
    """Return for each kind and size how many studies show what was hidden, and how many of these were named or tied."""
    fitted = [row for row in rows if "delta_bic" in row[2]]
    result: dict[str, Any] = {"failed": len(rows) - len(fitted)}
    for kind in dict.fromkeys(s.kind for s, _, _ in fitted):
        of_kind = [row for row in fitted if row[0].kind == kind]
        groups = {
            f"{size:g}": [r for r in of_kind if r[0].size == size] for size in sorted({s.size or 0.0 for s, _, _ in of_kind})
        }
        groups["all"] = of_kind
        result[kind] = {name: _shares(group) for name, group in groups.items()}
    return result


def _shares(rows: Sequence[tuple[BlindStudy, str, Outcome]]) -> dict[str, Any]:
    shown = [judgement for _, judgement, outcome in rows if is_shown(outcome)]
    hidden = [judgement for _, judgement, outcome in rows if not is_shown(outcome)]
    return {
        "shown": proportion(len(shown), len(rows)),
        "shown_and_named": proportion(sum(j in NAMED for j in shown), len(shown)),
        "not_shown_but_named": proportion(sum(j in NAMED for j in hidden), len(hidden)),
    }


def main() -> None:
    """Fit the studies that the options ask for, or the one of `solve`'s own process."""
    parser = argparse.ArgumentParser(description=__doc__)
    calibration.add_options(parser)
    parser.add_argument("--one", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.one is None:
        benchmark(options)
        return
    fields, named = json.loads(options.one)
    study = BlindStudy(**{**fields, "hidden": tuple(fields["hidden"])})
    (hidden,) = study.hidden
    assert study.size is not None
    value = hidden_number(scaled(hidden, study.size))
    print(json.dumps(gains(study, {f"known_{hidden}": value}, named)))


if __name__ == "__main__":
    main()
