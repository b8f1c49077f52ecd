"""Runs of a suite in several processes, each started as soon as the runs it takes a guess from have ended."""

from __future__ import annotations

import signal
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing import get_context
from typing import TYPE_CHECKING, Any

from strainsight_cli.failures import plain_warnings
from strainsight_cli.work import Progress, Work, bring_up_to_date

if TYPE_CHECKING:
    from strainsight.workflow.artefact import Artefact

LOOK = 0.2
"""[s] between two looks at what the processes say."""
PR_SET_PDEATHSIG = 1


@dataclass(frozen=True)
class Ended:
    """A run that ended: its lines; artefacts of its stages; the error that ended it, if any."""

    place: int
    lines: tuple[str, ...]
    artefacts: tuple[Artefact, ...]
    error: Exception | None


def side_by_side(
    works: Sequence[Work], jobs: int, force: bool, as_json: bool, verbose: bool, progress: Progress
) -> Iterator[Ended]:
    """Every run as it ends, `jobs` at a time; where one process computes what another needs, the other waits and takes it
    over. After a run that failed no other is started."""
    waits = [_guesses_from(work, works[:i]) for i, work in enumerate(works)]
    pending, ended = list(range(len(works))), set[int]()
    running: dict[Future[Ended], int] = {}
    with _processes(min(jobs, len(works)), verbose) as (pool, moves):
        while pending or running:
            for place in [place for place in pending if waits[place] <= ended][: jobs - len(running)]:
                pending.remove(place)
                running[pool.submit(_run, place, works[place], force, as_json, verbose)] = place
            done = wait(running, timeout=LOOK, return_when=FIRST_COMPLETED).done
            while not moves.empty():
                progress(*moves.get())
            for future in sorted(done, key=running.__getitem__):
                ended.add(running.pop(future))
                result = future.result()
                if result.error is not None:
                    pending.clear()
                yield result


@contextmanager
def _processes(count: int, verbose: bool) -> Iterator[tuple[ProcessPoolExecutor, Any]]:
    context = get_context("spawn")
    moves = context.SimpleQueue()
    with ProcessPoolExecutor(count, context, _start, (moves, verbose)) as pool:
        yield pool, moves


def _guesses_from(work: Work, before: Sequence[Work]) -> set[int]:
    """Places of the runs whose results are input files of this one."""
    from strainsight.workflow.plan import inputs_of

    paths = [path for stage in work.stages for path in inputs_of(stage, work.job, required=False).files.values()]
    return {i for i, other in enumerate(before) if any(path.is_relative_to(other.job.folder) for path in paths)}


_moves: Any = None


def _start(moves: Any, verbose: bool) -> None:
    """In a new process: end with the parent, and say warnings as it does."""
    global _moves
    _moves = moves
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    if sys.platform == "linux":
        import ctypes

        with suppress(OSError, AttributeError):
            ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    plain_warnings(verbose)


def _run(place: int, work: Work, force: bool, as_json: bool, verbose: bool) -> Ended:
    lines: list[str] = []
    forced = [stage.name for stage in work.stages] if force else []
    try:
        found = bring_up_to_date(work, forced, as_json, verbose, lines.append, lambda *move: _moves.put(move))
    except Exception as error:
        return Ended(place, tuple(lines), (), error)
    return Ended(place, tuple(lines), tuple(found), None)
