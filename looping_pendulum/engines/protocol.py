"""The interface of every engine, the reference included, and the time loop that stepped engines share."""

from __future__ import annotations

import copy
import dataclasses
import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, Protocol, Self, runtime_checkable

import numpy as np

from looping_pendulum.engines import Profile as Profile
from looping_pendulum.engines.facts import ValidatedRange
from looping_pendulum.engines.studies import Studies
from looping_pendulum.errors import EngineError
from looping_pendulum.reference_ode.effects import Effect, EffectKind
from looping_pendulum.reference_ode.parameters import Parameters, Release
from looping_pendulum.runs.trajectory import (
    SAMPLE_INTERVAL,
    Provenance,
    RunStatus,
    Supplier,
    Supplies,
    Supply,
    Trajectory,
    check_column_count,
    from_samples,
)
from looping_pendulum.scenarios.scenario import Scenario
from looping_pendulum.versions import installed_version

MAX_STRETCH_FRACTION = 0.05
"""Stretch of the string, as a fraction of its rest length, that ends a run: beyond it the rig no longer is the apparatus."""
MAX_DISTANCE_FACTOR = 2.0
"""Distance of a mass from the rod, in string lengths, that ends a run.

It catches chains of rigid links, which break down without stretching.
"""


FORCES_AND_RELEASE = frozenset({EffectKind.FORCE, EffectKind.CLOSURE, EffectKind.RELEASE})
"""Kinds of effects that reach an engine which applies the effects' forces and starts with the release's velocities."""

APPLIED_DRAG = Supply(by=Supplier.ADAPTER, how="the reference's formulas as applied forces")
"""Supplier of the drag in an engine that applies the effects' forces."""

STATIC_FRICTION = "static_friction"
"""Name of a static friction other than the kinetic one among the physics that an engine lacks (`Abilities.lacks`)."""


def physics_of(parameters: Parameters) -> tuple[str, ...]:
    """Return which pieces of physics named in `Supplies` a scenario with ``parameters`` contains."""
    c = parameters.coefficients
    pieces: list[str] = []
    if parameters.release is not Release.DROP:
        pieces.append("winding")
    # A held string does not slide over the rod
    if parameters.release in (Release.LOOPING, Release.VERTICAL) and c["kinetic_friction"] > 0:
        pieces += ["friction_law", "stick_slip"]
    # Every coefficient of drag has such a name
    if any(value > 0 for name, value in c.items() if name.endswith("_drag")):
        pieces.append("drag")
    return tuple(pieces)


@dataclass(frozen=True, kw_only=True)
class Abilities:
    """What an engine variant can do, as plain data."""

    releases: frozenset[Release]
    """Releases that it can represent."""
    supplies: Supplies
    """Who supplies which physics."""
    packages: tuple[str, ...]
    """Packages that it needs, as Python imports them: "pydrake", which pip calls "drake"."""
    summary: str
    """One sentence on what the variant is."""
    limits: tuple[str, ...] = ()
    """What it cannot do, each with its reason."""
    effect_kinds: frozenset[EffectKind] = frozenset({EffectKind.FORCE, EffectKind.CLOSURE})
    """Kinds of effects beyond the paper's model that reach it; forces reach every engine (`reference_ode.cartesian`).

    An engine with `EffectKind.RELEASE` starts with `reference_ode.cartesian.masses_at_release`.
    """
    known_failures: Mapping[str, str] = field(default_factory=dict)
    """Checks of `engines.conformance` that it fails -> the measured reason: strict expected failures."""
    static_friction: bool = False
    """Whether the variant has a static friction other than the kinetic one; with `EffectKind.STRING_LAW` it has one anyway."""
    additions: tuple[str, ...] = ()
    """What the adapter adds beyond the engine, each with its measured effect on the error."""
    from_reference: tuple[str, ...] = ()
    """What the adapter takes from the reference's own run of the scenario, each in a few words: "the length of a step"."""
    validated: tuple[ValidatedRange, ...] = ()
    """Ranges of scenarios over which its accuracy was measured, per profile, with the errors."""
    min_rod_radius: float = 0.0
    """Smallest radius of a rod that the variant can wind a string over, with any profile [m]; a drop has no rod."""
    main: bool = True
    """Whether a comparison that names no engine runs it; the other variants are for studies, and some fail badly on purpose."""

    def unsupported(self, parameters: Parameters) -> str:
        """Return which part of ``parameters`` this variant cannot represent; empty: none."""
        if parameters.release not in self.releases:
            return f"release {parameters.release.value!r}"
        if parameters.release is not Release.DROP and parameters.rod_radius < self.min_rod_radius:
            return f"a rod of {1e3 * parameters.rod_radius:.4g} mm radius, it needs {1e3 * self.min_rod_radius:.4g} mm or more"
        unreached = (e for e in parameters.effects if not e.in_base_model and not self.reaches(e))
        return ", ".join(f"effect {e.name!r} ({e.kind.value})" for e in unreached)

    def lacks(self, parameters: Parameters) -> tuple[str, ...]:
        """Return the names of the physics that ``parameters`` contain and this variant runs without."""
        lacking = [piece for piece in physics_of(parameters) if getattr(self.supplies, piece).by is Supplier.NOBODY]
        c, slides = parameters.coefficients, parameters.release in (Release.LOOPING, Release.VERTICAL)
        has_own = self.static_friction or EffectKind.STRING_LAW in self.effect_kinds
        if slides and c["static_friction"] != c["kinetic_friction"] and not has_own:
            lacking.append(STATIC_FRICTION)
        return tuple(lacking)

    def outside_range(self, profile: str, parameters: Parameters) -> tuple[str, ...]:
        """Return which quantities of ``parameters`` lie outside the range over which ``profile``'s accuracy was measured.

        Each is a phrase as of `ValidatedRange.outside`. A variant that states no range gives none. If it states several
        ranges, the one with the fewest quantities outside counts.
        """
        known = [each for each in self.validated if each.profile == profile]
        if not known:
            return ()
        if all(parameters.release not in each.releases for each in known):
            return (f"release {parameters.release.value!r} (measured: {', '.join(sorted(known[0].releases))})",)
        return min((each.outside(parameters) for each in known), key=len)

    def reaches(self, effect: Effect) -> bool:
        """Return whether ``effect`` reaches this variant.

        An effect that adds variables to the state needs `EffectKind.PROPERTY` besides its own kind.
        """
        kinds = {effect.kind, EffectKind.PROPERTY} if effect.variables else {effect.kind}
        return kinds <= self.effect_kinds


RecordSample = Callable[[Sequence[float]], None]
"""Function that stores one sample, a row of `COLUMNS`, as soon as it is computed, so that a crash loses none."""


def known_fields(engine: Engine, scenario: Scenario) -> dict[str, Any]:
    """Return the fields of a `Trajectory` that are known of ``engine`` and ``scenario`` before the run."""
    abilities, p = engine.abilities, scenario.parameters
    return {
        "engine": engine.name,
        "variant": engine.variant,
        "profile": engine.profile.value,
        "scenario": scenario.name,
        "lacks": abilities.lacks(p),
        "additions": abilities.additions,
        "from_reference": abilities.from_reference,
        "outside_range": abilities.outside_range(engine.profile.value, p),
    }


# `registry` asks isinstance of engines that other packages offer
@runtime_checkable
class Engine(Protocol):
    """Simulates scenarios.

    Constructing an engine imports nothing of its package; `simulate` imports it. So an engine can be listed where its package
    is missing, and can be pickled for the process in which it runs.
    """

    name: str
    variant: str
    """Empty for an engine without variants."""
    profile: Profile
    abilities: Abilities
    settings: Any
    """A frozen dataclass of every numerical setting that changes the result, SI."""

    def simulate(self, scenario: Scenario, record: RecordSample | None = None) -> Trajectory:
        """Run ``scenario`` from its release to its duration, or until the light mass reaches the rod."""

    def with_settings(self, **changes: Any) -> Engine:
        """Return this variant with some settings changed."""

    def studies(self) -> Studies:
        """Return what can be varied of this variant, starting from its settings."""


class Rig(Protocol):
    """The apparatus as built in one engine, ready to be stepped."""

    def advance(self) -> None:
        """Step the engine through one `SAMPLE_INTERVAL`, applying the effects' forces at every step."""

    def read(self) -> tuple[float, ...]:
        """Return positions [m], velocities [m/s], string stretch and slip [m]: `COLUMNS` without the time.

        The slip counts from anywhere: that of the first reading is taken off. Stretch and slip are NaN where not known.
        """


class SteppedEngine:
    """An engine that steps through time: the adapter builds the rig, and this class has the time loop.

    Parameters
    ----------
    variant
        One of `variants`, where the class has several.
    profile
        Chooses the settings.
    settings
        Replaces the profile's settings.
    """

    name: str
    variant: str
    profile: Profile
    abilities: Abilities
    settings: Any
    distribution: ClassVar[str]
    """The engine's package, as pip names it; where there are several, override `versions`."""
    rig: ClassVar[Callable[..., Any]]
    """Class of the apparatus, called with parameters and settings; where it needs more, override `build`."""
    variants: ClassVar[Mapping[str, Abilities]] = {}
    """Variant -> its abilities, where the class has several."""
    settings_by_profile: ClassVar[Mapping[Any, Any]]
    """Profile, or variant and profile -> settings."""

    def __init__(self, *, variant: str | None = None, profile: Profile = Profile.QUICK, settings: Any = None) -> None:
        if self.variants:
            self.variant = variant or self.variant
            self.abilities = self.variants[self.variant]
        self.profile = profile
        usual = self.settings_by_profile
        self.settings = settings if settings is not None else usual.get((self.variant, profile), usual.get(profile))

    def build(self, scenario: Scenario) -> Rig:
        """Build the scenario's apparatus at the moment of release."""
        rig: Rig = self.rig(scenario.parameters, self.settings)
        return rig

    def versions(self) -> dict[str, str]:
        """Return the version of each package that `simulate` uses."""
        return {self.distribution: installed_version(self.distribution)}

    def end_length(self, scenario: Scenario) -> float:
        """Return the free length [m] at which the run ends; an adapter raises it where its rig cannot follow further."""
        # With less than 4 mm of string the light mass turns so fast that steps cannot follow; MuJoCo breaks down there
        return max(scenario.parameters.end_length, 4e-3)

    def simulate(self, scenario: Scenario, record: RecordSample | None = None) -> Trajectory:
        """Run ``scenario`` from its release to its duration, or until the light mass reaches the rod."""
        rows: list[Sequence[float]] = []

        def add(row: Sequence[float]) -> None:
            check_column_count(len(row))
            rows.append(row)
            if record is not None:
                record(row)

        rig = self.build(scenario)
        started, cpu_started = time.perf_counter(), time.process_time()
        status = _run(rig, scenario, self.end_length(scenario), add)
        return from_samples(
            np.array(rows, dtype=float),
            parameters=scenario.parameters,
            status=status,
            wall_time=time.perf_counter() - started,
            cpu_time=time.process_time() - cpu_started,
            provenance=self.provenance(),
            **known_fields(self, scenario),
        )

    def with_settings(self, **changes: Any) -> Self:
        """Return this variant with some settings changed."""
        # A copy, not a call of the constructor, whose arguments differ between variants
        changed = copy.copy(self)
        changed.settings = dataclasses.replace(self.settings, **changes)
        return changed

    def studies(self) -> Studies:
        """Return what can be varied of this variant; an adapter that has nothing to vary keeps this."""
        return Studies()

    def provenance(self) -> Provenance:
        """Return versions, settings and suppliers of this engine's runs."""
        return Provenance(
            versions=self.versions(), settings=dataclasses.asdict(self.settings), supplies=self.abilities.supplies
        )


def steps_per_sample(time_step: float) -> int:
    """Return the number of steps of ``time_step`` [s] in one `SAMPLE_INTERVAL`.

    Raises
    ------
    EngineError
        If it is not a whole number.
    """
    steps = round(SAMPLE_INTERVAL / time_step)
    if steps < 1 or not math.isclose(steps * time_step, SAMPLE_INTERVAL, rel_tol=1e-9):
        raise EngineError(
            f"time_step: found {time_step:g} s, which does not divide the sample interval; "
            f"needed a whole fraction of {SAMPLE_INTERVAL:g} s; write 1e-4"
        )
    return steps


@dataclass(frozen=True, kw_only=True)
class StepGroups:
    """Settings of an engine that takes its steps in groups."""

    time_step: float
    """Length of a step [s]; it must divide the sample interval."""
    steps_per_group: int
    """Steps between two updates of what the adapter sees to."""

    def __post_init__(self) -> None:
        """Raise EngineError where groups of steps do not divide the sample interval."""
        if steps_per_sample(self.time_step) % self.steps_per_group:
            raise EngineError(
                f"time_step: found {self.time_step:g} s in groups of {self.steps_per_group}, needed a whole number of groups "
                f"in {SAMPLE_INTERVAL:g} s; write groups of 1"
            )

    @property
    def groups_per_sample(self) -> int:
        """Number of groups of steps in one sample interval."""
        return steps_per_sample(self.time_step) // self.steps_per_group

    @property
    def group_time(self) -> float:
        """Length of a group [s]."""
        return self.steps_per_group * self.time_step


def _run(rig: Rig, scenario: Scenario, end_length: float, add: Callable[[Sequence[float]], None]) -> RunStatus:
    """Advance ``rig`` sample by sample, pass each sample to ``add``, and return how the run ended."""
    p = scenario.parameters
    has_string = p.release is not Release.DROP
    end_distance = math.hypot(end_length, p.rod_radius)
    max_stretch, max_distance = MAX_STRETCH_FRACTION * p.string_length, MAX_DISTANCE_FACTOR * p.string_length
    row = rig.read()
    slip_at_release = row[-1]
    add((0.0, *row[:-1], row[-1] - slip_at_release))
    for sample in range(1, round(scenario.duration / SAMPLE_INTERVAL) + 1):
        rig.advance()
        row = rig.read()
        if not all(math.isfinite(value) for value in row[:8]):  # positions and velocities; stretch and slip may be NaN
            return RunStatus.NOT_FINITE
        if has_string and max(math.hypot(*row[:2]), math.hypot(*row[4:6])) > max_distance:
            return RunStatus.OUT_OF_REACH
        if has_string and math.hypot(row[0], row[1]) <= end_distance:
            # Inside this interval, and the rig may have stopped there: so its end is no sample
            return RunStatus.LIGHT_REACHED_ROD
        # Multiplied, not summed up, so that rounding does not accumulate in the times
        add((sample * SAMPLE_INTERVAL, *row[:-1], row[-1] - slip_at_release))
        # False for NaN, the stretch of an engine that does not know it
        if has_string and row[8] > max_stretch:
            return RunStatus.STRING_DRIFT
    return RunStatus.FINISHED
