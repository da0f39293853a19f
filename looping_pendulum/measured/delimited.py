"""Read text tables, as spreadsheets and video analysis programs write them, into lines of cells.

Encoding, comments, delimiter and decimal comma are seen by content, and cells get one writing: numbers lose the signs that
separate thousands, and times of a clock become seconds. Nothing here knows physics. Every fault is a `DataError` of one line
that names file, line and column.
"""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from looping_pendulum.errors import WayOut
from looping_pendulum.measured.observations import DataError
from looping_pendulum.scenarios.document import one_line, quote

LARGEST_FILE = 20 * 1024 * 1024
"""Largest size of a file that is read [bytes]: an hour of tracked points at 240 fps."""
MISSING = frozenset({"", "-", "--", "–", "—", "nan", "na", "n/a", "#n/a", "null", "none", "1.#qnan", "-1.#ind"})
"""Cells that say that there is no value, in lower case."""
DELIMITERS = ("\t", ";", "|", ",", " ")
"""Delimiters, the likelier first where several divide a table equally well; ' ' stands for any white space."""
SAMPLE_LINES = 100
"""Number of lines at either end of a table by which its delimiter is told."""
LARGEST_NUMBER = 1e100
"""Largest number that is read, and of the smallest that is not zero the inverse: squares are finite in any unit."""
MAX_LINE_LENGTH = 100_000
"""Longest line that is read [characters].

A row of measured data has about a hundred, and the csv module refuses a cell of more than 131 072.
"""
MAX_BREAKS = 20
"""Largest number of breaks in quoted cells of one line."""
MIN_HUNDREDTHS = 60
"""Smallest number behind a third colon that cannot count the frames of a second of film, so that all are hundredths."""
MAX_LISTED = 5
"""Largest number of names or lines that a sentence lists."""
COMMENT_SIGNS = ("#", "%")
"""Beginnings of lines that are comments."""
_DECIMAL_POINT = re.compile(r"[+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]{1,4})?")
_DECIMAL_COMMA = re.compile(r"[+-]?(?:[0-9]+(?:,[0-9]+)?|,[0-9]+)(?:[eE][+-]?[0-9]{1,4})?")
# Thousands that are separated: "1,075" and "1 075.5" beside a decimal point, "1.075" and "1 075,5" beside a decimal comma
_GROUPED_POINT = re.compile(r"[+-]?[1-9][0-9]{0,2}(?:[, \u00a0\u202f'\u2019][0-9]{3})+(?:\.[0-9]*)?")
_GROUPED_COMMA = re.compile(r"[+-]?[1-9][0-9]{0,2}(?:[. \u00a0\u202f'\u2019][0-9]{3})+(?:,[0-9]+)?")
# Hours may lack, and a date may stand before: "0:12.5", "00:00:12.50", "2024-05-03T10:22:31.250Z"; a fourth part is told apart
_CLOCK = re.compile(
    r"(?:[0-9]{4}-[0-9]{2}-[0-9]{2}[T ])?(?:([0-9]+):)?([0-9]{1,2}):([0-9]{2})(?:[.,]([0-9]+)|:([0-9]{2,3}))?"
    r"(?:Z|[+-][0-9]{2}:?[0-9]{2})?"
)
_MINUS_SIGNS = re.compile(r"[\u2212\u2012\u2013\ufe63\uff0d](?=[0-9.,])")
"""Signs that programs write for a minus before a number: macOS Numbers writes U+2212."""
_DIGITS = re.compile(r"[+-]?([0-9]*)[.,]?([0-9]*)(?:[eE]([+-]?[0-9]+))?")
_SEPARATOR_LINE = re.compile(r'\s*"?sep=(.)"?\s*', re.IGNORECASE)
# A line of tabs may be a row without points
_BLANK = re.compile(r"[^\S\t]*\ufeff?[^\S\t]*")
_WORDS = re.compile(r'"([^"]*)"|([^\s"]+)')
# Not str.splitlines, which also splits at form feeds and other characters at which editors do not
_LINE_ENDS = re.compile(r"\r\n|\r|\n")
_OTHER_FORMATS = {
    b"PK\x03\x04": "a zip archive (a spreadsheet?)",
    b"\xd0\xcf\x11\xe0": "an old spreadsheet",
    b"<": "XML",
    b"{": "JSON",
    b"[": "JSON",
    b"%PDF": "a PDF",
}
EXPORTS = (
    "in Tracker: File > Export > Data File; in Logger Pro: File > Export As > CSV; in Kinovea: Tools > Export to spreadsheet"
)
"""How programs whose own files are no tables export one."""


@dataclass(frozen=True, kw_only=True)
class TableLine:
    """One line of the file, split into cells."""

    line: int
    """Number of the line in the file, from 1."""
    cells: tuple[str, ...]

    @property
    def filled(self) -> list[str]:
        """Return the cells that are not empty."""
        return [c for c in self.cells if c]

    def cell(self, index: int) -> str:
        """Return a cell, '' where the line has no such one."""
        return self.cells[index] if index < len(self.cells) else ""


@dataclass(frozen=True, kw_only=True)
class DelimitedText:
    """Lines of cells of a text table."""

    file: str
    delimiter: str
    """One of `DELIMITERS`."""
    decimal_comma: bool
    comments: Sequence[TableLine]
    """Lines that began with "#", without it."""
    lines: Sequence[TableLine]
    """All other lines that are not empty."""

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
        text = row.cell(index)
        if text.lower() in MISSING:
            return math.nan
        needed = ""
        if self.decimal_comma and "." in text and (_DECIMAL_POINT.fullmatch(text) or "," in text):
            # The point could as well separate thousands
            needed = " among numbers with a decimal comma, needed one kind; replace one by the other"
        elif not is_number(text, self.decimal_comma):
            needed = ", needed a number or an empty cell; correct the cell, or empty it"
            if _CLOCK.fullmatch(text):
                needed = ", whose last part may count frames or hundredths, needed seconds; export the times in seconds"
        elif abs(float(text.replace(",", "."))) > LARGEST_NUMBER:
            needed = ", needed a finite number; correct the cell, or empty it"
        if needed:
            raise self.error(row.line, column, f"found {quote(text)}{needed}")
        value = float(text.replace(",", "."))
        return 0.0 if abs(value) * LARGEST_NUMBER < 1 else value


def listed(names: Sequence[str]) -> str:
    """Return names for a message: the first few, and how many more there are."""
    more = f" and {len(names) - MAX_LISTED} more" if len(names) > MAX_LISTED else ""
    return ", ".join(names[:MAX_LISTED]) + more


def data_error(
    file: str, line: int | None, column: str, message: str, way_out: WayOut | None = None, kind: type[DataError] = DataError
) -> DataError:
    """Return an error about a place in a file: 'clip.csv:7: column x: found ..., needed ...'."""
    where = f"{file}:{line}" if line else file
    return kind(one_line(f"{where}: {'column ' + column + ': ' if column else ''}{message}"), way_out)


def read_bytes(path: str | Path, file: str, largest: int = LARGEST_FILE) -> bytes:
    """Return the content of a file.

    Raises
    ------
    DataError
        If it cannot be read or has more than ``largest`` bytes.
    """
    try:
        with Path(path).open("rb") as stream:
            # One byte more than is allowed tells that a file is too large, however large it is
            raw = stream.read(largest + 1)
    except (OSError, ValueError) as error:
        why = str(error.strerror) if isinstance(error, OSError) else "this is not a valid file name"
        # YAML takes all behind " #" for a comment
        cut_off = [] if isinstance(error, ValueError) else [p.name for p in Path(path).parent.glob("* #*")]
        cut_off = [name for name in cut_off if name.startswith(f"{Path(path).name} #")]
        if cut_off:
            why += f"; in a study, ' #' begins a comment: write the name in quotes, '{cut_off[0]}'"
        raise data_error(file, None, "", f"cannot be read: {why}") from None
    if len(raw) > largest:
        size = f"{largest // 1024**2} MiB"
        raise data_error(file, None, "", f"found more than {size}, needed one trial; cut the file to the trial's frames")
    return raw


def read_text(raw: bytes, file: str, delimiters: Sequence[str] = DELIMITERS) -> DelimitedText:
    """Split the content of a text table, by one of ``delimiters``, into lines of cells.

    Raises
    ------
    DataError
        If it is no text table.
    """
    numbered = _without_breaks_in_quotes(numbered_lines(_decode(raw, file)))
    numbered = [(n, line.strip("\ufeff")) for n, line in numbered if not _BLANK.fullmatch(line)]
    for number, line in numbered:
        if len(line) > MAX_LINE_LENGTH:
            message = f"found a line of {len(line)} characters, needed rows of at most {MAX_LINE_LENGTH}"
            raise data_error(file, number, "", f"{message}; export the data again")
    comments = [(n, line.lstrip().lstrip("#%")) for n, line in numbered if line.lstrip().startswith(COMMENT_SIGNS)]
    lines = [(n, line) for n, line in numbered if not line.lstrip().startswith(COMMENT_SIGNS)]
    # A line for spreadsheets that names the delimiter
    separator = _SEPARATOR_LINE.fullmatch(lines[0][1]) if lines else None
    if separator:
        lines = lines[1:]
    delimiters = [separator[1]] if separator and separator[1] in DELIMITERS else delimiters
    delimiter, decimal_comma = _dialect([line for _, line in lines], delimiters)

    def split(numbered: list[tuple[int, str]]) -> list[TableLine]:
        split_lines = (TableLine(line=n, cells=split_cells(line, delimiter)) for n, line in numbered)
        return [line for line in split_lines if line.cells != ("",)]

    table = split(lines)
    if not table:
        raise data_error(file, None, "", "found no rows, needed a table of numbers; export the data again")
    parts = [match[5] for line in table for c in line.cells if (match := _CLOCK.fullmatch(c)) and match[5]]
    # Kinovea writes hundredths of a second behind a third colon, others frames
    has_frames = bool(parts) and all(len(part) == 2 and int(part) < MIN_HUNDREDTHS for part in parts)
    return DelimitedText(
        file=file,
        delimiter=delimiter,
        decimal_comma=decimal_comma,
        comments=split(comments),
        lines=[replace(row, cells=tuple(_plain_cell(c, decimal_comma, has_frames) for c in row.cells)) for row in table],
    )


def numbered_lines(text: str) -> list[tuple[int, str]]:
    """Return the lines of ``text`` with their numbers, from 1, counted as an editor does."""
    return list(enumerate(_LINE_ENDS.split(text), start=1))


def _without_breaks_in_quotes(numbered: list[tuple[int, str]]) -> list[tuple[int, str]]:
    """Return the lines with those joined between which a quotation mark is open: a name that a spreadsheet breaks."""
    joined = []
    following = iter(numbered)
    for number, line in following:
        if line.count('"') % 2:
            rest = [text for _, text in numbered[number : number + MAX_BREAKS]]
            last = next((i for i, text in enumerate(rest) if text.count('"') % 2), None)
            if last is not None and rest[last].strip() != '"':
                line = " ".join([line, *(next(following)[1] for _ in range(last + 1))])
        joined.append((number, line))
    return joined


def split_cells(line: str, delimiter: str) -> tuple[str, ...]:
    """Return the cells of a line, at least one, without the spaces around them; the delimiter ' ' means any white space."""
    if delimiter == " ":
        words = (quoted or bare for quoted, bare in _WORDS.findall(line)) if '"' in line else line.split()
        return tuple(words) or ("",)
    return tuple(cell.strip() for cell in next(csv.reader([line], delimiter=delimiter)))


def is_number(text: str, decimal_comma: bool) -> bool:
    """Return whether a cell is a number in the file's writing."""
    return bool((_DECIMAL_COMMA if decimal_comma else _DECIMAL_POINT).fullmatch(text))


def is_value(text: str, decimal_comma: bool) -> bool:
    """Return whether a cell is a number, perhaps with separated thousands, or a time of a clock."""
    grouped = _GROUPED_COMMA if decimal_comma else _GROUPED_POINT
    return is_number(text, decimal_comma) or bool(grouped.fullmatch(text) or _CLOCK.fullmatch(text))


def _plain_cell(text: str, decimal_comma: bool, has_frames: bool) -> str:
    """Return a number without the signs that separate its thousands, a time of a clock in seconds, anything else as it is.

    The last digit of a time stays the last one. A time whose last part may count frames is left as it is.
    """
    if (_GROUPED_COMMA if decimal_comma else _GROUPED_POINT).fullmatch(text):
        decimal = "," if decimal_comma else "."
        return "".join(c for c in text if c in "+-0123456789" + decimal)
    clock = _CLOCK.fullmatch(text)
    if clock is None or (clock[5] and has_frames):
        return text
    hours, minutes, seconds, *parts = clock.groups()
    part = next(filter(None, parts), "")
    whole = 3600 * int(hours or 0) + 60 * int(minutes) + int(seconds)
    return f"{whole}{',' if decimal_comma else '.'}{part}" if part else str(whole)


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
    way_out = f"export it as text ({EXPORTS})"
    for start, what in _OTHER_FORMATS.items():
        # XML may begin with a byte order mark
        if raw.removeprefix(b"\xef\xbb\xbf").lstrip().startswith(start):
            raise data_error(file, None, "", f"found {what}, needed a text table; {way_out}")
    try:
        if raw.startswith((b"\xff\xfe", b"\xfe\xff")):
            return raw.decode("utf-16")
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        # Older programs on Windows write names such as "Kugel grün" in their own code page; the numbers are the same in all.
        text = raw.decode("latin-1")
    text = _MINUS_SIGNS.sub("-", text)
    if "\0" in text:
        raise data_error(file, None, "", f"found binary data, needed a text table; {way_out}")
    return text


def _dialect(lines: Sequence[str], delimiters: Sequence[str]) -> tuple[str, bool]:
    """Return the delimiter and whether numbers have a decimal comma: those with which rows have most numbers or empty cells."""
    sample = lines if len(lines) <= 2 * SAMPLE_LINES else [*lines[:SAMPLE_LINES], *lines[-SAMPLE_LINES:]]
    best, most = (delimiters[0], False), -1
    for delimiter in delimiters:
        rows = [split_cells(line, delimiter) for line in sample]
        for decimal_comma in (False, True):
            counts = [(sum(not c or is_value(c, decimal_comma) for c in cells), len(cells)) for cells in rows if len(cells) > 1]
            # Of names such as "X 2" between tabs, white space would make more numbers
            count = sum(numbers for numbers, width in counts if 2 * numbers > width)
            if count > most:
                best, most = (delimiter, decimal_comma), count
    return best
