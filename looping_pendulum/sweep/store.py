"""The Zarr store of a map: made whole or not at all, filled unit by unit, and read back with its checksums.

Layout: Zarr version 3, one array per field of `fields.FIELDS`, dimensions named by the parameters of a grid or ``run`` of a
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

from looping_pendulum.scenarios import dump
from looping_pendulum.scenarios.document import one_line, shorten
from looping_pendulum.sweep.cells import engine_called, versions
from looping_pendulum.sweep.fields import ENDINGS, FIELDS, REFERENCE, WORDS, Values
from looping_pendulum.sweep.plan import Grid, MapError, MapPlan, Sample, WorkUnit

STORE = "map.zarr"
"""Name of the store in the output folder."""
PART = ".map.zarr.part"
"""What it is called while it is made."""
LOCK = ".lock"
METADATA = "zarr.json"
"""Where a group or an array is described."""
DESCRIPTION = ("shape", "data_type", "chunk_grid", "chunk_key_encoding", "dimension_names", "attributes")
"""What of such a description the values are read by."""
BYTES_PER_RUN = sum(np.dtype(field.dtype).itemsize for field in FIELDS)
"""Uncompressed."""


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Keep a second process out of ``folder``; the system frees the lock of a process that dies."""
    folder.mkdir(parents=True, exist_ok=True)
    try:
        import fcntl
    except ImportError:  # Windows: nobody is kept out
        yield
        return
    with (folder / LOCK).open("a") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            message = f"{folder}: found another run that is writing here, needed a folder of its own; wait for it to end"
            raise MapError(one_line(message)) from None
        yield


@contextmanager
def disk_faults(folder: Path) -> Iterator[None]:
    """Say in one line that the disk is full."""
    try:
        yield
    except OSError as error:
        if error.errno not in (errno.ENOSPC, errno.EDQUOT):
            raise
        message = f"{folder}: found a full disk ({error.strerror}), needed space for the map; what is finished is kept"
        raise MapError(one_line(f"{message}: free some, or move the folder, and run the same command again")) from None


class MapStore:
    """A map on disk."""

    def __init__(self, plan: MapPlan, folder: Path) -> None:
        self.plan, self.path = plan, folder / STORE
        group = zarr.open_group(self.path, mode="r+", use_consolidated=False)
        with zarr.config.set({"array.write_empty_chunks": True}):  # a chunk of nothing but NaN is done, too
            self._arrays: dict[str, Any] = {name: array for name, array in group.arrays()}
        self._names = [field.name for field in FIELDS]
        self._given = [axis.name for axis in plan.design.axes] if isinstance(plan.design, Sample) else []

    def missing(self) -> list[int]:
        """Units that are not there or damaged; leftovers of a process that was killed are removed."""
        for leftover in self.path.rglob("*.partial"):
            leftover.unlink(missing_ok=True)
        return [i for i in range(self.plan.units) if not self._whole(self.plan.unit(i))]

    def write(self, unit: WorkUnit, values: Values) -> None:
        """Put the results of a unit, shape (n,) each, where they belong."""
        given = self.plan.design.given(unit.region) if self._given and unit.engine == 0 else {}
        for name, content in (*given.items(), *((name, values[name]) for name in self._names)):
            self._arrays[name][self._index(name, unit)] = np.asarray(content).reshape(self._shape(name, unit))

    def _index(self, name: str, unit: WorkUnit) -> tuple[slice, ...]:
        by_engine = self.plan.several and name not in self._given
        return (slice(unit.engine, unit.engine + 1), *unit.region) if by_engine else unit.region

    def _shape(self, name: str, unit: WorkUnit) -> tuple[int, ...]:
        return tuple(where.stop - where.start for where in self._index(name, unit))

    def _whole(self, unit: WorkUnit) -> bool:
        for name in (*(self._given if unit.engine == 0 else ()), *self._names):
            array, index = self._arrays[name], self._index(name, unit)
            key = "/".join(str(where.start // size) for where, size in zip(index, array.chunks, strict=True))
            if not (self.path / name / "c" / key).is_file():
                return False
            try:
                array[index]
            except Exception:  # of whatever kind a damaged chunk raises: the unit is made again
                return False
        return True


def open_store(plan: MapPlan, folder: Path) -> MapStore:
    """Open the map in ``folder``, or begin it.

    Raises
    ------
    MapError
        If the folder holds another map or something else.
    """
    part = folder / PART
    shutil.rmtree(part, ignore_errors=True)
    if not (folder / STORE).exists():
        others = sorted(entry.name for entry in folder.iterdir() if entry.name != LOCK)
        if others:
            found = f"{folder}: found other files ({shorten(', '.join(others))}), needed an empty folder or one of this map"
            raise MapError(one_line(f"{found}; choose another with --out"))
        _create(plan, part)
        os.replace(part, folder / STORE)
    else:
        _refuse_other(plan, folder)
        _refuse_damaged(plan, folder / STORE)
        _mend_coordinates(plan, folder / STORE)
    return MapStore(plan, folder)


def attributes(plan: MapPlan) -> dict[str, Any]:
    """What the store says of itself; the same for the same map, whenever and wherever it is made."""
    packages: dict[str, str] = {}
    for engine in plan.engines:
        packages |= versions(engine, plan.profile)
    said: dict[str, Any] = {
        "title": plan.title,
        "description": plan.description,
        "map": plan.name,
        "map_id": map_id(plan),
        "map_file": plan.text,
        "map_file_sha256": hashlib.sha256(plan.text.encode()).hexdigest(),
        "scenario": plan.scenario.name,
        "scenario_file": dump(_bare(plan)),
        "engine": list(plan.engines),
        "profile": plan.profile.value,
        "tolerance": plan.tolerance,
        "duration": plan.duration,
        "versions": dict(sorted(packages.items())),
        "units": "SI",
    }
    settings = {name: vars(engine_called(name, plan.profile).settings) for name in plan.engines if name != REFERENCE}
    if settings:
        said["engine_settings"] = json.loads(json.dumps(settings, default=str))
    if isinstance(plan.design, Sample):
        said["sample"] = {"method": plan.design.method, "count": plan.design.count, "seed": plan.design.seed}
    return said


def map_id(plan: MapPlan) -> str:
    """Checksum of all that decides the results."""
    return hashlib.sha256(json.dumps(plan.as_dict(), sort_keys=True).encode()).hexdigest()


def _bare(plan: MapPlan) -> Any:
    """Return the scenario without what only a comparison of engines needs."""
    return replace(plan.scenario, tolerances=(), measured=None, inferred=())


def _refuse_other(plan: MapPlan, folder: Path) -> None:
    """Refuse a store of another map, or one begun with other versions, whose results would be mixed."""
    way_out = "choose another folder with --out, or delete this one"
    try:
        found: dict[str, Any] = dict(zarr.open_group(folder / STORE, mode="r", use_consolidated=False).attrs)
    except Exception:
        message = f"{folder / STORE}: found something that is no map, needed a map of this file; {way_out}"
        raise MapError(one_line(message)) from None
    wanted = attributes(plan)
    if found.get("map_id") != wanted["map_id"]:
        title = shorten(str(found.get("title", "?")))
        message = f"{folder}: found another map ({title!r}, or this one before a change), needed the map of {plan.file}"
        raise MapError(one_line(f"{message}; {way_out}"))
    before, now = found.get("versions", {}), wanted["versions"]
    for package in sorted({*before, *now}):
        old, new = before.get(package, "none"), now.get(package, "none")
        if old != new:
            message = f"{folder}: found a map begun with {package} {old}, and here is {new}; a map is made with one"
            raise MapError(one_line(f"{message}: install {package} {old}, or {way_out}"))


def _refuse_damaged(plan: MapPlan, path: Path) -> None:
    """Refuse a store whose description of its arrays is not what this map's is: its numbers would be read wrongly."""
    whole = zarr.storage.MemoryStore()
    _create(plan, whole)
    arrays: dict[str, Any] = dict(zarr.open_group(whole, mode="r").arrays())
    names = list(arrays)
    seen = {file: _description(path / file) for file in (METADATA, *(f"{name}/{METADATA}" for name in names))}
    together = (seen[METADATA].get("consolidated_metadata") or {}).get("metadata") or {}
    for name in names:
        wanted = json.loads(json.dumps(arrays[name].metadata.to_dict(), default=str))
        for file, found in ((f"{name}/{METADATA}", seen[f"{name}/{METADATA}"]), (METADATA, together.get(name) or {})):
            for key in _described(plan, name):
                if found.get(key) != wanted[key]:
                    what = f"{key} {shorten(json.dumps(found.get(key)))} of {name}, needed {shorten(json.dumps(wanted[key]))}"
                    raise _damaged(path / file, what)


def _described(plan: MapPlan, name: str) -> tuple[str, ...]:
    """What of an array's description must be as written; maps of an earlier version coded their coordinates otherwise."""
    coordinate = name == "engine" or (isinstance(plan.design, Grid) and name in plan.design.dims)
    return DESCRIPTION if coordinate else (*DESCRIPTION, "fill_value", "codecs")


def _description(path: Path) -> dict[str, Any]:
    """What a zarr.json says.

    Raises
    ------
    MapError
        If it is not there or damaged.
    """
    try:
        found = json.loads(path.read_bytes())
    except (OSError, ValueError, RecursionError) as error:
        raise _damaged(path, f"{type(error).__name__}: {error}") from None
    if not isinstance(found, dict):
        raise _damaged(path, "no description of an array")
    return found


def _damaged(path: Path, what: str) -> MapError:
    way_out = "restore that file from a copy, or delete the map and make it again"
    return MapError(one_line(f"{path}: found it damaged ({what}); {way_out}"))


def _mend_coordinates(plan: MapPlan, path: Path) -> None:
    """Write coordinates again that are not there, damaged or other than the map file says."""
    group: Any = zarr.open_group(path, mode="r+", use_consolidated=False)
    wanted: dict[str, Any] = {"engine": np.array(plan.engines, dtype=object)} if plan.several else {}
    wanted |= {axis.name: axis.values for axis in plan.design.axes} if isinstance(plan.design, Grid) else {}
    for name, values in wanted.items():
        try:
            whole = coordinate_file(path, name).is_file() and np.array_equal(np.asarray(group[name]), values)
        except Exception:  # of whatever kind a damaged chunk raises
            whole = False
        if not whole:
            group[name][...] = values


def coordinate_file(store: Path, name: str) -> Path:
    """The one chunk of a coordinate."""
    return store / name / "c" / "0"


def _create(plan: MapPlan, path: Path | zarr.storage.MemoryStore) -> None:
    """Write all but the results."""
    group = zarr.open_group(path, mode="w", zarr_format=3, attributes=attributes(plan))
    dims, shape, chunks = plan.design.dims, plan.design.shape, plan.chunk_shape
    aside = {}
    for axis in plan.design.axes:
        said = {"long_name": axis.meaning, "units": axis.unit or "1", "written_units": axis.written or "1"}
        if isinstance(plan.design, Grid):
            _whole_array(group, axis.name, axis.values, said)
        else:
            _empty_array(group, axis.name, "float64", float("nan"), shape, chunks, dims, said)
            aside = {"coordinates": " ".join(a.name for a in plan.design.axes)}
    if plan.several:
        _whole_array(group, "engine", np.array(plan.engines, dtype=object), {"long_name": "engine and variant"}, dtype=str)
        dims, shape, chunks = ("engine", *dims), (len(plan.engines), *shape), (1, *chunks)
    for field in FIELDS:
        said = {"long_name": field.meaning, "units": field.unit or "1"} | aside
        if field.name == "end":
            said |= {"flag_values": list(range(len(ENDINGS))), "flag_meanings": " ".join(ENDINGS)}  # type: ignore[dict-item]
            said["flag_words"] = [WORDS[name] for name in ENDINGS]  # type: ignore[assignment]
        _empty_array(group, field.name, field.dtype, field.fill, shape, chunks, dims, said)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that other programs may not know consolidated metadata yet; they need not
        zarr.consolidate_metadata(path)


def _empty_array(
    group: Any,
    name: str,
    dtype: str,
    fill: float,
    shape: tuple[int, ...],
    chunks: tuple[int, ...],
    dims: tuple[str, ...],
    said: dict[str, Any],
) -> None:
    group.create_array(
        name,
        shape=shape,
        chunks=chunks,
        dtype=dtype,
        fill_value=fill,
        dimension_names=dims,
        attributes=said,
        compressors=[ZstdCodec(level=3, checksum=True)],
    )


def _whole_array(group: Any, name: str, values: Any, said: dict[str, Any], dtype: Any = "float64") -> None:
    """Write a coordinate."""
    array = group.create_array(
        name,
        shape=values.shape,
        chunks=values.shape,
        dtype=dtype,
        fill_value="" if dtype is str else float("nan"),  # of a lost chunk: zarr's own 0 would pass for a value
        dimension_names=(name,),
        attributes=said,
        compressors=[ZstdCodec(level=3, checksum=True)],
    )
    array[...] = values
