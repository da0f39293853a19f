"""One glossary: the documentation shows it whole, the reports show their part, and its names are those of the code."""

import io
import re
import tokenize
from pathlib import Path

import pytest

from looping_pendulum.pages.report import glossary, glossary_rows

PAGES = ("comparison", "identification")
"""Reports that show a part of the glossary."""
ROOT = Path(__file__).parents[2]


def names_in_code() -> set[str]:
    """All identifiers of the package."""
    names = set()
    for path in (ROOT / "looping_pendulum").rglob("*.py"):
        tokens = tokenize.generate_tokens(io.StringIO(path.read_text(encoding="utf-8")).readline)
        names |= {token.string for token in tokens if token.type == tokenize.NAME}
    return names


def test_the_documentations_page_is_the_packages_file():
    page, source = ROOT / "docs" / "glossary.md", ROOT / "looping_pendulum" / "pages" / "glossary.md"
    assert page.read_text(encoding="utf-8") == source.read_text(encoding="utf-8")


def test_rows_are_whole_and_terms_stand_once():
    assert tuple(glossary_rows()[0]) == ("Term", "Meaning", "Symbol, unit", "Name in code", "Pages")
    assert all(row["Term"] and row["Meaning"].endswith(".") for row in glossary_rows())
    terms = [row["Term"] for row in glossary_rows()]
    assert len(set(terms)) == len(terms)
    assert {page for row in glossary_rows() for page in row["Pages"].split(", ") if page} == set(PAGES)


@pytest.mark.parametrize("page", PAGES)
def test_a_report_shows_its_terms(page):
    assert glossary(page)
    assert all(row["Meaning"] == glossary(page)[row["Term"]] for row in glossary_rows() if page in row["Pages"])


@pytest.mark.long
def test_names_in_code_are_in_the_code():
    known = names_in_code()
    named = [name for row in glossary_rows() for name in re.findall(r"`([\w.]+)`", row["Name in code"])]
    assert named
    missing = [name for name in named if not set(name.split(".")) <= known]
    assert not missing
