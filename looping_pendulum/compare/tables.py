"""Renders Markdown tables."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from looping_pendulum.pages.numbers import GAP, fixed, number, signed

__all__ = ["GAP", "fixed", "number", "signed", "table"]


def table(head: Sequence[str], rows: Iterable[Sequence[str]], left: int = 1) -> str:
    """Return a Markdown table; the first ``left`` columns are aligned left as text, the others right as numbers."""
    align = ["---"] * left + ["---:"] * (len(head) - left)
    lines = [head, align, *([_cell(c) for c in row] for row in rows)]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines) + "\n"


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")
