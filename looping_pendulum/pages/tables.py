"""Rows of results as a table of text or as a DataFrame."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from looping_pendulum.errors import MissingPackageError
from looping_pendulum.installation import install_command

Rows = Sequence[Mapping[str, Any]]
"""Rows of a table, each by the names of its columns, which are those of the first."""


def text_table(rows: Rows) -> str:
    """Return rows as lines of aligned cells below the names of the columns; numbers have six digits at most."""
    cells = [[*rows[0]], *text_cells(rows)] if rows else []
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    return "\n".join("  ".join(c.ljust(width) for c, width in zip(line, widths, strict=True)).rstrip() for line in cells)


def text_cells(rows: Rows) -> list[list[str]]:
    """Return the cells of each row as text; numbers have six digits at most, None is empty."""
    return [[_cell(value) for value in row.values()] for row in rows]


def _cell(value: Any) -> str:
    return "" if value is None else f"{value:.6g}" if isinstance(value, float) else str(value)


def data_frame(rows: Rows) -> Any:
    """Return rows as a `pandas.DataFrame`, in which None is NaN.

    Raises
    ------
    MissingPackageError
        If pandas is not installed.
    """
    try:
        import pandas
    except ImportError:
        way_out = f"`rows()` gives the same as a list; to get pandas: `{install_command('pandas')}`"
        raise MissingPackageError(f"to_frame: pandas is not installed; {way_out}") from None
    return pandas.DataFrame(rows)
