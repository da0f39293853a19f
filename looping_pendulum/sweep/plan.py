"""Plan of a map: its axes, its runs, and how these are cut into chunks."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from looping_pendulum.engines.protocol import Profile
from looping_pendulum.errors import HarnessError, ParameterError
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.scenarios.scenario import Scenario
from looping_pendulum.sweep.quantities import columns

REFERENCE = "reference"
"""Name of the exact model among the engines of a map."""
MIN_CHUNK_RUNS, MAX_CHUNK_RUNS, CHUNKS_PER_MAP = 1024, 65536, 64
"""Bounds on the runs per chunk, and chunks per map, where the map file does not give the size of a chunk.

Writing a chunk takes as long as a few hundred runs.
"""
ENGINE_CHUNK = 4
"""Runs per chunk of engines, whose runs take seconds."""

Region = tuple[slice, ...]
"""Slices of a map's dimensions."""


def run_count(region: Region) -> int:
    """Return the number of runs in a region."""
    return math.prod(where.stop - where.start for where in region)


class MapError(HarnessError, ValueError):
    """A map cannot be made, or not here."""


@dataclass(frozen=True, kw_only=True)
class Axis:
    """A varied quantity of a map."""

    name: str
    unit: str
    """SI unit, as pint reads it; '' for a plain number."""
    written: str
    """Unit in which the map file writes it, used for figures."""
    scale: float
    """Size of the unit ``written`` in SI units."""
    meaning: str
    values: Array
    """Grid: every value [SI], ascending, shape (n,). Sample: lowest and highest value [SI], shape (2,)."""
    logarithmic: bool = False

    def interpolate(self, share: Array) -> Array:
        """Return the values [SI] at ``share``, 0 to 1, of the way from the lowest to the highest."""
        low, high = float(self.values[0]), float(self.values[-1])
        if self.logarithmic:
            return np.asarray(low * (high / low) ** share)
        return np.asarray(low + (high - low) * share)


@dataclass(frozen=True, kw_only=True)
class Grid:
    """Grid: every combination of the axes' values."""

    axes: tuple[Axis, ...]

    @property
    def dims(self) -> tuple[str, ...]:
        """Names of the dimensions."""
        return tuple(axis.name for axis in self.axes)

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of values of each axis."""
        return tuple(len(axis.values) for axis in self.axes)

    def values_in(self, region: Region) -> dict[str, Array]:
        """Return the values of the varied quantities in a region, by name, shape (n,) each, the last axis fastest."""
        parts = [axis.values[where] for axis, where in zip(self.axes, region, strict=True)]
        mesh = np.meshgrid(*parts, indexing="ij")
        return {axis.name: values.ravel() for axis, values in zip(self.axes, mesh, strict=True)}


@dataclass(frozen=True, kw_only=True)
class Sample:
    """Sample: runs distributed evenly over the box of the axes (a low-discrepancy sequence)."""

    axes: tuple[Axis, ...]
    method: str
    """"sobol" or "halton"."""
    count: int
    seed: int

    dims = ("run",)

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of runs."""
        return (self.count,)

    def values_in(self, region: Region) -> dict[str, Array]:
        """Return the values of the varied quantities in a region, by name, shape (n,) each."""
        from scipy.stats import qmc

        start, stop = region[0].start, region[0].stop
        sampler = (qmc.Sobol if self.method == "sobol" else qmc.Halton)(len(self.axes), seed=self.seed)
        if start:  # SciPy cannot fast-forward by 0
            # So that any chunk can be computed alone, with the points that the whole sequence has there
            sampler.fast_forward(start)
        # The first by itself, as SciPy warns of a Sobol' sequence whose first points are no power of 2; docs/maps.md says so
        shares = np.concatenate([sampler.random(1), sampler.random(stop - start - 1)])
        return {axis.name: axis.interpolate(shares[:, i]) for i, axis in enumerate(self.axes)}


@dataclass(frozen=True, kw_only=True)
class MapPlan:
    """A checked map file."""

    name: str
    file: str
    """Name of the file in error messages."""
    text: str
    """The file's text."""
    title: str
    description: str
    scenario: Scenario
    engines: tuple[str, ...]
    """Labels, "mujoco:capstan"; `REFERENCE` for the exact model."""
    profile: Profile
    design: Grid | Sample
    tolerance: float
    """Relative tolerance of a step of the reference."""
    duration: float
    """Limit on the simulated time of a run [s]."""
    chunk: int | None = None
    """Most runs in a chunk; None: by the size of the map."""

    @property
    def several(self) -> bool:
        """Whether there are several engines: results then have a first dimension for them."""
        return len(self.engines) > 1

    @property
    def dims(self) -> tuple[str, ...]:
        """Names of the dimensions of the results."""
        return ("engine", *self.design.dims) if self.several else self.design.dims

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the results."""
        return (len(self.engines), *self.design.shape) if self.several else self.design.shape

    @property
    def runs(self) -> int:
        """Number of runs."""
        return math.prod(self.shape)

    @cached_property
    def chunk_shape(self) -> tuple[int, ...]:
        """Shape of a chunk of the results: of one engine, and as many whole rows as fit."""
        usual = min(max(math.prod(self.design.shape) // CHUNKS_PER_MAP, MIN_CHUNK_RUNS), MAX_CHUNK_RUNS)
        # All chunks of a map have one shape, so that an engine among them decides, whose runs take seconds
        left = self.chunk or (usual if set(self.engines) == {REFERENCE} else ENGINE_CHUNK)
        shape: list[int] = []
        # From the last axis, along which values are neighbours in the store
        for n in reversed(self.design.shape):
            shape.insert(0, max(1, min(n, left)))
            left //= shape[0]
        return (1, *shape) if self.several else tuple(shape)

    @property
    def chunk_count(self) -> int:
        """Number of chunks."""
        return math.prod(math.ceil(n / size) for n, size in zip(self.shape, self.chunk_shape, strict=True))

    def regions(self) -> Iterator[Region]:
        """Yield where each chunk is in the results; a chunk is computed, written and resumed as a whole."""
        starts = [range(0, n, size) for n, size in zip(self.shape, self.chunk_shape, strict=True)]
        for corner in itertools.product(*starts):
            yield tuple(
                slice(start, min(start + size, n)) for start, size, n in zip(corner, self.chunk_shape, self.shape, strict=True)
            )

    def engine(self, region: Region) -> str:
        """Return the engine that makes the runs of a chunk."""
        return self.engines[region[0].start if self.several else 0]

    def values_in(self, region: Region) -> dict[str, Array]:
        """Return the values [SI] of the varied quantities in a chunk, by name, shape (n,) each."""
        return self.design.values_in(region[1:] if self.several else region)

    def columns(self, region: Region) -> dict[str, Array]:
        """Return the parameters and coefficients of a chunk's runs for `solve_batch`, shape (n,) each."""
        return columns(self.scenario.parameters, self.values_in(region))

    def corners(self) -> Iterator[tuple[str, ParameterError | None]]:
        """Yield the corners of the box of all axes, in words, each with why its apparatus is impossible, or None."""
        base = self.scenario.parameters
        for ends in itertools.product((0, -1), repeat=len(self.design.axes)):
            at = {axis.name: axis.values[[end]] for axis, end in zip(self.design.axes, ends, strict=True)}
            words = ", ".join(f"{name} = {values[0]:g}" for name, values in at.items())
            try:
                # `Parameters` checks itself when it is made; a batch does not
                base.replace(**{name: float(values[0]) for name, values in columns(base, at).items()})
            except ParameterError as error:
                yield words, error
            else:
                yield words, None
