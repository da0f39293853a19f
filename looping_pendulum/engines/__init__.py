"""Adapters that build the apparatus in physics engines; `protocol` defines their interface, `registry` lists them.

What stands here is also what the command line needs before it imports any of them, which takes NumPy.
"""

from enum import StrEnum


class Profile(StrEnum):
    """Set of numerical settings, by how much a run may cost."""

    QUICK = "quick"
    """Seconds per run: for everyday use and for the tests."""
    ACCURATE = "accurate"
    """Minutes per run: the most accurate settings that the adapter has."""
