"""Undamped modes of a supported structure."""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.linalg import eigh
from scipy.sparse.linalg import ArpackError, LinearOperator, eigsh

from strainsight.errors import NumericalError, UserError
from strainsight.fem.factorisation import Factor, factorise
from strainsight.fem.memory import require_memory

DENSE_LIMIT = 300
GUARD = 4
REPEATED = 1e-7
"""Values ω² closer than this share of themselves are one frequency."""
NEARLY = 1e-6
"""Components that differ by less than this share are equally large: symmetry makes them so, and the first counts."""


def modes(
    K: sparse.csr_array, M: sparse.csr_array, count: int, *, shift: float = 0.0, factor: Factor | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """The lowest modes, by Lanczos iterations on (K − σM)⁻¹M (ARPACK, shift-invert, start vector seeded):

        K φ = ω² M φ,     φᵀMφ = 1,     the largest component of φ positive

    Of modes of one frequency the first has the largest component that any combination of them has, and so on (`turned`):
    no rounding chooses among the combinations.
    K, M (n, n) symmetric, K − σM positive definite, M positive semidefinite; count ≤ the rank of M; shift σ ≤ 0
    [rad²/s²]: 0 for a supported structure, negative for a free one (its rigid motions then come first); factor of
    K − σM, where there is one. Returns frequency (count,) [Hz] ascending and shapes (n, count) [1/√kg].
    Raises UserError for too large a count, for a mechanism (a mode without stiffness) and where the memory is not enough,
    NumericalError where a mode does not converge or K − σM is not positive definite.
    """
    n = K.shape[0]
    massive = int(np.count_nonzero(M.diagonal() > 0))
    if not 1 <= count <= massive:
        raise UserError(
            f"{count} modes of a model with {massive} unknowns that have mass", remedy=f"ask for 1 to {massive}"
        )
    if shift > 0:
        raise ValueError("the shift must not be positive")
    A = K if shift == 0 else sparse.csr_array(K - shift * M)
    if n <= DENSE_LIMIT or 2 * (count + GUARD) >= n:
        inverse, shapes = _dense(A, M, count)
    else:
        inverse, shapes = _lanczos(A, M, count, factor or factorise(A))
    # a few modes more than asked for keep the copies of a repeated frequency from being cut off
    inverse, shapes = inverse[:count], (shapes @ turned(inverse, shapes))[:, :count]
    lam = 1.0 / inverse + shift
    _check(A, M, lam - shift, shapes)
    return np.sqrt(np.maximum(lam, 0.0)) / (2 * np.pi), _signed(shapes)


def _dense(A: sparse.csr_array, M: sparse.csr_array, count: int) -> tuple[np.ndarray, np.ndarray]:
    """M φ = (1/λ) A φ, because M may be singular and A is not."""
    n = A.shape[0]
    try:
        inverse, V = eigh(M.toarray(), A.toarray(), subset_by_index=(max(n - count - GUARD, 0), n - 1))
    except np.linalg.LinAlgError:
        raise NumericalError(
            "the stiffness is not positive definite",
            remedy="the structure has a mechanism: check supports and connections",
        ) from None
    # beside those asked for, what has no mass is no mode
    found = max(count, int(np.count_nonzero(inverse > n * np.finfo(float).eps * inverse[-1])))
    return inverse[-found:][::-1], (V[:, -found:] / np.sqrt(inverse[-found:]))[:, ::-1]


def _lanczos(A: sparse.csr_array, M: sparse.csr_array, count: int, factor: Factor) -> tuple[np.ndarray, np.ndarray]:
    n = A.shape[0]
    wanted = min(count + GUARD, int(np.count_nonzero(M.diagonal() > 0)))
    start = M @ np.random.default_rng(0).standard_normal(n)
    basis = min(n, 2 * wanted + 10)
    require_memory(8.0 * n * (basis + 3 * wanted), f"{count} modes of {n} unknowns")
    solve = LinearOperator((n, n), matvec=factor.solve, matmat=factor.solve, dtype=float)
    try:
        lam, V = eigsh(A, wanted, M=M, sigma=0.0, OPinv=solve, v0=factor.solve(start), ncv=basis)
    except ArpackError as error:
        raise NumericalError(
            f"the Lanczos iterations did not converge: {error}",
            remedy="check the model for nearly loose parts, or ask for fewer modes",
        ) from None
    order = np.argsort(lam)
    V = V[:, order]
    return 1.0 / lam[order], V / np.sqrt(np.einsum("ij,ij->j", V, M @ V))


def _check(A: sparse.csr_array, M: sparse.csr_array, lam: np.ndarray, shapes: np.ndarray) -> None:
    """A mode whose energy is rounding error is a mechanism; the others must satisfy the equation."""
    m, k = M.diagonal(), A.diagonal()
    stiffest = (k[m > 0] / m[m > 0]).max()
    if not lam[0] > 1e-15 * stiffest:
        raise UserError(
            f"the structure has a mechanism: a mode at {np.sqrt(max(lam[0], 0.0)) / (2 * np.pi):.2g} Hz is "
            "stiffness of rounding size",
            remedy="look for parts joined at one node or one edge only, and for missing supports",
        )
    elastic = A @ shapes
    residual = np.linalg.norm(elastic - (M @ shapes) * lam, axis=0)
    scale = np.linalg.norm(np.sqrt(k)) * np.sqrt(lam)
    worst = int(np.argmax(residual / scale))
    if not residual[worst] <= 1e-6 * scale[worst]:
        raise NumericalError(
            f"mode {worst + 1} leaves a residual of {residual[worst] / scale[worst]:.1e}",
            remedy="check the model for elements of extreme shape or stiffness",
        )


def turned(values: np.ndarray, shapes: np.ndarray) -> np.ndarray:
    """T (count, count) orthogonal, which turns shapes (n, count) of repeated values (count,), ordered, among themselves.

    Of those of one value, the first column of `shapes` T has the largest component that any combination of them has, the
    others a zero there; the second the largest that is left, and so on.
    """
    T = np.eye(len(values))
    size = np.maximum(np.abs(values[1:]), np.abs(values[:-1]))
    ends = np.flatnonzero(np.abs(np.diff(values)) > REPEATED * size) + 1
    for own in np.split(np.arange(len(values)), ends):
        for first in range(len(own) - 1):
            rest = own[first:]
            V = shapes[:, own] @ T[np.ix_(own, rest)]
            longest = _largest(np.linalg.norm(V, axis=1))
            T[np.ix_(own, rest)] = T[np.ix_(own, rest)] @ np.linalg.qr(V[longest][:, None], mode="complete")[0]
    return T


def _signed(shapes: np.ndarray) -> np.ndarray:
    """The first of the largest components is positive, so that rounding cannot flip a symmetric shape."""
    first = _largest(np.abs(shapes))
    return shapes * np.sign(shapes[first, np.arange(shapes.shape[1])])


def _largest(size: np.ndarray) -> np.ndarray:
    """Where along the first axis the first of the largest stands."""
    return np.argmax(size >= (1 - NEARLY) * size.max(axis=0), axis=0)
