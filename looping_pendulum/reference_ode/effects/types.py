"""What an effect is: its coefficients, what it may depend on, and the places where it enters the equations."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property
from typing import Any, NamedTuple

TURN = 2 * math.pi


class Kinematics(NamedTuple):
    """What an effect may depend on at one instant. SI; numbers, arrays or expressions.

    Engines fill in the first nine; the rest are the reference's own and have a meaning without being given.
    """

    time: Any
    """Time since release [s]."""
    free_length: Any
    """Straight string from the rod's tangent point to the light mass, l [m]."""
    wrap_angle: Any
    """Wrap angle theta [rad]."""
    retreat_speed: Any
    """Speed of the light mass away from the rod along the string, u = l' + R theta' [m/s]; its velocity is -u e1 + w t1."""
    across_speed: Any
    """Speed of the light mass across the string, w = l theta' [m/s]."""
    across_speed_size: Any
    """|w| [m/s]; apart because an absolute value is not analytic and the integrators carry its sign."""
    light_mass_speed: Any
    """Speed of the light mass, hypot(u, w) [m/s]."""
    heavy_speed: Any
    """Upward speed of the heavy mass [m/s] (along its string if it swings); equal to u while the string is taut."""
    heavy_speed_size: Any
    """Size of the heavy mass's velocity [m/s]."""
    overlap: Any = None
    """1 where the string lies on itself, beyond the first turn, else 0; None: to be told from the wrap angle."""
    sliding_speed: Any = None
    """Speed at which the string slides on the rod, not below 0 [m/s]; None: the heavy mass's."""
    hanging_length: Any = None
    """String from the rod to the heavy mass [m]; None: not known."""
    heavy_tilt: Any = 0.0
    """Angle of the heavy mass's string to the vertical, away from the rod's centre [rad]."""
    heavy_across_speed: Any = 0.0
    """Speed of the heavy mass across its string [m/s]."""
    sideways_speed: Any = 0.0
    """Speed of the light mass along the rod [m/s]."""

    @property
    def contact_angle(self) -> Any:
        """Angle over which the string touches the rod [rad]."""
        return self.wrap_angle - self.heavy_tilt

    @property
    def slip(self) -> Any:
        """Speed at which the string slides on the rod [m/s]."""
        return self.heavy_speed_size if self.sliding_speed is None else self.sliding_speed

    @property
    def wrap_beyond_first_turn(self) -> Any:
        """Wrap angle beyond a full turn, or 0 [rad]."""
        beyond = self.wrap_angle - TURN
        return max(beyond, 0.0) if self.overlap is None else self.overlap * beyond


LightForce = Callable[[Any, Kinematics, Any], tuple[Any, Any]]
Quantity = Callable[[Any, Kinematics, Any], Any]
Winding = Callable[[Any, Any], tuple[Any, Any, Any]]


class EffectKind(StrEnum):
    """What sort of physics an effect is."""

    FORCE = "force on a mass"
    STRING_LAW = "law of the string on the rod"
    CLOSURE = "unknown force, found from data"
    PROPERTY = "property of string, rod or mass"
    RELEASE = "motion at release"


@dataclass(frozen=True, kw_only=True)
class Coefficient:
    """One number of an effect."""

    name: str
    unit: str
    """SI unit, as pint reads it; '' for a pure number."""
    default: float
    null: float
    """Value at which the effect is absent."""
    bounds: tuple[float, float]
    """Physically possible values."""
    meaning: str


@dataclass(frozen=True, kw_only=True, eq=False)
class Effect:
    """One named, fittable piece of physics. Each is itself and no other: compared, and hashed, by identity."""

    name: str
    kind: EffectKind
    formula: str
    source: str
    acts_on: str
    depends_on: tuple[str, ...]
    coefficients: tuple[Coefficient, ...]
    in_base_model: bool = False
    """Whether the paper's model has it; such effects are always compiled in, at their null value if need be."""
    needs_string: bool = False
    """Whether the effect is absent without a string (drop release)."""
    switch: str = ""
    """Coefficient at whose null value the effect is absent whatever the others are; '': none."""
    force_on_light_mass: LightForce | None = None
    """(xp, kinematics, p) -> force on the light mass (along, across) [N]."""
    force_on_heavy_mass: Quantity | None = None
    """(xp, kinematics, p) -> upward force on the heavy mass [N]."""
    sliding_exponent: Quantity | None = None
    """(xp, kinematics, p) -> ln of the tension ratio while the string slides, taken positive."""
    holding_exponent: Quantity | None = None
    """(xp, kinematics, p) -> ln of the largest tension ratio that the rod can hold without sliding."""
    inertia_of_light_mass: LightForce | None = None
    """(xp, kinematics, p) -> mass that moves with the light mass (along, across) [kg]."""
    inertia_of_heavy_mass: Quantity | None = None
    """(xp, kinematics, p) -> mass that moves with the heavy mass [kg]."""
    winding: Winding | None = None
    """(wrap angle beyond the first turn, p) -> what it adds to the rod's radius [m], its slope [m/rad] and its integral [m]."""
    watches_first_turn: bool = False
    """Whether the effect changes its law where the wrap angle passes a full turn."""
    variables: tuple[str, ...] = ()
    """Entries of the state that only this effect moves."""

    def acts(self, off_null: set[str]) -> bool:
        """Whether the effect is there, given the names of the coefficients that are not at their null value."""
        if self.switch:
            return self.switch in off_null
        return not off_null.isdisjoint(self._names)

    @cached_property
    def _names(self) -> tuple[str, ...]:
        return tuple(c.name for c in self.coefficients)
