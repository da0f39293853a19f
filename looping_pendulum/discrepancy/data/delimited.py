"""Read text tables, as spreadsheets and video analysis programs write them, into rows of cells.

Encoding, delimiter, decimal comma and header are recognised. Nothing here knows physics. Every fault is a `DataError` of one
line that names file, line and column.
"""

from __future__ import annotations

import math
import os
import re
from dataclasses import dataclass
from pathlib import Path

from looping_pendulum.discrepancy.data.observations import DataError
from looping_pendulum.scenarios import text_table
from looping_pendulum.scenarios.document import one_line, quote

LARGEST_FILE = 20 * 1024 * 1024
"""Largest size of a file that is read [bytes]: an hour of tracked points at 240 fps."""
MISSING = frozenset({"", "-", "--", "nan", "na", "n/a", "null", "none"})
"""Cells that say that there is no value, in lower case."""
_DECIMAL_POINT = re.compile(r"[+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]{1,4})?")
_DECIMAL_COMMA = re.compile(r"[+-]?[0-9]*,[0-9]+(?:[eE][+-]?[0-9]{1,4})?")
_OTHER_FORMATS = {
    b"PK\x03\x04": "a zip archive (a spreadsheet or a Tracker project)",
    b"\xd0\xcf\x11\xe0": "an old spreadsheet",
    b"<?xml": "XML (a Tracker project?)",
    b"%PDF": "a PDF",
}


@dataclass(frozen=True, kw_only=True)
class TableLine:
    """One line of the file, split into cells."""

    line: int
    """Number of the line in the file, from 1."""
    cells: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class DelimitedTable:
    """A text table: lines of a header, then rows of numbers."""

    file: str
    delimiter: str
    """Tab, semicolon or comma; ' ' stands for any white space."""
    decimal_comma: bool
    head: tuple[TableLine, ...]
    """Lines above the first row of numbers."""
    rows: tuple[TableLine, ...]
    multi: bool
    """Whether the file begins with Tracker's line for several tracks."""

    def error(self, line: int | None, column: str, message: str) -> DataError:
        """Return an error about a place in the file."""
        return data_error(self.file, line, column, message)

    def number(self, row: TableLine, index: int, column: str) -> float | None:
        """Return the value of a cell; None if it is empty or says that there is none.

        Raises
        ------
        DataError
            If the cell holds anything else.
        """
        text = row.cells[index] if index < len(row.cells) else ""
        if text.lower() in MISSING:
            return None
        with_point = text.replace(",", ".") if self.decimal_comma and _DECIMAL_COMMA.fullmatch(text) else text
        if not _DECIMAL_POINT.fullmatch(with_point):
            message = f"found {quote(text)}, needed a number or an empty cell; correct the cell, or empty it"
            raise self.error(row.line, column, message)
        value = float(with_point)
        if not math.isfinite(value):
            raise self.error(row.line, column, f"found {quote(text)}, needed a finite number; correct the cell, or empty it")
        return value


def data_error(file: str, line: int | None, column: str, message: str) -> DataError:
    """Return an error about a place in a file: 'clip.csv:7: column x: found ..., needed ...'."""
    where = f"{file}:{line}" if line else file
    return DataError(one_line(f"{where}: {'column ' + column + ': ' if column else ''}{message}"))


def read_table(path: str | Path, text_column: str = "") -> DelimitedTable:
    """Read a text table.

    Parameters
    ----------
    text_column
        Name of a first column that holds text. If the header begins with it, all rows below are data although their first cell
        is no number.

    Raises
    ------
    DataError
        If the file cannot be read or is no text table.
    """
    file = os.fspath(path)
    text = _decode(_bytes(Path(path), file), file)
    lines = text_table.lines(text)
    # Before lines with "#" are left out as comments
    multi = any(line.lstrip().lower().startswith("#multi") for _, line in lines[:3])
    lines = [(n, line) for n, line in lines if line.strip() and not line.lstrip().startswith("#")]
    if not lines:
        raise data_error(file, None, "", "found no rows, needed a table of numbers; export the data again")
    for number, line in lines:
        if len(line) > text_table.MAX_LINE_LENGTH:
            message = f"found a line of {len(line)} characters, needed rows of at most {text_table.MAX_LINE_LENGTH}"
            raise data_error(file, number, "", f"{message}; export the data again")
    delimiter, decimal_comma = _dialect([line for _, line in lines])
    rows = [TableLine(line=n, cells=text_table.cells(line, delimiter)) for n, line in lines]
    named = next((i + 1 for i, row in enumerate(rows) if text_column and row.cells[0].lower() == text_column), None)
    first = named or next((i for i, row in enumerate(rows) if _is_data(row.cells, decimal_comma)), len(rows))
    if first == len(rows):
        raise data_error(
            file, rows[-1].line, "", f"found no row of numbers (last row {quote(lines[-1][1].strip())}), needed rows such as "
            "'0.0042,0.51,-0.22'; export the data again, as numbers without units",
        )  # fmt: skip
    table = DelimitedTable(
        file=file,
        delimiter=delimiter,
        decimal_comma=decimal_comma,
        head=tuple(rows[:first]),
        rows=tuple(rows[first:]),
        multi=multi,
    )
    if decimal_comma:
        _refuse_mixed_decimals(table)
    return table


def _bytes(path: Path, file: str) -> bytes:
    try:
        with path.open("rb") as stream:
            # One byte more than is allowed tells that a file is too large, however large it is
            raw = stream.read(LARGEST_FILE + 1)
    except OSError as error:
        raise data_error(file, None, "", f"cannot be read: {error.strerror}") from None
    except ValueError:
        raise data_error(file, None, "", "cannot be read: this is not a valid file name") from None
    if len(raw) > LARGEST_FILE:
        size = f"{LARGEST_FILE // 1024**2} MiB"
        raise data_error(file, None, "", f"found more than {size}, needed one trial; cut the file to the trial's frames")
    return raw


def _decode(raw: bytes, file: str) -> str:
    way_out = "export it as text (in Tracker: File > Export > Data)"
    for start, what in _OTHER_FORMATS.items():
        # XML may begin with a byte order mark
        if raw.removeprefix(b"\xef\xbb\xbf").startswith(start):
            raise data_error(file, None, "", f"found {what}, needed a text table; {way_out}")
    try:
        if raw.startswith((b"\xff\xfe", b"\xfe\xff")):
            return raw.decode("utf-16")
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        # Older programs on Windows write names such as "Kugel grün" in their own code page; the numbers are the same in all.
        text = raw.decode("latin-1")
    if "\0" in text:
        raise data_error(file, None, "", f"found binary data, needed a text table; {way_out}")
    return text


def _dialect(lines: list[str]) -> tuple[str, bool]:
    """Return the delimiter, and whether numbers have a decimal comma.

    A comma is taken for the delimiter only if neither tab nor semicolon is in most lines: beside those it is a decimal comma.
    """
    for delimiter in ("\t", ";"):
        if sum(delimiter in line for line in lines) * 2 > len(lines):
            cells = [cell for line in lines for cell in text_table.cells(line, delimiter)]
            return delimiter, any(_DECIMAL_COMMA.fullmatch(c) for c in cells)
    # The last line holds numbers, whatever the lines of the header look like
    last = lines[-1].split()
    if len(last) > 1 and all(_DECIMAL_POINT.fullmatch(c) or _DECIMAL_COMMA.fullmatch(c) for c in last):
        return " ", any(_DECIMAL_COMMA.fullmatch(c) for line in lines for c in line.split())
    return ("," if any("," in line for line in lines) else " "), False


def _is_data(cells: tuple[str, ...], decimal_comma: bool) -> bool:
    """Return whether a line is a row of numbers: its first cell, the time, is a number, or most of its cells are.

    A line whose first cell is empty has the names of tracks, even if these are numbers.
    """
    filled = [c for c in cells if c]
    numbers = [bool(_DECIMAL_POINT.fullmatch(c) or (decimal_comma and _DECIMAL_COMMA.fullmatch(c))) for c in filled]
    return bool(cells[0]) and (numbers[0] or 2 * sum(numbers) > len(filled))


def _refuse_mixed_decimals(table: DelimitedTable) -> None:
    """Refuse a decimal point among decimal commas: the point could as well separate thousands."""
    for row in table.rows:
        for index, cell in enumerate(row.cells):
            if "." in cell and (_DECIMAL_POINT.fullmatch(cell) or "," in cell):
                message = f"found {quote(cell)} among numbers with a decimal comma, needed one kind; replace one by the other"
                raise table.error(row.line, str(index + 1), message)
