"""An unlisted force, with a formula if a simple one describes it as well as its radial basis functions do.

A formula is fitted to the weights of the basis functions, by what the data say of these. It has all directions of a force at
once: a pulse has one place and one width, and a height in every direction. The repaired model keeps the basis functions.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import optimize, special

from looping_pendulum.discrepancy.evidence.explain import Explanations, Judged
from looping_pendulum.discrepancy.evidence.laws import STRING_ON_ROD, TARGETS, Closure, motions
from looping_pendulum.discrepancy.fit.calibration import Fit
from looping_pendulum.pages.numbers import number
from looping_pendulum.reference_ode.effects.closure import COORDINATE_UNITS, N_BASIS_FUNCTIONS
from looping_pendulum.reference_ode.geometry import Array

PROFILE_POINTS = 60
"""Points of a profile in the result."""
FACTOR_TEXTS = {"constant": "", "retreat_speed": "-u", "across_speed": "-w"}
"""Factor -> its text before a formula; u is the light mass's speed away from the rod along the string, w across it.

A factor is minus the speed, so a positive function of the coordinate brakes.
"""
NO_FORMULA = "no simple formula; twelve radial basis functions"
"""Text in a formula's place where none describes the force."""
SIGNIFICANT_ERRORS = 2.0
"""Standard errors that a force must exceed at a coordinate to be reported as significant there."""
PROJECTION_POINTS = 120
"""Points at which a formula is projected on the basis functions by least squares."""
START_WIDTHS = (0.4, 1.0, 2.5)
"""Start values of the width of a pulse or step, in spacings of the basis functions."""
MIN_WIDTH = 0.2
"""Lower bound of the width of a pulse or step, in spacings of the basis functions."""
MIN_INFORMATION = 1e-10
"""Share of the largest information on a sum of weights below which the data are taken to say nothing of such a sum."""


@dataclass(frozen=True)
class Shape:
    """A function of the coordinate s: a sum of terms, each of which is multiplied by a parameter."""

    text: str
    """The sum, with the names of all parameters in braces."""
    terms: tuple[str, ...]
    """Name of each term's parameter."""
    functions: Callable[[Array, Array], tuple[Array, ...]]
    """Function of every term, of s and of z = (s - place) / width."""

    @property
    def has_place(self) -> bool:
        """Whether a place and a width are among its parameters."""
        return "{place}" in self.text


SHAPES = {
    "constant": Shape("{level}", ("level",), lambda s, z: (s**0,)),
    "line": Shape("{level} + {slope} s", ("level", "slope"), lambda s, z: (s**0, s)),
    "parabola": Shape("{level} + {slope} s + {curvature} s^2", ("level", "slope", "curvature"), lambda s, z: (s**0, s, s**2)),
    "pulse": Shape("{height} exp(-z^2 / 2), z = (s - {place}) / {width}", ("height",), lambda s, z: (np.exp(-0.5 * z * z),)),
    # As the pull of a body that is passed
    "odd pulse": Shape(
        "{swing} z exp(-z^2 / 2), z = (s - {place}) / {width}", ("swing",), lambda s, z: (z * np.exp(-0.5 * z * z),)
    ),
    "step": Shape("{height} / (1 + exp(-(s - {place}) / {width}))", ("height",), lambda s, z: (special.expit(z),)),
}
"""Name of a shape -> the shape."""


@dataclass(frozen=True, kw_only=True)
class Form:
    """A formula of one shape and of one coordinate, with one place and one width for all directions (sides) of a closure."""

    shape: str
    """One of `SHAPES`."""
    sides: tuple[str, ...]
    acting: tuple[str, ...]
    """Sides on which there is a force; on the others it is zero."""

    @property
    def name(self) -> str:
        """Formula of every side in words: "nothing along, pulse across"; of a single one: "pulse"."""
        if len(self.sides) == 1:
            return self.shape
        return ", ".join(f"{self.shape if side in self.acting else 'nothing'} {side}" for side in self.sides)

    @property
    def terms(self) -> tuple[str, ...]:
        """Names of its parameters: place and width, if it has them, then those of all sides: "across_height"."""
        place = ("place", "width") if SHAPES[self.shape].has_place else ()
        return (*place, *(f"{side}_{term}" for side in self.acting for term in SHAPES[self.shape].terms))

    def profile(self, values: Array, s: Array) -> Array:
        """Return the force of every side with these values of the terms at coordinates ``s``, shape (sides, n)."""
        shape = SHAPES[self.shape]
        place, width = values[:2] if shape.has_place else (0.0, 1.0)
        functions = np.array(shape.functions(s, (s - place) / width))
        force = np.zeros((len(self.sides), len(s)))
        amounts = values[2 * shape.has_place :].reshape(len(self.acting), -1)
        force[[self.sides.index(side) for side in self.acting]] = amounts @ functions
        return force

    def text(self, side: str, values: Array) -> str:
        """Return the formula of a side with the values of its terms."""
        if side not in self.acting:
            return "0"
        shown = {term.removeprefix(f"{side}_"): number(v, digits=4) for term, v in zip(self.terms, values, strict=True)}
        return SHAPES[self.shape].text.format(**shown)


@dataclass(frozen=True, kw_only=True)
class Formula:
    """A form with the values that suit the weights of the basis functions best, by what the data say of these."""

    form: Form
    parameters: tuple[tuple[str, float, float], ...]
    """Name, value and standard error [SI] of each of the form's terms."""
    delta_bic: float
    """By how much its Bayesian information criterion is lower than that of the basis functions."""

    @property
    def values(self) -> Array:
        """Values of the terms [SI]."""
        return np.array([value for _, value, _ in self.parameters])


@dataclass(frozen=True, kw_only=True)
class ForceProfile:
    """An unknown force in one direction, as a function of one coordinate."""

    side: str
    """"along" the light mass's string towards the rod, "across" it, or on the "heavy" mass upward."""
    coordinate: tuple[float, ...]
    """Coordinates of the points of the profile [`Unlisted.unit`]."""
    value: tuple[float, ...]
    """Force at each point, as radial basis functions [`Unlisted.value_unit`]."""
    error: tuple[float, ...]
    """Standard error of each value."""
    largest: float
    """Value of largest size of the formula, or of the radial basis functions where there is none."""
    largest_at: float
    """Coordinate of the largest value."""
    significant_from: float | None
    """Smallest coordinate at which the force exceeds two standard errors; None: nowhere."""
    significant_to: float | None
    """Largest coordinate at which the force exceeds two standard errors; None: nowhere."""
    formula: str
    """Formula of the force in this direction, or words where none describes it; s is the coordinate, u and w the light mass's
    speeds."""
    formula_values: tuple[float, ...] | None
    """Values of the formula along the coordinate; None: there is none."""


@dataclass(frozen=True, kw_only=True)
class Unlisted:
    """An unknown force, which no effect of the library is."""

    law: Closure
    profiles: tuple[ForceProfile, ...]
    """The force in each direction in which it acts."""
    formula: Formula | None
    """None: no simple one describes the force as well as its radial basis functions."""
    log_bayes_factor: float
    """Natural logarithm of the factor by which it makes the data more probable."""
    held_out_chi2_before: float
    """Largest chi2 per value on held-out data of the declared model."""
    held_out_chi2_after: float
    """The same of the repaired model."""

    @property
    def unit(self) -> str:
        """Unit of the coordinate."""
        return COORDINATE_UNITS[self.law.coordinate]

    @property
    def value_unit(self) -> str:
        """Unit of the profiles; '' for a change of the friction coefficient."""
        if self.law.target == STRING_ON_ROD:
            return ""
        return "N" if self.law.factor == "constant" else "N s/m"

    @property
    def in_words(self) -> str:
        """What it is and what it depends on, as part of a sentence."""
        point = self.law.point
        return self.law.in_words + ("" if point is None else f" from x = {point[0]:.3f} m, y = {point[1]:.3f} m")


@dataclass(frozen=True, kw_only=True, eq=False)
class RecoveredForce:
    """A closure that was fitted to the training trials."""

    closure: Closure
    fit: Fit
    """Its weights are the last of the free parameters."""
    coordinate_range: tuple[float, float]
    """Smallest and largest value of the coordinate along the training trials, where it matters."""

    @cached_property
    def weights(self) -> Array:
        """Weights of all sides [N], shape (sides, N_BASIS_FUNCTIONS)."""
        values = self.fit.values
        return np.array([values[n] for n in self.closure.names]).reshape(-1, N_BASIS_FUNCTIONS)

    @cached_property
    def _scale(self) -> Array:
        return np.array([p.scale for p in self.fit.problem.free_parameters[-len(self.closure.names) :]])

    def standard_error(self, side: int, s: Array) -> Array:
        """Return the standard error of a side's profile at coordinates ``s``, shape of ``s``."""
        n, part = len(self.closure.names), slice(side * N_BASIS_FUNCTIONS, (side + 1) * N_BASIS_FUNCTIONS)
        covariance = (self.fit.covariance[-n:, -n:] * np.outer(self._scale, self._scale))[part, part]
        basis = self.closure.basis_functions(s)
        variance = np.einsum("ij,jk,ik->i", basis, covariance, basis)
        return np.asarray(np.sqrt(np.maximum(variance, 0.0)))  # rounding can leave a variance slightly negative

    @cached_property
    def likelihood(self) -> tuple[Array, Array, float]:
        """What the data say of the weights w, all other parameters at their best for these, but for a constant.

        Chi2 is |root @ w - target|^2: root of shape (r, weights) [1/N], target of shape (r,). Last the Bayesian information
        criterion of the fitted weights, by their effective number.
        """
        fit, n = self.fit, len(self.closure.names)
        covariance, weights = fit.covariance[-n:, -n:], fit.x[-n:]
        information = np.linalg.pinv(covariance, hermitian=True)
        prior = fit.problem.prior_weights[-n:, -n:].T @ fit.problem.prior_weights[-n:, -n:]
        known, directions = np.linalg.eigh(information - prior)
        kept = known > MIN_INFORMATION * known[-1]
        root = np.sqrt(known[kept])[:, None] * directions[:, kept].T
        # The fitted weights are drawn towards zero by their prior: information @ weights is what the data alone say
        target = directions[:, kept].T @ information @ weights / np.sqrt(known[kept])
        # Their posterior covariance over that of their prior is the part of them that the data do not determine
        effective = n - float(np.trace(prior @ covariance))
        bic = float(np.sum((root @ weights - target) ** 2)) + effective * math.log(fit.problem.count)
        return root / self._scale, target, bic


def describe_unlisted_force(found: Explanations, judged: Judged, held_out_chi2_before: float) -> Unlisted:
    """Return the unlisted force of an explanation that has one as plain data.

    Parameters
    ----------
    held_out_chi2_before
        Largest chi2 per value of held-out data under the declared model.
    """
    e, fit = judged.explanation, judged.training
    law = e.parts.law
    assert law is not None
    rest = next((one for one in found.ranked if one.key == e.key - {law.name}), found.nothing)
    if law.point is not None:
        x, y = (fit.values[name] for name in law.point_coefficients)
        law = dataclasses.replace(law, point=(x, y))
    coordinates = motions(fit).where_it_acts(law)
    force = RecoveredForce(closure=law, fit=fit, coordinate_range=(float(coordinates.min()), float(coordinates.max())))
    formula = best_formula(force)
    return Unlisted(
        law=law,
        profiles=tuple(_profile(force, formula, i) for i in range(len(TARGETS[law.target]))),
        formula=formula,
        log_bayes_factor=e.log_z - rest.log_z,
        held_out_chi2_before=held_out_chi2_before,
        held_out_chi2_after=judged.held_out.worst.value,
    )


def _profile(force: RecoveredForce, formula: Formula | None, i: int) -> ForceProfile:
    """Return the force on the ``i``-th side of its closure."""
    s, side = np.linspace(*force.coordinate_range, PROFILE_POINTS), TARGETS[force.closure.target][i]
    value, error = force.closure.profile(force.weights[i], s), force.standard_error(i, s)
    significant = s[np.abs(value) > SIGNIFICANT_ERRORS * error]
    best, text, of_formula = value, NO_FORMULA, None
    if formula:
        best = formula.form.profile(formula.values, s)[i]
        text, of_formula = formula.form.text(side, formula.values), tuple(best.tolist())
        if factor := FACTOR_TEXTS[force.closure.factor]:
            text = f"{factor} ({text})"
    largest = int(np.argmax(np.abs(best)))
    return ForceProfile(
        side=side,
        coordinate=tuple(s.tolist()),
        value=tuple(value.tolist()),
        error=tuple(error.tolist()),
        largest=float(best[largest]),
        largest_at=float(s[largest]),
        significant_from=float(significant.min()) if significant.size else None,
        significant_to=float(significant.max()) if significant.size else None,
        formula=text,
        formula_values=of_formula,
    )


def best_formula(force: RecoveredForce) -> Formula | None:
    """Return the formula that describes a force best; None: none does so as well as the radial basis functions."""
    sides = TARGETS[force.closure.target]
    acting = [chosen for n in range(1, len(sides) + 1) for chosen in itertools.combinations(sides, n)]
    forms = [Form(shape=shape, sides=sides, acting=chosen) for shape in SHAPES for chosen in acting]
    best = max((_fitted(form, force) for form in forms), key=lambda formula: formula.delta_bic)
    return best if best.delta_bic > 0 else None


def _fitted(form: Form, force: RecoveredForce) -> Formula:
    """Fit a formula's values: its sums at many places and widths, then all of it from the best of these."""
    root, target, bic_of_weights = force.likelihood
    points = np.linspace(*force.coordinate_range, PROJECTION_POINTS)
    projection = np.linalg.pinv(force.closure.basis_functions(points))

    def residuals(values: Array) -> Array:
        """Return root @ w - target for the weights that come closest to the formula, shape (r,)."""
        weights = form.profile(values, points) @ projection.T
        return np.asarray(root @ weights.ravel() - target)

    n, spacing, (first, last) = len(form.terms), force.closure.spacing, force.coordinate_range
    low, high, scale = np.full(n, -np.inf), np.full(n, np.inf), np.ones(n)
    starts: list[tuple[float, ...]] = [()]
    if SHAPES[form.shape].has_place:
        places = np.linspace(first, last, N_BASIS_FUNCTIONS).tolist()
        starts = [(place, width * spacing) for place in places for width in START_WIDTHS]
        low[:2], high[:2], scale[:2] = (first, MIN_WIDTH * spacing), (last, last - first), spacing
    amounts = slice(len(starts[0]), None)

    def with_best_amounts(start: tuple[float, ...]) -> Array:
        values = np.append(start, np.zeros(n - len(start)))
        without = residuals(values)
        columns = np.stack([residuals(values + one) - without for one in np.eye(n)[amounts]], axis=1)
        values[amounts] = np.linalg.lstsq(columns, -without, rcond=1e-10)[0]
        return values

    start = min(map(with_best_amounts, starts), key=lambda values: float(np.sum(residuals(values) ** 2)))
    scale[amounts] = np.maximum(np.abs(start[amounts]), 1e-6)
    fit = optimize.least_squares(residuals, start, x_scale=scale, bounds=(low, high), max_nfev=60)
    errors = np.sqrt(np.maximum(np.diag(np.linalg.pinv(fit.jac.T @ fit.jac)), 0.0))
    bic = 2 * float(fit.cost) + n * math.log(force.fit.problem.count)  # SciPy's cost is half the sum of squares
    parameters = zip(form.terms, fit.x.tolist(), errors.tolist(), strict=True)
    return Formula(form=form, parameters=tuple(parameters), delta_bic=bic_of_weights - bic)
