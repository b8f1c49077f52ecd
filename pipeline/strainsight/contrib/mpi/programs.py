"""Which launcher of MPI and which Python: from the environment alone, so that no file of a stranger names a program to run."""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from strainsight.errors import UserError
from strainsight.processes import SAFE_PATH

LAUNCHER, PYTHON = "STRAINSIGHT_MPI", "STRAINSIGHT_MPI_PYTHON"
"""Variables of the environment: the launcher with its options; the interpreter that has petsc4py and slepc4py."""
DEFAULT_LAUNCHER = "mpiexec"
DEBIAN_PYTHON = Path("/usr/bin/python3")
DEBIAN_PACKAGES = (
    "usr/lib/petscdir/petsc*/*-real/lib/python3/dist-packages",
    "usr/lib/slepcdir/slepc*/*-real/lib/python3/dist-packages",
)
"""Where Debian's python3-slepc4py has them, whichever build the system's alternatives point to."""
LACKING = (
    "import sys; sys.path[:] = filter(None, sys.path); import importlib.util as u; "
    "print(*(m for m in ('numpy', 'petsc4py', 'slepc4py') if u.find_spec(m) is None))"
)
"""What is asked of an interpreter, which may be older than -P and PYTHONSAFEPATH: "" stands for the working folder."""
LIMIT = 60.0
"""[s] for an interpreter to say what it lacks."""
WHERE = "apt install python3-slepc4py, or pip install 'strainsight[mpi]'"


@dataclass(frozen=True)
class Programs:
    """launcher: a command and its options; python: an interpreter; environment of both."""

    launcher: tuple[str, ...]
    python: str
    environment: Mapping[str, str]


def programs(environment: Mapping[str, str] = os.environ) -> Programs:
    """Raises UserError on Windows, where the launcher is not there, or an interpreter lacks petsc4py or slepc4py."""
    if os.name == "nt":
        raise UserError("solver: slepc is for Linux and macOS", key="solver", remedy="solver: direct")
    launcher = _launcher(environment)
    # one thread a process: the processes are the parallelism
    own = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", **environment, SAFE_PATH: "1"}
    given = environment.get(PYTHON)
    tried = []
    for python, added in [(given, ())] if given else [(sys.executable, ()), *_debian()]:
        paths = os.pathsep.join(filter(None, (*added, *own.get("PYTHONPATH", "").split(os.pathsep))))
        found = Programs(launcher, python, {**own, "PYTHONPATH": paths} if paths else own)
        lacks = _lacking(found)
        if not lacks:
            return found
        tried.append(f"{python} lacks {lacks}")
    raise UserError(
        f"no Python that has petsc4py and slepc4py: {'; '.join(tried)}",
        key="solver",
        remedy=f"{WHERE}; another interpreter: export {PYTHON}=/path/to/python; or solver: direct",
    )


def _launcher(environment: Mapping[str, str]) -> tuple[str, ...]:
    stated = environment.get(LAUNCHER) or DEFAULT_LAUNCHER
    try:
        launcher = tuple(shlex.split(stated))
    except ValueError as error:
        raise UserError(
            f"{LAUNCHER}={stated!r} is no command: {error}", key="solver", remedy="close its quotes"
        ) from None
    if not launcher or shutil.which(launcher[0], path=environment.get("PATH")) is None:
        raise UserError(
            f"there is no program {launcher[0] if launcher else stated}, the launcher of MPI",
            key="solver",
            remedy=f"install an MPI (Debian: apt install openmpi-bin), or name its launcher: export {LAUNCHER}='mpiexec -n 4'; "
            "or solver: direct",
        )
    return launcher


def _debian() -> list[tuple[str, tuple[str, ...]]]:
    if not DEBIAN_PYTHON.exists():
        return []
    folders = (sorted(Path("/").glob(pattern)) for pattern in DEBIAN_PACKAGES)
    return [(str(DEBIAN_PYTHON), tuple(str(own[-1]) for own in folders if own))]


def _lacking(own: Programs) -> str:
    """The packages that the interpreter lacks; why it does not run, where it does not."""
    try:
        asked = subprocess.run(
            [own.python, "-c", LACKING], env=dict(own.environment), capture_output=True, text=True, timeout=LIMIT
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        return f"everything ({error})"
    return " and ".join(asked.stdout.split()) if asked.returncode == 0 else f"everything (exit code {asked.returncode})"
