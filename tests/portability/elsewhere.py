"""`python elsewhere.py SYSTEM WORDS…`: the command line on a Python without what POSIX alone has, or what tests ask for.

SYSTEM: `windows`, whose locks are made up of those that are here, or `bare`, with none. WORDS: those of a command; `hold FOLDER`,
`wait FOLDER`, `factorise` or `sleep`. What this cannot show: paths, consoles and libraries of those systems. os.set_blocking
stays: set_wakeup_fd of POSIX asks for it.
"""

from __future__ import annotations

import errno
import fcntl
import importlib.abc
import os
import signal
import subprocess  # before msvcrt is there, by which it knows Windows  # noqa: F401
import sys
import time
import types
from pathlib import Path

MODULES = {"fcntl", "resource", "termios", "pwd", "grp", "pty", "tty", "syslog", "readline", "pypardiso"}
"""Not on Windows; PARDISO not on a Mac of today."""
OF_OS = ("pread", "pwrite", "O_CLOEXEC", "O_NOFOLLOW", "posix_fallocate", "sched_getaffinity", "fork", "getuid")
OF_SIGNAL = ("SIGHUP", "SIGKILL", "SIGUSR1", "SIGALRM", "setitimer")
_lockf = fcntl.lockf


class NotThere(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name in MODULES:
            raise ModuleNotFoundError(f"No module named '{name}'", name=name)


def locking(handle: int, mode: int, count: int) -> None:
    """As Microsoft documents _locking: `count` bytes from where the file is at; EACCES where another has them."""
    assert mode == msvcrt.LK_NBLCK
    at = os.lseek(handle, 0, os.SEEK_CUR)
    assert 0 < at < 2**31
    try:
        _lockf(handle, fcntl.LOCK_EX | fcntl.LOCK_NB, count, at)
    except OSError:
        raise PermissionError(errno.EACCES, "Permission denied") from None


msvcrt = types.ModuleType("msvcrt")
msvcrt.locking, msvcrt.LK_NBLCK = locking, 2


def become(system: str) -> None:
    for name in OF_OS:
        delattr(os, name)
    for name in OF_SIGNAL:
        delattr(signal, name)
    for name in MODULES & sys.modules.keys():
        del sys.modules[name]
    sys.meta_path.insert(0, NotThere())
    if system == "windows":
        sys.modules["msvcrt"] = msvcrt


if __name__ == "__main__":
    become(sys.argv[1])
    words = sys.argv[2:]
    if words[0] == "hold":  # the lock of a results folder and that of a stage, until the end of stdin
        from strainsight.runner.runner import computing, locked

        with locked(Path(words[1])), computing(Path(words[1]).parent, "f" * 64):
            print("holds", flush=True)
            sys.stdin.read()
    elif words[0] == "wait":  # for that of the stage
        from strainsight.runner.runner import computing

        with computing(Path(words[1]).parent, "f" * 64, lambda: print("waits", flush=True)):
            print("has it", flush=True)
    elif words[0] == "factorise":  # a chain of springs, held at one end: x = [1, 2, … 9] under a unit force at the other
        import numpy as np
        from scipy import sparse

        from strainsight.fem.factorisation import factorise
        from strainsight_cli.failures import reported

        with reported():
            stiffness = sparse.diags_array([[-1.0] * 8, [2.0] * 8 + [1.0], [-1.0] * 8], offsets=[-1, 0, 1])
            factor = factorise(sparse.csr_array(stiffness))
            print(factor.solver, factor.solve(np.eye(9)[:, 8]).round(9).tolist())
    elif words[0] == "sleep":
        from strainsight_cli.failures import reported

        with reported():
            print("starts", flush=True)
            time.sleep(60)
    else:
        from strainsight_cli.main import main

        sys.argv = ["strainsight", *words]
        main()
