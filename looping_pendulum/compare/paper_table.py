"""Renders tables of event times and lengths: measurement, the paper's simulation, the reference and each engine."""

from __future__ import annotations

import math

from looping_pendulum.compare.event_quantities import EVENT_QUANTITIES
from looping_pendulum.compare.result import ComparisonResult, MeasuredRow
from looping_pendulum.compare.tables import GAP, fixed, number, signed, table
from looping_pendulum.engines.landmarks import Extremum

# Two decimals more than the paper prints for times and lengths, so that smaller differences show, too
DECIMALS = {"s": 4, "m": 4, "rad": 3}


PAPER_COLUMN = "paper's numerical"
"""Column of the paper's own simulation, which only the paper's trials have."""


def quantity_label(quantity: str, index: int) -> str:
    """Return a label, ("x1_extremum", 3) -> "x1 extremum 3"; the number only where there can be several."""
    several = quantity in EVENT_QUANTITIES and EVENT_QUANTITIES[quantity].several
    return f"{quantity.replace('_', ' ')} {index}" if several else quantity.replace("_", " ")


def render(result: ComparisonResult, *, source: bool = True) -> str:
    """Return the side-by-side table, or how to provide the measurements.

    Parameters
    ----------
    source
        Whether to say where the measurements come from.
    """
    if not result.measured:
        return (
            f"This trial was measured ({result.measured_source}), but its table of measured events is not in the package.\n"
            "Give the folder that contains it with `--data DIR` or in `$LOOPING_PENDULUM_DATA`.\n"
        )
    head = ["quantity", "unit", "measured", PAPER_COLUMN, "reference", *(result.short_name(e) for e in result.engines)]
    rows = [_row(row) for row in result.measured]
    rows.append(_summary(result))
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


def _row(row: MeasuredRow) -> list[str]:
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


def _summary(result: ComparisonResult) -> list[str]:
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
    rows += _series("x1 extremum", [_times(m.x1_extrema) for m in landmarks], ends)
    rows += _series("y1 extremum", [_times(m.y1_extrema) for m in landmarks], ends)
    if reference.light_reaches_rod is not None:
        reached = [[] if m.light_reaches_rod is None else [m.light_reaches_rod] for m in landmarks]
        rows += _series("light mass reaches rod", reached, ends)
    if not rows:
        return ""
    head = ["event", "reference [s]", *(f"{result.short_name(e)} [ms later]" for e in result.engines)]
    note = (
        "Event times of the reference, and how much later (+) or earlier (-) they are in each engine; both are read from\n"
        "samples in the same way. An event that the reference does not have is given as a time; *after its end*: the run ends\n"
        "before the event. An engine's run ends a little before the light mass reaches the rod, at a small free length.\n\n"
    )
    return note + table(head, rows)


def _times(extrema: tuple[Extremum, ...]) -> list[float]:
    return [e.time for e in extrema]


def _series(what: str, columns: list[list[float]], ends: list[float]) -> list[list[str]]:
    """Return the rows of one kind of event: times of the reference and of each engine, whose runs end at ``ends`` [s]."""
    rows = []
    for i in range(max(len(c) for c in columns)):
        values = [c[i] if i < len(c) else None for c in columns]
        reference = values[0]
        cells = [_cell(v, reference, end) for v, end in zip(values[1:], ends, strict=True)]
        rows.append([f"{what} {i + 1}" if max(len(c) for c in columns) > 1 else what, fixed(reference, 4), *cells])
    return rows


def _cell(value: float | None, reference: float | None, end: float) -> str:
    if value is None:
        return "after its end" if reference is not None and reference > end else GAP
    return f"at {value:.4f} s" if reference is None else signed(value - reference, 1e3)
