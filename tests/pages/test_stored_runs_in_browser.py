"""To which settings stored runs belong on the live page, and when one stands in for the page's own model."""

import numpy as np
import pytest

from looping_pendulum.reference_ode.solve import solve
from looping_pendulum.scenarios import load
from looping_pendulum.teaching import demo
from tests.pages.conftest import until
from tests.pages.live_page import COUNT, STAGE, act_at_random, at, preset, settled, type_into, value
from tests.pages.small import small_result, thick_result, twin_result

ROUNDING = 1e-5
"""The page's numbers have 1e-5 rad and 1e-6 m, which at 0.58 m of string is 6 micrometres [m]."""


@pytest.mark.long
def test_with_other_settings_the_runs_are_not_drawn_and_a_button_leads_back(visit):
    page = visit(demo.demo_page(small_result())).page
    at(page, 0.5)
    page.evaluate("document.documentElement.dataset.theme === 'light' || document.getElementById('theme').click()")
    settled(page)
    colour = page.evaluate("Theme.colour(live.engines.data.runs[1].colour)").lower()
    assert page.evaluate(COUNT, [STAGE, colour]) > 20
    assert page.inner_text("#engine-notice") == ""
    assert not page.is_visible("#engine-back")
    page.focus("#range-mass_ratio")
    page.keyboard.press("ArrowRight")
    settled(page)
    assert (
        page.inner_text("#engine-notice") == "The engines' runs belong to Two to one; with other settings they are not drawn."
    )
    assert page.evaluate(COUNT, [STAGE, colour]) == 0
    assert not any(page.locator(box).is_visible() for box in ("#timeline", "#engine-details", "[data-plot=distance]"))
    assert page.locator("#engine-runs input").first.is_disabled()
    page.locator("#range-light_drag").scroll_into_view_if_needed()
    assert page.locator("#engine-back").bounding_box()["y"] < 900, "it is in sight while sliders are moved"
    # The page's own model moves, for as long as it needs
    assert page.evaluate("live.player.end()") == page.evaluate("live.run.end")
    page.click("#engine-back")
    settled(page)
    assert value(page, "mass_ratio") == 2
    at(page, 0.5)
    assert page.evaluate(COUNT, [STAGE, colour]) > 20
    assert page.is_visible("#timeline")


def test_the_last_setting_stays_as_a_ghost_beside_the_runs(visit):
    page = visit(demo.demo_page(small_result())).page
    type_into(page, "#field-mass_ratio", "3")
    settled(page)
    assert page.evaluate("live.ghost.halt") == pytest.approx(small_result().reference.landmarks.halting_time, abs=1e-7)
    page.click("#engine-back")
    settled(page)
    assert page.evaluate("live.ghost.settings.heavy_mass / live.ghost.settings.light_mass") == pytest.approx(3)


@pytest.mark.parametrize("name", ["drop", "held", "atwood"])
def test_every_release_moves_beside_its_runs(visit, name):
    opened = visit(demo.demo_page(twin_result(load(name))))
    page = opened.page
    twin = page.evaluate("live.engines.data.runs[1].id")
    for share in (0.3, 1.0):
        time = share * load(name).duration
        at(page, time)
        place, sample = page.evaluate("([id, t]) => [live.engines.place(id, t), live.run.at(t)]", [twin, time])
        assert np.hypot(place["x"] - sample["light"][0], place["y"] - sample["light"][1]) < ROUNDING
        assert page.evaluate("document.getElementById('clock').textContent") == f"{time:.3f} s"
    # Within the canvas, whatever the motion
    box = page.evaluate("([x, y]) => [live.stage.view.x(x), live.stage.view.y(y)]", sample["heavy"])
    size = page.evaluate("[live.stage.canvas.clientWidth, live.stage.canvas.clientHeight]")
    assert all(0 <= pixel <= most for pixel, most in zip(box, size, strict=True))
    assert opened.complaints == []


@pytest.fixture(scope="module")
def thick(visit_once):
    return visit_once(demo.demo_page(thick_result()))


def test_a_stored_run_stands_in_for_a_model_that_lacks_an_effect(thick):
    page, result = thick.page, thick_result()
    preset(page, "thick")
    assert page.inner_text("#engine-notice") == (
        "This page's model does not have string thickness. What moves is the stored run of the reference; "
        "a slider sets the page's model going, without string thickness."
    )
    reference, halt = result.samples.reference, result.reference.landmarks.halting_time
    for i in range(0, len(reference.t), 100):
        sample = page.evaluate("(t) => live.run.at(t)", float(reference.t[i]))
        assert np.hypot(*(np.array(sample["light"]) - reference.light_position[i])) < ROUNDING
    assert page.evaluate("live.run.halt") == halt
    without = solve(load("two_to_one").parameters).halting_time
    assert abs(without - halt) > 1e-4, "else this test would not tell the two apart"
    assert f"halts after {halt:.4f} s" in page.inner_text("#result")
    assert "stored=thick" in page.evaluate("live.history.present && location.hash")
    # What the page cannot know of this run, it does not show
    assert not page.is_visible("[data-plot=energy]")
    assert page.is_disabled("#forces")
    assert page.is_disabled("#save-scenario")
    assert page.is_disabled("#save-numbers")
    page.locator("#table-of-run summary").click()
    settled(page)
    assert "NaN" not in page.inner_text("#table")
    assert thick.complaints == []


@pytest.mark.long
def test_a_slider_moves_the_model_without_the_effect_and_says_so(thick):
    page, result = thick.page, thick_result()
    preset(page, "thick")
    for choose in (
        lambda: preset(page, "two_to_one"),
        lambda: page.evaluate("location.hash = location.hash.split('&stored')[0]"),
    ):
        preset(page, "thick")
        choose()
        until(page, "live.state.stored === undefined")
        settled(page)
        # The same numbers, but for the string's thickness
        assert page.evaluate("live.run.halt") == pytest.approx(solve(load("two_to_one").parameters).halting_time, abs=1e-7)
        assert page.inner_text("#engine-notice") == (
            "The engines' runs belong to Thick; with other settings they are not drawn. "
            "This motion is without string thickness."
        )
        assert page.is_visible("[data-plot=energy]")
        assert page.is_enabled("#save-scenario")
    page.click("#undo")
    settled(page)
    assert page.evaluate("live.run.halt") == result.reference.landmarks.halting_time
    link = page.evaluate("location.hash")
    page.evaluate("(link) => { location.hash = link.replace('mass_ratio=2', 'mass_ratio=4'); }", link)
    until(page, "live.state.values.mass_ratio === 4")
    settled(page)
    assert page.evaluate("live.state.stored") is None, "a link with other numbers is no link to the stored run"
    page.evaluate("(link) => { location.hash = link; }", link)
    until(page, "live.state.stored === 'thick'")
    assert thick.complaints == []


@pytest.mark.long
@pytest.mark.parametrize("result", [small_result, thick_result])
def test_thirty_random_actions_beside_stored_runs(visit, result):
    act_at_random(visit, demo.demo_page(result()), 30)
