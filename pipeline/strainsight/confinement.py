"""Confine this process to reading: no file changed, no socket opened, no process started, no text executed, nothing unpickled.

A reader of foreign files confines itself before it opens one. An audit hook refuses what Python code asks for, on every system.
On Linux, Landlock and a seccomp filter also refuse it to compiled code. What a kernel does not have is left out.
"""

from __future__ import annotations

import ctypes
import os
import platform
import struct
import sys
from contextlib import suppress
from functools import partial
from typing import Any

_WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND
_FILES = "chflags chmod chown link mkdir remove removexattr rename rmdir setxattr symlink truncate utime"
_PROCESSES = "exec fork forkpty kill killpg posix_spawn spawn startfile system"
_OTHERS = "code.__new__ ctypes.dlopen pickle.find_class pty.spawn signal.pthread_kill sqlite3.connect subprocess.Popen"
_MODULES = "_winapi ftplib http imaplib poplib smtplib socket syslog telnetlib urllib winreg"
_REFUSED = {f"os.{name}" for name in f"{_FILES} {_PROCESSES}".split()} | set(_OTHERS.split())
_REFUSED_MODULES = tuple(f"{name}." for name in _MODULES.split())
"""Events, and the modules whose events all are."""
_IMPORTERS = (
    "_frozen_importlib",
    "_frozen_importlib_external",
    "importlib._bootstrap",
    "importlib._bootstrap_external",
)
_COMPILERS = (*_IMPORTERS, "collections", "dataclasses")
"""Modules that execute code that is imported, and text of their own where a class of theirs is made."""


def confine(folder: str | None = None) -> None:
    """Refuse this process from now on all that a reader does not need. Modules have to be imported before.

    folder: where files may be opened for writing, as a library does that only reads; they are not changed, either.
    What is refused raises PermissionError.
    """
    with suppress(ImportError, OSError, ValueError):
        import resource

        for limit in (resource.RLIMIT_FSIZE, resource.RLIMIT_CORE):
            resource.setrlimit(limit, (0, 0))
    if sys.platform == "linux":
        library = ctypes.CDLL(None, use_errno=True)
        # Without this neither filter is allowed; with it no program gives this process rights that it does not have.
        if library.prctl(_PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) == 0:
            _confine_files(library, folder)
            _confine_calls(library)
    sys.addaudithook(partial(_audit, folder))


def _audit(folder: str | None, event: str, arguments: tuple[Any, ...]) -> None:
    """Raise PermissionError for what a reader does not need. Source: PEP 578; the table of audit events of Python."""
    if event == "open":
        path, _, flags = arguments
        if flags & _WRITING and not _is_writable(path, folder):
            raise PermissionError(f"a reader may not write {path!r}")
    elif event in ("compile", "exec"):
        if sys._getframe(1).f_globals.get("__name__") not in _COMPILERS:
            raise PermissionError(f"a reader may not {event} text")
    elif event in _REFUSED or event.startswith(_REFUSED_MODULES):
        raise PermissionError(f"a reader may not call {event}")


def _is_writable(path: str | bytes | int, folder: str | None) -> bool:
    """Whether it is open already, the null device, or in the folder."""
    if isinstance(path, int) or path == os.devnull:
        return True
    return folder is not None and os.path.dirname(os.path.realpath(os.fsdecode(path))) == os.path.realpath(folder)


_PR_SET_NO_NEW_PRIVS, _PR_SET_SECCOMP, _SECCOMP_MODE_FILTER = 38, 22, 2
_LANDLOCK_CREATE_RULESET, _LANDLOCK_ADD_RULE, _LANDLOCK_RESTRICT_SELF = 444, 445, 446
"""System calls, of the same number on every machine."""
_LANDLOCK_VERSION, _PATH_BENEATH = 1, 1
_WRITE_FILE, _READ_FILE, _READ_DIR, _REFER, _TRUNCATE, _IOCTL_DEV = (1 << bit for bit in (1, 2, 3, 13, 14, 15))


def _confine_files(library: Any, folder: str | None) -> None:
    """Landlock: no file is made, removed or executed, none opened for writing but the null device and those of the folder.

    Source: linux/landlock.h, versions 1 to 7.
    """
    version = library.syscall(_LANDLOCK_CREATE_RULESET, None, ctypes.c_size_t(0), _LANDLOCK_VERSION)
    if version < 1:
        return
    known = (1 << 13) - 1
    for since, right in ((2, _REFER), (3, _TRUNCATE), (5, _IOCTL_DEV)):
        known |= right if version >= since else 0
    files = known & ~(_READ_FILE | _READ_DIR)
    network = 0b11 if version >= 4 else 0  # bind and connect by TCP
    scoped = 0b11 if version >= 6 else 0  # abstract sockets and signals of other processes
    rules = struct.pack("QQQ", files, network, scoped)[: 8 if version < 4 else 16 if version < 6 else 24]
    ruleset = library.syscall(_LANDLOCK_CREATE_RULESET, rules, ctypes.c_size_t(len(rules)), 0)
    if ruleset < 0:
        return
    for path, right in ((os.devnull, _WRITE_FILE | _TRUNCATE), (folder, _WRITE_FILE)):
        if path is not None:
            place = os.open(path, getattr(os, "O_PATH", 0))
            library.syscall(_LANDLOCK_ADD_RULE, ruleset, _PATH_BENEATH, struct.pack("=Qi", files & right, place), 0)
            os.close(place)
    library.syscall(_LANDLOCK_RESTRICT_SELF, ruleset, 0)
    os.close(ruleset)


_MACHINES = {"x86_64": 0xC000003E, "aarch64": 0xC00000B7}
"""Machine → its number in a filter (AUDIT_ARCH)."""
_CALLS = {
    # sockets
    "socket": (41, 198),
    "socketpair": (53, 199),
    "connect": (42, 203),
    "bind": (49, 200),
    "listen": (50, 201),
    "sendto": (44, 206),
    "sendmsg": (46, 211),
    # processes: other programs, copies, and the memory of others
    "execve": (59, 221),
    "execveat": (322, 281),
    "fork": (57, None),
    "vfork": (58, None),
    "kill": (62, 129),
    "tkill": (200, 130),
    "tgkill": (234, 131),
    "rt_sigqueueinfo": (129, 138),
    "rt_tgsigqueueinfo": (297, 240),
    "pidfd_open": (434, 434),
    "pidfd_send_signal": (424, 424),
    "pidfd_getfd": (438, 438),
    "ptrace": (101, 117),
    "process_vm_readv": (310, 270),
    "process_vm_writev": (311, 271),
    # what Landlock does not refuse: owners, rights, times and attributes of files; ways round a filter; the kernel
    "chmod": (90, None),
    "fchmod": (91, 52),
    "fchmodat": (268, 53),
    "fchmodat2": (452, 452),
    "chown": (92, None),
    "fchown": (93, 55),
    "lchown": (94, None),
    "fchownat": (260, 54),
    "utime": (132, None),
    "utimes": (235, None),
    "futimesat": (261, None),
    "utimensat": (280, 88),
    "setxattr": (188, 5),
    "lsetxattr": (189, 6),
    "fsetxattr": (190, 7),
    "removexattr": (197, 14),
    "lremovexattr": (198, 15),
    "fremovexattr": (199, 16),
    "io_uring_setup": (425, 425),
    "userfaultfd": (323, 282),
    "bpf": (321, 280),
    "perf_event_open": (298, 241),
    "add_key": (248, 217),
    "keyctl": (250, 219),
    "unshare": (272, 97),
    "setns": (308, 268),
    "mount": (165, 40),
    "shmget": (29, 194),
    "msgget": (68, 186),
    "mq_open": (240, 180),
}
"""System calls that are refused, by their numbers on either machine."""
_CLONE, _CLONE3 = (56, 220), (435, 435)
_CLONE_THREAD = 0x10000
_SECCOMP_CALL, _SECCOMP_SET_FILTER, _ALL_THREADS = (317, 277), 1, 1
_LOAD, _EQUAL, _ABOVE, _ANY_BIT, _RETURN = 0x20, 0x15, 0x35, 0x45, 0x06
"""Operations of a filter (BPF): load a word; jump where equal, at least, any bit set; return."""
_NUMBER_AT, _MACHINE_AT, _FIRST_ARGUMENT_AT = 0, 4, 16
_ALLOW, _KILL, _ERROR = 0x7FFF0000, 0x80000000, 0x00050000
_EPERM, _ENOSYS = 1, 38
_OTHER_SYSTEM = 0x40000000
"""Calls from here on belong to x32, whose numbers would pass."""


def _confine_calls(library: Any) -> None:
    """seccomp: the calls above fail with EPERM. Source: linux/seccomp.h, linux/filter.h."""
    machine = platform.machine()
    if machine not in _MACHINES or sys.byteorder != "little" or sys.maxsize < 1 << 32:
        return
    column = list(_MACHINES).index(machine)
    program = [
        (_LOAD, 0, 0, _MACHINE_AT),
        (_EQUAL, 1, 0, _MACHINES[machine]),
        (_RETURN, 0, 0, _KILL),
        (_LOAD, 0, 0, _NUMBER_AT),
        (_ABOVE, 0, 1, _OTHER_SYSTEM),
        (_RETURN, 0, 0, _ERROR | _EPERM),
        # glibc then starts threads by clone, whose flags a filter can see
        (_EQUAL, 0, 1, _CLONE3[column]),
        (_RETURN, 0, 0, _ERROR | _ENOSYS),
    ]
    for numbers in _CALLS.values():
        if (number := numbers[column]) is not None:
            program += [(_EQUAL, 0, 1, number), (_RETURN, 0, 0, _ERROR | _EPERM)]
    program += [
        (_EQUAL, 0, 3, _CLONE[column]),
        (_LOAD, 0, 0, _FIRST_ARGUMENT_AT),
        (_ANY_BIT, 1, 0, _CLONE_THREAD),
        (_RETURN, 0, 0, _ERROR | _EPERM),
        (_RETURN, 0, 0, _ALLOW),
    ]
    code = ctypes.create_string_buffer(b"".join(struct.pack("=HBBI", *step) for step in program))
    pointer = ctypes.create_string_buffer(struct.pack("@HP", len(program), ctypes.addressof(code)))
    if library.syscall(_SECCOMP_CALL[column], _SECCOMP_SET_FILTER, _ALL_THREADS, pointer) != 0:
        library.prctl(_PR_SET_SECCOMP, _SECCOMP_MODE_FILTER, pointer, 0, 0)
