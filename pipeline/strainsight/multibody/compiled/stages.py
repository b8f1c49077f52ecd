"""The implicit stages of a step, each foreseen from those before, then solved; and their derivatives."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from strainsight.compiled import inner, kept
from strainsight.multibody.compiled.arrays import Arrays, Moments, Sparsity, StepPoint, TrialState
from strainsight.multibody.compiled.blocks import natural_motions, natural_velocity
from strainsight.multibody.compiled.equations import FILES, SOLVED, equations
from strainsight.multibody.compiled.matrix import expand_step, factorise, right_side, scale_terms, substitute
from strainsight.multibody.compiled.newton import newton

ROWS = 7
"""Differences that are kept of what changes from stage to stage: it is foreseen by a polynomial of any order below."""


class Past(NamedTuple):
    """What a stage leaves to those behind it. end (2, n): q', v' of the last one, or (0, n). rate (2, n): its  e = (q' − q)/h
    − v'  and  a = (v' − v)/h,  or (0, n). differences (k, ROWS, 2, n): backward ones, from step to step, of its change from
    the stage before, for every stage of a step; known (k,): how many there are. corrections (k, 3): the first and the second
    of Newton's iteration where it was last seen how they follow each other, and the first of the last one."""

    end: np.ndarray
    rate: np.ndarray
    differences: np.ndarray
    known: np.ndarray
    corrections: np.ndarray


class Stages(NamedTuple):
    """How the last of them ended; iterations (k,); q, v (k, n) at the start and the end; ζ (k, nt), μ, λ (k, m), what force laws
    remember (k, any); the past of the next ones."""

    ended: int
    iterations: np.ndarray
    start_q: np.ndarray
    start_v: np.ndarray
    q: np.ndarray
    v: np.ndarray
    motion: np.ndarray
    mu: np.ndarray
    lam: np.ndarray
    memory: np.ndarray
    past: Past


def nothing(stages: int, n: int) -> Past:
    """Before the first step."""
    return Past(
        np.zeros((0, n)), np.zeros((0, n)), np.zeros((stages, ROWS, 2, n)), np.zeros(stages, dtype=np.int64),
        np.zeros((stages, 3)),
    )  # fmt: skip


class Steps(NamedTuple):
    """Solved steps: q, v (T, n), λ (T, m) at their ends, and the stages of the last one; of an unsolved first step its stages."""

    q: np.ndarray
    v: np.ndarray
    lam: np.ndarray
    last: Stages


@kept(*FILES, "multibody/compiled/newton.py")
def solve_stages(
    s: Arrays,
    pattern: Sparsity,
    p: StepPoint,
    u: np.ndarray,
    carried: float,
    memory: np.ndarray,
    mu: np.ndarray,
    lam: np.ndarray,
    near: np.ndarray,
    past: Past,
) -> Steps:
    """Steps from p.q, p.v under u (T, k, nu), of k stages each (`_solve_step`), up to the first one that is not solved. near:
    where the iteration of the last stage of each starts."""
    q, v, lams = np.empty((len(u), len(p.q))), np.empty((len(u), len(p.q))), np.empty((len(u), len(lam)))
    done, at, end = 0, p, u.shape[1] - 1
    for k in range(len(u)):
        stages = _solve_step(s, pattern, at, u[k], carried, memory, mu, lam, near, past)
        if k == 0 or stages.ended == SOLVED:
            last = stages
        if stages.ended != SOLVED:
            break
        past, memory, mu, lam = stages.past, stages.memory[end], stages.mu[end], stages.lam[end]
        copy(stages.q[end], q[k])
        copy(stages.v[end], v[k])
        copy(lam, lams[k])
        at = StepPoint(q[k], v[k], p.h, p.u, p.theta, p.K, p.C, p.w, p.address, p.begin, p.numbers)
        done += 1
    return Steps(q[:done], v[:done], lams[:done], last)


@inner
def _solve_step(
    s: Arrays,
    pattern: Sparsity,
    p: StepPoint,
    u: np.ndarray,
    carried: float,
    memory: np.ndarray,
    mu: np.ndarray,
    lam: np.ndarray,
    near: np.ndarray,
    past: Past,
) -> Stages:
    """Implicit Euler of p.h from p.q, p.v under u[0], then from  x + carried (x₁ − x)  under u[1], …, u (k, nu). near (2, n):
    q', v' from which the last one's iteration starts; (0, n): from what is foreseen, or q + hv, v where nothing is. mu, lam,
    memory: those of the stage before. Ends at the first stage that is not solved, whose trial state it leaves."""
    count, n, h = len(u), len(p.q), p.h
    iterations, ended = np.zeros(count, dtype=np.int64), SOLVED
    starts, starts_v = np.empty((count, n)), np.empty((count, n))
    ends, ends_v = np.empty((count, n)), np.empty((count, n))
    motions, kept_memory = np.empty((count, len(s.dt))), np.empty((count, len(memory)))
    mus, lams = np.empty((count, len(mu))), np.empty((count, len(lam)))
    has_past = len(past.rate) > 0
    rate = past.rate.copy() if has_past else np.zeros((2, n))
    differences, known, corrections = past.differences.copy(), past.known.copy(), past.corrections.copy()
    q0, v0, end = p.q.copy(), p.v.copy(), np.empty((2, n))
    if not goes_on(past.end, q0, v0):
        # from elsewhere, in other directions, corrections fall otherwise
        corrections = np.zeros((count, 3))
    for i in range(count):
        copy(q0, starts[i])
        copy(v0, starts_v[i])
        q, v = q0 + h * v0, v0.copy()
        if i == count - 1 and len(near):
            q, v = near[0].copy(), near[1].copy()
            corrections[i, 0] = corrections[i, 1] = corrections[i, 2] = 0.0
        elif has_past:
            ahead = predict_stage(s.d, h, differences[i], known[i])
            for j in range(n):
                v[j] = v0[j] + h * (rate[1, j] + ahead[1, j])
                q[j] = q0[j] + h * (v[j] + rate[0, j] + ahead[0, j])
        at = StepPoint(q0, v0, h, u[i], p.theta, p.K, p.C, p.w, p.address, p.begin, p.numbers)
        memory = memory.copy()
        ended, iterations[i], trial = newton(s, pattern, at, memory, q, v, mu, lam, corrections[i])
        q, z, mu, lam = trial
        v = natural_velocity(s.body, q, z)
        for state, kept_state in (
            (q, ends[i]), (v, ends_v[i]), (z, motions[i]), (mu, mus[i]), (lam, lams[i]), (memory, kept_memory[i]),
        ):  # fmt: skip
            copy(state, kept_state)
        if ended != SOLVED:
            break
        change = rate.copy()
        for j in range(n):
            rate[1, j] = (v[j] - v0[j]) / h
            rate[0, j] = (q[j] - q0[j]) / h - v[j]
            for a in range(2):
                change[a, j] = rate[a, j] - change[a, j]
        if has_past:
            known[i] = store_differences(differences[i], known[i], change)
        has_past = True
        for j in range(n):
            q0[j] += carried * (q[j] - q0[j])
            v0[j] += carried * (v[j] - v0[j])
    copy(ends[count - 1], end[0])
    copy(ends_v[count - 1], end[1])
    new = Past(end, rate, differences, known, corrections)
    return Stages(ended, iterations, starts, starts_v, ends, ends_v, motions, mus, lams, kept_memory, new)


@inner
def copy(a: np.ndarray, out: np.ndarray) -> None:
    """out ← a (n,); numba would create a separate message for inconsistent shapes."""
    for j in range(len(a)):
        out[j] = a[j]


@inner
def goes_on(end: np.ndarray, q: np.ndarray, v: np.ndarray) -> bool:
    """Whether q, v (n,) is that end, to the last digit."""
    same: bool = len(end) > 0
    for j in range(len(q) if same else 0):
        same = same and end[0, j] == q[j] and end[1, j] == v[j]
    return same


@inner
def predict_stage(d: np.ndarray, h: float, differences: np.ndarray, known: int) -> np.ndarray:
    """The change (2, n) of e and a from the stage before: the sum of the differences up to the order at which it would have been
    nearest the last time, when the next difference was its error."""
    n = len(d)
    best, least, order = np.zeros((2, n)), np.inf, 0
    for r in range(known):
        off = 0.0
        for j in range(n):
            off += d[j] ** 2 * (differences[r, 0, j] ** 2 + (h * differences[r, 1, j]) ** 2)
        if off < least:
            least, order = off, r
    for r in range(order):
        for a in range(2):
            for j in range(n):
                best[a, j] += differences[r, a, j]
    return best


@inner
def store_differences(differences: np.ndarray, known: int, change: np.ndarray) -> int:
    """Backward differences with one change (2, n) more, which becomes the last difference; how many are known now."""
    now: int = min(known + 1, len(differences))
    for r in range(now):
        for a in range(2):
            for j in range(change.shape[1]):
                old = differences[r, a, j]
                differences[r, a, j] = change[a, j]
                change[a, j] -= old
    return now


@kept(*FILES)
def step_slopes(
    s: Arrays,
    pattern: Sparsity,
    p: StepPoint,
    u: np.ndarray,
    starts: np.ndarray,
    starts_v: np.ndarray,
    q: np.ndarray,
    motion: np.ndarray,
    mu: np.ndarray,
    lam: np.ndarray,
    memory: np.ndarray,
    elastic: np.ndarray,
    carried: float,
    forced: bool,
) -> tuple[bool, np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Whether the matrices are regular; of solved stages (k, …) under u (k, width), with those of each by itself Aᵢ, Bᵢ,

        A (2n, 2n),   ∂/∂p = Bᵢ + Xᵢ ∂/∂p  of θ, and w (2n, n) if forced,   X = carried Aᵢ,   A ← X A + (1 − carried) Aᵢ

    and by u (2n, width) of the stages before the last one, and of the last one; elastic (k, n, nθ) = ∂(Kq + Cv)/∂θ."""
    n = q.shape[1]
    by_all, by_theta, by_w = np.eye(2 * n), np.zeros((2 * n, elastic.shape[2])), np.zeros((2 * n, n if forced else 0))
    inside, by_u, regular = np.zeros((2 * n, u.shape[1])), np.zeros((2 * n, u.shape[1])), True
    for i in range(len(q)):
        at = StepPoint(
            starts[i], starts_v[i], p.h, u[i], p.theta, p.K, p.C, p.w, p.address, p.begin, p.numbers
        )  # fmt: skip
        solved = TrialState(q[i], motion[i], mu[i], lam[i])
        fine, A, B_u, B_theta, B_w = _stage_slopes(s, pattern, at, memory[i].copy(), solved, elastic[i], forced)
        regular = regular and fine
        if i == 0:
            by_all, by_theta, by_w, by_u = A, B_theta, B_w, B_u
            continue
        through = carried * A
        by_all = through @ by_all + (1.0 - carried) * A
        inside, by_u = through @ (inside + by_u), B_u
        by_theta, by_w = through @ by_theta + B_theta, through @ by_w + B_w
    return regular, by_all, inside, by_u, by_theta, by_w


@inner
def _stage_slopes(
    s: Arrays,
    pattern: Sparsity,
    p: StepPoint,
    memory: np.ndarray,
    solved: TrialState,
    elastic: np.ndarray,
    forced: bool,
) -> tuple[bool, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Whether the matrix is regular; A (2n, 2n), B_u (2n, all of u), B_θ (2n, nθ), B_w (2n, n) at the solved stage:

    δq = T y,   δv = T ζ + ω × (ε × R),    (y, ζ) = Z⁻¹(TᵀD²/h δq_k,  TᵀM/h δv_k − ∂r₂/∂u δu − ∂r₂/∂θ δθ + Tᵀδw)
    """
    q, z, mu, lam = solved
    n, nt, m, h, nd, count = len(q), len(s.dt), s.joints, p.h, s.drives, len(p.theta)
    # no literal, for which numba would make all of the equations once more
    _, terms = equations(s, p, memory, solved, nt > 0)
    by_drive, TM = terms.by_drive, terms.TM
    Z, J, S = scale_terms(pattern, h, terms)
    columns = 2 * nt + 2 * nd
    r1, r2, r3, r4 = np.zeros((nt, columns)), np.zeros((nt, columns)), np.zeros((m, columns)), np.zeros((m, columns))
    for i in range(nt):
        r1[i, i] = r2[i, nt + i] = 1.0
    for k in range(len(s.drive)):
        row, at = s.drive[k, 0], 2 * nt + s.drive[k, 2]
        rate = by_drive[k, nt + 1]
        for i in range(nt):
            r1[i, at] -= by_drive[k, i] * mu[s.rigid + row]
            r2[i, at] += by_drive[k, i] * lam[s.rigid + row]
            rate += by_drive[k, i] * z[i]
        r3[row, at] -= rate
        r3[row, at + nd] -= by_drive[k, nt]
        r4[row, at] -= by_drive[k, nt]
    rows, right = right_side(pattern, h, terms.A, J, S, r1, r2, r3, r4)
    regular, pivots, last = factorise(Z, pattern.low)
    if regular:
        substitute(Z, pattern.low, pivots, last, right)
    y, zeta, _, _ = expand_step(pattern, h, terms.X, J, S, rows, right)
    whole = natural_rows(s.body, q, z, y, zeta)
    first, second = whole[:, :nt], whole[:, nt : 2 * nt]
    by_all, by_w = np.zeros((2 * n, 2 * n)), np.zeros((2 * n, n if forced else 0))
    _times_columns(s.body, q, first, s.d**2 / h, by_all)
    if forced:
        _times_columns(s.body, q, second, np.ones(n), by_w)
    for k in range(len(s.body)):
        moving, n0, t0, modes, width = s.body[k, 0], s.body[k, 1], s.body[k, 2], s.body[k, 3], s.body[k, 5]
        size = 12 * moving + modes
        for i in range(2 * n):
            for b in range(width):
                value = second[i, t0 + b] / h
                for j in range(size):
                    by_all[i, n + n0 + j] += value * TM[t0 + b, j]
    F = terms.by_parameters.copy()
    for k in range(len(s.input_row)):
        row = s.input_row[k]
        body = s.relations.feels[row, 0]
        if body >= 0:
            for i in range(s.body[body, 2], s.body[body, 2] + s.body[body, 5]):
                F[i, count + s.input_which[k]] -= terms.g[row, i]
    _moment_slopes(s.body, s.moments, q, F[:, count:])
    for k in range(len(s.body)):
        moving, n0, t0, modes = s.body[k, 0], s.body[k, 1], s.body[k, 2], s.body[k, 3]
        for i in range(modes):
            for j in range(count):
                F[t0 + 6 * moving + i, j] += elastic[n0 + 12 * moving + i, j]
    slopes = -(np.ascontiguousarray(second) @ F)
    by_theta, by_u = slopes[:, :count].copy(), slopes[:, count:].copy()
    for i in range(2 * n):
        for k in range(2 * nd):
            by_u[i, s.drive_at + k] += whole[i, 2 * nt + k]
    return regular, by_all, by_u, by_theta, by_w


@inner
def natural_rows(body: np.ndarray, q: np.ndarray, z: np.ndarray, y: np.ndarray, zeta: np.ndarray) -> np.ndarray:
    """δq, δv (2n, k) of y, ζ (nt, k):  δR_β = ε × R_β,   δṘ_β = δω × R_β + ω × (ε × R_β)."""
    n, k = len(q), y.shape[1]
    out = np.empty((2 * n, k))
    out[:n], out[n:] = natural_motions(body, q, y), natural_motions(body, q, zeta)
    for b in range(len(body)):
        t0 = body[b, 2]
        for beta in range(3 * body[b, 0]):
            at = body[b, 1] + 3 + 3 * beta
            for c in range(k):
                d0, d1, d2 = out[at, c], out[at + 1, c], out[at + 2, c]
                out[n + at, c] += z[t0 + 4] * d2 - z[t0 + 5] * d1
                out[n + at + 1, c] += z[t0 + 5] * d0 - z[t0 + 3] * d2
                out[n + at + 2, c] += z[t0 + 3] * d1 - z[t0 + 4] * d0
    return out


@inner
def _times_columns(body: np.ndarray, q: np.ndarray, W: np.ndarray, scale: np.ndarray, out: np.ndarray) -> None:
    """The first n columns of out (r, :) = W Tᵀ diag(scale), of W (r, nt)."""
    moved = natural_motions(body, q, W.T)
    for i in range(len(W)):
        for j in range(len(q)):
            out[i, j] = moved[j, i] * scale[j]


@inner
def _moment_slopes(body: np.ndarray, moments: Moments, q: np.ndarray, F: np.ndarray) -> None:
    """F (nt, nu) += ∂r₂/∂u of the moments:  −d_k in rows ε,  −ΨᵀRᵀd_k in rows η."""
    for m in range(len(moments.on)):
        k = moments.on[m]
        moving, n0, t0, modes = body[k, 0], body[k, 1], body[k, 2], body[k, 3]
        for j in range(moments.inputs.shape[1]):
            which = moments.inputs[m, j]
            if which < 0:
                continue
            for beta in range(3):
                on = moments.direction[m, beta, j]
                if moving:
                    F[t0 + 3 + beta, which] -= on
                    on = 0.0
                    for a in range(3):
                        on += q[n0 + 3 + 3 * beta + a] * moments.direction[m, a, j]
                for i in range(modes):
                    F[t0 + 6 * moving + i, which] -= moments.rotation[m, beta, i] * on
