"""Estimate the correlated noise of tracked points from the residuals of a fit, and fit the model again with it.

Amplitude and correlation time of each body maximise the restricted likelihood of the residuals (Patterson and Thompson,
Biometrika 58 (1971) 545): the fitted parameters, about which the model is linear, are integrated out, since a fit removes from
the residuals what its parameters can do. A body keeps white noise unless the Bayesian information criterion is lower with the
correlated part, be it a part of its own or, as one tracker mostly follows both masses, the same as the other mass's.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize

from looping_pendulum.discrepancy.data.observations import BODIES
from looping_pendulum.discrepancy.fit.calibration import Fit, calibrate, minimise
from looping_pendulum.discrepancy.fit.correlated_noise import CorrelatedNoise, Whitening
from looping_pendulum.discrepancy.fit.predictions import jacobian_at
from looping_pendulum.discrepancy.fit.problem import Problem, TrialData
from looping_pendulum.discrepancy.fit.residual_noise import MIN_DIFFERENCES, data_with_noise_of_residuals
from looping_pendulum.reference_ode.geometry import Array

MIN_CORRELATION_STEPS = 2.0
"""Shortest correlation time, in time steps: below it, the noise cannot be distinguished from white noise."""
MAX_PRIOR_SIGMAS = 4.0
"""Largest distance of a measured parameter from its value, in standard errors."""
MAX_CORRELATION_SHARE = 0.1
"""Longest correlation time, as a part of the longest trial.

Errors that last longer look like a wrong scale, clock or origin, which are parameters of the camera, or like what the model
lacks.
"""
START_AMPLITUDES, START_TIMES = (0.3, 1.0, 4.0, 16.0), 6
"""Amplitudes [white sigma] and number of correlation times among which the search begins: the likelihood has local maxima."""
SIMPLEX_SIZE = 0.5
"""Size of the first simplex of the search, in logarithms."""
LOG_TOLERANCE, COST_TOLERANCE = 0.03, 0.1
"""Relative accuracy of both, which the data determine to some 20 %, and accuracy of -2 ln L."""
PASSES = 2
"""Number of turns in which the noise of each body is estimated beside that of the others."""
PARAMETERS = 2
"""Numbers that describe the correlated noise of a body: amplitude and correlation time."""
ROUNDS = 2
"""Number of turns in which the noise is estimated and the model is fitted; after two they agree."""

Noises = Mapping[str, CorrelatedNoise]
"""Body -> its correlated noise; a body with white noise alone is left out."""


def with_correlated_noise(fit: Fit) -> Fit:
    """Estimate each body's correlated noise, keep that for which there is evidence, and fit the model again.

    Measured parameters then stay within `MAX_PRIOR_SIGMAS` of their values: with larger errors of the points a fit would
    otherwise be free to hide in them what the model lacks.
    """
    fit = _within_prior_bounds(fit)
    noises: Noises = {}
    for _ in range(ROUNDS):
        white = _data_with_white_noise(fit)
        noises = _Likelihood(fit, white).estimate(noises)
        fit = minimise(fit.problem.with_data([with_noises(d, noises) for d in white]), fit.x)
        if not noises:
            break
    return fit


def data_with_possible_wander(fit: Fit) -> list[TrialData]:
    """Return the data with the correlated noise that Akaike's criterion keeps: less evidence is enough."""
    white = _data_with_white_noise(fit)
    noises = _Likelihood(fit, white).estimate({}, lambda count: 2 * PARAMETERS)
    return [with_noises(d, noises) for d in white]


def _data_with_white_noise(fit: Fit) -> list[TrialData]:
    """Return the data with the noise of a fit's residuals as if it were white."""
    bare = _without_correlated_noise(fit)
    return [_white(data_with_noise_of_residuals(bare, k)) for k in range(len(fit.problem.data))]


def _within_prior_bounds(fit: Fit) -> Fit:
    """Return the fit with measured parameters bounded to within `MAX_PRIOR_SIGMAS` standard errors of their values."""
    p, bounded = fit.problem, []
    for n in p.free_parameters:
        reach = math.inf if n.sigma is None else MAX_PRIOR_SIGMAS * n.sigma
        bounds = max(n.bounds[0], n.init_value - reach), min(n.bounds[1], n.init_value + reach)
        bounded.append(dataclasses.replace(n, bounds=bounds))
    problem = Problem(p.study, p.data, bounded, (p.prior_mean, p.prior_weights))
    if np.all((fit.x >= problem.low) & (fit.x <= problem.high)):
        return dataclasses.replace(fit, problem=problem)
    return min((calibrate(problem), minimise(problem, fit.x)), key=lambda f: f.cost)


def noises_of(fit: Fit) -> Noises:
    """Return the correlated noise of each body that the data of a fit have; it is the same in all trials."""
    named = {name: noise for d in fit.problem.data for name, noise in d.correlated.items()}
    return {body: named[n] for body, names in BODIES.items() for n in names if n in named}


def with_noises(d: TrialData, noises: Noises) -> TrialData:
    """Return data with white noise alone as data with these correlated parts, of which the white one is made smaller."""
    sigma, correlated = d.sigma.copy(), {}
    for c in d.channels:
        noise = noises.get(_body_of(c.name))
        if noise is not None and len(c) > 1:
            correlated[c.name] = noise
            sigma[d.slices[c.name]] = noise.white_sigma(d.sigma[d.slices[c.name]], c.time_step)
    return dataclasses.replace(d, sigma=sigma, correlated=correlated)


def _white(d: TrialData) -> TrialData:
    return dataclasses.replace(d, correlated={})


def _without_correlated_noise(fit: Fit) -> Fit:
    """Return the fit with data whose noise counts as white."""
    return dataclasses.replace(fit, problem=fit.problem.with_data([_white(d) for d in fit.problem.data]))


def _body_of(channel: str) -> str:
    return next((body for body, names in BODIES.items() if channel in names), "")


def _noise(logs: Array) -> CorrelatedNoise:
    """Return noise from the logarithms of its amplitude and correlation time."""
    amplitude, correlation_time = np.exp(logs).tolist()
    return CorrelatedNoise(amplitude=amplitude, correlation_time=correlation_time)


@dataclass(frozen=True, kw_only=True)
class _Tracks:
    """All tracks of a body's coordinates, one after the other: a likelihood is evaluated thousands of times."""

    t: Array
    """Times of the points since the first of their track [s], shape (n,)."""
    sigma: Array
    """Standard deviation of the noise as if it were white, shape (n,); infinite: the point is left out."""
    steps: Array
    """Time between the points of their track [s], shape (n,)."""
    rows: Array
    """Residuals and their derivatives, in the units of the data, shape (n, 1 + p)."""

    def normal_matrix(self, noise: CorrelatedNoise | None) -> tuple[Array, float]:
        """Return the tracks' part of the normal matrix, shape (1 + p, 1 + p), and of the log determinant."""
        if noise is None:
            standardised = self.rows / self.sigma[:, None]
            log_determinant = 2 * float(np.sum(np.log(self.sigma[np.isfinite(self.sigma)])))
        else:
            whitening = Whitening(self.t, noise.white_sigma(self.sigma, self.steps), noise)
            standardised, log_determinant = whitening(self.rows), whitening.log_determinant
        return standardised.T @ standardised, log_determinant


def _joined(tracks: list[_Tracks]) -> _Tracks:
    return _Tracks(**{f.name: np.concatenate([getattr(part, f.name) for part in tracks]) for f in dataclasses.fields(_Tracks)})


class _Likelihood:
    """Restricted likelihood of a fit's residuals as a function of the correlated noise of each body."""

    def __init__(self, fit: Fit, white: list[TrialData]) -> None:
        # Residuals and derivatives in the units of the data
        bare = fit.problem.with_data([dataclasses.replace(d, sigma=np.where(np.isfinite(d.sigma), 1.0, np.inf)) for d in white])
        jacobian, residuals = jacobian_at(bare, fit.x), bare.residuals(fit.x)
        assert residuals is not None
        self._rows = np.column_stack([residuals, jacobian])
        n = bare.measured_rows
        self._prior = self._rows[n:].T @ self._rows[n:]
        self._rest = np.zeros_like(self._prior)
        """Part of the normal matrix that independent errors make: those of events, and of a point that is alone."""
        tracks: dict[str, list[_Tracks]] = {body: [] for body in BODIES}
        start = 0
        for d in white:
            independent = np.zeros(len(d.sigma), dtype=bool)
            independent[d.event_slice] = True
            for c in d.channels:
                part = d.slices[c.name]
                if len(c) > 1:
                    rows = self._rows[start + part.start : start + part.stop]
                    steps = np.full(len(c), c.time_step)
                    tracks[_body_of(c.name)].append(_Tracks(t=c.t - c.t[0], sigma=d.sigma[part], steps=steps, rows=rows))
                else:
                    independent[part] = True
            scaled = self._rows[start : start + len(d.sigma)][independent] / d.sigma[independent][:, None]
            self._rest += scaled.T @ scaled
            start += len(d.sigma)
        self._tracks = {body: _joined(parts) for body, parts in tracks.items() if parts}

    def estimate(
        self, start: Noises, penalty: Callable[[int], float] = lambda count: PARAMETERS * math.log(count)
    ) -> dict[str, CorrelatedNoise]:
        """Return the noise of each body that lowers -2 ln L by more than its penalty.

        Parameters
        ----------
        start
            What is known of it; empty: nothing.
        penalty
            Number of a body's values -> what they cost; by default by the Bayesian information criterion.
        """
        noises = dict(start)
        parts = {body: tracks.normal_matrix(noises.get(body)) for body, tracks in self._tracks.items()}
        # What is taken for the noise of one body depends on that of the other, which the model ties to it
        for _ in range(1 if start else PASSES):
            for body, tracks in self._tracks.items():
                sigma = tracks.sigma[np.isfinite(tracks.sigma)]
                if len(sigma) < 2 * MIN_DIFFERENCES:
                    continue
                before = noises.pop(body, None)
                parts[body] = tracks.normal_matrix(None)
                white_cost = self._cost(parts)
                noise, cost = self._best(body, parts, float(np.median(sigma)), before)
                if white_cost - cost > penalty(len(sigma)):
                    noises[body], parts[body] = noise, tracks.normal_matrix(noise)
        return self._with_shared(noises, parts)

    def _with_shared(
        self, noises: dict[str, CorrelatedNoise], parts: Mapping[str, tuple[Array, float]]
    ) -> dict[str, CorrelatedNoise]:
        """Give a mass without correlated noise that of the other one, if that makes the residuals more likely.

        It adds no number that is fitted, so that no criterion has to be paid.
        """
        for body, other in (("light", "heavy"), ("heavy", "light")):
            if other in noises and body not in noises and body in self._tracks:
                shared = {**parts, body: self._tracks[body].normal_matrix(noises[other])}
                if self._cost(shared) < self._cost(parts):
                    return noises | {body: noises[other]}
        return noises

    def _best(
        self, body: str, parts: Mapping[str, tuple[Array, float]], sigma: float, before: CorrelatedNoise | None
    ) -> tuple[CorrelatedNoise, float]:
        """Return the noise of one body that is most likely beside those of the others, and its cost.

        Parameters
        ----------
        sigma
            Typical standard deviation of the body's white noise.
        before
            Where the search begins; None: at the best of a grid.
        """
        tracks = self._tracks[body]
        shortest = MIN_CORRELATION_STEPS * float(tracks.steps.min())
        longest = max(2 * shortest, MAX_CORRELATION_SHARE * float(tracks.t.max()))  # each track begins at zero
        low, high = np.log([1e-2 * sigma, shortest]), np.log([1e4 * sigma, longest])

        def cost(logs: Array) -> float:
            return self._cost({**parts, body: tracks.normal_matrix(_noise(logs))})

        if before is None:
            grid = itertools.product(np.log(START_AMPLITUDES) + math.log(sigma), np.linspace(low[1], high[1], START_TIMES))
            start = min((np.array(logs) for logs in grid), key=cost)
        else:
            start = np.clip(np.log([before.amplitude, before.correlation_time]), low, high)
        inward = np.where(start + SIMPLEX_SIZE > high, -SIMPLEX_SIZE, SIMPLEX_SIZE)
        best = minimize(
            cost, start, method="Nelder-Mead", bounds=list(zip(low, high, strict=True)),
            options={
                "xatol": LOG_TOLERANCE, "fatol": COST_TOLERANCE,
                "initial_simplex": [start, start + [inward[0], 0.0], start + [0.0, inward[1]]],
            },
        )  # fmt: skip
        return _noise(best.x), float(best.fun)

    def _cost(self, parts: Mapping[str, tuple[Array, float]]) -> float:
        """Return -2 ln of the restricted likelihood but for a constant."""
        total = self._prior + self._rest + sum(matrix for matrix, _ in parts.values())
        normal, gradient = total[1:, 1:], total[0, 1:]
        unexplained = float(total[0, 0] - gradient @ np.linalg.lstsq(normal, gradient)[0])
        return unexplained + sum(log for _, log in parts.values()) + float(np.linalg.slogdet(normal)[1])
