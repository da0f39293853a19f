"""List all engines, find out which of them are installed, and select those that a user names."""

from __future__ import annotations

import dataclasses
import difflib
import warnings
from collections.abc import Collection, Iterable, Sequence
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from importlib.util import find_spec
from typing import Any

from looping_pendulum.engines.protocol import Abilities, Engine, Profile, SteppedEngine
from looping_pendulum.errors import EngineError, MissingPackageError, ScenarioError
from looping_pendulum.installation import install_command
from looping_pendulum.runs.trajectory import variant_label
from looping_pendulum.scenarios.scenario import Scenario

ADAPTERS = {
    "reference": "looping_pendulum.engines.reference",
    "mujoco": "looping_pendulum.engines.mujoco",
    "pymunk": "looping_pendulum.engines.pymunk",
    "pybullet": "looping_pendulum.engines.pybullet",
}
"""Engine name -> module of its adapter, which has ``engines(profile) -> list[Engine]``."""

ENTRY_POINTS = "looping_pendulum.engines"
"""Group of entry points by which other packages offer adapters: name -> module, as in `ADAPTERS`."""

ENGINE_MEMBERS = ("name", "variant", "profile", "abilities", "settings", "simulate", "studies")
"""Attributes and methods that an engine must have (`protocol.Engine`)."""

ALL_VARIANTS = "all"
"""Name by which a user selects every variant, including those that are only for studies."""

DISTRIBUTIONS = {"pydrake": "drake"}
"""Package, as Python imports it -> the name by which pip knows it, where the two differ."""

WHERE_IT_INSTALLS = {
    "pydrake": "Linux, from glibc 2.34 on; on a Mac with an ARM processor from Python 3.12 on; not on Windows",
    "pyb2d3": "Linux, Macs with an ARM processor, and Windows on x86-64",
    "rapier3d": "Linux, Macs with an ARM processor, and Windows on x86-64",
    "exudyn": "all systems but Windows on ARM",
    "newton": "all systems but Macs with an Intel processor, and Linux on ARM with a glibc before 2.34",
    "mujoco": "all systems but Macs with an Intel processor and Windows on ARM",
    "pybullet": "Linux on x86-64 with Python 3.11 only; elsewhere pip compiles it for many minutes, which needs a C++ compiler",
}
"""Package, as Python imports it -> the systems for which PyPI has it compiled, if they are not all (docs/install.md)."""


class AdapterWarning(UserWarning):
    """Another package's adapter cannot be used and is skipped; the message says why and what to do."""


def label(engine: Engine) -> str:
    """Return engine and variant as one name, as `variant_label` does."""
    return variant_label(engine.name, engine.variant)


def how_to_get(package: str, *, anywhere: bool = False) -> str:
    """Return the command that installs a package, as Python imports it, and on which systems that works.

    ``anywhere``: for text that is read on other machines (see `install_command`).
    """
    where = f" ({WHERE_IT_INSTALLS[package]})" if package in WHERE_IT_INSTALLS else ""
    return f"`{install_command(DISTRIBUTIONS.get(package, package), anywhere=anywhere)}`{where}"


@cache
def adapter_modules() -> tuple[EntryPoint, ...]:
    """Return the adapters of this package, then those of other packages in the order of their names."""
    own = (EntryPoint(name, module, ENTRY_POINTS) for name, module in ADAPTERS.items())
    return (*own, *sorted(set(entry_points(group=ENTRY_POINTS)), key=lambda point: (point.name, point.value)))


def _package(adapter: EntryPoint) -> str:
    """Return the distribution that offers an adapter; empty for those of this package."""
    return adapter.dist.name if adapter.dist else ""


def all_engines(profile: Profile) -> list[Engine]:
    """Return every engine variant with its settings for ``profile``, installed or not.

    Another package's adapter that cannot be used is skipped with an `AdapterWarning`: it must not cost the others' results.
    """
    engines, faults = load_engines(profile)
    _warn(faults)
    return engines


def _warn(faults: dict[str, str]) -> None:
    """Warn of each adapter that cannot be used."""
    for fault in faults.values():
        warnings.warn(fault, AdapterWarning, stacklevel=3)


def adapter_packages() -> dict[str, str]:
    """Map the name of each engine of another package to the distribution that offers its adapter."""
    return {adapter.name: _package(adapter) for adapter in adapter_modules() if adapter.name not in ADAPTERS}


def load_engines(profile: Profile) -> tuple[list[Engine], dict[str, str]]:
    """Return all engines, and for each adapter of another package that cannot be used one line that says why."""
    engines: list[Engine] = []
    faults: dict[str, str] = {}
    for adapter in adapter_modules():
        if not _package(adapter) and adapter.name in ADAPTERS:
            # Not within the try: a fault in an adapter of this package is a bug, and must show
            engines += adapter.load().engines(profile)
            continue
        taken = {engine.name for engine in engines} | ADAPTERS.keys()
        try:
            engines += _engines_of_other_package(adapter, profile, taken)
        except (Exception, SystemExit) as error:  # foreign code may raise anything, and must not end this program
            why = str(error) if isinstance(error, EngineError) else f"{type(error).__name__}: {error}"
            faults[adapter.name] = (
                f"engine {adapter.name!r} is left out: adapter {adapter.value} of the package {_package(adapter) or '?'}: "
                f"{' '.join(why.split())}; mend or uninstall that package"
            )
    return engines, faults


def _engines_of_other_package(adapter: EntryPoint, profile: Profile, taken: Collection[str]) -> list[Engine]:
    """Return the engines of another package's adapter, after checking what the other engines' results depend on."""
    if adapter.name in taken:
        raise EngineError(f"the name {adapter.name!r} is taken; needed another entry point name")
    engines = list(adapter.load().engines(profile))
    for engine in engines:
        if not isinstance(engine, Engine):
            lacking = [name for name in ENGINE_MEMBERS if not hasattr(engine, name)]
            raise EngineError(f"engines() gave {type(engine).__name__} without {', '.join(lacking)}; see engines/protocol.py")
        if engine.name != adapter.name:
            raise EngineError(f"engines() gave one called {engine.name!r}; needed the entry point's name, {adapter.name!r}")
        if not dataclasses.is_dataclass(engine.settings):
            raise EngineError(f"{label(engine)}: settings are {type(engine.settings).__name__}, needed a frozen dataclass")
        if not isinstance(engine.abilities, Abilities):
            raise EngineError(f"{label(engine)}: abilities are {type(engine.abilities).__name__}, needed Abilities")
    labels = [label(engine) for engine in engines]
    if len(set(labels)) < len(labels):
        raise EngineError(f"engines() gave two of one name among {', '.join(labels)}")
    return engines


def unknown_engine_message(name: str, engines: Iterable[Engine]) -> str:
    """Return a message that none of ``engines`` is called ``name``, with the nearest name and a list of all."""
    engines = tuple(engines)
    known = [label(engine) for engine in engines]
    near = difflib.get_close_matches(name, [*{engine.name for engine in engines}, *known], n=1)
    hint = f"; did you mean {near[0]!r}?" if near else "."
    return f"no engine is called {name!r}{hint} Known: {', '.join(known)}"


def missing_packages(engine: Engine) -> tuple[str, ...]:
    """Return the packages that ``engine`` needs and that are not installed."""
    return tuple(package for package in engine.abilities.packages if not _importable(package))


def _importable(package: str) -> bool:
    try:
        return find_spec(package) is not None
    except (ImportError, ValueError):  # for "a.b" if "a" is missing, and for a module that is only partly imported
        return False


def main_engines(profile: Profile) -> list[Engine]:
    """Return the engines that are compared with the reference if none is named: all main variants."""
    return [engine for engine in all_engines(profile) if engine.name != "reference" and engine.abilities.main]


def select(names: Iterable[str], profile: Profile) -> list[Engine]:
    """Return the engines with these ``names``: "pymunk" for all its variants, "mujoco:capstan" for one variant, "all" for all.

    Raises
    ------
    EngineError
        If a name is not known (the message lists those that are), or if it is that of an adapter which cannot be used.
    """
    names = tuple(names)
    engines, faults = load_engines(profile)
    if ALL_VARIANTS in names:
        _warn(faults)
    chosen: list[Engine] = []
    for name in names:
        # Another package's faulty adapter under one of our names does not make our engine unusable
        if name.partition(":")[0] in faults.keys() - ADAPTERS.keys():
            raise EngineError(f"--engine: {faults[name.partition(':')[0]]}")
        matches = [engine for engine in engines if name in (engine.name, label(engine))]
        if name == ALL_VARIANTS:
            matches = [engine for engine in engines if engine.name != "reference"]
        if not matches:
            raise EngineError(f"--engine: {unknown_engine_message(name, engines)}")
        chosen += [engine for engine in matches if engine not in chosen]
    return chosen


def engine(name: str, *, profile: Profile | str = Profile.QUICK, **settings: Any) -> Engine:
    """Return one engine, ready for ``engine(...).simulate(scenario)`` in this process.

    Parameters
    ----------
    name
        "mujoco:capstan" for a variant; the engine's name alone, if it has one main variant; "reference" for the exact model.
    profile
        "quick" or "accurate": chooses the settings.
    settings
        Settings that differ from the profile's, `time_step=1e-4` for example.

    Raises
    ------
    EngineError
        If no engine, or more than one, has this name, or it has no such setting.
    MissingPackageError
        If the engine is not installed.
    """
    found = select([name], Profile(profile))
    if len(found) > 1:
        found = [one for one in found if one.abilities.main]
    if len(found) != 1:
        choice = ", ".join(label(one) for one in select([name], Profile(profile)))
        raise EngineError(f"found several variants of {name!r}, needed one of {choice}")
    chosen = found[0]
    for package in missing_packages(chosen):
        raise MissingPackageError(f"{label(chosen)}: {package} is not installed; to get it: {how_to_get(package)}")
    if not settings:
        return chosen
    if not isinstance(chosen, SteppedEngine):
        raise EngineError(f"{label(chosen)}: found settings, needed an engine that has some that can be changed")
    known = [field.name for field in dataclasses.fields(chosen.settings)]
    for setting in settings:
        if setting not in known:
            raise EngineError(f"{label(chosen)}: found no setting {setting!r}, needed one of {', '.join(known)}")
    return chosen.with_settings(**settings)


def expand_tolerances(scenario: Scenario, profile: Profile) -> Scenario:
    """Return ``scenario`` with every tolerance under the name of one variant.

    A scenario file names an engine as a command line does: "mujoco:capstan" for one variant, "mujoco" for its main variants.
    A limit under a variant's own name replaces one on the same metric under the engine's name.

    Raises
    ------
    ScenarioError
        If a tolerance names an engine that no installed package offers, or one without a main variant.
    """
    engines, faults = load_engines(profile)
    variants = {name: _variants(name, scenario.name, engines, faults) for name in {t.engine for t in scenario.tolerances}}
    explicit = {(t.engine, t.profile, t.metric) for t in scenario.tolerances}
    tolerances = [
        dataclasses.replace(tolerance, engine=variant)
        for tolerance in scenario.tolerances
        for variant in variants[tolerance.engine]
        if variant == tolerance.engine or (variant, tolerance.profile, tolerance.metric) not in explicit
    ]
    return dataclasses.replace(scenario, tolerances=tuple(tolerances))


def _variants(name: str, scenario: str, engines: Sequence[Engine], faults: dict[str, str]) -> list[str]:
    """Return the labels of the variants that ``name`` refers to."""
    if name in {label(engine) for engine in engines}:
        return [name]
    fault = faults.get(name.partition(":")[0])
    if fault is not None and name.partition(":")[0] not in ADAPTERS:
        raise ScenarioError(f"{scenario}: tolerances: {fault}")
    same_engine = [engine for engine in engines if engine.name == name]
    main = [label(engine) for engine in same_engine if engine.abilities.main]
    if main:
        return main
    if same_engine:
        choice = ", ".join(label(engine) for engine in same_engine)
        raise ScenarioError(f"{scenario}: tolerances: {name!r} has no main variant; write one of {choice}")
    raise ScenarioError(f"{scenario}: tolerances: {unknown_engine_message(name, engines)}")


def why_no_tolerances(scenario: Scenario, profile: str, asked: Collection[str] | None) -> str:
    """Return why ``scenario`` has no limit for ``profile`` on any of the variants ``asked`` (None: all); empty: it has some."""
    named = list(dict.fromkeys(t.engine for t in scenario.tolerances if t.profile == profile))
    if any(asked is None or name in asked for name in named):
        return ""
    others = sorted({t.profile for t in scenario.tolerances} - {profile})
    if named:
        return f"no tolerances for profile {profile} of the engines asked for: it has them for {', '.join(named)}"
    way = f"it has them for profile {others[0]}" if others else "add some under `tolerances:`"
    return f"no tolerances for profile {profile}: {way}"
