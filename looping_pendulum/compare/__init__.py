"""Where, when and by how much engines depart from the reference.

`compare` makes one frozen `ComparisonResult` of a scenario, the reference and several trajectories; `write` puts it on disk as
``report.md``, ``report.html``, ``result.json``, ``figures/*.png`` and ``trajectories/*.csv``.
"""

from __future__ import annotations

from pathlib import Path

from looping_pendulum.compare.baseline import ResultChanges
from looping_pendulum.compare.comparison import compare
from looping_pendulum.compare.result import ComparisonResult
from looping_pendulum.compare.trajectories import residual_csv, trajectory_csv, trajectory_files
from looping_pendulum.files import optional_output, write_atomically

__all__ = ["ComparisonResult", "compare", "write", "write_page_meanwhile"]


def write(result: ComparisonResult, folder: Path | str, changes: ResultChanges | None = None) -> Path:
    """Write ``result`` below ``folder`` and return the report's path; each file is whole or absent.

    With a measured trial there is ``residuals.csv``, too. A result read back from JSON has no samples: then the report has no
    figures and there are no CSV files. With ``changes`` since a baseline the report has a section on them, and ``changes.json``
    has them as data. The numbers are written first; a figure or a page that cannot be made is left out with a warning.
    """
    from looping_pendulum.compare.figures import charts
    from looping_pendulum.compare.report import comparison_markdown, render_page
    from looping_pendulum.pages.drawing import draw, png

    folder = Path(folder)
    write_atomically(folder / "result.json", result.to_json())
    if changes is not None:
        write_atomically(folder / "changes.json", changes.to_json())
    if result.samples is not None:
        write_atomically(folder / "trajectories" / "reference.csv", trajectory_csv(result.samples.reference))
        for aligned, name in zip(result.samples.aligned, trajectory_files(result), strict=True):
            # A run without samples has no trajectory to write
            if len(aligned.run.t):
                write_atomically(folder / "trajectories" / name, trajectory_csv(aligned.run))
        if result.trial is not None and result.trial.tracks:
            write_atomically(folder / "residuals.csv", residual_csv(result, result.samples, result.trial))
        else:
            (folder / "residuals.csv").unlink(missing_ok=True)  # of another trial
    made = charts(result)
    captions = {}
    for chart in made:
        file = f"figures/{chart.id}.png"
        with optional_output(file):
            write_atomically(folder / file, png(draw(chart)))
            captions[file] = chart.caption
    report = folder / "report.md"
    write_atomically(report, comparison_markdown(result, captions, changes))
    with optional_output("report.html"):
        write_atomically(folder / "report.html", render_page(result, made, changes))
    return report


def write_page_meanwhile(result: ComparisonResult, running: tuple[str, ...], folder: Path) -> None:
    """Write report.html with the engines that have ended, and the labels of those that are still ``running``."""
    from looping_pendulum.compare.figures import charts
    from looping_pendulum.compare.report import render_page

    with optional_output("report.html"):
        write_atomically(folder / "report.html", render_page(result, charts(result), running=running))
