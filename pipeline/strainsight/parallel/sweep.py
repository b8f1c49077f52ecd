"""What a sweep is, the one that needs nobody else, and what another process answers: a result and the warnings on the way."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
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
