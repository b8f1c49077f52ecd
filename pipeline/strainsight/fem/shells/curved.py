"""Strains of second-order shells on their curved middle surface: MITC9 with a condensed ninth node, and MITC7."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from strainsight.errors import DeckError
from strainsight.fem.shells.tria import shell_axes
from strainsight.mesh.kinds.kind import ALONG_SIDES, FIRST, QUAD8, SECOND, TRI6, Kind, Rule, gauss, triangle
from strainsight.mesh.thin_faces import normals_at_nodes

Weights = Callable[[np.ndarray], np.ndarray]

TWO = np.array([-1.0, 1.0]) / np.sqrt(3)
"""Gauss points on −1 … 1."""
SIDES = np.array([-1.0, 0.0, 1.0])
"""Tying points of the shear in the transverse direction: on the sides it then depends on their nodes only, and curved sides
do not lock."""


@dataclass(frozen=True, eq=False)
class TiedStrains:
    """facet: the kind with the same nodes; rule of the integrals; inner (q, 2) → N (q,) and ∂N/∂ξ (q, 2) of the inner motion of
    ψ; completed: node functions include a share of it, so that they represent quadratics; held: the ties leave one motion
    free, which needs stabilisation; stretch_at (t, 2): tying points of e_rr, e_ss, 2 e_rs, and their weights (q, 3, t, 3) at
    points (q, 2); shear_at (t, 2) and weights (q, 2, t, 2) of γ_r, γ_s."""

    facet: Kind
    rule: Rule
    inner: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
    completed: bool
    stabilised: bool
    stretch_at: np.ndarray
    stretch: Weights
    shear_at: np.ndarray
    shear: Weights


def _lagrange(at: np.ndarray, x: np.ndarray) -> np.ndarray:
    """(q, n): the polynomials that are one at one of the points `at` (n,), at x (q,)."""
    others = [np.delete(at, i) for i in range(len(at))]
    return np.stack([np.prod((x[:, None] - b) / (a - b), axis=1) for a, b in zip(at, others, strict=True)], axis=-1)


def _grid(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.stack(np.meshgrid(a, b, indexing="ij"), axis=-1).reshape(-1, 2)


def _over_grid(a: np.ndarray, b: np.ndarray, xi: np.ndarray) -> np.ndarray:
    """(q, a b): the polynomials of the points of a grid."""
    both = _lagrange(a, xi[:, 0])[:, :, None] * _lagrange(b, xi[:, 1])[:, None]
    return both.reshape(len(xi), -1)


def _quad_stretch(xi: np.ndarray) -> np.ndarray:
    W = np.zeros((len(xi), 3, 4, 3))
    for component in range(3):
        W[:, component, :, component] = _over_grid(TWO, TWO, xi)
    return W


def _quad_shear(xi: np.ndarray) -> np.ndarray:
    W = np.zeros((len(xi), 2, 12, 2))
    W[:, 0, :6, 0] = _over_grid(TWO, SIDES, xi)
    W[:, 1, 6:, 1] = _over_grid(SIDES, TWO, xi)
    return W


def _quad_inner(xi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(1 − ξ²)(1 − η²): completes the functions to those of nine nodes."""
    r, s = xi.T
    return (1 - r**2) * (1 - s**2), np.stack([-2 * r * (1 - s**2), -2 * s * (1 - r**2)], axis=-1)


QUAD = TiedStrains(
    facet=QUAD8,
    rule=gauss(3, 2),
    inner=_quad_inner,
    completed=True,
    stabilised=True,
    stretch_at=_grid(TWO, TWO),
    stretch=_quad_stretch,
    shear_at=np.vstack([_grid(TWO, SIDES), _grid(SIDES, TWO)]),
    shear=_quad_shear,
)
"""e is tied at the four Gauss points, γ_r at ξ = ±1/√3 and η = 0, ±1, γ_s with ξ and η exchanged."""


_INSIDE, _SHARE = triangle(4)
_TRI_SHEAR = np.vstack([[[FIRST, 0], [SECOND, 0], [SECOND, FIRST], [FIRST, SECOND], [0, SECOND], [0, FIRST]], _INSIDE])
_ALONG = np.array([[1.0, 0], [1, 0], [-1, 1], [-1, 1], [0, -1], [0, -1]])


def _linear(xi: np.ndarray) -> np.ndarray:
    return np.column_stack([np.ones(len(xi)), xi])


_LINEAR = [np.linalg.inv(_linear(ALONG_SIDES[i : i + 3])) for i in (0, 3, 6)]


def _tri_stretch(xi: np.ndarray) -> np.ndarray:
    """Linear along each of the three directions, 2 e_qq = e_rr + e_ss − 2 e_rs."""
    rr, ss, qq = (_linear(xi) @ inverse for inverse in _LINEAR)
    W = np.zeros((len(xi), 3, 9, 3))
    W[:, 0, :3, 0] = W[:, 2, :3, 0] = rr
    W[:, 1, 3:6, 1] = W[:, 2, 3:6, 1] = ss
    W[:, 2, 6:, 0] = W[:, 2, 6:, 1] = -qq
    W[:, 2, 6:, 2] = qq
    return W


def _edge_space(xi: np.ndarray) -> np.ndarray:
    """(q, 2, 8): (γ_r, γ_s) linear, and (s, −r) times r and s."""
    r, s = xi.T
    no, one = np.zeros_like(r), np.ones_like(r)
    return np.stack(
        [
            np.stack([one, r, s, no, no, no, r * s, s * s], axis=-1),
            np.stack([no, no, no, one, r, s, -r * r, -r * s], axis=-1),
        ],
        axis=1,
    )


def _shear_coefficients() -> np.ndarray:
    """(8, t, 2): coefficients of `_edge_space` from γ at the tying points: two along each side, and the mean inside."""
    functionals = np.zeros((8, len(_TRI_SHEAR), 2))
    functionals[range(6), range(6)] = _ALONG
    functionals[6, 6:, 0] = functionals[7, 6:, 1] = _SHARE / _SHARE.sum()
    space = np.einsum("htc,tcb->hb", functionals, _edge_space(_TRI_SHEAR))
    return np.linalg.solve(space, functionals.reshape(8, -1)).reshape(functionals.shape)


_SHEAR = _shear_coefficients()


def _tri_shear(xi: np.ndarray) -> np.ndarray:
    return np.einsum("qcb,btd->qctd", _edge_space(xi), _SHEAR)


def _tri_inner(xi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """27 r s (1 − r − s)."""
    r, s = xi.T
    return 27 * r * s * (1 - r - s), 27 * np.stack([s * (1 - 2 * r - s), r * (1 - r - 2 * s)], axis=-1)


TRIA = TiedStrains(
    facet=TRI6,
    rule=(_INSIDE, _SHARE),
    inner=_tri_inner,
    completed=False,
    stabilised=False,
    stretch_at=ALONG_SIDES,
    stretch=_tri_stretch,
    shear_at=_TRI_SHEAR,
    shear=_tri_shear,
)

TIES = {8: QUAD, 6: TRIA}
"""Number of nodes of an element → its tying scheme."""


FLAT = 1e-3
"""Least cosine of the angle between the normal at a point and that of the corners."""
LEAST = 1e-13
"""Share of the squares of coordinates (at most one) that keeps the least-squares problem of eight nodes on a conic regular."""


@dataclass(frozen=True)
class MiddleSurface:
    """Elements: position (e, k, 3) [m] of their nodes moved onto the middle surface; normal (e, k, 3) of the element there;
    turned (e, k, 3, 3) with ψ = θ × n = turned θ; arm (e, k, 3) [m] from the nodes; axes (e, 3, 3) of `shell_axes`; share (e, k)
    of each node in the inner motion; ids (e,)."""

    position: np.ndarray
    normal: np.ndarray
    turned: np.ndarray
    arm: np.ndarray
    axes: np.ndarray
    share: np.ndarray
    ids: np.ndarray


@dataclass(frozen=True)
class ShellPoints:
    """At q points: N (e, q, k) and dN (e, q, k, 2) of the nodes, inner (q,) and its gradient (q, 2); x_a (e, q, 2, 3) = ∂x/∂ξ_α
    [m]; normal (e, q, 3); along (e, q, 2, 3), axes x and y of the element rotated the shortest way onto the tangent plane;
    J_αi = x_α · along_i (e, q, 2, 2) [m]; |J|."""

    N: np.ndarray
    dN: np.ndarray
    inner: tuple[np.ndarray, np.ndarray]
    x_a: np.ndarray
    normal: np.ndarray
    along: np.ndarray
    J: np.ndarray
    det: np.ndarray


def surface_of(ties: TiedStrains, position: np.ndarray, offset: np.ndarray, ids: np.ndarray) -> MiddleSurface:
    """position (e, k, 3) [m]; offset (e,) [m] of the middle surface along the normal that the element has at each node."""
    kind = ties.facet
    axes, normal = shell_axes(position, ids), normals_at_nodes(kind, position)
    _refuse_folded((np.einsum("ekc,ec->ek", normal, axes[:, :, 2]) > FLAT).all(axis=1), kind, ids)
    arm = offset[:, None, None] * normal
    middle = position + arm
    share = _share_within(kind, middle, axes) if ties.completed else np.zeros(position.shape[:2])
    return MiddleSurface(middle, normal, _crossed(normal), arm, axes, share, ids)


def _share_within(kind: Kind, position: np.ndarray, axes: np.ndarray) -> np.ndarray:
    """c (e, k) of N_a + c_a (1 − ξ²)(1 − η²), the smallest for which these functions represent every quadratic in x and y of the
    element at its centre; the functions of eight nodes do so on parallelograms only. Source: R. H. MacNeal & R. L. Harder,
    Eight nodes or nine?, Int. J. Numer. Meth. Engng 33 (1992) 1049-1058."""
    N = kind.shape(kind.centre[None])[0]
    local = np.matmul(position - position.mean(axis=1, keepdims=True), axes[:, :, :2])
    x, y = np.moveaxis(local / np.abs(local).max(axis=(1, 2), keepdims=True), 2, 0)
    cx, cy = x @ N, y @ N
    P = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=1)
    missing = np.stack([np.ones_like(cx), cx, cy, cx * cx, cx * cy, cy * cy], axis=1) - P @ N
    square = P @ P.swapaxes(1, 2) + LEAST * np.eye(6)
    return np.asarray(np.matmul(P.swapaxes(1, 2), np.linalg.solve(square, missing[..., None]))[..., 0])


def to_nodes(K: np.ndarray, surface: MiddleSurface) -> np.ndarray:
    """TᵀKT of matrices K (e, 6k, 6k) on the middle surface, u = u_a + θ_a × arm."""
    return rows_to_nodes(rows_to_nodes(K, surface).swapaxes(1, 2), surface).swapaxes(1, 2)


def rows_to_nodes(rows: np.ndarray, surface: MiddleSurface) -> np.ndarray:
    """Rows (e, r, 6k) of motions of the middle surface as rows of motions of the nodes."""
    e, r = rows.shape[:2]
    parts = rows.reshape(e, r, -1, 6).copy()
    parts[..., 3:] += np.matmul(parts[..., None, :3], _crossed(surface.arm)[:, None])[..., 0, :]
    return parts.reshape(rows.shape)


def points_of(ties: TiedStrains, surface: MiddleSurface, xi: np.ndarray) -> ShellPoints:
    """Geometry and functions at xi (q, 2). Raises DeckError for an element that is folded there."""
    (N, dN), inner = ties.facet.functions(xi), ties.inner(xi)
    N = N + surface.share[:, None] * inner[0][:, None]
    dN = dN + surface.share[:, None, :, None] * inner[1][:, None]
    x_a = np.matmul(dN.swapaxes(2, 3), surface.position[:, None])
    cross = np.cross(x_a[:, :, 0], x_a[:, :, 1])
    det = np.linalg.norm(cross, axis=2)
    z = surface.axes[:, None, :, 2]
    height = np.sum(cross * z, axis=2)
    _refuse_folded((height > FLAT * det).all(axis=1), ties.facet, surface.ids)
    normal = cross / det[..., None]
    axes = surface.axes[:, None, :, :2].swapaxes(2, 3)
    halfway = (z + normal) / (1 + height / det)[..., None]
    along = axes - np.matmul(axes, normal[..., None]) * halfway[:, :, None]
    return ShellPoints(N, dN, inner, x_a, normal, along, np.matmul(x_a, along.swapaxes(2, 3)), det)


def curved_strains(ties: TiedStrains, surface: MiddleSurface, xi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The rows (ε_xx, ε_yy, γ_xy; κ_xx, κ_yy, κ_xy; γ_xz, γ_yz; θ_n − ω; ε⁰ − ε of eight nodes) of motions of the nodes and two
    inner ones.

    x + z n moves by u + z ψ, with x, n, u and ψ = θ × n interpolated from the nodes, and ψ also by its inner motion:

        e_αβ = sym(x,α · u,β),   κ_αβ = sym(n,α · u,β + x,α · ψ,β),   γ_α = x,α · ψ + n · u,α,   ω = ½ n̂ · rot u

    Rigid motions cause no strain on any shape. e and γ are evaluated at points where a surface that bends without stretch or
    shear has none, and interpolated from there (`TiedStrains`): γ along ξ, η, so that constant γ passes on any shape; e along
    the directions of ξ and η at the centre, rotated onto the tangent plane. On flat elements constant strain then passes with
    curved sides, and linear strain with straight ones. ε⁰ is the strain of u itself: with ε at four points only, a motion of
    eight nodes would be free. Components along `ShellPoints.along`.

    xi (q, 2) natural coordinates. Returns (e, q, 12 or 9, 6k + 2) [1/m, 1], columns 6·node + component and the inner ψ along
    x, y of the element; |J| (e, q) [m²]. Assumes t/R small: strain is ε + z κ on the area of
    the middle surface. Sources: M. L. Bucalem & K.-J. Bathe, Higher-order MITC general shell elements, Int. J. Numer. Meth. Engng
    36 (1993) 3729-3754; K.-J. Bathe, F. Brezzi & S. W. Cho, The MITC7 and MITC9 plate bending elements, Comput. Struct. 32 (1989)
    797-814; P.-S. Lee & K.-J. Bathe, Development of MITC isotropic triangular shell finite elements, ibid. 82 (2004) 945-962.
    """
    here = points_of(ties, surface, xi)
    e, q, k = here.N.shape
    inverse = np.linalg.inv(here.J)
    G = np.zeros((e, q, 12 if ties.stabilised else 9, 6 * k + 2))
    tied = _tied_stretch(ties, surface, xi, inverse)
    _place(G[:, :, :3], surface, k, tied, None)
    n_a = np.matmul(here.dN.swapaxes(2, 3), surface.normal[:, None])
    local = voigt(inverse)
    bending = [_times(local, _stretch(a, d)) for a, d in ((n_a, here.dN), (here.x_a, _with_inner(here)[1]))]
    _place(G[:, :, 3:6], surface, k, *bending)
    _place(G[:, :, 6:8], surface, k, *_tied_shear(ties, surface, xi, inverse))
    slope = np.matmul(inverse, here.dN.swapaxes(2, 3))
    spin = slope[:, :, 0, :, None] * here.along[:, :, None, 1] - slope[:, :, 1, :, None] * here.along[:, :, None, 0]
    _place(G[:, :, 8:9], surface, k, -0.5 * spin[:, :, None], None)
    G[:, :, 8, : 6 * k].reshape(e, q, k, 6)[..., 3:] = here.N[..., None] * here.normal[:, :, None]
    if ties.stabilised:
        _place(G[:, :, 9:], surface, k, _times(local, _stretch(here.x_a, here.dN)) - tied, None)
    return G, here.det


def voigt(T: np.ndarray) -> np.ndarray:
    """(…, 3, 3): e_11, e_22, 2 e_12 → those of T e Tᵀ, T (…, 2, 2)."""
    a, b, c, d = T[..., 0, 0], T[..., 0, 1], T[..., 1, 0], T[..., 1, 1]
    rows = [[a * a, b * b, a * b], [c * c, d * d, c * d], [2 * a * c, 2 * b * d, a * d + b * c]]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


def _with_inner(at: ShellPoints) -> tuple[np.ndarray, np.ndarray]:
    """N (e, q, k + 1) and ∂N/∂ξ (e, q, k + 1, 2) of the nodes, followed by the inner motion."""
    N, dN = (np.broadcast_to(part, (len(at.N), *part.shape)) for part in at.inner)
    return np.concatenate([at.N, N[..., None]], axis=2), np.concatenate([at.dN, dN[:, :, None]], axis=2)


def _stretch(a: np.ndarray, dN: np.ndarray) -> np.ndarray:
    """e_rr, e_ss, 2 e_rs (e, q, 3, m, 3) = sym(a_α · u,β) of functions of u with gradients dN (e, q, m, 2); a (e, q, 2, 3)."""
    r, s = dN[..., :1], dN[..., 1:]
    one, two = a[:, :, None, 0], a[:, :, None, 1]
    return np.stack([one * r, two * s, one * s + two * r], axis=2)


def _times(T: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """T (e, q, r, t) times rows (e, q, t, m, 3)."""
    e, q, t, m, _ = rows.shape
    return np.matmul(T, rows.reshape(e, q, t, 3 * m)).reshape(e, q, -1, m, 3)


def _from(W: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Weights W (q, r, t, c) times rows (e, t, c, m, 3): (e, q, r, m, 3)."""
    e, t, c, m, _ = rows.shape
    q, r = W.shape[:2]
    return np.matmul(W.reshape(q * r, t * c), rows.reshape(e, t * c, 3 * m)).reshape(e, q, r, m, 3)


def _tied_stretch(ties: TiedStrains, surface: MiddleSurface, xi: np.ndarray, inverse: np.ndarray) -> np.ndarray:
    """ε (e, q, 3, m, 3) of functions of u along `ShellPoints.along` at xi; inverse (e, q, 2, 2) J⁻¹ there."""
    J = points_of(ties, surface, ties.facet.centre[None]).J
    parts = [points_of(ties, surface, points) for points in (ties.stretch_at, ties.rule[0])]
    tied, full = (_times(np.matmul(voigt(J), voigt(np.linalg.inv(at.J))), _stretch(at.x_a, at.dN)) for at in parts)
    # with the mean of the untied strain, constant stress exerts the forces of the sides
    weight = parts[1].det * ties.rule[1]
    untied = full - _from(ties.stretch(ties.rule[0]), tied)
    mean = np.einsum("eq,eqrmc->ermc", weight / weight.sum(axis=1, keepdims=True), untied)
    back = np.broadcast_to(voigt(np.linalg.inv(J)), (*inverse.shape[:2], 3, 3))
    return _times(back, _from(ties.stretch(xi), tied) + mean[:, None])


def _tied_shear(
    ties: TiedStrains, surface: MiddleSurface, xi: np.ndarray, inverse: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """γ (e, q, 2, m, 3) of functions of u and of ψ along `ShellPoints.along` at xi."""
    at = points_of(ties, surface, ties.shear_at)
    u = at.dN.swapaxes(2, 3)[..., None] * np.matmul(at.N, surface.normal)[:, :, None, None]
    psi = _with_inner(at)[0][:, :, None, :, None] * at.x_a[:, :, :, None]
    W = ties.shear(xi)
    return _times(inverse, _from(W, u)), _times(inverse, _from(W, psi))


def _place(G: np.ndarray, surface: MiddleSurface, k: int, u: np.ndarray, psi: np.ndarray | None) -> None:
    """Rows of functions of u (e, q, r, k, 3) and ψ (e, q, r, k + 1, 3) into rows G (e, q, r, 6k + 2)."""
    e, q, r = G.shape[:3]
    nodes = np.zeros((e, q, r, k, 6))
    nodes[..., :3] = u
    if psi is not None:
        nodes[..., 3:] = np.matmul(psi[..., :k, None, :], surface.turned[:, None, None])[..., 0, :]
        G[..., -2:] = np.matmul(psi[..., k, :], surface.axes[:, None, :, :2])
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
            f"folded shells of {len(kind.nodes)} nodes ({len(bad)} in total): {', '.join(map(str, bad[:5]))}"
            + (", …" if len(bad) > 5 else ""),
            remedy="Move the mid-side nodes to the middle of the sides, or split these elements.",
            entity=("element", int(bad[0])),
        )
