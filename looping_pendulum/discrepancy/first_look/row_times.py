"""Find rows of a table that show other times than they say: whole rows, and columns that stand in other rows than the rest.

Two masses have three or four coordinates and one time. At the time of a row that its points show, the masses must be on the
model's way; an effect that the model lacks leads them off it, as it does not displace both masses by one and the same time.
Columns that are shifted by rows are found by the length of the string.
"""

from __future__ import annotations

import contextlib
import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from looping_pendulum.discrepancy.first_look.misfit import CANNOT_RUN, DeclaredTrial, measured_distance
from looping_pendulum.discrepancy.fit.calibration import minimise
from looping_pendulum.discrepancy.fit.data import TrialData
from looping_pendulum.discrepancy.fit.problem import Problem
from looping_pendulum.measured.camera import Camera
from looping_pendulum.measured.displaced_rows import RATE_FACTORS, WrongTimes
from looping_pendulum.measured.noise import scatter
from looping_pendulum.measured.observations import Channel
from looping_pendulum.reference_ode.geometry import Array, string_coordinates
from looping_pendulum.reference_ode.parameters import Parameters

MIN_COORDINATES, MIN_ROWS = 3, 12
"""Smallest numbers of coordinates and of rows of a film that is looked at."""
MIN_STEP = 1 / 130
"""Shortest time from row to row [s]: with more rows a second their neighbours show what is wrong, in less time."""
SUBSTEPS = 8
"""Times of the model that are compared, for each step from row to row."""
REACH = 4
"""Largest difference between the displacements of two rows in turn [steps]."""
STAYS = 0.1
"""Cost of such a difference [variances of the noise for one step], so that rows in which nothing moves stay where they are."""
ROUNDS, MIN_FALL = 6, 0.05
"""Largest number of times that the rows' times and the model's values are found, one after the other, and smallest fall of the
distance from the way, in itself, with which they are found again."""
MAX_OFF = 3.0
"""Largest mean square distance from the model's way, in variances of the noise, at which its times count."""
MIN_ERROR = 0.02
"""Smallest error of a row's displacement that counts, as the model is not exact [steps]."""
HALVES, HALF_TIMES = (2, 4), (0.025, 0.05)
"""Rows, and times [s], on each side of one from which on the others are displaced."""
MIN_JUMP, MIN_JUMP_SIGMAS = 0.6, 6.0
"""Smallest displacement by lost pictures [steps], and in standard errors.

Of 312 blind trials with right times, at 30 and 80 rows a second and most of them with an effect, none is named.
"""
MIN_BESIDE, MAX_BESIDE = 0.15, 1.5
"""Smallest and largest displacement of a single row [steps]."""
MAX_REST = 4.0
"""Largest mean square distance from the way with which it is one: a tracker that slips goes another way than the masses, and
with one of them alone."""
MAX_SIGMAS, MIN_UNEVEN_RATIO = 4.0, 2.2
"""Largest displacement of a row that counts [standard errors], and smallest mean square at which all of them are uneven."""
BEND_HALF = 8
"""Rows on each side of one from which on a row lasts longer or shorter."""
MIN_BEND, MIN_BEND_SIGMAS = 0.3, 15.0
"""Smallest change of a row's duration [steps], and in standard errors."""
MAX_FACTOR_ERROR = 0.2
"""Largest difference between the ratio of two durations and one of `RATE_FACTORS`, in the latter."""
MAX_FOUND = 12
"""Largest number of places that are looked for."""
MIN_COMPARED_ROWS = 12
"""Smallest number of rows in which the string's two ends are compared."""
MAX_SHIFT = 20
"""Largest number of rows by which columns may be shifted that is looked for."""
MIN_ROWS_A_SHIFT = 4
"""Smallest number of rows in a table for each row by which columns may be shifted: enough must remain that are compared."""
MIN_SHIFT_RATIOS = {"heavy": 1.5, "light_x": 4.0, "light_y": 4.0}
"""Columns -> smallest ratio of the mean squares before and after rows are put right at which shifted ones are named.

A single column of the light mass in other rows makes no string at all; errors of the picture do so a little. Of 312 blind
trials with rows as they are, two exceed it, of a push out of the picture's plane. At 240 frames a second and 1.8 mm of noise, a
shift by two rows gives 2 to 2.5, and one by one row 1.3 to 1.7, which is no more than its noise.
"""
CLEAR_SHIFT_RATIO = 4.0
"""The same for a trial in which nothing else looks wrong, as the clock's offset may hide a shift."""
MAX_STRING_SIGMAS = 4.0
"""Largest difference of the string's two ends in one row that counts [standard deviations of the noise]."""
MAX_PICTURE_ERROR = 0.05
"""Usual error of a picture's scale, turn and, in free lengths, place."""


def wrong_times(starts: Sequence[tuple[Problem, Array]]) -> list[list[WrongTimes]]:
    """Return from where on rows were taken at other times than they say, by the way of the masses; the likeliest account first.

    Parameters
    ----------
    starts
        Problems of one trial and numbers of their free parameters with which to begin; each leads to an account of its own.
    """
    data = starts[0][0].data[0]
    rows = np.unique(np.concatenate([np.zeros(0), *(c.t for c in data.channels)]))
    in_space = len(data.channels) >= MIN_COORDINATES and all(c.unit == "m" for c in data.channels)
    if not in_space or len(rows) < MIN_ROWS or np.median(np.diff(rows)) < MIN_STEP:
        return []
    by_start = []
    for problem, x in starts:
        with contextlib.suppress(*CANNOT_RUN):
            by_start.append(_late_rows(problem, rows, x))
    time_error = max(c.time_error for c in data.channels)
    return [_breaks(rows, late, time_error) for late in sorted(by_start, key=lambda late: late.off) if late.off <= MAX_OFF]


@dataclass(frozen=True, kw_only=True, eq=False)
class _LateRows:
    """By how much later each row was taken than its file says, shape (n,)."""

    value: Array
    """[s]."""
    error: Array
    """Standard errors [s]; infinite where nothing moves."""
    rest: Array
    """Mean square distance from the model's way then, in variances of the noise."""

    @property
    def off(self) -> float:
        """Return that of all rows together."""
        return float(np.mean(self.rest))


def _late_rows(problem: Problem, rows: Array, x: Array) -> _LateRows:
    """Return by how much later rows were taken, by the model whose values are fitted to the way alone."""
    data = problem.data[0]
    late = _displaced_along(problem, rows, x, np.zeros_like(rows))
    before = math.inf
    for _ in range(ROUNDS):
        if late.off > (1 - MIN_FALL) * before:
            break
        before = late.off
        # In the order of the file, as a fit needs it
        t = np.maximum.accumulate(rows + late.value) + 1e-9 * np.arange(len(rows))
        channels = tuple(dataclasses.replace(c, t=t[np.searchsorted(rows, c.t)]) for c in data.channels)
        moved = problem.with_data([dataclasses.replace(data, channels=channels)])
        x = minimise(moved, x, cost_tolerance=1e-3, max_iterations=2).x
        late = _displaced_along(problem, rows, x, late.value)
    return late


def _displaced_along(problem: Problem, rows: Array, x: Array, before: Array) -> _LateRows:
    """Return by how much later rows were taken, by the model with these values."""
    data, step = problem.data[0], float(np.median(np.diff(rows)))
    beyond = float(np.abs(before).max()) + (REACH + 2) * step
    t = np.arange(rows[0] - beyond, rows[-1] + beyond, step / SUBSTEPS)
    dense = tuple(dataclasses.replace(c, t=t, value=np.zeros_like(t)) for c in data.channels)
    there = TrialData(trial=data.trial, channels=dense, sigma=np.ones(len(t) * len(dense)))
    shown = problem.with_data([there]).predict(x, 0).reshape(len(dense), len(t))
    points = np.full((len(dense), len(rows)), np.nan)
    for i, c in enumerate(data.channels):
        noise = max(scatter(c), c.last_digit)
        points[i, np.searchsorted(rows, c.t)] = np.where(np.isfinite(data.sigma[data.slices[c.name]]), c.value / noise, np.nan)
        shown[i] /= noise
    velocity = np.asarray(np.gradient(shown, t, axis=1))
    known = np.isfinite(points)
    value, rest, last = np.zeros_like(rows), np.zeros_like(rows), 0.0
    error = np.full(len(rows), np.inf)
    for n, row in enumerate(rows.tolist()):
        low, high = (int(np.searchsorted(t, row + last + reach)) for reach in (-REACH * step, REACH * step))
        beside = np.asarray(points[:, n, None] - shown[:, low:high])[known[:, n]]
        cost = np.einsum("ct,ct->t", beside, beside) + STAYS * ((t[low:high] - row - last) / step) ** 2
        at = int(np.argmin(cost))
        v = velocity[known[:, n], low + at]
        square = float(v @ v)
        further = float(np.clip(v @ beside[:, at] / (square + STAYS / step**2), -step / SUBSTEPS, step / SUBSTEPS))
        value[n] = last = t[low + at] + further - row
        if known[:, n].sum() >= MIN_COORDINATES and square:
            error[n] = 1 / np.sqrt(square)
        rest[n] = float(np.sum((beside[:, at] - v * further) ** 2)) / max(int(known[:, n].sum()) - 1, 1)
    return _LateRows(value=value, error=error, rest=rest)


def _breaks(rows: Array, late: _LateRows, time_error: float) -> list[WrongTimes]:
    """Return from where on all rows are displaced, or last longer or shorter, the clearest first."""
    step = float(np.median(np.diff(rows)))
    # The way off the model's shows the noise: with few rows a second, that of the points themselves contains their motion
    noise = math.sqrt(late.off) * late.error
    value, error = late.value / step, np.hypot(np.hypot(noise, time_error) / step, MIN_ERROR)
    # A recorder's times are uneven, beside what the points' noise does
    bends = np.abs(np.diff(value, 2)) / np.sqrt(error[:-2] ** 2 + 4 * error[1:-1] ** 2 + error[2:] ** 2)
    weight = 1 / (error * max(1.0, float(np.median(bends)) / 0.67))
    halves = sorted({*HALVES, *(max(HALVES[0], round(time / step)) for time in HALF_TIMES)})
    found: list[WrongTimes] = []
    while len(found) < MAX_FOUND:  # from where on all are displaced
        bend, sigmas = _broken_lines(rows / step, value, weight, BEND_HALF, bent=True)
        k = int(np.argmax(np.where(np.abs(bend[0]) > MIN_BEND, sigmas, 0.0)))
        if sigmas[k] > MIN_BEND_SIGMAS and abs(bend[0, k]) > MIN_BEND:
            ratio = (1 + bend[1, k] + bend[0, k]) / (1 + bend[1, k])
            factor = min(RATE_FACTORS, key=lambda f: abs(ratio / f - 1))
            if abs(ratio / factor - 1) > MAX_FACTOR_ERROR:
                break
            found.append(WrongTimes(t=float(rows[k]), factor=factor))
            value = value - bend[0, k] * np.maximum(rows - rows[k], 0) / step
            continue
        best = (0.0, 0, 0.0)
        for half in halves:
            jump, sigmas = _broken_lines(rows / step, value, weight, half, bent=False)
            k = int(np.argmax(np.where(jump[0] > MIN_JUMP, sigmas, 0.0)))
            best = max(best, (float(sigmas[k]), k, float(jump[0, k])))
        sigma, k, size = best
        if sigma < MIN_JUMP_SIGMAS or size < MIN_JUMP:
            break
        found.append(WrongTimes(t=float(rows[k]), shift=round(size) * step))
        value = value - round(size) * (np.arange(len(rows)) >= k)
    # Rows beside such a place, which is known to a row or two, are no single ones
    return sorted(found, key=lambda each: each.t) or _single_rows(rows, late, value, error)


def _single_rows(rows: Array, late: _LateRows, value: Array, error: Array) -> list[WrongTimes]:
    """Return rows that are displaced beside their neighbours; the first one stands for all if all are, a little each.

    Parameters
    ----------
    value, error
        Displacements and their errors, without those from somewhere on [steps].
    """
    step = float(np.median(np.diff(rows)))
    share = (rows[1:-1] - rows[:-2]) / (rows[2:] - rows[:-2])

    def beside_neighbours() -> Array:
        return np.asarray(value[1:-1] - (1 - share) * value[:-2] - share * value[2:])

    value, singles = value.copy(), list[WrongTimes]()
    # A row whose way crosses that of another time tells nothing, nor do its neighbours
    error = np.where(np.abs(np.pad(beside_neighbours(), 1)) < MAX_BESIDE, error, np.inf)
    error = np.sqrt(error[1:-1] ** 2 + ((1 - share) * error[:-2]) ** 2 + (share * error[2:]) ** 2)
    while True:
        beside = beside_neighbours()
        usual = (np.abs(beside) > MIN_BESIDE) & (late.rest[1:-1] < MAX_REST)
        sigmas = np.where(usual, np.abs(beside) / error, 0.0)
        k = int(np.argmax(sigmas))
        if sigmas[k] < MIN_JUMP_SIGMAS or len(singles) == MAX_FOUND:
            break
        singles.append(WrongTimes(t=float(rows[k + 1]), shift=float(beside[k]) * step, onward=False))
        value[k + 1] -= beside[k]
    known = np.isfinite(error) & (late.rest[1:-1] < MAX_REST)
    if known.sum() >= MIN_ROWS:
        mean = float(np.mean(np.minimum(beside / error, MAX_SIGMAS)[known] ** 2))
        if mean > max(MIN_UNEVEN_RATIO, 1 + MIN_JUMP_SIGMAS * math.sqrt(2 / int(known.sum()))):
            most = float(np.max(np.abs(beside[known]) * (error[known] < MIN_BESIDE), initial=0.0))
            singles.append(WrongTimes(t=float(rows[0]), shift=most * step, onward=False))
    return singles


def _broken_lines(t: Array, value: Array, weight: Array, half: int, *, bent: bool) -> tuple[Array, Array]:
    """Fit a line to the rows on each side of every row.

    Parameters
    ----------
    t
        Times of the rows [steps].
    bent
        Whether it bends there; otherwise it jumps, with one slope on both sides.

    Returns
    -------
    The break at each row and the slope before it, shape (2, n); and the break in its standard errors, shape (n,).
    """
    # Beyond the film's ends rows weigh nothing
    y, w, x = (sliding_window_view(np.pad(each, half), 2 * half)[: len(value)] for each in (value, weight, t))
    x = np.where(w > 0, x - t[:, None], 0.0)
    after = np.maximum(x, 0.0) if bent else np.broadcast_to(np.arange(-half, half) >= 0, x.shape)
    design = np.stack([after, x, np.ones_like(x)], axis=2) * w[..., None]
    normal = design.swapaxes(1, 2) @ design
    inverse = np.linalg.pinv(normal, hermitian=True)
    coefficients = np.einsum("nij,nkj,nk->ni", inverse, design, w * y)
    rest = w * y - np.einsum("nkj,nj->nk", design, coefficients)
    freedom = np.sum(w > 0, axis=1) - 3
    misfit = np.maximum(np.sum(rest**2, axis=1) / np.maximum(freedom, 1), 1.0)
    sigmas = np.abs(coefficients[:, 0]) / np.sqrt(np.maximum(inverse[:, 0, 0] * misfit, 1e-12))
    # Two rows on each side at least, and one more than there are numbers
    sides = np.minimum(np.sum(w[:, :half] > 0, axis=1), np.sum(w[:, half:] > 0, axis=1))
    return coefficients[:, :2].T, np.where((sides >= 2) & (freedom >= 1), sigmas, 0.0)


@dataclass(frozen=True, kw_only=True)
class RowShift:
    """Columns of a table that stand in other rows than the rest."""

    columns: str
    """Which: a channel, or "heavy" or "light" for all of a mass's."""
    rows: int
    """By how many rows their points are late; negative: early."""

    @property
    def text(self) -> str:
        """Return what is shifted, and by how much, in words."""
        body, _, axis = self.columns.partition("_")
        what = f"{axis} of the {body} mass" if axis else f"the {body} mass's points"
        plural = "s" if abs(self.rows) > 1 else ""
        return f"{what} {abs(self.rows)} row{plural} {'later' if self.rows > 0 else 'earlier'} than the other columns"


def without_shift(declared: DeclaredTrial, shift: RowShift) -> DeclaredTrial:
    """Return the trial, with y up, with columns earlier by so many rows."""

    def earlier(channel: Channel) -> Channel:
        is_shifted = channel.name.startswith(shift.columns)
        return dataclasses.replace(channel, t=channel.t - shift.rows * channel.time_step) if is_shifted else channel

    return declared.upright().with_channels(earlier)


def row_shift(declared: DeclaredTrial, least_ratio: float = 1.0) -> RowShift | None:
    """Return which columns stand in other rows than the rest, by the string's length; None: there are none.

    The free string, what is wound up, and the height of the heavy mass make one length, whatever the forces are.

    Parameters
    ----------
    least_ratio
        Smallest ratio of the mean squares before and after, where it is larger than `MIN_SHIFT_RATIOS`.
    """
    declared = declared.upright()
    channels = {c.name: c for c in declared.observations.channels}
    if not {"light_x", "light_y", "heavy_y"} <= channels.keys() or min(map(len, channels.values())) < MIN_COMPARED_ROWS:
        return None
    parameters = declared.study.parameters({}, declared.trial)
    # Mean square by which noise alone makes the string's two ends differ [m^2]
    of_x, of_y, of_heavy = (scatter(channels[name]) ** 2 for name in ("light_x", "light_y", "heavy_y"))
    noise = (of_x + of_y) / 2 + of_heavy
    before = _string_misfit(declared, parameters, noise)
    best, least = None, math.inf
    limit = min(MAX_SHIFT, len(channels["light_x"]) // MIN_ROWS_A_SHIFT)
    for columns, usual_ratio in MIN_SHIFT_RATIOS.items():
        if before <= max(usual_ratio, least_ratio):
            continue
        shifts = [RowShift(columns=columns, rows=n) for n in range(-limit, limit + 1)]
        misfits = [before if not s.rows else _string_misfit(without_shift(declared, s), parameters, noise) for s in shifts]
        at = int(np.argmin(misfits))
        # Far shifts leave few rows, which the terms of the picture fit better than their noise allows
        clear = before > max(usual_ratio, least_ratio) * max(misfits[at], 1.0)
        if shifts[at].rows and 0 < at < len(shifts) - 1 and clear and misfits[at] < least:
            best, least = shifts[at], misfits[at]
    return best


def shifts_by_motion(declared: DeclaredTrial) -> list[RowShift]:
    """Return with which columns in other rows the points are nearest to the declared motion, and those by a row more and less.

    Where columns are shifted far, few rows are left in which the string's two ends can be compared.
    """
    limit = min(MAX_SHIFT, max((len(c) for c in declared.observations.channels), default=0) // MIN_ROWS_A_SHIFT)
    shifts = [RowShift(columns=c, rows=n) for c in ("heavy", "light", *MIN_SHIFT_RATIOS) for n in range(-limit, limit + 1)]
    nearest = min(shifts, key=lambda shift: measured_distance(without_shift(declared, shift)).relative)
    # Before anything is fitted, one row more or less may be nearer
    rows = (nearest.rows + more for more in (0, 1, -1))
    return [dataclasses.replace(nearest, rows=n) for n in rows if n] if nearest.rows else []


def _string_misfit(declared: DeclaredTrial, parameters: Parameters, noise: float) -> float:
    """Return the mean square of what the string's two ends differ by, in that of the noise.

    What scale, turn and place of the picture change is fitted. Large differences count as `MAX_STRING_SIGMAS`: it matters in
    how many rows the ends differ, so that a tracker that slips for some is no shift.
    """
    channels = {c.name: c for c in declared.observations.channels}
    x, y, heavy = (channels[name] for name in ("light_x", "light_y", "heavy_y"))
    camera = Camera(**{name: known.value for name, known in declared.trial.camera.items()})
    inside = (x.t >= max(y.t[0], heavy.t[0])) & (x.t <= min(y.t[-1], heavy.t[-1]))
    t = x.t[inside]
    if len(t) < MIN_COMPARED_ROWS:
        return math.inf
    place = camera.true_position(np.stack([x.value[inside], np.interp(t, y.t, y.value)], axis=1))
    length, angle = string_coordinates(place, parameters.rod_radius, parameters.release_angle)
    wound = length + parameters.rod_radius * angle
    below = camera.true_position(np.stack([np.full(len(t), camera.origin_x), np.interp(t, heavy.t, heavy.value)], axis=1))
    picture = np.stack([*place.T, place[:, 0] ** 2, place[:, 0] * place[:, 1], place[:, 1] ** 2])
    picture /= np.maximum(length, 0.1 * parameters.free_length)
    design = np.stack([np.ones(len(t)), below[:, 1], *picture], axis=1)
    # A picture is known about; without these limits far shifts would be made good by it
    usual = np.array([parameters.free_length, 1.0, *np.zeros(5)])
    limits = np.array([parameters.free_length, *([MAX_PICTURE_ERROR] * 6)]) * [1, 1, *([parameters.free_length] * 2), 1, 1, 1]
    rest = np.concatenate([(wound - design @ usual) / math.sqrt(noise), np.zeros(len(usual))])
    change = np.linalg.lstsq(np.concatenate([design / math.sqrt(noise), np.diag(1 / limits)]), rest, rcond=None)[0]
    difference = wound - design @ (usual + change)
    return float(np.mean(np.minimum(difference**2 / noise, MAX_STRING_SIGMAS**2)))
