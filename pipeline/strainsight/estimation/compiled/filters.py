"""The steps of filters side by side, of each its own model."""

from __future__ import annotations

import numpy as np

from strainsight.compiled import kept
from strainsight.estimation.compiled.motion import corrected, in_states, moved_mean, moved_nuisances, predicted
from strainsight.estimation.compiled.nuisances import considered, updated_nuisances, without
from strainsight.estimation.compiled.readings import innovation_covariance, sense, sense_beyond, updated
from strainsight.estimation.compiled.vectors import (
    LOOPS,
    add_rows,
    apart,
    copied,
    copied_matrix,
    dot,
    loop,
    measured,
    mirrored,
    transposed,
    unmoved,
)

CALM = 20
"""A covariance is steady after so many steps in which it did not move (`unmoved`)."""
FILES = tuple(f"estimation/compiled/{name}.py" for name in ("motion", "nuisances", "readings", "vectors"))


@kept(*FILES, **LOOPS)
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
    whitened, small, likely, seen = np.empty(m), np.empty((m + 2, m)), np.empty(n), np.empty(n)
    sensed, slope, gain, behind = np.empty((m, d)), np.empty((m, d)), np.empty((m, d)), np.empty((beside.shape[1], d))
    V, V_c, free = np.empty((n, d)), np.empty((n, d)), np.empty(d)
    f, ahead_of_loads = len(U), len(pairs_nu[0]) - len(U)
    z = np.empty(f)
    for i in span:
        x, P, K, S = xs[i], Ps[i], gains[i], variances[i]
        transposed(Vs[i], V)
        if len(xcs):
            transposed(Vcs[i], V_c)
        for t in range(len(y)):
            there = measured(y[t])
            complete = len(there) == m
            if not complete or (t > 0 and apart(R[t], R[t - 1]) > 0):
                calms[i] = 0
            steady = calms[i] >= CALM
            for k in range(d):  # ν that is counted from elsewhere than zero has its slopes there
                free[k] = nus[i, k] if about[k] == 0.0 else 0.0
            corrected(x, V, free, likely)
            moved_nuisances(likely, V, pairs[i], beside[i], pairs_nu[i], beside_nu[i], G_nu[i], known[t], behind)
            moved_mean(x, pairs[i], beside[i], G[i], known[t], row)
            if not steady:
                copied_matrix(P, before)
                predicted(P, pairs[i], beside[i], Q[i], work)
            corrected(x, V, free, likely)
            in_states(basis[i], likely, seen)
            sense(seen, D, E, offset, acts, known_end[t], sensed)
            for j in range(f):
                z[j] = nus[i, ahead_of_loads + j] * (dot(U[j], seen) + dot(W[j], known_end[t]))
            sense_beyond(z, B, sensed)
            if not steady and (
                whole or calms[i] == CALM - 1
            ):  # a step that is kept may be the first of a steady filter
                innovation_covariance(P, H[i], R[t], row, Ss[i])
            if whole:
                copied_matrix(Ss[i], S_kept[i, t])
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
                    S[c] = updated(P, H[i, c], R[t, c] + more[c], K[c], row, row2, work)
                innovation = y[t, c] - dot(F[i, c], known_end[t]) - dot(H[i, c], x)
                for a in range(n):
                    x[a] += K[c, a] * innovation
                whitened[c] = innovation / np.sqrt(S[c])
                fits[i, t] -= 0.5 * np.log(2 * np.pi * S[c])
            fits[i, t] += updated_nuisances(
                V, H[i], sensed, K, S, there, whitened, nus[i], lefts[i], slope, gain, small
            )
            if len(less):
                fits[i, t] += without(less[t], nus[i], lefts[i])
            if not steady:
                mirrored(P)
                calms[i] = calms[i] + 1 if complete and unmoved(P, before, row) else 0
            if len(xcs):
                moved_nuisances(xcs[i], V_c, pairs[i], beside[i], pairs_nu[i], beside_nu[i], G_nu[i], known[t], behind)
                moved_mean(xcs[i], pairs[i], beside[i], G[i], known[t], row)
                predicted(Pcs[i], pairs[i], beside[i], Q[i], work)
                in_states(basis[i], xcs[i], seen)
                sense(seen, D, E, offset, acts, known_end[t], sensed)
                considered(xcs[i], Pcs[i], V_c, H[i], F[i], known_end[t], y[t], R[t], sensed)
            if whole:
                if len(xcs):
                    keep_state(xcs[i], Pcs[i], V_c, x_kept[i, t], P_kept[i, t], V_kept[i, t])
                else:
                    keep_state(x, P, V, x_kept[i, t], P_kept[i, t], V_kept[i, t])
            if keeps:
                copied(nus[i], nu_kept[i, t])
                copied_matrix(lefts[i], left_kept[i, t])
        transposed(V, Vs[i])
        if len(xcs):
            transposed(V_c, Vcs[i])


@loop
def keep_state(x, P, V, x_kept, P_kept, V_kept):  # type: ignore[no-untyped-def]
    copied(x, x_kept)
    copied_matrix(P, P_kept)
    transposed(V, V_kept)
