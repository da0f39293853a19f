"""Which candidate explains what a fit leaves: refit those that screening found best, judge on what no fit saw."""

from __future__ import annotations

import contextlib
import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from looping_pendulum.discrepancy.fit.calibration import Fit, FitError, calibrate, minimise
from looping_pendulum.discrepancy.fit.event_tests import unseen_limit
from looping_pendulum.discrepancy.fit.problem import FreeParameter, Problem, TrialData
from looping_pendulum.discrepancy.fit.residual import with_noise_of_residuals
from looping_pendulum.discrepancy.listed.candidates import Candidate
from looping_pendulum.discrepancy.listed.screening import ScreenedCandidate
from looping_pendulum.discrepancy.workers import ALONE, Told, Workers

SCORE_LIMIT = 4.0
"""Of a candidate's |z|; 120 clean studies reach 3.94."""
HELD_OUT_LIMIT = 1.08
"""Of chi2 per value of a held-out trial; clean maximum 1.072 with about a thousand values."""
SCATTER = 3.0
"""Standard errors 1/sqrt(n) of chi2 per value that are granted to trials with fewer values."""
WIDEST = 10.0
"""Largest amplitude that the screening may start a refit from, in scales."""
FIRST = 2
"""Candidates whose gain the others have to beat."""
PATIENCE = 10
"""Iterations in each window of a refit; right explanations need about four."""
AFRESH = (5.0, 0.2)
"""Values that a companion is started again from, over the one it was found at: the cost has further minima there."""
NEAR = 20.0
"""Part of another candidate's gain that may be missing for that to be worth while."""
BLOCKS = 8
"""Blocks of time that a single trial is cut into; two that lie far apart are held out at once."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Refit:
    """A model with one candidate more."""

    screened: ScreenedCandidate
    fit: Fit
    gain: float
    """On the Bayesian information criterion, over the model without it."""

    @property
    def candidate(self) -> Candidate:
        """What was added."""
        return self.screened.candidate

    @property
    def value(self) -> float:
        """[SI]"""
        return self.fit.values[self.candidate.name]

    @property
    def error(self) -> float:
        """Standard error [SI]."""
        return self.fit.errors[self.candidate.name]

    @property
    def inside(self) -> bool:
        """Whether the value is physically possible and not on a bound other than the null value's."""
        return self.candidate.name not in self.fit.at_bounds


def refit(base: Fit, screened: ScreenedCandidate, to_beat: float = 0.0) -> Refit | None:
    """Fit the model with a candidate from its own start; None where it cannot run.

    Parameters
    ----------
    to_beat
        Gain that another candidate has: a second start is only worth while if the screening promises more.
    """
    problem = _with_candidate(base, screened)
    amplitude = float(np.clip(screened.amplitude / screened.scale, -WIDEST, WIDEST))
    fits = []
    promised = base.cost - 0.5 * screened.score**2
    # where its own start leads nowhere near what the screening promises, the base's optimum is tried too
    for start in (base.problem.prior_mean, base.x):
        try:
            full = start is base.problem.prior_mean
            x = np.concatenate([start, [amplitude], np.zeros(len(screened.companions))])
            fits.append(calibrate(problem, x, most=PATIENCE) if full else minimise(problem, x, most=PATIENCE))
        except FitError:
            continue
        if fits[-1].cost < promised or (screened.score**2 < to_beat and fits[-1].cost < base.cost + 1):
            break
    if not fits:
        return None
    best = min(fits, key=lambda f: f.cost)
    if best.cost > base.cost:  # so far off an event was lost, and no gradient brings it back
        null = np.concatenate([base.x, np.zeros(1 + len(screened.companions))])
        with contextlib.suppress(FitError):
            best = min(best, minimise(problem, null, most=PATIENCE), key=lambda f: f.cost)
    penalty = (1 + len(screened.companions)) * math.log(base.problem.count)
    if screened.companions and base.cost - best.cost - penalty > max(to_beat - NEAR, 0.0):
        best = min([best, *_afresh(best, screened)], key=lambda f: f.cost)
    return Refit(screened=screened, fit=best, gain=base.cost - best.cost - penalty)


def refits(
    base: Fit,
    chosen: Sequence[ScreenedCandidate],
    known: Mapping[str, Refit | None],
    workers: Workers = ALONE,
    told: Told = lambda name: None,
) -> list[Refit]:
    """Fit the model with each candidate, best first; the gains of the first two are what the others have to beat.

    Parameters
    ----------
    known
        Refits that are made already, by the candidate's name.
    told
        Told the name of each that begins in this process.
    """
    made = dict(known)
    for part in (chosen[:FIRST], chosen[FIRST:]):
        to_beat = max((r.gain for r in made.values() if r), default=0.0)
        left = [s for s in part if s.candidate.name not in known]
        names = [s.candidate.name for s in left]
        done = workers.map(_refit_one, base, [(s, to_beat) for s in left], names, told)
        made |= {s.candidate.name: r and _of(base, s, r) for s, r in zip(left, done, strict=True)}
    found = (made[s.candidate.name] for s in chosen)
    return sorted((r for r in found if r), key=lambda r: -r.gain)


def _refit_one(base: Fit, wanted: tuple[ScreenedCandidate, float]) -> Refit | None:
    return refit(base, *wanted)


def _of(base: Fit, screened: ScreenedCandidate, done: Refit) -> Refit:
    """Return a refit with the study's own objects: what a helper returns has copies."""
    problem = _with_candidate(base, screened)
    return dataclasses.replace(done, screened=screened, fit=dataclasses.replace(done.fit, problem=problem))


def _with_candidate(base: Fit, screened: ScreenedCandidate) -> Problem:
    return base.problem.with_numbers(screened.candidate.number(screened.scale), *screened.companions)


def _afresh(fit: Fit, screened: ScreenedCandidate) -> list[Fit]:
    """Fit again from other values of what shapes the candidate."""
    found = []
    for i, number in enumerate(screened.companions, start=len(fit.x) - len(screened.companions)):
        for factor in AFRESH:
            x = fit.x.copy()
            x[i] = (factor * fit.values[number.name] - number.start) / number.scale
            with contextlib.suppress(FitError):
                found.append(minimise(fit.problem, x, most=PATIENCE))
    return found


@dataclass(frozen=True, kw_only=True, eq=False)
class HeldOutTest:
    """How a fit explains data that it did not see."""

    names: tuple[str, ...]
    """Trials, or blocks of time of the only one."""
    chi2: tuple[float, ...]
    """Of each, per value."""
    counts: tuple[int, ...]
    """Values behind each."""
    limits: tuple[float, ...]
    """Chi2 per value up to which each is explained."""
    rms: tuple[float | None, ...]
    """Of the residual of each [SI]; None: it has only events."""
    fits: tuple[Fit, ...] = ()

    @property
    def worst(self) -> float:
        """Largest chi2 per value."""
        return max(self.chi2)

    @property
    def explained(self) -> bool:
        """Whether all of it is explained to its noise."""
        return all(c <= limit for c, limit in zip(self.chi2, self.limits, strict=True))


def judge(fit: Fit, held: Sequence[tuple[TrialData, Sequence[FreeParameter]]], *, settled: bool = False) -> HeldOutTest:
    """Judge a fit on held-out trials, or on blocks of time of the training ones if there are none.

    Parameters
    ----------
    settled
        Whether the errors of the held-out marks stay as they are.
    """
    if not held:
        return _blocks(fit)
    fits = [_explain(fit, data, numbers, settled) for data, numbers in held]
    return HeldOutTest(
        names=tuple(d.trial.name for d, _ in held),
        chi2=tuple(f.cost / f.problem.count for f in fits),
        counts=tuple(f.problem.count for f in fits),
        limits=tuple(_limit(f) for f in fits),
        rms=tuple(rms(f, 0) for f in fits),
        fits=tuple(fits),
    )


def _limit(fit: Fit) -> float:
    """Chi2 per value up to which unseen data are explained; that of marks has noise that was estimated from them."""
    if not any(d.channels for d in fit.problem.data):
        return unseen_limit(fit.problem.data)
    return max(HELD_OUT_LIMIT, 1 + SCATTER / math.sqrt(fit.problem.count))


def rms(fit: Fit, k: int) -> float | None:
    """Residual of a trial [SI]: of the light mass's place where it was seen; None: it has only events."""
    d = fit.problem.data[k]
    if not d.channels:
        return None
    residual = d.value - fit.problem.predict(fit.x, k)
    return math.sqrt(sum(float(np.mean(residual[p] ** 2)) for p in places(d)))


def places(d: TrialData) -> list[slice]:
    """Where a trial's errors are told from: the light mass's place where it was seen, else all channels."""
    return [d.slices[n] for n in ("light_x", "light_y") if n in d.slices] or list(d.slices.values())


def _explain(fit: Fit, data: TrialData, own: Sequence[FreeParameter], settled: bool) -> Fit:
    """Fit only what is the held-out trial's own; what training knows is a prior as narrow as it left it."""
    p = fit.problem
    known = {n.name: i for i, n in enumerate(p.numbers)}
    added = [n for n in p.numbers if data.trial.name in n.trials and n.name not in {o.name for o in own}]
    numbers = [*own, *added]
    here = [i for i, n in enumerate(numbers) if n.name in known]
    there = [known[numbers[i].name] for i in here]
    mean, weights = np.zeros(len(numbers)), np.diag([1 / (n.prior or 10.0) for n in numbers])
    if here:
        covariance = fit.covariance[np.ix_(there, there)]
        values, vectors = np.linalg.eigh(covariance)
        root = (vectors / np.sqrt(np.maximum(values, 1e-12 * values.max()))).T
        weights[np.ix_(here, here)] = root
        mean[here] = fit.x[there]
    problem = Problem(p.study, [data], numbers, (mean, weights))
    explained = calibrate(problem)
    return explained if settled else with_noise_of_residuals(explained)


def _blocks(fit: Fit) -> HeldOutTest:
    """Leave out two of `BLOCKS` blocks of time after another; judge them by the prediction's own uncertainty."""
    problem = fit.problem
    names, chi2, sizes, counts = [], [], [], []
    half = BLOCKS // 2
    for j in range(half):
        out = [(_block(d) % half) == j for d in problem.data]
        if not any(o.any() for o in out):
            continue
        masked = [dataclasses.replace(d, sigma=np.where(o, np.inf, d.sigma)) for d, o in zip(problem.data, out, strict=True)]
        partial = minimise(problem.with_data(masked), fit.x)
        whole = Problem.jacobian(problem, partial.x)
        rows = np.concatenate(out)
        r = problem.residuals(partial.x)
        assert r is not None
        part = whole[: len(rows)][rows]
        spread = np.eye(len(part)) + part @ partial.covariance @ part.T
        left = r[: len(rows)][rows]
        names.append(f"blocks {j + 1} and {j + 1 + half} of {BLOCKS}")
        chi2.append(float(left @ np.linalg.solve(spread, left)) / len(left))
        counts.append(len(left))
        marks = np.concatenate([np.arange(len(d.t)) < d.event_slice.start for d in problem.data])[rows]
        if marks.any():
            sigma = np.concatenate([d.sigma for d in problem.data])[rows]
            sizes.append(math.sqrt(2 * float(np.mean((left * sigma)[marks] ** 2))))
    return HeldOutTest(
        names=tuple(names),
        chi2=(float(np.average(chi2, weights=counts)),),
        counts=(problem.count,),
        limits=(_limit(fit),),
        rms=(float(np.sqrt(np.mean(np.square(sizes)))) if sizes else None,),
    )


def _block(d: TrialData) -> NDArray[np.int_]:
    """Number of the block of time that each value belongs to; of events alone, their moments one after another."""
    if not d.channels:
        return np.asarray(np.unique(d.t, return_inverse=True)[1] % BLOCKS)
    span = float(np.ptp(d.t)) or 1.0
    return np.asarray(np.minimum((BLOCKS * (d.t - d.t.min()) / span).astype(int), BLOCKS - 1))
