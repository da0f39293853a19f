"""What the rules of transition ask of the equations, and the answers for one run."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any, Protocol

from looping_pendulum.reference_ode.equations import Equations, Impact
from looping_pendulum.reference_ode.state import Effects, Motion, State


class HybridSystem(Protocol):
    """The equations of one run, or of many at once, as `rules` asks them."""

    p: SimpleNamespace
    """Parameters by name."""
    effects: Effects
    rod_turns: bool
    string_stretches: bool
    leaves_plane: bool
    heavy_mass_swings: bool
    pivot_holds: bool
    """Whether the pivot has a friction that can hold the light mass at rest."""

    def where(self, condition: Any, a: Any, b: Any) -> Any:
        """Return the number ``a`` where ``condition`` holds, else ``b``."""

    def choose(self, condition: Any, a: Motion, b: Motion) -> Motion:
        """Return the motion ``a`` where ``condition`` holds, else ``b``."""

    def any(self, condition: Any) -> bool:
        """Return whether ``condition`` holds for at least one run."""

    def rates(self, m: Motion) -> State:
        """Return the derivatives of the state by time."""

    def tensions(self, m: Motion) -> tuple[Any, Any]:
        """Return the tensions in the free string and above the heavy mass [N]."""

    def holding_margins(self, m: Motion) -> tuple[Any, Any]:
        """Return by how much the tensions are inside the friction cone, (down, up) [N]."""

    def impact(self, slide: float, m: Motion) -> Impact:
        """Return the result of an inelastic impulse along the string; arguments as of `Equations.impact`."""

    def with_stretch_at_rest(self, m: Motion) -> State:
        """Return the state with the stretch of a string at rest on the verge of sliding down."""

    def with_even_stretch(self, m: Motion) -> State:
        """Return the state with its stretch spread evenly over the string."""


class SingleRunSystem:
    """The equations of one run, as `rules` asks them.

    Parameters
    ----------
    equations
        The equations over the numbers of the run.
    decisions
        The same over floats, from which the next mode is decided; None: the run's numbers are floats.
    """

    def __init__(self, equations: Equations, decisions: Equations | None = None) -> None:
        self._equations, self._decisions = equations, decisions or equations
        self._convert = decisions is not None
        self.p, self.effects = equations.p, equations.effects
        self.rod_turns, self.string_stretches = equations.rod_turns, equations.string_stretches
        self.leaves_plane, self.heavy_mass_swings = equations.leaves_plane, equations.heavy_mass_swings
        self.pivot_holds = equations.pivot_holds

    @staticmethod
    def where(condition: Any, a: Any, b: Any) -> Any:
        """Return ``a`` if ``condition`` holds, else ``b``."""
        return a if condition else b

    choose = where
    any = staticmethod(bool)

    def rates(self, m: Motion) -> State:
        """Return the derivatives of the state by time."""
        return self._equations.rates(*m)

    def tensions(self, m: Motion) -> tuple[Any, Any]:
        """Return the tensions in the free string and above the heavy mass [N], as floats."""
        return self._decisions.tensions(*self._floats(m))

    def holding_margins(self, m: Motion) -> tuple[Any, Any]:
        """Return by how much the tensions are inside the friction cone, (down, up) [N], as floats."""
        return self._decisions.holding_margins(*self._floats(m))

    def impact(self, slide: float, m: Motion) -> Impact:
        """Return the result of an inelastic impulse along the string; arguments as of `Equations.impact`."""
        return self._equations.impact(slide, m.t, m.y, m.signs)

    def with_stretch_at_rest(self, m: Motion) -> State:
        """Return the state with the stretch of a string at rest on the verge of sliding down."""
        return self._equations.with_stretch_at_rest(m.t, m.y, m.signs)

    def with_even_stretch(self, m: Motion) -> State:
        """Return the state with its stretch spread evenly over the string."""
        return self._equations.with_even_stretch(m.y, m.signs)

    def _floats(self, m: Motion) -> Motion:
        return Motion(m.mode, float(m.t), State(*map(float, m.y)), m.signs) if self._convert else m


def system_of_floats(p: SimpleNamespace, effects: Effects) -> SingleRunSystem:
    """Return the system of a run whose numbers are floats."""
    return SingleRunSystem(Equations(math, p, effects))
