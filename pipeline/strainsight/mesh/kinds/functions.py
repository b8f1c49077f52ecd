"""Polynomials that shape functions are made of: values N (q, k) and gradients ∂N/∂ξ (q, k, d)."""

from __future__ import annotations

from functools import reduce

import numpy as np

from strainsight.mesh.kinds.kind import Edges, Values
from strainsight.mesh.model import FloatArray


def barycentric(xi: FloatArray) -> Values:
    """L₀ = 1 − Σξᵢ, Lᵢ = ξᵢ."""
    q, d = xi.shape
    L = np.column_stack([1.0 - xi.sum(axis=1), xi])
    return L, np.broadcast_to(np.vstack([-np.ones(d), np.eye(d)]), (q, d + 1, d)).copy()


def quadratic_simplex(xi: FloatArray, edges: Edges) -> Values:
    """Corners L(2L − 1), mid-sides 4 L_a L_b."""
    L, dL = barycentric(xi)
    a, b = np.transpose(edges)
    N = np.concatenate([L * (2 * L - 1), 4 * L[:, a] * L[:, b]], axis=1)
    dN = np.concatenate(
        [(4 * L - 1)[..., None] * dL, 4 * (L[:, a, None] * dL[:, b] + L[:, b, None] * dL[:, a])], axis=1
    )
    return N, dN


def multilinear(xi: FloatArray, nodes: FloatArray) -> Values:
    """Π ½(1 + ξ_d ξ_ad)."""
    return _product(*_linear_factors(xi, nodes))


def serendipity(xi: FloatArray, nodes: FloatArray) -> Values:
    """Corners Π ½(1 + ξ_d ξ_ad) (Σ ξ_d ξ_ad − (d − 1)); mid-sides (1 − ξ_m²) Π_{d≠m} ½(1 + ξ_d ξ_ad)."""
    d = nodes.shape[1]
    factor, slope = _linear_factors(xi, nodes)
    along = nodes == 0.0
    bubble = np.broadcast_to(1 - xi[:, None, :] ** 2, factor.shape)
    bubble_slope = np.broadcast_to(-2 * xi[:, None, :], factor.shape)
    N, dN = _product(np.where(along, bubble, factor), np.where(along, bubble_slope, slope))
    corner = ~along.any(axis=1)
    tail = (xi @ nodes[corner].T) - (d - 1)
    dN[:, corner] = dN[:, corner] * tail[..., None] + N[:, corner, None] * nodes[corner]
    N[:, corner] *= tail
    return N, dN


def _linear_factors(xi: FloatArray, nodes: FloatArray) -> Values:
    """½(1 + ξ_d ξ_ad) and its slope, (q, k, d) each."""
    return 0.5 * (1 + xi[:, None, :] * nodes), np.broadcast_to(0.5 * nodes, (len(xi), *nodes.shape))


def _product(factor: FloatArray, slope: FloatArray) -> Values:
    """Π_d f_d and its gradient, f and f′ (q, k, d)."""
    f, df = np.moveaxis(factor, 2, 0), np.moveaxis(slope, 2, 0)
    gradient = [reduce(np.multiply, [df[j] if j == i else f[j] for j in range(len(f))]) for i in range(len(f))]
    return reduce(np.multiply, f), np.stack(gradient, axis=2)
