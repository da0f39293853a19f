"""How probable the points of one trial are by one hypothesis: the only judge of the first look.

A hypothesis says which trial was filmed (`Case`), and when and how the points of each row were taken (`Taken`). Points are then

    y = m(t + d; x) + S(t) c + n,     x ~ prior of the study,  c ~ N(0, q),  d ~ N(0, u),

with the declared model m, what it lacks S c (the largest modes of an integrated Wiener process in each coordinate), the error d
of a row's time, which all its points share, and noise n: Gaussian, of variance a^2 + (b v)^2 at the speed v, or, with a small
probability, the tracker has slipped to anywhere, or stays where it was. The density's logarithm is Laplace's, about the best x,
c and d, with the model's exact Jacobian; the noise's a and b are fitted, the sizes q are summed over.
"""

from __future__ import annotations

import contextlib
import dataclasses
import math
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from looping_pendulum.discrepancy.fit.data import TrialData
from looping_pendulum.discrepancy.fit.problem import Problem, free_parameters_of
from looping_pendulum.discrepancy.look.case import CANNOT_RUN, END, MIN_ROWS, Case, Rows
from looping_pendulum.discrepancy.look.prior import (
    BLUR,
    CAMERA_ERRORS,
    CLEAN_SHARE,
    KNOWN_NOISE,
    LACKING,
    LATER,
    MAX_LEFT,
    MAX_MISFIT,
    MAX_WHITE,
    MIN_SHARE,
    MODES,
    OPEN_FACTOR,
    SLIPS,
    UNREST,
)
from looping_pendulum.measured.edits import with_free_start
from looping_pendulum.measured.free_parameter import FreeParameter, ParameterRole
from looping_pendulum.reference_ode.geometry import Array

PARTS = ((0.75, 0.1), (1.25, 0.03), (1.75, 0.01), (2.4, 0.003), (END, 0.0))
"""Growing parts of the film that are fitted [`Case.fall_time`], and the error of the model in each, in free lengths.

A motion winds up on the rod ever faster, so that values which are right at the beginning lead to those of the whole.
"""
NEARER = tuple((END, error) for error in (0.3, 0.1, 0.03, 0.01, 0.0))
"""The same of what begins within the film, which may lead far away: of the whole film each time."""
TURNS, FIRST_TURNS = 40, 4
"""Most Gauss-Newton steps of a fit, and of one to a first part."""
ENOUGH = 0.05
"""Gain of a step by which a fit ends."""
MAX_DAMPING = 1e4
"""Of Nielsen's rule (Madsen, Nielsen and Tingleff 2004, section 3.2), at which a fit ends."""
NOISE_RANGE = 1.6
"""Largest factor of the noise at rest and its estimate before the fit."""
MAX_BLUR = 5e-3
"""Largest growth of a point's error with its speed [s]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Smoothing:
    """Points that are weighted sums of tracked ones."""

    inner: NDArray[np.intp]
    """Rows that are compared: those with points whose sums are complete."""
    weights: Array
    """Of the points of all rows in those, shape (inner rows, rows)."""
    root: Array
    """Inverse Cholesky factor of the covariance of their errors, in the variance that they show, square."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Taken:
    """When and how the points of a table were taken."""

    time: Array
    """[s], shape (rows, channels)."""
    used: NDArray[np.bool_]
    """Points that are compared, same shape."""
    unrest: float = UNREST
    """Standard error of each row's time [steps]."""
    late: Array | None = None
    """How late each point is, in a value that is fitted [s], same shape."""
    smoothing: Smoothing | None = None
    later: float | None = None
    """Time at which more begins to act than the model has [s]."""

    @staticmethod
    def as_written(rows: Rows, time: Array | None = None, **more: Any) -> Taken:
        """Return the points at the table's own times, or at others [s], shape (rows,) or (rows, channels)."""
        time = rows.t if time is None else time
        time = np.repeat(time[:, None], len(rows.channels), axis=1) if time.ndim == 1 else time
        return dataclasses.replace(Taken(time=time, used=rows.is_point), **more)

    def with_growing_times(self) -> Taken:
        """Return it without points whose time is not after that of the point before, which no run can have."""
        used = self.used.copy()
        for i in range(used.shape[1]):
            k = np.flatnonzero(used[:, i])
            used[k[1:], i] = np.diff(np.maximum.accumulate(self.time[k, i])) > 1e-9
        return dataclasses.replace(self, used=used)


@dataclass(frozen=True, kw_only=True, eq=False)
class Fit:
    """A hypothesis with its most probable values."""

    log: float
    """Logarithm of the density of the points [1/m of each]."""
    problem: Problem | None = None
    x: Array = field(default_factory=lambda: np.zeros(0))
    amounts: Array = field(default_factory=lambda: np.zeros(0))
    """Of what the model lacks, in `lacking`, and of further columns."""
    lacking: float = LACKING[-1]
    """Most probable size of what the model lacks [m]."""
    misfit: float = math.inf
    """Root mean square of the distances of points that show their body, in units of their noise."""
    left: float = math.inf
    """Distance within which all points but a share of `1 - MIN_SHARE` are [free lengths]."""
    share: float = 0.0
    """Share of points that show their body."""
    end: float = 1.0
    """Time at which the modes end [s]."""
    later: float | None = None
    """Of `Taken`."""
    weight: Array = field(default_factory=lambda: np.zeros((0, 0)))
    """Probability that each point shows its body, shape (rows, channels)."""

    @property
    def shows_masses(self) -> bool:
        """Return whether only noise is left of most points, beside an effect of any size."""
        return self.misfit < MAX_MISFIT and self.share > MIN_SHARE

    @property
    def explains(self) -> bool:
        """Return whether only noise, and an effect of a usual size, are left."""
        return self.shows_masses and self.lacking < LACKING[-1]

    @property
    def leaves_little(self) -> bool:
        """Return whether what an effect of any size leaves is small beside the motion, be it noise or not."""
        return self.left < MAX_LEFT

    @property
    def leaves_noise(self) -> bool:
        """Return whether an effect of any size leaves only noise."""
        return self.misfit < MAX_MISFIT and self.share > CLEAN_SHARE

    @property
    def explains_to_noise(self) -> bool:
        """Return whether an effect of a usual size leaves only noise."""
        return self.leaves_noise and self.lacking < LACKING[-1]

    @property
    def is_clean(self) -> bool:
        """Return whether only noise is left, without any effect."""
        return self.explains_to_noise and self.lacking == LACKING[0]

    @property
    def is_quiet(self) -> bool:
        """Return whether only noise is left, and more of it is white than lasts: the points were not smoothed."""
        return self.explains_to_noise and self.misfit < MAX_WHITE

    @property
    def values(self) -> dict[str, float]:
        """Return parameter -> its most probable value [SI]."""
        free = self.problem.free_parameters if self.problem else ()
        return {n.parameter: n.init_value + n.scale * float(v) for n, v in zip(free, self.x, strict=True)}

    def places(self, rows: Rows, t: Array) -> Array:
        """Return where the bodies are at times of shape (n,), what the model lacks included [SI], shape (n, channels)."""
        assert self.problem is not None
        time = np.repeat(t[:, None], len(rows.channels), axis=1)
        problem = _problem_at(self.problem, rows, time, np.ones_like(time, dtype=bool))
        model = problem.predict(self.x, 0).reshape(len(rows.channels), -1).T
        amounts = self.amounts[: MODES * len(rows.channels)].reshape(-1, MODES)
        return np.asarray(model + self.lacking * _shapes(t, self.end, self.later) @ amounts.T / rows.unit)


NO_FIT = Fit(log=-math.inf)
"""That of a hypothesis that cannot be."""


def problem_of(case: Case, rows: Rows) -> Problem:
    """Return the problem of fitting what the study leaves open to one trial; origin and height are always open."""
    trial = with_free_start(case.study, case.trial, case.observations)
    case = case.with_trial(trial)
    free = []
    for n in free_parameters_of(case.study, [(trial, case.observations)]):
        if n.parameter in ("origin_x", "origin_y", "hanging_length"):
            bounds = (1e-3, math.inf) if n.parameter == "hanging_length" else n.bounds
            n = dataclasses.replace(n, scale=max(n.scale, case.free_length), prior=1.0, bounds=bounds)
        distance = n.init_value - n.bounds[0]
        if 0 < distance < n.scale:  # a unit that is no larger than the distance from its bound
            n = dataclasses.replace(n, scale=distance, prior=n.prior_sigma * n.scale / distance)
        free.append(n)
    priors, named = case.study.camera_priors(trial, case.observations), {n.parameter for n in free}
    for name, error in CAMERA_ERRORS.items():
        of_start = name == "clock_offset" and trial.in_mid_swing
        at_bound = name == "tilt" and abs(priors["tilt"].value if name in priors else 0.0) > math.pi - error
        if name in priors and name not in named and not (of_start or at_bound):
            scale = OPEN_FACTOR if name in case.open else error or priors[name].sigma or 1e-3
            free.append(
                FreeParameter(
                    name=f"{trial.name}.{name}", parameter=name, role=ParameterRole.CAMERA, trials=(trial.name,),
                    init_value=priors[name].value, scale=scale, prior=1.0,
                )
            )  # fmt: skip
    return Problem(
        case.study, [TrialData(trial=trial, channels=rows.channels, sigma=np.ones(sum(map(len, rows.channels))))], free
    )


def _problem_at(problem: Problem, rows: Rows, time: Array, used: NDArray[np.bool_]) -> Problem:
    """Return the problem at other times; ``used`` are the points that it predicts, by channels."""
    channels = tuple(
        dataclasses.replace(c, t=time[used[:, i], i], value=np.zeros(int(used[:, i].sum())), stated_error=None)
        for i, c in enumerate(rows.channels)
        if used[:, i].any()
    )
    return problem.with_data([TrialData(trial=problem.data[0].trial, channels=channels, sigma=np.ones(int(used.sum())))])


@lru_cache(maxsize=8)
def _modes_on_grid(end: float) -> tuple[Array, Array]:
    """Return a grid of times up to ``end`` [s] and the modes there, of the process's covariance (s < t)

    cov(s, t) = 3 / 0.5^3 s^2 (3 t - s) / 6.
    """
    grid = np.linspace(0, max(end, 1e-3), 80)
    early, late = np.minimum.outer(grid, grid), np.maximum.outer(grid, grid)
    value, vector = np.linalg.eigh(3 / 0.5**3 * early**2 * (3 * late - early) / 6)
    return grid, vector[:, -MODES:] * np.sqrt(value[-MODES:])


def _shapes(t: Array, end: float, later: float | None) -> Array:
    """Return the shapes of what the model lacks, by 1 in half a second, or of what begins later, shape (n, modes)."""
    begin = later or 0.0
    grid, modes = _modes_on_grid(round(end - begin, 3))
    return np.stack([np.interp(t - begin, grid, mode) for mode in modes.T], axis=-1) * (LATER if later else 1.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class Linear:
    """A hypothesis linearised about some values of all its unknowns, on the grid of rows and channels."""

    z: Array
    """Values: of x, of what the model lacks, and of further columns, shape (q,)."""
    rest: Array
    """Points less the prediction, 0 where there is none [SI], shape (rows, channels)."""
    matrix: Array
    """Derivatives of the prediction, 0 where there is no point, shape (rows, channels, q)."""
    by_time: Array
    """Derivative of the prediction by the row's time [SI/s], shape (rows, channels)."""
    used: NDArray[np.bool_]
    """Points that are compared, same shape."""

    def scaled(self, factor: float, columns: slice) -> Linear:
        """Return it with some columns multiplied by a factor, and their values divided by it."""
        matrix, z = self.matrix.copy(), self.z.copy()
        matrix[..., columns] *= factor
        z[columns] /= factor
        return dataclasses.replace(self, matrix=matrix, z=z)


def _linearised(problem: Problem, rows: Rows, taken: Taken, z: Array, end: float) -> Linear:
    """Return a hypothesis about values z; the problem is that of its points (`_problem_at`).

    Raises
    ------
    ArithmeticError
        If the model cannot run with them.
    """
    p, c, used = len(problem.free_parameters), len(rows.channels), taken.used
    at, slopes = problem.predict_with_derivatives(z[:p], 0)
    if not np.isfinite(at).all():
        raise ArithmeticError("the model cannot run")
    prediction, matrix = np.zeros((c, len(rows.t))), np.zeros((c, len(rows.t), len(z)))
    prediction[used.T] = at  # by columns, as a problem has its points
    matrix[used.T, :p] = slopes
    offset = next((i for i, n in enumerate(problem.free_parameters) if n.parameter == "clock_offset"), None)
    by_time = np.zeros_like(prediction) if offset is None else matrix[..., offset] / problem.free_parameters[offset].scale
    for i in range(c):
        shapes = _shapes(taken.time[:, i], end, taken.later) * LACKING[1] / rows.unit[i]
        matrix[i, :, p + MODES * i : p + MODES * (i + 1)] = np.where(used[:, i, None], shapes, 0.0)
    if taken.late is not None:
        matrix[..., -1] = by_time * taken.late.T
    prediction += matrix[..., p:] @ z[p:]
    rest = np.where(used, np.nan_to_num(rows.value) - prediction.T, 0.0)
    matrix, by_time = matrix.transpose(1, 0, 2), np.where(used, by_time.T, 0.0)
    if taken.smoothing is not None:
        weights, inner = taken.smoothing.weights, taken.smoothing.inner
        rest = rows.value[inner] - weights @ prediction.T
        matrix = np.tensordot(weights, matrix, axes=1)
        by_time, used = np.zeros_like(rest), used[inner]
    return Linear(z=z, rest=rest, matrix=matrix, by_time=by_time, used=used)


@dataclass(frozen=True, kw_only=True, eq=False)
class Errors:
    """Errors of the points of all rows, and how probable they are if they do not show their body."""

    rows: Rows
    at_rest: Array
    """Factor on the noise of each body at rest, shape (bodies,)."""
    blur: Array
    """Growth of the noise of each body with its speed [s], shape (bodies,)."""
    model: float
    """Error of the model [m]."""
    unrest: float
    """Error of each row's time [s]."""
    otherwise: Array
    """Logarithm of the density of each body's points if they do not show it, shape (rows, bodies)."""
    root: Array | None
    """Of `Smoothing`."""

    @property
    def of_channel(self) -> NDArray[np.intp]:
        """Return the body of each channel, shape (channels,)."""
        return np.asarray(np.argmax(self.rows.body_of_channel, axis=1))

    def sigma(self) -> Array:
        """Return the errors of the points beside those of times [SI], shape (rows, channels)."""
        rest = np.nan_to_num(self.rows.at_rest, nan=1.0) * self.at_rest[self.of_channel]
        moving = np.nan_to_num(self.rows.speed) * self.blur[self.of_channel]
        return np.asarray(np.sqrt(rest**2 + moving**2 + (self.model / self.rows.unit) ** 2))

    def fitted_to(self, judged: Judged) -> Errors:
        """Return them with the two numbers of each body's noise as what is left of the points says, by one step of EM."""
        sum_to_body, sigma = self.rows.body_of_channel, judged.sigma
        rest = np.nan_to_num(self.rows.at_rest, nan=1.0) * self.at_rest[self.of_channel]
        moving = np.nan_to_num(self.rows.speed) * self.blur[self.of_channel]

        def variance(part: Array, per: Array, prior: Array) -> Array:
            """Return that of one part of the errors, in units of ``per``: its mean square, given what is left."""
            share = (part / sigma) ** 2
            square = share**2 * judged.left**2 * sigma**2 + part**2 * (1 - share)
            weight = judged.weight * (per > 0)
            square = np.divide(square, per**2, out=np.zeros_like(square), where=per > 0)
            total = (weight * square).sum(axis=0) @ sum_to_body
            return np.asarray((KNOWN_NOISE * prior + total) / (KNOWN_NOISE + weight.sum(axis=0) @ sum_to_body))

        at_rest = np.sqrt(variance(rest, np.nan_to_num(self.rows.at_rest), np.ones(len(self.at_rest))))
        blur = np.sqrt(variance(moving, np.nan_to_num(self.rows.speed), np.full(len(self.blur), BLUR**2)))
        return dataclasses.replace(
            self, at_rest=np.clip(at_rest, 1 / NOISE_RANGE, NOISE_RANGE), blur=np.clip(blur, BLUR / 10, MAX_BLUR)
        )

    def log_prior(self) -> float:
        """Return the logarithm of the prior density of the noise, that of its expected value left out."""
        ratio = np.concatenate([self.at_rest**2, (self.blur / BLUR) ** 2])
        return -0.5 * KNOWN_NOISE * float(np.sum(1 / ratio - 1 + np.log(ratio)))


@dataclass(frozen=True, kw_only=True, eq=False)
class Judged:
    """A linearised hypothesis after a step of its values."""

    log: float
    """Logarithm of the joint density of points and values."""
    z: Array
    left: Array
    """What is left of the points, times not changed, in `sigma`, shape (rows, channels)."""
    sigma: Array
    weight: Array
    """Probability that each point shows its body, 0 where there is none, shape (rows, channels)."""
    normal: Array
    """Negative second derivative of `log` by z, shape (q, q)."""
    slope: Array
    """Its first derivative, shape (q,)."""


def _judged(linear: Linear, errors: Errors, precision: Array, step: Array) -> Judged:
    """Judge a hypothesis after a step; the errors of the rows' times take their most probable values."""
    rows, to_body, sigma = errors.rows, errors.rows.body_of_channel, errors.sigma()
    left, matrix = (linear.rest - linear.matrix @ step) / sigma, linear.matrix / sigma[..., None]
    log_size = -np.log(sigma * rows.unit * math.sqrt(2 * math.pi))
    if errors.root is not None:
        left, matrix = errors.root @ left, np.tensordot(errors.root, matrix, axes=1)
        log_size = log_size + np.log(np.diag(errors.root))[:, None]
    late = errors.unrest * linear.by_time / sigma  # what a time's error moves each point, in its noise

    def seen(left: Array) -> tuple[Array, Array]:
        """Return the logarithm of each body's density, and the probability that its points show it."""
        own = np.where(linear.used, log_size - 0.5 * left**2, 0.0) @ to_body + math.log1p(-SLIPS)
        both = np.logaddexp(own, errors.otherwise)
        return both, np.where(linear.used, np.exp(np.clip(own - both, -50, 0)) @ to_body.T, 0.0)

    _, weight = seen(left / np.sqrt(1 + late**2))
    spread = 1 + (weight * late**2).sum(axis=1)
    shift = (weight * late * left).sum(axis=1) / spread
    both, weight = seen(left - shift[:, None] * late)
    z = linear.z + step
    of_rows = np.where(linear.used @ to_body > 0, both, 0.0).sum(axis=1) - 0.5 * (shift**2 + np.log(spread))
    log = float(of_rows.sum() - 0.5 * np.sum(precision * z**2))
    weighted = (matrix * weight[..., None]).reshape(-1, len(z))
    by_row = np.einsum("kc,kcq->kq", weight * late, matrix)
    normal = weighted.T @ matrix.reshape(-1, len(z)) - by_row.T @ (by_row / spread[:, None]) + np.diag(precision)
    slope = weighted.T @ left.ravel() - by_row.T @ ((weight * late * left).sum(axis=1) / spread) - precision * z
    return Judged(log=log, z=z, left=left - shift[:, None] * late, sigma=sigma, weight=weight, normal=normal, slope=slope)


def _step(judged: Judged, normal: Array, low: Array, high: Array) -> Array:
    """Return the step to the greatest density within bounds on the values: what would leave them stops there."""
    step, is_free = np.zeros_like(judged.z), np.ones(len(judged.z), dtype=bool)
    while is_free.any():
        rest = judged.slope - normal @ np.where(is_free, 0.0, step)
        step[is_free] = np.linalg.solve(normal[np.ix_(is_free, is_free)], rest[is_free])
        inside = np.clip(step, low - judged.z, high - judged.z)
        leaves, step = is_free & (inside != step), inside
        if not leaves.any():
            break
        is_free &= ~leaves
    return step


def fit(case: Case, rows: Rows, taken: Taken | None = None, *, start: Array | None = None, turns: int = TURNS) -> Fit:
    """Return a hypothesis with its fit, `NO_FIT` if it cannot be.

    Parameters
    ----------
    taken
        By default as written.
    start
        Values of x from a fit that is near.
    """
    taken = (taken or Taken.as_written(rows)).with_growing_times()
    if taken.used.any(axis=1).sum() < MIN_ROWS:
        return NO_FIT
    try:
        return _Search(case, rows, taken).fit(start, turns)
    except CANNOT_RUN:
        return NO_FIT


class _Search:
    """Search for the most probable values of one hypothesis, by damped Gauss-Newton steps."""

    def __init__(self, case: Case, rows: Rows, taken: Taken) -> None:
        self.case, self.rows, self.taken = case, rows, taken
        self.problem = problem = problem_of(case, rows)
        self.p = len(problem.free_parameters)
        self.modes = slice(self.p, self.p + MODES * len(rows.channels))
        more = self.modes.stop - self.p + (taken.late is not None)
        self.low = np.append(np.maximum(problem.low, -50), np.full(more, -50.0))
        self.high = np.append(np.minimum(problem.high, 50), np.full(more, 50.0))
        self.precision: Array = np.append([1 / n.prior_sigma**2 for n in problem.free_parameters], np.ones(more))
        self.end = min(float(taken.time[taken.used].max()), END * case.fall_time)

    def fit(self, start: Array | None, turns: int) -> Fit:
        """Return the fit, over growing parts of the film if it starts from the declared values."""
        z, now, done = np.zeros(len(self.low)), None, 0
        z[: self.p] = self._placed() if start is None else start
        parts = PARTS if start is None and self.taken.smoothing is None else PARTS[-1:] if self.taken.later is None else NEARER
        errors = self._errors()
        for share, tolerance in parts:
            used = self.taken.used & ((self.taken.time <= share * self.case.fall_time) | (tolerance == 0))
            if used.sum() < self.p or (used.sum() == done and share < END):
                continue
            done, part = used.sum(), dataclasses.replace(self.taken, used=used)
            errors = dataclasses.replace(errors, model=tolerance * self.case.free_length)
            now, errors = self._climb(part, errors, z, FIRST_TURNS if tolerance else turns)
            z = now.z
        return NO_FIT if now is None else self._result(now, errors)

    def _placed(self) -> Array:
        """Return the declared values x with the origin and the heavy mass's height where the first points show them."""
        first = self.taken.used & (self.taken.time <= PARTS[1][0] * self.case.fall_time)
        names, x = [n.parameter for n in self.problem.free_parameters], np.zeros(self.p)
        value = np.full(first.T.shape, np.nan)
        with contextlib.suppress(*CANNOT_RUN):
            there = _problem_at(self.problem, self.rows, self.taken.time, first).predict(x, 0)
            value[first.T] = self.rows.value.T[first.T] - there
        away = {c.name: v[np.isfinite(v)] for c, v in zip(self.rows.channels, value, strict=True) if np.isfinite(v).any()}

        def move(name: str, by: list[Array]) -> float:
            """Move a value by the median of what is away."""
            shift = float(np.median(np.concatenate(by))) if by and name in names else 0.0
            if shift:
                i = names.index(name)
                x[i] = np.clip(shift / self.problem.free_parameters[i].scale, self.low[i], self.high[i])
            return shift

        move("origin_x", [v for name, v in away.items() if name.endswith("_x")])
        up = move(
            "origin_y",
            [v for name, v in away.items() if name == "light_y"] or [v for n, v in away.items() if n in ("heavy_y", "height")],
        )
        move("hanging_length", [up - v for name, v in away.items() if name == "heavy_y"])
        return x

    def _errors(self) -> Errors:
        bodies, smoothing, otherwise = len(self.rows.bodies), self.taken.smoothing, self.rows.log_otherwise()
        rows = self.rows if smoothing is None else self.rows.part(smoothing.inner)
        return Errors(
            rows=rows,
            at_rest=np.ones(bodies),
            blur=np.full(bodies, BLUR),
            model=0.0,
            unrest=self.taken.unrest * self.rows.step,
            otherwise=otherwise if smoothing is None else otherwise[smoothing.inner],
            root=None if smoothing is None else smoothing.root,
        )

    def _climb(self, taken: Taken, errors: Errors, z: Array, turns: int) -> tuple[Linear, Errors]:
        """Return a hypothesis about the values to which steps lead, and the errors that go with them."""
        margin = np.minimum(0.1, 0.1 * (self.high - self.low))
        problem = _problem_at(self.problem, self.rows, taken.time, taken.used)
        here = _linearised(problem, self.rows, taken, np.clip(z, self.low + margin, self.high - margin), self.end)
        judged, damping, growth = _judged(here, errors, self.precision, np.zeros_like(z)), 1e-3, 2.0
        low, high = self.low + margin / 10, self.high - margin / 10
        for _ in range(turns):
            damped = judged.normal + damping * np.diag(np.diag(judged.normal))
            step = _step(judged, damped, np.maximum(low, here.z - 5), np.minimum(high, here.z + 5))
            try:
                z = here.z + step
                there = _linearised(problem, self.rows, taken, z, self.end)
                new = _judged(there, errors, self.precision, np.zeros_like(z))
            except CANNOT_RUN:
                new = None
            if new is None or new.log < judged.log:
                damping, growth = growth * damping, 2 * growth
                if damping > MAX_DAMPING:
                    break
                continue
            gain, expected = new.log - judged.log, float(judged.slope @ step - 0.5 * step @ judged.normal @ step)
            damping *= max(1 / 3, 1 - (2 * gain / expected - 1) ** 3) if expected > 0 else 1.0
            here, judged, growth = there, new, 2.0
            if not errors.model:
                errors = errors.fitted_to(judged)
                judged = _judged(here, errors, self.precision, np.zeros_like(z))
            if gain < (1.0 if errors.model else ENOUGH):
                break
        return here, errors

    def _result(self, at: Linear, errors: Errors) -> Fit:
        """Return the fit about the last values, summed over the sizes of what the model lacks."""
        sizes = []
        for size in LACKING:
            scaled = at.scaled(size / LACKING[1], self.modes)
            judged = _judged(scaled, errors, self.precision, np.zeros_like(at.z))
            step = _step(judged, judged.normal, self.low, self.high)
            judged = _judged(scaled, errors, self.precision, step)
            log_volume = 0.5 * float(np.sum(np.log(self.precision)) - np.linalg.slogdet(judged.normal)[1])
            sizes.append((judged.log + log_volume, size, judged))
        _, lacking, best = max(sizes, key=lambda s: s[0])
        log = float(logsumexp([s[0] for s in sizes])) - math.log(len(sizes)) + errors.log_prior()
        weight = best.weight
        left = np.abs(best.left * best.sigma * self.rows.unit / self.case.free_length)[at.used]
        misfit = math.sqrt(float((weight * best.left**2).sum() / max(weight.sum(), 1))) * math.sqrt(
            float(np.mean(errors.at_rest**2))
        )
        return Fit(
            log=log + self.case.log_volume * int(at.used.sum()),
            problem=self.problem,
            x=np.clip(best.z[: self.p], self.low[: self.p], self.high[: self.p]),
            amounts=best.z[self.p :],
            lacking=lacking,
            misfit=misfit,
            left=float(np.quantile(left, MIN_SHARE)),
            share=float(weight[at.used].mean()),
            end=self.end,
            later=self.taken.later,
            weight=weight,
        )
