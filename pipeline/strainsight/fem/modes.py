"""Undamped modes of a structure, supported or free."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy import sparse
from scipy.linalg import eigh, null_space
from scipy.sparse.linalg import ArpackError, LinearOperator, eigsh

from strainsight.errors import NumericalError, UserError
from strainsight.fem.factorisation import Factor, Factorise, Relief, factorise, factorise_free, pinned, relief_of
from strainsight.memory import require_memory

DEPENDENT = 1e-14
"""Share of A⁻¹M q in the norm of M below which what is left of it beside all q is rounding."""
MOST = 1000
"""Blocks after which iterations are given up."""


def largest(
    inverse: Callable[[np.ndarray], np.ndarray],
    M: sparse.csr_array,
    count: int,
    start: np.ndarray,
    most: int,
    tolerance: float,
    beside: int = 0,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The largest μ of A⁻¹M φ = μ φ, in the space of the vectors Q of all blocks:

        A⁻¹M Q = Q T + q [0 R],   QᵀMQ = I,   T s = μ s,   φ = Q s

    Every block is made orthogonal in M to all before it; before Q has more than `most` columns, the best φ take their place
    (thick restart). It ends where every |A⁻¹Mφ − μφ|_M = |R s_last| of the first `count` is at most tolerance · μ. A block sees
    as many copies of a repeated μ as it has vectors, and what the start has no part of is not seen at all.
    inverse: X (n, k) → A⁻¹X; M (n, n) positive semidefinite; start (n, b), in the range of A⁻¹M; beside: how many of the next
    are returned as they stand.
    Returns μ (count + beside,) falling, φ (n, count + beside) with φᵀMφ = 1, and |A⁻¹Mφ − μφ|_M, fewer where there are no more.
    Raises NumericalError where they do not converge.
    Sources: Grimes, Lewis and Simon, SIAM J. Matrix Anal. Appl. 15 (1994); Wu and Simon, ibid. 22 (2000).
    """
    Q, T, used = np.empty((len(start), most), order="F"), np.zeros((0, 0)), 0
    q, Mq, _ = _krylov_beside(Q[:, :0], M, start, M @ start)
    for _ in range(MOST):
        behind = used + q.shape[1]
        Q[:, used:behind] = q
        W = inverse(Mq)
        MW = M @ W
        share = Q[:, :behind].T @ MW
        T = np.block([[T, share[:used]], [share[:used].T, 0.5 * (share[used:] + share[used:].T)]])
        # the largest norm in M of its columns
        whole = float(np.sqrt(np.maximum(np.einsum("ij,ij->j", W, MW), 0.0).max(initial=0.0)))
        W -= Q[:, :behind] @ share
        q, Mq, R = _krylov_beside(Q[:, :behind], M, W, M @ W, DEPENDENT * whole)
        mu, s = eigh(T)
        mu, s = mu[::-1], s[:, ::-1]
        found = min(count + beside, behind)
        left = np.linalg.norm(R @ s[used:, :found], axis=0)
        if not q.shape[1] or (behind >= count and np.all(left[:count] <= tolerance * mu[: min(count, behind)])):
            return mu[:found], Q[:, :behind] @ s[:, :found], left
        used = behind
        if used + q.shape[1] > most:
            used = min(behind, (count + beside + most) // 2)
            Q[:, :used] = Q[:, :behind] @ s[:, :used]
            T = np.diag(mu[:used])
    raise NumericalError(
        f"the Lanczos iterations did not converge in {MOST} steps",
        remedy="check the model for nearly loose parts, or ask for fewer modes",
    )


def _krylov_beside(
    Q: np.ndarray, M: sparse.csr_array, W: np.ndarray, MW: np.ndarray, least: float = 0.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """q, Mq (n, r) and R (r, b) of W = Q C + q R: qᵀMq = I, QᵀMq = 0; r < b where less than b directions are longer than
    `least`. Twice: the first Gram matrix knows what is 1e-8 of the longest by its order only."""
    R, floor = np.eye(W.shape[1]), least
    for first in (True, False):
        W = W - Q @ (Q.T @ MW)
        # QᵀMW = 0 now, so that the old MW gives the products of the new W
        G = W.T @ MW
        size, V = eigh(0.5 * (G + G.T))
        longest = float(size[-1]) if len(size) else 0.0
        if not longest > floor**2:
            return W[:, :0], MW[:, :0], R[:0]
        if first:
            size = np.maximum(size, 1e-15 * longest)
        else:
            kept = (size > 1e-12) & (np.linalg.norm(np.sqrt(np.abs(size))[:, None] * (V.T @ R), axis=1) > least)
            size, V = size[kept], V[:, kept]
        turn = V / np.sqrt(size)
        W, R, floor = W @ turn, np.sqrt(size)[:, None] * (V.T @ R), 0.0
        MW = M @ W if first else MW @ turn
    return W, MW, R


DENSE_LIMIT = 300
GUARD = 4
BESIDE = 2
"""Modes that are looked for beside those found."""
CLOSELY, EXTRA = 1e-10, 2
"""Share of 1/λ to which modes are found from others that are near, and how many of those are taken beside the modes."""
ROUGHLY, ROUGH_BASIS = 1e-3, 24
"""Share of 1/λ to which the modes beside those found are looked for first, and vectors that this may take at a time."""
REPEATED = 1e-7
"""Values ω² closer to the first of them than this share of it are one frequency."""
SINGLY = 60
"""Modes up to which vectors are iterated one at a time: the small problem after each of them costs more than ARPACK beyond."""
NEARLY = 1e-6
"""Components that differ by less than this share are equally large: symmetry makes them so, and the first counts."""


def modes(
    K: sparse.csr_array,
    M: sparse.csr_array,
    count: int,
    *,
    shift: float = 0.0,
    factor: Factor | None = None,
    rigid: np.ndarray | None = None,
    by: Factorise = factorise,
    near: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """The lowest modes, by Lanczos iterations on (K − σM)⁻¹M, seeded, and iterations beside those found:

        K φ = ω² M φ,     φᵀMφ = 1,     the largest component of φ positive

    Of modes of one frequency the first has the largest component that any combination of them has, and so on (`turned`):
    no rounding chooses among the combinations. Small models, and those of which few unknowns have mass, are solved densely.
    K, M (n, n) symmetric, K − σM positive definite, M positive semidefinite; count ≤ the rank of M; shift σ ≤ 0
    [rad²/s²]: 0 for a supported structure, negative for a free one (its rigid motions then come first); factor of
    K − σM, where there is one; rigid (n, k): all motions without stiffness of a free structure, whose elastic modes alone
    are then found, without a shift, with `factorise_free` as factor; by: who factorises where there is no factor. A factor that
    has `lowest` iterates by itself (Krylov and Schur, SLEPc); order, copies and checks are the same. near (n, r): vectors whose
    span holds the modes nearly, as those of other parameters do: block iterations from there take half of the solutions, four
    at once. Either way |A⁻¹Mφ − φ/λ| ≤ `CLOSELY`/λ in the norm of M, so that 1/λ is off by the square of that over its distance
    from the others. Where a copy of a frequency may be missing, or the last one asked for is met again, ARPACK's iterations are
    repeated beside what they find until nothing is.

    Returns frequency (count,) [Hz] ascending and shapes (n, count) [1/√kg].
    Raises UserError for too large a count, for a mechanism (a mode without stiffness) and where the memory is not enough,
    NumericalError where a mode does not converge or K − σM is not positive definite.
    """
    relief = None if rigid is None else relief_of(M, rigid)
    massive = _massive(M, relief)
    if not 1 <= count <= massive:
        beside = "" if relief is None else f" beside {relief.shapes.shape[1]} rigid motions"
        raise UserError(
            f"{count} modes of a model with {massive} unknowns that have mass{beside}", remedy=f"ask for 1 to {massive}"
        )
    if shift > 0 or (shift and relief is not None):
        raise ValueError("the shift must not be positive, and 0 where the rigid motions are given")
    A = K if shift == 0 else sparse.csr_array(K - shift * M)
    inverse, shapes = _lowest(A, M, count, factor, relief, by, near)
    inverse, shapes = inverse[:count], (shapes @ turned(inverse, shapes))[:, :count]
    lam = 1.0 / inverse + shift
    _check(A, M, lam - shift, shapes)
    return np.sqrt(np.maximum(lam, 0.0)) / (2 * np.pi), shapes * signs(shapes)


def _massive(M: sparse.csr_array, relief: Relief | None) -> int:
    """The rank of M, of a free structure that of its elastic part."""
    return int(np.count_nonzero(M.diagonal() > 0)) - (0 if relief is None else relief.shapes.shape[1])


def _lowest(
    A: sparse.csr_array,
    M: sparse.csr_array,
    count: int,
    factor: Factor | None,
    relief: Relief | None,
    by: Factorise,
    near: np.ndarray | None,
) -> tuple[np.ndarray, np.ndarray]:
    """1/λ and φ of the modes, and of a few more: until no copy of the last frequency asked for is cut off."""
    n, massive, guard = A.shape[0], _massive(M, relief), GUARD
    while True:
        wanted = min(count + guard, massive)
        if n <= DENSE_LIMIT or _basis(wanted) > n:
            require_memory(8.0 * n * (4 * n + wanted), f"{count} modes of {n} unknowns")
            if relief is None:
                inverse, shapes = _dense(A.toarray(), M.toarray(), count, wanted)
            else:
                # (M − MR(MR)ᵀ)φ′ = (1/λ) A′φ′ on the springs of `pinned`: φ′ is φ moved so that they are not stretched
                M_elastic = M.toarray() - relief.inertia @ relief.inertia.T
                inverse, moved = _dense(pinned(A, relief.shapes).toarray(), M_elastic, count, wanted)
                shapes = relief.elastic(moved)
        else:
            factor = factor or (by(A) if relief is None else factorise_free(A, relief, by))
            if _basis(wanted) <= massive:
                found = _iterated(A, M, count, factor, near)
                if found is not None:
                    return found
                inverse, shapes = _lanczos(A, M, count, wanted, factor)
            else:
                inverse, shapes = _condensed(A, M, count, wanted, factor, relief)
        if _frequencies(inverse)[-1] >= count or len(inverse) < count + guard:
            return inverse, shapes
        guard *= 2


def _dense(A: np.ndarray, M: np.ndarray, count: int, wanted: int) -> tuple[np.ndarray, np.ndarray]:
    """M φ = (1/λ) A φ, because M may be singular and A is not."""
    n = len(A)
    try:
        inverse, V = eigh(M, A, subset_by_index=(n - wanted, n - 1))
    except np.linalg.LinAlgError:
        raise NumericalError(
            "the stiffness is not positive definite",
            remedy="the structure has a mechanism: check supports and connections",
        ) from None
    # beside those asked for, what has no mass is no mode
    found = max(count, int(np.count_nonzero(inverse > n * np.finfo(float).eps * inverse[-1])))
    return inverse[-found:][::-1], (V[:, -found:] / np.sqrt(inverse[-found:]))[:, ::-1]


def _condensed(
    A: sparse.csr_array, M: sparse.csr_array, count: int, wanted: int, factor: Factor, relief: Relief | None
) -> tuple[np.ndarray, np.ndarray]:
    """Few unknowns have mass: φ = Z y of the responses Z to a unit force on each, ZᵀMZ y = (1/λ) ZᵀAZ y, and no others; of
    a free structure to forces on them that balance."""
    n, massive = A.shape[0], np.flatnonzero(M.diagonal() > 0)
    require_memory(8.0 * n * (3 * len(massive) + wanted), f"{count} modes of {n} unknowns")
    forces = np.zeros((n, len(massive)))
    forces[massive, np.arange(len(massive))] = 1.0
    if relief is not None:
        forces = forces @ null_space(relief.shapes[massive].T)
    Z = factor.solve(forces)
    flexibility = forces.T @ Z
    inverse, Y = _dense(0.5 * (flexibility + flexibility.T), Z.T @ (M @ Z), count, wanted)
    return inverse, Z @ Y


def _basis(wanted: int) -> int:
    """Vectors of the Lanczos iterations, which need as many unknowns with mass."""
    return 2 * wanted + 10


def _lanczos(
    A: sparse.csr_array, M: sparse.csr_array, count: int, wanted: int, factor: Factor
) -> tuple[np.ndarray, np.ndarray]:
    """One start vector sees one copy of a repeated frequency, the others are rounding's to find: so the iterations are repeated
    beside what is found, x ← (I − Φ ΦᵀM) x, until nothing that they find there is lower than the last. Where 1/λ is known to
    `ROUGHLY` there, |error| ≤ `ROUGHLY`/λ, that mostly says so already, for a third of the solutions."""
    n = A.shape[0]
    require_memory(8.0 * n * (_basis(wanted) + 3 * wanted), f"{count} modes of {n} unknowns")
    inverse, shapes = _beside(A, M, wanted, factor, np.zeros((n, 0)))
    while True:
        if factor.lowest is not None:
            more, _ = _beside(A, M, BESIDE, factor, shapes, ROUGHLY)
            lower = (1 + ROUGHLY) * more[0] > inverse[-1]
        else:
            lower = not _nothing_beside(M, factor, shapes, inverse[-1])
        if not lower:
            return inverse, shapes
        more, others = _beside(A, M, BESIDE, factor, shapes)
        if more[0] <= (1 + REPEATED) * inverse[-1]:
            return inverse, shapes
        order = np.argsort(-np.concatenate([inverse, more]), kind="stable")[:wanted]
        inverse, shapes = np.concatenate([inverse, more])[order], np.hstack([shapes, others])[:, order]


def _iterated(
    A: sparse.csr_array, M: sparse.csr_array, count: int, factor: Factor, near: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray] | None:
    """1/λ and φ of the modes and the next one, of which the value alone is needed, from modes that are near or from one vector;
    None where the next one is, or something beside them may be, as low as the last: `_lanczos` sorts that out."""
    if factor.lowest is not None or (near is None and count > SINGLY):
        return None
    n, width = A.shape[0], 1 if near is None or near.shape[1] < count + EXTRA else count + EXTRA
    most = 3 * (count + EXTRA) + 30 if width == 1 else 12 * (count + EXTRA)
    require_memory(8.0 * n * (most + 5 * (count + EXTRA)), f"{count} modes of {n} unknowns")
    try:
        if near is None or width == 1:
            start = factor.solve(M @ np.random.default_rng(0).standard_normal((n, 1)))
        else:
            r = near.shape[1]
            Y = eigh(near.T @ (M @ near), near.T @ (A @ near), subset_by_index=(r - width, r - 1))[1]
            start = _by_fours(factor, M @ (near @ Y))
        inverse, shapes, left = largest(lambda X: _by_fours(factor, X), M, count, start, most, CLOSELY, beside=1)
    except (np.linalg.LinAlgError, NumericalError):
        return None  # they depend on each other, or lead nowhere
    if len(inverse) <= count or inverse[-1] + left[-1] >= (1 - REPEATED) * inverse[count - 1]:
        return None
    return (inverse, shapes) if _nothing_beside(M, factor, shapes, inverse[count - 1]) else None


def _nothing_beside(M: sparse.csr_array, factor: Factor, shapes: np.ndarray, last: float) -> bool:
    """Whether the largest 1/λ in the complement of shapes (n, k), which are orthonormal in M, is below `last`, by iterations to
    `ROUGHLY` of it."""
    solve = _beside_them(M, factor, shapes)
    start = solve(M @ np.random.default_rng(1).standard_normal((len(shapes), 1)))
    try:
        more, _, _ = largest(solve, M, 1, start, ROUGH_BASIS, ROUGHLY)
    except (np.linalg.LinAlgError, NumericalError):
        return False
    return not len(more) or bool((1 + ROUGHLY) * more[0] <= last)


def _beside_them(M: sparse.csr_array, factor: Factor, shapes: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    """(I − Φ ΦᵀM) A⁻¹ of shapes Φ (n, k), which are orthonormal in M."""
    weighted = M @ shapes

    def solve(X: np.ndarray) -> np.ndarray:
        Y = factor.solve(X)
        return np.asarray(Y - shapes @ (weighted.T @ Y))

    return solve


def _by_fours(factor: Factor, B: np.ndarray) -> np.ndarray:
    """A⁻¹B: four at once take less than twice the time of one, and, unlike more, come out the same with any number of threads."""
    return np.hstack([factor.solve(B[:, first : first + 4]) for first in range(0, B.shape[1], 4)])


def _beside(
    A: sparse.csr_array, M: sparse.csr_array, count: int, factor: Factor, shapes: np.ndarray, tolerance: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """1/λ, falling, and φ of the lowest modes in the complement of shapes (n, k), which are orthonormal in M; to a share
    `tolerance` of 1/λ, 0: to rounding."""
    n, solve = A.shape[0], _beside_them(M, factor, shapes)
    start = M @ np.random.default_rng(0).standard_normal(n)
    if factor.lowest is not None:
        lam, V = factor.lowest(M, count, _basis(count), solve(start), shapes, tolerance)
        return _ascending(M, lam, V)
    inverted = LinearOperator((n, n), matvec=solve, matmat=solve, dtype=float)
    try:
        lam, V = eigsh(A, count, M=M, sigma=0.0, OPinv=inverted, v0=solve(start), ncv=_basis(count), tol=tolerance)
    except ArpackError as error:
        raise NumericalError(
            f"the Lanczos iterations did not converge: {error}",
            remedy="check the model for nearly loose parts, or ask for fewer modes",
        ) from None
    return _ascending(M, lam, V)


def _ascending(M: sparse.csr_array, lam: np.ndarray, V: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """1/λ, falling, and φ with φᵀMφ = 1."""
    order = np.argsort(lam)
    V = V[:, order]
    return 1.0 / lam[order], V / np.sqrt(np.einsum("ij,ij->j", V, M @ V))


def _check(A: sparse.csr_array, M: sparse.csr_array, lam: np.ndarray, shapes: np.ndarray) -> None:
    """A mode whose energy is rounding error is a mechanism; the others must satisfy the equation."""
    m, k = M.diagonal(), A.diagonal()
    stiffest = (k[m > 0] / m[m > 0]).max()
    # φᵀAφ = λ may be a difference of terms that are 1e12 times as large; a rotation about the normal of a shell that is not quite
    # along an axis has next to no mass, and K_ii/M_ii alone says nothing there
    size = np.abs(shapes[:, 0])
    if not lam[0] > 1e-15 * stiffest and not lam[0] > 1e-12 * float(size @ (abs(A) @ size)):
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
    for own in np.split(np.arange(len(values)), _frequencies(values)[1:]):
        for first in range(len(own) - 1):
            rest = own[first:]
            V = shapes[:, own] @ T[np.ix_(own, rest)]
            longest = _largest(np.linalg.norm(V, axis=1))
            T[np.ix_(own, rest)] = T[np.ix_(own, rest)] @ np.linalg.qr(V[longest][:, None], mode="complete")[0]
    return T


def signs(shapes: np.ndarray) -> np.ndarray:
    """±1 (k,): the sign of the first of the largest components of shapes (n, k), so that rounding cannot flip a symmetric
    one."""
    first = _largest(np.abs(shapes))
    return np.asarray(np.sign(shapes[first, np.arange(shapes.shape[1])]))


def _frequencies(values: np.ndarray) -> list[int]:
    """Where each frequency of the ordered values begins; the values of one are all `REPEATED` near to its first."""
    first = [0]
    for i, value in enumerate(values):
        if abs(value - values[first[-1]]) > REPEATED * abs(values[first[-1]]):
            first.append(i)
    return first


def _largest(size: np.ndarray) -> np.ndarray:
    """Where along the first axis the first of the largest stands."""
    return np.argmax(size >= (1 - NEARLY) * size.max(axis=0), axis=0)
