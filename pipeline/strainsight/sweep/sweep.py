"""What a sweep is, the one that needs nobody else, and which one is asked for."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Protocol, TypeVar

P = TypeVar("P")
R = TypeVar("R")
S = TypeVar("S")

Told = Callable[[float], None]
"""Is told the share that is done."""


class Sweep(Protocol):
    """sweep(task, points, shared) = [task(shared, point) for point in points], wherever and in whatever order they run.

    task      a function of a module, without side effects: its result follows from its arguments to the last bit
    points    what differs; random numbers of a point come from a seed and its place, never from the order
    shared    what all points need, in plain arrays; it is sent once to a cluster
    told      is told the share that is done
    """

    def __call__(
        self, task: Callable[[S, P], R], points: Sequence[P], shared: S, told: Told | None = None
    ) -> list[R]: ...


def serial(task: Callable[[S, P], R], points: Sequence[P], shared: S, told: Told | None = None) -> list[R]:
    """One point after the other, here."""
    found = []
    for point in points:
        found.append(task(shared, point))
        if told is not None:
            told(len(found) / len(points))
    return found


def watched(sweep: Sweep, watcher: Told) -> Sweep:
    """The same sweep, whose progress `watcher` is told."""

    def seen(task: Callable[[S, P], R], points: Sequence[P], shared: S, told: Told | None = None) -> list[R]:
        return sweep(task, points, shared, told or watcher)

    return seen


@dataclass(frozen=True)
class Where:
    """Where sweeps run: in at most `jobs` processes, None for one a core, or on the Dask cluster whose scheduler has this
    address. No part of what is computed: it never enters a key."""

    jobs: int | None = None
    dask: str | None = None


@contextmanager
def opened(where: Where, memory: Callable[[], float] = lambda: math.inf) -> Iterator[Sweep]:
    """The sweep that is asked for; memory() [bytes] is what can still be taken. Raises UserError without such a cluster."""
    if where.dask is not None:
        from strainsight.sweep.cluster import on_cluster

        with on_cluster(where.dask) as sweep:
            yield sweep
    elif where.jobs == 1:
        yield serial
    else:
        from strainsight.sweep.processes import in_processes

        yield in_processes(where.jobs, memory)
