"""Stiffness and mass of beams of three nodes, straight or curved: quadratic, with shear, at two points of Gauss."""

from __future__ import annotations

import numpy as np

from strainsight.fem.beam_properties import BeamProperties, check_properties, require
from strainsight.mesh.beam_axes import ALONG, axes_along, beam_shape

RIGID_IN_SHEAR = 1000.0
"""Of the area, what stands for that in shear where a beam does not shear: nothing locks."""
GAUSS = np.array([-1.0, 1.0]) / np.sqrt(3)


def beam_strains(position: np.ndarray, axes: np.ndarray, offset: np.ndarray, xi: np.ndarray) -> np.ndarray:
    """Rows ε, γ_xy, γ_xz, θ_x', θ_y', θ_z' (e, q, 6, 18) along `axes_along` of motions of the nodes, at ξ (q,):

        ε = x·u',     γ_xy = y·u' − z·θ,     γ_xz = z·u' + y·θ,     u = u_a + θ_a × offset

    position (e, 3, 3) [m] of the nodes A, B and between; offset (e, 3, 3) [m] of the beam from them, along the basic axes.
    """
    e, q = len(position), len(xi)
    N, slope = beam_shape(xi)
    R, size = axes_along(position + offset, axes, xi)
    d = slope / size[..., None]  # e, q, 3
    X = R.swapaxes(2, 3)
    B = np.zeros((e, q, 6, 3, 6))
    B[:, :, :3, :, :3] = X[:, :, :, None] * d[:, :, None, :, None]
    # x·(θ × r) = θ·(r × x)
    B[:, :, :3, :, 3:] = np.cross(offset[:, None, None], B[:, :, :3, :, :3])
    B[:, :, 1, :, 3:] -= N[:, :, None] * X[:, :, 2, None]
    B[:, :, 2, :, 3:] += N[:, :, None] * X[:, :, 1, None]
    B[:, :, 3:, :, 3:] = B[:, :, :3, :, :3]
    return B.reshape(e, q, 6, 18)


def curved_beam_stiffnesses(
    position: np.ndarray, axes: np.ndarray, properties: BeamProperties, offset: np.ndarray, ids: np.ndarray
) -> np.ndarray:
    """Stiffness of beams of three nodes with unit Young's modulus:

        K = ∫ A ε² + G k_y A γ_xy² + G k_z A γ_xz² + G J θ_x'² + (−θ_z', θ_y') S (−θ_z', θ_y')ᵀ dx

    at two points of Gauss, where a curved beam that bends without stretch or shear has none: it does not lock, and under forces
    and moments at its nodes a straight one is exact there. Curvature of the beam does not couple the resultants (its radius is
    large against its height).

    position (e, 3, 3) [m] of the nodes A, B and between; axes (e, 3, 3) x, y, z of the beam as a whole; properties linear from A
    to B; offset (e, 3, 3) [m]; ids (e,). Returns (e, 18, 18) [m, m², m³], to be multiplied with E. Raises DeckError for a beam
    that turns back, and what `check_properties` does. Source: K.-J. Bathe, Finite Element Procedures (1996), 5.4.1.
    """
    check_properties(properties, ids)
    _, size = axes_along(position + offset, axes, GAUSS)
    _check_forward(position + offset, axes, ids)
    B = beam_strains(position, axes, offset, GAUSS)
    share = np.stack([0.5 * (1 - GAUSS), 0.5 * (1 + GAUSS)])  # end, q
    area, torsion = properties.area @ share, properties.torsion @ share
    second = np.einsum("eaij,aq->eqij", properties.second, share)
    G = (0.5 / (1 + properties.poisson_ratio))[:, None]
    shear = np.where(properties.shear > 0, properties.shear, RIGID_IN_SHEAR)
    C = np.zeros((len(ids), 2, 6, 6))
    C[:, :, 0, 0] = area
    C[:, :, 1, 1], C[:, :, 2, 2] = G * shear[:, :1] * area, G * shear[:, 1:] * area
    C[:, :, 3, 3] = G * torsion
    C[:, :, 4, 4], C[:, :, 5, 5] = second[..., 1, 1], second[..., 0, 0]
    C[:, :, 4, 5] = C[:, :, 5, 4] = -second[..., 0, 1]
    return np.asarray(np.einsum("eq,eqim,eqij,eqjn->emn", size, B, C, B, optimize=True))


def curved_beam_masses(
    position: np.ndarray,
    axes: np.ndarray,
    per_length: np.ndarray,
    offset: np.ndarray,
    ids: np.ndarray,
    rotary: np.ndarray,
) -> np.ndarray:
    """Consistent mass of beams of three nodes, of ½ ∫ m |u̇|² + (−θ̇_z, θ̇_y) R (−θ̇_z, θ̇_y)ᵀ + tr(R) θ̇_x² dx with their functions.

    per_length m (e, 2) at A and B [kg/m]; rotary R (e, 2, 2, 2) = ρ ∫ (y, z)ᵀ (y, z) dA at both ends [kg m]; the rest as
    `curved_beam_stiffnesses`. Returns (e, 18, 18) [kg, kg m, kg m²]. Raises DeckError for a beam that turns back.
    """
    _check_forward(position + offset, axes, ids)
    xi, w = np.polynomial.legendre.leggauss(3)
    e = len(ids)
    N, _ = beam_shape(xi)
    R, size = axes_along(position + offset, axes, xi)
    share = np.stack([0.5 * (1 - xi), 0.5 * (1 + xi)])
    # u and θ at the points, of the motions of the nodes
    u, theta = np.zeros((2, e, len(xi), 3, 3, 6))
    u[..., :3] = N[:, None, :, None] * np.eye(3)[:, None]
    u[..., 3:] = N[:, None, :, None] * np.cross(offset[:, None], np.eye(3)[:, None])[:, None]
    theta[..., 3:] = N[:, None, :, None] * R.swapaxes(2, 3)[:, :, :, None]
    of_u, of_theta = u.reshape(e, len(xi), 3, 18), theta.reshape(e, len(xi), 3, 18)
    second = np.einsum("eaij,aq->eqij", rotary, share)
    inertia = np.zeros((e, len(xi), 3, 3))
    inertia[..., 0, 0] = second[..., 0, 0] + second[..., 1, 1]
    inertia[..., 1, 1], inertia[..., 2, 2] = second[..., 1, 1], second[..., 0, 0]
    inertia[..., 1, 2] = inertia[..., 2, 1] = -second[..., 0, 1]
    M = np.einsum("eq,eqim,eqin->emn", (per_length @ share) * size * w, of_u, of_u, optimize=True)
    return np.asarray(M + np.einsum("eq,eqim,eqij,eqjn->emn", size * w, of_theta, inertia, of_theta, optimize=True))


def _check_forward(position: np.ndarray, axes: np.ndarray, ids: np.ndarray) -> None:
    """Raises DeckError where a beam turns back: the node between is too near an end."""
    _, slope = beam_shape(ALONG)
    forward = np.einsum("qk,ekc,ec->eq", slope, position, axes[:, :, 0]).min(axis=1)
    what = "turns back along its line ({value:.3g} m a unit of its coordinate)"
    require(forward > 0, forward, ids, what, "move the node between its ends to the middle")
