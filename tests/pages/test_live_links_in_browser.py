"""The live page's state in the address bar, there and back, in a real browser."""

import numpy as np
import pytest

from tests.pages.conftest import until
from tests.pages.live_page import preset, settled, value

NAMES_IN_CODES = (
    "release_angle free_length light_mass mass_ratio rod_radius kinetic_friction static_friction light_drag heavy_drag "
    "string_drag light_linear_drag heavy_linear_drag wind_speed side_force push_across push_along gravity hanging_length "
    "light_radius"
).split()
"""Settings of a code `LP1:...`, in its order."""


@pytest.mark.long
def test_a_link_leads_to_its_setting_and_back(page):
    preset(page, "two_to_one")
    link = page.evaluate("location.hash")
    values = page.evaluate("live.state")
    preset(page, "drop")
    assert page.evaluate("location.hash") != link
    page.evaluate("(link) => { location.hash = link; }", link)
    until(page, "document.getElementById('preset').value === 'two_to_one'")
    assert page.evaluate("live.state") == values


@pytest.mark.long
def test_any_setting_comes_back_by_its_link(opened):
    outcomes = opened.page.evaluate("""async () => {
      let seed = 20261124;
      const random = () => (seed = (seed * 48271) % 2147483647) / 2147483647;
      const releases = [...document.getElementById("release").options].map(({ value }) => value);
      const outcomes = [];
      for (let i = 0; i < 40; i++) {
        const select = document.getElementById("release");
        select.value = releases[i % releases.length];
        select.dispatchEvent(new Event("change"));
        for (const { name, min, max } of liveControls) {
          const field = document.getElementById(`field-${name}`);
          field.value = String(Number((min + random() * (max - min)).toPrecision(5)));
          field.dispatchEvent(new Event("change"));
        }
        const [link, state] = [location.hash, live.state];
        location.hash = "release=looping&mass_ratio=7";
        await new Promise((done) => window.addEventListener("hashchange", done, { once: true }));
        const between = live.state;
        location.hash = link;
        await new Promise((done) => window.addEventListener("hashchange", done, { once: true }));
        outcomes.push({ state, between, back: live.state, same: location.hash === link });
      }
      return outcomes;
    }""")
    for outcome in outcomes:
        assert outcome["between"] != outcome["state"] == outcome["back"]
        assert outcome["same"]
    assert {outcome["state"]["release"] for outcome in outcomes} == {"looping", "vertical", "held", "drop"}


@pytest.mark.parametrize(
    ("link", "message"),
    [
        (
            "release_angle_deg=500&mass_ratio=5",
            "the link: release_angle_deg: found '500', needed 5 to 180; the rest of the link is used",
        ),
        ("mass_ratio=5&release=thrown", "the link: release: found 'thrown', needed one of looping, vertical, held, drop; "),
        ("mass_ratio=5&free_length_cm=<b>1</b>", "the link: free_length_cm: found '<b>1</b>', needed 10 to 150; "),
    ],
)
def test_a_bad_link_says_so_and_keeps_the_rest(page, link, message):
    page.evaluate("(link) => { location.hash = link; }", link)
    until(page, "document.getElementById('fault').textContent !== ''")
    assert page.inner_text("#fault").startswith(message)
    assert value(page, "mass_ratio") == 5


def test_a_saved_page_gives_a_code_that_any_copy_takes(page, tmp_path):
    """Its address, `file:///...`, is a dead link for all others."""
    preset(page, "two_to_one")
    state = page.evaluate("live.state")
    code = page.evaluate("live.history.shared")
    assert code.startswith("LP1:looping;")
    assert len(code) < 120
    preset(page, "drop")
    page.fill("#code", f"  {code} ")
    page.dispatch_event("#code", "change")
    settled(page)
    assert page.evaluate("live.state") == state
    assert page.input_value("#code") == page.inner_text("#code-fault") == ""
    link = "https://example.org/live.html" + page.evaluate("location.hash")
    preset(page, "drop")
    page.fill("#code", link)
    page.dispatch_event("#code", "change")
    settled(page)
    assert page.evaluate("live.state") == state


def test_a_code_of_the_first_form_stays_readable(page):
    """It names no settings: with other controls, or in another order, the form needs another number."""
    names = page.evaluate("liveControls.map(({ name }) => name)")
    assert names == NAMES_IN_CODES
    page.fill("#code", "lp1:looping;20")
    page.dispatch_event("#code", "change")
    assert page.inner_text("#fault").startswith("the link: free_length_cm: found '0', needed 10 to 150; ")


def test_what_is_no_code_is_named(page):
    page.fill("#code", "hello")
    page.dispatch_event("#code", "change")
    assert (
        page.inner_text("#code-fault")
        == "“hello” is neither a code, which begins with LP1:, nor a link with settings behind #."
    )


def test_the_qr_code_is_the_code(page):
    cv2 = pytest.importorskip("cv2", reason="OpenCV, which reads the QR code, is not installed (extra `film`)")
    page.click("#show-qr")
    modules = page.evaluate("""() => {
      const canvas = document.getElementById("qr"), { width, height } = canvas;
      const { data } = canvas.getContext("2d").getImageData(0, 0, width, height);
      return Array.from({ length: height }, (_, y) => Array.from({ length: width }, (_, x) => data[4 * (y * width + x)]));
    }""")
    picture = np.kron(np.array(modules, dtype=np.uint8), np.ones((6, 6), dtype=np.uint8))
    assert cv2.QRCodeDetector().detectAndDecode(picture)[0] == page.evaluate("live.history.shared")
