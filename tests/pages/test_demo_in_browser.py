"""Stored runs on the live page in a real browser: what moves, what is marked where, what can be switched."""

import numpy as np
import pytest

from looping_pendulum.runs.trajectory import RunStatus
from looping_pendulum.teaching import demo
from tests.pages.axe import violations
from tests.pages.conftest import PHONE, sideways, until
from tests.pages.live_page import COUNT, STAGE, at, light_mass, page_text, played_to, preset, settled, type_into
from tests.pages.small import HOSTILE, LABELS, hostile_result, small_result, with_points

ROUNDING = 1e-5
"""The page's numbers have 1e-5 rad and 1e-6 m, which at 0.58 m of string is 6 micrometres [m]."""
DRAWN = 1 / 500
"""Time between drawn places [s]."""

CURSORS = """() => live.plots.filter(({ box }) => !box.hidden).map(({ canvas }) => {
  const context = canvas.getContext("2d"), ratio = canvas.width / canvas.clientWidth, row = canvas.height - 30 * ratio;
  const { data } = context.getImageData(0, row, canvas.width, 1);
  const columns = Array.from({ length: canvas.width }, (_, i) => i);
  const most = Math.max(...columns.map((i) => data[4 * i + 3])), drawn = columns.filter((i) => data[4 * i + 3] === most);
  return (drawn[0] + drawn[drawn.length - 1]) / 2 / ratio;
})"""
"""Where the cursor stands in each plot [px], read in a row in which only it is drawn."""

CIRCLES = """([selector, radii]) => {
  const original = CanvasRenderingContext2D.prototype.arc;
  let count = 0;
  CanvasRenderingContext2D.prototype.arc = function (...circle) {
    if (this.canvas.matches(selector) && radii.includes(circle[2])) count += 1;
    original.apply(this, circle);
  };
  live.change();
  return new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => {
    CanvasRenderingContext2D.prototype.arc = original;
    done(count);
  })));
}"""
"""Circles of given radii [px] that one frame draws."""

POINTS = [STAGE, [2.4, 6.5]]
"""Tracked points on the stage; the second radius is that of the latest one [px]."""


@pytest.fixture(scope="module")
def one_page(visit_once):
    return visit_once(demo.demo_page(small_result()))


@pytest.fixture
def opened(one_page):
    """The page, as it is when just loaded."""
    page = one_page.page
    preset(page, "two_to_one")
    page.evaluate("() => { live.player.stopAt(0); live.player.setSlow(4); window.scrollTo(0, 0); }")
    page.uncheck("#forces")
    for box in page.locator("#engine-runs input:enabled").all():
        box.check()
    page.evaluate("document.activeElement.blur()")
    settled(page)
    one_page.complaints.clear()
    return one_page


def test_it_loads_without_complaint_or_request(opened):
    until(opened.page, "live.frames > 0")
    opened.page.click("#theme")
    opened.page.click("#end")
    opened.page.click("#theme")
    assert [url for url in opened.requests if not url.startswith("blob:")] == [opened.page.url.partition("#")[0]]
    assert opened.complaints == opened.dialogs == []


def test_masses_are_where_the_runs_have_them(opened):
    samples = small_result().samples
    tracks = [
        ("reference", samples.reference),
        *((f"run{i}", a.run) for i, a in enumerate(samples.aligned, start=1) if len(a.t) > 1),
    ]
    assert len(tracks) == 4
    for name, run in tracks:
        for i in range(0, len(run.t), 200):
            place = opened.page.evaluate("([id, t]) => live.engines.place(id, t)", [name, float(run.t[i])])
            assert np.hypot(place["x"] - run.light_position[i, 0], place["y"] - run.light_position[i, 1]) < ROUNDING
            assert place["drop"] == pytest.approx(run.heavy_drop[i], abs=ROUNDING)


def test_the_page_itself_moves_as_the_stored_reference(opened):
    reference = small_result().samples.reference
    for i in range(0, len(reference.t), 100):
        sample = opened.page.evaluate("(t) => live.run.at(t)", float(reference.t[i]))
        assert np.hypot(*(np.array(sample["light"]) - reference.light_position[i])) < 1e-7


@pytest.mark.long
def test_play_moves_the_masses_and_stops_at_the_end(page):
    page.click("[data-slow='1']")
    before, picture = light_mass(page), page.evaluate(COUNT, [STAGE, "#000000"])
    page.click("#play")
    played_to(page, 0.2)
    assert light_mass(page)[0] - before[0] > 10
    assert page.evaluate(COUNT, [STAGE, "#000000"]) != picture
    page.click("[data-slow='1']")
    until(page, "!live.player.playing")
    assert page.evaluate("live.player.time") == small_result().duration
    page.click("[data-slow='50']")  # so that it is still near its beginning when it is looked at
    page.click("#play")  # from the end it begins anew
    assert page.evaluate("live.player.playing && live.player.time < 0.5")


@pytest.mark.long
def test_slow_motion_is_slower(page):
    page.click("[data-slow='50']")
    page.click("#play")
    frames = page.evaluate("""async () => {
      const frames = [];
      while (frames.length < 12) {
        const now = await new Promise(requestAnimationFrame);
        frames.push([now / 1000, live.player.time]);
      }
      return frames;
    }""")
    (start, before), (end, after) = frames[0], frames[-1]
    assert 0 < after - before <= (end - start + 0.1) / 50  # 0.1 s: a frame that was under way; a late frame only slows it


def test_the_slider_sets_the_time_and_all_that_follows_it(page):
    page.evaluate("""() => {
      const slider = document.getElementById("time");
      slider.value = 0.5;
      slider.dispatchEvent(new Event("input"));
    }""")
    settled(page)
    assert page.evaluate("live.player.time") == 0.5
    assert page.inner_text("#clock") == "0.500 s"
    reference = small_result().samples.reference
    assert page.inner_text("#now tbody tr:first-child td:nth-child(2)") == f"{1e3 * reference.heavy_drop[500]:.1f}"
    assert page.inner_text("#doing") == "the rod holds the string; last moment: stick at 0.4790 s"
    cursors = page.evaluate(CURSORS)
    assert len(cursors) == 6
    assert max(cursors) - min(cursors) <= 1
    width = page.evaluate("live.plots[0].canvas.clientWidth")
    assert cursors[0] == pytest.approx(44 + 0.5 / small_result().duration * (width - 54), abs=1.5)


@pytest.mark.long
def test_keys_go_from_moment_to_moment_of_the_shown_runs(page):
    for box in page.locator("#engine-runs input:enabled").all()[1:]:
        box.uncheck()
    times = [event["t"] for event in page.evaluate("live.engines.data.runs[0].events")]
    assert len(times) == 4
    at(page, 0.0)
    for expected in (*times, times[-1]):
        page.keyboard.press("n")
        assert page.evaluate("live.player.time") == expected
    page.keyboard.press("p")
    assert page.evaluate("live.player.time") == times[-2]
    page.locator("#engine-runs input[data-run=run1]").check()
    page.keyboard.press("Home")
    page.keyboard.press("N")
    assert page.evaluate("live.player.time") == min(times[0], page.evaluate("live.engines.data.runs[1].events[0].t"))


@pytest.mark.parametrize(
    "what", ["[data-slow='10']", "#forward", "#forces", "#engine-runs input[data-run=run1]", "#engine-runs .name >> nth=1"]
)
def test_space_plays_whatever_was_clicked_last(page, what):
    page.click(what)
    settled(page)
    page.evaluate("live.player.setSlow(1e6)")  # so that it hardly moves while it is looked at
    before = page.evaluate("[live.player.time, live.engines.shown.size]")
    page.keyboard.press("Space")
    assert page.evaluate("live.player.playing")
    page.keyboard.press("Space")
    assert not page.evaluate("live.player.playing")
    assert page.evaluate("live.player.time") - before[0] < 0.001, "less than a step forward"
    assert page.evaluate("live.engines.shown.size") == before[1]


@pytest.mark.long
def test_tracked_points_come_in_step_and_can_be_switched_off(visit):
    result = with_points(small_result())
    opened = visit(demo.demo_page(result))
    page = opened.page
    assert page.inner_text("#engine-runs .run[data-run=measured] .name") == "measured: mine"
    assert "light mass 20 mm" in page.text_content("#engine-runs .run[data-run=reference] details")
    times = np.array(result.trial.tracks[0].track.t)
    for time in (0.0, 0.25, 0.6):
        at(page, time)
        assert page.evaluate(CIRCLES, POINTS) == 2 * np.sum(times <= time), "both masses, up to the time"
    plots = {"drop": len(times), "distance": len(times), "turns": 0}  # drop, and distance from the reference
    for plot, count in plots.items():
        assert page.evaluate(CIRCLES, [f"[data-plot={plot}] canvas", [1.8]]) == count
    page.locator("#engine-runs input[data-run=measured]").uncheck()
    settled(page)
    assert page.evaluate(CIRCLES, POINTS) == 0
    assert page.evaluate(CIRCLES, ["[data-plot=drop] canvas", [1.8]]) == 0
    opened.assert_no_requests_or_complaints(page.url)


def test_a_switched_off_engine_disappears(page):
    at(page, 0.5)
    page.evaluate("document.documentElement.dataset.theme === 'light' || document.getElementById('theme').click()")
    settled(page)
    colour = page.evaluate("Theme.colour(live.engines.data.runs[2].colour)").lower()
    canvases = [STAGE, *(f"[data-plot={plot}] canvas" for plot in ("drop", "turns", "pull-light", "pull-heavy", "distance"))]
    for canvas in canvases:
        assert page.evaluate(COUNT, [canvas, colour]) > 20, canvas
    page.locator("#engine-runs input[data-run=run2]").uncheck()
    settled(page)
    for canvas in canvases:
        assert page.evaluate(COUNT, [canvas, colour]) == 0, canvas
    page.locator("#engine-runs input[data-run=run2]").check()
    settled(page)
    assert page.evaluate(COUNT, [STAGE, colour]) > 20


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
        assert page.evaluate("live.player.time") == halt
    kinds = page.eval_on_selector_all(
        "#timeline g[data-run=reference] g.mark", "(marks) => marks.map((m) => [m.dataset.kind, Number(m.dataset.time)])"
    )
    events = dict(result.reference.events)
    expected = [["stop", result.reference.landmarks.stops[0].time], ["stick", result.reference.landmarks.stops[1].time]]
    assert kinds == [*expected, ["slip", events["slip_onset"]], ["halt", events["halt"]]]


def test_gaps_say_why(page):
    rows = page.locator("#engine-runs .run").all()
    assert [row.locator(".name").inner_text() for row in rows] == ["reference", *LABELS]
    assert rows[4].locator("input").is_disabled()
    assert RunStatus.MISSING.value in rows[4].inner_text()
    assert RunStatus.STRING_DRIFT.value in rows[3].inner_text()
    assert page.locator("#timeline g[data-run=run3] g[data-kind=broke]").count() == 1
    assert "not run" in page.locator("#timeline g[data-run=run4]").text_content()
    assert "No friction on the rod" in rows[1].inner_text()
    assert "fed in by our adapter" in rows[2].inner_text()


@pytest.mark.long
@pytest.mark.parametrize(("reduced_motion", "plays"), [("reduce", False), ("no-preference", True)])
def test_it_plays_by_itself_only_where_motion_is_welcome(visit, reduced_motion, plays):
    page = visit(demo.demo_page(small_result()), reduced_motion=reduced_motion).page
    until(page, "live.player.time > 0" if plays else "live.frames > 0")
    settled(page)
    assert (page.evaluate("live.player.time") > 0) is plays


def test_without_stored_runs_it_waits_to_be_played(visit):
    page = visit(page_text(), reduced_motion="no-preference").page
    until(page, "live.frames > 0")
    assert not page.evaluate("live.player.playing")
    assert not any(
        page.locator(box).is_visible() for box in ("#engine-runs", "#engine-notices", "#timeline", "#engine-details")
    )


@pytest.mark.long
@pytest.mark.parametrize("color_scheme", ["light", "dark"])
def test_a_phone_shows_it_without_scrolling_sideways(visit, color_scheme):
    page = visit(demo.demo_page(small_result()), viewport=PHONE, color_scheme=color_scheme).page
    assert sideways(page) == 0
    stage = page.locator("#stage").bounding_box()
    assert stage["width"] > 300
    heights = page.eval_on_selector_all(
        "button, .run label", "(all) => all.map((one) => one.getBoundingClientRect().height).filter(Boolean)"
    )
    assert min(heights) >= 43.5  # as everywhere on the live page [px]


@pytest.mark.long
def test_axe_finds_nothing(opened):
    assert violations(opened.page) == []


@pytest.mark.long
def test_hostile_names_show_as_text(visit):
    opened = visit(demo.demo_page(hostile_result()))
    page = opened.page
    at(page, 0.5)
    assert HOSTILE in page.locator("#preset option").all_inner_texts()
    assert page.inner_text("#story") == HOSTILE
    assert HOSTILE in page.locator("#engine-runs .name").nth(1).inner_text()
    assert HOSTILE in page.locator("#now th").nth(7).text_content()
    type_into(page, "#field-mass_ratio", "3")
    settled(page)
    assert HOSTILE in page.inner_text("#engine-notice")
    assert HOSTILE in page.inner_text("#engine-back")
    assert page.locator("img").count() == 0
    opened.assert_no_requests_or_complaints(page.url.partition("#")[0])
