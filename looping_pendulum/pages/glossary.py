"""Read the glossary, `glossary.md` beside this file: the documentation shows it whole, each report the terms that it uses."""

from __future__ import annotations

from functools import cache
from importlib.resources import files

PAGES = ("comparison", "identification")
"""Reports that show a part of the glossary."""
COLUMNS = ("Term", "Meaning", "Symbol, unit", "Name in code", "Pages")


@cache
def rows() -> tuple[dict[str, str], ...]:
    """Return the rows of the glossary's table, each as {column: text}."""
    text = files("looping_pendulum.pages").joinpath("glossary.md").read_text(encoding="utf-8")
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines() if line.startswith("|")]
    head, _, *body = cells
    return tuple(dict(zip(head, row, strict=True)) for row in body)


def glossary(page: str) -> dict[str, str]:
    """Return {term: meaning} of the terms that ``page``, one of `PAGES`, shows.

    Raises
    ------
    ValueError
        If no such page is known.
    """
    if page not in PAGES:
        raise ValueError(f"page: found {page!r}, needed one of {', '.join(PAGES)}")
    return {row["Term"]: row["Meaning"] for row in rows() if page in row["Pages"]}
