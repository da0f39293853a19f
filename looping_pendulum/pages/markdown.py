"""Markdown of reports: its tables, plain text in it, and what a browser shows of it.

Names come from scenarios and files, so the HTML must not be able to run or fetch anything.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import cache
from typing import Any

from markupsafe import Markup

SPECIAL = str.maketrans({c: f"\\{c}" for c in "\\`*_[]|<>"})
"""Characters that have a meaning in Markdown -> their escapes."""


def plain(text: str) -> str:
    """Return ``text`` on one line with the characters escaped that have a meaning in Markdown."""
    return " ".join(text.split()).translate(SPECIAL)


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")


def table(head: Sequence[str], rows: Iterable[Sequence[str]], left: int = 1, *, cell: Callable[[str], str] = _cell) -> str:
    """Return a table; the first ``left`` columns are aligned left as text, the others right as numbers.

    ``cell`` turns the text of a cell into Markdown: as it stands, or with `plain` for text that is no Markdown.
    """
    align = ["---"] * left + ["---:"] * (len(head) - left)
    lines = [head, align, *([cell(text) for text in row] for row in rows)]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines) + "\n"


def html(text: str) -> Markup:
    """Return ``text`` as HTML: headings, paragraphs, lists, tables, code, emphasis. HTML, links and images remain text."""
    rendered: str = _parser().render(text)
    # Each table scrolls in a box of its own, reachable by keyboard, so that a wide one does not make the whole page scroll.
    rendered = rendered.replace("<table>", '<div class="table" tabindex="0" role="group" aria-label="table"><table>')
    return Markup(rendered.replace("</table>", "</table></div>"))


@cache
def _parser() -> Any:
    # Imported on use, as many results have tables that are never shown in a browser
    from markdown_it import MarkdownIt

    return MarkdownIt("commonmark", {"html": False}).enable("table").disable(["image", "link", "autolink", "reference"])
