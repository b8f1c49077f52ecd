"""Write lug.bdf.gz and lug.sha256: a steel lug bracket of hex20 solids with fillet welds of wedge15, in mm, t and s.

A base plate of 200 × 120 × 12 mm, z from 0 to 12 mm, with four bolt holes of 18 mm in diameter at (±78, ±36); in its middle
plane y = 0 an upright plate of 12 mm that tapers along the tangents of an eye: 30 mm in radius about (0, 0, 90), with a bore of
30 mm in diameter along y. A fillet weld of 6 mm legs runs along the four sides of the upright's foot; its corners are open.

Around each hole lie rings of elements about 2 mm in size at the rim, which grow by a factor outward; mid-side nodes are on the
circles. Bolt holes are clamped over their whole face; node 2, the centre of the bore, is the average of its face (RBE3) and
takes the load.

Sets of nodes: 11 the surface that gauges may be bonded to, all outside but the underside and the faces of the holes; 21 the
faces of the bolt holes; 22 that of the bore; 23 the crown of the eye, up to 7 mm to both sides, for a shaker; 24 the weld.
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

LENGTH, WIDTH, THICKNESS = 200.0, 120.0, 12.0
BOLT, BOLT_RADIUS = (78.0, 36.0), 9.0
FOOT, HEAD, LEG = 50.0, 55.0, 6.0
"""Half the upright's foot along x; where its trapezoid ends and the ring about the bore begins, z; legs of the weld."""
CENTRE, EYE, BORE = 90.0, 30.0, 15.0
GROWTH, RINGS = 1.4, 4
"""Of the elements' size from one ring about a hole to the next; number of rings."""
AROUND, FEET, SIDES, ARC = 6, 14, 6, 16
"""Divisions: of a side of a bolt hole's square, along the upright's foot, beside the eye, on its arc."""
CROWN = 7.0
REFERENCE, FIRST_NODE = 2, 101
DECIMALS = 6

# Half steps from an element's first corner to its nodes in Nastran's order: corners, mid-sides bottom, upright, top.
CORNERS = [(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0), (0, 0, 2), (2, 0, 2), (2, 2, 2), (0, 2, 2)]
HEX_EDGES = [(0, 1), (1, 2), (2, 3), (3, 0), (0, 4), (1, 5), (2, 6), (3, 7), (4, 5), (5, 6), (6, 7), (7, 4)]
WEDGE_EDGES = [(0, 1), (1, 2), (2, 0), (0, 3), (1, 4), (2, 5), (3, 4), (4, 5), (5, 3)]
HEX_FACES = [(0, 1, 2, 3), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)]
WEDGE_FACES = [(0, 1, 2), (3, 4, 5), (0, 1, 4, 3), (1, 2, 5, 4), (2, 0, 3, 5)]
STEPS = np.array(CORNERS + [tuple((np.array(CORNERS[a]) + CORNERS[b]) // 2) for a, b in HEX_EDGES])


@dataclass(frozen=True)
class Solids:
    """position (n, 3) [mm] rounded to 1e-6 mm, as the deck has it; hexahedra (e, 20) and wedges (w, 15), indices in Nastran's
    order."""

    position: np.ndarray
    hexahedra: np.ndarray
    wedges: np.ndarray


def halves(ends: list[float]) -> np.ndarray:
    """Ends of elements (k + 1,) and their middles between them, (2k + 1,)."""
    middles = [(a + b) / 2 for a, b in pairwise(ends)]
    return np.array([value for pair in zip(ends, middles, strict=False) for value in pair] + ends[-1:])


def even(start: float, stop: float, count: int) -> np.ndarray:
    """`count` elements of one length, by halves, (2 count + 1,)."""
    return np.linspace(start, stop, 2 * count + 1)


def grown(count: int, growth: float) -> np.ndarray:
    """Elements from 0 to 1, each longer than the one before by the factor, by halves, (2 count + 1,)."""
    ends = [(growth**k - 1) / (growth**count - 1) for k in range(count + 1)]
    return halves(ends)


def rectangle(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Lattice of a block with these coordinates by halves: (a,), (b,) → (a, b, 2)."""
    return np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1)


def on_circle(centre: tuple[float, float], radius: float, angle: np.ndarray) -> np.ndarray:
    """Points at these angles [rad], (a,) → (a, 2)."""
    return np.array([(centre[0] + radius * math.cos(t), centre[1] + radius * math.sin(t)) for t in angle.tolist()])


def ring(centre: tuple[float, float], radius: float, outer: np.ndarray, along: np.ndarray) -> np.ndarray:
    """Part of a ring: lattice (b, a, 2) on straight rays from a circle to the points outer (a, 2), anticlockwise, at the shares
    along (b,) of the rays. Angles on the circle are even between those of the first and last point."""
    first, last = (math.atan2(y - centre[1], x - centre[0]) for x, y in (outer[0], outer[-1]))
    inner = on_circle(centre, radius, np.linspace(first, last + (2 * math.pi if last < first else 0.0), len(outer)))
    return inner + along[:, None, None] * (outer - inner)


def square_ring(
    centre: tuple[float, float], radius: float, half: tuple[float, float], divisions: int, along: np.ndarray
) -> list[np.ndarray]:
    """Four parts of a ring from a circle to a rectangle of these half sides."""
    (x, y), (a, b) = centre, half
    corners = [(x + a, y - b), (x + a, y + b), (x - a, y + b), (x - a, y - b), (x + a, y - b)]
    return [ring(centre, radius, np.linspace(p, q, 2 * divisions + 1), along) for p, q in pairwise(corners)]


def base() -> list[np.ndarray]:
    """Lattices of the base plate in x, y."""
    end, side = LENGTH / 2, WIDTH / 2
    toe, edge = FOOT + LEG, THICKNESS / 2 + LEG
    x = halves([-end + (end - toe) * k / AROUND for k in range(AROUND)] + foot_ends(toe))
    x = np.concatenate([x, -x[2 * AROUND - 1 :: -1]])
    blocks = [rectangle(x, halves([-edge, -THICKNESS / 2, 0.0, THICKNESS / 2, edge]))]
    middle = x[np.abs(x) <= toe]
    for sign in (-1, 1):
        near, far = sorted((sign * edge, sign * side))
        blocks.append(rectangle(middle, even(near, far, AROUND)))
        for left in (-1, 1):
            centre, half = (left * BOLT[0], sign * BOLT[1]), ((end - toe) / 2, (side - edge) / 2)
            blocks += square_ring(centre, BOLT_RADIUS, half, AROUND, grown(RINGS, GROWTH))
    return blocks


def foot_ends(toe: float) -> list[float]:
    """x of the ends of the elements from weld toe to weld toe."""
    return [-toe, *np.linspace(-FOOT, FOOT, FEET + 1).tolist(), toe]


def tangent() -> float:
    """Angle [rad] at the eye's centre where the line from the upper end of the foot touches the eye, x > 0."""
    x, z = FOOT, THICKNESS + LEG - CENTRE
    return math.atan2(z, x) + math.acos(EYE / math.hypot(x, z))


def upright() -> list[np.ndarray]:
    """Lattices of the upright in x, z."""
    centre, along = (0.0, CENTRE), grown(RINGS, GROWTH)
    touch, foot = tangent(), THICKNESS + LEG
    right = on_circle(centre, EYE, np.array([touch]))[0]
    neck = FOOT + (right[0] - FOOT) * (HEAD - foot) / (right[1] - foot)
    left, lower = right * (-1, 1), np.array([neck, HEAD])
    x = even(-1.0, 1.0, FEET)
    trunk = np.array([[(s * (FOOT + (neck - FOOT) * t), foot + (HEAD - foot) * t) for t in even(0, 1, AROUND)] for s in x])
    return [
        rectangle(FOOT * x, even(THICKNESS, foot, 1)),
        trunk,
        ring(centre, BORE, np.linspace(lower * (-1, 1), lower, 2 * FEET + 1), along),
        ring(centre, BORE, np.linspace(lower, right, 2 * SIDES + 1), along),
        ring(centre, BORE, on_circle(centre, EYE, even(touch, math.pi - touch, ARC)), along),
        ring(centre, BORE, np.linspace(left, lower * (-1, 1), 2 * SIDES + 1), along),
    ]


def extruded(lattice: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """hex20 of a block: lattice (a, b, 2) and third coordinate (c,), by halves → (e, 20, 3)."""
    a, b, c = *lattice.shape[:2], len(depth)
    grid = np.empty((a, b, c, 3))
    grid[..., :2], grid[..., 2] = lattice[:, :, None], depth
    first = 2 * np.array(list(np.ndindex((a - 1) // 2, (b - 1) // 2, (c - 1) // 2)))
    index = first[:, None] + STEPS
    return grid[tuple(np.moveaxis(index, -1, 0))]


def weld() -> np.ndarray:
    """wedge15 of the fillet, (w, 15, 3)."""
    z, half = THICKNESS, THICKNESS / 2
    x, y = np.eye(3)[:2]
    ends = np.linspace(-FOOT, FOOT, FEET + 1).tolist()
    prisms = []
    for sign in (1, -1):
        foot, toe, up = (0.0, sign * half, z), (0.0, sign * (half + LEG), z), (0.0, sign * half, z + LEG)
        section = np.array([foot, toe, up] if sign > 0 else [foot, up, toe])
        prisms += [(section + p * x, section + q * x) for p, q in pairwise(ends)]
        foot, toe, up = (sign * FOOT, 0.0, z), (sign * (FOOT + LEG), 0.0, z), (sign * FOOT, 0.0, z + LEG)
        section = np.array([foot, up, toe] if sign > 0 else [foot, toe, up])
        prisms += [(section + p * y, section + q * y) for p, q in pairwise((-half, 0.0, half))]
    corner = np.array([np.concatenate(prism) for prism in prisms])
    middle = np.stack([(corner[:, a] + corner[:, b]) / 2 for a, b in WEDGE_EDGES], axis=1)
    return np.concatenate([corner, middle], axis=1)


def joined(hexahedra: np.ndarray, wedges: np.ndarray) -> Solids:
    """Elements with nodes of their own, (e, 20, 3) and (w, 15, 3), joined where nodes coincide."""
    points = np.rint(np.concatenate([hexahedra.reshape(-1, 3), wedges.reshape(-1, 3)]) * 10**DECIMALS).astype(np.int64)
    unique, index = np.unique(points, axis=0, return_inverse=True)
    index = index.reshape(-1)
    cut = hexahedra.shape[0] * 20
    return Solids(unique / 10**DECIMALS, index[:cut].reshape(-1, 20), index[cut:].reshape(-1, 15))


def lug() -> Solids:
    """The whole bracket."""
    layers = even(0.0, THICKNESS, 2)
    plate = [extruded(lattice, layers) for lattice in base()]
    standing = [extruded(lattice, THICKNESS / 2 - layers)[..., [0, 2, 1]] for lattice in upright()]
    return joined(np.concatenate(plate + standing), weld())


def outside(solids: Solids) -> np.ndarray:
    """Nodes on faces that belong to one element, (n,) bool."""
    owners: dict[tuple[int, ...], list[list[int]]] = {}
    for elements, faces, edges in (
        (solids.hexahedra, HEX_FACES, HEX_EDGES),
        (solids.wedges, WEDGE_FACES, WEDGE_EDGES),
    ):
        corners = 8 if faces is HEX_FACES else 6
        for face in faces:
            local = [*face, *(corners + k for k, (a, b) in enumerate(edges) if a in face and b in face)]
            for nodes in elements[:, local].tolist():
                owners.setdefault(tuple(sorted(nodes[: len(face)])), []).append(nodes)
    found = np.zeros(len(solids.position), dtype=bool)
    found[[node for faces in owners.values() if len(faces) == 1 for node in faces[0]]] = True
    return found


def sets(solids: Solids) -> dict[int, tuple[str, np.ndarray]]:
    """Number → what it is, and the nodes (n,) bool."""
    x, y, z = solids.position.T
    slack = 10.0 ** (1 - DECIMALS)
    plate, standing = z <= THICKNESS, z > THICKNESS
    bolts = plate & (np.abs(np.hypot(np.abs(x) - BOLT[0], np.abs(y) - BOLT[1]) - BOLT_RADIUS) < slack)
    bore = standing & (np.abs(np.hypot(x, z - CENTRE) - BORE) < slack)
    crown = standing & (np.abs(np.hypot(x, z - CENTRE) - EYE) < slack) & (z > CENTRE) & (np.abs(x) <= CROWN)
    hidden = (bolts & (z < THICKNESS)) | (bore & (np.abs(y) < THICKNESS / 2))
    hidden |= (z == 0) & (np.abs(x) < LENGTH / 2) & (np.abs(y) < WIDTH / 2)
    return {
        11: ("surface for gauges: all outside but the underside and the faces of the holes", outside(solids) & ~hidden),
        21: ("faces of the bolt holes", bolts),
        22: ("face of the bore", bore),
        23: ("crown of the eye", crown),
        24: ("weld", np.isin(np.arange(len(x)), solids.wedges)),
    }


def card(name: str, *fields: object) -> list[str]:
    """One card in small fields, eight to a line."""
    texts = [str(f) for f in fields]
    rows = [texts[i : i + 8] for i in range(0, len(texts), 8)]
    heads = [name.ljust(8)] + ["+".ljust(8)] * (len(rows) - 1)
    return [(head + "".join(text.rjust(8) for text in row)).rstrip() for head, row in zip(heads, rows, strict=True)]


def grid(number: int, x: np.ndarray) -> list[str]:
    """A GRID in large fields."""
    first, second, third = (f"{float(v) + 0.0:16.{DECIMALS}f}" for v in x)
    return [f"GRID*   {number:16d}{'':16s}{first}{second}", f"*       {third}"]


def ranges(ids: np.ndarray) -> list[object]:
    """Ascending ids with THRU for runs of three and more."""
    fields: list[object] = []
    for run in np.split(ids, np.flatnonzero(np.diff(ids) > 1) + 1):
        fields += [run[0], "THRU", run[-1]] if len(run) > 2 else list(run)
    return fields


def deck(solids: Solids) -> str:
    """The whole deck."""
    ids = FIRST_NODE + np.arange(len(solids.position))
    members = sets(solids)
    lines = [
        "$ Lug bracket of steel, 200 x 120 x 120 mm, hex20 and wedge15; units mm, t, s, N. Written by make_lug.py.",
        "SOL 103",
        "CEND",
        "TITLE = LUG",
        "SPC = 1",
        "METHOD = 1",
        "BEGIN BULK",
    ]
    lines += card("EIGRL", 1, "", "", 10)
    lines += card("MAT1", 1, "210000.", "", "0.3", "7.85E-9")
    lines += card("PSOLID", 1, 1)
    lines += ["$ centre of the bore, loaded", *grid(REFERENCE, np.array([0.0, 0.0, CENTRE]))]
    for number, x in zip(ids, solids.position, strict=True):
        lines += grid(number, x)
    for element, nodes in enumerate(ids[solids.hexahedra], start=1):
        lines += card("CHEXA", element, 1, *nodes)
    for element, nodes in enumerate(ids[solids.wedges], start=len(solids.hexahedra) + 1):
        lines += card("CPENTA", element, 1, *nodes)
    lines += card("SPC1", 1, 123, *ids[members[21][1]])
    number = len(solids.hexahedra) + len(solids.wedges) + 1
    lines += card("RBE3", number, "", REFERENCE, 123456, "1.", 123, *ids[members[22][1]])
    for number, (what, chosen) in members.items():
        lines += [f"$ {what}", *card("SET1", number, *ranges(ids[chosen]))]
    return "\n".join([*lines, "ENDDATA", ""])


def main(folder: Path) -> None:
    """Write the deck, packed, and the checksum of the packed file."""
    packed = gzip.compress(deck(lug()).encode("ascii"), 9, mtime=0)
    (folder / "lug.bdf.gz").write_bytes(packed)
    (folder / "lug.sha256").write_text(f"{hashlib.sha256(packed).hexdigest()}  lug.bdf.gz\n", encoding="ascii")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent)
