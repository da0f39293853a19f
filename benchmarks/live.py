"""Measure in a real browser how long a run of the live model takes, with its drawing, and how fluid dragging a slider is."""

from __future__ import annotations

from typing import Any

from benchmarks.pages import with_browser
from looping_pendulum.live.write import live_settings, page_script
from looping_pendulum.scenarios import load, shipped

MAX_RUN_TIME = 8.0
"""Limit on a run with its drawing, median [ms]: half of a frame's time at 60 frames per second."""
MIN_FRAMES_PER_SECOND = 55.0
"""Limit while a slider is dragged; browsers show at most 60."""
DRAGGED = 3.0
"""Time for which the slider is dragged [s]."""
REPEATS = 60
DRAWING = """
const canvas = document.createElement("canvas");
canvas.width = 900;
canvas.height = 900;
document.body.append(canvas);
const context = canvas.getContext("2d", { willReadFrequently: true });
globalThis.runAndDraw = (settings) => {
  const run = loopingPendulum.simulate(settings);
  context.clearRect(0, 0, 900, 900);
  for (const mass of ["light", "heavy"]) {
    context.beginPath();
    // About as many points as the path is pixels long
    for (let i = 0; i <= 500; i++) {
      const [x, y] = run.sample((i / 500) * run.endTime)[mass];
      context.lineTo(450 + 500 * x, 450 - 500 * y);
    }
    context.stroke();
  }
  context.getImageData(0, 0, 1, 1);  // waits until it is drawn
};
globalThis.timed = (settings, repeats) => {
  const median = (task) => {
    for (let i = 0; i < repeats; i++) task();
    const times = [];
    for (let i = 0; i < repeats; i++) {
      const start = performance.now();
      task();
      times.push(performance.now() - start);
    }
    return times.sort((a, b) => a - b)[repeats >> 1];
  };
  return [median(() => loopingPendulum.simulate(settings)), median(() => runAndDraw(settings))];
};
globalThis.dragged = (settings, seconds) =>
  new Promise((resolve, reject) => {
    const start = performance.now();
    let frames = 0;
    const frame = () => {
      const elapsed = (performance.now() - start) / 1000;
      if (elapsed > seconds) return resolve(frames / elapsed);
      try {
        runAndDraw({ ...settings, release_angle: settings.release_angle * (1 + 0.3 * Math.sin(elapsed)) });
      } catch (error) {
        return reject(error);
      }
      frames += 1;
      requestAnimationFrame(frame);
    };
    requestAnimationFrame(frame);
  });
"""


def benchmark() -> None:
    """Time the shipped scenarios."""
    print("\n## The live model in a browser\n")
    rows = with_browser(lambda browser: _rows(browser.new_page()))
    if rows is None:
        print("No browser here.")
        return
    print(
        "| scenario | a run [ms] | a run with its drawing [ms] | frames per second while dragged | |\n|---|---:|---:|---:|---|"
    )
    print("\n".join(rows))
    print(f"\nMedians of {REPEATS}; limits: {MAX_RUN_TIME:g} ms with drawing, {MIN_FRAMES_PER_SECOND:g} frames per second.")


def _rows(page: Any) -> list[str]:
    # The last value is an object: Playwright would call a function
    page.evaluate(f"{DRAWING} {page_script()} globalThis.loopingPendulum = loopingPendulum;")
    rows = []
    for name in shipped():
        settings = live_settings(load(name).parameters)
        run, drawn = page.evaluate("([settings, repeats]) => timed(settings, repeats)", [settings, REPEATS])
        frames = page.evaluate("([settings, seconds]) => dragged(settings, seconds)", [settings, DRAGGED])
        met = drawn <= MAX_RUN_TIME and frames >= MIN_FRAMES_PER_SECOND
        rows.append(f"| {name} | {run:.2f} | {drawn:.2f} | {frames:.0f} | {'met' if met else 'not met'} |")
    return rows
