"""results/NAME/run.log: times and messages of the commands in that folder."""

from __future__ import annotations

import os
import platform
import re
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from strainsight.file_lock import lock_file
from strainsight.processes import peak_memory
from strainsight.writing import open_file
from strainsight_cli.failures import LAST_WORDS, same_text

if TYPE_CHECKING:
    from strainsight.runner.plan import Job

# In quotes a path may hold spaces; outside it ends at one. A word before the slash makes it a relative path or a fraction.
_QUOTED = re.compile(r"""(["'])/(?:[^"'\n]*/)?([^"'\n/]*)\1""")
_BARE = re.compile(r"""(?<![\w.…/)\]-])/(?:[^\s/"',;:()]+/)*([^\s/"',;:()]+)""")


def placeless(text: str, folders: Iterable[Path] = ()) -> str:
    """The text with paths below `folders`, packages and working directory made relative, and other paths reduced to the file
    name.

    `File "/home/…/site-packages/scipy/sparse/_csr.py"` becomes `File "scipy/sparse/_csr.py"`."""
    known = [*folders, Path.cwd(), Path.home(), Path(tempfile.gettempdir()), Path(sys.prefix), *map(Path, sys.path)]
    roots = {str(path) for folder in known for path in (folder.absolute(), folder.resolve())} - {"/"}
    for root in sorted(roots, key=len, reverse=True):  # the deepest first
        text = re.sub(rf"(?<![\w./-]){re.escape(root)}/(?=[^\s\"'])", "", text)
        text = re.sub(rf"(?<![\w./-]){re.escape(root)}(?![\w.-])/?", ".", text)
    text = _QUOTED.sub(r"\1…/\2\1", text)
    return _BARE.sub(r"…/\1", text)


NAME = "run.log"
MOST, KEPT = 1 << 20, 1 << 19
"""[bytes] A log larger than the first value is cut to the last lines within the second."""

Log = Callable[[str], None]


@contextmanager
def run_log(job: Job, stages: str) -> Iterator[Log]:
    """Yield the function that writes a line to the log of the folder; warnings and a failure are logged automatically.

    The run creates the folder; earlier lines are kept and written with the first one after that. A log that cannot be written
    never makes a run fail."""
    import strainsight

    start = time.perf_counter()
    versions = f"strainsight {strainsight.__version__}, python {platform.python_version()}"
    waiting = [_line(f"run begins: {job.config['name']}, {stages}; {versions}")]

    def log(text: str) -> None:
        waiting.append(_line(placeless(text, (job.base, job.results))))
        if job.folder.is_dir() and not job.folder.is_symlink():
            append(job.folder / NAME, "".join(waiting))
            waiting.clear()

    shown = warnings.showwarning
    logged: set[str] = set()

    def warn(message: Warning | str, *rest: Any, **named: Any) -> None:
        if same_text(str(message)) not in logged:
            logged.add(same_text(str(message)))
            log(f"warning: {message}")
        shown(message, *rest, **named)

    def interrupted(text: str) -> None:
        if job.folder.is_dir() and not job.folder.is_symlink():
            append(job.folder / NAME, "".join([*waiting, _line(text)]), wait=False)

    warnings.showwarning = warn
    LAST_WORDS.append(interrupted)
    try:
        yield log
    except BaseException as error:
        log(f"failed after {time.perf_counter() - start:.1f} s\n{''.join(traceback.format_exception(error))}")
        raise
    else:
        log(f"finished after {time.perf_counter() - start:.1f} s, {peak()}")
    finally:
        LAST_WORDS.remove(interrupted)
        warnings.showwarning = shown


def peak() -> str:
    """Peak memory of this process, as in "peak memory 0.38 GiB"."""
    peak_bytes = peak_memory()
    return "peak memory unknown on this system" if peak_bytes is None else f"peak memory {peak_bytes / 2**30:.2f} GiB"


def append(path: Path, text: str, wait: bool = True) -> None:
    """Append whole lines, safely with other processes, and limit the size of the file.

    wait: for the lock; during an exit, the interrupted code may hold it."""
    with suppress(OSError):
        handle = open_file(path, os.O_RDWR | os.O_APPEND)
        try:
            # On a disk without locks lines are still whole where the system appends at once, as Linux does.
            with suppress(OSError):
                lock_file(handle, wait)
            _write(handle, text.encode(errors="replace"))
            if (size := os.fstat(handle).st_size) > MOST:
                os.lseek(handle, size - KEPT, os.SEEK_SET)
                last = os.read(handle, KEPT)
                os.ftruncate(handle, 0)
                _write(handle, last.partition(b"\n")[2])
        finally:
            os.close(handle)


def _write(handle: int, content: bytes) -> None:
    while content:
        content = content[os.write(handle, content) :]


def _line(text: str) -> str:
    """Time, process and text; continuation lines are indented."""
    clean = "".join(c if c.isprintable() or c == "\n" else "�" for c in text).rstrip("\n")
    head = f"{datetime.now(UTC).isoformat(timespec='seconds').removesuffix('+00:00')}Z {os.getpid()}"
    return "".join(f"{head} {'  | ' if i else ''}{line}\n" for i, line in enumerate(clean.split("\n")))
