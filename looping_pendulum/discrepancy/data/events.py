"""Read event tables: times and positions of stops, extrema and the halt."""

from __future__ import annotations

import math
from decimal import Decimal
from pathlib import Path

from looping_pendulum.discrepancy.data.delimited import DelimitedTable, TableLine, data_error
from looping_pendulum.discrepancy.data.observations import DataError, EventObservation, Observations, UnusedValues
from looping_pendulum.errors import ScenarioError
from looping_pendulum.scenarios.document import quote
from looping_pendulum.scenarios.measured import COLUMNS, current_name, read_event_table
from looping_pendulum.scenarios.units import UnitError, to_si

TIDY_COLUMNS = ("quantity", "index", "value", "sigma", "unit")
"""Columns of an event table with stated standard errors; the other form is that of the scenarios' measured tables."""
_SI_UNITS = ("s", "m", "rad", "")


def is_event_table(table: DelimitedTable) -> bool:
    """Return whether the table has the columns of an event table."""
    return bool(table.head) and table.head[-1].cells[0].lower() == "quantity"


def read_events(path: str | Path, table: DelimitedTable, name: str) -> Observations:
    """Read an event table of either form.

    Raises
    ------
    DataError
        In one line, with the row's line and the column.
    """
    head = tuple(cell.lower() for cell in table.head[-1].cells) if table.head else ()
    if head == TIDY_COLUMNS:
        return _read_tidy_table(table, name)
    if head != COLUMNS:
        forms = f"'{','.join(TIDY_COLUMNS)}' or '{','.join(COLUMNS)}'"
        line = table.head[-1].line if table.head else None
        raise table.error(line, "", f"found columns {quote(','.join(head))}, needed {forms}; rename them")
    return _read_printed_table(path, table, name)


def _read_printed_table(path: str | Path, table: DelimitedTable, name: str) -> Observations:
    """Read a table without standard errors: one unit of the last printed digit stands for each."""
    try:
        # By the reader of the scenarios' tables, whose form this is; the cells are needed beside it for their printed digits
        rows = read_event_table(Path(path)).rows
    except ScenarioError as error:
        raise DataError(str(error)) from None
    events, missing = [], []
    for row, printed in zip(rows, table.rows, strict=True):
        if row.measured is None:
            missing.append(f"{row.quantity} {row.index}")
            continue
        unit, text = row.unit, printed.cells[COLUMNS.index("measured")]
        sigma = _last_digit_unit(text) * to_si(f"1 {printed.cells[-1]}", unit)
        if not 0 < sigma < math.inf:
            message = f"found {quote(text)}, whose last digit is worth {sigma:g}, needed a number as a measurement prints it"
            raise table.error(printed.line, "measured", f"{message}; write for example '0.351'")
        events.append(EventObservation(quantity=row.quantity, index=row.index, value=row.measured, sigma=sigma, unit=unit))
    unused = (UnusedValues(count=len(missing), reason=f"not measured: {', '.join(missing)}"),) if missing else ()
    assumption = "event errors taken as one unit of the last printed digit"
    return Observations(name=name, file=table.file, events=tuple(events), unused=unused, assumptions=(assumption,))


def _last_digit_unit(text: str) -> float:
    """Return one unit of the last printed digit: "0.31" -> 0.01, "1.5e-3" -> 0.0001."""
    exponent = Decimal(text).as_tuple().exponent
    return float(f"1e{exponent}")  # 10.0**exponent raises OverflowError for exponents far from 0


def _read_tidy_table(table: DelimitedTable, name: str) -> Observations:
    """Read a table with a column of standard errors."""
    events: list[EventObservation] = []
    missing: list[str] = []
    first_lines: dict[tuple[str, int], int] = {}
    for row in table.rows:
        if len(row.cells) != len(TIDY_COLUMNS):
            raise table.error(
                row.line, "", f"found {len(row.cells)} cells, needed {len(TIDY_COLUMNS)}: {','.join(TIDY_COLUMNS)}"
            )
        event = _event(table, row)
        if event is None:
            missing.append(f"{row.cells[0]} {row.cells[1]}")
            continue
        # By today's names, which `_event` gives: an older name and a newer one may be the same quantity
        first = first_lines.setdefault((event.quantity, event.index), row.line)
        if first != row.line:
            message = f"found {event.quantity} {event.index} again (first on line {first}), needed it once; delete one"
            raise table.error(row.line, "index", message)
        events.append(event)
    unused = (UnusedValues(count=len(missing), reason=f"not measured: {', '.join(missing)}"),) if missing else ()
    return Observations(name=name, file=table.file, events=tuple(events), unused=unused)


def _event(table: DelimitedTable, row: TableLine) -> EventObservation | None:
    """Return the event of a row in SI units; None if its value is missing."""
    quantity, index, _, _, unit_text = row.cells
    if not quantity:
        raise table.error(row.line, "quantity", "found nothing, needed a name; write for example 'halting_time'")
    if not (index.isascii() and index.isdigit() and 0 < int(index[:9]) and len(index) < 10):
        raise table.error(row.line, "index", f"found {quote(index)}, needed a whole number from 1")
    unit = _si_unit(table, row, unit_text)
    value, sigma = table.number(row, 2, "value"), table.number(row, 3, "sigma")
    if value is None:
        return None
    if sigma is None or not sigma > 0:
        text = quote(row.cells[3]) if row.cells[3] else "nothing"
        raise table.error(row.line, "sigma", f"found {text}, needed the standard error of {quantity}, above 0")
    scale = to_si(f"1 {unit_text}", unit)
    if not math.isfinite(value * scale):
        raise data_error(table.file, row.line, "value", f"found {quote(row.cells[2])}, needed a finite number")
    quantity = current_name(table.file, quantity)
    return EventObservation(quantity=quantity, index=int(index), value=value * scale, sigma=sigma * scale, unit=unit)


def _si_unit(table: DelimitedTable, row: TableLine, unit_text: str) -> str:
    """Return the SI unit that a unit converts to."""
    for si in _SI_UNITS:
        try:
            to_si(f"1 {unit_text}", si)
        except UnitError:
            continue
        return si
    message = f"found {quote(unit_text)}, needed a unit of time, length or angle; write for example 's'"
    raise table.error(row.line, "unit", message)
