"""Stiffness, mass and strain of many straight beams and rods at once, rows 6·node + component along the basic axes.

The motions of an end are three translations and three rotations. x of the beam axes runs from A to B through the shear
centres. Centroid and centre of mass lie on this axis or at an offset from it (`BeamProperties.neutral`)."""

from __future__ import annotations

import numpy as np

from strainsight.fem.beam_properties import BeamProperties, check_properties, end_stiffness, require, require_area
from strainsight.mesh.thin_faces import ALONG, axes_along, beam_shape


def beam_stiffnesses(
    position: np.ndarray,
    axes: np.ndarray,
    properties: BeamProperties,
    offset: np.ndarray,
    released: np.ndarray,
    ids: np.ndarray,
) -> np.ndarray:
    """Stiffness of beams with unit Young's modulus, from the flexibility of the beam that is clamped at A:

        K = Tᵀ B F⁻¹ Bᵀ T,    F = ∫ b(x)ᵀ C(x) b(x) dx,

    C(x) = diag(1/A, 1/(G k A), 1/(G J), S⁻¹) of the section, b(x) its forces from those at B, B those at both ends, T the
    rigid arms from the nodes. A taper is exact: A, S and J are linear in x. A section without resistance (J = 0, I1 or I2 = 0)
    has no stiffness. A released motion carries no force, K − K_r K_rr⁻¹ K_rᵀ; a motion without stiffness has none after it.
    Warping is free (St Venant).

    position (e, 2, 3) of the nodes [m]; axes (e, 3, 3) x, y, z in columns; offset (e, 2, 3) [m] of the ends from the nodes,
    along the basic axes; released (e, 2, 6) of the ends, along the axes of the beam; ids (e,) for the error message.
    Returns (e, 12, 12) [m, m², m³], to be multiplied with E. Raises DeckError for a beam without length or orientation,
    and what `check_properties` does."""
    length = _lengths(position, axes, offset, ids)
    check_properties(properties, ids)
    return _transform_congruent(end_stiffness(length, properties, released), _arms(axes, offset))


def beam_masses(
    position: np.ndarray,
    axes: np.ndarray,
    per_length: np.ndarray,
    offset: np.ndarray,
    ids: np.ndarray,
    rotary: np.ndarray | None = None,
    mass_offset: np.ndarray | None = None,
) -> np.ndarray:
    """Consistent mass of beams, from the kinetic energy

        ½ ∫ m |u̇|² + (−θ̇_z, θ̇_y) R (−θ̇_z, θ̇_y)ᵀ + tr(R) θ̇_x² dx

    with u linear along the beam and cubic across it (Hermite), and the rotations θ of the sections linear between the ends.
    θ is not the slope of u, so that R moves only with the rotations if the beam shears. A released end moves with its node.

    per_length (e, 2) at A and B, linear in between [kg/m]; rotary R (e, 2, 2, 2) = ρ ∫ (y, z)ᵀ (y, z) dA at both ends [kg m],
    left out by default, as CBAR does; mass_offset (e, 2, 2) y and z [m] of the mass from the axis at both ends, linear in
    between: u in the energy is that of the mass. The rest as `beam_stiffnesses`. Returns (e, 12, 12) [kg, kg m, kg m²].
    Raises DeckError for a beam without length or orientation."""
    length = _lengths(position, axes, offset, ids)
    points, weights = np.polynomial.legendre.leggauss(4)
    xi, w = 0.5 * (points + 1), 0.5 * weights
    N, L = np.stack([1 - xi, xi]), length[:, None]
    mass = (per_length @ N) * w * L
    across = np.zeros((len(length), len(xi), 4))  # of v at A, θ_z at A, and those at B; of w and −θ_y the same
    across[:, :, 0], across[:, :, 2] = 1 - 3 * xi**2 + 2 * xi**3, 3 * xi**2 - 2 * xi**3
    across[:, :, 1], across[:, :, 3] = L * (xi - 2 * xi**2 + xi**3), L * (xi**3 - xi**2)
    M = np.zeros((len(length), 12, 12))
    _add(M, [0, 6], np.einsum("eq,aq,bq->eab", mass, N, N, optimize=True))
    bending = np.einsum("eq,eqa,eqb->eab", mass, across, across, optimize=True)
    _add(M, [1, 5, 7, 11], bending)
    signs = np.array([1.0, -1.0, 1.0, -1.0])
    _add(M, [2, 4, 8, 10], bending * np.outer(signs, signs))
    T = _arms(axes, offset)
    if mass_offset is not None and mass_offset.any():
        M = _transform_congruent(M, _offset_motions(length, mass_offset))
    if rotary is not None:
        R = np.einsum("eijk,iq,q,aq,bq->eabjk", rotary * length[:, None, None, None], N, w, N, N, optimize=True)
        _add(M, [3, 9], R[..., 0, 0] + R[..., 1, 1])
        turns = [5, 4, 11, 10]  # θ_z, θ_y at A and at B, the first with its sign changed
        sign = np.array([-1.0, 1.0, -1.0, 1.0])
        _add(M, turns, R.transpose(0, 1, 3, 2, 4).reshape(-1, 4, 4) * np.outer(sign, sign))
    return _transform_congruent(M, T)


def _offset_motions(length: np.ndarray, mass_offset: np.ndarray) -> np.ndarray:
    """(e, 12, 12): motions of the ends → of a line at r = (0, y, z) from them, u + θ × r, with its slopes θ − r' θ_x."""
    T = np.tile(np.eye(12), (len(length), 1, 1))
    slope = (mass_offset[:, 1] - mass_offset[:, 0]) / length[:, None]
    for node in range(2):
        at, (y, z) = 6 * node, mass_offset[:, node].T
        T[:, at, at + 4], T[:, at, at + 5] = z, -y
        T[:, at + 1, at + 3], T[:, at + 2, at + 3] = -z, y
        T[:, at + 4, at + 3], T[:, at + 5, at + 3] = -slope[:, 0], -slope[:, 1]
    return T


def rod_stiffnesses(
    position: np.ndarray, area: np.ndarray, torsion: np.ndarray, poisson_ratio: np.ndarray, ids: np.ndarray
) -> np.ndarray:
    """Stiffness of rods with unit Young's modulus: A/L of the elongation, J/(2(1 + ν) L) of the twist.

    position (e, 2, 3) [m]; area (e,) [m²]; torsion J (e,) [m⁴], 0 where the rod does not resist it; ids (e,).
    Returns (e, 12, 12) [m, m³], to be multiplied with E. Raises DeckError for a rod without length, area ≤ 0 or J < 0."""
    x, length = _directions(position, ids)
    require_area(area, ids)
    require(
        torsion >= 0,
        torsion,
        ids,
        "element {element} has the torsion constant J {value:g} m⁴",
        "Specify a torsion constant J ≥ 0 in the beam property.",
    )
    along = np.stack([area / length, torsion / (2 * (1 + poisson_ratio) * length)], axis=1)
    pair = np.array([[1.0, -1.0], [-1.0, 1.0]])
    blocks = np.einsum("em,mn,ij,ec,ed->eimcjnd", along, np.eye(2), pair, x, x, optimize=True)
    return blocks.reshape(-1, 12, 12)


def rod_masses(position: np.ndarray, per_length: np.ndarray, ids: np.ndarray) -> np.ndarray:
    """Consistent mass of rods, (m L/6) [[2, 1], [1, 2]] ⊗ I₃ of the translations; their sections have no inertia of turning.

    position (e, 2, 3) [m]; per_length (e,) [kg/m]; ids (e,). Returns (e, 12, 12) [kg]. Raises DeckError for a rod without
    length."""
    _, length = _directions(position, ids)
    pair = np.zeros((12, 12))
    for component in range(3):
        pair[np.ix_([component, 6 + component], [component, 6 + component])] = np.array([[2.0, 1.0], [1.0, 2.0]]) / 6
    return (per_length * length)[:, None, None] * pair


def _arms(axes: np.ndarray, offset: np.ndarray) -> np.ndarray:
    """T (e, 12, 12): motions of the nodes → of the ends along the axes of the beam, Xᵀ(u + θ × offset) and Xᵀθ."""
    T = np.zeros((len(axes), 12, 12))
    X = axes.swapaxes(1, 2)
    for node in range(2):
        at = 6 * node
        T[:, at : at + 3, at : at + 3] = T[:, at + 3 : at + 6, at + 3 : at + 6] = X
        # x · (θ × r) = θ · (r × x)
        T[:, at : at + 3, at + 3 : at + 6] = np.cross(offset[:, node, None, :], X)
    return T


def _transform_congruent(K: np.ndarray, T: np.ndarray) -> np.ndarray:
    """Tᵀ K T, symmetric to the last digit."""
    K = T.swapaxes(1, 2) @ K @ T
    return 0.5 * (K + K.swapaxes(1, 2))


def _add(M: np.ndarray, at: list[int], part: np.ndarray) -> None:
    rows = np.array(at)
    M[:, rows[:, None], rows] += part


def _directions(ends: np.ndarray, ids: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Unit vectors (e, 3) from A to B and lengths (e,) [m] of ends (e, 2, 3). Raises DeckError where a length is zero."""
    along = ends[:, 1] - ends[:, 0]
    length = np.linalg.norm(along, axis=1)
    what = "element {element} has the length {value:g} m from end A to end B"
    remedy = "Correct its two end nodes or its offsets. If the nodes must coincide, replace the beam by an RBE2."
    require(length > 1e-12 * np.abs(ends).max(axis=(1, 2)), length, ids, what, remedy)
    return along / length[:, None], length


def _lengths(position: np.ndarray, axes: np.ndarray, offset: np.ndarray, ids: np.ndarray) -> np.ndarray:
    """Lengths (e,) [m] of beams. Raises DeckError where one is zero, and where the orientation left no axes (not a number)."""
    x, length = _directions(position + offset, ids)
    what = "element {element} has an orientation vector parallel to the beam axis: its bending plane 1 is undefined"
    remedy = "Specify an orientation vector or node that does not lie on the line from end A to end B."
    require(np.isfinite(axes).all(axis=(1, 2)), length, ids, what, remedy)
    assert np.allclose(axes.swapaxes(1, 2) @ axes, np.eye(3), atol=1e-9)
    assert np.allclose(axes[:, :, 0], x, atol=1e-6)
    return length


RIGID_IN_SHEAR = 1000.0
"""Ratio of shear area to area of a beam without shear deformation: large enough to be rigid, without locking."""
GAUSS = np.array([-1.0, 1.0]) / np.sqrt(3)


def beam_strains(position: np.ndarray, axes: np.ndarray, offset: np.ndarray, xi: np.ndarray) -> np.ndarray:
    """Rows ε, γ_xy, γ_xz, θ_x', θ_y', θ_z' (e, q, 6, 18) along `axes_along` of motions of the nodes, at ξ (q,):

        ε = x·u',     γ_xy = y·u' − z·θ,     γ_xz = z·u' + y·θ,     u = u_a + θ_a × offset

    position (e, 3, 3) [m] of the nodes A, B and between; offset (e, 3, 3) [m] of the beam from them, along the basic axes."""
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

    at two Gauss points, where bending without stretch or shear produces no strain in a curved beam, so it does not lock.
    A straight beam with forces and moments at its nodes is exact there. The curvature of the beam does not couple the
    resultants (its radius is large compared with its height).

    position (e, 3, 3) [m] of the nodes A, B and between; axes (e, 3, 3) x, y, z of the beam as a whole; properties linear from A
    to B; offset (e, 3, 3) [m]; ids (e,). Returns (e, 18, 18) [m, m², m³], to be multiplied with E. Raises DeckError for a beam
    that turns back, and what `check_properties` does. Source: K.-J. Bathe, Finite Element Procedures (1996), 5.4.1."""
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
    `curved_beam_stiffnesses`. Returns (e, 18, 18) [kg, kg m, kg m²]. Raises DeckError for a beam that turns back."""
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
    what = "element {element} folds back on itself: dx/dξ is {value:.3g} m, not positive (x along the beam, ξ element coordinate)"
    require(forward > 0, forward, ids, what, "Move its middle node to the midpoint between its two end nodes.")
