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
def take_steps(span, motion, reading, beyond, state, considering, data, keep, out, ahead):  # type: ignore[no-untyped-def]
    pairs, beside, G, Q, pairs_nu, beside_nu, G_nu, basis = motion
    H, F, D, E, offset, acts = reading
    B, U, W, about = beyond
    xs, Ps, Vs, gains, variances, Ss, calms, nus, lefts = state
    xcs, Pcs, Vcs = considering
    known, known_end, y, R, more, less = data
    fits, nu_kept, left_kept, x_kept, P_kept, V_kept = out
    y_kept, S_kept, slope_kept = ahead
    keeps, whole = keep
    m, n, d = H.shape[1], H.shape[2], D.shape[0]
    before, work, row, row2 = np.empty((n, n)), np.empty((n, n)), np.empty(n), np.empty(n)
    moved, whitened = np.empty(n), np.empty(m)
    sensed, likely, seen = np.empty((m, d)), np.empty(n), np.empty(n)
    f, ahead_of_loads = len(U), len(pairs_nu[0]) - len(U)
    z = np.empty(f)
    for i in span:
        x, P, V, K, S = xs[i], Ps[i], Vs[i], gains[i], variances[i]
        for t in range(len(y)):
            complete = not np.isnan(y[t]).any()
            if not complete or (t > 0 and (R[t] != R[t - 1]).any()):
                calms[i] = 0
            steady = calms[i] >= CALM
            _corrected(x, V, nus[i], about, likely)
            _moved_nuisances(likely, V, pairs[i], beside[i], pairs_nu[i], beside_nu[i], G_nu[i], known[t], moved)
            _moved_mean(x, pairs[i], beside[i], G[i], known[t], row)
            if not steady:
                before[:] = P
                _predicted(P, pairs[i], beside[i], Q[i], work)
            _corrected(x, V, nus[i], about, likely)
            _in_states(basis[i], likely, seen)
            _sensed(seen, D, E, offset, acts, known_end[t], sensed)
            for j in range(f):
                z[j] = nus[i, ahead_of_loads + j] * (_dot(U[j], seen) + _dot(W[j], known_end[t]))
            _sensed_beyond(z, B, sensed)
            if not steady and (
                whole or calms[i] == CALM - 1
            ):  # a step that is kept may be the first of a steady filter
                _innovation_covariance(P, H[i], R[t], row, Ss[i])
            if whole:
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
            fits[i, t] += _updated_nuisances(V, H[i], sensed, K, S, y[t], whitened, nus[i], lefts[i])
            if len(less):
                fits[i, t] += _without(less[t], nus[i], lefts[i])
            if not steady:
                _mirrored(P)
                calms[i] = calms[i] + 1 if complete and _unmoved(P, before, row) else 0
            if len(xcs):
                _moved_nuisances(
                    xcs[i], Vcs[i], pairs[i], beside[i], pairs_nu[i], beside_nu[i], G_nu[i], known[t], moved
                )
                _moved_mean(xcs[i], pairs[i], beside[i], G[i], known[t], row)
                _predicted(Pcs[i], pairs[i], beside[i], Q[i], work)
                _in_states(basis[i], xcs[i], seen)
                _sensed(seen, D, E, offset, acts, known_end[t], sensed)
                _considered(xcs[i], Pcs[i], Vcs[i], H[i], F[i], known_end[t], y[t], R[t], sensed)
            if whole:
                if len(xcs):
                    x_kept[i, t], P_kept[i, t], V_kept[i, t] = xcs[i], Pcs[i], Vcs[i]
                else:
                    x_kept[i, t], P_kept[i, t], V_kept[i, t] = x, P, V
            if keeps:
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
def _add_moved(sign, x, pairs, beside, out):  # type: ignore[no-untyped-def]
    """out ← out ± A x, in coordinates in which modes are apart: each moves by itself and by the states behind them."""
    q, n = pairs.shape[1], len(x)
    for a in range(q):
        out[a] += sign * (pairs[0, a] * x[a] + pairs[1, a] * x[q + a])
    for a in range(q):
        out[q + a] += sign * (pairs[2, a] * x[a] + pairs[3, a] * x[q + a])
    for b in range(len(beside)):
        value = sign * x[2 * q + b]
        for a in range(n):
            out[a] += value * beside[b, a]


@njit(cache=True, nogil=True, fastmath={"contract", "reassoc"})
def _moved_mean(x, pairs, beside, G, w, ahead):  # type: ignore[no-untyped-def]
    """x ← A x + G w."""
    n = len(x)
    for a in range(n):
        ahead[a] = _dot(G[a], w)
    _add_moved(1.0, x, pairs, beside, ahead)
    for a in range(n):
        x[a] = ahead[a]


@njit(cache=True, nogil=True, fastmath={"contract", "reassoc"})
def _moved_nuisances(x, V, pairs, beside, pairs_nu, beside_nu, G_nu, w, moved):  # type: ignore[no-untyped-def]
    """V ← A V − (A_ν x + G_ν w), x before it has moved."""
    d, n = V.shape
    for k in range(d):
        for a in range(n):
            moved[a] = 0.0
        _add_moved(1.0, V[k], pairs, beside, moved)
        if k < len(pairs_nu):
            _add_moved(-1.0, x, pairs_nu[k], beside_nu[k], moved)
            for a in range(n):
                moved[a] -= _dot(G_nu[k, a], w)
        for a in range(n):
            V[k, a] = moved[a]


@njit(cache=True, nogil=True, fastmath={"contract", "reassoc"})
def _predicted(P, pairs, beside, Q, half):  # type: ignore[no-untyped-def]
    """P ← A P Aᵀ + Q, symmetric; half: P Aᵀ."""
    n, q = len(P), pairs.shape[1]
    for a in range(n):
        for b in range(n):
            half[a, b] = 0.0
        _add_moved(1.0, P[a], pairs, beside, half[a])
    for a in range(n):
        for b in range(a + 1):
            P[a, b] = Q[a, b]
        if a < 2 * q:
            k, first = a % q, 2 * (a // q)
            own, rate = pairs[first, k], pairs[first + 1, k]
            for b in range(a + 1):
                P[a, b] += own * half[k, b] + rate * half[q + k, b]
        _add_rows(beside[:, a], half[2 * q :], a + 1, P[a])
    _mirrored(P)


@njit(cache=True, nogil=True, fastmath={"contract", "reassoc"})
def _mirrored(P):  # type: ignore[no-untyped-def]
    """The lower half of P above its diagonal."""
    for a in range(len(P)):
        for b in range(a):
            P[b, a] = P[a, b]


@njit(cache=True, nogil=True, fastmath={"contract", "reassoc"})
def _in_states(basis, z, out):  # type: ignore[no-untyped-def]
    """x = T z."""
    for a in range(len(z)):
        out[a] = _dot(basis[a], z)


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
    """P ← (I − k hᵀ) P (I − h kᵀ) + k r kᵀ, Joseph's form, symmetric but for rounding, with k ← P h/s; returns
    s = hᵀP h + r."""
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
        gone = Th[a] - r * k[a]
        for b in range(n):
            P[a, b] = T[a, b] - gone * k[b]
    return s


@njit(cache=True, nogil=True, fastmath={"contract", "reassoc"})
def _sensed(x, D, E, offset, acts, w, out):  # type: ignore[no-untyped-def]
    """What one of every ν adds to the readings of the predicted motion; nothing where it does not act."""
    for k in range(len(D)):
        for c in range(D.shape[1]):
            out[c, k] = offset[k, c]
            if acts[k, c]:
                out[c, k] += _dot(D[k, c], x) + _dot(E[k, c], w)


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
def _updated_nuisances(V, H, sensed, K, S, y, whitened, nu, left):  # type: ignore[no-untyped-def]
    """V ← V + K ε of one channel after the other, and ν by least squares on the innovations of all at once; returns what the
    squares add to the log-likelihood.

    By slopes s (k, d) of white innovations e (k,):  L Lᵀ = I + s Λ sᵀ,  W = L⁻¹ s Λ,  ν ← ν + Wᵀ L⁻¹(e − s ν),  Λ ← Λ − WᵀW
    """
    d, n = V.shape
    there = np.flatnonzero(~np.isnan(y))
    m = len(there)
    if d == 0:
        fit = 0.0
        for channel in there:
            fit -= 0.5 * whitened[channel] * whitened[channel]
        return fit
    h, g, along, change = np.empty((m, n)), np.empty((m, n)), np.empty((m, m)), np.empty(m)
    slope, W, L, rest = np.empty((m, d)), np.zeros((m, d)), np.empty((m, m)), np.empty(m)
    for c in range(m):
        h[c], g[c] = H[there[c]], K[there[c]]
        for j in range(c):
            along[c, j] = _dot(h[c], g[j])
    for k in range(d):
        for c in range(m):
            change[c] = sensed[there[c], k] - _dot(h[c], V[k])
            for j in range(c):
                change[c] -= along[c, j] * change[j]
            slope[c, k] = change[c] / np.sqrt(S[there[c]])
        _add_rows(change, g, n, V[k])
    for c in range(m):
        _add_rows(slope[c], left, d, W[c])
        for j in range(c + 1):
            L[c, j] = _dot(W[c], slope[j])
        L[c, c] += 1.0
        rest[c] = whitened[there[c]] - _dot(nu, slope[c])
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
        for k in range(d):
            W[c, k] /= L[c, c]
        fit -= 0.5 * rest[c] * rest[c] + np.log(L[c, c])
    _add_rows(rest, W, d, nu)
    for k in range(d):
        for c in range(m):
            change[c] = -W[c, k]
        _add_rows(change, W, d, left[k])
    return fit


@njit(cache=True, nogil=True, fastmath={"contract", "reassoc"})
def _without(less, nu, left):  # type: ignore[no-untyped-def]
    """ν ← ν − Λ β, by an information β that is none; returns what that adds to the log-likelihood, −βᵀν + βᵀΛβ/2."""
    d = len(nu)
    change = np.zeros(d)
    _add_rows(less, left, d, change)
    fit = 0.0
    for k in range(d):
        fit += less[k] * (0.5 * change[k] - nu[k])
        nu[k] -= change[k]
    return fit


@njit(cache=True, nogil=True, fastmath={"contract", "reassoc"})
def _unmoved(P, before, std):  # type: ignore[no-untyped-def]
    for a in range(len(P)):
        std[a] = np.sqrt(before[a, a])
        for b in range(a + 1):
            if abs(P[a, b] - before[a, b]) > UNMOVED * std[a] * std[b]:
                return False
    return True


@njit(cache=True, nogil=True, fastmath={"contract", "reassoc"})
def _considered(x, P, V, H, F, w, y, R, sensed):  # type: ignore[no-untyped-def]
    """Update by all channels that measured, with the gain of Schmidt."""
    d, n = V.shape
    there = np.flatnonzero(~np.isnan(y))
    m = len(there)
    Ph, slope, S, K = np.empty((m, n)), np.empty((m, d)), np.empty((m, m)), np.empty((m, n))
    innovation, less = np.empty(m), np.empty(m)
    for c in range(m):
        h = H[there[c]]
        _product(P, h, Ph[c])
        innovation[c] = y[there[c]] - _dot(F[there[c]], w) - _dot(h, x)
        for k in range(d):
            slope[c, k] = _dot(h, V[k]) - sensed[there[c], k]
        K[c] = Ph[c]
        _add_rows(slope[c], V, n, K[c])
        for g in range(c + 1):
            S[c, g] = _dot(H[there[g]], Ph[c]) + _dot(slope[c], slope[g])
        S[c, c] += R[there[c]]
    _solved(S, K)
    _add_rows(innovation, K, n, x)
    for k in range(d):
        for c in range(m):
            less[c] = -slope[c, k]
        _add_rows(less, K, n, V[k])
    for a in range(n):
        for c in range(m):
            less[c] = -K[c, a]
        _add_rows(less, Ph, n, P[a])
    # rows of P Hᵀ after the first factor of Joseph's form
    for c in range(m):
        for a in range(n):
            Ph[c, a] = _dot(P[a], H[there[c]]) - R[there[c]] * K[c, a]
    for a in range(n):
        for c in range(m):
            less[c] = -Ph[c, a]
        _add_rows(less, K, n, P[a])
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
