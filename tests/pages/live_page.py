"""The live page as its tests take it: its text, a preset chosen, a value read."""

from __future__ import annotations

from functools import cache

from looping_pendulum.live.write import render

page_text = cache(render)


def settled(page):
    """Wait until the next frame is drawn."""
    page.evaluate("() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")


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


def value(page, name):
    return page.evaluate("(name) => live.state.values[name]", name)


def light_mass(page):
    """Where the light mass is on the screen [px]."""
    return page.evaluate("""() => {
      const box = document.getElementById("stage").getBoundingClientRect(), [x, y] = live.run.at(live.player.time).light;
      return [box.left + live.stage.view.x(x), box.top + live.stage.view.y(y)];
    }""")
