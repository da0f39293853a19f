"""Which engines there are, which of them are installed here, and which a user means."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from functools import cache
from importlib import import_module
from importlib.metadata import entry_points
from importlib.util import find_spec

from looping_pendulum.engines.protocol import Engine, Profile
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

EVERYTHING = "all"
"""What a user writes for every variant, those that are only for studies too."""

HOW_TO_GET = {
    "heyoka": "pip install heyoka (wheels for Linux x86-64, Python 3.11 to 3.13); SciPy stands in for it everywhere else",
    "mujoco": "pip install mujoco",
    "pymunk": "pip install pymunk",
    "pybullet": "use Python 3.11, where `pip install pybullet` finds a wheel; above it pip compiles for many minutes",
    "scipy": "pip install scipy",
}


def label(engine: Engine) -> str:
    """Engine and variant, "pymunk:chain"."""
    return f"{engine.name}:{engine.variant}"


@cache
def adapters() -> dict[str, str]:
    """Engine name -> module of its adapter, those of other packages included; these cannot take the place of our own."""
    offered = {point.name: point.value for point in entry_points(group=ENTRY_POINTS)}
    return ADAPTERS | {name: module for name, module in sorted(offered.items()) if name not in ADAPTERS}


def all_engines(profile: Profile) -> list[Engine]:
    """Every engine variant with its settings for ``profile``, installed or not.

    Raises
    ------
    EngineError
        If another package's adapter cannot be loaded.
    """
    return [engine for name, module in adapters().items() for engine in _load(name, module, profile)]


def _load(name: str, module: str, profile: Profile) -> list[Engine]:
    if name in ADAPTERS:
        return list(import_module(module).engines(profile))
    try:
        return list(import_module(module).engines(profile))
    except Exception as error:
        raise EngineError(
            f"adapter '{name}' ({module}), offered by another package, cannot be loaded: {type(error).__name__}: {error}; "
            "mend or uninstall that package"
        ) from error


def missing_packages(engine: Engine) -> tuple[str, ...]:
    """Packages that ``engine`` needs and that are not installed here."""
    return tuple(package for package in engine.abilities.packages if find_spec(package) is None)


def challengers(profile: Profile) -> list[Engine]:
    """Engines that are held against the reference where none is named: the main variants."""
    return [engine for engine in all_engines(profile) if engine.name != "reference" and engine.abilities.main]


def select(wanted: Iterable[str], profile: Profile) -> list[Engine]:
    """Engines named by ``wanted``: "pymunk" for all variants of one, "mujoco:capstan" for one variant, "all" for all.

    Raises
    ------
    EngineError
        If a name is not known; the message lists those that are.
    """
    engines = all_engines(profile)
    chosen: list[Engine] = []
    for name in wanted:
        found = [engine for engine in engines if name in (engine.name, label(engine))]
        if name == EVERYTHING:
            found = [engine for engine in engines if engine.name != "reference"]
        if not found:
            known = [label(engine) for engine in engines]
            near = difflib.get_close_matches(name, [*adapters(), *known], n=1)
            hint = f"; did you mean {near[0]!r}?" if near else ""
            raise EngineError(f"--engine: no engine is called {name!r}{hint} Known: {', '.join(known)}")
        chosen += [engine for engine in found if engine not in chosen]
    return chosen
