"""Strains of flat three-node shells: optimal membrane triangle in the plane, MITC3+ for bending."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from strainsight.errors import DeckError
from strainsight.mesh.thin import CORNERS

_A, _B = 0.445948490915965, 0.091576213509771
POINTS = np.array([[_A, _A], [1 - 2 * _A, _A], [_A, 1 - 2 * _A], [_B, _B], [1 - 2 * _B, _B], [_B, 1 - 2 * _B]])
WEIGHTS = np.repeat([0.223381589678011, 0.109951743655322], 3)
"""Points (r, s) and shares of the area, a rule of fourth degree (Dunavant 1985)."""

BETA = np.array([[1.0, 2.0, 1.0], [0.0, 1.0, -1.0], [-1.0, -1.0, -2.0]])
"""β₁ … β₉ of the optimal triangle; Q₁ without lengths; Q₂, Q₃ follow by cyclic exchange of nodes and sides."""

LEAST_BETA0 = 0.01
"""Least β₀ = (1 − 4ν²)/2, which vanishes with the drilling stiffness for ν near 1/2 (Felippa 2003)."""


def tria_strains(
    xy: np.ndarray, at: np.ndarray, nu: np.ndarray, twist: np.ndarray, along_beams: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """The eight rows (ε_xx, ε_yy, γ_xy; κ_xx, κ_yy, κ_xy; γ_xz, γ_yz) of motions of three nodes and two inner rotations.

    xy (e, 3, 2) [m] anticlockwise; at (e or 1, q, 2) area coordinates r, s of the second and third node; nu (e,) Poisson's
    ratio; twist d (e,), see `_shear`; along_beams (e, 3), nodes whose rotation about the normal has no effect. Returns
    (e, q, 8, 18 + 2), columns 6·node + component and the inner ones, and the area (e,) [m²]."""
    e, q = len(xy), at.shape[1]
    area, mean, varying = _membrane(xy, np.maximum((1 - 4 * nu**2) / 2, LEAST_BETA0), along_beams)
    J = xy[:, 1:] - xy[:, :1]
    inverse = np.stack([J[:, 1, 1], -J[:, 0, 1], -J[:, 1, 0], J[:, 0, 0]], axis=-1).reshape(e, 2, 2)
    inverse /= 2 * area[:, None, None]
    r, s = at[..., 0], at[..., 1]
    zeta = np.stack([1 - r - s, r, s], axis=-1)

    G = np.zeros((e, q, 8, 20))
    strain = mean[:, None] + np.matmul(zeta, varying.reshape(e, 3, 27)).reshape(e, q, 3, 9)
    u, v, w, x, y, z = (G[..., c:18:6] for c in range(6))
    u[:, :, :3], v[:, :, :3], z[:, :, :3] = strain[..., 0::3], strain[..., 1::3], strain[..., 2::3]
    linear = np.array([[-1.0, -1.0], [1.0, 0.0], [0.0, 1.0]])
    place_curvature(x, y, np.matmul(linear, inverse.swapaxes(1, 2))[:, None])
    bubble = 27 * np.stack([s * (1 - 2 * r - s), r * (1 - r - 2 * s)], axis=-1)
    place_curvature(G[..., 18:19], G[..., 19:20], np.matmul(bubble[:, :, None], inverse.swapaxes(1, 2)[:, None]))
    shear = _shear(xy, at, inverse, twist)
    w[:, :, 6:], x[:, :, 6:], y[:, :, 6:] = shear[..., 0:9:3], shear[..., 1:9:3], shear[..., 2:9:3]
    G[:, :, 6:, 18:] = shear[..., 9:]
    return G, area


def _membrane(
    xy: np.ndarray, beta0: np.ndarray, along_beams: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """ε_xx, ε_yy and γ_xy in triangles that move by u, v and a rotation θ about the normal at each node:

        ε(ζ) = ε̄ + Σᵢ ζᵢ εᵢ,     ε̄ = Lᵀq/area,     εᵢ = (3/2) √β₀ T_e Q_i θ̃,     Σᵢ εᵢ = 0

    ε̄ lumps constant stress into forces on the nodes, with sides bent along a cubic by θ (α_b = 3/2); θ̃ are the rotations
    of the nodes minus that of the triangle with linear u, v. ∫ εᵀAε has a rank of 9 − 3; a rectangle of two triangles bends in
    its plane as a beam of any slenderness if β₀ = (1 − 4ν²)/2. Sides of a node whose θ has no effect stay straight, so that
    constant stress passes next to other triangles, and its θ̃ is zero.
    Returns area (e,) [m²], ε̄ (e, 3, 9) and εᵢ (e, 3, 3, 9) with i second, columns u₁ v₁ θ₁ u₂ …. Source: C. A. Felippa,
    A study of optimal membrane triangles with drilling freedoms, Comput. Methods Appl. Mech. Engrg. 192 (2003) 2125-2168."""
    e = len(xy)
    side = np.roll(xy, -1, axis=1) - np.roll(xy, -2, axis=1)
    X, Y = side[..., 0], side[..., 1]  # x₂₃, x₃₁, x₁₂: the side opposite each node
    area = 0.5 * (X[:, 1] * Y[:, 2] - X[:, 2] * Y[:, 1])
    Xb, Yb, Xa, Ya = (np.roll(part, by, axis=1) for by in (-1, -2) for part in (X, Y))
    mean = np.zeros((e, 3, 3, 3))
    mean[:, 0, :, 0] = mean[:, 2, :, 1] = Y
    mean[:, 1, :, 1] = mean[:, 2, :, 0] = -X
    bows = (
        np.ones((e, 3))
        if along_beams is None
        else 1.0 * ~(np.roll(along_beams, -1, axis=1) | np.roll(along_beams, -2, axis=1))
    )
    bb, ba = (np.roll(bows, by, axis=1) for by in (-1, -2))
    mean[:, 0, :, 2] = (bb * Yb**2 - ba * Ya**2) / 4
    mean[:, 1, :, 2] = (bb * Xb**2 - ba * Xa**2) / 4
    mean[:, 2, :, 2] = (ba * Xa * Ya - bb * Xb * Yb) / 2
    mean /= (2 * area)[:, None, None, None]

    rotation = np.zeros((e, 3, 3, 3))
    rotation[..., :2] = -linear_turn(xy)[:, None]
    rotation[:, range(3), range(3), 2] = 1.0
    if along_beams is not None:
        rotation[along_beams] = 0.0

    # T_e diag(l²): strains along the sides 12, 23, 31; 1/l² is part of Q
    natural = np.stack([-Y * Yb, -X * Xb, Y * Xb + X * Yb], axis=1) * (np.sqrt(beta0) / (4 * area))[:, None, None]
    Q = np.stack([np.roll(BETA, i, axis=(0, 1)) for i in range(3)])
    varying = np.matmul(np.matmul(natural[:, None], Q).reshape(e, 9, 3), rotation.reshape(e, 3, 9))
    return area, mean.reshape(e, 3, 9), varying.reshape(e, 3, 3, 9)


def linear_turn(xy: np.ndarray) -> np.ndarray:
    """½(v,x − u,y) (e, 3, 2) [1/m] of linear u and v, per u and v of each node."""
    side = np.roll(xy, -1, axis=1) - np.roll(xy, -2, axis=1)
    area = np.linalg.det(xy[:, 1:] - xy[:, :1]) / 2
    return np.asarray(side / (4 * area)[:, None, None])


def place_curvature(x: np.ndarray, y: np.ndarray, g: np.ndarray) -> None:
    """κ = (θ_y,x, −θ_x,y, θ_y,y − θ_x,x) of functions with gradients g (e, q, n, 2), into rows of θ_x, θ_y (e, q, 8 or 9, n)."""
    y[:, :, 3] = g[..., 0]
    x[:, :, 4] = -g[..., 1]
    y[:, :, 5] = g[..., 1]
    x[:, :, 5] = -g[..., 0]


def _shear(xy: np.ndarray, at: np.ndarray, inverse: np.ndarray, twist: np.ndarray) -> np.ndarray:
    """γ (e, q, 2, 11) of w₁ θx₁ θy₁ w₂ … and of inner rotations b: w linear, θ linear plus 27 r s (1 − r − s) b.
    Shear along r and s is tied to

        e_r = 2/3 (e_r − e_s/2)(B) + 1/3 (e_r + e_s)(C) + ĉ (3s − 1)/3,
        e_s = 2/3 (e_s − e_r/2)(A) + 1/3 (e_r + e_s)(C) + ĉ (1 − 3r)/3,     ĉ = 3d (e_r,s − e_s,r),

    A (1/6, 2/3), B (2/3, 1/6), C (1/6, 1/6). Only d resists rotations θ = c (x, y) about the centre of a triangle; with d = 1,
    as in MITC3, it locks. Source: Y. Lee, P.-S. Lee & K.-J. Bathe, The MITC3+ shell element and its performance, Comput.
    Struct. 138 (2014) 12-23, with d = 10⁻⁴ for all elements."""
    A, B, C = (_covariant(xy, r, s) for r, s in ((1 / 6, 2 / 3), (2 / 3, 1 / 6), (1 / 6, 1 / 6)))
    ends = _covariant(xy, 0.0, 0.0), _covariant(xy, 1.0, 0.0), _covariant(xy, 0.0, 1.0)
    vary = twist[:, None] * ((ends[2][:, 0] - ends[0][:, 0]) - (ends[1][:, 1] - ends[0][:, 1]))
    both = (C[:, 0] + C[:, 1]) / 3
    tied = np.stack([(2 * B[:, 0] - B[:, 1]) / 3 + both, (2 * A[:, 1] - A[:, 0]) / 3 + both], axis=1)
    by = np.stack([3 * at[..., 1] - 1, 1 - 3 * at[..., 0]], axis=-1)
    return np.matmul(inverse[:, None], tied[:, None] + by[..., None] * vary[:, None, None])


def _covariant(xy: np.ndarray, r: float, s: float) -> np.ndarray:
    """(e_r, e_s) = w,r + x,r θ_y − y,r θ_x and along s (e, 2, 11), of the rotations at a point."""
    J = xy[:, 1:] - xy[:, :1]
    rows = np.zeros((len(xy), 2, 11))
    rows[:, :, 0] = -1.0
    rows[:, 0, 3] = rows[:, 1, 6] = 1.0
    for column, N in ((1, 1 - r - s), (4, r), (7, s), (9, 27 * r * s * (1 - r - s))):
        rows[:, :, column] = -N * J[:, :, 1]
        rows[:, :, column + 1] = N * J[:, :, 0]
    return rows


LEAST_CORNER = 1e-6
"""Least cross product of the two sides at a corner, as a share of the square of the largest side; below, degenerate."""


@dataclass(frozen=True)
class Plane:
    """axes (e, 3, 3) x, y and the normal z of elements, one in a column; xy (e, k, 2) [m] their nodes projected along z;
    arm (e, k) [m] from each node along z to the middle surface."""

    axes: np.ndarray
    xy: np.ndarray
    arm: np.ndarray


def shell_axes(position: np.ndarray, ids: np.ndarray) -> np.ndarray:
    """Axes of elements: z along the cross product of the diagonals (four corners) or sides (three), x along the side from
    the first node to the second, projected on the plane across z, and y = z × x.

    position (e, k, 3) [m], of second-order elements the corners first; ids (e,) for the error message. Returns (e, 3, 3), an
    axis in a column. Raises DeckError for an element without area, or with a reentrant corner."""
    position = position[:, : CORNERS[position.shape[1]]]
    size = np.linalg.norm(position - np.roll(position, 1, axis=1), axis=2).max(axis=1)
    first, second = _across(position)
    normal = np.cross(first, second)
    length = np.linalg.norm(normal, axis=1)
    _refuse(length > LEAST_CORNER * size**2, length, position, ids, "no area")
    z = normal / length[:, None]
    sides = np.roll(position, -1, axis=1) - position
    corner = np.einsum("ekc,ec->ek", np.cross(np.roll(sides, 1, axis=1), sides), z).min(axis=1)
    _refuse(corner > LEAST_CORNER * size**2, corner, position, ids, "a corner of more than 180°")
    x = sides[:, 0] - np.einsum("ec,ec->e", sides[:, 0], z)[:, None] * z
    x /= np.linalg.norm(x, axis=1)[:, None]
    return np.stack([x, np.cross(z, x), z], axis=2)


def plane_of(position: np.ndarray, offset: np.ndarray, ids: np.ndarray) -> Plane:
    """The mean plane of elements: the nodes of a warped one are alternately h above and below it.

    position (e, k, 3) [m]; offset (e,) [m] of the middle surface from the nodes along the normal; ids (e,). Raises what
    `shell_axes` does."""
    axes = shell_axes(position, ids)
    local = np.matmul(position - position.mean(axis=1, keepdims=True), axes)
    return Plane(axes, np.ascontiguousarray(local[:, :, :2]), offset[:, None] - local[:, :, 2])


def to_basic(K: np.ndarray, plane: Plane) -> np.ndarray:
    """TᵀKT of matrices K (e, 6k, 6k) on the plane, T from the motions of the nodes along the basic axes to those along the
    element's at the end of a rigid arm d z from each node:

        u = Rᵀ(u_a + φ_a × d z),    φ = Rᵀ φ_a

    Rigid motions cause no strain for any warp and offset. Returns (e, 6k, 6k)."""
    return rows_to_basic(rows_to_basic(K, plane).swapaxes(1, 2), plane).swapaxes(1, 2)


def rows_to_basic(rows: np.ndarray, plane: Plane) -> np.ndarray:
    """The rows (e, r, 6k) of motions on the plane as rows of motions of the nodes along the basic axes, `rows` T."""
    e, r = rows.shape[:2]
    parts = rows.reshape(e, r, -1, 6).copy()
    parts[..., 4] += plane.arm[:, None] * parts[..., 0]
    parts[..., 3] -= plane.arm[:, None] * parts[..., 1]
    return np.matmul(parts.reshape(e, -1, 3), plane.axes.swapaxes(1, 2)).reshape(rows.shape)


def _across(position: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The diagonals of a quad, or two sides of a triangle."""
    if position.shape[1] == 4:
        return position[:, 2] - position[:, 0], position[:, 3] - position[:, 1]
    return position[:, 1] - position[:, 0], position[:, 2] - position[:, 0]


def _refuse(good: np.ndarray, area: np.ndarray, position: np.ndarray, ids: np.ndarray, what: str) -> None:
    if good.all():
        return
    worst = int(np.argmin(np.where(good, np.inf, area)))
    names = ", ".join(str(id) for id in ids[~good][:5]) + (", …" if (~good).sum() > 5 else "")
    raise DeckError(
        f"shells of {position.shape[1]} nodes have {what} ({(~good).sum()} in total): {names} "
        f"(smallest cross product of sides or diagonals: {area[worst]:.3g} m² in element {ids[worst]})",
        remedy="Check the node order of these elements, and whether two of their nodes coincide.",
        entity=("element", int(ids[worst])),
    )
