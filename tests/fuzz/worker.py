"""python -m tests.fuzz.worker GROUP SEEDS WORK SEED FIRST LAST FATAL: reads the damaged files FIRST to LAST − 1.

FATAL is the number of the one that ended such a process before, or -1.

Every fault is a line of JSON on stdout; WORK/at holds the number of the file that is being read, for whoever has to know
which one ended the process.
"""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import signal
import sys
import tempfile
import traceback
import warnings
from collections.abc import Callable
from functools import partial
from pathlib import Path

from .cases import PAIRED, Case, Group, companions
from .guard import SECONDS, Hung, Watch, limit_memory, soon
from .readers import READERS, fault_of
from .seeds import ROOT

HDF5 = (".h5", ".med", ".h5m", ".cgns")
"""The library below these ends the process once in some hundred damaged files."""
OUTSIDE = "outside its folder"
CHILDREN = ("strainsight.measurements.reader", "strainsight.decks.other.load")
"""What readers start."""


def main() -> None:
    name, seeds, work, seed, first, last, fatal = sys.argv[1:]
    folder = Path(work)
    group = Group(name, Path(seeds) / name)
    if not folder.exists():
        companions(name, Path(seeds) / name, folder)
    (folder / "tmp").mkdir(exist_ok=True)
    tempfile.tempdir = str(folder / "tmp")
    os.chdir(folder)
    warnings.simplefilter("ignore")
    out = os.fdopen(os.dup(1), "w", buffering=1)
    with open(os.devnull, "w") as nothing:
        os.dup2(nothing.fileno(), 1)
        os.dup2(nothing.fileno(), 2)
    _read_once(name, Path(seeds) / name)
    limit_memory()
    watch = Watch(folder, (str(ROOT / "pipeline"),), name == "config", CHILDREN)
    at = os.open(folder / "at", os.O_RDWR | os.O_CREAT)
    for number in range(int(first), int(last)):
        os.pwrite(at, b"%-20d" % number, 0)
        if fault := _fault(group, number, group.case(int(seed), number), folder, watch, number == int(fatal)):
            print(json.dumps({"number": number, "fault": fault}), file=out)
    os.pwrite(at, b"%-20d" % int(last), 0)


def _read_once(name: str, seeds: Path) -> None:
    """Every sound file, so that what they import is there before memory is limited."""
    for path in sorted(seeds.iterdir()):
        with contextlib.suppress(Exception):
            READERS[name](path, 1, **({} if name == "config" else {"sandboxed": False}))


def _fault(group: Group, number: int, case: Case, folder: Path, watch: Watch, sandboxed: bool) -> str | None:
    """What is wrong with reading it; sandboxed: in the product's child process at once, since this one did not survive it."""
    path = folder / case.name
    path.write_bytes(case.content)
    watch.found.clear()
    watch.on = True
    # The child process costs half a second: it is spared where all goes well without, but for one file of two hundred.
    here = group.name != "config" and not sandboxed and case.choice % 200 > 0
    read = partial(READERS[group.name], sandboxed=False) if here else READERS[group.name]
    if here and path.suffix in HDF5:
        fault = _in_a_fork(read, path, case.choice, watch)
    else:
        fault = _said(read, path, case.choice, SECONDS / 5 if here else SECONDS)
    if here and fault and OUTSIDE not in fault:
        fault = _said(READERS[group.name], path, case.choice)
    watch.on = False
    if not fault and watch.found:
        fault = f"{OUTSIDE}: {watch.found[:3]}"
    if fault:
        kept = folder.parent / "found" / f"{group.name}-{number}"
        kept.mkdir(parents=True, exist_ok=True)
        shutil.copy(path, kept)
    path.unlink(missing_ok=True)
    if group.name == "deck" and path.name in PAIRED:
        shutil.copy(folder / f"part{path.suffix}", path)
    return fault


def _in_a_fork(read: Callable[..., None], path: Path, choice: int, watch: Watch) -> str | None:
    """As `_said`, in a process that the library may end."""
    reading, writing = os.pipe()
    if not (child := os.fork()):
        with contextlib.suppress(BaseException):
            fault = _said(read, path, choice) or (f"{OUTSIDE}: {watch.found[:3]}" if watch.found else "well")
            os.write(writing, fault.encode()[:4000])
        os._exit(0)
    os.close(writing)
    try:
        with soon(SECONDS / 3), os.fdopen(reading, "rb") as pipe:
            said = pipe.read().decode()
    except Hung:
        said = ""
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return None if said == "well" else said or "the process ended"


def _said(read: Callable[..., None], path: Path, choice: int, seconds: float = SECONDS) -> str | None:
    try:
        with soon(seconds):
            return fault_of(read, path, choice)
    except Hung:
        return "no end within ten seconds"


if __name__ == "__main__":
    try:
        main()
    except Exception:
        Path(sys.argv[3], "fault").write_text(traceback.format_exc(), "utf-8")
        raise
