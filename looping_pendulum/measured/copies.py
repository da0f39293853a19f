"""Pictures that a film stores again: rows that show the picture before are left out, as they count twice in a fit.

Only what the points themselves show beyond doubt counts here: points that are equal in every digit, and patterns in which some
rows of every few hardly move.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d

from looping_pendulum.measured.noise import scatter
from looping_pendulum.measured.observations import BODIES, Channel, ReadingNotes
from looping_pendulum.reference_ode.geometry import Array

MAX_PERIOD = 6
"""Longest pattern of pictures that are stored again [rows]."""
MIN_TURNS = 6
"""Smallest number of times that a pattern must be seen."""
STILL = 0.15
"""Largest share of the way to a copy in that to a new picture, squared: marks that are set again have some noise.

Where frames are uneven in turn by less than half of one, the shorter steps are longer.
"""
MIN_ROWS = 12
"""Smallest number of rows that show equal points."""
MIN_FRESH = 6
"""Smallest number of points that are left without copies."""
MAX_CHANCE_DIGIT = 0.2
"""Last digit, in standard deviations of the noise, up to which equal points are no chance but copies."""
MIN_COPIES = 3
"""Smallest number of points that are equal to the one before of which any is a copy."""
MIN_NOISE = 5e-5
"""Smallest noise, as a part of the range of the values, in which a copy tells anything: made-up data have none."""


def without_copies(channels: Sequence[Channel], notes: ReadingNotes) -> list[Channel]:
    """Return the channels without pictures that are stored again: every picture as often, or single ones with equal points."""
    t = np.unique(np.concatenate([np.zeros(0), *(c.t for c in channels)]))
    step = float(np.median(np.diff(t))) if len(t) > 1 else 0.0
    new = _pattern(channels, t, step) if step > 0 else None
    if new is None:
        return [c for body in _by_body(channels) for c in _without_equal_points(body, notes)]
    period, count = len(new), int(new.sum())
    first = int(np.argmax(new))
    by_file, even = [], []
    for c in channels:
        number = np.rint((c.t - t[0]) / step).astype(int)
        kept = new[number % period]
        rank = (np.cumsum(new)[number % period] - 1 + count * (number // period))[kept]
        by_file.append(replace(c, t=c.t[kept], value=c.value[kept]))
        # A camera's pictures are even in time, which a film shows twice and three times in turn
        even.append(replace(by_file[-1], t=t[0] + (first + rank * period / count) * step))
    noise = [scatter(c) for c in by_file]
    chosen = min((by_file, even), key=lambda those: sum(scatter(c) / n for c, n in zip(those, noise, strict=True) if n))
    every = f"every picture is stored {period} times" if count == 1 else f"{period} rows show {count} pictures"
    rows = f"{len(max(chosen, key=len))} of {len(max(channels, key=len))}"
    notes.assumptions.append(f"{every}: one row of each is kept, {rows}")
    return chosen


def _pattern(channels: Sequence[Channel], t: Array, step: float) -> NDArray[np.bool_] | None:
    """Return which rows of a period show a new picture; None: there is no such pattern."""
    number, square = np.rint((t - t[0]) / step).astype(int), np.zeros(len(t) - 1)
    seen = np.diff(number) == 1
    for c in channels:
        noise = max(scatter(c), c.last_digit)
        if c.name == "angle_rate" or not noise:
            continue
        values = np.full(len(t), np.nan)
        values[np.searchsorted(t, c.t)] = c.value / noise
        square += np.diff(values) ** 2
    seen &= np.isfinite(square)
    if not seen.any():
        return None
    square, place, best = np.where(seen, square, 0.0), number[1:][seen], None
    for period in range(2, MAX_PERIOD + 1):
        turns = np.bincount(place % period, minlength=period)
        if turns.min() < MIN_COPIES:
            break
        # By the largest step nearby, as masses come to rest, and so that a leap of the tracker decides nothing
        share = square / np.maximum(maximum_filter1d(square, 2 * period + 1), np.finfo(float).tiny)
        mean = np.bincount(place % period, weights=share[seen], minlength=period) / turns
        new = mean > STILL * mean.max()
        # Points that are equal in every digit tell more than those that hardly move
        if turns.min() < MIN_TURNS and np.any(mean[~new]):
            continue
        # Of pictures stored four times, every second one is stored twice, too
        if new.any() and not new.all() and (best is None or new.mean() < best.mean()):
            best = new
    return best


def _by_body(channels: Sequence[Channel]) -> list[list[Channel]]:
    """Return the channels in their order, by body; those of no body each alone."""
    bodies = {name: body for body, names in BODIES.items() for name in names}
    grouped: dict[str, list[Channel]] = {}
    for c in channels:
        grouped.setdefault(bodies.get(c.name, c.name), []).append(c)
    return list(grouped.values())


def _without_equal_points(body: list[Channel], notes: ReadingNotes) -> list[Channel]:
    """Return a body's channels without points that repeat the one before in every digit."""
    if any(not np.array_equal(c.t, body[0].t) for c in body) or len(body[0]) < MIN_ROWS:
        return body
    values = np.stack([c.value for c in body], axis=1)
    fresh = np.append(True, np.any(values[1:] != values[:-1], axis=1))
    if fresh.all() or fresh.sum() < MIN_FRESH:
        return body
    left = [replace(c, t=c.t[fresh], value=c.value[fresh]) for c in body]
    # Of rounded points, or of those on a raster such as a picture's pixels, many that are no neighbours are equal, too
    by_chance = max(len(c) - len(np.unique(c.value)) for c in left)
    if (~fresh).sum() < max(MIN_COPIES, by_chance) or not all(map(_has_fine_digits, left)):
        return body
    for c in body:
        notes.unused[f"{c.name}: a copy of the point before"] += int(np.sum(~fresh))
    return left


def _has_fine_digits(channel: Channel) -> bool:
    """Return whether a channel has noise, and digits so far below it that no two points are equal by chance."""
    noise = scatter(channel)
    return noise > max(MIN_NOISE * float(np.ptp(channel.value)), channel.last_digit / MAX_CHANCE_DIGIT)
