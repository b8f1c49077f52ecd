"""The linear system of one Newton iteration in minimal coordinates: assembled, eliminated, solved."""

from __future__ import annotations

import numpy as np

from strainsight.compiled import inner
from strainsight.multibody.compiled.arrays import Sparsity, StateChange, Terms

TINY = float(np.finfo(float).tiny)


@inner
def scale_terms(s: Sparsity, h: float, terms: Terms) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """X̂ = h D⁻¹X D⁻¹, Â = h D⁻¹A D⁻¹ (in X and A); the matrix Z of

        D²(y/h − ζ) + … = X y − D²ζ + Jᵀμ = r₁,     K y + A ζ − Jᵀλ = r₂,     J_r y + J ζ = r₃,     J y = r₄

    without ζ, its unknowns at their places; Ĵ = S J D⁻¹ of unit rows, and S; D = dt, x = D y, μ = S μ̂/h, λ = S λ̂/h²:

        D h ζ = X̂ x + Ĵᵀμ̂ − r̂₁

        [h²D⁻¹K D⁻¹ + ÂX̂   ÂĴᵀ   −Ĵᵀ]
        [h S J_r D⁻¹ + ĴX̂   ĴĴᵀ    0 ]
        [Ĵ                   0      0 ]
    """
    nt, m, count = len(s.dt), s.joints, len(s.body)
    g, gr, X, A, K = terms.g, terms.gr, terms.X, terms.A, terms.K
    Z = np.zeros((nt + 2 * m, nt + 2 * m))
    J, S = np.zeros((m, nt)), np.empty(m)
    down = 1.0 / s.dt
    for b in range(count):
        for i in range(s.body[b, 2], s.body[b, 2] + s.body[b, 5]):
            scale = h * down[i]
            for n in range(s.tied.shape[1]):
                c = s.tied[b, n]
                if c >= 0:
                    for j in range(s.body[c, 2], s.body[c, 2] + s.body[c, 5]):
                        X[i, j] *= scale * down[j]
            for n in range(s.pushed.shape[1]):
                c = s.pushed[b, n]
                if c >= 0:
                    for j in range(s.body[c, 2], s.body[c, 2] + s.body[c, 5]):
                        A[i, j] *= scale * down[j]
    for r in range(m):
        squares = 0.0
        for f in range(4):
            b = s.feels[r, f]
            if b >= 0:
                for j in range(s.body[b, 2], s.body[b, 2] + s.body[b, 5]):
                    J[r, j] = g[r, j] * down[j]
                    squares += J[r, j] ** 2
        S[r] = 1 / np.sqrt(max(squares, TINY))
        for f in range(4):
            b = s.feels[r, f]
            if b >= 0:
                for j in range(s.body[b, 2], s.body[b, 2] + s.body[b, 5]):
                    J[r, j] *= S[r]
    row = np.empty(nt)
    for b in range(count):
        for i in range(s.body[b, 2], s.body[b, 2] + s.body[b, 5]):
            to, scale = s.place[i], h * h * down[i]
            # every body that the row reaches once: first those of Â, then what X̂ and the stiffness of joints add
            for n in range(s.reached.shape[1]):
                c = s.reached[b, n]
                if c >= 0:
                    for j in range(s.body[c, 2], s.body[c, 2] + s.body[c, 5]):
                        row[j] = scale * K[i, j] * down[j]
            for n in range(s.pushed.shape[1]):
                c = s.pushed[b, n]
                if c < 0:
                    continue
                for k in range(s.body[c, 2], s.body[c, 2] + s.body[c, 5]):
                    value = A[i, k]
                    if value == 0.0:
                        continue
                    for t in range(s.tied.shape[1]):
                        e = s.tied[c, t]
                        if e >= 0:
                            for j in range(s.body[e, 2], s.body[e, 2] + s.body[e, 5]):
                                row[j] += value * X[k, j]
                for t in range(s.joint_rows.shape[1]):
                    r = s.joint_rows[c, t]
                    if r >= 0:
                        value = 0.0
                        for k in range(s.body[c, 2], s.body[c, 2] + s.body[c, 5]):
                            value += A[i, k] * J[r, k]
                        Z[to, s.place[nt + r]] += value
            for n in range(s.reached.shape[1]):
                c = s.reached[b, n]
                if c >= 0:
                    for j in range(s.body[c, 2], s.body[c, 2] + s.body[c, 5]):
                        Z[to, s.place[j]] = row[j]
    for r in range(m):
        mu, lam = s.place[nt + r], s.place[nt + m + r]
        for f in range(4):
            b = s.feels[r, f]
            if b < 0:
                continue
            begin, end = s.body[b, 2], s.body[b, 2] + s.body[b, 5]
            for j in range(begin, end):
                Z[s.place[j], lam] -= J[r, j]
                Z[lam, s.place[j]] += J[r, j]
                Z[mu, s.place[j]] += h * S[r] * gr[r, j] * down[j]
            for t in range(s.tied.shape[1]):
                e = s.tied[b, t]
                if e < 0:
                    continue
                left, right = s.body[e, 2], s.body[e, 2] + s.body[e, 5]
                row[left:right] = 0.0
                for k in range(begin, end):
                    value = J[r, k]
                    if value != 0.0:
                        for j in range(left, right):
                            row[j] += value * X[k, j]
                for j in range(left, right):
                    Z[mu, s.place[j]] += row[j]
            for t in range(s.joint_rows.shape[1]):
                o = s.joint_rows[b, t]
                if o >= 0:
                    value = 0.0
                    for j in range(begin, end):
                        value += J[r, j] * J[o, j]
                    Z[mu, s.place[nt + o]] += value
    return Z, J, S


@inner
def right_side(
    s: Sparsity, h: float, A: np.ndarray, J: np.ndarray, S: np.ndarray, r1: np.ndarray, r2: np.ndarray, r3: np.ndarray,
    r4: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """r̂₁ = h D⁻¹r₁ (nt, k) and the right side (N, k) of Z:  h²D⁻¹r₂ + Âr̂₁,  h S r₃ + Ĵr̂₁,  S r₄  at their places."""
    nt, m, k = len(s.dt), s.joints, r1.shape[1]
    rows, right = np.empty((nt, k)), np.empty((nt + 2 * m, k))
    for i in range(nt):
        for c in range(k):
            rows[i, c] = h / s.dt[i] * r1[i, c]
    for b in range(len(s.body)):
        for i in range(s.body[b, 2], s.body[b, 2] + s.body[b, 5]):
            to = s.place[i]
            for c in range(k):
                right[to, c] = h * h / s.dt[i] * r2[i, c]
            for n in range(s.pushed.shape[1]):
                e = s.pushed[b, n]
                if e >= 0:
                    for j in range(s.body[e, 2], s.body[e, 2] + s.body[e, 5]):
                        value = A[i, j]
                        if value != 0.0:
                            for c in range(k):
                                right[to, c] += value * rows[j, c]
    for r in range(m):
        to = s.place[nt + r]
        for c in range(k):
            right[to, c] = h * S[r] * r3[r, c]
            right[s.place[nt + m + r], c] = S[r] * r4[r, c]
        for f in range(4):
            b = s.feels[r, f]
            if b >= 0:
                for j in range(s.body[b, 2], s.body[b, 2] + s.body[b, 5]):
                    for c in range(k):
                        right[to, c] += J[r, j] * rows[j, c]
    return rows, right


@inner
def factorise(Z: np.ndarray, low: np.ndarray) -> tuple[bool, np.ndarray, np.ndarray]:
    """Z = LU by Gauss with row pivots in the envelope, in place: whether Z is regular, the pivots, the last column of a row.
    low (N,): the last row that a column reaches, not falling; so no row below is looked at, and what is filled stays within.
    As the pattern of Z is that of its transpose, a row reaches no column beyond."""
    N = len(Z)
    pivots, last = np.empty(N, dtype=np.int64), np.empty(N, dtype=np.int64)
    for i in range(N):
        j = low[i]
        while j > i and Z[i, j] == 0.0:
            j -= 1
        last[i] = j
    for j in range(N):
        at, largest = j, abs(Z[j, j])
        for i in range(j + 1, low[j] + 1):
            if abs(Z[i, j]) > largest:
                at, largest = i, abs(Z[i, j])
        if not largest > 0.0:
            return False, pivots, last
        pivots[j] = at
        if at != j:
            for c in range(j, max(last[j], last[at]) + 1):
                Z[j, c], Z[at, c] = Z[at, c], Z[j, c]
            last[j], last[at] = last[at], last[j]
        end, pivot = last[j] + 1, 1.0 / Z[j, j]
        for i in range(j + 1, low[j] + 1):
            if Z[i, j] == 0.0:
                continue
            share = Z[i, j] * pivot
            Z[i, j] = share
            for c in range(j + 1, end):
                Z[i, c] -= share * Z[j, c]
            last[i] = max(last[i], last[j])
    return True, pivots, last


@inner
def substitute(Z: np.ndarray, low: np.ndarray, pivots: np.ndarray, last: np.ndarray, right: np.ndarray) -> None:
    """right ← Z⁻¹ right (N, k) with what `factorise` made of Z."""
    N, k = right.shape
    for j in range(N):
        at = pivots[j]
        for c in range(k):
            value = right[at, c]
            if at != j:
                right[at, c] = right[j, c]
                right[j, c] = value
            if k == 1 and value != 0.0:
                for i in range(j + 1, low[j] + 1):
                    right[i, 0] -= Z[i, j] * value
        for i in range(j + 1, low[j] + 1 if k > 1 else 0):
            share = Z[i, j]
            if share != 0.0:
                for c in range(k):
                    right[i, c] -= share * right[j, c]
    for j in range(N - 1, -1, -1):
        pivot = 1.0 / Z[j, j]
        if k == 1:
            value = right[j, 0]
            for i in range(j + 1, last[j] + 1):
                value -= Z[j, i] * right[i, 0]
            right[j, 0] = value * pivot
            continue
        for i in range(j + 1, last[j] + 1):
            value = Z[j, i]
            if value != 0.0:
                for c in range(k):
                    right[j, c] -= value * right[i, c]
        for c in range(k):
            right[j, c] *= pivot


@inner
def expand_step(
    s: Sparsity, h: float, X: np.ndarray, J: np.ndarray, S: np.ndarray, rows: np.ndarray, z: np.ndarray
) -> StateChange:
    """From the solution z (N, k) of Z."""
    nt, m, k = len(s.dt), s.joints, z.shape[1]
    y, zeta, mu, lam = np.empty((nt, k)), np.empty((nt, k)), np.empty((m, k)), np.empty((m, k))
    for i in range(nt):
        for c in range(k):
            y[i, c] = z[s.place[i], c]
            zeta[i, c] = -rows[i, c]
    for b in range(len(s.body)):
        for i in range(s.body[b, 2], s.body[b, 2] + s.body[b, 5]):
            for n in range(s.tied.shape[1]):
                e = s.tied[b, n]
                if e >= 0:
                    for j in range(s.body[e, 2], s.body[e, 2] + s.body[e, 5]):
                        value = X[i, j]
                        if value != 0.0:
                            for c in range(k):
                                zeta[i, c] += value * y[j, c]
    for r in range(m):
        at, also = s.place[nt + r], s.place[nt + m + r]
        for f in range(4):
            b = s.feels[r, f]
            if b >= 0:
                for j in range(s.body[b, 2], s.body[b, 2] + s.body[b, 5]):
                    for c in range(k):
                        zeta[j, c] += J[r, j] * z[at, c]
        for c in range(k):
            mu[r, c] = z[at, c] * S[r] / h
            lam[r, c] = z[also, c] * S[r] / (h * h)
    for i in range(nt):
        for c in range(k):
            y[i, c] /= s.dt[i]
            zeta[i, c] /= h * s.dt[i]
    return StateChange(y, zeta, mu, lam)
