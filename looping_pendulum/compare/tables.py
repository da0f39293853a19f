"""Numbers and Markdown tables for people."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

GAP = "–"
"""Stands where there is no number."""


def number(value: float | None, scale: float = 1.0, digits: int = 3) -> str:
    """``value * scale`` to ``digits`` significant digits, without an exponent as long as that is readable."""
    if value is None:
        return GAP
    scaled = value * scale
    if scaled != 0 and abs(scaled) < 1e-4:
        return f"{scaled:.1e}"
    return np.format_float_positional(scaled, precision=digits, fractional=False, unique=False, trim="-") if scaled else "0"


def signed(value: float | None, scale: float = 1.0, digits: int = 3) -> str:
    """Like `number`, always with a sign."""
    text = number(value, scale, digits)
    return f"+{text}" if value is not None and value > 0 else text


def fixed(value: float | None, decimals: int) -> str:
    """``value`` with a fixed number of decimals."""
    return GAP if value is None else f"{value:.{decimals}f}"


def table(head: Sequence[str], rows: Iterable[Sequence[str]], left: int = 1) -> str:
    """Markdown table; the first ``left`` columns are text, the others numbers."""
    align = ["---"] * left + ["---:"] * (len(head) - left)
    lines = [head, align, *([_cell(c) for c in row] for row in rows)]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines) + "\n"


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")
