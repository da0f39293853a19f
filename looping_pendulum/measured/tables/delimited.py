"""From the bytes of a text table to rows of cells: encoding, comments, delimiter and decimal sign, found once for the file.

The way of a table is: bytes -> dialect -> rows of cells (here) -> header, units and names (`names`, `columns`) -> places
(`forms`) -> times (`times`) -> `Observations` (`readers`).

Each cell is parsed once, so that nothing behind this module knows of decimal commas, thousands or clocks, and nothing here
knows physics. Every fault is a `DataError` of one line that names file, line and column.
"""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from looping_pendulum.errors import WayOut
from looping_pendulum.files import read_file
from looping_pendulum.measured.observations import DataError
from looping_pendulum.scenarios.document import quote

LARGEST_FILE = 20 * 1024 * 1024
"""Largest size of a file that is read [bytes]."""
MAX_LINES = 100_000
"""Largest number of lines: seven minutes of film at 240/s."""
MAX_CELLS = 1_000_000
"""Largest number of cells, each of which takes some microseconds."""
MAX_LINE_LENGTH = 20_000
"""Longest line that is read [characters]; a row of measured data has about a hundred."""
MISSING = frozenset({"", "-", "--", "–", "—", "nan", "na", "n/a", "#n/a", "null", "none", "1.#qnan", "-1.#ind"})
"""Cells that say that there is no value, in lower case."""
DELIMITERS = ("\t", ";", "|", ",", " ")
"""Delimiters, the likelier first where several divide a table equally well; ' ' stands for any white space."""
SAMPLE_LINES = 100
"""Number of lines at either end of a table by which its delimiter is recognised."""
SAMPLE_LENGTH = 4000
"""Number of characters of each of these lines."""
LARGEST_NUMBER = 1e100
"""Largest number that is read, and of the smallest that is not zero the inverse: squares are finite in any unit."""
MAX_LISTED = 5
"""Largest number of names or lines that a sentence lists."""
_COMMENT_SIGNS = ("#", "%")
_SWAPPED_SIGNS = str.maketrans(",.", ".,")
# A number with a decimal point, whose thousands may be separated: "1,075.5", "1 075"
_NUMBER = re.compile(
    r"[+-]?(?=\.?[0-9])(?:[1-9][0-9]{0,2}(?:[, \u00a0\u202f'\u2019][0-9]{3})+|[0-9]*)(?:\.[0-9]*)?(?:[eE][+-]?[0-9]{1,4})?"
)
_BETWEEN_THOUSANDS = re.compile(r"[, \u00a0\u202f'\u2019]")
# Hours may lack, and a date may stand before: "0:12.5", "00:00:12.50", "2024-05-03T10:22:31.250Z". At midnight it is a date
_CLOCK = re.compile(
    r"(?:[0-9]{4}-[0-9]{2}-[0-9]{2}[T ](?!00:00:00$))?(?:([0-9]+):)?([0-9]{1,2}):([0-9]{2})(?:[.,]([0-9]+)|:([0-9]{2,3}))?"
    r"(?:Z|[+-][0-9]{2}:?[0-9]{2})?"
)
# A third colon has hundredths behind it (Kinovea) if one of them is too large for a frame's number, else perhaps frames
_HUNDREDTHS = re.compile(r":[0-9]{2}:[0-9]{2}:(?:[6-9][0-9]|[0-9]{3})")
# Signs that programs write for a minus before a number: macOS Numbers writes U+2212
_MINUS_SIGNS = re.compile(r"[\u2212\u2012\u2013\ufe63\uff0d](?=[0-9.,])")
_HAS_DIGIT = re.compile(r"[0-9]")
_DIGITS = re.compile(r"[+-]?([0-9]*)\.?([0-9]*)(?:[eE]([+-]?[0-9]+))?")
_SEPARATOR_LINE = re.compile(r'\s*"?sep=(.)"?\s*', re.IGNORECASE)
# Not str.splitlines, which also splits at form feeds and other characters at which editors do not
_LINE_ENDS = re.compile(r"\r\n|\r|\n")
_OTHER_FORMATS = {
    b"PK\x03\x04": "a zip archive (a spreadsheet?)", b"\xd0\xcf\x11\xe0": "an old spreadsheet", b"<": "XML", b"{": "JSON",
    b"[": "JSON", b"%PDF": "a PDF",
}  # fmt: skip
_AS_TEXT = (
    "needed a text table; export it as text (in Tracker: File > Export > Data File; in Logger Pro: File > Export As > CSV; "
    "in Kinovea: Tools > Export to spreadsheet)"
)


@dataclass(frozen=True, kw_only=True)
class TableLine:
    """One line of the file, split into cells."""

    line: int
    """Number of the line in the file, from 1."""
    cells: tuple[str, ...]
    """Numbers have a decimal point and no signs between thousands; times of a clock are in seconds."""
    values: tuple[float, ...] = ()
    """Number in each cell; not a number: it holds a text or nothing; infinite: a number that cannot be read."""

    @property
    def filled(self) -> list[str]:
        """Return the cells that are not empty."""
        return [c for c in self.cells if c]

    def cell(self, index: int) -> str:
        """Return a cell, '' where the line has no such one."""
        return self.cells[index] if index < len(self.cells) else ""

    def value(self, index: int) -> float:
        """Return the number in a cell, as `values`."""
        return self.values[index] if index < len(self.values) else math.nan


@dataclass(frozen=True, kw_only=True)
class DelimitedText:
    """Lines of cells of a text table."""

    file: str
    delimiter: str
    """One of `DELIMITERS`."""
    decimal_comma: bool
    comments: Sequence[TableLine]
    """Lines that began with a sign of comments, without it."""
    lines: Sequence[TableLine]
    """All other lines that are not empty."""
    notes: tuple[str, ...] = ()
    """Sentences about what was used and what was left out, of a file from which the table was made."""

    def error(self, line: int | None, column: str, message: str, way_out: WayOut | None = None) -> DataError:
        """Return an error about a place in the file."""
        return data_error(self.file, line, column, message, way_out)

    def number(self, row: TableLine, index: int, column: str) -> float:
        """Return the value of a cell; not a number if it is empty or says that there is none.

        Raises
        ------
        DataError
            If the cell holds anything else.
        """
        text, value = row.cell(index), row.value(index)
        if math.isfinite(value) or text.lower() in MISSING:
            return value
        if _CLOCK.fullmatch(text):
            needed = ", whose last part may count frames or hundredths, needed seconds; export the times in seconds"
        elif self.decimal_comma and "." in text and _NUMBER.fullmatch(text):
            needed = " among numbers with a decimal comma, needed one kind; replace one by the other"
        else:
            needed = ", needed a finite number or an empty cell; correct the cell, or empty it"
            if _HAS_DIGIT.search(text):
                needed += (
                    "; if a spreadsheet made a date of a number, import the measured table again with its columns as text, and "
                    "export that"
                )
        raise self.error(row.line, column, f"found {quote(text)}{needed}")


def listed(names: Sequence[str]) -> str:
    """Return names for a message: the first few, and how many more there are."""
    more = f" and {len(names) - MAX_LISTED} more" if len(names) > MAX_LISTED else ""
    return ", ".join(names[:MAX_LISTED]) + more


def data_error(
    file: str, line: int | None, column: str, message: str, way_out: WayOut | None = None, kind: type[DataError] = DataError
) -> DataError:
    """Return an error about a place in a file: 'clip.csv:7: column x: found ..., needed ...'."""
    where = f"{file}:{line}" if line else file
    return kind(f"{where}: {'column ' + column + ': ' if column else ''}{message}", way_out)


def read_bytes(path: str | Path, file: str, largest: int = LARGEST_FILE) -> bytes:
    """Return the content of a file.

    Raises
    ------
    DataError
        If it cannot be read or has more than ``largest`` bytes.
    """
    try:
        raw = read_file(path, largest)
    except ValueError:
        raise data_error(file, None, "", "cannot be read: this is not a valid file name") from None
    except OSError as error:
        raise data_error(file, None, "", f"cannot be read: {error.strerror}") from None
    _refuse_size(file, -(-len(raw) // 1024**2), largest // 1024**2, "MiB")
    return raw


def _refuse_size(file: str, size: int, largest: int, unit: str, line: int | None = None) -> None:
    if size > largest:
        message = f"found more than {largest} {unit}, needed one trial; export the trial's frames and two masses alone"
        raise data_error(file, line, "", message)


def read_text(raw: bytes, file: str, delimiters: Sequence[str] = DELIMITERS) -> DelimitedText:
    """Split the content of a text table, by one of ``delimiters``, into lines of cells.

    Raises
    ------
    DataError
        If it is no text table, or too large.
    """
    text = _decode(raw, file)
    _refuse_size(file, text.count("\n") + text.count("\r"), 2 * MAX_LINES, "lines")
    # Counted as an editor does
    numbered = [(n, line.strip("\ufeff")) for n, line in enumerate(_LINE_ENDS.split(text), start=1)]
    # A line of tabs may be a row without points, a lone quotation mark is none
    numbered = [(n, line) for n, line in numbered if "\t" in line or line.strip().strip('\ufeff" ')]
    comments = [(n, line.lstrip().lstrip("#%")) for n, line in numbered if line.lstrip().startswith(_COMMENT_SIGNS)]
    lines = [(n, line) for n, line in numbered if not line.lstrip().startswith(_COMMENT_SIGNS)]
    # A line for spreadsheets that names the delimiter
    separator = _SEPARATOR_LINE.fullmatch(lines[0][1]) if lines else None
    if separator:
        lines = lines[1:]
    delimiters = [separator[1]] if separator and separator[1] in DELIMITERS else delimiters
    delimiter, decimal_comma = _dialect([line for _, line in lines], delimiters)
    for number, line in numbered:
        _refuse_size(file, len(line), MAX_LINE_LENGTH, "characters in a line", number)
    _refuse_size(file, len(lines), MAX_LINES, "lines")
    _refuse_size(file, sum(line.count(delimiter) for _, line in numbered), MAX_CELLS, "cells")
    has_hundredths = bool(_HUNDREDTHS.search(text))
    table = []
    for number, cells in _split(lines, delimiter, file):
        parsed = [_parse_cell(cell, decimal_comma, has_hundredths) for cell in cells]
        table.append(TableLine(line=number, cells=tuple(c for c, _ in parsed), values=tuple(v for _, v in parsed)))
    if not table:
        raise data_error(file, None, "", "found no rows, needed a table of numbers; export the data again")
    titles = [TableLine(line=n, cells=tuple(cells)) for n, cells in _split(comments, delimiter, file)]
    return DelimitedText(file=file, delimiter=delimiter, decimal_comma=decimal_comma, comments=titles, lines=table)


def _split(numbered: Sequence[tuple[int, str]], delimiter: str, file: str = "") -> list[tuple[int, list[str]]]:
    """Return the cells of each line; one with a quoted break goes on in the next lines."""
    lines = (f"{' '.join(line.split()) if delimiter == ' ' else line}\n" for _, line in numbered)
    reader = csv.reader(lines, delimiter=delimiter, skipinitialspace=True)
    try:
        split = [(numbered[reader.line_num - 1][0], [" ".join(cell.split()) for cell in cells]) for cells in reader]
    except csv.Error as error:
        line = numbered[reader.line_num - 1][0]
        raise data_error(file, line, "", f"found {error}, needed quotation marks in pairs; export the data again") from None
    return [(number, cells) for number, cells in split if cells not in ([], [""])]


def _parse_cell(text: str, decimal_comma: bool, has_hundredths: bool = True) -> tuple[str, float]:
    """Return text and value of a cell, as `TableLine` has them. The last digit of a number stays the last one."""
    if not _HAS_DIGIT.search(text):
        return text, math.nan
    plain = text.translate(_SWAPPED_SIGNS) if decimal_comma else text
    if _NUMBER.fullmatch(plain):
        plain = _BETWEEN_THOUSANDS.sub("", plain)
        value = float(plain)
        if abs(value) > LARGEST_NUMBER:
            return text, math.inf
        return plain, 0.0 if abs(value) * LARGEST_NUMBER < 1 else value
    clock = _CLOCK.fullmatch(text)
    if clock is None or (clock[5] and not has_hundredths):
        return text, math.nan if clock is None else math.inf
    hours, minutes, seconds, *parts = clock.groups()
    plain = f"{3600 * int(hours or 0) + 60 * int(minutes) + int(seconds)}.{next(filter(None, parts), '')}"
    return plain, float(plain)


def last_digits(texts: Sequence[str]) -> list[float]:
    """Return what one unit of the last digit that tells anything is worth, of each number of a column.

    Programs write a column with so many decimals or with so many digits, and some add or leave out zeros at the end. So these
    do not count, and the number with the most digits tells for all: of "0", "0.00416667" and "0.5" the last digit of the third
    is worth 1e-6, and of "4.000000E-03" and "8.000000E-03" that of both 0.001.
    """
    parts = []
    for text in texts:
        match = _DIGITS.fullmatch(text)
        whole, printed, power = (match[1], match[2], int(match[3] or 0)) if match else ("", "", 0)
        decimals = printed.rstrip("0")
        digits = (whole + decimals).lstrip("0")
        # 12.50e-3: three digits, the first at 10^-2, the last at 10^-4, and printed to 10^-5
        last = power - len(decimals)
        parts.append((len(digits), last, last + len(digits) - 1, power - len(printed)))
    most = max((n for n, *_ in parts), default=0)
    lowest = min((last for n, last, *_ in parts if n), default=0)
    # As text, since 10.0**power raises OverflowError for large powers
    return [float(f"1e{max(lowest, min(first + 1 - most, printed)) if n else lowest}") for n, _, first, printed in parts]


def _decode(raw: bytes, file: str) -> str:
    """Return the text of a file; older programs on Windows wrote their own code page, in which numbers are the same."""
    is_utf16 = raw.startswith((b"\xff\xfe", b"\xfe\xff"))
    # XML may begin with a byte order mark
    begins = raw[:1024].removeprefix(b"\xef\xbb\xbf").lstrip()
    other = next((what for sign, what in _OTHER_FORMATS.items() if begins.startswith(sign)), "")
    try:
        text = raw.decode("utf-16" if is_utf16 else "utf-8-sig")
    except UnicodeDecodeError:
        text = raw.decode("latin-1")
    if other or "\0" in text:
        raise data_error(file, None, "", f"found {other or 'binary data'}, {_AS_TEXT}")
    return _MINUS_SIGNS.sub("-", text)


def _dialect(lines: Sequence[str], delimiters: Sequence[str]) -> tuple[str, bool]:
    """Return the delimiter and whether numbers have a decimal comma: those with which rows have most numbers or empty cells."""
    sample = lines if len(lines) <= 2 * SAMPLE_LINES else [*lines[:SAMPLE_LINES], *lines[-SAMPLE_LINES:]]
    numbered = [(n, line[:SAMPLE_LENGTH]) for n, line in enumerate(sample)]
    best, most = (delimiters[0], False), -1
    for delimiter in delimiters:
        rows = [cells for _, cells in _split(numbered, delimiter) if len(cells) > 1]
        for decimal_comma in (False, True):
            counts = [sum(not c or not math.isnan(_parse_cell(c, decimal_comma)[1]) for c in cells) for cells in rows]
            # Of names such as "X 2" between tabs, white space would make more numbers
            count = sum(n for n, cells in zip(counts, rows, strict=True) if 2 * n > len(cells))
            if count > most:
                best, most = (delimiter, decimal_comma), count
    return best
