"""The derivatives of an implicit step by the implicit function theorem, in minimal coordinates and out of them."""

from __future__ import annotations

import numpy as np

from strainsight.compiled import inner, kept
from strainsight.multibody.compiled.arrays import Arrays, Moments, Pattern, Point
from strainsight.multibody.compiled.equations import FILES, equations
from strainsight.multibody.compiled.matrix import expanded, factorise, right_side, scaled, substitute


@kept(*FILES)
def step_slopes(
    s: Arrays,
    pattern: Pattern,
    p: Point,
    theta: np.ndarray,
    memory: np.ndarray,
    q: np.ndarray,
    z: np.ndarray,
    mu: np.ndarray,
    lam: np.ndarray,
    elastic: np.ndarray,
) -> tuple[bool, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Whether the matrix is regular; A (2n, 2n), B_u (2n, all of u), B_θ (2n, nθ), B_w (2n, n) at the solved step q, ζ, μ, λ;
    elastic (n, nθ) = ∂(Kq + Cv)/∂θ.

        δq = T y,   δv = T ζ + ω × (ε × R),    (y, ζ) = Z⁻¹(TᵀD²/h δq_k,  TᵀM/h δv_k − ∂r₂/∂u δu − ∂r₂/∂θ δθ + Tᵀδw)
    """
    n, nt, m, h, nd, count = len(q), len(s.dt), s.joints, p.h, s.drives, len(theta)
    # no literal, for which numba would make all of the equations once more
    tangents = nt > 0
    _, terms = equations(s, p, theta, memory, q, z, mu, lam, tangents)
    by_drive, TM = terms.by_drive, terms.TM
    Z, J, S = scaled(pattern, h, terms)
    columns = 2 * nt + 2 * nd
    r1, r2, r3, r4 = np.zeros((nt, columns)), np.zeros((nt, columns)), np.zeros((m, columns)), np.zeros((m, columns))
    for i in range(nt):
        r1[i, i] = r2[i, nt + i] = 1.0
    for k in range(len(s.drive)):
        row, at = s.drive[k, 0], 2 * nt + s.drive[k, 2]
        rate = by_drive[k, nt + 1]
        for i in range(nt):
            r1[i, at] -= by_drive[k, i] * mu[s.rigid + row]
            r2[i, at] += by_drive[k, i] * lam[s.rigid + row]
            rate += by_drive[k, i] * z[i]
        r3[row, at] -= rate
        r3[row, at + nd] -= by_drive[k, nt]
        r4[row, at] -= by_drive[k, nt]
    own, right = right_side(pattern, h, terms.A, J, S, r1, r2, r3, r4)
    regular, pivots, last = factorise(Z, pattern.low)
    if regular:
        substitute(Z, pattern.low, pivots, last, right)
    y, zeta, _, _ = expanded(pattern, h, terms.X, J, S, own, right)
    whole = natural_rows(s.body, q, z, y, zeta)
    first, second = whole[:, :nt], whole[:, nt : 2 * nt]
    by_all, by_w = np.zeros((2 * n, 2 * n)), np.zeros((2 * n, n))
    _times_columns(s.body, q, first, s.d**2 / h, by_all)
    _times_columns(s.body, q, second, np.ones(n), by_w)
    for k in range(len(s.body)):
        moving, n0, t0, modes, width = s.body[k, 0], s.body[k, 1], s.body[k, 2], s.body[k, 3], s.body[k, 5]
        size = 12 * moving + modes
        for i in range(2 * n):
            for b in range(width):
                value = second[i, t0 + b] / h
                for j in range(size):
                    by_all[i, n + n0 + j] += value * TM[t0 + b, j]
    F = terms.by_parameters.copy()
    for k in range(len(s.input_row)):
        row = s.input_row[k]
        body = s.relations.feels[row, 0]
        if body >= 0:
            for i in range(s.body[body, 2], s.body[body, 2] + s.body[body, 5]):
                F[i, count + s.input_which[k]] -= terms.g[row, i]
    _moment_slopes(s.body, s.moments, q, F[:, count:])
    for k in range(len(s.body)):
        moving, n0, t0, modes = s.body[k, 0], s.body[k, 1], s.body[k, 2], s.body[k, 3]
        for i in range(modes):
            for j in range(count):
                F[t0 + 6 * moving + i, j] += elastic[n0 + 12 * moving + i, j]
    found = -(np.ascontiguousarray(second) @ F)
    by_theta, by_u = found[:, :count].copy(), found[:, count:].copy()
    for i in range(2 * n):
        for k in range(2 * nd):
            by_u[i, s.drive_at + k] += whole[i, 2 * nt + k]
    return regular, by_all, by_u, by_theta, by_w


@inner
def natural_rows(body: np.ndarray, q: np.ndarray, z: np.ndarray, y: np.ndarray, zeta: np.ndarray) -> np.ndarray:
    """δq, δv (2n, k) of y, ζ (nt, k):  δR_β = ε × R_β,   δṘ_β = δω × R_β + ω × (ε × R_β)."""
    n, k = len(q), y.shape[1]
    out = np.empty((2 * n, k))
    for b in range(len(body)):
        moving, n0, t0, modes = body[b, 0], body[b, 1], body[b, 2], body[b, 3]
        for i in range(modes):
            for c in range(k):
                out[n0 + 12 * moving + i, c] = y[t0 + 6 * moving + i, c]
                out[n + n0 + 12 * moving + i, c] = zeta[t0 + 6 * moving + i, c]
        if moving == 0:
            continue
        w0, w1, w2 = z[t0 + 3], z[t0 + 4], z[t0 + 5]
        for a in range(3):
            for c in range(k):
                out[n0 + a, c], out[n + n0 + a, c] = y[t0 + a, c], zeta[t0 + a, c]
        for beta in range(3):
            at = n0 + 3 + 3 * beta
            R0, R1, R2 = q[at], q[at + 1], q[at + 2]
            for c in range(k):
                e0, e1, e2 = y[t0 + 3, c], y[t0 + 4, c], y[t0 + 5, c]
                d0, d1, d2 = e1 * R2 - e2 * R1, e2 * R0 - e0 * R2, e0 * R1 - e1 * R0
                o0, o1, o2 = zeta[t0 + 3, c], zeta[t0 + 4, c], zeta[t0 + 5, c]
                out[at, c], out[at + 1, c], out[at + 2, c] = d0, d1, d2
                out[n + at, c] = o1 * R2 - o2 * R1 + w1 * d2 - w2 * d1
                out[n + at + 1, c] = o2 * R0 - o0 * R2 + w2 * d0 - w0 * d2
                out[n + at + 2, c] = o0 * R1 - o1 * R0 + w0 * d1 - w1 * d0
    return out


@inner
def _times_columns(body: np.ndarray, q: np.ndarray, W: np.ndarray, scale: np.ndarray, out: np.ndarray) -> None:
    """The first n columns of out (r, :) = W Tᵀ diag(scale), of W (r, nt)."""
    for i in range(len(W)):
        for b in range(len(body)):
            moving, n0, t0, modes = body[b, 0], body[b, 1], body[b, 2], body[b, 3]
            for k in range(modes):
                out[i, n0 + 12 * moving + k] = W[i, t0 + 6 * moving + k] * scale[n0 + 12 * moving + k]
            if moving == 0:
                continue
            e0, e1, e2 = W[i, t0 + 3], W[i, t0 + 4], W[i, t0 + 5]
            for a in range(3):
                out[i, n0 + a] = W[i, t0 + a] * scale[n0 + a]
            for beta in range(3):
                at = n0 + 3 + 3 * beta
                R0, R1, R2 = q[at], q[at + 1], q[at + 2]
                out[i, at] = (e1 * R2 - e2 * R1) * scale[at]
                out[i, at + 1] = (e2 * R0 - e0 * R2) * scale[at + 1]
                out[i, at + 2] = (e0 * R1 - e1 * R0) * scale[at + 2]


@inner
def _moment_slopes(body: np.ndarray, moments: Moments, q: np.ndarray, F: np.ndarray) -> None:
    """F (nt, nu) += ∂r₂/∂u of the moments:  −d_k in rows ε,  −ΨᵀRᵀd_k in rows η."""
    for m in range(len(moments.on)):
        k = moments.on[m]
        moving, n0, t0, modes = body[k, 0], body[k, 1], body[k, 2], body[k, 3]
        for j in range(moments.inputs.shape[1]):
            which = moments.inputs[m, j]
            if which < 0:
                continue
            for beta in range(3):
                on = moments.direction[m, beta, j]
                if moving:
                    F[t0 + 3 + beta, which] -= on
                    on = 0.0
                    for a in range(3):
                        on += q[n0 + 3 + 3 * beta + a] * moments.direction[m, a, j]
                for i in range(modes):
                    F[t0 + 6 * moving + i, which] -= moments.rotation[m, beta, i] * on
