"""One structure of shells, beams and rods, written as a Nastran and as an Abaqus deck, has the same K, M, load and supports."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.decks.abaqus.deck import read_abaqus
from strainsight.decks.nastran.deck import read_nastran
from strainsight.fem.loads import PointLoad, input_shape
from strainsight.fem.model import build_model

POINTS = [(0, 0, 0), (1, 0, 0.02), (2, 0, 0), (0, 1, 0), (1, 1, 0), (2, 1, 0), (3, 0.5, 0), (0, 0, 1), (2, 1, 1)]
GRIDS = "".join(f"GRID,{i},,{x},{y},{z}\n" for i, (x, y, z) in enumerate(POINTS, start=1))
NODES = "*NODE\n" + "".join(f"{i}, {x}, {y}, {z}\n" for i, (x, y, z) in enumerate(POINTS, start=1))


def offset(of: int, to: int, n1: tuple[float, float, float], place: tuple[float, float]) -> str:
    """A place along n1 and n2 of a beam as three fields along the basic axes."""
    t = np.subtract(POINTS[to - 1], POINTS[of - 1], dtype=float)
    n2 = np.cross(t, n1)
    n1_square = np.cross(n2, t)
    w = place[0] * n1_square / np.linalg.norm(n1_square) + place[1] * n2 / np.linalg.norm(n2)
    return ",".join(f"{c:.16f}"[:16] for c in w)


# an I 0.1 high with flanges 0.08 × 0.01 below and 0.05 × 0.012 above, a web of 0.006, its node 0.03 above the foot
A = np.array([0.08 * 0.01, 0.078 * 0.006, 0.05 * 0.012])
FOOT = float(A @ [0.005, 0.049, 0.094] / A.sum())
N1 = (0.0, 1.0, 0.3)
T = np.subtract(POINTS[2], POINTS[7], dtype=float)
UP = np.cross(T, N1)

NASTRAN = f"""\
{GRIDS}CQUAD4,10,1,1,2,5,4,,-.01
CQUAD4,11,1,2,3,6,5,,-.01
CTRIA3,12,2,3,7,6
CBAR,20,3,8,3,{UP[0]:.6f},{UP[1]:.6f},{UP[2]:.6f}
,,,{offset(8, 3, N1, (0.0, FOOT - 0.03))},{offset(8, 3, N1, (0.0, FOOT - 0.03))}
CBAR,21,4,6,9,1.,0.,0.
CBAR,22,5,9,7,0.,0.,1.
CROD,23,6,8,9
PSHELL,1,1,.02,1,,1
PSHELL,2,1,.03,1,,1,,4.
PBARL,3,1,,I
,.1,.08,.05,.006,.01,.012
PBARL,4,1,,BAR
,.04,.07
PBAR,5,2,.002,4.-6,2.-6,3.-6
,,,,,,,,
,1.,1.,1.-6
PROD,6,1,.001
MAT1,1,2.1+11,,.3,7850.
MAT1,2,7.+10,,.25,2700.
SPC1,1,123456,1,4
SPC1,1,24,7
PLOAD2,5,3.E3,10,THRU,12
"""
ABAQUS = f"""\
{NODES}*ELEMENT, TYPE=S4, ELSET=PLATE
10, 1, 2, 5, 4
11, 2, 3, 6, 5
*ELEMENT, TYPE=S3, ELSET=TIP
12, 3, 7, 6
*ELEMENT, TYPE=B31, ELSET=STRUT
20, 8, 3
*ELEMENT, TYPE=B31, ELSET=POST
21, 6, 9
*ELEMENT, TYPE=B31, ELSET=STAY
22, 9, 7
*ELEMENT, TYPE=T3D2, ELSET=ROD
23, 8, 9
*SHELL SECTION, ELSET=PLATE, MATERIAL=STEEL, OFFSET=SPOS
.02
*SHELL SECTION, ELSET=TIP, MATERIAL=STEEL, DENSITY=4.
.03
*BEAM SECTION, ELSET=STRUT, MATERIAL=STEEL, SECTION=I
.03, .1, .08, .05, .01, .012, .006
{N1[0]}, {N1[1]}, {N1[2]}
*BEAM SECTION, ELSET=POST, MATERIAL=STEEL, SECTION=RECT
.07, .04
1., 0., 0.
*BEAM GENERAL SECTION, ELSET=STAY, SECTION=GENERAL, DENSITY=2700.
.002, 2.e-6, 1.e-6, 4.e-6, 3.e-6
0., 0., 1.
7.e10, 2.8e10
*SOLID SECTION, ELSET=ROD, MATERIAL=STEEL
.001
*MATERIAL, NAME=STEEL
*ELASTIC
2.1e11, .3
*DENSITY
7850.
*BOUNDARY
1, ENCASTRE
4, 1, 6
7, 2
7, 4
*DLOAD
PLATE, P, 3.e3
TIP, P, 3.e3
"""


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


@pytest.fixture(scope="module")
def both(tmp_path_factory):
    folder = tmp_path_factory.mktemp("decks")
    (folder / "a.bdf").write_text(NASTRAN)
    (folder / "a.inp").write_text(ABAQUS)
    return read_nastran(folder / "a.bdf"), read_abaqus(folder / "a.inp")


def test_stiffness_mass_and_supports_are_the_same(both):
    nastran, abaqus = (build_model(mesh) for mesh in both)
    for a, b in ((nastran.stiffness, abaqus.stiffness), (nastran.mass, abaqus.mass)):
        X, Y = a.constant.toarray(), b.constant.toarray()
        assert X.shape == Y.shape
        np.testing.assert_allclose(Y, X, atol=1e-9 * np.abs(X).max())


def test_numbers_kinds_and_thicknesses_are_the_same(both):
    nastran, abaqus = both
    np.testing.assert_array_equal(abaqus.fixed, nastran.fixed)
    for a, b in zip(nastran.thin, abaqus.thin, strict=True):
        assert a.kind == b.kind
        np.testing.assert_array_equal(b.ids, a.ids)
        np.testing.assert_array_equal(b.nodes, a.nodes)
        np.testing.assert_array_equal(b.region, a.region)


def test_a_pressure_is_the_same(both):
    """P of *DLOAD and PLOAD2 both act along the normal by the right-hand rule."""
    shapes = []
    for mesh, name in zip(both, ("LOAD-5", "DLOAD-1"), strict=True):
        shapes.append(input_shape(build_model(mesh), [PointLoad("p", deck_load=name, factor=True)]))
    assert np.abs(shapes[0]).max() > 0
    np.testing.assert_allclose(shapes[1], shapes[0], atol=1e-9 * np.abs(shapes[0]).max())
