"""Stiffness and mass of many elements of one kind at once, as the blocks of their node pairs a ≤ b."""

from __future__ import annotations

import numpy as np

from strainsight.errors import DeckError
from strainsight.mesh.kinds.kind import ElementKind, Rule

SHEARS = ((0, 1), (1, 2), (2, 0))
AT_ONCE = 256
"""Elements whose strains at all points, 27 or fewer, are held at a time."""


def element_stiffnesses(kind: ElementKind, position: np.ndarray, nu: np.ndarray, ids: np.ndarray) -> np.ndarray:
    """Stiffness of isotropic elements with unit modulus:

        K_ab = ∫ λ g_a g_bᵀ + μ g_b g_aᵀ + μ (g_a·g_b) I dV,    g_a = J⁻ᵀ ∂N_a/∂ξ,
        λ = ν/((1 + ν)(1 − 2ν)),   μ = 1/(2(1 + ν))

    Incompatible modes P of a kind stand beside its nodes with the gradients of `bubble_gradients`, whose mean is zero so that
    constant strain passes; they are condensed: K_uu − K_ua K_aa⁻¹ K_au.

    position (e, k, 3) [m]; nu (e,) [-]; ids (e,) for the error message. Returns (e, k(k+1)/2, 9) [m], the 3 × 3 blocks
    of the node pairs a ≤ b in the order of numpy.triu_indices. Raises DeckError where |J| ≤ 0, naming the elements.
    """
    xi, w = kind.stiffness
    g, det = gradients(kind, position, xi, ids)
    if kind.bubble_gradient:
        g = np.concatenate([g, bubble_gradients(kind, position, xi, det)], axis=2)
    size = g.shape[2]
    root = g * np.sqrt(w * det)[:, :, None, None]
    flat = root.reshape(len(position), len(w), 3 * size)
    outer = np.matmul(flat.swapaxes(1, 2), flat).reshape(-1, size, 3, size, 3)
    lam = (nu / ((1 + nu) * (1 - 2 * nu)))[:, None, None, None]
    mu = (0.5 / (1 + nu))[:, None, None, None]
    if kind.bubble_gradient:
        K = _isotropic(outer.transpose(0, 1, 3, 2, 4), lam[..., None], mu[..., None])
        K = _condensed(K, len(kind.nodes))
        a, b = np.triu_indices(len(kind.nodes))
        return K[:, a, b].reshape(len(position), -1, 9)
    a, b = np.triu_indices(size)
    pairs = outer[:, a, :, b, :].swapaxes(0, 1)
    return _isotropic(pairs, lam, mu).reshape(len(position), -1, 9)


def anisotropic_stiffnesses(
    kind: ElementKind, position: np.ndarray, C: np.ndarray, ids: np.ndarray, rule: Rule
) -> np.ndarray:
    """Stiffness of anisotropic elements, K = ∫ BᵀCB dV, with the strain B z in the order xx yy zz xy yz zx, γ = 2ε.

    position (e, k, 3) [m]; C (e, q, 6, 6) [Pa] along the basic axes at the points of the rule, or (e, 1, 6, 6) where it is one in
    all of an element; incompatible modes, ids and errors as in `element_stiffnesses`. Returns (e, k(k+1)/2, 9) [N/m].
    """
    xi, w = rule
    k = len(kind.nodes)
    a, b = np.triu_indices(k)
    K = np.empty((len(position), len(a), 9))
    step = max(1, 27 * AT_ONCE // max(27, len(w)))
    for start in range(0, len(position), step):
        own = slice(start, start + step)
        g, det = gradients(kind, position[own], xi, ids[own])
        if kind.bubble_gradient:
            g = np.concatenate([g, bubble_gradients(kind, position[own], xi, det)], axis=2)
        e, q, size = g.shape[:3]
        B = symmetric_gradient(g).reshape(e, q, 6, 3 * size)
        stress = np.matmul(C[own] * (w * det)[:, :, None, None], B)
        whole = np.matmul(B.reshape(e, 6 * q, -1).swapaxes(1, 2), stress.reshape(e, 6 * q, -1))
        blocks = whole.reshape(e, size, 3, size, 3).swapaxes(2, 3)
        if kind.bubble_gradient:
            blocks = _condensed(blocks, k)
        K[own] = blocks[:, a, b].reshape(e, -1, 9)
    return K


def element_masses(kind: ElementKind, position: np.ndarray, ids: np.ndarray, rule: Rule | None = None) -> np.ndarray:
    """Consistent mass with unit density, m_ab = ∫ N_a N_b dV; the mass of the three components is m ⊗ I₃.

    position (e, k, 3) [m]; ids (e,) for the error message; rule: one whose weights are times a density, None that of the kind.
    Returns (e, k(k+1)/2, 1) [m³] of the node pairs a ≤ b. Raises DeckError where |J| ≤ 0, naming the elements.
    """
    xi, w = kind.mass if rule is None else rule
    _, det = jacobians(kind, position, xi, ids)
    N = kind.shape(xi)
    a, b = np.triu_indices(N.shape[1])
    return ((det * w) @ (N[:, a] * N[:, b]))[:, :, None]


def jacobians(
    kind: ElementKind, position: np.ndarray, xi: np.ndarray, ids: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """J = ∂x/∂ξ (e, q, 3, 3) [m] with J[d, c] = ∂x_c/∂ξ_d, and |J| (e, q) [m³].

    Raises DeckError where |J| ≤ 0, naming the elements.
    """
    J = np.einsum("qkd,ekc->eqdc", kind.gradient(xi), position, optimize=True)
    det = np.linalg.det(J)
    size = np.ptp(position, axis=1).max(axis=1)[:, None] ** 3
    bad = ~(det > 1e-12 * size).all(axis=1)
    if bad.any():
        worst = int(np.argmin(det.min(axis=1) / size[:, 0]))
        names = ", ".join(str(id) for id in ids[bad][:5]) + (", …" if bad.sum() > 5 else "")
        raise DeckError(
            f"{bad.sum()} {kind.name} elements are flat or inverted: {names} "
            f"(least Jacobian {det[worst].min():.3g} m³ in element {ids[worst]})",
            remedy="check the order of their nodes and how far their mid-side nodes are off the middle",
            entity=("element", int(ids[worst])),
        )
    return J, det


def gradients(
    kind: ElementKind, position: np.ndarray, xi: np.ndarray, ids: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """g_a = J⁻ᵀ ∂N_a/∂ξ (e, q, k, 3) [1/m] and |J| (e, q) [m³]."""
    J, det = jacobians(kind, position, xi, ids)
    return np.matmul(kind.gradient(xi), np.linalg.inv(J).swapaxes(2, 3)), det


def positions(kind: ElementKind, position: np.ndarray, xi: np.ndarray) -> np.ndarray:
    """x = Σ_a N_a x_a (e, q, 3) [m] of elements position (e, k, 3) at ξ (q, 3)."""
    return np.einsum("qk,ekc->eqc", kind.shape(xi), position)


def symmetric_gradient(g: np.ndarray) -> np.ndarray:
    """[εxx εyy εzz γxy γyz γzx] per component of the displacement of each node: g (e, q, k, 3) → (e, q, 6, k, 3)."""
    B = np.zeros((*g.shape[:2], 6, *g.shape[2:]))
    for i in range(3):
        B[:, :, i, :, i] = g[..., i]
    for row, (i, j) in enumerate(SHEARS, start=3):
        B[:, :, row, :, i] = g[..., j]
        B[:, :, row, :, j] = g[..., i]
    return B


def bubble_gradients(kind: ElementKind, position: np.ndarray, xi: np.ndarray, det: np.ndarray) -> np.ndarray:
    """(|J₀|/|J|) J₀⁻ᵀ ∂P/∂ξ (e, q, p, 3) [1/m] of the incompatible modes, J₀ at the centre (Taylor et al. 1976)."""
    assert kind.bubble_gradient is not None
    J = np.einsum("qkd,ekc->eqdc", kind.gradient(kind.centre), position)[:, 0]
    g = np.einsum("qid,ecd->eqic", kind.bubble_gradient(xi), np.linalg.inv(J))
    return g * (np.linalg.det(J)[:, None] / det)[:, :, None, None]


def _isotropic(outer: np.ndarray, lam: np.ndarray, mu: np.ndarray) -> np.ndarray:
    """λ G + μ Gᵀ + μ tr(G) I for blocks G = ∫ g_a g_bᵀ (..., 3, 3)."""
    trace = np.trace(outer, axis1=-2, axis2=-1)[..., None, None]
    return lam * outer + mu * outer.swapaxes(-1, -2) + mu * trace * np.eye(3)


def _condensed(K: np.ndarray, nodes: int) -> np.ndarray:
    """K_uu − K_ua K_aa⁻¹ K_au of blocks (e, k, k, 3, 3) whose first `nodes` stay."""
    e, k = K.shape[:2]
    dense = K.transpose(0, 1, 3, 2, 4).reshape(e, 3 * k, 3 * k)
    u = 3 * nodes
    condensed = dense[:, :u, :u] - dense[:, :u, u:] @ np.linalg.solve(dense[:, u:, u:], dense[:, u:, :u])
    return condensed.reshape(e, nodes, 3, nodes, 3).transpose(0, 1, 3, 2, 4)
