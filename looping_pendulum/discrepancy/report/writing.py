"""Everything that `identify` leaves in a folder."""

from __future__ import annotations

from pathlib import Path

from looping_pendulum.discrepancy.result import dump
from looping_pendulum.discrepancy.report import markdown, page, plots
from looping_pendulum.discrepancy.result import Identification
from looping_pendulum.files import decoration, write_whole

FILES, FOLDERS = ("verdict.json", "repaired.yaml", "report.md", "report.html"), ("figures",)
"""What `write` leaves."""


def write(result: Identification, folder: Path) -> Path:
    """Write verdict.json, repaired.yaml, report.md with figures, and report.html; return the path of report.md.

    The verdict is written first; a figure or a page that cannot be made is left out with a warning.
    """
    write_whole(folder / "verdict.json", dump(result))
    write_whole(folder / "repaired.yaml", result.scenario)
    captions = {}
    for name, (caption, image) in plots.draw(result).items():
        write_whole(folder / "figures" / name, image)
        captions[f"figures/{name}"] = caption
    write_whole(folder / "report.md", markdown.render(result, captions))
    with decoration("report.html"):
        write_whole(folder / "report.html", page.render(result))
    return folder / "report.md"
