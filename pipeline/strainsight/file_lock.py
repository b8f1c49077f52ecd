"""Locks on open files that the system drops with the process that holds them: POSIX, Windows, and none where neither is there."""

from __future__ import annotations

import os
import time
from importlib import import_module
from types import ModuleType


def _module(name: str) -> ModuleType | None:
    try:
        return import_module(name)
    except ImportError:
        return None


fcntl, msvcrt = _module("fcntl"), _module("msvcrt")
"""Lock modules of POSIX and of Windows."""
FIRST_BYTE = 1 << 30
"""Windows holds others off a locked byte: beyond all that is written, so that everybody can read who holds the lock. It counts
bytes to 2³¹."""
AGAIN = 0.1
"""[s] Windows has no wait without an end."""


def lock_file(handle: int, wait: bool) -> None:
    """Hold an open file until it is closed. Raises BlockingIOError where another holds it and `wait` is false, OSError on a disk
    without locks. A Python without either kind of lock holds nobody off."""
    if fcntl is not None:
        fcntl.flock(handle, fcntl.LOCK_EX if wait else fcntl.LOCK_EX | fcntl.LOCK_NB)
    elif msvcrt is not None:
        _windows(msvcrt, handle, FIRST_BYTE, wait)


def lock_byte(handle: int, byte: int, wait: bool) -> None:
    """The same for one byte of the file, 0 ≤ byte < 2⁶⁰; on Windows for one of 2³⁰, which two bytes may share."""
    if fcntl is not None:
        try:
            fcntl.lockf(handle, fcntl.LOCK_EX if wait else fcntl.LOCK_EX | fcntl.LOCK_NB, 1, byte)
        except PermissionError as error:  # which of the two is the system's choice
            raise BlockingIOError(*error.args) from None
    elif msvcrt is not None:
        _windows(msvcrt, handle, FIRST_BYTE + byte % FIRST_BYTE, wait)


def _windows(msvcrt: ModuleType, handle: int, byte: int, wait: bool) -> None:
    while True:
        try:
            os.lseek(handle, byte, os.SEEK_SET)
            msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)
        except PermissionError as error:
            if not wait:
                raise BlockingIOError(*error.args) from None
            time.sleep(AGAIN)
        else:
            return
