"""The live page's state in the address bar, there and back, in a real browser."""

from __future__ import annotations

import pytest

from tests.pages.conftest import until
from tests.pages.live_page import preset, settled, value


def test_a_link_leads_to_its_setting_and_back(opened):
    page = opened.page
    preset(page, "two_to_one")
    link = page.evaluate("location.hash")
    values = page.evaluate("live.state")
    preset(page, "drop")
    assert page.evaluate("location.hash") != link
    page.evaluate("(link) => { location.hash = link; }", link)
    settled(page)
    assert page.evaluate("live.state") == values
    assert page.input_value("#preset") == "two_to_one"


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
def test_a_bad_link_says_so_and_keeps_the_rest(opened, link, message):
    page = opened.page
    page.evaluate("(link) => { location.hash = link; }", link)
    until(page, "document.getElementById('fault').textContent !== ''")
    assert page.inner_text("#fault").startswith(message)
    assert value(page, "mass_ratio") == 5
