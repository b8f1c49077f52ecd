"""Runs of a suite in several processes, each started as soon as the runs it takes a guess from have ended."""

from __future__ import annotations

import signal
import sys
import warnings
from collections.abc import Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import active_children, get_context, resource_tracker
from typing import TYPE_CHECKING, Any

from strainsight.processes import end_with_parent
from strainsight_cli import levels
from strainsight_cli.failures import Failure, failure_of, plain_warnings, warn
from strainsight_cli.work import Progress, Work, bring_up_to_date, makers, note

if TYPE_CHECKING:
    from strainsight.runner.artefact import Artefact

LOOK = 0.2
"""[s] between two looks at what the processes say."""


@dataclass(frozen=True)
class Ended:
    """A run that ended: its lines; artefacts of its stages; what is reported of the failure that ended it, if any."""

    place: int
    lines: tuple[str, ...]
    artefacts: tuple[Artefact, ...]
    failure: Failure | None


def side_by_side(
    works: Sequence[Work], jobs: int, force: bool, as_json: bool, verbose: bool, progress: Progress
) -> Generator[Ended]:
    """Every run as it ends, `jobs` at a time; where one process computes what another needs, the other waits and reuses
    it. After a run that failed no other is started. Raises StrainsightError where a process was killed."""
    waits = [set(makers(work, works).values()) for work in works]
    pending, ended = list(range(len(works))), set[int]()
    running: dict[Future[Ended], int] = {}
    with _processes(min(jobs, len(works)), verbose) as (pool, moves):
        while pending or running:
            for place in [place for place in pending if waits[place] <= ended][: jobs - len(running)]:
                pending.remove(place)
                running[pool.submit(_run, place, works[place], force, as_json, verbose)] = place
            done = wait(running, timeout=LOOK, return_when=FIRST_COMPLETED).done
            _pass_on(moves, progress)
            for future in sorted(done, key=lambda future: (future.exception() is not None, running[future])):
                try:
                    result = future.result()
                except BrokenProcessPool:
                    raise _killed([works[place] for _, place in sorted(running.items(), key=lambda r: r[1])]) from None
                ended.add(running.pop(future))
                if result.failure is not None:
                    pending.clear()
                yield result


@contextmanager
def _processes(count: int, verbose: bool) -> Iterator[tuple[ProcessPoolExecutor, Any]]:
    context = get_context("spawn")
    _quiet_tracker()
    moves = context.SimpleQueue()
    with ProcessPoolExecutor(count, context, _start, (moves, verbose, levels.now())) as pool:
        try:
            yield pool, moves
        except BaseException:
            # Nobody listens any more: they would wait for that, and the pool for them.
            for process in active_children():
                process.terminate()
            raise


def _quiet_tracker() -> None:
    """Start the process that clears up semaphores after Ctrl-C so that it does not speak of it."""
    sys.warnoptions.append("ignore:resource_tracker")
    try:
        resource_tracker.ensure_running()
    finally:
        sys.warnoptions.pop()


def _pass_on(moves: Any, progress: Progress) -> None:
    """What the processes sent since the last look: a move of the bar, a note or a warning."""
    while not moves.empty():
        text = moves.get()
        if isinstance(text, str):
            note(text)
        elif isinstance(text, UserWarning):
            warn(str(text))
        else:
            progress(*text)


def _killed(works: Sequence[Work]) -> Exception:
    from strainsight.errors import StrainsightError

    return StrainsightError(
        "a process was killed, probably for lack of memory: --set jobs=1",
        where=", ".join(work.beside for work in works),
    )


_moves: Any = None


def _start(moves: Any, verbose: bool, level: levels.Level) -> None:
    """In a new process: end with the parent, and leave warnings to it, which prints each once."""
    global _moves
    _moves = moves
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    end_with_parent()
    levels.set_level(level)
    plain_warnings(verbose)
    warnings.showwarning = lambda message, *_, **__: moves.put(UserWarning(str(message)))


def _run(place: int, work: Work, force: bool, as_json: bool, verbose: bool) -> Ended:
    lines: list[str] = []
    forced = [stage.name for stage in work.stages] if force else []
    try:
        found = bring_up_to_date(
            work, forced, as_json, verbose, lines.append, lambda *move: _moves.put(move), lambda text: _moves.put(text)
        )
    except Exception as error:
        return Ended(place, tuple(lines), (), failure_of(error))
    return Ended(place, tuple(lines), tuple(found), None)
