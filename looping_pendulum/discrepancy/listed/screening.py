"""Screening: how much of what a fit leaves each candidate's sensitivity explains, beyond all that is fitted already."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np

from looping_pendulum.discrepancy.fit.calibration import Fit
from looping_pendulum.discrepancy.fit.problem import FreeParameter, Problem
from looping_pendulum.discrepancy.listed.candidates import Candidate
from looping_pendulum.discrepancy.workers import ALONE, Workers
from looping_pendulum.reference_ode.geometry import Array

LINEAR, TEMPLATES = 0.3, (3.0, 12.0)
"""Sizes of the tried changes [RMS, in units of noise]: one that is still linear, and finite ones."""
UNIT = 10.0
"""Change that one scale of a candidate makes [RMS, in units of noise]."""
VISIBLE = 1e-3
"""Part of a change that must be left beyond all fitted numbers: below it finite differences decide."""
CLEAR = 0.05
"""The same share above which finite changes are tried too: of one that is nearly absorbed, its own curvature would be left."""
TRIES, FAILURES = 12, 2
"""Values that are tried for a template of the wanted size, and how many of them may be impossible."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ScreenedCandidate:
    """How well a candidate's sensitivity fits what is left."""

    candidate: Candidate
    score: float
    """z of the best template; its square is the decrease of the cost that it promises."""
    amplitude: float
    """Value less null that it promises [SI]."""
    scale: float
    """Change [SI] that moves the prediction by `UNIT`."""
    companions: tuple[FreeParameter, ...] = ()
    """What is fitted with it, at the values that promise most."""


def screen(
    fit: Fit, chosen: Sequence[Candidate], without: Sequence[str] = (), workers: Workers = ALONE
) -> list[ScreenedCandidate]:
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
    shared = _Screening(bare, fit.x[kept], basis, left)
    chosen = costly_first(chosen)
    found = workers.map(_screen_one, shared, chosen, about=[c.name for c in chosen])
    # a helper's own copies of the candidates stay with it
    same = [dataclasses.replace(s, candidate=c) for c, s in zip(chosen, found, strict=True) if s]
    return sorted(same, key=lambda s: -abs(s.score))


def compile_for(problem: Problem, candidate: Candidate | None) -> None:
    """Run every trial with a little of a candidate (None: differentiate the model without one), so that it is compiled."""
    if candidate is None:
        problem.jacobian(problem.prior_mean)
        return
    companions = candidate.companion_numbers(candidate.companion_grid()[0])
    delta = math.copysign(_least(candidate), candidate.bounds[1] - candidate.null or -1.0)
    x = np.concatenate([problem.prior_mean, [delta], np.zeros(len(companions))])
    problem.with_numbers(candidate.number(1.0), *companions).residuals(x)


def _least(candidate: Candidate) -> float:
    """Change that is tried first [SI]."""
    return 1e-3 * abs(candidate.null) or 1e-6


class _Screening(NamedTuple):
    """What is the same for all candidates that are screened."""

    bare: Problem
    """Without numbers that are at their null value."""
    x: Array
    basis: Array
    """Orthonormal changes that the fitted numbers can make, shape (n, numbers)."""
    left: Array
    """What the fit leaves beyond these, shape (n,)."""


def _screen_one(shared: _Screening, candidate: Candidate) -> ScreenedCandidate | None:
    tried = [_screen_from(shared, candidate, values) for values in candidate.companion_grid()]
    return min((s for s in tried if s), key=lambda s: -abs(s.score), default=None)


def costly_first(chosen: Iterable[Candidate]) -> list[Candidate]:
    """Order candidates so that those that take longest do not come last: others then share what is left."""
    return sorted(chosen, key=lambda c: -len(c.companion_grid()))


def _beyond(basis: Array, v: Array) -> Array:
    """Part of ``v`` that no fitted number can make."""
    return np.asarray(v - basis @ (basis.T @ v))


def _screen_from(shared: _Screening, candidate: Candidate, values: Sequence[float]) -> ScreenedCandidate | None:
    """Score a candidate whose companions have these ``values`` [SI]."""
    bare, x, basis, left = shared
    companions = candidate.companion_numbers(values)
    problem = bare.with_numbers(candidate.number(1.0), *companions)
    here = bare.residuals(x)
    if here is None:
        return None
    measured = sum(len(d.t) for d in bare.data)
    happening = bare.happening(x)
    v = np.zeros(len(left))  # no prior speaks of a candidate

    @cache
    def change(delta: float) -> Array | None:
        there = np.concatenate([x, [delta], np.zeros(len(companions))])
        moved = problem.residuals(there)
        if moved is None or np.any(happening & ~problem.happening(there)):
            return None
        v[:measured] = (here - moved[: len(here)])[:measured]
        return v.copy()

    best, scale = (0.0, 0.0), 0.0
    first = _least(candidate)
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
    return ScreenedCandidate(candidate=candidate, score=best[0], amplitude=best[1], scale=scale, companions=companions)


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
