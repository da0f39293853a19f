"""Versions of installed packages: every result says what made it."""

from __future__ import annotations

from functools import cache
from importlib.metadata import PackageNotFoundError, packages_distributions, version

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
