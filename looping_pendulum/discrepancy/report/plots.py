"""Figures of an identification: measured as points, the declared model grey, the repaired one in colour, noise as a band."""

from __future__ import annotations

import io
from collections.abc import Callable
from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from looping_pendulum.compare.plots import GREY, literal
from looping_pendulum.discrepancy.report import event_report, unlisted_report
from looping_pendulum.discrepancy.result import Identification, TrialFigure
from looping_pendulum.files import decoration, file_stems
from looping_pendulum.pages.palette import COLOURS

BEFORE, AFTER = COLOURS[1], COLOURS[0]
SHOWN = 12
"""Candidates in the ranking."""


def draw(result: Identification) -> dict[str, tuple[str, bytes]]:
    """Every figure: file name -> (caption, PNG)."""
    made: list[tuple[str, str, Callable[[], Figure]]] = []
    stems = file_stems([("trial", picture.trial) for picture in result.pictures])
    for picture, stem in zip(result.pictures, stems, strict=True):
        word = "held out" if picture.held_out else "seen by the fit"
        caption = f"Trial {picture.trial} ({word}): marks and both models; below, residuals in units of noise (band: 2)."
        made.append((f"{stem}.png", caption, partial(trial_figure, picture)))
    if result.events:
        caption = "Measured less predicted events in units of their standard errors (band: 2); crosses: they do not happen."
        made.append(("events.png", caption, partial(event_report.figure, result.events, BEFORE, AFTER)))
    if result.rounds and any(r.gain is not None for r in result.rounds[0].ranking):
        caption = "First round: gain of every refitted candidate on the Bayesian information criterion; blue: passes."
        made.append(("ranking.png", caption, partial(ranking_figure, result)))
    if result.unlisted is not None:
        caption = "The unlisted force along its coordinate; bands: two standard errors."
        made.append(("unlisted-force.png", caption, partial(unlisted_report.figure, result.unlisted)))
    made.append(("errors.png", "Error of each trial before and after, in units of noise.", partial(error_figure, result)))
    figures: dict[str, tuple[str, bytes]] = {}
    for name, caption, make in made:
        with decoration(f"figures/{name}"):
            figures[name] = caption, _png(make())
    return figures


def trial_figure(picture: TrialFigure) -> Figure:
    """Marks and models of one trial over time, and the residuals of each channel."""
    count = len(picture.channels)
    figure = Figure(figsize=(9.0, 3.2 + 1.3 * count), layout="constrained")
    axes = figure.subplots(1 + count, 1, sharex=True, height_ratios=[2.4, *[1.0] * count])
    for i, name in enumerate(picture.channels):
        t = picture.t[name]
        colour = COLOURS[i % len(COLOURS)]
        axes[0].plot(t, picture.measured[name], ".", ms=2.5, color=colour, label=name)
        axes[0].plot(t, picture.before[name], "--", lw=0.9, color=GREY)
        axes[0].plot(t, picture.after[name], "-", lw=0.9, color="black")
        _residual(axes[1 + i], picture, name)
    axes[0].set_ylabel("measured [SI]")
    axes[0].legend(loc="best", fontsize=8, ncols=count)
    axes[0].set_title("points: marks; dashed grey: declared; black: repaired", fontsize=9)
    axes[1].legend(loc="upper left", fontsize=8, ncols=2)
    axes[-1].set_xlabel("time by the file's clock [s]")
    return figure


def _residual(axes: Axes, picture: TrialFigure, name: str) -> None:
    axes.axhspan(-2, 2, color="0.92")
    axes.plot(picture.t[name], picture.residual_before[name], ".", ms=3, color=BEFORE, label="declared")
    axes.plot(picture.t[name], picture.residual_after[name], ".", ms=3, color=AFTER, label="repaired")
    axes.set_ylabel(name, fontsize=8)


def ranking_figure(result: Identification) -> Figure:
    """Bars of the first round's gains."""
    ranking = [r for r in result.rounds[0].ranking if r.gain is not None][:SHOWN][::-1]
    figure = Figure(figsize=(7.0, 1.2 + 0.35 * len(ranking)), layout="constrained")
    axes = figure.subplots()
    gains = [max(r.gain or 0.0, 0.0) for r in ranking]
    axes.barh([literal(r.name) for r in ranking], gains, color=[AFTER if r.passes else GREY for r in ranking])
    axes.set_xscale("symlog", linthresh=10)
    axes.axvline(10, color="black", lw=0.8, ls=":")
    axes.set_xlabel("gain (dotted: the least that counts)")
    return figure


def error_figure(result: Identification) -> Figure:
    """Bars of each trial's error before and after."""
    figure = Figure(figsize=(7.0, 3.2), layout="constrained")
    axes = figure.subplots()
    at = np.arange(len(result.errors))
    axes.bar(at - 0.2, [e.noise_before for e in result.errors], 0.4, color=BEFORE, label="declared")
    axes.bar(at + 0.2, [e.noise_after for e in result.errors], 0.4, color=AFTER, label="repaired")
    axes.axhline(1, color="black", lw=0.8, ls=":")
    axes.set_xticks(at, [literal(e.trial) + (" (held out)" if e.held_out else "") for e in result.errors])
    axes.set_ylabel("RMS [noise]")
    axes.legend(fontsize=8)
    return figure


def _png(figure: Figure) -> bytes:
    out = io.BytesIO()
    figure.savefig(out, format="png", metadata={"Software": None})  # no version, so that the same figure has the same bytes
    return out.getvalue()
