"""Versions of installed packages and of code: every result says what made it."""

from __future__ import annotations

import hashlib
import sys
from functools import cache
from importlib.metadata import PackageNotFoundError, packages_distributions, version
from pathlib import Path

MISSING = "none"
"""Stands for the version of a package that is not installed."""


@cache
def installed_version(package: str) -> str:
    """Return the version of a package, by the name that pip or that ``import`` knows; `MISSING` if it is not installed.

    It is read once per process: looking it up takes milliseconds, and every run of an engine asks.
    """
    try:
        return version(package)
    except PackageNotFoundError:
        return ", ".join(version(name) for name in packages_distributions().get(package, ())) or MISSING


@cache
def source_digest(module: str) -> str:
    """Return a digest of the Python files of a module: those in its folder, and in the folders below it if it is a package.

    studies.py, which only says what to vary, is left out; empty for a module that is not imported.
    """
    file = getattr(sys.modules.get(module), "__file__", None)
    if file is None:
        return ""
    path = Path(file)
    found = path.parent.rglob("*.py") if path.name == "__init__.py" else path.parent.glob("*.py")
    files = sorted(each for each in found if each.name != "studies.py")
    return hashlib.sha256(b"".join(each.read_bytes() for each in files)).hexdigest()
