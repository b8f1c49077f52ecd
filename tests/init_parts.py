"""Nastran decks of small parts in mm and t: a block of tet10 with a loaded bore, a portal of shells, a crane arm with a lug."""

from __future__ import annotations

from itertools import permutations

import numpy as np

STEEL = "MAT1,1,2.1+5,,.3,7.85-9"
HEXA = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)])


def _card(*fields: object) -> str:
    words = [repr(round(field, 6)) if isinstance(field, float) else str(field) for field in fields]
    lines = [words[:9], *(["", *words[i : i + 8]] for i in range(9, len(words), 8))]
    return "\n".join(",".join(line) for line in lines)


def _grids(x: np.ndarray) -> list[str]:
    return [_card("GRID", i, "", *map(float, point)) for i, point in enumerate(x, start=1)]


def _deck(cards: list[str], loads: list[str]) -> str:
    head = ["SOL 103", "CEND", "SPC = 1", "BEGIN BULK"]
    return "\n".join([*head, *cards, STEEL, *loads, "ENDDATA", ""])


def _tet10(corners: np.ndarray, hexes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Six tetrahedra with mid-side nodes in each hexahedron (Kuhn); corners (n, 3), hexes (e, 2, 2, 2)."""
    paths = []
    for cell in hexes:
        for order in permutations(range(3)):
            at, path = [0, 0, 0], [cell[0, 0, 0]]
            for axis in order:
                at[axis] = 1
                path.append(cell[tuple(at)])
            paths.append(path)
    tets = np.array(paths)
    edge = np.linalg.det(corners[tets[:, 1:]] - corners[tets[:, :1]]) < 0
    tets[edge, 2:] = tets[edge, :1:-1]
    pairs = np.sort(tets[:, [[0, 1], [1, 2], [0, 2], [0, 3], [1, 3], [2, 3]]], axis=2)
    unique, index = np.unique(pairs.reshape(-1, 2), axis=0, return_inverse=True)
    middle = corners[unique].mean(axis=1)
    return np.vstack([corners, middle]), np.hstack([tets, len(corners) + index.reshape(-1, 6)])


def bore_block() -> str:
    """A block of 80 × 80 × 20 mm, clamped at y = −40 mm, with a bore of 30 mm. Load sets 11 and 12: 2 kN along x and −3 kN along
    y at the centre of the bore (node 9001, RBE3)."""
    around, radial, through = 16, 3, 2
    angle = np.arange(around) * 2 * np.pi / around + np.pi / around
    unit = np.column_stack([np.cos(angle), np.sin(angle)])
    outer = 40 * unit / np.abs(unit).max(axis=1, keepdims=True)
    plane = np.array([15 * unit + share * (outer - 15 * unit) for share in np.linspace(0, 1, radial + 1)])
    x = np.array([[[(*plane[j, i], z) for i in range(around)] for j in range(radial + 1)] for z in (0.0, 10.0, 20.0)])
    number = np.arange(x[..., 0].size).reshape(x.shape[:3])
    step = [(k, j, i) for k in range(through) for j in range(radial) for i in range(around)]
    hexes = np.array([number[k : k + 2, j : j + 2][:, :, [i, (i + 1) % around]] for k, j, i in step])
    nodes, tets = _tet10(x.reshape(-1, 3), hexes)
    cards = _grids(nodes) + [_card("CTETRA", e, 1, *(tet + 1)) for e, tet in enumerate(tets, start=1)]
    clamped = 1 + np.flatnonzero(np.abs(nodes[:, 1] + 40) < 1e-6)
    bore = 1 + np.flatnonzero(np.hypot(nodes[:, 0], nodes[:, 1]) < 15.01)
    cards += ["PSOLID,1,1", _card("SPC1", 1, 123, *clamped), "GRID,9001,,0.,0.,10."]
    cards += [_card("RBE3", 9002, "", 9001, 123456, 1.0, 123, *bore)]
    return _deck(cards, ["FORCE,11,9001,,2000.,1.,0.,0.", "FORCE,12,9001,,3000.,0.,-1.,0."])


def portal() -> str:
    """A portal of 1 × 0.6 m in the plane x-z of quad4 shells of 10 mm, members 100 mm wide, feet clamped, top edge guided
    in the plane; SET1 5: three nodes at x = 0, z = 500 to 600 mm. Load set 3: 1.5 kN along x at these nodes."""
    size = 50.0
    cells = [(i, k) for i in range(20) for k in range(12) if i < 2 or i >= 18 or k >= 10]
    corners = sorted({(i + a, k + b) for i, k in cells for a in (0, 1) for b in (0, 1)})
    number = {corner: n for n, corner in enumerate(corners, start=1)}
    cards = _grids(np.array([(size * i, 0.0, size * k) for i, k in corners]))
    for e, (i, k) in enumerate(cells, start=1):
        cards.append(_card("CQUAD4", e, 1, *(number[i + a, k + b] for a, b in ((0, 0), (1, 0), (1, 1), (0, 1)))))
    top = [number[corner] for corner in ((0, 10), (0, 11), (0, 12))]
    cards += ["PSHELL,1,1,10.,1,,1", _card("SPC1", 1, 123456, *(number[c] for c in corners if c[1] == 0))]
    cards += [_card("SPC1", 1, 2, *(number[c] for c in corners if c[1] == 12))]
    return _deck([*cards, _card("SET1", 5, *top)], [f"FORCE,3,{node},,500.,1.,0.,0." for node in top])


def crane_arm() -> str:
    """An arm of 1500 × 120 × 160 mm of hex8 along x, clamped at x = 0, with a lug of 120 × 40 × 160 mm at its end. Load set 1:
    5 kN along −z at the end of the lug (node 9001, RBE2); load set 2: a moment of 4e5 N mm about x there; load set 3: gravity."""
    cells = [(i, j, k) for i in range(27) for j in range(3) for k in range(4) if i < 25 or j == 1]
    corners = sorted({tuple(np.add(cell, h)) for cell in cells for h in HEXA})
    number = {corner: n for n, corner in enumerate(corners, start=1)}
    x = np.array(corners) * (60.0, 40.0, 40.0)
    cards = _grids(x)
    cards += [_card("CHEXA", e, 1, *(number[tuple(np.add(cell, h))] for h in HEXA)) for e, cell in enumerate(cells, start=1)]
    first, last = 1 + np.flatnonzero(x[:, 0] == 0), 1 + np.flatnonzero(x[:, 0] == 27 * 60.0)
    cards += ["PSOLID,1,1", _card("SPC1", 1, 123, *first), "GRID,9001,,1620.,60.,80."]
    cards += [_card("RBE2", 9002, 9001, 123456, *last)]
    return _deck(cards, ["FORCE,1,9001,,5000.,0.,0.,-1.", "MOMENT,2,9001,,4.+5,1.,0.,0.", "GRAV,3,,9810.,0.,0.,-1."])


PARTS = {"bore": bore_block, "portal": portal, "arm": crane_arm}
