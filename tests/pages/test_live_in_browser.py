"""The live page in a real browser: every control by mouse, keys and touch, its links, map and security policy.

What the model computes is held in tests/live; here the oracle is the reference's solution of the same settings.
"""

import math
import re

import numpy as np
import pytest

from looping_pendulum.live.write import live_settings
from looping_pendulum.reference_ode.solve import solve
from looping_pendulum.scenarios import load, shipped
from tests.pages.conftest import DESKTOP, PHONE, sideways, until
from tests.pages.live_page import (
    COUNT,
    STAGE,
    act_at_random,
    light_mass,
    page_text,
    played_to,
    preset,
    settled,
    type_into,
    value,
)

SHOWN = 5e-5
"""Half of the last digit of a time on the page [s]."""
PIXEL_IN_DRAG = 0.1
"""The page rounds what is dragged to a tenth of a degree and of a centimetre."""


def test_it_asks_for_nothing_and_complains_of_nothing(visit):
    opened = visit(page_text())
    page = opened.page
    until(page, "live.frames > 0")
    page.click("#theme")
    page.locator("#map").scroll_into_view_if_needed()
    until(page, "live.map.grids.length > 0")
    # The worker is made of the page's own script
    own = [url for url in opened.requests if not url.startswith("blob:")]
    assert own == [page.url.partition("#")[0]]
    assert opened.complaints == []


def test_the_policy_lets_nothing_be_loaded_or_evaluated(page):
    policy = page.get_attribute("meta[http-equiv=Content-Security-Policy]", "content")
    assert "default-src 'none'" in policy
    assert "'unsafe-eval'" not in policy
    assert "unsafe-inline" not in policy.partition("script-src")[2]
    refused = page.evaluate("""async () => {
      const outcomes = [];
      try { await fetch("https://example.org/"); } catch { outcomes.push("fetch"); }
      const image = new Image();
      const refused = new Promise((done) => { image.onerror = () => { outcomes.push("image"); done(); }; });
      image.src = "https://example.org/a.png";
      await refused;
      const script = document.createElement("script");
      script.textContent = "window.ranAnyway = true";
      document.body.append(script);
      const link = document.createElement("a");
      link.setAttribute("onclick", "window.ranAnyway = true");
      link.click();
      try { setTimeout("window.ranAnyway = true"); } catch { /* refused at once */ }
      await new Promise((done) => setTimeout(done, 50));
      return [...outcomes, Boolean(window.ranAnyway)];
    }""")
    assert refused == ["fetch", "image", False]


@pytest.mark.parametrize("is_there", [False, True], ids=["without WebAssembly", "where it is not allowed"])
def test_where_no_webassembly_runs_one_sentence_says_so(chromium, tmp_path, is_there):
    file = tmp_path / "page.html"
    file.write_text(page_text().replace(" 'wasm-unsafe-eval'", "") if is_there else page_text(), encoding="utf-8")
    page = chromium.new_page(locale="de-AT")
    faults = []
    page.on("pageerror", lambda error: faults.append(str(error)))
    if not is_there:
        page.add_init_script("delete globalThis.WebAssembly")
    page.goto(file.as_uri())
    until(page, "document.getElementById('main').innerText")
    assert page.inner_text("#main").startswith("Diese Seite rechnet mit WebAssembly, das dieser Browser nicht ")
    page.select_option("#language", "en")
    assert page.inner_text("#main").startswith("This page computes with WebAssembly, which this browser does not ")
    assert faults == []
    page.close()


DAILY = ("ten_to_one", "held")
"""Shipped scenarios whose halt the page shows daily; test_live.py runs all of them in Node."""


@pytest.mark.parametrize("name", [pytest.param(n, marks=[pytest.mark.accurate] * (n not in DAILY)) for n in shipped()])
def test_a_scenario_halts_when_the_reference_does(page, name):
    scenario = load(name)
    preset(page, name)
    reference = solve(scenario.parameters, duration=5.0)
    halt = page.evaluate("live.run.halt")
    assert halt == pytest.approx(reference.halting_time, abs=1e-7)
    words = page.inner_text("#result")
    if halt is not None:
        assert float(re.search(r"after ([\d.]+) s", words)[1]) == pytest.approx(halt, abs=SHOWN)
    assert page.inner_text("#fault") == ""
    assert page.input_value("#release") == scenario.parameters.release.value
    assert " ".join(scenario.description.split()) == page.inner_text("#story")


@pytest.mark.long
def test_a_slider_steps_by_keys_and_takes_a_typed_number(page):
    page.focus("#range-release_angle")
    for key, number in (
        ("Home", 5),
        ("ArrowRight", 6),
        ("ArrowUp", 7),
        ("PageUp", 17),
        ("ArrowLeft", 16),
        ("End", 180),
        ("PageDown", 170),
    ):
        page.keyboard.press(key)
        assert value(page, "release_angle") == number
    settled(page)  # a number that is drawn between the field's focus and the typing would be typed into
    page.fill("#field-release_angle", "112,5")
    page.keyboard.press("Enter")
    assert value(page, "release_angle") == 112.5


@pytest.mark.long
def test_every_slider_has_a_name_a_range_and_steps(opened):
    outcomes = opened.page.evaluate("""() => liveControls.map(({ name, min, max }) => {
      const range = document.getElementById(`range-${name}`), field = document.getElementById(`field-${name}`);
      const after = (key) => {
        range.dispatchEvent(new KeyboardEvent("keydown", { key }));
        return live.state.values[name];
      };
      const steps = ["Home", "ArrowRight", "End", "PageDown"].map(after);
      const typed = (min + max) / 2;
      field.value = String(typed);
      field.dispatchEvent(new Event("change"));
      return { name, min, max, steps, typed, value: live.state.values[name], label: range.labels[0].textContent,
        ends: [...range.parentElement.querySelectorAll(".limits span")].map((limit) => Number(limit.textContent)) };
    })""")
    assert len(outcomes) == opened.page.locator(".setting").count()
    for outcome in outcomes:
        least, more, most, less = outcome["steps"]
        assert (least, most) == (outcome["min"], outcome["max"]), outcome
        assert least < more < most, outcome
        assert least < less < most, outcome
        assert outcome["value"] == pytest.approx(outcome["typed"]), outcome
        assert outcome["label"], outcome
        assert outcome["ends"] == [outcome["min"], outcome["max"]], outcome


def test_a_slider_follows_the_mouse(page):
    box = page.locator("#range-mass_ratio").bounding_box()
    page.mouse.click(box["x"] + 0.75 * box["width"], box["y"] + box["height"] / 2)
    assert value(page, "mass_ratio") == pytest.approx(1 + 0.75 * 19, abs=0.5)
    before = page.evaluate("location.hash")
    assert f"mass_ratio={value(page, 'mass_ratio'):g}&" in before


@pytest.mark.parametrize(
    ("typed", "message"),
    [
        ("abc", "Angle of the string from straight up: found 'abc', needed a number such as 113.08"),
        ("400", "Angle of the string from straight up: found 400 °, needed 5 to 180 °"),
    ],
)
def test_a_bad_number_is_refused_in_one_line(page, typed, message):
    type_into(page, "#field-release_angle", typed)
    assert page.inner_text("#fault") == message
    beside = "document.getElementById('fault').previousElementSibling"
    assert page.evaluate(f"{beside}.dataset.name") == "release_angle", "it stands beside the field"
    assert page.input_value("#field-release_angle") == "113.08"
    assert value(page, "release_angle") == 113.08


def test_a_refusal_outlives_the_frame_of_a_change_just_before_it(page):
    page.evaluate("""() => {
      for (const [name, typed] of [["mass_ratio", "12"], ["release_angle", "400"]]) {
        const field = document.getElementById(`field-${name}`);
        field.value = typed;
        field.dispatchEvent(new Event("change"));
      }
    }""")
    settled(page)
    assert value(page, "mass_ratio") == 12
    assert page.inner_text("#fault").startswith("Angle of the string from straight up: found 400 °")
    type_into(page, "#field-release_angle", "100")
    assert page.inner_text("#fault") == ""


def test_friction_at_rest_is_never_below_that_of_sliding(page):
    type_into(page, "#field-kinetic_friction", "0.5")
    assert value(page, "static_friction") == 0.5  # equal before, so it follows
    type_into(page, "#field-static_friction", "0.8")
    assert value(page, "kinetic_friction") == 0.5
    type_into(page, "#field-static_friction", "0.3")
    assert value(page, "kinetic_friction") == 0.3


def test_the_light_mass_is_dragged_to_its_release(page):
    page.evaluate("live.player.stopAt(0.2)")
    settled(page)
    x, y = light_mass(page)
    page.mouse.move(x, y)
    page.mouse.down()
    settled(page)
    assert page.evaluate("live.player.time") == 0
    wanted = [x + 30, y - 80]
    page.mouse.move(*wanted, steps=4)
    settled(page)
    scale = page.evaluate("live.stage.view.scale")
    reach = scale * (0.01 * PIXEL_IN_DRAG / 2 + 0.75 * math.radians(PIXEL_IN_DRAG / 2)) + 1
    assert math.dist(light_mass(page), wanted) <= reach
    page.mouse.up()
    settled(page)
    assert not page.evaluate("live.player.playing")  # the visit prefers reduced motion
    assert "Before: 0.3814 s" in page.inner_text("#compared")
    page.keyboard.press("Control+z")
    settled(page)
    assert value(page, "release_angle") == 113.08


@pytest.mark.long
def test_undo_and_redo_go_through_all_settings(page):
    states = [page.evaluate("location.hash")]
    for angle in (100, 90, 80):
        type_into(page, "#field-release_angle", str(angle))
        states.append(page.evaluate("location.hash"))
    assert len(set(states)) == 4
    for state in reversed(states[:-1]):
        page.click("#undo")
        settled(page)
        assert page.evaluate("location.hash") == state
    for state in states[1:]:
        settled(page)
        page.click("#redo")
        settled(page)
        assert page.evaluate("location.hash") == state
    settled(page)
    assert page.is_disabled("#redo")


def test_a_ghost_and_the_change_as_numbers(page):
    first = page.evaluate("live.run.halt")
    type_into(page, "#field-mass_ratio", "12")
    settled(page)
    now = page.evaluate("live.run.halt")
    words = page.inner_text("#compared")
    shown = float(re.search(r"Change: ([+−][\d.]+) s", words)[1].replace("−", "-"))
    assert shown == pytest.approx(now - first, abs=SHOWN)
    assert page.evaluate("live.ghost.halt") == pytest.approx(first, abs=1e-12)
    page.uncheck("#ghost")
    settled(page)
    assert page.evaluate("live.ghost") is None
    assert page.inner_text("#compared") == ""


@pytest.mark.long
def test_play_slow_motion_steps_and_the_time(page):
    page.click("[data-slow='1']")
    page.click("#play")
    played_to(page, 0.1)
    assert page.inner_text("#play") == "Pause"
    page.click("#play")
    assert not page.evaluate("live.player.playing")
    page.click("#start")
    page.click("#forward")
    page.click("#forward")
    page.click("#back")
    settled(page)
    assert page.inner_text("#clock") == "0.002 s"
    page.evaluate("document.activeElement.blur()")
    for key, time in (("End", page.evaluate("live.run.end")), ("Home", 0), ("Shift+ArrowRight", 0.02), ("ArrowLeft", 0.018)):
        page.keyboard.press(key)
        assert page.evaluate("live.player.time") == pytest.approx(time)
    page.keyboard.press("Space")
    assert page.evaluate("live.player.playing")
    page.keyboard.press("Space")
    page.locator("#events button").first.click()
    assert page.evaluate("live.player.time") == pytest.approx(page.evaluate("live.run.halt"))
    settled(page)
    assert page.inner_text("#doing") == "the rod holds the string"


def test_a_click_in_a_curve_sets_the_time_of_all(page):
    plot = page.locator("[data-plot=energy]")
    plot.scroll_into_view_if_needed()
    box = plot.bounding_box()
    plot.click(position={"x": 44 + 0.5 * (box["width"] - 2 - 54), "y": 80})  # 44 and 10: the plot's edges; 2: its border
    assert page.evaluate("live.player.time") == pytest.approx(page.evaluate("live.run.end") / 2, abs=0.01)


def test_forces_are_arrows_on_demand(page):
    page.evaluate("live.player.stopAt(0.3)")
    settled(page)
    pink = [STAGE, "#cc79a7"]
    page.evaluate("document.documentElement.dataset.theme === 'light' || document.getElementById('theme').click()")
    settled(page)
    assert page.evaluate(COUNT, pink) == 0
    page.check("#forces")
    settled(page)
    assert page.evaluate(COUNT, pink) > 100


KEEP_WORDS = """() => {
  const { fillText } = CanvasRenderingContext2D.prototype;
  window.words = new Map();
  CanvasRenderingContext2D.prototype.fillText = function (words, x, y) {
    if (this.canvas.id === "stage") window.words.set(words, [x, y, this.measureText(words).width, this.textAlign]);
    return fillText.call(this, words, x, y);
  };
}"""


def drawn_words(page):
    """Words on the stage, each with its left and right end and its height [px]."""
    page.evaluate("window.words.clear(); live.change()")
    settled(page)
    shares = {"left": 0.0, "center": 0.5, "right": 1.0}
    words = page.evaluate("[...window.words]")
    return {one: (x - shares[align] * width, x + (1 - shares[align]) * width, y) for one, (x, y, width, align) in words}


@pytest.mark.long
@pytest.mark.parametrize("language", ["en", "de"])
@pytest.mark.parametrize("size", [DESKTOP, PHONE], ids=["desktop", "phone"])
def test_bars_have_a_scale_and_numbers_as_people_write_them(visit, size, language):
    page = visit(page_text(), viewport=size, locale=language).page
    page.evaluate(KEEP_WORDS)
    page.check("#forces")
    page.evaluate("""() => {
      const changed = { kinetic_friction: 0.6, static_friction: 0.6, mass_ratio: 20 };
      live.set({ ...live.state, values: { ...live.state.values, ...changed } });
    }""")
    page.evaluate("live.player.stopAt(0.8 * live.run.end)")
    seen = drawn_words(page)
    bound = page.evaluate("Math.exp(live.run.at(live.player.time).holding.bound)")
    assert 1e4 < bound < 1e6
    shown = [one for one in seen if re.fullmatch(r"\d{2,3}\u202f000", one) and not one.startswith("10")]
    assert [float(one.replace("\u202f", "")) for one in shown] == [pytest.approx(bound, rel=0.05)]
    assert "1" in seen
    assert {"100", "1000", "10\u202f000"} & seen.keys(), "the bars' scale"
    assert not any(re.search(r"\de\+?\d", one) for one in seen)
    assert not any("T2" in one for one in seen)
    width = page.evaluate("document.getElementById('stage').clientWidth")
    for one, (left, right, _) in seen.items():
        assert left >= 0, one
        assert right <= width, one


@pytest.mark.long
def test_no_string_crosses_the_name_of_a_mass(page):
    page.evaluate(KEEP_WORDS)
    for step in range(21):
        page.evaluate("(share) => live.player.stopAt(share * live.run.end)", step / 20)
        left, right, y = drawn_words(page)["M1"]
        # The string leads from the rod to the light mass; corners of the name are not on it
        rod, mass = page.evaluate("""() => {
          const { wrapAngle, light } = live.run.at(live.player.time), { rod_radius: r } = live.run.settings;
          const { view } = live.stage;
          return [[r * Math.cos(wrapAngle), r * Math.sin(wrapAngle)], light].map(([x, y]) => [view.x(x), view.y(y)]);
        }""")
        along = np.subtract(mass, rod) / np.hypot(*np.subtract(mass, rod))
        corners = [np.subtract((x, y + side), mass) for x in (left, right) for side in (-6, 6)]
        assert all(corner @ along > 0 or abs(corner[0] * along[1] - corner[1] * along[0]) > 6 for corner in corners), step


def test_stage_and_forces_are_seen_together(visit):
    page = visit(page_text(), viewport={"width": 1280, "height": 800}).page
    page.check("#forces")
    settled(page)
    assert page.evaluate("window.scrollY") == 0
    for part in ("#stage", "#time", "#result", "#forces", ".left .key"):
        box = page.locator(part).bounding_box()
        assert box["y"] >= 0, part
        assert box["y"] + box["height"] <= 800, part


def test_the_stage_fills_the_screen_on_request(page):
    height = page.locator("#stage").bounding_box()["height"]
    page.click("#full")
    until(page, "document.fullscreenElement !== null")
    until(page, f"document.getElementById('stage').getBoundingClientRect().height > {height}")
    for part in ("#play", "#forces", "#result"):
        assert page.is_visible(part)
    page.click("#full")
    until(page, "document.fullscreenElement === null")


def test_release_is_one_thing(page):
    """The button that leads to the start of the motion, and the choice of how the masses are let go, have different names."""
    names = page.evaluate(
        "[...document.querySelectorAll('button, label, summary, h2')].map((one) => one.innerText.trim()).filter(Boolean)"
    )
    assert names.count("Release") == 1
    assert len(set(names)) == len(names)


@pytest.mark.long
def test_the_map_is_that_of_the_runs_and_a_click_sets_both(page):
    page.locator("#map").scroll_into_view_if_needed()
    until(page, "live.map.grids.length && live.map.grids[0].drops.every((row) => row)")
    drops = page.evaluate("live.map.grids[0].drops")
    row, column = 4, 5
    box = page.locator("#map").bounding_box()
    wide, tall = box["width"] - 2 - 56, box["height"] - 2 - 46  # its edges and its border
    place = {"x": 45 + (column + 0.5) / 10 * wide, "y": 13 + (1 - (row + 0.5) / 8) * tall}
    page.locator("#map").click(position=place)
    settled(page)
    ratio = [page.evaluate("liveControls.find(({name}) => name === 'mass_ratio').min"), 20]
    assert value(page, "mass_ratio") == pytest.approx(ratio[0] + (row + 0.5) / 8 * (ratio[1] - ratio[0]), abs=0.2)
    assert page.evaluate("live.run.dropAtHalt") == pytest.approx(drops[row][column], rel=0.03)  # a pixel is some 0.3 degrees


@pytest.mark.long
def test_on_a_phone_it_fits_and_a_finger_reaches_everything(visit):
    opened = visit(page_text(), viewport=PHONE, has_touch=True, is_mobile=True, color_scheme="dark")
    page = opened.page
    assert page.evaluate("document.documentElement.dataset.theme") == "dark"
    assert sideways(page) <= 0
    page.locator("summary").first.tap()
    small = page.evaluate("""() => [...document.querySelectorAll("button, select, input:not([type=checkbox]):not(#time)")]
      .filter((e) => e.offsetParent).map((e) => [e.id || e.textContent, e.getBoundingClientRect()])
      .filter(([, box]) => box.height < 43.5 || box.width < 43.5).map(([name]) => name)""")
    assert small == []
    page.locator("#play").tap()
    played_to(page, 0.01)
    page.locator("#play").tap()
    assert not page.evaluate("live.player.playing")
    page.evaluate("window.scrollTo(0, 0)")
    page.locator("#start").tap()
    settled(page)
    x, y = light_mass(page)
    finger = page.context.new_cdp_session(page)
    for kind, points in (
        ("touchStart", [{"x": x, "y": y}]),
        ("touchMove", [{"x": x + 10, "y": y - 20}]),
        ("touchMove", [{"x": x + 20, "y": y - 40}]),
        ("touchEnd", []),
    ):
        finger.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})
    settled(page)
    assert value(page, "release_angle") < 110
    assert page.evaluate("window.scrollY") == 0  # the finger moved the mass, not the page
    page.evaluate("document.getElementById('range-mass_ratio').scrollIntoView({ block: 'end' })")
    box = page.locator("#range-mass_ratio").bounding_box()
    page.touchscreen.tap(box["x"] + 0.25 * box["width"], box["y"] + box["height"] / 2)
    assert value(page, "mass_ratio") == pytest.approx(1 + 0.25 * 19, abs=0.6)
    assert opened.complaints == []


@pytest.mark.long
def test_thirty_random_actions(visit):
    act_at_random(visit, page_text(), 30)


@pytest.mark.accurate
def test_two_thousand_random_actions(visit):
    act_at_random(visit, page_text(), 2000)


@pytest.mark.long
def test_every_number_of_the_live_model_has_a_control_or_follows_from_one(opened):
    settings = opened.page.evaluate("live.run.settings")
    assert settings.keys() == live_settings(load("ten_to_one").parameters).keys()


@pytest.mark.long
@pytest.mark.parametrize("width", [60, 240])
def test_without_room_it_complains_of_nothing(opened, width):
    page = opened.page
    page.set_viewport_size({"width": width, "height": 120})
    settled(page)
    page.evaluate("live.player.stopAt(0.1)")
    settled(page)
    page.set_viewport_size(DESKTOP)
    settled(page)
    assert opened.complaints == []
    assert page.evaluate("live.stage.view.scale") > 0
