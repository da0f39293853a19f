"""The page of every key of scenario, study and map files, from their schemas; `scripts.written_pages` writes it."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

from looping_pendulum.measured.camera import CAMERA
from looping_pendulum.measured.study import Study
from looping_pendulum.pages.markdown import table
from looping_pendulum.reference_ode.effects import COEFFICIENTS, LIBRARY, Coefficient
from looping_pendulum.reference_ode.effects.closure import CLOSURE
from looping_pendulum.scenarios.fields import QUANTITY_TEXT, QuantityField, undescribed_schema
from looping_pendulum.scenarios.quantities import file_key, quantity_kind
from looping_pendulum.scenarios.schema import ScenarioFile
from looping_pendulum.scenarios.units import pretty
from looping_pendulum.sweep.map_file import MapPlan
from looping_pendulum.sweep.quantities import FACTORS, VARIABLES

HEAD = ["key", "it takes", "example", "default", "meaning"]
ELSEWHERE = {
    "effects": "some of the [coefficients](#coefficients-of-effects)",
    "parameters": "one to three of the [quantities](#quantities-of-a-map)",
    "camera": "some of the [errors of a camera](#errors-of-a-camera)",
    "quick": "some of the [metrics](metrics.md), each with the keys below",
    "accurate": "as `quick`",
}
"""Key of a group whose own keys are listed in a table of their own -> the words in its row."""
TYPES = {"string": "text", "integer": "a whole number", "number": "a plain number", "boolean": "true or false"}


@dataclass(frozen=True, kw_only=True)
class KeyGroup:
    """A group of keys of a file, which has a table of its own."""

    path: str
    """Key of the group, with dots; '' for the file itself."""
    meaning: str
    rows: list[list[str]]
    """A row per key, as `HEAD`."""


def key_groups(
    schema: dict[str, Any], root: dict[str, Any], defaults: Mapping[str, str], path: str = "", meaning: str = ""
) -> Iterator[KeyGroup]:
    """Yield the group of keys that ``schema`` describes, then those inside it.

    ``defaults`` has the defaults that the schema does not state, by key.
    """
    rows, inside = [], []
    for key, entry in schema["properties"].items():
        inner = _resolved(entry, root)
        here = f"{path}.{key}".lstrip(".")
        default = defaults.get(here, "")
        if "default" in entry:
            default = f"`{_text(entry['default'])}`"
        elif key in schema.get("required", ()):
            default = "required"
        what = entry.get("description") or inner.get("description", "")
        takes, example = _takes(inner, root)
        if key in ELSEWHERE and inner.get("type") == "object":
            takes = ELSEWHERE[key]
            if key == "quick":
                limit = _resolved(next(iter(inner["properties"].values())), root)
                inside.append((limit, f"{here}.METRIC", "The limit on one metric."))
        else:
            below, way = _group_below(inner, root, here)
            if below:
                inside.append((below, way, what or below.get("description", "")))
        rows.append([f"`{key}`", takes, f"`{example}`" if example else "", default, what])
    yield KeyGroup(path=path, meaning=meaning, rows=rows)
    for below, way, what in inside:
        yield from key_groups(below, root, defaults, way, what)


def _resolved(schema: dict[str, Any], root: dict[str, Any]) -> dict[str, Any]:
    """Return a schema, with a reference replaced by its target."""
    target = schema.get("$ref", "")
    return root["$defs"][target.removeprefix("#/$defs/")] if target else schema


def _group_below(schema: dict[str, Any], root: dict[str, Any], path: str) -> tuple[dict[str, Any] | None, str]:
    """Return the group of keys inside ``schema``, or None, and how its keys begin."""
    if schema.get("properties"):
        return schema, path
    if isinstance(schema.get("items"), dict):
        return _group_below(_resolved(schema["items"], root), root, f"{path}[]")
    if isinstance(schema.get("additionalProperties"), dict):
        return _group_below(_resolved(schema["additionalProperties"], root), root, f"{path}.NAME")
    for one in schema.get("anyOf", schema.get("oneOf", ())):
        if "properties" in (choice := _resolved(one, root)):
            return choice, path
    return None, ""


def _takes(schema: dict[str, Any], root: dict[str, Any]) -> tuple[str, str]:
    """Return what a key takes, in words, and an example."""
    example = next(iter(schema.get("examples", ())), "")
    if QUANTITY_TEXT in schema:
        return schema[QUANTITY_TEXT], str(example)
    if "enum" in schema:
        return "one of " + ", ".join(f"`{word}`" for word in schema["enum"]), ""
    choices = [_resolved(one, root) for one in schema.get("anyOf", schema.get("oneOf", ()))]
    if choices:
        each = [_takes(one, root) for one in choices]
        return ", or ".join(takes for takes, _ in each), next((e for _, e in each if e), "")
    if schema.get("type") == "array":
        takes, example = _takes(_resolved(schema["items"], root), root) if "items" in schema else ("a value", "")
        return f"a list, each {takes}", f"[{example}]" if example else ""
    if schema.get("type") == "object":
        return ("a group" if schema.get("properties") else "a group of groups, each with a name"), ""
    return TYPES.get(schema.get("type", ""), ""), str(example)


def _text(value: object) -> str:
    """Return a default as a file has it."""
    return {True: "true", False: "false"}[value] if isinstance(value, bool) else str(value)


def section(model: Any, defaults: Mapping[str, str] = MappingProxyType({})) -> str:
    """Return the tables of a file's keys: those of the file itself, then those of each group in it."""
    schema = undescribed_schema(model)
    first, *others = key_groups(schema, schema, defaults)
    parts = [table(HEAD, first.rows, left=len(HEAD))]
    for group in others:
        parts.append(f"Below **`{group.path}`**: {group.meaning}\n\n{table(HEAD, group.rows, left=len(HEAD))}")
    return "\n".join(parts)


def coefficient_default(c: Coefficient) -> str:
    """Return the value of a coefficient that a file leaves out."""
    return "the kinetic one" if c.name == "static_friction" else _with_unit(c.default, c.unit)


def _with_unit(value: float, unit: str) -> str:
    return f"`{value:g} {pretty(unit)}".rstrip() + "`"


def coefficient_rows() -> Iterator[list[str]]:
    """Yield a row for each coefficient of the library's effects."""
    for effect in LIBRARY:
        if effect is CLOSURE:
            continue
        for c in effect.coefficients:
            key = f"`{file_key(c.name)}`"
            takes = quantity_kind(c).requirement
            yield [
                f"`{effect.name}`",
                f"`{c.name}`",
                key,
                takes,
                coefficient_default(c),
                c.meaning,
                effect.formula,
                effect.source,
            ]


def camera_rows() -> Iterator[list[str]]:
    """Yield a row for each error of a camera."""
    for c in CAMERA.values():
        yield [f"`{c.name}`", quantity_kind(c).requirement, _with_unit(c.null, c.unit), c.meaning]


def variable_rows() -> Iterator[list[str]]:
    """Yield a row for each quantity of a map that is no coefficient."""
    coefficients = {c.name for effect in LIBRARY for c in effect.coefficients}
    for variable in VARIABLES.values():
        if variable.name not in coefficients:
            other = "" if variable.name in FACTORS else f"`{file_key(variable.name)}`"
            example = f"`{QuantityField(variable.kind).kind.example_text}`"
            yield [f"`{variable.name}`", other, variable.kind.requirement, example, variable.meaning]


def page() -> str:
    """Return the text of the page."""
    effect_head = ["effect", "coefficient", "in a scenario", "it takes", "default", "meaning", "formula", "source"]
    camera_head = ["key", "it takes", "without the error", "meaning"]
    quantity_head = ["quantity", "also written", "it takes", "example", "meaning"]
    return f"""# Every key of the files

All three files are YAML. A dot leads into a group: `light.mass` is the key `mass` below `light:`. `[]` stands for each entry
of a list, and a word in capitals for a name of your choice. A quantity is written with its unit, as `6.25 mm` or `112 deg`;
lengths, masses, times and angles take any unit of their kind, such as m, cm, mm, in; kg, g, oz; s, ms, min; rad, deg, turn. A
key that is not listed here is refused. Where the column *default* is empty, the key may be left out, and *meaning* says what
then holds; required keys of a group are required only if the group is there.

An editor that reads JSON Schema completes the keys and checks the values while you type:

```sh
looping-pendulum scenarios --schema > scenario.schema.json
looping-pendulum identify --schema > study.schema.json
looping-pendulum map --schema > map.schema.json
```

With the YAML extension of VS Code, the file's first line is then `# yaml-language-server: $schema=scenario.schema.json`; files
that `looping-pendulum new` writes begin so, and the schema stands beside them.

## Scenario

A trial: apparatus, release, and what is expected of an engine that rebuilds it. `looping-pendulum new scenario` writes one.

{section(ScenarioFile, {file_key(c.name): coefficient_default(c) for c in COEFFICIENTS.values()})}
## Study

Measured trials, and the effects that are declared to act in them ([measured trials](measured.md)). `looping-pendulum new study`
writes one. A standard error follows `+/-`, in a unit of the same kind or in %; without one, the value is exact. *free* says
that nothing is known of the value.

{section(Study)}
## Map

One scenario, run again and again while one to three quantities change ([maps](maps.md)).

{section(MapPlan)}
## Coefficients of effects

The key of a scenario is in the third column. A study gives a coefficient under `effects` as `EFFECT: value`, which is that of
the effect's first coefficient, or as `EFFECT: {{COEFFICIENT: value}}`. A map varies it by its name under `parameters`.

The file `repaired.yaml`, which `identify` writes, may also have keys that begin with `closure_`: they hold a force that is in
no list of effects.

{table(effect_head, coefficient_rows(), left=len(effect_head))}
## Errors of a camera

Under `trials[].camera` of a study, each with a standard error or *free*.

{table(camera_head, camera_rows(), left=len(camera_head))}
## Quantities of a map

Under `parameters` of a map, each with a list of values or a group: `from` and `to` (the ends), `count` (of values, not with
`sample`) and `spacing` (`linear`, or `log` for equal factors), or `values` (a list). Beside these, every coefficient above.

{table(quantity_head, variable_rows(), left=len(quantity_head))}"""
