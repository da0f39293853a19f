"""Search for a force that no library lists, as a function of time or of the state, by radial basis functions.

While the string slides, a force on the heavy mass and one along the light mass's string move everything alike, so a force as
a function of *time* cannot name its body; as a function of the *state* it can, and held-out data decide. Each closure (a
coordinate, a factor, the directions it acts in) is screened by its sensitivities orthogonal to those of all fitted parameters,
with a ridge (Gaussian prior of the weights) that maximises the evidence; the best are refitted to the trajectories.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from looping_pendulum.discrepancy.data.free_parameter import FreeParameter
from looping_pendulum.discrepancy.data.study import Estimate, Study
from looping_pendulum.discrepancy.fit.calibration import WINDOW_COST_TOLERANCE, Fit, FitError, minimise
from looping_pendulum.discrepancy.fit.problem import Problem, TrialData
from looping_pendulum.discrepancy.fit.residual_noise import with_noise_of_residuals
from looping_pendulum.discrepancy.listed.attribution import HeldOutTest, check_held_out
from looping_pendulum.discrepancy.workers import SERIAL, ProgressCallback, Workers
from looping_pendulum.reference_ode.effects.closure import COORDINATES, FACTORS, N_BASIS_FUNCTIONS, weight_name
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.solution import Samples
from looping_pendulum.reference_ode.transitions import Mode

ACROSS = "light mass, across the string"
TARGETS: dict[str, tuple[str, ...]] = {
    "light mass, along the string": ("along",),
    ACROSS: ("across",),
    "light mass": ("along", "across"),
    "heavy mass": ("heavy",),
}
"""Where an unknown force may act -> sides of the closure in `reference_ode.effects.closure`."""
END_MARGIN = 0.5
"""By how many spacings the basis functions reach beyond either end of the coordinate's range."""
DERIVATIVE_STEP = 1e-3
"""Weight [N] of the difference quotients: the sensitivity to a weight is the prediction's change by it, over it."""
MIN_SPACING = 1e-4
"""Spacing of basis functions [SI] below which a coordinate counts as constant, and is not tried."""
MAX_SWING_ITERATIONS = 5
"""Largest number of iterations of a closure's fit to a long swing."""
MAX_REFITS = 4
"""Closures that are refitted to the trajectories, the best of the screening."""
SIGNIFICANT_ERRORS = 2.0
"""Standard errors that a force must exceed at a coordinate to be reported as significant there."""


@dataclass(frozen=True, kw_only=True)
class Closure:
    """A sum of radial basis functions of one coordinate, times a factor, as an unknown force on one mass."""

    coordinate: str
    """Name of the coordinate, of `COORDINATES`."""
    factor: str
    """Name of the factor, of `FACTORS`."""
    target: str
    """Where the force acts, of `TARGETS`."""
    first_centre: float
    """Coordinate of the first basis function's centre."""
    spacing: float
    """Distance of neighbouring centres, which is also each basis function's width, in units of the coordinate."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the weights, side by side."""
        return tuple(weight_name(side, i) for side in TARGETS[self.target] for i in range(N_BASIS_FUNCTIONS))

    @property
    def centres(self) -> Array:
        """Coordinates of the centres, shape (N_BASIS_FUNCTIONS,)."""
        return np.asarray(self.first_centre + self.spacing * np.arange(N_BASIS_FUNCTIONS), dtype=np.float64)

    @property
    def coefficients(self) -> dict[str, float]:
        """Coefficients of the effect beside its weights: which coordinate and factor, and where the centres are."""
        return {
            f"closure_of_{self.coordinate}": 1.0,
            f"closure_by_{self.factor}": 1.0,
            "closure_scale": 1 / self.spacing,
            "closure_start": self.first_centre / self.spacing,
        }

    def added_to(self, study: Study) -> Study:
        """Return ``study`` with this closure among its effects, its weights still zero."""
        fixed = {n: Estimate(value=v) for n, v in self.coefficients.items()}
        return dataclasses.replace(study, effects={**study.effects, **fixed})

    def basis_functions(self, s: Array) -> Array:
        """Return every basis function at coordinates ``s`` of shape (n,), shape (n, N_BASIS_FUNCTIONS)."""
        return np.asarray(np.exp(-0.5 * ((s[:, None] - self.centres) / self.spacing) ** 2), dtype=np.float64)

    def profile(self, weights: Array, s: Array) -> Array:
        """Return the weighted sum at coordinates ``s``, shape of ``s``; [N], or [N s/m] if multiplied by a speed."""
        return np.asarray(self.basis_functions(s) @ weights)


@dataclass(frozen=True, kw_only=True, eq=False)
class RecoveredForce:
    """A closure that was refitted to the trajectories and tested on held-out data."""

    closure: Closure
    fit: Fit
    twice_log_bayes_factor: float
    """Twice the log of the Bayes factor over the model without it, from the screening."""
    held_out: HeldOutTest
    coordinates: Array
    """Values of the coordinate along the training trials, shape (n,)."""

    @cached_property
    def weights(self) -> Array:
        """Weights of all sides [N], shape (sides, N_BASIS_FUNCTIONS)."""
        values = self.fit.values
        return np.array([values[n] for n in self.closure.names]).reshape(-1, N_BASIS_FUNCTIONS)

    def covariance(self, side: int) -> Array:
        """Return the covariance of a side's weights [N^2], shape (N_BASIS_FUNCTIONS, N_BASIS_FUNCTIONS)."""
        problem = self.fit.problem
        index = [problem.names.index(n) for n in self.closure.names[side * N_BASIS_FUNCTIONS : (side + 1) * N_BASIS_FUNCTIONS]]
        scale = np.array([problem.free_parameters[i].scale for i in index])
        return np.asarray(self.fit.covariance[np.ix_(index, index)] * np.outer(scale, scale))

    def standard_error(self, side: int, s: Array) -> Array:
        """Return the standard error of a side's profile at coordinates ``s``, shape of ``s``."""
        basis = self.closure.basis_functions(s)
        variance = np.einsum("ij,jk,ik->i", basis, self.covariance(side), basis)
        return np.asarray(np.sqrt(np.maximum(variance, 0.0)))  # rounding can leave a variance slightly negative


@dataclass(frozen=True, kw_only=True, eq=False)
class ScreenedClosure:
    """Evidence for a closure by the model linearised about a fit."""

    closure: Closure
    twice_log_bayes_factor: float
    """Twice the log of the Bayes factor over the model without it."""
    ridge: float
    """Prior standard deviation of the weights that maximises the evidence [N]."""
    weights: Array
    """Weights that this prior and the data give [N], shape (sides * N_BASIS_FUNCTIONS,)."""


def discover(
    base: Fit,
    held_out: Sequence[tuple[TrialData, Sequence[FreeParameter]]],
    report_step: ProgressCallback = lambda what: None,
    workers: Workers = SERIAL,
    min_evidence: float = -math.inf,
) -> list[RecoveredForce]:
    """Search all closures; return the best ones, refitted, in the order in which they explain held-out data.

    Parameters
    ----------
    base
        Fit of the declared model.
    held_out
        Held-out trials, each with the parameters that it alone has; empty: blocks of time are held out.
    min_evidence
        Smallest twice log Bayes factor of a closure that is refitted.
    """
    report_step("screening unknown forces")
    samples = [base.problem.run(base.x, k) for k in range(len(base.problem.data))]
    screened = sorted(screen(base, samples, workers), key=lambda s: -s.twice_log_bayes_factor)
    different = _one_per_target_and_coordinate(screened)[:MAX_REFITS]
    chosen = [s for s in different if s.twice_log_bayes_factor >= min_evidence]
    descriptions = [f"{s.closure.target} by {s.closure.coordinate}" for s in chosen]
    forces = workers.map(
        _refit,
        (base, held_out, samples),
        chosen,
        descriptions,
        lambda what: report_step(f"fitting an unknown force on the {what}"),
    )
    return sorted((f for f in forces if f), key=lambda f: f.held_out.worst)


def coordinate(samples: Sequence[Samples], name: str) -> Array:
    """Return the values of a coordinate along all runs, one run after another."""
    return np.concatenate([s.t if name == "time" else getattr(s.state, name) for s in samples])


def screen(base: Fit, samples: Sequence[Samples], workers: Workers = SERIAL) -> list[ScreenedClosure]:
    """Return the evidence of every closure by the residuals of a fit."""
    # What a refit of the declared model's parameters could explain is no evidence for a new force, so both the residuals and
    # the sensitivities to the weights are projected on the orthogonal complement of the Jacobian.
    fitted_basis, _ = np.linalg.qr(base.jacobian)
    unexplained = base.residuals - fitted_basis @ (fitted_basis.T @ base.residuals)
    closures = []
    for name, factor in itertools.product(COORDINATES, FACTORS):
        values = coordinate(samples, name)
        low, high = np.quantile(values, [0.0, 0.995])
        spacing = float(high - low) / (N_BASIS_FUNCTIONS - 1 - 2 * END_MARGIN)
        if spacing < MIN_SPACING:
            continue
        first_centre = float(low) - END_MARGIN * spacing
        closures.append(
            Closure(coordinate=name, factor=factor, target="light mass", first_centre=first_centre, spacing=spacing)
        )
    targets = _targets(samples)
    screened = workers.map(_screen_all_targets, (base.problem, base.x, fitted_basis, unexplained, targets), closures)
    return [one for each in screened for one in each]


def _targets(samples: Sequence[Samples]) -> tuple[str, ...]:
    """Return the targets on which a force can change these runs: of a clamped pendulum only that across its taut string."""
    if all((s.mode == Mode.CLAMPED).all() for s in samples):
        return (ACROSS,)
    return tuple(TARGETS)


def _screen_all_targets(shared: tuple[Problem, Array, Array, Array, tuple[str, ...]], light: Closure) -> list[ScreenedClosure]:
    """Return the evidence of a closure's coordinate and factor on every target."""
    problem, x, fitted_basis, unexplained, targets = shared
    # The targets share their sensitivities: those of both directions on the light mass serve it along, across and together
    widest = (ACROSS,) if targets == (ACROSS,) else ("light mass", "heavy mass")
    sensitivity: dict[str, Array] = {}
    for target in widest:
        sensitivity |= _sensitivity(problem, x, dataclasses.replace(light, target=target), fitted_basis)
    screened = []
    for target in targets:
        closure = dataclasses.replace(light, target=target)
        columns = np.stack([sensitivity[n] for n in closure.names], axis=1)
        twice_log_bayes_factor, ridge, weights = _evidence(columns, unexplained)
        screened.append(
            ScreenedClosure(closure=closure, twice_log_bayes_factor=twice_log_bayes_factor, ridge=ridge, weights=weights)
        )
    return screened


def _sensitivity(declared: Problem, x: Array, closure: Closure, fitted_basis: Array) -> dict[str, Array]:
    """Return weight -> change of the standardised prediction per newton, orthogonal to all fitted parameters."""
    problem = _problem(declared, closure, DERIVATIVE_STEP, WEAK_PRIOR)
    start = np.append(x, np.zeros(len(closure.names)))
    residuals = problem.residuals(start)
    assert residuals is not None
    sensitivity = {}
    for i, name in enumerate(closure.names):
        moved = start.copy()
        # In units of the weight's scale, which is `DERIVATIVE_STEP`
        moved[len(x) + i] = 1.0
        moved_residuals = problem.residuals(moved)
        # the sign: a residual is measured less predicted; the rows beyond the declared model's are those of the weights' prior
        rows = len(fitted_basis)
        change = np.zeros(rows) if moved_residuals is None else ((residuals - moved_residuals) / DERIVATIVE_STEP)[:rows]
        sensitivity[name] = change - fitted_basis @ (fitted_basis.T @ change)
    return sensitivity


WEAK_PRIOR = 1e6
"""Prior standard deviation, in scales of a parameter, that leaves it to the data."""


def _problem(problem: Problem, closure: Closure, scale: float, prior: float) -> Problem:
    """Return ``problem`` with a closure's weights as further parameters, of standard deviation ``prior`` times ``scale``."""
    trials = tuple(t.name for t in problem.study.trials)
    added = [
        FreeParameter(name=n, parameter=n, trials=trials, init_value=0.0, scale=scale, prior=prior, bounds=(-1e6, 1e6))
        for n in closure.names
    ]
    parameters = (*problem.free_parameters, *added)
    mean = np.append(problem.prior_mean, np.zeros(len(added)))
    weights = np.zeros((len(parameters), len(parameters)))
    n_declared = len(problem.free_parameters)
    weights[:n_declared, :n_declared] = problem.prior_weights
    weights[n_declared:, n_declared:] = np.eye(len(added)) / prior
    return Problem(closure.added_to(problem.study), problem.data, parameters, (mean, weights))


def _evidence(sensitivity: Array, residuals: Array) -> tuple[float, float, Array]:
    """Return the largest evidence for Gaussian weights, the ridge that gives it, and the weights' posterior mean.

    The evidence is twice the log of the Bayes factor over the model without the weights. With s the singular values of
    ``sensitivity`` and r the ridge, it is the sum of p^2 (r s)^2 / (1 + (r s)^2) - log(1 + (r s)^2), where p are the residuals'
    components along the left singular vectors.
    """
    u, s, vt = np.linalg.svd(sensitivity, full_matrices=False)
    projected = u.T @ residuals
    best = (-math.inf, 0.0, np.zeros(sensitivity.shape[1]))
    # From 10 uN, which move 10 g by a tenth of a millimetre in half a second, to 1 N, about the heavy mass's weight
    for ridge in np.logspace(-5, 0, 41):
        power = (ridge * s) ** 2
        twice_log_bayes_factor = float(np.sum(projected**2 * power / (1 + power) - np.log1p(power)))
        if twice_log_bayes_factor > best[0]:
            best = twice_log_bayes_factor, float(ridge), vt.T @ (ridge**2 * s / (1 + power) * projected)
    return best


def _one_per_target_and_coordinate(screened: Sequence[ScreenedClosure]) -> list[ScreenedClosure]:
    """Return the first closure of every target and coordinate, in order: those that differ by their factor are alike."""
    seen: set[tuple[str, str]] = set()
    different = []
    for one in screened:
        key = one.closure.coordinate, one.closure.target
        if key not in seen:
            seen.add(key)
            different.append(one)
    return different


def _refit_to_noise(problem: Problem, start: Array) -> Fit:
    """Fit a closure from ``start``, and again with the noise of its residuals."""
    return with_noise_of_residuals(minimise(problem, start, cost_tolerance=WINDOW_COST_TOLERANCE, max_iterations=12))


def _refit_swing(problem: Problem, base: Fit) -> Fit:
    """Do the same for a long swing, whose every run takes a hundred times as long, and whose phase a weight moves far.

    Raises
    ------
    FitError
        If the closure explains no more than no closure.
    """
    # Without a force, so that the phase holds
    start = np.append(base.x, np.zeros(len(problem.names) - len(base.x)))
    fit = minimise(problem, start, cost_tolerance=WINDOW_COST_TOLERANCE, max_iterations=MAX_SWING_ITERATIONS)
    if fit.cost >= base.cost:
        raise FitError("no force explains more than none")
    return with_noise_of_residuals(fit, cost_tolerance=WINDOW_COST_TOLERANCE, max_iterations=MAX_SWING_ITERATIONS)


def _refit(
    shared: tuple[Fit, Sequence[tuple[TrialData, Sequence[FreeParameter]]], Sequence[Samples]], screened: ScreenedClosure
) -> RecoveredForce | None:
    """Refit a closure to the trajectories with the ridge that maximises the evidence; None if the model cannot run."""
    base, held_out, samples = shared
    problem = _problem(base.problem, screened.closure, screened.ridge, 1.0)
    # The ridge is the scale of the weights in this problem, so that their prior has unit variance
    start = np.append(base.x, screened.weights / screened.ridge)
    try:
        fit = _refit_swing(problem, base) if base.problem.is_swing else _refit_to_noise(problem, start)
    except FitError:
        return None
    return RecoveredForce(
        closure=screened.closure,
        fit=fit,
        twice_log_bayes_factor=screened.twice_log_bayes_factor,
        held_out=(
            check_held_out(fit, held_out, max_iterations=MAX_SWING_ITERATIONS)
            if base.problem.is_swing
            else check_held_out(fit, held_out)
        ),
        coordinates=coordinate(samples, screened.closure.coordinate),
    )
