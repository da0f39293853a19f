"""The rules of transition for many runs at once: a table of runs, and their equations as `rules` asks them, on its columns."""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from looping_pendulum.reference_ode import rules
from looping_pendulum.reference_ode.batch import compiled
from looping_pendulum.reference_ode.batch.compiled import LEADING, BatchModel
from looping_pendulum.reference_ode.equations import Equations, Impact
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import Release
from looping_pendulum.reference_ode.state import Motion, Signs, State
from looping_pendulum.reference_ode.transitions import Event, Mode

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
            tables += compiled.padding_columns(tables[-1], sum(map(len, blocks)))
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


def release(model: BatchModel, kind: Release, block: Block, push_along: Array, push_across: Array) -> None:
    """Release the runs of a block, and take the first step of those that start at rest.

    Parameters
    ----------
    block
        Zeros but for free length, wrap angle, the heavy mass's tilt, the speed along the rod, duration and the parameters of
        the apparatus.
    push_along, push_across
        Speeds of the light mass at release, shape (n,) [m/s].
    """
    system = BatchSystem(model, block)
    y = _motion(block).y._replace(retreat_speed=push_along, across_speed=push_across)
    after, _, _ = rules.leave_rest(system, rules.enter(system, rules.release(system, kind, y)))
    _store(after, block)


def apply_event(model: BatchModel, block: Block, mode: Mode, event: Event) -> None:
    """Apply ``event``, at which all runs of the block, in ``mode``, have arrived."""
    _store(rules.apply_event(BatchSystem(model, block), mode, event, _motion(block)), block)


class BatchSystem(rules.HybridSystem):
    """The equations of the runs of a block; numbers are arrays of shape (n,), or the same for all.

    A batch supports neither a rod that turns nor a string that stretches.
    """

    def __init__(self, model: BatchModel, block: Block) -> None:
        self._model, self._inputs = model, block.inputs
        parameters = self._inputs[len(LEADING) :]
        p = SimpleNamespace(**{name: parameters[row] for row, name in enumerate(model.names)})
        super().__init__(Equations(np, p, model.effects))

    def where(self, condition: Any, a: Any, b: Any) -> Any:
        """Return ``a`` where ``condition`` holds, else ``b``."""
        return np.where(condition, a, b)

    def choose(self, condition: Any, a: Motion, b: Motion) -> Motion:
        """Return the motion ``a`` where ``condition`` holds, else ``b``."""

        def pick(x: Any, y: Any) -> Any:
            # A rule leaves most entries as they are: then both motions hold the same array
            return x if x is y else np.where(condition, x, y)

        return Motion(
            mode=pick(a.mode, b.mode),
            t=pick(a.t, b.t),
            y=State(*map(pick, a.y, b.y)),
            signs=Signs(*map(pick, a.signs, b.signs)),
        )

    def any(self, condition: Any) -> bool:
        """Return whether ``condition`` holds for at least one run."""
        return bool(np.any(condition))

    def rates(self, m: Motion) -> State:
        """Return the derivatives of the state by time."""
        columns, modes = self._columns(m), self._modes(m)
        rate = np.zeros((len(State._fields), len(modes)))
        for mode in map(Mode, np.unique(modes)):
            np.copyto(rate, compiled.rates(self._model, mode)(columns), where=modes == mode)
        return State(*rate)

    def tensions(self, m: Motion) -> tuple[Any, Any]:
        """Return the tension of the free string [N]; the other is not compiled, as no rule of these runs asks for it."""
        columns, modes = self._columns(m), self._modes(m)
        light = np.zeros(len(modes))
        for mode in map(Mode, np.unique(modes)):
            np.copyto(light, compiled.light_tension(self._model, mode)(columns)[0], where=modes == mode)
        return light, None

    def holding_margins(self, m: Motion) -> tuple[Any, Any]:
        """Return by how much the tensions are inside the friction cone of a string at rest, (down, up) [N]."""
        down, up = compiled.holding_margins(self._model)(self._columns(m))
        return down, up

    def impact(self, slide: float, m: Motion) -> Impact:
        """Return the result of an inelastic impulse along the string; arguments as of `Equations.impact`."""
        *state, sliding = compiled.impact(self._model, slide)(self._columns(m))
        return Impact(State(*state), sliding)

    def _columns(self, m: Motion) -> Array:
        """Return the inputs of the compiled functions: those of the block, with this motion."""
        columns = self._inputs.copy()
        for row, values in zip(_rows(columns), _entries(m), strict=True):
            row[:] = values
        return columns

    def _modes(self, m: Motion) -> NDArray[np.int64]:
        return np.broadcast_to(np.asarray(m.mode, dtype=np.int64), self._inputs.shape[1])


def _entries(m: Motion) -> list[Any]:
    """Return what a block holds of a motion beside its mode: the state, the time and the signs."""
    return [*m.y, m.t, *m.signs]


def _rows(inputs: Array) -> Array:
    """Return the rows of the same, a view."""
    return inputs[: len(State._fields) + 1 + len(Signs._fields)]


def _motion(block: Block) -> Motion:
    """Return the motion of the runs of a block, a copy."""
    rows = _rows(block.inputs).copy()
    return Motion(
        mode=block["mode"].astype(np.int64),
        t=rows[len(State._fields)],
        y=State(*rows[: len(State._fields)]),
        signs=Signs(*rows[len(State._fields) + 1 :]),
    )


def _store(m: Motion, block: Block) -> None:
    """Write a motion into a block."""
    block["mode"] = m.mode
    for row, values in zip(_rows(block.inputs), _entries(m), strict=True):
        row[:] = values
