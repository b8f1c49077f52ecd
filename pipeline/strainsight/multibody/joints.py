"""Joints: relations held at zero, or driven along a history."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from strainsight.compiled import kept
from strainsight.multibody import relations
from strainsight.multibody.bodies import Frame
from strainsight.multibody.relations import Relation, cosine, distance_squared, dot, offset

Kind = Literal["displacement", "length", "angle"]


@dataclass(frozen=True)
class DrivenRelation:
    """A relation ρ that is not held at zero but follows p(t):

        displacement   φ = ρ − p           p [m]
        length         φ = ρ − p²          p [m], ρ the square of a distance
        angle          φ = cos p ρ − sin p ρ'          p [rad], ρ = y_i·x_j, ρ' = x_i·x_j

    the last is regular at every angle, for φ_p = −1 there, and holds for p and for p + π: where it starts, the pose says.
    drive: the name of p; across: ρ'."""

    relation: Relation
    drive: str
    kind: Kind
    across: Relation | None = None

    @property
    def name(self) -> str:
        return self.relation.name


@dataclass(frozen=True)
class Drives:
    """The driven constraints of a system: names of the drives (nd,); at: the place of p in u, which is [loads, p, ṗ]; for
    every driven constraint (k): row among the constraints, across: row of ρ' among the relations or −1, which drive, and
    power of p (0: an angle)."""

    names: tuple[str, ...]
    at: int
    row: np.ndarray
    across: np.ndarray
    which: np.ndarray
    power: np.ndarray

    @property
    def width(self) -> int:
        """Of u."""
        return self.at + 2 * len(self.names)

    @property
    def rates(self) -> slice:
        """Places of ṗ in u."""
        return slice(self.at + len(self.names), self.width)


class Driven(NamedTuple):
    """φ_t (m,) = φ_p ṗ of all constraints; φ_p (k,), its derivative by time at rest (k,), and B_p (k, n) of the driven ones."""

    rate: np.ndarray
    slope: np.ndarray
    bend: np.ndarray
    gradient: np.ndarray


def compile_drives(
    constraints: Sequence[Relation | DrivenRelation], first: int, inputs: int
) -> tuple[Drives, list[Relation]]:
    """Drives of all constraints in order, and the additional relations ρ' of driven angles, in rows from `first` on."""
    names = list(
        dict.fromkeys(constraint.drive for constraint in constraints if isinstance(constraint, DrivenRelation))
    )
    extra: list[Relation] = []
    table: list[tuple[int, int, int, int]] = []
    for row, constraint in enumerate(constraints):
        if isinstance(constraint, DrivenRelation):
            across = -1
            if constraint.across is not None:
                across = first + len(extra)
                extra.append(constraint.across)
            power = {"angle": 0, "displacement": 1, "length": 2}[constraint.kind]
            table.append((row, across, names.index(constraint.drive), power))
    return Drives(tuple(names), inputs, *np.array(table, dtype=int).reshape(-1, 4).T), extra


def drive(drives: Drives, m: int, u: np.ndarray, rho: np.ndarray, G: np.ndarray) -> Driven | None:
    """Turns rows of ρ (nr,) and ∇ρ (nr, n) into φ and B of the driven constraints, in place."""
    if not len(drives.row):
        return None
    n, rate = G.shape[1], np.zeros(len(rho))
    table, by = (
        np.stack([drives.row, drives.across, drives.which, drives.power], axis=1),
        np.zeros((len(drives.row), n + 2)),
    )
    drive_relations(table, drives.at, len(drives.names), u, rho, rate, G, np.zeros((0, n)), by)
    return driven_of(drives, m, u, by)


def driven_of(drives: Drives, m: int, u: np.ndarray, by: np.ndarray) -> Driven | None:
    """Of by (k, n + 2) of `drive_relations`."""
    if not len(by):
        return None
    rate = np.zeros(m)
    rate[drives.row] = by[:, -2] * u[drives.rates][drives.which]
    return Driven(rate, by[:, -2], by[:, -1], by[:, :-2])


@kept()
def drive_relations(
    table: np.ndarray,
    at: int,
    count: int,
    u: np.ndarray,
    rho: np.ndarray,
    rho_dot: np.ndarray,
    g: np.ndarray,
    gr: np.ndarray,
    by: np.ndarray,
) -> None:
    """ρ, ρ̇ (nr,), ∇ρ and its change (nr, n), or (0, n), of the driven constraints become φ, Bv + φ_t, B and its change
    (`DrivenRelation`), in place; by (k, n + 2), given as zeros: ∂B/∂p, φ_p and ∂φ_t/∂p. table (k, 4): row, row of ρ' or −1, which
    of the drives, power; p at `at` in u, ṗ `count` behind."""
    n = g.shape[1]
    for k in range(len(table)):
        row, across, which, power = table[k, 0], table[k, 1], table[k, 2], table[k, 3]
        value, rate = u[at + which], u[at + count + which]
        if power == 0:
            c, s = np.cos(value), np.sin(value)
            slope = -s * rho[row] - c * rho[across]
            rho[row] = c * rho[row] - s * rho[across]
            bend = -rho[row] * rate
            rho_dot[row] = c * rho_dot[row] - s * rho_dot[across]
            for i in range(n):
                by[k, i] = -s * g[row, i] - c * g[across, i]
                g[row, i] = c * g[row, i] - s * g[across, i]
                if len(gr):
                    gr[row, i] = c * gr[row, i] - s * gr[across, i] + rate * by[k, i]
        else:
            rho[row] -= value**power
            slope, bend = (-1.0, 0.0) if power == 1 else (-2.0 * value, -2.0 * rate)
        rho_dot[row] += slope * rate
        by[k, n], by[k, n + 1] = slope, bend


def between(drives: Drives, h: float, share: float) -> tuple[np.ndarray, np.ndarray]:
    """W₀, W₁ (width, width): u = W₀ u(0) + W₁ u(h) at that share s of a step: loads on a straight line, p on the cubic that
    has p and ṗ at both ends (Hermite), ṗ its rate."""
    start, end = np.eye(drives.width) * (1 - share), np.eye(drives.width) * share
    nd, s = len(drives.names), share
    for k in range(drives.at, drives.at + nd):
        places = np.ix_([k, k + nd], [k, k + nd])
        start[places] = [
            [(1 + 2 * s) * (1 - s) ** 2, h * s * (1 - s) ** 2],
            [6 * s * (s - 1) / h, (1 - s) * (1 - 3 * s)],
        ]
        end[places] = [[s * s * (3 - 2 * s), h * s * s * (s - 1)], [6 * s * (1 - s) / h, s * (3 * s - 2)]]
    return start, end


@dataclass(frozen=True)
class Joint:
    """φ(q) = 0 (1.2) for every relation, φ(q, p(t)) = 0 for one that is driven; any tuple of relations makes a joint.
    aligned: cosines of axes that the relations keep parallel; that they point the same way only the start can say."""

    name: str
    relations: tuple[Relation | DrivenRelation, ...]
    aligned: tuple[Relation, ...] = ()


def spherical(name: str, i: Frame, j: Frame) -> Joint:
    """p_i = p_j: three relations."""
    return coincidence(name, i, j, "xyz")


def fixed(name: str, i: Frame, j: Frame) -> Joint:
    """p_i = p_j and parallel axes: six relations."""
    relations = (*revolute(name, i, j).relations, dot(i, 0, j, 1))
    return Joint(name, relations, tuple(cosine(i, k, j, k) for k in range(3)))


def revolute(name: str, i: Frame, j: Frame, axis: str = "z") -> Joint:
    """p_i = p_j, and the axis of j stays along that of i: five relations."""
    i, j = i.turned(axis), j.turned(axis)
    return Joint(name, (*spherical(name, i, j).relations, dot(i, 0, j, 2), dot(i, 1, j, 2)), (cosine(i, 2, j, 2),))


def pin(name: str, i: Frame, j: Frame, axis: str = "z") -> Joint:
    """j on the axis of i, two relations: what is left of a revolute joint where a planar loop is closed."""
    i = i.turned(axis)
    return Joint(name, (offset(i, 0, j), offset(i, 1, j)))


def cylindrical(name: str, i: Frame, j: Frame, axis: str = "z") -> Joint:
    """The axes of i and j on one line: four relations."""
    i, j = i.turned(axis), j.turned(axis)
    return Joint(name, (*pin(name, i, j).relations, dot(i, 0, j, 2), dot(i, 1, j, 2)), (cosine(i, 2, j, 2),))


def prismatic(name: str, i: Frame, j: Frame, axis: str = "z") -> Joint:
    """j slides along the axis of i without turning: five relations."""
    i, j = i.turned(axis), j.turned(axis)
    relations = (*cylindrical(name, i, j).relations, dot(i, 0, j, 1))
    return Joint(name, relations, tuple(cosine(i, k, j, k) for k in range(3)))


def universal(name: str, i: Frame, j: Frame, axis: str = "z") -> Joint:
    """p_i = p_j, and with the axis as z, x of i stays at right angles to y of j, the pins of the cross: four relations."""
    i, j = i.turned(axis), j.turned(axis)
    return Joint(name, (*spherical(name, i, j).relations, dot(i, 0, j, 1)))


def coincidence(name: str, i: Frame, j: Frame, components: Sequence[str]) -> Joint:
    """Components "x", "y" or "z" of p_i = p_j, in global axes: a relation each."""
    return Joint(name, tuple(relations.coincidence(i, j, "xyz".index(k)) for k in components))


def perpendicular(name: str, i: Frame, j: Frame, axis: str, to: str) -> Joint:
    """An axis of i at right angles to one of j, or (to: offset) to the line from p_i to p_j: one relation."""
    a = "xyz".index(axis)
    return Joint(name, (offset(i, a, j) if to == "offset" else dot(i, a, j, "xyz".index(to)),))


def distance(name: str, i: Frame, j: Frame, length: float) -> Joint:
    """|p_j − p_i| = length [m]: one relation."""
    return Joint(name, (distance_squared(i, j, length**2),))


def generic(name: str, i: Frame, j: Frame, fixed: Sequence[str]) -> Joint:
    """Some of x, y, z, displacements of j along the axes of i, and about_x, about_y, about_z, turns there: a relation each.
    One turn that is fixed keeps two axes at right angles (about_x y_j·z_i, about_y x_j·z_i, about_z x_j·y_i), two keep the
    third axis of both parallel, three all axes."""
    relations: list[Relation] = [offset(i, k, j) for k in range(3) if "xyz"[k] in fixed]
    turns = [k for k in range(3) if f"about_{'xyz'[k]}" in fixed]
    parallel: list[int] = []
    if len(turns) == 1:
        a, b = ((2, 1), (2, 0), (1, 0))[turns[0]]
        relations.append(dot(i, a, j, b))
    elif turns:
        free = next((k for k in range(3) if k not in turns), 2)
        a, b = (k for k in range(3) if k != free)
        relations += [dot(i, a, j, free), dot(i, b, j, free)] + [dot(i, a, j, b)] * (len(turns) == 3)
        parallel = [free] if len(turns) == 2 else [0, 1, 2]
    return Joint(name, tuple(relations), tuple(cosine(i, k, j, k) for k in parallel))


def driven_angle(name: str, i: Frame, j: Frame, axis: str = "z") -> Joint:
    """j is turned by p(t) about an axis that another joint keeps common: one relation."""
    i, j = i.turned(axis), j.turned(axis)
    turned = DrivenRelation(dot(i, 1, j, 0), name, "angle", dot(i, 0, j, 0))
    return Joint(name, (turned,), (cosine(i, 2, j, 2),))


def driven_displacement(name: str, i: Frame, j: Frame, axis: str = "z") -> Joint:
    """p_j is p(t) along an axis of i: one relation."""
    return Joint(name, (DrivenRelation(offset(i, "xyz".index(axis), j), name, "displacement"),))


def driven_distance(name: str, i: Frame, j: Frame) -> Joint:
    """|p_j − p_i| = p(t): one relation."""
    return Joint(name, (DrivenRelation(distance_squared(i, j), name, "length"),))


JOINTS: Mapping[str, Callable[..., Joint]] = {
    joint.__name__: joint
    for joint in (
        spherical,
        revolute,
        prismatic,
        cylindrical,
        universal,
        pin,
        fixed,
        coincidence,
        perpendicular,
        distance,
        generic,
        driven_angle,
        driven_displacement,
        driven_distance,
    )
}
"""The joints under the names that a config has for them: (name of the joint, first frame, second frame, the keys of its
section) → joint."""
