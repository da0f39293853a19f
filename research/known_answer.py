"""Fit a blind study with exactly what was hidden, begun at its true value: what its data show.

What such a fit cannot tell from the declared model no search can name, however large the effect is: the fitted parameters make
up for it. A law that no library lists is known by its true formula, as an effect of another package; since the package that is
tested must not know it, that fit has a process of its own: `python -m research.known_answer STUDY.yaml PLANTED`.
"""

import contextlib
import dataclasses
import itertools
import json
import math
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from looping_pendulum.discrepancy.candidates import Candidate
from looping_pendulum.discrepancy.evidence.explanation import WIDE, Parts, explained
from looping_pendulum.discrepancy.evidence.marginal import NoiseGrid
from looping_pendulum.discrepancy.fit.calibration import Fit, FitError, calibrate, minimise
from looping_pendulum.discrepancy.fit.problem import Problem
from looping_pendulum.discrepancy.fit.residual_noise import refit_with_estimated_noise, with_noise_of_residuals
from looping_pendulum.discrepancy.inputs import read_inputs
from looping_pendulum.errors import HarnessError
from looping_pendulum.measured.free_parameter import FreeParameter
from looping_pendulum.measured.study_io import load
from looping_pendulum.reference_ode.effects.own import ENTRY_POINTS
from tests.blind.cases import CASES
from tests.discrepancy.blind_sample import BlindStudy, hidden_numbers, planted_values
from tests.discrepancy.expected import PLANTED_LAWS

LAWS = "research.hidden_laws"
"""Module with the laws that no library lists."""
LAW = "known_"
"""Begin of the name of such a law as an effect; the name of its blind case follows."""
SHOWN = math.log(10.0)
"""Least log of the factor by which the right explanation must be more probable than any that lacks a part of it.

Of the data of a study in which it is, they *show* what is hidden.
"""

Outcome = dict[str, Any]
Planted = Mapping[str, Sequence[float]]
"""Blind case -> planted value of its candidate or law, then of the companions [SI]."""


def known_answer(study: BlindStudy, path: Path) -> Outcome:
    """Return the log posterior of every part of what is hidden in a study, whose file is at ``path``; see `log_posteriors`."""
    numbers = hidden_numbers(study)
    values = {**planted_values(study), **{LAW + name: value for name, value in numbers.items() if name in PLANTED_LAWS}}
    companions = planted_companions(study)
    if not any(name.startswith(LAW) for name in values):
        return _outcome(path, values, companions)
    with _installed_laws() as folder:
        environment = os.environ | {"PYTHONPATH": os.pathsep.join([folder, *filter(None, [os.environ.get("PYTHONPATH")])])}
        command = [sys.executable, "-m", "research.known_answer", str(path), json.dumps([values, companions])]
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    if done.returncode:
        return {"failed": done.stderr[-500:]}
    outcome: Outcome = json.loads(done.stdout.splitlines()[-1])
    return outcome


def planted_companions(study: BlindStudy) -> dict[str, float]:
    """Return the planted value of each companion coefficient in a study [SI], by name."""
    return {k: v for name in hidden_numbers(study) for k, v in CASES[name].fixed if not isinstance(v, tuple)}


@contextlib.contextmanager
def _installed_laws() -> Iterator[str]:
    """Make a folder on whose path the hidden laws are effects of another package."""
    with tempfile.TemporaryDirectory() as folder:
        about = Path(folder) / "hidden_laws-1.dist-info"
        about.mkdir()
        (about / "METADATA").write_text("Metadata-Version: 2.1\nName: hidden-laws\nVersion: 1\n", encoding="utf-8")
        (about / "entry_points.txt").write_text(f"[{ENTRY_POINTS}]\nlaws = {LAWS}\n", encoding="utf-8")
        yield folder


def _outcome(path: Path, values: Mapping[str, float], companions: Mapping[str, float]) -> Outcome:
    try:
        with threadpool_limits(1, user_api="blas"):
            return {"log_posteriors": log_posteriors(path, values, companions)}
    except (HarnessError, ArithmeticError, ValueError) as error:
        return {"failed": repr(error)}


def log_posteriors(path: Path, values: Mapping[str, float], companions: Mapping[str, float]) -> list[tuple[list[str], float]]:
    """Return (names, log posterior) of every subset of what is hidden, each fitted to all trials.

    Parameters
    ----------
    values
        Name of a candidate -> its planted value [SI].
    companions
        Name of a companion coefficient -> its planted value [SI].

    Raises
    ------
    FitError
        If one of these models cannot run, or the fit with all that is hidden does not converge.
    """
    inputs = read_inputs(load(path))
    right = [c for c in inputs.library if c.name in values]
    listed = sum(not c.name.startswith(LAW) or c.name in values for c in inputs.library)
    declared = refit_with_estimated_noise(calibrate(inputs.problem()))
    # The noise is that of the right model: the declared one's would count what it lacks as noise
    best = with_noise_of_residuals(_fitted(declared, declared, right, values, companions))
    grid = NoiseGrid(best.problem.data)
    found = []
    for count in range(len(right) + 1):
        for chosen in itertools.combinations(right, count):
            fit = _fitted(declared, best, chosen, values, companions)
            if len(chosen) == len(right) and not fit.converged:
                raise FitError("the fit with all that is hidden has not converged")
            explanation = explained(grid, fit, Parts(effects=chosen), listed)
            found.append(([c.name for c in chosen], explanation.log_posterior))
    return found


def planted_parameters(
    chosen: Sequence[Candidate], values: Mapping[str, float], companions: Mapping[str, float]
) -> tuple[list[FreeParameter], list[float]]:
    """Return some candidates and their companions as free parameters, and where these have their planted values [scales]."""
    more: list[FreeParameter] = []
    start: list[float] = []
    for c in chosen:
        scale = abs(values[c.name] - c.null)
        beside = c.companion_parameters([companions[k.name] for k in c.companions])
        more += [dataclasses.replace(c.free_parameter(scale), prior=WIDE), *beside]
        start += [(values[c.name] - c.null) / scale, *(0.0 for _ in c.companions)]
    return more, start


def _fitted(
    declared: Fit, best: Fit, chosen: Sequence[Candidate], values: Mapping[str, float], companions: Mapping[str, float]
) -> Fit:
    """Return the best fit of the declared model with some candidates to the data of ``best``.

    It begins with their true values, and the other parameters as the declared model's fit has them, as ``best`` has them, and
    from nothing but what is stated.
    """
    more, start = planted_parameters(chosen, values, companions)
    problem = Problem(declared.problem.study, best.problem.data, (*declared.problem.free_parameters, *more))
    others = len(declared.x)
    fits = []
    for fit_from, x in ((minimise, declared.x), (minimise, best.x[:others]), (calibrate, declared.problem.prior_mean)):
        with contextlib.suppress(FitError):
            fits.append(fit_from(problem, np.concatenate([x, start])))
    if not fits:
        raise FitError(f"the model with {', '.join(c.name for c in chosen) or 'nothing added'} cannot run")
    return min(fits, key=lambda f: f.cost)


def shown_parts(outcome: Outcome) -> frozenset[str] | None:
    """Return those parts of what is hidden that the data show: the most probable subset; None: a fit failed."""
    if "log_posteriors" not in outcome:
        return None
    names, _ = max(outcome["log_posteriors"], key=lambda one: one[1])
    return frozenset(names)


def log_odds(outcome: Outcome) -> float | None:
    """Return the log odds of all that is hidden to the best explanation that lacks a part of it; None: a fit failed."""
    if "log_posteriors" not in outcome:
        return None
    *parts, (_, whole) = sorted(outcome["log_posteriors"], key=lambda one: len(one[0]))
    return float(whole - max(log_posterior for _, log_posterior in parts))


if __name__ == "__main__":
    study_file, planted = sys.argv[1:]
    print(json.dumps(_outcome(Path(study_file), *json.loads(planted))))
