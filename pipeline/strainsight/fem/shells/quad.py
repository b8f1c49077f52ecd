"""Strains of shells of four nodes on their plane: incompatible modes and drilling in it, MITC4 across."""

from __future__ import annotations

import numpy as np

CORNERS = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])

GAUSS = CORNERS / np.sqrt(3)
"""Points with weights of one."""

SIDES = ((0, 1), (1, 2), (3, 2), (0, 3))
"""Along ξ or η; shear is tied at their middles."""


def quad_shape(at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The bilinear functions N (..., 4) and ∂N/∂(ξ, η) (..., 4, 2) at points `at` (..., 2)."""
    xi, eta = at[..., :1] * CORNERS[:, 0], at[..., 1:] * CORNERS[:, 1]
    slopes = np.stack([CORNERS[:, 0] * (1 + eta), CORNERS[:, 1] * (1 + xi)], axis=-1)
    return (1 + xi) * (1 + eta) / 4, slopes / 4


def quad_strains(xy: np.ndarray, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The nine rows (ε_xx, ε_yy, γ_xy; κ_xx, κ_yy, κ_xy; γ_xz, γ_yz; θ_z − ω) of motions of four nodes and four inner ones.

    In the plane u, v are bilinear with modes (1 − ξ²), (1 − η²) that neighbours do not share, whose gradients are
    (|J₀|/|J|) J₀⁻ᵀ ∂P/∂ξ so that constant strain passes (Taylor, Beresford & Wilson 1976), and ω = ½(v,x − u,y) of both.
    Across it w and θ are bilinear, κ = (θ_y,x, −θ_x,y, θ_y,y − θ_x,x), and shear along ξ and η is tied at the middles of sides,

        γ_ξ = (1 − η)/2 γ_ξ(0, −1) + (1 + η)/2 γ_ξ(0, 1),     γ_η = (1 − ξ)/2 γ_η(−1, 0) + (1 + ξ)/2 γ_η(1, 0),

    γ_ξ = w,ξ + x,ξ θ_y − y,ξ θ_x, with (γ_xz, γ_yz) = J⁻¹(γ_ξ, γ_η) at the point (Bathe & Dvorkin 1985).

    xy (e, 4, 2) [m]; at (e or 1, q, 2) natural coordinates. Returns (e, q, 9, 24 + 4), columns 6·node + component and the inner
    ones, and |J| (e, q) [m²]. Sources: R. L. Taylor et al., A non-conforming element for stress analysis, Int. J. Numer. Meth.
    Engng 10 (1976) 1211-1219; K.-J. Bathe & E. N. Dvorkin, A four-node plate bending element based on Mindlin/Reissner plate
    theory and a mixed interpolation, ibid. 21 (1985) 367-383; T. J. R. Hughes & F. Brezzi, On drilling degrees of freedom,
    Comput. Methods Appl. Mech. Engrg. 72 (1989) 105-121.
    """
    e, q = len(xy), at.shape[1]
    N, slopes = quad_shape(at)
    inverse, det = _inverse(np.matmul(slopes.swapaxes(2, 3), xy[:, None]))
    g = np.matmul(slopes, inverse.swapaxes(2, 3))
    G = np.zeros((e, q, 9, 28))
    u, v, w, x, y, z = (G[..., c:24:6] for c in range(6))
    _in_plane(u, v, g)
    _in_plane(G[..., 24:26], G[..., 26:28], _bubbles(xy, at, det))
    z[:, :, 8] = N
    y[:, :, 3] = g[..., 0]
    x[:, :, 4] = -g[..., 1]
    y[:, :, 5] = g[..., 1]
    x[:, :, 5] = -g[..., 0]

    xi, eta = at[..., 0], at[..., 1]
    zero = np.zeros_like(xi)
    mix = np.stack([1 - eta, zero, 1 + eta, zero, zero, 1 + xi, zero, 1 - xi], axis=-1).reshape(*xi.shape, 2, 4) / 2
    tied = np.matmul(np.matmul(inverse, mix).reshape(e, 2 * q, 4), _side_shear(xy).reshape(e, 4, 12))
    tied = tied.reshape(e, q, 2, 4, 3)
    w[:, :, 6:8], x[:, :, 6:8], y[:, :, 6:8] = tied[..., 0], tied[..., 1], tied[..., 2]
    return G, det


def _in_plane(u: np.ndarray, v: np.ndarray, g: np.ndarray) -> None:
    """ε and −ω of functions with the slopes g (e, q, n, 2), into the rows of u and v (e, q, 9, n)."""
    u[:, :, 0] = v[:, :, 2] = g[..., 0]
    v[:, :, 1] = u[:, :, 2] = g[..., 1]
    u[:, :, 8] = g[..., 1] / 2
    v[:, :, 8] = -g[..., 0] / 2


def _bubbles(xy: np.ndarray, at: np.ndarray, det: np.ndarray) -> np.ndarray:
    """(|J₀|/|J|) J₀⁻ᵀ ∂P/∂ξ (e, q, 2, 2) [1/m] of P = (1 − ξ², 1 − η²)."""
    inverse, centre = _inverse(np.matmul(quad_shape(np.zeros(2))[1].T, xy))
    slopes = -2 * at[..., :, None] * np.eye(2)
    return np.matmul(slopes, inverse.swapaxes(1, 2)[:, None]) * (centre[:, None] / det)[..., None, None]


def _side_shear(xy: np.ndarray) -> np.ndarray:
    """γ_ξ or γ_η (e, 4, 4, 3) at the middles of the sides, of w, θ_x, θ_y of each node."""
    tied = np.zeros((len(xy), 4, 4, 3))
    for side, (a, b) in enumerate(SIDES):
        half = (xy[:, b] - xy[:, a]) / 2
        tied[:, side, a, 0], tied[:, side, b, 0] = -0.5, 0.5
        tied[:, side, [a, b], 1] = -half[:, 1:] / 2
        tied[:, side, [a, b], 2] = half[:, :1] / 2
    return tied


def _inverse(J: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """J⁻¹ and |J| of J (..., 2, 2)."""
    det = J[..., 0, 0] * J[..., 1, 1] - J[..., 0, 1] * J[..., 1, 0]
    inverse = np.empty_like(J)
    inverse[..., 0, 0], inverse[..., 1, 1] = J[..., 1, 1], J[..., 0, 0]
    inverse[..., 0, 1], inverse[..., 1, 0] = -J[..., 0, 1], -J[..., 1, 0]
    return inverse / det[..., None, None], det
