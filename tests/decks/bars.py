"""A bar of solids by scikit-fem, with the ties, masses and springs of a deck in their own form: K, M and C u = 0."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cache

import numpy as np
import skfem
from scipy.linalg import eigh, null_space
from skfem.models.elasticity import lame_parameters, linear_elasticity

from ..solids import CUTS, HEX, SOLIDS, TET

E, NU, RHO, LENGTH = 2.1e11, 0.3, 7850.0, 1.0
OF = {"tet4": TET, "tet10": TET, "hex20": HEX}
CELLS = (2, 1, 1)
SHEARED = np.array([[LENGTH, 0.05, 0.0], [0.0, 0.3, 0.02], [0.0, 0.0, 0.2]])
STIFF = (
    np.array(
        [
            [9, 3, 2, 0, 0, 0],
            [3, 7, 2, 0, 0, 0],
            [2, 2, 5, 0, 0, 0],
            [0, 0, 0, 3, 0, 0],
            [0, 0, 0, 0, 2, 0],
            [0, 0, 0, 0, 0, 1],
        ]
    )
    * 1e10
)
"""Along 11 22 33 12 23 31."""


@dataclass(frozen=True)
class Bar:
    """x (n, 3) [m], cells with nodes in VTK order; K, M of scikit-fem, node after node."""

    kind: str
    x: np.ndarray
    cells: list[list[int]]
    K: np.ndarray
    M: np.ndarray

    @property
    def root(self) -> list[int]:
        return np.flatnonzero(self.u == 0).tolist()

    @property
    def tip(self) -> list[int]:
        return np.flatnonzero(self.u == CELLS[0]).tolist()

    @property
    def u(self) -> np.ndarray:
        """Place along the bar, 0 to 2."""
        return np.round(np.linalg.solve(SHEARED, self.x.T)[0] * CELLS[0], 9)


@cache
def bar(kind: str, anisotropic: bool = False) -> Bar:
    corners: dict[tuple[float, ...], int] = {}
    cells = []
    for first in np.ndindex(*CELLS):
        own = [tuple(np.add(first, corner)) for corner in HEX]
        for cut in CUTS[OF[kind]]:
            cells.append([corners.setdefault(own[i], len(corners)) for i in cut])
    straight = cells
    points = list(corners)
    middle: dict[frozenset[int], int] = {}
    full = []
    for cell in cells:
        own = list(cell)
        for a, b in SOLIDS[kind].edges:
            key = frozenset((cell[a], cell[b]))
            if key not in middle:
                middle[key] = len(points)
                points.append(tuple((np.array(points[cell[a]]) + points[cell[b]]) / 2))
            own.append(middle[key])
        full.append(own)
    x = np.array(points) / CELLS @ SHEARED.T
    x_corner = x[: len(corners)].T
    t = np.array(straight).T
    match kind:
        case "tet4" | "tet10":
            mesh = skfem.MeshTet(x_corner, t)
            element = skfem.ElementTetP1() if kind == "tet4" else skfem.ElementTetP2()
        case _:
            mesh, element = skfem.MeshHex(x_corner, t[[0, 1, 3, 4, 2, 5, 7, 6]]), skfem.ElementHexS2()
    basis = skfem.Basis(mesh, skfem.ElementVector(element), intorder=6)

    @skfem.BilinearForm
    def inertia(u, v, _):
        return RHO * (u[0] * v[0] + u[1] * v[1] + u[2] * v[2])

    @skfem.BilinearForm
    def along_axes(u, v, _):
        def strain(w):
            g = w.grad
            return np.array([g[0, 0], g[1, 1], g[2, 2], g[0, 1] + g[1, 0], g[1, 2] + g[2, 1], g[0, 2] + g[2, 0]])

        return np.einsum("i...,ij,j...->...", strain(v), STIFF, strain(u))

    stiffness = along_axes if anisotropic else linear_elasticity(*lame_parameters(E, NU))
    order = np.empty(basis.N, dtype=int)  # of ours: the dof of scikit-fem
    for dofs in (basis.nodal_dofs, basis.edge_dofs):
        for row in dofs.T if dofs.size else []:
            node = int(np.argmin(np.linalg.norm(x - basis.doflocs[:, row[0]], axis=1)))
            order[3 * node : 3 * node + 3] = row
    K, M = (form.assemble(basis).toarray()[np.ix_(order, order)] for form in (stiffness, inertia))
    return Bar(kind, x, full, K, M)


@dataclass
class Reference:
    """K and M of scikit-fem with six motions more for each reference node; rows of constraints C u = 0."""

    bar: Bar
    references: int = 0
    rows: list[np.ndarray] = field(default_factory=list)

    def __post_init__(self):
        self.n = self.bar.K.shape[0] + 6 * self.references
        self.K, self.M = np.zeros((self.n, self.n)), np.zeros((self.n, self.n))
        own = self.bar.K.shape[0]
        self.K[:own, :own], self.M[:own, :own] = self.bar.K, self.bar.M

    def at(self, node: int, c: int) -> int:
        """Node −1, −2 …: the reference nodes."""
        return 3 * node + c if node >= 0 else self.bar.K.shape[0] + 6 * (-1 - node) + c

    def relation(self, *terms: tuple[int, int, float]) -> None:
        row = np.zeros(self.n)
        for node, c, value in terms:
            row[self.at(node, c)] += value
        self.rows.append(row)

    def hold(self, nodes, components=(0, 1, 2), axes=None) -> None:
        for node in nodes:
            for c in components:
                direction = np.eye(3)[c] if axes is None else axes[:, c]
                self.relation(*((node, k, direction[k]) for k in range(3)))

    def rigid(self, nodes, place, components=(0, 1, 2)) -> None:
        """Nodes follow reference −1 at a place."""
        for node in nodes:
            S = lever(self.bar.x[node] - place)
            for c in components:
                self.relation((node, c, -1.0), *((-1, k, S[c, k]) for k in range(6)))

    def average(self, nodes, place) -> None:
        levers = np.array([lever(self.bar.x[node] - place) for node in nodes])
        fit = np.linalg.solve(np.einsum("nij,nik->jk", levers, levers), np.concatenate(levers).T)
        for k in range(6):
            self.relation(
                (-1, k, -1.0), *((node, c, fit[k, 3 * i + c]) for i, node in enumerate(nodes) for c in range(3))
            )

    def mass(self, node: int, mass: float, offset=(0, 0, 0), inertia=(0, 0, 0)) -> None:
        S = lever(np.array(offset, float))
        own = mass * S.T @ S
        own[3:, 3:] += np.diag(inertia)
        at = [self.at(node, c) for c in range(6 if node < 0 else 3)]
        self.M[np.ix_(at, at)] += own[: len(at), : len(at)]

    def spring(self, k: float, *ends: tuple[int, int]) -> None:
        row = np.zeros(self.n)
        for sign, (node, c) in zip((1.0, -1.0), ends, strict=False):
            row[self.at(node, c)] = sign
        self.K += k * np.outer(row, row)

    def frequencies(self) -> np.ndarray:
        Z = null_space(np.array(self.rows))
        values = eigh(Z.T @ self.K @ Z, Z.T @ self.M @ Z, eigvals_only=True)[:10]
        return np.sqrt(values) / (2 * np.pi)

    def total(self) -> float:
        x = np.zeros(self.n)
        x[: self.bar.K.shape[0] : 3] = 1
        x[self.bar.K.shape[0] :: 6] = 1
        return float(x @ self.M @ x)


def lever(r: np.ndarray) -> np.ndarray:
    """u_i = u + θ × r."""
    return np.hstack([np.eye(3), [[0, r[2], -r[1]], [-r[2], 0, r[0]], [r[1], -r[0], 0]]])


PLACE = np.array([1.2, 0.1, 0.05])
"""Of a reference node."""
T = np.array([[0.6, -0.8, 0.0], [0.8, 0.6, 0.0], [0.0, 0.0, 1.0]])
"""Axes of a system, in its columns."""


def plain(own: Bar) -> Reference:
    found = Reference(own)
    found.hold(own.root)
    return found


def with_reference(own: Bar) -> Reference:
    found = Reference(own, 1)
    found.hold(own.root)
    return found


def rigid_tip(own: Bar, components=(0, 1, 2)) -> Reference:
    found = with_reference(own)
    found.rigid(own.tip, PLACE, components)
    found.mass(-1, 20.0, (0.1, 0.0, 0.02), (0.5, 0.4, 0.3))
    return found


def averaged(own: Bar) -> Reference:
    found = with_reference(own)
    found.average(own.tip, PLACE)
    found.mass(-1, 20.0, inertia=(0.5, 0.4, 0.3))
    return found


def centred(own: Bar) -> Reference:
    found = with_reference(own)
    found.rigid(own.tip, PLACE)
    found.mass(-1, 20.0, inertia=(0.5, 0.4, 0.3))
    return found


def related(own: Bar) -> Reference:
    found, (a, b) = plain(own), own.tip[:2]
    found.relation((a, 0, 1.0), (b, 0, -0.5), (b, 2, 0.25))
    return found


def sprung(own: Bar) -> Reference:
    found, (a, b) = plain(own), own.tip[:2]
    found.spring(3e7, (a, 1))
    found.spring(2e8, (a, 2), (b, 2))
    return found


def anisotropic(own: Bar) -> Reference:
    return plain(bar(own.kind, anisotropic=True))


def barred(own: Bar) -> Reference:
    """Nodes of the tip follow one of them."""
    found = with_reference(own)
    found.rigid(own.tip[:4], own.x[own.tip[0]])
    return found


