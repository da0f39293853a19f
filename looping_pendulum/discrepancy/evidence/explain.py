"""Say what a declared model lacks: its fit to all trials, the search, and the smallest set of explanations that is credible."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from looping_pendulum.discrepancy import candidates
from looping_pendulum.discrepancy.evidence.explanation import (
    NOTHING,
    Explanation,
    Key,
    explained,
    fit_to_data,
    fit_without,
    law_name,
)
from looping_pendulum.discrepancy.evidence.marginal import NoiseGrid
from looping_pendulum.discrepancy.evidence.motions import Closure, motions
from looping_pendulum.discrepancy.evidence.prior import CHECKED, CREDIBLE, LAW_PREDICTS, TIE
from looping_pendulum.discrepancy.evidence.sampling import checked
from looping_pendulum.discrepancy.evidence.search import Search, in_words, posterior
from looping_pendulum.discrepancy.fit.calibration import Fit, FitError, calibrate
from looping_pendulum.discrepancy.fit.data import TrialData
from looping_pendulum.discrepancy.fit.held_out import HeldOutTest, check_held_out
from looping_pendulum.discrepancy.fit.residual import ModelTest, ResidualTests
from looping_pendulum.discrepancy.fit.residual_noise import refit_with_estimated_noise
from looping_pendulum.discrepancy.inputs import Inputs
from looping_pendulum.discrepancy.result import Verdict
from looping_pendulum.reference_ode.effects.closure import N_BASIS_FUNCTIONS
from looping_pendulum.reference_ode.geometry import Array


@dataclass(frozen=True, kw_only=True, eq=False)
class Judged:
    """An explanation beside its tests, and fitted to the training trials alone, so that held-out data judge it."""

    explanation: Explanation
    fit: Fit
    """To all trials."""
    tests: ResidualTests
    """Of that fit."""
    training: Fit
    held_out: HeldOutTest


@dataclass(frozen=True, kw_only=True, eq=False)
class RecoveredForce:
    """A closure that was fitted to the training trials and tested on held-out data."""

    closure: Closure
    fit: Fit
    """Its weights are the last of the free parameters."""
    log_bayes_factor: float
    """Log of the factor by which it makes the data of all trials more probable."""
    coordinates: Array
    """Values of the coordinate along the training trials, where it matters, shape (n,)."""
    held_out: HeldOutTest

    @cached_property
    def coordinate_range(self) -> tuple[float, float]:
        """Smallest and largest of the `coordinates`."""
        return float(self.coordinates.min()), float(self.coordinates.max())

    @cached_property
    def weights(self) -> Array:
        """Weights of all sides [N], shape (sides, N_BASIS_FUNCTIONS)."""
        values = self.fit.values
        return np.array([values[n] for n in self.closure.names]).reshape(-1, N_BASIS_FUNCTIONS)

    def standard_error(self, side: int, s: Array) -> Array:
        """Return the standard error of a side's profile at coordinates ``s``, shape of ``s``."""
        problem = self.fit.problem
        index = [problem.names.index(n) for n in self.closure.names[side * N_BASIS_FUNCTIONS : (side + 1) * N_BASIS_FUNCTIONS]]
        scale = np.array([problem.free_parameters[i].scale for i in index])
        covariance = self.fit.covariance[np.ix_(index, index)] * np.outer(scale, scale)
        basis = self.closure.basis_functions(s)
        variance = np.einsum("ij,jk,ik->i", basis, covariance, basis)
        return np.asarray(np.sqrt(np.maximum(variance, 0.0)))  # rounding can leave a variance slightly negative


class Explanations:
    """What may be missing, by its probability.

    Parameters
    ----------
    search
        What was fitted, and what the linear models beside it say.
    interrupted
        Whether the search was ended before others were looked at.
    """

    def __init__(self, search: Search, inputs: Inputs, interrupted: bool) -> None:
        self.search, self._inputs = search, inputs
        self._predicted: dict[Key, float] = {}
        self._of_training: dict[Key, Fit | None] = {}
        self.interrupted = interrupted
        self.contradicted: Explanation | None = None
        """What would be more probable than the declared model, but that the held-out trials do not confirm it."""
        # What has not converged is not ranked
        self._fitted = {key: e for key, e in search.fitted.items() if key == NOTHING or e.fit.converged}
        self._judge_probabilities()
        try:
            while not self.interrupted and (wrong := self._without_prediction()):
                if NOTHING not in self.credible:
                    self.contradicted = self.contradicted or wrong[0]
                for e in wrong:
                    del self._fitted[e.key]
                self._judge_probabilities()
        except KeyboardInterrupt:
            self.interrupted = True

    def _judge_probabilities(self) -> None:
        """Find the probabilities, by sampling where Laplace's method alone would decide, and what is credible."""
        probabilities = posterior(self._fitted)
        rivals = [key for key, p in probabilities if p > probabilities[0][1] * math.exp(-CHECKED)]
        if len(rivals) > 1:
            for key in rivals:
                e = self._fitted[key]
                if not e.checked:
                    self._fitted[key] = checked(e, self.search.tested(e)[0])
            probabilities = posterior(self._fitted)
        self.best = self._fitted[probabilities[0][0]]
        others = 1.0 - np.cumsum([0.0, *(p for _, p in probabilities)])
        # That something is missing, is said where it is no tie with other explanations
        enough = (1 - CREDIBLE) / (TIE if self.best.key != NOTHING else 1.0)
        self.credible = tuple(key for (key, _), p in zip(probabilities, others, strict=False) if p > enough)
        self.probabilities = dict(probabilities)
        """What an explanation adds -> its probability; an empty set: nothing is missing.

        Of one that adds nothing that shows to a part of it, and so is counted with that, there is none.
        """

    def _without_prediction(self) -> list[Explanation]:
        """Return the credible explanations of which a part makes the held-out trials less probable, or a law hardly more."""
        if not self._inputs.held_out:
            return []
        found = []
        for e in (self._fitted[key] for key in self.credible):
            for part in sorted(e.key):
                rest = self.search.fitted.get(e.key - {part})
                least = LAW_PREDICTS if e.parts.law and part == law_name(e.parts.law) else 0.0
                if rest is not None and self._log_prediction(e) - self._log_prediction(rest) < least:
                    found.append(e)
                    break
        return found

    def _log_prediction(self, e: Explanation) -> float:
        """Return the log density with which an explanation, by the training trials, predicts the held-out ones."""
        if e.key not in self._predicted:
            e = self.search.fitted[e.key]  # by Laplace's method, as that of the training trials is
            fit = self._fit_to_training(e)
            training = fit and explained(NoiseGrid(fit.problem.data), fit, e.parts, len(self.search.library))
            self._predicted[e.key] = e.log_z - training.log_z if training else -math.inf
        return self._predicted[e.key]

    @property
    def verdict(self) -> Verdict:
        """Return what the evidence says about the declared model; `verdict.decide` tests it."""
        if self.interrupted:
            return Verdict.INTERRUPTED
        if self.credible == (NOTHING,):
            return Verdict.UNEXPLAINED if self.contradicted else Verdict.NO_MISSING_EFFECT
        if all(self._fitted[key].parts.law for key in self.credible):
            return Verdict.UNLISTED
        return Verdict.IDENTIFIED if len(self.credible) == 1 else Verdict.AMBIGUOUS

    @property
    def contradiction(self) -> tuple[ModelTest, ...]:
        """Return the test that the declared model, which alone is left, fails: there is more to the data."""
        e = self.contradicted
        if e is None or self.credible != (NOTHING,):
            return ()
        asked = " and ".join(map(candidates.in_words, sorted(e.key)))
        return (
            ModelTest(
                subject=in_words(e.key),
                statistic="log odds against the declared model",
                value=e.log_posterior - self.search.fitted[NOTHING].log_posterior,
                limit=math.log(CREDIBLE / (1 - CREDIBLE)),
                failure=f"the data ask for {asked}, which the held-out trials do not confirm",
            ),
        )

    @property
    def ranked(self) -> list[Explanation]:
        """Return all explanations that were fitted, the most probable first."""
        known = self.probabilities
        return sorted(self._fitted.values(), key=lambda e: (e.key != self.best.key, -known.get(e.key, -1), -e.log_posterior))

    def fit(self, e: Explanation) -> Fit:
        """Return the fit of an explanation: with its most probable noise if it is credible, else with white noise."""
        return self.search.tested(e)[0] if e.key in self.credible else e.fit

    @property
    def nothing(self) -> Explanation:
        """Return the declared model."""
        return self._fitted[NOTHING]

    def judged(self, e: Explanation) -> Judged:
        """Judge an explanation by held-out data, with the noise of the best explanation: one noise compares them."""
        fit, tests = self.search.tested(e)
        training = fit
        if self._inputs.held_out or e.parts.law or e.setting != self.best.setting:
            noises = self.search.grid.noises(self.best.setting)
            data = [d.with_noises(noises) for d in self._training(e)]
            refitted = fit_to_data(self._fit_to_training(e) or e.fit, data)
            if refitted is None:
                raise FitError(f"the model with {in_words(e.key)} cannot run the training trials alone; leave one of them out")
            training = refitted
        held_out = check_held_out(training, self._inputs.held_out)
        return Judged(explanation=e, fit=fit, tests=tests, training=training, held_out=held_out)

    def force(self, judged: Judged) -> tuple[Fit, RecoveredForce]:
        """Return the law of an explanation that has one, and the fit to the training trials without it."""
        e = judged.explanation
        law = e.parts.law
        assert law is not None
        rest = self._fitted.get(e.key - {law_name(law)})
        without = rest.fit if rest else fit_without(e, law_name(law)) or self.nothing.fit
        data = judged.training.problem.data
        if law.point is not None:
            x, y = (judged.training.values[name] for name in law.point_coefficients)
            law = dataclasses.replace(law, point=(x, y))
        return fit_to_data(without, data) or without, RecoveredForce(
            closure=law,
            fit=judged.training,
            log_bayes_factor=e.log_z - (rest or self.nothing).log_z,
            coordinates=motions(judged.training).where_it_acts(law),
            held_out=judged.held_out,
        )

    def _fit_to_training(self, e: Explanation) -> Fit | None:
        """Return the fit to the training trials with white noise, the parameters of a law last; None: it cannot run."""
        if e.key not in self._of_training:
            law = e.parts.law.names if e.parts.law else ()
            self._of_training[e.key] = fit_to_data(e.fit, self._training(e), last=law)
        return self._of_training[e.key]

    def _training(self, e: Explanation) -> list[TrialData]:
        return [d for d in e.fit.problem.data if not d.trial.held_out]


def explain(
    inputs: Inputs,
    seed: int = 0,
    report: Callable[[str], None] = lambda what: None,
    is_time_over: Callable[[], bool] = lambda: False,
) -> tuple[Explanations, tuple[float, ...]]:
    """Compare explanations of the data of all trials, held-out ones included.

    The evidence of all data is that of the training trials times the density with which these predict the held-out ones.

    Parameters
    ----------
    seed
        Seed of the random second start of the calibration.
    report
        Called with a description of each step.
    is_time_over
        Asked before each step of the search, which then ends with what it has, as it does after Ctrl-C.

    Returns
    -------
    explanations
        What was found.
    start_costs
        Cost at which the fit of the declared model ended from each of its starts.

    Raises
    ------
    FitError
        If the declared model cannot run.
    """
    report("calibrating")
    problem = inputs.problem()
    second = problem.prior_mean + np.random.default_rng(seed).standard_normal(len(problem.free_parameters))
    starts = [problem.prior_mean, np.clip(second, problem.low, problem.high)]
    fits = [calibrate(problem, start) for start in starts]
    base = refit_with_estimated_noise(min(fits, key=lambda f: f.cost))
    search = Search(base, inputs.library, report, is_time_over)
    try:
        interrupted = not search.run()
    except KeyboardInterrupt:
        interrupted = True
    return Explanations(search, inputs, interrupted), tuple(f.cost for f in fits)
