"""One MPI process: it stores its rows of A and M and its part of the factor, and answers requests until it is ended. Runs
under another interpreter than strainsight, with numpy, petsc4py and slepc4py only. Requests and answers are files of the
private working directory (see `session.py`); each process reads and writes only its rows."""

from __future__ import annotations

import json
import os
import sys
import time
import traceback
from typing import Any

# nothing is to be found in the folder of this file, nor in the working folder
HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[:] = [path for path in sys.path if path and os.path.abspath(path) != HERE]

import numpy as np  # noqa: E402

SHORT, LONG = 0.001, 0.01
"""[s] between two checks for a request: processes that wait in MPI would each occupy a core."""
PR_SET_PDEATHSIG, SIGKILL = 1, 9
OUT_OF_MEMORY = (-7, -8, -9, -11, -13, -19, -20, -29)
"""INFOG(1) of MUMPS for too small or unavailable work arrays."""
NEGATIVE_ROOT, NULL_PIVOT = -40, -10
LOCAL = ("OMPI_COMM_WORLD_LOCAL_SIZE", "MPI_LOCALNRANKS")
"""Variables with the number of processes on this machine: Open MPI, MPICH."""
ALL = ("OMPI_COMM_WORLD_SIZE", "PMI_SIZE", "SLURM_STEP_NUM_TASKS")
"""Variables with the total number of processes."""
SHARE = 0.9
"""Share of the available memory."""
PETSC_ERR_MEM = 55
ROOM = 50
"""Per cent that MUMPS may exceed its estimate."""


class Refused(Exception):
    """Error that all processes have in common: kind, and figures for the message."""

    def __init__(self, kind: str, **figures: int):
        super().__init__(kind)
        self.answer = {"refused": kind, **figures}


class Distributed:
    """Matrices and factor, as far as this process stores them."""

    def __init__(self, PETSc: Any, SLEPc: Any):
        self.PETSc, self.SLEPc = PETSc, SLEPc
        self.comm = PETSc.COMM_WORLD
        self.A: Any
        self.ksp: Any
        self.factor: Any
        self.eps: Any
        self.A = self.ksp = self.factor = self.eps = None

    def matrix(self, name: str) -> Any:
        """The upper triangle of a symmetric matrix from its files, distributed by rows."""
        PETSc = self.PETSc
        indptr, indices, data = (np.load(f"{name}.{part}.npy", mmap_mode="r") for part in ("indptr", "indices", "data"))
        n = len(indptr) - 1
        rows = n // self.comm.size + (self.comm.rank < n % self.comm.size)
        first = self.comm.rank * (n // self.comm.size) + min(self.comm.rank, n % self.comm.size)
        pointers = np.asarray(indptr[first : first + rows + 1])
        entries = slice(int(pointers[0]), int(pointers[-1]))
        most = np.iinfo(PETSc.IntType).max
        if pointers[-1] - pointers[0] > most:
            raise OverflowError(f"{pointers[-1] - pointers[0]} matrix entries exceed the limit of {most} per process")
        X = PETSc.Mat().createSBAIJ(
            ((rows, n), (rows, n)),
            1,
            csr=(
                (pointers - pointers[0]).astype(PETSc.IntType),
                np.asarray(indices[entries], dtype=PETSc.IntType),
                np.asarray(data[entries]),
            ),
            comm=self.comm,
        )
        X.setOption(PETSc.Mat.Option.SYMMETRIC, True)
        return X

    def factorise(self, memory: float) -> dict[str, Any]:
        """A = LLᵀ by MUMPS with at most `memory` [bytes] on the machine of the command, 0: no limit."""
        PETSc = self.PETSc
        self.A = self.matrix("A")
        self.A.setOption(PETSc.Mat.Option.SPD, True)
        self.ksp = PETSc.KSP().create(self.comm)
        self.ksp.setOperators(self.A)
        self.ksp.setType(PETSc.KSP.Type.PREONLY)
        pc = self.ksp.getPC()
        pc.setType(PETSc.PC.Type.CHOLESKY)
        pc.setFactorSolverType("mumps")
        pc.setFactorSetUpSolverType()
        self.factor = pc.getFactorMatrix()
        self.factor.setMumpsIcntl(14, ROOM)
        if memory:
            self.factor.setMumpsIcntl(23, share_of(memory, self.comm.size))
        pc.setUp()
        code, estimate = self.factor.getMumpsInfog(1), self.factor.getMumpsInfog(17)
        if code in OUT_OF_MEMORY:
            raise Refused("memory", estimate=estimate)
        if code in (NEGATIVE_ROOT, NULL_PIVOT) or (code >= 0 and self.factor.getMumpsInfog(12) > 0):
            raise Refused("indefinite")
        if code < 0:
            raise Refused("mumps", code=code, detail=self.factor.getMumpsInfog(2))
        return {"memory": self.factor.getMumpsInfog(22)}

    def local_columns(self, file: str, mode: Any) -> Any:
        """Columns of this process in an array (k, n) of a file."""
        first, last = self.A.getOwnershipRange()
        return np.load(file, mmap_mode=mode)[:, first:last]

    def solve(self, request: dict[str, Any]) -> dict[str, Any]:
        """A⁻¹B, B and the result as rows of a file (k, n)."""
        PETSc = self.PETSc
        B = self.local_columns(request["of"], "r")
        rows, k, n = B.shape[1], len(B), self.A.getSize()[0]
        right, solution = (PETSc.Mat().createDense(((rows, n), (PETSc.DECIDE, k)), comm=self.comm) for _ in range(2))
        right.setUp()
        solution.setUp()
        right.getDenseArray()[:] = B.T
        right.assemble()
        solution.assemble()
        self.factor.matSolve(right, solution)
        self.write_columns(request["into"], solution.getDenseArray(readonly=True).T)
        right.destroy()
        solution.destroy()
        return {}

    def write_columns(self, file: str, rows: np.ndarray) -> None:
        """Write the columns of this process of rows (k, n)."""
        into = self.local_columns(file, "r+")
        into[:] = rows
        into.base.flush()

    def lowest(self, request: dict[str, Any]) -> dict[str, Any]:
        """A φ = λ M φ for the lowest λ, M-orthogonal to the known vectors of a file; φᵀMφ = 1."""
        eps, count = self.iterations(), request["count"]
        eps.setDimensions(count, request["basis"])
        eps.setTolerances(request["tolerance"], request["restarts"])
        known = [self.vector(row) for row in self.local_columns(request["known"], "r")] if request["known"] else []
        eps.setDeflationSpace(known)
        start = self.vector(self.local_columns(request["start"], "r")[0])
        eps.setInitialSpace([start])
        eps.solve()
        if eps.getConverged() < count:
            raise Refused("converged", found=eps.getConverged(), iterations=eps.getIterationNumber())
        values, shapes, phi = [], [], self.A.createVecRight()
        for i in range(count):
            values.append(eps.getEigenpair(i, phi).real)
            shapes.append(phi.getArray().copy())
        self.write_columns(request["into"], np.array(shapes))
        for vector in (*known, start, phi):
            vector.destroy()
        return {"values": values}

    def iterations(self) -> Any:
        """SLEPc solver, created once: each new one factorises again."""
        if self.eps is None:
            SLEPc = self.SLEPc
            self.eps = SLEPc.EPS().create(self.comm)
            self.eps.setOperators(self.A, self.matrix("M"))
            self.eps.setProblemType(SLEPc.EPS.ProblemType.GHEP)
            self.eps.setType(SLEPc.EPS.Type.KRYLOVSCHUR)
            self.eps.setWhichEigenpairs(SLEPc.EPS.Which.TARGET_MAGNITUDE)
            self.eps.setTarget(0.0)
            st = self.eps.getST()
            st.setType(SLEPc.ST.Type.SINVERT)
            st.setKSP(self.ksp)
        return self.eps

    def vector(self, values: np.ndarray) -> Any:
        x = self.A.createVecRight()
        x.setArray(values)
        return x


def say(name: str, what: dict[str, Any]) -> None:
    """Write a file atomically."""
    with open(f"{name}.tmp", "w", encoding="utf-8") as file:
        json.dump(what, file)
    os.replace(f"{name}.tmp", name)


def share_of(memory: float, size: int) -> int:
    """[MB] for one process, of `memory` [bytes] if all are on one machine, else of the machine of the process."""
    here = next((int(os.environ[name]) for name in LOCAL if os.environ.get(name, "").isdigit()), size)
    if here < size:
        with open("/proc/meminfo", encoding="ascii") as file:
            memory = 1024 * next(int(line.split()[1]) for line in file if line.startswith("MemAvailable:"))
    return max(1, int(SHARE * memory / here / 1e6))


def end_with_parent() -> None:
    """Let the kernel end this process with its parent."""
    if sys.platform == "linux":
        import ctypes

        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, SIGKILL)


def serve() -> None:
    """Answer requests one after the other."""
    from petsc4py import PETSc
    from slepc4py import SLEPc

    PETSc.Sys.popErrorHandler()  # an error is Python's, and not a page of MPI's
    PETSc.Sys.pushErrorHandler("ignore")
    comm, rows, number = PETSc.COMM_WORLD, Distributed(PETSc, SLEPc), 0
    if comm.rank == 0:
        say(
            "hello.json",
            {
                "processes": comm.size,
                "launched": next(
                    (int(os.environ[name]) for name in ALL if os.environ.get(name, "").isdigit()), comm.size
                ),
                "complex": bool(np.issubdtype(PETSc.ScalarType, np.complexfloating)),
                "mumps": bool(PETSc.Sys.hasExternalPackage("mumps")),
                "petsc": ".".join(map(str, PETSc.Sys.getVersion())),
                "slepc": ".".join(map(str, SLEPc.Sys.getVersion())),
            },
        )
    while True:
        request, pause = f"request-{number}.json", SHORT
        while not os.path.exists(request):
            time.sleep(pause)
            pause = min(1.2 * pause, LONG)
        with open(request, encoding="utf-8") as file:
            task = json.load(file)
        if task["do"] == "end":
            return
        try:
            answer = rows.factorise(task["memory"]) if task["do"] == "factorise" else getattr(rows, task["do"])(task)
        except Refused as refused:
            answer = refused.answer
        comm.barrier()
        if comm.rank == 0:
            say(f"answer-{number}.json", answer)
        number += 1


def main() -> None:
    end_with_parent()
    os.chdir(sys.argv[1])
    sys.argv = sys.argv[:1]  # PETSc takes none of ours
    try:
        serve()
    except BaseException as error:
        # The other processes wait for this one: the launcher ends them with it.
        kind = "indices" if isinstance(error, OverflowError) else "failed"
        answer = {"refused": kind, "text": f"{type(error).__name__}: {error}"}
        if isinstance(error, MemoryError) or getattr(error, "ierr", None) == PETSC_ERR_MEM:
            answer["refused"] = "memory"
        say("failure.json", answer)
        traceback.print_exc()
        sys.stderr.flush()
        os._exit(1)


main()
