"""Measure how long the demonstration page takes to appear, and its frame rate in a real browser."""

from __future__ import annotations

import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
LIMITS = {"cold start [s]": 100.0, "with results [s]": 3.0, "size [MB]": 6.0, "first paint [s]": 1.0, "frames per second": 30.0}
"""Limits: the last is a minimum, the others are maxima."""
PLAYED = 3.0
"""Time over which frames are counted [s]."""
REPEATS = 3
Result = TypeVar("Result")


def benchmark() -> None:
    """Run `demo ten_to_one` cold and again, then look at its page in the browser."""
    print("\n## The demonstration page, `demo ten_to_one --profile quick`, all engines\n")
    with tempfile.TemporaryDirectory() as folder:
        results: dict[str, float] = {"cold start [s]": _demo(folder)}
        results["with results [s]"] = statistics.median(_demo(folder) for _ in range(REPEATS))
        page = Path(folder) / "demo.html"
        results["size [MB]"] = page.stat().st_size / 1e6
        report = Path(folder) / "report.html"
        results |= in_browser(page)
        print("| what | measured | limit | |\n|---|---:|---:|---|")
        for what, limit in LIMITS.items():
            value = results.get(what)
            if value is None:
                print(f"| {what} | no browser here | {limit:g} | |")
                continue
            met = value >= limit if what == "frames per second" else value <= limit
            print(f"| {what} | {value:.3g} | {limit:g} | {'met' if met else 'not met'} |")
        print(f"\n`report.html` beside it: {report.stat().st_size / 1e6:.2f} MB (limit 6).")


def _demo(folder: str) -> float:
    """Return the wall time of the command [s]."""
    command = [sys.executable, "-m", "looping_pendulum", "demo", "ten_to_one", "--no-open", "--out", folder]
    started = time.perf_counter()
    subprocess.run(command, check=True, capture_output=True)
    return time.perf_counter() - started


def with_browser(task: Callable[[Any], Result]) -> Result | None:
    """Return what ``task`` returns, given a browser; None without one."""
    path = next((browser_path for name in BROWSERS if (browser_path := shutil.which(name))), None)
    if path is None:
        return None
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=["--no-sandbox"])
        result = task(browser)
        browser.close()
    return result


def in_browser(page: Path) -> dict[str, float]:
    """Return the medians of first paint and frames per second; empty without a browser."""
    visited = with_browser(lambda browser: [_one_visit(browser, page) for _ in range(REPEATS)])
    if visited is None:
        return {}
    paints, rates = zip(*visited, strict=True)
    return {"first paint [s]": statistics.median(paints), "frames per second": statistics.median(rates)}


def _one_visit(browser: Any, page: Path) -> tuple[float, float]:
    tab = browser.new_page(viewport={"width": 1280, "height": 900})
    tab.goto(page.as_uri())
    paint = 0.0
    while not paint:  # it plays by itself: it is painted soon
        paint = tab.evaluate("performance.getEntriesByName('first-contentful-paint')[0]?.startTime ?? 0") / 1000
    tab.click("[data-slow='10']")  # long enough to count, and all that moves moves
    tab.click("#start")
    tab.click("#play")
    before = tab.evaluate("[live.frames, performance.now()]")
    tab.wait_for_timeout(1000 * PLAYED)
    after = tab.evaluate("[live.frames, performance.now()]")
    tab.close()
    return paint, 1000 * (after[0] - before[0]) / (after[1] - before[1])
