"""Types of the effects: their coefficients, what they may depend on, and how they enter the equations."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, NamedTuple

TURN = 2 * math.pi
"""A full turn [rad]."""


class Kinematics(NamedTuple):
    """Quantities on which an effect may depend at one instant. SI; numbers, arrays or expressions.

    Engines give the first nine; the others are the reference's, with defaults for where they are not given.
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
    """|w| [m/s]; given by itself because an absolute value is not analytic and a mode carries its sign."""
    light_mass_speed: Any
    """Speed of the light mass, hypot(u, w) [m/s]."""
    heavy_speed: Any
    """Upward speed of the heavy mass [m/s] (along its string if it swings); equal to u while the string is taut."""
    heavy_speed_size: Any
    """Size of the heavy mass's velocity [m/s]."""
    overlap: Any = None
    """1 where the string lies on itself, beyond the first turn, else 0; None: it follows from the wrap angle."""
    sliding_speed: Any = None
    """Speed at which the string slides on the rod, not below 0 [m/s]; None: it is `heavy_speed_size`."""
    hanging_length: Any = None
    """Length of string from the rod to the heavy mass [m]; None: unknown."""
    heavy_tilt: Any = 0.0
    """Angle of the heavy mass's string to the vertical, away from the rod's centre [rad]."""
    heavy_across_speed: Any = 0.0
    """Speed of the heavy mass across its string [m/s]."""
    sideways_speed: Any = 0.0
    """Speed of the light mass along the rod [m/s]."""
    across_sign: Any = None
    """Sign of w, 0 where the pivot holds the light mass; None: it follows from the speeds."""
    taut: Any = 1.0
    """1 while the string is taut, 0 while it is slack."""

    @property
    def across_direction(self) -> Any:
        """Sign of the speed across the string, as a number: 1, -1, or 0 at rest."""
        if self.across_sign is not None:
            return self.across_sign
        # Engines give numbers; the reference gives the sign, as it is not analytic
        return (self.across_speed > 0) - (self.across_speed < 0)

    @property
    def contact_angle(self) -> Any:
        """Angle over which the string touches the rod [rad]."""
        return self.wrap_angle - self.heavy_tilt

    @property
    def slip_speed(self) -> Any:
        """Speed at which the string slides on the rod [m/s]."""
        return self.heavy_speed_size if self.sliding_speed is None else self.sliding_speed

    @property
    def wrap_beyond_first_turn(self) -> Any:
        """Wrap angle beyond a full turn, or 0 [rad]."""
        beyond = self.wrap_angle - TURN
        # Engines give numbers; the reference gives the overlap, as max() is not analytic
        return max(beyond, 0.0) if self.overlap is None else self.overlap * beyond


LightMassTerm = Callable[[Any, Kinematics, Any], tuple[Any, Any]]
"""(xp, kinematics, p) -> values along and across the string."""
ScalarTerm = Callable[[Any, Kinematics, Any], Any]
"""(xp, kinematics, p) -> value."""
Winding = Callable[[Any, Any], tuple[Any, Any, Any]]
"""(wrap angle beyond the first turn, p) -> growth of the radius, its slope and its integral."""


class EffectKind(StrEnum):
    """Category of an effect."""

    FORCE = "force on a mass"
    STRING_LAW = "law of the string on the rod"
    CLOSURE = "unknown force, found from data"
    PROPERTY = "property of string, rod or mass"
    RELEASE = "motion at release"


@dataclass(frozen=True, kw_only=True)
class Coefficient:
    """A coefficient of an effect, or of another model that can be fitted: its name, unit, default and bounds."""

    name: str
    unit: str
    """SI unit, as pint reads it; '' for a pure number."""
    default: float
    null: float
    """Value at which the effect is absent [SI]."""
    bounds: tuple[float, float]
    """Least and largest value that is accepted."""
    meaning: str
    """What it is, in words, for documentation and messages."""
    title: str = ""
    """What it adds to a model, in plain words for a sentence: "a steady sideways force"; empty: the name says it."""
    even: bool = False
    """Whether the motion in the plane is the same for the opposite value; a fit then takes the positive one."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Effect:
    """One named piece of physics with coefficients that can be fitted. Effects are compared and hashed by identity."""

    name: str
    kind: EffectKind
    formula: str
    source: str
    acts_on: str
    depends_on: tuple[str, ...]
    """Quantities of `Kinematics` on which its size depends; empty: it is constant."""
    coefficients: tuple[Coefficient, ...]
    direction: str = ""
    """Axis along which its force acts, "x" or "y", if that is the same in all positions; the wrap angle only turns it there."""
    in_base_model: bool = False
    """Whether the effect is part of the paper's model; such effects are always compiled in, even at their null value."""
    needs_string: bool = False
    """Whether the effect is absent without a string (drop release)."""
    needs_pivot: bool = False
    """Whether the effect is absent unless the string swings from a pivot (held release): one that runs over a rod has none."""
    switch: str = ""
    """Coefficient at whose null value the effect is absent whatever the others are; '': none."""
    force_on_light_mass: LightMassTerm | None = None
    """(xp, kinematics, p) -> force on the light mass (along, across) [N]."""
    force_on_heavy_mass: ScalarTerm | None = None
    """(xp, kinematics, p) -> upward force on the heavy mass [N]."""
    sliding_exponent: ScalarTerm | None = None
    """(xp, kinematics, p) -> ln of the tension ratio while the string slides, taken positive."""
    holding_exponent: ScalarTerm | None = None
    """(xp, kinematics, p) -> ln of the largest tension ratio that the rod can hold without sliding."""
    inertia_of_light_mass: LightMassTerm | None = None
    """(xp, kinematics, p) -> mass that moves with the light mass (along, across) [kg]."""
    inertia_of_heavy_mass: ScalarTerm | None = None
    """(xp, kinematics, p) -> mass that moves with the heavy mass [kg]."""
    winding: Winding | None = None
    """(wrap angle beyond the first turn, p) -> growth of the rod's radius [m], its slope [m/rad] and its integral [m]."""
    watches_first_turn: bool = False
    """Whether the effect changes its law where the wrap angle passes a full turn."""
    variables: tuple[str, ...] = ()
    """Entries of the state that this effect adds."""
    package: str = ""
    """Distribution of the package that offers the effect; '' if it is of this package, a study or a scenario."""
    module: str = ""
    """Module of that package."""

    def is_active(self, off_null: set[str]) -> bool:
        """Return whether the effect acts, given the names of the coefficients that are not at their null value."""
        if self.switch:
            return self.switch in off_null
        return any(c.name in off_null for c in self.coefficients)
