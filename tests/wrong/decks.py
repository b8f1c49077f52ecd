"""Small sound decks as text, which the tests break in one place each: a bar of bricks, a plate of shells, a frame of beams."""

from __future__ import annotations

from collections.abc import Sequence

STEEL = "MAT1,1,2.1+11,,.3,7850."
CONFIG = """\
kind: placement
name: own
mesh: {{file: {file}{mesh}}}
loads: {{tip: {{{load}, known: true, signal: {{type: sine, frequency: 20.0, amplitude: {amplitude}}}}}}}
parameters: {{E: {{property: {property}, region: 1, guess: {guess}, range: {range}}}}}
damping: {{type: modal, ratio: {ratio}}}
rom: {{modes: 2}}
train: {{duration: 0.1, time_step: 1.0e-3}}
gauges: {{direction: {{type: axis, axis: [1, 2, 3]}}, noise_std: {{value: {noise}}}{gauges}}}
place: {{estimate: [E], keep: 1}}
validate: {{time_step: 1.0e-3, duration: 0.1, initial_std: {{E: 0.1}}}}
"""
AS_MEANT = {
    "file": "deck.bdf",
    "mesh": "",
    "load": "node: 5, direction: [0, 0, 1]",
    "amplitude": "100.0",
    "property": "youngs_modulus",
    "guess": "2.0e11",
    "range": "[1.0e11, 3.0e11]",
    "ratio": "0.01",
    "noise": "1.0e-6",
    "gauges": "",
}


def config(**changes: str) -> str:
    return CONFIG.format(**{**AS_MEANT, **changes})


def number(value: float) -> str:
    return f"{value:.8g}" if "." in f"{value:.8g}" or "e" in f"{value:.8g}" else f"{value:.8g}."


def grid(first: int, cells: tuple[int, int, int], size: tuple[float, float, float], at: Sequence[float]) -> list[str]:
    """GRID cards of a box, x fastest."""
    nx, ny, nz = (n + 1 for n in cells)
    return [
        f"GRID,{first + i + nx * (j + ny * k)},,"
        + ",".join(number(a + s * q / max(n, 1)) for a, s, q, n in zip(at, size, (i, j, k), cells, strict=True))
        for k in range(nz)
        for j in range(ny)
        for i in range(nx)
    ]


def bricks(
    cells: tuple[int, int, int] = (4, 1, 1),
    size: tuple[float, float, float] = (0.4, 0.1, 0.1),
    at: Sequence[float] = (0.0, 0.0, 0.0),
    first: int = 1,
    element: int = 1,
) -> list[str]:
    """GRID and CHEXA cards of a bar along x, which is held at 1, 6, 11 and 16 and loaded at 5."""
    nx, ny = cells[0] + 1, cells[1] + 1
    cards, e = grid(first, cells, size, at), element
    for k in range(cells[2]):
        for j in range(cells[1]):
            for i in range(cells[0]):
                a = first + i + nx * (j + ny * k)
                b = a + nx * ny
                cards.append(f"CHEXA,{e},1,{a},{a + 1},{a + 1 + nx},{a + nx},{b},{b + 1},\n,{b + 1 + nx},{b + nx}")
                e += 1
    return cards


def deck(*cards: str, material: str = STEEL, held: str = "SPC1,1,123,1,6,11,16", case: str = "SPC = 1") -> str:
    return "\n".join(["SOL 103", "CEND", case, "BEGIN BULK", *cards, material, held, "ENDDATA"]) + "\n"


def bar(*more: str, **changes: str) -> str:
    return deck(*bricks(), "PSOLID,1,1", *more, **changes)


def plate(
    *more: str,
    turned: Sequence[int] = (),
    section: str = "PSHELL,1,1,.002,1,,1",
    rest: str = "",
    held: str = "SPC1,1,123456,1,6,11",
    **changes: str,
) -> str:
    """4 by 2 quadrangles of 0.4 by 0.2 m; turned: elements whose nodes go round the other way; rest: fields behind the nodes."""
    cards, e = grid(1, (4, 2, 0), (0.4, 0.2, 0.0), (0.0, 0.0, 0.0)), 1
    for j in range(2):
        for i in range(4):
            a = 1 + i + 5 * j
            nodes = [a, a + 1, a + 6, a + 5]
            nodes = nodes[::-1] if e in turned else nodes
            cards.append(f"CQUAD4,{e},1,{','.join(map(str, nodes))}{rest}")
            e += 1
    return deck(*cards, section, *more, held=held, **changes)


def frame(
    *more: str, section: str = "PBAR,1,1,4.-4,2.-8,1.-8,2.-8", rest: str = "", way: str = "0.,0.,1.", **changes: str
) -> str:
    cards = grid(1, (4, 0, 0), (0.4, 0.0, 0.0), (0.0, 0.0, 0.0))
    cards += [f"CBAR,{i},1,{i},{i + 1},{way}{rest}" for i in range(1, 5)]
    recovery = ",.01,.01,-.01,.01,-.01,-.01,.01,-.01"
    return deck(*cards, f"{section}\n{recovery}", *more, **{"held": "SPC1,1,123456,1", **changes})


def inp(
    *,
    elements: str = "C3D8",
    section: str = "*SOLID SECTION, ELSET=EALL, MATERIAL=STEEL",
    elastic: str = "2.1e11, 0.3",
    density: str = "7850.",
    held: str = "FIX, 1, 3",
    more: str = "",
) -> str:
    nodes = [
        card.removeprefix("GRID,").replace(",,", ",") for card in grid(1, (4, 1, 1), (0.4, 0.1, 0.1), (0.0, 0.0, 0.0))
    ]
    rows = [f"{e},{e},{e + 1},{e + 6},{e + 5},{e + 10},{e + 11},{e + 16},{e + 15}" for e in range(1, 5)]
    lines = [
        "*NODE, NSET=NALL",
        *nodes,
        f"*ELEMENT, TYPE={elements}, ELSET=EALL",
        *rows,
        "*NSET, NSET=FIX",
        "1, 6, 11, 16",
    ]
    lines += [section, "*MATERIAL, NAME=STEEL", "*ELASTIC", elastic]
    lines += ["*DENSITY", density] if density else []
    return "\n".join([*lines, "*BOUNDARY", held, *([more] if more else [])]) + "\n"


def msh(scale: float = 1.0, tag: int = 1, double: bool = False) -> str:
    """The bar for gmsh; tag: of its physical volume, 0 for none; double: a second node in the place of the last one."""
    nodes = [
        card.removeprefix("GRID,").replace(",,", ",").split(",")
        for card in grid(1, (4, 1, 1), (0.4, 0.1, 0.1), (0, 0, 0))
    ]
    lines = ["$MeshFormat", "2.2 0 8", "$EndMeshFormat"]
    if tag:
        lines += ["$PhysicalNames", "1", f'3 {tag} "steel"', "$EndPhysicalNames"]
    lines += ["$Nodes", str(len(nodes))]
    lines += [f"{i} {' '.join(number(scale * float(value)) for value in x)}" for i, *x in nodes]
    rows = [f"{e} 5 2 {tag} 1 {e} {e + 1} {e + 6} {e + 5} {e + 10} {e + 11} {e + 16} {e + 15}" for e in range(1, 5)]
    rows += [rows[0].replace("1 5 2", "5 5 2", 1)] if double else []
    return "\n".join([*lines, "$EndNodes", "$Elements", str(len(rows)), *rows, "$EndElements"]) + "\n"
