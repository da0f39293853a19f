"""Markdown of reports: its tables, text in it that is no Markdown, and what a browser shows of it.

Names come from scenarios and files, so the HTML must not be able to run or fetch anything.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from functools import cache
from typing import Any

from markupsafe import Markup

_MARKUP = re.compile(r"[\\<|]|\](?=[(\[:])")
"""What begins HTML, ends a cell of a table, or makes a link or an image of brackets."""


def escaped(value: object) -> Markup:
    """Return ``value`` on one line, in which no HTML, link or image can begin and no cell of a table ends.

    `Markup`, which is Markdown already, is returned as it is.
    """
    if isinstance(value, Markup):
        return value
    return Markup(_MARKUP.sub(r"\\\g<0>", " ".join(str(value).split())))


def escaped_lines(text: str) -> Markup:
    """Return ``text`` with its lines as they are, each `escaped`."""
    return Markup("\n".join(escaped(line) for line in text.strip().splitlines()))


def fenced(text: str, language: str) -> Markup:
    """Return ``text`` as a block of code; its fence is longer than any row of backticks in the text, which cannot end it."""
    fence = "`" * max(3, 1 + max(map(len, re.findall("`+", text)), default=0))
    return Markup(f"{fence}{language}\n{text.strip()}\n{fence}")


def code(text: object, *, in_table: bool = False) -> Markup:
    """Return ``text`` on one line to be put between backticks, of which it has none itself."""
    line = " ".join(str(text).split()).replace("`", "'")
    return Markup(line.replace("|", "\\|") if in_table else line)


def table(head: Sequence[str], rows: Iterable[Sequence[str]], left: int = 1) -> str:
    """Return a table; the first ``left`` columns are aligned left as text, the others right as numbers. Cells are `escaped`."""
    align = ["---"] * left + ["---:"] * (len(head) - left)
    lines: list[Sequence[str]] = [[escaped(text) for text in head], align, *([escaped(text) for text in row] for row in rows)]
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
