"""No process outlives the one that started it. What a system other than Linux cannot do is left out."""

from __future__ import annotations

import os
import signal
import sys
from contextlib import suppress
from pathlib import Path

PR_SET_PDEATHSIG = 1


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
    """Process → the one that started it, of all processes of this machine."""
    found = {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError, ValueError, IndexError):
            # pid (name) state parent …: a name may hold anything, also brackets.
            found[int(stat.parent.name)] = int(stat.read_bytes().rpartition(b")")[2].split()[1])
    return found
