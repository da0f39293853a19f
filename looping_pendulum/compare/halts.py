"""The report's section on halting: how its time depends on what counts as sliding, and what the string does after it."""

from __future__ import annotations

from looping_pendulum.compare.result import ComparisonResult
from looping_pendulum.compare.slides import COARSE, RESOLUTION
from looping_pendulum.compare.tables import GAP, fixed, number, table
from looping_pendulum.pages.numbers import quantity

SAME_HALT = 5e-4
"""Halting times that are closer than half a sample interval [s] are one."""


def render(result: ComparisonResult) -> list[str]:
    """Return the section, or nothing where no run halts."""
    runs = [("reference", result.reference.sampled), *((f"{e.label}, {e.profile}", e.landmarks) for e in result.engines)]
    runs = [(label, found) for label, found in runs if found.halting_times]
    if not any(each.time is not None for _, found in runs for each in found.halting_times):
        return []
    head = ["run", *(f"halts, to {quantity(each.resolution, 'm')} [s]" for each in runs[0][1].halting_times)]
    head += ["blurred by [ms]", "moves after by [mm]", "at up to [mm/s]"]
    rows = []
    for label, found in runs:
        then = found.rebound
        row = [label, *(fixed(each.time, 4) for each in found.halting_times), number(found.halting_time_blur, 1e3, 2)]
        rows.append([*row, *([GAP, GAP] if then is None else [number(then.travel, 1e3, 2), number(then.speed, 1e3, 2)])])
    return [f"## When does it halt?\n\n{_meaning()} {_against_events(result)}\n\n{_gaps(result)}{table(head, rows)}"]


def _meaning() -> str:
    return (
        f"A string halts when it stops sliding and does not slide by more than {quantity(RESOLUTION, 'm')} again until the "
        "light mass reaches the rod, or the run ends. The time is read from samples: of the string's slip over the rod where "
        "an engine tells it, else of the heavy mass's height, and in the same way for the reference. The table has it for several "
        f"resolutions, and by how much a quarter more or less than {quantity(RESOLUTION, 'm')} moves it: its blur. The last "
        f"columns say what the string still does once it stays within {quantity(COARSE, 'm')}: it rebounds, or creeps."
    )


def _against_events(result: ComparisonResult) -> str:
    """Hold what the samples of the reference give against its own events: the detector's error on this run."""
    exact, seen = result.reference.landmarks.halting_time, result.reference.sampled.halting_time
    if exact is None and seen is None:
        return "By its own events the reference does not halt either."
    if exact is not None and seen is not None and abs(seen - exact) <= SAME_HALT:
        off = quantity(abs(seen - exact), "s")
        return f"By its own events the reference halts at {exact:.6f} s, so this way of reading is off by {off}."
    own = "does not halt" if exact is None else f"halts at {exact:.4f} s"
    return f"By its own events the reference {own}: what it still slides until then is finer than this way of reading resolves."


def _gaps(result: ComparisonResult) -> str:
    lines = [f"- {e.label}, {e.profile}: not comparable: {e.not_comparable}.\n" for e in result.engines if e.not_comparable]
    return "".join(lines) + "\n" if lines else ""
