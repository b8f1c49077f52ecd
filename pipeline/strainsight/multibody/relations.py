"""Relations between frames, scalar products of two vectors of bodies: values, gradients and rates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from strainsight.compiled import joined, kept
from strainsight.multibody.bodies import Body, Carried, Frame, constant


@dataclass(frozen=True)
class Relation:
    """ρ(q) = x·y − value, with x and y a carried vector or the difference of two: (plus,) or (plus, minus). ∇ρ = J_xᵀ y +
    J_yᵀ x,     ∇²ρ = J_xᵀ J_y + J_yᵀ J_x + y·∇²x + x·∇²y     (∇²x, ∇²y constant)"""

    name: str
    x: tuple[Carried, ...]
    y: tuple[Carried, ...]
    value: float = 0.0


def coincidence(i: Frame, j: Frame, k: int, value: float = 0.0) -> Relation:
    """e_k·(p_j − p_i) = value [m], component k in global axes."""
    return Relation(
        f"global {'xyz'[k]} position of {j.name} relative to {i.name}",
        (constant(np.eye(3)[k]),),
        (j.point, -i.point),
        value,
    )


def dot(i: Frame, a: int, j: Frame, b: int) -> Relation:
    """a_{i,a}·a_{j,b} [-]."""
    return Relation(
        f"scalar product of the {'xyz'[a]} axis of {i.name} and the {'xyz'[b]} axis of {j.name}",
        (i.axis(a),),
        (j.axis(b),),
    )


def cosine(i: Frame, a: int, j: Frame, b: int) -> Relation:
    """a_{i,a}·a_{j,b}: 1 for parallel axes [-]."""
    return Relation(f"scalar product of the axes of '{i.name}' and '{j.name}'", (i.axis(a),), (j.axis(b),))


def offset(i: Frame, a: int, j: Frame) -> Relation:
    """a_{i,a}·(p_j − p_i) [m]: position of j along an axis of i."""
    return Relation(f"position of {j.name} along the {'xyz'[a]} axis of {i.name}", (i.axis(a),), (j.point, -i.point))


def distance_squared(i: Frame, j: Frame, value: float = 0.0) -> Relation:
    """|p_j − p_i|² = value [m²]."""
    difference = (j.point, -i.point)
    return Relation(f"distance between {i.name} and {j.name}", difference, difference, value)


def place(j: Frame, direction: np.ndarray, value: float = 0.0) -> Relation:
    """direction·p_j = value [m]."""
    return Relation(f"global position of {j.name}", (constant(direction),), (j.point,), value)


def bearing_displacements(i: Frame, j: Frame) -> tuple[Relation, ...]:
    """The five displacements of ring j in ring i, x the axis: [axial x, radial y, radial z, tilt about y, about z]. d_k =
    a_{i,k}·(p_j − p_i),     tilt_y = −a_{j,x}·a_{i,z},     tilt_z = a_{j,x}·a_{i,y}     [m, m, m, rad, rad]"""
    tilt_y = Relation(f"tilt of {j.name} about the y axis of {i.name}", (-i.axis(2),), (j.axis(0),))
    tilt_z = Relation(f"tilt of {j.name} about the z axis of {i.name}", (i.axis(1),), (j.axis(0),))
    return offset(i, 0, j), offset(i, 1, j), offset(i, 2, j), tilt_y, tilt_z


def bushing_displacements(i: Frame, j: Frame) -> tuple[Relation, ...]:
    """Those of a bearing and the turn about x, a_{j,y}·a_{i,z}: along x, y, z of i [m], then about them [rad]."""
    along_x, along_y, along_z, about_y, about_z = bearing_displacements(i, j)
    about_x = Relation(f"rotation of {j.name} about the x axis of {i.name}", (i.axis(2),), (j.axis(1),))
    return along_x, along_y, along_z, about_x, about_y, about_z


# Body, t, c, C and the shape of C: equal for vectors that are the same.
Key = tuple[str | None, float, bytes, bytes, tuple[int, ...]]


class Relations(NamedTuple):
    """Relations as arrays. Carried vectors (nc): on: their body (−1: none), felt: modes, t, c (nc, 3), C (nc, 3, k). Relations
    (nr): part (nr, 4): the carried vectors x₊, x₋, y₊, y₋ (−1: none) with their sign (nr, 4); value; feels (nr, 4): their bodies
    (−1: none)."""

    on: np.ndarray
    felt: np.ndarray
    t: np.ndarray
    c: np.ndarray
    C: np.ndarray
    part: np.ndarray
    sign: np.ndarray
    value: np.ndarray
    feels: np.ndarray


class Vectors(NamedTuple):
    """Carried vectors at a state: b (nc, 3), its rate, J (nc, 3, ·) = ∂b and its rate by the coordinates of its body; turned
    (nc, 3): R(c + Cη) in minimal coordinates."""

    b: np.ndarray
    rate: np.ndarray
    J: np.ndarray
    J_rate: np.ndarray
    turned: np.ndarray


class Values(NamedTuple):
    """Relations at a state: ρ, ρ̇ (nr,), ∇ρ and ∂ρ̇ under q alone (nr, nt), their two vectors x (nr, 2, 3)."""

    rho: np.ndarray
    rho_dot: np.ndarray
    g: np.ndarray
    g_rate: np.ndarray
    x: np.ndarray


class Products(NamedTuple):
    """Relations over natural coordinates; body (nb, 6): whether it moves, its first natural coordinate, its first one in the
    equations, modes, where its inertia begins (−1: it is constant), number of coordinates in the equations."""

    relations: Relations
    body: np.ndarray


def compile_products(relations: Sequence[Relation], bodies: Sequence[Body]) -> Products:
    """The relations over the coordinates of these bodies."""
    table, first, carried = np.zeros((len(bodies), 6), dtype=np.int64), 0, list[Carried]()
    for k, body in enumerate(bodies):
        table[k] = body.moves, first, first, body.modes, -1, body.size
        first += body.size
    index: dict[Key, int] = {}

    def number(vector: Carried) -> tuple[int, float]:
        for sign, known in ((1.0, vector), (-1.0, -vector)):
            if (number := index.get(_key(known))) is not None:
                return number, sign
        carried.append(vector)
        return index.setdefault(_key(vector), len(carried) - 1), 1.0

    part, sign = np.full((len(relations), 4), -1, dtype=np.int64), np.zeros((len(relations), 4))
    for row, relation in enumerate(relations):
        for at, vectors in ((0, relation.x), (2, relation.y)):
            for k, vector in enumerate(vectors):
                part[row, at + k], sign[row, at + k] = number(vector)

    nc, felt = len(carried), np.array([b.C.shape[1] for b in carried], dtype=np.int64)
    C, on, names = np.zeros((nc, 3, max(felt, default=0))), np.full(nc, -1, dtype=np.int64), [b.name for b in bodies]
    for i, b in enumerate(carried):
        C[i, :, : felt[i]] = b.C
        if b.body in names and (felt[i] or table[names.index(b.body), 0]):
            on[i] = names.index(b.body)
    feels = np.full((len(relations), 4), -1, dtype=np.int64)
    for row, term in enumerate(part):
        felt_by = sorted({int(on[i]) for i in term if i >= 0 and on[i] >= 0})
        feels[row, : len(felt_by)] = felt_by
    t, c = np.array([b.t for b in carried]), np.array([b.c for b in carried]).reshape(nc, 3)
    value = np.array([relation.value for relation in relations], dtype=float)
    return Products(Relations(on, felt, t, c, C, part, sign, value, feels), table)


def _key(b: Carried) -> Key:
    # adding zero makes −0 and 0 the same
    return b.body, b.t + 0.0, (b.c + 0.0).tobytes(), (b.C + 0.0).tobytes(), b.C.shape


@joined
def carried_vectors(r: Relations, body: np.ndarray, q: np.ndarray, v: np.ndarray) -> Vectors:
    """In natural coordinates, J (nc, 3, 12 + k)."""
    nc, most = len(r.t), r.C.shape[2]
    b, rate = np.zeros((nc, 3)), np.zeros((nc, 3))
    J, J_rate = np.zeros((nc, 3, 12 + most)), np.zeros((nc, 3, 12 + most))
    y, y_rate = np.empty(3), np.empty(3)
    for i in range(nc):
        moving, at, n = 0, 0, 0
        if r.on[i] >= 0:
            moving, at, n = body[r.on[i], 0], body[r.on[i], 1], r.felt[i]
        eta = at + 12 * moving
        for beta in range(3):
            y[beta], y_rate[beta] = r.c[i, beta], 0.0
            for k in range(n):
                y[beta] += r.C[i, beta, k] * q[eta + k]
                y_rate[beta] += r.C[i, beta, k] * v[eta + k]
        if moving == 0:
            for a in range(3):
                b[i, a], rate[i, a] = y[a], y_rate[a]
                for k in range(n):
                    J[i, a, k] = r.C[i, a, k]
            continue
        for a in range(3):
            b[i, a], rate[i, a], J[i, a, a] = r.t[i] * q[at + a], r.t[i] * v[at + a], r.t[i]
            for beta in range(3):
                R = at + 3 + 3 * beta + a
                b[i, a] += q[R] * y[beta]
                rate[i, a] += v[R] * y[beta] + q[R] * y_rate[beta]
                J[i, a, 3 + 3 * beta + a], J_rate[i, a, 3 + 3 * beta + a] = y[beta], y_rate[beta]
                for k in range(n):
                    J[i, a, 12 + k] += q[R] * r.C[i, beta, k]
                    J_rate[i, a, 12 + k] += v[R] * r.C[i, beta, k]
    return Vectors(b, rate, J, J_rate, b)


@joined
def rows(r: Relations, body: np.ndarray, vectors: Vectors, size: int, moving: bool) -> Values:
    """Of carried vectors and so many coordinates, without ∂ρ̇ (0, size) unless moving."""
    b, rate, J, Jr, _ = vectors
    nr = len(r.value)
    rho, rho_dot, x, xr = np.empty(nr), np.empty(nr), np.empty((nr, 2, 3)), np.empty((2, 3))
    # an element may have rows that feel different bodies
    g, gr = np.zeros((nr, size)), np.zeros((nr if moving else 0, size))
    for row in range(nr):
        for a in range(3):
            x[row, 0, a] = x[row, 1, a] = xr[0, a] = xr[1, a] = 0.0
        for p in range(4):
            i = r.part[row, p]
            if i >= 0:
                for a in range(3):
                    x[row, p // 2, a] += r.sign[row, p] * b[i, a]
                    xr[p // 2, a] += r.sign[row, p] * rate[i, a]
        rho[row], rho_dot[row] = -r.value[row], 0.0
        for a in range(3):
            rho[row] += x[row, 0, a] * x[row, 1, a]
            rho_dot[row] += xr[0, a] * x[row, 1, a] + x[row, 0, a] * xr[1, a]
        for p in range(4):
            i = r.part[row, p]
            if i < 0 or r.on[i] < 0:
                continue
            o, sign = 1 - p // 2, r.sign[row, p]
            f0, f1, f2 = sign * x[row, o, 0], sign * x[row, o, 1], sign * x[row, o, 2]
            r0, r1, r2 = sign * xr[o, 0], sign * xr[o, 1], sign * xr[o, 2]
            t0, width = body[r.on[i], 2], body[r.on[i], 5] - body[r.on[i], 3] + r.felt[i]
            for k in range(width):
                g[row, t0 + k] += J[i, 0, k] * f0 + J[i, 1, k] * f1 + J[i, 2, k] * f2
            for k in range(width if moving else 0):
                gr[row, t0 + k] += J[i, 0, k] * r0 + J[i, 1, k] * r1 + J[i, 2, k] * r2
                gr[row, t0 + k] += Jr[i, 0, k] * f0 + Jr[i, 1, k] * f1 + Jr[i, 2, k] * f2
    return Values(rho, rho_dot, g, gr, x)


@kept()
def relation_rows(p: Products, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """ρ (nr,), ∇ρ (nr, n), and its rate d/dt ∇ρ = vᵀ∇²ρ (nr, n)."""
    # no literal, for which numba would compile `rows` a second time
    moving = len(q) > 0
    values = rows(p.relations, p.body, carried_vectors(p.relations, p.body, q, v), len(q), moving)
    return values.rho, values.g, values.g_rate


@kept()
def relation_bends(p: Products, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
    """∂ρ̈/∂q (nr, n), ρ̈ = ∇ρ a + vᵀ∇²ρ v for coordinates that move with v and a; ∂ρ̈/∂v is 2 vᵀ∇²ρ, ∂ρ̈/∂a is ∇ρ."""
    r, body = p.relations, p.body
    b, rate, J, J_rate, _ = carried_vectors(r, body, q, v)
    _, second, _, J_second, _ = carried_vectors(r, body, q, a)
    for i in range(len(b)):
        for k in range(12 * body[r.on[i], 0] + r.felt[i] if r.on[i] >= 0 else 0):
            for c in range(3):
                second[i, c] += J_rate[i, c, k] * v[body[r.on[i], 1] + k]
    bends = np.zeros((len(r.value), len(q)))
    x, x_rate, x_second = np.empty((2, 3)), np.empty((2, 3)), np.empty((2, 3))
    for row in range(len(r.value)):
        x[:], x_rate[:], x_second[:] = 0.0, 0.0, 0.0
        for s in range(4):
            i = r.part[row, s]
            if i >= 0:
                for c in range(3):
                    x[s // 2, c] += r.sign[row, s] * b[i, c]
                    x_rate[s // 2, c] += r.sign[row, s] * rate[i, c]
                    x_second[s // 2, c] += r.sign[row, s] * second[i, c]
        for s in range(4):
            i, other = r.part[row, s], 1 - s // 2
            if i < 0 or r.on[i] < 0:
                continue
            for k in range(12 * body[r.on[i], 0] + r.felt[i]):
                slope = 0.0
                for c in range(3):
                    slope += J_second[i, c, k] * x[other, c] + 2 * J_rate[i, c, k] * x_rate[other, c]
                    slope += J[i, c, k] * x_second[other, c]
                bends[row, body[r.on[i], 1] + k] += r.sign[row, s] * slope
    return bends
