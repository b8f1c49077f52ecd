"""Mass and ten frequencies of a Nastran bar with ties, masses and springs, beside scikit-fem with its own form of them."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
import skfem
from scipy.linalg import eigh, null_space
from skfem.models.elasticity import lame_parameters, linear_elasticity

from strainsight.decks.reader import read_mesh
from strainsight.fem.mass import mass_properties

from ..solids import CUTS, HEX, TET, TET_EDGES
from .programs import frequencies

E, NU, RHO = 2.1e11, 0.3, 7850.0
CELLS = (2, 1, 1)
SHEARED = np.array([[1.0, 0.05, 0.0], [0.0, 0.3, 0.02], [0.0, 0.0, 0.2]])
PLACE = np.array([1.2, 0.1, 0.05])
"""Of the reference node."""


@cache
def bar():
    """x (n, 3) [m], tet10 with nodes in VTK order, and K, M of scikit-fem, node after node."""
    corners, cells = {}, []
    for first in np.ndindex(*CELLS):
        box = [tuple(np.add(first, corner)) for corner in HEX]
        cells += [[corners.setdefault(box[i], len(corners)) for i in cut] for cut in CUTS[TET]]
    points, middle, full = list(corners), {}, []
    for cell in cells:
        for a, b in TET_EDGES:
            if frozenset((cell[a], cell[b])) not in middle:
                middle[frozenset((cell[a], cell[b]))] = len(points)
                points.append((np.array(points[cell[a]]) + points[cell[b]]) / 2)
        full.append(cell + [middle[frozenset((cell[a], cell[b]))] for a, b in TET_EDGES])
    x = np.array(points) / CELLS @ SHEARED.T
    mesh = skfem.MeshTet(x[: len(corners)].T, np.array(cells).T)
    basis = skfem.Basis(mesh, skfem.ElementVector(skfem.ElementTetP2()), intorder=6)
    order = np.empty(basis.N, dtype=int)
    for row in (*basis.nodal_dofs.T, *basis.edge_dofs.T):
        node = int(np.argmin(np.linalg.norm(x - basis.doflocs[:, row[0]], axis=1)))
        order[3 * node : 3 * node + 3] = row
    inertia = skfem.BilinearForm(lambda u, v, _: RHO * (u[0] * v[0] + u[1] * v[1] + u[2] * v[2]))
    forms = linear_elasticity(*lame_parameters(E, NU)), inertia
    return x, full, *(form.assemble(basis).toarray()[np.ix_(order, order)] for form in forms)


def lever(r):
    """u_i = u + θ × r."""
    return np.hstack([np.eye(3), [[0, r[2], -r[1]], [-r[2], 0, r[0]], [r[1], -r[0], 0]]])


class Reference:
    """K and M of scikit-fem with six motions more of a node at PLACE; rows of constraints C u = 0."""

    def __init__(self):
        self.x, _, K, M = bar()
        self.n = len(K)
        self.K, self.M = (np.pad(matrix, (0, 6)) for matrix in (K, M))
        place = np.round(np.linalg.solve(SHEARED, self.x.T)[0], 9)
        self.tip = np.flatnonzero(place == 1)
        self.rows = [np.eye(self.n + 6)[3 * node + c] for node in np.flatnonzero(place == 0) for c in range(3)]

    def relation(self, reference, *terms):
        """Σ value u of (node, component, value), and `reference` (6,) of the motions at PLACE."""
        row = np.r_[np.zeros(self.n), reference]
        for node, c, value in terms:
            row[3 * node + c] += value
        return row

    def rigid(self):
        for node in self.tip:
            self.rows += [self.relation(s, (node, c, -1.0)) for c, s in enumerate(lever(self.x[node] - PLACE))]

    def average(self):
        levers = np.array([lever(self.x[node] - PLACE) for node in self.tip])
        fit = np.linalg.solve(np.einsum("nij,nik->jk", levers, levers), np.concatenate(levers).T)
        for k, row in enumerate(fit.reshape(6, -1, 3)):
            terms = [(node, c, row[i, c]) for i, node in enumerate(self.tip) for c in range(3)]
            self.rows.append(self.relation(-np.eye(6)[k], *terms))

    def mass(self, mass, offset, inertia):
        S = lever(np.array(offset, float))
        self.M[self.n :, self.n :] += mass * S.T @ S + np.diag([0, 0, 0, *inertia])

    def spring(self, k, *ends):
        row = self.relation(np.zeros(6), *ends)
        self.K += k * np.outer(row, row)

    def frequencies(self):
        """Motions without mass and stiffness are left out."""
        moved = np.abs(self.M).sum(axis=1) > 0
        Z = null_space(np.vstack([*self.rows, *np.eye(self.n + 6)[~moved]]))
        return np.sqrt(eigh(Z.T @ self.K @ Z, Z.T @ self.M @ Z, eigvals_only=True)[:10]) / (2 * np.pi)


def deck(*more):
    """GRID 5, 8, … of the bar, held at its root, and other cards, each a list of its fields."""
    x, cells, *_ = bar()
    cards = [["GRID", 5 + 3 * i, "", *place] for i, place in enumerate(x.tolist())]
    cards += [["CTETRA", e, 1, *(5 + 3 * i for i in cell)] for e, cell in enumerate(cells, start=1)]
    cards += [["PSOLID", 1, 1], ["MAT1", 1, E, "", NU, RHO], ["GRID", 900, "", *PLACE.tolist()]]
    root = np.flatnonzero(np.abs(np.linalg.solve(SHEARED, x.T)[0]) < 1e-9)
    lines = []
    for card in (*cards, ["SPC1", 1, 123, *(5 + 3 * root)], *more):
        words = [repr(field) if isinstance(field, float) else str(field) for field in card]
        lines += [",".join(words[:9]), *("," + ",".join(words[i : i + 8]) for i in range(9, len(words), 8))]
    control = ["MPC = 2"] * any(card[0] == "MPC" for card in more)
    return "\n".join(["SOL 103", "CEND", "SPC = 1", *control, "BEGIN BULK", *lines, "ENDDATA", ""])


def rigid_tip():
    reference = Reference()
    reference.rigid()
    reference.mass(20.0, (0.1, 0.0, 0.02), (0.5, 0.4, 0.3))
    mass = ["CONM2", 901, 900, "", 20.0, 0.1, 0.0, 0.02, "", 0.5, "", 0.4, "", "", 0.3]
    return reference, [["RBE2", 9, 900, 123, *(5 + 3 * reference.tip)], mass]


def averaged():
    reference = Reference()
    reference.average()
    reference.mass(20.0, (0, 0, 0), (0.5, 0.4, 0.3))
    mass = ["CONM2", 901, 900, "", 20.0, "", "", "", "", 0.5, "", 0.4, "", "", 0.3]
    return reference, [["RBE3", 9, "", 900, 123456, 1.0, 123, *(5 + 3 * reference.tip)], mass]


def sprung_and_related():
    reference = Reference()
    a, b = reference.tip[:2]
    reference.spring(3e7, (a, 1, 1.0))
    reference.spring(2e8, (a, 2, 1.0), (b, 2, -1.0))
    reference.rows.append(reference.relation(np.zeros(6), (a, 0, 1.0), (b, 0, -0.5), (b, 2, 0.25)))
    a, b = 5 + 3 * a, 5 + 3 * b
    springs = [["CELAS2", 91, 3e7, a, 2], ["CELAS1", 92, 93, a, 3, b, 3], ["PELAS", 93, 2e8]]
    return reference, [*springs, ["MPC", 2, a, 1, 1.0, b, 1, -0.5, "", "", b, 3, 0.25]]


@pytest.mark.parametrize("make", [rigid_tip, averaged, sprung_and_related])
def test_mass_and_frequencies_match_scikit_fem(tmp_path, make):
    expected, cards = make()
    (tmp_path / "bar.bdf").write_text(deck(*cards))
    mesh = read_mesh(tmp_path / "bar.bdf")
    assert not mesh.unsupported
    along = np.r_[np.tile([1.0, 0, 0], expected.n // 3), 1, np.zeros(5)]
    assert mass_properties(mesh)[0] == pytest.approx(along @ expected.M @ along, rel=1e-9)
    assert frequencies(mesh, 10) == pytest.approx(expected.frequencies(), rel=1e-8)
