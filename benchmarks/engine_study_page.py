"""The text and the figures of docs/engine-study.md and the tables beside it, from the stored engine study."""

import csv
import io
import math
import re
from collections.abc import Sequence

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from benchmarks.stored_study import MARK, EngineStudy, Point, front, supplied_by_engine
from looping_pendulum.compare.convergence import report
from looping_pendulum.compare.convergence.ladder import ErrorCause, refinement_sizes
from looping_pendulum.compare.convergence.report import halting_verdict
from looping_pendulum.compare.convergence.result import (
    HALT,
    ConvergenceResult,
    ErrorSplit,
    LadderStudy,
    VariantStudy,
    VariationStudy,
)
from looping_pendulum.pages.drawing import legend_below, make_figure
from looping_pendulum.pages.markdown import table
from looping_pendulum.pages.numbers import GAP, number
from looping_pendulum.pages.palette import COLOURS, GREY, MARKERS, styles

COMMAND = "python -m benchmarks.engine_study"
EARLY = "path_0.35s"
LARGE = 2.0
"""Factor by which a hidden default must enlarge the error to 0.35 s to stand on the page."""
TARGET = 60.0
"""CPU seconds per simulated second that a chain may take: a run of 0.7 s then takes less than a minute."""
KINDS = {
    "time step": ("time_step",),
    "link length": ("bend", "link_length", "segment_length", "elements"),
    "softness": ("time_constant", "stiffness", "compliance", "stiction_tolerance", "contact_slop", "error_rate", "hertz"),
    "solver's effort": ("iterations", "sub_steps", "solver_iterations", "substeps", "tolerance"),
    "string's mass": ("mass_fraction", "bead_mass_ratio"),
}
"""Kind of a ladder -> endings of the names of the settings that it refines."""
OTHER = "other"
COLUMNS, WIDTH, ROW_HEIGHT, LEGEND_HEIGHT = 3, 4.8, 1.25, 0.8
"""Panels beside each other, and sizes [in]: at this width the letters can be read on a phone."""
ERRORS = (1e-4, 1e3)
"""Limits of the errors' axis [mm]; smaller errors are drawn on its lower edge."""


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
A halting time converges only if it does along every ladder, apart from one whose setting another ladder refines as far or
further. Otherwise the table has the scatter of the finest rungs of its
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


def advice(study: EngineStudy) -> str:
    """Return the ten lines as a Markdown list."""
    variants = [v for v in study.convergence.variants if v.engine != "reference"]
    own_points = {p.variant: p for p in study.pareto if not p.where}
    # What never halts has no law that grips, whoever supplies it: such a variant is no choice for anybody
    choices = [v for v in variants if v.variant != "defaults" and halting_verdict(v) != "never halts"]
    contact = [v for v in choices if supplied_by_engine(v)]
    fed = [v for v in choices if not supplied_by_engine(v)]
    lines = [
        "**Ask first who supplies the law**: where an adapter feeds the capstan law in, a run tests everything but that law.",
        f"**If the law may be fed in**, take {_best(fed, own_points)}.",
        f"**If it must be the engine's own**, take {_best(contact, own_points)}.",
        _cost(contact, fed, own_points),
        _defaults(variants),
        _first_defaults(variants),
        _model(variants),
        _halting(contact, fed),
        _spread(contact),
        _ladders(contact),
    ]
    return "".join(f"{k}. {line}\n" for k, line in enumerate(lines, 1))


def split_of(v: VariantStudy, quantity: str) -> ErrorSplit | None:
    """Return the split of one quantity's error; None if the variant has no value of it."""
    return next((s for s in v.splits if s.quantity == quantity), None)


def _mm(metres: float) -> str:
    return f"{number(metres, 1e3, 2)} mm"


def _best(variants: list[VariantStudy], own_points: dict[str, Point]) -> str:
    """Name the variant with the smallest error at its own settings, and the cheapest within ten times of that."""
    errors = {v.label: v.own.rms[MARK] for v in variants if v.own.ok}
    known = {name: rms for name, rms in errors.items() if rms is not None and name in own_points}
    best = min(known, key=lambda name: known[name])
    near = min((name for name, rms in known.items() if rms <= 10 * known[best]), key=lambda name: own_points[name].cpu)

    def words(name: str) -> str:
        return f"`{name}`: {_mm(known[name])} to 0.7 s for {number(own_points[name].cpu, digits=2)} CPU s per simulated second"

    return words(best) if near == best else f"{words(best)}; the cheapest nearly as good is {words(near)}"


def _cost(contact: list[VariantStudy], fed: list[VariantStudy], own_points: dict[str, Point]) -> str:
    costs = [[own_points[v.label].cpu for v in group if v.label in own_points] for group in (contact, fed)]
    of_contact, of_fed = (f"{number(min(each), digits=2)} to {number(max(each), digits=2)}" for each in costs)
    return f"**Reckon with an own law's cost**: {of_contact} CPU s per simulated second, against {of_fed} with a law fed in."


def _defaults(variants: list[VariantStudy]) -> str:
    parts = []
    for v in variants:
        if v.variant == "defaults":
            rms = v.own.rms[MARK]
            parts.append(f"`{v.engine}` is {_mm(rms)} off at 0.7 s" if v.own.ok and rms else f"`{v.engine}` loses the string")
    return f"**Never run an engine as it comes**: {', '.join(parts)}."


def _first_defaults(variants: list[VariantStudy]) -> str:
    """Name for each engine the defaults with which alone a run fails; without one, that which moves the path to 0.35 s most."""
    named = []
    for engine in dict.fromkeys(v.engine for v in variants):
        # Where a run ends with the adapter's own settings, no default is what ends it
        defaults = [d for v in variants if v.engine == engine and (v.own.ok or v.variant == "defaults") for d in v.defaults]
        failing = dict.fromkeys(d.what for d in defaults if not d.run.ok)
        moves = {d.what: moved for d in defaults if (moved := d.change[EARLY]) is not None}
        worst = list(failing) or sorted(moves, key=lambda what: moves[what])[-1:]
        if worst:
            named.append(f"{engine} {', '.join(f'`{what}`' for what in worst)}")
    return f"**Change these defaults first**: {'; '.join(named)}."


def _model(variants: list[VariantStudy]) -> str:
    names = []
    for v in variants:
        split = split_of(v, MARK)
        if split is not None and split.model is not None and ErrorCause.MODEL in split.causes:
            names.append(f"`{v.label}` ({_mm(split.model)})")
    return f"**Do not refine where the model differs**: the error stays in the limit for {', '.join(names)}."


def _halting(contact: list[VariantStudy], fed: list[VariantStudy]) -> str:
    sure = [f"`{v.label}`" for v in fed if halting_verdict(v).startswith("yes")]
    scatters = []
    for v in contact:
        verdicts = [verdict for ladder in v.ladders for verdict in ladder.verdicts if verdict.quantity == HALT]
        if v.own.halting_time is not None:
            scatters += [max(known)] if (known := [verdict.scatter for verdict in verdicts if verdict.scatter]) else []
    return (
        f"**Do not read a halting time from one run of a chain**: it converges for {', '.join(sure)} only; the finest rungs of"
        f" variants with a law of their own scatter by {number(min(scatters), 1e3, 2)} to {number(max(scatters), 1e3, 2)} ms."
    )


def _spread(contact: list[VariantStudy]) -> str:
    spreads = {v.label: spread for v in contact if (spread := v.spread[MARK])}
    least, most = min(spreads, key=lambda k: spreads[k]), max(spreads, key=lambda k: spreads[k])
    return (
        "**Repeat a run from a start changed by 0.01 deg**, before you believe its digits: the error to 0.7 s spreads"
        f" by {_mm(spreads[least])} (`{least}`) to {_mm(spreads[most])} (`{most}`)."
    )


def _ladders(contact: list[VariantStudy]) -> str:
    ends = []
    for v in contact:
        for ladder in v.ladders:
            known = [rung.run.rms[MARK] for rung in ladder.rungs if rung.run.ok and rung.run.rms[MARK] is not None]
            own = v.own.rms[MARK]
            if known and own is not None:
                ends.append(known[-1] > own)
    return (
        f"**Refine all settings of a chain, never one**: at the end of {sum(ends)} of {len(ends)} ladders of such variants the"
        " path is farther from the reference than at the variant's own settings, whose errors partly cancel."
    )


def kind_of_ladder(setting: str) -> str:
    """Return the kind of the ladder that refines ``setting``."""
    return next((name for name, endings in KINDS.items() if setting.endswith(endings)), OTHER)


def ladder_line(v: VariantStudy, ladder: LadderStudy) -> tuple[list[float], list[float]]:
    """Return refinement against the variant's own setting, and error [mm], of each rung that has one."""
    sizes = refinement_sizes([rung.value for rung in ladder.rungs])
    own = next((h for h, rung in zip(sizes, ladder.rungs, strict=True) if rung.run.key == v.own.key), None)
    if own is None and ladder.own:
        rises = ladder.rungs[0].value < ladder.rungs[-1].value
        own = 1 / ladder.own if rises else ladder.own
    refinement, errors = [], []
    for h, rung in zip(sizes, ladder.rungs, strict=True):
        rms = rung.run.rms[MARK]
        if rms is not None and rung.run.ok and h > 0:
            refinement.append(float((own or sizes[0]) / h))
            errors.append(max(1e3 * rms, ERRORS[0]))
    return refinement, errors


def ladders_figure(result: ConvergenceResult) -> Figure:
    """Draw a panel for each variant that has a ladder with two rungs to 0.7 s; the reference is left out."""
    panels = {}
    for v in result.variants:
        lines = [(kind_of_ladder(ladder.setting), *ladder_line(v, ladder)) for ladder in v.ladders]
        lines = [line for line in lines if len(line[1]) > 1]
        if lines and v.engine != "reference":
            panels[v.label] = lines
    rows = math.ceil(len(panels) / COLUMNS)
    picture = Figure(figsize=(WIDTH, rows * ROW_HEIGHT + LEGEND_HEIGHT), dpi=180, layout="constrained")
    FigureCanvasAgg(picture)
    grid = picture.subplots(rows, COLUMNS, sharex=True, sharey=True, squeeze=False).ravel()
    look = {name: (COLOURS[k], MARKERS[k]) for k, name in enumerate((*KINDS, OTHER))}
    used = {name for lines in panels.values() for name, _, _ in lines}
    for axes, (label, lines) in zip(grid, panels.items(), strict=False):
        for name, x, y in lines:
            colour, marker = look[name]
            axes.plot(x, y, color=colour, marker=marker, ms=2.8, lw=1.0, clip_on=False, zorder=3)
        axes.axvline(1.0, color="0.6", lw=0.7)
        axes.set_title(label, fontsize=7.5, pad=2.5)
        axes.set(xscale="log", yscale="log", ylim=ERRORS)
        axes.set_yticks([1e-4, 1e-2, 1, 1e2], ["1e-4", "0.01", "1", "100"])
        axes.set_xticks([0.1, 1, 10], ["1/10", "1", "10"])
        axes.minorticks_off()
        axes.tick_params(labelsize=7, length=2)
        axes.grid(True, color="0.92", lw=0.6)
    for axes in grid[len(panels) :]:
        axes.set_visible(False)
    for axes in grid[len(panels) - COLUMNS : len(panels)]:
        # Above a hidden panel, too
        axes.tick_params(labelbottom=True)
    picture.supxlabel("refinement: own setting = 1, finer to the right", fontsize=8)
    picture.supylabel("RMS to 0.7 s against the reference [mm]", fontsize=8)
    handles = [Line2D([], [], color=c, marker=m, ms=4, label=name) for name, (c, m) in look.items() if name in used]
    picture.legend(handles=handles, loc="outside upper center", ncols=3, frameon=False, fontsize=8)
    return picture


def pareto_figure(timed_points: Sequence[Point]) -> Figure:
    """Draw error against time, log-log, with the Pareto fronts of all engines and of those that supply winding and friction."""
    picture, (axes,) = make_figure(8.4, 6.8)
    look = styles(p.variant for p in timed_points)
    for variant in dict.fromkeys(p.variant for p in timed_points):
        mine = [p for p in timed_points if p.variant == variant]
        style = look[variant]
        fill = style.colour if mine[0].contact else "white"
        xy = np.array([(p.cpu, 1e3 * p.rms) for p in mine]).T
        axes.plot(*xy, ls="none", marker=style.marker, ms=5.5, color=style.colour, mfc=fill, label=variant)
    for chosen, line, name in (
        (front(timed_points), "-", "no engine beats these"),
        (front(p for p in timed_points if p.contact), "--", "nor these, law its own"),
    ):
        axes.plot([p.cpu for p in chosen], [1e3 * p.rms for p in chosen], line, color="black", lw=1.0, zorder=1, label=name)
    axes.axvline(TARGET, color=GREY, lw=0.9, dashes=(1, 2), label=f"target {TARGET:g} s per s")
    axes.set(
        xscale="log", yscale="log", xlabel="CPU seconds per simulated second", ylabel="RMS to 0.7 s against the reference [mm]"
    )
    axes.set_title("Speed against accuracy; open marks: the adapter feeds a law in")
    legend_below(picture)
    return picture
