"""Small picture of a first look: the tracked points, and where the study says that they should be."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from looping_pendulum.discrepancy.first_look.misfit import Distance
from looping_pendulum.discrepancy.first_look.result import DeclarationCheck, TrialCheck
from looping_pendulum.measured.observations import BODIES, Channel
from looping_pendulum.pages.drawing import new_figure, png, without_mathtext
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


AXES = {True: ("x [m]", "y [m]"), False: ("time by the file's clock [s]", "measured [SI]")}
"""Whether a path is shown -> titles of its axes."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Curve:
    """Tracked points of one body or channel, and its declared motion."""

    label: str
    points: Array
    """Positions [m], or times and values, shape (n, 2)."""
    motion: Array
    """The same as declared."""
    is_path: bool
    """Whether these are positions."""


def curves(distance: Distance) -> list[Curve]:
    """Return the path of each mass that was tracked; where none was, every channel against time."""
    named = {channel.name: (channel, predicted) for channel, predicted in distance.points}
    paths = []
    for body, names in BODIES.items():
        if len(names) == 2 and named.keys() >= set(names):
            tracked, motion = _positions([named[n] for n in names])
            paths.append(Curve(label=f"{body}, tracked", points=tracked, motion=motion, is_path=True))
    return paths or [
        Curve(
            label=f"{channel.name}, measured",
            points=np.column_stack([channel.t, channel.value]),
            motion=np.column_stack([channel.t, predicted]),
            is_path=False,
        )
        for channel, predicted in named.values()
    ]


def shown_trials(check: DeclarationCheck) -> list[TrialCheck]:
    """Return the trials to show, those with mistakes first."""
    mistaken = {trial for mistake in check.mistakes for trial in mistake.trials}
    return sorted((t for t in check.trials if t.distance is not None), key=lambda t: t.trial not in mistaken)[:MAX_TRIALS]


def draw(check: DeclarationCheck) -> bytes | None:
    """Return the picture as PNG; None: no trial has points to show.

    Each row is a trial: on the left as it is declared, on the right, if a mistake was named in it, without the mistake. Trials
    with mistakes come first.
    """
    corrected = {trial: (m.keys, distance) for m in check.mistakes for trial, distance in m.corrected.items()}
    rows = shown_trials(check)
    if not rows:
        return None
    columns = 2 if corrected else 1
    figure = new_figure(PANEL * columns + 0.4, PANEL * len(rows))
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
    return png(figure)


def _panel(axes: Axes, distance: Distance) -> None:
    """Draw the points and the motion: paths to scale."""
    shown = curves(distance)
    for i, curve in enumerate(shown):
        axes.plot(*curve.points.T, ".", ms=4, color=COLOURS[i % len(COLOURS)], label=curve.label)
        axes.plot(*curve.motion.T, "-", lw=1.2, color="black", label="declared motion" if i == 0 else None)
        if curve.is_path:
            axes.plot(*curve.motion[0], "o", ms=5, mfc="none", color="black", label="its start" if i == 0 else None)
    if shown[0].is_path:
        axes.plot(0, 0, "+", ms=8, color="0.4", label="origin")
        axes.set_aspect("equal", adjustable="datalim")
    x_title, y_title = AXES[shown[0].is_path]
    axes.set_xlabel(x_title)
    axes.set_ylabel(y_title)


def _positions(both: Sequence[tuple[Channel, Array]]) -> tuple[Array, Array]:
    """Return measured and predicted positions at the times that both coordinates share, shape (n, 2)."""
    (x, x_predicted), (y, y_predicted) = both
    _, in_x, in_y = np.intersect1d(x.t, y.t, return_indices=True)
    points = np.column_stack([x.value[in_x], y.value[in_y]])
    return points, np.column_stack([x_predicted[in_x], y_predicted[in_y]])
