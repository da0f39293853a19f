"""Measure the pages in a real browser: the demonstration, and the live page while a slider is dragged."""

import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

from looping_pendulum.live.write import write

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
DEMONSTRATION_LIMITS = {
    "cold start [s]": 100.0,
    "with results [s]": 3.0,
    "size [MB]": 6.0,
    "report.html [MB]": 6.0,
    "first paint [s]": 1.0,
    "frames per second": 30.0,
}
"""Limits: the last is a minimum, the others are maxima."""
LIVE_LIMITS = {"size [kB]": 600.0, "first paint [s]": 0.5, "run and drawing [ms]": 8.0}
PLAYED = 3.0
"""Time over which frames are counted [s]."""
MOVES = 200
"""Settings through which the slider is dragged."""
REPEATS = 3
DRAG = """async (moves) => {
  while (!window.live) await new Promise((done) => requestAnimationFrame(done));  // its WebAssembly is being compiled
  const range = document.getElementById("range-release_angle"), before = live.costs.length;
  for (let i = 0; i < moves; i++) {
    range.value = 90 + 0.2 * i;
    range.dispatchEvent(new Event("input"));
    await new Promise((done) => requestAnimationFrame(done));
  }
  return live.costs.slice(before);
}"""
Result = TypeVar("Result")


def demonstration() -> None:
    """Run `demo ten_to_one` cold and again, then look at its page in the browser."""
    with tempfile.TemporaryDirectory() as folder:
        results = {"cold start [s]": _demo(folder)}
        results["with results [s]"] = statistics.median(_demo(folder) for _ in range(REPEATS))
        page = Path(folder) / "demo.html"
        results["size [MB]"] = page.stat().st_size / 1e6
        results["report.html [MB]"] = (Path(folder) / "report.html").stat().st_size / 1e6
        paint, rates = _visits(page, _frame_rate)
    _print("The demonstration page, `demo ten_to_one --profile quick`, all engines", DEMONSTRATION_LIMITS,
           results | paint | ({"frames per second": statistics.median(rates)} if rates else {}))  # fmt: skip


def live_page() -> None:
    """Measure the live page: its size, its first paint, and how long a run with its drawing takes while a slider is dragged."""
    with tempfile.TemporaryDirectory() as folder:
        page = Path(folder) / "live.html"
        write(page)
        size = {"size [kB]": page.stat().st_size / 1e3}
        paint, costs = _visits(page, lambda tab: tab.evaluate(DRAG, MOVES))
    _print(f"The live page, a slider dragged through {MOVES} settings", LIVE_LIMITS,
           size | paint | ({"run and drawing [ms]": statistics.median(sum(costs, []))} if costs else {}))  # fmt: skip


def _print(title: str, limits: Mapping[str, float], results: Mapping[str, float]) -> None:
    """Print what was measured against the limits; what a browser measures is missing where there is none."""
    print(f"\n## {title}\n\n| what | measured | limit | |\n|---|---:|---:|---|")
    for what, limit in limits.items():
        value = results.get(what)
        if value is None:
            print(f"| {what} | no browser here | {limit:g} | |")
            continue
        met = value >= limit if what == "frames per second" else value <= limit
        print(f"| {what} | {value:.3g} | {limit:g} | {'met' if met else 'not met'} |")


def _demo(folder: str) -> float:
    """Return the wall time of the command [s]."""
    command = [sys.executable, "-m", "looping_pendulum", "demo", "ten_to_one", "--no-open", "--out", folder]
    started = time.perf_counter()
    subprocess.run(command, check=True, capture_output=True)
    return time.perf_counter() - started


def _visits(page: Path, measure: Callable[[Any], Result]) -> tuple[dict[str, float], list[Result]]:
    """Return the median of first paint, and what ``measure`` says of each visit's tab; both empty without a browser."""
    path = next((browser_path for name in BROWSERS if (browser_path := shutil.which(name))), None)
    if path is None:
        return {}, []
    from playwright.sync_api import sync_playwright

    paints, results = [], []
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=["--no-sandbox"])
        for _ in range(REPEATS):
            tab = browser.new_page(viewport={"width": 1280, "height": 900})
            tab.goto(page.as_uri())
            paint = 0.0
            while not paint:  # it plays by itself: it is painted soon
                paint = tab.evaluate("performance.getEntriesByName('first-contentful-paint')[0]?.startTime ?? 0") / 1000
            paints.append(paint)
            results.append(measure(tab))
            tab.close()
        browser.close()
    return {"first paint [s]": statistics.median(paints)}, results


def _frame_rate(tab: Any) -> float:
    """Return the frames per second of the demonstration, played slowly."""
    tab.click("[data-slow='10']")  # long enough to count, and all that moves moves
    tab.click("#start")
    tab.click("#play")
    before = tab.evaluate("[live.frames, performance.now()]")
    tab.wait_for_timeout(1000 * PLAYED)
    after = tab.evaluate("[live.frames, performance.now()]")
    return 1000 * (after[0] - before[0]) / (after[1] - before[1])
