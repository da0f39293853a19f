"""Changes of the prediction by every listed candidate, of some sizes and to either side, beside a fit."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from looping_pendulum.discrepancy.candidates import Candidate
from looping_pendulum.discrepancy.evidence.changes import FINER, FINITE_SIZES, LINEAR_SIZE, Changes, finer, first_change, rms
from looping_pendulum.discrepancy.evidence.marginal import sigma_of
from looping_pendulum.discrepancy.evidence.prior import VISIBLE
from looping_pendulum.discrepancy.fit.calibration import Fit
from looping_pendulum.discrepancy.fit.predictions import Steps, together
from looping_pendulum.discrepancy.workers import SERIAL, Workers
from looping_pendulum.measured.free_parameter import FreeParameter, ParameterRole
from looping_pendulum.reference_ode.geometry import Array

SCALE_SIZE = 10.0
"""Change of the prediction by one scale of a candidate [RMS, in units of noise]."""
MIN_INDEPENDENT_SHARE = 1e-3
"""Smallest part of a change that the fitted parameters cannot make; below it, errors of finite differences decide."""
MIN_SHARE_OF_LINEAR = 0.3
"""Smallest such part for which a change of `LINEAR_SIZE` counts as linear; below it a change of `FINER` of that is taken.

Of a wrong mass, which a fitted mass makes up for but for its weighing, 12 % of the change was curvature: an eighth of the
smallest visible error was stated.
"""
MIN_SHARE_FOR_FINITE = 0.05
"""Smallest such part for which finite changes are tried, too.

If the fitted parameters absorb nearly all of a change, only its own curvature would be left.
"""
MAX_ODD_SHARE = 0.1
"""Largest part of a change that is opposite for the opposite value, up to which the effect counts as one of the square."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Template:
    """What a value of a candidate does to the prediction."""

    candidate: Candidate
    companions: tuple[FreeParameter, ...]
    """Parameters that shape it, at the values for which this is its change."""
    delta: float
    """Change of its value [SI]."""
    change: Array
    """Change of the prediction [units of the data], shape (n,)."""
    scale: float
    """Change of the value that changes the prediction by about `SCALE_SIZE` [units of noise]."""
    linear: bool
    """Whether minus the value does minus the change."""
    square: bool
    """Whether the change grows with the square of the value."""

    def value(self, amount: float) -> float | None:
        """Return the value less its null value [SI] that ``amount`` templates stand for; None: it is not possible."""
        if amount <= 0 and not self.linear:
            return None
        value = self.delta * (math.copysign(abs(amount) ** 0.5, amount) if self.square else amount)
        c = self.candidate
        return float(value) if c.bounds[0] <= c.null + value <= c.bounds[1] else None


@dataclass(frozen=True, kw_only=True)
class Visible:
    """The smallest size of a candidate that the data would show."""

    candidate: Candidate
    value: float
    """Change of its value [SI] that is `prior.VISIBLE` standard errors large."""
    motion: float
    """RMS change of the prediction by it, all else unchanged [units of noise]: what the fitted parameters hide."""
    can_hide: bool
    """Whether it changes nothing, however large it is, at the fit or with some of its companions' initial values."""


def smallest_visible(fit: Fit, found: Sequence[Template], complement: Array) -> list[Visible]:
    """Return the smallest visible size of every candidate that has a template, those that hide best first.

    Parameters
    ----------
    complement
        Gram matrix of the residuals and the templates beyond what the fitted parameters can do, shape (1 + m, 1 + m).
    """
    sigma = sigma_of(fit.problem.data)
    by_candidate: dict[str, dict[tuple[FreeParameter, ...], list[tuple[float, float]]]] = {}
    for t, square in zip(found, np.diag(complement)[1:], strict=True):
        amount = VISIBLE / math.sqrt(max(float(square), 1e-30))
        change = rms(np.divide(t.change, sigma, out=np.zeros_like(sigma), where=sigma > 0))
        if not t.square and change >= FINITE_SIZES[0]:
            # What does nothing up to some size, as static friction may, is only known to show at what was tried
            amount = max(amount, 1.0)
        value = abs(t.delta) * (math.sqrt(amount) if t.square else amount)
        by_candidate.setdefault(t.candidate.name, {}).setdefault(t.companions, []).append((value, amount * change))
    rows = []
    for c in {t.candidate.name: t.candidate for t in found}.values():
        cases = by_candidate[c.name]
        # Friction in its bearing, say, hides a rod that turns: the companions that hide it best say what is sure to show
        value, motion = max((of_case[0] for of_case in cases.values()), key=lambda one: one[0])
        p = fit.problem
        acts = np.array_equal(fit.x, c.where_it_acts(p.free_parameters, fit.x))
        can_hide = not acts or len(cases) < len(c.companion_grid())
        rows.append(Visible(candidate=c, value=value, motion=motion, can_hide=can_hide))
    return sorted(rows, key=lambda v: (-v.motion, v.candidate.name))


def templates(fit: Fit, chosen: Sequence[Candidate], workers: Workers = SERIAL) -> list[Template]:
    """Return the templates of candidates beside a fit."""
    basis = np.linalg.qr(fit.jacobian)[0]
    derivatives = {c.name: d for c in chosen if (d := _derivative_by_fitted(fit, c)) is not None}
    cases = [(c, tuple(values)) for c in chosen for values in c.companion_grid()]
    found = workers.map_together(_templates_together, (fit, basis, derivatives), cases)
    own = {c.name: c for c in chosen}  # a worker process returns copies
    return [dataclasses.replace(t, candidate=own[t.candidate.name]) for of_case in found for t in of_case]


def _templates_together(
    shared: tuple[Fit, Array, dict[str, Array]], cases: Sequence[tuple[Candidate, tuple[float, ...]]]
) -> list[list[Template]]:
    return together([_templates(*shared, *case) for case in cases])


def _templates(
    fit: Fit, basis: Array, derivatives: dict[str, Array], candidate: Candidate, companion_values: Sequence[float]
) -> Steps[list[Template]]:
    companions = candidate.companion_parameters(companion_values)
    problem = fit.problem.with_parameters(candidate.free_parameter(1.0), *companions)
    at = candidate.where_it_acts(fit.problem.free_parameters, fit.x)
    changes = Changes(problem, at, len(companions), len(fit.residuals))
    both_sides = candidate.bounds[0] < candidate.null < candidate.bounds[1] and not candidate.even
    reaches = [(candidate.bounds[1] if side > 0 else candidate.bounds[0]) - candidate.null for side in (1.0, -1.0)]
    reaches = [reach for reach, side in zip(reaches, (1.0, -1.0), strict=True) if side * reach > 0]
    # What a finite change does to the phase of a long swing, the fitted parameters nearly undo: its curvature would be left
    sizes = (LINEAR_SIZE,) if problem.is_swing else (LINEAR_SIZE, *FINITE_SIZES)
    where = yield from changes.find(reaches, sizes, first_change(candidate))
    if changes.cannot_run:
        return []
    linear = [delta for (_, size), delta in where.items() if size == LINEAR_SIZE and delta is not None]
    yield from changes.compute(
        [share * delta for delta in linear for share in ((-1.0, FINER, -FINER) if both_sides else (FINER,))]
    )
    found: list[Template] = []
    sigma = sigma_of(problem.data)

    def add(delta: float, change: Array, linear: bool, square: bool) -> None:
        # Beyond what the fitted parameters can do; below it, errors of finite differences decide
        if _independent_share(basis, change) >= MIN_INDEPENDENT_SHARE:
            size = SCALE_SIZE / max(rms(change), 1e-12)
            scale = abs(delta) * (size**0.5 if square else size)
            found.append(
                Template(
                    candidate=candidate,
                    companions=companions,
                    delta=delta,
                    change=change[: len(sigma)] * sigma,
                    scale=scale,
                    linear=linear,
                    square=square,
                )
            )

    square, finite, has_linear = candidate.even, True, False
    for reach in reaches:
        if square and reach < 0:
            continue
        delta = where[reach, LINEAR_SIZE]
        if delta is not None:
            change = changes.known[delta]
            assert change is not None
            opposite = changes.known.get(-delta) if both_sides else None
            if opposite is not None:
                # The central difference: what both sides have in common is curvature, not the linear effect
                central = 0.5 * (change - opposite)
                square = rms(central) < MAX_ODD_SHARE * rms(change)
                change = change if square else central
            if candidate.name in derivatives:
                change = derivatives[candidate.name] * delta
            elif not square and _independent_share(basis, change) < MIN_SHARE_OF_LINEAR:
                change = finer(changes.known, delta, opposite is not None, change)
            if opposite is not None and not square:
                finite = _independent_share(basis, change) > MIN_SHARE_FOR_FINITE
            if not has_linear:
                add(delta, change, opposite is not None, square)
            has_linear = opposite is not None and not square
        for size in sizes[1:] if finite else ():
            delta = where[reach, size]
            if delta is not None and (change := changes.known[delta]) is not None:
                add(delta, change, False, square)
    return found


def columns(found: Sequence[Template], n: int) -> Array:
    """Return the changes by templates, shape (n, m)."""
    return np.stack([t.change for t in found], axis=1) if found else np.zeros((n, 0))


def _derivative_by_fitted(fit: Fit, candidate: Candidate) -> Array | None:
    """Return the derivative by a factor on a parameter that is fitted in all its trials; None: the candidate is none.

    Only what was measured of the parameter tells such a factor from it. At an event that hardly happens a difference would have
    another derivative, and seem to tell them apart.
    """
    parameters = list(enumerate(fit.problem.free_parameters))
    same = [(i, p) for i, p in parameters if p.parameter == candidate.parameter and p.role is ParameterRole.SET]
    fitted = {d.trial.name for d in fit.problem.data}.intersection(candidate.trials)
    if candidate.role is not ParameterRole.TIMES or not {t for _, p in same for t in p.trials} >= fitted:
        return None
    derivative = np.sum([fit.jacobian[:, i] * (p.init_value / p.scale + fit.x[i]) for i, p in same], axis=0)
    derivative[fit.problem.measured_rows :] = 0.0  # the prior is that of the measured value
    return np.asarray(derivative)


def _independent_share(basis: Array, change: Array) -> float:
    """Return the size of the part of a change that the fitted parameters cannot make, relative to the change."""
    part = change - basis @ (basis.T @ change)
    return float(np.linalg.norm(part)) / max(float(np.linalg.norm(change)), 1e-300)
