"""One run at a time on one results folder, and one process at a time on one result."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from strainsight.errors import UserError
from strainsight.file_lock import lock_byte, lock_file
from strainsight.writing import make_folder, open_file

NAME = ".lock"
COMPUTING = ".computing"


@contextmanager
def locked(folder: Path) -> Iterator[int | None]:
    """Hold the lock of `folder` (made if need be); yields the pid of a run that died with the lock in hand, else None.

    The kernel drops the lock with the process that holds it, so that a killed run never blocks the next one.
    Raises UserError naming the process that holds it.
    """
    make_folder(folder)
    handle = _acquire(folder / NAME)
    try:
        left_by = _pid(handle)
        with suppress(OSError):  # a full disk: the lock holds without the name of who holds it
            os.ftruncate(handle, 0)
            os.lseek(handle, 0, os.SEEK_SET)
            os.write(handle, f"{os.getpid()}\n".encode())
        yield left_by
    finally:
        removed = _removed(folder / NAME)
        os.close(handle)
        if not removed:
            _removed(folder / NAME)


@contextmanager
def computing(results: Path, key: str, waits: Callable[[], None] = lambda: None) -> Iterator[None]:
    """Wait until no other process computes the stage of this key (hex sha256), and hold others off meanwhile.

    A byte of one file in `results` stands for the key; the kernel drops the lock with the process. waits: called where
    there is another one to wait for. On a disk without locks nobody waits: at worst the same is computed twice.
    """
    results.mkdir(parents=True, exist_ok=True)
    handle = open_file(results / COMPUTING, os.O_RDWR)
    byte = int(key[:15], 16)
    try:
        with suppress(OSError):
            try:
                lock_byte(handle, byte, wait=False)
            except BlockingIOError:
                waits()
                lock_byte(handle, byte, wait=True)
        yield
    finally:
        os.close(handle)


def _acquire(path: Path) -> int:
    while True:
        handle = open_file(path, os.O_RDWR)
        try:
            lock_file(handle, wait=False)
        except BlockingIOError:
            pid = _pid(handle)
            os.close(handle)
            raise UserError(
                f"another run{f' (process {pid})' if pid else ''} is writing to this folder",
                where=str(path.parent),
                remedy="wait until it has ended, or give another folder with --results DIR",
            ) from None
        # The holder before us may have removed the file between our open and our lock: then we hold a lock on nothing.
        try:
            if os.stat(path).st_ino == os.fstat(handle).st_ino:
                return handle
        except FileNotFoundError:
            pass
        os.close(handle)


def _removed(path: Path) -> bool:
    """Whether the file is gone: Windows keeps what is open, here or by another run that has just come; a folder may have become
    read-only."""
    with suppress(OSError):
        path.unlink(missing_ok=True)
        return True
    return False


def _pid(handle: int) -> int | None:
    os.lseek(handle, 0, os.SEEK_SET)
    text = os.read(handle, 32).decode(errors="replace").strip()
    return int(text) if text.isdigit() else None
