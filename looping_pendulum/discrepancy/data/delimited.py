"""Text tables as people's programs write them, to rows of cells: encoding, delimiter, decimal comma, header.

Nothing here knows physics. Every fault is a `DataError` of one line that names file, line and column.
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
"""[bytes]; an hour of marks at 240 fps."""
MISSING = frozenset({"", "-", "--", "nan", "na", "n/a", "null", "none"})
"""Cells that say that there is no mark, in lower case."""
_POINT = re.compile(r"[+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]{1,4})?")
_COMMA = re.compile(r"[+-]?[0-9]*,[0-9]+(?:[eE][+-]?[0-9]{1,4})?")
_FOREIGN = {
    b"PK\x03\x04": "a zip archive (a spreadsheet or a Tracker project)",
    b"\xd0\xcf\x11\xe0": "an old spreadsheet",
    b"<?xml": "XML (a Tracker project?)",
    b"%PDF": "a PDF",
}


@dataclass(frozen=True, kw_only=True)
class TableLine:
    """One line of the file."""

    line: int
    cells: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class DelimitedTable:
    """A text table."""

    file: str
    delimiter: str
    """Tab, semicolon, comma, or ' ' for any white space."""
    decimal_comma: bool
    head: tuple[TableLine, ...]
    """Rows above the first row of numbers."""
    rows: tuple[TableLine, ...]
    multi: bool
    """Whether the file begins with Tracker's line for several tracks."""

    def error(self, line: int | None, column: str, message: str) -> DataError:
        """Return an error about a place in the file."""
        return data_error(self.file, line, column, message)

    def number(self, row: TableLine, index: int, column: str) -> float | None:
        """Value of a cell; None where there is none.

        Raises
        ------
        DataError
            If the cell has something else.
        """
        text = row.cells[index] if index < len(row.cells) else ""
        if text.lower() in MISSING:
            return None
        plain = text.replace(",", ".") if self.decimal_comma and _COMMA.fullmatch(text) else text
        if not _POINT.fullmatch(plain):
            wanted = "a number or an empty cell"
            raise self.error(row.line, column, f"found {quote(text)}, needed {wanted}; correct the cell, or empty it")
        value = float(plain)
        if not math.isfinite(value):
            raise self.error(row.line, column, f"found {quote(text)}, needed a finite number; correct the cell, or empty it")
        return value


def data_error(file: str, line: int | None, column: str, message: str) -> DataError:
    """Return an error about a place in a file: 'clip.csv:7: column x: found ..., needed ...'."""
    where = f"{file}:{line}" if line else file
    return DataError(one_line(f"{where}: {'column ' + column + ': ' if column else ''}{message}"))


def read_table(path: str | Path, worded: str = "") -> DelimitedTable:
    """Read a text table.

    Parameters
    ----------
    worded
        Name of a first column that holds words, not numbers: below such a name all is data.

    Raises
    ------
    DataError
        If it is none.
    """
    file = os.fspath(path)
    text = _decode(_bytes(Path(path), file), file)
    lines = text_table.lines(text)
    multi = any(line.lstrip().lower().startswith("#multi") for _, line in lines[:3])
    lines = [(n, line) for n, line in lines if line.strip() and not line.lstrip().startswith("#")]
    if not lines:
        raise data_error(file, None, "", "found no rows, needed a table of numbers; export the data again")
    for number, line in lines:
        if len(line) > text_table.LONGEST_LINE:
            message = f"found a line of {len(line)} characters, needed rows of at most {text_table.LONGEST_LINE}"
            raise data_error(file, number, "", f"{message}; export the data again")
    delimiter, decimal_comma = _dialect([line for _, line in lines])
    rows = [TableLine(line=n, cells=text_table.cells(line, delimiter)) for n, line in lines]
    named = next((i + 1 for i, row in enumerate(rows) if worded and row.cells[0].lower() == worded), None)
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
            raw = stream.read(LARGEST_FILE + 1)
    except OSError as error:
        raise data_error(file, None, "", f"cannot be read: {error.strerror}") from None
    except ValueError:
        raise data_error(file, None, "", "cannot be read: it is no possible file name") from None
    if len(raw) > LARGEST_FILE:
        size = f"{LARGEST_FILE // 1024**2} MiB"
        raise data_error(file, None, "", f"found more than {size}, needed one trial; cut the file to the trial's frames")
    return raw


def _decode(raw: bytes, file: str) -> str:
    way_out = "export it as text (in Tracker: File > Export > Data)"
    for start, what in _FOREIGN.items():
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
    """Delimiter, and whether numbers have a decimal comma."""
    for delimiter in ("\t", ";"):
        if sum(delimiter in line for line in lines) * 2 > len(lines):
            cells = [cell for line in lines for cell in text_table.cells(line, delimiter)]
            return delimiter, any(_COMMA.fullmatch(c) for c in cells)
    last = lines[-1].split()
    if len(last) > 1 and all(_POINT.fullmatch(c) or _COMMA.fullmatch(c) for c in last):
        return " ", any(_COMMA.fullmatch(c) for line in lines for c in line.split())
    return ("," if any("," in line for line in lines) else " "), False


def _is_data(cells: tuple[str, ...], decimal_comma: bool) -> bool:
    """Whether a row is one of numbers: its first cell is, which is the time, or most of its cells are.

    One whose first cell is empty has the names of tracks, even if they are numbers.
    """
    filled = [c for c in cells if c]
    numbers = [bool(_POINT.fullmatch(c) or (decimal_comma and _COMMA.fullmatch(c))) for c in filled]
    return bool(cells[0]) and (numbers[0] or 2 * sum(numbers) > len(filled))


def _refuse_mixed_decimals(table: DelimitedTable) -> None:
    for row in table.rows:
        for index, cell in enumerate(row.cells):
            if "." in cell and (_POINT.fullmatch(cell) or "," in cell):
                message = f"found {quote(cell)} among numbers with a decimal comma, needed one kind; replace one by the other"
                raise table.error(row.line, str(index + 1), message)
