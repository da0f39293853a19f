"""Find the releases in which a number moved by more than small changes of the start move it."""

from __future__ import annotations

from collections.abc import Sequence

from looping_pendulum.releases.result import QUANTITIES, Move, ReleaseRow, Spread, VariantRow

FLOOR = 1e-6
"""Smallest move that is named [SI]: a micron, a microsecond, a microradian, a millionth.

Halting times are read from samples a millisecond apart, and smooth variants have spreads of nanometres, which rounding on
another processor passes.
"""


def find_moves(rows: Sequence[ReleaseRow], spread: Spread) -> tuple[Move, ...]:
    """Return every move among ``rows``, oldest release first; each release is compared with the last before it that ran."""
    moves: list[Move] = []
    last: dict[str, tuple[str, VariantRow]] = {}
    for row in rows:
        for variant in row.variants:
            if not variant.ran:
                continue
            if variant.label in last:
                since, before = last[variant.label]
                moves += _moves(row.release, variant, since, before, spread.values.get(variant.label, {}))
            last[variant.label] = row.release, variant
    return tuple(moves)


def _moves(release: str, variant: VariantRow, since: str, before: VariantRow, spreads: dict[str, float | None]) -> list[Move]:
    moves = []
    for name in QUANTITIES:
        old, new = before.values.get(name), variant.values.get(name)
        if old is None and new is None:
            continue
        ratio = None
        if old is not None and new is not None:
            spread = max(spreads.get(name) or 0.0, FLOOR)
            ratio = abs(new - old) / spread
            if ratio <= 1:
                continue
        moves.append(
            Move(label=variant.label, quantity=name, release=release, since=since, before=old, after=new, spreads=ratio)
        )
    return moves
