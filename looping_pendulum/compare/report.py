"""Renders the report in Markdown from the result object alone: the verdict first, then the causes, then the details.

`report.md.jinja` says what stands where; here is what its tables say.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any

from jinja2 import Environment
from markupsafe import Markup

from looping_pendulum.compare.baseline import ResultChanges
from looping_pendulum.compare.deviation import events_to_show
from looping_pendulum.compare.metrics import RMS_END_TIMES
from looping_pendulum.compare.result import ComparisonResult, EngineResult, MeasuredRow, ToleranceOutcome, ToleranceResult
from looping_pendulum.compare.trial import RESIDUAL_UNITS, RunResidual, TrackComparison
from looping_pendulum.pages import report as pages
from looping_pendulum.pages.chart import Chart
from looping_pendulum.pages.figures import MAX_LINE_POINTS
from looping_pendulum.pages.markdown import code, escaped
from looping_pendulum.pages.numbers import GAP, fixed, number, quantity, signed
from looping_pendulum.pages.report import glossary
from looping_pendulum.pages.templates import markdown_templates, sections
from looping_pendulum.runs.events import FIRST_REST_RESOLUTION, RESOLUTION, Landmarks, quantity_label
from looping_pendulum.runs.trajectory import Supplier, supplies_as_rows
from looping_pendulum.scenarios.metrics import METRICS, metric_called

FIGURES = "## Figures"
"""Heading of the section before and after which a page has the others."""
# Not "no" alone, with which "not run" and "no limits declared" begin as well
FAILING_PREFIXES = ("no:", "no (")
"""Beginnings of the table cells that say that an engine is outside tolerance; the report shows them in bold."""
AXES = {"light_x": "right", "heavy_x": "right", "light_y": "up", "heavy_y": "up", "wrap_angle": "ahead"}
"""Channel -> direction in which it grows."""
# Two decimals more than the paper prints for times and lengths, so that smaller differences show, too
DECIMALS = {"s": 4, "m": 4, "rad": 3}
PAPER_COLUMN = "paper's numerical"
"""Column of the paper's own simulation, which only the paper's trials have."""
HALT_AGREEMENT = 5e-4
"""Largest difference of two halting times that are called equal [s]: half a sample interval."""


def comparison_markdown(
    result: ComparisonResult, figures: Mapping[str, str] | None = None, changes: ResultChanges | None = None
) -> str:
    """Return the report.

    Parameters
    ----------
    figures
        Path of a figure, from the report's folder -> its caption.
    changes
        Changes since a baseline, if there is one.
    """
    return "\n".join(_sections(result, figures, changes))


def render_page(
    result: ComparisonResult, charts: Sequence[Chart], changes: ResultChanges | None = None, running: Sequence[str] = ()
) -> str:
    """Return the report as a page with the same sections; ``running``: labels of engines that are still running."""
    head, *others = _sections(result, changes=changes)
    if running:
        head += f"\n**Still running:** {escaped(', '.join(running))}. This page is about the others; reload it for these.\n"
    place = _place_of_figures(others)
    return pages.report_page(
        f"{result.title}: engines against the reference",
        [head, *others[:place]],
        charts,
        others[place + 1 : -1],  # without the words, of which the page has a list of its own
        glossary("comparison"),
        f"Lines join at most {MAX_LINE_POINTS} samples of a run; every number on this page comes from all of them.",
    )


def before_figures(result: ComparisonResult) -> list[str]:
    """Return the sections above the figures, the title first."""
    all_sections = _sections(result)
    return all_sections[: _place_of_figures(all_sections)]


def _place_of_figures(sections: Sequence[str]) -> int:
    return next(i for i, section in enumerate(sections) if section.startswith(FIGURES))


def _sections(
    result: ComparisonResult, figures: Mapping[str, str] | None = None, changes: ResultChanges | None = None
) -> list[str]:
    """Return the sections of the report, each with its heading first."""
    head, verdict = verdict_rows(result)
    parameters = dict(sorted(result.parameters.as_dict().items()))
    coefficients = dict(sorted(parameters.pop("coefficients").items()))
    # There are dozens of effects, and a scenario has a few of them
    acting = {name: value for name, value in coefficients.items() if value != 0}
    return sections(
        _templates(),
        "report.md.jinja",
        result=result,
        changes=changes,
        figures=figures or {},
        failures=_failures(result),
        feared=_feared(result),
        verdict=(head, [[row[0], _bold_failure(row[1]), *row[2:]] for row in verdict]),
        residuals=residual_rows(result),
        measured_events=measured_rows(result),
        has_paper_values=_has_paper_values(result),
        reference_events=events_to_show(result.reference.events),
        reference_end=_reference_end(result),
        halting=_halting_runs(result),
        check_against_events=_check_against_events(result),
        further_metrics=["string_stretch", *_others("detail")],
        events=event_rows(result),
        runs=[("reference", result.reference.provenance), *((name(e), e.provenance) for e in result.engines)],
        parameters=parameters | acting,
        some_effects_are_absent=len(acting) < len(coefficients),
        glossary=glossary("comparison"),
    )


@cache
def _templates() -> Environment:
    environment = markdown_templates("looping_pendulum.compare")
    environment.filters |= {
        "beyond": lambda e, threshold: fixed({d.threshold: d.time for d in e.departures}.get(threshold), 3),
        "cell": metric_cell,
        "column": lambda metric: METRICS[metric].column,
        "name": name,
        "quoted": _quoted,
        "settings": _settings,
        "supplies": supplies_as_rows,
        "value_and_limit": value_and_limit,
    }
    environment.globals |= {"RESOLUTION": RESOLUTION, "FIRST_REST_RESOLUTION": FIRST_REST_RESOLUTION}
    return environment


def _bold_failure(cell: str) -> Markup:
    """Return a cell of the verdict's table with a "no" in bold; a terminal shows it as it is."""
    text = escaped(cell)
    return Markup(f"**no**{text.removeprefix('no')}") if cell.startswith(FAILING_PREFIXES) else text


def _reference_end(result: ComparisonResult) -> str:
    """Say how the reference ends if it does not halt."""
    if result.reference.landmarks.halting_time is not None:
        return ""
    ends = any(each in ("light_reaches_rod", "heavy_reaches_rod", "unwrapped") for each, _ in result.reference.events)
    return "where it ends without a halt" if ends else "never halts"


def name(engine: EngineResult) -> str:
    """Return label and profile, for example "pymunk:chain, quick"."""
    return f"{engine.label}, {engine.profile}" if engine.profile else engine.label


def verdict_rows(result: ComparisonResult) -> tuple[list[str], list[list[str]]]:
    """Return header and rows of the verdict table as plain text, the reference first, for Markdown and for a terminal."""
    vertical = any(e.metrics.get("acceleration_error") is not None for e in result.engines)
    errors = ["drop_error", *(["acceleration_error"] if vertical else []), *_others("verdict")]
    head = ["engine", "within tolerance?", "helped by", *(METRICS[metric].column for metric in RMS_END_TIMES)]
    head += ["halting time [s]", *(METRICS[metric].column for metric in ("halting_time_error", *errors)), "CPU time [s per s]"]
    reference = result.reference.sampled
    before, after = [GAP] * (2 + len(RMS_END_TIMES)), [GAP] * (2 + len(errors))
    rows = [["reference", *before, fixed(reference.halting_time, 4), *after]]
    for engine, wall in zip(result.engines, result.clock.wall_times, strict=True):
        cells = [*(metric_cell(engine, metric) for metric in RMS_END_TIMES), fixed(engine.landmarks.halting_time, 4)]
        cells += ["not comparable" if engine.not_comparable else metric_cell(engine, "halting_time_error")]
        cells += [metric_cell(engine, metric) for metric in errors]
        cells.append(number(wall.cpu_per_simulated_second, digits=2))
        rows.append([name(engine), _within(result, engine), _helped_by(engine), *cells])
    return head, rows


def _helped_by(engine: EngineResult) -> str:
    """Say which laws the adapter supplies in the engine's place, and what it takes from the reference's own run."""
    supplies = supplies_as_rows(engine.provenance.supplies)
    laws = [what for what, by, _ in supplies if by == Supplier.ADAPTER.value and what != "drag"]
    helpers = {"the adapter": laws, "the reference": engine.from_reference}
    return "; ".join(f"{who}: {', '.join(what)}" for who, what in helpers.items() if what) or GAP


def metric_cell(engine: EngineResult, metric: str) -> str:
    """Return the value of ``engine``'s metric as a table shows it; a gap where the result is from before the metric."""
    return METRICS[metric].cell(engine.metrics.get(metric))


def _others(table: str) -> list[str]:
    """Return the metrics that have a column at the end of a table of the report: those of other packages."""
    return [each.name for each in METRICS.values() if each.table == table]


def _failures(result: ComparisonResult) -> list[str]:
    """Return what is outside tolerance, each in a few words."""
    failures = [f"{t.engine} ({t.metric}: {t.outcome.value})" for t in result.tolerances if not t.outcome.good]
    return failures + [f"{e.label} ({e.status_sentence})" for e in result.engines if result.broke_off(e)]


def _feared(result: ComparisonResult) -> list[str]:
    """Return who fails as expected, which is no praise, and in how many limits."""
    counts = [(e, result.judged(e)) for e in result.engines]
    return [f"{e.label} ({count} of {len(judged)} limits)" for e, judged in counts if (count := _expected_failures(judged))]


def _within(result: ComparisonResult, engine: EngineResult) -> str:
    judged = result.judged(engine)
    if not engine.available:
        return f"not run: {engine.status_sentence}"
    bad = sum(not t.outcome.good for t in judged)
    expected = _expected_failures(judged)
    note = f"; {expected} expected failure{'s' if expected > 1 else ''}" if expected else ""
    if result.broke_off(engine):
        return f"no: {engine.status_sentence}{note}"
    if bad:
        return f"no ({bad} of {len(judged)} limits){note}"
    if not judged:
        return "no limits declared"
    return f"yes{note}" if expected < len(judged) else f"as expected, no{note}"


def _expected_failures(judged: Sequence[ToleranceResult]) -> int:
    """Return how many limits fail as expected."""
    return sum(t.outcome is ToleranceOutcome.EXPECTED_FAILURE for t in judged)


def _quoted(message: str) -> Markup:
    """Return the last line of the engine's message, in which a traceback says most, as code: it may hold any characters."""
    lines = message.strip().splitlines()
    return Markup(f"`{code(lines[-1])[:200]}`") if lines else Markup("")


def value_and_limit(t: ToleranceResult) -> tuple[str, str]:
    """Return value and limit with their unit, for example ("0.41 mm", "at most 0.6 mm")."""
    metric = metric_called(t.metric)
    return metric.quantity(t.value), f"{metric.limit_words} {metric.quantity(t.limit)}"


def _setting(value: Any) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _settings(values: Mapping[str, Any]) -> str:
    return ", ".join(f"{key} {_setting(value)}" for key, value in values.items()) or GAP


def residual_rows(result: ComparisonResult) -> tuple[list[str], list[list[str]]]:
    """Return header and rows of the residuals as plain text, the reference first; empty without tracked points."""
    if result.trial is None or not result.trial.tracks:
        return [], []
    tracks = result.trial.tracks
    head = ["run"]
    for comparison in tracks:
        name, unit = comparison.track.name, RESIDUAL_UNITS[comparison.track.unit].name
        means = ", ".join(AXES[channel] for channel in comparison.track.channels)
        head += [f"{name}: RMS residual [{unit}]", f"largest [{unit}] (at [s])", f"mean, {means} [{unit}]", "points"]
    labels = ["reference", *(result.short_name(e) for e in result.engines)]
    rows = []
    for i, label in enumerate(labels):
        row = [label]
        for comparison in tracks:
            row += _residual_cells(comparison, comparison.reference if i == 0 else comparison.engines[i - 1])
        rows.append(row)
    return head, rows


def short_residual_rows(result: ComparisonResult) -> tuple[list[str], list[list[str]]]:
    """Return the RMS columns of `residual_rows` alone, which fit a terminal."""
    head, rows = residual_rows(result)
    columns = [0, *(i for i, cell in enumerate(head) if "RMS" in cell)]
    return [head[i] for i in columns if head], [[row[i] for i in columns] for row in rows]


def _residual_cells(comparison: TrackComparison, residual: RunResidual) -> list[str]:
    unit, total = RESIDUAL_UNITS[comparison.track.unit], len(comparison.track.t)
    points = str(total) if residual.compared == total else f"{residual.compared} of {total}"
    if residual.rms is None:
        return [GAP, GAP, GAP, points]
    scale = unit.per_si_unit
    means = ", ".join(signed(m, scale, 2) for m in residual.mean)
    largest = f"{number(residual.largest, scale)} ({fixed(residual.largest_at, 3)})"
    return [number(residual.rms, scale), largest, means, points]


def measured_rows(result: ComparisonResult) -> tuple[list[str], list[list[str]]]:
    """Return header and rows of the measured events beside those of the runs; the paper's own only where it has some."""
    paper = [PAPER_COLUMN] if _has_paper_values(result) else []
    head = ["quantity", "unit", "measured", *paper, "reference", *(result.short_name(e) for e in result.engines)]
    rows = [*map(_measured_row, result.measured), _rms_row(result)]
    return head, rows if paper else [[*row[:3], *row[4:]] for row in rows]


def _has_paper_values(result: ComparisonResult) -> bool:
    return any(row.paper_numerical is not None for row in result.measured)


def _measured_row(row: MeasuredRow) -> list[str]:
    base = row.paper_numerical if row.measured is None else row.measured
    # As precisely as it is printed: the paper's values to two decimals, others to the second digit of their standard error
    decimals = 2 if row.sigma is None else min(max(1 - math.floor(math.log10(row.sigma)), 0), 6)
    cells = [quantity_label(row.quantity, row.index), row.unit, fixed(row.measured, decimals)]
    if row.measured is None:
        cells.append(number(row.paper_numerical, digits=4))  # Shown as printed: the paper gives these values more digits.
    else:
        cells.append(_with_difference(row.paper_numerical, base, 2))
    return cells + [_with_difference(v, base, DECIMALS.get(row.unit, 4)) for v in (row.reference, *row.engines)]


def _with_difference(value: float | None, base: float | None, decimals: int) -> str:
    if value is None or base is None:
        return fixed(value, decimals)
    return f"{value:.{decimals}f} ({round((value - base) * 1e3):+d})"


def _rms_row(result: ComparisonResult) -> list[str]:
    """Return, per column, the root mean square difference from the measured times, over the times that the column has."""
    rows = [r for r in result.measured if r.unit == "s" and r.measured is not None]
    columns = [[r.paper_numerical for r in rows], [r.reference for r in rows]]
    columns += [[r.engines[i] for r in rows] for i in range(len(result.engines))]
    cells = []
    for column in columns:
        differences = [v - r.measured for v, r in zip(column, rows, strict=True) if v is not None and r.measured is not None]
        if differences:
            rms = math.sqrt(sum(d * d for d in differences) / len(differences))
            cells.append(f"{rms * 1e3:.1f} ({len(differences)} of {len(rows)})")
        else:
            cells.append(GAP)
    return ["RMS difference of the times", "ms", GAP, *cells]


def event_rows(result: ComparisonResult) -> tuple[list[str], list[list[str]]]:
    """Return header and rows of the times of stops, slip onsets and extrema of the reference and each engine."""
    reference = result.reference.sampled
    landmarks = [reference, *(e.landmarks for e in result.engines)]
    ends = [e.end_time or 0.0 for e in result.engines]
    rows = _series("stop", [[s.time for s in m.stops] for m in landmarks], ends)
    rows += _series("slip onset", [list(m.slip_onsets) for m in landmarks], ends)
    rows += _series("x1 extremum", [[e.time for e in m.x1_extrema] for m in landmarks], ends)
    rows += _series("y1 extremum", [[e.time for e in m.y1_extrema] for m in landmarks], ends)
    if reference.light_reaches_rod is not None:
        reached = [[] if m.light_reaches_rod is None else [m.light_reaches_rod] for m in landmarks]
        rows += _series("light mass reaches rod", reached, ends)
    return ["event", "reference [s]", *(f"{result.short_name(e)} [ms later]" for e in result.engines)], rows


def _series(what: str, columns: list[list[float]], ends: list[float]) -> list[list[str]]:
    """Return the rows of one kind of event: times of the reference and of each engine, whose runs end at ``ends`` [s]."""
    rows = []
    for i in range(max(len(c) for c in columns)):
        values = [c[i] if i < len(c) else None for c in columns]
        reference = values[0]
        cells = [_delay_cell(v, reference, end) for v, end in zip(values[1:], ends, strict=True)]
        rows.append([f"{what} {i + 1}" if max(len(c) for c in columns) > 1 else what, fixed(reference, 4), *cells])
    return rows


def _delay_cell(value: float | None, reference: float | None, end: float) -> str:
    if value is None:
        return "after its end" if reference is not None and reference > end else GAP
    return f"at {value:.4f} s" if reference is None else signed(value - reference, 1e3)


def _halting_runs(result: ComparisonResult) -> list[tuple[str, Landmarks]]:
    """Return the runs that have halting times, each with its landmarks; none where no run halts."""
    runs = [("reference", result.reference.sampled), *((name(e), e.landmarks) for e in result.engines)]
    # A run with hardly any samples has no landmarks at all
    runs = [(label, landmarks) for label, landmarks in runs if landmarks.halting_times]
    return runs if any(each.time is not None for _, landmarks in runs for each in landmarks.halting_times) else []


def _check_against_events(result: ComparisonResult) -> str:
    """Return how far the reference's halting time from samples is from that of its own events: the detector's error here."""
    exact, sampled = result.reference.landmarks.halting_time, result.reference.sampled.halting_time
    if exact is None and sampled is None:
        return "The reference's exact events contain no halt either."
    if exact is not None and sampled is not None and abs(sampled - exact) <= HALT_AGREEMENT:
        error = quantity(abs(sampled - exact), "s")
        return f"By its exact events the reference halts at {exact:.6f} s, so reading samples has an error of {error} here."
    exact_words = "does not halt" if exact is None else f"halts at {exact:.4f} s"
    return f"By its exact events the reference {exact_words}: until then it slides by less than reading samples can resolve."
