"""Write wing.bdf.gz and wing.sha256: the box of a light aircraft's wing, of shells and stringers, in mm, t and s.

Half span 3 m along y, swept back; between the front spar at 15 % and the rear spar at 60 % of the chord, which goes from 600 to
300 mm. Skins follow the thickness of a profile of 12 % (NACA 0012); ribs every eighth of the span; two stringers on each skin,
bars whose middle lies 10 mm inside it. The root is clamped. Node 2 is the average of the rib at the tip (RBE3), node 3 that
of the rib at half span: there a wing is loaded in a test. Node 4, a store of 5 kg below the rib at five eighths, hangs on it by
an RBE2.

Properties: 1 skins of 2.5 mm, 2 spars of 3 mm, 3 ribs of 2 mm, 4 stringers; all of one aluminium, E = 72 GPa, ν = 0.33,
ρ = 2800 kg/m³. Nodes are rounded to 1e-4 mm. `make_wing.py CHORD SPAN HEIGHT OUT` makes it of so many elements along each.

`make_wing.py CHORD SPAN HEIGHT OUT composite` has skins, spars and ribs of carbon plies in place of it (MAT8 2, E1 = 130 GPa),
x of the plies along the middle of the box (coordinate system 1): skins [45/−45/0/0/90/0]s of 3 mm, spars [45/−45/0/−45/45]s,
ribs [45/−45]2s.
"""

from __future__ import annotations

import gzip
import hashlib
import sys
from pathlib import Path

import numpy as np

SPAN, ROOT, TIP, SWEEP = 3000.0, 600.0, 300.0, 400.0
"""[mm]; sweep: of the leading edge at the tip."""
FRONT, REAR, THICKNESS = 0.15, 0.60, 0.12
"""Of the chord."""
BAYS = 8
STRINGERS = (1 / 3, 2 / 3)
"""Of the width of the box."""
INSIDE = 10.0
TIP_NODE, MIDDLE, STORE, FIRST = 2, 3, 4, 101
DIVISIONS = (12, 48, 4)
SECTIONS = ("PSHELL,1,1,2.5,1,,1", "PSHELL,2,1,3.0,1,,1", "PSHELL,3,1,2.0,1,,1")
LAYUPS = {1: ((45, -45, 0, 0, 90, 0), 0.25), 2: ((45, -45, 0, -45, 45), 0.25), 3: ((45, -45, 45, -45), 0.25)}
"""Property → half of the angles [°] of its plies, from the lower face to the middle, and the thickness of a ply."""


def profile(x: np.ndarray) -> np.ndarray:
    """Half the thickness of a NACA 0012 at x of its chord, as a share of the chord."""
    return 5 * THICKNESS * (0.2969 * np.sqrt(x) - 0.1260 * x - 0.3516 * x**2 + 0.2843 * x**3 - 0.1015 * x**4)


def point(along: np.ndarray, across: np.ndarray, up: np.ndarray) -> np.ndarray:
    """x, y, z [mm] of a place in the box: shares of its width (0 the front spar), of the span, and of its height (−1 to 1)."""
    chord = ROOT + (TIP - ROOT) * across
    share = FRONT + (REAR - FRONT) * along
    return np.stack([SWEEP * across + share * chord, SPAN * across, up * profile(share) * chord], axis=-1)


def deck(chord: int, span: int, height: int, composite: bool = False) -> str:
    """The whole deck of so many elements along the chord (a multiple of three), the span (of eight) and through the height."""
    number: dict[tuple[int, int, int], int] = {}
    material = "carbon plies" if composite else "aluminium"

    def node(i: int, j: int, k: int) -> int:
        return number.setdefault((i, j, k), FIRST + len(number))

    quads: list[tuple[int, tuple[int, ...]]] = []

    def quad(region: int, *corners: tuple[int, int, int]) -> None:
        quads.append((region, tuple(node(*own) for own in corners)))

    for j in range(span):
        for i in range(chord):
            quad(1, (i, j, height), (i + 1, j, height), (i + 1, j + 1, height), (i, j + 1, height))
            quad(1, (i, j, 0), (i, j + 1, 0), (i + 1, j + 1, 0), (i + 1, j, 0))
        for k in range(height):
            quad(2, (0, j, k), (0, j, k + 1), (0, j + 1, k + 1), (0, j + 1, k))
            quad(2, (chord, j, k), (chord, j + 1, k), (chord, j + 1, k + 1), (chord, j, k + 1))
    ribs = [bay * span // BAYS for bay in range(1, BAYS + 1)]
    for j in ribs:
        for i in range(chord):
            for k in range(height):
                quad(3, (i, j, k), (i + 1, j, k), (i + 1, j, k + 1), (i, j, k + 1))
    rows = [round(share * chord) for share in STRINGERS]
    bars = [
        (node(i, j, k), node(i, j + 1, k), -INSIDE if k else INSIDE)
        for k in (0, height)
        for i in rows
        for j in range(span)
    ]
    lines = [
        f"$ Wing box of {material}, shells and bars; units mm, t, s. Written by make_wing.py.",
        "SOL 103",
        "CEND",
        "SPC = 1",
        "BEGIN BULK",
    ]
    place = np.array(list(number))
    x = point(place[:, 0] / chord, place[:, 1] / span, 2 * place[:, 2] / height - 1)
    for id, own in zip(number.values(), x, strict=True):
        lines.append(f"GRID,{id},,{own[0]:.4f},{own[1]:.4f},{own[2]:.4f}")
    rib = {j: sorted(id for (_, row, _), id in number.items() if row == j) for j in (ribs[3], ribs[4], ribs[-1])}
    middle = {j: x[place[:, 1] == j].mean(axis=0) for j in rib}
    below = middle[ribs[4]] - [0.0, 0.0, 150.0]
    for id, own in ((TIP_NODE, middle[ribs[-1]]), (MIDDLE, middle[ribs[3]]), (STORE, below)):
        lines.append(f"GRID,{id},,{own[0]:.4f},{own[1]:.4f},{own[2]:.4f}")
    along = ",1" if composite else ""
    lines += [f"CQUAD4,{i},{region},{','.join(map(str, own))}{along}" for i, (region, own) in enumerate(quads, start=1)]
    for i, (a, b, z) in enumerate(bars, start=len(quads) + 1):
        lines.append(f"CBAR,{i},4,{a},{b},0.,0.,1.,")
        lines.append(f",,,0.,0.,{z:.1f},0.,0.,{z:.1f}")
    lines += _listed("RBE3", (90001, "", TIP_NODE, 123456, 1.0, 123), rib[ribs[-1]])
    lines += _listed("RBE3", (90002, "", MIDDLE, 123456, 1.0, 123), rib[ribs[3]])
    lines += _listed(
        "RBE2", (90003, STORE, 123456), [own for own in rib[ribs[4]] if own in bottom(number, ribs[4], rows)]
    )
    lines += [f"CONM2,90004,{STORE},0,5.0-3"]
    lines += [
        *(composite_sections(middle[ribs[-1]]) if composite else SECTIONS),
        # a bar of 3 mm by 20 mm on edge
        "PBAR,4,1,60.0,2000.0,45.0,163.0",
        "MAT1,1,7.2+4,,0.33,2.8-9",
    ]
    lines += _listed("SPC1", (1, 123456), sorted(id for (_, row, _), id in number.items() if row == 0))
    return "\n".join([*lines, "ENDDATA", ""])


def composite_sections(tip: np.ndarray) -> list[str]:
    """Laminates in place of SECTIONS, and the axes of their plies: x from the middle of the root to that of the tip."""
    root = point(np.array([0.0, 1.0]), np.zeros(2), np.zeros(2)).mean(axis=0)
    lines = [f"CORD2R,1,,{_reals(root)},{_reals(root + np.array([0.0, 0.0, 1.0]))}", f",{_reals(tip)}"]
    for number, (angles, thickness) in LAYUPS.items():
        lines.append(f"PCOMP,{number},,,,,,,SYM")
        plies = [f"2,{thickness},{angle:.1f},YES" for angle in angles]
        lines += [f",{','.join(plies[i : i + 2])}" for i in range(0, len(plies), 2)]
    return [*lines, "MAT8,2,1.3+5,9.0+3,0.30,4.8+3,4.8+3,3.2+3,1.55-9"]


def _reals(values: np.ndarray) -> str:
    return ",".join(f"{round(value, 4) + 0.0:.4f}" for value in values)


def bottom(number: dict[tuple[int, int, int], int], j: int, rows: list[int]) -> set[int]:
    """Nodes of a rib where the stringers of the lower skin pass."""
    return {number[i, j, 0] for i in rows}


def _listed(name: str, head: tuple[object, ...], nodes: list[int]) -> list[str]:
    """A card in free fields, eight to a line."""
    fields = [str(own) for own in (*head, *nodes)]
    rows = [fields[i : i + 8] for i in range(0, len(fields), 8)]
    return [",".join([name if not i else "", *row]) for i, row in enumerate(rows)]


def main(folder: Path) -> None:
    """Write the deck, packed, and the checksum of the packed file."""
    packed = gzip.compress(deck(*DIVISIONS).encode("ascii"), 9, mtime=0)
    (folder / "wing.bdf.gz").write_bytes(packed)
    (folder / "wing.sha256").write_text(f"{hashlib.sha256(packed).hexdigest()}  wing.bdf.gz\n", encoding="ascii")


if __name__ == "__main__":
    if len(sys.argv) > 4:
        divisions, name = map(int, sys.argv[1:4]), sys.argv[4]
        Path(name).write_text(deck(*divisions, composite="composite" in sys.argv[5:]), encoding="ascii")
    else:
        main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent)
