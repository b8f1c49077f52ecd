"""What CalculiX makes of a deck, and frequencies and displacements of the model that is read from it."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from strainsight.fem.factorisation import factorise
from strainsight.fem.loads import PointLoad, input_shape
from strainsight.fem.model import build_model, nodal
from strainsight.fem.modes import modes
from strainsight.mesh.model import Mesh

needs_calculix = pytest.mark.skipif(not shutil.which("ccx"), reason="CalculiX is not installed")


def calculix(deck: Path) -> list[list[str]]:
    """Words of every line that CalculiX prints."""
    subprocess.run(["ccx", deck.stem], cwd=deck.parent, check=True, stdout=subprocess.DEVNULL, timeout=60)
    return [line.split() for line in deck.with_suffix(".dat").read_text().splitlines()]


def printed_displacements(deck: Path) -> np.ndarray:
    """(rows, 3) of every step, along the axes of a node where it has some (a line that ends in L)."""
    rows = [row for row in calculix(deck) if len(row) - ("L" in row) == 4 and row[0].isdigit()]
    return np.array([[float(value) for value in row[1:4]] for row in rows])


def printed_frequencies(deck: Path, count: int) -> list[float]:
    """[Hz] of a *FREQUENCY step."""
    return [float(row[3]) for row in calculix(deck) if len(row) == 5 and row[0].isdigit()][:count]


def frequencies(mesh: Mesh, count: int) -> np.ndarray:
    model = build_model(mesh)
    return modes(model.stiffness.constant, model.mass.constant, count)[0]


def displacements(mesh: Mesh, *loads: str) -> list[np.ndarray]:
    """(n, 3) under each load of the deck."""
    model = build_model(mesh)
    solve = factorise(model.stiffness.constant).solve
    shapes = (input_shape(model, [PointLoad(name, deck_load=name, factor=True)]) for name in loads)
    return [nodal(model, solve(shape)).reshape(-1, 3) for shape in shapes]
