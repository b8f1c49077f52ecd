"""The equilibrium of one ball between its grooves, and of every ball."""

from __future__ import annotations

import math

import numpy as np

from strainsight.compiled import inner, kept

ITERATIONS = 200
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
def floors(table: np.ndarray, ball: float) -> tuple[float, float]:
    """Regularisation ε [N/m] of a ball without contact, and the negligible force [N]: far below all relevant values."""
    constant = np.max(table[:, 3])
    return 1e-16 * constant * math.sqrt(ball), constant * (LOOSE * ball) ** 1.5


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
