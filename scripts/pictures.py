"""Draw the pictures of README and the documentation's first page again: `python -m scripts.pictures`.

In a temporary folder, it runs the demonstration on the 10:1 trial and `identify` on the example's study (some minutes in all),
takes a picture of the demonstration's page in headless Chromium, and copies the reports' figures to docs/img.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from looping_pendulum.teaching.example_folder import write_example

IMAGES = Path(__file__).parents[1] / "docs" / "img"
DEMO_TIME = 0.62
"""Time that the demonstration shows in its picture [s]: the runs have separated, and none has ended."""
WINDOW = {"width": 1200, "height": 1060}
FIGURES = {"report/ten_to_one/figures/divergence.png": "divergence.png"}
STUDY_FIGURES = {"report/study/figures/motion.png": "identify.png"}


def run_command(folder: Path, *arguments: str) -> None:
    """Run a command of this package in ``folder``."""
    subprocess.run([sys.executable, "-m", "looping_pendulum", *arguments], cwd=folder, check=True)


def take_picture_of_demo(page_file: Path, picture: Path) -> None:
    """Store what the demonstration shows at `DEMO_TIME`."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
        page = browser.new_page(viewport=WINDOW, reduced_motion="reduce")
        page.goto(page_file.as_uri())
        page.evaluate("(t) => live.player.stopAt(t)", DEMO_TIME)
        page.evaluate("() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
        page.screenshot(path=picture)
        browser.close()


def main() -> None:
    """Draw all of them."""
    with tempfile.TemporaryDirectory() as name:
        folder, example = Path(name), Path(name, "example")
        run_command(folder, "demo", "ten_to_one", "--no-open")
        take_picture_of_demo(folder / "report" / "ten_to_one" / "demo.html", IMAGES / "demo.png")
        write_example(example)
        run_command(example, "identify", "study.yaml", "--out", "report/study")
        for place, figures in ((folder, FIGURES), (example, STUDY_FIGURES)):
            for source, target in figures.items():
                shutil.copyfile(place / source, IMAGES / target)


if __name__ == "__main__":
    main()
