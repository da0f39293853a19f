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

from looping_pendulum.discrepancy.evidence.prior import AMPLITUDES, P_LASTING
from looping_pendulum.discrepancy.fit.calibration import MAX_DECREASE
from looping_pendulum.discrepancy.fit.data import FRAMES, CorrelatedNoise, TrialData, Whitening
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
        edges = np.cumsum([0] + [len(d.t) for d in data])
        self.count = int(edges[-1])
        self._sigma = sigma = np.concatenate([d.sigma for d in data])
        log_white = float(2 * np.sum(np.log(sigma[np.isfinite(sigma)])))
        self._tracks: dict[str, _Tracks] = {}
        for body, names in BODIES.items():
            found = [(k, c) for k, d in enumerate(data) for c in d.channels if c.name in names and len(c) > 1]
            rows = [np.arange(self.count)[edges[k] : edges[k + 1]][data[k].slices[c.name]] for k, c in found]
            if found and sum(map(len, rows)) >= MIN_POINTS:
                t = np.concatenate([c.t - c.t[0] for _, c in found])
                steps = np.concatenate([np.full(len(c), c.time_step) for _, c in found])
                self._tracks[body] = _Tracks(t, sigma[np.concatenate(rows)], steps, np.concatenate(rows))
        of_tracks = np.concatenate([np.zeros(0, dtype=int), *(t.rows for t in self._tracks.values())]).astype(int)
        rest = np.ones(self.count, dtype=bool)
        rest[of_tracks] = False
        self._rest = rest
        self.combinations = list(itertools.product(range(len(SETTINGS)), repeat=len(self._tracks)))
        """Indices into `SETTINGS` of every body, white for all first."""
        n = len(self.combinations)
        self.log_prior = np.log(np.array([1 - P_LASTING, *(P_LASTING / max(n - 1, 1) for _ in range(n - 1))]))
        self.log_determinant = np.array(
            [
                log_white + sum(t.log_determinant(i) for t, i in zip(self._tracks.values(), c, strict=True))
                for c in self.combinations
            ]
        )

    def grams(self, columns: Array, settings: Sequence[int]) -> Array:
        """Return the Gram matrices of standardised columns, shape (settings, m, m).

        Parameters
        ----------
        columns
            Shape (n, m).
        settings
            Indices into `combinations`.
        """
        part = columns[self._rest] / self._sigma[self._rest, None]
        fixed = part.T @ part
        found = np.tile(fixed, (len(settings), 1, 1))
        for place, tracks in enumerate(self._tracks.values()):
            own = [self.combinations[s][place] for s in settings]
            used, places = np.unique(own, return_inverse=True)
            found += tracks.grams(columns, used.tolist())[places]
        return found

    def noises(self, setting: int) -> dict[str, CorrelatedNoise]:
        """Return body -> correlated noise of one of `combinations`; bodies with white noise are left out."""
        pairs = zip(self._tracks.items(), self.combinations[setting], strict=True)
        return {body: noise for (body, tracks), i in pairs if (noise := tracks.noise(i))}


class _Tracks:
    """All tracks of a body's coordinates, one after the other."""

    def __init__(self, t: Array, sigma: Array, steps: Array, rows: Array) -> None:
        self._t, self._sigma, self._steps, self.rows = t, sigma, steps, rows
        self._typical = float(np.median(sigma[np.isfinite(sigma)])) if np.isfinite(sigma).any() else 1.0
        self._known: dict[int, Whitening] = {}

    def noise(self, i: int) -> CorrelatedNoise | None:
        """Return the correlated noise of a setting."""
        setting = SETTINGS[i]
        if setting is None:
            return None
        return CorrelatedNoise(
            amplitude=setting[0] * self._typical, correlation_time=setting[1] * float(np.median(self._steps))
        )

    def _whitening(self, i: int) -> Whitening:
        if i not in self._known:
            noise = self.noise(i)
            assert noise is not None
            self._known[i] = Whitening(self._t, noise.white_sigma(self._sigma, self._steps), noise)
        return self._known[i]

    def log_determinant(self, i: int) -> float:
        """Return the log determinant of the noise of a setting less that of white noise."""
        if i == 0:
            return 0.0
        return self._whitening(i).log_determinant - float(2 * np.sum(np.log(self._sigma[np.isfinite(self._sigma)])))

    def grams(self, columns: Array, settings: Sequence[int]) -> Array:
        """Return the Gram matrices of the body's rows of columns, standardised by settings, shape (settings, m, m)."""
        own = np.asfortranarray(columns[self.rows])  # as the filters want them
        standardised = (own / self._sigma[:, None] if i == 0 else self._whitening(i)(own) for i in settings)
        return np.array([rows.T @ rows for rows in standardised])


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

    def solution(self, chosen: Sequence[int]) -> tuple[Array, Array]:
        """Return the step of the fitted parameters, and the amounts of templates, that fit best by the first setting."""
        index = np.array([*(1 + self._free), *(1 + self.p + t for t in chosen)])
        found = np.linalg.lstsq(self.gram[0][np.ix_(index, index)], self.gram[0][index, 0], rcond=None)[0]
        step = np.zeros(self.p)
        step[self._free] = found[: len(self._free)]
        return step, found[len(self._free) :]

    def decrease(self, chosen: Sequence[int]) -> float:
        """Return by how much the cost decreases with templates, by the first setting."""
        index = [1 + t for t in chosen]
        s = self.complement[0]
        return float(s[0, index] @ np.linalg.lstsq(s[np.ix_(index, index)], s[0, index], rcond=None)[0])


def sigma_of(data: Sequence[TrialData]) -> Array:
    """Return the standard deviation of every value's white noise, shape (n,); 0: it is left out."""
    return np.concatenate([np.where(np.isfinite(d.sigma), d.sigma, 0.0) for d in data])
