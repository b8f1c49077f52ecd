"""A point mass on a node that nothing holds is left out, unless the config ties it."""

from __future__ import annotations

import pytest

from strainsight.cases.structure.mesh import checked, mesh_of
from strainsight.config.mesh import MeshFile, Tie

from .conftest import TETRAHEDRON

LOOSE = TETRAHEDRON + "GRID,50,,1.,1.,1.\nGRID,51,,2.,1.,1.\nCONM2,90,50,,2.5\nCONM2,91,4,,3.\nSET1,7,1,2,3,4\n"


def imported(tmp_path, text, **more):
    (tmp_path / "deck.bdf").write_text(text)
    config = MeshFile(file="deck.bdf", **more)
    mesh = mesh_of(config, tmp_path / "deck.bdf")
    return mesh, checked(mesh, config)[0][0]


def test_it_is_left_out_with_a_note_and_weighs_nothing(tmp_path):
    mesh, weight = imported(tmp_path, LOOSE)
    assert [point.id for point in mesh.point_masses] == [91]
    assert mesh.notes[-1].startswith("a point mass of 2.5 kg on nodes that no element, tie, spring or support holds, left out")
    assert mesh.notes[-1].endswith("node 50")
    assert weight == pytest.approx(7850 / 6 + 3)
    mesh, _ = imported(tmp_path, LOOSE + "CONM2,92,51,,4.\n")
    assert mesh.notes[-1].startswith("2 point masses of 6.5 kg on nodes")


@pytest.mark.parametrize("card", ["RBE2,20,50,123,4", "CELAS2,20,1.+6,50,1,4,1", "MPC,1,50,1,1.,4,1,-1."])
def test_what_holds_its_node_keeps_it(tmp_path, card):
    (tmp_path / "deck.bdf").write_text(f"{LOOSE}{card}\n")
    mesh = mesh_of(MeshFile(file="deck.bdf"), tmp_path / "deck.bdf")
    assert len(mesh.point_masses) == 2
    assert not any("left out" in note for note in mesh.notes)


def test_a_tie_of_the_config_keeps_it(tmp_path):
    ties = (Tie(type="averaging", set="SET1-7", reference=50),)
    mesh, weight = imported(tmp_path, LOOSE, ties=ties)
    assert len(mesh.point_masses) == 2
    assert weight == pytest.approx(7850 / 6 + 5.5)
