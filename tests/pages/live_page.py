"""The live page as its tests take it: its text, a preset chosen, a value read."""

from functools import cache
from pathlib import Path

from looping_pendulum.live.write import render

ACTIONS = Path(__file__).parent / "live_actions.js"

PLAYED_TO = """(time) => new Promise((done) => {
  const look = () => {
    if (live.player.time < time) { requestAnimationFrame(look); return; }
    live.player.setSlow(1e6);
    done();
  };
  look();
})"""

STAGE = "#stage"
COUNT = """([selector, colour]) => {
  const canvas = document.querySelector(selector), context = canvas.getContext("2d");
  const [r, g, b] = [1, 3, 5].map((i) => parseInt(colour.slice(i, i + 2), 16));
  const { data } = context.getImageData(0, 0, canvas.width, canvas.height);
  let count = 0;
  for (let i = 0; i < data.length; i += 4) if (data[i] === r && data[i + 1] === g && data[i + 2] === b) count += 1;
  return count;
}"""
"""Pixels of a canvas that have a colour."""

page_text = cache(render)


SETTLED = """() => new Promise((done) => {
  const draw = () => requestAnimationFrame(() => requestAnimationFrame(done));
  const look = () => (live.history.travels ? requestAnimationFrame(look) : draw());
  look();
})"""


def settled(page):
    """Wait until the browser has gone where Undo sent it, and the next frame is drawn."""
    page.evaluate(SETTLED)


def at(page, time):
    """Set the time and wait until it is drawn."""
    page.evaluate("(t) => live.player.stopAt(t)", time)
    settled(page)


def played_to(page, time):
    """Wait until the motion plays beyond a time, and slow it down there: it plays on for as long as the test looks at it."""
    page.evaluate(PLAYED_TO, time)


def preset(page, name):
    page.evaluate(
        """(name) => {
      const select = document.getElementById("preset");
      select.value = name;
      select.dispatchEvent(new Event("change"));
    }""",
        name,
    )
    settled(page)


def type_into(page, selector, text):
    """Type into a field, and leave it."""
    page.fill(selector, text)
    page.keyboard.press("Tab")


def downloaded(page, button):
    """Return the bytes of the file that a button saves."""
    with page.expect_download() as download:
        page.click(button)
    return Path(download.value.path()).read_bytes()


def value(page, name):
    return page.evaluate("(name) => live.state.values[name]", name)


def light_mass(page):
    """Where the light mass is on the screen [px]."""
    return page.evaluate("""() => {
      const box = document.getElementById("stage").getBoundingClientRect(), [x, y] = live.run.at(live.player.time).light;
      return [box.left + live.stage.view.x(x), box.top + live.stage.view.y(y)];
    }""")


def act_at_random(visit, html, count):
    """Do ``count`` random actions on the page."""
    opened = visit(html)
    assert opened.page.evaluate(ACTIONS.read_text(encoding="utf-8"), [20261123, count]) > count / 20
    settled(opened.page)
    assert opened.complaints == []
    # Whatever was done, a run is shown and every number is one
    assert opened.page.evaluate("live.run.samples.every(({ light, heavy }) => [...light, ...heavy].every(Number.isFinite))")
