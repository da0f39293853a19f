"""Formulas that an unknown force may have, each with few numbers, and which of them the found bumps speak for.

A form writes all sides of a force at once: a pulse has one place and one width, and a height for every side. Forms are chosen
by what a fit of their numbers would leave if the model were linear about the bumps; `formula` refits the best by trajectory.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from looping_pendulum.discrepancy.unlisted.discovery import MARGIN, TARGETS, RecoveredForce
from looping_pendulum.reference_ode.effects.closure import BUMPS
from looping_pendulum.reference_ode.geometry import Array

REACH = 2.0
"""Bumps beyond either end of the coordinate's range on which a polynomial stands, so that its ends are its own."""
NARROW = 0.6
"""Distance of the bumps that a pulse is laid in, in its widths."""
DENSE = 120
"""Points at which a profile is laid into bumps."""
WIDTHS = (0.4, 1.0, 2.5)
"""Widths from which a local form is started, in distances of the found bumps."""
THINNEST = 0.2
"""Of a local form, in distances of the found bumps."""


@dataclass(frozen=True, kw_only=True)
class CoordinateRange:
    """Where the training trials went along the coordinate."""

    low: float
    high: float
    step: float
    """Distance of the bumps that the force was found with."""


@dataclass(frozen=True, kw_only=True)
class BasisPlacement:
    """Where a row of bumps stands."""

    low: float
    """Coordinate of the first bump."""
    step: float
    """Their distance."""
    margin: float
    """Bumps at either end that lie beyond where the profile matters; negative: it matters beyond the bumps."""


@dataclass(frozen=True, kw_only=True)
class FormulaTerm:
    """One number of a form."""

    name: str
    power: int
    """Its unit is the force's over the coordinate's to this power; None of the force for `of_coordinate`."""
    of_coordinate: bool = False
    """Whether it is a place or a width, in units of the coordinate."""


@dataclass(frozen=True, kw_only=True)
class FormulaFamily:
    """One kind of formula of one coordinate, for all sides of a closure."""

    name: str
    terms: tuple[FormulaTerm, ...]
    profile: Callable[[Array, Array], Array]
    """(numbers, coordinates of shape (n,)) -> force of every side, shape (sides, n)."""
    texts: tuple[str, ...]
    """Formula of every side, with the names of its terms in braces."""
    local: bool = False
    """Whether it is nothing but near its place, and can stand on bumps as narrow as itself."""

    def row(self, q: Array, where: CoordinateRange) -> BasisPlacement:
        """The row of bumps on which the form stands."""
        if self.local:
            place, step = float(q[0]), NARROW * abs(float(q[1]))
            return BasisPlacement(low=place - 0.5 * (BUMPS - 1) * step, step=step, margin=-MARGIN)
        step = (where.high - where.low) / (BUMPS - 1 - 2 * REACH)
        return BasisPlacement(low=where.low - REACH * step, step=step, margin=REACH)

    def weights(self, q: Array, row: BasisPlacement) -> Array:
        """The form as bumps, shape (sides, BUMPS) [N]."""
        dense, lay = _laying(row.margin)
        return np.asarray(self.profile(q, row.low + row.step * dense) @ lay.T)


@cache
def _laying(margin: float) -> tuple[Array, Array]:
    """Places along a row of bumps, and the matrix from a profile at them to the weights nearest to it."""
    dense = np.linspace(margin, BUMPS - 1 - margin, DENSE)
    bumps = np.exp(-0.5 * (dense[:, None] - np.arange(BUMPS)) ** 2)
    return dense, np.asarray(np.linalg.solve(bumps.T @ bumps + 1e-9 * np.eye(BUMPS), bumps.T))


POLYNOMIALS: dict[str, tuple[int, ...]] = {
    "constant": (0,),
    "proportional": (1,),
    "line": (0, 1),
    "square": (2,),
    "parabola": (0, 1, 2),
}
"""Form -> powers of the coordinate."""
PULSES: dict[str, tuple[str, ...]] = {"pulse": ("height",), "pass": ("swing",), "pulse and pass": ("height", "swing")}
"""Form -> parts: even about its place (a bump), and odd (there and back, as beside an attracting body)."""


def polynomial(sides: Sequence[str], chosen: Sequence[str]) -> FormulaFamily:
    """Return a polynomial of its own on every side; the name "nothing" leaves one out."""
    powers = [POLYNOMIALS.get(name, ()) for name in chosen]
    flat = [(i, n) for i, side in enumerate(powers) for n in side]

    def profile(q: Array, s: Array) -> Array:
        found = np.zeros((len(sides), len(s)))
        for value, (i, n) in zip(q, flat, strict=True):
            found[i] += value * s**n
        return found

    def text(i: int) -> str:
        parts = [f"{{{sides[i]}_{n}}}" + ("", " s", " s^2")[n] for n in powers[i]]
        return " + ".join(parts) or "0"

    return FormulaFamily(
        name=_name(sides, chosen),
        terms=tuple(FormulaTerm(name=f"{sides[i]}_{n}", power=n) for i, n in flat),
        profile=profile,
        texts=tuple(text(i) for i in range(len(sides))),
    )


def pulse(sides: Sequence[str], chosen: Sequence[str]) -> FormulaFamily:
    """Return pulses at one place and of one width on all sides; "nothing" leaves a side out."""
    parts = [PULSES.get(name, ()) for name in chosen]
    flat = [(i, part) for i, side in enumerate(parts) for part in side]

    def profile(q: Array, s: Array) -> Array:
        z = (s - q[0]) / q[1]
        bell = np.exp(-0.5 * z * z)
        found = np.zeros((len(sides), len(s)))
        for value, (i, part) in zip(q[2:], flat, strict=True):
            found[i] += value * (bell if part == "height" else z * bell)
        return found

    def text(i: int) -> str:
        names = [f"{{{sides[i]}_{part}}}" + ("" if part == "height" else " z") for part in parts[i]]
        factor = f"({' + '.join(names)})" if len(names) > 1 else "".join(names)
        return f"{factor} exp(-z^2 / 2), z = (s - {{place}}) / {{width}}" if names else "0"

    return FormulaFamily(
        name=_name(sides, chosen),
        terms=(*_LOCAL, *(FormulaTerm(name=f"{sides[i]}_{part}", power=0) for i, part in flat)),
        profile=profile,
        texts=tuple(text(i) for i in range(len(sides))),
        local=True,
    )


def step(sides: Sequence[str], chosen: Sequence[str]) -> FormulaFamily:
    """Return steps at one place and of one width on all sides; "nothing" leaves a side out."""
    on = [i for i, name in enumerate(chosen) if name != "nothing"]

    def profile(q: Array, s: Array) -> Array:
        rise = 1 / (1 + np.exp(-np.clip((s - q[0]) / q[1], -60, 60)))
        found = np.zeros((len(sides), len(s)))
        found[on] = np.asarray(q[2:])[:, None] * rise
        return found

    text = "{{{}_height}} / (1 + exp(-(s - {{place}}) / {{width}}))"
    return FormulaFamily(
        name=_name(sides, chosen),
        terms=(*_LOCAL, *(FormulaTerm(name=f"{sides[i]}_height", power=0) for i in on)),
        profile=profile,
        texts=tuple(text.format(side) if i in on else "0" for i, side in enumerate(sides)),
    )


_LOCAL = (FormulaTerm(name="place", power=0, of_coordinate=True), FormulaTerm(name="width", power=0, of_coordinate=True))


def _name(sides: Sequence[str], chosen: Sequence[str]) -> str:
    return chosen[0] if len(sides) == 1 else ", ".join(f"{name} {side}" for side, name in zip(sides, chosen, strict=True))


def forms(target: str) -> list[FormulaFamily]:
    """Every form that a force on a closure's target may have."""
    sides = TARGETS[target]

    def each(names: Sequence[str]) -> list[tuple[str, ...]]:
        every = itertools.product(("nothing", *names), repeat=len(sides))
        return [chosen for chosen in every if any(name != "nothing" for name in chosen)]

    found = [polynomial(sides, chosen) for chosen in each(tuple(POLYNOMIALS))]
    found += [pulse(sides, chosen) for chosen in each(tuple(PULSES))]
    return found + [step(sides, chosen) for chosen in each(("step",))]


@dataclass(frozen=True, kw_only=True, eq=False)
class PredictedFormula:
    """A form, and what it promises if the model is linear about the found bumps."""

    found: RecoveredForce
    form: FormulaFamily
    q: Array
    """Its numbers [SI]."""
    errors: Array
    cost: float
    """Sum of squares that it would leave, at the noise of the declared model."""

    @property
    def score(self) -> float:
        """Bayesian information criterion; lower is better."""
        return self.cost + len(self.q) * math.log(self.found.fit.problem.count)


def promises(found: RecoveredForce, noise: Array) -> list[PredictedFormula]:
    """Every form with its best numbers about the bumps, lowest criterion first.

    Parameters
    ----------
    noise
        Standard deviation of every value by which costs are told, shape (n,).
    """
    where = range_of(found)
    closure, problem = found.closure, found.fit.problem
    known = len(problem.numbers) - len(closure.names)
    row = BasisPlacement(low=closure.low, step=closure.step, margin=MARGIN)
    root, target, floor = _reduced(found, noise)
    scale = np.array([n.scale for n in problem.numbers[known:]])

    def miss(form: FormulaFamily, q: Array) -> Array:
        w = form.weights(q, row).ravel() / scale
        return np.asarray(root @ w - target)

    kept = [_best(found, form, miss, floor, where) for form in forms(closure.target)]
    return sorted((p for p in kept if p), key=lambda p: p.score)


def range_of(found: RecoveredForce) -> CoordinateRange:
    """Where the trials went along a closure's coordinate."""
    s = found.coordinates
    return CoordinateRange(low=float(s.min()), high=float(s.max()), step=found.closure.step)


def _reduced(found: RecoveredForce, noise: Array) -> tuple[Array, Array, float]:
    """Least squares for the weights alone, all else fitted: root, target and what no weight can explain."""
    fit = found.fit
    count = len(noise)
    own = np.concatenate([d.sigma for d in fit.problem.data])
    known = len(fit.problem.numbers) - len(found.closure.names)
    with np.errstate(invalid="ignore"):
        ratio = np.where(np.isfinite(own) & np.isfinite(noise), own / noise, 0.0)
    # the last rows are the ridge's, which no formula has
    rows = np.concatenate([ratio, np.ones(known)])
    jacobian, residuals = fit.jacobian[: count + known] * rows[:, None], fit.residuals[: count + known] * rows
    basis, _ = np.linalg.qr(jacobian[:, :known])
    left = residuals - basis @ (basis.T @ residuals)
    moving = jacobian[:, known:] - basis @ (basis.T @ jacobian[:, known:])
    q, root = np.linalg.qr(moving)
    explained = q.T @ left
    return root, np.asarray(explained + root @ fit.x[known:]), float(left @ left - explained @ explained)


def _best(
    found: RecoveredForce,
    form: FormulaFamily,
    miss: Callable[[FormulaFamily, Array], Array],
    floor: float,
    where: CoordinateRange,
) -> PredictedFormula | None:
    fits = [min((_linear(form, miss, start) for start in starts), key=lambda f: f[0]) for starts in _starts(form, where)]
    if form.terms[0].of_coordinate:
        fits = [_polished(form, miss, where, q) for _, q, _ in fits]
    cost, q, jacobian = min(fits, key=lambda f: f[0])
    errors = np.sqrt(np.maximum(np.diag(np.linalg.pinv(jacobian.T @ jacobian)), 0.0))
    return PredictedFormula(found=found, form=form, q=q, errors=errors, cost=cost + floor) if np.all(np.isfinite(q)) else None


def _polished(
    form: FormulaFamily, miss: Callable[[FormulaFamily, Array], Array], where: CoordinateRange, q: Array
) -> tuple[float, Array, Array]:
    """Cost, numbers and derivative where a form's place and width are best."""
    from scipy.optimize import least_squares

    low, high = np.full(len(q), -np.inf), np.full(len(q), np.inf)
    low[:2], high[:2] = (where.low, THINNEST * where.step), (where.high, where.high - where.low)
    size = np.concatenate([[where.step, where.step], np.maximum(np.abs(q[2:]), 1e-6)])
    fit = least_squares(lambda v: miss(form, v), q, x_scale=size, bounds=(low, high), max_nfev=60)
    return 2 * float(fit.cost), fit.x, fit.jac


def _linear(
    form: FormulaFamily, miss: Callable[[FormulaFamily, Array], Array], start: Sequence[float]
) -> tuple[float, Array, Array]:
    """Cost, numbers and derivative with the best heights for a place and a width."""
    linear = [i for i, t in enumerate(form.terms) if not t.of_coordinate]
    q = np.concatenate([start, np.zeros(len(linear))])
    nothing = miss(form, q)
    columns = np.stack([miss(form, q + _unit(len(q), i)) - nothing for i in linear], axis=1)
    q[linear] = np.linalg.lstsq(columns, -nothing, rcond=1e-10)[0]
    return float(np.sum((nothing + columns @ q[linear]) ** 2)), q, columns


def _starts(form: FormulaFamily, where: CoordinateRange) -> list[list[tuple[float, ...]]]:
    """Places to start from, for each width; one empty start where the form has neither."""
    if not form.terms[0].of_coordinate:
        return [[()]]
    places = np.linspace(where.low, where.high, BUMPS).tolist()
    return [[(place, width * where.step) for place in places] for width in WIDTHS]


def _unit(n: int, i: int) -> Array:
    e = np.zeros(n)
    e[i] = 1.0
    return e
