"""Draw the pictures of README and the documentation's first page again: `python -m scripts.pictures`.

In a temporary folder, it runs the demonstration on the 10:1 trial and `identify` on the example's study (some minutes in all),
takes a picture of the demonstration's page in headless Chromium, and copies the reports' figures to docs/img.
"""

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from looping_pendulum.discrepancy.evidence.explanation import NOTHING, Addition, explained, fit_addition
from looping_pendulum.discrepancy.evidence.search import Search
from looping_pendulum.discrepancy.evidence.templates import templates
from looping_pendulum.discrepancy.fit.calibration import calibrate
from looping_pendulum.discrepancy.fit.residual_noise import refit_with_estimated_noise
from looping_pendulum.discrepancy.inputs import read_inputs
from looping_pendulum.discrepancy.report.markdown import probability_in_words
from looping_pendulum.files import write_atomically
from looping_pendulum.measured.study_io import load
from looping_pendulum.pages.drawing import new_figure, png
from looping_pendulum.pages.palette import COLOURS
from looping_pendulum.teaching.example_folder import write_example

IMAGES = Path(__file__).parents[1] / "docs" / "img"
DEMO_TIME = 0.62
"""Time that the demonstration shows in its picture [s]: the runs have separated, and none has ended."""
START = 0.1
"""Amount of a further effect with which its fit begins."""
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
        path = shutil.which("chromium-headless-shell") or shutil.which("chromium")
        browser = playwright.chromium.launch(executable_path=path, args=["--no-sandbox"])
        page = browser.new_page(viewport=WINDOW, reduced_motion="reduce")
        page.goto(page_file.as_uri())
        page.evaluate("(t) => live.player.stopAt(t)", DEMO_TIME)
        page.evaluate("() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
        page.screenshot(path=picture)
        browser.close()


def draw_evidence(study: Path, picture: Path) -> None:
    """Draw how well some explanations of a study fit, and how probable they are."""
    inputs = read_inputs(load(study))
    problem = inputs.problem()
    with threadpool_limits(1, user_api="blas"):
        search = Search(refit_with_estimated_noise(calibrate(problem)), inputs.library)
        search.run()
        best = search.best
        others = [c for c in inputs.library if c not in best.parts.effects]
        added = [
            Addition(
                parent=best, templates=(t,), amounts=(START,), step=np.zeros(len(best.fit.x)), gain=0.0, decrease=0.0,
                library=len(inputs.library),
            )
            for t in templates(best.fit, others, {})
        ]  # fmt: skip
        pairs = [explained(search.grid, fit, a.parts, len(inputs.library)) for a in added if (fit := fit_addition(a))]
        pair = min(pairs, key=lambda e: e.fit.cost)
    law = max((e for e in search.fitted.values() if e.parts.law), key=lambda e: e.log_posterior)
    shown = [search.fitted[NOTHING], best, pair, law]
    names = [" + ".join(sorted(e.key)).replace("_", " ").replace(" by ", "\nby ") or "nothing" for e in shown]
    weights = np.exp([e.log_posterior - best.log_posterior for e in shown])
    drawing = new_figure(9.0, 3.2)
    axes = drawing.subplots(1, 2)
    misfits, shares = [e.fit.cost / problem.count for e in shown], weights / weights.sum()
    for ax, values, label, said in (
        (axes[0], misfits, "misfit (chi-square per value)", [f"{m:.4f}" for m in misfits]),
        (axes[1], 100 * shares, "probability [%]", [probability_in_words(p) for p in shares]),
    ):
        bars = ax.barh(range(len(shown)), values, color=COLOURS[0])
        ax.bar_label(bars, said, padding=3)
        ax.set(xlabel=label, xlim=(0, 1.55 * max(values)), yticks=range(len(shown)))
        ax.invert_yaxis()
    axes[0].set_yticklabels(names)
    axes[1].set_yticklabels([])
    write_atomically(picture, png(drawing))


def main() -> None:
    """Draw all of them."""
    with tempfile.TemporaryDirectory() as name:
        folder, example = Path(name), Path(name, "example")
        run_command(folder, "demo", "ten_to_one", "--no-open")
        take_picture_of_demo(folder / "report" / "ten_to_one" / "demo.html", IMAGES / "demo.png")
        write_example(example)
        run_command(example, "identify", "study.yaml", "--out", "report/study")
        draw_evidence(example / "study.yaml", IMAGES / "evidence.png")
        for place, figures in ((folder, FIGURES), (example, STUDY_FIGURES)):
            for source, target in figures.items():
                shutil.copyfile(place / source, IMAGES / target)


if __name__ == "__main__":
    main()
