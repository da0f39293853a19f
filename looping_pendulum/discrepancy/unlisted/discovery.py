"""What no library lists: an unknown force as a function of time or of the state, found as a row of bumps.

While the string slides, a force on the heavy mass and one along the light mass's string move everything alike, so a force as
a function of *time* cannot name its body; as a function of the *state* it can, and data that no fit saw is the judge. Each
closure (a coordinate, a factor, the sides it acts on) is screened by its sensitivities beyond all fitted numbers, with the
size of its ridge chosen by evidence; the best are refitted by trajectory.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from looping_pendulum.discrepancy.data.study import Estimate, Study
from looping_pendulum.discrepancy.fit.calibration import ROUGHLY, Fit, FitError, minimise
from looping_pendulum.discrepancy.fit.problem import FreeParameter, ParameterRole, Problem, TrialData
from looping_pendulum.discrepancy.fit.residual import with_noise_of_residuals
from looping_pendulum.discrepancy.listed.attribution import HeldOutTest, judge
from looping_pendulum.discrepancy.workers import ALONE, Workers
from looping_pendulum.reference_ode.effects.closure import BUMPS, COORDINATES, FACTORS, weight
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.solution import Samples

TARGETS: dict[str, tuple[str, ...]] = {
    "light mass, along the string": ("along",),
    "light mass, across the string": ("across",),
    "light mass": ("along", "across"),
    "heavy mass": ("heavy",),
}
"""Where an unknown force may act -> sides of the closure."""
MARGIN = 0.5
"""Bumps beyond either end of the coordinate's range."""
PROBE = 1e-3
"""Weight [N] whose effect is taken for the derivative."""
FLAT = 1e-4
"""Distance of bumps [SI] below which a coordinate counts as constant."""
REFITS = 4
SIGNIFICANT = 2.0
"""Standard errors that a force must exceed somewhere to be told of there."""

Tick = Callable[[str], None]


@dataclass(frozen=True, kw_only=True)
class Closure:
    """One form that the unknown force may have."""

    coordinate: str
    factor: str
    target: str
    low: float
    """Coordinate of the first bump."""
    step: float
    """Distance of the bumps, in units of the coordinate."""

    @property
    def names(self) -> tuple[str, ...]:
        """Its weights."""
        return tuple(weight(side, i) for side in TARGETS[self.target] for i in range(BUMPS))

    @property
    def centres(self) -> Array:
        """Coordinates of the bumps, shape (BUMPS,)."""
        return np.asarray(self.low + self.step * np.arange(BUMPS), dtype=np.float64)

    @property
    def coefficients(self) -> dict[str, float]:
        """What the effect needs beside its weights."""
        return {
            f"closure_of_{self.coordinate}": 1.0,
            f"closure_by_{self.factor}": 1.0,
            "closure_scale": 1 / self.step,
            "closure_start": self.low / self.step,
        }

    def declared(self, study: Study) -> Study:
        """Return the study with this form, its weights still zero."""
        fixed = {n: Estimate(value=v) for n, v in self.coefficients.items()}
        return dataclasses.replace(study, effects={**study.effects, **fixed})

    def bumps(self, s: Array) -> Array:
        """Every bump at coordinates ``s``, shape (n, BUMPS)."""
        return np.asarray(np.exp(-0.5 * ((s[:, None] - self.centres) / self.step) ** 2), dtype=np.float64)

    def profile(self, weights: Array, s: Array) -> Array:
        """Sum of the bumps at coordinates ``s``, shape of ``s``; [N], or [N s/m] if multiplied by a speed."""
        return np.asarray(self.bumps(s) @ weights)


@dataclass(frozen=True, kw_only=True, eq=False)
class RecoveredForce:
    """A closure, refitted by trajectory and judged."""

    closure: Closure
    fit: Fit
    gain: float
    """On twice the log evidence, over the model without it."""
    unseen: HeldOutTest
    coordinates: Array
    """Where the training trials went along the coordinate, shape (n,)."""

    @cached_property
    def weights(self) -> Array:
        """Of all sides, shape (sides, BUMPS) [N]."""
        values = self.fit.values
        return np.array([values[n] for n in self.closure.names]).reshape(-1, BUMPS)

    def covariance(self, side: int) -> Array:
        """Of a side's weights [N^2], shape (BUMPS, BUMPS)."""
        problem = self.fit.problem
        index = [problem.names.index(n) for n in self.closure.names[side * BUMPS : (side + 1) * BUMPS]]
        scale = np.array([problem.numbers[i].scale for i in index])
        return np.asarray(self.fit.covariance[np.ix_(index, index)] * np.outer(scale, scale))

    def band(self, side: int, s: Array) -> Array:
        """Standard error of a side's profile at ``s``, shape of ``s``."""
        bumps = self.closure.bumps(s)
        return np.asarray(np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", bumps, self.covariance(side), bumps), 0.0)))


@dataclass(frozen=True, kw_only=True, eq=False)
class ScreenedClosure:
    """What the sensitivities promise of a closure."""

    closure: Closure
    gain: float
    """Twice the log evidence."""
    ridge: float
    """Standard deviation of the weights that the evidence prefers [N]."""
    weights: Array


def discover(
    base: Fit,
    held: Sequence[tuple[TrialData, Sequence[FreeParameter]]],
    tick: Tick = lambda what: None,
    workers: Workers = ALONE,
) -> list[RecoveredForce]:
    """Search all closures; return the best, refitted and judged, those that explain unseen data best first."""
    tick("screening unknown forces")
    samples = [base.problem.run(base.x, k) for k in range(len(base.problem.data))]
    screened = sorted(screen(base, samples, workers), key=lambda s: -s.gain)
    chosen = _different(screened)[:REFITS]
    about = [f"{s.closure.target} by {s.closure.coordinate}" for s in chosen]
    found = workers.map(
        _refit, (base, held, samples), chosen, about, lambda what: tick(f"fitting an unknown force on the {what}")
    )
    return sorted((f for f in found if f), key=lambda f: f.unseen.worst)


def coordinate(samples: Sequence[Samples], name: str) -> Array:
    """Values of a coordinate along runs, end to end."""
    return np.concatenate([s.t if name == "time" else getattr(s.state, name) for s in samples])


def screen(base: Fit, samples: Sequence[Samples], workers: Workers = ALONE) -> list[ScreenedClosure]:
    """Score every closure by its evidence on what the fit leaves."""
    basis, _ = np.linalg.qr(base.jacobian)
    left = base.residuals - basis @ (basis.T @ base.residuals)
    forms = []
    for name, factor in itertools.product(COORDINATES, FACTORS):
        values = coordinate(samples, name)
        low, high = np.quantile(values, [0.0, 0.995])
        step = float(high - low) / (BUMPS - 1 - 2 * MARGIN)
        if step < FLAT:
            continue
        light = Closure(coordinate=name, factor=factor, target="light mass", low=float(low) - MARGIN * step, step=step)
        forms.append(light)
    found = workers.map(_screen_form, (base.problem, base.x, basis, left), forms)
    return [s for screened in found for s in screened]


def _screen_form(shared: tuple[Problem, Array, Array, Array], light: Closure) -> list[ScreenedClosure]:
    """Score a coordinate and factor on all targets."""
    problem, x, basis, left = shared
    heavy = dataclasses.replace(light, target="heavy mass")
    sensitivity = _sensitivity(problem, x, light, basis) | _sensitivity(problem, x, heavy, basis)
    found = []
    for target in TARGETS:
        closure = dataclasses.replace(light, target=target)
        gain, ridge, weights = _evidence(np.stack([sensitivity[n] for n in closure.names], axis=1), left)
        found.append(ScreenedClosure(closure=closure, gain=gain, ridge=ridge, weights=weights))
    return found


def _sensitivity(bare: Problem, x: Array, closure: Closure, basis: Array) -> dict[str, Array]:
    """Weight -> change of the standardised prediction per newton, beyond all fitted numbers."""
    problem = _problem(bare, closure, PROBE, WEAK_PRIOR)
    start = np.append(x, np.zeros(len(closure.names)))
    here = problem.residuals(start)
    assert here is not None
    found = {}
    for i, name in enumerate(closure.names):
        moved = start.copy()
        moved[len(x) + i] = 1.0
        there = problem.residuals(moved)
        change = np.zeros(len(basis)) if there is None else ((here - there) / PROBE)[: len(basis)]
        found[name] = change - basis @ (basis.T @ change)
    return found


WEAK_PRIOR = 1e6


def _problem(problem: Problem, closure: Closure, scale: float, prior: float) -> Problem:
    """Return the problem with a closure's weights as further numbers."""
    trials = tuple(t.name for t in problem.study.trials)
    added = [
        FreeParameter(
            name=n, parameter=n, how=ParameterRole.SET, trials=trials, start=0.0, scale=scale, prior=prior, bounds=(-1e6, 1e6)
        )
        for n in closure.names
    ]
    numbers = (*problem.numbers, *added)
    mean = np.append(problem.prior_mean, np.zeros(len(added)))
    weights = np.zeros((len(numbers), len(numbers)))
    known = len(problem.numbers)
    weights[:known, :known] = problem.prior_weights
    weights[known:, known:] = np.eye(len(added)) / prior
    return Problem(closure.declared(problem.study), problem.data, numbers, (mean, weights))


def _evidence(sensitivity: Array, left: Array) -> tuple[float, float, Array]:
    """Twice the log evidence of Gaussian weights over none, at the ridge that makes it largest; that ridge; the weights."""
    u, s, vt = np.linalg.svd(sensitivity, full_matrices=False)
    projected = u.T @ left
    best = (-math.inf, 0.0, np.zeros(sensitivity.shape[1]))
    for ridge in np.logspace(-5, 0, 41):
        power = (ridge * s) ** 2
        gain = float(np.sum(projected**2 * power / (1 + power) - np.log1p(power)))
        if gain > best[0]:
            best = gain, float(ridge), vt.T @ (ridge**2 * s / (1 + power) * projected)
    return best


def _different(screened: Sequence[ScreenedClosure]) -> list[ScreenedClosure]:
    """Best first, but one target and coordinate only once: factors are neighbours of each other."""
    seen: set[tuple[str, str]] = set()
    found = []
    for one in screened:
        key = one.closure.coordinate, one.closure.target
        if key not in seen:
            seen.add(key)
            found.append(one)
    return found


def _refit(
    shared: tuple[Fit, Sequence[tuple[TrialData, Sequence[FreeParameter]]], Sequence[Samples]], screened: ScreenedClosure
) -> RecoveredForce | None:
    """Refit by trajectory with the ridge that the evidence chose."""
    base, held, samples = shared
    problem = _problem(base.problem, screened.closure, screened.ridge, 1.0)
    start = np.append(base.x, screened.weights / screened.ridge)
    try:
        fit = with_noise_of_residuals(minimise(problem, start, close=ROUGHLY, most=12))
    except FitError:
        return None
    return RecoveredForce(
        closure=screened.closure,
        fit=fit,
        gain=screened.gain,
        unseen=judge(fit, held),
        coordinates=coordinate(samples, screened.closure.coordinate),
    )
