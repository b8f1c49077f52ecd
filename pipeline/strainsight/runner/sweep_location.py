"""Execution of sweeps: in this process, in several processes, or on a cluster."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from strainsight.parallel import Sweep, allowed_threads, cores, in_processes, serial


@dataclass(frozen=True)
class Where:
    """Execution of sweeps: in at most `jobs` processes (None: one per core), or on the Dask cluster with this scheduler address.
    It does not affect results or keys."""

    jobs: int | None = None
    dask: str | None = None


@contextmanager
def opened(where: Where, memory: Callable[[], float] = lambda: math.inf) -> Iterator[Sweep]:
    """The sweep that is asked for, and as many `threads`; memory() [bytes] is what can still be taken. Raises UserError without
    such a cluster."""
    if where.dask is not None:
        from strainsight.contrib.dask_cluster import on_cluster

        with on_cluster(where.dask) as sweep:
            yield sweep
    elif where.jobs == 1:
        yield serial
    else:
        before = allowed_threads.set(where.jobs or cores())
        try:
            yield in_processes(where.jobs, memory)
        finally:
            allowed_threads.reset(before)
