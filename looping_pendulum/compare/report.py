"""The report in Markdown, rendered from the result object and nothing else. Verdict first, then why, then detail."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from looping_pendulum.compare import baseline, halts, paper_table
from looping_pendulum.compare.result import ComparisonResult, EngineResult, RunProvenance, ToleranceOutcome, ToleranceResult
from looping_pendulum.compare.tables import GAP, fixed, number, signed, table
from looping_pendulum.compare.tolerances import AT_LEAST
from looping_pendulum.compare.words import told_events
from looping_pendulum.pages.glossary import glossary

UNITS: dict[str, tuple[str, float]] = {
    "rms_0.35s": ("mm", 1e3),
    "rms_0.7s": ("mm", 1e3),
    "rms_1.0s": ("mm", 1e3),
    "rms_halt": ("mm", 1e3),
    "halting_time_error": ("ms", 1e3),
    "rebound": ("mm", 1e3),
    "drop_error": ("mm", 1e3),
    "wrap_angle_error": ("mrad", 1e3),
    "free_length_error": ("mm", 1e3),
    "string_stretch": ("mm", 1e3),
    "acceleration_error": ("%", 1e2),
    "tube_fraction": ("%", 1e2),
    "simulated_time": ("s", 1.0),
}
"""Metric -> the unit a reader likes, and how many of it make one SI unit."""


REFUSED = ("no:", "no (")
"""How a verdict begins that leaves the comparison outside tolerance."""


def render(
    result: ComparisonResult, figures: Mapping[str, str] | None = None, changes: baseline.ResultChanges | None = None
) -> str:
    """Return the report.

    Parameters
    ----------
    figures
        Path below the report's folder -> caption.
    changes
        What changed since a baseline, if there is one.
    """
    figures_section = "## Figures\n\n" + _figures(figures or {})
    words = "## Words\n\n" + "".join(f"- **{word}**: {meaning}\n" for word, meaning in glossary("comparison").items())
    return "\n".join([*before_figures(result, changes), figures_section, *after_figures(result), words])


def before_figures(result: ComparisonResult, changes: baseline.ResultChanges | None = None) -> list[str]:
    """Sections that stand above the figures, the title first."""
    return [
        f"# {result.title}\n\n{result.description.strip()}\n",
        "## Verdict\n\n" + _verdict(result),
        "## Where, when and why\n\n" + _stories(result),
        *([] if changes is None else ["## Since the baseline\n\n" + baseline.render(changes)]),
    ]


def after_figures(result: ComparisonResult) -> list[str]:
    """Sections that stand below the figures, but for the glossary."""
    sections = []
    if result.measured_source or result.measured:
        sections.append("## Against the paper's trial\n\n" + paper_table.render(result))
    return [
        *sections,
        *halts.render(result),
        "## Detail\n\n" + _detail(result),
        "## Who supplies the physics\n\n" + _supplies(result),
        "## Tolerances\n\n" + _tolerances(result),
        "## Provenance\n\n" + _provenance(result),
        "## Wall times\n\n" + _wall_times(result),
    ]


def name(engine: EngineResult) -> str:
    """Label and profile, "pymunk:chain, quick"."""
    return f"{engine.label}, {engine.profile}" if engine.profile else engine.label


def verdict_rows(result: ComparisonResult) -> tuple[list[str], list[list[str]]]:
    """Header and rows of the verdict table as plain text, the reference first, for Markdown and for a terminal."""
    vertical = any(e.metrics.get("acceleration_error") is not None for e in result.engines)
    head = ["engine", "within tolerance?", "RMS to 0.35 s [mm]", "to 0.7 s [mm]", "to 1.0 s [mm]", "halting time [s]"]
    head += ["halting error [ms]", "drop error [mm]", *(["acceleration error [%]"] if vertical else []), "wall time [s per s]"]
    true = result.reference.sampled
    blank = [GAP] * (3 + vertical)
    rows = [["reference", GAP, *blank[:3], fixed(true.halting_time, 4), GAP, GAP, *blank[3:], GAP]]
    for engine, wall in zip(result.engines, result.clock.wall_times, strict=True):
        m, halt = engine.metrics, engine.landmarks.halting_time
        cells = [number(m[k], 1e3) for k in ("rms_0.35s", "rms_0.7s", "rms_1.0s")]
        late = "not comparable" if engine.not_comparable else signed(m["halting_time_error"], 1e3)
        cells += [fixed(halt, 4), late, signed(m["drop_error"], 1e3)]
        cells += [signed(m["acceleration_error"], 1e2)] if vertical else []
        rows.append([name(engine), _within(result, engine), *cells, number(wall.per_simulated_second, digits=2)])
    return head, rows


def _verdict(result: ComparisonResult) -> str:
    head, rows = verdict_rows(result)
    for row in rows:
        if row[1].startswith(REFUSED):
            row[1] = f"**no**{row[1].removeprefix('no')}"
    return f"{_verdict_sentence(result)}\n\n{table(head, rows, left=2)}"


def _verdict_sentence(result: ComparisonResult) -> str:
    broken = [f"{t.engine} ({t.metric}: {t.outcome.value})" for t in result.tolerances if not t.outcome.good]
    broken += [f"{e.label} ({e.status_sentence})" for e in result.engines if result.broke_off(e)]
    gaps = [e.label for e in result.engines if not e.available]
    if broken:
        text = f"**Outside tolerance:** {'; '.join(broken)}."
    elif not result.tolerances:
        text = "**No limits are declared** for these engines and this profile: the numbers stand unjudged."
    else:
        text = "**Within tolerance.**"
    return text + (f" Not run: {', '.join(gaps)}." if gaps else "")


def _within(result: ComparisonResult, engine: EngineResult) -> str:
    judged = result.judged(engine)
    if not engine.available:
        return f"not run: {engine.status_sentence}"
    bad = sum(not t.outcome.good for t in judged)
    expected = sum(t.outcome is ToleranceOutcome.EXPECTED_FAILURE for t in judged)
    note = f"; {expected} expected failure{'s' if expected > 1 else ''}" if expected else ""
    if result.broke_off(engine):
        return f"no: {engine.status_sentence}{note}"
    if bad:
        return f"no ({bad} of {len(judged)} limits){note}"
    if not judged:
        return "no limits declared"
    return f"yes{note}" if expected < len(judged) else f"as expected, no{note}"


def _stories(result: ComparisonResult) -> str:
    halt = result.reference.landmarks.halting_time
    events = "".join(f", {n.replace('_', ' ')} at {t:.4f} s" for n, t in told_events(result.reference.events))
    end = "" if halt is not None else ", never halts"
    true = f"- **reference** ({result.reference.engine}:{result.reference.variant}): released at 0 s{events}{end}.\n"
    lines = [
        f"- **{name(e)}**: {e.story}{_range_warning(e)}{' ' + _quoted(e.message) if e.message else ''}\n"
        for e in result.engines
    ]
    return true + "".join(lines)


def _range_warning(engine: EngineResult) -> str:
    if not engine.outside_range:
        return ""
    return f" **Its accuracy was never measured on such a scenario:** {'; '.join(engine.outside_range)}."


def _quoted(message: str) -> str:
    """Return the last line of what the engine said, as code: its own words may hold any characters."""
    lines = message.strip().splitlines()
    return "`" + lines[-1].replace("`", "'")[:200] + "`" if lines else ""


def _figures(figures: Mapping[str, str]) -> str:
    if not figures:
        return "None: this report was made without the trajectories.\n"
    return "\n".join(f"![{caption}]({path})\n\n*{caption}*\n" for path, caption in figures.items())


def _detail(result: ComparisonResult) -> str:
    head = ["engine", "in tube [%]", "leaves tube [s]", "1 mm off at [s]", "10 mm off at [s]", "growth [1/s]"]
    head += ["RMS to halt [mm]", "drop at halt [m]", "wrap angle at halt [rad]", "error [mrad]"]
    head += ["free length at halt [m]", "error [mm]", "stretch [mm]"]
    true = result.reference.sampled
    first = ["reference", *[GAP] * 6, fixed(true.drop_at_halt, 4), fixed(true.wrap_angle_at_halt, 4), GAP]
    rows = [[*first, fixed(true.free_length_at_halt, 4), GAP, GAP]]
    for e in result.engines:
        passed = {d.threshold: d.time for d in e.departures}
        row = [name(e), number(e.tube.fraction, 100), fixed(e.tube.first_exit, 3)]
        row += [fixed(passed.get(threshold), 3) for threshold in (1e-3, 1e-2)]
        row += [number(e.growth_rate, digits=2), number(e.metrics["rms_halt"], 1e3), fixed(e.landmarks.drop_at_halt, 4)]
        row += [fixed(e.landmarks.wrap_angle_at_halt, 4), signed(e.metrics["wrap_angle_error"], 1e3)]
        row += [fixed(e.landmarks.free_length_at_halt, 4), signed(e.metrics["free_length_error"], 1e3)]
        rows.append([*row, number(e.metrics["string_stretch"], 1e3)])
    width = next((f"{e.tube.half_time * 1e3:g} ms and {e.tube.half_width * 1e3:g} mm" for e in result.engines), "")
    text = f"The tube is {width} wide to either side.\n\n{table(head, rows)}" if width else "No engine was asked for.\n"
    return text + "\n" + paper_table.moments(result)


def _supplies(result: ComparisonResult) -> str:
    runs = [("reference", result.reference.provenance), *((name(e), e.provenance) for e in result.engines)]
    whats = [s.what for s in result.reference.provenance.supplies]
    rows = []
    for label, provenance in runs:
        by = {s.what: f"**{s.by}**: {s.how}" for s in provenance.supplies}
        rows.append([label, *(by.get(what, GAP) for what in whats)])
    note = "A law that the adapter feeds in is no evidence for that law; only what the engine supplies itself tests it.\n\n"
    added = "".join(f"- **{name(e)}**: {what}\n" for e in result.engines for what in e.additions)
    added = f"\nWhat an adapter puts in beyond its engine, and what that is worth:\n\n{added}" if added else ""
    return note + table(["run", *whats], rows, left=1 + len(whats)) + added


def _tolerances(result: ComparisonResult) -> str:
    if not result.tolerances:
        return "The scenario declares none for these engines and this profile.\n"
    head = ["engine", "metric", "outcome", "value", "limit", "why this limit", "remark"]
    return table(head, [_tolerance_row(t) for t in result.tolerances], left=7)


def limit_and_value(t: ToleranceResult) -> tuple[str, str]:
    """Limit and value with their unit: "at most 0.6 mm", "0.41 mm"."""
    unit, scale = UNITS.get(t.metric, ("SI", 1.0))
    limit = f"{'at least' if t.metric in AT_LEAST else 'at most'} {number(t.limit, scale)} {unit}"
    return limit, GAP if t.value is None else f"{number(t.value, scale)} {unit}"


def _tolerance_row(t: ToleranceResult) -> list[str]:
    limit, value = limit_and_value(t)
    outcome = t.outcome.value if t.outcome.good else f"**{t.outcome.value}**"
    return [f"{t.engine}, {t.profile}", t.metric, outcome, value, limit, t.reason, t.explanation]


def _provenance(result: ComparisonResult) -> str:
    p = dict(result.parameters)
    coefficients = p.pop("coefficients", {})
    listed = ", ".join(f"{k} {_setting(v)}" for k, v in (p | dict(coefficients)).items())
    text = f"Scenario `{result.scenario}`, watched for {result.duration:g} s. SI and radians: {listed}.\n\n"
    for i in result.inferred:
        script = f" (`{i.script}`)" if i.script else ""
        text += f"- Inferred, not printed by the source: {', '.join(i.parameters)}. {i.how}{script}\n"
    runs = [(f"reference, {result.reference.engine}:{result.reference.variant}", result.reference.provenance)]
    runs += [(name(e), e.provenance) for e in result.engines]
    return text + "\n" + table(["run", "versions", "settings [SI]", "seed"], [_provenance_row(*run) for run in runs], left=4)


def _provenance_row(label: str, p: RunProvenance) -> list[str]:
    versions = ", ".join(f"{k} {v}" for k, v in p.versions.items()) or GAP
    settings = ", ".join(f"{k} {_setting(v)}" for k, v in p.settings.items()) or GAP
    return [label, versions, settings, GAP if p.seed is None else str(p.seed)]


def _setting(value: Any) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _wall_times(result: ComparisonResult) -> str:
    head = ["engine", "wall time [s]", "wall time [s per simulated s]"]
    rows = [[f"{w.engine}, {w.profile}", number(w.seconds), number(w.per_simulated_second)] for w in result.clock.wall_times]
    note = f"Written {result.clock.written}. Times change from run to run; all else is the same for the same input.\n\n"
    return note + table(head, rows)
