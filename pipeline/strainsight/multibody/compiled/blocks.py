"""What every body by itself gives to the equations in minimal coordinates: inertia, elasticity, moments, and the metric."""

from __future__ import annotations

import numpy as np

from strainsight.compiled import inner, joined
from strainsight.multibody.bodies import Inertia, add_inertia
from strainsight.multibody.compiled.arrays import Arrays, Moments, StepPoint, Terms, TrialState


@joined
def natural_motions(body: np.ndarray, q: np.ndarray, y: np.ndarray) -> np.ndarray:
    """T y (n, k) of y (nt, k): δR_β = ε × R_β."""
    k = y.shape[1]
    out = np.empty((len(q), k))
    for b in range(len(body)):
        moving, n0, t0, modes = body[b, 0], body[b, 1], body[b, 2], body[b, 3]
        for i in range(modes):
            for c in range(k):
                out[n0 + 12 * moving + i, c] = y[t0 + 6 * moving + i, c]
        for a in range(3 * moving):
            R = n0 + 3 + 3 * a
            for c in range(k):
                e0, e1, e2 = y[t0 + 3, c], y[t0 + 4, c], y[t0 + 5, c]
                out[n0 + a, c] = y[t0 + a, c]
                out[R, c] = e1 * q[R + 2] - e2 * q[R + 1]
                out[R + 1, c] = e2 * q[R] - e0 * q[R + 2]
                out[R + 2, c] = e0 * q[R + 1] - e1 * q[R]
    return out


@joined
def natural_velocity(body: np.ndarray, q: np.ndarray, z: np.ndarray) -> np.ndarray:
    """v = T ζ (n,)."""
    return natural_motions(body, q, z.reshape(-1, 1)).reshape(-1)


@inner
def project_rows(A: np.ndarray, R: np.ndarray, modes: int, out: np.ndarray) -> None:
    """out (6 + k, w) = Tᵀ A of a matrix A (12 + k, w): rows of R_β × A_β; R (9,)."""
    w = A.shape[1]
    for j in range(w):
        for a in range(3):
            out[a, j], out[3 + a, j] = A[a, j], 0.0
        for beta in range(3):
            x, y, z = R[3 * beta], R[3 * beta + 1], R[3 * beta + 2]
            A0, A1, A2 = A[3 + 3 * beta, j], A[4 + 3 * beta, j], A[5 + 3 * beta, j]
            out[3, j] += y * A2 - z * A1
            out[4, j] += z * A0 - x * A2
            out[5, j] += x * A1 - y * A0
    for m in range(modes):
        for j in range(w):
            out[6 + m, j] = A[12 + m, j]


@inner
def _add_block(block: np.ndarray, at: int, K: np.ndarray) -> None:
    """K[at:, at:] += block."""
    for i in range(len(block)):
        for j in range(block.shape[1]):
            K[at + i, at + j] += block[i, j]


@inner
def _add_turned(g: np.ndarray, R: np.ndarray, at: int, K: np.ndarray) -> None:
    """K[at:, at:] (3, 3) += Σ R_β g_βᵀ − (Σ R_β·g_β) 1, of Σ (ε × R_β) × g_β; R (9,), g (12 + k, 1) behind that of r."""
    for beta in range(3):
        along = 0.0
        for m in range(3):
            along += R[3 * beta + m] * g[3 + 3 * beta + m, 0]
            for n in range(3):
                K[at + m, at + n] += R[3 * beta + m] * g[3 + 3 * beta + n, 0]
        for m in range(3):
            K[at + m, at + m] -= along


@inner
def inertia_of(f: np.ndarray, at: int, n0: int, n: int) -> Inertia:
    """The invariants of a body of n modes from `Arrays.inertia` f, where they begin at `at`."""
    x = at
    first = f[x + 1 : x + 4]
    x += 4
    first_modal = f[x : x + 3 * n].reshape(3, n)
    x += 3 * n
    second = f[x : x + 9].reshape(3, 3)
    x += 9
    coupling = f[x : x + 9 * n].reshape(3, 3, n)
    x += 9 * n
    coupling_modal = f[x : x + 9 * n * n].reshape(n, 3, 3, n)
    x += 9 * n * n
    modal = f[x : x + n * n].reshape(n, n)
    return Inertia(n0, f[at], first, first_modal, second, coupling, coupling_modal, modal)


@joined
def add_bodies(s: Arrays, p: StepPoint, trial: TrialState, v: np.ndarray, terms: Terms, tangents: bool) -> None:
    """r₁ = TᵀD²((q' − q)/h − v'), r₂ = Tᵀ(M a + c + K q + C v + moments − w) (nt,), and the blocks of every body of

        X += TᵀD²T/h + ∂r₁ with the velocity at rest,    A += TᵀM T/h + ∂c/∂ζ + C,     K += ∂r₂ at the same ζ        (nt, nt)

    given as zeros, without tangents not touched; TM (nt, 12 + most modes) = TᵀM of every body.

        ∂(Tᵀg) = Tᵀ∂g + Σ (ε × R_β) × g_β,     ∂v = T δζ + ω × (ε × R_β)
    """
    q, z, h, r1, r2, X, A, K = trial.q, trial.z, p.h, terms.r1, terms.r2, terms.X, terms.A, terms.K
    a = np.empty(len(v))
    for i in range(len(v)):
        a[i] = (v[i] - p.v[i]) / h
    for k in range(len(s.body)):
        moving, n0, t0, modes, width = s.body[k, 0], s.body[k, 1], s.body[k, 2], s.body[k, 3], s.body[k, 5]
        if moving == 0:
            # its frame is the ground's: its coordinates are minimal
            for i in range(modes):
                square, force = s.d[n0 + i] ** 2, -p.w[n0 + i] if len(p.w) else 0.0
                r1[t0 + i] = square * ((q[n0 + i] - p.q[n0 + i]) / h - v[n0 + i])
                for j in range(modes):
                    Mij, Kij, Cij = s.mass[n0 + i, n0 + j], p.K[n0 + i, n0 + j], p.C[n0 + i, n0 + j]
                    force += Mij * a[n0 + j] + Kij * q[n0 + j] + Cij * v[n0 + j]
                    if tangents:
                        terms.TM[t0 + i, j] = Mij
                        A[t0 + i, t0 + j] += Mij / h + Cij
                        K[t0 + i, t0 + j] += Kij
                if tangents:
                    X[t0 + i, t0 + i] += square / h
                r2[t0 + i] += force
            continue
        size = 12 + modes
        R = q[n0 + 3 : n0 + 12]
        column, down = np.empty((size, 1)), np.empty((width, 1))
        for i in range(size):
            column[i, 0] = s.d[n0 + i] ** 2 * ((q[n0 + i] - p.q[n0 + i]) / h - v[n0 + i])
        # the equation of q
        project_rows(column, R, modes, down)
        for i in range(width):
            r1[t0 + i] = down[i, 0]
        w0, w1, w2 = z[t0 + 3], z[t0 + 4], z[t0 + 5]
        if tangents:
            for i in range(width):
                X[t0 + i, t0 + i] += s.dt[t0 + i] ** 2 / h
            _add_turned(column, R, t0 + 3, X)
            square = s.d[n0 + 3] ** 2
            X[t0 + 3, t0 + 4] += square * w2
            X[t0 + 3, t0 + 5] -= square * w1
            X[t0 + 4, t0 + 3] -= square * w2
            X[t0 + 4, t0 + 5] += square * w0
            X[t0 + 5, t0 + 3] += square * w1
            X[t0 + 5, t0 + 4] -= square * w0
        # the equation of motion
        M, g = np.zeros((size, size)), np.zeros(size)
        Gq, Gv = np.zeros((size, size)), np.zeros((size, size))
        if s.body[k, 4] >= 0:
            add_inertia(inertia_of(s.inertia, s.body[k, 4], n0, modes), q, v, a, tangents, M, g, Gq, Gv)
        else:
            for i in range(size):
                for j in range(size):
                    M[i, j] = s.mass[n0 + i, n0 + j]
                    g[i] += M[i, j] * a[n0 + j]
        eta = n0 + 12
        for i in range(modes):
            for j in range(modes):
                g[12 + i] += p.K[eta + i, eta + j] * q[eta + j] + p.C[eta + i, eta + j] * v[eta + j]
        if len(p.w):
            for i in range(size):
                g[i] -= p.w[n0 + i]
        for i in range(size):
            column[i, 0] = g[i]
        project_rows(column, R, modes, down)
        for i in range(width):
            r2[t0 + i] += down[i, 0]
        if not tangents:
            continue
        for i in range(modes):
            for j in range(modes):
                Gq[12 + i, 12 + j] += p.K[eta + i, eta + j]
                Gv[12 + i, 12 + j] += p.C[eta + i, eta + j]
        for i in range(size):
            for j in range(size):
                Gv[i, j] += M[i, j] / h
        whole = np.empty((width, size))
        project_rows(M, R, modes, whole)
        for i in range(width):
            for j in range(size):
                terms.TM[t0 + i, j] = whole[i, j]
        AT, KT = np.empty((size, width)), np.empty((size, width))
        square_block = np.empty((width, width))
        project_rows(Gv.T, R, modes, AT.T)
        project_rows(AT, R, modes, square_block)
        _add_block(square_block, t0, A)
        project_rows(Gq.T, R, modes, KT.T)
        # ∂v of a turn: ω × (e_c × R_β) = e_c (ω·R_β) − R_β ω_c
        for beta in range(3):
            R0, R1, R2 = R[3 * beta], R[3 * beta + 1], R[3 * beta + 2]
            along = w0 * R0 + w1 * R1 + w2 * R2
            for i in range(size):
                G0, G1, G2 = Gv[i, 3 + 3 * beta], Gv[i, 4 + 3 * beta], Gv[i, 5 + 3 * beta]
                on = G0 * R0 + G1 * R1 + G2 * R2
                KT[i, 3] += along * G0 - on * w0
                KT[i, 4] += along * G1 - on * w1
                KT[i, 5] += along * G2 - on * w2
        project_rows(KT, R, modes, square_block)
        _add_block(square_block, t0, K)
        _add_turned(column, R, t0 + 3, K)
    _add_moments(s.body, s.moments, p.u, q, r2, K, tangents)


@inner
def add_natural_bodies(
    s: Arrays, p: StepPoint, q: np.ndarray, v: np.ndarray, a: np.ndarray, terms: Terms, tangents: bool
) -> None:
    """r₂ = M a + c + K q + C v (n,), K += ∂r₂/∂q, A += ∂r₂/∂v, and the blocks of M, of every body."""
    for k in range(len(s.body)):
        n0, modes, size = s.body[k, 1], s.body[k, 3], s.body[k, 5]
        M, g = np.zeros((size, size)), np.zeros(size)
        Gq, Gv = np.zeros((size, size)), np.zeros((size, size))
        if s.body[k, 4] >= 0:
            add_inertia(inertia_of(s.inertia, s.body[k, 4], n0, modes), q, v, a, size > 0, M, g, Gq, Gv)
        for i in range(size):
            for j in range(size):
                if s.body[k, 4] < 0:
                    M[i, j] = s.mass[n0 + i, n0 + j]
                    g[i] += M[i, j] * a[n0 + j]
                terms.TM[n0 + i, j] = M[i, j]
                Gq[i, j] += p.K[n0 + i, n0 + j]
                Gv[i, j] += p.C[n0 + i, n0 + j]
                g[i] += p.K[n0 + i, n0 + j] * q[n0 + j] + p.C[n0 + i, n0 + j] * v[n0 + j]
                if tangents:
                    terms.K[n0 + i, n0 + j] += Gq[i, j]
                    terms.A[n0 + i, n0 + j] += Gv[i, j]
            terms.r2[n0 + i] += g[i]


@inner
def _add_moments(
    body: np.ndarray, moments: Moments, u: np.ndarray, q: np.ndarray, r2: np.ndarray, K: np.ndarray, tangents: bool
) -> None:
    """Of the virtual work T·δθ, δθ = ε + RΨ δη:  rows ε: −T,   rows η: −ΨᵀRᵀT,  whose change is −ΨᵀRᵀ(T × ε)."""
    T = np.empty(3)
    for m in range(len(moments.on)):
        T[0] = T[1] = T[2] = 0.0
        for j in range(moments.inputs.shape[1]):
            which = moments.inputs[m, j]
            if which >= 0:
                for a in range(3):
                    T[a] += moments.direction[m, a, j] * u[which]
        k = moments.on[m]
        moving, n0, t0, modes = body[k, 0], body[k, 1], body[k, 2], body[k, 3]
        if moving:
            for a in range(3):
                r2[t0 + 3 + a] -= T[a]
        for beta in range(3):
            if moving:
                x, y, z = q[n0 + 3 + 3 * beta], q[n0 + 4 + 3 * beta], q[n0 + 5 + 3 * beta]
                on = x * T[0] + y * T[1] + z * T[2]
                # R_β·(T × ε) = (R_β × T)·ε
                across = (y * T[2] - z * T[1], z * T[0] - x * T[2], x * T[1] - y * T[0])
                for i in range(modes if tangents else 0):
                    for a in range(3):
                        K[t0 + 6 + i, t0 + 3 + a] -= moments.rotation[m, beta, i] * across[a]
            else:
                on = T[beta]
            for i in range(modes):
                r2[t0 + 6 * moving + i] -= moments.rotation[m, beta, i] * on
