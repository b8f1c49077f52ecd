"""Forces on the nodes of facets that do the same work as a traction on them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from strainsight.mesh.kinds.kind import Kind
from strainsight.mesh.model import FloatArray, IntArray

Traction = Callable[[FloatArray, FloatArray, FloatArray], FloatArray]
"""x (f, q, 3) [m], outward unit normal n (f, q, 3), place ξ (q, 2) in the reference domain → t (f, q, 3) [Pa]."""


def consistent_forces(position: FloatArray, kind: Kind, nodes: IntArray, traction: Traction) -> FloatArray:
    """f_a = ∫ N_a t dA over each facet: (f, k, 3) [N]; nodes (f, k) rows of position (n, 3) [m]; the rule is that of N Nᵀ."""
    xi, w = kind.mass
    N, dN = kind.functions(xi)
    x = np.einsum("qa,fac->fqc", N, position[nodes])
    J = np.einsum("qad,fac->fqcd", dN, position[nodes])
    area = np.cross(J[..., 0], J[..., 1])
    dA = np.linalg.norm(area, axis=-1)
    n = area / np.where(dA > 0, dA, 1.0)[..., None]
    return np.asarray(np.einsum("q,qa,fq,fqc->fac", w, N, dA, traction(x, n, xi)))
