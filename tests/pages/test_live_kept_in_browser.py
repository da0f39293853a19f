"""What a reader set and answered on the live page is there again: after a reload, by Back and Forward, in another tab."""

import json

import pytest

from tests.pages.conftest import until
from tests.pages.live_page import page_text, settled, type_into

STARTED = "'live' in window"
LINES = "looping-pendulum class; Ann; atwood=4.8/4.91\nlooping-pendulum class; Bo; atwood=5/4.91"
NO_STORAGE = """Object.defineProperty(window, "localStorage", {
  get() { throw new DOMException("denied", "SecurityError"); },
});"""
FULL_STORAGE = """Storage.prototype.setItem = () => { throw new DOMException("full", "QuotaExceededError"); };"""
NO_ADDRESS = """for (const how of ["pushState", "replaceState"]) {
  const change = history[how].bind(history);
  history[how] = (state, title, address) => {
    if (address !== undefined) throw new DOMException("denied", "SecurityError");
    change(state, title);
  };
}"""
"""As in a page within a page, whose address belongs to the outer one."""


def works(page):
    return page.evaluate("live.lesson.works")


def arrived(page, place):
    until(page, f"{STARTED} && live.history.place === {place}")
    settled(page)


def reload(page):
    page.reload()
    until(page, STARTED)
    settled(page)


def answer_second_step(page):
    """Open the lesson's second step, answer it and watch its run."""
    page.click("#lesson > summary")
    page.click("#lesson-steps li:nth-child(2) button")
    page.check("#lesson-options input[value=turns]")
    page.click("#lesson-change")
    until(page, "live.lesson.watched === null")
    settled(page)


def write_class(page):
    page.evaluate("for (const id of ['lesson', 'class']) document.getElementById(id).open = true")
    page.fill("#class-name", "Cleo")
    page.fill("#class-lines", LINES)


@pytest.mark.parametrize("locale", ["en", "de"])
def test_after_a_reload_all_is_there_again(visit, locale):
    opened = visit(page_text(), locale=locale)
    page = opened.page
    answer_second_step(page)
    write_class(page)
    type_into(page, "#field-mass_ratio", "7")
    page.click("#lesson-next")
    page.check("#lesson-options input[value=more]")  # at once before the reload: nothing may wait
    seen = ["live.state", "live.lesson.works", "live.lesson.place", "live.history.before", "location.hash"]
    before = [page.evaluate(one) for one in seen]
    reload(page)
    assert [page.evaluate(one) for one in seen] == before
    assert page.is_checked("#lesson-options input[value=more]")
    assert page.input_value("#class-lines") == LINES
    assert page.input_value("#class-name") == "Cleo"
    assert "frictionless=turns/turns" in page.inner_text("#class-line")
    assert page.locator("#class-results circle.said").count() == 2
    page.click("#lesson-steps li:nth-child(2) button")
    table = page.evaluate("(name) => liveLanguages[name]", locale)
    words = page.inner_text("#lesson-answer")
    assert words.startswith(table["lessonSaid"].partition("{")[0])
    assert table["lesson.frictionless.why"].partition("{")[0] in words
    assert page.get_attribute("#lesson-answer", "class") == "right"
    assert page.inner_text("#not-kept") == ""
    assert opened.complaints == []


def test_back_is_one_step_back_and_forward_brings_all_again(visit):
    opened = visit(page_text())
    page = opened.page
    first = page.evaluate("live.state")
    answer_second_step(page)
    second = page.evaluate("live.state")
    page.click("#lesson-next")
    arrived(page, 3)
    page.go_back()
    arrived(page, 2)
    assert (page.evaluate("live.lesson.place"), page.evaluate("live.state")) == (1, second)
    page.go_back()
    arrived(page, 1)
    assert (page.evaluate("live.lesson.place"), page.evaluate("live.state")) == (1, first)
    assert works(page)[1]["judgement"]["right"], "what was answered stays"
    page.click("#undo")
    arrived(page, 0)
    assert page.is_disabled("#undo")
    assert page.evaluate("live.lesson.place") == 0
    write_class(page)
    page.go_back()
    assert page.url == "about:blank"
    page.go_forward()
    arrived(page, 0)
    assert page.input_value("#class-lines") == LINES
    for place in (1, 2, 3):
        page.click("#redo")
        arrived(page, place)
    assert page.is_disabled("#redo")
    assert (page.evaluate("live.lesson.place"), page.evaluate("live.state")) == (2, second)
    assert opened.complaints == []


def test_undo_never_leaves_the_page(visit):
    page = visit(page_text()).page
    type_into(page, "#field-mass_ratio", "7")
    page.evaluate("for (let i = 0; i < 5; i++) live.go('undo')")
    arrived(page, 0)
    page.evaluate("for (let i = 0; i < 5; i++) live.go('undo')")
    settled(page)
    assert page.evaluate("live.state.values.mass_ratio") == 10


@pytest.mark.long
def test_a_link_that_is_followed_is_a_step_of_its_own(visit):
    page = visit(page_text()).page
    type_into(page, "#field-mass_ratio", "7")
    page.evaluate("location.hash = 'release=looping&mass_ratio=4'")
    arrived(page, 2)
    assert page.evaluate("live.history.before.values.mass_ratio") == 7
    page.click("#undo")
    arrived(page, 1)
    assert page.evaluate("live.state.values.mass_ratio") == 7


@pytest.mark.long
@pytest.mark.parametrize("fault", [NO_STORAGE, FULL_STORAGE], ids=["no storage", "full storage"])
def test_without_storage_a_reload_loses_nothing_and_one_sentence_warns(visit, fault):
    opened = visit(page_text())
    page = opened.page
    page.context.add_init_script(fault)
    reload(page)
    assert page.inner_text("#not-kept") == "", "there is nothing yet that could be lost"
    answer_second_step(page)
    write_class(page)
    assert page.inner_text("#not-kept").startswith("The answers and lines cannot be kept in this browser: ")
    until(page, "history.state.work.class !== ''")
    reload(page)
    assert works(page)[1]["judgement"]["right"]
    assert page.input_value("#class-lines") == LINES
    assert opened.complaints == []


@pytest.mark.long
def test_where_the_address_cannot_change_it_goes_back_all_the_same(visit):
    opened = visit(page_text())
    page = opened.page
    page.context.add_init_script(NO_ADDRESS)
    reload(page)
    type_into(page, "#field-mass_ratio", "7")
    reload(page)
    assert page.evaluate("live.state.values.mass_ratio") == 7
    page.click("#undo")
    arrived(page, 0)
    assert page.evaluate("live.state.values.mass_ratio") == 10
    assert opened.complaints == []


@pytest.mark.long
@pytest.mark.parametrize(
    "lesson",
    [
        "{",
        "null",
        "[1, 2]",
        '{"tab": 1, "value": "text"}',
        '{"value": {"place": "length", "set": "length", "works": 7, "seeds": {"film": -3, "trial": "x"}, "open": "yes"}}',
        '{"value": {"place": 99, "set": -1, "works": [{"counted": "<b>", "measured": -1}], "name": {}}}',
        json.dumps({"value": {"set": 1, "works": [{}, {"counted": "turns", "judgement": {"found": "turns", "right": True}}]}}),
        json.dumps({"value": {"set": 5, "works": [{}] * 5 + [{"counted": "deeper"}], "seeds": {"film": 4}}}),
    ],
)
def test_damaged_storage_does_not_break_the_page(visit, lesson):
    opened = visit(page_text())
    page = opened.page
    page.evaluate("history.replaceState(null, '')")
    page.evaluate("(lesson) => { localStorage['looping-pendulum-lesson'] = lesson; }", lesson)
    page.evaluate("localStorage['looping-pendulum-class'] = '{\"value\": {\"a\": 1}}'")
    reload(page)
    for place in range(1, 8):
        page.evaluate("document.getElementById('lesson').open = true")
        page.click(f"#lesson-steps li:nth-child({place}) button")
        settled(page)
        assert "undefined" not in page.inner_text("#lesson")
    assert page.inner_text("#fault") == ""
    assert page.input_value("#class-lines") == ""
    assert opened.complaints == []


def test_two_tabs_do_not_take_one_anothers_work(visit):
    page = visit(page_text()).page
    other = page.context.new_page()
    other.goto(page.url)
    until(other, STARTED)
    write_class(page)
    answer_second_step(other)
    for tab in (page, other):
        reload(tab)
    assert page.input_value("#class-lines") == LINES
    assert works(page)[1]["judgement"] is None
    assert works(other)[1]["judgement"]["right"]
    third = page.context.new_page()
    third.goto(page.url.partition("#")[0])
    until(third, STARTED)
    assert third.input_value("#class-lines") == LINES
    assert third.evaluate("live.state.values.mass_ratio") == 10


def test_steps_are_begun_anew(visit):
    page = visit(page_text()).page
    answer_second_step(page)
    type_into(page, "#field-mass_ratio", "7")
    page.click("#lesson-steps li:nth-child(1) button")
    page.fill("#lesson-number", "4.8")
    page.click("#lesson-change")
    until(page, "live.lesson.watched === null")
    page.click("#lesson-anew")
    assert page.input_value("#lesson-number") == page.inner_text("#lesson-answer") == ""
    assert page.evaluate("document.activeElement.id") == "lesson-name"
    assert page.get_attribute("#lesson-steps li:nth-child(1) button", "aria-label") == "Step 1: Without a loop"
    assert works(page)[1]["judgement"]["right"], "the other steps stay"
    reload(page)
    assert works(page)[0]["counted"] == ""
    write_class(page)
    page.click("#class-anew")
    assert works(page)[1]["counted"] == page.input_value("#class-name") == ""
    assert page.input_value("#class-lines") == LINES, "the lines of the others are no step"


@pytest.mark.long
def test_the_film_of_a_step_is_the_same_after_a_reload(visit):
    page = visit(page_text()).page
    page.click("#lesson > summary")
    page.click("#lesson-steps li:nth-child(6) button")
    page.check("#lesson-options input[value=deeper]")
    page.click("#lesson-change")
    until(page, "live.lesson.watched === null")
    points = page.evaluate("live.lesson.points")
    reload(page)
    assert page.evaluate("live.lesson.points") == points
    assert works(page)[5]["judgement"]["right"]


@pytest.mark.long
def test_a_reload_while_a_run_is_watched(visit):
    page = visit(page_text(), reduced_motion="no-preference").page
    page.click("#lesson > summary")
    page.fill("#lesson-number", "4.8")
    page.click("#lesson-change")
    reload(page)
    assert works(page)[0]["counted"] == "4.8"
    assert page.inner_text("#lesson-answer").startswith("Watch the run")
    page.click("#end")
    until(page, "live.lesson.watched === null")
    assert page.get_attribute("#lesson-answer", "class") == "right"
