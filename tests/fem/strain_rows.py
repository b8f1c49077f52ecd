"""Strain within beams and shells from the motions of their nodes, of which the product reads that on their surfaces alone."""

from __future__ import annotations

import numpy as np

from strainsight.fem.beam_matrices import _arms, _lengths
from strainsight.fem.beam_properties import BeamProperties, bending_axes, end_stiffness
from strainsight.fem.shells.curved import TIES, curved_strains, rows_to_nodes, surface_of
from strainsight.fem.shells.matrices import GAUSS, MOST_DRILLING, _integral, _with_stabilisation, quad_strains
from strainsight.fem.shells.tria import plane_of, rows_to_basic, tria_strains


def beam_strain_rows(
    position: np.ndarray,
    axes: np.ndarray,
    properties: BeamProperties,
    offset: np.ndarray,
    released: np.ndarray,
    at: np.ndarray,
    y: np.ndarray,
    z: np.ndarray,
) -> np.ndarray:
    """Strain along beams from the motions of their nodes, ε = rows · u:

        ε = N/(E A) + (y, z) S⁻¹ m/E,    m(x) = m_B − (L − x) (V_y, V_z),    m = (−M_z, M_y),

    which is u' − y θ_z' + z θ_y' (u' − y v'' − z w'' of a beam that does not shear), from the forces at B, so that it is exact
    for loads at the ends, with a taper too. Bending that the section does not resist leaves no strain.

    Where the neutral axis lies n beside that of the beam, m − N n and (y, z) − n take their places.

    at (e,) share of the length from A; y, z (e,) place on the section [m]; the rest as `beam_stiffnesses`, which is to have
    accepted it. Returns (e, 12) [1/m, 1].
    """
    length = _lengths(position, axes, offset, np.arange(len(position)))
    forces = end_stiffness(length, properties, released)[:, 6:]
    area = (1 - at) * properties.area[:, 0] + at * properties.area[:, 1]
    v, ends, _, _ = bending_axes(properties.second)
    inverse = np.einsum("eij,ej,ekj->eik", v, 1 / ((1 - at)[:, None] * ends[..., 0] + at[:, None] * ends[..., 1]), v)
    moment = np.stack([-forces[:, 5], forces[:, 4]], axis=1) - ((1 - at) * length)[:, None, None] * forces[:, 1:3]
    place = np.stack([y, z], axis=1)
    if properties.neutral is not None:
        n = (1 - at)[:, None] * properties.neutral[:, 0] + at[:, None] * properties.neutral[:, 1]
        place, moment = place - n, moment - n[:, :, None] * forces[:, None, 0]
    rows = forces[:, 0] / area[:, None] + np.einsum("ei,eij,ejn->en", place, inverse, moment)
    return np.matmul(rows[:, None], _arms(axes, offset))[:, 0]


def shell_strain_rows(
    position: np.ndarray, at: np.ndarray, height: np.ndarray, offset: np.ndarray, ids: np.ndarray, nu: float = 0.3
) -> np.ndarray:
    """Rows of ε_xx, ε_yy, γ_xy along the axes of `shell_axes` at a height z above the middle surface, ε + z κ.

    position (e, k, 3) [m]; at (e, 2) natural coordinates, ξ, η in −1 … 1 of four corners, area coordinates of the second and
    third of three corners, of second-order elements the same for all; height z (e,) [m]; offset (e,) [m] as in
    `shell_stiffnesses`; ids (e,); nu Poisson's ratio. At the centre of an element, (0, 0) or (1/3, 1/3), these are the strains
    of its stiffness and nu is without effect; elsewhere those of an isotropic one without the curvature that varies within a
    triangle, whose mean is zero. Returns (e, 3, 6k) [1/m, 1].
    Raises what `shell_axes` does.
    """
    e, k = position.shape[:2]
    C = np.zeros((e, 9, 9))
    C[:, :3, :3] = np.array([[1, nu, 0], [nu, 1, 0], [0, 0, (1 - nu) / 2]])
    if k in TIES:
        return _curved_rows(position, at, height, offset, ids, C)
    plane = plane_of(position, offset, ids)
    if k == 4:
        inside, weight = quad_strains(plane.xy, GAUSS[None])
        K = _integral(inside, C, weight)
        G = quad_strains(plane.xy, at[:, None])[0][:, 0, :6]
        rows = G[..., :24] - G[..., 24:] @ np.linalg.solve(K[:, 24:, 24:], K[:, 24:, :24])
    else:
        rows = tria_strains(plane.xy, at[:, None], np.full(e, nu), np.zeros(e))[0][:, 0, :6, :18]
    return rows_to_basic(rows[:, :3] + height[:, None, None] * rows[:, 3:], plane)


def _curved_rows(
    position: np.ndarray, at: np.ndarray, height: np.ndarray, offset: np.ndarray, ids: np.ndarray, C: np.ndarray
) -> np.ndarray:
    ties = TIES[position.shape[1]]
    own = surface_of(ties, position, offset, ids)
    G, det = curved_strains(ties, own, ties.rule[0])
    kept = 6 * position.shape[1]
    # inner motions follow as in a shell that is a tenth as thick as it is wide
    C[:, 3:6, 3:6] = C[:, :3, :3] * (det @ ties.rule[1])[:, None, None] / 1200
    C[:, [6, 7], [6, 7]] = 5 / 6 * C[:, 2, 2, None]
    if ties.stabilised:
        C = _with_stabilisation(C, np.full(len(C), MOST_DRILLING))
    K = _integral(G, C, det * ties.rule[1])
    inner = -np.linalg.solve(K[:, kept:, kept:], K[:, kept:, :kept])
    if not (at == at[0]).all():
        raise ValueError("second-order shells are asked at one point of all")
    rows = curved_strains(ties, own, at[:1])[0][:, 0, :6]
    rows = rows[..., :kept] + rows[..., kept:] @ inner
    return rows_to_nodes(rows[:, :3] + height[:, None, None] * rows[:, 3:], own)
