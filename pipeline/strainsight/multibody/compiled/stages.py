"""The implicit stages of a step, one after the other: each foreseen from those before, then solved."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from strainsight.compiled import inner, kept
from strainsight.multibody.compiled.arrays import Arrays, Pattern, Point
from strainsight.multibody.compiled.blocks import natural_velocity
from strainsight.multibody.compiled.equations import FILES, SOLVED
from strainsight.multibody.compiled.newton import newton

ROWS = 7
"""Differences that are kept of what changes from stage to stage: it is foreseen by a polynomial of any order below."""


class Past(NamedTuple):
    """What a stage leaves to those behind it.

    end (2, n): q', v' of the last one, or (0, n). rate (2, n): its  e = (q' − q)/h − v'  and  a = (v' − v)/h,  or (0, n).
    differences (k, ROWS, 2, n): backward ones, from step to step, of its change from the stage before, for every stage of a step;
    known (k,): how many there are.
    corrections (k, 3): the first and the second of Newton's iteration where it was last seen how they follow each other, and the
    first of the last one.
    """

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


@kept(*FILES, "multibody/compiled/newton.py")
def solve_stages(
    s: Arrays,
    pattern: Pattern,
    p: Point,
    u: np.ndarray,
    carried: float,
    theta: np.ndarray,
    memory: np.ndarray,
    mu: np.ndarray,
    lam: np.ndarray,
    near: np.ndarray,
    past: Past,
) -> Stages:
    """Implicit Euler of p.h from p.q, p.v under u[0], then from  x + carried (x₁ − x)  under u[1], …, u (k, nu).

    near (2, n): q', v' from which the last one's iteration starts; (0, n): from what is foreseen, or q + hv, v where nothing is.
    mu, lam, memory: those of the stage before. Ends at the first stage that is not solved, whose trial state it leaves.
    """
    count, n, h = len(u), len(p.q), p.h
    iterations, ended = np.zeros(count, dtype=np.int64), SOLVED
    starts, starts_v = np.empty((count, n)), np.empty((count, n))
    ends, ends_v = np.empty((count, n)), np.empty((count, n))
    motions, kept_memory = np.empty((count, len(s.dt))), np.empty((count, len(memory)))
    mus, lams = np.empty((count, len(mu))), np.empty((count, len(lam)))
    given = len(past.rate) > 0
    rate = past.rate.copy() if given else np.zeros((2, n))
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
        elif given:
            ahead = foreseen(s.d, h, differences[i], known[i])
            for j in range(n):
                v[j] = v0[j] + h * (rate[1, j] + ahead[1, j])
                q[j] = q0[j] + h * (v[j] + rate[0, j] + ahead[0, j])
        at = Point(q0, v0, h, u[i], p.K, p.C, p.w, p.address, p.begin, p.numbers)
        memory = memory.copy()
        ended, iterations[i], q, z, mu, lam = newton(s, pattern, at, theta, memory, q, v, mu, lam, corrections[i])
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
        if given:
            known[i] = noted(differences[i], known[i], change)
        given = True
        for j in range(n):
            q0[j] += carried * (q[j] - q0[j])
            v0[j] += carried * (v[j] - v0[j])
    copy(ends[count - 1], end[0])
    copy(ends_v[count - 1], end[1])
    new = Past(end, rate, differences, known, corrections)
    return Stages(ended, iterations, starts, starts_v, ends, ends_v, motions, mus, lams, kept_memory, new)


@inner
def copy(a: np.ndarray, out: np.ndarray) -> None:
    """out ← a (n,); numba would make a message of its own for shapes that do not fit."""
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
def foreseen(d: np.ndarray, h: float, differences: np.ndarray, known: int) -> np.ndarray:
    """The change (2, n) of e and a from the stage before: the sum of the differences up to the order at which it would have been
    nearest the last time, when the next difference was its error."""
    n = len(d)
    found, least, order = np.zeros((2, n)), np.inf, 0
    for r in range(known):
        off = 0.0
        for j in range(n):
            off += d[j] ** 2 * (differences[r, 0, j] ** 2 + (h * differences[r, 1, j]) ** 2)
        if off < least:
            least, order = off, r
    for r in range(order):
        for a in range(2):
            for j in range(n):
                found[a, j] += differences[r, a, j]
    return found


@inner
def noted(differences: np.ndarray, known: int, change: np.ndarray) -> int:
    """Backward differences with one change (2, n) more, which becomes the last difference; how many are known now."""
    now: int = min(known + 1, len(differences))
    for r in range(now):
        for a in range(2):
            for j in range(change.shape[1]):
                old = differences[r, a, j]
                differences[r, a, j] = change[a, j]
                change[a, j] -= old
    return now
