"""Quadrature rules on the reference domains of `elements`.

"stiffness" integrates ∇N ∇Nᵀ and "mass" N Nᵀ exactly where the Jacobian is constant; facets have one rule for both.
"""

from __future__ import annotations

from itertools import permutations
from typing import Literal

import numpy as np

from strainsight.errors import DeckError


def quadrature(kind: str, purpose: Literal["stiffness", "mass"] = "stiffness") -> tuple[np.ndarray, np.ndarray]:
    """∫ f dξ ≈ Σ w_q f(ξ_q): points (q, d) [-] and positive weights (q,) [-] that sum to the domain's measure.

    Raises DeckError for an unknown kind.
    """
    match kind:
        case "tet4":
            return _tetrahedron(1 if purpose == "stiffness" else 2)
        case "tet10":
            return _tetrahedron(2 if purpose == "stiffness" else 5)
        case "hex8":
            return _gauss(2, 3)
        case "hex20":
            return _gauss(3, 3)
        case "wedge6":
            return _wedge(2, 2)
        case "wedge15":
            return _wedge(4, 3)
        case "tri3":
            return _triangle(2)
        case "tri6":
            return _triangle(4)
        case "quad4":
            return _gauss(2, 2)
        case "quad8":
            return _gauss(3, 2)
    raise DeckError(f"no quadrature rule for element kind {kind!r}")


def _gauss(points: int, d: int) -> tuple[np.ndarray, np.ndarray]:
    """Gauss-Legendre product rule, exact for degree 2·points − 1 in each direction."""
    x, w = np.polynomial.legendre.leggauss(points)
    grid = np.stack(np.meshgrid(*[x] * d, indexing="ij"), axis=-1).reshape(-1, d)
    weights = np.prod(np.stack(np.meshgrid(*[w] * d, indexing="ij"), axis=-1), axis=-1).ravel()
    return grid, weights


def _orbits(size: int, orbits: list[tuple[tuple[float, ...], float]]) -> tuple[np.ndarray, np.ndarray]:
    """All distinct permutations of barycentric points (one coordinate dropped) with their weights."""
    points, weights = [], []
    for point, weight in orbits:
        for permuted in sorted(set(permutations(point))):
            points.append(permuted[1:])
            weights.append(weight)
    return np.array(points).reshape(-1, size), np.array(weights)


def _triangle(degree: int) -> tuple[np.ndarray, np.ndarray]:
    """Symmetric rules of Dunavant (1985) on the unit triangle, in closed form."""
    if degree == 2:
        return _orbits(2, [((1 / 6, 1 / 6, 2 / 3), 1 / 6)])
    root = np.sqrt(38 - 44 * np.sqrt(2 / 5))
    spread = np.sqrt(213125 - 53320 * np.sqrt(10))
    a, wa = (8 - np.sqrt(10) + root) / 18, (620 + spread) / 3720
    b, wb = (8 - np.sqrt(10) - root) / 18, (620 - spread) / 3720
    return _orbits(2, [((a, a, 1 - 2 * a), wa / 2), ((b, b, 1 - 2 * b), wb / 2)])


def _tetrahedron(degree: int) -> tuple[np.ndarray, np.ndarray]:
    """Centroid rule, the four-point rule of degree 2, Walkington's (2000) fourteen points of degree 5."""
    if degree == 1:
        return np.full((1, 3), 0.25), np.array([1 / 6])
    if degree == 2:
        a = (5 - np.sqrt(5)) / 20
        return _orbits(3, [((a, a, a, 1 - 3 * a), 1 / 24)])
    a, b, c = 0.31088591926330060980, 0.092735250310891226402, 0.045503704125649649492
    return _orbits(
        3,
        [
            ((a, a, a, 1 - 3 * a), 0.11268792571801585080 / 6),
            ((b, b, b, 1 - 3 * b), 0.073493043116361949544 / 6),
            ((c, c, 0.5 - c, 0.5 - c), 0.042546020777081466438 / 6),
        ],
    )


def _wedge(degree: int, points: int) -> tuple[np.ndarray, np.ndarray]:
    plane, weight = _triangle(degree)
    z, wz = _gauss(points, 1)
    return (
        np.column_stack([np.tile(plane, (len(z), 1)), np.repeat(z[:, 0], len(plane))]),
        np.outer(wz, weight).ravel(),
    )
