"""Reads map files into `MapPlan`. Every fault is a `ScenarioError` of one line: file, line, key, found, needed."""

from __future__ import annotations

from dataclasses import replace
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Annotated, Any

from pydantic import BeforeValidator, WithJsonSchema
from pydantic_core import PydanticCustomError

from looping_pendulum.engines.protocol import Profile
from looping_pendulum.engines.registry import how_to_get, label, missing_packages, select
from looping_pendulum.errors import EngineError, ScenarioError
from looping_pendulum.reference_ode.parameters import Release
from looping_pendulum.reference_ode.solve import DURATION
from looping_pendulum.scenarios import document, loader
from looping_pendulum.scenarios.document import Document, one_line, quote, shorten
from looping_pendulum.scenarios.fields import (
    Group,
    Key,
    KeyGroup,
    QuantityField,
    SimpleField,
    Text,
    input_error,
    model_schema,
    one_of,
    read_model,
    whole_number,
)
from looping_pendulum.scenarios.quantities import FILE_KEYS, QUANTITIES
from looping_pendulum.scenarios.scenario import Scenario
from looping_pendulum.scenarios.units import QuantityKind
from looping_pendulum.sweep.axis_file import COUNT, MAX_RUNS, axis_field, axis_of
from looping_pendulum.sweep.cells import engine_called
from looping_pendulum.sweep.plan import REFERENCE, Axis, Grid, MapPlan, Sample
from looping_pendulum.sweep.quantities import ALLOWED_OVERLAP, Variable, variables

MAX_AXES = 3
"""Largest number of quantities that a map varies."""
MAX_ENGINE_RUNS = 20_000
"""Largest number of runs of engines without --max-runs; their runs take seconds."""
TOLERANCE = 1e-9
"""Relative tolerance of a step where the map file gives none.

Halting times differ from those at 1e-12 by 4e-9 s at most, and no run ends otherwise, in 20 000 runs over release angle, mass
ratio and rod radius; a map and its report show four to six digits.
"""
TITLE_LIMIT = 200
"""Largest number of characters of a title; a longer one is cut."""


def _names(raw: object) -> list[str]:
    listed = raw if isinstance(raw, list) else [raw]
    if not listed or not all(isinstance(name, str) for name in listed):
        raise input_error(f"expected an engine or a list of them, got {quote(raw)}; write for example 'reference'")
    return [str(name) for name in listed]


PARAMETERS = {key: v for v in variables().values() for key in (v.name, FILE_KEYS.get(v.name, v.name))}
"""Key under ``parameters`` -> its quantity: "release_angle" or, as in a scenario file, "release.angle"."""
_AXES = KeyGroup(keys={key: Key(axis_field(variable)) for key, variable in PARAMETERS.items()})


def _parameters(raw: object) -> dict[str, Any]:
    if isinstance(raw, dict) and 1 <= len(raw) <= MAX_AXES:
        keys: dict[str, Any] = _AXES.read(raw)
        return keys
    number = f"{len(raw)} quantities" if isinstance(raw, dict) else quote(raw)
    example = "release_angle: {from: 60 deg, to: 130 deg, count: 71}"
    raise input_error(f"found {number}, needed one to {MAX_AXES}; write for example '{example}'")


Count = Annotated[int, COUNT]
_PARAMETERS_SCHEMA = _AXES.json_schema | {"minProperties": 1, "maxProperties": MAX_AXES}
_ENGINE_SCHEMA = {"anyOf": [{"type": "string"}, {"type": "array", "items": {"type": "string"}, "minItems": 1}]}


class SampleGroup(Group):
    """Runs distributed evenly over the box of all parameters, instead of a grid."""

    method: Annotated[str, one_of("sobol", "halton")] = "sobol"
    """Low-discrepancy sequence, scrambled: sobol (a power of 2 runs is best) or halton."""
    count: Count
    """Number of runs."""
    seed: Annotated[int, whole_number("1", low=0)] = 0
    """Seed of the scrambling."""


class MapFile(Group):
    """A map: one scenario, run again and again while one to three quantities change."""

    title: Text
    """A few words."""
    description: Text = ""
    """Question that the map answers."""
    scenario: Text
    """Shipped scenario, or path of a file from this file's folder."""
    engine: Annotated[Any, BeforeValidator(_names), WithJsonSchema(_ENGINE_SCHEMA)] = [REFERENCE]
    """reference, if not given, or engines and variants, whose runs take seconds each."""
    profile: Annotated[str, one_of(*(p.value for p in Profile))] = Profile.QUICK.value
    """Profile of the engines' settings; the reference has its tolerance."""
    parameters: Annotated[dict[str, Any], SimpleField(_parameters, _PARAMETERS_SCHEMA)]
    """One to three quantities, each with a range or a list of values."""
    sample: SampleGroup | None = None
    tolerance: Annotated[float, QuantityField(QuantityKind(unit="", low=1e-15, high=1e-3, example="1e-12"))] = TOLERANCE
    """Relative tolerance of a step of the reference."""
    duration: Annotated[float, QuantityField(replace(QUANTITIES["duration"].kind, example="5 s"))] | None = None
    """Limit on the simulated time of a run; 5 s or the scenario's, whichever is longer."""
    chunk: Count | None = None
    """Most runs that are computed, written and resumed as one."""


def json_schema() -> dict[str, Any]:
    """Return the JSON Schema (draft 2020-12) of a map file, for editors that complete and check YAML."""
    return model_schema(MapFile, "Looping pendulum map")


def shipped() -> list[str]:
    """Return the names of the maps that come with the package."""
    return loader.names_in(_folder())


def load(name_or_path: str | Path) -> MapPlan:
    """Load a shipped map by its name, or any by its path.

    Raises
    ------
    ScenarioError
        If there is no such file, or if it is faulty.
    EngineError, MissingPackageError
        If it names an engine that is not known or not installed.
    """
    raw, file, name = loader.read_source(name_or_path, _folder(), "map")
    return load_text(raw, file=file, name=name, folder=None if name_or_path in shipped() else Path(name_or_path).parent)


def load_text(raw: bytes | str, *, file: str = "map.yaml", name: str = "map", folder: Path | None = None) -> MapPlan:
    """Load a map from YAML text; ``folder`` is where a scenario's path begins. Raises as `load`."""
    # Half characters reach the parser, which refuses them as it does in a file
    data = raw.encode("utf-8", "surrogatepass") if isinstance(raw, str) else raw
    doc = document.parse(data, file)
    checked = read_model(MapFile, doc)
    scenario = _scenario(doc, checked.scenario, folder)
    axes = _axes(doc, checked, scenario)
    plan = MapPlan(
        name=name,
        file=file,
        # Without the byte order mark that some editors on Windows write
        text=data.decode("utf-8-sig"),
        title=shorten(checked.title, TITLE_LIMIT),
        description=checked.description,
        scenario=scenario,
        engines=_engines(doc, checked, scenario),
        profile=Profile(checked.profile),
        design=Grid(axes=axes) if checked.sample is None else Sample(axes=axes, **checked.sample.model_dump()),
        tolerance=checked.tolerance,
        duration=max(DURATION, scenario.duration) if checked.duration is None else checked.duration,
        chunk=checked.chunk,
    )
    # One possible corner is enough: a map may reach into impossible values, whose runs it marks
    corners = list(plan.corners())
    if all(why is not None for _, why in corners):
        words, why = corners[0]
        message = f"found no possible apparatus at any corner (at {words}: {why}), needed other values"
        raise doc.error(("parameters",), message)
    return plan


def refuse_unintended_size(plan: MapPlan, most: int | None = None) -> None:
    """Refuse a map of more than ``most`` runs, by default of more than anybody is likely to intend.

    Raises
    ------
    ScenarioError
        If it has more.
    """
    usual = MAX_RUNS if set(plan.engines) == {REFERENCE} else MAX_ENGINE_RUNS
    limit = usual if most is None else most
    if plan.runs > limit:
        sizes = " x ".join(f"{name} {size}" for name, size in zip(plan.design.dims, plan.design.shape, strict=True))
        engines = f" x engines {len(plan.engines)}" if len(plan.engines) > 1 else ""
        message = f"{plan.file}: found {plan.runs} runs ({sizes}{engines}), needed at most {limit}"
        raise ScenarioError(one_line(f"{message}; lower a 'count', or if you mean it give --max-runs {plan.runs}"))


def _folder() -> Traversable:
    return resources.files("looping_pendulum.sweep") / "maps"


def _scenario(doc: Document, name: str, folder: Path | None) -> Scenario:
    try:
        return loader.load(name if name in loader.shipped() or folder is None else folder / name)
    except ScenarioError as error:
        raise doc.error(("scenario",), str(error)) from None


def _engines(doc: Document, checked: MapFile, scenario: Scenario) -> tuple[str, ...]:
    """Return the labels of the engines that the file names, each installed and able to run the scenario."""
    profile = Profile(checked.profile)
    labels: list[str] = []
    for name in checked.engine:
        try:
            labels += [label(engine) for engine in select([name], profile)]
        except EngineError as error:
            # The message is made for the command line; here the key of the file is named instead
            raise doc.error(("engine",), str(error).removeprefix("--engine: ")) from None
    # An engine may be named twice, by itself and by one of its variants
    labels = list(dict.fromkeys(labels))
    for engine in (engine_called(one, profile) for one in labels if one != REFERENCE):
        for package in missing_packages(engine):
            raise doc.error(("engine",), f"found {label(engine)}, needed its package {package}; get it: {how_to_get(package)}")
        if why := engine.abilities.unsupported(scenario.parameters):
            raise doc.error(("engine",), f"found {label(engine)}, needed an engine that can run {scenario.name}: {why}")
    return tuple(labels)


def _axes(doc: Document, checked: MapFile, scenario: Scenario) -> tuple[Axis, ...]:
    axes: list[Axis] = []
    varied: list[Variable] = []
    for key, given in checked.parameters.items():
        variable = PARAMETERS[key]
        for other in varied:
            both = sorted(set(variable.sets) & set(other.sets))
            if both and {variable.name, other.name} != ALLOWED_OVERLAP:
                message = f"found beside {other.name}, which also sets {both[0]}, needed only one of them; leave one out"
                raise doc.error(("parameters", key), message)
        varied.append(variable)
        if variable.name == "release_angle" and scenario.parameters.release is Release.VERTICAL:
            message = "found an angle, but a vertical release hangs at 180 deg, needed another quantity; leave it out"
            raise doc.error(("parameters", key), message)
        try:
            axes.append(axis_of(variable, given, doc.data["parameters"][key], sampled=checked.sample is not None))
        except PydanticCustomError as error:
            # `input_error` notes the key inside the range, for its line
            raise doc.error(("parameters", key, *(error.context or {}).get("keys", ())), str(error)) from None
    return tuple(axes)
