"""All relations of a system at once: values, gradients, rates and curvature of scalar products of carried vectors."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from strainsight.compiled import inner, kept
from strainsight.multibody.bodies import RIGID
from strainsight.multibody.frames import Carried
from strainsight.multibody.relations import Relation

# Body, t, c, C and the shape of C: equal for vectors that are the same.
Key = tuple[str | None, float, bytes, bytes, tuple[int, ...]]


class Products(NamedTuple):
    """Relations as arrays. Carried vectors (nc): place (first coordinate r of the body, −1: it does not move), eta (first
    modal coordinate), modes (how many the vector feels), t, c (nc, 3), C (nc, 3, k), active (nc, 3): whether R_β counts,
    columns (nc, 12 + k) and width: the coordinates it depends on. Relations (nr): part (nr, 4) the carried vectors
    x₊, x₋, y₊, y₋ (−1: none) with their sign (nr, 4); value; curved: whether ∇²ρ ≠ 0."""

    place: np.ndarray
    eta: np.ndarray
    modes: np.ndarray
    t: np.ndarray
    c: np.ndarray
    C: np.ndarray
    active: np.ndarray
    columns: np.ndarray
    width: np.ndarray
    part: np.ndarray
    sign: np.ndarray
    value: np.ndarray
    curved: np.ndarray


def compile_products(relations: Sequence[Relation], place: dict[str, int], eta: dict[str, int]) -> Products:
    """The relations over coordinates q; place: first coordinate of every body that moves; eta: of its modal ones."""
    carried: list[Carried] = []
    index: dict[Key, int] = {}

    def number(vector: Carried) -> tuple[int, float]:
        for sign, known in ((1.0, vector), (-1.0, -vector)):
            found = index.get(_key(known))
            if found is not None:
                return found, sign
        carried.append(vector)
        return index.setdefault(_key(vector), len(carried) - 1), 1.0

    part, sign = np.full((len(relations), 4), -1), np.zeros((len(relations), 4))
    for row, relation in enumerate(relations):
        for at, vectors in ((0, relation.x), (2, relation.y)):
            for k, vector in enumerate(vectors):
                part[row, at + k], sign[row, at + k] = number(vector)

    nc, most = len(carried), max([b.C.shape[1] for b in carried], default=0)
    C = np.zeros((nc, 3, most))
    active = np.zeros((nc, 3), dtype=bool)
    columns, width = np.zeros((nc, RIGID + most), dtype=np.int64), np.zeros(nc, dtype=np.int64)
    places, etas = np.full(nc, -1), np.full(nc, -1)
    for i, b in enumerate(carried):
        C[i, :, : b.C.shape[1]] = b.C
        own: list[int] = []
        if b.body in place:
            places[i] = place[b.body]
            active[i] = (b.c != 0) | np.any(b.C != 0, axis=1)
            own += [places[i] + k for k in range(3) if b.t]
            own += [places[i] + 3 + 3 * beta + k for beta in range(3) if active[i, beta] for k in range(3)]
        if b.C.shape[1]:
            etas[i] = eta[str(b.body)]
            own += [etas[i] + k for k in range(b.C.shape[1])]
        columns[i, : len(own)], width[i] = own, len(own)
    moving = width > 0
    bent = (places >= 0) & (etas >= 0)
    curved = np.zeros(len(relations), dtype=bool)
    for row, (x0, x1, y0, y1) in enumerate(part):
        x, y = [i for i in (x0, x1) if i >= 0], [i for i in (y0, y1) if i >= 0]
        curved[row] = (np.any(moving[x]) and np.any(moving[y])) or np.any(bent[x + y])
    return Products(
        places,
        etas,
        np.array([b.C.shape[1] for b in carried], dtype=np.int64),
        np.array([b.t for b in carried]),
        np.array([b.c for b in carried]).reshape(nc, 3),
        C,
        active,
        columns,
        width,
        part,
        sign,
        np.array([relation.value for relation in relations], dtype=float),
        curved,
    )


def _key(b: Carried) -> Key:
    # adding zero makes −0 and 0 the same
    return b.body, b.t + 0.0, (b.c + 0.0).tobytes(), (b.C + 0.0).tobytes(), b.C.shape


@inner
def carried_vectors(p: Products, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """b (nc, 3), its rate, its Jacobian (nc, 3, width) on `columns`, and the rate of that."""
    nc, most = p.columns.shape
    b, rate = np.empty((nc, 3)), np.zeros((nc, 3))
    J, J_rate = np.zeros((nc, 3, most)), np.zeros((nc, 3, most))
    y, y_rate = np.empty(3), np.empty(3)
    for i in range(nc):
        eta, at, n = p.eta[i], p.place[i], p.modes[i]
        for beta in range(3):
            y[beta], y_rate[beta] = p.c[i, beta], 0.0
            for k in range(n):
                y[beta] += p.C[i, beta, k] * q[eta + k]
                y_rate[beta] += p.C[i, beta, k] * v[eta + k]
        if at < 0:
            for a in range(3):
                b[i, a], rate[i, a] = y[a], y_rate[a]
                for k in range(n):
                    J[i, a, k] = p.C[i, a, k]
            continue
        col = 0
        b[i] = 0.0
        if p.t[i] != 0.0:
            for a in range(3):
                b[i, a] = p.t[i] * q[at + a]
                rate[i, a] = p.t[i] * v[at + a]
                J[i, a, a] = p.t[i]
            col = 3
        for beta in range(3):
            if not p.active[i, beta]:
                continue
            R = at + 3 + 3 * beta
            for a in range(3):
                b[i, a] += q[R + a] * y[beta]
                rate[i, a] += v[R + a] * y[beta] + q[R + a] * y_rate[beta]
                J[i, a, col + a] = y[beta]
                J_rate[i, a, col + a] = y_rate[beta]
            col += 3
        for a in range(3):
            for k in range(n):
                for beta in range(3):
                    R = at + 3 + 3 * beta + a
                    J[i, a, col + k] += q[R] * p.C[i, beta, k]
                    J_rate[i, a, col + k] += v[R] * p.C[i, beta, k]
    return b, rate, J, J_rate


@kept()
def relation_rows(
    p: Products, q: np.ndarray, v: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """ρ (nr,), ∇ρ (nr, n), and its rate d/dt ∇ρ = vᵀ∇²ρ (nr, n); with the carried vectors b and J for the curvature."""
    b, rate, J, J_rate = carried_vectors(p, q, v)
    nr = len(p.value)
    rho = np.empty(nr)
    gradient, gradient_rate = np.zeros((nr, len(q))), np.zeros((nr, len(q)))
    x, x_rate = np.empty((2, 3)), np.empty((2, 3))
    for row in range(nr):
        x[:], x_rate[:] = 0.0, 0.0
        for s in range(4):
            i = p.part[row, s]
            if i >= 0:
                for a in range(3):
                    x[s // 2, a] += p.sign[row, s] * b[i, a]
                    x_rate[s // 2, a] += p.sign[row, s] * rate[i, a]
        rho[row] = x[0, 0] * x[1, 0] + x[0, 1] * x[1, 1] + x[0, 2] * x[1, 2] - p.value[row]
        for s in range(4):
            i = p.part[row, s]
            if i < 0:
                continue
            other = 1 - s // 2
            for k in range(p.width[i]):
                slope, slope_rate = 0.0, 0.0
                for a in range(3):
                    slope += J[i, a, k] * x[other, a]
                    slope_rate += J[i, a, k] * x_rate[other, a] + J_rate[i, a, k] * x[other, a]
                gradient[row, p.columns[i, k]] += p.sign[row, s] * slope
                gradient_rate[row, p.columns[i, k]] += p.sign[row, s] * slope_rate
    return rho, gradient, gradient_rate, b, J


@kept()
def relation_bends(p: Products, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
    """∂ρ̈/∂q (nr, n), ρ̈ = ∇ρ a + vᵀ∇²ρ v for coordinates that move with v and a; ∂ρ̈/∂v is 2 vᵀ∇²ρ, ∂ρ̈/∂a is ∇ρ."""
    b, rate, J, J_rate = carried_vectors(p, q, v)
    _, second, _, J_second = carried_vectors(p, q, a)
    for i in range(len(b)):
        for k in range(p.width[i]):
            for c in range(3):
                second[i, c] += J_rate[i, c, k] * v[p.columns[i, k]]
    found = np.zeros((len(p.value), len(q)))
    x, x_rate, x_second = np.empty((2, 3)), np.empty((2, 3)), np.empty((2, 3))
    for row in range(len(p.value)):
        x[:], x_rate[:], x_second[:] = 0.0, 0.0, 0.0
        for s in range(4):
            i = p.part[row, s]
            if i >= 0:
                for c in range(3):
                    x[s // 2, c] += p.sign[row, s] * b[i, c]
                    x_rate[s // 2, c] += p.sign[row, s] * rate[i, c]
                    x_second[s // 2, c] += p.sign[row, s] * second[i, c]
        for s in range(4):
            i, other = p.part[row, s], 1 - s // 2
            if i < 0:
                continue
            for k in range(p.width[i]):
                slope = 0.0
                for c in range(3):
                    slope += J_second[i, c, k] * x[other, c] + 2 * J_rate[i, c, k] * x_rate[other, c]
                    slope += J[i, c, k] * x_second[other, c]
                found[row, p.columns[i, k]] += p.sign[row, s] * slope
    return found


@kept()
def curvature(p: Products, n: int, weight: np.ndarray, b: np.ndarray, J: np.ndarray) -> np.ndarray:
    """Σ_r weight_kr ∇²ρ_r (2, n, n) for two sets of weights (2, nr), from the b and J of `relation_rows`."""
    H = np.zeros((2, n, n))
    x = np.empty((2, 3))
    for row in range(len(p.value)):
        first, second = weight[0, row], weight[1, row]
        if not p.curved[row] or (first == 0.0 and second == 0.0):
            continue
        x[:] = 0.0
        for s in range(4):
            i = p.part[row, s]
            if i >= 0:
                for a in range(3):
                    x[s // 2, a] += p.sign[row, s] * b[i, a]
        for s in range(2):
            i = p.part[row, s]
            if i < 0:
                continue
            for z in range(2, 4):
                j = p.part[row, z]
                if j < 0:
                    continue
                sign = p.sign[row, s] * p.sign[row, z]
                for k in range(p.width[i]):
                    K = p.columns[i, k]
                    for m in range(p.width[j]):
                        L = p.columns[j, m]
                        h = sign * (J[i, 0, k] * J[j, 0, m] + J[i, 1, k] * J[j, 1, m] + J[i, 2, k] * J[j, 2, m])
                        if h == 0.0:
                            continue
                        H[0, K, L] += first * h
                        H[0, L, K] += first * h
                        H[1, K, L] += second * h
                        H[1, L, K] += second * h
        for s in range(4):
            i = p.part[row, s]
            if i < 0 or p.place[i] < 0:
                continue
            for beta in range(3):
                for a in range(3):
                    R = p.place[i] + 3 + 3 * beta + a
                    other = p.sign[row, s] * x[1 - s // 2, a]
                    for k in range(p.modes[i]):
                        h, e = other * p.C[i, beta, k], p.eta[i] + k
                        H[0, R, e] += first * h
                        H[0, e, R] += first * h
                        H[1, R, e] += second * h
                        H[1, e, R] += second * h
    return H
