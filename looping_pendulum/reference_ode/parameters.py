"""Parameters of a run: apparatus, release and the coefficients of the effects that act. Physics only, SI and radians."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from functools import cached_property, lru_cache
from types import MappingProxyType, SimpleNamespace
from typing import Any, NamedTuple, Protocol, TypeVar, cast

from looping_pendulum.errors import ParameterError
from looping_pendulum.reference_ode import effects as effect_library
from looping_pendulum.reference_ode.effects import Effect
from looping_pendulum.reference_ode.effects.library import MIN_LOSS_TIME
from looping_pendulum.reference_ode.effects.own import OwnEffect, check_name, effect_of, own_effect_from, taken_names

Value = TypeVar("Value")

MAX_LENGTH_OR_MASS = 1e9
"""Largest length [m] or mass [kg] that is accepted: far above any apparatus, while its square stays finite."""
# Not `math.degrees`, so that a message can be written for an expression, too
DEGREES_PER_RADIAN = 180 / math.pi
POINT_MASS_END = 1 / 3
"""Free length, in rod radii, at which a light mass without a radius counts as having reached the rod.

It is then within 6 % of a radius of the rod's surface. A true point would go on to pull with a tension M1 w^2 / l beyond all
bounds, and so lift the heavy mass again over the last tenths of a millimetre, which no real mass does.
"""


def touching_length(light_radius: Any, rod_radius: Any) -> Any:
    """Return the free length at which the surface of a light mass touches the rod [m] (numbers or arrays)."""
    return (light_radius**2 + 2 * light_radius * rod_radius) ** 0.5


def string_length(free_length: Any, rod_radius: Any, release_angle: Any, hanging_length: Any, heavy_swing: Any) -> Any:
    """Return the length of the whole string, L = l + R theta + h [m] (paper, before eq. 1), numbers or arrays.

    A heavy mass that hangs at an angle unwinds R times ``heavy_swing`` of it.
    """
    return free_length + rod_radius * (release_angle - heavy_swing) + hanging_length


def derived_values(values: Mapping[str, Any], where: Callable[[Any, Any, Any], Any]) -> dict[str, Any]:
    """Return the numbers that the equations read and that follow from parameters and coefficients, by name.

    Parameters
    ----------
    values
        Parameters and coefficients by name: numbers, arrays or expressions.
    where
        (condition, a, b) -> a where the condition holds, else b; as `numpy.where`.
    """
    light_radius, rod_radius = values["light_radius"], values["rod_radius"]
    has_radius, loss_time = light_radius > 0, values["string_loss_time"]
    # Of a point the touching length is not asked for, as its root has no derivative there
    touching = touching_length(where(has_radius, light_radius, 1.0), rod_radius)
    return {
        "end_length": where(has_radius, touching, POINT_MASS_END * rod_radius),
        "string_length": string_length(
            values["free_length"], rod_radius, values["release_angle"], values["hanging_length"], values["heavy_swing"]
        ),
        # Only the equations see the least damping: the coefficients stay as given
        "string_loss_time": where(loss_time > MIN_LOSS_TIME, loss_time, MIN_LOSS_TIME),
    }


class Requirement(NamedTuple):
    """What an apparatus must fulfil."""

    is_met: Callable[[Mapping[str, Any]], Any]
    """Values by name -> whether it is met; an array if a value is one. NaN meets no requirement."""
    message: Callable[[Mapping[str, Any]], str]
    """Values by name, all of them numbers -> what was found, and what was needed."""


# Conditions are joined by `&`, not `and`, because a value may be an array with one entry per run of a batch.
def _positive(name: str) -> Requirement:
    allowed = f"needed a finite number above 0 and at most {MAX_LENGTH_OR_MASS:g}"
    return Requirement(
        is_met=lambda v: (v[name] > 0) & (v[name] <= MAX_LENGTH_OR_MASS),
        message=lambda v: f"{name}: found {v[name]:g}, {allowed}",
    )


def _within_bounds(name: str, low: float, high: float) -> Requirement:
    return Requirement(
        is_met=lambda v: (v[name] >= low) & (v[name] <= high) & (abs(v[name]) < math.inf),
        message=lambda v: f"{name}: found {v[name]:g}, needed between {low:g} and {high:g}",
    )


OF_THE_APPARATUS = (
    *map(_positive, ("light_mass", "heavy_mass", "rod_radius", "free_length", "hanging_length")),
    Requirement(
        is_met=lambda v: (v["light_radius"] >= 0) & (v["light_radius"] < math.inf),
        message=lambda v: f"light_radius: found {v['light_radius']:g}, needed 0 or more",
    ),
    Requirement(
        is_met=lambda v: (v["release_angle"] > 0) & (v["release_angle"] < 2 * math.pi),
        message=lambda v: f"release_angle: found {v['release_angle'] * DEGREES_PER_RADIAN:g} deg, needed between 0 and 360 deg",
    ),
)
OF_SEVERAL = (
    Requirement(
        is_met=lambda v: v["static_friction"] >= v["kinetic_friction"],
        message=lambda v: (
            f"static_friction: found {v['static_friction']:g}, needed at least kinetic_friction ({v['kinetic_friction']:g})"
        ),
    ),
    Requirement(
        is_met=lambda v: (v["rod_mobility"] == 0) | (v["string_compliance"] == 0),
        message=lambda v: "rod_mobility and string_compliance: found both above 0, needed one of them 0",
    ),
    Requirement(
        is_met=lambda v: v["free_length"] > v["end_length"],
        message=lambda v: (
            f"free_length: found {v['free_length']:g} m, but the light mass already touches the rod "
            f"at {v['end_length']:g} m; lengthen the string or shrink light_radius"
        ),
    ),
)


class EffectTables(NamedTuple):
    """The effects that may act in a run, and what follows from their coefficients."""

    effects: tuple[Effect, ...]
    """Those of the library, then the run's own, in the order in which their forces are summed."""
    defaults: Mapping[str, float]
    """Coefficient -> default [SI]."""
    nulls: Mapping[str, float]
    """Coefficient -> null value [SI]."""
    bounds: Mapping[str, Requirement]
    """Coefficient -> that it is within its bounds."""

    def requirements(self, coefficients: Iterable[str]) -> tuple[Requirement, ...]:
        """Return what an apparatus must fulfil, in the order in which it is checked; of the coefficients, those named."""
        return (*OF_THE_APPARATUS, *map(self.bounds.__getitem__, coefficients), *OF_SEVERAL)


@lru_cache(maxsize=64)
def effect_tables(own_effects: tuple[OwnEffect, ...]) -> EffectTables:
    """Return the tables of the library and of a run's own effects.

    Raises
    ------
    ParameterError
        If an own effect is faulty, or its name is taken.
    """
    taken = taken_names(effect_library.EFFECTS.values())
    for own in own_effects:
        try:
            check_name(own.name, taken)
        except ParameterError as error:
            raise ParameterError(f"own_effects: {error}") from None
        taken.add(own.name)
    effects = (*effect_library.EFFECTS.values(), *map(effect_of, own_effects))
    coefficients = {c.name: c for effect in effects for c in effect.coefficients}
    return EffectTables(
        effects=effects,
        defaults={name: c.default for name, c in coefficients.items()},
        nulls={name: c.null for name, c in coefficients.items()},
        bounds={name: _within_bounds(name, *c.bounds) for name, c in coefficients.items()},
    )


class Release(StrEnum):
    """How the apparatus is released."""

    LOOPING = "looping"
    """The light mass is held at the release angle, the string taut, and let go; the heavy mass is free."""
    VERTICAL = "vertical"
    """Both masses hang vertically and the string slides (an Atwood machine: the paper's friction calibration)."""
    HELD = "held"
    """The heavy mass is clamped: the light mass swings as a pendulum whose string winds on the rod."""
    DROP = "drop"
    """No string at all: both masses fall from where the looping release would have held them."""


@dataclass(frozen=True, kw_only=True)
class Parameters:
    """One apparatus and one release of it.

    Raises
    ------
    ParameterError
        If a quantity is impossible (a negative mass, a static friction below the kinetic one, ...).
    """

    light_mass: float
    """Mass M1 that whips round the rod [kg]."""
    heavy_mass: float
    """Mass M2 that falls and is stopped [kg]."""
    rod_radius: float
    """Radius R of the rod [m]."""
    free_length: float
    """String l from the rod's tangent point to the light mass at release [m]."""
    release_angle: float
    """Wrap angle theta at release [rad]; 0: straight up, pi/2: horizontal, pi: straight down."""
    # In the paper's model it only says how high the heavy mass hangs, and so when it would reach the rod
    hanging_length: float = 0.03
    """String h from the rod's tangent point to the heavy mass at release [m]."""
    light_radius: float = 0.0
    """Radius of the light mass [m]; the run ends when its surface touches the rod. 0: a point."""
    release: Release = Release.LOOPING
    coefficients: Mapping[str, float] = field(default_factory=dict)
    """Coefficient name -> value [SI] of the effects that act; those not named keep their default."""
    own_effects: tuple[OwnEffect, ...] = ()
    """Effects that the library does not have; as plain data, so that every process that gets these parameters has them."""

    def __post_init__(self) -> None:
        """Fill in default coefficients and refuse impossible values."""
        defaults = self._tables.defaults
        unknown = sorted(self.coefficients.keys() - defaults.keys())
        if unknown:
            known = ", ".join(defaults)
            raise ParameterError(f"coefficients: no effect has a coefficient {unknown[0]!r}; known: {known}")
        values = {**defaults, **self.coefficients}
        if "static_friction" not in self.coefficients:
            values["static_friction"] = values["kinetic_friction"]
        object.__setattr__(self, "coefficients", MappingProxyType(values))
        object.__setattr__(self, "release", Release(self.release))
        if self.release is Release.VERTICAL:
            object.__setattr__(self, "release_angle", math.pi)
        self._refuse_impossible(self.coefficients)

    def __repr__(self) -> str:
        """Return Python code that makes these parameters; of the coefficients it has those that act, and changed defaults."""
        defaults = self._tables.defaults
        acting = {name: value for name, value in self.coefficients.items() if value != 0 or value != defaults[name]}
        shown = {f.name: getattr(self, f.name) for f in dataclasses.fields(self)}
        shown |= {"release": self.release.value, "coefficients": acting}
        return f"Parameters({', '.join(f'{name}={value!r}' for name, value in shown.items())})"

    def __reduce__(self) -> tuple[object, ...]:
        """Pickle by value: a read-only mapping does not pickle by itself."""
        return parameters_from, (self.as_dict(),)

    def _refuse_impossible(self, coefficients: Iterable[str]) -> None:
        """Refuse impossible values; of the coefficients, only those named ``coefficients`` are checked against their bounds."""
        values = vars(self) | self._copied_coefficients() | {"end_length": self.end_length}
        for requirement in self._tables.requirements(coefficients):
            if not requirement.is_met(values):
                raise ParameterError(requirement.message(values))

    @property
    def end_length(self) -> float:
        """Free length at which the light mass touches the rod and the run ends [m]."""
        return self._derived["end_length"]

    @property
    def static_equals_kinetic(self) -> bool:
        """Whether static and kinetic friction are equal."""
        return bool(self.coefficients["static_friction"] == self.coefficients["kinetic_friction"])

    def with_static_friction(self, changes: Mapping[str, Value]) -> dict[str, Value]:
        """Return ``changes`` of parameters, to which that of the static friction is added if it follows the kinetic one.

        It does so where both are equal and only the kinetic one is changed: an apparatus with one coefficient keeps one.
        """
        complete = dict(changes)
        if "kinetic_friction" in complete and self.static_equals_kinetic:
            complete.setdefault("static_friction", complete["kinetic_friction"])
        return complete

    @property
    def string_length(self) -> float:
        """Length of the whole string, L = l + R theta + h [m] (paper, before eq. 1), less what a tilted heavy mass unwinds."""
        return self._derived["string_length"]

    @cached_property
    def effects(self) -> tuple[Effect, ...]:
        """Effects that act here: those of the paper's model, and any other with a coefficient off its null value."""
        return self.effects_with(frozenset())

    def effects_with(self, names: Collection[str]) -> tuple[Effect, ...]:
        """Return `effects`, and the effects of the coefficients ``names`` even at their null value."""
        return _active_effects(self._active_coefficients.union(names), self.release, self.own_effects)

    @property
    def _tables(self) -> EffectTables:
        return effect_tables(self.own_effects)

    @cached_property
    def _active_coefficients(self) -> frozenset[str]:
        """Coefficients that are not at their null value."""
        nulls = self._tables.nulls
        return frozenset(name for name, value in self.coefficients.items() if value != nulls[name])

    def values(self) -> SimpleNamespace:
        """Return every parameter and coefficient as an attribute of one object, which the equations read; do not change it."""
        return self._values

    @cached_property
    def _values(self) -> SimpleNamespace:
        fields = {name: getattr(self, name) for name in _FIELDS}
        return SimpleNamespace(**fields | self._copied_coefficients() | self._derived)

    @cached_property
    def _derived(self) -> dict[str, float]:
        numbers = {name: getattr(self, name) for name in NUMBERS} | self._copied_coefficients()
        return derived_values(numbers, lambda condition, a, b: a if condition else b)

    def replace(self, **changes: object) -> Parameters:
        """Return a copy with fields or coefficients changed (``replace(light_mass=0.02, kinetic_friction=0.3)``)."""
        if all(n in NUMBERS or n in self.coefficients for n in changes):
            return self._replace_numbers(changes)
        coefficients = self._copied_coefficients()
        changes = self.with_static_friction(changes)
        for name in [n for n in changes if n in self.coefficients]:
            coefficients[name] = float(changes.pop(name))  # type: ignore[arg-type]
        return dataclasses.replace(self, coefficients=coefficients, **changes)  # type: ignore[arg-type]

    def _replace_numbers(self, changes: Mapping[str, Any]) -> Parameters:
        """Return the same as `replace`, without checking what does not change: a fit asks for thousands of copies."""
        coefficients = self._copied_coefficients()
        moved = self.with_static_friction({name: float(value) for name, value in changes.items() if name in coefficients})
        copy = object.__new__(Parameters)  # without __post_init__, which would check everything again
        fields = vars(copy)
        for name in _FIELDS:
            fields[name] = changes.get(name, getattr(self, name))
        fields["own_effects"] = self.own_effects
        if self.release is Release.VERTICAL:
            fields["release_angle"] = math.pi
        fields["coefficients"] = MappingProxyType(coefficients | moved)
        copy._refuse_impossible(moved)
        nulls = self._tables.nulls
        active = frozenset(name for name, value in moved.items() if value != nulls[name])
        # Fills in the cached property: only coefficients that moved can have changed it
        fields["_active_coefficients"] = self._active_coefficients.difference(moved) | active
        return copy

    def _copied_coefficients(self) -> dict[str, float]:
        return cast("MappingProxyType[str, float]", self.coefficients).copy()

    def without_absent_own_effects(self) -> Parameters:
        """Return the same without those own effects that are at their null value."""
        absent = {own.name for own in self.own_effects} - self._active_coefficients
        return dataclasses.replace(
            self,
            own_effects=tuple(own for own in self.own_effects if own.name not in absent),
            coefficients={name: value for name, value in self.coefficients.items() if name not in absent},
        )

    def as_dict(self) -> dict[str, Any]:
        """Return plain data, for JSON and for another process; `parameters_from` reads it.

        An installed package's effect that does not act has no part in it, so that installing one changes no result and no key.
        """
        data = {name: getattr(self, name) for name in _FIELDS} | {"release": self.release.value}
        absent = {
            c.name: c.default
            for effect in self._tables.effects
            if effect.package and effect not in self.effects
            for c in effect.coefficients
        }
        data |= {"coefficients": {name: x for name, x in self.coefficients.items() if absent.get(name) != x}}
        # Without an own effect there is no key, so that results keep the format and the digest that they always had
        return data | ({"own_effects": [dataclasses.asdict(own) for own in self.own_effects]} if self.own_effects else {})


_FIELDS = tuple(f.name for f in dataclasses.fields(Parameters) if f.name not in ("coefficients", "own_effects"))
NUMBERS = tuple(name for name in _FIELDS if name != "release")
"""Names of the numbers of `Parameters`, beside the coefficients of the effects."""
effect_tables(())  # now, so that every run without own effects finds them in the cache


@lru_cache(maxsize=256)
def _active_effects(
    active_coefficients: frozenset[str], release: Release, own_effects: tuple[OwnEffect, ...]
) -> tuple[Effect, ...]:
    """Return the effects of the paper's model, and those that one of ``active_coefficients`` switches on."""
    names = set(active_coefficients)
    return tuple(
        effect
        for effect in effect_tables(own_effects).effects
        if (effect.in_base_model or effect.is_active(names)) and is_possible(effect, release)
    )


class HasParameters(Protocol):
    """What has parameters and a duration: a scenario, whose module is in a higher layer."""

    @property
    def parameters(self) -> Parameters:
        """Apparatus, release and coefficients."""

    @property
    def duration(self) -> float:
        """Time for which the motion is wanted [s]."""


def parameters_of(given: Parameters | HasParameters) -> Parameters:
    """Return what is ``given``, if it is parameters, or the parameters that it has."""
    return given if isinstance(given, Parameters) else given.parameters


def parameters_from(data: Mapping[str, Any]) -> Parameters:
    """Return the parameters whose plain data these are (`Parameters.as_dict`), as JSON keeps them.

    Raises
    ------
    ParameterError
        If they are impossible.
    """
    return Parameters(**{**data, "own_effects": tuple(own_effect_from(own) for own in data.get("own_effects", ()))})


def is_possible(effect: Effect, release: Release) -> bool:
    """Return whether the apparatus has what ``effect`` needs after this release: a string, a pivot."""
    return not ((effect.needs_string and release is Release.DROP) or (effect.needs_pivot and release is not Release.HELD))
