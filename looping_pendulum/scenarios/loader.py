"""Read scenario files into `Scenario`, and write them. Every error is a `ScenarioError` of one line: file, line, key, what."""

from __future__ import annotations

import dataclasses
import difflib
import functools
import math
import os
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any

import yaml
from pydantic import ValidationError

from looping_pendulum.errors import ParameterError, ScenarioError
from looping_pendulum.reference_ode import effects as effect_library
from looping_pendulum.reference_ode.effects.own import OwnEffect, effect_of
from looping_pendulum.reference_ode.parameters import Parameters, Release
from looping_pendulum.scenarios import document, own_effects, schema
from looping_pendulum.scenarios.document import Document, one_line
from looping_pendulum.scenarios.fields import first_error
from looping_pendulum.scenarios.metrics import METRICS
from looping_pendulum.scenarios.quantities import FILE_KEYS, file_key, unit_of
from looping_pendulum.scenarios.scenario import (
    PROFILES,
    Inference,
    MeasuredTable,
    Scenario,
    Tolerance,
)
from looping_pendulum.scenarios.schema import ScenarioFile, json_schema
from looping_pendulum.scenarios.units import show

__all__ = ["dump", "json_schema", "load", "load_text", "shipped"]

AIR_DENSITY = 1.2
"""Density of air [kg/m^3] for a drag shape that does not give it (paper, sec. IV)."""
SUFFIXES = (".yaml", ".yml")
"""File name extensions that are not part of a scenario's name."""


def shipped() -> list[str]:
    """Return the names of the scenarios that come with the package."""
    return names_in(_folder())


def names_in(folder: Traversable) -> list[str]:
    """Return the names of the YAML files in a folder."""
    return sorted(Path(entry.name).stem for entry in folder.iterdir() if entry.name.endswith(".yaml"))


def load(name_or_path: str | Path) -> Scenario:
    """Load a shipped scenario by its name, or any scenario by its path.

    Raises
    ------
    ScenarioError
        If there is no such scenario, or if its file has an error.
    """
    raw, file, name = read_source(name_or_path, _folder())
    return _scenario(_parse(raw, file), name)


_parse = functools.lru_cache(maxsize=16)(document.parse)
"""`document.parse` with a cache, because reading YAML takes nine tenths of the time of loading a scenario."""


def source_text(name_or_path: str | Path) -> str:
    """Return the text of a scenario's file, including comments, after checking that it loads.

    Raises
    ------
    ScenarioError
        As `load`.
    """
    load(name_or_path)
    return read_source(name_or_path, _folder())[0].decode("utf-8-sig")


def read_source(name_or_path: str | Path, folder: Traversable, kind: str = "scenario") -> tuple[bytes, str, str]:
    """Return a file by its path or, in the folder of shipped ones, its name: its bytes, its name in errors, and without suffix.

    Raises
    ------
    ScenarioError
        If there is no such file, or if it cannot be read.
    """
    if isinstance(name_or_path, str) and name_or_path in names_in(folder):
        file = f"{name_or_path}.yaml"
        return (folder / file).read_bytes(), file, name_or_path
    path, shown = Path(name_or_path), os.fspath(name_or_path)
    try:
        is_file = path.is_file()
    except (OSError, ValueError):  # too long for the file system, or with a null character
        is_file = False
    if not is_file:
        raise ScenarioError(one_line(_not_found(path, shown, names_in(folder), kind)))
    try:
        with path.open("rb") as stream:
            # One byte more than is allowed: enough to refuse a larger file, without reading all of it
            raw = stream.read(document.MAX_FILE_SIZE + 1)
    except OSError as error:
        raise ScenarioError(one_line(f"{shown}: cannot be read: {error.strerror}")) from None
    return raw, shown, path.stem


def load_text(text: str, name: str) -> Scenario:
    """Load a scenario from YAML text; ``name`` may end in ".yaml" and names the file in errors.

    Raises
    ------
    ScenarioError
        If the text has an error.
    """
    stem = Path(name).stem if name.endswith(SUFFIXES) else name
    # Lone surrogates are passed on to the reader, which refuses them with their line
    return _scenario(document.parse(text.encode("utf-8", "surrogatepass"), name), stem)


def _folder() -> Traversable:
    """Return the folder of the shipped scenarios."""
    return resources.files("looping_pendulum.scenarios")


def _not_found(path: Path, shown: str, names: list[str], kind: str) -> str:
    """Return the message that there is no such file, with the nearest name."""
    name = path.stem if path.suffix in SUFFIXES else shown
    near = difflib.get_close_matches(name, names, n=1, cutoff=0.5)
    hint = f"did you mean '{near[0]}'? " if near else ""
    shown = shown or "''"
    problem = f"found neither a file nor a shipped {kind} of this name"
    return f"{document.shorten(shown)}: {problem}; {hint}shipped: {', '.join(names)}"


def _scenario(doc: Document, name: str) -> Scenario:
    """Validate a document and return its scenario."""
    model = ScenarioFile
    try:
        own = own_effects.read(doc.data)
        model = schema.file_model(c for each in own for c in effect_of(each).coefficients)
        file = model.model_validate(doc.data, context=[each.name for each in own])
    except ValidationError as error:
        raise first_error(error, doc, model) from None
    try:
        parameters = _parameters(file, own)
    except ParameterError as error:
        parameter, _, message = str(error).partition(": ")
        raise doc.error(tuple(file_key(parameter).split(".")), message) from None
    return Scenario(
        name=name,
        title=file.title,
        description=file.description,
        parameters=parameters,
        duration=file.duration,
        tolerances=_tolerances(file),
        inferred=tuple(Inference(parameters=tuple(i.parameters), how=i.how, script=i.script) for i in file.inferred),
        measured=MeasuredTable(**file.measured.model_dump()) if file.measured else None,
    )


def _parameters(file: ScenarioFile, own: tuple[OwnEffect, ...]) -> Parameters:
    """Return the parameters of a validated file; those that it leaves out keep their default."""
    fields: dict[str, Any] = {}
    coefficients: dict[str, float] = file.effects.model_dump(exclude_none=True)
    for parameter, key in FILE_KEYS.items():
        value: Any = file
        for part in key.split("."):
            value = getattr(value, part)
        if isinstance(value, schema.DragShape):
            density = AIR_DENSITY if value.air_density is None else value.air_density
            value = effect_library.drag_coefficient(value.shape_factor, density, value.area)
        if value is not None:
            (coefficients if parameter in effect_library.COEFFICIENTS else fields)[parameter] = value
    if fields["release"] == Release.VERTICAL.value:
        # `Parameters` requires an angle, though this release determines it
        fields["release_angle"] = math.pi
    return Parameters(**fields, coefficients=coefficients, own_effects=own)


def _tolerances(file: ScenarioFile) -> tuple[Tolerance, ...]:
    """Return the tolerances of a validated file."""
    tolerances: list[Tolerance] = []
    for engine, profiles in file.tolerances.items():
        for profile in PROFILES:
            limits = getattr(profiles, profile)
            given = limits.model_dump(by_alias=True, exclude_none=True) if limits else {}
            tolerances += [Tolerance(engine=engine, profile=profile, metric=metric, **limit) for metric, limit in given.items()]
    return tuple(tolerances)


class _Dumper(yaml.SafeDumper):
    """PyYAML's dumper, but with unprintable text in double quotes.

    Outside them it writes some line breaks that YAML folds on reading, so that the text would change.
    """


def _text_node(dumper: yaml.SafeDumper, text: str) -> yaml.Node:
    """Return the YAML node of a text."""
    unprintable = not text.replace("\n", " ").isprintable()
    return dumper.represent_scalar("tag:yaml.org,2002:str", text, style='"' if unprintable else None)


_Dumper.add_representer(str, _text_node)


def dump(scenario: Scenario) -> str:
    """Return ``scenario`` as YAML with units; loading it gives an equal scenario."""
    p = scenario.parameters
    data: dict[str, Any] = {"title": scenario.title, "description": scenario.description}
    values = vars(p.values())
    for parameter, key in FILE_KEYS.items():
        is_default = parameter == "static_friction" and values[parameter] == values["kinetic_friction"]
        vertical = parameter == "release_angle" and p.release is Release.VERTICAL
        if is_default or vertical or (parameter == "light_radius" and not p.light_radius):
            continue
        group, _, name = key.rpartition(".")
        (data.setdefault(group, {}) if group else data)[name] = _yaml_value(parameter, values[parameter])
    data["duration"] = show(scenario.duration, "s")
    known = effect_library.COEFFICIENTS | {c.name: c for own in p.own_effects for c in effect_of(own).coefficients}
    others = {
        name: show(value, known[name].unit) if known[name].unit else float(value)
        for name, value in p.coefficients.items()
        if name not in FILE_KEYS and value != known[name].default
    }
    measured = dataclasses.asdict(scenario.measured) if scenario.measured else {}
    # Without a script the key is left out
    inferred = [
        {"parameters": list(i.parameters), "how": i.how} | ({"script": i.script} if i.script else {}) for i in scenario.inferred
    ]
    optional = {
        own_effects.KEY: own_effects.tree(p.own_effects),
        "effects": others,
        "inferred": inferred,
        "measured": measured,
        "tolerances": _tolerance_tree(scenario),
    }
    data |= {key: value for key, value in optional.items() if value}
    return str(yaml.dump(data, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=100))


def _yaml_value(parameter: str, value: Any) -> Any:
    """Return the value of a parameter as a file has it, with its unit."""
    if parameter == "release":
        return str(value.value)
    unit = unit_of(parameter)
    return show(value, unit) if unit else float(value)


def _tolerance_tree(scenario: Scenario) -> dict[str, Any]:
    """Return the tolerances as nested groups: engine, profile, metric."""
    tree: dict[str, Any] = {}
    for t in scenario.tolerances:
        unit = METRICS[t.metric].unit
        entry: dict[str, Any] = {"limit": show(t.limit, unit) if unit else float(t.limit), "reason": t.reason}
        if t.expected_failure:
            entry["expected_failure"] = t.expected_failure
        tree.setdefault(t.engine, {}).setdefault(t.profile, {})[t.metric] = entry
    return tree
