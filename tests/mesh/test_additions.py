"""What the config adds to a mesh is added, and nothing else changes."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.decks.nastran.deck import read_nastran
from strainsight.errors import UserError
from strainsight.mesh.additions import (
    node_index,
    node_indices,
    region_ids,
    with_averaging_element,
    with_material,
    with_node,
    with_rigid_element,
    with_support,
)

DECK = """\
GRID,11,,0.,0.,0.
GRID,2,,1.,0.,0.
GRID,33,,0.,1.,0.
GRID,4,,0.,0.,1.
GRID,5,,1.,1.,1.
CTETRA,10,1,11,2,33,4
CTETRA,20,7,2,33,4,5
PSOLID,1,1
PSOLID,7,1
MAT1,1,2.1+11,,.3,7850.
SPC1,1,123,11
SET1,3,33,4
"""


@pytest.fixture
def mesh(tmp_path):
    (tmp_path / "a.bdf").write_text(DECK)
    return read_nastran(tmp_path / "a.bdf")


def test_a_material_goes_to_the_regions_named_by_id_or_name(mesh):
    changed = with_material(mesh, [7], 7e10, 0.33, 2700.0)
    assert changed.materials[changed.regions[7].material].youngs_modulus == 7e10
    assert changed.regions[1] == mesh.regions[1]
    assert region_ids(changed, ["PSOLID 7", 1]) == (7, 1)


def test_a_material_for_all_regions_leaves_none_of_the_file(mesh):
    changed = with_material(mesh, None, 7e10, 0.33, 2700.0)
    assert [m.density for m in changed.materials.values()] == [2700.0]
    assert {r.material for r in changed.regions.values()} == set(changed.materials)


def test_supports_add_to_those_of_the_file_each_once(mesh):
    changed = with_support(mesh, node_indices(mesh, "SET1-3"), (0, 2))
    again = with_support(changed, node_indices(mesh, "SET1-3"), (2,))
    expected = {(0, 0), (0, 1), (0, 2), (2, 0), (2, 2), (3, 0), (3, 2)}
    assert {tuple(pair) for pair in changed.fixed.tolist()} == expected
    np.testing.assert_array_equal(changed.fixed, again.fixed)


def test_a_tie_takes_the_nodes_of_a_set_but_its_reference(mesh):
    changed = with_node(mesh, 900, (0.5, 0.5, 2.0))
    reference = node_index(changed, 900)
    assert changed.position[reference].tolist() == [0.5, 0.5, 2.0]
    tied = with_rigid_element(changed, reference, node_indices(changed, "SET1-3"), (0, 1, 2))
    tied = with_averaging_element(tied, node_index(tied, 4), np.array([2, 3, 4]), range(6))
    assert tied.node_ids[tied.rigid[0].nodes].tolist() == [33, 4]
    assert tied.node_ids[tied.averaging[0].nodes].tolist() == [33, 5]
    assert (tied.rigid[0].id, tied.averaging[0].id) == (1, 2)


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        (lambda mesh: with_material(mesh, ["PSOLID 8"], 1.0, 0.0, 1.0), "did you mean PSOLID 7"),
        (lambda mesh: node_indices(mesh, "SET-3"), "did you mean SET1-3"),
        (lambda mesh: node_index(mesh, 3), "no node 3"),
        (lambda mesh: with_node(mesh, 33, (0, 0, 0)), "already"),
    ],
)
def test_what_is_not_there_is_reported(mesh, wrong, says):
    with pytest.raises(UserError, match=says):
        wrong(mesh)
