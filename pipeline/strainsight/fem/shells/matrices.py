"""Stiffness, mass and strain of shells on their middle surfaces and at their nodes; classical lamination theory.

Strain in the order xx, yy, xy, γ_xy = 2 ε_xy; z from the middle of the laminate along its normal."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from strainsight.fem.shells.curved import TIES, curved_strains, points_of, surface_of, to_nodes
from strainsight.fem.shells.tria import POINTS, WEIGHTS, linear_turn, place_curvature, plane_of, to_basic, tria_strains

STIFF_IN_SHEAR = 1000.0
"""A shear stiffness of this many `in_shear` A₆₆ replaces a rigid one: the shear deflection of such a plate is at most a
thousandth of that of a homogeneous one."""
_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(3)
"""Gauss points in a ply, where the square of the shear stress is of fourth degree in z."""


@dataclass(frozen=True)
class Resistance:
    """Shell stiffness, N = A ε + B κ, M = B ε + D κ, Q = S γ.

    A (..., 3, 3) [N/m], B [N], D [N m], S (..., 2, 2) [N/m] of xz, yz."""

    A: np.ndarray
    B: np.ndarray
    D: np.ndarray
    S: np.ndarray

    def rotate(self, angle: np.ndarray) -> Resistance:
        """Rotate to axes from which x of this shell is rotated by the angle (e,) [rad] about the normal: (e, ...)."""
        R, r = strain_rotation(angle), _shear_rotation(angle)
        A, B, D, S = (T.swapaxes(-1, -2) @ X @ T for X, T in ((self.A, R), (self.B, R), (self.D, R), (self.S, r)))
        return Resistance(A, B, D, S)


def plane_stress(e1: float, e2: float, nu12: float, g12: float) -> np.ndarray:
    """Q (3, 3) [Pa] of σ = Q ε along the axes of an orthotropic ply: Q₁₁ = E₁/(1 − ν₁₂ν₂₁), Q₁₂ = ν₁₂E₂/(1 − ν₁₂ν₂₁), Q₆₆ = G₁₂,
    ν₂₁ = ν₁₂E₂/E₁."""
    share = 1 - nu12**2 * e2 / e1
    return np.array([[e1 / share, nu12 * e2 / share, 0.0], [nu12 * e2 / share, e2 / share, 0.0], [0.0, 0.0, g12]])


def laminate_resistance(
    thickness: np.ndarray, angle: np.ndarray, Q: np.ndarray, shear_flexibility: np.ndarray
) -> Resistance:
    """Resistance of a laminate of plies, from the lower face up, along its x and y, about its middle:

        (A, B, D) = ∫ (1, z, z²) Q̄ dz,     S⁻¹ = ∫ fᵀ Ḡ⁻¹ f dz,     τ(z) = f(z) (Q_x, Q_y)

    τ follows from equilibrium across the thickness, ∂τ_xz/∂z = −∂σ_xx/∂x − ∂τ_xy/∂y and similarly along y. The moments change
    by Q_x = ∂M_xx/∂x and Q_y = ∂M_yy/∂y only, in-plane forces are constant, and σ = Q̄ (b + z d) M with
    [a b; bᵀ d] = [A B; B D]⁻¹. So S stores the energy of that τ: 5/6 G t for a homogeneous shell, the shear stiffness of the
    core for a sandwich.

    thickness (n,) [m]; angle (n,) [rad] of axis 1 from x; Q (n, 3, 3) [Pa] along the axes of each ply; shear_flexibility
    (n, 2) 1/G₁z, 1/G₂z [1/Pa], 0 if rigid. Source: K. Rohwer, Improved transverse shear stiffnesses for layered
    finite elements, DFVLR-FB 88-32 (1988)."""
    T, r = strain_rotation(angle), _shear_rotation(angle)
    Q = T.swapaxes(1, 2) @ Q @ T
    flexible = r.swapaxes(1, 2) @ (shear_flexibility[:, :, None] * r)
    z = np.concatenate([[0.0], np.cumsum(thickness)]) - 0.5 * np.sum(thickness)
    low, high = z[:-1], z[1:]
    A, B, D = (np.einsum("p,pij->ij", (high**k - low**k) / k, Q) for k in (1, 2, 3))
    both = np.linalg.inv(np.block([[A, B], [B, D]]))
    b, d = both[:3, 3:], both[3:, 3:]

    below, energy = np.zeros((2, 2)), np.zeros((2, 2))
    for i in range(len(thickness)):

        def rise(to: float, i: int = i) -> np.ndarray:
            """f of the part of ply i below z."""
            F = Q[i] @ ((to - low[i]) * b + 0.5 * (to**2 - low[i] ** 2) * d)
            return -np.array([[F[0, 0], F[2, 1]], [F[2, 0], F[1, 1]]])

        for point, weight in zip(_POINTS, _WEIGHTS, strict=True):
            f = below + rise(0.5 * (low[i] + high[i] + point * thickness[i]))
            energy += 0.5 * weight * thickness[i] * f.T @ flexible[i] @ f
        below = below + rise(high[i])
    lam, V = np.linalg.eigh(0.5 * (energy + energy.T))
    return Resistance(A, B, D, V / np.maximum(lam, 1 / (STIFF_IN_SHEAR * in_shear(A))) @ V.T)


def strain_rotation(angle: np.ndarray) -> np.ndarray:
    """R (..., 3, 3): strains along x, y → along axes rotated by the angle (...) [rad] from them."""
    c, s = np.cos(angle), np.sin(angle)
    rows = [[c * c, s * s, c * s], [s * s, c * c, -c * s], [-2 * c * s, 2 * c * s, c * c - s * s]]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


def in_shear(X: np.ndarray) -> np.ndarray:
    """(X₁₁ + X₂₂ − 2 X₁₂ + 4 X₃₃)/8 of X (..., 3, 3): the mean of X₃₃ over all axes, which is X₃₃ of an isotropic X."""
    return np.asarray(X[..., 0, 0] + X[..., 1, 1] - 2 * X[..., 0, 1] + 4 * X[..., 2, 2]) / 8


def _shear_rotation(angle: np.ndarray) -> np.ndarray:
    """r (..., 2, 2) of γ_xz, γ_yz, as `strain_rotation`."""
    c, s = np.cos(angle), np.sin(angle)
    return np.moveaxis(np.array([[c, s], [-s, c]]), (0, 1), (-2, -1))


DRILLING = 6.0
"""Drilling stiffness of a quad as a multiple of D₃₃/area. At an edge between two planes it carries the bending moment that
rotates the other element about its normal. It vanishes for a thin shell, which a share of A₃₃
would lock if doubly curved."""

LEAST_DRILLING, MOST_DRILLING = 1e-4, 0.1
"""Bounds of the drilling stiffness as shares of A₃₃: for membranes, and for elements smaller than the thickness."""

TWIST, MOST_TWIST = 0.1, 0.01
"""d of MITC3+ is TWIST √(D₃₃/(S area)), which is proportional to t/h, and at most MOST_TWIST. The motion that only d resists
then has some hundredths of the bending stiffness, so that shells of any thickness do not lock."""
CORNERS = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])

GAUSS = CORNERS / np.sqrt(3)
"""Points with weights of one."""

SIDES = ((0, 1), (1, 2), (3, 2), (0, 3))
"""Sides along ξ or η; shear is tied at their middles."""


def shell_stiffnesses(
    position: np.ndarray,
    resistance: Resistance,
    offset: np.ndarray,
    ids: np.ndarray,
    along_beams: np.ndarray | None = None,
) -> np.ndarray:
    """Stiffness of shells, A, B, D, S of their resistance:

        K = ∫ (ε, κ)ᵀ [A B; B D] (ε, κ) + γᵀ S γ + c ((θ_z − ω)² + |ε⁰ − ε|²) dA,     c = ab/√(a² + b²) + 10⁻⁴ A₃₃

    a = 6 D₃₃/area and b = A₃₃/10, with ε, κ, γ and θ_z − ω of `quad_strains`, `tria_strains` and, for eight or six nodes,
    `curved_strains`, and A₃₃ and D₃₃ of `in_shear`. c is zero for three nodes, whose membrane has drilling rotations. ε⁰ − ε
    applies to eight nodes only, whose ε is otherwise free so that nothing locks. Inner motions are condensed,
    K_uu − K_ui K_ii⁻¹ K_iu.
    K scales with (A, B, D, S) together, but is no sum over them.

    position (e, k, 3) [m], k = 3, 4, 6 or 8, corners first; A, B, D, S (e, ...) along the axes of `shell_axes`, on a curved
    element rotated onto its tangent planes, S finite (for a shell rigid in shear a thousand times that of a flexible one);
    offset (e,) [m] of the middle surface from the nodes along the normal, by rigid arms; ids (e,) for the error message;
    along_beams (e, k): nodes along beams, whose drilling rotation is released (`release_drilling`). Returns (e, 6k, 6k), rows
    6·node + component, three translations [m] and three rotations [rad] along the basic axes. Assumes small strain; nodes of
    a warped quad of four are linked to its mean plane by rigid arms.
    Raises what `shell_axes` does, and DeckError for a second-order element that is folded."""
    e, k = position.shape[:2]
    A, B, D, S = resistance.A, resistance.B, resistance.D, resistance.S
    C = np.zeros((e, 9, 9))
    C[:, :3, :3], C[:, :3, 3:6], C[:, 3:6, :3], C[:, 3:6, 3:6], C[:, 6:8, 6:8] = A, B, B.swapaxes(1, 2), D, S
    if k in TIES:
        ties = TIES[k]
        surface = surface_of(ties, position, offset, ids)
        G, det = curved_strains(ties, surface, ties.rule[0])
        weight = det * ties.rule[1]
        C[:, 8, 8] = _drilling(A, D, weight)
        if ties.stabilised:
            C = _with_stabilisation(
                C, np.where(in_shear(D) > 0, C[:, 8, 8] - LEAST_DRILLING * in_shear(A), in_shear(A))
            )
        K = to_nodes(_condense_inner(_integral(G, C, weight), 6 * k), surface)
        return K if along_beams is None else release_drilling(K, surface.normal, along_beams, _least(A, weight))
    plane = plane_of(position, offset, ids)
    if k == 4:
        G, weight = quad_strains(plane.xy, GAUSS[None])
        C[:, 8, 8] = _drilling(A, D, weight)
    else:
        G, area = tria_strains(plane.xy, POINTS[None], _poisson(A), _twist(plane.xy, D, S), along_beams)
        C, weight = C[:, :8, :8], area[:, None] * WEIGHTS
    K = _condense_inner(_integral(G, C, weight), 6 * k)
    if along_beams is None:
        return to_basic(K, plane)
    if k == 3:
        return to_basic(release_drilling_trias(K, plane.xy, along_beams, _least(A, weight)), plane)
    return release_drilling(
        to_basic(K, plane), np.repeat(plane.axes[:, None, :, 2], k, axis=1), along_beams, _least(A, weight)
    )


def shell_masses(
    position: np.ndarray, per_area: np.ndarray, rotary: np.ndarray, offset: np.ndarray, ids: np.ndarray
) -> np.ndarray:
    """Consistent mass of shells, of the functions N of their nodes:

        M_ab = ∫ N_a N_b dA (m I on translations of the middle surface, ρt³/12 (n_a·n_b I − n_b n_aᵀ) on rotations)

    n the normal, constant for flat shells; inner motions of second-order shells have no mass. If the nodes of a flat mesh lie
    on the middle surface, rotation about the normal has no inertia, and M is singular. position (e, k, 3) [m]; per_area m (e,)
    [kg/m²]; rotary ρt³/12 (e,) [kg]; offset (e,) [m] as in `shell_stiffnesses`; ids (e,). Returns (e, 6k, 6k) [kg, kg m, kg m²].
    Raises what `shell_axes` does."""
    e, k = position.shape[:2]
    if k in TIES:
        return _curved_masses(position, per_area, rotary, offset, ids)
    plane = plane_of(position, offset, ids)
    if k == 4:
        N, slopes = quad_shape(GAUSS)
        det = np.linalg.det(np.matmul(slopes.swapaxes(1, 2), plane.xy[:, None]))
        m = np.einsum("eq,qa,qb->eab", det, N, N)
    else:
        area = np.linalg.det(plane.xy[:, 1:] - plane.xy[:, :1]) / 2
        m = area[:, None, None] * (np.ones((3, 3)) + np.eye(3)) / 12
    M = np.zeros((e, k, 6, k, 6))
    for c in (0, 1, 2):
        M[:, :, c, :, c] = per_area[:, None, None] * m
    for c in (3, 4):
        M[:, :, c, :, c] = rotary[:, None, None] * m
    return to_basic(M.reshape(e, 6 * k, 6 * k), plane)


def _drilling(A: np.ndarray, D: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """c (e,) of θ_z − ω; weight (e, q) [m²]."""
    inside = in_shear(A)
    return _lesser(DRILLING * in_shear(D) / weight.sum(axis=1), MOST_DRILLING * inside) + LEAST_DRILLING * inside


def _least(A: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Spring (e,) [N m] that remains between the rotation of a node along a beam and that of an element."""
    return np.asarray(LEAST_DRILLING * in_shear(A) * weight.sum(axis=1))


def _with_stabilisation(C: np.ndarray, c: np.ndarray) -> np.ndarray:
    """C (e, 12, 12) with the stabilisation of ε⁰ − ε."""
    extended = np.zeros((len(C), 12, 12))
    extended[:, :9, :9] = C
    extended[:, range(9, 12), range(9, 12)] = c[:, None] * [1.0, 1.0, 0.5]
    return extended


def _curved_masses(
    position: np.ndarray, per_area: np.ndarray, rotary: np.ndarray, offset: np.ndarray, ids: np.ndarray
) -> np.ndarray:
    ties = TIES[position.shape[1]]
    surface = surface_of(ties, position, offset, ids)
    xi, w = ties.rule
    at = points_of(ties, surface, xi)
    m = np.matmul(at.N.swapaxes(1, 2), (at.det * w)[..., None] * at.N)
    e, k = position.shape[:2]
    M = np.zeros((e, k, 6, k, 6))
    for c in range(3):
        M[:, :, c, :, c] = per_area[:, None, None] * m
    M[:, :, 3:, :, 3:] = np.einsum("e,eab,eaci,ebcj->eaibj", rotary, m, surface.turned, surface.turned, optimize=True)
    return to_nodes(M.reshape(e, 6 * k, 6 * k), surface)


def _twist(xy: np.ndarray, D: np.ndarray, S: np.ndarray) -> np.ndarray:
    """d of triangles, see `TWIST`."""
    area = np.linalg.det(xy[:, 1:] - xy[:, :1]) / 2
    return _lesser(TWIST * np.sqrt(_ratio(in_shear(D), area * (S[:, 0, 0] + S[:, 1, 1]) / 2)), MOST_TWIST)


def _lesser(a: np.ndarray, b: np.ndarray | float) -> np.ndarray:
    """ab/√(a² + b²) of a, b ≥ 0: nearly the smaller one, without a kink, so that K is smooth in the thickness."""
    return _ratio(a * b, np.hypot(a, b))


def _poisson(A: np.ndarray) -> np.ndarray:
    """A₁₂/A₁₁ (e,) of the mean of A over all axes."""
    a, b = A[:, 0, 0] + A[:, 1, 1], A[:, 0, 1]
    return _ratio(a + 6 * b - 4 * A[:, 2, 2], 3 * a + 2 * b + 4 * A[:, 2, 2])


def _ratio(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """a/b, and 0 where b is 0."""
    return np.divide(a, b, out=np.zeros(len(a)), where=b > 0)


def _integral(G: np.ndarray, C: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Σ_q w_q G_qᵀ C G_q (e, n, n) of rows G (e, q, r, n) with C (e, r, r) and w (e, q)."""
    e, q, r, n = G.shape
    stress = np.matmul(C[:, None], G) * weight[:, :, None, None]
    return np.matmul(G.reshape(e, q * r, n).swapaxes(1, 2), stress.reshape(e, q * r, n))


def _condense_inner(K: np.ndarray, count: int) -> np.ndarray:
    """K_uu − K_ui K_ii⁻¹ K_iu (e, count, count); inner motions without stiffness are left out."""
    inner = K[:, count:, count:].copy()
    i = np.arange(inner.shape[1])
    inner[:, i, i] += inner[:, i, i] == 0
    return K[:, :count, :count] - K[:, :count, count:] @ np.linalg.solve(inner, K[:, count:, :count])


def release_drilling(K: np.ndarray, normal: np.ndarray, which: np.ndarray, spring: np.ndarray) -> np.ndarray:
    """K with a spring between the rotation p about the normal of some nodes and the element there, in place of a rigid
    connection,

        K − K p pᵀK/(pᵀK p + s).

    normal (e, k, 3); which (e, k); spring s (e,) [N m]."""
    for node in np.flatnonzero(which.any(axis=0)):
        elements = np.flatnonzero(which[:, node])
        at = slice(6 * node + 3, 6 * node + 6)
        column = np.einsum("eac,ec->ea", K[elements, :, at], normal[elements, node])
        pivot = np.einsum("ec,ec->e", column[:, at], normal[elements, node]) + spring[elements]
        share = np.divide(column, pivot[:, None], out=np.zeros(column.shape), where=pivot[:, None] > 0)
        K[elements] -= share[:, :, None] * column[:, None, :]
    return K


def release_drilling_trias(K: np.ndarray, xy: np.ndarray, which: np.ndarray, spring: np.ndarray) -> np.ndarray:
    """The same for triangles K (e, 18, 18) on the plane that ignore these rotations: a spring from each to ½(v,x − u,y) of
    linear u and v."""
    relative_turn = np.zeros((*which.shape, 18))
    relative_turn[:, [0, 1, 2], [5, 11, 17]] = 1.0
    relative_turn[..., 0::6], relative_turn[..., 1::6] = (
        -linear_turn(xy)[:, None, :, component] for component in (0, 1)
    )
    return np.asarray(K + relative_turn.swapaxes(1, 2) @ ((spring[:, None] * which)[..., None] * relative_turn))


def quad_shape(at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The bilinear functions N (..., 4) and ∂N/∂(ξ, η) (..., 4, 2) at points `at` (..., 2)."""
    xi, eta = at[..., :1] * CORNERS[:, 0], at[..., 1:] * CORNERS[:, 1]
    slopes = np.stack([CORNERS[:, 0] * (1 + eta), CORNERS[:, 1] * (1 + xi)], axis=-1)
    return (1 + xi) * (1 + eta) / 4, slopes / 4


def quad_strains(xy: np.ndarray, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The nine rows (ε_xx, ε_yy, γ_xy; κ_xx, κ_yy, κ_xy; γ_xz, γ_yz; θ_z − ω) of motions of four nodes and four inner ones.

    In the plane u, v are bilinear with modes (1 − ξ²), (1 − η²) that neighbours do not share. Their gradients are
    (|J₀|/|J|) J₀⁻ᵀ ∂P/∂ξ so that constant strain passes (Taylor, Beresford & Wilson 1976), and ω = ½(v,x − u,y) of both.
    Transversely w and θ are bilinear, κ = (θ_y,x, −θ_x,y, θ_y,y − θ_x,x), and shear along ξ and η is tied at the side middles,

        γ_ξ = (1 − η)/2 γ_ξ(0, −1) + (1 + η)/2 γ_ξ(0, 1),     γ_η = (1 − ξ)/2 γ_η(−1, 0) + (1 + ξ)/2 γ_η(1, 0),

    γ_ξ = w,ξ + x,ξ θ_y − y,ξ θ_x, with (γ_xz, γ_yz) = J⁻¹(γ_ξ, γ_η) at the point (Bathe & Dvorkin 1985).

    xy (e, 4, 2) [m]; at (e or 1, q, 2) natural coordinates. Returns (e, q, 9, 24 + 4), columns 6·node + component and the inner
    ones, and |J| (e, q) [m²]. Sources: R. L. Taylor et al., A non-conforming element for stress analysis, Int. J. Numer. Meth.
    Engng 10 (1976) 1211-1219; K.-J. Bathe & E. N. Dvorkin, A four-node plate bending element based on Mindlin/Reissner plate
    theory and a mixed interpolation, ibid. 21 (1985) 367-383; T. J. R. Hughes & F. Brezzi, On drilling degrees of freedom,
    Comput. Methods Appl. Mech. Engrg. 72 (1989) 105-121."""
    e, q = len(xy), at.shape[1]
    N, slopes = quad_shape(at)
    inverse, det = _inverse(np.matmul(slopes.swapaxes(2, 3), xy[:, None]))
    g = np.matmul(slopes, inverse.swapaxes(2, 3))
    G = np.zeros((e, q, 9, 28))
    u, v, w, x, y, z = (G[..., c:24:6] for c in range(6))
    _in_plane(u, v, g)
    _in_plane(G[..., 24:26], G[..., 26:28], _bubbles(xy, at, det))
    z[:, :, 8] = N
    place_curvature(x, y, g)

    xi, eta = at[..., 0], at[..., 1]
    zero = np.zeros_like(xi)
    mix = np.stack([1 - eta, zero, 1 + eta, zero, zero, 1 + xi, zero, 1 - xi], axis=-1).reshape(*xi.shape, 2, 4) / 2
    tied = np.matmul(np.matmul(inverse, mix).reshape(e, 2 * q, 4), _side_shear(xy).reshape(e, 4, 12))
    tied = tied.reshape(e, q, 2, 4, 3)
    w[:, :, 6:8], x[:, :, 6:8], y[:, :, 6:8] = tied[..., 0], tied[..., 1], tied[..., 2]
    return G, det


def _in_plane(u: np.ndarray, v: np.ndarray, g: np.ndarray) -> None:
    """ε and −ω of functions with the gradients g (e, q, n, 2), into the rows of u and v (e, q, 9, n)."""
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
