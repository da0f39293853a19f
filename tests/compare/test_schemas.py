"""Keys of the files of results: one that changes or goes raises the version of its file, by which a reader refuses it."""

import dataclasses
import typing

import pytest

from looping_pendulum.compare.baseline import ResultChanges
from looping_pendulum.compare.convergence.result import ConvergenceResult
from looping_pendulum.compare.result import ComparisonResult
from looping_pendulum.discrepancy import result as identification
from tests.compare.golden import golden

FILES = {
    "result.json": (ComparisonResult, ComparisonResult.SCHEMA_VERSION),
    "changes.json": (ResultChanges, ResultChanges.SCHEMA_VERSION),
    "convergence.json": (ConvergenceResult, ConvergenceResult.SCHEMA_VERSION),
    "verdict.json": (identification.Identification, identification.SCHEMA_VERSION),
}


def keys_of(cls, found):
    """Add class -> its fields in a file, for ``cls`` and for all classes in its fields."""
    if dataclasses.is_dataclass(cls) and cls.__name__ not in found:
        # The class of what is not in the file is imported for type checkers alone
        hints = typing.get_type_hints(cls, localns={"DeclarationCheck": object})
        stored = [f.name for f in dataclasses.fields(cls) if f.compare]
        found[cls.__name__] = stored
        for name in stored:
            keys_of(hints[name], found)
    for part in typing.get_args(cls):
        keys_of(part, found)
    return found


@pytest.mark.parametrize("file", FILES)
def test_golden_keys_are_those_of_the_version(file):
    cls, version = FILES[file]
    keys = keys_of(cls, {})
    assert len(keys) > 1
    lines = [f"{file}, version {version}", *(f"{name}: {', '.join(fields)}" for name, fields in sorted(keys.items()))]
    golden(f"keys_of_{file.removesuffix('.json')}.txt", "\n".join(lines) + "\n")
