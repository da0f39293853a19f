"""Report what these data could show: the smallest size of each effect that would be seen, and errors that last."""

from __future__ import annotations

from looping_pendulum.compare.tables import number, table
from looping_pendulum.discrepancy.result import Identification, SmallestVisible
from looping_pendulum.discrepancy.verdict_sentence import BODY_IN_WORDS
from looping_pendulum.pages.numbers import amount, quantity

MAX_ROWS = 10
"""Effects in the table."""


def size_in_words(v: SmallestVisible) -> str:
    """Return the smallest visible size with its unit; of a factor, as a percentage."""
    if not v.unit and v.null_value == 1:
        return f"{amount(v.value, 100)} %"
    return quantity(v.value, v.unit)


def section(result: Identification) -> str:
    """Return the section on the smallest visible effects; empty if there are none."""
    visible = result.smallest_visible
    if not visible:
        return ""
    hiding = ""
    if result.can_hide:
        hiding = (
            f" No size of {', '.join(result.can_hide)} would be sure to show: what is fitted with it can keep it from "
            "acting, as friction in a bearing does, or a drag or friction of zero that it multiplies."
        )
    head = ["effect", "acts on", "smallest size that would show", "moves the masses by [noise]"]
    rows = [[v.name, v.acts_on, size_in_words(v), number(v.motion, digits=2)] for v in visible[:MAX_ROWS]]
    rest = f" The other {len(visible) - MAX_ROWS} are in `verdict.json`." if len(visible) > MAX_ROWS else ""
    note = (
        "An effect that is smaller than this may be there without a trace. The first of the list can hide best: an effect of "
        "that size moves the masses by the most, but the fitted masses, lengths, friction and camera settings make up for it. "
        f"A percentage is that of the value itself.{rest}{hiding}\n\n"
    )
    return "## What these data could show\n\n" + note + table(head, rows, left=2)


def correlated_noise_section(result: Identification) -> str:
    """Return the section on errors that last longer than a frame; empty if there are none."""
    if not result.correlated_noise:
        return ""
    head = ["tracked points of", "typically off by", "for about", "that is"]
    rows = [
        [BODY_IN_WORDS[e.body], quantity(e.amplitude, e.unit), quantity(e.correlation_time, "s"), f"{amount(e.points)} points"]
        for e in result.correlated_noise
    ]
    note = (
        "The tracked points do not only scatter from frame to frame. Neighbouring ones are off in the same direction, as when "
        "a tracker or a hand wanders over the mark. The tests allow for it; the price is that a small effect can hide behind "
        "it. Marks that are set anew in every frame, on a larger picture, would make it smaller.\n\n"
    )
    return "## Errors that last longer than a frame\n\n" + note + table(head, rows, left=1)
