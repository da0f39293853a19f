"""Renders the report's section on halting: how the time depends on the resolution, and how the string rebounds."""

from __future__ import annotations

from looping_pendulum.compare.result import ComparisonResult
from looping_pendulum.compare.tables import GAP, fixed, number, table
from looping_pendulum.engines.string_motion import FIRST_REST_RESOLUTION, RESOLUTION
from looping_pendulum.pages.numbers import quantity

HALT_AGREEMENT = 5e-4
"""Largest difference of two halting times that are called equal [s]: half a sample interval."""


def render(result: ComparisonResult) -> list[str]:
    """Return the section, or nothing where no run halts."""
    runs = [("reference", result.reference.sampled), *((f"{e.label}, {e.profile}", e.landmarks) for e in result.engines)]
    # A run with hardly any samples has no landmarks at all
    runs = [(label, landmarks) for label, landmarks in runs if landmarks.halting_times]
    if not any(each.time is not None for _, landmarks in runs for each in landmarks.halting_times):
        return []
    # The first run stands for all: one detector reads them, with the same resolutions
    head = ["run", *(f"halts, to within {quantity(each.resolution, 'm')} [s]" for each in runs[0][1].halting_times)]
    head += ["uncertainty [ms]", "rebound [mm]", "rebound speed, at most [mm/s]"]
    rows = []
    for label, landmarks in runs:
        rebound = landmarks.rebound
        row = [label, *(fixed(each.time, 4) for each in landmarks.halting_times)]
        row.append(number(landmarks.halting_time_uncertainty, 1e3, 2))
        rows.append([*row, *([GAP, GAP] if rebound is None else [number(x, 1e3, 2) for x in (rebound.travel, rebound.speed)])])
    text = f"{_definition()} {_check_against_events(result)}"
    return [f"## When does it halt?\n\n{text}\n\n{_not_comparable(result)}{table(head, rows)}"]


def _definition() -> str:
    return (
        f"A string halts when it stops sliding and does not slide by more than {quantity(RESOLUTION, 'm')} again until the "
        "light mass reaches the rod, or the run ends. The time is read from samples, in the same way for the reference and for "
        "every engine: from the string's slip over the rod where the engine reports it, otherwise from the heavy mass's "
        "height. The table gives it for several resolutions. Its uncertainty is how far it moves if the "
        f"{quantity(RESOLUTION, 'm')} are taken a quarter larger or smaller. The last columns give the rebound: how far and "
        f"how fast the string still moves after the time from which on it stays within {quantity(FIRST_REST_RESOLUTION, 'm')}."
    )


def _check_against_events(result: ComparisonResult) -> str:
    """Return how far the reference's halting time from samples is from that of its own events: the detector's error here."""
    exact, sampled = result.reference.landmarks.halting_time, result.reference.sampled.halting_time
    if exact is None and sampled is None:
        return "The reference's exact events contain no halt either."
    if exact is not None and sampled is not None and abs(sampled - exact) <= HALT_AGREEMENT:
        error = quantity(abs(sampled - exact), "s")
        return f"By its exact events the reference halts at {exact:.6f} s, so reading samples has an error of {error} here."
    exact_words = "does not halt" if exact is None else f"halts at {exact:.4f} s"
    return f"By its exact events the reference {exact_words}: until then it slides by less than reading samples can resolve."


def _not_comparable(result: ComparisonResult) -> str:
    lines = [f"- {e.label}, {e.profile}: not comparable: {e.not_comparable}.\n" for e in result.engines if e.not_comparable]
    return "".join(lines) + "\n" if lines else ""
