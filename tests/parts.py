"""Nastran decks of three parts with places that no hand reaches, in mm, t and s, and where these places are.

Knuckle of tet10: two eyes joined by an arm; a pin of 70 mm loads the right bore, half of the left bore is clamped by a bolt of
40 mm. Welded frame of shells: a box column with caps, a box beam with a cap welded to it, and a fin that stands out. Crane arm of
tet10: a box with a closed void, and a lug whose pin of 30 mm pulls at half of its bore.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from .bodies import body

Chart = Callable[[float, float, float], tuple[float, float, float]]
Block = tuple[tuple[int, int, int], Chart, Callable[..., bool]]
STEEL = "MAT1,1,210000.,,0.3,7.85-9\n"
EYES, HALF, DEEP, PIN, BOLT = 150.0, 60.0, 40.0, 35.0, 20.0
"""Knuckle: centres of the eyes at ±x; half their width; depth; radii of the bores."""
ARM, LUG, RADIUS = (480.0, 120.0, 80.0), 60.0, 15.0
"""Crane arm: lengths along x, y and z; half the width of the lug; radius of its bore."""
CELL, WALL = 20.0, 5.0
"""Frame: size and thickness of the shells."""
BOXES = ((0, 5), (0, 5), (0, 24)), ((5, 20), (0, 5), (12, 17))
"""Frame: column and beam, in cells."""


def whole(*cell: int) -> bool:
    return True


def eye(x: float, bore: float, half: float, cells: tuple[int, int, int], depth: float) -> Iterator[Block]:
    """The four sides of a square about (x, 0) with a bore: cells along a side, outward, and in depth."""
    around, rings, layers = cells
    for turn in range(4):

        def chart(u: float, v: float, w: float, turn: int = turn) -> tuple[float, float, float]:
            angle, share = np.pi / 2 * (u / around - 0.5), (v / rings) ** 1.2
            on_circle, on_side = bore * np.array([np.cos(angle), np.sin(angle)]), half * np.array([1, 2 * u / around - 1])
            p, q = (1 - share) * on_circle + share * on_side
            return (x + (p, q, -p, q)[turn], (q, p, q, -p)[turn], depth * w / layers)

        yield cells, chart, whole


def bar(low: Sequence[float], size: Sequence[float], cells: tuple[int, int, int], keep: Callable[..., bool] = whole) -> Block:
    """A box, of which some cells may be missing."""
    return cells, lambda *u: tuple(a + s * x / n for a, s, x, n in zip(low, size, u, cells, strict=True)), keep


def merged(*blocks: Block) -> tuple[np.ndarray, np.ndarray]:
    """Nodes (n, 3) and tet10 (e, 10) in Nastran's order of blocks that meet at common nodes."""
    places, rows, count = [], [], 0
    for counts, chart, keep in blocks:
        mesh = body("tet10", counts, chart, keep)
        nodes = mesh.blocks[0].nodes
        a, b, c, d = (mesh.position[nodes[:, k]] for k in range(4))
        turned = np.sum(np.cross(b - a, c - a) * (d - a), axis=1) < 0
        rows.append(count + np.where(turned[:, None], nodes[:, [0, 2, 1, 3, 6, 5, 4, 7, 9, 8]], nodes))
        places.append(mesh.position)
        count += len(mesh.position)
    x = np.concatenate(places)
    _, first, index = np.unique(np.round(x, 5), axis=0, return_index=True, return_inverse=True)
    return x[first], index.ravel()[np.concatenate(rows)]


def cards(x: np.ndarray, card: str, elements: np.ndarray) -> str:
    grids = "".join(f"GRID*,{i},,{a:.9g},{b:.9g}\n*,{c:.9g}\n" for i, (a, b, c) in enumerate(x.tolist(), start=1))
    rows = ([card, str(i), "1", *map(str, (row + 1).tolist())] for i, row in enumerate(elements, start=1))
    return grids + "".join(",".join(row[:9]) + "".join(f"\n+,{','.join(row[9:])}" * (len(row) > 9)) + "\n" for row in rows)


def listed(card: str, nodes: np.ndarray) -> str:
    return "".join(f"{card},{node + 1}\n" for node in nodes.tolist())


def deck(case: str, bulk: str) -> str:
    return f"SOL 101\nCEND\nSPC=1\n{case}BEGIN BULK\n{STEEL}{bulk}ENDDATA\n"


def knuckle() -> str:
    arm = bar((HALF - EYES, -HALF, 0), (2 * (EYES - HALF), 2 * HALF, DEEP), (9, 6, 2))
    x, rows = merged(*eye(EYES, PIN, HALF, (6, 3, 2), DEEP), *eye(-EYES, BOLT, HALF, (6, 3, 2), DEEP), arm)
    held = np.flatnonzero((np.hypot(x[:, 0] + EYES, x[:, 1]) < BOLT + 1e-3) & (x[:, 0] < -EYES + 1e-3))
    return deck("", "PSOLID,1,1\n" + cards(x, "CTETRA", rows) + listed("SPC1,1,123", held))


def in_eye(x: np.ndarray) -> np.ndarray:
    """Whether points (m, 3) [m] are in a bore of the knuckle."""
    x = 1e3 * x
    return np.minimum(np.hypot(x[:, 0] - EYES, x[:, 1]) - PIN, np.hypot(x[:, 0] + EYES, x[:, 1]) - BOLT) < 1.0


def crane_arm() -> str:
    long, wide, high = ARM

    def wall(i: int, j: int, k: int) -> bool:
        return i in (0, 11) or j in (0, 5) or k in (0, 3)

    x, rows = merged(bar((0, -wide / 2, 0), ARM, (12, 6, 4), wall), *eye(long + LUG, RADIUS, LUG, (6, 4, 4), high))
    pulled = np.flatnonzero((np.hypot(x[:, 0] - long - LUG, x[:, 1]) < RADIUS + 1e-3) & (x[:, 0] > long + LUG - 1e-3))
    forces = "".join(f"FORCE,2,{node + 1},,{5000 / len(pulled):.6f},0.,1.,0.\n" for node in pulled.tolist())
    held = listed("SPC1,1,123", np.flatnonzero(x[:, 0] < 1e-3))
    return deck("LOAD=2\n", "PSOLID,1,1\n" + cards(x, "CTETRA", rows) + held + forces)


def in_void(x: np.ndarray) -> np.ndarray:
    """Whether points (m, 3) [m] are on the wall of the void of the arm."""
    low, high = 1e-3 * np.array([[40, -40, 20], [440, 40, 60]])
    return np.all((x > low - 1e-6) & (x < high + 1e-6), axis=1)


def in_lug(x: np.ndarray) -> np.ndarray:
    """Whether points (m, 3) [m] are in the bore of the lug."""
    return np.hypot(1e3 * x[:, 0] - ARM[0] - LUG, 1e3 * x[:, 1]) < RADIUS + 1.0


def frame() -> str:
    number: dict[tuple[int, ...], int] = {}
    quads: dict[tuple[int, ...], list[int]] = {}

    def quad(*corners: tuple[int, ...]) -> None:
        nodes = [number.setdefault(corner, len(number)) for corner in corners]
        quads.setdefault(tuple(sorted(nodes)), nodes)

    for box in BOXES:
        for axis in range(3):
            one, two = (axis + 1) % 3, (axis + 2) % 3
            for level in box[axis]:
                for i in range(*box[one]):
                    for j in range(*box[two]):
                        at = [{axis: level, one: i + a, two: j + b} for a, b in ((0, 0), (1, 0), (1, 1), (0, 1))]
                        quad(*((c[0], c[1], c[2]) for c in at))
    for i in range(5):  # the fin, on the far side of the column
        for k in range(4, 20):
            quad((-i, 0, k), (-i - 1, 0, k), (-i - 1, 0, k + 1), (-i, 0, k + 1))
    x, rows = CELL * np.array(list(number)), np.array(list(quads.values()))
    held = listed("SPC1,1,123456", np.flatnonzero(x[:, 2] == 0))
    at = number[20, 5, 17] + 1
    forces = f"FORCE,2,{at},,500.,0.,0.,-1.\n"
    return deck("LOAD=2\n", f"PSHELL,1,1,{WALL},1,,1\n" + cards(x, "CQUAD4", rows) + held + forces)


def in_box(x: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Whether the outward side of facets with these centres and normals (m, 3) [m] is inside a box of the frame."""
    ahead = 1e3 * (x + 1e-3 * normal) / CELL
    low, high = np.moveaxis(np.array(BOXES), 2, 0)
    return np.any(np.all((ahead[:, None] > low) & (ahead[:, None] < high), axis=2), axis=1)
