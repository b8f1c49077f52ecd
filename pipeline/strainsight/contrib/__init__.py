"""Machines beyond this process: MPI and Dask."""
