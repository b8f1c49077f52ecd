"""Tiny decks: a unit tetrahedron on which each test adds or breaks one card."""

from __future__ import annotations

import pytest

from strainsight.mesh.nastran import read_nastran

TETRAHEDRON = """\
GRID,1,,0.,0.,0.
GRID,2,,1.,0.,0.
GRID,3,,0.,1.,0.
GRID,4,,0.,0.,1.
CTETRA,10,1,1,2,3,4
PSOLID,1,1
MAT1,1,2.1+11,,.3,7850.
SPC1,1,123,1,2,3
"""


@pytest.fixture
def tetrahedron():
    return TETRAHEDRON


@pytest.fixture
def read(tmp_path):
    """Deck text → Mesh, by way of a file named deck.bdf."""

    def from_text(text: str | bytes):
        path = tmp_path / "deck.bdf"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return read_nastran(path)

    return from_text
