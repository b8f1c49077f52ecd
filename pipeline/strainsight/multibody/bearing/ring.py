"""Loads, tangents and slopes of all balls on the rings: the inner loops."""

from __future__ import annotations

import math

import numpy as np

from strainsight.compiled import carray, inner, joined, kept
from strainsight.multibody.bearing.balls import ball_centre, floors, groove_centres, potential

NEAR, ROUNDS = 3e-8, 3
"""Unbalanced force, relative to all forces on a ball, from which one linear correction is exact; most corrections of a ball that
is tracked from another displacement of the ring."""
LANES = 16
"""Balls that are evaluated together, by vector instructions."""
BALLS = "multibody/bearing/balls.py"
KEPT = 8
"""Values stored by `ring_law` for a ball: its centre, and its slope with the ring. Six precede them: whether they exist, and the
displacement."""
STATE, CENTRE, SLOPE, LOAD, STIFF, ROWS = 0, 32, 34, 40, 43, 49
"""First rows of the work array of LANES balls: `contact_state` (32), p (2), X (6), load (3) and stiffness (6) in u, w, τ."""


@kept(BALLS)
def ring_load(
    table: np.ndarray,
    centrifugal: np.ndarray,
    radius: float,
    ball: float,
    turns: np.ndarray,
    q: np.ndarray,
    memory: np.ndarray,
    with_slopes: bool,
    force: np.ndarray,
    tangent: np.ndarray,
    slopes: np.ndarray,
) -> tuple[float, int, float]:
    """Energy, load of the inner ring, its tangent and its slopes in θ, summed over the balls.

        F = Σ T_kᵀ f_k,   ∂F/∂q = Σ_balls [Σ_inner T_kᵀ H_k T_k − Sᵀ X],   S = Σ_inner H_k T_k,   H = Σ H_k,   X = H⁻¹ S
                                = Σ_balls [Σ_inner (T_k − X)ᵀ H_k (T_k − X) + Xᵀ (Σ_outer H_k) X]
        ∂F/∂θ = Σ_balls Σ_inner [T_kᵀ (g_k − H_k p') + T_k'ᵀ f_k],   p' = H⁻¹ (Σ_k g_k + F_c' e_ρ)
        f_k = Q_k n_k,   g_k = H_k c_k' + n_k (K_k' δ^1.5 − 1.5 K_k √δ L_k')  at rest p,   ' = ∂/∂θ

    X is how the ball follows the ring; in the second form nothing cancels. T_k = A_k B(φ): A_k (2, 3) of `groove_centres`,
    B (3, 5) from q to (u, w, τ). Fills force (5,), tangent (5, 5) and slopes (5, 6), given as zeros; turns (z, 2): cos φ, sin φ.
    memory (0,), or (6 + KEPT z,) of another displacement nearby, whose balls are followed to here and kept: it saves most of the
    work, and the energy is not computed. Returns the energy [J], the ball that did not settle (−1: none), and its excess as in
    `ball_centre`."""
    soft, loose = floors(table, ball)
    push, z = centrifugal[0], len(turns)
    c, state = np.empty((4, 2)), np.empty((4, 8))
    A, X, G, v = np.zeros((2, 2, 3)), np.empty((2, 3)), np.empty((3, 6)), np.empty((2, 6))
    W, sums = np.empty((ROWS, LANES)), np.zeros((20, LANES))
    angle, settled = np.empty((2, LANES)), np.empty(LANES)
    for k in range(2):
        A[k, 0, 0] = A[k, 1, 1] = 1.0
        A[k, 0, 2], A[k, 1, 2] = radius + table[k, 1], -table[k, 0]
    energy, keeps = 0.0, len(memory) > 0
    following = keeps and memory[0] == 1.0
    if keeps:
        memory[0] = 0.0
    for begin in range(0, z, LANES):
        n = min(LANES, z - begin)
        for i in range(n):
            angle[0, i], angle[1, i], settled[i] = turns[begin + i, 0], turns[begin + i, 1], 0.0
        if following:
            predict(memory, z, begin, n, q, angle, W)
        rounds, good = ROUNDS if following else 0, 0
        while good < n:
            if rounds == 0:
                # not tracked, or lost
                for i in range(n):
                    if settled[i] < 1.0:
                        cos, sin = angle[0, i], angle[1, i]
                        tau = sin * q[3] - cos * q[4]
                        groove_centres(table, radius, q[0], cos * q[1] + sin * q[2], tau, c)
                        px, pr, excess = ball_centre(table, c, push, soft, loose, state)
                        if not excess <= 1:
                            return energy, begin + i, excess
                        if not keeps:
                            energy += potential(table, c, push, soft, px, pr)
                        W[CENTRE, i], W[CENTRE + 1, i], settled[i] = px, pr, 2.0
            good, tracked = evaluate_contacts(table, radius, q, angle, push, soft, loose, n, settled, W)
            rounds = rounds - 1 if tracked > 0 else 0
        evaluate_stiffness(A, soft, n, W)
        add_balls(angle, n, W, sums)
        if keeps:
            for j in range(KEPT):
                for i in range(n):
                    memory[6 + j * z + begin + i] = W[CENTRE + j, i]
        for i in range(n if with_slopes else 0):
            for k in range(4):
                for j in range(8):
                    state[k, j] = W[8 * k + j, i]
            for m in range(3):
                X[0, m], X[1, m] = W[SLOPE + m, i], W[SLOPE + 3 + m, i]
            cos, sin = angle[0, i], angle[1, i]
            ball_slopes(table, centrifugal[1], sin * q[3] - cos * q[4], A, state, X, G, v)
            for j in range(6):
                slopes[0, j] += G[0, j]
                slopes[1, j] += cos * G[1, j]
                slopes[2, j] += sin * G[1, j]
                slopes[3, j] += sin * G[2, j]
                slopes[4, j] -= cos * G[2, j]
    add_lanes(sums, force, tangent)
    if keeps:
        memory[0] = 1.0
        for m in range(5):
            memory[1 + m] = q[m]
    return energy, -1, 0.0


@joined
def predict(memory: np.ndarray, z: int, begin: int, n: int, q: np.ndarray, angle: np.ndarray, W: np.ndarray) -> None:
    """p of n balls from where they were, p + X Δ(u, w, τ)."""
    du, d1, d2, d3, d4 = q[0] - memory[1], q[1] - memory[2], q[2] - memory[3], q[3] - memory[4], q[4] - memory[5]
    for a in range(2):
        at, by = 6 + a * z + begin, 6 + (2 + 3 * a) * z + begin
        for i in range(n):
            dw, dt = angle[0, i] * d1 + angle[1, i] * d2, angle[1, i] * d3 - angle[0, i] * d4
            W[CENTRE + a, i] = (
                memory[at + i] + memory[by + i] * du + memory[by + z + i] * dw + memory[by + 2 * z + i] * dt
            )


@joined
def evaluate_contacts(
    table: np.ndarray, radius: float, q: np.ndarray, angle: np.ndarray, push: float, soft: float, loose: float, n: int,
    settled: np.ndarray, W: np.ndarray,
) -> tuple[int, int]:  # fmt: skip
    """`contact_state` of n balls at p, and a Newton step of p unless settled = 2, which is applied to the forces to first order.
    Returns how many are in equilibrium (settled ≥ 1: held by two grooves, small step), and how many still move (0; −1: loose)."""
    for k in range(4):
        x, rho, length, stiff, first = table[k, 0], table[k, 1], table[k, 2], table[k, 3], 8 * k
        moves = 1.0 if k < 2 else 0.0
        for i in range(n):
            w, tau = angle[0, i] * q[1] + angle[1, i] * q[2], angle[1, i] * q[3] - angle[0, i] * q[4]
            dx = x + moves * (q[0] + (radius + rho) * tau) - W[CENTRE, i]
            dr = rho + moves * (w - x * tau) - W[CENTRE + 1, i]
            d = math.sqrt(dx * dx + dr * dr)
            approach = d - length if d > length else 0.0
            root, per = math.sqrt(approach), 1.0 / d
            steep, Q = 1.5 * stiff * root, stiff * approach * root
            nx, nr, across = dx * per, dr * per, Q * per
            W[first, i], W[first + 1, i] = Q * nx, Q * nr
            W[first + 2, i] = (steep - across) * nx * nx + across
            W[first + 3, i] = (steep - across) * nx * nr
            W[first + 4, i] = (steep - across) * nr * nr + across
            W[first + 5, i], W[first + 6, i], W[first + 7, i] = root, nx, nr
    for i in range(n):
        gx, gr = soft * W[CENTRE, i] - W[0, i] - W[8, i] - W[16, i] - W[24, i], soft * W[CENTRE + 1, i] - push
        gr = gr - W[1, i] - W[9, i] - W[17, i] - W[25, i]
        a = soft + W[2, i] + W[10, i] + W[18, i] + W[26, i]
        b = W[3, i] + W[11, i] + W[19, i] + W[27, i]
        e = soft + W[4, i] + W[12, i] + W[20, i] + W[28, i]
        total, rounding, touching = 0.0, 0.0, 0.0
        for k in range(4):
            Q = W[8 * k, i] * W[8 * k + 6, i] + W[8 * k + 1, i] * W[8 * k + 7, i]
            root = W[8 * k + 5, i]
            total += Q
            rounding += 2.3e-16 * 1.5 * table[k, 3] * root * (table[k, 2] + root * root)
            touching += 1.0 if root > 0.0 else 0.0
        tolerance = NEAR * total + 8 * rounding + loose
        now = 1.0 if gx * gx + gr * gr <= tolerance * tolerance else 0.0
        now = now if touching >= 2.0 and total > 1e3 * loose else -1.0
        share = (0.0 if settled[i] == 2.0 else 1.0) / (a * e - b * b)
        sx, sr = -share * (e * gx - b * gr), -share * (a * gr - b * gx)
        W[CENTRE, i] += sx
        W[CENTRE + 1, i] += sr
        settled[i] = settled[i] if settled[i] >= 1.0 else now
        for k in range(2):
            W[8 * k, i] -= W[8 * k + 2, i] * sx + W[8 * k + 3, i] * sr
            W[8 * k + 1, i] -= W[8 * k + 3, i] * sx + W[8 * k + 4, i] * sr
    good = tracked = 0
    for i in range(n):
        good += 1 if settled[i] >= 1.0 else 0
        tracked += 1 if settled[i] == 0.0 else 0
    return good, tracked


@joined
def evaluate_stiffness(A: np.ndarray, soft: float, n: int, W: np.ndarray) -> None:
    """X, load and stiffness of n balls in (u, w, τ) from the state of their contacts."""
    a0, b0, a1, b1 = A[0, 0, 2], A[0, 1, 2], A[1, 0, 2], A[1, 1, 2]
    for i in range(n):
        xx, xr, rr = W[2, i] + W[10, i], W[3, i] + W[11, i], W[4, i] + W[12, i]
        ox, oxr, orr = soft + W[18, i] + W[26, i], W[19, i] + W[27, i], soft + W[20, i] + W[28, i]
        hxx, hxr, hrr = xx + ox, xr + oxr, rr + orr
        per = 1.0 / (hxx * hrr - hxr * hxr)
        sx = W[2, i] * a0 + W[3, i] * b0 + W[10, i] * a1 + W[11, i] * b1
        sr = W[3, i] * a0 + W[4, i] * b0 + W[11, i] * a1 + W[12, i] * b1
        W[SLOPE, i], W[SLOPE + 3, i] = per * (hrr * xx - hxr * xr), per * (hxx * xr - hxr * xx)
        W[SLOPE + 1, i], W[SLOPE + 4, i] = per * (hrr * xr - hxr * rr), per * (hxx * rr - hxr * xr)
        W[SLOPE + 2, i], W[SLOPE + 5, i] = per * (hrr * sx - hxr * sr), per * (hxx * sr - hxr * sx)
        W[LOAD, i], W[LOAD + 1, i] = W[0, i] + W[8, i], W[1, i] + W[9, i]
        W[LOAD + 2, i] = a0 * W[0, i] + b0 * W[1, i] + a1 * W[8, i] + b1 * W[9, i]
    for row in range(3):
        for column in range(row, 3):
            at = STIFF + row * (5 - row) // 2 + column
            for i in range(n):
                W[at, i] = 0.0
            for k in range(3):
                for i in range(n):
                    # of T_k − X for the inner contacts, of X for both outer ones
                    x0, x1 = W[SLOPE + row, i], W[SLOPE + 3 + row, i]
                    y0, y1 = W[SLOPE + column, i], W[SLOPE + 3 + column, i]
                    if k < 2:
                        h0, h1, h2 = W[8 * k + 2, i], W[8 * k + 3, i], W[8 * k + 4, i]
                        x0, x1, y0, y1 = (
                            A[k, 0, row] - x0,
                            A[k, 1, row] - x1,
                            A[k, 0, column] - y0,
                            A[k, 1, column] - y1,
                        )
                    else:
                        h0, h1, h2 = soft + W[18, i] + W[26, i], W[19, i] + W[27, i], soft + W[20, i] + W[28, i]
                    W[at, i] += (h0 * x0 + h1 * x1) * y0 + (h1 * x0 + h2 * x1) * y1


@joined
def add_balls(angle: np.ndarray, n: int, W: np.ndarray, sums: np.ndarray) -> None:
    """Of every lane, load and upper triangle of the tangent:  sums[:5] += Bᵀ load,  sums[5:] += Bᵀ stiffness B,
    B = [1 0 0 0 0; 0 cos sin 0 0; 0 0 0 sin −cos]."""
    B, row, to = np.empty((5, LANES)), (0, 1, 1, 2, 2), 5
    for i in range(n):
        cos, sin = angle[0, i], angle[1, i]
        B[0, i], B[1, i], B[2, i], B[3, i], B[4, i] = 1.0, cos, sin, sin, -cos
    for m in range(5):
        at = row[m]
        for i in range(n):
            sums[m, i] += B[m, i] * W[LOAD + at, i]
        for o in range(m, 5):
            on = STIFF + at * (5 - at) // 2 + row[o]
            for i in range(n):
                sums[to, i] += B[m, i] * B[o, i] * W[on, i]
            to += 1


@joined
def add_lanes(sums: np.ndarray, force: np.ndarray, tangent: np.ndarray) -> None:
    """force (5,) and tangent (5, 5) += `sums` of all lanes."""
    to = 5
    for m in range(5):
        for i in range(LANES):
            force[m] += sums[m, i]
        for o in range(m, 5):
            for i in range(LANES):
                tangent[m, o] += sums[to, i]
            tangent[o, m] = tangent[m, o]
            to += 1


@inner
def ball_slopes(
    table: np.ndarray,
    push_slope: float,
    tau: float,
    A: np.ndarray,
    state: np.ndarray,
    X: np.ndarray,
    G: np.ndarray,
    v: np.ndarray,
) -> None:
    """G (3, 6) = ∂(load in u, w, τ)/∂θ of one ball, as in `ring_load`; X (2, 3) = H⁻¹ S; v (2, 6) is scratch."""
    G[:] = 0.0
    v[:] = 0.0
    v[1, 0] = push_slope
    for k in range(4):
        if state[k, 5] == 0.0:
            continue
        root = state[k, 5]
        steep = 1.5 * table[k, 3] * root
        for kind in range(3):
            if kind == 0:
                j, dK, dL = 0, table[k, 4], -0.5
            elif kind == 1:
                j, dK, dL = 1 + k, table[k, 5], 1.0
            else:
                j, dK, dL = 5, 0.0, -1.0
            dx = dr = 0.0
            if kind < 2:
                dx, dr = table[k, 6 + kind], table[k, 8 + kind]
            cx, cr = dx, dr
            if k < 2:
                cx, cr = dx + tau * dr, dr - tau * dx
            normal = dK * root * root * root - steep * dL
            gx = state[k, 2] * cx + state[k, 3] * cr + normal * state[k, 6]
            gr = state[k, 3] * cx + state[k, 4] * cr + normal * state[k, 7]
            v[0, j] += gx
            v[1, j] += gr
            if k < 2:
                G[0, j] += gx
                G[1, j] += gr
                G[2, j] += A[k, 0, 2] * gx + A[k, 1, 2] * gr + dr * state[k, 0] - dx * state[k, 1]
    for m in range(3):
        for j in range(6):
            G[m, j] -= X[0, m] * v[0, j] + X[1, m] * v[1, j]


def ring_law(k, p, numbers, memory, rho, rate, theta, F, F_rho, F_rate, F_theta):  # type: ignore[no-untyped-def]
    """The bearing as a compiled force law (`multibody/forces.py`); numbers: the table (40), centrifugal (2), pitch radius, ball
    diameter, balls z, cos φ and sin φ of every ball, places of the parameters among PARAMETERS."""
    z = int(carray(numbers, 45)[44])
    law = carray(numbers, 45 + 2 * z + p)
    table, turns = law[:40].reshape((4, 10)), law[45 : 45 + 2 * z].reshape((z, 2))
    q, slopes = carray(rho, 5), np.zeros((5, 6))
    if not np.isfinite(q.sum()):
        return 0
    _, ball, _ = ring_load(
        table, law[40:42], law[42], law[43], turns, q, carray(memory, 6 + KEPT * z), p > 0, carray(F, 5),
        carray(F_rho, (5, 5)), slopes,
    )  # fmt: skip
    if ball >= 0:
        return 0
    by = carray(F_theta, (5, p))
    for j in range(p):
        for i in range(5):
            by[i, j] = slopes[i, int(law[45 + 2 * z + j])]
    return 1
