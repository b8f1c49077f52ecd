"""A sweep in threads of this process, of tasks whose time is that of compiled code."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextvars import ContextVar
from typing import TypeVar

from strainsight.parallel.sweep import P, Progress, R, S, Sweep, unwatched

allowed_threads: ContextVar[int] = ContextVar("threads", default=1)

A = TypeVar("A")
B = TypeVar("B")


def threads() -> int:
    """How many threads this process may take where it computes without a sweep: as many as its sweeps may take processes, one in
    those processes. What is computed is the same to the last bit."""
    return allowed_threads.get()


def in_threads(count: Callable[[], int]) -> Sweep:
    """At most count() at a time, asked when a sweep begins: nothing is sent anywhere, and no process has to start."""

    def sweep(task: Callable[[S, P], R], points: Sequence[P], shared: S, progress: Progress = unwatched) -> list[R]:
        found = []
        with ThreadPoolExecutor(count()) as pool:
            for result in pool.map(lambda point: task(shared, point), points):
                found.append(result)
                progress(len(found) / len(points))
        return found

    return sweep


def mapped(function: Callable[[A], B], parts: Iterable[A]) -> list[B]:
    """[function(part) for part in parts], in as many threads as this process may take."""
    if (count := threads()) == 1:
        return [function(part) for part in parts]
    with ThreadPoolExecutor(count) as pool:
        return list(pool.map(function, parts))


def side_by_side(first: Callable[[], A], second: Callable[[], B]) -> tuple[A, B]:
    """What both return, the first in a thread of its own where there are two; where both fail, the error of the first."""
    if threads() == 1:
        return first(), second()
    with ThreadPoolExecutor(1) as pool:
        ahead = pool.submit(first)
        try:
            behind = second()
        finally:
            found = ahead.result()
        return found, behind
