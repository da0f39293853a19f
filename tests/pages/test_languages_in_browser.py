"""The live page in another language: nothing on it stays English, nothing that was set is lost."""

import re

import pytest

from looping_pendulum.teaching import demo
from tests.pages.conftest import PHONE, sideways, until
from tests.pages.live_page import at, page_text, preset, settled, type_into, value
from tests.pages.small import small_result, thick_result, with_points
from tests.pages.test_live_files_in_browser import drop_file

STRINGS = """() => {
  const found = new Set([document.title]);
  const walker = document.createTreeWalker(document.documentElement, NodeFilter.SHOW_TEXT | NodeFilter.SHOW_ELEMENT);
  for (let node = walker.nextNode(); node; node = walker.nextNode()) {
    if (node.nodeType === Node.TEXT_NODE) {
      const isOther = node.parentElement.closest(
        "script, style, noscript, code, #language, title, option[value^='='], [lang='']:not(html), [lang=en]:not(html)");
      if (!isOther) found.add(node.textContent);
    } else {
      for (const name of ["aria-label", "title", "placeholder", "alt", "aria-valuetext", "aria-description"]) {
        if (node.hasAttribute(name)) found.add(node.getAttribute(name));
      }
    }
  }
  return [...found, ...window.drawn].map((words) => words.replace(/\\s+/g, " ").trim());
}"""
"""All that can be read on the page, hidden parts and names for screen readers included.

The languages' own names, a file's tracks, a reader's own scenario and what the package writes about runs are none of the
page's words.
"""
KEEP_WHAT_IS_DRAWN = """() => {
  const isKept = Boolean(window.drawn);
  window.drawn = new Set();
  if (isKept) return;
  const { fillText } = CanvasRenderingContext2D.prototype;
  CanvasRenderingContext2D.prototype.fillText = function (words, ...place) {
    window.drawn.add(words);
    return fillText.call(this, words, ...place);
  };
}"""
WORD = re.compile(r"[^\W\d_]{3,}")
"""Units and the names of masses and axes are shorter."""
FILE = re.compile(r"^\w+\.csv(:\d+)?: ")


@pytest.fixture(scope="module")
def german_words(one_page):
    tables = one_page.page.evaluate("liveLanguages")
    return GermanWords(tables["de"], tables["en"])


@pytest.fixture
def german(opened):
    """The page in German; in English again after the test."""
    page = opened.page
    page.select_option("#language", "de")
    settled(page)
    page.evaluate(KEEP_WHAT_IS_DRAWN)
    page.evaluate("live.change()")
    settled(page)
    yield opened
    page.select_option("#language", "en")
    settled(page)


def pattern(words):
    """Return what matches a text with any values."""
    parts = re.split(r"\{\w+\}", re.sub(r"\s+", " ", words))
    return re.compile(".+?".join(map(re.escape, parts)))


def plain(words):
    return re.sub(r"\s+", " ", words.replace("`", ""))


class GermanWords:
    """Whether a string is one of the German table, with nothing of the English one left in it."""

    def __init__(self, german, english):
        # Around code a text stands in several pieces
        pieces = [piece.strip() for words in german.values() for piece in words.split("`")[::2]]
        self.known = [pattern(words) for words in pieces if WORD.search(re.sub(r"\{\w+\}", "", words))]
        self.begun = [re.compile(f"{one.pattern} ") for one in self.known]
        left = [
            plain(words) for key, words in english.items() if WORD.search(words) and "{" not in words and words != german[key]
        ]
        everything = " ".join(plain(words) for words in german.values())
        self.left = [words for words in left if words not in everything]
        self.fine = set()

    def is_known(self, words):
        if not WORD.search(words) or any(one.fullmatch(words) for one in self.known):
            return True
        if FILE.match(words):
            return self.is_known(FILE.sub("", words))
        first, colon, rest = words.partition(": ")
        if colon and self.is_known(first) and self.is_known(rest):
            return True
        begun = (one.match(words) for one in self.begun)
        return any(begin and self.is_known(words[begin.end() :]) for begin in begun)

    def english_in(self, words):
        inside = (one for one in self.left if one in words)
        return [one for one in inside if re.search(rf"(?<!\w){re.escape(one)}(?!\w)", words)]

    def check(self, words):
        """Hold it of a string, which is seldom seen for the first time."""
        if words in self.fine:
            return
        assert self.is_known(words), words
        assert self.english_in(words) == [], words
        self.fine.add(words)


def assert_german(page, german_words):
    """Hold that each string of the page is one of the German table, and that none of the English table is left in one."""
    strings = page.evaluate(STRINGS)
    assert len(strings) > 100
    for words in strings:
        german_words.check(words)


@pytest.mark.long
def test_nothing_on_the_page_stays_english(german, german_words):
    page = german.page
    assert page.get_attribute("html", "lang") == "de"
    page.check("#forces")
    page.evaluate("document.querySelectorAll('details').forEach((one) => { one.open = true; })")
    page.locator("#map").scroll_into_view_if_needed()
    for name in page.eval_on_selector_all("#preset option", "(all) => all.map(({ value }) => value).filter(Boolean)"):
        preset(page, name)
        for share in (0.0, 0.5, 1.0):
            page.evaluate("(share) => live.player.stopAt(share * live.run.end)", share)
            settled(page)
            assert_german(page, german_words)
    page.select_option("#release", "looping")
    for setting, words in (
        ("mass_ratio", "12"),
        ("kinetic_friction", "0,2"),
        ("release_angle", "abc"),
        ("release_angle", "400"),
    ):
        type_into(page, f"#field-{setting}", words)
        settled(page)
        assert_german(page, german_words)
    assert page.inner_text("#fault") == "Winkel des Fadens gegen senkrecht oben: 400 ° gefunden, möglich sind 5 bis 180 °"
    page.evaluate("location.hash = 'release=thrown'")
    until(page, "document.getElementById('fault').textContent.startsWith('der Link')")
    assert_german(page, german_words)
    page.evaluate("Object.defineProperty(navigator, 'clipboard', { value: { writeText: async () => {} }, configurable: true })")
    page.click("#copy")
    until(page, "document.getElementById('copied').textContent !== ''")
    assert_german(page, german_words)
    page.evaluate("document.querySelectorAll('details').forEach((one) => { one.open = false; })")


@pytest.mark.long
def test_the_lesson_is_told_in_german(german, german_words):
    page = german.page
    searching = page.evaluate("liveLanguages.de.lessonSearching")
    page.evaluate("document.getElementById('lesson').open = true")
    for place in range(page.locator("#lesson-steps button").count()):
        page.locator("#lesson-steps button").nth(place).click()
        page.click("#lesson-change")  # without a prediction
        assert_german(page, german_words)
        if page.locator("#lesson-number").count():
            page.fill("#lesson-number", "5,5")
        else:
            page.locator("#lesson-options input").last.check()
        page.click("#lesson-change")
        until(page, "live.lesson.watched === null")
        settled(page)
        assert_german(page, german_words)
        if page.is_visible("#lesson-check"):
            page.click("#lesson-check")
            assert_german(page, german_words)
            until(page, f"document.getElementById('lesson-answer').textContent !== {searching!r}")
            assert_german(page, german_words)
    page.evaluate("document.getElementById('lesson').open = false")


@pytest.mark.long
def test_a_trial_and_its_fit_are_told_in_german(german, german_words):
    page = german.page
    rows = "".join(f"{0.01 * i:.2f};{-0.05 * i:.3f};{-0.3 - 0.01 * i:.3f};\n".replace(".", ",") for i in range(20))
    drop_file(page, "versuch.csv", f"t;light_x;light_y;Kraft\n{rows}0,2;;;1\n")
    until(page, "live.trial.trial !== null")
    settled(page)
    assert_german(page, german_words)
    message = page.inner_text("#trial-message")
    assert "leere Zellen: 2" in message
    assert "Längen ohne Einheit in m genommen" in message
    page.click("#trial-fit")
    until(page, "document.getElementById('fit-table').children.length > 0")
    settled(page)
    assert_german(page, german_words)
    table = page.inner_text("#fit-table")
    assert re.search(r"Gleitreibungszahl: \d", table)
    # In the other language at once, and back
    page.select_option("#language", "en")
    settled(page)
    assert "empty cells: 2" in page.inner_text("#trial-message")
    assert re.search(r"Friction, string sliding: \d", page.inner_text("#fit-table"))
    page.select_option("#language", "de")
    settled(page)
    assert page.inner_text("#fit-table") == table


@pytest.fixture(params=[lambda: with_points(small_result()), thick_result], ids=["small", "thick"])
def with_runs(request, visit):
    """A page with stored runs, in German."""
    page = visit(demo.demo_page(request.param()), locale="de-DE", viewport={"width": 1280, "height": 900}).page
    page.evaluate("live.player.stopAt(0)")
    page.evaluate(KEEP_WHAT_IS_DRAWN)
    page.evaluate("live.change()")
    page.evaluate("document.querySelectorAll('details').forEach((one) => { one.open = true; })")
    settled(page)
    return page


@pytest.mark.long
def test_stored_runs_are_told_in_german(with_runs, german_words):
    page = with_runs
    for time in (0, 0.5, page.evaluate("live.player.end()")):
        at(page, time)
        assert_german(page, german_words)
    page.focus("#range-mass_ratio")
    page.keyboard.press("ArrowRight")
    settled(page)
    assert page.inner_text("#engine-notice").startswith("Die Bewegungen der Physik-Engines gehören zu ")
    assert_german(page, german_words)
    page.click("#engine-back")
    settled(page)
    assert_german(page, german_words)


@pytest.mark.long
def test_stored_runs_are_told_in_another_language_at_once_and_stay_as_they_are(with_runs):
    page = with_runs
    words = "(ids) => ids.map((id) => document.getElementById(id).innerText)"
    boxes = ["engine-runs", "engine-details", "moment-key", "engine-notice", "doing"]
    at(page, 0.5)
    page.evaluate("document.querySelectorAll('#engine-details details')[1].open = false")
    page.locator("#engine-runs input:enabled").last.uncheck()
    settled(page)
    shown = "[...live.engines.shown].join()"
    kept = "#engine-runs input, #engine-runs details, #engine-details details"
    state = f"[...document.querySelectorAll('{kept}')].map((one) => one.checked ?? one.open)"
    german, runs, switches = page.evaluate(words, boxes), page.evaluate(shown), page.evaluate(state)
    assert False in switches
    assert "Fadenkraft an M1 [N]" in german[1]
    assert re.search(r"\d,\d{4} s", german[1])
    page.select_option("#language", "en")
    settled(page)
    english = page.evaluate(words, boxes)
    assert "string at M1 pulls [N]" in english[1]
    assert not re.search(r"\d,\d{4} s", english[1])
    assert page.text_content("#timeline text").startswith("the reference")
    assert page.title().startswith("The looping pendulum: ")
    assert (page.evaluate(shown), page.evaluate(state)) == (runs, switches)
    page.select_option("#language", "de")
    settled(page)
    assert page.evaluate(words, boxes) == german
    assert (page.evaluate(shown), page.evaluate(state)) == (runs, switches)
    assert page.title().startswith("Das Looping-Pendel: ")


@pytest.mark.long
@pytest.mark.parametrize(
    ("content", "message"),
    [
        (
            "",
            "bad.csv: keine Spalte t mit Zeiten in den ersten zwei Zeilen gefunden; diese Seite liest nur einfache Tabellen: "
            "looping-pendulum look 'bad.csv' --write plain.csv schreibt eine solche",
        ),
        (
            "t,light_x,light_y\n0,1,2\n.01,x,3\n",
            "bad.csv:3: Spalte 'light_x': 'x' gefunden, nötig ist eine Zahl; diese Seite liest nur einfache Tabellen: "
            "looping-pendulum look 'bad.csv' --write plain.csv schreibt eine solche",
        ),
        (
            "t,light_x,light_y\n0,1,2\n.01,150.5,3\n",
            "bad.csv: light_x = 150,5 m gefunden, nötig sind höchstens 20 m; eine andere Einheit wählen",
        ),
    ],
)
def test_a_bad_file_is_refused_in_german_and_then_in_english(german, german_words, content, message):
    page = german.page
    drop_file(page, "bad.csv", content)
    until(page, "document.getElementById('trial-error').textContent !== ''")
    assert page.inner_text("#trial-error") == message
    assert_german(page, german_words)
    page.select_option("#language", "en")
    settled(page)
    assert "found" in page.inner_text("#trial-error")


@pytest.mark.long
def test_numbers_have_a_comma_and_are_taken_with_one(german):
    page = german.page
    assert page.input_value("#field-release_angle") == "113,08"
    assert "0,3814 s" in page.inner_text("#result")
    type_into(page, "#field-release_angle", "112,5")
    settled(page)
    assert value(page, "release_angle") == 112.5
    assert page.get_attribute("#range-release_angle", "aria-valuetext") == "112,5 °"
    assert "Vorher: 0,3814 s" in page.inner_text("#compared")
    # Links and files are for programs, in any language
    assert "release_angle_deg=112.5&" in page.evaluate("location.hash")
    assert "112,5" not in page.evaluate("live.keeping.scenario()")


@pytest.mark.long
def test_another_language_keeps_all_that_was_set(page):
    type_into(page, "#field-mass_ratio", "7")
    page.evaluate("live.player.stopAt(0.2)")
    state, past = page.evaluate("live.state"), page.evaluate("live.history.place")
    page.select_option("#language", "de")
    settled(page)
    assert page.evaluate("live.state") == state
    assert page.evaluate("live.history.place") == past
    assert page.evaluate("live.player.time") == 0.2
    assert page.evaluate("location.hash").endswith("&lang=de")
    page.evaluate("location.hash = location.hash.replace('lang=de', 'lang=en')")
    until(page, "document.documentElement.lang === 'en'")
    assert page.input_value("#language") == "en"
    assert page.evaluate("live.state") == state


@pytest.mark.long
def test_the_language_is_the_readers_and_a_link_may_name_another(visit):
    opened = visit(page_text(), locale="de-CH")
    page = opened.page
    assert page.inner_text("h1") == "Das Looping-Pendel"
    assert "lang=" not in page.evaluate("location.hash")
    page.goto(f"{page.url.partition('#')[0]}?again#mass_ratio=5&lang=en")
    assert page.inner_text("h1") == "The looping pendulum"
    assert value(page, "mass_ratio") == 5
    assert opened.complaints == []


def test_german_fits_a_narrow_screen(visit):
    opened = visit(page_text(), locale="de-DE", viewport=PHONE | {"width": 320}, has_touch=True, is_mobile=True)
    assert opened.page.get_attribute("html", "lang") == "de"
    assert sideways(opened.page) <= 0
