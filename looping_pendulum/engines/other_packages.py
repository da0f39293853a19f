"""Adapters of other packages, which may do anything when they are imported: exit, hang, crash, print.

So a process of its own imports each and describes it in our own types, `StandIn`, which the process of a run turns into the
engine. A fault costs the adapter's own row, and never a command.
"""

from __future__ import annotations

import copy
import dataclasses
import io
import pickle
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from importlib.metadata import EntryPoint
from pathlib import Path
from types import SimpleNamespace
from typing import Any, TypeVar

from looping_pendulum.engines.facts import EngineFacts
from looping_pendulum.engines.protocol import Abilities, Engine, Profile, RecordSample
from looping_pendulum.engines.studies import Studies
from looping_pendulum.engines.worker import FAILURE, JOB, WORKER
from looping_pendulum.errors import EngineError
from looping_pendulum.files import write_atomically
from looping_pendulum.processes import Cause, run_python
from looping_pendulum.runs.trajectory import Trajectory, variant_label
from looping_pendulum.scenarios.scenario import Scenario
from looping_pendulum.versions import source_digest

ENGINE_MEMBERS = ("name", "variant", "profile", "abilities", "settings", "simulate", "with_settings", "studies")
"""Attributes and methods that an engine must have (`protocol.Engine`)."""
TIME_LIMIT = 30.0
"""Time that an adapter may take to be imported and described [s]; those of this package take half a second."""
MEMORY_LIMIT = 2**30
"""Memory that it may take [bytes]."""
DESCRIPTION = "description.pickle"
"""File to which that process writes the `Description`."""


T = TypeVar("T")


@dataclass(frozen=True, kw_only=True)
class Description:
    """What an adapter offers, in our own types."""

    engines: dict[Profile, list[StandIn]]
    facts: EngineFacts


class Settings(SimpleNamespace):
    """Settings of an engine of another package, whose own class this process does not import."""


class StandIn:
    """An engine of another package, which this process has not imported: it knows what the engine says of itself.

    Parameters
    ----------
    engine
        The engine, in the process that describes it.
    adapter
        Entry point's name and module.
    abilities, studies
        The engine's, checked.
    """

    def __init__(self, engine: Engine, adapter: tuple[str, str], abilities: Abilities, studies: Studies) -> None:
        self.name, self.variant, self.profile = adapter[0], str(engine.variant), Profile(engine.profile)
        self.abilities, self.adapter, self._studies = abilities, adapter, studies
        self.settings: Any = Settings(**_plain_fields(engine.settings))
        state = getattr(engine, "__dict__", {}).items()
        self.state = {name: _plain(value) for name, value in state if name not in ("abilities", "settings")}
        self.source = f"{type(engine).__module__}.{type(engine).__qualname__} {source_digest(type(engine).__module__)}"

    def with_settings(self, **changes: Any) -> StandIn:
        """Return the engine with some settings changed."""
        changed = copy.copy(self)
        changed.settings = Settings(**vars(self.settings) | changes)
        return changed

    def studies(self) -> Studies:
        """Return what can be varied of the engine."""
        return self._studies

    def simulate(self, scenario: Scenario, record: RecordSample | None = None) -> Trajectory:
        """Import the engine, and run ``scenario``."""
        return self._engine().simulate(scenario, record)

    def _engine(self) -> Engine:
        """Return the engine, which this process imports now."""
        name, module = self.adapter
        engines = load(EntryPoint(name, module, ""), self.profile)
        (found,) = (engine for engine in engines if engine.variant == self.variant)
        # What was not changed keeps its type, which is not known here
        own = _plain_fields(found.settings)
        changes = {name: value for name, value in vars(self.settings).items() if name not in own or value != own[name]}
        return found.with_settings(**changes) if changes else found


def _plain_fields(settings: Any) -> dict[str, Any]:
    """Return the settings of an engine as numbers, texts and tuples of such."""
    return {field.name: _plain(getattr(settings, field.name)) for field in dataclasses.fields(settings)}


def _plain(value: Any) -> Any:
    """Return a setting's value as a number, a text or a tuple of such."""
    if isinstance(value, (list, tuple)):
        return tuple(_plain(each) for each in value)
    if hasattr(value, "item"):  # NumPy's own numbers
        value = value.item()
    for kind in (bool, int, float, str):  # of which an enum may be a subclass
        if isinstance(value, kind):
            return kind(value)
    return None if value is None else str(value)


# ---- importing an adapter, in a process that may end by it


def load(adapter: EntryPoint, profile: Profile) -> list[Engine]:
    """Import an adapter in this process and return its engines, after checking what the other engines' results depend on.

    Raises
    ------
    EngineError
        If an engine is not as `protocol.Engine` states.
    """
    offered = adapter.load().engines(profile)
    if not isinstance(offered, Sequence):
        raise EngineError(f"engines() gave {type(offered).__name__}, needed a list of engines")
    if not offered:
        raise EngineError("engines() gave no engine")
    for engine in offered:
        if not isinstance(engine, Engine):
            lacking = [name for name in ENGINE_MEMBERS if not hasattr(engine, name)]
            raise EngineError(f"engines() gave {type(engine).__name__} without {', '.join(lacking)}; see engines/protocol.py")
        if engine.name != adapter.name:
            raise EngineError(f"engines() gave one called {engine.name!r}; needed the entry point's name, {adapter.name!r}")
        label = variant_label(engine.name, engine.variant)
        if engine.profile not in list(Profile):
            raise EngineError(f"{label}: its profile is {engine.profile!r}, needed one of {', '.join(Profile)}")
        if not dataclasses.is_dataclass(engine.settings):
            raise EngineError(f"{label}: settings are {type(engine.settings).__name__}, needed a frozen dataclass")
        if not isinstance(engine.abilities, Abilities):
            raise EngineError(f"{label}: abilities are {type(engine.abilities).__name__}, needed Abilities")
    labels = [variant_label(engine.name, engine.variant) for engine in offered]
    if len(set(labels)) < len(labels):
        raise EngineError(f"engines() gave two of one name among {', '.join(labels)}")
    return list(offered)


def describe(name: str, module: str, folder: Path) -> None:
    """Import the adapter of an entry point in this process, and write what it offers to ``folder``."""
    adapter = EntryPoint(name, module, "")
    engines = {profile: load(adapter, profile) for profile in Profile}
    facts = _checked(EngineFacts, getattr(adapter.load(), "FACTS", EngineFacts()), "FACTS")
    described = Description(
        engines={profile: [_stand_in(engine, adapter, facts) for engine in offered] for profile, offered in engines.items()},
        facts=facts,
    )
    write_atomically(folder / DESCRIPTION, pickle.dumps(described))


def _stand_in(engine: Engine, adapter: EntryPoint, facts: EngineFacts) -> StandIn:
    """Return the stand-in of ``engine``, with what the facts say was measured of it."""
    measured = facts.variant(engine.variant)
    abilities = _checked(Abilities, engine.abilities, "abilities")
    abilities = dataclasses.replace(
        abilities,
        validated=abilities.validated or measured.measured,
        additions=(*map(str, measured.additions), *abilities.additions),
        known_failures=measured.failed_checks | dict(abilities.known_failures),
    )
    studies = _checked(Studies, engine.studies(), "studies")
    return StandIn(engine, (adapter.name, adapter.value), abilities, studies)


def _checked(kind: type[T], value: object, what: str) -> T:
    """Return a dataclass of ours that foreign code has filled, as one whose fields have the types that it states."""
    from pydantic import TypeAdapter, ValidationError

    if not isinstance(value, kind):
        raise EngineError(f"{what} are {type(value).__name__}, needed {kind.__name__}")
    try:
        return TypeAdapter(kind).validate_python(dataclasses.asdict(value))  # type: ignore[call-overload]
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join([what, *map(str, first["loc"])])
        raise EngineError(f"{where}: found {first['input']!r:.60}, needed {first['msg']}") from None


# ---- what this process learns of an adapter


class _OwnTypes(pickle.Unpickler):
    """Reads a description, and imports nothing else than this package for it."""

    def find_class(self, module: str, name: str) -> Any:
        """Return a class of this package, or a built-in one."""
        if module.partition(".")[0] in ("looping_pendulum", "builtins"):
            return super().find_class(module, name)
        raise pickle.UnpicklingError(f"it holds {module}.{name}, needed plain data")


DESCRIBED: dict[EntryPoint, Description | str] = {}
"""What this process has learnt of adapters so far."""


def description(adapter: EntryPoint) -> Description | str:
    """Return what an adapter offers, or a sentence that says why it cannot be used; found out once."""
    if adapter not in DESCRIBED:
        DESCRIBED[adapter] = _described_elsewhere(adapter)
    return DESCRIBED[adapter]


def _described_elsewhere(adapter: EntryPoint) -> Description | str:
    """Return the description of an adapter that another process has imported, or why it has none."""
    try:
        with tempfile.TemporaryDirectory(prefix="looping-pendulum-", ignore_cleanup_errors=True) as path:
            folder = Path(path)
            job = partial(describe, adapter.name, adapter.value), TIME_LIMIT
            (folder / JOB).write_bytes(pickle.dumps(job))
            ending = run_python(WORKER, folder, time_limit=TIME_LIMIT, memory_limit=MEMORY_LIMIT)
            if (folder / FAILURE).exists():
                return (folder / FAILURE).read_text(encoding="utf-8", errors="replace")
            if not (folder / DESCRIPTION).exists():
                limits = {Cause.TIME: f" of {TIME_LIMIT:g} s", Cause.MEMORY: f" of {MEMORY_LIMIT / 2**20:g} MiB"}
                return f"its import ended: {ending}{limits.get(ending.cause, '')}"
            described = _OwnTypes(io.BytesIO((folder / DESCRIPTION).read_bytes())).load()
    # What foreign code has written may be anything
    except Exception as error:
        return f"its description cannot be read: {type(error).__name__}: {error}"
    return described if isinstance(described, Description) else f"it described itself as {described!r:.60}"
