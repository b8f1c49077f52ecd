"""Prediction: the mean, its covariance, and what constants ν add to the error."""

from __future__ import annotations

from strainsight.estimation.compiled.vectors import add_rows, dot, flushed, loop, mirrored


@loop
def add_moved(sign, x, pairs, beside, out):  # type: ignore[no-untyped-def]
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


@loop
def moved_mean(x, pairs, beside, G, w, ahead):  # type: ignore[no-untyped-def]
    """x ← A x + G w."""
    n = len(x)
    for a in range(n):
        ahead[a] = dot(G[a], w)
    add_moved(1.0, x, pairs, beside, ahead)
    for a in range(n):
        x[a] = flushed(ahead[a])


@loop
def moved_nuisances(x, V, pairs, beside, pairs_nu, beside_nu, G_nu, w, behind):  # type: ignore[no-untyped-def]
    """V ← A V − (A_ν x + G_ν w), x before it has moved; V (n, d), a row a state, as ν are many; behind (s, d): work space."""
    n, d = V.shape
    q, s = pairs.shape[1], len(beside)
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
        add_rows(beside[:, a], behind, d, V[a])
        for k in range(d):
            V[a, k] = flushed(V[a, k])
    for k in range(len(pairs_nu)):
        for a in range(q):
            V[a, k] -= pairs_nu[k, 0, a] * x[a] + pairs_nu[k, 1, a] * x[q + a]
            V[q + a, k] -= pairs_nu[k, 2, a] * x[a] + pairs_nu[k, 3, a] * x[q + a]
        for a in range(n):
            for b in range(s):
                V[a, k] -= beside_nu[k, b, a] * x[2 * q + b]
            V[a, k] -= dot(G_nu[k, a], w)


@loop
def predicted(P, pairs, beside, Q, half):  # type: ignore[no-untyped-def]
    """P ← A P Aᵀ + Q, symmetric; half: P Aᵀ."""
    n, q = len(P), pairs.shape[1]
    for a in range(n):
        for b in range(n):
            half[a, b] = 0.0
        add_moved(1.0, P[a], pairs, beside, half[a])
    for a in range(n):
        for b in range(a + 1):
            P[a, b] = Q[a, b]
        if a < 2 * q:
            k, first = a % q, 2 * (a // q)
            own, rate = pairs[first, k], pairs[first + 1, k]
            for b in range(a + 1):
                P[a, b] += own * half[k, b] + rate * half[q + k, b]
        add_rows(beside[:, a], half[2 * q :], a + 1, P[a])
        for b in range(a + 1):
            P[a, b] = flushed(P[a, b])
    mirrored(P)


@loop
def in_states(basis, z, out):  # type: ignore[no-untyped-def]
    """x = T z."""
    for a in range(len(z)):
        out[a] = dot(basis[a], z)


@loop
def corrected(x, V, nu, out):  # type: ignore[no-untyped-def]
    """x less what ν makes of it."""
    for a in range(len(x)):
        out[a] = x[a] - dot(V[a], nu)
