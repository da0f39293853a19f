"""Laws of unknown form beside a fit, as Gaussian processes of one coordinate: their evidence by a linear model.

The response of the data to a small push at one time is computed for each place where a law may act and for pulses at all times.
A law that is a function of the state pushes, to first order, as that function of the undisturbed motion: the response to it is
a sum of those to pulses, and no law costs a run of its own. All sums are made once as Gram matrices of each trial.

This says where the exact fit of a law begins. Beside that fit, its weights are linear parameters again, and all priors of them
are compared once more.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from looping_pendulum.discrepancy.evidence.marginal import NoiseGrid, sigma_of
from looping_pendulum.discrepancy.evidence.prior import LENGTHS, POINT_SIGMA, RIDGES
from looping_pendulum.discrepancy.fit.calibration import Fit
from looping_pendulum.discrepancy.fit.problem import Problem
from looping_pendulum.measured.free_parameter import FreeParameter
from looping_pendulum.measured.study import Estimate, Study
from looping_pendulum.reference_ode.effects.closure import (
    COORDINATES,
    FACTORS,
    N_BASIS_FUNCTIONS,
    ROUNDING_DISTANCE,
    coordinates_at,
    weight_name,
)
from looping_pendulum.reference_ode.effects.types import Kinematics
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.transitions import Mode

STRING_ON_ROD = "string on rod"
"""Target of a law of the string's friction."""
TARGETS: dict[str, tuple[str, ...]] = {
    "light mass, along the string": ("along",),
    "light mass, across the string": ("across",),
    "light mass": ("along", "across"),
    "light mass, to the right": ("gradient",),
    "light mass, upward": ("gradient",),
    "light mass, away from a point": ("gradient",),
    "heavy mass": ("heavy",),
    STRING_ON_ROD: ("friction",),
}
"""Where an unknown law may act -> sides of the closure in `reference_ode.effects.closure`."""
_OF_LIGHT_MASS = COORDINATES[:5]
COORDINATES_OF: dict[str, tuple[str, ...]] = {
    "light mass, along the string": _OF_LIGHT_MASS,
    "light mass, across the string": _OF_LIGHT_MASS,
    "light mass": _OF_LIGHT_MASS,
    "light mass, to the right": ("horizontal_position",),
    "light mass, upward": ("height",),
    "light mass, away from a point": ("distance",),
    "heavy mass": ("time", "retreat_speed", "hanging_length"),
    STRING_ON_ROD: ("wrap_angle", "slip_speed", "normal_load"),
}
"""Target -> coordinates of which a law there is searched for: time, and the place and speeds of what it acts on."""
POINT_SCALE = 0.01
"""Unit of a point's coordinates in a fit [m]."""
MAX_SHIFT = 0.3
"""Largest distance of a fitted point from where the linear model has it, in each direction [m]."""
END_MARGIN = 0.5
"""By how many spacings the basis functions reach beyond either end of the coordinate's range."""
MIN_SPACING = 1e-4
"""Spacing of basis functions [SI] below which a coordinate counts as constant, and is not tried."""
PULSE_SIZE = 1e-3
"""Height of a pulse that counts as one [N, or 1 for friction]: its change of the prediction is of order one."""
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
MAX_POINT_TRIALS = 50
"""Points that are tried from the best of the grid."""
Prior = tuple[float, float]
"""Prior of a law's weights: standard deviation [N, or 1 for friction], of `RIDGES`, and correlation length, of `LENGTHS`."""


@dataclass(frozen=True, kw_only=True)
class Closure:
    """A sum of radial basis functions of one coordinate, times a factor, as an unknown force or change of friction."""

    coordinate: str
    """Name of the coordinate, of `COORDINATES`."""
    factor: str
    """Name of the factor, of `FACTORS`."""
    target: str
    """Where it acts, of `TARGETS`."""
    first_centre: float
    """Coordinate of the first basis function's centre."""
    spacing: float
    """Distance of neighbouring centres, which is also each basis function's width, in units of the coordinate."""
    point: tuple[float, float] | None = None
    """Point (x, y) from which the coordinate "distance" is measured [m]; None for the other coordinates."""

    @property
    def name(self) -> str:
        """Name of a law as a part of an explanation."""
        return f"law: {self.target} by {self.coordinate}{'' if self.factor == 'constant' else f' times {self.factor}'}"

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the weights, side by side."""
        return tuple(weight_name(side, i) for side in TARGETS[self.target] for i in range(N_BASIS_FUNCTIONS))

    @property
    def point_coefficients(self) -> dict[str, float]:
        """Coefficients that say where the point is; empty without one."""
        return dict(zip(("closure_point_x", "closure_point_y"), self.point, strict=True)) if self.point else {}

    @property
    def in_words(self) -> str:
        """What it acts on and depends on, as part of a sentence, but for the point."""
        is_friction = self.target == STRING_ON_ROD
        law = "change of the friction of the string on the rod" if is_friction else f"force on the {self.target}"
        factor = self.factor.replace("_", " ")
        factor = "" if factor == "constant" else f" in proportion to the {factor}, and"
        return f"{law}{factor} as a function of the {self.coordinate.replace('_', ' ')}"

    def added_to(self, study: Study) -> Study:
        """Return ``study`` with this closure among its effects, its weights still zero."""
        fixed = {
            f"closure_of_{self.coordinate}": 1.0,
            f"closure_by_{self.factor}": 1.0,
            "closure_scale": 1 / self.spacing,
            "closure_start": self.first_centre / self.spacing,
            **self.point_coefficients,
        }
        return dataclasses.replace(study, effects={**study.effects, **{n: Estimate(value=v) for n, v in fixed.items()}})

    def basis_functions(self, s: Array) -> Array:
        """Return every basis function at coordinates ``s`` of shape (n,), shape (n, N_BASIS_FUNCTIONS)."""
        centres = self.first_centre + self.spacing * np.arange(N_BASIS_FUNCTIONS)
        return np.asarray(np.exp(-0.5 * ((s[:, None] - centres) / self.spacing) ** 2), dtype=np.float64)

    def profile(self, weights: Array, s: Array) -> Array:
        """Return the weighted sum at coordinates ``s``, shape of ``s``; [N], or [N s/m] times a speed; [1] for friction."""
        return np.asarray(self.basis_functions(s) @ weights)


def without_law(study: Study) -> Study:
    """Return ``study`` without what `Closure.added_to` has put among its effects."""
    return dataclasses.replace(study, effects={n: e for n, e in study.effects.items() if not n.startswith("closure_")})


def factors_of(target: str) -> tuple[str, ...]:
    """Return the factors with which a law is searched for: friction and a force along a gradient have none."""
    if target == "heavy mass":
        return FACTORS[:2]  # while the string is taut, the first speed is its own
    return FACTORS if TARGETS[target][0] in ("along", "across") else FACTORS[:1]


def log_share(law: Closure) -> float:
    """Return the log of a law's share of the prior of all laws: bodies alike, then targets and coordinates, then factors."""
    body = body_of(law.target)
    targets = [t for t in TARGETS if body_of(t) == body]
    ways = sum(len(COORDINATES_OF[t]) for t in targets) * len(factors_of(law.target))
    return -math.log(len({body_of(t) for t in TARGETS}) * ways)


def body_of(target: str) -> str:
    """Return what a target is a part of: "light mass", "heavy mass" or "string on rod"."""
    return target.split(",")[0]


def point_parameters(closure: Closure, trials: tuple[str, ...], prior: float) -> list[FreeParameter]:
    """Return x and y of the point from which a closure's distance is measured as free parameters; empty without one.

    Their standard deviation is ``prior`` times `POINT_SCALE`.
    """
    return [
        FreeParameter(
            name=name, parameter=name, trials=trials, init_value=value, scale=POINT_SCALE, prior=prior,
            bounds=(value - MAX_SHIFT, value + MAX_SHIFT),
        )
        for name, value in closure.point_coefficients.items()
    ]  # fmt: skip


def weight_parameters(closure: Closure, trials: tuple[str, ...], scale: float) -> list[FreeParameter]:
    """Return a closure's weights as free parameters, of standard deviation ``scale``."""
    return [
        FreeParameter(name=n, parameter=n, trials=trials, init_value=0.0, scale=scale, prior=1.0, bounds=(-1e6, 1e6))
        for n in closure.names
    ]


@dataclass(frozen=True, kw_only=True, eq=False)
class Motions:
    """The undisturbed motion of all training trials, samples end to end, arrays of shape (n,)."""

    coordinates: dict[str, Array]
    """Values of each of `COORDINATES` but the distance [SI]."""
    trial: Array
    """Index of the trial of every sample."""
    sliding: NDArray[np.bool_]
    """Whether the string slides on the rod."""
    clamped: bool
    """Whether all are held pendulums, of which only a force across the taut string changes the motion."""

    def from_point(self, point: tuple[float, float]) -> Array:
        """Return the vector (x, y) from a point to the light mass, and its rounded length [m], shape (3, n)."""
        x, y = self.coordinates["horizontal_position"] - point[0], self.coordinates["height"] - point[1]
        return np.stack([x, y, np.sqrt(x**2 + y**2 + ROUNDING_DISTANCE**2)])

    def coordinate(self, closure: Closure) -> Array:
        """Return the values of a closure's coordinate at all samples, shape (n,)."""
        return self.coordinates[closure.coordinate] if closure.point is None else self.from_point(closure.point)[2]

    @property
    def pulse_spacing(self) -> float:
        """Distance of pulses [s]."""
        return float(self.coordinates["time"].max()) / (N_PULSES - 1)

    def where_it_acts(self, closure: Closure) -> Array:
        """Return the values of a closure's coordinate where it can act: friction and the heavy mass's force while it slides."""
        values = self.coordinate(closure)
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

        x, y = self.coordinates["horizontal_position"], self.coordinates["height"]

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

    def directions(self, closure: Closure) -> dict[str, Array]:
        """Return side of `PULSED_SIDES` -> the closure's push there per unit of its profile at all samples, side by side."""
        sides = TARGETS[closure.target]
        if sides != ("gradient",):
            push = np.ones(len(self.trial)) if closure.factor == "constant" else -self.coordinates[closure.factor]
            return dict.fromkeys(sides, push)
        if closure.point is None:
            is_to_right = closure.coordinate == "horizontal_position"
            to_right, upward = np.full(len(self.trial), float(is_to_right)), np.full(len(self.trial), float(not is_to_right))
        else:
            x, y, length = self.from_point(closure.point)
            to_right, upward = x / length, y / length
        cosine, sine = np.cos(self.coordinates["wrap_angle"]), np.sin(self.coordinates["wrap_angle"])
        return {"along": to_right * sine - upward * cosine, "across": -to_right * cosine - upward * sine}


def motions(fit: Fit) -> Motions:
    """Return the motion of all trials by a fit."""
    problem, coordinates = fit.problem, []
    samples = [problem.run(fit.x, k) for k in range(len(problem.data))]
    for k, one in enumerate(samples):
        s, p = one.state, problem.parameters_and_camera(fit.x, k)[0].values()
        kinematics = Kinematics(
            time=one.t, free_length=s.free_length, wrap_angle=s.wrap_angle, retreat_speed=s.retreat_speed,
            across_speed=s.across_speed, across_speed_size=np.abs(s.across_speed),
            light_mass_speed=np.hypot(s.retreat_speed, s.across_speed), heavy_speed=s.heavy_speed,
            heavy_speed_size=np.abs(s.heavy_speed),
        )  # fmt: skip
        coordinates.append(np.stack(coordinates_at(np, kinematics, p)))
    modes = np.concatenate([s.mode for s in samples])
    return Motions(
        coordinates=dict(zip(COORDINATES[:-1], np.concatenate(coordinates, axis=1), strict=False)),
        trial=np.concatenate([np.full(len(s.t), k) for k, s in enumerate(samples)]),
        sliding=np.isin(modes, (Mode.SLIDING_DOWN, Mode.SLIDING_UP)),
        clamped=bool((modes == Mode.CLAMPED).all()),
    )


def respond(problem: Problem, x: Array, spacing: float, sides: Sequence[str]) -> Array:
    """Return the changes of the standardised prediction per unit of each pulse, shape (n, sides, N_PULSES).

    Parameters
    ----------
    spacing
        Distance of the pulses [s].
    sides
        Where they act, of `PULSED_SIDES`.
    """
    trials = tuple(t.name for t in problem.study.trials)
    names = [weight_name(side, i) for side in sides for i in range(N_BASIS_FUNCTIONS)]
    added = [FreeParameter(name=n, parameter=n, trials=trials, init_value=0.0, scale=PULSE_SIZE, prior=1.0) for n in names]
    parameters = (*problem.free_parameters, *added)
    prior = np.zeros(len(parameters)), np.eye(len(parameters))
    found = []
    for first in range(0, N_PULSES, N_BASIS_FUNCTIONS):
        closure = Closure(coordinate="time", factor="constant", target="", first_centre=first * spacing, spacing=spacing)
        pulsed = Problem(closure.added_to(problem.study), problem.data, parameters, prior)
        jacobian = pulsed.jacobian(np.append(x, np.zeros(len(added))))
        found.append(jacobian[: problem.measured_rows, len(x) :].reshape(-1, len(sides), N_BASIS_FUNCTIONS) / PULSE_SIZE)
    return np.concatenate(found, axis=2)


@dataclass(frozen=True, kw_only=True, eq=False)
class Law:
    """A law beside a fit: its evidence over the fit without it, by the linear model."""

    closure: Closure
    log_bayes_factor: float
    """With all priors of its weights."""
    prior: Prior
    """The one that is most probable."""
    weights: Array
    """Most probable weights by this prior [N, or 1 for friction], shape (sides * N_BASIS_FUNCTIONS,)."""
    step: Array
    """Change of the fitted parameters with these weights, shape (p,)."""
    decrease: float
    """Decrease of the cost, prior of the weights included."""


@lru_cache
def covariance_root(length: float, sides: int) -> Array:
    """Return a root L of the weights' prior covariance L L^T, in units of the ridge's square."""
    i = np.arange(N_BASIS_FUNCTIONS)
    k = np.exp(-0.5 * ((i[:, None] - i) / length) ** 2) if length else np.eye(N_BASIS_FUNCTIONS)
    return np.asarray(block_diag(*[np.linalg.cholesky(k + 1e-6 * np.eye(N_BASIS_FUNCTIONS))] * sides))


@dataclass(frozen=True, kw_only=True, eq=False)
class Weighing:
    """Evidence of a law over the model without it, for all priors of its weights, where the data are linear in these."""

    spectra: tuple[tuple[Array, Array, Array], ...]
    """Of each of `LENGTHS`: eigenvalues of the Gram matrix of the weights, projections of the residuals without the law, shape
    (k,) each, and the weights [N, or 1 for friction] that they belong to, shape (weights, k)."""

    @classmethod
    def of(cls, gram: Array, along: Array) -> Weighing:
        """Return it from the weights' Gram matrix, shape (w, w), and their products with the residuals, shape (w,).

        Both beyond what the fitted parameters can do, per weight [N, or 1 for friction].
        """
        spectra = []
        for length in LENGTHS:
            root = covariance_root(length, len(gram) // N_BASIS_FUNCTIONS)
            values, vectors = np.linalg.eigh(root.T @ gram @ root)
            kept = values > 1e-10 * max(float(values[-1]), 1e-300)
            weights = root @ vectors[:, kept]
            spectra.append((values[kept], weights.T @ along, weights))
        return cls(spectra=tuple(spectra))

    @cached_property
    def log_bayes_factors(self) -> Array:
        """Log Bayes factors, shape (LENGTHS, RIDGES)."""
        square = RIDGES[:, None] ** 2
        return np.array(
            [0.5 * np.sum(square * q**2 / (1 + square * e) - np.log1p(square * e), axis=1) for e, q, _ in self.spectra]
        )

    def log_bayes_factor(self, prior: Prior) -> float:
        """Return the log Bayes factor by one prior."""
        return float(self.log_bayes_factors[LENGTHS.index(prior[1]), RIDGES.tolist().index(prior[0])])

    def weights(self, prior: Prior) -> Array:
        """Return the most probable weights by a prior [N, or 1 for friction]."""
        values, along, weights = self.spectra[LENGTHS.index(prior[1])]
        return np.asarray(weights @ (prior[0] ** 2 / (1 + prior[0] ** 2 * values) * along))

    def decrease(self, prior: Prior) -> float:
        """Return the decrease of the cost by those weights, their prior included."""
        values, along, _ = self.spectra[LENGTHS.index(prior[1])]
        return float(np.sum(along**2 * prior[0] ** 2 / (1 + prior[0] ** 2 * values)))


def best_prior(log_bayes_factors: Array) -> Prior:
    """Return the most probable prior, from an array of shape (LENGTHS, RIDGES)."""
    length, ridge = np.unravel_index(int(np.argmax(log_bayes_factors)), log_bayes_factors.shape)
    return float(RIDGES[ridge]), LENGTHS[length]


class Laws:
    """All laws beside a fit.

    Parameters
    ----------
    setting
        Setting of the noise by which they are looked at.
    fitted
        `explanation.raw` of the fit.
    """

    def __init__(self, fit: Fit, runs: Motions, grid: NoiseGrid, setting: int, fitted: Array) -> None:
        self.fit, self.runs = fit, runs
        problem, sides = fit.problem, ("across",) if runs.clamped else PULSED_SIDES
        n = problem.measured_rows
        responses = respond(problem, fit.x, runs.pulse_spacing, sides).reshape(n, -1) * sigma_of(problem.data)[:, None]
        self._free = [i for i in range(len(problem.names)) if i not in fit.at_bounds]
        # Residuals and derivatives by the free parameters
        fitted = np.nan_to_num(fitted[:, [0, *(1 + i for i in self._free)]])
        self._sides = {side: slice(i * N_PULSES, (i + 1) * N_PULSES) for i, side in enumerate(sides)}
        # Of each trial: Gram matrix of the responses, their products with residuals and derivatives, and what makes pulses of a
        # function of time at its samples, shape (N_PULSES, samples)
        self._grams, self._crosses, self._projections = [], [], []
        whole, noises, begin = fitted[n:].T @ fitted[n:], grid.noises(setting), 0
        for k, data in enumerate(grid.data):
            part = slice(begin, begin := begin + len(data.t))
            standardised = data.with_noises(noises).standardise(np.hstack([responses[part], fitted[part]]))
            pulses, rest = standardised[:, : responses.shape[1]], standardised[:, responses.shape[1] :]
            self._grams.append(pulses.T @ pulses)
            self._crosses.append(pulses.T @ rest)
            whole = whole + rest.T @ rest
            distance = runs.coordinates["time"][runs.trial == k, None] - runs.pulse_spacing * np.arange(N_PULSES)
            self._projections.append(np.linalg.pinv(np.exp(-0.5 * (distance / runs.pulse_spacing) ** 2), rcond=1e-4))
        self._inverse, self._along = np.linalg.pinv(whole[1:, 1:], hermitian=True), whole[1:, 0]

    def all(self) -> list[Law]:
        """Return all laws."""
        found = []
        for target, names in COORDINATES_OF.items():
            if self.runs.clamped and TARGETS[target] != ("across",):
                continue
            for name in names:
                closures = (
                    [self.runs.best_from_point(target, lambda closure: self.law(closure).log_bayes_factor)]
                    if name == "distance"
                    else [self.runs.closure(target, name, factor) for factor in factors_of(target)]
                )
                found += [self.law(c) for c in closures if c]
        return found

    def law(self, closure: Closure) -> Law:
        """Return the evidence of a law."""
        used, of_trials = self._of_pulses(closure)
        gram = sum(m.T @ g[np.ix_(used, used)] @ m for m, g in zip(of_trials, self._grams, strict=True))
        cross = np.asarray(sum(m.T @ c[used] for m, c in zip(of_trials, self._crosses, strict=True)))
        fitted = cross[:, 1:]
        weighing = Weighing.of(gram - fitted @ self._inverse @ fitted.T, cross[:, 0] - fitted @ self._inverse @ self._along)
        log_bf = weighing.log_bayes_factors
        prior = best_prior(log_bf)
        weights, step = weighing.weights(prior), np.zeros(len(self.fit.x))
        step[self._free] = self._inverse @ (self._along - fitted.T @ weights)
        # A point is two fitted numbers, which cost what the Bayesian information criterion takes for them
        cost_of_point = 0.5 * len(closure.point_coefficients) * math.log(self.fit.problem.count)
        return Law(
            closure=closure,
            log_bayes_factor=float(np.logaddexp.reduce(log_bf, axis=None)) - math.log(log_bf.size) - cost_of_point,
            prior=prior,
            weights=weights,
            step=step,
            decrease=weighing.decrease(prior),
        )

    def _of_pulses(self, closure: Closure) -> tuple[Array, list[Array]]:
        """Return the pulses that a law needs, and how large each of them is by each weight, for every trial."""
        basis = closure.basis_functions(self.runs.coordinate(closure))
        directions = self.runs.directions(closure)
        together = TARGETS[closure.target] == ("gradient",)  # both parts of a force belong to the same weights
        found = []
        for k, projection in enumerate(self._projections):
            here = self.runs.trial == k
            parts = [projection @ (push[here, None] * basis[here]) for push in directions.values()]
            found.append(np.vstack(parts) if together else block_diag(*parts))
        used = np.concatenate([np.arange(self._sides[s].start, self._sides[s].stop) for s in directions])
        return used, found


def laws_beside(fit: Fit, grid: NoiseGrid, setting: int, fitted: Array) -> Laws | None:
    """Return all laws beside a fit; None: the records are too long for pulses to show where in a swing a force acts."""
    if not any(d.channels for d in fit.problem.data):  # a few events do not determine a law as a function
        return None
    runs = motions(fit)
    if runs.coordinates["time"].max() > MAX_PULSE_SPACING * N_PULSES:
        return None
    return Laws(fit, runs, grid, setting, fitted)


def with_law(p: Problem, closure: Closure, prior: Prior) -> Problem:
    """Return a problem with a law's point and weights as further parameters, the weights in units of the prior's ridge."""
    trials = tuple(t.name for t in p.study.trials)
    of_point = POINT_SIGMA / POINT_SCALE
    points, weights = point_parameters(closure, trials, of_point), weight_parameters(closure, trials, prior[0])
    root = block_diag(p.prior_weights, np.eye(len(points)) / of_point, prior_root(closure, prior))
    mean = np.append(p.prior_mean, np.zeros(len(points) + len(weights)))
    return Problem(closure.added_to(p.study), p.data, (*p.free_parameters, *points, *weights), (mean, root))


def prior_root(closure: Closure, prior: Prior) -> Array:
    """Return a root of the inverse prior covariance of a law's weights, in units of the ridge."""
    return np.asarray(np.linalg.inv(covariance_root(prior[1], len(TARGETS[closure.target]))))


def weighed(fit: Fit, closure: Closure, prior: Prior, gram: Array) -> Weighing:
    """Return the evidence of a fitted law by all priors.

    Parameters
    ----------
    prior
        Prior that its weights have in the fit.
    gram
        Gram matrix of the fit's residuals and derivatives, prior included, shape (1 + p, 1 + p).
    """
    p, x = fit.problem, fit.x
    of_law = [p.names.index(n) for n in closure.names]
    others = [i for i in range(len(x)) if i not in of_law and i not in fit.at_bounds]
    normal, along = gram[1:, 1:], gram[1:, 0]
    inverse = np.linalg.pinv(normal[np.ix_(others, others)], hermitian=True)
    cross = normal[np.ix_(of_law, others)]
    root = prior_root(closure, prior)
    # Without the prior of the weights, which have it in units of the ridge
    complement = normal[np.ix_(of_law, of_law)] - root.T @ root - cross @ inverse @ cross.T
    rest = along[of_law] + root.T @ root @ x[of_law] - cross @ inverse @ along[others]
    return Weighing.of(complement / prior[0] ** 2, (rest + complement @ x[of_law]) / prior[0])
