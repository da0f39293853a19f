"""The demonstration in a real browser: what moves, what is marked where, what can be switched, and that it fetches nothing."""

from __future__ import annotations

import numpy as np
import pytest

from looping_pendulum.engines.trajectory import RunStatus
from looping_pendulum.teaching import demo
from tests.pages.axe import violations
from tests.pages.conftest import PHONE, sideways, until
from tests.pages.small import HOSTILE, LABELS, hostile_result, small_result, with_points

ROUNDING = 1e-5
"""The page's numbers have 1e-5 rad and 1e-6 m, which at 0.58 m of string is 6 micrometres [m]."""
DRAWN = 1 / 500
"""Time between drawn places [s]."""

COUNT = """(colour) => {
  const canvas = document.getElementById("stage"), context = canvas.getContext("2d");
  const [r, g, b] = [1, 3, 5].map((i) => parseInt(colour.slice(i, i + 2), 16));
  const { data } = context.getImageData(0, 0, canvas.width, canvas.height);
  let count = 0;
  for (let i = 0; i < data.length; i += 4) if (data[i] === r && data[i + 1] === g && data[i + 2] === b) count += 1;
  return count;
}"""
"""Pixels of the stage that have a colour."""


RINGS = """() => {
  const original = CanvasRenderingContext2D.prototype.arc;
  let count = 0;
  CanvasRenderingContext2D.prototype.arc = function (...circle) {
    if (this.canvas.id === "stage" && [2.4, 6.5].includes(circle[2])) count += 1;
    original.apply(this, circle);
  };
  demo.setTime(demo.time);
  return new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => {
    CanvasRenderingContext2D.prototype.arc = original;
    done(count);
  })));
}"""
"""Tracked points that one frame draws: circles with the radius of a point, or of the latest one [px]."""


@pytest.fixture(scope="module")
def one_page(visit_once):
    return visit_once(demo.render(small_result()))


@pytest.fixture
def opened(one_page):
    """The page, as it is when just loaded."""
    page = one_page.page
    page.evaluate("() => { demo.pause(); demo.setTime(0); window.scrollTo(0, 0); }")
    page.click("[data-slow='4']")
    for box in page.locator("#runs input:enabled").all():
        box.check()
    page.evaluate("document.activeElement.blur()")
    frame(page)
    return one_page


def at(page, time):
    """Set the time and wait until it is drawn."""
    page.evaluate("(t) => demo.setTime(t)", time)
    until(page, f"document.getElementById('clock').textContent === '{time:.3f} s'")


def frame(page):
    """Wait until the next frame is drawn."""
    page.evaluate("() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")


def test_it_loads_without_complaint_or_request(opened):
    until(opened.page, "demo.frames > 0")
    opened.page.click("#theme")
    opened.page.click("#end")
    opened.page.click("#theme")
    opened.assert_no_requests_or_complaints(opened.page.url)


def test_masses_are_where_the_runs_have_them(opened):
    samples = small_result().samples
    tracks = [
        ("reference", samples.reference),
        *((f"run{i}", a.run) for i, a in enumerate(samples.aligned, start=1) if len(a.t) > 1),
    ]
    assert len(tracks) == 4
    for name, run in tracks:
        for i in range(0, len(run.t), 200):
            opened.page.evaluate("(t) => demo.setTime(t)", float(run.t[i]))
            place = opened.page.evaluate("(id) => demo.place(id)", name)
            assert np.hypot(place["x"] - run.light_position[i, 0], place["y"] - run.light_position[i, 1]) < ROUNDING
            assert place["drop"] == pytest.approx(run.heavy_drop[i], abs=ROUNDING)


def test_play_moves_the_masses_and_stops_at_the_end(opened):
    page = opened.page
    page.click("[data-slow='1']")
    before, picture = page.evaluate("demo.place('reference')"), page.evaluate(COUNT, "#000000")
    page.click("#play")
    until(page, "demo.time > 0.2")
    assert page.evaluate("demo.place('reference')")["x"] - before["x"] > 0.01
    assert page.evaluate(COUNT, "#000000") != picture
    until(page, "!demo.playing")
    assert page.evaluate("demo.time") == small_result().duration
    page.click("#play")  # from the end it begins anew
    until(page, "demo.playing && demo.time < 0.5")


def test_slow_motion_is_slower(opened):
    page = opened.page
    page.click("[data-slow='50']")
    page.click("#play")
    until(page, "demo.time > 0")
    start = page.evaluate("[performance.now(), demo.time]")
    page.wait_for_timeout(300)
    end = page.evaluate("[performance.now(), demo.time]")
    seconds, motion = (end[0] - start[0]) / 1000, end[1] - start[1]
    assert 0 < motion <= (seconds + 0.1) / 50  # 0.1 s: a frame that was under way; a late frame only slows it


def test_the_slider_sets_the_time_and_all_that_follows_it(opened):
    page = opened.page
    page.locator("#time").fill("0.5")
    frame(page)
    assert page.evaluate("demo.time") == 0.5
    assert page.inner_text("#clock") == "0.500 s"
    reference = small_result().samples.reference
    assert page.inner_text("#now tbody tr:first-child td:nth-child(2)") == f"{1e3 * reference.heavy_drop[500]:.1f}"
    assert "sticks" in page.inner_text("#doing")
    cursors = page.eval_on_selector_all(".panel .cursor", "(lines) => lines.map((l) => Number(l.getAttribute('x1')))")
    assert len(cursors) == 5
    assert len(set(cursors)) == 1


def test_a_click_in_a_panel_sets_the_time(opened):
    panel = opened.page.locator(".panel svg").first
    panel.scroll_into_view_if_needed()
    box = panel.bounding_box()
    panel.click(position={"x": 46 + 0.25 * (box["width"] - 56), "y": 40})  # 46 and 10: the panel's edges
    assert opened.page.evaluate("demo.time") == pytest.approx(0.25 * small_result().duration, abs=0.01)


def test_keys(opened):
    page = opened.page
    page.keyboard.press("End")
    assert page.evaluate("demo.time") == small_result().duration
    page.keyboard.press("Home")
    page.keyboard.press("ArrowRight")
    page.keyboard.press("Shift+ArrowRight")
    assert page.evaluate("demo.time") == pytest.approx(11 * DRAWN)
    page.keyboard.press("ArrowLeft")
    assert page.evaluate("demo.time") == pytest.approx(10 * DRAWN)
    page.keyboard.press("Space")
    assert page.evaluate("demo.playing")
    page.keyboard.press("Space")
    assert not page.evaluate("demo.playing")


def test_keys_go_from_moment_to_moment_of_the_shown_runs(opened):
    page = opened.page
    for box in page.locator("#runs input:enabled").all()[1:]:
        box.uncheck()
    times = [event["t"] for event in page.evaluate("demo.data.runs[0].events")]
    assert len(times) == 4
    at(page, 0.0)
    for expected in (*times, times[-1]):
        page.keyboard.press("n")
        assert page.evaluate("demo.time") == expected
    page.keyboard.press("p")
    assert page.evaluate("demo.time") == times[-2]
    page.locator("#runs input[data-run=run1]").check()
    page.keyboard.press("Home")
    page.keyboard.press("N")
    assert page.evaluate("demo.time") == min(times[0], page.evaluate("demo.data.runs[1].events[0].t"))


@pytest.mark.parametrize("what", ["[data-slow='10']", "#forward", "#runs input[data-run=run1]", "#runs .name >> nth=1"])
def test_space_plays_whatever_was_clicked_last(opened, what):
    page = opened.page
    page.click(what)
    frame(page)
    before = page.evaluate("[demo.time, demo.shown.length]")
    page.keyboard.press("Space")
    assert page.evaluate("demo.playing")
    page.keyboard.press("Space")
    assert not page.evaluate("demo.playing")
    assert page.evaluate("demo.time") - before[0] < 0.1
    assert page.evaluate("demo.shown.length") == before[1]


def test_space_on_a_button_that_the_keyboard_led_to_presses_it(opened):
    page = opened.page
    page.locator("#end").focus()
    page.keyboard.press("Space")
    assert page.evaluate("demo.time") == small_result().duration


def test_tracked_points_come_in_step_and_can_be_switched_off(visit):
    result = with_points(small_result())
    opened = visit(demo.render(result))
    page = opened.page
    assert page.inner_text("#runs .run[data-run=measured] .name") == "measured: mine"
    assert "light mass 20 mm" in page.inner_text("#runs .run[data-run=reference] .caption")
    times = np.array(result.trial.tracks[0].track.t)
    for time in (0.0, 0.25, 0.6):
        at(page, time)
        assert page.evaluate(RINGS) == 2 * np.sum(times <= time), "both masses, up to the time"
    rings = page.locator(".panels g[data-run=measured]")
    assert rings.count() == 2, "drop, and distance from the reference"
    assert rings.first.locator("circle").count() == len(times)
    page.locator("#runs input[data-run=measured]").uncheck()
    frame(page)
    assert page.evaluate(RINGS) == 0
    assert not rings.first.is_visible()
    assert page.evaluate("demo.shown").count("measured") == 0
    opened.assert_no_requests_or_complaints(page.url)


def test_a_switched_off_engine_disappears(opened):
    page = opened.page
    at(page, 0.5)
    colour = page.evaluate("Theme.colour(demo.data.runs[1].colour)").lower()
    assert page.evaluate(COUNT, colour) > 20
    assert page.locator(".panels g[data-run=run1]").first.is_visible()
    page.locator("#runs input[data-run=run1]").uncheck()
    frame(page)
    assert page.evaluate(COUNT, colour) == 0
    assert not any(group.is_visible() for group in page.locator(".panels g[data-run=run1]").all())
    assert "run1" not in page.evaluate("demo.shown")
    page.locator("#runs input[data-run=run1]").check()
    frame(page)
    assert page.evaluate(COUNT, colour) > 20


def test_marks_are_where_the_result_has_them(opened):
    page, result = opened.page, small_result()
    halts = {"reference": result.reference.landmarks.halting_time}
    halts |= {f"run{i}": e.landmarks.halting_time for i, e in enumerate(result.engines, start=1)}
    assert sum(halt is not None for halt in halts.values()) == 2
    slider = page.locator("#time").bounding_box()
    for name, halt in halts.items():
        marks = page.locator(f"#timeline g[data-run={name}] g[data-kind=halt]")
        assert marks.count() == (halt is not None)
        if halt is None:
            continue
        assert float(marks.get_attribute("data-time")) == halt
        box = marks.bounding_box()
        along = (box["x"] + box["width"] / 2 - slider["x"] - 8) / (slider["width"] - 16)  # 8 px: half of the slider's thumb
        assert along * result.duration == pytest.approx(halt, abs=2 * result.duration / slider["width"])  # two pixels
        marks.click()
        assert page.evaluate("demo.time") == halt
    kinds = page.eval_on_selector_all(
        "#timeline g[data-run=reference] g.mark", "(marks) => marks.map((m) => [m.dataset.kind, Number(m.dataset.time)])"
    )
    events = dict(result.reference.events)
    expected = [["stop", result.reference.landmarks.stops[0].time], ["stick", result.reference.landmarks.stops[1].time]]
    assert kinds == [*expected, ["slip", events["slip_onset"]], ["halt", events["halt"]]]


def test_gaps_say_why(opened):
    page = opened.page
    rows = page.locator("#runs .run").all()
    assert [row.locator(".name").inner_text() for row in rows] == ["reference", *LABELS]
    assert rows[4].locator("input").is_disabled()
    assert RunStatus.MISSING.value in rows[4].inner_text()
    assert RunStatus.STRING_DRIFT.value in rows[3].inner_text()
    assert page.locator("#timeline g[data-run=run3] g[data-kind=broke]").count() == 1
    assert "not run" in page.locator("#timeline g[data-run=run4]").text_content()
    assert "No friction on the rod" in rows[1].inner_text()
    assert "fed in by our adapter" in rows[2].inner_text()


@pytest.mark.parametrize(("reduced_motion", "plays"), [("reduce", False), ("no-preference", True)])
def test_it_plays_by_itself_only_where_motion_is_welcome(visit, reduced_motion, plays):
    opened = visit(demo.render(small_result()), reduced_motion=reduced_motion)
    assert opened.page.evaluate("demo.playing") is plays


def test_dark_and_light(visit):
    page = visit(demo.render(small_result()), color_scheme="dark").page
    ground = "getComputedStyle(document.body).backgroundColor"
    dark, black = page.evaluate(ground), page.evaluate(COUNT, "#ffffff")
    assert black > 0  # the reference is white there
    page.click("#theme")
    assert page.evaluate(ground) != dark
    assert page.inner_text("#theme") == "Dark"


@pytest.mark.parametrize("color_scheme", ["light", "dark"])
def test_a_phone_shows_it_without_scrolling_sideways(visit, color_scheme):
    page = visit(demo.render(small_result()), viewport=PHONE, color_scheme=color_scheme).page
    assert sideways(page) == 0
    stage = page.locator("#stage").bounding_box()
    assert stage["width"] > 300
    heights = page.eval_on_selector_all(".controls button", "(all) => all.map((one) => one.getBoundingClientRect().height)")
    assert min(heights) >= 24  # WCAG 2.2, 2.5.8: size of a target [px]


def test_everything_that_acts_has_a_name(opened):
    unnamed = opened.page.evaluate(
        """() => [...document.querySelectorAll("button, input, canvas, svg[role], [role=region]")].filter((e) =>
          !(e.getAttribute("aria-label") || e.textContent.trim() || e.labels?.length)).map((e) => e.outerHTML.slice(0, 80))"""
    )
    assert unnamed == []


def test_axe_finds_nothing(opened):
    assert violations(opened.page) == []


def test_hostile_names_show_as_text(visit):
    opened = visit(demo.render(hostile_result()))
    at(opened.page, 0.5)
    assert HOSTILE in opened.page.inner_text("h1")
    assert HOSTILE in opened.page.locator("#runs .name").nth(1).inner_text()
    assert HOSTILE in opened.page.locator("#now th").nth(7).text_content()
    assert opened.page.locator("img").count() == 0
    opened.assert_no_requests_or_complaints(opened.page.url)
