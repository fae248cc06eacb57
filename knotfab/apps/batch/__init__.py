"""Many builds, here or on a Dask cluster."""
