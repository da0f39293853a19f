"""The models of the live page: one for each release, with all effects that the page offers, and what the page needs of them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import reduce
from operator import and_
from typing import Any

from looping_pendulum.reference_ode import effects as forces
from looping_pendulum.reference_ode.closed_forms import kinetic_energy, potential_energy
from looping_pendulum.reference_ode.core.expressions import Expression, ExpressionGraph, ExpressionMath
from looping_pendulum.reference_ode.core.trace import Symbols, TracedModel, parameter_names, possible_modes, trace
from looping_pendulum.reference_ode.effects import GRAVITY, LIBRARY, Effect, Kinematics
from looping_pendulum.reference_ode.effects.library import (
    HEAVY_LINEAR_DRAG,
    LIGHT_LINEAR_DRAG,
    PUSH_ACROSS,
    PUSH_ALONG,
    SIDE_FORCE,
    WIND,
)
from looping_pendulum.reference_ode.geometry import light_velocity, vector_xy
from looping_pendulum.reference_ode.parameters import Release, derived_values, effect_tables, is_possible
from looping_pendulum.reference_ode.solution import heavy_mass_position, light_mass_position
from looping_pendulum.reference_ode.state import Effects, kinematics
from looping_pendulum.reference_ode.transitions import Mode

FURTHER_EFFECTS = (LIGHT_LINEAR_DRAG, HEAVY_LINEAR_DRAG, WIND, SIDE_FORCE, PUSH_ACROSS, PUSH_ALONG)
"""Effects beside those of the paper's model. All are compiled in; one is absent while its coefficient is 0."""
NOT_FROM_THE_AIR = (GRAVITY.name, SIDE_FORCE.name)
"""Effects whose forces on the light mass are no drag."""

HOLDING_MODES = tuple(mode for mode in Mode if mode.string_moves or mode is Mode.STICKING)
"""Modes in which the rod's friction holds the tensions apart."""


def live_effects(release: Release) -> Effects:
    """Return the effects that may act after this release, in the library's order."""
    return tuple(e for e in LIBRARY if (e.in_base_model or e in FURTHER_EFFECTS) and is_possible(e, release))


def absent_at_null(effect: Effect) -> Effect:
    """Return the effect with forces that are 0 while its coefficients are at their null values.

    The sum of the wind's terms is 0 then, too, but only up to the event that ends a mode: in a step beyond it a speed has
    the other sign, and the drag through the air has a kink there that the drag in still air has not.
    """
    if effect not in FURTHER_EFFECTS:
        return effect

    def unless_absent(p: Any, force: Any) -> Any:
        is_absent = reduce(and_, (getattr(p, c.name) == c.null for c in effect.coefficients))
        return is_absent.graph.where(is_absent, 0.0, force)

    on_light, on_heavy = effect.force_on_light_mass, effect.force_on_heavy_mass

    def force_on_light_mass(xp: Any, k: Kinematics, p: Any) -> tuple[Any, Any]:
        along, across = on_light(xp, k, p) if on_light else (0.0, 0.0)
        return unless_absent(p, along), unless_absent(p, across)

    def force_on_heavy_mass(xp: Any, k: Kinematics, p: Any) -> Any:
        return unless_absent(p, on_heavy(xp, k, p)) if on_heavy else 0.0

    return replace(
        effect,
        force_on_light_mass=on_light and force_on_light_mass,
        force_on_heavy_mass=on_heavy and force_on_heavy_mass,
    )


def live_coefficients() -> tuple[str, ...]:
    """Return the names of the coefficients of these effects."""
    return tuple(c.name for effect in live_effects(Release.LOOPING) for c in effect.coefficients)


@dataclass(frozen=True, kw_only=True)
class LiveModel:
    """The model of a release, and its functions beside those that the driver calls."""

    traced: TracedModel
    quantities: dict[Mode, tuple[Any, ...]]
    """Outputs of the function of each mode that gives what can be seen and drawn of an instant."""

    @property
    def functions(self) -> tuple[tuple[Any, ...], ...]:
        """Outputs of all functions: those of the driver first, then `quantities` in their order."""
        return (*self.traced.functions, *self.quantities.values())


def live_model(release: Release) -> LiveModel:
    """Trace the model of a release."""
    effects = tuple(map(absent_at_null, live_effects(release)))
    traced = trace(release, effects, derivatives=False)
    modes = possible_modes(release, effects)
    return LiveModel(traced=traced, quantities={mode: quantities(mode, traced.names, effects) for mode in modes})


def quantities(mode: Mode, names: tuple[str, ...], effects: Effects) -> tuple[Any, ...]:
    """Return what can be seen and drawn of an instant, in the order in which `run.js` reads it; vectors are x and y.

    |ln(T2/T1)| of a taut string that no clamp holds, and the most that the rod can hold, are else 0. The accelerations of the
    masses [m/s^2] come last: with the light one's velocity -u e1 + w t1 and the turning theta', it is
    (w theta' - u') e1 + (w' + u theta') t1 (see `reference_ode.equations`).
    """
    symbols = Symbols(names, effects)
    system, xp, y, p, parameters = symbols.system, ExpressionMath(symbols.graph), symbols.y, symbols.p, symbols.parameters()
    tensions = system.equations.tensions(mode, symbols.t, y, symbols.signs)
    k = kinematics(xp, mode, symbols.t, y, symbols.signs, p, effects)
    light = light_mass_position(xp, y, 0.0, p, effects)
    heavy = heavy_mass_position(xp, y, 0.0, p, effects)
    velocity = light_velocity(xp, y.wrap_angle, y.retreat_speed, y.across_speed)
    rates = system.equations.rates(mode, symbols.t, y, symbols.signs)
    along = y.across_speed * rates.wrap_angle - rates.retreat_speed
    across = rates.across_speed + y.retreat_speed * rates.wrap_angle
    from_the_air = tuple(effect for effect in effects if effect.name not in NOT_FROM_THE_AIR)
    holds = mode in HOLDING_MODES
    return (
        *light,
        *heavy,
        *velocity,
        y.heavy_speed,
        y.wrap_angle,
        y.free_length,
        y.slack,
        *tensions,
        kinetic_energy(parameters, velocity, (0.0, y.heavy_speed)),
        potential_energy(parameters, light, heavy),
        *vector_xy(xp, y.wrap_angle, *forces.force_on_light_mass(xp, k, p, from_the_air)),
        abs(xp.log(tensions[1] / tensions[0])) if holds else 0.0,
        forces.holding_exponent(xp, k, p, effects) if holds else 0.0,
        *vector_xy(xp, y.wrap_angle, along, across),
        rates.heavy_speed,
    )


class _GraphOfMessages(ExpressionGraph):
    """Keeps the expressions whose values a message shows; their places stand in it, in braces."""

    def __init__(self) -> None:
        super().__init__()
        self.values: list[Expression] = []

    def shown(self, expression: Expression, spec: str) -> str:
        if spec != "g":
            raise TypeError(f"format: found {spec!r}, needed 'g'")
        self.values.append(expression)
        return f"{{{len(self.values) - 1}}}"


@dataclass(frozen=True, kw_only=True)
class Requirements:
    """What an apparatus of the live model must fulfil."""

    names: tuple[str, ...]
    """Parameters that the outputs read."""
    messages: tuple[str, ...]
    """What is said where a requirement is not met; "{2}" stands for the third of the values that messages show."""
    outputs: tuple[Any, ...]
    """Whether each is met, then the values that the messages show."""


def live_requirements() -> Requirements:
    """Return the requirements of the reference that concern the live model."""
    graph = _GraphOfMessages()
    names = parameter_names(live_effects(Release.LOOPING))
    tables = effect_tables(())
    values = dict(tables.nulls) | {name: graph.symbol(f"p{i}") for i, name in enumerate(names)}
    values |= derived_values(values, graph.where)
    requirements = [(r.is_met(values), r.message) for r in tables.requirements(live_coefficients())]
    # What concerns effects that the live model does not have is met whatever the numbers are
    remaining = [(is_met, message) for is_met, message in requirements if isinstance(is_met, Expression)]
    messages = tuple(message(values) for _, message in remaining)
    return Requirements(names=names, messages=messages, outputs=(*(is_met for is_met, _ in remaining), *graph.values))
