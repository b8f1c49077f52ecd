"""Where sweeps run: here, in several processes, or on a cluster."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass

from strainsight.sweep.sweep import Sweep, serial

_threads: ContextVar[int] = ContextVar("threads", default=1)


def threads() -> int:
    """How many threads this process may take where it computes without a sweep: as many as its sweeps may take processes, one in
    those processes. What is computed is the same to the last bit."""
    return _threads.get()


@dataclass(frozen=True)
class Where:
    """Where sweeps run: in at most `jobs` processes, None for one a core, or on the Dask cluster whose scheduler has this
    address. No part of what is computed: it never enters a key."""

    jobs: int | None = None
    dask: str | None = None


@contextmanager
def opened(where: Where, memory: Callable[[], float] = lambda: math.inf) -> Iterator[Sweep]:
    """The sweep that is asked for, and as many `threads`; memory() [bytes] is what can still be taken. Raises UserError without
    such a cluster."""
    if where.dask is not None:
        from strainsight.sweep.cluster import on_cluster

        with on_cluster(where.dask) as sweep:
            yield sweep
    elif where.jobs == 1:
        yield serial
    else:
        from strainsight.sweep.processes import cores, in_processes

        before = _threads.set(where.jobs or cores())
        try:
            yield in_processes(where.jobs, memory)
        finally:
            _threads.reset(before)
