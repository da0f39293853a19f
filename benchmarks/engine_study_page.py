"""The text of docs/engine-study.md, from the stored engine study."""

from __future__ import annotations

from benchmarks.advice import advice
from benchmarks.pareto import PROTOTYPES, front
from benchmarks.stored_study import EngineStudy
from looping_pendulum.compare.convergence import report
from looping_pendulum.compare.tables import GAP, number, table

COMMAND = "python -m benchmarks.engine_study"


def page(study: EngineStudy) -> str:
    """Return the page of Markdown: what to do, one figure, and the tables in folds."""
    result = study.convergence
    return f"""# What the engines' errors are made of

## What to do

{advice(study)}
The [leaderboard](leaderboard.md) sorts all variants by any of these figures.

![Error to 0.7 s along every ladder, a panel for each variant](img/engine_study_ladders.png)

Each line is a ladder: one setting is refined, the others stay. Where all lines of a panel meet is the variant at its own
settings. A line that falls to the right has not converged yet; a level one shows the error that refining does not remove; in
a panel like a V the errors of the variant's own settings cancel each other. The two integrators of the reference are left out,
and so is a variant of which fewer than two rungs reach 0.7 s.

`{COMMAND}` writes this page from `docs/data/engine_study.json`; do not edit it by hand.
Variants are measured on days of their own, [with the versions of that day](#provenance).
`looping-pendulum converge {result.scenario} --engine NAME` writes the same report for one variant, with a figure for
every setting. The [glossary](glossary.md) explains the terms.

{report.opening(result)}
## How to read the tables

{report.HOW_TO_READ}
## How each error splits into parts

{fold("Not converged, different model, or the adapter's choice: every variant", report.splits_table(result))}
## Does the halting time converge?

{fold("The halting time of every variant", report.halting_table(result))}
## Every ladder

{report.HOW_TO_READ_LADDERS}
{fold("Every setting that was refined", report.ladders_table(result))}
## Speed against accuracy

![CPU seconds per simulated second against the error at 0.7 s](img/pareto.png)

{pareto_text(study)}
## Hidden defaults

Each row is a run in which only this setting differs from the variant's own settings.

{fold("Every default of an engine that an adapter changes", report.defaults_table(result))}
## The adapters' choices

{fold("Every choice, and an equally reasonable alternative", report.choices_table(result))}
## Provenance

{fold("When each variant was measured", days_table(study))}
{fold("Versions, suppliers of the physics, and settings", report.provenance_table(result))}"""


def fold(summary: str, text: str) -> str:
    """Return ``text`` in a fold that a reader opens."""
    return f'<details markdown="1">\n<summary>{summary}</summary>\n\n{text}\n</details>\n'


def days_table(study: EngineStudy) -> str:
    """Return a table of the days on which each variant was measured, and of the engine's versions on that day."""
    versions = {v.label: v.provenance.versions for v in study.convergence.variants}
    rows = [
        [m.variant, ", ".join(f"{k} {x}" for k, x in versions[m.variant].items()) or GAP, m.errors, m.times or GAP]
        for m in study.measurements
    ]
    return table(["variant", "versions", "errors measured", "times measured"], rows, left=4)


def pareto_text(study: EngineStudy) -> str:
    """Return the tables of the points on the Pareto front, the variants' own points, and the prototypes."""
    timed_points = study.pareto
    best = {p.key for p in front(timed_points)}
    contact = {p.key for p in front(p for p in timed_points if p.contact)}
    head = ["variant", "setting", "what", "RMS to 0.7 s [mm]", "CPU s per s", "wall s per s", "runs", "slowest"]
    rows = []
    for p in sorted(timed_points, key=lambda p: (p.variant, p.cpu)):
        marks = [
            *(["front"] if p.key in best else []),
            *(["front, own law"] if p.key in contact - best else []),
            *(["own settings"] if not p.where else []),
        ]
        if marks:
            times = [number(x, digits=2) for x in (p.cpu, p.wall)]
            rows.append(
                [
                    p.variant,
                    p.where or "its own",
                    ", ".join(marks),
                    number(1e3 * p.rms),
                    *times,
                    str(p.runs),
                    number(p.slowest, digits=2),
                ]
            )
    old = table(["prototype", "RMS to 0.7 s [mm]", "wall s per s"], [[w, number(e), number(t)] for w, e, t in PROTOTYPES])
    return f"""Timed apart from the error runs, one process at a time, building included and imports not; median of the runs.
The slowest is in wall seconds. {timing_note(study)}

**front**: no engine's point is both faster and more accurate. **front, own law**: none is of those engines that supply winding
and friction law themselves.

{fold("The points of the two fronts, and each variant's own settings", table(head, rows, left=3))}
{fold("Prototypes written before the adapters, in haste on a shared machine: times to a factor of two", old)}"""


def timing_note(study: EngineStudy) -> str:
    """Say which settings were timed, and which times are older than the errors."""
    budgets = sorted({m.timing_budget for m in study.measurements if m.times})
    text = f"Only settings whose run took at most {' or '.join(f'{seconds:g}' for seconds in budgets)} s were timed."
    older = {m.times for m in study.measurements if m.times and m.times < m.errors}
    if older:
        text += f" Times of {' and '.join(sorted(older))} are [older than the errors](#provenance): of these, only settings\n"
        text += "are shown whose path is still the same to 1 %."
    return text
