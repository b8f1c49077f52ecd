"""Relations in minimal coordinates, and what changes of their gradients in either."""

from __future__ import annotations

import numpy as np

from strainsight.compiled import inner, joined
from strainsight.multibody.products import Relations


@joined
def carried(
    r: Relations, body: np.ndarray, q: np.ndarray, z: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """b (nc, 3), its rate, J (nc, 3, 6 + k) = ∂b, ∂(rate) under q alone, and R(c + Cη) (nc, 3).

    b = t r + R y,  y = c + C η;     δb = t δr + ε × Ry + RC δη
    rate = t ṙ + ω × Ry + RC η̇;     δrate = ω × (ε × Ry + RC δη) + ε × RC η̇      at the same (ṙ, ω, η̇)
    """
    nc, most = len(r.t), r.C.shape[2]
    b, rate, turned = np.zeros((nc, 3)), np.zeros((nc, 3)), np.zeros((nc, 3))
    J, Jr = np.zeros((nc, 3, 6 + most)), np.zeros((nc, 3, 6 + most))
    y, yr, ry, ryr, RC = np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    for i in range(nc):
        for a in range(3):
            b[i, a] = r.c[i, a]
        if r.on[i] < 0:
            continue
        moving, n0, t0, felt = body[r.on[i], 0], body[r.on[i], 1], body[r.on[i], 2], r.felt[i]
        eta, etar = n0 + 12 * moving, t0 + 6 * moving
        for a in range(3):
            y[a], yr[a] = r.c[i, a], 0.0
            for k in range(felt):
                y[a] += r.C[i, a, k] * q[eta + k]
                yr[a] += r.C[i, a, k] * z[etar + k]
        if moving == 0:
            for a in range(3):
                b[i, a], rate[i, a] = y[a], yr[a]
                for k in range(felt):
                    J[i, a, k] = r.C[i, a, k]
            continue
        for a in range(3):
            R = n0 + 3 + a
            ry[a] = q[R] * y[0] + q[R + 3] * y[1] + q[R + 6] * y[2]
            ryr[a] = q[R] * yr[0] + q[R + 3] * yr[1] + q[R + 6] * yr[2]
        w0, w1, w2 = z[t0 + 3], z[t0 + 4], z[t0 + 5]
        t = r.t[i]
        rate[i, 0] = t * z[t0] + w1 * ry[2] - w2 * ry[1] + ryr[0]
        rate[i, 1] = t * z[t0 + 1] + w2 * ry[0] - w0 * ry[2] + ryr[1]
        rate[i, 2] = t * z[t0 + 2] + w0 * ry[1] - w1 * ry[0] + ryr[2]
        along = w0 * ry[0] + w1 * ry[1] + w2 * ry[2]
        for a in range(3):
            turned[i, a] = ry[a]
            b[i, a] = t * q[n0 + a] + ry[a]
            J[i, a, a] = t
            Jr[i, a, 3] -= ry[a] * w0
            Jr[i, a, 4] -= ry[a] * w1
            Jr[i, a, 5] -= ry[a] * w2
            Jr[i, a, 3 + a] += along
        _turn(ry, J[i])
        _turn(ryr, Jr[i])
        for k in range(felt):
            for a in range(3):
                R = n0 + 3 + a
                RC[a] = q[R] * r.C[i, 0, k] + q[R + 3] * r.C[i, 1, k] + q[R + 6] * r.C[i, 2, k]
                J[i, a, 6 + k] = RC[a]
            Jr[i, 0, 6 + k] = w1 * RC[2] - w2 * RC[1]
            Jr[i, 1, 6 + k] = w2 * RC[0] - w0 * RC[2]
            Jr[i, 2, 6 + k] = w0 * RC[1] - w1 * RC[0]
    return b, rate, J, Jr, turned


@inner
def _turn(a: np.ndarray, J: np.ndarray) -> None:
    """J[:, 3:6] += −[a]×, of ε × a."""
    J[0, 4] += a[2]
    J[0, 5] -= a[1]
    J[1, 3] -= a[2]
    J[1, 5] += a[0]
    J[2, 3] += a[1]
    J[2, 4] -= a[0]


@inner
def add_curvature(
    r: Relations,
    body: np.ndarray,
    row: int,
    weight: float,
    J: np.ndarray,
    turned: np.ndarray,
    x: np.ndarray,
    K: np.ndarray,
) -> None:
    """K += weight ∂(∇ρᵀ) of one relation:  ∂(Jᵀf) = Jᵀ∂f + ∂Jᵀ f,  rows ε: (ε × Ry + RC δη) × f,  rows η: (ε × RC)·f;
    in natural coordinates  rows R_β: f C_β δη,  rows η: C_βᵀ f·δR_β."""
    for p in range(4):
        i = r.part[row, p]
        if i < 0 or r.on[i] < 0:
            continue
        k, o = r.on[i], 1 - p // 2
        moving, t0, lead = body[k, 0], body[k, 2], body[k, 5] - body[k, 3]
        for other in range(2 * o, 2 * o + 2):
            j = r.part[row, other]
            if j < 0 or r.on[j] < 0:
                continue
            u0, wide = body[r.on[j], 2], body[r.on[j], 5] - body[r.on[j], 3] + r.felt[j]
            both = weight * r.sign[row, p] * r.sign[row, other]
            for m in range(lead + r.felt[i]):
                a0, a1, a2 = both * J[i, 0, m], both * J[i, 1, m], both * J[i, 2, m]
                for n in range(wide):
                    K[t0 + m, u0 + n] += a0 * J[j, 0, n] + a1 * J[j, 1, n] + a2 * J[j, 2, n]
        if moving == 0:
            continue
        own = weight * r.sign[row, p]
        f0, f1, f2 = own * x[row, o, 0], own * x[row, o, 1], own * x[row, o, 2]
        f = (f0, f1, f2)
        if lead == 12:
            for m in range(9):
                for n in range(r.felt[i]):
                    h = f[m % 3] * r.C[i, m // 3, n]
                    K[t0 + 3 + m, t0 + 12 + n] += h
                    K[t0 + 12 + n, t0 + 3 + m] += h
            continue
        along = turned[i, 0] * f0 + turned[i, 1] * f1 + turned[i, 2] * f2
        for m in range(3):
            K[t0 + 3 + m, t0 + 3 + m] -= along
            for n in range(3):
                K[t0 + 3 + m, t0 + 3 + n] += turned[i, m] * f[n]
        for n in range(r.felt[i]):
            c0, c1, c2 = J[i, 0, 6 + n], J[i, 1, 6 + n], J[i, 2, 6 + n]
            across = (c1 * f2 - c2 * f1, c2 * f0 - c0 * f2, c0 * f1 - c1 * f0)
            for m in range(3):
                K[t0 + 3 + m, t0 + 6 + n] += across[m]
                K[t0 + 6 + n, t0 + 3 + m] += across[m]
