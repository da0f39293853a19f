"""Renders a report as a page: its Markdown sections as HTML with sortable tables, its figures with plotly, and its glossary.

The glossary is `glossary.md` beside this file: the documentation shows it whole, each report the terms that it uses.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from functools import cache
from importlib.resources import files

from markupsafe import Markup

from looping_pendulum.pages import markdown
from looping_pendulum.pages.chart import Chart
from looping_pendulum.pages.figures import on_page, plotly_source
from looping_pendulum.pages.shell import SHARED_PACKAGE, asset, page


def report_page(
    title: str,
    before: Sequence[str],
    charts: Sequence[Chart],
    after: Sequence[str],
    terms: Mapping[str, str],
    note: str,
    first: Sequence[Chart] = (),
) -> str:
    """Return the page.

    Parameters
    ----------
    before, after
        Markdown sections above and below the ``charts``, each with its heading first; the first is the page's own title.
        Empty ones are left out.
    terms
        Term -> meaning, for readers who do not know it.
    note
        A sentence about all figures.
    first
        Charts directly below the first section.
    """
    head, *above = [markdown.html(text) for text in before if text]
    scripts = [asset(SHARED_PACKAGE, "tables.js")]
    above_figures, figures = [[on_page(chart) for chart in some] for some in (first, charts)]
    if above_figures or figures:
        scripts += [plotly_source(), asset(SHARED_PACKAGE, "figures.js")]
    return page(
        SHARED_PACKAGE,
        "report.html",
        title=title,
        styles=[(SHARED_PACKAGE, "report.css")],
        scripts=scripts,
        data={"figures": above_figures + figures},
        head=head,
        above=[_section(html, f"part-{i}") for i, html in enumerate(above)],
        below=[_section(markdown.html(text), f"more-{i}") for i, text in enumerate(t for t in after if t)],
        figures=figures,
        first=above_figures,
        terms=terms,
        note=note,
    )


def _section(html: Markup, name: str) -> dict[str, str]:
    """Separate a section's heading from its body, for the table of contents."""
    heading = re.match(r"<h2>(.*?)</h2>\n?", html, re.DOTALL)
    if heading is None:
        return {"id": name, "title": "", "body": html}
    return {"id": name, "title": Markup(heading[1]).striptags(), "body": Markup(html[heading.end() :])}


@cache
def glossary_rows() -> tuple[dict[str, str], ...]:
    """Return the rows of the glossary's table, each as {column: text}."""
    text = files("looping_pendulum.pages").joinpath("glossary.md").read_text(encoding="utf-8")
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines() if line.startswith("|")]
    head, _, *body = cells
    return tuple(dict(zip(head, row, strict=True)) for row in body)


def glossary(page: str) -> dict[str, str]:
    """Return {term: meaning} of the terms that ``page``, "comparison" or "identification", shows."""
    return {row["Term"]: row["Meaning"] for row in glossary_rows() if page in row["Pages"]}
