"""Solids that lack some of their mid-side nodes, beside the shape functions of elements with as many nodes as they have."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from scipy.linalg import eigh

from strainsight.errors import DeckError
from strainsight.fem.model import build_model
from strainsight.mesh.facets import exterior_facets
from strainsight.sensors.zones import admissible

from ... import solids
from ..programs import frequencies

E, NU, RHO = 2.1e11, 0.3, 7850.0
HEX, HEX_SIDES = 2.0 * np.array(solids.HEX) - 1, solids.SOLIDS["hex20"].nastran_edges
TET, TET_SIDES = np.array(solids.TET, float), solids.TET_EDGES
GAUSS = np.polynomial.legendre.leggauss(5)


def hex_functions(xi, sides):
    corner = [np.prod([(1 + xi[d] * c[d]) / 2 for d in range(3)]) for c in HEX]
    return corner, [
        np.prod([1 - xi[d] ** 2 if HEX[a][d] != HEX[b][d] else (1 + xi[d] * HEX[a][d]) / 2 for d in range(3)])
        for a, b in sides
    ]


def tet_functions(xi, sides):
    L = [1 - sum(xi), *xi]
    return list(L), [4 * L[a] * L[b] for a, b in sides]


def hex_rule():
    points, weights = GAUSS
    for at in product(range(5), repeat=3):
        yield points[list(at)], np.prod(weights[list(at)])


def tet_rule():
    points, weights = (GAUSS[0] + 1) / 2, GAUSS[1] / 2
    for at in product(range(5), repeat=3):
        u, v, w = points[list(at)]
        yield np.array([u, v * (1 - u), w * (1 - u) * (1 - v)]), np.prod(weights[list(at)]) * (1 - u) ** 2 * (1 - v)


KINDS = {"CHEXA": (HEX, HEX_SIDES, hex_functions, hex_rule), "CTETRA": (TET, TET_SIDES, tet_functions, tet_rule)}
SKEW = np.array([[0.8, 0.1, 0.0], [0.05, 0.5, 0.1], [0.0, -0.1, 1.1]])


def by_hand(name, present):
    """Frequencies of one element with the mid-side nodes `present`, its first three corners held: corner functions less half of
    those of the mid-side nodes beside them, slopes by complex steps."""
    reference, sides, functions, rule = KINDS[name]
    there = [sides[m] for m in present]

    def N(xi):
        corner, middle = functions(xi, there)
        for (a, b), value in zip(there, middle, strict=True):
            corner[a], corner[b] = corner[a] - value / 2, corner[b] - value / 2
        return np.array([*corner, *middle])

    n = len(reference) + len(there)
    lam, mu = E * NU / (1 + NU) / (1 - 2 * NU), E / 2 / (1 + NU)
    D = np.diag([2 * mu] * 3 + [mu] * 3)
    D[:3, :3] += lam
    K, M = np.zeros((2, 3 * n, 3 * n))
    for xi, weight in rule():
        slope = np.array([N(xi + 1e-30j * np.eye(3)[d]).imag / 1e-30 for d in range(3)])
        slope = np.linalg.solve(SKEW, slope)  # x = ξ · SKEW
        B = np.zeros((6, 3 * n))
        for i, (x, y, z) in enumerate(slope.T):
            B[:, 3 * i : 3 * i + 3] = [[x, 0, 0], [0, y, 0], [0, 0, z], [y, x, 0], [0, z, y], [z, 0, x]]
        H = np.kron(N(xi), np.eye(3))
        K += weight * np.linalg.det(SKEW) * B.T @ D @ B
        M += weight * np.linalg.det(SKEW) * RHO * H.T @ H
    free = np.arange(9, 3 * n)
    return np.sqrt(eigh(K[np.ix_(free, free)], M[np.ix_(free, free)], eigvals_only=True)) / 2 / np.pi


def deck(name, present, systems=""):
    reference, sides, *_ = KINDS[name]
    corners = reference @ SKEW
    middles = {m: (corners[a] + corners[b]) / 2 for m, (a, b) in enumerate(sides) if m in present}
    lines = [f"GRID,{i},,{x:.12},{y:.12},{z:.12}{systems}" for i, (x, y, z) in enumerate(corners, start=1)]
    lines += [f"GRID,{101 + m},,{x:.12},{y:.12},{z:.12}" for m, (x, y, z) in middles.items()]
    fields = ["7", "1", *map(str, range(1, len(corners) + 1))]
    fields += [str(101 + m) if m in present else "" for m in range(len(sides))]
    rows = [fields[i : i + 8] for i in range(0, len(fields), 8)]
    lines += [("," if i else f"{name},") + ",".join(row) for i, row in enumerate(rows)]
    return "\n".join([*lines, "PSOLID,1,1", f"MAT1,1,{E:.2e},,{NU},{RHO}", "SPC1,1,123,1,2,3", ""])


@pytest.mark.parametrize(
    ("name", "present"),
    [
        ("CHEXA", (0, 1, 2, 3)),
        ("CHEXA", (5, 11)),
        ("CHEXA", (0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10)),
        ("CTETRA", (2,)),
        ("CTETRA", (0, 1, 3, 4, 5)),
    ],
)
@pytest.mark.parametrize("systems", ["", ",9\nCORD2R,9,,0.,0.,0.,1.,1.,0.\n,1.,0.,0.5"], ids=["basic", "local"])
def test_partial_mid_side_nodes_match_reference_frequencies(read, name, present, systems):
    text = deck(name, present, ",9" if systems else "") + systems[systems.find("\n") + 1 :]
    expected = by_hand(name, present)
    count = min(10, len(expected) - 1)
    np.testing.assert_allclose(frequencies(read(text), count), expected[:count], rtol=1e-8)


def test_transition_element_joins_linear_and_quadratic(read):
    """Three bricks in a row, of 8, 16 and 20 nodes: the one between lacks the sides that it shares with the first."""
    points = {(x, y, z): 1 + i for i, (z, y, x) in enumerate(product(range(3), range(3), range(7)))}
    corners = [(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0), (0, 0, 2), (2, 0, 2), (2, 2, 2), (0, 2, 2)]
    used, cards = set(), []
    for e, x0 in enumerate((0, 2, 4)):
        own = [(x0 + x, y, z) for x, y, z in corners]
        nodes = [points[c] for c in own]
        if e:
            for a, b in HEX_SIDES:
                middle = tuple((own[a][d] + own[b][d]) // 2 for d in range(3))
                nodes.append("" if e == 1 and middle[0] == 2 else points[middle])
        used |= {*nodes} - {""}
        fields = [str(e + 1), "1", *map(str, nodes)]
        rows = [fields[i : i + 8] for i in range(0, len(fields), 8)]
        cards += [("," if i else "CHEXA,") + ",".join(row) for i, row in enumerate(rows)]
    grids = [f"GRID,{i},,{x / 2},{y / 2},{z / 2}" for (x, y, z), i in points.items() if i in used]
    more = ["PSOLID,1,1", f"MAT1,1,{E:.2e},,{NU},{RHO}", "SPC1,1,1,1,15,43,57", "SPC1,1,2,1,43", "SPC1,1,3,1,15", ""]
    mesh = read("\n".join([*grids, *cards, *more]))
    facets = exterior_facets(mesh)
    assert len(facets.element_id) == 14
    # a straight side is no tie that stiffens the surface: those at the held end alone have no place for a gauge
    assert sorted(np.unique(facets.element_id[admissible(mesh, facets)[0]])) == [2, 3]
    assert any("solid elements without some mid-side nodes (1 in total, first CHEXA" in note for note in mesh.notes)
    model = build_model(mesh)
    # one strain everywhere: forces at the two ends alone
    stretched = (mesh.position * [1e-3, -NU * 1e-3, -NU * 1e-3]).ravel()[model.constraint.free_rows]
    force = model.stiffness.constant @ stretched
    end = np.isin(mesh.position[model.constraint.free_rows // 3, 0], (0.0, 3.0))
    assert np.abs(force[~end]).max() < 1e-9 * np.abs(force).max()
    along = force[model.constraint.free_rows % 3 == 0].sum()
    assert along == pytest.approx(1e-3 * E, rel=1e-9)


def test_missing_corner_is_refused(read):
    with pytest.raises(DeckError, match="a node id"):
        read(deck("CTETRA", (2,)).replace("CTETRA,7,1,1,2,", "CTETRA,7,1,1,,"))


@pytest.mark.parametrize("held", ["SPC1,1,123,1,2,3\nSPC1,2,3,4,THRU,500", "SPC1,1,123,1,2,3\nSPC1,2,3,104"])
def test_added_node_ids_exceed_all_ids(read, held):
    text = deck("CTETRA", (2,)).replace("SPC1,1,123,1,2,3", held)
    if "THRU" in held:
        mesh = read(text, spc=2)
        assert mesh.node_ids.tolist()[-5:] == [501, 502, 503, 504, 505]
        assert sorted(mesh.node_ids[mesh.fixed[:, 0]].tolist()) == [4, 103]
    else:
        with pytest.raises(DeckError, match="node 104 is not in the deck"):
            read(text, spc=2)
