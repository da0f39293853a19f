"""A table of runs: one column per run, one row per quantity."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from looping_pendulum.reference_ode.batch.compiled import LEADING, padding_columns
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.transitions import Mode

BOOKKEEPING = ("run", "mode", "steps", "events")
"""Rows that the equations do not read: index of the run, its mode, and its numbers of steps and events."""
_ROW = {name: row for row, name in enumerate((*BOOKKEEPING, *LEADING))}


class Block:
    """Some runs as a table: a row for each of `BOOKKEEPING`, `LEADING` and the apparatus' parameters, a column for each run."""

    def __init__(self, table: Array) -> None:
        """Wrap ``table``, shape (rows, n), without copying it."""
        self.table = table

    @classmethod
    def joined(cls, blocks: Sequence[Block], pad_to_vectors: bool = False) -> Block:
        """Return the columns of all blocks, one block after another.

        With ``pad_to_vectors``, copies of the last column follow, so that the number of columns is a multiple of the SIMD size.
        """
        tables = [block.table for block in blocks]
        if pad_to_vectors:
            tables += padding_columns(tables[-1], sum(map(len, blocks)))
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
    def inputs(self) -> Array:
        """Rows that the equations read: `LEADING` and the apparatus' parameters. A view: changes reach the table."""
        return self.table[len(BOOKKEEPING) :]

    @property
    def runs(self) -> NDArray[np.int64]:
        """Indices of the runs in the batch, shape (n,)."""
        # Stored as a float, as the table is one array for the compiled functions; exact up to 2^53
        return self["run"].astype(np.int64)

    def view(self, start: int, end: int) -> Block:
        """Return some columns as a view: changes reach this block."""
        return Block(self.table[:, start:end])

    def take(self, columns: NDArray[np.int64]) -> Block:
        """Return a copy of some columns."""
        return Block(self.table.take(columns, axis=1))

    def present_modes(self) -> list[Mode]:
        """Return the modes that at least one run is in."""
        return [Mode(int(mode)) for mode in np.unique(self["mode"])]
