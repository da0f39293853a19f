"""Maps: many exact runs over one to three parameters, on this machine or on a Dask cluster.

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

_ELSEWHERE = {
    "load_map": ("looping_pendulum.sweep.map_file", "load"),
    "shipped_maps": ("looping_pendulum.sweep.map_file", "shipped"),
    "run_map": ("looping_pendulum.sweep.runner", "run_map"),
}


def __getattr__(name: str) -> Any:
    if name in _ELSEWHERE:
        module, attribute = _ELSEWHERE[name]
        return getattr(import_module(module), attribute)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def open_map(folder: Path | str) -> xarray.Dataset:
    """Open the map in ``folder``; values are read from the disk as they are needed.

    Returns
    -------
    xarray.Dataset
        SI units; dimensions named by the parameters of a grid, or ``run`` of a sample. What is not yet computed is NaN, and
        its ``end`` is -1.

    Raises
    ------
    MapError
        If there is none, or if what is needed to read it is missing or damaged.
    """
    import xarray as xr

    from looping_pendulum.scenarios.document import one_line, shorten
    from looping_pendulum.sweep.plan import MapError
    from looping_pendulum.sweep.store import STORE, coordinate_file

    mend = "`looping-pendulum map` of the same file in that folder mends or names it"

    path = Path(folder) / STORE
    if not (path / "zarr.json").is_file():
        raise MapError(f"{folder}: found no map, needed a folder that `looping-pendulum map` wrote")
    try:
        data: xr.Dataset = xr.open_zarr(path)
    except Exception as error:  # of whatever kind a damaged file raises
        why = f"{type(error).__name__}: {shorten(' '.join(str(error).split()))}"
        raise MapError(one_line(f"{path}: found it damaged ({why}); {mend}")) from None
    for name in data.indexes:
        if not coordinate_file(path, str(name)).is_file():
            raise MapError(one_line(f"{path}: found no values of {name}; {mend}"))
    return data
