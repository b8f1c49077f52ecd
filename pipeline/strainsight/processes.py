"""Processes that this one starts, and that none outlives it. What a system other than Linux cannot do is left out."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from importlib import import_module
from pathlib import Path
from threading import Event, Thread
from typing import IO, Any, Protocol, TypeVar

from strainsight.confinement import confine
from strainsight.imports import FOLDER

T = TypeVar("T")
SAFE_PATH = "PYTHONSAFEPATH"
"""Python's -P for a process and all that it starts."""
PR_SET_PDEATHSIG = 1
START_LIMIT = 120.0
"""[s] until a reader is there, on a machine that is busy."""
PROC = Path("/proc")
PS_LIMIT = 2.0
"""[s] for a list of all processes."""
READY = b"ready\n"
LONGER = 10.0
"""By the clock a reader may take so many times its limit of processor time: others use the machine, and disks are slow."""
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMEXPR_NUM_THREADS")
"""Variables of a reader, which is one thread: it computes nothing, and Landlock does not confine threads that run already."""
LOOK = 0.1
"""[s] between two looks at what a reader has used."""


def python(module: str) -> list[str]:
    """The command that runs a module of this package. -P: no module of the working folder, as SAFE_PATH."""
    return [sys.executable, "-P", "-m", module]


def inherited() -> dict[str, str]:
    """The environment of this process, in which a child finds this package and no module of the working folder, for which an
    empty entry of PYTHONPATH stands."""
    paths = [str(FOLDER.parent), *filter(None, os.environ.get("PYTHONPATH", "").split(os.pathsep))]
    return {**os.environ, SAFE_PATH: "1", "PYTHONPATH": os.pathsep.join(map(os.path.abspath, paths))}


@contextmanager
def safe_path() -> Iterator[None]:
    """Processes that libraries start meanwhile import no module of the working folder."""
    before = os.environ.get(SAFE_PATH)
    os.environ[SAFE_PATH] = "1"
    try:
        yield
    finally:
        if before is None:
            del os.environ[SAFE_PATH]
        else:
            os.environ[SAFE_PATH] = before


class Within(Protocol):
    """within(limit, read) is what `read` makes of a reader's answer, which ends after limit [s] of processor time, and
    LONGER times that by the clock, at the latest."""

    def __call__(self, limit: float, read: Callable[[IO[bytes]], T]) -> T: ...


@contextmanager
def reader(command: Sequence[str], asked: Any, start_limit: float) -> Iterator[Within]:
    """A child process that reads a file which may crash it, or hold it for ever: both cost the file and not the run.

    `asked` goes there as JSON, and `asked_of_reader` takes it. A process that crashes, is not ready within start_limit [s],
    or is killed at the limit of `Within`, answers no more.
    """
    process = subprocess.Popen(
        command,
        env=inherited() | dict.fromkeys(THREADS, "1"),
        cwd=FOLDER,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
    )
    assert process.stdin is not None
    assert process.stdout is not None
    answer = process.stdout

    def within(limit: float, read: Callable[[IO[bytes]], T]) -> T:
        done = Event()
        watching = Thread(target=_end_at, args=(process, limit, done), daemon=True)
        watching.start()
        try:
            return read(answer)
        finally:
            done.set()
            watching.join()

    with process:
        try:
            with suppress(BrokenPipeError), process.stdin:
                process.stdin.write(json.dumps([os.getcwd(), asked]).encode())
            if within(start_limit / LONGER, lambda stream: stream.readline()) != READY:
                process.kill()
                answer.read()
            yield within
        finally:
            process.kill()


def _end_at(process: subprocess.Popen[bytes], limit: float, done: Event) -> None:
    """End a process that is not done after limit [s] of processor time, or LONGER times that by the clock; on systems that do not
    say what it has used only the second."""
    used, started = _used(process.pid), time.monotonic()
    while not done.wait(min(LOOK, limit)):
        if _used(process.pid) - used > limit or time.monotonic() - started > LONGER * limit:
            process.kill()
            return


def _used(pid: int) -> float:
    """Processor time of a process [s], 0 where the system does not say."""
    with suppress(OSError, ValueError, IndexError):
        fields = (PROC / str(pid) / "stat").read_bytes().rpartition(b")")[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
    return 0.0


def asked_of_reader(*modules: str, writable: Callable[[Any], str] | None = None) -> Any:
    """In the child process of `reader`: what is asked of it.

    The modules are imported first, which no limit counts, away from the parent's working folder, whose settings they do not
    read; from then on the process is confined to reading. writable: what is asked → the folder of `confine`.
    """
    end_with_parent()
    folder, asked = json.loads(sys.stdin.read())
    for module in modules:
        import_module(module)
    os.chdir(folder)
    confine(writable(asked) if writable else None)
    sys.stdout.buffer.write(READY)
    sys.stdout.buffer.flush()
    return asked


def limit_memory(more: int) -> None:
    """From now on this process may take no more than so many bytes beside what it has, where the system can."""
    with suppress(ImportError, OSError, ValueError):
        import resource

        there = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        hard = resource.getrlimit(resource.RLIMIT_AS)[1]
        most = there + more
        resource.setrlimit(resource.RLIMIT_AS, (most if hard == resource.RLIM_INFINITY else min(most, hard), hard))


def peak_memory(children: bool = False) -> int | None:
    """The most memory that this process has held, or the largest of its children that have ended [bytes]; None where the system
    does not say (Windows)."""
    try:
        import resource
    except ImportError:
        return None
    unit = 1 if sys.platform == "darwin" else 1024
    return unit * resource.getrusage(resource.RUSAGE_CHILDREN if children else resource.RUSAGE_SELF).ru_maxrss


def end_with_parent() -> None:
    """In a child process: the kernel ends it with the thread that started it, however that ends."""
    if sys.platform == "linux":
        import ctypes

        with suppress(OSError, AttributeError):
            ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)


def end_children() -> None:
    """Ask every process that this one has started, and those that they have, to end.

    By SIGTERM: Python's resource tracker does not listen to that. It ends by itself with the last of the others and removes
    what they left in shared memory.
    """
    parents = _parents()
    for pid in parents:
        above = parents.get(pid)
        while above is not None and above != os.getpid():
            above = parents.get(above)
        if above is not None:
            with suppress(OSError):
                os.kill(pid, signal.SIGTERM)


def _parents() -> dict[int, int]:
    """Process → the one that started it, of all processes of this machine; none on Windows, where Ctrl-C reaches all processes of
    the console by itself."""
    if not (PROC / "self/stat").exists() and os.name == "posix":  # macOS
        listed = subprocess.run(["ps", "-A", "-o", "pid=,ppid="], capture_output=True, text=True, timeout=PS_LIMIT)
        return {int(pid): int(parent) for pid, parent in map(str.split, listed.stdout.splitlines())}
    found = {}
    for stat in PROC.glob("[0-9]*/stat"):
        with suppress(OSError, ValueError, IndexError):
            # pid (name) state parent …: a name may hold anything, also brackets.
            found[int(stat.parent.name)] = int(stat.read_bytes().rpartition(b")")[2].split()[1])
    return found
