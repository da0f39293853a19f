"""The lesson on the live page: predictions right and wrong, in both languages, by mouse and by keys."""

import re

import pytest

from tests.pages.conftest import DESKTOP, PHONE, sideways, until
from tests.pages.live_page import page_text, played_to, settled, type_into, value

NUMBERS = {"atwood": ("4,9", "9.81"), "lowest": ("3.15", "8")}
CHOICES = {
    "frictionless": ("turns", "halts"),
    "friction": ("times", "more"),
    "static": ("earlier", "later"),
    "drag": ("deeper", "higher"),
    "trial": ("more", "noise"),
}
PREDICTIONS = NUMBERS | CHOICES
"""Step -> a right and a wrong prediction; what is right is held to the reference in tests/live/test_lesson.py."""
PLACES = ["atwood", "frictionless", "friction", "lowest", "static", "drag", "trial"]


@pytest.fixture(params=["en", "de"])
def lesson(request, visit_in):
    return opened_lesson(visit_in, request.param)


# Each language and each outcome daily, their other pairs with `-m accurate`
@pytest.fixture(
    params=[
        pytest.param(("en", True), id="en-right"),
        pytest.param(("de", False), id="de-wrong"),
        pytest.param(("en", False), id="en-wrong", marks=pytest.mark.accurate),
        pytest.param(("de", True), id="de-right", marks=pytest.mark.accurate),
    ]
)
def predicted(request, visit_in):
    """The lesson in a language, and whether the prediction is to be right."""
    language, right = request.param
    return *opened_lesson(visit_in, language), right


def opened_lesson(visit_in, language):
    page = visit_in(language)
    page.evaluate("live.trial.remove(); live.lesson.film = null")
    return page, page.evaluate("(name) => liveLanguages[name]", language)


@pytest.fixture(scope="module")
def visit_in(visit_once):
    """The page in a language, with the lesson open."""
    pages = {}

    def visit(name):
        if name not in pages:
            pages[name] = visit_once(page_text(), locale=name)
            pages[name].page.click("#lesson > summary")
        assert pages[name].complaints == []
        return pages[name].page

    return visit


def open_step(page, name):
    page.click(f"#lesson-steps li:nth-child({PLACES.index(name) + 1}) button")


def predict(page, name, said):
    if name in NUMBERS:
        page.fill("#lesson-number", said)
    else:
        page.check(f"#lesson-options input[value={said}]")


def seen(page):
    """Wait until the run of a step has been seen."""
    until(page, "live.lesson.watched === null")
    settled(page)


def assert_told(page, table, name, said, right):
    """Hold that the answer says what was said, whether it was right, and why."""
    words = page.inner_text("#lesson-answer")
    found = PREDICTIONS[name][0]
    if name in CHOICES:
        said, found = (table[f"lesson.{name}.{answer}"] for answer in (said, found))
        both = table["lessonSaidOfFit" if name == "trial" else "lessonSaid"]
        assert words.startswith(both.replace("{said}", said).replace("{found}", found))
    else:
        number = said.replace(",", ".").replace(".", table["decimalSign"])
        assert words.startswith(table["lessonSaid"].partition("{said}")[0] + number)
    assert (table["lessonRight"] in words) == right
    assert (table["lessonWrong"] in words) == (not right)
    assert table[f"lesson.{name}.why"].partition("{")[0] in words
    assert not re.search(r"[{}]|undefined|NaN|Infinity", words)
    assert page.get_attribute("#lesson-answer", "class") == ("right" if right else "wrong")
    key = "lessonStepRight" if right else "lessonStepWrong"
    label = page.get_attribute(f"#lesson-steps li:nth-child({PLACES.index(name) + 1}) button", "aria-label")
    title = table[f"lesson.{name}.title"]
    assert label == table[key].replace("{number}", str(PLACES.index(name) + 1)).replace("{name}", title)


@pytest.mark.parametrize("name", ["atwood", "frictionless", "friction", "static"])
def test_a_prediction_is_checked_against_the_run(predicted, name):
    page, table, right = predicted
    before = page.evaluate("live.state")
    said = PREDICTIONS[name][0 if right else 1]
    page.uncheck("#ghost")
    page.uncheck("#forces")
    open_step(page, name)
    predict(page, name, said)
    page.click("#lesson-change")
    seen(page)
    assert_told(page, table, name, said, right)
    # What the step speaks of is shown
    assert page.is_checked("#ghost") == (name in ("friction", "static"))
    page.check("#ghost")
    settled(page)
    assert page.evaluate("live.ghost !== null") == (name in ("friction", "static")), "no ghost of the step before"
    assert page.is_checked("#forces") == (name == "friction")
    shown = page.evaluate("live.player.time")
    assert 0 < shown <= page.evaluate("live.run.end")
    page.click("#undo")
    settled(page)
    assert page.evaluate("live.state") == before


@pytest.mark.long
def test_the_lowest_ratio_is_searched_with_the_slider(predicted):
    page, table, right = predicted
    said = PREDICTIONS["lowest"][0 if right else 1]
    open_step(page, "lowest")
    predict(page, "lowest", said)
    page.click("#lesson-change")
    seen(page)
    assert page.inner_text("#lesson-answer") == table["lesson.lowest.task"]
    page.click("#lesson-go")
    assert page.evaluate("document.activeElement.id") == "range-mass_ratio"
    hints = {"10": "lessonHigh", "2.5": "lessonNever", "1.7": "lessonGap", "3.4": "lessonHigh", "3.1": "lessonNever"}
    for ratio, hint in (hints | {"3.2": "lessonRatioFound"}).items():
        type_into(page, "#field-mass_ratio", ratio.replace(".", table["decimalSign"]))
        settled(page)
        page.click("#lesson-check")
        words = table[hint].replace("{ratio}", ratio.replace(".", table["decimalSign"]))
        words = words.replace("{result}", page.inner_text("#result"))
        until(page, f"document.getElementById('lesson-answer').textContent.includes({words!r})")
    assert_told(page, table, "lowest", said, right)
    # With another length the ratio is another one
    type_into(page, "#field-free_length", "70")
    page.click("#lesson-check")
    assert page.inner_text("#lesson-answer") == table["lessonLeft"]


@pytest.mark.long
def test_a_wrong_drag_is_put_right_by_its_slider(predicted):
    page, table, right = predicted
    said = PREDICTIONS["drag"][0 if right else 1]
    open_step(page, "drag")
    predict(page, "drag", said)
    page.click("#lesson-check")
    early = page.inner_text("#lesson-answer")
    assert early.endswith(f"{page.inner_text('#lesson-change')}."), "before its time a check says what comes first"
    assert page.get_attribute("#lesson-answer", "class") == ""
    page.click("#lesson-change")
    seen(page)
    assert_told(page, table, "drag", said, right)
    assert page.evaluate("live.lesson.points.length") > 90
    hidden = page.evaluate("live.lesson.film.hidden")
    for drag, key in ((0.25, "lessonFar"), (hidden + 0.5, "lessonFar"), (hidden, "lessonNear")):
        type_into(page, "#field-light_drag", str(drag))
        settled(page)
        page.click("#lesson-check")
        words = page.inner_text("#lesson-answer")
        assert words.startswith(table[key].partition("{")[0])
        # Neither right nor wrong, even where the prediction was right: the step's button keeps that
        assert page.get_attribute("#lesson-answer", "class") == ""
        assert page.get_attribute("#lesson-steps [aria-current]", "aria-label").endswith(
            ("rightly", "otherwise", "richtig vorhergesagt", "anders vorhergesagt")
        )
        assert (table["lessonFar"].rpartition("}")[2] in words) == (key == "lessonFar")
    open_step(page, "atwood")
    assert page.evaluate("live.lesson.points") is None


@pytest.mark.long
def test_a_made_up_trial_is_fitted(predicted):
    page, table, right = predicted
    page.evaluate("live.lesson.seeds.trial = 1")  # with wind
    said = PREDICTIONS["trial"][0 if right else 1]
    open_step(page, "trial")
    predict(page, "trial", said)
    page.click("#lesson-check")
    assert page.inner_text("#lesson-answer") == table["lessonNeedsTrial"]
    page.click("#lesson-change")
    until(page, "live.trial.trial !== null")
    settled(page)
    box = page.locator("#lesson-answer").bounding_box()
    assert 0 <= box["y"] < DESKTOP["height"], "the page does not leave the lesson, which says how to go on"
    page.click("#lesson-check")
    assert page.inner_text("#lesson-answer") == table["lessonNeedsFit"]
    page.click("#lesson-go")
    assert page.evaluate("document.activeElement.id") == "trial-fit"
    page.click("#trial-fit")
    until(page, "live.fit.fitted?.file === live.trial.file && live.trial.file !== null")
    page.click("#lesson-check")
    assert_told(page, table, "trial", said, right)
    assert page.inner_text("#lesson-answer").endswith(table["lessonWind"].partition("}")[2])


@pytest.mark.long
def test_without_a_prediction_nothing_is_set(lesson):
    page, table = lesson
    before = page.evaluate("live.state")
    page.evaluate("live.lesson.beginAnew([...live.lesson.works.keys()])")
    for name, key in (("atwood", "lessonNoNumber"), ("static", "lessonNoPrediction")):
        open_step(page, name)
        page.click("#lesson-change")
        assert page.inner_text("#lesson-answer") == table[key]
    open_step(page, "atwood")
    for typed in ("-1", "a lot", "0"):
        page.fill("#lesson-number", typed)
        page.click("#lesson-change")
        assert page.inner_text("#lesson-answer") == table["lessonNoNumber"]
    assert page.evaluate("live.state") == before


@pytest.mark.long
def test_a_step_whose_settings_were_changed_tells_nothing(visit):
    page = visit(page_text(), reduced_motion="no-preference").page
    page.click("#lesson > summary")
    open_step(page, "frictionless")
    predict(page, "frictionless", "falls")
    page.click("#lesson-change")
    played_to(page, 0.02)
    # What is predicted later does not count
    predict(page, "frictionless", "turns")
    assert page.inner_text("#lesson-answer").startswith("Watch")
    type_into(page, "#field-mass_ratio", "4")
    until(page, "live.lesson.watched === null")
    assert page.inner_text("#lesson-answer").startswith("The settings are no longer")
    predict(page, "frictionless", "falls")
    page.click("#lesson-change")
    page.click("[data-slow='1']")
    played_to(page, 0.1)
    predict(page, "frictionless", "turns")
    page.click("[data-slow='1']")
    until(page, "document.getElementById('lesson-answer').className !== ''")
    assert "it falls until the string is used up. The run says: it stops and rises again" in page.inner_text("#lesson-answer")


@pytest.mark.long
def test_steps_in_any_order_keep_what_was_said_in_either_language(lesson):
    page, table = lesson
    other = "de" if table["decimalSign"] == "." else "en"
    here = page.evaluate("document.documentElement.lang")
    open_step(page, "static")
    predict(page, "static", "earlier")
    page.click("#lesson-change")
    seen(page)
    told = page.inner_text("#lesson-answer")
    link = page.evaluate("location.hash")
    page.click("#lesson-next")
    assert page.evaluate("document.activeElement.id") == "lesson-name"
    assert page.inner_text("#lesson-answer") != told
    page.select_option("#language", other)
    open_step(page, "static")
    assert page.evaluate("(name) => liveLanguages[name].lessonRight", other) in page.inner_text("#lesson-answer")
    assert page.is_checked("#lesson-options input[value=earlier]")
    page.select_option("#language", here)
    assert page.inner_text("#lesson-answer") == told
    assert page.evaluate("location.hash").startswith(link.partition("&lang")[0])
    assert value(page, "static_friction") == 0.4
    # The ghost is the run with the smaller coefficient
    assert page.evaluate("live.ghost.settings.static_friction") == pytest.approx(0.2)


@pytest.mark.long
def test_the_lesson_by_keyboard_alone(visit):
    opened = visit(page_text())
    page = opened.page
    page.focus("#lesson > summary")
    page.keyboard.press("Enter")
    page.keyboard.press("Tab")
    page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement.getAttribute('aria-label')") == "Step 2: The loop without friction"
    page.keyboard.press("Enter")
    assert page.evaluate("document.activeElement.textContent") == "Step 2: The loop without friction"
    page.keyboard.press("Tab")
    page.keyboard.press("Space")
    page.keyboard.press("ArrowDown")
    page.keyboard.press("ArrowDown")
    assert page.is_checked("#lesson-options input[value=turns]")
    page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement.id") == "lesson-change"
    page.keyboard.press("Enter")
    seen(page)
    assert page.get_attribute("#lesson-answer", "class") == "right"
    assert page.get_attribute("#lesson-answer", "role") == "status"
    page.keyboard.press("Control+z")
    settled(page)
    assert value(page, "kinetic_friction") == 0.3431
    assert opened.complaints == []


@pytest.mark.long
@pytest.mark.parametrize("locale", ["en", "de"])
def test_the_lesson_fits_a_narrow_screen(visit, locale):
    opened = visit(page_text(), locale=locale, viewport=PHONE | {"width": 320})
    page = opened.page
    page.click("#lesson > summary")
    for name in PLACES:
        open_step(page, name)
        assert sideways(page) <= 0, name


def test_thirty_pupils_are_drawn_as_a_distribution(visit_in):
    page, _ = opened_lesson(visit_in, "en")
    choices = ["falls", "halts", "turns"]
    lines = [
        f"looping-pendulum class; Pupil {i}; atwood={3 + i / 10}/4.91/{4.6 + i / 50:.2f}; frictionless={choices[i % 3]}/turns"
        for i in range(30)
    ]
    bad = [
        "hello",
        "looping-pendulum class; Eve; atwood=<b>/4.91; frictionless=flies",
        "looping-pendulum class; Pupil 0; atwood=9.81/4.91",
    ]
    page.evaluate("document.getElementById('class').open = true")
    page.fill("#class-lines", "\n".join([*lines, *bad]))
    # Pupil 0 is asked once, by the last line of that name
    message = "Pupils: 30. Several lines, of which the last counts: Pupil 0 (2). Lines that are of no pupil: 2."
    assert page.inner_text("#class-message") == message
    assert page.locator("#class-results circle.said").count() == 30
    assert page.locator("#class-results rect.measured").count() == 29
    bars = page.locator("#class-results figure").nth(1)
    assert bars.locator("svg").get_attribute("aria-label").endswith("it stops and rises again, several times: 10")
    assert bars.locator("rect.found").count() == 1
    page.fill("#class-lines", "")
    assert page.locator("#class-results figure").count() == 0


def test_a_pupils_line_is_read_as_it_was_answered(visit_in):
    page, _ = opened_lesson(visit_in, "en")
    page.evaluate("document.getElementById('class').open = true")
    page.evaluate("live.lesson.beginAnew([...live.lesson.works.keys()]); live.lesson.show(0)")
    page.fill("#lesson-number", "4,8")
    page.fill("#lesson-measured", "4.7")
    page.fill("#class-name", "Ann; B")
    # Read in the moment of the press: the answer follows with the next frame
    line = page.evaluate("(live.lesson.change(), document.getElementById('class-line').textContent)")
    # From the press on, whoever goes on before the run has ended
    assert line.endswith("atwood=4.8//4.7")
    page.fill("#class-lines", line)
    assert page.locator("#class-results circle.said").count() == 1
    page.evaluate("live.player.stopAt(live.player.end())")
    until(page, r"/atwood=4\.8\/\d/.test(document.getElementById('class-line').textContent)")
    line = page.inner_text("#class-line")
    assert re.fullmatch(r"looping-pendulum class; Ann B; atwood=4\.8/4\.9\d?/4\.7.*", line)
    page.fill("#class-lines", line)
    assert page.inner_text("#class-message") == "Pupils: 1."
    page.fill("#class-lines", "")
