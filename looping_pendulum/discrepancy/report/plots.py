"""Draw the figures of an identification: tracked points, the declared model grey, the repaired one black, noise as a band."""

from __future__ import annotations

import textwrap
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from looping_pendulum.discrepancy.first_look import picture as first_look
from looping_pendulum.discrepancy.report import event_report, lead_figure, unlisted_report
from looping_pendulum.discrepancy.result import Identification, RankedExplanation
from looping_pendulum.discrepancy.trial_results import TrialFigure
from looping_pendulum.files import file_stems, optional_output
from looping_pendulum.pages.drawing import MAX_LABEL_LENGTH, new_figure, png, without_mathtext
from looping_pendulum.pages.palette import COLOURS, GREY

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

BEFORE, AFTER = COLOURS[1], COLOURS[0]
"""Colours of the declared and of the repaired model."""
EXPLANATIONS_CAPTION = (
    "How much more probable each explanation is than that nothing is missing, in powers of ten; blue: together these have 95 % "
    "of the probability."
)

MAX_LINES = 5
"""Lines of an explanation's name in a figure."""


def draw(result: Identification) -> dict[str, tuple[str, bytes]]:
    """Return all figures: file name -> (caption, PNG)."""
    drawings: list[tuple[str, str, Callable[[], Figure]]] = []
    if result.trial_figures:
        colours = {"before": BEFORE, "after": AFTER}
        drawings.append((lead_figure.NAME, lead_figure.caption(result), partial(lead_figure.draw, result, colours)))
    stems = file_stems([("trial", picture.trial) for picture in result.trial_figures])
    for picture, stem in zip(result.trial_figures, stems, strict=True):
        role = "held out" if picture.held_out else "training"
        caption = (
            f"Trial {picture.trial} ({role}): tracked points and both models; below, residuals in units of noise (band: 2)."
        )
        drawings.append((f"{stem}.png", caption, partial(trial_figure, picture)))
    if result.events:
        caption = "Measured less predicted events in units of their standard errors (band: 2); crosses: they do not happen."
        drawings.append(("events.png", caption, partial(event_report.figure, result.events, BEFORE, AFTER)))
    if len(result.explanations) > 1:
        drawings.append(("explanations.png", EXPLANATIONS_CAPTION, partial(explanations_figure, result)))
    if result.unlisted is not None:
        caption = "The unlisted force along its coordinate; bands: two standard errors."
        drawings.append(("unlisted-force.png", caption, partial(unlisted_report.figure, result.unlisted)))
    drawings.append(("errors.png", "Error of each trial before and after, in units of noise.", partial(error_figure, result)))
    figures: dict[str, tuple[str, bytes]] = {}
    for name, caption, make in drawings:
        with optional_output(f"figures/{name}"):
            figures[name] = caption, png(make())
    if result.first_look is not None and result.first_look.notes:
        with optional_output(f"figures/{first_look.NAME}"):
            image = first_look.draw(result.first_look)
            if image is not None:
                figures[first_look.NAME] = first_look.CAPTION, image
    return figures


def trial_figure(picture: TrialFigure) -> Figure:
    """Draw tracked points and both models of one trial over time, and the residuals of each channel."""
    count = len(picture.channels)
    figure = new_figure(9.0, 3.2 + 1.3 * count)
    axes = figure.subplots(1 + count, 1, sharex=True, height_ratios=[2.4, *[1.0] * count])
    for i, name in enumerate(picture.channels):
        t = picture.t[name]
        colour = COLOURS[i % len(COLOURS)]
        axes[0].plot(t, picture.measured[name], ".", ms=2.5, color=colour, label=name)
        is_outlier = picture.outliers[name]
        axes[0].plot(t[is_outlier], picture.measured[name][is_outlier], "x", ms=5, mew=1.2, color=colour)
        axes[0].plot(t, picture.before[name], "--", lw=0.9, color=GREY)
        axes[0].plot(t, picture.after[name], "-", lw=0.9, color="black")
        _residual(axes[1 + i], picture, name)
    axes[0].set_ylabel("measured [SI]")
    axes[0].legend(loc="best", fontsize=8, ncols=count)
    axes[0].set_title(
        "points: tracked; crosses: outliers, left out; dashed grey: declared model; black: repaired model", fontsize=9
    )
    axes[1].legend(loc="upper left", fontsize=8, ncols=2)
    axes[-1].set_xlabel("time by the file's clock [s]")
    return figure


def _residual(axes: Axes, picture: TrialFigure, name: str) -> None:
    axes.axhspan(-2, 2, color="0.92")
    axes.plot(picture.t[name], picture.residual_before[name], ".", ms=3, color=BEFORE, label="declared")
    axes.plot(picture.t[name], picture.residual_after[name], ".", ms=3, color=AFTER, label="repaired")
    axes.set_ylabel(name, fontsize=8)


def explanations_figure(result: Identification) -> Figure:
    """Draw the odds of the explanations against that nothing is missing as bars."""
    # Matplotlib draws horizontal bars from below, and the best should be on top
    shown = [e for e in result.explanations if e.names][::-1]
    labels = [[without_mathtext(line) for line in name_lines(e, MAX_LABEL_LENGTH)] for e in shown]
    figure = new_figure(7.0, 1.2 + (0.2 + 0.15 * max((len(label) for label in labels), default=1)) * len(shown))
    axes = figure.subplots()
    # At places of their own: two laws may have one name
    at = np.arange(len(shown))
    axes.barh(at, [e.log10_odds for e in shown], color=[AFTER if e.credible else GREY for e in shown])
    axes.set_yticks(at, ["\n".join(label) for label in labels])
    axes.axvline(0, color="black", lw=0.8)
    axes.set_xlabel("odds, powers of ten")
    return figure


def name_lines(explanation: RankedExplanation, width: int) -> list[str]:
    """Return an explanation's name in lines of at most ``width`` characters, since that of a law is too long for one line."""
    return textwrap.wrap(" + ".join(explanation.names), width, max_lines=MAX_LINES, placeholder="...")


def error_figure(result: Identification) -> Figure:
    """Draw each trial's error before and after as bars."""
    figure = new_figure(7.0, 3.2)
    axes = figure.subplots()
    at = np.arange(len(result.errors))
    axes.bar(at - 0.2, [e.standardised_rms_before for e in result.errors], 0.4, color=BEFORE, label="declared")
    axes.bar(at + 0.2, [e.standardised_rms_after for e in result.errors], 0.4, color=AFTER, label="repaired")
    axes.axhline(1, color="black", lw=0.8, ls=":")
    axes.set_xticks(at, [without_mathtext(e.trial) + (" (held out)" if e.held_out else "") for e in result.errors])
    axes.set_ylabel("RMS [noise]")
    axes.legend(fontsize=8)
    return figure
