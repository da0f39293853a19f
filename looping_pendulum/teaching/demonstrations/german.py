"""German of the demonstrations: a result whose texts `pages/german.toml` has translated."""

from __future__ import annotations

from dataclasses import replace

from looping_pendulum.pages.german import translated
from looping_pendulum.teaching.demonstrations.demonstration import Demonstration, DemonstrationResult


def in_german(result: DemonstrationResult) -> DemonstrationResult:
    """Return a result whose texts are German, and whose numbers have a decimal comma."""
    return replace(
        result,
        demonstration=german_of(result.demonstration),
        header=tuple(map(_said, result.header)),
        rows=tuple(tuple(map(_said, row)) for row in result.rows),
        answer=tuple(replace(claim, text=_said(claim.text)) for claim in result.answer),
        curves=tuple(replace(curve, label=_said(curve.label)) for curve in result.curves),
    )


def german_of(d: Demonstration) -> Demonstration:
    """Return a demonstration whose own texts are German; a page takes its claims from the result."""
    lines, _, comment = d.change.partition("    # ")
    return replace(
        d,
        title=_said(d.title),
        question=_said(d.question),
        guess=_said(d.guess),
        experiment=_said(d.experiment),
        change=f"{lines}    # {_said(comment)}" if comment else lines,
        picture=replace(d.picture, x=_said(d.picture.x), y=_said(d.picture.y), caption=_said(d.picture.caption)),
    )


def _said(text: str) -> str:
    """Return the German of a text; of a demonstration that is not shipped it is not known."""
    return translated(text) or text
