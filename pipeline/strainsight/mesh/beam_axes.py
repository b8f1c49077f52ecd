"""Line and axes of beams of three nodes."""

from __future__ import annotations

import numpy as np

ALONG = np.array([-1.0, 1.0, 0.0])
"""ξ of the nodes: end A, end B and the one between."""


def beam_shape(xi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """N (q, 3) and ∂N/∂ξ (q, 3) of the nodes A, B and between, at ξ (q,)."""
    N = np.stack([xi * (xi - 1) / 2, xi * (xi + 1) / 2, 1 - xi**2], axis=-1)
    return N, np.stack([xi - 0.5, xi + 0.5, -2 * xi], axis=-1)


def axes_along(position: np.ndarray, axes: np.ndarray, xi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Axes (e, q, 3, 3) of beams at ξ (q,), one in a column, and ∂s/∂ξ (e, q) [m]: x along the beam, z across it and across y of
    the beam as a whole.

    position (e, 3, 3) [m] of the beam at its nodes; axes (e, 3, 3), x from end A to end B.
    """
    _, slope = beam_shape(xi)
    x = np.einsum("qk,ekc->eqc", slope, position)
    size = np.linalg.norm(x, axis=2)
    x = x / size[..., None]
    z = np.cross(x, axes[:, None, :, 1])
    z /= np.linalg.norm(z, axis=2)[..., None]
    return np.stack([x, np.cross(z, x), z], axis=3), size
