"""Sparse Cholesky, once, for many right-hand sides."""

from __future__ import annotations

import os
import sys
import warnings
import weakref
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from strainsight.errors import NumericalError, UserError

SUPERLU_LIMIT = 100_000
BLOCK = 32


@dataclass(frozen=True)
class Factor:
    """A factorised symmetric positive definite matrix; its memory goes with the last reference to it."""

    size: int
    solver: str
    _solve: Callable[[np.ndarray], np.ndarray]

    def solve(self, B: np.ndarray) -> np.ndarray:
        """A⁻¹B for B (n,) or (n, r), in blocks of 32 columns. Raises NumericalError where the result is not finite."""
        B = np.asarray(B, dtype=float)
        columns = B.reshape(self.size, -1)
        parts = [self._solve(columns[:, i : i + BLOCK]) for i in range(0, columns.shape[1], BLOCK)]
        X = np.concatenate(parts, axis=1) if parts else np.zeros_like(columns)
        if not np.all(np.isfinite(X)):
            raise NumericalError("the solution of A x = b is not finite", remedy=_REMEDY)
        return X.reshape(B.shape)


_MKL_CBWR_AUTO, _MKL_CBWR_AVX2 = 2, 10
_REMEDY = "the structure has a mechanism or an element of no stiffness: check supports, connections and materials"


def factorise(A: sparse.csr_array) -> Factor:
    """A = LLᵀ by PARDISO (mtype 2, upper triangle), or by SuperLU with a warning where PARDISO cannot be loaded.

    A (n, n) symmetric positive definite CSR; only its upper triangle is read. The matrix is scaled to a unit diagonal
    first, so that translations and rotations, or units far from SI, do not disturb the pivots.
    Raises NumericalError where A is not positive definite, UserError beyond 100 000 unknowns without PARDISO.
    """
    diagonal = A.diagonal()
    if not np.all(diagonal > 0):
        raise NumericalError(
            f"the stiffness is not positive definite: diagonal entry {int(np.argmin(diagonal > 0))} is "
            f"{diagonal[np.argmin(diagonal > 0)]:g}",
            remedy=_REMEDY,
        )
    scale = 1.0 / np.sqrt(diagonal)
    size = A.shape[0]
    upper = sparse.csr_array(sparse.triu(A, format="csr"))
    upper.sort_indices()
    upper.data *= np.repeat(scale, np.diff(upper.indptr)) * scale[upper.indices]
    try:
        solve, name = _pardiso(upper), "PARDISO"
    except (ImportError, OSError):
        if size > SUPERLU_LIMIT:
            raise UserError(
                f"{size} unknowns without PARDISO would take SuperLU many minutes",
                remedy="pip install pypardiso (x86-64), or coarsen the mesh below 100 000 unknowns",
            ) from None
        warnings.warn("PARDISO is not available: SuperLU is used, which is many times slower", stacklevel=2)
        solve, name = _superlu(upper), "SuperLU"
    return Factor(size, name, lambda B: scale[:, None] * solve(scale[:, None] * B))


def _pardiso(upper: sparse.csr_array) -> Callable[[np.ndarray], np.ndarray]:
    from pypardiso import PyPardisoSolver
    from pypardiso.pardiso_wrapper import PyPardisoError

    _name_mkl()
    solver = PyPardisoSolver(mtype=2)
    # the same bits on every run whatever the alignment of the arrays; MKL takes it before its first computation only
    if solver.libmkl.MKL_CBWR_Set(_MKL_CBWR_AVX2) != 0:
        solver.libmkl.MKL_CBWR_Set(_MKL_CBWR_AUTO)

    def call(phase: int, B: np.ndarray) -> np.ndarray:
        # pypardiso's own `solve` first compares the matrix with its copy, which costs more than the solve
        solver.set_phase(phase)
        return solver._call_pardiso(upper, np.asfortranarray(B))

    def solve(B: np.ndarray) -> np.ndarray:
        return call(33, B)

    weakref.finalize(solve, solver.free_memory, everything=True).atexit = False
    try:
        call(12, np.zeros((upper.shape[0], 1)))
    except PyPardisoError as error:
        if error.value == -4:
            raise NumericalError(
                "the stiffness is not positive definite: a pivot is not positive", remedy=_REMEDY
            ) from None
        raise NumericalError(
            f"PARDISO stopped with code {error.value} on {upper.shape[0]} unknowns",
            remedy="code -2 is a lack of memory: take a coarser mesh or a larger machine",
        ) from None
    return solve


def _name_mkl() -> None:
    """Name the MKL library where pip puts it: without that, pypardiso searches the whole environment for every factor (0.3 s)."""
    found = sorted(Path(sys.prefix, "lib").glob("libmkl_rt.so*"))
    if found:
        os.environ.setdefault("PYPARDISO_MKL_RT", str(found[0]))


def _superlu(upper: sparse.csr_array) -> Callable[[np.ndarray], np.ndarray]:
    full = upper + sparse.triu(upper, 1).T
    try:
        factor = splu(
            sparse.csc_matrix(full), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
        )
    except RuntimeError as error:
        raise NumericalError(f"the stiffness is singular ({error})", remedy=_REMEDY) from None
    if np.any(factor.U.diagonal() <= 0):
        raise NumericalError("the stiffness is not positive definite: a pivot is not positive", remedy=_REMEDY)
    return factor.solve
