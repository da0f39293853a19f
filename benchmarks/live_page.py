"""Measure the live page: its size, its first paint, and how long a run with its drawing takes while a slider is dragged."""

from __future__ import annotations

import statistics
import tempfile
from pathlib import Path
from typing import Any

from benchmarks.pages import with_browser
from looping_pendulum.live.write import write

LIMITS = {"size [kB]": 400.0, "first paint [s]": 0.5, "run and drawing [ms]": 8.0}
VISITS = 3
MOVES = 200
DRAG = """async (moves) => {
  const range = document.getElementById("range-release_angle"), before = live.costs.length;
  for (let i = 0; i < moves; i++) {
    range.value = 90 + 0.2 * i;
    range.dispatchEvent(new Event("input"));
    await new Promise((done) => requestAnimationFrame(done));
  }
  return live.costs.slice(before);
}"""


def benchmark() -> None:
    """Print what was measured against the limits."""
    print("\n## The live page, a slider dragged through 200 settings\n")
    with tempfile.TemporaryDirectory() as folder:
        page = Path(folder) / "live.html"
        write(page)
        results = {"size [kB]": page.stat().st_size / 1e3} | in_browser(page)
    print("| what | measured | limit | |\n|---|---:|---:|---|")
    for what, limit in LIMITS.items():
        value = results.get(what)
        met = "no browser here" if value is None else "met" if value <= limit else "not met"
        print(f"| {what} | {'' if value is None else f'{value:.3g}'} | {limit:g} | {met} |")


def in_browser(page: Path) -> dict[str, float]:
    """Return the medians of first paint, and of a run with its drawing; empty without a browser."""
    visited = with_browser(lambda browser: [_one_visit(browser, page) for _ in range(VISITS)])
    if visited is None:
        return {}
    paints, costs = zip(*visited, strict=True)
    return {"first paint [s]": statistics.median(paints), "run and drawing [ms]": statistics.median(sum(costs, []))}


def _one_visit(browser: Any, page: Path) -> tuple[float, list[float]]:
    tab = browser.new_page(viewport={"width": 1280, "height": 900})
    tab.goto(page.as_uri())
    paint = 0.0
    while not paint:
        paint = tab.evaluate("performance.getEntriesByName('first-contentful-paint')[0]?.startTime ?? 0") / 1000
    costs: list[float] = tab.evaluate(DRAG, MOVES)
    tab.close()
    return paint, costs
