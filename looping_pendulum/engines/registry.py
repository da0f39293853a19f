"""Which engines there are, which of them are installed here, and which a user means."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from importlib import import_module
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


def all_engines(profile: Profile) -> list[Engine]:
    """Every engine variant with its settings for ``profile``, installed or not."""
    return [engine for module in ADAPTERS.values() for engine in import_module(module).engines(profile)]


def missing_packages(engine: Engine) -> tuple[str, ...]:
    """Packages that ``engine`` needs and that are not installed here."""
    return tuple(package for package in engine.abilities.packages if find_spec(package) is None)


def challengers(profile: Profile) -> list[Engine]:
    """Every engine that is held against the reference."""
    return [engine for engine in all_engines(profile) if engine.name != "reference"]


def select(wanted: Iterable[str], profile: Profile) -> list[Engine]:
    """Engines named by ``wanted``: "pymunk" for all variants of one, "mujoco:capstan" for one variant.

    Raises
    ------
    EngineError
        If a name is not known; the message lists those that are.
    """
    engines = all_engines(profile)
    chosen: list[Engine] = []
    for name in wanted:
        found = [engine for engine in engines if name in (engine.name, label(engine))]
        if not found:
            known = [label(engine) for engine in engines]
            near = difflib.get_close_matches(name, [*ADAPTERS, *known], n=1)
            hint = f"; did you mean {near[0]!r}?" if near else ""
            raise EngineError(f"--engine: no engine is called {name!r}{hint} Known: {', '.join(known)}")
        chosen += [engine for engine in found if engine not in chosen]
    return chosen
