"""The reports in a real browser: figures are drawn, tables sort, names stay text, nothing is fetched.

A page takes seconds to open, most of them for Plotly. So each report is opened once, full of hostile names: what holds with
them is all that a calm page shows, and that nothing of it is run.
"""

import pytest

from looping_pendulum.compare.figures import charts
from looping_pendulum.compare.report import render_page
from looping_pendulum.discrepancy.report import figures, writing
from looping_pendulum.pages.figures import on_page
from tests.pages.axe import violations
from tests.pages.conftest import DESKTOP, PHONE, sideways, until
from tests.pages.made_up import identification
from tests.pages.small import HOSTILE, hostile_result

DRAWN = "[...document.querySelectorAll('.figure')].every((box) => box.querySelector('.main-svg'))"


@pytest.fixture(scope="module")
def comparison(visit_once):
    return visit_once(render_page(hostile_result(), charts(hostile_result())))


@pytest.fixture(scope="module")
def identified(visit_once):
    result = identification(HOSTILE)
    return visit_once(writing.identification_page(result, figures.charts(result)), viewport=PHONE, color_scheme="dark")


def test_comparison_draws_its_figures_and_fetches_nothing(comparison):
    page = comparison.page
    until(page, DRAWN)
    figures = [on_page(chart) for chart in charts(hostile_result())]
    assert page.locator(".figure").count() == len(figures) == 4
    assert page.locator("#residuals .scatterlayer .trace").count() == 2 * 4, "two bodies, the reference and three runs"
    for figure in figures:
        lines = page.locator(f"#{figure['id']} .scatterlayer .trace").count()
        assert lines == len(figure["traces"])
    page.click("#theme")  # drawn again in the other colours
    until(page, "document.querySelector('#path .main-svg').style.background !== 'rgb(255, 255, 255)'")
    page.click("#theme")
    comparison.assert_no_requests_or_complaints(page.url)


@pytest.mark.long
@pytest.mark.parametrize("report", ["comparison", "identified"])
def test_axe_finds_nothing(request, report):
    page = request.getfixturevalue(report).page
    until(page, DRAWN)
    assert violations(page) == []


def test_tables_sort(comparison):
    page = comparison.page
    table = page.locator("main table").first
    header = table.locator("thead th").nth(3)
    assert header.inner_text().startswith("RMS to 0.35 s [mm]")

    def cells():
        return [text.strip() for text in table.locator("tbody tr td:nth-child(4)").all_text_contents()]

    before = cells()
    numbers = sorted(float(text) for text in before if text != "–")
    assert len(numbers) == 2
    header.locator("button").click()
    assert [float(text) for text in cells()[:2]] == numbers
    assert header.get_attribute("aria-sort") == "ascending"
    header.locator("button").press("Enter")
    assert [float(text) for text in cells()[:2]] == numbers[::-1]
    assert header.get_attribute("aria-sort") == "descending"
    assert set(cells()[2:]) == {"–"}, "gaps stay last"
    first = table.locator("thead th").first
    first.locator("button").click()
    names = [text.strip() for text in table.locator("tbody tr td:first-child").all_text_contents()]
    assert names == sorted(names)


@pytest.mark.long
def test_a_phone_shows_it_without_scrolling_sideways(comparison):
    page = comparison.page
    page.set_viewport_size(PHONE)
    until(page, "document.querySelector('#path .main-svg').getBoundingClientRect().width <= 390")
    assert sideways(page) == 0
    cards = page.locator("table.cards").all()
    assert cards, "a table with sentences"
    for table in cards:
        cells = table.locator("tbody tr").first.locator("td").all()
        places = [cell.evaluate("(c) => c.getBoundingClientRect().left") for cell in cells]
        assert len(set(places)) == 1, "below each other"
        assert cells[1].get_attribute("data-label") == table.locator("thead th").nth(1).inner_text().strip()
    page.set_viewport_size(DESKTOP)


@pytest.mark.long
def test_sections_start_folded_on_a_phone_and_a_link_opens_one(visit):
    page = visit(render_page(hostile_result(), charts(hostile_result())), viewport=PHONE).page
    folds = page.locator("details.fold")
    assert folds.count() >= 5
    assert not any(fold.evaluate("(f) => f.open") for fold in folds.all())
    until(page, DRAWN)
    assert page.evaluate("document.documentElement.scrollHeight") < 12 * PHONE["height"]
    page.locator("nav.contents a", has_text="Provenance").click()
    until(page, "document.querySelectorAll('details.fold[open]').length === 1")
    assert page.locator("details.fold[open] table").first.is_visible()


def test_sections_are_open_on_a_desktop(comparison):
    assert all(fold.evaluate("(f) => f.open") for fold in comparison.page.locator("details.fold").all())


def test_identification_draws_every_figure(identified):
    until(identified.page, DRAWN)
    result = identification(HOSTILE)
    drawn = [chart.id for chart in figures.charts(result)]
    assert drawn == ["motion", drawn[1], "events", "explanations", "unlisted-force"]
    assert drawn[1].startswith("trial-")
    assert identified.page.eval_on_selector_all(".figure", "(all) => all.map((one) => one.id)") == drawn
    for name in drawn:
        assert identified.page.locator(f"#{name} .trace").count() > 0
    assert sideways(identified.page) == 0
    places = [identified.page.locator(f"#motion .subplot.{name}").bounding_box() for name in ("xy", "x2y2")]
    assert places[1]["y"] > places[0]["y"] + places[0]["height"], "a phone has the panels of a row below each other"
    assert abs(places[1]["x"] - places[0]["x"]) < 1
    identified.assert_no_requests_or_complaints(identified.page.url)


@pytest.mark.parametrize("report", ["comparison", "identified"])
def test_hostile_names_show_as_text(request, report):
    opened = request.getfixturevalue(report)
    until(opened.page, DRAWN)
    assert "onerror=alert(1)" in opened.page.inner_text("h1")
    assert "<script>alert(1)</script>" in opened.page.inner_text("main")
    assert opened.page.locator("img").count() == 0
    opened.assert_no_requests_or_complaints(opened.page.url)


def test_print_opens_what_is_folded_and_leaves_out_switches(comparison):
    page = comparison.page
    page.click("#theme")  # dark, which paper is not
    page.evaluate("window.dispatchEvent(new Event('beforeprint'))")
    page.emulate_media(media="print")
    assert page.evaluate("document.documentElement.dataset.theme") == "light"
    widths = "[...document.querySelectorAll('.figure .main-svg')].map((one) => one.getBoundingClientRect().width)"
    until(page, f"Math.max(...{widths}) <= 718")  # A4 with Chromium's margins of 1 cm [px]
    assert page.locator("details.words dl").is_visible()
    assert not page.locator("#theme").is_visible()
    assert not page.locator("nav.contents").is_visible()
    page.emulate_media(media="screen")
    page.evaluate("window.dispatchEvent(new Event('afterprint'))")
    assert page.evaluate("document.documentElement.dataset.theme") == "dark"
    until(page, "document.querySelector('#path .main-svg').getBoundingClientRect().width > 1000")
