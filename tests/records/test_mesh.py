"""A mesh that was written is read again, whatever it holds."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest

from strainsight.decks.reader import read_mesh
from strainsight.mesh.beam_sides import with_sides
from strainsight.mesh.model import Mesh
from strainsight.mesh.shell_faces import with_faces
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
CQUAD4,11,4,1,2,6,3,30.,.1
CTRIA3,12,5,1,2,3
CBAR,13,7,2,3,0.,0.,1.
,456,5,.1,.2,.3
CBEAM,14,8,1,6,0.,1.,0.
CONROD,15,3,4,9,.2,.3,,.5
PSHELL,4,9,.2,9,,9,,2.
PSHELL,5,9,.3,9
PBAR,7,9,.1,.2,.3,.4,.5
,.1,.2,.3,.4
PBEAM,8,9,.1,.2,.3,.01,.4,.5
,.1,.2,.3,.4
,YES,1.,.2,.3,.4,.02,.5,.6
,.5,.6
PSOLID,3,9
MAT1,9,2.1E11,,0.3,7850.
RBE2,20,6,123,2,3
RBE3,30,,5,123456,1.,12,3,4
,2.,46,1
MPC,50,3,1,1.,6,5,-.1
,,4,2,3.
MPC,50,4,3,1.
CONM2,40,6,,2.5,.1,.2,.3
,1.,.0,2.,.0,.0,3.
CTRIA3,90,9,1,2,3,30.
PCOMP,9,,.5,,,,,SYM
,10,.1,30.,,9,.2
MAT8,10,1.4+11,1.+10,.3,5.+9,,3.+9,1600.
CTETRA,92,12,1,2,3,5
PSOLID,12,14,5
MAT11,14,1.4+11,1.+10,1.+10,.3,.3,.4,5.+9
,5.+9,3.4+9,1600.
CTRIA3,91,13,2,3,6
PSHELL,13,9,.2,15,,15
MAT1,15,7.+10,,.3
CMASS2,41,2.5,4,2
SPC1,1,123,1
FORCE,7,2,,100.,0.,0.,1.
ENDDATA
"""


def same(a, b) -> bool:
    if isinstance(a, np.ndarray):
        return a.dtype == b.dtype and np.array_equal(a, b, equal_nan=a.dtype.kind == "f")
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
    mesh = with_sides(with_faces(read_mesh(tmp_path / "own.bdf", "mm", "t")))
    datasets = written(MeshColumns.of(mesh), at=Place(below))
    output = Output(datasets, {}, "toy")
    found = mesh_from(write_artefact(tmp_path / "import.h5", output, Header("import", 1, "key", {}, {}, {})), below)
    assert len(mesh.rigid) == len(mesh.averaging) == len(mesh.point_masses) - 1 == len(mesh.loads) == len(mesh.axes) == 1
    assert [len(own.value) for own in mesh.relations] == [3, 1]
    assert len(mesh.shells) == len(mesh.beams) == 2
    assert len(mesh.sections) == 7
    assert len(mesh.laminae) == len(mesh.anisotropic) == len(mesh.orientations) == 1
    assert len(mesh.arms) == 2 * (4 + 3 + 3 + 3) + 16  # a shell has two faces, a beam without pins four sides
    for field in fields(Mesh):
        if field.name not in ("source", "included", "origin", "read"):  # of the deck, not of the model
            own, there = getattr(mesh, field.name), getattr(found, field.name)
            assert same(own, there), field.name
