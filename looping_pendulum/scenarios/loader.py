"""Read scenario files into `Scenario`, and write them. Every error is a `ScenarioError` of one line: file, line, key, what."""

from __future__ import annotations

import difflib
import functools
import os
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any

from looping_pendulum.errors import ParameterError, ScenarioError, shorten
from looping_pendulum.reference_ode import effects as effect_library
from looping_pendulum.reference_ode.effects.own import effect_of
from looping_pendulum.reference_ode.parameters import Parameters, Release
from looping_pendulum.scenarios import document, own_effects
from looping_pendulum.scenarios.document import Document, quote, to_yaml
from looping_pendulum.scenarios.fields import QuantityField, file_keys, read_model, suggest
from looping_pendulum.scenarios.quantities import FILE_KEYS, file_key, quantity_kind
from looping_pendulum.scenarios.scenario import Scenario
from looping_pendulum.scenarios.schema import ScenarioFile, json_schema

__all__ = ["dump", "json_schema", "load", "load_text", "shipped"]

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
        is_file = path.exists() and not path.is_dir()
    except (OSError, ValueError):  # too long for the file system, or with a null character
        is_file = False
    if not is_file:
        raise ScenarioError(_not_found(path, shown, names_in(folder), kind))
    return document.read(path), shown, path.stem


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
    return f"{shorten(shown)}: {problem}; {hint}shipped: {', '.join(names)}"


def _scenario(doc: Document, name: str) -> Scenario:
    """Validate a document and return its scenario."""
    own_effects.warn_of_faulty_packages()
    file = read_model(ScenarioFile, doc)
    own = [c.name for effect in file.own_effects for c in effect_of(effect).coefficients]
    known = [*FILE_KEYS.values(), *map(file_key, (*effect_library.COEFFICIENTS, *own))]
    for i, inference in enumerate(file.inferred):
        for j, key in enumerate(inference.parameters):
            if key not in known:
                message = f"expected a key of this file such as 'release.angle', got {quote(key)}{suggest(key, known)}"
                raise doc.error(("inferred", i, "parameters", j), message)
    try:
        parameters = _parameters(file)
    except ParameterError as error:
        parameter, _, message = str(error).partition(": ")
        raise doc.error(tuple(file_key(parameter).split(".")), message) from None
    return Scenario(
        name=name,
        title=file.title,
        description=file.description,
        parameters=parameters,
        duration=file.duration,
        tolerances=file.tolerances,
        inferred=file.inferred,
        measured=file.measured,
    )


def _parameters(file: ScenarioFile) -> Parameters:
    """Return the parameters of a validated file; those that it leaves out keep their default."""
    groups = {"light": file.light, "heavy": file.heavy, "rod": file.rod, "string": file.string, "release": file.release}
    given = {f"{group}.{key}": value for group, values in groups.items() for key, value in values.items()}
    given |= {} if file.gravity is None else {"gravity": file.gravity}
    values = {parameter: given[key] for parameter, key in FILE_KEYS.items() if key in given}
    coefficients = {name: value for name, value in values.items() if name in effect_library.COEFFICIENTS}
    fields = {name: value for name, value in values.items() if name not in coefficients}
    return Parameters(**fields, coefficients=file.effects | coefficients, own_effects=file.own_effects)


def dump(scenario: Scenario) -> str:
    """Return ``scenario`` as YAML with units; loading it gives an equal scenario."""
    p = scenario.parameters
    values = vars(p.values())
    groups: dict[str, dict[str, Any]] = {}
    for parameter, key in FILE_KEYS.items():
        is_default = parameter == "static_friction" and values[parameter] == values["kinetic_friction"]
        vertical = parameter == "release_angle" and p.release is Release.VERTICAL
        if not (is_default or vertical or (parameter == "light_radius" and not p.light_radius)):
            group, _, name = key.rpartition(".")
            groups.setdefault(group, {})[name] = values[parameter]
    known = effect_library.COEFFICIENTS | {c.name: c for own in p.own_effects for c in effect_of(own).coefficients}
    others: Any = {
        name: QuantityField(quantity_kind(known[name])).write(value)
        for name, value in p.coefficients.items()
        if name not in FILE_KEYS and value != known[name].default
    }
    file = ScenarioFile(
        title=scenario.title,
        description=scenario.description,
        light=groups["light"],
        heavy=groups["heavy"],
        rod=groups["rod"],
        string=groups["string"],
        gravity=groups[""]["gravity"],
        release=groups["release"],
        duration=scenario.duration,
        inferred=scenario.inferred,
        measured=scenario.measured,
        tolerances=scenario.tolerances,
        own_effects=p.own_effects,
        effects=others,
    )
    return to_yaml(file_keys(file))
