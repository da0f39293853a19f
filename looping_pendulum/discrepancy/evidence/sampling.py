"""The evidence of a fitted explanation by importance sampling, which checks Laplace's method where that decides."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from looping_pendulum.discrepancy.evidence.explanation import WIDE, Explanation
from looping_pendulum.discrepancy.evidence.prior import log_density
from looping_pendulum.discrepancy.fit.calibration import Fit
from looping_pendulum.reference_ode.geometry import Array

SAMPLES = 300
"""Number of runs of each trial by which an evidence is checked."""
LEAST_EFFECTIVE = 0.05
"""Effective share of the samples below which they say nothing: a few of them have nearly all the weight."""


def checked(e: Explanation, fit: Fit, seed: int = 0) -> Explanation:
    """Return an explanation with its evidence by sampling around its optimum; unchanged where too few samples count.

    Samples are Gaussian, as Laplace's method takes the posterior to be. Each counts by the ratio of the posterior density there
    to that: beyond a bound it counts nothing, and the prior of an effect is the one at its own size.

    Parameters
    ----------
    fit
        The explanation's fit with its most probable noise.
    """
    p = fit.problem
    values, vectors = np.linalg.eigh(fit.jacobian.T @ fit.jacobian)
    z = np.random.default_rng(seed).standard_normal((SAMPLES, len(values)))
    x = fit.x + (z / np.sqrt(values)) @ vectors.T
    inside = np.all((x >= p.low) & (x <= p.high), axis=1)
    log_weights = np.full(SAMPLES, -np.inf)
    rows = x[inside]
    residuals = [p.residuals_of(row, predicted) for row, predicted in zip(rows, p.predict_many(rows), strict=True)]
    rise = np.array([math.inf if r is None else float(r @ r) - fit.cost for r in residuals])
    log_weights[inside] = 0.5 * (np.sum(z[inside] ** 2, axis=1) - rise)
    sigma = np.sqrt(np.diag(fit.covariance))
    for c in e.parts.effects:
        i = p.names.index(c.name)
        error = float(sigma[i]) * p.free_parameters[i].scale / c.stated_error
        log_weights += _log_prior(x[:, i], float(sigma[i]), error) - _log_prior(fit.x[i : i + 1], float(sigma[i]), error)
    most = float(log_weights.max())
    if most == -math.inf:
        return e
    weights = np.exp(log_weights - most)
    if float(weights.sum() ** 2 / np.sum(weights**2)) < LEAST_EFFECTIVE * SAMPLES:
        return e
    correction = most + math.log(float(weights.mean()))
    return dataclasses.replace(e, log_z=e.log_z + correction, checked=True)


def _log_prior(x: Array, sigma: float, error: float) -> Array:
    """Return the log prior density of an effect less that of the fit's wide one, but for a constant; as `explained` has it."""
    density = np.minimum(log_density(x / sigma, error), -0.5 * math.log(2 * math.pi))
    return np.asarray(density + 0.5 * (x / WIDE) ** 2)
