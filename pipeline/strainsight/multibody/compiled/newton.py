"""Newton's iteration of an implicit step, whole: no Python in it but laws that have no other form."""

from __future__ import annotations

import numpy as np

from strainsight.compiled import inner
from strainsight.multibody.compiled.arrays import Arrays, Sparsity, StateChange, StepPoint, TrialState
from strainsight.multibody.compiled.equations import BROKEN, NO_LOAD, SOLVED, equations
from strainsight.multibody.compiled.matrix import expand_step, factorise, right_side, scale_terms, substitute

INFINITE, SINGULAR, ENDLESS = 3, 4, 5
"""Outcomes of an iteration other than SOLVED, NO_LOAD and BROKEN: not finite; singular; too many iterations."""
ITERATIONS = 25
CONVERGED = 1e-12
"""Largest correction of a body, or its expected successor, relative to its coordinates."""
ROUNDING = 1e-8
"""A smaller correction that no longer decreases is rounding."""
DIGITS, OF_ITS_OWN = 1e-14, 1e-6
"""A correction is also rounding below these limits relative to the whole system and to its body. A nearly rigid body follows the
last digits of other positions."""
SLOW = 1e-3
"""Motion in a step, relative to the coordinates, below which the velocity is negligible."""
STILL = 1e-10
"""Deformation of a body, relative to the whole system, that is negligible: that of an unloaded body is rounding."""
CLOSE, FAST, ROUNDED = 0.01, 1e-4, 1e-2
"""A correction below CLOSE lets the next iteration reuse its matrix. The next correction must be below FAST of it. Its expected
successor must be below ROUNDED of CONVERGED: with the old matrix the convergence is linear only."""
BELIEVED, LAST_DIGIT = 0.01, 1e-17
"""Required successor of a first correction, relative to CONVERGED, if it is not computed, and its least value."""
USUAL, SMALL = 2.0, 1e-6
"""Times the first correction of the step before, above which something has happened, a contact say; and the largest one whose
successor is believed."""
LEAST = 1e-3
"""Share of a correction below which Newton's iteration is given up."""
TINY = float(np.finfo(float).tiny)


@inner
def newton(
    s: Arrays,
    pattern: Sparsity,
    p: StepPoint,
    memory: np.ndarray,
    q: np.ndarray,
    v: np.ndarray,
    mu: np.ndarray,
    lam: np.ndarray,
    corrections: np.ndarray,
) -> tuple[int, int, TrialState]:
    """How it ended, iterations, and the state, from a trial q, v that is put on the rotations first, and μ, λ (m,). Undamped
    while the corrections shrink; a step after which they grow, or to where a law has no load, is halved. corrections (3,):
    the first two of a stage that led here, where they were last seen, and the first of the last one; or zeros. A first one
    that is no larger than either, and whose successor, if it fell by its square as theirs, would be far below what is asked
    for, is the only one. They are brought up to date, and the second counts for twice as much every time it is believed."""
    nt, m = len(s.dt), s.joints
    q, z = on_rotations(s.body, nt, q, v)
    trial = last = TrialState(q, z, mu, lam)
    change = StateChange(np.empty((nt, 1)), np.empty((nt, 1)), np.empty((m, 1)), np.empty((m, 1)))
    before, share, begun, again = np.inf, 1.0, False, False
    iteration = 0
    while iteration < ITERATIONS:
        iteration += 1
        state, terms = equations(s, p, memory, trial, not again)
        r1, r2, r3, r4 = terms.r1, terms.r2, terms.r3, terms.r4
        if state == BROKEN:
            return state, iteration, trial
        if state == NO_LOAD:
            share *= 0.5
            if not begun or share < LEAST:
                return state, iteration, trial
            trial = move_state(s, last, change, share)
            again = False
            continue
        size, of_all, failed = np.inf, np.inf, not np.isfinite(total(r1) + total(r2) + total(r3) + total(r4))
        if not failed:
            if not again:
                Z, J, S = scale_terms(pattern, p.h, terms)
                regular, pivots, ends = factorise(Z, pattern.low)
                if not regular:
                    return SINGULAR, iteration, trial
                old_X, old_A = terms.X, terms.A
            rows, right = right_side(pattern, p.h, old_A, J, S, negative(r1), negative(r2), negative(r3), negative(r4))
            substitute(Z, pattern.low, pivots, ends, right)
            new = expand_step(pattern, p.h, old_X, J, S, rows, right)
            size, of_all = correction(s, p.h, trial, new)
            failed = not np.isfinite(size)
        if again and (failed or size > FAST * before):
            # the matrix of the iteration before is no good here
            again = False
            iteration -= 1
            continue
        if begun and (failed or (size > 2 * before and size > 1e-3)):
            share *= 0.5
            if share < LEAST:
                return ENDLESS, iteration, trial
            trial = move_state(s, last, change, share)
            continue
        if failed:
            return INFINITE, iteration, trial
        change, last, begun = new, trial, True
        trial = move_state(s, trial, change, 1.0)
        if iteration == 1:
            usual = size <= min(SMALL, corrections[0], USUAL * corrections[2])
            corrections[2] = size
            if usual and corrections[1] * (size / corrections[0]) ** 2 <= BELIEVED * CONVERGED:
                corrections[1] *= 2
                return SOLVED, iteration, trial
        if iteration == 2 and share == 1.0:
            corrections[0], corrections[1] = before, max(size, LAST_DIGIT)
        extrapolated = size * (size / before) if iteration > 1 and size < 0.01 * before else np.inf
        enough = ROUNDED if again else 0.1
        rounding = (
            iteration > 2 and size > 0.3 * before and (size < ROUNDING or (of_all < DIGITS and size < OF_ITS_OWN))
        )
        if size <= CONVERGED or extrapolated <= enough * CONVERGED or rounding:
            return SOLVED, iteration, trial
        # so near the end the change of the matrix is one of the next order
        again = size < CLOSE
        before, share = size, 1.0
    return ENDLESS, ITERATIONS, trial


@inner
def negative(r: np.ndarray) -> np.ndarray:
    """−r as a column (n, 1)."""
    out = np.empty((len(r), 1))
    for i in range(len(r)):
        out[i, 0] = -r[i]
    return out


@inner
def total(r: np.ndarray) -> float:
    """Sum of r (n,)."""
    value = 0.0
    for i in range(len(r)):
        value += r[i]
    return value


@inner
def on_rotations(body: np.ndarray, nt: int, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """q (n,) with the nearest rotations for R, and the ζ (nt,) nearest to v: ω = ½ Σ R_β × V_β. R ← ½(R + R⁻ᵀ) (Higham),
    whose quadratic convergence ends at the polar factor of any regular R."""
    q, z = q.copy(), np.empty(nt)
    C = np.empty(9)
    for k in range(len(body)):
        moving, n0, t0, modes = body[k, 0], body[k, 1], body[k, 2], body[k, 3]
        for m in range(modes):
            z[t0 + 6 * moving + m] = v[n0 + 12 * moving + m]
        if moving == 0:
            continue
        R = q[n0 + 3 : n0 + 12]
        for _ in range(60):
            cofactors(R, C)
            volume = R[0] * C[0] + R[1] * C[1] + R[2] * C[2]
            change = 0.0
            for i in range(9):
                new = 0.5 * (R[i] + C[i] / volume)
                change = max(change, abs(new - R[i]))
                R[i] = new
            if not change > 1e-15:
                break
        for a in range(3):
            z[t0 + a] = v[n0 + a]
            z[t0 + 3 + a] = 0.0
        for beta in range(3):
            x, y, w = R[3 * beta], R[3 * beta + 1], R[3 * beta + 2]
            V0, V1, V2 = v[n0 + 3 + 3 * beta], v[n0 + 4 + 3 * beta], v[n0 + 5 + 3 * beta]
            z[t0 + 3] += 0.5 * (y * V2 - w * V1)
            z[t0 + 4] += 0.5 * (w * V0 - x * V2)
            z[t0 + 5] += 0.5 * (x * V1 - y * V0)
    return q, z


@inner
def cofactors(R: np.ndarray, C: np.ndarray) -> None:
    """C = det(R) R⁻ᵀ column by column: R_2 × R_3, R_3 × R_1, R_1 × R_2."""
    for j in range(3):
        a, b = 3 * ((j + 1) % 3), 3 * ((j + 2) % 3)
        C[3 * j] = R[a + 1] * R[b + 2] - R[a + 2] * R[b + 1]
        C[3 * j + 1] = R[a + 2] * R[b] - R[a] * R[b + 2]
        C[3 * j + 2] = R[a] * R[b + 1] - R[a + 1] * R[b]


@inner
def move_state(s: Arrays, trial: TrialState, change: StateChange, share: float) -> TrialState:
    """The state a share of a correction further: R ← exp([ε]×) R, put back on the rotations to round-off."""
    body, q, y = s.body, trial.q.copy(), change.y
    turn = np.empty(3)
    for k in range(len(body)):
        moving, n0, t0, modes = body[k, 0], body[k, 1], body[k, 2], body[k, 3]
        for m in range(modes):
            q[n0 + 12 * moving + m] += share * y[t0 + 6 * moving + m, 0]
        if moving == 0:
            continue
        for a in range(3):
            q[n0 + a] += share * y[t0 + a, 0]
            turn[a] = share * y[t0 + 3 + a, 0]
        square = turn[0] ** 2 + turn[1] ** 2 + turn[2] ** 2
        angle = np.sqrt(square)
        if angle > 1e-4:
            sine, cosine = np.sin(angle) / angle, (1 - np.cos(angle)) / square
        else:
            sine, cosine = 1 - square / 6, 0.5 - square / 24
        for beta in range(3):
            at = n0 + 3 + 3 * beta
            x0, x1, x2 = q[at], q[at + 1], q[at + 2]
            c0, c1, c2 = turn[1] * x2 - turn[2] * x1, turn[2] * x0 - turn[0] * x2, turn[0] * x1 - turn[1] * x0
            q[at] += sine * c0 + cosine * (turn[1] * c2 - turn[2] * c1)
            q[at + 1] += sine * c1 + cosine * (turn[2] * c0 - turn[0] * c2)
            q[at + 2] += sine * c2 + cosine * (turn[0] * c1 - turn[1] * c0)
        R = q[n0 + 3 : n0 + 12]
        C = R.copy()
        for i in range(3):
            for j in range(3):
                dot = C[3 * i] * C[3 * j] + C[3 * i + 1] * C[3 * j + 1] + C[3 * i + 2] * C[3 * j + 2]
                if i == j:
                    dot -= 1.0
                for a in range(3):
                    R[3 * i + a] -= 0.5 * dot * C[3 * j + a]
    z = further(trial.z, change.z, share)
    return TrialState(q, z, further(trial.mu, change.mu, share), further(trial.lam, change.lam, share))


@inner
def further(x: np.ndarray, change: np.ndarray, share: float) -> np.ndarray:
    """x (m,) with a share of the change (k, 1) of its last k."""
    x, first = x.copy(), len(x) - len(change)
    for k in range(len(change)):
        x[first + k] += share * change[k, 0]
    return x


@inner
def correction(s: Arrays, h: float, trial: TrialState, change: StateChange) -> tuple[float, float]:
    """Largest correction of any body, relative to its coordinates and to its velocity (or SLOW of them); and of all coordinates
    and velocities, relative to the coordinates of the whole system [-]."""
    body, d, dt, q, z, y, dz = s.body, s.d, s.dt, trial.q, trial.z, change.y, change.z
    count = len(body)
    squares, whole, moved_by, speed = np.zeros((count, 4)), 0.0, 0.0, 0.0
    for k in range(count):
        moving, n0, t0, width = body[k, 0], body[k, 1], body[k, 2], body[k, 5]
        for i in range(width):
            size = dt[t0 + i]
            squares[k, 0] += (size * y[t0 + i, 0]) ** 2
            squares[k, 1] += (h * size * dz[t0 + i, 0]) ** 2
            squares[k, 3] += (h * size * (z[t0 + i] + dz[t0 + i, 0])) ** 2
        for i in range(12 * moving + body[k, 3]):
            squares[k, 2] += (d[n0 + i] * q[n0 + i]) ** 2
        whole += squares[k, 2]
        moved_by += squares[k, 0] + squares[k, 1]
        speed += squares[k, 3]
    if not np.isfinite(whole + moved_by + speed):
        return np.inf, np.inf
    largest = 0.0
    for k in range(count):
        scale = max(squares[k, 2], STILL**2 * whole)
        largest = max(largest, squares[k, 0] / max(scale, TINY))
        largest = max(largest, squares[k, 1] / max(squares[k, 3], SLOW**2 * scale, TINY))
    return float(np.sqrt(largest)), float(np.sqrt(moved_by / max(whole, TINY)))
