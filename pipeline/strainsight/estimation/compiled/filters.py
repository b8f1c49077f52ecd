"""Compiled steps of parallel Kalman filters, each with its own model."""

from __future__ import annotations

import numpy as np

from strainsight.compiled import kept
from strainsight.estimation.compiled.vectors import (
    LOOPS,
    add_rows,
    copy,
    copy_matrix,
    count_differences,
    dot,
    flush,
    is_steady,
    loop,
    measured_channels,
    mirror,
    product,
    solve,
    transpose,
)


@loop
def add_moved(x, pairs, augmented, out):  # type: ignore[no-untyped-def]
    """out ← out + A x in modal coordinates: modes are uncoupled, and the augmented states act on all of them."""
    q, n = pairs.shape[1], len(x)
    for a in range(q):
        out[a] += pairs[0, a] * x[a] + pairs[1, a] * x[q + a]
    for a in range(q):
        out[q + a] += pairs[2, a] * x[a] + pairs[3, a] * x[q + a]
    for b in range(len(augmented)):
        value = x[2 * q + b]
        for a in range(n):
            out[a] += value * augmented[b, a]


@loop
def predict_mean(x, pairs, augmented, G, w, ahead):  # type: ignore[no-untyped-def]
    """x ← A x + G w."""
    n = len(x)
    for a in range(n):
        ahead[a] = dot(G[a], w)
    add_moved(x, pairs, augmented, ahead)
    for a in range(n):
        x[a] = flush(ahead[a])


@loop
def move_considered(x, plain, fixed, V, pairs, augmented, pairs_nu, augmented_nu, G_nu, w, behind):  # type: ignore[no-untyped-def]
    """V ← A V − (A_ν x + G_ν w), x before it has moved; for ν with a fixed slope, fixed (d,) = 1, `plain` in place of x.

    The two terms of a frequency nearly cancel: both belong to the loads without errors, as does the start.
    ν are last, as they are many: V (n, d), slopes (4, q, e), (n, s, e), (n, p, e); behind (s, d): work space."""
    n, d = V.shape
    q, s = pairs.shape[1], len(augmented)
    for a in range(q):
        p0, p1, p2, p3 = pairs[0, a], pairs[1, a], pairs[2, a], pairs[3, a]
        for k in range(d):
            position, rate = V[a, k], V[q + a, k]
            V[a, k] = p0 * position + p1 * rate
            V[q + a, k] = p2 * position + p3 * rate
    for b in range(s):
        for k in range(d):
            behind[b, k] = V[2 * q + b, k]
            V[2 * q + b, k] = 0.0
    for a in range(n):
        add_rows(augmented[:, a], behind, d, V[a])
        for k in range(d):
            V[a, k] = flush(V[a, k])
    e = pairs_nu.shape[2]
    for a in range(n):
        if a < 2 * q:
            i, first = a % q, 2 * (a // q)
            position, rate = x[i], x[q + i]
            more, faster = plain[i] - position, plain[q + i] - rate
            for k in range(e):
                V[a, k] -= pairs_nu[first, i, k] * (position + fixed[k] * more)
                V[a, k] -= pairs_nu[first + 1, i, k] * (rate + fixed[k] * faster)
        for b in range(s):
            value, more = x[2 * q + b], plain[2 * q + b] - x[2 * q + b]
            for k in range(e):
                V[a, k] -= augmented_nu[a, b, k] * (value + fixed[k] * more)
        for j in range(len(w)):
            for k in range(e):
                V[a, k] -= G_nu[a, j, k] * w[j]


@loop
def predict_covariance(P, pairs, augmented, Q, half):  # type: ignore[no-untyped-def]
    """P ← A P Aᵀ + Q, symmetric; half: work space for P Aᵀ."""
    n, q = len(P), pairs.shape[1]
    for a in range(n):
        for b in range(n):
            half[a, b] = 0.0
        add_moved(P[a], pairs, augmented, half[a])
    for a in range(n):
        for b in range(a + 1):
            P[a, b] = Q[a, b]
        if a < 2 * q:
            k, first = a % q, 2 * (a // q)
            position, rate = pairs[first, k], pairs[first + 1, k]
            for b in range(a + 1):
                P[a, b] += position * half[k, b] + rate * half[q + k, b]
        add_rows(augmented[:, a], half[2 * q :], a + 1, P[a])
        for b in range(a + 1):
            P[a, b] = flush(P[a, b])
    mirror(P)


@loop
def to_states(basis, z, out):  # type: ignore[no-untyped-def]
    """x = T z."""
    for a in range(len(z)):
        out[a] = dot(basis[a], z)


@loop
def correct_mean(x, V, nu, out):  # type: ignore[no-untyped-def]
    """x − Vᵀν: the states corrected by the estimate of ν."""
    for a in range(len(x)):
        out[a] = x[a] - dot(V[a], nu)


@loop
def update_considered(V, H, sensed, K, S, channels, whitened, nu, left, slope, W, small):  # type: ignore[no-untyped-def]
    """V ← V + K ε channel by channel, and ν by least squares on all innovations; returns the increment of the log-likelihood.

    With slopes s (k, d) of the white innovations e (k,):  L Lᵀ = I + s Λ sᵀ,  W = L⁻¹ s Λ,  ν ← ν + Wᵀ L⁻¹(e − s ν),  Λ ← Λ − WᵀW

    V (n, d); channels: channels with a sample; slope, W (m, d) and small (m + 2, m): work space."""
    n, d = V.shape
    m = len(channels)
    if d == 0:
        fit = 0.0
        for channel in channels:
            fit -= 0.5 * whitened[channel] * whitened[channel]
        return fit
    L, rest, factor = small[:m], small[m], small[m + 1]
    for c in range(m):
        h = H[channels[c]]
        for k in range(d):
            slope[c, k] = 0.0
            W[c, k] = 0.0
        add_rows(h, V, d, slope[c])
        for k in range(d):
            slope[c, k] = sensed[channels[c], k] - slope[c, k]
        for j in range(c):
            L[c, j] = -dot(h, K[channels[j]])
        add_rows(L[c, :c], slope, d, slope[c])
    for a in range(n):
        for c in range(m):
            factor[c] = K[channels[c], a]
        add_rows(factor[:m], slope, d, V[a])
    for c in range(m):
        scale = 1.0 / np.sqrt(S[channels[c]])
        for k in range(d):
            slope[c, k] *= scale
    for c in range(m):
        add_rows(slope[c], left, d, W[c])
        for j in range(c + 1):
            L[c, j] = dot(W[c], slope[j])
        L[c, c] += 1.0
        rest[c] = whitened[channels[c]] - dot(nu, slope[c])
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
def remove_bias(less, nu, left):  # type: ignore[no-untyped-def]
    """ν ← ν − Λ β, which removes the bias β; returns the increment of the log-likelihood, −βᵀν + βᵀΛβ/2."""
    d = len(nu)
    change = np.zeros(d)
    add_rows(less, left, d, change)
    fit = 0.0
    for k in range(d):
        fit += less[k] * (0.5 * change[k] - nu[k])
        nu[k] -= change[k]
    return fit


@loop
def schmidt_update(x, P, V, H, F, w, y, R, sensed):  # type: ignore[no-untyped-def]
    """Update by all channels with a sample, with the Schmidt-Kalman gain; V (n, d)."""
    n, d = V.shape
    channels = measured_channels(y)
    m = len(channels)
    Ph, slope, S, K = np.empty((m, n)), np.empty((m, d)), np.empty((m, m)), np.empty((m, n))
    innovation, less = np.empty(m), np.empty(m)
    for c in range(m):
        h = H[channels[c]]
        product(P, h, Ph[c])
        innovation[c] = y[channels[c]] - dot(F[channels[c]], w) - dot(h, x)
        for k in range(d):
            slope[c, k] = -sensed[channels[c], k]
        add_rows(h, V, d, slope[c])
        for a in range(n):
            K[c, a] = Ph[c, a] + dot(slope[c], V[a])
        for g in range(c + 1):
            S[c, g] = dot(H[channels[g]], Ph[c]) + dot(slope[c], slope[g])
        S[c, c] += R[channels[c]]
    solve(S, K)
    add_rows(innovation, K, n, x)
    for a in range(n):
        for c in range(m):
            less[c] = -K[c, a]
        add_rows(less, slope, d, V[a])
        add_rows(less, Ph, n, P[a])
    # rows of P Hᵀ after the first factor of Joseph's form
    for c in range(m):
        for a in range(n):
            Ph[c, a] = dot(P[a], H[channels[c]]) - R[channels[c]] * K[c, a]
    for a in range(n):
        for c in range(m):
            less[c] = -Ph[c, a]
        add_rows(less, K, n, P[a])
    for a in range(n):
        for b in range(a):
            P[a, b] = P[b, a] = 0.5 * (P[a, b] + P[b, a])


@loop
def sense(x, D, E, offset, acts, w, out):  # type: ignore[no-untyped-def]
    """Sensitivity of the predicted readings to each ν; zero where it does not act."""
    for k in range(len(D)):
        for c in range(D.shape[1]):
            out[c, k] = offset[k, c]
            if acts[k, c]:
                out[c, k] += dot(D[k, c], x) + dot(E[k, c], w)


@loop
def sense_truncation(z, B, out):  # type: ignore[no-untyped-def]
    """Add the sensitivity to the displacement that the reduced coordinates truncate."""
    if len(z) == 0:
        return
    for k in range(len(B)):
        for c in range(B.shape[1]):
            out[c, k] += dot(B[k, c], z)


@loop
def innovation_covariance(P, H, R, Ph, S):  # type: ignore[no-untyped-def]
    """S ← H P Hᵀ + R."""
    m = len(H)
    for c in range(m):
        product(P, H[c], Ph)
        for g in range(m):
            S[g, c] = dot(H[g], Ph)
        S[c, c] += R[c]


PLAIN = 1e3
"""Largest ratio of predicted and noise variance of a sample for an update in the short form, which loses as many digits."""


@loop
def update_covariance(P, h, r, k, Ph, Th):  # type: ignore[no-untyped-def]
    """P ← (I − k hᵀ) P (I − h kᵀ) + k r kᵀ, Joseph's form, symmetric but for rounding, with k ← P h/s; returns
    s = hᵀP h + r. Where the sample reduces no variance by more than PLAIN, P ← P − k (P h)ᵀ."""
    n = len(h)
    product(P, h, Ph)
    s = r + dot(h, Ph)
    for a in range(n):
        k[a] = Ph[a] / s
    for a in range(n):
        for b in range(n):
            P[a, b] -= k[a] * Ph[b]
    if s <= PLAIN * r:
        return s
    for a in range(n):
        Th[a] = dot(P[a], h)
    for a in range(n):
        lost = Th[a] - r * k[a]
        for b in range(n):
            P[a, b] -= lost * k[b]
    return s


CALM = 20
"""Steps without change (`is_steady`) after which a covariance counts as steady."""
FILES = tuple(f"estimation/compiled/{name}.py" for name in ("filters", "vectors"))


@kept(*FILES, **LOOPS)
def take_steps(span, motion, reading, truncation, state, considering, data, keep, out, ahead):  # type: ignore[no-untyped-def]
    pairs, augmented, G, Q, pairs_nu, augmented_nu, G_nu, basis = motion
    H, F, D, E, offset, acts = reading
    B, U, W, fixed = truncation
    xs, Ps, Vs, gains, variances, Ss, calms, nus, lefts = state
    xcs, Pcs, Vcs = considering
    known, known_end, y, R, more, less = data
    fits, nu_kept, left_kept, x_kept, P_kept, V_kept = out
    y_kept, S_kept, slope_kept = ahead
    keeps, whole = keep
    m, n, d = H.shape[1], H.shape[2], D.shape[0]
    before, work, row, row2 = np.empty((n, n)), np.empty((n, n)), np.empty(n), np.empty(n)
    whitened, small, likely, physical = np.empty(m), np.empty((m + 2, m)), np.empty(n), np.empty(n)
    sensed, slope, gain, behind = (
        np.empty((m, d)),
        np.empty((m, d)),
        np.empty((m, d)),
        np.empty((augmented.shape[1], d)),
    )
    V, V_c, free = np.empty((n, d)), np.empty((n, d)), np.empty(d)
    f, ahead_of_loads = len(U), pairs_nu.shape[3] - len(U)
    z = np.empty(f)
    for i in span:
        x, P, K, S = xs[i], Ps[i], gains[i], variances[i]
        transpose(Vs[i], V)
        if len(xcs):
            transpose(Vcs[i], V_c)
        for t in range(len(y)):
            channels = measured_channels(y[t])
            complete = len(channels) == m
            if not complete or (t > 0 and count_differences(R[t], R[t - 1]) > 0):
                calms[i] = 0
            steady = calms[i] >= CALM
            for k in range(d):
                free[k] = (1.0 - fixed[k]) * nus[i, k]
            correct_mean(x, V, free, likely)
            slopes = pairs_nu[i], augmented_nu[i], G_nu[i]
            move_considered(likely, x, fixed, V, pairs[i], augmented[i], *slopes, known[t], behind)
            predict_mean(x, pairs[i], augmented[i], G[i], known[t], row)
            if not steady:
                copy_matrix(P, before)
                predict_covariance(P, pairs[i], augmented[i], Q[i], work)
            correct_mean(x, V, free, likely)
            to_states(basis[i], likely, physical)
            sense(physical, D, E, offset, acts, known_end[t], sensed)
            for j in range(f):
                z[j] = nus[i, ahead_of_loads + j] * (dot(U[j], physical) + dot(W[j], known_end[t]))
            sense_truncation(z, B, sensed)
            if not steady and (
                whole or calms[i] == CALM - 1
            ):  # a step that is kept may be the first of a steady filter
                innovation_covariance(P, H[i], R[t], row, Ss[i])
            if whole:
                copy_matrix(Ss[i], S_kept[i, t])
                for c in range(m):
                    y_kept[i, t, c] = dot(H[i, c], x) + dot(F[i, c], known_end[t])
                    for k in range(d):
                        slope[c, k] = 0.0
                    add_rows(H[i, c], V, d, slope[c])
                    for k in range(d):
                        slope_kept[i, t, c, k] = sensed[c, k] - slope[c, k]
            for c in range(m):
                whitened[c] = 0.0
                if np.isnan(y[t, c]):
                    continue
                if not steady:
                    S[c] = update_covariance(P, H[i, c], R[t, c] + more[c], K[c], row, row2)
                innovation = y[t, c] - dot(F[i, c], known_end[t]) - dot(H[i, c], x)
                for a in range(n):
                    x[a] += K[c, a] * innovation
                whitened[c] = innovation / np.sqrt(S[c])
                fits[i, t] -= 0.5 * np.log(2 * np.pi * S[c])
            fits[i, t] += update_considered(
                V, H[i], sensed, K, S, channels, whitened, nus[i], lefts[i], slope, gain, small
            )
            if len(less):
                fits[i, t] += remove_bias(less[i, t], nus[i], lefts[i])
            if not steady:
                mirror(P)
                calms[i] = calms[i] + 1 if complete and is_steady(P, before, row) else 0
            if len(xcs):
                move_considered(xcs[i], xcs[i], fixed, V_c, pairs[i], augmented[i], *slopes, known[t], behind)
                predict_mean(xcs[i], pairs[i], augmented[i], G[i], known[t], row)
                predict_covariance(Pcs[i], pairs[i], augmented[i], Q[i], work)
                to_states(basis[i], xcs[i], physical)
                sense(physical, D, E, offset, acts, known_end[t], sensed)
                schmidt_update(xcs[i], Pcs[i], V_c, H[i], F[i], known_end[t], y[t], R[t], sensed)
            if whole:
                if len(xcs):
                    keep_state(xcs[i], Pcs[i], V_c, x_kept[i, t], P_kept[i, t], V_kept[i, t])
                else:
                    keep_state(x, P, V, x_kept[i, t], P_kept[i, t], V_kept[i, t])
            if keeps:
                copy(nus[i], nu_kept[i, t])
                copy_matrix(lefts[i], left_kept[i, t])
        transpose(V, Vs[i])
        if len(xcs):
            transpose(V_c, Vcs[i])


@loop
def keep_state(x, P, V, x_kept, P_kept, V_kept):  # type: ignore[no-untyped-def]
    copy(x, x_kept)
    copy_matrix(P, P_kept)
    transpose(V, V_kept)
