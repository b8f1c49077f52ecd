"""Decks as text: a unit tetrahedron on which each test adds or breaks one card, and the reader of the folder."""

from __future__ import annotations

import pytest

from strainsight.decks.abaqus.deck import read_abaqus
from strainsight.decks.gmsh.mesh import read_gmsh
from strainsight.decks.nastran.deck import read_nastran
from strainsight.decks.other import mesh
from strainsight.decks.other.load import load

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
READERS = {"nastran": ("deck.bdf", read_nastran), "abaqus": ("deck.inp", read_abaqus), "gmsh": ("part.msh", read_gmsh)}
"""Folder of the tests → name of the file, and its reader."""


@pytest.fixture(autouse=True)
def read_here(request, monkeypatch):
    """meshio in the process of the tests: another one takes half a second to start for each file."""
    if request.path.name != "test_sandbox.py":
        monkeypatch.setattr(mesh, "load_sandboxed", load)


@pytest.fixture
def tetrahedron():
    return TETRAHEDRON


@pytest.fixture
def read(request, tmp_path):
    """Text or bytes → Mesh, by way of a file named deck.bdf, deck.inp or part.msh."""
    name, reader = READERS[request.path.parent.name]

    def from_content(content: str | bytes, **options):
        path = tmp_path / name
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return reader(path, **options)

    return from_content
