"""List all engines, find out which of them are installed, and select those that a user names."""

from __future__ import annotations

import dataclasses
import difflib
import warnings
from collections.abc import Collection, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from importlib.util import find_spec
from typing import Any

from looping_pendulum.engines.facts import EngineFacts, Package, own_facts
from looping_pendulum.engines.other_packages import DESCRIBED, Description, description, load
from looping_pendulum.engines.protocol import Engine, Profile
from looping_pendulum.errors import EngineError, MissingPackageError, ScenarioError
from looping_pendulum.installation import install_command
from looping_pendulum.pages import palette
from looping_pendulum.processes import core_count
from looping_pendulum.runs.trajectory import variant_label
from looping_pendulum.scenarios.scenario import Scenario

ENTRY_POINTS = "looping_pendulum.engines"
"""Group of entry points by which packages, this one included, offer adapters: name -> module with ``engines(profile)``."""
REFERENCE = EntryPoint("reference", "looping_pendulum.engines.reference", ENTRY_POINTS)
"""The only adapter that is no entry point: without it nothing can be compared."""

ALL_VARIANTS = "all"
"""Name by which a user selects every variant, including those that are only for studies."""


class AdapterWarning(UserWarning):
    """Another package's adapter cannot be used and is skipped; the message says why and what to do."""


def label(engine: Engine) -> str:
    """Return engine and variant as one name, as `variant_label` does."""
    return variant_label(engine.name, engine.variant)


def how_to_get(package: str, *, anywhere: bool = False) -> str:
    """Return the command that installs a package, as Python imports it, and on which systems that works.

    ``anywhere``: for text that is read on other machines (see `install_command`).
    """
    known = {name: each for facts in _known_facts().values() for name, each in facts.packages.items()}
    asked = known.get(package, Package(pip=package))
    where = f" ({asked.systems})" if asked.systems else ""
    return f"`{install_command(asked.pip, anywhere=anywhere)}`{where}"


# ---- adapters


@cache
def adapter_modules() -> tuple[EntryPoint, ...]:
    """Return the reference's adapter, those of this package, then those of other packages, each in the order of their names."""
    offered = sorted(set(entry_points(group=ENTRY_POINTS)), key=lambda point: (not is_own(point), point.name, point.value))
    return (REFERENCE, *offered)


def is_own(adapter: EntryPoint) -> bool:
    """Return whether an adapter is an engine's folder of this package; then every process that asks for it imports it."""
    return adapter.value == f"{__package__}.{adapter.name}"


def own_engines() -> set[str]:
    """Return the names of this package's engines."""
    return {adapter.name for adapter in adapter_modules() if is_own(adapter)}


def adapter_packages() -> dict[str, str]:
    """Map the name of each engine of another package to the distribution that offers its adapter."""
    return {adapter.name: _package(adapter) for adapter in adapter_modules() if not is_own(adapter)}


def _package(adapter: EntryPoint) -> str:
    """Return the distribution that offers an adapter; empty if it is not known."""
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


def load_engines(profile: Profile, names: Collection[str] | None = None) -> tuple[list[Engine], dict[str, str]]:
    """Return all engines, and for each adapter of another package that cannot be used one line that says why.

    ``names``: load these engines only, so that others' adapters are not even looked at.
    """
    engines: list[Engine] = []
    found: dict[EntryPoint, Description | str] = {}
    others: dict[str, EntryPoint] = {}
    for adapter in adapter_modules():
        if names is not None and adapter.name not in names:
            continue
        if is_own(adapter):
            # Not guarded: a fault in an adapter of this package is a bug, and must show
            engines += adapter.load().engines(profile)
        elif adapter.name in own_engines() | others.keys():
            found[adapter] = f"the name {adapter.name!r} is taken; needed another entry point name"
        else:
            others[adapter.name] = adapter
    # At the same time, as one that hangs is waited for
    with ThreadPoolExecutor(core_count()) as pool:
        found |= zip(others.values(), pool.map(description, others.values()), strict=True)
    faults: dict[str, str] = {}
    for adapter, described in found.items():
        if isinstance(described, Description):
            engines += described.engines[profile]
        else:
            faults[adapter.name] = (
                f"engine {adapter.name!r} is left out: adapter {adapter.value} of the package {_package(adapter) or '?'}: "
                f"{' '.join(described.split())}; fix or uninstall that package"
            )
    return engines, faults


# ---- facts


def engine_facts(name: str) -> EngineFacts:
    """Return the facts of an engine; empty ones where nobody states any."""
    return _known_facts(name).get(name, EngineFacts())


def _known_facts(*further: str) -> dict[str, EngineFacts]:
    """Map engine -> facts: for those of this package, then for those of other packages, where they have been described.

    ``further``: names of engines whose adapters are described for it.
    """
    facts = {adapter.name: own_facts(adapter.name) for adapter in adapter_modules() if is_own(adapter)}
    for adapter in adapter_modules():
        if adapter.name not in facts and (adapter.name in further or adapter in DESCRIBED):
            found = description(adapter)
            facts[adapter.name] = found.facts if isinstance(found, Description) else EngineFacts()
    return facts


def styles(labels: Iterable[str]) -> dict[str, palette.Style]:
    """Return the style of each label, from the facts of the engines; see `palette.styles`."""
    labels = tuple(labels)
    facts = _known_facts(*(label.partition(":")[0] for label in labels))
    stated = {
        variant_label(engine, variant): (each.colour, each.symbol)
        for engine, known in facts.items()
        for variant, each in known.variants.items()
    }
    return palette.styles(labels, stated)


# ---- engines by their names


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
        # Of "a.b" only "a": to find the rest would import "a" in this process
        return find_spec(package.partition(".")[0]) is not None
    except ValueError:  # for a module that is only partly imported
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
    asked = {name.partition(":")[0] for name in names}
    engines, faults = load_engines(profile, None if ALL_VARIANTS in names else asked)
    if ALL_VARIANTS in names:
        _warn(faults)
    chosen: list[Engine] = []
    for name in names:
        # Another package's faulty adapter under one of our names does not make our engine unusable
        if name.partition(":")[0] in faults.keys() - own_engines():
            raise EngineError(f"--engine: {faults[name.partition(':')[0]]}")
        matches = [engine for engine in engines if name in (engine.name, label(engine))]
        if name == ALL_VARIANTS:
            matches = [engine for engine in engines if engine.name != "reference"]
        if not matches:
            raise EngineError(f"--engine: {unknown_engine_message(name, load_engines(profile)[0])}")
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
    (adapter,) = (adapter for adapter in adapter_modules() if adapter.name == found[0].name)
    if not is_own(adapter):
        # Asked for in this process, it may be imported here
        wanted = {label(one) for one in found}
        found = [one for one in load(adapter, Profile(profile)) if label(one) in wanted]
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
    named = {t.engine for t in scenario.tolerances}
    engines, faults = load_engines(profile, {name.partition(":")[0] for name in named})
    variants = {name: _variants(name, scenario.name, engines, faults, profile) for name in named}
    explicit = {(t.engine, t.profile, t.metric) for t in scenario.tolerances}
    tolerances = [
        dataclasses.replace(tolerance, engine=variant)
        for tolerance in scenario.tolerances
        for variant in variants[tolerance.engine]
        if variant == tolerance.engine or (variant, tolerance.profile, tolerance.metric) not in explicit
    ]
    return dataclasses.replace(scenario, tolerances=tuple(tolerances))


def _variants(name: str, scenario: str, engines: Sequence[Engine], faults: dict[str, str], profile: Profile) -> list[str]:
    """Return the labels of the variants that ``name`` refers to."""
    if name in {label(engine) for engine in engines}:
        return [name]
    fault = faults.get(name.partition(":")[0])
    if fault is not None and name.partition(":")[0] not in own_engines():
        raise ScenarioError(f"{scenario}: tolerances: {fault}")
    same_engine = [engine for engine in engines if engine.name == name]
    main = [label(engine) for engine in same_engine if engine.abilities.main]
    if main:
        return main
    if same_engine:
        choice = ", ".join(label(engine) for engine in same_engine)
        raise ScenarioError(f"{scenario}: tolerances: {name!r} has no main variant; write one of {choice}")
    raise ScenarioError(f"{scenario}: tolerances: {unknown_engine_message(name, load_engines(profile)[0])}")


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
