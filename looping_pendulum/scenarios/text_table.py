"""Split a text table into lines and cells, in one way for all readers, so that their line numbers and cells agree."""

from __future__ import annotations

import csv
import re

MAX_LINE_LENGTH = 100_000
"""Longest line that is read [characters].

A row of measured data has about a hundred, and the csv module refuses a cell of more than 131 072.
"""
_WORDS = re.compile(r'"([^"]*)"|([^\s"]+)')
# Not str.splitlines, which also splits at form feeds and other characters at which editors do not
_LINE_ENDS = re.compile(r"\r\n|\r|\n")


def lines(text: str) -> list[tuple[int, str]]:
    """Return the lines of ``text`` with their numbers, from 1, counted as an editor does."""
    return list(enumerate(_LINE_ENDS.split(text), start=1))


def cells(line: str, delimiter: str) -> tuple[str, ...]:
    """Return the cells of a line, at least one, without the spaces around them; the delimiter ' ' means any white space."""
    if delimiter == " ":
        words = (quoted or bare for quoted, bare in _WORDS.findall(line)) if '"' in line else line.split()
        return tuple(words) or ("",)
    return tuple(cell.strip() for cell in next(csv.reader([line], delimiter=delimiter)))
