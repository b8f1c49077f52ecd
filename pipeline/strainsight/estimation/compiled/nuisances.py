"""Constants ν beside the states: least squares on the innovations, and the gain of Schmidt, which considers them."""

from __future__ import annotations

import numpy as np

from strainsight.estimation.compiled.vectors import add_rows, dot, loop, measured, product, solved


@loop
def updated_nuisances(V, H, sensed, K, S, there, whitened, nu, left, slope, W, small):  # type: ignore[no-untyped-def]
    """V ← V + K ε of one channel after the other, and ν by least squares on the innovations of all at once; returns what the
    squares add to the log-likelihood.

    By slopes s (k, d) of white innovations e (k,):  L Lᵀ = I + s Λ sᵀ,  W = L⁻¹ s Λ,  ν ← ν + Wᵀ L⁻¹(e − s ν),  Λ ← Λ − WᵀW

    V (n, d); there: channels that measured; slope, W (m, d) and small (m + 2, m): work space.
    """
    n, d = V.shape
    m = len(there)
    if d == 0:
        fit = 0.0
        for channel in there:
            fit -= 0.5 * whitened[channel] * whitened[channel]
        return fit
    L, rest, factor = small[:m], small[m], small[m + 1]
    for c in range(m):
        h = H[there[c]]
        for k in range(d):
            slope[c, k] = 0.0
            W[c, k] = 0.0
        add_rows(h, V, d, slope[c])
        for k in range(d):
            slope[c, k] = sensed[there[c], k] - slope[c, k]
        for j in range(c):
            L[c, j] = -dot(h, K[there[j]])
        add_rows(L[c, :c], slope, d, slope[c])
    for a in range(n):
        for c in range(m):
            factor[c] = K[there[c], a]
        add_rows(factor[:m], slope, d, V[a])
    for c in range(m):
        scale = 1.0 / np.sqrt(S[there[c]])
        for k in range(d):
            slope[c, k] *= scale
    for c in range(m):
        add_rows(slope[c], left, d, W[c])
        for j in range(c + 1):
            L[c, j] = dot(W[c], slope[j])
        L[c, c] += 1.0
        rest[c] = whitened[there[c]] - dot(nu, slope[c])
    fit = 0.0
    for c in range(m):
        for j in range(c):
            for i in range(j):
                L[c, j] -= L[c, i] * L[j, i]
            L[c, j] /= L[j, j]
            L[c, c] -= L[c, j] * L[c, j]
            rest[c] -= L[c, j] * rest[j]
            for k in range(d):
                W[c, k] -= L[c, j] * W[j, k]
        L[c, c] = np.sqrt(L[c, c])
        rest[c] /= L[c, c]
        scale = 1.0 / L[c, c]
        for k in range(d):
            W[c, k] *= scale
        fit -= 0.5 * rest[c] * rest[c] + np.log(L[c, c])
    add_rows(rest[:m], W, d, nu)
    for k in range(d):
        for c in range(m):
            factor[c] = -W[c, k]
        add_rows(factor[:m], W, d, left[k])
    return fit


@loop
def without(less, nu, left):  # type: ignore[no-untyped-def]
    """ν ← ν − Λ β, by an information β that is none; returns what that adds to the log-likelihood, −βᵀν + βᵀΛβ/2."""
    d = len(nu)
    change = np.zeros(d)
    add_rows(less, left, d, change)
    fit = 0.0
    for k in range(d):
        fit += less[k] * (0.5 * change[k] - nu[k])
        nu[k] -= change[k]
    return fit


@loop
def considered(x, P, V, H, F, w, y, R, sensed):  # type: ignore[no-untyped-def]
    """Update by all channels that measured, with the gain of Schmidt; V (n, d)."""
    n, d = V.shape
    there = measured(y)
    m = len(there)
    Ph, slope, S, K = np.empty((m, n)), np.empty((m, d)), np.empty((m, m)), np.empty((m, n))
    innovation, less = np.empty(m), np.empty(m)
    for c in range(m):
        h = H[there[c]]
        product(P, h, Ph[c])
        innovation[c] = y[there[c]] - dot(F[there[c]], w) - dot(h, x)
        for k in range(d):
            slope[c, k] = -sensed[there[c], k]
        add_rows(h, V, d, slope[c])
        for a in range(n):
            K[c, a] = Ph[c, a] + dot(slope[c], V[a])
        for g in range(c + 1):
            S[c, g] = dot(H[there[g]], Ph[c]) + dot(slope[c], slope[g])
        S[c, c] += R[there[c]]
    solved(S, K)
    add_rows(innovation, K, n, x)
    for a in range(n):
        for c in range(m):
            less[c] = -K[c, a]
        add_rows(less, slope, d, V[a])
        add_rows(less, Ph, n, P[a])
    # rows of P Hᵀ after the first factor of Joseph's form
    for c in range(m):
        for a in range(n):
            Ph[c, a] = dot(P[a], H[there[c]]) - R[there[c]] * K[c, a]
    for a in range(n):
        for c in range(m):
            less[c] = -Ph[c, a]
        add_rows(less, K, n, P[a])
    for a in range(n):
        for b in range(a):
            P[a, b] = P[b, a] = 0.5 * (P[a, b] + P[b, a])
