"""Write cantilever.bdf: a steel cantilever of hex20 solids, as a finite-element program would.

L = 2 m along x, 0.25 m wide (y), 0.19 m high (z), centred on the x axis; at the tip an RBE2 with reference node 2.
First bending mode (in z) about 40 Hz. Every coordinate is a multiple of 1/40, 1/32 or 19/800 m and stands exactly in a
small field.

`cantilever-coarse.bdf` is the same beam in larger elements, for examples that are to run in seconds.

The root at x = 0 is held along x everywhere, and across it on two strips: in y where |y| is at most 1/32 m, in z where
|z| is at most 19/800 m. So the section can contract as beam theory lets it: a clamp of all components stiffens the
axial mode by 0.34 %, the bending modes by 0.5 to 0.7 %.
"""

from __future__ import annotations

import hashlib
import sys
from pathlib import Path

import numpy as np

LENGTH, WIDTH, HEIGHT = 2.0, 0.25, 0.19
DIVISIONS, COARSE = (40, 4, 4), (20, 2, 2)
REFERENCE, FIRST_NODE, RIGID = 2, 101, 9001
# Half steps from an element's first corner to its nodes in Nastran's order: corners, mid-sides bottom, upright, top.
STEPS = np.array(
    [
        (0, 0, 0),
        (2, 0, 0),
        (2, 2, 0),
        (0, 2, 0),
        (0, 0, 2),
        (2, 0, 2),
        (2, 2, 2),
        (0, 2, 2),
        (1, 0, 0),
        (2, 1, 0),
        (1, 2, 0),
        (0, 1, 0),
        (0, 0, 1),
        (2, 0, 1),
        (2, 2, 1),
        (0, 2, 1),
        (1, 0, 2),
        (2, 1, 2),
        (1, 2, 2),
        (0, 1, 2),
    ]
)


def real(value: float) -> str:
    """A real of at most eight characters that is exactly `value` to fifteen digits."""
    text = f"{value:.9f}".rstrip("0")
    text = text.replace("0.", ".", 1) if text.startswith(("0.", "-0.")) and len(text) > 8 else text
    if len(text) > 8 or abs(float(text) - value) > 1e-15:
        raise ValueError(f"{value!r} does not fit a small field")
    return text


def card(name: str, *fields: object) -> list[str]:
    """One card in small fields, eight to a line."""
    texts = [real(f) if isinstance(f, float) else str(f) for f in fields]
    rows = [texts[i : i + 8] for i in range(0, len(texts), 8)]
    heads = [name.ljust(8)] + ["+".ljust(8)] * (len(rows) - 1)
    return [(head + "".join(text.rjust(8) for text in row)).rstrip() for head, row in zip(heads, rows, strict=True)]


def deck(divisions: tuple[int, int, int] = DIVISIONS) -> str:
    """The whole deck; divisions: elements along x, y and z."""
    half = [2 * d for d in divisions]
    grid = np.stack(np.meshgrid(*(np.arange(h + 1) for h in half), indexing="ij"), axis=-1)
    serendipity = (grid % 2).sum(axis=-1) <= 1
    number = np.zeros(serendipity.shape, dtype=int)
    number[serendipity] = FIRST_NODE + np.arange(serendipity.sum())
    size = np.array([LENGTH, WIDTH, HEIGHT])
    lines = [
        "$ Cantilever of steel, 2 m x 0.25 m x 0.19 m, hex20; units m, kg, s. Written by make_cantilever.py.",
        "SOL 103",
        "CEND",
        "TITLE = CANTILEVER",
        "SPC = 1",
        "METHOD = 1",
        "BEGIN BULK",
    ]
    lines += card("EIGRL", 1, "", "", 10)
    lines += card("MAT1", 1, "2.1E+11", "", "0.3", "7850.")
    lines += card("PSOLID", 1, 1)
    lines += card("GRID", REFERENCE, "", LENGTH, 0.0, 0.0)
    for index in grid[serendipity]:
        x = size * index / half - np.array([0.0, WIDTH / 2, HEIGHT / 2])
        lines += card("GRID", number[tuple(index)], "", *(float(round(v, 9)) + 0.0 for v in x))
    for element, (i, j, k) in enumerate(np.ndindex(*divisions), start=1):
        nodes = number[tuple((2 * np.array([i, j, k]) + STEPS).T)]
        lines += card("CHEXA", element, 1, *nodes)
    root, (_, j, k) = number[0], divisions  # j and k half steps to the middle
    for component, nodes in ((1, root), (2, root[j - 1 : j + 2]), (3, root[:, k - 1 : k + 2])):
        lines += card("SPC1", 1, component, *nodes[nodes > 0])
    lines += card("RBE2", RIGID, REFERENCE, 123, *number[-1][number[-1] > 0])
    return "\n".join([*lines, "ENDDATA", ""])


def main(folder: Path) -> None:
    """Write both decks and their checksums."""
    sums = ""
    for name, divisions in (("cantilever.bdf", DIVISIONS), ("cantilever-coarse.bdf", COARSE)):
        content = deck(divisions).encode("ascii")
        (folder / name).write_bytes(content)
        sums += f"{hashlib.sha256(content).hexdigest()}  {name}\n"
    (folder / "SHA256SUMS").write_text(sums, encoding="ascii")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent)
