"""Write hinge.bdf.gz and hinge.sha256: the hinge of a flap on the web of a spar, of solids, shells and bars, in mm, t and s.

The web, 432 × 324 mm in the plane z = 0 and clamped along its four edges, is a laminate of 3 mm, the wall of a tank that lies
below it; six stiffeners of 4 × 24 mm run along x inside the tank, bars whose middle lies 13.5 mm below that of the web. On the
web stands a machined fitting of hexahedra: a foot of 96 × 78 × 8 mm, and in its middle a lug of 18 mm with a bore of 24 mm at
z = 63.5 mm. Two gussets of 3 mm, shells, meet lug and foot edge-on.

Where parts meet:
- Four bolts at (±36, ±27) mm. An RBE2 of each is led by the node of the web in its middle and holds the web below its washer,
  all six motions of 3 × 3 nodes; a second one, with the same leader, holds the 3 × 3 nodes of the foot above, which have three.
- Gussets share the nodes of the faces that they stand on. A solid resists no rotation of a node: on shared nodes alone a
  gusset would be hinged. An RBE3 gives every shared node the mean rotation of its neighbours on the face, in a cross of four.
- Stiffeners share the nodes of the web and have offsets.

Node 2, the middle of the bore, is the average of its face (RBE3). Pressure of the tank on the web is PLOAD2 set 7, 1 N/mm².
Properties: 1 fitting, 2 gussets, 3 web, 4 stiffeners. Fitting, gussets and stiffeners are aluminium, E = 71 GPa, ν = 0.33,
ρ = 2810 kg/m³; the web is of 16 plies of 0.1875 mm, [45/0/−45/90]2s, E1 = 140 GPa, E2 = 9 GPa, G = 5 GPa, ν12 = 0.3, ρ =
1600 kg/m³, 0° along x. Nodes are rounded to 1e-4 mm. `make_hinge.py FINER OUT` cuts every edge into so many parts; bolts hold
the same patches.
"""

from __future__ import annotations

import gzip
import hashlib
import sys
from collections.abc import Iterable
from itertools import count, pairwise, product
from pathlib import Path

import numpy as np

LENGTH, WIDTH, SKIN, PITCH = 216.0, 162.0, 3.0, 9.0
"""Of the web: half its sides, its thickness, its elements [mm]."""
STIFFENERS, BLADE = (-135.0, -81.0, -27.0, 27.0, 81.0, 135.0), (4.0, 24.0)
"""y, and width by height [mm]."""
BELOW = -(SKIN + BLADE[1]) / 2
FOOT, DEEP, SIZE = (48.0, 39.0), 8.0, 6.0
"""Half the sides of the foot, its thickness, elements of the fitting [mm]."""
LUG, EYE, BORE, NECK = 9.0, 24.0, 12.0, 30.0
"""Half the thickness of the lug, radii of its eye and bore, height of what is straight between foot and eye [mm]."""
GUSSET = 3.0
BOLTS = [(x, y) for x in (-36.0, 36.0) for y in (-27.0, 27.0)]
WASHER = 9.0
"""Half the side of the square that a bolt holds of the web; of the foot it is SIZE [mm]."""
PIN = 2
TOP = SKIN / 2 + DEEP
"""z of the upper side of the foot; the middle of the web is at 0."""
CENTRE = TOP + NECK + EYE
CROSS = ((1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1))
Place = tuple[float, float, float]


class Nodes:
    """Ids of places. What lies at one place is one node within a part; a part that shares the nodes of another asks for those."""

    def __init__(self) -> None:
        self.ids: dict[tuple[str, Place], int] = {}

    def __call__(self, part: str, x: float, y: float, z: float) -> int:
        return self.ids.setdefault((part, rounded(x, y, z)), 101 + len(self.ids))

    def of(self, part: str) -> dict[Place, int]:
        return {place: id for (own, place), id in self.ids.items() if own == part}


def rounded(x: float, y: float, z: float) -> Place:
    return (round(float(x), 4) + 0.0, round(float(y), 4) + 0.0, round(float(z), 4) + 0.0)


def even(a: float, b: float, step: float) -> np.ndarray:
    """Places from a to b, so far apart."""
    return np.linspace(a, b, round((b - a) / step) + 1)


def eye(around: int, rings: int) -> np.ndarray:
    """x, z (rings + 1, around, 2) about the bore: from its circle to a square below and the circle of the eye above."""
    quarter = np.arange(around // 4) / (around // 4)
    half = np.arange(around // 8) / (around // 8)
    turn = np.pi * np.arange(around // 2) / (around // 2)
    sides = [
        (2 * quarter - 1, -1 + 0 * quarter),
        (1 + 0 * half, half - 1),
        (np.cos(turn), np.sin(turn)),
        (-1 + 0 * half, -half),
    ]
    outer = EYE * np.hstack(sides).T
    inner = BORE * outer / np.linalg.norm(outer, axis=1, keepdims=True)
    share = np.linspace(0.0, 1.0, rings + 1)[:, None, None]
    return (1 - share) * inner + share * outer


def steps(places: np.ndarray) -> list[tuple[float, float]]:
    """Neighbours in a row."""
    return list(pairwise(places.tolist()))


def bricks(node: Nodes, size: float) -> list[tuple[int, ...]]:
    """Nodes of the hexahedra of foot and lug."""
    across = even(-LUG, LUG, size)
    foot = (even(-FOOT[0], FOOT[0], size), even(-FOOT[1], FOOT[1], size), even(SKIN / 2, TOP, size * 2 / 3))
    neck = (even(-EYE, EYE, size), across, even(TOP, TOP + NECK, size))
    found = [
        tuple(node("fitting", *own, c) for c in z for own in ((x[0], y[0]), (x[1], y[0]), (x[1], y[1]), (x[0], y[1])))
        for grid in (foot, neck)
        for x, y, z in product(*map(steps, grid))
    ]
    plane = eye(round(8 * EYE / size), round(2 * (EYE - BORE) / (1.5 * size)))
    for a, b in steps(across):
        for low, high in pairwise(plane):
            for one, two, three, four in zip(
                low, high, np.roll(high, -1, axis=0), np.roll(low, -1, axis=0), strict=True
            ):
                # z × x is y: counter-clockwise in the plane of x and z, the side of larger y comes first
                found.append(
                    tuple(node("fitting", x, y, CENTRE + z) for y in (b, a) for x, z in (one, two, three, four))
                )
    return found


def gussets(node: Nodes, size: float) -> list[tuple[int, ...]]:
    """Nodes of the quadrangles of both gussets, in the plane x = 0, and of the triangles along their slope."""
    solid = node.of("fitting")
    found = []
    rows = round(NECK / size)
    for side, i, k in product((1, -1), range(rows), range(rows)):
        ring = (
            ((i, k), (i + 1, k), (i + 1, k + 1), (i, k + 1)) if i + k < rows - 1 else ((i, k), (i + 1, k), (i, k + 1))
        )
        if i + k < rows:
            places = [rounded(0.0, side * (LUG + size * a), TOP + size * b) for a, b in ring]
            found.append(tuple(solid[own] if own in solid else node("gusset", *own) for own in places[::side]))
    return found


def beside(solid: dict[Place, int], place: Place, size: float) -> list[int]:
    """The neighbours of a node of a gusset on the faces of lug and foot that it stands on."""
    cross = [rounded(*(a + size * b for a, b in zip(place, step, strict=True))) for step in CROSS]
    return [solid[own] for own in cross if own in solid and abs(own[1]) >= LUG and own[2] >= TOP]


def ties(node: Nodes, ribs: list[tuple[int, ...]], size: float) -> list[str]:
    """RBE3 of the bore, RBE2 of the bolts, RBE3 of the rotations of gussets."""
    solid, plate = node.of("fitting"), node.of("web")
    near = 1e-3
    bore = [id for (x, _, z), id in solid.items() if abs(np.hypot(x, z - CENTRE) - BORE) < near]
    lines = _listed("RBE3", (90001, "", PIN, 123456, 1.0, 123), bore)
    for tie, (x, y) in zip(range(90011, 90019, 2), BOLTS, strict=True):
        leader = plate[x, y, 0.0]
        web = [id for (a, b, _), id in plate.items() if max(abs(a - x), abs(b - y)) < WASHER + near and id != leader]
        foot = [id for (a, b, c), id in solid.items() if max(abs(a - x), abs(b - y)) < SIZE + near and c == SKIN / 2]
        lines += _listed("RBE2", (tie, leader, 123456), web) + _listed("RBE2", (tie + 1, leader, 123), foot)
    place = {id: own for own, id in solid.items()}
    shared = sorted({own for rib in ribs for own in rib} & set(place))
    for tie, id in enumerate(shared, start=90101):
        lines += _listed("RBE3", (tie, "", id, 456, 1.0, 123), beside(solid, place[id], size))
    return lines


def deck(finer: int) -> str:
    """The whole deck, every edge of its elements cut into so many parts."""
    node = Nodes()
    size, pitch = SIZE / finer, PITCH / finer
    x, y = even(-LENGTH, LENGTH, pitch), even(-WIDTH, WIDTH, pitch)
    web = [
        tuple(node("web", *own, 0.0) for own in ((a, c), (b, c), (b, d), (a, d)))
        for (a, b), (c, d) in product(steps(x), steps(y))
    ]
    bars = [(node("web", a, own, 0.0), node("web", b, own, 0.0)) for own in STIFFENERS for a, b in steps(x)]
    hexahedra = bricks(node, size)
    ribs = gussets(node, size)
    lines = [
        "$ Hinge of a flap on the web of a spar: solids, shells and bars; units mm, t, s. Written by make_hinge.py.",
        "SOL 103",
        "CEND",
        "SPC = 1",
        "BEGIN BULK",
        f"GRID,{PIN},,0.,0.,{CENTRE}",
    ]
    lines += [f"GRID,{id},,{a},{b},{c}" for (_, (a, b, c)), id in node.ids.items()]
    own = count(1)
    lines += [f"CQUAD4,{next(own)},3,{','.join(map(str, ring))},0." for ring in web]
    for ends in bars:
        lines += [f"CBAR,{next(own)},4,{ends[0]},{ends[1]},0.,0.,1.,", f",,,0.,0.,{BELOW},0.,0.,{BELOW}"]
    for ring in ribs:
        lines.append(f"{'CQUAD4' if len(ring) == 4 else 'CTRIA3'},{next(own)},2,{','.join(map(str, ring))}")
    for brick in hexahedra:
        lines += _listed("CHEXA", (next(own), 1), brick)
    lines += ties(node, ribs, size)
    lines += [
        "PSOLID,1,1",
        f"PSHELL,2,1,{GUSSET},1,,1",
        "PCOMP,3,,,,,,,SYM",
        *(f",2,{SKIN / 16},{a}.,,2,{SKIN / 16},{b}.," for a, b in ((45, 0), (-45, 90), (45, 0), (-45, 90))),
        "PBARL,4,1,,BAR,,,,,",
        f",{BLADE[0]},{BLADE[1]}",
        "MAT1,1,7.1+4,,0.33,2.81-9",
        "MAT8,2,1.4+5,9.0+3,0.3,5.0+3,5.0+3,5.0+3,1.6-9",
        f"PLOAD2,7,1.0,1,THRU,{len(web)}",
    ]
    edge = [id for (a, b, _), id in node.of("web").items() if abs(a) == LENGTH or abs(b) == WIDTH]
    lines += _listed("SPC1", (1, 123456), edge)
    return "\n".join([*lines, "ENDDATA", ""])


def _listed(name: str, head: tuple[object, ...], nodes: Iterable[int]) -> list[str]:
    """A card in free fields, eight to a line."""
    fields = [str(own) for own in (*head, *nodes)]
    rows = [fields[i : i + 8] for i in range(0, len(fields), 8)]
    return [",".join([name if not i else "", *row]) for i, row in enumerate(rows)]


def main(folder: Path) -> None:
    """Write the deck, packed, and the checksum of the packed file."""
    packed = gzip.compress(deck(1).encode("ascii"), 9, mtime=0)
    (folder / "hinge.bdf.gz").write_bytes(packed)
    (folder / "hinge.sha256").write_text(f"{hashlib.sha256(packed).hexdigest()}  hinge.bdf.gz\n", encoding="ascii")


if __name__ == "__main__":
    if len(sys.argv) == 3:
        Path(sys.argv[2]).write_text(deck(int(sys.argv[1])), encoding="ascii")
    else:
        main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent)
