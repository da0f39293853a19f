"""Keys of the files of results: one that changes or goes raises the version of its file, by which a reader refuses it."""

import dataclasses
import json
import typing

import jsonschema
import pytest

from looping_pendulum.compare import compare
from looping_pendulum.compare.baseline import ResultChanges
from looping_pendulum.compare.convergence.result import ConvergenceResult
from looping_pendulum.compare.result import ComparisonResult
from looping_pendulum.discrepancy import result as identification
from scripts import result_schema
from tests.compare.golden import golden
from tests.discrepancy.test_report import made_up

FILES = {
    "result.json": (ComparisonResult, ComparisonResult.SCHEMA_VERSION),
    "changes.json": (ResultChanges, ResultChanges.SCHEMA_VERSION),
    "convergence.json": (ConvergenceResult, ConvergenceResult.SCHEMA_VERSION),
    "verdict.json": (identification.Identification, identification.SCHEMA_VERSION),
}


def keys_of(cls, found):
    """Add class -> its fields in a file, for ``cls`` and for all classes in its fields."""
    if dataclasses.is_dataclass(cls) and cls.__name__ not in found:
        hints = typing.get_type_hints(cls)
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


@pytest.mark.parametrize("file", result_schema.SCHEMAS, ids=lambda file: file.name)
def test_the_shipped_schema_is_that_of_the_classes(file):
    assert file.read_text(encoding="utf-8") == result_schema.text(file), "run: python -m scripts.result_schema"


def test_a_result_is_as_the_shipped_schema_says(measured_scenario, reference, make_run, missing, table, limit):
    schema = ComparisonResult.json_schema()
    limited = dataclasses.replace(measured_scenario, tolerances=(limit("rms_0.7s", 1e-3),))
    runs = [make_run(shift=(0.02, 0.0), settings={"a": (1, 2.0), "b": None}), missing]
    tree = json.loads(compare(limited, reference, runs, table).to_json())
    validator = jsonschema.Draft202012Validator(schema)
    validator.check_schema(schema)
    validator.validate(tree)
    assert set(schema["properties"]) == set(tree)
    for change in ({"duration": "1 s"}, {"engines": {}}, {"schema": {"id": "other", "version": 4}}):
        assert not validator.is_valid(tree | change)
    del tree["clock"]
    assert not validator.is_valid(tree)


@pytest.mark.parametrize("verdict", identification.Verdict)
def test_a_verdict_is_as_the_shipped_schema_says(verdict):
    schema = identification.json_schema()
    tree = json.loads(identification.dump(made_up(verdict)))
    validator = jsonschema.Draft202012Validator(schema)
    validator.check_schema(schema)
    validator.validate(tree)
    assert set(schema["properties"]) == set(tree)
    for change in ({"verdict": "perhaps"}, {"effects": {}}, {"schema": {"id": "other", "version": 12}}):
        assert not validator.is_valid(tree | change)
