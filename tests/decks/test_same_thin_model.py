"""Laminates of shells, written as a Nastran and as an Abaqus deck, have the same K and M."""

from __future__ import annotations

import numpy as np

from strainsight.decks.abaqus.deck import read_abaqus
from strainsight.decks.nastran.deck import read_nastran
from strainsight.fem.model import build_model

POINTS = [(0, 0, 0), (1, 0, 0.02), (2, 0, 0), (0, 1, 0), (1, 1, 0), (2, 1, 0), (3, 0.5, 0), (0, 0, 1), (2, 1, 1)]
GRIDS = "".join(f"GRID,{i},,{x},{y},{z}\n" for i, (x, y, z) in enumerate(POINTS, start=1))
NODES = "*NODE\n" + "".join(f"{i}, {x}, {y}, {z}\n" for i, (x, y, z) in enumerate(POINTS, start=1))


# plies on a warped plate, on one across x, and of an isotropic core; x of the basic system, z, and a direction of their own
OF_PLIES = [
    f"""\
{GRIDS}CORD2R,5,,0.,0.,0.,0.,0.,1.
,1.,2.,0.
GRID,10,,0.,1.,1.
CQUAD4,10,1,1,2,5,4,0,.003
CQUAD4,11,1,2,3,6,5,0,.003
CQUAD4,12,3,1,4,10,8,90.
CTRIA3,13,2,3,7,6,5
PCOMP,1,,2.,,,,,SYM
,8,.001,0.,,8,.002,30.,
,1,.004,0.
PCOMP,2
,8,.001,0.,,8,.002,-60.
PSHELL,3,8,.003,8,,8
MAT8,8,1.4+11,1.+10,.3,5.+9,4.+9,3.+9,1600.
MAT1,1,7.+7,,.25,80.
SPC1,1,123456,7
""",
    f"""\
{NODES}10, 0., 1., 1.
*ELEMENT, TYPE=S4, ELSET=PLATE
10, 1, 2, 5, 4
11, 2, 3, 6, 5
*ELEMENT, TYPE=S4, ELSET=WALL
12, 1, 4, 10, 8
*ELEMENT, TYPE=S3, ELSET=TIP
13, 3, 7, 6
*ORIENTATION, NAME=SKEW
1., 2., 0., -2., 1., 0.
3, 0.
*SHELL SECTION, ELSET=PLATE, COMPOSITE, SYMMETRIC, DENSITY=2., OFFSET={-0.003 / 0.014:.15f}
.001, 3, CARBON, 0.
.002, 3, Carbon, 30.
.004, 3, FOAM
*SHELL SECTION, ELSET=TIP, COMPOSITE, ORIENTATION=SKEW
.001, , CARBON
.002, , CARBON, -60.
*SHELL SECTION, ELSET=WALL, MATERIAL=CARBON
.003
*MATERIAL, NAME=CARBON
*ELASTIC, TYPE=LAMINA
1.4e11, 1.e10, .3, 5.e9, 4.e9, 3.e9
*DENSITY
1600.
*MATERIAL, NAME=FOAM
*ELASTIC, TYPE=ISOTROPIC
7.e7, .25
*DENSITY
80.
*BOUNDARY
7, 1, 6
""",
]


def test_laminates_are_the_same(tmp_path):
    (tmp_path / "a.bdf").write_text(OF_PLIES[0])
    (tmp_path / "a.inp").write_text(OF_PLIES[1])
    meshes = read_nastran(tmp_path / "a.bdf"), read_abaqus(tmp_path / "a.inp")
    assert [sorted(len(own.plies) for own in mesh.sections.values()) for mesh in meshes] == [[1, 2, 6]] * 2
    nastran, abaqus = (build_model(mesh) for mesh in meshes)
    for a, b in ((nastran.stiffness, abaqus.stiffness), (nastran.mass, abaqus.mass)):
        X, Y = a.constant.toarray(), b.constant.toarray()
        assert np.abs(X).max() > 0
        np.testing.assert_allclose(Y, X, atol=1e-9 * np.abs(X).max())


