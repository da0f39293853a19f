"""The one shape that every engine has, the reference included."""

from __future__ import annotations

import abc
import copy
import dataclasses
import functools
import importlib.metadata
import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, ClassVar, Protocol, Self, runtime_checkable

import numpy as np

from looping_pendulum.engines.studies import Studies
from looping_pendulum.engines.trajectory import (
    COLUMNS,
    Provenance,
    RunStatus,
    Supplier,
    Supplies,
    Supply,
    Trajectory,
    from_samples,
    whole_row,
)
from looping_pendulum.engines.validated import ValidatedRange, outside_range
from looping_pendulum.errors import EngineError
from looping_pendulum.reference_ode.effects import Effect, EffectKind
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import Parameters, Release
from looping_pendulum.scenarios.scenario import Scenario

SAMPLE_INTERVAL = 1e-3
"""Time between samples [s]; every engine's step divides it, so that nothing is ever resampled."""

STRETCH_BUDGET = 0.05
"""A string longer than its rest length by more than this fraction ends a run: it no longer is the apparatus."""
REACH = 2.0
"""A mass farther from the rod than so many string lengths ends a run: a chain of rigid links breaks down without stretching."""


FORCES_AND_RELEASE = frozenset({EffectKind.FORCE, EffectKind.CLOSURE, EffectKind.RELEASE})
"""What reaches an engine that applies the effects' forces and starts with the release's velocities."""

APPLIED_DRAG = Supply(by=Supplier.ADAPTER, how="the reference's formulas as applied forces")
"""Who supplies the drag in an engine that applies the effects' forces."""


STATIC_FRICTION = "static_friction"


def needed_physics(parameters: Parameters) -> tuple[str, ...]:
    """Pieces of physics, of those that `Supplies` names, that a scenario with ``parameters`` has at all."""
    c = parameters.coefficients
    needed: list[str] = []
    if parameters.release is not Release.DROP:
        needed.append("winding")
    if parameters.release in (Release.LOOPING, Release.VERTICAL) and c["kinetic_friction"] > 0:
        needed += ["friction_law", "stick_slip"]
    if any(value > 0 for name, value in c.items() if name.endswith("_drag")):
        needed.append("drag")
    return tuple(needed)


def needs_static_friction(parameters: Parameters) -> bool:
    """Whether the string may stick with more friction than it slides with, as ``parameters`` say it."""
    c = parameters.coefficients
    return parameters.release in (Release.LOOPING, Release.VERTICAL) and c["static_friction"] != c["kinetic_friction"]


class Profile(StrEnum):
    """How much a run may cost."""

    QUICK = "quick"
    """Seconds: for a first look and for the tests."""
    ACCURATE = "accurate"
    """Minutes: the best that the adapter knows."""


@dataclass(frozen=True, kw_only=True)
class Abilities:
    """What an engine variant can do, as plain data."""

    releases: frozenset[Release]
    """Releases that it can represent."""
    supplies: Supplies
    packages: tuple[str, ...]
    """Packages that it needs, as Python imports them: "pydrake", which pip calls "drake"."""
    summary: str
    """One sentence on what the variant is."""
    limits: tuple[str, ...] = ()
    """What it cannot do, each with its reason."""
    effect_kinds: frozenset[EffectKind] = frozenset({EffectKind.FORCE, EffectKind.CLOSURE})
    """Kinds of effects beyond the paper's model that reach it; forces reach every engine (`reference_ode.cartesian`).

    An engine with `EffectKind.RELEASE` starts with `reference_ode.cartesian.release_velocity`.
    """
    known_failures: Mapping[str, str] = field(default_factory=dict)
    """Checks of `engines.conformance` that it fails -> the measured reason: strict expected failures."""
    static_friction: bool = False
    """Whether a static friction other than the kinetic one reaches it; one that takes `EffectKind.STRING_LAW` has it anyway."""
    additions: tuple[str, ...] = ()
    """What the adapter puts in beyond the engine, each with its measured worth."""
    validated: tuple[ValidatedRange, ...] = ()
    """Over which scenarios its accuracy was measured, per profile, and what it was."""
    main: bool = True
    """Whether a comparison that names no engine runs it; the others are for studies, and catastrophic ones among them."""

    def unsupported(self, parameters: Parameters) -> str:
        """Return what of ``parameters`` this variant cannot represent; empty: nothing."""
        if parameters.release not in self.releases:
            return f"release {parameters.release.value!r}"
        beyond = (e for e in parameters.effects if not e.in_base_model and not self.reaches(e))
        return ", ".join(f"effect {e.name!r} ({e.kind.value})" for e in beyond)

    def lacks(self, parameters: Parameters) -> tuple[str, ...]:
        """Names of the physics that ``parameters`` have and this variant runs without, among `needed_physics`."""
        lacking = [what for what in needed_physics(parameters) if getattr(self.supplies, what).by is Supplier.NOBODY]
        if needs_static_friction(parameters) and not (self.static_friction or EffectKind.STRING_LAW in self.effect_kinds):
            lacking.append(STATIC_FRICTION)
        return tuple(lacking)

    def outside_range(self, profile: str, parameters: Parameters) -> tuple[str, ...]:
        """Return what of ``parameters`` lies outside the range in which ``profile``'s accuracy was measured; empty: nothing."""
        return outside_range(self.validated, profile, parameters)

    def reaches(self, effect: Effect) -> bool:
        """Whether ``effect`` reaches this variant; one that adds variables to the state is a property whatever its kind."""
        kinds = {effect.kind, EffectKind.PROPERTY} if effect.variables else {effect.kind}
        return kinds <= self.effect_kinds


def declared(engine: Engine, parameters: Parameters) -> dict[str, Any]:
    """Return the fields of a `Trajectory` that follow from what ``engine`` declares of itself, whatever its run does."""
    return {
        "lacks": engine.abilities.lacks(parameters),
        "additions": engine.abilities.additions,
        "outside_range": engine.abilities.outside_range(engine.profile.value, parameters),
    }


class Recorder(Protocol):
    """Where samples go as they are made, so that a crash loses none; see `isolation.FileRecorder`."""

    def add(self, row: Sequence[float]) -> None:
        """Keep one row of `COLUMNS`."""

    def rows(self) -> Array:
        """All rows kept so far, shape (n, len(COLUMNS))."""


class MemoryRecorder:
    """Keeps samples in this process."""

    def __init__(self) -> None:
        self._rows: list[tuple[float, ...]] = []

    def add(self, row: Sequence[float]) -> None:
        """Keep one row of `COLUMNS`."""
        self._rows.append(tuple(whole_row(row)))

    def rows(self) -> Array:
        """All rows kept so far, shape (n, len(COLUMNS))."""
        return np.array(self._rows, dtype=float).reshape(-1, len(COLUMNS))


@runtime_checkable
class Engine(Protocol):
    """Simulates scenarios. Making one imports nothing; its package is imported by `simulate`."""

    name: str
    variant: str
    profile: Profile
    abilities: Abilities
    settings: Any
    """A frozen dataclass of every numerical setting that changes the answer, SI."""

    def simulate(self, scenario: Scenario, recorder: Recorder | None = None) -> Trajectory:
        """Run ``scenario`` from its release to its duration, or until the light mass reaches the rod."""

    def studies(self) -> Studies:
        """What can be varied of this variant, with its settings as the middle of it."""


class Rig(Protocol):
    """The apparatus, built in one engine."""

    def advance(self) -> None:
        """Step the engine through one `SAMPLE_INTERVAL`, applying the effects' forces at every step."""

    def read(self) -> tuple[float, ...]:
        """Positions [m], velocities [m/s], string stretch and, where known, string slip [m]: `COLUMNS` without the time."""


class SteppedEngine(abc.ABC):
    """An engine that steps through time: an adapter says how to build its rig, and the loop is here."""

    name: str
    variant: str
    profile: Profile
    abilities: Abilities
    settings: Any

    @abc.abstractmethod
    def build(self, scenario: Scenario) -> Rig:
        """Rebuild the scenario's apparatus at the moment of release."""

    @abc.abstractmethod
    def versions(self) -> dict[str, str]:
        """Package -> version of what `simulate` uses."""

    def end_length(self, scenario: Scenario) -> float:
        """Free length [m] at which the run ends; an adapter raises it where its rig cannot follow further."""
        return max(scenario.parameters.end_length, 4e-3)

    def simulate(self, scenario: Scenario, recorder: Recorder | None = None) -> Trajectory:
        """Run ``scenario`` from its release to its duration, or until the light mass reaches the rod."""
        recorder = recorder if recorder is not None else MemoryRecorder()
        rig = self.build(scenario)
        started = time.perf_counter()
        status = _run(rig, scenario, self.end_length(scenario), recorder.add)
        return from_samples(
            recorder.rows(),
            parameters=scenario.parameters,
            engine=self.name,
            variant=self.variant,
            profile=self.profile.value,
            scenario=scenario.name,
            status=status,
            wall_time=time.perf_counter() - started,
            provenance=self.provenance(),
            **declared(self, scenario.parameters),
        )

    def with_settings(self, **changes: object) -> Self:
        """Return this variant with some settings changed."""
        changed = copy.copy(self)
        changed.settings = dataclasses.replace(self.settings, **changes)
        return changed

    def studies(self) -> Studies:
        """What can be varied of this variant; an adapter that has nothing to vary keeps this."""
        return Studies()

    def provenance(self) -> Provenance:
        """Versions, settings and suppliers of this engine's runs."""
        return Provenance(
            versions=self.versions(), settings=dataclasses.asdict(self.settings), supplies=self.abilities.supplies
        )


class TunedEngine(SteppedEngine):
    """A stepped engine of one package, with settings of its own for each profile.

    Parameters
    ----------
    profile
        Chooses the settings.
    settings
        Replaces the profile's settings, for studies of convergence.
    """

    distribution: ClassVar[str]
    """The engine's package, as pip names it."""
    tuned: ClassVar[Mapping[Profile, Any]]
    """Profile -> settings."""

    def __init__(self, *, profile: Profile = Profile.QUICK, settings: Any = None) -> None:
        self.profile = profile
        self.settings = settings if settings is not None else self.tuned[profile]

    def versions(self) -> dict[str, str]:
        """Version of the engine's package."""
        return {self.distribution: installed_version(self.distribution)}


@functools.cache
def installed_version(distribution: str) -> str:
    """Version of an installed package, read once: looking it up takes longer than a short run."""
    return importlib.metadata.version(distribution)


def steps_per_sample(time_step: float) -> int:
    """Steps of ``time_step`` [s] in one `SAMPLE_INTERVAL`.

    Raises
    ------
    EngineError
        If it is no whole number.
    """
    steps = round(SAMPLE_INTERVAL / time_step)
    if steps < 1 or not math.isclose(steps * time_step, SAMPLE_INTERVAL, rel_tol=1e-9):
        raise EngineError(
            f"time_step: found {time_step:g} s, which does not divide the sample interval; "
            f"needed a whole fraction of {SAMPLE_INTERVAL:g} s; write 1e-4"
        )
    return steps


def groups_per_sample(time_step: float, steps_per_group: int) -> int:
    """Groups of steps of ``time_step`` [s] in one `SAMPLE_INTERVAL`.

    Raises
    ------
    EngineError
        If steps or groups are no whole number.
    """
    steps = steps_per_sample(time_step)
    if steps % steps_per_group:
        raise EngineError(
            f"time_step: found {time_step:g} s in groups of {steps_per_group}, needed a whole number of groups "
            f"in {SAMPLE_INTERVAL:g} s; write groups of 1"
        )
    return steps // steps_per_group


def _run(rig: Rig, scenario: Scenario, end_length: float, add: Callable[[Sequence[float]], None]) -> RunStatus:
    """Advance ``rig`` sample by sample; say how it ended."""
    p = scenario.parameters
    has_string = p.release is not Release.DROP
    end_distance = math.hypot(end_length, p.rod_radius)
    stretch_limit, reach = STRETCH_BUDGET * p.string_length, REACH * p.string_length
    row = rig.read()
    add((0.0, *row))
    for sample in range(1, round(scenario.duration / SAMPLE_INTERVAL) + 1):
        rig.advance()
        row = rig.read()
        if not all(math.isfinite(value) for value in row[:8]):
            return RunStatus.NOT_FINITE
        if has_string and max(math.hypot(*row[:2]), math.hypot(*row[4:6])) > reach:
            return RunStatus.OUT_OF_REACH
        if has_string and math.hypot(row[0], row[1]) <= end_distance:
            return RunStatus.LIGHT_REACHED_ROD  # somewhere in this interval: a rig that stopped there has no sample at its end
        add((sample * SAMPLE_INTERVAL, *row))
        if has_string and row[8] > stretch_limit:
            return RunStatus.STRING_DRIFT
    return RunStatus.FINISHED
