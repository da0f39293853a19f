"""Screen candidates: score test of each one's sensitivity against the residuals, beyond what the fitted parameters can do."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from looping_pendulum.discrepancy.data.free_parameter import FreeParameter, ParameterRole
from looping_pendulum.discrepancy.fit.calibration import Fit
from looping_pendulum.discrepancy.fit.predictions import MIN_BATCH, Steps, jacobian_at, predict, together
from looping_pendulum.discrepancy.fit.problem import Problem
from looping_pendulum.discrepancy.listed.candidates import Candidate
from looping_pendulum.discrepancy.workers import SERIAL, Workers
from looping_pendulum.reference_ode.batch import compiled_alone, supports
from looping_pendulum.reference_ode.geometry import Array

LINEAR_SIZE, FINITE_SIZES = 0.3, (3.0, 12.0)
"""Sizes of the changes of the prediction that are tried [RMS, in units of noise]: one that is still linear, and finite ones."""
SCALE_SIZE = 10.0
"""Change of the prediction by one scale of a candidate [RMS, in units of noise]."""
MIN_INDEPENDENT_SHARE = 1e-3
"""Smallest part of a change that the fitted parameters cannot make; below it, errors of finite differences decide."""
MIN_SHARE_OF_LINEAR = 0.3
"""Smallest such part for which a change of `LINEAR_SIZE` counts as linear; below it a change of `FINER` of that is taken.

Of a wrong mass, which a fitted mass makes up for but for its weighing, 12 % of the change was curvature: the score was that of
the curvature, and an eighth of the smallest visible error was stated.
"""
FINER = 0.1
"""Share of the change that is taken there."""
MIN_SHARE_FOR_FINITE = 0.05
"""Smallest such part for which finite changes are tried, too.

If the fitted parameters absorb nearly all of a change, only its own curvature would be left.
"""
MAX_ODD_SHARE = 0.1
"""Largest part of a change that is opposite for the opposite value, up to which the effect counts as one of the square."""
MIN_ALIGNMENT = 0.99
"""Cosine between the linear change and the first finite one above which no larger change is tried."""
MAX_NULL_SCORE = 4.0
"""Largest score |z| that noise alone may give; 99 % of clean studies stay below it (docs/data/calibration.json)."""
FIRST_FACTORS = (1.0, 10.0, 40.0)
"""Factors on the change of the value that is tried first: they are those of the sizes, where it was known from another fit."""
MAX_TRIES, MAX_FAILURES = 10, 2
"""Largest number of steps in which changes of given sizes are looked for, and how many values may be impossible."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ScreenedCandidate:
    """How strongly the residuals of a fit look like a candidate's effect."""

    candidate: Candidate
    score: float
    """Score (z) of the best template; its square is the predicted decrease of chi2."""
    amplitude: float
    """Predicted value less the null value [SI]."""
    error: float
    """Standard error of the value by the template [SI]: an effect several times as large would be seen.

    With companions it is the largest at any of their initial values: friction in its bearing, say, hides a rod that turns.
    """
    motion_by_error: float
    """Change of the prediction by one `error`, all else unchanged [RMS, in units of noise]."""
    scale: float
    """Change of the value [SI] that changes the prediction by `SCALE_SIZE`."""
    small_change: float
    """Change of the value [SI] that changes the prediction by about `LINEAR_SIZE`: where another screening begins."""
    companions: tuple[FreeParameter, ...] = ()
    """Parameters that are fitted with it, at the values that give the highest score."""
    acts_at_fit: bool = True
    """Whether it changes something at the fitted values. Elsewhere (`Candidate.where_it_acts`) its score says little."""
    can_hide: bool = False
    """Whether it changes nothing, however large it is, at the fit or with some of its companions' initial values."""
    score_beyond_bounds: float = 0.0
    """Largest |z| at values that are not possible."""

    @property
    def held_by(self) -> str:
        """Return what is known in general that keeps the value within its bounds, while the residuals would have it beyond."""
        held = self.score_beyond_bounds > max(abs(self.score), MAX_NULL_SCORE)
        return self.candidate.bounds_reason if held else ""


def screen(
    fit: Fit,
    chosen: Sequence[Candidate],
    without: Sequence[str] = (),
    workers: Workers = SERIAL,
    known_changes: Mapping[str, float] = MappingProxyType({}),
) -> list[ScreenedCandidate]:
    """Score candidates, best first. Those that do not change the prediction are left out.

    Parameters
    ----------
    known_changes
        Candidate's name -> its `ScreenedCandidate.small_change` beside an earlier fit, from which the search for a change of
        the right size begins.
    without
        Parameters of the fit that are set to their null value while sensitivities are computed: every new set of effects costs
        a compilation, and an effect that was added hardly changes what another one does.
    """
    kept = [i for i, n in enumerate(fit.problem.names) if n not in without]
    jacobian = fit.jacobian
    if without:  # all sensitivities must be taken at one point, or their difference looks like an effect
        null = np.where(np.isin(fit.problem.names, without), 0.0, fit.x)
        jacobian = jacobian_at(fit.problem, null)
    basis, _ = np.linalg.qr(jacobian)
    # What the fitted parameters could explain is no evidence for a candidate
    residual = _orthogonal_part(basis, fit.residuals)
    reduced = Problem(fit.problem.study, fit.problem.data, [fit.problem.free_parameters[i] for i in kept])
    derivatives = {c.name: d for c in chosen if (d := _derivative_by_fitted(fit, jacobian, c)) is not None}
    shared = _ScreeningInput(reduced, fit.x[kept], basis, residual, dict(known_changes), derivatives)
    results = workers.map_together(_screen_together, shared, chosen)
    # a worker process returns copies of the candidates; put this process's own in their place
    screened = [dataclasses.replace(s, candidate=c) for c, s in zip(chosen, results, strict=True) if s]
    return sorted(screened, key=lambda s: -abs(s.score))


def compile_for(problem: Problem, candidate: Candidate | None) -> None:
    """Run every trial with a little of a candidate, so that its equations are compiled.

    None: compute derivatives of the model without a candidate.
    """
    if candidate is None:
        jacobian_at(problem, problem.prior_mean)
        return
    companions = candidate.companion_parameters(candidate.companion_grid()[0])
    delta = math.copysign(_first_change(candidate), candidate.bounds[1] - candidate.null or -1.0)
    x = np.concatenate([problem.prior_mean, [delta], np.zeros(len(companions))])
    extended = problem.with_parameters(candidate.free_parameter(1.0), *companions)
    # As many runs as a batch needs, if it takes the effect
    rows = np.tile(x, (MIN_BATCH if steps_together(problem, candidate) else 1, 1))
    rows[:, len(problem.prior_mean)] *= np.linspace(0.5, 1.0, len(rows))
    predict([(extended, rows)])


def steps_together(problem: Problem, candidate: Candidate) -> bool:
    """Return whether runs with a candidate are made in a batch, whose one compiled model serves all such candidates."""
    base, names = problem.base[0], [candidate.parameter, *(c.name for c in candidate.companions)]
    names = [name for name in names if name in base.coefficients]
    return not problem.is_swing and supports(base, names) and not compiled_alone(base.effects_with(names))


def _first_change(candidate: Candidate) -> float:
    """Return the change that is tried first [SI]."""
    return 1e-3 * abs(candidate.null) or 1e-6


class _ScreeningInput(NamedTuple):
    """Input that is the same for all candidates."""

    reduced: Problem
    """Problem without the parameters that are set to their null value."""
    x: Array
    """Its parameters, shape (p,)."""
    basis: Array
    """Orthonormal basis of the changes that the fitted parameters can make, shape (n, p)."""
    residual: Array
    """Part of the residuals that is orthogonal to these, shape (n,)."""
    known_changes: dict[str, float]
    """Candidate's name -> its `ScreenedCandidate.small_change` beside an earlier fit."""
    derivatives: dict[str, Array]
    """Candidate's name -> how the prediction changes with its value, shape (n,), where fitted parameters say it."""


def _derivative_by_fitted(fit: Fit, jacobian: Array, candidate: Candidate) -> Array | None:
    """Return the derivative by a factor on a parameter that is fitted in all its trials; None: the candidate is none.

    Only what was measured of the parameter tells such a factor from it. At an event that hardly happens a difference would have
    another derivative, and seem to tell them apart.
    """
    parameters = list(enumerate(fit.problem.free_parameters))
    same = [(i, p) for i, p in parameters if p.parameter == candidate.parameter and p.role is ParameterRole.SET]
    fitted = {d.trial.name for d in fit.problem.data}.intersection(candidate.trials)
    if candidate.role is not ParameterRole.TIMES or not {t for _, p in same for t in p.trials} >= fitted:
        return None
    derivative = np.sum([jacobian[:, i] * (p.init_value / p.scale + fit.x[i]) for i, p in same], axis=0)
    derivative[fit.problem.measured_rows :] = 0.0  # the prior is that of the measured value
    return np.asarray(derivative)


def _screen_together(shared: _ScreeningInput, chosen: Sequence[Candidate]) -> list[ScreenedCandidate | None]:
    """Score candidates, all in step, each with each of its companions' initial values."""
    cases = [(c, values) for c in chosen for values in c.companion_grid()]
    results = iter(together([_screen_with_companions(shared, *case) for case in cases]))
    return [_best_of(shared, c, [next(results) for _ in c.companion_grid()]) for c in chosen]


def _best_of(
    shared: _ScreeningInput, candidate: Candidate, screened: Sequence[ScreenedCandidate | None]
) -> ScreenedCandidate | None:
    """Return the best of what a candidate has with its companions' initial values, or None if nothing changes."""
    results = [s for s in screened if s]
    if not results:
        return None
    acts_at_fit = np.array_equal(shared.x, candidate.where_it_acts(shared.reduced.free_parameters, shared.x))
    best = max(results, key=lambda s: abs(s.score))
    best_hidden = max(results, key=lambda s: s.error)
    return dataclasses.replace(
        best,
        error=best_hidden.error,
        motion_by_error=best_hidden.motion_by_error,
        acts_at_fit=acts_at_fit,
        can_hide=len(results) < len(screened) or not acts_at_fit,
    )


def slowest_first(chosen: Iterable[Candidate]) -> list[Candidate]:
    """Order candidates so that those that take longest come first: at the end all workers then have something to do."""
    return sorted(chosen, key=lambda c: -len(c.companion_grid()))


def _orthogonal_part(basis: Array, v: Array) -> Array:
    """Return the part of ``v`` that the fitted parameters cannot make."""
    return np.asarray(v - basis @ (basis.T @ v))


def _screen_with_companions(
    shared: _ScreeningInput, candidate: Candidate, values: Sequence[float]
) -> Steps[ScreenedCandidate | None]:
    """Score a candidate whose companions have these ``values`` [SI]."""
    reduced, x, basis, residual, known_changes, derivatives = shared
    companions = candidate.companion_parameters(values)
    x = candidate.where_it_acts(reduced.free_parameters, x)
    problem = reduced.with_parameters(candidate.free_parameter(1.0), *companions)
    changes = _Changes(problem, x, len(companions), len(residual))
    best, beyond, scale, linear_error, finite_error = (0.0, 0.0), 0.0, 0.0, math.inf, math.inf
    both_sides = candidate.bounds[0] < candidate.null < candidate.bounds[1] and not candidate.even
    templates: tuple[float, ...] = FINITE_SIZES
    is_square = candidate.even  # a push out of the plane, say, does the same to either side
    reaches = [(candidate.bounds[1] if side > 0 else candidate.bounds[0]) - candidate.null for side in (1.0, -1.0)]
    reaches = [reach for reach, side in zip(reaches, (1.0, -1.0), strict=True) if side * reach > 0]
    # A run of a long swing costs ten times that of a loop, so that finite changes are made where they are needed
    sizes = (LINEAR_SIZE,) if reduced.is_swing else (LINEAR_SIZE, *FINITE_SIZES)
    first, smallest = known_changes.get(candidate.name) or _first_change(candidate), _first_change(candidate)
    found = yield from changes.find(reaches, sizes, first, smallest)
    if changes.cannot_run:
        return None
    linear_changes = [delta for (_, size), delta in found.items() if size == LINEAR_SIZE and delta is not None]
    finer = [share * delta for delta in linear_changes for share in (-1.0, FINER, -FINER)] if both_sides else []
    yield from changes.compute(finer or [FINER * delta for delta in linear_changes])
    for reach in reaches:
        if is_square and reach < 0:
            continue
        linear: Array | None = None
        opposite: Array | None = None
        for size in (LINEAR_SIZE, *FINITE_SIZES):
            if (reach, size) not in found:
                found |= yield from changes.find([reach], [size], first, smallest)
            delta = found[reach, size]
            if delta is None:  # below the integrator's errors, or without effect
                continue
            template = changes.known[delta]
            assert template is not None
            if size == LINEAR_SIZE:
                first = abs(delta)
                opposite = changes.known[-delta] if both_sides else None
                if opposite is not None:
                    # The central difference: what both sides have in common is curvature, not the linear effect
                    central = 0.5 * (template - opposite)
                    is_square = _rms(central) < MAX_ODD_SHARE * _rms(template)
                    if not is_square:
                        template = central
                if candidate.name in derivatives:
                    template = derivatives[candidate.name] * delta
                elif not is_square and _independent_share(basis, template) < MIN_SHARE_OF_LINEAR:
                    template = _finer(changes.known, delta, opposite is not None, template)
                # In a swing, finite changes in one direction, too, only show their own curvature: they shift its phase
                if (opposite is not None or reduced.is_swing) and not is_square:
                    templates = FINITE_SIZES if _independent_share(basis, template) > MIN_SHARE_FOR_FINITE else ()
                linear = template
            if size == LINEAR_SIZE and opposite is not None and not is_square and math.isfinite(linear_error):
                score, amplitude = 0.0, 0.0  # the central difference is that to the other side
            elif size in (LINEAR_SIZE, *templates):
                score, amplitude, error_here = _score(basis, residual, template, delta)
                if is_square:
                    amplitude = math.copysign(math.sqrt(max(amplitude / delta, 0.0)) * delta, delta)
                    error_here = math.sqrt(abs(delta) * error_here / MAX_NULL_SCORE)  # so that 4 errors have a score of 4
                if size == LINEAR_SIZE and _rms(template) < FINITE_SIZES[0]:
                    linear_error = min(linear_error, error_here)
                else:
                    # An effect that does nothing up to some size, as static friction may: only what was tried is known to show
                    finite_error = min(finite_error, max(error_here, abs(delta) / MAX_NULL_SCORE))
            else:
                score, amplitude = 0.0, 0.0
            allowed = candidate.bounds[0] <= candidate.null + amplitude <= candidate.bounds[1]
            # the linear template holds for both signs, a finite one only for its own
            if not allowed:
                beyond = max(beyond, abs(score))
            elif abs(score) > abs(best[0]) and (score > 0 or (size == LINEAR_SIZE and not is_square)):
                best = score, amplitude
            if size == FINITE_SIZES[-1]:
                scale = max(scale, abs(delta))
            elif reduced.is_swing and not templates:
                # Finite changes would show the scale alone
                scale = max(scale, min(abs(delta) * FINITE_SIZES[-1] / size, abs(reach)))
                break
            elif size == FINITE_SIZES[0] and not (templates and _alignment(basis, linear, template) < MIN_ALIGNMENT):
                # A still larger change would say the same again
                scale = max(scale, min(abs(delta) * FINITE_SIZES[-1] / FINITE_SIZES[0], abs(reach)))
                break
    if not scale:
        return None
    scale *= SCALE_SIZE / FINITE_SIZES[-1]
    if reduced.is_swing and best[1]:
        # What a candidate does to a long swing's phase, the fitted parameters nearly undo, so that a scale by the whole change
        # of the prediction would be off by orders of magnitude; the prior and the steps of a refit are in units of it
        scale = abs(best[1])
    # The curvature of a finite change would make effects look visible that the fitted parameters hide
    error = linear_error if math.isfinite(linear_error) else finite_error
    visible = MAX_NULL_SCORE * error / scale
    return ScreenedCandidate(
        candidate=candidate,
        score=best[0],
        amplitude=best[1],
        error=error,
        motion_by_error=SCALE_SIZE * (visible**2 if is_square else visible) / MAX_NULL_SCORE,
        scale=scale,
        small_change=first,
        companions=companions,
        score_beyond_bounds=beyond,
    )


class _Changes:
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

    def compute(self, deltas: Iterable[float]) -> Steps[None]:
        """Compute what these changes of the value do [SI], all at once."""
        new = [delta for delta in dict.fromkeys(deltas) if delta not in self.known]
        if not new or self.cannot_run:
            return
        at = np.tile(self._null, (len(new) + (self._here is None), 1))
        at[-len(new) :, self._place] = new
        predicted = yield self._problem, at
        residuals = [self._problem.residuals_of(x, row) for x, row in zip(at, predicted, strict=True)]
        if self._here is None:
            self._here = residuals[0]
            if self._here is None:
                self.cannot_run = True
                return
            self._events = self._problem.events_that_happen(self._null)
        for x, delta, moved in zip(at[-len(new) :], new, residuals[-len(new) :], strict=True):
            change = None
            if moved is not None and not (len(self._events) and self._loses_event(x)):
                change = np.zeros(self._rows)  # the rows of the prior stay zero: a candidate has none
                change[: self._problem.measured_rows] = (self._here - moved)[: self._problem.measured_rows]
            self.known[delta] = change

    def _loses_event(self, x: Array) -> bool:
        return bool(np.any(self._events & ~self._problem.events_that_happen(x)))

    def find(
        self, reaches: Sequence[float], sizes: Sequence[float], first: float, smallest: float
    ) -> Steps[dict[tuple[float, float], float | None]]:
        """Find changes of the value up to each reach [SI] that change the prediction by about these sizes.

        Where a change of ``smallest`` [SI] cannot run, no smaller one is tried; ``first`` is tried first.

        Returns (reach, size) -> change of the value; None if the reach comes first and hardly anything changes.
        """
        sides = {reach: math.copysign(1.0, reach) for reach in reaches}
        tries = [side * min(first * factor, abs(reach)) for reach, side in sides.items() for factor in FIRST_FACTORS]
        for _ in range(MAX_TRIES):
            yield from self.compute(tries)
            tries = []
            for reach, side in sides.items():
                guesses = [_next_try(self._tried(side), abs(reach), size, smallest) for size in sizes]
                tries += [side * guess for guess in guesses if guess is not None]
            if not tries or self.cannot_run:
                break
        return {(r, size): _chosen(self._tried(side), side, abs(r), size) for r, side in sides.items() for size in sizes}

    def _tried(self, side: float) -> list[tuple[float, float]]:
        """Return sizes of the changes of the value to a side, and of those of the prediction: infinite where it cannot run."""
        return sorted((abs(d), math.inf if v is None else _rms(v)) for d, v in self.known.items() if d * side > 0)


def _next_try(tried: Sequence[tuple[float, float]], reach: float, size: float, smallest: float) -> float | None:
    """Return a change of the value to try for a change of the prediction by about ``size``; None: what was tried suffices.

    Steps are in proportion to the change that is missing. Between a change that is too small and one that is too large, they
    follow a power law through both, since what an effect does may grow with the square of its value.
    """
    # About the size is enough, since a score does not depend on it as long as the change is linear
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


def _finer(known: Mapping[float, Array | None], delta: float, central: bool, template: Array) -> Array:
    """Return the change by ``delta`` [SI] as far as it is linear, from a smaller one; ``template`` where that cannot run."""
    ahead = known[FINER * delta]
    behind = known[-FINER * delta] if central else None
    if ahead is None or (central and behind is None):
        return template
    return (ahead if behind is None else 0.5 * (ahead - behind)) / FINER


def _rms(v: Array) -> float:
    return float(np.sqrt(np.mean(v**2)))


def _independent_share(basis: Array, v: Array) -> float:
    """Return the size of the part of ``v`` that the fitted parameters cannot make, relative to ``v``."""
    return float(np.linalg.norm(_orthogonal_part(basis, v))) / max(float(np.linalg.norm(v)), 1e-300)


def _alignment(basis: Array, linear: Array | None, finite: Array) -> float:
    """Return the cosine between a linear and a finite change, of their parts that the fitted parameters cannot make."""
    if linear is None:
        return 0.0
    a, b = _orthogonal_part(basis, linear), _orthogonal_part(basis, finite)
    return float(a @ b) / max(float(np.linalg.norm(a)) * float(np.linalg.norm(b)), 1e-300)


def _score(basis: Array, residual: Array, v: Array, delta: float) -> tuple[float, float, float]:
    """Return the score (z) of a template ``v`` made by ``delta`` [SI], the amplitude that fits best, and its error [SI]."""
    if _independent_share(basis, v) < MIN_INDEPENDENT_SHARE:
        return 0.0, 0.0, math.inf
    template = _orthogonal_part(basis, v)
    norm = float(np.linalg.norm(template))
    return float(template @ residual) / norm, delta * float(template @ residual) / norm**2, abs(delta) / norm
