"""Write angle.bdf.gz and angle.sha256: a bracket of bent steel plate with a lightening hole, hex20, in mm, t and s.

A plate of 70 × 10 mm is clamped at its lower end, z = 0, stands 150 mm along z, turns by 90° about an axis along y with 20 mm to
its middle plane, and goes on for 110 mm along x. In the middle of the upright part, 60 mm above the clamp, is a hole of 30 mm in
diameter.

The mesh is made in the plane of the plate, s along it from the clamp, y across, t out of the bend, and then bent. Two elements
lie across the plate: with one, full integration makes torsion too stiff, and frequencies 0.8 % too high. `solids(2)` has elements
of half the size in the plane, and `tetrahedra` cuts them: a mesh for another program that shares nodes with this one.

Sets of nodes: 11 the surface for gauges, both faces of the plate; 21 the clamp; 22 the four nodes that an unknown load acts on,
on top near a corner of the free end; 23 those of a shaker, outside on the upright part.
"""

from __future__ import annotations

import gzip
import hashlib
import math
import sys
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

WIDTH, THICKNESS = 70.0, 10.0
UPRIGHT, BEND, ARM = 150.0, 20.0, 110.0
ARC = BEND * math.pi / 2
HOLE, RADIUS, SQUARE = 60.0, 15.0, 25.0
"""s of the centre of the hole, its radius, half the side of the square of elements about it."""
LENGTHS = (
    (0.0, HOLE - SQUARE, 3),
    (HOLE - SQUARE, HOLE + SQUARE, 4),
    (HOLE + SQUARE, UPRIGHT, 5),
    (UPRIGHT, UPRIGHT + ARC, 6),
)
"""From, to and number of elements along s; the arm follows."""
ALONG = (*LENGTHS, (UPRIGHT + ARC, UPRIGHT + ARC + ARM, 9))
ACROSS = ((-WIDTH / 2, -SQUARE, 1), (-SQUARE, SQUARE, 4), (SQUARE, WIDTH / 2, 1))
RINGS, LAYERS = 2, 2
FIRST_NODE, DECIMALS = 101, 6
CORNERS = [(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0), (0, 0, 2), (2, 0, 2), (2, 2, 2), (0, 2, 2)]
EDGES = [(0, 1), (1, 2), (2, 3), (3, 0), (0, 4), (1, 5), (2, 6), (3, 7), (4, 5), (5, 6), (6, 7), (7, 4)]
STEPS = np.array(CORNERS + [tuple((np.array(CORNERS[a]) + CORNERS[b]) // 2) for a, b in EDGES])
"""Half steps from an element's first corner to its nodes in Nastran's order."""


@dataclass(frozen=True)
class Plate:
    """flat (n, 3) [mm] s, y, t of every point of the lattice by halves, corners, middles of sides, faces and elements; position
    (n, 3) [mm] of the bent plate; cells (e, 3, 3, 3) the points of every element by halves along s or outward, y or around, t;
    faces: lattices (a, b) of the points on t = +THICKNESS/2 of the parts without hole."""

    flat: np.ndarray
    position: np.ndarray
    cells: np.ndarray
    faces: list[np.ndarray]


def bent(flat: np.ndarray) -> np.ndarray:
    """Points (…, 3) of the flat plate where they are in the bracket."""
    s, y, t = np.moveaxis(flat, -1, 0)
    turn = np.clip((s - UPRIGHT) / BEND, 0, math.pi / 2)
    beyond = np.maximum(s - UPRIGHT - ARC, 0)
    x = BEND - (BEND + t) * np.cos(turn) + beyond
    z = np.minimum(s, UPRIGHT) + (BEND + t) * np.sin(turn)
    return np.stack([x, y, z], axis=-1)


def rectangle(s: tuple[float, float, int], y: tuple[float, float, int], finer: int) -> np.ndarray:
    """Lattice of a part by halves (a, b, 2)."""
    axes = [np.linspace(start, stop, 2 * finer * count + 1) for start, stop, count in (s, y)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)


def rings(finer: int) -> list[np.ndarray]:
    """Four lattices (a, b, 2) from the hole outward to its square."""
    share = np.linspace(0, 1, 2 * finer * RINGS + 1)[:, None, None]
    corners = [(1, -1), (1, 1), (-1, 1), (-1, -1), (1, -1)]
    found = []
    for p, q in pairwise(corners):
        outer = SQUARE * np.linspace(p, q, 2 * finer * 4 + 1)
        first = math.atan2(p[1], p[0])
        angle = np.linspace(first, first + math.pi / 2, len(outer))
        inner = RADIUS * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        found.append(inner + share * (outer - inner) + (HOLE, 0.0))
    return found


def solids(finer: int = 1) -> Plate:
    """The plate in elements of 1/`finer` of the size, but across it."""
    middle = ALONG[1], ACROSS[1]
    flats = [rectangle(s, y, finer) for s in ALONG for y in ACROSS if (s, y) != middle]
    depth = np.linspace(-THICKNESS / 2, THICKNESS / 2, 2 * LAYERS + 1)
    blocks = []
    for lattice in (*flats, *rings(finer)):
        block = np.empty((*lattice.shape[:2], len(depth), 3))
        block[..., :2], block[..., 2] = lattice[:, :, None], depth
        blocks.append(block)
    points = np.rint(np.concatenate([b.reshape(-1, 3) for b in blocks]) * 10**DECIMALS).astype(np.int64)
    unique, index = np.unique(points, axis=0, return_inverse=True)
    flat, at = unique / 10**DECIMALS, 0
    cells, faces = [], []
    for block in blocks:
        own = index.reshape(-1)[at : at + block[..., 0].size].reshape(block.shape[:3])
        at += own.size
        first = 2 * np.array(list(np.ndindex(*((n - 1) // 2 for n in own.shape))))
        steps = np.stack(np.meshgrid(*[np.arange(3)] * 3, indexing="ij"), axis=-1)
        cells.append(own[tuple(np.moveaxis(first[:, None, None, None] + steps, -1, 0))])
        faces.append(own[:, :, -1])
    return Plate(flat, bent(flat), np.concatenate(cells), faces[: len(flats)])


def hexahedra(plate: Plate) -> np.ndarray:
    """hex20 (e, 20) of points of the plate."""
    return plate.cells[:, STEPS[:, 0], STEPS[:, 1], STEPS[:, 2]]


def tetrahedra(plate: Plate) -> np.ndarray:
    """tet10 (6 e, 10) of points of the plate, in CalculiX's order: corners, then middles of sides 12 23 31 14 24 34.

    Every element is two prisms, and a prism three tetrahedra, its sides cut from the corner with the lowest number, so that
    neighbours agree (Dompierre et al., How to subdivide pyramids, prisms and hexahedra into tetrahedra, 1999).
    """
    found = []
    for cell in plate.cells:
        for sides in (((0, 0), (2, 0), (2, 2)), ((0, 0), (2, 2), (0, 2))):
            where = [(*side, level) for level in (0, 2) for side in sides]
            for four in _cut([int(cell[w]) for w in where]):
                ends = [np.array(where[k]) for k in four]
                middles = [(ends[a] + ends[b]) // 2 for a, b in ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3))]
                found.append([cell[tuple(w)] for w in (*ends, *middles)])
    return np.array(found)


def _cut(corner: list[int]) -> list[list[int]]:
    """Corners of three tetrahedra in a prism of six corners with these numbers."""
    # the six ways to look at a prism, by which corner comes first
    views = (
        (0, 1, 2, 3, 4, 5),
        (1, 2, 0, 4, 5, 3),
        (2, 0, 1, 5, 3, 4),
        (3, 5, 4, 0, 2, 1),
        (4, 3, 5, 1, 0, 2),
        (5, 4, 3, 2, 1, 0),
    )
    v = views[int(np.argmin(corner))]
    c = [corner[k] for k in v]
    if min(c[1], c[5]) < min(c[2], c[4]):
        fours = ((0, 1, 2, 5), (0, 1, 5, 4), (0, 4, 5, 3))
    else:
        fours = ((0, 1, 2, 4), (0, 4, 2, 5), (0, 4, 5, 3))
    return [[v[k] for k in four] for four in fours]


def patch(plate: Plate, s: tuple[float, float], y: tuple[float, float]) -> np.ndarray:
    """The corners (4,) of one element of the coarse mesh on the outer face."""
    places = np.array([(a, b, THICKNESS / 2) for a in s for b in y])
    distance = np.linalg.norm(plate.flat[:, None] - places, axis=2)
    if distance.min(axis=0).max() > 1e-5:
        raise ValueError("no node there")
    return np.argmin(distance, axis=0)


def sets(plate: Plate) -> dict[int, tuple[str, np.ndarray]]:
    """Number → what it is, and the nodes."""
    s, _, t = plate.flat.T
    end = UPRIGHT + ARC + ARM
    size, below = ARM / 9, (UPRIGHT - HOLE - SQUARE) / 5
    return {
        11: ("surface for gauges: both faces of the plate", np.flatnonzero(np.isclose(np.abs(t), THICKNESS / 2))),
        21: ("clamp", np.flatnonzero(np.isclose(s, 0))),
        22: ("unknown load", patch(plate, (end - 2 * size, end - size), (SQUARE / 2, SQUARE))),
        23: ("shaker", patch(plate, (UPRIGHT - below, UPRIGHT), (-SQUARE, -SQUARE / 2))),
    }


def card(name: str, *fields: object) -> list[str]:
    """One card in small fields, eight to a line."""
    texts = [str(f) for f in fields]
    rows = [texts[i : i + 8] for i in range(0, len(texts), 8)]
    heads = [name.ljust(8)] + ["+".ljust(8)] * (len(rows) - 1)
    return [(head + "".join(text.rjust(8) for text in row)).rstrip() for head, row in zip(heads, rows, strict=True)]


def deck(plate: Plate) -> str:
    """The whole deck."""
    elements = hexahedra(plate)
    used = np.unique(elements)
    ids = np.zeros(len(plate.flat), dtype=np.int64)
    ids[used] = FIRST_NODE + np.arange(len(used))
    lines = [
        "$ Angle bracket of steel, hex20; units mm, t, s, N. Written by make_angle.py.",
        "SOL 103",
        "CEND",
        "TITLE = ANGLE",
        "SPC = 1",
        "METHOD = 1",
        "BEGIN BULK",
    ]
    lines += card("EIGRL", 1, "", "", 10)
    lines += card("MAT1", 1, "210000.", "", "0.3", "7.85E-9")
    lines += card("PSOLID", 1, 1)
    for node in used:
        first, second, third = (f"{float(v) + 0.0:16.{DECIMALS}f}" for v in plate.position[node])
        lines += [f"GRID*   {ids[node]:16d}{'':16s}{first}{second}", f"*       {third}"]
    for element, nodes in enumerate(ids[elements], start=1):
        lines += card("CHEXA", element, 1, *nodes)
    for number, (what, chosen) in sets(plate).items():
        members = np.sort(ids[chosen][ids[chosen] > 0])
        lines += [f"$ {what}", *card("SET1", number, *members)]
        if number == 21:
            lines += card("SPC1", 1, 123, *members)
    return "\n".join([*lines, "ENDDATA", ""])


def main(folder: Path) -> None:
    """Write the deck, packed, and the checksum of the packed file."""
    packed = gzip.compress(deck(solids()).encode("ascii"), 9, mtime=0)
    (folder / "angle.bdf.gz").write_bytes(packed)
    (folder / "angle.sha256").write_text(f"{hashlib.sha256(packed).hexdigest()}  angle.bdf.gz\n", encoding="ascii")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent)
