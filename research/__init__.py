"""What was measured for the pages: scripts that are run by hand, and what they found, in `data` (see README.md)."""

from pathlib import Path
from typing import Any

FOLDER = Path(__file__).parent
DATA = FOLDER / "data"
DOCS = Path(__file__).parents[1] / "docs"
IMAGES = DOCS / "img"


def rounded(tree: Any, digits: int = 4) -> Any:
    """Return ``tree`` with floats rounded to so many significant digits, by default more than errors are known to."""
    if isinstance(tree, dict):
        return {key: rounded(value, digits) for key, value in tree.items()}
    if isinstance(tree, list | tuple):
        return [rounded(value, digits) for value in tree]
    return float(f"{tree:.{digits}g}") if isinstance(tree, float) else tree
