"""Sparse Cholesky, once, for many right-hand sides."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import SuperLU, splu

from strainsight.errors import MachineWarning, NumericalError, UserError
from strainsight.fem.pardiso import MECHANISM, pardiso
from strainsight.memory import require_memory

SUPERLU_LIMIT = 100_000
BLOCK = 32
LEAST_BYTES = 32
"""PARDISO's analysis, the upper triangle and a factor without fill, per entry of the matrix."""


class Lowest(Protocol):
    """lowest(M, count, basis, start, beside, tolerance): λ (count,) and φ (n, count) of A φ = λ M φ, the lowest in the complement
    of `beside` (n, k), which are orthonormal in M; by iterations with so many basis vectors from `start` (n,)."""

    def __call__(
        self, M: sparse.csr_array, count: int, basis: int, start: np.ndarray, beside: np.ndarray, tolerance: float
    ) -> tuple[np.ndarray, np.ndarray]: ...


@dataclass(frozen=True)
class Factor:
    """A factorised symmetric positive definite matrix; its memory goes with the last reference to it. lowest: modes by whoever
    holds the factor, None where they are iterated for here."""

    size: int
    solver: str
    _solve: Callable[[np.ndarray], np.ndarray]
    lowest: Lowest | None = None

    def solve(self, B: np.ndarray) -> np.ndarray:
        """A⁻¹B for B (n,) or (n, r), in blocks of 32 columns. Raises NumericalError where the result is not finite."""
        B = np.asarray(B, dtype=float)
        columns = B.reshape(self.size, -1)
        X = np.empty(columns.shape)
        for start in range(0, columns.shape[1], BLOCK):
            X[:, start : start + BLOCK] = self._solve(columns[:, start : start + BLOCK])
        if not np.all(np.isfinite(X)):
            raise NumericalError("the solution of A x = b is not finite", remedy=MECHANISM)
        return X.reshape(B.shape)


Factorise = Callable[[sparse.csr_array], Factor]
"""Who factorises: `factorise`, or the processes of MPI (`fem.mpi.session`)."""


def factorise(A: sparse.csr_array) -> Factor:
    """A = LLᵀ by PARDISO (mtype 2, upper triangle), or by SuperLU with a warning where PARDISO cannot be loaded.

    A (n, n) symmetric positive definite CSR; only its upper triangle is read. The matrix is scaled to a unit diagonal
    first, so that translations and rotations, or units far from SI, do not disturb the pivots.
    Raises NumericalError where A is not positive definite, UserError where the memory is not enough for it (known after
    PARDISO's analysis, before its factorisation) and beyond 100 000 unknowns without PARDISO.
    """
    scale, size = conditioned(A), A.shape[0]
    require_memory(LEAST_BYTES * A.nnz, f"the factor of {size} unknowns, at the very least")
    upper = scaled_upper(A, scale)
    try:
        solve, name = pardiso(upper), "PARDISO"
    except (ImportError, OSError):
        if size > SUPERLU_LIMIT:
            raise too_large(size) from None
        warnings.warn(
            "PARDISO is not available: SuperLU factorises, two to five times slower; more than 100 000 unknowns are refused "
            "(pip install pypardiso, where there is MKL: x86-64)",
            MachineWarning,
            stacklevel=2,
        )
        solve, name = _superlu(upper), "SuperLU"
    return Factor(size, name, lambda B: scale[:, None] * solve(scale[:, None] * B))


def conditioned(A: sparse.csr_array) -> np.ndarray:
    """s (n,) for which SAS, S = diag(s), has a unit diagonal. Raises NumericalError where A has an entry there ≤ 0."""
    diagonal = A.diagonal()
    if not np.all(diagonal > 0):
        raise NumericalError(
            f"the stiffness is not positive definite: diagonal entry {int(np.argmin(diagonal > 0))} is "
            f"{diagonal[np.argmin(diagonal > 0)]:g}",
            remedy=MECHANISM,
        )
    return np.asarray(1.0 / np.sqrt(diagonal))


def scaled_upper(A: sparse.csr_array, scale: np.ndarray) -> sparse.csr_array:
    """The upper triangle of SAS, S = diag(scale), its indices sorted."""
    upper = sparse.csr_array(sparse.triu(A, format="csr"))
    upper.sort_indices()
    upper.data *= np.repeat(scale, np.diff(upper.indptr)) * scale[upper.indices]
    return upper


def too_large(size: int) -> UserError:
    """Of so many unknowns without PARDISO."""
    return UserError(
        f"{size} unknowns without PARDISO would take SuperLU many minutes",
        remedy="pip install pypardiso (x86-64), or coarsen the mesh below 100 000 unknowns",
    )


def superlu(upper: sparse.csr_array, what: str) -> SuperLU:
    """The factor of a symmetric matrix from its upper triangle, without pivoting; NumericalError where it is singular."""
    full = sparse.csc_matrix(upper + sparse.triu(upper, 1).T)
    try:
        return splu(full, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    except RuntimeError as error:
        raise NumericalError(f"{what} is singular ({error})", remedy=MECHANISM) from None


def _superlu(upper: sparse.csr_array) -> Callable[[np.ndarray], np.ndarray]:
    factor = superlu(upper, "the stiffness")
    if np.any(factor.U.diagonal() <= 0):
        raise NumericalError("the stiffness is not positive definite: a pivot is not positive", remedy=MECHANISM)
    return factor.solve
