"""The rules of transition for many runs at once: their equations as `rules` asks them, on the columns of a block."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from looping_pendulum.reference_ode import rules
from looping_pendulum.reference_ode.batch import compiled
from looping_pendulum.reference_ode.batch.block import Block
from looping_pendulum.reference_ode.batch.compiled import LEADING, BatchModel
from looping_pendulum.reference_ode.effects.forces import PIVOT_FRICTION
from looping_pendulum.reference_ode.equations import Impact
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import Release
from looping_pendulum.reference_ode.state import Motion, Signs, State, extra_variables
from looping_pendulum.reference_ode.transitions import Event, Mode


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


class BatchSystem:
    """The equations of the runs of a block, as `rules` asks them; numbers are arrays of shape (n,), or the same for all."""

    rod_turns = string_stretches = False  # what a batch does not support

    def __init__(self, model: BatchModel, block: Block) -> None:
        self._model, self._inputs = model, block.inputs
        self.effects = model.effects
        self.pivot_holds = PIVOT_FRICTION in model.effects
        own = extra_variables(model.effects)
        self.leaves_plane, self.heavy_mass_swings = "sideways" in own, "heavy_tilt" in own
        parameters = self._inputs[len(LEADING) :]
        self.p = SimpleNamespace(**{name: parameters[row] for row, name in enumerate(model.names)})

    where = staticmethod(np.where)

    @staticmethod
    def choose(condition: Any, a: Motion, b: Motion) -> Motion:
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

    @staticmethod
    def any(condition: Any) -> bool:
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

    def with_stretch_at_rest(self, m: Motion) -> State:
        """Refuse: a batch does not support a string that stretches."""
        raise NotImplementedError

    with_even_stretch = with_stretch_at_rest

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
