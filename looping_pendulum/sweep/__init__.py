"""Maps: many exact runs over one to three parameters, on this machine or on a Dask cluster."""
