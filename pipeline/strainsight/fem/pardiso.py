"""Intel's PARDISO through the library that pypardiso finds."""

from __future__ import annotations

import ctypes
import os
import sys
import weakref
from collections.abc import Callable, Sequence
from pathlib import Path
from threading import current_thread, main_thread
from typing import Any

import numpy as np
from scipy import sparse

from strainsight.errors import NumericalError, UserError
from strainsight.memory import require_memory

MECHANISM = "the structure has a mechanism or an element of no stiffness: check supports, connections and materials"
POSITIVE_DEFINITE = 2
ANALYSE, FACTORISE, SOLVE = 11, 22, 33
OWN_VALUES, ORDERING, NUMERICAL_MEMORY, FROM_ZERO = 1, 2, 17, 35
"""Places in iparm, counted from 1 as in its manual."""
NESTED_DISSECTION = 2
_NOT_DEFINITE, _NO_MEMORY = -4, -2
_MKL_CBWR_AUTO, _MKL_CBWR_AVX2 = 2, 10


def pardiso(upper: sparse.csr_array) -> Callable[[np.ndarray], np.ndarray]:
    """Factorise A = LLᵀ and return B (n, r) → A⁻¹B.

    upper (n, n) the upper triangle of A, CSR with sorted indices. The factor's memory goes with the last reference to the
    result. Raises ImportError or OSError where PARDISO cannot be loaded, NumericalError where A is not positive definite,
    UserError where the memory is not enough: the analysis tells it before the factorisation takes it.
    """
    return factorised(upper, POSITIVE_DEFINITE, f"the factor of {upper.shape[0]} unknowns")[0]


def factorised(
    upper: sparse.csr_array, kind: int, what: str, options: Sequence[tuple[int, int]] = ()
) -> tuple[Callable[[np.ndarray], np.ndarray], np.ndarray]:
    """B (n, r) → A⁻¹B, and iparm as the factorisation has left it; kind of A, what it is in words, options of iparm.

    Otherwise as `pardiso`.
    """
    solver = solver_of(kind)
    # Everything else stays zero. PARDISO's own defaults order with several threads, which differs between runs, and refine
    # every solution twice, which takes four times as long and which a positive definite matrix does not need.
    for place, value in ((OWN_VALUES, 1), (ORDERING, NESTED_DISSECTION), (FROM_ZERO, 1), *options):
        solver.iparm[place - 1] = value
    call = interface(solver, upper)

    def solve(B: np.ndarray) -> np.ndarray:
        X = np.empty(B.shape, upper.dtype, order="F")
        call(SOLVE, np.asfortranarray(B), X)
        return X

    weakref.finalize(solve, solver.free_memory, everything=True).atexit = False
    nothing = np.zeros((upper.shape[0], 1), upper.dtype)
    call(ANALYSE, nothing, nothing)
    require_memory(1024.0 * float(solver.iparm[NUMERICAL_MEMORY - 1]), what)
    call(FACTORISE, nothing, nothing)
    return solve, solver.iparm


def interface(solver: Any, upper: sparse.csr_array) -> Callable[[int, np.ndarray, np.ndarray], None]:
    """One phase: (phase, B, X) with B, X (n, r) in columns, X written. Raises the errors of `pardiso`.

    pypardiso's own compares the matrix with its copy before each solve, or copies all its indices. Solutions are found by one
    thread: of several columns their last bits depend on how many there are, and more were no faster.
    """
    size = upper.shape[0]
    row, column = (np.ascontiguousarray(index, dtype=np.int32) for index in (upper.indptr, upper.indices))
    one, n, kind, silent = (ctypes.byref(ctypes.c_int32(value)) for value in (1, size, solver.mtype, 0))

    def integers(values: np.ndarray) -> Any:
        return values.ctypes.data_as(ctypes.POINTER(ctypes.c_int32))

    def call(phase: int, B: np.ndarray, X: np.ndarray) -> None:
        code, library = ctypes.c_int32(0), solver.libmkl
        before = library.MKL_Set_Num_Threads_Local(1) if phase == SOLVE else 0
        solver._mkl_pardiso(
            solver.pt.ctypes.data_as(ctypes.POINTER(solver._pt_type[0])),
            one,
            one,
            kind,
            ctypes.byref(ctypes.c_int32(phase)),
            n,
            upper.data.ctypes.data_as(ctypes.c_void_p),
            integers(row),
            integers(column),
            integers(solver.perm),
            ctypes.byref(ctypes.c_int32(B.shape[1])),
            integers(solver.iparm),
            silent,
            B.ctypes.data_as(ctypes.c_void_p),
            X.ctypes.data_as(ctypes.c_void_p),
            ctypes.byref(code),
        )
        if phase == SOLVE:
            library.MKL_Set_Num_Threads_Local(before)
        if code.value:
            raise _failure(code.value, phase, size)

    return call


def _failure(code: int, phase: int, size: int) -> NumericalError | UserError:
    if code == _NOT_DEFINITE:
        return NumericalError("the stiffness is not positive definite: a pivot is not positive", remedy=MECHANISM)
    if code == _NO_MEMORY:
        return UserError(
            f"there is not enough memory to factorise {size} unknowns",
            remedy="take a coarser mesh or a larger machine, or end other programs",
        )
    return NumericalError(
        f"PARDISO stopped with code {code} in phase {phase} on {size} unknowns",
        remedy="look the code up in the manual of oneMKL, under pardiso",
    )


def solver_of(kind: int) -> Any:
    """PARDISO for matrices of that kind, the same bits on every run whatever the alignment of the arrays.

    MKL takes its branch before its first computation only, so that no other solver may be made. Raises ImportError or OSError
    where PARDISO cannot be loaded.
    """
    name_mkl()  # first: the import makes a solver, too
    from pypardiso import PyPardisoSolver

    solver = PyPardisoSolver(mtype=kind)
    if current_thread() is not main_thread():  # beside others, which share the cores
        solver.libmkl.MKL_Set_Num_Threads_Local(1)
    if solver.libmkl.MKL_CBWR_Set(_MKL_CBWR_AVX2) != 0:
        solver.libmkl.MKL_CBWR_Set(_MKL_CBWR_AUTO)
    return solver


def name_mkl() -> None:
    """Name the MKL library where pip puts it: without that, pypardiso searches the whole environment for every factor (0.3 s).
    Threads of MKL are to sleep between calls: they would spin for 0.2 s on cores that NumPy's threads need."""
    os.environ.setdefault("KMP_BLOCKTIME", "0")
    found = sorted(Path(sys.prefix, "lib").glob("libmkl_rt.so*"))
    if found:
        os.environ.setdefault("PYPARDISO_MKL_RT", str(found[0]))
