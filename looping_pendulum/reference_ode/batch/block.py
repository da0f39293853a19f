"""Runs side by side, as a table."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from looping_pendulum.reference_ode.batch.compiled import LEADING, filler
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.transitions import Mode

NOTES = ("run", "mode", "steps", "events")
"""What is noted of a run beside what the equations need: its index, its mode, how many steps and events it has had."""
_ROW = {name: row for row, name in enumerate((*NOTES, *LEADING))}


class Block:
    """Some runs side by side: a table with a row for each of `NOTES`, `LEADING` and the apparatus, a column for each run."""

    def __init__(self, table: Array) -> None:
        """``table``: shape (rows, n)."""
        self.table = table

    @classmethod
    def joined(cls, blocks: Sequence[Block], whole_vectors: bool = False) -> Block:
        """Columns of all, one block after another; ``whole_vectors``: with copies of the last one that fill whole vectors."""
        tables = [block.table for block in blocks]
        if whole_vectors:
            tables += filler(tables[-1], sum(map(len, blocks)))
        return cls(np.concatenate(tables, axis=1) if len(tables) > 1 else tables[0])

    def __len__(self) -> int:
        columns: int = self.table.shape[1]
        return columns

    def __getitem__(self, name: str) -> Array:
        row: Array = self.table[_ROW[name]]
        return row

    def __setitem__(self, name: str, values: Array | float) -> None:
        self.table[_ROW[name]] = values

    @property
    def numbers(self) -> Array:
        """The rows that the equations need: `LEADING` and the apparatus."""
        return self.table[len(NOTES) :]

    @property
    def runs(self) -> NDArray[np.int64]:
        """Indices of the runs."""
        return self["run"].astype(np.int64)

    def part(self, start: int, end: int) -> Block:
        """Some columns; what changes there changes here."""
        return Block(self.table[:, start:end])

    def take(self, columns: NDArray[np.int64]) -> Block:
        """A copy of some columns."""
        return Block(self.table.take(columns, axis=1))

    def present_modes(self) -> list[Mode]:
        """Modes that some run is in."""
        return [Mode(int(mode)) for mode in np.unique(self["mode"])]
