"""What a sweep is, the one that needs nobody else, and what another process answers: a result and the warnings on the way."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextvars import ContextVar
from typing import Any, Protocol, TypeVar

P = TypeVar("P")
R = TypeVar("R")
S = TypeVar("S")

Progress = Callable[[float], None]
"""Called with the share that is done."""


def unwatched(share: float) -> None:
    """Progress that nobody looks at."""


class Sweep(Protocol):
    """sweep(task, points, shared) = [task(shared, point) for point in points], wherever and in whatever order they run.

    task      a function of a module, without side effects: its result follows from its arguments to the last bit
    points    what differs; random numbers of a point come from a seed and its place, never from the order
    shared    what all points need, in plain arrays; it is sent once to a cluster
    progress  called with the share that is done
    """

    def __call__(
        self, task: Callable[[S, P], R], points: Sequence[P], shared: S, progress: Progress = unwatched
    ) -> list[R]: ...


def serial(task: Callable[[S, P], R], points: Sequence[P], shared: S, progress: Progress = unwatched) -> list[R]:
    """One point after the other, here."""
    found = []
    for point in points:
        found.append(task(shared, point))
        progress(len(found) / len(points))
    return found


def watched(sweep: Sweep, watcher: Progress) -> Sweep:
    """The same sweep, which calls `watcher` with its progress."""

    def seen(task: Callable[[S, P], R], points: Sequence[P], shared: S, progress: Progress = watcher) -> list[R]:
        return sweep(task, points, shared, progress)

    return seen


Captured = tuple[Any, list[tuple[str, type[Warning]]]]
"""Result of a task in another process and its warnings, which are repeated here, where they are shown as all others."""


def captured(task: Callable[[Any, Any], Any], shared: Any, point: Any) -> Captured:
    """The result of a task, and its warnings."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        result = task(shared, point)
    return result, [(str(warning.message), warning.category) for warning in caught]


def repeated(answer: Captured) -> Any:
    """The result, after its warnings."""
    result, caught = answer
    for message, category in caught:
        warnings.warn(message, category, stacklevel=3)
    return result


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
