"""Measurements behind the pages and the package's data, and timings; `python -m benchmarks --help`."""

from typing import Any


def rounded(tree: Any, digits: int = 4) -> Any:
    """Return ``tree`` with floats rounded to so many significant digits, by default more than errors are known to."""
    if isinstance(tree, dict):
        return {key: rounded(value, digits) for key, value in tree.items()}
    if isinstance(tree, list | tuple):
        return [rounded(value, digits) for value in tree]
    return float(f"{tree:.{digits}g}") if isinstance(tree, float) else tree
