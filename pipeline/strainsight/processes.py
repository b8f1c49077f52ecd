"""Processes that this one starts, and that none outlives it. What a system other than Linux cannot do is left out.

A reader of foreign files confines itself before it opens one. An audit hook refuses what Python code asks for, on every system.
On Linux, Landlock and a seccomp filter also refuse it to compiled code. What a kernel does not have is left out."""

from __future__ import annotations

import ctypes
import json
import os
import platform
import signal
import struct
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import partial
from importlib import import_module
from pathlib import Path
from threading import Event, Thread
from typing import IO, Any, Protocol, TypeVar

from strainsight.imports import FOLDER

_WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND
_FILES = (
    "os.chflags os.chmod os.chown os.link os.mkdir os.remove os.removexattr os.rename os.rmdir os.setxattr os.symlink "
    "os.truncate os.utime"
)
_PROCESSES = "os.exec os.fork os.forkpty os.kill os.killpg os.posix_spawn os.spawn os.startfile os.system"
_OTHERS = "code.__new__ ctypes.dlopen pickle.find_class pty.spawn signal.pthread_kill sqlite3.connect subprocess.Popen"
_REFUSED = set(f"{_FILES} {_PROCESSES} {_OTHERS}".split())
_MAIL = ("imaplib.", "poplib.", "smtplib.")
_REFUSED_MODULES = ("_winapi.", "ftplib.", "http.", *_MAIL, "socket.", "syslog.", "telnetlib.", "urllib.", "winreg.")
"""Events, and the modules whose events all are."""
_IMPORTERS = (
    "_frozen_importlib",
    "_frozen_importlib_external",
    "importlib._bootstrap",
    "importlib._bootstrap_external",
)
_COMPILERS = (*_IMPORTERS, "collections", "dataclasses")
"""Modules that execute imported code, or code in text."""


def confine(folder: str | None = None) -> None:
    """Refuse this process from now on all that a reader does not need. Modules have to be imported before.

    folder: where files may be opened for writing, as a library does that only reads; they are not changed, either.
    What is refused raises PermissionError."""
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
            raise PermissionError(f"the library that reads the file tried to write {path!r}; this is not permitted")
    elif event in ("compile", "exec"):
        if sys._getframe(1).f_globals.get("__name__") not in _COMPILERS:
            raise PermissionError(
                f"the library that reads the file tried to {event} Python code; this is not permitted"
            )
    elif event in _REFUSED or event.startswith(_REFUSED_MODULES):
        raise PermissionError(f"the library that reads the file tried to call {event}; this is not permitted")


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
    Source: linux/landlock.h, versions 1 to 7."""
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


T = TypeVar("T")
SAFE_PATH = "PYTHONSAFEPATH"
"""Python's -P for a process and all that it starts."""
PR_SET_PDEATHSIG = 1
START_LIMIT = 120.0
"""[s] until a reader is there, on a machine that is busy."""
PROC = Path("/proc")
PS_LIMIT = 2.0
"""[s] for a list of all processes."""
READY = b"ready\n"
LONGER = 10.0
"""By the clock a reader may take so many times its limit of processor time: others use the machine, and disks are slow."""
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMEXPR_NUM_THREADS")
"""Variables of a reader, which is one thread: it computes nothing, and Landlock does not confine threads that run already."""
LOOK = 0.1
"""[s] between two looks at what a reader has used."""


def python(module: str) -> list[str]:
    """The command that runs a module of this package. -P: no module of the working folder, as SAFE_PATH."""
    return [sys.executable, "-P", "-m", module]


def inherited() -> dict[str, str]:
    """The environment of this process, in which a child finds this package and no module of the working folder, for which an
    empty entry of PYTHONPATH stands."""
    paths = [str(FOLDER.parent), *filter(None, os.environ.get("PYTHONPATH", "").split(os.pathsep))]
    return {**os.environ, SAFE_PATH: "1", "PYTHONPATH": os.pathsep.join(map(os.path.abspath, paths))}


@contextmanager
def safe_path() -> Iterator[None]:
    """Processes that libraries start meanwhile import no module of the working folder."""
    before = os.environ.get(SAFE_PATH)
    os.environ[SAFE_PATH] = "1"
    try:
        yield
    finally:
        if before is None:
            del os.environ[SAFE_PATH]
        else:
            os.environ[SAFE_PATH] = before


class Within(Protocol):
    """within(limit, read) is what `read` makes of a reader's answer, which ends after limit [s] of processor time, and
    LONGER times that by the clock, at the latest."""

    def __call__(self, limit: float, read: Callable[[IO[bytes]], T]) -> T: ...


@contextmanager
def reader(command: Sequence[str], request: Any, start_limit: float) -> Iterator[Within]:
    """A child process that reads a file which may crash it, or hold it for ever: both cost the file and not the run.

    `request` goes there as JSON, and `receive_request` takes it. A process that crashes, is not ready within start_limit [s],
    or is killed at the limit of `Within`, answers no more."""
    process = subprocess.Popen(
        command,
        env=inherited() | dict.fromkeys(THREADS, "1"),
        cwd=FOLDER,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
    )
    assert process.stdin is not None
    assert process.stdout is not None
    answer = process.stdout

    def within(limit: float, read: Callable[[IO[bytes]], T]) -> T:
        done = Event()
        watching = Thread(target=_end_at, args=(process, limit, done), daemon=True)
        watching.start()
        try:
            return read(answer)
        finally:
            done.set()
            watching.join()

    with process:
        try:
            with suppress(BrokenPipeError), process.stdin:
                process.stdin.write(json.dumps([os.getcwd(), request]).encode())
            if within(start_limit / LONGER, lambda stream: stream.readline()) != READY:
                process.kill()
                answer.read()
            yield within
        finally:
            process.kill()


def _end_at(process: subprocess.Popen[bytes], limit: float, done: Event) -> None:
    """End a process after limit [s] of processor time, or LONGER times that by the clock; only the second if processor time is
    unknown."""
    used, started = _used(process.pid), time.monotonic()
    while not done.wait(min(LOOK, limit)):
        if _used(process.pid) - used > limit or time.monotonic() - started > LONGER * limit:
            process.kill()
            return


def _used(pid: int) -> float:
    """Processor time of a process [s], 0 where the system does not say."""
    with suppress(OSError, ValueError, IndexError):
        fields = (PROC / str(pid) / "stat").read_bytes().rpartition(b")")[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
    return 0.0


def receive_request(*modules: str, writable: Callable[[Any], str] | None = None) -> Any:
    """In the child process of `reader`: the request.

    The modules are imported first, which no limit counts, away from the parent's working folder, whose settings they do not
    read; from then on the process is confined to reading. writable: request → the folder of `confine`."""
    end_with_parent()
    folder, request = json.loads(sys.stdin.read())
    for module in modules:
        import_module(module)
    os.chdir(folder)
    confine(writable(request) if writable else None)
    sys.stdout.buffer.write(READY)
    sys.stdout.buffer.flush()
    return request


def limit_memory(more: int) -> None:
    """Limit the additional memory of this process, if the system permits."""
    with suppress(ImportError, OSError, ValueError):
        import resource

        used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        hard = resource.getrlimit(resource.RLIMIT_AS)[1]
        most = used + more
        resource.setrlimit(resource.RLIMIT_AS, (most if hard == resource.RLIM_INFINITY else min(most, hard), hard))


def peak_memory(children: bool = False) -> int | None:
    """The most memory that this process has held, or the largest of its children that have ended [bytes]; None where the system
    does not say (Windows)."""
    try:
        import resource
    except ImportError:
        return None
    unit = 1 if sys.platform == "darwin" else 1024
    return unit * resource.getrusage(resource.RUSAGE_CHILDREN if children else resource.RUSAGE_SELF).ru_maxrss


def end_with_parent() -> None:
    """In a child process: the kernel ends it with the thread that started it, however that ends."""
    if sys.platform == "linux":
        with suppress(OSError, AttributeError):
            ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)


def end_children() -> None:
    """Ask every process that this one has started, and those that they have, to end.

    By SIGTERM: Python's resource tracker does not listen to that. It ends by itself with the last of the others and removes
    what they left in shared memory."""
    parents = _parents()
    for pid in parents:
        above = parents.get(pid)
        while above is not None and above != os.getpid():
            above = parents.get(above)
        if above is not None:
            with suppress(OSError):
                os.kill(pid, signal.SIGTERM)


def _parents() -> dict[int, int]:
    """Process → the one that started it, of all processes of this machine; none on Windows, where Ctrl-C reaches all processes of
    the console by itself."""
    if not (PROC / "self/stat").exists() and os.name == "posix":  # macOS
        listed = subprocess.run(["ps", "-A", "-o", "pid=,ppid="], capture_output=True, text=True, timeout=PS_LIMIT)
        return {int(pid): int(parent) for pid, parent in map(str.split, listed.stdout.splitlines())}
    parents = {}
    for stat in PROC.glob("[0-9]*/stat"):
        with suppress(OSError, ValueError, IndexError):
            # pid (name) state parent …: a name may hold anything, also brackets.
            parents[int(stat.parent.name)] = int(stat.read_bytes().rpartition(b")")[2].split()[1])
    return parents
