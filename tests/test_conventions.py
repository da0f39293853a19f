"""House rules that a whole package keeps, each asked of every module of it."""

import dataclasses
import importlib
import pkgutil

import pytest

MUTABLE = {
    "ReadingNotes": "collects what a reader has to say while it reads",
    "IsolatedEngine": "stands for an engine, and engines are named by position",
    "ValueRange": "grows as cells are read",
    "EngineSummary": "grows as cells are read",
    "TrialSearch": "keeps the misfits that it has computed",
}
"""Dataclass that is not frozen or not by keyword -> why."""


def dataclasses_below(folder):
    package = importlib.import_module(f"looping_pendulum.{folder}")
    for module in [package.__name__, *(m.name for m in pkgutil.walk_packages(package.__path__, f"{package.__name__}."))]:
        if not module.endswith(".worker"):  # that one runs when it is imported
            for name, value in vars(importlib.import_module(module)).items():
                if isinstance(value, type) and dataclasses.is_dataclass(value) and value.__module__ == module:
                    yield f"{module}.{name}", value


def is_strict(kind):
    return kind.__dataclass_params__.frozen and all(f.kw_only for f in dataclasses.fields(kind))


@pytest.mark.parametrize("folder", ["reference_ode", "scenarios", "engines", "compare", "discrepancy", "sweep", "teaching"])
def test_dataclasses_are_frozen_and_keyword_only(folder):
    # A frozen one cannot be changed behind the back of who keeps it, and keywords cannot be exchanged.
    classes = list(dataclasses_below(folder))
    assert classes
    loose = [name for name, kind in classes if kind.__name__ not in MUTABLE and not is_strict(kind)]
    assert not loose, "write @dataclass(frozen=True, kw_only=True), or say in MUTABLE why not"
