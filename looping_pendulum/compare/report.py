"""Renders the report in Markdown from the result object alone: the verdict first, then the causes, then the details."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from looping_pendulum.compare import baseline
from looping_pendulum.compare.result import (
    ComparisonResult,
    EngineResult,
    MeasuredRow,
    ToleranceOutcome,
    ToleranceResult,
)
from looping_pendulum.compare.stories import events_to_show
from looping_pendulum.compare.trial import RESIDUAL_UNITS, RunResidual, TrackComparison
from looping_pendulum.pages import report as pages
from looping_pendulum.pages.chart import Chart
from looping_pendulum.pages.figures import MAX_LINE_POINTS, on_page
from looping_pendulum.pages.markdown import plain, table
from looping_pendulum.pages.numbers import GAP, fixed, number, quantity, signed
from looping_pendulum.pages.report import glossary
from looping_pendulum.runs.events import FIRST_REST_RESOLUTION, RESOLUTION, quantity_label
from looping_pendulum.runs.trajectory import Supplier, supplies_as_rows
from looping_pendulum.scenarios.metrics import METRICS, RMS_END_TIMES, metric_called

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
HALT_DEFINITION = (
    f"A string halts when it stops sliding and does not slide by more than {quantity(RESOLUTION, 'm')} again until the "
    "light mass reaches the rod, or the run ends. The time is read from samples, in the same way for the reference and for "
    "every engine: from the string's slip over the rod where the engine reports it, otherwise from the heavy mass's "
    "height. The table gives it for several resolutions. Its uncertainty is the largest distance of these times from that to "
    f"within {quantity(RESOLUTION, 'm')}; *at least*: to within the finest, the string does not come to rest in this run. The "
    "last columns give the rebound: how far and "
    f"how fast the string still moves after the time from which on it stays within {quantity(FIRST_REST_RESOLUTION, 'm')}."
)
HELP_NOTE = (
    "*Helped by*: laws that the adapter supplies, for which the engine's run is no evidence, and what the adapter takes from "
    "the reference's own run. Drag, which every adapter of this package supplies, is left out; smaller corrections stand under "
    "*Who supplies the physics*.\n"
)


def comparison_markdown(
    result: ComparisonResult, figures: Mapping[str, str] | None = None, changes: baseline.ResultChanges | None = None
) -> str:
    """Return the report.

    Parameters
    ----------
    figures
        Path of a figure, from the report's folder -> its caption.
    changes
        Changes since a baseline, if there is one.
    """
    pictures = [f"![{caption}]({path})\n\n*{caption}*\n" for path, caption in (figures or {}).items()]
    none = "There are none, because this report was made without the trajectories.\n"
    figures_section = "## Figures\n\n" + ("\n".join(pictures) or none)
    words = "## Words\n\n" + "".join(f"- **{word}**: {meaning}\n" for word, meaning in glossary("comparison").items())
    return "\n".join([*before_figures(result, changes), figures_section, *after_figures(result), words])


def render_page(
    result: ComparisonResult,
    charts: Sequence[Chart],
    changes: baseline.ResultChanges | None = None,
    running: Sequence[str] = (),
) -> str:
    """Return the report as a page with the same sections; ``running``: labels of engines that are still running."""
    head, *sections = before_figures(result, changes)
    if running:
        head += f"\n**Still running:** {', '.join(running)}. This page is about the others; reload it for these.\n"
    return pages.report_page(
        f"{result.title}: engines against the reference",
        [head, *sections],
        [on_page(chart) for chart in charts],
        after_figures(result),
        glossary("comparison"),
        f"Lines join at most {MAX_LINE_POINTS} samples of a run; every number on this page comes from all of them.",
    )


def before_figures(result: ComparisonResult, changes: baseline.ResultChanges | None = None) -> list[str]:
    """Return the sections above the figures, the title first."""
    return [
        f"# {result.title}\n\n{result.description.strip()}\n",
        "## Verdict\n\n" + _verdict(result),
        *trial_section(result),
        "## Where, when and why\n\n" + _stories(result),
        *([] if changes is None else ["## Changes since the baseline\n\n" + baseline.changes_markdown(changes)]),
    ]


def after_figures(result: ComparisonResult) -> list[str]:
    """Return the sections below the figures, except the glossary."""
    sections = []
    if result.trial is None and (result.measured_source or result.measured):
        sections.append("## Against the measured events\n\n" + measured_events_table(result))
    return [
        *sections,
        *halting_section(result),
        "## Detail\n\n" + _detail(result),
        "## Who supplies the physics\n\n" + _supplies(result),
        "## Tolerances\n\n" + _tolerances(result),
        "## Provenance\n\n" + _provenance(result),
        "## Times\n\n" + _times(result),
    ]


def name(engine: EngineResult) -> str:
    """Return label and profile, for example "pymunk:chain, quick"."""
    return f"{engine.label}, {engine.profile}" if engine.profile else engine.label


def verdict_rows(result: ComparisonResult) -> tuple[list[str], list[list[str]]]:
    """Return header and rows of the verdict table as plain text, the reference first, for Markdown and for a terminal."""
    vertical = any(e.metrics.get("acceleration_error") is not None for e in result.engines)
    errors = ["drop_error", *(["acceleration_error"] if vertical else [])]
    head = ["engine", "within tolerance?", "helped by", *(METRICS[metric].column for metric in RMS_END_TIMES)]
    head += ["halting time [s]", *(METRICS[metric].column for metric in ("halting_time_error", *errors)), "CPU time [s per s]"]
    reference = result.reference.sampled
    blank = [GAP] * (3 + vertical)
    rows = [["reference", GAP, GAP, *blank[:3], fixed(reference.halting_time, 4), GAP, GAP, *blank[3:], GAP]]
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
    """Return the value of ``engine``'s metric as a table shows it."""
    return METRICS[metric].cell(engine.metrics[metric])


def _verdict(result: ComparisonResult) -> str:
    head, rows = verdict_rows(result)
    for row in rows:
        # Here and not in `verdict_rows`, whose rows a terminal shows, too
        if row[1].startswith(FAILING_PREFIXES):
            row[1] = f"**no**{row[1].removeprefix('no')}"
    return f"{_verdict_sentence(result)}\n\n{table(head, rows, left=3)}\n{HELP_NOTE}"


def _verdict_sentence(result: ComparisonResult) -> str:
    failures = [f"{t.engine} ({t.metric}: {t.outcome.value})" for t in result.tolerances if not t.outcome.good]
    failures += [f"{e.label} ({e.status_sentence})" for e in result.engines if result.broke_off(e)]
    not_run = [e.label for e in result.engines if not e.available]
    if failures:
        text = f"**Outside tolerance:** {'; '.join(failures)}."
    elif not result.tolerances:
        text = "**No limits are declared** for these engines and this profile, so there is no verdict on the numbers."
    else:
        text = _expected_sentence(result)
    return text + (f" Not run: {', '.join(not_run)}." if not_run else "")


def _expected_sentence(result: ComparisonResult) -> str:
    """Say that nothing unexpected happened, and who fails as expected, which is no praise."""
    feared = []
    for e in result.engines:
        judged = result.judged(e)
        count = _expected_failures(judged)
        if count:
            feared.append(f"{e.label} ({count} of {len(judged)} limits)")
    if not feared:
        return "**Within tolerance.**"
    return f"**No unexpected result**, but these fail as expected: {'; '.join(feared)}. All other limits are kept."


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


def _stories(result: ComparisonResult) -> str:
    halt = result.reference.landmarks.halting_time
    events = "".join(f", {n.replace('_', ' ')} at {t:.4f} s" for n, t in events_to_show(result.reference.events))
    ends = any(each in ("light_reaches_rod", "heavy_reaches_rod", "unwrapped") for each, _ in result.reference.events)
    end = "" if halt is not None else ", where it ends without a halt" if ends else ", never halts"
    reference = f"- **reference**: released at 0 s{events}{end}.\n"
    lines = []
    for e in result.engines:
        outside = "; ".join(e.outside_range)
        warning = f" **Its accuracy was not measured for such a scenario:** {outside}." if outside else ""
        message = "" if e.message in e.story else " " + _quoted(e.message)
        lines.append(f"- **{name(e)}**: {e.story}{warning}{message}\n")
    return reference + "".join(lines)


def _quoted(message: str) -> str:
    """Return the last line of the engine's message as code, since it may hold any characters."""
    lines = message.strip().splitlines()
    # A backtick would end the code, and a traceback says most in its last line
    return "`" + lines[-1].replace("`", "'")[:200] + "`" if lines else ""


def _detail(result: ComparisonResult) -> str:
    head = ["engine", METRICS["tube_fraction"].column, "leaves tube [s]", "beyond 1 mm at [s]", "beyond 10 mm at [s]"]
    head += ["growth rate [1/s]", METRICS["rms_halt"].column, "drop at halt [m]"]
    head += ["wrap angle at halt [rad]", f"error [{METRICS['wrap_angle_error'].shown_in.name}]"]
    head += ["free length at halt [m]", f"error [{METRICS['free_length_error'].shown_in.name}]"]
    head += [METRICS["string_stretch"].column]
    reference = result.reference.sampled
    first = ["reference", *[GAP] * 6, fixed(reference.drop_at_halt, 4), fixed(reference.wrap_angle_at_halt, 4), GAP]
    rows = [[*first, fixed(reference.free_length_at_halt, 4), GAP, GAP]]
    for e in result.engines:
        crossings = {d.threshold: d.time for d in e.departures}
        row = [name(e), metric_cell(e, "tube_fraction"), fixed(e.tube.first_exit, 3)]
        # The literals of `DEPARTURE_THRESHOLDS`, so that they are exact keys
        row += [fixed(crossings.get(threshold), 3) for threshold in (1e-3, 1e-2)]
        row += [number(e.growth_rate, digits=2), metric_cell(e, "rms_halt"), fixed(e.landmarks.drop_at_halt, 4)]
        row += [fixed(e.landmarks.wrap_angle_at_halt, 4), metric_cell(e, "wrap_angle_error")]
        row += [fixed(e.landmarks.free_length_at_halt, 4), metric_cell(e, "free_length_error")]
        rows.append([*row, metric_cell(e, "string_stretch")])
    width = next((f"{e.tube.half_time * 1e3:g} ms and {e.tube.half_width * 1e3:g} mm" for e in result.engines), "")
    text = f"The half-widths of the tube are {width}.\n\n{table(head, rows)}" if width else "No engine was run.\n"
    return text + "\n" + events_table(result)


def _supplies(result: ComparisonResult) -> str:
    runs = [("reference", result.reference.provenance), *((name(e), e.provenance) for e in result.engines)]
    whats = [what for what, *_ in supplies_as_rows(result.reference.provenance.supplies)]
    rows = []
    for label, provenance in runs:
        rows.append([label, *(f"**{by}**: {how}" for _, by, how in supplies_as_rows(provenance.supplies))])
    note = (
        "Agreement tests an engine only in the physics that the engine itself supplies, not in laws that the adapter adds.\n\n"
    )
    added = "".join(f"- **{name(e)}**: {what}\n" for e in result.engines for what in e.additions)
    added = f"\nCorrections that an adapter adds to its engine, and how much each of them matters:\n\n{added}" if added else ""
    return note + table(["run", *whats], rows, left=1 + len(whats)) + added


def _tolerances(result: ComparisonResult) -> str:
    if not result.tolerances:
        return "The scenario declares no tolerances for these engines and this profile.\n"
    head = ["engine", "metric", "outcome", "value", "limit", "reason for the limit", "remark"]
    rows = []
    for t in result.tolerances:
        outcome = t.outcome.value if t.outcome.good else f"**{t.outcome.value}**"
        rows.append([f"{t.engine}, {t.profile}", t.metric, outcome, *value_and_limit(t), t.reason, t.explanation])
    return table(head, rows, left=7)


def value_and_limit(t: ToleranceResult) -> tuple[str, str]:
    """Return value and limit with their unit, for example ("0.41 mm", "at most 0.6 mm")."""
    metric = metric_called(t.metric)
    return metric.quantity(t.value), f"{metric.limit_words} {metric.quantity(t.limit)}"


def _provenance(result: ComparisonResult) -> str:
    p = dict(sorted(result.parameters.as_dict().items()))
    coefficients = dict(sorted(p.pop("coefficients").items()))
    # There are dozens of effects, and a scenario has a few of them
    acting = {k: v for k, v in coefficients.items() if v != 0}
    listed = ", ".join(f"{k} {_setting(v)}" for k, v in (p | acting).items())
    text = f"Scenario `{result.scenario}`, simulated for {result.duration:g} s. Parameters (SI, radians): {listed}"
    text += "; no other effect acts.\n\n" if len(acting) < len(coefficients) else ".\n\n"
    for i in result.inferred:
        script = f" (`{i.script}`)" if i.script else ""
        text += f"- Inferred, because the source does not print them: {', '.join(i.parameters)}. {i.how}{script}\n"
    runs = [("reference", result.reference.provenance), *((name(e), e.provenance) for e in result.engines)]
    rows = []
    for label, provenance in runs:
        versions = ", ".join(f"{k} {v}" for k, v in provenance.versions.items()) or GAP
        settings = ", ".join(f"{k} {_setting(v)}" for k, v in provenance.settings.items()) or GAP
        rows.append([label, versions, settings, GAP if provenance.seed is None else str(provenance.seed)])
    return text + "\n" + table(["run", "versions", "settings [SI]", "seed"], rows, left=4)


def _setting(value: Any) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _times(result: ComparisonResult) -> str:
    head = ["engine", "CPU time [s]", "CPU time [s per simulated s]", "wall time [s]", "wall time [s per simulated s]"]
    rows = [
        [
            f"{w.engine}, {w.profile}",
            *map(number, (w.cpu_seconds, w.cpu_per_simulated_second, w.seconds, w.per_simulated_second)),
        ]
        for w in result.clock.wall_times
    ]
    note = f"Written {result.clock.written}. Times differ from run to run; everything else is the same for the same input.\n\n"
    return note + table(head, rows)


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


def trial_section(result: ComparisonResult) -> list[str]:
    """Return the section on the measured trial, or nothing without one."""
    trial = result.trial
    if trial is None:
        return []
    parts = [f"Trial `{_code(trial.name)}`, read from `{_code(trial.source)}`; times are since the release.\n"]
    parts += ["".join(f"- {plain(note)}\n" for note in trial.notes)] if trial.notes else []
    if trial.tracks:
        head, rows = residual_rows(result)
        parts.append(
            "Residual: measured less predicted, at the measured times; the RMS is that of the distance, over the points that a "
            "run covers.\n"
        )
        parts.append(table(head, rows))
    if result.measured:
        parts.append(measured_events_table(result, source=False))
    return ["## Against the measured trial\n\n" + "\n".join(parts)]


def _code(text: str) -> str:
    """Return ``text`` for Markdown's code, which a backtick would end."""
    return " ".join(text.split()).replace("`", "'")


def measured_events_table(result: ComparisonResult, *, source: bool = True) -> str:
    """Return the side-by-side table, or how to provide the measurements.

    Parameters
    ----------
    source
        Whether to say where the measurements come from.
    """
    if not result.measured:
        return (
            f"This trial was measured ({result.measured_source}), but its table of measured events is not in the package. "
            "Give the folder that contains it with `--data DIR` or in `$LOOPING_PENDULUM_DATA`.\n"
        )
    head = ["quantity", "unit", "measured", PAPER_COLUMN, "reference", *(result.short_name(e) for e in result.engines)]
    rows = [_measured_row(row) for row in result.measured]
    rows.append(_rms_row(result))
    unit = "in thousandths of the unit (ms, mm, mrad)."
    if any(row.paper_numerical is not None for row in result.measured):
        otherwise = "or where nothing was measured from the paper's numerical one, "
        note = f"{otherwise}{unit} The paper prints times to 10 ms and lengths to 10 mm."
    else:
        note = unit
        place = head.index(PAPER_COLUMN)
        head, *rows = ([*row[:place], *row[place + 1 :]] for row in (head, *rows))
    origin = f"Source: {result.measured_source}.\n\n" if source and result.measured_source else ""
    return f"{origin}In brackets: the difference from the measured value, {note}\n\n{table(head, rows, left=2)}"


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


def events_table(result: ComparisonResult) -> str:
    """Return a table of the times of stops, slip onsets and extrema of the reference and each engine."""
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
    if not rows:
        return ""
    head = ["event", "reference [s]", *(f"{result.short_name(e)} [ms later]" for e in result.engines)]
    note = (
        "Event times of the reference, and how much later (+) or earlier (-) they are in each engine; both are read from "
        "samples in the same way. An event that the reference does not have is given as a time; *after its end*: the run ends "
        "before the event. The arrival at the rod follows from how fast the string grows shorter in the last samples.\n\n"
    )
    return note + table(head, rows)


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


def halting_section(result: ComparisonResult) -> list[str]:
    """Return the section, or nothing where no run halts."""
    runs = [("reference", result.reference.sampled), *((f"{e.label}, {e.profile}", e.landmarks) for e in result.engines)]
    # A run with hardly any samples has no landmarks at all
    runs = [(label, landmarks) for label, landmarks in runs if landmarks.halting_times]
    if not any(each.time is not None for _, landmarks in runs for each in landmarks.halting_times):
        return []
    # The first run stands for all: one detector reads them, with the same resolutions
    head = ["run", *(f"halts, to within {quantity(each.resolution, 'm')} [s]" for each in runs[0][1].halting_times)]
    head += ["uncertainty [ms]", "rebound [mm]", "rebound speed, at most [mm/s]"]
    rows = []
    for label, landmarks in runs:
        rebound = landmarks.rebound
        row = [label, *(fixed(each.time, 4) for each in landmarks.halting_times)]
        row.append(f"{landmarks.at_least}{number(landmarks.halting_time_uncertainty, 1e3, 2)}")
        rows.append([*row, *([GAP, GAP] if rebound is None else [number(x, 1e3, 2) for x in (rebound.travel, rebound.speed)])])
    text = f"{HALT_DEFINITION} {_check_against_events(result)}\n\n"
    unlike = [f"- {e.label}, {e.profile}: not comparable: {e.not_comparable}.\n" for e in result.engines if e.not_comparable]
    text += "".join(unlike) + ("\n" if unlike else "")
    return [f"## When does it halt?\n\n{text}{table(head, rows)}"]


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
