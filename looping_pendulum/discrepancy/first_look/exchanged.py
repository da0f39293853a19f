"""Find rows of a table in which the points of the two masses are exchanged, as trackers that lose both may do."""

from __future__ import annotations

import dataclasses
from functools import reduce

import numpy as np
from numpy.typing import NDArray

from looping_pendulum.discrepancy.first_look.evidence import MIN_ROWS
from looping_pendulum.discrepancy.first_look.misfit import OTHER_MASS, DeclaredTrial
from looping_pendulum.measured.observations import Channel
from looping_pendulum.reference_ode.geometry import Array


@dataclasses.dataclass(frozen=True, kw_only=True)
class ExchangedRows:
    """A trial with its points exchanged back."""

    declared: DeclaredTrial
    spans: tuple[tuple[float, float], ...]
    """First and last time of the rows that were exchanged [s]."""
    is_to_the_end: bool

    @property
    def text(self) -> str:
        """Return the rows in words."""
        words = [f"from {first:.4g} s to {last:.4g} s" for first, last in self.spans]
        if self.is_to_the_end:
            words[-1] = f"from {self.spans[-1][0]:.4g} s on"
        return " and ".join(words)


def without_exchanged_rows(declared: DeclaredTrial) -> ExchangedRows | None:
    """Return the trial with rows exchanged in which each mass is where the other one should be next; None: there are none."""
    channels = {c.name: c for c in declared.observations.channels}
    names = [f"{mass}_{axis}" for mass in OTHER_MASS for axis in "xy"]
    if not channels.keys() >= set(names):
        return None
    t = reduce(np.union1d, [channels[name].t for name in names])
    if len(t) < MIN_ROWS:
        return None
    places = np.full((len(t), len(names)), np.nan)
    for i, name in enumerate(names):
        places[np.searchsorted(t, channels[name].t), i] = channels[name].value
    exchanged = _exchanged(t, places.reshape(-1, 2, 2))
    if not exchanged.any():
        return None
    ends = np.flatnonzero(np.diff(np.concatenate([[False], exchanged, [False]]).astype(int)))
    own = dict(zip(names, np.where(exchanged[:, None], places[:, [2, 3, 0, 1]], places).T, strict=True))

    def exchanged_back(channel: Channel) -> Channel:
        if channel.name not in own:
            return channel
        known = np.isfinite(own[channel.name])
        return dataclasses.replace(channel, t=t[known], value=own[channel.name][known])

    return ExchangedRows(
        declared=declared.with_channels(exchanged_back),
        spans=tuple((float(t[a]), float(t[b - 1])) for a, b in ends.reshape(-1, 2)),
        is_to_the_end=bool(exchanged[-1]),
    )


def _exchanged(t: Array, places: Array) -> NDArray[np.bool_]:
    """Return in which rows the masses are nearer to where they move if they are exchanged, shape (n,).

    Parameters
    ----------
    places
        Of both masses, shape (n, 2, 2); not a number: not tracked.
    """
    exchanged = np.zeros(len(t), dtype=bool)
    before = last = np.where(np.isfinite(places[0]), places[0], places[1])
    for k in range(1, len(t)):
        # A turning mass bends its way, so that half of its last step is the better guess
        onward = last + 0.5 * (last - before)
        away = [float(np.nansum(np.linalg.norm(each - onward, axis=1))) for each in (places[k], places[k, ::-1])]
        exchanged[k] = away[1] < away[0]
        own = places[k, ::-1] if exchanged[k] else places[k]
        before, last = last, np.where(np.isfinite(own), own, onward)
    return exchanged
