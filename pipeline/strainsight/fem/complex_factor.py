"""Sparse factors of complex symmetric matrices, for dynamic stiffnesses K + sC + s²M."""

from __future__ import annotations

import weakref
from collections.abc import Callable

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from strainsight.errors import NumericalError, UserError
from strainsight.fem.factorisation import SUPERLU_LIMIT
from strainsight.fem.memory import require_memory
from strainsight.fem.pardiso import (
    ANALYSE,
    FACTORISE,
    FROM_ZERO,
    MECHANISM,
    NESTED_DISSECTION,
    NUMERICAL_MEMORY,
    ORDERING,
    OWN_VALUES,
    SOLVE,
    interface,
    solver_of,
)

COMPLEX_SYMMETRIC = 6
PERTURBATION, PERTURBED, PIVOTING = 10, 14, 21
_TINY = 13
"""A pivot below 1e-13 of the matrix is a failure, not something to be corrected."""
LEAST_BYTES = 64
"""PARDISO's analysis, the upper triangle and a factor without fill, per entry of the matrix."""


def factorise_complex(A: sparse.csr_array) -> Callable[[np.ndarray], np.ndarray]:
    """A = LDLᵀ without pivoting, by PARDISO or SuperLU; returns b (n,) → A⁻¹b.

    A (n, n) complex symmetric (A = Aᵀ); only its upper triangle is read. Some complex multiple of A must have a positive
    definite real part: then no pivot can vanish and none need be sought. K + sC + s²M over s has one where Re s > 0.
    Raises NumericalError where a pivot vanishes, UserError where the memory is not enough and beyond 100 000 unknowns
    without PARDISO.
    Source: Higham, Mathematics of Computation 67 (1998); George, Ikramov and Kucherov, SIAM J. Matrix Anal. 23 (2002).
    """
    require_memory(LEAST_BYTES * A.nnz, f"the complex factor of {A.shape[0]} unknowns, at the very least")
    size = np.abs(A.diagonal())
    if not np.all(size > 0):
        raise NumericalError("a dynamic stiffness has a zero on its diagonal", remedy=MECHANISM)
    scale = 1.0 / np.sqrt(size)
    upper = sparse.csr_array(sparse.triu(A, format="csr"))
    upper.sort_indices()
    upper.data = upper.data * (np.repeat(scale, np.diff(upper.indptr)) * scale[upper.indices])
    try:
        solve = _pardiso(upper)
    except (ImportError, OSError):
        if A.shape[0] > SUPERLU_LIMIT:
            raise UserError(
                f"{A.shape[0]} unknowns without PARDISO would take SuperLU many minutes",
                remedy="pip install pypardiso (x86-64), or coarsen the mesh below 100 000 unknowns",
            ) from None
        solve = _superlu(upper)
    return lambda b: scale * solve(scale * b)


def _pardiso(upper: sparse.csr_array) -> Callable[[np.ndarray], np.ndarray]:
    solver = solver_of(COMPLEX_SYMMETRIC)
    wanted = ((OWN_VALUES, 1), (ORDERING, NESTED_DISSECTION), (FROM_ZERO, 1), (PERTURBATION, _TINY), (PIVOTING, 0))
    for place, value in wanted:
        solver.iparm[place - 1] = value
    call = interface(solver, upper)

    def solve(b: np.ndarray) -> np.ndarray:
        x = np.empty((len(b), 1), dtype=complex, order="F")
        call(SOLVE, np.asfortranarray(b[:, None]), x)
        return x[:, 0]

    weakref.finalize(solve, solver.free_memory, everything=True).atexit = False
    nothing = np.zeros((upper.shape[0], 1), dtype=complex)
    call(ANALYSE, nothing, nothing)
    require_memory(
        1024.0 * float(solver.iparm[NUMERICAL_MEMORY - 1]), f"the complex factor of {upper.shape[0]} unknowns"
    )
    call(FACTORISE, nothing, nothing)
    if solver.iparm[PERTURBED - 1]:
        raise NumericalError("a pivot of a dynamic stiffness vanishes", remedy=MECHANISM)
    return solve


def _superlu(upper: sparse.csr_array) -> Callable[[np.ndarray], np.ndarray]:
    full = sparse.csc_matrix(upper + sparse.triu(upper, 1).T)
    try:
        factor = splu(full, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    except RuntimeError as error:
        raise NumericalError(f"a dynamic stiffness is singular ({error})", remedy=MECHANISM) from None
    return factor.solve
