"""Sparse factors of symmetric matrices, real and complex, by PARDISO or SuperLU, and inertia relief of free structures."""

from __future__ import annotations

import ctypes
import os
import sys
import warnings
import weakref
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from hashlib import blake2b
from pathlib import Path
from threading import current_thread, main_thread
from typing import Any, Protocol

import numpy as np
from scipy import sparse
from scipy.linalg import qr
from scipy.sparse.linalg import SuperLU, splu

from strainsight.errors import MachineWarning, NumericalError, UserError
from strainsight.memory import require_memory

NOT_DEFINITE = "the stiffness matrix is not positive definite: a pivot of its factorisation is not positive"
MECHANISM = "Check supports, connections and materials: a part of the structure can move freely or has no stiffness."
POSITIVE_DEFINITE = 2
ANALYSE, FACTORISE, SOLVE = 11, 22, 33
OWN_VALUES, ORDERING, NUMERICAL_MEMORY, FROM_ZERO = 1, 2, 17, 35
"""Indices of iparm, counted from 1 as in the manual of oneMKL."""
NESTED_DISSECTION = 2
_NOT_DEFINITE, _NO_MEMORY = -4, -2
_MKL_CBWR_AUTO, _MKL_CBWR_AVX2 = 2, 10


def pardiso(upper: sparse.csr_array) -> Callable[[np.ndarray], np.ndarray]:
    """Factorise A = LLᵀ and return B (n, r) → A⁻¹B.

    upper (n, n) the upper triangle of A, CSR with sorted indices. The memory of the factor is freed with the last reference to
    the result. Raises ImportError or OSError if PARDISO cannot be loaded, NumericalError if A is not positive definite, and
    UserError if the memory estimated by the analysis is not available."""
    return factorise_with(upper, POSITIVE_DEFINITE, f"the factorisation with {upper.shape[0]} degrees of freedom")[0]


def factorise_with(
    upper: sparse.csr_array, kind: int, what: str, options: Sequence[tuple[int, int]] = ()
) -> tuple[Callable[[np.ndarray], np.ndarray], np.ndarray]:
    """B (n, r) → A⁻¹B, and iparm after the factorisation; kind of A, what: its description, options of iparm.

    Otherwise as `pardiso`."""
    solver = solver_of(kind)
    # Everything else stays zero. With its defaults PARDISO orders with several threads, which differs between runs, and refines
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

    The function of pypardiso compares the matrix with its copy before each solve, or copies all its indices. Solutions use one
    thread: with several, the last bits depend on the number of columns, and the time was no shorter."""
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
        return NumericalError(NOT_DEFINITE, remedy=MECHANISM)
    if code == _NO_MEMORY:
        return UserError(
            f"the memory is not sufficient to factorise the stiffness matrix of {size} degrees of freedom",
            remedy="Use a coarser mesh or a computer with more memory, or close other programs.",
        )
    return NumericalError(
        f"the equation solver PARDISO stopped with error code {code} in phase {phase} ({size} degrees of freedom)",
        remedy="Look up the error code in the manual of oneMKL, section pardiso.",
    )


def solver_of(kind: int) -> Any:
    """PARDISO for matrices of that kind, with bitwise equal results on every run for any alignment of the arrays.

    MKL fixes its code branch before its first computation, so no other solver may exist. Raises ImportError or OSError if
    PARDISO cannot be loaded."""
    name_mkl()  # first, because the import creates a solver
    from pypardiso import PyPardisoSolver

    solver = PyPardisoSolver(mtype=kind)
    if current_thread() is not main_thread():  # other threads share the cores
        solver.libmkl.MKL_Set_Num_Threads_Local(1)
    if solver.libmkl.MKL_CBWR_Set(_MKL_CBWR_AVX2) != 0:
        solver.libmkl.MKL_CBWR_Set(_MKL_CBWR_AUTO)
    return solver


def name_mkl() -> None:
    """Set the path of the MKL library installed by pip; otherwise pypardiso searches the whole environment for every factor
    (0.3 s). Threads of MKL sleep between calls; otherwise they spin for 0.2 s on cores that NumPy needs."""
    os.environ.setdefault("KMP_BLOCKTIME", "0")
    if libraries := sorted(Path(sys.prefix, "lib").glob("libmkl_rt.so*")):
        os.environ.setdefault("PYPARDISO_MKL_RT", str(libraries[0]))


SUPERLU_LIMIT = 100_000
BLOCK = 32
LEAST_BYTES = 32
"""PARDISO's analysis, the upper triangle and a factor without fill, per entry of the matrix."""


class Lowest(Protocol):
    """lowest(M, count, basis, start, known, tolerance): λ (count,) and φ (n, count) of A φ = λ M φ, the lowest modes M-orthogonal
    to `known` (n, k), which are M-orthonormal; by iterations with `basis` vectors from `start` (n,)."""

    def __call__(
        self, M: sparse.csr_array, count: int, basis: int, start: np.ndarray, known: np.ndarray, tolerance: float, /
    ) -> tuple[np.ndarray, np.ndarray]: ...


@dataclass(frozen=True)
class Factor:
    """A factorised symmetric positive definite matrix; its memory is freed with the last reference to it. lowest: eigenvalue
    iterations by the owner of the factor, None for those of this package."""

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
            raise NumericalError("the solution of the linear equations is not finite", remedy=MECHANISM)
        return X.reshape(B.shape)


Factorise = Callable[[sparse.csr_array], Factor]
"""A factorisation: `factorise`, or one distributed over MPI processes (`contrib.mpi.session`)."""


def factorise(A: sparse.csr_array) -> Factor:
    """A = LLᵀ by PARDISO (mtype 2, upper triangle), or by SuperLU with a warning where PARDISO cannot be loaded.

    A (n, n) symmetric positive definite CSR; only its upper triangle is used. The matrix is scaled to a unit diagonal
    first, so that translations and rotations, or units far from SI, do not affect the pivots.
    Raises NumericalError if A is not positive definite; UserError if the memory is not sufficient (known after the analysis
    of PARDISO, before its factorisation), and above 100 000 degrees of freedom without PARDISO."""
    scale, size = diagonal_scaling(A), A.shape[0]
    require_memory(LEAST_BYTES * A.nnz, f"the factorisation with {size} degrees of freedom")
    upper = scaled_upper(A, scale)
    try:
        solve, name = pardiso(upper), "PARDISO"
    except (ImportError, OSError):
        if size > SUPERLU_LIMIT:
            raise too_large(size) from None
        warnings.warn(
            "the equation solver PARDISO is not available. SuperLU replaces it: it is two to five times slower and limited to "
            "100 000 degrees of freedom. On x86-64, install PARDISO with: pip install pypardiso",
            MachineWarning,
            stacklevel=2,
        )
        factor = superlu(upper, "the stiffness matrix")
        if np.any(factor.U.diagonal() <= 0):
            raise NumericalError(NOT_DEFINITE, remedy=MECHANISM) from None
        solve, name = factor.solve, "SuperLU"

    def scaled_solve(B: np.ndarray) -> np.ndarray:
        X = solve(np.multiply(scale[:, None], B, order="F"))
        X *= scale[:, None]
        return X

    return Factor(size, name, scaled_solve)


_KEPT: list[tuple[bytes, Factor]] = []
"""Digest of a matrix and its factor, at most one."""


def factorise_and_keep(A: sparse.csr_array) -> Factor:
    """`factorise`; the factor is kept for the next `factorise_or_reuse`, as `rom` follows `modes` with the same matrix."""
    _KEPT.clear()  # before the memory of the next one is needed
    factor = factorise(A)
    _KEPT.append((_digest(A), factor))
    return factor


def factorise_or_reuse(A: sparse.csr_array) -> Factor:
    """The kept factor if A is the same to the bit, otherwise `factorise`; no factor is kept after it."""
    kept = _KEPT.pop() if _KEPT else None
    if kept is not None and kept[0] == _digest(A):
        return kept[1]
    del kept
    return factorise(A)


def _digest(A: sparse.csr_array) -> bytes:
    digest = blake2b()
    for part in (A.indptr, A.indices, A.data):
        digest.update(np.ascontiguousarray(part).data)
    return digest.digest()


def diagonal_scaling(A: sparse.csr_array) -> np.ndarray:
    """s (n,) for which SAS, S = diag(s), has a unit diagonal. Raises NumericalError if A has a diagonal entry ≤ 0."""
    diagonal = A.diagonal()
    if not np.all(diagonal > 0):
        raise NumericalError(
            f"the stiffness matrix is not positive definite: diagonal entry {int(np.argmin(diagonal > 0))} is "
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
    """Error for this number of degrees of freedom without PARDISO."""
    return UserError(
        f"the model has {size} degrees of freedom, the equation solver SuperLU is limited to 100 000, PARDISO is not installed",
        remedy="Install PARDISO (pip install pypardiso, x86-64), or coarsen the mesh below 100 000 degrees of freedom.",
    )


def superlu(upper: sparse.csr_array, what: str) -> SuperLU:
    """The factor of a symmetric matrix from its upper triangle, without pivoting; NumericalError if it is singular."""
    full = sparse.csc_matrix(upper + sparse.triu(upper, 1).T)
    try:
        return splu(full, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    except RuntimeError as error:
        raise NumericalError(f"{what} is singular ({error})", remedy=MECHANISM) from None


COMPLEX_SYMMETRIC = 6
PERTURBATION, PERTURBED, PIVOTING = 10, 14, 21
_TINY = 13
"""Exponent of the smallest pivot: below 1e-13 of the matrix the factorisation fails."""
COMPLEX_BYTES = 64
"""PARDISO's analysis, the upper triangle and a factor without fill, per entry of the matrix."""


def factorise_complex(A: sparse.csr_array) -> Callable[[np.ndarray], np.ndarray]:
    """A = LDLᵀ without pivoting, by PARDISO or SuperLU; returns b (n,) → A⁻¹b.

    A (n, n) complex symmetric (A = Aᵀ); only its upper triangle is used. Some complex multiple of A must have a positive
    definite real part, so that no pivot can vanish. (K + sC + s²M)/s has one for Re s > 0.
    Raises NumericalError if a pivot vanishes, UserError if the memory is not sufficient and above 100 000 degrees of
    freedom without PARDISO.
    Source: Higham, Mathematics of Computation 67 (1998); George, Ikramov and Kucherov, SIAM J. Matrix Anal. 23 (2002)."""
    require_memory(COMPLEX_BYTES * A.nnz, f"the complex factorisation with {A.shape[0]} degrees of freedom")
    size = np.abs(A.diagonal())
    if not np.all(size > 0):
        raise NumericalError("the dynamic stiffness matrix has a zero on the diagonal", remedy=MECHANISM)
    scale = 1.0 / np.sqrt(size)
    upper = scaled_upper(A, scale)
    try:
        solve = _pardiso(upper)
    except (ImportError, OSError):
        if A.shape[0] > SUPERLU_LIMIT:
            raise too_large(A.shape[0]) from None
        solve = superlu(upper, "the dynamic stiffness matrix").solve
    return lambda b: scale * solve(scale * b)


def _pardiso(upper: sparse.csr_array) -> Callable[[np.ndarray], np.ndarray]:
    what = f"the complex factorisation with {upper.shape[0]} degrees of freedom"
    solve, iparm = factorise_with(upper, COMPLEX_SYMMETRIC, what, ((PERTURBATION, _TINY), (PIVOTING, 0)))
    if iparm[PERTURBED - 1]:
        raise NumericalError("a pivot of the dynamic stiffness matrix is zero", remedy=MECHANISM)
    return lambda b: solve(b[:, None])[:, 0]


MASSLESS = 1e-12
"""Smallest inertia of a rigid-body motion, as a share of the largest."""


@dataclass(frozen=True)
class Relief:
    """R (n, k) [1/√kg], a basis of the rigid-body motions with KR = 0 and RᵀMR = I, and inertia MR (n, k) [√kg].

    Elastic modes are M-orthogonal to R: z = R r + z_e, r̈ = Rᵀf, and z_e has no rigid-body component."""

    shapes: np.ndarray
    inertia: np.ndarray

    def balance(self, F: np.ndarray) -> np.ndarray:
        """F − MRRᵀF: forces (n, k) in equilibrium with the inertia forces of the rigid-body acceleration that they cause."""
        return np.asarray(F - self.inertia @ (self.shapes.T @ F))

    def elastic(self, Z: np.ndarray) -> np.ndarray:
        """Z − R(MR)ᵀZ: displacements (n, k) without their rigid-body motions."""
        return np.asarray(Z - self.shapes @ (self.inertia.T @ Z))


def relief_of(M: sparse.csr_array, rigid: np.ndarray) -> Relief:
    """rigid (n, k): any basis of the rigid-body motions. Raises UserError if one of them has no mass."""
    rigid = rigid / np.linalg.norm(rigid, axis=0)
    moment, V = np.linalg.eigh(rigid.T @ (M @ rigid))
    if not moment[0] > MASSLESS * moment[-1]:
        raise UserError(
            "a rigid-body motion of the structure has no mass",
            key="mesh.free",
            remedy="Specify the density of all materials.",
        )
    shapes = rigid @ (V / np.sqrt(moment))
    return Relief(shapes, np.asarray(M @ shapes))


def pin_rigid_motions(K: sparse.csr_array, rigid: np.ndarray) -> sparse.csr_array:
    """K with a spring to the ground in k degrees of freedom that R (n, k) moves independently: positive definite.

    A statically determinate support: balanced forces cause no force in its springs, for any spring stiffness."""
    at = qr(rigid.T, mode="r", pivoting=True)[1][: rigid.shape[1]]
    diagonal = np.zeros(K.shape[0])
    diagonal[at] = K.diagonal()[at]
    return sparse.csr_array(K + sparse.diags_array(diagonal))


def factorise_free(K: sparse.csr_array, relief: Relief, by: Factorise = factorise) -> Factor:
    """The inverse of K in the space of elastic motions, as a factor:

        K⁺f = (I − R(MR)ᵀ) A⁻¹ (f − MRRᵀf),     A = K and the springs of `pin_rigid_motions`;     M K⁺f ⊥ R,  K K⁺f = f − MRRᵀf

    Raises the errors of `factorise`."""
    inner = by(pin_rigid_motions(K, relief.shapes))

    def lowest(
        M: sparse.csr_array, count: int, basis: int, start: np.ndarray, known: np.ndarray, tolerance: float, /
    ) -> tuple[np.ndarray, np.ndarray]:
        """Modes M-orthogonal to R, so that no vector of the iterations stretches a spring; the solver may return A⁻¹Mφ for φ,
        which contains rigid-body motions."""
        assert inner.lowest is not None
        values, modes = inner.lowest(M, count, basis, start, np.hstack([relief.shapes, known]), tolerance)
        return values, relief.elastic(modes)

    return Factor(
        inner.size,
        inner.solver,
        lambda B: relief.elastic(inner.solve(relief.balance(B))),
        None if inner.lowest is None else lowest,
    )
