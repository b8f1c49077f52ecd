"""A factor that lies in the processes of MPI, as a `Factor`.

Matrices, right-hand sides and results go by files of a private folder; every process reads its own rows of them:

    A.indptr.npy, A.indices.npy, A.data.npy     the upper triangle, CSR; likewise M
    request-N.json, answer-N.json               what is asked, and the answer of the first process
"""

from __future__ import annotations

import json
import os
import shlex
import shutil
import subprocess
import sys
import time
import weakref
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy import sparse

from strainsight.contrib.mpi.supervisor import END, ENDED, SAID
from strainsight.errors import NumericalError, UserError
from strainsight.fem.factorisation import MECHANISM, NOT_DEFINITE, Factor, diagonal_scaling, scaled_upper
from strainsight.memory import GIB, SMALLER, available_memory
from strainsight.processes import SAFE_PATH, inherited
from strainsight.processes import python as command_of

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
"""Code that prints the missing packages of an interpreter, which may be older than -P and PYTHONSAFEPATH; "" is the working
folder."""
LIMIT = 60.0
"""[s] for an interpreter to report its missing packages."""
WHERE = "install SLEPc: apt install python3-slepc4py, or pip install 'strainsight[mpi]'"


@dataclass(frozen=True)
class Programs:
    """launcher: a command and its options; python: an interpreter; environment of both."""

    launcher: tuple[str, ...]
    python: str
    environment: Mapping[str, str]


def programs(environment: Mapping[str, str] = os.environ) -> Programs:
    """Launcher and interpreter. Raises UserError on Windows, without a launcher, or without petsc4py and slepc4py."""
    if os.name == "nt":
        raise UserError("solver: slepc is available on Linux and macOS only", key="solver", remedy="set solver: direct")
    launcher = _launcher(environment)
    # one thread a process: the processes are the parallelism
    variables = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", **environment, SAFE_PATH: "1"}
    configured = environment.get(PYTHON)
    tried = []
    for python, added in [(configured, ())] if configured else [(sys.executable, ()), *_debian()]:
        paths = os.pathsep.join(filter(None, (*added, *variables.get("PYTHONPATH", "").split(os.pathsep))))
        candidate = Programs(launcher, python, {**variables, "PYTHONPATH": paths} if paths else variables)
        if not (lacks := _lacking(candidate)):
            return candidate
        tried.append(f"{python}: {lacks}")
    raise UserError(
        f"no Python with petsc4py and slepc4py found: {'; '.join(tried)}",
        key="solver",
        remedy=f"{WHERE}; or select another interpreter: export {PYTHON}=/path/to/python; or set solver: direct",
    )


def _launcher(environment: Mapping[str, str]) -> tuple[str, ...]:
    command = environment.get(LAUNCHER) or DEFAULT_LAUNCHER
    try:
        launcher = tuple(shlex.split(command))
    except ValueError as error:
        raise UserError(
            f"{LAUNCHER}={command!r} is not a valid command: {error}",
            key="solver",
            remedy=f"correct the quotes and backslashes in {LAUNCHER}",
        ) from None
    if not launcher or shutil.which(launcher[0], path=environment.get("PATH")) is None:
        raise UserError(
            f"the MPI launcher {launcher[0] if launcher else command} was not found",
            key="solver",
            remedy=f"install an MPI (Debian: apt install openmpi-bin), or set its launcher: export {LAUNCHER}='mpiexec -n 4'; "
            "or set solver: direct",
        )
    return launcher


def _debian() -> list[tuple[str, tuple[str, ...]]]:
    if not DEBIAN_PYTHON.exists():
        return []
    folders = (sorted(Path("/").glob(pattern)) for pattern in DEBIAN_PACKAGES)
    return [(str(DEBIAN_PYTHON), tuple(str(folder[-1]) for folder in folders if folder))]


def _lacking(programs: Programs) -> str:
    """Missing packages of the interpreter, or why it does not run."""
    try:
        process = subprocess.run(
            [programs.python, "-c", LACKING],
            env=dict(programs.environment),
            capture_output=True,
            text=True,
            timeout=LIMIT,
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        return f"the interpreter does not run ({error})"
    return (
        ", ".join(f"no {package}" for package in process.stdout.split())
        if process.returncode == 0
        else f"the interpreter does not run (exit code {process.returncode})"
    )


WORKER = Path(__file__).with_name("worker.py")
START_LIMIT = 120.0
"""[s] until the processes are connected."""
SHORT, LONG = 0.001, 0.02
"""[s] between two looks for an answer."""
TAIL = 6
"""Lines of the MPI output that an error repeats."""
CONVERGED, RESTARTS = 1e-14, 1000
"""Krylov-Schur iterations: relative residual, and most restarts."""
KILLED = 128 + 9
FAILURE = "failure.json"
"""Error of a single process."""


@dataclass(frozen=True)
class OverMpi:
    """Factorise by MUMPS in MPI processes; say: receives a sentence about each factorisation."""

    say: Callable[[str], None] = lambda text: None

    def __call__(self, A: sparse.csr_array) -> Factor:
        """A = LLᵀ as `fem.factorisation.factorise`, scaled likewise, with `lowest` for modes. Raises NumericalError if A is
        not positive definite or a process dies, UserError if MPI, PETSc or SLEPc are missing, incompatible, or have too
        little memory."""
        scale = diagonal_scaling(A)
        session = _Session(programs())
        try:
            mpi = session.start()
            session.matrix("A", scaled_upper(A, scale))
            memory = available_memory()
            answer = session.ask("factorise", memory=0 if np.isinf(memory) else memory)
        except BaseException:
            session.close()
            raise
        self.say(
            f"SLEPc {mpi['slepc']} with MUMPS in {mpi['processes']} processes: the factorisation with {A.shape[0]} "
            f"degrees of freedom used {answer['memory'] * 1e6 / GIB:.3g} GiB of memory in total"
        )
        return _factor(session, scale)


def _factor(session: _Session, scale: np.ndarray) -> Factor:
    mass: list[sparse.csr_array] = []

    def solve(B: np.ndarray) -> np.ndarray:
        right, into = session.array(scale[:, None] * B), session.room(B.shape[1], len(B))
        session.ask("solve", of=right, into=into)
        return scale[:, None] * session.read_columns(right, into)

    def lowest(
        M: sparse.csr_array, count: int, basis: int, start: np.ndarray, known: np.ndarray, tolerance: float
    ) -> tuple[np.ndarray, np.ndarray]:
        if not mass or mass[0] is not M:
            if mass:
                raise ValueError(
                    "the mass matrix differs from that of the first modes; factorise the stiffness matrix again"
                )
            session.matrix("M", scaled_upper(M, scale))
            mass.append(M)
        first, into = session.array((start / scale)[:, None]), session.room(count, len(start))
        known_columns = session.array(known / scale[:, None]) if known.shape[1] else ""
        limits = {"tolerance": max(tolerance, CONVERGED), "restarts": RESTARTS}
        answer = session.ask("lowest", count=count, basis=basis, start=first, known=known_columns, into=into, **limits)
        return np.array(answer["values"]), scale[:, None] * session.read_columns(first, known_columns, into)

    weakref.finalize(solve, session.close)
    return Factor(len(scale), "MUMPS", solve, lowest)


class _Session:
    """MPI processes and their folder, until `close`."""

    def __init__(self, programs: Programs):
        self.programs, self.requests, self.written, self.started = programs, 0, 0, False
        self.process = subprocess.Popen(
            command_of("strainsight.contrib.mpi.supervisor"),
            env=inherited(),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
        )
        assert self.process.stdout is not None
        self.folder = Path(self.process.stdout.readline().decode().rstrip("\n"))

    def start(self) -> dict[str, Any]:
        """Start the processes and return their description. Raises UserError if they do not start or are not suitable."""
        assert self.process.stdin is not None
        command = [*self.programs.launcher, self.programs.python, str(WORKER)]
        self.process.stdin.write(json.dumps([command, dict(self.programs.environment)]).encode() + b"\n")
        self.process.stdin.flush()
        mpi = self._wait("hello.json", START_LIMIT)
        if mpi["launched"] != mpi["processes"]:
            raise UserError(
                f"`{' '.join(self.programs.launcher)}` starts {mpi['launched']} processes that are not connected by MPI",
                key="solver",
                remedy=f"use the launcher of the MPI that petsc4py was built with: export {LAUNCHER}=…",
            )
        if mpi["complex"] or not mpi["mumps"]:
            what = "for complex numbers" if mpi["complex"] else "without MUMPS"
            build = "for real numbers" if mpi["complex"] else "with --download-mumps --download-scalapack"
            raise UserError(
                f"PETSc {mpi['petsc']} is built {what}",
                key="solver",
                remedy=f"build PETSc {build}, or select another interpreter: export {PYTHON}=/path/to/python",
            )
        self.started = True
        return mpi

    def matrix(self, name: str, upper: sparse.csr_array) -> None:
        """Write a matrix for the processes."""
        for part in ("indptr", "indices", "data"):
            np.save(self.folder / f"{name}.{part}.npy", getattr(upper, part))

    def ask(self, do: str, **what: Any) -> dict[str, Any]:
        """Send a request to all processes, and return the answer."""
        self._request(do, **what)
        return self._wait(f"answer-{self.requests - 1}.json", np.inf)

    def _request(self, do: str, **what: Any) -> None:
        request = self.folder / f"request-{self.requests}.json"
        request.with_suffix(".tmp").write_text(json.dumps({"do": do, **what}))
        request.with_suffix(".tmp").replace(request)
        self.requests += 1

    def close(self) -> None:
        """End the processes and remove the folder."""
        with suppress(OSError):
            if self.started:
                # before the processes are asked to end, which the supervisor then leaves to them
                (self.folder / END).touch()
                self._request("end")
        with suppress(OSError):
            assert self.process.stdin is not None
            self.process.stdin.close()
        with self.process:  # waits for it
            pass
        shutil.rmtree(self.folder, ignore_errors=True)  # of a supervisor that was killed

    def array(self, columns: np.ndarray) -> str:
        """Write columns (n, k) to a new file, as its rows; return its name."""
        name = self._name()
        np.save(self.folder / name, np.ascontiguousarray(columns.T, dtype=float))
        return name

    def room(self, k: int, n: int) -> str:
        """Create a file for a result (k, n); return its name."""
        name = self._name()
        np.lib.format.open_memmap(self.folder / name, "w+", dtype=float, shape=(k, n)).flush()
        return name

    def _name(self) -> str:
        self.written += 1
        return f"array-{self.written}.npy"

    def read_columns(self, *names: str) -> np.ndarray:
        """Columns (n, k) of the last of these files; all of them are removed."""
        array = np.load(self.folder / names[-1])
        for name in filter(None, names):
            (self.folder / name).unlink()
        return np.asarray(array.T)

    def _wait(self, name: str, limit: float) -> dict[str, Any]:
        """Content of a file as soon as it exists. Raises the error reported by the processes, or the cause of their end."""
        answer, pause, until = self.folder / name, SHORT, time.monotonic() + limit
        while not answer.exists():
            ended = self.process.poll() is not None or (self.folder / ENDED).exists()
            if (ended or (self.folder / FAILURE).exists()) and not answer.exists():
                raise self._failed()
            if time.monotonic() > until:
                raise UserError(
                    f"the processes of `{' '.join(self.programs.launcher)}` were not connected after {limit:g} s"
                    f"{self._last_output()}",
                    key="solver",
                    remedy=f"test the launcher with {self.programs.python} -c 'from slepc4py import SLEPc'; "
                    f"to set another launcher: export {LAUNCHER}='mpiexec -n 4'",
                )
            time.sleep(pause)
            pause = min(1.2 * pause, LONG)
        result: dict[str, Any] = json.loads(answer.read_text())
        if "refused" in result:
            raise self._refused(result)
        return result

    def _refused(self, answer: dict[str, Any]) -> NumericalError | UserError:
        """Error that all processes have in common."""
        kind = answer["refused"]
        if kind == "indefinite":
            return NumericalError(NOT_DEFINITE, remedy=MECHANISM)
        if kind == "converged":
            return NumericalError(
                f"only {answer['found']} modes converged in {answer['iterations']} Krylov-Schur restarts",
                remedy="check the model for nearly unconstrained parts, or reduce the number of modes in the config",
            )
        if kind == "memory":
            figure = f" (estimated: {answer['estimate'] * 1e6 / GIB:.3g} GiB)" if "estimate" in answer else ""
            return UserError(
                f"the MPI processes have too little memory for the factorised matrix{figure}",
                key="solver",
                remedy=f"name more machines in the launcher command (export {LAUNCHER}=…), or {SMALLER}",
            )
        if kind == "indices":
            return UserError(
                f"the part of the matrix on one process is too large for PETSc with 32-bit indices: {answer['text']}",
                key="solver",
                remedy=f"set more processes in the launcher command (export {LAUNCHER}=…), or build PETSc --with-64-bit-indices",
            )
        if text := answer.get("text"):
            return NumericalError(f"an MPI process failed: {text}", key="solver", remedy="set solver: direct")
        text = f"MUMPS stopped with INFOG(1) = {answer['code']}, INFOG(2) = {answer['detail']}"
        return NumericalError(
            text, key="solver", remedy="look up INFOG(1) in the manual of MUMPS, or set solver: direct"
        )

    def _failed(self) -> NumericalError | UserError:
        """Error of processes that ended unexpectedly."""
        failure, ended = self.folder / FAILURE, self.folder / ENDED
        if failure.exists():
            return self._refused(json.loads(failure.read_text()))
        code = json.loads(ended.read_text()) if ended.exists() else self.process.poll()
        what = f"`{' '.join(self.programs.launcher)}` ended with exit code {code}{self._last_output()}"
        if self.started:
            killed = "a process was killed, probably because memory ran out: start" if code == KILLED else "start"
            return NumericalError(
                f"an MPI process died: {what}",
                key="solver",
                remedy=f"{killed} the processes on more machines (export {LAUNCHER}=…), or use a coarser mesh; "
                "or set solver: direct",
            )
        return UserError(
            what,
            key="solver",
            remedy=f"set the launcher and its options in {LAUNCHER}; as root Open MPI needs "
            "OMPI_ALLOW_RUN_AS_ROOT=1 and OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1; more processes than cores need --oversubscribe",
        )

    def _last_output(self) -> str:
        """Last lines printed by the launcher or its processes."""
        try:
            text = (self.folder / SAID).read_text(errors="replace")
        except OSError:
            return ""
        lines = [line.rstrip() for line in text.splitlines() if line.strip(" -")]
        return "".join(f" | {line}" for line in lines[-TAIL:])
