"""The Zarr store of a map: created as a whole, filled chunk by chunk, and read back with checksums.

Layout: Zarr version 3, one array per field of `cells.FIELDS`, dimensions named by the parameters of a grid or ``run`` of a
sample (and first ``engine``, where the map file lists several), so that `xarray.open_zarr` opens it. Zarr writes each file
under a temporary name and renames it, and Zstandard's checksum tells a damaged one.
"""

from __future__ import annotations

import errno
import hashlib
import json
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from filelock import FileLock, Timeout
from numpy.typing import NDArray

from looping_pendulum.engines.registry import label, select
from looping_pendulum.errors import shorten
from looping_pendulum.files import write_atomically
from looping_pendulum.scenarios import dump
from looping_pendulum.sweep.cells import ENDING_DESCRIPTIONS, ENDINGS, FIELDS, NOT_YET_RUN, Values, differing_versions, versions
from looping_pendulum.sweep.map_file import REFERENCE, MapError, MapPlan, Region

if TYPE_CHECKING:
    import xarray

STORE = "map.zarr"
"""Name of the store in the output folder."""
LOCK = ".lock"
"""Name of the file that keeps a second process out of the output folder."""
METADATA = "zarr.json"
"""Name of the file that describes a group."""
NewArray = tuple[tuple[str, ...], NDArray[Any], dict[str, Any]]
"""Dimensions, values and attributes of an array of a store."""
BYTES_PER_RUN = sum(np.dtype(field.kind).itemsize for field in FIELDS.values())
"""Uncompressed size of a run's values."""


@contextmanager
def claimed(folder: Path) -> Iterator[None]:
    """Keep a second process out of ``folder``; turn the exception of a full disk into a `MapError` of one line."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        # The system frees the lock of a process that dies
        with FileLock(folder / LOCK, timeout=0):
            yield
    except Timeout:
        needed = "a folder of its own; wait for it to end"
        raise MapError(f"{folder}: found another run that is writing here, needed {needed}") from None
    except OSError as error:
        if error.errno not in (errno.ENOSPC, errno.EDQUOT):
            raise
        way_out = "what is finished is kept: free some, or move the folder, and run the same command again"
        raise MapError(f"{folder}: found a full disk ({error.strerror}), needed space for the map; {way_out}") from None


class MapStore:
    """A map on disk, open for reading and writing.

    Raises
    ------
    MapError
        If the folder holds another map or something else.
    """

    def __init__(self, plan: MapPlan, folder: Path) -> None:
        import zarr  # not at the top: reading a map file takes a third of a second less

        self.plan, self.path, self.attributes = plan, folder / STORE, attributes(plan)
        if (self.path / METADATA).exists():
            self._refuse_other(folder)
        else:
            _refuse_other_files(folder)
        # Written again each time, which restores what was lost or damaged. The group's own comes first: with it the map exists
        for key, content in sorted(self._files_without_results().items(), key=lambda item: item[0] != METADATA):
            write_atomically(self.path / key, content)
        # By the arrays' own descriptions, not by the copies of them that the group's has
        self._arrays: dict[str, Any] = dict(zarr.open_group(self.path, mode="r+", use_consolidated=False).arrays())

    def missing(self) -> list[Region]:
        """Return the chunks that are not computed yet, or damaged; remove temporary files that a killed process left."""
        for leftover in self.path.rglob("*.partial"):
            leftover.unlink()
        return [region for region in self.plan.regions() if not self._is_complete(region)]

    def _is_complete(self, region: Region) -> bool:
        try:
            return bool(np.all(self.read(region)["end"] != NOT_YET_RUN))
        except Exception:  # a damaged chunk may raise any exception
            return False

    def read(self, region: Region) -> Values:
        """Return the results of a chunk, shape (n,) each."""
        return {name: np.asarray(self._arrays[name][region]).ravel() for name in FIELDS}

    def write(self, region: Region, values: Values) -> None:
        """Write the results of a chunk, shape (n,) each."""
        if self.plan.sample:
            for name, given in self.plan.values_in(region).items():
                self._arrays[name][region[-1]] = given
        # The end comes last: it says that the chunk is there as a whole
        for name in sorted(values, key="end".__eq__):
            self._arrays[name][region] = values[name].reshape([where.stop - where.start for where in region])

    def _refuse_other(self, folder: Path) -> None:
        """Refuse a store of another map, or one begun with other versions of packages: the results would be mixed."""
        way_out = "choose another folder with --out, or delete this one"
        try:
            stored = dict(json.loads((self.path / METADATA).read_bytes())["attributes"])
        except Exception:
            raise MapError(f"{self.path}: found something that is no map, needed a map of this file; {way_out}") from None
        if stored.get("map_id") != self.attributes["map_id"]:
            found = f"found another map ({shorten(str(stored.get('title', '?')))!r}, or this one before a change)"
            raise MapError(f"{folder}: {found}, needed the map of {self.plan.file}; {way_out}")
        for package, old, new in differing_versions(stored.get("versions", {}), self.attributes["versions"]):
            found = f"found a map begun with {package} {old}, and here is {new}; a map is made with one"
            raise MapError(f"{folder}: {found}: install {package} {old}, or {way_out}")

    def _files_without_results(self) -> dict[str, bytes]:
        """Return name -> content of a store's files before there are results, the same whenever and wherever it is made."""
        import zarr
        from zarr.codecs import ZstdCodec
        from zarr.storage import MemoryStore

        files: dict[str, Any] = {}
        group = zarr.create_group(MemoryStore(files), attributes=self.attributes)
        for name, (dims, values, attrs) in _layout(self.plan).items():
            is_whole = dims == (name,)
            # The value of a lost chunk: Zarr's default of 0 would look like a coordinate
            fill = values.flat[0] if not is_whole else "" if name == "engine" else np.nan
            group.create_array(
                name,
                data=values,
                write_data=is_whole,
                chunks=values.shape if is_whole else tuple(self.plan.chunk_sizes[dim] for dim in dims),
                fill_value=fill,
                compressors=[ZstdCodec(level=3, checksum=True)],
                attributes=attrs,
                dimension_names=dims,
            )
        with warnings.catch_warnings():
            # Zarr warns that consolidated metadata is not in the standard yet; without it xarray warns
            warnings.simplefilter("ignore")
            zarr.consolidate_metadata(group.store)
        return {name: content.to_bytes() for name, content in files.items()}


def _layout(plan: MapPlan) -> dict[str, NewArray]:
    """Return the arrays of a map by name, with the values of coordinates, and of the others how they are before any run."""
    beside = {"coordinates": " ".join(axis.name for axis in plan.axes)} if plan.sample else {}
    arrays: dict[str, NewArray] = {}
    for name, field in FIELDS.items():
        # One value, whatever the size of the map
        values = np.broadcast_to(np.array(field.missing, field.kind), tuple(plan.sizes.values()))
        arrays[name] = (tuple(plan.sizes), values, {"long_name": field.meaning, "units": field.unit or "1", **beside})
    arrays["end"][2].update(
        flag_values=list(range(len(ENDINGS))),
        flag_meanings=" ".join(ENDINGS),
        flag_words=list(ENDING_DESCRIPTIONS.values()),
    )
    for axis in plan.axes:
        units = {"units": axis.quantity.kind.unit or "1", "written_units": axis.written or "1"}
        values = np.broadcast_to(np.nan, plan.sample.count) if plan.sample else axis.values
        arrays[axis.name] = ("run" if plan.sample else axis.name,), values, {"long_name": axis.quantity.meaning, **units}
    if plan.several:
        names = np.array(plan.engines, dtype=np.dtypes.StringDType())
        arrays["engine"] = ("engine",), names, {"long_name": "engine and variant"}
    return arrays


def _refuse_other_files(folder: Path) -> None:
    others = sorted(entry.name for entry in folder.iterdir() if entry.name not in (LOCK, STORE))
    # A process that was killed may have left a store that was hardly begun, with nothing but a temporary file
    if others or any((folder / STORE).glob("[!.]*")):
        found = shorten(", ".join(others or [STORE]))
        needed = "an empty folder or one of this map; choose another with --out"
        raise MapError(f"{folder}: found other files ({found}), needed {needed}")


def attributes(plan: MapPlan) -> dict[str, Any]:
    """Return the attributes of the store; they are the same for the same map, whenever and wherever it is made."""
    engines = select((name for name in plan.engines if name != REFERENCE), plan.profile)
    decisive = {
        "engine": list(plan.engines),
        "profile": plan.profile.value,
        "tolerance": plan.tolerance,
        "duration": plan.duration,
        "sample": plan.sample and plan.sample.model_dump(),
    }
    return {
        "title": plan.title,
        "description": plan.description,
        "map": plan.name,
        "map_id": _checksum(plan, decisive),
        "map_file": plan.text,
        "map_file_sha256": hashlib.sha256(plan.text.encode()).hexdigest(),
        "scenario": plan.scenario.name,
        # Without tolerances and measurements, which only a comparison of engines needs
        "scenario_file": dump(replace(plan.scenario, tolerances=(), measured=None, inferred=())),
        **decisive,
        "versions": versions(plan),
        "units": "SI",
        # Through JSON, which turns what Zarr's attributes cannot hold into text
        "engine_settings": json.loads(json.dumps({label(engine): vars(engine.settings) for engine in engines}, default=str)),
    }


def _checksum(plan: MapPlan, decisive: dict[str, Any]) -> str:
    """Return the checksum of all that determines the results, the same on every processor."""
    axes = []
    for axis in plan.axes:
        # Logarithmic values are powers, whose last bits depend on the processor
        values = axis.values[[0, -1]] if axis.logarithmic else axis.values
        axes.append([axis.name, axis.logarithmic, len(axis.values), values.tolist()])
    # The chunk does not change values, but a store has chunks of one shape, so that a map cannot go on with another
    known = decisive | {"parameters": plan.scenario.parameters.as_dict(), "axes": axes, "chunk": plan.chunk_sizes}
    return hashlib.sha256(json.dumps(known, sort_keys=True).encode()).hexdigest()


def open_map(folder: Path | str) -> xarray.Dataset:
    """Open the map in ``folder``; values are read from the disk when they are needed.

    Returns
    -------
    xarray.Dataset
        SI units; dimensions named by the parameters of a grid, or ``run`` of a sample. Runs that are not computed yet are
        NaN, and their ``end`` is -1.

    Raises
    ------
    MapError
        If there is no map, or if a file that is needed to read it is missing or damaged.
    """
    import xarray as xr
    from zarr.storage import LocalStore

    path = Path(folder) / STORE
    if not (path / METADATA).is_file():
        raise MapError(f"{folder}: found no map, needed a folder that `looping-pendulum map` wrote")
    try:
        # As a store, not as a path, which would be an address where the folder's name has "::"
        data: xr.Dataset = xr.open_zarr(LocalStore(path, read_only=True))
    except Exception as error:  # a damaged file may raise any exception
        raise _damaged(path, f"{type(error).__name__}: {error}") from None
    # Zarr reads a missing chunk as its fill value, so that a lost coordinate raises nothing
    for name, index in data.indexes.items():
        if index.isin(["", float("nan")]).any():
            raise _damaged(path, f"no values of {name}")
    return data


def _damaged(path: Path, why: str) -> MapError:
    way_out = "`looping-pendulum map` with the same file and folder repairs it or says why not"
    return MapError(f"{path}: found it damaged ({shorten(' '.join(why.split()))}); {way_out}")
