"""Plan of a map: its axes, its runs, and how these are cut into chunks. Everything follows from the index of a run."""

from __future__ import annotations

import itertools
import math
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from looping_pendulum.engines.protocol import Profile
from looping_pendulum.errors import HarnessError, ParameterError
from looping_pendulum.reference_ode.geometry import Array
from looping_pendulum.reference_ode.parameters import Parameters
from looping_pendulum.scenarios.scenario import Scenario
from looping_pendulum.sweep.cells import REFERENCE
from looping_pendulum.sweep.quantities import columns

MIN_CHUNK_RUNS, MAX_CHUNK_RUNS, CHUNKS_PER_MAP = 256, 65536, 16
"""Bounds on the runs per chunk, and chunks per map, where the map file does not give the size of a chunk.

A batch costs 0.04 s and 25 us per run, and writing a chunk 0.03 s.
"""
ENGINE_CHUNK = 4
"""Runs per chunk of engines, whose runs take seconds."""


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

    def as_dict(self) -> dict[str, Any]:
        """Return what determines the values as plain data, the same on every processor.

        Logarithmic values are powers, whose last bits depend on the processor; so only their ends and their number are given.
        """
        ends = [float(self.values[0]), float(self.values[-1]), len(self.values)]
        return {
            "name": self.name,
            "logarithmic": self.logarithmic,
            "values": ends if self.logarithmic else self.values.tolist(),
        }


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

    def values_in(self, region: tuple[slice, ...]) -> dict[str, Array]:
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

    def values_in(self, region: tuple[slice, ...]) -> dict[str, Array]:
        """Return the values of the varied quantities in a region, by name, shape (n,) each."""
        from scipy.stats import qmc

        start, stop = region[0].start, region[0].stop
        sampler = (qmc.Sobol if self.method == "sobol" else qmc.Halton)(len(self.axes), seed=self.seed)
        with warnings.catch_warnings():
            warnings.simplefilter(
                "ignore", UserWarning
            )  # Sobol' sequences are balanced only for powers of 2; the docs of maps say so
            if start:  # SciPy cannot fast-forward by 0
                # So that any chunk can be computed alone, with the points that the whole sequence has there
                sampler.fast_forward(start)
            shares = sampler.random(stop - start)
        return {axis.name: axis.interpolate(shares[:, i]) for i, axis in enumerate(self.axes)}


@dataclass(frozen=True, kw_only=True)
class WorkUnit:
    """Unit of work: one engine on one chunk, which is computed, written and resumed as a whole."""

    index: int
    engine: int
    region: tuple[slice, ...]
    """Slices of the design's dimensions."""

    @property
    def runs(self) -> int:
        """Number of runs."""
        return math.prod(where.stop - where.start for where in self.region)


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
    several: bool
    """Whether the file gave a list of engines: results then have a dimension for them."""
    profile: Profile
    design: Grid | Sample
    tolerance: float
    """Relative tolerance of a step of the reference."""
    duration: float
    """Limit on the simulated time of a run [s]."""
    chunk: int | None = None
    """Most runs in a chunk; None: by the size of the map."""

    @property
    def cells(self) -> int:
        """Runs of one engine."""
        return math.prod(self.design.shape)

    @property
    def runs(self) -> int:
        """Runs of all engines."""
        return self.cells * len(self.engines)

    @cached_property
    def chunk_shape(self) -> tuple[int, ...]:
        """Shape of a chunk in the design's dimensions, with as many whole rows as fit."""
        # All chunks of a map have one shape, so that an engine among them decides, whose runs take seconds
        usual = min(max(self.cells // CHUNKS_PER_MAP, MIN_CHUNK_RUNS), MAX_CHUNK_RUNS)
        left = self.chunk or (usual if set(self.engines) == {REFERENCE} else ENGINE_CHUNK)
        shape: list[int] = []
        # From the last axis, along which values are neighbours in the store
        for n in reversed(self.design.shape):
            shape.insert(0, max(1, min(n, left)))
            left //= shape[0]
        return tuple(shape)

    @cached_property
    def blocks(self) -> tuple[int, ...]:
        """Number of chunks along each of the design's dimensions."""
        # Division that rounds up: the last chunk may be smaller
        return tuple(-(-n // size) for n, size in zip(self.design.shape, self.chunk_shape, strict=True))

    @property
    def units(self) -> int:
        """Number of units of work."""
        return math.prod(self.blocks) * len(self.engines)

    def unit(self, index: int) -> WorkUnit:
        """Return the unit of work with this index; the engine is the slowest index."""
        engine, *block = np.unravel_index(index, (len(self.engines), *self.blocks))
        region = tuple(
            slice(int(b) * size, min((int(b) + 1) * size, n))
            for b, size, n in zip(block, self.chunk_shape, self.design.shape, strict=True)
        )
        return WorkUnit(index=index, engine=int(engine), region=region)

    def columns(self, unit: WorkUnit) -> dict[str, Array]:
        """Return the parameters and coefficients of a unit's runs for `solve_batch`, shape (n,) each."""
        return columns(self.scenario.parameters, self.design.values_in(unit.region))

    def corners(self) -> Iterator[tuple[str, ParameterError | None]]:
        """Yield the corners of the box of all axes, in words, each with why its apparatus is impossible, or None."""
        base: Parameters = self.scenario.parameters
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

    def as_dict(self) -> dict[str, Any]:
        """Return all that determines the results as plain data."""
        design: dict[str, Any] = {"axes": [axis.as_dict() for axis in self.design.axes]}
        if isinstance(self.design, Sample):
            design |= {"method": self.design.method, "count": self.design.count, "seed": self.design.seed}
        return {
            "parameters": self.scenario.parameters.as_dict(),
            "design": design,
            "engines": list(self.engines),
            "several": self.several,
            "profile": self.profile.value,
            "tolerance": self.tolerance,
            "duration": self.duration,
            # It does not change values, but a store has chunks of one shape, so that a map cannot go on with another
            "chunk": list(self.chunk_shape),
        }
