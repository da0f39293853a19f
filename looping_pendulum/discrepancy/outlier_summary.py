"""Summarise which tracked points the fits left out as outliers, for the result and in words."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from looping_pendulum.discrepancy.fit.calibration import Fit
from looping_pendulum.discrepancy.trial_results import Outliers
from looping_pendulum.measured.observations import BODIES
from looping_pendulum.pages.numbers import quantity


def summarise_outliers(fits: Sequence[tuple[Fit, int, bool]]) -> tuple[Outliers, ...]:
    """Return the outliers of each trial and body; ``fits``: fit, index of the trial in it, whether the trial is held out."""
    rows = []
    for fit, k, held_out in fits:
        d = fit.problem.data[k]
        residual = d.value - fit.problem.predict(fit.x, k)
        for names in BODIES.values():
            channels = [c for c in d.channels if c.name in names and d.is_outlier[d.slices[c.name]].any()]
            if not channels:
                continue
            # One coordinate of a point may be missing, or stand in another row
            t = np.unique(np.concatenate([c.t for c in channels]))
            is_outlier, distance = np.zeros(len(t), dtype=bool), np.zeros(len(t))
            for c in channels:
                at, part = np.searchsorted(t, c.t), d.slices[c.name]
                is_outlier[at] |= d.is_outlier[part]
                distance[at] = np.hypot(distance[at], residual[part])
            index = np.flatnonzero(is_outlier)
            # Cut where an index is left out, so that each run is one interval of time
            runs = np.split(index, 1 + np.flatnonzero(np.diff(index) > 1))
            rows.append(
                Outliers(
                    trial=d.trial.name,
                    held_out=held_out,
                    channels=tuple(c.name for c in channels),
                    count=len(index),
                    of=len(t),
                    intervals=tuple((float(t[run[0]]), float(t[run[-1]])) for run in runs),
                    largest_distance=float(np.max(distance[index])),
                    unit=channels[0].unit,
                )
            )
    return tuple(rows)


def outliers_in_words(outliers: Sequence[Outliers]) -> str:
    """Return a sentence about the points that were left out, of which there must be some."""
    count, of = sum(o.count for o in outliers), sum(o.of for o in outliers)
    largest = max(outliers, key=lambda o: o.largest_distance)
    return (
        f"{count} of {of} tracked points do not show the mass, being off by up to "
        f"{quantity(largest.largest_distance, largest.unit)} beside neighbours that are not; they were left out."
    )
