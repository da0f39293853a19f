"""Converts the Markdown of reports to HTML.

Names in it come from scenarios and files, so the result must not be able to run or fetch anything.
"""

from __future__ import annotations

from functools import cache

from markdown_it import MarkdownIt
from markupsafe import Markup


def html(text: str) -> Markup:
    """Return ``text`` as HTML: headings, paragraphs, lists, tables, code, emphasis. HTML, links and images remain text."""
    rendered: str = _parser().render(text)
    # Each table scrolls in a box of its own, reachable by keyboard, so that a wide one does not make the whole page scroll.
    rendered = rendered.replace("<table>", '<div class="table" tabindex="0" role="group" aria-label="table"><table>')
    return Markup(rendered.replace("</table>", "</table></div>"))


@cache
def _parser() -> MarkdownIt:
    return MarkdownIt("commonmark", {"html": False}).enable("table").disable(["image", "link", "autolink", "reference"])
