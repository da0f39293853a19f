"""Say what a declared model lacks: its fit to all trials, the search, and the smallest set of explanations that is credible."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from looping_pendulum.discrepancy.evidence.explanation import NOTHING, Explanation, Key, explained, to_data_steps
from looping_pendulum.discrepancy.evidence.marginal import NoiseGrid
from looping_pendulum.discrepancy.evidence.prior import CREDIBLE, LAW_PREDICTS
from looping_pendulum.discrepancy.evidence.search import Search, best_of, posterior
from looping_pendulum.discrepancy.fit.calibration import Fit, calibrate
from looping_pendulum.discrepancy.fit.predictions import alone
from looping_pendulum.discrepancy.fit.problem import Problem, free_parameters_of
from looping_pendulum.discrepancy.fit.residual_noise import refit_with_estimated_noise
from looping_pendulum.discrepancy.inputs import Inputs
from looping_pendulum.discrepancy.workers import SERIAL, Workers


@dataclass(frozen=True, kw_only=True, eq=False)
class Explanations:
    """What may be missing, by its probability."""

    probabilities: tuple[tuple[Key, float], ...]
    """What an explanation adds, and its probability, the most probable first; an empty set: nothing is missing."""
    best: Explanation
    """The most probable explanation."""
    passes: bool
    """Whether its residuals look like its own noise."""

    @property
    def credible(self) -> tuple[Key, ...]:
        """Return the smallest set of explanations that has `prior.CREDIBLE` of the probability."""
        found, total = [], 0.0
        for key, p in self.probabilities:
            found.append(key)
            total += p
            if total >= CREDIBLE:
                break
        return tuple(found)


def explain(inputs: Inputs, workers: Workers = SERIAL, report: Callable[[str], None] = lambda what: None) -> Explanations:
    """Compare explanations of the data of all trials, held-out ones included.

    The evidence of all data is that of the training trials times the density with which these predict the held-out ones.

    Raises
    ------
    FitError
        If the declared model cannot run.
    """
    report("calibrating")
    search = Search(_declared(inputs), inputs.library, workers, report)
    search.run()
    fitted = dict(search.fitted)
    while True:
        best = best_of(fitted)
        found = Explanations(probabilities=tuple(posterior(fitted)), best=best, passes=search.passes(best))
        laws = [fitted[key] for key in found.credible if fitted[key].parts.law]
        unconfirmed = [e for e in laws if not _predicts(e, fitted[NOTHING], inputs, len(search.library))]
        if not unconfirmed:
            return found
        for e in unconfirmed:
            del fitted[e.key]


def _declared(inputs: Inputs) -> Fit:
    """Return the fit of the declared model to all trials."""
    data = [*inputs.training, *(d for d, _ in inputs.held_out)]
    free = free_parameters_of(inputs.study, list(inputs.observed))
    return refit_with_estimated_noise(calibrate(Problem(inputs.study, data, free)))


def _predicts(e: Explanation, nothing: Explanation, inputs: Inputs, library: int) -> bool:
    """Return whether a law, by the training trials, makes the held-out ones more probable; so if there are none."""
    if not inputs.held_out:
        return True
    training = {d.trial.name for d in inputs.training}
    gains = []
    for one in (e, nothing):
        data = [d for d in one.fit.problem.data if d.trial.name in training]
        fit = alone(to_data_steps(one.fit, data))
        if fit is None:
            return False
        gains.append(one.log_z - explained(NoiseGrid(data), fit, one.parts, library).log_z)
    return gains[0] - gains[1] >= LAW_PREDICTS
