"""What a study of releases says, as rows of a table and as sentences."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import groupby

from looping_pendulum.pages.numbers import number
from looping_pendulum.releases.result import CAPSTAN, QUANTITIES, Move, ReleaseRow, ReleasesResult, VariantRow

SHOWN = ("rms_0.35s", "rms_0.7s", "halting_time_error", CAPSTAN.name)
"""Numbers with columns of their own; the others are in the file."""
HEADER = ("release", "variant", *(QUANTITIES[name].column for name in SHOWN), "CPU [s]", "remark")


def rows(result: ReleasesResult) -> list[tuple[str, ...]]:
    """Return a row for each variant with each release, as `HEADER`."""
    return [cells for row in result.releases for cells in _cells(row)]


def _cells(row: ReleaseRow) -> Iterator[tuple[str, ...]]:
    gaps = ("",) * (len(HEADER) - 3)
    if row.error:
        yield row.release, "", *gaps, f"not installed: {row.error}"
    for variant in row.variants:
        if variant.ran:
            values = (QUANTITIES[name].cell(variant.values.get(name)) for name in SHOWN)
            yield row.release, variant.label, *values, number(variant.cpu_time, digits=2), remark(row, variant)
        else:
            yield row.release, variant.label, *gaps, remark(row, variant)


def remark(row: ReleaseRow, variant: VariantRow) -> str:
    """Return what is unusual about a variant's run."""
    parts = [variant.error, variant.capstan_note, f"with {', '.join(row.pins)}" if row.pins else ""]
    return "; ".join(part for part in parts if part)


def move_sentences(result: ReleasesResult) -> list[tuple[str, str, str]]:
    """Return (release, variant, what moved) for each variant that a release moved, oldest first."""
    groups = groupby(result.moves, lambda move: (move.release, move.label))
    return [(release, label, moved(list(group))) for (release, label), group in groups]


def moved(moves: list[Move]) -> str:
    """Return one sentence of all moves of a variant with one release: the shown numbers, and how many others moved."""
    shown = [move for move in moves if move.quantity in SHOWN] or moves
    text = "; ".join(_change(move) for move in shown)
    others = len(moves) - len(shown)
    return f"since {moves[0].since}: {text}" + (f"; and {others} other number{'s' if others > 1 else ''}" if others else "")


def _change(move: Move) -> str:
    metric = QUANTITIES[move.quantity]
    size = "" if move.spreads is None else f" ({number(move.spreads, digits=2)} × its spread)"
    return f"{metric.heading} {metric.cell(move.before)} → {metric.cell(move.after)} {metric.shown_in.name}{size}"
