"""The first picture of a report: how far one trial is from the declared and from the repaired model.

Where a mass's position was tracked, it is the motion with the residual of every point as a line, magnified; otherwise it is the
residual against time. The trial is the one that the verdict's sentence speaks of.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from looping_pendulum.discrepancy.result import Identification, Verdict
from looping_pendulum.discrepancy.trial_results import TrialFigure
from looping_pendulum.discrepancy.verdict_sentence import BODY_IN_WORDS, worst_trial
from looping_pendulum.measured.observations import BODIES, UNITS
from looping_pendulum.pages.drawing import new_figure, without_mathtext
from looping_pendulum.pages.figures import INK, Figure, escaped, horizontal, plain, points
from looping_pendulum.pages.palette import GREY
from looping_pendulum.reference_ode.geometry import Array

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

NAME = "motion.png"
"""File name of the picture in the folder of figures."""
MODELS = (("before", "declared model", "0"), ("after", "repaired model", "1"))
"""Field of a figure's arrays, label and part of the id of each model."""
VECTOR_SHARE = 0.1
"""Length of the declared model's RMS residual in the picture, as a share of the motion's size; no magnification exceeds it."""
SHOWN_UNITS = {"m": (("mm", 1e3), ("m", 1.0)), "rad": (("mrad", 1e3), ("deg", 180 / math.pi)), "rad/s": (("rad/s", 1.0),) * 2}
"""SI unit of a channel -> unit and its number per SI unit for small residuals, and for those of `LARGE` and above."""
LARGE = 0.1
"""RMS residual [SI] above which the larger unit is used."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ResidualVectors:
    """Residuals of a tracked mass as lines from the model to the points."""

    path: Array
    """Positions by the model [m], shape (n, 2)."""
    tips: Array
    """The model's position plus the magnified residual [m], shape (n, 2)."""


def shown_trial(result: Identification) -> TrialFigure | None:
    """Return the trial to show: the one that the verdict's sentence speaks of, or else the first that was tracked."""
    if not result.trial_figures:
        return None
    name = worst_trial(result.errors).trial
    return next((p for p in result.trial_figures if p.trial == name), result.trial_figures[0])


def has_repair(result: Identification) -> bool:
    """Return whether the repaired model differs from the declared one."""
    return result.verdict is not Verdict.NO_MISSING_EFFECT and bool(result.effects or result.unlisted)


def models(result: Identification) -> tuple[tuple[str, str, str], ...]:
    """Return those of `MODELS` to show."""
    return MODELS if has_repair(result) else MODELS[:1]


def tracked_body(picture: TrialFigure) -> str | None:
    """Return the body whose position was tracked in both directions, the light mass first; None: there is none."""
    return next((b for b, names in BODIES.items() if len(names) == 2 and set(names) <= set(picture.channels)), None)


def residual_vectors(picture: TrialFigure, body: str) -> tuple[dict[str, ResidualVectors], float]:
    """Return field of the model ("before", "after") -> residual vectors, and the factor by which they are magnified."""
    x, y = BODIES[body]
    _, ix, iy = np.intersect1d(picture.t[x], picture.t[y], return_indices=True)
    used = ~(picture.outliers[x][ix] | picture.outliers[y][iy])
    ix, iy = ix[used], iy[used]

    def both(values: Mapping[str, Array]) -> Array:
        return np.column_stack([values[x][ix], values[y][iy]])

    measured = both(picture.measured)
    paths = {side: both(getattr(picture, side)) for side, _, _ in MODELS}
    size = float(np.max(np.ptp(measured, axis=0), initial=0.0))
    rms = float(np.sqrt(np.mean(np.sum((measured - paths["before"]) ** 2, axis=1)))) if len(measured) else 0.0
    factor = _round_factor(VECTOR_SHARE * size / rms) if rms > 0 else 1.0
    return {side: ResidualVectors(path=path, tips=path + factor * (measured - path)) for side, path in paths.items()}, factor


def _round_factor(largest: float) -> float:
    """Return the largest of 1, 2, 5, 10, 20, ... that is not above ``largest``; 1 at least."""
    if largest < 1:
        return 1.0
    power = 10.0 ** math.floor(math.log10(largest))
    return power * max(step for step in (1, 2, 5) if step * power <= largest)


def residuals_over_time(picture: TrialFigure, channel: str) -> tuple[dict[str, Array], str]:
    """Return field of the model -> measured less predicted values without outliers, and their unit."""
    raw = {
        side: np.where(picture.outliers[channel], np.nan, picture.measured[channel] - getattr(picture, side)[channel])
        for side, _, _ in MODELS
    }
    size = float(np.sqrt(np.nanmean(raw["before"] ** 2)))
    unit, per_si = SHOWN_UNITS[UNITS[channel]][size > LARGE]
    return {side: per_si * values for side, values in raw.items()}, unit


def caption(result: Identification) -> str:
    """Return what the picture shows."""
    picture = shown_trial(result)
    assert picture is not None
    role = "held-out trial" if picture.held_out else "trial"
    body = tracked_body(picture)
    beside = " Left: the declared model; right: the repaired one." if has_repair(result) else ""
    if body is None:
        several = "the declared and the repaired model" if has_repair(result) else "the declared model"
        return (
            f"Measured less predicted by {several}, in the {role} {picture.trial}. A right model leaves only scatter about 0."
        )
    return f"{_vectors_in_words(picture, body, role)}{beside}"


def _vectors_in_words(picture: TrialFigure, body: str, role: str) -> str:
    _, factor = residual_vectors(picture, body)
    longer = f", drawn {factor:g} times as long as it is" if factor > 1 else ""
    return (
        f"Motion of the {BODY_IN_WORDS[body]} in the {role} {picture.trial}. Each line leads from the model to the tracked "
        f"point{longer}. A right model leaves lines in all directions; where neighbouring lines point the same way, it is off."
    )


def draw(result: Identification, colours: Mapping[str, str]) -> Drawing:
    """Draw the picture with Matplotlib; ``colours``: field of the model -> colour."""
    picture = shown_trial(result)
    assert picture is not None
    body = tracked_body(picture)
    return _draw_over_time(result, picture, colours) if body is None else _draw_motion(result, picture, body, colours)


def _draw_motion(result: Identification, picture: TrialFigure, body: str, colours: Mapping[str, str]) -> Drawing:
    shown = models(result)
    vectors, factor = residual_vectors(picture, body)
    ends = np.concatenate([vectors[side].tips for side, _, _ in shown])
    width, height = np.maximum(np.ptp(ends, axis=0), 1e-9)
    drawing = new_figure(4.8 * len(shown), 1.0 + min(max(4.2 * height / width, 2.0), 5.0))
    panels = drawing.subplots(1, len(shown), sharex=True, sharey=True, squeeze=False)[0]
    for axes, (side, label, _) in zip(panels, shown, strict=True):
        v = vectors[side]
        lines = np.stack([v.path, v.tips], axis=1)
        axes.plot(*_with_gaps(lines), "-", lw=0.8, color=colours[side])
        axes.plot(v.path[:, 0], v.path[:, 1], "-", lw=1.2, color="black")
        axes.set_title(label + (f" (residuals x {factor:g})" if factor > 1 else ""), fontsize=10)
        axes.set_aspect("equal", adjustable="box")
        axes.set_xlabel("x [m]")
    panels[0].set_ylabel("y [m]")
    return drawing


def _draw_over_time(result: Identification, picture: TrialFigure, colours: Mapping[str, str]) -> Drawing:
    drawing = new_figure(8.0, 1.0 + 2.6 * len(picture.channels))
    panels = drawing.subplots(len(picture.channels), 1, sharex=True, squeeze=False)[:, 0]
    for axes, channel in zip(panels, picture.channels, strict=True):
        residuals, unit = residuals_over_time(picture, channel)
        axes.axhline(0, color=GREY, lw=0.8)
        for side, label, _ in models(result):
            axes.plot(picture.t[channel], residuals[side], ".-", lw=0.8, ms=4, color=colours[side], label=label)
        axes.set_ylabel(f"{without_mathtext(channel)}: measured\nless predicted [{unit}]")
    panels[0].legend(fontsize=9)
    panels[-1].set_xlabel("time by the file's clock [s]")
    return drawing


def page_figures(result: Identification, colours: Mapping[str, str]) -> list[Figure]:
    """Return the picture for the page, one figure for each panel; ``colours``: field of the model -> colour of the page."""
    picture = shown_trial(result)
    if picture is None:
        return []
    body = tracked_body(picture)
    return [_page_over_time(result, picture, colours)] if body is None else _page_motion(result, picture, body, colours)


def _page_motion(result: Identification, picture: TrialFigure, body: str, colours: Mapping[str, str]) -> list[Figure]:
    shown = models(result)
    vectors, factor = residual_vectors(picture, body)
    # The same square for all, so that they can be compared: a margin of 5 % around everything
    ends = np.concatenate([part for side, _, _ in shown for part in (vectors[side].path, vectors[side].tips)])
    centre, half = (ends.max(axis=0) + ends.min(axis=0)) / 2, 0.55 * float(np.max(np.ptp(ends, axis=0)))
    axis = [{"range": plain([c - half, c + half]), "title": {"text": f"{n} [m]"}} for n, c in zip("xy", centre, strict=True)]
    words = _vectors_in_words(picture, body, "held-out trial" if picture.held_out else "trial")
    charts = []
    for i, (side, label, number) in enumerate(shown):
        v = vectors[side]
        x, y = _with_gaps(np.stack([v.path, v.tips], axis=1))
        lines = {
            "type": "scatter",
            "mode": "lines",
            "x": plain(x),
            "y": plain(y),
            "name": "residuals",
            "hoverinfo": "skip",
            "showlegend": False,
        }
        path = {
            "type": "scatter",
            "mode": "lines",
            "x": plain(v.path[:, 0]),
            "y": plain(v.path[:, 1]),
            "name": label,
            "showlegend": False,
        }
        charts.append(
            Figure(
                id=f"motion-{number}",
                caption=f"{label.capitalize()}. {words}" if i == 0 else f"{label.capitalize()}, drawn in the same way.",
                traces=(lines | {"line": {"color": colours[side], "width": 1}}, path | {"line": {"color": INK, "width": 1.5}}),
                layout={
                    # On the left and in two lines: the buttons of Plotly are on the right, and a phone is narrow
                    "title": {
                        "text": label + (f"<br>(residuals x {factor:g})" if factor > 1 else ""),
                        "font": {"size": 14},
                        "x": 0.0,
                        "xanchor": "left",
                    },
                    "xaxis": axis[0] | {"constrain": "domain"},
                    "yaxis": axis[1] | {"scaleanchor": "x", "constrain": "domain"},
                    "margin": {"t": 40, "b": 50},
                },
            )
        )
    return charts


def _page_over_time(result: Identification, picture: TrialFigure, colours: Mapping[str, str]) -> Figure:
    traces: list[dict[str, Any]] = []
    layout: dict[str, Any] = {"shapes": []}
    count = len(picture.channels)
    for i, channel in enumerate(picture.channels):
        residuals, unit = residuals_over_time(picture, channel)
        axis = "y" if i == 0 else f"y{i + 1}"
        layout[f"yaxis{i + 1 if i else ''}"] = {
            "title": {"text": f"{escaped(channel)} [{unit}]"}, "domain": [1 - (i + 0.9) / count, 1 - i / count]
        }  # fmt: skip
        layout["shapes"].append(horizontal(0, axis))
        for side, label, _ in models(result):
            style = {"color": colours[side], "size": 6}
            t, values = plain(picture.t[channel]), plain(residuals[side], 4)
            traces.append(points(label, t, values, colours[side], marker=style, mode="lines+markers", yaxis=axis,
                                 line={"color": colours[side], "width": 1}, showlegend=i == 0))  # fmt: skip
    layout["xaxis"] = {"title": {"text": "time by the file's clock [s]"}, "anchor": f"y{count}" if count > 1 else "y"}
    return Figure(id="motion-0", caption=caption(result), traces=tuple(traces), layout=layout, height=160 + 220 * count)


def _with_gaps(lines: Array) -> tuple[Array, Array]:
    """Return x and y of lines of shape (n, 2, 2) as one line with a gap (NaN) after each."""
    gap = np.full((len(lines), 1, 2), np.nan)
    joined = np.concatenate([lines, gap], axis=1).reshape(-1, 2)
    return joined[:, 0], joined[:, 1]
