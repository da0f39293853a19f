"""Adapters that build the apparatus in physics engines; `protocol` defines their interface, `registry` lists them.

An engine is a folder here, with its adapter and its facts (`facts`), and an entry point in pyproject.toml. What stands in this
file is also what the command line needs before it imports any adapter, which takes NumPy.
"""

import json
from enum import StrEnum
from importlib.resources import files

FACTS_FILE = "engine.json"
"""File in an engine's folder with its facts (`facts.EngineFacts`)."""
MEMORY_LIMIT = 2 * 1024**3
"""Default limit on the memory of one run, with all processes that it starts [bytes].

Runs of the shipped adapters were measured to take 35 to 141 MiB.
"""


class Profile(StrEnum):
    """Set of numerical settings, by how much a run may cost."""

    QUICK = "quick"
    """Seconds per run: for everyday use and for the tests."""
    ACCURATE = "accurate"
    """Minutes per run: the most accurate settings that the adapter has."""


def own_labels() -> list[str]:
    """Return the labels of all variants of this package's engines, from their facts."""
    labels = []
    for folder in sorted(files("looping_pendulum").joinpath("engines").iterdir(), key=lambda folder: folder.name):
        facts = folder.joinpath(FACTS_FILE)
        if facts.is_file():
            variants = json.loads(facts.read_text(encoding="utf-8"))["variants"]
            labels += [f"{folder.name}:{variant}".removesuffix(":") for variant in variants]
    return labels
