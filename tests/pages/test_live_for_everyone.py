"""The live page for everyone: axe-core, keyboard alone, screen readers, enlarged, narrow, by touch, without motion.

What the map says is held to the reference's solution.
"""

import math
import re

import pytest

from looping_pendulum.reference_ode.solve import solve
from looping_pendulum.scenarios import load
from looping_pendulum.teaching.example_folder import write_example
from tests.pages.axe import violations
from tests.pages.conftest import DESKTOP, PHONE, sideways, until
from tests.pages.live_page import page_text, preset, settled, type_into, value

SHOWN = 0.05
"""Half of the last digit of a drop on the page [cm]."""
NARROW = {"width": 320, "height": 640}
DOUBLED = {"viewport": {"width": 640, "height": 450}, "device_scale_factor": 2}
"""1280 x 900 at 200 %."""
QUADRUPLED = {"viewport": {"width": 320, "height": 256}, "device_scale_factor": 4}
"""1280 x 1024 at 400 %, as WCAG 2.2 asks of reflow."""
MIN_TARGET = 24
"""WCAG 2.2, AA [px]."""

TOUCH = {"has_touch": True, "is_mobile": True}

FOCUSABLE = """() => {
  const all = [...document.querySelectorAll("a[href], button, input, textarea, select, summary, [tabindex='0']")];
  return all.filter((e) => !e.disabled && e.checkVisibility()).map((e) => e.id || e.className || e.textContent.trim());
}"""

FOCUSED = """() => {
  const e = document.activeElement, box = e.getBoundingClientRect(), style = getComputedStyle(e);
  const inside = (low, high, most) => (Math.max(low, 0) + Math.min(high, most)) / 2;
  const place = [inside(box.left, box.right, innerWidth), inside(box.top, box.bottom, innerHeight)];
  const top = document.elementFromPoint(...place);
  return {
    name: e.id || e.className || e.textContent.trim(),
    seen: top !== null && (e.contains(top) || [...(e.labels ?? [])].some((label) => label.contains(top))),
    ring: e.matches(":focus-visible") && style.outlineStyle !== "none" ? parseFloat(style.outlineWidth) : 0,
  };
}"""

SMALL = """(least) => {
  const all = document.querySelectorAll("button, input, textarea, select, summary, canvas[tabindex]");
  const shown = [...all].filter((e) => e.checkVisibility());
  const boxes = shown.map((e) => [e.id || e.textContent, (e.type === "checkbox" ? e.labels[0] : e).getBoundingClientRect()]);
  const cut = ({ left, right }) => left < -1 || right > innerWidth + 1;
  return boxes.filter(([, box]) => box.width < least || box.height < least || cut(box)).map(([name]) => name);
}"""


def show_everything(page, tmp_path):
    """Open all sections, with forces, a ghost, a trial, a map, a fault and the fields of a trial."""
    first = next(path for path in write_example(tmp_path / "example") if path.name == "first.csv")
    page.evaluate("document.querySelectorAll('details').forEach((d) => { d.open = true; })")
    page.check("#forces")
    page.set_input_files("#trial-file", first)
    until(page, "live.trial.trial !== null")
    type_into(page, "#field-mass_ratio", "12")
    type_into(page, "#field-release_angle", "400")
    assert page.inner_text("#fault")
    page.locator("#map").scroll_into_view_if_needed()
    until(page, "live.map.grids.length > 0")
    settled(page)


@pytest.mark.parametrize(
    ("kind", "scheme"),
    [
        ("desktop", "light"),
        ("phone", "dark"),
        pytest.param("desktop", "dark", marks=pytest.mark.accurate),
        pytest.param("phone", "light", marks=pytest.mark.accurate),
    ],
)
def test_axe_finds_nothing(visit, tmp_path, kind, scheme):
    options = {"viewport": DESKTOP} if kind == "desktop" else {"viewport": PHONE, **TOUCH}
    opened = visit(page_text(), color_scheme=scheme, **options)
    assert opened.page.evaluate("document.documentElement.dataset.theme") == scheme
    assert violations(opened.page) == []
    show_everything(opened.page, tmp_path)
    assert violations(opened.page) == []
    assert opened.complaints == []


CUT_OFF = """() => {
  const c = document.createElement("canvas").getContext("2d"), room = 28;  // of a select's arrow and edges
  const width = (e, words) => { c.font = getComputedStyle(e).font; return c.measureText(words).width; };
  return [...document.querySelectorAll("body *")].filter((e) => {
    if (!e.checkVisibility() || e.closest(".table, .visually-hidden, .skip")) return false;
    const { left, right } = e.getBoundingClientRect();
    if (left < -1 || right > innerWidth + 1) return true;
    if (e.matches("select")) return [...e.options].some(({ text }) => width(e, text) > e.clientWidth - room);
    if (e.matches("input[type=text]")) return width(e, e.value || e.placeholder) > e.clientWidth;
    return e.clientWidth > 0 && e.scrollWidth > e.clientWidth + 1 && getComputedStyle(e).overflowX !== "visible";
  }).map((e) => e.id || e.className || e.tagName);
}"""
"""Elements of which a part is beyond an edge: the screen's, their own, or a field's."""


@pytest.mark.long
@pytest.mark.parametrize("language", ["en", "de"])
@pytest.mark.parametrize("size", [DESKTOP, PHONE], ids=["desktop", "phone"])
def test_nothing_is_cut_off(visit, tmp_path, size, language):
    page = visit(page_text(), viewport=size, locale=language).page
    show_everything(page, tmp_path)
    assert page.evaluate(CUT_OFF) == []


@pytest.mark.long
@pytest.mark.parametrize("name", ["ten_to_one", "two_to_one", "held"])
def test_the_masses_names_are_whole_on_a_phone(visit, name):
    page = visit(page_text(), viewport=PHONE).page
    preset(page, name)
    cut = page.evaluate("""async () => {
      const { fillText } = CanvasRenderingContext2D.prototype, cut = [];
      CanvasRenderingContext2D.prototype.fillText = function (words, x, y) {
        const half = this.measureText(words).width / 2, middle = this.textAlign === "center" ? x : x + half;
        if (/^M[12]$/.test(words) && (middle - half < 0 || middle + half > this.canvas.clientWidth)) cut.push([words, x, y]);
        fillText.call(this, words, x, y);
      };
      for (let share = 0; share <= 1; share += 0.02) {
        live.player.stopAt(share * live.run.end);
        await new Promise(requestAnimationFrame);
      }
      return cut;
    }""")
    assert cut == []


def test_axe_finds_what_is_broken(visit):
    page = visit(page_text()).page
    page.evaluate("""() => {
      document.getElementById("undo").textContent = "";
      document.getElementById("undo").removeAttribute("title");
      document.getElementById("result").style.color = "#ddd";
      document.querySelector("label[for=preset]").remove();
    }""")
    assert {found.partition(":")[0] for found in violations(page)} == {"button-name", "color-contrast", "select-name"}


# Ten seconds each; the least room runs daily
@pytest.mark.parametrize(
    "options",
    [
        pytest.param({"viewport": DESKTOP}, id="desktop", marks=pytest.mark.accurate),
        pytest.param({"viewport": PHONE}, id="phone", marks=pytest.mark.accurate),
        pytest.param({"viewport": NARROW}, id="320 px wide", marks=pytest.mark.accurate),
        pytest.param(DOUBLED, id="200 %", marks=pytest.mark.accurate),
        pytest.param(QUADRUPLED, id="400 %"),
    ],
)
def test_the_keyboard_leads_to_every_control_and_shows_where_it_is(visit, tmp_path, options):
    page = visit(page_text(), **options).page
    show_everything(page, tmp_path)
    assert sideways(page) <= 0
    assert page.evaluate(SMALL, MIN_TARGET) == []
    names = page.evaluate(FOCUSABLE)
    page.focus(".skip")
    steps = [page.evaluate(FOCUSED)]
    for key in ("Tab", "Shift+Tab"):  # back, too: then the stage, which stays in sight, covers other places
        for _ in names[1:]:
            page.keyboard.press(key)
            steps.append(page.evaluate(FOCUSED))
    assert [step["name"] for step in steps] == [*names, *names[-2::-1]]
    assert [step["name"] for step in steps if not step["seen"]] == []
    assert [step["name"] for step in steps if step["ring"] < 2] == []


def drop_of_reference(scenario, **changes):
    """How far the heavy mass has fallen when it halts [cm]; None if it never does."""
    run = solve(load(scenario).parameters.replace(**changes), duration=5.0)
    if run.halt is None:
        return None
    heights = run.sample([0.0, run.halting_time]).heavy_position[:, 1]
    return 100 * float(heights[0] - heights[1])


@pytest.mark.long
def test_the_map_is_read_and_set_by_keys(page):
    page.focus("#map")
    time = page.evaluate("live.player.time")

    def reading(*keys):
        for key in keys:
            page.keyboard.press(key)
        return page.inner_text("#map-reading")

    words = reading("ArrowRight")
    drop = drop_of_reference("ten_to_one", release_angle=math.radians(114))
    said = re.fullmatch(r"114 degrees, 10 to 1: halts after falling ([\d.]+) cm\.", words)
    assert float(said[1]) == pytest.approx(drop, abs=SHOWN + 1e-3)
    mass = load("ten_to_one").parameters.light_mass
    words = reading("Shift+ArrowDown", "Shift+ArrowDown", "ArrowUp", "Shift+ArrowLeft", "Shift+ArrowLeft")
    drop = drop_of_reference("ten_to_one", release_angle=math.radians(94), heavy_mass=8.1 * mass)
    said = re.fullmatch(r"94 degrees, 8.1 to 1: halts after falling ([\d.]+) cm\.", words)
    assert float(said[1]) == pytest.approx(drop, abs=SHOWN + 1e-3)
    assert (value(page, "release_angle"), value(page, "mass_ratio")) == (113.08, 10)
    assert page.evaluate("live.player.time") == time, "the arrows are the map's while it has the focus"
    assert reading("Enter") == ""
    assert (value(page, "release_angle"), value(page, "mass_ratio")) == (94, 8.1)
    assert reading(*["Shift+ArrowRight"] * 9) == "180 degrees, 8.1 to 1: no halt for good."
    assert drop_of_reference("ten_to_one", release_angle=math.pi, heavy_mass=8.1 * mass) is None
    assert reading("Escape") == ""
    assert reading("ArrowLeft").startswith("93 degrees")
    page.keyboard.press("Tab")
    assert page.inner_text("#map-reading") == ""
    assert (value(page, "release_angle"), value(page, "mass_ratio")) == (94, 8.1)
    assert page.get_attribute("#map-reading", "role") == "status"


@pytest.mark.long
def test_events_are_announced_once_as_the_motion_passes_them(page):
    preset(page, "two_to_one")
    page.evaluate("""() => {
      window.added = 0;
      const count = (changes) => changes.forEach(({ addedNodes }) => { added += addedNodes.length; });
      new MutationObserver(count).observe(document.getElementById("event-log"), { childList: true });
      live.player.setSlow(1);
    }""")
    events = page.locator("#events button").all_inner_texts()
    assert len(events) > 3
    assert page.get_attribute("#event-log", "role") == "log"
    announced = page.locator("#event-log p")

    def play_from(time):
        page.evaluate("(time) => { live.player.stopAt(time); live.player.play(); }", time)
        until(page, "!live.player.playing")
        settled(page)

    end = page.evaluate("live.run.end")
    play_from(0.5 * end)
    late = [words for words in events if float(words.split()[0]) > 0.5 * end]
    assert 0 < len(late) < len(events)
    assert announced.all_inner_texts() == late
    play_from(0)
    assert announced.all_inner_texts() == events
    added = page.evaluate("added")
    assert added == len(late) + len(events)
    for share in (0.9, 0.1, 0.7, 0.2, 1.0, 0.0, 0.5):
        page.evaluate(
            """(time) => {
          const slider = document.getElementById("time");
          slider.value = time;
          slider.dispatchEvent(new Event("input"));
        }""",
            share * end,
        )
        settled(page)
    play_from(0.3 * end)
    assert page.evaluate("added") == added, "neither scrubbing nor a part that plays again repeats them"
    play_from(0)
    assert page.evaluate("added") == added + len(events), "from the release it is announced anew"
    assert announced.all_inner_texts() == events


def test_the_slider_of_the_time_says_what_happens_then(page):
    page.focus("#time")
    page.keyboard.press("End")
    settled(page)
    assert re.fullmatch(r"1\.\d{3} seconds: the rod holds the string", page.get_attribute("#time", "aria-valuetext"))
    page.keyboard.press("Home")
    page.keyboard.press("Shift+ArrowRight")
    settled(page)
    assert page.get_attribute("#time", "aria-valuetext") == "0.020 seconds: the string slides; the heavy mass falls"


def test_the_table_of_the_run_names_its_events(page):
    preset(page, "two_to_one")
    page.evaluate("document.getElementById('table-of-run').open = true")
    settled(page)
    events = page.locator("#events button").all_inner_texts()
    assert (
        page.inner_text("#table caption")
        == f"The run from the release to its end; the last column names the events: {len(events)}"
    )
    rows = page.evaluate("""() => [...document.querySelectorAll("#table tbody tr")].map((row) => ({
      event: row.classList.contains("event"), cells: [...row.cells].map((cell) => cell.textContent), head: row.cells[0].scope,
    }))""")
    assert [f"{row['cells'][0]} s: {row['cells'][-1]}" for row in rows if row["event"]] == events
    assert all(row["cells"][-1] == "" for row in rows if not row["event"])
    assert {row["head"] for row in rows} == {"row"}
    assert {len(row["cells"]) for row in rows} == {page.locator("#table thead th[scope=col]").count()}
    times = [float(row["cells"][0]) for row in rows]
    assert times == sorted(times)
    page.focus(".table")
    before = page.evaluate("live.player.time")
    page.keyboard.press("ArrowRight")
    assert page.evaluate("live.player.time") == before, "in the table the arrows scroll"


@pytest.mark.long
def test_every_button_switch_and_choice_works_by_keys(opened, tmp_path):
    page = opened.page

    def press(target, *keys):
        page.focus(target)
        for key in keys:
            page.keyboard.press(key)
        settled(page)

    theme = page.evaluate("document.documentElement.dataset.theme")
    press("#theme", "Enter")
    assert page.evaluate("document.documentElement.dataset.theme") != theme
    press("#theme", "Space")
    press("#forces", "Space")
    assert page.is_checked("#forces")
    press("#preset", "ArrowDown")
    first = page.input_value("#preset")
    assert first not in ("", "ten_to_one")
    press("#release", "ArrowDown")
    assert page.evaluate("live.state.release") == page.input_value("#release")
    press("#undo", "Enter")
    assert page.input_value("#preset") == first
    press("#redo", "Space")
    assert page.input_value("#preset") != first
    preset(page, "ten_to_one")
    press("[data-slow='10']", "Enter")
    assert page.evaluate("live.player.slow") == 10
    press("#forward", "Enter", "Enter")
    assert page.evaluate("live.player.time") == pytest.approx(0.004)
    press("#back", "Space")
    assert page.evaluate("live.player.time") == pytest.approx(0.002)
    press("#play", "Enter")
    assert page.evaluate("live.player.playing")
    press("#play", "Space")
    assert not page.evaluate("live.player.playing")
    press("#events li:last-child button", "Enter")
    assert page.evaluate("live.player.time") == page.evaluate("live.run.end")
    press("#start", "Enter")
    assert page.evaluate("live.player.time") == 0
    page.evaluate("document.getElementById('table-of-run').open = false")
    press("#table-of-run summary", "Enter")
    assert page.evaluate("document.getElementById('table-of-run').open")
    press("#copy", "Enter")
    until(page, "document.getElementById('copied').textContent !== ''")
    for button in ("#save-picture", "#save-numbers", "#save-scenario"):
        with page.expect_download():
            press(button, "Enter")
    show_everything(page, tmp_path)
    press("#trial-mirror", "Space")
    assert page.evaluate("live.trial.options.mirrored")
    press("#trial-length", "ArrowDown")
    assert page.evaluate("live.trial.options.length") == "cm"
    press("#trial-remove", "Enter")
    assert page.evaluate("live.trial.trial") is None
    assert opened.complaints == []


@pytest.mark.long
def test_every_kind_of_control_works_by_touch(visit):
    opened = visit(page_text(), viewport=PHONE, **TOUCH)
    page = opened.page

    def tap(target, position=None):
        page.locator(target).first.tap(position=position)
        settled(page)

    theme = page.evaluate("document.documentElement.dataset.theme")
    tap("#theme")
    assert page.evaluate("document.documentElement.dataset.theme") != theme
    for speed in (1, 10, 50, 4):
        tap(f"[data-slow='{speed}']")
        assert page.evaluate("live.player.slow") == speed
    tap("#forward")
    assert page.evaluate("live.player.time") == pytest.approx(0.002)
    tap("#back")
    assert page.evaluate("live.player.time") == 0
    tap("label:has(#forces)")
    assert page.is_checked("#forces")
    tap("#range-mass_ratio")
    ratio = value(page, "mass_ratio")
    assert ratio == pytest.approx(10.5, abs=0.6)
    tap("#undo")
    assert value(page, "mass_ratio") == 10
    tap("#redo")
    assert value(page, "mass_ratio") == ratio
    tap("summary:has-text('More settings')")
    assert page.is_visible("#range-gravity")
    for plot in ("drop", "turns", "pull", "energy"):
        tap("#start")
        tap(f"[data-plot={plot}]", {"x": 200, "y": 90})
        assert page.evaluate("live.player.time") > 0.1
    tap("#events button")
    assert page.evaluate("live.player.time") == pytest.approx(page.evaluate("live.run.events[0].time"))
    tap("#map", {"x": 150, "y": 100})
    assert value(page, "mass_ratio") != ratio
    tap("#table-of-run summary")
    assert page.locator("#table tbody tr").count() > 20
    tap("#copy")
    until(page, "document.getElementById('copied').textContent !== ''")
    assert opened.complaints == []


RESTS = """async () => {
  const before = live.frames;
  for (let i = 0; i < 12; i++) await new Promise(requestAnimationFrame);
  return live.frames === before;
}"""
"""Whether the page draws nothing in twelve frames of the browser."""


def test_nothing_moves_by_itself(visit):
    page = visit(page_text(), reduced_motion="reduce").page
    until(page, "live.frames > 0")
    # However late the page comes to rest: what moves by itself never does
    until(page, RESTS)
    assert page.evaluate("document.getAnimations().length") == 0
    assert page.evaluate("live.player.time") == 0
