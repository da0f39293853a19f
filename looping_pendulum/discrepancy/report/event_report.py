"""Report measured events beside the predictions of both models: a table, the error by unit, and a figure."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from looping_pendulum.compare.landmarks import quantity_label
from looping_pendulum.compare.tables import GAP, number, signed, table
from looping_pendulum.discrepancy.fit.event_prediction import MISSED_EVENT_ERRORS
from looping_pendulum.discrepancy.result import Identification
from looping_pendulum.discrepancy.trial_results import EventResidual
from looping_pendulum.pages.drawing import new_figure, without_mathtext
from looping_pendulum.pages.numbers import DISPLAY_UNITS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

AXIS_LIMIT = 15.0
"""Largest residual on the axis [standard errors]; larger ones are drawn there, and as crosses the events that do not happen."""


def section(result: Identification) -> str:
    """Return the section on events; empty if none was measured."""
    if not result.events:
        return ""
    head = ["trial", "held out?", "event", "unit", "measured", "+/-", "declared model", "off by", "repaired model", "off by"]
    rows = [
        [e.trial, "yes" if e.held_out else "no", quantity_label(e.quantity, e.index), e.unit or GAP,
         number(e.measured, digits=4), number(e.sigma, digits=2), number(e.before, digits=4), off_by(e, e.before),
         number(e.after, digits=4), off_by(e, e.after)]
        for e in result.events
    ]  # fmt: skip
    note = (
        "Off by: measured less predicted, in standard errors. An event without a prediction does not happen in that model's "
        f"run, and counts as missed by {MISSED_EVENT_ERRORS:g} standard errors.\n\n"
    )
    return "## Events\n\n" + note + table(head, rows, left=4) + "\n" + _by_unit(result)


def off_by(event: EventResidual, predicted: float | None) -> str:
    """Return measured less predicted in standard errors, in words."""
    return "does not happen" if predicted is None else signed((event.measured - predicted) / event.sigma, digits=2)


def _by_unit(result: Identification) -> str:
    """Return the table of RMS errors of events by trial and unit; empty if there are none."""
    rows = [
        [e.trial, "yes" if e.held_out else "no", DISPLAY_UNITS[unit].name,
         *(number(errors.get(unit), DISPLAY_UNITS[unit].per_si_unit) for errors in (e.events_before, e.events_after))]
        for e in result.errors
        for unit in sorted({*e.events_before, *e.events_after})
        if unit in DISPLAY_UNITS
    ]  # fmt: skip
    return (
        table(["trial", "held out?", "unit", "RMS of its events, declared model", "repaired model"], rows, left=3)
        if rows
        else ""
    )


def figure(events: Sequence[EventResidual], before: str, after: str) -> Figure:
    """Draw the residuals of all events, by trial from above; ``before`` and ``after`` are the colours of the two models."""
    chart = new_figure(7.5, 1.2 + 0.24 * len(events))
    axes = chart.subplots()
    axes.axvspan(-2, 2, color="0.92")
    axes.axvline(0, color="black", lw=0.8)
    for side, colour, label in (("before", before, "declared"), ("after", after, "repaired")):
        predictions = [(i, e, getattr(e, side)) for i, e in enumerate(events)]
        positions = [
            (max(min((e.measured - v) / e.sigma, AXIS_LIMIT), -AXIS_LIMIT), i) for i, e, v in predictions if v is not None
        ]
        axes.plot([x for x, _ in positions], [y for _, y in positions], "o", ms=4, color=colour, label=label)
        missing = [i for i, _, v in predictions if v is None]
        axes.plot([AXIS_LIMIT] * len(missing), missing, "x", ms=6, color=colour)
    names = [
        f"{without_mathtext(e.trial)}{' (held out)' if e.held_out else ''}: {quantity_label(e.quantity, e.index)}"
        for e in events
    ]
    axes.set_yticks(range(len(events)), names, fontsize=8)
    axes.invert_yaxis()
    axes.set_xlim(-1.05 * AXIS_LIMIT, 1.05 * AXIS_LIMIT)
    axes.set_xlabel("measured less predicted [standard errors]")
    axes.legend(fontsize=8, loc="lower right")
    return chart
