"""Sweeps: by one thread, by several, or in several processes by joblib, with the warnings of each task."""

from __future__ import annotations

import math
import os
import signal
import time
import warnings
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextvars import ContextVar
from functools import partial
from typing import Any, Protocol, TypeVar

from strainsight.errors import MachineWarning
from strainsight.processes import end_with_parent, peak_memory, safe_path

P = TypeVar("P")
R = TypeVar("R")
S = TypeVar("S")

Progress = Callable[[float], None]
"""Called with the share that is done."""


def ignore_progress(share: float) -> None:
    """Progress that nobody looks at."""


class Sweep(Protocol):
    """sweep(task, points, shared) = [task(shared, point) for point in points], wherever and in whatever order they run.

    task      a function of a module, without side effects: its result follows from its arguments to the last bit
    points    what differs; random numbers of a point come from a seed and its place, never from the order
    shared    what all points need, in plain arrays; it is sent once to a cluster
    progress  called with the share that is done
    """

    def __call__(
        self, task: Callable[[S, P], R], points: Sequence[P], shared: S, progress: Progress = ignore_progress
    ) -> list[R]: ...


def serial(task: Callable[[S, P], R], points: Sequence[P], shared: S, progress: Progress = ignore_progress) -> list[R]:
    """One point after the other, here."""
    results = []
    for point in points:
        results.append(task(shared, point))
        progress(len(results) / len(points))
    return results


def watched(sweep: Sweep, watcher: Progress) -> Sweep:
    """The same sweep, which calls `watcher` with its progress."""
    return partial(sweep, progress=watcher)


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

    def sweep(
        task: Callable[[S, P], R], points: Sequence[P], shared: S, progress: Progress = ignore_progress
    ) -> list[R]:
        results = []
        with ThreadPoolExecutor(count()) as pool:
            for result in pool.map(lambda point: task(shared, point), points):
                results.append(result)
                progress(len(results) / len(points))
        return results

    return sweep


def mapped(function: Callable[[A], B], parts: Iterable[A]) -> list[B]:
    """[function(part) for part in parts], in as many threads as this process may take."""
    if (count := threads()) == 1:
        return [function(part) for part in parts]
    with ThreadPoolExecutor(count) as pool:
        return list(pool.map(function, parts))


def side_by_side(first: Callable[[], A], second: Callable[[], B]) -> tuple[A, B]:
    """Results of both functions, the first in a separate thread if two are available; if both fail, the error of the first."""
    if threads() == 1:
        return first(), second()
    with ThreadPoolExecutor(1) as pool:
        ahead = pool.submit(first)
        try:
            behind = second()
        finally:
            result = ahead.result()
        return result, behind


WORTH = 5.0
"""[s] of work ahead from which other processes pay: they take about 2 s to start and to import what they need."""


def in_processes(jobs: int | None, memory: Callable[[], float]) -> Sweep:
    """At most `jobs` processes, None for one a core; fewer where memory() [bytes] is not enough for as many as large as this.

    The first points are computed here: they tell how long the others will take. A process that is killed loses nothing:
    what it and the others had not done is done here."""
    most = jobs or cores()

    def sweep(
        task: Callable[[S, P], R], points: Sequence[P], shared: S, progress: Progress = ignore_progress
    ) -> list[R]:
        results: list[R] = []
        start = time.perf_counter()

        def keep(result: R) -> None:
            results.append(result)
            progress(len(results) / len(points))

        for k, point in enumerate(points):
            left = len(points) - k
            if k and (time.perf_counter() - start) / k * left > WORTH:
                count = min(most, left, _fitting(memory()))
                if count > 1:
                    _spread(task, points[k:], shared, count, keep)
                    break
            keep(task(shared, point))
        for point in points[len(results) :]:
            keep(task(shared, point))
        return results

    return sweep


def _spread(task: Callable[[S, P], R], points: Sequence[P], shared: S, count: int, keep: Callable[[R], None]) -> None:
    """Keep the results in order, up to the first that got lost with its process."""
    from joblib import Parallel, delayed
    from joblib.externals.loky.process_executor import TerminatedWorkerError

    # max_nbytes: no array passes through a file. pre_dispatch: no more copies of what is shared than processes.
    parallel = Parallel(
        n_jobs=count, return_as="generator", batch_size=1, pre_dispatch="n_jobs", max_nbytes=None, initializer=_begin
    )
    try:
        with safe_path():
            for result in parallel(delayed(captured)(task, shared, point) for point in points):
                keep(repeated(result))
    except TerminatedWorkerError:
        warnings.warn(
            "a parallel process was killed, probably for lack of memory; the computation continues in one process "
            "(--jobs 1)",
            MachineWarning,
            stacklevel=2,
        )


def _begin() -> None:
    """In a new process: no traceback on Ctrl-C, and no life without the process that asked for it."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    end_with_parent()


def cores() -> int:
    """Cores that this process may use: fewer than the machine has where it is confined to some."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _fitting(memory: float) -> int:
    """Number of additional processes that fit into the memory [bytes], each with the peak memory of this one."""
    peak = peak_memory()
    return cores() if peak is None or math.isinf(memory) else int(memory / peak)
