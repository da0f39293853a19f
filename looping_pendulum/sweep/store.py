"""The Zarr store of a map: created as a whole, filled unit by unit, and read back with checksums.

Layout: Zarr version 3, one array per field of `cells.FIELDS`, dimensions named by the parameters of a grid or ``run`` of a
sample (and first ``engine``, where the map file lists several), so that `xarray.open_zarr` opens it. Zarr writes each chunk
under a temporary name and renames it, and Zstandard's checksum tells a damaged one.
"""

from __future__ import annotations

import errno
import hashlib
import json
import os
import shutil
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import zarr
import zarr.storage
from zarr.codecs import ZstdCodec

from looping_pendulum.files import LockedError, locked
from looping_pendulum.scenarios import dump
from looping_pendulum.scenarios.document import one_line, shorten
from looping_pendulum.sweep.cells import (
    ENDING_DESCRIPTIONS,
    ENDINGS,
    FIELDS,
    REFERENCE,
    Values,
    differing_versions,
    engine_called,
    versions,
)
from looping_pendulum.sweep.plan import Grid, MapError, MapPlan, Sample, WorkUnit

STORE = "map.zarr"
"""Name of the store in the output folder."""
PART = ".map.zarr.part"
"""Name of the store while it is created."""
LOCK = ".lock"
"""Name of the file that keeps a second process out of the output folder."""
METADATA = "zarr.json"
"""Name of the file that describes a group or an array."""
DESCRIPTION = (
    "shape", "data_type", "chunk_grid", "chunk_key_encoding", "dimension_names", "attributes", "fill_value", "codecs",
)  # fmt: skip
"""Keys of such a description that determine how the values are read."""
BYTES_PER_RUN = sum(np.dtype(field.dtype).itemsize for field in FIELDS)
"""Uncompressed size of a run's values."""


@contextmanager
def claimed(folder: Path) -> Iterator[None]:
    """Keep a second process out of ``folder``; turn the exception of a full disk into a `MapError` of one line."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with locked(folder / LOCK, wait=False):
            yield
    except LockedError:
        message = f"{folder}: found another run that is writing here, needed a folder of its own; wait for it to end"
        raise MapError(one_line(message)) from None
    except OSError as error:
        if error.errno not in (errno.ENOSPC, errno.EDQUOT):
            raise
        message = f"{folder}: found a full disk ({error.strerror}), needed space for the map; what is finished is kept"
        raise MapError(one_line(f"{message}: free some, or move the folder, and run the same command again")) from None


class MapStore:
    """A map on disk, open for writing."""

    def __init__(self, plan: MapPlan, folder: Path) -> None:
        self.plan, self.path = plan, folder / STORE
        # By the arrays' own descriptions, not by the copies of them that the group's may have
        group = zarr.open_group(self.path, mode="r+", use_consolidated=False)
        with zarr.config.set({"array.write_empty_chunks": True}):  # a chunk of nothing but NaN must exist to count as computed
            self._arrays: dict[str, Any] = {name: array for name, array in group.arrays()}
        self._varied = [axis.name for axis in plan.design.axes] if isinstance(plan.design, Sample) else []

    def missing(self) -> list[int]:
        """Return the units that are missing or damaged; remove temporary files that a killed process left."""
        for leftover in self.path.rglob("*.partial"):
            leftover.unlink(missing_ok=True)
        return [i for i in range(self.plan.units) if not self._is_complete(self.plan.unit(i))]

    def write(self, unit: WorkUnit, values: Values) -> None:
        """Write the results of a unit, shape (n,) each."""
        # All engines of a sample share the values of its runs, so one of them writes these
        given = self.plan.design.values_in(unit.region) if self._varied and unit.engine == 0 else {}
        for name, content in (given | values).items():
            index = self._index(name, unit)
            shape = tuple(where.stop - where.start for where in index)
            self._arrays[name][index] = np.asarray(content).reshape(shape)

    def _index(self, name: str, unit: WorkUnit) -> tuple[slice, ...]:
        by_engine = self.plan.several and name not in self._varied
        return (slice(unit.engine, unit.engine + 1), *unit.region) if by_engine else unit.region

    def _is_complete(self, unit: WorkUnit) -> bool:
        for name in (*(self._varied if unit.engine == 0 else ()), *(field.name for field in FIELDS)):
            array, index = self._arrays[name], self._index(name, unit)
            key = "/".join(str(where.start // size) for where, size in zip(index, array.chunks, strict=True))
            if not (self.path / name / "c" / key).is_file():
                return False
            try:
                # Reading is what tests the checksum
                array[index]
            except Exception:  # a damaged chunk may raise any exception; the unit is computed again
                return False
        return True


def open_store(plan: MapPlan, folder: Path) -> MapStore:
    """Open the map in ``folder``, or create it.

    Raises
    ------
    MapError
        If the folder holds another map or something else.
    """
    part = folder / PART
    # A process that was killed may have left half of a store
    shutil.rmtree(part, ignore_errors=True)
    if not (folder / STORE).exists():
        others = sorted(entry.name for entry in folder.iterdir() if entry.name != LOCK)
        if others:
            message = f"{folder}: found other files ({shorten(', '.join(others))}), needed an empty folder or one of this map"
            raise MapError(one_line(f"{message}; choose another with --out"))
        _create(plan, part)
        # The store appears as a whole or not at all, so that one that exists can be gone on with
        os.replace(part, folder / STORE)
    else:
        _refuse_other(plan, folder)
        _refuse_damaged(plan, folder / STORE)
        _repair_coordinates(plan, folder / STORE)
    return MapStore(plan, folder)


def attributes(plan: MapPlan) -> dict[str, Any]:
    """Return the attributes of the store; they are the same for the same map, whenever and wherever it is made."""
    packages: dict[str, str] = {}
    for engine in plan.engines:
        packages |= versions(engine, plan.profile)
    metadata: dict[str, Any] = {
        "title": plan.title,
        "description": plan.description,
        "map": plan.name,
        "map_id": map_id(plan),
        "map_file": plan.text,
        "map_file_sha256": hashlib.sha256(plan.text.encode()).hexdigest(),
        "scenario": plan.scenario.name,
        # Without tolerances and measurements, which only a comparison of engines needs
        "scenario_file": dump(replace(plan.scenario, tolerances=(), measured=None, inferred=())),
        "engine": list(plan.engines),
        "profile": plan.profile.value,
        "tolerance": plan.tolerance,
        "duration": plan.duration,
        "versions": dict(sorted(packages.items())),
        "units": "SI",
    }
    settings = {name: vars(engine_called(name, plan.profile).settings) for name in plan.engines if name != REFERENCE}
    if settings:
        # Through JSON, which turns what Zarr's attributes cannot hold into text
        metadata["engine_settings"] = json.loads(json.dumps(settings, default=str))
    if isinstance(plan.design, Sample):
        metadata["sample"] = {"method": plan.design.method, "count": plan.design.count, "seed": plan.design.seed}
    return metadata


def map_id(plan: MapPlan) -> str:
    """Return the checksum of all that determines the results."""
    return hashlib.sha256(json.dumps(plan.as_dict(), sort_keys=True).encode()).hexdigest()


def _refuse_other(plan: MapPlan, folder: Path) -> None:
    """Refuse a store of another map, or one begun with other versions of packages: the results would be mixed."""
    way_out = "choose another folder with --out, or delete this one"
    try:
        stored: dict[str, Any] = dict(zarr.open_group(folder / STORE, mode="r", use_consolidated=False).attrs)
    except Exception:
        message = f"{folder / STORE}: found something that is no map, needed a map of this file; {way_out}"
        raise MapError(one_line(message)) from None
    wanted = attributes(plan)
    if stored.get("map_id") != wanted["map_id"]:
        title = shorten(str(stored.get("title", "?")))
        message = f"{folder}: found another map ({title!r}, or this one before a change), needed the map of {plan.file}"
        raise MapError(one_line(f"{message}; {way_out}"))
    for package, old, new in differing_versions(stored.get("versions", {}), wanted["versions"]):
        message = f"{folder}: found a map begun with {package} {old}, and here is {new}; a map is made with one"
        raise MapError(one_line(f"{message}: install {package} {old}, or {way_out}"))


def _refuse_damaged(plan: MapPlan, path: Path) -> None:
    """Refuse a store whose description of its arrays differs from this map's: its values would be read wrongly."""
    # Zarr itself says what the description must be, by creating the same store in memory
    whole = zarr.storage.MemoryStore()
    _create(plan, whole)
    arrays: dict[str, Any] = dict(zarr.open_group(whole, mode="r").arrays())
    consolidated = (_description(path / METADATA).get("consolidated_metadata") or {}).get("metadata") or {}
    for name, array in arrays.items():
        wanted = json.loads(json.dumps(array.metadata.to_dict(), default=str))
        own = path / name / METADATA
        for file, description in ((own, _description(own)), (path / METADATA, consolidated.get(name) or {})):
            for key in DESCRIPTION:
                if (actual := description.get(key)) != wanted[key]:
                    what = f"{key} {shorten(json.dumps(actual))} of {name}, needed {shorten(json.dumps(wanted[key]))}"
                    raise _damaged(file, what)


def _description(path: Path) -> dict[str, Any]:
    """Read a zarr.json.

    Raises
    ------
    MapError
        If the file is missing or damaged.
    """
    try:
        description = json.loads(path.read_bytes())
    except (OSError, ValueError, RecursionError) as error:
        raise _damaged(path, f"{type(error).__name__}: {error}") from None
    if not isinstance(description, dict):
        raise _damaged(path, "no description of an array")
    return description


def _damaged(path: Path, what: str) -> MapError:
    way_out = "restore that file from a copy, or delete the map and make it again"
    return MapError(one_line(f"{path}: found it damaged ({what}); {way_out}"))


def _repair_coordinates(plan: MapPlan, path: Path) -> None:
    """Write again the coordinates that are missing, damaged, or different from the map file's."""
    group: Any = zarr.open_group(path, mode="r+", use_consolidated=False)
    coordinates: dict[str, Any] = {"engine": np.array(plan.engines, dtype=object)} if plan.several else {}
    coordinates |= {axis.name: axis.values for axis in plan.design.axes} if isinstance(plan.design, Grid) else {}
    for name, values in coordinates.items():
        try:
            intact = coordinate_file(path, name).is_file() and np.array_equal(np.asarray(group[name]), values)
        except Exception:  # a damaged chunk may raise any exception
            intact = False
        if not intact:
            group[name][...] = values


def coordinate_file(store: Path, name: str) -> Path:
    """Return the file of a coordinate's only chunk."""
    return store / name / "c" / "0"


def _create(plan: MapPlan, path: Path | zarr.storage.MemoryStore) -> None:
    """Create the store with everything but the results."""
    group = zarr.open_group(path, mode="w", zarr_format=3, attributes=attributes(plan))
    dims, shape, chunks = plan.design.dims, plan.design.shape, plan.chunk_shape
    compressors = [ZstdCodec(level=3, checksum=True)]

    def coordinate(name: str, values: Any, attrs: dict[str, Any], dtype: Any = "float64") -> None:
        # The value of a lost chunk: zarr's default of 0 would look like a coordinate
        fill: Any = "" if dtype is str else float("nan")
        whole: dict[str, Any] = {"shape": values.shape, "chunks": values.shape, "dtype": dtype, "fill_value": fill}
        array = group.create_array(name, **whole, dimension_names=(name,), attributes=attrs, compressors=compressors)
        array[...] = values

    def results(name: str, dtype: str, fill: float, attrs: dict[str, Any]) -> None:
        empty: dict[str, Any] = {"shape": shape, "chunks": chunks, "dtype": dtype, "fill_value": fill}
        group.create_array(name, **empty, dimension_names=dims, attributes=attrs, compressors=compressors)

    coordinates = {}
    for axis in plan.design.axes:
        attrs = {"long_name": axis.meaning, "units": axis.unit or "1", "written_units": axis.written or "1"}
        if isinstance(plan.design, Grid):
            coordinate(axis.name, axis.values, attrs)
        else:
            results(axis.name, "float64", float("nan"), attrs)
            coordinates = {"coordinates": " ".join(a.name for a in plan.design.axes)}
    if plan.several:
        coordinate("engine", np.array(plan.engines, dtype=object), {"long_name": "engine and variant"}, dtype=str)
        # A chunk belongs to one engine, since it is computed and written as one unit
        dims, shape, chunks = ("engine", *dims), (len(plan.engines), *shape), (1, *chunks)
    for field in FIELDS:
        of_field: dict[str, Any] = {"long_name": field.meaning, "units": field.unit or "1", **coordinates}
        if field.name == "end":
            endings = {"flag_values": list(range(len(ENDINGS))), "flag_meanings": " ".join(ENDINGS)}
            of_field |= endings | {"flag_words": [ENDING_DESCRIPTIONS[name] for name in ENDINGS]}
        results(field.name, field.dtype, field.fill, of_field)
    with warnings.catch_warnings():
        # Zarr warns that consolidated metadata is not in the standard yet; readers work without it
        warnings.simplefilter("ignore")
        zarr.consolidate_metadata(path)
