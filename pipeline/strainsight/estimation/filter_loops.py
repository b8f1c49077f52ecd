"""The compiled loops of linear Kalman filters side by side; `parallel_filters.advance` has the equations.

Plain loops that numba compiles: they take the same steps on every processor, and a step of twenty-odd states in microseconds.
One file, because the compiled code that numba keeps on disk does not notice a change in another file.
"""

from __future__ import annotations

import numpy as np
from numba import njit

UNMOVED, CALM = 1e-13, 20
"""A covariance is steady after CALM steps in which no entry moved by more than UNMOVED of its standard deviations."""


@njit(cache=True, nogil=True, fastmath={"contract", "reassoc"})
def take_steps(span, system, beyond, state, considering, data, keep, out, ahead):  # type: ignore[no-untyped-def]
    AT, G, Q, H, F, A_nu, G_nu, D, E, offset = system
    B, U, W, about = beyond
    xs, Ps, Vs, gains, variances, Ss, calms, nus, lefts = state
    xcs, Pcs, Vcs = considering
    known, known_end, y, R, more = data
    fits, nu_kept, left_kept, x_kept, P_kept, V_kept = out
    y_kept, S_kept, slope_kept = ahead
    m, n, d = H.shape[1], H.shape[2], D.shape[0]
    before, work, row, row2 = np.empty((n, n)), np.empty((n, n)), np.empty(n), np.empty(n)
    moved, whitened = np.empty((d, n)), np.empty(m)
    sensed, slope, gain_nu, likely = np.empty((m, d)), np.empty(d), np.empty(d), np.empty(n)
    f, ahead_of_loads = len(U), A_nu.shape[1] - len(U)
    z = np.empty(f)
    for i in span:
        x, P, V, K, S = xs[i], Ps[i], Vs[i], gains[i], variances[i]
        for t in range(len(y)):
            complete = not np.isnan(y[t]).any()
            if not complete or (t > 0 and (R[t] != R[t - 1]).any()):
                calms[i] = 0
            steady = calms[i] >= CALM
            _corrected(x, V, nus[i], about, likely)
            _moved_nuisances(likely, V, AT[i], A_nu[i], G_nu[i], known[t], moved)
            _moved_mean(x, AT[i], G[i], known[t], row)
            if not steady:
                before[:] = P
                _predicted(P, AT[i], Q[i], work)
            _corrected(x, V, nus[i], about, likely)
            _sensed(likely, D, E, offset, known_end[t], sensed)
            for j in range(f):
                z[j] = nus[i, ahead_of_loads + j] * (_dot(U[j], likely) + _dot(W[j], known_end[t]))
            _sensed_beyond(z, B, sensed)
            if not steady and (keep or calms[i] == CALM - 1):  # a step that is kept may be the first of a steady filter
                _innovation_covariance(P, H[i], R[t], row, Ss[i])
            if keep:
                S_kept[i, t] = Ss[i]
                for c in range(m):
                    y_kept[i, t, c] = _dot(H[i, c], x) + _dot(F[i, c], known_end[t])
                    for k in range(d):
                        slope_kept[i, t, c, k] = sensed[c, k] - _dot(H[i, c], V[k])
            for c in range(m):
                whitened[c] = 0.0
                if np.isnan(y[t, c]):
                    continue
                if not steady:
                    S[c] = _updated(P, H[i, c], R[t, c] + more[c], K[c], row, row2, work)
                innovation = y[t, c] - _dot(F[i, c], known_end[t]) - _dot(H[i, c], x)
                for a in range(n):
                    x[a] += K[c, a] * innovation
                whitened[c] = innovation / np.sqrt(S[c])
                fits[i, t] -= 0.5 * np.log(2 * np.pi * S[c])
            fits[i, t] += _updated_nuisances(V, H[i], sensed, K, S, y[t], whitened, slope, gain_nu, nus[i], lefts[i])
            if not steady:
                calms[i] = calms[i] + 1 if complete and _unmoved(P, before) else 0
            if len(xcs):
                _moved_nuisances(xcs[i], Vcs[i], AT[i], A_nu[i], G_nu[i], known[t], moved)
                _moved_mean(xcs[i], AT[i], G[i], known[t], row)
                _predicted(Pcs[i], AT[i], Q[i], work)
                _sensed(xcs[i], D, E, offset, known_end[t], sensed)
                _considered(xcs[i], Pcs[i], Vcs[i], H[i], F[i], known_end[t], y[t], R[t], sensed)
            if keep:
                if len(xcs):
                    x_kept[i, t], P_kept[i, t], V_kept[i, t] = xcs[i], Pcs[i], Vcs[i]
                else:
                    x_kept[i, t], P_kept[i, t], V_kept[i, t] = x, P, V
                nu_kept[i, t], left_kept[i, t] = nus[i], lefts[i]


@njit(cache=True, nogil=True, fastmath={"contract", "reassoc"})
def _dot(a, b):  # type: ignore[no-untyped-def]
    value = 0.0
    for j in range(len(a)):
        value += a[j] * b[j]
    return value


@njit(cache=True, nogil=True, fastmath={"contract", "reassoc"})
def _add_rows(h, X, n, out):  # type: ignore[no-untyped-def]
    """out ← out + Σ_b h_b X_b, of the first n columns; four rows at a time, so that out is read and written less often."""
    whole = len(h) - len(h) % 4
    for b in range(0, whole, 4):
        h0, h1, h2, h3 = h[b], h[b + 1], h[b + 2], h[b + 3]
        for a in range(n):
            out[a] += h0 * X[b, a] + h1 * X[b + 1, a] + h2 * X[b + 2, a] + h3 * X[b + 3, a]
    for b in range(whole, len(h)):
        for a in range(n):
            out[a] += h[b] * X[b, a]


@njit(cache=True, nogil=True, fastmath={"contract", "reassoc"})
def _moved_mean(x, AT, G, w, ahead):  # type: ignore[no-untyped-def]
    """x ← A x + G w."""
    n = len(x)
    for a in range(n):
        ahead[a] = _dot(G[a], w)
    _add_rows(x, AT, n, ahead)
    for a in range(n):
        x[a] = ahead[a]


@njit(cache=True, nogil=True, fastmath={"contract", "reassoc"})
def _moved_nuisances(x, V, AT, A_nu, G_nu, w, moved):  # type: ignore[no-untyped-def]
    """V ← A V − (A_ν x + G_ν w), x before it has moved."""
    d, n = V.shape
    for k in range(d):
        for a in range(n):
            moved[k, a] = 0.0
        _add_rows(V[k], AT, n, moved[k])
        if k < len(A_nu):
            for a in range(n):
                moved[k, a] -= _dot(A_nu[k, a], x) + _dot(G_nu[k, a], w)
        for a in range(n):
            V[k, a] = moved[k, a]


@njit(cache=True, nogil=True, fastmath={"contract", "reassoc"})
def _predicted(P, AT, Q, half):  # type: ignore[no-untyped-def]
    """P ← A P Aᵀ + Q, symmetric; half: P Aᵀ."""
    n = len(P)
    for a in range(n):
        for b in range(n):
            half[a, b] = 0.0
        _add_rows(P[a], AT, n, half[a])
    for a in range(n):
        for b in range(a + 1):
            P[a, b] = Q[a, b]
        _add_rows(AT[:, a], half, a + 1, P[a])
    for a in range(n):
        for b in range(a):
            P[b, a] = P[a, b]


@njit(cache=True, nogil=True, fastmath={"contract", "reassoc"})
def _innovation_covariance(P, H, R, Ph, S):  # type: ignore[no-untyped-def]
    """S ← H P Hᵀ + R."""
    m = len(H)
    for c in range(m):
        _product(P, H[c], Ph)
        for g in range(m):
            S[g, c] = _dot(H[g], Ph)
        S[c, c] += R[c]


@njit(cache=True, nogil=True, fastmath={"contract", "reassoc"})
def _product(P, h, out):  # type: ignore[no-untyped-def]
    """out ← P h, P symmetric."""
    n = len(h)
    for a in range(n):
        out[a] = 0.0
    _add_rows(h, P, n, out)


@njit(cache=True, nogil=True, fastmath={"contract", "reassoc"})
def _updated(P, h, r, k, Ph, Th, T):  # type: ignore[no-untyped-def]
    """P ← (I − k hᵀ) P (I − h kᵀ) + k r kᵀ, Joseph's form, with k ← P h/s; returns s = hᵀP h + r."""
    n = len(h)
    _product(P, h, Ph)
    s = r + _dot(h, Ph)
    for a in range(n):
        k[a] = Ph[a] / s
    for a in range(n):
        for b in range(n):
            T[a, b] = P[a, b] - k[a] * Ph[b]
        Th[a] = _dot(T[a], h)
    for a in range(n):
        for b in range(a + 1):
            P[a, b] = P[b, a] = T[a, b] - Th[a] * k[b] + r * k[a] * k[b]
    return s


@njit(cache=True, nogil=True, fastmath={"contract", "reassoc"})
def _sensed(x, D, E, offset, w, out):  # type: ignore[no-untyped-def]
    """What one of every ν adds to the readings of the predicted motion."""
    for k in range(len(D)):
        for c in range(D.shape[1]):
            out[c, k] = offset[k, c] + _dot(D[k, c], x) + _dot(E[k, c], w)


@njit(cache=True, nogil=True, fastmath={"contract", "reassoc"})
def _sensed_beyond(z, B, out):  # type: ignore[no-untyped-def]
    """What it adds to them of what loads displace beyond the coordinates."""
    if len(z) == 0:
        return
    for k in range(len(B)):
        for c in range(B.shape[1]):
            out[c, k] += _dot(B[k, c], z)


@njit(cache=True, nogil=True, fastmath={"contract", "reassoc"})
def _corrected(x, V, nu, about, out):  # type: ignore[no-untyped-def]
    """x less what ν makes of it; ν that is counted from elsewhere than zero has its slopes there."""
    for a in range(len(x)):
        out[a] = x[a]
    for k in range(len(nu)):
        if about[k] == 0.0:
            for a in range(len(x)):
                out[a] -= V[k, a] * nu[k]


@njit(cache=True, nogil=True, fastmath={"contract", "reassoc"})
def _updated_nuisances(V, H, sensed, K, S, y, whitened, slope, gain_nu, nu, left):  # type: ignore[no-untyped-def]
    """V ← V + K ε, and ν by least squares on the innovations; returns what the squares add to the log-likelihood."""
    d, n = V.shape
    fit = 0.0
    for c in range(len(H)):
        if np.isnan(y[c]):
            continue
        one = 1.0 / np.sqrt(S[c])
        for k in range(d):
            change = sensed[c, k] - _dot(H[c], V[k])
            for a in range(n):
                V[k, a] += K[c, a] * change
            slope[k] = change * one
        for k in range(d):
            gain_nu[k] = _dot(left[k], slope)
        size, rest = 1.0 + _dot(gain_nu, slope), whitened[c] - _dot(nu, slope)
        for k in range(d):
            share = gain_nu[k] / size
            nu[k] += share * rest
            for j in range(d):
                left[k, j] -= share * gain_nu[j]
        fit -= 0.5 * (rest * rest / size + np.log(size))
    return fit


@njit(cache=True, nogil=True, fastmath={"contract", "reassoc"})
def _unmoved(P, before):  # type: ignore[no-untyped-def]
    for a in range(len(P)):
        for b in range(len(P)):
            if abs(P[a, b] - before[a, b]) > UNMOVED * np.sqrt(before[a, a] * before[b, b]):
                return False
    return True


@njit(cache=True, nogil=True, fastmath={"contract", "reassoc"})
def _considered(x, P, V, H, F, w, y, R, sensed):  # type: ignore[no-untyped-def]
    """Update by all channels that measured, with the gain of Schmidt."""
    d, n = V.shape
    there = np.flatnonzero(~np.isnan(y))
    m = len(there)
    Ph, slope, S, K = np.empty((m, n)), np.empty((m, d)), np.empty((m, m)), np.empty((m, n))
    innovation = np.empty(m)
    for c in range(m):
        h = H[there[c]]
        _product(P, h, Ph[c])
        innovation[c] = y[there[c]] - _dot(F[there[c]], w) - _dot(h, x)
        K[c] = Ph[c]
        for k in range(d):
            slope[c, k] = sensed[there[c], k] - _dot(h, V[k])
            for a in range(n):
                K[c, a] -= V[k, a] * slope[c, k]
        for g in range(c + 1):
            S[c, g] = _dot(H[there[g]], Ph[c]) + _dot(slope[c], slope[g])
        S[c, c] += R[there[c]]
    _solved(S, K)
    for c in range(m):
        for a in range(n):
            x[a] += K[c, a] * innovation[c]
        for k in range(d):
            for a in range(n):
                V[k, a] += K[c, a] * slope[c, k]
        for a in range(n):
            for b in range(n):
                P[a, b] -= K[c, a] * Ph[c, b]
    # rows of P Hᵀ after the first factor of Joseph's form
    for c in range(m):
        for a in range(n):
            Ph[c, a] = _dot(P[a], H[there[c]]) - R[there[c]] * K[c, a]
    for c in range(m):
        for a in range(n):
            for b in range(n):
                P[a, b] -= Ph[c, a] * K[c, b]
    for a in range(n):
        for b in range(a):
            P[a, b] = P[b, a] = 0.5 * (P[a, b] + P[b, a])


@njit(cache=True, nogil=True, fastmath={"contract", "reassoc"})
def _solved(S, B):  # type: ignore[no-untyped-def]
    """B ← S⁻¹ B by Cholesky's factors, of the lower half of S, which they replace."""
    m = len(S)
    for c in range(m):
        for g in range(c + 1):
            value = S[c, g]
            for j in range(g):
                value -= S[c, j] * S[g, j]
            S[c, g] = np.sqrt(value) if c == g else value / S[g, g]
    for c in range(m):
        for j in range(c):
            for a in range(B.shape[1]):
                B[c, a] -= S[c, j] * B[j, a]
        for a in range(B.shape[1]):
            B[c, a] /= S[c, c]
    for c in range(m - 1, -1, -1):
        for j in range(c + 1, m):
            for a in range(B.shape[1]):
                B[c, a] -= S[j, c] * B[j, a]
        for a in range(B.shape[1]):
            B[c, a] /= S[c, c]
