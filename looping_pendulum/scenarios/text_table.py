"""Lines and cells of a text table, cut in one way for every reader: line numbers and cells then agree between them."""

from __future__ import annotations

import csv
import re

LONGEST_LINE = 100_000
"""[characters]; a row of measured data has some hundred, and the csv module refuses a cell of more than 131 072."""
_LINE_ENDS = re.compile(r"\r\n|\r|\n")


def lines(text: str) -> list[tuple[int, str]]:
    """Lines of ``text`` with their numbers, from 1; an editor counts the same line ends."""
    return list(enumerate(_LINE_ENDS.split(text), start=1))


def cells(line: str, delimiter: str) -> tuple[str, ...]:
    """Cells of a line without the spaces around them; ``delimiter`` ' ' is any white space."""
    if delimiter == " ":
        return tuple(line.split())
    return tuple(cell.strip() for cell in next(csv.reader([line], delimiter=delimiter)))
