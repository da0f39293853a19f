"""The leaderboard is what the stored data say, has every variant, and is sorted by mouse and keyboard in a browser."""

import math
import re

import pytest

from benchmarks.leaderboard import COMMAND, HEAD, PAGE, page, stored
from benchmarks.stored_study import SUMMARY, read
from tests.docs_commands import PROJECT

TABLE = re.compile(r'<div class="leaderboard">.*?</div>', re.DOTALL)


def table() -> str:
    """The page's table alone, with its script, as a file of its own."""
    script = (PROJECT / "docs" / "sort-tables.js").read_text(encoding="utf-8")
    found = TABLE.search(PAGE.read_text(encoding="utf-8"))
    assert found is not None
    return f"<!doctype html><html lang=en><title>t</title><body>{found[0]}<script>{script}</script></body></html>"


def test_the_page_is_what_the_stored_data_say():
    study = read(SUMMARY.read_text(encoding="utf-8"))
    assert PAGE.read_text(encoding="utf-8") == page(study, stored()), f"write it again: {COMMAND}"


@pytest.mark.long
def test_every_variant_of_the_study_has_its_static_ratio():
    study = read(SUMMARY.read_text(encoding="utf-8"))
    labels = {v.label for v in study.convergence.variants}
    assert labels <= {row["variant"] for row in stored()}, "measure it: python -m benchmarks.leaderboard --static NAME"


def test_the_reference_has_the_capstan_laws_ratio():
    # Oracle: the closed form, ln(T2 / T1) = mu theta
    row = next(row for row in stored() if row["variant"] == "reference:scipy")
    assert math.isclose(row["exponent"], row["friction"] * math.pi, rel_tol=1e-9)


def column(page, name):
    number = HEAD.index(name) + 1
    return page.evaluate(f"[...document.querySelectorAll('tbody td:nth-child({number})')].map(cell => cell.dataset.value)")


def numbers(values):
    return [float(value) for value in values if value]


@pytest.mark.parametrize("name", ["static ratio", "halting time [ms]", "path [mm]", "cost"])
def test_a_click_on_a_head_sorts_by_it_and_gaps_stay_last(visit, name):
    opened = visit(table(), viewport={"width": 390, "height": 844})
    head = opened.page.get_by_role("button", name=name)
    for direction in ("ascending", "descending"):
        head.click()
        values = column(opened.page, name)
        assert numbers(values) == sorted(numbers(values), reverse=direction == "descending")
        assert len(set(numbers(values))) > 10
        gaps = values.count("")
        assert gaps > 0
        assert values[-gaps:] == [""] * gaps
        assert opened.page.locator(f"th[aria-sort={direction}]").inner_text().startswith(name)
    assert opened.complaints == []


@pytest.mark.long
def test_by_keyboard_words_are_sorted_by_the_alphabet(visit):
    opened = visit(table())
    opened.page.get_by_role("button", name="variant").focus()
    opened.page.keyboard.press("Enter")
    labels = column(opened.page, "variant")
    assert labels == sorted(labels)
    assert len(labels) == len(read(SUMMARY.read_text(encoding="utf-8")).convergence.variants)
