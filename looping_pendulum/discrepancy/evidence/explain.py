"""Say what a declared model lacks: its fit to all trials, the search, and the smallest set of explanations that is credible."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from looping_pendulum.discrepancy.evidence.explanation import NOTHING, Explanation, Key, checked, explained, fit_to_data
from looping_pendulum.discrepancy.evidence.marginal import NoiseGrid
from looping_pendulum.discrepancy.evidence.prior import CHECKED, CREDIBLE, DECISIVE, LAW_PREDICTS, TIE
from looping_pendulum.discrepancy.evidence.search import Search, in_words, posterior
from looping_pendulum.discrepancy.fit.calibration import Fit, FitError, calibrate
from looping_pendulum.discrepancy.fit.data import TrialData
from looping_pendulum.discrepancy.fit.problem import time_limits
from looping_pendulum.discrepancy.fit.residual import HeldOutTest, ModelTest, ResidualTests, check_held_out
from looping_pendulum.discrepancy.fit.residual_noise import refit_with_estimated_noise
from looping_pendulum.discrepancy.inputs import Inputs


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
    log_prediction: float = math.nan
    """Log density with which it predicts the held-out trials by the training trials; nan: blocks of time are held out."""


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
        self.search, self._inputs, self.interrupted = search, inputs, interrupted
        self._predicted: dict[Key, float] = {}
        self._of_training: dict[Key, Fit | None] = {}
        self.contradicted: Explanation | None = None
        """What would be more probable than the declared model, but that the held-out trials contradict or do not confirm it."""
        # What has not converged is not ranked
        self._fitted = {key: e for key, e in search.fitted.items() if key == NOTHING or e.fit.converged}
        self._rank()
        try:
            while not self.interrupted and (wrong := self._refused()):
                if NOTHING not in self.credible:
                    self.contradicted = self.contradicted or wrong[0]
                # With what adds nothing that shows to it, and so was counted with it
                self._fitted = {
                    key: e for key, e in self._fitted.items()
                    if not any(key >= w.key and e.log_posterior <= w.log_posterior for w in wrong)
                }  # fmt: skip
                self._rank()
        except KeyboardInterrupt:
            self.interrupted = True

    def _rank(self) -> None:
        """Find the probabilities, by sampling where Laplace's method alone would decide, and what is credible."""
        probabilities = posterior(self._fitted)
        rivals = [key for key, p in probabilities if p > probabilities[0][1] * math.exp(-CHECKED)]
        if len(rivals) > 1 and not self.interrupted:
            try:
                for e in (self._fitted[key] for key in rivals):
                    self._fitted[e.key] = e if e.checked else checked(e, self.search.tested(e)[0])
            except KeyboardInterrupt:
                self.interrupted = True
            probabilities = posterior(self._fitted)
        self.nothing, self.best = self._fitted[NOTHING], self._fitted[probabilities[0][0]]
        others = 1.0 - np.cumsum([0.0, *(p for _, p in probabilities)])
        # That something is missing, is said where it is no tie with other explanations
        enough = (1 - CREDIBLE) / (TIE if self.best.key != NOTHING else 1.0)
        self.credible = tuple(key for (key, _), p in zip(probabilities, others, strict=False) if p > enough)
        self.probabilities = dict(probabilities)
        """What an explanation adds -> its probability; an empty set: nothing is missing.

        Of one that adds nothing that shows to a part of it, and so is counted with that, there is none.
        """

    def _refused(self) -> list[Explanation]:
        """Return the credible explanations of which the held-out trials contradict a part, or do not confirm the law.

        What is wrong in all trials alike, the declared fit imitates in each of them by other values, so that it predicts a
        held-out trial as well: then the probability of all trials together decides. Where no trial is held out, blocks of
        time judge what is left, by the tests of what would be claimed.
        """
        if not self._inputs.held_out:
            return []
        found = []
        for e in (self._fitted[key] for key in self.credible):
            for part in sorted(e.key):
                rest = self.search.fitted.get(e.key - {part})
                least = LAW_PREDICTS if e.parts.law and part == e.parts.law.name else -DECISIVE
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
    def contradiction(self) -> ModelTest | None:
        """The test of what is left by what is more probable, but refused; None: nothing was."""
        if (e := self.contradicted) is None:
            return None
        refused = "no held-out trial confirms" if e.parts.law else "the held-out trials contradict"
        return ModelTest(
            subject=in_words(e.key),
            statistic=f"log odds against {in_words(self.best.key)}",
            value=e.log_posterior - self.best.log_posterior,
            limit=DECISIVE,
            failure=f"the data ask for {e.parts.in_words}, which {refused}",
        )

    @property
    def ranked(self) -> list[Explanation]:
        """All explanations that were fitted, the most probable first."""
        known = self.probabilities
        return sorted(self._fitted.values(), key=lambda e: (e.key != self.best.key, -known.get(e.key, -1), -e.log_posterior))

    def fit(self, e: Explanation) -> Fit:
        """Return the fit of an explanation: with its most probable noise if it is credible, else with white noise."""
        return self.search.tested(e)[0] if e.key in self.credible else e.fit

    def judged(self, e: Explanation) -> Judged:
        """Judge an explanation by held-out data, with the noise of the best explanation: one noise compares them.

        Raises
        ------
        FitError
            If its model cannot run the training trials alone.
        """
        fit, tests = self.search.tested(e)
        training: Fit | None = fit
        if self._inputs.held_out or e.parts.law or e.setting != self.best.setting:
            noises = self.search.grid.noises(self.best.setting)
            data = [d.with_noises(noises) for d in _training(e)]
            training = fit_to_data(self._fit_to_training(e) or e.fit, data)
        if training is None:
            raise FitError(f"the model with {in_words(e.key)} cannot run the training trials alone; leave one of them out")
        held_out = check_held_out(training, self._inputs.held_out)
        log_prediction = self._log_prediction(e) if self._inputs.held_out else math.nan
        return Judged(explanation=e, fit=fit, tests=tests, training=training, held_out=held_out, log_prediction=log_prediction)

    def _fit_to_training(self, e: Explanation) -> Fit | None:
        """Return the fit to the training trials with white noise, the parameters of a law last; None: it cannot run."""
        if e.key not in self._of_training:
            self._of_training[e.key] = fit_to_data(e.fit, _training(e), last=e.parts.law.names if e.parts.law else ())
        return self._of_training[e.key]


def _training(e: Explanation) -> list[TrialData]:
    return [d for d in e.fit.problem.data if not d.trial.held_out]


def fit_declared_model(inputs: Inputs, seed: int) -> tuple[Fit, tuple[float, ...]]:
    """Return the fit of the declared model to all trials, and the cost at which it ended from each of its starts.

    Raises
    ------
    FitError
        If the model cannot run.
    """
    problem = inputs.problem()
    second = problem.prior_mean + np.random.default_rng(seed).standard_normal(len(problem.free_parameters))
    fits = [calibrate(problem, start) for start in (problem.prior_mean, np.clip(second, problem.low, problem.high))]
    return refit_with_estimated_noise(min(fits, key=lambda f: f.cost)), tuple(f.cost for f in fits)


def explain(
    inputs: Inputs,
    seed: int = 0,
    report: Callable[[str], None] = lambda what: None,
    report_fit: Callable[[str], None] = lambda what: None,
) -> tuple[Explanations, tuple[float, ...]]:
    """Compare explanations of the data of all trials, held-out ones included.

    The evidence of all data is that of the training trials times the density with which these predict the held-out ones.

    Parameters
    ----------
    seed
        Seed of the random second start of the calibration.
    report
        Called with a description of each step. After Ctrl-C, or where the time is over, the search ends with what it has.
    report_fit
        Called with a description of each fit of the search.

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
    OutOfTime
        If the time is over before the declared model is calibrated.
    """
    report("calibrating")
    declared, costs = fit_declared_model(inputs, seed)
    search = Search(declared, inputs.library, report, report_fit)
    try:
        search.run()
    except KeyboardInterrupt:
        with time_limits():  # what there is, is put in order
            return Explanations(search, inputs, interrupted=True), costs
    return Explanations(search, inputs, interrupted=False), costs
