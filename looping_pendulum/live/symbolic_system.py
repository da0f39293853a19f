"""The rules of transition as formulas: the equations as `rules` asks them, on expressions that print themselves."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

from looping_pendulum.live.expressions import ExpressionGraph, ExpressionMath, possible_values
from looping_pendulum.reference_ode.equations import Equations
from looping_pendulum.reference_ode.rules import HybridSystem
from looping_pendulum.reference_ode.state import Effects, Motion, Signs, State
from looping_pendulum.reference_ode.transitions import Mode


class SymbolicSystem(HybridSystem):
    """The equations of one run on expressions; the mode may be a choice between several."""

    def __init__(self, graph: ExpressionGraph, p: SimpleNamespace, effects: Effects) -> None:
        super().__init__(Equations(ExpressionMath(graph), p, effects))
        self._graph = graph

    def where(self, condition: Any, a: Any, b: Any) -> Any:
        """Return the number ``a`` where ``condition`` holds, else ``b``."""
        return self._graph.where(condition, a, b)

    def choose(self, condition: Any, a: Motion, b: Motion) -> Motion:
        """Return the motion ``a`` where ``condition`` holds, else ``b``."""
        return Motion(
            mode=self.where(condition, a.mode, b.mode),
            t=self.where(condition, a.t, b.t),
            y=State(*self._each(condition, a.y, b.y)),
            signs=Signs(*self._each(condition, a.signs, b.signs)),
        )

    def _each(self, condition: Any, a: tuple[Any, ...], b: tuple[Any, ...]) -> list[Any]:
        return [self.where(condition, x, y) for x, y in zip(a, b, strict=True)]

    def any(self, condition: Any) -> bool:
        """Return whether ``condition`` may hold."""
        return condition is not False

    def rates(self, m: Motion) -> State:
        """Return the derivatives of the state by time."""
        return State(*self._in_each_mode(m, self.equations.rates))

    def tensions(self, m: Motion) -> tuple[Any, Any]:
        """Return the tensions in the free string and above the heavy mass [N]."""
        light, heavy = self._in_each_mode(m, self.equations.tensions)
        return light, heavy

    def holding_margins(self, m: Motion) -> tuple[Any, Any]:
        """Return by how much the tensions are inside the friction cone, (down, up) [N]."""
        down, up = self._in_each_mode(m, self.equations.holding_margins)
        return down, up

    def _in_each_mode(self, m: Motion, function: Callable[..., tuple[Any, ...]]) -> list[Any]:
        """Return what ``function`` gives in the mode of ``m``, which may be a choice between several."""
        modes = [Mode(value) for value in possible_values(m.mode)]
        result = list(function(modes[-1], *m[1:]))
        for mode in modes[:-1]:
            result = self._each(m.mode == mode, function(mode, *m[1:]), tuple(result))
        return result
