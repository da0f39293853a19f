"""How a notebook shows results: one function for each kind, registered with IPython, so that results know nothing of it."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING, Any

from looping_pendulum.pages import markdown

if TYPE_CHECKING:
    from looping_pendulum.compare.result import ComparisonResult
    from looping_pendulum.discrepancy.fit_study import StudyFit
    from looping_pendulum.discrepancy.result import Identification
    from looping_pendulum.reference_ode.solution import Run
    from looping_pendulum.runs.trajectory import Trajectory
    from looping_pendulum.scenarios.scenario import Scenario

NOT_NUMBERS = ("title", "description", "inferred", "measured", "tolerances")
"""Keys of a scenario that are not shown in the table of its numbers."""


def register() -> None:
    """Have IPython show results as HTML, if it runs here."""
    shell = sys.modules["IPython"].get_ipython() if "IPython" in sys.modules else None
    if shell is not None:
        formatter = shell.display_formatter.formatters["text/html"]
        for (module, name), show in FORMATTERS.items():
            formatter.for_type_by_name(module, name, show)


def _html(title: str, note: str, *parts: str) -> str:
    """Return the HTML of a title, a note in plain text, and Markdown ``parts``."""
    heading = f"**{markdown.escaped(title)}**"
    return str(markdown.html("\n\n".join([heading, *([markdown.escaped(note)] if note.strip() else []), *parts])))


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    return markdown.table(head, rows, left=len(head))


def reference_run(run: Run) -> str:
    """Return an exact run's events, with the apparatus at each."""
    from looping_pendulum.reference_ode.transitions import PHASE_EVENTS
    from looping_pendulum.runs.outcome import outcome

    note = f"{outcome(run)} Its tolerance is {run.tolerance:g}."
    rows = [
        [
            f"{e.time:.6f}",
            "release" if e.event is None else str(e.event).replace("_", " "),
            e.mode_after.name.lower().replace("_", " "),
            f"{float(run.heavy_drop(e.state)):.4f}",
            f"{float(e.state.wrap_angle):.4f}",
            f"{float(e.state.free_length):.4f}",
        ]
        for e in run.events
        if e.event not in PHASE_EVENTS
    ]
    head = ["time [s]", "event", "mode after it", "M2 has fallen by [m]", "wrap angle [rad]", "free length [m]"]
    return _html("Exact reference", note, _table(head, rows))


def scenario(scenario: Scenario) -> str:
    """Return a scenario's numbers with their units, and the limits that engines must keep."""
    import yaml

    from looping_pendulum.compare.json_text import flatten
    from looping_pendulum.scenarios import loader
    from looping_pendulum.scenarios.metrics import METRICS
    from looping_pendulum.scenarios.units import show

    tree = yaml.safe_load(loader.dump(scenario))
    numbers = {key: value for key, value in tree.items() if key not in NOT_NUMBERS}
    parts = [_table(["key", "value"], [(".".join(keys), str(value)) for keys, value in flatten(numbers).items()])]
    if scenario.tolerances:
        rows = [[t.engine, t.profile, t.metric, show(t.limit, METRICS[t.metric].unit), t.reason] for t in scenario.tolerances]
        parts.append(_table(["engine", "profile", "metric", "limit", "why this much"], rows))
    return _html(f"{scenario.name}: {scenario.title}", scenario.description, *parts)


def trajectory(run: Trajectory) -> str:
    """Return how an engine's run ended, what happened in it, and who supplied which physics."""
    from looping_pendulum.runs.trajectory import supplies_as_rows

    until = (
        f"{len(run.t)} samples to {run.t[-1]:.3f} s; the heavy mass fell {run.heavy_drop.max():.4f} m at most. "
        if len(run.t)
        else ""
    )
    versions = ", ".join(f"{name} {version}" for name, version in run.provenance.versions.items())
    parts = [_table(["physics", "by", "how"], supplies_as_rows(run.provenance.supplies))]
    if run.events:
        parts.insert(0, _table(["time [s]", "event"], [[f"{e.time:.6f}", e.name.replace("_", " ")] for e in run.events]))
    note = f"{run.status.value}. {until}{run.message} {versions}"
    return _html(f"{run.label} on {run.scenario}, {run.profile}", note, *parts)


def comparison(result: ComparisonResult) -> str:
    """Return verdict, table and stories of a comparison."""
    from looping_pendulum.compare.report import before_figures

    return str(markdown.html("\n\n".join(before_figures(result))))


def identification(result: Identification) -> str:
    """Return verdict, what was added, and the errors before and after."""
    from looping_pendulum.discrepancy.report.markdown import before_figures

    return str(markdown.html("\n\n".join(before_figures(result))))


def study_fit(result: StudyFit) -> str:
    """Return the fitted parameters of a declared model, and the remarks on them."""
    from looping_pendulum.pages.tables import text_cells

    rows = result.rows()
    table = _table([*rows[0]], text_cells(rows))
    return _html(f"Fit of {result.fit.problem.study.name}", result.summary, table, *map(markdown.escaped, result.remarks))


FORMATTERS: dict[tuple[str, str], Callable[[Any], str]] = {
    ("looping_pendulum.reference_ode.solution", "Run"): reference_run,
    ("looping_pendulum.scenarios.scenario", "Scenario"): scenario,
    ("looping_pendulum.runs.trajectory", "Trajectory"): trajectory,
    ("looping_pendulum.compare.result", "ComparisonResult"): comparison,
    ("looping_pendulum.discrepancy.result", "Identification"): identification,
    ("looping_pendulum.discrepancy.fit_study", "StudyFit"): study_fit,
}
"""Module and name of a class -> what shows it. By name, so that showing a scenario imports nothing of the reports."""
