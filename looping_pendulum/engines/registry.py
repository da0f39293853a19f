"""Which engines there are, which of them are installed here, and which a user means."""

from __future__ import annotations

import dataclasses
import difflib
import warnings
from collections.abc import Collection, Iterable
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from importlib.metadata import entry_points
from importlib.util import find_spec

from looping_pendulum.engines.protocol import Abilities, Engine, Profile
from looping_pendulum.errors import EngineError

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
"""What an engine must have (`protocol.Engine`)."""

EVERYTHING = "all"
"""What a user writes for every variant, those that are only for studies too."""

HOW_TO_GET = {
    "pydrake": 'pip install "looping-pendulum[drake]", which is pip install "drake>=1.51"',
    "heyoka": "pip install heyoka (wheels for Linux x86-64, Python 3.11 to 3.13); SciPy stands in for it everywhere else",
    "mujoco": "pip install mujoco",
    "pymunk": "pip install pymunk",
    "pybullet": "use Python 3.11, where `pip install pybullet` finds a wheel; above it pip compiles for many minutes",
    "scipy": "pip install scipy",
}


@dataclass(frozen=True, kw_only=True)
class AdapterModule:
    """An adapter: a module with ``engines(profile) -> list[Engine]``."""

    name: str
    """What its engines are called."""
    module: str
    package: str = ""
    """Distribution that offers it; empty for our own."""


class AdapterWarning(UserWarning):
    """Another package's adapter is left out; the message says why and what to do."""


def label(engine: Engine) -> str:
    """Engine and variant, "pymunk:chain"."""
    return f"{engine.name}:{engine.variant}"


def how_to_get(package: str) -> str:
    """How to install a package that an engine needs."""
    return HOW_TO_GET.get(package, f"pip install {package}")


@cache
def offers() -> tuple[AdapterModule, ...]:
    """Our own adapters, and those of other packages by name."""
    points = entry_points(group=ENTRY_POINTS)
    others = {(point.name, point.value, point.dist.name if point.dist else "") for point in points}
    own = (AdapterModule(name=name, module=module) for name, module in ADAPTERS.items())
    return (*own, *(AdapterModule(name=name, module=module, package=package) for name, module, package in sorted(others)))


def all_engines(profile: Profile) -> list[Engine]:
    """Every engine variant with its settings for ``profile``, installed or not.

    Another package's adapter that cannot be used is left out with an `AdapterWarning`: it must not cost the others' results.
    """
    engines, faults = loaded(profile)
    _warn_of(faults)
    return engines


def _warn_of(faults: dict[str, str]) -> None:
    for fault in faults.values():
        warnings.warn(fault, AdapterWarning, stacklevel=3)


def suppliers() -> dict[str, str]:
    """Engine name -> distribution that offers its adapter, for those of other packages."""
    return {offer.name: offer.package for offer in offers() if offer.name not in ADAPTERS}


def loaded(profile: Profile) -> tuple[list[Engine], dict[str, str]]:
    """Return all engines, and per adapter of another package that cannot be used one line that says why."""
    engines: list[Engine] = []
    faults: dict[str, str] = {}
    for offer in offers():
        if not offer.package and offer.name in ADAPTERS:
            engines += import_module(offer.module).engines(profile)
            continue
        taken = {engine.name for engine in engines} | ADAPTERS.keys()
        try:
            engines += _from_elsewhere(offer, profile, taken)
        except (Exception, SystemExit) as error:
            why = str(error) if isinstance(error, EngineError) else f"{type(error).__name__}: {error}"
            faults[offer.name] = (
                f"engine {offer.name!r} is left out: adapter {offer.module} of the package {offer.package or '?'}: "
                f"{' '.join(why.split())}; mend or uninstall that package"
            )
    return engines, faults


def _from_elsewhere(offer: AdapterModule, profile: Profile, taken: Collection[str]) -> list[Engine]:
    """Engines of another package's adapter, checked for what the others' results depend on."""
    if offer.name in taken:
        raise EngineError(f"the name {offer.name!r} is taken; needed another entry point name")
    found = list(import_module(offer.module).engines(profile))
    for engine in found:
        if not isinstance(engine, Engine):
            lacking = [name for name in ENGINE_MEMBERS if not hasattr(engine, name)]
            raise EngineError(f"engines() gave {type(engine).__name__} without {', '.join(lacking)}; see engines/protocol.py")
        if engine.name != offer.name:
            raise EngineError(f"engines() gave one called {engine.name!r}; needed the entry point's name, {offer.name!r}")
        if not dataclasses.is_dataclass(engine.settings):
            raise EngineError(f"{label(engine)}: settings are {type(engine.settings).__name__}, needed a frozen dataclass")
        if not isinstance(engine.abilities, Abilities):
            raise EngineError(f"{label(engine)}: abilities are {type(engine.abilities).__name__}, needed Abilities")
    labels = [label(engine) for engine in found]
    if len(set(labels)) < len(labels):
        raise EngineError(f"engines() gave two of one name among {', '.join(labels)}")
    return found


def unknown(name: str, engines: Iterable[Engine]) -> str:
    """Say that none of ``engines`` is called ``name``, with the nearest name and all of them."""
    engines = tuple(engines)
    known = [label(engine) for engine in engines]
    near = difflib.get_close_matches(name, [*{engine.name for engine in engines}, *known], n=1)
    hint = f"; did you mean {near[0]!r}?" if near else "."
    return f"no engine is called {name!r}{hint} Known: {', '.join(known)}"


def missing_packages(engine: Engine) -> tuple[str, ...]:
    """Packages that ``engine`` needs and that are not installed here."""
    return tuple(package for package in engine.abilities.packages if not _importable(package))


def _importable(package: str) -> bool:
    try:
        return find_spec(package) is not None
    except (ImportError, ValueError):  # of "a.b" without "a"; of a module that is half imported
        return False


def challengers(profile: Profile) -> list[Engine]:
    """Engines that are held against the reference where none is named: the main variants."""
    return [engine for engine in all_engines(profile) if engine.name != "reference" and engine.abilities.main]


def select(wanted: Iterable[str], profile: Profile) -> list[Engine]:
    """Engines named by ``wanted``: "pymunk" for all variants of one, "mujoco:capstan" for one variant, "all" for all.

    Raises
    ------
    EngineError
        If a name is not known (the message lists those that are), or that of an adapter which cannot be used.
    """
    wanted = tuple(wanted)
    engines, faults = loaded(profile)
    if EVERYTHING in wanted:
        _warn_of(faults)
    chosen: list[Engine] = []
    for name in wanted:
        if name.partition(":")[0] in faults.keys() - ADAPTERS.keys():
            raise EngineError(f"--engine: {faults[name.partition(':')[0]]}")
        found = [engine for engine in engines if name in (engine.name, label(engine))]
        if name == EVERYTHING:
            found = [engine for engine in engines if engine.name != "reference"]
        if not found:
            raise EngineError(f"--engine: {unknown(name, engines)}")
        chosen += [engine for engine in found if engine not in chosen]
    return chosen
