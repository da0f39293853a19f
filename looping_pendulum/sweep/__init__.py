"""Computes maps: many runs over one to three parameters, on this machine or on a Dask cluster.

`load_map` reads a map file, `run_map` makes the map, `open_map` gives the finished one as an xarray Dataset.
"""

from looping_pendulum.sweep.map_file import load as load_map
from looping_pendulum.sweep.map_file import shipped as shipped_maps
from looping_pendulum.sweep.runner import run_map
from looping_pendulum.sweep.store import open_map

__all__ = ["load_map", "open_map", "run_map", "shipped_maps"]
