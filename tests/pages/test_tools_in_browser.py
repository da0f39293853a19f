"""The tools of a bench: over the stage stopwatch, ruler, protractor and arrows; values in the plots; a curve of one's own.

Also the sheets for teachers.
"""

import re

import numpy as np
import pytest

from tests.pages.axe import violations
from tests.pages.conftest import DESKTOP, PHONE, sideways, until
from tests.pages.live_page import COUNT, STAGE, at, page_text, settled, type_into
from tests.pages.test_languages_in_browser import KEEP_WHAT_IS_DRAWN, assert_german, german_words  # noqa: F401

SKY, YELLOW = "#56b4e9", "#e69f00"
TOUCH = {"has_touch": True, "is_mobile": True}
TOOLS = ("stopwatch", "ruler", "protractor")
CORNERS = """(name) => live.bench.tools.find((tool) => tool.name === name).points"""
"""Points of a tool in the plane [m]."""

VALUES = """(time) => {
  const { drop, heavyTension, lightTension } = live.run.at(time);
  return [100 * drop, heavyTension, lightTension];
}"""


@pytest.fixture
def page(opened):
    """The page in light colours, without tools, and as before after the test."""
    page = opened.page
    page.evaluate("document.documentElement.dataset.theme === 'light' || document.getElementById('theme').click()")
    page.evaluate("document.querySelectorAll('details').forEach((one) => { one.open = one.matches('.menu, #own-curve'); })")
    settled(page)
    yield page
    for box in ("velocity", "acceleration", "own-line", *(f"show-{tool}" for tool in TOOLS)):
        page.set_checked(f"#{box}", False)
    page.fill("#own-formula", "")
    page.select_option("#own-quantity", "drop")
    page.evaluate("document.querySelectorAll('details').forEach((one) => { one.open = false; })")
    assert [one for one in opened.complaints if "willReadFrequently" not in one] == [], "what only tests read"


def drag(page, handle, dx, dy):
    box = page.locator(handle).bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + dx / 2, y + dy / 2)
    page.mouse.move(x + dx, y + dy)
    page.mouse.up()
    settled(page)


def reading(page, handle):
    return float(re.match(r"[\d.]+", page.get_attribute(handle, "aria-valuetext"))[0])


def test_the_ruler_shows_the_distance_of_its_ends(page):
    assert not page.is_visible("#ruler-0")
    page.check("#show-ruler")
    settled(page)
    scale = page.evaluate("live.stage.view.scale")
    before = reading(page, "#ruler-0")
    drag(page, "#ruler-2", 60, -80)
    a, b = page.evaluate(CORNERS, "ruler")
    assert reading(page, "#ruler-0") == pytest.approx(100 * np.hypot(*np.subtract(a, b)), abs=0.05)
    assert reading(page, "#ruler-0") == pytest.approx(np.hypot(before + 6000 / scale, 8000 / scale), abs=0.2)
    # As a whole it keeps its length
    drag(page, "#ruler-0", -30, -50)
    moved = np.subtract(page.evaluate(CORNERS, "ruler"), [a, b])
    assert moved == pytest.approx(np.array([[-30 / scale, 50 / scale]] * 2), abs=1 / scale)
    page.focus("#ruler-1")
    time, start = page.evaluate("live.player.time"), page.evaluate(CORNERS, "ruler")[0]
    for key in ("ArrowRight", "Shift+ArrowRight", "ArrowUp"):
        page.keyboard.press(key)
    settled(page)
    assert np.subtract(page.evaluate(CORNERS, "ruler")[0], start) == pytest.approx([11 / scale, 1 / scale], abs=1e-9)
    assert page.evaluate("live.player.time") == time, "the arrow keys are the ruler's"
    page.uncheck("#show-ruler")
    settled(page)
    assert not page.is_visible("#ruler-0")


def test_the_ruler_measures_what_the_model_has(page):
    page.check("#show-ruler")
    settled(page)
    # Its ends on the rod's axis and on the light mass
    page.evaluate("""() => {
      live.bench.tools[0].points = [[0, 0], live.run.at(0).light];
      live.wake();
    }""")
    settled(page)
    assert reading(page, "#ruler-0") == pytest.approx(np.hypot(58.08, 0.625), abs=0.05 + 1e-6)


def test_the_protractor_shows_the_angle_between_its_arms(page):
    page.check("#show-protractor")
    settled(page)
    assert reading(page, "#protractor-0") == pytest.approx(90, abs=0.05)
    drag(page, "#protractor-2", -20, 90)
    corner, *arms = np.array(page.evaluate(CORNERS, "protractor"))
    first, second = (arm - corner for arm in arms)
    angle = np.degrees(np.arccos(first @ second / np.linalg.norm(first) / np.linalg.norm(second)))
    assert reading(page, "#protractor-0") == pytest.approx(angle, abs=0.05)
    assert angle > 100
    assert page.get_attribute("#protractor-1", "aria-valuetext").endswith("°")


def test_no_tool_leaves_the_stage(page):
    page.check("#show-ruler")
    page.check("#show-stopwatch")
    settled(page)
    drag(page, "#ruler-0", -2000, 0)
    drag(page, "#stopwatch-grip", 3000, 2000)
    stage = page.locator(STAGE).bounding_box()
    for part in ("#ruler-1", "#stopwatch"):
        box = page.locator(part).bounding_box()
        middle = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        assert stage["x"] <= middle[0] <= stage["x"] + stage["width"]
        assert stage["y"] <= middle[1] <= stage["y"] + stage["height"]


def test_the_stopwatch_runs_with_the_time_of_the_motion(page):
    page.check("#show-stopwatch")
    at(page, 0.1)
    page.click("#stopwatch-run")
    at(page, 0.35)
    assert page.inner_text("#stopwatch-time") == "0.250 s"
    page.click("#stopwatch-run")
    at(page, 0.9)
    assert page.inner_text("#stopwatch-time") == "0.250 s"
    assert page.inner_text("#stopwatch-said") == "The stopwatch reads 0.250 seconds."
    # It goes on from there
    page.focus("#stopwatch-run")
    page.keyboard.press("Enter")
    at(page, 1.0)
    page.keyboard.press("Enter")
    assert page.inner_text("#stopwatch-time") == "0.350 s"
    page.click("#stopwatch-reset")
    assert page.inner_text("#stopwatch-time") == "0.000 s"
    page.evaluate("live.bench.stopwatch.place = [50, 50]; live.bench.stopwatch.move(0, 0)")
    before = page.locator("#stopwatch").bounding_box()
    page.focus("#stopwatch-grip")
    page.keyboard.press("Shift+ArrowRight")
    page.keyboard.press("ArrowDown")
    after = page.locator("#stopwatch").bounding_box()
    assert (after["x"] - before["x"], after["y"] - before["y"]) == (40, 4)


def test_arrows_have_a_key_with_their_scales(page):
    at(page, 0.3)
    assert not page.is_visible("#key")
    counts = {colour: page.evaluate(COUNT, [STAGE, colour]) for colour in (SKY, YELLOW)}
    assert set(counts.values()) == {0}
    page.check("#velocity")
    settled(page)
    assert page.evaluate(COUNT, [STAGE, YELLOW]) > 60
    assert page.evaluate(COUNT, [STAGE, SKY]) == 0
    page.check("#acceleration")
    settled(page)
    assert page.evaluate(COUNT, [STAGE, SKY]) > 60
    words = page.inner_text("#key")
    speed, unit = re.search(r"velocity\s*= ([\d.]+) (m/s)", words).groups()
    # The key's arrow is as long as the stage draws this speed; the fastest 1 % is beyond its longest
    drawn = page.locator("#key canvas").first.evaluate("(canvas) => canvas.clientWidth") - 4
    most = page.evaluate("""() => {
      const speedOf = ({ lightVelocity, heavyVelocity }) => Math.max(Math.hypot(...lightVelocity), Math.abs(heavyVelocity[1]));
      const speeds = live.run.samples.map(speedOf);
      return speeds.sort((a, b) => a - b)[Math.floor(0.99 * (speeds.length - 1))];
    }""")
    assert drawn == pytest.approx(90 * float(speed) / most, abs=1)
    assert re.search(r"acceleration\s*= \d+ m/s²", words)
    assert unit == "m/s"


def test_values_are_read_under_the_pointer_and_by_keys(page):
    page.evaluate("""() => {
      window.words = [];
      const { fillText } = CanvasRenderingContext2D.prototype;
      CanvasRenderingContext2D.prototype.fillText = function (words, ...place) {
        if (this.canvas.closest(".plots")) window.words.push(words);
        return fillText.call(this, words, ...place);
      };
    }""")
    plot = page.locator("[data-plot=drop]")
    plot.scroll_into_view_if_needed()
    box, end = plot.bounding_box(), page.evaluate("live.run.end")
    page.mouse.move(box["x"] + 45 + 0.25 * (box["width"] - 2 - 54), box["y"] + 90)  # 44 and 10: the plot's edges; 1: its border
    settled(page)
    time = page.evaluate("live.probe")
    assert time == pytest.approx(0.25 * end, abs=0.01 * end)
    assert page.evaluate("live.player.time") == 0, "the time stays"
    drop, *pulls = page.evaluate(VALUES, time)
    words = page.evaluate("window.words")
    assert {f"{time:.3f} s", f"{drop:.1f}", f"{pulls[0]:.2f}", f"{pulls[1]:.2f}"} <= set(words)
    page.mouse.move(5, 5)
    assert page.evaluate("live.probe") is None
    page.focus("[data-plot=pull]")
    for key in ("Home", "Shift+ArrowRight", "ArrowRight", "ArrowRight", "ArrowLeft"):
        page.keyboard.press(key)
    _, *pulls = page.evaluate(VALUES, 0.022)
    said = page.get_attribute("[data-plot=pull]", "aria-valuetext")
    assert said == f"At 0.022 s: at M2 {pulls[0]:.2f}, at M1 {pulls[1]:.2f}"
    assert page.evaluate("live.player.time") == 0
    page.keyboard.press("Enter")
    assert page.evaluate("live.player.time") == pytest.approx(0.022)
    page.keyboard.press("Tab")
    page.keyboard.press("Tab")
    settled(page)


def test_what_a_finger_reads_stays_until_it_touches_something_else(visit):
    opened = visit(page_text(), viewport=PHONE, **TOUCH)
    page = opened.page
    page.locator("[data-plot=turns]").tap(position={"x": 150, "y": 80})
    settled(page)
    assert page.evaluate("live.probe") == page.evaluate("live.player.time") > 0
    page.locator("#plots-title").tap()
    assert page.evaluate("live.probe") is None
    for tool in TOOLS:
        page.evaluate("document.querySelector('.menu').open = true")
        page.locator(f"label:has(#show-{tool})").tap()
    page.locator("#stopwatch-run").tap()
    assert page.inner_text("#stopwatch-run") == "Stop"
    assert sideways(page) <= 0
    assert opened.complaints == []


def test_a_formula_lies_over_the_points_and_says_how_far_from_them(page):
    # A run of two falling masses is a parabola
    page.evaluate("""() => {
      const none = ["light_drag", "heavy_drag", "string_drag", "kinetic_friction", "static_friction"].map((name) => [name, 0]);
      live.set({ release: "vertical", values: { ...live.state.values, mass_ratio: 3, ...Object.fromEntries(none) } });
    }""")
    page.fill("#own-formula", "a/2 t²; a = 490,5")
    settled(page)
    result = page.inner_text("#own-result")
    assert float(re.match(r"RMS distance of your curve: ([\d.]+) cm;", result)[1]) == 0
    assert "points of the run" in result
    page.fill("#own-formula", "a/2 t² + 3; a = 490,5")
    settled(page)
    assert page.inner_text("#own-result").startswith("RMS distance of your curve: 3.00 cm;")
    page.fill("#own-formula", "1/(t - t)")
    settled(page)
    assert page.inner_text("#own-result") == "At 0.000 s your curve has no value."
    page.fill("#own-formula", "3*t +")
    settled(page)
    assert page.inner_text("#own-fault") == (
        "The formula, character 6: found the end, needed a number, t, a constant or a function."
    )
    assert page.get_attribute("#own-formula", "aria-invalid") == "true"


def test_formula_and_straight_line_are_held_to_measured_points(page):
    t = np.arange(40) / 60
    heavy = -0.03 - 0.4 * t
    rows = "\n".join(f"{time:.6f},{-0.5 - time / 10:.6f},{-0.2:.6f},0.00625,{y:.6f}" for time, y in zip(t, heavy, strict=True))
    csv = f"t,light_x,light_y,heavy_x,heavy_y\n{rows}\n"
    page.evaluate("(csv) => live.trial.open(new File([csv], 'some.csv'), false)", csv)
    until(page, "live.trial.trial !== null")
    page.fill("#own-formula", "40 t")
    page.check("#own-line")
    page.fill("#own-from", "0.1")
    type_into(page, "#own-to", "0.5")
    settled(page)
    start = page.evaluate("100 * live.run.at(0).heavy[1]") + 3
    assert "40 measured points" in page.inner_text("#own-result")
    rms = float(re.match(r"RMS distance of your curve: ([\d.]+) cm;", page.inner_text("#own-result"))[1])
    assert rms == pytest.approx(abs(start), abs=1e-3)
    slope = float(re.search(r"0\.100 s to 0\.500 s: slope ([\d.]+)", page.inner_text("#own-line-result"))[1])
    assert slope == pytest.approx(40, abs=0.01)
    page.select_option("#own-quantity", "x")
    settled(page)
    slope = float(re.search(r"slope (-?[\d.]+)", page.inner_text("#own-line-result"))[1])
    assert slope == pytest.approx(-10, abs=0.01)
    page.fill("#own-to", "0.105")
    settled(page)
    assert page.inner_text("#own-line-result").endswith("there are fewer than two points; choose other times.")


@pytest.mark.parametrize("language", ["en", "de"])
def test_the_teachers_sheet_of_the_open_step_is_printed_with_the_worksheet(opened, language):
    page = opened.page
    page.select_option("#language", language)
    sheets = page.locator("#handout article")
    page.evaluate("window.dispatchEvent(new Event('beforeprint'))")
    assert sheets.count() == 2
    page.evaluate("document.getElementById('lesson').open = true; live.lesson.open(2)")
    page.evaluate("window.dispatchEvent(new Event('beforeprint'))")
    assert sheets.count() == 3
    texts = page.evaluate("(language) => liveLanguages[language]", language)
    for part in ("aim", "say", "ask"):
        assert texts[f"teacher.friction.{part}"] in sheets.nth(2).text_content()
    page.evaluate("window.dispatchEvent(new Event('afterprint'))")
    # All steps, on a few pages of paper
    page.evaluate("window.print = () => window.dispatchEvent(new Event('beforeprint'))")
    page.evaluate("document.getElementById('class').open = true")
    page.click("#teacher-sheets")
    assert sheets.count() == 1
    assert sheets.locator("h2").count() == 7
    page.evaluate("window.dispatchEvent(new Event('afterprint'))")
    page.evaluate("document.querySelectorAll('details').forEach((one) => { one.open = false; }); live.lesson.open(0)")
    page.select_option("#language", "en")
    assert opened.complaints == []


@pytest.mark.parametrize("size", [DESKTOP, PHONE], ids=["desktop", "phone"])
def test_everything_switched_on_is_for_everyone(visit, size):
    opened = visit(page_text(), viewport=size)
    page = opened.page
    page.evaluate("document.querySelectorAll('details').forEach((one) => { one.open = true; })")
    for box in ("forces", "velocity", "acceleration", "own-line", *(f"show-{tool}" for tool in TOOLS)):
        page.check(f"#{box}")
    page.fill("#own-formula", "3 +")
    settled(page)
    assert violations(page) == []
    assert sideways(page) <= 0
    assert opened.complaints == []


@pytest.mark.long
def test_the_tools_are_german(visit, german_words):  # noqa: F811
    opened = visit(page_text(), locale="de")
    page = opened.page
    page.evaluate(KEEP_WHAT_IS_DRAWN)
    page.evaluate("document.querySelectorAll('details').forEach((one) => { one.open = true; })")
    for box in ("forces", "velocity", "acceleration", "own-line", *(f"show-{tool}" for tool in TOOLS)):
        page.check(f"#{box}")
    for formula in ("3*t", "1/(t-t)", "3 +", "q", "sin", "(t", "3 4", "#", "t; 3", "y ="):
        page.fill("#own-formula", formula)
        settled(page)
        assert_german(page, german_words)
    page.click("#stopwatch-run")
    page.click("#stopwatch-run")
    page.focus("[data-plot=energy]")
    settled(page)
    assert_german(page, german_words)
    assert opened.complaints == []
