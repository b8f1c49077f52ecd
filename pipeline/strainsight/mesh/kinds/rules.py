"""Quadrature rules that several kinds use."""

from __future__ import annotations

from itertools import permutations

import numpy as np

from strainsight.mesh.kinds.kind import Rule


def gauss(points: int, d: int) -> Rule:
    """Gauss-Legendre product rule on [−1, 1]ᵈ, exact for degree 2·points − 1 in each direction."""
    x, w = np.polynomial.legendre.leggauss(points)
    grid = np.stack(np.meshgrid(*[x] * d, indexing="ij"), axis=-1).reshape(-1, d)
    weights = np.prod(np.stack(np.meshgrid(*[w] * d, indexing="ij"), axis=-1), axis=-1).ravel()
    return grid, weights


def orbits(size: int, orbits: list[tuple[tuple[float, ...], float]]) -> Rule:
    """All distinct permutations of barycentric points (one coordinate dropped) with their weights."""
    points, weights = [], []
    for point, weight in orbits:
        for permuted in sorted(set(permutations(point))):
            points.append(permuted[1:])
            weights.append(weight)
    return np.array(points).reshape(-1, size), np.array(weights)


def triangle(degree: int) -> Rule:
    """Symmetric rules of Dunavant (1985) of degree 2 and 4 on the unit triangle, in closed form."""
    if degree == 2:
        return orbits(2, [((1 / 6, 1 / 6, 2 / 3), 1 / 6)])
    root = np.sqrt(38 - 44 * np.sqrt(2 / 5))
    spread = np.sqrt(213125 - 53320 * np.sqrt(10))
    a, wa = (8 - np.sqrt(10) + root) / 18, (620 + spread) / 3720
    b, wb = (8 - np.sqrt(10) - root) / 18, (620 - spread) / 3720
    return orbits(2, [((a, a, 1 - 2 * a), wa / 2), ((b, b, 1 - 2 * b), wb / 2)])
