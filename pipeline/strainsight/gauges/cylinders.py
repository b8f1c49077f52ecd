"""The cylinder on which the nodes of a face lie."""

from __future__ import annotations

import numpy as np
from scipy.optimize import least_squares

from strainsight.ordering import first_of_largest

ROUND = 0.02
"""Share of its radius that a cylinder's nodes may be off."""
TILTED = 0.25
"""Largest RMS of what normals of a cylinder have along it, over what they have across."""
LARGEST = 1e3
"""Radius of a cylinder over the size of its face: beyond it, nodes do not tell it from a plane."""


def cylinder(x: np.ndarray, middle: np.ndarray, vector: np.ndarray) -> tuple[float, np.ndarray, bool]:
    """Radius [m], axis (3,) and whether it is seen from inside, of the cylinder on which the points x (k, 3) [m] lie.

    It begins with the axis that the normals stand on and the circle of least squares, |x|² = 2 c·x + R² − |c|², and is then
    fitted to the points: normals of plane facets on a coarse cylinder are tilted along it. Zero where a point is off it by more
    than 2 % of its radius. middle (m, 3) [m] and vector (m, 3) [m²] of its facets.
    """
    none = (0.0, np.zeros(3), False)
    _, s, V = np.linalg.svd(vector / np.linalg.norm(vector, axis=1, keepdims=True).clip(1e-300), full_matrices=False)
    if len(s) < 3 or s[2] > TILTED * s[0]:
        return none
    origin, size = x.mean(axis=0), float(np.ptp(x, axis=0).max())
    y = (x - origin) / size
    flat = y @ V[:2].T
    solution, _, rank, _ = np.linalg.lstsq(np.c_[2 * flat, np.ones(len(flat))], np.sum(flat**2, axis=1), rcond=1e-6)
    if rank < 3:
        return none

    def off(p: np.ndarray) -> np.ndarray:
        return np.asarray(np.linalg.norm(_frame(p, V, y)[1], axis=1) - p[4])

    radius = np.sqrt(solution[2] + solution[:2] @ solution[:2])
    fitted = least_squares(off, [0.0, 0.0, *solution[:2], radius], x_scale=0.1, xtol=1e-12, ftol=1e-12, gtol=1e-12)
    radius = float(fitted.x[4])
    if not 0 < radius < LARGEST or np.abs(fitted.fun).max() > ROUND * radius:
        return none
    axis, out = _frame(fitted.x, V, (middle - origin) / size)
    return radius * size, axis * np.sign(axis[first_of_largest(np.abs(axis))]), bool(np.sum(out * vector) < 0)


def _frame(p: np.ndarray, V: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Axis (3,) along V₃ + p₀ V₁ + p₁ V₂ through p₂ V₁ + p₃ V₂, and what leads from it to the points y (k, 3)."""
    axis = V[2] + p[:2] @ V[:2]
    axis /= np.linalg.norm(axis)
    arm = y - p[2:4] @ V[:2]
    return axis, arm - np.outer(arm @ axis, axis)
