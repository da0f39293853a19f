"""What the live model contains, and its parameters, state and signs as symbols."""

from __future__ import annotations

from dataclasses import replace
from functools import reduce
from operator import and_
from types import SimpleNamespace
from typing import Any, cast

from looping_pendulum.live.expressions import PrintedGraph
from looping_pendulum.reference_ode.core.expressions import ExpressionGraph, ExpressionMath
from looping_pendulum.reference_ode.core.trace import SymbolicSystem
from looping_pendulum.reference_ode.effects import LIBRARY, Effect, Kinematics
from looping_pendulum.reference_ode.effects.library import (
    HEAVY_LINEAR_DRAG,
    LIGHT_LINEAR_DRAG,
    PUSH_ACROSS,
    PUSH_ALONG,
    SIDE_FORCE,
    WIND,
)
from looping_pendulum.reference_ode.parameters import NUMBERS, Parameters, Release, is_possible
from looping_pendulum.reference_ode.state import Effects, Signs, State
from looping_pendulum.reference_ode.transitions import Mode

FURTHER_EFFECTS = (LIGHT_LINEAR_DRAG, HEAVY_LINEAR_DRAG, WIND, SIDE_FORCE, PUSH_ACROSS, PUSH_ALONG)
"""Effects beside those of the paper's model. All are compiled in; one is absent while its coefficient is 0."""
MODES = (Mode.STICKING, Mode.SLIDING_DOWN, Mode.SLIDING_UP, Mode.SLACK, Mode.CLAMPED, Mode.CLAMPED_SLACK, Mode.FALLING)
"""Modes of a run with these effects, but for its end."""
STATE = State._fields[: State._fields.index("slack") + 1]
"""Entries of the state that these effects move."""
SIGNS = Signs._fields[: Signs._fields.index("phase") + 1]
"""Signs and phases that these effects change."""


def live_effects(release: Release) -> Effects:
    """Return the effects that may act after this release, in the library's order."""
    return tuple(e for e in LIBRARY if (e.in_base_model or e in FURTHER_EFFECTS) and is_possible(e, release))


def absent_at_null(effect: Effect, graph: ExpressionGraph) -> Effect:
    """Return the effect with forces that are 0 while its coefficients are at their null values.

    The sum of the wind's terms is 0 then, too, but only up to the event that ends a mode: in a step beyond it a speed has
    the other sign, and the drag through the air has a kink there that the drag in still air has not.
    """
    if effect not in FURTHER_EFFECTS:
        return effect

    def is_absent(p: Any) -> Any:
        return reduce(and_, (getattr(p, c.name) == c.null for c in effect.coefficients))

    on_light, on_heavy = effect.force_on_light_mass, effect.force_on_heavy_mass

    def force_on_light_mass(xp: Any, k: Kinematics, p: Any) -> tuple[Any, Any]:
        along, across = on_light(xp, k, p) if on_light else (0.0, 0.0)
        return graph.where(is_absent(p), 0.0, along), graph.where(is_absent(p), 0.0, across)

    def force_on_heavy_mass(xp: Any, k: Kinematics, p: Any) -> Any:
        return graph.where(is_absent(p), 0.0, on_heavy(xp, k, p)) if on_heavy else 0.0

    return replace(
        effect,
        force_on_light_mass=on_light and force_on_light_mass,
        force_on_heavy_mass=on_heavy and force_on_heavy_mass,
    )


def live_coefficients() -> tuple[str, ...]:
    """Return the names of the coefficients of these effects."""
    return tuple(c.name for effect in live_effects(Release.LOOPING) for c in effect.coefficients)


def effects_in(mode: Mode) -> Effects:
    """Return the effects that may act in a mode: with a string, or without one."""
    return live_effects(Release.DROP if mode is Mode.FALLING else Release.LOOPING)


PARAMETERS = (*NUMBERS, *live_coefficients(), "end_length", "string_length")
"""Names of all numbers that the equations read."""


class Model:
    """Symbols of one function of the model, and the equations over them."""

    def __init__(self, effects: Effects) -> None:
        self.graph = PrintedGraph()
        self.xp = ExpressionMath(self.graph)
        # The null value of an absent effect's coefficient is a number, so that nothing is printed of its terms
        absent = {c.name: c.null for effect in LIBRARY for c in effect.coefficients}
        self.p = SimpleNamespace(**(absent | {name: self.graph.symbol(f"p.{name}") for name in PARAMETERS}))
        self.effects = tuple(absent_at_null(effect, self.graph) for effect in effects)
        self.system = SymbolicSystem(self.graph, self.p, self.effects)
        self.t = self.graph.symbol("t")
        self.y = State(**{name: self.graph.symbol(name) for name in STATE})
        self.signs = Signs(**{name: self.graph.symbol(f"s.{name}") for name in SIGNS})

    def parameters(self, release: Release | None = None) -> Parameters:
        """Return what stands for `Parameters` in functions that read its numbers."""
        stand_in: Any = SimpleNamespace(
            **vars(self.p), release=release, coefficients=vars(self.p), effects=self.effects, values=lambda: self.p
        )
        return cast(Parameters, stand_in)
