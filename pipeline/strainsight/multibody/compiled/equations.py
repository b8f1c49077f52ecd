"""The equations of motion with all their derivatives: of an implicit step at a trial state in minimal coordinates, and of a state
in natural ones."""

from __future__ import annotations

import numpy as np

from strainsight.compiled import inner, joined, kept
from strainsight.multibody.compiled.arrays import Arrays, StepPoint, Terms, TrialState
from strainsight.multibody.compiled.blocks import add_bodies, add_natural_bodies, natural_velocity
from strainsight.multibody.forces import ABORT, MOVING, NONE, call
from strainsight.multibody.joints import drive_relations
from strainsight.multibody.relations import Relations, Values, Vectors, carried_vectors, rows


@joined
def carried(r: Relations, body: np.ndarray, q: np.ndarray, z: np.ndarray) -> Vectors:
    """Vectors in minimal coordinates, J (nc, 3, 6 + k), its rate under q alone: b = t r + R y,  y = c + C η;     δb = t δr +
    ε × Ry + RC δη rate = t ṙ + ω × Ry + RC η̇;     δrate = ω × (ε × Ry + RC δη) + ε × RC η̇      at the same (ṙ, ω, η̇)"""
    nc, most = len(r.t), r.C.shape[2]
    b, rate, turned = np.zeros((nc, 3)), np.zeros((nc, 3)), np.zeros((nc, 3))
    J, Jr = np.zeros((nc, 3, 6 + most)), np.zeros((nc, 3, 6 + most))
    y, yr, ry, ryr, RC = np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    for i in range(nc):
        for a in range(3):
            b[i, a] = r.c[i, a]
        if r.on[i] < 0:
            continue
        moving, n0, t0, felt = body[r.on[i], 0], body[r.on[i], 1], body[r.on[i], 2], r.felt[i]
        eta, etar = n0 + 12 * moving, t0 + 6 * moving
        for a in range(3):
            y[a], yr[a] = r.c[i, a], 0.0
            for k in range(felt):
                y[a] += r.C[i, a, k] * q[eta + k]
                yr[a] += r.C[i, a, k] * z[etar + k]
        if moving == 0:
            for a in range(3):
                b[i, a], rate[i, a] = y[a], yr[a]
                for k in range(felt):
                    J[i, a, k] = r.C[i, a, k]
            continue
        for a in range(3):
            R = n0 + 3 + a
            ry[a] = q[R] * y[0] + q[R + 3] * y[1] + q[R + 6] * y[2]
            ryr[a] = q[R] * yr[0] + q[R + 3] * yr[1] + q[R + 6] * yr[2]
        w0, w1, w2 = z[t0 + 3], z[t0 + 4], z[t0 + 5]
        t = r.t[i]
        rate[i, 0] = t * z[t0] + w1 * ry[2] - w2 * ry[1] + ryr[0]
        rate[i, 1] = t * z[t0 + 1] + w2 * ry[0] - w0 * ry[2] + ryr[1]
        rate[i, 2] = t * z[t0 + 2] + w0 * ry[1] - w1 * ry[0] + ryr[2]
        along = w0 * ry[0] + w1 * ry[1] + w2 * ry[2]
        for a in range(3):
            turned[i, a] = ry[a]
            b[i, a] = t * q[n0 + a] + ry[a]
            J[i, a, a] = t
            Jr[i, a, 3] -= ry[a] * w0
            Jr[i, a, 4] -= ry[a] * w1
            Jr[i, a, 5] -= ry[a] * w2
            Jr[i, a, 3 + a] += along
        _turn(ry, J[i])
        _turn(ryr, Jr[i])
        for k in range(felt):
            for a in range(3):
                R = n0 + 3 + a
                RC[a] = q[R] * r.C[i, 0, k] + q[R + 3] * r.C[i, 1, k] + q[R + 6] * r.C[i, 2, k]
                J[i, a, 6 + k] = RC[a]
            Jr[i, 0, 6 + k] = w1 * RC[2] - w2 * RC[1]
            Jr[i, 1, 6 + k] = w2 * RC[0] - w0 * RC[2]
            Jr[i, 2, 6 + k] = w0 * RC[1] - w1 * RC[0]
    return Vectors(b, rate, J, Jr, turned)


@inner
def _turn(a: np.ndarray, J: np.ndarray) -> None:
    """J[:, 3:6] += −[a]×, of ε × a."""
    J[0, 4] += a[2]
    J[0, 5] -= a[1]
    J[1, 3] -= a[2]
    J[1, 5] += a[0]
    J[2, 3] += a[1]
    J[2, 4] -= a[0]


@inner
def add_curvature(
    r: Relations, body: np.ndarray, row: int, weight: float, vectors: Vectors, x: np.ndarray, K: np.ndarray
) -> None:
    """K += weight ∂(∇ρᵀ) of one relation:  ∂(Jᵀf) = Jᵀ∂f + ∂Jᵀ f,  rows ε: (ε × Ry + RC δη) × f,  rows η: (ε × RC)·f;
    in natural coordinates  rows R_β: f C_β δη,  rows η: C_βᵀ f·δR_β."""
    J, turned = vectors.J, vectors.turned
    for p in range(4):
        i = r.part[row, p]
        if i < 0 or r.on[i] < 0:
            continue
        k, o = r.on[i], 1 - p // 2
        moving, t0, lead = body[k, 0], body[k, 2], body[k, 5] - body[k, 3]
        for other in range(2 * o, 2 * o + 2):
            j = r.part[row, other]
            if j < 0 or r.on[j] < 0:
                continue
            u0, wide = body[r.on[j], 2], body[r.on[j], 5] - body[r.on[j], 3] + r.felt[j]
            both = weight * r.sign[row, p] * r.sign[row, other]
            for m in range(lead + r.felt[i]):
                a0, a1, a2 = both * J[i, 0, m], both * J[i, 1, m], both * J[i, 2, m]
                for n in range(wide):
                    K[t0 + m, u0 + n] += a0 * J[j, 0, n] + a1 * J[j, 1, n] + a2 * J[j, 2, n]
        if moving == 0:
            continue
        factor = weight * r.sign[row, p]
        f0, f1, f2 = factor * x[row, o, 0], factor * x[row, o, 1], factor * x[row, o, 2]
        f = (f0, f1, f2)
        if lead == 12:
            for m in range(9):
                for n in range(r.felt[i]):
                    h = f[m % 3] * r.C[i, m // 3, n]
                    K[t0 + 3 + m, t0 + 12 + n] += h
                    K[t0 + 12 + n, t0 + 3 + m] += h
            continue
        along = turned[i, 0] * f0 + turned[i, 1] * f1 + turned[i, 2] * f2
        for m in range(3):
            K[t0 + 3 + m, t0 + 3 + m] -= along
            for n in range(3):
                K[t0 + 3 + m, t0 + 3 + n] += turned[i, m] * f[n]
        for n in range(r.felt[i]):
            c0, c1, c2 = J[i, 0, 6 + n], J[i, 1, 6 + n], J[i, 2, 6 + n]
            across = (c1 * f2 - c2 * f1, c2 * f0 - c0 * f2, c0 * f1 - c1 * f0)
            for m in range(3):
                K[t0 + 3 + m, t0 + 6 + n] += across[m]
                K[t0 + 6 + n, t0 + 3 + m] += across[m]


FILES = (
    *(f"multibody/{name}.py" for name in ("bodies", "forces", "joints", "relations")),
    *(f"multibody/compiled/{name}.py" for name in ("arrays", "blocks", "equations", "matrix")),
)
"""Of the compiled code in it."""
SOLVED, NO_LOAD, BROKEN = 0, 1, 2
"""All is there; a law has no load; a law in Python failed."""


@joined
def equations(s: Arrays, p: StepPoint, memory: np.ndarray, trial: TrialState, tangents: bool) -> tuple[int, Terms]:
    """State and terms of a trial state. memory of the laws is brought up to date."""
    vectors = carried(s.relations, s.body, trial.q, trial.z)
    values = rows(s.relations, s.body, vectors, len(s.dt), tangents)
    terms = terms_of(s, p, values, tangents)
    add_bodies(s, p, trial, natural_velocity(s.body, trial.q, trial.z), terms, tangents)
    return add_forces(s, p, memory, values, vectors, trial.mu, trial.lam, terms, tangents), terms


@kept(*FILES)
def natural_equations(
    s: Arrays,
    p: StepPoint,
    memory: np.ndarray,
    q: np.ndarray,
    v: np.ndarray,
    a: np.ndarray,
    mu: np.ndarray,
    lam: np.ndarray,
    tangents: bool,
) -> tuple[int, Terms]:
    """State and terms of (1.3) at q, v, a (n,), μ, λ (m,), over `natural` arrays, without the moments: r₁ = Bᵀμ,
    r₂ = M a + c + f − Bᵀλ, K = ∂r₂/∂q, A = ∂r₂/∂v, X = ∂r₁/∂q, the blocks of M in TᵀM."""
    moving = len(q) > 0
    vectors = carried_vectors(s.relations, s.body, q, v)
    values = rows(s.relations, s.body, vectors, len(q), moving)
    terms = terms_of(s, p, values, tangents)
    add_natural_bodies(s, p, q, v, a, terms, tangents)
    return add_forces(s, p, memory, values, vectors, mu, lam, terms, tangents), terms


@joined
def terms_of(s: Arrays, p: StepPoint, values: Values, tangents: bool) -> Terms:
    """Constraints, driven as they are, and zeros for the rest."""
    rho, rho_dot, g, gr, _ = values
    nt, joints = g.shape[1], s.joints
    by_drive, most = np.zeros((len(s.drive), nt + 2)), 0
    drive_relations(s.drive, s.drive_at, s.drives, p.u, rho, rho_dot, g, gr, by_drive)
    for k in range(len(s.body)):
        most = max(most, s.body[k, 3])
    # zeros of large systems take as long as what is done with them
    size = nt if tangents else 0
    return Terms(
        np.zeros(nt), np.zeros(nt), rho_dot[:joints].copy(), rho[:joints].copy(), g, gr, np.zeros((size, size)),
        np.zeros((size, size)), np.zeros((size, size)), np.zeros((nt, 12 + most)),
        np.zeros((size, len(p.theta) + len(p.u))), by_drive,
    )  # fmt: skip


@joined
def add_forces(
    s: Arrays,
    p: StepPoint,
    memory: np.ndarray,
    values: Values,
    vectors: Vectors,
    mu: np.ndarray,
    lam: np.ndarray,
    terms: Terms,
    tangents: bool,
) -> int:
    """What is conjugate to relations, Σ F ∇ρ: loads, weights, elements, multipliers. The state."""
    nr, r1, r2, g = len(values.rho), terms.r1, terms.r2, terms.g
    F, F_joint, state = s.weights.copy(), np.zeros(nr), SOLVED
    for k in range(len(s.input_row)):
        F[s.input_row[k]] = -p.u[s.input_which[k]]
    for e in range(len(s.element)):
        answer = add_element(s, p, e, memory, values, F, terms, tangents)
        if answer == ABORT:
            state = BROKEN
            break
        if answer == NONE:
            state = NO_LOAD
            break
    for row in range(s.joints):
        F[row], F_joint[row] = -lam[s.rigid + row], mu[s.rigid + row]
    for row in range(nr):
        for f in range(4):
            k = s.relations.feels[row, f]
            if k >= 0:
                for i in range(s.body[k, 2], s.body[k, 2] + s.body[k, 5]):
                    r1[i] += F_joint[row] * g[row, i]
                    r2[i] += F[row] * g[row, i]
    for k in range(len(s.drive) if tangents else 0):
        # the weight of a driven constraint is that of the two relations it is made of
        row, across = s.drive[k, 0], s.drive[k, 1]
        if across >= 0:
            angle = p.u[s.drive_at + s.drive[k, 2]]
            F[across], F_joint[across] = -np.sin(angle) * F[row], -np.sin(angle) * F_joint[row]
            F[row], F_joint[row] = np.cos(angle) * F[row], np.cos(angle) * F_joint[row]
    for row in range(nr if tangents else 0):
        if F[row] != 0.0:
            add_curvature(s.relations, s.body, row, F[row], vectors, values.x, terms.K)
        if F_joint[row] != 0.0:
            add_curvature(s.relations, s.body, row, F_joint[row], vectors, values.x, terms.X)
    return state


@joined
def add_element(
    s: Arrays, p: StepPoint, e: int, memory: np.ndarray, values: Values, F: np.ndarray, terms: Terms, tangents: bool
) -> int:
    """The law of an element: its F, K += ∇ρᵀ(∂F/∂ρ ∇ρ + ∂F/∂ρ̇ ∂ρ̇), A += ∇ρᵀ ∂F/∂ρ̇ ∇ρ, ∂r₂/∂θ. Its answer."""
    first, n, parameters = s.element[e, 0], s.element[e, 1], s.element[e, 2]
    force, slope, damped = np.zeros(n), np.zeros((n, n)), np.zeros((n, n))
    by, mine = np.zeros((n, parameters)), np.empty(parameters)
    for j in range(parameters):
        which = s.element_parameter[e, j]
        mine[j] = p.theta[which] if which < len(p.theta) else p.u[which - len(p.theta)]
    here, moving = values.rho[first : first + n], values.rho_dot[first : first + n]
    numbers, kept_memory = p.numbers[p.begin[e] :], memory[s.element[e, 3] :]
    answer: int = call(
        p.address[e], n, parameters, numbers.ctypes.data, kept_memory.ctypes.data, here.ctypes.data, moving.ctypes.data,
        mine.ctypes.data, force.ctypes.data, slope.ctypes.data, damped.ctypes.data, by.ctypes.data,
    )  # fmt: skip
    if answer < 1:
        return answer
    for i in range(n):
        F[first + i] = force[i]
    if not tangents:
        return answer
    g, gr = terms.g, terms.gr
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
    _add(s.body, s.element_feels[e], first, n, g, pulled, terms.K)
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
        _add(s.body, s.element_feels[e], first, n, g, pulled, terms.A)
    for j in range(parameters):
        for m in range(s.element_feels.shape[1]):
            k = s.element_feels[e, m]
            if k >= 0:
                for c in range(s.body[k, 2], s.body[k, 2] + s.body[k, 5]):
                    for i in range(n):
                        terms.by_parameters[c, s.element_parameter[e, j]] += g[first + i, c] * by[i, j]
    return answer


@inner
def _add(
    body: np.ndarray, feels: np.ndarray, first: int, n: int, g: np.ndarray, pulled: np.ndarray, K: np.ndarray
) -> None:
    """K += gᵀ pulled on the bodies that an element feels."""
    for m in range(len(feels)):
        a = feels[m]
        if a < 0:
            continue
        for o in range(len(feels)):
            b = feels[o]
            if b < 0:
                continue
            for i in range(body[a, 2], body[a, 2] + body[a, 5]):
                for j in range(n):
                    value = g[first + j, i]
                    if value != 0.0:
                        for c in range(body[b, 2], body[b, 2] + body[b, 5]):
                            K[i, c] += value * pulled[j, c]
