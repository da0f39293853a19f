"""The schemas of all three files, and the page of their keys, which a script writes from them."""

import json
import re
from pathlib import Path
from typing import Any

import pytest
import yaml

from looping_pendulum.measured import study_io
from looping_pendulum.measured.study import Study
from looping_pendulum.scenarios import dump, json_schema, load
from looping_pendulum.scenarios.fields import KeyGroup
from looping_pendulum.scenarios.schema import ScenarioFile
from looping_pendulum.sweep import map_file
from looping_pendulum.sweep.map_file import MapPlan
from scripts.keys_page import ELSEWHERE, page
from tests.command_line import here
from tests.scenarios.test_shipped import NAMES

PACKAGE = Path(__file__).parents[2] / "looping_pendulum"
SCENARIO = (PACKAGE / "scenarios" / "ten_to_one.yaml").read_text(encoding="utf-8")
STUDY = (PACKAGE / "teaching" / "example" / "study.yaml").read_text(encoding="utf-8")
MAP = (PACKAGE / "sweep" / "maps" / "quick.yaml").read_text(encoding="utf-8")
SECTIONS = {"Scenario": ScenarioFile, "Study": Study, "Map": MapPlan}


class EditorLoader(yaml.SafeLoader):
    """Reads YAML 1.2, as editors do, where 1e-9 is a number."""


EditorLoader.add_implicit_resolver(
    "tag:yaml.org,2002:float", re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?$"), list("-+0123456789.")
)


def as_an_editor_reads(text: str) -> object:
    return yaml.load(text, Loader=EditorLoader)


# A checker of the few words of JSON Schema that ours uses, so that no further package is needed.
def problems(schema: dict, data: object, root: dict, at: str = "") -> list[str]:
    if "$ref" in schema:
        return problems(root["$defs"][schema["$ref"].removeprefix("#/$defs/")], data, root, at)
    faults = []
    for choice in ("anyOf", "oneOf"):
        if choice in schema and not any(not problems(s, data, root, at) for s in schema[choice]):
            faults.append(f"{at}: none of {choice}")
    types = {"object": dict, "array": list, "string": str, "number": (int, float), "integer": int, "boolean": bool}
    if "type" in schema and (
        not isinstance(data, types[schema["type"]]) or (isinstance(data, bool) and schema["type"] != "boolean")
    ):
        return [f"{at}: not a {schema['type']}"]
    if "pattern" in schema and not re.search(schema["pattern"], str(data)):
        faults.append(f"{at}: pattern")
    if "enum" in schema and data not in schema["enum"]:
        faults.append(f"{at}: enum")
    if isinstance(data, int | float) and not schema.get("minimum", data) <= data <= schema.get("maximum", data):
        faults.append(f"{at}: bounds")
    if isinstance(data, list):
        for i, item in enumerate(data):
            faults += problems(schema.get("items", {}), item, root, f"{at}[{i}]")
    if isinstance(data, dict):
        faults += [f"{at}.{key}: missing" for key in schema.get("required", []) if key not in data]
        for key, value in data.items():
            below = schema.get("properties", {}).get(key, schema.get("additionalProperties", {}))
            faults += [f"{at}.{key}: unknown"] if below is False else problems(below, value, root, f"{at}.{key}")
    return faults


def models_in(annotation: Any) -> list[type]:
    """Every group inside an annotation such as ``tuple[Trial, ...] | None``."""
    if hasattr(annotation, "__pydantic_fields__"):
        return [annotation]
    return [model for inner in getattr(annotation, "__args__", ()) for model in models_in(inner)]


def keys_of(group: KeyGroup) -> set[str]:
    """Every key at any depth of a group."""
    inner = [key.field for key in group.keys.values() if isinstance(key.field, KeyGroup)]
    return set(group.keys).union(*map(keys_of, inner))


def last_keys(model: Any) -> set[str]:
    """Every key at any depth of a file, as the models themselves have it, apart from the metrics and coefficients."""
    keys = set()
    for name, field in model.__pydantic_fields__.items():
        alias = field.validation_alias or name
        keys |= {alias} - {f"<{name}>"}
        for group in (each for each in field.metadata if isinstance(each, KeyGroup) and alias not in ELSEWHERE):
            keys |= keys_of(group)
        for inner in models_in(field.annotation):
            keys |= last_keys(inner)
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


SCHEMAS = {SCENARIO: json_schema, STUDY: study_io.json_schema, MAP: map_file.json_schema}


def test_the_schemas_accept_what_is_shipped():
    scenarios = [(PACKAGE / "scenarios" / f"{name}.yaml").read_text(encoding="utf-8") for name in NAMES]
    maps = [path.read_text(encoding="utf-8") for path in (PACKAGE / "sweep" / "maps").glob("*.yaml")]
    shipped = {json_schema: [*scenarios, *(dump(load(name)) for name in NAMES)], map_file.json_schema: maps}
    for made, texts in (shipped | {study_io.json_schema: [STUDY]}).items():
        schema = made()
        for text in texts:
            assert problems(schema, as_an_editor_reads(text), schema) == [], text


@pytest.mark.parametrize(
    ("text", "old", "new", "problem"),
    [
        (SCENARIO, "6.25 mm", "6.25", ".rod.radius: not a string"),
        (SCENARIO, "  radius:", "  raduis:", ".rod.radius: missing"),
        (SCENARIO, "kind: looping", "kind: lopping", ".release.kind: enum"),
        (SCENARIO, "kinetic_friction: 0.3431", "kinetic_friction: -1", ".string.kinetic_friction: none of anyOf"),
        (SCENARIO, "rms_0.7s:", "rms:", ".tolerances.mujoco:capstan.accurate.rms: unknown"),
        (STUDY, "title:", "titel:", ".title: missing"),
        (STUDY, "10 g +/- 0.05 g", "ten g", ".apparatus.light.mass: pattern"),
        (STUDY, "held_out: true", "held_out: maybe", ".trials[1].held_out: not a boolean"),
        (STUDY, "light_drag: free", "light_drag: unknown", ".effects.light_drag: pattern"),
        (STUDY, "held_out:", "heldout:", ".trials[1].heldout: unknown"),
        (MAP, "mass_ratio:", "mass_ration:", ".parameters.mass_ration: unknown"),
        (MAP, "to: 12", "to: 12 kg", ".parameters.mass_ratio: none of anyOf"),
        (MAP, "1e-9", "1", ".tolerance: none of anyOf"),
    ],
)
def test_the_schemas_refuse_what_the_loaders_refuse(text, old, new, problem):
    schema = SCHEMAS[text]()
    assert old in text
    assert problem in problems(schema, as_an_editor_reads(text.replace(old, new)), schema)


def test_json_schema_describes_units_with_examples():
    schema = json_schema()
    assert schema["$schema"] == "https://json-schema.org/draft/2020-12/schema"
    radius = schema["properties"]["rod"]["properties"]["radius"]
    assert "a length above 0, with its unit" in radius["description"]
    assert radius["examples"] == ["6.25 mm"]
    groups = [*schema["$defs"].values(), *(schema["properties"][name] for name in ("light", "rod", "release", "effects"))]
    for group in groups:
        assert group.get("additionalProperties") is False
    assert "null" not in str(schema)
