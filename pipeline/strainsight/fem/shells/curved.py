"""Strains of second-order shells on their curved middle surface: MITC9 with its ninth node within, and MITC7."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from strainsight.errors import DeckError
from strainsight.fem.shells.plane import shell_axes
from strainsight.fem.shells.tying import Ties
from strainsight.mesh.kinds.kind import Kind
from strainsight.mesh.shell_normals import normals_at_nodes

FLAT = 1e-3
"""Least cosine of the angle between the normal at a point and that of the corners."""


@dataclass(frozen=True)
class Surface:
    """Elements: position (e, k, 3) [m] of their nodes moved onto the middle surface; normal (e, k, 3) of the element there;
    turned (e, k, 3, 3) with ψ = θ × n = turned θ; arm (e, k, 3) [m] from the nodes; axes (e, 3, 3) of `shell_axes`; ids (e,)."""

    position: np.ndarray
    normal: np.ndarray
    turned: np.ndarray
    arm: np.ndarray
    axes: np.ndarray
    ids: np.ndarray


@dataclass(frozen=True)
class Points:
    """At q points: N (q, k) and dN (q, k, 2) of the nodes; x_a (e, q, 2, 3) = ∂x/∂ξ_α [m]; normal (e, q, 3); along (e, q, 2, 3),
    axes x and y of the element turned the shortest way onto the tangent plane; J_αi = x_α · along_i (e, q, 2, 2) [m]; |J|."""

    N: np.ndarray
    dN: np.ndarray
    x_a: np.ndarray
    normal: np.ndarray
    along: np.ndarray
    J: np.ndarray
    det: np.ndarray


def surface_of(kind: Kind, position: np.ndarray, offset: np.ndarray, ids: np.ndarray) -> Surface:
    """position (e, k, 3) [m]; offset (e,) [m] of the middle surface along the normal that the element has at each node."""
    axes, normal = shell_axes(position, ids), normals_at_nodes(kind, position)
    good = (np.einsum("ekc,ec->ek", normal, axes[:, :, 2]) > FLAT).all(axis=1)
    _refuse_folded(good, kind, ids)
    arm = offset[:, None, None] * normal
    return Surface(position + arm, normal, _crossed(normal), arm, axes, ids)


def to_nodes(K: np.ndarray, own: Surface) -> np.ndarray:
    """TᵀKT of matrices K (e, 6k, 6k) on the middle surface, u = u_a + θ_a × arm."""
    return rows_to_nodes(rows_to_nodes(K, own).swapaxes(1, 2), own).swapaxes(1, 2)


def rows_to_nodes(rows: np.ndarray, own: Surface) -> np.ndarray:
    """Rows (e, r, 6k) of motions of the middle surface as rows of motions of the nodes."""
    e, r = rows.shape[:2]
    parts = rows.reshape(e, r, -1, 6).copy()
    parts[..., 3:] += np.matmul(parts[..., None, :3], _crossed(own.arm)[:, None])[..., 0, :]
    return parts.reshape(rows.shape)


def points_of(kind: Kind, own: Surface, xi: np.ndarray) -> Points:
    """At xi (q, 2). Raises DeckError for an element that is folded there."""
    N, dN = kind.functions(xi)
    x_a = np.matmul(dN.swapaxes(1, 2), own.position[:, None])
    cross = np.cross(x_a[:, :, 0], x_a[:, :, 1])
    det = np.linalg.norm(cross, axis=2)
    z = own.axes[:, None, :, 2]
    height = np.sum(cross * z, axis=2)
    _refuse_folded((height > FLAT * det).all(axis=1), kind, own.ids)
    normal = cross / det[..., None]
    axes = own.axes[:, None, :, :2].swapaxes(2, 3)
    halfway = (z + normal) / (1 + height / det)[..., None]
    along = axes - np.matmul(axes, normal[..., None]) * halfway[:, :, None]
    return Points(N, dN, x_a, normal, along, np.matmul(x_a, along.swapaxes(2, 3)), det)


def curved_strains(ties: Ties, own: Surface, xi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The nine rows (ε_xx, ε_yy, γ_xy; κ_xx, κ_yy, κ_xy; γ_xz, γ_yz; θ_n − ω) of motions of the nodes and inner ones.

    x + z n moves by u + z ψ, with x, n, u and ψ = θ × n interpolated from the nodes, and inner motions besides:

        e_αβ = sym(x,α · u,β),   κ_αβ = sym(n,α · u,β + x,α · ψ,β),   γ_α = x,α · ψ + n · u,α,   ω = ½ n̂ · rot u

    Rigid motions make none of these, whatever the shape. e and γ are taken at points where a surface that bends without
    stretch or shear has none, and go on from there (`Ties`): γ along ξ, η, so that constant γ passes on any shape; e along
    the directions that ξ and η have in the middle, turned onto the tangent plane, so that on flat elements constant strain
    passes with curved sides too, and linear strain with straight ones. Components along `Points.along`.

    xi (q, 2) natural coordinates. Returns (e, q, 9, 6k + inner) [1/m, 1], columns 6·node + component and the inner ones, u
    along the basic axes and ψ along x, y of the element; |J| (e, q) [m²]. Assumes t/R small: strain is ε + z κ in the area of
    the middle. Sources: M. L. Bucalem & K.-J. Bathe, Higher-order MITC general shell elements, Int. J. Numer. Meth. Engng 36
    (1993) 3729-3754; K.-J. Bathe, F. Brezzi & S. W. Cho, The MITC7 and MITC9 plate bending elements, Comput. Struct. 32 (1989)
    797-814; P.-S. Lee & K.-J. Bathe, Development of MITC isotropic triangular shell finite elements, ibid. 82 (2004) 945-962.
    """
    kind = ties.facet
    here = points_of(kind, own, xi)
    e, q, k = len(own.ids), len(xi), len(kind.nodes)
    inverse = np.linalg.inv(here.J)
    G = np.zeros((e, q, 9, 6 * k + 3 * ties.moves + 2))
    _place(G[:, :, :3], own, k, _tied_stretch(ties, own, xi, inverse), None)
    of_u, of_psi = _functions(ties, xi, here, ties.moves), _functions(ties, xi, here, True)
    n_a = np.matmul(here.dN.swapaxes(1, 2), own.normal[:, None])
    local = voigt(inverse)
    bending = [_times(local, _stretch(a, d)) for a, (_, d) in ((n_a, of_u), (here.x_a, of_psi))]
    _place(G[:, :, 3:6], own, k, *bending)
    _place(G[:, :, 6:8], own, k, *_tied_shear(ties, own, xi, inverse))
    slope = np.einsum("eqia,qma->eqim", inverse, of_u[1])
    spin = slope[:, :, 0, :, None] * here.along[:, :, None, 1] - slope[:, :, 1, :, None] * here.along[:, :, None, 0]
    _place(G[:, :, 8:], own, k, -0.5 * spin[:, :, None], None)
    G[:, :, 8, : 6 * k].reshape(e, q, k, 6)[..., 3:] = here.N[:, :, None] * here.normal[:, :, None]
    return G, here.det


def voigt(T: np.ndarray) -> np.ndarray:
    """(…, 3, 3): e_11, e_22, 2 e_12 → those of T e Tᵀ, T (…, 2, 2)."""
    a, b, c, d = T[..., 0, 0], T[..., 0, 1], T[..., 1, 0], T[..., 1, 1]
    rows = [[a * a, b * b, a * b], [c * c, d * d, c * d], [2 * a * c, 2 * b * d, a * d + b * c]]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


def _functions(ties: Ties, xi: np.ndarray, at: Points, inner: bool) -> tuple[np.ndarray, np.ndarray]:
    """N (q, m) and ∂N/∂ξ (q, m, 2) of the nodes, and of the inner motion behind them."""
    if not inner:
        return at.N, at.dN
    N, dN = ties.inner(xi)
    return np.concatenate([at.N, N[:, None]], axis=1), np.concatenate([at.dN, dN[:, None]], axis=1)


def _stretch(a: np.ndarray, dN: np.ndarray) -> np.ndarray:
    """e_rr, e_ss, 2 e_rs (e, q, 3, m, 3) = sym(a_α · u,β) of functions of u with slopes dN (q, m, 2); a (e, q, 2, 3)."""
    r, s = dN[..., :1], dN[..., 1:]
    one, two = a[:, :, None, 0], a[:, :, None, 1]
    return np.stack([one * r, two * s, one * s + two * r], axis=2)


def _times(T: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """T (e, q, r, t) of rows (e, q, t, m, 3)."""
    e, q, t, m, _ = rows.shape
    return np.matmul(T, rows.reshape(e, q, t, 3 * m)).reshape(e, q, -1, m, 3)


def _from(W: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Weights W (q, r, t, c) of rows (e, t, c, m, 3): (e, q, r, m, 3)."""
    e, t, c, m, _ = rows.shape
    q, r = W.shape[:2]
    return np.matmul(W.reshape(q * r, t * c), rows.reshape(e, t * c, 3 * m)).reshape(e, q, r, m, 3)


def _tied_stretch(ties: Ties, own: Surface, xi: np.ndarray, inverse: np.ndarray) -> np.ndarray:
    """ε (e, q, 3, m, 3) of functions of u along `Points.along` at xi; inverse (e, q, 2, 2) J⁻¹ there."""
    at = points_of(ties.facet, own, ties.stretch_at)
    J = points_of(ties.facet, own, ties.facet.centre[None]).J
    _, dN = _functions(ties, ties.stretch_at, at, ties.moves)
    there = np.matmul(voigt(J), voigt(np.linalg.inv(at.J)))
    back = np.broadcast_to(voigt(np.linalg.inv(J)), (*inverse.shape[:2], 3, 3))
    return _times(back, _from(ties.stretch(xi), _times(there, _stretch(at.x_a, dN))))


def _tied_shear(ties: Ties, own: Surface, xi: np.ndarray, inverse: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """γ (e, q, 2, m, 3) of functions of u and of ψ along `Points.along` at xi."""
    at = points_of(ties.facet, own, ties.shear_at)
    n = np.matmul(at.N, own.normal)
    _, dN = _functions(ties, ties.shear_at, at, ties.moves)
    N, _ = _functions(ties, ties.shear_at, at, True)
    u = dN.swapaxes(1, 2)[..., None] * n[:, :, None, None]
    psi = N[:, None, :, None] * at.x_a[:, :, :, None]
    W = ties.shear(xi)
    return _times(inverse, _from(W, u)), _times(inverse, _from(W, psi))


def _place(G: np.ndarray, own: Surface, k: int, u: np.ndarray, psi: np.ndarray | None) -> None:
    """Rows of functions of u and ψ (e, q, r, m, 3), k of the nodes and those within, into rows G (e, q, r, 6k + inner)."""
    e, q, r = G.shape[:3]
    nodes = np.zeros((e, q, r, k, 6))
    nodes[..., :3] = u[..., :k, :]
    inner = 3 * (u.shape[3] - k)
    G[..., 6 * k : 6 * k + inner] = u[..., k:, :].reshape(e, q, r, inner)
    if psi is not None:
        nodes[..., 3:] = np.matmul(psi[..., :k, None, :], own.turned[:, None, None])[..., 0, :]
        G[..., -2:] = np.matmul(psi[..., k, :], own.axes[:, None, :, :2])
    G[..., : 6 * k] = nodes.reshape(e, q, r, 6 * k)


def _crossed(a: np.ndarray) -> np.ndarray:
    """X (…, 3, 3) with X θ = θ × a, a (…, 3)."""
    x, y, z = np.moveaxis(a, -1, 0)
    no = np.zeros_like(x)
    return np.moveaxis(np.array([[no, z, -y], [-z, no, x], [y, -x, no]]), (0, 1), (-2, -1))


def _refuse_folded(good: np.ndarray, kind: Kind, ids: np.ndarray) -> None:
    if not good.all():
        bad = ids[~good]
        raise DeckError(
            f"{len(bad)} shells of {len(kind.nodes)} nodes are folded: {', '.join(map(str, bad[:5]))}"
            + (", …" if len(bad) > 5 else ""),
            remedy="move their mid-side nodes to the middle of the sides, or split these elements",
            entity=("element", int(bad[0])),
        )
