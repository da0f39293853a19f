"""Find and read measured event tables, which are not part of the package."""

from __future__ import annotations

import hashlib
import os
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from looping_pendulum.errors import RenamedWarning, ScenarioError
from looping_pendulum.scenarios import text_table
from looping_pendulum.scenarios.document import one_line, quote
from looping_pendulum.scenarios.units import UnitError, to_si

DATA_VARIABLE = "LOOPING_PENDULUM_DATA"
"""Environment variable that names a data folder."""
DEFAULT_DATA_FOLDERS = ("data", "../shared/data")
"""Data folders that are searched, relative to the current directory."""
COLUMNS = ("quantity", "index", "measured", "paper_numerical", "unit")
"""Columns of an event table, in this order."""
RENAMED_QUANTITIES = {"break_away_time": "slip_onset_time"}
"""Quantity as tables of version 0.1 name it -> its name now; both are read."""
MAX_TABLE_SIZE = 1024 * 1024
"""Largest event table that is read [bytes]."""
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


@dataclass(frozen=True, kw_only=True)
class MeasuredEventTable:
    """The measured events of one trial."""

    file: str
    rows: tuple[MeasuredEventRow, ...]
    """In the order of the source."""


def data_folders() -> list[Path]:
    """Return the folders that are searched for measured data: $LOOPING_PENDULUM_DATA, then `DEFAULT_DATA_FOLDERS`."""
    folder = os.environ.get(DATA_VARIABLE)
    return [*([Path(folder)] if folder else []), *map(Path, DEFAULT_DATA_FOLDERS)]


def find_data(file: str, folders: Path | Sequence[Path] | None = None) -> Path | None:
    """Find a file of measured data, or return None.

    Parameters
    ----------
    file
        Path below a data folder, as `MeasuredTrial.file`.
    folders
        Data folders to search first, before those of `data_folders`.
    """
    given = [folders] if isinstance(folders, Path) else list(folders or ())
    for folder in [*given, *data_folders()]:
        path = folder / file
        if path.is_file():
            return path
    return None


def read_event_table(path: Path, sha256: str | None = None) -> MeasuredEventTable:
    """Read an event table: CSV with the `COLUMNS`; lines that begin with # are comments.

    Parameters
    ----------
    sha256
        Checksum that the file must have; None: any.

    Raises
    ------
    ScenarioError
        If the table has an error; the message has the file, the row's line and the column.
    """
    file = str(path)
    text = _read(path, sha256)
    rows: list[MeasuredEventRow] = []
    first_lines: dict[tuple[str, int], int] = {}
    header: tuple[str, ...] = ()
    for number, line in text_table.lines(text):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        if len(line) > text_table.MAX_LINE_LENGTH:
            raise _error(
                file, number, "", f"found a line of {len(line)} characters, needed at most {text_table.MAX_LINE_LENGTH}"
            )
        cells = text_table.cells(line, ",")
        if not header:
            header = cells
            if header != COLUMNS:
                raise _error(file, number, "", f"found columns {quote(','.join(header))}, needed '{','.join(COLUMNS)}'")
            continue
        row = _row(file, number, cells)
        first = first_lines.setdefault((row.quantity, row.index), number)
        if first != number:
            raise _error(file, number, "index", f"found {row.quantity} {row.index} a second time (first on line {first})")
        rows.append(row)
    if not rows:
        raise ScenarioError(one_line(f"{file}: found no rows, needed a line '{','.join(COLUMNS)}' and rows below it"))
    return MeasuredEventTable(file=file, rows=tuple(rows))


def current_name(file: str, quantity: str) -> str:
    """Return the name that ``quantity`` has today, with a `RenamedWarning` if ``file`` has an earlier one."""
    if quantity not in RENAMED_QUANTITIES:
        return quantity
    name = RENAMED_QUANTITIES[quantity]
    # The message names no line: Python shows equal warnings once, so a table with many such rows gives one notice.
    warnings.warn(RenamedWarning(one_line(f"{file}: quantity: {quantity} is now called {name}; rename it")), stacklevel=2)
    return name


def _read(path: Path, sha256: str | None) -> str:
    """Return the text of a table, after checking its size and checksum."""
    try:
        with path.open("rb") as stream:
            raw = stream.read(MAX_TABLE_SIZE + 1)
    except OSError as error:
        raise ScenarioError(one_line(f"{path}: cannot be read: {error.strerror}")) from None
    if len(raw) > MAX_TABLE_SIZE:
        raise ScenarioError(one_line(f"{path}: found more than {MAX_TABLE_SIZE // 1024} KiB, needed a table of events"))
    checksum = hashlib.sha256(raw).hexdigest()
    if sha256 is not None and checksum != sha256.lower():
        message = f"{path}: found SHA-256 {checksum[:12]}..., needed {sha256[:12]}...; it is not the scenario's own table"
        raise ScenarioError(one_line(message))
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        raise _error(str(path), line, "", f"found the byte 0x{raw[error.start]:02x}, needed UTF-8 text") from None


def _row(file: str, line: int, cells: tuple[str, ...]) -> MeasuredEventRow:
    """Return one row of a table, with its values in SI units."""
    if len(cells) != len(COLUMNS):
        raise _error(file, line, "", f"found {len(cells)} columns, needed {len(COLUMNS)}: {','.join(COLUMNS)}")
    quantity, index, measured, numerical, unit = cells
    if not quantity:
        raise _error(file, line, "quantity", "found nothing, needed a name; write for example 'halting_time'")
    # isascii, as other scripts have digits, too; nine digits at most, as int() itself refuses thousands
    if not (index.isascii() and index.isdigit() and 0 < int(index[:9]) and len(index) < 10):
        raise _error(file, line, "index", f"found {quote(index)}, needed a whole number from 1")
    si = _si_unit(file, line, unit)
    return MeasuredEventRow(
        quantity=current_name(file, quantity),
        index=int(index),
        measured=_number(file, line, "measured", measured, unit, si),
        paper_numerical=_number(file, line, "paper_numerical", numerical, unit, si),
        unit=si,
    )


def _si_unit(file: str, line: int, unit: str) -> str:
    """Return the SI unit of the same dimension as ``unit``."""
    for si in _SI_UNITS:
        try:
            to_si(f"1 {unit}", si)
        except UnitError:
            continue
        return si
    raise _error(file, line, "unit", f"found {quote(unit)}, needed a unit of time, length or angle; write for example 's'")


def _number(file: str, line: int, column: str, text: str, unit: str, si: str) -> float | None:
    """Return the value of a cell [SI]; None for an empty cell."""
    if not text:
        return None
    try:
        return to_si(f"{text} {unit}", si)
    except UnitError:
        raise _error(file, line, column, f"found {quote(text)}, needed a finite number or nothing") from None


def _error(file: str, line: int, column: str, message: str) -> ScenarioError:
    """Return an error with its place in the table."""
    return ScenarioError(one_line(f"{file}:{line}: {column + ': ' if column else ''}{message}"))
