"""The text of docs/engine-study.md and the tables beside it, from the stored engine study."""

from __future__ import annotations

import csv
import io
import re

from benchmarks.advice import advice
from benchmarks.pareto import MARK, front
from benchmarks.stored_study import EngineStudy
from looping_pendulum.compare.convergence import report
from looping_pendulum.compare.convergence.result import HALT, VariantStudy, VariationStudy
from looping_pendulum.compare.tables import GAP, number, table

COMMAND = "python -m benchmarks.engine_study"
EARLY = "path_0.35s"
LARGE = 2.0
"""Factor by which a hidden default must enlarge the error to 0.35 s to stand on the page."""


def page(study: EngineStudy) -> str:
    """Return the page of Markdown: what to do, two figures, three tables in folds, and where all others are."""
    result = study.convergence
    return f"""# What the engines' errors are made of

## What to do

{advice(study)}
The [leaderboard](leaderboard.md) sorts all variants by any of these figures.

![Error to 0.7 s along every ladder, a panel for each variant](img/engine_study_ladders.png)

A *ladder* is a sequence of runs, its *rungs*, that refines one setting step by step while the others stay. Each line of the
figure is one. Where all lines of a panel meet is the variant at its own settings. A line that falls to the right has not
converged yet; a level one shows the error that refining does not remove; in a panel like a V the errors of the variant's own
settings cancel each other. The two integrators of the reference are left out, and so is a variant of which fewer than two
rungs reach 0.7 s.

{report.opening(result)}
## What an error consists of

Each error is split into three parts:

- **not converged**: how far the variant at its own settings is from its own limit, which the ladders show. Finer settings
  remove this part.
- **different model**: how far that limit is from the reference. No setting removes this part.
- **adapter's choice**: the largest change that another, equally reasonable choice of the adapter makes. If it is as large as
  the distance of the limit, that distance is the choice's, not the model's.

{fold("The parts of the error of the path to 0.7 s, every variant", splits_text(study))}
{fold("Whether the halting time of a variant converges", report.halting_table(result) + HALTING_NOTE)}
`looping-pendulum converge {result.scenario} --engine NAME` makes the same study of one variant, with a figure for every
setting. The [glossary](glossary.md) explains the terms.

## Speed against accuracy

![CPU seconds per simulated second against the error at 0.7 s](img/pareto.png)

The runs were timed apart from those of the errors, one process at a time, building included and imports not; the figure has
the median of some runs each. {timing_note(study)}

## Hidden defaults

{defaults_text(study)}
## All numbers

| table | a row for each |
| --- | --- |
{file_list()}
`{COMMAND}` writes these tables and this page from `docs/data/engine_study.json`, in which every run is; do not edit them by
hand. {days_text(study)}
"""


SPLITS_NOTE = f"""
The error is the root mean square distance of the light mass from the reference up to 0.7 s. *±* is half the width of a 95 %
interval, of both parts. *Spread* is the standard deviation of the error when the start changes by 0.01 deg or 0.1 mm,
each start with its own reference. Where a part is {GAP}, fewer than three runs have a value of it, or the run broke off.
"""
HALTING_NOTE = """
A halting time converges only if it does along every ladder. Otherwise the table has the scatter of the finest rungs of its
worst ladder, which one run does not show.
"""

FILES = {
    "splits": "variant and quantity: error to 0.35 s, to 0.7 s and of the halting time, with their parts",
    "halting": "variant: whether its halting time converges",
    "ladders": "setting that was refined: its ends, and how each error behaves along it",
    "defaults": "default of an engine that an adapter changes: what that setting alone does",
    "choices": "choice of an adapter: what an equally reasonable alternative does",
    "speed": "setting that was timed: error and seconds per simulated second",
    "provenance": "variant: versions, days of measurement, and who supplies which physics",
    "settings": "setting of a variant, in SI units",
}
"""Name of a table in docs/data/engine_study -> what a row of it is about."""


def file_list() -> str:
    """Return the rows of the page's list of tables."""
    return "".join(f"| [{name}.csv](data/engine_study/{name}.csv) | {text} |\n" for name, text in FILES.items())


def data_files(study: EngineStudy) -> dict[str, str]:
    """Return the name of each table of `FILES` -> its text, as CSV."""
    result = study.convergence
    splits = {report.QUANTITY_LABELS[name]: cells(report.splits_table(result, [name])) for name in (EARLY, MARK, HALT)}
    days = {m.variant: [m.errors, m.times or GAP] for m in study.measurements}
    head, *provenance = cells(report.provenance_table(result))
    settings = [[v.label, name, str(value)] for v in result.variants for name, value in v.provenance.settings.items()]
    rows = {
        "splits": [
            # The unit is the quantity's: millimetres of a path, milliseconds of a time
            ["quantity", "variant", "main cause", "error [mm or ms]", *splits[report.QUANTITY_LABELS[EARLY]][0][3:]],
            *([label, *row] for label, (_, *of_quantity) in splits.items() for row in of_quantity),
        ],
        "halting": cells(report.halting_table(result)),
        "ladders": cells(report.ladders_table(result)),
        "defaults": cells(report.defaults_table(result)),
        "choices": cells(report.choices_table(result)),
        "speed": speed_rows(study),
        "provenance": [[*head, "errors measured", "times measured"], *([*row, *days[row[0]]] for row in provenance)],
        "settings": [["variant", "setting", "value"], *settings],
    }
    return {name: _csv(rows[name]) for name in FILES}


def cells(markdown: str) -> list[list[str]]:
    """Return the head and the rows of a Markdown table."""
    lines = [re.split(r"(?<!\\)\|", line)[1:-1] for line in markdown.splitlines() if line.startswith("| ")]
    head, _, *rows = [[cell.strip().replace("\\|", "|") for cell in line] for line in lines]
    return [head, *rows]


def _csv(rows: list[list[str]]) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue()


def fold(summary: str, text: str) -> str:
    """Return ``text`` in a fold that a reader opens."""
    return f'<details markdown="1">\n<summary>{summary}</summary>\n\n{text}\n</details>\n'


def splits_text(study: EngineStudy) -> str:
    """Return the table of the parts of the error to 0.7 s, without a heading of its own, and what its columns mean."""
    text = report.splits_table(study.convergence, [MARK])
    return text[text.index("|") :] + SPLITS_NOTE


def speed_rows(study: EngineStudy) -> list[list[str]]:
    """Return a head, and a row for every timed setting: its error, its times, and whether any engine's point beats it."""
    best = {p.key for p in front(study.pareto)}
    contact = {p.key for p in front(p for p in study.pareto if p.contact)}
    head = ["variant", "setting", "no point is faster and more accurate", "RMS to 0.7 s [mm]", "CPU s per s", "wall s per s"]
    rows = [[*head, "runs", "slowest [wall s per s]"]]
    for p in sorted(study.pareto, key=lambda p: (p.variant, p.cpu)):
        beaten = "of all" if p.key in best else "of those with a law of their own" if p.key in contact else ""
        times = [number(x, digits=2) for x in (p.cpu, p.wall)]
        rows.append(
            [p.variant, p.where or "its own", beaten, number(1e3 * p.rms), *times, str(p.runs), number(p.slowest, digits=2)]
        )
    return rows


def timing_note(study: EngineStudy) -> str:
    """Say which settings were timed, and which times are older than the errors."""
    budgets = sorted({m.timing_budget for m in study.measurements if m.times})
    text = f"Only settings whose run took at most {' or '.join(f'{seconds:g}' for seconds in budgets)} s were timed."
    older = {m.times for m in study.measurements if m.times and m.times < m.errors}
    if older:
        text += f" Times of {' and '.join(sorted(older))} are older than the errors: of these, only settings\n"
        text += "are shown whose path is still the same to 1 %."
    return text


def defaults_text(study: EngineStudy) -> str:
    """Return how many defaults were tried, and a table of those with which a run fails or its error grows much."""
    rows, count = [], 0
    for v in study.convergence.variants:
        # Where the run ends with the adapter's own settings, or has all defaults at once, one default has no effect of its own
        for one in v.defaults if v.own.ok and v.variant != "defaults" else ():
            count += 1
            growth = _growth(v, one)
            if growth is None or growth >= LARGE:
                after = "its run ends" if growth is None else number(one.run.rms[EARLY], 1e3, 2)
                rows.append([v.label, one.what, one.other, one.ours, number(v.own.rms[EARLY], 1e3, 2), after])
    head = ["variant", "setting", "engine's default", "adapter's value", "error to 0.35 s [mm]", "with this default [mm]"]
    return f"""Of {count} defaults that the adapters change, {len(rows)} alone end a run, or enlarge its error to 0.35 s to
{LARGE:g} times that of the adapter's value or more.

{fold("These defaults", table(head, rows, left=4))}"""


def _growth(v: VariantStudy, one: VariationStudy) -> float | None:
    """Return the factor by which a default enlarges the error to 0.35 s; None if its run does not get there."""
    own, other = v.own.rms[EARLY], one.run.rms[EARLY]
    if not one.run.ok or other is None:
        return None
    return other / own if own else 1.0


def days_text(study: EngineStudy) -> str:
    """Say when the numbers were measured."""
    days = sorted({day for m in study.measurements for day in (m.errors, m.times) if day})
    return f"They were measured from {days[0]} to {days[-1]}, each variant with the versions that provenance.csv has."
