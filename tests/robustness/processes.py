"""Processes of the command line, started quickly (`forked`), and what is left of them."""

from __future__ import annotations

import json
import os
import select
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

PATIENCE = 300.0
"""[s] after which a process of a test has hung, on a machine that does three other things."""
LOOK = 5e-4
"""[s] between two looks."""


class Launcher:
    """start(words, says) → pid of `strainsight WORDS`, its own session, output into the file; end() → its exit code.

    scratch: the folder for their temporary files.
    """

    def __init__(self, scratch: Path):
        self.scratch, self.pid, self.runs = scratch, 0, False

    def __enter__(self) -> Launcher:
        self._server = subprocess.Popen(
            [sys.executable, str(Path(__file__).with_name("forked.py"))],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            bufsize=0,
            env={**os.environ, "TMPDIR": str(self.scratch)},
        )
        return self

    def __exit__(self, *_: object) -> None:
        self._server.stdin.close()
        self._server.wait(PATIENCE)
        self._server.stdout.close()

    def start(self, words: Sequence[str], says: Path) -> int:
        self._server.stdin.write(f"{json.dumps({'words': list(words), 'says': str(says)})}\n".encode())
        self.pid = int(self._server.stdout.readline())
        self.runs = True
        return self.pid

    def has_ended(self) -> bool:
        return bool(select.select([self._server.stdout], [], [], 0)[0])

    def end(self, patience: float = PATIENCE) -> int:
        """Wait for it; kill it where that takes too long."""
        if not select.select([self._server.stdout], [], [], patience)[0]:
            os.killpg(self.pid, signal.SIGKILL)
            raise AssertionError(f"no end after {patience} s")
        self.runs = False
        return int(self._server.stdout.readline())


def until(true: Callable[[], object], patience: float = PATIENCE) -> bool:
    end = time.monotonic() + patience
    while time.monotonic() < end:
        if true():
            return True
        time.sleep(LOOK)
    return False


def of_session(leader: int) -> dict[int, str]:
    """Every process, not counting those that have ended, of a session → its command."""
    found = {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            state, _, _, session = stat.read_text().rpartition(")")[2].split()[:4]
            if int(session) == leader and state not in "ZX":
                found[int(stat.parent.name)] = (stat.parent / "cmdline").read_text().replace("\0", " ")
    return found
