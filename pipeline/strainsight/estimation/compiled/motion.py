"""Prediction: the mean, its covariance, and what constants ν add to the error."""

from __future__ import annotations

from strainsight.estimation.compiled.vectors import add_rows, dot, loop, mirrored


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
        x[a] = ahead[a]


@loop
def moved_nuisances(x, V, pairs, beside, pairs_nu, beside_nu, G_nu, w, moved):  # type: ignore[no-untyped-def]
    """V ← A V − (A_ν x + G_ν w), x before it has moved."""
    d, n = V.shape
    for k in range(d):
        for a in range(n):
            moved[a] = 0.0
        add_moved(1.0, V[k], pairs, beside, moved)
        if k < len(pairs_nu):
            add_moved(-1.0, x, pairs_nu[k], beside_nu[k], moved)
            for a in range(n):
                moved[a] -= dot(G_nu[k, a], w)
        for a in range(n):
            V[k, a] = moved[a]


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
    mirrored(P)


@loop
def in_states(basis, z, out):  # type: ignore[no-untyped-def]
    """x = T z."""
    for a in range(len(z)):
        out[a] = dot(basis[a], z)


@loop
def corrected(x, V, nu, about, out):  # type: ignore[no-untyped-def]
    """x less what ν makes of it; ν that is counted from elsewhere than zero has its slopes there."""
    for a in range(len(x)):
        out[a] = x[a]
    for k in range(len(nu)):
        if about[k] == 0.0:
            for a in range(len(x)):
                out[a] -= V[k, a] * nu[k]
