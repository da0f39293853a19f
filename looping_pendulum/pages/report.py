"""A report as a page: its Markdown sections as HTML with sortable tables, and its figures as plotly draws them."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from markupsafe import Markup

from looping_pendulum.pages import markdown
from looping_pendulum.pages.figures import Figure, plotly_source
from looping_pendulum.pages.shell import KIT, asset, page


@dataclass(frozen=True, kw_only=True)
class Section:
    """One section of a report."""

    id: str
    title: str
    body: Markup


def render(
    title: str, before: Sequence[str], figures: Sequence[Figure], after: Sequence[str], words: Mapping[str, str], note: str
) -> str:
    """Return the page.

    Parameters
    ----------
    before, after
        Markdown sections above and below the figures, each with its heading first; the first is the page's own title.
        Empty ones are left out.
    words
        Word -> meaning, for a reader who is new to them.
    note
        A sentence on all figures.
    """
    head, *above = [markdown.html(text) for text in before if text]
    scripts = [asset(KIT, "tables.js")]
    if figures:
        scripts += [plotly_source(), asset(KIT, "figures.js")]
    return page(
        KIT,
        "report.html",
        title=title,
        styles=[(KIT, "report.css")],
        scripts=scripts,
        data={"figures": [figure.as_dict() for figure in figures]},
        head=head,
        above=[_section(html, f"part-{i}") for i, html in enumerate(above)],
        below=[_section(markdown.html(text), f"more-{i}") for i, text in enumerate(t for t in after if t)],
        figures=figures,
        words=words,
        note=note,
    )


def _section(html: Markup, name: str) -> Section:
    """Take a section's heading, for the table of contents."""
    found = re.match(r"<h2>(.*?)</h2>\n?", html, re.DOTALL)
    if found is None:
        return Section(id=name, title="", body=html)
    return Section(id=name, title=Markup(found[1]).striptags(), body=Markup(html[found.end() :]))
