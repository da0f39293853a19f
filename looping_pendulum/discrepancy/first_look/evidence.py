"""The probability of a trial's points, given an account of how they came about.

Points are what the declared model predicts + what it lacks + noise. About values that fit, the prediction is linear in the
values that the study leaves free. What the model lacks is an integrated Wiener process in each coordinate: it begins with the
release and may have any shape. All three are Gaussian, so that

    log p(points | account) = -1/2 (r^T C^-1 r + log |2 pi C|),    C = J P J^T + q K + s^2 D^2

is exact, with the derivatives J by the free values, their prior P, the process's covariance K and the points' noise D. The
sizes q and s are summed over. In the eigenvectors of D^-1 K D^-1 the last two terms are diagonal for all sizes at once.

An account may look at other points than another one, as where it says that times are other ones. So each is compared with the
probability of the same points if all that is known of them is that their motion is smooth.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh
from scipy.optimize import least_squares
from scipy.special import logsumexp

from looping_pendulum.discrepancy.first_look.prior import LACKING, LEAST_NOISE, NOISES, SMOOTH
from looping_pendulum.discrepancy.fit.data import TrialData
from looping_pendulum.discrepancy.fit.problem import Problem
from looping_pendulum.measured.observations import BODIES
from looping_pendulum.reference_ode.geometry import Array

PARTS = (0.75, 1.0, 1.25, 1.5, 2.0, 2.5)
"""Ends of the parts that are looked at in turn, in units of the time in which a mass falls through the free length.

In the first the light mass swings down, until 1.5 it begins to loop, and then it has looped and friction has shown itself.
"""
LOOPING = 1.5
"""The part in which the light mass begins to loop."""
MIN_POINTS = 6
"""Smallest number of points of a channel that is compared."""
MIN_ROWS = 12
"""Smallest number of rows that tell how they came about."""
MAX_ROWS = 100
"""Largest number of points of a channel that are compared; more at equal distances tell hardly more."""
STEPS, REFINEMENTS = 15, 4
"""Largest number of linearisations in one part: with one size of what the model lacks, and with the most probable one."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Evidence:
    """How probable points are by one account."""

    log: float
    """Logarithm of the probability density of the points, in that of the same points if their motion is only smooth [nats]."""
    misfit: float = math.inf
    """Root mean square of the points' distances in units of their noise, with the least that the model may lack."""
    lacking: float = LACKING[-1]
    """Most probable of the sizes of what the model lacks [m]."""
    problem: Problem | None = None
    """What was fitted, of one trial; None: nothing could be."""
    reason: str = ""
    """Why nothing could be fitted."""
    x: Array = field(default_factory=lambda: np.zeros(0))
    """The free values about which it is linear."""

    @property
    def explains(self) -> bool:
        """Return whether the points are more probable by the account than by smoothness alone."""
        return self.log > 0

    @property
    def explains_all(self) -> bool:
        """Return whether no more than an effect of a usual size is missing besides."""
        return self.explains and self.lacking < LACKING[-1]

    @property
    def lacks_nothing(self) -> bool:
        """Return whether the model most probably lacks hardly anything."""
        return self.lacking == LACKING[0]

    @property
    def values(self) -> dict[str, float]:
        """Return parameter -> fitted value [SI]."""
        free = self.problem.free_parameters if self.problem else ()
        return {n.parameter: n.init_value + n.scale * float(v) for n, v in zip(free, self.x, strict=True)}


def evidence_of(
    problem: Problem,
    fall_time: float,
    length_per_unit: Mapping[str, float],
    end: float = PARTS[-1],
    start: Array | None = None,
) -> Evidence:
    """Return the evidence of one trial's points by a problem, whose free values are found over growing parts of the trial.

    Parameters
    ----------
    fall_time
        Time in which a mass falls through the free length [s].
    length_per_unit
        Unit of a channel -> length that it is worth [m].
    end
        End of the last part, in units of the same.
    start
        Free values of a fit that is near already, so that two parts do.
    """
    best = Evidence(log=-math.inf)
    growing = tuple(part for part in PARTS if part < end)
    # Where the first part leads astray, a larger one may not
    for parts in ((*growing, end), (*growing[3:], end)) if start is None else ((LOOPING, end),):
        found = _by_parts(problem, parts, fall_time, length_per_unit, start)
        best = max(best, found, key=lambda e: e.log)
        if best.lacks_nothing:
            break
    return dataclasses.replace(best, problem=problem)


def _by_parts(
    problem: Problem,
    parts: Sequence[float],
    fall_time: float,
    length_per_unit: Mapping[str, float],
    start: Array | None = None,
) -> Evidence:
    data = problem.data[0]
    camera = problem.parameters_and_camera(problem.prior_mean, 0)[1]
    x = _inside(problem, np.zeros(len(problem.free_parameters)) if start is None else start)
    before, found = -1, Evidence(log=-math.inf)
    for share in parts:
        whole = data.until((share * fall_time - camera.clock_offset) / camera.clock_ratio)
        part = _thinned(whole)
        if not part.channels or len(whole.value) == before:
            continue
        before = len(whole.value)
        found = _fitted(problem.with_data([part]), Points.of(part, length_per_unit), x)
        if not math.isfinite(found.log):
            break
        x = found.x
    return found


def _fitted(problem: Problem, points: Points, x: Array) -> Evidence:
    """Return the evidence with the model linearised about values that fit, beginning with ``x``."""
    x, found = fitted(problem, lambda x: problem.predict_with_derivatives(x, 0), points, x)
    if not math.isfinite(found.log):
        return Evidence(log=-math.inf)
    return Evidence(log=found.log - points.of_smooth_motion, misfit=found.misfit, lacking=found.lacking, x=x)


def fitted(
    problem: Problem, predict: Callable[[Array], tuple[Array, Array]], points: Points, x: Array
) -> tuple[Array, LinearEvidence]:
    """Return values that fit, looked for from ``x`` on, and the evidence of a model that is linear about them.

    Parameters
    ----------
    predict
        Function that returns what is predicted with some values, and its derivatives.
    """
    prior = np.array([n.prior_sigma for n in problem.free_parameters])
    root = np.sqrt(1 / (1 + growth(LACKING[1]) * points.eigenvalue))

    @lru_cache(maxsize=2)
    def predicted(x: bytes) -> tuple[Array, Array]:
        return predict(np.frombuffer(x))

    def residuals(x: Array) -> Array:
        rest = points.value - predicted(x.tobytes())[0] * points.unit
        return np.concatenate([root * points.whitened(np.where(np.isfinite(rest), rest, 1e3)), x / prior])

    def jacobian(x: Array) -> Array:
        slopes = points.whitened(predicted(x.tobytes())[1] * points.unit[:, None])
        return np.concatenate([-root[:, None] * slopes, np.diag(1 / prior)])

    low, high = np.maximum(problem.low, -50.0), np.minimum(problem.high, 50.0)
    x = least_squares(residuals, x, jacobian, bounds=(low, high), max_nfev=STEPS, xtol=1e-3, ftol=1e-3).x

    def linear(x: Array) -> LinearEvidence:
        return points.linear(*predicted(x.tobytes()), -x, prior)

    at, best = x, linear(x)
    step = best.change
    # The most probable size of what the model lacks may be another one
    for _ in range(REFINEMENTS if math.isfinite(best.log) else 0):
        there = _inside(problem, at + step)
        new = linear(there)
        if new.log - new.to_gain > best.log - best.to_gain:
            at, best, step = there, new, new.change
        else:  # too far for the motion to be linear, or it fails there
            step = step / 4
    # As far as the motion is not linear, what the change promises is not believed
    return at, dataclasses.replace(best, log=best.log - best.to_gain)


def _inside(problem: Problem, x: Array) -> Array:
    """Return free values within their bounds, and a little away from these, where nothing would change with them."""
    low, high = np.maximum(problem.low, -50.0), np.minimum(problem.high, 50.0)
    margin = np.minimum(0.1, 0.1 * (high - low))
    return np.clip(x, low + margin, high - margin)


def _thinned(data: TrialData) -> TrialData:
    """Return the data with `MAX_ROWS` points of each channel, without channels of a few points."""
    channels, sigma = [], []
    for c in data.channels:
        if len(c) >= MIN_POINTS:
            kept = np.unique(np.linspace(0, len(c) - 1, min(MAX_ROWS, len(c))).astype(int))
            channels.append(dataclasses.replace(c, t=c.t[kept], value=c.value[kept]))
            sigma.append(data.sigma[data.slices[c.name]][kept])
    return TrialData(trial=data.trial, channels=tuple(channels), sigma=np.concatenate([np.zeros(0), *sigma]))


@dataclass(frozen=True, kw_only=True, eq=False)
class LinearEvidence:
    """Evidence of a model that is linear about a start."""

    log: float
    misfit: float
    lacking: float
    change: Array
    """Change of the free values to the most probable ones, shape (p,)."""
    to_gain: float
    """By how much the logarithm of the density grows with the change."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Points:
    """Points of one trial in the eigenvectors of what the model may lack."""

    value: Array
    """Points [m], shape (n,)."""
    unit: Array
    """Length that a unit of each point is worth [m], shape (n,)."""
    parts: tuple[tuple[slice, Array, Array], ...]
    """Of each channel its part, the eigenvalues for q = 1, and the matrix to their eigenvectors."""
    eigenvalue: Array
    """Shape (n,)."""
    body: NDArray[np.intp]
    """Number of each point's body, whose noise has one size, shape (n,)."""
    log_sigma: float
    """Sum of the logarithms of the standard deviations of the noise [m]."""
    t: Array

    @staticmethod
    def of(data: TrialData, length_per_unit: Mapping[str, float], noise: ErrorsOfRows | None = None) -> Points:
        """Return a trial's points, whose errors may be other ones than white noise."""
        unit = np.concatenate([np.full(len(c), length_per_unit[c.unit]) for c in data.channels])
        way = max(length_per_unit[c.unit] * float(np.ptp(c.value)) for c in data.channels)
        sigma = np.maximum(data.sigma * unit, LEAST_NOISE * way)
        parts, body = [], np.zeros(len(unit), dtype=int)
        start = min(0.0, *(c.t[0] for c in data.channels))
        log_sigma = 0.0
        for c in data.channels:
            part = data.slices[c.name]
            # The same for both coordinates of a body, and for many accounts
            eigenvalue, matrix, log_determinant = _eigenvectors((c.t - start).tobytes(), sigma[part].tobytes(), noise)
            parts.append((part, eigenvalue, matrix))
            log_sigma += 0.5 * log_determinant
            body[part] = next((i for i, names in enumerate(BODIES.values()) if c.name in names), len(BODIES))
        return Points(
            value=data.value * unit,
            unit=unit,
            parts=tuple(parts),
            eigenvalue=np.concatenate([eigenvalue for _, eigenvalue, _ in parts]),
            body=np.unique(body, return_inverse=True)[1].astype(np.intp),
            log_sigma=log_sigma,
            t=data.t - start,
        )

    def whitened(self, values: Array) -> Array:
        """Return values [m] of shape (n,) or (n, m) in the eigenvectors, in units of the noise."""
        return np.concatenate([matrix @ values[part] for part, _, matrix in self.parts])

    def linear(self, predicted: Array, jacobian: Array, mean: Array, prior: Array) -> LinearEvidence:
        """Return the evidence of a prediction in the points' units, and of changes of it.

        Parameters
        ----------
        mean, prior
            Means and standard deviations of the changes before anything is measured, shape (p,).
        """
        rest = self.whitened(self.value - predicted * self.unit)
        slopes = self.whitened(jacobian * self.unit[:, None])
        return self._summed(rest, slopes, mean, prior, [growth(lacking) for lacking in LACKING])

    @property
    def of_smooth_motion(self) -> float:
        """Return the logarithm of the points' density if all that is known of them is that their motion is smooth."""
        time = float(np.ptp(self.t))
        count = len(self.parts)
        straight, rest, way = np.zeros((len(self.value), 2 * count)), self.value.copy(), 0.0
        for i, (part, _, _) in enumerate(self.parts):
            rest[part] -= self.value[part].mean()
            way = max(way, float(np.ptp(self.value[part])))
            straight[part, 2 * i], straight[part, 2 * i + 1] = 1.0, self.t[part] / time
        way = max(way, math.exp(self.log_sigma / len(self.value)))
        growths = [3 * (bend * way) ** 2 / time**3 for bend in SMOOTH]
        prior = np.full(2 * count, 3 * way)
        return self._summed(self.whitened(rest), self.whitened(straight), np.zeros(2 * count), prior, growths).log

    def _summed(self, rest: Array, slopes: Array, mean: Array, prior: Array, growths: Sequence[float]) -> LinearEvidence:
        noises = np.array(list(product(NOISES, repeat=int(self.body.max()) + 1)))
        q = np.repeat(growths, len(noises))
        noise = np.tile(noises, (len(growths), 1))[:, self.body]
        weight = 1 / (noise**2 + q[:, None] * self.eigenvalue)
        normal = (slopes.T * weight[:, None, :]) @ slopes + np.diag(prior**-2)
        right = (weight * rest) @ slopes + mean / prior**2
        change = np.linalg.solve(normal, right[..., None])[..., 0]
        square = weight @ rest**2 + np.sum((mean / prior) ** 2)
        explained = np.sum(change * right, axis=1)
        log_determinant = np.linalg.slogdet(normal)[1] + 2 * np.sum(np.log(prior)) - np.sum(np.log(weight), axis=1)
        log = -0.5 * (square - explained + log_determinant + len(rest) * math.log(2 * math.pi)) - self.log_sigma
        k = int(np.argmax(log))
        white = next(i for i in range(len(noises)) if np.all(noises[i] == 1.0))
        left = square[white] - explained[white]
        return LinearEvidence(
            log=float(logsumexp(log)) - math.log(len(log)),
            misfit=math.sqrt(max(left, 0.0) / len(rest)),
            lacking=(*LACKING, *SMOOTH)[k // len(noises)],
            change=change[k],
            to_gain=0.5 * float(explained[k]),
        )


def growth(lacking: Any) -> Any:
    """Return the strength q of the process that moves a mass by so much in half a second [m^2/s^3], of any shape."""
    return 3 * lacking**2 / 0.5**3


@dataclass(frozen=True)
class ErrorsOfRows:
    """Errors of the points in successive rows that are not white, as a function of the standard deviations of white ones."""

    name: tuple[str | float, ...]
    covariance: Callable[[Array], Array] = field(compare=False)
    """Of standard deviations of shape (n,), shape (n, n)."""


@lru_cache(maxsize=64)
def _eigenvectors(t: bytes, sigma: bytes, noise: ErrorsOfRows | None) -> tuple[Array, Array, float]:
    """Return eigenvalues of what the model may lack in units of the noise, the matrix to them, and log |noise|."""
    times, deviation = np.frombuffer(t), np.frombuffer(sigma)
    early, late = np.minimum.outer(times, times), np.maximum.outer(times, times)
    growth = early**2 * (3 * late - early) / 6
    if noise is None:
        eigenvalue, vectors = eigh(growth / np.outer(deviation, deviation), driver="evd")
        return np.maximum(eigenvalue, 0.0), vectors.T / deviation, 2 * float(np.sum(np.log(deviation)))
    errors = noise.covariance(deviation)
    eigenvalue, vectors = eigh(growth, errors)
    return np.maximum(eigenvalue, 0.0), vectors.T, float(np.linalg.slogdet(errors)[1])
