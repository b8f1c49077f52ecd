"""What a sweep is, and the one that needs nobody else."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol, TypeVar

P = TypeVar("P")
R = TypeVar("R")
S = TypeVar("S")

Progress = Callable[[float], None]
"""Called with the share that is done."""


class Sweep(Protocol):
    """sweep(task, points, shared) = [task(shared, point) for point in points], wherever and in whatever order they run.

    task      a function of a module, without side effects: its result follows from its arguments to the last bit
    points    what differs; random numbers of a point come from a seed and its place, never from the order
    shared    what all points need, in plain arrays; it is sent once to a cluster
    progress  called with the share that is done
    """

    def __call__(
        self, task: Callable[[S, P], R], points: Sequence[P], shared: S, progress: Progress | None = None
    ) -> list[R]: ...


def serial(task: Callable[[S, P], R], points: Sequence[P], shared: S, progress: Progress | None = None) -> list[R]:
    """One point after the other, here."""
    found = []
    for point in points:
        found.append(task(shared, point))
        if progress is not None:
            progress(len(found) / len(points))
    return found


def watched(sweep: Sweep, watcher: Progress) -> Sweep:
    """The same sweep, which calls `watcher` with its progress."""

    def seen(task: Callable[[S, P], R], points: Sequence[P], shared: S, progress: Progress | None = None) -> list[R]:
        return sweep(task, points, shared, progress or watcher)

    return seen
