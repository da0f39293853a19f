"""Read event tables: times and positions of stops, extrema and the halt."""

from __future__ import annotations

import math
from decimal import Decimal

from looping_pendulum.measured.delimited import DelimitedText, TableLine, data_error
from looping_pendulum.measured.observations import EventObservation, Observations, UnusedValues
from looping_pendulum.scenarios.document import quote
from looping_pendulum.scenarios.measured import COLUMNS, current_name
from looping_pendulum.scenarios.units import UnitError, to_si

TIDY_COLUMNS = ("quantity", "index", "value", "sigma", "unit")
"""Columns of an event table with stated standard errors; the other form is that of the scenarios' measured tables."""
_SI_UNITS = ("s", "m", "rad", "")


def is_event_table(text: DelimitedText) -> bool:
    """Return whether a file has the columns of an event table."""
    return any(line.cells[0].lower() == "quantity" for line in text.lines)


def read_events(text: DelimitedText, name: str) -> Observations:
    """Read an event table of either form.

    Raises
    ------
    DataError
        In one line, with the row's line and the column.
    """
    at = next((i for i, line in enumerate(text.lines) if line.cells[0].lower() == "quantity"), 0)
    head, rows = tuple(cell.lower() for cell in text.lines[at].cells), text.lines[at + 1 :]
    if head not in (TIDY_COLUMNS, COLUMNS):
        forms = f"'{','.join(TIDY_COLUMNS)}' or '{','.join(COLUMNS)}'"
        raise text.error(text.lines[at].line, "", f"found columns {quote(','.join(head))}, needed {forms}; rename them")
    if not rows:
        raise text.error(text.lines[at].line, "", "found no rows below the names of the columns, needed one for each event")
    events: list[EventObservation] = []
    missing: list[str] = []
    first_lines: dict[tuple[str, int], int] = {}
    for row in rows:
        if len(row.cells) != len(head):
            raise text.error(row.line, "", f"found {len(row.cells)} cells, needed {len(head)}: {','.join(head)}")
        event = _event(text, row, head)
        if event is None:
            missing.append(f"{row.cells[0]} {row.cells[1]}")
            continue
        # By today's names, which `_event` gives: an older name and a newer one may be the same quantity
        first = first_lines.setdefault((event.quantity, event.index), row.line)
        if first != row.line:
            message = f"found {event.quantity} {event.index} again (first on line {first}), needed it once; delete one"
            raise text.error(row.line, "index", message)
        events.append(event)
    return Observations(
        name=name,
        file=text.file,
        events=tuple(events),
        unused=(UnusedValues(count=len(missing), reason=f"not measured: {', '.join(missing)}"),) if missing else (),
        assumptions=() if head == TIDY_COLUMNS else ("event errors taken as one unit of the last printed digit",),
    )


def _event(text: DelimitedText, row: TableLine, head: tuple[str, ...]) -> EventObservation | None:
    """Return the event of a row in SI units; None if its value is missing."""
    quantity, index, value_text, error_text, unit_text = row.cells
    if not quantity:
        raise text.error(row.line, "quantity", "found nothing, needed a name; write for example 'halting_time'")
    if not (index.isascii() and index.isdigit() and 0 < int(index[:9]) and len(index) < 10):
        raise text.error(row.line, "index", f"found {quote(index)}, needed a whole number from 1")
    unit = _si_unit(text, row, unit_text)
    value, error = text.number(row, 2, head[2]), text.number(row, 3, head[3])
    if math.isnan(value):
        return None
    if head == TIDY_COLUMNS:
        sigma, what = error, quote(error_text) if error_text else "nothing"
        needed = f"needed the standard error of {quantity}, above 0"
    else:
        # A table without standard errors: one unit of the last printed digit stands for each
        sigma = _last_digit_unit(value_text)
        what = f"{quote(value_text)}, whose last digit is worth {sigma:g}"
        needed = "needed a number as a measurement prints it; write for example '0.351'"
    if not 0 < sigma < math.inf:
        raise text.error(row.line, "sigma" if head == TIDY_COLUMNS else "measured", f"found {what}, {needed}")
    scale = to_si(f"1 {unit_text}", unit)
    if not math.isfinite(value * scale):
        raise data_error(text.file, row.line, "value", f"found {quote(value_text)}, needed a finite number")
    quantity = current_name(text.file, quantity)
    return EventObservation(quantity=quantity, index=int(index), value=value * scale, sigma=sigma * scale, unit=unit)


def _last_digit_unit(text: str) -> float:
    """Return one unit of the last printed digit: "0.31" -> 0.01, "1.0" -> 0.1, "1.5e-3" -> 0.0001."""
    exponent = Decimal(text).as_tuple().exponent
    return float(f"1e{exponent}")  # 10.0**exponent raises OverflowError for exponents far from 0


def _si_unit(table: DelimitedText, row: TableLine, unit_text: str) -> str:
    """Return the SI unit that a unit converts to."""
    for si in _SI_UNITS:
        try:
            to_si(f"1 {unit_text}", si)
        except UnitError:
            continue
        return si
    message = f"found {quote(unit_text)}, needed a unit of time, length or angle; write for example 's'"
    raise table.error(row.line, "unit", message)
