"""Everything that `identify` leaves in a folder."""

from __future__ import annotations

from pathlib import Path

from looping_pendulum.compare.export import file_stem, write_whole
from looping_pendulum.discrepancy import verdict
from looping_pendulum.discrepancy.report import markdown, page, plots
from looping_pendulum.discrepancy.verdict import Identification


def write(result: Identification, folder: Path) -> Path:
    """Write report.md with figures, report.html, verdict.json and repaired.yaml; return the path of report.md."""
    captions = {}
    for name, (caption, image) in plots.draw(result).items():
        stem = f"{file_stem(name.removesuffix('.png'))}.png"
        write_whole(folder / "figures" / stem, image)
        captions[f"figures/{stem}"] = caption
    write_whole(folder / "verdict.json", verdict.dump(result))
    write_whole(folder / "repaired.yaml", result.scenario)
    write_whole(folder / "report.html", page.render(result))
    write_whole(folder / "report.md", markdown.render(result, captions))
    return folder / "report.md"
