"""Marginal likelihood of a model that is linear in its parameters, the noise marginalised over a grid.

Columns are the residuals, their derivatives by the fitted parameters, and templates of what could be added, in the units of the
data. Each body's part of their Gram matrix is computed for white noise and for Ornstein-Uhlenbeck processes beside it; the
parts of the bodies add, so that every pair of settings costs one sum. All that follows are Schur complements.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from looping_pendulum.discrepancy.evidence.prior import AMPLITUDES, P_LASTING
from looping_pendulum.discrepancy.fit.calibration import MAX_DECREASE
from looping_pendulum.discrepancy.fit.data import FRAMES, CorrelatedNoise, TrialData
from looping_pendulum.measured.observations import BODIES
from looping_pendulum.reference_ode.geometry import Array

SETTINGS = (None, *itertools.product(AMPLITUDES, FRAMES))
"""Noise of one body: white, or with an amplitude and a correlation time."""
MIN_POINTS = 20
"""Points of a body below which its noise counts as white."""


class NoiseGrid:
    """All settings of the noise of a study's data, which have white noise.

    Columns that it takes have one row for each value of ``data``, in the units of the data; those of values that are left out
    count for nothing.
    """

    def __init__(self, data: Sequence[TrialData]) -> None:
        self.data = tuple(data)
        self._edges = np.cumsum([0] + [len(d.t) for d in data]).tolist()
        self.count = int(self._edges[-1])
        self._rows: dict[str, NDArray[np.bool_]] = {}
        """Body -> which values are its points, of those whose noise may be correlated."""
        self._noises: dict[str, list[CorrelatedNoise | None]] = {}
        """Body -> its noise by each of `SETTINGS`."""
        sigma = np.concatenate([d.sigma for d in data])
        for body, names in BODIES.items():
            rows, steps = np.zeros(self.count, dtype=bool), np.zeros(self.count)
            for d, start in zip(data, self._edges, strict=False):
                for c in d.channels:
                    if c.name in names and len(c) > 1:
                        part = slice(start + d.slices[c.name].start, start + d.slices[c.name].stop)
                        rows[part], steps[part] = True, c.time_step
            if rows.sum() >= MIN_POINTS:
                known = sigma[rows & np.isfinite(sigma)]
                typical, step = float(np.median(known)) if len(known) else 1.0, float(np.median(steps[rows]))
                self._rows[body] = rows
                self._noises[body] = [
                    s and CorrelatedNoise(amplitude=s[0] * typical, correlation_time=s[1] * step) for s in SETTINGS
                ]
        self.combinations = list(itertools.product(range(len(SETTINGS)), repeat=len(self._rows)))
        """Indices into `SETTINGS` of every body, white for all first."""
        n = len(self.combinations)
        self.log_prior = np.log(np.array([1 - P_LASTING, *(P_LASTING / max(n - 1, 1) for _ in range(n - 1))]))

    @cached_property
    def log_determinant(self) -> Array:
        """Log determinants of the noise's covariance, shape (combinations,)."""
        white = sum(d.log_determinant for d in self.data)
        beyond = {
            body: [sum(d.log_determinant for d in self._data[body, i]) - white for i in range(len(SETTINGS))]
            for body in self._rows
        }
        return np.array([white + sum(beyond[body][i] for body, i in zip(beyond, c, strict=True)) for c in self.combinations])

    @cached_property
    def _data(self) -> dict[tuple[str, int], tuple[TrialData, ...]]:
        """Body and index into `SETTINGS` -> the data with this noise of the body."""
        return {
            (body, i): tuple(d.with_noises({body: noise} if noise else {}) for d in self.data)
            for body, noises in self._noises.items()
            for i, noise in enumerate(noises)
        }

    def _gram(self, data: Sequence[TrialData], columns: Array, rows: NDArray[np.bool_]) -> Array:
        """Return the Gram matrix of some rows of columns, standardised by the noise of the data, shape (m, m)."""
        parts = zip(data, itertools.pairwise(self._edges), strict=True)
        standardised = np.concatenate([d.standardise(columns[begin:end]) for d, (begin, end) in parts])[rows]
        return np.asarray(standardised.T @ standardised)

    def grams(self, columns: Array, settings: Sequence[int]) -> Array:
        """Return the Gram matrices of standardised columns, shape (settings, m, m).

        Parameters
        ----------
        columns
            Shape (n, m).
        settings
            Indices into `combinations`.
        """
        rest = ~np.any([np.zeros(self.count, dtype=bool), *self._rows.values()], axis=0)
        found = np.tile(self._gram(self.data, columns, rest), (len(settings), 1, 1))
        for place, (body, rows) in enumerate(self._rows.items()):
            own = [self.combinations[s][place] for s in settings]
            by_setting = {i: self._gram(self._data[body, i], columns, rows) for i in set(own)}
            found += np.array([by_setting[i] for i in own])
        return found

    def noises(self, setting: int) -> dict[str, CorrelatedNoise]:
        """Return body -> correlated noise of one of `combinations`; bodies with white noise are left out."""
        pairs = zip(self._noises.items(), self.combinations[setting], strict=True)
        return {body: noise for (body, noises), i in pairs if (noise := noises[i])}


class Marginal:
    """Evidence of models whose columns are among those given.

    Parameters
    ----------
    grid
        Settings of the noise.
    fitted
        Residuals and their derivatives by the fitted parameters, shape (n + p, 1 + p); the last p rows are those of the prior.
    templates
        Shape (n, m).
    at_bounds
        Fitted parameters, by their index, that are on a bound: other noise does not move them.
    settings
        Settings that are looked at; None: all.
    """

    def __init__(
        self, grid: NoiseGrid, fitted: Array, templates: Array | None = None, at_bounds: Sequence[int] = (),
        settings: Sequence[int] | None = None,
    ) -> None:  # fmt: skip
        n, self.p = grid.count, fitted.shape[1] - 1
        self.settings = np.arange(len(grid.combinations)) if settings is None else np.asarray(settings)
        columns = fitted[:n] if templates is None else np.hstack([fitted[:n], templates])
        self.gram = grid.grams(np.nan_to_num(columns), self.settings.tolist())
        prior = fitted[n:]
        self.gram[:, : 1 + self.p, : 1 + self.p] += prior.T @ prior
        self._log_prior_precision = 2 * float(np.linalg.slogdet(prior[:, 1:])[1])
        self._free = np.array([i for i in range(self.p) if i not in at_bounds], dtype=int)
        self._log_determinant, self.log_prior = grid.log_determinant[self.settings], grid.log_prior[self.settings]

    @cached_property
    def _factors(self) -> tuple[Array, Array]:
        """Return the inverses of the free parameters' normal matrices, and the Schur complements of all other columns."""
        free, others = 1 + self._free, np.r_[0, 1 + self.p : self.gram.shape[1]]
        cross = self.gram[:, free[:, None], others]
        inverse = np.asarray(np.linalg.inv(self.gram[:, free[:, None], free]), dtype=np.float64)
        return inverse, self.gram[:, others[:, None], others] - np.swapaxes(cross, 1, 2) @ (inverse @ cross)

    @property
    def complement(self) -> Array:
        """Gram matrices of residuals and templates beyond what the fitted parameters can do, shape (settings, 1 + m, 1 + m)."""
        return self._factors[1]

    @cached_property
    def log_z_of_settings(self) -> Array:
        """Log evidence without any template, for every setting, prior of the setting included, shape (settings,)."""
        fitted = slice(1, 1 + self.p)
        square = self.complement[:, 0, 0].copy()  # after the step that is left to the minimum by this noise
        white = self.settings == 0
        # By white noise it is the fit's own, which leaves a large one only where the model is far from linear
        square[white] = np.maximum(square[white], self.gram[white, 0, 0] - MAX_DECREASE)
        log_normal = np.linalg.slogdet(self.gram[:, fitted, fitted])[1]
        return np.asarray(self.log_prior - 0.5 * (square + self._log_determinant + log_normal - self._log_prior_precision))

    @property
    def log_z(self) -> float:
        """Log evidence without any template."""
        return float(np.logaddexp.reduce(self.log_z_of_settings))

    def shift(self) -> tuple[Array, Array]:
        """Return the step of the fitted parameters and their variances by each setting's noise, shape (settings, p)."""
        step = np.zeros((len(self.gram), self.p))
        step[:, self._free] = np.einsum("gij,gj->gi", self._factors[0], self.gram[:, 1 + self._free, 0])
        fitted = slice(1, 1 + self.p)
        # Also of what is on a bound, as the evidence has the volume of all
        inverse = self._factors[0] if len(self._free) == self.p else np.linalg.inv(self.gram[:, fitted, fitted])
        return step, np.einsum("gii->gi", inverse).copy()

    def step(self, chosen: Sequence[int]) -> Array:
        """Return the step of the fitted parameters that fits best beside some templates, by the first setting, shape (p,)."""
        index = np.array([*(1 + self._free), *(1 + self.p + t for t in chosen)])
        step = np.zeros(self.p)
        step[self._free] = np.linalg.lstsq(self.gram[0][np.ix_(index, index)], self.gram[0][index, 0], rcond=None)[0][
            : len(self._free)
        ]
        return step

    def decrease(self, chosen: Sequence[int]) -> float:
        """Return by how much the cost decreases with templates, by the first setting."""
        index = [1 + t for t in chosen]
        s = self.complement[0]
        return float(s[0, index] @ np.linalg.lstsq(s[np.ix_(index, index)], s[0, index], rcond=None)[0])


def sigma_of(data: Sequence[TrialData]) -> Array:
    """Return the standard deviation of every value's white noise, shape (n,); 0: it is left out."""
    return np.concatenate([np.where(np.isfinite(d.sigma), d.sigma, 0.0) for d in data])
