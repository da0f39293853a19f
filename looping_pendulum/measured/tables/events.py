"""Tables of measured events (stops, extrema, the halt): where those of the shipped scenarios may be, and their one reader."""

from __future__ import annotations

import hashlib
import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path

from looping_pendulum.measured.observations import DataError, Edit, EventObservation, Observations
from looping_pendulum.measured.tables.delimited import DelimitedText, TableLine, read_bytes, read_text
from looping_pendulum.scenarios.document import quote
from looping_pendulum.scenarios.units import UnitError, to_si

DATA_VARIABLE = "LOOPING_PENDULUM_DATA"
"""Environment variable that names a data folder."""
DEFAULT_DATA_FOLDERS = ("data", "../shared/data")
"""Data folders that are searched, relative to the current directory."""
COLUMNS = ("quantity", "index", "measured", "paper_numerical", "unit")
"""Columns of an event table as the paper prints it."""
TIDY_COLUMNS = ("quantity", "index", "value", "sigma", "unit")
"""Columns of an event table with stated standard errors."""
MAX_TABLE_SIZE = 1024 * 1024
"""Largest printed event table that is read [bytes]."""
_SI_UNITS = ("s", "m", "rad", "kg", "m/s", "m/s**2", "")
"""SI units that a measured quantity may have; '' for a plain number."""


@dataclass(frozen=True, kw_only=True)
class MeasuredEventRow:
    """One quantity that was measured, or that the paper computed."""

    quantity: str
    """Name of the quantity, "x1_extremum"."""
    index: int
    """Number of the event among those of the same quantity, from 1."""
    measured: float | None
    """Measured value [SI]; None if it was not measured."""
    paper_numerical: float | None
    """Value of the paper's own simulation [SI]; None if the paper prints none."""
    unit: str
    """SI unit of both."""
    sigma: float | None = None
    """Standard error of the measured value [SI]; None if the source states none."""
    last_digit: float = math.nan
    """What one unit of the measured value's last printed digit is worth [SI]."""


def data_folders() -> list[Path]:
    """Return the folders that are searched for measured data: $LOOPING_PENDULUM_DATA, then `DEFAULT_DATA_FOLDERS`."""
    folder = os.environ.get(DATA_VARIABLE)
    return [*([Path(folder)] if folder else []), *map(Path, DEFAULT_DATA_FOLDERS)]


def find_data(file: str, folders: Path | Sequence[Path] | None = None) -> Path | None:
    """Find a file of measured data, or return None.

    Parameters
    ----------
    file
        Path below a data folder, as `MeasuredTable.file`.
    folders
        Data folders to search first, before those of `data_folders`.
    """
    given = [folders] if isinstance(folders, Path) else list(folders or ())
    for folder in [*given, *data_folders()]:
        path = folder / file
        if path.is_file():
            return path
    return None


def read_event_table(path: Path, sha256: str | None = None) -> tuple[MeasuredEventRow, ...]:
    """Read a file that is an event table, with commas.

    Parameters
    ----------
    sha256
        Checksum that the file must have; None: any.

    Raises
    ------
    DataError
        As `event_table`, or if it is another file.
    """
    raw = read_bytes(path, str(path), MAX_TABLE_SIZE)
    checksum = hashlib.sha256(raw).hexdigest()
    if sha256 is not None and checksum != sha256.lower():
        message = f"{path}: found SHA-256 {checksum[:12]}..., needed {sha256[:12]}...; it is not the scenario's own table"
        raise DataError(message)
    return event_table(read_text(raw, str(path), [","]))


def is_event_table(text: DelimitedText) -> bool:
    """Return whether a file has the columns of an event table."""
    return any(line.cells[0].lower() == "quantity" for line in text.lines)


def read_events(text: DelimitedText, name: str) -> Observations:
    """Return the events of a table; without standard errors, one unit of the last printed digit stands for each.

    Raises
    ------
    DataError
        As `event_table`.
    """
    rows = event_table(text)
    missing = [f"{row.quantity} {row.index}" for row in rows if row.measured is None]
    edits = [Edit(count=len(missing), reason=f"not measured: {', '.join(missing)}")] if missing else []
    if any(row.sigma is None for row in rows if row.measured is not None):
        edits.append(Edit(reason="event errors taken as one unit of the last printed digit"))
    events = tuple(
        EventObservation(
            quantity=row.quantity,
            index=row.index,
            value=row.measured,
            sigma=row.last_digit if row.sigma is None else row.sigma,
            unit=row.unit,
        )
        for row in rows
        if row.measured is not None
    )
    return Observations(name=name, file=text.file, events=events, edits=tuple(edits))


def event_table(text: DelimitedText) -> tuple[MeasuredEventRow, ...]:
    """Read an event table of either form, `COLUMNS` or `TIDY_COLUMNS`.

    Raises
    ------
    DataError
        In one line, with the row's line and the column.
    """
    at = next((i for i, line in enumerate(text.lines) if line.cells[0].lower() == "quantity"), 0)
    head, lines = tuple(cell.lower() for cell in text.lines[at].cells), text.lines[at + 1 :]
    if head not in (TIDY_COLUMNS, COLUMNS):
        forms = f"'{','.join(TIDY_COLUMNS)}' or '{','.join(COLUMNS)}'"
        raise text.error(text.lines[at].line, "", f"found columns {quote(','.join(head))}, needed {forms}; rename them")
    if not lines:
        raise text.error(text.lines[at].line, "", "found no rows below the names of the columns, needed one for each event")
    rows: list[MeasuredEventRow] = []
    first_lines: dict[tuple[str, int], int] = {}
    for line in lines:
        if len(line.cells) != len(head):
            raise text.error(line.line, "", f"found {len(line.cells)} cells, needed {len(head)}: {','.join(head)}")
        row = _row(text, line, head)
        first = first_lines.setdefault((row.quantity, row.index), line.line)
        if first != line.line:
            message = f"found {row.quantity} {row.index} again (first on line {first}), needed it once; delete one"
            raise text.error(line.line, "index", message)
        rows.append(row)
    return tuple(rows)


def _row(text: DelimitedText, line: TableLine, head: tuple[str, ...]) -> MeasuredEventRow:
    """Return one row of a table, with its values in SI units."""
    quantity, index, value_text, error_text, unit_text = line.cells
    if not quantity:
        raise text.error(line.line, "quantity", "found nothing, needed a name; write for example 'halting_time'")
    # isascii, as other scripts have digits, too; nine digits at most, as int() itself refuses thousands
    if not (index.isascii() and index.isdigit() and 0 < int(index[:9]) and len(index) < 10):
        raise text.error(line.line, "index", f"found {quote(index)}, needed a whole number from 1")
    unit, factor = _si_unit(text, line, unit_text)
    value, second = (text.number(line, column, head[column]) * factor for column in (2, 3))
    is_measured, is_tidy = not math.isnan(value), head == TIDY_COLUMNS
    # 10.0**exponent raises OverflowError for exponents far from 0
    digit = float(f"1e{Decimal(value_text).as_tuple().exponent}") if is_measured else math.nan
    if is_measured and is_tidy and not 0 < second < math.inf:
        found = f"found {quote(error_text) if error_text else 'nothing'}"
        raise text.error(line.line, "sigma", f"{found}, needed the standard error of {quantity}, above 0")
    if is_measured and not is_tidy and not 0 < digit * factor < math.inf:
        needed = "needed a number as a measurement prints it; write for example '0.351'"
        raise text.error(line.line, "measured", f"found {quote(value_text)}, whose last digit is worth {digit:g}, {needed}")
    known = None if math.isnan(second) else second
    return MeasuredEventRow(
        quantity=quantity,
        index=int(index),
        measured=value if is_measured else None,
        paper_numerical=None if is_tidy else known,
        unit=unit,
        sigma=known if is_tidy else None,
        last_digit=digit * factor,
    )


def _si_unit(text: DelimitedText, line: TableLine, unit_text: str) -> tuple[str, float]:
    """Return the SI unit that a unit converts to, and the factor."""
    for si in _SI_UNITS:
        try:
            return si, to_si(f"1 {unit_text}", si)
        except UnitError:
            continue
    message = f"found {quote(unit_text)}, needed a unit of time, length or angle; write for example 's'"
    raise text.error(line.line, "unit", message)
