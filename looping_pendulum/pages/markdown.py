"""Markdown of our reports as HTML. Names in it come from scenarios and files, so it can neither run nor fetch anything."""

from __future__ import annotations

from functools import cache

from markdown_it import MarkdownIt
from markupsafe import Markup


def html(text: str) -> Markup:
    """Return ``text`` as HTML: headings, paragraphs, lists, tables, code, emphasis. HTML, links and images in it stay text."""
    rendered: str = _parser().render(text)
    # a scrolling box of its own, reachable by keyboard: a wide table must not make a phone's page scroll sideways
    rendered = rendered.replace("<table>", '<div class="table" tabindex="0" role="region" aria-label="table"><table>')
    return Markup(rendered.replace("</table>", "</table></div>"))


@cache
def _parser() -> MarkdownIt:
    return MarkdownIt("commonmark", {"html": False}).enable("table").disable(["image", "link", "autolink", "reference"])
