"""Event tables: times and positions of stops, extrema and halts."""

from __future__ import annotations

import math
from decimal import Decimal
from pathlib import Path

from looping_pendulum.discrepancy.data.delimited import DelimitedTable, TableLine, data_error
from looping_pendulum.discrepancy.data.observations import DataError, EventObservation, Observations, UnusedValues
from looping_pendulum.errors import ScenarioError
from looping_pendulum.scenarios.document import quote
from looping_pendulum.scenarios.measured import COLUMNS, read_event_table
from looping_pendulum.scenarios.units import UnitError, to_si

TIDY = ("quantity", "index", "value", "sigma", "unit")
"""Columns of an event table with stated errors; the other form is that of the scenarios' measured tables."""
_SI_UNITS = ("s", "m", "rad", "")


def is_event_table(table: DelimitedTable) -> bool:
    """Whether the table has the columns of one."""
    return bool(table.head) and table.head[-1].cells[0].lower() == "quantity"


def read_events(path: str | Path, table: DelimitedTable, name: str) -> Observations:
    """Read an event table of either form.

    Raises
    ------
    DataError
        In one line, with the row's line and the column.
    """
    head = tuple(cell.lower() for cell in table.head[-1].cells) if table.head else ()
    if head == TIDY:
        return _tidy(table, name)
    if head != COLUMNS:
        forms = f"'{','.join(TIDY)}' or '{','.join(COLUMNS)}'"
        line = table.head[-1].line if table.head else None
        raise table.error(line, "", f"found columns {quote(','.join(head))}, needed {forms}; rename them")
    return _printed(path, table, name)


def _printed(path: str | Path, table: DelimitedTable, name: str) -> Observations:
    """Table without errors: one unit of the last printed digit stands for each."""
    try:
        rows = read_event_table(Path(path)).rows
    except ScenarioError as error:
        raise DataError(str(error)) from None
    events, missing = [], []
    for row, printed in zip(rows, table.rows, strict=True):
        if row.measured is None:
            missing.append(f"{row.quantity} {row.index}")
            continue
        unit, text = row.unit, printed.cells[COLUMNS.index("measured")]
        sigma = _last_digit(text) * to_si(f"1 {printed.cells[-1]}", unit)
        if not 0 < sigma < math.inf:
            message = f"found {quote(text)}, whose last digit is worth {sigma:g}, needed a number as a measurement prints it"
            raise table.error(printed.line, "measured", f"{message}; write for example '0.351'")
        events.append(EventObservation(quantity=row.quantity, index=row.index, value=row.measured, sigma=sigma, unit=unit))
    dropped = (UnusedValues(count=len(missing), reason=f"not measured: {', '.join(missing)}"),) if missing else ()
    assumption = "event errors taken as one unit of the last printed digit"
    return Observations(name=name, file=table.file, events=tuple(events), dropped=dropped, assumptions=(assumption,))


def _last_digit(text: str) -> float:
    """One unit of the last printed digit: "0.31" -> 0.01, "1.5e-3" -> 0.0001."""
    exponent = Decimal(text).as_tuple().exponent
    return float(f"1e{exponent}")  # unlike 10.0**exponent, which is an error far below and above


def _tidy(table: DelimitedTable, name: str) -> Observations:
    events: list[EventObservation] = []
    missing: list[str] = []
    seen: dict[tuple[str, int], int] = {}
    for row in table.rows:
        if len(row.cells) != len(TIDY):
            raise table.error(row.line, "", f"found {len(row.cells)} cells, needed {len(TIDY)}: {','.join(TIDY)}")
        event = _event(table, row)
        if event is None:
            missing.append(f"{row.cells[0]} {row.cells[1]}")
            continue
        first = seen.setdefault((event.quantity, event.index), row.line)
        if first != row.line:
            message = f"found {event.quantity} {event.index} again (first on line {first}), needed it once; delete one"
            raise table.error(row.line, "index", message)
        events.append(event)
    dropped = (UnusedValues(count=len(missing), reason=f"not measured: {', '.join(missing)}"),) if missing else ()
    return Observations(name=name, file=table.file, events=tuple(events), dropped=dropped)


def _event(table: DelimitedTable, row: TableLine) -> EventObservation | None:
    quantity, index, _, _, written = row.cells
    if not quantity:
        raise table.error(row.line, "quantity", "found nothing, needed a name; write for example 'halting_time'")
    if not (index.isascii() and index.isdigit() and 0 < int(index[:9]) and len(index) < 10):
        raise table.error(row.line, "index", f"found {quote(index)}, needed a whole number from 1")
    unit = _si_unit(table, row, written)
    value, sigma = table.number(row, 2, "value"), table.number(row, 3, "sigma")
    if value is None:
        return None
    if sigma is None or not sigma > 0:
        found = quote(row.cells[3]) if row.cells[3] else "nothing"
        raise table.error(row.line, "sigma", f"found {found}, needed the standard error of {quantity}, above 0")
    scale = to_si(f"1 {written}", unit)
    if not math.isfinite(value * scale):
        raise data_error(table.file, row.line, "value", f"found {quote(row.cells[2])}, needed a finite number")
    return EventObservation(quantity=quantity, index=int(index), value=value * scale, sigma=sigma * scale, unit=unit)


def _si_unit(table: DelimitedTable, row: TableLine, written: str) -> str:
    for si in _SI_UNITS:
        try:
            to_si(f"1 {written}", si)
        except UnitError:
            continue
        return si
    message = f"found {quote(written)}, needed a unit of time, length or angle; write for example 's'"
    raise table.error(row.line, "unit", message)
