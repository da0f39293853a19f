"""How results show themselves in a notebook: a short text with tables, as HTML in which nothing can run."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from looping_pendulum.pages.markdown import html

SPECIAL = str.maketrans({c: f"\\{c}" for c in "\\`*_[]|<>"})
"""Characters that Markdown reads as more than themselves."""


def plain(text: str) -> str:
    """``text`` on one line, for Markdown, with nothing in it that Markdown would read."""
    return " ".join(text.split()).translate(SPECIAL)


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Markdown table of plain text."""
    lines = [[plain(cell) for cell in head], ["---"] * len(head), *([plain(cell) for cell in row] for row in rows)]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def shown(title: str, note: str, *parts: str) -> str:
    """HTML of a title, a sentence or two, and Markdown ``parts``."""
    return str(html("\n\n".join([f"**{plain(title)}**", *([plain(note)] if note.strip() else []), *parts])))
