"""The equations of an implicit step at a trial state, in minimal coordinates, with all that Newton's iteration needs of them."""

from __future__ import annotations

import numpy as np

from strainsight.compiled import inner
from strainsight.multibody.compiled.arrays import Arrays, Point
from strainsight.multibody.compiled.blocks import add_bodies, natural_velocity
from strainsight.multibody.compiled.call import ABORT, call
from strainsight.multibody.compiled.law import MOVING, NONE
from strainsight.multibody.compiled.relations import add_curvature, carried, rows

FILES = (
    "multibody/inertia.py",
    *(
        f"multibody/compiled/{name}.py"
        for name in ("arrays", "blocks", "call", "equations", "law", "matrix", "relations")
    ),
)
"""Of the compiled code in it."""
SOLVED, NO_LOAD, BROKEN = 0, 1, 2
"""All is there; a law has no load; a law in Python failed."""


@inner
def equations(
    s: Arrays,
    p: Point,
    theta: np.ndarray,
    memory: np.ndarray,
    q: np.ndarray,
    z: np.ndarray,
    mu: np.ndarray,
    lam: np.ndarray,
    tangents: bool,
) -> tuple[int, np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray,
           np.ndarray, np.ndarray, np.ndarray, np.ndarray]:  # fmt: skip
    """State, r₁, r₂ (nt,), r₃, r₄ (joints,), ∇ρ, ∂ρ̇ (nr, nt), X, A, K (nt, nt), TᵀM (nt, 12 + most modes), ∂r₂/∂(θ, u) of the
    elements (nt, nθ + all of u), ∂B/∂p, φ_p and ∂φ_t/∂p of the driven constraints (k, nt + 2) at q, ζ, μ, λ; without tangents
    ∂ρ̇, X, A, K, TᵀM and ∂r₂/∂(θ, u) are empty. memory of the laws is brought up to date."""
    nt, nr = len(s.dt), len(s.value)
    b, rate, J, Jr, turned = carried(s, q, z)
    rho, rho_dot, x = np.empty(nr), np.empty(nr), np.empty((nr, 2, 3))
    # zeros of large systems take as long as what is done with them
    size, most = nt if tangents else 0, 0
    for k in range(len(s.body)):
        most = max(most, s.body[k, 3])
    # an element may have rows that feel different bodies
    g, gr = np.zeros((nr, nt)), np.zeros((nr if tangents else 0, nt))
    rows(s, b, rate, J, Jr, rho, rho_dot, g, gr, x)
    by_drive = np.zeros((len(s.drive), nt + 2))
    drive(s, p.u, rho, rho_dot, g, gr, by_drive)
    v = natural_velocity(s, q, z)
    r1, r2 = np.zeros(nt), np.zeros(nt)
    X, A, K, TM = np.zeros((size, size)), np.zeros((size, size)), np.zeros((size, size)), np.zeros((size, 12 + most))
    by_theta = np.zeros((size, len(theta) + len(p.u)))
    add_bodies(s, p, q, z, v, r1, r2, X, A, K, TM, tangents)
    F = s.weights.copy()
    for k in range(len(s.input_row)):
        F[s.input_row[k]] = -p.u[s.input_which[k]]
    state = SOLVED
    for e in range(len(s.element)):
        answer = add_element(s, p, e, theta, memory, rho, rho_dot, g, gr, F, A, K, by_theta, tangents)
        if answer == ABORT:
            state = BROKEN
            break
        if answer == NONE:
            state = NO_LOAD
            break
    held = np.zeros(nr)
    for row in range(s.joints):
        F[row], held[row] = -lam[s.rigid + row], mu[s.rigid + row]
    for row in range(nr):
        for f in range(4):
            k = s.feels[row, f]
            if k >= 0:
                for i in range(s.body[k, 2], s.body[k, 2] + s.body[k, 5]):
                    r1[i] += held[row] * g[row, i]
                    r2[i] += F[row] * g[row, i]
    for k in range(len(s.drive) if tangents else 0):
        # the weight of a driven constraint is that of the two relations it is made of
        row, across = s.drive[k, 0], s.drive[k, 1]
        if across >= 0:
            angle = p.u[s.drive_at + s.drive[k, 2]]
            F[across], held[across] = -np.sin(angle) * F[row], -np.sin(angle) * held[row]
            F[row], held[row] = np.cos(angle) * F[row], np.cos(angle) * held[row]
    for row in range(nr if tangents else 0):
        if F[row] != 0.0:
            add_curvature(s, row, F[row], J, turned, x, K)
        if held[row] != 0.0:
            add_curvature(s, row, held[row], J, turned, x, X)
    r3, r4 = rho_dot[: s.joints].copy(), rho[: s.joints].copy()
    return state, r1, r2, r3, r4, g, gr, X, A, K, TM, by_theta, by_drive


@inner
def drive(
    s: Arrays,
    u: np.ndarray,
    rho: np.ndarray,
    rho_dot: np.ndarray,
    g: np.ndarray,
    gr: np.ndarray,
    by_drive: np.ndarray,
) -> None:
    """ρ, ρ̇, ∇ρ, ∂ρ̇ of the driven constraints become φ, Bv + φ_t, B and its change (`DrivenRelation`), in place; by_drive as of
    `equations`, given as zeros."""
    nt = g.shape[1]
    for k in range(len(s.drive)):
        row, across, which, power = s.drive[k, 0], s.drive[k, 1], s.drive[k, 2], s.drive[k, 3]
        value, rate = u[s.drive_at + which], u[s.drive_at + s.drives + which]
        if power == 0:
            c, n = np.cos(value), np.sin(value)
            slope = -n * rho[row] - c * rho[across]
            rho[row] = c * rho[row] - n * rho[across]
            bend = -rho[row] * rate
            rho_dot[row] = c * rho_dot[row] - n * rho_dot[across]
            for f in range(4):
                body = s.feels[row, f]
                if body >= 0:
                    for i in range(s.body[body, 2], s.body[body, 2] + s.body[body, 5]):
                        by_drive[k, i] = -n * g[row, i] - c * g[across, i]
                        g[row, i] = c * g[row, i] - n * g[across, i]
                        if len(gr):
                            gr[row, i] = c * gr[row, i] - n * gr[across, i] + rate * by_drive[k, i]
        else:
            rho[row] -= value**power
            slope, bend = (-1.0, 0.0) if power == 1 else (-2.0 * value, -2.0 * rate)
        rho_dot[row] += slope * rate
        by_drive[k, nt], by_drive[k, nt + 1] = slope, bend


@inner
def add_element(
    s: Arrays,
    p: Point,
    e: int,
    theta: np.ndarray,
    memory: np.ndarray,
    rho: np.ndarray,
    rho_dot: np.ndarray,
    g: np.ndarray,
    gr: np.ndarray,
    F: np.ndarray,
    A: np.ndarray,
    K: np.ndarray,
    by_theta: np.ndarray,
    tangents: bool,
) -> int:
    """The law of an element: its F, K += ∇ρᵀ(∂F/∂ρ ∇ρ + ∂F/∂ρ̇ ∂ρ̇), A += ∇ρᵀ ∂F/∂ρ̇ ∇ρ, ∂r₂/∂θ. Its answer."""
    first, n, parameters = s.element[e, 0], s.element[e, 1], s.element[e, 2]
    own, slope, damped = np.zeros(n), np.zeros((n, n)), np.zeros((n, n))
    by, mine = np.zeros((n, parameters)), np.empty(parameters)
    for j in range(parameters):
        which = s.element_parameter[e, j]
        mine[j] = theta[which] if which < len(theta) else p.u[which - len(theta)]
    here, moving = rho[first : first + n], rho_dot[first : first + n]
    numbers, kept_memory = p.numbers[p.begin[e] :], memory[s.element[e, 3] :]
    answer: int = call(
        p.address[e], n, parameters, numbers.ctypes.data, kept_memory.ctypes.data, here.ctypes.data, moving.ctypes.data,
        mine.ctypes.data, own.ctypes.data, slope.ctypes.data, damped.ctypes.data, by.ctypes.data,
    )  # fmt: skip
    if answer < 1:
        return answer
    for i in range(n):
        F[first + i] = own[i]
    if not tangents:
        return answer
    pulled = np.empty((n, g.shape[1]))
    for m in range(s.element_feels.shape[1]):
        k = s.element_feels[e, m]
        if k < 0:
            continue
        begin, end = s.body[k, 2], s.body[k, 2] + s.body[k, 5]
        for i in range(n):
            for c in range(begin, end):
                value = 0.0
                for j in range(n):
                    value += slope[i, j] * g[first + j, c]
                if answer == MOVING:
                    for j in range(n):
                        value += damped[i, j] * gr[first + j, c]
                pulled[i, c] = value
    _add(s, e, first, n, g, pulled, K)
    if answer == MOVING:
        for m in range(s.element_feels.shape[1]):
            k = s.element_feels[e, m]
            if k < 0:
                continue
            for i in range(n):
                for c in range(s.body[k, 2], s.body[k, 2] + s.body[k, 5]):
                    value = 0.0
                    for j in range(n):
                        value += damped[i, j] * g[first + j, c]
                    pulled[i, c] = value
        _add(s, e, first, n, g, pulled, A)
    for j in range(parameters):
        for m in range(s.element_feels.shape[1]):
            k = s.element_feels[e, m]
            if k >= 0:
                for c in range(s.body[k, 2], s.body[k, 2] + s.body[k, 5]):
                    for i in range(n):
                        by_theta[c, s.element_parameter[e, j]] += g[first + i, c] * by[i, j]
    return answer


@inner
def _add(s: Arrays, e: int, first: int, n: int, g: np.ndarray, pulled: np.ndarray, K: np.ndarray) -> None:
    """K += gᵀ pulled on the bodies that an element feels."""
    for m in range(s.element_feels.shape[1]):
        a = s.element_feels[e, m]
        if a < 0:
            continue
        for o in range(s.element_feels.shape[1]):
            b = s.element_feels[e, o]
            if b < 0:
                continue
            for i in range(s.body[a, 2], s.body[a, 2] + s.body[a, 5]):
                for j in range(n):
                    value = g[first + j, i]
                    if value != 0.0:
                        for c in range(s.body[b, 2], s.body[b, 2] + s.body[b, 5]):
                            K[i, c] += value * pulled[j, c]
