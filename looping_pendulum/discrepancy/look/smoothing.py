"""Points that were smoothed or interpolated after they were tracked, distinguished from errors that last longer than a frame.

A smoothed point is a weighted sum of tracked ones, so that the motion is smoothed alike and errors of neighbours are one and
the same. Both are one linear map, of the prediction and of the white noise, and are judged by `evidence.fit` as all else.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from looping_pendulum.discrepancy.look.case import Case, Rows
from looping_pendulum.discrepancy.look.evidence import Fit, Smoothing, Taken, fit
from looping_pendulum.discrepancy.look.prior import WANDER_FRAMES, WANDERS, WHITE
from looping_pendulum.reference_ode.geometry import Array

WINDOWS, CUTOFFS, MADE_UP = (3, 5, 7, 9, 11, 15, 21), (6.0, 8.0, 10.0, 15.0, 20.0), (2, 3, 4, 8)
"""Rows that are averaged or fitted by a parabola; frequencies of a Butterworth filter [Hz]; rows of which one is new."""
MAX_ROWS, MIN_ROWS = 240, 20
"""Most rows that are looked at, as matrices of them are inverted, and fewest."""
KINDS_TRIED, QUICK_TURNS = 2, 2
"""How many of the smoothings that are likeliest after some steps are fitted to the end."""


def smoothing(case: Case, rows: Rows, start: Array) -> tuple[str, float, Fit] | None:
    """Return how points were smoothed, its gain over points as they were tracked, whose errors may last, and its fit."""
    whole = rows.part(np.asarray(rows.is_point.all(axis=1)))
    # A program smooths what it tracks in all frames, a spreadsheet the rows that are written
    over_frames, over_rows = _at_every_frame(rows), whole.part(slice(MAX_ROWS))
    same = len(over_frames.t) == len(over_rows.t)
    found = (_smoothed(case, each, start) for each in ((over_rows,) if same else (over_frames, over_rows)))
    return max(filter(None, found), key=lambda f: f[1], default=None)


def _smoothed(case: Case, rows: Rows, start: Array) -> tuple[str, float, Fit] | None:
    """Return the likeliest smoothing over such rows."""
    n = len(rows.t)
    half = min(10, n // 6)
    inner = half + np.flatnonzero(rows.is_point[half : n - half].all(axis=1))
    if len(inner) < MIN_ROWS:
        return None
    rows = replace(rows, at_rest=np.nanmedian(rows.sigma, axis=0) * np.ones((n, 1)), speed=np.zeros(rows.value.shape))
    apart, one = np.abs(np.subtract.outer(np.arange(n), np.arange(n))), np.eye(n)
    tracked = [("", one, one)]
    tracked += [("", one, one + size**2 * np.exp(-apart / frames)) for size in WANDERS for frames in WANDER_FRAMES]
    difference = np.diff(one, 4, axis=0) / math.sqrt(70)  # by which the noise of the points was estimated
    smoothed = []
    for text, weights in _kernels(n, rows.step):
        shared = weights @ weights.T
        seen = max(float(np.median(np.sum((difference @ shared) * difference, axis=1))), 1e-9)
        smoothed.append((text, weights, shared / seen + WHITE**2 * one))

    def best(hypotheses: list[tuple[str, Array, Array]]) -> tuple[Fit, str]:
        takens = []
        for text, weights, errors in hypotheses:
            root = np.linalg.inv(np.linalg.cholesky(errors[np.ix_(inner, inner)]))
            smooth = Smoothing(inner=inner, weights=weights[inner], root=root)
            taken = Taken.as_written(rows, used=np.ones(rows.value.shape, dtype=bool), smoothing=smooth)
            takens.append((fit(case, rows, taken, start=start, turns=QUICK_TURNS).log, text, taken))
        takens.sort(key=lambda t: -t[0])
        fits = [(fit(case, rows, taken, start=start), text) for _, text, taken in takens[:KINDS_TRIED]]
        return max(fits, key=lambda f: f[0].log)

    (own, _), (smooth, text) = best(tracked), best(smoothed)
    return (text, smooth.log - own.log, smooth) if math.isfinite(smooth.log) else None


def _at_every_frame(rows: Rows) -> Rows:
    """Return rows at every frame, `MAX_ROWS` at most, without points where the table has none."""
    number = np.rint((rows.t - rows.t[0]) / rows.step).astype(int)
    first = np.append(True, np.diff(number) > 0) & (number < MAX_ROWS)
    rows, number = rows.part(first), number[first]
    frames = np.arange(number[-1] + 1)

    def at_frames(values: Array) -> Array:
        filled = np.full((len(frames), len(rows.channels)), np.nan)
        filled[number] = values
        return filled

    t = np.interp(frames, number, rows.t)
    return replace(rows, t=t, value=at_frames(rows.value), at_rest=at_frames(rows.at_rest), speed=at_frames(rows.speed))


def _kernels(n: int, step: float) -> Iterator[tuple[str, Array]]:
    """Yield what may be done with points, in words, and their weights, shape (rows, rows)."""
    from scipy import signal

    k, one = np.arange(n), np.eye(n)
    for window in (w for w in WINDOWS if w < n / 2):
        near = np.abs(np.subtract.outer(k, k)) <= window // 2
        yield f"averaged over {window} frames", near / near.sum(axis=1, keepdims=True)
        if window > 3:
            yield f"smoothed by parabolas through {window} frames", signal.savgol_filter(one, window, 2, axis=0)
    for cutoff in (c for c in CUTOFFS if 2 * c * step < 0.9):
        yield f"filtered at {cutoff:g} Hz", signal.filtfilt(*signal.butter(2, 2 * cutoff * step), one, axis=0)
    for every in MADE_UP:
        for phase in range(every):
            before = (k - phase) // every * every + phase
            share, weights = (k - before) / every, np.zeros((n, n))
            weights[k, np.clip(before, 0, n - 1)] += 1 - share
            weights[k, np.clip(before + every, 0, n - 1)] += share
            yield f"interpolated: one frame of {every} shows a new picture", weights
