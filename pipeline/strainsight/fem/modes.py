"""Undamped modes of a structure, supported or free."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy import sparse
from scipy.linalg import eigh, null_space
from scipy.sparse.linalg import ArpackError, LinearOperator, eigsh

from strainsight.errors import NumericalError, UserError
from strainsight.fem.factorisation import (
    Factor,
    Factorise,
    Relief,
    factorise,
    factorise_free,
    pin_rigid_motions,
    relief_of,
)
from strainsight.memory import require_memory

DEPENDENT = 1e-14
"""Share of the M-norm of A⁻¹M q below which its part M-orthogonal to all q is rounding."""
NEGLIGIBLE, WELL_CONDITIONED = 1e-13, 1e-6
"""Components of unit vectors, and smallest ratio of the squared lengths in a block, for which M W is not computed again."""
MOST, ROWS = 1000, 8192
"""Maximum number of blocks of an iteration, and number of rows that a restart turns at once."""


def largest(
    inverse: Callable[[np.ndarray], np.ndarray],
    M: sparse.csr_array,
    count: int,
    start: np.ndarray,
    most: int,
    tolerance: float,
    extra: int = 0,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Largest μ of A⁻¹M φ = μ φ by block Lanczos iterations with thick restart, in the space of the vectors Q of all blocks:

        A⁻¹M Q = Q T + q [0 R],   QᵀMQ = I,   T s = μ s,   φ = Q s

    Every block is M-orthogonalised to all before it; before Q has more than `most` columns, the best φ replace them (thick
    restart). The iteration ends when every |A⁻¹Mφ − μφ|_M = |R s_last| of the first `count` is at most tolerance · μ. A block
    detects as many copies of a repeated μ as it has vectors; modes orthogonal to the start vectors are not detected.
    inverse: X (n, k) → A⁻¹X; M (n, n) positive semidefinite; start (n, b), in the range of A⁻¹M; extra: number of further
    modes that are returned unconverged.
    Returns μ (count + extra,) descending, φ (n, count + extra) with φᵀMφ = 1, and |A⁻¹Mφ − μφ|_M; fewer if no more exist.
    Raises NumericalError if they do not converge.
    Sources: Grimes, Lewis and Simon, SIAM J. Matrix Anal. Appl. 15 (1994); Wu and Simon, ibid. 22 (2000)."""
    Q, T, used = np.empty((len(start), most), order="F"), np.zeros((0, 0)), 0
    q, Mq, _, _ = _orthonormalise(Q[:, :0], M, start)
    for _ in range(MOST):
        behind = used + q.shape[1]
        Q[:, used:behind] = q
        q, Mq, R, share = _orthonormalise(Q[:, :behind], M, inverse(Mq))
        T = np.block([[T, share[:used]], [share[:used].T, 0.5 * (share[used:] + share[used:].T)]])
        if q.shape[1] and behind < count:
            used = behind
            continue
        mu, s = eigh(T)
        mu, s = mu[::-1], s[:, ::-1]
        returned = min(count + extra, behind)
        residual = np.linalg.norm(R @ s[used:, :returned], axis=0)
        if not q.shape[1] or np.all(residual[:count] <= tolerance * mu[:count]):
            return mu[:returned], Q[:, :behind] @ s[:, :returned], residual
        used = behind
        if used + q.shape[1] > most:
            used = min(behind, (count + extra + most) // 2)
            for rows in np.split(Q, range(ROWS, len(Q), ROWS)):  # in place
                rows[:, :used] = rows[:, :behind] @ s[:, :used]
            T = np.diag(mu[:used])
    raise NumericalError(
        f"the Lanczos iterations for the modes did not converge in {MOST} steps",
        remedy="Check the model for nearly unconstrained parts, or request fewer modes.",
    )


def _orthonormalise(
    Q: np.ndarray, M: sparse.csr_array, W: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """q, Mq (n, r), R (r, b) and C (k, b) of W = Q C + q R: qᵀMq = I, QᵀMq = 0; r < b if fewer than b directions are longer
    than DEPENDENT times the longest column of W. Repeated twice: the first Gram matrix resolves directions of 1e-8 of the longest
    only in magnitude."""
    MW = M @ W
    floor = least = DEPENDENT * float(np.sqrt(np.maximum(np.einsum("ij,ij->j", W, MW), 0.0).max(initial=0.0)))
    R, C = np.eye(W.shape[1]), Q.T @ MW
    for first in (True, False):
        share = C if first else Q.T @ MW
        W = W - Q @ share
        if first or np.abs(share).max(initial=0.0) > NEGLIGIBLE:
            MW = M @ W
        G = W.T @ MW
        size, V = eigh(0.5 * (G + G.T))
        longest = float(size[-1]) if len(size) else 0.0
        if not longest > floor**2:
            return W[:, :0], MW[:, :0], R[:0], C
        if first:
            size = np.maximum(size, 1e-15 * longest)
        else:
            significant = (size > 1e-12) & (np.linalg.norm(np.sqrt(np.abs(size))[:, None] * (V.T @ R), axis=1) > least)
            size, V = size[significant], V[:, significant]
        turn = V / np.sqrt(size)
        W, R, floor = W @ turn, np.sqrt(size)[:, None] * (V.T @ R), 0.0
        MW = M @ W if first and size[0] < WELL_CONDITIONED * longest else MW @ turn
    return W, MW, R, C


DENSE_LIMIT = 300
GUARD = 4
COMPLEMENT = 2
"""Modes to look for in the complement of those found."""
CLOSELY, WIDTH = 1e-10, 8
"""Relative accuracy of 1/λ of block iterations, and number of vectors in a block: eight solutions at once take twice the time of
one."""
ROUGHLY, ROUGH_BASIS = 1e-3, 24
"""Relative accuracy of 1/λ of the first search in the complement, and its maximum number of vectors; also the distance of values
1/λ that count as a cluster."""
REPEATED = 1e-7
"""Relative distance of values ω² from the first of them that counts as one repeated frequency."""
NEARLY = 1e-6
"""Relative difference of components that count as equal, as by symmetry; the first counts."""


def modes(
    K: sparse.csr_array,
    M: sparse.csr_array,
    count: int,
    *,
    shift: float = 0.0,
    factor: Factor | None = None,
    rigid: np.ndarray | None = None,
    by: Factorise = factorise,
) -> tuple[np.ndarray, np.ndarray]:
    """The lowest modes, by seeded block Lanczos iterations on (K − σM)⁻¹M:

        K φ = ω² M φ,     φᵀMφ = 1,     the largest component of φ positive

    Among modes of one frequency, the first has the largest component of all their combinations, and so on
    (`combine_repeated`), so that rounding does not choose the combination. Small models, and models with few massive
    degrees of freedom,
    are solved densely. K, M (n, n) symmetric, K − σM positive definite, M positive semidefinite; count ≤ the rank of M.
    shift σ ≤ 0 [rad²/s²]: 0 for a supported structure, negative for a free one (its rigid-body modes then come first);
    factor: of K − σM, if available, otherwise computed with `by`. rigid (n, k): all rigid-body motions of a free structure, for
    its elastic modes only; then without shift, and with `factorise_free` as factor. A factor with `lowest` (Krylov-Schur,
    SLEPc) iterates itself; order, copies and checks are the same.
    |A⁻¹Mφ − φ/λ| ≤ `CLOSELY`/λ in the M-norm, so that the error of 1/λ is the square of that over its distance from the others.
    Blocks of `WIDTH` random vectors detect as many copies of a frequency. If a copy may be missing, or the last requested
    frequency is repeated, ARPACK iterations continue in the complement of the modes found until they find no lower mode.

    Returns frequency (count,) [Hz] ascending and shapes (n, count) [1/√kg].
    Raises UserError for too large a count, for a mechanism (a mode without stiffness) and if the memory is not sufficient,
    NumericalError if a mode does not converge or K − σM is not positive definite."""
    relief = None if rigid is None else relief_of(M, rigid)
    massive = _rank_of_mass(M, relief)
    if not 1 <= count <= massive:
        suffix = "" if relief is None else " in addition to the rigid-body modes"
        raise UserError(
            f"{count} modes are requested, but the degrees of freedom with mass allow only {massive}{suffix}",
            remedy=f"Request 1 to {massive} modes.",
        )
    if shift > 0 or (shift and relief is not None):
        raise ValueError(
            f"the eigenvalue shift is {shift:g}, but must be ≤ 0, or 0 if the argument `rigid` (rigid-body modes) is passed"
        )
    A = K if shift == 0 else sparse.csr_array(K - shift * M)
    inverse, shapes = _lowest_modes(A, M, count, factor, relief, by)
    inverse, shapes = inverse[:count], (shapes @ combine_repeated(inverse, shapes))[:, :count]
    lam = 1.0 / inverse + shift
    _check(A, M, lam - shift, shapes)
    return np.sqrt(np.maximum(lam, 0.0)) / (2 * np.pi), shapes * signs(shapes)


def _rank_of_mass(M: sparse.csr_array, relief: Relief | None) -> int:
    """The rank of M, for a free structure that of its elastic part."""
    return int(np.count_nonzero(M.diagonal() > 0)) - (0 if relief is None else relief.shapes.shape[1])


def _lowest_modes(
    A: sparse.csr_array, M: sparse.csr_array, count: int, factor: Factor | None, relief: Relief | None, by: Factorise
) -> tuple[np.ndarray, np.ndarray]:
    """1/λ and φ of the modes and of a few more, so that no copy of the last requested frequency is cut off."""
    n, massive, guard = A.shape[0], _rank_of_mass(M, relief), GUARD
    while True:
        wanted = min(count + guard, massive)
        if n <= DENSE_LIMIT or _basis(wanted) > n:
            require_memory(8.0 * n * (4 * n + wanted), f"computing {count} modes with {n} degrees of freedom")
            if relief is None:
                inverse, shapes = _dense_modes(A.toarray(), M.toarray(), count, wanted)
            else:
                # (M − MR(MR)ᵀ)φ′ = (1/λ) A′φ′ with the springs of `pin_rigid_motions`; φ′ is φ that leaves them unstretched
                M_elastic = M.toarray() - relief.inertia @ relief.inertia.T
                inverse, pinned_modes = _dense_modes(
                    pin_rigid_motions(A, relief.shapes).toarray(), M_elastic, count, wanted
                )
                shapes = relief.elastic(pinned_modes)
        else:
            factor = factor or (by(A) if relief is None else factorise_free(A, relief, by))
            if _basis(wanted) <= massive:
                if (result := _block_modes(M, count, factor)) is not None:
                    return result
                inverse, shapes = _lanczos(A, M, count, wanted, factor)
            else:
                inverse, shapes = _condensed_modes(A, M, count, wanted, factor, relief)
        if _frequencies(inverse)[-1] >= count or len(inverse) < count + guard:
            return inverse, shapes
        guard *= 2


def _dense_modes(A: np.ndarray, M: np.ndarray, count: int, wanted: int) -> tuple[np.ndarray, np.ndarray]:
    """M φ = (1/λ) A φ, because M may be singular and A is not."""
    n = len(A)
    try:
        inverse, V = eigh(M, A, subset_by_index=(n - wanted, n - 1))
    except np.linalg.LinAlgError:
        raise NumericalError(
            "the stiffness matrix is not positive definite",
            remedy="Check supports and connections: the structure has a mechanism (a part that can move without strain).",
        ) from None
    # additional vectors without mass are not modes
    selected = max(count, int(np.count_nonzero(inverse > n * np.finfo(float).eps * inverse[-1])))
    return inverse[-selected:][::-1], (V[:, -selected:] / np.sqrt(inverse[-selected:]))[:, ::-1]


def _condensed_modes(
    A: sparse.csr_array, M: sparse.csr_array, count: int, wanted: int, factor: Factor, relief: Relief | None
) -> tuple[np.ndarray, np.ndarray]:
    """Few massive degrees of freedom: φ = Z y of the responses Z to a unit force on each, ZᵀMZ y = (1/λ) ZᵀAZ y; for a
    free structure to self-equilibrated forces on them."""
    n, massive = A.shape[0], np.flatnonzero(M.diagonal() > 0)
    require_memory(8.0 * n * (3 * len(massive) + wanted), f"computing {count} modes with {n} degrees of freedom")
    forces = np.zeros((n, len(massive)))
    forces[massive, np.arange(len(massive))] = 1.0
    if relief is not None:
        forces = forces @ null_space(relief.shapes[massive].T)
    Z = factor.solve(forces)
    flexibility = forces.T @ Z
    inverse, Y = _dense_modes(0.5 * (flexibility + flexibility.T), Z.T @ (M @ Z), count, wanted)
    return inverse, Z @ Y


def _basis(wanted: int) -> int:
    """Number of Lanczos vectors; as many massive degrees of freedom are needed."""
    return 2 * wanted + 10


def _lanczos(
    A: sparse.csr_array, M: sparse.csr_array, count: int, wanted: int, factor: Factor
) -> tuple[np.ndarray, np.ndarray]:
    """One start vector detects one copy of a repeated frequency, and others only by rounding. So the iterations are repeated in
    the complement of the modes found, x ← (I − Φ ΦᵀM) x, until they find no mode lower than the last. A search to the accuracy
    `ROUGHLY`, |error| ≤ `ROUGHLY`/λ, usually decides this for a third of the solutions."""
    n = A.shape[0]
    require_memory(8.0 * n * (_basis(wanted) + 3 * wanted), f"computing {count} modes with {n} degrees of freedom")
    inverse, shapes = _complement_modes(A, M, wanted, factor, np.zeros((n, 0)))
    while True:
        if factor.lowest is not None:
            more, _ = _complement_modes(A, M, COMPLEMENT, factor, shapes, ROUGHLY)
            lower = (1 + ROUGHLY) * more[0] > inverse[-1]
        else:
            lower = not _no_lower_mode(M, factor, shapes, inverse[-1])
        if not lower:
            return inverse, shapes
        more, others = _complement_modes(A, M, COMPLEMENT, factor, shapes)
        if more[0] <= (1 + REPEATED) * inverse[-1]:
            return inverse, shapes
        order = np.argsort(-np.concatenate([inverse, more]), kind="stable")[:wanted]
        inverse, shapes = np.concatenate([inverse, more])[order], np.hstack([shapes, others])[:, order]


def _block_modes(M: sparse.csr_array, count: int, factor: Factor) -> tuple[np.ndarray, np.ndarray] | None:
    """1/λ and φ of the modes and the value of the next one, by block iterations; None if the next mode may be as low as the last,
    or a copy in a cluster of `WIDTH` modes is missing: `_lanczos` resolves that."""
    if factor.lowest is not None:
        return None
    n, most = M.shape[0], max(2 * count + 2 * WIDTH, count + 6 * WIDTH)
    require_memory(8.0 * n * (most + 5 * count), f"computing {count} modes with {n} degrees of freedom")
    start = factor.solve(M @ np.random.default_rng(0).standard_normal((n, WIDTH)))
    try:
        inverse, shapes, residual = largest(factor.solve, M, count, start, most, CLOSELY, extra=1)
    except (np.linalg.LinAlgError, NumericalError):
        return None  # no convergence
    if len(inverse) <= count or inverse[-1] + residual[-1] >= (1 - REPEATED) * inverse[count - 1]:
        return None
    clustered = any(b >= (1 - ROUGHLY) * a for a, b in zip(inverse, inverse[WIDTH - 1 :], strict=False))
    if clustered and not _no_lower_mode(M, factor, shapes, inverse[count - 1]):
        return None
    return inverse, shapes


def _no_lower_mode(M: sparse.csr_array, factor: Factor, shapes: np.ndarray, last: float) -> bool:
    """Whether the largest 1/λ in the complement of the M-orthonormal shapes (n, k) is below `last`, by iterations to the
    relative accuracy `ROUGHLY`."""
    solve = _deflated_inverse(M, factor, shapes)
    start = solve(M @ np.random.default_rng(1).standard_normal((len(shapes), 1)))
    try:
        more, _, _ = largest(solve, M, 1, start, ROUGH_BASIS, ROUGHLY)
    except (np.linalg.LinAlgError, NumericalError):
        return False
    return not len(more) or bool((1 + ROUGHLY) * more[0] <= last)


def _deflated_inverse(M: sparse.csr_array, factor: Factor, shapes: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    """(I − Φ ΦᵀM) A⁻¹ with M-orthonormal shapes Φ (n, k)."""
    weighted = M @ shapes

    def solve(X: np.ndarray) -> np.ndarray:
        Y = factor.solve(X)
        return np.asarray(Y - shapes @ (weighted.T @ Y))

    return solve


def _complement_modes(
    A: sparse.csr_array, M: sparse.csr_array, count: int, factor: Factor, shapes: np.ndarray, tolerance: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """1/λ, descending, and φ of the lowest modes in the complement of the M-orthonormal shapes (n, k); to the relative accuracy
    `tolerance` of 1/λ, 0: to rounding."""
    n, solve = A.shape[0], _deflated_inverse(M, factor, shapes)
    start = M @ np.random.default_rng(0).standard_normal(n)
    if factor.lowest is not None:
        lam, V = factor.lowest(M, count, _basis(count), solve(start), shapes, tolerance)
        return _ascending(M, lam, V)
    inverted = LinearOperator((n, n), matvec=solve, matmat=solve, dtype=float)
    try:
        lam, V = eigsh(A, count, M=M, sigma=0.0, OPinv=inverted, v0=solve(start), ncv=_basis(count), tol=tolerance)
    except ArpackError as error:
        raise NumericalError(
            f"the Lanczos iterations for the modes did not converge: {error}",
            remedy="Check the model for nearly unconstrained parts, or request fewer modes.",
        ) from None
    return _ascending(M, lam, V)


def _ascending(M: sparse.csr_array, lam: np.ndarray, V: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """1/λ, descending, and φ with φᵀMφ = 1."""
    order = np.argsort(lam)
    V = V[:, order]
    return 1.0 / lam[order], V / np.sqrt(np.einsum("ij,ij->j", V, M @ V))


def _check(A: sparse.csr_array, M: sparse.csr_array, lam: np.ndarray, shapes: np.ndarray) -> None:
    """Raise an error for a mode whose energy is rounding (a mechanism), and for one with a large residual."""
    m, k = M.diagonal(), A.diagonal()
    stiffest = (k[m > 0] / m[m > 0]).max()
    # φᵀAφ = λ may be a difference of terms that are 1e12 times as large; a rotation about a shell normal that is nearly along
    # an axis has hardly any mass, so that K_ii/M_ii is no measure of stiffness there
    size = np.abs(shapes[:, 0])
    if not lam[0] > 1e-15 * stiffest and not lam[0] > 1e-12 * float(size @ (abs(A) @ size)):
        raise UserError(
            f"the structure has a mechanism: a mode at {np.sqrt(max(lam[0], 0.0)) / (2 * np.pi):.2g} Hz has no stiffness apart "
            "from rounding errors",
            remedy="Check for parts that are joined at one node or one edge only, and for missing supports.",
        )
    residual = np.linalg.norm(A @ shapes - (M @ shapes) * lam, axis=0)
    scale = np.linalg.norm(np.sqrt(k)) * np.sqrt(lam)
    worst = int(np.argmax(residual / scale))
    if not residual[worst] <= 1e-6 * scale[worst]:
        raise NumericalError(
            f"mode {worst + 1} satisfies K φ = λ M φ only with a relative residual of {residual[worst] / scale[worst]:.1e} "
            "(limit 1e-6)",
            remedy="Check the model for elements of extreme shape or stiffness.",
        )


def combine_repeated(values: np.ndarray, shapes: np.ndarray) -> np.ndarray:
    """T (count, count) orthogonal, which combines shapes (n, count) of repeated values (count,), ordered.

    Among those of one value, the first column of `shapes` T has the largest component that any combination has, the others
    a zero there; the second has the largest remaining component, and so on."""
    T = np.eye(len(values))
    for copies in np.split(np.arange(len(values)), _frequencies(values)[1:]):
        for first in range(len(copies) - 1):
            rest = copies[first:]
            V = shapes[:, copies] @ T[np.ix_(copies, rest)]
            longest = _largest(np.linalg.norm(V, axis=1))
            T[np.ix_(copies, rest)] = T[np.ix_(copies, rest)] @ np.linalg.qr(V[longest][:, None], mode="complete")[0]
    return T


def signs(shapes: np.ndarray) -> np.ndarray:
    """±1 (k,): the sign of the first of the largest components of shapes (n, k), so that rounding cannot flip a symmetric
    shape."""
    return np.asarray(np.sign(shapes[_largest(np.abs(shapes)), np.arange(shapes.shape[1])]))


def _frequencies(values: np.ndarray) -> list[int]:
    """Index of the first of each group of ordered values, which are within `REPEATED` of it."""
    first = [0]
    for i, value in enumerate(values):
        if abs(value - values[first[-1]]) > REPEATED * abs(values[first[-1]]):
            first.append(i)
    return first


def _largest(size: np.ndarray) -> np.ndarray:
    """Index along the first axis of the first of the (nearly) largest components."""
    return np.argmax(size >= (1 - NEARLY) * size.max(axis=0), axis=0)
