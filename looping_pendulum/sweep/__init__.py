"""Computes maps: many runs over one to three parameters, on this machine or on a Dask cluster.

`load_map` reads a map file, `run_map` makes the map, `open_map` gives the finished one as an xarray Dataset.
"""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import xarray

    from looping_pendulum.sweep.map_file import load as load_map
    from looping_pendulum.sweep.map_file import shipped as shipped_maps
    from looping_pendulum.sweep.runner import run_map

__all__ = ["load_map", "open_map", "run_map", "shipped_maps"]

# The names are imported when they are used: workers import this package for `cells` alone, without the reader of files and Zarr
_LAZY_NAMES = {
    "load_map": ("looping_pendulum.sweep.map_file", "load"),
    "shipped_maps": ("looping_pendulum.sweep.map_file", "shipped"),
    "run_map": ("looping_pendulum.sweep.runner", "run_map"),
}


def __getattr__(name: str) -> Any:
    if name in _LAZY_NAMES:
        module, attribute = _LAZY_NAMES[name]
        return getattr(import_module(module), attribute)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


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

    from looping_pendulum.scenarios.document import one_line, shorten
    from looping_pendulum.sweep.plan import MapError
    from looping_pendulum.sweep.store import STORE, coordinate_file

    repair = "`looping-pendulum map` with the same file and folder repairs it or says why not"

    path = Path(folder) / STORE
    if not (path / "zarr.json").is_file():
        raise MapError(f"{folder}: found no map, needed a folder that `looping-pendulum map` wrote")
    try:
        data: xr.Dataset = xr.open_zarr(path)
    except Exception as error:  # a damaged file may raise any exception
        why = f"{type(error).__name__}: {shorten(' '.join(str(error).split()))}"
        raise MapError(one_line(f"{path}: found it damaged ({why}); {repair}")) from None
    # Zarr reads a missing chunk as its fill value, so that a lost coordinate raises nothing
    for name in data.indexes:
        if not coordinate_file(path, str(name)).is_file():
            raise MapError(one_line(f"{path}: found no values of {name}; {repair}"))
    return data
