"""What samples read, and an update by one channel after the other."""

from __future__ import annotations

from strainsight.estimation.compiled.vectors import dot, loop, product


@loop
def sense(x, D, E, offset, acts, w, out):  # type: ignore[no-untyped-def]
    """What one of every ν adds to the readings of the predicted motion; nothing where it does not act."""
    for k in range(len(D)):
        for c in range(D.shape[1]):
            out[c, k] = offset[k, c]
            if acts[k, c]:
                out[c, k] += dot(D[k, c], x) + dot(E[k, c], w)


@loop
def sense_beyond(z, B, out):  # type: ignore[no-untyped-def]
    """What it adds to them of what loads displace beyond the coordinates."""
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


@loop
def updated(P, h, r, k, Ph, Th, T):  # type: ignore[no-untyped-def]
    """P ← (I − k hᵀ) P (I − h kᵀ) + k r kᵀ, Joseph's form, symmetric but for rounding, with k ← P h/s; returns
    s = hᵀP h + r."""
    n = len(h)
    product(P, h, Ph)
    s = r + dot(h, Ph)
    for a in range(n):
        k[a] = Ph[a] / s
    for a in range(n):
        for b in range(n):
            T[a, b] = P[a, b] - k[a] * Ph[b]
        Th[a] = dot(T[a], h)
    for a in range(n):
        gone = Th[a] - r * k[a]
        for b in range(n):
            P[a, b] = T[a, b] - gone * k[b]
    return s
