"""Where things are on the live page: enlarged, on a phone upright and on its side, very narrow, and on a projector."""

import pytest

from tests.pages.conftest import DESKTOP, PHONE, sideways, until
from tests.pages.live_page import page_text, settled

PHONE_ON_ITS_SIDE = {"width": 844, "height": 390}
NARROW = {"width": 320, "height": 640}
PROJECTOR = {"width": 1920, "height": 1080}
DOUBLED = [{"width": 640, "height": 450}, {"width": 640, "height": 360}, {"width": 960, "height": 540}]
"""1280 x 900, 1280 x 720 and 1920 x 1080 at 200 %."""
MOST_OF_A_PHONE = 0.4

UNREACHABLE = """async () => {
  const found = [];
  for (const control of document.querySelectorAll(".scene :is(button, input, select, textarea, summary)")) {
    if (!control.checkVisibility()) continue;
    control.scrollIntoView({ block: "nearest" });
    const { left, right, top, bottom } = control.getBoundingClientRect();
    const [x, y] = [(left + right) / 2, (top + bottom) / 2], seen = document.elementFromPoint(x, y);
    const isInside = left >= -1 && right <= innerWidth + 1 && top >= -1 && bottom <= innerHeight + 1;
    const isOnTop = seen && (control.contains(seen) || [...(control.labels ?? [])].some((label) => label.contains(seen)));
    if (!isInside || !isOnTop) found.push([control.id || control.textContent, left, top, right, bottom]);
  }
  window.scrollTo(0, 0);
  return found;
}"""
"""Controls beside and under the stage that cannot be brought on the screen, or lie under something there."""

LABELS = """() => {
  const { fillText } = CanvasRenderingContext2D.prototype, sizes = [];
  CanvasRenderingContext2D.prototype.fillText = function (...words) {
    if (this.canvas.id === "stage") sizes.push(parseFloat(this.font.match(/[\\d.]+(?=px)/)) * this.getTransform().a);
    return fillText.call(this, ...words);
  };
  live.draw();
  CanvasRenderingContext2D.prototype.fillText = fillText;
  return Math.min(...sizes) / Math.min(devicePixelRatio, 2);
}"""
"""Size of the smallest words on the stage [px]."""


def in_sizes(*sizes):
    return pytest.mark.parametrize("size", sizes, ids=[f"{size['width']}x{size['height']}" for size in sizes])


def box(page, selector):
    return page.locator(selector).bounding_box()


def answer_third_step(page):
    """Answer the step with the longest words, by mouse, from where the button is."""
    page.click("#lesson > summary")
    page.click("#lesson-steps li:nth-child(3) button")
    page.check("#lesson-options input[value=times]")
    page.click("#lesson-change")
    until(page, "live.lesson.watched === null")
    settled(page)


@pytest.mark.long
@pytest.mark.parametrize("locale", ["en", "de"])
@in_sizes(DESKTOP, PHONE, PHONE_ON_ITS_SIDE, NARROW, *DOUBLED)
def test_no_control_leaves_the_screen(visit, size, locale):
    page = visit(page_text(), viewport=size, locale=locale).page
    page.evaluate("document.querySelectorAll('.scene details').forEach((d) => { d.open = true; })")
    page.check("#forces")
    for place in (1, 3, 4, 7):
        page.click(f"#lesson-steps li:nth-child({place}) button")
        assert page.evaluate(UNREACHABLE) == [], place
        assert sideways(page) <= 0


@in_sizes(PHONE, PHONE_ON_ITS_SIDE, NARROW, *DOUBLED)
def test_the_stage_is_in_sight_beside_the_lesson_and_leaves_it_room(visit, size):
    page = visit(page_text(), viewport=size).page
    answer_third_step(page)
    stage, button = box(page, "#stage"), box(page, "#lesson-change")
    assert stage["y"] >= 0
    assert stage["y"] + stage["height"] <= size["height"]
    assert stage["height"] <= MOST_OF_A_PHONE * size["height"] + 1
    assert 0 <= button["y"] <= size["height"] - button["height"], "stage and button are seen together"
    if size["width"] < size["height"]:
        # Upright, with all that stays above the settings, whatever came of the run
        for values in ({}, {"mass_ratio": 2, "release_angle": 120, "kinetic_friction": 1, "static_friction": 1}):
            page.evaluate("(values) => live.set({ ...live.state, values: { ...live.state.values, ...values } })", values)
            settled(page)
            seen = box(page, ".seen")
            assert seen["height"] <= MOST_OF_A_PHONE * size["height"] + 1
            assert box(page, "#stage")["height"] > 100
            for part in ("#play", "#time", "#result"):
                assert box(page, part)["y"] + box(page, part)["height"] <= seen["y"] + seen["height"] + 1, part


def test_on_a_projector_words_grow_with_the_stage(visit):
    opened = visit(page_text(), viewport=PROJECTOR)
    page = opened.page
    page.check("#forces")
    settled(page)
    before, height = page.evaluate(LABELS), box(page, "#stage")["height"]
    button = page.evaluate("parseFloat(getComputedStyle(document.getElementById('start')).fontSize)")
    page.click("#full")
    until(page, "document.fullscreenElement !== null")
    until(page, f"document.getElementById('stage').clientHeight > {1.2 * height}")
    settled(page)
    assert page.evaluate(LABELS) > 1.4 * before
    assert page.evaluate("parseFloat(getComputedStyle(document.getElementById('start')).fontSize)") > 1.4 * button
    for part in ("#stage", "#play", "#time", "#result", "#full", "#forces", "#ghost", "#film > summary"):
        assert box(page, part)["y"] >= 0, part
        assert box(page, part)["y"] + box(page, part)["height"] <= PROJECTOR["height"], part
    # What is drawn larger is taken where it is seen
    x, y = page.evaluate("""() => {
      const { left, top } = document.getElementById("stage").getBoundingClientRect(), { view, enlarged } = live.stage;
      const [x, y] = live.run.at(0).light;
      return [left + enlarged * view.x(x), top + enlarged * view.y(y)];
    }""")
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 30, y - 60, steps=3)
    page.mouse.up()
    settled(page)
    assert 60 < page.evaluate("live.state.values.release_angle") < 113
    assert opened.complaints == []


def test_a_page_whose_scripts_are_forbidden_says_so_in_one_sentence(chromium, tmp_path):
    """As where a server's policy, or a page around it, forbids them: no words can be filled in."""
    file = tmp_path / "page.html"
    for name, text, options in (
        ("policy", page_text().replace("script-src ", "script-src 'none'; x-src "), {}),
        ("off", page_text(), {"java_script_enabled": False}),
    ):
        file.write_text(text, encoding="utf-8")
        context = chromium.new_context(viewport=PHONE, **options)
        page = context.new_page()
        page.goto(file.as_uri())
        page.wait_for_timeout(1500)  # it appears after a second
        shown = page.locator("body").aria_snapshot()
        assert "its scripts cannot run here" in shown, name
        assert "Skripte" in shown, name
        assert 'heading "The looping pendulum" [level=1]' in shown, name
        assert "button" not in shown, name
        context.close()


def test_an_error_of_the_page_is_one_sentence(visit):
    page = visit(page_text()).page
    page.evaluate("setTimeout(() => { throw new Error('x'); })")
    until(page, "document.getElementById('fault').textContent !== ''")
    assert page.inner_text("#fault") == "Something in this page has failed; reload it: settings and answers are kept."


def test_a_page_that_does_not_start_is_one_sentence(chromium, tmp_path):
    file = tmp_path / "page.html"
    file.write_text(page_text(), encoding="utf-8")
    page = chromium.new_page()
    page.add_init_script("delete window.IntersectionObserver")
    page.goto(file.as_uri())
    until(page, "document.getElementById('main').innerText")
    assert page.inner_text("#main") == "This page cannot be shown in this browser; please open it in another one."
    page.close()
