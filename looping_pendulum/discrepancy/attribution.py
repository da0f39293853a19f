"""Which candidate explains what a fit leaves: screen by sensitivities, refit the best, judge on what no fit saw."""

from __future__ import annotations

import contextlib
import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from looping_pendulum.discrepancy.calibration import Fit, FitError, calibrate, minimise
from looping_pendulum.discrepancy.candidates import Candidate
from looping_pendulum.discrepancy.event_tests import unseen_limit
from looping_pendulum.discrepancy.problem import Data, Number, Problem
from looping_pendulum.discrepancy.residual import with_noise_of_residuals
from looping_pendulum.reference_ode.geometry import Array

LINEAR, TEMPLATES = 0.3, (3.0, 12.0)
"""Sizes of the tried changes [RMS, in units of noise]: one that is still linear, and finite ones."""
UNIT = 10.0
"""Change that one scale of a candidate makes [RMS, in units of noise]."""
VISIBLE = 1e-3
"""Part of a change that must be left beyond all fitted numbers: below it finite differences decide."""
CLEAR = 0.05
"""The same share above which finite changes are tried too: of one that is nearly absorbed, its own curvature would be left."""
SCORE_LIMIT = 4.0
"""Of a candidate's |z|; 120 clean studies reach 3.94."""
HELD_OUT_LIMIT = 1.08
"""Of chi2 per value of a held-out trial; clean maximum 1.072 with about a thousand values."""
SCATTER = 3.0
"""Standard errors 1/sqrt(n) of chi2 per value that are granted to trials with fewer values."""
WIDEST = 10.0
"""Largest amplitude that the screening may start a refit from, in scales."""
TRIES, FAILURES = 12, 2
"""Values that are tried for a template of the wanted size, and how many of them may be impossible."""
PATIENCE = 10
"""Iterations in each window of a refit; right explanations need about four."""
AFRESH = (5.0, 0.2)
"""Values that a companion is started again from, over the one it was found at: the cost has further minima there."""
NEAR = 20.0
"""Part of another candidate's gain that may be missing for that to be worth while."""
BLOCKS = 8
"""Blocks of time that a single trial is cut into; two that lie far apart are held out at once."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Screened:
    """How well a candidate's sensitivity fits what is left."""

    candidate: Candidate
    score: float
    """z of the best template; its square is the decrease of the cost that it promises."""
    amplitude: float
    """Value less null that it promises [SI]."""
    scale: float
    """Change [SI] that moves the prediction by `UNIT`."""
    companions: tuple[Number, ...] = ()
    """What is fitted with it, at the values that promise most."""


def screen(fit: Fit, chosen: Sequence[Candidate], without: Sequence[str] = ()) -> list[Screened]:
    """Score candidates, best first. Those that move nothing here are left out.

    Parameters
    ----------
    without
        Numbers of the fit that are at their null value while sensitivities are taken: every new set of effects costs a
        compilation, and an effect that was added hardly changes what another one does.
    """
    kept = [i for i, n in enumerate(fit.problem.names) if n not in without]
    jacobian = fit.jacobian
    if without:  # both sensitivities at the same place, or their difference passes for a cause
        null = np.where(np.isin(fit.problem.names, without), 0.0, fit.x)
        jacobian = fit.problem.jacobian(null, central=True)
    basis, _ = np.linalg.qr(jacobian)
    left = _beyond(basis, fit.residuals)
    bare = Problem(fit.problem.study, fit.problem.data, [fit.problem.numbers[i] for i in kept])
    found = []
    for candidate in chosen:
        tried = [_screen_one(bare, fit.x[kept], basis, left, candidate, values) for values in candidate.companion_grid()]
        found += sorted((s for s in tried if s), key=lambda s: -abs(s.score))[:1]
    return sorted(found, key=lambda s: -abs(s.score))


def _beyond(basis: Array, v: Array) -> Array:
    """Part of ``v`` that no fitted number can make."""
    return np.asarray(v - basis @ (basis.T @ v))


def _screen_one(
    bare: Problem, x: Array, basis: Array, left: Array, candidate: Candidate, values: Sequence[float]
) -> Screened | None:
    companions = candidate.companion_numbers(values)
    problem = bare.with_numbers(candidate.number(1.0), *companions)
    here = bare.residuals(x)
    if here is None:
        return None
    measured = sum(len(d.t) for d in bare.data)
    happening = bare.happening(x)
    v = np.zeros(len(left))  # no prior speaks of a candidate

    def change(delta: float) -> Array | None:
        there = np.concatenate([x, [delta], np.zeros(len(companions))])
        moved = problem.residuals(there)
        if moved is None or np.any(happening & ~problem.happening(there)):
            return None
        v[:measured] = (here - moved[: len(here)])[:measured]
        return v.copy()

    best, scale = (0.0, 0.0), 0.0
    first = 1e-3 * abs(candidate.null) or 1e-6
    both_sides = candidate.bounds[0] < candidate.null < candidate.bounds[1]
    templates: tuple[float, ...] = TEMPLATES
    for side in (1.0, -1.0):
        reach = (candidate.bounds[1] if side > 0 else candidate.bounds[0]) - candidate.null
        if side * reach <= 0:
            continue
        delta = side * first
        for size in (LINEAR, *TEMPLATES):
            delta, template = _sized(change, delta, reach, size)
            if template is None:  # too small to be integrated, or nothing moves: try the next size from afar
                delta = 0.01 * reach
                continue
            if size == LINEAR:
                first = abs(delta)  # what was small on this side is so on the other
                opposite = change(-delta) if both_sides else None
                if opposite is not None:
                    template = 0.5 * (template - opposite)
                    templates = TEMPLATES if _visible(basis, template) > CLEAR else ()
            score, amplitude = _score(basis, left, template, delta) if size in (LINEAR, *templates) else (0.0, 0.0)
            allowed = candidate.bounds[0] <= candidate.null + amplitude <= candidate.bounds[1]
            # a finite template only speaks for its own side
            if allowed and abs(score) > abs(best[0]) and (score > 0 or size == LINEAR):
                best = score, amplitude
            if size == TEMPLATES[-1]:
                scale = max(scale, abs(delta))
            else:
                delta *= TEMPLATES[0] / LINEAR if size == LINEAR else TEMPLATES[-1] / TEMPLATES[0]
    if not scale:
        return None
    scale *= UNIT / TEMPLATES[-1]
    return Screened(candidate=candidate, score=best[0], amplitude=best[1], scale=scale, companions=companions)


def _visible(basis: Array, v: Array) -> float:
    """Share of ``v`` that no fitted number can make."""
    return float(np.linalg.norm(_beyond(basis, v))) / max(float(np.linalg.norm(v)), 1e-300)


def _score(basis: Array, left: Array, v: Array, delta: float) -> tuple[float, float]:
    if _visible(basis, v) < VISIBLE:
        return 0.0, 0.0
    beyond = _beyond(basis, v)
    norm = float(np.linalg.norm(beyond))
    return float(beyond @ left) / norm, delta * float(beyond @ left) / norm**2


def _sized(change: Callable[[float], Array | None], delta: float, reach: float, size: float) -> tuple[float, Array | None]:
    """Find a value that moves the prediction by about ``size``; None where the bound comes first and nothing moves."""
    low, high, failures = 0.0, math.inf, 0
    v: Array | None = None
    for _ in range(TRIES):
        delta = math.copysign(min(abs(delta), abs(reach)), reach)
        v = change(delta)
        failures += v is None
        if failures > FAILURES:
            return delta, None
        rms = math.inf if v is None else float(np.sqrt(np.mean(v**2)))
        if 0.5 < rms / size < 2:
            return delta, v
        if rms < size:
            if abs(delta) >= abs(reach):
                return delta, v if rms > 0.1 * LINEAR else None
            low = abs(delta)
        else:
            high = abs(delta)
        factor = min(max(size / max(rms, 1e-30), 1e-2), 1e2)
        guess = abs(delta) * factor
        delta = math.copysign(guess if low < guess < high else math.sqrt(max(low, high / 100) * high), reach)
    return delta, v


@dataclass(frozen=True, kw_only=True, eq=False)
class Refit:
    """A model with one candidate more."""

    screened: Screened
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


def refit(base: Fit, screened: Screened, to_beat: float = 0.0) -> Refit | None:
    """Fit the model with a candidate from its own start; None where it cannot run.

    Parameters
    ----------
    to_beat
        Gain that another candidate has: a second start is only worth while if the screening promises more.
    """
    problem = base.problem.with_numbers(screened.candidate.number(screened.scale), *screened.companions)
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
        if fits[-1].cost < promised or (screened.score**2 < to_beat and fits[-1].cost < base.cost - 1):
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


def _afresh(fit: Fit, screened: Screened) -> list[Fit]:
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
class Unseen:
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


def judge(fit: Fit, held: Sequence[tuple[Data, Sequence[Number]]], *, settled: bool = False) -> Unseen:
    """Judge a fit on held-out trials, or on blocks of time of the training ones if there are none.

    Parameters
    ----------
    settled
        Whether the errors of the held-out marks stay as they are.
    """
    if not held:
        return _blocks(fit)
    fits = [_explain(fit, data, numbers, settled) for data, numbers in held]
    return Unseen(
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


def places(d: Data) -> list[slice]:
    """Where a trial's errors are told from: the light mass's place where it was seen, else all channels."""
    return [d.slices[n] for n in ("light_x", "light_y") if n in d.slices] or list(d.slices.values())


def _explain(fit: Fit, data: Data, own: Sequence[Number], settled: bool) -> Fit:
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


def _blocks(fit: Fit) -> Unseen:
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
    return Unseen(
        names=tuple(names),
        chi2=(float(np.average(chi2, weights=counts)),),
        counts=(problem.count,),
        limits=(_limit(fit),),
        rms=(float(np.sqrt(np.mean(np.square(sizes)))) if sizes else None,),
    )


def _block(d: Data) -> NDArray[np.int_]:
    """Number of the block of time that each value belongs to; of events alone, their moments one after another."""
    if not d.channels:
        return np.asarray(np.unique(d.t, return_inverse=True)[1] % BLOCKS)
    span = float(np.ptp(d.t)) or 1.0
    return np.asarray(np.minimum((BLOCKS * (d.t - d.t.min()) / span).astype(int), BLOCKS - 1))
