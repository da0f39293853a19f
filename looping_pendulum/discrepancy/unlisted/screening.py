"""Screen closures by the evidence for each, with the model linearised about a fit.

The response of the data to a small push at one time is computed for each place where a closure may act and for pulses at all
times. A closure that is a function of the state pushes, to first order, as that function of the undisturbed motion: the
response to it is a sum of those to pulses, and no closure costs a run of its own. Its evidence has a ridge (Gaussian prior of
the weights) that maximises it.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import SimpleNamespace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr

from looping_pendulum.discrepancy.data.free_parameter import FreeParameter
from looping_pendulum.discrepancy.fit.calibration import Fit
from looping_pendulum.discrepancy.fit.predictions import predict
from looping_pendulum.discrepancy.fit.problem import Problem
from looping_pendulum.discrepancy.unlisted.closures import COORDINATES_OF, TARGETS, Closure, factors_of
from looping_pendulum.discrepancy.workers import SERIAL, Batch, Workers
from looping_pendulum.reference_ode.effects.closure import (
    COORDINATES,
    N_BASIS_FUNCTIONS,
    ROUNDING_DISTANCE,
    coordinates_at,
    light_mass_position,
    weight_name,
)
from looping_pendulum.reference_ode.effects.types import Kinematics
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.transitions import Mode

END_MARGIN = 0.5
"""By how many spacings the basis functions reach beyond either end of the coordinate's range."""
MIN_SPACING = 1e-4
"""Spacing of basis functions [SI] below which a coordinate counts as constant, and is not tried."""
PULSE_SIZE = 1e-3
"""Height of a pulse [N, or 1 for friction] of the difference quotients."""
N_PULSES = 60
"""Pulses along the longest trial, a width apart."""
MAX_PULSE_SPACING = 0.1
"""Largest distance of pulses [s]: wider ones would not show where in a swing a force acts."""
PULSED_SIDES = ("along", "across", "heavy", "friction")
"""Sides whose responses give those of all closures: a force along a gradient is one along and across the string."""
POINT_GRID = 9
"""Points in each direction at which a point of attraction is tried first."""
POINT_MARGIN = 0.2
"""Share of the light mass's range by which this grid is larger on every side."""
# From 10 uN, which move 10 g by a tenth of a millimetre in half a second, to 1 N, about the heavy mass's weight
RIDGES = np.logspace(-5, 0, 41)
"""Prior standard deviations of the weights that are tried [N, or 1 for friction]; by their evidence, all are alike."""
MAX_POINT_TRIALS = 50
"""Points that are tried from the best of the grid."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Motions:
    """The undisturbed motion of all training trials, samples end to end, arrays of shape (n,)."""

    kinematics: Kinematics
    parameters: tuple[SimpleNamespace, ...]
    """Parameters of each trial, as the equations read them."""
    trial: Array
    """Index of the trial of every sample."""
    sliding: NDArray[np.bool_]
    """Whether the string slides on the rod."""
    clamped: bool
    """Whether all are held pendulums, of which only a force across the taut string changes the motion."""

    def coordinate(self, name: str, point: tuple[float, float] | None = None) -> Array:
        """Return the values of a coordinate at all samples, shape (n,)."""
        if name == "distance":
            assert point is not None
            x, y = self.positions
            return np.asarray(np.sqrt((x - point[0]) ** 2 + (y - point[1]) ** 2 + ROUNDING_DISTANCE**2))
        return np.asarray(self._coordinates[COORDINATES.index(name)])

    @property
    def pulsed_sides(self) -> tuple[str, ...]:
        """Return the sides on which pulses change the motion."""
        return ("across",) if self.clamped else PULSED_SIDES

    @property
    def is_too_long(self) -> bool:
        """Return whether the records are so long that pulses would not show where in a swing a force acts."""
        return bool(self.kinematics.time.max() > MAX_PULSE_SPACING * N_PULSES)

    @property
    def pulse_spacing(self) -> float:
        """Return the distance of pulses [s]."""
        return float(self.kinematics.time.max()) / (N_PULSES - 1)

    @cached_property
    def positions(self) -> Array:
        """Position (x, y) of the light mass [m], shape (2, n)."""
        return np.concatenate([np.stack(light_mass_position(np, k, p)) for k, p in self._each_trial], axis=1)

    @cached_property
    def _coordinates(self) -> Array:
        rows = [np.stack(coordinates_at(np, k, p)) for k, p in self._each_trial]
        return np.concatenate(rows, axis=1)

    @property
    def _each_trial(self) -> list[tuple[Kinematics, SimpleNamespace]]:
        k = self.kinematics
        return [
            (Kinematics(*(f[self.trial == i] if isinstance(f, np.ndarray) else f for f in k)), p)
            for i, p in enumerate(self.parameters)
        ]

    def where_it_acts(self, closure: Closure) -> Array:
        """Return the values of a closure's coordinate where it can act: friction and the heavy mass's force while it slides."""
        values = self.coordinate(closure.coordinate, closure.point)
        return values[self.sliding] if TARGETS[closure.target][0] in ("friction", "heavy") and self.sliding.any() else values

    def closure(
        self, target: str, name: str, factor: str = "constant", point: tuple[float, float] | None = None
    ) -> Closure | None:
        """Return a closure with its basis functions in their places; None: its coordinate is constant."""
        closure = Closure(coordinate=name, factor=factor, target=target, first_centre=0.0, spacing=1.0, point=point)
        low, high = np.quantile(self.where_it_acts(closure), [0.0, 0.995])
        spacing = float(high - low) / (N_BASIS_FUNCTIONS - 1 - 2 * END_MARGIN)
        if spacing < MIN_SPACING:
            return None
        return dataclasses.replace(closure, first_centre=float(low) - END_MARGIN * spacing, spacing=spacing)

    def best_from_point(self, target: str, evidence: Callable[[Closure], float]) -> Closure | None:
        """Return the closure of the distance from the point that has the most evidence; None: there is none."""
        from scipy.optimize import minimize

        x, y = self.positions

        def closure(point: Sequence[float]) -> Closure | None:
            return self.closure(target, "distance", point=(float(point[0]), float(point[1])))

        def cost(point: Sequence[float]) -> float:
            one = closure(point)
            return -evidence(one) if one else math.inf

        axes = [np.linspace(v.min() - POINT_MARGIN * np.ptp(v), v.max() + POINT_MARGIN * np.ptp(v), POINT_GRID) for v in (x, y)]
        start = min(((a, b) for a in axes[0] for b in axes[1]), key=cost)
        step = 0.5 * max(float(a[1] - a[0]) for a in axes)
        simplex = np.array([start, (start[0] + step, start[1]), (start[0], start[1] + step)])
        options = {"maxfev": MAX_POINT_TRIALS, "initial_simplex": simplex, "xatol": 1e-3, "fatol": 0.1}
        return closure(minimize(cost, start, method="Nelder-Mead", options=options).x)

    def pulses_of(self, k: int) -> Array:
        """Return the matrix that makes pulses of a function of time, at the samples of trial ``k``, shape (N_PULSES, n)."""
        t, spacing = self.kinematics.time[self.trial == k], self.pulse_spacing
        pulses = np.exp(-0.5 * ((t[:, None] - spacing * np.arange(N_PULSES)) / spacing) ** 2)
        return np.asarray(np.linalg.pinv(pulses, rcond=1e-4))

    def factor(self, name: str) -> Array:
        """Return the factor of the basis functions, 1 or minus a speed, shape (n,)."""
        return np.ones(len(self.trial)) if name == "constant" else -getattr(self.kinematics, name)

    def directions(self, closure: Closure) -> dict[str, Array]:
        """Return side of `PULSED_SIDES` -> the closure's push there per unit of its profile at all samples, side by side."""
        sides = TARGETS[closure.target]
        if sides != ("gradient",):
            return {side: self.factor(closure.factor) for side in sides}
        to_right, upward = np.zeros(len(self.trial)), np.zeros(len(self.trial))
        if closure.point is None:
            (to_right if closure.coordinate == "horizontal_position" else upward)[:] = 1.0
        else:
            to_right, upward = (self.positions - np.array(closure.point)[:, None]) / self.coordinate("distance", closure.point)
        cosine, sine = np.cos(self.kinematics.wrap_angle), np.sin(self.kinematics.wrap_angle)
        return {"along": to_right * sine - upward * cosine, "across": -to_right * cosine - upward * sine}


def motions(fit: Fit) -> Motions:
    """Return the motion of all trials by a fit."""
    problem = fit.problem
    samples = [problem.run(fit.x, k) for k in range(len(problem.data))]
    fields = [
        (s.t, s.state.free_length, s.state.wrap_angle, s.state.retreat_speed, s.state.across_speed,
         np.abs(s.state.across_speed), np.hypot(s.state.retreat_speed, s.state.across_speed),
         s.state.heavy_speed, np.abs(s.state.heavy_speed))
        for s in samples
    ]  # fmt: skip
    modes = np.concatenate([s.mode for s in samples])
    return Motions(
        kinematics=Kinematics(*(np.concatenate(f) for f in zip(*fields, strict=True))),
        parameters=tuple(problem.parameters_and_camera(fit.x, k)[0].values() for k in range(len(samples))),
        trial=np.concatenate([np.full(len(s.t), k) for k, s in enumerate(samples)]),
        sliding=np.isin(modes, (Mode.SLIDING_DOWN, Mode.SLIDING_UP)),
        clamped=bool((modes == Mode.CLAMPED).all()),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class ScreenedClosure:
    """Evidence for a closure by the model linearised about a fit."""

    closure: Closure
    twice_log_bayes_factor: float
    """Twice the log of the Bayes factor over the model without it."""
    ridge: float
    """Prior standard deviation of the weights that maximises the evidence [N]."""
    weights: Array
    """Weights that this prior and the data give [N], shape (sides * N_BASIS_FUNCTIONS,)."""


def responses_of(base: Fit, runs: Motions, workers: Workers = SERIAL, begun: Batch | None = None) -> Responses:
    """Return the responses of a fit's residuals to pulses; ``begun`` is what `begin_responses` returned for it."""
    # What a refit of the declared model's parameters could explain is no evidence for a new force, so both the residuals and
    # the sensitivities to the weights are projected on the orthogonal complement of the Jacobian.
    fitted_basis, _ = np.linalg.qr(base.jacobian)
    unexplained = base.residuals - fitted_basis @ (fitted_basis.T @ base.residuals)
    shares = workers.finish(begun or begin_responses(base, runs, workers))
    columns = [share[i] for i in range(max(map(len, shares))) for share in shares if i < len(share)]
    return Responses(base, runs, fitted_basis, unexplained, columns)


def screen(responses: Responses) -> list[ScreenedClosure]:
    """Return the evidence of every closure, largest first."""
    screened, runs = [], responses.runs
    for target, names in COORDINATES_OF.items():
        if runs.clamped and TARGETS[target] != ("across",):
            continue
        for name in names:
            if name == "distance":
                screened += _with_best_point(responses, target)
                continue
            screened += [s for factor in factors_of(target) if (s := responses.evidence(target, name, factor))]
    return sorted(screened, key=lambda s: -s.twice_log_bayes_factor)


def begin_responses(base: Fit, runs: Motions, workers: Workers) -> Batch:
    """Begin to compute the changes of the standardised prediction by pulses, for `screen`."""
    sides = [(side, i) for side in runs.pulsed_sides for i in range(0, N_PULSES, N_BASIS_FUNCTIONS)]
    # Two shares, each a batch of runs
    return workers.begin(_respond, (base.problem, base.x, runs.pulse_spacing), [sides[::2], sides[1::2]])


class Responses:
    """Responses of the residuals to pulses at all times, orthogonal to all fitted parameters.

    Parameters
    ----------
    columns
        Results of `begin_responses`.
    """

    def __init__(self, base: Fit, runs: Motions, fitted_basis: Array, unexplained: Array, columns: Sequence[Array]) -> None:
        self.runs = runs
        self.count = base.problem.count
        sides = runs.pulsed_sides
        edges = np.cumsum([0] + [len(d.t) for d in base.problem.data])
        n_trials = len(base.problem.data)
        width = n_trials * N_PULSES
        # By columns and overwritten, since this matrix is most of the memory that an identification takes
        whole = np.zeros((len(fitted_basis), len(sides) * width), order="F")
        for i in range(len(sides)):
            parts = N_PULSES // N_BASIS_FUNCTIONS
            of_side = np.concatenate(columns[i * parts : (i + 1) * parts], axis=1)
            # A pulse is at one time in all trials; a closure pushes each at times of its own
            for k in range(n_trials):
                rows = slice(edges[k], edges[k + 1])
                block = whole[:, i * width + k * N_PULSES : i * width + (k + 1) * N_PULSES]
                block[rows] = of_side[rows]
                block -= fitted_basis @ (fitted_basis[rows].T @ of_side[rows])
        # An orthonormal basis of all responses makes every screening as small as the number of pulses
        basis, root = qr(whole, overwrite_a=True, mode="economic", check_finite=False)
        self.unexplained = basis.T @ unexplained
        self._roots = {side: root[:, i * width : (i + 1) * width] for i, side in enumerate(sides)}
        self._projections = [runs.pulses_of(k) for k in range(n_trials)]

    def to(self, closure: Closure) -> Array:
        """Return the response to each of a closure's weights, side by side."""
        basis = closure.basis_functions(self.runs.coordinate(closure.coordinate, closure.point))
        parts = [
            self._roots[side]
            @ np.concatenate(
                [p @ (push[:, None] * basis)[self.runs.trial == k] for k, p in enumerate(self._projections)], axis=0
            )
            for side, push in self.runs.directions(closure).items()
        ]
        # Both parts of a force along a gradient belong to the same weights
        return np.asarray(sum(parts) if TARGETS[closure.target] == ("gradient",) else np.concatenate(parts, axis=1))

    def evidence(
        self, target: str, name: str, factor: str = "constant", point: tuple[float, float] | None = None
    ) -> ScreenedClosure | None:
        """Return the evidence of one closure; None if its coordinate is constant."""
        closure = self.runs.closure(target, name, factor, point)
        return self.evidence_of(closure) if closure else None

    def evidence_of(self, closure: Closure) -> ScreenedClosure:
        """Return the evidence of a closure whose basis functions have their places."""
        twice_log_bayes_factor, ridge, weights = _evidence(self.to(closure), self.unexplained)
        # A point is two fitted numbers, which cost what the Bayesian information criterion takes for them
        twice_log_bayes_factor -= len(closure.point_coefficients) * math.log(self.count)
        return ScreenedClosure(closure=closure, twice_log_bayes_factor=twice_log_bayes_factor, ridge=ridge, weights=weights)


def _respond(shared: tuple[Problem, Array, float], batches: Sequence[tuple[str, int]]) -> list[Array]:
    """Return the changes of the standardised prediction per unit of each pulse, of batches of pulses by side and first one."""
    problem, x, spacing = shared
    requests = []
    for side, first in batches:
        closure = Closure(coordinate="time", factor="constant", target="", first_centre=first * spacing, spacing=spacing)
        trials = tuple(t.name for t in problem.study.trials)
        names = [weight_name(side, i) for i in range(N_BASIS_FUNCTIONS)]
        added = [FreeParameter(name=n, parameter=n, trials=trials, init_value=0.0, scale=PULSE_SIZE, prior=1.0) for n in names]
        parameters = (*problem.free_parameters, *added)
        pulsed = Problem(
            closure.added_to(problem.study), problem.data, parameters, (np.zeros(len(parameters)), np.eye(len(parameters)))
        )
        # The first without a pulse, the others with one each, in units of the weight's scale
        at = np.tile(np.append(x, np.zeros(len(added))), (1 + len(added), 1))
        at[1:, len(x) :] = np.eye(len(added))
        requests.append((pulsed, at))
    return [_columns(problem, *request, predicted) for request, predicted in zip(requests, predict(requests), strict=True)]


def _columns(problem: Problem, pulsed: Problem, at: Array, predicted: Array) -> Array:
    """Return the changes by the pulses of one batch, shape (rows of the problem, pulses)."""
    measured = problem.measured_rows
    residuals = pulsed.residuals_of(at[0], predicted[0])
    assert residuals is not None
    columns = np.zeros((measured + len(problem.free_parameters), len(at) - 1))
    for column, x, row in zip(columns.T, at[1:], predicted[1:], strict=True):
        changed = pulsed.residuals_of(x, row)
        # the sign: a residual is measured less predicted; the rows of the priors do not change
        if changed is not None:
            column[:measured] = ((residuals - changed) / PULSE_SIZE)[:measured]
    return columns


def _with_best_point(responses: Responses, target: str) -> list[ScreenedClosure]:
    """Return the closure whose point has the most evidence; empty if there is none."""
    best = responses.runs.best_from_point(target, lambda closure: responses.evidence_of(closure).twice_log_bayes_factor)
    return [responses.evidence_of(best)] if best else []


def _evidence(sensitivity: Array, residuals: Array) -> tuple[float, float, Array]:
    """Return the largest evidence for Gaussian weights, the ridge that gives it, and the weights' posterior mean.

    The evidence is twice the log of the Bayes factor over the model without the weights. With s the singular values of
    ``sensitivity`` and r the ridge, it is the sum of p^2 (r s)^2 / (1 + (r s)^2) - log(1 + (r s)^2), where p are the residuals'
    components along the left singular vectors.
    """
    u, s, vt = np.linalg.svd(sensitivity, full_matrices=False)
    projected = u.T @ residuals
    power = (RIDGES[:, None] * s) ** 2
    twice_log_bayes_factors = np.sum(projected**2 * power / (1 + power) - np.log1p(power), axis=1)
    best = int(np.argmax(twice_log_bayes_factors))
    ridge = float(RIDGES[best])
    return float(twice_log_bayes_factors[best]), ridge, vt.T @ (ridge**2 * s / (1 + power[best]) * projected)
