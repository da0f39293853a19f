"""Measured events beside both models: a table, the error of each unit, and a figure."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.figure import Figure

from looping_pendulum.compare.paper_table import quantity_words
from looping_pendulum.compare.plots import literal
from looping_pendulum.compare.tables import GAP, number, signed, table
from looping_pendulum.discrepancy.fit.event_prediction import MISSED
from looping_pendulum.discrepancy.result import EventResidual, Identification

FARTHEST = 15.0
"""Largest residual that the figure shows in its place [standard errors]; events that do not happen stand there as crosses."""
SHOWN_IN = {"s": (1e3, "ms"), "m": (1e3, "mm"), "rad": (1e3, "mrad")}
"""SI unit -> factor and unit of the errors."""


def section(result: Identification) -> str:
    """Return the section, empty if no event was measured."""
    if not result.events:
        return ""
    head = ["trial", "seen by the fit?", "event", "unit", "measured", "+/-", "before", "off by", "after", "off by"]
    rows = [
        [e.trial, "no" if e.held_out else "yes", quantity_words(e.quantity, e.index), e.unit or GAP,
         number(e.measured, digits=4), number(e.sigma, digits=2), number(e.before, digits=4), off_by(e, e.before),
         number(e.after, digits=4), off_by(e, e.after)]
        for e in result.events
    ]  # fmt: skip
    note = (
        "Off by: measured less predicted, in standard errors. An event without a prediction does not happen in that model's "
        f"run, and counts as missed by {MISSED:g} standard errors.\n\n"
    )
    return "## Events\n\n" + note + table(head, rows, left=4) + "\n" + _by_unit(result)


def off_by(event: EventResidual, predicted: float | None) -> str:
    """Measured less predicted in standard errors, in words."""
    return "does not happen" if predicted is None else signed((event.measured - predicted) / event.sigma, digits=2)


def _by_unit(result: Identification) -> str:
    rows = [
        [e.trial, "no" if e.held_out else "yes", SHOWN_IN[unit][1], number(e.events_before.get(unit), SHOWN_IN[unit][0]),
         number(e.events_after.get(unit), SHOWN_IN[unit][0])]
        for e in result.errors
        for unit in sorted({*e.events_before, *e.events_after})
        if unit in SHOWN_IN
    ]  # fmt: skip
    return table(["trial", "seen by the fit?", "unit", "RMS of its events before", "after"], rows, left=3) if rows else ""


def figure(events: Sequence[EventResidual], before: str, after: str) -> Figure:
    """Residuals of every event, by trial from above; ``before`` and ``after`` are colours."""
    drawn = Figure(figsize=(7.5, 1.2 + 0.24 * len(events)), layout="constrained")
    axes = drawn.subplots()
    axes.axvspan(-2, 2, color="0.92")
    axes.axvline(0, color="black", lw=0.8)
    for side, colour, label in (("before", before, "declared"), ("after", after, "repaired")):
        known = [(i, e, getattr(e, side)) for i, e in enumerate(events)]
        places = [(max(min((e.measured - v) / e.sigma, FARTHEST), -FARTHEST), i) for i, e, v in known if v is not None]
        axes.plot([x for x, _ in places], [y for _, y in places], "o", ms=4, color=colour, label=label)
        missing = [i for i, _, v in known if v is None]
        axes.plot([FARTHEST] * len(missing), missing, "x", ms=6, color=colour)
    names = [f"{literal(e.trial)}{' (held out)' if e.held_out else ''}: {quantity_words(e.quantity, e.index)}" for e in events]
    axes.set_yticks(range(len(events)), names, fontsize=8)
    axes.invert_yaxis()
    axes.set_xlim(-1.05 * FARTHEST, 1.05 * FARTHEST)
    axes.set_xlabel("measured less predicted [standard errors]")
    axes.legend(fontsize=8, loc="lower right")
    return drawn
