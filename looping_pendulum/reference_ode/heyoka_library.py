"""Import heyoka quickly, with a bound on what it keeps of its compiled code."""

from __future__ import annotations

import os
import sys
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import cast

FOLDER_VARIABLE = "HEYOKA_CACHE_DIR"
"""heyoka's own: who sets it has chosen a folder, and with it the limit that is written there."""
DISK_LIMIT = 200 * 10**6
"""Most that compiled code may take on disk [B]; heyoka's own limit is 21 GB."""


@cache
def load_heyoka() -> ModuleType:
    """Return heyoka; code that it compiles is kept on disk in a folder of ours, the least recently used of it given up first.

    Several processes may share the folder. Where it cannot be written, each process compiles for itself.
    """
    heyoka = _import_without_sympy()
    heyoka.set_logger_level_critical()  # what it would warn of comes back as an outcome
    code = heyoka.llvm_state
    if FOLDER_VARIABLE not in os.environ:
        try:
            code.set_diskcache_path(cache_folder())
            if code.get_diskcache_limit() != DISK_LIMIT:
                code.set_diskcache_limit(DISK_LIMIT)
        except RuntimeError:  # no home, no room, no permission, or a damaged file
            code.set_diskcache_enabled(False)
    return heyoka


def _import_without_sympy() -> ModuleType:
    """Import heyoka without SymPy, whose import takes nine times as long and serves conversions that are not used here."""
    needless = "sympy" not in sys.modules
    if needless:
        sys.modules["sympy"] = None  # type: ignore[assignment]  # what Python's import system takes for "not to be had"
    try:
        import heyoka
    finally:
        if needless:
            del sys.modules["sympy"]
    return cast("ModuleType", heyoka)


def cache_folder() -> Path:
    """Folder of the compiled code: below ``$XDG_CACHE_HOME``, or ``~/.cache`` where that is not set.

    Raises
    ------
    RuntimeError
        If this user has no home folder.
    """
    above = os.environ.get("XDG_CACHE_HOME")
    return (Path(above) if above else Path.home() / ".cache") / "looping-pendulum" / "heyoka"
