"""The live page as its tests take it: its text, a preset chosen, a value read."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from looping_pendulum.live.write import render

ACTIONS = Path(__file__).parent / "live_actions.js"

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


def act_at_random(visit, html, count):
    """Do ``count`` random actions on the page."""
    opened = visit(html)
    opened.page.set_default_timeout(600_000)
    assert opened.page.evaluate(ACTIONS.read_text(encoding="utf-8"), [20261123, count]) > count / 20
    settled(opened.page)
    assert opened.complaints == []
    # Whatever was done, a run is shown and every number is one
    assert opened.page.evaluate("live.run.samples.every(({ light, heavy }) => [...light, ...heavy].every(Number.isFinite))")
