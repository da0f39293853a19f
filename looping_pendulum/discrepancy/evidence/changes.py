"""What values of a candidate do to the prediction, and which values change it by about a given size."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from looping_pendulum.discrepancy.candidates import Candidate
from looping_pendulum.discrepancy.fit.predictions import MIN_BATCH, Steps, jacobian_at, predict
from looping_pendulum.discrepancy.fit.problem import Problem
from looping_pendulum.reference_ode.batch import compiled_alone, supports
from looping_pendulum.reference_ode.geometry import Array

LINEAR_SIZE, FINITE_SIZES = 0.3, (3.0, 12.0)
"""Sizes of the changes of the prediction that are tried [RMS, in units of noise]: one that is still linear, and finite ones."""
FINER = 0.1
"""Share of a linear change that shows whether it is one."""
FIRST_FACTORS = (1.0, 10.0, 40.0)
"""Factors on the smallest change of the value that is tried at once: about those of the sizes."""
MAX_TRIES, MAX_FAILURES = 10, 2
"""Largest number of steps in which changes of given sizes are looked for, and how many values may be impossible."""


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
        self, reaches: Sequence[float], sizes: Sequence[float], first: float
    ) -> Steps[dict[tuple[float, float], float | None]]:
        """Find changes of the value up to each reach [SI] that change the prediction by about these sizes.

        A change of ``first`` [SI] is tried first; where it cannot run, no smaller one is.

        Returns (reach, size) -> change of the value; None if the reach comes first and hardly anything changes.
        """
        sides = {reach: math.copysign(1.0, reach) for reach in reaches}
        tries = [side * min(first * factor, abs(reach)) for reach, side in sides.items() for factor in FIRST_FACTORS]
        for _ in range(MAX_TRIES):
            yield from self.compute(tries)
            tries = []
            for reach, side in sides.items():
                guesses = [_next_try(self._tried(side), abs(reach), size, first) for size in sizes]
                tries += [side * guess for guess in guesses if guess is not None]
            if not tries or self.cannot_run:
                break
        return {(r, size): _chosen(self._tried(side), side, abs(r), size) for r, side in sides.items() for size in sizes}

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


def steps_together(problem: Problem, candidate: Candidate) -> bool:
    """Return whether runs with a candidate are made in a batch, whose one compiled model serves all such candidates."""
    base, names = problem.base[0], [candidate.parameter, *(c.name for c in candidate.companions)]
    names = [name for name in names if name in base.coefficients]
    return not problem.is_swing and supports(base, names) and not compiled_alone(base.effects_with(names))


def compile_for(problem: Problem, candidate: Candidate | None) -> None:
    """Run every trial with a little of a candidate, so that its equations are compiled.

    None: compute derivatives of the model without a candidate.
    """
    if candidate is None:
        jacobian_at(problem, problem.prior_mean)
        return
    companions = candidate.companion_parameters(candidate.companion_grid()[0])
    delta = math.copysign(first_change(candidate), candidate.bounds[1] - candidate.null or -1.0)
    x = np.concatenate([problem.prior_mean, [delta], np.zeros(len(companions))])
    extended = problem.with_parameters(candidate.free_parameter(1.0), *companions)
    # As many runs as a batch needs, if it takes the effect
    rows = np.tile(x, (MIN_BATCH if steps_together(problem, candidate) else 1, 1))
    rows[:, len(problem.prior_mean)] *= np.linspace(0.5, 1.0, len(rows))
    predict([(extended, rows)])
