"""What a process has to have around it before anything of weight is loaded: streams, a working folder, memory to load into."""

from __future__ import annotations

import io
import os
import sys

LAST_STREAM = 2
"""Number of the last of the three that a process is born with."""
LEAST = 1 << 30
"""[bytes] of address space; the libraries take more than half of it, and OpenBLAS waits for ever for threads without room."""


def prepare_streams() -> None:
    """A service may have closed them: what is printed then goes nowhere. A terminal without Greek gets question marks, not a
    failure at the end of a long run."""
    # the numbers that are free are the first that files get, and a library may print on 1 and 2
    while (taken := os.open(os.devnull, os.O_RDWR)) < LAST_STREAM:
        pass
    if taken > LAST_STREAM:
        os.close(taken)
    sys.stdout = sys.stdout or open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115
    sys.stderr = sys.stderr or open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")


def missing() -> str:
    """What is not there, with the remedy; empty where all is."""
    try:
        os.getcwd()
    except OSError:
        return "the working folder is gone, or may not be read\n    change to a folder that exists"
    try:
        import resource
    except ImportError:  # Windows has no such limits
        return ""
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    if limit != resource.RLIM_INFINITY and limit < LEAST:
        return (
            f"the limit of address space is {limit / 2**20:.0f} MiB (ulimit -v), too little to load the libraries\n"
            f"    at least {LEAST // 2**20} MiB: ulimit -v {LEAST // 1024}, and what the model takes beside it"
        )
    return ""
