"""Rows in which a tracker has lost an object: by its own score, or by a place that stands for none."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from looping_pendulum.reference_ode.geometry import Array

MIN_SCORE = 0.5
"""Smallest score of a point that is used, as a share of the median of its object's, as programs scale scores in many ways."""
MAX_MARKS = 5
"""Largest number of different marks of a lost object in a table."""
FAR = 3.0
"""Way to a mark, in the longest step between the other points: a mass may pass a place whose numbers are whole."""
MIN_OTHERS = 10
"""Smallest number of other points by which a sign for a lost place is recognised that is not a usual one."""
USUAL_MARKS = (0.0, -1.0)
"""Both coordinates of the marks that are recognised among the points, too."""
NINES = tuple(10.0**k - 1 for k in range(2, 10))
"""Marks of a lone column."""


def low_scores(score: Array) -> NDArray[np.bool_]:
    """Return which points have a low score."""
    median = np.nanmedian(score) if np.isfinite(score).any() else np.nan
    return np.asarray(score < MIN_SCORE * median) if median > 0 else np.zeros(len(score), dtype=bool)


def marked_as_lost(values: Array) -> NDArray[np.bool_]:
    """Return which points are marks of a lost object: far from the points before and after, where no mass gets in a step.

    Trackers write (0, 0), (-1, -1), (-9999, -9999) or any other place. One that occurs once is a mark only if both coordinates
    are one whole number. A mass may begin at the origin, if somebody put it there; then its next step is no longer than all
    others.

    Parameters
    ----------
    values
        Coordinates in the file's unit, or one angle or height, shape (k, n), k = 1 or 2; not a number: none.
    """
    lost = np.zeros(values.shape[1], dtype=bool)
    left = np.all(np.isfinite(values), axis=0)
    marks = [(np.full(2, mark), True) for mark in USUAL_MARKS if len(values) == 2]
    for place, is_usual in (*marks, *((place, False) for place in _unusual_marks(values[:, left]))):
        is_there = left & np.all(values == place[:, None], axis=0)
        others = np.flatnonzero(left & ~is_there)
        if not (is_there.any() and len(others)):
            continue
        longest_step = np.linalg.norm(np.diff(values[:, others], axis=1), axis=0).max(initial=0.0)
        away = np.linalg.norm(values[:, others] - place[:, None], axis=0)
        if is_usual:
            begins_there = len(others) == 1 or away[0] <= longest_step
            is_there[: others[0] if begins_there else 0] = False
        else:
            after = np.searchsorted(others, np.flatnonzero(is_there))
            beside = np.clip(np.append(after - 1, after), 0, len(others) - 1)
            if len(others) < MIN_OTHERS or away[beside].min() <= FAR * longest_step:
                continue
        lost |= is_there
        left &= ~is_there
    return lost


def _unusual_marks(points: Array) -> list[Array]:
    """Return the places that may be marks, the farthest from the middle of all first."""
    if not points.size:
        return []
    places, counts = np.unique(points, axis=1, return_counts=True)
    is_whole = np.all(places == np.round(places[0]), axis=0)
    may_be = (counts > 1) | is_whole if len(points) == 2 else np.isin(np.abs(places[0]), NINES)
    places = places[:, may_be]
    away = np.linalg.norm(places - np.median(points, axis=1)[:, None], axis=0)
    return list(places.T[np.argsort(-away, kind="stable")[:MAX_MARKS]])
