"""Inertia relief: what a structure that nothing holds does beside its rigid motions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.linalg import qr

from strainsight.errors import UserError
from strainsight.fem.factorisation import Factor, Factorise, factorise

MASSLESS = 1e-12
"""Share of the largest inertia below which a rigid motion has none."""


@dataclass(frozen=True)
class Relief:
    """R (n, k) [1/√kg], a basis of the rigid motions with KR = 0 and RᵀMR = I, and inertia MR (n, k) [√kg].

    The modes that strain the structure are orthogonal to R in M: z = R r + z_e, r̈ = Rᵀf, and z_e has no part of R.
    """

    shapes: np.ndarray
    inertia: np.ndarray

    def balanced(self, F: np.ndarray) -> np.ndarray:
        """F − MRRᵀF: forces (n, k) and the inertia forces of the rigid accelerations that they cause, in equilibrium."""
        return np.asarray(F - self.inertia @ (self.shapes.T @ F))

    def elastic(self, Z: np.ndarray) -> np.ndarray:
        """Z − R(MR)ᵀZ: displacements (n, k) without their rigid motions."""
        return np.asarray(Z - self.shapes @ (self.inertia.T @ Z))


def relief_of(M: sparse.csr_array, rigid: np.ndarray) -> Relief:
    """rigid (n, k): any basis of the rigid motions. Raises UserError where one of them moves no mass."""
    rigid = rigid / np.linalg.norm(rigid, axis=0)
    moment, V = np.linalg.eigh(rigid.T @ (M @ rigid))
    if not moment[0] > MASSLESS * moment[-1]:
        raise UserError(
            "a rigid motion of the structure moves no mass", key="mesh.free", remedy="give its materials a density"
        )
    shapes = rigid @ (V / np.sqrt(moment))
    return Relief(shapes, np.asarray(M @ shapes))


def pinned(K: sparse.csr_array, rigid: np.ndarray) -> sparse.csr_array:
    """K with a spring to the ground in k unknowns that R (n, k) moves independently: positive definite.

    A statically determinate support: forces in equilibrium leave its springs alone, whatever their stiffness.
    """
    at = qr(rigid.T, mode="r", pivoting=True)[1][: rigid.shape[1]]
    diagonal = np.zeros(K.shape[0])
    diagonal[at] = K.diagonal()[at]
    return sparse.csr_array(K + sparse.diags_array(diagonal))


def factorise_free(K: sparse.csr_array, relief: Relief, by: Factorise = factorise) -> Factor:
    """The inverse of K in the space of elastic motions, as a factor:

        K⁺f = (I − R(MR)ᵀ) A⁻¹ (f − MRRᵀf),     A = K and the springs of `pinned`;     M K⁺f ⊥ R,  K K⁺f = f − MRRᵀf

    Raises the errors of `factorise`.
    """
    inner = by(pinned(K, relief.shapes))

    def lowest(
        M: sparse.csr_array, count: int, basis: int, start: np.ndarray, beside: np.ndarray, tolerance: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Orthogonal to R in M, so that no vector of the iterations stretches a spring; A⁻¹Mφ that a solver may return for φ
        holds rigid motions."""
        assert inner.lowest is not None
        values, moved = inner.lowest(M, count, basis, start, np.hstack([relief.shapes, beside]), tolerance)
        return values, relief.elastic(moved)

    return Factor(
        inner.size,
        inner.solver,
        lambda B: relief.elastic(inner.solve(relief.balanced(B))),
        None if inner.lowest is None else lowest,
    )
