"""What is printed in place of the page: a worksheet on the setting that is shown, and a sheet with its answers."""

import re

import numpy as np
import pytest

from looping_pendulum.reference_ode.solve import solve
from looping_pendulum.reference_ode.transitions import Event, Mode
from looping_pendulum.scenarios import loader
from tests.pages.live_page import COUNT, at, preset, settled, type_into, value
from tests.pages.test_languages_in_browser import assert_german, german, german_words  # noqa: F401

PRINTED = "window.dispatchEvent(new Event('beforeprint'))"
ORANGE = "#d55e00"
"""Of the light mass and its path."""
RELEASES = ("ten_to_one", "atwood", "held", "drop")
"""One scenario for each release."""
SLIDES = (Event.SLIP_ONSET_DOWN, Event.SLIP_ONSET_UP)
NAMES = {"Friction, string sliding": "kinetic_friction", "Friction, string at rest": "static_friction"}
OPACITY_ON_ARC = """() => {
  const canvas = document.getElementById("stage"), { view } = live.stage, { wrapAngle } = live.run.at(0);
  const { rod_radius: r, release_angle: angle } = live.run.settings, ratio = canvas.width / canvas.clientWidth;
  const x = view.x(r * Math.cos(wrapAngle)) - 30 * Math.sin(angle / 4);
  const y = view.y(r * Math.sin(wrapAngle)) - 30 * Math.cos(angle / 4);
  const { data } = canvas.getContext("2d").getImageData(ratio * x - 2, ratio * y - 2, 4, 4);
  return Math.max(...data.filter((_, i) => i % 4 === 3));
}"""
"""Opacity of what is drawn a quarter of the angle from straight up."""


@pytest.fixture
def printed(opened):
    """Fill the sheets, and have the page as on paper; afterwards as on the screen."""
    page = opened.page

    def fill():
        page.evaluate(PRINTED)
        page.emulate_media(media="print")
        return page.locator("#handout article")

    yield fill
    page.evaluate("window.dispatchEvent(new Event('afterprint'))")
    page.emulate_media(media="screen")
    assert page.locator("#handout article").count() == 0
    assert opened.complaints == []


def changes(question):
    """What the last question changes: label, value and the one before, of each setting."""
    return re.findall(r"(?:is changed: |; )(.+?) ([\d.]+)(?: \S+)? in place of ([\d.]+\d|\d)", question)


def answers(sheets):
    return sheets.nth(1).locator("ol strong").all_inner_texts()


@pytest.mark.long
@pytest.mark.parametrize("language", ["en", "de"])
@pytest.mark.parametrize("name", RELEASES)
def test_two_pages_of_paper_hold_all(opened, name, language):
    page = opened.page
    page.select_option("#language", language)
    preset(page, name)
    page.check("#forces")
    # As many settings as there can be
    page.evaluate("""() => {
      const steps = new Map(liveControls.map(({ name, step }) => [name, step])), { release, values } = live.state;
      const all = Object.entries(values).map(([name, one]) => [name, one || steps.get(name)]);
      live.set({ release, values: Object.fromEntries(all) });
    }""")
    settled(page)
    paper = page.pdf(format="A4").decode("latin-1")
    page.select_option("#language", "en")
    assert len(re.findall(r"/Type\s*/Page\b", paper)) == 2
    assert opened.complaints == []


def test_on_paper_is_the_worksheet_alone(page, printed):
    at(page, 0.2)
    page.check("#forces")
    sheets = printed()
    assert not page.is_visible("main")
    assert not page.is_visible("header")
    worksheet = sheets.first
    words = worksheet.inner_text()
    assert "0.200 s after the release" in words
    for setting in ("Angle of the string from straight up\t113.08 °", "Mass ratio M2/M1\t10", "Gravity\t9.81 m/s²"):
        assert setting in words
    assert "Wind" not in words, "what is seldom needed and zero is left out"
    assert worksheet.locator("ol > li").count() == 3
    assert worksheet.locator(".line-to-write").count() >= 6, "room for a prediction and for answers"
    assert worksheet.locator(".key").is_visible(), "what the arrows of the picture mean"
    assert "halts after" not in words, "no answer on the pupils' sheet"
    # The picture is as wide for its height as it was drawn
    sizes = worksheet.locator("figure > canvas").evaluate("(c) => [c.width / c.height, c.clientWidth / c.clientHeight]")
    assert sizes[0] == pytest.approx(sizes[1], rel=0.01)
    count = [page.evaluate(COUNT, [f"#handout article:nth-child({n}) canvas", ORANGE]) for n in (1, 2)]
    assert 0 < count[0] < count[1], "pupils do not see the path that is still to come"


@pytest.mark.parametrize("name", RELEASES)
def test_answers_are_those_of_the_pages_runs(page, printed, name):
    preset(page, name)
    sheets = printed()
    first, second, changed = answers(sheets)
    question = sheets.nth(1).locator("ol > li").last.inner_text()
    assert "NaN" not in sheets.nth(1).inner_text()
    run = "live.run"
    if name in ("ten_to_one", "atwood"):
        assert first == page.text_content("#result")
    if name == "ten_to_one":
        turns = page.evaluate(f"[0, {run}.halt, {run}.end].map((t) => {run}.at(t).turns.toFixed(2))")
        assert re.findall(r"\d\.\d\d(?= )", second)[:3] == turns
    if name == "atwood":
        pulls = page.evaluate(f"[{run}.at(0).lightTension, {run}.at(0).heavyTension].map((pull) => pull.toFixed(3))")
        assert re.findall(r"\d\.\d{3}", second) == pulls
    if name == "held":
        speed = page.evaluate(f"Math.max(...{run}.samples.map(({{ lightVelocity }}) => Math.hypot(...lightVelocity)))")
        assert first.endswith(f"at {speed:.2f} m/s.")
    if name == "drop":
        assert f"M2 {100 * page.evaluate(f'{run}.at({run}.end).drop'):.1f} cm" in first
    # Whoever moves the slider as the last question says has its answer as the first one
    page.emulate_media(media="screen")
    for label, wanted, _ in changes(question):
        field = page.get_by_label(label, exact=True).first.get_attribute("id").replace("range", "field")
        type_into(page, f"#{field}", wanted)
    settled(page)
    page.evaluate(PRINTED)
    answer, why = changed, ""
    if name == "ten_to_one":  # more friction, and it halts not for good: that is explained
        answer, why = re.fullmatch(r"(.*) (The more the rod grips, .*)", changed).groups()
    assert answers(page.locator("#handout article"))[0] == answer
    assert changed != first
    turns = re.findall(r"only ([\d.]+) turns", why)
    assert turns == page.evaluate("live.run.rests.slice(0, 1).map(({ turns }) => turns.toFixed(2))") * bool(why)


def test_without_friction_the_last_question_adds_some(opened, printed):
    preset(opened.page, "frictionless")
    assert value(opened.page, "kinetic_friction") == 0
    question = printed().nth(1).locator("ol > li").last.inner_text()
    assert [numbers for _, *numbers in changes(question)] == [["0.3", "0"], ["0.3", "0"]]


@pytest.mark.parametrize("name", ["ten_to_one", "frictionless", "static_friction"])
def test_the_changed_answer_is_the_references_for_just_what_the_question_says(page, printed, name):
    """The oracle is the model in Python, given no more than the printed words."""
    preset(page, name)
    sheets = printed()
    question = sheets.nth(1).locator("ol > li").last.inner_text()
    asked = {NAMES[label]: float(wanted) for label, wanted, _ in changes(question)}
    before = loader.load(name).parameters
    assert {NAMES[label]: float(old) for label, _, old in changes(question)} == {n: before.coefficients[n] for n in asked}
    run = solve(before.replace(**asked))
    halt = run.halting_time
    still = next((event.time for event in run.events if event.mode_after is Mode.STICKING), None)
    if halt is None and still is not None:
        # "Never halts" was said of it
        slides = next(event.time for event in run.events if event.event in SLIDES and event.time > still)
        expected = f"The heavy mass stands still after {still:.3f} s, but not for good: after {slides:.3f} s the string slides"
    elif halt is None:
        expected = "The heavy mass never halts: "
    else:
        drop = 100 * run.heavy_drop(run.sample(np.array([halt])).state)[0]
        expected = f"The heavy mass halts after {halt:.4f} s, {drop:.1f}\u00a0cm below its start."
    assert answers(sheets)[2].startswith(expected)


def test_the_angle_has_an_arc_where_the_mass_is_let_go(page):
    preset(page, "ten_to_one")
    drawn = []
    for time in (0, 0.05):
        at(page, time)
        drawn.append(page.evaluate(OPACITY_ON_ARC))
    assert drawn[0] > 200
    assert drawn[1] < 200, "no more than the path, which is pale"


@pytest.mark.long
def test_the_sheets_are_german(german, german_words):  # noqa: F811
    page = german.page
    for name in RELEASES:
        preset(page, name)
        page.evaluate(PRINTED)
        assert_german(page, german_words)
    page.evaluate("window.dispatchEvent(new Event('afterprint'))")


def test_the_command_prints(opened):
    opened.page.evaluate("() => { window.print = () => { window.hasPrinted = true; }; }")
    opened.page.click("#worksheet")
    assert opened.page.evaluate("window.hasPrinted")
