"""Small picture of a first look: the tracked points, and where the study says that they should be."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from looping_pendulum.discrepancy.data.observations import BODIES, Channel
from looping_pendulum.discrepancy.first_look.misfit import Distance
from looping_pendulum.discrepancy.first_look.result import DeclarationCheck
from looping_pendulum.pages.palette import COLOURS
from looping_pendulum.reference_ode.geometry import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes

NAME = "first-look.png"
"""File name of the picture."""
CAPTION = (
    "Tracked points of the first part of each trial, and the motion that the study declares (lines), before anything is fitted."
)
MAX_TRIALS = 4
"""Largest number of trials that are shown."""
PANEL = 3.4
"""Width and height of a panel [inches]."""


def draw(check: DeclarationCheck) -> bytes | None:
    """Return the picture as PNG; None: no trial has points to show.

    Each row is a trial: on the left as it is declared, on the right, if a mistake was named in it, without the mistake. Trials
    with mistakes come first.
    """
    from matplotlib.figure import Figure  # imported on use: it takes as long as the comparison itself

    from looping_pendulum.compare.plots import without_mathtext

    corrected = {trial: (m.keys, distance) for m in check.mistakes for trial, distance in m.corrected.items()}
    rows = sorted((t for t in check.trials if t.distance is not None), key=lambda t: t.trial not in corrected)[:MAX_TRIALS]
    if not rows:
        return None
    columns = 2 if corrected else 1
    figure = Figure(figsize=(PANEL * columns + 0.4, PANEL * len(rows)), layout="constrained")
    panels = figure.subplots(len(rows), columns, squeeze=False)
    for (left, *right), row in zip(panels, rows, strict=True):
        assert row.distance is not None
        _panel(left, row.distance)
        left.set_title(without_mathtext(f"trial {row.trial}, as declared"), fontsize=9)
        for axes in right:
            if row.trial in corrected:
                keys, distance = corrected[row.trial]
                _panel(axes, distance)
                axes.set_title(without_mathtext(f"with '{keys}'"), fontsize=9, wrap=True)
            else:
                axes.set_visible(False)
    panels[0][0].legend(fontsize=7, loc="best")
    out = io.BytesIO()
    figure.savefig(out, format="png", metadata={"Software": None})  # no version, so that the same picture has the same bytes
    return out.getvalue()


def _panel(axes: Axes, distance: Distance) -> None:
    """Draw the points and the motion, to scale where positions were tracked, otherwise against time."""
    named = {channel.name: (channel, predicted) for channel, predicted in distance.points}
    drawn: set[str] = set()
    for i, (body, names) in enumerate(BODIES.items()):
        if len(names) == 2 and named.keys() >= set(names):
            points, motion = _positions([named[n] for n in names])
            axes.plot(*points.T, ".", ms=4, color=COLOURS[i], label=f"{body}, tracked")
            axes.plot(*motion.T, "-", lw=1.2, color="black", label="declared motion" if not drawn else None)
            axes.plot(*motion[0], "o", ms=5, mfc="none", color="black", label="its start" if not drawn else None)
            drawn |= set(names)
    if drawn:
        axes.plot(0, 0, "+", ms=8, color="0.4", label="origin")
        axes.set_aspect("equal", adjustable="datalim")
        axes.set_xlabel("x [m]")
        axes.set_ylabel("y [m]")
        return
    for i, (channel, predicted) in enumerate(named.values()):
        axes.plot(channel.t, channel.value, ".", ms=4, color=COLOURS[i % len(COLOURS)], label=f"{channel.name}, measured")
        axes.plot(channel.t, predicted, "-", lw=1.2, color="black", label="declared motion" if i == 0 else None)
    axes.set_xlabel("time by the file's clock [s]")
    axes.set_ylabel("measured [SI]")


def _positions(both: Sequence[tuple[Channel, Array]]) -> tuple[Array, Array]:
    """Return measured and predicted positions at the times that both coordinates share, shape (n, 2)."""
    (x, x_predicted), (y, y_predicted) = both
    _, in_x, in_y = np.intersect1d(x.t, y.t, return_indices=True)
    points = np.column_stack([x.value[in_x], y.value[in_y]])
    return points, np.column_stack([x_predicted[in_x], y_predicted[in_y]])
