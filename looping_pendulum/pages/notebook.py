"""Formats results for notebooks: a short text with tables, as HTML in which nothing can run."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

SPECIAL = str.maketrans({c: f"\\{c}" for c in "\\`*_[]|<>"})
"""Characters that have a meaning in Markdown -> their escapes."""


def plain(text: str) -> str:
    """Return ``text`` on one line with the characters escaped that have a meaning in Markdown."""
    return " ".join(text.split()).translate(SPECIAL)


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a Markdown table of plain text."""
    lines = [[plain(cell) for cell in head], ["---"] * len(head), *([plain(cell) for cell in row] for row in rows)]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def notebook_html(title: str, note: str, *parts: str) -> str:
    """Return the HTML of a title, a note in plain text, and Markdown ``parts``."""
    # Here, for results of every layer import this file, and few of them are ever shown.
    from looping_pendulum.pages.markdown import html

    return str(html("\n\n".join([f"**{plain(title)}**", *([plain(note)] if note.strip() else []), *parts])))
