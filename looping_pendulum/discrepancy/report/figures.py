"""The figures of a report as data: report.md and report.html draw the same.

The first is of the trial that the verdict's sentence speaks of: its motion with the residual of every point as a line,
magnified, or, where no mass's position was tracked, what was tracked over time; of a study of events alone, the events.
"""

from __future__ import annotations

import math
import textwrap
from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from looping_pendulum.compare.figures import charts as charts_of_comparison
from looping_pendulum.compare.result import ComparisonResult
from looping_pendulum.discrepancy.fit_study import StudyFit
from looping_pendulum.discrepancy.formulas import Unlisted
from looping_pendulum.discrepancy.look.check import DeclarationCheck
from looping_pendulum.discrepancy.look.mistakes import Distance
from looping_pendulum.discrepancy.report.markdown import SIDES, off_by, probability_in_words
from looping_pendulum.discrepancy.result import Identification, PredictedTrial
from looping_pendulum.discrepancy.verdict import BODY_IN_WORDS, worst_trial
from looping_pendulum.files import file_stems
from looping_pendulum.measured.observations import BODIES
from looping_pendulum.pages.chart import (
    BLACK,
    DARK_GREY,
    Chart,
    ChartAxis,
    Curve,
    Guide,
    Panel,
    make_charts,
    reach,
    with_room,
)
from looping_pendulum.pages.drawing import draw
from looping_pendulum.pages.palette import COLOURS, GREY
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.runs.events import quantity_label

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MODEL_COLOURS = {"before": COLOURS[1], "after": COLOURS[0]}
"""Key of a model in `PredictedTrial` -> its colour."""
VECTOR_SHARE = 0.1
"""Length of the declared model's RMS residual in the picture, as a share of the motion's size; no magnification exceeds it."""
CLOCK = ChartAxis(label="time by the file's clock [s]")
POINTS: dict[str, Any] = {"marker": "o", "size": 2.4}
"""Look of tracked points and of residuals."""
OUTLIER = "outlier, left out"
NOISE_BAND = 2.0
"""Half-width of the bands that hold 95 % of mere noise [standard errors]."""
AXIS_LIMIT = 15.0
"""Largest residual of an event on the axis [standard errors]; larger ones and events that do not happen are drawn there."""
MAX_LINES, LABEL_WIDTH = 6, 28
"""Lines of a name beside an axis, and characters in a line of it: half of a phone's width."""
FIRST_LOOK = "first-look"
"""Name of the figure of a first look."""
MAX_TRIALS = 4
"""Largest number of trials that are shown of a first look."""
PANEL = 3.4
"""Width and height of one of its panels [inches]."""
TITLE_WIDTH = 42
"""Characters in a line of a panel's title."""


def draw_all(result: Identification | StudyFit | ComparisonResult) -> dict[str, Figure]:
    """Return the figures of a result by their names, drawn by Matplotlib; one that cannot be made is left out with a warning.

    They are not pyplot's, so that nothing has to be closed: ``figures["motion"].savefig("motion.png")``.
    """
    if isinstance(result, ComparisonResult):
        made = charts_of_comparison(result)
    elif isinstance(result, Identification):
        made = charts(result)
    else:
        stems = file_stems([("trial", t.data.trial.name) for t in result.trials])
        pairs = zip(stems, result.trials, strict=True)
        models = (("before", "declared model"),)
        made = [trial_chart(models, trial, stem) for stem, trial in pairs if trial.data.channels]
    return {chart.id: draw(chart) for chart in made}


def charts(result: Identification) -> list[Chart]:
    """Return every figure that the result has data for, the first of the report first; what cannot be made is left out."""
    look = result.first_look
    worst = worst_trial(result.errors).trial if result.errors else ""
    trials = sorted(result.trial_figures, key=lambda figure: figure.data.trial.name != worst)
    stems = file_stems([("trial", figure.data.trial.name) for figure in trials])
    of_trials = {stem: partial(trial_chart, _models(result), figure, stem) for stem, figure in zip(stems, trials, strict=True)}
    makers: dict[str, Callable[[], Chart | None]] = {"motion": partial(motion_chart, result), **of_trials}
    if look is not None and look.notes:
        makers[FIRST_LOOK] = partial(first_look_chart, look)
    if result.events:
        makers["events"] = partial(events_chart, result)
    if len(result.explanations) > 1:
        makers["explanations"] = partial(explanations_chart, result)
    if result.unlisted is not None:
        makers["unlisted-force"] = partial(unlisted_chart, result, result.unlisted)
    return make_charts(makers)


def _models(result: Identification) -> tuple[tuple[str, str], ...]:
    """Return key and label of each model that differs."""
    return (("before", "declared model"), *([("after", result.other_model)] if result.has_other_model else []))


def in_lines(name: str) -> str:
    """Return a name in lines of at most `LABEL_WIDTH` characters, since that of a law is too long for one line."""
    return "\n".join(textwrap.wrap(name, LABEL_WIDTH, max_lines=MAX_LINES, placeholder="..."))


def _rows(names: Sequence[str]) -> tuple[ChartAxis, float]:
    """Return the axis of rows with these names, the first on top, and the height of a figure with it [inches]."""
    ticks = {float(i): in_lines(name) for i, name in enumerate(names)}
    lines = max((words.count("\n") + 1 for words in ticks.values()), default=1)
    return ChartAxis(limits=(len(names) - 0.5, -0.5), ticks=ticks), 1.8 + (0.2 + 0.15 * lines) * len(names)


def residual_vectors(picture: PredictedTrial, body: str) -> tuple[dict[str, tuple[Array, Array]], float]:
    """Return key of the model ("before", "after") -> residual vectors, and the factor by which they are magnified.

    Residual vectors lead from positions by the model to these plus the magnified residual [m], both of shape (n, 2). The factor
    is one of 1, 2, 5, 10, 20, ...
    """
    data = picture.data
    x, y = (data.slices[name] for name in BODIES[body])
    _, ix, iy = np.intersect1d(data.t[x], data.t[y], return_indices=True)
    used = ~(data.is_outlier[x][ix] | data.is_outlier[y][iy])
    ix, iy = ix[used], iy[used]

    def both(values: Array) -> Array:
        return np.column_stack([values[x][ix], values[y][iy]])

    measured = both(data.value)
    paths = {model: both(values) for model, values in picture.predicted.items()}
    size = float(np.max(np.ptp(measured, axis=0), initial=0.0))
    rms = float(np.sqrt(np.mean(np.sum((measured - paths["before"]) ** 2, axis=1)))) if len(measured) else 0.0
    factor = 1.0
    if rms > 0 and (largest := VECTOR_SHARE * size / rms) >= 1:
        power = 10.0 ** math.floor(math.log10(largest))
        factor = power * max(step for step in (1, 2, 5) if step * power <= largest)
    return {model: (path, path + factor * (measured - path)) for model, path in paths.items()}, factor


def motion_chart(result: Identification) -> Chart | None:
    """Return the motion with residual vectors by each model; None: no mass's position was tracked in both directions."""
    tracked = [
        (figure, body)
        for figure in result.trial_figures
        for body, names in BODIES.items()
        if len(names) == 2 and set(names) <= set(figure.data.slices)
    ]
    if not tracked:
        return None
    models, name = _models(result), worst_trial(result.errors).trial
    # The trial that the verdict's sentence speaks of, or else the first that was tracked
    figure, body = next((one for one in tracked if one[0].data.trial.name == name), tracked[0])
    vectors, factor = residual_vectors(figure, body)
    # The same limits for all, so that they can be compared
    shown = [part for side, _ in models for part in vectors[side]]
    x, y = with_room(*(reach([part[:, k] for part in shown]) for k in (0, 1)))
    panels = []
    for side, label in models:
        path, tips = vectors[side]
        ends = np.stack([path, tips], axis=1).reshape(-1, 2).T
        curves = [
            Curve(label="", x=ends[0], y=ends[1], colour=MODEL_COLOURS[side], width=0.8, in_pairs=True),
            Curve(label=label, x=path[:, 0], y=path[:, 1], width=1.2, in_legend=False),
        ]
        title = label + (f"\n(residuals x {factor:g})" if factor > 1 else "")
        panels.append(Panel(curves=curves, y=ChartAxis(label="y [m]", limits=y), title=title, to_scale=True))
    role = "held-out trial" if figure.held_out else "trial"
    beside = f", of the declared and of the {result.other_model}" if result.has_other_model else ""
    longer = f", drawn {factor:g} times as long as it is" if factor > 1 else ""
    return Chart(
        id="motion",
        caption=f"Motion of the {BODY_IN_WORDS[body]} in the {role} {figure.data.trial.name}{beside}. Each line leads "
        f"from the model to the tracked point{longer}. A right model leaves lines in all directions; where neighbouring "
        "lines point the same way, it is off.",
        subject=figure.data.trial.name,
        title=f"motion of the {BODY_IN_WORDS[body]}",
        x=ChartAxis(label="x [m]", limits=x),
        panels=panels,
        size=(4.8 * len(models), 1.6 + min(4.2 * (y[1] - y[0]) / (x[1] - x[0]), 5.0)),
        columns=len(models),
    )


def trial_chart(models: Sequence[tuple[str, str]], picture: PredictedTrial, name: str) -> Chart:
    """Return tracked points and the models of one trial over time, and below them the residuals of each channel.

    Parameters
    ----------
    models
        Pairs of the key of a model in ``picture`` and its label.
    """
    top: list[Curve] = []
    below = []
    data = picture.data
    for i, (channel, part) in enumerate(data.slices.items()):
        t, measured, is_outlier = data.t[part], data.value[part], data.is_outlier[part]
        colour = COLOURS[i % len(COLOURS)]
        top.append(Curve(label=f"{channel}, tracked", x=t, y=measured, colour=colour, **POINTS))
        residuals = []
        for side, label in models:
            look: dict[str, Any] = {"dashes": (6, 3), "colour": GREY} if side == "before" else {}
            # The models have one entry in the legend for all channels
            top.append(Curve(label=label, x=t, y=picture.predicted[side][part], width=0.9, in_legend=i == 0, **look))
            look = POINTS | {"colour": MODEL_COLOURS[side], "in_legend": i == 0}
            residuals.append(Curve(label=f"residual, {label}", x=t, y=picture.residuals[side][part], **look))
        if is_outlier.any():
            named = any(curve.label == OUTLIER for curve in top)
            look = {"colour": colour, "marker": "x", "size": 5.0, "in_legend": not named}
            top.append(Curve(label=OUTLIER, x=t[is_outlier], y=measured[is_outlier], **look))
        guide = Guide(y=0.0, half_width=NOISE_BAND)
        below.append(Panel(curves=residuals, y=ChartAxis(label=channel), guides=[guide], height=5))
    return Chart(
        id=name,
        caption=f"Trial {data.trial.name} ({'held out' if picture.held_out else 'training'}): tracked points and models; "
        f"below, residuals in units of noise (band: {NOISE_BAND:g}).",
        subject=data.trial.name,
        title="tracked points and models",
        x=CLOCK,
        panels=[Panel(curves=top, y=ChartAxis(label="measured [SI]"), height=12), *below],
        size=(9.0, 3.8 + 1.3 * len(data.channels)),
    )


def events_chart(result: Identification) -> Chart:
    """Return the residuals of all events, by trial from above."""
    events = result.events
    names = [
        f"{e.trial}{' (held out)' if e.held_out else ''}: {quantity_label(e.event.quantity, e.event.index)}" for e in events
    ]
    rows, height = _rows(names)
    curves = []
    for side, label in _models(result):
        predictions = [(i, e, getattr(e, side)) for i, e in enumerate(events)]
        happens = [(i, (e.event.value - v) / e.event.sigma) for i, e, v in predictions if v is not None]
        missing = [i for i, _, v in predictions if v is None]
        words = [f"{name}: {off_by(e.event, v)}" for name, (_, e, v) in zip(names, predictions, strict=True)]
        look: dict[str, Any] = {"label": label, "colour": MODEL_COLOURS[side], "size": 6.0}
        if happens:
            at = np.clip([z for _, z in happens], -AXIS_LIMIT, AXIS_LIMIT)
            rows_of = [i for i, _ in happens]
            curves.append(Curve(x=at, y=rows_of, marker="o", words=[words[i] for i in rows_of], **look))
        if missing:
            look |= {"marker": "x", "words": [words[i] for i in missing], "in_legend": not happens}
            curves.append(Curve(x=[AXIS_LIMIT] * len(missing), y=missing, **look))
    return Chart(
        id="events",
        caption=f"Measured less predicted events in standard errors (band: {NOISE_BAND:g}); those beyond {AXIS_LIMIT:g} are "
        "drawn at the edge; a cross: the event does not happen in that model's run.",
        subject=result.title,
        title="events",
        x=ChartAxis(label="residual\n[standard errors]", limits=(-1.05 * AXIS_LIMIT, 1.05 * AXIS_LIMIT)),
        panels=[Panel(curves=curves, y=rows, guides=[Guide(x=0.0, colour=BLACK, half_width=NOISE_BAND)])],
        size=(7.5, height),
    )


def explanations_chart(result: Identification) -> Chart:
    """Return the odds of the explanations against that nothing is missing as bars."""
    shown = [e for e in result.explanations if e.names]
    rows, height = _rows([f"{probability_in_words(e.probability)}: {' + '.join(e.names)}" for e in shown])
    bars = []
    for label, credible, colour in (("95 % of the probability", True, MODEL_COLOURS["after"]), ("others", False, GREY)):
        # At places of their own: two laws may have one name
        chosen = [(i, e) for i, e in enumerate(shown) if e.credible == credible]
        if chosen:
            ends = [end for _, e in chosen for end in (0.0, e.log10_odds)]
            at = [i for i, _ in chosen for _ in range(2)]
            bars.append(Curve(label=label, x=ends, y=at, colour=colour, width=12, in_pairs=True))
    return Chart(
        id="explanations",
        caption="How much more probable each explanation is than that nothing is missing, in powers of ten, and its "
        "probability; blue: together these have 95 %.",
        subject=result.title,
        title="explanations",
        x=ChartAxis(label="odds, powers of ten"),
        panels=[Panel(curves=bars, y=rows, guides=[Guide(x=0.0, colour=BLACK)])],
        size=(7.0, height),
    )


def unlisted_chart(result: Identification, force: Unlisted) -> Chart:
    """Return the force in every direction with a band of two standard errors, and the formula."""
    curves = []
    for i, p in enumerate(force.profiles):
        colour, band = COLOURS[i % len(COLOURS)], NOISE_BAND * np.array(p.error)
        curves.append(Curve(label=SIDES[p.side], x=p.coordinate, y=p.value, colour=colour, width=1.5, band=band))
        if p.formula_values is not None:
            look: dict[str, Any] = {"colour": colour, "width": 1.5, "dashes": (4, 2)}
            curves.append(Curve(label="its formula", x=p.coordinate, y=p.formula_values, **look))
    return Chart(
        id="unlisted-force",
        caption="The unlisted force along its coordinate; bands: two standard errors.",
        subject=result.title,
        title="unlisted law",
        x=ChartAxis(label=f"{force.law.coordinate.replace('_', ' ')} [{force.unit}]"),
        panels=[
            Panel(
                curves=curves, y=ChartAxis(label=f"unlisted law [{force.value_unit or 1}]"), guides=[Guide(y=0.0, colour=BLACK)]
            )
        ],
        size=(8.0, 4.2),
    )


def first_look_chart(check: DeclarationCheck) -> Chart | None:
    """Return what a first look compares, before any fit; None: no trial has points to show.

    Each trial has a panel as it is declared and, if a mistake was named in it, one beside it without the mistake. Trials with
    mistakes come first.
    """
    corrected = {trial: (m.keys, distance) for m in check.mistakes for trial, distance in m.corrected.items()}
    mistaken = {trial for mistake in check.mistakes for trial in mistake.trials}
    checks = sorted(check.trials, key=lambda one: (one.trial not in corrected, one.trial not in mistaken))
    shown = [(one.trial, one.distance) for one in checks if one.distance is not None][:MAX_TRIALS]
    panels: list[Panel] = []
    for trial, distance in shown:
        panels.append(_declared_panel(distance, f"trial {trial}, as declared", named=not panels))
        if trial in corrected:
            keys, without_mistake = corrected[trial]
            panels.append(_declared_panel(without_mistake, f"with '{keys}'", named=False))
    if not panels:
        return None
    columns = min(2, len(panels))
    return Chart(
        id=FIRST_LOOK,
        caption="Tracked points of the first part of each trial, and the motion that the study declares (lines), before "
        "anything is fitted.",
        subject="first look",
        title="points and declared motion",
        x=CLOCK,
        panels=panels,
        size=(PANEL * columns + 0.4, 0.8 + PANEL * -(-len(panels) // columns)),
        columns=columns,
    )


def _declared_panel(distance: Distance, title: str, *, named: bool) -> Panel:
    """Return the tracked points and the declared motion: paths to scale; ``named``: its curves stand in the legend."""
    motions, are_paths = declared_motions(distance)
    curves = []
    for i, (label, tracked, motion) in enumerate(motions):
        colour, first = COLOURS[i % len(COLOURS)], named and i == 0
        curves.append(Curve(label=label, x=tracked[:, 0], y=tracked[:, 1], colour=colour, in_legend=named, **POINTS))
        curves.append(Curve(label="declared motion", x=motion[:, 0], y=motion[:, 1], width=1.2, in_legend=first))
        if are_paths:
            start = motion[:1].T
            curves.append(Curve(label="its start", x=start[0], y=start[1], marker="o", hollow=True, in_legend=first))
    title = "\n".join(textwrap.wrap(title, TITLE_WIDTH, max_lines=2, placeholder="..."))
    if not are_paths:
        return Panel(curves=curves, y=ChartAxis(label="measured [SI]"), title=title)
    curves.append(Curve(label="origin", x=[0.0], y=[0.0], colour=DARK_GREY, marker="P", size=6.0, in_legend=named))
    x, y = with_room(reach([curve.x for curve in curves]), reach([curve.y for curve in curves]))
    axes = ChartAxis(label="x [m]", limits=x), ChartAxis(label="y [m]", limits=y)
    return Panel(curves=curves, x=axes[0], y=axes[1], title=title, to_scale=True)


def declared_motions(distance: Distance) -> tuple[list[tuple[str, Array, Array]], bool]:
    """Return label, tracked points and declared motion of each mass that was tracked, and whether these are paths.

    Where no mass was tracked in both directions, they are every channel against time. Points have shape (n, 2).
    """
    named = {channel.name: (channel, predicted) for channel, predicted in distance.points}
    paths = []
    for body, names in BODIES.items():
        if len(names) == 2 and named.keys() >= set(names):
            (x, x_predicted), (y, y_predicted) = (named[n] for n in names)
            _, in_x, in_y = np.intersect1d(x.t, y.t, return_indices=True)
            tracked = np.column_stack([x.value[in_x], y.value[in_y]])
            paths.append((f"{body}, tracked", tracked, np.column_stack([x_predicted[in_x], y_predicted[in_y]])))
    if paths:
        return paths, True
    return [
        (f"{name}, measured", np.column_stack([channel.t, channel.value]), np.column_stack([channel.t, predicted]))
        for name, (channel, predicted) in named.items()
    ], False
