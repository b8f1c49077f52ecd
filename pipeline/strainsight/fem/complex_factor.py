"""Sparse factors of complex symmetric matrices, for dynamic stiffnesses K + sC + s²M."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy import sparse

from strainsight.errors import NumericalError
from strainsight.fem.factorisation import SUPERLU_LIMIT, scaled_upper, superlu, too_large
from strainsight.fem.pardiso import MECHANISM, factorised
from strainsight.memory import require_memory

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
    upper = scaled_upper(A, scale)
    try:
        solve = _pardiso(upper)
    except (ImportError, OSError):
        if A.shape[0] > SUPERLU_LIMIT:
            raise too_large(A.shape[0]) from None
        solve = superlu(upper, "a dynamic stiffness").solve
    return lambda b: scale * solve(scale * b)


def _pardiso(upper: sparse.csr_array) -> Callable[[np.ndarray], np.ndarray]:
    what = f"the complex factor of {upper.shape[0]} unknowns"
    solve, iparm = factorised(upper, COMPLEX_SYMMETRIC, what, ((PERTURBATION, _TINY), (PIVOTING, 0)))
    if iparm[PERTURBED - 1]:
        raise NumericalError("a pivot of a dynamic stiffness vanishes", remedy=MECHANISM)
    return lambda b: solve(b[:, None])[:, 0]
