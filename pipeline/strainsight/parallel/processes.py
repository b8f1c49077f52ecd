"""A sweep in several processes of this machine, by joblib, as soon as that is faster than going on in one."""

from __future__ import annotations

import math
import os
import signal
import time
import warnings
from collections.abc import Callable, Sequence

from strainsight.errors import MachineWarning
from strainsight.parallel.sweep import P, Progress, R, S, Sweep, captured, repeated, unwatched
from strainsight.processes import end_with_parent, peak_memory, safe_path

WORTH = 5.0
"""[s] of work ahead from which other processes pay: they take about 2 s to start and to import what they need."""


def in_processes(jobs: int | None, memory: Callable[[], float]) -> Sweep:
    """At most `jobs` processes, None for one a core; fewer where memory() [bytes] is not enough for as many as large as this.

    The first points are computed here: they tell how long the others will take. A process that is killed loses nothing:
    what it and the others had not done is done here.
    """
    most = jobs or cores()

    def sweep(task: Callable[[S, P], R], points: Sequence[P], shared: S, progress: Progress = unwatched) -> list[R]:
        found: list[R] = []
        start = time.perf_counter()

        def keep(result: R) -> None:
            found.append(result)
            progress(len(found) / len(points))

        for k, point in enumerate(points):
            left = len(points) - k
            if k and (time.perf_counter() - start) / k * left > WORTH:
                count = min(most, left, _fitting(memory()))
                if count > 1:
                    _spread(task, points[k:], shared, count, keep)
                    break
            keep(task(shared, point))
        for point in points[len(found) :]:
            keep(task(shared, point))
        return found

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
            "a process of a sweep was killed, probably for lack of memory: the rest goes on in one (--jobs 1)",
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
    """Processes as large as this one was at its largest that there is memory for [bytes], beside it."""
    own = peak_memory()
    return cores() if own is None or math.isinf(memory) else int(memory / own)
