"""Constraints that move with time: φ(q, p(t)) = 0 and B(q, p) v + φ_p ṗ = 0."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from strainsight.compiled import kept
from strainsight.multibody.relations import Relation

Kind = Literal["displacement", "length", "angle"]


@dataclass(frozen=True)
class DrivenRelation:
    """A relation ρ that is not held at zero but follows p(t):

        displacement   φ = ρ − p           p [m]
        length         φ = ρ − p²          p [m], ρ the square of a distance
        angle          φ = cos p ρ − sin p ρ'          p [rad], ρ = y_i·x_j, ρ' = x_i·x_j

    the last is regular at every angle, for φ_p = −1 there, and holds for p and for p + π: where it starts, the pose says.
    drive: the name of p; across: ρ'.
    """

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


def compile_drives(held: Sequence[Relation | DrivenRelation], first: int, inputs: int) -> tuple[Drives, list[Relation]]:
    """Of all constraints in order, and the relations ρ' that they need besides, which stand from row `first` on."""
    names = list(dict.fromkeys(own.drive for own in held if isinstance(own, DrivenRelation)))
    extra: list[Relation] = []
    table: list[tuple[int, int, int, int]] = []
    for row, own in enumerate(held):
        if isinstance(own, DrivenRelation):
            across = -1
            if own.across is not None:
                across = first + len(extra)
                extra.append(own.across)
            table.append((row, across, names.index(own.drive), {"angle": 0, "displacement": 1, "length": 2}[own.kind]))
    columns = np.array(table, dtype=int).reshape(-1, 4).T
    return Drives(tuple(names), inputs, *columns), extra


def drive(
    drives: Drives, m: int, u: np.ndarray, rho: np.ndarray, G: np.ndarray, G_rate: np.ndarray | None = None
) -> Driven | None:
    """Turns rows of ρ (nr,), ∇ρ and its rate (nr, n) into φ, B and dB/dt of the driven constraints, in place."""
    if not len(drives.row):
        return None
    n, rate = G.shape[1], np.zeros(len(rho))
    table, by = (
        np.stack([drives.row, drives.across, drives.which, drives.power], axis=1),
        np.zeros((len(drives.row), n + 2)),
    )
    G_rate = np.zeros((0, n)) if G_rate is None else G_rate
    drive_relations(table, drives.at, len(drives.names), u, rho, rate, G, G_rate, by)
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
        own = np.ix_([k, k + nd], [k, k + nd])
        start[own] = [[(1 + 2 * s) * (1 - s) ** 2, h * s * (1 - s) ** 2], [6 * s * (s - 1) / h, (1 - s) * (1 - 3 * s)]]
        end[own] = [[s * s * (3 - 2 * s), h * s * s * (s - 1)], [6 * s * (1 - s) / h, s * (3 * s - 2)]]
    return start, end
