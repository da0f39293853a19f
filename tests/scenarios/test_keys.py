"""The schemas of all three files, and the page of their keys, which a script writes from them."""

import json
import re
from pathlib import Path
from typing import Any

import pytest
import yaml
from pydantic import BaseModel

from looping_pendulum.measured import study_file
from looping_pendulum.measured.study_file import StudyFile
from looping_pendulum.scenarios.schema import Limits, file_model
from looping_pendulum.sweep import map_file
from looping_pendulum.sweep.map_file import MapFile
from scripts.keys_page import PAGE, page
from tests.command_line import here
from tests.scenarios.test_shipped import problems

PACKAGE = Path(__file__).parents[2] / "looping_pendulum"
STUDY = (PACKAGE / "teaching" / "example" / "study.yaml").read_text(encoding="utf-8")
MAP = (PACKAGE / "sweep" / "maps" / "quick.yaml").read_text(encoding="utf-8")
SECTIONS = {"Scenario": file_model(), "Study": StudyFile, "Map": MapFile}


class EditorLoader(yaml.SafeLoader):
    """Reads YAML 1.2, as editors do, where 1e-9 is a number."""


EditorLoader.add_implicit_resolver(
    "tag:yaml.org,2002:float", re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?$"), list("-+0123456789.")
)


def as_an_editor_reads(text: str) -> object:
    return yaml.load(text, Loader=EditorLoader)


def test_the_page_is_what_the_script_writes():
    assert Path(__file__).parents[2] / "docs" / "keys.md" == PAGE
    assert PAGE.read_text(encoding="utf-8") == page(), "out of date; write it again: python -m scripts.keys_page"


def models_in(annotation: Any) -> list[type[BaseModel]]:
    """Every group inside an annotation such as ``list[TrialGroup] | None``."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [model for inner in getattr(annotation, "__args__", ()) for model in models_in(inner)]


def last_keys(model: type[BaseModel]) -> set[str]:
    """Every key at any depth of a file, as the models themselves have it, apart from the metrics and coefficients."""
    keys = set()
    for name, field in model.model_fields.items():
        keys.add(name)
        for inner in models_in(field.annotation):
            keys |= set() if inner is Limits or inner.__name__ == "EffectsGroup" else last_keys(inner)
    return keys


@pytest.mark.parametrize("section", SECTIONS)
def test_the_page_has_every_key_of_the_models_and_each_has_a_meaning(section):
    text = page().partition(f"\n## {section}\n")[2].partition("\n## ")[0]
    rows = [[cell.strip() for cell in line.strip("|").split(" | ")] for line in text.splitlines() if line.startswith("| `")]
    assert {row[0].strip(" `") for row in rows} >= last_keys(SECTIONS[section])
    for key, takes, _, _, meaning in rows:
        assert takes, key
        assert meaning.strip(" |"), key


@pytest.mark.parametrize(("command", "name"), [("scenarios", "scenario"), ("identify", "study"), ("map", "map")])
def test_each_command_prints_the_schema_of_its_files(command, name):
    done = here(command, "--schema")
    assert done.returncode == 0, done.stderr
    schema = json.loads(done.stdout)
    assert schema["title"] == f"Looping pendulum {name}"
    assert "x-words" not in done.stdout


def test_the_schemas_accept_what_is_shipped():
    schema = study_file.json_schema()
    assert problems(schema, as_an_editor_reads(STUDY), schema) == []
    schema = map_file.json_schema()
    for path in (PACKAGE / "sweep" / "maps").glob("*.yaml"):
        assert problems(schema, as_an_editor_reads(path.read_text(encoding="utf-8")), schema) == []


@pytest.mark.parametrize(
    ("text", "old", "new", "problem"),
    [
        (STUDY, "title:", "titel:", ".title: missing"),
        (STUDY, "10 g +/- 0.05 g", "ten g", ".apparatus.light.mass: pattern"),
        (STUDY, "held_out: true", "held_out: maybe", ".trials[1].held_out: not a boolean"),
        (STUDY, "light_drag: free", "light_drag: unknown", ".effects.light_drag: none of anyOf"),
        (STUDY, "held_out:", "heldout:", ".trials[1].heldout: unknown"),
        (MAP, "mass_ratio:", "mass_ration:", ".parameters.mass_ration: unknown"),
        (MAP, "to: 12", "to: 12 kg", ".parameters.mass_ratio: none of anyOf"),
        (MAP, "1e-9", "1", ".tolerance: none of anyOf"),
    ],
)
def test_the_schemas_refuse_what_the_loaders_refuse(text, old, new, problem):
    schema = (study_file if text is STUDY else map_file).json_schema()
    assert old in text
    assert problem in problems(schema, as_an_editor_reads(text.replace(old, new)), schema)
