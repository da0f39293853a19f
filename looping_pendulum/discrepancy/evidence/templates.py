"""Changes of the prediction by every listed candidate, of some sizes and to either side, beside a fit."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from looping_pendulum.discrepancy.data.free_parameter import FreeParameter
from looping_pendulum.discrepancy.evidence.marginal import sigma_of
from looping_pendulum.discrepancy.fit.calibration import Fit
from looping_pendulum.discrepancy.fit.predictions import Steps, together
from looping_pendulum.discrepancy.listed.candidates import Candidate
from looping_pendulum.discrepancy.listed.screening import (
    FINER,
    FINITE_SIZES,
    LINEAR_SIZE,
    MAX_ODD_SHARE,
    MIN_INDEPENDENT_SHARE,
    MIN_SHARE_FOR_FINITE,
    MIN_SHARE_OF_LINEAR,
    SCALE_SIZE,
    _Changes,
    _derivative_by_fitted,
    _finer,
    _first_change,
    _independent_share,
    _rms,
)
from looping_pendulum.discrepancy.workers import SERIAL, Workers
from looping_pendulum.reference_ode.geometry import Array


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


def templates(fit: Fit, chosen: Sequence[Candidate], workers: Workers = SERIAL) -> list[Template]:
    """Return the templates of candidates beside a fit."""
    basis = np.linalg.qr(fit.jacobian)[0]
    derivatives = {c.name: d for c in chosen if (d := _derivative_by_fitted(fit, fit.jacobian, c)) is not None}
    cases = [(c, tuple(values)) for c in chosen for values in c.companion_grid()]
    found = workers.map_together(_templates_together, (fit, basis, derivatives), cases)
    own = {c.name: c for c in chosen}  # a worker process returns copies
    return [dataclasses.replace(t, candidate=own[t.candidate.name]) for of_case in found for t in of_case]


def _templates_together(
    shared: tuple[Fit, Array, dict[str, Array]], cases: Sequence[tuple[Candidate, tuple[float, ...]]]
) -> list[list[Template]]:
    return together([_templates(*shared, *case) for case in cases])


def _templates(
    fit: Fit, basis: Array, derivatives: dict[str, Array], candidate: Candidate, companion_values: Sequence[float]
) -> Steps[list[Template]]:
    companions = candidate.companion_parameters(companion_values)
    problem = fit.problem.with_parameters(candidate.free_parameter(1.0), *companions)
    at = candidate.where_it_acts(fit.problem.free_parameters, fit.x)
    changes = _Changes(problem, at, len(companions), len(fit.residuals))
    both_sides = candidate.bounds[0] < candidate.null < candidate.bounds[1] and not candidate.even
    reaches = [(candidate.bounds[1] if side > 0 else candidate.bounds[0]) - candidate.null for side in (1.0, -1.0)]
    reaches = [reach for reach, side in zip(reaches, (1.0, -1.0), strict=True) if side * reach > 0]
    # What a finite change does to the phase of a long swing, the fitted parameters nearly undo: its curvature would be left
    sizes = (LINEAR_SIZE,) if problem.is_swing else (LINEAR_SIZE, *FINITE_SIZES)
    first = _first_change(candidate)
    where = yield from changes.find(reaches, sizes, first, first)
    if changes.cannot_run:
        return []
    linear = [delta for (_, size), delta in where.items() if size == LINEAR_SIZE and delta is not None]
    yield from changes.compute(
        [share * delta for delta in linear for share in ((-1.0, FINER, -FINER) if both_sides else (FINER,))]
    )
    found: list[Template] = []
    sigma = sigma_of(problem.data)

    def add(delta: float, change: Array, linear: bool, square: bool) -> None:
        # Beyond what the fitted parameters can do; below it, errors of finite differences decide
        if _independent_share(basis, change) >= MIN_INDEPENDENT_SHARE:
            size = SCALE_SIZE / max(_rms(change), 1e-12)
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
                square = _rms(central) < MAX_ODD_SHARE * _rms(change)
                change = change if square else central
            if candidate.name in derivatives:
                change = derivatives[candidate.name] * delta
            elif not square and _independent_share(basis, change) < MIN_SHARE_OF_LINEAR:
                change = _finer(changes.known, delta, opposite is not None, change)
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
