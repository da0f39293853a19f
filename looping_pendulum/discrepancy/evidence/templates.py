"""Changes of the prediction by every listed candidate, of some sizes and to either side, beside a fit."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from looping_pendulum.discrepancy.candidates import Candidate
from looping_pendulum.discrepancy.evidence.marginal import sigma_of
from looping_pendulum.discrepancy.evidence.prior import VISIBLE
from looping_pendulum.discrepancy.fit.calibration import Fit
from looping_pendulum.discrepancy.fit.problem import Problem
from looping_pendulum.discrepancy.result import SmallestVisible
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
LINEAR_SIZE, FINITE_SIZES = 0.3, (3.0, 12.0)
"""Sizes of the changes of the prediction that are tried [RMS, in units of noise]: one that is still linear, and finite ones."""
FINER = 0.1
"""Share of a linear change that shows whether it is one."""
FIRST_FACTORS = (1.0, 40.0)
"""Factors on the smallest change of the value that is tried at once: about that of the sizes."""
MAX_TRIES, MAX_FAILURES = 10, 2
"""Largest number of steps in which changes of given sizes are looked for, and how many values may be impossible."""


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


def smallest_visible(fit: Fit, found: Sequence[Template], complement: Array) -> list[SmallestVisible]:
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
        acts = np.array_equal(fit.x, c.where_it_acts(fit.problem.free_parameters, fit.x))
        rows.append(
            SmallestVisible(
                name=c.name,
                value=value,
                unit=c.unit,
                acts_on=c.acts_on,
                null_value=c.null,
                motion=motion,
                can_hide=not acts or len(cases) < len(c.companion_grid()),
            )
        )
    return sorted(rows, key=lambda v: (-v.motion, v.name))


def templates(fit: Fit, chosen: Sequence[Candidate]) -> list[Template]:
    """Return the templates of candidates beside a fit."""
    basis = np.linalg.qr(fit.jacobian)[0]
    derivatives = {c.name: d for c in chosen if (d := _derivative_by_fitted(fit, c)) is not None}
    cases = [(c, tuple(values)) for c in chosen for values in c.companion_grid()]
    return [t for c, values in cases for t in _templates(fit, basis, derivatives, c, values)]


def _templates(
    fit: Fit, basis: Array, derivatives: dict[str, Array], candidate: Candidate, companion_values: Sequence[float]
) -> list[Template]:
    companions = candidate.companion_parameters(companion_values)
    problem = fit.problem.with_parameters(candidate.free_parameter(1.0), *companions)
    at = candidate.where_it_acts(fit.problem.free_parameters, fit.x)
    changes = Changes(problem, at, len(companions), len(fit.residuals))
    both_sides = candidate.bounds[0] < candidate.null < candidate.bounds[1] and not candidate.even
    reaches = [(candidate.bounds[1] if side > 0 else candidate.bounds[0]) - candidate.null for side in (1.0, -1.0)]
    reaches = [reach for reach, side in zip(reaches, (1.0, -1.0), strict=True) if side * reach > 0]
    # What a finite change does to the phase of a long swing, the fitted parameters nearly undo: its curvature would be left
    sizes = (LINEAR_SIZE,) if problem.is_swing else (LINEAR_SIZE, *FINITE_SIZES)
    where = changes.find(reaches, sizes, first_change(candidate))
    if changes.cannot_run:
        return []
    linear = [delta for (_, size), delta in where.items() if size == LINEAR_SIZE and delta is not None]
    changes.compute([share * delta for delta in linear for share in ((-1.0, FINER, -FINER) if both_sides else (FINER,))])
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


class Changes:
    """What values of a candidate do to the standardised prediction, each computed once."""

    def __init__(self, problem: Problem, x: Array, companion_count: int, rows: int) -> None:
        """Prepare; ``x``: parameters without the candidate and its companions; ``rows``: length of a change."""
        self._problem, self._null = problem, np.concatenate([x, np.zeros(1 + companion_count)])
        self._rows = rows
        self._place = len(x)
        self._here: Array | None = None
        self._events: NDArray[np.bool_] = np.zeros(0, dtype=bool)
        self.known: dict[float, Array | None] = {}
        """Change of the value [SI] -> that of the prediction; None: the model cannot run there, or loses an event."""
        self.cannot_run = False
        """Whether the model cannot run without the candidate."""

    def compute(self, deltas: Iterable[float]) -> None:
        """Compute what these changes of the value do [SI], all at once."""
        new = [delta for delta in dict.fromkeys(deltas) if delta not in self.known]
        if not new or self.cannot_run:
            return
        at = np.tile(self._null, (len(new) + (self._here is None), 1))
        at[-len(new) :, self._place] = new
        residuals = [self._problem.residuals_of(x, row) for x, row in zip(at, self._problem.predict_many(at), strict=True)]
        if self._here is None:
            self._here = residuals[0]
            if self._here is None:
                self.cannot_run = True
                return
            self._events = self._problem.events_that_happen(self._null)
        for x, delta, moved in zip(at[-len(new) :], new, residuals[-len(new) :], strict=True):
            change = None
            if moved is not None and not (len(self._events) and np.any(self._events & ~self._problem.events_that_happen(x))):
                change = np.zeros(self._rows)  # the rows of the prior stay zero: a candidate has none
                change[: self._problem.measured_rows] = (self._here - moved)[: self._problem.measured_rows]
            self.known[delta] = change

    def find(self, reaches: Sequence[float], sizes: Sequence[float], first: float) -> dict[tuple[float, float], float | None]:
        """Find changes of the value up to each reach [SI] that change the prediction by about these sizes.

        A change of ``first`` [SI] is tried first; where it cannot run, no smaller one is. To a second side, the changes that
        were found to the first one are.

        Returns (reach, size) -> change of the value; None if the reach comes first and hardly anything changes.
        """
        found: dict[tuple[float, float], float | None] = {}
        tries = first_tries = [first * factor for factor in FIRST_FACTORS]
        for reach in reaches:
            side = math.copysign(1.0, reach)
            for _ in range(MAX_TRIES):
                self.compute([side * min(delta, abs(reach)) for delta in tries])
                guesses = [_next_try(self._tried(side), abs(reach), size, first) for size in sizes]
                tries = [guess for guess in guesses if guess is not None]
                if not tries or self.cannot_run:
                    break
            chosen = {size: _chosen(self._tried(side), side, abs(reach), size) for size in sizes}
            found |= {(reach, size): delta for size, delta in chosen.items()}
            mirrored = [abs(delta) for delta in chosen.values() if delta is not None]
            tries = mirrored or first_tries
        return found

    def _tried(self, side: float) -> list[tuple[float, float]]:
        """Return sizes of the changes of the value to a side, and of those of the prediction: infinite where it cannot run."""
        return sorted((abs(d), math.inf if v is None else rms(v)) for d, v in self.known.items() if d * side > 0)


def _next_try(tried: Sequence[tuple[float, float]], reach: float, size: float, smallest: float) -> float | None:
    """Return a change of the value to try for a change of the prediction by about ``size``; None: what was tried suffices.

    Steps are in proportion to the change that is missing. Between a change that is too small and one that is too large, they
    follow a power law through both, since what an effect does may grow with the square of its value.
    """
    # About the size is enough, since the evidence does not depend on it as long as the change is linear
    if any(_is_about(rms, size) for _, rms in tried) or sum(math.isinf(rms) for _, rms in tried) > MAX_FAILURES:
        return None
    low = max([t for t in tried if t[1] < size], default=(0.0, 0.0))
    high = min([t for t in tried if t[0] > low[0]], default=(math.inf, math.inf))
    if math.isinf(high[1]) and math.isfinite(high[0]):
        # A string that stretches too little for the integrator's steps: what runs at a larger value does not at any smaller one
        if high[0] <= smallest or any(math.isfinite(rms) for delta, rms in tried if delta > high[0]):
            return None
    elif math.isinf(high[0]) and low[0] >= reach:
        return None
    if low[1] > 0 and math.isfinite(high[1]):
        share = math.log(size / low[1]) / math.log(high[1] / low[1])
        guess: float = low[0] * (high[0] / low[0]) ** share
    else:
        # At most two decades, since far from there the change is hardly proportional
        known = low if low[0] else high
        guess = known[0] * min(max(size / max(known[1], 1e-30), 1e-2), 1e2)
    if not low[0] < guess < high[0]:
        guess = math.sqrt(max(low[0], high[0] / 100) * high[0]) if math.isfinite(high[0]) else 10 * low[0]
    return min(guess, reach)


def _chosen(tried: Sequence[tuple[float, float]], side: float, reach: float, size: float) -> float | None:
    """Return the change of the value that changes the prediction by about ``size``, or hardly at all up to the reach: None."""
    runs = [t for t in tried if math.isfinite(t[1]) and t[1] > 0]
    if not runs:
        return None
    delta, rms = min(runs, key=lambda t: abs(math.log(t[1] / size)))
    at_reach = delta >= reach and rms < size and rms > 0.1 * LINEAR_SIZE
    return float(side * delta) if _is_about(rms, size) or at_reach else None


def _is_about(rms: float, size: float) -> bool:
    return bool(0.5 < rms / size < 2)


def finer(known: Mapping[float, Array | None], delta: float, central: bool, template: Array) -> Array:
    """Return the change by ``delta`` [SI] as far as it is linear, from a smaller one; ``template`` where that cannot run."""
    ahead = known[FINER * delta]
    behind = known[-FINER * delta] if central else None
    if ahead is None or (central and behind is None):
        return template
    return (ahead if behind is None else 0.5 * (ahead - behind)) / FINER


def rms(v: Array) -> float:
    """Return the root mean square."""
    return float(np.sqrt(np.mean(v**2)))


def first_change(candidate: Candidate) -> float:
    """Return the change that is tried first [SI]."""
    return 1e-3 * abs(candidate.null) or 1e-6
