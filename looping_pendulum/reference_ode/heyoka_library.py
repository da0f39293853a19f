"""Import heyoka quickly, and limit the disk space of its cache of compiled code."""

from __future__ import annotations

import os
import sys
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import cast

FOLDER_VARIABLE = "HEYOKA_CACHE_DIR"
"""Environment variable of heyoka. Whoever sets it has chosen a folder, and the limit that is stored there; both are kept."""
# heyoka's own folder grew by hundreds of megabytes with each run of the tests
DISK_LIMIT = 200 * 10**6
"""Largest size of the cache on disk [B]; heyoka's default is 21 GB."""


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


def cache_folder() -> Path:
    """Return the folder of the compiled code: below ``$XDG_CACHE_HOME``, or ``~/.cache`` where that is not set.

    Raises
    ------
    RuntimeError
        If this user has no home folder.
    """
    cache_home = os.environ.get("XDG_CACHE_HOME")
    return (Path(cache_home) if cache_home else Path.home() / ".cache") / "looping-pendulum" / "heyoka"
