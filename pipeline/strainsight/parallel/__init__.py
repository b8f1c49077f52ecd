"""One function at many points: in this process, in several, or on a Dask cluster, with the same results."""
