"""A process that reads hostile files: ten seconds a file, a bounded memory, and a record of every file it opens."""

from __future__ import annotations

import os
import re
import resource
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

SECONDS = 10.0
MEMORY = 3 << 29
"""[bytes] that reading may take: 1.5 GiB."""
CHANGES = {
    *("os.remove", "os.rename", "os.rmdir", "os.mkdir", "os.link", "os.symlink", "os.truncate", "os.chmod", "os.chown"),
    *("shutil.rmtree", "shutil.move", "os.utime", "os.mkfifo", "os.mknod"),
}
CALLS = {"os.system", "os.exec", "os.posix_spawn", "subprocess.Popen", "socket.connect", "socket.bind", "ctypes.dlopen"}
TIMES = re.compile(r"/proc/\d+/stat")
"""What a process has used of the processor: of the child that reads a file."""
WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND


class Hung(BaseException):
    """Ten seconds have passed; not an Exception, so that no reader takes it for a damaged file."""


@contextmanager
def soon(seconds: float = SECONDS) -> Iterator[None]:
    """Raise Hung after so many seconds of work, or six times as many of a machine that does other things too."""

    def late(number: int, frame: Any) -> None:
        raise Hung

    clocks = {signal.ITIMER_PROF: (signal.SIGPROF, 1), signal.ITIMER_REAL: (signal.SIGALRM, 6)}
    old = {number: signal.signal(number, late) for number, _ in clocks.values()}
    for clock, (_, times) in clocks.items():
        signal.setitimer(clock, times * seconds)
    try:
        yield
    finally:
        for clock in clocks:
            signal.setitimer(clock, 0)
        for number, handler in old.items():
            signal.signal(number, handler)


def limit_memory(more: int = MEMORY) -> None:
    """From now on this process and what it starts may map so many bytes more than it has now."""
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    most = pages * resource.getpagesize() + more
    resource.setrlimit(resource.RLIMIT_AS, (most, most))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


class Watch:
    """Every file that is opened or changed outside `own` folders: to `found`, in words, while `on`.

    free: what may be read besides; anywhere: files may be read wherever they are. calls: programs that may be started.
    """

    def __init__(self, own: Path, free: tuple[str, ...], anywhere: bool = False, calls: tuple[str, ...] = ()):
        self.own, self.anywhere, self.calls = str(own.resolve()), anywhere, calls
        self.free = (
            *free,
            sys.prefix,
            sys.base_prefix,
            "/proc/self",
            "/sys/",
            "/dev/null",
            "/dev/urandom",
            "/usr/",
            "/lib",
        )
        self.on, self.found = False, []
        sys.addaudithook(self._heard)

    def _heard(self, event: str, words: tuple[Any, ...]) -> None:
        if not self.on:
            return
        if event == "open" and not isinstance(words[0], int) and words[0] is not None:
            path, mode, flags = words
            writes = bool((flags or 0) & WRITING) or bool(set(mode or "") & set("wax+"))
            place = os.path.realpath(os.fsdecode(path))
            if (
                place != os.devnull
                and not self._inside(place)
                and (writes or not (self.anywhere or place.startswith(self.free) or TIMES.fullmatch(place)))
            ):
                self.found.append(f"{'writes' if writes else 'reads'} {place}")
        elif event in CHANGES:
            for path in words[:2]:
                if isinstance(path, str | bytes) and not self._inside(os.path.realpath(os.fsdecode(path))):
                    self.found.append(f"{event} {os.fsdecode(path)}")
        elif event in CALLS and not any(call in str(words) for call in self.calls):
            self.found.append(f"{event} {str(words)[:200]}")

    def _inside(self, place: str) -> bool:
        return place == self.own or place.startswith(self.own + os.sep)
