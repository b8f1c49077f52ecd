"""Loads, tangents and slopes of all balls on the rings, and the equilibrium of each ball: the inner loops."""

from __future__ import annotations

import math

import numpy as np

from strainsight.compiled import carray, inner, kept

ITERATIONS = 200
NEAR, FALL = 3e-8, 0.1
"""Unbalanced force, relative to all forces on a ball, from which one linear correction is exact, and its required decrease
before."""
LOOSE = 1e-10
"""Approach, as a share of the ball diameter, below which a contact has no force."""


@inner
def groove_centres(table: np.ndarray, radius: float, u: float, w: float, tau: float, out: np.ndarray) -> None:
    """c_k (4, 2) in the axial plane of one ball; those of the inner ring have moved by  A_k (u, w, τ). A_k = [1 0 R + ρ_k; 0
    1 −x_k];  u axial, w radial displacement [m], τ tilt about the tangent of the pitch circle [rad]."""
    for k in range(4):
        out[k, 0], out[k, 1] = table[k, 0], table[k, 1]
        if k < 2:
            out[k, 0] += u + (radius + table[k, 1]) * tau
            out[k, 1] += w - table[k, 0] * tau


@inner
def pinched(table: np.ndarray, c: np.ndarray) -> tuple[float, float]:
    """Ball centre between the two opposite grooves that are farthest apart: exact if only they touch. On their line, the
    elongation |c_i − c_o| − L_i − L_o is divided as K_i^(−2/3) to K_o^(−2/3)."""
    best, px, pr = -math.inf, 0.0, 0.0
    for i in range(2):
        for o in range(2, 4):
            ex, er = c[i, 0] - c[o, 0], c[i, 1] - c[o, 1]
            distance = math.sqrt(ex * ex + er * er)
            gap = distance - table[i, 2] - table[o, 2]
            if gap > best and distance > 0:
                best = gap
                part = gap / (1 + (table[i, 3] / table[o, 3]) ** (2 / 3))
                share = (table[i, 2] + part) / distance
                px, pr = c[i, 0] - share * ex, c[i, 1] - share * er
    return px, pr


@inner
def potential(table: np.ndarray, c: np.ndarray, push: float, soft: float, px: float, pr: float) -> float:
    """Π(p) = Σ 0.4 K_k δ_k^2.5 − F_c p_ρ + ½ ε |p|²,  δ_k = max(|p − c_k| − L_k, 0)  [J]."""
    total = 0.5 * soft * (px * px + pr * pr) - push * pr
    for k in range(4):
        dx, dr = c[k, 0] - px, c[k, 1] - pr
        approach = math.sqrt(dx * dx + dr * dr) - table[k, 2]
        if approach > 0:
            total += 0.4 * table[k, 3] * approach * approach * math.sqrt(approach)
    return total


@inner
def contact_state(table: np.ndarray, c: np.ndarray, px: float, pr: float, state: np.ndarray) -> tuple[float, float]:
    """Rows (Q n_x, Q n_ρ, H_xx, H_xρ, H_ρρ, √δ, n_x, n_ρ) of the four contacts, (4, 8); zero without contact.

        Q = K δ^1.5,   n = (c − p)/d,   H = 1.5 K √δ n nᵀ + (Q/d)(I − n nᵀ),   d = |c − p|

    Returns Σ Q [N] and what rounding of the distances makes of the forces [N]."""
    total, rounding = 0.0, 0.0
    for k in range(4):
        dx, dr = c[k, 0] - px, c[k, 1] - pr
        d = math.sqrt(dx * dx + dr * dr)
        approach = d - table[k, 2]
        if approach <= 0:
            state[k, :] = 0.0
            continue
        root = math.sqrt(approach)
        steep = 1.5 * table[k, 3] * root
        Q = table[k, 3] * approach * root
        nx, nr, across = dx / d, dr / d, Q / d
        state[k, 0], state[k, 1] = Q * nx, Q * nr
        state[k, 2] = (steep - across) * nx * nx + across
        state[k, 3] = (steep - across) * nx * nr
        state[k, 4] = (steep - across) * nr * nr + across
        state[k, 5], state[k, 6], state[k, 7] = root, nx, nr
        total += Q
        rounding += steep * d
    return total, 2.3e-16 * rounding


@inner
def gradient_and_hessian(
    state: np.ndarray, push: float, soft: float, px: float, pr: float
) -> tuple[float, float, float, float, float, int, int]:
    """∇Π (2) and H = ∇²Π (xx, xρ, ρρ) of `potential` at p from `contact_state`; how many contacts touch, the last of them."""
    gx, gr, a, b, e, touching, only = soft * px, soft * pr - push, soft, 0.0, soft, 0, 0
    for k in range(4):
        if state[k, 5] > 0:
            touching, only = touching + 1, k
        gx -= state[k, 0]
        gr -= state[k, 1]
        a += state[k, 2]
        b += state[k, 3]
        e += state[k, 4]
    return gx, gr, a, b, e, touching, only


@inner
def ball_centre(
    table: np.ndarray, c: np.ndarray, push: float, soft: float, loose: float, state: np.ndarray
) -> tuple[float, float, float]:
    """p = argmin Π(p): the equilibrium of one ball, thesis (1.18); Newton with halved steps on a convex function. push F_c,
    loose [N], soft ε [N/m]; fills `state` (`contact_state`) at p. Returns p [m] and the force that remains unbalanced, as a
    multiple of what is tolerated: above one the ball did not settle."""
    px, pr = pinched(table, c)
    reach = 0.0
    for k in range(4):
        reach = max(reach, math.hypot(c[k, 0] - px, c[k, 1] - pr))
    energy = potential(table, c, push, soft, px, pr)
    excess, before, last = math.inf, math.inf, False
    sx = sr = 0.0
    for _ in range(ITERATIONS):
        total, rounding = contact_state(table, c, px, pr, state)
        gx, gr, a, b, e, touching, only = gradient_and_hessian(state, push, soft, px, pr)
        residual = math.hypot(gx, gr)
        excess = residual / (1e-9 * total + 8 * rounding + loose)
        if last and residual > before:
            px, pr = px - sx, pr - sr
            contact_state(table, c, px, pr, state)
        if last or (residual <= loose and total <= loose):
            return px, pr, min(excess, 1.0) if last else excess
        determinant = a * e - b * b
        sx, sr = -(e * gx - b * gr) / determinant, -(a * gr - b * gx) / determinant
        if excess <= 1:
            # Newton's step from here is exact to round-off, which no comparison of energies could tell
            px, pr, last, before = px + sx, pr + sr, True, residual
            continue
        if push == 0 and touching == 1:
            # nothing holds the ball against one groove: Newton would follow the groove for ever
            clear = 1.001 * state[only, 5] ** 2
            sx, sr = clear * state[only, 6], clear * state[only, 7]
        length = math.hypot(sx, sr)
        step = min(1.0, reach / length)
        slope = gx * sx + gr * sr
        # what rounding of the distances makes of the energy
        slack = 1e-15 * reach * total
        for _ in range(60):
            new = potential(table, c, push, soft, px + step * sx, pr + step * sr)
            if new <= energy + 1e-4 * step * slope + slack:
                break
            step *= 0.5
        px, pr, energy = px + step * sx, pr + step * sr, new
    return px, pr, excess


@inner
def followed(
    table: np.ndarray, c: np.ndarray, push: float, soft: float, loose: float, px: float, pr: float, state: np.ndarray
) -> tuple[bool, float, float]:
    """Full Newton steps from p near the equilibrium of a ball held by two grooves: whether they converged, and p; fills `state`.
    A last correction is applied to the forces to first order."""
    before = math.inf
    for _ in range(4):
        total, rounding = contact_state(table, c, px, pr, state)
        gx, gr, a, b, e, touching, _ = gradient_and_hessian(state, push, soft, px, pr)
        residual = math.hypot(gx, gr)
        if touching < 2 or not residual < FALL * before or total <= 1e3 * loose:
            return False, px, pr
        determinant = a * e - b * b
        sx, sr = -(e * gx - b * gr) / determinant, -(a * gr - b * gx) / determinant
        px, pr = px + sx, pr + sr
        if residual <= NEAR * total + 8 * rounding + loose:
            for k in range(4):
                if state[k, 5] > 0:
                    state[k, 0] -= state[k, 2] * sx + state[k, 3] * sr
                    state[k, 1] -= state[k, 3] * sx + state[k, 4] * sr
            return True, px, pr
        before = residual
    return False, px, pr


@inner
def floors(table: np.ndarray, ball: float) -> tuple[float, float]:
    """Regularisation ε [N/m] of a ball without contact, and the negligible force [N]: far below all relevant values."""
    constant = np.max(table[:, 3])
    return 1e-16 * constant * math.sqrt(ball), constant * (LOOSE * ball) ** 1.5


KEPT = 8
"""Values stored by `ring_law` for a ball: its centre, and its slope with the ring. Six precede them: whether they exist, and the
displacement."""


@kept()
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
    c, state = np.empty((4, 2)), np.empty((4, 8))
    A, S, X, Y = np.zeros((2, 2, 3)), np.empty((2, 3)), np.empty((2, 3)), np.empty((2, 3))
    stiff, f, G, v = np.empty((3, 3)), np.empty(3), np.empty((3, 6)), np.empty((2, 6))
    for k in range(2):
        A[k, 0, 0] = A[k, 1, 1] = 1.0
        A[k, 0, 2], A[k, 1, 2] = radius + table[k, 1], -table[k, 0]
    energy, keeps = 0.0, len(memory) > 0
    following = keeps and memory[0] == 1.0
    du = d1 = d2 = d3 = d4 = 0.0
    if following:
        du, d1, d2, d3, d4 = q[0] - memory[1], q[1] - memory[2], q[2] - memory[3], q[3] - memory[4], q[4] - memory[5]
    for i in range(len(turns)):
        cos, sin = turns[i, 0], turns[i, 1]
        tau, at = sin * q[3] - cos * q[4], 6 + KEPT * i
        groove_centres(table, radius, q[0], cos * q[1] + sin * q[2], tau, c)
        settled, px, pr = False, 0.0, 0.0
        if following:
            dw, dt = cos * d1 + sin * d2, sin * d3 - cos * d4
            px = memory[at] + memory[at + 2] * du + memory[at + 3] * dw + memory[at + 4] * dt
            pr = memory[at + 1] + memory[at + 5] * du + memory[at + 6] * dw + memory[at + 7] * dt
            settled, px, pr = followed(table, c, centrifugal[0], soft, loose, px, pr, state)
        if not settled:
            px, pr, excess = ball_centre(table, c, centrifugal[0], soft, loose, state)
            if not excess <= 1:
                if keeps:
                    memory[0] = 0.0
                return energy, i, excess
        if not keeps:
            energy += potential(table, c, centrifugal[0], soft, px, pr)
        hxx = soft + state[0, 2] + state[1, 2] + state[2, 2] + state[3, 2]
        hxr = state[0, 3] + state[1, 3] + state[2, 3] + state[3, 3]
        hrr = soft + state[0, 4] + state[1, 4] + state[2, 4] + state[3, 4]
        determinant = hxx * hrr - hxr * hxr
        f[:] = 0.0
        S[:] = 0.0
        for k in range(2):
            f[0] += state[k, 0]
            f[1] += state[k, 1]
            f[2] += A[k, 0, 2] * state[k, 0] + A[k, 1, 2] * state[k, 1]
            for m in range(3):
                S[0, m] += state[k, 2] * A[k, 0, m] + state[k, 3] * A[k, 1, m]
                S[1, m] += state[k, 3] * A[k, 0, m] + state[k, 4] * A[k, 1, m]
        for m in range(3):
            X[0, m] = (hrr * S[0, m] - hxr * S[1, m]) / determinant
            X[1, m] = (hxx * S[1, m] - hxr * S[0, m]) / determinant
        if keeps:
            memory[at], memory[at + 1] = px, pr
            for m in range(3):
                memory[at + 2 + m], memory[at + 5 + m] = X[0, m], X[1, m]
        stiff[:] = 0.0
        for k in range(2):
            for m in range(3):
                Y[0, m], Y[1, m] = A[k, 0, m] - X[0, m], A[k, 1, m] - X[1, m]
            _add_form(state[k, 2], state[k, 3], state[k, 4], Y, stiff)
        _add_form(
            soft + state[2, 2] + state[3, 2], state[2, 3] + state[3, 3], soft + state[2, 4] + state[3, 4], X, stiff
        )
        force[0] += f[0]
        force[1] += cos * f[1]
        force[2] += sin * f[1]
        force[3] += sin * f[2]
        force[4] -= cos * f[2]
        _add_tangent(stiff, cos, sin, tangent)
        if with_slopes:
            ball_slopes(table, centrifugal[1], tau, A, state, X, G, v)
            for j in range(6):
                slopes[0, j] += G[0, j]
                slopes[1, j] += cos * G[1, j]
                slopes[2, j] += sin * G[1, j]
                slopes[3, j] += sin * G[2, j]
                slopes[4, j] -= cos * G[2, j]
    if keeps:
        memory[0] = 1.0
        for m in range(5):
            memory[1 + m] = q[m]
    return energy, -1, 0.0


@inner
def _add_form(xx: float, xr: float, rr: float, Y: np.ndarray, stiff: np.ndarray) -> None:
    """stiff (3, 3) += Yᵀ [xx xr; xr rr] Y."""
    for m in range(3):
        left, right = xx * Y[0, m] + xr * Y[1, m], xr * Y[0, m] + rr * Y[1, m]
        for n in range(m, 3):
            stiff[m, n] += left * Y[0, n] + right * Y[1, n]
            stiff[n, m] = stiff[m, n]


@inner
def _add_tangent(stiff: np.ndarray, cos: float, sin: float, tangent: np.ndarray) -> None:
    """tangent += Bᵀ stiff B,  B = [1 0 0 0 0; 0 cos sin 0 0; 0 0 0 sin −cos]."""
    row = (0, 1, 1, 2, 2)
    factor = (1.0, cos, sin, sin, -cos)
    for m in range(5):
        for n in range(m, 5):
            tangent[m, n] += factor[m] * factor[n] * stiff[row[m], row[n]]
            if m != n:
                tangent[n, m] = tangent[m, n]


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


@kept()
def each_ball(
    table: np.ndarray, push: float, radius: float, ball: float, stations: np.ndarray, q: np.ndarray
) -> tuple[np.ndarray, np.ndarray, int, float]:
    """Centres p (z, 2) and vectors c_k − p (z, 4, 2) [m] of all balls; then the ball without equilibrium, and its unbalanced
    force."""
    soft, loose = floors(table, ball)
    centre, arm, c, state = (
        np.empty((len(stations), 2)),
        np.empty((len(stations), 4, 2)),
        np.empty((4, 2)),
        np.empty((4, 8)),
    )
    for i in range(len(stations)):
        cos, sin = math.cos(stations[i]), math.sin(stations[i])
        groove_centres(table, radius, q[0], cos * q[1] + sin * q[2], sin * q[3] - cos * q[4], c)
        centre[i, 0], centre[i, 1], excess = ball_centre(table, c, push, soft, loose, state)
        if not excess <= 1:
            return centre, arm, i, excess
        for k in range(4):
            arm[i, k, 0], arm[i, k, 1] = c[k, 0] - centre[i, 0], c[k, 1] - centre[i, 1]
    return centre, arm, -1, 0.0


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
