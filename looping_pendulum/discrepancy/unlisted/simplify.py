"""Formulas with few parameters that an unknown force may have, and which of them fit its radial basis functions best.

A formula has all directions of a force at once: a pulse has one place and one width, and a height in every direction. Formulas
are ranked by the cost that a fit of their parameters would leave if the model were linear about the fitted radial basis
functions; `formula` refits the best to the trajectories.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from looping_pendulum.discrepancy.unlisted.closures import TARGETS
from looping_pendulum.discrepancy.unlisted.force import RecoveredForce
from looping_pendulum.discrepancy.unlisted.motions import END_MARGIN
from looping_pendulum.reference_ode.effects.closure import N_BASIS_FUNCTIONS
from looping_pendulum.reference_ode.geometry import Array

POLYNOMIAL_MARGIN = 2.0
"""By how many spacings the basis functions reach beyond either end of the coordinate's range where they stand for a polynomial.

A polynomial does not fall off at the ends of the range as a sum of basis functions does.
"""
PULSE_SPACING = 0.6
"""Spacing of the basis functions that stand for a pulse, in widths of the pulse."""
PROJECTION_POINTS = 120
"""Points at which a profile is projected on basis functions by least squares."""
START_WIDTHS = (0.4, 1.0, 2.5)
"""Start values of the width of a pulse or step, in spacings of the fitted basis functions."""
MIN_WIDTH = 0.2
"""Lower bound of the width of a pulse or step, in spacings of the fitted basis functions."""


@dataclass(frozen=True, kw_only=True)
class CoordinateRange:
    """Range of the coordinate over the training trials."""

    low: float
    high: float
    spacing: float
    """Spacing of the basis functions that were fitted."""


@dataclass(frozen=True, kw_only=True)
class BasisPlacement:
    """Centres of the basis functions along the coordinate."""

    first_centre: float
    spacing: float
    margin: float
    """How many spacings the first and last centres lie outside the range in which the profile matters; negative: inside."""


@dataclass(frozen=True, kw_only=True)
class FormulaTerm:
    """One parameter of a formula."""

    name: str
    power: int
    """Power of the coordinate that the parameter multiplies: its unit is the force's over the coordinate's to this power."""
    of_coordinate: bool = False
    """Whether the parameter is a place or a width, in units of the coordinate; then the power means nothing."""


@dataclass(frozen=True, kw_only=True)
class FormulaFamily:
    """One kind of formula of one coordinate, for all directions (sides) of a closure."""

    name: str
    terms: tuple[FormulaTerm, ...]
    profile: Callable[[Array, Array], Array]
    """(values of the terms, coordinates of shape (n,)) -> force of every side, shape (sides, n)."""
    texts: tuple[str, ...]
    """Formula of every side, with the names of its terms in braces."""
    local: bool = False
    """Whether the force is negligible except near a place, so that basis functions as narrow as itself can stand for it."""

    def placement(self, values: Array, coordinate_range: CoordinateRange) -> BasisPlacement:
        """Return the centres of the basis functions that stand for the formula with these values."""
        if self.local:
            place, spacing = float(values[0]), PULSE_SPACING * abs(float(values[1]))
            return BasisPlacement(
                first_centre=place - 0.5 * (N_BASIS_FUNCTIONS - 1) * spacing, spacing=spacing, margin=-END_MARGIN
            )
        spacing = (coordinate_range.high - coordinate_range.low) / (N_BASIS_FUNCTIONS - 1 - 2 * POLYNOMIAL_MARGIN)
        first_centre = coordinate_range.low - POLYNOMIAL_MARGIN * spacing
        return BasisPlacement(first_centre=first_centre, spacing=spacing, margin=POLYNOMIAL_MARGIN)

    def weights(self, values: Array, placement: BasisPlacement) -> Array:
        """Return the weights of the basis functions that stand for the formula [N], shape (sides, N_BASIS_FUNCTIONS)."""
        points, projection = _projection_onto_basis(placement.margin)
        return np.asarray(self.profile(values, placement.first_centre + placement.spacing * points) @ projection.T)


# There are three margins in all, and a fit of a formula projects its profile at every step
@cache
def _projection_onto_basis(margin: float) -> tuple[Array, Array]:
    """Return points in spacings from the first centre, and the matrix from a profile at them to the least-squares weights."""
    points = np.linspace(margin, N_BASIS_FUNCTIONS - 1 - margin, PROJECTION_POINTS)
    basis = np.exp(-0.5 * (points[:, None] - np.arange(N_BASIS_FUNCTIONS)) ** 2)
    # The small ridge keeps the system solvable where basis functions lie outside the points (a positive margin).
    return points, np.asarray(np.linalg.solve(basis.T @ basis + 1e-9 * np.eye(N_BASIS_FUNCTIONS), basis.T))


POLYNOMIALS: dict[str, tuple[int, ...]] = {
    "constant": (0,),
    "proportional": (1,),
    "line": (0, 1),
    "square": (2,),
    "parabola": (0, 1, 2),
}
"""Polynomial -> powers of the coordinate."""
PULSES: dict[str, tuple[str, ...]] = {"pulse": ("height",), "pass": ("swing",), "pulse and pass": ("height", "swing")}
"""Pulse -> parts: "height" is even about the place, a Gaussian; "swing" is odd, as the pull of a body that is passed."""


def polynomial(sides: Sequence[str], chosen: Sequence[str]) -> FormulaFamily:
    """Return a polynomial of its own on every side; the name "nothing" leaves a side out."""
    powers = [POLYNOMIALS.get(name, ()) for name in chosen]
    side_powers = [(i, n) for i, side in enumerate(powers) for n in side]

    def profile(values: Array, s: Array) -> Array:
        force = np.zeros((len(sides), len(s)))
        for value, (i, n) in zip(values, side_powers, strict=True):
            force[i] += value * s**n
        return force

    def text(i: int) -> str:
        parts = [f"{{{sides[i]}_{n}}}" + ("", " s", " s^2")[n] for n in powers[i]]
        return " + ".join(parts) or "0"

    return FormulaFamily(
        name=_name(sides, chosen),
        terms=tuple(FormulaTerm(name=f"{sides[i]}_{n}", power=n) for i, n in side_powers),
        profile=profile,
        texts=tuple(text(i) for i in range(len(sides))),
    )


def pulse(sides: Sequence[str], chosen: Sequence[str]) -> FormulaFamily:
    """Return pulses at one place and of one width on all sides; "nothing" leaves a side out."""
    parts = [PULSES.get(name, ()) for name in chosen]
    side_parts = [(i, part) for i, side in enumerate(parts) for part in side]

    def profile(values: Array, s: Array) -> Array:
        z = (s - values[0]) / values[1]
        bell = np.exp(-0.5 * z * z)
        force = np.zeros((len(sides), len(s)))
        for value, (i, part) in zip(values[2:], side_parts, strict=True):
            force[i] += value * (bell if part == "height" else z * bell)
        return force

    def text(i: int) -> str:
        names = [f"{{{sides[i]}_{part}}}" + ("" if part == "height" else " z") for part in parts[i]]
        factor = f"({' + '.join(names)})" if len(names) > 1 else "".join(names)
        return f"{factor} exp(-z^2 / 2), z = (s - {{place}}) / {{width}}" if names else "0"

    return FormulaFamily(
        name=_name(sides, chosen),
        terms=(*_LOCAL, *(FormulaTerm(name=f"{sides[i]}_{part}", power=0) for i, part in side_parts)),
        profile=profile,
        texts=tuple(text(i) for i in range(len(sides))),
        local=True,
    )


def sigmoid_step(sides: Sequence[str], chosen: Sequence[str]) -> FormulaFamily:
    """Return logistic steps at one place and of one width on all sides; "nothing" leaves a side out."""
    active = [i for i, name in enumerate(chosen) if name != "nothing"]

    def profile(values: Array, s: Array) -> Array:
        rise = 1 / (1 + np.exp(-np.clip((s - values[0]) / values[1], -60, 60)))  # clipped: exp would overflow
        force = np.zeros((len(sides), len(s)))
        force[active] = np.asarray(values[2:])[:, None] * rise
        return force

    text = "{{{}_height}} / (1 + exp(-(s - {{place}}) / {{width}}))"
    return FormulaFamily(
        name=_name(sides, chosen),
        terms=(*_LOCAL, *(FormulaTerm(name=f"{sides[i]}_height", power=0) for i in active)),
        profile=profile,
        texts=tuple(text.format(side) if i in active else "0" for i, side in enumerate(sides)),
    )


_LOCAL = (FormulaTerm(name="place", power=0, of_coordinate=True), FormulaTerm(name="width", power=0, of_coordinate=True))


def _name(sides: Sequence[str], chosen: Sequence[str]) -> str:
    return chosen[0] if len(sides) == 1 else ", ".join(f"{name} {side}" for side, name in zip(sides, chosen, strict=True))


def forms(target: str) -> list[FormulaFamily]:
    """Return every formula family that a force on ``target`` may have."""
    sides = TARGETS[target]

    def combinations(names: Sequence[str]) -> list[tuple[str, ...]]:
        every = itertools.product(("nothing", *names), repeat=len(sides))
        return [chosen for chosen in every if any(name != "nothing" for name in chosen)]

    families = [polynomial(sides, chosen) for chosen in combinations(tuple(POLYNOMIALS))]
    families += [pulse(sides, chosen) for chosen in combinations(tuple(PULSES))]
    return families + [sigmoid_step(sides, chosen) for chosen in combinations(("step",))]


@dataclass(frozen=True, kw_only=True, eq=False)
class PredictedFormula:
    """A formula with the values and the cost that it would have if the model were linear about the fitted basis functions."""

    force: RecoveredForce
    form: FormulaFamily
    values: Array
    """Values of the terms [SI]."""
    errors: Array
    """Standard errors of the terms [SI]."""
    cost: float
    """Predicted sum of squared residuals in units of the declared model's noise."""

    @property
    def bic(self) -> float:
        """Predicted Bayesian information criterion; lower is better."""
        return self.cost + len(self.values) * math.log(self.force.fit.problem.count)


def predict_formulas(force: RecoveredForce, noise: Array) -> list[PredictedFormula]:
    """Return every formula with its best values by the linearised model, lowest BIC first.

    Parameters
    ----------
    noise
        Standard deviation of every measured value, which costs are in units of, shape (n,).
    """
    coordinate_range = coordinate_range_of(force)
    closure, problem = force.closure, force.fit.problem
    n_declared = len(problem.free_parameters) - len(closure.names)
    placement = BasisPlacement(first_centre=closure.first_centre, spacing=closure.spacing, margin=END_MARGIN)
    root, target, unexplained_cost = _reduced_least_squares(force, noise)
    scale = np.array([n.scale for n in problem.free_parameters[n_declared:]])

    def reduced_residuals(form: FormulaFamily, values: Array) -> Array:
        weights = form.weights(values, placement).ravel() / scale
        return np.asarray(root @ weights - target)

    predictions = [
        _best_fit(force, form, reduced_residuals, unexplained_cost, coordinate_range) for form in forms(closure.target)
    ]
    return sorted((p for p in predictions if p), key=lambda p: p.bic)


def coordinate_range_of(force: RecoveredForce) -> CoordinateRange:
    """Return the range of a closure's coordinate over the training trials."""
    s = force.coordinates
    return CoordinateRange(low=float(s.min()), high=float(s.max()), spacing=force.closure.spacing)


def _reduced_least_squares(force: RecoveredForce, noise: Array) -> tuple[Array, Array, float]:
    """Reduce the linearised least-squares problem to the weights, all other parameters at their best (variable projection).

    Returns
    -------
    root, target, unexplained_cost
        The cost of weights w, in scales, is ``|root @ w - target|^2 + unexplained_cost``.
    """
    fit = force.fit
    count = len(noise)
    fit_sigma = np.concatenate([d.sigma for d in fit.problem.data])
    n_declared = len(fit.problem.free_parameters) - len(force.closure.names)
    with np.errstate(invalid="ignore"):
        ratio = np.where(np.isfinite(fit_sigma) & np.isfinite(noise), fit_sigma / noise, 0.0)
    # The last rows of the fit are the ridge (prior) of the weights, which no formula has: they are left out.
    rows = np.concatenate([ratio, np.ones(n_declared)])
    jacobian, residuals = fit.jacobian[: count + n_declared] * rows[:, None], fit.residuals[: count + n_declared] * rows
    basis, _ = np.linalg.qr(jacobian[:, :n_declared])
    unexplained = residuals - basis @ (basis.T @ residuals)
    weight_sensitivity = jacobian[:, n_declared:] - basis @ (basis.T @ jacobian[:, n_declared:])
    orthonormal, root = np.linalg.qr(weight_sensitivity)
    explained = orthonormal.T @ unexplained
    return root, np.asarray(explained + root @ fit.x[n_declared:]), float(unexplained @ unexplained - explained @ explained)


def _best_fit(
    force: RecoveredForce,
    form: FormulaFamily,
    reduced_residuals: Callable[[FormulaFamily, Array], Array],
    unexplained_cost: float,
    coordinate_range: CoordinateRange,
) -> PredictedFormula | None:
    """Fit a formula's values to the reduced problem; None if they do not come out finite."""
    fits = [
        min((_fit_linear(form, reduced_residuals, start) for start in starts), key=lambda f: f[0])
        for starts in _start_values(form, coordinate_range)
    ]
    if form.terms[0].of_coordinate:
        # Only from the best place for each width: the cost has minima at many places, and a fit from each would take long
        fits = [_fit_nonlinear(form, reduced_residuals, coordinate_range, values) for _, values, _ in fits]
    cost, values, jacobian = min(fits, key=lambda f: f[0])
    errors = np.sqrt(np.maximum(np.diag(np.linalg.pinv(jacobian.T @ jacobian)), 0.0))
    if not np.all(np.isfinite(values)):
        return None
    return PredictedFormula(force=force, form=form, values=values, errors=errors, cost=cost + unexplained_cost)


def _fit_nonlinear(
    form: FormulaFamily,
    reduced_residuals: Callable[[FormulaFamily, Array], Array],
    coordinate_range: CoordinateRange,
    values: Array,
) -> tuple[float, Array, Array]:
    """Return cost, values and Jacobian of the best fit of all terms, place and width included, from ``values``."""
    from scipy.optimize import least_squares

    low, high = np.full(len(values), -np.inf), np.full(len(values), np.inf)
    # of a pulse or step, the first two terms are its place and its width
    low[:2] = coordinate_range.low, MIN_WIDTH * coordinate_range.spacing
    high[:2] = coordinate_range.high, coordinate_range.high - coordinate_range.low
    scale = np.concatenate([[coordinate_range.spacing, coordinate_range.spacing], np.maximum(np.abs(values[2:]), 1e-6)])
    fit = least_squares(lambda v: reduced_residuals(form, v), values, x_scale=scale, bounds=(low, high), max_nfev=60)
    return 2 * float(fit.cost), fit.x, fit.jac  # SciPy's cost is half the sum of squares


def _fit_linear(
    form: FormulaFamily, reduced_residuals: Callable[[FormulaFamily, Array], Array], start: Sequence[float]
) -> tuple[float, Array, Array]:
    """Return cost, values and Jacobian of the best fit of the terms that enter linearly, at a given place and width."""
    linear = [i for i, t in enumerate(form.terms) if not t.of_coordinate]
    values = np.concatenate([start, np.zeros(len(linear))])
    residuals_without = reduced_residuals(form, values)
    columns = np.stack(
        [reduced_residuals(form, values + _unit_vector(len(values), i)) - residuals_without for i in linear], axis=1
    )
    values[linear] = np.linalg.lstsq(columns, -residuals_without, rcond=1e-10)[0]
    return float(np.sum((residuals_without + columns @ values[linear]) ** 2)), values, columns


def _start_values(form: FormulaFamily, coordinate_range: CoordinateRange) -> list[list[tuple[float, ...]]]:
    """Return, for each start width, the starts (place, width); one empty start for a formula without a place."""
    if not form.terms[0].of_coordinate:
        return [[()]]
    places = np.linspace(coordinate_range.low, coordinate_range.high, N_BASIS_FUNCTIONS).tolist()
    return [[(place, width * coordinate_range.spacing) for place in places] for width in START_WIDTHS]


def _unit_vector(n: int, i: int) -> Array:
    e = np.zeros(n)
    e[i] = 1.0
    return e
