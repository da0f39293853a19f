"""Write the files of an identification to a folder: the same report as Markdown and as a page, with its figures."""

from __future__ import annotations

import warnings
from pathlib import Path

from looping_pendulum.discrepancy.report import figures, markdown
from looping_pendulum.discrepancy.result import Identification, dump
from looping_pendulum.discrepancy.workers import SERIAL, Workers
from looping_pendulum.files import optional_output, write_atomically
from looping_pendulum.pages import report as pages
from looping_pendulum.pages.glossary import glossary

FILES, FOLDERS = ("verdict.json", "repaired.yaml", "report.md", "report.html"), ("figures",)
"""Files and folders that `write` makes."""


def write(result: Identification, folder: Path, workers: Workers = SERIAL) -> Path:
    """Write verdict.json, repaired.yaml, report.md with figures, and report.html; return the path of report.md.

    The verdict is written first, so that it is there whatever else fails; a figure or a page that cannot be made is left out
    with a warning. An idle one of the ``workers`` draws meanwhile.
    """
    drawings = workers.begin(_draw, None, [result])
    write_atomically(folder / "verdict.json", dump(result))
    write_atomically(folder / "repaired.yaml", result.scenario)
    with optional_output("report.html"):
        write_atomically(folder / "report.html", render(result))
    [(drawn, skipped)] = workers.finish(drawings)
    for warning in skipped:
        warnings.warn(warning, stacklevel=2)
    for name, (_, image) in drawn.items():
        write_atomically(folder / "figures" / name, image)
    captions = {f"figures/{name}": caption for name, (caption, _) in drawn.items()}
    write_atomically(folder / "report.md", markdown.render(result, captions))
    return folder / "report.md"


def _draw(_: None, result: Identification) -> tuple[dict[str, tuple[str, bytes]], list[Warning | str]]:
    """Return all figures, and the warnings about those that are left out."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        drawn = figures.draw(result)
    return drawn, [w.message for w in caught]


def render(result: Identification) -> str:
    """Return the page as HTML: the sections of report.md, and interactive figures."""
    return pages.render(
        f"{result.title}: what the model lacks",
        markdown.before_figures(result),
        figures.on_page(result),
        markdown.after_figures(result),
        glossary("identification"),
        "Residual: measured less predicted. Grey bands: two standard errors, which contain 95 % of mere noise.",
        figures.first_on_page(result),
    )
