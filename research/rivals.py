"""Let other methods name what is missing in the blind studies of the calibration: `python -m research.rivals`.

Each method is one function, from a study's data to the names of effects. It gets the data of a study, the declared model and,
where it names effects, the same candidates as `identify`, whose outcomes come from the calibration if the work folder is the
same. Studies of a single trial are left out: not every method can hold out blocks of time. A method whose package is not
installed is not run, and the table says so.
"""

from __future__ import annotations

import argparse
import math
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from looping_pendulum.discrepancy.candidates import Candidate
from looping_pendulum.discrepancy.evidence.explanation import Addition, Parts, bounded, explained, fit_addition, raw
from looping_pendulum.discrepancy.evidence.marginal import Marginal, NoiseGrid
from looping_pendulum.discrepancy.evidence.templates import columns, templates
from looping_pendulum.discrepancy.fit.calibration import Fit, FitError, calibrate
from looping_pendulum.discrepancy.fit.data import TrialData
from looping_pendulum.discrepancy.fit.held_out import check_held_out
from looping_pendulum.discrepancy.fit.problem import Problem
from looping_pendulum.discrepancy.fit.residual_noise import refit_with_estimated_noise, with_noise_of_residuals
from looping_pendulum.discrepancy.inputs import Inputs, read_inputs
from looping_pendulum.errors import HarnessError
from looping_pendulum.installation import install_command
from looping_pendulum.measured.study_io import load
from research import DATA, calibration, rates_page
from research.calibration_summary import JUDGEMENTS, Outcome, proportion
from tests.discrepancy.blind_sample import KINDS, BlindStudy, planted_values, write_files

RESULT = DATA / "rivals.json"
OURS = "identify"
Array = NDArray[np.float64]
MIN_ERRORS = 3.0
"""Standard errors from its null value beyond which a parameter of the fit of all candidates counts as an effect."""
MAX_EVALUATIONS = 1500
"""Runs of all trials that the fit of all candidates may take; more than it takes to converge in most studies."""
IMPOSSIBLE_RESIDUAL = 1e3
"""Standardised residual of a model that cannot run."""
SMALL_STEP = 1e-6
"""Value of every candidate, in its scale, at which a model with all of them must run: least squares begins off the bounds."""
MAX_FORWARD_EFFECTS = 3
"""Largest number of effects that forward selection adds, as many as `prior.MAX_EFFECTS`."""
MAX_FORWARD_REFITS = 4
"""Candidates that may explain most, which it refits before each addition."""
MAX_GAUSSIAN_PROCESS_POINTS = 400
"""Points of one coordinate, all trials together; a Gaussian process takes time in proportion to their cube."""


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
    installed = [name for name, (_, package) in METHODS.items() if not package or find_spec(package)]
    runnable = [name for name in installed if name in (options.method or METHODS)]
    not_run = {
        rates_page.METHODS[name]: rates_page.NOT_ASKED
        if name in installed
        else f"{package} is missing: {install_command('-e', '.[research]')}"
        for name, (_, package) in METHODS.items()
        if name not in runnable
    }
    ours, interrupted = calibration.run(studies, calibration.solve, folder, title=OURS, jobs=options.jobs)
    outcomes = {OURS: [(s, ours[s.name]) for s in studies if s.name in ours]}
    for method in runnable:
        if interrupted:
            break
        runs = [RivalRun(study=s, method=method) for s in studies]
        done, interrupted = calibration.run(runs, solve, folder, title=method, jobs=options.jobs)
        outcomes[method] = [(r.study, done[r.name]) for r in runs if r.name in done]
    block = calibration.provenance(options, "rivals") | {
        "studies": len(studies),
        "methods": {method: summary(pairs) for method, pairs in outcomes.items()},
        "not_run": not_run,
        "losses_of_identify": lost_studies(outcomes),
    }
    print(rates_page.rivals_block(block))
    for loss in block["losses_of_identify"]:
        hidden = " and ".join(loss["hidden"]) or "nothing"
        print(f"identify loses {loss['study']} ({hidden}): {loss['ours']}; right: {', '.join(loss['right'])}")
    if interrupted:
        sys.exit(130)
    calibration.store(RESULT, options.set, block)


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
            says = METHODS[task.method][0](read_inputs(load(path)))
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


@dataclass(frozen=True, kw_only=True)
class Rival:
    """What a method says about a study."""

    names: tuple[str, ...]
    """Effects that it names."""
    departs: bool
    """Whether it says that the declared model is not enough."""
    held_out_error: float | None
    """RMS residual of the held-out trial in units of the noise; None: the method predicts no trajectory."""


def _declared_fit(inputs: Inputs) -> Fit:
    return refit_with_estimated_noise(calibrate(Problem(inputs.study, inputs.training, inputs.free_parameters)))


def _held_out_error(fit: Fit, inputs: Inputs) -> float:
    return math.sqrt(check_held_out(fit, inputs.held_out).worst)


def best_additions(fit: Fit, chosen: Sequence[Candidate]) -> list[Addition]:
    """Return by a linear model with white noise what each candidate would add to a fit, the largest decrease of the cost first.

    The amount is 0 where the best value is not possible.
    """
    grid, found = NoiseGrid(fit.problem.data), templates(fit, chosen)
    parent = explained(grid, fit, Parts(), len(chosen))
    m = Marginal(grid, raw(fit), columns(found, grid.count), bounded(fit), [0])
    best: dict[str, Addition] = {}
    for i, t in enumerate(found):
        step, amounts = m.solution([i])
        possible = t.value(float(amounts[0])) is not None
        amount, decrease = (float(amounts[0]), m.decrease([i])) if possible else (0.0, 0.0)
        if t.candidate.name not in best or decrease > best[t.candidate.name].decrease:
            best[t.candidate.name] = Addition(
                parent=parent, templates=(t,), amounts=(amount,), law=None, step=step, gain=0.0, decrease=decrease,
                log_prior=0.0,
            )  # fmt: skip
    return sorted(best.values(), key=lambda a: -a.decrease)


def delta_bic(without: Fit, fit: Fit) -> float:
    """Return the decrease of the Bayesian information criterion by the parameters that a fit has more: ln n for each."""
    return without.cost - fit.cost - (len(fit.x) - len(without.x)) * math.log(without.problem.count)


def all_free(inputs: Inputs) -> Rival:
    """Fit all candidates at once with lmfit, and name those that are more than `MIN_ERRORS` from their null values.

    As `identify` does, it starts at the calibrated declared model, and keeps every parameter within its physical bounds. Of
    candidates that cannot act together (a rod that turns and a string that stretches) it takes the one that may explain most.
    """
    import lmfit

    base = _declared_fit(inputs)
    more = {}
    for addition in best_additions(base, inputs.library):
        (t,) = addition.templates
        new = {t.candidate.name: t.candidate.free_parameter(t.scale)}
        new |= {c.name: c for c in t.companions if c.name not in more}
        together = base.problem.with_parameters(*(more | new).values())
        inside = np.clip(np.append(base.x, np.full(len(more | new), SMALL_STEP)), together.low, together.high)
        if together.residuals(inside) is not None:
            more |= new
    problem = base.problem.with_parameters(*more.values())
    start = np.concatenate([base.x, np.zeros(len(more))])
    parameters = lmfit.Parameters()
    for i, value in enumerate(start):
        parameters.add(f"x{i}", value=value, min=problem.low[i], max=problem.high[i])

    def residual(values: lmfit.Parameters) -> Array:
        found = problem.residuals(np.array([values[f"x{i}"].value for i in range(len(start))]))
        rows = problem.measured_rows + len(start)
        return np.full(rows, IMPOSSIBLE_RESIDUAL) if found is None else found

    result = lmfit.minimize(
        residual, parameters, method="least_squares", max_nfev=MAX_EVALUATIONS, diff_step=1e-3, ftol=1e-5, x_scale="jac"
    )
    x = np.array([result.params[f"x{i}"].value for i in range(len(start))])
    names = []
    for i, name in enumerate(problem.names):
        error = result.params[f"x{i}"].stderr
        if name in {c.name for c in inputs.library} and error and abs(x[i]) > MIN_ERRORS * error:
            names.append(name)
    residuals = problem.residuals(x)
    if residuals is None:
        raise FitError("the model with all candidates cannot run where lmfit ended")
    held_out = _held_out_error(Fit(problem=problem, x=x, residuals=residuals), inputs)
    return Rival(names=tuple(sorted(names)), departs=bool(names), held_out_error=held_out)


def forward_bic(inputs: Inputs) -> Rival:
    """Add the candidate that lowers the Bayesian information criterion most, as long as one does; test nothing else."""
    fit, added = _declared_fit(inputs), []
    for _ in range(MAX_FORWARD_EFFECTS):
        chosen = [a for a in best_additions(fit, [c for c in inputs.library if c.name not in added]) if a.decrease]
        refits = [(f, a.templates[0].candidate.name) for a in chosen[:MAX_FORWARD_REFITS] if (f := fit_addition(a))]
        best, name = max(refits, key=lambda r: delta_bic(fit, r[0]), default=(fit, ""))
        if delta_bic(fit, best) <= 0:
            break
        added.append(name)
        fit = with_noise_of_residuals(best)
    return Rival(names=tuple(sorted(added)), departs=bool(added), held_out_error=_held_out_error(fit, inputs))


def gaussian_process(inputs: Inputs) -> Rival:
    """Add a Gaussian process to the calibrated model's prediction (Kennedy and O'Hagan, 2001), one for each coordinate.

    Its inputs are time, mass ratio and release angle; the noise is that of the points. It names no effect. It says that the
    declared model is not enough if its marginal likelihood for one coordinate, less half of log(n) for each of its four
    parameters, is larger than that of noise alone. Held-out data are predicted by its mean.
    """
    base = _declared_fit(inputs)
    held_out = check_held_out(base, inputs.held_out).fits
    departs, squares, count = False, 0.0, 0
    channels = sorted({name for d in base.problem.data for name in d.slices})
    for name in channels:
        train = [_residuals(base, k, name) for k in range(len(base.problem.data))]
        process, gain = _fit_process(np.concatenate([i for i, _ in train]), np.concatenate([r for _, r in train]))
        departs |= gain > 0
        for fit in held_out:
            where, residual = _residuals(fit, 0, name)
            if len(residual):
                squares += float(np.sum((residual - process(where)) ** 2))
                count += len(residual)
    return Rival(names=(), departs=departs, held_out_error=math.sqrt(squares / count) if count else None)


def _residuals(fit: Fit, k: int, channel: str) -> tuple[Array, Array]:
    """Return the inputs of the points of a channel of trial ``k``, shape (n, 3), and their residuals, shape (n,)."""
    d: TrialData = fit.problem.data[k]
    if channel not in d.slices:
        return np.zeros((0, 3)), np.zeros(0)
    part = d.slices[channel]
    z = d.standardise(d.value - fit.problem.predict(fit.x, k))[part]
    used = np.isfinite(d.sigma[part])
    parameters, _ = fit.problem.parameters_and_camera(fit.x, k)
    # A tenth of a second, a factor of two in mass and some 10 degrees are lengths of order one
    setting = (math.log2(parameters.heavy_mass / parameters.light_mass), parameters.release_angle / 0.2)
    t = d.t[part][used] / 0.1
    return np.column_stack([t, np.full(len(t), setting[0]), np.full(len(t), setting[1])]), z[used]


def _fit_process(where: Array, residual: Array) -> tuple[Callable[[Array], Array], float]:
    """Fit a Gaussian process to residuals in units of their noise; return its mean, and its gain of log evidence."""
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import RBF, ConstantKernel

    step = max(1, math.ceil(len(residual) / MAX_GAUSSIAN_PROCESS_POINTS))
    where, residual = where[::step], residual[::step]
    kernel = ConstantKernel(1.0, (1e-4, 1e4)) * RBF([1.0, 1.0, 1.0], (0.1, 100.0))
    process = GaussianProcessRegressor(kernel, alpha=1.0).fit(where, residual)
    noise_alone = -0.5 * float(residual @ residual) - 0.5 * len(residual) * math.log(2 * math.pi)
    penalty = 0.5 * len(process.kernel_.theta) * math.log(len(residual))
    return process.predict, float(process.log_marginal_likelihood_value_) - noise_alone - penalty


def sindy(inputs: Inputs) -> Rival:
    """Regress the acceleration across the string, from smoothed points, on a library of forces, by PySINDy's STLSQ.

    The string's tension, which is not known, has no part across the string. Terms beyond gravity and quadratic drag name
    effects; forces along the string, friction and the camera are out of reach of this method, and so are trajectories.
    """
    import pysindy

    data = _accelerations_across(inputs)
    if data is None:
        return Rival(names=(), departs=False, held_out_error=None)
    terms, across = data
    optimiser = pysindy.STLSQ(threshold=SINDY_THRESHOLD, alpha=1e-6, normalize_columns=False)
    optimiser.fit(terms, across[:, None])
    return _named_terms(np.abs(optimiser.coef_[0]) > 0)


def symbolic_regression(inputs: Inputs) -> Rival:
    """Look for a formula of the same acceleration in the same terms by genetic programming, with PyOperon.

    The formula is that of its last front which describes the data most briefly (minimum description length). Those terms in
    it that are not declared name effects; what is out of reach of `sindy` is so here, too.
    """
    from pyoperon.sklearn import SymbolicRegressor

    data = _accelerations_across(inputs)
    if data is None:
        return Rival(names=(), departs=False, held_out_error=None)
    regressor = SymbolicRegressor(
        allowed_symbols="add,sub,mul,constant,variable", max_length=FORMULA_LENGTH, generations=GENERATIONS,
        population_size=POPULATION, pool_size=POPULATION, objectives=["r2", "length"],
        model_selection_criterion="minimum_description_length", n_threads=1, random_state=0,
    )  # fmt: skip
    regressor.fit(*data)
    columns = [f"term{i}" for i in range(len(TERMS_ACROSS))]
    formula = regressor.get_model_string(regressor.model_, 3, names=columns)
    return _named_terms(np.array([column in formula for column in columns]))


FORMULA_LENGTH, GENERATIONS, POPULATION = 25, 200, 500
"""Largest number of nodes of a formula, and the size of the search: some 2 s."""


def _named_terms(kept: NDArray[np.bool_]) -> Rival:
    """Return what a method says that keeps these of the terms across the string."""
    names = tuple(sorted(name for name, k in zip(TERMS_ACROSS, kept, strict=True) if k and name))
    return Rival(names=names, departs=bool(names), held_out_error=None)


def _accelerations_across(inputs: Inputs) -> tuple[Array, Array] | None:
    """Return terms of unit root mean square, shape (n, terms), and the acceleration across the string [m/s^2], shape (n,).

    None if no trial has the light mass's path.
    """
    parts = []
    for d in inputs.training:
        if {"light_x", "light_y"} <= set(d.slices):
            parameters = inputs.study.parameters({}, d.trial)
            parts.append(_terms_across(d, parameters.rod_radius, parameters.coefficients["gravity"]))
    if not parts:
        return None
    terms, across = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
    return terms / np.sqrt(np.mean(terms**2, axis=0)), across


TERMS_ACROSS = ("", "", "light_linear_drag", "wind_speed", "side_force", "side_stiffness")
"""Effect of each term of the library; empty: gravity and quadratic drag, which are declared."""
SINDY_THRESHOLD = 0.3
"""Smallest RMS acceleration of a term that is kept [m/s^2]: a little above what smoothing leaves of a millimetre's noise."""
SMOOTHING_POINTS = 15
"""Points of the window of the Savitzky-Golay filter: 60 ms at 240 frames a second."""


def _terms_across(d: TrialData, radius: float, gravity: float) -> tuple[Array, Array]:
    """Return the library's terms across the string, shape (n, terms), and the acceleration across it [m/s^2], shape (n,)."""
    from scipy.signal import savgol_filter

    x, y = (d.value[d.slices[name]] for name in ("light_x", "light_y"))
    tx, ty = (d.t[d.slices[name]] for name in ("light_x", "light_y"))
    step = float(np.median(np.diff(tx)))
    t = np.arange(tx[0], tx[-1], step)
    place = np.column_stack([np.interp(t, tx, x), np.interp(t, ty, y)])
    order = [savgol_filter(place, SMOOTHING_POINTS, 3, deriv=k, delta=step, axis=0) for k in range(3)]
    inside = slice(SMOOTHING_POINTS, -SMOOTHING_POINTS)
    p, v, a = (values[inside] for values in order)
    distance = np.maximum(np.linalg.norm(p, axis=1), 1.01 * radius)
    sense = np.sign(p[:, 0] * v[:, 1] - p[:, 1] * v[:, 0])
    contact = np.arctan2(p[:, 1], p[:, 0]) - sense * np.arccos(radius / distance)
    # A tangent leaves the rod at a right angle to the radius, so that the radius is the direction across the string
    n = np.column_stack([np.cos(contact), np.sin(contact)])
    speed = np.linalg.norm(v, axis=1)
    along_n = np.sum(v * n, axis=1)
    terms = np.column_stack([-gravity * n[:, 1], speed * along_n, along_n, speed * n[:, 0], n[:, 0], p[:, 0] * n[:, 0]])
    return terms, np.sum(a * n, axis=1)


METHODS: dict[str, tuple[Callable[[Inputs], Rival], str]] = {
    "all_free": (all_free, "lmfit"),
    "forward_bic": (forward_bic, ""),
    "gaussian_process": (gaussian_process, "sklearn"),
    "sindy": (sindy, "pysindy"),
    "symbolic_regression": (symbolic_regression, "pyoperon"),
}
"""Name -> method, and the module that it needs; empty: none beside those of this project."""


def main() -> None:
    """Let the methods judge the studies that the options ask for."""
    parser = argparse.ArgumentParser(description=__doc__)
    calibration.add_options(parser)
    parser.add_argument("--method", action="append", choices=list(METHODS), help="only this one; repeatable")
    benchmark(parser.parse_args())


if __name__ == "__main__":
    main()
