"""Products, copies and solutions of small arrays. Plain loops that numba compiles: they take the same steps on every
processor, and a step of twenty-odd states in microseconds. A slice that is assigned to would take seconds to compile, as
numba makes a message of the shapes that do not fit."""

from __future__ import annotations

from typing import Any

import numpy as np

from strainsight.compiled import inner

LOOPS: dict[str, Any] = {"nogil": True, "fastmath": {"contract", "reassoc"}}
NEGLIGIBLE = 1e-140
"""What decays to less is zero: products of numbers near the least that a processor can hold take it a hundred times as long."""
UNMOVED = 1e-13
"""Of its standard deviations: an entry of a covariance that moves by less is at rest."""


def loop(function: Any) -> Any:
    """What compiled loops of this room alone call."""
    return inner(function, **LOOPS)


@loop
def copy(a, out):  # type: ignore[no-untyped-def]
    """out ← a, of one dimension."""
    for j in range(len(a)):
        out[j] = a[j]


@loop
def copy_matrix(A, out):  # type: ignore[no-untyped-def]
    for i in range(len(A)):
        for j in range(A.shape[1]):
            out[i, j] = A[i, j]


@loop
def transpose(A, out):  # type: ignore[no-untyped-def]
    for i in range(len(A)):
        for j in range(A.shape[1]):
            out[j, i] = A[i, j]


@loop
def measured_channels(y):  # type: ignore[no-untyped-def]
    """Places in y that are no NaN."""
    places, m = np.empty(len(y), np.int64), 0
    for c in range(len(y)):
        if not np.isnan(y[c]):
            places[m] = c
            m += 1
    return places[:m]


@loop
def count_differences(a, b):  # type: ignore[no-untyped-def]
    """In how many places."""
    count = 0
    for j in range(len(a)):
        if a[j] != b[j]:
            count += 1
    return count


@loop
def flush(value):  # type: ignore[no-untyped-def]
    return value if abs(value) > NEGLIGIBLE else 0.0


@loop
def dot(a, b):  # type: ignore[no-untyped-def]
    value = 0.0
    for j in range(len(a)):
        value += a[j] * b[j]
    return value


@loop
def add_rows(h, X, n, out):  # type: ignore[no-untyped-def]
    """out ← out + Σ_b h_b X_b, of the first n columns; four rows at a time, so that out is read and written less often."""
    whole = len(h) - len(h) % 4
    for b in range(0, whole, 4):
        h0, h1, h2, h3 = h[b], h[b + 1], h[b + 2], h[b + 3]
        for a in range(n):
            out[a] += h0 * X[b, a] + h1 * X[b + 1, a] + h2 * X[b + 2, a] + h3 * X[b + 3, a]
    for b in range(whole, len(h)):
        for a in range(n):
            out[a] += h[b] * X[b, a]


@loop
def mirror(P):  # type: ignore[no-untyped-def]
    """The lower half of P above its diagonal."""
    for a in range(len(P)):
        for b in range(a):
            P[b, a] = P[a, b]


@loop
def product(P, h, out):  # type: ignore[no-untyped-def]
    """out ← P h, P symmetric."""
    n = len(h)
    for a in range(n):
        out[a] = 0.0
    add_rows(h, P, n, out)


@loop
def solve(S, B):  # type: ignore[no-untyped-def]
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


@loop
def is_steady(P, before, std):  # type: ignore[no-untyped-def]
    for a in range(len(P)):
        std[a] = np.sqrt(before[a, a])
        for b in range(a + 1):
            if abs(P[a, b] - before[a, b]) > UNMOVED * std[a] * std[b]:
                return False
    return True
