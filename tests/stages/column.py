"""The benches of configs/ on a column of twenty bricks instead of their hub, with four modes."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from ..edges.beam import CORNERS, deck
from ..shared import ROOT, once

COUNTS, LOW, HIGH = (2, 2, 5), np.array([0.586, -0.45, -3.0]), np.array([1.386, 0.45, 0.5])
FLANGE = 2
"""The node at (1.386, 0, 0) that holds the two upper rows of the face beside it."""
GAUGES = (
    ((0.586, 0.2, -2.65), (0, 0, 1)),
    ((1.386, 0.2, -0.55), (0, 0, 1)),
    ((0.8, 0.45, -2.65), (1, 0, 1)),
    ((0.8, -0.45, -2.65), (1, 0, -1)),
)


def column() -> str:
    """The deck, clamped at its foot."""
    half = np.stack(np.meshgrid(*(np.arange(c + 1) for c in COUNTS), indexing="ij"), axis=-1).reshape(-1, 3)
    number = {tuple(at): 101 + n for n, at in enumerate(half.tolist())}
    place = LOW + half / np.array(COUNTS) * (HIGH - LOW)
    cards = [["GRID", 101 + n, "", *map(repr, x)] for n, x in enumerate(place.tolist())]
    for e, first in enumerate(np.ndindex(*COUNTS), start=1):
        cards.append(["CHEXA", e, 1, *(number[tuple((np.array(first) + np.array(s) // 2).tolist())] for s in CORNERS)])
    on_flange = (half[:, 0] == COUNTS[0]) & (half[:, 2] >= COUNTS[2] - 1)
    cards += [
        ["SPC1", 1, 123, *(101 + np.flatnonzero(half[:, 2] == 0))],
        ["GRID", FLANGE, "", "1.386", "0.0", "0.0"],
        ["RBE2", 1, FLANGE, 123456, *(101 + np.flatnonzero(on_flange))],
    ]
    return deck(cards, 1.7e11, 7100.0)


def on_column(config: Path) -> Path:
    """A bench of configs/ on the column, at half the size where its mesh is scaled by it."""
    text = config.read_text(encoding="utf-8")
    size = 0.5 if "scale: 0.5" in text else 1.0
    gauges = ", ".join(f"{{position: {[size * x for x in at]}, direction: {list(along)}}}" for at, along in GAUGES)
    text = re.sub(r"gauges:(?:  #[^\n]*)?\n(?: +- \{position[^\n]*\n)+", f"gauges: [{gauges}]\n", text)
    text = re.sub(r"\S*hub-bench.bdf.gz", "column.bdf", text).replace("../bench-load.csv", "bench-load.csv")
    text = text.replace("modes: 10", "modes: 4")
    mesh, loads = column(), (ROOT / "configs" / "bench-load.csv").read_text(encoding="utf-8").splitlines()

    def make(folder: Path) -> None:
        (folder / "column.bdf").write_text(mesh, encoding="ascii")
        (folder / "bench-load.csv").write_text("\n".join([*loads[:1002], ""]), encoding="ascii")
        (folder / config.name).write_text(text, encoding="utf-8")

    return once("column", text + mesh, make) / config.name
