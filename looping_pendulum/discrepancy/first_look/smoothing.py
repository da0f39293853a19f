"""Tell points that were smoothed, filtered or interpolated after they were tracked, by the errors that they are left with.

A smoothed point is a weighted sum of tracked ones. So the motion is smoothed alike, and the errors of neighbours are one and
the same for a fixed number of rows, with hardly any white part, which the errors of no tracker are.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial, reduce

import numpy as np
from numpy.typing import NDArray

from looping_pendulum.discrepancy.first_look.evidence import MIN_ROWS, ErrorsOfRows, LinearEvidence, Points, fitted
from looping_pendulum.discrepancy.first_look.prior import LACKING, SMOOTHED_SHARE, WANDERS, WHITE
from looping_pendulum.discrepancy.fit.data import FRAMES, TrialData
from looping_pendulum.discrepancy.fit.problem import Problem
from looping_pendulum.measured.noise import ORDER
from looping_pendulum.reference_ode.geometry import Array

MAX_ROWS = 140
"""Largest number of rows that are compared."""
HALVES = (20, 10, 7, 4, 2)
"""Largest number of rows on each side over which is smoothed: the first that leaves half of the rows so far from any gap."""
WINDOWS = (3, 5, 7, 9, 11, 15, 21)
"""Rows over which is averaged, or to which a parabola is fitted."""
CUTOFFS, FILTER_ORDERS = (6.0, 10.0, 15.0, 20.0), (2, 4)
"""Frequencies above which a Butterworth filter that runs forth and back leaves little [Hz], and its orders."""
MADE_UP = (2, 3, 4, 8)
"""Rows of which one shows a picture, where those between are interpolated."""
ROUNDS = 2
"""Number of times that an account is chosen and fitted, each about the fit to the one before."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Account:
    """How the points of rows may be made of tracked ones."""

    text: str
    """What was done with these, in words; empty: nothing."""
    weights: Array
    """Weights of tracked points in the written ones, shape (rows, rows)."""
    errors: ErrorsOfRows
    log_share: float
    """Logarithm of the prior probability."""


@dataclass(frozen=True)
class Smoothing:
    """How points were smoothed before they were written."""

    text: str
    gain: float
    """Logarithm of how much more probable it is than points as they were tracked."""
    rows: int
    """Number of rows that were compared."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Judged:
    """An account with its fit."""

    account: Account
    evidence: LinearEvidence
    log: float
    """Logarithm of its probability, but for a constant that all accounts of the same rows share."""


def smoothing_of(problem: Problem, x: Array, length_per_unit: Mapping[str, float]) -> Smoothing | None:
    """Return how points were smoothed before they were written; None: they are as tracked.

    Parameters
    ----------
    problem
        Fit of the declared model to one trial.
    x
        Free values about which the model is linear.
    length_per_unit
        Unit of a channel -> length that it is worth [m].
    """
    data = _common_rows(problem.data[0])
    rows = min(2 * MAX_ROWS, len(data.channels[0]) if data.channels else 0)
    if rows < MIN_ROWS or not problem.free_parameters:
        return None
    whole = _rows(data, np.arange(rows))
    t = whole.channels[0].t
    has_gaps = np.ptp(np.diff(t)) > 0.5 * np.median(np.diff(t))
    found = []
    # Points may have been smoothed before rows were lost, or from each row that is left to the next
    for times in (t, np.arange(rows, dtype=float)) if has_gaps else (t,):
        half, inner = _inner_rows(times)
        if half:
            found.append(_smoothing_of_rows(problem, x, whole, half, inner, length_per_unit))
    return max(filter(None, found), key=lambda each: each.gain, default=None)


def _smoothing_of_rows(
    problem: Problem,
    x: Array,
    whole: TrialData,
    half: int,
    inner: NDArray[np.intp],
    length_per_unit: Mapping[str, float],
) -> Smoothing | None:
    """Return how the points of some inner rows were smoothed, over at most ``half`` rows on each side; None: they were not."""
    t = whole.channels[0].t
    rows = len(t)
    points, here = _rows(whole, inner), problem.with_data([whole])
    prior = np.array([n.prior_sigma for n in problem.free_parameters])

    @lru_cache(maxsize=2)
    def of_rows(x: bytes) -> tuple[list[Array], ...]:
        both = here.predict_with_derivatives(np.frombuffer(x), 0)
        return tuple([each[part] for part in whole.slices.values()] for each in both)

    def predicted(account: Account, x: Array) -> tuple[Array, Array]:
        weights = account.weights[inner]
        shown, slopes = (np.concatenate([weights @ of_channel for of_channel in each]) for each in of_rows(x.tobytes()))
        return shown, slopes

    def best_of(accounts: Sequence[Account]) -> Judged:
        of_accounts = [Points.of(points, length_per_unit, account.errors) for account in accounts]
        judged = []
        for at in (x, np.zeros_like(x)):
            for _ in range(ROUNDS):
                logs = [
                    account.log_share + of_account.linear(*predicted(account, at), -at, prior).log
                    for account, of_account in zip(accounts, of_accounts, strict=True)
                ]
                best = int(np.argmax(logs))
                account = accounts[best]
                at, found = fitted(problem, partial(predicted, account), of_accounts[best], at)
                judged.append(Judged(account=account, evidence=found, log=account.log_share + found.log))
        return max(judged, key=lambda j: j.log)

    as_tracked = best_of(list(_as_tracked(rows)))
    smoothed = best_of(list(_smoothed(rows, half, float(np.median(np.diff(t))), inner, as_tracked.account.errors)))
    # Where an effect is missing besides, its motion may look smoothed
    if smoothed.log <= as_tracked.log or smoothed.evidence.lacking > LACKING[0]:
        return None
    return Smoothing(text=smoothed.account.text, gain=smoothed.log - as_tracked.log, rows=len(inner))


def _common_rows(data: TrialData) -> TrialData:
    """Return the data with the rows alone in which all points were tracked."""
    channels = [c for c in data.channels if c.unit == "m"]
    times = reduce(np.intersect1d, [c.t for c in channels]) if channels else np.zeros(0)
    kept = [np.isin(c.t, times) for c in channels]
    sigma = [data.sigma[data.slices[c.name]][k] for c, k in zip(channels, kept, strict=True)]
    common = tuple(dataclasses.replace(c, t=c.t[k], value=c.value[k]) for c, k in zip(channels, kept, strict=True))
    # Fourth differences of a mass that moves fast show its motion, too
    least = min((float(s.min()) for s in sigma if len(s)), default=0.0)
    return TrialData(trial=data.trial, channels=common, sigma=np.full(sum(map(len, sigma)), least))


def _rows(data: TrialData, rows: NDArray[np.intp]) -> TrialData:
    channels = tuple(dataclasses.replace(c, t=c.t[rows], value=c.value[rows]) for c in data.channels)
    sigma = np.concatenate([data.sigma[data.slices[c.name]][rows] for c in data.channels])
    return TrialData(trial=data.trial, channels=channels, sigma=sigma)


def _inner_rows(t: Array) -> tuple[int, NDArray[np.intp]]:
    """Return the largest number of rows on each side over which is smoothed, and the rows so far from any that is missing."""
    step, k = np.diff(t), np.arange(len(t))
    ends = np.concatenate([[0], 1 + np.flatnonzero(step > 1.5 * np.median(step)), [len(t)]])
    run = np.searchsorted(ends, k, side="right")
    away = np.minimum(k - ends[run - 1], ends[run] - 1 - k) + 1
    half = next((h for h in HALVES if np.sum(away > h) >= max(MIN_ROWS, len(t) / 2)), 0)
    return half, np.flatnonzero(away > half)[:MAX_ROWS]


def _as_tracked(rows: int) -> Iterator[Account]:
    """Yield white errors, and those of trackers that wander."""
    errors = [ErrorsOfRows(("white",), lambda sigma: np.diag(sigma**2))]
    errors += [_wandering(size, frames) for size in WANDERS for frames in FRAMES]
    for each in errors:
        yield Account(text="", weights=np.eye(rows), errors=each, log_share=math.log((1 - SMOOTHED_SHARE) / len(errors)))


def _wandering(size: float, frames: float) -> ErrorsOfRows:
    def covariance(sigma: Array) -> Array:
        apart = np.abs(np.subtract.outer(np.arange(len(sigma)), np.arange(len(sigma))))
        return np.asarray(np.diag(sigma**2) + size**2 * np.outer(sigma, sigma) * np.exp(-apart / frames))

    return ErrorsOfRows(("wandering", size, frames), covariance)


def _smoothed(rows: int, half: int, step: float, inner: NDArray[np.intp], later: ErrorsOfRows) -> Iterator[Account]:
    kernels = list(_kernels(rows, half, step))
    # Fourth differences, by which the noise was estimated
    difference = np.diff(np.eye(rows), ORDER, axis=0)
    difference /= np.linalg.norm(difference[0])
    for number, (text, weights) in enumerate(kernels):
        shared = weights @ weights.T
        seen = max(float(np.median(np.sum((difference @ shared) * difference, axis=1))), 1e-9)
        of_rows = shared[np.ix_(inner, inner)] / seen

        def covariance(sigma: Array, of_rows: Array = of_rows) -> Array:
            return np.asarray(np.outer(sigma, sigma) * of_rows + np.diag((WHITE * sigma) ** 2))

        # Further errors may have come later
        for errors in (ErrorsOfRows((text, number, rows, half, step), covariance), later):
            yield Account(text=text, weights=weights, errors=errors, log_share=math.log(SMOOTHED_SHARE / 2 / len(kernels)))


def _kernels(rows: int, half: int, step: float) -> Iterator[tuple[str, Array]]:
    """Yield what may be done with points, in words, and their weights, shape (rows, rows)."""
    from scipy import signal  # takes a quarter of a second with scipy.stats, and few studies come here

    one, k = np.eye(rows), np.arange(rows)
    for window in (w for w in WINDOWS if w <= 2 * half + 1):
        average = np.sum([np.eye(rows, k=n - window // 2) for n in range(window)], axis=0) / window
        yield f"averaged over {window} frames", average
        if window > 3:
            yield f"smoothed by parabolas through {window} frames", signal.savgol_filter(one, window, 2, axis=0)
    for cutoff in (c for c in CUTOFFS if 2 * c * step < 0.9):
        for order in FILTER_ORDERS:
            weights = signal.filtfilt(*signal.butter(order, 2 * cutoff * step), one, axis=0)
            window = round(1 / float(np.sum(weights[rows // 2] ** 2)))
            if window <= 2 * half + 1:
                yield f"filtered at {cutoff:g} Hz, which is over some {window} frames", weights
    for every in MADE_UP:
        for phase in range(every):
            before = (k - phase) // every * every + phase
            share = (k - before) / every
            weights = np.zeros((rows, rows))
            weights[k, np.clip(before, 0, rows - 1)] += 1 - share
            weights[k, np.clip(before + every, 0, rows - 1)] += share
            yield f"interpolated: one frame of {every} shows a new picture", weights
