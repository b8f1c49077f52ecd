"""A mesh that was written is read again, whatever it holds."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest

from strainsight.decks.reader import read_mesh
from strainsight.mesh.model import Mesh
from strainsight.records.mesh import MeshColumns, mesh_from
from strainsight.records.record import Place, written
from strainsight.workflow.artefact import Header
from strainsight.workflow.output import Output
from strainsight.workflow.store import write_artefact

DECK = """\
BEGIN BULK
CORD2R,5,0,0.,0.,0.,0.,0.,1.
,0.,1.,0.
GRID,1,,0.,0.,0.
GRID,2,,1.,0.,0.
GRID,3,,0.,1.,0.
GRID,4,,0.,0.,1.
GRID,5,,1.,1.,1.,5
GRID,6,,2.,2.,2.
CTETRA,7,3,1,2,3,4
CTETRA,8,3,5,2,3,4
PSOLID,3,9
MAT1,9,2.1E11,,0.3,7850.
RBE2,20,6,123,2,3
RBE3,30,,5,123456,1.,12,3,4
CONM2,40,6,,2.5,.1,.2,.3
,1.,.0,2.,.0,.0,3.
SPC1,1,123,1
FORCE,7,2,,100.,0.,0.,1.
ENDDATA
"""


def same(a, b) -> bool:
    if isinstance(a, np.ndarray):
        return a.shape == b.shape and bool(np.all(a == b))
    if isinstance(a, dict):
        return list(a) == list(b) and all(same(a[key], b[key]) for key in a)
    if isinstance(a, tuple | list):
        return len(a) == len(b) and all(map(same, a, b))
    if hasattr(a, "__dataclass_fields__"):
        return type(a) is type(b) and all(same(getattr(a, f.name), getattr(b, f.name)) for f in fields(a))
    return bool(a == b)


@pytest.mark.parametrize("below", ["", "/bodies/hub"])
def test_everything_of_a_mesh_comes_back(tmp_path, below):
    (tmp_path / "own.bdf").write_text(DECK)
    mesh = read_mesh(tmp_path / "own.bdf", "mm", "t")
    datasets = written(MeshColumns.of(mesh), at=Place(below))
    output = Output(datasets, {}, "toy")
    found = mesh_from(write_artefact(tmp_path / "import.h5", output, Header("import", 1, "key", {}, {}, {})), below)
    assert len(mesh.rigid) == len(mesh.averaging) == len(mesh.point_masses) == len(mesh.loads) == len(mesh.axes) == 1
    for field in fields(Mesh):
        if field.name not in ("source", "included", "origin"):  # of the deck, not of the model
            own, there = getattr(mesh, field.name), getattr(found, field.name)
            assert same(own, there), field.name
