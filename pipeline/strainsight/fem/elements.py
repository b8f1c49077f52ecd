"""Shape functions of the six solids and the four facets, nodes in VTK order.

Reference domains: simplices 0 ≤ ξᵢ, Σξᵢ ≤ 1; squares and cubes [−1, 1]ᵈ; wedges triangle × [−1, 1].
The wedge's nodes 0, 1, 2 lie at ζ = −1 (as in Nastran, gmsh and vtkWedge's own interpolation).
"""

from __future__ import annotations

import numpy as np

from strainsight.errors import DeckError

_TRIANGLE_EDGES = ((0, 1), (1, 2), (2, 0))
_TETRAHEDRON_EDGES = (*_TRIANGLE_EDGES, (0, 3), (1, 3), (2, 3))
_SQUARE = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], dtype=float)
_SQUARE_EDGES = ((0, 1), (1, 2), (2, 3), (3, 0))
_CUBE = np.vstack([np.column_stack([_SQUARE, np.full(4, level)]) for level in (-1.0, 1.0)])
_CUBE_EDGES = (*_SQUARE_EDGES, (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7))


def _with_midsides(corners: np.ndarray, edges: tuple[tuple[int, int], ...]) -> np.ndarray:
    return np.vstack([corners, [0.5 * (corners[a] + corners[b]) for a, b in edges]])


_TRIANGLE = np.vstack([np.zeros(2), np.eye(2)])
_TETRAHEDRON = np.vstack([np.zeros(3), np.eye(3)])
_WEDGE = np.vstack([np.column_stack([_TRIANGLE, np.full(3, level)]) for level in (-1.0, 1.0)])
_WEDGE_EDGES = (*_TRIANGLE_EDGES, (3, 4), (4, 5), (5, 3), (0, 3), (1, 4), (2, 5))

REFERENCE_NODES: dict[str, np.ndarray] = {
    "tri3": _TRIANGLE,
    "tri6": _with_midsides(_TRIANGLE, _TRIANGLE_EDGES),
    "quad4": _SQUARE,
    "quad8": _with_midsides(_SQUARE, _SQUARE_EDGES),
    "tet4": _TETRAHEDRON,
    "tet10": _with_midsides(_TETRAHEDRON, _TETRAHEDRON_EDGES),
    "hex8": _CUBE,
    "hex20": _with_midsides(_CUBE, _CUBE_EDGES),
    "wedge6": _WEDGE,
    "wedge15": _with_midsides(_WEDGE, _WEDGE_EDGES),
}
MIDSIDE_EDGES: dict[str, dict[int, tuple[int, int]]] = {
    "tet10": {4 + i: edge for i, edge in enumerate(_TETRAHEDRON_EDGES)},
    "hex20": {8 + i: edge for i, edge in enumerate(_CUBE_EDGES)},
    "wedge15": {6 + i: edge for i, edge in enumerate(_WEDGE_EDGES)},
}
SOLID_KINDS = ("tet4", "tet10", "hex8", "hex20", "wedge6", "wedge15")
FACET_KINDS = ("tri3", "tri6", "quad4", "quad8")


def shape(kind: str, xi: np.ndarray) -> np.ndarray:
    """Shape functions N_a(ξ), N_a(ξ_b) = δ_ab: xi (q, d) [-] → (q, k) [-]. Raises DeckError for an unknown kind."""
    return _evaluate(kind, xi)[0]


def shape_gradient(kind: str, xi: np.ndarray) -> np.ndarray:
    """∂N_a/∂ξ_d: xi (q, d) [-] → (q, k, d) [-]. Raises DeckError for an unknown kind."""
    return _evaluate(kind, xi)[1]


def centre(kind: str) -> np.ndarray:
    """Centroid of the reference domain (d,) [-]."""
    nodes = REFERENCE_NODES[kind]
    corners = nodes.shape[1] + 1 if kind.startswith("t") else 6 if kind.startswith("w") else 2 ** nodes.shape[1]
    return nodes[:corners].mean(axis=0)


def bubble_gradient(xi: np.ndarray) -> np.ndarray:
    """∂P_i/∂ξ_d of the incompatible modes P_i = 1 − ξᵢ² of hex8 (Wilson et al. 1973): xi (q, 3) → (q, 3, 3)."""
    return -2.0 * np.asarray(xi)[:, :, None] * np.eye(3)


def _evaluate(kind: str, xi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    xi = np.atleast_2d(xi)
    match kind:
        case "tri3" | "tet4":
            return _barycentric(xi)
        case "tri6":
            return _quadratic_simplex(xi, _TRIANGLE_EDGES)
        case "tet10":
            return _quadratic_simplex(xi, _TETRAHEDRON_EDGES)
        case "quad4" | "hex8":
            return _multilinear(xi, REFERENCE_NODES[kind])
        case "quad8" | "hex20":
            return _serendipity(xi, REFERENCE_NODES[kind])
        case "wedge6":
            return _linear_wedge(xi)
        case "wedge15":
            return _quadratic_wedge(xi)
    raise DeckError(f"element kind {kind!r} is not supported", remedy=f"use {', '.join(SOLID_KINDS)}")


def _barycentric(xi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """L₀ = 1 − Σξᵢ, Lᵢ = ξᵢ."""
    q, d = xi.shape
    L = np.column_stack([1.0 - xi.sum(axis=1), xi])
    return L, np.broadcast_to(np.vstack([-np.ones(d), np.eye(d)]), (q, d + 1, d)).copy()


def _quadratic_simplex(xi: np.ndarray, edges: tuple[tuple[int, int], ...]) -> tuple[np.ndarray, np.ndarray]:
    """Corners L(2L − 1), mid-sides 4 L_a L_b."""
    L, dL = _barycentric(xi)
    a, b = np.transpose(edges)
    N = np.concatenate([L * (2 * L - 1), 4 * L[:, a] * L[:, b]], axis=1)
    dN = np.concatenate(
        [(4 * L - 1)[..., None] * dL, 4 * (L[:, a, None] * dL[:, b] + L[:, b, None] * dL[:, a])], axis=1
    )
    return N, dN


def _linear_factors(xi: np.ndarray, nodes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """½(1 + ξ_d ξ_ad) and its slope, (q, k, d) each."""
    return 0.5 * (1 + xi[:, None, :] * nodes), np.broadcast_to(0.5 * nodes, (len(xi), *nodes.shape))


def _product(factor: np.ndarray, slope: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Π_d f_d and its gradient, f and f′ (q, k, d)."""
    d = factor.shape[2]
    gradient = [np.prod(np.where(np.arange(d) == i, slope, factor), axis=2) for i in range(d)]
    return np.prod(factor, axis=2), np.stack(gradient, axis=2)


def _multilinear(xi: np.ndarray, nodes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Π ½(1 + ξ_d ξ_ad)."""
    return _product(*_linear_factors(xi, nodes))


def _serendipity(xi: np.ndarray, nodes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
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


def _linear_wedge(xi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """L_a ½(1 ± ζ)."""
    L, dL = _barycentric(xi[:, :2])
    z = xi[:, 2, None]
    N = np.concatenate([L * (1 - z) / 2, L * (1 + z) / 2], axis=1)
    plane = np.concatenate([dL * (1 - z)[..., None] / 2, dL * (1 + z)[..., None] / 2], axis=1)
    return N, np.concatenate([plane, np.concatenate([-L / 2, L / 2], axis=1)[..., None]], axis=2)


def _quadratic_wedge(xi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Corners ½L[(2L − 1)(1 ± ζ) − (1 − ζ²)], triangle mid-sides 2 L_a L_b (1 ± ζ), uprights L(1 − ζ²)."""
    L, dL = _barycentric(xi[:, :2])
    z = xi[:, 2, None]
    a, b = np.transpose(_TRIANGLE_EDGES)
    pair, dpair = L[:, a] * L[:, b], L[:, a, None] * dL[:, b] + L[:, b, None] * dL[:, a]
    N, plane, upright = [], [], []
    for sign in (-1.0, 1.0):
        end = 1 + sign * z
        N.append(0.5 * L * ((2 * L - 1) * end - (1 - z**2)))
        plane.append((0.5 * ((4 * L - 1) * end - (1 - z**2)))[..., None] * dL)
        upright.append(0.5 * L * ((2 * L - 1) * sign + 2 * z))
    for sign in (-1.0, 1.0):
        N.append(2 * pair * (1 + sign * z))
        plane.append(2 * dpair * (1 + sign * z)[..., None])
        upright.append(2 * pair * sign)
    N.append(L * (1 - z**2))
    plane.append(dL * (1 - z**2)[..., None])
    upright.append(-2 * z * L)
    gradient = np.concatenate([np.concatenate(plane, axis=1), np.concatenate(upright, axis=1)[..., None]], axis=2)
    return np.concatenate(N, axis=1), gradient
