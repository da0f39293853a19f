"""Map files, and what they say: the runs of a map, and how these are cut into chunks.

Every fault of a file is a `ScenarioError` of one line: file, line, key, found, needed.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import cached_property
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import AfterValidator, Field, model_validator

from looping_pendulum.engines.protocol import Profile
from looping_pendulum.engines.registry import how_to_get, label, missing_packages, select
from looping_pendulum.errors import EngineError, HarnessError, ParameterError, ScenarioError, shorten
from looping_pendulum.reference_ode.batch import impossible_runs, parameter_values
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.solve import DURATION
from looping_pendulum.scenarios import document, loader
from looping_pendulum.scenarios.document import quote
from looping_pendulum.scenarios.fields import (
    TEXT,
    DependentField,
    Group,
    QuantityField,
    Text,
    in_no_file,
    input_error,
    model_schema,
    one_of,
    read_model,
    whole_number,
)
from looping_pendulum.scenarios.quantities import QUANTITIES
from looping_pendulum.scenarios.scenario import Scenario
from looping_pendulum.scenarios.units import QuantityKind
from looping_pendulum.sweep.quantities import AXES, COUNT, MAX_RUNS, Axis, columns

REFERENCE = "reference"
"""Name of the exact model among the engines of a map."""
MAX_ENGINE_RUNS = 20_000
"""Largest number of runs of engines without --max-runs; their runs take seconds."""
TOLERANCE = 1e-9
"""Relative tolerance of a step where the map file gives none.

Halting times differ from those at 1e-12 by 4e-9 s at most, and no run ends otherwise, in 20 000 runs over release angle, mass
ratio and rod radius; a map and its report show four to six digits.
"""
TITLE_LIMIT = 200
"""Largest number of characters of a title; a longer one is cut."""
MIN_CHUNK_RUNS, MAX_CHUNK_RUNS, CHUNKS_PER_MAP = 1024, 65536, 64
"""Bounds on the runs per chunk, and chunks per map, where the map file does not give the size of a chunk.

Writing a chunk takes as long as a few hundred runs.
"""
ENGINE_CHUNK = 4
"""Runs per chunk of engines, whose runs take seconds."""

Region = tuple[slice, ...]
"""Slices of a map's dimensions."""


class MapError(HarnessError, ValueError):
    """A map cannot be made, or not here."""


def _scenario(raw: object, before: Mapping[str, Any]) -> Scenario:
    """Return the scenario that a map file names."""
    name, folder = TEXT.read(raw), before["folder"]
    try:
        return loader.load(name if name in loader.shipped() or folder is None else folder / name)
    except ScenarioError as error:
        raise input_error(str(error)) from None


def _engines(raw: object, before: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the labels of the engines that a map file names, each installed and able to run the scenario."""
    names: list[Any] = raw if isinstance(raw, list) else [raw]
    if not names or not all(isinstance(name, str) for name in names):
        raise input_error(f"expected an engine or a list of them, got {quote(raw)}; write for example 'reference'")
    try:
        engines = select(names, before.get("profile", Profile.QUICK))
    except EngineError as error:
        # The message is made for the command line; here the key of the file is named instead
        raise input_error(str(error).removeprefix("--engine: ")) from None
    for engine in engines:
        for package in missing_packages(engine):
            raise input_error(f"found {label(engine)}, needed its package {package}; get it: {how_to_get(package)}")
        scenario = before.get("scenario")
        if scenario and (why := engine.abilities.unsupported(scenario.parameters)):
            raise input_error(f"found {label(engine)}, needed an engine that can run {scenario.name}: {why}")
    return tuple(map(label, engines))


class Sample(Group):
    """Runs distributed evenly over the box of all parameters, instead of a grid."""

    method: Annotated[str, one_of("sobol", "halton")] = "sobol"
    """Low-discrepancy sequence, scrambled: sobol (a power of 2 runs is best) or halton."""
    count: Annotated[int, COUNT]
    """Number of runs."""
    seed: Annotated[int, whole_number("1", low=0)] = 0
    """Seed of the scrambling."""

    def values(self, axes: tuple[Axis, ...], where: slice) -> dict[str, Array]:
        """Return the values of the axes in some of the runs, by name, shape (n,) each."""
        from scipy.stats import qmc

        sampler = (qmc.Sobol if self.method == "sobol" else qmc.Halton)(len(axes), seed=self.seed)
        if where.start:  # SciPy cannot fast-forward by 0
            # So that any chunk can be computed alone, with the points that the whole sequence has there
            sampler.fast_forward(where.start)
        # The first by itself, as SciPy warns of a Sobol' sequence whose first points are no power of 2; docs/maps.md says so
        shares = np.concatenate([sampler.random(1), sampler.random(where.stop - where.start - 1)])
        values = {}
        for axis, share in zip(axes, shares.T, strict=True):
            low, high = axis.values
            values[axis.name] = low * (high / low) ** share if axis.logarithmic else low + (high - low) * share
        return values


_ENGINE_SCHEMA = {"anyOf": [{"type": "string"}, {"type": "array", "items": {"type": "string"}, "minItems": 1}]}


# A field without a key of its own, whose alias is in brackets, is in no file
class MapPlan(Group):
    """A map: one scenario, run again and again while one to three quantities change."""

    name: Annotated[str, in_no_file("name")]
    file: Annotated[str, in_no_file("file")]
    """Name of the file in error messages."""
    text: Annotated[str, in_no_file("text")]
    """The file's text."""
    folder: Annotated[Path | None, in_no_file("folder")]
    """Where the path of a scenario begins."""
    title: Annotated[Text, AfterValidator(lambda title: shorten(title, TITLE_LIMIT))]
    """A few words."""
    description: Text = ""
    """Question that the map answers."""
    scenario: Annotated[Scenario, DependentField(_scenario, {"type": "string"})]
    """Shipped scenario, or path of a file from this file's folder."""
    profile: Annotated[Profile, one_of(*Profile)] = Profile.QUICK
    """Profile of the engines' settings; the reference has its tolerance."""
    engines: Annotated[tuple[str, ...], DependentField(_engines, _ENGINE_SCHEMA), Field(alias="engine")] = (REFERENCE,)
    """reference, if not given, or engines and variants, whose runs take seconds each."""
    sample: Sample | None = None
    axes: Annotated[tuple[Axis, ...], AXES, Field(alias="parameters")]
    """One to three quantities, each with a range or a list of values."""
    tolerance: Annotated[float, QuantityField(QuantityKind(unit="", low=1e-15, high=1e-3, example="1e-12"))] = TOLERANCE
    """Relative tolerance of a step of the reference."""
    given_duration: Annotated[
        float | None, QuantityField(replace(QUANTITIES["duration"].kind, example="5 s")), Field(alias="duration")
    ] = None
    """Limit on the simulated time of a run; 5 s or the scenario's, whichever is longer."""
    chunk: Annotated[int | None, COUNT] = None
    """Most runs that are computed, written and resumed as one."""

    @model_validator(mode="after")
    def _check_apparatus(self) -> MapPlan:
        # One possible corner is enough: a map may reach into impossible values, whose runs it marks
        impossible = self.impossible_corners
        if len(impossible) == 2 ** len(self.axes):
            first = ", ".join(f"{axis.name} = {axis.values[0]:g}" for axis in self.axes)
            message = f"found no possible apparatus at any corner (at {first}: {impossible[0]}), needed other values"
            raise input_error(message, "parameters")
        return self

    @property
    def impossible_corners(self) -> dict[int, ParameterError]:
        """Why some corners of the box of all axes have no possible apparatus, by their index."""
        corners = np.array(list(itertools.product(*(axis.values[[0, -1]] for axis in self.axes))))
        at = {axis.name: values for axis, values in zip(self.axes, corners.T, strict=True)}
        base = self.scenario.parameters
        return impossible_runs(base, parameter_values(base, columns(base, at)), len(corners))

    @property
    def duration(self) -> float:
        """Limit on the simulated time of a run [s]."""
        return self.given_duration or max(DURATION, self.scenario.duration)

    @property
    def several(self) -> bool:
        """Whether there are several engines: results then have a first dimension for them."""
        return len(self.engines) > 1

    @property
    def sizes(self) -> dict[str, int]:
        """Dimensions of the results, and their lengths."""
        engines = {"engine": len(self.engines)} if self.several else {}
        return engines | ({"run": self.sample.count} if self.sample else {axis.name: len(axis.values) for axis in self.axes})

    @property
    def runs(self) -> int:
        """Number of runs."""
        return math.prod(self.sizes.values())

    @cached_property
    def chunk_sizes(self) -> dict[str, int]:
        """Dimensions of a chunk of the results, and their lengths: of one engine, and as many whole rows as fit."""
        usual = min(max(self.runs // len(self.engines) // CHUNKS_PER_MAP, MIN_CHUNK_RUNS), MAX_CHUNK_RUNS)
        # All chunks of a map have one shape, so that an engine among them decides, whose runs take seconds
        left = self.chunk or (usual if set(self.engines) == {REFERENCE} else ENGINE_CHUNK)
        sizes = dict.fromkeys(self.sizes, 1)
        # From the last axis, along which values are neighbours in the store
        for dim, n in reversed([(dim, n) for dim, n in self.sizes.items() if dim != "engine"]):
            sizes[dim] = max(1, min(n, left))
            left //= sizes[dim]
        return sizes

    @property
    def chunk_count(self) -> int:
        """Number of chunks."""
        return math.prod(math.ceil(self.sizes[dim] / size) for dim, size in self.chunk_sizes.items())

    def regions(self) -> Iterator[Region]:
        """Yield where each chunk is in the results; a chunk is computed, written and resumed as a whole."""
        sizes, chunks = tuple(self.sizes.values()), tuple(self.chunk_sizes.values())
        for corner in itertools.product(*(range(0, n, size) for n, size in zip(sizes, chunks, strict=True))):
            yield tuple(slice(start, min(start + size, n)) for start, size, n in zip(corner, chunks, sizes, strict=True))

    def engine(self, region: Region) -> str:
        """Return the engine that makes the runs of a chunk."""
        return self.engines[region[0].start if self.several else 0]

    def values_in(self, region: Region) -> dict[str, Array]:
        """Return the values [SI] of the varied quantities in a chunk, by name, shape (n,) each, the last axis fastest."""
        if self.sample:
            return self.sample.values(self.axes, region[-1])
        parts = [axis.values[where] for axis, where in zip(self.axes, region[-len(self.axes) :], strict=True)]
        mesh = np.meshgrid(*parts, indexing="ij")
        return {axis.name: values.ravel() for axis, values in zip(self.axes, mesh, strict=True)}

    def columns(self, region: Region) -> dict[str, Array]:
        """Return the parameters and coefficients of a chunk's runs for `solve_batch`, shape (n,) each."""
        return columns(self.scenario.parameters, self.values_in(region))


def run_count(region: Region) -> int:
    """Return the number of runs in a region."""
    return math.prod(where.stop - where.start for where in region)


def json_schema() -> dict[str, Any]:
    """Return the JSON Schema (draft 2020-12) of a map file, for editors that complete and check YAML."""
    return model_schema(MapPlan, "Looping pendulum map")


def _folder() -> Traversable:
    return resources.files("looping_pendulum.sweep") / "maps"


def shipped() -> list[str]:
    """Return the names of the maps that come with the package."""
    return loader.names_in(_folder())


def load(name_or_path: str | Path) -> MapPlan:
    """Load a shipped map by its name, or any by its path.

    Raises
    ------
    ScenarioError
        If there is no such file, or if it is faulty.
    """
    raw, file, name = loader.read_source(name_or_path, _folder(), "map")
    return load_text(raw, file=file, name=name, folder=None if name_or_path in shipped() else Path(name_or_path).parent)


def load_text(raw: bytes | str, *, file: str = "map.yaml", name: str = "map", folder: Path | None = None) -> MapPlan:
    """Load a map from YAML text; ``folder`` is where a scenario's path begins. Raises as `load`."""
    # Half characters reach the parser, which refuses them as it does in a file
    data = raw.encode("utf-8", "surrogatepass") if isinstance(raw, str) else raw
    # Without the byte order mark that some editors on Windows write
    beside = {"<file>": file, "<name>": name, "<folder>": folder, "<text>": data.decode("utf-8-sig", "replace")}
    return read_model(MapPlan, document.parse(data, file), beside)


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
        sizes = " x ".join(f"{name} {size}" for name, size in plan.sizes.items())
        message = f"{plan.file}: found {plan.runs} runs ({sizes}), needed at most {limit}"
        raise ScenarioError(f"{message}; lower a 'count', or if you mean it give --max-runs {plan.runs}")
