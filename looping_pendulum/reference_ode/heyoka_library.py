"""Import heyoka quickly, and keep on disk what it compiles, within a limit.

heyoka's own cache saves the optimisation of code; what is pickled here also saves making its expressions, which takes longer:
a mode's integrator is read in 5 ms, a mode's step of a batch in 30 to 60 ms, a quarter of the time with heyoka's cache alone.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import pickle
import platform
import sys
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any, TypeVar, cast

from looping_pendulum.reference_ode.effects import LIBRARY, Effect

T = TypeVar("T")

FOLDER_VARIABLE = "HEYOKA_CACHE_DIR"
"""Environment variable of heyoka. Whoever sets it has chosen a folder, and the limit that is stored there; both are kept."""
# heyoka's own folder grew by hundreds of megabytes with each run of the tests
DISK_LIMIT, PICKLED_LIMIT = 100 * 10**6, 400 * 10**6
"""Largest size of heyoka's cache on disk, and of what is pickled beside it [B]; heyoka's default is 21 GB.

A function of a batch takes up to 7 MB, and one search for missing effects used over fifty. Where they did not fit, half of its
time went into compiling again.
"""
COMPILER_OPTIONS: dict[str, Any] = {}
"""Options of all calls of heyoka's compilers; tests leave code unoptimised by them."""


@cache
def load_heyoka() -> ModuleType:
    """Return heyoka, which caches compiled code on disk in this package's own folder, up to `DISK_LIMIT`.

    The least recently used code is deleted first. Several processes may share the folder. Where it cannot be written, each
    process compiles for itself.
    """
    heyoka = _import_without_sympy()
    heyoka.set_logger_level_critical()  # what it would warn of is returned as an outcome, too
    llvm_state = heyoka.llvm_state
    if FOLDER_VARIABLE not in os.environ:
        try:
            llvm_state.set_diskcache_path(cache_folder())
            if llvm_state.get_diskcache_limit() != DISK_LIMIT:
                llvm_state.set_diskcache_limit(DISK_LIMIT)
        except RuntimeError:  # no home, no room, no permission, or a damaged file
            llvm_state.set_diskcache_enabled(False)
    return heyoka


def _import_without_sympy() -> ModuleType:
    """Import heyoka without SymPy, whose import takes nine times as long and serves conversions that are not used here."""
    blocked = "sympy" not in sys.modules
    if blocked:
        sys.modules["sympy"] = None  # type: ignore[assignment]  # makes Python's import of it fail
    try:
        import heyoka
    finally:
        if blocked:
            del sys.modules["sympy"]
    return cast("ModuleType", heyoka)


def compiled(what: tuple[object, ...], effects: tuple[Effect, ...], make: Callable[[], T]) -> T:
    """Return what ``make`` makes with heyoka's compilers, from disk if it was made before.

    It is made anew after any change of this package's equations, heyoka's version or the processor. Effects from elsewhere
    are always made anew: what they are, their names do not say.

    Parameters
    ----------
    what
        What is made, beside the effects: values whose representation is the same in every process.
    """
    if not all(effect in LIBRARY for effect in effects):
        return make()
    name = repr((_origin(), what, [effect.name for effect in effects], sorted(COMPILER_OPTIONS.items())))
    try:
        path = cache_folder() / f"{hashlib.sha256(name.encode()).hexdigest()[:32]}.pickle"
    except RuntimeError:  # no home
        return make()
    with contextlib.suppress(Exception):
        return cast("T", _kept(path))
    with _alone(path):
        with contextlib.suppress(Exception):  # another process has made it meanwhile
            return cast("T", _kept(path))
        made = make()
        with contextlib.suppress(OSError):
            _keep(path, pickle.dumps(made, protocol=pickle.HIGHEST_PROTOCOL))
    return made


def _kept(path: Path) -> Any:
    """Return what is kept; damaged bytes raise whatever they lead to, missing ones an `OSError`."""
    found = pickle.loads(path.read_bytes())
    with contextlib.suppress(OSError):
        os.utime(path)  # it was used now
    return found


@contextlib.contextmanager
def _alone(path: Path) -> Iterator[None]:
    """Wait until no other process makes what is kept at ``path``: to compile twice at once takes longer than to wait."""
    import fcntl  # heyoka runs on Linux

    lock = path.with_suffix(".lock")
    with contextlib.ExitStack() as stack:
        with contextlib.suppress(OSError):  # where nothing can be written, each process makes its own
            lock.parent.mkdir(parents=True, exist_ok=True)
            fcntl.flock(stack.enter_context(lock.open("w")), fcntl.LOCK_EX)
        yield
        with contextlib.suppress(OSError):
            lock.unlink(missing_ok=True)


@cache
def _origin() -> str:
    """Return what compiled code depends on beside what it computes: equations, heyoka, and the processor."""
    equations = hashlib.sha256(b"".join(file.read_bytes() for file in sorted(Path(__file__).parent.rglob("*.py"))))
    processor: set[str] = set()
    with contextlib.suppress(OSError):
        lines = Path("/proc/cpuinfo").read_text().splitlines()  # heyoka runs on Linux
        processor = {line for line in lines if line.startswith(("model name", "flags"))}
    return repr((load_heyoka().__version__, sys.version, platform.machine(), sorted(processor), equations.hexdigest()))


def _keep(path: Path, content: bytes) -> None:
    """Write a file as a whole, and delete the least recently used ones above the limit."""
    unfinished = path.with_suffix(f".{os.getpid()}")
    try:
        unfinished.write_bytes(content)
        unfinished.replace(path)
    finally:
        unfinished.unlink(missing_ok=True)
    total = 0
    for kept in sorted(path.parent.glob("*.pickle"), key=lambda kept: -kept.stat().st_mtime):
        total += kept.stat().st_size
        if total > PICKLED_LIMIT:
            kept.unlink(missing_ok=True)


def cache_folder() -> Path:
    """Return the folder of the compiled code: that of heyoka's variable, or one below ``$XDG_CACHE_HOME`` or ``~/.cache``.

    Raises
    ------
    RuntimeError
        If this user has no home folder.
    """
    if FOLDER_VARIABLE in os.environ:
        return Path(os.environ[FOLDER_VARIABLE])
    cache_home = os.environ.get("XDG_CACHE_HOME")
    return (Path(cache_home) if cache_home else Path.home() / ".cache") / "looping-pendulum" / "heyoka"
