"""Write the files of an identification to a folder: the same report as Markdown and as a page."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from looping_pendulum.discrepancy.report import figures, markdown
from looping_pendulum.discrepancy.result import Identification, dump
from looping_pendulum.files import optional_output, write_atomically
from looping_pendulum.pages import drawing
from looping_pendulum.pages import report as pages
from looping_pendulum.pages.chart import Chart
from looping_pendulum.pages.report import glossary

FILES, FOLDERS = ("verdict.json", "repaired.yaml", "report.md", "report.html"), ("figures",)
"""Files and folders that `write` makes."""


def write(result: Identification, folder: Path) -> Path:
    """Write verdict.json, repaired.yaml, report.md with its first figure, and report.html with all; return report.md's path.

    The verdict is written first, so that it is there whatever else fails; a figure or a page that cannot be made is left out
    with a warning.
    """
    write_atomically(folder / "verdict.json", dump(result))
    write_atomically(folder / "repaired.yaml", result.scenario)
    charts = figures.charts(result)
    with optional_output("report.html"):
        write_atomically(folder / "report.html", identification_page(result, charts))
    picture = ""
    for chart in charts[:1]:  # drawing each takes half a second, and the page has them all
        file = f"figures/{chart.id}.png"
        with optional_output(file):
            write_atomically(folder / file, drawing.png(drawing.draw(chart)))
            picture = f"![{chart.caption}]({file})\n\n*{chart.caption}* More figures are in `report.html`.\n"
    write_atomically(folder / "report.md", markdown.identification_markdown(result, picture))
    return folder / "report.md"


def identification_page(result: Identification, charts: Sequence[Chart]) -> str:
    """Return the page as HTML: the sections of report.md, and interactive figures."""
    return pages.report_page(
        f"{result.title}: what the model lacks",
        markdown.before_figures(result),
        charts[1:],
        markdown.after_figures(result),
        glossary("identification"),
        "Residual: measured less predicted. Grey bands: two standard errors, which contain 95 % of mere noise.",
        first=charts[:1],
    )
