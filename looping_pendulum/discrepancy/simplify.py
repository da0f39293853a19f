"""Turn a row of bumps into a formula that people read: the simplest shape that the bumps cannot tell from themselves."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from looping_pendulum.discrepancy.discovery import Closure, Found
from looping_pendulum.reference_ode.closure import BUMPS
from looping_pendulum.reference_ode.geometry import Array

DENSE = 200
"""Points at which a shape is laid into bumps."""

Shape = Callable[[Array, Array], Array]


@dataclass(frozen=True, kw_only=True)
class Form:
    """One kind of formula of one coordinate."""

    name: str
    text: str
    """With ``{0}``, ``{1}`` ... for its numbers and ``s`` for the coordinate."""
    shape: Shape
    starts: Callable[[Array, Array], list[list[float]]]
    """(coordinates, profile) -> starts of its numbers."""


def _bump_starts(s: Array, y: Array) -> list[list[float]]:
    peak, span = int(np.argmax(np.abs(y))), float(np.ptp(s))
    return [[float(y[peak]), float(s[peak]), span * width] for width in (0.05, 0.15, 0.4)]


def _step_starts(s: Array, y: Array) -> list[list[float]]:
    height, middle, width = float(y[-1] - y[0]) or 1e-3, float(np.median(s)), float(np.ptp(s)) / 10
    return [[height, middle, width], [height, middle, -width]]


FORMS = (
    Form(name="nothing", text="0", shape=lambda q, s: np.zeros_like(s), starts=lambda s, y: [[]]),
    Form(name="constant", text="{0}", shape=lambda q, s: q[0] + 0 * s, starts=lambda s, y: [[float(y.mean())]]),
    Form(name="proportional", text="{0} s", shape=lambda q, s: q[0] * s, starts=lambda s, y: [[0.0]]),
    Form(name="line", text="{0} + {1} s", shape=lambda q, s: q[0] + q[1] * s, starts=lambda s, y: [[float(y.mean()), 0.0]]),
    Form(name="square", text="{0} s^2", shape=lambda q, s: q[0] * s * s, starts=lambda s, y: [[0.0]]),
    Form(
        name="parabola",
        text="{0} + {1} s + {2} s^2",
        shape=lambda q, s: q[0] + q[1] * s + q[2] * s * s,
        starts=lambda s, y: [[float(y.mean()), 0.0, 0.0]],
    ),
    Form(
        name="bump",
        text="{0} exp(-((s - {1}) / {2})^2 / 2)",
        shape=lambda q, s: q[0] * np.exp(-0.5 * ((s - q[1]) / q[2]) ** 2),
        starts=_bump_starts,
    ),
    Form(
        name="step",
        text="{0} / (1 + exp(-(s - {1}) / {2}))",
        shape=lambda q, s: q[0] / (1 + np.exp(-np.clip((s - q[1]) / q[2], -60, 60))),
        starts=_step_starts,
    ),
)


@dataclass(frozen=True, kw_only=True)
class Formula:
    """A simplified profile of one side."""

    form: str
    text: str
    numbers: tuple[float, ...]
    errors: tuple[float, ...]
    misfit: float
    """Chi2 of the formula against the bumps, given their covariance."""
    weights: Array
    """The formula as bumps [N], shape (BUMPS,)."""


def simplify(found: Found, side: int) -> Formula:
    """Choose the form of lowest Bayesian information criterion against the bumps of ``side``."""
    closure = found.closure
    s = np.linspace(found.coordinates.min(), found.coordinates.max(), DENSE)
    lay = _laying(closure, s)
    values, root = _weights(found, side)
    profile = closure.profile(values, s)
    best: tuple[float, Formula] | None = None
    for form in FORMS:
        formula = _fit(form, s, profile, lay, values, root)
        score = formula.misfit + len(formula.numbers) * math.log(BUMPS)
        if best is None or score < best[0]:
            best = score, formula
    assert best is not None
    return best[1]


def _laying(closure: Closure, s: Array) -> Array:
    """Matrix from a profile at ``s`` to the weights of the bumps nearest to it."""
    bumps = closure.bumps(s)
    return np.asarray(np.linalg.solve(bumps.T @ bumps + 1e-6 * len(s) * np.eye(BUMPS), bumps.T))


def _weights(found: Found, side: int) -> tuple[Array, Array]:
    """Weights of a side, and a root of the inverse of their covariance."""
    values, vectors = np.linalg.eigh(found.covariance(side))
    root = (vectors / np.sqrt(np.maximum(values, 1e-12 * values.max()))).T
    return found.weights[side], root


def _fit(form: Form, s: Array, profile: Array, lay: Array, values: Array, root: Array) -> Formula:
    from scipy.optimize import least_squares

    def miss(q: Array) -> Array:
        return np.asarray(root @ (values - lay @ form.shape(q, s)))

    best = None
    for start in form.starts(s, profile):
        if not start:
            misfit = float(np.sum(miss(np.array([])) ** 2))
            return Formula(form=form.name, text=form.text, numbers=(), errors=(), misfit=misfit, weights=np.zeros(BUMPS))
        fit = least_squares(miss, start, x_scale=np.maximum(np.abs(start), 1e-4), max_nfev=400)
        if best is None or fit.cost < best.cost:
            best = fit
    assert best is not None
    covariance = np.linalg.pinv(best.jac.T @ best.jac)
    return Formula(
        form=form.name,
        text=form.text,
        numbers=tuple(float(v) for v in best.x),
        errors=tuple(float(v) for v in np.sqrt(np.maximum(np.diag(covariance), 0))),
        misfit=2 * float(best.cost),
        weights=lay @ form.shape(best.x, s),
    )
