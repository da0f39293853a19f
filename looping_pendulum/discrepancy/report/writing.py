"""Write the files of an identification to a folder."""

from __future__ import annotations

from pathlib import Path

from looping_pendulum.discrepancy.report import markdown, page, plots
from looping_pendulum.discrepancy.result import Identification
from looping_pendulum.discrepancy.verdict_file import dump
from looping_pendulum.files import optional_output, write_atomically

FILES, FOLDERS = ("verdict.json", "repaired.yaml", "report.md", "report.html"), ("figures",)
"""Files and folders that `write` makes."""


def write(result: Identification, folder: Path) -> Path:
    """Write verdict.json, repaired.yaml, report.md with figures, and report.html; return the path of report.md.

    The verdict is written first, so that it is there whatever else fails; a figure or a page that cannot be made is left out
    with a warning.
    """
    write_atomically(folder / "verdict.json", dump(result))
    write_atomically(folder / "repaired.yaml", result.scenario)
    captions = {}
    for name, (caption, image) in plots.draw(result).items():
        write_atomically(folder / "figures" / name, image)
        captions[f"figures/{name}"] = caption
    write_atomically(folder / "report.md", markdown.render(result, captions))
    with optional_output("report.html"):
        write_atomically(folder / "report.html", page.render(result))
    return folder / "report.md"
