"""Lumped mass of solids: the diagonal, scaled to the mass of each element."""

from __future__ import annotations

import numpy as np
import pytest
from tests.decks.abaqus.test_contact import HEX20
from tests.edges.beam import bricks

from strainsight.cases.structure.mesh import mesh_of
from strainsight.config.mesh import MeshFile
from strainsight.decks.reader import read_mesh
from strainsight.errors import ConfigError
from strainsight.fem.assembly import assemble
from strainsight.fem.mass import mass_properties
from strainsight.records.mesh import MeshColumns

RHO = 7800.0
TETRAHEDRON = [(0, 0, 0), (2, 0, 0), (0, 2, 0), (0, 0, 2)]
TET10 = TETRAHEDRON + [
    tuple(np.add(TETRAHEDRON[a], TETRAHEDRON[b]) // 2) for a, b in [(0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)]
]
SHELL = (
    "*NODE\n91, 0, 0, 9\n92, 1, 0, 9\n93, 0, 1, 9\n*ELEMENT, TYPE=S3, ELSET=S\n9, 91, 92, 93\n"
    "*SHELL SECTION, ELSET=S, MATERIAL=M\n.1\n"
)
CASES = {  # nodes, volume, share of a corner and of a middle (HRZ: Zienkiewicz and Taylor, appendix on lumped mass)
    "C3D4": (TETRAHEDRON, 8 / 6, 1 / 4, 0),
    "C3D10": (TET10, 8 / 6, 1 / 36, 4 / 27),
    "C3D8": (HEX20[:8], 8.0, 1 / 8, 0),
    "C3D20": (HEX20, 8.0, 7 / 248, 16 / 248),
}


def deck(path, name: str, more: str = ""):
    nodes = CASES[name][0]
    lines = ["*NODE", *(f"{i + 1}, {x}, {y}, {z}" for i, (x, y, z) in enumerate(nodes))]
    numbers = list(map(str, [1, *range(1, len(nodes) + 1)]))
    lines += [f"*ELEMENT, TYPE={name}, ELSET=E", ", ".join(numbers[:11]) + "," * (len(numbers) > 11)]
    lines += [", ".join(numbers[11:])] if numbers[11:] else []
    lines += ["*MATERIAL, NAME=M", "*ELASTIC", "2.1e11, .3", "*DENSITY", str(RHO)]
    lines += ["*SOLID SECTION, ELSET=E, MATERIAL=M", "*BOUNDARY", "1, 1, 3", ""]
    path.write_text("\n".join(lines) + more)
    return path


@pytest.mark.parametrize("name", list(CASES))
def test_lumped_masses_are_those_that_are_published(tmp_path, name):
    nodes, volume, corner, middle = CASES[name]
    path = deck(tmp_path / "a.inp", name)
    mesh = mesh_of(MeshFile(file="a.inp", mass="lumped"), path)
    M = assemble(mesh)[1].constant.toarray()
    np.testing.assert_allclose(M, np.diag(np.diag(M)), atol=1e-12 * M.max())
    corners = 4 if len(nodes) in (4, 10) else 8
    share = np.where(np.arange(len(nodes)) < corners, corner, middle)
    np.testing.assert_allclose(np.diag(M), np.repeat(RHO * volume * share, 3), rtol=1e-12)
    mass, centre = mass_properties(mesh)
    consistent = mass_properties(read_mesh(path))
    assert mass == pytest.approx(consistent[0], rel=1e-12)
    np.testing.assert_allclose(centre, consistent[1], rtol=1e-12)


def test_what_is_lumped_stays_so_in_the_artefact(tmp_path):
    path = deck(tmp_path / "a.inp", "C3D4")
    for choice, expected in ((None, False), ("lumped", True), ("consistent", False)):
        mesh = mesh_of(MeshFile(file="a.inp", mass=choice), path)
        assert mesh.lumped == MeshColumns.of(mesh).made().lumped == expected


@pytest.mark.parametrize(
    ("value", "choice", "by"),
    [("-1", None, "PARAM,COUPMASS"), ("-1", "consistent", ""), ("1", "lumped", "mesh.mass"), ("1", None, "")],
)
def test_a_note_says_that_mass_is_lumped_and_by_what_and_no_other(tmp_path, value, choice, by):
    path = tmp_path / "a.bdf"
    path.write_text(bricks((1, 1, 1)).replace("ENDDATA", f"PARAM,COUPMASS,{value}\nENDDATA"))
    mesh = mesh_of(MeshFile(file="a.bdf", mass=choice), path)
    said = [note for note in mesh.notes if "lumped" in note]
    assert [note.partition(":")[0] for note in said] == ([f"mass of solids is lumped, as {by} says"] if by else [])
    assert mesh.lumped == bool(by)


def test_shells_are_not_lumped(tmp_path):
    path = deck(tmp_path / "a.inp", "C3D4", SHELL)
    with pytest.raises(ConfigError, match="whose mass is not lumped here"):
        mesh_of(MeshFile(file="a.inp", mass="lumped"), path)
